// hordctl calibrate: the lenslet grid of a sensor from a white frame.
#include <chrono>
#include <ctime>
#include <numbers>
#include <optional>

#include <fmt/chrono.h>
#include <fmt/format.h>
#include <nlohmann/json.hpp>

#include "calib/calibrate_grid.h"
#include "calib/grid_toml.h"
#include "drivers/frame_file.h"
#include "firmware/hordctl/commands.h"
#include "firmware/hordctl/progress.h"

namespace hord::firmware {
namespace {

using Json = nlohmann::ordered_json;

struct CalibrateArguments {
    std::string white, dark, out, centres, camera = "unnamed";
    bool json = false;
};

Json to_json(const CalibrateArguments& arguments, const calib::GridCalibration& found) {
    const calib::GridFit& fit = found.fit;
    Json ladder = Json::array(), unobservable = Json::array();
    for (const auto& rung : fit.ladder) {
        ladder.push_back({{"model", name_of(rung.rung)}, {"cv_rms_x_px", rung.cv_x_rms_px}, {"cv_rms_y_px", rung.cv_y_rms_px}, {"verdict", rung.verdict}});
    }
    for (const auto& parameter : fit.unobservable) unobservable.push_back(parameter.name);
    return {{"white", arguments.white},
            {"lattice", name_of(fit.grid.kind)},
            {"columns", fit.grid.columns},
            {"rows", fit.grid.rows},
            {"pitch_px", found.pitch_px},
            {"rotation_deg", found.rotation_rad * 180 / std::numbers::pi},
            {"model", name_of(fit.grid.rung)},
            {"reason", fit.reason},
            {"ladder", ladder},
            {"unobservable", unobservable},
            {"lenslets",
             {{"inside", found.inside}, {"complete", found.complete}, {"found", found.found}, {"missing", found.missing}, {"rejected", found.rejected}, {"saturated", found.saturated}}},
            {"residual_px", {{"rms_x", fit.rms_x_px}, {"rms_y", fit.rms_y_px}, {"max", fit.max_px}}},
            {"cross_validated_px", {{"rms_x", fit.cv_x_rms_px}, {"rms_y", fit.cv_y_rms_px}, {"blocks", fit.blocks}}}};
}

Exit run_calibrate(const CalibrateArguments& arguments) {
    auto white = drivers::read_frame(arguments.white);
    if (!white) return complain(white.error());
    std::optional<algo::Frame> dark;
    if (!arguments.dark.empty()) {
        auto read = drivers::read_frame(arguments.dark, {white->width_px(), white->height_px(), 0});
        if (!read) return complain(read.error());
        dark = std::move(*read);
    }
    std::optional<Progress> progress(std::in_place, "calibrate");
    calib::GridOptions options;
    options.progress = [&](double done) { progress->show(done); };
    const auto found = calib::calibrate_grid(white->view(), dark ? std::optional(dark->view()) : std::nullopt, options);
    progress.reset();
    if (!found) return complain({found.error().code, arguments.white + ": " + found.error().what, found.error().cure});

    const std::time_t now = std::time(nullptr);
    const calib::GridStamp stamp{arguments.camera, fmt::format("{:%Y-%m-%dT%H:%M:%SZ}", fmt::gmtime(now)), arguments.white, arguments.dark};
    if (auto done = calib::write_grid(arguments.out, calib::file_of(*found, stamp)); !done) return complain(done.error());
    if (!arguments.centres.empty()) {
        if (auto done = calib::write_centres(arguments.centres, *found); !done) return complain(done.error());
    }
    if (arguments.json) {
        fmt::print("{}\n", to_json(arguments, *found).dump());
        return Exit::good;
    }
    const calib::GridFit& fit = found->fit;
    fmt::print("{} lattice, {} x {} lenslets, pitch {:.4f} px, rotation {:.4f} degrees\n", name_of(fit.grid.kind), fit.grid.columns, fit.grid.rows,
               found->pitch_px, found->rotation_rad * 180 / std::numbers::pi);
    fmt::print("model: {} ({})\n", name_of(fit.grid.rung), fit.reason);
    fmt::print("lenslets: {} complete, {} found, {} missing, {} rejected, {} saturated\n", found->complete, found->found, found->missing, found->rejected,
               found->saturated);
    fmt::print("residual {:.4f} / {:.4f} px, cross-validated {:.4f} / {:.4f} px (x / y, rms)\n", fit.rms_x_px, fit.rms_y_px, fit.cv_x_rms_px, fit.cv_y_rms_px);
    fmt::print("{}\n", arguments.out);
    return Exit::good;
}

}  // namespace

void add_calibrate(CLI::App& program, Exit& status) {
    auto* command = program.add_subcommand("calibrate", "Find the lenslet grid of a sensor in a white frame");
    auto arguments = std::make_shared<CalibrateArguments>();
    command->add_option("WHITE", arguments->white, "A frame of even light: 8- or 16-bit grey")->required();
    command->add_option("--dark", arguments->dark, "A frame without light, of the same size");
    command->add_option("--out", arguments->out, "Calibration file to write (TOML)")->required();
    command->add_option("--centres", arguments->centres, "Lenslet centres to write (CSV: m,n,x_px,y_px; pixel (0,0) is the centre of the top-left one)");
    command->add_option("--camera", arguments->camera, "Identity of the camera, kept in the file")->capture_default_str();
    command->add_flag("--json", arguments->json, "Print one JSON object");
    command->footer("Exit status: 0 written, 2 no lattice or unreadable input.\nExample: hordctl calibrate white.png --dark dark.png --out grid.toml");
    command->callback([arguments, &status] { status = run_calibrate(*arguments); });
}

}  // namespace hord::firmware
