// Domain: gauges and probes. Where several ranks share the scene: they stand still, so the blocks
// that they can read are known; these are told to all ranks, and everyone takes the same sample.
#pragma once

#include <algorithm>
#include <cmath>
#include <map>
#include <vector>

#include "mpm/kernels/telling.hpp"
#include "mpm/solver/domain.hpp"
#include "mpm/solver/rank_checks.hpp"

namespace mpm {

template <class X, class T, int D>
SamplePoints<typename Domain<X, T, D>::Grid, typename Domain<X, T, D>::Sum, D>
Domain<X, T, D>::sample_points() {
    SamplePoints<Grid, Sum, D> points{node_update(parity()),
                                      sensors_.records(),
                                      sensors_.points(),
                                      spec_.cell_size,
                                      {},
                                      sensors_.functions(),
                                      kernel_width(sensors_.functions().kernel) != 3};
    for (int a = 0; a < D; ++a) points.cells[a] = spec_.cells[a];
    return points;
}

/// On the CPU: the blocks that points which are due can read are told to all, and everyone takes
/// the same sample.
template <class X, class T, int D>
void Domain<X, T, D>::sample_points_together(SamplePoints<Grid, Sum, D> points) {
    const RankShare<D>& s = *share_;
    const auto wanted = sensors_.blocks_of_due_points(table_.keys_of);
    if (wanted.empty()) return;

    const std::size_t sums = std::size_t(plan_.sum_channels) * block_cells,
                      velocities = std::size_t(plan_.velocity_channels) * block_cells;
    std::vector<std::uint64_t> own;  // of all fields there
    for (std::uint64_t key : wanted) {
        const std::uint64_t* end = table_.keys + table_.slots;
        for (const std::uint64_t* k = std::lower_bound(table_.keys, end, key);
             k < end && *k < key + std::uint64_t(table_.keys_of.fields); ++k)
            if (counts_slot(std::size_t(k - table_.keys))) own.push_back(*k);
    }
    Packer packer;
    packer.put(own);
    for (std::uint64_t key : own) {
        const std::size_t slot = std::size_t(find_key(table_.keys, table_.slots, key));
        packer.put(sums_[parity()].data() + slot * sums, sums);
        packer.put(velocity_.data() + slot * velocities, velocities);
    }
    const Bytes mine = packer.take();
    struct Told {
        std::vector<Sum> sums;
        std::vector<Grid> velocities;
    };
    using Tables = std::map<std::uint64_t, Told>;
    const auto read = [&](Unpacker& from) {
        Tables out;
        const auto keys = from.list<std::uint64_t>();
        checks::ascending_keys(keys, checks::keys_below(table_.keys_of),
                               [](std::uint64_t key) { return key; });
        for (std::uint64_t key : keys) {
            if (!detail::holds(wanted, table_.keys_of.of_block(key)))
                checks::refuse("with block " + std::to_string(key) + ", which no point reads");
            Told& t = out[key];
            t.sums.resize(sums);
            t.velocities.resize(velocities);
            from.get(t.sums.data(), sums);
            from.get(t.velocities.data(), velocities);
        }
        return out;
    };
    std::vector<Tables> parts(s.keys.size());
    s.comm->exchange_and_read(std::vector<Bytes>(s.keys.size(), mine), s.comm->others(),
                              "blocks of points",
                              [&](int r, Unpacker& from) { parts[std::size_t(r)] = read(from); });
    Unpacker again(mine);
    parts[std::size_t(s.rank())] = read(again);
    Tables told;
    for (Tables& part : parts) told.merge(part);  // a block is told by one
    std::vector<std::uint64_t> keys;
    Told all;
    for (const auto& [key, t] : told) {
        keys.push_back(key);
        all.sums.insert(all.sums.end(), t.sums.begin(), t.sums.end());
        all.velocities.insert(all.velocities.end(), t.velocities.begin(), t.velocities.end());
    }
    auto& grid = points.node.grid;
    grid.table = {table_.keys_of, std::int32_t(keys.size()), keys.data(), nullptr, nullptr};
    grid.sums = all.sums.data();
    grid.velocity = all.velocities.data();
    for (int k = 0; k < sensors_.point_count(); ++k) points(k);
}

/// On devices: the table of blocks that are told. All ranks together.
template <class X, class T, int D>
void Domain<X, T, D>::open_points() {
    if constexpr (X::is_device) {
        if (sensors_.point_count() == 0) return;
        ToldClock never{};
        never.due = -1;
        told_clock_.assign(std::vector<ToldClock>{never});
        if (spec_.contact.any()) return;  // `link_points` does, with each table
        told_keys_.assign(sensors_.blocks_of_points(table_.keys_of));
        reserve_told();
    }
}

/// Room for it, and where all ranks have theirs. All ranks together, and none in a step.
template <class X, class T, int D>
void Domain<X, T, D>::reserve_told() {
    if constexpr (X::is_device) {
        const std::size_t blocks = told_keys_.size(),
                          sums = blocks * std::size_t(plan_.sum_channels) * block_cells;
        told_slots_.reserve_discard(blocks);
        told_sums_.reserve_discard(sums);
        told_sums_.zero();
        told_velocity_.reserve_discard(blocks * std::size_t(plan_.velocity_channels) * block_cells);
        told_velocity_.zero();
        struct Tables {
            Sum* sums;
            Grid* velocity;
        };
        exec_.wait();
        if (!reaches()) {
            told_blocks_.ranks = 1;
            told_blocks_.sums[0] = told_sums_.data();
            told_blocks_.velocity[0] = told_velocity_.data();
            const std::size_t others = std::size_t(share_->ranks() - 1);
            told_sums_in_.reserve_discard(others * told_sums_.size());
            told_velocity_in_.reserve_discard(others * told_velocity_.size());
            return;
        }
        told_blocks_.ranks = share_->ranks();
        int r = 0;
        for (const Tables& theirs : share_->comm->tell(
                 Tables{told_sums_.data(), told_velocity_.data()}, "where points are told")) {
            told_blocks_.sums[r] = theirs.sums;
            told_blocks_.velocity[r++] = theirs.velocity;
        }
    }
}

/// Slots of the blocks that points can read, of all fields that anyone has there, ascending. All
/// ranks together.
template <class X, class T, int D>
std::vector<std::uint64_t> Domain<X, T, D>::slots_of_points() {
    const auto wanted = sensors_.blocks_of_points(table_.keys_of);
    const auto keys = blocks_.keys().host();
    std::vector<std::uint64_t> all;
    for (std::uint64_t key : wanted)
        for (auto k = std::lower_bound(keys.begin(), keys.end(), key);
             k != keys.end() && *k < key + std::uint64_t(table_.keys_of.fields); ++k)
            if (counts_slot(std::size_t(k - keys.begin()))) all.push_back(*k);
    const std::uint64_t below = checks::keys_below(table_.keys_of);
    const auto told = share_->comm->all_gather(
        all, "slots of points",
        [&](const std::vector<std::uint64_t>& theirs, int) { checks::table_keys(theirs, below); });
    all.clear();
    for (const auto& theirs : told) all.insert(all.end(), theirs.begin(), theirs.end());
    std::sort(all.begin(), all.end());
    all.erase(std::unique(all.begin(), all.end()), all.end());
    return all;
}

/// Which of these blocks this rank tells, whenever there is a new table. Where bodies have fields
/// of velocities, blocks have slots by these, and the few that are there are told.
template <class X, class T, int D>
void Domain<X, T, D>::link_points() {
    if (sensors_.point_count() == 0) return;
    if (spec_.contact.any()) {
        told_keys_.assign(slots_of_points());
        reserve_told();
    }
    exec_.for_each(
        std::int64_t(told_keys_.size()),
        FindTold{told_keys_.data(), table_.keys, table_.slots, counts_.data(), told_slots_.data()});
}

/// Before the ranks meet.
template <class X, class T, int D>
void Domain<X, T, D>::tell_points() {
    if (sensors_.point_count() == 0) return;
    const Clock* clock = clock_buffer_.data();
    exec_.for_each(sensors_.point_count(),
                   OpenPoints<D>{clock, sensors_.records(), sensors_.points(), told_clock_.data()});
    const std::int32_t sums = plan_.sum_channels * block_cells,
                       velocities = plan_.velocity_channels * block_cells;
    exec_.for_each(
        std::int64_t(told_keys_.size()) * (sums + velocities),
        TellBlocks<Grid, Sum>{clock, told_clock_.data(), told_slots_.data(), sums_[parity()].data(),
                              velocity_.data(), sums, velocities, told_blocks_});
}

/// The tables of all become one where ranks have told their own alone.
template <class X, class T, int D>
void Domain<X, T, D>::swap_told_points() {
    std::vector<Parcel> out, in;
    const std::size_t sums = told_sums_.size(), velocities = told_velocity_.size();
    std::size_t k = 0;
    for (int r : share_->comm->others()) {
        out.push_back({told_sums_.data(), sums * sizeof(Sum), r});
        out.push_back({told_velocity_.data(), velocities * sizeof(Grid), r});
        in.push_back({told_sums_in_.data() + k * sums, sums * sizeof(Sum), r});
        in.push_back({told_velocity_in_.data() + k * velocities, velocities * sizeof(Grid), r});
        ++k;
    }
    meeting_->swap(out, in);
    // Each block is told by one rank: nothing is rounded.
    for (std::size_t other = 0; other < k; ++other) {
        exec_.for_each(std::int64_t(sums),
                       AddSums<Sum>{told_sums_.data(), told_sums_in_.data() + other * sums});
        exec_.for_each(
            std::int64_t(velocities),
            AddSums<Grid>{told_velocity_.data(), told_velocity_in_.data() + other * velocities});
    }
}

/// After they have met. Before they meet again what has been read is forgotten.
template <class X, class T, int D>
void Domain<X, T, D>::sample_told_points() {
    if (sensors_.point_count() == 0) return;
    if (!reaches()) swap_told_points();
    SamplePoints<Grid, Sum, D> points = sample_points();
    auto& grid = points.node.grid;
    grid.table = {table_.keys_of, std::int32_t(told_keys_.size()), told_keys_.data(), nullptr,
                  nullptr};
    grid.sums = told_sums_.data();
    grid.velocity = told_velocity_.data();
    points.node.clock = &told_clock_.data()->clock;
    exec_.for_each_large(sensors_.point_count(),
                         SampleTold<Grid, Sum, D>{points, told_clock_.data()});
    exec_.for_each(std::int64_t(told_sums_.size()),
                   ForgetBlocks<Sum>{told_clock_.data(), told_sums_.data()});
    exec_.for_each(std::int64_t(told_velocity_.size()),
                   ForgetBlocks<Grid>{told_clock_.data(), told_velocity_.data()});
}

}  // namespace mpm
