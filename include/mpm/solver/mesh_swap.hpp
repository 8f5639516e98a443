// Of one body of elements on a device of several: the places of vertices that go to other ranks in
// each step, and come from them, between kernels and without the host.
#pragma once

#include <cstddef>
#include <cstdint>
#include <vector>

#include "mpm/exec/buffer.hpp"
#include "mpm/exec/communicator.hpp"
#include "mpm/solver/mesh_share.hpp"

namespace mpm {

template <class T, int D>
struct PackPlaces {
    const std::int32_t* number;
    const std::int32_t* cells;
    const T* beyond;
    std::int32_t* cells_to;
    T* beyond_to;
    MPM_INLINE void operator()(std::int64_t k) const {
        const std::int64_t from = std::int64_t(number[k]) * D;
        MPM_UNROLL for (int a = 0; a < D; ++a) {
            cells_to[k * D + a] = cells[from + a];
            beyond_to[k * D + a] = beyond[from + a];
        }
    }
};
template <class T, int D>
struct UnpackPlaces {
    const std::int32_t* number;
    const std::int32_t* cells_from;
    const T* beyond_from;
    ElementsView<T, D> mesh;
    MPM_INLINE void operator()(std::int64_t k) const {
        const std::int64_t to = std::int64_t(number[k]) * D;
        MPM_UNROLL for (int a = 0; a < D; ++a)
            place_vertex(mesh, to + a, cells_from[k * D + a], beyond_from[k * D + a]);
    }
};

/// Lists and pieces of all other ranks in a row, by rank.
template <class X, class T, int D>
class MeshSwap {
public:
    /// Where one rank's piece for another begins.
    struct Piece {
        const std::int32_t* cells;
        const T* beyond;
    };

    explicit MeshSwap(ExecutorBase<X>& exec)
        : give_(exec),
          need_(exec),
          cells_out_(exec),
          cells_in_(exec),
          beyond_out_(exec),
          beyond_in_(exec) {}

    /// By what a rank gives and needs now.
    void list(const MeshShare& share) {
        give_at_ = flatten(share.give, give_);
        need_at_ = flatten(share.need, need_);
        cells_out_.reserve_discard(give_.size() * D);
        beyond_out_.reserve_discard(give_.size() * D);
        cells_in_.reserve_discard(need_.size() * D);
        beyond_in_.reserve_discard(need_.size() * D);
        from_.assign(share.need.size(), Piece{});
        for (std::size_t r = 0; r < from_.size(); ++r)
            from_[r] = {cells_in_.data() + need_at_[r] * D, beyond_in_.data() + need_at_[r] * D};
    }
    /// What this rank gives another, where that may read it itself.
    Piece given(std::size_t rank) const {
        return {cells_out_.data() + give_at_[rank] * D, beyond_out_.data() + give_at_[rank] * D};
    }
    void read_at(std::size_t rank, const Piece& theirs) { from_[rank] = theirs; }
    std::size_t bytes_a_step() const {
        return give_.size() * D * (sizeof(std::int32_t) + sizeof(T));
    }

    void pack(X& exec, const ElementsView<T, D>& mesh) const {
        exec.for_each(std::int64_t(give_.size()),
                      PackPlaces<T, D>{give_.data(), mesh.cells, mesh.beyond, cells_out_.data(),
                                       beyond_out_.data()});
    }
    /// Where ranks do not read each other's memory.
    void add_parcels(std::vector<Parcel>& out, std::vector<Parcel>& in) const {
        for (std::size_t r = 0; r < from_.size(); ++r) {
            const std::size_t go = (give_at_[r + 1] - give_at_[r]) * D,
                              come = (need_at_[r + 1] - need_at_[r]) * D;
            if (go > 0) {
                out.push_back(
                    {cells_out_.data() + give_at_[r] * D, go * sizeof(std::int32_t), int(r)});
                out.push_back({beyond_out_.data() + give_at_[r] * D, go * sizeof(T), int(r)});
            }
            if (come > 0) {
                in.push_back(
                    {cells_in_.data() + need_at_[r] * D, come * sizeof(std::int32_t), int(r)});
                in.push_back({beyond_in_.data() + need_at_[r] * D, come * sizeof(T), int(r)});
            }
        }
    }
    void unpack(X& exec, const ElementsView<T, D>& mesh) const {
        for (std::size_t r = 0; r < from_.size(); ++r)
            exec.for_each(std::int64_t(need_at_[r + 1] - need_at_[r]),
                          UnpackPlaces<T, D>{need_.data() + need_at_[r], from_[r].cells,
                                             from_[r].beyond, mesh});
    }
    std::size_t bytes() const {
        return give_.bytes() + need_.bytes() + cells_out_.bytes() + cells_in_.bytes() +
               beyond_out_.bytes() + beyond_in_.bytes();
    }

private:
    static std::vector<std::size_t> flatten(const std::vector<std::vector<std::int32_t>>& lists,
                                            Buffer<X, std::int32_t>& to) {
        std::vector<std::int32_t> all;
        std::vector<std::size_t> at = {0};
        for (const auto& list : lists) {
            all.insert(all.end(), list.begin(), list.end());
            at.push_back(all.size());
        }
        to.assign(all);
        return at;
    }

    Buffer<X, std::int32_t> give_, need_, cells_out_, cells_in_;
    Buffer<X, T> beyond_out_, beyond_in_;
    std::vector<std::size_t> give_at_, need_at_;
    std::vector<Piece> from_;  // by rank
};

}  // namespace mpm
