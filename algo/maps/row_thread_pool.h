// A crew of threads that shares out bands of rows.
//
// The threads live as long as the crew and sleep between calls; sharing out allocates nothing. Each thread has a run of
// bands, one after the other; who is done with it takes from others' ends. So which thread works on which band is left
// to chance, and a band's result must not depend on it.
#pragma once

#include <memory>

#include "common/result.h"

namespace hord::algo {

class RowThreadPool {
  public:
    // threads: 1..kMaxThreads, the calling thread included. Fails with busy when the system gives no thread.
    static Result<std::unique_ptr<RowThreadPool>> create(int threads);
    static constexpr int kMaxThreads = 64;

    RowThreadPool(const RowThreadPool&) = delete;
    RowThreadPool& operator=(const RowThreadPool&) = delete;
    ~RowThreadPool();

    [[nodiscard]] int threads() const;

    // Rows for a band to have where each band also reads the row before and the row after it: all of them for one
    // thread, else few bands a thread, so that little is read twice, yet no thread waits long for another that was held
    // up.
    [[nodiscard]] int rows_a_band(int rows) const;

    // Calls work(worker, band) once for every band 0..bands-1, worker being 0 (the calling thread) to threads()-1, and
    // returns when all are done. `work` must not throw. Not to be called by two threads at once.
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
    struct State;
    explicit RowThreadPool(std::unique_ptr<State> state);
    void share_out(int bands, Call call, void* context);
    std::unique_ptr<State> state_;
};

}  // namespace hord::algo
