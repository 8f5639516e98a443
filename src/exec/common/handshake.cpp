#include "handshake.hpp"

#include <sys/random.h>

#include <cstdio>

namespace mpm {

namespace {

using sockets::now;
using sockets::Socket;

/// How long a connection that comes in may take to say who it is.
constexpr double seconds_to_greet = 5;
/// Connections that are heard at a time; one more takes the place of the first of them once that
/// has had this long. Who knows the secret needs a few milliseconds.
constexpr std::size_t most_pending = 256;
constexpr double seconds_to_itself = 1;

constexpr char magic[8] = {'l', 'i', 'b', 'm', 'p', 'm', 'R', '2'};

/// What both say at once, before either has proved anything.
struct Opening {
    char magic[8];
    unsigned char number[32];
};
/// What each says then, first who has connected.
struct Proof {
    Card card;
    Digest hash;
};
static_assert(sizeof(Card) == 88 && sizeof(Opening) == 40 && sizeof(Proof) == 120,
              "these travel as they are");

Opening open_up() {
    Opening out{};
    std::memcpy(out.magic, magic, sizeof magic);
    std::size_t have = 0;
    while (have < sizeof out.number) {
        const ssize_t n = ::getrandom(out.number + have, sizeof out.number - have, 0);
        if (n < 0 && errno != EINTR)
            throw DeviceError("the system gives no random numbers: " + sockets::last_error());
        if (n > 0) have += std::size_t(n);
    }
    return out;
}

/// By who has connected ("connects"), or by who has accepted, which binds the card of the first
/// too.
Digest prove(const std::string& secret, const char* side, const Opening& connects,
             const Opening& accepts, const Card& first, const Card* second = nullptr) {
    std::string text = std::string("libmpm ranks 2 ") + side;
    const auto add = [&](const void* data, std::size_t size) {
        text.append(static_cast<const char*>(data), size);
    };
    add(connects.number, sizeof connects.number);
    add(accepts.number, sizeof accepts.number);
    add(&first, sizeof first);
    if (second) add(second, sizeof *second);
    return keyed_hash(secret, text.data(), text.size());
}

}  // namespace

void put_text(char (&to)[64], const std::string& text) {
    std::snprintf(to, sizeof to, "%s", text.c_str());
}
std::string text_of(const char (&from)[64]) {
    return std::string(from, strnlen(from, sizeof from));
}

Card card_of(const Launch& launch, int port) {
    Card c;
    c.rank = launch.rank;
    c.ranks = launch.ranks;
    c.job = 14695981039346656037ull;  // FNV-1a
    for (const unsigned char letter : launch.job) c.job = (c.job ^ letter) * 1099511628211ull;
    c.port = std::uint32_t(port);
    char host[64] = "";
    ::gethostname(host, sizeof host - 1);
    put_text(c.host, host);
    return c;
}

std::string Dropped::text() const {
    std::string out;
    const auto add = [&](int n, const char* what) {
        if (n > 0) out += (out.empty() ? "" : ", ") + std::to_string(n) + " " + what;
    };
    add(silent, "silent or slow");
    add(strangers, "without the secret");
    add(others, "of another job");
    add(crowded, "beyond those that are heard at a time");
    return out;
}

std::string greet(int fd, const Card& mine, const std::function<std::string()>& secret, int rank,
                  double ends, const sockets::Hook& hook) {
    const Opening own = open_up();
    Opening theirs{};
    if (!sockets::send_all(fd, &own, sizeof own, ends, hook) ||
        !sockets::receive_all(fd, &theirs, sizeof theirs, ends, hook))
        return "it does not answer";
    if (std::memcmp(theirs.magic, magic, sizeof magic) != 0) return "it is not a rank of libmpm";
    const std::string key = secret();
    if (key.empty()) return "it has left no secret for the processes of its job";
    Proof told{mine, prove(key, "connects", own, theirs, mine)}, heard{};
    if (!sockets::send_all(fd, &told, sizeof told, ends, hook) ||
        !sockets::receive_all(fd, &heard, sizeof heard, ends, hook))
        return "it does not accept the secret of this process, or is of another job";
    if (!equal_in_constant_time(heard.hash, prove(key, "accepts", own, theirs, mine, &heard.card)))
        return "it does not know the secret of this process";
    const Card& card = heard.card;
    if (card.job != mine.job || card.ranks != mine.ranks || card.rank != rank)
        return "it is rank " + std::to_string(card.rank) + " of " + std::to_string(card.ranks);
    return {};
}

struct Acceptor::Pending {
    Socket socket;
    double began = 0;
    Opening own{};
    struct {
        Opening opening;
        Proof proof;
    } said{};
    std::size_t come = 0;
    bool gone = false;
};

Acceptor::Acceptor(std::vector<Socket> listeners, const Card& mine, std::string secret)
    : listeners_(std::move(listeners)), mine_(mine), secret_(std::move(secret)) {}
Acceptor::~Acceptor() = default;

bool Acceptor::has_room() const {
    return pending_.size() < most_pending || now() >= pending_.front().began + seconds_to_itself;
}

void Acceptor::accept_all(int listener) {
    while (has_room()) {
        Socket s(::accept4(listener, nullptr, nullptr, SOCK_CLOEXEC | SOCK_NONBLOCK));
        if (!s) {
            if (errno == EINTR || errno == ECONNABORTED) continue;
            // No descriptor is left: the oldest gives up its own, or the next try is later.
            if (errno == EMFILE || errno == ENFILE || errno == ENOBUFS || errno == ENOMEM) {
                if (pending_.empty()) {
                    ::usleep(20'000);
                } else {
                    pending_.erase(pending_.begin());
                    ++dropped_.crowded;
                }
            }
            return;
        }
        if (pending_.size() >= most_pending) {
            pending_.erase(pending_.begin());
            ++dropped_.crowded;
        }
        Pending p;
        p.socket = std::move(s);
        p.began = now();
        p.own = open_up();
        // The system holds so few bytes of a new connection, or it is a broken one.
        if (::send(p.socket.get(), &p.own, sizeof p.own, MSG_NOSIGNAL | MSG_DONTWAIT) !=
            ssize_t(sizeof p.own)) {
            ++dropped_.silent;
            continue;
        }
        pending_.push_back(std::move(p));
    }
}

bool Acceptor::hear(Pending& p) {
    auto* at = reinterpret_cast<unsigned char*>(&p.said);
    while (p.come < sizeof p.said) {
        const ssize_t n = ::recv(p.socket.get(), at + p.come, sizeof p.said - p.come, MSG_DONTWAIT);
        if (n < 0 && errno == EINTR) continue;
        if (n < 0 && (errno == EAGAIN || errno == EWOULDBLOCK)) return false;
        if (n <= 0) {
            p.gone = true;
            ++dropped_.silent;
            return false;
        }
        p.come += std::size_t(n);
        if (std::memcmp(p.said.opening.magic, magic, std::min(p.come, sizeof magic)) != 0) {
            p.gone = true;
            ++dropped_.strangers;
            return false;
        }
    }
    const Proof& proof = p.said.proof;
    p.gone = true;
    if (!equal_in_constant_time(proof.hash,
                                prove(secret_, "connects", p.said.opening, p.own, proof.card))) {
        ++dropped_.strangers;
        return false;
    }
    if (proof.card.job != mine_.job) {
        ++dropped_.others;
        return false;
    }
    const Proof answer{mine_, prove(secret_, "accepts", p.said.opening, p.own, proof.card, &mine_)};
    if (::send(p.socket.get(), &answer, sizeof answer, MSG_NOSIGNAL | MSG_DONTWAIT) !=
        ssize_t(sizeof answer)) {
        ++dropped_.silent;
        return false;
    }
    return true;
}

Acceptor::Guest Acceptor::next(double ends, const sockets::Hook& hook) {
    while (true) {
        double until = ends;
        std::vector<pollfd> ready;
        const bool room = has_room();
        for (const Socket& s : listeners_) ready.push_back({s.get(), short(room ? POLLIN : 0), 0});
        for (const Pending& p : pending_) ready.push_back({p.socket.get(), POLLIN, 0});
        if (!pending_.empty())
            until = std::min(
                until, pending_.front().began + (room ? seconds_to_greet : seconds_to_itself));
        const int most = int(std::clamp(until - now(), 0.0, 1e6) * 1000) + 1;
        const int n = ::poll(ready.data(), nfds_t(ready.size()),
                             hook ? std::min(most, sockets::slice) : most);
        if (n < 0 && errno != EINTR) return {};
        if (hook) hook();
        std::size_t k = listeners_.size();
        const std::size_t known = pending_.size();
        for (std::size_t i = 0; i < known; ++i, ++k) {
            Pending& p = pending_[i];
            if (n > 0 && ready[k].revents != 0 && hear(p)) {
                Guest guest{std::move(p.socket), p.said.proof.card};
                pending_.erase(pending_.begin() + std::ptrdiff_t(i));
                std::erase_if(pending_, [](const Pending& q) { return q.gone; });
                return guest;
            }
            if (!p.gone && now() >= p.began + seconds_to_greet) {
                p.gone = true;
                ++dropped_.silent;
            }
        }
        std::erase_if(pending_, [](const Pending& q) { return q.gone; });
        if (n > 0)
            for (std::size_t l = 0; l < listeners_.size(); ++l)
                if (ready[l].revents & POLLIN) accept_all(listeners_[l].get());
        if (now() >= ends) return {};
    }
}

}  // namespace mpm
