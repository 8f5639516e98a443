// The phased step: what happens to a particle is taken apart, so that transfers, kernels and
// materials add instead of multiplying. Between its parts a particle's numbers lie in scratch
// columns.
//
//   collect   gathers velocity, its gradient and what else the scheme wants; knows no material
//   respond   advances state and position and leaves what is to be deposited; knows no kernel
//   spread    deposits it; knows no material
//
// For all transfers, kernels and forms of F-bar; the fused and two-pass forms are for quadratic
// splines with affine transfer. Here is what the parts share; their bodies are in transfers.hpp and
// respond.hpp, drivers own the loops.
#pragma once

#include "mpm/kernels/body_common.hpp"
#include "mpm/physics/shape/kernel.hpp"
#include "mpm/physics/transfer/scheme.hpp"

namespace mpm {

/// Where the phased step of a body finds its numbers; -1: absent.
struct PhaseNumbers {
    KernelChoice kernel;
    SchemeNumbers scheme;
    int channels = 0;  // velocity, and j with F-bar
    // Channels of nodal velocities behind them.
    int before = -1;    // D: of momentum alone
    int guard = -1;     // 1: a boundary changed the node's velocity
    int filtered = -1;  // D: XPIC
    int plain = -1;     // nodal sums: D, momentum without stress
    // State columns.
    int velocity = -1;       // D: what the particle stores
    int extent = -1;         // D: cpGIMP, stretch of its edges less one
    int edges = -1;          // D x D: CPDI, F - I of its edges
    bool own_edges = false;  // that the material does not store anyway
    bool sweeps = false;     // XPIC, FMPM
    std::int64_t every = 1;  // of their steps one filters
    bool lags = false;       // F-bar: the gathered average is not advanced
    bool leads = false;      // F-bar: what is deposited is advanced once more

    MPM_INLINE bool separate_affine() const {
        return scheme.affine && kernel.gradient == GradientForm::shapes;
    }
};

/// What a launch adds to the grid, or reads of it.
enum class Part : int {
    step,      // all of a step
    speeds,    // collects the velocity alone
    vectors,   // D numbers a particle, to the momentum channels: a sweep of XPIC or FMPM
    averages,  // one number a particle, to the sum of its F-bar group: the split form
    stresses   // what stresses push, after all masses: DDMP, whose step leaves it out
};

/// One body, one step.
template <class X, class T, int D>
struct Phase {
    Pass<X, T, D> pass;
    PhaseNumbers n;
    Part part = Part::step;
    int source = 0;                     // sweeps: channel of nodal velocities that is gathered
    const std::int32_t* due = nullptr;  // nothing is collected where it points to 0
    const typename Pass<X, T, D>::Sum* masses =
        nullptr;         // DDMP: sums that say where nodes have mass
    bool turns = false;  // devices: the clock turns when the step's last is spread
};

/// True where a launch is to do nothing: the run has halted, or nobody is waiting for it. A sample
/// may be due at the very moment of a halt.
template <class X, class T, int D>
MPM_INLINE bool idle(const Phase<X, T, D>& phase) {
    const Clock& clock = *phase.pass.clock;
    if (phase.due != nullptr) return !*phase.due;
    return clock.halt != Halt::none ||
           (phase.part == Part::vectors && clock.step % phase.n.every != 0);
}

/// Columns of scratch, each `count` long.
template <int D>
struct Scratch {
    int channels;
    MPM_INLINE int value(int c) const { return c; }
    MPM_INLINE int slope(int a, int c) const { return channels * (1 + a) + c; }
    /// Affine part where it is not the gradient; later the stress of the coming step.
    MPM_INLINE int stress(int a, int c) const { return channels * (1 + D) + a * D + c; }
    MPM_INLINE int before(int a) const { return channels * (1 + D) + D * D + a; }
    MPM_INLINE int filtered(int a) const { return before(D) + a; }
    MPM_INLINE int guard() const { return before(2 * D); }
};
/// How many columns a body needs.
inline int scratch_columns(int dimension, const PhaseNumbers& n) {
    const auto columns = [&]<int D>() {
        const Scratch<D> s{n.channels};
        return n.guard >= 0      ? s.guard() + 1
               : n.filtered >= 0 ? s.filtered(D)
               : n.before >= 0   ? s.before(D)
                                 : s.before(0);
    };
    return dimension == 2 ? columns.template operator()<2>() : columns.template operator()<3>();
}

/// Channels of a spread, in this order: D of momentum, j with F-bar, D of momentum without stress
/// where a scheme stores velocities, the mass. Sweeps have only the first or only j.
struct SpreadChannel {
    enum Kind { momentum, average, plain, mass } kind;
    int axis;
};
template <int D>
MPM_INLINE int spread_channels(const PhaseNumbers& n, Part part) {
    if (part == Part::vectors || part == Part::stresses) return D;
    if (part == Part::averages) return 1;
    return n.channels + (n.plain >= 0 ? D : 0) + 1;
}
template <int D>
MPM_INLINE SpreadChannel spread_channel(const PhaseNumbers& n, Part part, int channel) {
    if (part == Part::averages) return {SpreadChannel::average, 0};
    if (channel < D) return {SpreadChannel::momentum, channel};
    if (channel < n.channels) return {SpreadChannel::average, 0};
    if (n.plain >= 0 && channel < n.channels + D)
        return {SpreadChannel::plain, channel - n.channels};
    return {SpreadChannel::mass, 0};
}

}  // namespace mpm
