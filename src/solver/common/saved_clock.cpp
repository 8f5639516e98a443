#include "mpm/solver/saved_clock.hpp"

#include <algorithm>
#include <cmath>
#include <limits>

#include "mpm/solver/saved_state.hpp"

namespace mpm {

namespace {

static_assert(sizeof(ClockOfFormat1) == 2344 && offsetof(ClockOfFormat1, log_step) == 264 &&
                  offsetof(ClockOfFormat1, deposited_before) == 2320,
              "what earlier versions have written");

/// Calls `f(name, first element in a, in b, count)` for every field that is saved as it is.
template <class A, class B, class F>
void each_field(A& a, B& b, const F& f) {
    f("time", &a.time, &b.time, 1);
    f("dt", &a.dt, &b.dt, 1);
    f("dt_stable", &a.dt_stable, &b.dt_stable, 1);
    f("step", &a.step, &b.step, 1);
    f("drift", &a.drift, &b.drift, 1);
    f("strays", &a.strays, &b.strays, 1);
    f("stray_limit", &a.stray_limit, &b.stray_limit, 1);
    f("speed", &a.speed, &b.speed, 1);
    f("unit_read", a.unit_read, b.unit_read, quantities);
    f("scale_write", a.scale_write, b.scale_write, quantities);
    f("deposited", a.deposited, b.deposited, quantities);
    f("deposit_limit", a.deposit_limit, b.deposit_limit, quantities);
    f("deposited_before", a.deposited_before, b.deposited_before, quantities);
    f("log_stride", &a.log_stride, &b.log_stride, 1);
}
/// The same of one clock, `f(name, first element, count)`.
template <class C, class F>
void each_field(C& clock, const F& f) {
    each_field(clock, clock,
               [&](const char* name, auto* x, auto*, int count) { f(name, x, count); });
}

/// Earlier clocks end before the deposits of the step before the last, which then are none: the
/// first limit follows from the last deposits alone, as it did in those versions.
Clock clock_of_image(const SavedState& state) {
    const auto bytes = state.list<unsigned char>("clock");
    ClockOfFormat1 image{};
    if (bytes.size() != sizeof image && bytes.size() != offsetof(ClockOfFormat1, deposited_before))
        refuse_entry("clock", "has " + std::to_string(bytes.size()) + " bytes",
                     std::to_string(sizeof image) + ", or " +
                         std::to_string(offsetof(ClockOfFormat1, deposited_before)) +
                         " of versions before");
    std::memcpy(&image, bytes.data(), bytes.size());
    Clock clock{};
    each_field(image, clock,
               [](const char*, auto* from, auto* to, int count) { std::copy_n(from, count, to); });
    clock.log_count = image.log_count;
    if (image.log_count < 0 || image.log_count > speed_log_size)
        refuse_entry("clock", "has " + std::to_string(image.log_count) + " logged speeds",
                     "0 to " + std::to_string(speed_log_size));
    std::copy_n(image.log_step, image.log_count, clock.log_step);
    std::copy_n(image.log_speed, image.log_count, clock.log_speed);
    return clock;
}

Clock clock_of_fields(const SavedState& state) {
    Clock clock{};
    each_field(clock, [&](const char* name, auto* to, int count) {
        using E = std::remove_pointer_t<decltype(to)>;
        const auto values = state.list<E>("clock_" + std::string(name), std::size_t(count));
        std::copy(values.begin(), values.end(), to);
    });
    const auto steps = state.list<std::int64_t>("clock_log_step");
    const auto speeds = state.list<double>("clock_log_speed", steps.size());
    if (steps.size() > std::size_t(speed_log_size))
        refuse_entry("clock_log_step", "has " + std::to_string(steps.size()) + " elements",
                     "at most " + std::to_string(speed_log_size));
    std::copy(steps.begin(), steps.end(), clock.log_step);
    std::copy(speeds.begin(), speeds.end(), clock.log_speed);
    clock.log_count = std::int32_t(steps.size());
    return clock;
}

std::string all_digits(double x) {
    char text[32];
    std::snprintf(text, sizeof text, "%.17g", x);
    return text;
}

void check_clock(const Clock& c) {
    constexpr double most = std::numeric_limits<double>::max();
    constexpr double infinity = std::numeric_limits<double>::infinity();
    const auto within = [](const char* name, double x, double low, double high) {
        if (!(x >= low && x <= high))
            refuse_entry("clock_" + std::string(name), "is " + all_digits(x),
                         all_digits(low) + " to " + all_digits(high));
    };
    within("time", c.time, 0, most);
    if (c.step < 0 || c.step >= std::int64_t(1) << 60)
        refuse_entry("clock_step", "is " + std::to_string(c.step), "a number of steps");
    within("dt_stable", c.dt_stable, std::numeric_limits<double>::min(), most);
    within("dt", c.dt, std::numeric_limits<double>::min(), c.dt_stable * (1 + 1e-12));
    if (!(c.time + c.dt > c.time))
        refuse_entry("clock_time", "is " + all_digits(c.time),
                     "a time that a step of " + all_digits(c.dt) + " s advances");
    within("drift", c.drift, 0, 1 + 1e-9);
    within("speed", c.speed, 0, most);
    for (int q = 0; q < quantities; ++q) {
        // Powers of two, so that a sum is the same number on any scale.
        for (const auto& [name, x] :
             {std::pair("unit_read", c.unit_read[q]), std::pair("scale_write", c.scale_write[q])}) {
            int exponent = 0;
            if (!(x > 0 && x <= most) || std::frexp(x, &exponent) != 0.5 || !std::isfinite(1 / x))
                refuse_entry("clock_" + std::string(name), "has " + all_digits(x), "powers of two");
        }
        within("deposited", c.deposited[q], 0, most);
        within("deposited_before", c.deposited_before[q], 0, most);
        within("deposit_limit", c.deposit_limit[q], 0, infinity);
    }
    if (c.log_stride < 1 || (c.log_stride & (c.log_stride - 1)) != 0)
        refuse_entry("clock_log_stride", "is " + std::to_string(c.log_stride), "a power of two");
    for (int k = 0; k < c.log_count; ++k) {
        within("log_speed", c.log_speed[k], 0, most);
        if (c.log_step[k] < 0 || c.log_step[k] > c.step ||
            (k > 0 && c.log_step[k] <= c.log_step[k - 1]))
            refuse_entry("clock_log_step", "has " + std::to_string(c.log_step[k]),
                         "steps up to the present one, ascending");
    }
}

}  // namespace

Clock saved_clock(const State& whole) {
    const SavedState state(whole);
    Clock clock = state.format() == 1 ? clock_of_image(state) : clock_of_fields(state);
    check_clock(clock);
    clock.dt_next = clock.dt;
    clock.numbers_dt = clock.numbers_dt_next = -1;
    clock.until = std::numeric_limits<double>::infinity();
    clock.halt = Halt::none;
    clock.fault = FaultKind::none;
    clock.fault_particle = no_fault;
    return clock;
}

void save_clock(State& state, const Clock& clock) {
    state.erase("clock");
    state["format"] = detail::to_blob(std::vector<std::int32_t>{state_format});
    const auto put = [&]<class E>(const std::string& name, const E* from, int count) {
        state["clock_" + name] = detail::to_blob(std::vector<E>(from, from + count));
    };
    each_field(clock, put);
    put("log_step", clock.log_step, clock.log_count);
    put("log_speed", clock.log_speed, clock.log_count);
}

}  // namespace mpm
