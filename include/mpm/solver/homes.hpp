// Which slots of a table of blocks hold something: particles of a body, or nodes that a load cell
// measures.
#pragma once

#include <cstdint>
#include <vector>

#include "mpm/exec/buffer.hpp"

namespace mpm {

template <class X>
struct Homes {
    std::vector<Buffer<X, std::uint32_t>> flag, position;  // (slots,), and its scan
    std::vector<std::uint32_t> count;

    /// Those of one more body: `mark(flag)` queues what marks them, `number` gets how many.
    template <class Mark>
    void add(X& exec, std::int64_t slots, std::uint32_t* number, const Mark& mark) {
        auto& of_body = flag.emplace_back(exec);
        auto& scan = position.emplace_back(exec);
        of_body.reserve_discard(std::size_t(slots));
        scan.reserve_discard(std::size_t(slots) + 1);
        mark(of_body);
        exec.exclusive_scan(of_body.data(), scan.data(), slots);
        exec.copy(number, scan.data() + slots, sizeof(std::uint32_t));
    }
};

}  // namespace mpm
