// Learns a reference (algo/reference/reference.h) from the next parts of the running line, while the line goes on.
//
// The next parts that are inspected count as good, whatever the verdict says of them. An inspecting thread copies a
// frame into one buffer when that is free, and never waits: a part that comes while the one before is still written to
// the disk is passed over, the next one serves. A thread of its own, which leaves the processor to the others (nice
// 10), writes the frames to
//     <folder>/teach/                                  (removed afterwards, and at the next start where a process was
//     killed)
// learns from them, one frame in memory at a time, has the recipe with its new reference judge them once, and writes
//     <folder>/references/taught-<recipe>-<n>.hordref  n: one more than the highest there
//     <folder>/recipe-taught.toml                      the recipe with it, so that a restart finds what waits for the
//     line to stop
// An inspecting thread allocates nothing and shares no lock with that thread.
#pragma once

#include <atomic>
#include <cstdint>
#include <filesystem>
#include <functional>
#include <memory>
#include <optional>
#include <string>
#include <thread>
#include <vector>

#include "algo/inspection/pipeline.h"
#include "algo/reference/reference.h"
#include "drivers/hal/event_loop.h"
#include "firmware/recipes/recipe_file.h"

namespace hord::firmware {

// The recipe that it was asked with, and its new reference. Both are on the disk.
struct Taught {
    NumberedRecipe recipe;
    std::string remarks;  // which parts were left out or would not pass, and why; empty: none
};

class TeachIn {
  public:
    static constexpr std::uint32_t kMinParts = algo::Reference::kMinParts, kMaxParts = 64, kUsualParts = 16;

    // Told on the loop's thread.
    struct Listener {
        std::function<void(std::uint32_t parts)>
            taken;                                 // so many frames are there now; 0: the next part may be the first
        std::function<void(Result<Taught>)> done;  // once; not after cancel()
    };

    virtual ~TeachIn() = default;

    // Loop thread, does not block. From the next part on. `parts` is from kMinParts to kMaxParts. Fails with busy (a
    // teach, or the end of one that was cancelled, is under way), and when the system gives no thread; later with io
    // (the disk), and with invalid_argument (no reference comes of these parts). Then nothing is left behind.
    Result<void> begin(std::uint32_t parts, const NumberedRecipe& recipe, Listener listener) {
        return do_begin(parts, recipe, std::move(listener));
    }

    // Loop thread, does not block. Nothing is left behind. No effect where none is under way.
    void cancel() { do_cancel(); }

    // Loop thread. What was taught will not be used: its files are removed.
    void discard(const NumberedRecipe& taught) { do_discard(taught); }

    // Loop thread. This recipe is in use, and remembered as such: what earlier teaches of its number left is removed.
    void in_use(const NumberedRecipe& recipe) { do_in_use(recipe); }

  private:
    virtual Result<void> do_begin(std::uint32_t parts, const NumberedRecipe& recipe, Listener listener) = 0;
    virtual void do_cancel() = 0;
    virtual void do_discard(const NumberedRecipe& taught) = 0;
    virtual void do_in_use(const NumberedRecipe& recipe) = 0;
};

struct TeachInOptions {
    algo::Extents extents = {};
    int bits = 8;
    std::filesystem::path folder = {};        // exists
    std::uint64_t leave_free_bytes = 0;       // of the disk
    std::uint32_t ignored_part = 0xFFFFFFFF;  // of the station's own tests
    bool thread = true;                       // false: the loop's thread does the work, for virtual time
};

class LineTeachIn final : public TeachIn {
  public:
    LineTeachIn(hal::EventLoop& loop, TeachInOptions options);
    ~LineTeachIn() override;  // cancels, and waits; no on_inspection() comes any more
    LineTeachIn(const LineTeachIn&) = delete;
    LineTeachIn& operator=(const LineTeachIn&) = delete;

    // Any thread, several at the same time; what is borrowed is copied.
    void on_inspection(std::uint32_t part, const FrameView& frame, const algo::Inspection& inspection);

    // What was taught before the process ended and had not come into use: the recipe to take in place of `recipe`;
    // none: nothing was. Fails as remembered_recipe().
    [[nodiscard]] static Result<std::optional<NumberedRecipe>> left_waiting(const std::filesystem::path& folder,
                                                                            const NumberedRecipe& recipe);

  private:
    enum class Slot : std::uint32_t { closed, empty, filling, full };
    struct TeachSession;
    Result<void> do_begin(std::uint32_t parts, const NumberedRecipe& recipe, Listener listener) override;
    void do_cancel() override;
    void do_discard(const NumberedRecipe& taught) override;
    void do_in_use(const NumberedRecipe& recipe) override;

    void work();
    [[nodiscard]] Result<Taught> teach();
    [[nodiscard]] Result<void> prepare();
    [[nodiscard]] Result<void> spool();
    void tell(std::size_t taken);
    [[nodiscard]] Result<Taught> learn();
    [[nodiscard]] Result<std::string> judge_them_again(const algo::Recipe& recipe, const std::vector<bool>& left_out);
    [[nodiscard]] Result<Frame> spooled(std::size_t k) const;
    [[nodiscard]] std::filesystem::path spool_file(std::size_t k) const;
    [[nodiscard]] std::filesystem::path next_reference(std::uint16_t number) const;
    void step();
    void finish(Result<Taught> outcome);
    void finished(Result<Taught>& outcome);

    hal::EventLoop& loop_;
    const TeachInOptions options_;
    std::shared_ptr<char> life_ = std::make_shared<char>();
    const std::weak_ptr<char> alive_ = life_;  // what was posted asks it

    // Handed from the loop's thread to the teacher's and back.
    std::unique_ptr<TeachSession> lesson_;
    std::thread thread_;

    // The hand-over: who finds it empty fills it; who made it full is heard by the teacher's thread.
    std::atomic<Slot> slot_{Slot::closed};
    std::atomic<bool> cancelled_{false};
    std::atomic<bool> ended_{false};  // finish() was called
    Frame frame_;
    std::uint32_t frame_part_ = 0;
};

}  // namespace hord::firmware
