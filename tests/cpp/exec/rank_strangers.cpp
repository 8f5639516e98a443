// Who does not know the secret of a launch gets nothing and delays nobody; who knows it and sends
// what is no message ends the job by its name.
#include <arpa/inet.h>
#include <fcntl.h>
#include <gtest/gtest.h>
#include <sys/stat.h>

#include <chrono>
#include <cstring>
#include <fstream>
#include <map>
#include <thread>

#include "mpm/core/error.hpp"
#include "mpm/exec/inbox.hpp"
#include "mpm/exec/keyed_hash.hpp"
#include "mpm/exec/secret.hpp"
#include "support/mutate.hpp"
#include "support/processes.hpp"

namespace mpm {
namespace {

using test::given_secret, test::RankProcess, test::free_port;
using Link = std::shared_ptr<Communicator>;

std::string hexadecimal(const Digest& digest) {
    std::string out;
    for (const unsigned char byte : digest)
        for (const int half : {byte >> 4, byte & 15}) out += "0123456789abcdef"[half];
    return out;
}

TEST(KeyedHash, vectors_of_the_standards) {
    const auto hash = [](const std::string& text) {
        return hexadecimal(Sha256().add(text.data(), text.size()).digest());
    };
    // FIPS 180-4, examples of NIST.
    EXPECT_EQ(hash(""), "e3b0c44298fc1c149afbf4c8996fb92427ae41e4649b934ca495991b7852b855");
    EXPECT_EQ(hash("abc"), "ba7816bf8f01cfea414140de5dae2223b00361a396177a9cb410ff61f20015ad");
    EXPECT_EQ(hash("abcdbcdecdefdefgefghfghighijhijkijkljklmklmnlmnomnopnopq"),
              "248d6a61d20638b8e5c026930c3e6039a33ce45964ff2167f6ecedd419db06c1");
    EXPECT_EQ(hash(std::string(1'000'000, 'a')),
              "cdc76e5c9914fb9281a1c7e284d73e67f1809a48a497200e046d39ccc7112cd0");
    // In pieces of any size.
    std::string text;
    for (int k = 0; k < 300; ++k) text += char(k * 7);
    Sha256 pieces;
    for (std::size_t at = 0, n = 1; at < text.size(); at += n, n = n * 3 % 67 + 1)
        pieces.add(text.data() + at, std::min(n, text.size() - at));
    EXPECT_EQ(hexadecimal(pieces.digest()), hash(text));
    // RFC 4231, cases 1, 2, 3 and 6.
    const auto keyed = [](const std::string& key, const std::string& data) {
        return hexadecimal(keyed_hash(key, data.data(), data.size()));
    };
    EXPECT_EQ(keyed(std::string(20, '\x0b'), "Hi There"),
              "b0344c61d8db38535ca8afceaf0bf12b881dc200c9833da726e9376c2e32cff7");
    EXPECT_EQ(keyed("Jefe", "what do ya want for nothing?"),
              "5bdcc146bf60754e6a042426089575c75a003f089d2739839dec58b964ec3843");
    EXPECT_EQ(keyed(std::string(20, '\xaa'), std::string(50, '\xdd')),
              "773ea91e36800e46854db8ebd09181a72959098b3ef8c122d9635514ced565fe");
    EXPECT_EQ(
        keyed(std::string(131, '\xaa'), "Test Using Larger Than Block-Size Key - Hash Key First"),
        "60e431591ee0b67f0d8a26aacbf5b77f8e0bc6213728c5140546040f0ee37f54");
}

/// Who is connected to a port, and speaks as it likes.
class Client {
public:
    /// As soon as someone listens there.
    explicit Client(int port, const char* address = "127.0.0.1", double seconds = 20) {
        sockaddr_in at{};
        at.sin_family = AF_INET;
        at.sin_port = htons(std::uint16_t(port));
        ::inet_pton(AF_INET, address, &at.sin_addr);
        for (int k = 0; k < int(seconds * 100); ++k) {
            fd_ = ::socket(AF_INET, SOCK_STREAM | SOCK_CLOEXEC, 0);
            if (::connect(fd_, reinterpret_cast<const sockaddr*>(&at), sizeof at) == 0) return;
            ::close(std::exchange(fd_, -1));
            ::usleep(10'000);
        }
    }
    Client(Client&& o) noexcept : fd_(std::exchange(o.fd_, -1)) {}
    Client& operator=(Client&&) = delete;
    ~Client() {
        if (fd_ >= 0) ::close(fd_);
    }
    bool connected() const { return fd_ >= 0; }
    int fd() const { return fd_; }
    void send(const void* data, std::size_t size) { (void)!::send(fd_, data, size, MSG_NOSIGNAL); }
    /// As many bytes, or as came before it was sent away.
    Bytes receive(std::size_t size) {
        Bytes out(size);
        std::size_t have = 0;
        for (ssize_t n; have < size && (n = ::recv(fd_, out.data() + have, size - have, 0)) > 0;)
            have += std::size_t(n);
        out.resize(have);
        return out;
    }
    /// Whether the other has closed the connection.
    bool sent_away() {
        unsigned char more[4096];
        ssize_t n;
        while ((n = ::recv(fd_, more, sizeof more, 0)) > 0) {
        }
        return true;
    }

private:
    int fd_ = -1;
};

struct Opening {
    char magic[8] = {'l', 'i', 'b', 'm', 'p', 'm', 'R', '2'};
    unsigned char number[32] = {};
};
struct Card {
    std::int32_t rank = 1, ranks = 2;
    std::uint64_t job = 0;
    std::uint32_t port = 1, unused = 0;
    char host[64] = "here";
};
struct Proof {
    Card card;
    Digest hash;
};

std::uint64_t number_of(const std::string& job) {
    std::uint64_t hash = 14695981039346656037ull;
    for (const unsigned char c : job) hash = (hash ^ c) * 1099511628211ull;
    return hash;
}

/// The bytes with which rank 1 of 2 would prove that it knows a secret.
Proof prove(const std::string& secret, const Opening& mine, const Bytes& theirs,
            const char* side = "connects") {
    Proof out;
    out.card.job = number_of("test");
    std::string text = std::string("libmpm ranks 2 ") + side;
    text.append(reinterpret_cast<const char*>(mine.number), sizeof mine.number);
    text.append(reinterpret_cast<const char*>(theirs.data()) + 8, 32);
    text.append(reinterpret_cast<const char*>(&out.card), sizeof out.card);
    out.hash = keyed_hash(secret, text.data(), text.size());
    return out;
}

/// A process that has become rank 1 of 2 by all rules, and may now break them.
Client mole(int port) {
    Client out(port);
    const Opening mine;
    out.send(&mine, sizeof mine);
    const Proof proof = prove(given_secret, mine, out.receive(sizeof mine));
    out.send(&proof, sizeof proof);
    EXPECT_EQ(out.receive(sizeof proof).size(), sizeof proof) << "a true rank was refused";
    EXPECT_EQ(out.receive(2 * 132).size(), 2u * 132u) << "not told who is where";
    return out;
}

Launch place(int rank, int ranks, int port, const std::string& secret = given_secret) {
    Launch l = test::place(rank, ranks, port);
    l.secret = secret;
    return l;
}

/// How many were sent away while all met, and that they can speak.
std::string meet(const Link& link) {
    for (const auto& list : link->all_gather(std::vector<int>{7}))
        if (list != std::vector<int>{7}) return "wrong";
    return "met, dropped " + std::to_string(static_cast<RankProcesses&>(*link).dropped());
}

TEST(RankStrangers, silent_ones_delay_nobody) {
    const int port = free_port();
    RankProcess first(place(0, 3, port), meet);
    std::vector<Client> silent;
    for (int k = 0; k < 20; ++k) silent.emplace_back(port);
    Client slow(port);
    slow.send("libm", 4);
    // Heard one after the other they would take 100 s, and these would not be heard in time.
    RankProcess second(place(1, 3, port), meet), third(place(2, 3, port), meet);
    EXPECT_EQ(first.said().substr(0, 3), "met");
    EXPECT_EQ(second.said(), "met, dropped 0");
    EXPECT_EQ(third.said(), "met, dropped 0");
}

TEST(RankStrangers, are_dropped_and_counted) {
    const int port = free_port();
    RankProcess first(place(0, 2, port), meet);
    int dropped = 0;
    const auto say = [&](const Bytes& bytes) {
        Client stranger(port);
        stranger.send(bytes.data(), bytes.size());
        if (!bytes.empty()) ::shutdown(stranger.fd(), SHUT_WR);
        EXPECT_TRUE(stranger.sent_away());
        ++dropped;
    };
    // The word of earlier versions, that of the web, zeros, and more than there is to say.
    const std::string old_word = "libmpmR1", web = "GET / HTTP/1.1\r\nHost: a\r\n\r\n";
    Bytes hello(old_word.begin(), old_word.end());
    hello.resize(96);
    say(hello);
    say(Bytes(web.begin(), web.end()));
    say(Bytes(160, 0));
    say(Bytes(1 << 20, 0xff));
    // A secret that is another, or none, or the other side's part of the proof.
    for (const std::string& secret : {std::string("x"), std::string(32, 'f'), std::string()}) {
        Client stranger(port);
        const Opening mine;
        stranger.send(&mine, sizeof mine);
        const Proof proof = prove(secret, mine, stranger.receive(sizeof mine));
        stranger.send(&proof, sizeof proof);
        EXPECT_EQ(stranger.receive(1).size(), 0u) << "a stranger was answered";
        ++dropped;
    }
    {
        Client stranger(port);
        const Opening mine;
        stranger.send(&mine, sizeof mine);
        const Proof proof = prove(given_secret, mine, stranger.receive(sizeof mine), "accepts");
        stranger.send(&proof, sizeof proof);
        EXPECT_EQ(stranger.receive(1).size(), 0u);
        ++dropped;
    }
    {  // One that says to it what it says itself.
        Client mirror(port);
        const Bytes theirs = mirror.receive(sizeof(Opening));
        mirror.send(theirs.data(), theirs.size());
        const Bytes zeros(sizeof(Proof), 0);
        mirror.send(zeros.data(), zeros.size());
        EXPECT_EQ(mirror.receive(1).size(), 0u);
        ++dropped;
    }
    // Nearly right ones.
    test::Mutator mutate(test::number_of("LIBMPM_FUZZ_SEED", 1));
    const auto tries =
        int(std::min<std::uint64_t>(test::number_of("LIBMPM_FUZZ_MESSAGES", 4000) / 40, 5000));
    for (int k = 0; k < tries; ++k) {
        Client stranger(port);
        const Opening mine;
        const Proof proof = prove(given_secret, mine, stranger.receive(sizeof mine));
        Bytes right(sizeof mine + sizeof proof);
        std::memcpy(right.data(), &mine, sizeof mine);
        std::memcpy(right.data() + sizeof mine, &proof, sizeof proof);
        Bytes wrong = mutate(right);
        // What only goes on behind the right bytes would be a rank that speaks.
        if (wrong.size() >= right.size() && std::equal(right.begin(), right.end(), wrong.begin()))
            wrong[50] ^= 1;
        stranger.send(wrong.data(), wrong.size());
        ::shutdown(stranger.fd(), SHUT_WR);
        EXPECT_EQ(stranger.receive(1).size(), 0u) << "a stranger was answered";
        ++dropped;
    }
    RankProcess second(place(1, 2, port), meet);
    EXPECT_EQ(first.said(), "met, dropped " + std::to_string(dropped));
    EXPECT_EQ(second.said(), "met, dropped 0");
}

TEST(RankStrangers, who_has_another_secret_is_told_so) {
    const int port = free_port();
    RankProcess first(place(0, 2, port), meet, 3);
    RankProcess wrong(place(1, 2, port, std::string(32, 'w')), meet, 1);
    const std::string told = wrong.said(), missed = first.said();
    EXPECT_NE(told.find("does not accept the secret of this process"), std::string::npos) << told;
    EXPECT_NE(missed.find("without the secret"), std::string::npos) << missed;
    for (const std::string& text : {told, missed})
        EXPECT_EQ(text.find(given_secret), std::string::npos) << "the secret is in a message";
}

TEST(RankStrangers, what_was_overheard_proves_nothing) {
    // Between the two stands one who hears all, and says it again at the next job.
    const int port = free_port(), between = free_port();
    const int listener = ::socket(AF_INET, SOCK_STREAM, 0);
    sockaddr_in at{};
    at.sin_family = AF_INET;
    at.sin_port = htons(std::uint16_t(between));
    at.sin_addr.s_addr = htonl(INADDR_LOOPBACK);
    ASSERT_EQ(::bind(listener, reinterpret_cast<sockaddr*>(&at), sizeof at), 0);
    ASSERT_EQ(::listen(listener, 4), 0);
    RankProcess first(place(0, 2, port), meet), second(place(1, 2, between), meet);
    const int caller = ::accept(listener, nullptr, nullptr);
    Bytes overheard;
    {
        Client to_first(port);
        const auto carry = [](int from, int to, Bytes* keep) {
            unsigned char piece[4096];
            for (ssize_t n; (n = ::recv(from, piece, sizeof piece, 0)) > 0;) {
                if (keep) keep->insert(keep->end(), piece, piece + n);
                (void)!::send(to, piece, std::size_t(n), MSG_NOSIGNAL);
            }
            ::shutdown(to, SHUT_WR);
        };
        std::thread back(carry, to_first.fd(), caller, nullptr);
        carry(caller, to_first.fd(), &overheard);
        back.join();
    }
    ::close(caller);
    ::close(listener);
    EXPECT_EQ(first.said(), "met, dropped 0");
    EXPECT_EQ(second.said(), "met, dropped 0");
    ASSERT_GE(overheard.size(), sizeof(Opening) + sizeof(Proof));
    const int again = free_port();
    RankProcess next(place(0, 2, again), meet, 2);
    Client replayed(again);
    replayed.send(overheard.data(), overheard.size());
    EXPECT_EQ(replayed.receive(4096).size(), sizeof(Opening)) << "more than a random number";
    EXPECT_NE(next.said().find("1 without the secret"), std::string::npos);
}

TEST(RankStrangers, only_the_named_interface_listens) {
    // 127.0.0.2 is an address of this host as good as that of any network.
    const int port = free_port();
    Launch l = place(0, 2, port);
    l.host = "127.0.0.2";
    RankProcess first(l, meet, 3);
    EXPECT_TRUE(Client(port, "127.0.0.2").connected());
    EXPECT_FALSE(Client(port, "127.0.0.1", 0.05).connected());
}

TEST(RankStrangers, no_meeting_beyond_this_host_without_a_secret) {
    Launch l = place(0, 2, free_port(), "");
    l.host = "10.1.2.3";
    try {
        const RankProcesses comm(l, 1);
        FAIL() << "met";
    } catch (const DeviceError& e) {
        EXPECT_NE(std::string(e.what()).find("LIBMPM_SECRET"), std::string::npos) << e.what();
    }
    l.secret = given_secret;  // no address of this host
    try {
        const RankProcesses comm(l, 1);
        FAIL() << "met";
    } catch (const DeviceError& e) {
        EXPECT_NE(std::string(e.what()).find("cannot listen at 10.1.2.3"), std::string::npos)
            << e.what();
    }
}

/// What rank 0 ends with where rank 1 sends these bytes after they have met.
std::string told(const std::function<void(Client&)>& speak) {
    const int port = free_port();
    RankProcess first(place(0, 2, port), [](const Link& link) -> std::string {
        for (int k = 0; k < 5; ++k) link->all_gather_alike(std::vector<int>{k}, "a number");
        return "nobody noticed";
    });
    Client rank = mole(port);
    speak(rank);
    ::shutdown(rank.fd(), SHUT_WR);
    rank.sent_away();
    return first.said();
}

TEST(RankStrangers, a_broken_message_of_a_rank_ends_the_job_by_its_name) {
    const auto header = [](std::uint32_t kind, std::uint64_t size, std::uint32_t unused = 0) {
        return FrameHeader{kind, unused, size};
    };
    const auto send = [](const FrameHeader& h, const Bytes& body = {}) {
        return [=](Client& c) {
            c.send(&h, sizeof h);
            c.send(body.data(), body.size());
        };
    };
    const auto expect = [](const std::string& text, const std::string& part) {
        EXPECT_NE(text.find("rank 1 has sent"), std::string::npos) << text;
        EXPECT_NE(text.find(part), std::string::npos) << text;
    };
    expect(told(send(header(1, ~std::uint64_t(0)))), "announces 18446744073709551615 bytes");
    expect(told(send(header(9, 4), Bytes(4))), "what is no message (of kind 9)");
    expect(told(send(header(1, 4, 5), Bytes(4))), "what is no message");
    expect(told(send(header(2, 1 << 20))), "a word to stop of 1048576 bytes");
    expect(told(send(header(1, 3), Bytes(3))), "a number of 3 bytes");
    expect(told(send(header(1, 8), Bytes(8))), "a number of 2 in place of 1");
    expect(told([&](Client& c) {
               for (int k = 0; k < 9; ++k) send(header(1, 0))(c);
           }),
           "rank 0");
    test::Mutator random(5);
    expect(told([&](Client& c) {
               Bytes garbage(5000);
               for (auto& byte : garbage) byte = (unsigned char)(random.below(256) | 1);
               c.send(garbage.data(), garbage.size());
           }),
           "what is no message");
    // Announced, and never sent: the memory for it is not taken, and the end is noticed.
    const std::string cut = told(send(header(1, std::uint64_t(1) << 45), Bytes(1000)));
    EXPECT_NE(cut.find("rank 1 has ended"), std::string::npos) << cut;
    // A word to stop is text, whatever it was.
    const std::string stop = told(send(header(2, 6), {'n', 'o', 0xff, 0x01, 0xc3, 0xa9}));
    EXPECT_EQ(stop, "stopped: no??\xc3\xa9");
}

TEST(Inbox, makes_the_messages_that_were_sent) {
    test::Mutator random(3);
    for (int round = 0; round < 200; ++round) {
        std::vector<Bytes> sent(1 + random.below(2));
        Bytes stream;
        for (Bytes& body : sent) {
            body.resize(random.below(3) == 0 ? 0 : random.below(3000));
            for (auto& byte : body) byte = (unsigned char)random.below(256);
            const FrameHeader h{FrameHeader::message, 0, body.size()};
            const auto* at = reinterpret_cast<const unsigned char*>(&h);
            stream.insert(stream.end(), at, at + sizeof h);
            stream.insert(stream.end(), body.begin(), body.end());
        }
        Inbox inbox(1 + random.below(1000));
        for (std::size_t at = 0; at < stream.size();) {
            const auto [to, most] = inbox.space();
            const std::size_t n =
                std::min({most, stream.size() - at, std::size_t(1 + random.below(500))});
            std::memcpy(to, stream.data() + at, n);
            inbox.come(n);
            at += n;
        }
        ASSERT_EQ(inbox.whole(), sent.size());
        for (const Bytes& body : sent) ASSERT_EQ(inbox.take(), body);
    }
}

TEST(Inbox, survives_whatever_comes) {
    const std::uint64_t seed = test::number_of("LIBMPM_FUZZ_SEED", 1),
                        wanted = test::number_of("LIBMPM_FUZZ_MESSAGES", 4000);
    test::Mutator mutate(seed);
    std::uint64_t refused = 0, read = 0;
    const std::string word = "rank 1: a body has left";
    for (std::uint64_t k = 0; k < wanted; ++k) {
        Bytes stream;
        for (const std::uint32_t kind : {1u, k % 3 == 0 ? 2u : 1u}) {
            const FrameHeader h{kind, 0, word.size()};
            const auto* at = reinterpret_cast<const unsigned char*>(&h);
            stream.insert(stream.end(), at, at + sizeof h);
            stream.insert(stream.end(), word.begin(), word.end());
        }
        stream = mutate(stream);
        Inbox inbox(256);
        try {
            for (std::size_t at = 0; at < stream.size() && !inbox.has_stopped();) {
                const auto [to, most] = inbox.space();
                ASSERT_GT(most, 0u);
                ASSERT_LE(most, std::max<std::size_t>(256, stream.size()));
                const std::size_t n = std::min(most, stream.size() - at);
                std::memcpy(to, stream.data() + at, n);
                inbox.come(n);
                at += n;
                if (inbox.whole() > 0 && k % 2 == 0) inbox.take();
            }
            ++read;
        } catch (const MessageError&) {
            ++refused;
        }
    }
    EXPECT_GT(refused, 0u);
    EXPECT_GT(read, 0u);
    std::printf("%llu streams refused, %llu read\n", static_cast<unsigned long long>(refused),
                static_cast<unsigned long long>(read));
}

// --- The secret

std::string refusal(const std::map<std::string, std::string>& environment) {
    try {
        const std::string got = read_secret([&](const char* name) -> const char* {
            const auto found = environment.find(name);
            return found == environment.end() ? nullptr : found->second.c_str();
        });
        return "got " + got;
    } catch (const DeviceError& e) {
        return e.what();
    }
}

TEST(Secret, of_the_user) {
    const std::string path = ::testing::TempDir() + "libmpm_secret_" + std::to_string(::getpid());
    const auto expect = [](const std::string& text, const std::string& part) {
        EXPECT_NE(text.find(part), std::string::npos) << text;
    };
    EXPECT_EQ(refusal({}), "got ");
    EXPECT_EQ(refusal({{"LIBMPM_SECRET", " " + given_secret + "\n"}}), "got " + given_secret);
    expect(refusal({{"LIBMPM_SECRET", "short"}}), "has 5 characters; expected 32");
    expect(refusal({{"LIBMPM_SECRET", given_secret}, {"LIBMPM_SECRET_FILE", path}}), "set one");
    expect(refusal({{"LIBMPM_SECRET_FILE", path}}), "cannot be read");
    std::ofstream(path) << given_secret << "\n";
    ::chmod(path.c_str(), 0644);
    expect(refusal({{"LIBMPM_SECRET_FILE", path}}), "chmod 600");
    ::chmod(path.c_str(), 0600);
    EXPECT_EQ(refusal({{"LIBMPM_SECRET_FILE", path}}), "got " + given_secret);
    std::ofstream(path) << "short";
    expect(refusal({{"LIBMPM_SECRET_FILE", path}}), "has 5 characters");
    expect(refusal({{"LIBMPM_SECRET_FILE", ::testing::TempDir()}}), "is no file");
    ::unlink(path.c_str());
}

TEST(Secret, of_a_job_on_one_host) {
    const std::string name = "test-" + std::to_string(::getpid());
    std::string path, old;
    {
        SecretFile first(name), other(name);
        EXPECT_EQ(other.read(), "");
        old = first.make();
        EXPECT_EQ(old.size(), 64u);
        EXPECT_EQ(other.read(), old);
        path = first.path();
        struct stat about {};
        ASSERT_EQ(::stat(path.c_str(), &about), 0);
        EXPECT_EQ(about.st_mode & 0777u, 0600u);
        // Whoever could have put it there could know it.
        ::chmod(path.c_str(), 0644);
        EXPECT_EQ(other.read(), "");
    }
    EXPECT_NE(::access(path.c_str(), F_OK), 0) << "it is still there";
    SecretFile next(name);
    EXPECT_NE(next.make(), old);
}

TEST(Secret, what_a_dead_job_has_left_is_no_secret_of_the_next) {
    const int port = free_port();
    const Launch l = test::place(0, 2, port);
    const SecretFile left("ranks-" + std::to_string(port) + "-" + std::to_string(number_of(l.job)));
    {
        std::ofstream(left.path()) << std::string(64, 'a');
        ::chmod(left.path().c_str(), 0600);
    }
    // Rank 1 looks first, and finds that of the dead.
    RankProcess second(test::place(1, 2, port), meet);
    ::usleep(200'000);
    RankProcess first(l, meet);
    EXPECT_EQ(first.said(), "met, dropped 0");
    EXPECT_EQ(second.said(), "met, dropped 0");
    EXPECT_NE(::access(left.path().c_str(), F_OK), 0) << "the secret is still there";
}

TEST(Launch, one_host_meets_on_its_loopback_interface) {
    const auto read = [](std::map<std::string, std::string> environment) {
        return read_launch([&](const char* name) -> const char* {
            const auto found = environment.find(name);
            return found == environment.end() ? nullptr : found->second.c_str();
        });
    };
    std::map<std::string, std::string> torch = {{"RANK", "1"},
                                                {"WORLD_SIZE", "4"},
                                                {"MASTER_ADDR", "n1"},
                                                {"MASTER_PORT", "29500"},
                                                {"LOCAL_WORLD_SIZE", "4"}};
    EXPECT_EQ(read(torch).host, "127.0.0.1");
    EXPECT_TRUE(read(torch).one_host);
    torch["LOCAL_WORLD_SIZE"] = "2";
    EXPECT_EQ(read(torch).host, "n1");
    EXPECT_FALSE(read(torch).one_host);
    std::map<std::string, std::string> slurm = {{"SLURM_PROCID", "1"},
                                                {"SLURM_NTASKS", "2"},
                                                {"SLURM_JOB_ID", "7"},
                                                {"SLURM_STEP_NODELIST", "n7"}};
    EXPECT_EQ(read(slurm).host, "127.0.0.1");
    slurm["LIBMPM_MASTER"] = "n7:4000";  // named
    EXPECT_EQ(read(slurm).host, "n7");
    slurm["LIBMPM_SECRET"] = given_secret;
    slurm["LIBMPM_LISTEN"] = "10.0.0.7";
    const Launch l = read(slurm);
    EXPECT_EQ(l.secret, given_secret);
    EXPECT_EQ(l.listen, "10.0.0.7");
    EXPECT_EQ(l.read.find(given_secret), std::string::npos) << "the secret is in messages";
}

}  // namespace
}  // namespace mpm
