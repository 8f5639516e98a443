// Sweeps over the grid that XPIC and FMPM make before particles see it, by the residual recursion
// (Bonus 2023, section 5.6; Nairn and Hammerquist 2021):
//
//   r_0 = source,  r_{m+1} = r_m - S+ S r_m,  result = sum over m < k of r_m
//
// S gathers to the particles, S+ averages back. FMPM(k): source and result are the velocity after
// forces and boundaries, which then act once more. XPIC(k): the source is the velocity before them,
// the result what particles are told of it. Momentum does not change, whatever k.
#pragma once

#include "mpm/kernels/grid.hpp"
#include "mpm/kernels/rank_told.hpp"

namespace mpm {

/// The grid half of a step without its consequences.
struct NothingDecided {
    MPM_HD void operator()(const double*) const {}
};

/// Channels of nodal velocities, D each, that a sweep works on.
struct SweepChannels {
    int source = 0, result = 0, residual = 0;
    std::int64_t every = 1;
    MPM_INLINE bool due(const Clock& clock) const {
        return clock.halt == Halt::none && clock.step % every == 0;
    }
};

/// The largest of what a sweep may gather, and the largest nodal mass: a particle gathers no more
/// than the fastest node has, and of light nodes no more than their mass over its own.
template <class T, class Sum, int D>
struct SweepMaxima {
    const NodeUpdate<T, Sum, D>& node;
    MPM_INLINE void see(const T* v, T mass, double (&maxima)[maxima_count]) const {
        const double light = node.light_mass < node.least_mass ? 1 + light_nodes_add : light_nodes;
        for (int a = 0; a < D; ++a)
            UpdateGrid<T, Sum, D>::larger_of(maxima[max_speed], light * node.counts(v[a], mass));
        UpdateGrid<T, Sum, D>::larger_of(maxima[max_mass], double(mass));
    }
    static constexpr double light_nodes = 8;
};

/// The scale of the coming sweep's sums; of one rank of several, what it has found.
struct SetSweepScale {
    Clock* clock;
    int sum_bits;  // 0: sums are plain numbers
    TellRanks tell;
    MPM_HD void operator()(const double* maxima) const {
        if (sum_bits == 0) return;
        if (!tell.any()) return by(maxima[max_speed], maxima[max_mass]);
        RankTold mine{};
        mine.number[0] = maxima[max_speed];
        mine.number[1] = maxima[max_mass];
        tell(mine);
    }
    MPM_HD void by(double speed, double mass) const {
        const double most = speed * mass;
        clock->sweep_scale = power_of_two_below(ldexp(1.0, sum_bits - 1) / (most > 0 ? most : 1.0));
    }
};
/// Devices: when all have told.
struct SetSweepScaleOfAll {
    SetSweepScale set;
    const RankTold* told;
    int ranks;
    MPM_HD void operator()() const {
        double most[2] = {};
        for (int r = 0; r < ranks; ++r)
            for (int k = 0; k < 2; ++k)
                if (!(told[r].number[k] <= most[k])) most[k] = told[r].number[k];
        set.by(most[0], most[1]);
    }
};

template <class T, class Sum, int D>
struct BeginSweep {
    NodeUpdate<T, Sum, D> node;
    SweepChannels channels;
    MPM_INLINE void operator()(std::int64_t i, double (&maxima)[maxima_count]) const {
        if (!channels.due(*node.clock)) return;
        T* u = node.grid.velocity + i * node.grid.velocity_channels;
        for (int a = 0; a < D; ++a)
            u[channels.result + a] = u[channels.residual + a] = u[channels.source + a];
        const T m = node.mass(std::int32_t(i / block_cells), int(i % block_cells));
        SweepMaxima<T, Sum, D>{node}.see(u + channels.residual, m, maxima);
    }
};

/// After S+ S r has been added to the momentum sums of `work`, which are cleared again.
template <class T, class Sum, int D>
struct AdvanceSweep {
    NodeUpdate<T, Sum, D> node;
    Sum* work;
    SweepChannels channels;
    MPM_INLINE void operator()(std::int64_t i, double (&maxima)[maxima_count]) const {
        if (!channels.due(*node.clock)) return;
        const auto& g = node.grid;
        const std::int32_t slot = std::int32_t(i / block_cells);
        const int n = int(i % block_cells);
        T* u = g.velocity + i * g.velocity_channels;
        Sum* sum = work + std::int64_t(slot) * g.sum_channels * block_cells + n;
        const T m = node.mass(slot, n);
        const double unit = std::is_integral_v<Sum> ? 1 / node.clock->sweep_scale : 1;
        for (int a = 0; a < D; ++a) {
            Sum& s = sum[(1 + a) * block_cells];
            if (m > T(0)) u[channels.residual + a] -= from_sum<T>(s, unit) / m;
            u[channels.result + a] += u[channels.residual + a];
            s = 0;
        }
        SweepMaxima<T, Sum, D>{node}.see(u + channels.residual, m, maxima);
    }
};

/// Boundaries once more where the velocity itself was swept, and the maxima that the clock decides
/// by.
template <class T, class Sum, int D>
struct FinishSweep {
    NodeUpdate<T, Sum, D> node;
    SweepChannels channels;
    MPM_INLINE void operator()(std::int64_t i, double (&maxima)[maxima_count]) const {
        if (node.clock->halt != Halt::none) return;
        const auto& g = node.grid;
        const std::int32_t slot = std::int32_t(i / block_cells);
        const int n = int(i % block_cells);
        const T m = node.mass(slot, n);
        if (!(m > T(0))) return;
        T* u = g.velocity + i * g.velocity_channels;
        Vec<T, D> v;
        for (int a = 0; a < D; ++a) v[a] = u[a];
        if (channels.result == 0 && channels.due(*node.clock) && node.touched[slot]) {
            std::int64_t c[D];
            node.cell(slot, n, c);
            apply_boundaries<true>(node.boundaries, c, v, NothingSeen{}, node.share(slot, n));
            for (int a = 0; a < D; ++a) u[a] = v[a];
        }
        for (int a = 0; a < D; ++a)
            UpdateGrid<T, Sum, D>::larger_of(maxima[max_speed], node.counts(v[a], m));
        if constexpr (std::is_integral_v<Sum>)
            UpdateGrid<T, Sum, D>::larger_of(maxima[max_mass], double(m));
    }
};

/// F-bar in its split form: the average of what `project_particle` made, after it has been added to
/// the groups' sums of `work`, which are cleared again.
template <class T, class Sum, int D>
struct AverageVolumes {
    NodeUpdate<T, Sum, D> node;
    Sum* work;
    const GroupChannels* groups;
    int group_count;
    MPM_INLINE void operator()(std::int64_t i) const {
        if (node.clock->halt != Halt::none) return;
        const auto& g = node.grid;
        const std::int32_t slot = std::int32_t(i / block_cells);
        const int n = int(i % block_cells);
        Sum* sum = work + std::int64_t(slot) * g.sum_channels * block_cells + n;
        const double unit = std::is_integral_v<Sum> ? 1 / node.clock->scale_write[group_sum] : 1;
        for (int k = 0; k < group_count; ++k) {
            const GroupChannels& c = groups[k];
            if (!c.split) continue;
            const T w = from_sum<T>(node.sums(slot, n)[(c.weight < 0 ? 0 : c.weight) * block_cells],
                                    node.clock->unit_read[mass_sum]);
            Sum& s = sum[c.sum * block_cells];
            g.velocity[i * g.velocity_channels + c.average] =
                w > T(0) ? from_sum<T>(s, unit) / w : T(0);
            s = 0;
        }
    }
};

}  // namespace mpm
