// What comes over a connection, made into messages: a header, then as many bytes as it announces.
// No byte is believed before it is looked at: whoever sends what is no message, or more than it
// may, is refused before memory is taken for it.
#pragma once

#include <algorithm>
#include <cstdint>
#include <deque>
#include <string>
#include <utility>

#include "mpm/exec/communicator.hpp"

namespace mpm {

struct FrameHeader {
    static constexpr std::uint32_t message = 1, stop = 2;
    std::uint32_t kind = message;
    std::uint32_t unused = 0;
    std::uint64_t size = 0;
};
static_assert(sizeof(FrameHeader) == 16, "it travels as it is");

class Inbox {
public:
    /// `at_once`: bytes that are taken for what is announced and has not come; more are as it
    /// comes.
    explicit Inbox(std::size_t at_once = std::size_t(64) << 20) : at_once_(at_once) {}

    /// Larger messages are none of ours.
    static constexpr std::uint64_t most_bytes = std::uint64_t(1) << 46;
    /// Of the text with which a rank stops.
    static constexpr std::size_t most_text = 1 << 16;
    /// Whole messages that nobody has asked for: whoever gives the next must have had an answer to
    /// the one before.
    static constexpr std::size_t most_whole = 2;

    /// Where the next bytes go, and how many at most.
    std::pair<unsigned char*, std::size_t> space() {
        if (come_ < sizeof header_)
            return {reinterpret_cast<unsigned char*>(&header_) + come_, sizeof header_ - come_};
        const std::size_t have = come_ - sizeof header_;
        if (have == body_.size())
            body_.resize(std::size_t(std::min<std::uint64_t>(header_.size, 2 * have)));
        return {body_.data() + have, body_.size() - have};
    }
    /// So many have come there. Throws MessageError where they are no message.
    void come(std::size_t n) {
        const bool head = come_ < sizeof header_;
        come_ += n;
        if (head && come_ == sizeof header_) begin();
        if (come_ < sizeof header_ || come_ - sizeof header_ < header_.size) return;
        come_ = 0;
        if (header_.kind == FrameHeader::message) {
            whole_.push_back(std::exchange(body_, {}));
        } else {
            stopped_ = true;
            why_ = legible(std::exchange(body_, {}));
        }
    }

    std::size_t whole() const { return whole_.size(); }
    Bytes take() {
        Bytes out = std::move(whole_.front());
        whole_.pop_front();
        return out;
    }
    bool has_stopped() const { return stopped_; }
    const std::string& why() const { return why_; }

    /// Text of others, for messages: UTF-8 without control characters, whatever it was.
    static std::string legible(const Bytes& bytes) {
        std::string out;
        for (std::size_t k = 0; k < bytes.size();) {
            const std::size_t n = letter(bytes, k);
            if (n == 0)
                out += '?';
            else
                out.append(bytes.begin() + std::ptrdiff_t(k),
                           bytes.begin() + std::ptrdiff_t(k + n));
            k += std::max<std::size_t>(n, 1);
        }
        return out;
    }

private:
    void begin() {
        const auto refuse = [](const std::string& what) { throw MessageError(what); };
        const std::string size = std::to_string(header_.size);
        if ((header_.kind != FrameHeader::message && header_.kind != FrameHeader::stop) ||
            header_.unused != 0)
            refuse("what is no message (of kind " + std::to_string(header_.kind) + ")");
        if (header_.kind == FrameHeader::stop && header_.size > most_text)
            refuse("a word to stop of " + size + " bytes");
        if (header_.size > most_bytes) refuse("a message that announces " + size + " bytes");
        if (header_.kind == FrameHeader::message && whole_.size() >= most_whole)
            refuse("more messages than it was asked for");
        body_.resize(std::size_t(std::min<std::uint64_t>(header_.size, at_once_)));
    }
    /// Bytes of the letter of UTF-8 that begins here; 0 where none does.
    static std::size_t letter(const Bytes& bytes, std::size_t at) {
        const unsigned char first = bytes[at];
        if (first < 0x80) return (first >= 0x20 && first != 0x7f) || first == '\n' ? 1 : 0;
        const std::size_t n = first >= 0xf0 ? 4 : first >= 0xe0 ? 3 : 2;
        if (first < 0xc2 || first > 0xf4 || at + n > bytes.size()) return 0;
        std::uint32_t code = first & (0x7fu >> n);
        for (std::size_t k = 1; k < n; ++k) {
            if ((bytes[at + k] & 0xc0) != 0x80) return 0;
            code = code << 6 | (bytes[at + k] & 0x3f);
        }
        const bool shortest = code >= (n == 2 ? 0x80u : n == 3 ? 0x800u : 0x10000u);
        return shortest && code <= 0x10ffff && (code < 0xd800 || code > 0xdfff) ? n : 0;
    }

    std::size_t at_once_;
    FrameHeader header_;
    Bytes body_;
    std::size_t come_ = 0;  // of header and body
    std::deque<Bytes> whole_;
    bool stopped_ = false;
    std::string why_;
};

}  // namespace mpm
