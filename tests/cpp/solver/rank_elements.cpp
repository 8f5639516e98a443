// Bodies of elements on several ranks against one: the same bits of vertices and of elements, with
// vertices that change ranks, elements that flow and are worked on elsewhere afterwards, cuts that
// move at every sort, and messages that come late; faults are those of one rank.
#include <gtest/gtest.h>

#include <cmath>
#include <map>
#include <mutex>

#include "mpm/solver/blob.hpp"
#include "mpm/solver/ranks.hpp"
#include "support/meshes_of_elements.hpp"
#include "support/ranks.hpp"
#include "support/slow_engine.hpp"
#include "support/unruly.hpp"

namespace mpm {
namespace {

using test::expect_same_samples;
using test::go;
using test::with_ranks;

constexpr int half = test::sanitized ? 15 : 40;

struct Kind {
    int dimension;
    bool single;
    bool contact = false;
};

/// Two plates over water that runs: one with volumes of vertices and a traction, one that flows.
Spec plates(const Kind& kind) {
    Spec s = test::gauged_scene(kind.dimension, kind.single);
    const std::size_t D = std::size_t(kind.dimension);
    const bool flat = D == 2;
    const std::vector<double> solid = test::solid();
    s.bodies.resize(1);
    for (int k = 0; k < 2; ++k) {
        std::vector<double> lower = flat ? std::vector<double>{2.0 + 17 * k, 24.0}
                                         : std::vector<double>{1.0 + 9 * k, 3.0, 7.0},
                            size = flat ? std::vector<double>{16, 4} : std::vector<double>{8, 7, 2};
        double volume = 1;
        std::vector<int> edges;
        for (std::size_t a = 0; a < D; ++a) {
            edges.push_back(int(size[a]) * (flat ? 2 : 1));
            lower[a] *= s.cell_size;
            size[a] *= s.cell_size;
            volume *= size[a];
        }
        const auto mesh = test::box_of_elements(lower, size, edges);
        if (k == 0)
            s.bodies.push_back(
                test::body_of_elements(s, "elastic", "FixedCorotated", solid, mesh, volume, true));
        else
            s.bodies.push_back(test::body_of_elements(
                s, "plastic", "VonMises", {solid[0], solid[1], solid[2], 1e-3 * solid[1], 0}, mesh,
                volume, true));
        BodySpec& b = s.bodies.back();
        b.velocity[0] = (kind.contact ? 0.5 : 1) * (k == 0 ? 5 : -4);
        b.velocity[D - 1] = -3;
    }
    TractionSpec push;
    push.particles = {0, 3, 7};
    push.area = {0.3 * s.cell_size, 0.1 * s.cell_size, 0.2 * s.cell_size};
    push.value.time = {0, 0.1};
    push.value.value.assign(2 * D, 0.0);
    push.value.value[0] = 2e4;
    push.value.value[D] = -3e4;
    s.bodies[1].tractions = {push};
    for (SensorSpec& sensor : s.sensors)
        if (sensor.kind == SensorKind::tracker)
            sensor.ids = {s.bodies[1].first_id + 5, s.bodies[1].first_id};
    if (kind.contact) {
        ContactSpec& c = s.contact;
        c.fields = 3;
        c.kind = {0, 1, 2};
        c.density = {1000, solid[0], solid[0]};
        c.laws.resize(2);
        c.laws[0].kind = ContactKind::fluid;
        c.laws[0].fill = 0.7;
        c.laws[1].kind = ContactKind::friction;
        c.laws[1].static_friction = 0.4;
        c.laws[1].dynamic_friction = 0.3;
        c.law_of = {-1, 0, 0, 0, -1, 1, 0, 1, -1};
        for (int b = 0; b < 3; ++b) s.bodies[std::size_t(b)].fields = {{0, b}};
    }
    return s;
}

/// Everything that can be read of bodies of elements, vertices by id.
void expect_same_meshes(Engine& many, Engine& one) {
    EXPECT_EQ(many.step(), one.step());
    EXPECT_EQ(many.time(), one.time());
    for (int b = 1; b < 3; ++b) {
        const auto names = one.attribute_names(b);
        const Attributes x = many.attributes(b, names), y = one.attributes(b, names);
        ASSERT_EQ(x.id.size(), y.id.size());
        std::map<std::uint64_t, std::size_t> row;
        for (std::size_t k = 0; k < x.id.size(); ++k) row[x.id[k]] = k;
        ASSERT_EQ(row.size(), x.id.size()) << "an id is there twice";
        for (const auto& [name, theirs] : y.values) {
            const Array& ours = x.values.at(name);
            ASSERT_EQ(ours.shape, theirs.shape) << name;
            if (is_of_elements(name)) {
                EXPECT_TRUE(ours.data == theirs.data) << "body " << b << " " << name;
                continue;
            }
            const std::size_t width = theirs.data.size() / y.id.size();
            bool same = true;
            for (std::size_t k = 0; k < y.id.size(); ++k)
                for (std::size_t c = 0; c < width; ++c)
                    same = same &&
                           ours.data[row.at(y.id[k]) * width + c] == theirs.data[k * width + c];
            EXPECT_TRUE(same) << "body " << b << " " << name;
        }
    }
    EXPECT_TRUE(test::table(many, 0) == test::table(one, 0)) << "water";
}

class RankElements : public ::testing::TestWithParam<Kind> {
protected:
    Spec scene() { return plates(GetParam()); }
};

TEST_P(RankElements, have_the_bits_of_one) {
    const auto one = make_cpu_engine(scene());
    EXPECT_EQ(go(*one, 2 * half).reason, "steps");
    EXPECT_GT(one->statistics().at("sorts"), 1);
    EXPECT_EQ(one->statistics().count("bytes_of_vertices"), 0u);
    const Attributes plastic = one->attributes(2, {"element_plastic_strain"});
    double flowed = 0;
    for (const double strain : plastic.values.at("element_plastic_strain").data)
        flowed = std::max(flowed, strain);
    EXPECT_GT(flowed, 0) << "elements must flow to mean anything";
    const auto samples = one->drain();
    double migrated = 0, told = 0;
    for (int ranks : {2, 3, 4}) {
        for (int axis : {-1, 0}) {
            if (test::sanitized && (ranks != 3 || axis == 0)) continue;
            const Spec s = with_ranks(scene(), ranks, axis, 1.05);
            const auto many = make_cpu_engine(s);
            go(*many, half);
            go(*many, half);
            migrated += many->statistics().at("migrated");
            told += many->statistics().at("bytes_of_vertices");
            expect_same_meshes(*many, *one);
            expect_same_samples(many->drain(), samples, s);
            const Condition x = many->condition(1000), y = one->condition(1000);
            EXPECT_NEAR(x.elastic, y.elastic, 1e-10 * y.elastic);
            for (std::size_t b = 1; b < 3; ++b)
                EXPECT_NEAR(x.volume_ratio[b], y.volume_ratio[b], 1e-12);
        }
    }
    EXPECT_GT(migrated, 0);
    EXPECT_GT(told, 0);
}

TEST_P(RankElements, with_late_messages_and_new_cuts_at_every_sort) {
    const auto one = make_cpu_engine(scene());
    go(*one, 2 * half);
    const auto many =
        make_cpu_engine(with_ranks(scene(), 4, -1, 0), std::make_unique<test::UnrulyRanks>(4, 5));
    go(*many, 2 * half);
    EXPECT_GT(many->statistics().at("rebalances"), 0);
    expect_same_meshes(*many, *one);
}

TEST_P(RankElements, resume_on_another_number) {
    const auto straight = make_cpu_engine(scene());
    go(*straight, half);
    const auto from_one = straight->save();
    go(*straight, half);
    const auto three = make_cpu_engine(with_ranks(scene(), 3, -1, 1.05));
    three->load(from_one);
    go(*three, 5);
    const auto two = make_cpu_engine(with_ranks(scene(), 2, 0, 0));
    two->load(three->save());
    go(*two, 5);
    const auto again = make_cpu_engine(scene());
    const State last = two->save();
    for (const double kept : detail::numbers(last, "body2_elements")) ASSERT_TRUE(kept == kept);
    again->load(last);
    go(*again, half - 10);
    expect_same_meshes(*again, *straight);
}

/// Of unlike ranks: vertices of 0 and 1 are all on one.
TEST_P(RankElements, on_ranks_that_have_none) {
    const auto one = make_cpu_engine(scene());
    go(*one, 20);
    Spec s = with_ranks(scene(), 3, 0, 1e9);
    s.ranks.planes = {1, s.cells[0] / (s.dimension == 2 ? 8 : 4) - 1};
    const auto many = make_cpu_engine(s);
    go(*many, 20);
    expect_same_meshes(*many, *one);
}

/// Each dimension and each precision; under sanitizers not each with each.
const std::vector kinds = test::sanitized ? std::vector{Kind{2, true, true}, Kind{3, false, true}}
                                          : std::vector{Kind{2, false}, Kind{2, true, true},
                                                        Kind{3, true}, Kind{3, false, true}};
INSTANTIATE_TEST_SUITE_P(All, RankElements, ::testing::ValuesIn(kinds));

/// On devices: dimension, whether ranks reach each other's memory, contact.
class DeviceElements : public ::testing::TestWithParam<std::tuple<int, bool, bool>> {
protected:
    const bool reaches = std::get<1>(GetParam());
    Spec scene() { return plates({std::get<0>(GetParam()), true, std::get<2>(GetParam())}); }
    std::unique_ptr<Engine> make(int ranks, int axis, double rebalance_above) {
        return test::make_slow_engine(test::on_devices(scene(), ranks, axis, rebalance_above),
                                      reaches);
    }
};

TEST_P(DeviceElements, have_the_bits_of_one) {
    const auto one = test::make_slow_engine(scene());
    EXPECT_EQ(go(*one, 2 * half).reason, "steps");
    EXPECT_GT(one->statistics().at("sorts"), 1);
    const auto samples = one->drain();
    double migrated = 0, told = 0;
    for (int ranks : {2, 3}) {
        for (double rebalance_above : {1.05, 0.0}) {
            if (test::sanitized && (ranks == 2) == (rebalance_above == 0)) continue;
            const auto many = make(ranks, ranks == 2 ? 0 : -1, rebalance_above);
            go(*many, half);
            go(*many, half);
            migrated += many->statistics().at("migrated");
            told += many->statistics().at("bytes_of_vertices");
            expect_same_meshes(*many, *one);
            expect_same_samples(many->drain(), samples, scene());
        }
    }
    EXPECT_GT(migrated, 0);
    EXPECT_GT(told, 0);
}

TEST_P(DeviceElements, resume_on_another_number) {
    const auto straight = test::make_slow_engine(scene());
    go(*straight, half);
    const auto from_one = straight->save();
    go(*straight, half);
    const auto three = make(3, -1, 1.05);
    three->load(from_one);
    go(*three, half / 2);
    const auto again = test::make_slow_engine(scene());
    again->load(three->save());
    go(*again, half - half / 2);
    expect_same_meshes(*again, *straight);
}

/// Of double precision no further than the CPU's single precision, times a few: sums are integers
/// on one and numbers on the other.
TEST_P(DeviceElements, are_as_near_to_double_precision_as_the_cpu) {
    const auto exact =
        make_cpu_engine(plates({std::get<0>(GetParam()), false, std::get<2>(GetParam())}));
    const auto cpu = make_cpu_engine(scene()), device = test::make_slow_engine(scene());
    for (Engine* e : {exact.get(), cpu.get(), device.get()}) go(*e, 20);
    const std::vector<std::string> names = {"element_stress", "element_energy",
                                            "element_volume_ratio"};
    for (int b = 1; b < 3; ++b) {
        const Attributes right = exact->attributes(b, names), x = cpu->attributes(b, names),
                         y = device->attributes(b, names);
        for (const std::string& name : names) {
            const auto& of = [&](const Attributes& a) -> const std::vector<double>& {
                return a.values.at(name).data;
            };
            double size = 0, of_cpu = 0, of_device = 0;
            for (std::size_t k = 0; k < of(right).size(); ++k) {
                size = std::max(size, std::abs(of(right)[k]));
                of_cpu = std::max(of_cpu, std::abs(of(x)[k] - of(right)[k]));
                of_device = std::max(of_device, std::abs(of(y)[k] - of(right)[k]));
            }
            EXPECT_GT(size, 0);
            EXPECT_LT(of_device, 8 * of_cpu + 1e-5 * size) << name << " of " << size;
        }
    }
}

/// Under sanitizers not each with each.
using Kinds = std::vector<std::tuple<int, bool, bool>>;
INSTANTIATE_TEST_SUITE_P(All, DeviceElements,
                         ::testing::ValuesIn(test::sanitized
                                                 ? Kinds{{2, true, true}, {2, false, false}}
                                                 : Kinds{{2, true, true},
                                                         {2, false, false},
                                                         {3, true, false},
                                                         {3, false, true}}));

TEST(DeviceElements, name_the_element_that_the_cpu_names) {
    Spec s = plates({2, true});
    BodySpec& b = s.bodies[1];
    b.velocity.assign(2 * b.count, 0.0);
    for (const std::size_t v : {40u, 50u, 60u, 70u, 80u}) b.velocity[2 * v] = 400;
    b.parameters[1] = 100;
    const auto cpu = make_cpu_engine(s);
    const RunResult expected = go(*cpu, 4000);
    ASSERT_EQ(expected.fault.code, "inverted-element");
    for (const int ranks : {1, 2}) {
        const auto device =
            test::make_slow_engine(ranks == 1 ? s : test::on_devices(s, ranks, 0, 1.05));
        const RunResult found = go(*device, 4000);
        EXPECT_EQ(found.fault.code, expected.fault.code);
        EXPECT_NEAR(double(found.steps), double(expected.steps), 2);
        EXPECT_GE(found.fault.element, 0);
        EXPECT_EQ(found.fault.ids.size(), 3u);
    }
}

/// Counts what ranks say of vertices.
class Listening final : public RankThreads {
public:
    using RankThreads::RankThreads;
    std::map<std::string, int> heard;

private:
    void hand_over(int, int, const char* what, Bytes& bytes, const Reader& read) override {
        {
            const std::lock_guard lock(mutex_);
            ++heard[what];
        }
        read(bytes);
    }
    std::mutex mutex_;
};

TEST(RankElements, scenes_without_a_mesh_say_nothing_of_vertices) {
    for (const bool meshes : {false, true}) {
        auto ranks = std::make_unique<Listening>(3);
        Listening& heard = *ranks;
        const Spec s = meshes ? plates({2, false}) : test::gauged_scene(2, false);
        const auto many = make_cpu_engine(with_ranks(s, 3, 0, 1.05), std::move(ranks));
        go(*many, 10);
        EXPECT_EQ(heard.heard.count("vertices") + heard.heard.count("places of vertices") +
                      heard.heard.count("wanted vertices") + heard.heard.count("places at rest"),
                  meshes ? 4u : 0u);
    }
}

TEST(RankElements, name_the_element_that_one_rank_names) {
    const auto thrown = [] {
        Spec s = plates({2, false});
        BodySpec& b = s.bodies[1];
        b.velocity.assign(2 * b.count, 0.0);
        for (const std::size_t v : {40u, 50u, 60u, 70u, 80u}) b.velocity[2 * v] = 400;
        b.parameters[1] = 100;
        return s;
    };
    const auto one = make_cpu_engine(thrown());
    const RunResult alone = go(*one, 4000);
    ASSERT_EQ(alone.fault.code, "inverted-element");
    for (const int ranks : {2, 4}) {
        const auto many = make_cpu_engine(with_ranks(thrown(), ranks, 0, 0));
        const RunResult together = go(*many, 4000);
        EXPECT_EQ(together.steps, alone.steps);
        EXPECT_EQ(together.fault.code, alone.fault.code);
        EXPECT_EQ(together.fault.element, alone.fault.element);
        EXPECT_EQ(together.fault.ids, alone.fault.ids);
        EXPECT_EQ(together.fault.message, alone.fault.message);
    }
}

TEST(RankElements, that_leave_the_domain_stop_all) {
    const auto leaving = [] {
        Spec s = plates({2, false});
        s.boundaries.clear();
        std::erase_if(s.sensors,
                      [](const SensorSpec& x) { return x.kind == SensorKind::load_cell; });
        s.leaving = Leaving::remove;
        s.bodies.erase(s.bodies.begin());
        for (SensorSpec& sensor : s.sensors) sensor.body = std::min(sensor.body, 0);
        std::erase_if(s.sensors, [](const SensorSpec& x) { return x.kind != SensorKind::energy; });
        for (BodySpec& b : s.bodies) {
            b.tractions.clear();
            b.velocity = {0, 20};
        }
        return s;
    };
    const auto one = make_cpu_engine(leaving());
    const RunResult alone = go(*one, 4000);
    ASSERT_EQ(alone.fault.code, "left-domain");
    const auto many = make_cpu_engine(with_ranks(leaving(), 3, 0, 0));
    const RunResult together = go(*many, 4000);
    EXPECT_EQ(together.steps, alone.steps);
    EXPECT_EQ(together.fault.code, "left-domain");
    EXPECT_EQ(together.fault.ids, alone.fault.ids);
    EXPECT_EQ(together.fault.message, alone.fault.message);
}

}  // namespace
}  // namespace mpm
