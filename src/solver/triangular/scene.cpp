// From what a caller asks for to functions, laws, a plan, particles and held sides.
#include <algorithm>
#include <cstdio>

#include "mpm/core/error.hpp"
#include "mpm/kernels/model_headers.inc"
#include "mpm/solver/functions_engine.hpp"
#include "mpm/triangular/cubic_powell_sabin.hpp"
#include "mpm/triangular/lagrange.hpp"
#include "mpm/triangular/powell_sabin.hpp"
#include "mpm/triangular/tensor_spline.hpp"

namespace mpm {

using triangular::Point;

std::unique_ptr<triangular::Basis> make_basis(const FunctionsSpec& spec) {
    if (spec.kind == "splines") {
        return std::make_unique<triangular::TensorSpline>(
            triangular::BSpline(spec.knots[0], spec.degrees[0]),
            triangular::BSpline(spec.knots[1], spec.degrees[1]));
    }
    std::vector<std::array<int, 3>> triangles;
    for (std::size_t k = 0; k + 2 < spec.triangles.size(); k += 3)
        triangles.push_back({spec.triangles[k], spec.triangles[k + 1], spec.triangles[k + 2]});
    const auto mesh =
        std::make_shared<const triangular::Mesh>(points_of(spec.vertices), std::move(triangles));
    if (spec.basis == "linear") return std::make_unique<triangular::Lagrange>(mesh, 1);
    if (spec.basis == "lagrange") return std::make_unique<triangular::Lagrange>(mesh, spec.degree);
    if (spec.basis == "powell-sabin")
        return std::make_unique<triangular::PowellSabin>(mesh, points_of(spec.split));
    if (spec.basis == "cubic-powell-sabin")
        return std::make_unique<triangular::CubicPowellSabin>(mesh);
    throw SceneError("basis '" + spec.basis +
                     "' is not built; there are linear, lagrange, powell-sabin and "
                     "cubic-powell-sabin");
}

std::unique_ptr<triangular::Law> make_law(const std::string& material,
                                          const std::vector<double>& parameters) {
#define MPM_MODEL(Model)         \
    if (material == Model::name) \
        return std::make_unique<triangular::LawOf<Model>>(parameters.data());
#include "mpm/kernels/models.inc"
#undef MPM_MODEL
    throw SceneError("material '" + material + "' is not built");
}

Plan plan_functions(const Spec& spec) {
    if (spec.dimension != 2) {
        throw SceneError(
            "grid: functions over triangles and spline grids are built in two "
            "dimensions, dimension is " +
            std::to_string(spec.dimension) + "; use dimension=2");
    }
    check_elements(spec);
    const auto basis = make_basis(spec.functions);
    Plan plan;
    plan.on_functions = true;
    plan.channels = {"mass (" + spec.functions.mass + ")", "force", "momentum"};
    std::size_t couplings = 0;
    for (int c = 0; c < basis->cells(); ++c)
        couplings += basis->on_cell(c).size() * basis->on_cell(c).size();
    // Cell matrices twice, where they go, the sparse matrix and what its pattern is made of; its
    // factor; the mesh and the functions' numbers; force, momentum, acceleration, velocity.
    const FunctionsSpec& f = spec.functions;
    const double factor = f.mass == "lumped"         ? 0
                          : f.mass == "partial-rows" ? 150
                          : f.solver == "direct"     ? 50
                                                     : 0;
    plan.memory_grid = double(couplings) * ((f.mass == "lumped" ? 40 : 110) + factor) +
                       double(basis->cells()) * 1000 + double(basis->functions()) * 16 * 4;
    plan.bytes_per_node = int(plan.memory_grid / double(basis->functions()));
    for (const auto& b : spec.bodies) {
        const MaterialInfo& m = material(b.material);
        BodyPlan p;
        p.name = b.name;
        p.particles = b.count;
        p.pipeline_reason = "functions over cells, sums and solves twice a step";
        const int reals = m.reals(2);
        const auto column = [&](const char* name, int count) {
            p.columns.push_back({name, count, 8 * count});
        };
        column("id", 1);
        column("position", 2);
        column("velocity", 2);
        column("displacement", 2);
        column("mass", 1);
        column("volume", 1);
        column("state", reals);
        column("stress", 3);
        column("velocity_gradient", 4);
        p.bytes_per_particle = int(triangular::Method::bytes_per_particle(*basis, reals));
        p.state_columns = reals;
        p.spacing = b.count ? std::sqrt(b.particle_mass / m.density(b.parameters.data())) : 0;
        plan.memory_particles += double(b.count) * p.bytes_per_particle;
        const double c = m.wave_speed(b.parameters.data());
        if (c > plan.wave_speed) {
            plan.wave_speed = c;
            char text[64];
            std::snprintf(text, sizeof text, "%.4g m/s", c);
            plan.limited_by = "body '" + b.name + "': wave speed " + text;
        }
        plan.bodies.push_back(std::move(p));
    }
    // 2 / omega_max in parts of h / c, about: digest 3.6 and measured; the engine finds the scene's
    // own.
    const int degree = std::max(1, basis->degree());
    const double part = (degree == 1   ? 0.28
                         : degree == 2 ? 0.2
                         : degree < 5  ? 0.1
                                       : 0.05) *
                        (spec.functions.mass == "lumped" ? 2.5 : 1.0);
    plan.time_step = plan.wave_speed > 0 ? spec.cfl * part * basis->spacing() / plan.wave_speed : 0;
    if (spec.time_step > 0) {
        plan.time_step = spec.time_step;
        plan.limited_by = "given by the caller";
    } else {
        plan.limited_by += " (estimate; the run measures the largest frequency)";
    }
    plan.kernels = {"locate", "assemble", "factorise"};
    for (const auto& s : spec.sensors) plan.kernels.push_back("sample:" + s.name);
    for (const char* k : {"accelerations", "velocities", "momentum", "strain and stress"})
        plan.kernels.push_back(k);
    return plan;
}

Point table_at(const TableSpec& t, double time) {
    double out[2];
    TimeTableView{t.time.data(), t.value.data(), std::int32_t(t.time.size()), 2, t.end}.at(time,
                                                                                           out);
    return {out[0], out[1]};
}

void FunctionsEngine::place_body(const BodySpec& b) {
    const MaterialInfo& info = material(b.material);
    triangular::Particles body;
    body.name = b.name;
    body.law = make_law(b.material, b.parameters);
    const std::size_t n = b.count, reals = std::size_t(body.law->reals());
    std::vector<double> row(2 * n);
    b.position(0, n, row.data());
    const bool each = b.velocity.size() == 2 * n && n != 1;
    const double density = info.density(b.parameters.data());
    for (std::size_t p = 0; p < n; ++p) {
        body.id.push_back(b.first_id + p);
        body.position.emplace_back(row[2 * p], row[2 * p + 1]);
        const std::size_t v = each ? 2 * p : 0;
        body.velocity.emplace_back(b.velocity[v], b.velocity[v + 1]);
    }
    body.displacement.assign(n, Point(0, 0));
    body.volume.assign(n, b.particle_mass / density);
    if (b.volume) b.volume(0, n, body.volume.data());
    for (double v : body.volume) body.mass.push_back(v * density);
    body.state.assign(n * reals, 0.0);
    if (b.pressure) {
        std::vector<double> pressure(n);
        b.pressure(0, n, pressure.data());
        for (std::size_t p = 0; p < n; ++p)
            body.state[p * reals] = info.volume_from_pressure(pressure[p], b.parameters.data());
    }
    if (b.stress) {
        std::vector<double> stress(4 * n);
        b.stress(0, n, stress.data());
        for (std::size_t p = 0; p < n; ++p)
            std::copy_n(stress.begin() + std::ptrdiff_t(4 * p), 4,
                        body.state.begin() + std::ptrdiff_t(p * reals));
    }
    for (const TractionSpec& t : b.tractions) {
        triangular::Traction pull;
        pull.particles.assign(t.particles.begin(), t.particles.end());
        pull.length = t.length;
        pull.value = [table = t.value](double time) { return table_at(table, time); };
        body.tractions.push_back(std::move(pull));
    }
    method_.bodies().push_back(std::move(body));
}

// Outer edges that belong to each face of the domain, or lie on the segments of an outline
// boundary.
void FunctionsEngine::find_parts() {
    const auto& basis = method_.basis();
    const auto& outline = basis.outline();
    const double near = 1e-6 * basis.spacing();  // vertices of files are rounded
    for (std::size_t b = 0; b < spec_.boundaries.size(); ++b) {
        const BoundarySpec& boundary = spec_.boundaries[b];
        if (boundary.is_box) {
            throw SceneError("boundary '" + boundary.name +
                             "': a box cannot lie in a grid of functions; cut it out of the mesh "
                             "and hold that part of the outline");
        }
        const auto add = [&](int face, const std::string& what, const auto& belongs) {
            const SurfaceLaw& law = boundary.law[std::size_t(face)];
            if (law.response == Response::separable) {
                throw SceneError("boundary '" + boundary.name +
                                 "': a separable response is not built for grids of functions; use "
                                 "Sticky() or Slip()");
            }
            HeldPart part{int(b), face, {{}, law.response == Response::slip}};
            double length = 0;
            for (std::size_t e = 0; e < outline.size(); ++e) {
                if (!belongs(outline[e])) continue;
                part.hold.edges.push_back(int(e));
                length += (outline[e].end - outline[e].start).norm();
            }
            if (part.hold.edges.empty()) {
                throw SceneError("boundary '" + boundary.name +
                                 "': no edge of the grid's outline " + "lies on " + what +
                                 "; check its coordinates against the mesh, " +
                                 "or name the sides that there are with DomainWalls(faces=...)");
            }
            parts_.push_back(std::move(part));
            return length;
        };
        if (!boundary.segments.empty()) {
            double wanted = 0;
            const auto segment = [&](std::size_t s) {
                return std::pair(Point(boundary.segments[s], boundary.segments[s + 1]),
                                 Point(boundary.segments[s + 2], boundary.segments[s + 3]));
            };
            for (std::size_t s = 0; s + 3 < boundary.segments.size(); s += 4)
                wanted += (segment(s).second - segment(s).first).norm();
            const double found = add(0, "it", [&](const triangular::OuterEdge& e) {
                for (std::size_t s = 0; s + 3 < boundary.segments.size(); s += 4) {
                    const auto [from, to] = segment(s);
                    const Point along = (to - from).normalized();
                    const auto on = [&](const Point& x) {
                        const double at = (x - from).dot(along);
                        return std::abs(triangular::cross(along, x - from)) < near && at > -near &&
                               at < (to - from).norm() + near;
                    };
                    if (on(e.start) && on(e.end)) return true;
                }
                return false;
            });
            if (std::abs(found - wanted) > 1e-6 * wanted) {
                throw SceneError("boundary '" + boundary.name +
                                 "': edges of the grid's outline lie "
                                 "on " +
                                 std::to_string(found) + " m of its " + std::to_string(wanted) +
                                 " m; give it corners that are vertices of the outline");
            }
            continue;
        }
        for (int face = 0; face < 4; ++face) {
            if (!boundary.present[std::size_t(face)]) continue;
            const Eigen::Index axis = face / 2;
            const double at = face % 2 ? basis.upper()[axis] : basis.lower()[axis];
            const std::string name = std::string(face / 2 ? "y" : "x") + (face % 2 ? "+" : "-");
            add(face, "face " + name, [&](const triangular::OuterEdge& e) {
                return std::abs(e.start[axis] - at) < near && std::abs(e.end[axis] - at) < near;
            });
        }
    }
}

}  // namespace mpm
