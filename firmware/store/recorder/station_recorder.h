// The station's ResultSink over the store: results go to a StoreQueue, frames to a FrameRetention. Joins a part's
// defects (known at its inspection) with its result (known past the ejector). Never waits for a disk.
#pragma once

#include <cstdint>
#include <deque>
#include <functional>
#include <memory>
#include <mutex>
#include <string>
#include <vector>

#include "drivers/hal/clock.h"
#include "firmware/station/result_sink.h"
#include "firmware/store/frames/frame_retention.h"
#include "firmware/store/results/store_queue.h"

namespace hord::firmware::store {

struct StationRecorderOptions {
    StartRecord start = {};  // the run; its time is filled in
    StoreQueueOptions queue = {};
    std::uint32_t ignored_part = 0xFFFFFFFF;  // part number of self-tests, which are not recorded
};

class StationRecorder final : public ResultSink {
  public:
    // `clock` is the one of PartResult::arrived_ns; `utc_now` the machine's. `queue_listener` as StoreQueue's. `frames`
    // may be null: no frame is kept.
    StationRecorder(const hal::Clock& clock, const std::function<UtcMicros()>& utc_now, StoreQueue::Open open,
                    StationRecorderOptions options, StoreQueue::Listener queue_listener,
                    std::unique_ptr<FrameRetention> frames);

    // Call before the station runs. Records what is in use, if it differs from the store's newest.
    void in_use(ChangeRecord::What what, const std::string& name, const std::string& text);

    void on_result(const PartResult& result) override;
    AckStatus on_acknowledged(const RequestOrigin& who, std::uint32_t sequence) override;
    void on_change(const Change& change) override;
    void on_inspection(std::uint32_t part, const FrameView& frame, const algo::Inspection& inspection) override;

    // Writes what waits; blocks for some seconds at most if the store fails. Errors name what is in no store then. Call
    // once, when nothing is reported any more.
    std::vector<Error> finish();

    [[nodiscard]] StoreQueueState state() const { return queue_.state(); }
    // For tests without a thread.
    bool step() { return queue_.step(); }

  private:
    // Defects of an inspection, until the part's result comes.
    struct Found {
        std::uint32_t part = 0;
        std::vector<algo::Defect> defects;
    };
    [[nodiscard]] UtcMicros utc_of(std::int64_t station_ns) const;

    const hal::Clock& clock_;
    const std::function<UtcMicros()> utc_now_;
    const std::uint32_t ignored_part_;
    std::unique_ptr<FrameRetention> frames_;
    std::mutex mutex_;
    std::deque<Found> found_;  // the newest last; those without defects are not in it
    StoreQueue queue_;
};

}  // namespace hord::firmware::store
