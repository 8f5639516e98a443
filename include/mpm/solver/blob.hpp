// Columns of numbers as pieces of a saved state, and back.
#pragma once

#include <cstring>
#include <type_traits>

#include "mpm/core/error.hpp"
#include "mpm/solver/engine.hpp"

namespace mpm {

namespace detail {

template <class E>
constexpr char type_code() {
    if constexpr (std::is_same_v<E, float>)
        return 'f';
    else if constexpr (std::is_same_v<E, double>)
        return 'd';
    else if constexpr (std::is_same_v<E, std::int32_t>)
        return 'i';
    else if constexpr (std::is_same_v<E, std::int64_t>)
        return 'l';
    else if constexpr (std::is_same_v<E, std::uint32_t>)
        return 'I';
    else if constexpr (std::is_same_v<E, std::uint64_t>)
        return 'L';
    else
        return 'B';
}

/// Bytes of an element; 0 where there is no such type.
constexpr std::size_t size_of(char type) {
    switch (type) {
        case 'f':
        case 'i':
        case 'I':
            return 4;
        case 'd':
        case 'l':
        case 'L':
            return 8;
        case 'B':
            return 1;
        default:
            return 0;
    }
}

template <class E>
Blob to_blob(const std::vector<E>& v) {
    Blob b;
    b.type = type_code<E>();
    b.shape = {b.type == 'B' ? v.size() * sizeof(E) : v.size()};
    b.bytes.resize(v.size() * sizeof(E));
    if (!v.empty()) std::memcpy(b.bytes.data(), v.data(), b.bytes.size());
    return b;
}

inline const Blob& find(const State& state, const std::string& name) {
    const auto it = state.find(name);
    if (it == state.end())
        throw SceneError("the saved state has no entry '" + name +
                         "'; it is not a state of this scene");
    return it->second;
}

template <class E>
std::vector<E> from_blob(const State& state, const std::string& name) {
    const Blob& b = find(state, name);
    if (b.bytes.size() % sizeof(E) != 0 || b.type != type_code<E>()) {
        throw SceneError("the saved state's entry '" + name +
                         "' has another type than this run; it was saved by another "
                         "version or precision");
    }
    std::vector<E> v(b.bytes.size() / sizeof(E));
    if (!v.empty()) std::memcpy(v.data(), b.bytes.data(), b.bytes.size());
    return v;
}

/// Numbers of whatever floating type, as doubles.
inline std::vector<double> numbers(const State& state, const std::string& name) {
    const Blob& b = find(state, name);
    if (b.type == 'f') {
        const auto v = from_blob<float>(state, name);
        return {v.begin(), v.end()};
    }
    if (b.type == 'i') {
        const auto v = from_blob<std::int32_t>(state, name);
        return {v.begin(), v.end()};
    }
    if (b.type == 'l') {
        const auto v = from_blob<std::int64_t>(state, name);
        return {v.begin(), v.end()};
    }
    return from_blob<double>(state, name);
}

}  // namespace detail

}  // namespace mpm
