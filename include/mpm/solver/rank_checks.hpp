// What ranks tell each other of blocks and particles, looked at before it is used. Whoever finds
// something wrong throws MessageError, to which the communicator adds who has sent what.
#pragma once

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <string>
#include <tuple>
#include <vector>

#include "mpm/data/blocks.hpp"
#include "mpm/exec/communicator.hpp"
#include "mpm/solver/rank_share.hpp"

namespace mpm::checks {

[[noreturn]] inline void refuse(const std::string& what) { throw MessageError(what); }

/// One more than the largest key that a domain has.
template <int D>
std::uint64_t keys_below(const BlockKeys<D>& keys) {
    std::uint64_t n = std::uint64_t(keys.fields);
    for (std::int64_t count : keys.counts) n *= std::uint64_t(count);
    return n;
}

/// Keys, or what has one: ascending, none twice, none beyond the domain.
template <class List, class KeyOf>
void ascending_keys(const List& list, std::uint64_t below, const KeyOf& key_of) {
    for (std::size_t k = 0; k < list.size(); ++k) {
        const std::uint64_t key = key_of(list[k]);
        if (key >= below)
            refuse("with block " + std::to_string(key) + "; the domain has " +
                   std::to_string(below));
        if (k > 0 && key <= key_of(list[k - 1]))
            refuse("whose blocks do not ascend at " + std::to_string(key));
    }
}
inline void table_keys(const std::vector<std::uint64_t>& keys, std::uint64_t below) {
    // A table's cells are counted in 32 bits.
    if (keys.size() >= (std::size_t(1) << 31) / block_cells)
        refuse("of " + std::to_string(keys.size()) + " blocks");
    ascending_keys(keys, below, [](std::uint64_t key) { return key; });
}
inline void held_blocks(const std::vector<HeldBlock>& blocks, std::uint64_t below) {
    ascending_keys(blocks, below, [](const HeldBlock& b) { return b.key; });
    for (const HeldBlock& b : blocks)
        if (b.slot < 0 || std::uint64_t(b.slot) >= below || (b.ready != 0 && b.ready != 1))
            refuse("with block " + std::to_string(b.key) + " in slot " + std::to_string(b.slot));
}
inline void block_weights(const std::vector<BlockWeight>& blocks, std::uint64_t below) {
    ascending_keys(blocks, below, [](const BlockWeight& b) { return b.key; });
    // Sums of them stay below 2^64: of 1024 ranks, each with at most so much.
    std::uint64_t left = std::uint64_t(1) << 53;
    for (const BlockWeight& b : blocks) {
        if (b.weight == 0 || b.weight > left)
            refuse("with block " + std::to_string(b.key) + " of weight " +
                   std::to_string(b.weight));
        left -= b.weight;
    }
}

/// What `link_ranks` is told: pieces of blocks that both ranks hold, of which there are `common`,
/// in the order in which their sums will come. `colours`: of each body.
template <class Staged>
void staged_parts(const std::vector<Staged>& parts, std::size_t common,
                  const std::vector<int>& colours, int rank) {
    for (std::size_t k = 0; k < parts.size(); ++k) {
        const Staged& p = parts[k];
        if (p.slot < 0 || std::size_t(p.slot) >= common || p.body < 0 ||
            std::size_t(p.body) >= colours.size() || p.colour < 0 ||
            p.colour >= colours[std::size_t(p.body)] || p.rank != rank || p.at < 0 ||
            std::size_t(p.at) != k)
            refuse("whose part " + std::to_string(k) + " is of shared block " +
                   std::to_string(p.slot) + ", body " + std::to_string(p.body) + ", colour " +
                   std::to_string(p.colour) + " and rank " + std::to_string(p.rank));
        if (k > 0 && p.body < parts[k - 1].body)
            refuse("whose bodies do not ascend at part " + std::to_string(k));
    }
    const auto place = [](const Staged& p) { return std::tie(p.slot, p.body, p.colour); };
    std::vector<Staged> all = parts;
    std::sort(all.begin(), all.end(),
              [&](const Staged& a, const Staged& b) { return place(a) < place(b); });
    const auto twice =
        std::adjacent_find(all.begin(), all.end(),
                           [&](const Staged& a, const Staged& b) { return place(a) == place(b); });
    if (twice != all.end())
        refuse("with shared block " + std::to_string(twice->slot) + " twice for body " +
               std::to_string(twice->body));
}

/// Numbers of a mesh's vertices, in any order, none twice.
inline void vertices(const std::vector<std::int32_t>& list, std::size_t below) {
    if (list.size() > below) refuse("of " + std::to_string(list.size()) + " vertices");
    std::vector<std::uint8_t> seen(below, 0);
    for (const std::int32_t v : list) {
        if (v < 0 || std::size_t(v) >= below || seen[std::size_t(v)])
            refuse("with vertex " + std::to_string(v) + " of " + std::to_string(below) +
                   ", or with that twice");
        seen[std::size_t(v)] = 1;
    }
}
/// What another rank asks this one for: ascending, and this one's to tell.
template <class Mine>
void wanted(const std::vector<std::int32_t>& list, std::size_t below, const char* what,
            const Mine& mine) {
    for (std::size_t k = 0; k < list.size(); ++k)
        if (list[k] < (k == 0 ? 0 : list[k - 1] + 1) || std::size_t(list[k]) >= below ||
            !mine(list[k]))
            refuse("for " + std::string(what) + " " + std::to_string(list[k]) +
                   ", which is not this rank's or out of order");
}
/// Of which differences are taken.
inline void cells_of_vertices(const std::vector<std::int32_t>& cells) {
    constexpr std::int32_t most = 1 << 28;
    for (const std::int32_t c : cells)
        if (c < -most || c > most) refuse("with a vertex in cell " + std::to_string(c));
}

/// Offsets are of cells that a particle was in the middle of, by a drift of one at most.
inline constexpr double farthest_offset = 2;

/// Particles of one body that come from the rank whose table has `theirs`. `mine(key)`: whether a
/// block is this rank's; `ids`: one more than the largest there may be.
template <class Emigrants, class Mine>
void emigrants(const Emigrants& e, std::size_t offsets, const std::vector<std::uint64_t>& theirs,
               const Mine& mine, std::uint64_t ids) {
    const std::size_t n = e.id.size();
    const auto length = [&](std::size_t size, const std::string& what) {
        if (size != n)
            refuse("with " + std::to_string(size) + " " + what + " for " + std::to_string(n) +
                   " ids");
    };
    length(e.from.size(), "blocks they come from");
    length(e.to.size(), "blocks they go to");
    length(e.cell.size(), "cells");
    for (const auto& column : e.column) length(column.size(), "rows of a column");
    const auto holds = [&](std::uint64_t key) {
        return std::binary_search(theirs.begin(), theirs.end(), key);
    };
    std::uint64_t last_from = 0, last_to = 0;
    bool any = false;
    for (std::size_t k = 0; k < n; ++k) {
        const auto particle = [&] { return " of particle " + std::to_string(e.id[k]); };
        if (e.id[k] >= ids)
            refuse("with particle " + std::to_string(e.id[k]) + "; ids are below " +
                   std::to_string(ids));
        if (e.cell[k] >= std::uint32_t(block_cells))
            refuse("with cell " + std::to_string(e.cell[k]) + particle());
        // Those that follow each other mostly share their blocks.
        if ((!any || e.from[k] != last_from) && !holds(e.from[k]))
            refuse("with block " + std::to_string(e.from[k]) + particle() +
                   ", which that rank does not have");
        if ((!any || e.to[k] != last_to) && (!holds(e.to[k]) || !mine(e.to[k])))
            refuse("with block " + std::to_string(e.to[k]) + particle() +
                   ", which is not this rank's");
        if (any && e.from[k] < last_from) refuse("whose blocks do not ascend");
        last_from = e.from[k];
        last_to = e.to[k];
        any = true;
        for (std::size_t a = 0; a < offsets; ++a)
            if (!(std::abs(double(e.column[a][k])) <= farthest_offset))
                refuse("with offset " + std::to_string(double(e.column[a][k])) + particle());
    }
    std::vector<std::uint32_t> all = e.id;
    std::sort(all.begin(), all.end());
    const auto twice = std::adjacent_find(all.begin(), all.end());
    if (twice != all.end()) refuse("with particle " + std::to_string(*twice) + " twice");
}

}  // namespace mpm::checks
