// What ranks say of their own parts, made into what one engine would say. Lists are by rank.
#pragma once

#include <map>
#include <string>
#include <vector>

#include "mpm/solver/engine.hpp"

namespace mpm {

/// Rows of one array behind those of another.
void append_rows(Array& to, const Array& from);
/// What another rank has where this one has not a number: rows of elements, of which one has each.
void take_numbers(Array& to, const Array& from);
/// Particles of an engine, of all bodies.
double particles_of(const Engine& engine, std::size_t bodies);

/// What another rank says, looked at beside what this one says of itself. Throws MessageError where
/// the two cannot be joined.
struct PartCheck {
    std::size_t bodies = 0;
    int dimension = 0;
    void operator()(const RunResult& theirs, const RunResult& mine) const;
    void operator()(const std::vector<Samples>& theirs, const std::vector<Samples>& mine) const;
    void operator()(const std::vector<Removed>& theirs, const std::vector<Removed>& mine) const;
    void operator()(const std::vector<Flow>& theirs, const std::vector<Flow>& mine) const;
    void operator()(const Condition& theirs, const Condition& mine) const;
    void operator()(const State& theirs, const State& mine) const;
    void operator()(double theirs, double mine) const;  // a count
    void operator()(const std::map<std::string, double>& theirs,
                    const std::map<std::string, double>& mine) const;
};

/// All have halted for the same reason; of a fault the ranks tell that have its particles.
RunResult join_results(const std::vector<RunResult>& ranks);
/// Every rank has a row at each time: its own part, or of a point the same as all. Rows are those
/// of `finished`, from those of the ranks' rings.
std::vector<Samples> join_samples(const std::vector<SensorSpec>& sensors, int dimension,
                                  const std::vector<std::vector<Samples>>& ranks);
std::vector<Removed> join_removed(const std::vector<std::vector<Removed>>& ranks);
std::vector<Flow> join_flows(const std::vector<std::vector<Flow>>& ranks);
/// Energies and masses are sums over ranks; means are weighted by what they are the means of.
Condition join_conditions(const std::vector<Condition>& ranks, std::size_t bodies);
/// The slowest of each phase: that is what the others have waited for.
std::map<std::string, double> join_timings(const std::vector<std::map<std::string, double>>& ranks);
std::map<std::string, double> join_statistics(
    const std::vector<std::map<std::string, double>>& ranks);
/// What one rank would have saved, but for blocks without mass.
State join_states(const std::vector<State>& ranks, std::size_t bodies);

}  // namespace mpm
