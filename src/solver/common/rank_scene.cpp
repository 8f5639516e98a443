#include "mpm/solver/rank_scene.hpp"

#include <algorithm>
#include <memory>
#include <unordered_map>
#include <utility>

#include "mpm/kernels/placing.hpp"
#include "mpm/solver/blob.hpp"
#include "mpm/solver/rank_fields.hpp"
#include "mpm/solver/saved_clock.hpp"

namespace mpm {

namespace detail {

/// Of other ranks: what ranks add up is the first one's.
inline void first_ranks_alone(std::vector<double>& values) {
    for (double& v : values) v = v == v ? 0.0 : v;
}

/// Rows of a body that a thread holds at a time.
inline constexpr std::uint64_t rows_at_once = std::uint64_t(1) << 18;

template <int D>
std::vector<std::uint64_t> keys_of_rows(const Spec& spec, const BodySpec& body,
                                        const BlockKeys<D>& keys, std::uint64_t first,
                                        std::uint64_t last) {
    std::int64_t cells[D];
    for (int a = 0; a < D; ++a) cells[a] = spec.cells[std::size_t(a)];
    std::vector<double> x((last - first) * D);
    body.position(first, last, x.data());
    std::vector<std::uint64_t> out(last - first);
    for (std::uint64_t k = 0; k < out.size(); ++k) {
        std::int64_t c[D];
        if (!cell_of<D>(x.data() + k * D, spec.cell_size, cells, c))
            for (std::int64_t& at : c) at = 0;
        for (std::int64_t& at : c) at /= Block<D>::edge;
        out[k] = keys.key(c);
    }
    return out;
}

/// What `make(first row, keys of it and those that follow)` says of a body's rows, piece by piece,
/// to `take` in their order. Pieces are worked on side by side.
template <int D, class Make, class Take>
void walk_rows(const Spec& spec, const BodySpec& body, const BlockKeys<D>& keys, const Make& make,
               const Take& take) {
    using Made = decltype(make(std::uint64_t(0), std::vector<std::uint64_t>()));
    const std::uint64_t pieces = (body.count + rows_at_once - 1) / rows_at_once,
                        together = body.position.at_hand ? 2 * most_threads() : 1;
    std::vector<Made> made;
    for (std::uint64_t next = 0; next < pieces; next += together) {
        made.clear();
        made.resize(std::min(together, pieces - next));
        in_parallel(made.size(), 1, [&](std::uint64_t from, std::uint64_t to) {
            for (std::uint64_t k = from; k < to; ++k) {
                const std::uint64_t first = (next + k) * rows_at_once,
                                    last = std::min(first + rows_at_once, body.count);
                made[k] = make(first, keys_of_rows<D>(spec, body, keys, first, last));
            }
        });
        for (Made& m : made) take(m);
    }
}

}  // namespace detail

template <int D>
BlockPartition<D> first_partition(const BlockKeys<D>& keys, const RanksSpec& ranks,
                                  std::vector<BlockWeight> blocks,
                                  const std::vector<GroupWeight>& groups,
                                  const BlockPartition<D>* present) {
    const int axis = present ? present->axis() : ranks.axis;
    if (axis == RanksSpec::chosen && ranks.grouped)
        return choose_for_groups<D>(keys, std::move(blocks), groups, ranks.count);
    if (axis == RanksSpec::chosen)
        return choose_partition<D>(keys, std::move(blocks), ranks.count, ranks.rebalance_above);
    BlockPartition<D> partition(keys, axis);
    if (!ranks.planes.empty())
        partition.cut_at(ranks.planes);
    else if (ranks.grouped)
        cut_by_groups(partition, groups, ranks.count);
    else
        partition.cut(blocks, ranks.count);
    return partition;
}

template <int D>
RankScenes<D>::RankScenes(const Spec& scene, int only) {
    const BlockKeys<D> keys = keys_of_domain<D>(scene);
    using Counts = std::unordered_map<std::uint64_t, std::uint64_t>;
    const std::size_t groups = scene.ranks.grouped ? std::size_t(scene.ranks.count) : 1;
    std::vector<Counts> weight(groups);
    for (const BodySpec& body : scene.bodies) {
        const auto group = [&](std::uint64_t row) {
            return groups == 1 ? 0 : group_of(body, body.ids.empty() ? row : body.ids[row]);
        };
        detail::walk_rows<D>(
            scene, body, keys,
            [&](std::uint64_t first, const std::vector<std::uint64_t>& of) {
                // Particles that follow each other mostly stand in one block.
                std::vector<Counts> counts(groups);
                std::uint64_t* here = nullptr;
                int last = -1;
                for (std::size_t k = 0; k < of.size(); ++k) {
                    const int g = group(first + k);
                    if (k == 0 || of[k] != of[k - 1] || g != last)
                        here = &counts[std::size_t(g)][of[k]];
                    last = g;
                    ++*here;
                }
                return counts;
            },
            [&](const std::vector<Counts>& counts) {
                for (std::size_t g = 0; g < groups; ++g)
                    for (const auto& [key, particles] : counts[g]) weight[g][key] += particles;
            });
    }
    Counts all;
    std::vector<GroupWeight> grouped;
    for (std::size_t g = 0; g < groups; ++g) {
        for (const auto& [key, particles] : weight[g]) {
            all[key] += particles;
            if (scene.ranks.grouped) grouped.push_back({key, int(g), particles});
        }
    }
    std::vector<BlockWeight> blocks;
    for (const auto& [key, particles] : all) blocks.push_back({key, particles + weight_of_block});
    partition = first_partition<D>(keys, scene.ranks, std::move(blocks), grouped);

    spec.assign(std::size_t(scene.ranks.count), scene);
    for (std::size_t r = 1; r < spec.size(); ++r) {
        detail::first_ranks_alone(spec[r].start.sensor_first);
        detail::first_ranks_alone(spec[r].start.load_impulse);
    }
    for (Spec& s : spec) {
        for (InletSpec& inlet : s.inlets)  // ids go on above those of all ranks
            inlet.next_id = std::max(inlet.next_id, scene.bodies.at(std::size_t(inlet.body)).count);
    }
    for (std::size_t b = 0; b < scene.bodies.size(); ++b) {
        const BodySpec& body = scene.bodies[b];
        struct Run {
            std::uint64_t first, last;
            int owner;
        };
        std::vector<std::shared_ptr<RowRuns>> rows(spec.size());
        for (auto& r : rows) r = std::make_shared<RowRuns>();
        detail::walk_rows<D>(
            scene, body, keys,
            [&](std::uint64_t first, const std::vector<std::uint64_t>& of) {
                std::vector<Run> runs;
                for (std::size_t k = 0; k < of.size(); ++k) {
                    if (k > 0 && of[k] == of[k - 1]) {
                        ++runs.back().last;
                        continue;
                    }
                    const int owner = partition.owner(of[k]);
                    if (k == 0 || owner != runs.back().owner)
                        runs.push_back({first + k, first + k, owner});
                    ++runs.back().last;
                }
                return runs;
            },
            [&](const std::vector<Run>& runs) {
                for (const Run& r : runs)
                    if (only < 0 || r.owner == only)
                        rows[std::size_t(r.owner)]->add(r.first, r.last);
            });
        for (std::size_t r = 0; r < spec.size(); ++r) {
            BodySpec& own = spec[r].bodies[b];
            own.count = rows[r]->count();
            own.id_count = ids_of(body);
            own.ids.resize(own.count);
            rows[r]->each(0, own.count,
                          [&](std::uint64_t row, std::uint64_t n, std::uint64_t place) {
                              for (std::uint64_t k = 0; k < n; ++k)
                                  own.ids[place + k] =
                                      body.ids.empty() ? std::uint32_t(row + k) : body.ids[row + k];
                          });
            if (!body.elements.empty()) own.all_vertices = body.position;
            own.position = chosen_rows(body.position, rows[r], D);
            own.pressure = chosen_rows(body.pressure, rows[r], 1);
            own.state = chosen_rows(body.state, rows[r], body.state_width);
        }
    }
}

std::vector<BlockWeight> weigh_state(const State& all, std::size_t bodies) {
    const auto keys = detail::from_blob<std::uint64_t>(all, "keys");
    std::vector<BlockWeight> blocks;
    for (std::uint64_t key : keys) blocks.push_back({key, 0});
    for (std::size_t b = 0; b < bodies; ++b) {
        const auto start =
            detail::from_blob<std::uint32_t>(all, "body" + std::to_string(b) + "_cell_start");
        for (std::size_t k = 0; k < blocks.size(); ++k)
            blocks[k].weight += start.at((k + 1) * block_cells) - start.at(k * block_cells);
    }
    for (BlockWeight& block : blocks)
        if (block.weight > 0) block.weight += weight_of_block;
    return blocks;
}

std::vector<GroupWeight> group_state(const State& all, const std::vector<BodySpec>& bodies) {
    const auto keys = detail::from_blob<std::uint64_t>(all, "keys");
    std::vector<GroupWeight> out;
    for (std::size_t b = 0; b < bodies.size(); ++b) {
        const std::string p = "body" + std::to_string(b) + "_";
        const auto start = detail::from_blob<std::uint32_t>(all, p + "cell_start"),
                   id = detail::from_blob<std::uint32_t>(all, p + "id");
        for (std::size_t k = 0; k < keys.size(); ++k) {
            const std::size_t before = out.size();
            for (std::size_t q = start.at(k * block_cells); q < start.at((k + 1) * block_cells);
                 ++q) {
                const int group = group_of(bodies[b], id.at(q));
                std::size_t w = before;
                while (w < out.size() && out[w].group != group) ++w;
                if (w == out.size()) out.push_back({keys[k], group, 0});
                ++out[w].particles;
            }
        }
    }
    return out;
}

template <int D>
State share_of_state(const State& all, std::size_t bodies, const BlockPartition<D>& partition,
                     const BlockKeys<D>& keys_of, const BlocksTogether& together, int rank) {
    const auto keys = detail::from_blob<std::uint64_t>(all, "keys");
    const auto blocks = weigh_state(all, bodies);
    std::vector<bool> own(keys.size(), false), kept(keys.size(), false);
    std::vector<std::uint64_t> table;
    for (std::size_t k = 0; k < keys.size(); ++k) {
        own[k] = blocks[k].weight > 0 && partition.owner(keys[k]) == rank;
        if (!own[k]) continue;
        std::int64_t at[D];
        keys_of.block(keys[k], at);
        for (int n = 0; n < Block<D>::neighbours; ++n) {
            std::int64_t b[D];
            keys_of.beside(at, n, b);
            table.push_back(keys_of.key(b, keys_of.field(keys[k])));
        }
    }
    add_together<D>(keys_of, together, table);
    if (keys_of.fields > 1) table = table_of_fields(keys_of, table, keys);
    for (std::size_t k = 0; k < keys.size(); ++k)
        kept[k] = std::binary_search(table.begin(), table.end(), keys[k]);
    // Rows of a blob, `per` elements each, of those blocks or particles that are chosen.
    const auto choose = [&](const std::string& name, const auto& ranges, std::size_t per) {
        const Blob& from = detail::find(all, name);
        Blob to;
        to.type = from.type;
        const std::size_t rows = from.shape.at(0) / per,
                          size = rows == 0 ? 0 : from.bytes.size() / rows;
        for (const auto& [first, last] : ranges) {
            to.bytes.insert(to.bytes.end(), from.bytes.begin() + std::ptrdiff_t(first * size),
                            from.bytes.begin() + std::ptrdiff_t(last * size));
        }
        to.shape = {size == 0 ? 0 : to.bytes.size() / size * per};
        return to;
    };
    using Ranges = std::vector<std::pair<std::size_t, std::size_t>>;
    Ranges of_blocks;
    for (std::size_t k = 0; k < keys.size(); ++k)
        if (kept[k]) of_blocks.emplace_back(k, k + 1);

    State s = all;
    const std::size_t channels =
        std::size_t(detail::from_blob<std::int32_t>(all, "sum_channels").at(0));
    s["keys"] = choose("keys", of_blocks, 1);
    s["sums"] = choose("sums", of_blocks, channels * block_cells);
    for (std::size_t b = 0; b < bodies; ++b) {
        const std::string p = "body" + std::to_string(b) + "_";
        const auto start = detail::from_blob<std::uint32_t>(all, p + "cell_start");
        Ranges of_particles;
        std::vector<std::uint32_t> cell_start = {0};
        for (std::size_t k = 0; k < keys.size(); ++k) {
            if (!kept[k]) continue;
            const std::size_t first = start[k * block_cells], last = start[(k + 1) * block_cells];
            if (own[k]) of_particles.emplace_back(first, last);
            const std::uint32_t before = cell_start.back();
            for (std::size_t c = 1; c <= block_cells; ++c)
                cell_start.push_back(
                    own[k] ? before + (start[k * block_cells + c] - std::uint32_t(first)) : before);
        }
        for (const auto& [name, blob] : all) {
            if (name.rfind(p, 0) != 0) continue;
            const std::string column = name.substr(p.size());
            const bool frozen = column.rfind("frozen", 0) == 0;
            if (column == "cell_start")
                s[name] = detail::to_blob(cell_start);
            else if (column == "elements")
                continue;  // all ranks take what elements keep, of all
            else if (!frozen)
                s[name] = choose(name, of_particles, 1);
            else if (rank > 0)  // the first rank lists them
                s[name] = choose(name, Ranges{}, 1);
        }
    }
    if (rank > 0) {
        Clock clock = saved_clock(all);
        clock.strays = 0;
        save_clock(s, clock);
        for (const char* name :
             {"load_impulse", "contact_impulse", "pin_impulse", "sensor_first"}) {
            if (!all.contains(name)) continue;
            auto values = detail::from_blob<double>(all, name);
            detail::first_ranks_alone(values);
            s[name] = detail::to_blob(values);
        }
    }
    return s;
}

#define MPM_RANK_SCENE(D)                                                                 \
    template std::vector<std::uint64_t> detail::keys_of_rows<D>(                          \
        const Spec&, const BodySpec&, const BlockKeys<D>&, std::uint64_t, std::uint64_t); \
    template BlockPartition<D> first_partition<D>(                                        \
        const BlockKeys<D>&, const RanksSpec&, std::vector<BlockWeight>,                  \
        const std::vector<GroupWeight>&, const BlockPartition<D>*);                       \
    template struct RankScenes<D>;                                                        \
    template State share_of_state<D>(const State&, std::size_t, const BlockPartition<D>&, \
                                     const BlockKeys<D>&, const BlocksTogether&, int);
MPM_RANK_SCENE(2)
MPM_RANK_SCENE(3)
#undef MPM_RANK_SCENE

}  // namespace mpm
