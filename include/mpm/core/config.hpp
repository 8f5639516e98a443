// Markers shared by every floor: where a function may run and that it must be inlined.
#pragma once

#if defined(__CUDACC__)
#define MPM_HD __host__ __device__
#define MPM_INLINE __host__ __device__ __forceinline__
#if defined(__CUDA_ARCH__)
#define MPM_UNROLL _Pragma("unroll")
#define MPM_NO_UNROLL _Pragma("unroll 1")
#else
#define MPM_UNROLL
#define MPM_NO_UNROLL
#endif
#elif defined(LIBMPM_SANITIZED)
// Accesses are checked whether a function is inlined or not, and a unit of a material compiles in a
// fifth of the time.
#define MPM_HD
#define MPM_INLINE inline
#define MPM_UNROLL
#define MPM_NO_UNROLL
#else
#define MPM_HD
// Packs live in registers of a width that the surrounding clone decides, so they must never cross a
// call.
#define MPM_INLINE inline __attribute__((always_inline))
#define MPM_UNROLL _Pragma("GCC unroll 32")
#define MPM_NO_UNROLL _Pragma("GCC unroll 1")
#endif

// Long functions that few nodes or no particle of a step need: a call, on the host and on a device.
// Inlined wherever they are used they were a third of what either backend took to compile.
// MPM_HOST_CALL is for those that a device's particles need.
#if defined(__CUDACC__)
#define MPM_CALL __host__ __device__ __noinline__
#define MPM_HOST_CALL MPM_INLINE
#else
#define MPM_CALL inline __attribute__((noinline))
#define MPM_HOST_CALL MPM_CALL
#endif

namespace mpm {

/// The first line of every MPM_CALL function (tools/check_floors.py): lanes of a warp that enter it
/// together leave it together. Where some return early and wait in the caller, while others go on
/// to a call of their own (a division in double precision is one), that call uses the register of
/// the barrier at which the first ones wait (ptxas 13.0): they run ahead, and overwrite uniform
/// registers, pointers to the stack among them, of those that are still inside.
struct [[maybe_unused]] Reconverge {
#if defined(__CUDA_ARCH__)
    unsigned lanes;
    __device__ Reconverge() : lanes(__activemask()) {}
    __device__ ~Reconverge() { __syncwarp(lanes); }
    Reconverge(const Reconverge&) = delete;
    Reconverge& operator=(const Reconverge&) = delete;
#endif
};

}  // namespace mpm

// For lambdas in functions that are compiled for several instruction sets (kernels/cpu/levels.hpp):
// one that stays a call there is compiled for the lowest of them, and was called wrongly.
#if defined(__CUDACC__) || defined(LIBMPM_SANITIZED)
#define MPM_INLINE_LAMBDA
#else
#define MPM_INLINE_LAMBDA __attribute__((always_inline))
#endif
