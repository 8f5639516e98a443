// The CPU executor: memory on the heap, loops by OpenMP. Verbs, not loops, are what common code may
// use: `for_each` promises independent iterations and therefore cannot write sums; `max_each`
// reduces maxima, whose order does not matter; scatters happen in the body passes, which own what
// they add to.
#pragma once

#include <omp.h>

#include <algorithm>
#include <cstdint>
#include <cstdlib>
#include <cstring>
#include <new>
#include <string>
#include <vector>

#include "mpm/core/config.hpp"
#include "mpm/core/error.hpp"
#include "mpm/exec/sums.hpp"

namespace mpm {

class Cpu {
public:
    static constexpr bool is_device = false;
    /// Ranks on a CPU wait for each other's messages and for nothing else.
    struct Meeting {
        void meet() {}
        void wait() {}
        void give_up() noexcept {}
    };
    /// In which numbers the grid is kept beside particles in T.
    template <class T>
    using Grid = T;
    /// Type of a nodal sum: the number itself.
    template <class T>
    using Sum = T;
    /// How far a particle may drift from the cell it was sorted into, in cells. Particles outside
    /// their cell go one by one, which costs three times a lane, so the CPU sorts early.
    static constexpr double drift_limit = 0.3;
    /// Share of the drift that a sort looks ahead.
    static constexpr double look_ahead = 0;
    /// Steps handed over before the state is looked at again.
    static constexpr int batch = 1;

    explicit Cpu(int threads) : threads_(threads > 0 ? threads : omp_get_max_threads()) {}
    int threads() const { return threads_; }

    void* allocate(std::size_t bytes) {
        void* p = std::aligned_alloc(64, (bytes + 63) / 64 * 64);
        if (!p)
            throw CapacityError("out of memory: " + std::to_string(bytes) +
                                " bytes asked for in one piece");
        return p;
    }
    void release(void* p, std::size_t /*bytes*/) noexcept { std::free(p); }
    void copy(void* to, const void* from, std::size_t bytes) {
        if (bytes > 0) std::memcpy(to, from, bytes);  // a rank may hold nothing at all
    }
    void upload(void* to, const void* from, std::size_t bytes) { copy(to, from, bytes); }
    void download(void* to, const void* from, std::size_t bytes) { copy(to, from, bytes); }
    void zero(void* p, std::size_t bytes) {
        if (bytes > 0) std::memset(p, 0, bytes);
    }
    void wait() {}
    void wait_for_all() noexcept {}
    void trim() {}
    void check(const char*) {}

    template <class F>
    void single(const F& f) {
        f();
    }

    template <class F>
    void for_each(std::int64_t n, const F& f) {
#pragma omp parallel for schedule(static) num_threads(threads_) if (n > 32768)
        for (std::int64_t i = 0; i < n; ++i) f(i);
    }

    /// Iterations that cost much more than a few nanoseconds each.
    template <class F>
    void for_each_large(std::int64_t n, const F& f) {
#pragma omp parallel for schedule(dynamic) num_threads(threads_) if (n > 8)
        for (std::int64_t i = 0; i < n; ++i) f(i);
    }

    /// A pass of a step; devices bring it while the one before still runs.
    template <class F>
    void for_each_next(std::int64_t n, const F& f) {
        for_each(n, f);
    }

    /// Host work on host copies.
    template <class F>
    void host_for(std::int64_t n, const F& f) {
        for_each_large(n, f);
    }

    /// then(maxima), with maxima[m] = max over i of what f(i, local) leaves in local[m], at least
    /// 0.
    template <int M, class F, class G>
    void max_each(std::int64_t n, const F& f, const G& then) {
        double out[M] = {};
        largest_of(n, f, out);
        then(static_cast<const double*>(out));
    }

    /// Parts in which `sum_each` adds up n items: they depend on n alone, so that no number of
    /// threads changes a bit.
    static std::int64_t sum_parts(std::int64_t n) {
        return std::max<std::int64_t>(1, (n + 63) / 64);
    }

    /// then(s, sums) for each set s, with sums[w] = sum over its items i of what f(i, s, local)
    /// adds to local[w]. `parts` has room for W sums a place, of whatever can be added and is none
    /// where it is zeros. Beside it beside(k) runs for k < more, which are few and slow. Says
    /// `then` so at the end, where it wants to know (`then.done()`); leaves out sets that have
    /// nothing to do, where f knows (`f.idle(s)`). Sets may have fewer parts than `sum_parts`.
    template <int W, class F, class G, class A, class H>
    void sum_each(const SumSets& sets, const F& f, const G& then, A* parts, std::int64_t more,
                  const H& beside) {
        for_each_large(more, beside);
        for_each_large(sets.places, [&](std::int64_t place) {
            const int s = sets.owner(std::int32_t(place));
            if constexpr (requires { f.idle(s); }) {
                if (f.idle(s)) return;
            }
            const SumSet& set = sets.set[s];
            const std::int64_t of_all = (set.count + 63) / 64,
                               each = 64 * ((of_all + set.parts - 1) / set.parts),
                               begin = each * (place - set.place);
            A* local = parts + place * W;
            std::fill_n(local, W, A{});
            for (std::int64_t i = begin; i < std::min(set.count, begin + each); ++i)
                f(set.first + i, s, local);
        });
        for (int s = 0; s < sets.count; ++s) {
            if constexpr (requires { f.idle(s); }) {
                if (f.idle(s)) continue;
            }
            A sums[W] = {};
            for (std::int32_t k = 0; k < sets.set[s].parts; ++k)
                for (int w = 0; w < W; ++w) sums[w] += parts[(sets.set[s].place + k) * W + w];
            then(s, static_cast<const A*>(sums));
        }
        if constexpr (requires { then.done(); }) then.done();
    }

    /// out[i] = sum of in[0 .. i), for i in [0, n]: n + 1 results.
    void exclusive_scan(const std::uint32_t* in, std::uint32_t* out, std::int64_t n) {
        std::uint32_t sum = 0;
        for (std::int64_t i = 0; i < n; ++i) {
            const std::uint32_t x = in[i];
            out[i] = sum;
            sum += x;
        }
        out[n] = sum;
    }

    /// Keys ascending, each once; returns how many remain. Devices want to know how many bits they
    /// have.
    std::int64_t sort_unique(std::uint64_t* keys, std::int64_t n, int /*bits*/) {
        std::sort(keys, keys + n);
        return std::unique(keys, keys + n) - keys;
    }

    /// order[k] = index of the k-th element by key, ties in index order; start[key] = first k of
    /// that key, for keys in [0, range]. Particles are nearly in order, so each thread's chunk
    /// spans few keys and a histogram of its own.
    void stable_order(const std::uint32_t* key, std::int64_t n, std::int64_t range,
                      std::uint32_t* order, std::uint32_t* start) {
        const int workers = n > 65536 ? threads_ : 1;
        struct Chunk {
            std::int64_t low = 0;
            std::vector<std::uint32_t> count;
        };
        std::vector<Chunk> chunks(workers);
        std::vector<std::uint32_t> total(range + 1, 0);
#pragma omp parallel for schedule(static, 1) num_threads(workers)
        for (int w = 0; w < workers; ++w) {
            const std::int64_t b = n * w / workers, e = n * (w + 1) / workers;
            std::uint32_t low = ~0u, high = 0;
            for (std::int64_t i = b; i < e; ++i) {
                low = std::min(low, key[i]);
                high = std::max(high, key[i]);
            }
            if (b == e) low = high = 0;
            chunks[w].low = low;
            chunks[w].count.assign(std::size_t(high) - low + 1, 0);
            for (std::int64_t i = b; i < e; ++i) ++chunks[w].count[key[i] - low];
        }
        for (auto& c : chunks) {
            for (std::size_t k = 0; k < c.count.size(); ++k) {
                const std::uint32_t here = c.count[k];
                c.count[k] = total[c.low + k];  // how many earlier chunks hold of this key
                total[c.low + k] += here;
            }
        }
        exclusive_scan(total.data(), start, range);
#pragma omp parallel for schedule(static, 1) num_threads(workers)
        for (int w = 0; w < workers; ++w) {
            const std::int64_t b = n * w / workers, e = n * (w + 1) / workers;
            auto& c = chunks[w];
            for (std::int64_t i = b; i < e; ++i)
                order[start[key[i]] + c.count[key[i] - c.low]++] = std::uint32_t(i);
        }
    }

    /// A flag that several workers may raise at once.
    static void raise(std::uint32_t* flag) { __atomic_store_n(flag, 1u, __ATOMIC_RELAXED); }
    /// Keeps the smallest value seen.
    static void keep_smallest(std::uint64_t* to, std::uint64_t value) {
        std::uint64_t seen = __atomic_load_n(to, __ATOMIC_RELAXED);
        while (value < seen && !__atomic_compare_exchange_n(to, &seen, value, true,
                                                            __ATOMIC_RELAXED, __ATOMIC_RELAXED)) {
        }
    }
    /// Returns the value before the addition.
    static std::uint32_t fetch_add(std::uint32_t* to, std::uint32_t by) {
        return __atomic_fetch_add(to, by, __ATOMIC_RELAXED);
    }

private:
    /// Knows nothing of what follows: the grid update is compiled once, whatever comes after it.
    /// Defined outside of the class: not being inline, it can be compiled in one unit of several
    /// (`extern template`).
    template <int M, class F>
    void largest_of(std::int64_t n, const F& f, double (&out)[M]);

    int threads_;
};

template <int M, class F>
void Cpu::largest_of(std::int64_t n, const F& f, double (&out)[M]) {
#pragma omp parallel num_threads(threads_) if (n > 16384)
    {
        double local[M] = {};
        // By turns: items that cost much may come first.
#pragma omp for schedule(static, 1024) nowait
        for (std::int64_t i = 0; i < n; ++i) f(i, local);
#pragma omp critical(mpm_maxima)
        for (int m = 0; m < M; ++m) out[m] = std::max(out[m], local[m]);
    }
}

}  // namespace mpm
