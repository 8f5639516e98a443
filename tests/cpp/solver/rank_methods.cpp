// Several ranks against one by transfer, kernel, material and form of F-bar: the same bits of what
// particles store and of what is read of them, with particles that change ranks, new cuts, messages
// that come late, and a run that is saved by some ranks and goes on on others.
#include <gtest/gtest.h>

#include <functional>
#include <limits>

#include "mpm/solver/ranks.hpp"
#include "support/ranks.hpp"
#include "support/scene.hpp"
#include "support/unruly.hpp"

namespace mpm {
namespace {

using test::expect_same_particles;
using test::expect_same_samples;
using test::expect_same_smoothing;
using test::expect_same_states;
using test::forever;
using test::go;
using test::with_ranks;

constexpr int half = test::sanitized ? 10 : 20;

/// Water that runs under a solid block which falls, in a closed box; sensors of all kinds.
Spec small_scene(int dimension, bool single) {
    const bool flat = dimension == 2;
    Spec s = test::empty_scene(
        dimension, single,
        flat ? std::vector<std::int64_t>{44, 24} : std::vector<std::int64_t>{20, 8, 12});
    const int up = dimension - 1;
    s.gravity.value[std::size_t(up)] = -9.81;
    s.bodies.push_back(test::body(
        s, "water", "TaitFluid", test::fluid(),
        flat ? test::lattice(s, {0, 0}, {24, 10}, 2) : test::lattice(s, {0, 0, 0}, {11, 8, 4}, 2),
        flat ? 4 : 8));
    s.bodies.push_back(test::body(
        s, "block", "FixedCorotated", test::solid(),
        flat ? test::lattice(s, {9, 12}, {15, 17}, 2) : test::lattice(s, {4, 2, 6}, {8, 6, 9}, 2),
        flat ? 4 : 8));
    s.bodies[0].velocity[0] = 5;
    s.bodies[1].velocity[0] = 6;
    s.bodies[1].velocity[std::size_t(up)] = -3;
    test::add_walls(s, Response::separable);
    test::add_energy(s, 0.003);
    SensorSpec load;
    load.name = "load";
    load.kind = SensorKind::load_cell;
    load.boundary = 0;
    load.faces = (1 << (2 * dimension)) - 1;
    load.interval = 0.004;
    load.reference.assign(std::size_t(dimension), 0.0);
    s.sensors.push_back(load);
    SensorSpec track;
    track.name = "track";
    track.kind = SensorKind::tracker;
    track.body = 1;
    track.interval = 0.002;
    track.ids = {s.bodies[1].first_id + 5, s.bodies[1].first_id};
    s.sensors.push_back(track);
    SensorSpec gauge;
    gauge.name = "gauge";
    gauge.kind = SensorKind::wave_gauge;
    gauge.interval = 0.004;
    gauge.axis = up;
    gauge.position = flat ? std::vector<double>{1.23, 0} : std::vector<double>{0.63, 0.41, 0};
    gauge.body = 0;
    s.sensors.push_back(gauge);
    SensorSpec probe = gauge;
    probe.name = "probe";
    probe.kind = SensorKind::velocity_probe;
    probe.position[std::size_t(up)] = 0.31;
    s.sensors.push_back(probe);
    return s;
}

void smooth(BodySpec& b, SmoothingForm form) {
    b.smoothing = form;
    b.smoothing_time = 0.01;
    b.smoothing_ratio = 0.1;
}
void by_functions(Spec& s, Kernel kernel) {
    s.kernel.kernel = kernel;
    s.kernel.gradient = GradientForm::shapes;
}

struct Method {
    std::string name;
    std::function<void(Spec&)> choose;
    int dimension = 2;
    bool single = false;
};
std::ostream& operator<<(std::ostream& out, const Method& m) { return out << m.name; }

class RankMethods : public ::testing::TestWithParam<Method> {
protected:
    Spec scene() {
        Spec s = small_scene(GetParam().dimension, GetParam().single);
        GetParam().choose(s);
        return s;
    }
};

TEST_P(RankMethods, have_the_bits_of_one) {
    const Spec s = scene();
    for (const BodySpec& body : s.bodies)
        if (test::sanitized && !test::is_built(body.material))
            GTEST_SKIP() << body.material << " is not among the few that sanitizers are built with";
    const int bodies = int(s.bodies.size());
    const auto one = make_cpu_engine(s);
    go(*one, half);
    const State saved = one->save();
    ASSERT_EQ(go(*one, half).reason, "steps");
    ASSERT_GT(one->statistics().at("sorts"), 1) << "the scene must sort to mean anything";
    const auto samples = one->drain();

    const Spec planes = with_ranks(s, 2, 0, 1.05);
    const auto two = make_cpu_engine(planes);
    go(*two, half);
    go(*two, half);
    EXPECT_GT(two->statistics().at("migrated"), 0);
    expect_same_states(*two, *one, bodies);
    expect_same_samples(two->drain(), samples, planes, GetParam().single ? 1e-6 : 1e-11);
    expect_same_smoothing(*two, *one, bodies, 1e-11);

    // From one to three that cut at every sort, and on to four whose messages come late.
    const auto three = make_cpu_engine(with_ranks(s, 3, RanksSpec::curve, 0));
    three->load(saved);
    go(*three, half / 2);
    const auto four = make_cpu_engine(with_ranks(s, 4, RanksSpec::curve, 1.0),
                                      std::make_unique<test::UnrulyRanks>(4, 5));
    four->load(three->save());
    go(*four, half - half / 2);
    expect_same_states(*four, *one, bodies);
}

void keeps(Spec& s, const char* scheme) {
    s.transfer.scheme = scheme;
    for (BodySpec& b : s.bodies) {
        b.keep = 0.97;
        b.shift.rule = ShiftRule::binary;
        b.shift.shift_max = 1;
        b.shift.shift_min = 0.2;
    }
}

/// Bodies of fluid in one pass over the particles, others phased.
const std::vector<Method> stores = {
    {"FLIP", [](Spec& s) { keeps(s, "FLIP"); }},
    {"AFLIP_two_volumes",
     [](Spec& s) {
         keeps(s, "AFLIP");
         smooth(s.bodies[0], SmoothingForm::two_volume);
     }},
    {"NFLIP_one_volume",
     [](Spec& s) {
         keeps(s, "NFLIP");
         smooth(s.bodies[0], SmoothingForm::one_volume_gradient);
     }},
    {"ASFLIP_guarded_3D_single", [](Spec& s) { keeps(s, "ASFLIP"); }, 3, true},
    {"AFLIP_turning",
     [](Spec& s) {
         keeps(s, "AFLIP");
         s.bodies[1].velocity_gradient = {0, -4, 4, 0};
     }},
    {"SFLIP_phased",
     [](Spec& s) {
         keeps(s, "SFLIP");
         s.pipeline = "phased";
     }},
};
const std::vector<Method> forms = {
    {"PIC", [](Spec& s) { s.transfer.scheme = "PIC"; }},
    {"APIC_phased_3D_single", [](Spec& s) { s.pipeline = "phased"; }, 3, true},
    {"one_volume_on_solid",
     [](Spec& s) {
         for (BodySpec& b : s.bodies) smooth(b, SmoothingForm::one_volume);
     }},
    {"two_volumes_on_solid_that_turns",
     [](Spec& s) {
         smooth(s.bodies[1], SmoothingForm::two_volume);
         s.bodies[1].velocity_gradient = {0, -4, 4, 0};
     }},
    {"literal",
     [](Spec& s) {
         for (BodySpec& b : s.bodies) smooth(b, SmoothingForm::literal);
     }},
    {"split_on_one_of_two", [](Spec& s) { smooth(s.bodies[1], SmoothingForm::split); }},
    {"split_with_FLIP",
     [](Spec& s) {
         keeps(s, "FLIP");
         for (BodySpec& b : s.bodies) smooth(b, SmoothingForm::split);
     }},
    {"HerschelBulkleyFluid",
     [](Spec& s) {
         s.bodies[0].material = "HerschelBulkleyFluid";
         s.bodies[0].parameters = {1000, 2e5, 7.15, 40, 5, 0.8, 50};
     }},
    {"CamClay",
     [](Spec& s) {
         s.bodies[1].material = "CamClay";
         s.bodies[1].parameters = {800, 1e6, 0.3, -0.05, 30, 0.5, 0.8, 1};
     }},
    {"XPIC",
     [](Spec& s) {
         s.transfer.scheme = "XPIC";
         s.transfer.order = 3;
     }},
    {"FMPM_every_second_cubic",
     [](Spec& s) {
         s.transfer.scheme = "FMPM";
         s.transfer.order = 2;
         s.transfer.every = 2;
         s.kernel.kernel = Kernel::cubic;
     }},
    {"damping",
     [](Spec& s) {
         keeps(s, "FLIP");
         s.bodies[1].damping = 0.05;
     }},
};
const std::vector<Method> kernels = {
    {"cubic", [](Spec& s) { s.kernel.kernel = Kernel::cubic; }},
    {"cubic_3D_AFLIP",
     [](Spec& s) {
         keeps(s, "AFLIP");
         s.kernel.kernel = Kernel::cubic;
     },
     3},
    {"linear_PIC_FLIP",
     [](Spec& s) {
         keeps(s, "PIC-FLIP");
         by_functions(s, Kernel::linear);
     }},
    {"boundary_splines",
     [](Spec& s) {
         keeps(s, "FLIP");
         by_functions(s, Kernel::quadratic);
         s.kernel.clamped = true;
     }},
    {"gimp", [](Spec& s) { by_functions(s, Kernel::ugimp); }},
    {"cpgimp_FLIP",
     [](Spec& s) {
         keeps(s, "FLIP");
         by_functions(s, Kernel::cpgimp);
     }},
    {"cpdi", [](Spec& s) { by_functions(s, Kernel::cpdi); }},
    {"ddmp_FLIP",
     [](Spec& s) {
         keeps(s, "FLIP");
         by_functions(s, Kernel::ddmp);
     }},
    {"cubic_mirrored",
     [](Spec& s) {
         s.kernel.kernel = Kernel::cubic;
         for (SurfaceLaw& law : s.boundaries[0].law) law.response = Response::mirror;
     }},
};
/// Both bodies over cells: a fluid's volume and a strain.
void over_cells(Spec& s, const SmoothingChoice& choice) {
    s.bodies[1].material = "LinearElastic";
    s.bodies[1].parameters = {800, 1e6, 0.3};
    for (BodySpec& b : s.bodies) b.cell_smoothing = choice;
    s.bodies[0].smoothed_field = "volume";
    s.bodies[1].smoothed_field = "strain";
}
void assume(Spec& s, CellForm form, TensorPart part) {
    for (BodySpec& b : s.bodies) {
        b.assumed.form = form;
        b.assumed_part = part;
    }
}
const std::vector<Method> cells = {
    {"C0", [](Spec& s) { over_cells(s, {CellForm::constant}); }},
    {"C1_3D_single", [](Spec& s) { over_cells(s, {CellForm::linear}); }, 3, true},
    {"F0AL2",
     [](Spec& s) {
         over_cells(s, {CellForm::flux, FluxLimiter::quadratic, true});
     }},
    {"F0AL1_3D",
     [](Spec& s) {
         over_cells(s, {CellForm::flux, FluxLimiter::linear, true});
     },
     3},
    {"F1_FLIP",
     [](Spec& s) {
         keeps(s, "FLIP");
         over_cells(s, {CellForm::linear_flux});
     }},
    {"nodal_cubic",
     [](Spec& s) {
         s.kernel.kernel = Kernel::cubic;
         over_cells(s, {CellForm::nodal});
     }},
    {"nodal_cubic_3D",
     [](Spec& s) {
         s.kernel.kernel = Kernel::cubic;
         over_cells(s, {CellForm::nodal});
     },
     3},
    {"nodal_gimp",
     [](Spec& s) {
         by_functions(s, Kernel::ugimp);
         over_cells(s, {CellForm::nodal});
     }},
    {"nodal_cpdi",
     [](Spec& s) {
         by_functions(s, Kernel::cpdi);
         over_cells(s, {CellForm::nodal});
     }},
    {"F0_between_nodes",
     [](Spec& s) {
         keeps(s, "PIC-FLIP");
         by_functions(s, Kernel::linear);
         over_cells(s, {CellForm::flux});
     }},
    {"assumed_cells_FLIP",
     [](Spec& s) {
         keeps(s, "FLIP");
         assume(s, CellForm::constant, TensorPart::full);
     }},
    {"assumed_nodes_smoothed",
     [](Spec& s) {
         s.transfer.scheme = "PIC";
         over_cells(s, {CellForm::constant});
         assume(s, CellForm::nodal, TensorPart::volumetric);
     }},
    {"placed_force_FLIP",
     [](Spec& s) {
         keeps(s, "FLIP");
         s.bodies[1].force.axis = 0;
         s.bodies[1].force.place = {0, 1};
         s.bodies[1].force.value = {0, 0, 1, 0};
     }},
};
const auto name_of_method = [](const auto& info) { return info.param.name; };
INSTANTIATE_TEST_SUITE_P(Stores, RankMethods, ::testing::ValuesIn(stores), name_of_method);
INSTANTIATE_TEST_SUITE_P(Forms, RankMethods, ::testing::ValuesIn(forms), name_of_method);
INSTANTIATE_TEST_SUITE_P(Kernels, RankMethods, ::testing::ValuesIn(kernels), name_of_method);
INSTANTIATE_TEST_SUITE_P(Cells, RankMethods, ::testing::ValuesIn(cells), name_of_method);

/// Layers that come with a velocity of their own, and particles that leave with theirs.
TEST(RankMethodsFlow, inlets_and_outlets) {
    for (const char* kind : {"auto", "phased", "smoothed"}) {
        Spec s = test::empty_scene(2, false, {32, 12});
        const bool smoothed = std::string(kind) == "smoothed";
        s.pipeline = smoothed ? "auto" : kind;
        s.bodies.push_back(test::body(s, "water", "TaitFluid", test::fluid(),
                                      test::lattice(s, {0, 2}, {30, 8}, 2), 4));
        s.bodies[0].velocity = {4, 0};
        s.bodies[0].id_count = 100000;
        keeps(s, smoothed ? "FLIP" : "AFLIP");
        if (smoothed) {
            s.bodies[0].cell_smoothing.form = CellForm::flux;
            s.bodies[0].smoothed_field = "volume";
            assume(s, CellForm::constant, TensorPart::volumetric);
        }
        InletSpec inlet;
        inlet.name = "in";
        inlet.body = 0;
        inlet.spacing = 0.05;
        for (int k = 4; k < 16; ++k) {
            inlet.points.push_back(0.025);
            inlet.points.push_back((k + 0.5) * 0.05);
        }
        inlet.velocity.time = {0};
        inlet.velocity.value = {4};
        s.inlets.push_back(inlet);
        s.outlets.push_back({"out", 1});
        s.leaving = Leaving::remove;
        const auto one = make_cpu_engine(s);
        one->run(-1, 0.15, forever);
        bool came = false, went = false;
        for (const Flow& f : one->flows()) (f.inlet ? came : went) = true;
        ASSERT_TRUE(came && went);
        const auto many = make_cpu_engine(with_ranks(s, 3, 0, 1.05));
        many->run(-1, 0.15, forever);
        expect_same_states(*many, *one, 1);
    }
}

}  // namespace
}  // namespace mpm
