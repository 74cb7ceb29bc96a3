#include "firmware/store/frames/frame_retention.h"

#include <algorithm>
#include <cstring>
#include <ctime>
#include <utility>

#include <fmt/chrono.h>
#include <fmt/format.h>

#include "firmware/store/frames/frame_metadata.h"
#include "firmware/store/frames/frame_png.h"
#include "firmware/store/results/hash_chain.h"
#include "firmware/store/results/no_exceptions.h"
#include "firmware/store/results/records.h"

namespace hord::firmware::store {
namespace {

constexpr std::size_t kMissedKept = 64;

std::string file_time(UtcMicros time_us) {
    const auto seconds = static_cast<std::time_t>(time_us / 1'000'000);
    std::tm utc{};
    gmtime_r(&seconds, &utc);
    return fmt::format("{:%Y%m%dT%H%M%SZ}", utc);
}

}  // namespace

// A frame and its inspection. Allocates at its first use and keeps the memory.
struct FrameRetention::Buffer {
    std::uint32_t part = 0, trigger = 0;
    const char* role = "";
    UtcMicros time_us = 0;
    Frame samples;
    std::vector<std::uint8_t> maps;
    std::vector<algo::Defect> defects;
    algo::Verdict verdict = algo::Verdict::unfit;
    algo::Reason reason = algo::Reason::none;
    float score = 0;
    std::uint32_t dark_dn = 0;
    bool maps_of_bounds = false, bounded = false, out_of_time = false;
    std::shared_ptr<const std::string> recipe;

    void fill(std::uint32_t number, const FrameView& frame, const algo::Inspection& inspection) {
        part = number;
        const FrameView kept = samples.view();
        if (kept.width_px != frame.width_px || kept.height_px != frame.height_px || kept.bits != frame.bits)
            samples = Frame(frame.width_px, frame.height_px, frame.bits);
        const std::size_t row_bytes = samples.bytes().size() / static_cast<std::size_t>(frame.height_px);
        for (int y = 0; y < frame.height_px; ++y)
            std::memcpy(samples.bytes().subspan(static_cast<std::size_t>(y) * row_bytes).data(), frame.row8(y),
                        row_bytes);
        maps = bytes_of_maps(inspection);
        defects.assign(inspection.defects.begin(), inspection.defects.end());
        verdict = inspection.verdict;
        reason = inspection.reason;
        score = inspection.score;
        dark_dn = inspection.dark_dn;
        maps_of_bounds = inspection.has_bounds;
        bounded = inspection.bounded;
        out_of_time = inspection.out_of_time;
    }
};

FrameRetention::FrameRetention(Open open, FrameRetentionOptions options, std::function<UtcMicros()> utc_now,
                               Listener listener)
    : open_(std::move(open)), options_(std::move(options)), utc_now_(std::move(utc_now)),
      listener_(std::move(listener)) {
    for (std::size_t k = 0; k < options_.buffers; ++k) free_.push_back(std::make_unique<Buffer>());
    if (options_.thread) thread_ = std::jthread([this](const std::stop_token& stop) { work(stop); });
}

FrameRetention::~FrameRetention() = default;

std::uint64_t FrameRetention::finish() {
    const std::uint64_t before = counts().dropped;
    if (thread_.joinable()) {
        thread_.request_stop();
        thread_.join();
    }
    const Counts at_end = counts();
    return at_end.failing ? at_end.dropped : at_end.dropped - before;
}

void FrameRetention::set_recipe(const std::string& text) {
    auto shared = std::make_shared<const std::string>(text);
    const std::lock_guard lock(mutex_);
    recipe_ = std::move(shared);
}

FrameRetention::Counts FrameRetention::counts() const {
    const std::lock_guard lock(mutex_);
    return counts_;
}

// -- choosing

void FrameRetention::on_inspection(std::uint32_t part, const FrameView& frame, const algo::Inspection& inspection) {
    Handle buffer;
    {
        std::unique_lock lock(mutex_);
        if (!free_.empty()) {
            buffer = std::move(free_.back());
            free_.pop_back();
        } else if (!recent_.empty()) {
            buffer = std::move(recent_.front());
            recent_.pop_front();
        } else {
            if (inspection.verdict != algo::Verdict::pass) {
                drop(
                    lock,
                    {ErrorCode::busy, "frames come faster than they can be kept",
                     "use a faster disk, or keep fewer (store.frames_before, store.frames_after, store.sample_every)"});
            }
            return;
        }
        buffer->recipe = recipe_;
    }
    buffer->fill(part, frame, inspection);
    buffer->time_us = utc_now_();

    const std::lock_guard lock(mutex_);
    const auto missed = std::find(missed_.begin(), missed_.end(), part);
    const bool came_too_late = missed != missed_.end();
    if (came_too_late) missed_.erase(missed);
    if (inspection.verdict != algo::Verdict::pass || came_too_late) {
        trigger(part, std::move(buffer));
    } else if (after_ > 0) {
        --after_;
        enqueue(std::move(buffer), "after", trigger_);
    } else if (options_.sample_every != 0 && part % options_.sample_every == 0) {
        enqueue(std::move(buffer), "sample", 0);
    } else {
        recent_.push_back(std::move(buffer));
    }
}

void FrameRetention::on_result(const PartResult& result) {
    // Frames of rejected inspections are kept already; a part without inspection has no frame.
    if (result.verdict == PartVerdict::pass || result.reason < PartReason::verdict_late) return;
    const std::lock_guard lock(mutex_);
    const auto found =
        std::find_if(recent_.begin(), recent_.end(), [&](const Handle& b) { return b->part == result.part; });
    if (found == recent_.end()) {
        if (result.reason != PartReason::verdict_late) return;
        missed_.push_back(result.part);
        if (missed_.size() > kMissedKept) missed_.pop_front();
        return;
    }
    // Frames of later parts stay.
    std::deque<Handle> later(std::make_move_iterator(found + 1), std::make_move_iterator(recent_.end()));
    Handle buffer = std::move(*found);
    recent_.erase(found, recent_.end());
    trigger(result.part, std::move(buffer));
    recent_ = std::move(later);
}

// With the lock. recent_ holds the frames before the rejected one.
void FrameRetention::trigger(std::uint32_t part, Handle buffer) {
    while (recent_.size() > static_cast<std::size_t>(options_.before)) {
        free_.push_back(std::move(recent_.front()));
        recent_.pop_front();
    }
    for (Handle& before : recent_) enqueue(std::move(before), "before", part);
    recent_.clear();
    after_ = options_.after;
    trigger_ = part;
    enqueue(std::move(buffer), "reject", part);
}

// With the lock.
void FrameRetention::enqueue(Handle buffer, const char* role, std::uint32_t trigger) {
    buffer->role = role;
    buffer->trigger = trigger;
    waiting_.push_back(std::move(buffer));
    wake_.notify_one();
}

// With the lock, which is released while the listener is called.
void FrameRetention::drop(std::unique_lock<std::mutex>& lock, const Error& error) {
    ++counts_.dropped;
    if (std::exchange(counts_.failing, true) || !listener_.failed) return;
    lock.unlock();
    listener_.failed(error);
    lock.lock();
}

// -- writing

void FrameRetention::work(const std::stop_token& stop) {
    std::unique_lock lock(mutex_);
    while (true) {
        const bool waits =
            wake_.wait_for(lock, stop, options_.look_every, [this] { return !waiting_.empty() || results_need_room_; });
        const bool ends = !waits && stop.stop_requested();
        lock.unlock();
        if (waits) (void)step();
        else look_at_disk();
        if (ends) return;
        lock.lock();
    }
}

// While no frame comes. A disk that took none is asked whether it takes one as large as the last: others may have freed
// it. An error of one that worked is reported with the next frame.
void FrameRetention::look_at_disk() {
    if (!counts().failing) {
        if (archive_ != nullptr) (void)without_exceptions([&] { return archive_->trim(); });
        return;
    }
    const auto done =
        without_exceptions([&] { return use_archive().and_then([&] { return archive_->probe(refused_bytes_); }); });
    std::unique_lock lock(mutex_);
    if (done) works_again(lock);
}

bool FrameRetention::step() {
    std::unique_lock lock(mutex_);
    if (std::exchange(results_need_room_, false)) {
        lock.unlock();
        // An error is reported with the next frame.
        (void)without_exceptions(
            [&] { return use_archive().and_then([&] { return archive_->leave_more_free(kRoomForResults); }); });
        return true;
    }
    if (waiting_.empty()) return false;
    Handle buffer = std::move(waiting_.front());
    waiting_.pop_front();
    lock.unlock();
    write(*buffer);
    lock.lock();
    free_.push_back(std::move(buffer));
    return true;
}

Result<void> FrameRetention::use_archive() {
    if (archive_ != nullptr) return {};
    auto opened = open_();
    if (!opened) return tl::unexpected(opened.error());
    archive_ = std::move(*opened);
    return {};
}

void FrameRetention::make_room_for_results() {
    const std::lock_guard lock(mutex_);
    results_need_room_ = true;
    wake_.notify_one();
}

void FrameRetention::write(Buffer& buffer) {
    refused_bytes_ = buffer.samples.bytes().size();
    const auto done = without_exceptions([&]() -> Result<void> {
        if (auto usable = use_archive(); !usable) return usable;
        const auto png = encode_png(buffer.samples.view(), metadata_of(buffer));
        if (!png) return tl::unexpected(png.error());
        refused_bytes_ = png->size();
        return archive_->add(fmt::format("{}-p{}-{}", file_time(buffer.time_us), buffer.part, buffer.role), *png);
    });
    std::unique_lock lock(mutex_);
    if (!done) return drop(lock, done.error());
    ++counts_.kept;
    works_again(lock);
}

// With the lock, which is released while the listener is called.
void FrameRetention::works_again(std::unique_lock<std::mutex>& lock) {
    if (!waiting_.empty() || !std::exchange(counts_.failing, false)) return;
    lock.unlock();
    if (listener_.works_again) listener_.works_again();
}

std::string FrameRetention::metadata_of(const Buffer& buffer) const {
    FrameMetadata data;
    data.station = options_.station;
    data.software = options_.software;
    data.boot = options_.boot;
    data.part = buffer.part;
    data.time_us = buffer.time_us;
    data.role = buffer.role;
    data.trigger = buffer.trigger;
    data.grid = options_.extents;
    data.bits = buffer.samples.bits();
    data.dark_dn = buffer.dark_dn;
    data.judgement = {std::string(name_of(buffer.verdict)),
                      std::string(name_of(buffer.reason)),
                      buffer.score,
                      to_json(buffer.defects),
                      to_hex(sha256(buffer.maps)),
                      buffer.maps_of_bounds,
                      buffer.bounded,
                      buffer.out_of_time};
    data.samples_sha256 = digest_of_samples(buffer.samples.view());
    data.recipe = *buffer.recipe;
    return data.to_json();
}

}  // namespace hord::firmware::store
