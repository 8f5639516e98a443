// The engine of scenes on functions over cells: the method of triangular/method.hpp with the clock,
// sensors, readers and saved states that every engine has. Double precision, on the CPU.
#pragma once

#include <array>
#include <chrono>
#include <optional>

#include "mpm/solver/engine.hpp"
#include "mpm/solver/plan.hpp"
#include "mpm/triangular/method.hpp"

namespace mpm {

class SavedState;

/// What such a scene will cost; nothing of the particles' size is allocated.
Plan plan_functions(const Spec& spec);

std::unique_ptr<triangular::Basis> make_basis(const FunctionsSpec& spec);
std::unique_ptr<triangular::Law> make_law(const std::string& material,
                                          const std::vector<double>& parameters);

triangular::Point table_at(const TableSpec& table, double time);

/// Points from pairs of coordinates.
inline std::vector<triangular::Point> points_of(const std::vector<double>& numbers) {
    std::vector<triangular::Point> out;
    for (std::size_t k = 0; k + 1 < numbers.size(); k += 2)
        out.emplace_back(numbers[k], numbers[k + 1]);
    return out;
}

class FunctionsEngine final : public Engine {
public:
    explicit FunctionsEngine(const Spec& spec);

    RunResult run(std::int64_t steps, double until, double wall) override;
    double time() const override { return time_; }
    std::int64_t step() const override { return step_; }
    double time_step() const override { return dt_; }
    std::uint64_t particle_count(int body) const override;
    std::vector<Samples> drain() override;
    std::vector<Removed> removed() override { return std::exchange(removed_, {}); }
    std::vector<Flow> flows() override { return {}; }
    SmoothingHistory smoothing(int) const override { return {}; }
    std::vector<std::string> attribute_names(int body) const override;
    /// Readers get everything wherever they look: such scenes are small.
    Attributes attributes(int body, const std::vector<std::string>& names,
                          const Window& window) override;
    Array grid(const std::string& name, const Window& window) override;
    NodalSums sums(const Window&) override {
        throw SceneError(
            "a run on a grid of functions has no nodal sums from which another can continue");
    }
    Condition condition(int samples) override;
    State save() override;
    void check(const State& state) const override;
    void load(const State& state) override;
    std::map<std::string, double> timings() const override { return timings_; }
    std::map<std::string, double> statistics() const override;

private:
    /// One face of a boundary, or an outline boundary as a whole: what is held together.
    struct HeldPart {
        int boundary;
        int face;
        triangular::Hold hold;
    };
    struct SensorState {
        std::int64_t next = 0;
        double last_time = 0;
        double first_energy = 0;  // not-a-number before the first sample
        std::array<double, 3> impulse{};
        Samples waiting;
    };
    struct Saved;
    struct SavedBody;

    // state.cpp
    Saved read(const State& state) const;
    SensorState read_sensor(const SavedState& state, const Saved& saved, std::size_t k) const;
    SavedBody read_body(const SavedState& state, std::size_t b) const;

    void place_body(const BodySpec& body);
    void find_parts();
    void hold_active();
    triangular::Point velocity_of(int boundary, double time) const;
    triangular::Point gravity_at(double time) const;
    std::vector<triangular::Point> hold_velocities(double time) const;
    bool make_ready();
    void fail(const triangular::Trouble& trouble);
    void watch_step();
    void sample_due();
    void sample(std::size_t sensor);
    std::array<double, 3> energies(int body) const;
    void take_impulses();
    void charge(const char* phase);

    Spec spec_;
    triangular::Method method_;
    std::vector<HeldPart> parts_;
    std::vector<int> active_;  // parts that hold now
    double time_ = 0, dt_ = 0, first_dt_ = 0, stable_ = 0;
    std::int64_t step_ = 0, watched_at_ = -1;
    bool ready_ = false, held_ = false;
    std::optional<Fault> fault_;
    std::vector<SensorState> sensors_;
    std::vector<Removed> removed_;
    std::map<std::string, double> timings_;
    std::chrono::steady_clock::time_point mark_;
};

}  // namespace mpm
