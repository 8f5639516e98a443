// Domain: rigid bodies. Their particles carry mass to the grid as others do; what holds and pushes
// them there is solved for body by body, and particles go where their bodies are (design/rigid.md).
#pragma once

#include "mpm/kernels/phase.hpp"
#include "mpm/solver/domain.hpp"

namespace mpm {

/// A rigid body holds the nodes of a fluid that it fills so much of, 0.72 cells from a flat face
/// on. It is heavier than what it has at a node, so that nothing else says how much of the fluid
/// there it may hold, and with nodes further out the fluid moves as if the body were larger
/// (design/rigid.md).
inline constexpr double least_of_rigid = 0.08;

/// Calls f(home cell in the domain, particle) for the particles of a home block.
template <class T, int D, class F>
void for_each_in_block(const BodyView<T, D>& body, const BlockTableView<D>& table,
                       std::int32_t slot, const F& f) {
    const std::uint32_t* start = body.cell_start + std::int64_t(slot) * block_cells;
    for (int c = 0; c < block_cells; ++c) {
        if (start[c] == start[c + 1]) continue;
        int home[D];
        std::int64_t cell[D];
        Block<D>::coordinates(c, home);
        for (int a = 0; a < D; ++a) cell[a] = table.corners[std::int64_t(slot) * D + a] + home[a];
        for (std::uint32_t q = start[c]; q < start[c + 1]; ++q) f(cell, q);
    }
}

template <class X, class T, int D>
void Domain<X, T, D>::make_rigid(Body& body, const BodySpec& s) {
    if constexpr (!X::is_device) {
        std::vector<double> position(std::size_t(s.count) * D);
        s.position(0, s.count, position.data());
        body.rigid = rigid_.add(s, position, body.material->density(s.parameters.data()));
    }
}

/// The blocks with nodes of rigid bodies, and which slots are theirs.
template <class X, class T, int D>
void Domain<X, T, D>::list_rigid() {
    if (!rigid_.any()) return;
    const auto keys = blocks_.keys().host();
    const std::uint64_t fields = std::uint64_t(table_.keys_of.fields);
    const std::uint64_t bending = std::uint64_t(spec_.contact.bending());
    rigid_blocks_.clear();
    for (std::size_t slot = 0, next = 0; slot < keys.size(); slot = next) {
        RigidBlock block{std::int32_t(slot), 0, 0};
        while (next < keys.size() && keys[next] / fields == keys[slot] / fields) {
            if (keys[next] % fields < bending) ++block.bending;
            ++next;
        }
        block.all = std::int32_t(next - slot);
        if (block.all > block.bending) rigid_blocks_.push_back(block);
    }
    body_of_field_.assign(fields, -1);
    for (std::size_t k = 0; k < rigid_.count(); ++k)
        body_of_field_[std::size_t(rigid_.at(k).field)] = std::int32_t(k);
}

/// Load cells measure nodes whose bodies bend; what they take of rigid ones is known.
template <class X, class T, int D>
const std::uint8_t* Domain<X, T, D>::counted_for_loads() {
    if (share_) return counts_.data();
    if (!rigid_.any()) return nullptr;
    std::vector<std::uint8_t> counts;
    for (const std::uint64_t key : blocks_.keys().host())
        counts.push_back(table_.keys_of.field(key) < spec_.contact.bending() ? 1 : 0);
    counts_.assign(counts);
    return counts_.data();
}

namespace detail {

/// Calls f(face, outward normal, distance in m, velocity, law) for each wall of a boundary near a
/// place; the distance is negative inside.
template <int D, class F>
void for_each_wall(const BoundaryView<D>& all, int b, const Vec<double, D>& x, double near,
                   const F& f) {
    const BoundaryRecord<D>& r = all.records[b];
    Vec<double, D> own;
    for (int a = 0; a < D; ++a) own[a] = r.velocity[a];
    for (int a = 0; a < D && r.limited; ++a)
        if (!(x[a] >= r.within_lower[a] && x[a] <= r.within_upper[a])) return;
    if (r.surface > 0) {
        const SurfaceRecord<D>& s = all.surfaces[r.surface - 1];
        double at[D], there[D], normal[D], distance, wall[D];
        for (int a = 0; a < D; ++a) at[a] = x[a];
        s.to_body(at, there);
        if (!s.field.at(there, distance, normal) || !(distance < near)) return;
        s.velocity_at(at, wall);
        Vec<double, D> n;
        double square = 0;
        for (int a = 0; a < D; ++a) {
            n[a] = 0;
            for (int c = 0; c < D; ++c) n[a] += s.rotation[a][c] * normal[c];
            square += n[a] * n[a];
            own[a] += wall[a];
        }
        if (!(square > 0)) return;
        for (int a = 0; a < D; ++a) n[a] /= std::sqrt(square);
        f(0, n, distance, own, r.law[0]);
        return;
    }
    if (!r.is_box) {
        for (int k = 0; k < 2 * D; ++k) {
            if (!r.present[k]) continue;
            const int a = k / 2;
            const double distance =
                k % 2 == 0 ? x[a] - r.lower[a] * all.cell_size : r.upper[a] * all.cell_size - x[a];
            if (!(distance < near)) continue;
            Vec<double, D> n{};
            n[a] = k % 2 == 0 ? 1 : -1;
            f(k, n, distance, own, r.law[k]);
        }
        return;
    }
    // Of a box its nearest point; inside, its nearest face.
    Vec<double, D> beyond{};
    double square = 0, least = 0;
    int face = -1, nearest = 0;
    for (int a = 0; a < D; ++a) {
        const double low = r.lower[a] * all.cell_size - x[a],
                     high = x[a] - r.upper[a] * all.cell_size;
        beyond[a] = low > 0 ? -low : (high > 0 ? high : 0.0);
        square += beyond[a] * beyond[a];
        if (beyond[a] != 0 && (face < 0 || std::abs(beyond[a]) > std::abs(beyond[face / 2])))
            face = 2 * a + (high > 0 ? 1 : 0);
        const double deep = std::max(low, high);
        if (a == 0 || deep > least) {
            least = deep;
            nearest = 2 * a + (high > low ? 1 : 0);
        }
    }
    const double distance = square > 0 ? std::sqrt(square) : least;
    if (!(distance < near)) return;
    Vec<double, D> n{};
    if (square > 0) {
        for (int a = 0; a < D; ++a) n[a] = beyond[a] / distance;
    } else {
        face = nearest;
        n[face / 2] = face % 2 == 0 ? -1 : 1;
    }
    f(face, n, distance, own, r.law[face]);
}

}  // namespace detail

/// What walls and other bodies leave of the motions of rigid bodies in this step; velocities of
/// their nodes, and of those that they push. From sums and velocities that nobody else changes, so
/// that it may be done again.
template <class X, class T, int D>
void Domain<X, T, D>::resolve_rigid(double (&maxima)[maxima_count]) {
    if constexpr (!X::is_device) {
        const Clock& clock = *clock_buffer_.data();
        if (clock.halt != Halt::none) return;
        const auto node = node_update(parity());
        const ContactView contact = contact_view();
        const NodeContact<Grid, Sum, D> meeting{node, contact};
        using Fields = typename NodeContact<Grid, Sum, D>::Fields;
        const double dx = spec_.cell_size, cells_per_step = dx / clock.dt;
        rigid_points_.clear();
        rigid_free_.clear();
        std::vector<RigidMeeting>& met = rigid_met_;
        met.clear();
        rigid_.begin(clock.gravity, clock.dt);
        for (std::size_t k = 0; k < rigid_.count(); ++k) keep_before_walls(k);

        const auto field_of = [&](std::int32_t slot) {
            return std::int32_t(table_.keys_of.field(table_.keys[slot]));
        };
        for (const RigidBlock& block : rigid_blocks_) {
            for (int n = 0; n < block_cells; ++n) {
                bool any = false;
                for (std::int32_t k = block.bending; k < block.all && !any; ++k)
                    any = node.mass(block.first + k, n) > Grid(0);
                if (!any) continue;
                std::int64_t cell[D];
                node.cell(block.first, n, cell);
                double at[D];
                node_position<D>(cell, dx, at);
                Vec<double, D> place;
                for (int a = 0; a < D; ++a) place[a] = at[a];
                // Bodies that bend, those that are stuck to each other as one.
                Fields f;
                if (block.bending > 0) meeting.find(block.first, block.bending, n, f);
                std::int32_t free_of[most_fields_at_node];
                const std::size_t met_before = met.size();
                for (int i = 0; i < f.count; ++i) {
                    if (f.of[i] != i) {
                        free_of[i] = free_of[f.of[i]];
                        met.push_back({free_of[i], f.slot[i], n});
                        continue;
                    }
                    FreeNode<D> free{};
                    free.mass = 0;
                    for (int k = i; k < f.count; ++k)
                        if (f.of[k] == i) free.mass += double(f.mass[k]);
                    const Grid* v = node.grid.velocity + node.grid.velocity_place(f.slot[i], n);
                    for (int a = 0; a < D; ++a) {
                        free.velocity[a] = double(v[a]);
                        f.velocity[i][a] = v[a];
                    }
                    f.together[i] = Grid(free.mass);
                    free_of[i] = std::int32_t(rigid_free_.size());
                    rigid_free_.push_back(free);
                    met.push_back({free_of[i], f.slot[i], n});
                }
                const std::size_t points_before = rigid_points_.size();
                for (std::int32_t k = block.bending; k < block.all; ++k) {
                    const std::int32_t slot = block.first + k, own = field_of(slot);
                    const Grid mass = node.mass(slot, n);
                    if (!(mass > Grid(0))) continue;
                    const std::int32_t kind = contact.kind_of[own];
                    const double of_full = 1 / contact.full[kind], part = double(mass) * of_full;
                    RigidPoint<D> point{};
                    point.body = body_of_field_[std::size_t(own)];
                    point.place = place;
                    point.fields[0] = own;
                    point.kinds[0] = kind;
                    if (node.touched[slot]) {
                        meet_walls(node, slot, n, part, point);
                        guide_rigid(node, slot, n, cell, point);
                    }
                    const auto by_law = [&](std::int32_t other_slot, double fills) {
                        const std::int32_t other = field_of(other_slot),
                                           its = contact.kind_of[other];
                        point.fields[1] = other;
                        point.kinds[1] = its;
                        const std::int32_t law = contact.law_of[kind * contact.kinds + its];
                        if (law < 0) {
                            point.hold = RigidHold::stick;
                            rigid_points_.push_back(point);
                            return;
                        }
                        const ContactLaw& l = contact.laws[law];
                        if (l.kind == ContactKind::fluid && part < least_of_rigid) return;
                        const double of_other = 1 / contact.full[its];
                        if (!approach_allowed<double>(l, part, fills * of_other, cells_per_step,
                                                      point.allowed))
                            return;
                        Vec<Grid, D> normal;
                        if (!meeting.direction(slot, other_slot, Grid(of_full), Grid(of_other), n,
                                               normal))
                            return;
                        point.hold = RigidHold::push;
                        for (int a = 0; a < D; ++a) point.normal[a] = double(normal[a]);
                        point.static_friction = l.static_friction;
                        point.dynamic_friction = l.dynamic_friction;
                        rigid_points_.push_back(point);
                    };
                    for (int i = 0; i < f.count; ++i) {
                        const int all = f.of[i];
                        point.free = free_of[i];
                        point.other = -1;
                        const std::size_t before = rigid_points_.size();
                        by_law(f.slot[i], double(f.fills[i]));
                        if (rigid_points_.size() == before) continue;
                        RigidPoint<D>& added = rigid_points_.back();
                        const double m = rigid_free_[std::size_t(free_of[i])].mass;
                        added.along = added.across = 1 / m;
                        if (added.hold == RigidHold::push && node.touched[f.slot[i]])
                            held_beside(meeting, n, f, all, added);
                    }
                    point.free = -1;
                    point.along = point.across = 0;
                    for (std::int32_t j = k + 1; j < block.all; ++j) {
                        const Grid theirs = node.mass(block.first + j, n);
                        if (!(theirs > Grid(0))) continue;
                        point.other = body_of_field_[std::size_t(field_of(block.first + j))];
                        by_law(block.first + j, double(theirs));
                    }
                }
                // Nobody meets what is here.
                bool used = false;
                for (std::size_t p = points_before; p < rigid_points_.size(); ++p)
                    used = used || rigid_points_[p].free >= 0;
                if (!used && f.count > 0) {
                    rigid_free_.resize(std::size_t(met[met_before].free));
                    met.resize(met_before);
                }
            }
        }
        const RigidSweeps sweeps = rigid_.solve(rigid_points_, rigid_free_);
        rigid_most_sweeps_ = std::max(rigid_most_sweeps_, sweeps.sweeps);
        rigid_left_ = std::max(rigid_left_, sweeps.left);

        // Boundaries once more on what was pushed, and velocities back.
        rigid_walls_.clear();
        for (std::size_t k = 0; k < met.size(); ++k) {
            const RigidMeeting& m = met[k];
            FreeNode<D>& free = rigid_free_[std::size_t(m.free)];
            if (!free.pushed) continue;
            const bool first = k == 0 || met[k - 1].free != m.free;
            if (first && node.touched[m.slot]) {
                std::int64_t cell[D];
                node.cell(m.slot, m.node, cell);
                double at[D];
                node_position<D>(cell, dx, at);
                Vec<Grid, D> v;
                for (int a = 0; a < D; ++a) v[a] = Grid(free.velocity[a]);
                const Vec<double, D> exact = free.velocity;
                bool held = false;
                apply_boundaries<true>(
                    node.boundaries, cell, v,
                    [&](int boundary, int face, const Vec<Grid, D>& before,
                        const Vec<Grid, D>& after) {
                        RigidWall<D> wall{boundary, face, {}, {}};
                        for (int a = 0; a < D; ++a) {
                            wall.place[a] = at[a];
                            wall.impulse[a] = free.mass * (double(before[a]) - double(after[a]));
                            if (!held) wall.impulse[a] += free.taken[a];
                        }
                        held = true;
                        rigid_walls_.push_back(wall);
                    },
                    node.share(m.slot, m.node));
                for (int a = 0; a < D; ++a) free.velocity[a] = held ? double(v[a]) : exact[a];
            }
            Grid* out = node.grid.velocity + node.grid.velocity_place(m.slot, m.node);
            const Grid mass = node.mass(m.slot, m.node);
            for (int a = 0; a < D; ++a) {
                out[a] = Grid(free.velocity[a]);
                maxima[max_speed] = std::max(maxima[max_speed], node.counts(out[a], mass));
            }
            if (plan_.kept.guard >= 0) out[plan_.kept.guard] = Grid(1);
        }
        for (const RigidPoint<D>& p : rigid_points_) {
            if (p.boundary < 0) continue;
            rigid_walls_.push_back({p.boundary, p.face, p.place, p.impulse});
        }
        for (const RigidBlock& block : rigid_blocks_) {
            for (std::int32_t k = block.bending; k < block.all; ++k) {
                const std::int32_t slot = block.first + k;
                const auto body = std::size_t(body_of_field_[std::size_t(field_of(slot))]);
                for (int n = 0; n < block_cells; ++n) {
                    const Grid mass = node.mass(slot, n);
                    if (!(mass > Grid(0))) continue;
                    std::int64_t cell[D];
                    node.cell(slot, n, cell);
                    double at[D];
                    node_position<D>(cell, dx, at);
                    Vec<double, D> place;
                    for (int a = 0; a < D; ++a) place[a] = at[a];
                    const Vec<double, D> v = rigid_.next_velocity(body, place);
                    Grid* out = node.grid.velocity + node.grid.velocity_place(slot, n);
                    for (int a = 0; a < D; ++a) {
                        out[a] = Grid(v[a]);
                        maxima[max_speed] = std::max(maxima[max_speed], node.counts(out[a], mass));
                    }
                }
            }
        }
    }
}

/// A point of a wall, `gap` m from a body.
template <class X, class T, int D>
void Domain<X, T, D>::add_wall(RigidPoint<D> point, int b, int face, const Vec<double, D>& normal,
                               double gap, const Vec<double, D>& velocity, const SurfaceLaw& law) {
    point.boundary = b;
    point.face = face;
    point.allowed = gap > 0 ? gap / clock_buffer_.data()->dt : 0.0;
    for (int a = 0; a < D; ++a) point.normal[a] = -normal[a];
    point.wall = velocity;
    const bool rough = law.response == Response::sticky;
    point.static_friction = rough ? 1e30 : law.static_friction;
    point.dynamic_friction = rough ? 1e30 : law.dynamic_friction;
    rigid_points_.push_back(point);
}

/// Whether a boundary pushes a rigid body as a wall does.
template <class X, class T, int D>
bool Domain<X, T, D>::is_wall_of(const BoundaryRecord<D>& r, int rigid) const {
    if (!r.active || (r.is_box && r.law[0].response == Response::prescribed)) return false;
    if (r.share == 0) return true;
    for (const Body& b : bodies_)
        if (b.rigid == rigid && b.plan.group.weight >= 0)
            return (r.share >> b.plan.group.weight & 1) != 0;
    return false;
}

/// Walls at a node of a rigid body, which fills `part` of it: by the gap between the two.
template <class X, class T, int D>
void Domain<X, T, D>::meet_walls(const NodeUpdate<Grid, Sum, D>& node, std::int32_t slot, int n,
                                 double part, const RigidPoint<D>& point) {
    if constexpr (!X::is_device) {
        const double dx = spec_.cell_size;
        Vec<Grid, D> outwards;
        bool sloped = false, looked = false;
        for (int b = 0; b < node.boundaries.count; ++b) {
            if (!is_wall_of(node.boundaries.records[b], point.body)) continue;
            detail::for_each_wall<D>(
                node.boundaries, b, point.place, 1.5 * dx,
                [&](int face, const Vec<double, D>& normal, double distance,
                    const Vec<double, D>& velocity, const SurfaceLaw& law) {
                    if (!looked) {
                        looked = true;
                        const NodeContact<Grid, Sum, D> around{node, contact_view()};
                        sloped = around.outwards(slot, n, outwards);
                    }
                    // Which of several faces it is that the body turns to.
                    double towards = 0;
                    for (int a = 0; a < D && sloped; ++a)
                        towards -= normal[a] * double(outwards[a]);
                    if (sloped && !(towards > 0.3)) return;
                    const double gap = contact_gap<double>(part, filled_at(-distance / dx));
                    add_wall(point, b, face, normal, gap * dx, velocity, law);
                });
        }
    }
}

/// Corners fill less of a node than faces, and come nearer to a wall before it pushes there: no
/// particle comes nearer than a tenth of its edge.
template <class X, class T, int D>
void Domain<X, T, D>::keep_before_walls(std::size_t k) {
    if constexpr (!X::is_device) {
        const auto boundaries = boundaries_.view();
        const auto& body = rigid_.at(k);
        const double dt = clock_buffer_.data()->dt, least = 0.2 * body.half;
        double speed = 0, turn = 0;
        for (int a = 0; a < D; ++a) speed += body.next.velocity[a] * body.next.velocity[a];
        for (const double w : body.spin) turn += w * w;
        speed = std::sqrt(speed) + std::sqrt(turn) * body.furthest;
        for (int b = 0; b < boundaries.count; ++b) {
            const BoundaryRecord<D>& r = boundaries.records[b];
            if (!is_wall_of(r, int(k))) continue;
            double moves = 0;
            for (int a = 0; a < D; ++a) moves += r.velocity[a] * r.velocity[a];
            moves = std::sqrt(moves);
            if (r.surface > 0) moves += 0.5 * spec_.cell_size / dt;  // no faster than particles
            const double near = least + (speed + moves) * dt + 0.01 * spec_.cell_size;
            for (const std::uint32_t number : body.outer) {
                RigidPoint<D> point{};
                point.body = std::int32_t(k);
                for (int a = 0; a < D; ++a) {
                    point.place[a] = body.state.centre[a];
                    for (int i = 0; i < D; ++i)
                        point.place[a] += body.axes.e[a][i] * body.places[number][std::size_t(i)];
                }
                detail::for_each_wall<D>(
                    boundaries, b, point.place, near,
                    [&](int face, const Vec<double, D>& normal, double distance,
                        const Vec<double, D>& velocity, const SurfaceLaw& law) {
                        add_wall(point, b, face, normal, distance - least, velocity, law);
                    });
            }
        }
    }
}

/// Regions of a prescribed velocity at a node of a rigid body.
template <class X, class T, int D>
void Domain<X, T, D>::guide_rigid(const NodeUpdate<Grid, Sum, D>& node, std::int32_t slot, int n,
                                  const std::int64_t (&cell)[D], RigidPoint<D> point) {
    if constexpr (!X::is_device) {
        for (int b = 0; b < node.boundaries.count; ++b) {
            const BoundaryRecord<D>& r = node.boundaries.records[b];
            if (!r.active || !r.is_box || r.law[0].response != Response::prescribed) continue;
            if (r.share != 0 && !(node.part_of(node.sums(slot, n), r.share) > 0)) continue;
            bool inside = true;
            for (int a = 0; a < D; ++a)
                inside = inside && cell[a] >= r.lower[a] && cell[a] < r.upper[a] &&
                         (!r.limited || (point.place[a] >= r.within_lower[a] &&
                                         point.place[a] <= r.within_upper[a]));
            for (int a = 0; a < D && inside; ++a) {
                if (!(r.law[0].axes >> a & 1)) continue;
                RigidPoint<D> guide = point;
                guide.boundary = b;
                guide.hold = RigidHold::guide;
                guide.normal = {};
                guide.normal[a] = 1;
                for (int c = 0; c < D; ++c) guide.wall[c] = r.velocity[c];
                rigid_points_.push_back(guide);
            }
        }
    }
}

/// How far a boundary lets a node of another body go along the normal and across it.
template <class X, class T, int D>
template <class Meeting, class Fields>
void Domain<X, T, D>::held_beside(const Meeting& meeting, int n, const Fields& f, int i,
                                  RigidPoint<D>& point) {
    const double by = spec_.cell_size / clock_buffer_.data()->dt * 1e-3;
    Vec<Grid, D> along;
    for (int a = 0; a < D; ++a) along[a] = Grid(point.normal[a]);
    point.along *= double(meeting.part_given(n, f, i, along, Grid(by)));
    if (!(point.static_friction > 0)) return;
    Vec<Grid, D> across{};
    int least = 0;
    for (int a = 1; a < D; ++a)
        if (std::abs(point.normal[a]) < std::abs(point.normal[least])) least = a;
    double square = 0;
    for (int a = 0; a < D; ++a) {
        const double t = (a == least ? 1.0 : 0.0) - point.normal[least] * point.normal[a];
        across[a] = Grid(t);
        square += t * t;
    }
    for (int a = 0; a < D; ++a) across[a] = Grid(double(across[a]) / std::sqrt(square));
    point.across *= double(meeting.part_given(n, f, i, across, Grid(by)));
}

/// Where the particles of a body are, and what they deposit: its own velocity and the slope of it.
template <class X, class T, int D>
void Domain<X, T, D>::place_rigid(Body& body, const Phase<X, T, D>& phase, bool moves) {
    if constexpr (!X::is_device) {
        const auto& b = rigid_.at(std::size_t(body.rigid));
        const Mat<double, D> axes = rotation_of<D>(b.state.turn);
        const Scratch<D> column{phase.n.channels};
        const std::size_t count = body.count;
        const double dx = spec_.cell_size;
        const BodyView<T, D> view = body.view();
        // dv_c / dx_a
        double slope[D][D] = {};
        for (int a = 0; a < D; ++a) {
            Vec<double, D> unit{};
            unit[a] = 1;
            const Vec<double, D> of = velocity_at<D>(Vec<double, D>{}, b.spin, unit);
            for (int c = 0; c < D; ++c) slope[c][a] = of[c];
        }
        exec_.host_for(std::int64_t(body.homes), [&](std::int64_t h) {
            for_each_in_block<T, D>(
                view, table_, view.home[h], [&](const std::int64_t(&cell)[D], std::uint32_t q) {
                    const auto& own = b.places[view.id[q]];
                    Vec<double, D> r;
                    bool sound = true, far = false;
                    for (int a = 0; a < D; ++a) {
                        r[a] = 0;
                        for (int k = 0; k < D; ++k) r[a] += axes.e[a][k] * own[std::size_t(k)];
                        const double offset =
                            (b.state.centre[a] + r[a]) / dx - (double(cell[a]) + 0.5);
                        if (moves) view.offset[a][q] = T(offset);
                        sound = sound && std::abs(offset) <= 1.75;
                        far = far || std::abs(offset) > 1.0;
                    }
                    if (!sound)
                        X::keep_smallest(phase.pass.fault_particle,
                                         std::uint64_t(phase.pass.body_number) << 40 | q);
                    if (far)
                        __atomic_store_n(phase.pass.strays, ~std::uint64_t(0), __ATOMIC_RELAXED);
                    const Vec<double, D> v = velocity_at<D>(b.state.velocity, b.spin, r);
                    for (int c = 0; c < D; ++c) {
                        const auto put = [&](int at, double number) {
                            phase.pass.scratch[std::size_t(at) * count + q] = Grid(number);
                        };
                        put(column.value(c), v[c]);
                        for (int a = 0; a < D; ++a) {
                            put(column.slope(a, c), slope[c][a] * dx);
                            put(column.stress(a, c), 0);
                        }
                    }
                });
        });
    }
}

/// A rigid body's part of a step, once its motion is known.
template <class X, class T, int D>
void Domain<X, T, D>::move_rigid(Body& body, const Phase<X, T, D>& phase) {
    if constexpr (!X::is_device) {
        if (clock_buffer_.data()->halt != Halt::none) return;
        rigid_.advance(std::size_t(body.rigid), clock_buffer_.data()->dt);
        place_rigid(body, phase, true);
        phase_ops_.spread(phase);
    }
}

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
            double* sum = loads.impulse + k * load_columns<D>;
            for (const RigidWall<D>& w : rigid_walls_) {
                if (w.boundary != cell.boundary || !(cell.faces >> w.face & 1)) continue;
                Vec<double, D> arm;
                double moment[spins<D>] = {};
                for (int a = 0; a < D; ++a) {
                    sum[a] += w.impulse[a];
                    arm[a] = w.place[a] - cell.reference[a];
                }
                add_moment<D>(arm, w.impulse, 1, moment);
                for (int a = 0; a < spins<D>; ++a) sum[D + a] += moment[a];
            }
        }
        const auto contacts = sensors_.take_contact(clock_buffer_.data());
        for (int k = 0; k < sensors_.contact_count(); ++k) {
            const ContactLoadRecord& sensor = sensors_.contact_loads()[k];
            double* sum = contacts.impulse + k * contact_columns<D>;
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
                    sum[a] += sign * p.impulse[a];
                }
                sum[D] += push;
                sum[D + 1] += std::sqrt(square);
                sum[D + 2] += work;
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

/// Particles of a rigid body have left the domain: whatever the policy, it stays whole.
template <class X, class T, int D>
bool Domain<X, T, D>::breaks_rigid(const std::vector<std::uint32_t>& left, std::size_t b,
                                   const Buffer<X, std::uint32_t>& cell) {
    const Body& body = bodies_[b];
    std::vector<std::uint64_t> ids;
    for (const Leaver<D>& who : list_left(body, left[b], cell))
        ids.push_back(body.first_id + who.id);
    fault_ = Fault{"left-domain",
                   body.plan.name,
                   ids,
                   clock_.step,
                   clock_.time,
                   double(ids.size()),
                   clock_.speed,
                   growth_start(clock_),
                   std::to_string(ids.size()) +
                       " particles of a rigid body left the domain, the first at step " +
                       std::to_string(clock_.step) +
                       "; it stays whole, so that no policy takes them out"};
    return true;
}

}  // namespace mpm
