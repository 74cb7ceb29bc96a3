#include "algo/maps/row_thread_pool.h"

#include <algorithm>
#include <string>
#include <system_error>

namespace hord::algo {
namespace {

constexpr int kBandsPerThread = 4;
constexpr int kMinRows = 16;

}  // namespace

// The next band of the worker's own share, then the last one of the worker with most left; -1: none is left.
int RowThreadPool::next_band(int worker) {
    Share& own = shares_[static_cast<std::size_t>(worker)];
    if (own.left() > 0) return own.next++;
    Share& most = *std::ranges::max_element(shares_, {}, &Share::left);
    return most.left() > 0 ? --most.end : -1;
}

// Takes bands until none is left.
void RowThreadPool::work(int worker, std::unique_lock<std::mutex>& lock) {
    for (int band = next_band(worker); band >= 0; band = next_band(worker)) {
        lock.unlock();
        call_(context_, worker, band);
        lock.lock();
    }
}

void RowThreadPool::serve(int worker) {
    std::unique_lock lock(mutex_);
    for (unsigned last_round = 0;;) {
        wake_.wait(lock, [&] { return closing_ || round_ != last_round; });
        if (closing_) return;
        last_round = round_;
        work(worker, lock);
        if (--busy_ == 0) done_.notify_one();
    }
}

Result<std::unique_ptr<RowThreadPool>> RowThreadPool::create(int threads) {
    if (threads < 1 || threads > kMaxThreads) {
        return fail(ErrorCode::invalid_argument, std::to_string(threads) + " threads",
                    "use 1 to " + std::to_string(kMaxThreads));
    }
    std::unique_ptr<RowThreadPool> pool(new RowThreadPool);
    pool->shares_.resize(static_cast<std::size_t>(threads));
    try {
        for (int worker = 1; worker < threads; ++worker)
            pool->others_.emplace_back([self = pool.get(), worker] { self->serve(worker); });
    } catch (const std::system_error& e) {
        return fail(ErrorCode::busy, "no thread for a band of rows", e.what());
    }
    return pool;
}

RowThreadPool::~RowThreadPool() {
    {
        const std::lock_guard lock(mutex_);
        closing_ = true;
    }
    wake_.notify_all();
    for (std::thread& other : others_) other.join();
}

int RowThreadPool::threads() const { return static_cast<int>(others_.size()) + 1; }

int RowThreadPool::rows_a_band(int rows) const {
    const int bands = threads() == 1 ? 1 : threads() * kBandsPerThread;
    return std::max((rows + bands - 1) / bands, std::min(rows, kMinRows));
}

void RowThreadPool::share_out(int bands, Call call, void* context) {
    std::unique_lock lock(mutex_);
    call_ = call;
    context_ = context;
    const int workers = threads();
    for (int k = 0; k < workers; ++k)
        shares_[static_cast<std::size_t>(k)] = {bands * k / workers, bands * (k + 1) / workers};
    busy_ = workers - 1;
    ++round_;
    wake_.notify_all();
    work(0, lock);
    done_.wait(lock, [&] { return busy_ == 0; });
}

}  // namespace hord::algo
