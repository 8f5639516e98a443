#include "mpm/solver/merged.hpp"

#include <algorithm>
#include <cmath>
#include <numeric>

#include "mpm/solver/element_mesh.hpp"
#include "mpm/solver/faults.hpp"
#include "mpm/solver/saved_state.hpp"

namespace mpm {

namespace {

/// Velocities of single particles are held in memory; bodies with different ones are merged up to
/// this many particles.
constexpr std::uint64_t most_with_velocities = 1u << 24;
/// Ids of one body have 32 bits.
constexpr std::uint64_t most_ids = (std::uint64_t(1) << 32) - 256;

bool alike(const BodySpec& a, const BodySpec& b, int dimension) {
    // Nothing has been checked yet: what does not fit is left for the plan to refuse.
    const std::size_t corners = 2 * std::size_t(dimension);
    return !a.rigid.given && !b.rigid.given &&  // each has a motion of its own
           a.elements.empty() == b.elements.empty() && a.vertex_volumes == b.vertex_volumes &&
           a.elements.size() + b.elements.size() < most_ids && a.damping == b.damping &&
           a.tractions.empty() && b.tractions.empty() && a.pins.empty() && b.pins.empty() &&
           a.element_stress.empty() && b.element_stress.empty() &&
           (a.elements.empty() || ids_of(a) + ids_of(b) < most_ids / 2) &&
           a.restored == b.restored && a.bounds.size() == corners && b.bounds.size() == corners &&
           a.material == b.material && a.parameters == b.parameters &&
           // Equal boxes elsewhere differ by the rounding of their edges.
           std::abs(a.particle_mass - b.particle_mass) <= 1e-12 * a.particle_mass &&
           a.smoothing == b.smoothing && a.shifts == b.shifts && a.density == b.density &&
           a.smoothing_time == b.smoothing_time && a.smoothing_ratio == b.smoothing_ratio &&
           a.keep == b.keep && a.shift == b.shift &&
           // Cells and nodal means are a body's own.
           !works_between_parts(a) && !works_between_parts(b) && a.guard == b.guard &&
           a.held_by == b.held_by && bool(a.pressure) == bool(b.pressure) &&
           bool(a.state) == bool(b.state) && a.state_width == b.state_width &&
           a.first_id + ids_of(a) == b.first_id && a.count > 0 && b.count > 0 &&
           ids_of(a) + ids_of(b) < most_ids &&
           ((a.velocity == b.velocity && a.velocity_gradient == b.velocity_gradient) ||
            ids_of(a) + ids_of(b) <= most_with_velocities);
}

/// So many numbers a particle from as many for all, or from none, which are zeros.
std::vector<double> spread(const std::vector<double>& numbers, std::uint64_t count,
                           std::size_t width) {
    if (numbers.size() == count * width) return numbers;
    std::vector<double> out(count * width);
    for (std::size_t k = 0; k < out.size() && !numbers.empty(); ++k) out[k] = numbers[k % width];
    return out;
}
/// What two bodies have, one after the other; once for all where they have the same.
void append(std::vector<double>& to, std::uint64_t count, const std::vector<double>& more,
            std::uint64_t added, std::size_t width) {
    if (to == more && to.size() <= width) return;
    to = spread(to, count, width);
    const auto rest = spread(more, added, width);
    to.insert(to.end(), rest.begin(), rest.end());
}

Rows one_after_another(Rows a, std::uint64_t count, Rows b, int width) {
    if (!a) return {};
    const bool at_hand = a.at_hand && b.at_hand;
    Rows rows([a = std::move(a), b = std::move(b), count, width](std::uint64_t first,
                                                                 std::uint64_t last, double* out) {
        const std::uint64_t middle = std::clamp(count, first, last);
        if (first < middle) a(first, middle, out);
        if (middle < last)
            b(middle - count, last - count, out + (middle - first) * std::uint64_t(width));
    });
    rows.at_hand = at_hand;
    return rows;
}

void append(BodySpec& to, const BodySpec& b, int dimension) {
    if (to.position) {
        const std::size_t d = std::size_t(dimension);
        append(to.velocity, to.count, b.velocity, b.count, d);
        append(to.velocity_gradient, to.count, b.velocity_gradient, b.count, d * d);
    }
    to.position = one_after_another(std::move(to.position), to.count, b.position, dimension);
    to.pressure = one_after_another(std::move(to.pressure), to.count, b.pressure, 1);
    to.state = one_after_another(std::move(to.state), to.count, b.state, to.state_width);
    if (!to.ids.empty() || !b.ids.empty()) {
        const auto add = [&](const BodySpec& body, std::uint64_t shift) {
            for (std::uint64_t k = 0; k < body.count; ++k)
                to.ids.push_back(std::uint32_t(shift + (body.ids.empty() ? k : body.ids[k])));
        };
        if (to.ids.empty()) add(BodySpec(to), 0);
        add(b, ids_of(to));
    }
    for (const GroupOfIds& g : b.groups)
        if (to.groups.empty() || to.groups.back().group != g.group)
            to.groups.push_back({ids_of(to) + g.first, g.group});
    for (const FieldOfIds& f : b.fields)
        if (to.fields.empty() || to.fields.back().field != f.field)
            to.fields.push_back({ids_of(to) + f.first, f.field});
    for (const std::int32_t v : b.elements) to.elements.push_back(v + std::int32_t(ids_of(to)));
    to.id_count = ids_of(to) + ids_of(b);
    to.count += b.count;
    for (int a = 0; a < dimension; ++a) {
        to.bounds[a] = std::min(to.bounds[a], b.bounds[a]);
        to.bounds[dimension + a] = std::max(to.bounds[dimension + a], b.bounds[dimension + a]);
    }
}

class Merged final : public Engine {
public:
    Merged(const Spec& spec, MergedSpec merged,
           const std::function<std::unique_ptr<Engine>(const Spec&)>& make)
        : body_of_(std::move(merged.body_of)), inner_(make(merged.spec)) {
        for (const auto& b : spec.bodies)
            bodies_.push_back({b.name, b.first_id, b.count, ids_of(b), 0,
                               b.elements.size() / std::size_t(spec.dimension + 1)});
        for (std::size_t b = 1; b < bodies_.size(); ++b)
            if (body_of_[b] == body_of_[b - 1])
                bodies_[b].first_element = bodies_[b - 1].first_element + bodies_[b - 1].elements;
        for (const auto& b : merged.spec.bodies) together_.push_back({b.count, ids_of(b)});
    }

    RunResult run(std::int64_t steps, double until, double wall) override {
        columns_ = {};
        RunResult r = inner_->run(steps, until, wall);
        if (!r.fault.ids.empty()) {
            const Body& b = bodies_[owner(r.fault.ids[0])];
            r.fault.body = b.name;
            if (r.fault.element >= 0) {
                r.fault.element -= std::int64_t(b.first_element);
                name_element(r.fault, b.first_id);
            }
        }
        return r;
    }
    double time() const override { return inner_->time(); }
    std::int64_t step() const override { return inner_->step(); }
    double time_step() const override { return inner_->time_step(); }
    std::uint64_t particle_count(int body) const override {
        const int m = body_of_.at(std::size_t(body));
        if (alone(body)) return inner_->particle_count(m);
        if (inner_->particle_count(m) != together_[m].count) count_again(m);
        return bodies_[body].count;
    }
    std::vector<Samples> drain() override { return inner_->drain(); }
    std::vector<Flow> flows() override { return inner_->flows(); }
    SmoothingHistory smoothing(int body) const override {
        return inner_->smoothing(body_of_.at(std::size_t(body)));
    }
    std::vector<Removed> removed() override {
        std::vector<Removed> out;
        for (const Removed& r : inner_->removed()) {
            for (std::size_t b = 0; b < bodies_.size(); ++b) {
                if (body_of_[b] != r.body) continue;
                Removed own;
                own.body = int(b);
                own.step = r.step;
                own.policy = r.policy;
                const std::size_t width = r.position.shape[1];
                for (std::size_t k : rows_of_body(r.ids, int(b))) {
                    own.ids.push_back(r.ids[k]);
                    own.position.data.insert(
                        own.position.data.end(),
                        r.position.data.begin() + std::ptrdiff_t(k * width),
                        r.position.data.begin() + std::ptrdiff_t((k + 1) * width));
                }
                own.position.shape = {own.ids.size(), width};
                if (!own.ids.empty()) out.push_back(std::move(own));
            }
        }
        return out;
    }
    std::vector<std::string> attribute_names(int body) const override {
        return inner_->attribute_names(body_of_.at(std::size_t(body)));
    }
    Attributes attributes(int body, const std::vector<std::string>& names,
                          const Window& window) override {
        const int m = body_of_.at(std::size_t(body));
        if (alone(body)) return inner_->attributes(m, names, window);
        std::vector<std::string> of_rows, of_elements;
        for (const auto& name : names)
            (is_of_elements(name) ? of_elements : of_rows).push_back(name);
        const Columns& all = columns(m, of_rows, window);
        const std::size_t first = all.start[body - first_of(m)];
        const std::size_t last = all.start[body - first_of(m) + 1], n = all.read.id.size();
        Attributes out;
        for (std::size_t q = first; q < last; ++q) out.id.push_back(all.read.id[all.rows[q]]);
        for (const auto& name : of_elements) {
            auto found = columns_.of_elements.find(name);
            if (found == columns_.of_elements.end()) {
                Attributes read = inner_->attributes(m, {name});
                found = columns_.of_elements.emplace(name, std::move(read.values.at(name))).first;
            }
            const Array& from = found->second;
            const Body& b = bodies_[std::size_t(body)];
            const std::size_t width = from.data.size() / from.shape[0];
            const auto row = from.data.begin() + std::ptrdiff_t(b.first_element * width);
            Array& to = out.values[name];
            to.shape = from.shape;
            to.shape[0] = b.elements;
            to.data.assign(row, row + std::ptrdiff_t(b.elements * width));
        }
        for (const auto& name : of_rows) {
            const Array& from = all.read.values.at(name);
            Array& to = out.values[name];
            to.shape = from.shape;
            to.shape[0] = last - first;
            const std::size_t width = n == 0 ? 0 : from.data.size() / n;
            to.data.clear();
            to.data.reserve((last - first) * width);
            for (std::size_t q = first; q < last; ++q) {
                const auto row = from.data.begin() + std::ptrdiff_t(all.rows[q] * width);
                to.data.insert(to.data.end(), row, row + std::ptrdiff_t(width));
            }
        }
        return out;
    }
    Gathered gather(int body, const std::vector<std::string>& names,
                    const std::vector<double>& origin, IdRange ids) override {
        const Body& b = bodies_.at(std::size_t(body));
        std::vector<std::string> of_rows, of_elements;
        for (const auto& name : names)
            (is_of_elements(name) ? of_elements : of_rows).push_back(name);
        Gathered out = inner_->gather(body_of_[std::size_t(body)], of_rows, origin,
                                      ids.within({b.first_id, b.ids}));
        if (of_elements.empty()) return out;
        for (auto& [name, column] : Engine::gather(body, of_elements, origin, ids).columns)
            out.columns[name] = std::move(column);
        return out;
    }
    DenseColumn duplicate(const DenseColumn& column) override { return inner_->duplicate(column); }
    void copy_out(const DenseColumn& column, void* to) override { inner_->copy_out(column, to); }
    void assign(const Assignment& given) override {
        Assignment all = given;
        all.body = body_of_.at(std::size_t(given.body));
        columns_ = {};
        inner_->assign(all);
    }
    Array grid(const std::string& name, const Window& window) override {
        return inner_->grid(name, window);
    }
    NodalSums sums(const Window& window) override { return inner_->sums(window); }
    Condition condition(int samples) override {
        Condition c = inner_->condition(samples);
        const auto merged = std::move(c.volume_ratio);
        c.volume_ratio.clear();
        c.moving.clear();
        for (int m : body_of_) c.volume_ratio.push_back(merged[std::size_t(m)]);
        return c;
    }
    State save() override {
        State s = inner_->save();
        if (s.empty()) return s;  // another rank has it
        s["body_of"] = detail::to_blob(std::vector<std::int32_t>(body_of_.begin(), body_of_.end()));
        return s;
    }
    void check(const State& state) const override {
        const SavedState saved(state);
        if (saved.has("body_of") && saved.list<std::int32_t>("body_of") !=
                                        std::vector<std::int32_t>(body_of_.begin(), body_of_.end()))
            refuse_entry("body_of", "stores bodies together that this scene does not",
                         "the same groups of bodies");
        inner_->check(state);
    }
    void load(const State& state) override {
        check(state);
        columns_ = {};
        inner_->load(state);
        for (Together& t : together_) t.count = unknown;
    }
    std::map<std::string, double> timings() const override { return inner_->timings(); }
    std::map<std::string, double> statistics() const override { return inner_->statistics(); }

private:
    struct Body {
        std::string name;
        std::uint64_t first_id, count, ids;
        std::size_t first_element, elements;  // the first among those of the merged body
    };

    struct Together {
        std::uint64_t count, ids;
    };
    static constexpr std::uint64_t unknown = ~std::uint64_t(0);

    /// What has been read of one merged body since it last changed: with hundreds of bodies, each
    /// read of one of them would otherwise gather all.
    struct Columns {
        int merged = -1;
        Window window;
        Attributes read;
        std::map<std::string, Array> of_elements;
        std::vector<std::size_t> rows;   // body by body, in the order of storage
        std::vector<std::size_t> start;  // (bodies + 1,) in `rows`
    };

    /// Numbers that are held at most until the next step; more are gathered anew at each read.
    static constexpr std::size_t most_held = std::size_t(1) << 26;

    const Columns& columns(int merged, const std::vector<std::string>& names,
                           const Window& window) {
        if (columns_.merged != merged || !(columns_.window == window)) columns_ = {};
        std::vector<std::string> missing;
        for (const auto& name : names)
            if (columns_.read.values.count(name) == 0) missing.push_back(name);
        if (columns_.merged == merged && missing.empty()) return columns_;
        Attributes more = inner_->attributes(merged, missing, window);
        std::size_t held = 0;
        for (const auto* part : {&columns_.read, &more})
            for (const auto& column : part->values) held += column.second.data.size();
        if (held > most_held && missing.size() < names.size())
            more = inner_->attributes(merged, names, window);
        if (held > most_held) columns_.read.values.clear();
        columns_.read.values.merge(more.values);
        if (columns_.merged == merged) return columns_;
        columns_.merged = merged;
        columns_.window = window;
        columns_.read.id = std::move(more.id);
        const auto& id = columns_.read.id;
        std::vector<std::size_t> body(id.size());
        columns_.start.assign(std::size_t(std::count(body_of_.begin(), body_of_.end(), merged)) + 1,
                              0);
        for (std::size_t k = 0; k < id.size(); ++k) {
            body[k] = owner(merged, id[k]) - std::size_t(first_of(merged));
            ++columns_.start[body[k] + 1];
        }
        std::partial_sum(columns_.start.begin(), columns_.start.end(), columns_.start.begin());
        columns_.rows.resize(id.size());
        auto next = columns_.start;
        for (std::size_t k = 0; k < id.size(); ++k) columns_.rows[next[body[k]]++] = k;
        return columns_;
    }

    /// Bodies of a merged one follow each other.
    int first_of(int merged) const {
        return int(std::lower_bound(body_of_.begin(), body_of_.end(), merged) - body_of_.begin());
    }

    /// After particles have gone, or a state has come: who has how many is for their ids to say.
    void count_again(int merged) const {
        for (std::size_t b = 0; b < bodies_.size(); ++b)
            if (body_of_[b] == merged) bodies_[b].count = 0;
        for (std::uint64_t id : inner_->attributes(merged, {}).id)
            ++bodies_[owner(merged, id)].count;
        together_[merged].count = inner_->particle_count(merged);
    }

    bool alone(int body) const {
        return bodies_[body].ids == together_[body_of_.at(std::size_t(body))].ids;
    }
    std::size_t owner(std::uint64_t id) const {
        for (std::size_t b = 0; b < bodies_.size(); ++b)
            if (id - bodies_[b].first_id < bodies_[b].ids) return b;
        return 0;
    }
    /// The same among those of a merged body, whose ids follow the list.
    std::size_t owner(int merged, std::uint64_t id) const {
        const auto range = std::equal_range(body_of_.begin(), body_of_.end(), merged);
        const auto first = bodies_.begin() + (range.first - body_of_.begin());
        const auto after = std::upper_bound(
            first, bodies_.begin() + (range.second - body_of_.begin()), id,
            [](std::uint64_t wanted, const Body& b) { return wanted < b.first_id; });
        return std::size_t(after - bodies_.begin()) - 1;
    }
    std::vector<std::size_t> rows_of_body(const std::vector<std::uint64_t>& ids, int body) const {
        std::vector<std::size_t> rows;
        for (std::size_t k = 0; k < ids.size(); ++k)
            if (ids[k] - bodies_[body].first_id < bodies_[body].ids) rows.push_back(k);
        return rows;
    }

    mutable std::vector<Body> bodies_;  // their counts when together_ last changed
    std::vector<int> body_of_;          // ascending
    Columns columns_;
    mutable std::vector<Together> together_;  // each merged body
    std::unique_ptr<Engine> inner_;
};

}  // namespace

MergedSpec merge_alike(const Spec& spec) {
    MergedSpec out;
    out.spec = spec;
    out.spec.bodies.clear();
    std::vector<bool> asked_for(spec.bodies.size(), false);
    for (const auto& s : spec.sensors) {
        const bool one = s.kind == SensorKind::energy || s.kind == SensorKind::wave_gauge;
        if (one && s.body >= 0) asked_for.at(std::size_t(s.body)) = true;
    }
    for (const auto& inlet : spec.inlets) asked_for.at(std::size_t(inlet.body)) = true;
    if (!spec.stored_as.empty() && spec.stored_as.size() != spec.bodies.size())
        throw SceneError("the saved state is of " + std::to_string(spec.stored_as.size()) +
                         " bodies; this scene has " + std::to_string(spec.bodies.size()));
    for (std::size_t b = 0; b < spec.bodies.size(); ++b) {
        const bool joins = spec.stored_as.empty()
                               ? b > 0 && !asked_for[b] && !asked_for[b - 1] &&
                                     alike(out.spec.bodies.back(), spec.bodies[b], spec.dimension)
                               : b > 0 && spec.stored_as[b] == spec.stored_as[b - 1];
        if (joins && (asked_for[b] || asked_for[b - 1]))
            throw SceneError("a sensor asks for body '" + spec.bodies[b].name +
                             "' or the one before it, which the saved state holds as one");
        if (joins)
            append(out.spec.bodies.back(), spec.bodies[b], spec.dimension);
        else
            out.spec.bodies.push_back(spec.bodies[b]);
        out.body_of.push_back(int(out.spec.bodies.size()) - 1);
    }
    for (auto& s : out.spec.sensors) {
        if (s.body >= 0) s.body = out.body_of.at(std::size_t(s.body));
        for (TallySpec& t : s.tallies) t.body = out.body_of.at(std::size_t(t.body));
    }
    for (auto& inlet : out.spec.inlets) inlet.body = out.body_of.at(std::size_t(inlet.body));
    return out;
}

Plan plan_scene(const Spec& spec, const BackendTraits& backend) {
    Plan plan = make_plan(spec, backend);
    const Plan runs = make_plan(merge_alike(spec).spec, backend);
    plan.kernels = runs.kernels;
    plan.memory_sort = runs.memory_sort;
    // Blocks of each field count, which the bounds of merged bodies do not tell.
    if (spec.contact.any()) return plan;
    plan.memory_grid = runs.memory_grid;
    plan.memory_tables = runs.memory_tables;
    return plan;
}

std::unique_ptr<Engine> make_merged(
    const Spec& spec, const std::function<std::unique_ptr<Engine>(const Spec&)>& make) {
    MergedSpec merged = merge_alike(spec);
    if (merged.spec.bodies.size() == spec.bodies.size()) return make(spec);
    // What is wrong with a mesh is said of the body that has it.
    for (const BodySpec& b : spec.bodies) {
        if (b.elements.empty() || !b.position) continue;
        std::vector<double> position(std::size_t(b.count) * std::size_t(spec.dimension));
        b.position(0, b.count, position.data());
        check_mesh(b.name, spec.dimension, position, b.elements, spec.cell_size);
    }
    return std::make_unique<Merged>(spec, std::move(merged), make);
}

}  // namespace mpm
