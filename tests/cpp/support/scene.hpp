// Small scenes for engine tests, and what they are asked for.
#pragma once

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <map>
#include <memory>
#include <string>
#include <vector>

#include "mpm/solver/blob.hpp"
#include "mpm/solver/engine.hpp"
#include "mpm/solver/plan.hpp"
#include "mpm/solver/saved_clock.hpp"
#include "support/random.hpp"

namespace mpm::test {

inline constexpr double forever = std::numeric_limits<double>::infinity();

/// Sanitizers take twenty times as long: what is long is shorter there, statistics of long runs and
/// most materials are left out.
#if defined(LIBMPM_SANITIZED)
inline constexpr bool sanitized = true;
#else
inline constexpr bool sanitized = false;
#endif

inline bool is_built(const std::string& name) {
    const auto& all = materials();
    return std::any_of(all.begin(), all.end(), [&](const auto& m) { return name == m.name; });
}

inline std::vector<double> fluid(double bulk_modulus = 2e5) {
    return {1000, bulk_modulus, 7.15, 0.001};
}
inline std::vector<double> solid(double youngs_modulus = 1e6) { return {800, youngs_modulus, 0.3}; }

inline Spec empty_scene(int dimension, bool single, std::vector<std::int64_t> cells,
                        double cell_size = 0.1) {
    Spec s;
    s.dimension = dimension;
    s.precision = single ? Precision::single : Precision::double_;
    s.threads = 1;
    s.cell_size = cell_size;
    s.cells = std::move(cells);
    s.gravity.time = {0};
    s.gravity.value.assign(std::size_t(dimension), 0.0);
    return s;
}

/// Particles at given positions, in metres; the mass follows from `per_cell` particles a cell.
inline BodySpec body(const Spec& s, std::string name, std::string material,
                     std::vector<double> parameters, std::vector<double> position,
                     double per_cell) {
    BodySpec b;
    b.name = std::move(name);
    b.material = std::move(material);
    b.parameters = std::move(parameters);
    b.count = position.size() / std::size_t(s.dimension);
    b.position = rows_of(std::move(position), s.dimension);
    b.particle_mass = b.parameters[0] * std::pow(s.cell_size, s.dimension) / per_cell;
    b.velocity.assign(std::size_t(s.dimension), 0.0);
    b.bounds.assign(std::size_t(2 * s.dimension), 0.0);
    for (int a = 0; a < s.dimension; ++a)
        b.bounds[std::size_t(s.dimension + a)] = double(s.cells[a]) * s.cell_size;
    for (const auto& o : s.bodies) b.first_id = std::max(b.first_id, o.first_id + o.count);
    return b;
}

/// Positions of all particles of a body in a row.
inline std::vector<double> positions(const BodySpec& b, int dimension) {
    std::vector<double> x(b.count * std::size_t(dimension));
    b.position(0, b.count, x.data());
    return x;
}

/// A lattice with `n` particles a cell along each axis over the cells [lower, upper).
inline std::vector<double> lattice(const Spec& s, std::vector<int> lower, std::vector<int> upper,
                                   int n) {
    std::vector<double> out;
    std::size_t total = 1;
    for (int a = 0; a < s.dimension; ++a) total *= std::size_t((upper[a] - lower[a]) * n);
    for (std::size_t k = 0; k < total; ++k) {
        std::size_t rest = k;
        for (int a = 0; a < s.dimension; ++a) {
            const std::size_t count = std::size_t((upper[a] - lower[a]) * n);
            out.push_back((lower[a] + (double(rest % count) + 0.5) / n) * s.cell_size);
            rest /= count;
        }
    }
    return out;
}

inline void add_walls(Spec& s, Response response) {
    BoundarySpec b;
    b.name = "walls";
    b.present.assign(std::size_t(2 * s.dimension), 1);
    b.law.assign(std::size_t(2 * s.dimension), {response, 0, 0});
    b.end = forever;
    s.boundaries.push_back(b);
}

/// Gravity that turns about, so that what is in a box comes by all of it.
inline void tilt(Spec& s) {
    s.gravity.time.clear();
    s.gravity.value.clear();
    for (int k = 0; k < 8; ++k) {
        s.gravity.time.push_back(0.15 * k);
        for (int a = 0; a < s.dimension; ++a)
            s.gravity.value.push_back(20 * std::sin(2.4 * k + 1.3 * a));
    }
    s.gravity.end = TableEnd::repeat;
}

inline void add_energy(Spec& s, double interval) {
    SensorSpec e;
    e.name = "energy";
    e.kind = SensorKind::energy;
    e.interval = interval;
    s.sensors.push_back(e);
}

/// Water and two solid blocks that fall into each other in a closed basin: both materials, two
/// bodies of one material, F-bar, walls, a box, sensors of all kinds, sorts.
inline Spec busy_scene(int dimension, bool single) {
    const bool flat = dimension == 2;
    Spec s = empty_scene(
        dimension, single,
        flat ? std::vector<std::int64_t>{70, 40} : std::vector<std::int64_t>{20, 14, 12});
    s.gravity.value[std::size_t(dimension - 1)] = -9.81;
    s.bodies.push_back(
        body(s, "water", "TaitFluid", fluid(),
             flat ? lattice(s, {0, 0}, {50, 22}, 2) : lattice(s, {0, 0, 0}, {12, 14, 6}, 2),
             flat ? 4 : 8));
    s.bodies.back().smoothing = SmoothingForm::one_volume_gradient;
    s.bodies.back().smoothing_time = 0.01;
    for (int k = 0; k < 2; ++k) {
        const int x = 2 + 5 * k;
        s.bodies.push_back(body(
            s, "block" + std::to_string(k), "FixedCorotated", solid(),
            flat ? lattice(s, {x, 25}, {x + 4, 28}, 3) : lattice(s, {x, 4, 8}, {x + 3, 8, 10}, 2),
            flat ? 9 : 8));
        s.bodies.back().velocity[std::size_t(dimension - 1)] = -3.0;
        s.bodies.back().velocity[0] = 1.0 - 1.5 * k;
    }
    add_walls(s, Response::separable);
    BoundarySpec box;
    box.name = "box";
    box.is_box = true;
    box.lower = flat ? std::vector<int>{58, 0} : std::vector<int>{15, 4, 0};
    box.upper = flat ? std::vector<int>{62, 20} : std::vector<int>{18, 9, 8};
    box.present.assign(std::size_t(2 * dimension), 1);
    box.law.assign(std::size_t(2 * dimension), {Response::separable, 0.3, 0.2});
    box.end = forever;
    s.boundaries.push_back(box);
    add_energy(s, 0.003);
    SensorSpec load;
    load.name = "load";
    load.kind = SensorKind::load_cell;
    load.boundary = 0;
    load.faces = (1 << (2 * dimension)) - 1;
    load.reference.assign(std::size_t(dimension), 0.0);
    s.sensors.push_back(load);
    SensorSpec track;
    track.name = "track";
    track.kind = SensorKind::tracker;
    track.body = 1;
    track.interval = 0.002;
    track.ids = {s.bodies[1].first_id + 5, s.bodies[1].first_id};
    s.sensors.push_back(track);
    return s;
}

/// Attributes of one body by id: id -> the numbers of all its attributes in a row, without those of
/// elements.
inline std::map<std::uint64_t, std::vector<double>> table(Engine& engine, int body) {
    auto names = engine.attribute_names(body);
    std::erase_if(names, [](const std::string& n) { return n == "id" || is_of_elements(n); });
    const Attributes a = engine.attributes(body, names);
    std::map<std::uint64_t, std::vector<double>> out;
    for (std::size_t k = 0; k < a.id.size(); ++k) {
        auto& row = out[a.id[k]];
        for (const auto& [name, array] : a.values) {
            const std::size_t width = array.data.size() / a.id.size();
            for (std::size_t c = 0; c < width; ++c) row.push_back(array.data[k * width + c]);
        }
    }
    return out;
}

/// Everything a state consists of, byte for byte, but the clock: ranks count strays in other
/// portions.
inline std::map<std::string, std::vector<unsigned char>> state_bytes(Engine& engine) {
    std::map<std::string, std::vector<unsigned char>> out;
    for (const auto& [name, blob] : engine.save())
        if (name.rfind("clock_", 0) != 0) out[name] = blob.bytes;
    return out;
}

/// The same state as version 0.1 has saved it: the clock as an image of its memory, of versions
/// before that without its end.
inline State as_format_1(State state, bool shorter = false) {
    const Clock now = saved_clock(state);
    ClockOfFormat1 c{};
    c.time = now.time;
    c.dt = c.dt_next = now.dt;
    c.dt_stable = now.dt_stable;
    c.step = now.step;
    c.drift = now.drift;
    c.strays = now.strays;
    c.stray_limit = now.stray_limit;
    c.speed = now.speed;
    std::copy_n(now.unit_read, 3, c.unit_read);
    std::copy_n(now.scale_write, 3, c.scale_write);
    std::copy_n(now.deposited, 3, c.deposited);
    std::copy_n(now.deposit_limit, 3, c.deposit_limit);
    std::copy_n(now.deposited_before, 3, c.deposited_before);
    std::copy_n(now.log_step, now.log_count, c.log_step);
    std::copy_n(now.log_speed, now.log_count, c.log_speed);
    c.log_count = now.log_count;
    c.log_stride = now.log_stride;
    c.fault_particle = no_fault;
    c.until = forever;
    c.halt = 3;
    for (auto entry = state.begin(); entry != state.end();)
        entry = entry->first.rfind("clock_", 0) == 0 ? state.erase(entry) : std::next(entry);
    state.erase("format");
    std::vector<unsigned char> bytes(sizeof c);
    std::memcpy(bytes.data(), &c, sizeof c);
    if (shorter) bytes.resize(offsetof(ClockOfFormat1, deposited_before));
    state["clock"] = detail::to_blob(bytes);
    return state;
}

}  // namespace mpm::test
