#include "drivers/recorded_frames.h"

#include <algorithm>
#include <array>
#include <cctype>
#include <system_error>

namespace hord::drivers {
namespace {

namespace fs = std::filesystem;

bool looks_like_a_frame(const fs::path& file) {
    std::string extension = file.extension().string();
    std::ranges::transform(extension, extension.begin(), [](unsigned char c) { return static_cast<char>(std::tolower(c)); });
    constexpr std::array<std::string_view, 4> known = {".png", ".tif", ".tiff", ".pgm"};
    return std::ranges::find(known, extension) != known.end();
}

Result<std::vector<fs::path>> list(const std::vector<fs::path>& files_or_folders) {
    std::vector<fs::path> out;
    for (const fs::path& path : files_or_folders) {
        std::error_code error;
        if (!fs::is_directory(path, error)) {
            out.push_back(path);
            continue;
        }
        std::vector<fs::path> in_folder;
        for (auto entry = fs::directory_iterator(path, error); !error && entry != fs::directory_iterator(); entry.increment(error)) {
            if (looks_like_a_frame(entry->path())) in_folder.push_back(entry->path());
        }
        if (error) return fail(ErrorCode::unreadable, "the folder " + path.string() + " cannot be read", "check its permissions");
        if (in_folder.empty()) {
            return fail(ErrorCode::not_found, "the folder " + path.string() + " holds no frame", "put PNG, TIFF or PGM frames into it");
        }
        std::ranges::sort(in_folder);
        out.insert(out.end(), in_folder.begin(), in_folder.end());
    }
    if (out.empty()) return fail(ErrorCode::not_found, "no recorded frame is named", "name a folder or files");
    return out;
}

}  // namespace

RecordedFrames::RecordedFrames(hal::EventLoop& loop, const RecordedFramesOptions& options)
    : loop_(loop), options_(options), slots_(std::make_unique<Slot[]>(static_cast<std::size_t>(options.buffers))) {}

Result<std::unique_ptr<RecordedFrames>> RecordedFrames::open(hal::EventLoop& loop, const std::vector<fs::path>& files_or_folders,
                                                             const RecordedFramesOptions& options) {
    if (options.buffers < 1) return fail(ErrorCode::invalid_argument, "recorded frames need at least one buffer", "set buffers to 4");
    auto files = list(files_or_folders);
    if (!files) return tl::unexpected(files.error());
    std::unique_ptr<RecordedFrames> sensor(new RecordedFrames(loop, options));
    ExpectedFrame expected = options.expected;
    Error all;
    for (const fs::path& file : *files) {
        auto frame = read_frame(file, expected);
        if (!frame) {
            if (all.what.empty()) all = frame.error();
            else all.what += "\n" + frame.error().message();
            continue;
        }
        expected = {frame->width_px(), frame->height_px(), frame->bits()};
        sensor->frames_.push_back(std::move(*frame));
        sensor->files_.push_back(file);
    }
    if (!all.what.empty()) return tl::unexpected(all);
    return sensor;
}

hal::SensorFormat RecordedFrames::do_format() const {
    const algo::Frame& first = frames_.front();
    return {first.width_px(), first.height_px(), first.bits(), options_.buffers};
}

Result<void> RecordedFrames::do_start(Listener& listener) {
    listener_ = &listener;
    sequence_ = 0;
    lost_ = false;
    return {};
}

Error RecordedFrames::used_up() const {
    return {ErrorCode::disconnected, "all " + std::to_string(frames_.size()) + " recorded frames are played",
            "stop and start to play them again, or let them repeat"};
}

Result<void> RecordedFrames::do_trigger(const hal::ExposureRequest& request) {
    if (lost_) return tl::unexpected(used_up());
    if (sequence_ == frames_.size() && !options_.repeat) {
        lost_ = true;
        lost_timer_ = loop_.call_after({}, [this] { listener_->on_sensor_lost(used_up()); });
        return tl::unexpected(used_up());
    }
    for (std::uint32_t k = 0; k < static_cast<std::uint32_t>(options_.buffers); ++k) {
        Slot& slot = slots_[k];
        if (slot.state.load(std::memory_order_acquire) != State::free) continue;
        slot.state.store(State::exposing, std::memory_order_relaxed);
        const algo::Frame& frame = frames_[sequence_ % frames_.size()];
        slot.info = {.sequence = ++sequence_, .exposure_start = std::max(request.start, loop_.now()),
                     .bytes_used = frame.bytes().size(), .corrupt = false};
        slot.timer = loop_.call_at(slot.info.exposure_start + request.length + options_.readout, [this, k] { deliver(k); });
        return {};
    }
    return fail(ErrorCode::busy, "every frame buffer is lent or filling", "give frames back sooner, or set more buffers");
}

void RecordedFrames::deliver(std::uint32_t number) {
    Slot& slot = slots_[number];
    slot.state.store(State::lent, std::memory_order_relaxed);
    const algo::Frame& frame = frames_[(slot.info.sequence - 1) % frames_.size()];
    listener_->on_frame(hal::FrameLease(*this, number, frame.view(), slot.info));
}

void RecordedFrames::do_stop() {
    listener_ = nullptr;
    loop_.cancel(lost_timer_);
    for (int k = 0; k < options_.buffers; ++k) {
        Slot& slot = slots_[static_cast<std::size_t>(k)];
        if (slot.state.load(std::memory_order_acquire) != State::exposing) continue;
        loop_.cancel(slot.timer);
        slot.state.store(State::free, std::memory_order_release);
    }
}

}  // namespace hord::drivers
