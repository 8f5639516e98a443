// Sensors: what a checkpoint has of them, and how a run goes on with it.
#pragma once

#include "mpm/solver/sensors.hpp"

namespace mpm {

template <class X, int D>
void Sensors<X, D>::save(State& state) const {
    const auto records = records_.host();
    std::vector<std::int64_t> next;
    std::vector<double> last, first;
    for (std::size_t k = 0; k < records.size(); ++k) {
        next.push_back(records[k].next);
        last.push_back(records[k].last_time);
        first.push_back(sensors_[k].first.host()[0]);
    }
    state["load_impulse"] =
        detail::to_blob(in_pieces(load_impulse_, load_columns<D>, &Sensors::load_scale));
    std::vector<double> told, pins;
    for (const auto& s : sensors_) {
        if (s.spec.kind == SensorKind::pin_force) {
            const auto own = in_pieces(s.pin_told, D, &Sensors::load_scale);
            pins.insert(pins.end(), own.begin(), own.end());
        }
        if (s.spec.kind != SensorKind::rigid_motion) continue;
        auto own = s.told;
        own.resize(rigid_loads, std::numeric_limits<double>::quiet_NaN());
        told.insert(told.end(), own.begin(), own.end());
    }
    if (!told.empty()) state["rigid_told"] = detail::to_blob(told);
    if (!pins.empty()) state["pin_impulse"] = detail::to_blob(pins);
    if (contact_count() > 0)
        state["contact_impulse"] = detail::to_blob(
            in_pieces(contact_impulse_, contact_columns<D>, &Sensors::contact_scale));
    state["sensor_next"] = detail::to_blob(next);
    state["sensor_last"] = detail::to_blob(last);
    state["sensor_first"] = detail::to_blob(first);
}

template <class X, int D>
void Sensors<X, D>::load(const State& state, const Clock& clock) {
    restore(detail::from_blob<std::int64_t>(state, "sensor_next"),
            detail::from_blob<double>(state, "sensor_last"),
            detail::from_blob<double>(state, "sensor_first"),
            detail::from_blob<double>(state, "load_impulse"), clock);
    load_told(state);
    if (contact_count() == 0) return;
    std::vector<double> impulse;
    if (state.contains("contact_impulse"))
        impulse = detail::from_blob<double>(state, "contact_impulse");
    const auto known = detail::from_blob<std::int64_t>(state, "sensor_next").size();
    take_impulse(impulse, known, SensorKind::contact_load, contact_columns<D>,
                 &Sensors::contact_scale, contact_impulse_);
}

/// What rigid bodies were told, and pins. Earlier versions have one number each of pins, among
/// those of rigid bodies.
template <class X, int D>
void Sensors<X, D>::load_told(const State& state) {
    std::vector<double> told, pins;
    if (state.contains("rigid_told")) told = detail::from_blob<double>(state, "rigid_told");
    const bool apart = state.contains("pin_impulse");
    if (apart) pins = detail::from_blob<double>(state, "pin_impulse");
    constexpr std::ptrdiff_t of_rigid = rigid_loads, of_pin = D * exact_pieces;
    auto from = told.cbegin();
    auto pin = pins.cbegin();
    for (auto& s : sensors_) {
        const bool pinned = s.spec.kind == SensorKind::pin_force;
        if (pinned && apart) {
            if (pins.cend() - pin < of_pin) continue;  // of a sensor that is new
            s.pin_told.assign(impulse_of(pin, exact_pieces));
            pin += of_pin;
        } else if (pinned || s.spec.kind == SensorKind::rigid_motion) {
            if (told.cend() - from < of_rigid) break;
            if (!pinned) {
                s.told.assign(from, from + of_rigid);
                if (std::isnan(s.told[0])) s.told.clear();
            } else if (!std::isnan(*from)) {
                s.pin_told.assign(impulse_of(from, 1));
            }
            from += of_rigid;
        }
    }
}

/// The impulse of a pin, of so many numbers each component.
template <class X, int D>
std::vector<Int128> Sensors<X, D>::impulse_of(std::vector<double>::const_iterator from,
                                              int pieces) const {
    std::vector<Int128> sum(D, 0);
    for (int k = 0; k < D * pieces; ++k)
        sum[std::size_t(k / pieces)] += exact(from[k], load_scale(k / pieces));
    return sum;
}

template <class X, int D>
std::vector<double> Sensors<X, D>::in_pieces(const Buffer<X, Int128>& sums, int columns,
                                             double (Sensors::*scale)(int) const) const {
    std::vector<double> out;
    const auto all = sums.host();
    for (std::size_t k = 0; k < all.size(); ++k) {
        double pieces[exact_pieces];
        to_pieces(all[k], pieces);
        for (int j = 0; j < exact_pieces; ++j)
            out.push_back(std::ldexp(pieces[j], j * piece_bits) / (this->*scale)(int(k) % columns));
    }
    return out;
}

template <class X, int D>
void Sensors<X, D>::take_impulse(const std::vector<double>& saved, std::size_t known,
                                 SensorKind kind, int columns, double (Sensors::*scale)(int) const,
                                 Buffer<X, Int128>& to) const {
    std::size_t sums = 0;  // of the sensors that the state knows
    for (std::size_t k = 0; k < std::min(known, sensors_.size()); ++k)
        if (sensors_[k].spec.kind == kind) sums += std::size_t(columns);
    std::vector<Int128> all(to.size(), 0);
    // States of earlier versions have one number for each.
    const std::size_t pieces = saved.size() == sums ? 1 : exact_pieces;
    if (saved.size() > all.size() * pieces)
        throw SceneError("the saved state has other sensors than this scene");
    for (std::size_t k = 0; k < saved.size(); ++k)
        all[k / pieces] += exact(saved[k], (this->*scale)(int(k / pieces) % columns));
    to.assign(all);
}

template <class X, int D>
void Sensors<X, D>::restore(const std::vector<std::int64_t>& next, const std::vector<double>& last,
                            const std::vector<double>& first, const std::vector<double>& impulse,
                            const Clock& clock) {
    auto records = records_.host();
    if (next.size() > records.size() || last.size() != next.size() || first.size() != next.size())
        throw SceneError("the saved state has other sensors than this scene");
    for (std::size_t k = 0; k < records.size(); ++k) {
        const bool known = k < next.size();
        const double interval = records[k].interval;
        records[k].next = known          ? next[k]
                          : interval > 0 ? std::int64_t(clock.time / interval)
                                         : clock.step;
        records[k].last_time = known ? last[k] : clock.time;
        records[k].count = 0;
        if (known) sensors_[k].first.assign({first[k]});
    }
    take_impulse(impulse, next.size(), SensorKind::load_cell, load_columns<D>, &Sensors::load_scale,
                 load_impulse_);
    records_.assign(records);
}

}  // namespace mpm
