// Domain: rigid bodies. Their particles carry mass to the grid as others do; what holds and pushes
// them there is solved for body by body, and particles go where their bodies are (design/rigid.md).
#pragma once

#include "mpm/kernels/respond.hpp"
#include "mpm/solver/domain.hpp"
#include "mpm/solver/wall_distances.hpp"

namespace mpm {

/// A rigid body holds the nodes of a fluid that it fills so much of, 0.72 cells from a flat face
/// on. It is heavier than what it has at a node, so that nothing else says how much of the fluid
/// there it may hold, and with nodes further out the fluid moves as if the body were larger
/// (design/rigid.md).
inline constexpr double least_of_rigid = 0.08;

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
                const Vec<double, D> place = place_of_node(cell);
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

        return_velocities(maxima);
        move_rigid_nodes(maxima);
    }
}

/// Boundaries once more on what rigid bodies have pushed, and velocities back to their nodes.
template <class X, class T, int D>
void Domain<X, T, D>::return_velocities(double (&maxima)[maxima_count]) {
    if constexpr (!X::is_device) {
        const auto node = node_update(parity());
        rigid_walls_.clear();
        for (std::size_t k = 0; k < rigid_met_.size(); ++k) {
            const RigidMeeting& m = rigid_met_[k];
            FreeNode<D>& free = rigid_free_[std::size_t(m.free)];
            if (!free.pushed) continue;
            const bool first = k == 0 || rigid_met_[k - 1].free != m.free;
            if (first && node.touched[m.slot]) {
                std::int64_t cell[D];
                node.cell(m.slot, m.node, cell);
                const Vec<double, D> at = place_of_node(cell);
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
    }
}

/// The velocities of the nodes of rigid bodies, by their new motions.
template <class X, class T, int D>
void Domain<X, T, D>::move_rigid_nodes(double (&maxima)[maxima_count]) {
    if constexpr (!X::is_device) {
        const auto node = node_update(parity());
        for (const RigidBlock& block : rigid_blocks_) {
            for (std::int32_t k = block.bending; k < block.all; ++k) {
                const std::int32_t slot = block.first + k;
                const auto body = std::size_t(
                    body_of_field_[std::size_t(table_.keys_of.field(table_.keys[slot]))]);
                for (int n = 0; n < block_cells; ++n) {
                    const Grid mass = node.mass(slot, n);
                    if (!(mass > Grid(0))) continue;
                    std::int64_t cell[D];
                    node.cell(slot, n, cell);
                    const Vec<double, D> v = rigid_.next_velocity(body, place_of_node(cell));
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

/// Where a node is, m.
template <class X, class T, int D>
Vec<double, D> Domain<X, T, D>::place_of_node(const std::int64_t (&cell)[D]) const {
    double at[D];
    node_position<D>(cell, spec_.cell_size, at);
    Vec<double, D> place;
    for (int a = 0; a < D; ++a) place[a] = at[a];
    return place;
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
            for_each_wall<D>(node.boundaries, b, point.place, 1.5 * dx,
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
                                 const double gap =
                                     contact_gap<double>(part, filled_at(-distance / dx));
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
                for_each_wall<D>(boundaries, b, point.place, near,
                                 [&](int face, const Vec<double, D>& normal, double distance,
                                     const Vec<double, D>& velocity, const SurfaceLaw& law) {
                                     add_wall(point, b, face, normal, distance - least, velocity,
                                              law);
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
            const std::int32_t slot = view.home[h];
            const std::int32_t* corner = table_.corners + std::int64_t(slot) * D;
            for_each_of_block<T, D>(view, slot, [&](const int(&home)[D], std::uint32_t q) {
                const auto& own = b.places[view.id[q]];
                Vec<double, D> r;
                bool sound = true, far = false;
                for (int a = 0; a < D; ++a) {
                    r[a] = 0;
                    for (int k = 0; k < D; ++k) r[a] += axes.e[a][k] * own[std::size_t(k)];
                    const double offset =
                        (b.state.centre[a] + r[a]) / dx - (double(corner[a] + home[a]) + 0.5);
                    if (moves) view.offset[a][q] = T(offset);
                    sound = sound && std::abs(offset) <= 1.75;
                    far = far || std::abs(offset) > far_from_home;
                }
                if (!sound)
                    X::keep_smallest(phase.pass.fault_particle,
                                     fault_number(phase.pass.body_number, q));
                if (far) __atomic_store_n(phase.pass.strays, ~std::uint64_t(0), __ATOMIC_RELAXED);
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

}  // namespace mpm
