// Domain: fields of velocities, and the blocks in which several of them meet.
#pragma once

#include "mpm/solver/domain.hpp"
#include "mpm/solver/rank_fields.hpp"

namespace mpm {

template <class X, class T, int D>
void Domain<X, T, D>::set_contact() {
    const ContactSpec& c = spec_.contact;
    if (!c.any()) return;
    if (table_.keys_of.bits() > 62)
        throw CapacityError("the domain has more than 2^62 blocks of " + std::to_string(c.fields) +
                            " fields of velocities; use a larger cell_size");
    std::vector<double> full;
    for (const double density : c.density) full.push_back(density * std::pow(spec_.cell_size, D));
    contact_laws_.assign(c.laws);
    law_of_.assign(std::vector<std::int32_t>(c.law_of.begin(), c.law_of.end()));
    kind_of_.assign(std::vector<std::int32_t>(c.kind.begin(), c.kind.end()));
    full_.assign(full);
    crowded_.assign({0});
    if constexpr (X::is_device) grid_maxima_.reserve_discard(maxima_count);
}

/// The blocks of the present table with several fields: of several ranks those that this one's
/// homes reach, whose sums and those around it has of all fields.
template <class X, class T, int D>
void Domain<X, T, D>::list_contacts() {
    if (!spec_.contact.any()) return;
    const auto keys = blocks_.keys().host();
    const std::uint64_t fields = std::uint64_t(table_.keys_of.fields);
    std::vector<std::int32_t> first, count, counted;
    for (std::size_t slot = 0, next = 0; slot < keys.size(); slot = next) {
        while (next < keys.size() && keys[next] / fields == keys[slot] / fields) ++next;
        // Rigid bodies, the last of the fields, meet others apart (design/rigid.md).
        std::size_t bending = next;
        while (bending > slot && int(keys[bending - 1] % fields) >= spec_.contact.bending())
            --bending;
        if (bending - slot < 2) continue;
        if (share_ && !detail::holds(share_->reached[std::size_t(share_->rank())],
                                     table_.keys_of.of_block(keys[slot])))
            continue;
        if (counts_slot(slot)) counted.push_back(std::int32_t(first.size()));
        first.push_back(std::int32_t(slot));
        count.push_back(std::int32_t(bending - slot));
    }
    contact_blocks_ = std::int32_t(first.size());
    contact_first_.assign(first);
    contact_count_.assign(count);
    sensors_.measure_contacts(counted);
    if (plan_.filled < 0) return;
    // What contact reads of a node and its neighbours comes from these blocks and those beside.
    const auto neighbours = blocks_.neighbours().host();
    std::vector<std::uint8_t> near(keys.size(), 0);
    for (std::size_t k = 0; k < first.size(); ++k) {
        for (std::int32_t slot = first[k]; slot < first[k] + count[k]; ++slot) {
            near[std::size_t(slot)] = 1;
            for (int n = 0; n < Block<D>::neighbours; ++n) {
                const std::int32_t to =
                    neighbours[std::size_t(slot) * Block<D>::neighbours + std::size_t(n)];
                if (to >= 0) near[std::size_t(to)] = 1;
            }
        }
    }
    near_contact_.assign(near);
}

/// What nodes hold of all their fields comes with the first of these: behind the last slot of the
/// block where this is its first, else the slot itself.
template <class X, class T, int D>
std::size_t Domain<X, T, D>::end_of_fields(const std::vector<std::uint64_t>& keys,
                                           std::size_t slot) const {
    const std::uint64_t fields = std::uint64_t(table_.keys_of.fields);
    if (fields == 1) return slot + 1;
    if (slot > 0 && keys[slot - 1] / fields == keys[slot] / fields) return slot;
    std::size_t end = slot + 1;
    while (end < keys.size() && keys[end] / fields == keys[slot] / fields) ++end;
    return end;
}

template <class X, class T, int D>
ContactView Domain<X, T, D>::contact_view() {
    return {contact_laws_.data(),
            law_of_.data(),
            kind_of_.data(),
            full_.data(),
            std::int32_t(full_.size()),
            contact_first_.data(),
            contact_count_.data(),
            contact_blocks_,
            std::int32_t(plan_.filled),
            std::int32_t(spec_.contact.bending())};
}

/// Contact after the grid update, whose maxima it joins with its own for `decided`.
template <class X, class T, int D>
template <class Decided>
void Domain<X, T, D>::resolve_contacts(const double* maxima, const Decided& decided) {
    const ContactPass<Base, Grid, Sum, D> contact{
        {node_update(parity()), contact_view(), boundaries_.known()},
        groups_.data(),
        int(plan_.groups.size()),
        plan_.kept,
        crowded_.data()};
    exec_.template max_each<maxima_count>(
        std::int64_t(contact_blocks_) * block_cells, contact,
        AfterContact<Decided>{decided, maxima, crowded_.data(), clock_buffer_.data()});
}

}  // namespace mpm
