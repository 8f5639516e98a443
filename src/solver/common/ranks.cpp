#include "mpm/solver/ranks.hpp"

#include <algorithm>
#include <cmath>
#include <numeric>
#include <set>

#include "mpm/core/error.hpp"
#include "mpm/data/blocks.hpp"
#include "mpm/solver/blob.hpp"
#include "mpm/solver/saved_clock.hpp"

namespace mpm {

void check_ranks(const Spec& spec, const Plan& plan) {
    const auto refuse = [](const std::string& what, const std::string& remedy) {
        throw SceneError(what + " is not built for several ranks; " + remedy);
    };
    if (spec.ranks.axis >= spec.dimension)
        throw SceneError("ranks are dealt by planes across axis " +
                         std::to_string(spec.ranks.axis) + ", which the scene has not");
    if (spec.start.given) refuse("going on from a run with other bodies", "take one rank");
    if (spec.pipeline == "phased")
        refuse("pipeline 'phased'", "take one rank, or pipeline 'auto' with transfer APIC");
    if (!plan.phased && !plan.keeps) return;
    if (spec.transfer.scheme != "APIC")
        refuse("transfer '" + spec.transfer.scheme + "'", "take one rank or APIC");
    const KernelSpec& k = spec.kernel;
    if (k.kernel != Kernel::quadratic || k.clamped || k.gradient != GradientForm::moments)
        refuse("a kernel other than 'quadratic' with gradients from moments",
               "take one rank or that kernel");
    for (const BodySpec& b : spec.bodies) {
        const MaterialInfo& law = material(b.material);
        if (!law.fused)
            refuse("material '" + b.material + "' of body '" + b.name + "'", "take one rank");
        if (b.smoothing == SmoothingForm::split || b.smoothing == SmoothingForm::literal ||
            (b.smoothing != SmoothingForm::none && !law.volumetric))
            refuse("this form of F-bar on body '" + b.name + "'",
                   "take one rank, or another form, which solids have not");
    }
    refuse("the phased step", "take one rank");
}

void check_devices(const Spec& spec) {
    if (spec.ranks.devices.size() != std::size_t(std::max(spec.ranks.count, 0)))
        throw SceneError("the scene has " + std::to_string(spec.ranks.count) + " ranks and names " +
                         std::to_string(spec.ranks.devices.size()) +
                         " devices; name one for each, such as ['cuda:0', 'cuda:1']");
    for (const SensorSpec& s : spec.sensors) {
        if (s.kind == SensorKind::wave_gauge || s.kind == SensorKind::velocity_probe)
            throw SceneError("sensor '" + s.name +
                             "': gauges and probes are not built for several devices; take one "
                             "device, or read the grid between runs");
    }
}

namespace {

/// Rows of one array behind those of another.
void append(Array& to, const Array& from) {
    if (to.shape.empty()) {
        to = from;
        return;
    }
    to.shape.at(0) += from.shape.at(0);
    to.data.insert(to.data.end(), from.data.begin(), from.data.end());
}

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

/// One state of those of all ranks: what one rank would have saved, but for blocks without mass.
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
    all["clock"] = detail::to_blob(std::vector<Clock>{clock});
    for (const char* name : {"load_impulse", "sensor_first"}) {
        auto sum = detail::from_blob<double>(all, name);
        for (std::size_t r = 1; r < ranks.size(); ++r) {
            const auto more = detail::from_blob<double>(ranks[r], name);
            for (std::size_t k = 0; k < sum.size(); ++k) sum[k] += more[k];
        }
        all[name] = detail::to_blob(sum);
    }
    return all;
}

class Ranks final : public Engine {
public:
    Ranks(const Spec& spec, std::unique_ptr<RankThreads> threads,
          std::vector<std::unique_ptr<Engine>> engines)
        : threads_(std::move(threads)), engines_(std::move(engines)), bodies_(spec.bodies.size()) {
        for (const SensorSpec& s : spec.sensors) kinds_.push_back(s.kind);
    }

    RunResult run(std::int64_t steps, double until, double wall) override {
        std::vector<RunResult> results(engines_.size());
        threads_->together([&](int r) {
            results[std::size_t(r)] = engines_[std::size_t(r)]->run(steps, until, wall);
        });
        RunResult out = results[0];
        if (out.reason != "fault") return out;
        // Where a rank has nothing to tell, the fault is another's.
        bool told = false;
        for (RunResult& r : results) {
            if (r.fault.code.empty()) continue;
            if (!told) {
                out.fault = r.fault;
            } else if (out.fault.code == "left-domain" && r.fault.body == out.fault.body) {
                out.fault.ids.insert(out.fault.ids.end(), r.fault.ids.begin(), r.fault.ids.end());
                out.fault.value += r.fault.value;
                out.fault.message = std::to_string(out.fault.ids.size()) +
                                    " particles left the domain, the first at step " +
                                    std::to_string(out.fault.step);
            }
            told = true;
        }
        std::sort(out.fault.ids.begin(), out.fault.ids.end());
        return out;
    }
    double time() const override { return engines_[0]->time(); }
    std::int64_t step() const override { return engines_[0]->step(); }
    double time_step() const override { return engines_[0]->time_step(); }
    std::uint64_t particle_count(int body) const override {
        std::uint64_t n = 0;
        for (const auto& e : engines_) n += e->particle_count(body);
        return n;
    }
    /// Every rank has a row at each time: its own part, or of a point the same as all.
    std::vector<Samples> drain() override {
        std::vector<Samples> out = engines_[0]->drain();
        for (std::size_t r = 1; r < engines_.size(); ++r) {
            const std::vector<Samples> more = engines_[r]->drain();
            for (std::size_t k = 0; k < out.size(); ++k) {
                if (kinds_[k] == SensorKind::wave_gauge || kinds_[k] == SensorKind::velocity_probe)
                    continue;
                for (std::size_t i = 0; i < out[k].values.data.size(); ++i) {
                    double& value = out[k].values.data[i];
                    const double part = more[k].values.data.at(i);
                    if (kinds_[k] != SensorKind::tracker)
                        value += part;
                    else if (part == part)  // a particle is not a number where it is not
                        value = part;
                }
            }
        }
        return out;
    }
    std::vector<Removed> removed() override {
        std::vector<Removed> out;
        for (const auto& e : engines_) {
            for (Removed& more : e->removed()) {
                const auto same = std::find_if(out.begin(), out.end(), [&](const Removed& r) {
                    return r.body == more.body && r.step == more.step && r.policy == more.policy;
                });
                if (same == out.end()) {
                    out.push_back(std::move(more));
                    continue;
                }
                same->ids.insert(same->ids.end(), more.ids.begin(), more.ids.end());
                append(same->position, more.position);
            }
        }
        std::stable_sort(out.begin(), out.end(),
                         [](const Removed& a, const Removed& b) { return a.step < b.step; });
        return out;
    }
    std::vector<Flow> flows() override {
        std::vector<Flow> out;
        for (const auto& e : engines_) {
            for (const Flow& more : e->flows()) {
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
    std::vector<std::string> attribute_names(int body) const override {
        return engines_[0]->attribute_names(body);
    }
    Attributes attributes(int body, const std::vector<std::string>& names) override {
        Attributes out = engines_[0]->attributes(body, names);
        for (std::size_t r = 1; r < engines_.size(); ++r) {
            const Attributes more = engines_[r]->attributes(body, names);
            out.id.insert(out.id.end(), more.id.begin(), more.id.end());
            for (const auto& [name, array] : more.values) append(out.values[name], array);
        }
        return out;
    }
    Array grid(const std::string& name) override {
        Array out;
        for (const auto& e : engines_) append(out, e->grid(name));
        return out;
    }
    NodalSums sums() override {
        NodalSums out;
        for (const auto& e : engines_) {
            const NodalSums more = e->sums();
            out.cell.insert(out.cell.end(), more.cell.begin(), more.cell.end());
            for (const auto& [channel, value] : more.value) {
                auto& to = out.value[channel];
                to.insert(to.end(), value.begin(), value.end());
            }
        }
        return out;
    }
    /// Energies and masses are sums over ranks; means are weighted by what they are the means of.
    Condition condition(int samples) override {
        std::vector<double> here;
        for (const auto& e : engines_) {
            here.push_back(0);
            for (std::size_t b = 0; b < bodies_; ++b)
                here.back() += double(e->particle_count(int(b)));
        }
        const double all = std::max(std::accumulate(here.begin(), here.end(), 0.0), 1.0);
        Condition out;
        out.moving.assign(bodies_, 0);
        std::vector<double> ratios(bodies_, 0.0);
        double squares = 0;
        for (std::size_t r = 0; r < engines_.size(); ++r) {
            const Condition part = engines_[r]->condition(int(samples * here[r] / all));
            out.kinetic += part.kinetic;
            out.elastic += part.elastic;
            out.potential += part.potential;
            out.speed = std::max(out.speed, part.speed);
            out.mass += part.mass;
            if (part.mass > 0) squares += part.mass * part.density;
            for (std::size_t b = 0; b < bodies_; ++b) {
                if (part.moving[b] == 0) continue;
                ratios[b] += double(part.moving[b]) * part.volume_ratio[b];
                out.moving[b] += part.moving[b];
            }
        }
        if (out.mass > 0) out.density = squares / out.mass;
        for (std::size_t b = 0; b < bodies_; ++b)
            out.volume_ratio.push_back(ratios[b] / double(out.moving[b]));
        return out;
    }
    State save() override {
        std::vector<State> states;
        for (const auto& e : engines_) states.push_back(e->save());
        return join_states(states, bodies_);
    }
    void load(const State& state) override {
        threads_->begin_anew();
        threads_->together([&](int r) { engines_[std::size_t(r)]->load(state); });
    }
    std::map<std::string, double> timings() const override {
        // The slowest of each phase: that is what the others have waited for.
        std::map<std::string, double> out;
        for (const auto& e : engines_)
            for (const auto& [phase, seconds] : e->timings())
                out[phase] = std::max(out[phase], seconds);
        return out;
    }
    std::map<std::string, double> statistics() const override {
        std::map<std::string, double> out = engines_[0]->statistics();
        static const std::set<std::string> alike = {"sorts", "tables",     "fastest_node",
                                                    "drift", "rebalances", "imbalance"};
        for (std::size_t r = 1; r < engines_.size(); ++r)
            for (const auto& [name, value] : engines_[r]->statistics())
                if (!alike.contains(name)) out[name] += value;
        out["ranks"] = double(engines_.size());
        return out;
    }

private:
    std::unique_ptr<RankThreads> threads_;
    std::vector<std::unique_ptr<Engine>> engines_;
    std::size_t bodies_;
    std::vector<SensorKind> kinds_;
};

}  // namespace

std::unique_ptr<Engine> join_ranks(const Spec& spec, std::unique_ptr<RankThreads> ranks,
                                   std::vector<std::unique_ptr<Engine>> engines) {
    return std::make_unique<Ranks>(spec, std::move(ranks), std::move(engines));
}

}  // namespace mpm
