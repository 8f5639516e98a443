// Ranks as processes: everyone gets what everyone gave, of any size; a rank that stops, or dies,
// stops all; who does not come is named.
#include "mpm/exec/rank_processes.hpp"

#include <gtest/gtest.h>
#include <unistd.h>

#include <map>

#include "mpm/core/error.hpp"
#include "support/processes.hpp"

namespace mpm {
namespace {

using test::run_processes;
using Link = std::shared_ptr<Communicator>;

TEST(RankProcesses, everyone_gets_what_everyone_gave) {
    for (int n : {1, 2, 3, 4}) {
        const auto said = run_processes(n, [](const Link& link) -> std::string {
            Communicator& c = *link;
            std::vector<int> peers;
            if (c.rank() > 0) peers.push_back(c.rank() - 1);
            if (c.rank() + 1 < c.ranks()) peers.push_back(c.rank() + 1);
            for (int round = 0; round < 200; ++round) {
                std::vector<Bytes> to{std::size_t(c.ranks())};
                for (int p : peers) {
                    Packer packer;
                    packer.put(
                        std::vector<int>(std::size_t(round % 5), 100 * c.rank() + p + round));
                    if (round % 7 != 0) to[std::size_t(p)] = packer.take();  // else: nothing at all
                }
                const auto in = c.exchange(std::move(to), peers);
                for (int p : peers) {
                    if (round % 7 == 0) {
                        if (!in[std::size_t(p)].empty()) return "not empty";
                        continue;
                    }
                    Unpacker unpacker(in[std::size_t(p)]);
                    if (unpacker.list<int>() !=
                            std::vector<int>(std::size_t(round % 5), 100 * p + c.rank() + round) ||
                        !unpacker.empty())
                        return "wrong in round " + std::to_string(round);
                }
                const auto all = c.all_gather(std::vector<int>{c.rank(), round});
                for (int r = 0; r < c.ranks(); ++r)
                    if (all[std::size_t(r)] != std::vector<int>{r, round}) return "wrong for all";
            }
            return "right";
        });
        EXPECT_EQ(said, std::vector<std::string>(std::size_t(n), "right"));
    }
}

TEST(RankProcesses, messages_larger_than_the_system_holds) {
    // Both send before either receives: neither may wait for the other to have received.
    const auto said = run_processes(3, [](const Link& link) -> std::string {
        Communicator& c = *link;
        const std::size_t size = 8u << 20;
        for (int round = 0; round < 2; ++round) {
            std::vector<Bytes> to(3);
            for (int p : c.others()) {
                to[std::size_t(p)].resize(size + std::size_t(p));
                for (std::size_t k = 0; k < size; k += 997)
                    to[std::size_t(p)][k] = (unsigned char)(k / 997 + 31u * unsigned(c.rank()));
            }
            const auto in = c.exchange(std::move(to), c.others());
            for (int p : c.others()) {
                const Bytes& from = in[std::size_t(p)];
                if (from.size() != size + std::size_t(c.rank())) return "wrong size";
                for (std::size_t k = 0; k < size; k += 997)
                    if (from[k] != (unsigned char)(k / 997 + 31u * unsigned(p))) return "wrong";
            }
        }
        return "right";
    });
    EXPECT_EQ(said, (std::vector<std::string>{"right", "right", "right"}));
}

TEST(RankProcesses, one_that_stops_stops_all) {
    for (int guilty : {0, 2}) {
        const auto said = run_processes(3, [&](const Link& link) -> std::string {
            Communicator& c = *link;
            for (int round = 0; round < 5; ++round) {
                c.all_gather(std::vector<int>(100000, round));
                if (c.rank() == guilty && round == 3) {
                    c.stop("no such luck");
                    return "told";
                }
            }
            return "nobody heard of it";
        });
        for (int r = 0; r < 3; ++r)
            EXPECT_EQ(said[std::size_t(r)], r == guilty ? "told" : "stopped: no such luck");
    }
}

TEST(RankProcesses, a_stop_behind_the_last_message_takes_nothing_back) {
    const auto said = run_processes(2, [](const Link& link) -> std::string {
        Communicator& c = *link;
        // Rank 1 looks next when both the message and the stop behind it are there.
        if (c.rank() == 1) RankProcesses::while_waiting([] { ::usleep(600'000); });
        if (c.rank() == 0) ::usleep(300'000);
        const auto in = c.all_gather(std::vector<int>{c.rank() + 5});
        if (c.rank() == 0) {
            c.stop("enough");
            return "told";
        }
        if (in[0] != std::vector<int>{5}) return "wrong";
        try {
            c.all_gather(std::vector<int>{1});
        } catch (const RankStopped& e) {
            return std::string("then: ") + e.what();
        }
        return "nobody heard of it";
    });
    EXPECT_EQ(said[1], "then: enough");
}

TEST(RankProcesses, who_waits_asks_whether_to_go_on) {
    const auto said = run_processes(2, [](const Link& link) -> std::string {
        Communicator& c = *link;
        if (c.rank() == 0) {
            RankProcesses::while_waiting([] { throw std::runtime_error("a signal"); });
            c.all_gather(std::vector<int>{1});
        }
        for (int k = 0; k < 5000; ++k) {
            c.check();
            ::usleep(1000);
        }
        return "nobody heard of it";
    });
    EXPECT_EQ(said[0], "threw: a signal");
    EXPECT_EQ(said[1], "stopped: rank 0 was interrupted while it waited");
    // At the start too, whoever it is that does not come.
    RankProcesses::while_waiting([] { throw std::runtime_error("a signal"); });
    const test::Work none = [](const Link&) -> std::string { return "met"; };
    EXPECT_EQ(run_processes(2, none, 20, {1})[0], "threw: a signal");
    EXPECT_EQ(run_processes(2, none, 20, {0})[1], "threw: a signal");
    RankProcesses::while_waiting({});
}

TEST(RankProcesses, who_waits_long_says_for_whom) {
    const auto said = run_processes(3, [](const Link& link) -> std::string {
        Communicator& c = *link;
        RankProcesses::patience = c.rank() == 0 ? 0.3 : 30;
        ::testing::internal::CaptureStderr();
        if (c.rank() == 2) ::usleep(1'500'000);
        c.all_gather(std::vector<int>{1});
        return ::testing::internal::GetCapturedStderr();
    });
    EXPECT_EQ(said[0], "libmpm: rank 0 of 3 has waited 0.3 s for rank 2, and goes on\n");
    EXPECT_EQ(said[1], "");
}

TEST(RankProcesses, who_waits_elsewhere_hears_of_it) {
    const auto said = run_processes(2, [&](const Link& link) -> std::string {
        Communicator& c = *link;
        if (c.rank() == 0) {
            c.stop("enough");
            return "told";
        }
        for (int k = 0; k < 2000; ++k) {
            c.check();
            ::usleep(1000);
        }
        return "nobody heard of it";
    });
    EXPECT_EQ(said[1], "stopped: enough");
}

TEST(RankProcesses, one_that_dies_stops_all) {
    // In a row: rank 0 knows of rank 2 only by what rank 1 says.
    const auto said = run_processes(3, [](const Link& link) -> std::string {
        Communicator& c = *link;
        std::vector<int> peers;
        if (c.rank() > 0) peers.push_back(c.rank() - 1);
        if (c.rank() < 2) peers.push_back(c.rank() + 1);
        for (int round = 0; round < 50; ++round) {
            if (c.rank() == 2 && round == 20) return "die";
            c.exchange(std::vector<Bytes>(3, Bytes(1000, 1)), peers);
        }
        return "nobody noticed";
    });
    for (int r : {0, 1}) {
        EXPECT_EQ(said[std::size_t(r)].find("stopped: rank 2 has ended"), 0u)
            << said[std::size_t(r)];
    }
}

TEST(RankProcesses, one_that_has_done_its_work_may_leave) {
    // Rank 2 is gone while the others still talk to each other.
    const auto said = run_processes(3, [](const Link& link) -> std::string {
        Communicator& c = *link;
        c.all_gather(std::vector<int>{1});
        if (c.rank() == 2) return "right";
        for (int round = 0; round < 20; ++round) {
            ::usleep(5000);
            std::vector<Bytes> to(3, Bytes(10, (unsigned char)round));
            const int other = 1 - c.rank();
            if (c.exchange(to, {other})[std::size_t(other)] != Bytes(10, (unsigned char)round))
                return "wrong";
        }
        return "right";
    });
    EXPECT_EQ(said, (std::vector<std::string>{"right", "right", "right"}));
}

TEST(RankProcesses, who_does_not_come_is_named) {
    const test::Work none = [](const Link&) -> std::string { return "met"; };
    const auto without_two = run_processes(4, none, 0.5, {1, 3});
    EXPECT_NE(without_two[0].find("nothing was heard in time of ranks 1, 3"), std::string::npos)
        << without_two[0];
    EXPECT_NE(without_two[0].find("RANK=0"), std::string::npos) << without_two[0];
    EXPECT_NE(without_two[2].find("rank 0"), std::string::npos) << without_two[2];
    const auto without_first = run_processes(2, none, 0.5, {0});
    EXPECT_NE(without_first[1].find("cannot be reached in time"), std::string::npos)
        << without_first[1];
}

Launch read(const std::map<std::string, std::string>& environment) {
    return read_launch([&](const char* name) -> const char* {
        const auto found = environment.find(name);
        return found == environment.end() ? nullptr : found->second.c_str();
    });
}

TEST(Launch, of_each_launcher) {
    EXPECT_EQ(read({}).ranks, 1);
    EXPECT_EQ(read({}).launcher, "");
    const Launch torch = read({{"RANK", "3"},
                               {"WORLD_SIZE", "4"},
                               {"MASTER_ADDR", "node1"},
                               {"MASTER_PORT", "29500"},
                               {"OMPI_COMM_WORLD_RANK", "0"}});
    EXPECT_EQ(torch.launcher, "torchrun");
    EXPECT_EQ(torch.rank, 3);
    EXPECT_EQ(torch.ranks, 4);
    EXPECT_EQ(torch.host, "node1");
    EXPECT_EQ(torch.port, 29500);
    // torchrun's own store is at that port.
    EXPECT_EQ(read({{"RANK", "0"},
                    {"WORLD_SIZE", "1"},
                    {"MASTER_ADDR", "a"},
                    {"MASTER_PORT", "29500"},
                    {"TORCHELASTIC_USE_AGENT_STORE", "True"}})
                  .port,
              29501);
    const Launch open = read({{"OMPI_COMM_WORLD_RANK", "1"},
                              {"OMPI_COMM_WORLD_SIZE", "2"},
                              {"OMPI_COMM_WORLD_LOCAL_SIZE", "2"},
                              {"SLURM_PROCID", "0"},
                              {"SLURM_NTASKS", "8"}});
    EXPECT_EQ(open.launcher, "Open MPI");
    EXPECT_EQ(open.host, "127.0.0.1");
    EXPECT_GT(open.port, 1024);
    const Launch mpich =
        read({{"PMI_RANK", "1"}, {"PMI_SIZE", "3"}, {"LIBMPM_MASTER", "[::1]:99"}});
    EXPECT_EQ(mpich.ranks, 3);
    EXPECT_EQ(mpich.host, "::1");
    EXPECT_EQ(mpich.port, 99);
    const std::map<std::string, std::string> slurm = {{"SLURM_PROCID", "5"},
                                                      {"SLURM_NTASKS", "8"},
                                                      {"SLURM_JOB_ID", "7"},
                                                      {"SLURM_STEP_ID", "0"},
                                                      {"SLURM_STEP_NODELIST", "gpu[07-09,12]"}};
    EXPECT_EQ(read(slurm).host, "gpu07");
    EXPECT_EQ(read(slurm).rank, 5);
    auto next_step = slurm;
    next_step["SLURM_STEP_ID"] = "1";
    EXPECT_NE(read(slurm).port, read(next_step).port);
}

TEST(Launch, hosts_as_slurm_writes_them) {
    EXPECT_EQ(first_host("node1"), "node1");
    EXPECT_EQ(first_host("b2,a1"), "b2");
    EXPECT_EQ(first_host("n[3,5-7]-ib,x"), "n3-ib");
    EXPECT_EQ(first_host("n[001-128]"), "n001");
    EXPECT_EQ(first_host("n[001"), "");
}

TEST(Launch, what_is_malformed_is_named) {
    const auto message = [](const std::map<std::string, std::string>& environment) {
        try {
            read(environment);
        } catch (const DeviceError& e) {
            return std::string(e.what());
        }
        return std::string("accepted");
    };
    const auto expect = [&](const std::map<std::string, std::string>& environment,
                            const std::string& part) {
        EXPECT_NE(message(environment).find(part), std::string::npos) << message(environment);
    };
    expect({{"RANK", "x"}, {"WORLD_SIZE", "2"}}, "RANK is 'x'");
    expect({{"RANK", "2"}, {"WORLD_SIZE", "2"}}, "from 0 to 1");
    expect({{"RANK", "0"}, {"WORLD_SIZE", "0"}}, "WORLD_SIZE is '0'");
    expect({{"RANK", "0"}, {"WORLD_SIZE", "2"}}, "MASTER_ADDR");
    expect({{"RANK", "0"}, {"WORLD_SIZE", "2"}, {"MASTER_ADDR", "a"}, {"MASTER_PORT", "70000"}},
           "MASTER_PORT is '70000'");
    expect({{"PMI_RANK", "0"}}, "PMI_SIZE is ''");
    expect({{"PMI_RANK", "0"}, {"PMI_SIZE", "2"}, {"LIBMPM_MASTER", "node"}}, "expected host:port");
    expect({{"PMI_RANK", "0"}, {"PMI_SIZE", "4"}, {"MPI_LOCALNRANKS", "2"}}, "LIBMPM_MASTER");
    expect({{"SLURM_PROCID", "0"}, {"SLURM_NTASKS", "2"}, {"SLURM_STEP_NODELIST", "["}},
           "SLURM_STEP_NODELIST");
}

}  // namespace
}  // namespace mpm
