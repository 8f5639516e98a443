#include "mpm/solver/rows.hpp"

#include <cstdlib>
#include <exception>
#include <mutex>
#include <string>
#include <thread>

#include "mpm/core/error.hpp"

namespace mpm {

namespace {

constexpr std::uint64_t least_points = std::uint64_t(1) << 15;  // that a thread is worth

thread_local bool within_parts = false;

void check_range(std::uint64_t first, std::uint64_t last, std::uint64_t count) {
    if (first > last || last > count)
        throw SceneError("rows " + std::to_string(first) + " to " + std::to_string(last) + " of " +
                         std::to_string(count) + " points");
}

}  // namespace

std::uint64_t most_threads() {
    const unsigned there = std::max(1u, std::thread::hardware_concurrency());
    const char* asked = std::getenv("OMP_NUM_THREADS");
    const int most = asked ? std::atoi(asked) : 0;
    return most > 0 ? std::min(there, unsigned(most)) : there;
}

void in_parallel(std::uint64_t n, std::uint64_t least,
                 const std::function<void(std::uint64_t, std::uint64_t)>& f) {
    const std::uint64_t parts =
        within_parts ? 1 : std::min(most_threads(), n / std::max<std::uint64_t>(least, 1));
    if (parts <= 1) {
        if (n > 0) f(0, n);
        return;
    }
    std::mutex lock;
    std::exception_ptr thrown;
    const auto work = [&](std::uint64_t part) {
        within_parts = true;
        try {
            f(n * part / parts, n * (part + 1) / parts);
        } catch (...) {
            const std::lock_guard<std::mutex> held(lock);
            if (!thrown) thrown = std::current_exception();
        }
        within_parts = false;
    };
    std::vector<std::thread> threads;
    threads.reserve(parts - 1);
    std::uint64_t started = 1;
    try {
        for (; started < parts; ++started) threads.emplace_back(work, started);
    } catch (const std::exception&) {
        // No more threads, or memory for them, to be had: the rest is for this one.
    }
    work(0);
    for (; started < parts; ++started) work(started);
    for (std::thread& t : threads) t.join();
    if (thrown) std::rethrow_exception(thrown);
}

LatticePoints::LatticePoints(int dimension, std::vector<Run> runs)
    : dimension_(dimension), runs_(std::move(runs)), start_{0} {
    for (const Run& run : runs_)
        start_.push_back(start_.back() + run.x.size() * run.section->count());
}

void LatticePoints::fill(std::uint64_t first, std::uint64_t last, double* out, int stride) const {
    if (dimension_ == 0) return;
    std::size_t run =
        std::size_t(std::upper_bound(start_.begin(), start_.end(), first) - start_.begin()) - 1;
    for (; first < last; ++run) {
        const Run& r = runs_[run];
        const std::uint64_t end = std::min(last, start_[run + 1]), size = r.section->count();
        while (first < end) {
            const std::uint64_t k = (first - start_[run]) / size,
                                inside = (first - start_[run]) % size;
            // Of points alone as many as there are, else what is left of one section.
            const std::uint64_t n =
                dimension_ == 1 ? end - first : std::min(size - inside, end - first);
            for (std::uint64_t i = 0; i < n; ++i)
                out[i * std::uint64_t(stride)] = r.x[dimension_ == 1 ? k + i : k];
            r.section->fill(inside, inside + n, out + 1, stride);
            out += n * std::uint64_t(stride);
            first += n;
        }
    }
}

Rows lattice_rows(std::shared_ptr<const LatticePoints> points) {
    Rows rows([points = std::move(points)](std::uint64_t first, std::uint64_t last, double* out) {
        check_range(first, last, points->count());
        const int d = points->dimension();
        in_parallel(last - first, least_points, [&](std::uint64_t a, std::uint64_t b) {
            points->fill(first + a, first + b, out + a * std::uint64_t(d), d);
        });
    });
    rows.at_hand = true;
    return rows;
}

Rows still_water_rows(std::shared_ptr<const LatticePoints> points, StillWater water) {
    Rows rows([points = std::move(points), water = std::move(water)](
                  std::uint64_t first, std::uint64_t last, double* out) {
        check_range(first, last, points->count());
        const std::size_t d = std::size_t(points->dimension());
        in_parallel(last - first, least_points, [&](std::uint64_t a, std::uint64_t b) {
            std::vector<double> x((b - a) * d);
            points->fill(first + a, first + b, x.data(), int(d));
            for (std::uint64_t k = 0; k < b - a; ++k) {
                double height = 0;
                for (std::size_t i = 0; i < d; ++i) height += x[k * d + i] * water.up[i];
                out[a + k] = water.strength * std::max(water.top - height, 0.0);
            }
        });
    });
    rows.at_hand = true;
    return rows;
}

Rows chosen_rows(const Rows& all, std::shared_ptr<const RowRuns> runs, int width) {
    if (!all) return {};
    Rows chosen([all, runs, width](std::uint64_t first, std::uint64_t last, double* out) {
        // Runs close to each other are asked for at once.
        constexpr std::uint64_t at_once = std::uint64_t(1) << 16;
        const std::uint64_t w = std::uint64_t(width);
        std::vector<double> piece;
        struct Part {
            std::uint64_t row, n, place;
        };
        std::vector<Part> parts;
        const auto flush = [&] {
            if (parts.empty()) return;
            const std::uint64_t from = parts.front().row, to = parts.back().row + parts.back().n;
            if (parts.size() == 1) {
                all(from, to, out + (parts[0].place - first) * w);
            } else {
                piece.resize((to - from) * w);
                all(from, to, piece.data());
                for (const Part& p : parts)
                    std::copy_n(piece.begin() + std::ptrdiff_t((p.row - from) * w), p.n * w,
                                out + (p.place - first) * w);
            }
            parts.clear();
        };
        runs->each(first, last, [&](std::uint64_t row, std::uint64_t n, std::uint64_t place) {
            if (!parts.empty() && row + n > parts.front().row + at_once) flush();
            parts.push_back({row, n, place});
        });
        flush();
    });
    if (all.at_hand) {
        chosen.at_hand = true;
        return chosen;
    }
    std::vector<double> out(runs->count() * std::uint64_t(width));
    chosen(0, runs->count(), out.data());
    return rows_of(std::move(out), width);
}

}  // namespace mpm
