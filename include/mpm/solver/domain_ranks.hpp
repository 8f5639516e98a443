// Domain: one rank of several. Within a step ranks meet when sums are complete and before the clock
// decides, and once more for each sum that a step reads itself. Everything else, readers included,
// is each rank's own.
#pragma once

#include <cstring>
#include <map>
#include <numeric>
#include <tuple>

#include "mpm/kernels/staging.hpp"
#include "mpm/solver/domain.hpp"
#include "mpm/solver/rank_checks.hpp"
#include "mpm/solver/rank_fields.hpp"

namespace mpm {

/// The keys of everyone's table. All ranks together.
template <class X, class T, int D>
std::vector<std::vector<std::uint64_t>> Domain<X, T, D>::gather_tables(
    const Buffer<X, std::uint64_t>& keys) {
    const std::uint64_t below = checks::keys_below(table_.keys_of);
    return share_->comm->all_gather(
        keys.host(), "a table",
        [&](const std::vector<std::uint64_t>& theirs, int) { checks::table_keys(theirs, below); });
}

/// Tables by what each rank's homes reach become those that ranks hold where bodies have fields of
/// velocities of their own.
template <class X, class T, int D>
void Domain<X, T, D>::hold_all_fields(std::vector<std::vector<std::uint64_t>>& tables) const {
    if (!spec_.contact.any()) return;
    std::vector<std::uint64_t> all;
    for (const auto& table : tables) all.insert(all.end(), table.begin(), table.end());
    std::sort(all.begin(), all.end());
    all.erase(std::unique(all.begin(), all.end()), all.end());
    for (auto& table : tables) table = table_of_fields(table_.keys_of, table, all);
}

/// Which blocks each rank's homes reach: there it knows all that contact needs, and the lowest such
/// rank counts a block. All ranks together.
template <class X, class T, int D>
void Domain<X, T, D>::tell_reached() {
    RankShare<D>& s = *share_;
    std::vector<std::uint64_t> keys;
    for (const Body& body : bodies_) {
        for (std::int32_t h = 0; h < body.homes; ++h) {
            const std::int32_t* around = blocks_.neighbours().data() +
                                         std::size_t(body.home.data()[h]) * Block<D>::neighbours;
            for (int n = 0; n < Block<D>::neighbours; ++n)
                if (around[n] >= 0) keys.push_back(table_.keys[around[n]]);
        }
    }
    const std::uint64_t below = checks::keys_below(table_.keys_of);
    s.reached = s.comm->all_gather(
        blocks_of_slots(table_.keys_of, keys), "blocks that are reached",
        [&](const std::vector<std::uint64_t>& theirs, int) { checks::table_keys(theirs, below); });
    const std::size_t slots = std::size_t(table_.slots);
    for (std::size_t slot = 0; slot < slots; ++slot) {
        const std::uint64_t block = table_.keys_of.of_block(table_.keys[slot]);
        int first = 0;
        while (first < s.ranks() && !detail::holds(s.reached[std::size_t(first)], block)) ++first;
        s.counts[slot] = first == s.rank();
    }
}

/// Who holds what of the present table, and with it where sums go. `keys`: of everyone's table.
template <class X, class T, int D>
void Domain<X, T, D>::link_ranks(std::vector<std::vector<std::uint64_t>> keys) {
    RankShare<D>& s = *share_;
    s.keys = std::move(keys);
    const int me = s.rank(), ranks = s.ranks();
    const std::size_t slots = std::size_t(table_.slots);
    std::vector<std::vector<std::int32_t>> common(s.keys.size());  // the same blocks on both sides
    std::vector<std::uint8_t> is_shared(slots, 0);
    s.counts.assign(slots, 1);
    s.peers.clear();
    for (int r = 0; r < ranks; ++r) {
        if (r == me) continue;
        auto& list = common[std::size_t(r)];
        const auto& theirs = s.keys[std::size_t(r)];
        std::size_t k = 0;
        for (std::size_t slot = 0; slot < slots; ++slot) {
            while (k < theirs.size() && theirs[k] < table_.keys[slot]) ++k;
            if (k == theirs.size()) break;
            if (theirs[k] != table_.keys[slot]) continue;
            list.push_back(std::int32_t(slot));
            is_shared[slot] = 1;
            if (r < me) s.counts[slot] = 0;
        }
        if (!list.empty()) s.peers.push_back(r);
    }
    if (spec_.contact.any()) tell_reached();
    counts_.assign(s.counts);
    s.shared.clear();
    for (std::size_t slot = 0; slot < slots; ++slot)
        if (is_shared[slot]) s.shared.push_back(std::int32_t(slot));

    // A slot behind the table for all blocks of one body and colour that add to a shared block.
    using Staged = typename RankShare<D>::Staged;
    s.parts.clear();
    s.staged = 0;
    s.staged_of.assign(1, 0);
    s.destinations.assign(bodies_.size(), {});
    std::vector<std::int32_t> stage(slots, -1);
    for (std::size_t b = 0; b < bodies_.size(); ++b) {
        const Body& body = bodies_[b];
        auto& to = s.destinations[b];
        to.assign(blocks_.neighbours().data(),
                  blocks_.neighbours().data() + slots * Block<D>::neighbours);
        for (std::size_t colour = 0; colour + 1 < body.colour_start.size(); ++colour) {
            const std::size_t first = s.parts.size();
            for (std::int32_t k = body.colour_start[colour]; k < body.colour_start[colour + 1];
                 ++k) {
                std::int32_t* row =
                    to.data() + std::size_t(body.coloured.data()[k]) * Block<D>::neighbours;
                for (int side = 0; side < Block<D>::neighbours; ++side) {
                    const std::int32_t slot = row[side];
                    if (slot < 0 || !is_shared[std::size_t(slot)]) continue;
                    std::int32_t& at = stage[std::size_t(slot)];
                    if (at < 0) {
                        at = table_.slots + s.staged++;
                        s.parts.push_back({slot, std::int32_t(b), std::int32_t(colour), me, at});
                    }
                    row[side] = at;
                }
            }
            for (std::size_t k = first; k < s.parts.size(); ++k)
                stage[std::size_t(s.parts[k].slot)] = -1;
        }
        s.staged_of.push_back(s.staged);
    }

    // Everyone learns what the messages of each step will hold.
    const auto by_body = [&](const std::vector<Staged>& list) {
        std::vector<std::size_t> first(bodies_.size() + 1, 0);
        for (const Staged& part : list) ++first[std::size_t(part.body) + 1];
        std::partial_sum(first.begin(), first.end(), first.begin());
        return first;
    };
    s.send.assign(s.keys.size(), {});
    s.send_of.assign(s.keys.size(), {});
    s.receive_of.assign(s.keys.size(), {});
    std::vector<Bytes> out(s.keys.size());
    const std::size_t own = s.parts.size();
    for (int r : s.peers) {
        const auto& list = common[std::size_t(r)];
        std::vector<Staged> told;
        for (std::size_t k = 0; k < own; ++k) {
            const Staged& part = s.parts[k];
            const auto found = std::lower_bound(list.begin(), list.end(), part.slot);
            if (found == list.end() || *found != part.slot) continue;
            told.push_back({std::int32_t(found - list.begin()), part.body, part.colour, me,
                            std::int32_t(told.size())});
            s.send[std::size_t(r)].push_back(part.at);
        }
        s.send_of[std::size_t(r)] = by_body(told);
        Packer packer;
        packer.put(told);
        out[std::size_t(r)] = packer.take();
    }
    std::vector<int> colours;
    for (const Body& body : bodies_) colours.push_back(int(body.colour_start.size()) - 1);
    std::vector<std::vector<Staged>> told(s.keys.size());
    s.comm->exchange_and_read(
        std::move(out), s.peers, "parts of shared blocks", [&](int r, Unpacker& from) {
            auto parts = from.list<Staged>();
            checks::staged_parts(parts, common[std::size_t(r)].size(), colours, r);
            told[std::size_t(r)] = std::move(parts);
        });
    for (int r : s.peers) {
        s.receive_of[std::size_t(r)] = by_body(told[std::size_t(r)]);
        for (Staged part : told[std::size_t(r)]) {
            part.slot = common[std::size_t(r)][std::size_t(part.slot)];
            s.parts.push_back(part);
        }
    }
    std::sort(s.parts.begin(), s.parts.end(), [](const Staged& a, const Staged& b) {
        return std::tie(a.slot, a.body, a.colour, a.rank) <
               std::tie(b.slot, b.body, b.colour, b.rank);
    });
    s.first_part.assign(s.shared.size() + 1, s.parts.size());
    for (std::size_t k = 0, part = 0; k < s.shared.size(); ++k) {
        s.first_part[k] = part;
        while (part < s.parts.size() && s.parts[part].slot == s.shared[k]) ++part;
    }

    const std::size_t block = std::size_t(plan_.sum_channels) * block_cells;
    for (auto& sums : sums_) {
        const std::size_t before = std::min(sums.size(), slots * block),
                          size = (slots + std::size_t(s.staged)) * block;
        Buffer<X, Sum> larger(exec_);
        larger.reserve_discard(size);
        exec_.copy(larger.data(), sums.data(), before * sizeof(Sum));
        exec_.zero(larger.data() + before, (size - before) * sizeof(Sum));
        sums.swap(larger);
    }
    list_measured();
    list_contacts();
}

/// What ranks have staged of the bodies from `first` to before `last`, `size` numbers a block,
/// comes to all who hold a block, and everyone adds it up in the same order: add(part, to, from).
template <class X, class T, int D>
template <class Number, class Add>
void Domain<X, T, D>::add_up_staged(const char* what, Number* blocks, std::size_t size,
                                    std::size_t first, std::size_t last, const Add& add) {
    RankShare<D>& s = *share_;
    std::vector<Bytes> out(s.keys.size());
    for (int r : s.peers) {
        Bytes& bytes = out[std::size_t(r)];
        const auto& begins = s.send_of[std::size_t(r)];
        const std::int32_t* list = s.send[std::size_t(r)].data() + begins[first];
        const std::size_t count = begins[last] - begins[first];
        bytes.resize(count * size * sizeof(Number));
        for (std::size_t k = 0; k < count; ++k) {
            std::memcpy(bytes.data() + k * size * sizeof(Number),
                        blocks + std::size_t(list[k]) * size, size * sizeof(Number));
        }
        s.bytes_of_sums += bytes.size();
    }
    const auto in =
        s.comm->exchange_and_read(std::move(out), s.peers, what, [&](int r, Unpacker& from) {
            const auto& begins = s.receive_of[std::size_t(r)];
            from.leave((begins[last] - begins[first]) * size * sizeof(Number));
        });
    exec_.for_each_large(std::int64_t(s.shared.size()), [&](std::int64_t k) {
        for (std::size_t p = s.first_part[std::size_t(k)]; p < s.first_part[std::size_t(k) + 1];
             ++p) {
            const auto& part = s.parts[p];
            if (std::size_t(part.body) < first || std::size_t(part.body) >= last) continue;
            const std::size_t at = std::size_t(part.at), rank = std::size_t(part.rank);
            const Number* from = part.rank == s.rank()
                                     ? blocks + at * size
                                     : reinterpret_cast<const Number*>(in[rank].data()) +
                                           (at - s.receive_of[rank][first]) * size;
            add(part, blocks + std::size_t(part.slot) * size, from);
        }
    });
}

template <class X, class T, int D>
void Domain<X, T, D>::end_of_sums(int parity, Added added) {
    const std::size_t block = std::size_t(plan_.sum_channels) * block_cells;
    Sum* sums = sums_[parity].data();
    const auto add = [&](const auto& part, Sum* to, const Sum* from) {
        const Body& body = bodies_[std::size_t(part.body)];
        const bool spread = added == Added::in_step ? body.plan.pipeline == Pipeline::phased
                                                    : body.plan.any_transfer();
        add_staged<Sum>(to, from, spread ? Sum(1) : Sum(body.particle_mass), block,
                        added == Added::at_rest);
    };
    add_up_staged("sums", sums, block, 0, bodies_.size(), add);
    exec_.zero(sums + std::size_t(table_.slots) * block,
               std::size_t(share_->staged) * block * sizeof(Sum));
}

/// Of one body that ranks share: what cells sum up of its particles.
template <class X, class T, int D>
struct Domain<X, T, D>::PeersOfBody final : StagedPeers {
    Domain& domain;
    std::size_t body;

    PeersOfBody(Domain& of, std::size_t number) : domain(of), body(number) {}
    void complete(double* cells, std::size_t width) override {
        const std::size_t size = width * block_cells;
        domain.add_up_staged("sums over cells", cells, size, body, body + 1,
                             [&](const auto&, double* to, const double* from) {
                                 for (std::size_t k = 0; k < size; ++k) to[k] += from[k];
                             });
    }
    void add_up(SmoothingTotals& totals) override {
        const auto all = domain.share_->comm->tell(totals, "what smoothing has changed");
        totals = {};
        for (const SmoothingTotals& of_rank : all) totals.add(of_rank);
    }
};

/// Blocks are dealt anew where the work has become too uneven: by all ranks alike, from what all
/// have told. `load`: particles that stand in each slot now.
template <class X, class T, int D>
void Domain<X, T, D>::rebalance(const std::vector<std::uint64_t>& load) {
    RankShare<D>& s = *share_;
    std::vector<BlockWeight> blocks;
    for (std::size_t slot = 0; slot < load.size(); ++slot)
        if (load[slot] > 0) blocks.push_back({table_.keys[slot], load[slot] + weight_of_block});
    if (s.seconds) weigh_by_time(blocks);
    s.loads.assign(s.keys.size(), 0);
    for (const auto& theirs : s.comm->all_gather_alike(loads_of(s.partition, blocks), "loads"))
        for (std::size_t r = 0; r < theirs.size(); ++r) s.loads[r] += theirs[r];
    const double was = imbalance(s.loads);
    if (was > s.rebalance_above) deal_anew(blocks, was);
}

/// Weights of this rank's blocks, by what a weight has cost the ranks that own them.
template <class X, class T, int D>
void Domain<X, T, D>::weigh_by_time(std::vector<BlockWeight>& blocks) {
    RankShare<D>& s = *share_;
    // As many steps on all ranks.
    if (s.worked.size() >= CostRates::fewest_steps) {
        StepCost mine{usual_nanoseconds(std::move(s.worked)), 0};
        s.worked.clear();
        for (const BlockWeight& b : blocks) mine.weight += b.weight;
        s.costs.tell(s.comm->tell(mine, "what a step has cost"));
    }
    for (BlockWeight& b : blocks) b.weight *= s.costs.of(s.partition.owner(b.key));
}

/// `blocks`: of this rank, `was`: how uneven the present cuts are; all ranks together.
template <class X, class T, int D>
void Domain<X, T, D>::deal_anew(const std::vector<BlockWeight>& blocks, double was) {
    RankShare<D>& s = *share_;
    std::vector<BlockWeight> all;
    const std::uint64_t below = checks::keys_below(table_.keys_of);
    for (const auto& theirs : s.comm->all_gather(
             blocks, "weights of blocks",
             [&](const std::vector<BlockWeight>&list, int) { checks::block_weights(list, below); }))
        all.insert(all.end(), theirs.begin(), theirs.end());
    if (!recut(s.partition, all, s.rebalance_above, was)) return;
    s.loads = loads_of(s.partition, all);
    ++s.rebalances;
}

}  // namespace mpm
