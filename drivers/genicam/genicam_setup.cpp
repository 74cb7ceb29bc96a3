#include "drivers/genicam/genicam_setup.h"

#include <algorithm>
#include <cmath>
#include <utility>
#include <vector>

#include "drivers/genicam/genicam_barrier.h"
#include "drivers/genicam/genicam_discovery.h"
#include "drivers/genicam/genicam_features.h"
#include "drivers/genicam/receive_buffer.h"
#include "drivers/hal/packed_samples.h"

namespace hord::drivers {
namespace {

std::size_t frame_bytes(const GreyFormat& format, std::size_t samples) {
    switch (format.layout) {
        case SampleLayout::gige: return gige_bytes(samples);
        case SampleLayout::pfnc: return pfnc_bytes(format.bits, samples);
        default: return samples * (format.bits > 8 ? 2U : 1U);
    }
}

class Setup {
  public:
    explicit Setup(const GenicamSensorOptions& request) : request_(request) {}

    Result<GenicamSetup> run() {
        auto taken = take_genicam_camera(request_.camera);
        if (!taken) return tl::unexpected(taken.error());
        out_.camera = std::move(taken->camera);
        out_.name = std::move(taken->name);
        device_ = out_.device();
        if (auto done = check_socket_buffer(); !done) return tl::unexpected(done.error());
        const auto format = choose_format();
        if (!format) return tl::unexpected(format.error());
        for (const auto& [feature, value] : features_of(*format)) {
            if (auto done = set(feature, value); !done) return tl::unexpected(done.error());
        }
        if (auto done = set_packets(); !done) return tl::unexpected(done.error());
        if (auto done = set_trigger(); !done) return tl::unexpected(done.error());
        for (const auto& [feature, value] : request_.features) {
            if (auto done = set(feature, value); !done) return tl::unexpected(done.error());
        }
        if (auto done = set_light(); !done) return tl::unexpected(done.error());
        if (auto done = set_barrier(); !done) return tl::unexpected(done.error());
        if (auto done = agree(*format); !done) return tl::unexpected(done.error());
        return std::move(out_);
    }

  private:
    // After the features of the configuration, so that none of them lengthens the light.
    Result<void> set_light() {
        if (request_.light_line.empty()) return {};
        const char* const exposure = exposure_feature(device_);
        const Features light{{"LineSelector", request_.light_line},
                             {"LineMode", "Output"},
                             {"LineSource", "ExposureActive"},
                             {exposure, std::to_string(request_.light_us)}};
        for (const auto& [feature, value] : light) {
            if (auto done = set(feature, value); !done) return done;
        }
        ArvFailure failed;
        const double us = arv_device_get_float_feature_value(device_, exposure, failed.out());
        if (!failed && std::abs(us - static_cast<double>(request_.light_us)) <= 1) return {};
        return fail(ErrorCode::refused,
                    out_.name + ": " + exposure + " is " + std::to_string(us) + " us after it was set to " +
                        std::to_string(request_.light_us),
                    "set timing.strobe_us to a length that the camera has, and switch ExposureAuto off");
    }

    Result<void> set_barrier() {
        if (request_.barrier_line.empty()) return {};
        return named(out_.name, set_input_events(device_, request_.barrier_line).map([this](const InputEvents& events) {
            out_.input.emplace(events.rising, events.falling);
        }));
    }

    Result<void> set(const std::string& feature, const std::string& value) {
        return named(out_.name, set_feature(device_, feature, value));
    }

    Result<GreyFormat> choose_format() {
        guint count = 0;
        ArvFailure failed;
        const GlibOwned<const char*> names(
            arv_camera_dup_available_pixel_formats_as_strings(out_.camera.get(), &count, failed.out()));
        const std::vector<std::string> there(names.get(), names.get() + (names ? count : 0));
        std::vector<GreyFormat> known = genicam_formats();
        if (!request_.pixel_format.empty()) {
            std::erase_if(known, [&](const GreyFormat& one) { return one.name != request_.pixel_format; });
            if (known.empty() || known.front().bits != request_.bits) {
                return fail(ErrorCode::invalid_argument,
                            "sensor.pixel_format \"" + request_.pixel_format + "\" does not hold grey samples of " +
                                std::to_string(request_.bits) + " bits",
                            "use Mono8, Mono10, Mono10p, Mono10Packed, Mono12, Mono12p, Mono12Packed or Mono16, with "
                            "sensor.bits to match; or leave it out");
            }
        }
        return choose_grey_format(out_.name, there, known, request_.bits,
                                  "set sensor.bits, or sensor.pixel_format, to what the camera has");
    }

    using Features = std::vector<std::pair<std::string, std::string>>;
    [[nodiscard]] Features features_of(const GreyFormat& format) const {
        Features out{{"PixelFormat", format.name}};
        const bool has_offset = has_feature(device_, "OffsetX") && has_feature(device_, "OffsetY");
        if (has_offset) out.insert(out.end(), {{"OffsetX", "0"}, {"OffsetY", "0"}});  // else no full width would fit
        if (request_.width_px > 0) out.emplace_back("Width", std::to_string(request_.width_px));
        if (request_.height_px > 0) out.emplace_back("Height", std::to_string(request_.height_px));
        if (request_.offset_x_px > 0) out.emplace_back("OffsetX", std::to_string(request_.offset_x_px));
        if (request_.offset_y_px > 0) out.emplace_back("OffsetY", std::to_string(request_.offset_y_px));
        if (has_feature(device_, "AcquisitionMode")) out.emplace_back("AcquisitionMode", "Continuous");
        return out;
    }

    Result<void> set_packets() {
        if (arv_camera_is_gv_device(out_.camera.get()) == FALSE) return {};
        arv_camera_gv_set_stream_options(out_.camera.get(), ARV_GV_STREAM_OPTION_PACKET_SOCKET_DISABLED);
        ArvFailure failed;
        if (request_.packet_bytes == 0) {
            // A camera that cannot test packets keeps what it has, also from another program or configuration.
            arv_camera_gv_set_packet_size(out_.camera.get(), kEthernetMtu, ArvFailure().out());
            arv_camera_gv_auto_packet_size(out_.camera.get(), failed.out());
        } else {
            arv_camera_gv_set_packet_size(out_.camera.get(), request_.packet_bytes, failed.out());
        }
        const std::string why = failed.what();
        const bool set = !failed;
        out_.packet_bytes = static_cast<int>(arv_camera_gv_get_packet_size(out_.camera.get(), failed.out()));
        if (set && !failed && (request_.packet_bytes == 0 || out_.packet_bytes == request_.packet_bytes)) {
            arv_camera_gv_set_packet_size_adjustment(out_.camera.get(), ARV_GV_PACKET_SIZE_ADJUSTMENT_NEVER);
            return {};
        }
        const std::string wanted = request_.packet_bytes == 0 ? "a size that was negotiated"
                                                              : std::to_string(request_.packet_bytes) + " bytes";
        return fail(ErrorCode::refused,
                    out_.name + ": packets of " + wanted + " were refused (they have " +
                        std::to_string(out_.packet_bytes) + "): " + why,
                    "set sensor.packet_bytes to 0, which negotiates it, or to the MTU of the whole way: cameras want "
                    "multiples of 4");
    }

    Result<void> set_trigger() {
        ArvFailure failed;
        if (request_.trigger == CameraTrigger::free) {
            arv_camera_clear_triggers(out_.camera.get(), failed.out());
        } else {
            const std::string source =
                request_.trigger == CameraTrigger::software ? "Software" : request_.trigger_source;
            if (auto known = set("TriggerSource", source); !known) return known;
            arv_camera_set_trigger(out_.camera.get(), source.c_str(), failed.out());
        }
        if (failed)
            return fail(ErrorCode::refused, out_.name + ": the trigger was refused: " + failed.what(),
                        "see TriggerMode and TriggerSource in the camera's manual");
        return {};
    }

    Result<void> agree(const GreyFormat& grey) {
        ArvFailure failed;
        int x = 0, y = 0, width = 0, height = 0;
        arv_camera_get_region(out_.camera.get(), &x, &y, &width, &height, failed.out());
        const std::size_t needed =
            frame_bytes(grey, static_cast<std::size_t>(width) * static_cast<std::size_t>(height));
        out_.payload = arv_camera_get_payload(out_.camera.get(), failed.out());
        if (failed || width <= 0 || height <= 0)
            return fail(ErrorCode::io, out_.name + " does not say its region: " + failed.what(),
                        "switch it off and on");
        if (out_.payload != needed) {
            return fail(ErrorCode::unsupported,
                        out_.name + " sends " + std::to_string(out_.payload) + " bytes a frame, and " +
                            std::to_string(width) + " x " + std::to_string(height) + " samples of " + grey.name +
                            " are " + std::to_string(needed),
                        "switch chunk data off (ChunkModeActive = false), and choose a width that needs no padding");
        }
        out_.region = {x, y, width, height};
        out_.pixel_format = arv_camera_get_pixel_format(out_.camera.get(), failed.out());
        if (failed)
            return fail(ErrorCode::io, out_.name + " does not say its format: " + failed.what(),
                        "switch it off and on");
        // Packed rows may end inside a byte: whole bytes of a row.
        out_.format = {width, height, grey, static_cast<std::ptrdiff_t>(out_.payload) / height};
        return {};
    }

    // Of a socket that is not the stream's: so that the station does not open where the stream would not start.
    [[nodiscard]] Result<void> check_socket_buffer() const {
        const int wanted = request_.socket_buffer_bytes;
        const int given =
            wanted > 0 && arv_camera_is_gv_device(out_.camera.get()) ? granted_receive_buffer(wanted) : wanted;
        if (given >= wanted) return {};
        return fail(ErrorCode::unsupported,
                    "the kernel gives a socket " + std::to_string(given) + " of the " + std::to_string(wanted) +
                        " bytes of sensor.socket_buffer_bytes",
                    "sysctl net.core.rmem_max=" + std::to_string(wanted) + ", and in /etc/sysctl.d to keep it");
    }

    const GenicamSensorOptions& request_;
    GenicamSetup out_;
    ArvDevice* device_ = nullptr;  // the camera's
};

}  // namespace

Result<GenicamSetup> set_up_genicam(const GenicamSensorOptions& options) { return Setup(options).run(); }

const char* exposure_feature(ArvDevice* device) {
    return has_feature(device, "ExposureTime") ? "ExposureTime" : "ExposureTimeAbs";
}

}  // namespace hord::drivers
