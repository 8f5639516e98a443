// Ranks as processes of a test: forked, met on this host, and asked what they have to say.
#pragma once

#include <gtest/gtest.h>
#include <netinet/in.h>
#include <sys/socket.h>
#include <sys/wait.h>
#include <unistd.h>

#include <algorithm>
#include <functional>
#include <memory>
#include <string>
#include <utility>
#include <vector>

#include "mpm/exec/rank_processes.hpp"

namespace mpm::test {

/// A port that was free a moment ago.
inline int free_port() {
    const int s = ::socket(AF_INET, SOCK_STREAM, 0);
    sockaddr_in at{};
    at.sin_family = AF_INET;
    at.sin_addr.s_addr = htonl(INADDR_LOOPBACK);
    socklen_t size = sizeof at;
    EXPECT_EQ(::bind(s, reinterpret_cast<sockaddr*>(&at), size), 0);
    ::getsockname(s, reinterpret_cast<sockaddr*>(&at), &size);
    ::close(s);
    return ntohs(at.sin_port);
}

/// A secret that the user has given.
inline const std::string given_secret = "7c0f6f5b1de94a8e8b8c52f1a0b3d4e7";

inline Launch place(int rank, int ranks, int port) {
    Launch l;
    l.launcher = "a test";
    l.rank = rank;
    l.ranks = ranks;
    l.port = port;
    l.job = "test";
    l.read = "RANK=" + std::to_string(rank);
    return l;
}

using Work = std::function<std::string(const std::shared_ptr<Communicator>&)>;

/// A rank that is a process of its own: forked, and asked what its work returned, or "threw ..."
/// where it did. One that returns "die" ends without a word.
class RankProcess {
public:
    RankProcess(const Launch& launch, const Work& work, double seconds = 20) {
        int ends[2];
        EXPECT_EQ(::pipe(ends), 0);
        pipe_ = ends[0];
        child_ = ::fork();
        if (child_ == 0) {
            std::string said;
            try {
                said = work(std::make_shared<RankProcesses>(launch, seconds));
                if (said == "die") ::_exit(3);
            } catch (const RankStopped& e) {
                said = std::string("stopped: ") + e.what();
            } catch (const std::exception& e) {
                said = std::string("threw: ") + e.what();
            }
            if (::write(ends[1], said.data(), said.size()) != ssize_t(said.size())) ::_exit(4);
            ::_exit(0);
        }
        ::close(ends[1]);
    }
    RankProcess(RankProcess&& o) noexcept
        : pipe_(std::exchange(o.pipe_, -1)), child_(std::exchange(o.child_, -1)) {}
    RankProcess& operator=(RankProcess&&) = delete;
    ~RankProcess() {
        if (child_ > 0) said();
    }
    /// Waits for its end.
    std::string said() {
        std::string out;
        char buffer[4096];
        for (ssize_t n; (n = ::read(pipe_, buffer, sizeof buffer)) > 0;)
            out.append(buffer, std::size_t(n));
        ::close(pipe_);
        ::waitpid(std::exchange(child_, -1), nullptr, 0);
        return out;
    }

private:
    int pipe_ = -1;
    pid_t child_ = -1;
};

/// What each of so many processes said; nothing of those that are absent.
inline std::vector<std::string> run_processes(int ranks, const Work& work, double seconds = 20,
                                              const std::vector<int>& absent = {}) {
    const int port = free_port();
    std::vector<std::unique_ptr<RankProcess>> made;
    for (int r = 0; r < ranks; ++r) {
        const bool comes = std::find(absent.begin(), absent.end(), r) == absent.end();
        made.push_back(comes ? std::make_unique<RankProcess>(place(r, ranks, port), work, seconds)
                             : nullptr);
    }
    std::vector<std::string> out;
    for (const auto& rank : made) out.push_back(rank ? rank->said() : std::string());
    return out;
}

}  // namespace mpm::test
