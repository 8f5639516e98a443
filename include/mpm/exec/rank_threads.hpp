// Ranks that are threads of one process: messages lie in boxes until they are fetched. No barrier:
// a rank waits only for those it exchanges with.
#pragma once

#include <condition_variable>
#include <exception>
#include <functional>
#include <map>
#include <memory>
#include <mutex>
#include <thread>
#include <tuple>

#include "mpm/exec/communicator.hpp"

namespace mpm {

class RankThreads {
public:
    explicit RankThreads(int ranks) {
        for (int r = 0; r < ranks; ++r) ends_.push_back(std::make_unique<End>(*this, r, ranks));
    }
    RankThreads(const RankThreads&) = delete;
    RankThreads& operator=(const RankThreads&) = delete;
    virtual ~RankThreads() = default;

    int ranks() const { return int(ends_.size()); }
    Communicator& of(int rank) { return *ends_.at(std::size_t(rank)); }

    /// After a failure, while nobody is at work: ranks may begin anew, from a state that they are
    /// given. What was on its way is lost.
    void begin_anew() {
        const std::lock_guard lock(mutex_);
        box_.clear();
        stopped_ = false;
        ++begun_;
        for (auto& end : ends_) end->begin(begun_ << 40);
    }

    /// Runs work(rank) on a thread for each rank and waits for all. When one fails the others are
    /// stopped, and what it threw is thrown here; that of the lowest rank where several did.
    void together(const std::function<void(int)>& work) {
        std::vector<std::exception_ptr> failed(ends_.size());
        std::vector<bool> stopped(ends_.size(), false);
        std::mutex mutex;
        const auto guarded = [&](int rank) {
            const std::size_t r = std::size_t(rank);
            const auto keep = [&](bool by_another) {
                const std::lock_guard lock(mutex);
                failed[r] = std::current_exception();
                stopped[r] = by_another;
            };
            try {
                work(rank);
            } catch (const RankStopped&) {
                keep(true);
            } catch (const std::exception& e) {
                keep(false);
                of(rank).stop("rank " + std::to_string(rank) + ": " + e.what());
            } catch (...) {
                keep(false);
                of(rank).stop("rank " + std::to_string(rank) + " has failed");
            }
        };
        std::vector<std::thread> threads;
        for (int r = 1; r < ranks(); ++r) threads.emplace_back(guarded, r);
        guarded(0);
        for (auto& t : threads) t.join();
        for (const bool by_another : {false, true})
            for (std::size_t r = 0; r < failed.size(); ++r)
                if (failed[r] && stopped[r] == by_another) std::rethrow_exception(failed[r]);
    }

protected:
    /// Which message: from whom, to whom, and its number among those.
    struct Address {
        int from, to;
        std::uint64_t number;
        bool operator<(const Address& o) const {
            return std::tie(from, to, number) < std::tie(o.from, o.to, o.number);
        }
    };

    /// On its way. Tests override it to hold messages back and to bring them out of order.
    virtual void send(const Address& where, Bytes bytes) { deliver(where, std::move(bytes)); }
    /// And to read others in their place.
    using Reader = std::function<void(const Bytes&)>;
    virtual void hand_over(int /*from*/, int /*to*/, const char* /*what*/, Bytes& bytes,
                           const Reader& read) {
        read(bytes);
    }

    void deliver(const Address& where, Bytes bytes) {
        {
            const std::lock_guard lock(mutex_);
            box_[where] = std::move(bytes);
        }
        arrived_.notify_all();
    }

private:
    class End final : public Communicator {
    public:
        End(RankThreads& all, int rank, int ranks)
            : all_(all),
              rank_(rank),
              sent_(std::size_t(ranks), 0),
              fetched_(std::size_t(ranks), 0) {}
        int rank() const override { return rank_; }
        int ranks() const override { return all_.ranks(); }
        std::vector<Bytes> exchange(std::vector<Bytes> to, const std::vector<int>& peers) override {
            for (int p : peers)
                all_.send({rank_, p, sent_[std::size_t(p)]++}, std::move(to.at(std::size_t(p))));
            std::vector<Bytes> in(all_.ends_.size());
            for (int p : peers)
                in[std::size_t(p)] = all_.fetch({p, rank_, fetched_[std::size_t(p)]++});
            return in;
        }
        void stop(const std::string& why) noexcept override { all_.stop(why); }
        void check() override { all_.check(); }
        /// Numbers of messages from here on.
        void begin(std::uint64_t number) {
            sent_.assign(sent_.size(), number);
            fetched_.assign(fetched_.size(), number);
        }

    protected:
        void hand_over(int from, const char* what, Bytes& bytes, const Reader& read) override {
            all_.hand_over(from, rank_, what, bytes, read);
        }

    private:
        RankThreads& all_;
        int rank_;
        std::vector<std::uint64_t> sent_, fetched_;  // by rank
    };

    Bytes fetch(const Address& where) {
        std::unique_lock lock(mutex_);
        auto found = box_.end();
        arrived_.wait(lock, [&] {
            found = box_.find(where);
            return found != box_.end() || stopped_;
        });
        if (stopped_) throw RankStopped(why_);
        Bytes bytes = std::move(found->second);
        box_.erase(found);
        return bytes;
    }
    void check() {
        const std::lock_guard lock(mutex_);
        if (stopped_) throw RankStopped(why_);
    }
    void stop(const std::string& why) noexcept {
        {
            const std::lock_guard lock(mutex_);
            if (!stopped_) why_ = why;
            stopped_ = true;
        }
        arrived_.notify_all();
    }

    std::vector<std::unique_ptr<End>> ends_;
    std::mutex mutex_;
    std::condition_variable arrived_;
    std::map<Address, Bytes> box_;
    bool stopped_ = false;
    std::string why_;
    std::uint64_t begun_ = 0;
};

}  // namespace mpm
