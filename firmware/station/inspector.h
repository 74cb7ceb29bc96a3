// Inspects frames on threads of its own: borrows a frame, answers on the loop's thread.
#pragma once

#include <cstdint>
#include <functional>
#include <memory>
#include <vector>

#include "algo/frame/grid_decoder.h"
#include "algo/inspection/pipeline.h"
#include "common/result.h"
#include "drivers/hal/event_loop.h"
#include "drivers/hal/sensor.h"
#include "firmware/core/events.h"

namespace hord::firmware {

// Receives every inspection with its macro-pixel frame (a raw frame after decoding) and maps, by reference. Called on
// the inspecting threads, concurrently; references are valid during the call only.
class InspectionObserver {
  public:
    virtual ~InspectionObserver() = default;
    virtual void on_inspection(std::uint32_t part, const FrameView& frame, const algo::Inspection& inspection) = 0;
};

class Inspector {
  public:
    // Called on the loop's thread.
    class Listener {
      public:
        virtual void on_judged(
            const Judged& judged) = 0;  // exactly once for every accepted submit(), unless stopped before

      protected:
        ~Listener() = default;
    };

    virtual ~Inspector() = default;

    // Loop thread. Judgements go to `listener` until stop(). When already started, the listener is replaced.
    virtual void start(Listener& listener) = 0;

    // Loop thread, does not block. The frame returns to its sensor when it is judged, or at once on failure.
    // Fails with busy (the queue is full), disconnected (not started).
    virtual Result<void> submit(std::uint32_t part, hal::FrameLease frame) = 0;

    // Loop thread. Waits for the frame that is being inspected; no call reaches the listener after it returns.
    virtual void stop() = 0;

    // Loop thread, while the station does not execute. Switches to another recipe. Waits for the frame that is being
    // inspected; queued frames are returned unjudged. Fails with invalid_argument (the recipe does not fit the light
    // field; the old one stays), unsupported (no function to remake the inspection).
    virtual Result<void> use(const algo::Recipe& recipe, std::uint16_t number);

    // Loop thread. Number of queued frames.
    [[nodiscard]] virtual std::size_t waiting() const { return 0; }

    // Loop thread. Calls `all_here` on the loop's thread once every inspecting thread has answered: at once without
    // threads, after its frame if one is busy, never if one hangs. A later call replaces a pending one.
    virtual void liveness_check(std::function<void()> all_here) {  // NOLINT: threads keep it
        all_here();
    }
};

struct InspectorSettings {
    algo::Extents extents;
    int bits = 8;
    std::shared_ptr<const algo::GridDecoder> decoder =
        nullptr;  // for raw frames, with these extents; null: macro-pixel frames
    algo::Recipe recipe;
    std::uint16_t recipe_number = kNoNumber;  // copied to every Judged
    int threads = 1;                          // each with a pipeline of its own
    int queue = 8;                            // queued frames; one more is refused with busy
    InspectionObserver* observer = nullptr;   // outlives the inspector
    algo::NowNs now = nullptr;                // clock for Inspection::times and limits; null: they stay 0
    algo::InspectionLimits limits = {};       // of an inspection
};

// Worker threads; answers through loop.post(). Fails as Pipeline::create does.
Result<std::unique_ptr<Inspector>> make_threaded_inspector(hal::EventLoop& loop, const InspectorSettings& settings);

// The same with any function, one a thread.
using InspectFunction = std::function<Judged(std::uint32_t part, const hal::FrameLease& frame)>;
using MakeInspectFunctions =
    std::function<Result<std::vector<InspectFunction>>(const algo::Recipe& recipe, std::uint16_t number)>;
// The pipeline as such a function. Fails as Pipeline::create does.
Result<InspectFunction> make_pipeline_judge(const InspectorSettings& settings);
// `remake` creates the functions for another recipe; without it use() is unsupported.
std::unique_ptr<Inspector> make_threaded_inspector(hal::EventLoop& loop, int queue,
                                                   std::vector<InspectFunction> functions,
                                                   MakeInspectFunctions remake = nullptr);

}  // namespace hord::firmware
