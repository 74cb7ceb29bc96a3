#include "drivers/files/recorded_frames.h"

#include <algorithm>
#include <utility>

#include <fmt/format.h>

namespace hord::drivers {

namespace fs = std::filesystem;

Result<Frame> RecordedSeries::read(const fs::path& file) {
    std::error_code none;
    if (fs::is_directory(file, none)) {
        return fail(ErrorCode::invalid_argument, file.string() + " is a folder, and its name is a frame's",
                    "rename it, or name a folder of frames alone");
    }
    // A file of 16 bits without a note has the depth of the frames before it.
    const int found = format_.bits > 8 ? format_.bits : 0;
    auto read = read_noted_frame(file, {0, 0, bits_ != 0 ? bits_ : found});
    if (!read) return tl::unexpected(read.error());
    const Frame& frame = read->frame;
    const auto& geometry = read->geometry;
    const auto refuse = [&](const std::string& has, const std::string& before, const char* cure) {
        return fail(ErrorCode::invalid_argument, file.string() + has + ", and the frames before it " + before, cure);
    };
    const auto size = [](int width, int height) { return std::to_string(width) + "x" + std::to_string(height); };
    if (geometry && noted_ && !(*geometry == noted_->geometry)) {
        return fail(
            ErrorCode::invalid_argument,
            file.string() + " says " + describe(*geometry) + ", and " + noted_->file + " " + describe(noted_->geometry),
            "play frames of one geometry");
    }
    if (format_.bits != 0 && (frame.width_px() != format_.width_px || frame.height_px() != format_.height_px)) {
        return refuse(" is " + size(frame.width_px(), frame.height_px()) + " pixels",
                      size(format_.width_px, format_.height_px), "play frames of one size");
    }
    if (format_.bits != 0 && frame.bits() != format_.bits) {
        return refuse(" has " + std::to_string(frame.bits()) + "-bit samples", std::to_string(format_.bits),
                      "play frames of one depth");
    }
    format_ = {frame.width_px(), frame.height_px(), frame.bits()};
    if (geometry && !noted_) noted_ = Noted{file.string(), *geometry};
    return std::move(read->frame);
}

Error all_of(const std::vector<Error>& problems) {
    const std::size_t told = std::min(problems.size(), kMaxFramesTold);
    Error all{problems.front().code, {}, problems[told - 1].cure};
    if (told < problems.size())
        all.what = fmt::format("{} frames cannot be played; the first {}:\n", problems.size(), told);
    for (std::size_t k = 0; k < told; ++k) {
        const Error& problem = problems[k];
        const bool is_last = k + 1 == told;
        const bool says_cure = !is_last && problems[k + 1].cure != problem.cure;
        all.what += (says_cure ? problem.message() : problem.what) + (is_last ? "" : "\n");
    }
    if (told == problems.size()) return all;
    all.what = fmt::format("{}\nand {} more", all.message(), problems.size() - told);
    all.cure = "mend these and start again: it tells the next ones";
    return all;
}

Result<std::unique_ptr<RecordedFrames>> RecordedFrames::open(hal::EventLoop& loop,
                                                             const std::vector<fs::path>& files_or_folders,
                                                             const std::function<void(double)>& progress, int bits) {
    auto files = list_frames(files_or_folders);
    if (!files) return tl::unexpected(files.error());
    std::unique_ptr<RecordedFrames> sensor(new RecordedFrames(loop, bits));
    std::vector<Error> problems;
    double looked_at = 0;
    for (const fs::path& file : *files) {
        if (progress) progress(looked_at++ / static_cast<double>(files->size()));
        auto read = sensor->series_.read(file);
        if (read) sensor->frames_.push_back(std::move(*read));
        else problems.push_back(read.error());
    }
    if (progress) progress(1);
    if (!problems.empty()) return tl::unexpected(all_of(problems));
    return sensor;
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
