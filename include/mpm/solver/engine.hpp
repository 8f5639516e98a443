// A simulation as its caller sees it, whatever the backend, precision and dimension.
#pragma once

#include <cstdint>
#include <map>
#include <memory>
#include <string>
#include <utility>
#include <vector>

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

struct Samples {
    std::vector<double> time;
    Array values;
};

struct Attributes {
    std::vector<std::uint64_t> id;
    std::map<std::string, Array> values;
};

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
    virtual std::vector<std::string> attribute_names(int body) const = 0;
    virtual Attributes attributes(int body, const std::vector<std::string>& names) = 0;
    virtual Array grid(const std::string& name) = 0;
    virtual NodalSums sums() = 0;
    virtual State save() = 0;
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
