// What readers look at: host copies of one body's particles and of the nodes about them, of all or
// of those in a window. Looking never changes a run.
#pragma once

#include <numeric>
#include <vector>

#include "mpm/data/blocks.hpp"
#include "mpm/exec/buffer.hpp"
#include "mpm/kernels/reading.hpp"
#include "mpm/solver/block_table.hpp"
#include "mpm/solver/body_store.hpp"
#include "mpm/solver/engine.hpp"

namespace mpm {

/// Places in `keys` of the blocks of which a window touches a cell, or one of the `more` beside it.
template <int D>
std::vector<std::int32_t> blocks_in(const Window& window, const BlockKeys<D>& keys_of,
                                    const std::vector<std::uint64_t>& keys, double cell_size,
                                    int more) {
    std::vector<std::int32_t> out;
    const std::size_t boxes = window.low.size() / D;
    for (std::size_t k = 0; k < keys.size(); ++k) {
        std::int64_t block[D];
        keys_of.block(keys[k], block);
        bool touched = window.everywhere();
        for (std::size_t box = 0; box < boxes && !touched; ++box) {
            touched = true;
            for (int a = 0; a < D && touched; ++a) {
                const double low = double(block[a] * Block<D>::edge - more) * cell_size;
                const double high = double((block[a] + 1) * Block<D>::edge + more) * cell_size;
                touched = window.low[box * D + a] <= high && low <= window.high[box * D + a];
            }
        }
        if (touched) out.push_back(std::int32_t(k));
    }
    return out;
}

/// Of slots, the first `width` of the `stride` values that each has, one slot behind the other.
template <class B, class V>
std::vector<V> rows_of(B& exec, const BufferOf<B, V>& from, const BufferOf<B, std::int32_t>& slots,
                       std::size_t stride, std::size_t width) {
    BufferOf<B, V> to(exec);
    const std::size_t n = slots.size() * width;
    to.reserve_discard(n);
    exec.for_each(std::int64_t(n), TakeBlocks<V>{slots.data(), from.data(), std::int64_t(stride),
                                                 std::int64_t(width), to.data()});
    return to.host();
}

/// A body's particles on the host: rows counted over those that were taken, blocks over the blocks
/// that were. The slots whose nodal values go with them are `nodes`, in the order of their rows.
template <class T, int D>
struct ParticleSnapshot {
    std::size_t count = 0;
    std::vector<std::uint32_t> id;  // counted from the body's first
    std::vector<std::vector<T>> offset, state;
    std::vector<std::uint8_t> cell;  // home cells in their blocks; empty: stored cell by cell
    std::vector<std::int32_t> home;  // blocks with particles
    std::vector<std::uint64_t> keys;
    std::vector<std::uint32_t> start;        // of the cells of a block
    std::size_t start_stride = block_cells;  // from one block to the next in `start`
    std::vector<std::int32_t> neighbours;    // (blocks, 3^D): row of nodal values, -1: none
    std::vector<std::int32_t> nodes;         // empty: all slots

    const std::uint32_t* starts(std::int32_t h) const {
        return start.data() + std::size_t(h) * start_stride;
    }
    HomeCells homes(std::int32_t h) const {
        return {starts(h), cell.empty() ? nullptr : cell.data()};
    }
    const std::int32_t* around(std::int32_t h) const {
        return neighbours.data() + std::size_t(h) * Block<D>::neighbours;
    }
};

/// Slots of nodes with their sums, rows of the other lists.
template <class Sum>
struct NodesSeen {
    std::vector<std::int32_t> slots;
    std::vector<std::uint64_t> keys;
    std::vector<Sum> sums;  // (slots, channels, nodes of a block)
};

/// A particle is stored by the cell in which the last sort found it, and is less than this many
/// cells outside of it (`drift_limit` of the executors).
inline constexpr int most_drift = 1;

/// Does a point lie in a box of a window?
template <int D>
bool lies_in(const Window& window, const double (&x)[D]) {
    for (std::size_t box = 0; box < window.low.size() / D; ++box) {
        bool inside = true;
        for (std::size_t a = 0; a < D; ++a)
            inside = inside && x[a] >= window.low[box * D + a] && x[a] <= window.high[box * D + a];
        if (inside) return true;
    }
    return false;
}

/// Leaves those particles of a snapshot that lie in a window: what is worked out of each costs more
/// than all the copying.
template <class T, int D>
void keep_in(const Window& window, const BlockKeys<D>& keys_of, double cell_size,
             ParticleSnapshot<T, D>& seen) {
    std::vector<std::uint8_t> cell;
    std::size_t kept = 0;
    for (const std::int32_t h : seen.home) {
        std::int64_t block[D];
        keys_of.block(seen.keys[std::size_t(h)], block);
        std::uint32_t* of = seen.start.data() + std::size_t(h) * seen.start_stride;
        const std::uint32_t first = of[0], last = of[block_cells];
        HomeCells homes = seen.homes(h);
        std::vector<int> home_cell;
        for (std::uint32_t q = first; q < last; ++q) home_cell.push_back(homes.of(q));
        std::fill_n(of, block_cells, std::uint32_t(kept));
        for (std::uint32_t q = first; q < last; ++q) {
            int at[D];
            Block<D>::coordinates(home_cell[q - first], at);
            double x[D];
            for (int a = 0; a < D; ++a)
                x[a] = (double(block[a] * Block<D>::edge + at[a]) + 0.5 +
                        double(seen.offset[std::size_t(a)][q])) *
                       cell_size;
            if (!lies_in<D>(window, x)) continue;
            cell.push_back(std::uint8_t(home_cell[q - first]));
            seen.id[kept] = seen.id[q];
            for (auto* columns : {&seen.offset, &seen.state})
                for (auto& column : *columns) column[kept] = column[q];
            ++kept;
        }
        of[block_cells] = std::uint32_t(kept);
    }
    seen.count = kept;
    seen.cell = std::move(cell);
}

/// All particles of a body.
template <class X, class T, int D>
ParticleSnapshot<T, D> all_particles(const BodyStore<X, T, D>& body,
                                     const BlockTable<ExecutorBase<X>, D>& blocks) {
    ParticleSnapshot<T, D> out;
    out.count = body.count;
    out.id = body.id.host(body.count);
    out.keys = blocks.keys().host();
    out.start = body.cell_start.host(out.keys.size() * block_cells + 1);
    out.cell = body.cell.host(X::is_device ? body.count : 0);
    out.home = body.home.host();
    out.neighbours = blocks.neighbours().host();
    for (auto& c : body.offset) out.offset.push_back(c.host(body.count));
    for (auto& c : body.state) out.state.push_back(c.host(body.count));
    return out;
}

/// Those that lie in a window.
template <class B, class X, class T, int D>
ParticleSnapshot<T, D> particles_in(const Window& window, B& exec, const BodyStore<X, T, D>& body,
                                    const BlockTable<B, D>& blocks, double cell_size) {
    ParticleSnapshot<T, D> out;
    const auto slots = body.home.host();
    const auto keys = blocks.keys().host();
    for (const std::int32_t slot : slots) out.keys.push_back(keys[std::size_t(slot)]);
    const auto chosen =
        blocks_in<D>(window, blocks.view().keys_of, out.keys, cell_size, most_drift);
    std::vector<std::int32_t> taken;
    for (std::size_t k = 0; k < chosen.size(); ++k) {
        taken.push_back(slots[std::size_t(chosen[k])]);
        out.keys[k] = out.keys[std::size_t(chosen[k])];  // ascending: never one still to be read
    }
    out.keys.resize(chosen.size());
    out.home.resize(chosen.size());
    std::iota(out.home.begin(), out.home.end(), 0);
    out.offset.resize(D);
    out.state.resize(body.state.size());
    if (taken.empty()) return out;

    BufferOf<B, std::int32_t> from(exec);
    from.assign(taken);
    out.start_stride = block_cells + 1;
    out.start = rows_of(exec, body.cell_start, from, block_cells, out.start_stride);
    std::vector<std::uint32_t> row;
    for (std::size_t h = 0; h < taken.size(); ++h) {
        std::uint32_t* start = out.start.data() + h * out.start_stride;
        const std::uint32_t first = start[0];
        row.push_back(std::uint32_t(out.count));
        for (std::size_t c = 0; c < out.start_stride; ++c) start[c] = row[h] + (start[c] - first);
        out.count = start[block_cells];
    }
    const std::size_t columns = D + body.state.size();
    BufferOf<B, std::uint32_t> rows(exec), id(exec);
    BufferOf<B, std::uint8_t> cell(exec);
    BufferOf<B, T> numbers(exec);
    rows.assign(row);
    id.reserve_discard(out.count);
    cell.reserve_discard(X::is_device ? out.count : 0);
    numbers.reserve_discard(columns * out.count);
    exec.for_each(std::int64_t(taken.size()) * TakeParticles<T, D>::lanes,
                  TakeParticles<T, D>{body.view(), from.data(), rows.data(), int(body.state.size()),
                                      std::int64_t(out.count), numbers.data(), id.data(),
                                      X::is_device ? cell.data() : nullptr});
    out.id = id.host();
    out.cell = cell.host();
    const std::vector<T> all = numbers.host();
    for (std::size_t c = 0; c < columns; ++c) {
        auto& to = c < D ? out.offset[c] : out.state[c - D];
        to.assign(all.begin() + std::ptrdiff_t(c * out.count),
                  all.begin() + std::ptrdiff_t((c + 1) * out.count));
    }

    keep_in(window, blocks.view().keys_of, cell_size, out);

    // Nodal values of the blocks around, each once.
    out.neighbours =
        rows_of(exec, blocks.neighbours(), from, Block<D>::neighbours, Block<D>::neighbours);
    std::vector<std::int32_t> row_of(keys.size(), -1);
    for (std::int32_t& slot : out.neighbours) {
        if (slot < 0) continue;
        std::int32_t& place = row_of[std::size_t(slot)];
        if (place < 0) {
            place = std::int32_t(out.nodes.size());
            out.nodes.push_back(slot);
        }
        slot = place;
    }
    return out;
}

/// Values of these slots, `width` each and in this order; of no slots, those of all.
template <class B, class V>
std::vector<V> values_of(B& exec, const BufferOf<B, V>& from,
                         const std::vector<std::int32_t>& slots, std::size_t width) {
    if (slots.empty()) return from.host();
    BufferOf<B, std::int32_t> wanted(exec);
    wanted.assign(slots);
    return rows_of(exec, from, wanted, width, width);
}

}  // namespace mpm
