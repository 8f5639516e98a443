// Functions compiled for several instruction sets at once.
#pragma once

// 32-byte packs widen with the clone they are inlined into; the loader picks the clone for the
// processor.
#if defined(LIBMPM_SANITIZED) || defined(__clang__)
#define MPM_CLONES
#else
#define MPM_CLONES \
    __attribute__((target_clones("default", "arch=x86-64-v3", "arch=x86-64-v4"), flatten, noinline))
#endif
