#include "mpm/exec/rank_processes.hpp"

#include <algorithm>
#include <cstdio>
#include <limits>
#include <optional>

#include "handshake.hpp"
#include "mpm/exec/secret.hpp"

namespace mpm {

namespace {

using sockets::now;
using sockets::Socket;

/// How long who stops tries to tell the others.
constexpr double seconds_to_tell = 2;
/// Asked while this process waits for others.
sockets::Hook hook;

/// Where a rank is found, as rank 0 tells all.
struct Place {
    char address[64] = "", host[64] = "";
    std::uint32_t port = 0;
};

std::string name_of(const Launch& launch) {
    return "rank " + std::to_string(launch.rank) + " of " + std::to_string(launch.ranks) +
           " (started by " + launch.launcher + ", read: " + launch.read + ")";
}

[[noreturn]] void fail(const Launch& launch, const std::string& what) {
    throw DeviceError("ranks as processes: " + name_of(launch) + ": " + what);
}

/// Of a job on one host whose user gave no secret: the file in which rank 0 leaves one.
std::string file_of(const Launch& launch) {
    const Card card = card_of(launch, launch.port);
    return "ranks-" + std::to_string(launch.port) + "-" + std::to_string(card.job);
}

/// Connections that the system keeps until they are heard.
constexpr int most_waiting = 1024;

/// Who has proved to be of this job, and says something that cannot be.
void check_guest(const Launch& launch, const Card& card, int least) {
    const std::string who = "rank " + std::to_string(card.rank) + " on " + text_of(card.host);
    if (card.ranks != launch.ranks)
        fail(launch, who + " believes that there are " + std::to_string(card.ranks) +
                         " ranks; start all with the same command");
    if (card.rank < least || card.rank >= launch.ranks || card.port > 65535)
        fail(launch, "a process calls itself rank " + std::to_string(card.rank) + ", at port " +
                         std::to_string(card.port));
}

/// Where rank 0 listens: where the others will look for it, and nowhere else.
std::vector<Socket> listen_first_at(const Launch& launch) {
    const std::string& place = launch.listen.empty() ? launch.host : launch.listen;
    std::string why = "no address";
    const auto all = sockets::addresses_of(place, launch.port, why);
    const bool on_loopback = sockets::is_loopback(launch.host);
    std::vector<Socket> out;
    int error = 0;
    bool skipped = false;
    for (const sockaddr_storage& at : all) {
        // Names of hosts are often given an address of the loopback interface by these themselves.
        if (!on_loopback && sockets::is_loopback(at) && !launch.one_host && launch.listen.empty()) {
            skipped = true;
            continue;
        }
        auto [socket, failed] = sockets::listen_at(at, most_waiting);
        if (socket)
            out.push_back(std::move(socket));
        else if (error != EADDRINUSE)
            error = failed;
    }
    const std::string at = place + ":" + std::to_string(launch.port);
    if (error == EADDRINUSE || (out.empty() && error == EACCES))
        fail(launch, "cannot listen at " + at + ": " + std::strerror(error) +
                         "; another job may use it: set LIBMPM_MASTER=host:port");
    if (!out.empty()) return out;
    if (skipped)
        fail(launch,
             "'" + place +
                 "' is the loopback interface to this host, where other hosts do not "
                 "reach it; set LIBMPM_LISTEN to the address of this host in their network");
    fail(launch, "cannot listen at " + at + ": " + (error ? std::strerror(error) : why) +
                     "; rank 0 must run on the host that LIBMPM_MASTER or MASTER_ADDR names, or "
                     "set LIBMPM_LISTEN to an address of its host");
}

}  // namespace

double RankProcesses::patience = 30;

void RankProcesses::while_waiting(std::function<void()> ask) { hook = std::move(ask); }

RankProcesses::RankProcesses(const Launch& launch, double seconds)
    : launch_(launch), peers_(std::size_t(launch.ranks)) {
    if (launch_.ranks == 1) return;
    if (launch_.secret.empty() && !sockets::is_loopback(launch_.host))
        fail(launch_, "the processes meet at " + launch_.host + ":" + std::to_string(launch_.port) +
                          ", which other hosts reach, and have no secret by which they know each "
                          "other. Set LIBMPM_SECRET for all of them, such as "
                          "`export LIBMPM_SECRET=$(openssl rand -hex 32)` before mpirun -x "
                          "LIBMPM_SECRET, srun or torchrun; or LIBMPM_SECRET_FILE to a file of "
                          "mode 600 that all hosts see (docs/ranks.md)");
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

void RankProcesses::missing(const std::vector<int>& ranks, const std::string& what,
                            const std::string& more) const {
    std::string list;
    for (int r : ranks) list += (list.empty() ? "" : ", ") + std::to_string(r);
    fail(launch_, what + " rank" + (ranks.size() > 1 ? "s " : " ") + list +
                      "; the place to meet is " + launch_.host + ":" +
                      std::to_string(launch_.port) + more +
                      ". Start all processes by one mpirun, srun or torchrun, or set "
                      "LIBMPM_MASTER=host:port to a place that all reach");
}

void RankProcesses::join(int rank, int socket) {
    sockets::prepare(socket);
    peers_[std::size_t(rank)].socket = socket;
}

/// Of rank 0: waits for all, and tells them where they are.
void RankProcesses::listen_first(double ends) {
    auto listeners = listen_first_at(launch_);
    // The port is this process's alone now, and so is the file.
    std::optional<SecretFile> file;
    if (launch_.secret.empty()) launch_.secret = file.emplace(file_of(launch_)).make();
    const Card mine = card_of(launch_, launch_.port);
    Acceptor acceptor(std::move(listeners), mine, launch_.secret);
    std::vector<Place> places(peers_.size());
    std::vector<std::string> hosts(peers_.size());
    put_text(places[0].host, text_of(mine.host));
    for (int come = 1; come < ranks(); ++come) {
        auto [socket, card] = acceptor.next(ends, hook);
        dropped_ = acceptor.dropped().all();
        if (!socket) {
            std::vector<int> gone;
            for (int r : others())
                if (peers_[std::size_t(r)].socket < 0) gone.push_back(r);
            const std::string dropped = acceptor.dropped().text();
            missing(gone, "nothing was heard in time of",
                    dropped.empty() ? "" : "; connections that were dropped: " + dropped);
        }
        check_guest(launch_, card, 1);
        Peer& peer = peers_[std::size_t(card.rank)];
        if (peer.socket >= 0)
            fail(launch_, "two processes call themselves rank " + std::to_string(card.rank) +
                              ", the later on " + text_of(card.host));
        Place& place = places[std::size_t(card.rank)];
        put_text(place.address, sockets::address_of_peer(socket.get()));
        put_text(place.host, text_of(card.host));
        place.port = card.port;
        join(card.rank, socket.release());
    }
    for (int r : others())
        if (!sockets::send_all(peers_[std::size_t(r)].socket, places.data(),
                               places.size() * sizeof(Place), ends, hook))
            missing({r}, "the connection broke to");
    for (std::size_t r = 0; r < places.size(); ++r) hosts[r] = text_of(places[r].host);
    find_locals(hosts);
    say_dropped(acceptor.dropped().text(), dropped_);
}

/// Of all others: finds rank 0, and by its word those in between.
void RankProcesses::find_first(double ends) {
    std::optional<SecretFile> file;
    if (launch_.secret.empty()) file.emplace(file_of(launch_));
    // Rank 0 answers when it has made the file, and not before.
    std::string known = launch_.secret;
    const auto secret = [&] { return file ? known = file->read() : known; };
    // Others find this process where rank 0 has seen it, and nowhere else.
    Socket listener;
    Card mine;
    auto [first, why] =
        sockets::connect_to(launch_.host, launch_.port, ends, hook, [&](const Socket& s) {
            auto [heard, failed] = sockets::listen_at(sockets::own_address(s.get()), most_waiting);
            if (!heard) return "this host cannot listen: " + std::string(std::strerror(failed));
            listener = std::move(heard);
            mine = card_of(launch_, sockets::port_of(listener.get()));
            return greet(s.get(), mine, secret, 0, ends, hook);
        });
    if (!first) missing({0}, "cannot be reached in time (" + why + "):");
    launch_.secret = known;
    file.reset();
    std::vector<Place> places(peers_.size());
    const std::string address = sockets::address_of_peer(first.get());
    if (!sockets::receive_all(first.get(), places.data(), places.size() * sizeof(Place), ends,
                              hook))
        missing({0}, "no word came in time of who is where, from");
    join(0, first.release());
    const auto own_secret = [&] { return launch_.secret; };
    for (int r = 1; r < rank(); ++r) {
        const Place& place = places[std::size_t(r)];
        if (place.port > 65535)
            fail(launch_, "rank 0 has sent port " + std::to_string(place.port) + " of rank " +
                              std::to_string(r));
        std::string where = text_of(place.address);
        // Who reached rank 0 from its own host is to be found on that host.
        if (sockets::is_loopback(where)) where = address;
        auto [socket, reason] = sockets::connect_to(
            where, int(place.port), ends, hook,
            [&](const Socket& s) { return greet(s.get(), mine, own_secret, r, ends, hook); });
        if (!socket)
            missing({r}, "cannot be reached at " + where + ":" + std::to_string(place.port) +
                             " in time (" + reason + "):");
        join(r, socket.release());
    }
    std::vector<Socket> listeners;
    listeners.push_back(std::move(listener));
    Acceptor acceptor(std::move(listeners), mine, launch_.secret);
    for (int r = rank() + 1; r < ranks(); ++r) {
        auto [socket, card] = acceptor.next(ends, hook);
        dropped_ = acceptor.dropped().all();
        if (!socket) {
            std::vector<int> gone;
            for (int k = rank() + 1; k < ranks(); ++k)
                if (peers_[std::size_t(k)].socket < 0) gone.push_back(k);
            missing(gone, "no connection came in time from");
        }
        check_guest(launch_, card, rank() + 1);
        if (peers_[std::size_t(card.rank)].socket >= 0)
            fail(launch_, "two processes call themselves rank " + std::to_string(card.rank));
        join(card.rank, socket.release());
    }
    std::vector<std::string> hosts;
    for (const Place& place : places) hosts.push_back(text_of(place.host));
    find_locals(hosts);
    say_dropped(acceptor.dropped().text(), dropped_);
}

void RankProcesses::say_dropped(const std::string& what, int count) {
    if (count > 0)
        std::fprintf(stderr,
                     "libmpm: rank %d of %d has dropped %d connection%s while the ranks met: %s\n",
                     rank(), ranks(), count, count > 1 ? "s" : "", what.c_str());
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
            const bool done = peer.in.whole() > 0 && peer.out.empty();
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
        in[std::size_t(p)] = peers_[std::size_t(p)].in.take();
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
    if (!broken_.empty()) return stop(broken_);
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
    if (!broken_.empty()) stop(broken_);
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
            const std::size_t size = std::min<std::size_t>(why_.size(), Inbox::most_text);
            out.header = {FrameHeader::stop, 0, size};
            out.bytes.assign(why_.begin(), why_.begin() + std::ptrdiff_t(size));
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
        const std::size_t head = std::min(out.gone, sizeof(FrameHeader)), body = out.gone - head;
        if (head < sizeof(FrameHeader))
            parts[count++] = {reinterpret_cast<char*>(&out.header) + head,
                              sizeof(FrameHeader) - head};
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
        if (out.gone == sizeof(FrameHeader) + size) p.out.pop_front();
    }
}

void RankProcesses::read(int rank) {
    Peer& p = peers_[std::size_t(rank)];
    while (!p.ended) {
        const auto [at, wanted] = p.in.space();
        const ssize_t n = ::recv(p.socket, at, wanted, MSG_DONTWAIT);
        if (n < 0) {
            if (errno == EINTR) continue;
            if (errno == EAGAIN || errno == EWOULDBLOCK) return;
            return end(rank, sockets::last_error());
        }
        if (n == 0) return end(rank, "it has closed the connection");
        try {
            p.in.come(std::size_t(n));
        } catch (const MessageError& e) {
            broken_ = "rank " + std::to_string(rank) + " has sent " + e.what() + " to rank " +
                      std::to_string(this->rank());
            return end(rank, std::string("it has sent ") + e.what());
        }
        if (!p.in.has_stopped()) continue;
        if (!stopped_) why_ = p.in.why();
        stopped_ = true;
        return;
    }
}

}  // namespace mpm
