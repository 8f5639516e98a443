// How two processes that meet learn that they know the same secret, before either believes a byte
// of the other: each gives a random number, and proves by a keyed hash of both numbers and of what
// it says that it has the key. What was overheard once proves nothing again, and nothing that is
// sent tells the key. Whoever accepts hears many at a time: who is silent delays nobody.
#pragma once

#include <functional>
#include <string>
#include <vector>

#include "mpm/exec/keyed_hash.hpp"
#include "mpm/exec/launcher.hpp"
#include "sockets.hpp"

namespace mpm {

/// What a process says of itself.
struct Card {
    std::int32_t rank = 0, ranks = 0;
    std::uint64_t job = 0;
    std::uint32_t port = 0;  // at which it listens
    std::uint32_t unused = 0;
    char host[64] = "";  // that it is on
};

void put_text(char (&to)[64], const std::string& text);
/// Up to the first zero, and no further than there are bytes.
std::string text_of(const char (&from)[64]);
Card card_of(const Launch& launch, int port);

/// Connections that were sent away while processes met.
struct Dropped {
    int silent = 0;     // said nothing, or not all, in time
    int strangers = 0;  // do not speak so, or do not know the secret
    int others = 0;     // know it, and are of another job
    int crowded = 0;    // had waited longest when there were too many
    int all() const { return silent + strangers + others + crowded; }
    std::string text() const;
};

/// Of who has connected: tells `mine`, and becomes sure that the other is `rank` of the same job.
/// `secret`: asked once the other is there. Why not, or "".
std::string greet(int fd, const Card& mine, const std::function<std::string()>& secret, int rank,
                  double ends, const sockets::Hook& hook);

class Acceptor {
public:
    Acceptor(std::vector<sockets::Socket> listeners, const Card& mine, std::string secret);
    ~Acceptor();

    struct Guest {
        sockets::Socket socket;
        Card card;
    };
    /// The next that knows the secret and is of this job; without a socket at the end of time.
    Guest next(double ends, const sockets::Hook& hook);
    const Dropped& dropped() const { return dropped_; }

private:
    struct Pending;
    /// Whether it has said all, and that is right. Gone where it is not.
    bool hear(Pending& p);
    void accept_all(int listener);
    /// Whether one more can be heard, perhaps in place of the one that has been silent longest.
    bool has_room() const;

    std::vector<sockets::Socket> listeners_;
    Card mine_;
    std::string secret_;
    std::vector<Pending> pending_;  // who came first is first
    Dropped dropped_;
};

}  // namespace mpm
