#include "mpm/solver/faults.hpp"

#include <algorithm>
#include <cmath>
#include <string>

#include "mpm/kernels/transfers.hpp"

namespace mpm {

std::int64_t growth_start(const Clock& clock) {
    std::int64_t since = 0;
    for (int k = 0; k < clock.log_count; ++k)
        if (!(clock.log_speed[k] > 0.1 * clock.speed)) since = clock.log_step[k];
    return since;
}

template <int D>
Fault describe_fault(const Spec& spec, const Plan& plan, const Clock& clock,
                     const std::function<FailedParticle(std::size_t, std::size_t)>& particle) {
    Fault f;
    f.step = clock.step;
    f.time = clock.time;
    f.speed = clock.speed;
    f.grew_since = growth_start(clock);
    f.value = clock.fault_value;
    if (clock.fault == FaultKind::outran) {
        f.code = clock.fault_value < 1e299 ? "outran-cell" : "non-finite";
        f.message = clock.fault_value < 1e299
                        ? "a node would carry its particles across more than one cell in one step"
                        : "a nodal velocity is not finite";
        return f;
    }
    if (clock.fault == FaultKind::fixed_point) {
        const double* limit = clock.deposit_limit;
        const bool grew = clock.deposited[momentum_sum] > limit[momentum_sum] ||
                          clock.deposited[group_sum] > limit[group_sum];
        f.code = std::isfinite(f.value) ? "fixed-point" : "non-finite";
        f.message = !std::isfinite(f.value) ? "what particles deposit is not finite"
                    : grew
                        ? "what particles deposit grew more than 16-fold beyond that of the last "
                          "two steps and no longer fits its fixed-point scale"
                        : "the stress of a particle is so large for the time step that all "
                          "motion beside it would be lost to rounding";
        return f;
    }
    if (clock.fault == FaultKind::crowded) {
        f.code = "crowded-node";
        f.message =
            "more bodies with fields of velocities of their own meet at a node than contact "
            "keeps apart";
        return f;
    }
    if (clock.fault_particle == fault_elsewhere) return f;
    const std::size_t b = clock.fault_particle >> 40;
    if (clock.fault == FaultKind::smoothing) {
        f.body = plan.bodies.at(b).name;
        f.code = std::isfinite(f.value) ? "smoothing-energy" : "non-finite";
        f.message = std::isfinite(f.value)
                        ? "smoothing over cells has added energy to the field that it smooths"
                        : "what smoothing over cells has found is not finite";
        return f;
    }
    const std::size_t k = clock.fault_particle & ((std::uint64_t(1) << 40) - 1);
    const BodyPlan& body = plan.bodies.at(b);
    f.body = body.name;
    --f.step;  // found by the step after
    const FailedParticle failed = particle(b, k);
    f.ids = {failed.id};
    if (clock.fault == FaultKind::smoothing_range) {
        ++f.step;  // found at once
        f.code = "smoothing-range";
        f.message =
            "the field that is smoothed is larger than sums of smoothing over cells can hold on "
            "a device";
        for (const double x : failed.state) {
            if (std::isfinite(x)) continue;
            f.code = "non-finite";
            f.message = "what it stores is not finite";
        }
        return f;
    }
    f.code = "inverted";
    double furthest = 0;
    for (const double x : failed.offset) {
        if (!std::isfinite(x)) f.code = "non-finite";
        furthest = std::max(furthest, std::abs(x));
    }
    const std::vector<double>& state = failed.state;
    double widest = 0;  // half-edge of cpGIMP and CPDI
    for (const double x : state)
        if (!std::isfinite(x)) f.code = "non-finite";
    for (int a = 0; a < D && body.phase.extent >= 0; ++a)
        widest = std::max(
            widest, body.phase.kernel.half_edge * (1 + state[std::size_t(body.phase.extent + a)]));
    bool flat = false;
    if (body.phase.edges >= 0) {
        const auto edges = half_edges_at<D>(body.phase, [&](int r) { return state[r]; });
        for (int a = 0; a < D; ++a) widest = std::max(widest, reach_along(edges, a));
        flat = !(determinant(edges, cofactors(edges)) > 0);
    }
    const std::string follows =
        std::string("its edges, which kernel '") + name_of(spec.kernel.kernel) + "' follows, ";
    if (widest > largest_half_edge && f.code != "non-finite") {
        f.code = "stretched";
        f.value = 2 * widest;
        f.message = follows + "grew beyond three cells";
    } else if (flat && f.code != "non-finite") {
        f.code = "stretched";
        f.message = follows + "enclose no volume any more";
    } else if (f.code == "non-finite") {
        f.message = "its position or state is not finite";
    } else if (furthest > 1.75) {
        f.code = "outran-cell";
        f.value = furthest;
        f.message = "it moved further than the step can see";
    } else {
        f.code = material(spec.bodies.at(b).material).volumetric ? "compressed" : "inverted";
        f.value = state.empty() ? 0 : state[0];
        f.message = material(spec.bodies.at(b).material).limits;
    }
    return f;
}

#define MPM_FAULTS(D)                           \
    template Fault describe_fault<D>(           \
        const Spec&, const Plan&, const Clock&, \
        const std::function<FailedParticle(std::size_t, std::size_t)>&);
MPM_FAULTS(2)
MPM_FAULTS(3)
#undef MPM_FAULTS

}  // namespace mpm
