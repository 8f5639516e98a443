// The grid half of a step: sums -> velocities, gravity, boundaries (Bonus 2023, section 4.10).
#pragma once

#include "mpm/kernels/wall_lines.hpp"
#include "mpm/physics/contact.hpp"

namespace mpm {

/// Below this share of the lightest particle's mass a node does not move: its weight in any
/// particle's velocity is smaller still, and in single precision its quotient momentum / mass would
/// be noise. What such nodes hold is lost, so the share lies below the rounding of the sums around
/// it.
template <class T>
inline constexpr double negligible_mass = sizeof(T) == 4 ? 1e-10 : 1e-18;
/// With fixed-point sums, the least number of quanta for the same reason.
inline constexpr int least_quanta = 16;

/// One node: from sums to the velocity with which the coming step moves particles.
template <class T, class Sum, int D>
struct NodeUpdate {
    GridView<T, Sum, D> grid;
    const Clock* clock;
    BoundaryView<D> boundaries;
    const std::uint32_t* touched;  // per slot: may a boundary hold nodes of it
    double least_mass;             // of a particle, kg
    double light_mass;  // lighter nodes count by their part of it (kernels/clock.hpp), kg
    const GroupPressure* pressures = nullptr;  // where boxes or surfaces have linear cells
    int pressure_count = 0;
    RubbingParts<T> rubbing = {};

    MPM_INLINE const Sum* sums(std::int32_t slot, int node) const {
        return grid.sums + std::int64_t(slot) * grid.sum_channels * block_cells + node;
    }
    MPM_INLINE T mass(Sum sum) const {
        if constexpr (std::is_integral_v<Sum>) {
            if (sum < least_quanta) return 0;
        }
        const T m = from_sum<T>(sum, clock->unit_read[mass_sum]);
        return m > T(negligible_mass<T> * least_mass) ? m : T(0);
    }
    MPM_INLINE T mass(std::int32_t slot, int node) const { return mass(sums(slot, node)[0]); }
    MPM_INLINE void cell(std::int32_t slot, int node, std::int64_t (&c)[D]) const {
        grid.table.cell(slot, node, c);
    }
    MPM_INLINE Vec<Sum, D> momentum(std::int32_t slot, int node) const {
        const Sum* s = sums(slot, node);
        Vec<Sum, D> p;
        for (int a = 0; a < D; ++a) p[a] = s[(1 + a) * block_cells];
        return p;
    }
    /// Of the bodies whose volume the grid averages, where they press, times the part that they
    /// fill of so much of the node, Pa.
    MPM_INLINE double pressure(std::int32_t slot, int node, double room = 1) const {
        const Sum* s = sums(slot, node);
        double all = 0;
        for (int k = 0; k < pressure_count; ++k) {
            const GroupPressure& g = pressures[k];
            const double mass =
                from_sum<double>(s[g.weight * block_cells], clock->unit_read[mass_sum]);
            if (!(mass > 0)) continue;
            const double j =
                from_sum<double>(s[g.sum * block_cells], clock->unit_read[group_sum]) / mass;
            const double full = room * g.full;
            if (j > 0 && j < 1) all += g.at(j) * (mass < full ? mass / full : 1.0);
        }
        return all;
    }
    /// What a speed counts of a node with mass m.
    MPM_INLINE double counts(T speed, T m) const {
        const double size = absolute(double(speed));
        return double(m) < light_mass ? size * (double(m) / light_mass) : size;
    }
    /// Before any boundary.
    MPM_INLINE Vec<T, D> free_velocity(T m, const Vec<Sum, D>& p) const {
        Vec<T, D> v;
        const T inverse = T(1) / m;
        for (int a = 0; a < D; ++a) {
            v[a] = from_sum<T>(p[a], clock->unit_read[momentum_sum]) * inverse +
                   T(clock->dt * clock->gravity[a]);
        }
        return v;
    }
    /// Of a node whose velocity no other's changes. With `special`, what kernels/boundaries.hpp
    /// says of it.
    template <bool special, class Seen>
    MPM_INLINE Vec<T, D> lone_velocity(std::int32_t slot, int node, T m, const Vec<Sum, D>& p,
                                       const Seen& seen) const {
        Vec<T, D> v = free_velocity(m, p);
        if (touched[slot]) {
            std::int64_t c[D];
            cell(slot, node, c);
            apply_boundaries<special>(boundaries, c, v, seen, share(slot, node));
        }
        return v;
    }
    /// What is known of a node, now.
    MPM_INLINE KnownNodes<D> known_of(const KnownNodes<D>& all, std::int64_t at, std::int32_t slot,
                                      int node) const {
        std::int64_t c[D];
        cell(slot, node, c);
        return all.at(at, boundaries, c);
    }
    /// Of a node in a block that boundaries touch, mirrors excepted; `known`: its lines, packed.
    /// `plain`: it is on lines, and nothing else holds it. `seated`: `FollowLines` says what.
    template <bool plain, bool seated = false, class Seen>
    MPM_INLINE Vec<T, D> wall_velocity(std::int32_t slot, int node, T m, const Vec<Sum, D>& p,
                                       const KnownNodes<D>& known, std::int64_t at,
                                       const Seen& seen, const WallSeats<T>& seats = {}) const {
        Vec<T, D> v = free_velocity(m, p);
        std::int64_t c[D];
        cell(slot, node, c);
        if constexpr (plain) {
            FollowLines<NodeUpdate, T, D, true>{*this, known, at}(slot, node, c, m, v, seen);
        } else {
            const WallAsks asks = known.asks ? known.asks[at] : WallAsks(~WallNode::free);
            const Vec<T, D> free = v;
            BoundAxes<D> bound;
            if (boundaries.lines && (asks & ~(WallNode::held | WallNode::watched))) {
                const FollowLines<NodeUpdate, T, D, false, seated> lines{*this, known, at, seats};
                if constexpr (seated)
                    bound = lines(slot, node, c, m, v, seen);
                else
                    bound = lines.called(slot, node, c, m, v, seen);
            }
            if (asks & WallNode::held)
                apply_boundaries<true>(boundaries, c, v, seen, share(slot, node), bound, &free);
        }
        return v;
    }
    /// Of one that is on lines, and nothing else holds it.
    template <class Seen>
    MPM_INLINE Vec<T, D> lined_velocity(const LinedNode<D>& piece, T m, const Vec<Sum, D>& p,
                                        const Seen& seen) const {
        Vec<T, D> v = free_velocity(m, p);
        const std::int64_t c[D] = {};  // the piece says where the others are
        FollowLines<NodeUpdate, T, D, true, false, const LinedNode<D>*>{*this, &piece}(
            piece.slot(), piece.number(), c, m, v, seen);
        return v;
    }
    /// Of one that boundaries hold, and no line.
    template <class Seen>
    MPM_INLINE Vec<T, D> held_velocity(std::int32_t slot, int node, T m, const Vec<Sum, D>& p,
                                       const Seen& seen) const {
        Vec<T, D> v = free_velocity(m, p);
        std::int64_t c[D];
        cell(slot, node, c);
        apply_boundaries<true>(boundaries, c, v, seen, share(slot, node), BoundAxes<D>{});
        return v;
    }
    /// Tells `seen` what boundaries do to a node, with what is known of those beside them. `seats`:
    /// of this step.
    template <class Seen>
    MPM_INLINE void tell(std::int32_t slot, int node, T m, const Vec<Sum, D>& p,
                         const KnownNodes<D>& all, const WallSeats<T>& seats,
                         const Seen& seen) const {
        if (!touched[slot]) return;
        if (boundaries.mirrors) {
            std::int64_t c[D];
            cell(slot, node, c);
            const Images<D> images(boundaries, c);
            if (images.mirrored) {
                mirrored_velocity(images, free_velocity(m, p), seen);
                return;
            }
        }
        KnownNodes<D> own = {};
        std::int64_t at = 0;
        if (all.asks && !boundaries.mirrors) {
            at = all.place(slot, node);
            if (all.asks[at] == WallNode::free) return;
            if (all.asks[at] == WallNode::on_lines) {
                wall_velocity<true>(slot, node, m, p, all, at, seen);
                return;
            }
            own = known_of(all, at, slot, node);
        }
        wall_velocity<false>(slot, node, m, p, own, at, seen, seats);
    }
    /// Part of a node's mass that lies in some channels.
    MPM_INLINE double part_of(const Sum* s, std::uint64_t channels) const {
        double part = 0;
        for (int c = 0; c < grid.sum_channels; ++c)
            if (channels >> c & 1)
                part += from_sum<double>(s[c * block_cells], clock->unit_read[mass_sum]);
        return part;
    }
    /// How fast a solid that has contact closes its gap to a plane in one step, m/s: 0 where it
    /// touches. Held nodes reach two cells: by them alone a body would lie on a bed, and rub there,
    /// that water between them keeps it off. The plane's normal is along an axis, or leans by
    /// `leans`, its parts over that along the axis; the node lies so many cells above it along the
    /// axis. The gap follows from the rows of nodes on both sides of the body's face, of which the
    /// lower one has less mass the further off the face lies; both have as little beside its edges.
    /// Below a corner the rows have the gap of a face further off, the more the steeper its sides
    /// rise to the columns beside it (design/walls.md, 9).
    MPM_CALL double closing_speed(std::int32_t slot, int node, int axis, int sign, double height,
                                  const double (&leans)[D]) const {
        const Reconverge at_return;
        const BlockTableView<D>& table = grid.table;
        const std::int64_t field = std::int64_t(table.keys_of.field(table.keys[slot]));
        if (boundaries.solid_fields[field] != closes_gaps) return 0;
        // The lower row is that with heights in (-1/4, 3/4].
        const int up = int(floor(0.75 - height));
        if (up < -1 || up > 1) return 0;
        // Mass of a row of the node's column, or of one beside it.
        const auto row = [&](int by, int beside, int side) {
            int at[D], around, there;
            Block<D>::coordinates(node, at);
            for (int a = 0; a < D; ++a)
                at[a] += Block<D>::margin + (a == axis ? by * sign : a == beside ? side : 0);
            arena_node<D>(at, around, there);
            const std::int32_t of =
                table.neighbours[std::int64_t(slot) * Block<D>::neighbours + around];
            return of < 0 ? 0.0 : from_sum<double>(sums(of, there)[0], clock->unit_read[mass_sum]);
        };
        const auto gap_below = [&](double lower, double upper, double low) {  // cells
            double gap = 0;
            const double touching = upper * filled_at(low) / filled_at(low + 1);
            for (int k = 0; k < 4 && lower < touching; ++k)
                gap = low - depth_of(lower / upper * filled_at(low + 1 - gap));
            return gap;
        };
        const double low = height + up, upper = row(up + 1, axis, 0),
                     here = gap_below(row(up, axis, 0), upper, low);
        double gap = here;
        for (int a = 0; a < D && gap > 0; ++a) {
            if (a == axis) continue;
            double rise = 0;
            for (int side = -1; side < 2; side += 2) {
                const double above = row(up + 1, a, side);
                if (!(above > 1e-3 * upper)) continue;
                const double more =
                    gap_below(row(up, a, side), above, low + side * leans[a]) - here;
                rise = more > rise ? more : rise;
            }
            gap -= 1.1 * rise < 0.5 ? 1.1 * rise : 0.5;
        }
        return gap > 0 ? gap * boundaries.cell_size / clock->dt : 0;
    }
    /// Of a node, as `apply_boundaries` asks for it.
    struct Share {
        const NodeUpdate& of;
        std::int32_t slot;
        int node;
        MPM_INLINE double operator()(std::uint64_t channels) const {
            const Sum* s = of.sums(slot, node);
            const double part = of.part_of(s, channels) / of.part_of(s, 1);
            return part < 1 ? part : 1.0;
        }
        MPM_INLINE T rubs(int boundary, T part) const {
            return of.rubbing.at(boundary, of.touched[slot], node, part);
        }
        MPM_INLINE double closing_speed(int axis, int sign, double height,
                                        const double (&leans)[D]) const {
            if (!of.boundaries.solid_fields) return 0;
            return of.closing_speed(slot, node, axis, sign, height, leans);
        }
    };
    MPM_INLINE Share share(std::int32_t slot, int node) const { return {*this, slot, node}; }
    /// f(sums of a node, sign of each component) over all nodes that share by mirrored planes.
    template <class F>
    MPM_INLINE void each_image(const Images<D>& images, const F& f) const {
        images.each([&](const std::int64_t(&at)[D], const double(&sign)[D]) {
            int number = 0;
            const std::int32_t slot = find_node<D>(grid.table, at, number);
            if (slot >= 0) f(sums(slot, number), sign);
        });
    }
    /// Mass of all nodes that share, 0 where it is negligible.
    MPM_CALL T shared_mass(const Images<D>& images) const {
        const Reconverge at_return;
        T all = 0;
        std::int64_t quanta = 0;
        each_image(images, [&](const Sum* s, const double(&)[D]) {
            if constexpr (std::is_integral_v<Sum>) quanta += std::int64_t(s[0]);
            all += from_sum<T>(s[0], clock->unit_read[mass_sum]);
        });
        if constexpr (std::is_integral_v<Sum>) {
            if (quanta < least_quanta) return 0;
        }
        return all > T(negligible_mass<T> * least_mass) ? all : T(0);
    }
    /// Of a node whose images have mass; `own` is what it would have by itself, for `seen`.
    template <class Seen>
    MPM_CALL Vec<T, D> mirrored_velocity(const Images<D>& images, const Vec<T, D>& own,
                                         const Seen& seen) const {
        const Reconverge at_return;
        T mass = 0;
        Vec<T, D> v{};
        each_image(images, [&](const Sum* s, const double(&sign)[D]) {
            const T m = from_sum<T>(s[0], clock->unit_read[mass_sum]);
            mass += m;
            for (int a = 0; a < D; ++a) {
                v[a] += T(sign[a]) *
                        (from_sum<T>(s[(1 + a) * block_cells], clock->unit_read[momentum_sum]) +
                         m * T(clock->dt * clock->gravity[a]));
            }
        });
        const auto here = [&](const Vec<T, D>& there) {
            Vec<T, D> u;
            for (int a = 0; a < D; ++a) u[a] = T(images.sign[a]) * there[a];
            return u;
        };
        for (int a = 0; a < D; ++a) v[a] = v[a] / mass;
        tell_planes(images, own, here(v), seen);
        const auto part = [&](std::uint64_t channels) {
            double of = 0, all = 0;
            each_image(images, [&](const Sum* sum, const double(&)[D]) {
                of += part_of(sum, channels);
                all += part_of(sum, 1);
            });
            return of < all ? of / all : 1.0;
        };
        apply_boundaries<true>(
            boundaries, images.inside, v,
            [&](int b, int face, const Vec<T, D>& before, const Vec<T, D>& after) {
                seen(b, face, here(before), here(after));
            },
            part);
        return here(v);
    }
    /// What each plane has changed: its own component, all of them where it is sticky. What the two
    /// nodes of a pair exchange along the plane cancels in their sum.
    template <class Seen>
    MPM_INLINE void tell_planes(const Images<D>& images, const Vec<T, D>& before,
                                const Vec<T, D>& after, const Seen& seen) const {
        Vec<T, D> now = before;
        bool told[D] = {};
        for (int a = 0; a < D; ++a) {
            if (images.face[a] < 0) continue;
            const Vec<T, D> was = now;
            for (int c = 0; c < D; ++c) {
                if (told[c] || !(c == a || images.reverses_all[a] || images.face[c] < 0)) continue;
                now[c] = after[c];
                told[c] = true;
            }
            seen(images.boundary[a], images.face[a], was, now);
        }
    }
};

/// Where schemes that store velocities find more at a node (kernels/phase.hpp); -1: absent.
struct KeptChannels {
    int plain = -1;   // sums: D, momentum without stress
    int before = -1;  // velocities: D, of that momentum alone
    int guard = -1;   // 1: a boundary changed the velocity
    bool any() const { return plain >= 0 || before >= 0 || guard >= 0; }
    /// Three dimensions: whether the velocities and the guard, or a number that is nobody's, are
    /// one piece of the `channels` of a node.
    MPM_INLINE bool in_one_piece(int channels) const {
        return before >= 0 && before % 4 == 0 && channels % 4 == 0 &&
               (guard < 0 ? before + 4 == channels : guard == before + 3);
    }
};

/// Hears whether any boundary has changed a velocity.
template <class T, int D>
struct Changed {
    bool* changed;
    MPM_INLINE void operator()(int, int, const Vec<T, D>& before, const Vec<T, D>& after) const {
        for (int a = 0; a < D; ++a) *changed = *changed || before[a] != after[a];
    }
};

/// Velocities that `MoveWallNodes` has made, by (listed block, node): those of a block whose flag
/// `touched` is k > 0 begin at node (k - 1) block_cells.
template <class T, int D>
struct WallNodes {
    T* velocity = nullptr;            // of D components; null where there are none
    std::uint8_t* changed = nullptr;  // by any boundary
    const WallAsks* asks = nullptr;   // null where a scene has no such boundaries
    T* seat = nullptr;                // as `WallSeats` has it
    // Hosts: those on lines alone, which the pass over all nodes moves.
    const LinedNode<D>* lined = nullptr;
    std::int64_t lined_count = 0;
};

/// Over all nodes of all blocks. Leaves velocities and averages, clears the sums that the step will
/// fill, and gathers the maxima that the clock decides by. `keeps`: also what `KeptChannels` names;
/// `mirrors`: mirrored planes, and what else kernels/boundaries.hpp calls special beside them.
/// `lines`: nodes on lines alone come first, from their list.
template <class T, class Sum, int D, bool keeps = false, bool mirrors = false, bool lines = false>
struct UpdateGrid {
    NodeUpdate<T, Sum, D> node;
    Sum* next;  // sums to clear
    const GroupChannels* groups;
    int group_count;
    GroupChannels only;  // the group if there is one alone
    KeptChannels kept = {};
    WallNodes<T, D> walls = {};

    MPM_INLINE void operator()(std::int64_t i, double (&maxima)[maxima_count]) const {
        const auto& g = node.grid;
        if (node.clock->halt != Halt::none) return;
        // Nodes of the list come here twice: with their piece they get what they have by their
        // lines, without it their sums are cleared.
        const LinedNode<D>* piece = nullptr;
        if constexpr (lines) {
            if (i < walls.lined_count) {
                piece = walls.lined + i;
                i = piece->node;
            } else {
                i -= walls.lined_count;
            }
        }
        const std::int32_t slot = std::int32_t(i / block_cells);
        const int n = int(i % block_cells);
        T* out = g.velocity + g.velocity_place(slot, n);
        // All reads first, none waits for another: most nodes carry mass.
        const Sum* s = node.sums(slot, n);
        const Sum mass = s[0];
        const Vec<Sum, D> p = node.momentum(slot, n);
        // With one group the node's velocities and its average are stored in one piece.
        const bool in_one = D == 3 && group_count == 1;
        Sum of_group = 0, of_weight = 0;
        if (in_one) of_group = s[only.sum * block_cells];
        if (in_one && only.weight >= 0) of_weight = s[only.weight * block_cells];
        Sum plain[D] = {};
        if constexpr (keeps)
            for (int a = 0; a < D; ++a)
                if (kept.before >= 0) plain[a] = s[(kept.plain + a) * block_cells];

        Sum* clear = next + std::int64_t(slot) * g.sum_channels * block_cells + n;
        for (int c = 0; c < g.sum_channels && !piece; ++c) clear[c * block_cells] = 0;
        const T m = node.mass(mass);
        if constexpr (mirrors) {
            if (node.touched[slot]) {
                std::int64_t c[D];
                node.cell(slot, n, c);
                const Images<D> images(node.boundaries, c);
                if (images.mirrored) return update_mirrored(images, c, m, out, maxima);
            }
        }
        if (piece && !(m > T(0))) return;
        Vec<T, D> v{};
        [[maybe_unused]] bool changed = false;
        if (m > T(0)) {
            std::uint32_t listed = 0;
            if constexpr (lines)
                listed = walls.asks && !piece ? node.touched[slot] : 0;
            else
                listed = walls.velocity ? node.touched[slot] : 0;
            if (piece) {
                v = node.lined_velocity(*piece, m, p, Changed<T, D>{&changed});
            } else if (listed > 0) {
                const std::int64_t at = std::int64_t(listed - 1) * block_cells + n;
                if (lines && walls.asks[at] == WallNode::on_lines) return;  // it has its own turn
                const bool free = walls.asks[at] == WallNode::free;
                if (free)
                    v = node.free_velocity(m, p);
                else
                    for (int a = 0; a < D; ++a) v[a] = walls.velocity[at * D + a];
                if constexpr (keeps) changed = kept.guard >= 0 && !free && walls.changed[at];
            } else if constexpr (keeps) {
                v = node.template lone_velocity<mirrors>(slot, n, m, p, Changed<T, D>{&changed});
            } else {
                v = node.template lone_velocity<mirrors>(slot, n, m, p, NothingSeen{});
            }
            for (int a = 0; a < D; ++a) larger_of(maxima[max_speed], node.counts(v[a], m));
            if constexpr (std::is_integral_v<Sum>) larger_of(maxima[max_mass], double(m));
        }
        struct alignas(16) Piece {
            T e[4];
        };
        if constexpr (keeps) {
            T before[D];
            for (int a = 0; a < D; ++a)
                before[a] = m > T(0)
                                ? from_sum<T>(plain[a], node.clock->unit_read[momentum_sum]) / m
                                : T(0);
            const T guard = T(changed ? 1 : 0);
            if (D == 3 && kept.in_one_piece(g.velocity_channels)) {
                *reinterpret_cast<Piece*>(out + kept.before) = {
                    {before[0], before[1], before[D - 1], guard}};
            } else {
                for (int a = 0; a < D && kept.before >= 0; ++a) out[kept.before + a] = before[a];
                if (kept.guard >= 0) out[kept.guard] = guard;
            }
        }
        if constexpr (D == 3) {
            if (in_one) {
                *reinterpret_cast<Piece*>(out) = {
                    {v[0], v[1], v[2],
                     m > T(0) ? average(of_group, only.weight >= 0 ? of_weight : mass) : T(0)}};
                return;
            }
        }
        for (int a = 0; a < D; ++a) out[a] = v[a];
        for (int k = 0; k < group_count; ++k) {
            const GroupChannels& c = groups[k];
            out[c.average] = m > T(0) ? average(s[c.sum * block_cells],
                                                s[(c.weight < 0 ? 0 : c.weight) * block_cells])
                                      : T(0);
        }
    }
    /// The same for a node that shares with others by mirrored planes.
    MPM_INLINE void update_mirrored(Images<D> images, const std::int64_t (&cell)[D], T own_mass,
                                    T* out, double (&maxima)[maxima_count]) const {
        const T m = node.shared_mass(images);
        Vec<T, D> v{};
        if (m > T(0)) v = node.mirrored_velocity(images, v, NothingSeen{});
        for (int a = 0; a < D; ++a) {
            out[a] = v[a];
            larger_of(maxima[max_speed], node.counts(v[a], m));
        }
        if constexpr (std::is_integral_v<Sum>) larger_of(maxima[max_mass], double(own_mass));
        if constexpr (keeps) {
            // A wall has changed it, whatever its velocity was before.
            if (kept.guard >= 0) out[kept.guard] = T(m > T(0) ? 1 : 0);
            for (int a = 0; a < D && kept.before >= 0; ++a) {
                T plain = 0;
                node.each_image(images, [&](const Sum* s, const double(&sign)[D]) {
                    plain += T(sign[a]) * from_sum<T>(s[(kept.plain + a) * block_cells],
                                                      node.clock->unit_read[momentum_sum]);
                });
                out[kept.before + a] = m > T(0) ? T(images.sign[a]) * plain / m : T(0);
            }
        }
        // Pressure grows towards a plane that gravity presses on, and an image would end that slope
        // there: water would relax to less than its weight beside the plane, and sink for ever. The
        // slope that is carried leads on to the node beyond (design/walls.md, 3).
        for (int a = 0; a < D; ++a)
            if (node.clock->gravity[a] != 0) images.part(a, cell[a]);
        for (int k = 0; k < group_count; ++k) {
            const GroupChannels& c = groups[k];
            T sum = 0, weight = 0;
            node.each_image(images, [&](const Sum* s, const double(&)[D]) {
                sum += from_sum<T>(s[c.sum * block_cells], node.clock->unit_read[group_sum]);
                weight += from_sum<T>(s[(c.weight < 0 ? 0 : c.weight) * block_cells],
                                      node.clock->unit_read[mass_sum]);
            });
            out[c.average] = m > T(0) && weight > T(0) ? sum / weight : T(0);
        }
    }
    MPM_INLINE T average(Sum sum, Sum weight) const {
        const T w = from_sum<T>(weight, node.clock->unit_read[mass_sum]);
        return w > T(0) ? from_sum<T>(sum, node.clock->unit_read[group_sum]) / w : T(0);
    }
    // Not-a-number counts as infinite: nothing that is wrong may pass for slow.
    MPM_INLINE static void larger_of(double& to, double x) {
        if (!(x <= to)) to = x == x ? x : 1e300;
    }
};

}  // namespace mpm
