#include "algo/maps/row_thread_pool.h"

#include <algorithm>
#include <condition_variable>
#include <mutex>
#include <string>
#include <system_error>
#include <thread>
#include <vector>

namespace hord::algo {
namespace {

constexpr int kBandsPerThread = 4;
constexpr int kMinRows = 16;

}  // namespace

struct RowThreadPool::State {
    std::mutex mutex;
    std::condition_variable wake, done;
    std::vector<std::thread> others;
    bool closing = false;

    // The current work. `round` counts share_out() calls: a new number wakes the threads.
    unsigned round = 0;
    Call call = nullptr;
    void* context = nullptr;
    struct Share {
        int next, end;  // bands
        [[nodiscard]] int left() const { return end - next; }
    };
    std::vector<Share> shares;  // one per worker
    int busy = 0;               // others that have not finished this round

    void share(int bands) {
        const int workers = static_cast<int>(shares.size());
        for (int k = 0; k < workers; ++k)
            shares[static_cast<std::size_t>(k)] = {bands * k / workers, bands * (k + 1) / workers};
    }
    // The next band of the worker's own share, then the last one of the worker with most left; -1: none is left.
    int next_band(int worker) {
        Share& own = shares[static_cast<std::size_t>(worker)];
        if (own.left() > 0) return own.next++;
        Share& most = *std::ranges::max_element(shares, {}, &Share::left);
        return most.left() > 0 ? --most.end : -1;
    }
    // Takes bands until none is left.
    void work(int worker, std::unique_lock<std::mutex>& lock) {
        for (int band = next_band(worker); band >= 0; band = next_band(worker)) {
            lock.unlock();
            call(context, worker, band);
            lock.lock();
        }
    }

    void serve(int worker) {
        std::unique_lock lock(mutex);
        for (unsigned last_round = 0;;) {
            wake.wait(lock, [&] { return closing || round != last_round; });
            if (closing) return;
            last_round = round;
            work(worker, lock);
            if (--busy == 0) done.notify_one();
        }
    }
};

Result<std::unique_ptr<RowThreadPool>> RowThreadPool::create(int threads) {
    if (threads < 1 || threads > kMaxThreads) {
        return fail(ErrorCode::invalid_argument, std::to_string(threads) + " threads",
                    "use 1 to " + std::to_string(kMaxThreads));
    }
    std::unique_ptr<RowThreadPool> pool(new RowThreadPool(std::make_unique<State>()));
    State& state = *pool->state_;
    state.shares.resize(static_cast<std::size_t>(threads));
    try {
        for (int worker = 1; worker < threads; ++worker)
            state.others.emplace_back([&state, worker] { state.serve(worker); });
    } catch (const std::system_error& e) {
        return fail(ErrorCode::busy, "no thread for a band of rows", e.what());
    }
    return pool;
}

RowThreadPool::RowThreadPool(std::unique_ptr<State> state) : state_(std::move(state)) {}

RowThreadPool::~RowThreadPool() {
    {
        const std::lock_guard lock(state_->mutex);
        state_->closing = true;
    }
    state_->wake.notify_all();
    for (std::thread& other : state_->others) other.join();
}

int RowThreadPool::threads() const { return static_cast<int>(state_->others.size()) + 1; }

int RowThreadPool::rows_a_band(int rows) const {
    const int bands = threads() == 1 ? 1 : threads() * kBandsPerThread;
    return std::max((rows + bands - 1) / bands, std::min(rows, kMinRows));
}

void RowThreadPool::share_out(int bands, Call call, void* context) {
    State& state = *state_;
    std::unique_lock lock(state.mutex);
    state.call = call;
    state.context = context;
    state.share(bands);
    state.busy = static_cast<int>(state.others.size());
    ++state.round;
    state.wake.notify_all();
    state.work(0, lock);
    state.done.wait(lock, [&] { return state.busy == 0; });
}

}  // namespace hord::algo
