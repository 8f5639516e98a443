// How far places are from walls of the domain, boxes and surfaces: for rigid bodies, which meet
// them at points.
#pragma once

#include <algorithm>
#include <cmath>

#include "mpm/kernels/boundaries.hpp"

namespace mpm {

/// Calls f(face, outward normal, distance in m, velocity, law) for each wall of a boundary near a
/// place; the distance is negative inside.
template <int D, class F>
void for_each_wall(const BoundaryView<D>& all, int b, const Vec<double, D>& x, double near,
                   const F& f) {
    const BoundaryRecord<D>& r = all.records[b];
    Vec<double, D> own;
    for (int a = 0; a < D; ++a) own[a] = r.velocity[a];
    for (int a = 0; a < D && r.limited; ++a)
        if (!(x[a] >= r.within_lower[a] && x[a] <= r.within_upper[a])) return;
    if (r.surface > 0) {
        const SurfaceRecord<D>& s = all.surfaces[r.surface - 1];
        double at[D], there[D], normal[D], distance, wall[D];
        for (int a = 0; a < D; ++a) at[a] = x[a];
        s.to_body(at, there);
        if (!s.field.at(there, distance, normal) || !(distance < near)) return;
        s.velocity_at(at, wall);
        Vec<double, D> n;
        double square = 0;
        for (int a = 0; a < D; ++a) {
            n[a] = 0;
            for (int c = 0; c < D; ++c) n[a] += s.rotation[a][c] * normal[c];
            square += n[a] * n[a];
            own[a] += wall[a];
        }
        if (!(square > 0)) return;
        for (int a = 0; a < D; ++a) n[a] /= std::sqrt(square);
        f(0, n, distance, own, r.law[0]);
        return;
    }
    if (!r.is_box) {
        for (int k = 0; k < 2 * D; ++k) {
            if (!r.present[k]) continue;
            const int a = k / 2;
            const double distance =
                k % 2 == 0 ? x[a] - r.lower[a] * all.cell_size : r.upper[a] * all.cell_size - x[a];
            if (!(distance < near)) continue;
            Vec<double, D> n{};
            n[a] = k % 2 == 0 ? 1 : -1;
            f(k, n, distance, own, r.law[k]);
        }
        return;
    }
    // Of a box its nearest point; inside, its nearest face.
    Vec<double, D> beyond{};
    double square = 0, least = 0;
    int face = -1, nearest = 0;
    for (int a = 0; a < D; ++a) {
        const double low = r.lower[a] * all.cell_size - x[a],
                     high = x[a] - r.upper[a] * all.cell_size;
        beyond[a] = low > 0 ? -low : (high > 0 ? high : 0.0);
        square += beyond[a] * beyond[a];
        if (beyond[a] != 0 && (face < 0 || std::abs(beyond[a]) > std::abs(beyond[face / 2])))
            face = 2 * a + (high > 0 ? 1 : 0);
        const double deep = std::max(low, high);
        if (a == 0 || deep > least) {
            least = deep;
            nearest = 2 * a + (high > low ? 1 : 0);
        }
    }
    const double distance = square > 0 ? std::sqrt(square) : least;
    if (!(distance < near)) return;
    Vec<double, D> n{};
    if (square > 0) {
        for (int a = 0; a < D; ++a) n[a] = beyond[a] / distance;
    } else {
        face = nearest;
        n[face / 2] = face % 2 == 0 ? -1 : 1;
    }
    f(face, n, distance, own, r.law[face]);
}

}  // namespace mpm
