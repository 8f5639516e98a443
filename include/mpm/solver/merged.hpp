// Bodies that differ in nothing but their particles, stepped as one: two dozen equal blocks then
// cost what one body of their size costs, not two dozen launches and sorts.
#pragma once

#include <functional>
#include <memory>
#include <vector>

#include "mpm/solver/engine.hpp"
#include "mpm/solver/plan.hpp"

namespace mpm {

/// The scene with alike neighbours in the list of bodies made one, and which body each went to.
struct MergedSpec {
    Spec spec;
    std::vector<int> body_of;  // of each body of the scene
};

/// Merges bodies of equal material, parameters, particle mass and F-bar whose ids follow each
/// other, unless a sensor asks for one of them alone.
MergedSpec merge_alike(const Spec& spec);

/// The plan of the scene as it was given; its kernels and memory are those of what runs.
Plan plan_scene(const Spec& spec, const BackendTraits& backend);

/// An engine of the scene as it was given, run by `make` on the merged one.
std::unique_ptr<Engine> make_merged(
    const Spec& spec, const std::function<std::unique_ptr<Engine>(const Spec&)>& make);

}  // namespace mpm
