// Ranks on devices: which blocks are new to a rank's table and who has their sums, and the sums of
// chosen blocks in one piece.
#pragma once

#include <cstdint>
#include <vector>

#include "mpm/solver/rank_share.hpp"

namespace mpm {

/// Whether a rank's list, which ascends, has a block, asked for in ascending order.
class HeldInOrder {
public:
    explicit HeldInOrder(const std::vector<HeldBlock>& list) : list_(&list) {}
    const HeldBlock* find(std::uint64_t key) {
        while (at_ < list_->size() && (*list_)[at_].key < key) ++at_;
        return at_ < list_->size() && (*list_)[at_].key == key ? &(*list_)[at_] : nullptr;
    }

private:
    const std::vector<HeldBlock>* list_;
    std::size_t at_ = 0;
};

/// Blocks that are new to a rank's table, and where the first who held them keeps them: by that
/// rank the slots there and here.
struct NewBlocks {
    std::vector<std::vector<std::int32_t>> from, to;
    NewBlocks(int rank, const std::vector<std::vector<HeldBlock>>& before,
              const std::vector<std::vector<HeldBlock>>& after)
        : from(before.size()), to(before.size()) {
        std::vector<HeldInOrder> held(before.begin(), before.end());
        for (const HeldBlock& block : after[std::size_t(rank)]) {
            if (held[std::size_t(rank)].find(block.key)) continue;
            for (std::size_t r = 0; r < held.size(); ++r) {
                const HeldBlock* theirs = held[r].find(block.key);
                if (!theirs) continue;
                from[r].push_back(theirs->slot);
                to[r].push_back(block.slot);
                break;
            }
        }
    }
};

/// Sums of chosen blocks, which may be another device's, into one piece, and from it into a table.
template <class Sum>
struct PackBlocks {
    const Sum* sums;
    const std::int32_t* slot;
    std::int64_t size;  // of a block
    Sum* out;
    MPM_INLINE void operator()(std::int64_t i) const {
        out[i] = sums[slot[i / size] * size + i % size];
    }
};
template <class Sum>
struct UnpackBlocks {
    Sum* sums;
    const std::int32_t* slot;
    std::int64_t size;
    const Sum* in;
    MPM_INLINE void operator()(std::int64_t i) const {
        sums[slot[i / size] * size + i % size] = in[i];
    }
};

/// Adds what another rank has added to blocks that this one holds too. Integers: the order of ranks
/// changes no bit.
template <class Sum>
struct AddBlocks {
    const Clock* clock;  // within a step: nothing is added where it has halted. Else null
    Sum* sums;
    const std::int32_t* slot;
    std::int64_t size;  // of a block
    const Sum* in;
    MPM_INLINE void operator()(std::int64_t i) const {
        if (clock && clock->halt != Halt::none) return;
        if (in[i] != 0) sums[slot[i / size] * size + i % size] += in[i];
    }
};
template <class Sum>
struct AddSums {
    Sum* to;
    const Sum* from;
    MPM_INLINE void operator()(std::int64_t i) const { to[i] += from[i]; }
};

}  // namespace mpm
