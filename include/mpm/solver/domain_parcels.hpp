// Domain: what ranks on devices have added to blocks that both hold, in one piece for each other
// rank, read there where they reach each other's memory. Where they do not, such as in processes of
// their own, all that goes from one to another is sent and received, between kernels and without
// the host waiting for it within a step: votes too, and at a sort the particles that change their
// rank and the sums of blocks that are new to a table.
#pragma once

#include "mpm/kernels/cell_sums.hpp"
#include "mpm/solver/domain.hpp"
#include "mpm/solver/rank_blocks.hpp"

namespace mpm {

/// Whether ranks read each other's lists and pieces where these are.
template <class X, class T, int D>
bool Domain<X, T, D>::reaches() const {
    if constexpr (X::is_device) return !meeting_ || meeting_->reaches();
    return false;
}

/// What each rank has told of itself, votes before the clock decides or other numbers, on all.
template <class X, class T, int D>
template <class N>
void Domain<X, T, D>::share_told(const Buffer<X, N>& by_rank) {
    if (reaches()) return meeting_->meet();
    std::vector<Parcel> out, in;
    for (int r : share_->comm->others()) {
        out.push_back({by_rank.data() + share_->rank(), sizeof(N), r});
        in.push_back({by_rank.data() + r, sizeof(N), r});
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
    const std::size_t swaps = 1 + (splits() ? 1 : 0) + std::size_t(std::max(plan_.sweeps, 0));
    s.bytes_a_step = slots.size() * std::size_t(block) * sizeof(Sum) * swaps;
    list_shared_cells(std::int64_t(slots.size()));
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

/// The same, in pieces by rank of what others hold too, for what bodies sum up over cells.
template <class X, class T, int D>
void Domain<X, T, D>::list_shared_cells(std::int64_t slots) {
    int most = 0, all = 0;  // numbers of a cell, of one body and of all
    for (const Body& body : bodies_) {
        if (!body.plan.cells.smooths()) continue;
        most = std::max(most, summed_columns(body));
        all += summed_columns(body);
    }
    if (most == 0) return;
    const std::size_t cells = std::size_t(slots) * block_cells;
    cells_out_.reserve_discard(cells * std::size_t(most));
    share_->bytes_a_step += cells * std::size_t(all) * sizeof(std::int64_t);
    if (!reaches()) return cells_in_.reserve_discard(cells_out_.size());
    RankShare<D>& s = *share_;
    struct Piece {
        const std::int64_t* out;
        std::int64_t first;
    };
    std::vector<Piece> mine(std::size_t(s.ranks()), Piece{nullptr, 0});
    for (const SharedWith& w : shared_with_)
        mine[std::size_t(w.rank)] = {cells_out_.data(), w.first};
    const auto told = s.comm->all_gather_alike(mine, "where its sums over cells are");
    for (SharedWith& w : shared_with_) {
        const Piece& theirs = told[std::size_t(w.rank)].at(std::size_t(s.rank()));
        w.their_cells = theirs.out;
        w.their_first = theirs.first;
    }
}

/// Of one body that devices share: what cells sum up of its particles.
template <class X, class T, int D>
struct Domain<X, T, D>::CellsOfDevices final : CellPeers {
    Domain& domain;
    explicit CellsOfDevices(Domain& of) : domain(of) {}
    void complete(double* cells, std::size_t width) override {
        domain.swap_cells(reinterpret_cast<std::int64_t*>(cells), int(width));
    }
};

/// Every rank has added what its own particles do to cells; they get the sums of all. Before a rank
/// packs again all have met once more: to tell what came of it.
template <class X, class T, int D>
void Domain<X, T, D>::swap_cells(std::int64_t* cells, int columns) {
    const std::int64_t count = std::int64_t(table_.slots) * block_cells,
                       block = std::int64_t(columns) * block_cells,
                       of_sums = std::int64_t(plan_.sum_channels) * block_cells;
    exec_.for_each(std::int64_t(shared_slots_.size()) * block,
                   PackCells{cells, count, columns, shared_slots_.data(), cells_out_.data()});
    if (reaches()) {
        meeting_->meet();
    } else {
        std::vector<Parcel> out, in;
        for (SharedWith& w : shared_with_) {
            const std::size_t bytes = std::size_t(w.numbers / of_sums * block) * 8;
            w.their_cells = cells_in_.data();
            w.their_first = w.first;
            out.push_back({cells_out_.data() + w.first * block, bytes, w.rank});
            in.push_back({cells_in_.data() + w.first * block, bytes, w.rank});
        }
        meeting_->swap(out, in);
    }
    for (const SharedWith& w : shared_with_)
        exec_.for_each(w.numbers / of_sums * block,
                       AddCells{cells, count, columns, shared_slots_.data() + w.first,
                                w.their_cells + w.their_first * block});
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
