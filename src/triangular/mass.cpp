#include "mpm/triangular/mass.hpp"

#include <Eigen/IterativeLinearSolvers>
#include <Eigen/SparseCholesky>
#include <Eigen/SparseLU>
#include <algorithm>
#include <cmath>
#include <limits>

namespace mpm::triangular {

struct MassSystem::Work {
    using Matrix = Eigen::SparseMatrix<double>;
    // Where the entries of a cell's matrix go: matrix entry, weight, entry of the cell.
    struct Place {
        int entry;
        int local;
        double weight;
    };
    Work(const Basis& basis, const MassOptions& options, Cpu& exec);
    void constrain(const Constraints& constraints);
    bool assemble(const CellMatrices& sums, const std::vector<char>& filled);
    bool solve(const Eigen::VectorXd& f, const Eigen::VectorXd& given, Eigen::VectorXd& c);
    Eigen::VectorXd times(const Eigen::VectorXd& c) const;
    std::size_t bytes() const;

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
    bool symmetric() const { return options_.form != MassForm::partial_rows; }
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

CellMatrices::CellMatrices(const Basis& basis) {
    std::size_t all = 0;
    for (int c = 0; c < basis.cells(); ++c) {
        start_.push_back(all);
        all += basis.on_cell(c).size() * basis.on_cell(c).size();
    }
    data_.assign(all, 0.0);
}

MassSystem::Work::Work(const Basis& basis, const MassOptions& options, Cpu& exec)
    : basis_(basis), options_(options), exec_(exec) {
    on_surface_.assign(std::size_t(basis.functions()), 0);
    local_.resize(std::size_t(basis.cells()));
    for (int c = 0; c < basis.cells(); ++c) {
        const auto n = basis.on_cell(c).size();
        local_[std::size_t(c)].assign(n * n, 0.0);
    }
}

/// f(row, column, entry of the cell's matrix, weight) for all that a cell adds to the free
/// unknowns' matrix.
template <class F>
void MassSystem::Work::each_coupling(int cell, bool only_diagonal, const F& f) const {
    const auto& on = basis_.on_cell(cell);
    for (std::size_t i = 0; i < on.size(); ++i)
        for (std::size_t j = 0; j < on.size(); ++j) {
            if (only_diagonal && i != j) continue;
            for (int c = 0; c < 2; ++c)
                for (const auto& s : constraints_->terms(2 * on[i] + c))
                    for (const auto& t : constraints_->terms(2 * on[j] + c))
                        f(s.free, t.free, int(i * on.size() + j), s.weight * t.weight);
        }
}

// All entries that can ever be, the cells' couplings and the diagonal, and where in them the cells'
// matrices go.
void MassSystem::Work::lay_out(bool only_diagonal, Matrix& m,
                               std::vector<std::vector<Place>>& places) {
    std::vector<Eigen::Triplet<double>> entries;
    for (int f = 0; f < constraints_->free(); ++f) entries.emplace_back(f, f, 0.0);
    for (int cell = 0; cell < basis_.cells(); ++cell)
        each_coupling(cell, only_diagonal, [&](int row, int column, int, double) {
            entries.emplace_back(row, column, 0.0);
        });
    m = Matrix(constraints_->free(), constraints_->free());
    m.setFromTriplets(entries.begin(), entries.end());
    places.assign(std::size_t(basis_.cells()), {});
    for (int cell = 0; cell < basis_.cells(); ++cell)
        each_coupling(cell, only_diagonal, [&](int row, int column, int local, double weight) {
            const int* begin = m.innerIndexPtr() + m.outerIndexPtr()[column];
            const int* end = m.innerIndexPtr() + m.outerIndexPtr()[column + 1];
            const auto entry = std::lower_bound(begin, end, row) - m.innerIndexPtr();
            places[std::size_t(cell)].push_back({int(entry), local, weight});
        });
}

void MassSystem::Work::constrain(const Constraints& constraints) {
    constraints_ = &constraints;
    const bool diagonal = options_.form == MassForm::lumped;
    lay_out(diagonal, matrix_, places_);
    dropped_.assign(std::size_t(constraints.free()), 0);
    if (iterates(Solver::richardson)) {
        lay_out(true, lumped_, lumped_places_);
        lumped_cholesky_.analyzePattern(lumped_);
    } else if (!iterates(Solver::conjugate_gradients)) {
        if (symmetric())
            cholesky_.analyzePattern(matrix_);
        else
            general_.analyzePattern(matrix_);
    }
}

// A function belongs to the surface where it lives on filled and on empty cells.
void MassSystem::Work::mark_surface(const std::vector<char>& filled) {
    std::vector<char> seen(on_surface_.size(), 0);
    for (int cell = 0; cell < basis_.cells(); ++cell)
        for (int f : basis_.on_cell(cell))
            seen[std::size_t(f)] |= filled[std::size_t(cell)] ? 1 : 2;
    for (std::size_t f = 0; f < seen.size(); ++f) on_surface_[f] = seen[f] == 3;
}

void MassSystem::Work::shape(int cell, const double* sums, std::vector<double>& local) const {
    const auto& on = basis_.on_cell(cell);
    const std::size_t n = on.size();
    const auto surface = [&](std::size_t i) { return bool(on_surface_[std::size_t(on[i])]); };
    std::copy(sums, sums + n * n, local.begin());
    if (options_.form == MassForm::consistent) return;
    for (std::size_t i = 0; i < n; ++i)
        for (std::size_t j = 0; j < n; ++j) {
            if (i == j) continue;
            const bool row = options_.form == MassForm::lumped || surface(i);
            const bool either = row || (options_.form == MassForm::partial_symmetric && surface(j));
            if (!either) continue;
            local[i * n + i] += local[i * n + j];
            local[i * n + j] = 0;
        }
}

void MassSystem::Work::add_up(Matrix& m, const std::vector<std::vector<Place>>& places) const {
    std::fill(m.valuePtr(), m.valuePtr() + m.nonZeros(), 0.0);
    for (std::size_t c = 0; c < places.size(); ++c)
        for (const Place& p : places[c])
            m.valuePtr()[p.entry] += p.weight * local_[c][std::size_t(p.local)];
}

// A large diagonal, so that the pivots of what is left out are not taken for small ones.
void MassSystem::Work::drop_from(Matrix& m) const {
    if (inactive_ == 0) return;
    for (int column = 0; column < m.outerSize(); ++column)
        for (Matrix::InnerIterator it(m, column); it; ++it)
            if (dropped_[std::size_t(it.row())] || dropped_[std::size_t(column)])
                it.valueRef() = it.row() == column ? largest_ : 0.0;
}

bool MassSystem::Work::assemble(const CellMatrices& sums, const std::vector<char>& filled) {
    if (options_.form == MassForm::partial_rows || options_.form == MassForm::partial_symmetric)
        mark_surface(filled);
    exec_.for_each(basis_.cells(),
                   [&](std::int64_t c) { shape(int(c), sums.of(int(c)), local_[std::size_t(c)]); });
    add_up(matrix_, places_);

    inactive_ = 0;
    smallest_ = std::numeric_limits<double>::infinity();
    const Eigen::VectorXd masses = matrix_.diagonal();
    largest_ = masses.size() > 0 ? masses.maxCoeff() : 0;
    for (Eigen::Index f = 0; f < masses.size(); ++f) {
        const bool drop = !(masses[f] > options_.deactivate_below);
        dropped_[std::size_t(f)] = drop;
        inactive_ += drop;
        if (!drop) smallest_ = std::min(smallest_, masses[f]);
    }
    if (!(largest_ > 0)) largest_ = 1;
    drop_from(matrix_);
    condition_ = smallest_ / largest_;
    return factorise();
}

bool MassSystem::Work::factorise() {
    if (matrix_.rows() == 0) return true;
    if (iterates(Solver::conjugate_gradients)) {
        gradients_.setTolerance(options_.tolerance);
        gradients_.setMaxIterations(options_.iterations);
        gradients_.compute(matrix_);
        return gradients_.info() == Eigen::Success;
    }
    if (iterates(Solver::richardson)) {
        // Row sums of the matrix as it stands, lumped or not; `times` wants the matrix itself.
        const auto kept = local_;
        for (std::size_t c = 0; c < local_.size(); ++c) {
            const std::size_t n = basis_.on_cell(int(c)).size();
            for (std::size_t i = 0; i < n; ++i) {
                double sum = 0;
                for (std::size_t j = 0; j < n; ++j) sum += local_[c][i * n + j];
                local_[c][i * n + i] = sum;
            }
        }
        add_up(lumped_, lumped_places_);
        local_ = kept;
        drop_from(lumped_);
        lumped_cholesky_.factorize(lumped_);
        return lumped_cholesky_.info() == Eigen::Success;
    }
    if (!symmetric()) {
        general_.factorize(matrix_);
        return general_.info() == Eigen::Success;
    }
    cholesky_.factorize(matrix_);
    if (cholesky_.info() != Eigen::Success) return false;
    const auto pivots = cholesky_.vectorD();
    condition_ = pivots.minCoeff() / pivots.maxCoeff();
    return condition_ > 0;
}

bool MassSystem::Work::reduced_solve(const Eigen::VectorXd& f, Eigen::VectorXd& c) {
    iterations_ = 0;
    if (iterates(Solver::conjugate_gradients)) {
        c = gradients_.solve(f);
        iterations_ = int(gradients_.iterations());
        return gradients_.info() == Eigen::Success;
    }
    if (iterates(Solver::richardson)) {
        // c <- c + L^-1 (f - M c), from the lumped solution; stopping early is a choice.
        c = lumped_cholesky_.solve(f);
        const double scale = f.norm();
        while (iterations_ < options_.iterations) {
            const Eigen::VectorXd residual = f - matrix_ * c;
            if (residual.norm() <= options_.tolerance * scale) break;
            c += lumped_cholesky_.solve(residual);
            ++iterations_;
        }
        return true;
    }
    if (symmetric())
        c = cholesky_.solve(f);
    else
        c = general_.solve(f);
    return true;
}

bool MassSystem::Work::solve(const Eigen::VectorXd& f, const Eigen::VectorXd& given,
                             Eigen::VectorXd& c) {
    Eigen::VectorXd right, free;
    const bool moved = given.cwiseAbs().maxCoeff() > 0;
    if (moved)
        constraints_->reduce(f - times(given), right);
    else
        constraints_->reduce(f, right);
    for (Eigen::Index k = 0; k < right.size(); ++k)
        if (dropped_[std::size_t(k)]) right[k] = 0;
    const bool converged = right.size() == 0 || reduced_solve(right, free);
    if (right.size() == 0) free = right;
    constraints_->expand(free, c);
    if (moved) c += given;
    return converged;
}

Eigen::VectorXd MassSystem::Work::times(const Eigen::VectorXd& c) const {
    Eigen::VectorXd out = Eigen::VectorXd::Zero(c.size());
    for (int cell = 0; cell < basis_.cells(); ++cell) {
        const auto& on = basis_.on_cell(cell);
        const auto& local = local_[std::size_t(cell)];
        for (std::size_t i = 0; i < on.size(); ++i)
            for (std::size_t j = 0; j < on.size(); ++j)
                for (int k = 0; k < 2; ++k)
                    out[2 * on[i] + k] += local[i * on.size() + j] * c[2 * on[j] + k];
    }
    return out;
}

std::size_t MassSystem::Work::bytes() const {
    std::size_t all = std::size_t(matrix_.nonZeros() + lumped_.nonZeros()) * 12;
    if (!iterates(Solver::conjugate_gradients) && !iterates(Solver::richardson)) {
        all += 12 * std::size_t(symmetric() ? cholesky_.matrixL().nestedExpression().nonZeros()
                                            : general_.nnzL() + general_.nnzU());
    }
    for (const auto& l : local_) all += l.size() * sizeof(double);
    for (const auto& p : places_) all += p.size() * sizeof(Place);
    return all;
}

MassSystem::MassSystem(const Basis& basis, const MassOptions& options, Cpu& exec)
    : work_(std::make_unique<Work>(basis, options, exec)) {}
MassSystem::~MassSystem() = default;
void MassSystem::constrain(const Constraints& constraints) { work_->constrain(constraints); }
bool MassSystem::assemble(const CellMatrices& sums, const std::vector<char>& filled) {
    return work_->assemble(sums, filled);
}
bool MassSystem::solve(const Eigen::VectorXd& f, const Eigen::VectorXd& given, Eigen::VectorXd& c) {
    return work_->solve(f, given, c);
}
Eigen::VectorXd MassSystem::times(const Eigen::VectorXd& c) const { return work_->times(c); }
int MassSystem::inactive() const { return work_->inactive_; }
double MassSystem::smallest_mass() const { return work_->smallest_; }
double MassSystem::reciprocal_condition() const { return work_->condition_; }
int MassSystem::iterations() const { return work_->iterations_; }
bool MassSystem::symmetric() const { return work_->symmetric(); }
std::size_t MassSystem::bytes() const { return work_->bytes(); }

}  // namespace mpm::triangular
