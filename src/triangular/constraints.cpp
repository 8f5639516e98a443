#include "mpm/triangular/constraints.hpp"

#include <Eigen/LU>
#include <Eigen/QR>
#include <algorithm>
#include <map>
#include <numeric>

namespace mpm::triangular {

namespace {

/// One condition on the coefficients, scaled to a unit row.
struct Row {
    std::vector<std::pair<int, double>> entries;  // (full number, weight)
    int hold;
    Point target;  // times the hold's velocity
    Point normal;  // of the edge
};

/// Weights below this part of the largest are rounding.
constexpr double negligible = 1e-9;
/// Conditions that differ by less are one: the edges along a straight side turn by the rounding of
/// their vertices, in files by some units of the ninth digit, and must not become corners.
constexpr double alike = 1e-5;

void add_rows(const Functional& f, int hold, const Point& direction, const Point& normal,
              std::vector<Row>& out) {
    Row row{{}, hold, f.slope ? Point(0, 0) : direction, normal};
    double norm = 0;
    for (double w : f.weight) norm = std::max(norm, std::abs(w));
    if (!(norm > 0)) return;
    for (std::size_t k = 0; k < f.function.size(); ++k)
        for (int c = 0; c < 2; ++c) {
            const double w = f.weight[k] / norm * direction[c];
            if (std::abs(w) > negligible) row.entries.push_back({2 * f.function[k] + c, w});
        }
    row.target /= norm;
    out.push_back(std::move(row));
}

/// Numbers that share a row belong together.
class Groups {
public:
    explicit Groups(int count) : parent_(std::size_t(count)) {
        std::iota(parent_.begin(), parent_.end(), 0);
    }
    int root(int i) {
        while (parent_[std::size_t(i)] != i)
            i = parent_[std::size_t(i)] = parent_[std::size_t(parent_[std::size_t(i)])];
        return i;
    }
    void join(int i, int j) { parent_[std::size_t(root(i))] = root(j); }

private:
    std::vector<int> parent_;
};

}  // namespace

Constraints::Constraints(const Basis& basis, const std::vector<Hold>& holds) {
    const int count = 2 * basis.functions();
    std::vector<Row> rows;
    for (std::size_t h = 0; h < holds.size(); ++h)
        for (int edge : holds[h].edges) {
            const Point& normal = basis.outline()[std::size_t(edge)].normal;
            for (const Functional& f : basis.along(edge)) {
                if (holds[h].normal_only) {
                    add_rows(f, int(h), normal, normal, rows);
                } else {
                    add_rows(f, int(h), Point(1, 0), normal, rows);
                    add_rows(f, int(h), Point(0, 1), normal, rows);
                }
            }
        }
    terms_.resize(std::size_t(count));
    held_.assign(std::size_t(count), -1);
    Groups groups(count);
    std::vector<double> facing(std::size_t(count), -1);
    for (const Row& r : rows)
        for (const auto& [full, weight] : r.entries) {
            groups.join(r.entries.front().first, full);
            // In a corner a force goes to the side that it presses on, not to one it runs along.
            const double faces = std::abs(r.normal[full % 2]);
            if (faces <= facing[std::size_t(full)] + alike) continue;
            facing[std::size_t(full)] = faces;
            held_[std::size_t(full)] = r.hold;
        }
    std::map<int, std::vector<int>>
        members;  // in ascending order: numbering stays that of the grid
    std::map<int, std::vector<const Row*>> conditions;
    for (int i = 0; i < count; ++i) members[groups.root(i)].push_back(i);
    for (const Row& r : rows) conditions[groups.root(r.entries.front().first)].push_back(&r);

    for (int i = 0; i < count; ++i) {
        const int root = groups.root(i);
        const auto found = conditions.find(root);
        if (found == conditions.end()) {
            terms_[std::size_t(i)].push_back({free_++, 1.0});
            continue;
        }
        const auto& numbers = members[root];
        if (numbers.front() != i) continue;  // the group is taken as a whole at its first member
        Eigen::MatrixXd c =
            Eigen::MatrixXd::Zero(Eigen::Index(found->second.size()), Eigen::Index(numbers.size()));
        for (std::size_t r = 0; r < found->second.size(); ++r)
            for (const auto& [full, weight] : found->second[r]->entries) {
                const auto at = std::lower_bound(numbers.begin(), numbers.end(), full);
                c(Eigen::Index(r), at - numbers.begin()) = weight;
            }
        Eigen::FullPivLU<Eigen::MatrixXd> lu(c);
        lu.setThreshold(alike);
        const Eigen::MatrixXd kernel = lu.kernel();
        const bool none = lu.dimensionOfKernel() == 0;
        for (Eigen::Index k = 0; !none && k < kernel.cols(); ++k) {
            const double largest = kernel.col(k).cwiseAbs().maxCoeff();
            for (std::size_t m = 0; m < numbers.size(); ++m) {
                const double w = kernel(Eigen::Index(m), k) / largest;
                if (std::abs(w) > negligible) terms_[std::size_t(numbers[m])].push_back({free_, w});
            }
            ++free_;
        }
        Eigen::CompleteOrthogonalDecomposition<Eigen::MatrixXd> least(c);
        least.setThreshold(alike);
        const Eigen::MatrixXd inverse = least.pseudoInverse();
        for (std::size_t m = 0; m < numbers.size(); ++m)
            for (std::size_t r = 0; r < found->second.size(); ++r) {
                const Row& row = *found->second[r];
                const Point response = inverse(Eigen::Index(m), Eigen::Index(r)) * row.target;
                if (response.cwiseAbs().maxCoeff() > 0)
                    given_.push_back({numbers[m], row.hold, response});
            }
    }
}

void Constraints::given(const std::vector<Point>& velocity, Eigen::VectorXd& full) const {
    full.setZero(Eigen::Index(terms_.size()));
    for (const Given& g : given_) full[g.full] += g.response.dot(velocity[std::size_t(g.hold)]);
}

void Constraints::expand(const Eigen::VectorXd& free, Eigen::VectorXd& full) const {
    full.resize(Eigen::Index(terms_.size()));
    for (std::size_t i = 0; i < terms_.size(); ++i) {
        double sum = 0;
        for (const Term& t : terms_[i]) sum += t.weight * free[t.free];
        full[Eigen::Index(i)] = sum;
    }
}

void Constraints::reduce(const Eigen::VectorXd& full, Eigen::VectorXd& free) const {
    free.setZero(free_);
    for (std::size_t i = 0; i < terms_.size(); ++i)
        for (const Term& t : terms_[i]) free[t.free] += t.weight * full[Eigen::Index(i)];
}

}  // namespace mpm::triangular
