#include "mpm/solver/raw_samples.hpp"

#include <algorithm>
#include <cmath>

#include "mpm/kernels/tally.hpp"
#include "mpm/solver/rank_join.hpp"

namespace mpm {

namespace {

/// Calls f(MeanRow of its kind) for a sensor that tells means of sums.
template <class F>
void of_means(SensorKind kind, int dimension, const F& f) {
    if (kind == SensorKind::load_cell)
        dimension == 2 ? f(MeanRow<load_columns<2>>{}) : f(MeanRow<load_columns<3>>{});
    if (kind == SensorKind::contact_load)
        dimension == 2 ? f(MeanRow<contact_columns<2>>{}) : f(MeanRow<contact_columns<3>>{});
    if (kind == SensorKind::pin_force) dimension == 2 ? f(MeanRow<2>{}) : f(MeanRow<3>{});
}

std::size_t width_of(const Samples& of) {
    return of.time.empty() ? 0 : of.values.data.size() / of.time.size();
}

void add(double* to, const double* from, int count) {
    for (int k = 0; k < count; ++k) to[k] += from[k];
}

/// The lowest, or not-a-number where one is.
double lower_of(double a, double b) { return b < a || b != b ? b : a; }

void join_tally(double* to, const double* from) {
    using R = TallyRow;
    add(to, from, R::low);
    for (int c = 0; c < 3; ++c) {
        to[R::low + c] = lower_of(to[R::low + c], from[R::low + c]);
        to[R::high + c] = -lower_of(-to[R::high + c], -from[R::high + c]);
    }
}

/// Of one tally, behind those that are there.
void finish_tally(const double* raw, std::vector<double>& out) {
    using R = TallyRow;
    for (int k = 0; k < 6; ++k)
        out.push_back(to_double(from_pieces(raw + k * exact_pieces), raw[R::scales + k]));
    for (int c = 0; c < 3; ++c) out.push_back(raw[R::counts + c]);
    for (int k = 0; k < 2; ++k) {
        // Halves that have been added carry; what is no number of a rank's is taken for zero.
        const auto half = [&](int which) {
            const double x = raw[R::ids + 2 * k + which];
            return x >= 0 && x < 0x1p60 ? std::uint64_t(x) : 0;
        };
        const std::uint64_t sum = (half(0) << 32) + half(1);
        out.push_back(double(sum >> 32));
        out.push_back(double(sum & 0xffffffffu));
    }
    for (const int at : {R::low, R::high})
        for (int c = 0; c < 3; ++c) out.push_back(raw[R::counts + c] > 0 ? raw[at + c] : 0.0);
}

}  // namespace

SceneSizes sizes_of(const Spec& spec, const Plan& plan) {
    SceneSizes s{spec.cell_size, plan.wave_speed, 0, 0};
    for (const std::int64_t cells : spec.cells)
        s.length = std::max(s.length, double(cells) * spec.cell_size);
    // A scene of rigid bodies has no waves; a plan that none was made for has no step.
    if (plan.time_step > 0) s.speed = std::max(s.speed, 0.5 * spec.cell_size / plan.time_step);
    if (!(s.speed > 0)) s.speed = 1;
    for (const BodySpec& b : spec.bodies)
        s.density = std::max(s.density, material(b.material).density(b.parameters.data()));
    if (!(s.density > 0)) s.density = 1;
    s.mass = s.density * std::pow(spec.cell_size, spec.dimension);
    return s;
}

ImpulseScales impulse_scales(const Spec& spec, const Plan& plan) {
    const SceneSizes s = sizes_of(spec, plan);
    const double impulse = s.mass * s.speed;
    return {exact_scale(impulse), exact_scale(impulse * s.length), exact_scale(impulse * s.speed)};
}

std::size_t ring_columns(const Spec& spec, int sensor) {
    const SensorSpec& s = spec.sensors.at(std::size_t(sensor));
    if (s.kind == SensorKind::tally) return s.tallies.size() * TallyRow::size + 1;
    std::size_t columns = 0;
    of_means(s.kind, spec.dimension, [&](auto row) { columns = row.size; });
    return columns > 0 ? columns : sensor_columns(spec, sensor).first.size();
}

std::vector<SensorSpec> without_places(std::vector<SensorSpec> sensors) {
    for (SensorSpec& s : sensors)
        for (TallySpec& t : s.tallies) t.places = {};
    return sensors;
}

void join(const SensorSpec& sensor, int dimension, Samples& to, const Samples& from) {
    if (sensor.kind == SensorKind::wave_gauge || sensor.kind == SensorKind::velocity_probe)
        return;  // each rank has them whole
    if (sensor.kind == SensorKind::tracker) {
        take_numbers(to.values, from.values);  // a particle is not a number where it is not
        return;
    }
    const std::size_t width = width_of(to);
    int summed = int(width);
    of_means(sensor.kind, dimension, [&](auto row) { summed = row.scales; });
    for (std::size_t i = 0; i < to.time.size(); ++i) {
        double* row = &to.values.data[i * width];
        const double* more = &from.values.data.at(i * width);
        if (sensor.kind != SensorKind::tally) add(row, more, summed);
        for (std::size_t k = 0; k < sensor.tallies.size(); ++k)
            join_tally(row + k * TallyRow::size, more + k * TallyRow::size);
    }
}

std::vector<Samples> finished(const std::vector<SensorSpec>& sensors, int dimension,
                              std::vector<Samples> raw) {
    for (std::size_t k = 0; k < raw.size(); ++k) {
        const SensorSpec& sensor = sensors.at(k);
        Array& values = raw[k].values;
        const std::size_t rows = raw[k].time.size(), width = width_of(raw[k]);
        std::vector<double> out;
        const auto each = [&](const auto& finish) {
            for (std::size_t i = 0; i < rows; ++i) finish(values.data.data() + i * width);
            values.data = std::move(out);
        };
        if (sensor.kind == SensorKind::tally) {
            each([&](const double* row) {
                for (std::size_t t = 0; t < sensor.tallies.size(); ++t)
                    finish_tally(row + t * TallyRow::size, out);
                out.push_back(row[width - 1]);
            });
            values.shape = {rows, sensor.tallies.size() * TallyRow::finished + 1};
        }
        of_means(sensor.kind, dimension, [&](auto form) {
            constexpr int columns = decltype(form)::scales / exact_pieces;
            each([&](const double* row) {
                for (int c = 0; c < columns; ++c)
                    out.push_back(
                        to_double(from_pieces(row + c * exact_pieces), row[form.scales + c]) /
                        row[form.elapsed]);
            });
            values.shape = {rows, std::size_t(columns)};
        });
    }
    return raw;
}

}  // namespace mpm
