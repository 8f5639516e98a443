// The boundaries of a scene where kernels see them: records, surfaces of any shape, the time tables
// of their motion and of gravity, and which blocks they may hold nodes of. Knows no particle and no
// nodal value; only kernels write into its records (`BeginStep`).
#pragma once

#include <algorithm>
#include <cmath>
#include <functional>
#include <map>
#include <set>
#include <string>
#include <utility>
#include <vector>

#include "mpm/core/error.hpp"
#include "mpm/exec/buffer.hpp"
#include "mpm/kernels/sorting.hpp"
#include "mpm/kernels/wall_nodes.hpp"
#include "mpm/solver/blocks_together.hpp"
#include "mpm/solver/fluids.hpp"
#include "mpm/solver/plan.hpp"
#include "mpm/solver/spec.hpp"
#include "mpm/solver/surface_blocks.hpp"
#include "mpm/solver/time_tables.hpp"

namespace mpm {

/// What is known of the nodes of listed blocks.
template <class X, int D>
struct WallNodeBuffers {
    Buffer<X, WallAsks> asks;
    Buffer<X, std::uint32_t> lines;
    Buffer<X, SurfaceNode<D>> surfaces;  // where any is linear

    explicit WallNodeBuffers(X& exec) : asks(exec), lines(exec), surfaces(exec) {}
    void reserve_discard(std::size_t nodes, bool linear_surfaces) {
        asks.reserve_discard(nodes);
        lines.reserve_discard(nodes * D);
        if (linear_surfaces) surfaces.reserve_discard(nodes);
    }
    void swap(WallNodeBuffers& other) noexcept {
        asks.swap(other.asks);
        lines.swap(other.lines);
        surfaces.swap(other.surfaces);
    }
    FoundWallNodes<D> found() const { return {asks.data(), lines.data(), surfaces.data()}; }
    std::size_t bytes() const { return asks.bytes() + lines.bytes() + surfaces.bytes(); }
};

template <class X, int D>
class Boundaries {
public:
    Boundaries(X& exec, const Spec& spec, const Plan& plan);
    Boundaries(const Boundaries&) = delete;
    Boundaries& operator=(const Boundaries&) = delete;

    BoundaryView<D> view() const {
        return {records_.data(),
                int(records_.size()),
                surfaces_.data(),
                cell_size_,
                reach(),
                linear_walls_,
                linear_surfaces_,
                mirrored_walls_,
                down_,
                restricted_,
                solid_fields_.size() > 0 ? solid_fields_.data() : nullptr};
    }
    /// Gravity and boundaries of the moment of a clock.
    BeginStep<D> begin_step(Clock* clock) const {
        return {clock, gravity_, records_.data(), int(records_.size()), surfaces_.data()};
    }
    /// Of each averaged group of bodies, how it presses; where boxes have linear faces.
    const Buffer<X, GroupPressure>& pressures() const { return pressures_; }

    /// Of a new table: which blocks any boundary may hold nodes of.
    void touch(const BlockTableView<D>& table);
    /// (slots,) of the last table; where `lists`, 1 + the place of those that are in `blocks`.
    const Buffer<X, std::uint32_t>& touched() const { return touched_; }

    /// Whether nodes beside boundaries are moved apart from the others (`MoveWallNodes`).
    bool lists() const { return lists_; }
    bool has_mirrors() const { return mirrored_walls_; }
    bool has_linear_surfaces() const { return linear_surfaces_; }
    const Buffer<X, std::int32_t>& blocks() const { return blocks_; }
    const Buffer<X, WallAsks>& asks() const { return nodes_.asks; }
    const Buffer<X, std::uint32_t>& lines() const { return nodes_.lines; }  // packed
    /// How many of them the last list did not have, or had by boundaries that change.
    std::size_t blocks_classified() const { return classified_; }
    /// What stays of nodes that are not `WallNode::unknown`.
    KnownNodes<D> known() const {
        if (!lists()) return {};
        return {nodes_.lines.data(), linear_surfaces_ ? nodes_.surfaces.data() : nullptr,
                touched_.data(), nodes_.asks.data()};
    }
    /// By (listed block, node), the nodes that a pass moves; on hosts lines have no pass.
    const Buffer<X, std::int32_t>& nodes_of(WallPass pass) const { return of_pass_[int(pass)]; }
    /// Hosts: the nodes on lines alone, in the order of listed blocks.
    const Buffer<X, LinedNode<D>>& lined() const { return lined_; }
    double bytes() const {
        return double(touched_.bytes() + blocks_.bytes() + block_keys_.bytes() + nodes_.bytes() +
                      nodes_before_.bytes() + of_pass_[0].bytes() + of_pass_[1].bytes() +
                      of_pass_[2].bytes() + lined_.bytes());
    }
    /// The same of what load cell number `cell` measures, into `flag`.
    void touch_measured(int cell, const BlockTableView<D>& table, std::uint32_t* flag);
    /// For tables of one rank of several, whose keys are these.
    BlocksTogether blocks_together(const BlockKeys<D>& keys_of) const;

private:
    /// Nodes beyond a face of the domain that particles inside can reach.
    int reach() const { return wide_ ? 2 : 1; }
    SurfaceRecord<D> surface(const SurfaceSpec& spec);
    static void lead_rows_into_others(const std::vector<BoundarySpec>& specs,
                                      std::vector<BoundaryRecord<D>>& records);
    void add_lines(const SurfaceRecord<D>& at_rest, const BlockKeys<D>& keys_of,
                   std::map<std::uint64_t, unsigned>& lines) const;
    void set_pressures(const Spec& spec, const Plan& plan);
    void set_fields(const Spec& spec);
    void list_touched(const BlockTableView<D>& table);
    void list_blocks(const BlockTableView<D>& table, Buffer<X, std::int32_t>& kept,
                     Buffer<X, std::int32_t>& classified);
    void list_passes(const BlockTableView<D>& table);

    X& exec_;
    double cell_size_;
    bool wide_;  // particles reach two nodes beyond a face
    bool lists_ = false;
    bool linear_walls_ = false;  // kernels/wall_lines.hpp
    bool linear_surfaces_ = false;
    bool mirrored_walls_ = false;
    int down_ = -1;            // as `BoundaryView` has it
    bool restricted_ = false;  // as `BoundaryView` has it
    TimeTables<X> tables_{exec_};
    TimeTableView gravity_{};
    std::vector<Buffer<X, std::uint64_t>> surface_keys_;
    std::vector<Buffer<X, std::int32_t>> surface_places_, surface_all_;
    std::vector<Buffer<X, float>> surface_values_;
    Buffer<X, BoundaryRecord<D>> records_{exec_};
    Buffer<X, SurfaceRecord<D>> surfaces_{exec_};
    Buffer<X, BoundaryRecord<D>> measured_{exec_};  // of each load cell, its faces alone
    Buffer<X, GroupPressure> pressures_{exec_};
    Buffer<X, std::int32_t> solid_fields_{exec_};  // as `BoundaryView` has them
    Buffer<X, std::uint32_t> touched_{exec_};
    Buffer<X, std::int32_t> blocks_{exec_};
    Buffer<X, std::uint64_t> block_keys_{exec_};  // of listed blocks
    BlockKeys<D> keys_of_{};                      // how to read them
    std::size_t classified_ = 0;
    // By (listed block, node); room for those of the next list, once it keeps any.
    WallNodeBuffers<X, D> nodes_{exec_}, nodes_before_{exec_};
    Buffer<X, std::int32_t> of_pass_[wall_passes] = {Buffer<X, std::int32_t>(exec_),
                                                     Buffer<X, std::int32_t>(exec_),
                                                     Buffer<X, std::int32_t>(exec_)};
    Buffer<X, LinedNode<D>> lined_{exec_};
};

template <class X, int D>
Boundaries<X, D>::Boundaries(X& exec, const Spec& spec, const Plan& plan)
    : exec_(exec), cell_size_(spec.cell_size), wide_(kernel_width(spec.kernel.kernel) == 5) {
    gravity_ = tables_.upload(spec.gravity, D);
    down_ = axis_of_gravity(spec, D);
    std::vector<BoundaryRecord<D>> records, measured;
    std::vector<SurfaceRecord<D>> surfaces;
    for (std::size_t k = 0; k < spec.boundaries.size(); ++k) {
        const BoundarySpec& s = spec.boundaries[k];
        BoundaryRecord<D> r{};
        r.is_box = s.is_box;
        // Of splines that end with the domain only the outermost is not zero at the wall.
        const int beyond = !spec.kernel.clamped ? 0 : (spec.kernel.kernel == Kernel::cubic ? 2 : 1);
        for (int a = 0; a < D; ++a) {
            const bool own = s.is_box || !s.surface.keys.empty();
            r.lower[a] = own ? s.lower[a] : -beyond;
            r.upper[a] = own ? s.upper[a] : int(spec.cells[a]) + beyond;
        }
        if (!s.surface.keys.empty()) {
            surfaces.push_back(surface(s.surface));
            r.surface = int(surfaces.size());
        }
        bool everyone = s.restricted < 0;
        for (std::size_t b = 0; b < spec.bodies.size() && s.restricted >= 0; ++b) {
            if (!(spec.bodies[b].held_by >> s.restricted & 1)) continue;
            const int weight = plan.bodies[b].group.weight;
            // Without a sum of its own the body's group is all there is.
            everyone = everyone || weight < 0;
            if (weight >= 0) r.share |= std::uint64_t(1) << weight;
        }
        if (everyone) r.share = 0;
        restricted_ = restricted_ || r.share != 0;
        r.limited = !s.within.empty();
        for (int a = 0; a < D && r.limited; ++a) {
            r.within_lower[a] = s.within[std::size_t(a)];
            r.within_upper[a] = s.within[std::size_t(D + a)];
        }
        for (int f = 0; f < 2 * D; ++f) {
            if (!s.present[f] || !mirrors(s.law[f].response)) continue;
            if (r.limited || s.restricted >= 0)
                throw SceneError("boundary '" + s.name +
                                 "' mirrors, which can be limited neither in space nor to bodies");
            if (wide_ && spec.cells[f / 2] < 2)
                throw SceneError("boundary '" + s.name +
                                 "' mirrors along an axis of one cell, too narrow for this kernel; "
                                 "make it two cells or take another kernel");
        }
        for (int f = 0; f < 2 * D; ++f) {
            r.present[f] = s.present[f];
            r.law[f] = s.law[f];
            r.law[f].linear = s.law[f].linear && s.present[f];
        }
        for (int a = 0; a < D; ++a) {
            const int cells = int(spec.cells[std::size_t(a)]);
            r.face_lower[a] = std::max(r.lower[a], 0);
            r.face_upper[a] = std::min(r.upper[a], cells);
            r.rows_lower[a] = r.lower[a] <= 0 ? -4 : r.lower[a];
            r.rows_upper[a] = r.upper[a] >= cells ? cells + 4 : r.upper[a];
        }
        r.start = s.start;
        r.end = s.end;
        if (s.moves) r.motion = tables_.upload(s.motion, D);
        records.push_back(r);
    }
    lead_rows_into_others(spec.boundaries, records);
    lists_ = lists_wall_nodes(spec.boundaries);
    set_pressures(spec, plan);
    set_fields(spec);
    if (linear_walls_ && mirrored_walls_)
        throw SceneError(
            "walls that mirror beside walls with linear cells are not built; choose "
            "cell=\"held\" for these or another response for those");
    if (lists_ && records.size() >= most_packed_boundaries)
        throw CapacityError(
            "the scene has " + std::to_string(records.size()) +
            " boundaries, some of them with linear cells; one scene holds at most " +
            std::to_string(most_packed_boundaries - 1) +
            " then. Join boxes that touch, or use cell=\"held\"");
    // Lines are found before the first step says what is active, and kept of what always is.
    for (BoundaryRecord<D>& r : records) r.active = r.always();
    records_.assign(records);
    surfaces_.assign(surfaces);
    for (const auto& s : spec.sensors) {
        if (s.kind != SensorKind::load_cell) continue;
        BoundaryRecord<D>& r = measured.emplace_back(records.at(std::size_t(s.boundary)));
        for (int f = 0; f < 2 * D; ++f) r.present[f] = r.present[f] && (s.faces >> f & 1);
    }
    measured_.assign(measured);
}

template <class X, int D>
SurfaceRecord<D> Boundaries<X, D>::surface(const SurfaceSpec& s) {
    SurfaceRecord<D> r{};
    const SurfaceBlocks<D> blocks(s);
    for (int a = 0; a < D; ++a) {
        r.field.low[a] = blocks.low[a];
        r.field.counts[a] = blocks.counts[a];
        r.field.origin[a] = s.origin[std::size_t(a)];
        r.about[a] = s.about.empty() ? 0 : s.about[std::size_t(a)];
    }
    std::vector<std::uint64_t> keys;
    std::vector<std::int32_t> places;
    blocks.list(s, keys, places);
    surface_keys_.emplace_back(exec_).assign(keys);
    surface_places_.emplace_back(exec_).assign(places);
    auto& all = surface_all_.emplace_back(exec_);
    all.assign(blocks.all(keys, places));
    surface_values_.emplace_back(exec_).assign(s.values);
    r.field.keys = surface_keys_.back().data();
    r.field.place = surface_places_.back().data();
    r.field.value = surface_values_.back().data();
    r.field.all = all.size() > 0 ? all.data() : nullptr;
    r.field.count = std::int32_t(keys.size());
    r.field.per_metre = 1 / s.spacing;
    r.decay = s.decay;
    r.thickness = s.thickness;
    r.path = tables_.upload(s.path, D);
    r.turn = tables_.upload(s.turn, 1);
    for (int a = 0; a < 3; ++a) r.axis[a] = s.axis.empty() ? (a == 2) : s.axis[std::size_t(a)];
    for (int a = 0; a < D; ++a) r.rotation[a][a] = 1;
    return r;
}

/// Adds the blocks with nodes that lines towards a surface may have, each with its axes. The record
/// is one on the host.
template <class X, int D>
void Boundaries<X, D>::add_lines(const SurfaceRecord<D>& s, const BlockKeys<D>& keys_of,
                                 std::map<std::uint64_t, unsigned>& lines) const {
    BoundaryView<D> view{};
    view.cell_size = cell_size_;
    const auto& field = s.field;
    const double block = Block<D>::edge * cell_size_, size = field.edge / field.per_metre;
    std::set<std::uint64_t> seen;
    for (std::int32_t k = 0; k < field.count; ++k) {
        if (field.place[k] < 0) continue;
        std::int64_t first[D], last[D], b[D];
        std::uint64_t key = field.keys[k];
        for (int a = D - 1; a >= 0; --a) {
            const double number =
                double(field.low[a]) + double(key % std::uint64_t(field.counts[a]));
            key /= std::uint64_t(field.counts[a]);
            const double low = field.origin[a] + number * size;
            constexpr std::int64_t rim = BlockKeys<D>::rim;
            first[a] = std::max(std::int64_t(std::floor(low / block)), -rim);
            last[a] = std::min(std::int64_t(std::floor((low + size) / block)),
                               keys_of.counts[a] - rim - 1);
            b[a] = first[a];
        }
        for (bool more = std::equal(first, first + D, last, std::less_equal<>()); more;) {
            if (seen.insert(keys_of.key(b)).second) {
                unsigned axes = 0;
                for (int n = 0; n < block_cells; ++n) {
                    std::int64_t cell[D];
                    int in[D];
                    Block<D>::coordinates(n, in);
                    for (int a = 0; a < D; ++a) cell[a] = b[a] * Block<D>::edge + in[a];
                    const SurfaceView<D> node(view, s, cell);
                    // A leader stands less than two cells off the surface.
                    if (node.known && node.axis >= 0 && node.distance < 2.01 && !node.deep())
                        axes |= 1u << node.axis;
                }
                if (axes != 0) lines[keys_of.key(b)] |= axes;
            }
            more = false;
            for (int a = D - 1; a >= 0 && !more; --a) {
                more = ++b[a] <= last[a];
                if (!more) b[a] = first[a];
            }
        }
    }
}

/// Which boundaries there are at all, and what edges of linear faces and surfaces ask for: how much
/// each averaged group of bodies presses.
template <class X, int D>
void Boundaries<X, D>::set_pressures(const Spec& spec, const Plan& plan) {
    bool boxes = false;
    for (const BoundarySpec& s : spec.boundaries) {
        mirrored_walls_ = mirrored_walls_ || mpm::mirrors(s);
        linear_surfaces_ = linear_surfaces_ || linear_surface(s);
        for (const SurfaceLaw& law : s.law) {
            linear_walls_ = linear_walls_ || law.linear;
            boxes = boxes || (law.linear && s.is_box);
        }
    }
    if (boxes || linear_surfaces_) pressures_.assign(group_pressures<D>(spec, plan));
}

template <class X, int D>
void Boundaries<X, D>::set_fields(const Spec& spec) {
    if (!spec.contact.any()) return;
    auto fields = fields_of_solids(spec);
    // Nodes that a gap keeps from what lets go are asked in the pass over nodes beside boundaries,
    // as load cells and contact ask them.
    bool lets_go = false, at_the_end = false;
    for (const BoundarySpec& s : spec.boundaries)
        for (const SurfaceLaw& law : s.law) {
            const bool separable = law.response == Response::separable;
            lets_go = lets_go || separable;
            at_the_end = at_the_end || (separable && !s.is_box && s.surface.keys.empty());
        }
    // Round bodies come a little nearer than they may: through a wall of the domain they would
    // leave it.
    const bool asked = lets_go && !at_the_end && !mirrored_walls_ &&
                       std::count(fields.begin(), fields.end(), +closes_gaps) > 0;
    lists_ = lists_ || asked;
    if (!asked) std::replace(fields.begin(), fields.end(), +closes_gaps, +held_by_nodes);
    solid_fields_.assign(fields);
}

template <class X, int D>
void Boundaries<X, D>::touch(const BlockTableView<D>& table) {
    touched_.reserve_discard(std::size_t(table.slots));
    exec_.for_each(table.slots, TouchBoundaries<D>{table, records_.data(), int(records_.size()),
                                                   surfaces_.data(), cell_size_, touched_.data()});
    if (lists()) list_touched(table);
}

template <class X, int D>
void Boundaries<X, D>::list_touched(const BlockTableView<D>& table) {
    Buffer<X, std::int32_t> kept(exec_), classified(exec_);
    list_blocks(table, kept, classified);
    const std::size_t blocks = blocks_.size(), nodes = blocks * block_cells;
    classified_ = classified.size();
    if (classified_ < blocks) nodes_.swap(nodes_before_);
    nodes_.reserve_discard(nodes, linear_surfaces_);
    if (classified_ < blocks)
        exec_.for_each(
            std::int64_t(nodes),
            KeepWallNodes<D>{blocks_.data(), kept.data(), nodes_before_.found(), nodes_.found()});
    exec_.for_each(std::int64_t(classified_ * block_cells),
                   ClassifyWallNodes<D>{table, view(), blocks_.data(), classified.data(),
                                        pressures_.size() > 0, nodes_.found()});
    list_passes(table);
    exec_.wait();
}

/// Lists the touched blocks. `kept`: of each slot, its place in the list before; `classified`:
/// places in the list of those that are not kept.
template <class X, int D>
void Boundaries<X, D>::list_blocks(const BlockTableView<D>& table, Buffer<X, std::int32_t>& kept,
                                   Buffer<X, std::int32_t>& classified) {
    const std::int64_t slots = table.slots;
    Buffer<X, std::uint32_t> position(exec_), flag(exec_), classified_position(exec_),
        numbers(exec_);
    flag.reserve_discard(std::size_t(slots));
    kept.reserve_discard(std::size_t(slots));
    for (auto* scan : {&position, &classified_position})
        scan->reserve_discard(std::size_t(slots) + 1);
    numbers.reserve_discard(2);
    const bool known = keys_of_.same_as(table.keys_of);
    exec_.for_each(slots, FindKeptBlocks<D>{table, view(), touched_.data(), block_keys_.data(),
                                            known ? std::int32_t(block_keys_.size()) : 0,
                                            kept.data(), flag.data()});
    exec_.exclusive_scan(touched_.data(), position.data(), slots);
    exec_.exclusive_scan(flag.data(), classified_position.data(), slots);
    exec_.copy(numbers.data(), position.data() + slots, sizeof(std::uint32_t));
    exec_.copy(numbers.data() + 1, classified_position.data() + slots, sizeof(std::uint32_t));
    const std::vector<std::uint32_t> counts = numbers.host();
    blocks_.reserve_discard(counts[0]);
    block_keys_.reserve_discard(counts[0]);
    classified.reserve_discard(counts[1]);
    exec_.for_each(slots, ListWallBlocks{table.keys, position.data(), flag.data(),
                                         classified_position.data(), touched_.data(),
                                         blocks_.data(), block_keys_.data(), classified.data()});
    keys_of_ = table.keys_of;
}

/// Which nodes of listed blocks each pass moves.
template <class X, int D>
void Boundaries<X, D>::list_passes(const BlockTableView<D>& table) {
    const std::size_t nodes = blocks_.size() * block_cells;
    std::vector<Buffer<X, std::uint32_t>> flags, positions;
    Buffer<X, std::uint32_t> numbers(exec_);
    numbers.reserve_discard(wall_passes);
    for (int k = 0; k < wall_passes; ++k) {
        flags.emplace_back(exec_).reserve_discard(nodes);
        positions.emplace_back(exec_).reserve_discard(nodes + 1);
    }
    exec_.for_each(
        std::int64_t(nodes),
        FlagWallPasses{nodes_.asks.data(), {flags[0].data(), flags[1].data(), flags[2].data()}});
    for (int k = 0; k < wall_passes; ++k) {
        exec_.exclusive_scan(flags[k].data(), positions[k].data(), std::int64_t(nodes));
        exec_.copy(numbers.data() + k, positions[k].data() + nodes, sizeof(std::uint32_t));
    }
    const std::vector<std::uint32_t> counts = numbers.host();
    for (std::size_t k = 0; k < wall_passes; ++k) {
        if constexpr (!X::is_device) {
            if (WallPass(k) == WallPass::lines) {
                lined_.reserve_discard(counts[k]);
                exec_.for_each(
                    std::int64_t(nodes),
                    ListLinedNodes<D>{table, blocks_.data(), nodes_.lines.data(), flags[k].data(),
                                      positions[k].data(), lined_.data()});
                continue;
            }
        }
        of_pass_[k].reserve_discard(counts[k]);
        exec_.for_each(std::int64_t(nodes),
                       ListHomes{flags[k].data(), positions[k].data(), of_pass_[k].data()});
    }
}

template <class X, int D>
void Boundaries<X, D>::touch_measured(int cell, const BlockTableView<D>& table,
                                      std::uint32_t* flag) {
    exec_.for_each(table.slots, TouchBoundaries<D>{table, measured_.data() + cell, 1,
                                                   surfaces_.data(), cell_size_, flag});
}

/// Rows of a box's faces that end where it stands on another box, which goes on beyond them, lead
/// on into that one, as they do where the box ends with the domain: particles in the corner between
/// the two reach nodes there.
template <class X, int D>
void Boundaries<X, D>::lead_rows_into_others(const std::vector<BoundarySpec>& specs,
                                             std::vector<BoundaryRecord<D>>& records) {
    const auto rests = [&](std::size_t b) {
        const BoundaryRecord<D>& r = records[b];
        return r.is_box && r.surface == 0 && !r.limited && r.share == 0 && !specs[b].moves &&
               r.always();
    };
    for (std::size_t b = 0; b < records.size(); ++b) {
        BoundaryRecord<D>& own = records[b];
        for (std::size_t o = 0; o < records.size() && rests(b); ++o) {
            if (o == b || !rests(o)) continue;
            const BoundaryRecord<D>& other = records[o];
            for (int t = 0; t < D; ++t) {
                bool wider = true;
                for (int a = 0; a < D; ++a)
                    wider = wider && (a == t || (other.rows_lower[a] < own.lower[a] &&
                                                 other.rows_upper[a] > own.upper[a]));
                const auto holds = [&](int cell) {
                    return wider && cell >= other.lower[t] && cell < other.upper[t];
                };
                if (holds(own.lower[t] - 1))
                    own.rows_lower[t] = std::max(own.lower[t] - 4, other.lower[t]);
                if (holds(own.upper[t]))
                    own.rows_upper[t] = std::min(own.upper[t] + 4, other.upper[t]);
            }
        }
    }
}

template <class X, int D>
BlocksTogether Boundaries<X, D>::blocks_together(const BlockKeys<D>& keys_of) const {
    BlocksTogether together;
    std::vector<MirrorPlane>& planes = together.planes;
    const auto block = [](std::int64_t cell) {
        constexpr std::int64_t edge = Block<D>::edge, rim = BlockKeys<D>::rim;
        return (cell + rim * edge) / edge - rim;
    };
    for (const BoundaryRecord<D>& r : records_.host()) {
        for (int f = 0; f < 2 * D && !r.is_box && r.surface == 0; ++f) {
            if (!r.present[f] || !mirrors(r.law[f].response)) continue;
            const std::int64_t plane = f % 2 == 0 ? r.lower[f / 2] : r.upper[f / 2];
            for (int k = 0; k < reach(); ++k) {
                const MirrorPlane sides{f / 2, block(plane - 1 - k), block(plane + k)};
                if (sides.low != sides.high) planes.push_back(sides);
            }
        }
        // The nodes of a line read one another's sums too.
        for (int f = 0; f < 2 * D && r.surface == 0; ++f) {
            if (!r.present[f] || !r.law[f].linear) continue;
            const WallPlane<D> wall(r, f);
            const MirrorPlane sides{f / 2, block(wall.plane - (wall.sign > 0 ? 1 : 2)),
                                    block(wall.plane + (wall.sign > 0 ? 1 : 0))};
            if (sides.low != sides.high) planes.push_back(sides);
        }
    }
    const auto surfaces = surfaces_.host();
    for (const BoundaryRecord<D>& r : records_.host()) {
        if (r.surface == 0 || !r.law[0].linear) continue;
        const std::size_t number = std::size_t(r.surface - 1);
        SurfaceRecord<D> s = surfaces[number];
        if (!s.at_rest()) continue;
        const auto keys = surface_keys_[number].host();
        const auto places = surface_places_[number].host();
        const auto values = surface_values_[number].host();
        s.field.keys = keys.data();
        s.field.place = places.data();
        s.field.value = values.data();
        s.field.all = nullptr;
        add_lines(s, keys_of, together.lines);
    }
    return together;
}

}  // namespace mpm
