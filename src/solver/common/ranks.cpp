#include "mpm/solver/ranks.hpp"

#include <algorithm>
#include <numeric>

#include "mpm/core/error.hpp"
#include "mpm/solver/rank_join.hpp"
#include "mpm/solver/raw_samples.hpp"

namespace mpm {

void check_ranks(const Spec& spec) {
    const auto refuse = [](const std::string& what, const std::string& remedy) {
        throw SceneError(what + " is not built for several ranks; " + remedy);
    };
    if (spec.ranks.axis >= spec.dimension)
        throw SceneError("ranks are dealt by planes across axis " +
                         std::to_string(spec.ranks.axis) + ", which the scene has not");
    if (const auto& planes = spec.ranks.planes; !planes.empty()) {
        if (spec.ranks.axis < 0)
            throw SceneError("planes are given for ranks that are dealt across no axis; name one");
        if (planes.size() + 1 != std::size_t(spec.ranks.count))
            throw SceneError(std::to_string(planes.size()) + " planes are given for " +
                             std::to_string(spec.ranks.count) +
                             " ranks; give one fewer than ranks");
        for (std::size_t k = 0; k < planes.size(); ++k)
            if (planes[k] < (k == 0 ? 1 : planes[k - 1] + 1))
                throw SceneError("the planes between ranks do not ascend from block 1 on");
    }
    if (spec.ranks.grouped) {
        for (const BodySpec& b : spec.bodies)
            for (const GroupOfIds& g : b.groups)
                if (g.group < 0 || g.group >= spec.ranks.count)
                    throw SceneError("body '" + b.name + "' is of group " +
                                     std::to_string(g.group) + "; there are as many as ranks, " +
                                     std::to_string(spec.ranks.count));
        if (!spec.ranks.planes.empty())
            throw SceneError("ranks begin with groups of bodies and at planes; give one of them");
    }
    for (const BoundarySpec& b : spec.boundaries)
        if (b.law[0].linear && (b.surface.path.given() || b.surface.turn.given()))
            refuse("linear cells beside the moving surface '" + b.name + "'",
                   "take one rank, or cell=\"held\" for it");
    for (const BoundarySpec& b : spec.boundaries)
        if (b.uplift)
            refuse("uplift on boundary '" + b.name + "', which looks from edge to edge of a base,",
                   "take one rank, or uplift=False for it");
}

void check_processes(const Spec& spec) {
    if (spec.ranks.processes && spec.ranks.count != spec.ranks.processes->ranks())
        throw SceneError("the scene has " + std::to_string(spec.ranks.count) +
                         " ranks and the job " + std::to_string(spec.ranks.processes->ranks()) +
                         " processes");
}

void check_devices(const Spec& spec) {
    if (!spec.ranks.processes &&
        spec.ranks.devices.size() != std::size_t(std::max(spec.ranks.count, 0)))
        throw SceneError("the scene has " + std::to_string(spec.ranks.count) + " ranks and names " +
                         std::to_string(spec.ranks.devices.size()) +
                         " devices; name one for each, such as ['cuda:0', 'cuda:1']");
    if (spec.ranks.measured)
        throw SceneError(
            "loads by measured time are not built for ranks on devices; take particles");
    if (spec.ranks.count > most_device_ranks)
        throw SceneError("the scene has " + std::to_string(spec.ranks.count) +
                         " ranks on devices; it takes at most " +
                         std::to_string(most_device_ranks));
}

namespace {

class Ranks final : public Engine {
    /// What each rank says, one after the other.
    template <class Ask>
    auto of_each(const Ask& ask) const {
        std::vector<decltype(ask(*engines_[0]))> out;
        for (const auto& e : engines_) out.push_back(ask(*e));
        return out;
    }
    /// Of attributes that the body may not have, which are then for one rank to refuse.
    bool known(int body, const std::vector<std::string>& names) const {
        const auto all = attribute_names(body);
        return std::all_of(names.begin(), names.end(), [&](const std::string& n) {
            return n == "state" || n == "frozen" ||
                   std::find(all.begin(), all.end(), n) != all.end();
        });
    }

public:
    Ranks(const Spec& spec, std::unique_ptr<RankThreads> threads,
          std::vector<std::unique_ptr<Engine>> engines)
        : threads_(std::move(threads)),
          engines_(std::move(engines)),
          bodies_(spec.bodies.size()),
          dimension_(spec.dimension),
          sensors_(without_places(spec.sensors)) {}

    RunResult run(std::int64_t steps, double until, double wall) override {
        std::vector<RunResult> results(engines_.size());
        threads_->together([&](int r) {
            results[std::size_t(r)] = engines_[std::size_t(r)]->run(steps, until, wall);
        });
        return join_results(results);
    }
    double time() const override { return engines_[0]->time(); }
    std::int64_t step() const override { return engines_[0]->step(); }
    double time_step() const override { return engines_[0]->time_step(); }
    std::uint64_t particle_count(int body) const override {
        std::uint64_t n = 0;
        for (const auto& e : engines_) n += e->particle_count(body);
        return n;
    }
    std::vector<Samples> drain() override {
        return join_samples(sensors_, dimension_, of_each([](Engine& e) { return e.drain(); }));
    }
    std::vector<Removed> removed() override {
        return join_removed(of_each([](Engine& e) { return e.removed(); }));
    }
    std::vector<Flow> flows() override {
        return join_flows(of_each([](Engine& e) { return e.flows(); }));
    }
    SmoothingHistory smoothing(int body) const override { return engines_[0]->smoothing(body); }
    std::vector<std::string> attribute_names(int body) const override {
        return engines_[0]->attribute_names(body);
    }
    Attributes attributes(int body, const std::vector<std::string>& names,
                          const Window& window) override {
        if (!known(body, names)) return engines_[0]->attributes(body, names);
        auto parts = of_each([&](Engine& e) { return e.attributes(body, names, window); });
        Attributes out = std::move(parts[0]);
        for (std::size_t r = 1; r < parts.size(); ++r) {
            out.id.insert(out.id.end(), parts[r].id.begin(), parts[r].id.end());
            for (const auto& [name, array] : parts[r].values) {
                if (is_of_elements(name))
                    take_numbers(out.values[name], array);
                else
                    append_rows(out.values[name], array);
            }
        }
        return out;
    }
    Array grid(const std::string& name, const Window& window) override {
        check_grid_attribute(name);
        Array out;
        for (const Array& part : of_each([&](Engine& e) { return e.grid(name, window); }))
            append_rows(out, part);
        return out;
    }
    NodalSums sums(const Window& window) override {
        NodalSums out;
        for (const auto& e : engines_) {
            const NodalSums more = e->sums(window);
            out.cell.insert(out.cell.end(), more.cell.begin(), more.cell.end());
            for (const auto& [channel, value] : more.value) {
                auto& to = out.value[channel];
                to.insert(to.end(), value.begin(), value.end());
            }
        }
        return out;
    }
    Condition condition(int samples) override {
        std::vector<double> here;
        for (const auto& e : engines_) here.push_back(particles_of(*e, bodies_));
        const double all = std::max(std::accumulate(here.begin(), here.end(), 0.0), 1.0);
        auto own = here.begin();
        const auto ask = [&](Engine& e) { return e.condition(int(samples * *own++ / all)); };
        return join_conditions(of_each(ask), bodies_);
    }
    State save() override {
        return join_states(of_each([](Engine& e) { return e.save(); }), bodies_);
    }
    void check(const State& state) const override { engines_[0]->check(state); }
    void load(const State& state) override {
        check(state);  // else a rank that refuses would stop all
        threads_->begin_anew();
        threads_->together([&](int r) { engines_[std::size_t(r)]->load(state); });
    }
    std::map<std::string, double> timings() const override {
        return join_timings(of_each([](Engine& e) { return e.timings(); }));
    }
    std::map<std::string, double> statistics() const override {
        return join_statistics(of_each([](Engine& e) { return e.statistics(); }));
    }

private:
    std::unique_ptr<RankThreads> threads_;
    std::vector<std::unique_ptr<Engine>> engines_;
    std::size_t bodies_;
    int dimension_;
    std::vector<SensorSpec> sensors_;
};

}  // namespace

std::unique_ptr<Engine> join_ranks(const Spec& spec, std::unique_ptr<RankThreads> ranks,
                                   std::vector<std::unique_ptr<Engine>> engines) {
    return std::make_unique<Ranks>(spec, std::move(ranks), std::move(engines));
}

}  // namespace mpm
