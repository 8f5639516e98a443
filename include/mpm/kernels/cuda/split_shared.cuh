// What a block of threads of the fused step keeps in shared memory whose warps share the work
// (kernels/cuda/split.cuh): lines of nodes, sums, the ring between those that move particles and
// those that add, lists of strays, and the barriers at which they wait for each other.
#pragma once

#include "mpm/kernels/cuda/arena.cuh"
#include "mpm/kernels/cuda/chunks.cuh"

namespace mpm::cuda {

/// Warps of a block of threads that move; every one of them takes part in every chunk.
inline constexpr int movers = int(chunk_ranks);

/// Sizes of a step whose warps share the work: homes of a block of threads, transfer channels, and
/// numbers of a particle, the last three its velocity where the scheme keeps one
/// (kernels/keep.hpp).
template <int Homes, int Channels, int Reals, bool Keeps>
struct SplitSizes {
    static constexpr int H = Homes, C = Channels, R = Reals;
    static constexpr bool keeps = Keeps;
    static constexpr int sums = C + (keeps ? 3 : 0);  // beside that of the mass
    /// Warps that add: one a plane; two where momentum without stress is added as well, so that
    /// each has 36 sums.
    static constexpr int adders = keeps ? 6 : 3;
    static constexpr int threads = 32 * (movers + adders);
    static constexpr int blocks = keeps ? 2 : 3;  // of threads on a multiprocessor
};

struct alignas(16) Piece {
    float e[4];
};

/// As `LineArena`, for H homes along x. Four lanes that follow each other read the same nodes, so
/// that its strides need not keep lanes apart.
template <int H>
struct SplitLines {
    using Number = float;
    static constexpr int edge_x = H * Block<3>::edge + 2 * Block<3>::margin,
                         edge = Block<3>::arena_edge, cells = Block<3>::edge + 2;
    MPM_INLINE static constexpr int stride(int axis) {
        return axis == 2 ? 3 : (axis == 1 ? 3 * cells : 3 * cells * edge);
    }
    Piece at[edge_x * stride(0)];

    template <int N>
    MPM_INLINE Line<float, N> load(int place) const {
        return line_from<N, float>(at + place);
    }
};

/// Places of nodes about H homes along x.
template <int H>
struct SplitPlaces {
    static constexpr int edge_x = SplitLines<H>::edge_x, edge = Block<3>::arena_edge,
                         nodes = edge_x * 68;
    MPM_INLINE static constexpr int stride(int axis) {
        return axis == 2 ? 1 : (axis == 1 ? edge : 68);
    }
};
/// As `SumArena`.
template <int H, int sums>
struct SplitSums : SplitPlaces<H> {
    alignas(16) std::int32_t at[(sums + 1) * SplitPlaces<H>::nodes];
};
/// As `KeptArena`: what a scheme that keeps a velocity reads of nodes beside the lines.
template <int H>
struct KeptNodes {
    struct Nodes : SplitPlaces<H> {
        Piece at[SplitPlaces<H>::nodes];
        MPM_INLINE Piece load(int place) const { return at[place]; }
    };
    Nodes nodes;
};
struct NoNodes {};

/// What one particle deposits, about the centre of its cell.
template <int C>
struct Record {
    static_assert(C <= 4);
    static constexpr int pieces = 5;
    Vec<float, 3> local;
    float tag;  // in a row its weight, 0 of who is elsewhere; in a list where its cell begins
    float centre[C];
    float slope[3][C];

    __device__ __forceinline__ void put(Piece* to, int stride) const {
        to[0] = {{local[0], local[1], local[2], tag}};
        Piece piece{};
        MPM_UNROLL for (int c = 0; c < C; ++c) piece.e[c] = centre[c];
        to[stride] = piece;
        MPM_UNROLL for (int a = 0; a < 3; ++a) {
            MPM_UNROLL for (int c = 0; c < C; ++c) piece.e[c] = slope[a][c];
            to[(2 + a) * stride] = piece;
        }
    }
    __device__ __forceinline__ void set(const Deposit<float, 3, C>& d) {
        MPM_UNROLL for (int c = 0; c < C; ++c) {
            centre[c] = d.centre[c];
            MPM_UNROLL for (int a = 0; a < 3; ++a) slope[a][c] = d.slope[a][c];
        }
    }
    __device__ __forceinline__ void get_place(const Piece* from) {
        const Piece piece = from[0];
        MPM_UNROLL for (int a = 0; a < 3; ++a) local[a] = piece.e[a];
        tag = piece.e[3];
    }
    __device__ __forceinline__ void get(const Piece* from, int stride) {
        get_place(from);
        Piece piece = from[stride];
        MPM_UNROLL for (int c = 0; c < C; ++c) centre[c] = piece.e[c];
        MPM_UNROLL for (int a = 0; a < 3; ++a) {
            piece = from[(2 + a) * stride];
            MPM_UNROLL for (int c = 0; c < C; ++c) slope[a][c] = piece.e[c];
        }
    }
};

/// What a particle deposits of momentum without stress, in the pieces behind those of its record.
struct PlainPieces {
    static constexpr int pieces = 3;
    __device__ __forceinline__ static void put(Piece* to, int stride,
                                               const Deposit<float, 3, 3>& d) {
        float e[4 * pieces];
        MPM_UNROLL for (int c = 0; c < 3; ++c) {
            e[c] = d.centre[c];
            MPM_UNROLL for (int a = 0; a < 3; ++a) e[3 + 3 * a + c] = d.slope[a][c];
        }
        MPM_UNROLL for (int k = 0; k < pieces; ++k)
            to[k * stride] = {{e[4 * k], e[4 * k + 1], e[4 * k + 2], e[4 * k + 3]}};
    }
    __device__ __forceinline__ static void get(const Piece* from, int stride, float (&centre)[3],
                                               float (&slope)[3][3]) {
        float e[4 * pieces];
        MPM_UNROLL for (int k = 0; k < pieces; ++k) {
            const Piece piece = from[k * stride];
            MPM_UNROLL for (int i = 0; i < 4; ++i) e[4 * k + i] = piece.e[i];
        }
        MPM_UNROLL for (int c = 0; c < 3; ++c) {
            centre[c] = e[c];
            MPM_UNROLL for (int a = 0; a < 3; ++a) slope[a][c] = e[3 + 3 * a + c];
        }
    }
};

/// What moving needs of the step, in shared memory: registers are dearer than reading it anew.
struct alignas(16) MoverNumbers {
    float move, rate, impulse, ratio;
};

/// Where the stencil of a home cell begins in the lines and in the sums, its column in a row, and
/// which rank of its chunk a particle has.
struct HomePlace {
    std::uint32_t bits;
    __device__ static HomePlace of(int in_lines, int in_sums, int column) {
        return {std::uint32_t(in_lines) | std::uint32_t(in_sums) << 12 |
                std::uint32_t(column) << 24};
    }
    __device__ __forceinline__ HomePlace of_rank(int rank) const {
        return {bits | std::uint32_t(rank) << 29};
    }
    __device__ __forceinline__ int in_lines() const { return int(bits & 0xfff); }
    __device__ __forceinline__ int in_sums() const { return int(bits >> 12 & 0xfff); }
    __device__ __forceinline__ int column() const { return int(bits >> 24 & 31); }
    __device__ __forceinline__ unsigned rank() const { return bits >> 29; }
};

/// What a warp that moves keeps of where it is: the same for all its lanes, and there is no
/// register to spare for it.
struct alignas(16) Walk {
    std::uint32_t first, size;  // of the chunk's particles
    std::uint32_t group;        // of 32 cells
    std::uint32_t rank, most;   // the chunk's first; of the group
    int listed;                 // strays
};

template <class S>
struct SplitShared : std::conditional_t<S::keeps, KeptNodes<S::H>, NoNodes> {
    using Sizes = S;
    static constexpr int H = Sizes::H;
    using Lines = SplitLines<H>;
    using Sums = SplitSums<H, Sizes::sums>;
    using Nodes = std::conditional_t<Sizes::keeps, KeptNodes<H>, NoNodes>;
    /// Pieces of a record.
    static constexpr int pieces =
        Record<Sizes::C>::pieces + (Sizes::keeps ? PlainPieces::pieces : 0);
    /// Pieces from one row to the next: two neighbouring cells of four ranks, which eight lanes
    /// write at a time, meet in no bank.
    static constexpr int pitch = pieces * warp_cells + 2;
    /// What is brought of a particle: the word with its home byte, its place, its state.
    static constexpr int columns = 4 + Sizes::R;
    /// Of a list: what is left of a block's share of a multiprocessor's memory.
    static constexpr int bytes = 228 * 1024 / Sizes::blocks - 1024 - int(sizeof(MoverNumbers)) - 64;
    static constexpr int others =
        int(sizeof(Lines) + sizeof(Sums) + (Sizes::keeps ? sizeof(Nodes) : 0)) +
        int(2 * chunk_ranks * pitch * sizeof(Piece)) +
        movers * ((columns + 2) * warp_cells * 4 + int(sizeof(Walk))) +
        H * int(sizeof(CellPlaces) + block_cells * sizeof(HomePlace)) + 64;
    static constexpr int left = (bytes - others) / (movers * pieces * int(sizeof(Piece)));
    static constexpr bool fits = left >= 4;
    static constexpr int room = !fits ? 4 : (left < 32 ? left : 32);

    Lines lines;
    Sums sums;
    Piece ring[2][chunk_ranks][pitch];
    Piece list[movers][pieces][room];
    float brought[movers][columns][warp_cells];
    std::uint32_t kept[movers][2][warp_cells];
    std::uint64_t empty[2];  // barriers of the ring's two chunks
    Walk walk[movers];
    int strayed;
    alignas(8) Largest<float> largest;
    CellPlaces places[H];
    HomePlace homes[H][block_cells];

    __device__ __forceinline__ Piece* row(int place) { return &ring[0][0][0] + place; }
};

// Barriers in shared memory, of which a phase ends when so many have arrived. Waiting tells two
// phases apart, so nobody may be two turns of the ring ahead: every mover takes part in every
// chunk.
__device__ __forceinline__ std::uint32_t in_shared(const void* p) {
    return std::uint32_t(__cvta_generic_to_shared(p));
}
__device__ __forceinline__ void begin_barrier(std::uint64_t* at, int count) {
    asm volatile("mbarrier.init.shared.b64 [%0], %1;" ::"r"(in_shared(at)), "r"(count) : "memory");
}
/// What the warp's lanes have done before is seen by who waits.
__device__ __forceinline__ void arrive(std::uint64_t* at) {
    __syncwarp();
    [[maybe_unused]] std::uint64_t state;
    if (threadIdx.x % 32 == 0)
        asm volatile("mbarrier.arrive.shared.b64 %0, [%1];"
                     : "=l"(state)
                     : "r"(in_shared(at))
                     : "memory");
}
__device__ __forceinline__ void await(std::uint64_t* at, std::uint32_t parity) {
    // Sleeps until then, or for so many nanoseconds.
#if __CUDA_ARCH__ >= 900
    asm volatile(
        "{\n"
        ".reg .pred is;\n"
        "again_%=:\n"
        "mbarrier.try_wait.parity.shared::cta.b64 is, [%0], %1, %2;\n"
        "@!is bra again_%=;\n"
        "}" ::"r"(in_shared(at)),
        "r"(parity), "r"(1000000)
        : "memory");
#else
    asm volatile(
        "{\n"
        ".reg .pred is;\n"
        "again_%=:\n"
        "mbarrier.test_wait.parity.shared.b64 is, [%0], %1;\n"
        "@!is bra again_%=;\n"
        "}" ::"r"(in_shared(at)),
        "r"(parity)
        : "memory");
#endif
}

/// Rows are full: movers say so and go on, adders wait for it. Such a wait takes no instructions,
/// but all who wait go on together, so that it is for those alone who have as much to do.
template <int threads>
__device__ __forceinline__ void say_full(unsigned turn) {
    if (turn % 2 == 0)
        asm volatile("bar.arrive 1, %0;" ::"n"(threads) : "memory");
    else
        asm volatile("bar.arrive 2, %0;" ::"n"(threads) : "memory");
}
template <int threads>
__device__ __forceinline__ void await_full(unsigned turn) {
    if (turn % 2 == 0)
        asm volatile("bar.sync 1, %0;" ::"n"(threads) : "memory");
    else
        asm volatile("bar.sync 2, %0;" ::"n"(threads) : "memory");
}

/// A number from the grid's memory to this block's, on its way until `wait_for_brought`.
__device__ __forceinline__ void bring(const float* from, float* to) {
    asm volatile("cp.async.ca.shared.global [%0], [%1], 4;" ::"r"(in_shared(to)), "l"(from)
                 : "memory");
}
__device__ __forceinline__ void wait_for_brought() {
    asm volatile("cp.async.wait_all;" ::: "memory");
}

/// The blocks that the nodes of a column of blocks are in, counted from the one before the first
/// home: those of its neighbours along y and z, ascending; null where no home reaches.
template <int H>
__device__ __forceinline__ const std::int32_t* column_of(const BlockTableView<3>& table,
                                                         const std::int32_t (&slot)[H],
                                                         int column) {
    if (H == 1 || (slot[0] >= 0 && column <= 2)) return neighbours_of(table, slot[0]) + 9 * column;
    if (slot[H - 1] >= 0 && column >= 1)
        return neighbours_of(table, slot[H - 1]) + 9 * (column - 1);
    return nullptr;
}

/// The nodes about a block's homes to its lines; `also(place, from)` may read more of a node, whose
/// place is that of `SplitPlaces` and whose numbers begin at `from`.
template <class Sizes, class P, class Also = NothingElse>
__device__ __forceinline__ void fill_lines(const P& pass, const std::int32_t (&slot)[Sizes::H],
                                           SplitLines<Sizes::H>& lines, const Also& also = {}) {
    constexpr int H = Sizes::H, C = Sizes::C, threads = Sizes::threads;
    using Lines = SplitLines<H>;
    using Places = SplitPlaces<H>;
    constexpr int edge = Block<3>::edge, margin = Block<3>::margin, parts = 2,
                  cells = Lines::cells / parts;
    const auto& g = pass.grid;
    // Those that place homes come last.
    const int first = (threadIdx.x + threads - H * block_cells) % threads;
    for (int t = first; t < Lines::edge_x * Lines::edge * parts; t += threads) {
        const int part = t % parts, y = t / parts % Lines::edge, x = t / (parts * Lines::edge);
        const int nx = x - margin + edge, ny = y - margin + edge;
        const std::int32_t* column = column_of<H>(g.table, slot, nx / edge);
        if (column == nullptr) continue;
        column += ny / edge * 3;
        const int first_node = (nx % edge * edge + ny % edge) * edge;
        const auto from = [&](int k) {
            const int nz = part * cells + k - margin + edge;
            return g.velocity + g.velocity_place(column[nz / edge], first_node + nz % edge);
        };
        float u[cells + 2][C];
        MPM_UNROLL for (int k = 0; k < cells + 2; ++k)
            load_node<C, P, float, Sizes::keeps>(pass, from(k), u[k]);
        // Two nodes belong to both parts.
        MPM_UNROLL for (int k = 0; k <= cells; ++k) also(
            x * Places::stride(0) + y * Places::stride(1) + part * (cells + 1) + k, from(k + part));
        Piece* to = lines.at + x * Lines::stride(0) + y * Lines::stride(1) +
                    part * cells * Lines::stride(2);
        MPM_UNROLL for (int k = 0; k < cells; ++k)
            expand_into(to + 3 * k, u[k], u[k + 1], u[k + 2]);
    }
}

/// As `flush`: a thread takes a row of nodes along y.
template <class Sizes, class P, class ChannelOf>
__device__ __forceinline__ void flush_sums(const P& pass, const std::int32_t (&slot)[Sizes::H],
                                           const SplitSums<Sizes::H, Sizes::sums>& sums,
                                           const ChannelOf& channel_of) {
    using Sums = SplitPlaces<Sizes::H>;
    constexpr int edge = Block<3>::edge, margin = Block<3>::margin,
                  rows = Sums::edge_x * Sums::edge, parts = Sizes::threads / rows;
    static_assert(parts > 0);
    const int part = threadIdx.x / rows, row = threadIdx.x % rows;
    if (part >= parts) return;
    const int z = row % Sums::edge, x = row / Sums::edge;
    const int nx = x - margin + edge, nz = z - margin + edge;
    const std::int32_t* column = column_of<Sizes::H>(pass.grid.table, slot, nx / edge);
    if (column == nullptr) return;
    column += nz / edge;
    const std::int64_t stride = std::int64_t(pass.grid.sum_channels) * block_cells;
    std::int32_t* side[3];
    MPM_UNROLL for (int k = 0; k < 3; ++k) side[k] =
        pass.grid.sums + column[3 * k] * stride + nx % edge * (edge * edge) + nz % edge;
    const unsigned mine = every(parts, part);
    MPM_UNROLL for (int k = 0; k < Sums::edge; ++k) {
        if (!(mine >> k & 1)) continue;
        const int ny = k - margin + edge;
        const std::int32_t* from = sums.at + x * Sums::stride(0) + k * Sums::stride(1) + z;
        std::int32_t* to = side[ny / edge] + ny % edge * edge;
        flush_node<Sizes::sums>(pass, from, Sums::nodes, to, channel_of);
    }
}

}  // namespace mpm::cuda
