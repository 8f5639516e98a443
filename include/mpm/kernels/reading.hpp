// The velocity of a particle and of a point, as every reader sees it: attributes, columns for other
// libraries, trackers, probes. In double, and never part of a step.
#pragma once

#include "mpm/kernels/transfers.hpp"

namespace mpm {

/// The functions of a scene, as `stencil_of`, for readers.
template <int W, int D>
MPM_CALL Stencil<double, D, W> functions_at(const KernelChoice& kernel, const Vec<double, D>& xi,
                                            const Vec<double, D>& half,
                                            const std::int64_t (&cell)[D]) {
    const Reconverge at_return;
    return stencil_of<W>(kernel, xi, half, cell);
}

/// Calls f(functions) with those of a particle; `state(r)` is number r of what it stores, `wide`
/// says that the kernel reaches five nodes along an axis. Devices have no particles that are
/// parallelepipeds and no dual domains.
template <bool device, int D, class State, class F>
MPM_INLINE void with_functions(const PhaseNumbers& n, bool wide, const Standing<double, D>& at,
                               const State& state, const F& f) {
    if constexpr (!device) {
        if (n.edges >= 0) {
            CornerStencil<double, D> s;
            s.find(at.xi, half_edges_at<D>(n, state));
            f(s);
            return;
        }
    }
    Vec<double, D> half;
    MPM_UNROLL for (int a = 0; a < D; ++a) half[a] =
        n.kernel.half_edge * (n.extent >= 0 ? 1 + state(n.extent + a) : 1.0);
    if constexpr (!device) {
        if (n.kernel.kernel == Kernel::ddmp) {
            DualStencil<double, D> s;
            static_cast<Stencil<double, D, 5>&>(s) =
                functions_at<5, D>(n.kernel, at.xi, half, at.in_domain);
            s.find(at.xi);
            f(s);
            return;
        }
    }
    if (wide) {
        auto s = functions_at<5, D>(n.kernel, at.xi, half, at.in_domain);
        f(s);
    } else {
        auto s = functions_at<3, D>(n.kernel, at.xi, half, at.in_domain);
        f(s);
    }
}

/// Nodal velocities by places around a home block.
template <class Grid>
struct NodesAround {
    const Grid* velocity;
    int channels;
    const std::int32_t* neighbours;  // of the home block, by number among the 3^D
    MPM_INLINE const Grid* operator()(int place) const {
        const std::int32_t slot = neighbours[place >> 8];
        if (slot < 0) return nullptr;
        return velocity + (std::int64_t(slot) * block_cells + (place & 255)) * channels;
    }
};

/// The numbers that particle q stores, by column.
template <class T>
struct StoredNumbers {
    const T* const* column;
    std::size_t q;
    MPM_INLINE double operator()(int r) const { return double(column[r][q]); }
};

/// A particle's velocity, m/s: the one that it stores where its transfer makes it store one, else
/// what the grid gives it. `node(place)` points at the velocity of a node around its home block
/// (`places_in_grid`), or at nothing.
template <bool device, int D, class State, class Node>
MPM_HOST_CALL void particle_velocity(const PhaseNumbers& n, bool wide,
                                     const Standing<double, D>& at, const State& state,
                                     const Node& node, double (&v)[D]) {
    if (n.velocity >= 0) {
        for (int a = 0; a < D; ++a) v[a] = state(n.velocity + a);
        return;
    }
    for (int a = 0; a < D; ++a) v[a] = 0;
    with_functions<device, D>(n, wide, at, state, [&](auto& s) {
        constexpr int W = std::remove_reference_t<decltype(s)>::width;
        for_each_node(s, places_in_grid<W>(at.cell), [&](const auto&, int place, double w) {
            const auto* u = node(place);
            if (u == nullptr) return;
            for (int a = 0; a < D; ++a) v[a] += w * double(u[a]);
        });
    });
}

/// Whether nodes around a home block carry mass: where a kernel's gradients ask for it.
template <class Sum>
struct HasMass {
    const Sum* sums;  // by block, channel, node; mass is the first
    int channels;
    const std::int32_t* neighbours;  // of the home block, by number among the 3^D
    MPM_INLINE bool operator()(int place) const {
        const std::int32_t slot = neighbours[place >> 8];
        return slot >= 0 &&
               sums[std::int64_t(slot) * channels * block_cells + (place & 255)] > Sum(0);
    }
};

/// Velocity gradient (1/s) at a particle, as its material sees it, added to `rate`. `node` as of
/// `particle_velocity`, `has_mass(place)` as `HasMass`.
template <bool device, int D, class State, class Node, class Masses>
MPM_HOST_CALL void particle_rate(const PhaseNumbers& n, bool wide, const Standing<double, D>& at,
                                 const State& state, const Node& node, const Masses& has_mass,
                                 double cell_size, double (&rate)[D][D]) {
    const bool shapes = n.kernel.gradient == GradientForm::shapes;
    with_functions<device, D>(n, wide, at, state, [&](auto& s) {
        using S = std::remove_reference_t<decltype(s)>;
        const Places<D, S::width> places = places_in_grid<S::width>(at.cell);
        if constexpr (std::is_same_v<S, DualStencil<double, D>>) {
            s.find_gradients([&](const DualNode<D>& of) {
                int place = 0;
                for (int a = 0; a < D; ++a) place += places.part[a][of[a]];
                return has_mass(place);
            });
        }
        for_each_node(s, places, [&](const auto& k, int place, double w) {
            const auto* u = node(place);
            if (u == nullptr) return;
            for (int a = 0; a < D; ++a)
                for (int b = 0; b < D; ++b)
                    rate[a][b] += node_along(s, k, w, b, shapes) / cell_size * double(u[a]);
        });
    });
}

/// What a point sees of a scene's functions: its splines, and of functions that average over a
/// particle's domain those that they average, for a point has no domain.
inline KernelChoice functions_of_point(const KernelChoice& kernel) {
    KernelChoice out = kernel;
    out.modified = false;
    if (out.kernel != Kernel::quadratic && out.kernel != Kernel::cubic) out.kernel = Kernel::linear;
    return out;
}

/// Velocity at a point from the nodes around it that carry mass, by their share of its functions;
/// false where none does. `node(c)` points at the velocity of the node of cell c, or at nothing.
template <int W, int D, class Node>
MPM_INLINE bool point_velocity(const KernelChoice& kernel, const double (&cells)[D],
                               const Node& node, double (&v)[D]) {
    std::int64_t cell[D];
    Vec<double, D> xi, half{};
    for (int a = 0; a < D; ++a) {
        cell[a] = std::int64_t(floor(cells[a]));
        xi[a] = cells[a] - double(cell[a]) - 0.5;
        v[a] = 0;
    }
    const Stencil<double, D, W> s = functions_at<W, D>(kernel, xi, half, cell);
    constexpr int nodes = D == 2 ? W * W : W * W * W;
    double total = 0;
    for (int n = 0; n < nodes; ++n) {
        std::int64_t c[D];
        double weight = 1;
        for (int a = D - 1, rest = n; a >= 0; --a, rest /= W) {
            c[a] = cell[a] + rest % W - W / 2;
            weight *= s.weight[a][rest % W];
        }
        if (weight == 0) continue;
        const auto* u = node(c);
        if (u == nullptr) continue;
        for (int a = 0; a < D; ++a) v[a] += weight * double(u[a]);
        total += weight;
    }
    if (!(total > 1e-6)) return false;
    for (int a = 0; a < D; ++a) v[a] /= total;
    return true;
}

/// Rows of chosen blocks, one behind the other: `width` of the `stride` values that a slot has.
template <class V>
struct TakeBlocks {
    const std::int32_t* slots;
    const V* from;
    std::int64_t stride, width;
    V* to;

    MPM_INLINE void operator()(std::int64_t i) const {
        to[i] = from[slots[i / width] * stride + i % width];
    }
};

/// What the particles of chosen home blocks store, block behind block; `lanes` workers share one.
template <class T, int D>
struct TakeParticles {
    static constexpr int lanes = 32;

    BodyView<T, D> body;
    const std::int32_t* slots;
    const std::uint32_t* row;  // of the first particle of each block
    int columns;               // of state
    std::int64_t count;
    T* to;  // (D + columns, count): offsets, then state
    std::uint32_t* id;
    std::uint8_t* cell;  // null where they are stored cell by cell

    MPM_INLINE void operator()(std::int64_t i) const {
        const std::uint32_t* start = body.cell_start + std::int64_t(slots[i / lanes]) * block_cells;
        for (std::uint32_t q = start[0] + std::uint32_t(i % lanes); q < start[block_cells];
             q += lanes) {
            const std::int64_t k = std::int64_t(row[i / lanes]) + (q - start[0]);
            for (int a = 0; a < D; ++a) to[a * count + k] = body.offset[a][q];
            for (int r = 0; r < columns; ++r) to[(D + r) * count + k] = body.state[r][q];
            id[k] = body.id[q];
            if (cell) cell[k] = std::uint8_t(body.home_cell(q));
        }
    }
};

}  // namespace mpm
