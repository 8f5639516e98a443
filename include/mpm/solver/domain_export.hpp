// Domain: particles for other array libraries. Particles are stored as offsets from their cells, in
// the order of the cells; here they are gathered where they are into dense columns, a row a
// particle in the order of ids. Looking never changes a run: the columns are copies.
#pragma once

#include "mpm/kernels/reading.hpp"
#include "mpm/solver/domain.hpp"

namespace mpm {

/// Sets flag[id - first] where a particle of that id is.
struct FlagIds {
    const std::uint32_t* id;
    std::uint32_t first, ids;
    std::uint32_t* flag;

    MPM_INLINE void operator()(std::int64_t q) const {
        const std::uint32_t k = id[q] - first;  // wraps to beyond `ids` below the first
        if (k < ids) flag[k] = 1;
    }
};

/// How many ids there are up to the last one in use: inlets have room for billions.
struct CountIds {
    const std::uint32_t* id;
    double* count;

    MPM_INLINE void operator()(std::int64_t q, double* local) const {
        const double here = double(id[q]) + 1;
        if (here > local[0]) local[0] = here;
    }
    MPM_INLINE void operator()(const double* maxima) const { *count = maxima[0]; }
};

/// Fills the columns that are asked for, each null otherwise. `lanes` workers share a home block.
/// Devices have no particles that are parallelepipeds.
template <class T, class Grid, int D, bool device>
struct GatherColumns {
    static constexpr int lanes = 32;

    BodyView<T, D> body;
    BlockTableView<D> table;
    const Grid* nodes;
    int channels;
    PhaseNumbers n;
    bool wide;  // the kernel reaches five nodes
    std::uint32_t first, ids;
    const std::uint32_t* row;  // of each id from `first` on; null: none is missing
    double cell_size;
    double origin[D];  // m, added to positions
    std::uint64_t first_id;
    std::uint64_t* id;
    double *position, *velocity, *speed, *kinetic_energy, *volume_ratio, *mass;

    MPM_INLINE void operator()(std::int64_t i) const {
        const std::int32_t slot = body.home[i / lanes];
        const std::uint32_t* start = body.cell_start + std::int64_t(slot) * block_cells;
        const std::int32_t* corner = table.corners + std::int64_t(slot) * D;
        HomeCells homes{start, body.cell};
        for (std::uint32_t q = start[0] + std::uint32_t(i % lanes); q < start[block_cells];
             q += lanes) {
            const std::uint32_t k = body.id[q] - first;
            int home[D];
            Block<D>::coordinates(homes.of(q), home);
            if (k >= ids) continue;
            const std::int64_t to = row ? row[k] : k;
            if (id) id[to] = first_id + body.id[q];
            if (mass) mass[to] = body.particle_mass;
            if (volume_ratio) volume_ratio[to] = 1 - double(body.state[0][q]);
            for (int a = 0; a < D && position; ++a) {
                const double centre = double(corner[a] + home[a]) + 0.5;
                position[to * D + a] = (centre + double(body.offset[a][q])) * cell_size + origin[a];
            }
            if (!nodes) continue;
            double v[D], square = 0;
            Vec<double, D> offset;
            for (int a = 0; a < D; ++a) offset[a] = double(body.offset[a][q]);
            Standing<double, D> at;
            at.find(corner, home, offset);
            const std::int32_t* around =
                table.neighbours + std::int64_t(slot) * Block<D>::neighbours;
            particle_velocity<device, D>(n, wide, at, StoredNumbers<T>{body.state, q},
                                         NodesAround<Grid>{nodes, channels, around}, v);
            for (int a = 0; a < D; ++a) {
                if (velocity) velocity[to * D + a] = v[a];
                square += v[a] * v[a];
            }
            if (speed) speed[to] = sqrt(square);
            if (kinetic_energy) kinetic_energy[to] = 0.5 * body.particle_mass * square;
        }
    }
};

template <class X, class T, int D>
Gathered Domain<X, T, D>::gather(int number, const std::vector<std::string>& names,
                                 const std::vector<double>& origin, IdRange range) {
    Body& body = bodies_.at(std::size_t(number));
    Buffer<X, double> counted(exec_);
    counted.reserve_discard(1);
    counted.zero();
    const CountIds count_ids{body.id.data(), counted.data()};
    if (body.count > 0) exec_.template max_each<1>(body.count, count_ids, count_ids);
    const auto all = std::uint64_t(counted.host()[0]);
    const IdRange mine{body.first_id, all};  // named: nvcc's host pass cannot take it as a list
    const IdRange wanted = range.within(mine);
    const std::uint64_t first = wanted.first - body.first_id, ids = wanted.count;
    const auto asked = [&](const char* name) {
        return std::find(names.begin(), names.end(), name) != names.end();
    };

    // What needs the material is worked out by the host, like what was set aside.
    const std::vector<std::string> here = {"id",    "position",       "velocity",
                                           "speed", "kinetic_energy", "mass"};
    const bool own_ratio =
        body.material->volumetric && body.plan.smoothing != Smoothing::two_volumes;
    std::vector<std::string> on_host;
    for (const auto& name : names) {
        const bool is_here = (std::find(here.begin(), here.end(), name) != here.end() ||
                              (name == "volume_ratio" && own_ratio)) &&
                             !(body.mesh && (name == "mass" || name == "kinetic_energy"));
        if (!is_here || !body.frozen_id.empty()) on_host.push_back(name);
    }
    Gathered out;
    if constexpr (X::is_device) out.device = exec_.device();
    std::vector<std::string> left;
    for (const auto& name : names)
        if (std::find(on_host.begin(), on_host.end(), name) == on_host.end()) left.push_back(name);
    if (!on_host.empty()) {
        const Gathered from = Engine::gather(number, on_host, origin, range);
        for (const auto& [name, column] : from.columns) {
            DenseColumn to = make_column(column.type, column.shape);
            exec_.upload(to.data.get(), column.data.get(), column.bytes());
            out.columns[name] = std::move(to);
        }
    }
    if (left.empty()) return out;

    GatherColumns<T, Grid, D, X::is_device> columns{};
    const bool moving = std::any_of(left.begin(), left.end(), [](const std::string& name) {
        return name == "velocity" || name == "speed" || name == "kinetic_energy";
    });
    if (moving) prepare_velocities();
    Buffer<X, std::uint32_t> flag(exec_), row(exec_);
    std::uint64_t rows = ids;
    if (body.count < all) {
        flag.reserve_discard(ids + 1);
        row.reserve_discard(ids + 1);
        flag.zero();
        exec_.for_each(body.count, FlagIds{body.id.data(), std::uint32_t(first), std::uint32_t(ids),
                                           flag.data()});
        exec_.exclusive_scan(flag.data(), row.data(), std::int64_t(ids));
        std::uint32_t total = 0;
        exec_.download(&total, row.data() + ids, sizeof(total));
        rows = total;
        columns.row = row.data();
    }
    const auto make = [&](const char* name, std::size_t width) -> double* {
        if (!asked(name) || out.columns.count(name)) return nullptr;
        std::vector<std::size_t> shape = {std::size_t(rows)};
        if (width > 1) shape.push_back(width);
        const DenseColumn& c = out.columns[name] = make_column('d', shape);
        return static_cast<double*>(c.data.get());
    };
    if (asked("id") && !out.columns.count("id")) {
        const DenseColumn& c = out.columns["id"] = make_column('L', {std::size_t(rows)});
        columns.id = static_cast<std::uint64_t*>(c.data.get());
    }
    columns.position = make("position", D);
    columns.velocity = make("velocity", D);
    columns.speed = make("speed", 1);
    columns.kinetic_energy = make("kinetic_energy", 1);
    columns.volume_ratio = make("volume_ratio", 1);
    columns.mass = make("mass", 1);
    columns.body = body.view();
    columns.table = table_;
    columns.nodes = moving ? velocity_.data() : nullptr;
    columns.channels = plan_.velocity_channels;
    columns.n = body.plan.phase;
    columns.wide = kernel_width(spec_.kernel.kernel) != 3;
    columns.first = std::uint32_t(first);
    columns.ids = std::uint32_t(ids);
    columns.cell_size = spec_.cell_size;
    for (int a = 0; a < D; ++a) columns.origin[a] = origin.empty() ? 0 : origin[std::size_t(a)];
    columns.first_id = body.first_id;
    exec_.for_each(std::int64_t(body.homes) * GatherColumns<T, Grid, D, X::is_device>::lanes,
                   columns);
    exec_.wait();
    return out;
}

/// Memory of the executor that goes back to it with its last user; the engine must live as long.
template <class X, class T, int D>
DenseColumn Domain<X, T, D>::make_column(char type, const std::vector<std::size_t>& shape) {
    DenseColumn out;
    out.type = type;
    out.shape = shape;
    X* exec = &exec_;
    const std::size_t bytes = std::max<std::size_t>(out.bytes(), 64);
    out.data = std::shared_ptr<void>(exec_.allocate(bytes), [exec, bytes](void* p) {
        exec->wait_for_all();  // another library's work on it may still be queued
        exec->release(p, bytes);
    });
    return out;
}

template <class X, class T, int D>
DenseColumn Domain<X, T, D>::duplicate(const DenseColumn& column) {
    DenseColumn out = make_column(column.type, column.shape);
    exec_.wait_for_all();
    if (column.bytes() > 0) exec_.copy(out.data.get(), column.data.get(), column.bytes());
    exec_.wait();
    return out;
}

template <class X, class T, int D>
void Domain<X, T, D>::copy_out(const DenseColumn& column, void* to) {
    exec_.wait_for_all();
    if (column.bytes() > 0) exec_.download(to, column.data.get(), column.bytes());
}

}  // namespace mpm
