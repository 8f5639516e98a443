// What ranks as processes tell each other of their engines, as messages and back.
#pragma once

#include <map>
#include <string>
#include <type_traits>
#include <vector>

#include "mpm/exec/inbox.hpp"
#include "mpm/solver/engine.hpp"

namespace mpm::messages {

/// Whose bytes are its value, whatever they are: not so of a `bool`.
template <class E>
concept Plain =
    std::is_trivially_copyable_v<E> && !std::is_same_v<E, Flow> && !std::is_same_v<E, bool>;

inline void put(Packer& to, const Plain auto& value) { to.put(&value, 1); }
inline void get(Unpacker& from, Plain auto& value) { from.get(&value, 1); }

inline void put(Packer& to, const std::string& text) {
    to.put(std::vector<char>(text.begin(), text.end()));
}
inline void get(Unpacker& from, std::string& text) {
    text = Inbox::legible(from.list<unsigned char>());
}

template <Plain E>
void put(Packer& to, const std::vector<E>& list) {
    to.put(list);
}
template <Plain E>
void get(Unpacker& from, std::vector<E>& list) {
    list = from.list<E>();
}

inline void put(Packer& to, const Array& a) {
    put(to, a.shape);
    put(to, a.data);
}
inline void get(Unpacker& from, Array& a) {
    get(from, a.shape);
    get(from, a.data);
}

inline void put(Packer& to, const Blob& b) {
    put(to, b.type);
    put(to, b.shape);
    put(to, b.bytes);
}
inline void get(Unpacker& from, Blob& b) {
    get(from, b.type);
    get(from, b.shape);
    get(from, b.bytes);
}

inline void put(Packer& to, const Samples& s) {
    put(to, s.time);
    put(to, s.values);
}
inline void get(Unpacker& from, Samples& s) {
    get(from, s.time);
    get(from, s.values);
}

inline void put(Packer& to, const Removed& r) {
    put(to, r.body);
    put(to, r.ids);
    put(to, r.position);
    put(to, r.step);
    put(to, r.policy);
}
inline void get(Unpacker& from, Removed& r) {
    get(from, r.body);
    get(from, r.ids);
    get(from, r.position);
    get(from, r.step);
    get(from, r.policy);
}

inline void put(Packer& to, const Flow& f) {
    put(to, std::int32_t(f.inlet));
    put(to, f.number);
    put(to, f.step);
    put(to, f.particles);
    for (const double value : {f.time, f.mass, f.volume}) put(to, value);
}
inline void get(Unpacker& from, Flow& f) {
    std::int32_t inlet = 0;
    get(from, inlet);
    f.inlet = inlet != 0;
    get(from, f.number);
    get(from, f.step);
    get(from, f.particles);
    for (double* value : {&f.time, &f.mass, &f.volume}) get(from, *value);
}

inline void put(Packer& to, const RunResult& r) {
    put(to, r.reason);
    put(to, r.steps);
    put(to, r.time);
    const Fault& f = r.fault;
    for (const std::string* text : {&f.code, &f.body, &f.message}) put(to, *text);
    put(to, f.ids);
    put(to, f.element);
    put(to, f.step);
    put(to, f.grew_since);
    for (const double value : {f.time, f.value, f.speed}) put(to, value);
}
inline void get(Unpacker& from, RunResult& r) {
    get(from, r.reason);
    get(from, r.steps);
    get(from, r.time);
    Fault& f = r.fault;
    for (std::string* text : {&f.code, &f.body, &f.message}) get(from, *text);
    get(from, f.ids);
    get(from, f.element);
    get(from, f.step);
    get(from, f.grew_since);
    for (double* value : {&f.time, &f.value, &f.speed}) get(from, *value);
}

inline void put(Packer& to, const Condition& c) {
    for (const double value : {c.kinetic, c.elastic, c.potential, c.speed, c.mass, c.density})
        put(to, value);
    put(to, c.volume_ratio);
    put(to, c.moving);
}
inline void get(Unpacker& from, Condition& c) {
    for (double* value : {&c.kinetic, &c.elastic, &c.potential, &c.speed, &c.mass, &c.density})
        get(from, *value);
    get(from, c.volume_ratio);
    get(from, c.moving);
}

template <class E>
requires(!Plain<E>) void put(Packer& to, const std::vector<E>& list) {
    put(to, std::uint64_t(list.size()));
    for (const E& e : list) put(to, e);
}
template <class E>
requires(!Plain<E>) void get(Unpacker& from, std::vector<E>& list) {
    std::uint64_t n = 0;
    get(from, n);
    list.clear();
    for (std::uint64_t k = 0; k < n; ++k) get(from, list.emplace_back());
}

template <class E>
void put(Packer& to, const std::map<std::string, E>& map) {
    put(to, std::uint64_t(map.size()));
    for (const auto& [name, value] : map) {
        put(to, name);
        put(to, value);
    }
}
template <class E>
void get(Unpacker& from, std::map<std::string, E>& map) {
    std::uint64_t n = 0;
    get(from, n);
    for (std::uint64_t k = 0; k < n; ++k) {
        std::string name;
        get(from, name);
        if (map.contains(name)) throw MessageError("with '" + name + "' twice");
        get(from, map[name]);
    }
}

template <class E>
Bytes pack(const E& value) {
    Packer to;
    put(to, value);
    return to.take();
}
template <class E>
E unpack(const Bytes& bytes) {
    Unpacker from(bytes);
    E value{};
    get(from, value);
    return value;
}

}  // namespace mpm::messages
