// Domain: particles into cells, and the sums that the first step reads.
#pragma once

#include "mpm/kernels/placing.hpp"
#include "mpm/solver/domain.hpp"

namespace mpm {

/// Rows of positions that are held at a time.
inline constexpr std::uint64_t piece_rows = std::uint64_t(1) << 22;

/// Calls f(first, rows, position on the device, the same on the host) for the particles of a body.
template <class X, class F>
void for_each_piece(X& exec, const Rows& rows, std::uint64_t count, int width, const F& f) {
    Buffer<X, double> there(exec);
    std::vector<double> here;
    for (std::uint64_t first = 0; first < count; first += piece_rows) {
        const std::uint64_t n = std::min(piece_rows, count - first);
        here.resize(n * width);
        rows(first, first + n, here.data());
        there.assign(here);
        f(first, std::int64_t(n), there.data(), here);
    }
}

template <class X, class T, int D>
void Domain<X, T, D>::place_particles(const Spec& spec) {
    find_blocks(spec);
    for (std::size_t b = 0; b < bodies_.size(); ++b) place_body(bodies_[b], spec.bodies[b]);
}

/// The table: blocks that hold particles, and their neighbours.
template <class X, class T, int D>
void Domain<X, T, D>::find_blocks(const Spec& spec) {
    Buffer<X, std::uint64_t> keys(exec_), first_outside(exec_);
    Buffer<X, std::uint32_t> outside(exec_);
    std::vector<std::uint64_t> homes;
    for (const BodySpec& s : spec.bodies) {
        outside.assign({0});
        first_outside.assign({~std::uint64_t(0)});
        for_each_piece(
            exec_, s.position, s.count, D,
            [&](std::uint64_t first, std::int64_t n, const double* position,
                const std::vector<double>&) {
                keys.reserve_discard(n);
                FindBlocks<X, D> find{
                    position,       spec.cell_size,      {}, table_.keys_of, first, keys.data(),
                    outside.data(), first_outside.data()};
                for (int a = 0; a < D; ++a) find.cells[a] = spec.cells[a];
                exec_.for_each(n, find);
                keys.shrink(std::size_t(exec_.sort_unique(keys.data(), n, table_.keys_of.bits())));
                const auto found = keys.host();
                homes.insert(homes.end(), found.begin(), found.end());
            });
        const std::uint32_t n = outside.host()[0];
        if (n > 0) {
            throw SceneError("body '" + s.name + "': " + std::to_string(n) +
                             " particles lie outside the domain, the first with id " +
                             std::to_string(s.first_id + first_outside.host()[0]) +
                             ". Enlarge the domain or move the body");
        }
    }
    std::sort(homes.begin(), homes.end());
    homes.erase(std::unique(homes.begin(), homes.end()), homes.end());
    keys.assign(homes);
    set_neighbourhood(keys, keys_);
    table_.keys = keys_.data();
    table_.slots = std::int32_t(keys_.size());
}

template <class X, class T, int D>
void Domain<X, T, D>::place_body(Body& body, const BodySpec& s) {
    body.count = std::uint32_t(s.count);
    const std::size_t room = s.count + column_padding;
    for (int a = 0; a < D; ++a) {
        body.offset.emplace_back(exec_);
        body.offset.back().reserve_discard(room);
    }
    for (int r = 0; r < body.plan.state_columns; ++r) {
        body.state.emplace_back(exec_);
        body.state.back().reserve_discard(room);
        body.state.back().zero();
    }
    body.id.reserve_discard(room);
    if constexpr (X::is_device) body.cell.reserve_discard(room);
    Buffer<X, std::uint32_t> cell(exec_);
    cell.reserve_discard(room);
    cell.shrink(s.count);
    for_each_piece(exec_, s.position, s.count, D,
                   [&](std::uint64_t first, std::int64_t n, const double* position,
                       const std::vector<double>&) {
                       PlaceParticles<T, D> place{position,
                                                  spec_.cell_size,
                                                  {},
                                                  table_,
                                                  {},
                                                  cell.data() + first,
                                                  body.id.data() + first,
                                                  std::uint32_t(first)};
                       for (int a = 0; a < D; ++a) {
                           place.cells[a] = spec_.cells[a];
                           place.offset[a] = body.offset[a].data() + first;
                       }
                       exec_.for_each(n, place);
                   });
    if (s.pressure) {
        std::vector<T> j;
        for_each_piece(
            exec_, s.pressure, s.count, 1,
            [&](std::uint64_t first, std::int64_t n, const double*,
                const std::vector<double>& pressure) {
                j.resize(n);
                for (std::int64_t k = 0; k < n; ++k) {
                    j[k] = T(body.material->volume_from_pressure(pressure[k], s.parameters.data()));
                }
                for (auto& column : body.state)
                    exec_.upload(column.data() + first, j.data(), n * sizeof(T));
            });
    }
    const std::int64_t range = std::int64_t(table_.slots) * block_cells;
    body.cell_start.reserve_discard(range + 2);
    arrange(exec_, cell, range, body.id.data(), body.cell_start.data(), body.cell.data());
    permute(body, cell.data());
    cell = Buffer<X, std::uint32_t>(exec_);
    exec_.trim();
}

template <class X, class T, int D>
void Domain<X, T, D>::first_deposit(const Spec& spec) {
    for (auto& s : sums_) {
        s.reserve_discard(std::size_t(table_.slots) * plan_.sum_channels * block_cells);
        s.zero();
    }
    std::vector<BodyNumbers> numbers;
    for (const BodyConstants& body : constants_.host())
        numbers.push_back(body_numbers(body, spec_.cell_size, clock_.dt, clock_.dt));
    numbers_.assign(numbers);
    if constexpr (!std::is_integral_v<Sum>) {
        deposit_all(spec);
    } else {
        // Once to learn what is deposited, with a mass that cannot be exceeded: all particles of a
        // node's 3^D cells, each with the largest weight.
        Buffer<X, double> found(exec_);
        found.reserve_discard(1);
        double mass = 0;
        for (Body& body : bodies_) {
            exec_.template max_each<1>(std::int64_t(table_.slots) * block_cells,
                                       MostOfCell{body.cell_start.data()}, Keep{found.data()});
            mass += body.particle_mass * std::max(found.host()[0], 1.0) * stencil_nodes<D> *
                    std::pow(0.75, D);
        }
        set_scales(mass, 1, 1);
        deposit_all(spec);
        exec_.template max_each<1>(std::int64_t(table_.slots) * block_cells,
                                   LargestNodeMass<Grid, Sum, D>{node_update(0)},
                                   Keep{found.data()});
        fetch_clock();
        const double calm = 1e-6 * plan_.wave_speed;
        set_scales(std::max(found.host()[0], least_mass_),
                   2 * std::max(clock_.deposited[momentum_sum], calm),
                   2 * std::max(clock_.deposited[group_sum], 1e-7));
        sums_[0].zero();
        deposit_all(spec);
        fetch_clock();
    }
}

template <class X, class T, int D>
void Domain<X, T, D>::set_scales(double mass, double momentum_limit, double group_limit) {
    if constexpr (std::is_integral_v<Sum>) {
        const FixedPoint f =
            fixed_point(X::template sum_bits<T>, mass, momentum_limit, group_limit);
        for (int q = 0; q < quantities; ++q) {
            clock_.scale_write[q] = f.scale[q];
            clock_.unit_read[q] = 1 / f.scale[q];
            clock_.deposit_limit[q] = f.limit[q];
            clock_.deposited[q] = 0;
        }
    }
}

template <class X, class T, int D>
void Domain<X, T, D>::deposit_all(const Spec& spec) {
    push_clock();
    for (std::size_t b = 0; b < bodies_.size(); ++b) {
        Body& body = bodies_[b];
        if (body.homes == 0) continue;
        const auto& velocity = spec.bodies[b].velocity;
        const std::size_t n = body.count;
        body.scratch.reserve_discard(n * D + column_padding);
        Buffer<X, Grid> given(exec_);
        std::vector<Grid> piece;
        for (int a = 0; a < D; ++a) {
            Grid* to = body.scratch.data() + a * n;
            if (velocity.size() == std::size_t(D)) {
                exec_.for_each(std::int64_t(n), Constant<Grid>{Grid(velocity[a]), to});
                continue;
            }
            piece.resize(n);
            for (std::size_t k = 0; k < n; ++k) piece[k] = Grid(velocity[k * D + a]);
            given.assign(piece);
            exec_.for_each(std::int64_t(n), Take<Grid>{body.id.data(), given.data(), to});
        }
        body.ops.initial(pass(body, int(b), 0));
        exec_.wait();
        body.scratch = Buffer<X, Grid>(exec_);
    }
}

}  // namespace mpm
