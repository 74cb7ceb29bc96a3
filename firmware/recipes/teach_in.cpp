#include "firmware/recipes/teach_in.h"

#include <algorithm>
#include <cerrno>
#include <cstring>
#include <fstream>
#include <system_error>
#include <utility>

#include <fcntl.h>
#include <fmt/format.h>
#include <sched.h>
#include <sys/resource.h>
#include <unistd.h>

#include "algo/good_parts/distinct_parts.h"
#include "algo/reference/read_noise.h"
#include "algo/reference/reference_learner.h"
#include "common/file_writing.h"
#include "common/unique_fd.h"
#include "firmware/recipes/reference_file.h"
#include "firmware/recipes/taught_files.h"

namespace hord::firmware {
namespace {

namespace fs = std::filesystem;

constexpr const char* kSpool = "teach";
constexpr const char* kReferences = "references";
constexpr const char* kWaiting = "recipe-taught.toml";
constexpr const char* kCheckDisk = "check the state folder's owner and the space on its disk, then teach again";

constexpr int kNice = 10;

Error cancelled_error() { return {ErrorCode::refused, "the teach was cancelled", "teach again"}; }

bool shows_a_part(algo::Reason reason) {
    using enum algo::Reason;
    return reason != too_dark && reason != saturated && reason != nothing_to_see && reason != no_part &&
        reason != unexpected_light && reason != unexpected_geometry;
}

}  // namespace

Result<void> LineTeachIn::check_folder() const {
    return options_.check_folder ? options_.check_folder() : Result<void>();
}

void LineTeachIn::remove_quietly(const fs::path& path) const {
    std::error_code ignored;
    if (check_folder()) fs::remove_all(path, ignored);
}

LineTeachIn::LineTeachIn(hal::EventLoop& loop, TeachInOptions options) : loop_(loop), options_(std::move(options)) {
    remove_quietly(options_.folder / kSpool);
}

LineTeachIn::~LineTeachIn() {
    life_.reset();
    report_stopped_ = true;
    cancel();
    if (thread_.joinable()) thread_.join();
    remove_quietly(options_.folder / kSpool);
}

// -- the loop's thread

Result<void> LineTeachIn::begin(std::uint32_t parts, const NumberedRecipe& recipe, Listener listener) {
    if (session_) return fail(ErrorCode::busy, "a teach is under way", "wait for its end");
    if (recipe.recipe.gradient && *recipe.recipe.gradient != algo::Feature::emd) {
        return fail(ErrorCode::refused,
                    fmt::format("recipe {} compares neighbours by {}, of which a reference knows nothing",
                                recipe.number, name_of(*recipe.recipe.gradient)),
                    "use emd among the recipe's features, or no distance, then teach");
    }
    report_stopped_ = true;  // of the session before; its thread ends soon
    cancelled_ = ended_ = false;
    session_ = Session{parts, recipe, std::move(listener), {}};
    if (!options_.thread) {
        if (auto ready = prepare(); !ready) finish(tl::unexpected(ready.error()));
        return {};
    }
    auto before = std::make_shared<std::thread>(std::move(thread_));
    try {
        thread_ = std::thread([this, before] {
            if (before->joinable()) before->join();
            work();
        });
    } catch (const std::system_error& error) {
        thread_ = std::move(*before);
        session_.reset();
        return fail(ErrorCode::busy, fmt::format("the system gives no thread to teach with: {}", error.what()),
                    "see what else runs on this machine");
    }
    return {};
}

void LineTeachIn::cancel() {
    if (!session_ || cancelled_) return;
    session_->listener = {};
    cancelled_ = true;
    // A thread that is filling the slot finishes; then the background thread sees the cancellation.
    Slot expected = Slot::empty;
    slot_.compare_exchange_strong(expected, Slot::closed);
    slot_.notify_all();
    if (!options_.thread && !ended_) finish(tl::unexpected(cancelled_error()));
}

void LineTeachIn::discard(const NumberedRecipe& learned) {
    report_stopped_ = true;  // before the removal: write_report() looks at it after its writing
    remove_quietly(options_.folder / kWaiting);
    remove_quietly(learned.reference_file);
    if (check_folder()) remove_taught_report(learned.reference_file);
}

void LineTeachIn::in_use(const NumberedRecipe& recipe) {
    remove_quietly(options_.folder / kWaiting);
    if (recipe.reference_file.parent_path() != options_.folder / kReferences) return;  // not a learned one
    if (!check_folder()) return;
    remove_other_taught(recipe.reference_file, recipe.number);
}

Result<std::optional<RememberedRecipe>> LineTeachIn::pending_recipe(const fs::path& folder,
                                                                    const NumberedRecipe& recipe) {
    auto learned = remembered_recipe(pending_file(folder), recipe);
    if (learned && *learned && !(*learned)->recipe) return std::nullopt;
    return learned;
}

fs::path LineTeachIn::pending_file(const fs::path& folder) { return folder / kWaiting; }

// The background thread's last call but for the report.
void LineTeachIn::finish(Result<TeachResult> outcome) {
    const auto parts = std::exchange(to_report_, std::nullopt);
    ended_ = true;
    if (!parts) remove_quietly(options_.folder / kSpool);
    auto shared = std::make_shared<Result<TeachResult>>(std::move(outcome));
    post([this, shared] { finished(*shared); });
    if (parts) write_report(*parts);
}

// The outcome is told: nothing of the session is used here but its frames on the disk.
void LineTeachIn::write_report(const LearnedParts& parts) {
    const auto stopped = [&] { return report_stopped_ || cancelled_; };
    const auto written = check_folder().and_then([&] { return options_.report(parts); });
    if ((!written || stopped()) && check_folder()) remove_taught_report(parts.file);
    if (!written && !stopped()) {
        post([this, error = written.error(), file = parts.file.string()] {
            if (!options_.trouble) return;
            options_.trouble(
                {error.code,
                 fmt::format("the reference {} is learned, its report is not written: {}", file, error.what),
                 error.cure});
        });
    }
    remove_quietly(options_.folder / kSpool);
}

void LineTeachIn::post(std::function<void()> call) {
    loop_.post([call = std::move(call), alive = alive_] {
        if (!alive.expired()) call();
    });
}

void LineTeachIn::finished(Result<TeachResult>& outcome) {
    const auto session = std::exchange(session_, std::nullopt);
    frame_ = {};
    if (cancelled_) {
        if (outcome) discard(outcome->recipe);
        return;
    }
    if (session->listener.done) session->listener.done(std::move(outcome));
}

// -- an inspecting thread

void LineTeachIn::on_inspection(std::uint32_t part, const FrameView& frame, const algo::Inspection& inspection) {
    if (slot_.load(std::memory_order_relaxed) != Slot::empty) return;
    if (part == options_.ignored_part || !shows_a_part(inspection.reason)) return;
    if (frame.width_px != options_.extents.width_px() || frame.height_px != options_.extents.height_px() ||
        frame.bits != options_.bits)
        return;
    Slot expected = Slot::empty;
    if (!slot_.compare_exchange_strong(expected, Slot::filling)) return;
    const auto row_bytes = static_cast<std::size_t>(frame.width_px) * static_cast<std::size_t>(frame.sample_bytes());
    std::byte* to = frame_.bytes().data();
    for (int y = 0; y < frame.height_px; ++y, to += row_bytes)
        std::memcpy(to, frame.data + y * frame.stride_bytes, row_bytes);
    frame_part_ = part;
    slot_.store(Slot::full);
    if (options_.thread) slot_.notify_all();
    else post([this] { step(); });
}

// -- the background thread

void LineTeachIn::work() {
    // The policy of the starting thread, perhaps real-time, was inherited. Nice 10 has a tenth of the share of an
    // inspecting thread: enough to end on a busy machine.
    const sched_param ordinary{};
    ::sched_setscheduler(0, SCHED_OTHER, &ordinary);
    ::setpriority(PRIO_PROCESS, static_cast<id_t>(::gettid()), kNice);
    finish(run());
}

Result<TeachResult> LineTeachIn::run() {
    if (auto ready = prepare(); !ready) return tl::unexpected(ready.error());
    while (session_->numbers.size() < session_->parts) {
        Slot now = slot_.load();
        for (; now == Slot::empty || now == Slot::filling; now = slot_.load()) slot_.wait(now);
        if (cancelled_) return tl::unexpected(cancelled_error());
        if (auto done = spool(); !done) return tl::unexpected(done.error());
    }
    return learn();
}

// Without a thread: run() in steps, on the loop's thread.
void LineTeachIn::step() {
    if (!session_ || ended_ || slot_ != Slot::full) return;
    if (auto done = spool(); !done) return finish(tl::unexpected(done.error()));
    if (session_->numbers.size() == session_->parts) finish(learn());
}

Result<void> LineTeachIn::prepare() {
    report_stopped_ = false;
    to_report_.reset();
    if (auto here = check_folder(); !here) return here;
    frame_ = Frame(options_.extents.width_px(), options_.extents.height_px(),
                   options_.bits);  // zeroed, so its pages are allocated
    std::error_code error;
    for (const char* folder : {kSpool, kReferences}) {
        fs::create_directory(options_.folder / folder, error);
        if (error)
            return fail(ErrorCode::io,
                        fmt::format("{} cannot be made: {}", (options_.folder / folder).string(), error.message()),
                        kCheckDisk);
    }
    const std::uint64_t wanted = session_->parts * std::uint64_t{frame_.bytes().size()} +
        bytes_of_maps(options_.extents) + options_.leave_free_bytes;
    const auto space = fs::space(options_.folder, error);
    if (!error && space.available < wanted) {
        return fail(
            ErrorCode::io,
            fmt::format("{} has {} MB free, a teach of {} parts needs {} MB with what stays free",
                        options_.folder.string(), space.available / 1'000'000, session_->parts, wanted / 1'000'000 + 1),
            "make room on the disk, or teach fewer parts");
    }
    session_->numbers.reserve(session_->parts);
    slot_ = Slot::empty;
    report_progress(0);
    // Cancelled before the slot was empty: cancel() has not closed it.
    Slot expected = Slot::empty;
    if (cancelled_ && slot_.compare_exchange_strong(expected, Slot::closed)) return tl::unexpected(cancelled_error());
    return {};
}

fs::path LineTeachIn::spool_file(std::size_t k) const {
    return options_.folder / kSpool / fmt::format("part-{:02}.raw", k + 1);
}

// Writes the slot's frame to the disk. Then the slot is empty again, or closed after the last frame.
Result<void> LineTeachIn::spool() {
    const fs::path file = spool_file(session_->numbers.size());
    if (auto here = check_folder(); !here) {
        slot_ = Slot::closed;
        return here;
    }
    const auto refuse = [&](int why) {
        slot_ = Slot::closed;
        return fail(ErrorCode::io, fmt::format("{} cannot be written: {}", file.string(), std::strerror(why)),
                    kCheckDisk);
    };
    common::UniqueFd fd(::open(file.c_str(), O_WRONLY | O_CREAT | O_TRUNC | O_CLOEXEC | O_NOFOLLOW, 0600));
    if (!fd) return refuse(errno);
    int why = common::write_all(fd.get(), std::as_const(frame_).bytes());
    // Synced to keep at most one frame in the page cache: more would delay the writing of results.
    if (why == 0 && ::fdatasync(fd.get()) != 0) why = errno;
    if (why == 0) why = fd.close();
    if (why != 0) return refuse(why);
    session_->numbers.push_back(frame_part_);
    const auto count = static_cast<std::uint32_t>(session_->numbers.size());
    slot_ = count < session_->parts ? Slot::empty : Slot::closed;
    Slot expected = Slot::empty;
    if (cancelled_) slot_.compare_exchange_strong(expected, Slot::closed);
    report_progress(count);
    return {};
}

void LineTeachIn::report_progress(std::size_t taken) {
    post([this, taken] {
        if (session_ && session_->listener.taken) session_->listener.taken(static_cast<std::uint32_t>(taken));
    });
}

Result<Frame> LineTeachIn::read_spooled(std::size_t k) const {
    if (cancelled_ || report_stopped_) return tl::unexpected(cancelled_error());
    Frame frame(options_.extents.width_px(), options_.extents.height_px(), options_.bits);
    std::ifstream in(spool_file(k), std::ios::binary);
    const auto bytes = frame.bytes();
    in.read(reinterpret_cast<char*>(bytes.data()), static_cast<std::streamsize>(bytes.size()));
    if (!in) return fail(ErrorCode::io, spool_file(k).string() + " cannot be read back", kCheckDisk);
    return frame;
}

Result<TeachResult> LineTeachIn::learn() {
    const std::uint32_t before = crc32_of(session_->recipe);
    TeachResult result{session_->recipe, {}};
    result.recipe.recipe.reference.reset();  // its dark level must not bound that of the new one
    algo::LearnOptions options;
    options.levels = algo::light_levels(result.recipe.recipe, options_.bits);
    options.max_dark_rise_dn = result.recipe.recipe.max_dark_rise_dn;
    options.dark_from_noise = result.recipe.recipe.dark_dn == 0;
    const auto frame_of = [this](std::size_t k) { return read_spooled(k); };
    // As `hordctl learn` does; if every bin has light, a fifth of the dark level (algo/recipe/recipe.h).
    const auto read = algo::read_noise_of(options_.extents, options.levels, session_->parts, frame_of);
    options.read_dn = read.value_or(static_cast<float>(options.levels.dark) / 5);
    const auto refused = [&](const Error& e) -> Result<TeachResult> {
        return fail(e.code, fmt::format("no reference can be learned from these {} parts: {}", session_->parts, e.what),
                    e.cure + ", and teach again");
    };
    const auto parts = algo::parts_to_learn(options_.extents, session_->parts, frame_of, options);
    if (cancelled_) return tl::unexpected(cancelled_error());
    if (!parts) return refused(parts.error());
    options.name_of = [numbers = session_->numbers, frames = parts->frames](std::size_t part) {
        return fmt::format("part {}", numbers[frames[part]]);
    };
    auto learned = algo::learn_reference(
        options_.extents, options_.bits, parts->frames.size(),
        [&](std::size_t k) { return frame_of(parts->frames[k]); }, options);
    if (cancelled_) return tl::unexpected(cancelled_error());
    if (!learned) return refused(learned.error());
    const auto remark = [&](const std::string& sentence) {
        if (!sentence.empty()) result.remarks += (result.remarks.empty() ? "" : "; ") + sentence;
    };
    std::vector<bool> left_out(session_->parts, false);
    for (const algo::LeftOut& out : learned->left_out) {
        const std::size_t frame = parts->frames[out.part];
        left_out[frame] = true;
        remark(fmt::format("part {} was left out: {}", session_->numbers[frame], out.why));
    }
    remark(parts->repeated);
    const auto unsure = algo::unsure_of(*learned, "learn with hordctl learn --electrons-per-dn",
                                        static_cast<double>(result.recipe.recipe.reject_score));
    result.recipe.recipe.reference = std::make_shared<const algo::Reference>(std::move(learned->reference));
    auto judged = inspect_again(result.recipe.recipe, left_out);
    if (!judged) return tl::unexpected(judged.error());
    remark(*judged);
    for (const std::string& sentence : unsure) remark(sentence);

    result.recipe.reference_file = next_taught_reference(options_.folder / kReferences, result.recipe.number);
    auto written = check_folder().and_then(
        [&] { return write_reference(result.recipe.reference_file, *result.recipe.recipe.reference); });
    (void)crc32_of(result.recipe);  // cached here, so that the loop's thread need not compute it
    if (written) written = remember_recipe(options_.folder / kWaiting, before, result.recipe);
    if (!written || cancelled_) {
        discard(result.recipe);
        return tl::unexpected(written ? cancelled_error() : written.error());
    }
    if (!options_.report) return result;
    LearnedParts& report = to_report_.emplace();
    report.file = result.recipe.reference_file;
    report.reference = result.recipe.recipe.reference;
    report.recipe = result.recipe.recipe;
    for (const std::size_t frame : parts->frames)
        report.frames.push_back(fmt::format("part {}", session_->numbers[frame]));
    report.left_out = std::move(learned->left_out);
    report.poses = std::move(learned->poses);
    report.frame_of = [this, frames = parts->frames](std::size_t k) { return read_spooled(frames[k]); };
    report.repeated = parts->repeated;
    report.unsure = unsure;
    report.learning = options;
    report.electrons_from = "estimated";
    report.read_noise_from = read ? "estimated" : "assumed";
    return result;
}

// Inspects the learned parts with the new recipe. Returns which of them it would reject; fails if it would reject most.
Result<std::string> LineTeachIn::inspect_again(const algo::Recipe& recipe, const std::vector<bool>& left_out) {
    auto pipeline = algo::Pipeline::create(options_.extents, options_.bits, recipe);
    if (!pipeline) return tl::unexpected(pipeline.error());
    std::string rejected;
    std::size_t judged = 0, passed = 0;
    for (std::size_t k = 0; k < left_out.size(); ++k) {
        if (left_out[k]) continue;
        const auto frame = read_spooled(k);
        if (!frame) return tl::unexpected(frame.error());
        const auto inspection = pipeline->inspect(frame->view());
        if (!inspection) return tl::unexpected(inspection.error());
        ++judged;
        if (inspection->verdict == algo::Verdict::pass) ++passed;
        else
            rejected += fmt::format("{}part {} would be rejected: {}", rejected.empty() ? "" : "; ",
                                    session_->numbers[k], algo::name_of(inspection->reason));
    }
    if (2 * passed >= judged) return rejected;
    return fail(
        ErrorCode::invalid_argument,
        fmt::format("the recipe with this reference would pass only {} of the {} parts it was learned from: {}", passed,
                    judged, rejected),
        "see that the parts are good and lie alike, and that the recipe's own limits allow them; then teach again");
}

}  // namespace hord::firmware
