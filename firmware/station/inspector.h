// Who judges frames: takes a frame on loan, answers on the loop's thread.
//
// Three kinds: threaded (the service), inline in virtual time (simulation: the real pipeline runs at once, its answer
// comes after a modelled time), and a stand-in without any pipeline (tests of the control, millions of parts).
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

// Sees every inspection as it is made, with its macro-pixel frame (the raw one, decoded) and maps, nothing copied.
// Called on the thread that inspects (with several threads: on each, at the same time); everything borrowed is valid
// during the call only.
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
            const Judged& judged) = 0;  // exactly one for every accepted submit(), unless stopped before

      protected:
        ~Listener() = default;
    };

    virtual ~Inspector() = default;

    // Loop thread. Judgements go to `listener` until stop(). Harmless when already started (the listener is replaced).
    void start(Listener& listener) { do_start(listener); }

    // Loop thread, does not block. The frame goes back to its sensor when it is judged, or at once on failure.
    // Fails with busy (the queue is full), disconnected (not started).
    Result<void> submit(std::uint32_t part, hal::FrameLease frame) { return do_submit(part, std::move(frame)); }

    // Loop thread. Waits for the frame that is being inspected; no call reaches the listener after it returns.
    void stop() { do_stop(); }

    // Loop thread, while the station does not execute: judges with another recipe from now on. Waits for the frame that
    // is being inspected; frames that wait are given back unjudged. Fails with invalid_argument (the recipe does not
    // fit the light field; the old one stays), unsupported (a stand-in).
    Result<void> use(const algo::Recipe& recipe, std::uint16_t number) { return do_use(recipe, number); }

    // Loop thread. Frames that wait for a thread now.
    [[nodiscard]] std::size_t waiting() const { return do_waiting(); }

    // Loop thread. `all_here` runs on the loop's thread once every thread has taken a turn: at once when none is
    // started, after its frame when one is busy, never when one hangs. A later call replaces an earlier one that waits.
    void liveness_check(std::function<void()> all_here) { do_liveness_check(std::move(all_here)); }

  private:
    virtual void do_start(Listener& listener) = 0;
    virtual void do_liveness_check(std::function<void()> all_here) { all_here(); }
    virtual Result<void> do_use(const algo::Recipe& recipe, std::uint16_t number);
    [[nodiscard]] virtual std::size_t do_waiting() const { return 0; }
    virtual Result<void> do_submit(std::uint32_t part, hal::FrameLease frame) = 0;
    virtual void do_stop() = 0;
};

struct InspectorSettings {
    algo::Extents extents;
    int bits = 8;
    std::shared_ptr<const algo::GridDecoder> decoder =
        nullptr;  // of raw frames, of these extents; none: frames are macro-pixels
    algo::Recipe recipe;
    std::uint16_t recipe_number = kNoNumber;  // comes back in every Judged
    int threads = 1;                          // each with a pipeline of its own
    int queue = 8;                            // frames that may wait; one more is refused as busy
    InspectionObserver* observer = nullptr;   // outlives the inspector
    algo::NowNs now = nullptr;                // the clock of Inspection::times; none: they stay 0
};

// Worker threads; answers through loop.post(). Fails with what Pipeline::create says.
Result<std::unique_ptr<Inspector>> make_threaded_inspector(hal::EventLoop& loop, const InspectorSettings& settings);

// The same with any way of judging, one a thread.
using InspectFunction = std::function<Judged(std::uint32_t part, const hal::FrameLease& frame)>;
using Judges = std::function<Result<std::vector<InspectFunction>>(const algo::Recipe& recipe, std::uint16_t number)>;
// The pipeline as one. Fails with what Pipeline::create says.
Result<InspectFunction> make_pipeline_judge(const InspectorSettings& settings);
// `remake` makes them for another recipe; without it use() is unsupported.
std::unique_ptr<Inspector> make_threaded_inspector(hal::EventLoop& loop, int queue, std::vector<InspectFunction> judges,
                                                   Judges remake = nullptr);

// Inspects inside submit(), answers `modelled` later by a timer. `threads` bounds how many parts are in the modelled
// work at the same time, `queue` how many wait.
Result<std::unique_ptr<Inspector>> make_inline_inspector(hal::EventLoop& loop, const InspectorSettings& settings,
                                                         hal::Duration modelled);

// No pipeline: `judge` says what to answer and how much later. `queue` bounds the parts under way.
struct StandInAnswer {
    Judged judged;  // `part` is filled in
    hal::Duration after{};
};
using StandIn = std::function<StandInAnswer(std::uint32_t part, const hal::FrameLease& frame)>;
std::unique_ptr<Inspector> make_stand_in_inspector(hal::EventLoop& loop, int queue, StandIn judge);

}  // namespace hord::firmware
