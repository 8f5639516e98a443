#include <algorithm>
#include <cstring>
#include <numeric>
#include <utility>

#include "mpm/core/error.hpp"
#include "mpm/solver/rank_join.hpp"
#include "mpm/solver/rank_messages.hpp"
#include "mpm/solver/ranks.hpp"
#include "mpm/solver/raw_samples.hpp"

namespace mpm {

namespace {

/// What all ranks refuse alike: they are as they were, and go on.
struct Refused : SceneError {
    using SceneError::SceneError;
};

/// What one rank throws stops the others: nobody waits for a rank that does not come.
template <class Work>
auto guarded(Communicator& comm, const Work& work) {
    const std::string name = "rank " + std::to_string(comm.rank());
    try {
        return work();
    } catch (const RankStopped&) {
        throw;
    } catch (const Refused&) {
        throw;
    } catch (const std::exception& e) {
        comm.stop(name + ": " + e.what());
        throw;
    } catch (...) {
        comm.stop(name + " has failed");
        throw;
    }
}

/// Bit for bit: a parameter may be no number.
bool alike(const std::vector<double>& a, const std::vector<double>& b) {
    return a.size() == b.size() && std::memcmp(a.data(), b.data(), a.size() * sizeof(double)) == 0;
}

/// What all processes must have alike, in numbers.
std::vector<double> outline(const Spec& spec) {
    std::vector<double> out = {double(spec.dimension),
                               double(spec.precision),
                               spec.cell_size,
                               spec.cfl,
                               spec.time_step,
                               double(spec.leaving),
                               double(spec.sensors.size()),
                               double(spec.boundaries.size()),
                               double(spec.inlets.size()),
                               double(spec.ranks.axis),
                               spec.ranks.rebalance_above,
                               double(spec.ranks.measured),
                               double(spec.ranks.grouped),
                               double(spec.ranks.planes.size())};
    for (const std::int64_t first : spec.ranks.planes) out.push_back(double(first));
    for (const std::int64_t n : spec.cells) out.push_back(double(n));
    for (const BodySpec& b : spec.bodies) {
        out.insert(out.end(), {double(b.count), b.particle_mass, double(b.first_id)});
        out.insert(out.end(), b.parameters.begin(), b.parameters.end());
        for (const GroupOfIds& g : b.groups)
            out.insert(out.end(), {double(g.first), double(g.group)});
    }
    return out;
}

class OneOfRanks final : public Engine {
public:
    OneOfRanks(const Spec& spec, std::shared_ptr<Communicator> comm,
               const std::function<std::unique_ptr<Engine>()>& make)
        : comm_(std::move(comm)),
          bodies_(spec.bodies.size()),
          check_{bodies_, spec.dimension},
          sensors_(without_places(spec.sensors)) {
        const auto all = comm_->all_gather(outline(spec), "an outline of its scene");
        for (std::size_t r = 1; r < all.size(); ++r)
            if (!alike(all[r], all[0]))
                throw SceneError("rank " + std::to_string(r) +
                                 " has another scene than rank 0; all processes must describe the "
                                 "same one, with the same seeds and files");
        own_ = guarded(*comm_, make);
    }

    RunResult run(std::int64_t steps, double until, double wall) override {
        return guarded(*comm_,
                       [&] { return join_results(tell_all(own_->run(steps, until, wall))); });
    }
    double time() const override { return own_->time(); }
    std::int64_t step() const override { return own_->step(); }
    double time_step() const override { return own_->time_step(); }
    std::uint64_t particle_count(int body) const override { return own_->particle_count(body); }
    std::vector<Samples> drain() override {
        return join_samples(sensors_, check_.dimension, tell_all(own_->drain()));
    }
    std::vector<Removed> removed() override { return join_removed(tell_all(own_->removed())); }
    std::vector<Flow> flows() override { return join_flows(tell_all(own_->flows())); }
    SmoothingHistory smoothing(int body) const override { return own_->smoothing(body); }
    std::vector<std::string> attribute_names(int body) const override {
        return own_->attribute_names(body);
    }
    Attributes attributes(int body, const std::vector<std::string>& names,
                          const Window& window) override {
        return own_->attributes(body, names, window);
    }
    Array grid(const std::string& name, const Window& window) override {
        return own_->grid(name, window);
    }
    NodalSums sums(const Window& window) override { return own_->sums(window); }
    Condition condition(int samples) override {
        return guarded(*comm_, [&] {
            const double mine = particles_of(*own_, bodies_);
            const auto here = tell_all(mine);
            const double all = std::max(std::accumulate(here.begin(), here.end(), 0.0), 1.0);
            return join_conditions(tell_all(own_->condition(int(samples * mine / all))), bodies_);
        });
    }
    State save() override {
        return guarded(*comm_, [&]() -> State {
            State mine = own_->save();
            std::vector<Bytes> to{std::size_t(comm_->ranks())};
            if (comm_->rank() > 0) {
                to[0] = messages::pack(mine);
                comm_->exchange_and_read(std::move(to), {0}, "what it has none of",
                                         [](int, Unpacker&) {});
                return {};
            }
            std::vector<State> states(to.size());
            comm_->exchange_and_read(std::move(to), comm_->others(), "a state",
                                     [&](int r, Unpacker& from) {
                                         State theirs;
                                         messages::get(from, theirs);
                                         check_(theirs, mine);
                                         states[std::size_t(r)] = std::move(theirs);
                                     });
            states[0] = std::move(mine);
            return join_states(states, bodies_);
        });
    }
    void check(const State& state) const override { own_->check(state); }
    void load(const State& state) override {
        guarded(*comm_, [&] {
            // What one refuses all refuse, before anyone has changed anything.
            std::string problem;
            try {
                own_->check(state);
            } catch (const SceneError& e) {
                problem = e.what();
            }
            const auto all = comm_->all_gather(std::vector<char>(problem.begin(), problem.end()));
            for (std::size_t r = 0; r < all.size(); ++r)
                if (!all[r].empty())
                    throw Refused("rank " + std::to_string(r) + ": " +
                                  std::string(all[r].begin(), all[r].end()));
            own_->load(state);
        });
    }
    std::map<std::string, double> timings() const override {
        return join_timings(tell_all(own_->timings()));
    }
    std::map<std::string, double> statistics() const override {
        return join_statistics(tell_all(own_->statistics()));
    }

private:
    /// What every rank says, by rank.
    template <class E>
    std::vector<E> tell_all(const E& mine) const {
        const Bytes bytes = messages::pack(mine);
        std::vector<E> out(std::size_t(comm_->ranks()));
        comm_->exchange_and_read(std::vector<Bytes>(out.size(), bytes), comm_->others(),
                                 "what it says of its part", [&](int r, Unpacker& from) {
                                     E theirs{};
                                     messages::get(from, theirs);
                                     check_(theirs, mine);
                                     out[std::size_t(r)] = std::move(theirs);
                                 });
        out[std::size_t(comm_->rank())] = mine;
        return out;
    }

    std::shared_ptr<Communicator> comm_;
    std::size_t bodies_;
    PartCheck check_;
    std::vector<SensorSpec> sensors_;
    std::unique_ptr<Engine> own_;
};

}  // namespace

std::unique_ptr<Engine> join_processes(const Spec& spec, std::shared_ptr<Communicator> processes,
                                       const std::function<std::unique_ptr<Engine>()>& make) {
    return std::make_unique<OneOfRanks>(spec, std::move(processes), make);
}

}  // namespace mpm
