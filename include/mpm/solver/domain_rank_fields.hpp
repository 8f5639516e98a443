// Domain: devices that share a scene whose bodies have fields of velocities of their own. As ranks
// on the CPU do (rank_fields.hpp), each holds all fields of the blocks that its homes reach and of
// those around, but finds them on the device and asks others only for what lies beside a cut.
#pragma once

#include <string>
#include <vector>

#include "mpm/kernels/sorting.hpp"
#include "mpm/solver/domain.hpp"
#include "mpm/solver/rank_checks.hpp"
#include "mpm/solver/rank_fields.hpp"

namespace mpm {

/// The block that each slot is of, by its key of field 0.
template <int D>
struct BlocksOfSlots {
    BlockKeys<D> keys_of;
    const std::uint64_t* keys;
    std::uint64_t* out;
    MPM_INLINE void operator()(std::int64_t slot) const {
        out[slot] = keys_of.of_block(keys[slot]);
    }
};
/// Blocks and those around them, inside of the domain.
template <int D>
struct ListAround {
    BlockKeys<D> keys_of;
    const std::uint64_t* blocks;
    std::uint64_t* out;  // (blocks * 3^D)
    MPM_INLINE void operator()(std::int64_t i) const {
        const std::uint64_t block = blocks[i / Block<D>::neighbours];
        std::int64_t at[D], b[D];
        keys_of.block(block, at);
        const bool inside = keys_of.beside(at, int(i % Block<D>::neighbours), b);
        out[i] = inside ? keys_of.key(b) : block;
    }
};
/// Slots of some blocks.
template <int D>
struct FlagOfBlocks {
    BlockKeys<D> keys_of;
    const std::uint64_t* keys;
    const std::uint64_t* blocks;  // ascending
    std::int32_t count;
    std::uint32_t* flag;
    MPM_INLINE void operator()(std::int64_t k) const {
        flag[k] = find_key(blocks, count, keys_of.of_block(keys[k])) >= 0;
    }
};
/// Whether this rank counts a block: where its homes reach it, unless those of an earlier rank do.
template <int D>
struct CountReached {
    BlockKeys<D> keys_of;
    const std::uint64_t* keys;
    const std::uint64_t* blocks;  // that are reached, ascending
    std::int32_t count;
    bool by_another;
    std::uint8_t* counts;
    MPM_INLINE void operator()(std::int64_t slot) const {
        const bool found = find_key(blocks, count, keys_of.of_block(keys[slot])) >= 0;
        if (!by_another)
            counts[slot] = found;
        else if (found)
            counts[slot] = 0;
    }
};

/// Which slots each rank's homes reach, `keys` those of this one, and with them the blocks where it
/// resolves contact. Of others only what lies beside a cut. All ranks together.
template <class X, class T, int D>
std::vector<std::vector<std::uint64_t>> Domain<X, T, D>::tell_reached_slots(
    const Buffer<X, std::uint64_t>& keys) {
    RankShare<D>& s = *share_;
    const std::int64_t slots = std::int64_t(keys.size());
    reached_.reserve_discard(keys.size());
    exec_.for_each(slots, BlocksOfSlots<D>{table_.keys_of, keys.data(), reached_.data()});
    reached_.shrink(std::size_t(exec_.sort_unique(reached_.data(), slots, table_.keys_of.bits())));

    Buffer<X, std::uint32_t> flag(exec_), position(exec_);
    Buffer<X, std::uint64_t> beside(exec_);
    beside.reserve_discard(flag_border(keys, false, flag, position));
    exec_.for_each(slots, ListKeys{keys.data(), position.data(), flag.data(), beside.data()});
    const std::uint64_t below = checks::keys_below(table_.keys_of);
    auto told = s.comm->all_gather(
        beside.host(), "slots that its homes reach",
        [&](const std::vector<std::uint64_t>& theirs, int) { checks::table_keys(theirs, below); });
    s.reached.clear();
    for (int r = 0; r < s.ranks(); ++r)
        s.reached.push_back(r == s.rank() ? reached_.host()
                                          : blocks_of_slots(table_.keys_of, told[std::size_t(r)]));
    return told;
}

/// The same for the homes of the present table.
template <class X, class T, int D>
void Domain<X, T, D>::tell_reached_by_homes() {
    Buffer<X, std::uint32_t> any(exec_);
    Buffer<X, std::uint64_t> none(exec_), keys(exec_);
    Buffer<X, std::int32_t> map(exec_);
    join_homes(find_homes(), any);
    blocks_.rebuild(any, none, keys, map);
    tell_reached_slots(keys);
}

/// A table of the slots that this rank's homes reach becomes the one that it holds. All ranks
/// together.
template <class X, class T, int D>
void Domain<X, T, D>::hold_fields_of_devices(Buffer<X, std::uint64_t>& keys) {
    const RankShare<D>& s = *share_;
    const auto told = tell_reached_slots(keys);
    std::vector<std::uint64_t> all;
    for (int r : s.comm->others())
        all.insert(all.end(), told[std::size_t(r)].begin(), told[std::size_t(r)].end());
    if (all.empty()) return;

    const int bits = table_.keys_of.bits();
    Buffer<X, std::uint64_t> around(exec_), theirs(exec_), table(exec_);
    const std::int64_t candidates = std::int64_t(reached_.size()) * Block<D>::neighbours;
    around.reserve_discard(std::size_t(candidates));
    exec_.for_each(candidates, ListAround<D>{table_.keys_of, reached_.data(), around.data()});
    const std::int64_t blocks = exec_.sort_unique(around.data(), candidates, bits);

    const std::int64_t n = std::int64_t(all.size());
    Buffer<X, std::uint32_t> flag(exec_), position(exec_);
    theirs.assign(all);
    flag.reserve_discard(all.size());
    position.reserve_discard(all.size() + 1);
    exec_.for_each(n, FlagOfBlocks<D>{table_.keys_of, theirs.data(), around.data(),
                                      std::int32_t(blocks), flag.data()});
    exec_.exclusive_scan(flag.data(), position.data(), n);
    std::uint32_t more = 0;
    exec_.download(&more, position.data() + n, sizeof more);
    if (more == 0) return;
    table.reserve_discard(keys.size() + more);
    exec_.copy(table.data(), keys.data(), keys.size() * sizeof(std::uint64_t));
    exec_.for_each(
        n, ListKeys{theirs.data(), position.data(), flag.data(), table.data() + keys.size()});
    table.shrink(std::size_t(exec_.sort_unique(table.data(), std::int64_t(table.size()), bits)));
    // A node out there that follows a line would be too fast without the rest of it, and its speed
    // is among the maxima.
    if (!s.together.empty()) {
        auto with_others = table.host();
        add_together<D>(table_.keys_of, s.together, with_others);
        table.assign(with_others);
    }
    check_slots(std::int64_t(table.size()));
    keys.swap(table);
}

/// Of the ranks whose homes reach a block the lowest counts it: it knows all that becomes of it.
template <class X, class T, int D>
void Domain<X, T, D>::count_reached() {
    const RankShare<D>& s = *share_;
    Buffer<X, std::uint64_t> theirs(exec_);
    const auto count = [&](const Buffer<X, std::uint64_t>& blocks, bool by_another) {
        exec_.for_each(table_.slots,
                       CountReached<D>{table_.keys_of, table_.keys, blocks.data(),
                                       std::int32_t(blocks.size()), by_another, counts_.data()});
    };
    count(reached_, false);
    for (int r = 0; r < s.rank(); ++r) {
        theirs.assign(s.reached[std::size_t(r)]);
        count(theirs, true);
    }
}

}  // namespace mpm
