// What the tallies of a scene's sensors need while it runs: tasks, the bodies that they look at,
// and room for parts of their sums (kernels/tally.hpp).
#pragma once

#include <algorithm>
#include <cmath>
#include <vector>

#include "mpm/exec/buffer.hpp"
#include "mpm/exec/sums.hpp"
#include "mpm/kernels/tally.hpp"
#include "mpm/solver/body_store.hpp"
#include "mpm/solver/raw_samples.hpp"

namespace mpm {

template <class X, class T, int D>
struct Tallies {
    using Law = typename LawOf<X, D>::type;
    explicit Tallies(X& x) : tasks(x), asking(x), sets(x), parts(x), bodies(x), places(x) {}

    std::vector<int> seen;                 // bodies, in the order of `bodies`
    std::vector<Buffer<X, IdSpan>> spans;  // of the homes of each of them
    std::vector<std::uint8_t> in_part;     // whether a task is of some of its ids alone
    std::vector<TallyTask<D>> task_list;
    std::vector<std::int32_t> asking_list;
    Buffer<X, TallyTask<D>> tasks;
    Buffer<X, std::int32_t> asking;  // sensors
    Buffer<X, SumSet> sets;          // one a task
    Buffer<X, Tally> parts;
    Buffer<X, TallyBody<T, D, Law>> bodies;
    Buffer<X, double> places;  // of all tasks that ask where particles were at first
    std::int32_t part_count = 0;
    bool stale = true;  // homes have changed, or where particles are

    bool any() const { return !task_list.empty(); }
};

/// A body as what looks at its particles sees it; where they are is the caller's to say.
template <class X, class T, int D, class Law>
TallyBody<T, D, Law> tally_body(const BodyStore<X, T, D>& body, const Law& law) {
    TallyBody<T, D, Law> seen{};
    seen.n = body.plan.phase;
    seen.law = law;
    std::copy(body.parameters.begin(), body.parameters.end(), seen.parameters);
    seen.reals = body.material->reals(D);
    seen.columns = body.plan.state_columns;
    seen.two_volumes = body.plan.smoothing == Smoothing::two_volumes;
    seen.volumetric = body.material->volumetric;
    return seen;
}

/// Scales of a task's sums: of values, or of moments. Finer than `exact_scale` by 20 bits: energies
/// of particles and speeds at rest are that small beside those of waves. Behind the number 34 bits
/// are left for sums of 10^9 particles.
template <int D>
void scale_tally(TallyTask<D>& task, const SceneSizes& sizes, double particle_mass,
                 double particle_volume) {
    const double stress = sizes.density * sizes.speed * sizes.speed;
    const auto size = [&] {
        switch (task.of) {
            case TallyOf::position:
            case TallyOf::elevation: {
                double farthest = sizes.length;
                for (int a = 0; a < D; ++a)
                    farthest = std::max(farthest, std::abs(task.origin[a]) + sizes.length);
                return farthest;
            }
            case TallyOf::velocity:
            case TallyOf::speed:
                return sizes.speed;
            case TallyOf::kinetic_energy:
                return particle_mass * sizes.speed * sizes.speed;
            case TallyOf::volume:
                return particle_volume;
            case TallyOf::density:
                return sizes.density;
            case TallyOf::elastic_energy:
                return particle_volume * stress;
            case TallyOf::pressure:
            case TallyOf::von_mises:
            case TallyOf::stress:
                return stress;
            default:
                return 1.0;
        }
    }();
    const double length = sizes.length;
    for (int k = 0; k < 6; ++k) {
        double of = size;
        if (task.of == TallyOf::motion)
            of = k < 3 ? length : sizes.speed;
        else if (task.of == TallyOf::spin)
            of = k < 3 ? length * sizes.speed : length;
        else if (task.of > TallyOf::motion)
            of = length * length;
        task.scale[k] = std::ldexp(exact_scale(of), 20);
    }
}

}  // namespace mpm
