// Memory of one executor. Move-only, uninitialised, released with its executor's call.
#pragma once

#include <cstddef>
#include <type_traits>
#include <utility>
#include <vector>

namespace mpm {

/// Room behind a column of particles: lanes of a pack may read past the last one. What a sort needs
/// for a while has the same size, so that a pool hands the same piece from one to the other.
inline constexpr std::size_t column_padding = 16;

template <class X, class T>
class BufferOf {
    static_assert(std::is_trivially_copyable_v<T>);

public:
    explicit BufferOf(X& x) : exec_(&x) {}
    BufferOf(const BufferOf&) = delete;
    BufferOf& operator=(const BufferOf&) = delete;
    BufferOf(BufferOf&& other) noexcept { swap(other); }
    BufferOf& operator=(BufferOf&& other) noexcept {
        swap(other);
        return *this;
    }
    ~BufferOf() {
        if (data_) exec_->release(data_, bytes());
    }

    T* data() const { return data_; }
    std::size_t size() const { return size_; }
    std::size_t bytes() const { return capacity_ * sizeof(T); }

    /// Room for n elements; what was there is lost when it has to grow. Grows by a sixteenth beyond
    /// what is asked; large pieces, whose room would be missed, by a sixty-fourth.
    void reserve_discard(std::size_t n) {
        if (n > capacity_) {
            if (data_) exec_->release(data_, bytes());
            data_ = nullptr;
            capacity_ = 0;
            const bool large = n * sizeof(T) >= std::size_t(64) << 20;
            const std::size_t room = size_ == 0 ? n : n + n / (large ? 64 : 16);
            data_ = static_cast<T*>(exec_->allocate((room > 0 ? room : 1) * sizeof(T)));
            capacity_ = room;
        }
        size_ = n;
    }
    /// Forgets what lies beyond the first n elements.
    void shrink(std::size_t n) { size_ = n < size_ ? n : size_; }
    void zero() { exec_->zero(data_, size_ * sizeof(T)); }
    void assign(const std::vector<T>& host) {
        reserve_discard(host.size());
        if (!host.empty()) exec_->upload(data_, host.data(), host.size() * sizeof(T));
    }
    std::vector<T> host() const { return host(size_); }
    /// The first n elements.
    std::vector<T> host(std::size_t n) const {
        std::vector<T> out(n);
        if (n) exec_->download(out.data(), data_, n * sizeof(T));
        return out;
    }
    void swap(BufferOf& other) noexcept {
        std::swap(exec_, other.exec_);
        std::swap(data_, other.data_);
        std::swap(size_, other.size_);
        std::swap(capacity_, other.capacity_);
    }

private:
    X* exec_ = nullptr;
    T* data_ = nullptr;
    std::size_t size_ = 0;
    std::size_t capacity_ = 0;
};

template <class X>
struct BaseOfExecutor {
    using type = X;
};
template <class X>
requires requires { typename X::Base; }
struct BaseOfExecutor<X> {
    using type = typename X::Base;
};
/// An executor without what it says of numbers: its memory and its verbs. What knows no number is
/// compiled for these alone.
template <class X>
using ExecutorBase = typename BaseOfExecutor<X>::type;

/// Executors that differ in their numbers alone have the same memory.
template <class X, class T>
using Buffer = BufferOf<ExecutorBase<X>, T>;

}  // namespace mpm
