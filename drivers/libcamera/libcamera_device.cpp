// A camera by libcamera 0.0.3 (Debian 12) or 0.4 (Debian 13). Only the way to pass stream roles differs.
#include "drivers/libcamera/libcamera_device.h"

#include <algorithm>
#include <array>
#include <atomic>
#include <cerrno>
#include <cstdlib>
#include <cstring>
#include <filesystem>
#include <optional>

#include <fcntl.h>
#include <libcamera/libcamera.h>
#include <libcamera/property_ids.h>
#include <libcamera/version.h>
#include <sys/stat.h>

#include "common/unique_fd.h"
#include "drivers/libcamera/libcamera_format.h"
#include "drivers/libcamera/libcamera_request.h"

namespace hord::drivers {
namespace {

using libcamera::ControlType;
using libcamera::ControlValue;

std::unique_ptr<libcamera::CameraConfiguration> configuration_for(libcamera::Camera& camera,
                                                                  libcamera::StreamRole role) {
#if LIBCAMERA_VERSION_MAJOR == 0 && LIBCAMERA_VERSION_MINOR == 0
    return camera.generateConfiguration(libcamera::StreamRoles{role});
#else
    return camera.generateConfiguration({role});
#endif
}

std::optional<ControlValue> value_of(ControlType type, std::int64_t value) {
    switch (type) {
        case libcamera::ControlTypeBool: return ControlValue(value != 0);
        case libcamera::ControlTypeByte: return ControlValue(static_cast<std::uint8_t>(value));
        case libcamera::ControlTypeInteger32: return ControlValue(static_cast<std::int32_t>(value));
        case libcamera::ControlTypeInteger64: return ControlValue(value);
        case libcamera::ControlTypeFloat: return ControlValue(static_cast<float>(value));
        default: return std::nullopt;
    }
}

class LibcameraDevice final : public CameraDevice {
  public:
    explicit LibcameraDevice(LibcameraSensorOptions request) : request_(std::move(request)) {}
    ~LibcameraDevice() override { stop(); }

    Result<std::vector<hal::ListedCamera>> list() override {
        ::setenv("LIBCAMERA_LOG_LEVELS", "*:ERROR", 0);
        if (auto started = start_manager(); !started) return tl::unexpected(started.error());
        std::vector<hal::ListedCamera> cameras;
        for (const auto& camera : manager_->cameras()) cameras.push_back(listed(*camera));
        let_go();
        return cameras;
    }

    Result<CameraFormat> look() override {
        auto format = take();
        let_go();
        return format;
    }

    Result<std::vector<CameraBuffer>> start(CameraPort::Listener& listener) override {
        if (auto format = take(); !format) {
            let_go();
            return tl::unexpected(format.error());
        }
        auto buffers = stream(listener);
        if (!buffers) stop();
        return buffers;
    }

    Result<void> queue(std::uint32_t buffer) override {
        libcamera::Request& request = *requests_[buffer];
        request.reuse(libcamera::Request::ReuseBuffers);
        if (const int error = camera_->queueRequest(&request); error != 0) return failed("takes no request", error);
        return {};
    }

    void stop() override {
        if (!camera_) return;
        if (streams_.exchange(false)) camera_->stop();  // completes pending requests as cancelled
        camera_->requestCompleted.disconnect(this);
        camera_->disconnected.disconnect(this);
        requests_.clear();
        if (allocator_) allocator_->free(config_->at(0).stream());
        allocator_.reset();
        let_go();
    }

    bool is_there() override {
        return std::ranges::all_of(nodes_, [](const common::UniqueFd& node) {
            struct stat status {};
            return ::fstat(node.get(), &status) == 0 && status.st_nlink > 0;
        });
    }

  private:
    tl::unexpected<Error> failed(const std::string& what, int error) const {
        const ErrorCode code = error == -EBUSY ? ErrorCode::busy
            : error == -ENODEV                 ? ErrorCode::not_found
                                               : ErrorCode::io;
        return fail(
            code, id_ + ": " + what + ": " + std::strerror(-error),
            code == ErrorCode::busy ? "close the program that uses it" : "check its cable and the kernel's log");
    }

    // Holds the camera's video nodes as path descriptors: a removed node has no name any more, even if another device
    // now has that name.
    void hold_nodes() {
        std::error_code error;
        for (auto entry = std::filesystem::directory_iterator("/dev", error);
             !error && entry != std::filesystem::directory_iterator(); entry.increment(error)) {
            if (!entry->path().filename().string().starts_with("video")) continue;
            common::UniqueFd node(::open(entry->path().c_str(), O_PATH | O_CLOEXEC));
            struct stat status {};
            if (node && ::fstat(node.get(), &status) == 0 && is_mine(status.st_rdev)) nodes_.push_back(std::move(node));
        }
    }
    [[nodiscard]] bool is_mine(dev_t device) const {
#if LIBCAMERA_VERSION_MAJOR == 0 && LIBCAMERA_VERSION_MINOR == 0
        return manager_->get(device) == camera_;
#else
        const auto devices = camera_->properties().get(libcamera::properties::SystemDevices);
        return devices && std::ranges::find(*devices, static_cast<std::int64_t>(device)) != devices->end();
#endif
    }

    void let_go() {
        nodes_.clear();
        config_.reset();
        if (camera_ && std::exchange(acquired_, false)) camera_->release();
        camera_.reset();
        manager_.reset();
    }

    Result<void> start_manager() {
        manager_ = std::make_unique<libcamera::CameraManager>();
        if (const int error = manager_->start(); error != 0) {
            return fail(ErrorCode::io, std::string("libcamera does not start: ") + std::strerror(-error),
                        "join the group video; see cam -l");
        }
        return {};
    }

    // Without acquiring the camera.
    static hal::ListedCamera listed(libcamera::Camera& camera) {
        hal::ListedCamera out;
        out.name = camera.id();
        out.text = camera.properties().get(libcamera::properties::Model).value_or("");
        for (const auto role :
             {libcamera::StreamRole::Raw, libcamera::StreamRole::Viewfinder, libcamera::StreamRole::VideoRecording}) {
            const auto config = configuration_for(camera, role);
            if (!config || config->empty()) continue;
            const libcamera::StreamFormats formats = config->at(0).formats();
            for (const auto& pixels : formats.pixelformats()) {
                const std::string name = pixels.toString();
                if (std::ranges::find(out.formats, name, &hal::ListedFormat::name) != out.formats.end()) continue;
                hal::ListedFormat& format = out.formats.emplace_back();
                format.name = name;
                format.bits = libcamera_bits(name);
                for (const auto& size : formats.sizes(pixels)) {
                    format.sizes.push_back(size.toString());
                    format.width_px = static_cast<int>(size.width);  // libcamera sorts them: the last is the largest
                    format.height_px = static_cast<int>(size.height);
                }
            }
        }
        return out;
    }

    // Finds the camera, acquires it and negotiates the format.
    Result<CameraFormat> take() {
        if (auto started = start_manager(); !started) return tl::unexpected(started.error());
        std::vector<std::string> ids;
        for (const auto& camera : manager_->cameras()) ids.push_back(camera->id());
        const auto chosen = choose_camera(ids, request_.camera);
        if (!chosen) return tl::unexpected(chosen.error());
        id_ = *chosen;
        camera_ = manager_->get(id_);
        if (!camera_) return fail(ErrorCode::not_found, "camera \"" + id_ + "\" went away", "check its cable");
        if (const int error = camera_->acquire(); error != 0) return failed("cannot be taken", error);
        acquired_ = true;
        return configure();
    }

    Result<CameraFormat> configure() {
        std::vector<std::string> names;
        for (const auto role :
             {libcamera::StreamRole::Raw, libcamera::StreamRole::Viewfinder, libcamera::StreamRole::VideoRecording}) {
            auto config = configuration_for(*camera_, role);
            if (!config || config->empty()) continue;
            std::vector<std::string> of_role;
            for (const auto& format : config->at(0).formats().pixelformats()) of_role.push_back(format.toString());
            names.insert(names.end(), of_role.begin(), of_role.end());
            const auto grey = choose_libcamera_format(id_, of_role, request_.bits, request_.green);
            if (!grey) continue;
            return agree(std::move(config), *grey);
        }
        std::ranges::sort(names);
        names.erase(std::unique(names.begin(), names.end()), names.end());
        return tl::unexpected(choose_libcamera_format(id_, names, request_.bits, request_.green).error());
    }

    Result<CameraFormat> agree(std::unique_ptr<libcamera::CameraConfiguration> config, const GreyFormat& grey) {
        libcamera::StreamConfiguration& wanted = config->at(0);
        const libcamera::PixelFormat format = libcamera::PixelFormat::fromString(grey.name);
        wanted.pixelFormat = format;
        if (request_.width_px > 0) wanted.size.width = static_cast<unsigned>(request_.width_px);
        if (request_.height_px > 0) wanted.size.height = static_cast<unsigned>(request_.height_px);
        wanted.bufferCount = static_cast<unsigned>(request_.buffers);
        const libcamera::Size size = wanted.size;
        const auto status = config->validate();
        if (status == libcamera::CameraConfiguration::Invalid || wanted.pixelFormat != format || wanted.size != size) {
            std::string sizes;
            for (const auto& one : wanted.formats().sizes(format))
                sizes += (sizes.empty() ? "" : ", ") + one.toString();
            return fail(ErrorCode::unsupported,
                        id_ + " has no " + grey.name + " frames of " + size.toString() +
                            "; sizes: " + (sizes.empty() ? "not said" : sizes),
                        "set sensor.width_px and height_px to one of them");
        }
        config_ = std::move(config);
        if (const int error = camera_->configure(config_.get()); error != 0)
            return failed("its format cannot be set", error);
        const libcamera::StreamConfiguration& made = config_->at(0);
        return CameraFormat{static_cast<int>(made.size.width), static_cast<int>(made.size.height), grey,
                            static_cast<std::ptrdiff_t>(made.stride)};
    }

    Result<std::vector<CameraBuffer>> stream(CameraPort::Listener& listener) {
        libcamera::Stream* const stream = config_->at(0).stream();
        allocator_ = std::make_unique<libcamera::FrameBufferAllocator>(camera_);
        if (const int error = allocator_->allocate(stream); error < 0) return failed("gives no buffers", error);
        std::vector<CameraBuffer> buffers;
        for (const auto& buffer : allocator_->buffers(stream)) {
            const auto& plane = buffer->planes().front();
            buffers.push_back({plane.fd.get(),
                               plane.offset == libcamera::FrameBuffer::Plane::kInvalidOffset ? 0 : plane.offset,
                               plane.length});
            auto request = camera_->createRequest(requests_.size());
            if (!request || request->addBuffer(stream, buffer.get()) != 0) return failed("takes no buffer", -EIO);
            requests_.push_back(std::move(request));
        }
        auto controls = settings();
        if (!controls) return tl::unexpected(controls.error());
        listener_ = &listener;
        camera_->requestCompleted.connect(this, &LibcameraDevice::on_completed);
        camera_->disconnected.connect(this, &LibcameraDevice::on_disconnected);
        streams_ = true;
        if (const int error = camera_->start(&*controls); error != 0) {
            streams_ = false;
            return failed("does not stream", error);
        }
        for (const auto& request : requests_) {
            if (const int error = camera_->queueRequest(request.get()); error != 0)
                return failed("takes no request", error);
        }
        hold_nodes();
        return buffers;
    }

    Result<libcamera::ControlList> settings() {
        libcamera::ControlList list(camera_->controls());
        for (const auto& [name, number] : request_.controls) {
            const libcamera::ControlId* found = nullptr;
            std::string names;
            for (const auto& [id, info] : camera_->controls()) {
                names += (names.empty() ? "" : ", ") + id->name();
                if (id->name() == name) found = id;
            }
            if (found == nullptr)
                return fail(
                    ErrorCode::unsupported,
                    id_ + ": control \"" + name + "\" does not exist; controls: " + (names.empty() ? "none" : names),
                    "see cam -c ID --list-controls");
            const auto value = value_of(found->type(), number);
            if (!value)
                return fail(ErrorCode::unsupported, id_ + ": control \"" + name + "\" is no number", "leave it out");
            list.set(found->id(), *value);
        }
        return list;
    }

    // Both on libcamera's thread.
    void on_completed(libcamera::Request* request) {
        if (request->status() == libcamera::Request::RequestCancelled) {
            // Cancelled by stop(), or the camera accepts no buffer any more. libcamera reports its loss later, and only
            // to a process that may listen to the kernel's device events.
            if (streams_) listener_->on_camera_gone({}, {});
            return;
        }
        const libcamera::FrameMetadata& metadata = request->buffers().begin()->second->metadata();
        CameraFrame frame;
        frame.buffer = static_cast<std::uint32_t>(request->cookie());
        frame.sequence = metadata.sequence;
        frame.corrupt = metadata.status != libcamera::FrameMetadata::FrameSuccess;
        if (!metadata.planes().empty()) frame.bytes_used = metadata.planes()[0].bytesused;
        const auto start = request->metadata().get(libcamera::controls::SensorTimestamp);
        frame.stamp_of_start = start.has_value();
        frame.stamp = hal::TimePoint(hal::Duration(start ? *start : static_cast<std::int64_t>(metadata.timestamp)));
        listener_->on_camera_frame(frame);
    }
    void on_disconnected() { listener_->on_camera_gone({}, {}); }

    const LibcameraSensorOptions request_;
    std::string id_;
    std::unique_ptr<libcamera::CameraManager> manager_;  // the process may have one
    std::shared_ptr<libcamera::Camera> camera_;
    std::unique_ptr<libcamera::CameraConfiguration> config_;
    std::unique_ptr<libcamera::FrameBufferAllocator> allocator_;
    std::vector<std::unique_ptr<libcamera::Request>> requests_;
    std::vector<common::UniqueFd> nodes_;
    CameraPort::Listener* listener_ = nullptr;
    bool acquired_ = false;
    std::atomic<bool> streams_ = false;
};

}  // namespace

std::unique_ptr<CameraDevice> open_libcamera(const std::string& request) {
    auto options = parse_libcamera_request(request);
    return options ? std::make_unique<LibcameraDevice>(std::move(*options)) : nullptr;
}

}  // namespace hord::drivers
