// Many particles that add to the same nodes: a vectorised scatter that forgets that lanes may
// collide loses mass here. All precisions, dimensions, pipelines and thread counts.
#include <gtest/gtest.h>

#include <cmath>
#include <numeric>

#include "support/scene.hpp"

namespace mpm {
namespace {

constexpr int particles = test::sanitized ? 2000 : 10000;

struct Setup {
    int dimension;
    bool single;
    const char* pipeline;
    const char* material;
};
void PrintTo(const Setup& s, std::ostream* out) {
    *out << s.dimension << "D " << (s.single ? "single " : "double ") << s.pipeline << ' '
         << s.material;
}

class Collision : public ::testing::TestWithParam<Setup> {
protected:
    int D = GetParam().dimension;
    double tolerance = GetParam().single ? 2e-5 : 2e-12;

    Spec scene(const std::vector<double>& position, int threads) {
        std::vector<std::int64_t> cells(std::size_t(D), 24);
        Spec s = test::empty_scene(D, GetParam().single, cells);
        s.threads = threads;
        s.pipeline = GetParam().pipeline;
        const bool water = std::string(GetParam().material) == "TaitFluid";
        s.bodies.push_back(test::body(s, "pile", GetParam().material,
                                      water ? test::fluid() : test::solid(), position, 8));
        return s;
    }
    std::vector<double> velocity() const {
        std::vector<double> v = {0.5, -0.25, 0.125};
        v.resize(std::size_t(D));
        return v;
    }

    /// Grid values by cell number.
    std::map<std::vector<int>, std::vector<double>> nodes(Engine& engine) {
        const Array x = engine.grid("position"), m = engine.grid("mass"),
                    v = engine.grid("velocity");
        std::map<std::vector<int>, std::vector<double>> out;
        for (std::size_t k = 0; k < m.data.size(); ++k) {
            std::vector<int> cell;
            std::vector<double> row = {m.data[k]};
            for (int a = 0; a < D; ++a) {
                cell.push_back(int(std::floor(x.data[k * std::size_t(D) + std::size_t(a)] / 0.1)));
                row.push_back(m.data[k] * v.data[k * std::size_t(D) + std::size_t(a)]);
            }
            out[cell] = row;
        }
        return out;
    }
    /// Nodal masses by the definition of the weights, from the particles' own positions.
    std::map<std::vector<int>, double> expected_mass(Engine& engine, double particle_mass) {
        const Array x = engine.attributes(0, {"position"}).values.at("position");
        std::map<std::vector<int>, double> out;
        for (std::size_t p = 0; p < x.shape[0]; ++p) {
            for (int n = 0; n < (D == 2 ? 9 : 27); ++n) {
                std::vector<int> cell;
                double weight = particle_mass;
                int rest = n;
                for (int a = 0; a < D; ++a) {
                    const double s = x.data[p * std::size_t(D) + std::size_t(a)] / 0.1;
                    const int node = int(std::floor(s)) + rest % 3 - 1;
                    const double d = std::fabs(node + 0.5 - s);
                    weight *= d < 0.5 ? 0.75 - d * d : (d < 1.5 ? 0.5 * (1.5 - d) * (1.5 - d) : 0);
                    cell.push_back(node);
                    rest /= 3;
                }
                out[cell] += weight;
            }
        }
        return out;
    }

    void check(const std::vector<double>& position) {
        std::map<std::vector<int>, std::vector<double>> first;
        for (int threads = 1; threads <= 4; ++threads) {
            Spec s = scene(position, threads);
            s.bodies[0].velocity = velocity();
            const double m = s.bodies[0].particle_mass;
            const auto engine = make_cpu_engine(s);
            for (int step = 0; step < 3; ++step) {
                const auto found = nodes(*engine);
                std::vector<double> total(std::size_t(D) + 1, 0.0);
                for (const auto& [cell, row] : found)
                    for (std::size_t c = 0; c < row.size(); ++c) total[c] += row[c];
                ASSERT_NEAR(total[0], particles * m, tolerance * particles * m)
                    << threads << " threads, step " << step;
                for (int a = 0; a < D; ++a) {
                    ASSERT_NEAR(total[std::size_t(a) + 1],
                                particles * m * velocity()[std::size_t(a)],
                                tolerance * particles * m)
                        << threads << " threads, step " << step;
                }
                const auto expected = expected_mass(*engine, m);
                for (const auto& [cell, mass] : expected) {
                    if (mass < 1e-6 * m) continue;
                    ASSERT_TRUE(found.count(cell));
                    // Thousands of equal terms, one after the other, round the same way.
                    ASSERT_NEAR(found.at(cell)[0], mass, 20 * tolerance * mass + tolerance * m)
                        << threads << " threads, step " << step;
                }
                ASSERT_EQ(engine->run(1, test::forever, test::forever).reason, "steps");
            }
            if (threads == 1)
                first = nodes(*engine);
            else
                ASSERT_EQ(nodes(*engine), first) << "bits depend on the number of threads";
        }
    }
};

TEST_P(Collision, on_one_point) {
    std::vector<double> position;
    for (int p = 0; p < particles; ++p)
        for (int a = 0; a < D; ++a) position.push_back(1.0 + 0.013 * (a + 1));
    check(position);
}

/// Around the corner where blocks meet: all cells of one node's support, in 2^D blocks.
TEST_P(Collision, on_the_support_of_one_node) {
    test::Random random(41);
    std::vector<double> position;
    for (int p = 0; p < particles; ++p)
        for (int a = 0; a < D; ++a) position.push_back(0.1 * (8.5 + random.between(-1.49, 1.49)));
    check(position);
}

INSTANTIATE_TEST_SUITE_P(All, Collision,
                         ::testing::Values(Setup{3, true, "fused", "TaitFluid"},
                                           Setup{3, false, "fused", "TaitFluid"},
                                           Setup{2, true, "fused", "TaitFluid"},
                                           Setup{2, false, "fused", "TaitFluid"},
                                           Setup{3, true, "two-pass", "TaitFluid"},
                                           Setup{2, false, "two-pass", "TaitFluid"},
                                           Setup{3, true, "fused", "FixedCorotated"},
                                           Setup{2, false, "fused", "FixedCorotated"}));

}  // namespace
}  // namespace mpm
