// The order of a device's particles: by block and cell, rank by rank or by chunk
// (kernels/order.hpp). Cells are filled in whatever order their particles arrive and then put in
// the order of the ids, so that the result depends on nothing but who stands where.
#include "mpm/kernels/arrange.hpp"
#include "mpm/kernels/cuda/chunks.cuh"
#include "mpm/kernels/cuda/rank_walk.cuh"

namespace mpm {

namespace {

constexpr int warps = 4;
constexpr int room = 32;  // particles of a cell that fit shared memory

/// One warp for 32 cells: those that follow each other, or half of a block's places.
template <HomeOrder by>
__global__ void __launch_bounds__(warps * 32)
    rank_cells(const std::uint32_t* arrived, const std::uint32_t* id, const std::uint32_t* start,
               std::int64_t cells, std::uint32_t* order, std::uint8_t* home) {
    __shared__ std::uint64_t list[warps][room][32];
    const int lane = threadIdx.x % 32, warp = threadIdx.x / 32;
    const std::int64_t first = (std::int64_t(blockIdx.x) * warps + warp) * warp_cells;
    if (first >= cells) return;
    std::int64_t own = first + lane;
    std::uint32_t before = start[first];
    if constexpr (by == HomeOrder::by_chunk) {
        __shared__ cuda::CellPlaces places[warps];
        const std::int64_t block = first / block_cells * block_cells;
        const int half = int(first - block);
        for (int k = 0; k < block_cells; k += 32) places[warp].find(start + block, k + lane);
        __syncwarp();
        own = block + places[warp].cell_at[half + lane];
        // What the fuller half holds comes before that of the other.
        const std::uint32_t fuller = __reduce_add_sync(~0u, places[warp].count[lane]);
        before = start[block] + (half > 0 ? fuller : 0);
    }
    const std::uint32_t begin = start[own], count = start[own + 1] - begin;
    const cuda::CellWalk<by> walk(before, count);
    if (walk.nobody()) return;
    const int cell = int(own % block_cells);
    const auto entry = [&](std::uint32_t k) {
        const std::uint32_t p = arrived[begin + k];
        return std::uint64_t(id[p]) << 32 | p;
    };
    const bool fits = count <= room;
    if (fits) {
        constexpr int batch = 8;  // loads under way at a time
        for (std::uint32_t first_of = 0; first_of < count; first_of += batch) {
            std::uint32_t p[batch], number[batch];
            MPM_UNROLL for (int k = 0; k < batch; ++k) if (first_of + k < count) p[k] =
                arrived[begin + first_of + k];
            MPM_UNROLL for (int k = 0; k < batch; ++k) if (first_of + k < count) number[k] =
                id[p[k]];
            MPM_UNROLL for (int k = 0; k < batch; ++k) {
                if (first_of + k >= count) break;
                const std::uint64_t e = std::uint64_t(number[k]) << 32 | p[k];
                std::uint32_t at = first_of + k;
                for (; at > 0 && list[warp][at - 1][lane] > e; --at) {
                    list[warp][at][lane] = list[warp][at - 1][lane];
                }
                list[warp][at][lane] = e;
            }
        }
    }
    std::uint32_t taken = 0;
    std::uint64_t last = 0;
    walk.each([&](std::uint32_t place) {
        if (fits) {
            last = list[warp][taken][lane];
        } else {
            // The next larger one; a cell that holds so many is rare.
            std::uint64_t best = ~std::uint64_t(0);
            for (std::uint32_t k = 0; k < count; ++k) {
                const std::uint64_t e = entry(k);
                if ((taken == 0 || e > last) && e < best) best = e;
            }
            last = best;
        }
        order[place] = std::uint32_t(last);
        home[place] = home_byte(cell, by == HomeOrder::by_chunk ? taken : 0);
        ++taken;
    });
}

}  // namespace

void arrange_homes(Cuda& exec, std::uint32_t* cell, std::int64_t particles, std::int64_t cells,
                   const std::uint32_t* id, std::uint32_t* start, std::uint8_t* home,
                   HomeOrder of_home) {
    Buffer<Cuda, std::uint32_t> arrived(exec);
    arrived.reserve_discard(std::size_t(particles) + column_padding);
    exec.bucket_order(cell, particles, cells + 1, arrived.data(), start);
    constexpr std::int64_t each = warps * warp_cells;
    exec.launch(of_home == HomeOrder::by_chunk ? &rank_cells<HomeOrder::by_chunk>
                                               : &rank_cells<HomeOrder::by_rank>,
                (cells + each - 1) / each, 1, warps * 32,
                static_cast<const std::uint32_t*>(arrived.data()), id,
                static_cast<const std::uint32_t*>(start), cells, cell, home);
}

}  // namespace mpm
