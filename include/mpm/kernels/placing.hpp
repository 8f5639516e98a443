// From positions in metres to particles in cells, before the first step. Maps over particles in
// pieces, so that no more than a piece of what the caller gives is held at a time.
#pragma once

#include <limits>

#include "mpm/kernels/grid.hpp"
#include "mpm/kernels/sorting.hpp"

namespace mpm {

/// The fields of velocities of a body's particles: of those from an id on, until the next.
struct FieldsView {
    const std::uint64_t* first;  // (count,) ascending ids above the body's first, of which one is 0
    const std::int32_t* field;
    int count = 0;             // 0: all have the only field
    const std::uint32_t* ids;  // of the body's rows; null: the rows

    MPM_INLINE std::int64_t of(std::uint64_t row) const {
        if (count == 0) return 0;
        const std::uint64_t id = ids ? ids[row] : row;
        int low = 0, high = count;
        while (high - low > 1) {
            const int middle = (low + high) / 2;
            if (first[middle] <= id)
                low = middle;
            else
                high = middle;
        }
        return field[low];
    }
};

/// Cell of a position along each axis; false outside the domain and for what is not a number.
template <int D>
MPM_INLINE bool cell_of(const double* position, double cell_size, const std::int64_t (&cells)[D],
                        std::int64_t (&cell)[D]) {
    bool inside = true;
    for (int a = 0; a < D; ++a) {
        const double x = position[a] / cell_size, low = floor(x);
        inside = inside && x >= 0 && low < double(cells[a]);
        cell[a] = inside ? std::int64_t(low) : 0;
    }
    return inside;
}

/// Key of the block that each position lies in; positions outside are counted and the first is
/// kept.
template <class X, int D>
struct FindBlocks {
    const double* position;  // (n, D), m
    double cell_size;
    std::int64_t cells[D];
    BlockKeys<D> keys_of;
    std::uint64_t first;  // number of the first of these particles
    std::uint64_t* keys;
    std::uint32_t* outside;
    std::uint64_t* first_outside;
    FieldsView fields = {};

    MPM_INLINE void operator()(std::int64_t i) const {
        std::int64_t c[D];
        if (!cell_of<D>(position + i * D, cell_size, cells, c)) {
            X::fetch_add(outside, 1);
            X::keep_smallest(first_outside, first + std::uint64_t(i));
        }
        for (int a = 0; a < D; ++a) c[a] /= Block<D>::edge;
        keys[i] = keys_of.key(c, fields.of(first + std::uint64_t(i)));
    }
};

/// Offsets and cells of positions that lie in the table's blocks.
template <class T, int D>
struct PlaceParticles {
    const double* position;  // (n, D), m
    double cell_size;
    std::int64_t cells[D];
    BlockTableView<D> table;
    T* offset[D];
    std::uint32_t* cell;  // slot * 64 + cell
    std::uint32_t* id;
    std::uint32_t first;
    FieldsView fields = {};

    MPM_INLINE void operator()(std::int64_t i) const {
        std::int64_t c[D], block[D];
        int at[D];
        cell_of<D>(position + i * D, cell_size, cells, c);
        for (int a = 0; a < D; ++a) {
            block[a] = c[a] / Block<D>::edge;
            at[a] = int(c[a] % Block<D>::edge);
            // Sorting takes offsets for [-1/2, 1/2): what T rounds up to the next cell stays in its
            // own, just below the face, or it would be set back by a whole cell.
            const T xi = T(position[i * D + a] / cell_size - double(c[a]) - 0.5);
            offset[a][i] = xi < T(0.5) ? xi : T(0.5) - std::numeric_limits<T>::epsilon() / 4;
        }
        const std::int64_t field = fields.of(first + std::uint64_t(i));
        const std::int32_t slot =
            find_key(table.keys, table.slots, table.keys_of.key(block, field));
        cell[i] = std::uint32_t(slot) * block_cells + std::uint32_t(Block<D>::cell(at));
        id[i] = first + std::uint32_t(i);
    }
};

/// One number for all particles.
template <class T>
struct Constant {
    T value;
    T* to;
    MPM_INLINE void operator()(std::int64_t k) const { to[k] = value; }
};

/// Takes a stress of the phased step from the slope that the two-pass form deposits: first moments
/// of quadratic splines are the slope times 1/4.
template <class T>
struct AddStress {
    const T* stress;
    T* slope;
    MPM_INLINE void operator()(std::int64_t k) const { slope[k] -= T(4) * stress[k]; }
};

/// Most particles that any cell holds.
struct MostOfCell {
    const std::uint32_t* start;
    MPM_INLINE void operator()(std::int64_t c, double (&most)[1]) const {
        const double n = double(start[c + 1] - start[c]);
        if (n > most[0]) most[0] = n;
    }
};

template <class T, class Sum, int D>
struct LargestNodeMass {
    NodeUpdate<T, Sum, D> node;
    MPM_INLINE void operator()(std::int64_t i, double (&most)[1]) const {
        const double m = double(node.mass(std::int32_t(i / block_cells), int(i % block_cells)));
        if (m > most[0]) most[0] = m;
    }
};

/// Keeps what a reduction found.
struct Keep {
    double* to;
    MPM_HD void operator()(const double* found) const { *to = found[0]; }
};

}  // namespace mpm
