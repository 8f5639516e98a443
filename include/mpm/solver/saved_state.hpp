// Reading a saved state that nobody vouches for: what an entry is not, an error says by its name.
#pragma once

#include <cmath>
#include <string>
#include <utility>
#include <vector>

#include "mpm/solver/blob.hpp"

namespace mpm {

/// Layout of saved states. 1: states without an entry "format", the clock as an image of memory;
/// 2: named fields alone.
inline constexpr std::int32_t state_format = 2;

[[noreturn]] inline void refuse_entry(const std::string& name, const std::string& is,
                                      const std::string& expected) {
    throw SceneError("the saved state's entry '" + name + "' " + is + "; expected " + expected +
                     "; the state is damaged or of another scene, use an older one");
}

/// Typed access to the entries of a state; whatever does not fit is a `SceneError`.
class SavedState {
public:
    explicit SavedState(const State& state) : state_(state) {}

    bool has(const std::string& name) const { return state_.contains(name); }

    /// Number of elements.
    std::size_t size(const std::string& name) const { return entry(name).shape[0]; }
    char type(const std::string& name) const { return entry(name).type; }

    template <class E>
    std::vector<E> list(const std::string& name) const {
        const Blob& b = entry(name);
        if (b.type != detail::type_code<E>())
            refuse_entry(name, std::string("is of type '") + b.type + "'",
                         std::string("'") + detail::type_code<E>() + "'");
        std::vector<E> v(b.shape[0]);
        if (!v.empty()) std::memcpy(v.data(), b.bytes.data(), b.bytes.size());
        return v;
    }
    template <class E>
    std::vector<E> list(const std::string& name, std::size_t count) const {
        expect_size(name, count);
        return list<E>(name);
    }
    template <class E>
    E one(const std::string& name) const {
        return list<E>(name, 1)[0];
    }
    /// Finite floating-point numbers, `count` of them, none beyond `most`; `integers`: or integers.
    std::vector<double> numbers(const std::string& name, std::size_t count, double most,
                                bool integers = false) const {
        expect_size(name, count);
        const char code = type(name);
        const bool whole = code == 'i' || code == 'l';
        if (code != 'f' && code != 'd' && !(whole && integers))
            refuse_entry(name, std::string("is of type '") + code + "'", "numbers");
        auto values = detail::numbers(state_, name);
        for (std::size_t k = 0; k < values.size(); ++k)
            if (!(std::abs(values[k]) <= most))
                refuse_entry(name,
                             "has " + std::to_string(values[k]) + " at place " + std::to_string(k),
                             "finite numbers within the precision's range");
        return values;
    }
    void expect_size(const std::string& name, std::size_t count) const {
        if (size(name) != count)
            refuse_entry(name, "has " + std::to_string(size(name)) + " elements",
                         std::to_string(count));
    }

    /// Which layout it is of; raises `SceneError` for one that this version does not know.
    std::int32_t format() const {
        if (!has("format")) return 1;
        const auto found = one<std::int32_t>("format");
        if (found != state_format)
            throw SceneError("the saved state's entry 'format' is " + std::to_string(found) +
                             "; this version reads formats 1 and " + std::to_string(state_format) +
                             ": go on with the version that saved it");
        return found;
    }

private:
    const Blob& entry(const std::string& name) const {
        const Blob& b = detail::find(state_, name);
        const std::size_t size = detail::size_of(b.type);
        if (size == 0 || b.shape.size() != 1)
            refuse_entry(name, "has " + std::to_string(b.shape.size()) + " axes", "a row");
        if (b.bytes.size() % size != 0 || b.bytes.size() / size != b.shape[0])
            refuse_entry(name, "has " + std::to_string(b.bytes.size()) + " bytes",
                         std::to_string(b.shape[0]) + " elements of " + std::to_string(size));
        return b;
    }

    const State& state_;
};

}  // namespace mpm
