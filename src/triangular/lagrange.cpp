#include "mpm/triangular/lagrange.hpp"

#include <string>

#include "mpm/core/error.hpp"

namespace mpm::triangular {

Lagrange::Lagrange(std::shared_ptr<const Mesh> shared, int order)
    : OnMesh(std::move(shared)), order_(order) {
    if (order < 1 || order > highest) {
        throw SceneError("Lagrange basis: order " + std::to_string(order) + "; expected 1 to " +
                         std::to_string(highest));
    }
    // Corners first, so that order 1 is the barycentric coordinates in the order of the corners.
    index_ = {{order, 0, 0}, {0, order, 0}, {0, 0, order}};
    for (int k = 0; k <= order; ++k)
        for (int l = 0; k + l <= order; ++l)
            if (const int m = order - k - l; k < order && l < order && m < order)
                index_.push_back({k, l, m});

    nodes_ = mesh().vertices();
    for (const auto& e : mesh().edges()) {
        const Point a = nodes_[std::size_t(e.vertex[0])], b = nodes_[std::size_t(e.vertex[1])];
        for (int place = 1; place < order; ++place) {
            const double part = double(place) / order;
            nodes_.push_back((1 - part) * a + part * b);
        }
    }
    for (int t = 0; t < cells(); ++t) {
        const auto& vertex = mesh().triangles()[std::size_t(t)];
        const auto c = mesh().corners(t);
        gradients_.push_back(barycentric_gradients(c));
        std::vector<int> here;
        for (const auto& n : index_) {
            int zeros = 0, last_zero = 0;
            for (int k = 0; k < 3; ++k) {
                if (n[std::size_t(k)] == 0) {
                    ++zeros;
                    last_zero = k;
                }
            }
            if (zeros == 2) {
                here.push_back(vertex[here.size()]);
            } else if (zeros == 1) {
                const int side = (last_zero + 1) % 3;
                const auto from = std::size_t(side), to = std::size_t((side + 1) % 3);
                // Places count from the vertex of the lower number, for both triangles.
                here.push_back(
                    on_edge(mesh().edge_of(t, side), vertex[from] < vertex[to] ? n[to] : n[from]));
            } else {
                here.push_back(functions());
                nodes_.push_back((n[0] * c[0] + n[1] * c[1] + n[2] * c[2]) / order);
            }
        }
        on_cell_.push_back(std::move(here));
    }
}

int Lagrange::on_edge(int edge, int place) const {
    return int(mesh().vertices().size()) + edge * (order_ - 1) + place - 1;
}

void Lagrange::evaluate(int cell, const Point& x, double* value, Point* gradient) const {
    const auto& slope = gradients_[std::size_t(cell)];
    const auto& vertex = mesh().triangles()[std::size_t(cell)];
    const Point from = x - mesh().vertices()[std::size_t(vertex[0])];
    const double second = slope[1].dot(from), third = slope[2].dot(from);
    const double at[3] = {1 - second - third, second, third};
    if (order_ == 1) {
        for (std::size_t k = 0; k < 3; ++k) {
            value[k] = at[k];
            gradient[k] = slope[k];
        }
        return;
    }
    // factor[k][n]: the polynomial in coordinate k that is 1 at n / order and 0 at the nodes below.
    double factor[3][highest + 1], steep[3][highest + 1];
    for (std::size_t k = 0; k < 3; ++k) {
        factor[k][0] = 1;
        steep[k][0] = 0;
        for (int n = 0; n < order_; ++n) {
            const double next = (order_ * at[k] - n) / (n + 1);
            factor[k][n + 1] = factor[k][n] * next;
            steep[k][n + 1] = steep[k][n] * next + factor[k][n] * order_ / (n + 1);
        }
    }
    for (std::size_t i = 0; i < index_.size(); ++i) {
        const auto [a, b, c] = index_[i];
        const double f = factor[0][a], g = factor[1][b], h = factor[2][c];
        value[i] = f * g * h;
        gradient[i] = steep[0][a] * g * h * slope[0] + f * steep[1][b] * h * slope[1] +
                      f * g * steep[2][c] * slope[2];
    }
}

std::vector<Functional> Lagrange::along(int edge) const {
    const int number = edge_number(edge);
    const auto& ends = mesh().edges()[std::size_t(number)].vertex;
    std::vector<Functional> out = {{{ends[0]}, {1.0}}, {{ends[1]}, {1.0}}};
    for (int place = 1; place < order_; ++place) out.push_back({{on_edge(number, place)}, {1.0}});
    return out;
}

}  // namespace mpm::triangular
