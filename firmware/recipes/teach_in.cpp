#include "firmware/recipes/teach_in.h"

#include <algorithm>
#include <cerrno>
#include <charconv>
#include <cstring>
#include <fstream>
#include <span>
#include <system_error>
#include <utility>

#include <fcntl.h>
#include <fmt/format.h>
#include <sched.h>
#include <sys/resource.h>
#include <unistd.h>

#include "algo/reference/read_noise.h"
#include "algo/reference/reference_learner.h"
#include "firmware/recipes/recipe_folder.h"
#include "firmware/recipes/reference_file.h"

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
    return reason != algo::Reason::too_dark && reason != algo::Reason::saturated &&
        reason != algo::Reason::nothing_to_see;
}

void remove_quietly(const fs::path& path) {
    std::error_code ignored;
    fs::remove_all(path, ignored);
}

std::string learned_prefix(std::uint16_t number) { return fmt::format("taught-{}-", number); }

// n of "taught-7-n.hordref"; none: another file.
std::optional<std::uint64_t> nth_of(const fs::path& file, const std::string& prefix) {
    const std::string stem = file.stem().string();
    if (file.extension() != ".hordref" || !stem.starts_with(prefix)) return std::nullopt;
    std::uint64_t n = 0;
    const char* end = stem.data() + stem.size();
    const auto read = std::from_chars(stem.data() + prefix.size(), end, n);
    return read.ec == std::errc() && read.ptr == end ? std::optional(n) : std::nullopt;
}

template <class Do>
void for_each_reference(const fs::path& folder, std::uint16_t number, Do&& what) {
    std::error_code error;
    for (auto entry = fs::directory_iterator(folder / kReferences, error); !error && entry != fs::directory_iterator();
         entry.increment(error)) {
        if (const auto n = nth_of(entry->path(), learned_prefix(number))) what(entry->path(), *n);
    }
}

// About; what the file takes in algo/reference/reference.h's types.
std::uint64_t reference_bytes(const algo::Extents& e) {
    algo::Reference r;
    r.extents = e;
    return e.lenslets() * (r.stride() * sizeof(std::uint16_t) + 9 * sizeof(float) + 1);
}

}  // namespace

// One teach. `recipe` and `parts` never change.
struct LineTeachIn::TeachSession {
    std::uint32_t parts = 0;
    NumberedRecipe recipe;
    Listener listener;                   // the loop's thread
    std::vector<std::uint32_t> numbers;  // of the parts whose frames are there
};

LineTeachIn::LineTeachIn(hal::EventLoop& loop, TeachInOptions options) : loop_(loop), options_(std::move(options)) {
    remove_quietly(options_.folder / kSpool);
}

LineTeachIn::~LineTeachIn() {
    life_.reset();
    do_cancel();
    if (thread_.joinable()) thread_.join();
    remove_quietly(options_.folder / kSpool);
}

// -- the loop's thread

Result<void> LineTeachIn::do_begin(std::uint32_t parts, const NumberedRecipe& recipe, Listener listener) {
    if (lesson_ != nullptr) return fail(ErrorCode::busy, "a teach is under way", "wait for its end");
    if (recipe.recipe.gradient && *recipe.recipe.gradient != algo::Feature::emd) {
        return fail(ErrorCode::refused,
                    fmt::format("recipe {} compares neighbours by {}, of which a reference knows nothing",
                                recipe.number, name_of(*recipe.recipe.gradient)),
                    "use emd among the recipe's features, or no distance, then teach");
    }
    if (thread_.joinable()) thread_.join();  // it has told its end long ago
    cancelled_ = ended_ = false;
    lesson_ = std::make_unique<TeachSession>(TeachSession{parts, recipe, std::move(listener), {}});
    if (!options_.thread) {
        if (auto ready = prepare(); !ready) finish(tl::unexpected(ready.error()));
        return {};
    }
    try {
        thread_ = std::thread([this] { work(); });
    } catch (const std::system_error& error) {
        lesson_.reset();
        return fail(ErrorCode::busy, fmt::format("the system gives no thread to teach with: {}", error.what()),
                    "see what else runs on this machine");
    }
    return {};
}

void LineTeachIn::do_cancel() {
    if (lesson_ == nullptr || cancelled_) return;
    lesson_->listener = {};
    cancelled_ = true;
    // Who is filling the slot finishes; then the teacher's thread sees that it was cancelled.
    Slot expected = Slot::empty;
    slot_.compare_exchange_strong(expected, Slot::closed);
    slot_.notify_all();
    if (!options_.thread && !ended_) finish(tl::unexpected(cancelled_error()));
}

void LineTeachIn::do_discard(const NumberedRecipe& taught) {
    remove_quietly(options_.folder / kWaiting);
    remove_quietly(taught.reference_file);
}

void LineTeachIn::do_in_use(const NumberedRecipe& recipe) {
    remove_quietly(options_.folder / kWaiting);
    if (recipe.reference_file.parent_path() != options_.folder / kReferences) return;  // it was not taught
    std::vector<fs::path> old;
    for_each_reference(options_.folder, recipe.number, [&](const fs::path& file, std::uint64_t) {
        if (file != recipe.reference_file) old.push_back(file);
    });
    for (const fs::path& file : old) remove_quietly(file);
}

Result<std::optional<NumberedRecipe>> LineTeachIn::left_waiting(const fs::path& folder, const NumberedRecipe& recipe) {
    return remembered_recipe(folder / kWaiting, crc32_of(recipe));
}

// The last that the teacher's thread does.
void LineTeachIn::finish(Result<Taught> outcome) {
    ended_ = true;
    remove_quietly(options_.folder / kSpool);
    auto shared = std::make_shared<Result<Taught>>(std::move(outcome));
    loop_.post([this, shared, alive = alive_] {
        if (!alive.expired()) finished(*shared);
    });
}

void LineTeachIn::finished(Result<Taught>& outcome) {
    const auto lesson = std::move(lesson_);
    frame_ = {};
    if (cancelled_) {
        if (outcome) do_discard(outcome->recipe);
        return;
    }
    if (lesson->listener.done) lesson->listener.done(std::move(outcome));
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
    if (options_.thread) {
        slot_.notify_all();
    } else {
        loop_.post([this, alive = alive_] {
            if (!alive.expired()) step();
        });
    }
}

// -- the teacher's thread

void LineTeachIn::work() {
    // Whoever began it may be under a real-time policy, which is inherited. Nice 10 has a tenth of the share of a
    // thread that inspects: enough to come to an end on a busy machine.
    const sched_param ordinary{};
    ::sched_setscheduler(0, SCHED_OTHER, &ordinary);
    ::setpriority(PRIO_PROCESS, static_cast<id_t>(::gettid()), kNice);
    finish(teach());
}

Result<Taught> LineTeachIn::teach() {
    if (auto ready = prepare(); !ready) return tl::unexpected(ready.error());
    while (lesson_->numbers.size() < lesson_->parts) {
        Slot now = slot_.load();
        for (; now == Slot::empty || now == Slot::filling; now = slot_.load()) slot_.wait(now);
        if (cancelled_) return tl::unexpected(cancelled_error());
        if (auto done = spool(); !done) return tl::unexpected(done.error());
    }
    return learn();
}

// In place of teach(), on the loop's thread.
void LineTeachIn::step() {
    if (lesson_ == nullptr || ended_ || slot_ != Slot::full) return;
    if (auto done = spool(); !done) return finish(tl::unexpected(done.error()));
    if (lesson_->numbers.size() == lesson_->parts) finish(learn());
}

Result<void> LineTeachIn::prepare() {
    frame_ = Frame(options_.extents.width_px(), options_.extents.height_px(),
                   options_.bits);  // zeroed: its pages are there
    std::error_code error;
    for (const char* folder : {kSpool, kReferences}) {
        fs::create_directory(options_.folder / folder, error);
        if (error)
            return fail(ErrorCode::io,
                        fmt::format("{} cannot be made: {}", (options_.folder / folder).string(), error.message()),
                        kCheckDisk);
    }
    const std::uint64_t wanted = lesson_->parts * std::uint64_t{frame_.bytes().size()} +
        reference_bytes(options_.extents) + options_.leave_free_bytes;
    const auto space = fs::space(options_.folder, error);
    if (!error && space.available < wanted) {
        return fail(
            ErrorCode::io,
            fmt::format("{} has {} MB free, a teach of {} parts needs {} MB with what stays free",
                        options_.folder.string(), space.available / 1'000'000, lesson_->parts, wanted / 1'000'000 + 1),
            "make room on the disk, or teach fewer parts");
    }
    lesson_->numbers.reserve(lesson_->parts);
    slot_ = Slot::empty;
    tell(0);
    // Cancelled before it was empty: who cancelled has not closed it.
    Slot expected = Slot::empty;
    if (cancelled_ && slot_.compare_exchange_strong(expected, Slot::closed)) return tl::unexpected(cancelled_error());
    return {};
}

fs::path LineTeachIn::spool_file(std::size_t k) const {
    return options_.folder / kSpool / fmt::format("part-{:02}.raw", k + 1);
}

// The frame in the slot goes to the disk; the slot is open again, or closed after the last one.
Result<void> LineTeachIn::spool() {
    const fs::path file = spool_file(lesson_->numbers.size());
    const auto refuse = [&] {
        const int why = errno;
        slot_ = Slot::closed;
        return fail(ErrorCode::io, fmt::format("{} cannot be written: {}", file.string(), std::strerror(why)),
                    kCheckDisk);
    };
    const int fd = ::open(file.c_str(), O_WRONLY | O_CREAT | O_TRUNC | O_CLOEXEC | O_NOFOLLOW, 0600);
    if (fd < 0) return refuse();
    std::span<const std::byte> rest = std::as_const(frame_).bytes();
    bool written = true;
    while (written && !rest.empty()) {
        const ssize_t count = ::write(fd, rest.data(), rest.size());
        if (count > 0) rest = rest.subspan(static_cast<std::size_t>(count));
        else written = count < 0 && errno == EINTR;
    }
    // Not for its safety: so that no more than one frame waits in the system's memory, in the way of the results.
    written = written && ::fdatasync(fd) == 0;
    const int why = errno;
    const bool closed = ::close(fd) == 0;
    if (!written) errno = why;
    if (!written || !closed) return refuse();
    lesson_->numbers.push_back(frame_part_);
    const auto count = static_cast<std::uint32_t>(lesson_->numbers.size());
    slot_ = count < lesson_->parts ? Slot::empty : Slot::closed;
    Slot expected = Slot::empty;
    if (cancelled_) slot_.compare_exchange_strong(expected, Slot::closed);
    tell(count);
    return {};
}

void LineTeachIn::tell(std::size_t taken) {
    loop_.post([this, taken, alive = alive_] {
        if (!alive.expired() && lesson_ != nullptr && lesson_->listener.taken)
            lesson_->listener.taken(static_cast<std::uint32_t>(taken));
    });
}

Result<Frame> LineTeachIn::spooled(std::size_t k) const {
    if (cancelled_) return tl::unexpected(cancelled_error());
    Frame frame(options_.extents.width_px(), options_.extents.height_px(), options_.bits);
    std::ifstream in(spool_file(k), std::ios::binary);
    const auto bytes = frame.bytes();
    in.read(reinterpret_cast<char*>(bytes.data()), static_cast<std::streamsize>(bytes.size()));
    if (!in) return fail(ErrorCode::io, spool_file(k).string() + " cannot be read back", kCheckDisk);
    return frame;
}

fs::path LineTeachIn::next_reference(std::uint16_t number) const {
    std::uint64_t highest = 0;
    for_each_reference(options_.folder, number,
                       [&](const fs::path&, std::uint64_t n) { highest = std::max(highest, n); });
    return options_.folder / kReferences / fmt::format("{}{}.hordref", learned_prefix(number), highest + 1);
}

Result<Taught> LineTeachIn::learn() {
    const std::uint32_t before = crc32_of(lesson_->recipe);
    Taught taught{lesson_->recipe, {}};
    algo::LearnOptions options;
    options.levels = algo::light_levels(taught.recipe.recipe, options_.bits);
    const auto frame_of = [this](std::size_t k) { return spooled(k); };
    // As hordctl learn does; where no bin is without light, the default dark level's fifth (algo/recipe/recipe.h).
    const auto read = algo::read_noise_of(options_.extents, options.levels, lesson_->parts, frame_of);
    options.read_dn = read.value_or(static_cast<float>(options.levels.dark) / 5);
    auto learned = algo::learn_reference(options_.extents, options_.bits, lesson_->parts, frame_of, options);
    if (cancelled_) return tl::unexpected(cancelled_error());
    if (!learned) {
        const Error& e = learned.error();
        return fail(e.code, fmt::format("no reference can be learned from these {} parts: {}", lesson_->parts, e.what),
                    e.cure + ", and teach again");
    }
    std::vector<bool> left_out(lesson_->parts, false);
    for (const algo::LeftOut& out : learned->left_out) {
        left_out[out.part] = true;
        taught.remarks += fmt::format("{}part {} was left out: {}", taught.remarks.empty() ? "" : "; ",
                                      lesson_->numbers[out.part], out.why);
    }
    taught.recipe.recipe.reference = std::make_shared<const algo::Reference>(std::move(learned->reference));
    auto judged = judge_them_again(taught.recipe.recipe, left_out);
    if (!judged) return tl::unexpected(judged.error());
    if (!judged->empty()) taught.remarks += (taught.remarks.empty() ? "" : "; ") + *judged;

    taught.recipe.reference_file = next_reference(taught.recipe.number);
    auto written = write_reference(taught.recipe.reference_file, *taught.recipe.recipe.reference);
    (void)crc32_of(taught.recipe);  // made here, so that the loop's thread need not
    if (written) written = remember_recipe(options_.folder / kWaiting, before, taught.recipe);
    if (!written || cancelled_) {
        do_discard(taught.recipe);
        return tl::unexpected(written ? cancelled_error() : written.error());
    }
    return taught;
}

// A recipe that would not pass what it was learned from is of no use. Says which parts it would not pass; fails when
// they are most.
Result<std::string> LineTeachIn::judge_them_again(const algo::Recipe& recipe, const std::vector<bool>& left_out) {
    auto pipeline = algo::Pipeline::create(options_.extents, options_.bits, recipe);
    if (!pipeline) return tl::unexpected(pipeline.error());
    std::string said;
    std::size_t judged = 0, passed = 0;
    for (std::size_t k = 0; k < left_out.size(); ++k) {
        if (left_out[k]) continue;
        const auto frame = spooled(k);
        if (!frame) return tl::unexpected(frame.error());
        const auto inspection = pipeline->inspect(frame->view());
        if (!inspection) return tl::unexpected(inspection.error());
        ++judged;
        if (inspection->verdict == algo::Verdict::pass) ++passed;
        else
            said += fmt::format("{}part {} would be rejected: {}", said.empty() ? "" : "; ", lesson_->numbers[k],
                                algo::name_of(inspection->reason));
    }
    if (2 * passed >= judged) return said;
    return fail(
        ErrorCode::invalid_argument,
        fmt::format("the recipe with this reference would pass only {} of the {} parts it was learned from: {}", passed,
                    judged, said),
        "see that the parts are good and lie alike, and that the recipe's own limits allow them; then teach again");
}

}  // namespace hord::firmware
