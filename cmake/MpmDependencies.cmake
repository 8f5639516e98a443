# Everything that is looked for outside the tree.

find_package(Python 3.11 REQUIRED COMPONENTS Interpreter Development.Module)
if(NOT SKBUILD) # a plain `cmake -S . -B build`: the interpreter's packages hold pybind11 and Eigen
  execute_process(
    COMMAND "${Python_EXECUTABLE}" -c "import sysconfig; print(sysconfig.get_path('platlib'))"
    OUTPUT_VARIABLE _mpm_site
    OUTPUT_STRIP_TRAILING_WHITESPACE COMMAND_ERROR_IS_FATAL ANY)
  list(APPEND CMAKE_PREFIX_PATH "${_mpm_site}" "${_mpm_site}/pybind11")
endif()
set(PYBIND11_FINDPYTHON ON)
find_package(pybind11 2.13 CONFIG REQUIRED)

# LIBMPM_EIGEN_INCLUDE (variable or environment) names a folder of bare Eigen headers, for machines
# that can install nothing. Eigen 5 refuses a request for version 3.4, so the version is compared
# here.
if(NOT LIBMPM_EIGEN_INCLUDE AND DEFINED ENV{LIBMPM_EIGEN_INCLUDE})
  set(LIBMPM_EIGEN_INCLUDE "$ENV{LIBMPM_EIGEN_INCLUDE}")
endif()
if(LIBMPM_EIGEN_INCLUDE)
  if(NOT EXISTS "${LIBMPM_EIGEN_INCLUDE}/Eigen/Core")
    message(FATAL_ERROR "LIBMPM_EIGEN_INCLUDE=${LIBMPM_EIGEN_INCLUDE} holds no Eigen/Core")
  endif()
  add_library(mpm_eigen INTERFACE)
  target_include_directories(mpm_eigen SYSTEM INTERFACE "${LIBMPM_EIGEN_INCLUDE}")
  add_library(Eigen3::Eigen ALIAS mpm_eigen)
else()
  find_package(Eigen3 CONFIG REQUIRED PATH_SUFFIXES cmeel.prefix/share/eigen3/cmake)
  if(Eigen3_VERSION VERSION_LESS 3.4)
    message(FATAL_ERROR "Eigen ${Eigen3_VERSION} at ${Eigen3_DIR}: 3.4 or newer is needed")
  endif()
endif()

# Every isolated build of pip unpacks these headers to a new path, which would recompile every unit.
# Kept in the build folder they stay where they are, and the second `pip install` compiles what has
# changed.
function(mpm_keep_headers target folder)
  get_target_property(from ${target} INTERFACE_INCLUDE_DIRECTORIES)
  set(kept "${PROJECT_BINARY_DIR}/headers")
  file(GLOB_RECURSE headers RELATIVE "${from}" "${from}/${folder}/*")
  foreach(header IN LISTS headers)
    cmake_path(GET header PARENT_PATH parent)
    file(MAKE_DIRECTORY "${kept}/${parent}")
    file(COPY_FILE "${from}/${header}" "${kept}/${header}" ONLY_IF_DIFFERENT)
  endforeach()
  set_target_properties(${target} PROPERTIES
    INTERFACE_INCLUDE_DIRECTORIES "${kept}" INTERFACE_SYSTEM_INCLUDE_DIRECTORIES "${kept}")
endfunction()
if(SKBUILD)
  mpm_keep_headers(pybind11::pybind11_headers pybind11)
  if(NOT LIBMPM_EIGEN_INCLUDE)
    mpm_keep_headers(Eigen3::Eigen Eigen)
  endif()
endif()

find_package(OpenMP REQUIRED COMPONENTS CXX)

# CUDA. CMake finds nvcc on PATH, by CUDACXX or by CUDA_PATH; the two other usual places are tried
# here.
if(NOT LIBMPM_CUDA MATCHES "^(AUTO|ON|OFF)$")
  message(FATAL_ERROR "LIBMPM_CUDA=${LIBMPM_CUDA}: say AUTO, ON or OFF")
endif()
set(LIBMPM_WITH_CUDA FALSE)
if(NOT LIBMPM_CUDA STREQUAL "OFF")
  if(NOT DEFINED CMAKE_CUDA_COMPILER AND NOT DEFINED ENV{CUDACXX})
    find_program(LIBMPM_NVCC nvcc
      HINTS ENV CUDA_PATH ENV CUDA_HOME PATHS /usr/local/cuda PATH_SUFFIXES bin)
    mark_as_advanced(LIBMPM_NVCC)
    if(LIBMPM_NVCC)
      set(ENV{CUDACXX} "${LIBMPM_NVCC}") # CMAKE_CUDA_COMPILER would skip the check below
    endif()
  endif()
  if(NOT DEFINED CMAKE_CUDA_ARCHITECTURES AND NOT DEFINED ENV{CUDAARCHS})
    set(CMAKE_CUDA_ARCHITECTURES 90)
  endif()
  include(CheckLanguage)
  check_language(CUDA)
  if(CMAKE_CUDA_COMPILER)
    enable_language(CUDA)
    if(CMAKE_CUDA_COMPILER_VERSION VERSION_LESS 12.0)
      set(_mpm_cuda_reason "nvcc ${CMAKE_CUDA_COMPILER_VERSION} is older than 12.0")
    else()
      find_package(CUDAToolkit REQUIRED)
      set(LIBMPM_WITH_CUDA TRUE)
      set(CMAKE_CUDA_STANDARD 20)
      set(CMAKE_CUDA_STANDARD_REQUIRED ON)
      set(CMAKE_CUDA_EXTENSIONS OFF)
      set(CMAKE_CUDA_RUNTIME_LIBRARY Static)
    endif()
  else()
    set(_mpm_cuda_reason
        "no working nvcc was found (PATH, CUDACXX, CUDA_PATH, CUDA_HOME, /usr/local/cuda)")
  endif()
  if(NOT LIBMPM_WITH_CUDA AND LIBMPM_CUDA STREQUAL "ON")
    message(FATAL_ERROR "LIBMPM_CUDA=ON, but ${_mpm_cuda_reason}")
  endif()
else()
  set(_mpm_cuda_reason "LIBMPM_CUDA=OFF")
endif()
if(LIBMPM_WITH_CUDA)
  message(STATUS "CUDA backend: nvcc ${CMAKE_CUDA_COMPILER_VERSION}, "
    "architectures ${CMAKE_CUDA_ARCHITECTURES}")
else()
  message(STATUS "CUDA backend: not built (${_mpm_cuda_reason})")
endif()
