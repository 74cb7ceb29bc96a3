#include "drivers/hal/camera_sensor.h"

#include <algorithm>
#include <utility>

#include "drivers/hal/packed_samples.h"

namespace hord::drivers {
namespace {

constexpr hal::Duration kOverdue = std::chrono::milliseconds(250);  // a frame that is awaited so long does not come

}  // namespace

Result<void> CameraSensor::check_buffers(int buffers) {
    if (buffers >= kMinBuffers && buffers <= kMaxBuffers) return {};
    return fail(ErrorCode::invalid_argument, "sensor.buffers must be in 2..32", "set it to 4");
}

Result<void> CameraSensor::begin(std::shared_ptr<CameraStream> stream, int fd, Listener& listener) {
    const auto& memory = stream->memory;
    const auto width = static_cast<std::size_t>(format_.width_px), height = static_cast<std::size_t>(format_.height_px);
    const std::size_t needed = static_cast<std::size_t>(stride_bytes_) * height;
    if (memory.size() <= static_cast<std::size_t>(format_.buffers)) {
        return fail(ErrorCode::io, name_ + " gives only " + std::to_string(memory.size()) + " buffers",
                    "set fewer sensor.buffers");
    }
    if (std::ranges::any_of(memory, [&](const auto& buffer) { return buffer.size() < needed; }))
        return fail(ErrorCode::io, name_ + ": a buffer is smaller than a frame", "look at the kernel's log");
    if (fd >= 0) {
        if (auto watched = watch(fd); !watched) return watched;
    }
    if (layout_ != SampleLayout::plain)
        stream->unpacked.assign(memory.size(), std::vector<std::uint16_t>(width * height));
    listener_ = &listener;
    lost_ = false;
    waiting_.clear();
    commanded_.reset();
    commands_ = 0;
    last_match_.reset();
    given_up_ = false;
    unproven_ = 0;
    untriggered_ = 0;
    const std::scoped_lock lock(mutex_);
    ++generation_;
    stream_ = std::move(stream);
    return {};
}

Result<void> CameraSensor::watch(int fd) {
    loop_.unwatch(watch_);
    return loop_.watch(fd, hal::EventLoop::Readiness::readable, [this] { on_ready(); })
        .map([this](hal::EventLoop::WatchId watch) { watch_ = watch; });
}

Result<void> CameraSensor::do_trigger(const hal::ExposureRequest& request) {
    if (lost_) return fail(ErrorCode::disconnected, name_ + " is gone", "stop it and start it again");
    if (triggers_ == CameraTriggers::command) forget_what_was_not_commanded();
    if (commanded_ && loop_.now() - commanded_->at > kOverdue && request.start < commanded_->at + kPatience)
        return fail(ErrorCode::busy,
                    name_ + ": the frame of its last trigger has not come for " +
                        std::to_string((loop_.now() - commanded_->at) / std::chrono::milliseconds(1)) + " ms",
                    cure_of_silence_);
    const std::scoped_lock lock(mutex_);
    const auto lent = std::ranges::count_if(lent_, [&](const auto& lease) { return lease.second == stream_; });
    if (static_cast<std::size_t>(lent) + waiting_.size() >= static_cast<std::size_t>(format_.buffers)) {
        const bool overdue = !waiting_.empty() && loop_.now() - waiting_.front().start > kOverdue;
        if (overdue && lent == 0) {
            const bool comes = last_delivery_ > waiting_.front().start;
            return fail(ErrorCode::busy,
                        name_ + ": the last " + std::to_string(waiting_.size()) + " exposures brought " +
                            (comes ? "frames whose time stamps are before their triggers" : "no frame"),
                        comes ? "look whether the camera's clock stands still or was set; switch the camera off and on"
                              : cure_of_silence_);
        }
        return fail(ErrorCode::busy, name_ + ": every buffer is lent or filling",
                    "give frames back sooner, or set more sensor.buffers" +
                        (lent == 0 ? "; if no frame comes at all, " + cure_of_silence_ : ""));
    }
    waiting_.push_back(request);
    return {};
}

void CameraSensor::forget_what_was_not_commanded() {
    std::erase_if(waiting_, [this](const hal::ExposureRequest& request) {
        return (!commanded_ || commanded_->exposure != request.exposure) &&
            request.start + request.length < loop_.now();
    });
}

Result<void> CameraSensor::begin_command(std::uint32_t exposure) {
    const auto its = std::ranges::find(waiting_, exposure, &hal::ExposureRequest::exposure);
    if (commanded_ && loop_.now() - commanded_->at < kPatience) {
        if (its != waiting_.end()) waiting_.erase(its);
        return fail(ErrorCode::busy, name_ + ": the frame of the trigger before has not come",
                    "leave more time between parts, or look why frames take so long");
    }
    waiting_.erase(waiting_.begin(), its == waiting_.end() ? waiting_.begin() : its);
    given_up_ = given_up_ || commanded_;
    ++commands_;
    commanded_ = Commanded{exposure, loop_.now()};
    return {};
}

CameraSensor::Match CameraSensor::match(const CameraFrame& frame) {
    const auto began = [&](const hal::ExposureRequest& exposure) {
        return frame.stamp_of_start ? frame.stamp : frame.stamp - exposure.length;
    };
    if (triggers_ == CameraTriggers::command) {
        if (!commanded_) return {waiting_.end()};
        const auto its = std::ranges::find(waiting_, commanded_->exposure, &hal::ExposureRequest::exposure);
        if ((its == waiting_.end() ? frame.stamp : began(*its)) < commanded_->at) return {waiting_.end()};
        if (!answers_open_command(frame)) {
            ++unproven_;
            return {waiting_.end()};
        }
        last_match_ = Matched{frame.sequence, commands_};
        given_up_ = false;
        unproven_ = 0;
        return {its, std::exchange(commanded_, std::nullopt)->exposure};
    }
    while (waiting_.size() > 1 && began(waiting_[1]) >= waiting_[1].start) waiting_.erase(waiting_.begin());
    const bool triggered = !waiting_.empty() && began(waiting_.front()) >= waiting_.front().start;
    return {triggered ? waiting_.begin() : waiting_.end()};
}

bool CameraSensor::answers_open_command(const CameraFrame& frame) const {
    if (!given_up_ || frame.stamp_error_known) return true;
    return last_match_ && frame.sequence - last_match_->sequence == commands_ - last_match_->commands;
}

void CameraSensor::deliver(const CameraFrame& frame) {
    last_delivery_ = loop_.now();
    const Match its = match(frame);
    const bool triggered = its.trigger != waiting_.end();
    std::shared_ptr<CameraStream> stream;
    std::uint32_t slot = 0;
    {
        const std::scoped_lock lock(mutex_);
        stream = stream_;
        if (frame.buffer >= stream->memory.size()) return lose(name_ + " named a buffer that does not exist");
        if (!triggered && triggers_ == CameraTriggers::unknown) {
            ++untriggered_;
            if (const auto queued = stream->queue(frame.buffer); !queued)
                lose(name_ + ": " + queued.error().what, queued.error().cure);
            return;
        }
        slot = generation_ * static_cast<std::uint32_t>(kMaxBuffers) + frame.buffer;
        lent_[slot] = stream;
    }
    hal::FrameInfo info{
        .sequence = frame.sequence - untriggered_,
        .exposure_start = frame.stamp_of_start || !triggered ? frame.stamp : frame.stamp - its.trigger->length,
        .bytes_used = frame.bytes_used,
        .corrupt = frame.corrupt,
        .exposure = its.exposure,
        .nobodys = triggers_ == CameraTriggers::command && its.exposure == 0};
    if (triggered) waiting_.erase(its.trigger);
    const FrameView view = view_of(*stream, frame.buffer, info.bytes_used);
    listener_->on_frame(hal::FrameLease(*this, slot, view, info));
    if (is_running() && unproven_ >= kMaxUnproven) {
        lose(name_ + ": its last " + std::to_string(unproven_) +
                 " frames do not show which trigger made them, since one brought no frame within " +
                 std::to_string(kPatience / std::chrono::milliseconds(1)) + " ms",
             "look why its frames come so late, or why it ignores triggers (exposure and transfer longer than the "
             "distance between parts); stop it and start it again");
    }
}

// The camera's own buffer, or the unpacked samples and their size in `bytes_used`.
FrameView CameraSensor::view_of(CameraStream& stream, std::uint32_t buffer, std::size_t& bytes_used) const {
    const std::byte* data = stream.memory[buffer].data();
    FrameView view{data, format_.width_px, format_.height_px, stride_bytes_, format_.bits};
    if (layout_ == SampleLayout::plain) return view;
    const auto width = static_cast<std::size_t>(format_.width_px), height = static_cast<std::size_t>(format_.height_px),
               stride = static_cast<std::size_t>(stride_bytes_);
    std::vector<std::uint16_t>& samples = stream.unpacked[buffer];
    auto* const bytes = reinterpret_cast<std::byte*>(samples.data());
    if (layout_ == SampleLayout::mipi) {
        bytes_used = unpack_rows(data, stride, bytes_used, format_.bits, width, samples);
    } else if (layout_ != SampleLayout::green) {
        const std::span whole{data, std::min(bytes_used, stream.memory[buffer].size())};
        const bool complete = layout_ == SampleLayout::gige ? unpack_gige(whole, format_.bits, samples)
                                                            : unpack_pfnc(whole, format_.bits, samples);
        bytes_used = complete ? samples.size() * sizeof(std::uint16_t) : 0;
    } else {
        std::size_t y = 0;  // complete rows
        for (; y < height && y * stride + 3 * width <= bytes_used; ++y) {
            for (std::size_t x = 0; x < width; ++x) bytes[y * width + x] = data[y * stride + 3 * x + 1];
        }
        bytes_used = y * width;
    }
    view.data = bytes;
    view.stride_bytes = static_cast<std::ptrdiff_t>(format_.width_px) * view.sample_bytes();
    return view;
}

void CameraSensor::do_give_back(std::uint32_t slot) noexcept {
    const std::scoped_lock lock(mutex_);
    const auto lease = lent_.find(slot);
    if (lease == lent_.end()) return;
    // A failure shows as lost frames.
    if (lease->second == stream_) (void)stream_->queue(slot % static_cast<std::uint32_t>(kMaxBuffers));
    lent_.erase(lease);  // the last lease of an earlier stream frees it
}

void CameraSensor::lose(const std::string& what, const std::string& cure) {
    if (std::exchange(lost_, true)) return;
    loop_.unwatch(watch_);
    waiting_.clear();
    const Error why{ErrorCode::disconnected, what, cure};
    lost_timer_ = loop_.call_after({}, [this, why] { listener_->on_sensor_lost(why); });
    on_lost(why);
}

std::shared_ptr<CameraStream> CameraSensor::end() {
    listener_ = nullptr;
    loop_.cancel(lost_timer_);
    loop_.unwatch(watch_);
    waiting_.clear();
    const std::scoped_lock lock(mutex_);
    return std::exchange(stream_, nullptr);
}

}  // namespace hord::drivers
