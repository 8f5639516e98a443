// One rank a process against one rank in all: the same bits, sensors to the rounding of their sums,
// states that go on elsewhere; and what fails on one ends all.
#include <cmath>

#include "mpm/core/error.hpp"
#include "mpm/solver/rank_messages.hpp"
#include "mpm/solver/ranks.hpp"
#include "support/processes.hpp"
#include "support/scene.hpp"

namespace mpm {
namespace {

using test::forever;
using Link = std::shared_ptr<Communicator>;

constexpr int parts[] = {test::sanitized ? 9 : 27, test::sanitized ? 11 : 33};

Spec scene_of(const Link& link, bool flat) {
    Spec s = test::busy_scene(flat ? 2 : 3, !flat);
    s.bodies[0].velocity[0] = 5;
    s.ranks.count = link->ranks();
    s.ranks.processes = link;
    return s;
}
Spec alone(Spec s) {
    s.ranks = {};
    return s;
}

/// The particles of a body on all ranks.
std::map<std::uint64_t, std::vector<double>> everywhere(Engine& engine, int body,
                                                        Communicator& link) {
    std::vector<double> numbers;
    for (const auto& [id, row] : test::table(engine, body)) {
        numbers.push_back(double(id));
        numbers.push_back(double(row.size()));
        numbers.insert(numbers.end(), row.begin(), row.end());
    }
    std::map<std::uint64_t, std::vector<double>> out;
    for (const auto& list : link.all_gather(numbers)) {
        for (std::size_t k = 0; k < list.size();) {
            const auto n = std::ptrdiff_t(list[k + 1]);
            const auto first = list.begin() + std::ptrdiff_t(k) + 2;
            if (!out.emplace(std::uint64_t(list[k]), std::vector<double>(first, first + n)).second)
                throw Error("an id is there twice");
            k += std::size_t(n) + 2;
        }
    }
    return out;
}

std::string compare(Engine& many, Engine& one, Communicator& link) {
    if (many.time() != one.time() || many.step() != one.step() ||
        many.time_step() != one.time_step())
        return "another time";
    for (int b = 0; b < 3; ++b)
        if (everywhere(many, b, link) != test::table(one, b))
            return "other particles of body " + std::to_string(b);
    return "";
}

class RankProcesses : public ::testing::TestWithParam<bool> {};

TEST_P(RankProcesses, have_the_bits_of_one) {
    const bool flat = GetParam();
    for (int ranks : {2, 3}) {
        const auto said = test::run_processes(ranks, [&](const Link& link) -> std::string {
            const Spec s = scene_of(link, flat);
            const auto many = make_cpu_engine(s), one = make_cpu_engine(alone(s));
            for (int steps : parts) {
                many->run(steps, forever, forever);
                one->run(steps, forever, forever);
                const std::string wrong = compare(*many, *one, *link);
                if (!wrong.empty()) return wrong;
            }
            const auto x = many->drain(), y = one->drain();
            for (std::size_t k = 0; k < y.size(); ++k) {
                if (x[k].time != y[k].time) return "other times of samples";
                double size = 0;
                for (double v : y[k].values.data) size = std::max(size, std::abs(v));
                const double off = s.sensors[k].kind == SensorKind::tracker ? 0 : 1e-11 * size;
                for (std::size_t i = 0; i < y[k].values.data.size(); ++i)
                    if (!(std::abs(x[k].values.data.at(i) - y[k].values.data[i]) <= off))
                        return "sensor " + s.sensors[k].name;
            }
            const Condition c = many->condition(4096), d = one->condition(4096);
            if (std::abs(c.kinetic - d.kinetic) > 1e-10 * d.kinetic || c.speed != d.speed)
                return "another condition";
            if (many->statistics().at("ranks") != link->ranks()) return "other ranks";
            return many->statistics().at("migrated") > 0 ? "right" : "nothing has migrated";
        });
        EXPECT_EQ(said, std::vector<std::string>(std::size_t(ranks), "right"));
    }
}

TEST_P(RankProcesses, save_on_rank_0_and_go_on_anywhere) {
    const bool flat = GetParam();
    const auto said = test::run_processes(2, [&](const Link& link) -> std::string {
        const Spec s = scene_of(link, flat);
        const auto many = make_cpu_engine(s);
        many->run(parts[0], forever, forever);
        const State state = many->save();
        if (state.empty() != (link->rank() > 0)) return "a state where there is none";
        // To all, as a file is.
        const auto told = link->all_gather(messages::pack(state));
        const State whole = messages::unpack<State>(told[0]);
        const auto again = make_cpu_engine(s), one = make_cpu_engine(alone(s)),
                   straight = make_cpu_engine(alone(s));
        again->load(whole);
        one->load(whole);
        straight->run(parts[0], forever, forever);
        for (Engine* e : {many.get(), again.get(), one.get(), straight.get()})
            e->run(parts[1], forever, forever);
        for (Engine* e : {many.get(), again.get()}) {
            const std::string wrong = compare(*e, *straight, *link);
            if (!wrong.empty()) return wrong;
        }
        for (int b = 0; b < 3; ++b)
            if (test::table(*one, b) != test::table(*straight, b)) return "other on one rank";
        return "right";
    });
    EXPECT_EQ(said, (std::vector<std::string>{"right", "right"}));
}

TEST_P(RankProcesses, halt_together) {
    const bool flat = GetParam();
    const auto said = test::run_processes(2, [&](const Link& link) -> std::string {
        const auto many = make_cpu_engine(scene_of(link, flat));
        // Only one has no time left.
        const RunResult r = many->run(-1, forever, link->rank() == 1 ? 0.0 : 1e6);
        return r.reason + " " + std::to_string(r.steps);
    });
    EXPECT_EQ(said[0], said[1]);
    EXPECT_EQ(said[0].find("wall"), 0u) << said[0];
}

TEST_P(RankProcesses, fail_together) {
    const bool flat = GetParam();
    const auto said = test::run_processes(2, [&](const Link& link) -> std::string {
        Spec s = scene_of(link, flat);
        if (link->rank() == 1) s.cell_size *= 2;
        make_cpu_engine(s);
        return "made";
    });
    for (const std::string& text : said)
        EXPECT_NE(text.find("rank 1 has another scene"), std::string::npos) << text;
    // A body that leaves: the rank that has it tells, and all hear of it.
    const auto left = test::run_processes(2, [&](const Link& link) -> std::string {
        Spec s = scene_of(link, flat);
        s.boundaries.clear();
        s.sensors.resize(1);
        const RunResult r = make_cpu_engine(s)->run(2000, forever, forever);
        return r.reason + " " + r.fault.code + " " + r.fault.message;
    });
    EXPECT_EQ(left[0], left[1]);
    EXPECT_EQ(left[0].find("fault left-domain"), 0u) << left[0];
}

INSTANTIATE_TEST_SUITE_P(All, RankProcesses, ::testing::Bool(),
                         [](const auto& info) { return info.param ? "flat" : "solid"; });

}  // namespace
}  // namespace mpm
