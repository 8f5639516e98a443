// What becomes of particles that have left the domain: through which outlet each went, what the
// policy says of the others, and the list of those taken out since it was last asked for. Knows no
// column of a body and no executor; compiled in src/solver/common/outflow.cpp.
#pragma once

#include <array>
#include <cstdint>
#include <string>
#include <utility>
#include <vector>

#include "mpm/kernels/supplying.hpp"
#include "mpm/solver/engine.hpp"
#include "mpm/solver/spec.hpp"

namespace mpm {

template <int D>
class Outflow {
public:
    /// Particles of one body that left the same way.
    struct Way {
        Removed removed;
        std::vector<std::uint32_t> place, id;
        int outlet;  // -1: elsewhere
    };

    explicit Outflow(const Spec& spec);

    bool stops() const { return leaving_ == Leaving::stop; }
    bool freezes(const Way& way) const { return way.outlet < 0 && leaving_ == Leaving::freeze; }
    /// The outlet through which a particle has left, or -1.
    int outlet_of(const Leaver<D>& who) const;
    /// Of one body: through each outlet, then elsewhere. Changes nothing.
    std::vector<Way> ways(int body, std::uint64_t first_id, std::int64_t step,
                          const std::vector<Leaver<D>>& left) const;
    /// They are out: lists them, and says what has gone through outlets. `mass_and_volume`: of a
    /// particle of each body.
    std::vector<Flow> take(std::vector<Way> ways, double time, std::int64_t step,
                           const std::vector<std::array<double, 2>>& mass_and_volume);
    std::vector<Removed> removed() { return std::exchange(removed_, {}); }

private:
    std::vector<OutletSpec> outlets_;
    Leaving leaving_;
    std::vector<std::int64_t> cells_;
    std::vector<Removed> removed_;
};

}  // namespace mpm
