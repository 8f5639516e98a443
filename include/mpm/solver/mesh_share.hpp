// Of one body of elements, what a rank of several works on: the elements of its own vertices. What
// these need of the vertices of others comes in each step (design/elements.md).
#pragma once

#include <cstdint>
#include <utility>
#include <vector>

#include "mpm/kernels/elements.hpp"

namespace mpm {

struct MeshShare {
    std::vector<std::int32_t> owner;  // of each vertex
    // By number, ascending. An element is pushed on every rank that has a vertex of it, so that
    // what it keeps is of now on all of these.
    std::vector<std::int32_t> pushed, measured, pressed;
    std::vector<std::uint8_t> pushes;  // (elements,): those that are
    // Vertices by rank, ascending: whose places come from there, and go there.
    std::vector<std::vector<std::int32_t>> need, give;
    std::vector<int> peers;  // with whom there is any

    /// All but `give` and `peers`, by the owners.
    template <class T, int D>
    void list(const ElementsView<T, D>& mesh, int rank, int ranks) {
        const auto elements = std::size_t(mesh.elements), vertices = std::size_t(mesh.vertices);
        std::vector<std::uint8_t> wanted(vertices, 0);
        const auto mark_elements = [&](std::vector<std::uint8_t>& marked, std::size_t v) {
            for (std::uint32_t c = mesh.start[v]; c < mesh.start[v + 1]; ++c)
                marked[mesh.corner[c] / (D + 1)] = 1;
        };
        const auto want_vertices = [&](const std::vector<std::int32_t>& of) {
            for (const std::int32_t e : of)
                for (int k = 0; k <= D; ++k) wanted[std::size_t(mesh.number(e, k))] = 1;
        };
        pushes.assign(elements, 0);
        for (std::size_t v = 0; v < vertices; ++v)
            if (owner[v] == rank) mark_elements(pushes, v);
        pushed = numbers_of(pushes);
        want_vertices(pushed);
        if (mesh.grown) {
            // Pressures of all vertices of these, and with them volumes of a layer more.
            pressed = numbers_of(wanted);
            std::vector<std::uint8_t> asks(elements, 0);
            for (const std::int32_t v : pressed) mark_elements(asks, std::size_t(v));
            measured = numbers_of(asks);
            want_vertices(measured);
        }
        need.assign(std::size_t(ranks), {});
        for (std::size_t v = 0; v < vertices; ++v)
            if (wanted[v] && owner[v] != rank)
                need[std::size_t(owner[v])].push_back(std::int32_t(v));
    }
    void list_peers() {
        peers.clear();
        for (std::size_t r = 0; r < need.size(); ++r)
            if (!need[r].empty() || !give[r].empty()) peers.push_back(int(r));
    }
    std::size_t bytes() const {
        std::size_t n = owner.size() + pushed.size() + measured.size() + pressed.size();
        for (const auto* lists : {&need, &give})
            for (const auto& list : *lists) n += list.size();
        return n * sizeof(std::int32_t) + pushes.size();
    }

private:
    static std::vector<std::int32_t> numbers_of(const std::vector<std::uint8_t>& marked) {
        std::vector<std::int32_t> out;
        for (std::size_t k = 0; k < marked.size(); ++k)
            if (marked[k]) out.push_back(std::int32_t(k));
        return out;
    }
};

}  // namespace mpm
