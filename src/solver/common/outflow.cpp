#include "mpm/solver/outflow.hpp"

namespace mpm {

template <int D>
Outflow<D>::Outflow(const Spec& spec)
    : outlets_(spec.outlets), leaving_(spec.leaving), cells_(spec.cells) {}

template <int D>
int Outflow<D>::outlet_of(const Leaver<D>& who) const {
    for (std::size_t k = 0; k < outlets_.size(); ++k) {
        const int a = outlets_[k].face / 2;
        const bool upper = outlets_[k].face % 2 != 0;
        if (upper ? who.cell[a] >= cells_[std::size_t(a)] : who.cell[a] < 0) return int(k);
    }
    return -1;
}

template <int D>
std::vector<typename Outflow<D>::Way> Outflow<D>::ways(int body, std::uint64_t first_id,
                                                       std::int64_t step,
                                                       const std::vector<Leaver<D>>& left) const {
    const std::size_t outlets = outlets_.size();
    const char* policy =
        leaving_ == Leaving::freeze ? "freeze" : (leaving_ == Leaving::remove ? "delete" : "stop");
    std::vector<Way> ways(outlets + 1);
    for (std::size_t k = 0; k <= outlets; ++k) {
        Removed& r = ways[k].removed;
        r.body = body;
        r.step = step;
        r.policy = k < outlets ? "outflow:" + outlets_[k].name : policy;
        ways[k].outlet = k < outlets ? int(k) : -1;
    }
    for (const Leaver<D>& who : left) {
        const int outlet = outlet_of(who);
        Way& way = ways[outlet < 0 ? outlets : std::size_t(outlet)];
        way.place.push_back(who.place);
        way.id.push_back(who.id);
        way.removed.ids.push_back(first_id + who.id);
        for (int a = 0; a < D; ++a) way.removed.position.data.push_back(who.position[a]);
    }
    for (Way& way : ways) way.removed.position.shape = {way.removed.ids.size(), std::size_t(D)};
    return ways;
}

template <int D>
std::vector<Flow> Outflow<D>::take(std::vector<Way> ways, double time, std::int64_t step,
                                   const std::vector<std::array<double, 2>>& mass_and_volume) {
    std::vector<Flow> flows, out;
    for (std::size_t k = 0; k < outlets_.size(); ++k)
        flows.push_back({false, int(k), time, step, 0, 0, 0});
    for (Way& way : ways) {
        Removed& r = way.removed;
        const std::size_t n = r.ids.size();
        if (n == 0) continue;
        if (way.outlet >= 0) {
            Flow& flow = flows[std::size_t(way.outlet)];
            const auto& [mass, volume] = mass_and_volume[std::size_t(r.body)];
            flow.particles += n;
            flow.mass += double(n) * mass;
            flow.volume += double(n) * volume;
        }
        removed_.push_back(std::move(r));
    }
    for (const Flow& flow : flows)
        if (flow.particles > 0) out.push_back(flow);
    return out;
}

template class Outflow<2>;
template class Outflow<3>;

}  // namespace mpm
