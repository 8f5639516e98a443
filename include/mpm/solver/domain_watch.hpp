// Domain: what a guard asks for at a halt. It changes nothing but recomputable numbers and keeps no
// memory of its own.
#pragma once

#include "mpm/kernels/watching.hpp"
#include "mpm/solver/domain.hpp"

namespace mpm {

template <class X, class T, int D>
Condition Domain<X, T, D>::condition(int samples) {
    Condition out;
    prepare_velocities();
    out.speed = clock_.speed;
    // As a sensor that is due; the clock must not keep its passes from running.
    const Clock kept = clock_;
    clock_.halt = Halt::none;
    push_clock();
    exec_.single(begin_step());  // gravity of this moment
    Sensor<Base> all(exec_);
    all.spec.body = -1;
    all.times.reserve_discard(1);
    all.values.assign(std::vector<double>(4, std::numeric_limits<double>::quiet_NaN()));
    all.first.assign({0.0});
    SensorRecord due{};
    due.due = due.capacity = 1;
    due.columns = 4;
    due.times = all.times.data();
    due.values = all.values.data();
    Buffer<X, SensorRecord> record(exec_);
    record.assign({due});
    if (!dead_) sample_energy(all, record.data());

    const std::int64_t nodes = std::int64_t(table_.slots) * block_cells;
    const std::int64_t parts = exec_.sum_parts(nodes);
    Buffer<X, SumSet> set(exec_);
    Buffer<X, double> partial(exec_), packing(exec_);
    set.assign({SumSet{0, nodes, 0, std::int32_t(parts)}});
    partial.reserve_discard(std::size_t(parts) * 2);
    packing.assign({0.0, 0.0});
    exec_.template sum_each<2>(
        SumSets{set.data(), 1, std::int32_t(parts)},
        AddPacking<Grid, Sum, D>{node_update(parity()), share_ ? counts_.data() : nullptr},
        KeepPacking{packing.data()}, partial.data(), 0, Nothing{});
    exec_.wait();
    clock_ = kept;
    push_clock();

    const auto energy = all.values.host();
    out.kinetic = energy[0];
    out.elastic = energy[1];
    out.potential = energy[2];
    const auto mass = packing.host();
    double cell = 1;
    for (int a = 0; a < D; ++a) cell *= spec_.cell_size;
    out.mass = mass[0];
    if (mass[0] > 0) out.density = mass[1] / (mass[0] * cell);

    std::uint64_t count = 0;
    for (const auto& b : bodies_) count += b.count;
    for (auto& body : bodies_) {
        out.volume_ratio.push_back(std::numeric_limits<double>::quiet_NaN());
        out.moving.push_back(body.count);
        if (body.count == 0) continue;
        if (body.mesh) {
            out.volume_ratio.back() = mean_volume_ratio(body, int(out.volume_ratio.size()) - 1);
            continue;
        }
        const int columns = body.plan.state_columns;
        const std::int64_t wanted = std::max<std::int64_t>(
            64, std::int64_t(double(samples) * double(body.count) / double(count)));
        const std::int64_t stride = std::max<std::int64_t>(1, std::int64_t(body.count) / wanted);
        const std::int64_t n = (std::int64_t(body.count) + stride - 1) / stride;
        Buffer<X, double> state(exec_);
        state.reserve_discard(std::size_t(n * columns));
        exec_.for_each(n, TakeStates<T, D>{body.view(), columns, stride, state.data()});
        exec_.wait();
        const auto taken = state.host();
        const double still[D][D] = {};
        double sum = 0;
        for (std::int64_t k = 0; k < n; ++k) {
            const double* s = taken.data() + k * columns;
            sum += body.material->volumetric
                       ? 1 - s[0]
                       : body.ops.observe(s, still, body.parameters.data()).volume_ratio;
        }
        out.volume_ratio.back() = sum / double(n);
    }
    return out;
}

}  // namespace mpm
