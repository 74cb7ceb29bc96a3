#include "firmware/store/recorder/station_recorder.h"

#include <algorithm>
#include <utility>

#include <fmt/format.h>

namespace hord::firmware::store {
namespace {

// More parts with defects than can be between camera and ejector: older entries belong to parts whose result never
// came.
constexpr std::size_t kFoundKept = 512;

StartRecord begun_now(StartRecord start, UtcMicros now) {
    start.time_us = now;
    return start;
}

}  // namespace

StationRecorder::StationRecorder(const hal::Clock& clock, const std::function<UtcMicros()>& utc_now,
                                 StoreQueue::Open open, StationRecorderOptions options,
                                 StoreQueue::Listener queue_listener, std::unique_ptr<FrameRetention> frames)
    : clock_(clock), utc_now_(utc_now), ignored_part_(options.ignored_part), frames_(std::move(frames)),
      queue_(std::move(open), options.queue, begun_now(std::move(options.start), utc_now()), utc_now,
             std::move(queue_listener)) {}

UtcMicros StationRecorder::utc_of(std::int64_t station_ns) const {
    const std::int64_t ago_ns = clock_.now().time_since_epoch().count() - station_ns;
    return utc_now_() - ago_ns / 1000;
}

void StationRecorder::in_use(ChangeRecord::What what, const std::string& name, const std::string& text) {
    if (frames_ && what == ChangeRecord::What::recipe) frames_->set_recipe(text);
    queue_.add(ChangeRecord{
        .what = what, .time_us = utc_now_(), .peer = {}, .name = name, .before = {}, .after = text, .if_new = true});
}

void StationRecorder::on_result(const PartResult& result) {
    ResultRecord record{result, utc_of(result.arrived_ns), {}};
    {
        const std::lock_guard lock(mutex_);
        const auto found =
            std::find_if(found_.begin(), found_.end(), [&](const Found& f) { return f.part == result.part; });
        if (found != found_.end()) {
            record.defects = std::move(found->defects);
            found_.erase(found);
        }
    }
    if (frames_) frames_->on_result(result);
    queue_.add(std::move(record));
}

AckStatus StationRecorder::on_acknowledged(const RequestOrigin& who, std::uint32_t sequence) {
    return queue_.acknowledge(who.peer, utc_now_(), sequence);
}

void StationRecorder::on_change(const Change& change) {
    using What = ChangeRecord::What;
    const What what = change.what == Change::What::command ? What::command
        : change.what == Change::What::recipe              ? What::recipe
                                                           : What::configuration;
    if (frames_ && what == What::recipe) frames_->set_recipe(change.after);
    queue_.add(
        ChangeRecord{what, utc_now_(), change.who.peer, change.who.token, change.name, change.before, change.after});
}

void StationRecorder::on_inspection(std::uint32_t part, const FrameView& frame, const algo::Inspection& inspection) {
    if (part == ignored_part_) return;
    if (!inspection.defects.empty()) {
        Found found{part, {inspection.defects.begin(), inspection.defects.end()}};
        const std::lock_guard lock(mutex_);
        found_.push_back(std::move(found));
        if (found_.size() > kFoundKept) found_.pop_front();
    }
    if (frames_) frames_->on_inspection(part, frame, inspection);
}

std::vector<Error> StationRecorder::finish() {
    std::vector<Error> all;
    if (const Unstored left = queue_.finish(); left.any()) all.push_back(left.error());
    const std::uint64_t dropped = frames_ ? frames_->finish() : 0;
    if (dropped > 0) {
        all.push_back({ErrorCode::io, fmt::format("{} frames could not be kept", dropped),
                       "free space on the store's disk, or use a faster one"});
    }
    return all;
}

}  // namespace hord::firmware::store
