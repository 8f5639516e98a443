# The target mpm_flags carries what every unit of ours is compiled with. -ffast-math stays out: a
# library linked with it flushes denormals for the whole Python process and drops checks for
# non-finite values. Instruction sets beyond the baseline come from attributes of functions
# (mpm/kernels/cpu/levels.hpp).

if(NOT CMAKE_BUILD_TYPE AND NOT CMAKE_CONFIGURATION_TYPES)
  set(CMAKE_BUILD_TYPE Release)
endif()
set(CMAKE_CXX_STANDARD 20)
set(CMAKE_CXX_STANDARD_REQUIRED ON)
set(CMAKE_CXX_EXTENSIONS OFF)
set(CMAKE_POSITION_INDEPENDENT_CODE ON)
set(CMAKE_CXX_VISIBILITY_PRESET hidden)
set(CMAKE_CUDA_VISIBILITY_PRESET hidden)
set(CMAKE_VISIBILITY_INLINES_HIDDEN ON)
set(CMAKE_EXPORT_COMPILE_COMMANDS ON)
# -O3 is for what runs once a particle or once a node (mpm_library): elsewhere it doubles the time to
# compile. Of nvcc these are the host's.
set(CMAKE_CXX_FLAGS_RELEASE "-O2 -DNDEBUG")
set(CMAKE_CUDA_FLAGS_RELEASE "-O2 -DNDEBUG")

add_library(mpm_flags INTERFACE)
target_include_directories(mpm_flags INTERFACE "${PROJECT_SOURCE_DIR}/include")
target_link_libraries(mpm_flags INTERFACE Eigen3::Eigen)
target_compile_definitions(
  mpm_flags
  INTERFACE LIBMPM_VERSION="${PROJECT_VERSION}"
            EIGEN_MAX_STATIC_ALIGN_BYTES=16 # one layout whatever the instruction set
            $<$<BOOL:${LIBMPM_WITH_CUDA}>:LIBMPM_WITH_CUDA=1>)

set(_mpm_host_flags -ffp-contract=fast -fno-math-errno -fno-trapping-math -fno-signed-zeros)
set(_mpm_host_warnings -Wall -Wextra -Wno-psabi)
if(LIBMPM_WERROR)
  list(APPEND _mpm_host_warnings -Werror)
endif()
if(LIBMPM_NATIVE)
  list(APPEND _mpm_host_flags -march=native)
endif()
if(LIBMPM_SANITIZE)
  list(APPEND _mpm_host_flags -fsanitize=${LIBMPM_SANITIZE} -fno-sanitize-recover=all
       -fno-omit-frame-pointer)
  # Checks of pointers are the address sanitizer's, and those are calls: with both the solver's unit
  # compiles in less than half the time. Not so in what runs once a particle or once a node
  # (mpm_library): there calls take twice the time of tests, and save a fifth of compiling.
  if(LIBMPM_SANITIZE MATCHES address AND CMAKE_CXX_COMPILER_ID STREQUAL GNU)
    list(APPEND _mpm_host_flags -fno-sanitize=null,object-size,vptr
         --param=asan-instrumentation-with-call-threshold=0)
    set(MPM_HOT_SANITIZED --param=asan-instrumentation-with-call-threshold=7000)
  endif()
  target_link_options(mpm_flags INTERFACE -fsanitize=${LIBMPM_SANITIZE})
  target_compile_definitions(mpm_flags INTERFACE LIBMPM_SANITIZED=1)
endif()
target_compile_options(mpm_flags INTERFACE
  "$<$<COMPILE_LANGUAGE:CXX>:${_mpm_host_flags};${_mpm_host_warnings}>")
if(LIBMPM_WITH_CUDA)
  # The host half of a .cu unit gets the same arithmetic; Eigen needs the relaxed constexpr.
  list(JOIN _mpm_host_flags "," _mpm_cuda_flags)
  set(_mpm_cuda_flags --expt-relaxed-constexpr
      "-Xcompiler=${_mpm_cuda_flags},-Wall,-Wno-psabi")
  if(LIBMPM_LINEINFO) # for profilers: the same instructions, and half of the module again
    list(APPEND _mpm_cuda_flags -lineinfo)
  endif()
  if(CMAKE_CUDA_COMPILER_VERSION VERSION_GREATER_EQUAL 13.0)
    # A fifth of the size of a unit; the drivers that CUDA 13 needs unpack it, those of 12.0 to 12.3 do not.
    list(APPEND _mpm_cuda_flags --compress-mode=size)
  endif()
  target_compile_options(mpm_flags INTERFACE "$<$<COMPILE_LANGUAGE:CUDA>:${_mpm_cuda_flags}>")
  if(LIBMPM_WERROR)
    target_compile_options(mpm_flags INTERFACE "$<$<COMPILE_LANGUAGE:CUDA>:-Werror=all-warnings>")
  endif()
  string(REPLACE ";" "," _mpm_architectures "${CMAKE_CUDA_ARCHITECTURES}")
  target_compile_definitions(mpm_flags INTERFACE LIBMPM_CUDA_ARCHITECTURES="${_mpm_architectures}")
endif()
