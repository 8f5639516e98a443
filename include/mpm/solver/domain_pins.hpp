// Domain: vertices of elements that are held or driven, and what they push (design/elements.md).
#pragma once

#include <array>

#include "mpm/solver/domain.hpp"

namespace mpm {

/// The pin of each pinned vertex, in their order.
inline std::vector<const PinSpec*> pins_by_vertex(const std::vector<PinSpec>& pins) {
    std::vector<const PinSpec*> out;
    for (const PinSpec& pin : pins) out.insert(out.end(), pin.vertices.size(), &pin);
    return out;
}

/// Before the first step: pinned vertices begin at rest, whatever velocity their body has.
template <class X, class T, int D>
void Domain<X, T, D>::rest_pinned(Body& body, const BodySpec& spec) {
    if constexpr (!X::is_device) {
        const std::int32_t* pinned = body.mesh ? body.mesh->pinned() : nullptr;
        if (!pinned) return;
        const std::vector<const PinSpec*> pin_of = pins_by_vertex(spec.pins);
        for (std::uint32_t q = 0; q < body.count; ++q) {
            const std::int32_t k = pinned[body.id.data()[q]];
            if (k < 0) continue;
            for (const int a : pin_of[std::size_t(k)]->axes)
                body.scratch.data()[std::size_t(a) * body.count + q] = Grid(0);
        }
    }
}

/// What pinned vertices have gathered makes way for the velocity that brings them where their pins
/// are at the end of the step. That is what they deposit, and what they store where a transfer
/// makes them: nothing is left that the grid cannot see. A pin gives the momentum by which its
/// vertices differ from what they would have kept, and bears what their elements pull.
template <class X, class T, int D>
void Domain<X, T, D>::pin_vertices(Body& body, const Phase<X, T, D>& phase) {
    if constexpr (!X::is_device) {
        const int number = int(phase.pass.body_number);
        const std::vector<PinSpec>& pins = spec_.bodies[std::size_t(number)].pins;
        const Clock& clock = *phase.pass.clock;
        if (pins.empty() || clock.halt != Halt::none) return;
        const ElementsView<T, D> mesh = body.mesh->view();
        body.elements.locate(phase.pass, mesh, false);
        const std::vector<const PinSpec*> pin_of = pins_by_vertex(pins);
        std::vector<std::array<double, D>> goal(pins.size()), push(pin_of.size());
        for (std::size_t p = 0; p < pins.size(); ++p) {
            const TableSpec& t = pins[p].displacement;
            if (t.time.empty()) continue;
            TimeTableView{t.time.data(), t.value.data(), std::int32_t(t.time.size()), D, t.end}.at(
                clock.time + clock.dt, goal[p].data());
            for (double& x : goal[p]) x /= spec_.cell_size;
        }
        const PhaseNumbers& n = phase.n;
        const Scratch<D> column{n.channels};
        const std::int32_t* pinned = body.mesh->pinned();
        exec_.host_for(body.count, [&](std::int64_t q) {
            const std::uint32_t id = body.id.data()[q];
            const std::int32_t k = pinned[id];
            if (k < 0) return;
            const PinSpec* pin = pin_of[std::size_t(k)];
            const auto at = [&](int c) -> Grid& {
                return phase.pass.scratch[std::size_t(c) * body.count + std::size_t(q)];
            };
            for (const int a : pin->axes) {
                const std::int64_t entry = std::int64_t(id) * D + a;
                const double gone = double(mesh.cells[entry]) + double(mesh.beyond[entry]),
                             to = goal[std::size_t(pin - pins.data())][std::size_t(a)];
                const T must = T((to - gone) / phase.pass.numbers->move);
                T would = T(at(column.value(a)));
                if (n.velocity >= 0) {  // bodies of elements have no sweeps
                    T& own = phase.pass.body.state[n.velocity + a][q];
                    Grid& before = at(column.before(a));
                    would += T(n.scheme.keep) * (own - T(before));
                    own = must;
                    before = Grid(must);
                }
                at(column.value(a)) = Grid(must);
                push[std::size_t(k)][std::size_t(a)] =
                    body.mesh->mass()[id] * (double(must) - double(would));
            }
        });
        tell_pins(number, push);
    }
}

/// What elements and tractions pull at pinned vertices in the coming step, which the grid is not
/// given.
template <class X, class T, int D>
void Domain<X, T, D>::bear_pull(Body& body, const Phase<X, T, D>& phase) {
    if constexpr (!X::is_device) {
        const int number = int(phase.pass.body_number);
        const ElementsView<T, D> mesh = body.mesh->view();
        if (!mesh.held || !has_pin_force(number)) return;
        const double density = phase.pass.body.particle_mass / phase.pass.body.particle_volume,
                     time = 0.25 * phase.pass.numbers->impulse * density;  // dt_next / dx
        std::vector<std::array<double, D>> push;
        for (const PinSpec& pin : spec_.bodies[std::size_t(number)].pins)
            for (const std::uint64_t v : pin.vertices) {
                const Vec<T, D> pull = force_on_vertex(mesh, std::int64_t(v));
                std::array<double, D>& to = push.emplace_back();
                for (const int a : pin.axes) to[std::size_t(a)] = -time * double(pull[a]);
            }
        tell_pins(number, push);
    }
}

template <class X, class T, int D>
bool Domain<X, T, D>::has_pin_force(int number) {
    for (int k = 0; k < sensors_.count(); ++k) {
        const SensorSpec& s = sensors_.at(k).spec;
        if (s.kind == SensorKind::pin_force && s.body == number) return true;
    }
    return false;
}

/// Adds what pins have pushed in a step, vertex by vertex in their order, for sensors that ask.
template <class X, class T, int D>
void Domain<X, T, D>::tell_pins(int number, const std::vector<std::array<double, D>>& push) {
    const std::vector<PinSpec>& pins = spec_.bodies[std::size_t(number)].pins;
    for (int k = 0; k < sensors_.count(); ++k) {
        Sensor<Base>& s = sensors_.at(k);
        if (s.spec.kind != SensorKind::pin_force || s.spec.body != number) continue;
        std::size_t first = 0;
        for (int p = 0; p < s.spec.pin; ++p) first += pins[std::size_t(p)].vertices.size();
        s.told.resize(D, 0.0);
        for (std::size_t v = 0; v < pins[std::size_t(s.spec.pin)].vertices.size(); ++v)
            for (std::size_t a = 0; a < D; ++a) s.told[a] += push[first + v][a];
    }
}

/// The mean force of a body on its pin since the sample before.
template <class X, class T, int D>
void Domain<X, T, D>::sample_pin(Sensor<Base>& s, SensorRecord& record) {
    if constexpr (!X::is_device) {
        const double time = clock_buffer_.data()->time, elapsed = time - record.last_time;
        const bool known = record.last_time >= 0 && elapsed > 0;
        s.told.resize(D, 0.0);
        double* row = open_row(record, time);
        for (std::size_t a = 0; a < D; ++a)
            row[a] = known ? -s.told[a] / elapsed : std::numeric_limits<double>::quiet_NaN();
        s.told.assign(D, 0.0);
        record.last_time = time;
    }
}

}  // namespace mpm
