// What processes say of their parts is looked at here, before rank_join.cpp makes one of them.
#include <cmath>
#include <cstring>
#include <string>

#include "mpm/data/blocks.hpp"
#include "mpm/exec/communicator.hpp"
#include "mpm/solver/blob.hpp"
#include "mpm/solver/rank_join.hpp"

namespace mpm {

namespace {

[[noreturn]] void refuse(const std::string& what) { throw MessageError(what); }

bool same_bits(double a, double b) { return std::memcmp(&a, &b, sizeof a) == 0; }

/// Whether so many elements are what a shape says.
bool holds(const std::vector<std::size_t>& shape, std::size_t elements) {
    std::size_t n = 1;
    for (const std::size_t size : shape) {
        if (size != 0 && n > elements / size + 1) return false;
        n *= size;
    }
    return !shape.empty() && n == elements;
}

std::size_t size_of_type(char type) {
    const std::size_t size = detail::size_of(type);
    if (size == 0) refuse("with an entry of type '" + std::to_string(int(type)) + "'");
    return size;
}

}  // namespace

void PartCheck::operator()(const RunResult& theirs, const RunResult& mine) const {
    if (theirs.reason != mine.reason || theirs.steps != mine.steps ||
        !same_bits(theirs.time, mine.time))
        refuse("that it has halted for '" + theirs.reason + "' after " +
               std::to_string(theirs.steps) + " steps, where this rank has for '" + mine.reason +
               "' after " + std::to_string(mine.steps));
}

void PartCheck::operator()(const std::vector<Samples>& theirs,
                           const std::vector<Samples>& mine) const {
    if (theirs.size() != mine.size()) refuse("of " + std::to_string(theirs.size()) + " sensors");
    for (std::size_t k = 0; k < mine.size(); ++k)
        if (theirs[k].time != mine[k].time || theirs[k].values.shape != mine[k].values.shape ||
            theirs[k].values.data.size() != mine[k].values.data.size())
            refuse("with " + std::to_string(theirs[k].time.size()) + " samples of sensor " +
                   std::to_string(k) + ", of which this rank has " +
                   std::to_string(mine[k].time.size()) + ", or at other times");
}

void PartCheck::operator()(const std::vector<Removed>& theirs, const std::vector<Removed>&) const {
    for (const Removed& r : theirs) {
        const auto& shape = r.position.shape;
        if (r.body < 0 || std::size_t(r.body) >= bodies || shape.size() != 2 ||
            shape[0] != r.ids.size() || shape[1] != std::size_t(dimension) ||
            !holds(shape, r.position.data.size()))
            refuse("with " + std::to_string(r.position.data.size()) + " coordinates of " +
                   std::to_string(r.ids.size()) + " removed particles of body " +
                   std::to_string(r.body));
    }
}

void PartCheck::operator()(const std::vector<Flow>& theirs, const std::vector<Flow>&) const {
    for (const Flow& f : theirs)
        if (f.number < 0) refuse("with inlet or outlet " + std::to_string(f.number));
}

void PartCheck::operator()(const Condition& theirs, const Condition&) const {
    if (theirs.moving.size() != bodies || theirs.volume_ratio.size() != bodies)
        refuse("of " + std::to_string(theirs.moving.size()) + " bodies");
}

void PartCheck::operator()(double theirs, double) const {
    if (!(theirs >= 0 && theirs <= 0x1p53)) refuse("of " + std::to_string(theirs) + " particles");
}

void PartCheck::operator()(const std::map<std::string, double>& theirs,
                           const std::map<std::string, double>&) const {
    if (theirs.size() > 10'000) refuse("of " + std::to_string(theirs.size()) + " entries");
}

void PartCheck::operator()(const State& theirs, const State& mine) const {
    for (const auto& [name, own] : mine) {
        const auto found = theirs.find(name);
        if (found == theirs.end()) refuse("without '" + name + "'");
        const Blob& blob = found->second;
        const std::size_t size = size_of_type(blob.type);
        if (blob.type != own.type || blob.bytes.size() % size != 0 ||
            !holds(blob.shape, blob.bytes.size() / size))
            refuse("whose '" + name + "' has " + std::to_string(blob.bytes.size()) +
                   " bytes of type '" + std::to_string(int(blob.type)) + "'");
    }
    if (theirs.size() != mine.size())
        refuse("with " + std::to_string(theirs.size()) + " entries in place of " +
               std::to_string(mine.size()));
    for (const char* name :
         {"load_impulse", "contact_impulse", "pin_impulse", "sensor_first", "sum_channels"})
        if (mine.contains(name) && theirs.at(name).shape != mine.at(name).shape)
            refuse("whose '" + std::string(name) + "' has another size");
    if (theirs.at("sum_channels").bytes != mine.at("sum_channels").bytes) refuse("with other sums");
    const std::size_t channels =
        std::size_t(detail::from_blob<std::int32_t>(mine, "sum_channels").at(0));
    const auto keys = detail::from_blob<std::uint64_t>(theirs, "keys");
    for (std::size_t k = 1; k < keys.size(); ++k)
        if (keys[k] <= keys[k - 1])
            refuse("whose blocks do not ascend at " + std::to_string(keys[k]));
    const auto rows = [&](const std::string& name) { return theirs.at(name).shape[0]; };
    if (theirs.at("sums").shape.size() != 1 || rows("sums") % block_cells != 0 ||
        rows("sums") / block_cells != keys.size() * channels)
        refuse("with " + std::to_string(rows("sums")) + " sums of " + std::to_string(keys.size()) +
               " blocks");
    for (std::size_t b = 0; b < bodies; ++b) {
        const std::string p = "body" + std::to_string(b) + "_";
        const auto start = detail::from_blob<std::uint32_t>(theirs, p + "cell_start");
        const auto count = rows(p + "id");
        bool right = start.size() == keys.size() * block_cells + 1 && start.front() == 0 &&
                     start.back() == count;
        for (std::size_t c = 1; c < start.size() && right; ++c) right = start[c - 1] <= start[c];
        if (!right)
            refuse("whose cells of body " + std::to_string(b) + " do not hold its " +
                   std::to_string(count) + " particles");
        for (const auto& [name, blob] : theirs) {
            if (name.rfind(p, 0) != 0 || name == p + "cell_start") continue;
            if (name.rfind(p + "frozen", 0) == 0) {
                const std::size_t frozen = rows(p + "frozen_id");
                if (blob.shape.size() != 1 || (frozen == 0) != (blob.shape[0] == 0) ||
                    (frozen > 0 && blob.shape[0] % frozen != 0))
                    refuse("with " + std::to_string(blob.shape[0]) + " numbers in '" + name +
                           "' for " + std::to_string(frozen) + " ids");
            } else if (name == p + "elements") {
                if (!mine.contains(name) || blob.shape != mine.at(name).shape)
                    refuse("whose '" + name + "' has another size");
            } else if (blob.shape.size() != 1 || blob.shape[0] != count) {
                refuse("with " + std::to_string(blob.shape[0]) + " rows of '" + name + "' for " +
                       std::to_string(count) + " ids");
            }
        }
    }
}

}  // namespace mpm
