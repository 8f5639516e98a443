#include "mpm/triangular/method.hpp"

#include <Eigen/Eigenvalues>
#include <algorithm>
#include <cmath>
#include <numeric>
#include <random>

#include "mpm/core/error.hpp"

namespace mpm::triangular {

namespace {

/// Particles from which on threads pay: with two of them a step of 9,600 particles took 4.3 ms
/// instead of 2.2, one of 38,400 took 7.7 instead of 12.9.
constexpr std::size_t worth_threads = 20000;

/// Coefficient of a function in both components.
Point coefficient(const Eigen::VectorXd& field, int function) {
    return {field[2 * function], field[2 * function + 1]};
}

/// The mass matrix is the grid's as a whole, no body's.
Trouble unsolved(double value, const char* what) {
    return {"singular-mass", -1, {}, value, 0, what};
}

}  // namespace

void Particles::take(const std::vector<std::size_t>& places) {
    const auto gather = [&](auto& column, std::size_t width) {
        std::remove_reference_t<decltype(column)> taken;
        taken.reserve(places.size() * width);
        for (std::size_t p : places)
            for (std::size_t k = 0; k < width; ++k) taken.push_back(column[p * width + k]);
        column = std::move(taken);
    };
    std::vector<std::size_t> now(count(), count());  // count() for those that go
    for (std::size_t k = 0; k < places.size(); ++k) now[places[k]] = k;
    for (Traction& t : tractions) {
        std::vector<std::size_t> left;
        for (std::size_t p : t.particles)
            if (now[p] < now.size()) left.push_back(now[p]);
        t.particles = left;
    }
    gather(state, std::size_t(law->reals()));
    gather(id, 1);
    gather(position, 1);
    gather(velocity, 1);
    gather(displacement, 1);
    gather(mass, 1);
    gather(volume, 1);
    gather(stress, 1);
    gather(rate, 1);
    gather(cell, 1);
    by_id_.clear();
}

void Particles::erase(const std::vector<std::size_t>& gone) {
    if (gone.empty()) return;
    std::vector<std::size_t> kept;
    auto next = gone.begin();
    for (std::size_t p = 0; p < count(); ++p) {
        if (next != gone.end() && *next == p)
            ++next;
        else
            kept.push_back(p);
    }
    take(kept);
}

std::size_t Particles::place_of(std::uint64_t sought) const {
    if (by_id_.size() != count()) {
        by_id_.resize(count());
        std::iota(by_id_.begin(), by_id_.end(), std::size_t(0));
        std::sort(by_id_.begin(), by_id_.end(),
                  [&](std::size_t a, std::size_t b) { return id[a] < id[b]; });
    }
    const auto at = std::lower_bound(by_id_.begin(), by_id_.end(), sought,
                                     [&](std::size_t p, std::uint64_t x) { return id[p] < x; });
    return at == by_id_.end() || id[*at] != sought ? count() : *at;
}

Method::Method(std::unique_ptr<Basis> basis, const MassOptions& mass, int threads)
    : exec_(threads), basis_(std::move(basis)), mass_(*basis_, mass, exec_), sums_(*basis_) {
    width_ = basis_->widest();
    filled_.assign(std::size_t(basis_->cells()), 0);
    local_.assign(std::size_t(basis_->cells()) * width_ * 2, 0.0);
    control_ = basis_->control_points();
    // The solvers' own threads would pay at sizes that no plane scene has, and change bits.
    Eigen::setNbThreads(1);
}

void Method::hold(const std::vector<Hold>& holds) {
    auto next = std::make_unique<Constraints>(*basis_, holds);
    mass_.constrain(*next);
    constraints_ = std::move(next);
    impulses_.resize(holds.size(), {0, 0, 0});
    search_.resize(0);
}

void Method::start() {
    stiffness_.clear();
    for (Particles& b : bodies_) {
        const std::size_t n = b.count();
        b.stress.resize(n);
        b.rate.assign(n, Tensor{});
        b.cell.resize(n, -1);
        for (std::size_t p = 0; p < n; ++p) {
            const Tensor tau = b.law->stress(b.state_of(p));
            b.stress[p] = {tau.e[0][0], tau.e[1][1], tau.e[0][1]};
        }
        const auto e = b.law->elasticity();
        const double along = e.lame + 2 * e.shear;
        stiffness_.push_back({along, e.lame, 0, e.lame, along, 0, 0, 0, e.shear});
    }
    if (!constraints_) hold({});
}

void Method::sort_by_cell() {
    for (Particles& b : bodies_) {
        std::vector<std::size_t> places(b.count());
        std::iota(places.begin(), places.end(), std::size_t(0));
        std::stable_sort(places.begin(), places.end(),
                         [&](std::size_t p, std::size_t q) { return b.cell[p] < b.cell[q]; });
        b.take(places);
    }
}

void Method::remember_filled() {
    std::fill(filled_.begin(), filled_.end(), char(0));
    for (const Particles& b : bodies_)
        for (int c : b.cell)
            if (c >= 0 && std::size_t(c) < filled_.size()) filled_[std::size_t(c)] = 1;
}

std::vector<std::vector<std::size_t>> Method::relocate() {
    std::vector<std::vector<std::size_t>> out;
    for (Particles& b : bodies_) {
        exec_.for_each(std::int64_t(b.count()), [&](std::int64_t i) {
            const auto p = std::size_t(i);
            b.cell[p] = basis_->locate(b.position[p], b.cell[p]);
        });
        out.emplace_back();
        for (std::size_t p = 0; p < b.count(); ++p)
            if (b.cell[p] < 0) out.back().push_back(p);
    }
    return out;
}

// In the order of bodies and ids within a cell, so that sums do not depend on threads.
void Method::list_particles() {
    const auto cells = std::size_t(basis_->cells());
    first_of_body_.assign(1, 0);
    cell_start_.assign(cells + 1, 0);
    for (const Particles& b : bodies_) {
        first_of_body_.push_back(first_of_body_.back() + b.count());
        for (int c : b.cell) ++cell_start_[std::size_t(c) + 1];
    }
    cells_changed_ = false;
    for (std::size_t c = 0; c < cells; ++c) {
        const bool filled = cell_start_[c + 1] > 0;
        cells_changed_ = cells_changed_ || filled != bool(filled_[c]);
        filled_[c] = filled;
        cell_start_[c + 1] += cell_start_[c];
    }
    listed_.resize(first_of_body_.back());
    std::vector<std::size_t> next(cell_start_.begin(), cell_start_.end() - 1);
    for (std::size_t b = 0; b < bodies_.size(); ++b)
        for (std::size_t p = 0; p < bodies_[b].count(); ++p)
            listed_[next[std::size_t(bodies_[b].cell[p])]++] = first_of_body_[b] + p;
    value_.resize(listed_.size() * width_);
    gradient_.resize(listed_.size() * width_);
}

/// f(cell); threads only where they are worth their waking.
template <class F>
void Method::each_cell(const F& f) {
    const bool few = listed_.size() < worth_threads;
    (few ? alone_ : exec_).for_each_large(basis_->cells(), [&](std::int64_t c) { f(int(c)); });
}

/// f(body, particle, place of its values and gradients)
template <class F>
void Method::each_particle(int cell, const F& f) const {
    std::size_t body = 0;
    for (std::size_t k = cell_start_[std::size_t(cell)]; k < cell_start_[std::size_t(cell) + 1];
         ++k) {
        const std::size_t all = listed_[k];
        while (all >= first_of_body_[body + 1]) ++body;
        f(body, all - first_of_body_[body], k * width_);
    }
}

void Method::collect(Eigen::VectorXd& out) const {
    out.setZero(2 * basis_->functions());
    for (int c = 0; c < basis_->cells(); ++c) {
        if (!filled_[std::size_t(c)]) continue;
        const auto& on = basis_->on_cell(c);
        const double* local = local_.data() + std::size_t(c) * width_ * 2;
        for (std::size_t i = 0; i < on.size(); ++i)
            for (std::size_t k = 0; k < 2; ++k)
                out[2 * on[i] + Eigen::Index(k)] += local[2 * i + k];
    }
}

/// out = what f(sums of the cell, its functions, body, particle, place of its values and gradients)
/// adds up over all particles, two numbers a function.
template <class F>
void Method::sum(Eigen::VectorXd& out, const F& f) {
    each_cell([&](int cell) {
        const auto& on = basis_->on_cell(cell);
        double* sums = local_.data() + std::size_t(cell) * width_ * 2;
        std::fill(sums, sums + 2 * on.size(), 0.0);
        each_particle(cell,
                      [&](std::size_t b, std::size_t p, std::size_t at) { f(sums, on, b, p, at); });
    });
    collect(out);
}

/// Adds a particle's momentum to a cell's sums.
void Method::deposit(double* sums, const std::vector<int>& on, std::size_t b, std::size_t p,
                     std::size_t at) const {
    const Point momentum = bodies_[b].mass[p] * bodies_[b].velocity[p];
    for (std::size_t i = 0; i < on.size(); ++i) {
        sums[2 * i] += value_[at + i] * momentum[0];
        sums[2 * i + 1] += value_[at + i] * momentum[1];
    }
}

std::optional<Trouble> Method::prepare(double time, const Point& gravity) {
    list_particles();
    std::vector<std::vector<Point>> pull(bodies_.size());
    for (std::size_t b = 0; b < bodies_.size(); ++b) {
        if (bodies_[b].tractions.empty()) continue;
        pull[b].assign(bodies_[b].count(), Point(0, 0));
        for (const Traction& t : bodies_[b].tractions) {
            const Point force = t.length * t.value(time);
            for (std::size_t p : t.particles) pull[b][p] += force;
        }
    }
    each_cell([&](int cell) {
        const std::size_t n = basis_->on_cell(cell).size();
        double* m = sums_.of(cell);
        double* f = local_.data() + std::size_t(cell) * width_ * 2;
        std::fill(m, m + n * n, 0.0);
        std::fill(f, f + 2 * n, 0.0);
        each_particle(cell, [&](std::size_t b, std::size_t p, std::size_t at) {
            const Particles& body = bodies_[b];
            double* phi = value_.data() + at;
            Point* grad = gradient_.data() + at;
            basis_->evaluate(cell, body.position[p], phi, grad);
            const auto& tau = body.stress[p];
            Point outer = body.mass[p] * gravity;
            if (!pull[b].empty()) outer += pull[b][p];
            const double v = body.volume[p];
            for (std::size_t i = 0; i < n; ++i) {
                const double weighted = body.mass[p] * phi[i];
                for (std::size_t j = 0; j < n; ++j) m[i * n + j] += weighted * phi[j];
                f[2 * i] += phi[i] * outer[0] - v * (grad[i][0] * tau[0] + grad[i][1] * tau[2]);
                f[2 * i + 1] += phi[i] * outer[1] - v * (grad[i][0] * tau[2] + grad[i][1] * tau[1]);
            }
        });
    });
    collect(force_);
    if (!mass_.assemble(sums_, filled_)) {
        return unsolved(mass_.smallest_mass(), "the mass matrix could not be factorised");
    }
    return std::nullopt;
}

std::optional<Trouble> Method::step(double dt, const Surroundings& around) {
    Eigen::VectorXd given;
    constraints_->given(around.hold_acceleration, given);
    if (!mass_.solve(force_, given, acceleration_)) {
        return unsolved(mass_.iterations(), "the solver for accelerations did not converge");
    }
    if (loads_) {
        // What the holds add to the balance M a = F; the opposite is what they feel.
        const Eigen::VectorXd reaction = mass_.times(acceleration_) - force_;
        for (Eigen::Index i = 0; i < reaction.size(); ++i) {
            const int h = constraints_->holder(int(i));
            if (h < 0) continue;
            const double impulse = -dt * reaction[i];
            auto& sum = impulses_[std::size_t(h)];
            const Point& q = control_[std::size_t(i / 2)];
            sum[std::size_t(i % 2)] += impulse;
            sum[2] += i % 2 == 0 ? -q[1] * impulse : q[0] * impulse;
        }
    }
    // Velocities, and the momentum that they project to.
    Eigen::VectorXd momentum;
    sum(momentum, [&](double* sums, const auto& on, std::size_t b, std::size_t p, std::size_t at) {
        Point gain(0, 0);
        for (std::size_t i = 0; i < on.size(); ++i)
            gain += value_[at + i] * coefficient(acceleration_, on[i]);
        bodies_[b].velocity[p] += dt * gain;
        deposit(sums, on, b, p, at);
    });
    constraints_->given(around.hold_velocity, given);
    if (!mass_.solve(momentum, given, velocity_)) {
        return unsolved(mass_.iterations(), "the solver for velocities did not converge");
    }
    each_cell([&](int cell) {
        const auto& on = basis_->on_cell(cell);
        each_particle(cell, [&](std::size_t b, std::size_t p, std::size_t at) {
            Particles& body = bodies_[b];
            Point v(0, 0);
            Tensor rate{}, strain;
            for (std::size_t i = 0; i < on.size(); ++i) {
                const Point node = coefficient(velocity_, on[i]);
                const Point& g = gradient_[at + i];
                v += value_[at + i] * node;
                for (int k = 0; k < 2; ++k)
                    for (int l = 0; l < 2; ++l) rate.e[k][l] += node[k] * g[l];
            }
            for (int k = 0; k < 2; ++k)
                for (int l = 0; l < 2; ++l) strain.e[k][l] = dt * rate.e[k][l];
            const Tensor tau = body.law->respond(body.state_of(p), strain, rate);
            body.stress[p] = {tau.e[0][0], tau.e[1][1], tau.e[0][1]};
            body.rate[p] = rate;
            body.position[p] += dt * v;
            body.displacement[p] += dt * v;
        });
    });
    return check();
}

std::optional<Trouble> Method::check() const {
    for (std::size_t b = 0; b < bodies_.size(); ++b) {
        const Particles& body = bodies_[b];
        Trouble trouble;
        for (std::size_t p = 0; p < body.count(); ++p) {
            const bool finite = body.position[p].allFinite() && body.velocity[p].allFinite();
            if (finite && body.law->admissible(body.state_of(p))) continue;
            if (trouble.ids.empty()) {
                trouble.code = finite ? "inverted" : "non-finite";
                trouble.body = int(b);
                trouble.speed = body.velocity[p].norm();
            }
            trouble.ids.push_back(body.id[p]);
        }
        if (!trouble.ids.empty()) return trouble;
    }
    return std::nullopt;
}

// What the internal forces change by when particles are displaced by a field, at rest stiffness.
void Method::stiffness_times(const Eigen::VectorXd& field, Eigen::VectorXd& out) {
    sum(out, [&](double* sums, const auto& on, std::size_t b, std::size_t p, std::size_t at) {
        double e[3] = {};
        for (std::size_t i = 0; i < on.size(); ++i) {
            const Point& g = gradient_[at + i];
            const Point node = coefficient(field, on[i]);
            e[0] += node[0] * g[0];
            e[1] += node[1] * g[1];
            e[2] += node[0] * g[1] + node[1] * g[0];
        }
        const auto& d = stiffness_[b];
        double s[3];
        for (std::size_t k = 0; k < 3; ++k)
            s[k] = bodies_[b].volume[p] *
                   (d[3 * k] * e[0] + d[3 * k + 1] * e[1] + d[3 * k + 2] * e[2]);
        for (std::size_t i = 0; i < on.size(); ++i) {
            const Point& g = gradient_[at + i];
            sums[2 * i] += g[0] * s[0] + g[1] * s[2];
            sums[2 * i + 1] += g[0] * s[2] + g[1] * s[1];
        }
    });
}

// Lanczos on M^-1 K in the inner product of M, restarted from the largest Ritz vector. Where the
// matrix is not symmetric its symmetric use still finds the largest eigenvalue closely, as the rows
// that differ are few.
double Method::stable_step(bool thorough) {
    const Eigen::Index n = 2 * basis_->functions();
    const Eigen::VectorXd nothing = Eigen::VectorXd::Zero(n);
    Eigen::VectorXd w, anything(n);
    std::mt19937_64 random(20180701);
    std::uniform_real_distribution<double> uniform(-1, 1);
    for (double& x : anything) x = uniform(random);
    if (thorough || search_.size() != n) {
        search_ = anything;
    } else {
        // The last vector knows nothing of what it does not couple to, such as another body.
        const double norm = std::sqrt(anything.dot(mass_.times(anything)));
        if (norm > 0) search_ += (0.05 / norm) * anything;
    }
    const int most = thorough ? 40 : 4;
    // Of the free coefficients only, and none without mass.
    mass_.solve(mass_.times(search_), nothing, w);
    std::vector<Eigen::VectorXd> q, mq;
    std::vector<double> alpha, beta;
    Eigen::VectorXd kq;
    for (int k = 0; k < most; ++k) {
        const Eigen::VectorXd mw = mass_.times(w);
        const double norm = std::sqrt(std::max(0.0, w.dot(mw)));
        if (!(norm > 1e-14 * (k == 0 ? 0.0 : std::abs(alpha.back())) && norm > 0)) break;
        if (k > 0) beta.push_back(norm);
        q.push_back(w / norm);
        mq.push_back(mw / norm);
        stiffness_times(q.back(), kq);
        mass_.solve(kq, nothing, w);
        alpha.push_back(q.back().dot(kq));
        for (int pass = 0; pass < 2; ++pass)
            for (std::size_t j = 0; j < q.size(); ++j) w -= mq[j].dot(w) * q[j];
    }
    if (alpha.empty()) return std::numeric_limits<double>::infinity();
    Eigen::SelfAdjointEigenSolver<Eigen::MatrixXd> ritz;
    const Eigen::VectorXd a =
        Eigen::Map<const Eigen::VectorXd>(alpha.data(), Eigen::Index(alpha.size()));
    const auto rest = Eigen::Index(alpha.size()) - 1;
    const Eigen::VectorXd b = Eigen::Map<const Eigen::VectorXd>(beta.data(), rest);
    ritz.computeFromTridiagonal(a, b);
    const double largest = ritz.eigenvalues()[rest];
    search_.setZero();
    for (std::size_t j = 0; j < q.size(); ++j)
        search_ += ritz.eigenvectors()(Eigen::Index(j), rest) * q[j];
    return largest > 0 ? 2 / std::sqrt(largest) : std::numeric_limits<double>::infinity();
}

void Method::set_search(const std::vector<double>& at) {
    search_ = Eigen::Map<const Eigen::VectorXd>(at.data(), Eigen::Index(at.size()));
}

Eigen::VectorXd Method::velocity_field(const std::vector<Point>& hold_velocity) {
    Eigen::VectorXd momentum, given, out;
    sum(momentum, [&](const auto&... particle) { deposit(particle...); });
    constraints_->given(hold_velocity, given);
    mass_.solve(momentum, given, out);
    return out;
}

std::optional<Point> Method::value_at(const Eigen::VectorXd& field, const Point& x) const {
    const int cell = basis_->locate(x, -1);
    if (cell < 0 || !filled_[std::size_t(cell)]) return std::nullopt;
    double phi[Basis::most];
    Point grad[Basis::most];
    basis_->evaluate(cell, x, phi, grad);
    const auto& on = basis_->on_cell(cell);
    Point out(0, 0);
    for (std::size_t i = 0; i < on.size(); ++i) out += phi[i] * coefficient(field, on[i]);
    return out;
}

Eigen::VectorXd Method::function_masses() const {
    Eigen::VectorXd out = Eigen::VectorXd::Zero(basis_->functions());
    for (int cell = 0; cell < basis_->cells(); ++cell) {
        const auto& on = basis_->on_cell(cell);
        each_particle(cell, [&](std::size_t b, std::size_t p, std::size_t at) {
            for (std::size_t i = 0; i < on.size(); ++i)
                out[on[i]] += bodies_[b].mass[p] * value_[at + i];
        });
    }
    return out;
}

int Method::filled_cells() const {
    return int(std::count(filled_.begin(), filled_.end(), char(1)));
}

double Method::bytes_per_particle(const Basis& basis, int reals) {
    const std::size_t width = basis.widest();
    return double(sizeof(std::uint64_t) + 3 * sizeof(Point) + 2 * sizeof(double) +
                  std::size_t(reals) * sizeof(double) + sizeof(std::array<double, 3>) +
                  sizeof(Tensor) + sizeof(int) + sizeof(std::size_t) +
                  width * (sizeof(double) + sizeof(Point)));
}

double Method::bytes() const {
    double all = double(mass_.bytes() + sums_.bytes()) + double(local_.size()) * sizeof(double);
    all += 1000.0 * basis_->cells();  // the mesh and the functions' own numbers, about
    for (const Particles& b : bodies_)
        all += double(b.count()) * bytes_per_particle(*basis_, b.law->reals());
    return all;
}

}  // namespace mpm::triangular
