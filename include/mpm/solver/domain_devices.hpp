// Domain: one rank of several on devices. What a block's particles add goes to all who hold the
// block, straight into their memory while the pass runs (Copies); integers end alike everywhere. So
// ranks only have to wait for each other twice a step: when the votes are there, by which also the
// sums to come are cleared, and when the sums are complete.
#pragma once

#include "mpm/solver/domain.hpp"

namespace mpm {

/// Counts the nodes of other ranks' blocks that a home's arena reaches.
template <class X, int D>
struct CountShared {
    const std::int32_t* home;
    const std::int32_t* neighbours;
    const std::int32_t* copies;
    int others;
    std::uint32_t* nodes;
    MPM_INLINE void operator()(std::int64_t h) const {
        const std::int32_t* row = neighbours + std::int64_t(home[h]) * Block<D>::neighbours;
        std::uint32_t found = 0;
        for (int n = 0; n < Block<D>::neighbours; ++n) {
            int rest = n, reached = 1;
            for (int a = 0; a < D; ++a) {
                reached *= rest % 3 == 1 ? Block<D>::edge : Block<D>::margin;
                rest /= 3;
            }
            for (int o = 0; o < others; ++o)
                if (copies[std::int64_t(row[n]) * others + o] >= 0) found += std::uint32_t(reached);
        }
        if (found > 0) X::fetch_add(nodes, found);
    }
};

/// Where ranks vote, and how they wait for each other. All ranks together.
template <class X, class T, int D>
void Domain<X, T, D>::open_devices() {
    if constexpr (X::is_device) {
        Communicator& comm = *share_->comm;
        meeting_ = std::make_unique<typename X::Meeting>(exec_, comm);
        votes_.assign(std::vector<RankVote>(std::size_t(comm.ranks()), RankVote{}));
        std::vector<RankVote*> boxes;
        for (const auto& theirs : comm.all_gather(std::vector<RankVote*>{votes_.data()}))
            boxes.push_back(theirs.at(0));
        boxes_.assign(boxes);
    }
}

/// Until what every rank has queued is done. Nothing where this is the only one.
template <class X, class T, int D>
void Domain<X, T, D>::meet_hosts() {
    if (!share_) return;
    exec_.wait();
    share_->comm->all_gather(std::vector<int>{1});
}

template <class X, class T, int D>
double Domain<X, T, D>::largest_of_all(double x) const {
    if (!share_) return x;
    for (const auto& theirs : share_->comm->all_gather(std::vector<double>{x}))
        x = std::max(x, theirs.at(0));
    return x;
}

/// How many steps all ranks queue, and whether the time of any is over.
template <class X, class T, int D>
void Domain<X, T, D>::run_together(std::int64_t& steps, bool& wall_over) {
    struct Says {
        std::int64_t steps;
        std::int64_t over;
    };
    for (const auto& theirs : share_->comm->all_gather(std::vector<Says>{{steps, wall_over}})) {
        steps = std::min(steps, theirs.at(0).steps);
        wall_over = wall_over || theirs.at(0).over != 0;
    }
}

/// Who holds what of the present table. `keys`: of everyone's table.
template <class X, class T, int D>
void Domain<X, T, D>::link_devices(std::vector<std::vector<std::uint64_t>> keys) {
    RankShare<D>& s = *share_;
    s.keys = std::move(keys);
    const int me = s.rank(), ranks = s.ranks();
    const auto& mine = s.keys[std::size_t(me)];
    const std::size_t slots = mine.size(), others = std::size_t(ranks - 1);
    std::vector<std::int32_t> copies(slots * others, -1);
    s.counts.assign(slots, 1);
    s.peers.clear();
    std::vector<std::uint8_t> is_shared(slots, 0);
    std::size_t other = 0;
    for (int r = 0; r < ranks; ++r) {
        if (r == me) continue;
        const auto& theirs = s.keys[std::size_t(r)];
        bool any = false;
        for (std::size_t slot = 0, k = 0; slot < slots && k < theirs.size();) {
            if (theirs[k] < mine[slot]) {
                ++k;
            } else if (mine[slot] < theirs[k]) {
                ++slot;
            } else {
                copies[slot * others + other] = std::int32_t(k);
                is_shared[slot] = 1;
                if (r < me) s.counts[slot] = 0;
                any = true;
                ++slot;
                ++k;
            }
        }
        if (any) s.peers.push_back(r);
        ++other;
    }
    s.shared.clear();
    for (std::size_t slot = 0; slot < slots; ++slot)
        if (is_shared[slot]) s.shared.push_back(std::int32_t(slot));
    copies_.assign(copies);
    counts_.assign(s.counts);
    Buffer<X, std::uint32_t> nodes(exec_);
    nodes.assign({0});
    for (const Body& body : bodies_) {
        exec_.for_each(body.homes, CountShared<X, D>{body.home.data(), neighbours_.data(),
                                                     copies_.data(), int(others), nodes.data()});
    }
    s.bytes_a_step =
        std::uint64_t(nodes.host()[0]) * std::uint64_t(plan_.sum_channels) * sizeof(Sum);
    if (load_count_ > 0) list_measured();
}

/// Where everyone keeps its sums now. All ranks together, whenever they may have moved.
template <class X, class T, int D>
void Domain<X, T, D>::link_sums() {
    if constexpr (X::is_device) {
        const RankShare<D>& s = *share_;
        using Both = std::array<Sum*, 2>;
        const auto told = s.comm->all_gather(std::vector<Both>{{sums_[0].data(), sums_[1].data()}});
        std::vector<Copies<Sum>> copies(2);
        for (int p = 0; p < 2; ++p) {
            copies[std::size_t(p)].slot = copies_.data();
            copies[std::size_t(p)].others = s.ranks() - 1;
            int other = 0;
            for (int r : s.comm->others())
                copies[std::size_t(p)].sums[other++] = told[std::size_t(r)].at(0)[std::size_t(p)];
        }
        copies_of_sums_.assign(copies);
    }
}

}  // namespace mpm
