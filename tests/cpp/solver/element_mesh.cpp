// The mesh of a body of elements alone: lists, rest shapes, masses, refusals.
#include "mpm/solver/element_mesh.hpp"

#include <gtest/gtest.h>

#include <numeric>

#include "mpm/exec/cpu.hpp"
#include "support/meshes_of_elements.hpp"

namespace mpm {
namespace {

using Mesh3 = ElementMesh<Cpu, double, 3>;
using Mesh2 = ElementMesh<Cpu, float, 2>;

TEST(ElementMesh, lists_the_elements_of_each_vertex_ascending) {
    Cpu exec(1);
    const auto box = test::box_of_elements({0, 0, 0}, {0.2, 0.3, 0.1}, {2, 3, 1});
    const Mesh3 mesh(exec, "box", box.vertex, box.element, false, 0, 0.1, 800);
    const auto view = mesh.view();
    EXPECT_EQ(mesh.elements(), 36u);
    EXPECT_EQ(mesh.vertices(), 24u);
    std::size_t entries = 0;
    for (std::size_t v = 0; v < mesh.vertices(); ++v) {
        for (std::uint32_t c = view.start[v]; c < view.start[v + 1]; ++c, ++entries) {
            EXPECT_EQ(std::size_t(box.element[view.corner[c]]), v);
            if (c > view.start[v]) {
                EXPECT_LT(view.corner[c - 1], view.corner[c]);
            }
        }
    }
    EXPECT_EQ(entries, box.element.size());
}

TEST(ElementMesh, volumes_and_masses_are_those_of_the_box) {
    Cpu exec(1);
    const auto box = test::box_of_elements({0, 0, 0}, {0.2, 0.3, 0.1}, {2, 3, 1});
    const Mesh3 mesh(exec, "box", box.vertex, box.element, true, 0, 0.1, 800);
    const auto view = mesh.view();
    double volume = 0;
    for (std::int64_t e = 0; e < view.elements; ++e) {
        volume += view.volume[e];
        // Cells are cubes of 0.1 m: D_m^-1 in 1/cells is a matrix of 0 and 1 here.
        const Mat<double, 3> inverse = element_inverse<double>(view, e);
        const Mat<double, 3> c = cofactors(inverse);
        EXPECT_NEAR(determinant(inverse, c), 1, 1e-12);
    }
    EXPECT_NEAR(volume, 0.006, 1e-15);
    const auto& mass = mesh.mass();
    EXPECT_NEAR(std::accumulate(mass.begin(), mass.end(), 0.0), 4.8, 1e-12);
    // Where a body is at rest, whatever its cells, there is no force and no change of volume.
    for (std::int64_t k = 0; k < view.vertices * 3; ++k) {
        view.cells[k] = 1000;
        view.beyond[k] = 0.25;
    }
    for (std::int64_t e = 0; e < view.elements; ++e) {
        grow_element(view, e);
        EXPECT_EQ(view.grown[e], 0);
    }
}

template <class F>
std::string refusal(const F& f) {
    try {
        f();
    } catch (const Error& e) {
        return e.what();
    }
    return "";
}

TEST(ElementMesh, refuses_by_the_number_of_the_element) {
    Cpu exec(1);
    const std::vector<double> square = {0, 0, 1, 0, 1, 1, 0, 1};
    const auto make = [&](std::vector<std::int32_t> elements, double cell = 1.0) {
        return refusal([&] { Mesh2(exec, "b", square, elements, false, 0, cell, 800); });
    };
    EXPECT_EQ(make({0, 1, 2, 0, 2, 3}), "");
    EXPECT_NE(make({0, 1, 2, 0, 3, 2}).find("element 1 has the volume -0.5"), std::string::npos);
    EXPECT_NE(make({0, 1, 2, 0, 2, 2}).find("element 1 has the volume 0"), std::string::npos);
    EXPECT_NE(make({0, 1, 2, 0, 2, 4}).find("element 1 names vertex 4 of 4"), std::string::npos);
    EXPECT_NE(make({0, 1, 2, 0, 1, 2}).find("vertex 3 belongs to no element"), std::string::npos);
    EXPECT_NE(make({0, 1, 2, 0}).find("no rows of 3"), std::string::npos);
    EXPECT_NE(make({0, 1, 2, 0, 2, 3}, 0.9).find("element 0 has an edge of 1.41"),
              std::string::npos);
}

}  // namespace
}  // namespace mpm
