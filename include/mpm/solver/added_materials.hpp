// Materials that come while the library runs (kernels/cpu/added_material.hpp): found by name beside
// those that were built.
#pragma once

#include <map>
#include <string>

#include "mpm/kernels/pass.hpp"

namespace mpm {

/// Puts a description behind those of the built-in materials. Raises `SceneError` for a name that
/// there is already.
void add_material(const MaterialInfo& info);

template <class X, class T, int D>
using FindAdded = BodyOps<X, T, D> (*)(Smoothing);

/// The instances of one backend, precision and dimension, by name. Whoever adds says that nobody
/// makes a simulation meanwhile: both is done under Python's lock.
template <class X, class T, int D>
std::map<std::string, FindAdded<X, T, D>>& added_ops() {
    static std::map<std::string, FindAdded<X, T, D>> ops;
    return ops;
}

/// Loads the library at `path`; returns the name of its material. Raises `SceneError` for a file
/// that is none, or was compiled from other headers.
std::string add_cpu_material(const std::string& path);
std::string add_cuda_material(const std::string& path);

}  // namespace mpm
