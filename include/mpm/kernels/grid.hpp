// The grid half of a step: sums -> velocities, gravity, boundaries (Bonus 2023, section 4.10).
#pragma once

#include "mpm/kernels/views.hpp"

namespace mpm {

/// Below this share of the lightest particle's mass a node does not move: its weight in any
/// particle's velocity is smaller still, and in single precision its quotient momentum / mass would
/// be noise. What such nodes hold is lost, so the share lies below the rounding of the sums around
/// it.
template <class T>
inline constexpr double negligible_mass = sizeof(T) == 4 ? 1e-10 : 1e-18;
/// With fixed-point sums, the least number of quanta for the same reason.
inline constexpr int least_quanta = 16;

/// What the boundaries leave of a node's velocity. `seen(boundary, face, before, after)` hears of
/// every response.
template <class T, int D, class Seen>
MPM_INLINE void apply_boundaries(const BoundaryRecord<D>* boundaries, int count,
                                 const std::int64_t (&cell)[D], Vec<T, D>& v, const Seen& seen) {
    for (int b = 0; b < count; ++b) {
        const BoundaryRecord<D>& r = boundaries[b];
        if (!r.active) continue;
        Vec<T, D> wall;
        for (int a = 0; a < D; ++a) wall[a] = T(r.velocity[a]);
        if (!r.is_box) {
            // The wall of face x- lies at the lower side of cell 0: nodes 0 and beyond it are held.
            for (int face = 0; face < 2 * D; ++face) {
                const int a = face / 2;
                const bool held = face % 2 == 0 ? cell[a] <= r.lower[a] : cell[a] >= r.upper[a] - 1;
                if (!r.present[face] || !held) continue;
                const Vec<T, D> before = v;
                v = respond(r.law[face], a, face % 2 == 0 ? T(1) : T(-1), before, wall);
                seen(b, face, before, v);
            }
            continue;
        }
        // A box holds its inside by its nearest faces and the one layer of cells before each face.
        // Cells that touch it only by an edge or a corner stay free: holding them too would choke
        // gaps beside the box (design/walls.md).
        std::int64_t depth[2 * D], least = 0;
        int outside = 0;
        for (int a = 0; a < D; ++a) {
            depth[2 * a] = cell[a] - r.lower[a];
            depth[2 * a + 1] = r.upper[a] - 1 - cell[a];
            const std::int64_t nearest =
                depth[2 * a] < depth[2 * a + 1] ? depth[2 * a] : depth[2 * a + 1];
            outside += nearest < -1 ? 2 : (nearest < 0 ? 1 : 0);
            if (a == 0 || nearest < least) least = nearest;
        }
        if (outside > 1) continue;
        // Inside, all faces at the least depth: with one alone, particles would slide in along the
        // diagonals.
        for (int f = 0; f < 2 * D; ++f) {
            if (depth[f] != least) continue;
            const Vec<T, D> before = v;
            v = respond(r.law[f], f / 2, f % 2 == 0 ? T(-1) : T(1), before, wall);
            seen(b, f, before, v);
        }
    }
}

struct NothingSeen {
    template <class... A>
    MPM_INLINE void operator()(const A&...) const {}
};

/// One node: from sums to the velocity with which the coming step moves particles.
template <class T, class Sum, int D>
struct NodeUpdate {
    GridView<T, Sum, D> grid;
    const Clock* clock;
    const BoundaryRecord<D>* boundaries;
    int boundary_count;
    const std::uint32_t* touched;  // per slot: may a boundary hold nodes of it
    double least_mass;             // of a particle, kg

    MPM_INLINE const Sum* sums(std::int32_t slot, int node) const {
        return grid.sums + std::int64_t(slot) * grid.sum_channels * block_cells + node;
    }
    MPM_INLINE T mass(Sum sum) const {
        if constexpr (std::is_integral_v<Sum>) {
            if (sum < least_quanta) return 0;
        }
        const T m = from_sum<T>(sum, clock->unit_read[mass_sum]);
        return m > T(negligible_mass<T> * least_mass) ? m : T(0);
    }
    MPM_INLINE T mass(std::int32_t slot, int node) const { return mass(sums(slot, node)[0]); }
    MPM_INLINE void cell(std::int32_t slot, int node, std::int64_t (&c)[D]) const {
        int at[D];
        Block<D>::coordinates(node, at);
        for (int a = 0; a < D; ++a) c[a] = grid.table.corners[std::int64_t(slot) * D + a] + at[a];
    }
    MPM_INLINE Vec<Sum, D> momentum(std::int32_t slot, int node) const {
        const Sum* s = sums(slot, node);
        Vec<Sum, D> p;
        for (int a = 0; a < D; ++a) p[a] = s[(1 + a) * block_cells];
        return p;
    }
    template <class Seen>
    MPM_INLINE Vec<T, D> velocity(std::int32_t slot, int node, T m, const Vec<Sum, D>& p,
                                  const Seen& seen) const {
        Vec<T, D> v;
        const T inverse = T(1) / m;
        for (int a = 0; a < D; ++a) {
            v[a] = from_sum<T>(p[a], clock->unit_read[momentum_sum]) * inverse +
                   T(clock->dt * clock->gravity[a]);
        }
        if (touched[slot]) {
            std::int64_t c[D];
            cell(slot, node, c);
            apply_boundaries<T, D>(boundaries, boundary_count, c, v, seen);
        }
        return v;
    }
};

/// Where schemes that store velocities find more at a node (kernels/phase.hpp); -1: absent.
struct KeptChannels {
    int plain = -1;   // sums: D, momentum without stress
    int before = -1;  // velocities: D, of that momentum alone
    int guard = -1;   // 1: a boundary changed the velocity
    // With forces from gradients of shapes the lightest nodes are fast without bound, while their
    // weight in any particle's velocity is at most their mass over the particle's.
    bool by_weight = false;
    template <class T>
    MPM_INLINE double counts(T speed, T mass, double least_mass) const {
        const double share = by_weight ? double(mass) / least_mass : 1.0;
        return absolute(double(speed)) * (share < 1 ? share : 1.0);
    }
};

/// Hears whether any boundary has changed a velocity.
template <class T, int D>
struct Changed {
    bool* changed;
    MPM_INLINE void operator()(int, int, const Vec<T, D>& before, const Vec<T, D>& after) const {
        for (int a = 0; a < D; ++a) *changed = *changed || before[a] != after[a];
    }
};

/// Over all nodes of all blocks. Leaves velocities and averages, clears the sums that the step will
/// fill, and gathers the maxima that the clock decides by. `keeps`: also what `KeptChannels` names.
template <class T, class Sum, int D, bool keeps = false>
struct UpdateGrid {
    NodeUpdate<T, Sum, D> node;
    Sum* next;  // sums to clear
    const GroupChannels* groups;
    int group_count;
    GroupChannels only;  // the group if there is one alone
    KeptChannels kept = {};

    MPM_INLINE void operator()(std::int64_t i, double (&maxima)[maxima_count]) const {
        const auto& g = node.grid;
        if (node.clock->halt != Halt::none) return;
        const std::int32_t slot = std::int32_t(i / block_cells);
        const int n = int(i % block_cells);
        T* out = g.velocity + g.velocity_place(slot, n);
        // All reads first, none waits for another: most nodes carry mass.
        const Sum* s = node.sums(slot, n);
        const Sum mass = s[0];
        const Vec<Sum, D> p = node.momentum(slot, n);
        // With one group the node's velocities and its average are stored in one piece.
        const bool in_one = D == 3 && group_count == 1;
        Sum of_group = 0, of_weight = 0;
        if (in_one) of_group = s[only.sum * block_cells];
        if (in_one && only.weight >= 0) of_weight = s[only.weight * block_cells];

        Sum* clear = next + std::int64_t(slot) * g.sum_channels * block_cells + n;
        for (int c = 0; c < g.sum_channels; ++c) clear[c * block_cells] = 0;
        const T m = node.mass(mass);
        Vec<T, D> v{};
        if (m > T(0)) {
            if constexpr (keeps) {
                bool changed = false;
                v = node.velocity(slot, n, m, p, Changed<T, D>{&changed});
                if (kept.guard >= 0) out[kept.guard] = T(changed ? 1 : 0);
            } else {
                v = node.velocity(slot, n, m, p, NothingSeen{});
            }
            for (int a = 0; a < D; ++a) {
                if constexpr (keeps)
                    larger_of(maxima[max_speed], kept.counts(v[a], m, node.least_mass));
                else
                    larger_of(maxima[max_speed], absolute(double(v[a])));
            }
            if constexpr (std::is_integral_v<Sum>) larger_of(maxima[max_mass], double(m));
        }
        if constexpr (keeps) {
            for (int a = 0; a < D && kept.before >= 0; ++a) {
                out[kept.before + a] = m > T(0) ? from_sum<T>(s[(kept.plain + a) * block_cells],
                                                              node.clock->unit_read[momentum_sum]) /
                                                      m
                                                : T(0);
            }
            if (!(m > T(0)) && kept.guard >= 0) out[kept.guard] = T(0);
        }
        if constexpr (D == 3) {
            if (in_one) {
                struct alignas(16) Piece {
                    T e[4];
                };
                *reinterpret_cast<Piece*>(out) = {
                    {v[0], v[1], v[2],
                     m > T(0) ? average(of_group, only.weight >= 0 ? of_weight : mass) : T(0)}};
                return;
            }
        }
        for (int a = 0; a < D; ++a) out[a] = v[a];
        for (int k = 0; k < group_count; ++k) {
            const GroupChannels& c = groups[k];
            out[c.average] = m > T(0) ? average(s[c.sum * block_cells],
                                                s[(c.weight < 0 ? 0 : c.weight) * block_cells])
                                      : T(0);
        }
    }
    MPM_INLINE T average(Sum sum, Sum weight) const {
        const T w = from_sum<T>(weight, node.clock->unit_read[mass_sum]);
        return w > T(0) ? from_sum<T>(sum, node.clock->unit_read[group_sum]) / w : T(0);
    }
    // Not-a-number counts as infinite: nothing that is wrong may pass for slow.
    MPM_INLINE static void larger_of(double& to, double x) {
        if (!(x <= to)) to = x == x ? x : 1e300;
    }
};

}  // namespace mpm
