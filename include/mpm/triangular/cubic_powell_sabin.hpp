// Cubic Powell-Sabin splines: continuously differentiable, none negative, exact for cubic fields.
// De Koster (2018), appendix A.3; their ordinates are derived in section 6 of the digest from the
// conditions for a continuous gradient.
#pragma once

#include <Eigen/Core>
#include <memory>
#include <vector>

#include "mpm/triangular/control_triangle.hpp"
#include "mpm/triangular/on_mesh.hpp"
#include "mpm/triangular/split.hpp"

namespace mpm::triangular {

/// Three functions a vertex, 3 v + q; two for each corner of a triangle, one for each piece there;
/// and two for each outer edge. They span all C1 cubics on the split. In a triangle live those of
/// its vertices, of its own corners, and on each side two of the neighbour or of the outer edge.
class CubicPowellSabin final : public OnMesh {
public:
    static constexpr int on_triangle = 21;

    /// Inner points of the split at the incentres, or as given, one for each triangle.
    explicit CubicPowellSabin(std::shared_ptr<const Mesh> mesh,
                              const std::vector<Point>& inner = {});

    const char* name() const override { return "cubic-powell-sabin"; }
    int degree() const override { return 3; }
    int functions() const override { return int(control_points_.size()); }
    const std::vector<int>& on_cell(int cell) const override { return on_cell_[std::size_t(cell)]; }
    void evaluate(int cell, const Point& x, double* value, Point* gradient) const override;
    std::vector<std::array<Point, 3>> pieces(int cell) const override;
    std::vector<Point> control_points() const override { return control_points_; }
    std::vector<Functional> along(int edge) const override;

    const Split& split() const { return split_; }
    /// Bezier ordinates of a triangle's functions, in the order of on_cell, in one of its pieces
    /// (A, B, C): at AAA, BBB, CCC, AAB, ABB, BBC, BCC, CCA, CAA, ABC.
    Eigen::Matrix<double, on_triangle, 10> ordinates(int cell, int piece) const;

private:
    /// Places of the ordinates of a triangle, those that its pieces share only once.
    static constexpr int places = 37;
    using Ordinates = Eigen::Matrix<double, on_triangle, places>;
    /// A corner's inner control points lie at reach / 3 of the way from (2 V + Z) / 3 along the two
    /// sides' halves R - V; Z - V = first (R - V) + second (R' - V).
    struct Corner {
        double first, second, reach;
    };

    Corner corner(int triangle, int k) const;
    int of_corner(int triangle, int k, int side) const;
    void number(int triangle);
    void fill(int triangle);

    Split split_;
    std::vector<std::array<Triplet, 3>> triplet_;
    std::vector<int> first_on_edge_;  // the first of an outer edge's two functions
    std::vector<Point> control_points_;
    std::vector<std::vector<int>> on_cell_;
    std::vector<Ordinates> ordinates_;
};

}  // namespace mpm::triangular
