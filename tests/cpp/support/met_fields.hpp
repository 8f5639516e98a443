// Blocks in which bodies with velocities of their own meet, of nodal sums written by hand, as far
// as the grid update takes them on hosts and on devices.
#pragma once

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <limits>
#include <type_traits>
#include <vector>

#include "mpm/kernels/contact.hpp"
#include "mpm/kernels/wall_nodes.hpp"
#include "support/random.hpp"

namespace mpm::test {

/// What stands at the nodes.
enum class Walls { none, holds, slips, lets_go, corner, of_some, inside, linear };

/// A row of blocks along the first axis, each with some of the bodies, each body of a kind of its
/// own; the first one is water. What they may meet: a bed below all and a box in the last block.
template <class T, class Sum, int D>
struct MetFields {
    static constexpr int edge = Block<D>::edge, around = Block<D>::neighbours, up = D - 1;
    // Sums: of one group of averaged volumes, of the momentum without stress, of each body's mass.
    static constexpr int group_sum_at = 1 + D, group_mass_at = 2 + D, plain_at = 3 + D,
                         own_at = 3 + 2 * D;
    // Velocities: the group's average, those of the momentum without stress, the guard.
    static constexpr int average_at = D, before_at = D + 1, guard_at = 2 * D + 1,
                         velocity_channels = 2 * D + 2;
    static constexpr double cell_size = 0.1, least_mass = 1e-3;
    static constexpr bool whole = std::is_integral_v<Sum>;

    int bodies, slots = 0, sum_channels;
    BlockKeys<D> keys_of{};
    std::vector<std::uint64_t> keys;
    std::vector<std::int32_t> corners, neighbours, kinds, law_of, of_solids, first, count;
    std::vector<std::uint32_t> touched, lines;
    std::vector<std::int32_t> listed;
    std::vector<WallAsks> asks;
    std::vector<ContactLaw> laws = std::vector<ContactLaw>(2);  // with water, of solids
    std::vector<double> full;
    std::vector<Sum> sums;
    std::vector<T> velocity;
    std::vector<BoundaryRecord<D>> records;
    Clock clock{};
    GroupPressure pressure{group_sum_at, group_mass_at, 100, 7, 1};
    GroupChannels group{average_at, group_sum_at, group_mass_at};
    KeptChannels kept{plain_at, before_at, guard_at};
    double maxima[maxima_count] = {};  // of the grid update

    /// `blocks`: the bodies of each, ascending.
    MetFields(int number_of_bodies, const std::vector<std::vector<int>>& blocks)
        : bodies(number_of_bodies), sum_channels(own_at + bodies) {
        std::fill(keys_of.counts, keys_of.counts + D, 8);
        keys_of.fields = bodies;
        for (int b = 0; b < int(blocks.size()); ++b) {
            const std::vector<int>& here = blocks[std::size_t(b)];
            if (here.size() > 1) {
                first.push_back(slots);
                count.push_back(int(here.size()));
            }
            std::int64_t at[D] = {};
            at[0] = b;
            for (const int body : here) {
                keys.push_back(keys_of.key(at, body));
                for (int a = 0; a < D; ++a) corners.push_back(a == 0 ? b * edge : 0);
                ++slots;
            }
        }
        for (int slot = 0; slot < slots; ++slot)
            for (int k = 0; k < around; ++k) {
                std::int64_t here[D], there[D];
                keys_of.block(keys[std::size_t(slot)], here);
                keys_of.beside(here, k, there);
                neighbours.push_back(find_block<D>(table(), there, body(slot)));
            }
        touched.assign(std::size_t(slots), 0);
        for (int k = 0; k < bodies; ++k) {
            kinds.push_back(k);
            of_solids.push_back(k > 0);
            full.push_back(1 + 0.1 * k);
            for (int j = 0; j < bodies; ++j) law_of.push_back(k > 0 && j > 0);
        }
        sums.assign(std::size_t(slots * sum_channels * block_cells), 0);
        velocity.assign(std::size_t(slots * block_cells * velocity_channels), 0);
        clock.dt = 0.05;
        for (int a = 0; a < D; ++a) clock.gravity[a] = a == up ? -2 : 0.3;
        // As small as leaves room for the largest sums.
        for (double& unit : clock.unit_read) unit = std::ldexp(1.0, sizeof(Sum) == 4 ? -26 : -50);
    }
    Sum& sum(int slot, int channel, int n) {
        return sums[std::size_t((slot * sum_channels + channel) * block_cells + n)];
    }
    void set(int slot, int channel, int n, double to) {
        if constexpr (whole)
            sum(slot, channel, n) = Sum(std::llround(to / clock.unit_read[0]));
        else
            sum(slot, channel, n) = Sum(to);
    }
    double value(int slot, int channel, int n) {
        return from_sum<double>(sum(slot, channel, n), clock.unit_read[0]);
    }
    void stick(int body, int to) {
        law_of[std::size_t(body * bodies + to)] = law_of[std::size_t(to * bodies + body)] = -1;
    }
    int body(int slot) const { return int(keys_of.field(keys[std::size_t(slot)])); }
    /// Where the velocities of a node begin.
    std::size_t place(int slot, int n) const {
        return std::size_t((slot * block_cells + n) * velocity_channels);
    }
    T* at(int slot, int n) { return velocity.data() + place(slot, n); }

    /// A body at a node: its mass, its velocity, by how much its volume there is lost.
    void put(int slot, int n, double mass, const Vec<double, D>& v, double loss = 0) {
        set(slot, 0, n, mass);
        for (int a = 0; a < D; ++a) {
            set(slot, 1 + a, n, mass * v[a]);
            set(slot, plain_at + a, n, 0.9 * mass * v[a]);
        }
        set(slot, group_mass_at, n, loss > 0 ? mass / 2 : 0);
        set(slot, group_sum_at, n, loss * mass / 2);
        set(slot, own_at + body(slot), n, mass);
    }
    /// So little of it that it does not move, and is none of those that meet.
    void put_crumb(int slot, int n) {
        put(slot, n, 0, {});
        sum(slot, 0, n) = Sum(whole ? least_quanta / 2 : negligible_mass<T> * least_mass / 2);
    }
    /// Any bodies anywhere: many of a node move alike, or nearly so.
    void put_any(Random& random) {
        for (std::size_t k = 0; k < first.size(); ++k)
            for (int n = 0; n < block_cells; ++n) {
                Vec<double, D> like;
                for (int a = 0; a < D; ++a) like[a] = random.between(-1, 1);
                const double differs = random.integer(0, 2) > 0 ? 1 : random.integer(0, 1) * 1e-6;
                for (int slot = first[k]; slot < first[k] + count[k]; ++slot) {
                    const int is = random.integer(0, 9);
                    if (is == 0) continue;
                    if (is == 1) {
                        put_crumb(slot, n);
                        continue;
                    }
                    Vec<double, D> v = like;
                    for (int a = 0; a < D; ++a) v[a] += differs * random.between(-1, 1);
                    const double fills =
                        is < 8 ? random.between(0.2, 1.1) : std::pow(10, -4 * random.between(0, 1));
                    put(slot, n, fills * full[std::size_t(body(slot))], v,
                        random.integer(0, 2) * 1e-2);
                }
            }
        for (int slot = 0; slot < slots; ++slot)  // those that nobody meets
            for (int n = 0; n < block_cells; ++n)
                if (count_of(slot) == 1) put(slot, n, random.between(0.2, 1), {{1, -1}});
    }
    int count_of(int slot) const {
        std::int32_t from = 0, fields = 0;
        find_siblings<D>(table(), slot, bodies, from, fields);
        return fields;
    }

    /// For those of some bits, 0 for all.
    BoundaryRecord<D>& bed(Response response, double friction = 0, unsigned some = 0) {
        BoundaryRecord<D> r{};
        r.active = r.present[2 * up] = 1;
        std::fill(r.upper, r.upper + D, 8 * edge);
        r.law[2 * up].response = response;
        r.law[2 * up].static_friction = r.law[2 * up].dynamic_friction = friction;
        r.share = std::uint64_t(some) << own_at;
        return added(r);
    }
    /// Of two cells along each axis, on the bed where the last block begins.
    BoundaryRecord<D>& box(Response response) {
        BoundaryRecord<D> r{};
        r.active = r.is_box = 1;
        for (int a = 0; a < D; ++a) {
            r.lower[a] = r.face_lower[a] = a == 0 ? corners[std::size_t((slots - 1) * D)] : 0;
            r.upper[a] = r.face_upper[a] = r.rows_upper[a] = r.lower[a] + 2;
            r.rows_lower[a] = r.lower[a] > 0 ? r.lower[a] : -4;
        }
        for (int f = 0; f < 2 * D; ++f) {
            r.present[f] = 1;
            r.law[f].response = response;
            r.law[f].axes = 1;
        }
        return added(r);
    }
    BoundaryRecord<D>& added(BoundaryRecord<D> r) {
        r.end = std::numeric_limits<double>::infinity();
        records.push_back(r);
        return records.back();
    }
    void build(Walls walls, Random& random) {
        const auto any = [&] { return Response(random.integer(0, 2)); };
        const double friction = random.integer(0, 1) * random.between(0, 1);
        if (walls == Walls::holds)  // one of them: nothing approaches where all are held
            bed(Response::sticky, 0, 1u << random.integer(0, bodies - 1));
        if (walls == Walls::slips) bed(Response::slip, friction);
        if (walls == Walls::lets_go) bed(Response::separable, friction);
        if (walls == Walls::corner) {
            bed(any(), friction);
            box(any());
        }
        if (walls == Walls::of_some) {
            bed(any(), friction, unsigned(random.integer(1, (1 << bodies) - 1)));
            if (random.integer(0, 1)) bed(any());
            if (random.integer(0, 1)) box(any());
        }
        if (walls == Walls::inside) {
            bed(any());
            box(Response::prescribed);
        }
        if (walls == Walls::linear) {
            bed(Response(random.integer(1, 2)), friction);
            if (random.integer(0, 1)) box(Response(random.integer(1, 2)));
            const bool by_default = random.integer(0, 1);
            for (auto& r : records)
                for (SurfaceLaw& law : r.law) {
                    law.linear = true;
                    law.cautious = by_default;
                }
            if (random.integer(0, 1)) bed(any(), friction, unsigned(random.integer(1, 3)));
        }
        for (auto& r : records)
            for (int a = 0; a < D && random.integer(0, 2) == 0; ++a)
                r.velocity[a] = random.between(-0.5, 0.5);
        list();
    }

    BlockTableView<D> table() const {
        return {keys_of, slots, keys.data(), corners.data(), neighbours.data()};
    }
    BoundaryView<D> boundaries() const {
        BoundaryView<D> all{records.data(), int(records.size()), nullptr, cell_size, 1};
        for (const auto& r : records) {
            all.restricted |= r.share != 0;
            for (const SurfaceLaw& law : r.law) all.lines |= law.linear;
        }
        all.down = up;
        if (all.lines) all.solid_fields = of_solids.data();
        return all;
    }
    NodeUpdate<T, Sum, D> nodes() {
        return {{table(), velocity.data(), velocity_channels, sums.data(), sum_channels},
                &clock,
                boundaries(),
                touched.data(),
                least_mass,
                10 * least_mass,  // so that some nodes count by a part of them
                &pressure,
                boundaries().lines};
    }
    ContactView contact() const {
        return {laws.data(), law_of.data(), kinds.data(), full.data(),
                bodies,      first.data(),  count.data(), std::int32_t(first.size()),
                -1,          bodies};
    }
    /// Are nodes beside boundaries moved apart from the others?
    bool lists() const {
        bool some = boundaries().lines || boundaries().restricted;
        for (const auto& r : records) some |= r.law[0].response == Response::prescribed;
        return some;
    }
    KnownNodes<D> known() const {
        return lists() ? KnownNodes<D>{lines.data(), nullptr, touched.data(), asks.data()}
                       : KnownNodes<D>{};
    }

    /// What the nodes of all blocks ask for, as `ClassifyWallNodes` has it where nothing moves and
    /// no surface is linear.
    void list() {
        listed.clear();
        std::fill(touched.begin(), touched.end(), 0);
        for (int slot = 0; slot < slots && !records.empty(); ++slot) {
            listed.push_back(slot);
            touched[std::size_t(slot)] = std::uint32_t(listed.size());
        }
        asks.assign(listed.size() * block_cells, WallNode::free);
        lines.assign(asks.size() * D, 0);
        const BoundaryView<D> all = boundaries();
        for (std::size_t i = 0; i < asks.size(); ++i) {
            std::int64_t cell[D];
            const std::int32_t slot = listed[i / block_cells];
            nodes().cell(slot, int(i % block_cells), cell);
            for (int a = 0; a < D && all.lines; ++a) {
                const WallLine line = find_line<D>(all, a, cell, all.holds(table(), slot));
                lines[i * D + std::size_t(a)] = line.packed();
                if (line.form != WallLine::none) asks[i] |= WallNode::on_lines;
                for (int by = -2; by < 3; ++by) {
                    std::int64_t there[D];
                    moved_along<D>(cell, a, by, there);
                    each_edge<D>(all, there, [&](auto...) { asks[i] |= WallNode::edges; });
                }
            }
            Vec<double, D> v{};
            apply_boundaries<true>(all, cell, v, [&](auto&&...) { asks[i] |= WallNode::held; });
        }
    }

    /// From the sums to the velocities before contact.
    void update(bool device) {
        std::vector<Sum> next(sums.size());
        std::vector<T> moved(asks.size() * D), seats(asks.size() * (D + 1));
        std::vector<std::uint8_t> changed(asks.size());
        std::vector<LinedNode<D>> pieces;
        WallNodes<T, D> to;
        if (lists()) to = {moved.data(), changed.data(), asks.data(), seats.data()};
        if (lists() && device) move<WallPass::lines>(to);
        if (lists() && !device)
            for (std::size_t i = 0; i < asks.size(); ++i)
                if (asks[i] == WallNode::on_lines)
                    pieces.emplace_back(table(), listed[i / block_cells], int(i % block_cells),
                                        lines.data() + i * D);
        if (lists()) {
            move<WallPass::held>(to);
            const auto all = places(WallPass::all);
            const SeatWallNodes<T, Sum, D> seat{nodes(), listed.data(), all.data(), known(),
                                                to.seat};
            for (std::size_t k = 0; k < all.size(); ++k) seat(std::int64_t(k));
            move<WallPass::all>(to);
            to.lined = pieces.data();
            to.lined_count = std::int64_t(pieces.size());
        }
        std::fill(maxima, maxima + maxima_count, 0);
        const std::int64_t all = std::int64_t(slots) * block_cells;
        const auto run = [&](const auto& update) {
            for (std::int64_t i = 0; i < all + to.lined_count; ++i) update(i, maxima);
        };
        if (lists() && !device)
            run(UpdateGrid<T, Sum, D, true, false, true>{nodes(), next.data(), &group, 1, group,
                                                         kept, to});
        else
            run(UpdateGrid<T, Sum, D, true>{nodes(), next.data(), &group, 1, group, kept, to});
    }

private:
    std::vector<std::int32_t> places(WallPass pass) const {
        std::vector<std::int32_t> out;
        for (std::size_t i = 0; i < asks.size(); ++i) {
            const WallPass of = WallNode::needs_all(asks[i]) ? WallPass::all
                                : asks[i] == WallNode::held  ? WallPass::held
                                                             : WallPass::lines;
            if (asks[i] != WallNode::free && of == pass) out.push_back(std::int32_t(i));
        }
        return out;
    }
    template <WallPass pass>
    void move(const WallNodes<T, D>& to) {
        const auto all = places(pass);
        const MoveWallNodes<T, Sum, D, pass> move{nodes(), listed.data(), all.data(), known(), to};
        for (std::size_t k = 0; k < all.size(); ++k) move(std::int64_t(k));
    }
};

}  // namespace mpm::test
