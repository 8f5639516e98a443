// Boundaries take coefficients away: what remains free, and what the boundaries give. Conditions
// are eliminated, so that the matrices stay symmetric: de Koster (2018), section 3.5.4, digest 5.9.
#pragma once

#include <Eigen/Core>

#include "mpm/triangular/basis.hpp"

namespace mpm::triangular {

/// A velocity given along outer edges, wholly or normal to them only.
struct Hold {
    std::vector<int> edges;
    bool normal_only = false;
};

/// Velocities have two components a function; component c of function i is number 2 i + c.
class Constraints {
public:
    struct Term {
        int free;
        double weight;
    };
    Constraints(const Basis& basis, const std::vector<Hold>& holds);

    /// Number of free coefficients.
    int free() const { return free_; }
    /// Coefficient `full` is the sum of these, plus what is given.
    const std::vector<Term>& terms(int full) const { return terms_[std::size_t(full)]; }
    /// Which hold takes up the force on a coefficient, -1 for none. Of several the one whose side
    /// faces the force, then the first.
    int holder(int full) const { return held_[std::size_t(full)]; }

    /// What the holds' velocities give of all coefficients.
    void given(const std::vector<Point>& velocity, Eigen::VectorXd& full) const;
    /// full = terms * free
    void expand(const Eigen::VectorXd& free, Eigen::VectorXd& full) const;
    /// free = terms^T * full
    void reduce(const Eigen::VectorXd& full, Eigen::VectorXd& free) const;

private:
    int free_ = 0;
    std::vector<std::vector<Term>> terms_;
    std::vector<int> held_;
    // given = response * targets, target = direction . velocity of the hold
    struct Given {
        int full;
        int hold;
        Point response;
    };
    std::vector<Given> given_;
};

}  // namespace mpm::triangular
