// Rows that are asked for in pieces: of lattices with holes, and some of the rows of others.
#include "mpm/solver/rows.hpp"

#include <gtest/gtest.h>

#include <atomic>
#include <numeric>
#include <stdexcept>

#include "mpm/core/error.hpp"
#include "support/random.hpp"

namespace mpm {
namespace {

std::vector<double> axis(int n, double from) {
    std::vector<double> x(static_cast<std::size_t>(n));
    for (int k = 0; k < n; ++k) x[std::size_t(k)] = from + 0.1 * k;
    return x;
}

/// (4, 3, 5) points without those of (1..2, 0..1, 2..4): sections of two kinds along the first
/// axis.
std::shared_ptr<const LatticePoints> holed() {
    const auto points = [](int dimension, std::vector<LatticePoints::Run> runs) {
        return std::make_shared<const LatticePoints>(dimension, std::move(runs));
    };
    const auto point = std::make_shared<const LatticePoints>(true);
    const auto line = points(1, {{axis(5, 7), point}}), shorter = points(1, {{axis(2, 7), point}}),
               whole = points(2, {{axis(3, 4), line}}),
               cut = points(2, {{axis(2, 4), shorter}, {{4.2}, line}});
    return points(3, {{{1.0}, whole}, {{1.1, 1.2}, cut}, {{1.3}, whole}});
}

/// The same by looking at every point.
std::vector<double> holed_by_hand() {
    std::vector<double> out;
    const auto x = axis(4, 1), y = axis(3, 4), z = axis(5, 7);
    for (int i = 0; i < 4; ++i)
        for (int j = 0; j < 3; ++j)
            for (int k = 0; k < 5; ++k) {
                if ((i == 1 || i == 2) && j < 2 && k >= 2) continue;
                for (double v : {x[std::size_t(i)], y[std::size_t(j)], z[std::size_t(k)]})
                    out.push_back(v);
            }
    return out;
}

TEST(Rows, a_lattice_in_pieces_of_any_size) {
    const auto points = holed();
    const auto all = holed_by_hand();
    ASSERT_EQ(points->count() * 3, all.size());
    const Rows rows = lattice_rows(points);
    for (std::uint64_t first = 0; first <= points->count(); ++first)
        for (std::uint64_t last = first; last <= points->count(); ++last) {
            std::vector<double> piece((last - first) * 3);
            rows(first, last, piece.data());
            for (std::size_t k = 0; k < piece.size(); ++k)
                ASSERT_DOUBLE_EQ(piece[k], all[first * 3 + k]) << first << " to " << last;
        }
    double none;
    EXPECT_THROW(rows(0, points->count() + 1, &none), SceneError);
}

TEST(Rows, still_water) {
    const auto points = holed();
    const Rows rows = still_water_rows(points, {2.0, 7.25, {0.0, 0.0, 1.0}});
    const auto all = holed_by_hand();
    std::vector<double> p(points->count());
    rows(0, p.size(), p.data());
    for (std::size_t k = 0; k < p.size(); ++k)
        EXPECT_DOUBLE_EQ(p[k], 2.0 * std::max(7.25 - all[3 * k + 2], 0.0));
}

TEST(Rows, chosen_ones_whether_at_hand_or_not) {
    constexpr std::uint64_t n = 300'000;  // more than is asked for at once
    std::vector<double> values(2 * n);
    std::iota(values.begin(), values.end(), 0.0);
    test::Random random(5);
    auto runs = std::make_shared<RowRuns>();
    std::vector<std::uint64_t> chosen;
    for (std::uint64_t row = 0; row < n;) {
        const auto skip = std::uint64_t(random.between(0, 40)),
                   take = std::uint64_t(random.between(0, random.between(0, 1) < 0.01 ? 1e5 : 9));
        row = std::min(n, row + skip);
        const std::uint64_t end = std::min(n, row + take);
        runs->add(row, end);
        for (; row < end; ++row) chosen.push_back(row);
    }
    ASSERT_EQ(runs->count(), chosen.size());
    int asked = 0;
    Rows counted([&](std::uint64_t first, std::uint64_t last, double* out) {
        ++asked;
        std::copy_n(values.begin() + std::ptrdiff_t(2 * first), 2 * (last - first), out);
    });
    for (const Rows& all : {rows_of(values, 2), counted}) {
        const Rows rows = chosen_rows(all, runs, 2);
        const int before = asked;
        std::vector<double> out(2 * chosen.size() - 14);
        rows(3, chosen.size() - 4, out.data());
        for (std::size_t k = 0; k < out.size(); ++k)
            ASSERT_EQ(out[k], double(2 * chosen[3 + k / 2] + k % 2));
        EXPECT_EQ(asked, before) << "what is not at hand is asked for once, when it is chosen";
    }
    EXPECT_GT(asked, 0);
}

TEST(Rows, parts_cover_all_and_throw) {
    std::vector<std::atomic<int>> seen(10'007);
    in_parallel(seen.size(), 10, [&](std::uint64_t first, std::uint64_t last) {
        for (; first < last; ++first) ++seen[first];
    });
    for (const auto& n : seen) EXPECT_EQ(n, 1);
    EXPECT_THROW(in_parallel(1000, 1,
                             [](std::uint64_t first, std::uint64_t) {
                                 if (first > 0 || most_threads() == 1)
                                     throw std::runtime_error("a part");
                             }),
                 std::runtime_error);
}

}  // namespace
}  // namespace mpm
