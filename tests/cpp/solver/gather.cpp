// Dense columns of particles: what readers get, in the order of ids, in memory of their own.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <cstring>
#include <numeric>

#include "mpm/core/error.hpp"
#include "support/scene.hpp"

namespace mpm {
namespace {

using test::forever;

std::vector<double> numbers(const DenseColumn& c) {
    std::vector<double> out(c.bytes() / sizeof(double));
    std::memcpy(out.data(), c.data.get(), c.bytes());
    return out;
}
std::vector<std::uint64_t> ids(const DenseColumn& c) {
    std::vector<std::uint64_t> out(c.bytes() / sizeof(std::uint64_t));
    std::memcpy(out.data(), c.data.get(), c.bytes());
    return out;
}

struct Kind {
    int dimension;
    bool single;
};
class Gather : public ::testing::TestWithParam<Kind> {};

TEST_P(Gather, gives_what_readers_get_by_id) {
    const auto [dimension, single] = GetParam();
    const auto engine = make_cpu_engine(test::busy_scene(dimension, single));
    engine->run(25, forever, forever);
    const std::vector<double> origin = {10, 20, 30};
    const auto before = test::state_bytes(*engine);
    for (int body = 0; body < 3; ++body) {
        auto names = engine->attribute_names(body);
        const Gathered got = engine->gather(body, names, origin);
        EXPECT_EQ(got.device, -1);
        names.erase(std::find(names.begin(), names.end(), "id"));
        const Attributes read = engine->attributes(body, names);
        std::vector<std::size_t> order(read.id.size());
        std::iota(order.begin(), order.end(), 0);
        std::sort(order.begin(), order.end(),
                  [&](std::size_t a, std::size_t b) { return read.id[a] < read.id[b]; });
        const auto id = ids(got.columns.at("id"));
        ASSERT_EQ(id.size(), order.size());
        for (std::size_t k = 0; k < id.size(); ++k) ASSERT_EQ(id[k], read.id[order[k]]);
        for (const auto& name : names) {
            const DenseColumn& column = got.columns.at(name);
            const Array& expected = read.values.at(name);
            ASSERT_EQ(column.shape, expected.shape) << name;
            const auto values = numbers(column);
            const std::size_t width = values.size() / id.size();
            for (std::size_t k = 0; k < values.size(); ++k) {
                double e = expected.data[order[k / width] * width + k % width];
                if (name == "position") e += origin[k % width];
                ASSERT_NEAR(values[k], e, 4e-16 * std::max(1.0, std::abs(e))) << name;
            }
        }
        // Part of the ids: the rows of those alone.
        const std::uint64_t first = id[id.size() / 3], count = id[id.size() / 2] - first;
        const Gathered part = engine->gather(body, {"id", "position"}, {}, {first, count});
        const auto some = ids(part.columns.at("id"));
        EXPECT_EQ(some, std::vector<std::uint64_t>(
                            std::lower_bound(id.begin(), id.end(), first),
                            std::lower_bound(id.begin(), id.end(), first + count)));
        EXPECT_EQ(part.columns.at("position").shape[0], some.size());
    }
    EXPECT_EQ(test::state_bytes(*engine), before);
}

TEST(Gathered, columns_are_the_callers_own) {
    const auto engine = make_cpu_engine(test::busy_scene(2, false));
    engine->run(3, forever, forever);
    const Gathered one = engine->gather(0, {"velocity"}, {});
    const DenseColumn& column = one.columns.at("velocity");
    const auto kept = numbers(column);
    const DenseColumn copy = engine->duplicate(column);
    EXPECT_NE(copy.data.get(), column.data.get());
    EXPECT_EQ(numbers(copy), kept);
    std::vector<double> host(kept.size());
    engine->copy_out(copy, host.data());
    EXPECT_EQ(host, kept);
    std::memset(copy.data.get(), 0, copy.bytes());
    engine->run(20, forever, forever);
    EXPECT_EQ(numbers(column), kept) << "it stays as it was while the run goes on";
    EXPECT_NE(numbers(engine->gather(0, {"velocity"}, {}).columns.at("velocity")), kept);
    EXPECT_THROW(engine->gather(0, {"colour"}, {}), SceneError);
}

INSTANTIATE_TEST_SUITE_P(
    Kinds, Gather, ::testing::Values(Kind{2, true}, Kind{2, false}, Kind{3, true}, Kind{3, false}),
    [](const auto& info) {
        return std::to_string(info.param.dimension) + (info.param.single ? "d_single" : "d_double");
    });

}  // namespace
}  // namespace mpm
