#include "mpm/triangular/powell_sabin.hpp"

namespace mpm::triangular {

PowellSabin::PowellSabin(std::shared_ptr<const Mesh> mesh, const std::vector<Point>& inner)
    : OnMesh(mesh), split_(mesh, inner) {
    const auto& vertices = mesh->vertices();
    for (int v = 0; v < int(vertices.size()); ++v) {
        control_.push_back(control_triangle(split_.shell(v, 0.5)));
        triplet_.push_back(triplets(control_.back(), vertices[std::size_t(v)]));
    }
    for (int t = 0; t < cells(); ++t) {
        const auto& v = mesh->triangles()[std::size_t(t)];
        const auto corner = mesh->corners(t);
        on_cell_.emplace_back();
        planes_.emplace_back();
        for (int k = 0; k < 3; ++k) {
            const Point& here = corner[std::size_t(k)];
            for (int q = 0; q < 3; ++q) {
                const Triplet& own = triplet(v[std::size_t(k)])[std::size_t(q)];
                const auto half_way = [&](const Point& to) { return own.plane(0.5 * (to - here)); };
                on_cell_.back().push_back(3 * v[std::size_t(k)] + q);
                planes_.back()[std::size_t(3 * k + q)] = {own.value, half_way(split_.on_side(t, k)),
                                                          half_way(split_.on_side(t, (k + 2) % 3)),
                                                          half_way(split_.inner(t))};
            }
        }
    }
}

std::array<double, 6> PowellSabin::ordinates(int cell, int function, int piece) const {
    const int k = function / 3;  // corner whose function it is
    const Planes& p = planes_[std::size_t(cell)][std::size_t(function)];
    const double near = split_.share(cell, k);               // of the corner in side k
    const double far = 1 - split_.share(cell, (k + 2) % 3);  // and in the side before
    const double inner = split_.weights(cell)[std::size_t(k)] * p.inner;
    switch ((piece - 2 * k + Split::pieces) % Split::pieces) {
        case 0:
            return {p.vertex, near * p.side, inner, p.side, near * p.inner, p.inner};
        case 1:
            return {0, near * p.side, inner, 0, near * p.inner, 0};
        case 4:
            return {0, far * p.other_side, inner, 0, far * p.inner, 0};
        case 5:
            return {p.vertex, far * p.other_side, inner, p.other_side, far * p.inner, p.inner};
        default:
            return {0, 0, inner, 0, 0, 0};
    }
}

void PowellSabin::evaluate(int cell, const Point& x, double* value, Point* gradient) const {
    std::array<double, 3> z;
    const int piece = split_.locate(cell, x, z);
    const auto& g = split_.gradients(cell, piece);
    for (int f = 0; f < 9; ++f) {
        const auto o = ordinates(cell, f, piece);
        const double d0 = o[0] * z[0] + o[3] * z[1] + o[5] * z[2];
        const double d1 = o[3] * z[0] + o[1] * z[1] + o[4] * z[2];
        const double d2 = o[5] * z[0] + o[4] * z[1] + o[2] * z[2];
        value[f] = d0 * z[0] + d1 * z[1] + d2 * z[2];
        gradient[f] = 2 * (d0 * g[0] + d1 * g[1] + d2 * g[2]);
    }
}

std::vector<std::array<Point, 3>> PowellSabin::pieces(int cell) const {
    std::vector<std::array<Point, 3>> out;
    for (int p = 0; p < Split::pieces; ++p) out.push_back(split_.piece(cell, p));
    return out;
}

std::vector<Point> PowellSabin::control_points() const {
    std::vector<Point> out;
    for (const auto& triangle : control_) out.insert(out.end(), triangle.begin(), triangle.end());
    return out;
}

// Along a side a spline is fixed by value and slope at its ends: eqs. 3.63 and 3.64.
std::vector<Functional> PowellSabin::along(int edge) const {
    const OuterEdge& outer = outline()[std::size_t(edge)];
    const Point tangent = (outer.end - outer.start).normalized();
    std::vector<Functional> out;
    for (int v : mesh().edges()[std::size_t(edge_number(edge))].vertex) {
        Functional value, slope;
        slope.slope = true;
        for (int q = 0; q < 3; ++q) {
            const Triplet& t = triplet(v)[std::size_t(q)];
            value.function.push_back(3 * v + q);
            value.weight.push_back(t.value);
            slope.function.push_back(3 * v + q);
            slope.weight.push_back(t.gradient.dot(tangent));
        }
        out.push_back(value);
        out.push_back(slope);
    }
    return out;
}

}  // namespace mpm::triangular
