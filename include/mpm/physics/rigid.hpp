// Motion of a rigid body: inertia, free flight, and the impulses at points where others hold it
// (design/rigid.md). In double precision, whatever the particles have.
//
//   p = M v,  l = I w;   between impulses p changes by M g dt and l is kept.
//
// In space the body turns by the symmetric splitting of free rotation (Dullweber, Leimkuhler and
// McLachlan 1997): each part is an exact turn about a principal axis, so that l is kept to rounding
// and the energy stays within a bound of second order for any time.
#pragma once

#include <cmath>

#include "mpm/core/eigen.hpp"
#include "mpm/core/linalg.hpp"

namespace mpm {

/// Numbers of a turn's rate, and of an orientation: an angle, or a quaternion.
template <int D>
inline constexpr int spins = D == 2 ? 1 : 3;
template <int D>
inline constexpr int turns = D == 2 ? 1 : 4;

/// r x J, or its only component in the plane.
template <int D>
inline void add_moment(const Vec<double, D>& r, const Vec<double, D>& j, double factor,
                       double (&sum)[spins<D>]) {
    if constexpr (D == 2) {
        sum[0] += factor * (r[0] * j[1] - r[1] * j[0]);
    } else {
        sum[0] += factor * (r[1] * j[2] - r[2] * j[1]);
        sum[1] += factor * (r[2] * j[0] - r[0] * j[2]);
        sum[2] += factor * (r[0] * j[1] - r[1] * j[0]);
    }
}
/// v + w x r
template <int D>
inline Vec<double, D> velocity_at(const Vec<double, D>& v, const double (&w)[spins<D>],
                                  const Vec<double, D>& r) {
    if constexpr (D == 2)
        return {v[0] - w[0] * r[1], v[1] + w[0] * r[0]};
    else
        return {v[0] + w[1] * r[2] - w[2] * r[1], v[1] + w[2] * r[0] - w[0] * r[2],
                v[2] + w[0] * r[1] - w[1] * r[0]};
}

/// Where a body is and how it moves.
template <int D>
struct RigidState {
    Vec<double, D> centre;      // m
    Vec<double, D> velocity;    // m/s
    double momentum[spins<D>];  // of its turn, in space: kg m^2/s (2D: of a metre's thickness)
    double turn[turns<D>];      // from the axes of the body, principal ones in space
    double impulse[D];          // N s that others have given it since the start
    double moment[spins<D>];    // N m s, the same about its centre
};

/// What it is, in the axes of the body.
template <int D>
struct RigidShape {
    double mass = 0;
    double inertia[spins<D>] = {};  // kg m^2, principal
    // Degrees of freedom that are held: these move on as they began.
    bool held[D] = {};
    bool held_turn = false;

    double give(int axis) const { return held[axis] ? 0.0 : 1 / mass; }
};

/// Columns: the axes of the body in space.
template <int D>
inline Mat<double, D> rotation_of(const double (&turn)[turns<D>]) {
    Mat<double, D> r;
    if constexpr (D == 2) {
        const double c = std::cos(turn[0]), s = std::sin(turn[0]);
        r.e[0][0] = r.e[1][1] = c;
        r.e[0][1] = -s;
        r.e[1][0] = s;
    } else {
        const double w = turn[0], x = turn[1], y = turn[2], z = turn[3];
        r.e[0][0] = 1 - 2 * (y * y + z * z);
        r.e[0][1] = 2 * (x * y - w * z);
        r.e[0][2] = 2 * (x * z + w * y);
        r.e[1][0] = 2 * (x * y + w * z);
        r.e[1][1] = 1 - 2 * (x * x + z * z);
        r.e[1][2] = 2 * (y * z - w * x);
        r.e[2][0] = 2 * (x * z - w * y);
        r.e[2][1] = 2 * (y * z + w * x);
        r.e[2][2] = 1 - 2 * (x * x + y * y);
    }
    return r;
}

/// a b of two quaternions: first b, then a.
inline void turn_by(const double (&a)[4], const double (&b)[4], double (&out)[4]) {
    const double q[4] = {a[0] * b[0] - a[1] * b[1] - a[2] * b[2] - a[3] * b[3],
                         a[0] * b[1] + a[1] * b[0] + a[2] * b[3] - a[3] * b[2],
                         a[0] * b[2] - a[1] * b[3] + a[2] * b[0] + a[3] * b[1],
                         a[0] * b[3] + a[1] * b[2] - a[2] * b[1] + a[3] * b[0]};
    for (int k = 0; k < 4; ++k) out[k] = q[k];
}
/// Of a matrix of axes with determinant 1.
inline void quaternion_of(const Mat<double, 3>& r, double (&q)[4]) {
    // By the largest of the four squares, which is a quarter or more (Shepperd 1978).
    const double square[4] = {
        1 + r.e[0][0] + r.e[1][1] + r.e[2][2], 1 + r.e[0][0] - r.e[1][1] - r.e[2][2],
        1 - r.e[0][0] + r.e[1][1] - r.e[2][2], 1 - r.e[0][0] - r.e[1][1] + r.e[2][2]};
    int k = 0;
    for (int i = 1; i < 4; ++i)
        if (square[i] > square[k]) k = i;
    const double s = 2 * std::sqrt(square[k]);
    const double of[3] = {r.e[2][1] - r.e[1][2], r.e[0][2] - r.e[2][0], r.e[1][0] - r.e[0][1]};
    if (k == 0) {
        q[0] = s / 4;
        for (int i = 0; i < 3; ++i) q[1 + i] = of[i] / s;
        return;
    }
    const int i = k - 1;
    q[0] = of[i] / s;
    for (int j = 0; j < 3; ++j) q[1 + j] = j == i ? s / 4 : (r.e[i][j] + r.e[j][i]) / s;
}

/// Angular velocity, rad/s, of an angular momentum in space.
template <int D>
inline void spin_of(const RigidShape<D>& body, const Mat<double, D>& axes,
                    const double (&momentum)[spins<D>], double (&spin)[spins<D>]) {
    if constexpr (D == 2) {
        spin[0] = momentum[0] / body.inertia[0];
    } else {
        double own[3];
        for (int k = 0; k < 3; ++k) {
            own[k] = 0;
            for (int a = 0; a < 3; ++a) own[k] += axes.e[a][k] * momentum[a];
            own[k] /= body.inertia[k];
        }
        for (int a = 0; a < 3; ++a) {
            spin[a] = 0;
            for (int k = 0; k < 3; ++k) spin[a] += axes.e[a][k] * own[k];
        }
    }
}

/// Turns a body freely for a time; its angular momentum in space stays what it is.
template <int D>
inline void turn_freely(const RigidShape<D>& body, RigidState<D>& s, double dt) {
    if constexpr (D == 2) {
        s.turn[0] += s.momentum[0] / body.inertia[0] * dt;
    } else {
        double spin[3], square = 0;
        spin_of<3>(body, rotation_of<3>(s.turn), s.momentum, spin);
        for (const double w : spin) square += w * w;
        // Parts of a hundredth of a radian: the energy then stays within 1e-5 of itself.
        const double parts = std::ceil(std::sqrt(square) * dt / 0.01);
        const int n = parts >= 1 ? (parts < 1000 ? int(parts) : 1000) : 1;
        const double h = dt / n;
        for (int part = 0; part < n; ++part) {
            const Mat<double, 3> axes = rotation_of<3>(s.turn);
            double m[3];
            for (int k = 0; k < 3; ++k) {
                m[k] = 0;
                for (int a = 0; a < 3; ++a) m[k] += axes.e[a][k] * s.momentum[a];
            }
            const auto about = [&](int k, double time) {
                const double angle = m[k] / body.inertia[k] * time;
                double q[4] = {std::cos(angle / 2), 0, 0, 0};
                q[1 + k] = std::sin(angle / 2);
                turn_by(s.turn, q, s.turn);
                const int i = (k + 1) % 3, j = (k + 2) % 3;
                const double c = std::cos(angle), d = std::sin(angle), a = m[i], b = m[j];
                m[i] = c * a + d * b;
                m[j] = c * b - d * a;
            };
            about(0, h / 2);
            about(1, h / 2);
            about(2, h);
            about(1, h / 2);
            about(0, h / 2);
            double size = 0;
            for (const double x : s.turn) size += x * x;
            size = 1 / std::sqrt(size);
            for (double& x : s.turn) x *= size;
        }
    }
}

/// Kinetic energy, J (2D: J/m).
template <int D>
inline double kinetic_energy(const RigidShape<D>& body, const RigidState<D>& s) {
    double e = 0, spin[spins<D>];
    for (int a = 0; a < D; ++a) e += 0.5 * body.mass * s.velocity[a] * s.velocity[a];
    spin_of<D>(body, rotation_of<D>(s.turn), s.momentum, spin);
    for (int a = 0; a < spins<D>; ++a) e += 0.5 * spin[a] * s.momentum[a];
    return e;
}

}  // namespace mpm
