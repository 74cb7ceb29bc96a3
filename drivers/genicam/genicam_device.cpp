#include "drivers/genicam/genicam_device.h"

#include <algorithm>
#include <array>
#include <atomic>
#include <cerrno>
#include <cmath>
#include <cstdio>
#include <cstring>
#include <ctime>
#include <mutex>
#include <thread>
#include <vector>

#include <sys/mman.h>
#include <unistd.h>

#include "common/unique_fd.h"
#include "drivers/genicam/frame_identity.h"
#include "drivers/genicam/genicam_barrier.h"
#include "drivers/genicam/genicam_discovery.h"
#include "drivers/genicam/genicam_features.h"
#include "drivers/genicam/genicam_setup.h"
#include "drivers/genicam/receive_buffer.h"

namespace hord::drivers {
namespace {

using namespace std::chrono_literals;

constexpr auto kLatchEvery = 1s, kReportEvery = 60s;
constexpr int kFirstLatches = 8;
constexpr auto kPlausible = 10s;  // between a latched camera's time stamp and the arrival; more: another unit or clock
// Of a socket buffer that is not configured. Packets take more of it than they have bytes.
constexpr std::size_t kMinSocketBytes = 1U << 22U, kMaxSocketBytes = 1U << 30U;
constexpr int kSuspicious = 3;  // incomplete frames and no complete one
constexpr std::uint64_t kPopWaitUs = 50'000;

hal::Duration time_of(clockid_t clock) {
    timespec time{};
    ::clock_gettime(clock, &time);
    return std::chrono::seconds(time.tv_sec) + std::chrono::nanoseconds(time.tv_nsec);
}
hal::TimePoint now() { return hal::TimePoint(time_of(CLOCK_MONOTONIC)); }

// Memory that the station maps, too.
class SharedMemory {
  public:
    explicit SharedMemory(std::size_t bytes) : bytes_(bytes), fd_(::memfd_create("hord-frame", MFD_CLOEXEC)) {
        if (!fd_ || ::ftruncate(fd_.get(), static_cast<off_t>(bytes)) != 0) return;
        void* const data = ::mmap(nullptr, bytes, PROT_READ | PROT_WRITE, MAP_SHARED | MAP_POPULATE, fd_.get(), 0);
        if (data != MAP_FAILED) data_ = data;
    }
    ~SharedMemory() {
        if (data_ != nullptr) ::munmap(data_, bytes_);
    }
    SharedMemory(SharedMemory&& other) noexcept
        : bytes_(other.bytes_), fd_(std::move(other.fd_)), data_(std::exchange(other.data_, nullptr)) {}
    SharedMemory& operator=(SharedMemory&&) = delete;
    [[nodiscard]] void* data() const { return data_; }
    [[nodiscard]] int fd() const { return fd_.get(); }

  private:
    std::size_t bytes_;
    common::UniqueFd fd_;
    void* data_ = nullptr;
};

class GenicamDevice final : public CameraDevice {
  public:
    explicit GenicamDevice(const GenicamSensorOptions& request) : request_(request) {}
    ~GenicamDevice() override { stop(); }

    Result<std::vector<hal::ListedCamera>> list() override { return list_genicam_cameras(); }

    Result<CameraFormat> look() override {
        return set_up_genicam(request_).map([](const GenicamSetup& setup) { return setup.format; });
    }

    Result<std::vector<CameraBuffer>> start(CameraPort::Listener& listener) override {
        auto setup = set_up_genicam(request_);
        if (!setup) return tl::unexpected(setup.error());
        agreed_ = std::move(*setup);
        device_ = agreed_.device();
        auto buffers = stream(listener);
        if (!buffers) stop();
        return buffers;
    }

    Result<void> queue(std::uint32_t buffer) override {
        if (buffer >= buffers_.size()) return fail(ErrorCode::internal, "was given a buffer that does not exist");
        push(buffers_[buffer]);
        return {};
    }

    Result<void> trigger() override {
        ArvFailure failed;
        arv_device_execute_command(device_, "TriggerSoftware", failed.out());
        if (failed) return fail(ErrorCode::io, "took no software trigger: " + failed.what());
        return {};
    }

    void stop() override {
        stopping_ = true;
        messages_.reset();
        if (receiver_.joinable()) receiver_.join();
        if (stream_) {
            ArvFailure failed;
            arv_camera_stop_acquisition(agreed_.camera.get(), failed.out());
            tell_statistics(true);
        }
        stream_.reset();  // with the buffers it has; those that are lent end with the process
        device_ = nullptr;
        agreed_.camera.reset();  // releases the control
    }

    bool is_there() override {
        if (lost_ || now() - checked_ < kLatchEvery) return !lost_;
        checked_ = now();
        heard_ = false;
        if (!answers() && !heard_) lost_ = true;
        tell_statistics(false);
        return !lost_;
    }
    std::string why_gone() override { return "is lost: it does not answer, or another program took its control"; }

  private:
    template <class... Parts>
    void say(const char* format, Parts... parts) const {
        std::fprintf(stderr, "%s: ", agreed_.name.c_str());
        std::fprintf(stderr, format, parts...);
        std::fputc('\n', stderr);
    }

    Result<std::vector<CameraBuffer>> stream(CameraPort::Listener& listener) {
        std::vector<CameraBuffer> out;
        for (int k = 0; k < request_.buffers; ++k) {
            const SharedMemory& memory = memory_.emplace_back(agreed_.payload);
            if (memory.data() == nullptr)
                return fail(ErrorCode::io, std::string("no memory for frames: ") + std::strerror(errno),
                            "set fewer sensor.buffers");
            buffers_.push_back(arv_buffer_new_full(agreed_.payload, memory.data(), GUINT_TO_POINTER(k), nullptr));
            out.push_back({memory.fd(), 0, agreed_.payload});
        }
        ArvFailure failed;
        stream_.reset(arv_camera_create_stream(agreed_.camera.get(), nullptr, nullptr, failed.out()));
        if (!stream_)
            return fail(ErrorCode::io, agreed_.name + " gives no stream: " + failed.what(), "switch it off and on");
        const auto socket_bytes = set_socket_buffer();
        if (!socket_bytes) return tl::unexpected(socket_bytes.error());
        socket_bytes_ = static_cast<std::size_t>(*socket_bytes);
        if (ARV_IS_GV_STREAM(stream_.get())) {
            int mode = ARV_GV_STREAM_PACKET_RESEND_NEVER;  // Aravis's choice, by what the camera says that it can
            g_object_get(stream_.get(), "packet-resend", &mode, nullptr);
            resends_ = mode != ARV_GV_STREAM_PACKET_RESEND_NEVER;
        }
        for (ArvBuffer* const buffer : buffers_) push(buffer);
        g_signal_connect(device_, "control-lost", G_CALLBACK(on_control_lost), this);
        for (int k = 0; k < kFirstLatches; ++k) latch(failed);
        listener_ = &listener;
        if (auto done = listen_to_barrier(); !done) return tl::unexpected(done.error());
        arv_camera_start_acquisition(agreed_.camera.get(), failed.out());
        if (failed)
            return fail(ErrorCode::io, agreed_.name + " does not stream: " + failed.what(),
                        "look at sensor.trigger and at the features of the configuration");
        stopping_ = false;
        any_complete_ = false;
        incomplete_ = 0;
        receiver_ = std::thread([this] { receive(); });
        checked_ = told_ = now();
        tell_start(*socket_bytes);
        return out;
    }

    Result<void> listen_to_barrier() {
        if (!agreed_.input) return {};
        ArvFailure failed;
        ticks_a_second_ = 1'000'000'000;
        if (ARV_IS_GV_DEVICE(device_)) {
            const guint64 frequency = arv_gv_device_get_timestamp_tick_frequency(ARV_GV_DEVICE(device_), failed.out());
            if (!failed && frequency > 0) ticks_a_second_ = frequency;
        }
        auto opened = MessageChannel::open(device_, [this](const GvcpMessage& message) { take(message); });
        return named(agreed_.name, std::move(opened)).map([this](auto channel) { messages_ = std::move(channel); });
    }

    void take(const GvcpMessage& message) {
        heard_ = true;
        for (const InputEdges::Edge& edge : agreed_.input->take(message)) {
            const hal::Duration stamp = time_of_ticks(edge.ticks, ticks_a_second_);
            const hal::TimePoint arrival = now();
            const std::scoped_lock lock(mutex_);
            clock_.arrived(stamp, arrival);
            const hal::TimePoint least = clock_.earliest(stamp), most = clock_.latest(stamp);
            hal::TimePoint at = std::min(least + (most - least) / 2, arrival);
            // Another clock than that of its frames.
            if (std::chrono::abs(arrival - at) > kPlausible) at = arrival;
            last_edge_ = std::max(at, last_edge_);
            listener_->on_camera_edge({edge.active, edge.sequence, last_edge_});
        }
    }

    static hal::Duration time_of_ticks(std::uint64_t ticks, std::uint64_t a_second) {
        return hal::Duration(static_cast<hal::Duration::rep>(static_cast<long double>(ticks) * 1e9L /
                                                             static_cast<long double>(a_second)));
    }

    // Bytes that the kernel gives; 0: not a GigE camera.
    Result<int> set_socket_buffer() {
        if (!ARV_IS_GV_STREAM(stream_.get())) return 0;
        const int wanted = request_.socket_buffer_bytes > 0
            ? request_.socket_buffer_bytes
            : static_cast<int>(std::clamp<std::size_t>(agreed_.payload, kMinSocketBytes, kMaxSocketBytes));
        g_object_set(stream_.get(), "socket-buffer", ARV_GV_STREAM_SOCKET_BUFFER_FIXED, "socket-buffer-size", wanted,
                     nullptr);
        // Aravis sets it at the first packet: too late for the first burst.
        const int socket = udp_socket_on(arv_gv_stream_get_port(ARV_GV_STREAM(stream_.get())));
        if (socket >= 0) return set_receive_buffer(socket, wanted);
        say("its socket was not found: until its first packet it has the buffer of net.core.rmem_default");
        return granted_receive_buffer(wanted);
    }

    void tell_start(int socket_bytes) {
        const CameraFormat& format = agreed_.format;
        say("%d x %d %s, %zu bytes a frame", format.width_px, format.height_px, format.grey.name.c_str(),
            agreed_.payload);
        if (ARV_IS_GV_STREAM(stream_.get())) {
            say("packets of %d bytes (%s), socket buffer of %d bytes%s", agreed_.packet_bytes,
                request_.packet_bytes == 0 ? "negotiated" : "as configured", socket_bytes,
                static_cast<std::size_t>(socket_bytes) < agreed_.payload
                    ? ", less than a frame: frames may lose packets while the processor is busy; raise "
                      "net.core.rmem_max"
                    : "");
            say(resends_ ? "lost packets are asked for again" : "it sends no lost packet again");
        }
        tell_exposure();
        const std::scoped_lock lock(mutex_);
        if (const auto error = clock_.error()) {
            say("its clock is known to +-%.0f us", static_cast<double>(error->count()) / 1e3);
        } else {
            say("its clock cannot be latched: time stamps are late by the least delay of a frame's first packet, which "
                "is "
                "not known");
        }
    }

    // A camera that nobody told its exposure has that of its maker, often some 10 ms: light from elsewhere, and blur.
    void tell_exposure() {
        const char* const exposure = exposure_feature(device_);
        ArvFailure failed;
        const double us = arv_device_get_float_feature_value(device_, exposure, failed.out());
        if (failed) return;
        const auto wanted = static_cast<double>(request_.exposure_us);
        const bool differs =
            request_.light_line.empty() && wanted > 0 && std::abs(us - wanted) > std::max(1.0, 0.01 * wanted);
        if (differs) {
            say("it exposes for %.0f us, and timing.exposure_us is %lld: set %s in [[sensor.feature]] (with "
                "ExposureAuto "
                "off), or timing.exposure_us, unless its trigger sets the exposure",
                us, static_cast<long long>(request_.exposure_us), exposure);
        } else {
            say("it exposes for %.0f us", us);
        }
    }

    void tell_statistics(bool last) {
        if (!stream_ || (!last && now() - told_ < kReportEvery)) return;
        told_ = now();
        std::uint64_t resent = 0, missing = 0;
        if (ARV_IS_GV_STREAM(stream_.get()))
            arv_gv_stream_get_statistics(ARV_GV_STREAM(stream_.get()), &resent, &missing);
        guint64 complete = 0, failures = 0, underruns = 0;
        arv_stream_get_statistics(stream_.get(), &complete, &failures, &underruns);
        const std::array bad{failures, underruns, resent, missing};
        if (bad == told_bad_ && !(last && bad != decltype(bad){})) return;
        told_bad_ = bad;
        say("%llu frames complete, %llu incomplete, %llu without a free buffer; %llu packets sent again, %llu missing",
            static_cast<unsigned long long>(complete), static_cast<unsigned long long>(failures),
            static_cast<unsigned long long>(underruns), static_cast<unsigned long long>(resent),
            static_cast<unsigned long long>(missing));
    }

    // Asks the camera something, the time if it can. False: no answer came within Aravis's time and repetitions. Its
    // heartbeat notices that, too, but later: parts pass unseen meanwhile if the light barrier is the camera's.
    bool answers() {
        ArvFailure failed;
        latch(failed);
        if (no_latch_ && arv_camera_is_gv_device(agreed_.camera.get()) != FALSE)
            arv_camera_gv_get_packet_size(agreed_.camera.get(), failed.out());
        return !failed.is(ARV_DEVICE_ERROR_TIMEOUT);
    }

    // Reads the camera's clock between two readings of the station's. The second one is after the value was read, not
    // after the command: a camera that answers with its present time is then timed rightly, too.
    void latch(ArvFailure& failed) {
        static constexpr std::array<std::array<const char*, 2>, 2> kNames{
            {{"TimestampLatch", "TimestampLatchValue"}, {"GevTimestampControlLatch", "GevTimestampValue"}}};
        if (no_latch_) return;
        const auto names = std::ranges::find_if(
            kNames, [&](const auto& pair) { return has_feature(device_, pair[0]) && has_feature(device_, pair[1]); });
        no_latch_ = names == kNames.end();
        if (no_latch_) return;
        const hal::TimePoint before = now();
        arv_device_execute_command(device_, (*names)[0], failed.out());
        if (failed) return;
        const gint64 value = arv_device_get_integer_feature_value(device_, (*names)[1], failed.out());
        const hal::TimePoint after = now();
        if (failed) return;
        // The older name counts ticks, the newer one nanoseconds.
        std::uint64_t frequency = 1'000'000'000;
        if (names != kNames.begin() && ARV_IS_GV_DEVICE(device_))
            frequency = arv_gv_device_get_timestamp_tick_frequency(ARV_GV_DEVICE(device_), failed.out());
        if (failed || frequency == 0) return;
        const std::scoped_lock lock(mutex_);
        clock_.latched(before, time_of_ticks(static_cast<std::uint64_t>(value), frequency), after);
    }

    void receive() {
        while (!stopping_) {
            ArvBuffer* const buffer = arv_stream_timeout_pop_buffer(stream_.get(), kPopWaitUs);
            if (buffer != nullptr) listener_->on_camera_frame(frame_of(buffer));
        }
    }

    CameraFrame frame_of(ArvBuffer* buffer) {
        heard_ = true;
        CameraFrame frame;
        frame.buffer = GPOINTER_TO_UINT(arv_buffer_get_user_data(buffer));
        // The first packet's arrival, a time of day; 0: it did not come, and the buffer's id is that of an earlier
        // frame.
        const std::chrono::nanoseconds first(arv_buffer_get_system_timestamp(buffer));
        frame.sequence =
            first.count() == 0 ? counter_.sequence_without_id() : counter_.sequence_of(arv_buffer_get_frame_id(buffer));
        std::size_t bytes = 0;
        arv_buffer_get_data(buffer, &bytes);
        // A buffer that is not complete holds samples of an earlier frame.
        const std::string damage = damage_of(buffer);
        frame.corrupt = !damage.empty();
        frame.bytes_used = frame.corrupt ? 0 : bytes;
        if (frame.corrupt) tell_damaged(damage);
        if (!any_complete_ && frame.corrupt && ++incomplete_ == kSuspicious) tell_none_complete(differs(buffer));
        any_complete_ = any_complete_ || !frame.corrupt;
        const hal::TimePoint arrival = first.count() == 0
            ? now()
            : std::min(now(), hal::TimePoint(first + time_of(CLOCK_MONOTONIC) - time_of(CLOCK_REALTIME)));
        const bool triggered = request_.trigger != CameraTrigger::free;
        const hal::Duration stamp(arv_buffer_get_timestamp(buffer));
        frame.stamp = arrival;
        frame.stamp_of_start = triggered && !frame.corrupt;
        if (stamp <= hal::Duration::zero()) return frame;  // no clock, or the first packet was lost
        const std::scoped_lock lock(mutex_);
        if (frame.corrupt && std::chrono::abs(arrival - clock_.latest(stamp)) > kPlausible) return frame;
        if (!frame.corrupt) clock_.arrived(stamp, arrival);
        if (clock_.error() && std::chrono::abs(arrival - clock_.latest(stamp)) > kPlausible) {
            say("its latched clock is not that of its frames: the arrival of frames is used instead");
            no_latch_ = true;
            clock_ = {};
            clock_.arrived(stamp, arrival);
        }
        // Triggered: a frame has a trigger, so the latest time is right: none is taken for one that began before.
        // Running free: the earliest, so that no frame that began before the trigger is taken.
        frame.stamp = std::min(triggered ? clock_.latest(stamp) : clock_.earliest(stamp), arrival);
        frame.stamp_error_known = clock_.error().has_value();
        frame.stamp_of_start = triggered || frame.stamp_error_known;
        return frame;
    }

    static bool misses_packets(ArvBuffer* buffer) {
        const ArvBufferStatus status = arv_buffer_get_status(buffer);
        return status == ARV_BUFFER_STATUS_TIMEOUT || status == ARV_BUFFER_STATUS_MISSING_PACKETS;
    }

    // Its packets came and are not what was agreed.
    static bool differs(ArvBuffer* buffer) {
        const ArvBufferStatus status = arv_buffer_get_status(buffer);
        return status == ARV_BUFFER_STATUS_SIZE_MISMATCH || status == ARV_BUFFER_STATUS_SUCCESS;
    }

    // Empty: the frame is complete, and its first packet says what was agreed.
    [[nodiscard]] std::string damage_of(ArvBuffer* buffer) const {
        const ArvBufferStatus status = arv_buffer_get_status(buffer);
        if (misses_packets(buffer))
            return std::string("packets of it did not come") +
                (resends_ ? ", although lost ones are asked for again" : "");
        if (status == ARV_BUFFER_STATUS_SIZE_MISMATCH) return "it has another size than was agreed";
        if (status != ARV_BUFFER_STATUS_SUCCESS) return "its packets do not belong together";
        if (arv_buffer_get_payload_type(buffer) != ARV_BUFFER_PAYLOAD_TYPE_IMAGE) return "it is not an image alone";
        std::array<int, 4> region{};
        int pad_x = 0, pad_y = 0;
        arv_buffer_get_image_region(buffer, region.data(), &region[1], &region[2], &region[3]);
        arv_buffer_get_image_padding(buffer, &pad_x, &pad_y);
        if (region[2] != agreed_.region[2] || region[3] != agreed_.region[3])
            return "it has another size than was agreed";
        if (region != agreed_.region) return "it has another place on the sensor than was agreed";
        if (arv_buffer_get_image_pixel_format(buffer) != agreed_.pixel_format)
            return "it has another format than was agreed";
        return pad_x != 0 || pad_y != 0 ? "its rows are padded" : "";
    }

    // Receiver's thread. The first one, then one in a while: the counts come with the statistics.
    void tell_damaged(const std::string& damage) {
        if (stopping_ || now() < quiet_until_) return;
        quiet_until_ = now() + kReportEvery;
        say("a frame is damaged: %s", damage.c_str());
    }

    // Large packets that a switch drops: first and last packet of each frame come, and no samples.
    void tell_none_complete(bool differ) const {
        if (differ) {
            say("none of the first %d frames was what was agreed: look at the camera's format, size and region "
                "(what is saved in it, and [[sensor.feature]]); switch it off and on; else update its firmware",
                kSuspicious);
        } else if (agreed_.packet_bytes > kEthernetMtu) {
            say("none of the first %d frames was complete: does everything between camera and station carry packets of "
                "%d bytes? Set sensor.packet_bytes to 0, or raise the MTU of each switch and interface on the way%s",
                kSuspicious, agreed_.packet_bytes,
                socket_bytes_ < agreed_.payload
                    ? "; and raise net.core.rmem_max: the socket buffer is less than a frame"
                    : "");
        } else {
            say("none of the first %d frames was complete: raise net.core.rmem_max, and look for errors of the "
                "network's interface (ip -s link)",
                kSuspicious);
        }
    }

    // A buffer whose frame lost its first packet must not keep the times of an earlier frame.
    void push(ArvBuffer* buffer) {
        arv_buffer_set_timestamp(buffer, 0);
        arv_buffer_set_system_timestamp(buffer, 0);
        arv_stream_push_buffer(stream_.get(), buffer);
    }

    static void on_control_lost(ArvDevice*, GenicamDevice* self) { self->lost_ = true; }

    const GenicamSensorOptions request_;
    GenicamSetup agreed_;
    ArvDevice* device_ = nullptr;  // the camera's
    ArvOwned<ArvStream> stream_;
    std::vector<SharedMemory> memory_;
    std::vector<ArvBuffer*> buffers_;  // of the stream, or lent
    std::size_t socket_bytes_ = 0;
    CameraPort::Listener* listener_ = nullptr;
    std::thread receiver_;
    std::atomic<bool> stopping_ = true, lost_ = false, no_latch_ = false;
    std::atomic<bool> heard_ = false;  // a frame or a message came since the camera was last asked
    BlockCounter counter_;
    bool resends_ = false;        // the camera sends lost packets again
    hal::TimePoint quiet_until_;  // of the receiver, about damaged frames
    bool any_complete_ = false;   // since the start; the receiver's
    int incomplete_ = 0;
    std::mutex mutex_;
    CameraClock clock_;  // under mutex_
    hal::TimePoint checked_, told_;
    std::array<guint64, 4> told_bad_{};
    std::uint64_t ticks_a_second_ = 0;
    hal::TimePoint last_edge_;                  // under mutex_
    std::unique_ptr<MessageChannel> messages_;  // its thread uses the rest
};

}  // namespace

std::unique_ptr<CameraDevice> open_genicam(const GenicamSensorOptions& options) {
    return std::make_unique<GenicamDevice>(options);
}

}  // namespace hord::drivers
