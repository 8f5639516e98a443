// The material point method on functions over triangles: particles, sums, solves. One step is that
// of Sulsky et al. (1995), "modified update", de Koster (2018) section 2.4. Double precision, plane
// strain.
#pragma once

#include <functional>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "mpm/triangular/law.hpp"
#include "mpm/triangular/mass.hpp"

namespace mpm::triangular {

/// A force on particles of a body's surface that stays with them: eq. 2.28.
struct Traction {
    std::vector<std::size_t> particles;
    double length = 0;                        // of the boundary that each stands for, m
    std::function<Point(double time)> value;  // Pa
};

/// Particles of one body, in any order.
struct Particles {
    std::string name;
    std::unique_ptr<Law> law;
    std::vector<std::uint64_t> id;
    std::vector<Point> position, velocity, displacement;
    std::vector<double> mass, volume;           // kg/m, undeformed m^2
    std::vector<double> state;                  // law->reals() each
    std::vector<std::array<double, 3>> stress;  // Kirchhoff: xx, yy, xy, Pa
    std::vector<Tensor> rate;                   // grad v of the last step, 1/s
    std::vector<int> cell;
    std::vector<Traction> tractions;

    std::size_t count() const { return position.size(); }
    const double* state_of(std::size_t p) const {
        return state.data() + p * std::size_t(law->reals());
    }
    double* state_of(std::size_t p) { return state.data() + p * std::size_t(law->reals()); }
    /// Place of the particle with an id, count() if it has gone.
    std::size_t place_of(std::uint64_t sought) const;
    /// Keeps the particles at these places, in this order.
    void take(const std::vector<std::size_t>& places);
    void erase(const std::vector<std::size_t>& gone);  // ascending

private:
    mutable std::vector<std::size_t> by_id_;  // places by ascending id, made when asked for
};

/// What stopped a step.
struct Trouble {
    std::string code;
    int body = -1;
    std::vector<std::uint64_t> ids;
    double value = 0, speed = 0;
    std::string message;
};

/// Outside influences at one moment.
struct Surroundings {
    Point gravity{0, 0};
    std::vector<Point> hold_velocity;      // at the end of the step, one a hold
    std::vector<Point> hold_acceleration;  // over the step
};

class Method {
public:
    Method(std::unique_ptr<Basis> basis, const MassOptions& mass, int threads);

    std::vector<Particles>& bodies() { return bodies_; }
    const std::vector<Particles>& bodies() const { return bodies_; }
    const Basis& basis() const { return *basis_; }
    /// Call after the last body was added and after particles were changed from outside.
    void start();
    /// Puts particles of a cell beside each other in memory, where most of them stay.
    void sort_by_cell();
    /// Which cells are filled, from the cells that the particles say they are in: what the next
    /// `prepare` compares with. Part of a run's state.
    void remember_filled();
    void hold(const std::vector<Hold>& holds);

    /// Particles outside the functions' domain, body by body: to be dealt with before `prepare`.
    std::vector<std::vector<std::size_t>> relocate();
    /// Functions at the particles, mass matrix and forces of the state as it stands.
    std::optional<Trouble> prepare(double time, const Point& gravity);
    /// One step from a prepared state.
    std::optional<Trouble> step(double dt, const Surroundings& around);

    /// 2 / omega_max of the prepared system: the longest stable step, s. `thorough` starts the
    /// search afresh; otherwise it goes on from where it ended last.
    double stable_step(bool thorough);
    /// Where that search ended, which is part of a run's state.
    std::vector<double> search() const { return {search_.begin(), search_.end()}; }
    void set_search(const std::vector<double>& at);

    /// Coefficients (functions, 2) of the velocity that the particles have now.
    Eigen::VectorXd velocity_field(const std::vector<Point>& hold_velocity);
    /// Value of a field at a point, or nothing outside the filled cells.
    std::optional<Point> value_at(const Eigen::VectorXd& field, const Point& x) const;
    /// Of the last step: coefficients of the acceleration and of the velocity that moved particles.
    const Eigen::VectorXd& last_acceleration() const { return acceleration_; }
    const Eigen::VectorXd& last_velocity() const { return velocity_; }
    /// Mass of each function, kg/m.
    Eigen::VectorXd function_masses() const;

    /// Impulse that each hold has taken up since it was last asked, N s/m and N s (moment about the
    /// lower corner).
    std::vector<std::array<double, 3>>& impulses() { return impulses_; }
    void measure_loads(bool on) { loads_ = on; }

    const MassSystem& mass() const { return mass_; }
    int filled_cells() const;
    /// Particles have entered cells or left the last ones since the state before.
    bool cells_changed() const { return cells_changed_; }
    double bytes() const;
    static double bytes_per_particle(const Basis& basis, int reals);

private:
    template <class F>
    void each_cell(const F& f);
    template <class F>
    void each_particle(int cell, const F& f) const;
    void list_particles();
    void stiffness_times(const Eigen::VectorXd& field, Eigen::VectorXd& out);
    void collect(Eigen::VectorXd& out) const;
    template <class F>
    void sum(Eigen::VectorXd& out, const F& f);
    void deposit(double* sums, const std::vector<int>& on, std::size_t b, std::size_t p,
                 std::size_t at) const;
    std::optional<Trouble> check() const;

    Cpu exec_, alone_{1};
    std::unique_ptr<Basis> basis_;
    std::size_t width_ = 0;  // most functions on a cell
    MassSystem mass_;
    std::unique_ptr<Constraints> constraints_;
    std::vector<Particles> bodies_;
    std::vector<std::array<double, 9>> stiffness_;  // of each body at rest: xx, yy, engineering xy
    // Particles by cell, all bodies: number of a particle among all.
    std::vector<std::size_t> first_of_body_, cell_start_, listed_;
    std::vector<double> value_;    // (all particles as listed, width)
    std::vector<Point> gradient_;  // (all particles as listed, width)
    CellMatrices sums_;
    std::vector<double> local_;  // (cells, width, 2): what cells add to the functions
    std::vector<char> filled_;
    bool cells_changed_ = false;
    Eigen::VectorXd force_, acceleration_, velocity_, search_;
    std::vector<std::array<double, 3>> impulses_;
    std::vector<Point> control_;
    bool loads_ = false;
};

}  // namespace mpm::triangular
