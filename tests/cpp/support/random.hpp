// Random numbers with a fixed seed: a failure repeats.
#pragma once

#include <cmath>
#include <random>

#include "mpm/core/linalg.hpp"

namespace mpm::test {

class Random {
public:
    explicit Random(unsigned seed) : engine_(seed) {}
    double between(double low, double high) {
        return std::uniform_real_distribution<double>(low, high)(engine_);
    }
    int integer(int low, int high) {
        return std::uniform_int_distribution<int>(low, high)(engine_);
    }
    template <int D>
    Mat<double, D> matrix(double size) {
        Mat<double, D> m;
        for (auto& row : m.e)
            for (double& x : row) x = between(-size, size);
        return m;
    }
    /// Uniformly distributed rotation.
    template <int D>
    Mat<double, D> rotation() {
        Mat<double, D> q;
        if constexpr (D == 2) {
            const double a = between(0, 6.283185307179586);
            q = {{{std::cos(a), -std::sin(a)}, {std::sin(a), std::cos(a)}}};
        } else {
            std::normal_distribution<double> normal;
            double w[4], square = 0;
            for (double& x : w) {
                x = normal(engine_);
                square += x * x;
            }
            for (double& x : w) x /= std::sqrt(square);
            const double a = w[0], b = w[1], c = w[2], d = w[3];
            q = {{{1 - 2 * (c * c + d * d), 2 * (b * c - a * d), 2 * (b * d + a * c)},
                  {2 * (b * c + a * d), 1 - 2 * (b * b + d * d), 2 * (c * d - a * b)},
                  {2 * (b * d - a * c), 2 * (c * d + a * b), 1 - 2 * (b * b + c * c)}}};
        }
        return q;
    }
    std::mt19937& engine() { return engine_; }

private:
    std::mt19937 engine_;
};

template <int D>
double largest(const Mat<double, D>& m) {
    double out = 0;
    for (const auto& row : m.e)
        for (double x : row) out = std::fmax(out, std::fabs(x));
    return out;
}

}  // namespace mpm::test
