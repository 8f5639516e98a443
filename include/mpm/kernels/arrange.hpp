// Into which order a sort brings the particles of a body.
#pragma once

#include <cstdint>

#include "mpm/exec/buffer.hpp"
#include "mpm/kernels/order.hpp"

namespace mpm {

/// `cell` holds each particle's cell in [0, cells], `cells` for those that are taken out. It
/// becomes the order: cell[k] = which particle is stored at place k. start[c] = places before cell
/// c, for c in [0, cells]. On devices, which store as `of_home` says, `home` gets the home byte of
/// the particle at each place, and particles of one cell are in the order of their ids; on the CPU
/// they keep their order.
template <class X>
void arrange(X& exec, Buffer<X, std::uint32_t>& cell, std::int64_t cells, const std::uint32_t* id,
             std::uint32_t* start, std::uint8_t* home, HomeOrder of_home) {
    if constexpr (!X::is_device) {
        Buffer<X, std::uint32_t> order(exec);
        order.reserve_discard(cell.size());
        exec.stable_order(cell.data(), std::int64_t(cell.size()), cells + 1, order.data(), start);
        cell.swap(order);
    } else {
        arrange_homes(exec, cell.data(), std::int64_t(cell.size()), cells, id, start, home,
                      of_home);
    }
}

class Cuda;
/// Compiled once, in src/kernels/cuda/arrange.cu.
void arrange_homes(Cuda& exec, std::uint32_t* cell, std::int64_t particles, std::int64_t cells,
                   const std::uint32_t* id, std::uint32_t* start, std::uint8_t* home,
                   HomeOrder of_home);

}  // namespace mpm
