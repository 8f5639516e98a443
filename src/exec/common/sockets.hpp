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

/// Listens at a port (0: any that is free), for this host alone or for all that reach it.
inline Socket listen_at(int port, bool this_host_alone, int most) {
    std::string why;
    for (const int family : {AF_INET6, AF_INET}) {
        if (this_host_alone && family == AF_INET6) continue;
        // Who was heard may be gone before it is accepted: that must not wait for the next.
        Socket s(::socket(family, SOCK_STREAM | SOCK_CLOEXEC | SOCK_NONBLOCK, 0));
        if (!s) {
            why = last_error();
            continue;
        }
        const int yes = 1, no = 0;
        ::setsockopt(s.get(), SOL_SOCKET, SO_REUSEADDR, &yes, sizeof yes);
        sockaddr_in6 six{};
        six.sin6_family = AF_INET6;
        six.sin6_addr = in6addr_any;
        six.sin6_port = htons(std::uint16_t(port));
        sockaddr_in four{};
        four.sin_family = AF_INET;
        four.sin_addr.s_addr = htonl(this_host_alone ? INADDR_LOOPBACK : INADDR_ANY);
        four.sin_port = htons(std::uint16_t(port));
        if (family == AF_INET6) ::setsockopt(s.get(), IPPROTO_IPV6, IPV6_V6ONLY, &no, sizeof no);
        const sockaddr* at = family == AF_INET6 ? reinterpret_cast<const sockaddr*>(&six)
                                                : reinterpret_cast<const sockaddr*>(&four);
        const socklen_t size = family == AF_INET6 ? sizeof six : sizeof four;
        if (::bind(s.get(), at, size) == 0 && ::listen(s.get(), most) == 0) return s;
        why = last_error();
    }
    throw DeviceError("ranks as processes: cannot listen at port " + std::to_string(port) + ": " +
                      why + "; another job may use it: set LIBMPM_MASTER=host:port");
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

/// Connected to a host, tried until the end: who listens may come later. Else why not.
inline std::pair<Socket, std::string> connect_to(const std::string& host, int port, double ends,
                                                 const Hook& meanwhile = {}) {
    std::string why = "no answer";
    do {
        addrinfo hints{}, *found = nullptr;
        hints.ai_family = AF_UNSPEC;
        hints.ai_socktype = SOCK_STREAM;
        const int failed =
            ::getaddrinfo(host.c_str(), std::to_string(port).c_str(), &hints, &found);
        if (failed) why = ::gai_strerror(failed);
        for (const addrinfo* a = failed ? nullptr : found; a; a = a->ai_next) {
            Socket s(::socket(a->ai_family, SOCK_STREAM | SOCK_CLOEXEC | SOCK_NONBLOCK, 0));
            if (!s) continue;
            int error = 0;
            socklen_t size = sizeof error;
            if (::connect(s.get(), a->ai_addr, a->ai_addrlen) != 0) {
                error = errno;
                if (error == EINPROGRESS) {
                    error = ETIMEDOUT;
                    if (wait(s.get(), POLLOUT, std::min(ends, now() + 5)))
                        ::getsockopt(s.get(), SOL_SOCKET, SO_ERROR, &error, &size);
                }
            }
            if (error == 0) {
                ::freeaddrinfo(found);
                return {std::move(s), ""};
            }
            why = std::strerror(error);
        }
        if (!failed) ::freeaddrinfo(found);
        ::usleep(50'000);
        if (meanwhile) meanwhile();
    } while (now() < ends);
    return {Socket(), why};
}

}  // namespace mpm::sockets
