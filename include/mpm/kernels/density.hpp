// Volumes of a fluid that are led by the density of the grid: J of its particles moves by a part of
// the excess around them, so that pressure holds apart what F-bar has let come too near.
// Derivation, measurements and what was tried: design/fbar.md, 4.
#pragma once

#include "mpm/kernels/excess.hpp"

namespace mpm {

/// What volumes take of the excess at a time, every tenth step, and what disorder makes of a mean
/// of nodes: it is not led away, or its noise, of which only what is too much counts, would lift
/// water above its volume.
inline constexpr double density_rate = 0.02, density_band = 0.02;

/// Mean excess of each node and those about it by weights 1, 2, 1 along each axis: at one node it
/// is noise of several per cent. Beside a surface of the fluid, where a mean sees what is missing,
/// only what is too much.
template <class T, int D>
struct FindPacked {
    BlockTableView<D> table;
    const Clock* clock;
    const T* excess;  // (slots, nodes)
    T* packed;        // (slots, nodes)

    MPM_INLINE void operator()(std::int64_t i) const {
        if (clock->halt != Halt::none) return;
        constexpr int edge = Block<D>::edge, about = D == 2 ? 9 : 27;
        const std::int64_t slot = i / block_cells;
        packed[i] = 0;
        if (!(excess[i] == excess[i])) return;
        int own[D];
        Block<D>::coordinates(int(i % block_cells), own);
        double sum = 0, weights = 0;
        for (int k = 0; k < about; ++k) {
            int at[D], block = 0, rest = k;
            double weight = 1;
            for (int a = D - 1; a >= 0; --a, rest /= 3) {
                at[a] = own[a] + rest % 3 - 1;
                weight *= rest % 3 == 1 ? 2 : 1;
            }
            for (int a = 0; a < D; ++a) {
                const int by = at[a] < 0 ? 0 : (at[a] < edge ? 1 : 2);
                at[a] -= (by - 1) * edge;
                block = block * 3 + by;
            }
            const std::int32_t of = table.neighbours[slot * Block<D>::neighbours + block];
            // Blocks that are not there are empty; what walls leave too little of has no say.
            const double value =
                of < 0 ? -1.0 : double(excess[std::int64_t(of) * block_cells + Block<D>::cell(at)]);
            if (!(value == value)) continue;
            sum += weight * value;
            weights += weight;
        }
        const double by = sum / weights - density_band;
        packed[i] = T(by < 0 ? 0 : (by < 0.5 ? by : 0.5));
    }
};

/// Leads the volumes of the particles of a body's home blocks, a thread for each cell of a block
/// (on devices for each 64th particle).
template <class G, class T, int D>
struct LeadVolumes {
    BlockTableView<D> table;
    const Clock* clock;
    BodyView<T, D> body;
    const G* packed;

    MPM_INLINE void operator()(std::int64_t i) const {
        if (clock->halt != Halt::none) return;
        each_of_cell(body, i,
                     [&](std::int32_t slot, int cell, std::uint32_t q) { lead(slot, cell, q); });
    }
    MPM_INLINE void lead(std::int32_t slot, int cell, std::uint32_t q) const {
        const NodesAround<G> around{packed, 1,
                                    table.neighbours + std::int64_t(slot) * Block<D>::neighbours};
        int home[D];
        Block<D>::coordinates(cell, home);
        Vec<T, D> offset;
        for (int a = 0; a < D; ++a) offset[a] = body.offset[a][q];
        Standing<G, D> at;
        at.find(table.corners + std::int64_t(slot) * D, home, offset);
        const Stencil<G, D, 3> s = stencil_of<3>(KernelChoice{}, at.xi, Vec<G, D>{}, at.in_domain);
        G more = 0;
        for_each_node(s, places_in_grid<3>(at.cell), [&](const auto&, int place, G weight) {
            const G* e = around(place);
            if (e != nullptr) more += weight * *e;
        });
        body.state[0][q] += T(G(density_rate) * more);  // 1 - J
    }
};

}  // namespace mpm
