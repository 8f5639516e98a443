#include "mpm/solver/rigid_bodies.hpp"

#include <algorithm>
#include <cmath>
#include <map>

#include "mpm/core/error.hpp"

namespace mpm {

namespace {

/// Sweeps at most, and the change of velocity, by the largest there is, at which they end.
constexpr int most_sweeps = 200;
constexpr double calm = 1e-8;
/// Part of its speed by which a given velocity may differ from a rigid motion.
constexpr double off_motion = 1e-6;

template <int D>
double dot(const Vec<double, D>& a, const Vec<double, D>& b) {
    double s = 0;
    for (int k = 0; k < D; ++k) s += a[k] * b[k];
    return s;
}

/// Inertia about the centre in space: the sum of m (r.r 1 - r r^T), or its only component.
template <int D>
void add_inertia(const double (&r)[D], double mass, Mat<double, 3>& sum) {
    double square = 0;
    for (const double x : r) square += x * x;
    if constexpr (D == 2) {
        sum.e[2][2] += mass * square;
    } else {
        for (int a = 0; a < 3; ++a)
            for (int b = 0; b < 3; ++b)
                sum.e[a][b] += mass * ((a == b ? square : 0.0) - r[a] * r[b]);
    }
}

/// Particles beside which there is none in some direction, of the 8 or 26 along axes and diagonals:
/// within half of a right angle and 1.6 spacings.
template <int D>
std::vector<std::uint32_t> on_surface(const std::vector<std::array<double, D>>& places,
                                      double spacing) {
    constexpr double reach = 1.6, cosine = 0.7;
    using Cell = std::array<std::int64_t, D>;
    const double edge = reach * spacing;
    std::map<Cell, std::vector<std::uint32_t>> cells;
    const auto cell_of = [&](const std::array<double, D>& x) {
        Cell c;
        for (std::size_t a = 0; a < D; ++a) c[a] = std::int64_t(std::floor(x[a] / edge));
        return c;
    };
    for (std::size_t k = 0; k < places.size(); ++k)
        cells[cell_of(places[k])].push_back(std::uint32_t(k));
    constexpr int around = D == 2 ? 9 : 27;
    const auto offset = [](int n, std::size_t a) {
        for (std::size_t b = 0; b < a; ++b) n /= 3;
        return n % 3 - 1;
    };
    std::vector<std::uint32_t> out;
    for (std::size_t k = 0; k < places.size(); ++k) {
        bool seen[around] = {};
        for (int n = 0; n < around; ++n) {
            Cell c = cell_of(places[k]);
            for (std::size_t a = 0; a < D; ++a) c[a] += offset(n, a);
            const auto found = cells.find(c);
            if (found == cells.end()) continue;
            for (const std::uint32_t other : found->second) {
                double d[D], square = 0;
                for (std::size_t a = 0; a < D; ++a) {
                    d[a] = places[other][a] - places[k][a];
                    square += d[a] * d[a];
                }
                if (other == k || square > edge * edge) continue;
                for (int way = 0; way < around; ++way) {
                    double along = 0, size = 0;
                    for (std::size_t a = 0; a < D; ++a) {
                        along += d[a] * offset(way, a);
                        size += offset(way, a) * offset(way, a);
                    }
                    seen[way] = seen[way] || along > cosine * std::sqrt(square * size);
                }
            }
        }
        seen[around / 2] = true;  // no direction
        if (!std::all_of(seen, seen + around, [](bool s) { return s; }))
            out.push_back(std::uint32_t(k));
    }
    return out;
}

}  // namespace

template <int D>
int RigidBodies<D>::add(const BodySpec& s, const std::vector<double>& position, double density) {
    const std::string who = "body '" + s.name + "'";
    const std::size_t n = position.size() / D;
    Body b;
    b.name = s.name;
    b.field = s.fields.empty() ? 0 : s.fields[0].field;
    b.shape.mass = double(n) * s.particle_mass;
    for (const int axis : s.rigid.held) b.shape.held[axis] = true;
    b.shape.held_turn = s.rigid.held_turn;
    b.state = {};
    for (std::size_t k = 0; k < n; ++k)
        for (int a = 0; a < D; ++a) b.state.centre[a] += position[k * D + std::size_t(a)];
    for (int a = 0; a < D; ++a) b.state.centre[a] /= double(n);

    Mat<double, 3> points{}, whole{};
    const auto from_centre = [&](std::size_t k, double(&r)[D]) {
        for (int a = 0; a < D; ++a) r[a] = position[k * D + std::size_t(a)] - b.state.centre[a];
    };
    for (std::size_t k = 0; k < n; ++k) {
        double r[D];
        from_centre(k, r);
        add_inertia<D>(r, s.particle_mass, points);
    }
    whole = points;
    // A particle is a square or a cube of its volume.
    const double edge = std::pow(s.particle_mass / density, 1.0 / D);
    for (int a = 0; a < 3; ++a) whole.e[a][a] += b.shape.mass * edge * edge / 6;
    if (!s.rigid.inertia.empty()) {
        if constexpr (D == 2) {
            whole.e[2][2] = s.rigid.inertia[0];
        } else {
            for (int a = 0; a < 3; ++a)
                for (int c = 0; c < 3; ++c) whole.e[a][c] = s.rigid.inertia[std::size_t(3 * a + c)];
        }
    }
    Mat<double, D> axes{};
    if constexpr (D == 2) {
        b.shape.inertia[0] = whole.e[2][2];
        axes.e[0][0] = axes.e[1][1] = 1;
    } else {
        const Spectrum<double, 3> found = spectrum(whole);
        axes = found.axes;
        const auto& e = axes.e;
        const double size = e[0][0] * (e[1][1] * e[2][2] - e[1][2] * e[2][1]) -
                            e[0][1] * (e[1][0] * e[2][2] - e[1][2] * e[2][0]) +
                            e[0][2] * (e[1][0] * e[2][1] - e[1][1] * e[2][0]);
        for (int a = 0; a < 3 && size < 0; ++a) axes.e[a][2] = -axes.e[a][2];
        for (int k = 0; k < 3; ++k) b.shape.inertia[k] = found.value[k];
        quaternion_of(axes, b.state.turn);
        axes = rotation_of<3>(b.state.turn);
    }
    for (int k = 0; k < spins<D>; ++k)
        if (!(b.shape.inertia[k] > 0))
            throw SceneError(who + " has the principal inertia " +
                             std::to_string(b.shape.inertia[k]) +
                             " kg m^2; expected above 0; correct its inertia, or leave it out");
    std::copy_n(b.state.turn, turns<D>, b.begun);

    b.places.resize(n);
    for (std::size_t k = 0; k < n; ++k) {
        double r[D];
        from_centre(k, r);
        for (int i = 0; i < D; ++i) {
            b.places[k][std::size_t(i)] = 0;
            for (int a = 0; a < D; ++a) b.places[k][std::size_t(i)] += axes.e[a][i] * r[a];
        }
        double square = 0;
        for (const double x : r) square += x * x;
        b.furthest = std::max(b.furthest, std::sqrt(square));
    }
    b.half = edge / 2;
    b.outer = on_surface<D>(b.places, edge);

    // The rigid motion of what its particles are given.
    const auto given = [&](std::size_t k, int a) {
        const std::size_t d = D;
        return s.velocity.size() == d ? s.velocity[std::size_t(a)]
                                      : s.velocity[k * d + std::size_t(a)];
    };
    double moment[spins<D>] = {}, spin[spins<D>] = {}, fastest = 0;
    for (std::size_t k = 0; k < n; ++k)
        for (int a = 0; a < D; ++a) b.state.velocity[a] += given(k, a);
    for (int a = 0; a < D; ++a) b.state.velocity[a] /= double(n);
    if (s.velocity.size() > std::size_t(D)) {
        for (std::size_t k = 0; k < n; ++k) {
            double r[D];
            from_centre(k, r);
            Vec<double, D> at, v;
            for (int a = 0; a < D; ++a) {
                at[a] = r[a];
                v[a] = given(k, a) - b.state.velocity[a];
            }
            add_moment<D>(at, v, s.particle_mass, moment);
        }
        if constexpr (D == 2) {
            spin[0] = points.e[2][2] > 0 ? moment[0] / points.e[2][2] : 0.0;
        } else {
            const Spectrum<double, 3> of = spectrum(points);
            double most = 0;
            for (int k = 0; k < 3; ++k) most = std::max(most, of.value[k]);
            for (int k = 0; k < 3; ++k) {
                if (!(of.value[k] > 1e-12 * most)) continue;
                double along = 0;
                for (int a = 0; a < 3; ++a) along += of.axes.e[a][k] * moment[a];
                for (int a = 0; a < 3; ++a) spin[a] += of.axes.e[a][k] * along / of.value[k];
            }
        }
        double off = 0;
        for (std::size_t k = 0; k < n; ++k) {
            double r[D];
            from_centre(k, r);
            Vec<double, D> at;
            for (int a = 0; a < D; ++a) at[a] = r[a];
            const Vec<double, D> v = velocity_at<D>(b.state.velocity, spin, at);
            for (int a = 0; a < D; ++a) {
                off = std::max(off, std::abs(v[a] - given(k, a)));
                fastest = std::max(fastest, std::abs(given(k, a)));
            }
        }
        if (off > off_motion * fastest)
            throw SceneError(who + ": its velocity differs by " + std::to_string(off) +
                             " m/s from that of a rigid motion; expected v + ω × (x - centre); "
                             "give it such a field");
    }
    if (D == 3 && b.shape.held_turn)
        for (int a = 0; a < spins<D>; ++a)
            if (spin[a] != 0)
                throw SceneError(who +
                                 " turns at the start and its rotation is held; expected one "
                                 "that does not turn; leave \"rotation\" out of held");
    if constexpr (D == 2) {
        b.state.momentum[0] = b.shape.inertia[0] * spin[0];
    } else {
        for (int k = 0; k < 3; ++k) {
            double along = 0;
            for (int a = 0; a < 3; ++a) along += axes.e[a][k] * spin[a];
            for (int a = 0; a < 3; ++a)
                b.state.momentum[a] += axes.e[a][k] * b.shape.inertia[k] * along;
        }
    }
    b.next = b.state;
    b.axes = axes;
    std::copy_n(spin, spins<D>, b.spin);
    bodies_.push_back(std::move(b));
    return int(bodies_.size()) - 1;
}

template <int D>
void RigidBodies<D>::begin(const double* gravity, double dt) {
    for (Body& b : bodies_) {
        b.next = b.state;
        for (int a = 0; a < D; ++a)
            if (!b.shape.held[a]) b.next.velocity[a] += dt * gravity[a];
        b.axes = rotation_of<D>(b.state.turn);
        spin_of<D>(b.shape, b.axes, b.next.momentum, b.spin);
    }
}

/// A point with what an impulse does there.
template <int D>
struct RigidBodies<D>::Row {
    RigidPoint<D>& p;
    Vec<double, D> arm[2];   // from the centres of the bodies
    Vec<double, D> axis[D];  // normal, then along the face
    double push;             // velocity along the normal by an impulse along it, 1/kg
    double inverse[D][D];    // stick: of all axes; else of those along the face

    static Vec<double, D> cross_normal(const Vec<double, D>& n) {
        if constexpr (D == 2) {
            return {-n[1], n[0]};
        } else {
            int least = 0;
            for (int a = 1; a < 3; ++a)
                if (std::abs(n[a]) < std::abs(n[least])) least = a;
            Vec<double, D> t{};
            t[least] = 1;
            const double along = n[least];
            double square = 0;
            for (int a = 0; a < 3; ++a) {
                t[a] -= along * n[a];
                square += t[a] * t[a];
            }
            for (int a = 0; a < 3; ++a) t[a] /= std::sqrt(square);
            return t;
        }
    }
};

template <int D>
RigidSweeps RigidBodies<D>::solve(std::vector<RigidPoint<D>>& points,
                                  std::vector<FreeNode<D>>& nodes) {
    RigidSweeps out;
    if (points.empty()) return out;
    // Angular velocity of a body by an angular impulse.
    const auto turned = [&](const Body& b, const double(&moment)[spins<D>],
                            double(&spin)[spins<D>]) {
        for (double& x : spin) x = 0;
        if (!b.shape.held_turn) spin_of<D>(b.shape, b.axes, moment, spin);
    };
    const auto response = [&](std::int32_t k, const Vec<double, D>& arm, const Vec<double, D>& by,
                              const Vec<double, D>& along) {
        const Body& b = bodies_[std::size_t(k)];
        double moment[spins<D>] = {}, spin[spins<D>], sum = 0;
        add_moment<D>(arm, by, 1, moment);
        turned(b, moment, spin);
        const Vec<double, D> v = velocity_at<D>(Vec<double, D>{}, spin, arm);
        for (int a = 0; a < D; ++a) sum += along[a] * (v[a] + b.shape.give(a) * by[a]);
        return sum;
    };
    std::vector<Row> rows;
    rows.reserve(points.size());
    for (RigidPoint<D>& p : points) {
        p.impulse = {};
        Row row{p, {}, {}, 0, {}};
        const std::int32_t of[2] = {p.body, p.other};
        for (int k = 0; k < 2; ++k)
            for (int a = 0; a < D && of[k] >= 0; ++a)
                row.arm[k][a] = p.place[a] - bodies_[std::size_t(of[k])].state.centre[a];
        if (p.hold == RigidHold::stick) {
            for (int a = 0; a < D; ++a) {
                row.axis[a] = {};
                row.axis[a][a] = 1;
            }
        } else {
            row.axis[0] = p.normal;
            row.axis[1] = Row::cross_normal(p.normal);
            if constexpr (D == 3) {
                const auto &n = row.axis[0], &t = row.axis[1];
                row.axis[2] = {n[1] * t[2] - n[2] * t[1], n[2] * t[0] - n[0] * t[2],
                               n[0] * t[1] - n[1] * t[0]};
            }
        }
        double k[D][D];
        for (int i = 0; i < D; ++i) {
            for (int j = 0; j < D; ++j) {
                k[i][j] = 0;
                for (int s = 0; s < 2; ++s)
                    if (of[s] >= 0)
                        k[i][j] += response(of[s], row.arm[s], row.axis[j], row.axis[i]);
            }
            if (p.free >= 0) k[i][i] += i == 0 || p.hold == RigidHold::stick ? p.along : p.across;
        }
        row.push = k[0][0];
        if (p.hold == RigidHold::stick) {
            Mat<double, D> m;
            for (int i = 0; i < D; ++i)
                for (int j = 0; j < D; ++j) m.e[i][j] = k[i][j];
            const Spectrum<double, D> s = spectrum(m);
            double most = 0;
            for (int i = 0; i < D; ++i) most = std::max(most, s.value[i]);
            for (int i = 0; i < D; ++i)
                for (int j = 0; j < D; ++j) {
                    row.inverse[i][j] = 0;
                    for (int e = 0; e < D; ++e)
                        if (s.value[e] > 1e-12 * most)
                            row.inverse[i][j] += s.axes.e[i][e] * s.axes.e[j][e] / s.value[e];
                }
        } else if constexpr (D == 2) {
            row.inverse[1][1] = k[1][1] > 0 ? 1 / k[1][1] : 0.0;
        } else {
            const double det = k[1][1] * k[2][2] - k[1][2] * k[2][1];
            const double of_det = det > 1e-12 * k[1][1] * k[2][2] ? 1 / det : 0.0;
            row.inverse[1][1] = k[2][2] * of_det;
            row.inverse[2][2] = k[1][1] * of_det;
            row.inverse[1][2] = -k[1][2] * of_det;
            row.inverse[2][1] = -k[2][1] * of_det;
        }
        rows.push_back(row);
    }

    const auto approach = [&](const Row& row) {
        const RigidPoint<D>& p = row.p;
        const Body& b = bodies_[std::size_t(p.body)];
        Vec<double, D> w = velocity_at<D>(b.next.velocity, b.spin, row.arm[0]), u = p.wall;
        if (p.other >= 0) {
            const Body& o = bodies_[std::size_t(p.other)];
            u = velocity_at<D>(o.next.velocity, o.spin, row.arm[1]);
        } else if (p.free >= 0) {
            u = nodes[std::size_t(p.free)].velocity;
        }
        for (int a = 0; a < D; ++a) w[a] -= u[a];
        return w;
    };
    // Impulse j on what is met, by the row's axes.
    const auto apply = [&](Row& row, const double(&j)[D]) {
        RigidPoint<D>& p = row.p;
        Vec<double, D> in_space{};
        for (int i = 0; i < D; ++i)
            for (int a = 0; a < D; ++a) in_space[a] += j[i] * row.axis[i][a];
        for (int a = 0; a < D; ++a) p.impulse[a] += in_space[a];
        const auto push = [&](std::int32_t k, const Vec<double, D>& arm, double sign) {
            Body& b = bodies_[std::size_t(k)];
            double moment[spins<D>] = {}, spin[spins<D>];
            add_moment<D>(arm, in_space, sign, moment);
            turned(b, moment, spin);
            for (int a = 0; a < D; ++a) {
                b.next.velocity[a] += sign * b.shape.give(a) * in_space[a];
                b.next.impulse[a] += sign * in_space[a];
            }
            for (int a = 0; a < spins<D>; ++a) {
                b.spin[a] += spin[a];
                if (!b.shape.held_turn) b.next.momentum[a] += moment[a];
                b.next.moment[a] += moment[a];
            }
        };
        push(p.body, row.arm[0], -1);
        if (p.other >= 0) push(p.other, row.arm[1], 1);
        if (p.free >= 0) {
            FreeNode<D>& node = nodes[std::size_t(p.free)];
            node.pushed = true;
            for (int a = 0; a < D; ++a) {
                double moved = in_space[a] / node.mass;
                if (p.hold != RigidHold::stick) {
                    moved = p.along * j[0] * row.axis[0][a];
                    for (int i = 1; i < D; ++i) moved += p.across * j[i] * row.axis[i][a];
                }
                node.velocity[a] += moved;
                node.taken[a] += in_space[a] - node.mass * moved;
            }
        }
    };

    double largest = 0;
    for (const Row& row : rows) {
        const Vec<double, D> w = approach(row);
        largest = std::max(largest, std::sqrt(dot<D>(w, w)));
    }
    std::vector<std::array<double, D>> sum(rows.size());  // impulses by the rows' axes
    for (auto& s : sum) s.fill(0);
    const auto visit = [&](std::size_t r) {
        Row& row = rows[r];
        const RigidPoint<D>& p = row.p;
        double j[D] = {}, changed = 0;
        if (p.hold == RigidHold::stick) {
            const Vec<double, D> w = approach(row);
            for (int i = 0; i < D; ++i)
                for (int k = 0; k < D; ++k) j[i] += row.inverse[i][k] * w[k];
            changed = std::sqrt(dot<D>(w, w));
            for (int i = 0; i < D; ++i) sum[r][std::size_t(i)] += j[i];
            apply(row, j);
            return changed;
        }
        if (!(row.push > 0)) return 0.0;
        const double speed = dot<D>(approach(row), row.axis[0]) - p.allowed;
        double normal = sum[r][0] + speed / row.push;
        if (p.hold == RigidHold::push && normal < 0) normal = 0;
        j[0] = normal - sum[r][0];
        changed = std::abs(j[0]) * row.push;
        if (j[0] != 0) apply(row, j);
        sum[r][0] = normal;
        if (p.hold == RigidHold::guide || !(p.static_friction > 0 || p.dynamic_friction > 0))
            return changed;
        const Vec<double, D> w = approach(row);
        double across[D] = {}, size = 0, step[D] = {};
        for (int i = 1; i < D; ++i) {
            across[i] = sum[r][std::size_t(i)];
            for (int k = 1; k < D; ++k) across[i] += row.inverse[i][k] * dot<D>(w, row.axis[k]);
            size += across[i] * across[i];
        }
        size = std::sqrt(size);
        const double limit = p.dynamic_friction * normal;
        const double keep =
            size <= p.static_friction * normal || size <= limit ? 1.0 : limit / size;
        double moved = 0;
        for (int i = 1; i < D; ++i) {
            step[i] = keep * across[i] - sum[r][std::size_t(i)];
            sum[r][std::size_t(i)] += step[i];
            moved += step[i] * step[i];
        }
        if (moved > 0) {
            apply(row, step);
            changed = std::max(changed, std::sqrt(moved) * row.push);
        }
        return changed;
    };
    while (out.sweeps < most_sweeps) {
        out.left = 0;
        const bool forward = out.sweeps % 2 == 0;
        for (std::size_t k = 0; k < rows.size(); ++k)
            out.left = std::max(out.left, visit(forward ? k : rows.size() - 1 - k));
        ++out.sweeps;
        if (!(out.left > calm * largest)) break;
    }
    return out;
}

template <int D>
void RigidBodies<D>::advance(std::size_t k, double dt) {
    Body& b = bodies_[k];
    b.state = b.next;
    for (int a = 0; a < D; ++a) b.state.centre[a] += dt * b.state.velocity[a];
    turn_freely<D>(b.shape, b.state, dt);
    b.next = b.state;
    b.axes = rotation_of<D>(b.state.turn);
    spin_of<D>(b.shape, b.axes, b.state.momentum, b.spin);
}

template <int D>
std::array<double, turns<D>> RigidBodies<D>::orientation(std::size_t k) const {
    const Body& b = bodies_[k];
    std::array<double, turns<D>> out;
    if constexpr (D == 2) {
        out[0] = b.state.turn[0] - b.begun[0];
    } else {
        const double back[4] = {b.begun[0], -b.begun[1], -b.begun[2], -b.begun[3]};
        double q[4];
        turn_by(b.state.turn, back, q);
        const double sign = q[0] < 0 ? -1 : 1;
        for (std::size_t i = 0; i < 4; ++i) out[i] = sign * q[i];
    }
    return out;
}

template <int D>
std::vector<double> RigidBodies<D>::saved(std::size_t k) const {
    const RigidState<D>& s = bodies_[k].state;
    std::vector<double> out;
    const auto add = [&](const double* from, int n) { out.insert(out.end(), from, from + n); };
    add(s.centre.e, D);
    add(s.velocity.e, D);
    add(s.momentum, spins<D>);
    add(s.turn, turns<D>);
    add(s.impulse, D);
    add(s.moment, spins<D>);
    return out;
}

template <int D>
void RigidBodies<D>::restore(std::size_t k, const std::vector<double>& saved) {
    Body& b = bodies_[k];
    const double* from = saved.data();
    const auto take = [&](double* to, int n) {
        std::copy_n(from, n, to);
        from += n;
    };
    take(b.state.centre.e, D);
    take(b.state.velocity.e, D);
    take(b.state.momentum, spins<D>);
    take(b.state.turn, turns<D>);
    take(b.state.impulse, D);
    take(b.state.moment, spins<D>);
    b.next = b.state;
    b.axes = rotation_of<D>(b.state.turn);
    spin_of<D>(b.shape, b.axes, b.state.momentum, b.spin);
}

template class RigidBodies<2>;
template class RigidBodies<3>;

}  // namespace mpm
