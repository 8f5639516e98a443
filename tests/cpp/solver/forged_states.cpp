// Saved states that somebody has changed: every entry, element by element and as a whole. Whatever
// cannot be run with is refused by the entry's name and leaves the engine as it was; the rest runs,
// or ends in a fault. Under the address sanitizer an index that slips through shows itself.
#include <gtest/gtest.h>

#include <cmath>
#include <functional>
#include <set>

#include "mpm/core/error.hpp"
#include "support/scene.hpp"

namespace mpm {
namespace {

using test::forever;

constexpr double nan = std::numeric_limits<double>::quiet_NaN();

/// Water between an inlet and an outlet, two blocks that are stepped as one, one of which flies
/// out and is set aside; sensors of every kind.
Spec flowing(bool single) {
    Spec s = test::empty_scene(2, single, {24, 16});
    s.gravity.value[1] = -9.81;
    s.leaving = Leaving::freeze;
    s.bodies.push_back(test::body(s, "water", "TaitFluid", test::fluid(),
                                  test::lattice(s, {0, 0}, {10, 4}, 2), 4));
    s.bodies[0].smoothing = SmoothingForm::one_volume_gradient;
    s.bodies[0].smoothing_time = 0.01;
    s.bodies[0].velocity = {1, 0};
    s.bodies[0].id_count = 1000;
    for (int k = 0; k < 2; ++k) {
        s.bodies.push_back(test::body(s, "block" + std::to_string(k), "FixedCorotated",
                                      test::solid(),
                                      test::lattice(s, {14, 6 + 4 * k}, {16, 8 + 4 * k}, 2), 4));
        s.bodies.back().first_id = 1000 + 16 * std::uint64_t(k);
        s.bodies.back().velocity = {40.0 * k, 0};
    }
    InletSpec inlet;
    inlet.name = "in";
    inlet.body = 0;
    inlet.spacing = 0.05;
    for (int k = 0; k < 8; ++k) inlet.points.insert(inlet.points.end(), {0.025, 0.025 + 0.05 * k});
    inlet.velocity.time = {0};
    inlet.velocity.value = {2};
    inlet.next_id = s.bodies[0].count;
    s.inlets.push_back(inlet);
    test::add_walls(s, Response::separable);
    s.boundaries[0].present = {0, 0, 1, 1};
    test::add_energy(s, 0.003);
    SensorSpec load;
    load.name = "load";
    load.kind = SensorKind::load_cell;
    load.boundary = 0;
    load.faces = 4;
    load.reference = {0, 0};
    s.sensors.push_back(load);
    return s;
}

Spec wide(const std::string& scheme, Kernel kernel) {
    Spec s = test::empty_scene(2, false, {16, 16});
    s.gravity.value[1] = -9.81;
    s.transfer.scheme = scheme;
    s.kernel.kernel = kernel;
    s.kernel.gradient = GradientForm::shapes;
    s.bodies.push_back(test::body(s, "block", "FixedCorotated", test::solid(),
                                  test::lattice(s, {5, 2}, {9, 5}, 2), 4));
    test::add_walls(s, Response::separable);
    return s;
}

Spec on_triangles() {
    Spec s = test::empty_scene(2, false, {4, 4}, 0.25);
    s.functions.kind = "triangular";
    s.functions.basis = "linear";
    for (int j = 0; j <= 4; ++j)
        for (int i = 0; i <= 4; ++i)
            s.functions.vertices.insert(s.functions.vertices.end(), {0.25 * i, 0.25 * j});
    for (int j = 0; j < 4; ++j)
        for (int i = 0; i < 4; ++i) {
            const int a = 5 * j + i;
            s.functions.triangles.insert(s.functions.triangles.end(),
                                         {a, a + 1, a + 6, a, a + 6, a + 5});
        }
    s.gravity.value[1] = -1;
    s.bodies.push_back(test::body(s, "block", "LinearElastic", test::solid(),
                                  test::lattice(s, {0, 0}, {2, 2}, 3), 9));
    BoundarySpec floor;
    floor.name = "floor";
    floor.present = {0, 0, 1, 0};
    floor.law.assign(4, {Response::sticky, 0, 0});
    floor.end = forever;
    s.boundaries.push_back(floor);
    test::add_energy(s, 0.01);
    return s;
}

template <class E>
E read(const Blob& b, std::size_t k) {
    E x;
    std::memcpy(&x, b.bytes.data() + k * sizeof(E), sizeof(E));
    return x;
}
template <class E>
void write(Blob& b, std::size_t k, E x) {
    std::memcpy(b.bytes.data() + k * sizeof(E), &x, sizeof(E));
}

template <class E>
std::vector<E> values_beside(E x) {
    if constexpr (std::is_floating_point_v<E>) {
        const E most = std::numeric_limits<E>::max();
        return {E(nan),
                E(HUGE_VAL),
                E(-HUGE_VAL),
                most,
                -most,
                E(0),
                E(-1),
                E(2),
                E(1.7),
                E(-x),
                E(x * E(1.5)),
                E(x * E(0.5)),
                std::numeric_limits<E>::denorm_min(),
                E(1e6)};
    } else {
        const E most = std::numeric_limits<E>::max(), least = std::numeric_limits<E>::min();
        return {most, least, E(0), E(1), E(x + 1), E(x - 1), E(most / 2), E(x + 1000)};
    }
}

/// Calls `f(blob, what)` with every forgery of an entry.
template <class E>
void forge_values(const Blob& good, const std::function<void(Blob, std::string)>& f) {
    const std::size_t n = good.shape[0];
    if (n == 0) return;
    for (std::size_t k : std::set<std::size_t>{0, n / 2, n - 1}) {
        for (E x : values_beside(read<E>(good, k))) {
            Blob b = good;
            write(b, k, x);
            f(b, "element " + std::to_string(k) + " of " + std::to_string(n));
        }
    }
    for (E x : values_beside(read<E>(good, 0))) {
        Blob b = good;
        for (std::size_t k = 0; k < n; ++k) write(b, k, x);
        f(b, "all elements");
    }
    Blob swapped = good, twice = good;
    write(swapped, 0, read<E>(good, n - 1));
    write(swapped, n - 1, read<E>(good, 0));
    f(swapped, "ends swapped");
    write(twice, 0, read<E>(good, n - 1));
    f(twice, "an element twice");
}

void forge_values(const Blob& b, const std::function<void(Blob, std::string)>& f) {
    if (b.type == 'f') forge_values<float>(b, f);
    if (b.type == 'd') forge_values<double>(b, f);
    if (b.type == 'i') forge_values<std::int32_t>(b, f);
    if (b.type == 'l') forge_values<std::int64_t>(b, f);
    if (b.type == 'I') forge_values<std::uint32_t>(b, f);
    if (b.type == 'L') forge_values<std::uint64_t>(b, f);
}

/// Forgeries of type and size; none of them may be taken.
void forge_shape(const Blob& good, const std::function<void(Blob, std::string)>& f) {
    const std::size_t n = good.shape[0], size = n == 0 ? 8 : good.bytes.size() / n;
    Blob b = good;
    b.bytes.resize((n + 1) * size);
    b.shape = {n + 1};
    f(b, "one more");
    b = good;
    b.shape = {n + 1};
    f(b, "a shape without its bytes");
    b.shape = {n, 1};
    f(b, "two axes");
    b.shape = {};
    f(b, "no axis");
    b = good;
    b.type = '?';
    f(b, "an unknown type");
    if (n == 0) return;
    b = good;
    b.bytes.resize((n - 1) * size);
    b.shape = {n - 1};
    f(b, "one less");
    b = good;
    b.bytes.pop_back();
    f(b, "a byte less");
    b.bytes.clear();
    b.shape = {0};
    f(b, "empty");
    b = good;
    b.type = good.type == 'd' ? 'L' : good.type == 'l' ? 'd' : good.type == 'f' ? 'I' : 'f';
    if (size == 8) f(b, "another type");
}

class Forged : public ::testing::Test {
protected:
    void begin(const Spec& spec, std::int64_t steps) {
        spec_ = spec;
        engine_ = spec.functions.kind.empty() ? make_cpu_engine(spec) : make_functions_engine(spec);
        const auto r = engine_->run(steps, forever, forever);
        ASSERT_EQ(r.reason, "steps") << r.fault.message;
        good_ = engine_->save();
        before_ = test::state_bytes(*engine_);
    }

    /// Returns whether the state was taken.
    bool attempt(const State& state, const std::string& entry, const std::string& what) {
        SCOPED_TRACE(entry + ": " + what);
        ++tried_;
        try {
            engine_->load(state);
        } catch (const SceneError& e) {
            ++refused_;
            EXPECT_NE(std::string(e.what()).find("saved state"), std::string::npos) << e.what();
            // As if nobody had asked.
            if (tried_ % 16 == 0) {
                EXPECT_EQ(test::state_bytes(*engine_), before_);
            }
            return false;
        }
        const auto r = engine_->run(3, forever, 20);
        EXPECT_TRUE(r.reason == "steps" || r.reason == "fault") << r.reason;
        EXPECT_TRUE(std::isfinite(engine_->time()));
        for (std::size_t b = 0; b < spec_.bodies.size(); ++b) {
            engine_->attributes(int(b), {"position", "velocity", "stress"});
            engine_->particle_count(int(b));
        }
        if (r.reason == "steps") {
            engine_->grid("velocity");
            try {
                engine_->save();
            } catch (const NumericalError&) {
            }
        }
        engine_->drain();
        engine_->load(good_);
        return true;
    }

    void forge_all() {
        for (const auto& [name, good] : good_) {
            State state = good_;
            state.erase(name);
            const bool optional = name == "sorts_of_table" || name == "body_of";
            EXPECT_EQ(attempt(state, name, "missing"), optional);
            forge_shape(good, [&](const Blob& b, const std::string& what) {
                state[name] = b;
                const bool same = what == "empty" && (name == "search" || b.bytes == good.bytes);
                // More bodies of the scene than the state stores are for `Merged` to judge.
                if (name == "search" || (name == "body_of" && spec_.bodies.size() == 1)) {
                    attempt(state, name, what);
                } else {
                    EXPECT_FALSE(attempt(state, name, what) && !same) << name << ": " << what;
                }
            });
            forge_values(good, [&](const Blob& b, const std::string& what) {
                state[name] = b;
                const bool taken = attempt(state, name, what);
                const bool may = name == "sensor_first" || name == "clock_deposit_limit" ||
                                 name.find("first_energy") != std::string::npos ||
                                 name == "clock_stable";
                bool finite = true;
                for (std::size_t k = 0; k < b.shape[0]; ++k) {
                    if (b.type == 'd') finite = finite && std::isfinite(read<double>(b, k));
                    if (b.type == 'f') finite = finite && std::isfinite(read<float>(b, k));
                }
                if (!finite && !may) {
                    EXPECT_FALSE(taken) << name << ": " << what;
                }
            });
        }
        EXPECT_EQ(test::state_bytes(*engine_), before_);
        EXPECT_GT(refused_, tried_ / 3);
        // The engine that has seen all of it goes on with the bits of one that has not.
        engine_->run(20, forever, forever);
        const auto fresh =
            spec_.functions.kind.empty() ? make_cpu_engine(spec_) : make_functions_engine(spec_);
        fresh->load(good_);
        fresh->run(20, forever, forever);
        EXPECT_EQ(test::state_bytes(*engine_), test::state_bytes(*fresh));
        RecordProperty("tried", tried_);
        RecordProperty("refused", refused_);
    }

    /// What no reader may take, by entry: `change` gets its blob.
    void expect_refused(const std::string& name, const std::function<void(Blob&)>& change) {
        State state = good_;
        ASSERT_TRUE(state.contains(name)) << name;
        change(state[name]);
        try {
            engine_->load(state);
            ADD_FAILURE() << name << " was taken";
            engine_->load(good_);
        } catch (const SceneError& e) {
            EXPECT_NE(std::string(e.what()).find("'" + name + "'"), std::string::npos) << e.what();
        }
        EXPECT_EQ(test::state_bytes(*engine_), before_);
    }

    Spec spec_;
    std::unique_ptr<Engine> engine_;
    State good_;
    std::map<std::string, std::vector<unsigned char>> before_;
    int tried_ = 0, refused_ = 0;
};

TEST_F(Forged, states_of_particles_in_single_precision) {
    begin(flowing(true), 150);
    ASSERT_FALSE(good_.at("body1_frozen_id").bytes.empty()) << "the scene must set some aside";
    ASSERT_GT(read<std::uint64_t>(good_.at("supply_layers"), 0), 0u) << "and supply some";
    forge_all();
}
TEST_F(Forged, states_of_particles_that_reach_far) {
    for (const auto& [scheme, kernel] :
         {std::pair("FLIP", Kernel::cpgimp), std::pair("APIC", Kernel::cpdi)}) {
        if (test::sanitized && kernel == Kernel::cpgimp) continue;
        tried_ = refused_ = 0;
        begin(wide(scheme, kernel), 30);
        forge_all();
    }
}
TEST_F(Forged, states_of_several_ranks) {
    if (test::sanitized) GTEST_SKIP() << "what they check is what one rank checks";
    Spec s = flowing(false);
    s.ranks.count = 2;
    s.threads = 2;
    begin(s, 150);
    forge_all();
}
TEST_F(Forged, states_on_functions) {
    begin(on_triangles(), 30);
    forge_all();
}

/// Each rule by itself: what fits in every other respect is refused by the entry that breaks it.
TEST_F(Forged, every_rule_by_its_entry) {
    begin(flowing(false), 150);
    const auto set = [](auto x, std::size_t k = 0) { return [=](Blob& b) { write(b, k, x); }; };
    const auto copy = [](std::size_t to, std::size_t from, std::size_t size) {
        return [=](Blob& b) {
            std::memcpy(b.bytes.data() + to * size, b.bytes.data() + from * size, size);
        };
    };
    const double time = engine_->time(), dt = engine_->time_step();
    expect_refused("clock_time", set(-1.0));
    expect_refused("clock_time", set(1e18));  // a step does not advance it
    expect_refused("clock_dt", set(0.0));
    expect_refused("clock_dt", set(dt * 10));
    expect_refused("clock_dt_stable", set(1.0));
    expect_refused("clock_step", set(std::int64_t(-1)));
    expect_refused("clock_drift", set(1.5));
    expect_refused("clock_unit_read", set(3.0));
    expect_refused("clock_scale_write", set(0.0, 1));
    expect_refused("clock_deposited", set(-1.0));
    expect_refused("clock_log_stride", set(std::int32_t(3)));
    expect_refused("clock_log_step", copy(1, 0, 8));
    expect_refused("clock_log_step", set(std::int64_t(1) << 40, 3));
    expect_refused("clock_log_speed", set(nan));
    expect_refused("sorts_of_table", set(std::int32_t(-1)));
    expect_refused("keys", copy(1, 0, 8));
    expect_refused("keys", set(~std::uint64_t(0), 0));
    // A table that ends before its last blocks: all sizes fit, and neighbours are missing.
    {
        State cut = good_;
        const std::size_t n = cut["keys"].shape[0], block = cut["sums"].bytes.size() / n;
        Blob& keys = cut["keys"];
        const std::size_t drop = 1;  // its particles' neighbour, which holds none itself
        keys.bytes.erase(keys.bytes.begin(), keys.bytes.begin() + 8 * std::ptrdiff_t(drop));
        keys.shape[0] -= drop;
        Blob& sums = cut["sums"];
        sums.bytes.erase(sums.bytes.begin(), sums.bytes.begin() + std::ptrdiff_t(block * drop));
        sums.shape[0] = sums.bytes.size() / 8;
        for (std::size_t b = 0; b < 2; ++b) {
            Blob& start = cut["body" + std::to_string(b) + "_cell_start"];
            ASSERT_EQ(read<std::uint32_t>(start, 64 * drop), 0u);
            start.bytes.erase(start.bytes.begin(),
                              start.bytes.begin() + 256 * std::ptrdiff_t(drop));
            start.shape[0] -= 64 * drop;
        }
        try {
            engine_->load(cut);
            ADD_FAILURE() << "a table without a neighbour was taken";
        } catch (const SceneError& e) {
            EXPECT_NE(std::string(e.what()).find("'keys'"), std::string::npos) << e.what();
        }
    }
    const std::size_t cells = good_["body0_cell_start"].shape[0] - 1;
    expect_refused("body0_cell_start", set(std::uint32_t(1)));
    expect_refused("body0_cell_start", set(~std::uint32_t(0), cells / 2));
    expect_refused("body0_cell_start", set(std::uint32_t(1) << 30, cells));
    expect_refused("body0_id", copy(0, 1, 4));
    expect_refused("body0_id", set(std::uint32_t(1000)));  // one that the body does not keep
    expect_refused("body1_frozen_id", set(read<std::uint32_t>(good_["body1_id"], 0)));
    expect_refused("body0_offset0", set(1.76));
    // Half a cell and twice the way since the last sort.
    const double way = read<double>(good_["clock_drift"], 0);
    expect_refused("body0_offset0", set(-0.51 - 2 * way));
    expect_refused("body0_offset1", set(nan, 3));
    expect_refused("body0_state0", set(HUGE_VAL));
    expect_refused("body1_frozen_position", set(nan));
    expect_refused("body1_frozen_state", set(nan));
    expect_refused("body_of", set(std::int32_t(2), 2));  // its blocks are stepped as one
    expect_refused("body_of", set(std::int32_t(-1), 0));
    expect_refused("sums", [](Blob& b) { std::fill(b.bytes.begin(), b.bytes.end(), 0); });
    expect_refused("sums", set(nan, 100));
    expect_refused("supply_moved", set(-1.0));
    expect_refused("supply_layers", set(std::uint64_t(0)));
    expect_refused("supply_layers", set(std::uint64_t(1) << 40));
    expect_refused("supply_next_id", set(std::uint64_t(3)));
    expect_refused("supply_next_id", set(std::uint64_t(1001)));
    expect_refused("sensor_next", set(std::int64_t(0)));  // samples without end
    expect_refused("sensor_next", set(std::int64_t(1) << 40));
    expect_refused("sensor_next", set(std::int64_t(-5), 1));
    expect_refused("sensor_last", set(2 * time));
    expect_refused("sensor_first", set(HUGE_VAL));
    expect_refused("load_impulse", set(nan));
    expect_refused("format", set(std::int32_t(3)));
}

/// Word by word; versions before this one saved the clock as it lay in memory.
TEST_F(Forged, images_of_earlier_clocks) {
    begin(flowing(false), 150);
    for (bool shorter : {false, true}) {
        const State old = test::as_format_1(good_, shorter);
        engine_->load(old);
        EXPECT_EQ(test::state_bytes(*engine_), before_);
        const std::size_t words = old.at("clock").bytes.size() / 8;
        for (std::size_t k = 0; k<words; k += k> 40 && k < 280 ? 17 : 1) {
            for (const std::uint64_t x :
                 {~std::uint64_t(0), std::uint64_t(0), std::uint64_t(1) << 63,
                  std::uint64_t(0x7ff0000000000000), std::uint64_t(0x7ff8000000000000),
                  std::uint64_t(0x40f86a0000000000)}) {
                State state = old;
                write(state["clock"], k, x);
                attempt(state, "clock", "word " + std::to_string(k));
            }
        }
    }
    EXPECT_GT(refused_, 50);
}

TEST_F(Forged, states_of_an_earlier_version_go_on_with_the_same_bits) {
    for (const Spec& spec : {flowing(false), flowing(true)}) {
        begin(spec, 100);
        const auto other = make_cpu_engine(spec);
        other->load(test::as_format_1(good_));
        for (Engine* e : {engine_.get(), other.get()}) e->run(60, forever, forever);
        EXPECT_EQ(test::state_bytes(*engine_), test::state_bytes(*other));
        EXPECT_EQ(engine_->time(), other->time());
    }
    begin(on_triangles(), 20);
    State old = good_;
    std::vector<double> clock;
    for (const char* name : {"time", "dt", "first_dt", "stable"})
        clock.push_back(read<double>(good_["clock_" + std::string(name)], 0));
    std::vector<std::int64_t> counters;
    for (const char* name : {"step", "watched_at"})
        counters.push_back(read<std::int64_t>(good_["clock_" + std::string(name)], 0));
    std::vector<double> sums = {read<double>(good_["sensor0_last_time"], 0),
                                read<double>(good_["sensor0_first_energy"], 0), 0, 0, 0};
    for (auto e = old.begin(); e != old.end();)
        e = e->first.rfind("clock_", 0) == 0 ? old.erase(e) : std::next(e);
    for (const char* name :
         {"format", "sensor0_last_time", "sensor0_first_energy", "sensor0_impulse"})
        old.erase(name);
    old["clock"] = detail::to_blob(clock);
    old["counters"] = detail::to_blob(counters);
    old["sensor0_sums"] = detail::to_blob(sums);
    const auto other = make_functions_engine(spec_);
    other->load(old);
    for (Engine* e : {engine_.get(), other.get()}) e->run(30, forever, forever);
    EXPECT_EQ(test::state_bytes(*engine_), test::state_bytes(*other));
}

}  // namespace
}  // namespace mpm
