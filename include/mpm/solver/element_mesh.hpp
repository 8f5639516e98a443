// The mesh of one body of elements, by number of vertex and of element, wherever its vertices are
// stored: the elements at rest, which elements each vertex has, and room for what a step finds of
// them. Of it only what elements of laws that flow keep is state: a checkpoint stores the vertices
// as particles, and F follows from where they are.
#pragma once

#include <array>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <cstring>
#include <limits>
#include <memory>
#include <string>
#include <vector>

#include "mpm/core/error.hpp"
#include "mpm/exec/buffer.hpp"
#include "mpm/kernels/elements.hpp"
#include "mpm/kernels/pinned_vertices.hpp"
#include "mpm/solver/mesh_share.hpp"
#include "mpm/solver/mesh_swap.hpp"
#include "mpm/solver/spec.hpp"
#include "mpm/solver/time_tables.hpp"

namespace mpm {

/// Longest edge of an element over the square root of the dimension, in cells. Where elements are
/// larger, nodes between vertices are empty and other bodies pass.
inline constexpr double largest_element = 1.05;

/// Refuses what is no mesh of this grid, by the element's number. `position`: (vertices, dimension)
/// m; `element`: (m, dimension + 1).
void check_mesh(const std::string& body, int dimension, const std::vector<double>& position,
                const std::vector<std::int32_t>& element, double cell_size);

/// What decides the memory of a mesh.
struct MeshSizes {
    std::uint64_t elements, vertices;
    bool vertex_volumes;
    int kept;                      // numbers that an element keeps
    std::uint64_t loaded, pinned;  // vertices of tractions, of pins
    bool stressed, damped;
};
/// With numbers of `real` bytes, of a device or not.
template <int D>
double planned_mesh_bytes(const MeshSizes& m, int real, bool device) {
    const int of_volumes = m.vertex_volumes ? 1 : 0,
              by_element = 2 * 4 * (D + 1) + real * (D * (2 * D + 1) + 1 + of_volumes + m.kept +
                                                     (m.stressed ? start_reals<D> : 0)),
              by_vertex = 4 * (2 * D + 1) + (m.pinned > 0 ? 5 : 0) +
                          real * (2 * D + 3 * of_volumes + (m.loaded > 0 ? D : 0) +
                                  (m.damped ? D : 0) + (device ? D : 0)),
              by_loaded = 4 + 8, by_pinned = 4 + 4 + 8 + 8 * D;
    return double(m.elements) * by_element + double(m.vertices) * by_vertex +
           double(m.loaded) * by_loaded + double(m.pinned) * by_pinned;
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
          force_(exec),
          inverse_(exec),
          volume_(exec),
          grown_(exec),
          kept_(exec),
          start_stress_(exec),
          rest_offset_(exec),
          beyond_(exec),
          moved_(exec),
          vertex_volume_(exec),
          vertex_change_(exec),
          pressure_(exec),
          load_(exec),
          vertex_push_(exec),
          pinned_(exec),
          pinned_vertex_(exec),
          pin_(exec),
          held_(exec),
          pinned_mine_(exec),
          pinned_mass_(exec),
          push_(exec),
          goal_(exec),
          tables_(exec),
          swap_(exec),
          exec_(exec),
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
        if constexpr (X::is_device) {
            host_ = {element, start, corner};
            vertex_push_.reserve_discard(vertices_ * D);
        }
        vertex_.assign(element);
        start_.assign(start);
        corner_.assign(corner);
        inverse_.assign(inverse);
        volume_.assign(volume);
        inverted_.assign({no_fault});
        force_.reserve_discard(elements_);
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
        v.moved = damping_.any() ? moved_.data() : nullptr;
        v.damping = damping_;
        v.start = start_.data();
        v.corner = corner_.data();
        v.vertex_volume = vertex_volume_.data();
        v.vertex_change = vertex_change_.data();
        v.pressure = pressure_.data();
        v.load = load_.size() > 0 ? load_.data() : nullptr;
        v.push = X::is_device ? vertex_push_.data() : nullptr;
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
    /// Tractions, in the order of the scene.
    struct Traction {
        TimeTableView value;
        Buffer<X, std::uint32_t> vertex;
        Buffer<X, double> area;
    };
    const std::vector<Traction>& tractions() const { return tractions_; }
    void load_by(const std::vector<TractionSpec>& tractions) {
        if (tractions.empty()) return;
        load_.assign(std::vector<T>(vertices_ * D, T(0)));
        for (const TractionSpec& t : tractions) {
            tractions_.push_back({tables_.upload(t.value, D), Buffer<X, std::uint32_t>(exec_),
                                  Buffer<X, double>(exec_)});
            tractions_.back().vertex.assign(
                std::vector<std::uint32_t>(t.particles.begin(), t.particles.end()));
            tractions_.back().area.assign(t.area);
        }
    }
    /// Stresses at rest, (elements, `start_reals`), Pa; of none nothing is held.
    void stress(const std::vector<double>& numbers) {
        if (!numbers.empty()) start_stress_.assign(std::vector<T>(numbers.begin(), numbers.end()));
    }
    /// Numerical damping, Pa s.
    void damp(double normal, double shear) {
        damping_ = {T(normal), T(shear)};
        moved_.assign(std::vector<T>(vertices_ * D, T(0)));
    }
    /// Of each pin, its displacement in m; without rows: none.
    const std::vector<TimeTableView>& goals() const { return goals_; }
    bool has_pins() const { return pinned_.size() > 0; }
    PinsView pins() const {
        return {std::int64_t(pin_.size()),
                pinned_.data(),
                pinned_vertex_.data(),
                pin_.data(),
                pinned_mass_.data(),
                goal_.data(),
                push_.data(),
                share_ ? pinned_mine_.data() : nullptr};
    }
    void pin(const std::vector<PinSpec>& pins) {
        if (pins.empty()) return;
        std::vector<std::int32_t> number(vertices_, -1), pin_of;
        std::vector<std::uint32_t> vertex;
        std::vector<std::uint8_t> held(vertices_, 0);
        std::vector<double> mass;
        std::vector<TimeTableView>& goal = goals_;
        for (const PinSpec& pin : pins) {
            for (const std::uint64_t v : pin.vertices) {
                number[std::size_t(v)] = std::int32_t(vertex.size());
                vertex.push_back(std::uint32_t(v));
                pin_of.push_back(std::int32_t(goal.size()));
                mass.push_back(mass_[std::size_t(v)]);
                for (const int a : pin.axes) held[std::size_t(v)] |= std::uint8_t(1 << a);
            }
            goal.push_back(pin.displacement.time.empty() ? TimeTableView{}
                                                         : tables_.upload(pin.displacement, D));
        }
        pinned_.assign(number);
        pinned_vertex_.assign(vertex);
        pin_.assign(pin_of);
        held_.assign(held);
        pinned_mass_.assign(mass);
        goal_.assign(goal);
        push_.assign(std::vector<double>(vertex.size() * D, 0.0));
    }
    /// Room for a number an element, taken when it is first asked for.
    double* energy() {
        energy_.reserve_discard(elements_);
        return energy_.data();
    }
    /// The mesh where the host reads it, and writes places and what elements keep: on devices a
    /// copy of what is there, which `take` brings back.
    class OnHost {
    public:
        OnHost(OnHost&&) noexcept = default;
        ElementsView<T, D> view;

    private:
        friend ElementMesh;
        explicit OnHost(const ElementsView<T, D>& v) : view(v) {}
        std::vector<std::vector<std::byte>> copies_;
    };
    OnHost on_host() const {
        OnHost out(connected());
        if constexpr (X::is_device) {
            const auto copy = [&]<class E>(const auto& from, E*& to) {
                if (!to) return;
                const auto numbers = from.host();
                auto& bytes = out.copies_.emplace_back(numbers.size() * sizeof(E));
                std::memcpy(bytes.data(), numbers.data(), bytes.size());
                to = reinterpret_cast<E*>(bytes.data());
            };
            ElementsView<T, D>& v = out.view;
            copy(inverse_, v.inverse);
            copy(volume_, v.volume);
            copy(kept_, v.kept);
            copy(start_stress_, v.start_stress);
            copy(rest_cell_, v.rest_cell);
            copy(rest_offset_, v.rest_offset);
            copy(cells_, v.cells);
            copy(beyond_, v.beyond);
            copy(moved_, v.moved);
            copy(vertex_volume_, v.vertex_volume);
            copy(vertex_change_, v.vertex_change);
            copy(pressure_, v.pressure);
            copy(inverted_, v.inverted);
            if (share_) {
                v.pushed.number = share_->pushed.data();
                v.measured.number = share_->measured.data();
                v.pressed.number = share_->pressed.data();
            }
        }
        return out;
    }
    void take(const OnHost& from) {
        if constexpr (X::is_device) {
            const auto bring = [&]<class E>(const Buffer<X, E>& to, const E* numbers) {
                if (numbers) exec_.upload(to.data(), numbers, to.size() * sizeof(E));
            };
            const ElementsView<T, D>& v = from.view;
            bring(rest_cell_, v.rest_cell);
            bring(rest_offset_, v.rest_offset);
            bring(cells_, v.cells);
            bring(beyond_, v.beyond);
            bring(kept_, v.kept);
        }
    }
    /// Of several ranks: what this one works on, and what it tells the others. Null on one.
    MeshShare* share() { return share_.get(); }
    const MeshShare* share() const { return share_.get(); }
    /// Devices of several: what goes between ranks in each step.
    MeshSwap<X, T, D>& swap() { return swap_; }
    /// By the present owners of its vertices.
    void share_among(std::vector<std::int32_t> owner, int rank, int ranks) {
        share_.reset();  // all are listed meanwhile
        auto share = std::make_unique<MeshShare>();
        share->owner = std::move(owner);
        share->list(connected(), rank, ranks);
        pushed_.assign(share->pushed);
        measured_.assign(share->measured);
        pressed_.assign(share->pressed);
        std::vector<std::uint8_t> mine;
        for (const std::uint32_t vertex : pinned_vertex_.host())
            mine.push_back(share->owner[vertex] == rank);
        pinned_mine_.assign(mine);
        share_ = std::move(share);
    }
    /// Whether what counts each element once counts it on this rank.
    bool counts(std::int64_t element, int rank) const {
        return !share_ || share_->owner[std::size_t(connected().number(element, 0))] == rank;
    }
    /// Which vertices elements have, where the host reads it; of the rest it knows what there is.
    ElementsView<T, D> connected() const {
        ElementsView<T, D> v = view();
        if constexpr (X::is_device) {
            v.vertex = host_.vertex.data();
            v.start = host_.start.data();
            v.corner = host_.corner.data();
        }
        return v;
    }
    /// The first element that was turned inside out, or `no_fault`; forgotten with `begin_anew`.
    std::uint64_t inverted() const { return inverted_.host()[0]; }
    void begin_anew() { inverted_.assign({no_fault}); }
    std::size_t bytes() const {
        return vertex_.bytes() + rest_cell_.bytes() + cells_.bytes() + start_.bytes() +
               corner_.bytes() + inverse_.bytes() + volume_.bytes() + force_.bytes() +
               grown_.bytes() + kept_.bytes() + start_stress_.bytes() + rest_offset_.bytes() +
               beyond_.bytes() + moved_.bytes() + vertex_volume_.bytes() + vertex_change_.bytes() +
               pressure_.bytes() + load_.bytes() + vertex_push_.bytes() + pinned_.bytes() +
               held_.bytes() + pinned_mine_.bytes() + pinned_vertex_.bytes() + pin_.bytes() +
               pinned_mass_.bytes() + push_.bytes() + goal_.bytes() + swap_.bytes() +
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
    Buffer<X, ElementForces<T, D>> force_;
    Buffer<X, T> inverse_, volume_, grown_, kept_, start_stress_;
    Buffer<X, T> rest_offset_, beyond_, moved_, vertex_volume_, vertex_change_, pressure_, load_,
        vertex_push_;
    ElementDamping<T> damping_;
    Buffer<X, std::int32_t> pinned_;
    Buffer<X, std::uint32_t> pinned_vertex_;
    Buffer<X, std::int32_t> pin_;
    Buffer<X, std::uint8_t> held_, pinned_mine_;
    Buffer<X, double> pinned_mass_, push_;
    Buffer<X, TimeTableView> goal_;
    TimeTables<ExecutorBase<X>> tables_;
    MeshSwap<X, T, D> swap_;
    ExecutorBase<X>& exec_;
    std::vector<Traction> tractions_;
    std::vector<TimeTableView> goals_;
    struct Connected {  // devices: where the host reads them
        std::vector<std::int32_t> vertex;
        std::vector<std::uint32_t> start, corner;
    } host_;
    Buffer<X, std::uint64_t> inverted_;
    Buffer<X, double> energy_;
    Buffer<X, std::int32_t> pushed_, measured_, pressed_;
    std::unique_ptr<MeshShare> share_;
    std::size_t elements_, vertices_, kept_reals_;
    bool vertex_volumes_;
    std::vector<double> mass_;
};

}  // namespace mpm
