// Contact between bodies that have fields of velocities of their own: what becomes of the nodes
// where several fields have mass, after the grid update and before the bodies (design/contact.md).
//
// Fields that no law keeps apart are stuck: they move as one, as a run with one field would have
// it. Those with a law push each other by physics/contact.hpp, pair by pair in the order of their
// fields, twice where there are several pairs. Boundaries act before, so that a body on a floor
// carries the one on it, and after each push.
//
// All follows from sums that nobody changes, so that sensors may work it out again; what the grid
// update has left has the same bits, or differs by rounding where products are fused with sums.
#pragma once

#include <limits>

#include "mpm/kernels/grid.hpp"
#include "mpm/physics/contact.hpp"

namespace mpm {

/// Fields with mass at one node that are kept apart; more is a fault.
inline constexpr int most_fields_at_node = 16;

struct ContactView {
    const ContactLaw* laws;
    const std::int32_t* law_of;   // (kinds, kinds): which of them; -1: stuck
    const std::int32_t* kind_of;  // (fields,)
    const double* full;           // (kinds,): mass of a node that a body at rest fills, kg
    std::int32_t kinds;
    const std::int32_t* first;  // of each block with several fields: their first slot
    const std::int32_t* count;  // and how many slots
    std::int32_t blocks;
    std::int32_t filled;  // the sum by which what fills a node differs from its mass; -1: none
    std::int32_t fields;  // but those of rigid bodies, which are the last (design/rigid.md)
};

/// The slots of the block that a slot is of, one for each of the first `fields` fields there.
template <int D>
MPM_INLINE void find_siblings(const BlockTableView<D>& table, std::int32_t slot,
                              std::int32_t fields, std::int32_t& first, std::int32_t& count) {
    const std::uint64_t low =
        table.keys[slot] - std::uint64_t(table.keys_of.field(table.keys[slot]));
    first = slot;
    while (first > 0 && table.keys[first - 1] >= low) --first;
    std::int32_t last = slot + 1;
    while (last < table.slots && table.keys[last] < low + std::uint64_t(fields)) ++last;
    count = last - first;
}

/// One node with all its fields.
template <class T, class Sum, int D>
struct NodeContact {
    /// Part of the velocities: an approach beside boundaries that is slower is none. What a
    /// boundary leaves of a push is a difference of velocities, off by a few roundings of them.
    /// Where that was all there was, boundaries seemed to hold what they do not, and light bodies
    /// were thrown.
    static constexpr T least_approach = 64 * std::numeric_limits<T>::epsilon();

    NodeUpdate<T, Sum, D> node;
    ContactView contact;
    KnownNodes<D> known = {};  // where nodes beside boundaries are listed

    /// The fields that have mass at a node.
    struct Fields {
        int count = 0;
        bool too_many = false;
        std::int32_t slot[most_fields_at_node];
        std::int32_t kind[most_fields_at_node];
        int of[most_fields_at_node];   // the first of those that it is stuck to, or itself
        T mass[most_fields_at_node];   // its own, kg
        T fills[most_fields_at_node];  // what its volume there would weigh, kg
        // Of the first of those that are stuck to each other, for all of them:
        T together[most_fields_at_node];
        Vec<T, D> velocity[most_fields_at_node];
        Vec<T, D> lined[most_fields_at_node];  // as lines towards walls gave it
        bool pushed[most_fields_at_node];      // by another body
        bool held[most_fields_at_node];        // by a boundary
        bool several = false;                  // are any stuck
    };

    /// Do several fields have mass there?
    MPM_INLINE bool meet_at(std::int32_t first, std::int32_t count, int n) const {
        int found = 0;
        for (std::int32_t k = 0; k < count && found < 2; ++k)
            found += node.mass(first + k, n) > T(0);
        return found > 1;
    }
    MPM_CALL void find(std::int32_t first, std::int32_t count, int n, Fields& f) const {
        const Reconverge at_return;
        for (std::int32_t k = 0; k < count; ++k) {
            const T m = node.mass(first + k, n);
            if (!(m > T(0))) continue;
            if (f.count == most_fields_at_node) {
                f.too_many = true;
                return;
            }
            const int i = f.count++;
            f.slot[i] = first + k;
            f.kind[i] =
                contact.kind_of[node.grid.table.keys_of.field(node.grid.table.keys[first + k])];
            f.mass[i] = m;
            f.fills[i] = fills(first + k, n);
            f.of[i] = i;
            f.pushed[i] = f.held[i] = false;
        }
        for (int i = 0; i < f.count; ++i)
            for (int j = i + 1; j < f.count; ++j)
                if (law(f, i, j) < 0) stick(f, i, j);
    }
    /// What fills a node: its mass, but for bodies of elements, whose mass is at vertices.
    MPM_INLINE T fills(std::int32_t slot, int n) const {
        const auto sums = node.sums(slot, n);
        const double unit = node.clock->unit_read[mass_sum];
        T m = from_sum<T>(sums[0], unit);
        if (contact.filled >= 0) m = m + from_sum<T>(sums[contact.filled * block_cells], unit);
        return m;
    }
    MPM_INLINE std::int32_t law(const Fields& f, int i, int j) const {
        return contact.law_of[f.kind[i] * contact.kinds + f.kind[j]];
    }
    MPM_INLINE static void stick(Fields& f, int i, int j) {
        const int a = f.of[i] < f.of[j] ? f.of[i] : f.of[j], b = f.of[i] + f.of[j] - a;
        if (a == b) return;
        f.several = true;
        for (int k = 0; k < f.count; ++k)
            if (f.of[k] == b) f.of[k] = a;
    }

    /// Of one body, or of all that stick: what hears of boundaries. One type for all who ask, or
    /// each would compile the boundaries once more. `seen` may be null.
    template <class Seen>
    struct Told {
        bool* changed;
        const Seen* seen;
        const Fields* f;
        int first, last;  // of the fields, those that stick to `of`
        int of;

        MPM_INLINE void operator()(int boundary, int face, const Vec<T, D>& before,
                                   const Vec<T, D>& after) const {
            Changed<T, D>{changed}(boundary, face, before, after);
            for (int k = first; k < last && seen; ++k)
                if (f->of[k] == of) (*seen)(k, boundary, face, before, after);
        }
    };

    /// Velocities after gravity, contact and boundaries; `seen(i, boundary, face, before, after)`
    /// hears of every response of a boundary on field i's mass, and `met(i, j, impulse, normal, w,
    /// mass)` of every impulse on field j, minus that on i: at the approach w = v_i - v_j before
    /// it, of so much reduced mass.
    template <class Seen, class Met = NothingSeen>
    MPM_INLINE void solve(int n, Fields& f, const Seen& seen, const Met& met = {}) const {
        for (int i = 0; i < f.count; ++i)
            if (f.of[i] == i) begin(n, f, i, seen);
        meet_all(n, f, seen, met);
    }
    /// What of `solve` comes after boundaries.
    template <class Seen, class Met>
    MPM_INLINE void meet_all(int n, Fields& f, const Seen& seen, const Met& met) const {
        int pairs = 0;
        for (int i = 0; i < f.count; ++i)
            for (int j = i + 1; j < f.count; ++j) pairs += f.of[i] != f.of[j];
        for (int sweep = 0; sweep < (pairs > 1 ? 2 : 1); ++sweep)
            for (int i = 0; i < f.count; ++i)
                for (int j = i + 1; j < f.count; ++j)
                    if (f.of[i] != f.of[j]) meet(n, f, i, j, seen, met);
    }

    /// Before any contact, where none are stuck: what the grid update has left, which is the same.
    MPM_INLINE void begin_as_updated(int n, Fields& f) const {
        for (int i = 0; i < f.count; ++i) {
            const T* left = node.grid.velocity + node.grid.velocity_place(f.slot[i], n);
            for (int a = 0; a < D; ++a) f.velocity[i][a] = f.lined[i][a] = left[a];
            f.together[i] = f.mass[i];
        }
    }
    /// Before any contact: as one body that all those stuck together make.
    template <class Seen>
    MPM_INLINE void begin(int n, Fields& f, int i, const Seen& seen) const {
        if (on_lines(f.slot[i])) return begin_on_lines(n, f, i, seen);
        Vec<T, D> p{};
        T m = 0;
        for (int k = i; k < f.count; ++k) {
            if (f.of[k] != i) continue;
            m += f.mass[k];
            const Vec<Sum, D> sum = node.momentum(f.slot[k], n);
            for (int a = 0; a < D; ++a)
                p[a] += from_sum<T>(sum[a], node.clock->unit_read[momentum_sum]);
        }
        const T inverse = T(1) / m;
        for (int a = 0; a < D; ++a)
            f.velocity[i][a] = p[a] * inverse + T(node.clock->dt * node.clock->gravity[a]);
        f.together[i] = m;
        respond_of(n, f, i, seen);
    }
    /// May lines of nodes towards linear walls go through a block?
    MPM_INLINE bool on_lines(std::int32_t slot) const {
        return node.touched[slot] && (node.boundaries.lines || node.boundaries.surface_lines);
    }
    /// Each field follows lines of its own, whose nodes have only its mass.
    template <class Seen>
    MPM_CALL void begin_on_lines(int n, Fields& f, int i, const Seen& seen) const {
        const Reconverge at_return;
        Vec<T, D> p{};
        T m = 0;
        for (int k = i; k < f.count; ++k) {
            if (f.of[k] != i) continue;
            const std::int64_t at = listed_at(f.slot[k], n);
            const Vec<T, D> v = node.template wall_velocity<false>(
                f.slot[k], n, f.mass[k], node.momentum(f.slot[k], n),
                node.known_of(known, at, f.slot[k], n), at,
                Told<Seen>{&f.held[i], &seen, &f, k, k + 1, i});
            m += f.mass[k];
            for (int a = 0; a < D; ++a) p[a] += f.several ? f.mass[k] * v[a] : v[a];
        }
        // By itself it has what the grid update has left.
        for (int a = 0; a < D && f.several; ++a) p[a] /= m;
        f.velocity[i] = f.lined[i] = p;
        f.together[i] = m;
    }
    MPM_INLINE std::int64_t listed_at(std::int32_t slot, int n) const {
        return std::int64_t(node.touched[slot] - 1) * block_cells + n;
    }
    template <class Seen>
    MPM_INLINE void respond_of(int n, Fields& f, int i, const Seen& seen) const {
        respond(n, f, i, f.velocity[i], Told<Seen>{&f.held[i], &seen, &f, i, f.count, i});
    }
    /// Of a field and all that is stuck to it, as `apply_boundaries` asks for it.
    struct Share {
        const NodeUpdate<T, Sum, D>& node;
        const Fields& f;
        int n, i;
        MPM_INLINE double operator()(std::uint64_t channels) const {
            double part = 0, all = 0;
            for (int k = i; k < f.count; ++k) {
                if (f.of[k] != i) continue;
                part += node.part_of(node.sums(f.slot[k], n), channels);
                all += node.part_of(node.sums(f.slot[k], n), 1);
            }
            return part < all ? part / all : 1.0;
        }
        /// The slowest of them: what is stuck touches with the first.
        MPM_INLINE double closing_speed(int axis, int sign, double height,
                                        const double (&leans)[D]) const {
            double least = node.share(f.slot[i], n).closing_speed(axis, sign, height, leans);
            for (int k = i + 1; k < f.count; ++k) {
                if (f.of[k] != i) continue;
                const double one =
                    node.share(f.slot[k], n).closing_speed(axis, sign, height, leans);
                least = one < least ? one : least;
            }
            return least;
        }
    };
    /// What boundaries make of a velocity of a field, and of all that is stuck to it.
    template <class Seen>
    MPM_CALL void respond(int n, const Fields& f, int i, Vec<T, D>& v, const Seen& seen) const {
        const Reconverge at_return;
        if (!node.touched[f.slot[i]]) return;
        std::int64_t c[D];
        node.cell(f.slot[i], n, c);
        const Share share{node, f, n, i};
        const Vec<T, D> free = v;
        BoundAxes<D> bound;
        if (on_lines(f.slot[i])) {
            const std::int64_t at = listed_at(f.slot[i], n);
            bound =
                FollowLines<NodeUpdate<T, Sum, D>, T, D>{node,
                                                         node.known_of(known, at, f.slot[i], n), at}
                    .keep_on_lines(f.slot[i], c, f.lined[i], v, seen);
        }
        apply_boundaries<true>(node.boundaries, c, v, seen, share, bound, &free);
    }
    /// The part, 0 to 1, of a change of velocity along a unit vector that boundaries let a field
    /// have, asked for with a change by `by`. `given`: what the field gets of a change by one.
    template <class Seen = NothingSeen>
    MPM_INLINE T part_given(int n, const Fields& f, int i, const Vec<T, D>& along, T by,
                            const Seen* = nullptr, Vec<T, D>* given = nullptr) const {
        bool changed = false;
        Vec<T, D> v = f.velocity[i];
        for (int x = 0; x < D; ++x) v[x] += by * along[x];
        respond(n, f, i, v, Told<Seen>{&changed, nullptr, &f, 0, 0, i});
        if (given) *given = along;
        if (!changed || by == T(0)) return T(1);
        T got = 0;
        for (int x = 0; x < D; ++x) {
            v[x] -= f.velocity[i][x];
            got += v[x] * along[x];
        }
        const T part = got / by;
        if (!(part > T(0) && part < T(1))) {
            if (given && !(part > T(0))) *given = Vec<T, D>{};
            return part > T(0) ? T(1) : T(0);
        }
        for (int x = 0; x < D && given; ++x) (*given)[x] = v[x] / by;
        return part;
    }
    /// What an impulse along a unit vector meets between two fields.
    struct Meeting {
        T mass;              // reduced, by `mass_beside_walls` where a boundary limits one of them
        T whole;             // without that bound
        Vec<T, D> mobility;  // w changes by the impulse times minus this
    };
    /// Along a unit vector in which two fields approach at `speed` more than is allowed. `mass`: of
    /// both as if free. `w`: their relative velocity.
    template <class Seen>
    MPM_INLINE Meeting meeting_beside_boundaries(int n, const Fields& f, int a, int b,
                                                 const Vec<T, D>& along, T speed, T mass,
                                                 const Seen* told, const Vec<T, D>& w,
                                                 T allowed) const {
        const T push = mass * speed;
        Meeting out;
        Vec<T, D> by_b;
        const T of_a = part_given(n, f, a, along, -push / f.together[a], told, &out.mobility),
                of_b = part_given(n, f, b, along, push / f.together[b], told, &by_b);
        for (int x = 0; x < D; ++x)
            out.mobility[x] = out.mobility[x] / f.together[a] + by_b[x] / f.together[b];
        if (of_a == T(1) && of_b == T(1)) {
            out.mass = out.whole = mass;
            return out;
        }
        const T inverse = of_a / f.together[a] + of_b / f.together[b];
        out.mass = out.whole = 0;
        if (!(inverse > T(0))) return out;
        out.whole = T(1) / inverse;
        out.mass = mass_beside_walls<T, D>(out.mobility, w, inverse, speed, allowed,
                                           of_a == T(1) || of_b == T(1));
        return out;
    }

    /// The part of an impulse beside boundaries by which no body gains more speed than |w|, the
    /// size of the relative velocity. What boundaries leave of it was asked of the push and of
    /// friction apart, and one that lets go, or rubs, answers both together otherwise. What their
    /// friction takes of a body's speed is no matter.
    template <class Seen>
    MPM_INLINE T part_that_acts(int n, const Fields& f, int a, int b, const Vec<T, D>& impulse,
                                const Vec<T, D>& w, const Seen* told) const {
        const T inverse = T(1) / f.together[a] + T(1) / f.together[b];
        const T most = length(w) * (T(1) + least_approach);    // rounded
        if (!(length(impulse) * inverse > most)) return T(1);  // boundaries add nothing to it
        const T of_a = gained(f.velocity[a], changed_by(n, f, a, impulse, T(-1), told)),
                of_b = gained(f.velocity[b], changed_by(n, f, b, impulse, T(1), told));
        const T more = of_a > of_b ? of_a : of_b;
        return more <= most ? T(1) : most / more;
    }
    /// Speed, or speed backwards: friction of a wall takes speed, and turns nobody round.
    MPM_INLINE static T gained(const Vec<T, D>& before, const Vec<T, D>& after) {
        const T size = length(before), more = length(after) - size;
        T back = 0;
        for (int x = 0; x < D; ++x) back -= after[x] * before[x];
        return size > T(0) && back > more * size ? back / size : more;
    }
    MPM_INLINE static T length(const Vec<T, D>& v) {
        T square = 0;
        for (int x = 0; x < D; ++x) square += v[x] * v[x];
        return square_root(square);
    }
    /// The velocity of a field after so much of an impulse, by boundaries.
    template <class Seen>
    MPM_INLINE Vec<T, D> changed_by(int n, const Fields& f, int i, const Vec<T, D>& impulse, T part,
                                    const Seen*) const {
        bool changed = false;
        Vec<T, D> v = f.velocity[i];
        for (int x = 0; x < D; ++x) v[x] += part * impulse[x] / f.together[i];
        respond(n, f, i, v, Told<Seen>{&changed, nullptr, &f, 0, 0, i});
        return v;
    }
    MPM_INLINE static T largest_of(const Vec<T, D>& u, const Vec<T, D>& v) {
        T most = 0;
        for (int x = 0; x < D; ++x) {
            if (absolute(u[x]) > most) most = absolute(u[x]);
            if (absolute(v[x]) > most) most = absolute(v[x]);
        }
        return most;
    }

    /// How two fields approach each other.
    struct Approach {
        Vec<T, D> w, normal;
        T allowed;  // along the normal, m/s
        T speed;    // more than that
    };
    /// False where they do not.
    MPM_INLINE bool approach(int n, const Fields& f, int i, int j, Approach& out) const {
        const int a = f.of[i], b = f.of[j];
        const T of_a = T(1 / contact.full[f.kind[i]]), of_b = T(1 / contact.full[f.kind[j]]);
        if (!approach_allowed<T>(contact.laws[law(f, i, j)], f.fills[i] * of_a, f.fills[j] * of_b,
                                 node.boundaries.cell_size / node.clock->dt, out.allowed))
            return false;
        T square = 0, along = 0;
        for (int x = 0; x < D; ++x) {
            out.w[x] = f.velocity[a][x] - f.velocity[b][x];
            square += out.w[x] * out.w[x];
        }
        // Slower than the gap allows in any direction: there is no normal to look for.
        if (!(square > out.allowed * out.allowed)) return false;
        if (!direction(f.slot[i], f.slot[j], of_a, of_b, n, out.normal)) return false;
        for (int x = 0; x < D; ++x) along += out.w[x] * out.normal[x];
        out.speed = along - out.allowed;
        return out.speed > (beside_boundaries(f, a, b)
                                ? least_approach * largest_of(f.velocity[a], f.velocity[b])
                                : T(0));
    }
    MPM_INLINE bool beside_boundaries(const Fields& f, int a, int b) const {
        return node.touched[f.slot[a]] || node.touched[f.slot[b]];
    }
    /// Do any two fields approach each other?
    MPM_INLINE bool any_approach(int n, const Fields& f) const {
        Approach found;
        for (int i = 0; i < f.count; ++i)
            for (int j = i + 1; j < f.count; ++j)
                if (f.of[i] != f.of[j] && approach(n, f, i, j, found)) return true;
        return false;
    }

    /// The impulse that two fields exchange, on all that is stuck to them.
    template <class Seen, class Met>
    MPM_CALL void meet(int n, Fields& f, int i, int j, const Seen& seen, const Met& met) const {
        const Reconverge at_return;
        const int a = f.of[i], b = f.of[j];
        Approach found;
        if (!approach(n, f, i, j, found)) return;
        const Vec<T, D>&w = found.w, &normal = found.normal;
        const T speed = found.speed, allowed = found.allowed;
        Vec<T, D> impulse;
        const T mass = f.together[a] * f.together[b] / (f.together[a] + f.together[b]);
        T mass_along = mass, mass_across = mass, whole_across = mass;
        const bool beside = beside_boundaries(f, a, b);
        if (beside) {
            Vec<T, D> slide, left;
            for (int x = 0; x < D; ++x) slide[x] = w[x] - (speed + allowed) * normal[x];
            const T across = length(slide);
            const Meeting pushed =
                meeting_beside_boundaries(n, f, a, b, normal, speed, mass, &seen, w, allowed);
            mass_along = pushed.mass;
            if (!(mass_along > T(0))) return;
            if (across > T(0)) {
                // Friction has what the push leaves.
                for (int x = 0; x < D; ++x) {
                    slide[x] /= across;
                    left[x] = w[x] - mass_along * speed * pushed.mobility[x];
                }
                const Meeting rubbed =
                    meeting_beside_boundaries(n, f, a, b, slide, across, mass, &seen, left, T(0));
                mass_across = rubbed.mass;
                whole_across = rubbed.whole;
            }
        }
        if (!contact_impulse<T, D>(contact.laws[law(f, i, j)], normal, w, mass_along, mass_across,
                                   allowed, impulse))
            return;
        if (beside) {
            const T part = part_that_acts(n, f, a, b, impulse, w, &seen);
            for (int x = 0; x < D; ++x) impulse[x] *= part;
        }
        for (int x = 0; x < D; ++x) {
            f.velocity[a][x] -= impulse[x] / f.together[a];
            f.velocity[b][x] += impulse[x] / f.together[b];
        }
        f.pushed[a] = f.pushed[b] = true;
        met(i, j, impulse, normal, w, whole_across);
        if (!beside) return;
        // At once, so that no other body is pushed by what a boundary does not let move.
        respond_of(n, f, a, seen);
        respond_of(n, f, b, seen);
    }
    /// Where a field's own mass falls off to.
    MPM_INLINE bool outwards(std::int32_t slot, int n, Vec<T, D>& normal) const {
        return descent_around(
            n, [&](int around, int there) { return fills_beside(slot, around, there); }, normal);
    }
    /// Normal from one field to the other, by the volume fractions of the nodes around.
    MPM_INLINE bool direction(std::int32_t slot_a, std::int32_t slot_b, T of_a, T of_b, int n,
                              Vec<T, D>& normal) const {
        return descent_around(
            n,
            [&](int around, int there) {
                return fills_beside(slot_a, around, there) * of_a -
                       fills_beside(slot_b, around, there) * of_b;
            },
            normal);
    }
    /// What fills a node of a block around a slot's.
    MPM_INLINE T fills_beside(std::int32_t slot, int around, int there) const {
        const std::int32_t to =
            node.grid.table.neighbours[std::int64_t(slot) * Block<D>::neighbours + around];
        return to < 0 ? T(0) : fills(to, there);
    }
    /// `descent` of value(number of the block around, node there) over the nodes around one.
    template <class Value>
    MPM_INLINE static bool descent_around(int n, const Value& value, Vec<T, D>& normal) {
        int at[D];
        Block<D>::coordinates(n, at);
        return descent<T, D>(
            [&](const int(&k)[D]) {
                int place[D], around, there;
                for (int a = 0; a < D; ++a) place[a] = at[a] + k[a] - 1 + Block<D>::margin;
                arena_node<D>(place, around, there);
                return value(around, there);
            },
            normal);
    }
};

}  // namespace mpm
