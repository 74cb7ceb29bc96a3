#include "firmware/diagnostics/device_diagnostics.h"

#include <algorithm>
#include <utility>

#include <fmt/format.h>

#include "firmware/diagnostics/frame_quality.h"

namespace hord::firmware {
namespace {

using hal::Duration;
using std::chrono::milliseconds;

constexpr Duration kListen = milliseconds(300);  // to the part sensor: three times the detection time of a lost line
constexpr Duration kLead = milliseconds(20);     // from request to light
constexpr Duration kPatience = milliseconds(3000);

struct SensesParts final : hal::PartSensor::Listener {
    void on_edge(const hal::PartEdge&) override { ++edges; }
    void on_encoder(const hal::EncoderReading&) override { ++readings; }
    void on_part_sensor_lost(const Error& error) override { lost = error; }
    int edges = 0, readings = 0;
    std::optional<Error> lost;
};
struct SeesLight final : hal::Strobe::Listener {
    void on_strobe(const hal::StrobeReport& report) override { reports.push_back(report); }
    void on_strobe_lost(const Error& error) override { lost = error; }
    std::vector<hal::StrobeReport> reports;
    std::optional<Error> lost;
};
struct SeesFrames final : hal::Sensor::Listener {
    void on_frame(hal::FrameLease lease) override { frame = std::move(lease); }
    void on_sensor_lost(const Error& error) override { lost = error; }
    hal::FrameLease frame;
    std::optional<Error> lost;
};
struct SeesRejects final : hal::Rejector::Listener {
    void on_reject(const hal::RejectReport& r) override { report = r; }
    void on_rejector_link(bool is_up, const Error& why_down) override {
        up = is_up;
        if (!is_up) why = why_down;
    }
    bool up = false;
    Error why;
    std::optional<hal::RejectReport> report;
};

double ms(Duration d) { return static_cast<double>(d.count()) / 1e6; }

class Check {
  public:
    Check(hal::EventLoop& loop, CellUnderTest& cell, const DeviceDiagnosticsOptions& options)
        : loop_(loop), cell_(cell), options_(options) {}

    std::vector<CheckRow> go() {
        if (!cell_.camera_hears) part_sensor();
        lights();
        sensor();
        rejector();
        if (hal::Strobe* strobe = usable(cell_.strobe)) strobe->stop();
        return std::move(rows_);
    }

  private:
    void add(std::string what, CheckRow::Result result, std::string found, std::string cure = {}) {
        rows_.push_back({std::move(what), result, std::move(found), std::move(cure)});
        if (options_.row) options_.row(rows_.back());
    }
    void good(const std::string& what, std::string found) { add(what, CheckRow::Result::good, std::move(found)); }
    void bad(const std::string& what, const Error& error) { add(what, CheckRow::Result::bad, error.what, error.cure); }
    void bad(const std::string& what, std::string found, std::string cure) {
        add(what, CheckRow::Result::bad, std::move(found), std::move(cure));
    }
    void skipped(const std::string& what, std::string why) { add(what, CheckRow::Result::skipped, std::move(why)); }
    void judged(const std::string& what, const Judgement& judgement) {
        add(what, judgement.good ? CheckRow::Result::good : CheckRow::Result::bad, judgement.found, judgement.cure);
    }

    template <class Device>
    Device* usable(DeviceUnderTest<Device>& device) {
        return device.device ? *device.device : nullptr;
    }
    // Rows for a device that is not there.
    template <class Device>
    Device* opened(const std::string& what, DeviceUnderTest<Device>& device) {
        if (!device.device) bad(what, device.device.error());
        else if (*device.device == nullptr) skipped(what, "simulated in this configuration");
        return usable(device);
    }

    void part_sensor() {
        hal::PartSensor* device = opened("part sensor", cell_.part_sensor);
        if (device == nullptr) return;
        SensesParts senses;
        if (auto started = device->start(senses); !started) return bad("part sensor", started.error());
        options_.wait([&] { return senses.lost.has_value(); }, kListen);
        device->stop();
        if (senses.lost) return bad("part sensor", *senses.lost);
        good("part sensor",
             fmt::format("{}, {} edges in {:.1f} s", cell_.part_sensor.name, senses.edges, ms(kListen) / 1000));
        if (!cell_.encoder) return;
        if (senses.readings > 0)
            good("encoder", fmt::format("{} readings in {:.1f} s", senses.readings, ms(kListen) / 1000));
        else bad("encoder", "tells nothing", "check its wiring and [part_sensor.encoder]");
    }

    // Each light alone, as long as a part is lit and no longer than it may be.
    void lights() {
        hal::Strobe* strobe = opened("lights", cell_.strobe);
        if (strobe == nullptr) return;
        if (auto started = strobe->start(light_); !started) {
            cell_.strobe.device = tl::unexpected(started.error());
            return bad("lights", started.error());
        }
        const hal::StrobeLimits limits = strobe->limits();
        good("lights",
             fmt::format("{}, {} {}", cell_.strobe.name, limits.channels,
                         limits.channels == 1 ? "collimator" : "collimators"));
        if (cell_.camera_lights)
            return skipped("light 0", "the camera lights its exposures: see the rows of the frame");
        for (int channel = 0; channel < limits.channels; ++channel) {
            const std::string what = fmt::format("light {}", channel);
            const auto report = flash(*strobe, 1U << static_cast<unsigned>(channel), loop_.now() + kLead,
                                      std::min(cell_.core.strobe, limits.max_on));
            if (!report) {
                bad(what, report.error());
            } else if (!report->lit) {
                bad(what, "was not lit",
                    "the machine did not run the strobe's thread in time: try again with nothing else running, or "
                    "under a real-time policy");
            } else {
                good(what,
                     fmt::format("lit for {:.3f} ms, asked for {:.3f}", ms(report->width),
                                 ms(std::min(cell_.core.strobe, limits.max_on))));
            }
        }
    }

    // Fires one pulse as soon as the light has rested, and waits for its report.
    Result<hal::StrobeReport> flash(hal::Strobe& strobe, std::uint32_t channels, hal::TimePoint start, Duration width) {
        light_.reports.clear();
        Result<void> fired;
        for (const hal::TimePoint give_up = loop_.now() + kPatience; loop_.now() < give_up;
             start = loop_.now() + kLead) {
            fired = strobe.fire({.exposure = ++exposure_, .channels = channels, .start = start, .width = width});
            if (fired || fired.error().code != ErrorCode::busy) break;
            options_.wait([] { return false; }, kLead);
        }
        if (!fired) return tl::unexpected(fired.error());
        options_.wait([&] { return !light_.reports.empty() || light_.lost; }, kPatience);
        if (light_.lost) return tl::unexpected(*light_.lost);
        if (light_.reports.empty()) return fail(ErrorCode::internal, "the strobe does not report", "report this");
        return light_.reports.back();
    }

    void sensor() {
        hal::Sensor* device = opened("sensor", cell_.sensor);
        if (device == nullptr) return;
        SeesFrames sees;
        if (auto started = device->start(sees); !started) return bad("sensor", started.error());
        const hal::SensorFormat format = device->format();
        good("sensor",
             fmt::format("{}, {}x{} at {} bits, {} frames at a time", cell_.sensor.name, format.width_px,
                         format.height_px, format.bits, format.buffers));
        if (cell_.camera_hears) part_sensor();
        look(*device, sees);
        sees.frame = {};
        device->stop();
    }

    // One frame with light and one without.
    void look(hal::Sensor& device, SeesFrames& sees) {
        hal::Strobe* strobe = usable(cell_.strobe);
        const auto lit = exposure(device, sees, strobe);
        if (!lit) return bad("frame", lit.error());
        good("frame", fmt::format("came {:.1f} ms after the exposure's end", ms(*lit)));
        const auto quality = quality_of_frame(sees.frame.view());
        if (!quality) return bad("exposure", quality.error());
        if (strobe == nullptr) return skipped("exposure, focus", "no light of this station's own");
        judged("exposure", judge_exposure(*quality));
        judged("saturation", judge_saturation(*quality, cell_.recipe));
        judged("focus", judge_focus(*quality));
        if (cell_.camera_lights) return skipped("without light", "the camera lights every exposure");
        const auto dark = exposure(device, sees, nullptr);
        if (!dark) return bad("without light", dark.error());
        const auto dark_quality = quality_of_frame(sees.frame.view());
        if (!dark_quality) return bad("without light", dark_quality.error());
        judged("without light", judge_dark(*dark_quality, *quality));
    }

    // Exposes as for a part. Returns the time from the end of the exposure to the frame.
    Result<Duration> exposure(hal::Sensor& device, SeesFrames& sees, hal::Strobe* strobe) {
        sees.frame = {};
        const CoreConfig& core = cell_.core;
        if (strobe != nullptr) {  // it has rested before the exposure begins
            options_.wait([] { return false; }, std::max(core.min_gap, strobe->limits().min_rest));
        }
        const hal::TimePoint start = loop_.now() + std::max(core.trigger_lead, kLead);
        if (auto asked = device.trigger({.exposure = exposure_ + 1, .start = start, .length = core.exposure}); !asked)
            return tl::unexpected(asked.error());
        if (strobe != nullptr) {
            const auto report = flash(*strobe, core.strobe_channels, start + core.strobe_delay, core.strobe);
            if (!report) return tl::unexpected(report.error());
            if (!report->lit)
                return fail(ErrorCode::timeout, "the light was not lit for it", "see the rows of the lights");
        }
        const Duration patience = start + core.exposure - loop_.now() + std::max(core.frame_timeout, kPatience);
        options_.wait([&] { return static_cast<bool>(sees.frame) || sees.lost; }, patience);
        if (sees.lost) return tl::unexpected(*sees.lost);
        if (!sees.frame) {
            return fail(
                ErrorCode::timeout, fmt::format("none within {:.1f} s", ms(patience) / 1000),
                "check the sensor's trigger: free-running, or wired to what the station triggers; see its controls");
        }
        const hal::SensorFormat format = device.format();
        const std::size_t row = static_cast<std::size_t>(format.width_px) * (format.bits > 8 ? 2 : 1);
        const auto needed =
            static_cast<std::size_t>(sees.frame.view().stride_bytes) * static_cast<std::size_t>(format.height_px - 1) +
            row;
        if (sees.frame.info().corrupt || sees.frame.info().bytes_used < needed) {
            return fail(ErrorCode::io, fmt::format("damaged: {} of {} bytes", sees.frame.info().bytes_used, needed),
                        "check the sensor's cable and the kernel's log");
        }
        return loop_.now() - (start + core.exposure);
    }

    Result<FrameQuality> quality_of_frame(const FrameView& frame) {
        if (cell_.decoder) {
            const auto decoded = cell_.decoder->decode(frame);
            if (!decoded) return tl::unexpected(decoded.error());
            return quality_of(decoded->view(), cell_.decoder->extents(), cell_.recipe);
        }
        const auto extents = algo::extents_of_frame(frame.width_px, frame.height_px, cell_.bins_i, cell_.bins_j);
        if (!extents) return tl::unexpected(extents.error());
        return quality_of(frame, *extents, cell_.recipe);
    }

    void rejector() {
        hal::Rejector* device = opened("rejector", cell_.rejector);
        if (device == nullptr) return;
        if (cell_.ask_module) {
            const auto said = cell_.ask_module();
            if (!said) return bad("rejector", said.error());
            good("rejector", fmt::format("{}: {}", cell_.rejector.name, *said));
        } else {
            good("rejector", cell_.rejector.name);
        }
        if (!options_.actuate) return skipped("ejector", "not moved: add --actuate, with the line clear");
        SeesRejects sees;
        if (auto started = device->start(sees); !started) return bad("ejector", started.error());
        if (!options_.wait([&] { return sees.up; }, kPatience)) {
            bad("ejector",
                sees.why.what.empty()
                    ? Error{ErrorCode::timeout, "its link does not come up", "check its power and cable"}
                    : sees.why);
        } else {
            eject(*device, sees);
        }
        device->stop();
    }

    void eject(hal::Rejector& device, SeesRejects& sees) {
        const CoreConfig& core = cell_.core;
        const hal::RejectCommand command{.part = 1, .start = loop_.now() + kLead, .width = core.reject_pulse};
        if (auto taken = device.reject(command); !taken) return bad("ejector", taken.error());
        options_.wait([&] { return sees.report.has_value(); }, kPatience);
        using Outcome = hal::RejectReport::Outcome;
        if (!sees.report || sees.report->outcome == Outcome::failed) {
            if (!sees.up && !sees.why.what.empty()) return bad("ejector", sees.why);
            bad("ejector", "no confirmation",
                "check the address of its coil, the module's own fault display and its profile; with a confirm sensor: "
                "nothing came past it");
        } else if (sees.report->outcome == Outcome::late) {
            bad("ejector", fmt::format("acknowledged after its pulse of {:.1f} ms", ms(core.reject_pulse)),
                "the module is slow: lengthen rejector.pulse_ms, or use a faster link");
        } else if (sees.report->at - command.start > core.reject_early) {
            bad("ejector",
                fmt::format("acknowledged {:.1f} ms after its start; the part is there after {:.1f} ms",
                            ms(sees.report->at - command.start), ms(core.reject_early)),
                "the module is slow: lengthen rejector.early_ms, or use a faster link");
        } else {
            good("ejector",
                 fmt::format("pulsed for {:.1f} ms, acknowledged {:.1f} ms after its start", ms(core.reject_pulse),
                             ms(sees.report->at - command.start)));
        }
        options_.wait([] { return false; }, core.reject_pulse + kLead);  // the pulse ends by itself
    }

    hal::EventLoop& loop_;
    CellUnderTest& cell_;
    const DeviceDiagnosticsOptions& options_;
    SeesLight light_;
    std::uint32_t exposure_ = 0;
    std::vector<CheckRow> rows_;
};

}  // namespace

std::vector<CheckRow> check_cell(hal::EventLoop& loop, CellUnderTest& cell, const DeviceDiagnosticsOptions& options) {
    return Check(loop, cell, options).go();
}

std::string table_of(const std::vector<CheckRow>& rows) {
    std::size_t width = 0;
    for (const CheckRow& row : rows) width = std::max(width, row.what.size());
    std::string out;
    for (const CheckRow& row : rows) {
        const char* result = row.result == CheckRow::Result::good ? "good"
            : row.result == CheckRow::Result::bad                 ? "BAD"
                                                                  : "-";
        out += fmt::format("{:<{}}  {:<4}  {}\n", row.what, width, result, row.found);
        if (!row.cure.empty()) out += fmt::format("{:<{}}        cure: {}\n", "", width, row.cure);
    }
    return out;
}

}  // namespace hord::firmware
