// What a block of threads of the fused step keeps in shared memory whose warps share the work
// (kernels/cuda/split.cuh): lines of nodes, sums, the ring between those that move particles and
// those that add, lists of strays, and the barriers at which they wait for each other.
#pragma once

#include "mpm/kernels/cuda/arena.cuh"
#include "mpm/kernels/cuda/chunks.cuh"

namespace mpm::cuda {

/// Warps of a block of threads; every one of the movers takes part in every chunk.
inline constexpr int movers = int(chunk_ranks), adders = 3;
inline constexpr int split_threads = 32 * (movers + adders);
/// Blocks of threads on a multiprocessor.
inline constexpr int split_blocks = 3;

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

/// As `SumArena`, for H homes along x.
template <int H, int C>
struct SplitSums {
    static constexpr int edge_x = SplitLines<H>::edge_x, edge = Block<3>::arena_edge,
                         nodes = edge_x * 68;
    MPM_INLINE static constexpr int stride(int axis) {
        return axis == 2 ? 1 : (axis == 1 ? edge : 68);
    }
    alignas(16) std::int32_t at[(C + 1) * nodes];
};

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
    __device__ __forceinline__ void get(const Piece* from, int stride) {
        Piece piece = from[0];
        MPM_UNROLL for (int a = 0; a < 3; ++a) local[a] = piece.e[a];
        tag = piece.e[3];
        piece = from[stride];
        MPM_UNROLL for (int c = 0; c < C; ++c) centre[c] = piece.e[c];
        MPM_UNROLL for (int a = 0; a < 3; ++a) {
            piece = from[(2 + a) * stride];
            MPM_UNROLL for (int c = 0; c < C; ++c) slope[a][c] = piece.e[c];
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

/// Of a law whose particles have R numbers.
template <int H, int C, int R>
struct SplitShared {
    using Sums = SplitSums<H, C>;
    /// Pieces from one row to the next: two neighbouring cells of four ranks, which eight lanes
    /// write at a time, meet in no bank.
    static constexpr int pitch = Record<C>::pieces * warp_cells + 2;
    /// What is brought of a particle: the word with its home byte, its place, its state.
    static constexpr int columns = 4 + R;
    /// Of a list: what is left of a third of a multiprocessor's memory.
    static constexpr int bytes = 228 * 1024 / split_blocks - 1024 - int(sizeof(MoverNumbers)) - 64;
    static constexpr int others =
        int(sizeof(SplitLines<H>) + sizeof(SplitSums<H, C>)) +
        int(2 * chunk_ranks * pitch * sizeof(Piece)) + movers * (columns + 2) * warp_cells * 4 +
        movers * int(sizeof(Walk)) + H * int(sizeof(CellPlaces) + block_cells * sizeof(HomePlace)) +
        64;
    static constexpr int left =
        (bytes - others) / (movers * Record<C>::pieces * int(sizeof(Piece)));
    static constexpr int room = left < 32 ? left : 32;
    static_assert(room >= 4);

    SplitLines<H> lines;
    Sums sums;
    Piece ring[2][chunk_ranks][pitch];
    Piece list[movers][Record<C>::pieces][room];
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
__device__ __forceinline__ void say_full(unsigned turn) {
    if (turn % 2 == 0)
        asm volatile("bar.arrive 1, %0;" ::"n"(split_threads) : "memory");
    else
        asm volatile("bar.arrive 2, %0;" ::"n"(split_threads) : "memory");
}
__device__ __forceinline__ void await_full(unsigned turn) {
    if (turn % 2 == 0)
        asm volatile("bar.sync 1, %0;" ::"n"(split_threads) : "memory");
    else
        asm volatile("bar.sync 2, %0;" ::"n"(split_threads) : "memory");
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

template <int H, int C, class P>
__device__ __forceinline__ void fill_lines(const P& pass, const std::int32_t (&slot)[H],
                                           SplitLines<H>& lines) {
    using Lines = SplitLines<H>;
    constexpr int edge = Block<3>::edge, margin = Block<3>::margin, parts = 2,
                  cells = Lines::cells / parts;
    const auto& g = pass.grid;
    // Those that place homes come last.
    const int first = (threadIdx.x + split_threads - H * block_cells) % split_threads;
    for (int t = first; t < Lines::edge_x * Lines::edge * parts; t += split_threads) {
        const int part = t % parts, y = t / parts % Lines::edge, x = t / (parts * Lines::edge);
        const int nx = x - margin + edge, ny = y - margin + edge;
        const std::int32_t* column = column_of<H>(g.table, slot, nx / edge);
        if (column == nullptr) continue;
        column += ny / edge * 3;
        const int first_node = (nx % edge * edge + ny % edge) * edge;
        float u[cells + 2][C];
        MPM_UNROLL for (int k = 0; k < cells + 2; ++k) {
            const int nz = part * cells + k - margin + edge;
            load_node<C, P, float>(
                pass, g.velocity + g.velocity_place(column[nz / edge], first_node + nz % edge),
                u[k]);
        }
        Piece* to = lines.at + x * Lines::stride(0) + y * Lines::stride(1) +
                    part * cells * Lines::stride(2);
        MPM_UNROLL for (int k = 0; k < cells; ++k)
            expand_into(to + 3 * k, u[k], u[k + 1], u[k + 2]);
    }
}

/// As `flush`: a thread takes a row of nodes along y.
template <int H, int C, class P>
__device__ __forceinline__ void flush_sums(const P& pass, const std::int32_t (&slot)[H],
                                           const SplitSums<H, C>& sums) {
    using Sums = SplitSums<H, C>;
    constexpr int edge = Block<3>::edge, margin = Block<3>::margin,
                  rows = Sums::edge_x * Sums::edge, parts = split_threads / rows;
    static_assert(parts > 0);
    const int part = threadIdx.x / rows, row = threadIdx.x % rows;
    if (part >= parts) return;
    const int z = row % Sums::edge, x = row / Sums::edge;
    const int nx = x - margin + edge, nz = z - margin + edge;
    const std::int32_t* column = column_of<H>(pass.grid.table, slot, nx / edge);
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
        flush_node<C>(pass, from, Sums::nodes, to, sum_channels_of(pass));
    }
}

}  // namespace mpm::cuda
