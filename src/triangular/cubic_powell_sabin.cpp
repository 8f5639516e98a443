#include "mpm/triangular/cubic_powell_sabin.hpp"

#include <algorithm>

namespace mpm::triangular {

static_assert(CubicPowellSabin::on_triangle <= Basis::most);

namespace {

// Where the ordinates of a triangle are kept. V is corner k, Z the inner point, R the point on the
// corner's first (h = 0) or second side (h = 1), and VVR the place (2 V + R) / 3.
constexpr int vvv(int k) { return k; }
constexpr int vvz(int k) { return 3 + k; }
constexpr int vzz(int k) { return 6 + k; }
constexpr int vvr(int k, int h) { return 9 + 2 * k + h; }
constexpr int vrz(int k, int h) { return 15 + 2 * k + h; }
constexpr int vrr(int k, int h) { return 21 + 2 * k + h; }
constexpr int rrr(int side) { return 27 + side; }
constexpr int rrz(int side) { return 30 + side; }
constexpr int rzz(int side) { return 33 + side; }
constexpr int zzz = 36;

// Order of the functions of a triangle: of its vertices, of its corners, across its sides.
constexpr int of_vertex(int k, int q) { return 3 * k + q; }
constexpr int inside(int k, int h) { return 9 + 2 * k + h; }
constexpr int across(int side, int h) { return 15 + 2 * side + h; }

/// Places of a piece's ordinates, in the order that the header gives.
std::array<int, 10> places_of(int piece) {
    const int k = Split::corner_of(piece), side = Split::side_of(piece), h = k == side ? 0 : 1;
    return {vvv(k),    rrr(side), zzz,    vvr(k, h), vrr(k, h),
            rrz(side), rzz(side), vzz(k), vvz(k),    vrz(k, h)};
}

}  // namespace

CubicPowellSabin::CubicPowellSabin(std::shared_ptr<const Mesh> shared,
                                   const std::vector<Point>& inner)
    : OnMesh(shared), split_(std::move(shared), inner) {
    const auto& vertices = mesh().vertices();
    for (int v = 0; v < int(vertices.size()); ++v) {
        const auto corners = control_triangle(split_.shell(v, 1.0 / 3));
        triplet_.push_back(triplets(corners, vertices[std::size_t(v)]));
        control_points_.insert(control_points_.end(), corners.begin(), corners.end());
    }
    for (int t = 0; t < cells(); ++t) {
        for (int k = 0; k < 3; ++k) {
            const Point v = mesh().corners(t)[std::size_t(k)];
            const Point from = v + (split_.inner(t) - v) / 3;
            const double reach = corner(t, k).reach;
            for (int side : {k, (k + 2) % 3})
                control_points_.push_back(from + reach * (split_.on_side(t, side) - v) / 3);
        }
    }
    for (const auto& e : mesh().edges()) {
        first_on_edge_.push_back(e.outer() ? functions() : -1);
        if (!e.outer()) continue;
        const Point& r = split_.on_side(e.sides[0].triangle, e.sides[0].side);
        for (int v : e.vertex) control_points_.push_back((vertices[std::size_t(v)] + 2 * r) / 3);
    }
    ordinates_.resize(std::size_t(cells()), Ordinates::Zero());
    for (int t = 0; t < cells(); ++t) {
        number(t);
        fill(t);
    }
}

CubicPowellSabin::Corner CubicPowellSabin::corner(int t, int k) const {
    const Point v = mesh().corners(t)[std::size_t(k)];
    const Point r = split_.on_side(t, k) - v, other = split_.on_side(t, (k + 2) % 3) - v;
    const Point z = split_.inner(t) - v;
    const double d = cross(r, other), first = cross(z, other) / d, second = cross(r, z) / d;
    return {first, second, std::max(1.0, first + second)};
}

int CubicPowellSabin::of_corner(int t, int k, int side) const {
    return 3 * int(mesh().vertices().size()) + 6 * t + 2 * k + (k == side ? 0 : 1);
}

void CubicPowellSabin::number(int t) {
    const auto& vertex = mesh().triangles()[std::size_t(t)];
    std::vector<int> here(on_triangle);
    for (int k = 0; k < 3; ++k) {
        const int v = vertex[std::size_t(k)];
        for (int q = 0; q < 3; ++q) here[std::size_t(of_vertex(k, q))] = 3 * v + q;
        here[std::size_t(inside(k, 0))] = of_corner(t, k, k);
        here[std::size_t(inside(k, 1))] = of_corner(t, k, (k + 2) % 3);
    }
    for (int side = 0; side < 3; ++side) {
        const auto number = std::size_t(mesh().edge_of(t, side));
        const auto& e = mesh().edges()[number];
        const auto& s = e.sides[e.sides[0].triangle == t ? 1 : 0];
        for (int h = 0; h < 2; ++h) {
            int& f = here[std::size_t(across(side, h))];
            if (e.outer()) {
                f = first_on_edge_[number] +
                    (vertex[std::size_t((side + h) % 3)] == e.vertex[0] ? 0 : 1);
            } else {
                // The neighbour runs along the side the other way.
                f = of_corner(s.triangle, (s.side + 1 - h) % 3, s.side);
            }
        }
    }
    on_cell_.push_back(std::move(here));
}

void CubicPowellSabin::fill(int t) {
    Ordinates& o = ordinates_[std::size_t(t)];
    const auto& vertex = mesh().triangles()[std::size_t(t)];
    const auto c = mesh().corners(t);
    for (int k = 0; k < 3; ++k) {
        const auto& triplet = triplet_[std::size_t(vertex[std::size_t(k)])];
        const Point& v = c[std::size_t(k)];
        // Next to a vertex, its tangent plane.
        for (int q = 0; q < 3; ++q) {
            const Triplet& plane = triplet[std::size_t(q)];
            const int f = of_vertex(k, q);
            o(f, vvv(k)) = plane.value;
            o(f, vvz(k)) = plane.plane((split_.inner(t) - v) / 3);
            o(f, vvr(k, 0)) = plane.plane((split_.on_side(t, k) - v) / 3);
            o(f, vvr(k, 1)) = plane.plane((split_.on_side(t, (k + 2) % 3) - v) / 3);
        }
        // In the next shell, the plane over (2 V + Z) / 3 and the corner's two control points.
        const Corner blue = corner(t, k);
        const double share[2] = {blue.first / blue.reach, blue.second / blue.reach};
        o.col(vzz(k)) = (1 - share[0] - share[1]) * o.col(vvz(k));
        for (int h = 0; h < 2; ++h) {
            o(inside(k, h), vzz(k)) += share[h];
            o.col(vrz(k, h)) = (1 - 1 / blue.reach) * o.col(vvz(k));
            o(inside(k, h), vrz(k, h)) += 1 / blue.reach;
        }
    }
    for (int side = 0; side < 3; ++side) {
        const auto& e = mesh().edges()[std::size_t(mesh().edge_of(t, side))];
        const auto& s = e.sides[e.sides[0].triangle == t ? 1 : 0];
        for (int h = 0; h < 2; ++h) {
            const int k = (side + h) % 3;
            if (e.outer()) {
                o(across(side, h), vrr(k, h)) = 1;
                continue;
            }
            // The side's point lies between the inner points of both triangles, and this ordinate
            // likewise between one of each.
            const Corner blue = corner(s.triangle, (s.side + 1 - h) % 3);
            const double own = split_.part(t, side);
            o.col(vrr(k, h)) = own * o.col(vrz(k, h));
            const auto& triplet = triplet_[std::size_t(vertex[std::size_t(k)])];
            const Point to = (split_.inner(s.triangle) - c[std::size_t(k)]) / 3;
            for (int q = 0; q < 3; ++q)
                o(of_vertex(k, q), vrr(k, h)) +=
                    (1 - own) * (1 - 1 / blue.reach) * triplet[std::size_t(q)].plane(to);
            o(across(side, h), vrr(k, h)) += (1 - own) / blue.reach;
        }
    }
    // Along the sides, and around the inner point, what C1 leaves no choice of.
    for (int side = 0; side < 3; ++side) {
        const int next = (side + 1) % 3;
        const double a = split_.share(t, side), b = 1 - a;
        o.col(rrr(side)) = a * o.col(vrr(side, 0)) + b * o.col(vrr(next, 1));
        o.col(rrz(side)) = a * o.col(vrz(side, 0)) + b * o.col(vrz(next, 1));
        o.col(rzz(side)) = a * o.col(vzz(side)) + b * o.col(vzz(next));
        o.col(zzz) += split_.weights(t)[std::size_t(side)] * o.col(vzz(side));
    }
}

void CubicPowellSabin::evaluate(int cell, const Point& x, double* value, Point* gradient) const {
    std::array<double, 3> at;
    const int piece = split_.locate(cell, x, at);
    const auto [a, b, c] = at;
    const double bernstein[10] = {a * a * a,     b * b * b,     c * c * c,     3 * a * a * b,
                                  3 * a * b * b, 3 * b * b * c, 3 * b * c * c, 3 * c * c * a,
                                  3 * c * a * a, 6 * a * b * c};
    // Its derivatives by the three coordinates.
    const double steep[10][3] = {{3 * a * a, 0, 0},         {0, 3 * b * b, 0},
                                 {0, 0, 3 * c * c},         {6 * a * b, 3 * a * a, 0},
                                 {3 * b * b, 6 * a * b, 0}, {0, 6 * b * c, 3 * b * b},
                                 {0, 3 * c * c, 6 * b * c}, {3 * c * c, 0, 6 * c * a},
                                 {6 * c * a, 0, 3 * a * a}, {6 * b * c, 6 * c * a, 6 * a * b}};
    const auto& slope = split_.gradients(cell, piece);
    const Ordinates& o = ordinates_[std::size_t(cell)];
    std::fill(value, value + on_triangle, 0.0);
    std::fill(gradient, gradient + on_triangle, Point::Zero());
    const auto place = places_of(piece);
    for (std::size_t n = 0; n < 10; ++n) {
        const Point g = steep[n][0] * slope[0] + steep[n][1] * slope[1] + steep[n][2] * slope[2];
        const auto ordinate = o.col(place[n]);
        for (int f = 0; f < on_triangle; ++f) {
            value[f] += bernstein[n] * ordinate[f];
            gradient[f] += ordinate[f] * g;
        }
    }
}

std::vector<std::array<Point, 3>> CubicPowellSabin::pieces(int cell) const {
    std::vector<std::array<Point, 3>> out;
    for (int p = 0; p < Split::pieces; ++p) out.push_back(split_.piece(cell, p));
    return out;
}

std::vector<Functional> CubicPowellSabin::along(int edge) const {
    const int number = edge_number(edge);
    const Point tangent =
        (outline()[std::size_t(edge)].end - outline()[std::size_t(edge)].start).normalized();
    std::vector<Functional> out;
    for (int v : mesh().edges()[std::size_t(number)].vertex) {
        Functional value, slope{{}, {}, true};
        for (int q = 0; q < 3; ++q) {
            const Triplet& t = triplet_[std::size_t(v)][std::size_t(q)];
            value.function.push_back(3 * v + q);
            value.weight.push_back(t.value);
            slope.function.push_back(3 * v + q);
            slope.weight.push_back(t.gradient.dot(tangent));
        }
        out.push_back(std::move(value));
        out.push_back(std::move(slope));
    }
    const int first = first_on_edge_[std::size_t(number)];
    out.push_back({{first}, {1.0}});
    out.push_back({{first + 1}, {1.0}});
    return out;
}

Eigen::Matrix<double, CubicPowellSabin::on_triangle, 10> CubicPowellSabin::ordinates(
    int cell, int piece) const {
    const auto place = places_of(piece);
    Eigen::Matrix<double, on_triangle, 10> out;
    for (std::size_t n = 0; n < 10; ++n)
        out.col(Eigen::Index(n)) = ordinates_[std::size_t(cell)].col(place[n]);
    return out;
}

}  // namespace mpm::triangular
