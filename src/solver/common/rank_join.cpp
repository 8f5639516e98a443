#include "mpm/solver/rank_join.hpp"

#include <algorithm>
#include <cstring>
#include <set>

#include "mpm/data/blocks.hpp"
#include "mpm/kernels/clock.hpp"
#include "mpm/solver/blob.hpp"
#include "mpm/solver/raw_samples.hpp"
#include "mpm/solver/saved_clock.hpp"

namespace mpm {

namespace {

/// Pieces of a blob, in elements.
struct Pieces {
    Blob out;
    void take(const Blob& from, std::size_t first, std::size_t last) {
        out.type = from.type;
        const std::size_t elements = from.shape.at(0),
                          size = elements == 0 ? 0 : from.bytes.size() / elements;
        out.bytes.insert(out.bytes.end(), from.bytes.begin() + std::ptrdiff_t(first * size),
                         from.bytes.begin() + std::ptrdiff_t(last * size));
        if (out.shape.empty()) out.shape = {0};
        out.shape[0] += last - first;
    }
};

/// What another has where this is not a number.
template <class E>
void take_numbers(Blob& to, const Blob& from) {
    for (std::size_t at = 0; at + sizeof(E) <= std::min(to.bytes.size(), from.bytes.size());
         at += sizeof(E)) {
        E own, other;
        std::memcpy(&own, to.bytes.data() + at, sizeof own);
        std::memcpy(&other, from.bytes.data() + at, sizeof other);
        if (own != own) std::memcpy(to.bytes.data() + at, &other, sizeof other);
    }
}
void take_numbers(Blob& to, const Blob& from) {
    if (to.type == 'f')
        take_numbers<float>(to, from);
    else
        take_numbers<double>(to, from);
}

}  // namespace

void take_numbers(Array& to, const Array& from) {
    for (std::size_t k = 0; k < std::min(to.data.size(), from.data.size()); ++k)
        if (to.data[k] != to.data[k]) to.data[k] = from.data[k];
}

void append_rows(Array& to, const Array& from) {
    if (to.shape.empty()) {
        to = from;
        return;
    }
    to.shape.at(0) += from.shape.at(0);
    to.data.insert(to.data.end(), from.data.begin(), from.data.end());
}

double particles_of(const Engine& engine, std::size_t bodies) {
    double n = 0;
    for (std::size_t b = 0; b < bodies; ++b) n += double(engine.particle_count(int(b)));
    return n;
}

RunResult join_results(const std::vector<RunResult>& ranks) {
    RunResult out = ranks.at(0);
    if (out.reason != "fault") return out;
    // Where a rank has nothing to tell, the fault is another's.
    bool told = false;
    for (const RunResult& r : ranks) {
        if (r.fault.code.empty()) continue;
        if (!told) {
            out.fault = r.fault;
        } else if (out.fault.code == "left-domain" && r.fault.code == out.fault.code &&
                   r.fault.body == out.fault.body) {
            out.fault.ids.insert(out.fault.ids.end(), r.fault.ids.begin(), r.fault.ids.end());
            out.fault.value += r.fault.value;
            // Behind their number both say the same.
            out.fault.message = std::to_string(out.fault.ids.size()) +
                                out.fault.message.substr(std::min(out.fault.message.find(' '),
                                                                  out.fault.message.size()));
        } else if (out.fault.element >= 0 && r.fault.element >= 0 &&
                   r.fault.body == out.fault.body && r.fault.element < out.fault.element) {
            out.fault = r.fault;  // one rank names the first
        }
        told = true;
    }
    std::sort(out.fault.ids.begin(), out.fault.ids.end());
    return out;
}

std::vector<Samples> join_samples(const std::vector<SensorSpec>& sensors, int dimension,
                                  const std::vector<std::vector<Samples>>& ranks) {
    std::vector<Samples> out = ranks.at(0);
    for (std::size_t r = 1; r < ranks.size(); ++r)
        for (std::size_t k = 0; k < out.size(); ++k)
            join(sensors.at(k), dimension, out[k], ranks[r].at(k));
    return finished(sensors, dimension, std::move(out));
}

std::vector<Removed> join_removed(const std::vector<std::vector<Removed>>& ranks) {
    std::vector<Removed> out;
    for (const auto& list : ranks) {
        for (const Removed& more : list) {
            const auto same = std::find_if(out.begin(), out.end(), [&](const Removed& r) {
                return r.body == more.body && r.step == more.step && r.policy == more.policy;
            });
            if (same == out.end()) {
                out.push_back(more);
                continue;
            }
            same->ids.insert(same->ids.end(), more.ids.begin(), more.ids.end());
            append_rows(same->position, more.position);
        }
    }
    std::stable_sort(out.begin(), out.end(),
                     [](const Removed& a, const Removed& b) { return a.step < b.step; });
    return out;
}

std::vector<Flow> join_flows(const std::vector<std::vector<Flow>>& ranks) {
    std::vector<Flow> out;
    for (const auto& list : ranks) {
        for (const Flow& more : list) {
            const auto same = std::find_if(out.begin(), out.end(), [&](const Flow& f) {
                return f.inlet == more.inlet && f.number == more.number && f.step == more.step;
            });
            if (same == out.end()) {
                out.push_back(more);
                continue;
            }
            same->particles += more.particles;
            same->mass += more.mass;
            same->volume += more.volume;
        }
    }
    std::stable_sort(out.begin(), out.end(),
                     [](const Flow& a, const Flow& b) { return a.step < b.step; });
    return out;
}

Condition join_conditions(const std::vector<Condition>& ranks, std::size_t bodies) {
    Condition out;
    out.moving.assign(bodies, 0);
    std::vector<double> ratios(bodies, 0.0);
    double squares = 0;
    for (const Condition& part : ranks) {
        out.kinetic += part.kinetic;
        out.elastic += part.elastic;
        out.potential += part.potential;
        out.speed = std::max(out.speed, part.speed);
        out.mass += part.mass;
        if (part.mass > 0) squares += part.mass * part.density;
        for (std::size_t b = 0; b < bodies; ++b) {
            if (part.moving.at(b) == 0) continue;
            ratios[b] += double(part.moving[b]) * part.volume_ratio.at(b);
            out.moving[b] += part.moving[b];
        }
    }
    if (out.mass > 0) out.density = squares / out.mass;
    for (std::size_t b = 0; b < bodies; ++b)
        out.volume_ratio.push_back(ratios[b] / double(out.moving[b]));
    return out;
}

std::map<std::string, double> join_timings(
    const std::vector<std::map<std::string, double>>& ranks) {
    std::map<std::string, double> out;
    for (const auto& list : ranks)
        for (const auto& [phase, seconds] : list) out[phase] = std::max(out[phase], seconds);
    return out;
}

std::map<std::string, double> join_statistics(
    const std::vector<std::map<std::string, double>>& ranks) {
    std::map<std::string, double> out = ranks.at(0);
    static const std::set<std::string> alike = {"sorts", "tables",     "fastest_node",
                                                "drift", "rebalances", "imbalance"};
    for (std::size_t r = 1; r < ranks.size(); ++r)
        for (const auto& [name, value] : ranks[r])
            if (!alike.contains(name)) out[name] += value;
    out["ranks"] = double(ranks.size());
    return out;
}

State join_states(const std::vector<State>& ranks, std::size_t bodies) {
    struct Place {
        std::size_t rank, slot;
    };
    std::map<std::uint64_t, std::vector<Place>> held;
    for (std::size_t r = 0; r < ranks.size(); ++r) {
        const auto keys = detail::from_blob<std::uint64_t>(ranks[r], "keys");
        for (std::size_t k = 0; k < keys.size(); ++k) held[keys[k]].push_back({r, k});
    }
    State all = ranks.at(0);
    const std::size_t block =
        block_cells * std::size_t(detail::from_blob<std::int32_t>(all, "sum_channels").at(0));
    std::vector<std::uint64_t> keys;
    Pieces sums;
    for (const auto& [key, places] : held) {
        keys.push_back(key);
        const Place& p = places[0];
        sums.take(detail::find(ranks[p.rank], "sums"), p.slot * block, (p.slot + 1) * block);
    }
    all["keys"] = detail::to_blob(keys);
    if (!keys.empty()) all["sums"] = std::move(sums.out);

    for (std::size_t b = 0; b < bodies; ++b) {
        const std::string prefix = "body" + std::to_string(b) + "_";
        std::vector<std::vector<std::uint32_t>> start;
        for (const State& s : ranks)
            start.push_back(detail::from_blob<std::uint32_t>(s, prefix + "cell_start"));
        struct Range {
            std::size_t rank, first, last;
        };
        std::vector<Range> ranges;
        std::vector<std::uint32_t> cell_start = {0};
        for (const auto& [key, places] : held) {
            std::vector<std::uint32_t> more(block_cells, 0);
            for (const Place& p : places) {
                const std::uint32_t* from = start[p.rank].data() + p.slot * block_cells;
                if (from[block_cells] == from[0]) continue;
                ranges.push_back({p.rank, from[0], from[block_cells]});
                for (int c = 0; c < block_cells; ++c) more[std::size_t(c)] += from[c + 1] - from[0];
            }
            const std::uint32_t before = cell_start.back();
            for (std::uint32_t n : more) cell_start.push_back(before + n);
        }
        for (auto& [name, blob] : all) {
            if (name.rfind(prefix, 0) != 0) continue;
            Pieces joined;
            if (name == prefix + "cell_start") {
                blob = detail::to_blob(cell_start);
                continue;
            }
            if (name == prefix + "elements") {
                for (const State& s : ranks) take_numbers(blob, detail::find(s, name));
                continue;
            }
            if (name.rfind(prefix + "frozen", 0) == 0) {
                for (const State& s : ranks) {
                    const Blob& from = detail::find(s, name);
                    joined.take(from, 0, from.shape.at(0));
                }
            } else {
                joined.take(blob, 0, 0);
                for (const Range& r : ranges)
                    joined.take(detail::find(ranks[r.rank], name), r.first, r.last);
            }
            blob = std::move(joined.out);
        }
    }
    Clock clock = saved_clock(all);
    for (std::size_t r = 1; r < ranks.size(); ++r) {
        const Clock other = saved_clock(ranks[r]);
        // A device counts its own, and finds its own deposits of the last step; the rest is the
        // same on all.
        clock.strays += other.strays;
        for (int q = 0; q < quantities; ++q)
            clock.deposited[q] = std::max(clock.deposited[q], other.deposited[q]);
    }
    save_clock(all, clock);
    for (const char* name : {"load_impulse", "contact_impulse", "pin_impulse", "sensor_first"}) {
        if (!all.contains(name)) continue;
        auto sum = detail::from_blob<double>(all, name);
        for (std::size_t r = 1; r < ranks.size(); ++r) {
            const auto more = detail::from_blob<double>(ranks[r], name);
            for (std::size_t k = 0; k < sum.size(); ++k) sum[k] += more[k];
        }
        all[name] = detail::to_blob(sum);
    }
    return all;
}

}  // namespace mpm
