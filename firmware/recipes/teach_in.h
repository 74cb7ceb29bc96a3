// Teach-in: learns a reference (algo/reference/reference.h) from the next parts of the running line.
//
// The next inspected parts count as good, independent of their verdict. An inspecting thread copies a frame into a
// single buffer if that is free, and never waits: parts that come while the last frame is being written to the disk are
// skipped. A background thread (nice 10) writes the frames to
//     <folder>/teach/                                  (removed at the end, and at the next start after a kill)
// learns from them with one frame in memory at a time, inspects them again with the new reference, and writes
//     <folder>/references/taught-<recipe>-<n>.hordref  n: one more than the highest there
//     <folder>/recipe-taught.toml                      the recipe with it; a restart finds it until the line stops
// Then the reference is told, and its report is written beside it from the same frames, which takes several times as
// long. The next teach-in, discard() and the end of the process stop the report; then none is left.
// An inspecting thread allocates nothing and shares no lock with the background thread.
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
#include "firmware/recipes/learned_parts.h"
#include "firmware/recipes/recipe_file.h"
#include "firmware/recipes/recipe_folder.h"

namespace hord::firmware {

// The recipe with its new reference, both on the disk.
struct TeachResult {
    NumberedRecipe recipe;
    // Parts that were left out, seen twice, or would be rejected, and why; then what the parts do not determine. Empty:
    // none.
    std::string remarks;
};

class TeachIn {
  public:
    static constexpr std::uint32_t kMinParts = algo::Reference::kMinParts, kMaxParts = 64, kUsualParts = 16;

    // Called on the loop's thread.
    struct Listener {
        std::function<void(std::uint32_t parts)> taken;  // number of frames so far; 0: ready for the first part
        std::function<void(Result<TeachResult>)> done;   // once; not after cancel()
    };

    virtual ~TeachIn() = default;

    // Loop thread, does not block. Starts with the next part; `parts` is in kMinParts..kMaxParts. Fails with refused (a
    // recipe that a reference does not fit) or busy (a teach-in or its cancellation is under way, or the system has no
    // thread). `done` fails with io (the disk) or invalid_argument (no reference can be learned); no file is left then.
    virtual Result<void> begin(std::uint32_t parts, const NumberedRecipe& recipe, Listener listener) = 0;

    // Loop thread, does not block. Removes the files of the teach-in under way, if there is one.
    virtual void cancel() = 0;

    // Loop thread. Removes the files of a learned recipe that will not be used.
    virtual void discard(const NumberedRecipe& learned) = 0;

    // Loop thread. Call it when this recipe is in use and remembered: removes the files of earlier teach-ins of its
    // number, reports included.
    virtual void in_use(const NumberedRecipe& recipe) = 0;
};

struct TeachInOptions {
    algo::Extents extents = {};
    int bits = 8;
    std::filesystem::path folder = {};        // must exist
    std::uint64_t leave_free_bytes = 0;       // on the disk
    std::uint32_t ignored_part = 0xFFFFFFFF;  // number of the station's own test parts
    // Before each write and removal: whether `folder` is still the station's. Any thread. Empty: it is.
    std::function<Result<void>()> check_folder = {};
    bool thread = true;  // false: works on the loop's thread, for virtual time
    // Writes the report_file()s of the reference, on the background thread. Its `frame_of` fails when the report is not
    // wanted any more. Empty: no report.
    std::function<Result<void>(const LearnedParts&)> report = {};
    std::function<void(const Error&)> trouble = {};  // loop's thread: a report could not be written
};

class LineTeachIn final : public TeachIn {
  public:
    LineTeachIn(hal::EventLoop& loop, TeachInOptions options);
    ~LineTeachIn() override;  // cancels and waits; on_inspection() must not be called any more
    LineTeachIn(const LineTeachIn&) = delete;
    LineTeachIn& operator=(const LineTeachIn&) = delete;

    Result<void> begin(std::uint32_t parts, const NumberedRecipe& recipe, Listener listener) override;
    void cancel() override;
    void discard(const NumberedRecipe& learned) override;
    void in_use(const NumberedRecipe& recipe) override;

    // Any thread, several at the same time. Copies the frame.
    void on_inspection(std::uint32_t part, const FrameView& frame, const algo::Inspection& inspection);

    // The file that a teach-in leaves until its recipe is in use.
    [[nodiscard]] static std::filesystem::path pending_file(const std::filesystem::path& folder);
    // A recipe that was learned before the process ended and was not in use yet, to be used instead of `recipe`. Fails
    // as remembered_recipe().
    [[nodiscard]] static Result<std::optional<RememberedRecipe>> pending_recipe(const std::filesystem::path& folder,
                                                                                const NumberedRecipe& recipe);

  private:
    enum class Slot : std::uint32_t { closed, empty, filling, full };
    // One teach-in. `recipe` and `parts` never change.
    struct Session {
        std::uint32_t parts = 0;
        NumberedRecipe recipe;
        Listener listener;                   // loop's thread
        std::vector<std::uint32_t> numbers;  // of the parts whose frames are on the disk
    };
    void work();
    [[nodiscard]] Result<TeachResult> run();
    [[nodiscard]] Result<void> prepare();
    [[nodiscard]] Result<void> spool();
    void report_progress(std::size_t taken);
    [[nodiscard]] Result<TeachResult> learn();
    [[nodiscard]] Result<std::string> inspect_again(const algo::Recipe& recipe, const std::vector<bool>& left_out);
    [[nodiscard]] Result<Frame> read_spooled(std::size_t k) const;
    [[nodiscard]] std::filesystem::path spool_file(std::size_t k) const;
    [[nodiscard]] Result<void> check_folder() const;
    void remove_quietly(const std::filesystem::path& path) const;
    void post(std::function<void()> call);  // to the loop, unless this is destroyed before
    void step();
    void finish(Result<TeachResult> outcome);
    void write_report(const LearnedParts& parts);
    void finished(Result<TeachResult>& outcome);

    hal::EventLoop& loop_;
    const TeachInOptions options_;
    std::shared_ptr<char> life_ = std::make_shared<char>();
    const std::weak_ptr<char> alive_ = life_;

    // Owned by the loop's thread, used by the background thread between begin() and the outcome's post.
    std::optional<Session> session_;
    std::thread thread_;
    std::optional<LearnedParts> to_report_;  // background thread alone

    // State of `frame_`: an inspecting thread that changes it from empty to filling may write; the background thread
    // waits for full.
    std::atomic<Slot> slot_{Slot::closed};
    std::atomic<bool> cancelled_{false};
    std::atomic<bool> ended_{false};           // finish() was called
    std::atomic<bool> report_stopped_{false};  // until the next session is prepared
    Frame frame_;
    std::uint32_t frame_part_ = 0;
};

}  // namespace hord::firmware
