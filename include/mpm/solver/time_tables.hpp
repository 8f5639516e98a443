// Time tables where kernels read them: of motions, of gravity, of what flows in. They stay where
// they are as long as this lives, and are never written again.
#pragma once

#include <vector>

#include "mpm/data/time_table.hpp"
#include "mpm/exec/buffer.hpp"
#include "mpm/kernels/surface.hpp"
#include "mpm/solver/spec.hpp"

namespace mpm {

template <class X>
class TimeTables {
public:
    explicit TimeTables(X& exec) : exec_(exec) {}

    TimeTableView upload(const TableSpec& table, int components);
    MotionView upload(const MotionSpec& motion, int components);

private:
    X& exec_;
    std::vector<Buffer<X, double>> memory_;
};

template <class X>
TimeTableView TimeTables<X>::upload(const TableSpec& table, int components) {
    memory_.emplace_back(exec_);
    memory_.back().assign(table.time);
    const double* time = memory_.back().data();
    memory_.emplace_back(exec_);
    memory_.back().assign(table.value);
    return {time, memory_.back().data(), std::int32_t(table.time.size()), components, table.end};
}

template <class X>
MotionView TimeTables<X>::upload(const MotionSpec& motion, int components) {
    MotionView view{};
    if (motion.table.time.empty()) return view;
    view.table = upload(motion.table, components);
    if (motion.of_places) return view;
    memory_.emplace_back(exec_);
    memory_.back().assign(motion.travelled());
    view.travelled = memory_.back().data();
    return view;
}

}  // namespace mpm
