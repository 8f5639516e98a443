// Domain: what ranks on devices have added to blocks that both hold, in one piece for each other
// rank, read there where they reach each other's memory. Where they do not, such as in processes of
// their own, all that goes from one to another is sent and received, between kernels and without
// the host waiting for it within a step: votes too, and at a sort the particles that change their
// rank and the sums of blocks that are new to a table.
#pragma once

#include "mpm/solver/domain.hpp"
#include "mpm/solver/rank_blocks.hpp"

namespace mpm {

/// Whether ranks read each other's lists and pieces where these are.
template <class X, class T, int D>
bool Domain<X, T, D>::reaches() const {
    if constexpr (X::is_device) return !meeting_ || meeting_->reaches();
    return false;
}

/// The votes of all, on every rank, before the clock decides.
template <class X, class T, int D>
void Domain<X, T, D>::share_votes() {
    if (reaches()) return meeting_->meet();
    std::vector<Parcel> out, in;
    for (int r : share_->comm->others()) {
        out.push_back({votes_.data() + share_->rank(), sizeof(RankVote), r});
        in.push_back({votes_.data() + r, sizeof(RankVote), r});
    }
    meeting_->swap(out, in);
}

/// Lists the blocks that this rank and another hold, for every other: both by their keys, so that
/// the blocks of a message need no names.
template <class X, class T, int D>
void Domain<X, T, D>::list_shared() {
    RankShare<D>& s = *share_;
    const std::int64_t block = std::int64_t(plan_.sum_channels) * block_cells;
    std::vector<std::int32_t> slots;
    shared_with_.clear();
    for (int r : s.comm->others()) {
        const auto& theirs = s.held[std::size_t(r)];
        const std::size_t first = slots.size();
        auto k = theirs.begin();
        for (const HeldBlock& mine : s.held[std::size_t(s.rank())]) {
            while (k != theirs.end() && k->key < mine.key) ++k;
            if (k != theirs.end() && k->key == mine.key) slots.push_back(mine.slot);
        }
        if (slots.size() > first)
            shared_with_.push_back(
                {r, std::int64_t(first), std::int64_t(slots.size() - first) * block});
    }
    shared_slots_.assign(slots);
    shared_out_.reserve_discard(slots.size() * std::size_t(block));
    s.bytes_a_step = slots.size() * std::size_t(block) * sizeof(Sum) * (splits() ? 2 : 1);
    if (!reaches()) return shared_in_.reserve_discard(shared_out_.size());
    std::vector<const Sum*> mine(std::size_t(s.ranks()), nullptr);
    for (const SharedWith& w : shared_with_)
        mine[std::size_t(w.rank)] = shared_out_.data() + w.first * block;
    const auto told = s.comm->all_gather_alike(mine, "where its sums are");
    for (SharedWith& w : shared_with_)
        w.theirs = told[std::size_t(w.rank)].at(std::size_t(s.rank()));
}

/// Every rank has added to its own sums alone: they become those of all. `clock`: as in AddBlocks.
/// Before a rank packs again, all have met once more: for their votes, or as hosts.
template <class X, class T, int D>
void Domain<X, T, D>::swap_sums(int which, const Clock* clock) {
    const std::int64_t block = std::int64_t(plan_.sum_channels) * block_cells;
    Sum* sums = sums_[which].data();
    exec_.for_each(std::int64_t(shared_out_.size()),
                   PackBlocks<Sum>{sums, shared_slots_.data(), block, shared_out_.data()});
    if (!reaches()) {
        std::vector<Parcel> out, in;
        for (SharedWith& w : shared_with_) {
            const std::size_t bytes = std::size_t(w.numbers) * sizeof(Sum);
            Sum* here = shared_in_.data() + w.first * block;
            out.push_back({shared_out_.data() + w.first * block, bytes, w.rank});
            in.push_back({here, bytes, w.rank});
            w.theirs = here;
        }
        meeting_->swap(out, in);
    } else if (clock) {
        meeting_->meet();
    } else {
        meet_hosts();
    }
    for (const SharedWith& w : shared_with_)
        exec_.for_each(w.numbers, AddBlocks<Sum>{clock, sums, shared_slots_.data() + w.first, block,
                                                 w.theirs});
}

/// The end of the sums of a step.
template <class X, class T, int D>
void Domain<X, T, D>::share_sums() {
    swap_sums(1 - parity(), clock_buffer_.data());
}

/// What all have deposited between steps, on all. Nothing where this is the only rank.
template <class X, class T, int D>
void Domain<X, T, D>::share_deposits(int which) {
    if (share_) swap_sums(which, nullptr);
    meet_hosts();
}

/// The particles that come, from where they were listed into lists of this device, which `landed`
/// keeps. `come`, of each body: what each rank has told, which is then where they are here.
template <class X, class T, int D>
void Domain<X, T, D>::fetch_emigrants(const std::vector<Emigrating>& go,
                                      std::vector<std::vector<Coming>>& come,
                                      std::vector<Emigrating>& landed) {
    std::vector<Parcel> out, in;
    const auto add = [](std::vector<Parcel>& to, auto* list, std::size_t n, int rank) {
        to.push_back({const_cast<void*>(static_cast<const void*>(list)), n * sizeof *list, rank});
    };
    // Of each body in turn on both sides, so that what is sent first is what is waited for first.
    for (std::size_t b = 0; b < go.size(); ++b) {
        const std::size_t columns = bodies_[b].offset.size() + bodies_[b].state.size();
        for (int r : share_->comm->others()) {
            const std::size_t first = go[b].first[std::size_t(r)], n = go[b].count[std::size_t(r)];
            if (n == 0) continue;
            add(out, go[b].key.data() + first, n, r);
            add(out, go[b].in.data() + first, n, r);
            add(out, go[b].id.data() + first, n, r);
            for (std::size_t c = 0; c < columns; ++c)
                add(out, go[b].column.data() + c * go[b].all + first, n, r);
        }
        for (Coming& c : come[b]) {
            Emigrating& here = landed.emplace_back(exec_);
            here.key.reserve_discard(c.count);
            for (auto* list : {&here.in, &here.id}) list->reserve_discard(c.count);
            here.column.reserve_discard(c.count * columns);
            add(in, here.key.data(), c.count, c.rank);
            add(in, here.in.data(), c.count, c.rank);
            add(in, here.id.data(), c.count, c.rank);
            for (std::size_t k = 0; k < columns; ++k)
                add(in, here.column.data() + k * c.count, c.count, c.rank);
            c = {here.key.data(), here.in.data(), here.id.data(), here.column.data(), 0,
                 c.count,         c.count,        c.rank};
        }
    }
    meeting_->swap(out, in);
    meeting_->wait();
}

}  // namespace mpm
