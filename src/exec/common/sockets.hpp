// The system's stream sockets, as far as ranks need them. Everything waits until a moment of a
// steady clock at most.
#pragma once

#include <netdb.h>
#include <netinet/in.h>
#include <netinet/tcp.h>
#include <poll.h>
#include <sys/socket.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <chrono>
#include <cstring>
#include <functional>
#include <string>
#include <utility>
#include <vector>

#include "mpm/core/error.hpp"

namespace mpm::sockets {

inline double now() {
    return std::chrono::duration<double>(std::chrono::steady_clock::now().time_since_epoch())
        .count();
}
inline std::string last_error() { return std::strerror(errno); }

/// Owns a descriptor.
class Socket {
public:
    Socket() = default;
    explicit Socket(int fd) : fd_(fd) {}
    Socket(Socket&& o) noexcept : fd_(std::exchange(o.fd_, -1)) {}
    Socket& operator=(Socket&& o) noexcept {
        std::swap(fd_, o.fd_);
        return *this;
    }
    ~Socket() {
        if (fd_ >= 0) ::close(fd_);
    }
    int get() const { return fd_; }
    int release() { return std::exchange(fd_, -1); }
    explicit operator bool() const { return fd_ >= 0; }

private:
    int fd_ = -1;
};

/// Milliseconds after which who waits asks whether it shall go on.
constexpr int slice = 200;
/// Asked meanwhile; throws to give up.
using Hook = std::function<void()>;

/// Whether `events` came before the end.
inline bool wait(int fd, short events, double ends, const Hook& meanwhile = {}) {
    while (true) {
        const double left = ends - now();
        pollfd p{fd, events, 0};
        const int most = int(std::clamp(left, 0.0, 1e6) * 1000) + (left > 0);
        const int n = ::poll(&p, 1, meanwhile ? std::min(most, slice) : most);
        if (n > 0) return true;
        if (n < 0 && errno != EINTR) return false;
        if (n == 0 && now() >= ends) return false;
        if (meanwhile) meanwhile();
    }
}

/// All bytes, or false at the end of time or of the connection.
inline bool send_all(int fd, const void* data, std::size_t size, double ends,
                     const Hook& meanwhile = {}) {
    const char* at = static_cast<const char*>(data);
    while (size > 0) {
        const ssize_t n = ::send(fd, at, size, MSG_NOSIGNAL | MSG_DONTWAIT);
        if (n > 0) {
            at += n;
            size -= std::size_t(n);
        } else if (n < 0 && (errno == EAGAIN || errno == EWOULDBLOCK)) {
            if (!wait(fd, POLLOUT, ends, meanwhile)) return false;
        } else if (n == 0 || errno != EINTR) {
            return false;
        }
    }
    return true;
}
inline bool receive_all(int fd, void* data, std::size_t size, double ends,
                        const Hook& meanwhile = {}) {
    char* at = static_cast<char*>(data);
    while (size > 0) {
        const ssize_t n = ::recv(fd, at, size, MSG_DONTWAIT);
        if (n > 0) {
            at += n;
            size -= std::size_t(n);
        } else if (n < 0 && (errno == EAGAIN || errno == EWOULDBLOCK)) {
            if (!wait(fd, POLLIN, ends, meanwhile)) return false;
        } else if (n == 0 || errno != EINTR) {
            return false;
        }
    }
    return true;
}

/// What ranks send is waited for; and who is out of reach shall be noticed within a minute or so.
inline void prepare(int fd) {
    const int yes = 1, idle = 30, every = 10, probes = 3;
    ::setsockopt(fd, IPPROTO_TCP, TCP_NODELAY, &yes, sizeof yes);
    ::setsockopt(fd, SOL_SOCKET, SO_KEEPALIVE, &yes, sizeof yes);
    ::setsockopt(fd, IPPROTO_TCP, TCP_KEEPIDLE, &idle, sizeof idle);
    ::setsockopt(fd, IPPROTO_TCP, TCP_KEEPINTVL, &every, sizeof every);
    ::setsockopt(fd, IPPROTO_TCP, TCP_KEEPCNT, &probes, sizeof probes);
}

inline bool is_loopback(const std::string& host) {
    return host == "localhost" || host == "::1" || host.rfind("127.", 0) == 0;
}

/// Of a host, as the system finds them; each once.
inline std::vector<sockaddr_storage> addresses_of(const std::string& host, int port,
                                                  std::string& why) {
    addrinfo hints{}, *found = nullptr;
    hints.ai_family = AF_UNSPEC;
    hints.ai_socktype = SOCK_STREAM;
    const int failed = ::getaddrinfo(host.c_str(), std::to_string(port).c_str(), &hints, &found);
    if (failed) why = ::gai_strerror(failed);
    std::vector<sockaddr_storage> out;
    for (const addrinfo* a = failed ? nullptr : found; a; a = a->ai_next) {
        if (a->ai_family != AF_INET && a->ai_family != AF_INET6) continue;
        sockaddr_storage at{};
        std::memcpy(&at, a->ai_addr, a->ai_addrlen);
        const bool twice = std::any_of(out.begin(), out.end(), [&](const sockaddr_storage& o) {
            return std::memcmp(&o, &at, sizeof at) == 0;
        });
        if (!twice) out.push_back(at);
    }
    if (!failed) ::freeaddrinfo(found);
    return out;
}
inline socklen_t size_of(const sockaddr_storage& at) {
    return at.ss_family == AF_INET6 ? sizeof(sockaddr_in6) : sizeof(sockaddr_in);
}
inline bool is_loopback(const sockaddr_storage& at) {
    if (at.ss_family == AF_INET6)
        return IN6_IS_ADDR_LOOPBACK(&reinterpret_cast<const sockaddr_in6&>(at).sin6_addr);
    return ntohl(reinterpret_cast<const sockaddr_in&>(at).sin_addr.s_addr) >> 24 == 127;
}

/// Listens at one address and its port (0: any that is free), and at no other. Else why not.
inline std::pair<Socket, int> listen_at(const sockaddr_storage& at, int most) {
    // Who was heard may be gone before it is accepted: that must not wait for the next.
    Socket s(::socket(at.ss_family, SOCK_STREAM | SOCK_CLOEXEC | SOCK_NONBLOCK, 0));
    if (!s) return {Socket(), errno};
    const int yes = 1;
    ::setsockopt(s.get(), SOL_SOCKET, SO_REUSEADDR, &yes, sizeof yes);
    if (at.ss_family == AF_INET6)
        ::setsockopt(s.get(), IPPROTO_IPV6, IPV6_V6ONLY, &yes, sizeof yes);
    if (::bind(s.get(), reinterpret_cast<const sockaddr*>(&at), size_of(at)) != 0 ||
        ::listen(s.get(), most) != 0)
        return {Socket(), errno};
    return {std::move(s), 0};
}

/// Where a connection ends on this side, at any port that is free.
inline sockaddr_storage own_address(int fd) {
    sockaddr_storage at{};
    socklen_t size = sizeof at;
    ::getsockname(fd, reinterpret_cast<sockaddr*>(&at), &size);
    if (at.ss_family == AF_INET6)
        reinterpret_cast<sockaddr_in6&>(at).sin6_port = 0;
    else
        reinterpret_cast<sockaddr_in&>(at).sin_port = 0;
    return at;
}

inline int port_of(int fd) {
    sockaddr_storage at{};
    socklen_t size = sizeof at;
    ::getsockname(fd, reinterpret_cast<sockaddr*>(&at), &size);
    return at.ss_family == AF_INET6 ? ntohs(reinterpret_cast<const sockaddr_in6*>(&at)->sin6_port)
                                    : ntohs(reinterpret_cast<const sockaddr_in*>(&at)->sin_port);
}

/// The address at the other end, in digits.
inline std::string address_of_peer(int fd) {
    sockaddr_storage at{};
    socklen_t size = sizeof at;
    char host[NI_MAXHOST] = "";
    if (::getpeername(fd, reinterpret_cast<sockaddr*>(&at), &size) != 0 ||
        ::getnameinfo(reinterpret_cast<sockaddr*>(&at), size, host, sizeof host, nullptr, 0,
                      NI_NUMERICHOST) != 0)
        return {};
    const std::string text = host, mapped = "::ffff:";
    return text.rfind(mapped, 0) == 0 ? text.substr(mapped.size()) : text;
}

/// Connected to a host, tried until the end: who listens may come later. `greet` says of a
/// connection why it is not the one that is looked for; "" where it is. Else why there is none.
template <class Greet>
std::pair<Socket, std::string> connect_to(const std::string& host, int port, double ends,
                                          const Hook& meanwhile, const Greet& greet) {
    std::string why = "no answer";
    do {
        bool answered = false;
        for (const sockaddr_storage& a : addresses_of(host, port, why)) {
            Socket s(::socket(a.ss_family, SOCK_STREAM | SOCK_CLOEXEC | SOCK_NONBLOCK, 0));
            if (!s) continue;
            int error = 0;
            socklen_t size = sizeof error;
            if (::connect(s.get(), reinterpret_cast<const sockaddr*>(&a), size_of(a)) != 0) {
                error = errno;
                if (error == EINPROGRESS) {
                    error = ETIMEDOUT;
                    if (wait(s.get(), POLLOUT, std::min(ends, now() + 5)))
                        ::getsockopt(s.get(), SOL_SOCKET, SO_ERROR, &error, &size);
                }
            }
            if (error != 0) {
                why = std::strerror(error);
                continue;
            }
            answered = true;
            why = greet(s);
            if (why.empty()) return {std::move(s), ""};
        }
        ::usleep(answered ? 250'000 : 50'000);
        if (meanwhile) meanwhile();
    } while (now() < ends);
    return {Socket(), why};
}

}  // namespace mpm::sockets
