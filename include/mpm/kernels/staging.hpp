// Sums of blocks that several ranks hold, in the order in which one rank would have added them.
//
// On the CPU sums are plain numbers, so their order decides their bits: body by body, colour by
// colour, and of each colour at most one block adds to a node. A rank therefore does not add to a
// block that others hold too, but stages what its blocks of each body and colour would add there,
// in slots behind those of its table. Staged blocks are told to all who hold the block, and
// everyone adds all of them up in the order of bodies and colours. Of one body and colour the
// ranks' blocks share no node either, so in which order ranks come changes nothing.
//
// A flush adds mass * arena, which compiles to one rounding where there is a fused multiply-add and
// to two elsewhere. So the arena is staged as it is, and the mass comes with the addition, in a
// function compiled for the same instruction sets.
#pragma once

#include <cstddef>

namespace mpm {

/// to[k] += mass * from[k], rounded as the flush of a step does it, or with `first` as that of the
/// first deposit, which is compiled once only (kernels/cpu/body_pass.hpp).
template <class T>
void add_staged(T* to, const T* from, T mass, std::size_t count, bool first);

}  // namespace mpm
