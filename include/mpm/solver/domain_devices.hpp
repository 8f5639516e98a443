// Domain: one rank of several on devices. It adds to its own sums alone; what it has added to
// blocks that others hold too they read after the pass and add to theirs (domain_parcels.hpp);
// integers end alike everywhere. So ranks only have to wait for each other twice a step: when the
// votes are there and when the sums are packed. Where they do not reach each other's memory these
// two are exchanges; the rest is the same.
#pragma once

#include <string>

#include "mpm/kernels/placing.hpp"
#include "mpm/solver/domain.hpp"
#include "mpm/solver/rank_checks.hpp"

namespace mpm {

/// Slots of blocks within `reach` blocks of one that another rank owns.
template <int D>
struct FlagBorder {
    BlockKeys<D> keys_of;
    const std::uint64_t* keys;
    RowCuts<D> cuts;
    int me;
    bool all;
    int reach;
    std::uint32_t* flag;
    MPM_INLINE void operator()(std::int64_t slot) const {
        std::int64_t at[D];
        keys_of.block(keys[slot], at);
        const int width = 2 * reach + 1;
        int around = 1;
        for (int a = 0; a < D; ++a) around *= width;
        bool found = all;
        for (int n = 0; n < around && !found; ++n) {
            std::int64_t b[D];
            bool inside = true;
            int rest = n;
            for (int a = D - 1; a >= 0; --a) {
                b[a] = at[a] + rest % width - reach;
                rest /= width;
                inside = inside && b[a] >= -BlockKeys<D>::rim &&
                         b[a] < keys_of.counts[a] - BlockKeys<D>::rim;
            }
            found = inside && cuts.owner(keys_of, keys_of.key(b)) != me;
        }
        flag[slot] = found;
    }
};
template <int D>
struct ListHeld {
    BlockKeys<D> keys_of;
    const std::uint64_t* keys;
    std::int32_t slots;
    const std::uint32_t* flag;
    const std::uint32_t* position;
    HeldBlock* out;
    ReachedBlocks reached;
    MPM_INLINE void operator()(std::int64_t slot) const {
        if (!flag[slot]) return;
        std::int64_t at[D];
        keys_of.block(keys[slot], at);
        bool ready = true;
        for (int n = 0; n < Block<D>::neighbours && ready; ++n) {
            std::int64_t b[D];
            int rest = n;
            for (int a = D - 1; a >= 0; --a) {
                b[a] = at[a] + rest % 3 - 1;
                rest /= 3;
                ready = ready && b[a] >= -BlockKeys<D>::rim &&
                        b[a] + BlockKeys<D>::rim < keys_of.counts[a];
            }
            ready = ready &&
                    find_key(keys, slots, keys_of.key(b, keys_of.field(keys[slot]))) >= 0 &&
                    reached.has(keys_of.key(b));
        }
        out[position[slot]] = {keys[slot], std::int32_t(slot), ready};
    }
};

/// Blocks of this rank whose neighbours are all in the table: they may become homes in it.
template <int D>
struct FlagReady {
    const std::int32_t* neighbours;
    const std::int32_t* owner;
    int me;
    std::uint32_t* ready;
    BlockKeys<D> keys_of;
    const std::uint64_t* keys;
    ReachedBlocks reached;
    MPM_INLINE void operator()(std::int64_t slot) const {
        bool all = owner[slot] == me;
        for (int n = 0; n < Block<D>::neighbours && all; ++n) {
            const std::int32_t beside = neighbours[slot * Block<D>::neighbours + n];
            all = beside >= 0 && reached.has(keys_of.of_block(keys[beside]));
        }
        ready[slot] = all;
    }
};

/// Blocks of another rank's table that this one holds too.
template <class X>
struct LinkHeld {
    const std::uint64_t* keys;
    std::int32_t slots;
    const HeldBlock* theirs;
    bool they_count;  // its nodes, and not we
    const std::int32_t* owner;
    int rank;  // whose table it is
    std::uint8_t* shared;
    std::uint8_t* counts;
    std::uint32_t* ready;
    std::uint32_t* found;
    MPM_INLINE void operator()(std::int64_t k) const {
        const std::int32_t slot = find_key(keys, slots, theirs[k].key);
        if (slot < 0) return;
        shared[slot] = 1;
        if (they_count) counts[slot] = 0;
        if (owner[slot] == rank) ready[slot] = theirs[k].ready;
        X::fetch_add(found, 1);
    }
};

/// Where ranks vote, and how they wait for each other. All ranks together.
template <class X, class T, int D>
void Domain<X, T, D>::open_devices() {
    if constexpr (X::is_device) {
        Communicator& comm = *share_->comm;
        meeting_ = X::Meeting::open(exec_, comm);
        const auto open = [&]<class N>(Buffer<X, N>& by_rank, Buffer<X, N*>& boxes) {
            by_rank.assign(std::vector<N>(std::size_t(comm.ranks()), N{}));
            boxes.assign(meeting_->reaches() ? comm.tell(by_rank.data(), "where it is told")
                                             : std::vector<N*>{by_rank.data()});
        };
        open(votes_, boxes_);
        open(told_, told_boxes_);
    }
}

/// Until what every rank has queued is done. Nothing where this is the only one.
template <class X, class T, int D>
void Domain<X, T, D>::meet_hosts() {
    if (!share_) return;
    if constexpr (X::is_device) meeting_->wait();
    share_->comm->tell(1, "that it is there");
}

template <class X, class T, int D>
double Domain<X, T, D>::largest_of_all(double x) const {
    if (!share_) return x;
    for (const double theirs : share_->comm->tell(double(x), "a number"))
        if (!(theirs <= x)) x = theirs;  // not-a-number stays
    return x;
}

/// Numbers of all ranks, added up. On the CPU nothing asks for them.
template <class X, class T, int D>
void Domain<X, T, D>::sum_of_devices(std::vector<std::uint64_t>& numbers) const {
    if (!share_ || !X::is_device) return;
    const auto told = share_->comm->all_gather_alike(numbers, "numbers");
    std::fill(numbers.begin(), numbers.end(), 0);
    for (const auto& theirs : told)
        for (std::size_t k = 0; k < numbers.size(); ++k) numbers[k] += theirs[k];
}

/// The same for the homes of all bodies and behind them their particles, which say what each rank
/// has to do.
template <class X, class T, int D>
void Domain<X, T, D>::sum_of_homes(std::vector<std::uint64_t>& numbers) {
    if (!share_ || !X::is_device) return;
    const std::size_t bodies = bodies_.size();
    share_->loads.clear();
    const auto told = share_->comm->all_gather_alike(numbers, "homes");
    std::fill(numbers.begin(), numbers.end(), 0);
    for (const auto& theirs : told) {
        std::uint64_t load = 0;
        for (std::size_t k = 0; k < numbers.size(); ++k) {
            numbers[k] += theirs[k];
            load += k < bodies ? weight_of_block * theirs[k] : theirs[k];
        }
        share_->loads.push_back(load);
    }
}

/// How many steps all ranks queue, and whether the time of any is over.
template <class X, class T, int D>
void Domain<X, T, D>::run_together(std::int64_t& steps, bool& wall_over) {
    struct Says {
        std::int64_t steps;
        std::int64_t over;
    };
    const auto check = [](const std::vector<Says>& list, int) {
        if (list.size() != 1 || list[0].steps < -1)
            throw MessageError("of " + std::to_string(list.size()) + " entries");
    };
    for (const auto& theirs : share_->comm->all_gather(std::vector<Says>{{steps, wall_over}},
                                                       "how many steps are to come", check)) {
        steps = std::min(steps, theirs[0].steps);
        wall_over = wall_over || theirs[0].over != 0;
    }
}

/// Which slots of a table others may hold too: those beside a block that another rank owns, or two
/// away from one where a rank holds all fields around what its homes reach. With `all`, every one.
/// Returns how many.
template <class X, class T, int D>
std::uint32_t Domain<X, T, D>::flag_border(const Buffer<X, std::uint64_t>& keys, bool all,
                                           Buffer<X, std::uint32_t>& flag,
                                           Buffer<X, std::uint32_t>& position) {
    const RankShare<D>& s = *share_;
    const std::int64_t slots = std::int64_t(keys.size());
    flag.reserve_discard(std::size_t(slots));
    position.reserve_discard(std::size_t(slots) + 1);
    // Whoever has a block of one side of a mirrored wall has that of the other.
    FlagBorder<D> border{table_.keys_of,
                         keys.data(),
                         {},
                         s.rank(),
                         all || !s.together.empty(),
                         spec_.contact.any() ? 2 : 1,
                         flag.data()};
    border.cuts = RowCuts<D>(s.partition);
    exec_.for_each(slots, border);
    exec_.exclusive_scan(flag.data(), position.data(), slots);
    std::uint32_t n = 0;
    exec_.download(&n, position.data() + slots, sizeof n);
    return n;
}

/// These slots.
template <class X, class T, int D>
std::vector<HeldBlock> Domain<X, T, D>::list_held(const Buffer<X, std::uint64_t>& keys, bool all) {
    Buffer<X, std::uint32_t> flag(exec_), position(exec_);
    Buffer<X, HeldBlock> list(exec_);
    list.reserve_discard(flag_border(keys, all, flag, position));
    const std::int64_t slots = std::int64_t(keys.size());
    exec_.for_each(slots, ListHeld<D>{table_.keys_of, keys.data(), std::int32_t(slots), flag.data(),
                                      position.data(), list.data(), reached_blocks()});
    return list.host();
}

/// The same of all ranks, which call it together.
template <class X, class T, int D>
std::vector<std::vector<HeldBlock>> Domain<X, T, D>::gather_held(
    const Buffer<X, std::uint64_t>& keys, bool all) {
    const std::uint64_t below = checks::keys_below(table_.keys_of);
    return share_->comm->all_gather(
        list_held(keys, all), "blocks that it holds",
        [&](const std::vector<HeldBlock>& theirs, int) { checks::held_blocks(theirs, below); });
}

/// Who holds what of the present table. `held`: of everyone's.
template <class X, class T, int D>
void Domain<X, T, D>::link_devices(std::vector<std::vector<HeldBlock>> held) {
    RankShare<D>& s = *share_;
    s.held = std::move(held);
    const std::size_t slots = std::size_t(table_.slots);
    shared_.reserve_discard(slots);
    counts_.reserve_discard(slots);
    ready_.reserve_discard(slots);
    exec_.for_each(std::int64_t(slots), Constant<std::uint8_t>{0, shared_.data()});
    exec_.for_each(std::int64_t(slots), Constant<std::uint8_t>{1, counts_.data()});
    find_owners();
    exec_.for_each(std::int64_t(slots),
                   FlagReady<D>{blocks_.neighbours().data(), owner_.data(), s.rank(), ready_.data(),
                                table_.keys_of, table_.keys, reached_blocks()});
    Buffer<X, std::uint32_t> found(exec_);  // blocks that others hold too
    found.assign({0});
    Buffer<X, HeldBlock> theirs(exec_);
    for (int r : s.comm->others()) {
        theirs.assign(s.held[std::size_t(r)]);
        exec_.for_each(
            std::int64_t(theirs.size()),
            LinkHeld<X>{table_.keys, table_.slots, theirs.data(), r < s.rank(), owner_.data(), r,
                        shared_.data(), counts_.data(), ready_.data(), found.data()});
    }
    s.shared_blocks = found.host()[0];
    if (spec_.contact.any()) count_reached();
    list_shared();
    s.counts = counts_.host();
    link_points();
    list_measured();
    list_contacts();
}

/// Homes, and who shares what, after the table was made anew but for sorts. All ranks together.
template <class X, class T, int D>
void Domain<X, T, D>::link_homes() {
    if constexpr (X::is_device) {
        if (share_ && spec_.contact.any()) tell_reached_by_homes();
        if (share_) link_devices(gather_held(blocks_.keys(), false));
        list_homes(find_homes());
    } else {
        list_homes(find_homes());
        if (share_) link_ranks(gather_tables(blocks_.keys()));
    }
}

/// Where everyone keeps its sums now. All ranks together, whenever they may have moved.
template <class X, class T, int D>
void Domain<X, T, D>::link_sums() {
    if constexpr (X::is_device) {
        if (!reaches()) return;
        const RankShare<D>& s = *share_;
        using Both = std::array<Sum*, 2>;
        sums_of_.clear();
        for (const Both& theirs :
             s.comm->tell(Both{sums_[0].data(), sums_[1].data()}, "where sums are"))
            sums_of_.push_back(theirs);
    }
}

}  // namespace mpm
