// Domain: bodies of elements on several ranks. Vertices change their ranks as particles do; a mesh
// is on all ranks whole, and each works on the elements of its own vertices. What it needs to know
// of the others' is told once a step, and by whom to whom is settled at each sort.
#pragma once

#include "mpm/solver/domain.hpp"
#include "mpm/solver/rank_checks.hpp"

namespace mpm {

namespace detail {

/// Where vertices stand, into a message and out of it.
template <class T, int D>
void put_places(Packer& to, const std::int32_t* cells, const T* beyond,
                const std::vector<std::int32_t>& vertices) {
    std::vector<std::int32_t> whole;
    std::vector<T> rest;
    for (const std::int32_t v : vertices) {
        whole.insert(whole.end(), cells + std::int64_t(v) * D, cells + (std::int64_t(v) + 1) * D);
        rest.insert(rest.end(), beyond + std::int64_t(v) * D, beyond + (std::int64_t(v) + 1) * D);
    }
    to.put(whole.data(), whole.size());
    to.put(rest.data(), rest.size());
}
template <class T, int D>
void get_places(Unpacker& from, const ElementsView<T, D>& mesh,
                const std::vector<std::int32_t>& vertices) {
    std::vector<std::int32_t> whole(vertices.size() * D);
    std::vector<T> rest(whole.size());
    from.get(whole.data(), whole.size());
    from.get(rest.data(), rest.size());
    checks::cells_of_vertices(whole);
    for (std::size_t k = 0; k < vertices.size(); ++k)
        for (std::size_t a = 0; a < D; ++a)
            place_vertex(mesh, std::int64_t(vertices[k]) * D + std::int64_t(a), whole[k * D + a],
                         rest[k * D + a]);
}

}  // namespace detail

/// Calls f(body, number among bodies of elements) for each of these.
template <class X, class T, int D>
template <class F>
void Domain<X, T, D>::each_mesh(const F& f) {
    std::size_t k = 0;
    for (Body& body : bodies_)
        if (body.mesh) f(body, k++);
}

/// Where a body's vertices are at rest, from whoever has them then. All ranks together.
template <class X, class T, int D>
void Domain<X, T, D>::tell_rest(Body& body) {
    const auto on_host = body.mesh->on_host();
    const ElementsView<T, D>& mesh = on_host.view;
    const auto n = std::size_t(mesh.vertices);
    std::fill_n(mesh.cells, n * D, 0);
    std::fill_n(mesh.beyond, n * D, T(0));
    const std::vector<std::uint32_t> id = body.id.host(body.count);
    const std::vector<std::int32_t> own(id.begin(), id.end());
    Packer packer;
    packer.put(own);
    detail::put_places<T, D>(packer, mesh.rest_cell, mesh.rest_offset, own);
    // Of a message that is refused nothing stays.
    struct Told {
        std::vector<std::int32_t> vertex, cells;
        std::vector<T> offset;
    };
    std::vector<Told> told{std::size_t(share_->ranks())};
    share_->comm->exchange_and_read(std::vector<Bytes>(told.size(), packer.take()),
                                    share_->comm->others(), "places at rest",
                                    [&](int r, Unpacker& from) {
                                        Told theirs{from.list<std::int32_t>(), {}, {}};
                                        checks::vertices(theirs.vertex, n);
                                        theirs.cells.resize(theirs.vertex.size() * D);
                                        theirs.offset.resize(theirs.cells.size());
                                        from.get(theirs.cells.data(), theirs.cells.size());
                                        from.get(theirs.offset.data(), theirs.offset.size());
                                        checks::cells_of_vertices(theirs.cells);
                                        told[std::size_t(r)] = std::move(theirs);
                                    });
    for (const Told& theirs : told)
        for (std::size_t k = 0; k < theirs.cells.size(); ++k) {
            const std::size_t to = std::size_t(theirs.vertex[k / D]) * D + k % D;
            mesh.rest_cell[to] = theirs.cells[k];
            mesh.rest_offset[to] = theirs.offset[k];
        }
    body.mesh->take(on_host);
}

/// Who has which vertices, by body of elements. All ranks together.
template <class X, class T, int D>
std::vector<std::vector<std::int32_t>> Domain<X, T, D>::find_owners_of_vertices() {
    RankShare<D>& s = *share_;
    std::vector<std::vector<std::int32_t>> owner, own;
    Packer packer;
    each_mesh([&](Body& body, std::size_t) {
        const std::vector<std::uint32_t> id = body.id.host(body.count);
        own.emplace_back(id.begin(), id.end());
        owner.emplace_back(body.mesh->vertices(), -1);
        packer.put(own.back());
    });
    std::vector<std::vector<std::vector<std::int32_t>>> all{std::size_t(s.ranks())};
    s.comm->exchange_and_read(std::vector<Bytes>(all.size(), packer.take()), s.comm->others(),
                              "vertices", [&](int r, Unpacker& from) {
                                  std::vector<std::vector<std::int32_t>> theirs;
                                  for (const auto& of : owner) {
                                      theirs.push_back(from.list<std::int32_t>());
                                      checks::vertices(theirs.back(), of.size());
                                  }
                                  all[std::size_t(r)] = std::move(theirs);
                              });
    all[std::size_t(s.rank())] = std::move(own);
    each_mesh([&](Body& body, std::size_t k) {
        for (std::size_t r = 0; r < all.size(); ++r)
            for (const std::int32_t v : all[r][k]) {
                std::int32_t& of = owner[k][std::size_t(v)];
                if (of >= 0)
                    throw DeviceError("vertex " + std::to_string(v) + " of body '" +
                                      body.plan.name + "' is on ranks " + std::to_string(of) +
                                      " and " + std::to_string(r));
                of = std::int32_t(r);
            }
        const auto lost = std::find(owner[k].begin(), owner[k].end(), -1);
        if (lost != owner[k].end())
            throw DeviceError("vertex " + std::to_string(lost - owner[k].begin()) + " of body '" +
                              body.plan.name + "' is on no rank");
    });
    return owner;
}

/// What each rank works on now that vertices are where they are, and what it is told from now on.
/// What elements keep of flow comes to who works on them anew; `all_keep`: all ranks have it of
/// all. All ranks together.
template <class X, class T, int D>
void Domain<X, T, D>::link_meshes(bool all_keep) {
    if (!has_meshes()) return;
    auto owner = find_owners_of_vertices();
    std::vector<std::vector<std::int32_t>> before;
    std::vector<std::vector<std::uint8_t>> pushed;
    each_mesh([&](Body& body, std::size_t k) {
        const MeshShare* share = body.mesh->share();
        before.push_back(share ? share->owner : std::vector<std::int32_t>());
        pushed.push_back(share ? share->pushes : std::vector<std::uint8_t>());
        body.mesh->share_among(std::move(owner[k]), share_->rank(), share_->ranks());
        // Sorts write a place in other numbers.
        body.elements.locate(pass(body, int(&body - bodies_.data()), parity()), body.mesh->view(),
                             false);
    });
    tell_wanted(before, pushed, all_keep);
}

/// Each rank asks the others for what it needs, and is told it. `owner`, `pushed`: of vertices and
/// elements before; not looked at where `all_keep`.
template <class X, class T, int D>
void Domain<X, T, D>::tell_wanted(const std::vector<std::vector<std::int32_t>>& owner,
                                  const std::vector<std::vector<std::uint8_t>>& pushed,
                                  bool all_keep) {
    RankShare<D>& s = *share_;
    const std::size_t ranks = std::size_t(s.ranks()), meshes = owner.size();
    using Lists = std::vector<std::vector<std::int32_t>>;  // by body of elements
    const auto first_vertex = [](const Body& body, std::int32_t e) {
        return std::size_t(body.mesh->connected().number(e, 0));
    };
    // Elements whose memory comes from a rank: from who had the first vertex.
    std::vector<Lists> keeps(ranks, Lists(meshes)), asked(ranks, Lists(meshes));
    each_mesh([&](Body& body, std::size_t k) {
        if (all_keep || body.mesh->kept() == 0) return;
        for (const std::int32_t e : body.mesh->share()->pushed)
            if (!pushed[k][std::size_t(e)])
                keeps[std::size_t(owner[k][first_vertex(body, e)])][k].push_back(e);
    });
    std::vector<Packer> packers(ranks);
    each_mesh([&](Body& body, std::size_t k) {
        MeshShare& share = *body.mesh->share();
        share.give.assign(ranks, {});
        for (std::size_t r = 0; r < ranks; ++r) {
            packers[r].put(share.need[r]);
            packers[r].put(keeps[r][k]);
        }
    });
    const auto exchange = [&](const char* what, const auto& read) {
        std::vector<Bytes> out;
        for (Packer& packer : packers) out.push_back(packer.take());
        s.comm->exchange_and_read(std::move(out), s.comm->others(), what, read);
    };
    exchange("wanted vertices", [&](int r, Unpacker& from) {
        each_mesh([&](Body& body, std::size_t k) {
            MeshShare& share = *body.mesh->share();
            auto vertices = from.list<std::int32_t>(), elements = from.list<std::int32_t>();
            checks::wanted(vertices, body.mesh->vertices(), "vertex",
                           [&](std::int32_t v) { return share.owner[std::size_t(v)] == s.rank(); });
            checks::wanted(elements, body.mesh->elements(), "element", [&](std::int32_t e) {
                return !all_keep && body.mesh->kept() > 0 &&
                       owner[k][first_vertex(body, e)] == s.rank();
            });
            share.give[std::size_t(r)] = std::move(vertices);
            asked[std::size_t(r)][k] = std::move(elements);
        });
    });
    std::vector<typename ElementMesh<X, T, D>::OnHost> on_host;
    each_mesh([&](Body& body, std::size_t k) {
        on_host.push_back(body.mesh->on_host());
        const ElementsView<T, D>& mesh = on_host.back().view;
        const std::size_t kept = body.mesh->kept();
        body.mesh->share()->list_peers();
        for (std::size_t r = 0; r < ranks; ++r) {
            detail::put_places<T, D>(packers[r], mesh.cells, mesh.beyond,
                                     body.mesh->share()->give[r]);
            for (const std::int32_t e : asked[r][k])
                packers[r].put(mesh.kept + std::size_t(e) * kept, kept);
        }
    });
    exchange("places of vertices", [&](int r, Unpacker& from) {
        each_mesh([&](Body& body, std::size_t k) {
            const ElementsView<T, D>& mesh = on_host[k].view;
            const std::size_t kept = body.mesh->kept();
            detail::get_places<T, D>(from, mesh, body.mesh->share()->need[std::size_t(r)]);
            for (const std::int32_t e : keeps[std::size_t(r)][k])
                from.get(mesh.kept + std::size_t(e) * kept, kept);
        });
    });
    each_mesh([&](Body& body, std::size_t k) { body.mesh->take(on_host[k]); });
    if constexpr (X::is_device) link_places();
}

/// Devices: where each rank reads what others give it in each step, and whether any does.
template <class X, class T, int D>
void Domain<X, T, D>::link_places() {
    RankShare<D>& s = *share_;
    bool any = false;
    s.vertices_a_step = 0;
    each_mesh([&](Body& body, std::size_t) {
        MeshSwap<X, T, D>& swap = body.mesh->swap();
        swap.list(*body.mesh->share());
        s.vertices_a_step += swap.bytes_a_step();
        any = any || !body.mesh->share()->peers.empty();
        if (!reaches()) return;
        std::vector<typename MeshSwap<X, T, D>::Piece> mine;
        for (int r = 0; r < s.ranks(); ++r) mine.push_back(swap.given(std::size_t(r)));
        const auto told = s.comm->all_gather_alike(mine, "where its vertices are");
        for (const int r : s.comm->others())
            swap.read_at(std::size_t(r), told[std::size_t(r)].at(std::size_t(s.rank())));
    });
    // All meet, or none.
    s.swaps_places = false;
    for (const bool theirs : s.comm->tell(int(any), "whether elements cross a cut"))
        s.swaps_places = s.swaps_places || theirs;
}

/// Once a step, when vertices have moved: where those are that the others' elements have too.
template <class X, class T, int D>
void Domain<X, T, D>::swap_places() {
    RankShare<D>& s = *share_;
    if constexpr (X::is_device) {
        if (!s.swaps_places) return;
        // Before anyone packs again, all have met once more for their votes.
        each_mesh(
            [&](Body& body, std::size_t) { body.mesh->swap().pack(exec_, body.mesh->view()); });
        if (reaches()) {
            meeting_->meet();
        } else {
            std::vector<Parcel> out, in;
            each_mesh([&](Body& body, std::size_t) { body.mesh->swap().add_parcels(out, in); });
            meeting_->swap(out, in);
        }
        each_mesh(
            [&](Body& body, std::size_t) { body.mesh->swap().unpack(exec_, body.mesh->view()); });
        return;
    }
    std::vector<int> peers;
    each_mesh([&](Body& body, std::size_t) {
        const MeshShare& share = *body.mesh->share();
        peers.insert(peers.end(), share.peers.begin(), share.peers.end());
    });
    std::sort(peers.begin(), peers.end());
    peers.erase(std::unique(peers.begin(), peers.end()), peers.end());
    if (peers.empty()) return;
    std::vector<Bytes> out{std::size_t(s.ranks())};
    for (const int r : peers) {
        Packer packer;
        each_mesh([&](Body& body, std::size_t) {
            const ElementsView<T, D> mesh = body.mesh->view();
            detail::put_places<T, D>(packer, mesh.cells, mesh.beyond,
                                     body.mesh->share()->give[std::size_t(r)]);
        });
        out[std::size_t(r)] = packer.take();
        s.bytes_of_vertices += out[std::size_t(r)].size();
    }
    s.comm->exchange_and_read(
        std::move(out), peers, "places of vertices", [&](int r, Unpacker& from) {
            each_mesh([&](Body& body, std::size_t) {
                const ElementsView<T, D> mesh = body.mesh->view();
                detail::get_places<T, D>(from, mesh, body.mesh->share()->need[std::size_t(r)]);
            });
        });
}

}  // namespace mpm
