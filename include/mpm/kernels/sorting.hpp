// Sorting particles by cell and rebuilding the table of blocks. Runs when drift demands it, between
// two steps. All of it is maps over blocks, cells or particles, so both backends share the text.
#pragma once

#include "mpm/kernels/views.hpp"

namespace mpm {

/// Brings an offset back to [-1/2, 1/2) and says by how many cells it moved.
template <class T>
MPM_INLINE T wrap_offset(T x, int& shift) {
    shift = x < T(-0.5) ? -1 : (x < T(0.5) ? 0 : 1);
    x -= T(shift);
    if (!(x < T(0.5))) {  // rounding of the subtraction: the upper side belongs to the next cell
        x -= T(1);
        ++shift;
    }
    return x;
}

/// By how many cells along each axis a sort moves the home of a particle, at most two, in a byte:
/// 0 where it stays.
struct HomeMove {
    static constexpr int most = 2, digits = 2 * most + 1;
    template <int D>
    MPM_INLINE static std::uint8_t of(const int (&cells)[D]) {
        int code = 0;
        for (int a = D - 1; a >= 0; --a)
            code = code * digits + (cells[a] < 0 ? cells[a] + digits : cells[a]);
        return std::uint8_t(code);
    }
    MPM_INLINE static int along(std::uint8_t code, int axis) {
        int rest = code;
        for (int a = 0; a < axis; ++a) rest /= digits;
        rest %= digits;
        return rest > most ? rest - digits : rest;
    }
};

/// Per cell of the present table: in which cells are its particles to be sorted? Those where they
/// stand now, or, with `moves`, those where they will be half way to the next sort (`Decide`).
/// Changes no particle, so that a run may still be refused with its state intact. A particle has
/// moved by at most one cell and looks ahead by less than one, so its block is a neighbour.
template <class X, class T, int D>
struct FindCells {
    using Grid = typename X::template Grid<T>;
    BlockTableView<D> table;
    BodyView<T, D> body;
    std::int32_t cells[D];           // of the domain
    std::uint32_t* occupied;         // per present slot: by this body
    std::uint32_t* new_cell;         // per particle: present slot * 64 + cell, or `outside`
    std::uint32_t* left;             // count of particles outside the domain
    std::uint8_t* moves = nullptr;   // per particle: of its home; null: homes where particles are
    const Grid* velocity = nullptr;  // of the nodes of the present table
    int velocity_channels = 0;
    T time = 0, ahead = 0;  // cells per m/s looked ahead, and cells at most

    static constexpr std::uint32_t outside = ~0u;

    static constexpr int lanes = home_lanes<X>;

    MPM_INLINE void operator()(std::int64_t i) const {
        const std::int32_t slot = body.home[i / lanes];
        const std::int32_t* corner = table.corners + std::int64_t(slot) * D;
        for_each_of_lane<X>(body, slot, int(i % lanes),
                            [&](std::uint32_t p, int cell) { find(p, cell, slot, corner); });
    }

    MPM_INLINE void find(std::uint32_t p, int cell, std::int32_t slot,
                         const std::int32_t* corner) const {
        int home[D], at[D], shift[D];
        T xi[D];
        Block<D>::coordinates(cell, home);
        bool inside = true;
        MPM_UNROLL for (int a = 0; a < D; ++a) {
            xi[a] = wrap_offset(body.offset[a][p], shift[a]);
            at[a] = home[a] + shift[a];
            inside = inside && in_domain(corner, at[a], a);
        }
        if (!inside) {
            new_cell[p] = outside;
            X::fetch_add(left, 1);
            return;
        }
        std::uint32_t to = cell_at(slot, at);
        if (moves != nullptr) {
            // The node in the middle of the cell says how fast it goes.
            const Grid* v = velocity + std::int64_t(to) * velocity_channels;
            MPM_UNROLL for (int a = 0; a < D; ++a) {
                T way = time * T(v[a]);
                way = way < -ahead ? -ahead : (way > ahead ? ahead : way);
                int further;
                wrap_offset(xi[a] + way, further);
                // What stands so near a face that it will leave is at home before it.
                if (!in_domain(corner, at[a] + further, a) || shift[a] + further > HomeMove::most)
                    further = 0;
                at[a] += further;
                shift[a] += further;
            }
            moves[p] = HomeMove::of<D>(shift);
            to = cell_at(slot, at);
        }
        const std::uint32_t block = to / block_cells;
        if (!occupied[block]) X::raise(&occupied[block]);
        new_cell[p] = to;
    }

    MPM_INLINE bool in_domain(const std::int32_t* corner, int at, int axis) const {
        const std::int32_t global = corner[axis] + at;
        return global >= 0 && global < cells[axis];
    }
    /// slot * 64 + cell of what lies `at` cells from the first of a block.
    MPM_INLINE std::uint32_t cell_at(std::int32_t slot, const int (&at)[D]) const {
        int c[D], neighbour = 0;
        MPM_UNROLL for (int a = 0; a < D; ++a) {
            const int side = at[a] < 0 ? 0 : (at[a] < Block<D>::edge ? 1 : 2);
            neighbour = neighbour * 3 + side;
            c[a] = at[a] - (side - 1) * Block<D>::edge;
        }
        const std::int32_t to =
            table.neighbours[std::int64_t(slot) * Block<D>::neighbours + neighbour];
        return std::uint32_t(to) * block_cells + std::uint32_t(Block<D>::cell(c));
    }
};

/// Keys of the occupied blocks of a table.
struct ListKeys {
    const std::uint64_t* keys;
    const std::uint32_t* position;  // scan of `occupied`
    const std::uint32_t* occupied;
    std::uint64_t* out;
    MPM_INLINE void operator()(std::int64_t slot) const {
        if (occupied[slot]) out[position[slot]] = keys[slot];
    }
};

/// Candidates for a table: every home block and its neighbours.
template <int D>
struct ListNeighbours {
    BlockKeys<D> keys_of;
    const std::uint64_t* homes;
    std::uint64_t* out;  // (homes * 3^D)

    MPM_INLINE void operator()(std::int64_t i) const {
        int n = int(i % Block<D>::neighbours);
        std::int64_t b[D];
        const std::uint64_t home = homes[i / Block<D>::neighbours];
        keys_of.block(home, b);
        for (int a = D - 1; a >= 0; --a) {
            b[a] += n % 3 - 1;
            n /= 3;
        }
        out[i] = keys_of.key(b, keys_of.field(home));
    }
};

/// Neighbours of every slot of a new table, and the boundaries that may hold its nodes.
template <int D>
struct LinkBlocks {
    BlockTableView<D> table;
    std::int32_t* neighbours;
    std::int32_t* corners;

    MPM_INLINE void operator()(std::int64_t i) const {
        const std::int64_t slot = i / Block<D>::neighbours;
        int n = int(i % Block<D>::neighbours);
        std::int64_t b[D];
        table.keys_of.block(table.keys[slot], b);
        bool outside = false;
        if (n == 0) {
            for (int a = 0; a < D; ++a) corners[slot * D + a] = std::int32_t(b[a] * Block<D>::edge);
        }
        for (int a = D - 1; a >= 0; --a) {
            b[a] += n % 3 - 1;
            n /= 3;
            outside = outside || b[a] < -BlockKeys<D>::rim ||
                      b[a] + BlockKeys<D>::rim >= table.keys_of.counts[a];
        }
        const std::int64_t field = table.keys_of.field(table.keys[slot]);
        neighbours[i] =
            outside ? -1 : find_key(table.keys, table.slots, table.keys_of.key(b, field));
    }
};

/// 1 where a wall acts on the second node before it too.
MPM_INLINE int sees_next(const SurfaceLaw& law) {
    return mirrors(law.response) || law.linear ? 1 : 0;
}

template <int D>
struct TouchBoundaries {
    BlockTableView<D> table;
    const BoundaryRecord<D>* boundaries;
    int count;
    const SurfaceRecord<D>* surfaces;
    double cell_size;
    std::uint32_t* touched;

    MPM_INLINE void operator()(std::int64_t slot) const {
        std::int64_t b[D];
        table.keys_of.block(table.keys[slot], b);
        std::uint32_t hit = 0;
        for (int k = 0; k < count; ++k) {
            const BoundaryRecord<D>& r = boundaries[k];
            bool apart = false, rim = false;
            for (int a = 0; a < D; ++a) {
                const std::int64_t low = b[a] * Block<D>::edge,
                                   high = low + Block<D>::edge;  // cells [low, high)
                const int further = sees_next(r.law[2 * a]), beyond = sees_next(r.law[2 * a + 1]);
                apart = apart || high < r.lower[a] - further || low > r.upper[a] + beyond;
                rim = rim || (r.present[2 * a] && low <= r.lower[a] + further) ||
                      (r.present[2 * a + 1] && high >= r.upper[a] - beyond);
            }
            if (r.surface > 0)
                hit |= !apart && near(surfaces[r.surface - 1], b);
            else
                hit |= r.is_box ? !apart : rim;
        }
        touched[slot] = hit;
    }
    /// Whether a body at rest reaches nodes of a block; of one that moves its whole way counts.
    MPM_INLINE bool near(const SurfaceRecord<D>& s, const std::int64_t (&block)[D]) const {
        const double span = Block<D>::edge * cell_size;
        if (!s.at_rest() || s.field.per_metre * span > DistanceField<D>::edge) return true;
        // Its blocks are no smaller than these, so one of the outermost nodes lies in any that
        // matters, also where the edges of both coincide and rounding decides whose they are.
        for (int corner = 0; corner < (1 << D); ++corner) {
            double x[D], local[D];
            for (int a = 0; a < D; ++a)
                x[a] = double(block[a]) * span +
                       (corner >> a & 1 ? span - 0.5 * cell_size : 0.5 * cell_size);
            if (s.field.find(x, local) != DistanceField<D>::outside) return true;
        }
        return false;
    }
};

/// Slots of one table -> slots of another (-1 where the block is not in it).
struct MapSlots {
    const std::uint64_t* old_keys;
    const std::uint64_t* new_keys;
    std::int32_t new_slots;
    std::int32_t* map;
    MPM_INLINE void operator()(std::int64_t slot) const {
        map[slot] = find_key(new_keys, new_slots, old_keys[slot]);
    }
};

/// new_cell from the present table's numbering to the new one; particles outside, and those that go
/// to other ranks, sort behind everything.
struct RenumberCells {
    std::uint32_t* cell;
    const std::int32_t* map;  // null: the numbering stays
    std::uint32_t cells;      // of the present table
    std::uint32_t behind;
    MPM_INLINE void operator()(std::int64_t p) const {
        const std::uint32_t c = cell[p];
        if (c >= cells)
            cell[p] = behind;
        else if (map)
            cell[p] = std::uint32_t(map[c / block_cells]) * block_cells + c % block_cells;
    }
};

/// By how much a sort moves the homes of particles; of those behind the first `count` it knows that
/// they have come with offsets from their new ones.
struct HomeMoves {
    bool ahead;  // else every home is where its particle is
    const std::uint8_t* of;
    std::uint32_t count;

    /// An offset of particle p along an axis, from the cell into which it is sorted.
    template <class T>
    MPM_INLINE T from_home(T x, std::uint32_t p, int axis) const {
        if (!ahead) {
            int shift;
            return wrap_offset(x, shift);
        }
        return p < count ? x - T(HomeMove::along(of[p], axis)) : x;
    }
};

/// Particles into their new order, a few columns at a time: as many as there is spare room for.
template <class T>
struct Permute {
    static constexpr int most = 4;
    const std::uint32_t* order;
    const T* from[most];
    T* to[most];
    int columns;
    int offsets;  // of them, the first so many are offsets, of axes from `axis` on
    int axis;
    HomeMoves moves;
    MPM_INLINE void operator()(std::int64_t k) const {
        const std::uint32_t p = order[k];
        for (int c = 0; c < columns; ++c) {
            const T x = from[c][p];
            to[c][k] = c < offsets ? moves.from_home(x, p, axis + c) : x;
        }
    }
};
/// How many columns are permuted together: spare columns are cheap while they are small.
inline int permuted_together(std::uint64_t particles) {
    return particles <= (std::uint64_t(1) << 24) ? Permute<float>::most : 1;
}

/// Offsets of some particles, along one axis, from the cells into which they are sorted.
template <class T>
struct TakeOffsets {
    const std::uint32_t* index;
    const T* from;
    T* to;
    HomeMoves moves;
    int axis;
    MPM_INLINE void operator()(std::int64_t k) const {
        to[k] = moves.from_home(from[index[k]], index[k], axis);
    }
};

/// to[k] = from[index[k]].
template <class T>
struct Take {
    const std::uint32_t* index;
    const T* from;
    T* to;
    MPM_INLINE void operator()(std::int64_t k) const { to[k] = from[index[k]]; }
};

/// Is any occupied block new to the table's homes? Its neighbours may then be missing. `before`:
/// the blocks that were homes; with several devices those that may be.
template <class X>
struct FindNewHomes {
    const std::uint32_t* occupied;
    const std::uint32_t* before;
    std::uint32_t* found;
    MPM_INLINE void operator()(std::int64_t slot) const {
        if (occupied[slot] && !before[slot]) X::raise(found);
    }
};

struct FlagHomes {
    const std::uint32_t* cell_start;
    std::uint32_t* flag;
    MPM_INLINE void operator()(std::int64_t slot) const {
        flag[slot] = cell_start[(slot + 1) * block_cells] > cell_start[slot * block_cells];
    }
};
/// Adds the homes of a body to those of others.
struct JoinHomes {
    const std::uint32_t* flag;
    std::uint32_t* any;
    MPM_INLINE void operator()(std::int64_t slot) const {
        if (flag[slot]) any[slot] = 1;
    }
};
/// Devices: homes with many particles, and the particles of the others.
struct FlagFull {
    const std::uint32_t* cell_start;
    std::uint32_t least;
    std::uint32_t* full;
    std::uint32_t* lone;  // particles
    MPM_INLINE void operator()(std::int64_t slot) const {
        const std::uint32_t n =
            cell_start[(slot + 1) * block_cells] - cell_start[slot * block_cells];
        full[slot] = n >= least;
        lone[slot] = n >= least ? 0 : n;
    }
};
/// Full homes first, each kind ascending.
struct ListByKind {
    const std::uint32_t* cell_start;
    const std::uint32_t* position;       // scan of all homes
    const std::uint32_t* full_position;  // of the full ones
    const std::uint32_t* lone_position;  // of particles in the others
    std::uint32_t full_homes;
    std::int32_t* home;
    std::uint32_t* lone;
    std::int32_t* lone_slot;
    MPM_INLINE void operator()(std::int64_t slot) const {
        if (position[slot + 1] == position[slot]) return;
        if (full_position[slot + 1] != full_position[slot]) {
            home[full_position[slot]] = std::int32_t(slot);
            return;
        }
        home[full_homes + position[slot] - full_position[slot]] = std::int32_t(slot);
        const std::uint32_t begin = cell_start[slot * block_cells];
        const std::uint32_t at = lone_position[slot], n = lone_position[slot + 1] - at;
        for (std::uint32_t k = 0; k < n; ++k) {
            lone[at + k] = begin + k;
            lone_slot[at + k] = std::int32_t(slot);
        }
    }
};
/// Takes those from a list that another rank counts.
struct KeepCounted {
    const std::uint8_t* counts;
    std::uint32_t* flag;
    MPM_INLINE void operator()(std::int64_t slot) const {
        if (counts[slot] == 0) flag[slot] = 0;
    }
};
struct ListHomes {
    const std::uint32_t* flag;
    const std::uint32_t* position;
    std::int32_t* home;
    MPM_INLINE void operator()(std::int64_t slot) const {
        if (flag[slot]) home[position[slot]] = std::int32_t(slot);
    }
};

/// How far behind the first a home block comes when blocks are handed to a device: those that add
/// to blocks that another device holds too; then heavy ones, so that the last to finish are light.
struct WeighHomes {
    static constexpr int bits = 3;
    const std::int32_t* home;
    const std::uint32_t* cell_start;
    std::uint32_t mean;
    std::uint32_t* key;
    const std::int32_t* neighbours;  // (slots, sides)
    int sides;
    const std::uint8_t* shared;  // (slots,): others hold it too; null: this is the only device
    MPM_INLINE void operator()(std::int64_t h) const {
        const std::uint32_t* start = cell_start + std::int64_t(home[h]) * block_cells;
        const std::uint32_t weight = 4 * (start[block_cells] - start[0]) / mean;
        key[h] = weight < (1u << bits) ? (1u << bits) - 1 - weight : 0;
        if (shared == nullptr) return;
        bool beside = false;
        for (int n = 0; n < sides && !beside; ++n)
            beside = shared[neighbours[std::int64_t(home[h]) * sides + n]] != 0;
        key[h] = beside ? 0 : (key[h] > 0 ? key[h] : 1);
    }
};

/// Sums follow their blocks into the new table; blocks that are new start empty.
template <class Sum>
struct MoveSums {
    const Sum* from;
    Sum* to;
    const std::int32_t* old_slot;  // of each new slot
    int channels;
    MPM_INLINE void operator()(std::int64_t i) const {
        const std::int64_t slot = i / block_cells, old = old_slot[slot];
        Sum* out = to + slot * channels * block_cells + i % block_cells;
        if (old < 0) {
            for (int c = 0; c < channels; ++c) out[c * block_cells] = Sum(0);
            return;
        }
        const Sum* in = from + old * channels * block_cells + i % block_cells;
        for (int c = 0; c < channels; ++c) out[c * block_cells] = in[c * block_cells];
    }
};

}  // namespace mpm
