// Domain: bodies of elements. Their vertices are particles of the phased step, stored, sorted and
// saved as such; here is what is by number of vertex and of element (design/elements.md).
#pragma once

#include "mpm/kernels/pinned_vertices.hpp"
#include "mpm/kernels/placing.hpp"
#include "mpm/solver/domain.hpp"

namespace mpm {

template <class X, class T, int D>
void Domain<X, T, D>::make_mesh(Body& body, const BodySpec& s) {
    const std::uint64_t vertices = ids_of(s);
    std::vector<double> position(std::size_t(vertices) * D);
    (s.all_vertices ? s.all_vertices : s.position)(0, vertices, position.data());
    body.elements = element_ops<X, T, D>(s.material);
    body.mesh = std::make_unique<ElementMesh<X, T, D>>(
        exec_, s.name, position, s.elements, s.vertex_volumes, body.elements.kept, spec_.cell_size,
        body.material->density(s.parameters.data()));
    body.mesh->stress(s.element_stress);
    body.mesh->pin(s.pins);
    body.mesh->load_by(s.tractions);
    if (s.damping > 0) {
        const double* p = s.parameters.data();
        const double density = body.material->density(p), l = 2 * spec_.cell_size * s.damping;
        body.mesh->damp(l * density * body.material->wave_speed(p),
                        l * std::sqrt(density * body.material->shear_modulus(p)));
    }
    body.ops = vertex_ops<X, T, D>();
}

/// Once particles are in their cells: these are the vertices' places at rest. The share of its
/// mass is what a vertex stores.
template <class X, class T, int D>
void Domain<X, T, D>::place_mesh(Body& body) {
    std::vector<T> share;
    for (const double mass : body.mesh->mass()) share.push_back(T(mass / body.particle_mass));
    Buffer<X, T> by_number(exec_);
    by_number.assign(share);
    exec_.for_each(body.count, Take<T>{body.id.data(), by_number.data(), body.state[0].data()});
    body.elements.locate(pass(body, int(&body - bodies_.data()), parity()), body.mesh->view(),
                         true);
    exec_.wait();
    if (share_) tell_rest(body);
}

/// All vertices move before anyone asks where they are: those of other ranks too.
template <class X, class T, int D>
void Domain<X, T, D>::move_vertices(const std::vector<std::size_t>& moving) {
    if (!has_meshes()) return;
    for (const std::size_t b : moving) {
        Body& body = bodies_[b];
        if (!body.mesh) continue;
        Phase<X, T, D> p = phase(body, int(b), 1 - parity());
        p.turns = true;
        pin_vertices(body, p);
        body.ops.respond(p);
        after_respond(body, p);
        body.elements.locate(p.pass, body.mesh->view(), false);
    }
    if (share_) swap_places();
    for (const std::size_t b : moving) {
        Body& body = bodies_[b];
        if (body.mesh && body.mesh->vertex_volumes())
            body.elements.volumes(pass(body, int(b), 1 - parity()), body.mesh->view());
    }
}

/// Where vertices are now, by number, and what volumes of vertices follow from it.
template <class X, class T, int D>
void Domain<X, T, D>::locate_elements(Body& body, int number) {
    const Pass<X, T, D> p = pass(body, number, parity());
    body.elements.locate(p, body.mesh->view(), false);
    if (body.mesh->vertex_volumes()) body.elements.volumes(p, body.mesh->view());
}

/// What tractions push vertices by now, or at the end of the step.
template <class X, class T, int D>
void Domain<X, T, D>::load_elements(Body& body, bool ahead) {
    T* load = body.mesh->view().load;
    if (!load) return;
    exec_.for_each(std::int64_t(body.mesh->vertices()) * D, Constant<T>{T(0), load});
    for (const auto& t : body.mesh->tractions())
        exec_.for_each(std::int64_t(t.vertex.size()),
                       AddTraction<T, D>{t.value, t.vertex.data(), t.area.data(), spec_.cell_size,
                                         clock_buffer_.data(), ahead, load});
}

/// The forces of elements where their vertices are; the first that has turned inside out is kept,
/// and halts the coming step. Devices report it as they spread its vertices.
template <class X, class T, int D>
void Domain<X, T, D>::push_elements(const Phase<X, T, D>& phase, Body& body, bool ahead) {
    load_elements(body, ahead);
    body.elements.forces(phase.pass, body.mesh->view());
    if constexpr (!X::is_device) {
        const std::uint64_t inverted = body.mesh->inverted();
        if (inverted == no_fault) return;
        // Reported by the first of its vertices that is here.
        const ElementsView<T, D> mesh = body.mesh->view();
        const std::uint32_t* id = body.id.data();
        std::uint32_t place = body.count;
        for (int k = 0; k <= D && place == body.count; ++k)
            place = std::uint32_t(std::find(id, id + body.count,
                                            std::uint32_t(mesh.number(std::int64_t(inverted), k))) -
                                  id);
        X::keep_smallest(phase.pass.fault_particle, fault_number(phase.pass.body_number, place));
    }
}

/// What a body's particles have in scratch, or vertices with the forces of their elements, which
/// act from the end of the step on, or from now.
template <class X, class T, int D>
void Domain<X, T, D>::spread_body(Body& body, const Phase<X, T, D>& phase, bool ahead) {
    if (!body.mesh) {
        phase_ops_.spread(phase);
        return;
    }
    push_elements(phase, body, ahead);
    bear_pull(body, phase);
    const ElementsView<T, D> mesh = body.mesh->view();
    // The last to spread turns the clock.
    if (contact_blocks_ > 0 && plan_.filled >= 0)
        body.elements.fill(phase, mesh, near_contact_.data(), plan_.filled);
    body.elements.spread(phase, mesh);
}

/// Attributes of elements, and of vertices what follows from theirs: means weighted by volume, and
/// a share of each element's volume and energy. Of several ranks one has an element; on the others
/// it is not a number.
template <class X, class T, int D>
void Domain<X, T, D>::see_elements(Body& body, int number, const std::vector<std::string>& names,
                                   Attributes& out) {
    const auto follows = [](const std::string& name) {
        for (const char* own : {"mass", "volume", "volume_ratio", "density", "pressure", "stress",
                                "elastic_energy", "kinetic_energy", "plastic_strain"})
            if (name == own) return true;
        return is_of_elements(name);
    };
    if (std::none_of(names.begin(), names.end(), follows)) return;
    locate_elements(body, number);
    const auto on_host = body.mesh->on_host();
    const ElementsView<T, D>& mesh = on_host.view;
    const std::size_t elements = body.mesh->elements(), n = body.count;
    std::vector<ElementSeen<D>> seen(elements);
    exec_.host_for(mesh.pushed.count, [&](std::int64_t k) {
        const std::int64_t e = mesh.pushed[k];
        seen[std::size_t(e)] = body.elements.see(mesh, e, body.parameters.data());
    });
    const int rank = share_ ? share_->rank() : 0;
    const auto put = [&](const std::string& name, std::size_t rows, std::vector<std::size_t> shape,
                         const auto& value) {
        if (std::find(names.begin(), names.end(), name) == names.end()) return;
        Array& a = out.values[name];
        std::size_t width = 1;
        for (const std::size_t k : shape) width *= k;
        a.shape = {rows};
        a.shape.insert(a.shape.end(), shape.begin(), shape.end());
        a.data.assign(rows * width, 0.0);
        const bool of_elements = is_of_elements(name);
        for (std::size_t k = 0; k < rows; ++k) {
            double* to = a.data.data() + k * width;
            if (of_elements && !body.mesh->counts(std::int64_t(k), rank))
                std::fill_n(to, width, std::numeric_limits<double>::quiet_NaN());
            else
                value(k, to);
        }
    };
    const std::vector<std::size_t> square = {std::size_t(D), std::size_t(D)};
    put("element_stress", elements, square, [&](std::size_t e, double* to) {
        for (int k = 0; k < D * D; ++k) to[k] = seen[e].stress[k / D][k % D];
    });
    put("element_pressure", elements, {},
        [&](std::size_t e, double* to) { *to = seen[e].pressure; });
    put("element_volume_ratio", elements, {},
        [&](std::size_t e, double* to) { *to = seen[e].volume_ratio; });
    put("element_energy", elements, {}, [&](std::size_t e, double* to) { *to = seen[e].energy; });
    put("element_plastic_strain", elements, {},
        [&](std::size_t e, double* to) { *to = seen[e].plastic_strain; });

    const std::vector<std::uint32_t> id = body.id.host(n);
    // Sum over the elements of the vertex in row k, each with its part of the volume.
    const auto sum = [&](std::size_t k, const auto& of) {
        double all = 0;
        for (std::uint32_t c = mesh.start[id[k]]; c < mesh.start[id[k] + 1]; ++c) {
            const std::size_t e = mesh.corner[c] / (D + 1);
            all += double(mesh.volume[e]) / (D + 1) * of(seen[e]);
        }
        return all;
    };
    const auto rest = [&](std::size_t k) {
        return sum(k, [](const ElementSeen<D>&) { return 1.0; });
    };
    const auto volume = [&](std::size_t k) {
        return sum(k, [](const ElementSeen<D>& s) { return s.volume_ratio; });
    };
    const std::vector<double>& mass = body.mesh->mass();
    put("mass", n, {}, [&](std::size_t k, double* to) { *to = mass[id[k]]; });
    put("volume", n, {}, [&](std::size_t k, double* to) { *to = volume(k); });
    put("volume_ratio", n, {}, [&](std::size_t k, double* to) { *to = volume(k) / rest(k); });
    put("density", n, {}, [&](std::size_t k, double* to) { *to = mass[id[k]] / volume(k); });
    put("pressure", n, {}, [&](std::size_t k, double* to) {
        *to = sum(k, [](const ElementSeen<D>& s) { return s.pressure; }) / rest(k);
    });
    put("stress", n, square, [&](std::size_t k, double* to) {
        for (int i = 0; i < D * D; ++i)
            to[i] =
                sum(k, [&](const ElementSeen<D>& s) { return s.stress[i / D][i % D]; }) / rest(k);
    });
    put("plastic_strain", n, {}, [&](std::size_t k, double* to) {
        *to = sum(k, [](const ElementSeen<D>& s) { return s.plastic_strain; }) / rest(k);
    });
    put("elastic_energy", n, {}, [&](std::size_t k, double* to) {
        *to = 0;
        for (std::uint32_t c = mesh.start[id[k]]; c < mesh.start[id[k] + 1]; ++c)
            *to += seen[mesh.corner[c] / (D + 1)].energy / (D + 1);
    });
    const auto kinetic = out.values.find("kinetic_energy");
    for (std::size_t k = 0; kinetic != out.values.end() && k < n; ++k)
        kinetic->second.data[k] *= mass[id[k]] / body.particle_mass;
}

/// Of all elements, by their volume. Of several ranks what gives that when it is weighted by their
/// vertices: each has the elements that it counts.
template <class X, class T, int D>
double Domain<X, T, D>::mean_volume_ratio(Body& body, int number) {
    double now = 0, rest = 0;
    locate_elements(body, number);
    const auto on_host = body.mesh->on_host();
    const ElementsView<T, D>& mesh = on_host.view;
    const int rank = share_ ? share_->rank() : 0;
    for (std::int64_t e = 0; e < mesh.elements; ++e) {
        const double v = double(mesh.volume[e]);
        rest += v;
        if (!body.mesh->counts(e, rank)) continue;
        now +=
            v *
            (1 + volume_change(element_state<double>(mesh, element_inverse<double>(mesh, e), e)));
    }
    if (share_) now *= double(mesh.vertices) / double(body.count);
    return now / rest;
}

/// What elements keep of flow: of several ranks, of those that this one counts.
template <class X, class T, int D>
std::vector<T> Domain<X, T, D>::kept_here(const Body& body) const {
    std::vector<T> out = body.mesh->kept_numbers();
    const std::size_t width = body.mesh->kept();
    for (std::size_t e = 0; share_ && e < body.mesh->elements(); ++e)
        if (!body.mesh->counts(std::int64_t(e), share_->rank()))
            std::fill_n(out.begin() + std::ptrdiff_t(e * width), width,
                        std::numeric_limits<T>::quiet_NaN());
    return out;
}

/// What `describe_fault` has said of the vertex that the fault was reported by, said of the
/// element.
template <class X, class T, int D>
Fault Domain<X, T, D>::describe_element(Body& body, Fault fault) {
    const auto on_host = body.mesh->on_host();
    const ElementsView<T, D>& mesh = on_host.view;
    const auto e = std::int64_t(body.mesh->inverted());
    const double ratio =
        1 + volume_change(element_state<double>(mesh, element_inverse<double>(mesh, e), e));
    fault.ids.clear();
    for (int k = 0; k <= D; ++k)
        fault.ids.push_back(body.first_id + std::uint64_t(mesh.number(e, k)));
    fault.element = e;
    fault.value = ratio;
    fault.code = !std::isfinite(ratio)         ? "non-finite"
                 : ratio > least_element_ratio ? "element-range"
                                               : "inverted-element";
    name_element(fault, body.first_id);
    return fault;
}

}  // namespace mpm
