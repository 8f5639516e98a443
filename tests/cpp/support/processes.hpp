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

/// What each of so many processes returned, or "threw ..." where it did. A process that returns
/// "die" ends without a word.
inline std::vector<std::string> run_processes(int ranks, const Work& work, double seconds = 20,
                                              const std::vector<int>& absent = {}) {
    const int port = free_port();
    std::vector<int> pipes;
    std::vector<pid_t> children;
    for (int r = 0; r < ranks; ++r) {
        int ends[2];
        EXPECT_EQ(::pipe(ends), 0);
        pipes.push_back(ends[0]);
        const bool comes = std::find(absent.begin(), absent.end(), r) == absent.end();
        const pid_t child = comes ? ::fork() : 0;
        if (comes && child == 0) {
            std::string said;
            try {
                const auto comm = std::make_shared<RankProcesses>(place(r, ranks, port), seconds);
                said = work(comm);
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
        children.push_back(child);
    }
    std::vector<std::string> out;
    for (int r = 0; r < ranks; ++r) {
        std::string said;
        char buffer[4096];
        for (ssize_t n; (n = ::read(pipes[std::size_t(r)], buffer, sizeof buffer)) > 0;)
            said.append(buffer, std::size_t(n));
        ::close(pipes[std::size_t(r)]);
        if (children[std::size_t(r)] > 0) ::waitpid(children[std::size_t(r)], nullptr, 0);
        out.push_back(said);
    }
    return out;
}

}  // namespace mpm::test
