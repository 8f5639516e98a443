// Messages that are nearly right: real ones with bits, numbers and lengths changed.
#pragma once

#include <algorithm>
#include <cstdint>
#include <cstdlib>
#include <cstring>
#include <random>

#include "mpm/exec/communicator.hpp"

namespace mpm::test {

class Mutator {
public:
    explicit Mutator(std::uint64_t seed) : random_(seed) {}

    /// Another message than the one that is given.
    Bytes operator()(const Bytes& from) {
        Bytes to = from;
        do {
            for (int changes = 1 + int(below(3)); changes > 0; --changes) change(to);
        } while (to == from);
        return to;
    }
    std::uint64_t below(std::uint64_t n) { return n == 0 ? 0 : random_() % n; }

private:
    void change(Bytes& b) {
        if (b.empty()) return grow(b);
        const std::size_t at = below(b.size());
        switch (below(11)) {
            case 0:
                b[at] = (unsigned char)(b[at] ^ 1u << below(8));
                break;
            case 1:
                b[at] = (unsigned char)(below(256));
                break;
            case 2:
                return put<std::uint64_t>(b);
            case 3:
                return put<std::uint32_t>(b);
            case 4:
                return add<std::uint64_t>(b);
            case 5:
                return add<std::uint32_t>(b);
            case 6:
                b.resize(at);
                break;
            case 7:
                return grow(b);
            case 8: {  // a piece is there twice, or a row of it is gone
                const std::size_t n = std::min<std::size_t>(b.size() - at, 1 + below(64));
                const Bytes piece(b.begin() + std::ptrdiff_t(at),
                                  b.begin() + std::ptrdiff_t(at + n));
                if (below(2) == 0)
                    b.insert(b.begin() + std::ptrdiff_t(below(b.size() + 1)), piece.begin(),
                             piece.end());
                else
                    b.erase(b.begin() + std::ptrdiff_t(at), b.begin() + std::ptrdiff_t(at + n));
                break;
            }
            case 9: {  // two numbers trade places
                if (b.size() < 8) break;
                const std::size_t x = 4 * below(b.size() / 4), y = 4 * below(b.size() / 4);
                for (std::size_t k = 0; k < 4; ++k) std::swap(b[x + k], b[y + k]);
                break;
            }
            default: {
                const std::size_t n = std::min<std::size_t>(b.size() - at, 1 + below(32));
                std::memset(b.data() + at, below(2) == 0 ? 0 : 0xff, n);
            }
        }
    }
    void grow(Bytes& b) {
        for (std::uint64_t n = 1 + below(32); n > 0; --n) b.push_back((unsigned char)below(256));
    }
    /// A number that programs stumble over, mostly where one stands.
    template <class E>
    void put(Bytes& b) {
        if (b.size() < sizeof(E)) return;
        const E of[] = {0,
                        1,
                        E(-1),
                        E(-2),
                        E(E(1) << (8 * sizeof(E) - 1)),
                        E(~(E(1) << (8 * sizeof(E) - 1))),
                        E(b.size()),
                        E(1) << 31,
                        E(random_()),
                        E(64),
                        E(0x7ff0000000000000ull),
                        E(std::uint64_t(1) << (random_() % 64))};
        const E value = of[below(sizeof of / sizeof *of)];
        std::memcpy(b.data() + place<E>(b), &value, sizeof value);
    }
    template <class E>
    void add(Bytes& b) {
        if (b.size() < sizeof(E)) return;
        const std::size_t at = place<E>(b);
        E value;
        std::memcpy(&value, b.data() + at, sizeof value);
        value = E(value + (below(2) == 0 ? E(1 + below(3)) : E(-1 - E(below(3)))));
        std::memcpy(b.data() + at, &value, sizeof value);
    }
    template <class E>
    std::size_t place(const Bytes& b) {
        // Lengths stand at the beginning.
        const std::size_t within = below(4) == 0 ? std::min<std::size_t>(b.size(), 64) : b.size();
        return 4 * below((within - sizeof(E)) / 4 + 1);
    }

    std::mt19937_64 random_;
};

/// A number of the environment, or another.
inline std::uint64_t number_of(const char* name, std::uint64_t otherwise) {
    const char* text = std::getenv(name);
    return text && *text ? std::strtoull(text, nullptr, 10) : otherwise;
}

}  // namespace mpm::test
