// A device on the host: what common code knows of CUDA, with loops for kernels, so that ranks on
// devices are tested where there is none. Sums are integers and particles are taken one by one.
// Ranks reach each other's memory, or send each other what they would have written there.
#pragma once

#include <algorithm>
#include <cstdlib>
#include <cstring>
#include <functional>
#include <memory>
#include <vector>

#include "mpm/core/error.hpp"
#include "mpm/exec/communicator.hpp"
#include "mpm/exec/sums.hpp"
#include "mpm/kernels/arrange.hpp"
#include "mpm/kernels/body_common.hpp"
#include "mpm/kernels/keep.hpp"
#include "mpm/kernels/order.hpp"
#include "mpm/kernels/phase_ops.hpp"

namespace mpm {

class SlowDevice {
public:
    static constexpr bool is_device = true;
    template <class T>
    using Grid = T;
    template <class T>
    using Sum = std::int32_t;
    template <class T>
    static constexpr int sum_bits = 31;
    static constexpr double drift_limit = 0.95;
    static constexpr double look_ahead = 1.0 / 3;
    static std::uint64_t stray_limit(std::uint64_t particles) { return 3 * particles; }
    static constexpr int batch = 8;

    explicit SlowDevice(bool reaches = true) : reaches_(reaches) {}

    /// Nothing is queued here, so to meet is to wait for all.
    struct Meeting {
        Communicator& comm;
        bool reaching;
        static std::unique_ptr<Meeting> open(SlowDevice& x, Communicator& c) {
            return std::make_unique<Meeting>(Meeting{c, x.reaches_});
        }
        bool reaches() const { return reaching; }
        void meet() {
            if (!reaching) throw Error("ranks that do not reach each other meet by parcels");
            comm.all_gather(std::vector<int>{0});
        }
        void swap(const std::vector<Parcel>& out, const std::vector<Parcel>& in) {
            std::vector<Bytes> to(std::size_t(comm.ranks()));
            std::vector<int> peers;
            for (int r : comm.others()) {
                const auto goes = [&](const Parcel& p) { return p.rank == r; };
                if (std::any_of(out.begin(), out.end(), goes) ||
                    std::any_of(in.begin(), in.end(), goes))
                    peers.push_back(r);
            }
            for (const Parcel& p : out) {
                const auto* from = static_cast<const unsigned char*>(p.at);
                to[std::size_t(p.rank)].insert(to[std::size_t(p.rank)].end(), from, from + p.bytes);
            }
            const auto come = comm.exchange(std::move(to), peers);
            std::vector<std::size_t> read(come.size(), 0);
            for (const Parcel& p : in) {
                std::size_t& at = read[std::size_t(p.rank)];
                if (come[std::size_t(p.rank)].size() < at + p.bytes)
                    throw Error("a parcel is smaller than what was waited for");
                std::memcpy(p.at, come[std::size_t(p.rank)].data() + at, p.bytes);
                at += p.bytes;
            }
            for (std::size_t r = 0; r < come.size(); ++r)
                if (read[r] != come[r].size()) throw Error("nobody waited for a parcel");
        }
        void wait() {}
        void give_up() noexcept {}
        void begin_anew() {}
    };

    void* allocate(std::size_t bytes) {
        void* p = std::malloc(bytes > 0 ? bytes : 1);
        std::memset(p, 0xcd, bytes);
        return p;
    }
    void release(void* p, std::size_t bytes) noexcept {
        std::memset(p, 0xdd, bytes);
        std::free(p);
    }
    void copy(void* to, const void* from, std::size_t bytes) {
        if (bytes > 0) std::memcpy(to, from, bytes);
    }
    void upload(void* to, const void* from, std::size_t bytes) { copy(to, from, bytes); }
    void download(void* to, const void* from, std::size_t bytes) { copy(to, from, bytes); }
    void zero(void* p, std::size_t bytes) {
        if (bytes > 0) std::memset(p, 0, bytes);
    }
    void wait() {}
    void wait_for_all() noexcept {}
    void trim() {}
    struct Peak {
        std::uint64_t used = 0, held = 0;
    };
    Peak peak() const { return {}; }
    int device() const { return 0; }
    int multiprocessors() const { return 1; }
    bool shared() const { return false; }
    bool shares_work() const { return true; }
    void side_stream() {}
    void main_stream() {}
    void join() {}
    std::uint32_t* arrivals() const { return arrivals_.get(); }

    template <class F>
    void single(const F& f) {
        f();
    }
    template <class F>
    void for_each(std::int64_t n, const F& f) {
        for (std::int64_t i = n - 1; i >= 0; --i) f(i);
    }
    template <class F>
    void for_each_large(std::int64_t n, const F& f) {
        for_each(n, f);
    }
    template <class F>
    void for_each_next(std::int64_t n, const F& f) {
        for_each(n, f);
    }
    void host_for(std::int64_t n, const std::function<void(std::int64_t)>& f) { for_each(n, f); }
    template <int M, class F, class G>
    void max_each(std::int64_t n, const F& f, const G& then) {
        double out[M] = {};
        for (std::int64_t i = 0; i < n; ++i) f(i, out);
        then(static_cast<const double*>(out));
    }
    std::int64_t sum_parts(std::int64_t) const { return 1; }
    template <int W, class F, class G, class A, class H>
    void sum_each(const SumSets& sets, const F& f, const G& then, A*, std::int64_t more,
                  const H& beside) {
        for_each(more, beside);
        for (int s = 0; s < sets.count; ++s) {
            A sums[W] = {};
            for (std::int64_t i = 0; i < sets.set[s].count; ++i) f(sets.set[s].first + i, s, sums);
            then(s, static_cast<const A*>(sums));
        }
        if constexpr (requires { then.done(); }) then.done();
    }
    void exclusive_scan(const std::uint32_t* in, std::uint32_t* out, std::int64_t n) {
        std::uint32_t sum = 0;
        for (std::int64_t i = 0; i < n; ++i) {
            const std::uint32_t x = in[i];
            out[i] = sum;
            sum += x;
        }
        out[n] = sum;
    }
    std::int64_t sort_unique(std::uint64_t* keys, std::int64_t n, int) {
        std::sort(keys, keys + n);
        return std::unique(keys, keys + n) - keys;
    }
    void sort_by_key(std::uint32_t*, std::int32_t*, std::int64_t, int) {}

    static void raise(std::uint32_t* flag) { *flag = 1; }
    static void keep_smallest(std::uint64_t* to, std::uint64_t value) {
        *to = std::min(*to, value);
    }
    static void add_integer(std::int64_t* to, std::int64_t by) { *to += by; }
    static std::uint32_t fetch_add(std::uint32_t* to, std::uint32_t by) {
        return std::exchange(*to, *to + by);
    }

private:
    bool reaches_;
    std::unique_ptr<std::uint32_t> arrivals_ = std::make_unique<std::uint32_t>(0);
};

/// As src/kernels/cuda/arrange.cu.
inline void arrange_homes(SlowDevice&, std::uint32_t* cell, std::int64_t particles,
                          std::int64_t cells, const std::uint32_t* id, std::uint32_t* start,
                          std::uint8_t* home, HomeOrder of_home) {
    std::vector<std::uint32_t> of(cell, cell + particles), arrived(of.size());
    for (std::size_t p = 0; p < of.size(); ++p) arrived[p] = std::uint32_t(p);
    std::sort(arrived.begin(), arrived.end(), [&](std::uint32_t a, std::uint32_t b) {
        return of[a] != of[b] ? of[a] < of[b] : id[a] < id[b];
    });
    std::size_t at = 0;
    for (std::int64_t c = 0; c <= cells; ++c) {
        while (at < arrived.size() && of[arrived[at]] < std::uint32_t(c)) ++at;
        start[c] = std::uint32_t(at);
    }
    start[cells + 1] = std::uint32_t(particles);
    place_homes(of_home, start, std::size_t(cells),
                [&](std::size_t c, std::uint32_t rank, std::uint32_t place, std::uint8_t byte) {
                    cell[place] = arrived[start[c] + rank];
                    home[place] = byte;
                });
}

namespace test {

template <class Material, Smoothing S, int D>
void add_slow_phases(BodyOps<SlowDevice, float, D>& ops);

/// The nodes around a cell, which is one of a home block or beside it.
template <int D, int C>
struct NodesAround {
    const Pass<SlowDevice, float, D>& pass;
    const std::int32_t* neighbours;
    int cell[D];
    static constexpr int stride(int axis) { return D - axis == 3 ? 3 : 1; }

    void find(int node, std::int32_t& slot, int& number) const {
        int at[D], neighbour;
        for (int a = D - 1; a >= 0; --a) {
            at[a] = cell[a] + node % 3 - 1 + Block<D>::margin;
            node /= 3;
        }
        arena_node<D>(at, neighbour, number);
        slot = neighbours[neighbour];
    }
    template <int N>
    Line<float, N> load(int line) const {
        float u[3][C];
        for (int k = 0; k < 3; ++k) {
            std::int32_t slot;
            int number;
            find(line * 3 + k, slot, number);
            const float* from = pass.grid.velocity + pass.grid.velocity_place(slot, number);
            for (int c = 0; c < C; ++c) u[k][c] = from[c < D ? c : pass.group.average];
        }
        Line<float, N> out;
        for (int c = 0; c < N; ++c) {
            float q[3];
            expand_line(u[0][c], u[1][c], u[2][c], q);
            for (int k = 0; k < 3; ++k) out.q[k][c] = q[k];
        }
        return out;
    }
    void add(int node, int channel, float v) {
        const int quantity = channel < D ? momentum_sum : (channel < C ? group_sum : mass_sum);
        const double scale = pass.body.particle_mass * pass.clock->scale_write[quantity];
        const std::int32_t x = std::int32_t(std::lrint(double(v) * scale));
        std::int32_t slot;
        int number;
        find(node, slot, number);
        put(pass.grid.sums, slot, number, channel, x);
    }
    void add_mass(int node, float v) { add(node, C, v); }
    void put(std::int32_t* sums, std::int32_t slot, int number, int channel, std::int32_t x) const {
        std::int32_t* to =
            sums + std::int64_t(slot) * pass.grid.sum_channels * block_cells + number;
        const auto plus = [&](int c) {
            __atomic_fetch_add(to + c * block_cells, x, __ATOMIC_RELAXED);
        };
        if (channel < C) return plus(channel < D ? 1 + channel : pass.group.sum);
        plus(0);
        if (pass.group.weight >= 0) plus(pass.group.weight);
    }
};

/// Calls f(place, home cell, nodes) for all particles of a body.
template <int D, int C, class F>
void for_each_particle(const Pass<SlowDevice, float, D>& pass, const F& f) {
    for (std::int32_t h = 0; h < pass.body.homes; ++h) {
        const std::int32_t slot = pass.body.home[h];
        const std::uint32_t* start = pass.body.cell_start + std::int64_t(slot) * block_cells;
        NodesAround<D, C> nodes{
            pass, pass.grid.table.neighbours + std::int64_t(slot) * Block<D>::neighbours, {}};
        for (std::uint32_t q = start[0]; q < start[block_cells]; ++q) {
            int home[D];
            Block<D>::coordinates(pass.body.cell[q], home);
            f(q, home, nodes);
        }
    }
}

template <int D, int C>
void settle(const int (&home)[D], const Vec<float, D>& xi, NodesAround<D, C>& nodes,
            Vec<float, D>& local) {
    for (int a = 0; a < D; ++a) {
        const int shift = cell_shift(xi[a]);
        nodes.cell[a] = home[a] + shift;
        local[a] = xi[a] - float(shift);
    }
}

template <class Material, Smoothing S, int D>
void deposit(const Pass<SlowDevice, float, D>& pass, NodesAround<D, transfer_channels<D, S>>& nodes,
             const Vec<float, D>& local, const Affine<float, D, transfer_channels<D, S>>& u) {
    constexpr int C = transfer_channels<D, S>;
    const auto larger = [&](int quantity, float x) {
        pass.deposited[quantity] = std::max(pass.deposited[quantity], double(x));
    };
    larger(momentum_sum, deposit_size<0, D>(u));
    if constexpr (C > D) larger(group_sum, deposit_size<D, C>(u));
    scatter<float, D, C, true>(nodes, quadratic_weights<float, D>(local), 1.0f, u);
}

/// All workers of a body have been: the last of all bodies' turns the clock.
template <int D>
void arrive(const Pass<SlowDevice, float, D>& pass, std::int32_t workers) {
    *pass.arrivals += std::uint32_t(workers);
    if (*pass.arrivals < pass.workers) return;
    pass.turn();
    *pass.arrivals = 0;
}

/// What is left of a particle's step: `advance(nodes, local, state)` makes its deposit, and
/// `put(nodes, local, deposit)` adds it.
template <class Material, int C, int R, int D, class Advance, class Put>
void step_slowly(const Pass<SlowDevice, float, D>& pass, const Advance& advance, const Put& put) {
    if (pass.clock->halt != Halt::none) return;
    for_each_particle<D, C>(pass, [&](std::uint32_t q, const int(&home)[D], auto& nodes) {
        Vec<float, D> xi, local;
        float state[R];
        for (int a = 0; a < D; ++a) xi[a] = pass.body.offset[a][q];
        for (int r = 0; r < R; ++r) state[r] = pass.body.state[r][q];
        settle<D, C>(home, xi, nodes, local);
        const auto u = advance(nodes, local, state);
        for (int a = 0; a < D; ++a) xi[a] = local[a] + float(nodes.cell[a] - home[a]);
        for (int a = 0; a < D; ++a) pass.body.offset[a][q] = xi[a];
        for (int r = 0; r < R; ++r) pass.body.state[r][q] = state[r];
        if (!sound<Material>(xi, state))
            return SlowDevice::keep_smallest(pass.fault_particle,
                                             fault_number(pass.body_number, q));
        settle<D, C>(home, xi, nodes, local);
        for (int a = 0; a < D; ++a) {
            if (nodes.cell[a] == home[a]) continue;
            if (*pass.strays != ~std::uint64_t(0)) ++*pass.strays;
            break;
        }
        put(nodes, xi, local, u);
    });
    arrive(pass, pass.body.full_homes);
}

template <class Material, Smoothing S, int D>
void run_slowly(const Pass<SlowDevice, float, D>& pass) {
    constexpr int C = transfer_channels<D, S>, R = state_reals<Material, D, S>;
    const auto numbers = step_numbers<float, Material>(
        *pass.numbers, Material::template constants<float>(pass.parameters), pass.carry,
        pass.stress_only);
    step_slowly<Material, C, R, D>(
        pass,
        [&](auto& nodes, Vec<float, D>& local, float(&state)[R]) {
            return advance_particle<Material, S, float, D>(nodes, 0, local, state, numbers);
        },
        [&](auto& nodes, const Vec<float, D>&, const Vec<float, D>& local, const auto& u) {
            deposit<Material, S, D>(pass, nodes, local, u);
        });
}

/// The nodes around a cell as schemes that store velocities see them.
template <int D, int C>
struct KeptNodes {
    NodesAround<D, C>& around;
    const KeepNumbers<float>& keep;
    static constexpr int stride(int axis) {
        int s = 1;
        for (int a = D - 1; a > axis; --a) s *= 3;
        return s;
    }
    struct Node {
        float e[4];
    };
    Node load(int node) const {
        std::int32_t slot;
        int number;
        around.find(node, slot, number);
        const auto& grid = around.pass.grid;
        const float* from = grid.velocity + grid.velocity_place(slot, number);
        Node out{};
        for (int a = 0; a < D; ++a) out.e[a] = from[keep.before + a];
        if (keep.guarded) out.e[D] = from[keep.guard];
        return out;
    }
    void add(int node, int channel, float v) {
        if (channel < C) return around.add(node, channel, v);
        const auto& pass = around.pass;
        const double scale = pass.body.particle_mass * pass.clock->scale_write[momentum_sum];
        std::int32_t slot;
        int number;
        around.find(node, slot, number);
        std::int32_t* to =
            pass.grid.sums +
            (std::int64_t(slot) * pass.grid.sum_channels + keep.plain + channel - C) * block_cells +
            number;
        *to += std::int32_t(std::lrint(double(v) * scale));
    }
    void add_mass(int node, float v) { around.add_mass(node, v); }
};

/// As kernels/cuda/keep.cuh.
template <class Material, Smoothing S, int D>
void keep_slowly(const Phase<SlowDevice, float, D>& phase) {
    const auto& pass = phase.pass;
    constexpr int C = transfer_channels<D, S>, R = state_reals<Material, D, S> + D;
    const auto numbers = step_numbers<float, Material>(
        *pass.numbers, Material::template constants<float>(pass.parameters), pass.carry,
        pass.stress_only);
    const auto keep = keep_numbers<float>(phase.n);
    step_slowly<Material, C, R, D>(
        pass,
        [&](auto& nodes, Vec<float, D>& local, float(&state)[R]) {
            return advance_keeping<Material, S, float, D>(nodes, 0, KeptNodes<D, C>{nodes, keep}, 0,
                                                          local, state, numbers, keep);
        },
        [&](auto& nodes, const Vec<float, D>& xi, const Vec<float, D>& local, const auto& u) {
            if (strays_far(xi)) *pass.strays = ~std::uint64_t(0);
            const auto larger = [&](int quantity, float x) {
                pass.deposited[quantity] = std::max(pass.deposited[quantity], double(x));
            };
            larger(momentum_sum, deposit_size<0, D>(u));
            larger(momentum_sum, deposit_size<C, C + D>(u));
            if constexpr (C > D) larger(group_sum, deposit_size<D, C>(u));
            KeptNodes<D, C> sums{nodes, keep};
            scatter<float, D, C + D, true>(sums, quadratic_weights<float, D>(local), 1.0f, u);
        });
}

template <class Material, Smoothing S, int D>
void rest_slowly(const Pass<SlowDevice, float, D>& pass) {
    constexpr int C = transfer_channels<D, S>, R = state_reals<Material, D, S>;
    const auto numbers = step_numbers<float, Material>(
        *pass.numbers, Material::template constants<float>(pass.parameters), pass.carry,
        pass.stress_only);
    for_each_particle<D, C>(pass, [&](std::uint32_t q, const int(&home)[D], auto& nodes) {
        Vec<float, D> xi, local, velocity;
        float state[R];
        for (int a = 0; a < D; ++a) xi[a] = pass.body.offset[a][q];
        for (int r = 0; r < R; ++r) state[r] = pass.body.state[r][q];
        for (int a = 0; a < D; ++a)
            velocity[a] = pass.scratch[a * std::size_t(pass.body.count) + q];
        settle<D, C>(home, xi, nodes, local);
        deposit<Material, S, D>(
            pass, nodes, local,
            resting_particle<Material, S, float, D, float>(velocity, state, numbers));
    });
}

template <class Material, Smoothing S, int D>
BodyOps<SlowDevice, float, D> slow_ops() {
    BodyOps<SlowDevice, float, D> ops{};
    add_slow_phases<Material, S, D>(ops);
    ops.fused = ops.split = &run_slowly<Material, S, D>;
    ops.pairs = true;
    if constexpr (fuses_memory<Material>) ops.keep = ops.split_keep = &keep_slowly<Material, S, D>;
    ops.initial = &rest_slowly<Material, S, D>;
    ops.energies = [](const Pass<SlowDevice, float, D>& pass, const std::int32_t*,
                      double* partial) { std::fill_n(partial, 3 * pass.body.homes, 1.0); };
    ops.state_columns = state_reals<Material, D, S>;
    ops.channels = transfer_channels<D, S>;
    ops.observe = [](const double* state, const double(&rate)[D][D], const double* parameters) {
        return Material::template observe<D>(state, rate, parameters);
    };
    return ops;
}

}  // namespace test
}  // namespace mpm

#include "support/slow_phases.hpp"
