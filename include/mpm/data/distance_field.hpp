// The signed distance to a rigid body, negative inside, on a lattice of its own: blocks of 8^D
// lattice cells near the surface hold the values at all their corners (9^D, so that no look-up
// needs a second block); blocks deep inside are named without values; what is not named is outside.
// Memory grows with the surface, not with the domain.
#pragma once

#include "mpm/data/blocks.hpp"

namespace mpm {

template <int D>
struct DistanceField {
    static constexpr int edge = 8;
    static constexpr int corners = D == 2 ? 81 : 729;

    const std::uint64_t* keys;  // (count,) ascending
    const std::int32_t* place;  // (count,): which block of values; -1: deep inside
    const float* value;         // (blocks, corners), in lattice cells, last axis fastest
    std::int32_t count;
    std::int64_t low[D], counts[D];  // the block that is number zero; blocks along each axis
    double origin[D];                // of the lattice, m
    double per_metre;                // lattice cells

    /// Which block holds a point and where it is in it, in lattice cells; its entry, or -1.
    MPM_HD std::int32_t find(const double (&x)[D], double (&local)[D]) const {
        std::uint64_t key = 0;
        for (int a = 0; a < D; ++a) {
            const double u = (x[a] - origin[a]) * per_metre;
            const double block = floor(u / edge);
            local[a] = u - block * edge;
            const double number = block - double(low[a]);
            if (!(number >= 0 && number < double(counts[a]))) return -1;
            key = key * std::uint64_t(counts[a]) + std::uint64_t(number);
        }
        return find_key(keys, count, key);
    }

    /// May the field know of a point within so many m, along each axis?
    MPM_HD bool reaches(const double (&x)[D], double metres) const {
        bool near = true;
        for (int a = 0; a < D; ++a) {
            // No division: lanes of a warp that wait for others in one have waited forever.
            const double u = (x[a] - origin[a]) * per_metre, more = metres * per_metre;
            near = near && u > double(low[a] * edge) - more &&
                   u < double((low[a] + counts[a]) * edge) + more;
        }
        return near;
    }
    /// Distance in m and its gradient, of unit length; false outside the field. Deep inside the
    /// gradient is zero.
    MPM_HD bool at(const double (&x)[D], double& distance, double (&normal)[D]) const {
        double local[D];
        const std::int32_t entry = find(x, local);
        if (entry < 0) return false;
        for (int a = 0; a < D; ++a) normal[a] = 0;
        if (place[entry] < 0) {
            distance = -edge / per_metre;
            return true;
        }
        int base = 0;
        double share[D];
        for (int a = 0; a < D; ++a) {
            int i = int(local[a]);
            i = i < 0 ? 0 : (i > edge - 1 ? edge - 1 : i);
            share[a] = local[a] - i;
            base = base * (edge + 1) + i;
        }
        const float* v = value + std::int64_t(place[entry]) * corners;
        distance = 0;
        for (int c = 0; c < (1 << D); ++c) {
            int at = base, stride = 1;
            double weight = 1;
            for (int a = D - 1; a >= 0; --a) {
                at += (c >> a & 1) * stride;
                stride *= edge + 1;
                weight *= c >> a & 1 ? share[a] : 1 - share[a];
            }
            distance += weight * double(v[at]);
            for (int a = 0; a < D; ++a) {
                double slope = c >> a & 1 ? 1 : -1;
                for (int b = 0; b < D; ++b)
                    if (b != a) slope *= c >> b & 1 ? share[b] : 1 - share[b];
                normal[a] += slope * double(v[at]);
            }
        }
        distance /= per_metre;
        double length = 0;
        for (int a = 0; a < D; ++a) length += normal[a] * normal[a];
        length = sqrt(length);
        // On the middle of a thin plate both sides are equally near: no direction, like deep
        // inside.
        for (int a = 0; a < D; ++a) normal[a] = length > 1e-3 ? normal[a] / length : 0;
        return true;
    }
};

}  // namespace mpm
