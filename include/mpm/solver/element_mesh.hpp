// The mesh of one body of elements, by number of vertex and of element, wherever its vertices are
// stored: the elements at rest, which elements each vertex has, and room for what a step finds of
// them. Of it only what elements of laws that flow keep is state: a checkpoint stores the vertices
// as particles, and F follows from where they are.
#pragma once

#include <array>
#include <cmath>
#include <cstdint>
#include <limits>
#include <memory>
#include <string>
#include <vector>

#include "mpm/core/error.hpp"
#include "mpm/exec/buffer.hpp"
#include "mpm/kernels/elements.hpp"
#include "mpm/solver/mesh_share.hpp"
#include "mpm/solver/spec.hpp"

namespace mpm {

/// Longest edge of an element over the square root of the dimension, in cells. Where elements are
/// larger, nodes between vertices are empty and other bodies pass.
inline constexpr double largest_element = 1.05;

/// Refuses what is no mesh of this grid, by the element's number. `position`: (vertices, dimension)
/// m; `element`: (m, dimension + 1).
void check_mesh(const std::string& body, int dimension, const std::vector<double>& position,
                const std::vector<std::int32_t>& element, double cell_size);

/// Memory of a mesh with numbers of `real` bytes.
template <int D>
double planned_mesh_bytes(std::uint64_t elements, std::uint64_t vertices, bool vertex_volumes,
                          int kept, bool loaded, bool pinned, bool stressed, int real) {
    const int of_volumes = vertex_volumes ? 1 : 0,
              by_element = 2 * 4 * (D + 1) + real * (2 * D * D + 1 + of_volumes + kept +
                                                     (stressed ? start_reals<D> : 0)),
              by_vertex = 4 * (2 * D + 1) + (pinned ? 5 : 0) +
                          real * (2 * D + 3 * of_volumes + (loaded ? D : 0));
    return double(elements) * by_element + double(vertices) * by_vertex;
}

template <class X, class T, int D>
class ElementMesh {
public:
    static constexpr std::size_t corners = D + 1;

    /// As `check_mesh` has it; `kept`: numbers that an element keeps.
    ElementMesh(X& exec, const std::string& body, const std::vector<double>& position,
                const std::vector<std::int32_t>& element, bool vertex_volumes, int kept,
                double cell_size, double density)
        : vertex_(exec),
          rest_cell_(exec),
          cells_(exec),
          start_(exec),
          corner_(exec),
          inverse_(exec),
          volume_(exec),
          force_(exec),
          grown_(exec),
          kept_(exec),
          start_stress_(exec),
          rest_offset_(exec),
          beyond_(exec),
          vertex_volume_(exec),
          vertex_change_(exec),
          pressure_(exec),
          load_(exec),
          pinned_(exec),
          held_(exec),
          inverted_(exec),
          energy_(exec),
          pushed_(exec),
          measured_(exec),
          pressed_(exec),
          elements_(element.size() / corners),
          vertices_(position.size() / D),
          kept_reals_(std::size_t(kept)),
          vertex_volumes_(vertex_volumes) {
        check_mesh(body, D, position, element, cell_size);
        std::vector<T> inverse(elements_ * D * D), volume(elements_);
        std::vector<double> of_vertex(vertices_, 0.0);
        std::vector<std::uint32_t> start(vertices_ + 1, 0), corner(element.size());
        for (std::size_t e = 0; e < elements_; ++e) {
            Mat<double, D> edges;
            for (std::size_t k = 0; k < corners; ++k) {
                ++start[std::size_t(element[e * corners + k]) + 1];
                for (std::size_t a = 0; k > 0 && a < D; ++a)
                    edges.e[a][k - 1] =
                        (at(position, element, e, k, a) - at(position, element, e, 0, a)) /
                        cell_size;
            }
            const ElementAtRest<D> rest(edges);
            volume[e] = T(rest.volume * std::pow(cell_size, D));
            for (std::size_t a = 0; a < D; ++a)
                for (std::size_t b = 0; b < D; ++b)
                    inverse[(e * D + a) * D + b] = T(rest.inverse.e[a][b]);
            for (std::size_t k = 0; k < corners; ++k)
                of_vertex[std::size_t(element[e * corners + k])] +=
                    rest.volume * std::pow(cell_size, D) / double(corners);
        }
        for (std::size_t v = 0; v < vertices_; ++v) {
            start[v + 1] += start[v];
            mass_.push_back(density * of_vertex[v]);
        }
        auto next = start;
        for (std::size_t c = 0; c < element.size(); ++c)
            corner[next[std::size_t(element[c])]++] = std::uint32_t(c);
        vertex_.assign(element);
        start_.assign(start);
        corner_.assign(corner);
        inverse_.assign(inverse);
        volume_.assign(volume);
        inverted_.assign({no_fault});
        force_.reserve_discard(elements_ * D * D);
        rest_cell_.reserve_discard(vertices_ * D);
        cells_.reserve_discard(vertices_ * D);
        rest_offset_.reserve_discard(vertices_ * D);
        beyond_.reserve_discard(vertices_ * D);
        if (kept > 0) kept_.assign(std::vector<T>(elements_ * kept_reals_, T(0)));
        if (!vertex_volumes_) return;
        grown_.reserve_discard(elements_);
        vertex_volume_.assign(std::vector<T>(of_vertex.begin(), of_vertex.end()));
        vertex_change_.reserve_discard(vertices_);
        pressure_.reserve_discard(vertices_);
    }

    ElementsView<T, D> view() const {
        ElementsView<T, D> v{};
        v.elements = std::int64_t(elements_);
        v.vertices = std::int64_t(vertices_);
        if (share_) {
            v.pushed = {std::int64_t(share_->pushed.size()), pushed_.data()};
            v.measured = {std::int64_t(share_->measured.size()), measured_.data()};
            v.pressed = {std::int64_t(share_->pressed.size()), pressed_.data()};
        } else {
            v.pushed = v.measured = {v.elements};
            v.pressed = {v.vertices};
        }
        v.vertex = vertex_.data();
        v.inverse = inverse_.data();
        v.volume = volume_.data();
        v.force = force_.data();
        v.grown = vertex_volumes_ ? grown_.data() : nullptr;
        v.kept = kept_reals_ > 0 ? kept_.data() : nullptr;
        v.start_stress = start_stress_.size() > 0 ? start_stress_.data() : nullptr;
        v.rest_cell = rest_cell_.data();
        v.rest_offset = rest_offset_.data();
        v.cells = cells_.data();
        v.beyond = beyond_.data();
        v.start = start_.data();
        v.corner = corner_.data();
        v.vertex_volume = vertex_volume_.data();
        v.vertex_change = vertex_change_.data();
        v.pressure = pressure_.data();
        v.load = load_.size() > 0 ? load_.data() : nullptr;
        v.held = held_.size() > 0 ? held_.data() : nullptr;
        v.inverted = inverted_.data();
        return v;
    }
    std::size_t elements() const { return elements_; }
    std::size_t vertices() const { return vertices_; }
    bool vertex_volumes() const { return vertex_volumes_; }
    /// rho sum V/(D + 1) of each vertex, kg (2D: kg/m).
    const std::vector<double>& mass() const { return mass_; }
    /// What elements keep, (elements, kept), in the mesh's order; all zero at rest.
    std::size_t kept() const { return kept_reals_; }
    std::vector<T> kept_numbers() const { return kept_.host(elements_ * kept_reals_); }
    void keep(const std::vector<T>& numbers) { kept_.assign(numbers); }
    /// Room for the loads of tractions, (vertices, D), zero when first asked for.
    T* load() {
        if (load_.size() == 0) load_.assign(std::vector<T>(vertices_ * D, T(0)));
        return load_.data();
    }
    /// Stresses at rest, (elements, `start_reals`), Pa; of none nothing is held.
    void stress(const std::vector<double>& numbers) {
        if (!numbers.empty()) start_stress_.assign(std::vector<T>(numbers.begin(), numbers.end()));
    }
    /// Which of the pinned vertices each is, in the order of their pins, or -1; null without pins.
    const std::int32_t* pinned() const { return pinned_.size() > 0 ? pinned_.data() : nullptr; }
    void pin(const std::vector<PinSpec>& pins) {
        if (pins.empty()) return;
        std::vector<std::int32_t> number(vertices_, -1);
        std::vector<std::uint8_t> held(vertices_, 0);
        std::int32_t next = 0;
        for (const PinSpec& pin : pins)
            for (const std::uint64_t v : pin.vertices) {
                number[std::size_t(v)] = next++;
                for (const int a : pin.axes) held[std::size_t(v)] |= std::uint8_t(1 << a);
            }
        pinned_.assign(number);
        held_.assign(held);
    }
    /// Room for a number an element, taken when it is first asked for.
    double* energy() {
        energy_.reserve_discard(elements_);
        return energy_.data();
    }
    /// Of several ranks: what this one works on, and what it tells the others. Null on one.
    MeshShare* share() { return share_.get(); }
    const MeshShare* share() const { return share_.get(); }
    /// By the present owners of its vertices.
    void share_among(std::vector<std::int32_t> owner, int rank, int ranks) {
        share_.reset();  // all are listed meanwhile
        auto share = std::make_unique<MeshShare>();
        share->owner = std::move(owner);
        share->list(view(), rank, ranks);
        pushed_.assign(share->pushed);
        measured_.assign(share->measured);
        pressed_.assign(share->pressed);
        share_ = std::move(share);
    }
    /// Whether what counts each element once counts it on this rank.
    bool counts(std::int64_t element, int rank) const {
        return !share_ || share_->owner[std::size_t(view().number(element, 0))] == rank;
    }
    /// The first element that was turned inside out, or `no_fault`; forgotten with `begin_anew`.
    std::uint64_t inverted() const { return inverted_.host()[0]; }
    void begin_anew() { inverted_.assign({no_fault}); }
    std::size_t bytes() const {
        return vertex_.bytes() + rest_cell_.bytes() + cells_.bytes() + start_.bytes() +
               corner_.bytes() + inverse_.bytes() + volume_.bytes() + force_.bytes() +
               grown_.bytes() + kept_.bytes() + start_stress_.bytes() + rest_offset_.bytes() +
               beyond_.bytes() + vertex_volume_.bytes() + vertex_change_.bytes() +
               pressure_.bytes() + load_.bytes() + pinned_.bytes() + held_.bytes() +
               inverted_.bytes() + energy_.bytes() + pushed_.bytes() + measured_.bytes() +
               pressed_.bytes() + (share_ ? share_->bytes() : 0);
    }

private:
    static double at(const std::vector<double>& position, const std::vector<std::int32_t>& element,
                     std::size_t e, std::size_t k, std::size_t a) {
        return position[std::size_t(element[e * corners + k]) * D + a];
    }

    Buffer<X, std::int32_t> vertex_, rest_cell_, cells_;
    Buffer<X, std::uint32_t> start_, corner_;
    Buffer<X, T> inverse_, volume_, force_, grown_, kept_, start_stress_;
    Buffer<X, T> rest_offset_, beyond_, vertex_volume_, vertex_change_, pressure_, load_;
    Buffer<X, std::int32_t> pinned_;
    Buffer<X, std::uint8_t> held_;
    Buffer<X, std::uint64_t> inverted_;
    Buffer<X, double> energy_;
    Buffer<X, std::int32_t> pushed_, measured_, pressed_;
    std::unique_ptr<MeshShare> share_;
    std::size_t elements_, vertices_, kept_reals_;
    bool vertex_volumes_;
    std::vector<double> mass_;
};

}  // namespace mpm
