// CUDA driver of the fused step, in three dimensions and single precision, whose warps share the
// work (warp specialisation): some move particles, the others add up what these deposit, producers
// and consumers of a ring. Loops, lists and flush; no formula.
//
// A block of threads owns one home block, or two beside each other along x, and takes them 32 cells
// at a time. A warp that moves takes particles as they lie, a quarter of a chunk
// (kernels/order.hpp), and leaves what each deposits in a ring in shared memory: a row for a rank,
// a column for a cell. A lane of a warp that adds owns a cell and one plane of its stencil, 9 x (C
// + 1) sums in registers, to which it adds the rows. So nobody holds both what moving and what
// adding takes, and 21 warps fit on a multiprocessor where the other fused form has 8
// (design/gpu-step.md).
//
// A particle that has left its cell has weight 0 in its row and goes to a list of the warp that
// moved it, which adds it to the sums as integers, a lane a particle, when the list is full and at
// the end. Sums of a cell are added in the order of ranks, whoever shares its block: no schedule
// and no neighbour changes a bit.
#pragma once

#include "mpm/kernels/cuda/split_shared.cuh"

namespace mpm::cuda {

/// Takes the deposit of one particle straight into the sums of a block.
template <int H, int C>
struct IntoSums {
    using Sums = SplitSums<H, C>;
    std::int32_t* at;  // lowest node of the stencil
    __device__ __forceinline__ void add(int node, int channel, float v) {
        atomicAdd(at + channel * Sums::nodes + stencil_place<Sums, 3>(node), to_fixed(v));
    }
    __device__ __forceinline__ void add_mass(int node, float v) { add(node, C, v); }
};

/// Nine sums a channel.
template <int C>
struct PlaneSums {
    float value[9][C + 1];
    __device__ __forceinline__ void add(int node, int channel, float v) {
        value[node][channel] += v;
    }
    __device__ __forceinline__ void add_mass(int node, float v) { value[node][C] += v; }
};

/// What the warps that move do.
template <class Material, Smoothing S, int H>
struct Mover {
    static constexpr int C = transfer_channels<3, S>, R = state_reals<Material, 3, S>;
    using Shared = SplitShared<H, C, R>;
    using Sums = SplitSums<H, C>;
    using Constants = typename Material::template Constants<float>;

    const Pass<Cuda, float, 3>& pass;
    const Constants& constants;
    const MoverNumbers& numbers;
    Shared& shared;

    struct Particle {
        bool is;
        int origin;  // of its home cell in the lines
        Vec<float, 3> xi;
        float state[R];
    };
    /// A particle that has left its cell.
    struct Stray {
        bool is = false;
        int code = 0, row = 0;  // where its cell begins in the sums; its place in the ring
    };

    __device__ __forceinline__ Walk& walk() const { return shared.walk[threadIdx.x / 32]; }
    /// Which of a chunk's particles is this lane's. Chunks that are not full begin with another
    /// warp each time.
    __device__ __forceinline__ static std::uint32_t lane_in_chunk(unsigned turn) {
        return (threadIdx.x / 32 + turn) % movers * 32 + threadIdx.x % 32;
    }
    /// What is needed again of the particle that is on its way: its place, and that of its home.
    __device__ __forceinline__ volatile std::uint32_t& kept(int which) const {
        return shared.kept[threadIdx.x / 32][which][threadIdx.x % 32];
    }
    /// Where a column of this lane's particle of the coming chunk is brought.
    __device__ __forceinline__ float* brought(int column) const {
        return &shared.brought[threadIdx.x / 32][column][threadIdx.x % 32];
    }

    /// Goes to chunk `turn`, if there is one, and has this lane's particle brought.
    __device__ __forceinline__ void next(unsigned turn) const {
        const unsigned lane = threadIdx.x % 32;
        Walk w = walk();
        w.first += w.size;
        w.rank += chunk_ranks;
        while (w.rank >= w.most) {
            if (++w.group == 2 * H) {
                if (lane == 0) walk().group = w.group;
                __syncwarp();
                return;
            }
            const CellPlaces& places = shared.places[w.group / 2];
            w.most = __reduce_max_sync(~0u, places.count[w.group % 2 * warp_cells + lane]);
            if (w.group % 2 == 0) w.first = places.begin;
            w.rank = 0;
        }
        const CellPlaces& places = shared.places[w.group / 2];
        w.size =
            __reduce_add_sync(~0u, of_chunk(places.count[w.group % 2 * warp_cells + lane], w.rank));
        const std::uint32_t at = lane_in_chunk(turn);
        if (at < w.size) {
            const std::uint32_t q = w.first + at;
            // Four bytes are the least that come in one go.
            bring(reinterpret_cast<const float*>(pass.body.cell + q / 4 * 4), brought(0));
            MPM_UNROLL for (int a = 0; a < 3; ++a) bring(pass.body.offset[a] + q, brought(1 + a));
            MPM_UNROLL for (int r = 0; r < R; ++r) bring(pass.body.state[r] + q, brought(4 + r));
        }
        if (lane == 0) walk() = w;
        __syncwarp();
    }
    /// What has come of this lane's particle.
    __device__ __forceinline__ Particle take(unsigned turn) const {
        wait_for_brought();
        Particle p;
        const Walk& w = walk();
        const std::uint32_t at = lane_in_chunk(turn);
        const std::uint32_t q = w.first + at;
        const std::uint8_t byte = reinterpret_cast<const std::uint8_t*>(brought(0))[q % 4];
        const HomePlace home =
            shared.homes[w.group / 2][home_cell_of(byte)].of_rank(chunk_rank_of(byte));
        p.is = at < w.size;
        p.origin = home.in_lines();
        kept(0) = q;
        kept(1) = home.bits;
        MPM_UNROLL for (int a = 0; a < 3; ++a) p.xi[a] = *brought(1 + a);
        MPM_UNROLL for (int r = 0; r < R; ++r) p.state[r] = *brought(4 + r);
        __syncwarp();
        return p;
    }
    /// Moves a particle, and leaves what it deposits in the ring.
    __device__ __forceinline__ void move(unsigned turn, Particle& p, Stray& stray) const {
        auto& xi = p.xi;
        auto& state = p.state;
        const StepNumbers<float, Material> step{
            numbers.move,
            numbers.rate,
            numbers.impulse,
            constants,
            {numbers.ratio, pass.carry ? 1.0f : 0.0f, pass.stress_only}};
        const auto u = advance_from<Material, S>(shared.lines, p.origin, xi, state, step);
        const std::uint32_t q = kept(0);
        store(pass.body, q, xi, state);
        Largest<float> size;
        size.template see<3, C>(u);
        Record<C> record;
        // As `settle` has it.
        float shift[3];
        MPM_UNROLL for (int a = 0; a < 3; ++a) {
            shift[a] = float(xi[a] > 0.5f) - float(xi[a] < -0.5f);
            record.local[a] = xi[a] - shift[a];
        }
        const float moved = shift[0] * float(Sums::stride(0)) + shift[1] * float(Sums::stride(1)) +
                            shift[2] * float(Sums::stride(2));
        const HomePlace home{kept(1)};
        stray.code = home.in_sums() + int(moved);
        stray.is = moved != 0;
        record.tag = moved != 0 ? 0.0f : 1.0f;
        const auto d = deposit_of(quadratic_weights<float, 3>(record.local), u);
        MPM_UNROLL for (int c = 0; c < C; ++c) {
            record.centre[c] = d.centre[c];
            MPM_UNROLL for (int a = 0; a < 3; ++a) record.slope[a][c] = d.slope[a][c];
        }
        if (sound<Material>(xi, state)) {
            see(size);
        } else {
            Cuda::keep_smallest(pass.fault_particle, fault_number(pass.body_number, q));
            record = {};
            stray.is = false;
        }
        stray.row = int(turn % 2 * chunk_ranks + home.rank()) * Shared::pitch + home.column();
        wait_for_room(turn);
        record.put(shared.row(stray.row), warp_cells);
    }
    /// Until the rows that a turn writes to have been added.
    __device__ __forceinline__ void wait_for_room(unsigned turn) const {
        // Of a barrier that nobody has come to yet the phase before it is over.
        await(shared.empty + turn % 2, turn / 2 % 2 ^ 1);
    }
    __device__ __forceinline__ void see(const Largest<float>& size) const {
        Largest<float>& most = shared.largest;
        if (size.momentum > most.momentum || size.group > most.group) {
            atomicMax(&most.momentum, size.momentum);
            atomicMax(&most.group, size.group);
        }
    }

    __device__ __forceinline__ Piece* list(int piece) const {
        return shared.list[threadIdx.x / 32][piece];
    }
    /// The list to the sums. There is one place that does, so that no particle's bits depend on
    /// when.
    __device__ __forceinline__ void add_list(int listed) const {
        const int k = threadIdx.x % 32;
        if (k >= listed) return;
        const Scales<float, 3> scales(pass);
        Record<C> record;
        record.get(list(0) + k, Shared::room);
        Affine<float, 3, C> u;
        MPM_UNROLL for (int c = 0; c < C; ++c) {
            u.value[c] = record.centre[c];
            MPM_UNROLL for (int a = 0; a < 3; ++a) u.slope[a][c] = record.slope[a][c];
        }
        u = to_mass_scale(u, scales);
        IntoSums<H, C> sums{shared.sums.at + __float_as_int(record.tag)};
        detail::spread<0, true, float, 3, C>(sums, quadratic_weights<float, 3>(record.local),
                                             scales.mass, u.value, u.slope, 0);
    }
    /// Particles that have left their cells, from their rows to the list.
    __device__ __forceinline__ void keep_strays(Stray stray, bool last) const {
        unsigned waiting = __ballot_sync(~0u, stray.is);
        if (waiting == 0 && !last) return;
        int listed = walk().listed;
        if (waiting && threadIdx.x % 32 == 0) atomicAdd(&shared.strayed, __popc(waiting));
#pragma unroll 1
        while (waiting || (last && listed > 0)) {
            const int to = listed + __popc(waiting & ((1u << threadIdx.x % 32) - 1));
            if (stray.is && to < Shared::room) {
                const Piece* const row = shared.row(stray.row);
                Piece piece = row[0];
                piece.e[3] = __int_as_float(stray.code);
                list(0)[to] = piece;
                MPM_UNROLL for (int k = 1; k < Record<C>::pieces; ++k) list(k)[to] =
                    row[k * warp_cells];
                stray.is = false;
            }
            listed = min(Shared::room, listed + __popc(waiting));
            waiting = __ballot_sync(~0u, stray.is);
            if (waiting == 0 && !last) break;
            __syncwarp();
            add_list(listed);
            listed = 0;
            __syncwarp();
        }
        if (threadIdx.x % 32 == 0) walk().listed = listed;
        __syncwarp();
    }

    __device__ __forceinline__ void run() const {
        if (threadIdx.x % 32 == 0) walk() = {0, 0, ~0u, 0, 0, 0};
        __syncwarp();
        next(0);
#pragma unroll 1
        for (unsigned turn = 0;; ++turn) {
            const bool last = walk().group == 2 * H;
            Stray stray;
            if (!last) {
                Particle particle = take(turn);
                next(turn + 1);
                if (particle.is)
                    move(turn, particle, stray);
                else
                    wait_for_room(turn);
            }
            // Before its row is given up.
            keep_strays(stray, last);
            if (last) return;
            __syncwarp();
            say_full(turn);
        }
    }
};

/// What the warps that add do: each a plane of the stencils of 32 cells.
template <int H, int C, int R>
__device__ __forceinline__ void add_rows(const Pass<Cuda, float, 3>& pass,
                                         SplitShared<H, C, R>& shared) {
    using Shared = SplitShared<H, C, R>;
    using Sums = SplitSums<H, C>;
    const int lane = threadIdx.x % 32, plane = int(threadIdx.x) / 32 - movers;
    // The weight of the plane, as `quadratic_weights` has it.
    const float side = float(plane - 1), p0 = plane == 1 ? 0.75f : 0.125f, p1 = 0.5f * side,
                p2 = plane == 1 ? -1.0f : 0.5f;
    std::uint32_t turn = 0;
#pragma unroll 1
    for (int group = 0; group < 2 * H; ++group) {
        const CellPlaces& places = shared.places[group / 2];
        const int place = group % 2 * warp_cells + lane;
        const std::uint32_t count = places.count[place], most = __reduce_max_sync(~0u, count);
        PlaneSums<C> sums;
        MPM_UNROLL for (int n = 0; n < 9; ++n) MPM_UNROLL for (int c = 0; c <= C; ++c)
            sums.value[n][c] = 0;
#pragma unroll 1
        for (std::uint32_t first = 0; first < most; first += chunk_ranks, ++turn) {
            await_full(turn);
            const std::uint32_t own = of_chunk(count, first);
            const Piece* row = &shared.ring[turn % 2][0][lane];
#pragma unroll 1
            for (std::uint32_t r = 0; __any_sync(~0u, r < own); ++r, row += Shared::pitch) {
                if (r >= own) continue;
                Record<C> record;
                record.get(row, warp_cells);
                const float x = record.local[0], share = record.tag * (p0 + x * (p1 + x * p2));
                MPM_UNROLL for (int c = 0; c < C; ++c) record.centre[c] =
                    record.centre[c] + side * record.slope[0][c];
                detail::spread<1, false, float, 3, C>(sums,
                                                      quadratic_weights<float, 3>(record.local),
                                                      share, record.centre, record.slope, 0);
            }
            arrive(shared.empty + turn % 2);
        }
        if (count == 0) continue;
        const Scales<float, 3> scales(pass);
        int cell[3];
        Block<3>::coordinates(places.cell_at[place], cell);
        cell[0] += group / 2 * Block<3>::edge;
        std::int32_t* to = shared.sums.at + stencil_origin<Sums, 3>(cell) + plane * Sums::stride(0);
        MPM_UNROLL for (int n = 0; n < 9; ++n) MPM_UNROLL for (int c = 0; c <= C; ++c)
            atomicAdd(to + c * Sums::nodes + n / 3 * Sums::stride(1) + n % 3,
                      to_fixed(sums.value[n][c] * scales.template of<C>(c)));
    }
}

/// By 64 threads a home, each one cell: all reads at once.
template <int H, int C, int R>
__device__ __forceinline__ void place_homes(SplitShared<H, C, R>& shared,
                                            const BodyView<float, 3>& body,
                                            const std::int32_t (&slot)[H]) {
    const int h = threadIdx.x / block_cells, c = threadIdx.x % block_cells;
    if (h >= H) return;
    const std::int32_t own = H == 1 || h == 0 ? slot[0] : slot[H - 1];
    CellPlaces& places = shared.places[h];
    const int place =
        places.find(own < 0 ? nullptr : body.cell_start + std::int64_t(own) * block_cells, c);
    int cell[3];
    Block<3>::coordinates(c, cell);
    cell[0] += h * Block<3>::edge;
    shared.homes[h][c] =
        HomePlace::of(stencil_origin<SplitLines<H>, 3>(cell),
                      stencil_origin<SplitSums<H, C>, 3>(cell), place % warp_cells);
}

template <class Material, Smoothing S, int H>
__global__ void __launch_bounds__(split_threads, split_blocks)
    split_step(const __grid_constant__ Pass<Cuda, float, 3> pass,
               const __grid_constant__ typename Material::template Constants<float> constants) {
    constexpr int C = transfer_channels<3, S>, R = state_reals<Material, 3, S>;
    extern __shared__ __align__(16) unsigned char memory[];
    SplitShared<H, C, R>& shared = *reinterpret_cast<SplitShared<H, C, R>*>(memory);
    __shared__ MoverNumbers numbers;

    after_previous();
    const bool halted = pass.clock->halt != Halt::none;
    const int warp = threadIdx.x / 32;
    std::int32_t slot[H];
    MPM_UNROLL for (int h = 0; h < H; ++h) slot[h] =
        H == 1 ? pass.body.home[blockIdx.x] : pass.body.pair[H * blockIdx.x + h];
    place_homes(shared, pass.body, slot);
    if (threadIdx.x == split_threads - 1) {
        for (std::uint64_t& barrier : shared.empty) begin_barrier(&barrier, adders);
        shared.strayed = 0;
        shared.largest = {};
        const auto n =
            step_numbers<float, Material>(*pass.numbers, constants, pass.carry, pass.stress_only);
        numbers = {n.move, n.rate, n.impulse, n.smoothing.ratio};
    }
    fill_lines<H, C>(pass, slot, shared.lines);
    int4* const sums = reinterpret_cast<int4*>(shared.sums.at);
    for (int k = threadIdx.x; k < int(sizeof shared.sums.at / sizeof(int4)); k += split_threads)
        sums[k] = int4{};
    if (halted) return;
    __syncthreads();
    if (warp < movers)
        Mover<Material, S, H>{pass, constants, numbers, shared}.run();
    else
        add_rows(pass, shared);
    __syncthreads();
    if (warp == 0) {
        Largest<float> largest = shared.largest;
        largest.listen(pass);
        largest.tell(pass);
        if (threadIdx.x == 0 && shared.strayed > 0) count_strays(pass, shared.strayed);
    }
    flush_sums<H, C>(pass, slot, shared.sums);
    end_pass(pass);
}

template <class Material, Smoothing S>
void run_split(const Pass<Cuda, float, 3>& pass) {
    constexpr int C = transfer_channels<3, S>, R = state_reals<Material, 3, S>;
    static_assert(sizeof(SplitShared<2, C, R>) <= SplitShared<2, C, R>::bytes);
    const auto constants = Material::template constants<float>(pass.parameters);
    if (pass.body.pairs > 0)
        pass.exec->launch_large(int(sizeof(SplitShared<2, C, R>)), &split_step<Material, S, 2>,
                                pass.body.pairs, split_threads, pass, constants);
    else
        pass.exec->launch_large(int(sizeof(SplitShared<1, C, R>)), &split_step<Material, S, 1>,
                                pass.body.full_homes, split_threads, pass, constants);
}

}  // namespace mpm::cuda
