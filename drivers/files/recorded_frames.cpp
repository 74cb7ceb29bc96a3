#include "drivers/files/recorded_frames.h"

#include <algorithm>
#include <utility>

namespace hord::drivers {

namespace fs = std::filesystem;

Result<std::unique_ptr<RecordedFrames>> RecordedFrames::open(hal::EventLoop& loop,
                                                             const std::vector<fs::path>& files_or_folders,
                                                             const std::function<void(double)>& progress) {
    auto files = list_frames(files_or_folders);
    if (!files) return tl::unexpected(files.error());
    std::unique_ptr<RecordedFrames> sensor(new RecordedFrames(loop));
    ExpectedFrame expected;
    Error all;
    double looked_at = 0;
    for (const fs::path& file : *files) {
        if (progress) progress(looked_at++ / static_cast<double>(files->size()));
        auto read = sensor->read(file, expected);
        if (!read) {
            if (all.what.empty()) all = read.error();
            else all.what += "\n" + read.error().message();
            continue;
        }
        expected = {read->width_px(), read->height_px(), read->bits()};
        sensor->frames_.push_back(std::move(*read));
    }
    if (progress) progress(1);
    if (!all.what.empty()) return tl::unexpected(all);
    return sensor;
}

// The frame in the expected format; its note must be that of the frames before it.
Result<Frame> RecordedFrames::read(const fs::path& file, const ExpectedFrame& expected) {
    auto read = read_noted_frame(file, expected);
    if (!read) return tl::unexpected(read.error());
    const auto& geometry = read->geometry;
    if (geometry && noted_ && !(*geometry == noted_->geometry)) {
        return fail(
            ErrorCode::invalid_argument,
            file.string() + " says " + describe(*geometry) + ", and " + noted_->file + " " + describe(noted_->geometry),
            "play frames of one geometry");
    }
    if (expected.bits != 0 && read->frame.bits() != expected.bits) {
        return fail(ErrorCode::invalid_argument,
                    file.string() + " has " + std::to_string(read->frame.bits()) +
                        "-bit samples, and the frames before it " + std::to_string(expected.bits),
                    "play frames of one depth");
    }
    if (geometry && !noted_) noted_ = Noted{file.string(), *geometry};
    return std::move(read->frame);
}

hal::SensorFormat RecordedFrames::format() const {
    const Frame& first = frames_.front();
    return {first.width_px(), first.height_px(), first.bits(), kBuffers};
}

Result<void> RecordedFrames::do_start(Listener& listener) {
    listener_ = &listener;
    sequence_ = 0;
    lost_ = false;
    return {};
}

Error RecordedFrames::used_up() const {
    return {ErrorCode::disconnected, "all " + std::to_string(frames_.size()) + " recorded frames are played",
            "stop and start to play them again"};
}

Result<void> RecordedFrames::do_trigger(const hal::ExposureRequest& request) {
    if (lost_) return tl::unexpected(used_up());
    if (sequence_ == frames_.size()) {
        lost_ = true;
        lost_timer_ = loop_.call_after({}, [this] { listener_->on_sensor_lost(used_up()); });
        return tl::unexpected(used_up());
    }
    for (std::uint32_t k = 0; k < slots_.size(); ++k) {
        Slot& slot = slots_[k];
        if (slot.state.load(std::memory_order_acquire) != State::free) continue;
        slot.state.store(State::exposing, std::memory_order_relaxed);
        const Frame& frame = frames_[sequence_];
        slot.info = {.sequence = ++sequence_,
                     .exposure_start = std::max(request.start, loop_.now()),
                     .bytes_used = frame.bytes().size(),
                     .corrupt = false};
        slot.timer = loop_.call_at(slot.info.exposure_start + request.length + kReadout, [this, k] { deliver(k); });
        return {};
    }
    return fail(ErrorCode::busy, "every frame buffer is lent or filling",
                "give frames back sooner, or set more buffers");
}

void RecordedFrames::deliver(std::uint32_t number) {
    Slot& slot = slots_[number];
    slot.state.store(State::lent, std::memory_order_relaxed);
    const Frame& frame = frames_[slot.info.sequence - 1];
    listener_->on_frame(hal::FrameLease(*this, number, frame.view(), slot.info));
}

void RecordedFrames::do_stop() {
    listener_ = nullptr;
    loop_.cancel(lost_timer_);
    for (Slot& slot : slots_) {
        if (slot.state.load(std::memory_order_acquire) != State::exposing) continue;
        loop_.cancel(slot.timer);
        slot.state.store(State::free, std::memory_order_release);
    }
}

}  // namespace hord::drivers
