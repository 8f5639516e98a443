// Domain: what sensors hear of rigid bodies: energy, loads and motion.
#pragma once

#include "mpm/solver/domain.hpp"

namespace mpm {

/// Kinetic and potential energy of a rigid body, in the first of its homes.
template <class X, class T, int D>
void Domain<X, T, D>::add_rigid_energy(Body& body, const std::int32_t* due, double* partial) {
    if constexpr (!X::is_device) {
        if (!*due) return;
        std::fill_n(partial, std::size_t(body.homes) * 3, 0.0);
        const auto& b = rigid_.at(std::size_t(body.rigid));
        partial[0] = kinetic_energy<D>(b.shape, b.next);
        for (int a = 0; a < D; ++a)
            partial[2] -= b.shape.mass * clock_buffer_.data()->gravity[a] * b.state.centre[a];
    }
}

/// What load cells and sensors of contacts hear of rigid bodies in this step.
template <class X, class T, int D>
void Domain<X, T, D>::tell_rigid_loads() {
    if constexpr (!X::is_device) {
        if (!rigid_.any() || clock_buffer_.data()->halt != Halt::none) return;
        const auto loads = sensors_.take_load(clock_buffer_.data());
        for (int k = 0; k < sensors_.load_count(); ++k) {
            const LoadCellRecord<D>& cell = sensors_.load_cells()[k];
            Int128* sum = loads.impulse + k * load_columns<D>;
            for (const RigidWall<D>& w : rigid_walls_) {
                if (w.boundary != cell.boundary || !(cell.faces >> w.face & 1)) continue;
                Vec<double, D> arm;
                double moment[spins<D>] = {};
                for (int a = 0; a < D; ++a) {
                    sum[a] += exact(w.impulse[a], loads.scale[a]);
                    arm[a] = w.place[a] - cell.reference[a];
                }
                add_moment<D>(arm, w.impulse, 1, moment);
                for (int a = 0; a < spins<D>; ++a)
                    sum[D + a] += exact(moment[a], loads.scale[D + a]);
            }
        }
        const auto contacts = sensors_.take_contact(clock_buffer_.data());
        for (int k = 0; k < sensors_.contact_count(); ++k) {
            const ContactLoadRecord& sensor = sensors_.contact_loads()[k];
            Int128* sum = contacts.impulse + k * contact_columns<D>;
            for (const RigidPoint<D>& p : rigid_points_) {
                if (p.boundary >= 0 || p.hold != RigidHold::push) continue;
                const int low = p.fields[0] < p.fields[1] ? 0 : 1;
                if (sensor.fields[0] >= 0 &&
                    (p.fields[low] != sensor.fields[0] || p.fields[1 - low] != sensor.fields[1]))
                    continue;
                const int side =
                    sensors_
                        .contact_sides()[sensor.sides + p.kinds[low] * std::int32_t(kind_count()) +
                                         p.kinds[1 - low]];
                if (side == 0) continue;
                // The impulse is that on the second of the point's own order.
                const double sign = side * (low == 0 ? 1 : -1);
                double push = 0, square = 0, work = 0;
                const Vec<double, D> mine = rigid_.next_velocity(std::size_t(p.body), p.place),
                                     theirs =
                                         p.other >= 0
                                             ? rigid_.next_velocity(std::size_t(p.other), p.place)
                                             : rigid_free_[std::size_t(p.free)].velocity;
                for (int a = 0; a < D; ++a) push += p.impulse[a] * p.normal[a];
                for (int a = 0; a < D; ++a) {
                    const double across = p.impulse[a] - push * p.normal[a];
                    square += across * across;
                    work += across * (mine[a] - theirs[a]);
                    sum[a] += exact(sign * p.impulse[a], contacts.scale[a]);
                }
                sum[D] += exact(push, contacts.scale[D]);
                sum[D + 1] += exact(std::sqrt(square), contacts.scale[D + 1]);
                sum[D + 2] += exact(work, contacts.scale[D + 2]);
            }
        }
    }
}

/// A row of the motion of a body: place, velocity, rate of turn, orientation, and the mean force
/// and moment of others on it since the row before.
template <class X, class T, int D>
void Domain<X, T, D>::sample_rigid(Sensor<Base>& s, SensorRecord& record) {
    if constexpr (!X::is_device) {
        const Body& body = bodies_.at(std::size_t(s.spec.body));
        const auto& b = rigid_.at(std::size_t(body.rigid));
        const double time = clock_buffer_.data()->time, elapsed = time - record.last_time;
        const bool first = record.last_time < 0 || s.told.empty();
        if (s.told.empty()) s.told.assign(std::size_t(D + spins<D>), 0.0);
        double* row = open_row(record, time);
        const auto put = [&](const double* from, int n) { row = std::copy_n(from, n, row); };
        put(b.state.centre.e, D);
        put(b.next.velocity.e, D);
        put(b.spin, spins<D>);
        const auto turn = rigid_.orientation(std::size_t(body.rigid));
        put(turn.data(), turns<D>);
        std::vector<double> now(b.state.impulse, b.state.impulse + D);
        now.insert(now.end(), b.state.moment, b.state.moment + spins<D>);
        for (std::size_t a = 0; a < now.size(); ++a)
            *row++ = first || !(elapsed > 0) ? std::numeric_limits<double>::quiet_NaN()
                                             : (now[a] - s.told[a]) / elapsed;
        s.told = now;
        record.last_time = time;
    }
}

}  // namespace mpm
