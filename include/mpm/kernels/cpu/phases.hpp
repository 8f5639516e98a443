// CPU driver of the phased step: loops, lanes and flush; no formula. Collecting and responding are
// independent particle by particle; spreading goes by colours of blocks that share no node, so that
// no number of threads changes a bit. Nor does the order of a body's particles, which ranks differ
// in: whether one shares a pack depends on itself alone.
#pragma once

#include "mpm/exec/cpu.hpp"
#include "mpm/kernels/cpu/arena.hpp"
#include "mpm/kernels/cpu/levels.hpp"
#include "mpm/kernels/respond.hpp"

namespace mpm::cpu {

inline int phase_threads(const Cpu& exec, std::uint32_t particles) {
    return particles > 2048 ? exec.threads() : 1;
}

/// Sorting is due, whatever the drift.
inline void call_for_sort(std::uint64_t* strays) {
    __atomic_store_n(strays, ~std::uint64_t(0), __ATOMIC_RELAXED);
}

/// The numbers of the particles from q on, a lane each, where their body keeps them. Of lanes that
/// are not taken 0 is read and nothing written.
template <class T, int D>
struct PackOfParticles {
    using Number = Pack<T, lanes<T>>;
    using G = Number;
    using Mask = MaskOf<Number>;
    const Pass<Cpu, T, D>& pass;
    std::uint32_t q;
    Mask taken;
    bool whole;

    MPM_INLINE Number load(const T* column) const {
        const Number x = Number::load(column + q);
        return whole ? x : select(taken, x, Number(T(0)));
    }
    MPM_INLINE void store(T* column, Number x) const {
        if (whole) return x.store(column + q);
        for (int l = 0; l < Number::lanes; ++l)
            if (taken[l]) column[q + l] = x[l];
    }
    MPM_INLINE Number offset(int a) const { return load(pass.body.offset[a]); }
    MPM_INLINE void set_offset(int a, Number x) const { store(pass.body.offset[a], x); }
    MPM_INLINE Number state(int r) const { return load(pass.body.state[r]); }
    MPM_INLINE void set_state(int r, Number x) const { store(pass.body.state[r], x); }
    MPM_INLINE Number scratch(int c) const {
        return load(pass.scratch + std::size_t(c) * pass.body.count);
    }
    MPM_INLINE void set_scratch(int c, Number x) const {
        store(pass.scratch + std::size_t(c) * pass.body.count, x);
    }
};

template <class Material, Smoothing S, class T, int D>
struct RespondRange {
    using P = Phase<Cpu, T, D>;
    using Numbers = StepNumbers<T, Material>;

    MPM_INLINE static void tell(const P& phase, bool is_sound, bool is_far, std::uint32_t q) {
        const auto& pass = phase.pass;
        if (!is_sound) Cpu::keep_smallest(pass.fault_particle, fault_number(pass.body_number, q));
        if (is_far) call_for_sort(pass.strays);
    }
    template <bool packs>
    MPM_INLINE static void run(const P& phase, const Numbers& numbers, bool due,
                               std::uint32_t begin, std::uint32_t end) {
        if constexpr (packs && !lane_wise<Material>) {
            // Parallelepipeds go one by one.
            if (phase.n.edges < 0) return by_packs(phase, numbers, due, begin, end);
        }
        for (std::uint32_t q = begin; q < end; ++q) {
            const auto found = respond_particle<Material, S>(phase, numbers, due, q);
            tell(phase, found.sound, found.far, q);
        }
    }
    MPM_INLINE static void by_packs(const P& phase, const Numbers& numbers, bool due,
                                    std::uint32_t begin, std::uint32_t end) {
        using Row = PackOfParticles<T, D>;
        constexpr std::uint32_t W = Row::Number::lanes;
        for (std::uint32_t q = begin; q < end; q += W) {
            const auto taken = Row::Mask::first(int(end - q < W ? end - q : W));
            const Row row{phase.pass, q, taken, end - q >= W};
            const auto found = respond<Material, S>(phase, numbers, due, row);
            if (!any(taken & (found.far | !found.sound))) continue;
            for (std::uint32_t l = 0; l < W; ++l)
                if (taken[int(l)]) tell(phase, found.sound[int(l)], found.far[int(l)], q + l);
        }
    }
};

template <class Material, Smoothing S, class T, int D>
void respond_body(const Phase<Cpu, T, D>& phase) {
    constexpr std::uint32_t piece = 512;
    const auto& pass = phase.pass;
    if (pass.clock->halt != Halt::none) return;
    const auto numbers =
        phase_numbers<Material>(phase, Material::template constants<T>(phase.pass.parameters));
    const bool due = phase.n.sweeps && pass.clock->step % phase.n.every == 0;
    const std::uint32_t count = pass.body.count;
    using B = RespondRange<Material, S, T, D>;
    constexpr Levels levels = lane_wise<Material> ? Levels::base : Levels::up_to_v3;
    const auto run = runner<B, levels, const Phase<Cpu, T, D>&, const typename B::Numbers&, bool,
                            std::uint32_t, std::uint32_t>();
#pragma omp parallel for schedule(static) num_threads(phase_threads(*pass.exec, count))
    for (std::uint32_t k = 0; k < (count + piece - 1) / piece; ++k)
        run(phase, numbers, due, k * piece, std::min(count, (k + 1) * piece));
}
template <class Material, Smoothing S, class T, int D>
void rest_body(const Phase<Cpu, T, D>& phase) {
    const auto numbers =
        phase_numbers<Material>(phase, Material::template constants<T>(phase.pass.parameters));
    for (std::uint32_t q = 0; q < phase.pass.body.count; ++q)
        rest_particle<Material, S>(phase, numbers, q);
}
template <class Material, Smoothing S, class T, int D>
void project_body(const Phase<Cpu, T, D>& phase) {
    if (phase.pass.clock->halt != Halt::none) return;
    const auto numbers =
        phase_numbers<Material>(phase, Material::template constants<T>(phase.pass.parameters));
    const std::uint32_t count = phase.pass.body.count;
#pragma omp parallel for schedule(static) num_threads(phase_threads(*phase.pass.exec, count))
    for (std::uint32_t q = 0; q < count; ++q) project_particle<Material, S>(phase, numbers, q);
}

/// Per home block: kinetic, elastic and potential energy.
template <class Material, Smoothing S, class T, int D>
void phase_energies(const Phase<Cpu, T, D>& phase, const std::int32_t* due, double* partial) {
    if (!*due) return;
    const auto& pass = phase.pass;
#pragma omp parallel for schedule(dynamic, 8) num_threads(pass.exec->threads())
    for (std::int32_t h = 0; h < pass.body.homes; ++h) {
        const std::int32_t slot = pass.body.home[h];
        std::int64_t corner[D];
        pass.grid.table.keys_of.block(pass.grid.table.keys[slot], corner);
        for (int a = 0; a < D; ++a) corner[a] *= Block<D>::edge;
        double sum[3] = {};
        for_each_of_block<T, D>(pass.body, slot, [&](const int(&home)[D], std::uint32_t q) {
            constexpr int R = state_reals<Material, D, S>;
            Vec<T, D> xi;
            T state[R];
            for (int a = 0; a < D; ++a) xi[a] = pass.body.offset[a][q];
            for (int r = 0; r < R; ++r) state[r] = pass.body.state[r][q];
            add_energies_of<Material>(pass, corner, home, xi, speed_squared(phase, q), state, sum);
        });
        for (int e = 0; e < 3; ++e) partial[3 * h + e] = sum[e];
    }
}

/// The phased part of a material's instance.
template <class Material, Smoothing S, class T, int D>
void add_phases(BodyOps<Cpu, T, D>& ops) {
    ops.respond = &respond_body<Material, S, T, D>;
    ops.rest = &rest_body<Material, S, T, D>;
    // Only a second volume is averaged in a transfer of its own.
    if constexpr (S == Smoothing::two_volumes) ops.project = &project_body<Material, S, T, D>;
    ops.phase_energies = &phase_energies<Material, S, T, D>;
    describe_instance<Material, S>(ops);
}

}  // namespace mpm::cpu
