// SHA-256 (FIPS 180-4) and the keyed hash made of it, HMAC (RFC 2104): by which processes prove to
// each other that they know the same secret. A few messages of a hundred bytes when ranks meet, so
// plainness counts and speed does not; tested with the vectors of the standards.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <cstring>
#include <string>

namespace mpm {

using Digest = std::array<unsigned char, 32>;

class Sha256 {
public:
    Sha256& add(const void* data, std::size_t size) {
        const auto* at = static_cast<const unsigned char*>(data);
        length_ += size;
        for (; size > 0; --size) {
            block_[held_++] = *at++;
            if (held_ == block_.size()) take_block();
        }
        return *this;
    }
    Digest digest() {
        const std::uint64_t bits = 8 * length_;
        const unsigned char one = 0x80, zero = 0;
        add(&one, 1);
        while (held_ != 56) add(&zero, 1);
        for (int k = 7; k >= 0; --k) {
            const auto byte = static_cast<unsigned char>(bits >> (8 * k));
            add(&byte, 1);
        }
        Digest out{};
        for (std::size_t k = 0; k < out.size(); ++k)
            out[k] = static_cast<unsigned char>(state_[k / 4] >> (24 - 8 * (k % 4)));
        return out;
    }

private:
    static std::uint32_t turned(std::uint32_t x, int n) { return x >> n | x << (32 - n); }

    void take_block() {
        static constexpr std::uint32_t k[64] = {
            0x428a2f98, 0x71374491, 0xb5c0fbcf, 0xe9b5dba5, 0x3956c25b, 0x59f111f1, 0x923f82a4,
            0xab1c5ed5, 0xd807aa98, 0x12835b01, 0x243185be, 0x550c7dc3, 0x72be5d74, 0x80deb1fe,
            0x9bdc06a7, 0xc19bf174, 0xe49b69c1, 0xefbe4786, 0x0fc19dc6, 0x240ca1cc, 0x2de92c6f,
            0x4a7484aa, 0x5cb0a9dc, 0x76f988da, 0x983e5152, 0xa831c66d, 0xb00327c8, 0xbf597fc7,
            0xc6e00bf3, 0xd5a79147, 0x06ca6351, 0x14292967, 0x27b70a85, 0x2e1b2138, 0x4d2c6dfc,
            0x53380d13, 0x650a7354, 0x766a0abb, 0x81c2c92e, 0x92722c85, 0xa2bfe8a1, 0xa81a664b,
            0xc24b8b70, 0xc76c51a3, 0xd192e819, 0xd6990624, 0xf40e3585, 0x106aa070, 0x19a4c116,
            0x1e376c08, 0x2748774c, 0x34b0bcb5, 0x391c0cb3, 0x4ed8aa4a, 0x5b9cca4f, 0x682e6ff3,
            0x748f82ee, 0x78a5636f, 0x84c87814, 0x8cc70208, 0x90befffa, 0xa4506ceb, 0xbef9a3f7,
            0xc67178f2};
        std::uint32_t w[64];
        for (std::size_t t = 0; t < 16; ++t)
            w[t] = std::uint32_t(block_[4 * t]) << 24 | std::uint32_t(block_[4 * t + 1]) << 16 |
                   std::uint32_t(block_[4 * t + 2]) << 8 | std::uint32_t(block_[4 * t + 3]);
        for (std::size_t t = 16; t < 64; ++t) {
            const std::uint32_t a = w[t - 15], b = w[t - 2];
            w[t] = w[t - 16] + (turned(a, 7) ^ turned(a, 18) ^ a >> 3) + w[t - 7] +
                   (turned(b, 17) ^ turned(b, 19) ^ b >> 10);
        }
        auto s = state_;
        for (std::size_t t = 0; t < 64; ++t) {
            const std::uint32_t e = s[4], a = s[0];
            const std::uint32_t t1 = s[7] + (turned(e, 6) ^ turned(e, 11) ^ turned(e, 25)) +
                                     ((e & s[5]) ^ (~e & s[6])) + k[t] + w[t],
                                t2 = (turned(a, 2) ^ turned(a, 13) ^ turned(a, 22)) +
                                     ((a & s[1]) ^ (a & s[2]) ^ (s[1] & s[2]));
            s = {t1 + t2, s[0], s[1], s[2], s[3] + t1, s[4], s[5], s[6]};
        }
        for (std::size_t n = 0; n < 8; ++n) state_[n] += s[n];
        held_ = 0;
    }

    std::array<std::uint32_t, 8> state_ = {0x6a09e667, 0xbb67ae85, 0x3c6ef372, 0xa54ff53a,
                                           0x510e527f, 0x9b05688c, 0x1f83d9ab, 0x5be0cd19};
    std::array<unsigned char, 64> block_{};
    std::size_t held_ = 0;
    std::uint64_t length_ = 0;
};

/// HMAC-SHA-256 of a message under a key.
inline Digest keyed_hash(const std::string& key, const void* data, std::size_t size) {
    std::array<unsigned char, 64> inner{}, outer{};
    if (key.size() > inner.size()) {
        const Digest shorter = Sha256().add(key.data(), key.size()).digest();
        std::memcpy(inner.data(), shorter.data(), shorter.size());
    } else if (!key.empty()) {
        std::memcpy(inner.data(), key.data(), key.size());
    }
    for (std::size_t k = 0; k < inner.size(); ++k) {
        outer[k] = inner[k] ^ 0x5c;
        inner[k] ^= 0x36;
    }
    const Digest first = Sha256().add(inner.data(), inner.size()).add(data, size).digest();
    return Sha256().add(outer.data(), outer.size()).add(first.data(), first.size()).digest();
}

/// Takes as long wherever they differ: how long it took tells nobody how much was right.
inline bool equal_in_constant_time(const Digest& a, const Digest& b) {
    volatile unsigned char different = 0;
    for (std::size_t k = 0; k < a.size(); ++k) different = different | (a[k] ^ b[k]);
    return different == 0;
}

}  // namespace mpm
