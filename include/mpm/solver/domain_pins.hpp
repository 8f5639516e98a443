// Domain: vertices of elements that are held or driven, and what they push (design/elements.md).
#pragma once

#include "mpm/kernels/pinned_vertices.hpp"
#include "mpm/solver/domain.hpp"

namespace mpm {

template <class X, class T, int D>
void Domain<X, T, D>::rest_pinned(Body& body) {
    if (!body.mesh || !body.mesh->has_pins()) return;
    exec_.for_each(body.count, RestPinned<Grid, T, D>{body.view(), body.mesh->view().held,
                                                      body.scratch.data()});
}

template <class X, class T, int D>
void Domain<X, T, D>::pin_vertices(Body& body, const Phase<X, T, D>& phase) {
    if (!body.mesh->has_pins()) return;
    const ElementsView<T, D> mesh = body.mesh->view();
    body.elements.locate(phase.pass, mesh, false);
    exec_.for_each(body.count,
                   PinVertices<X, T, D>{phase, mesh, body.mesh->pins(), spec_.cell_size});
    tell_pins(body, int(phase.pass.body_number));
}

template <class X, class T, int D>
void Domain<X, T, D>::bear_pull(Body& body, const Phase<X, T, D>& phase) {
    const int number = int(phase.pass.body_number);
    if (!body.mesh->has_pins() || !has_pin_force(number)) return;
    const PinsView pins = body.mesh->pins();
    exec_.for_each(pins.count, BearPull<X, T, D>{phase.pass, body.mesh->view(), pins});
    tell_pins(body, number);
}

template <class X, class T, int D>
bool Domain<X, T, D>::has_pin_force(int number) {
    for (int k = 0; k < sensors_.count(); ++k) {
        const SensorSpec& s = sensors_.at(k).spec;
        if (s.kind == SensorKind::pin_force && s.body == number) return true;
    }
    return false;
}

/// Adds what pins have pushed in a step for sensors that ask.
template <class X, class T, int D>
void Domain<X, T, D>::tell_pins(Body& body, int number) {
    const std::vector<PinSpec>& pins = spec_.bodies[std::size_t(number)].pins;
    for (int k = 0; k < sensors_.count(); ++k) {
        Sensor<Base>& s = sensors_.at(k);
        if (s.spec.kind != SensorKind::pin_force || s.spec.body != number) continue;
        std::size_t first = 0;
        for (int p = 0; p < s.spec.pin; ++p) first += pins[std::size_t(p)].vertices.size();
        exec_.for_each(D, TellPin<D>{clock_buffer_.data(), body.mesh->pins(), std::int64_t(first),
                                     std::int64_t(pins[std::size_t(s.spec.pin)].vertices.size()),
                                     sensors_.scales().impulse, s.pin_told.data()});
    }
}

}  // namespace mpm
