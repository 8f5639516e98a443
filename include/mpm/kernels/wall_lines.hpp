// Walls that strain the cells beside them rightly: along a grid line towards a wall the velocity
// across it is linear and meets that of the wall in the plane of the wall. Derivation, measurements
// and what was tried: design/walls.md, 7.
//
// Nodes of a line by their place: 1, 0 and -1, at 3/2, 1/2 and -1/2 cells from the plane. The first
// leads the others,
//
//   v_i . n - w = T_i u,   T = 1, 1/3, -1/3,
//
// and u is the field of this kind that is nearest to what each node would do by itself, v*, in the
// metric of the masses: forces on a node that is led act on its leader (virtual work),
//
//   u = sum T_i m_i (v*_i . n - w) / sum T_i^2 m_i,    I = sum m_i (v_i - v*_i) . n,
//
// with I the impulse of the wall on the line. In gaps of two and three cells, where two such lines
// would overlap, node 0 leads node -1 alone, T = 1, -1; in a gap or a box of one cell nodes are
// held.
#pragma once

#include "mpm/kernels/wall_places.hpp"

namespace mpm {

/// Pressure that the grid knows of a group of bodies: of their averaged volume loss.
struct GroupPressure {
    int sum, weight;  // channels
    double stiffness, exponent;
    double full;  // mass of a full node, kg

    MPM_INLINE double at(double j) const { return stiffness * (exp(-exponent * log1p(-j)) - 1); }
};

/// What nodes of listed blocks would do by themselves: mass and velocity of those that ask for more
/// than lines towards walls (`SeatWallNodes`). Each of a line's nodes asks for all of them.
template <class T>
struct WallSeats {
    const T* seat = nullptr;
    const WallAsks* asks = nullptr;
    MPM_INLINE bool has(std::int64_t place) const {
        return seat && WallNode::needs_all(asks[place]);
    }
};

/// What the lines leave of one node's velocity. `Node` is a `NodeUpdate`. `plain`: of a node that
/// `ClassifyWallNodes` has found to be on lines alone. `seated`: what other nodes would do by
/// themselves is there, but for those that nothing pushes. Both are one function on a device: lanes
/// of a warp that wait while others are in a call have waited forever (design/gpu-step.md).
template <class Node, class T, int D, bool plain = false, bool seated = false,
          class Known = KnownNodes<D>>
struct FollowLines {
    // Where `plain`: what is known is the piece of the node itself.
    static constexpr bool pieced = std::is_same_v<Known, const LinedNode<D>*>;
    const Node& node;
    Known known = {};
    std::int64_t listed_at = 0;  // the node's place among those that are known
    WallSeats<T> seats = {};

    struct Seat {
        T mass = 0;
        Vec<T, D> velocity{};  // of the node by itself
    };
    /// Sums over the nodes of a line, velocities relative to the wall.
    struct Sums {
        T leader = 0;           // mass
        T mass = 0, led = 0;    // sum of m, of T m
        T push = 0, inert = 0;  // sum of T m v, of T^2 m
        int beside = 0;         // nodes with mass of the two beside the plane
        T toward = 0;           // sum of their v: twice the velocity in the plane
        Vec<T, D> momentum{};
        MPM_INLINE T lead() const { return push / inert; }
    };
    /// A leader with less of its line's mass than this leads nothing: all there is is a film of
    /// less than 0.6 cells on the plane, and the velocity of a node that hardly weighs would be
    /// that of the film, times three or more.
    static constexpr double least_leader = 1.0 / 16;
    struct Wall {
        const SurfaceLaw& law;
        Vec<T, D> velocity;
    };

    MPM_INLINE Wall wall(const WallLine& line) const {
        const BoundaryRecord<D>& r = node.boundaries.records[line.boundary];
        Wall out{r.law[line.face], {}};
        for (int a = 0; a < D; ++a) out.velocity[a] = T(r.velocity[a]);
        return out;
    }
    /// What a node would do by itself, edges of boxes included.
    MPM_INLINE Seat seat(std::int32_t slot, int number, const std::int64_t (&cell)[D]) const {
        Seat out;
        out.mass = node.mass(slot, number);
        if (!(out.mass > T(0))) return out;
        out.velocity = node.free_velocity(out.mass, node.momentum(slot, number));
        if constexpr (!plain) push(slot, number, cell, out.mass, out.velocity, NothingSeen{});
        return out;
    }
    MPM_CALL Seat called_seat(std::int32_t slot, int number, const std::int64_t (&cell)[D]) const {
        const Reconverge at_return;
        Seat out;
        return find_seat(slot, number, out) ? out : seat(slot, number, cell);
    }
    /// What faces give back at their edges to the nodes that no line leads; those that are all but
    /// inside a body rest in it.
    template <class Seen>
    MPM_INLINE void push(std::int32_t slot, int number, const std::int64_t (&cell)[D], T mass,
                         Vec<T, D>& v, const Seen& seen) const {
        if (node.pressure_count == 0) return;
        const bool listed = known.asks && known.listed[slot] > 0;
        const WallAsks asks = listed ? known.asks[known.place(slot, number)] : WallNode::unknown;
        if (asks & (WallNode::edges | WallNode::watched | WallNode::unknown))
            push_at_edges(slot, number, cell, mass, v, seen);
        const SurfaceNode<D>* s = known.of(slot, number);
        if (!s || !s->pushed()) return;
        const Vec<T, D> before = v;
        if (s->cut.before < SurfaceNode<D>::least_before) {
            const BoundaryRecord<D>& r = node.boundaries.records[s->boundary];
            for (int a = 0; a < D; ++a) v[a] = T(r.velocity[a]);
            seen(s->boundary, 0, before, v);
            return;
        }
        double size = node.pressure(slot, number, s->cut.before) * node.clock->dt / double(mass);
        for (int a = 1; a < D; ++a) size *= node.boundaries.cell_size;
        for (int a = 0; a < D; ++a) v[a] += T(size * s->cut.area[a]);
        seen(s->boundary, 0, before, v);
    }
    template <class Seen>
    MPM_INLINE void push_at_edges(std::int32_t slot, int number, const std::int64_t (&cell)[D],
                                  T mass, Vec<T, D>& v, const Seen& seen) const {
        each_edge<D>(node.boundaries, cell, [&](int b, int face, int axis, double area) {
            double size = node.pressure(slot, number) * node.clock->dt * area;
            for (int a = 1; a < D; ++a) size *= node.boundaries.cell_size;
            const Vec<T, D> before = v;
            v[axis] += T(size / double(mass));
            seen(b, face, before, v);
        });
    }
    /// In the same order from wherever on the line, so that all its nodes find the same numbers.
    MPM_INLINE Sums sum(const WallLine& line, int axis, std::int32_t slot,
                        const std::int64_t (&cell)[D], const Seat& own,
                        const Vec<T, D>& moving) const {
        Sums out;
        MPM_UNROLL for (int at = 1; at >= -1; --at) {
            if (at > line.first()) continue;
            Seat s = own;
            if (at != line.place) {
                const std::int64_t by = (at - line.place) * line.sign;
                std::int64_t there[D];
                moved_along<D>(cell, axis, by, there);
                int number = 0;
                std::int32_t of;
                if constexpr (pieced)
                    of = known->beside_along(axis, int(by), number);
                else
                    of = node_beside<D>(node.grid.table, slot, cell, axis, by, number);
                s = of < 0 ? Seat{} : other_seat(of, number, there);
            }
            if (at == line.first()) out.leader = s.mass;
            const T t = line.template share<T>(at);
            out.mass += s.mass;
            out.led += t * s.mass;
            out.inert += t * t * s.mass;
            out.push += t * s.mass * (s.velocity[axis] - moving[axis]);
            if (at <= 0 && s.mass > T(0)) {
                ++out.beside;
                out.toward += s.velocity[axis] - moving[axis];
            }
            for (int a = 0; a < D; ++a) out.momentum[a] += s.mass * (s.velocity[a] - moving[a]);
        }
        return out;
    }
    MPM_CALL Sums called_sum(const WallLine& line, int axis, std::int32_t slot,
                             const std::int64_t (&cell)[D], const Seat& own,
                             const Vec<T, D>& moving) const {
        const Reconverge at_return;
        return sum(line, axis, slot, cell, own, moving);
    }
    MPM_INLINE Seat other_seat(std::int32_t slot, int number, const std::int64_t (&cell)[D]) const {
        if constexpr (plain)
            return seat(slot, number, cell);
        else if constexpr (seated)
            return seat_there(slot, number);
        else
            return called_seat(slot, number, cell);
    }
    /// Of this step, if there is one.
    MPM_INLINE bool find_seat(std::int32_t slot, int number, Seat& out) const {
        if (!seats.seat || node.touched[slot] == 0) return false;
        const std::int64_t at = std::int64_t(node.touched[slot] - 1) * block_cells + number;
        if (!seats.has(at)) return false;
        const T* const from = seats.seat + at * (D + 1);
        out.mass = from[D];
        for (int a = 0; a < D; ++a) out.velocity[a] = from[a];
        return true;
    }
    MPM_INLINE Seat seat_there(std::int32_t slot, int number) const {
        Seat out;
        if (find_seat(slot, number, out)) return out;
        out.mass = node.mass(slot, number);
        if (out.mass > T(0))
            out.velocity = node.free_velocity(out.mass, node.momentum(slot, number));
        return out;
    }
    MPM_INLINE bool alone(std::int32_t slot) const {
        return node.boundaries.holds(node.grid.table, slot);
    }
    MPM_INLINE WallLine line_of(std::int32_t slot, int axis, const std::int64_t (&cell)[D]) const {
        if constexpr (pieced) {
            return WallLine::unpacked(known->lines[axis]);
        } else {
            if constexpr (!plain) {
                if (known.lines == nullptr)
                    return find_line<D>(node.boundaries, axis, cell, alone(slot));
            }
            return WallLine::unpacked(known.lines[listed_at * D + axis]);
        }
    }
    template <class Seen>
    MPM_CALL BoundAxes<D> called(std::int32_t slot, int number, const std::int64_t (&cell)[D],
                                 T mass, Vec<T, D>& v, const Seen& seen) const {
        const Reconverge at_return;
        return (*this)(slot, number, cell, mass, v, seen);
    }
    /// `v` is the node's velocity by itself. Returns across which axes walls on cell faces have it.
    template <class Seen>
    MPM_INLINE BoundAxes<D> operator()(std::int32_t slot, int number, const std::int64_t (&cell)[D],
                                       T mass, Vec<T, D>& v, const Seen& seen) const {
        if constexpr (!plain) push(slot, number, cell, mass, v, seen);
        const Seat own{mass, v};
        WallLine lines[D];
        Vec<T, D> slid[D] = {};  // of the line's mass along the wall
        T pressed[D] = {};       // speed that the wall takes from the line's mass by pressing
        BoundAxes<D> bound;
        MPM_UNROLL for (int a = 0; a < D; ++a) {
            WallLine& line = lines[a] = line_of(slot, a, cell);
            pressed[a] = 0;
            if (line.form == WallLine::none) continue;
            const Wall by = wall(line);
            const Vec<T, D> before = v;
            Sums s;
            if (!line.holds()) {
                if constexpr (plain || seated)
                    s = sum(line, a, slot, cell, own, by.velocity);
                else
                    s = called_sum(line, a, slot, cell, own, by.velocity);
            }
            if (line.holds() || !(s.leader > T(least_leader) * s.mass)) {
                // Without a leader there is no field: nodes at the plane are held one by one.
                if (line.holds() || line.place <= 0) {
                    v = hold(line, a, node.share(slot, number), by, before);
                    seen(line.boundary, line.face, before, v);
                }
                const bool stands = v[a] == by.velocity[a];
                if (line.form == WallLine::shut && stands) bind(bound, a, line);
                line.form = WallLine::none;
                continue;
            }
            const T impulse = T(line.sign) * (s.lead() * s.led - s.momentum[a]);
            if (by.law.response == Response::separable && !(impulse > T(0))) {
                let_go(line, a, s, by, before, v, seen);
                line.form = WallLine::none;
                continue;
            }
            v[a] = by.velocity[a] + line.template share<T>(line.place) * s.lead();
            bind(bound, a, line);
            seen(line.boundary, line.face, before, v);
            if (impulse > T(0)) pressed[a] = impulse / s.mass;
            for (int c = 0; c < D; ++c) slid[a][c] = c == a ? T(0) : s.momentum[c] / s.mass;
        }
        MPM_UNROLL for (int a = 0; a < D; ++a) if (lines[a].form != WallLine::none)
            rub(lines, a, slid[a], pressed[a], v, seen);
        if constexpr (!plain) {
            if (!node.boundaries.surface_lines) return bound;
            const SurfaceNode<D>* is = known.surfaces ? known.surfaces + listed_at : nullptr;
            const int count = !is ? node.boundaries.count : is->boundary >= 0 ? 1 : 0;
            for (int k = 0; k < count; ++k) {
                const int b = is ? is->boundary : k;
                const BoundaryRecord<D>& r = node.boundaries.records[b];
                if (!is && (!r.active || r.surface == 0 || !r.law[0].linear)) continue;
                const SurfaceLine<D> line =
                    is ? is->line() : surface_line<D>(node.boundaries, b, cell, alone(slot));
                follow_surface(b, slot, cell, own, bound, line, v, seen);
            }
        }
        return bound;
    }
    /// What the plane of a line leaves of the velocity of a node that it holds by itself.
    template <class Share>
    MPM_INLINE Vec<T, D> hold(const WallLine& line, int axis, const Share& share, const Wall& by,
                              const Vec<T, D>& v) const {
        return respond_at_face<true>(by.law, axis, line.sign, line.place + 0.5, v, by.velocity,
                                     share);
    }
    MPM_INLINE auto share_of(std::int32_t slot, const std::int64_t (&cell)[D]) const {
        std::int64_t block[D];
        return node.share(slot, block_of_node<D>(cell, block));
    }
    MPM_INLINE void bind(BoundAxes<D>& bound, int axis, const WallLine& line) const {
        bound.bind(axis, line.sign, (line.place + 0.5) * node.boundaries.cell_size);
        bound.shut[axis] = line.form == WallLine::shut;
    }
    /// No wall pulls where material may leave it. But drops beside the plane that fall while others
    /// on the line rise would pass it if its nodes were free: what these give a drop in the plane
    /// may not lead into the wall. A field that is zero there, as of a line that is pressed, is
    /// left as it is, or a force that rounding makes negative would take its momentum.
    template <class Seen>
    MPM_INLINE void let_go(const WallLine& line, int axis, const Sums& s, const Wall& by,
                           const Vec<T, D>& before, Vec<T, D>& v, const Seen& seen) const {
        if (line.place > 0 || s.beside < 2 || !(T(line.sign) * s.toward < T(0))) return;
        // As of what meets the wall with that velocity.
        const T onto = s.toward / T(2);
        Vec<T, D> met = v;
        met[axis] = by.velocity[axis] + onto;
        v = respond(by.law, axis, T(line.sign), met, by.velocity);
        v[axis] = before[axis] - onto;
        seen(line.boundary, line.face, before, v);
    }
    /// A node that no line leads, as a held surface has it.
    template <class Seen>
    MPM_INLINE void hold_at_surface(int b, std::int32_t slot, const std::int64_t (&cell)[D],
                                    const BoundAxes<D>& bound, Vec<T, D>& v,
                                    const Seen& seen) const {
        const BoundaryRecord<D>& r = node.boundaries.records[b];
        const SurfaceRecord<D>& s = node.boundaries.surfaces[r.surface - 1];
        const Vec<T, D> before = v;
        double x[D];
        node_position<D>(cell, node.boundaries.cell_size, x);
        Vec<T, D> wall;
        for (int a = 0; a < D; ++a) wall[a] = T(r.velocity[a]);
        const SurfaceNode<D>* is = known.surfaces ? known.surfaces + listed_at : nullptr;
        const auto share = share_of(slot, cell);
        const ClosingSpeed<std::remove_cv_t<decltype(share)>, D> closing_speed{share};
        const bool acted =
            is && is->boundary == b && is->state == SurfaceLine<D>::held
                ? respond_near_surface<T, D>(s, r.law[0], x, is->lead, is->normal, wall, bound,
                                             node.boundaries.cell_size, v, closing_speed)
                : respond_to_surface<T, D>(s, r.law[0], x, wall, bound, node.boundaries.cell_size,
                                           v, closing_speed);
        if (acted) seen(b, 0, before, v);
    }
    /// A surface across its own normal. What walls on cell faces hold (`bound`) is left alone.
    template <class Seen>
    MPM_INLINE void follow_surface(int b, std::int32_t slot, const std::int64_t (&cell)[D],
                                   const Seat& own, const BoundAxes<D>& walls,
                                   const SurfaceLine<D>& line, Vec<T, D>& v,
                                   const Seen& seen) const {
        const BoundaryView<D>& all = node.boundaries;
        const BoundaryRecord<D>& r = all.records[b];
        const SurfaceRecord<D>& s = all.surfaces[r.surface - 1];
        const SurfaceLaw& law = r.law[0];
        const Vec<T, D> before = v;
        if (line.state == SurfaceLine<D>::held)
            return hold_at_surface(b, slot, cell, walls, v, seen);
        if (line.state != SurfaceLine<D>::on) return;
        const double size = all.cell_size;
        const BoundAxes<D> bound = walls.before(line.normal, line.share * line.lead * size, size);
        T mass = 0, led = 0, push = 0, inert = 0, leader = 0, arm = 0;
        T last = 0, last_share = 0, in_plane = 0;  // velocities along the normal
        bool across = false;
        Vec<T, D> momentum{}, here{};
        std::int64_t there[D];
        PlaceOnLine first, place;
        for (int step = 0; step < 8; ++step) {
            const std::int64_t by = line.leader - step * line.sign;
            const bool self = by == 0;
            moved_along<D>(cell, line.axis, by, there);
            int number = 0;
            const std::int32_t of =
                node_beside<D>(node.grid.table, slot, cell, line.axis, by, number);
            if (const SurfaceNode<D>* is = known.of(of, number, b))
                place = is->place;
            else
                place = PlaceOnLine(SurfaceView<D>(all, s, there));
            if (step == 0) first = place;
            if (!place.along(first) || place.deep) break;
            Seat seat_here = own;
            if (!self) seat_here = of < 0 ? Seat{} : other_seat(of, number, there);
            double moving[D] = {};
            if (!s.at_rest()) {
                double x[D];
                node_position<D>(there, all.cell_size, x);
                s.velocity_at(x, moving);
            }
            const T t = T(place.distance / line.lead);
            T along = 0;
            for (int a = 0; a < D; ++a) {
                const T w = T(moving[a] + r.velocity[a]);
                if (self) here[a] = w;
                along += T(line.normal[a]) * (seat_here.velocity[a] - w);
                momentum[a] += seat_here.mass * (seat_here.velocity[a] - w);
            }
            if (step == 0) leader = seat_here.mass;
            if (t <= T(0) && last_share > T(0) && seat_here.mass > T(0)) {
                in_plane = (along * last_share - last * t) / (last_share - t);
                across = true;
            }
            last = along;
            last_share = seat_here.mass > T(0) ? t : T(0);
            mass += seat_here.mass;
            arm -= T(step * line.sign) * seat_here.mass;
            led += t * seat_here.mass;
            inert += t * t * seat_here.mass;
            push += t * seat_here.mass * along;
        }
        // As at walls on cell faces: `operator()`, `let_go`.
        const bool leads = line.leader == 0;
        if (!(leader > T(least_leader) * mass))
            return leads ? void() : hold_at_surface(b, slot, cell, bound, v, seen);
        const T lead = push / inert;
        T along = 0, is = 0;
        for (int a = 0; a < D; ++a) {
            along += T(line.normal[a]) * momentum[a];
            is += T(line.normal[a]) * (v[a] - here[a]);
        }
        const T impulse = lead * led - along;
        const T open = T(bound.open(line.normal));
        if (!(open > T(least_open))) return;
        if (law.response == Response::separable && !(impulse > T(0))) {
            if (leads || !across || !(in_plane < T(0))) return;
            for (int a = 0; a < D; ++a)
                if (!bound.on[a]) v[a] -= in_plane / open * T(line.normal[a]);
            seen(b, 0, before, v);
            return;
        }
        if (line.slides) {
            // Of cut cells particles integrate what pushes along a slope unevenly between the nodes
            // of a line, over all of them hardly: they move as one, but for what the flow is drawn
            // out along the slope as it is pressed across it.
            const T drawn = lead / T(line.lead) * (T(line.leader) + arm / mass);
            for (int a = 0; a < D; ++a) {
                if (bound.on[a]) continue;
                const T steep = T(a == line.axis) - T(line.normal[a] * line.normal[line.axis]);
                const T lag = momentum[a] / mass - (own.velocity[a] - here[a]) + drawn * steep;
                v[a] += lag;
                is += T(line.normal[a]) * lag;
            }
        }
        const T change = (T(line.share) * lead - is) / open;
        for (int a = 0; a < D; ++a)
            if (!bound.on[a]) v[a] += change * T(line.normal[a]);
        if (law.static_friction > 0 || law.dynamic_friction > 0) {
            T speed = 0;
            for (int a = 0; a < D; ++a) {
                momentum[a] = (momentum[a] - along * T(line.normal[a])) / mass;
                speed += momentum[a] * momentum[a];
            }
            const T pressed = impulse > T(0) ? impulse / mass : T(0);
            const T lost = T(1) - kept_of_sliding<T>(law, square_root(speed), pressed);
            for (int a = 0; a < D; ++a)
                if (!bound.on[a]) v[a] -= lost * momentum[a];
        }
        seen(b, 0, before, v);
    }
    /// What another body has made of the velocity of a node since its lines gave it `lined`. The
    /// leader of a line hears of that in the next step; a node that is led goes no further towards
    /// the wall than its line or the wall itself does, and not off it where it may not leave.
    /// Returns what `operator()` does.
    template <class Seen>
    MPM_INLINE BoundAxes<D> keep_on_lines(std::int32_t slot, const std::int64_t (&cell)[D],
                                          const Vec<T, D>& lined, Vec<T, D>& v,
                                          const Seen& seen) const {
        BoundAxes<D> bound;
        for (int a = 0; a < D && node.boundaries.lines; ++a) {
            const WallLine line = line_of(slot, a, cell);
            if (line.form == WallLine::none || (!line.holds() && line.place > 0)) continue;
            const Wall by = wall(line);
            Vec<T, D> least = by.velocity;
            if (line.holds()) {
                const Vec<T, D> before = v;
                v = hold(line, a, share_of(slot, cell), by, before);
                seen(line.boundary, line.face, before, v);
                if (line.form != WallLine::held && v[a] == least[a]) bind(bound, a, line);
                continue;
            }
            const T off = T(line.sign) * (lined[a] - least[a]);
            if (by.law.response != Response::separable || off < T(0)) least[a] = lined[a];
            const Vec<T, D> before = v;
            v = respond(by.law, a, T(line.sign), before, least);
            seen(line.boundary, line.face, before, v);
            if (v[a] == least[a]) bind(bound, a, line);
        }
        for (int b = 0; b < node.boundaries.count && node.boundaries.surface_lines; ++b) {
            const BoundaryRecord<D>& r = node.boundaries.records[b];
            if (!r.active || r.surface == 0 || !r.law[0].linear) continue;
            const SurfaceLine<D> line = surface_line_of(slot, b, cell);
            if (line.state == SurfaceLine<D>::away ||
                (line.state == SurfaceLine<D>::on && line.leader == 0))
                continue;
            if (line.state == SurfaceLine<D>::held) {
                hold_at_surface(b, slot, cell, bound, v, seen);
                continue;
            }
            const Vec<T, D> before = v;
            double x[D], moving[D];
            node_position<D>(cell, node.boundaries.cell_size, x);
            node.boundaries.surfaces[r.surface - 1].velocity_at(x, moving);
            Vec<T, D> normal, least;
            T off = 0;
            for (int a = 0; a < D; ++a) {
                normal[a] = T(line.normal[a]);
                least[a] = T(moving[a] + r.velocity[a]);
                off += normal[a] * (lined[a] - least[a]);
            }
            if (r.law[0].response != Response::separable || off < T(0))
                for (int a = 0; a < D; ++a) least[a] += off * normal[a];
            v = respond_along(r.law[0], normal, before, least);
            seen(b, 0, before, v);
        }
        return bound;
    }
    MPM_INLINE SurfaceLine<D> surface_line_of(std::int32_t slot, int boundary,
                                              const std::int64_t (&cell)[D]) const {
        if (known.surfaces) {
            const SurfaceNode<D>& s = known.surfaces[listed_at];
            return s.boundary == boundary ? s.line() : SurfaceLine<D>{};
        }
        return surface_line<D>(node.boundaries, boundary, cell, alone(slot));
    }
    /// Coulomb friction: one tangential impulse on the whole line, by mass.
    template <class Seen>
    MPM_INLINE void rub(const WallLine (&lines)[D], int axis, const Vec<T, D>& slid, T pressed,
                        Vec<T, D>& v, const Seen& seen) const {
        const SurfaceLaw& law = wall(lines[axis]).law;
        if (!(law.static_friction > 0 || law.dynamic_friction > 0)) return;
        T speed = 0;
        for (int a = 0; a < D; ++a) speed += slid[a] * slid[a];
        const T lost = T(1) - kept_of_sliding<T>(law, square_root(speed), pressed);
        const Vec<T, D> before = v;
        for (int a = 0; a < D; ++a)
            if (lines[a].form == WallLine::none) v[a] -= lost * slid[a];
        seen(lines[axis].boundary, lines[axis].face, before, v);
    }
};

}  // namespace mpm
