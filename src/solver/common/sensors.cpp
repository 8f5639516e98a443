#include "mpm/core/error.hpp"
#include "mpm/solver/engine.hpp"

namespace mpm {

std::pair<std::vector<std::string>, std::vector<std::string>> sensor_columns(const Spec& spec,
                                                                             int sensor) {
    const SensorSpec& s = spec.sensors.at(std::size_t(sensor));
    const bool flat = spec.dimension == 2;
    const std::vector<std::string> axes =
        flat ? std::vector<std::string>{"x", "y"} : std::vector<std::string>{"x", "y", "z"};
    std::vector<std::string> names, units;
    const auto add = [&](const std::string& name, const std::string& unit) {
        names.push_back(name);
        units.push_back(unit);
    };
    switch (s.kind) {
        case SensorKind::load_cell:
            for (const auto& a : axes) add("force_" + a, flat ? "N/m" : "N");
            if (flat)
                add("moment_z", "N");
            else
                for (const auto& a : axes) add("moment_" + a, "N m");
            break;
        case SensorKind::wave_gauge:
            add("elevation", "m");
            break;
        case SensorKind::velocity_probe:
            for (const auto& a : axes) add("velocity_" + a, "m/s");
            break;
        case SensorKind::tracker:
            for (auto id : s.ids) {
                for (const auto& a : axes) add("position_" + a + ":" + std::to_string(id), "m");
                for (const auto& a : axes) add("velocity_" + a + ":" + std::to_string(id), "m/s");
            }
            break;
        case SensorKind::contact_load:
            for (const auto& a : axes) add("force_" + a, flat ? "N/m" : "N");
            for (const char* n : {"normal", "tangential"}) add(n, flat ? "N/m" : "N");
            add("friction_power", flat ? "W/m" : "W");
            break;
        case SensorKind::rigid_motion:
            for (const auto& a : axes) add("centroid_" + a, "m");
            for (const auto& a : axes) add("velocity_" + a, "m/s");
            if (flat) {
                add("angular_velocity", "rad/s");
                add("angle", "rad");
            } else {
                for (const auto& a : axes) add("angular_velocity_" + a, "rad/s");
                for (const char* q : {"w", "x", "y", "z"}) add(std::string("quaternion_") + q, "1");
            }
            for (const auto& a : axes) add("force_" + a, flat ? "N/m" : "N");
            if (flat)
                add("moment_z", "N");
            else
                for (const auto& a : axes) add("moment_" + a, "N m");
            break;
        case SensorKind::pin_force:
            for (const auto& a : axes) add("force_" + a, flat ? "N/m" : "N");
            break;
        case SensorKind::tally:
            for (std::size_t k = 0; k < s.tallies.size(); ++k) {
                const std::string of = ":" + std::to_string(k);
                const auto several = [&](const std::string& what, int count) {
                    for (int c = 0; c < count; ++c) add(what + std::to_string(c) + of, "1");
                };
                several("sum", 6);
                several("count", 3);
                several("ids", 4);
                several("low", 3);
                several("high", 3);
            }
            add("time_step", "s");
            break;
        case SensorKind::energy:
            for (const char* n : {"kinetic", "elastic", "potential", "dissipated"})
                add(n, flat ? "J/m" : "J");
            break;
    }
    return {names, units};
}

}  // namespace mpm
