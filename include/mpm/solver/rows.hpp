// What is given particle by particle: rows that are asked for in pieces, so that a scene needs no
// memory of its particles' size on the host.
#pragma once

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <functional>
#include <memory>
#include <utility>
#include <vector>

namespace mpm {

/// Writes rows [first, last) to `out`. May be asked for any of them again.
struct Rows : std::function<void(std::uint64_t first, std::uint64_t last, double* out)> {
    using function::function;
    bool at_hand = false;  // asking again costs little, from several threads too
};

/// Rows of an array that is there.
inline Rows rows_of(std::vector<double> values, int width) {
    Rows rows([kept = std::make_shared<const std::vector<double>>(std::move(values)), width](
                  std::uint64_t first, std::uint64_t last, double* out) {
        std::copy(kept->begin() + std::ptrdiff_t(first * std::uint64_t(width)),
                  kept->begin() + std::ptrdiff_t(last * std::uint64_t(width)), out);
    });
    rows.at_hand = true;
    return rows;
}

/// How many threads `in_parallel` takes at most: OMP_NUM_THREADS, or as many as there are cores.
std::uint64_t most_threads();

/// Calls f(first, last) for all of 0 <= k < n in parts of `least` or more, side by side; within
/// another such call, all at once. Throws what a part has thrown.
void in_parallel(std::uint64_t n, std::uint64_t least,
                 const std::function<void(std::uint64_t first, std::uint64_t last)>& f);

/// The points of a lattice that lie in no hole, last axis fastest. Across the first axis stand
/// sections of one axis fewer; those between two faces of holes are alike and are kept once.
class LatticePoints {
public:
    struct Run {
        std::vector<double> x;  // of the sections on the first axis, m
        std::shared_ptr<const LatticePoints> section;
    };
    /// One point without coordinates, or none.
    explicit LatticePoints(bool there) : start_{0, there ? 1u : 0u} {}
    LatticePoints(int dimension, std::vector<Run> runs);

    int dimension() const { return dimension_; }
    std::uint64_t count() const { return start_.back(); }
    /// Coordinates of points [first, last) to out[0], out[stride] ...
    void fill(std::uint64_t first, std::uint64_t last, double* out, int stride) const;

private:
    int dimension_ = 0;
    std::vector<Run> runs_;
    std::vector<std::uint64_t> start_;  // the point at which each run begins, and their number
};

/// Positions of a lattice.
Rows lattice_rows(std::shared_ptr<const LatticePoints> points);

/// Pressures of water at rest in these points: strength * max(top - x . up, 0), Pa.
struct StillWater {
    double strength, top;    // weight of a volume, Pa/m; level, m along `up`
    std::vector<double> up;  // (dimension,), of length 1
};
Rows still_water_rows(std::shared_ptr<const LatticePoints> points, StillWater water);

/// Chosen rows, as runs of such that follow each other.
class RowRuns {
public:
    /// Rows [first, last) behind those that are chosen so far.
    void add(std::uint64_t first, std::uint64_t last) {
        if (first == last) return;
        if (!first_.empty() && first_.back() + (start_.back() - start_[start_.size() - 2]) == first)
            start_.back() += last - first;
        else {
            first_.push_back(first);
            start_.push_back(start_.back() + (last - first));
        }
    }
    std::uint64_t count() const { return start_.back(); }
    /// Calls f(row, number of rows, place of the first among the chosen) for the chosen [first,
    /// last), run by run.
    template <class F>
    void each(std::uint64_t first, std::uint64_t last, const F& f) const {
        std::size_t run =
            std::size_t(std::upper_bound(start_.begin(), start_.end(), first) - start_.begin()) - 1;
        for (; first < last; ++run) {
            const std::uint64_t end = std::min(last, start_[run + 1]);
            f(first_[run] + (first - start_[run]), end - first, first);
            first = end;
        }
    }

private:
    std::vector<std::uint64_t> first_, start_{0};
};

/// The chosen ones of some rows: asked for when they are wanted where those are at hand, else made
/// here.
Rows chosen_rows(const Rows& all, std::shared_ptr<const RowRuns> runs, int width);

}  // namespace mpm
