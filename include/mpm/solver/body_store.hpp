// The particles of one body: columns, order, and what the plan decided about them.
#pragma once

#include <memory>
#include <string>
#include <vector>

#include "mpm/exec/buffer.hpp"
#include "mpm/exec/sums.hpp"
#include "mpm/kernels/pass.hpp"
#include "mpm/kernels/sorting.hpp"
#include "mpm/solver/element_mesh.hpp"
#include "mpm/solver/engine.hpp"
#include "mpm/solver/plan.hpp"

namespace mpm {

template <class X, class T, int D>
struct BodyStore {
    explicit BodyStore(X& x)
        : id(x),
          cell_start(x),
          cell(x),
          moves(x),
          home(x),
          pair(x),
          lone(x),
          lone_slot(x),
          coloured(x),
          scratch(x),
          smoothing_set(x) {}

    BodyPlan plan;
    BodyOps<X, T, D> ops{};
    const MaterialInfo* material = nullptr;
    std::vector<double> parameters;
    std::uint64_t first_id = 0;
    double particle_mass = 0;
    double particle_volume = 0;
    // Of bodies of elements, whose vertices are the particles; their particle is the mean vertex.
    std::unique_ptr<ElementMesh<X, T, D>> mesh;
    ElementOps<X, T, D> elements{};
    int rigid = -1;  // its number among the rigid bodies

    std::uint32_t count = 0;
    std::vector<Buffer<X, T>> offset;  // D columns
    std::vector<Buffer<X, T>> state;
    Buffer<X, std::uint32_t> id;
    Buffer<X, std::uint32_t> cell_start;   // (slots * 64 + 1)
    Buffer<X, std::uint8_t> cell;          // devices: `home_byte` of each particle
    HomeOrder order = HomeOrder::by_rank;  // devices: how particles of a home are stored
    Buffer<X, std::uint8_t> moves;         // while it is sorted: `HomeMove` of each particle
    bool looks_ahead = false;              // does this sort, whether or not there are particles
    Buffer<X, std::int32_t> home;
    std::int32_t homes = 0, full_homes = 0;
    std::int32_t all_full_homes = 0;  // devices: of all ranks
    Buffer<X, std::int32_t> pair;     // devices: full homes two by two, where there are many
    std::int32_t pairs = 0;
    Buffer<X, std::uint32_t> lone;  // devices: particles of the homes that are not full
    Buffer<X, std::int32_t> lone_slot;
    std::uint32_t lone_count = 0;
    Buffer<X, std::int32_t> coloured;                 // CPU: home blocks by colour
    std::vector<std::int32_t> colour_start;           // CPU
    Buffer<X, typename X::template Grid<T>> scratch;  // two-pass: what particles deposit

    SmoothingHistory smoothing;       // over cells
    std::int64_t smoothing_seen = 0;  // devices: calls that are in it
    Buffer<X, SumSet> smoothing_set;  // devices: the homes that its energy is summed over
    std::int64_t smoothing_homes = -1;
    std::uint64_t count_of_all = 0;  // particles on all ranks; on CPUs those of this one

    // Taken out of the computation by the policy for particles that leave the domain, still listed.
    std::vector<std::uint32_t> frozen_id;
    std::vector<double> frozen_position;  // (n, D)
    std::vector<double> frozen_state;     // (n, state columns)

    HomeMoves home_moves() const {
        return {looks_ahead, moves.data(), std::uint32_t(moves.size())};
    }
    BodyView<T, D> view() const {
        BodyView<T, D> v{};
        for (int a = 0; a < D; ++a) v.offset[a] = offset[a].data();
        for (std::size_t r = 0; r < state.size(); ++r) v.state[r] = state[r].data();
        v.id = id.data();
        v.count = count;
        v.cell_start = cell_start.data();
        v.cell = X::is_device ? cell.data() : nullptr;
        v.home = home.data();
        v.homes = homes;
        v.full_homes = full_homes;
        v.pair = pair.data();
        v.pairs = pairs;
        v.lone = lone.data();
        v.lone_slot = lone_slot.data();
        v.lone_count = lone_count;
        v.particle_mass = particle_mass;
        v.particle_volume = particle_volume;
        return v;
    }
};

}  // namespace mpm
