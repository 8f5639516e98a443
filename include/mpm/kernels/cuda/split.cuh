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
// Schemes that store a velocity (kernels/keep.hpp) add momentum without stress: a second warp a
// plane holds those sums and the mass.
//
// A particle that has left its cell has weight 0 in its row and goes to a list of the warp that
// moved it, which adds it to the sums as integers, a lane a particle, when the list is full and at
// the end. Sums of a cell are added in the order of ranks, whoever shares its block: no schedule
// and no neighbour changes a bit.
#pragma once

#include "mpm/kernels/cuda/keep.cuh"
#include "mpm/kernels/cuda/split_adders.cuh"

namespace mpm::cuda {

/// What a step is told of a scheme that stores no velocity.
struct NothingKept {};

template <class Material, Smoothing S, int H, class Keep>
using SizesOf = SplitSizes<H, transfer_channels<3, S>,
                           state_reals<Material, 3, S> + (std::is_empty_v<Keep> ? 0 : 3),
                           !std::is_empty_v<Keep>>;

/// Takes the deposit of one particle straight into the sums of a block.
template <class Sizes>
struct IntoSums {
    using Sums = SplitPlaces<Sizes::H>;
    std::int32_t* at;  // lowest node of the stencil
    __device__ __forceinline__ void add(int node, int channel, float v) {
        atomicAdd(at + channel * Sums::nodes + stencil_place<Sums, 3>(node), to_fixed(v));
    }
    __device__ __forceinline__ void add_mass(int node, float v) { add(node, Sizes::sums, v); }
};

/// What the warps that move do.
template <class Material, Smoothing S, int H, class Keep>
struct Mover {
    using Sizes = SizesOf<Material, S, H, Keep>;
    static constexpr int C = Sizes::C, R = Sizes::R;
    using Shared = SplitShared<Sizes>;
    using Sums = SplitPlaces<H>;
    using Constants = typename Material::template Constants<float>;

    const Pass<Cuda, float, 3>& pass;
    const Constants& constants;
    const Keep& keep;
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
        __syncwarp();  // before one lane writes it
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
        const HomePlace home{kept(1)};
        const auto u = advance(p, home, step);
        const std::uint32_t q = kept(0);
        store(pass.body, q, xi, state);
        Largest<float> size;
        Record<C> record;
        // As `settle` has it.
        float shift[3];
        MPM_UNROLL for (int a = 0; a < 3; ++a) {
            shift[a] = float(xi[a] > 0.5f) - float(xi[a] < -0.5f);
            record.local[a] = xi[a] - shift[a];
        }
        const float moved = shift[0] * float(Sums::stride(0)) + shift[1] * float(Sums::stride(1)) +
                            shift[2] * float(Sums::stride(2));
        stray.code = home.in_sums() + int(moved);
        stray.is = moved != 0;
        record.tag = moved != 0 ? 0.0f : 1.0f;
        const auto w = quadratic_weights<float, 3>(record.local);
        const auto transferred = part_of<0, C>(u);
        size.template see<3, C>(transferred);
        record.set(deposit_of(w, transferred));
        Deposit<float, 3, 3> plain;
        if constexpr (Sizes::keeps) {
            const auto kept_part = part_of<C, 3>(u);
            // Of what is not a number here `transferred` is none either.
            size.see_momentum(deposit_size<0, 3, true>(kept_part));
            plain = deposit_of(w, kept_part);
        }
        if (sound<Material>(xi, state)) {
            see(size);
            if constexpr (Sizes::keeps) {
                if (strays_far(xi)) call_for_sort(pass);
            }
        } else {
            Cuda::keep_smallest(pass.fault_particle, fault_number(pass.body_number, q));
            record = {};
            plain = {};
            stray.is = false;
        }
        stray.row = int(turn % 2 * chunk_ranks + home.rank()) * Shared::pitch + home.column();
        wait_for_room(turn);
        Piece* const row = shared.row(stray.row);
        record.put(row, warp_cells);
        if constexpr (Sizes::keeps)
            PlainPieces::put(row + Record<C>::pieces * warp_cells, warp_cells, plain);
    }
    __device__ __forceinline__ auto advance(Particle& p, HomePlace home,
                                            const StepNumbers<float, Material>& step) const {
        if constexpr (Sizes::keeps)
            return advance_keeping_from<Material, S, float, 3>(
                shared.lines, p.origin, shared.nodes, home.in_sums(), p.xi, p.state, step, keep);
        else
            return advance_from<Material, S>(shared.lines, p.origin, p.xi, p.state, step);
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
        float centre[Sizes::sums], slope[3][Sizes::sums];
        MPM_UNROLL for (int c = 0; c < C; ++c) {
            centre[c] = record.centre[c];
            MPM_UNROLL for (int a = 0; a < 3; ++a) slope[a][c] = record.slope[a][c];
        }
        if constexpr (Sizes::keeps) {
            float plain[3], tilt[3][3];
            PlainPieces::get(list(Record<C>::pieces) + k, Shared::room, plain, tilt);
            MPM_UNROLL for (int c = 0; c < 3; ++c) {
                centre[C + c] = plain[c];
                MPM_UNROLL for (int a = 0; a < 3; ++a) slope[a][C + c] = tilt[a][c];
            }
        }
        // Products are rounded as such: see `scale_channel`.
        MPM_UNROLL for (int c = 0; c < Sizes::sums; ++c) {
            const float by = scale_of<Sizes>(scales, c) / scales.mass;
            centre[c] = __fmul_rn(centre[c], by);
            MPM_UNROLL for (int a = 0; a < 3; ++a) slope[a][c] = __fmul_rn(slope[a][c], by);
        }
        IntoSums<Sizes> sums{shared.sums.at + __float_as_int(record.tag)};
        detail::spread<0, true, float, 3, Sizes::sums>(
            sums, quadratic_weights<float, 3>(record.local), scales.mass, centre, slope, 0);
    }
    /// Particles that have left their cells, from their rows to the list.
    __device__ __forceinline__ void keep_strays(Stray stray, bool last) const {
        unsigned waiting = __ballot_sync(~0u, stray.is);
        if (waiting == 0 && !last) return;
        int listed = walk().listed;
        __syncwarp();
        if (waiting && threadIdx.x % 32 == 0) atomicAdd(&shared.strayed, __popc(waiting));
#pragma unroll 1
        while (waiting || (last && listed > 0)) {
            const int to = listed + __popc(waiting & ((1u << threadIdx.x % 32) - 1));
            if (stray.is && to < Shared::room) {
                const Piece* const row = shared.row(stray.row);
                Piece piece = row[0];
                piece.e[3] = __int_as_float(stray.code);
                list(0)[to] = piece;
                MPM_UNROLL for (int k = 1; k < Shared::pieces; ++k) list(k)[to] =
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
            say_full<Sizes::threads>(turn);
        }
    }
};

/// By 64 threads a home, each one cell: all reads at once.
template <class Sizes>
__device__ __forceinline__ void place_homes(SplitShared<Sizes>& shared,
                                            const BodyView<float, 3>& body,
                                            const std::int32_t (&slot)[Sizes::H]) {
    constexpr int H = Sizes::H;
    const int h = threadIdx.x / block_cells, c = threadIdx.x % block_cells;
    if (h >= H) return;
    const std::int32_t own = H == 1 || h == 0 ? slot[0] : slot[H - 1];
    CellPlaces& places = shared.places[h];
    const int place =
        places.find(own < 0 ? nullptr : body.cell_start + std::int64_t(own) * block_cells, c);
    int cell[3];
    Block<3>::coordinates(c, cell);
    cell[0] += h * Block<3>::edge;
    shared.homes[h][c] = HomePlace::of(stencil_origin<SplitLines<H>, 3>(cell),
                                       stencil_origin<SplitPlaces<H>, 3>(cell), place % warp_cells);
}

/// Has the nodes about a block's homes in shared memory.
template <class Sizes, class Keep>
__device__ __forceinline__ void fill_nodes(const Pass<Cuda, float, 3>& pass,
                                           const std::int32_t (&slot)[Sizes::H],
                                           SplitShared<Sizes>& shared, const Keep& keep) {
    if constexpr (Sizes::keeps) {
        const NodeReader read(pass, keep);
        fill_lines<Sizes>(pass, slot, shared.lines, [&](int place, const float* from) {
            float u[4];
            read(from, u);
            shared.nodes.at[place] = {{u[0], u[1], u[2], u[3]}};
        });
    } else {
        fill_lines<Sizes>(pass, slot, shared.lines);
    }
}

template <class Material, Smoothing S, int H, class Keep>
__global__ void __launch_bounds__((SizesOf<Material, S, H, Keep>::threads),
                                  (SizesOf<Material, S, H, Keep>::blocks))
    split_step(const __grid_constant__ Pass<Cuda, float, 3> pass,
               const __grid_constant__ typename Material::template Constants<float> constants,
               const __grid_constant__ Keep keep) {
    using Sizes = SizesOf<Material, S, H, Keep>;
    constexpr int threads = Sizes::threads;
    extern __shared__ __align__(16) unsigned char memory[];
    SplitShared<Sizes>& shared = *reinterpret_cast<SplitShared<Sizes>*>(memory);
    __shared__ MoverNumbers numbers;

    after_previous();
    const bool halted = pass.clock->halt != Halt::none;
    const int warp = threadIdx.x / 32;
    std::int32_t slot[H];
    MPM_UNROLL for (int h = 0; h < H; ++h) slot[h] =
        H == 1 ? pass.body.home[blockIdx.x] : pass.body.pair[H * blockIdx.x + h];
    place_homes(shared, pass.body, slot);
    if (threadIdx.x == threads - 1) {
        for (std::uint64_t& barrier : shared.empty) begin_barrier(&barrier, Sizes::adders);
        shared.strayed = 0;
        shared.largest = {};
        const auto n =
            step_numbers<float, Material>(*pass.numbers, constants, pass.carry, pass.stress_only);
        numbers = {n.move, n.rate, n.impulse, n.smoothing.ratio};
    }
    fill_nodes(pass, slot, shared, keep);
    int4* const sums = reinterpret_cast<int4*>(shared.sums.at);
    for (int k = threadIdx.x; k < int(sizeof shared.sums.at / sizeof(int4)); k += threads)
        sums[k] = int4{};
    if (halted) return;
    __syncthreads();
    if (warp < movers)
        Mover<Material, S, H, Keep>{pass, constants, keep, numbers, shared}.run();
    else
        add_as(pass, shared, warp - movers);
    __syncthreads();
    if (warp == 0) {
        Largest<float> largest = shared.largest;
        largest.listen(pass);
        largest.tell(pass);
        if (threadIdx.x == 0 && shared.strayed > 0) count_strays(pass, shared.strayed);
    }
    if constexpr (Sizes::keeps)
        flush_sums<Sizes>(pass, slot, shared.sums, sum_channels_of<Sizes::C>(pass, keep));
    else
        flush_sums<Sizes>(pass, slot, shared.sums, sum_channels_of(pass));
    end_pass(pass);
}

/// Laws with long states leave no room for two homes.
template <class Material, Smoothing S, class Keep>
inline constexpr bool pairs_fit = SplitShared<SizesOf<Material, S, 2, Keep>>::fits;

/// With `Keep` numbers of a scheme that stores a velocity, or nothing.
template <class Material, Smoothing S, class Keep>
void run_split_with(const Pass<Cuda, float, 3>& pass, const Keep& keep) {
    using One = SplitShared<SizesOf<Material, S, 1, Keep>>;
    using Two = SplitShared<SizesOf<Material, S, 2, Keep>>;
    static_assert(One::fits && sizeof(One) <= One::bytes);
    const auto constants = Material::template constants<float>(pass.parameters);
    if constexpr (Two::fits) {
        static_assert(sizeof(Two) <= Two::bytes);
        if (pass.body.pairs > 0) {
            pass.exec->launch_large(int(sizeof(Two)), &split_step<Material, S, 2, Keep>,
                                    pass.body.pairs, Two::Sizes::threads, pass, constants, keep);
            return;
        }
    }
    pass.exec->launch_large(int(sizeof(One)), &split_step<Material, S, 1, Keep>,
                            pass.body.full_homes, One::Sizes::threads, pass, constants, keep);
}
template <class Material, Smoothing S>
void run_split(const Pass<Cuda, float, 3>& pass) {
    run_split_with<Material, S>(pass, NothingKept{});
}
template <class Material, Smoothing S>
void run_split_keeping(const Phase<Cuda, float, 3>& phase) {
    run_split_with<Material, S>(phase.pass, keep_numbers<float>(phase.n));
}

}  // namespace mpm::cuda
