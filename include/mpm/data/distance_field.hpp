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

    /// What `find` says of blocks that have no values.
    static constexpr std::int32_t deep = -1, outside = -2;

    const std::uint64_t* keys;  // (count,) ascending
    const std::int32_t* place;  // (count,): which block of values, or `deep`
    const float* value;         // (blocks, corners), in lattice cells, last axis fastest
    std::int32_t count;
    std::int64_t low[D], counts[D];  // the block that is number zero; blocks along each axis
    double origin[D];                // of the lattice, m
    double per_metre;                // lattice cells
    // (all of `counts`,): `place`, or `outside`; null where there is none. A search waits for a
    // dozen reads, one after the other.
    const std::int32_t* all = nullptr;

    /// Which block of values a point is in and where in it, in lattice cells; `deep`; `outside`.
    MPM_HD std::int32_t find(const double (&x)[D], double (&local)[D]) const {
        std::uint64_t key = 0;
        for (int a = 0; a < D; ++a) {
            const double u = (x[a] - origin[a]) * per_metre;
            const double block = floor(u / edge);
            local[a] = u - block * edge;
            const double number = block - double(low[a]);
            if (!(number >= 0 && number < double(counts[a]))) return outside;
            key = key * std::uint64_t(counts[a]) + std::uint64_t(number);
        }
        if (all) return all[key];
        const std::int32_t entry = find_key(keys, count, key);
        return entry < 0 ? outside : place[entry];
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
        const std::int32_t block = find(x, local);
        if (block == outside) return false;
        for (int a = 0; a < D; ++a) normal[a] = 0;
        if (block == deep) {
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
        const float* v = value + std::int64_t(block) * corners;
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
