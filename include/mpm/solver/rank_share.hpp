// What a rank of several knows beside its own state: who owns which blocks, which blocks others
// hold too, and what goes to whom at the end of each step. A run on one rank has none of it.
#pragma once

#include <algorithm>
#include <cstdint>
#include <ctime>
#include <functional>
#include <vector>

#include "mpm/data/partition.hpp"
#include "mpm/data/rank_costs.hpp"
#include "mpm/exec/communicator.hpp"
#include "mpm/kernels/clock.hpp"
#include "mpm/kernels/sampling_steps.hpp"
#include "mpm/solver/blocks_together.hpp"
#include "mpm/solver/faults.hpp"

namespace mpm {

/// What a home block costs beside its particles, in particles.
inline constexpr std::uint64_t weight_of_block = 16;

/// Processor time of the calling thread, in s. It stands still while the thread waits, be it for a
/// processor that others use, and so says what was to do and not who else was there.
inline double thread_seconds() {
    std::timespec t{};
    clock_gettime(CLOCK_THREAD_CPUTIME_ID, &t);
    return double(t.tv_sec) + 1e-9 * double(t.tv_nsec);
}

/// A block in a rank's table, as others are told of it.
struct HeldBlock {
    std::uint64_t key;
    std::int32_t slot;
    std::int32_t ready;  // all its neighbours are in the table too
};

/// Where bodies have fields of velocities: the blocks that a rank's homes reach, by field 0. It
/// holds all fields there and around, so these are where homes may be without a new table.
struct ReachedBlocks {
    const std::uint64_t* keys = nullptr;  // ascending; null: any
    std::int32_t count = 0;
    MPM_INLINE bool has(std::uint64_t block) const {
        return !keys || find_key(keys, count, block) >= 0;
    }
};

/// What ranks on devices say of a sort before any of them has changed anything.
struct SortWord {
    std::uint32_t stops;  // particles have left, and the policy is to stop
    std::uint32_t lacks;  // the tables lack a block that is now needed
};

/// Who owns a block, as kernels know it.
template <int D>
struct RowCuts {
    int axis = 0, bits = 1, count = 0;
    std::uint64_t at[most_device_ranks] = {};  // where each rank but the first begins

    RowCuts() = default;
    explicit RowCuts(const BlockPartition<D>& p)
        : axis(p.axis()), bits(p.bits()), count(int(p.cuts().size())) {
        std::copy(p.cuts().begin(), p.cuts().end(), at);
    }
    MPM_INLINE int owner(const BlockKeys<D>& keys_of, std::uint64_t key) const {
        const std::uint64_t place = place_in_row(keys_of, key, axis, bits);
        int r = 0;
        while (r < count && at[r] <= place) ++r;
        return r;
    }
};

template <int D>
struct RankShare {
    /// What the blocks of one body and colour on one rank add to a block that others hold too.
    struct Staged {
        std::int32_t slot;          // of the block
        std::int32_t body, colour;  // in whose order they are added
        std::int32_t rank;          // whose it is
        std::int32_t at;            // own: the slot that it is staged in; else its place in the
                                    // message of that rank
    };

    Communicator* comm = nullptr;
    BlockPartition<D> partition;
    double rebalance_above = 0;
    BlocksTogether together;

    std::vector<std::vector<std::uint64_t>> keys;  // of each rank's table, ascending
    // Where bodies have fields of velocities: of each rank, blocks that its homes reach, by field
    // 0.
    std::vector<std::vector<std::uint64_t>> reached;
    std::vector<int> peers;                       // ranks that hold a block that this one holds
    std::vector<std::int32_t> shared;             // slots that others hold too
    std::vector<Staged> parts;                    // of each of them in turn, in order
    std::vector<std::size_t> first_part;          // (shared + 1,)
    std::int32_t staged = 0;                      // slots behind those of the table
    std::vector<std::int32_t> staged_of;          // where those of each body begin, then `staged`
    std::vector<std::vector<std::int32_t>> send;  // to each rank, of these slots, body after body
    // To and from each rank: where the blocks of each body begin, then how many there are in all.
    std::vector<std::vector<std::size_t>> send_of, receive_of;
    std::vector<std::vector<std::int32_t>> destinations;  // of each body: (slots, 3^D)
    // Of the ranks that hold a block one counts its nodes, where each is to count once.
    std::vector<std::uint8_t> counts;

    // Where loads are by measured time: this rank's clock, in s; when its vote began, and with it
    // a wait for the others; what each step since the last telling has taken; what all made of it.
    std::function<double()> seconds;
    double votes_at = 0;
    std::vector<double> worked;
    CostRates costs;

    double wall_ends = 0;
    bool wall_over = false;  // for any rank

    // Since the start.
    // Devices, of bodies of elements: whether any rank needs places of others' vertices, and what
    // this one gives of its own, bytes.
    bool swaps_places = false;
    std::uint64_t vertices_a_step = 0;
    std::uint64_t rebalances = 0, migrated = 0, bytes_of_sums = 0, bytes_of_vertices = 0;
    // Devices: of the sums that others get in a step, at most.
    std::uint64_t bytes_a_step = 0;
    std::uint64_t shared_blocks = 0;           // devices
    std::vector<std::vector<HeldBlock>> held;  // devices: of each rank, those beside a cut
    std::vector<std::uint64_t> loads;          // of each rank, when they were last told

    int rank() const { return comm->rank(); }
    int ranks() const { return comm->ranks(); }
    bool counts_slot(std::size_t slot) const { return counts[slot] != 0; }
};

/// What a rank tells the others before the clock decides.
struct RankVote {
    double maxima[maxima_count];
    double deposited[quantities];
    std::uint64_t strays;
    std::int32_t fault;
    std::int32_t wall_over;
};

/// Votes of all ranks into one: the largest of what they found.
MPM_HD inline void add_vote(RankVote& all, const RankVote& v) {
    // Not-a-number is the largest of all.
    const auto larger = [](double& to, double x) {
        if (x != x || x > to) to = x;
    };
    for (int m = 0; m < maxima_count; ++m) larger(all.maxima[m], v.maxima[m]);
    for (int q = 0; q < quantities; ++q) larger(all.deposited[q], v.deposited[q]);
    // A call for a sort is as many as there can be.
    const std::uint64_t sum = all.strays + v.strays;
    all.strays = sum < v.strays ? ~std::uint64_t(0) : sum;
    all.fault = all.fault || v.fault;
    all.wall_over = all.wall_over || v.wall_over;
}

/// What a clock and the maxima of its grid say; its wall time is the host's to know.
MPM_HD inline RankVote vote_of(const Clock& clock, const double* maxima) {
    RankVote mine{};
    for (int m = 0; m < maxima_count; ++m) mine.maxima[m] = maxima[m];
    for (int q = 0; q < quantities; ++q) mine.deposited[q] = clock.deposited[q];
    mine.strays = clock.strays;
    mine.fault = clock.fault_particle != no_fault ||
                 (clock.halt == Halt::fault && clock.fault == FaultKind::crowded);
    return mine;
}

/// A clock decides by the votes of all as if they were its own.
template <int D>
MPM_HD inline void decide_by(const RankVote& all, Clock* clock, const Decide<D>& decide) {
    const std::uint64_t own = clock->strays;
    clock->strays = all.strays;
    for (int q = 0; q < quantities; ++q) clock->deposited[q] = all.deposited[q];
    if (all.fault && clock->fault_particle == no_fault) clock->fault_particle = fault_elsewhere;
    decide(all.maxima);
    clock->strays = own;  // each goes on counting its own
}

/// Devices: a rank's vote after its grid update, into the memory of all that it reaches.
struct TellVote {
    const Clock* clock;
    RankVote* const* boxes;  // where each of these keeps the votes, by rank
    int rank, count;
    MPM_HD void operator()(const double* maxima) const {
        const RankVote mine = vote_of(*clock, maxima);
        for (int k = 0; k < count; ++k) boxes[k][rank] = mine;
    }
};
/// Devices: what one thread does after a pass over the grid. One type for all of it: the kernels
/// that find the maxima are the largest there are, and a type each would compile them three times.
template <int D>
struct AfterGrid {
    enum class Kind : int { nothing, decide, tell, keep } kind = Kind::nothing;
    Decide<D> decide{};
    TellVote tell{};
    double* kept = nullptr;  // for `AfterContact`
    MomentSensors moments{};

    static AfterGrid deciding(const Decide<D>& d, const MomentSensors& m) {
        return {Kind::decide, d, {}, nullptr, m};
    }
    static AfterGrid telling(const TellVote& t) { return {Kind::tell, {}, t}; }
    static AfterGrid keeping(double* to) { return {Kind::keep, {}, {}, to}; }
    MPM_HD void operator()(const double* maxima) const {
        if (kind == Kind::decide && !moments.halt(decide.clock)) decide(maxima);
        if (kind == Kind::tell) tell(maxima);
        for (int m = 0; m < maxima_count && kind == Kind::keep; ++m) kept[m] = maxima[m];
    }
};

/// Devices: when all votes are there.
template <int D>
struct DecideByVotes {
    Decide<D> decide;
    Clock* clock;
    const RankVote* votes;
    int ranks;
    MomentSensors moments;
    MPM_HD void operator()() const {
        if (moments.halt(clock)) return;
        RankVote all{};
        for (int r = 0; r < ranks; ++r) add_vote(all, votes[r]);
        decide_by(all, clock, decide);
    }
};

/// The clock decides alike on all ranks: by the largest of what they found.
template <int D>
struct DecideTogether {
    Decide<D> decide;
    Clock* clock;
    RankShare<D>* share;
    double now;

    void operator()(const double* maxima) const {
        if (share->seconds) share->votes_at = share->seconds();
        RankVote mine = vote_of(*clock, maxima);
        mine.wall_over = now > share->wall_ends;
        RankVote all{};
        for (const RankVote& vote : share->comm->tell(mine, "a vote")) add_vote(all, vote);
        share->wall_over = all.wall_over;
        decide_by(all, clock, decide);
    }
};

/// How a Domain is made one of several.
template <int D>
struct RankLink {
    Communicator* comm = nullptr;
    BlockPartition<D> partition;
    double rebalance_above = 0;
};

}  // namespace mpm
