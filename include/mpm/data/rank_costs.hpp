// What a weight costs on each rank, from the times that all have told of their own work. Times are
// measured, so no two runs have the same, and no bit of a run may depend on them: only the cuts do.
// All ranks compute from the same integers by products, quotients and a halved sum, none of which
// compilers fuse, and find the same.
#pragma once

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <vector>

namespace mpm {

/// What a rank tells of the steps since it last told: the time that one took, and the weight of the
/// blocks that it had in hand.
struct StepCost {
    std::uint64_t nanoseconds, weight;
};

/// The time of the usual step, in ns: the median, which a few that were disturbed do not move.
/// `seconds`: of each step, at least one.
inline std::uint64_t usual_nanoseconds(std::vector<double> seconds) {
    const auto middle = seconds.begin() + std::ptrdiff_t(seconds.size() / 2);
    std::nth_element(seconds.begin(), middle, seconds.end());
    return std::uint64_t(std::llround(std::clamp(*middle, 0.0, 1e9) * 1e9));
}

/// Time by weight of each rank, over that of all, smoothed: half of what was known, which is 1 at
/// first, and half of what is new. It is put down to the blocks that the rank had. Where it is the
/// rank that is slow and not its blocks, those that it hands on are thought too heavy, the next
/// telling corrects that, and the cuts come to rest where all take the same time, whatever makes it
/// so.
class CostRates {
public:
    static constexpr std::uint64_t one = 1024;
    /// Fewer tell nothing.
    static constexpr std::size_t fewest_steps = 4;
    /// More are forgotten.
    static constexpr std::size_t most_steps = 4096;
    /// A rank without anything to do, or a clock that stood still, is no reason to move all.
    static constexpr double most = 64;

    CostRates() = default;
    explicit CostRates(int ranks) : rate_(std::size_t(ranks), 1.0) {}

    void tell(const std::vector<StepCost>& of) {
        std::uint64_t time = 0, weight = 0;
        for (const StepCost& c : of) {
            time += c.nanoseconds;
            weight += c.weight;
        }
        for (std::size_t r = 0; r < rate_.size(); ++r) {
            double now = 1;
            if (of[r].weight > 0 && time > 0)
                now = double(of[r].nanoseconds) * double(weight) /
                      (double(of[r].weight) * double(time));
            now = std::clamp(now, 1 / most, most);
            rate_[r] = 0.5 * (rate_[r] + now);
        }
    }
    /// By which a weight of this rank counts.
    std::uint64_t of(int rank) const {
        return std::uint64_t(std::llround(rate_[std::size_t(rank)] * double(one)));
    }

private:
    std::vector<double> rate_;
};

}  // namespace mpm
