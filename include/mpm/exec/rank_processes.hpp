// Ranks that are processes, on one host or on several: a connection between each two of them, over
// which messages go in the order in which they were given. No library but the system's sockets.
#pragma once

#include <cstdint>
#include <deque>
#include <functional>
#include <string>
#include <vector>

#include "mpm/exec/communicator.hpp"
#include "mpm/exec/inbox.hpp"
#include "mpm/exec/launcher.hpp"

namespace mpm {

class RankProcesses final : public Communicator {
public:
    /// All processes of the job together: rank 0 listens, the others find it, and each learns where
    /// the others are. Whoever connects proves first that it knows the secret of the launch, and
    /// is dropped and counted where it does not. Throws DeviceError after `seconds`, which says who
    /// is missing, and where the place to meet is reached from other hosts and there is no secret.
    RankProcesses(const Launch& launch, double seconds);
    ~RankProcesses() override;
    RankProcesses(const RankProcesses&) = delete;
    RankProcesses& operator=(const RankProcesses&) = delete;

    int rank() const override { return launch_.rank; }
    int ranks() const override { return launch_.ranks; }
    bool one_process() const override { return false; }
    std::vector<Bytes> exchange(std::vector<Bytes> to, const std::vector<int>& peers) override;
    void stop(const std::string& why) noexcept override;
    void check() override;
    void check_awaited(const std::vector<int>& ranks) override;

    /// What to ask every 0.2 s while this process waits for others, at the start too: throws to
    /// give up, which ends the work of all.
    static void while_waiting(std::function<void()> ask);
    /// Seconds after which it is said on stderr, once a wait, for whom this process waits.
    static double patience;

    const Launch& launch() const { return launch_; }
    /// Processes on the host of this one, and which of them it is, in the order of ranks.
    int local_ranks() const { return local_ranks_; }
    int local_rank() const { return local_rank_; }
    /// Connections that were dropped while the ranks met: silent, without the secret, of others.
    int dropped() const { return dropped_; }

private:
    /// What is on its way out: what of it has gone is counted in bytes of the header and the body.
    struct Outgoing {
        FrameHeader header;
        Bytes bytes;
        std::size_t gone = 0;
    };
    struct Peer {
        int socket = -1;
        bool ended = false;  // it has closed the connection, or is out of reach
        std::string how;     // it ended
        std::deque<Outgoing> out;
        Inbox in;
    };

    void listen_first(double ends);
    void find_first(double ends);
    void say_dropped(const std::string& what, int count);
    void join(int rank, int socket);
    void find_locals(const std::vector<std::string>& hosts);
    /// Sends and receives what is possible; waits for it at most so long. Whether anything came.
    bool move(int milliseconds);
    /// For who has waited in vain since `began`: asks what to do, and says for whom it waits.
    void ask(const std::vector<int>& awaited, double& began);
    void read(int rank);
    void write(int rank);
    void end(int rank, const std::string& how);
    /// Ends the work of all where a rank that this one waits for has ended.
    void miss(int rank);
    /// Throws `RankStopped` where one has stopped.
    void end_if_stopped();
    /// Tells all others why.
    void tell() noexcept;
    [[noreturn]] void missing(const std::vector<int>& ranks, const std::string& what,
                              const std::string& more = {}) const;
    void close_all() noexcept;

    Launch launch_;
    std::vector<Peer> peers_;  // by rank; of this one: nothing
    int local_ranks_ = 1, local_rank_ = 0;
    int dropped_ = 0;
    bool stopped_ = false, told_ = false;
    std::string why_;
    std::string broken_;  // who has sent what is no message
};

}  // namespace mpm
