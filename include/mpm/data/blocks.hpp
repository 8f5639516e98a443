// The sparse grid: blocks of 64 cells (4^3, or 8^2 in two dimensions) that hold particles, and
// their neighbours. A block's arena is the block and two nodes around it: what its particles reach
// while none stands more than one cell beside the cell it was sorted into.
#pragma once

#include <cmath>
#include <cstdint>

#include "mpm/core/config.hpp"

namespace mpm {

inline constexpr int block_cells = 64;

template <int D>
struct Block {
    static constexpr int edge = D == 2 ? 8 : 4;
    static constexpr int margin = 2;
    static constexpr int arena_edge = edge + 2 * margin;
    static constexpr int arena_nodes =
        D == 2 ? arena_edge * arena_edge : arena_edge * arena_edge * arena_edge;
    static constexpr int neighbours = D == 2 ? 9 : 27;

    /// Cell number inside a block, last axis fastest.
    MPM_INLINE static int cell(const int (&c)[D]) {
        int n = 0;
        MPM_UNROLL for (int a = 0; a < D; ++a) n = n * edge + c[a];
        return n;
    }
    MPM_INLINE static void coordinates(int cell, int (&c)[D]) {
        MPM_UNROLL for (int a = D - 1; a >= 0; --a) {
            c[a] = cell % edge;
            cell /= edge;
        }
    }
    MPM_INLINE static constexpr int arena_stride(int axis) {
        int s = 1;
        for (int a = D - 1; a > axis; --a) s *= arena_edge;
        return s;
    }
};

/// By how many cells a particle stands beside its home cell along one axis. Drift is limited to
/// one.
template <class T>
MPM_INLINE int cell_shift(T xi) {
    return xi < T(-0.5) ? -1 : (xi <= T(0.5) ? 0 : 1);
}

/// Number of a block in the domain, counted with a rim of `rim` blocks outside it, and of one of
/// the fields of velocities there (design/contact.md): those of a block follow each other. A scene
/// without contact has one.
template <int D>
struct BlockKeys {
    static constexpr int rim = 2;
    std::int64_t counts[D];   // blocks along each axis, rim included
    std::int64_t fields = 1;  // of velocities

    /// Do keys mean the same blocks and fields?
    bool same_as(const BlockKeys& other) const {
        bool same = fields == other.fields;
        for (int a = 0; a < D; ++a) same = same && counts[a] == other.counts[a];
        return same;
    }
    MPM_INLINE std::uint64_t key(const std::int64_t (&b)[D], std::int64_t field = 0) const {
        std::int64_t k = 0;
        MPM_UNROLL for (int a = 0; a < D; ++a) k = k * counts[a] + (b[a] + rim);
        return std::uint64_t(k * fields + field);
    }
    MPM_INLINE std::int64_t field(std::uint64_t key) const {
        return fields == 1 ? 0 : std::int64_t(key) % fields;
    }
    /// Of the slot of its block that is of field 0.
    MPM_INLINE std::uint64_t of_block(std::uint64_t key) const {
        return key - std::uint64_t(field(key));
    }
    /// Number n of the 3^D blocks around one, itself among them; whether it lies in the domain.
    MPM_INLINE bool beside(const std::int64_t (&at)[D], int n, std::int64_t (&b)[D]) const {
        bool inside = true;
        for (int a = D - 1; a >= 0; --a) {
            b[a] = at[a] + n % 3 - 1;
            n /= 3;
            inside = inside && b[a] >= -rim && b[a] < counts[a] - rim;
        }
        return inside;
    }
    /// Bits that the largest key needs.
    int bits() const {
        double blocks = double(fields);
        for (std::int64_t n : counts) blocks *= double(n);
        int b = 1;
        while (b < 64 && std::ldexp(1.0, b) < blocks) ++b;
        return b;
    }
    MPM_INLINE void block(std::uint64_t key, std::int64_t (&b)[D]) const {
        std::int64_t k = std::int64_t(key);
        if (fields != 1) k /= fields;
        MPM_UNROLL for (int a = D - 1; a >= 0; --a) {
            b[a] = k % counts[a] - rim;
            k /= counts[a];
        }
    }
};

template <int D>
struct BlockTableView {
    BlockKeys<D> keys_of;
    std::int32_t slots;
    const std::uint64_t* keys;       // (slots,) ascending
    const std::int32_t* corners;     // (slots, D): first cell of each block
    const std::int32_t* neighbours;  // (slots, 3^D): slot or -1; own slot in the middle

    /// The cell of a slot's node.
    MPM_INLINE void cell(std::int32_t slot, int node, std::int64_t (&c)[D]) const {
        int at[D];
        Block<D>::coordinates(node, at);
        for (int a = 0; a < D; ++a) c[a] = corners[std::int64_t(slot) * D + a] + at[a];
    }
};

/// Slot of a key in an ascending table, or -1.
MPM_INLINE std::int32_t find_key(const std::uint64_t* keys, std::int32_t count, std::uint64_t key) {
    std::int32_t low = 0, high = count;
    while (low < high) {
        const std::int32_t middle = (low + high) / 2;
        if (keys[middle] < key)
            low = middle + 1;
        else
            high = middle;
    }
    return low < count && keys[low] == key ? low : -1;
}

/// Slot of a block and field, or -1 where it is not active.
template <int D>
MPM_INLINE std::int32_t find_block(const BlockTableView<D>& table, const std::int64_t (&block)[D],
                                   std::int64_t field = 0) {
    for (int a = 0; a < D; ++a) {
        if (block[a] < -BlockKeys<D>::rim ||
            block[a] + BlockKeys<D>::rim >= table.keys_of.counts[a])
            return -1;
    }
    return find_key(table.keys, table.slots, table.keys_of.key(block, field));
}

/// The block that owns the node of a cell; returns the node's number there.
template <int D>
MPM_INLINE int block_of_node(const std::int64_t (&cell)[D], std::int64_t (&block)[D]) {
    int at[D];
    for (int a = 0; a < D; ++a) {
        const std::int64_t c = cell[a];
        block[a] = c >= 0 ? c / Block<D>::edge : -((-c + Block<D>::edge - 1) / Block<D>::edge);
        at[a] = int(c - block[a] * Block<D>::edge);
    }
    return Block<D>::cell(at);
}

/// Slot of the block that owns the node of a cell, or -1, and the node's number there.
template <int D>
MPM_INLINE std::int32_t find_node(const BlockTableView<D>& table, const std::int64_t (&cell)[D],
                                  int& node) {
    std::int64_t block[D];
    node = block_of_node<D>(cell, block);
    return find_block<D>(table, block);
}

/// f(slot, node) for each field that has nodes in the block of a cell.
template <int D, class F>
MPM_INLINE void each_field_of_node(const BlockTableView<D>& table, const std::int64_t (&cell)[D],
                                   const F& f) {
    std::int64_t block[D];
    const int node = block_of_node<D>(cell, block);
    if (table.keys_of.fields == 1) {
        const std::int32_t slot = find_block<D>(table, block);
        if (slot >= 0) f(slot, node);
        return;
    }
    for (int a = 0; a < D; ++a) {
        if (block[a] < -BlockKeys<D>::rim ||
            block[a] + BlockKeys<D>::rim >= table.keys_of.counts[a])
            return;
    }
    const std::uint64_t low = table.keys_of.key(block);
    std::int32_t first = 0, last = table.slots;
    while (first < last) {
        const std::int32_t middle = (first + last) / 2;
        if (table.keys[middle] < low)
            first = middle + 1;
        else
            last = middle;
    }
    for (; first < table.slots && table.keys[first] < low + std::uint64_t(table.keys_of.fields);
         ++first)
        f(first, node);
}

/// A node of a block's arena seen from the block: slot of the block that owns it (or -1) and its
/// node number there.
template <int D, int margin = Block<D>::margin>
MPM_INLINE void arena_node(const int (&at)[D], int& neighbour, int& node) {
    neighbour = 0;
    node = 0;
    MPM_UNROLL for (int a = 0; a < D; ++a) {
        const int n = at[a] - margin + Block<D>::edge;  // in [edge - margin, 2 edge + margin)
        neighbour = neighbour * 3 + n / Block<D>::edge;
        node = node * Block<D>::edge + n % Block<D>::edge;
    }
}

}  // namespace mpm
