// The mass matrix of the functions and what is done to it before it is solved: consistent, lumped,
// or lumped where the material ends. De Koster (2018), sections 3.3, 5.2 to 5.4 and A.2.
#pragma once

#include <algorithm>
#include <memory>
#include <string>
#include <vector>

#include "mpm/exec/cpu.hpp"
#include "mpm/triangular/constraints.hpp"

namespace mpm::triangular {

enum class MassForm {
    consistent,
    lumped,             // row sums: non-negative functions only
    partial_rows,       // rows of functions at a free surface lumped: momentum is not conserved
    partial_symmetric,  // rows and columns: momentum is conserved
};
enum class Solver { direct, conjugate_gradients, richardson };

struct MassOptions {
    MassForm form = MassForm::consistent;
    Solver solver = Solver::direct;
    double tolerance = 1e-10;     // of the residual, relative
    int iterations = 200;         // most of them
    double deactivate_below = 0;  // kg/m: functions of less mass on the diagonal are left out
};

/// Sums over the particles of each cell, function by function in the order of Basis::on_cell.
class CellMatrices {
public:
    explicit CellMatrices(const Basis& basis);
    /// Row-major square matrix of a cell.
    double* of(int cell) { return data_.data() + start_[std::size_t(cell)]; }
    const double* of(int cell) const { return data_.data() + start_[std::size_t(cell)]; }
    void clear() { std::fill(data_.begin(), data_.end(), 0.0); }
    std::size_t bytes() const { return data_.size() * sizeof(double); }

private:
    std::vector<std::size_t> start_;
    std::vector<double> data_;
};

/// Solves M c = f for both components at once, with held coefficients given.
class MassSystem {
public:
    MassSystem(const Basis& basis, const MassOptions& options, Cpu& exec);
    ~MassSystem();

    /// Other boundaries hold from now on.
    void constrain(const Constraints& constraints);
    /// The matrix of these sums; `filled` says which cells hold particles. False where it cannot be
    /// factorised.
    bool assemble(const CellMatrices& sums, const std::vector<char>& filled);
    /// c with M c = f on free coefficients and `given` on held ones. False where an iteration has
    /// not converged.
    bool solve(const Eigen::VectorXd& f, const Eigen::VectorXd& given, Eigen::VectorXd& c);
    /// M c, over all coefficients.
    Eigen::VectorXd times(const Eigen::VectorXd& c) const;

    /// Functions without mass, or with less than asked for, among the free coefficients.
    int inactive() const;
    /// Smallest mass on the diagonal of an active function, kg/m.
    double smallest_mass() const;
    /// Smallest over largest pivot of the factorisation, an estimate of the reciprocal condition
    /// number; of the diagonal where an iteration takes its place.
    double reciprocal_condition() const;
    int iterations() const;
    bool symmetric() const;
    std::size_t bytes() const;

private:
    // Apart, because sparse matrices and their solvers take ten seconds to compile in every unit
    // that sees them.
    struct Work;
    std::unique_ptr<Work> work_;
};

}  // namespace mpm::triangular
