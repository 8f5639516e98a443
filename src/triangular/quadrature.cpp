#include "mpm/triangular/quadrature.hpp"

#include <Eigen/Eigenvalues>

namespace mpm::triangular {

/// Eigenvalues of the recursion of Legendre's polynomials (Golub and Welsch).
std::vector<std::pair<double, double>> gauss(int n) {
    Eigen::MatrixXd jacobi = Eigen::MatrixXd::Zero(n, n);
    for (int k = 1; k < n; ++k)
        jacobi(k, k - 1) = jacobi(k - 1, k) = k / std::sqrt(4.0 * k * k - 1);
    const Eigen::SelfAdjointEigenSolver<Eigen::MatrixXd> solver(jacobi);
    std::vector<std::pair<double, double>> out;
    for (int k = 0; k < n; ++k)
        out.emplace_back((1 + solver.eigenvalues()[k]) / 2,
                         std::pow(solver.eigenvectors()(0, k), 2));
    return out;
}

}  // namespace mpm::triangular
