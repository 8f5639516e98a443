// A simulation as its caller sees it, whatever the backend, precision and dimension.
#pragma once

#include <algorithm>
#include <cstdint>
#include <limits>
#include <map>
#include <memory>
#include <string>
#include <utility>
#include <vector>

#include "mpm/core/error.hpp"
#include "mpm/solver/spec.hpp"

namespace mpm {

/// Numbers with a shape, for readers.
struct Array {
    std::vector<std::size_t> shape;
    std::vector<double> data;
};

/// A named piece of a saved state. `type`: 'f' float32, 'd' float64, 'i' int32, 'l' int64, 'I'
/// uint32, 'L' uint64, 'B' bytes.
struct Blob {
    char type = 'B';
    std::vector<std::size_t> shape;
    std::vector<unsigned char> bytes;
};
using State = std::map<std::string, Blob>;

struct Fault {
    std::string code;
    std::string body;
    std::vector<std::uint64_t> ids;
    std::int64_t step = 0;
    double time = 0;
    double value = 0;
    double speed = 0;
    std::int64_t grew_since = 0;
    std::string message;
    std::int64_t element = -1;  // of a body of elements; `ids` are then its vertices
};

struct RunResult {
    std::string reason;
    std::int64_t steps = 0;
    double time = 0;
    Fault fault;
};

struct Removed {
    int body = 0;
    std::vector<std::uint64_t> ids;
    Array position;
    std::int64_t step = 0;
    std::string policy;
};

/// What particles have left at the nodes, before gravity and boundaries.
struct NodalSums {
    std::vector<std::int64_t> cell;                    // (n, dimension)
    std::map<std::string, std::vector<double>> value;  // by channel, (n,)
};

/// Particles that an inlet supplied or an outlet took out at one moment.
struct Flow {
    bool inlet = false;
    int number = 0;  // of the inlet or outlet
    double time = 0;
    std::int64_t step = 0;
    std::uint64_t particles = 0;
    double mass = 0;    // kg
    double volume = 0;  // m^3 at rest
};

struct Samples {
    std::vector<double> time;
    Array values;
};

/// What a guard watches, of all bodies together but the volumes.
struct Condition {
    double kinetic = 0, elastic = 0, potential = 0;  // J (2D: J/m), the last as of a sensor
    double speed = 0;                                // fastest node of the last step, m/s
    double mass = 0;                                 // kg (2D: kg/m)
    // Mass-weighted mean density of the nodes, kg/m^3; not-a-number where there is none.
    double density = std::numeric_limits<double>::quiet_NaN();
    std::vector<double> volume_ratio;  // mean J of each body; not-a-number for an empty one
    // How many particles of each body these are means of; for ranks, to take the mean of all.
    std::vector<std::uint64_t> moving;
};

/// What smoothing over cells did to one body (physics/smoothing.hpp), call after call; where there
/// were very many, several calls make a row.
struct SmoothingHistory {
    /// Time of the row's first call in s, how many, sum m q^2 in kg before the first, its change by
    /// all of them, and I_E of the last.
    struct Row {
        double time, calls, before, change, index;
    };
    std::vector<Row> rows;
    std::int64_t calls_per_row = 1, calls = 0;

    static constexpr std::size_t most_rows = 65536;
    void add(double time, double before, double change, double index) {
        if (calls % calls_per_row == 0) {
            if (rows.size() == most_rows) thin();
            if (calls % calls_per_row == 0) rows.push_back({time, 0, before, 0, 0});
        }
        ++calls;
        Row& row = rows.back();
        row.calls += 1;
        row.change += change;
        row.index = index;
    }

private:
    void thin() {
        for (std::size_t k = 0; k < rows.size() / 2; ++k) {
            const Row a = rows[2 * k], b = rows[2 * k + 1];
            rows[k] = {a.time, a.calls + b.calls, a.before, a.change + b.change, b.index};
        }
        rows.resize(rows.size() / 2);
        calls_per_row *= 2;
    }
};

struct Attributes {
    std::vector<std::uint64_t> id;
    std::map<std::string, Array> values;
};

/// Attributes of bodies of elements whose rows are elements, in the mesh's order.
inline bool is_of_elements(const std::string& attribute) {
    return attribute.rfind("element_", 0) == 0;
}

/// Numbers one after another in the engine's memory: "d" float64 or "L" uint64. The engine must
/// outlive them.
struct DenseColumn {
    char type = 'd';
    std::vector<std::size_t> shape;
    std::shared_ptr<void> data;

    std::size_t bytes() const {
        std::size_t n = 8;
        for (std::size_t k : shape) n *= k;
        return n;
    }
};

/// Columns over particles, rows in the order of ids.
struct Gathered {
    int device = -1;  // that they are on; -1: the host
    std::map<std::string, DenseColumn> columns;
};

struct IdRange {
    std::uint64_t first = 0;
    std::uint64_t count = std::numeric_limits<std::uint64_t>::max();

    /// What it has in common with another one.
    IdRange within(const IdRange& other) const {
        const std::uint64_t low = std::max(first, other.first);
        const std::uint64_t left = low - first < count ? count - (low - first) : 0;
        const std::uint64_t others =
            low - other.first < other.count ? other.count - (low - other.first) : 0;
        return {low, std::min(left, others)};
    }
};

/// Where a reader looks: boxes, m from the lower corner of the domain; none: everywhere. Of
/// particles it gets those that lie in them, of nodes all of the blocks that they touch.
struct Window {
    std::vector<double> low, high;  // (boxes, dimension), sides may be infinite
    bool everywhere() const { return low.empty(); }
    bool operator==(const Window&) const = default;
};

/// What particles of one body are given at the boundary of a step; rows as in `id`.
struct Assignment {
    int body = 0;
    std::vector<std::uint64_t> id;  // (n,), each once
    std::vector<double> change;     // (n, dimension) added to their velocities, m/s, or none
    // (n, width) in place of the first `width` numbers that their material stores, or none
    std::vector<double> state;
    int width = 0;
    std::vector<double> pressure;  // (n,) Pa, of fluids, or none
};

/// Refuses a name that nodes have no values of.
inline void check_grid_attribute(const std::string& name) {
    if (name != "position" && name != "velocity" && name != "mass")
        throw SceneError("grid has no attribute '" + name + "'; it has position, velocity, mass");
}

class Engine {
public:
    Engine() = default;
    Engine(const Engine&) = delete;
    Engine& operator=(const Engine&) = delete;
    virtual ~Engine() = default;

    virtual RunResult run(std::int64_t steps, double until, double wall) = 0;
    virtual double time() const = 0;
    virtual std::int64_t step() const = 0;
    virtual double time_step() const = 0;
    virtual std::uint64_t particle_count(int body) const = 0;
    virtual std::vector<Samples> drain() = 0;
    virtual std::vector<Removed> removed() = 0;
    /// What came and went since the last call.
    virtual std::vector<Flow> flows() = 0;
    /// Of a body, since the engine was made; empty where nothing is smoothed over cells.
    virtual SmoothingHistory smoothing(int body) const = 0;
    virtual std::vector<std::string> attribute_names(int body) const = 0;
    /// Of a body of elements always of everything.
    virtual Attributes attributes(int body, const std::vector<std::string>& names,
                                  const Window& window = {}) = 0;
    /// The same as dense columns of the caller's own where the engine's memory is; `origin`
    /// (dimension,) m is added to positions. "id" is an attribute here.
    virtual Gathered gather(int body, const std::vector<std::string>& names,
                            const std::vector<double>& origin, IdRange ids = {});
    virtual DenseColumn duplicate(const DenseColumn& column);
    virtual void copy_out(const DenseColumn& column, void* to);
    /// Changes particles and, by what these add to them, nodal sums. What is refused leaves the
    /// engine as it was.
    virtual void assign(const Assignment& given);
    virtual Array grid(const std::string& name, const Window& window = {}) = 0;
    virtual NodalSums sums(const Window& window = {}) = 0;
    /// At a halt; the volumes from about `samples` particles.
    virtual Condition condition(int samples) = 0;
    virtual State save() = 0;
    /// Raises `SceneError` unless `load` would take the state; changes nothing.
    virtual void check(const State& state) const = 0;
    /// What is refused leaves the engine as it was.
    virtual void load(const State& state) = 0;
    virtual std::map<std::string, double> timings() const = 0;
    virtual std::map<std::string, double> statistics() const = 0;
};

/// Names of a sensor's columns and their units.
std::pair<std::vector<std::string>, std::vector<std::string>> sensor_columns(const Spec& spec,
                                                                             int sensor);

std::unique_ptr<Engine> make_cpu_engine(const Spec& spec);
std::unique_ptr<Engine> make_cuda_engine(const Spec& spec);
/// For scenes on functions over cells (Spec::functions).
std::unique_ptr<Engine> make_functions_engine(const Spec& spec);

}  // namespace mpm
