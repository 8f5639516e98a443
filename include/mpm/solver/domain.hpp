// One simulation on one executor: owns the state, runs the life of a step, sorts. Written once for
// both backends; they differ in the executor X and in how the passes over particles run.
//
//   begin    gravity and boundaries of this moment
//   grid     sums -> velocities, boundaries, averages; clears the other sums; maxima
//   decide   sort first? sample? stop? how long is the next step?
//   sample   sensors that are due; loads that accumulate
//   bodies   gather, advance, move, deposit into the other sums
//   end      time moves on
#pragma once

#include <algorithm>
#include <array>
#include <chrono>
#include <cmath>
#include <cstdio>
#include <exception>
#include <limits>

#include "mpm/core/error.hpp"
#include "mpm/exec/buffer.hpp"
#include "mpm/exec/sums.hpp"
#include "mpm/kernels/arrange.hpp"
#include "mpm/kernels/cell_sums.hpp"
#include "mpm/kernels/contact_pass.hpp"
#include "mpm/kernels/grid.hpp"
#include "mpm/kernels/order.hpp"
#include "mpm/kernels/phase_ops.hpp"
#include "mpm/kernels/sampling.hpp"
#include "mpm/kernels/sorting.hpp"
#include "mpm/kernels/supplying.hpp"
#include "mpm/kernels/sweep.hpp"
#include "mpm/kernels/telling.hpp"
#include "mpm/solver/block_table.hpp"
#include "mpm/solver/body_store.hpp"
#include "mpm/solver/boundaries.hpp"
#include "mpm/solver/engine.hpp"
#include "mpm/solver/faults.hpp"
#include "mpm/solver/homes.hpp"
#include "mpm/solver/inflow.hpp"
#include "mpm/solver/look_ahead.hpp"
#include "mpm/solver/outflow.hpp"
#include "mpm/solver/rank_share.hpp"
#include "mpm/solver/rigid_bodies.hpp"
#include "mpm/solver/sensors.hpp"
#include "mpm/solver/snapshot.hpp"
#include "mpm/solver/state_check.hpp"
#include "mpm/solver/tallies.hpp"
#include "mpm/solver/uplift.hpp"

namespace mpm {

namespace detail {
template <class T>
struct Emigrants;
}

template <class X, class T, int D>
class Domain final : public Engine {
public:
    using Grid = typename X::template Grid<T>;
    using Sum = typename X::template Sum<T>;

    template <class FindOps>
    Domain(const Spec& spec, const Plan& plan, X exec, const FindOps& find_ops,
           const RankLink<D>& link = {});

    RunResult run(std::int64_t steps, double until, double wall) override;
    double time() const override { return clock_.time; }
    std::int64_t step() const override { return clock_.step; }
    double time_step() const override { return clock_.dt; }
    std::uint64_t particle_count(int body) const override {
        const auto& b = bodies_.at(std::size_t(body));
        return b.count + b.frozen_id.size();
    }
    /// One of several ranks tells the rows of its rings: all join theirs.
    std::vector<Samples> drain() override {
        auto raw = sensors_.drain();
        return share_ ? raw : finished(spec_.sensors, D, std::move(raw));
    }
    std::vector<Removed> removed() override { return outflow_.removed(); }
    std::vector<Flow> flows() override { return std::exchange(flows_, {}); }
    SmoothingHistory smoothing(int body) const override {
        return bodies_.at(std::size_t(body)).smoothing;
    }
    std::vector<std::string> attribute_names(int body) const override;
    Attributes attributes(int body, const std::vector<std::string>& names,
                          const Window& window) override;
    Gathered gather(int body, const std::vector<std::string>& names,
                    const std::vector<double>& origin, IdRange ids) override;
    DenseColumn duplicate(const DenseColumn& column) override;
    void copy_out(const DenseColumn& column, void* to) override;
    void assign(const Assignment& given) override;
    Array grid(const std::string& name, const Window& window) override;
    NodalSums sums(const Window& window) override;
    Condition condition(int samples) override;
    State save() override;
    void check(const State& state) const override;
    void load(const State& state) override;
    std::map<std::string, double> timings() const override { return timings_; }
    std::map<std::string, double> statistics() const override;

private:
    /// What of X components that know no precision are compiled for.
    using Base = ExecutorBase<X>;
    using Body = BodyStore<X, T, D>;
    void list_measured() { sensors_.measure(table_, boundaries_, counted_for_loads()); }

    // domain_contact.hpp
    void set_contact();
    void list_contacts();
    ContactView contact_view();
    std::size_t end_of_fields(const std::vector<std::uint64_t>& keys, std::size_t slot) const;
    template <class Decided>
    void resolve_contacts(const double* maxima, const Decided& decided);

    // domain_place.hpp
    void place_particles(const Spec& spec);
    void find_blocks(const Spec& spec);
    void place_body(Body& body, const BodySpec& spec);
    void set_pressure(Body& body, const BodySpec& spec, std::uint32_t at);
    double steepest_deposit(const Spec& spec) const;
    void deposit_body(Body& body, int number, const std::vector<double>& velocity,
                      const std::vector<double>& gradient, bool tilted, int to);
    void deposit_stresses(Body& body, int number, int to);
    void first_deposit(const Spec& spec);
    template <class Chosen>
    void deposit(const Spec& spec, const Chosen& chosen, double dt);
    template <class Chosen>
    void deposit_all(const Spec& spec, const Chosen& chosen, bool tilted);
    void start_from(const Spec& spec);
    std::vector<double> sums_as_numbers(const std::vector<Sum>& sums) const;
    void adopt_sums(const std::vector<double>& value);
    void set_scales(double mass, double momentum_limit, double group_limit);

    // domain_step.hpp
    void one_step();
    void update_grid();
    void run_sensors();
    void sample_energy(Sensor<Base>& sensor, SensorRecord* record);
    // domain_tallies.hpp
    void make_tallies();
    void list_tallied();
    void run_tallies();
    void reserve_deposits(Body& body);
    std::uint64_t workers_of(const Body& body) const;
    void run_bodies();
    void advance_body(Body& body, int number, std::uint32_t workers);
    // domain_packing.hpp
    void spread_packed();
    // domain_phases.hpp
    Phase<X, T, D> phase(Body& body, int number, int parity_to);
    void reserve_scratch(Body& body);
    void complete_sums();
    void collect_bodies(const std::vector<std::size_t>& moving);
    void after_collect(Body& body, int number, const Phase<X, T, D>& phase);
    void after_respond(Body& body, const Phase<X, T, D>& phase);
    struct PeersOfBody;
    struct CellsOfDevices;
    CellRoom cell_room(const Body& body, PeersOfBody* peers = nullptr);
    bool meets_over_cells(const Body& body) const;
    void smooth_on_device(Body& body, int number, const Phase<X, T, D>& phase);
    void collect_smoothing();
    void sweep_grid();
    /// The grid half of a step without its consequences.
    using NothingAfter = std::conditional_t<X::is_device, AfterGrid<D>, NothingDecided>;
    template <class Decided>
    void make_velocities(const Decided& decided);
    template <bool mirrors, bool lines, class Decided>
    void make_velocities_with(const Decided& decided);
    void move_wall_nodes();
    Fault describe_fault();
    std::int64_t steps_to_sort() const;
    void fetch_clock();
    void push_clock() {
        clock_buffer_.reserve_discard(1);
        exec_.single(SetClock{clock_, clock_buffer_.data()});
    }

    // domain_state.hpp
    void check_laws(const State& state) const;
    std::vector<std::uint32_t> cell_by_cell(const Body& body,
                                            std::vector<std::uint8_t>* cell = nullptr) const;

    // domain_elements.hpp
    void make_mesh(Body& body, const BodySpec& spec);
    void place_mesh(Body& body);
    void locate_elements(Body& body, int number);
    void load_elements(Body& body, bool ahead);
    void push_elements(const Phase<X, T, D>& phase, Body& body, bool ahead);
    void spread_body(Body& body, const Phase<X, T, D>& phase, bool ahead);
    void see_elements(Body& body, int number, const std::vector<std::string>& names,
                      Attributes& out);
    double mean_volume_ratio(Body& body, int number);
    Fault describe_element(Body& body, Fault fault);
    std::vector<T> kept_here(const Body& body) const;
    void move_vertices(const std::vector<std::size_t>& moving);
    // domain_pins.hpp
    void rest_pinned(Body& body);
    void pin_vertices(Body& body, const Phase<X, T, D>& phase);
    void bear_pull(Body& body, const Phase<X, T, D>& phase);
    bool has_pin_force(int number);
    void tell_pins(Body& body, int number);

    // domain_meshes.hpp
    bool has_meshes() const {
        return std::any_of(bodies_.begin(), bodies_.end(),
                           [](const Body& b) { return b.mesh != nullptr; });
    }
    template <class F>
    void each_mesh(const F& f);
    void tell_rest(Body& body);
    void link_meshes(bool all_keep);
    std::vector<std::vector<std::int32_t>> find_owners_of_vertices();
    void tell_wanted(const std::vector<std::vector<std::int32_t>>& owner,
                     const std::vector<std::vector<std::uint8_t>>& pushed, bool all_keep);
    void link_places();
    void swap_places();
    // domain_rigid.hpp
    void make_rigid(Body& body, const BodySpec& spec);
    void list_rigid();
    const std::uint8_t* counted_for_loads();
    void resolve_rigid(double (&maxima)[maxima_count]);
    void return_velocities(double (&maxima)[maxima_count]);
    void move_rigid_nodes(double (&maxima)[maxima_count]);
    Vec<double, D> place_of_node(const std::int64_t (&cell)[D]) const;
    bool is_wall_of(const BoundaryRecord<D>& boundary, int rigid) const;
    void add_wall(RigidPoint<D> point, int boundary, int face, const Vec<double, D>& normal,
                  double gap, const Vec<double, D>& velocity, const SurfaceLaw& law);
    void meet_walls(const NodeUpdate<Grid, Sum, D>& node, std::int32_t slot, int n, double part,
                    const RigidPoint<D>& point);
    void keep_before_walls(std::size_t k);
    void guide_rigid(const NodeUpdate<Grid, Sum, D>& node, std::int32_t slot, int n,
                     const std::int64_t (&cell)[D], RigidPoint<D> point);
    template <class Meeting, class Fields>
    void held_beside(const Meeting& meeting, int n, const Fields& f, int i, RigidPoint<D>& point);
    void place_rigid(Body& body, const Phase<X, T, D>& phase, bool moves);
    void move_rigid(Body& body, const Phase<X, T, D>& phase);
    // domain_rigid_loads.hpp
    void add_rigid_energy(Body& body, const std::int32_t* due, double* partial);
    void tell_rigid_loads();
    void sample_rigid(Sensor<Base>& sensor, SensorRecord& record);
    std::size_t kind_count() const { return full_.size(); }

    // domain_export.hpp
    DenseColumn make_column(char type, const std::vector<std::size_t>& shape);

    // domain_read.hpp
    void prepare_velocities();
    void prepare_swept_velocities();
    Base& memory() { return exec_; }
    NodesSeen<Sum> nodes_in(const Window& window);

    // domain_supply.hpp
    bool supply();
    void append_arrivals(int body, Buffer<X, std::uint32_t>& cell, const BlockTableView<D>& table);
    void deposit_arrivals();

    // domain_sort.hpp
    bool sort();
    void find_cells(Body& body, std::uint32_t* occupied, std::uint32_t* cell, std::uint32_t* left);
    bool end_of_sort(double began);
    std::vector<Leaver<D>> list_left(const Body& body, std::uint32_t count,
                                     const Buffer<X, std::uint32_t>& cell);
    bool stop_for_left(const Body& body, const std::vector<std::uint64_t>& ids,
                       const std::string& who, const std::string& why = {});
    bool remove_left(const std::vector<std::uint32_t>& left,
                     const std::vector<Buffer<X, std::uint32_t>>& cells);
    void adopt_table(Buffer<X, std::uint64_t>& keys);
    void permute(Body& body, const std::uint32_t* order);
    void link_table();
    Homes<Base> find_homes();
    void list_homes(const Homes<Base>& homes);
    void join_homes(const Homes<Base>& homes, Buffer<X, std::uint32_t>& any);
    void sort_by_colour(Body& body);
    void heavy_first(Body& body);
    void list_pairs(Body& body, std::uint32_t least);
    void list_by_kind(Body& body, const Buffer<X, std::uint32_t>& position);

    // domain_ranks.hpp
    std::vector<std::vector<std::uint64_t>> gather_tables(const Buffer<X, std::uint64_t>& keys);
    void hold_all_fields(std::vector<std::vector<std::uint64_t>>& tables) const;
    void tell_reached();
    void link_ranks(std::vector<std::vector<std::uint64_t>> keys);
    /// What has been staged: by a step's passes, or by a first deposit, whose bodies without
    /// gradients of velocity are added by a pass of its own.
    enum class Added { in_step, at_rest, tilted };
    void end_of_sums(int parity, Added added);
    template <class Number, class Add>
    void add_up_staged(const char* what, Number* blocks, std::size_t size, std::size_t first,
                       std::size_t last, const Add& add);
    void rebalance(const std::vector<std::uint64_t>& load);
    void weigh_by_time(std::vector<BlockWeight>& blocks);
    void deal_anew(const std::vector<BlockWeight>& blocks, double was);
    // domain_points.hpp
    SamplePoints<Grid, Sum, D> sample_points();
    void sample_points_together(SamplePoints<Grid, Sum, D> points);
    void open_points();
    void reserve_told();
    std::vector<std::uint64_t> slots_of_points();
    void link_points();
    void tell_points();
    void swap_told_points();
    void sample_told_points();
    // domain_devices.hpp
    /// Particles of a body on their way to other ranks.
    struct Emigrating {
        Buffer<X, std::uint64_t> key;             // of the block they are sorted into
        Buffer<X, std::uint32_t> in, id;          // the cell of it
        Buffer<X, T> column;                      // (columns, all): offsets from that cell, states
        std::vector<std::uint32_t> first, count;  // of each rank
        std::uint32_t all = 0;
        explicit Emigrating(X& x) : key(x), in(x), id(x), column(x) {}
    };
    /// The same, in the memory of the rank that they come from.
    struct Coming {
        const std::uint64_t* key;
        const std::uint32_t *in, *id;
        const T* column;
        std::uint32_t first, count, all;
        int rank;
    };
    /// Blocks that this rank and another hold.
    struct SharedWith {
        int rank;
        std::int64_t first;           // in shared_slots_
        std::int64_t numbers;         // sums of all of them
        const Sum* theirs = nullptr;  // what the other has added to them
        // The same of cells, of which that for this rank begins at the block `their_first`.
        const std::int64_t* their_cells = nullptr;
        std::int64_t their_first = 0;
    };
    void link_homes();
    ReachedBlocks reached_blocks() const {
        if (!spec_.contact.any()) return {};
        return {reached_.data(), std::int32_t(reached_.size())};
    }
    std::uint32_t flag_border(const Buffer<X, std::uint64_t>& keys, bool all,
                              Buffer<X, std::uint32_t>& flag, Buffer<X, std::uint32_t>& position);
    std::vector<HeldBlock> list_held(const Buffer<X, std::uint64_t>& keys, bool all);
    std::vector<std::vector<HeldBlock>> gather_held(const Buffer<X, std::uint64_t>& keys, bool all);
    void link_devices(std::vector<std::vector<HeldBlock>> held);
    void link_sums();
    void open_devices();
    void meet_hosts();
    double largest_of_all(double x) const;
    void sum_of_devices(std::vector<std::uint64_t>& numbers) const;
    void sum_of_homes(std::vector<std::uint64_t>& numbers);
    void run_together(std::int64_t& steps, bool& wall_over);
    // domain_rank_fields.hpp
    std::vector<std::vector<std::uint64_t>> tell_reached_slots(
        const Buffer<X, std::uint64_t>& keys);
    void tell_reached_by_homes();
    void hold_fields_of_devices(Buffer<X, std::uint64_t>& keys);
    void count_reached();
    // domain_parcels.hpp
    bool reaches() const;
    template <class N>
    void share_told(const Buffer<X, N>& by_rank);
    TellRanks tell_ranks() {
        if (!X::is_device || !share_) return {};
        return {told_boxes_.data(), share_->rank(), int(told_boxes_.size())};
    }
    void list_shared();
    void list_shared_cells(std::int64_t slots);
    void swap_cells(std::int64_t* cells, int columns);
    static int summed_columns(const Body& body);
    std::int32_t reserve_smoothing(Body& body);
    /// What a rank that fails has queued on a device shall not wait for the others.
    struct GiveUp {
        typename X::Meeting* meeting;
        int before = std::uncaught_exceptions();
        ~GiveUp() {
            if (meeting && std::uncaught_exceptions() > before) meeting->give_up();
        }
    };
    /// Until all that this rank has queued is done. Sweeps are made by all ranks together, so that
    /// one that has failed is heard of; a reader is alone otherwise.
    void wait_for_sweeps() {
        if constexpr (X::is_device) {
            if (share_ && plan_.sweep.residual > 0) return meeting_->wait();
        }
        exec_.wait();
    }
    void swap_sums(int which, const Clock* clock);
    void share_sums();
    void share_deposits(int which);
    void fetch_emigrants(const std::vector<Emigrating>& go, std::vector<std::vector<Coming>>& come,
                         std::vector<Emigrating>& landed);
    // domain_migrate_devices.hpp
    bool sort_among_devices();
    void find_owners();
    void count_emigrants(const std::vector<Buffer<X, std::uint32_t>>& cells,
                         Buffer<X, std::uint32_t>& counts);
    bool deal_devices();
    Emigrating list_emigrants(const Body& body, Buffer<X, std::uint32_t>& cell,
                              const std::uint32_t* count);
    std::vector<std::vector<Coming>> tell_emigrants(const std::vector<Emigrating>& go,
                                                    SortWord& word,
                                                    std::vector<Emigrating>& landed);
    void sort_into_new_table(const std::vector<std::vector<Coming>>& come,
                             const std::vector<std::uint32_t>& gone,
                             std::vector<Buffer<X, std::uint32_t>>& cells,
                             Buffer<X, std::uint32_t>& occupied,
                             const std::vector<std::vector<HeldBlock>>* all_before);
    void adopt_table_of_devices(Buffer<X, std::uint64_t>& keys,
                                const std::vector<std::vector<HeldBlock>>& before,
                                const std::vector<std::vector<HeldBlock>>& after);
    void admit_arrived(int number, const std::vector<Coming>& come, std::uint32_t gone,
                       Buffer<X, std::uint32_t>& cell, const BlockTableView<D>& table);
    // domain_migrate.hpp
    bool stops_here(const std::vector<std::uint32_t>& left,
                    const std::vector<Buffer<X, std::uint32_t>>& cells);
    bool refuse_to_sort(bool stops, const std::vector<std::uint32_t>& left,
                        const std::vector<Buffer<X, std::uint32_t>>& cells);
    bool anyone_stops(const std::vector<std::uint32_t>& left,
                      const std::vector<Buffer<X, std::uint32_t>>& cells);
    void adopt_table_of_ranks(Buffer<X, std::uint64_t>& keys,
                              const std::vector<std::vector<std::uint64_t>>& after);
    bool sort_among_ranks();
    void admit(int number, const detail::Emigrants<T>& come, Buffer<X, std::uint32_t>& cell,
               const std::vector<int>& owner, const BlockTableView<D>& table);
    /// Whether a block's nodes are this rank's to count, where every block counts once.
    bool counts_slot(std::size_t slot) const { return !share_ || share_->counts_slot(slot); }

    /// Which scale a nodal sum has, by its index among all sums.
    int scale_of_sum(std::size_t k) const {
        const int c = int(k / block_cells % std::size_t(plan_.sum_channels));
        if (c == 0) return mass_sum;
        if (c <= D) return momentum_sum;
        for (const auto& b : plan_.bodies)
            if (b.group.weight == c) return mass_sum;
        if (c == plan_.filled) return mass_sum;
        if (plan_.kept.plain >= 0 && c >= plan_.kept.plain && c < plan_.kept.plain + D)
            return momentum_sum;
        return group_sum;
    }
    bool wide_kernel() const { return kernel_width(spec_.kernel.kernel) == 5; }
    /// Where stresses push depends on which nodes have mass: they are spread after all masses.
    bool stresses_apart() const { return spec_.kernel.kernel == Kernel::ddmp; }
    /// Does any body average its volumes in a transfer of their own?
    bool splits() const {
        return std::any_of(plan_.groups.begin(), plan_.groups.end(),
                           [](const GroupChannels& g) { return g.split; });
    }
    int parity() const { return int(clock_.step & 1); }
    GridView<Grid, Sum, D> grid_view(int parity) {
        return {table_, velocity_.data(), plan_.velocity_channels, sums_[parity].data(),
                plan_.sum_channels};
    }
    NodeUpdate<Grid, Sum, D> node_update(int parity) {
        return {grid_view(parity),
                clock_buffer_.data(),
                boundaries_.view(),
                boundaries_.touched().data(),
                least_mass_,
                light_mass_,
                boundaries_.pressures().data(),
                int(boundaries_.pressures().size()),
                uplift_.rubbing()};
    }
    WallNodes<Grid, D> wall_nodes() {
        if (!boundaries_.lists()) return {};
        const auto& lined = boundaries_.lined();
        return {wall_velocity_.data(), wall_changed_.data(), boundaries_.asks().data(),
                wall_seats_.data(),    lined.data(),         std::int64_t(lined.size())};
    }
    /// What nodes beside boundaries would do by themselves in this step.
    WallSeats<Grid> wall_seats() const {
        if (!boundaries_.lists()) return {};
        return {wall_seats_.data(), boundaries_.asks().data()};
    }
    template <bool keeps, bool mirrors, bool lines>
    UpdateGrid<Grid, Sum, D, keeps, mirrors, lines> grid_update(int parity) {
        return {node_update(parity),
                sums_[1 - parity].data(),
                groups_.data(),
                int(plan_.groups.size()),
                plan_.groups.size() == 1 ? plan_.groups[0] : GroupChannels{},
                plan_.kept,
                wall_nodes()};
    }
    BeginStep<D> begin_step() { return boundaries_.begin_step(clock_buffer_.data()); }
    TurnStep<D> turn_step() {
        return {{clock_buffer_.data(), spec_.cell_size, plan_.shift}, begin_step()};
    }
    Pass<X, T, D> pass(Body& body, int number, int parity_to);
    double now() const {
        return std::chrono::duration<double>(std::chrono::steady_clock::now().time_since_epoch())
            .count();
    }

    Spec spec_;  // without the particles' arrays
    Plan plan_;
    X exec_;
    Clock clock_{};  // host copy, current after fetch_clock
    double least_mass_ = 0, light_mass_ = 0;
    bool dead_ = false;
    Fault fault_;

    Buffer<X, Clock> clock_buffer_{exec_};
    Buffer<X, TimeTableView> drives_{exec_};  // of pins that drive vertices
    Buffer<X, BodyConstants> constants_{exec_};
    Buffer<X, BodyNumbers> numbers_{exec_};
    Buffer<X, GroupChannels> groups_{exec_};
    BlockTable<Base, D> blocks_{exec_, spec_.cells, spec_.contact.fields};
    const BlockTableView<D>& table_ = blocks_.view();
    Boundaries<Base, D> boundaries_{exec_, spec_, plan_};
    Uplift<X, Grid, Sum, D> uplift_{exec_, spec_, plan_};

    int sorts_of_table_ = 0;
    Buffer<X, Grid> velocity_{exec_};
    bool velocities_made_ = false;  // for readers, since the state last changed
    bool velocities_wait_ = false;  // CPU: for a run that goes on, with these maxima
    std::array<double, maxima_count> maxima_{};
    Buffer<X, Grid> wall_velocity_{exec_};  // `WallNodes`
    Buffer<X, std::uint8_t> wall_changed_{exec_};
    Buffer<X, Grid> wall_seats_{exec_};
    // (slots, nodes), where particles are shifted or volumes led by density.
    Buffer<X, Grid> excess_{exec_}, packed_{exec_};
    Buffer<X, std::uint32_t> some_excess_{exec_}, some_packed_{exec_};
    Buffer<X, Sum> sums_[2] = {Buffer<X, Sum>(exec_), Buffer<X, Sum>(exec_)};

    PhaseOps<X, T, D> phase_ops_ = phase_ops<X, T, D>();
    Buffer<X, double> cells_{exec_};  // what is summed over cells, body after body
    // Devices, of smoothing over cells: by body; of each home of one body, then of the parts of
    // their sum.
    Buffer<X, SmoothingLog> smoothing_logs_{exec_};
    Buffer<X, double> smoothing_energies_{exec_};
    std::vector<Body> bodies_;

    Sensors<Base, D> sensors_{exec_, spec_, plan_};
    Tallies<X, T, D> tallies_{exec_};
    ExpectedSamples expected_;  // devices
    bool sampling_ = true;      // in the step to come

    // Where contact is declared: laws, and the blocks with several fields of velocities.
    Buffer<X, ContactLaw> contact_laws_{exec_};
    Buffer<X, std::int32_t> law_of_{exec_}, kind_of_{exec_};
    Buffer<X, double> full_{exec_};
    Buffer<X, std::int32_t> contact_first_{exec_}, contact_count_{exec_};
    Buffer<X, std::uint32_t> crowded_{exec_};
    Buffer<X, double> grid_maxima_{exec_};         // devices: before contact
    Buffer<X, std::uint8_t> near_contact_{exec_};  // (slots,) of scenes with elements too
    std::int32_t contact_blocks_ = 0;

    // Rigid bodies, the blocks that their nodes are in, and what they met in this step.
    RigidBodies<D> rigid_;
    std::vector<RigidBlock> rigid_blocks_;
    std::vector<std::int32_t> body_of_field_;  // (fields,): its number among them, or -1
    std::vector<RigidPoint<D>> rigid_points_;
    std::vector<FreeNode<D>> rigid_free_;
    std::vector<RigidMeeting> rigid_met_;
    std::vector<RigidWall<D>> rigid_walls_;
    int rigid_most_sweeps_ = 0;
    double rigid_left_ = 0;

    Inflow<Base, D> inflow_{exec_, spec_, plan_};
    Outflow<D> outflow_{spec_};
    std::vector<Flow> flows_;
    std::map<std::string, double> timings_;
    std::int64_t sorts_ = 0, tables_ = 0, last_sort_ = 0, sort_interval_ = 0;
    double look_ahead_ = look_ahead_of(X::look_ahead);
    std::unique_ptr<RankShare<D>> share_;  // null where this is the only rank

    // Devices that share the scene.
    std::unique_ptr<typename X::Meeting> meeting_;
    Buffer<X, RankVote> votes_{exec_};   // of all ranks, by rank
    Buffer<X, RankVote*> boxes_{exec_};  // of all ranks that this one reaches, or its own
    Buffer<X, RankTold> told_{exec_};    // likewise: what else they tell within a step
    Buffer<X, RankTold*> told_boxes_{exec_};
    Buffer<X, std::uint8_t> shared_{exec_};  // (slots,): others hold it too
    Buffer<X, std::int32_t> owner_{exec_};   // (slots,)
    // (slots,): its owner may have particles there without a new table.
    Buffer<X, std::uint32_t> ready_{exec_};
    // Where bodies have fields of velocities: blocks that this rank's homes reach, by field 0.
    Buffer<X, std::uint64_t> reached_{exec_};
    std::vector<std::array<Sum*, 2>> sums_of_;  // of each rank
    Buffer<X, std::uint8_t> counts_{exec_};     // RankShare::counts
    // The blocks that each of them shares with this one, what this one has added to them, a piece
    // for each other rank, and, where they do not reach each other's memory, the pieces of the
    // others (else they are read where they are).
    std::vector<SharedWith> shared_with_;
    Buffer<X, std::int32_t> shared_slots_{exec_};
    Buffer<X, Sum> shared_out_{exec_}, shared_in_{exec_};
    Buffer<X, std::int64_t> cells_out_{exec_}, cells_in_{exec_};  // of what is summed over cells
    // What gauges and probes read (telling.hpp).
    Buffer<X, std::uint64_t> told_keys_{exec_};
    Buffer<X, std::int32_t> told_slots_{exec_};
    Buffer<X, Sum> told_sums_{exec_}, told_sums_in_{exec_};
    Buffer<X, Grid> told_velocity_{exec_}, told_velocity_in_{exec_};
    Buffer<X, ToldClock> told_clock_{exec_};
    ToldBlocks<Grid, Sum> told_blocks_{};
};

}  // namespace mpm

#include "mpm/solver/domain_assign.hpp"
#include "mpm/solver/domain_contact.hpp"
#include "mpm/solver/domain_devices.hpp"
#include "mpm/solver/domain_elements.hpp"
#include "mpm/solver/domain_export.hpp"
#include "mpm/solver/domain_meshes.hpp"
#include "mpm/solver/domain_migrate.hpp"
#include "mpm/solver/domain_migrate_devices.hpp"
#include "mpm/solver/domain_packing.hpp"
#include "mpm/solver/domain_parcels.hpp"
#include "mpm/solver/domain_phases.hpp"
#include "mpm/solver/domain_pins.hpp"
#include "mpm/solver/domain_place.hpp"
#include "mpm/solver/domain_points.hpp"
#include "mpm/solver/domain_rank_fields.hpp"
#include "mpm/solver/domain_ranks.hpp"
#include "mpm/solver/domain_read.hpp"
#include "mpm/solver/domain_rigid.hpp"
#include "mpm/solver/domain_rigid_loads.hpp"
#include "mpm/solver/domain_setup.hpp"
#include "mpm/solver/domain_sort.hpp"
#include "mpm/solver/domain_state.hpp"
#include "mpm/solver/domain_step.hpp"
#include "mpm/solver/domain_supply.hpp"
#include "mpm/solver/domain_tallies.hpp"
#include "mpm/solver/domain_watch.hpp"
