// Boundaries with water in the gap below what stands on them: which nodes lie above such a gap, and
// what it adds to their sums and leaves of what rubs there (kernels/uplift.hpp).
#pragma once

#include <algorithm>
#include <cstdint>
#include <string>
#include <vector>

#include "mpm/core/error.hpp"
#include "mpm/exec/buffer.hpp"
#include "mpm/kernels/sorting.hpp"
#include "mpm/kernels/uplift_passes.hpp"
#include "mpm/solver/boundaries.hpp"
#include "mpm/solver/fluids.hpp"

namespace mpm {

template <class X, class T, class Sum, int D>
class Uplift {
public:
    using Node = NodeUpdate<T, Sum, D>;
    using Walls = Boundaries<ExecutorBase<X>, D>;

    Uplift(X& exec, const Spec& spec, const Plan& plan);
    Uplift(const Uplift&) = delete;
    Uplift& operator=(const Uplift&) = delete;

    /// A scene without them has none of the rest.
    bool any() const { return records_.size() > 0; }
    /// Of a new table.
    void list(const BlockTableView<D>& table, const Walls& walls);
    /// What the gaps add in this step.
    void find(const Node& node, const Walls& walls);
    /// From here to `lower` the sums have it.
    void raise(const Node& node, const Walls& walls);
    void lower(const Node& node, const Walls& walls);
    /// What of a node rubs on them in this step.
    RubbingParts<T> rubbing() const {
        if (rubbing_.size() == 0) return {};
        return {rubbing_.data(), record_of_.data(), nodes_};
    }
    /// What a load cell of one of them asks.
    MeasureUplift<T, Sum, D> measured(const Node& node, const Walls& walls,
                                      const std::int32_t* slots, const LoadCellRecord<D>* cells,
                                      const ImpulseScales& scales) const;
    double bytes() const {
        return double(mask_.bytes() + feet_.bytes() + before_.bytes() + with_.bytes() +
                      rubbing_.bytes() + record_of_.bytes());
    }

private:
    NodeUplift<T, Sum, D> of(const Node& node, const Walls& walls) const {
        NodeUplift<T, Sum, D> found{node, walls.known(), {}, axis_, up_};
        found.uplift.records = records_.data();
        found.uplift.count = int(records_.size());
        found.uplift.pressures = pressures_.data();
        found.uplift.pressure_count = int(pressures_.size());
        found.uplift.solid_fields = solid_fields_.size() > 0 ? solid_fields_.data() : nullptr;
        found.uplift.meets = meets_;
        for (int a = 0; a < D; ++a) found.uplift.cells[a] = cells_[a];
        return found;
    }
    void set(const Node& node, const Walls& walls, const Buffer<X, Sum>& from);

    X& exec_;
    int axis_ = 0, up_ = 1;  // against gravity
    std::int64_t cells_[D] = {};
    Buffer<X, UpliftRecord> records_{exec_};
    Buffer<X, GroupPressure> pressures_{exec_};
    Buffer<X, std::int32_t> solid_fields_{exec_};
    double meets_ = 1;                      // as `UpliftView` has it
    Buffer<X, std::uint32_t> mask_{exec_};  // (listed blocks, nodes)
    Buffer<X, std::int32_t> feet_{exec_};   // by (listed block, node)
    Buffer<X, Sum> before_{exec_}, with_{exec_};
    Buffer<X, std::uint32_t> lifted_{exec_};
    Buffer<X, std::int32_t> record_of_{exec_};  // by boundary, -1 without a gap
    Buffer<X, T> rubbing_{exec_};               // (records, listed blocks, nodes)
    std::int64_t nodes_ = 0;                    // of the listed blocks
};

template <class X, class T, class Sum, int D>
Uplift<X, T, Sum, D>::Uplift(X& exec, const Spec& spec, const Plan& plan) : exec_(exec) {
    std::vector<UpliftRecord> records;
    for (std::size_t k = 0; k < spec.boundaries.size(); ++k) {
        const BoundarySpec& b = spec.boundaries[k];
        if (!b.uplift) continue;
        if (b.moves || b.surface.path.given() || b.surface.turn.given())
            throw SceneError("boundary '" + b.name +
                             "' has uplift and moves, but which nodes lie above its gap is found "
                             "once; use uplift=False for it");
        if (linear_surface(b))
            throw SceneError("boundary '" + b.name +
                             "' has uplift and linear cells beside its surface, whose nodes move "
                             "as lines; use cell=\"held\" for it");
        double density = 0;
        for (const BodySpec& body : spec.bodies)
            if (b.restricted >= 0 && body.held_by >> b.restricted & 1)
                density =
                    std::max(density, material(body.material).density(body.parameters.data()));
        records.push_back({int(k), density * std::pow(spec.cell_size, D)});
    }
    if (records.empty()) return;
    const auto refuse = [&](const std::string& why) {
        throw SceneError("boundary '" + spec.boundaries[std::size_t(records[0].boundary)].name +
                         "' has uplift, " + why);
    };
    if (records.size() > most_uplifts)
        refuse("as " + std::to_string(records.size()) + " have; at most " +
               std::to_string(most_uplifts) + " may. Join those of bodies with one friction");
    if (!lists_wall_nodes(spec.boundaries))
        refuse("which is not built beside walls that mirror; use Slip for these");
    pressures_.assign(group_pressures<D>(spec, plan));
    if (pressures_.size() == 0)
        refuse(
            "and no fluid has its volumes averaged, whose pressure it would be; give one FBar()");
    axis_ = axis_of_gravity(spec, D);
    if (axis_ < 0) refuse("and there is no gravity, along which it would press");
    double pull = 0;
    for (std::size_t k = std::size_t(axis_); k < spec.gravity.value.size(); k += D)
        pull += spec.gravity.value[k];
    up_ = pull < 0 ? 1 : -1;
    for (int a = 0; a < D; ++a) cells_[a] = spec.cells[std::size_t(a)];
    if (spec.contact.any()) {
        solid_fields_.assign(fields_of_solids(spec));
        for (const ContactLaw& law : spec.contact.laws)
            if (law.kind == ContactKind::fluid) meets_ = std::min(meets_, law.fill);
    } else {
        std::vector<std::int32_t> record_of(spec.boundaries.size(), -1);
        for (std::size_t r = 0; r < records.size(); ++r)
            record_of[std::size_t(records[r].boundary)] = std::int32_t(r);
        record_of_.assign(record_of);
    }
    records_.assign(records);
    lifted_.assign({0});
}

template <class X, class T, class Sum, int D>
void Uplift<X, T, Sum, D>::list(const BlockTableView<D>& table, const Walls& walls) {
    const std::int64_t nodes = std::int64_t(walls.blocks().size()) * block_cells;
    Buffer<X, std::uint32_t> flag(exec_), position(exec_), number(exec_);
    flag.reserve_discard(std::size_t(nodes));
    position.reserve_discard(std::size_t(nodes) + 1);
    mask_.reserve_discard(std::size_t(nodes));
    exec_.for_each(nodes, MarkFeet<D>{table, walls.view(), walls.blocks().data(), records_.data(),
                                      int(records_.size()), axis_, up_, mask_.data(), flag.data()});
    exec_.exclusive_scan(flag.data(), position.data(), nodes);
    number.reserve_discard(1);
    exec_.copy(number.data(), position.data() + nodes, sizeof(std::uint32_t));
    const std::size_t count = number.host()[0];
    feet_.reserve_discard(count);
    exec_.for_each(nodes, ListHomes{flag.data(), position.data(), feet_.data()});
    before_.reserve_discard(count * D);
    with_.reserve_discard(count * D);
    nodes_ = nodes;
    if (record_of_.size() > 0) {
        rubbing_.reserve_discard(records_.size() * std::size_t(nodes));
        rubbing_.zero();
    }
    exec_.wait();
}

template <class X, class T, class Sum, int D>
void Uplift<X, T, Sum, D>::find(const Node& node, const Walls& walls) {
    exec_.for_each(std::int64_t(feet_.size()),
                   FindUplift<T, Sum, D>{of(node, walls), walls.blocks().data(), feet_.data(),
                                         mask_.data(), before_.data(), with_.data(),
                                         rubbing_.size() > 0 ? rubbing_.data() : nullptr, nodes_});
}

template <class X, class T, class Sum, int D>
void Uplift<X, T, Sum, D>::set(const Node& node, const Walls& walls, const Buffer<X, Sum>& from) {
    exec_.for_each(std::int64_t(feet_.size()),
                   SetFeet<T, Sum, D>{node.grid, walls.blocks().data(), feet_.data(), from.data(),
                                      lifted_.data()});
}

template <class X, class T, class Sum, int D>
void Uplift<X, T, Sum, D>::raise(const Node& node, const Walls& walls) {
    exec_.single(MayLift{node.clock, lifted_.data()});
    set(node, walls, with_);
}

template <class X, class T, class Sum, int D>
void Uplift<X, T, Sum, D>::lower(const Node& node, const Walls& walls) {
    set(node, walls, before_);
    exec_.single(NotLifted{lifted_.data()});
}

template <class X, class T, class Sum, int D>
MeasureUplift<T, Sum, D> Uplift<X, T, Sum, D>::measured(const Node& node, const Walls& walls,
                                                        const std::int32_t* slots,
                                                        const LoadCellRecord<D>* cells,
                                                        const ImpulseScales& scales) const {
    return {of(node, walls), walls.touched().data(), mask_.data(), slots, cells, scales};
}

}  // namespace mpm
