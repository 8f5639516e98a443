// The whole state of an engine on functions, out and in.
#include <algorithm>
#include <cmath>
#include <limits>

#include "mpm/solver/functions_engine.hpp"
#include "mpm/solver/saved_state.hpp"

namespace mpm {

using triangular::Point;

namespace {

constexpr double most = std::numeric_limits<double>::max();

Blob points_blob(const std::vector<Point>& points) {
    std::vector<double> numbers;
    for (const Point& p : points) numbers.insert(numbers.end(), {p[0], p[1]});
    return detail::to_blob(numbers);
}

template <class E>
Blob one(E value) {
    Blob b;
    b.type = detail::type_code<E>();
    b.shape = {1};
    b.bytes.resize(sizeof value);
    std::memcpy(b.bytes.data(), &value, sizeof value);
    return b;
}

std::string number(double x) {
    char text[32];
    std::snprintf(text, sizeof text, "%.9g", x);
    return text;
}

void within(const std::string& name, double x, double low, double high) {
    if (!(x >= low && x <= high))
        refuse_entry(name, "is " + number(x), number(low) + " to " + number(high));
}

}  // namespace

/// A state, read and checked, that is yet to be adopted.
struct FunctionsEngine::SavedBody {
    std::vector<std::size_t> gone;  // places in the engine
    std::vector<double> position, velocity, displacement, volume, mass, state, stress, rate;
    std::vector<std::int32_t> cell;
};
struct FunctionsEngine::Saved {
    double time = 0, dt = 0, first_dt = 0, stable = 0;
    std::int64_t step = 0, watched_at = 0;
    std::vector<double> search;
    std::vector<SensorState> sensors;
    std::vector<SavedBody> bodies;
};

State FunctionsEngine::save() {
    if (fault_ && fault_->code != "left-domain")
        throw NumericalError("the state cannot be saved after a fault (" + fault_->code + ")");
    State s;
    s["format"] = one(state_format);
    s["clock_time"] = one(time_);
    s["clock_dt"] = one(dt_);
    s["clock_first_dt"] = one(first_dt_);
    s["clock_stable"] = one(stable_);
    s["clock_step"] = one(step_);
    s["clock_watched_at"] = one(watched_at_);
    s["search"] = detail::to_blob(method_.search());
    for (std::size_t k = 0; k < sensors_.size(); ++k) {
        const SensorState& x = sensors_[k];
        const std::string p = "sensor" + std::to_string(k) + "_";
        s[p + "next"] = one(x.next);
        s[p + "last_time"] = one(x.last_time);
        s[p + "first_energy"] = one(x.first_energy);
        s[p + "impulse"] = detail::to_blob(std::vector<double>(x.impulse.begin(), x.impulse.end()));
    }
    for (std::size_t b = 0; b < method_.bodies().size(); ++b) {
        const auto& body = method_.bodies()[b];
        const std::string p = "body" + std::to_string(b) + "_";
        s[p + "id"] = detail::to_blob(body.id);
        s[p + "position"] = points_blob(body.position);
        s[p + "velocity"] = points_blob(body.velocity);
        s[p + "displacement"] = points_blob(body.displacement);
        s[p + "volume"] = detail::to_blob(body.volume);
        s[p + "mass"] = detail::to_blob(body.mass);
        s[p + "state"] = detail::to_blob(body.state);
        s[p + "cell"] =
            detail::to_blob(std::vector<std::int32_t>(body.cell.begin(), body.cell.end()));
        std::vector<double> stress, rate;
        for (const auto& t : body.stress) stress.insert(stress.end(), t.begin(), t.end());
        for (const auto& r : body.rate)
            rate.insert(rate.end(), {r.e[0][0], r.e[0][1], r.e[1][0], r.e[1][1]});
        s[p + "stress"] = detail::to_blob(stress);
        s[p + "rate"] = detail::to_blob(rate);
    }
    return s;
}

FunctionsEngine::Saved FunctionsEngine::read(const State& whole) const {
    const SavedState state(whole);
    const bool named = state.format() > 1;
    Saved out;
    if (named) {
        out.time = state.one<double>("clock_time");
        out.dt = state.one<double>("clock_dt");
        out.first_dt = state.one<double>("clock_first_dt");
        out.stable = state.one<double>("clock_stable");
        out.step = state.one<std::int64_t>("clock_step");
        out.watched_at = state.one<std::int64_t>("clock_watched_at");
    } else {
        const auto clock = state.list<double>("clock", 4);
        const auto counters = state.list<std::int64_t>("counters", 2);
        out.time = clock[0], out.dt = clock[1], out.first_dt = clock[2], out.stable = clock[3];
        out.step = counters[0], out.watched_at = counters[1];
    }
    constexpr double least = std::numeric_limits<double>::min();
    within("clock_time", out.time, 0, most);
    // Without particles nothing limits the step.
    within("clock_stable", out.stable, least, std::numeric_limits<double>::infinity());
    within("clock_dt", out.dt, least, std::min(most, out.stable));
    within("clock_first_dt", out.first_dt, least, most);
    if (!(out.time + out.dt > out.time))
        refuse_entry("clock_time", "is " + number(out.time),
                     "a time that a step of " + number(out.dt) + " s advances");
    within("clock_step", double(out.step), 0, 1e18);
    within("clock_watched_at", double(out.watched_at), -1, double(out.step));
    out.search = state.numbers("search", state.size("search"), most);
    if (out.search.size() > 2 * std::size_t(method_.basis().functions()))
        refuse_entry("search", "has " + std::to_string(out.search.size()) + " elements",
                     "two a function at most");
    for (std::size_t k = 0; k < sensors_.size(); ++k)
        out.sensors.push_back(read_sensor(state, out, k));
    for (std::size_t b = 0; b < method_.bodies().size(); ++b)
        out.bodies.push_back(read_body(state, b));
    if (state.has("body" + std::to_string(method_.bodies().size()) + "_id"))
        throw SceneError("the saved state has more bodies than this scene");
    return out;
}

FunctionsEngine::SensorState FunctionsEngine::read_sensor(const SavedState& state,
                                                          const Saved& saved, std::size_t k) const {
    const std::string p = "sensor" + std::to_string(k) + "_";
    SensorState x;
    x.next = state.one<std::int64_t>(p + "next");
    if (state.format() > 1) {
        x.last_time = state.one<double>(p + "last_time");
        x.first_energy = state.one<double>(p + "first_energy");
        const auto impulse = state.numbers(p + "impulse", 3, most);
        std::copy(impulse.begin(), impulse.end(), x.impulse.begin());
    } else {
        const auto sums = state.list<double>(p + "sums", 5);
        x.last_time = sums[0];
        x.first_energy = sums[1];
        for (std::size_t a = 0; a < 3; ++a) {
            within(p + "sums", sums[2 + a], -most, most);
            x.impulse[a] = sums[2 + a];
        }
    }
    within(p + "last_time", x.last_time, 0, saved.time * (1 + 1e-12));
    if (std::isinf(x.first_energy)) refuse_entry(p + "first_energy", "is inf", "an energy, J");
    const double interval = spec_.sensors[k].interval;
    // The next sample is at most one interval ahead, and was not due some steps ago, which may have
    // been longer.
    const bool fits = interval <= 0 ? x.next <= saved.step + 1
                                    : (double(x.next) - 1) * interval <= saved.time * (1 + 1e-12) &&
                                          saved.time - double(x.next) * interval <=
                                              1e3 * std::max({saved.dt, saved.first_dt, interval});
    if (x.next < 0 || !fits)
        refuse_entry(p + "next",
                     "is " + std::to_string(x.next) + " at " + number(saved.time) + " s",
                     "the number of the sample that comes next");
    return x;
}

FunctionsEngine::SavedBody FunctionsEngine::read_body(const SavedState& state,
                                                      std::size_t b) const {
    const auto& body = method_.bodies()[b];
    const std::string p = "body" + std::to_string(b) + "_";
    SavedBody out;
    const auto ids = state.list<std::uint64_t>(p + "id");
    const std::size_t n = ids.size();
    // Those that had left before the state was saved; the others stand in the scene's order.
    for (std::size_t k = 0, next = 0; k < body.count() || next < n; ++k) {
        if (k == body.count())
            throw SceneError("the saved state's body '" + body.name +
                             "' has other particles than this scene's");
        if (next < n && ids[next] == body.id[k])
            ++next;
        else
            out.gone.push_back(k);
    }
    out.position = state.numbers(p + "position", 2 * n, most);
    out.velocity = state.numbers(p + "velocity", 2 * n, most);
    out.displacement = state.numbers(p + "displacement", 2 * n, most);
    out.volume = state.numbers(p + "volume", n, most);
    out.mass = state.numbers(p + "mass", n, most);
    out.state = state.numbers(p + "state", n * std::size_t(body.law->reals()), most);
    out.stress = state.numbers(p + "stress", 3 * n, most);
    out.rate = state.numbers(p + "rate", 4 * n, most);
    out.cell = state.list<std::int32_t>(p + "cell", n);
    for (std::size_t k = 0; k < n; ++k) {
        within(p + "volume", out.volume[k], std::numeric_limits<double>::min(), most);
        within(p + "mass", out.mass[k], std::numeric_limits<double>::min(), most);
        const Point x(out.position[2 * k], out.position[2 * k + 1]);
        const std::int32_t cell = out.cell[k];
        // -1: it has left, and the policy was to stop.
        if (cell < -1 || cell >= method_.basis().cells() || method_.basis().locate(x, cell) != cell)
            refuse_entry(p + "cell",
                         "has " + std::to_string(cell) + " for a particle at (" + number(x[0]) +
                             ", " + number(x[1]) + ") m",
                         "the cell that it is in");
    }
    return out;
}

void FunctionsEngine::check(const State& state) const { read(state); }

void FunctionsEngine::load(const State& state) {
    Saved saved = read(state);
    for (std::size_t b = 0; b < saved.bodies.size(); ++b) {
        auto& body = method_.bodies()[b];
        SavedBody& from = saved.bodies[b];
        body.erase(from.gone);
        body.position = points_of(from.position);
        body.velocity = points_of(from.velocity);
        body.displacement = points_of(from.displacement);
        body.volume = std::move(from.volume);
        body.mass = std::move(from.mass);
        body.state = std::move(from.state);
        body.cell.assign(from.cell.begin(), from.cell.end());
        for (std::size_t k = 0; k < body.count(); ++k) {
            std::copy_n(from.stress.begin() + std::ptrdiff_t(3 * k), 3, body.stress[k].begin());
            for (std::size_t e = 0; e < 4; ++e) body.rate[k].e[e / 2][e % 2] = from.rate[4 * k + e];
        }
    }
    for (std::size_t k = 0; k < sensors_.size(); ++k) {
        saved.sensors[k].waiting = std::move(sensors_[k].waiting);
        sensors_[k] = std::move(saved.sensors[k]);
    }
    time_ = saved.time;
    step_ = saved.step;
    fault_.reset();
    ready_ = false;
    held_ = false;
    hold_active();
    // Else the cells of the start would count as newly left, and the step as due to be found again.
    method_.remember_filled();
    method_.set_search(saved.search);
    dt_ = saved.dt;
    first_dt_ = saved.first_dt;
    stable_ = saved.stable;
    watched_at_ = saved.watched_at;
}

}  // namespace mpm
