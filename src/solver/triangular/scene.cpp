// From what a caller asks for to functions, laws and a plan.
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

namespace {

std::vector<Point> points_of(const std::vector<double>& numbers) {
    std::vector<Point> out;
    for (std::size_t k = 0; k + 1 < numbers.size(); k += 2)
        out.emplace_back(numbers[k], numbers[k + 1]);
    return out;
}

}  // namespace

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
    const auto basis = make_basis(spec.functions);
    Plan plan;
    plan.on_functions = true;
    plan.fused = false;
    plan.channels = {"mass (" + spec.functions.mass + ")", "force", "momentum"};
    plan.pipeline_reason = "functions over cells, sums and solves twice a step";
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

}  // namespace mpm
