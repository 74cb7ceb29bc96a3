// A pool of threads that share bands of rows.
//
// The threads live as long as the pool and sleep between calls; share_out() allocates nothing. Each thread has a run of
// consecutive bands; a thread that has finished its run takes bands from the end of another's. So a band's result must
// not depend on the thread that computes it.
#pragma once

#include <condition_variable>
#include <memory>
#include <mutex>
#include <thread>
#include <type_traits>
#include <vector>

#include "common/result.h"

namespace hord::algo {

class RowThreadPool {
  public:
    // threads: 1..kMaxThreads, the calling thread included. Fails with busy if the system cannot start a thread.
    static Result<std::unique_ptr<RowThreadPool>> create(int threads);
    static constexpr int kMaxThreads = 64;

    RowThreadPool(const RowThreadPool&) = delete;
    RowThreadPool& operator=(const RowThreadPool&) = delete;
    ~RowThreadPool();

    [[nodiscard]] int threads() const;

    // Rows per band if every band also reads the rows before and after it. One thread: all rows. Else few bands per
    // thread: little is read twice, and no thread waits long for a delayed one.
    [[nodiscard]] int rows_a_band(int rows) const;

    // Calls work(worker, band) once for every band 0..bands-1 and returns when all are done. Workers are 0 (the calling
    // thread) to threads()-1. `work` must not throw. Must not be called by two threads at once.
    template <class Work>
    void share_out(int bands, Work&& work) {
        share_out(
            bands,
            [](void* context, int worker, int band) {
                (*static_cast<std::remove_reference_t<Work>*>(context))(worker, band);
            },
            &work);
    }

  private:
    using Call = void (*)(void* context, int worker, int band);
    struct Share {
        int next = 0, end = 0;  // bands
        [[nodiscard]] int left() const { return end - next; }
    };
    RowThreadPool() = default;
    void share_out(int bands, Call call, void* context);
    int next_band(int worker);
    void work(int worker, std::unique_lock<std::mutex>& lock);
    void serve(int worker);

    std::mutex mutex_;
    std::condition_variable wake_, done_;
    std::vector<std::thread> others_;
    bool closing_ = false;
    // The current work. `round_` counts share_out() calls: a new number wakes the threads.
    unsigned round_ = 0;
    Call call_ = nullptr;
    void* context_ = nullptr;
    std::vector<Share> shares_;  // one per worker
    int busy_ = 0;               // others that have not finished this round
};

}  // namespace hord::algo
