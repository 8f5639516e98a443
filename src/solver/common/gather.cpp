// Dense columns of any engine, by way of what its readers get.
#include <algorithm>
#include <cstring>
#include <new>

#include "mpm/core/error.hpp"
#include "mpm/solver/engine.hpp"

namespace mpm {

namespace {

DenseColumn on_heap(char type, std::vector<std::size_t> shape) {
    DenseColumn out{type, std::move(shape), nullptr};
    const std::size_t bytes = std::max<std::size_t>(out.bytes(), sizeof(double));
    out.data = std::shared_ptr<void>(::operator new(bytes), [](void* p) { ::operator delete(p); });
    return out;
}

}  // namespace

Gathered Engine::gather(int body, const std::vector<std::string>& names,
                        const std::vector<double>& origin, IdRange ids) {
    std::vector<std::string> read;
    for (const auto& name : names)
        if (name != "id") read.push_back(name);
    const Attributes from = attributes(body, read);
    std::vector<std::size_t> rows;
    for (std::size_t k = 0; k < from.id.size(); ++k)
        if (from.id[k] - ids.first < ids.count) rows.push_back(k);
    std::sort(rows.begin(), rows.end(),
              [&](std::size_t a, std::size_t b) { return from.id[a] < from.id[b]; });
    Gathered out;
    if (read.size() < names.size()) {
        DenseColumn& to = out.columns["id"] = on_heap('L', {rows.size()});
        auto* id = static_cast<std::uint64_t*>(to.data.get());
        for (std::size_t k = 0; k < rows.size(); ++k) id[k] = from.id[rows[k]];
    }
    for (const auto& [name, value] : from.values) {
        auto shape = value.shape;
        if (is_of_elements(name)) {  // rows as the mesh has them
            DenseColumn& to = out.columns[name] = on_heap('d', shape);
            std::copy(value.data.begin(), value.data.end(), static_cast<double*>(to.data.get()));
            continue;
        }
        shape[0] = rows.size();
        const std::size_t width = from.id.empty() ? 0 : value.data.size() / from.id.size();
        DenseColumn& to = out.columns[name] = on_heap('d', shape);
        auto* numbers = static_cast<double*>(to.data.get());
        for (std::size_t k = 0; k < rows.size(); ++k) {
            for (std::size_t a = 0; a < width; ++a) {
                const bool shifted = name == "position" && a < origin.size();
                numbers[k * width + a] =
                    value.data[rows[k] * width + a] + (shifted ? origin[a] : 0.0);
            }
        }
    }
    return out;
}

void Engine::assign(const Assignment& /*given*/) {
    throw SceneError(
        "particles are given values while the simulation runs on functions over cells or on "
        "several ranks, which is not built; take square cells and one device");
}

DenseColumn Engine::duplicate(const DenseColumn& column) {
    DenseColumn out = on_heap(column.type, column.shape);
    std::memcpy(out.data.get(), column.data.get(), column.bytes());
    return out;
}

void Engine::copy_out(const DenseColumn& column, void* to) {
    std::memcpy(to, column.data.get(), column.bytes());
}

}  // namespace mpm
