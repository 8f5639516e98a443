// Contact over all nodes where several fields meet, in the step (kernels/contact.hpp).
#pragma once

#include "mpm/kernels/contact.hpp"

namespace mpm {

/// Over the nodes of the blocks with several fields. Leaves velocities, what transfers that store
/// velocities keep, averages of what is stuck, and the maxima of what has changed.
template <class X, class T, class Sum, int D>
struct ContactPass {
    NodeContact<T, Sum, D> of;
    const GroupChannels* groups;
    int group_count;
    KeptChannels kept;
    std::uint32_t* crowded;  // raised where more fields meet than are kept apart

    using Fields = typename NodeContact<T, Sum, D>::Fields;

    /// Does contact change anything there? Of most nodes only one field has mass, and many fields
    /// part: devices gather the others, so that whole warps share the work.
    MPM_INLINE bool wanted(std::int64_t i) const {
        const std::int64_t block = i / block_cells;
        const int n = int(i % block_cells);
        if (!of.meet_at(of.contact.first[block], of.contact.count[block], n)) return false;
        Fields f;
        of.find(of.contact.first[block], of.contact.count[block], n, f);
        if (f.too_many || f.several) return true;
        of.begin_as_updated(n, f);
        return of.any_approach(n, f);
    }
    /// Does its node lie where lines towards walls may be followed? See exec/cuda_kernels.cuh.
    MPM_INLINE bool one_by_one(std::int64_t i) const {
        return of.on_lines(of.contact.first[i / block_cells]);
    }
    MPM_INLINE void operator()(std::int64_t i, double (&maxima)[maxima_count]) const {
        const auto& node = of.node;
        if (node.clock->halt != Halt::none) return;
        const std::int64_t block = i / block_cells;
        const int n = int(i % block_cells);
        Fields f;
        of.find(of.contact.first[block], of.contact.count[block], n, f);
        if (f.too_many) X::raise(crowded);
        if (f.count < 2 || f.too_many) return;
        if (f.several) {
            of.solve(n, f, NothingSeen{});
        } else {
            of.begin_as_updated(n, f);
            of.meet_all(n, f, NothingSeen{}, NothingSeen{});
        }
        for (int k = 0; k < f.count; ++k) {
            const int from = f.of[k];
            T* out = node.grid.velocity + node.grid.velocity_place(f.slot[k], n);
            for (int a = 0; a < D; ++a) {
                out[a] = f.velocity[from][a];
                UpdateGrid<T, Sum, D>::larger_of(maxima[max_speed],
                                                 node.counts(out[a], f.together[from]));
            }
            if (kept.guard >= 0 && (f.several || f.pushed[from]))
                out[kept.guard] = T(f.pushed[from] || f.held[from] ? 1 : 0);
        }
        if (f.several) average(n, f);
    }
    /// What the nodes of one field would hold, beside the velocity.
    MPM_INLINE void average(int n, const Fields& f) const {
        const auto& node = of.node;
        for (int i = 0; i < f.count; ++i) {
            if (f.of[i] != i) continue;
            const auto spread = [&](int channel, T value) {
                for (int k = i; k < f.count; ++k)
                    if (f.of[k] == i)
                        node.grid.velocity[node.grid.velocity_place(f.slot[k], n) + channel] =
                            value;
            };
            const auto sum = [&](int channel, int quantity) {
                T all = 0;
                for (int k = i; k < f.count; ++k)
                    if (f.of[k] == i)
                        all += from_sum<T>(node.sums(f.slot[k], n)[channel * block_cells],
                                           node.clock->unit_read[quantity]);
                return all;
            };
            for (int a = 0; a < D && kept.before >= 0; ++a)
                spread(kept.before + a, sum(kept.plain + a, momentum_sum) / f.together[i]);
            for (int g = 0; g < group_count; ++g) {
                const GroupChannels& c = groups[g];
                const T weight = sum(c.weight < 0 ? 0 : c.weight, mass_sum);
                spread(c.average, weight > T(0) ? sum(c.sum, group_sum) / weight : T(0));
            }
        }
    }
};

/// What one thread does after contact: as if the grid update had found its maxima, too.
template <class Decided>
struct AfterContact {
    Decided decided;
    const double* of_grid;
    const std::uint32_t* crowded;  // raised: more fields meet at a node than are kept apart
    Clock* clock;

    MPM_HD void operator()(const double* maxima) const {
        double all[maxima_count];
        for (int m = 0; m < maxima_count; ++m)
            all[m] = maxima[m] > of_grid[m] ? maxima[m] : of_grid[m];
        if (*crowded != 0 && clock->halt == Halt::none) {
            clock->halt = Halt::fault;
            clock->fault = FaultKind::crowded;
            clock->fault_value = most_fields_at_node;
        }
        decided(static_cast<const double*>(all));
    }
};

}  // namespace mpm
