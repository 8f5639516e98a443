// The mass matrix of the functions and what is done to it before it is solved: consistent, lumped,
// or lumped where the material ends. De Koster (2018), sections 3.3, 5.2 to 5.4 and A.2.
#pragma once

#include <Eigen/IterativeLinearSolvers>
#include <Eigen/SparseCholesky>
#include <Eigen/SparseLU>
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
    int inactive() const { return inactive_; }
    /// Smallest mass on the diagonal of an active function, kg/m.
    double smallest_mass() const { return smallest_; }
    /// Smallest over largest pivot of the factorisation, an estimate of the reciprocal condition
    /// number; of the diagonal where an iteration takes its place.
    double reciprocal_condition() const { return condition_; }
    int iterations() const { return iterations_; }
    bool symmetric() const { return options_.form != MassForm::partial_rows; }
    std::size_t bytes() const;

private:
    using Matrix = Eigen::SparseMatrix<double>;
    // Where the entries of a cell's matrix go: matrix entry, weight, entry of the cell.
    struct Place {
        int entry;
        int local;
        double weight;
    };
    template <class F>
    void each_coupling(int cell, bool only_diagonal, const F& f) const;
    void lay_out(bool only_diagonal, Matrix& m, std::vector<std::vector<Place>>& places);
    void shape(int cell, const double* sums, std::vector<double>& local) const;
    void mark_surface(const std::vector<char>& filled);
    bool factorise();
    bool reduced_solve(const Eigen::VectorXd& f, Eigen::VectorXd& c);
    bool iterates(Solver solver) const {
        return options_.form != MassForm::lumped && options_.solver == solver;
    }
    void add_up(Matrix& m, const std::vector<std::vector<Place>>& places) const;
    void drop_from(Matrix& m) const;

    const Basis& basis_;
    MassOptions options_;
    Cpu& exec_;
    const Constraints* constraints_ = nullptr;
    std::vector<char> on_surface_;            // functions
    std::vector<std::vector<double>> local_;  // of each cell, after lumping
    Matrix matrix_, lumped_;
    std::vector<std::vector<Place>> places_;
    std::vector<std::vector<Place>> lumped_places_;
    std::vector<char> dropped_;
    int inactive_ = 0, iterations_ = 0;
    double smallest_ = 0, largest_ = 0, condition_ = 0;
    Eigen::SimplicialLDLT<Matrix> cholesky_, lumped_cholesky_;
    Eigen::SparseLU<Matrix> general_;
    Eigen::ConjugateGradient<Matrix, Eigen::Lower | Eigen::Upper> gradients_;
};

}  // namespace mpm::triangular
