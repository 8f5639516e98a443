// Volumes of a fluid that are led by the density of the grid: J of its particles moves by a part of
// the excess around them, so that pressure holds apart what F-bar has let come too near.
// Derivation, measurements and what was tried: design/fbar.md, 4.
#pragma once

#include "mpm/kernels/excess.hpp"

namespace mpm {

/// What volumes take of the excess at a time, every tenth step, and what disorder makes of a mean
/// of nodes: it is not led away, or its noise, of which only what is too much counts, would lift
/// water above its volume.
inline constexpr double density_rate = 0.02, density_band = 0.03;

/// Mean excess of each node and those about it by weights 1, 2, 1 along each axis: at one node it
/// is noise of several per cent. What is missing leads nothing: free surfaces and slopes would look
/// like holes (led both ways, water over a slope of linear cells began to breathe).
template <class X, class T, int D>
struct FindPacked {
    BlockTableView<D> table;
    const Clock* clock;
    const T* excess;      // (slots, nodes)
    T* packed;            // (slots, nodes)
    std::uint32_t* some;  // (slots,), zero before: 1 where any node of the block is

    MPM_INLINE void operator()(std::int64_t i) const {
        if (clock->halt != Halt::none) return;
        constexpr int edge = Block<D>::edge, about = D == 2 ? 9 : 27;
        const std::int64_t slot = i / block_cells;
        packed[i] = 0;
        if (!(excess[i] > T(-1))) return;  // nothing is there, or walls leave too little of it
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
        if (!(by > 0)) return;
        packed[i] = T(by < 0.5 ? by : 0.5);
        X::raise(&some[slot]);
    }
};

/// Leads the volumes of the particles of a body's home blocks: items as those of
/// `NodesOfParticles`.
template <class G, class T, int D>
struct LeadVolumes {
    NodesOfParticles<G, T, D> packed;

    MPM_INLINE void operator()(std::int64_t i) const {
        packed.each(i, [&](std::uint32_t q, const auto& s, const auto& places, const auto& around) {
            G more = 0;
            for_each_node(s, places, [&](const auto&, int place, G weight) {
                const G* found = around(place);
                if (found != nullptr) more += weight * *found;
            });
            packed.body.state[0][q] += T(G(density_rate) * more);  // 1 - J
        });
    }
};

}  // namespace mpm
