// Functions compiled for several instruction sets, and which of them a process runs.
#pragma once

#include <cstdlib>
#include <string>

#include "mpm/core/error.hpp"

// 32-byte packs widen with the function that they are inlined into, so everything is.
#if defined(__x86_64__) && !defined(LIBMPM_SANITIZED) && !defined(__clang__)
#define MPM_HAS_LEVELS 1
#define MPM_LEVEL_V3 __attribute__((target("arch=x86-64-v3"), flatten, noinline))
#define MPM_LEVEL_V4 __attribute__((target("arch=x86-64-v4"), flatten, noinline))
#else
#define MPM_HAS_LEVELS 0
#endif

namespace mpm::cpu {

/// Instruction sets in ascending order: what every processor of this kind has, AVX2 with fused
/// multiply-add, AVX-512.
enum class Level : int { base, v3, v4 };

inline const char* name_of(Level level) {
    static constexpr const char* name[] = {"x86-64", "x86-64-v3", "x86-64-v4"};
    return MPM_HAS_LEVELS ? name[int(level)] : "as compiled";
}

/// The highest that this processor has, or the one that LIBMPM_INSTRUCTIONS names: results of
/// different levels differ in their last bits.
inline Level processor_level() {
#if MPM_HAS_LEVELS
    static const Level level = [] {
        __builtin_cpu_init();
        const Level best = __builtin_cpu_supports("x86-64-v4")   ? Level::v4
                           : __builtin_cpu_supports("x86-64-v3") ? Level::v3
                                                                 : Level::base;
        const char* asked = std::getenv("LIBMPM_INSTRUCTIONS");
        if (asked == nullptr) return best;
        std::string known;
        for (int k = 0; k <= int(best); ++k) {
            if (std::string(asked) == name_of(Level(k))) return Level(k);
            known += std::string(k == 0 ? "" : ", ") + name_of(Level(k));
        }
        throw SceneError("LIBMPM_INSTRUCTIONS is '" + std::string(asked) +
                         "' in the environment; this processor has " + known +
                         ". Set it to one of them, or leave it out for the last one");
    }();
    return level;
#else
    return Level::base;
#endif
}

/// The instructions that a pass is compiled for besides those of every processor.
enum class Levels { base, up_to_v3, all };

// B::run<packs>(...) with the instructions of a level. Packs are for wide vectors: without them a
// particle at a time is as fast and compiles in a third of the time.
template <class B, class... A>
void run_at_base(A... a) {
    B::template run<!MPM_HAS_LEVELS>(a...);
}
#if MPM_HAS_LEVELS
template <class B, class... A>
MPM_LEVEL_V3 void run_at_v3(A... a) {
    B::template run<true>(a...);
}
template <class B, class... A>
MPM_LEVEL_V4 void run_at_v4(A... a) {
    B::template run<true>(a...);
}
#endif

/// The highest of the levels up to `to` that this processor has.
template <class B, Levels to, class... A>
void (*runner())(A...) {
#if MPM_HAS_LEVELS
    if constexpr (to == Levels::all) {
        if (processor_level() == Level::v4) return &run_at_v4<B, A...>;
    }
    if constexpr (to != Levels::base) {
        if (processor_level() >= Level::v3) return &run_at_v3<B, A...>;
    }
#endif
    return &run_at_base<B, A...>;
}

}  // namespace mpm::cpu
