// T1 of Yang (2016): smoothing of a bar's strain, pass after pass: the index I_E against values
// from an independent implementation, and what holds of every form in one, two and three
// dimensions.
#include "mpm/kernels/cpu/smooth_points.hpp"

#include <gtest/gtest.h>

#include <cmath>
#include <functional>
#include <map>
#include <random>
#include <string>

namespace mpm {
namespace {

const std::map<std::string, SmoothingChoice>& forms() {
    using F = CellForm;
    using L = FluxLimiter;
    static const std::map<std::string, SmoothingChoice> all = {
        {"C0", {F::constant, L::none, false, 1, false}},
        {"C1", {F::linear, L::none, false, 1, false}},
        {"NB", {F::nodal, L::none, false, 1, false}},
        {"F0", {F::flux, L::none, false, 1, false}},
        {"F0L1", {F::flux, L::linear, false, 1, false}},
        {"F0L2", {F::flux, L::quadratic, false, 1, false}},
        {"F0A", {F::flux, L::none, true, 1, false}},
        {"F0AL1", {F::flux, L::linear, true, 1, false}},
        {"F0AL2", {F::flux, L::quadratic, true, 1, false}},
        {"F1", {F::linear_flux, L::none, false, 1, false}},
        {"F1 cheap", {F::linear_flux, L::none, false, 1, true}}};
    return all;
}

/// Thirty particles in ten cells of a bar of length 1.
struct Bar {
    std::vector<double> x, m, q;
    explicit Bar(const std::function<double(double, int)>& strain) {
        for (int k = 0; k < 30; ++k) {
            x.push_back((k + 0.5) / 30);
            m.push_back(1);
            q.push_back(strain(x.back(), k / 3));
        }
    }
    cpu::PointField field() const { return {1, 30, 1, x.data(), m.data(), 0.1}; }
    double mean() const {
        double s = 0;
        for (double v : q) s += v / 30;
        return s;
    }
    double about_mean() const {
        double s = 0;
        for (double v : q) s += (v - mean()) * (v - mean());
        return s;
    }
};

double line(double x, int) { return x; }
double square(double x, int) { return (x - 0.5) * (x - 0.5); }
double cubic(double x, int) { return (x - 0.2) * (x - 0.5) * (x - 0.8); }
double board(double, int cell) { return cell % 2 ? -1 : 1; }

struct Row {
    const char* form;
    double (*strain)(double, int);
    double index[4];  // after 1, 10, 100, 10000 passes
};

constexpr double L = -8.0 / 899, Q = -0.044295;
const Row rows[] = {
    {"C0", line, {L, L, L, L}},
    {"F0L1", line, {L, L, L, L}},
    {"F0L2", line, {L, L, L, L}},
    {"F0A", line, {L, L, L, L}},
    {"F0AL1", line, {L, L, L, L}},
    {"F0AL2", line, {L, L, L, L}},
    {"C1", line, {0, 0, 0, 0}},
    {"F1", line, {0, 0, 0, 0}},
    {"F1 cheap", line, {-0.002455, -0.005595, -0.005612, -0.005612}},
    {"F0", line, {-0.061457, -0.403759, -0.993105, -1}},
    {"NB", line, {-0.038331, -0.303041, -0.969455, -1}},
    {"C0", square, {Q, Q, Q, Q}},
    {"F0L2", square, {Q, Q, Q, Q}},
    {"F0AL1", square, {Q, Q, Q, Q}},
    {"F0AL2", square, {Q, Q, Q, Q}},
    {"F0L1", square, {-0.051422, -0.108933, -0.496460, -1}},
    {"F0A", square, {-0.047010, -0.051516, -0.111713, -0.967374}},
    {"C1", square, {-0.000050, -0.000050, -0.000050, -0.000050}},
    {"F1", square, {-0.000050, -0.000050, -0.000050, -0.000050}},
    {"C0", cubic, {-0.083470, -0.083470, -0.083470, -0.083470}},
    {"F0L1", cubic, {-0.116640, -0.298942, -0.652987, -0.736905}},
    {"F0L2", cubic, {-0.084922, -0.095013, -0.121798, -0.131043}},
    {"F0A", cubic, {-0.087666, -0.160761, -0.176666, -0.176666}},
    {"F0AL1", cubic, {-0.084664, -0.085937, -0.085944, -0.085944}},
    {"F0AL2", cubic, {-0.084264, -0.085871, -0.085944, -0.085944}},
    {"C0", board, {0, 0, 0, 0}},
    {"C1", board, {0, 0, 0, 0}},
    {"F0", board, {-0.950000, -0.987260, -0.999856, -1}},
    {"F0A", board, {-0.950000, -0.970000, -0.970000, -0.970000}},
    {"F0L1", board, {-0.875000, -0.956019, -0.979852, -0.984695}},
    {"F0AL1", board, {-0.875000, -0.922094, -0.932524, -0.932524}},
    {"F0L2", board, {-0.634345, -0.779380, -0.787264, -0.800000}},
    {"F1", board, {-0.192408, -0.757801, -0.816290, -0.816290}},
    {"NB", board, {-0.935185, -0.984598, -0.999369, -1}},
};

TEST(SmoothPoints, energy_index_of_bars) {
    const int passes[] = {1, 10, 100, 10000};
    for (const Row& row : rows) {
        Bar bar(row.strain);
        const double mean = bar.mean(), before = bar.about_mean();
        int done = 0;
        for (int k = 0; k < 4; ++k) {
            const auto energies = cpu::smooth_points(bar.field(), forms().at(row.form),
                                                     passes[k] - done, bar.q.data());
            done = passes[k];
            EXPECT_NEAR(bar.about_mean() / before - 1, row.index[k], 1e-5)
                << row.form << " after " << done << ", row " << &row - rows;
            EXPECT_NEAR(bar.mean(), mean, 1e-10) << row.form;
            for (const SmoothingEnergy& e : energies)
                ASSERT_TRUE(e.sound(1e-14)) << row.form << " " << e.change() / e.before;
        }
    }
}

TEST(SmoothPoints, particles_that_drift_lose_more) {
    struct Drift {
        const char* form;
        double index[4];
    };
    const Drift drifts[] = {{"C0", {L, L, L, -0.585135}},    {"F0A", {L, L, L, -0.585135}},
                            {"F0AL1", {L, L, L, -0.585135}}, {"F0AL2", {L, L, L, -0.585135}},
                            {"F0L1", {L, L, L, -0.931966}},  {"F0L2", {L, L, L, -0.922264}}};
    for (const Drift& d : drifts) {
        Bar bar(line);
        const double before = bar.about_mean();
        const std::vector<double> start = bar.x;
        for (int s = 1; s <= 10000; ++s) {
            cpu::smooth_points(bar.field(), forms().at(d.form), 1, bar.q.data());
            const double index = bar.about_mean() / before - 1;
            for (std::size_t k = 0; k < 30; ++k) bar.x[k] = start[k] - 1.3e-4 * s;
            const double want = s == 1     ? d.index[0]
                                : s == 10  ? d.index[1]
                                : s == 100 ? d.index[2]
                                           : d.index[3];
            if (s == 1 || s == 10 || s == 100 || s == 10000) {
                EXPECT_NEAR(index, want, 1e-5) << d.form << " after " << s;
            } else if (s == 1000 && std::string(d.form) == "C0") {
                EXPECT_NEAR(index, -0.098828, 1e-5);
            }
        }
    }
}

template <int D>
void random_points(const std::string& form) {
    std::mt19937 generator(7 * D);
    std::uniform_real_distribution<double> one(0, 1);
    const int n = 400, components = 2;
    std::vector<double> x, m, q;
    for (int k = 0; k < n; ++k) {
        for (int a = 0; a < D; ++a) x.push_back((one(generator) - 0.5) * (D == 1 ? 40 : 6));
        m.push_back(0.2 + one(generator));
        for (int c = 0; c < components; ++c) q.push_back(one(generator) - 0.3);
    }
    const cpu::PointField field{D, n, components, x.data(), m.data(), 0.7};
    const auto sum = [&](int c) {
        double s = 0;
        for (int k = 0; k < n; ++k) s += m[k] * q[k * components + c];
        return s;
    };
    const double before[] = {sum(0), sum(1)};
    for (const auto& e : cpu::smooth_points(field, forms().at(form), 20, q.data()))
        EXPECT_TRUE(e.sound(1e-14)) << form << " in " << D << "D: " << e.change() / e.before;
    for (int c = 0; c < components; ++c) EXPECT_NEAR(sum(c), before[c], 1e-11) << form;
}

TEST(SmoothPoints, mass_means_stay_and_energy_never_rises) {
    for (const auto& [name, form] : forms()) {
        random_points<1>(name);
        random_points<2>(name);
        random_points<3>(name);
    }
}

TEST(SmoothPoints, linear_fields_stay_linear_on_full_lattices) {
    for (const char* form : {"C1", "F1"}) {
        std::vector<double> x, m, q;
        for (int i = 0; i < 12; ++i)
            for (int j = 0; j < 12; ++j) {
                x.push_back(0.25 + 0.5 * i);
                x.push_back(0.25 + 0.5 * j);
                m.push_back(1);
                q.push_back(1 + 2 * x[x.size() - 2] - 3 * x.back());
            }
        const std::vector<double> before = q;
        cpu::smooth_points({2, 144, 1, x.data(), m.data(), 1}, forms().at(form), 5, q.data());
        for (std::size_t k = 0; k < q.size(); ++k) EXPECT_NEAR(q[k], before[k], 1e-12);
    }
}

}  // namespace
}  // namespace mpm
