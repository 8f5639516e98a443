#include "mpm/exec/rank_processes.hpp"

#include <algorithm>
#include <cstdio>
#include <limits>

#include "sockets.hpp"

namespace mpm {

namespace {

using sockets::now;
using sockets::Socket;

/// Larger ones are no messages of ours.
constexpr std::uint64_t most_bytes = std::uint64_t(1) << 46;
/// How long who stops tries to tell the others.
constexpr double seconds_to_tell = 2;
/// How long a connection that comes in may take to say who it is.
constexpr double seconds_to_greet = 5;

/// Asked while this process waits for others.
sockets::Hook hook;

/// What a process says first on each connection.
struct Hello {
    char magic[8] = {'l', 'i', 'b', 'm', 'p', 'm', 'R', '1'};
    std::int32_t rank = 0, ranks = 0;
    std::uint64_t job = 0;
    std::uint32_t port = 0;  // at which it listens
    char host[64] = "";      // that it is on
    bool ours() const { return std::memcmp(magic, Hello().magic, sizeof magic) == 0; }
};
/// Where a rank is found, as rank 0 tells all.
struct Place {
    char address[64] = "", host[64] = "";
    std::uint32_t port = 0;
};

void put_text(char (&to)[64], const std::string& text) {
    std::snprintf(to, sizeof to, "%s", text.c_str());
}
std::string text_of(const char (&from)[64]) {
    return std::string(from, strnlen(from, sizeof from));
}

std::uint64_t number_of(const std::string& job) {
    std::uint64_t hash = 14695981039346656037ull;  // FNV-1a
    for (const unsigned char c : job) hash = (hash ^ c) * 1099511628211ull;
    return hash;
}

Hello hello_of(const Launch& launch, int port) {
    Hello h;
    h.rank = launch.rank;
    h.ranks = launch.ranks;
    h.job = number_of(launch.job);
    h.port = std::uint32_t(port);
    char host[64] = "";
    ::gethostname(host, sizeof host - 1);
    put_text(h.host, host);
    return h;
}

std::string name_of(const Launch& launch) {
    return "rank " + std::to_string(launch.rank) + " of " + std::to_string(launch.ranks) +
           " (started by " + launch.launcher + ", read: " + launch.read + ")";
}

[[noreturn]] void fail(const Launch& launch, const std::string& what) {
    throw DeviceError("ranks as processes: " + name_of(launch) + ": " + what);
}

/// The next of our processes that comes in; nothing at the end of time. Strangers are sent away.
std::pair<Socket, Hello> accept_one(const Launch& launch, int listener, double ends) {
    while (sockets::wait(listener, POLLIN, ends, hook)) {
        Socket s(::accept4(listener, nullptr, nullptr, SOCK_CLOEXEC | SOCK_NONBLOCK));
        if (!s) continue;
        Hello h;
        if (!sockets::receive_all(s.get(), &h, sizeof h, std::min(ends, now() + seconds_to_greet),
                                  hook))
            continue;
        if (!h.ours() || h.job != number_of(launch.job)) continue;
        if (h.ranks != launch.ranks)
            fail(launch, "rank " + std::to_string(h.rank) + " on " + text_of(h.host) +
                             " believes that there are " + std::to_string(h.ranks) +
                             " ranks; start all with the same command");
        if (h.rank <= 0 || h.rank >= launch.ranks)
            fail(launch, "a process calls itself rank " + std::to_string(h.rank));
        return {std::move(s), h};
    }
    return {};
}

}  // namespace

double RankProcesses::patience = 30;

void RankProcesses::while_waiting(std::function<void()> ask) { hook = std::move(ask); }

RankProcesses::RankProcesses(const Launch& launch, double seconds)
    : launch_(launch), peers_(std::size_t(launch.ranks)) {
    if (launch_.ranks == 1) return;
    const double ends = now() + seconds;
    try {
        if (launch_.rank == 0)
            listen_first(ends);
        else
            find_first(ends);
    } catch (...) {
        close_all();
        throw;
    }
}

RankProcesses::~RankProcesses() { close_all(); }

void RankProcesses::close_all() noexcept {
    if (told_) {
        // Closing with messages unread would take back the word that work has ended.
        for (const Peer& p : peers_)
            if (p.socket >= 0) ::shutdown(p.socket, SHUT_WR);
        const double ends = now() + 1;
        for (const Peer& p : peers_) {
            char rest[65536];
            while (p.socket >= 0 && sockets::wait(p.socket, POLLIN, ends) &&
                   ::recv(p.socket, rest, sizeof rest, MSG_DONTWAIT) > 0) {
            }
        }
    }
    for (Peer& p : peers_) {
        if (p.socket >= 0) ::close(p.socket);
        p.socket = -1;
    }
}

void RankProcesses::missing(const std::vector<int>& ranks, const std::string& what) const {
    std::string list;
    for (int r : ranks) list += (list.empty() ? "" : ", ") + std::to_string(r);
    fail(launch_, what + " rank" + (ranks.size() > 1 ? "s " : " ") + list +
                      "; the place to meet is " + launch_.host + ":" +
                      std::to_string(launch_.port) +
                      ". Start all processes by one mpirun, srun or torchrun, or set "
                      "LIBMPM_MASTER=host:port to a place that all reach");
}

void RankProcesses::join(int rank, int socket) {
    sockets::prepare(socket);
    peers_[std::size_t(rank)].socket = socket;
}

/// Of rank 0: waits for all, and tells them where they are.
void RankProcesses::listen_first(double ends) {
    const Socket listener =
        sockets::listen_at(launch_.port, sockets::is_loopback(launch_.host), launch_.ranks + 16);
    std::vector<Place> places(peers_.size());
    std::vector<std::string> hosts(peers_.size());
    put_text(places[0].host, hello_of(launch_, 0).host);
    for (int come = 1; come < ranks(); ++come) {
        auto [socket, hello] = accept_one(launch_, listener.get(), ends);
        if (!socket) {
            std::vector<int> gone;
            for (int r : others())
                if (peers_[std::size_t(r)].socket < 0) gone.push_back(r);
            missing(gone, "nothing was heard in time of");
        }
        Peer& peer = peers_[std::size_t(hello.rank)];
        if (peer.socket >= 0)
            fail(launch_, "two processes call themselves rank " + std::to_string(hello.rank) +
                              ", the later on " + text_of(hello.host));
        Place& place = places[std::size_t(hello.rank)];
        put_text(place.address, sockets::address_of_peer(socket.get()));
        put_text(place.host, text_of(hello.host));
        place.port = hello.port;
        join(hello.rank, socket.release());
    }
    for (int r : others())
        if (!sockets::send_all(peers_[std::size_t(r)].socket, places.data(),
                               places.size() * sizeof(Place), ends, hook))
            missing({r}, "the connection broke to");
    for (std::size_t r = 0; r < places.size(); ++r) hosts[r] = text_of(places[r].host);
    find_locals(hosts);
}

/// Of all others: finds rank 0, and by its word those in between.
void RankProcesses::find_first(double ends) {
    const Socket listener =
        sockets::listen_at(0, sockets::is_loopback(launch_.host), launch_.ranks + 16);
    const Hello hello = hello_of(launch_, sockets::port_of(listener.get()));
    auto [first, why] = sockets::connect_to(launch_.host, launch_.port, ends, hook);
    if (!first) missing({0}, "cannot be reached in time (" + why + "):");
    std::vector<Place> places(peers_.size());
    const std::string address = sockets::address_of_peer(first.get());
    if (!sockets::send_all(first.get(), &hello, sizeof hello, ends, hook) ||
        !sockets::receive_all(first.get(), places.data(), places.size() * sizeof(Place), ends,
                              hook))
        missing({0}, "no word came in time of who is where, from");
    join(0, first.release());
    for (int r = 1; r < rank(); ++r) {
        const Place& place = places[std::size_t(r)];
        std::string where = text_of(place.address);
        // Who reached rank 0 from its own host is to be found on that host.
        if (sockets::is_loopback(where)) where = address;
        auto [socket, reason] = sockets::connect_to(where, int(place.port), ends, hook);
        if (!socket || !sockets::send_all(socket.get(), &hello, sizeof hello, ends, hook))
            missing({r}, "cannot be reached at " + where + ":" + std::to_string(place.port) +
                             " in time (" + reason + "):");
        join(r, socket.release());
    }
    for (int r = rank() + 1; r < ranks(); ++r) {
        auto [socket, who] = accept_one(launch_, listener.get(), ends);
        if (!socket) {
            std::vector<int> gone;
            for (int k = rank() + 1; k < ranks(); ++k)
                if (peers_[std::size_t(k)].socket < 0) gone.push_back(k);
            missing(gone, "no connection came in time from");
        }
        if (peers_[std::size_t(who.rank)].socket >= 0)
            fail(launch_, "two processes call themselves rank " + std::to_string(who.rank));
        join(who.rank, socket.release());
    }
    std::vector<std::string> hosts;
    for (const Place& place : places) hosts.push_back(text_of(place.host));
    find_locals(hosts);
}

void RankProcesses::find_locals(const std::vector<std::string>& hosts) {
    const auto here = [&](const std::string& host) { return host == hosts[std::size_t(rank())]; };
    local_ranks_ = int(std::count_if(hosts.begin(), hosts.end(), here));
    local_rank_ = int(std::count_if(hosts.begin(), hosts.begin() + rank(), here));
}

std::vector<Bytes> RankProcesses::exchange(std::vector<Bytes> to, const std::vector<int>& peers) {
    end_if_stopped();
    std::vector<Bytes> in(peers_.size());
    for (int p : peers) {
        Outgoing out;
        out.bytes = std::move(to.at(std::size_t(p)));
        out.header.size = out.bytes.size();
        peers_.at(std::size_t(p)).out.push_back(std::move(out));
        write(p);
    }
    double began = 0;
    while (true) {
        std::vector<int> awaited;
        for (int p : peers) {
            const Peer& peer = peers_[std::size_t(p)];
            const bool done = !peer.in.empty() && peer.out.empty();
            if (done) continue;
            awaited.push_back(p);
            miss(p);
        }
        // First: a faster rank may have ended its work behind the last message to this one.
        if (awaited.empty()) break;
        end_if_stopped();
        if (move(sockets::slice)) continue;
        if (began == 0) began = now();
        ask(awaited, began);
    }
    for (int p : peers) {
        Peer& peer = peers_[std::size_t(p)];
        in[std::size_t(p)] = std::move(peer.in.front());
        peer.in.pop_front();
    }
    return in;
}

void RankProcesses::ask(const std::vector<int>& awaited, double& began) {
    if (hook) {
        try {
            hook();
        } catch (...) {
            stop("rank " + std::to_string(rank()) + " was interrupted while it waited");
            throw;
        }
    }
    if (now() - began < patience) return;
    began = std::numeric_limits<double>::infinity();  // once is enough
    std::string list;
    for (int p : awaited) list += (list.empty() ? "" : ", ") + std::to_string(p);
    std::fprintf(stderr, "libmpm: rank %d of %d has waited %g s for rank%s %s, and goes on\n",
                 rank(), ranks(), patience, awaited.size() > 1 ? "s" : "", list.c_str());
}

void RankProcesses::check() {
    move(0);
    end_if_stopped();
}

void RankProcesses::check_awaited(const std::vector<int>& ranks) {
    move(0);
    for (int p : ranks) miss(p);
    end_if_stopped();
}

void RankProcesses::miss(int rank) {
    const Peer& peer = peers_[std::size_t(rank)];
    if (!peer.ended || stopped_) return;
    stop("rank " + std::to_string(rank) + " has ended or is out of reach (" + peer.how +
         ") while rank " + std::to_string(launch_.rank) + " waited for it");
}

void RankProcesses::stop(const std::string& why) noexcept {
    if (stopped_) return;  // all have been told, or will be before this rank ends
    stopped_ = true;
    try {
        why_ = why;
    } catch (...) {
    }
    tell();
}

/// What was heard is passed on before this rank ends: others would find its connection closed, and
/// not know why, if the word of who stopped came to them later.
void RankProcesses::end_if_stopped() {
    if (!stopped_) return;
    if (!told_) tell();
    throw RankStopped(why_);
}

void RankProcesses::tell() noexcept {
    told_ = true;
    try {
        for (Peer& p : peers_) {
            if (p.socket < 0 || p.ended) continue;
            Outgoing out;
            out.header = {Kind::stop, 0, why_.size()};
            out.bytes.assign(why_.begin(), why_.end());
            p.out.push_back(std::move(out));
        }
        const double ends = now() + seconds_to_tell;
        const auto waits = [](const Peer& p) { return !p.ended && !p.out.empty(); };
        while (std::any_of(peers_.begin(), peers_.end(), waits) && now() < ends) move(50);
    } catch (...) {
        // Then the others find the connection closed.
    }
}

bool RankProcesses::move(int milliseconds) {
    std::vector<pollfd> ready;
    std::vector<int> who;
    for (int r = 0; r < ranks(); ++r) {
        const Peer& p = peers_[std::size_t(r)];
        if (p.socket < 0 || p.ended) continue;
        ready.push_back({p.socket, short(POLLIN | (p.out.empty() ? 0 : POLLOUT)), 0});
        who.push_back(r);
    }
    if (ready.empty()) return false;
    if (::poll(ready.data(), nfds_t(ready.size()), milliseconds) <= 0) return false;
    for (std::size_t k = 0; k < ready.size(); ++k) {
        if (ready[k].revents & (POLLIN | POLLHUP | POLLERR)) read(who[k]);
        if (ready[k].revents & POLLOUT) write(who[k]);
    }
    return true;
}

void RankProcesses::end(int rank, const std::string& how) {
    Peer& p = peers_[std::size_t(rank)];
    if (p.ended) return;
    p.ended = true;
    p.how = how;
}

void RankProcesses::write(int rank) {
    Peer& p = peers_[std::size_t(rank)];
    while (!p.ended && !p.out.empty()) {
        Outgoing& out = p.out.front();
        const std::size_t size = out.bytes.size();
        iovec parts[2];
        int count = 0;
        const std::size_t head = std::min(out.gone, sizeof(Header)), body = out.gone - head;
        if (head < sizeof(Header))
            parts[count++] = {reinterpret_cast<char*>(&out.header) + head, sizeof(Header) - head};
        if (body < size) parts[count++] = {out.bytes.data() + body, size - body};
        msghdr message{};
        message.msg_iov = parts;
        message.msg_iovlen = std::size_t(count);
        const ssize_t n = ::sendmsg(p.socket, &message, MSG_NOSIGNAL | MSG_DONTWAIT);
        if (n < 0) {
            if (errno == EINTR) continue;
            if (errno == EAGAIN || errno == EWOULDBLOCK) return;
            const std::string how = sockets::last_error();
            read(rank);  // perhaps it has said why
            end(rank, how);
            return;
        }
        out.gone += std::size_t(n);
        if (out.gone == sizeof(Header) + size) p.out.pop_front();
    }
}

void RankProcesses::read(int rank) {
    Peer& p = peers_[std::size_t(rank)];
    while (!p.ended) {
        const bool head = p.come < sizeof(Header);
        const std::size_t body = head ? 0 : p.come - sizeof(Header),
                          wanted = head ? sizeof(Header) - p.come : p.coming.size() - body;
        if (wanted > 0) {
            unsigned char* at = head ? reinterpret_cast<unsigned char*>(&p.header) + p.come
                                     : p.coming.data() + body;
            const ssize_t n = ::recv(p.socket, at, wanted, MSG_DONTWAIT);
            if (n < 0) {
                if (errno == EINTR) continue;
                if (errno == EAGAIN || errno == EWOULDBLOCK) return;
                return end(rank, sockets::last_error());
            }
            if (n == 0) return end(rank, "it has closed the connection");
            p.come += std::size_t(n);
            if (head && p.come == sizeof(Header)) {
                const bool known = p.header.kind == Kind::message || p.header.kind == Kind::stop;
                if (!known || p.header.size > most_bytes)
                    return end(rank, "it has sent what is no message");
                p.coming.resize(p.header.size);
            }
        }
        if (p.come < sizeof(Header) || p.come - sizeof(Header) < p.coming.size()) continue;
        p.come = 0;
        if (p.header.kind == Kind::message) {
            p.in.push_back(std::exchange(p.coming, {}));
            continue;
        }
        if (!stopped_) why_.assign(p.coming.begin(), p.coming.end());
        stopped_ = true;
        p.coming.clear();
        return;
    }
}

}  // namespace mpm
