// hordctl calibrate: the lenslet grid of a sensor from a white frame, its direction map from captures at known tilts.
#include <ctime>
#include <filesystem>
#include <functional>
#include <numbers>
#include <optional>

#include <fmt/chrono.h>
#include <fmt/format.h>

#include "calib/calibrate/calibrate_grid.h"
#include "calib/files/accept_calibration.h"
#include "calib/files/grid_toml.h"
#include "common/cli/message.h"
#include "common/cli/progress.h"
#include "firmware/hordctl/commands.h"
#include "firmware/hordctl/frames/calibrate_pictures.h"
#include "firmware/hordctl/frames/frame_reader.h"
#include "firmware/store/results/json_text.h"

namespace hord::firmware {
namespace {

using store::Json;

struct CalibrateArguments {
    std::string white, dark, flat, tilts, out, centres, pictures, camera = std::string(calib::kUnnamedCamera);
    bool json = false, force = false;
};

Json to_json(const calib::DirectionFit& fit) {
    return {{"model", name_of(fit.map.model)},
            {"reason", fit.reason},
            {"captures", fit.captures},
            {"scale_px_a_rad", fit.scale_px_a_rad},
            {"scale_sigma", fit.scale_sigma},
            {"stage_rotation_deg", fit.stage_rotation_rad * 180 / std::numbers::pi},
            {"stage_rotation_sigma_deg", fit.stage_rotation_sigma * 180 / std::numbers::pi},
            {"mirrored", fit.mirrored},
            {"zero_px", {{"x", fit.map.zero_px.x_px}, {"y", fit.map.zero_px.y_px}}},
            {"left_out_px", {{"rms_x", fit.left_out_x_px}, {"rms_y", fit.left_out_y_px}}}};
}

Json to_json(const CalibrateArguments& arguments, const calib::GridCalibration& found,
             const std::optional<calib::DirectionFit>& directions) {
    const calib::GridFit& fit = found.fit;
    Json candidates = Json::array(), unobservable = Json::array();
    for (const auto& model : fit.candidates) {
        candidates.push_back({{"model", name_of(model)},
                              {"cv_rms_x_px", model.cv_x_rms_px},
                              {"cv_rms_y_px", model.cv_y_rms_px},
                              {"verdict", model.verdict}});
    }
    for (const auto& parameter : fit.unobservable) unobservable.push_back(parameter.name);
    Json json{
        {"white", arguments.white},
        {"lattice", name_of(fit.grid.kind)},
        {"columns", fit.grid.columns},
        {"rows", fit.grid.rows},
        {"pitch_px", found.pitch_px},
        {"rotation_deg", found.rotation_rad * 180 / std::numbers::pi},
        {"model", name_of(fit.grid.model)},
        {"reason", fit.reason},
        {"ladder", candidates},
        {"warnings", found.warnings},
        {"unobservable", unobservable},
        {"lenslets",
         {{"inside", found.inside},
          {"complete", found.complete},
          {"found", found.found},
          {"missing", found.missing},
          {"displaced", found.displaced},
          {"rejected", found.rejected},
          {"blemished", found.blemished},
          {"saturated", found.saturated},
          {"apart", found.apart},
          {"whole", found.whole},
          {"whole_found", found.whole_found},
          {"whole_placed", found.whole_placed}}},
        {"residual_px", {{"rms_x", fit.rms_x_px}, {"rms_y", fit.rms_y_px}, {"max", fit.max_px}}},
        {"common_residual_px", {{"rms", found.smooth_residuals.px}, {"alike", found.smooth_residuals.correlation}}},
        {"single_lenslets_px",
         {{"rms", fit.shifts.rms_px},
          {"share", fit.shifts.share},
          {"left_x", fit.shifts.left_x_px},
          {"left_y", fit.shifts.left_y_px}}},
        {"cross_validated_px", {{"rms_x", fit.cv_x_rms_px}, {"rms_y", fit.cv_y_rms_px}, {"blocks", fit.blocks}}}};
    if (directions) json["directions"] = to_json(*directions);
    return json;
}

// Optional frames that measure the sensor itself; they have the size of the white frame.
struct SensorFrames {
    std::optional<Frame> dark, flat;
};
std::optional<FrameView> view_of(const std::optional<Frame>& frame) {
    return frame ? std::optional(frame->view()) : std::nullopt;
}

// An empty name leaves the frame of `otherwise`.
Result<SensorFrames> read_sensor_frames(const std::string& dark, const std::string& flat, const Frame& like,
                                        SensorFrames otherwise) {
    for (const auto& [name, to] : {std::pair{&dark, &otherwise.dark}, {&flat, &otherwise.flat}}) {
        if (name->empty()) continue;
        auto frame = read_raw_frame(*name, {like.width_px(), like.height_px(), 0});
        if (!frame) return tl::unexpected(frame.error());
        *to = std::move(*frame);
    }
    return otherwise;
}

// The captures of tilts.toml in `folder`, one after the other.
Result<calib::DirectionFit> calibrate_directions(const std::filesystem::path& folder,
                                                 const calib::GridCalibration& grid, const Frame& white,
                                                 SensorFrames frames, const std::function<void(double)>& progress) {
    const auto list = calib::read_tilts(folder / "tilts.toml");
    if (!list) return tl::unexpected(list.error());
    const auto place = [&](const std::string& name) { return name.empty() ? name : (folder / name).string(); };
    const auto own = read_sensor_frames(place(list->dark), place(list->flat), white, std::move(frames));
    if (!own) return tl::unexpected(own.error());
    const auto measure = [&](const std::string& name) -> Result<calib::SpotPlace> {
        const auto frame = read_raw_frame(place(name));
        if (!frame) return tl::unexpected(frame.error());
        auto spot = calib::measure_spots(frame->view(), view_of(own->dark), view_of(own->flat), grid);
        if (!spot) return tl::unexpected(about(place(name), spot.error()));
        return spot;
    };
    const auto empty = measure(list->empty);
    if (!empty) return tl::unexpected(empty.error());
    std::vector<calib::Tilt> tilts;
    for (const calib::TiltEntry& entry : list->tilts) {
        progress(static_cast<double>(tilts.size() + 1) / static_cast<double>(list->tilts.size() + 1));
        const auto spot = measure(entry.frame);
        if (!spot) return tl::unexpected(spot.error());
        tilts.push_back({entry.frame, entry.direction, *spot});
    }
    progress(1);
    auto fit = calib::fit_directions(*empty, tilts, grid.pitch_px);
    if (!fit) return tl::unexpected(about(place("tilts.toml"), fit.error()));
    return fit;
}

// A worse calibration is not installed over a better one, nor one of another camera, nor over a file that is not a
// calibration.
Result<void> may_replace(const std::string& out, const calib::GridFile& fresh) {
    if (!std::filesystem::exists(out)) return {};
    const auto held = calib::read_grid(out);
    if (!held)
        return fail(held.error().code, held.error().what + ": it is not overwritten", "give another --out, or --force");
    const auto fine = calib::accept_calibration(fresh, *held);
    if (!fine) return fail(fine.error().code, out + ": not overwritten: " + fine.error().what, fine.error().cure);
    return {};
}

void print_found(const calib::GridCalibration& found, const std::optional<calib::DirectionFit>& directions) {
    const calib::GridFit& fit = found.fit;
    fmt::print("{} lattice, {} x {} lenslets, pitch {:.4f} px, rotation {:.4f} degrees\n", name_of(fit.grid.kind),
               fit.grid.columns, fit.grid.rows, found.pitch_px, found.rotation_rad * 180 / std::numbers::pi);
    fmt::print("model: {} ({})\n", name_of(fit.grid.model), fit.reason);
    fmt::print(
        "lenslets: {} complete, {} found, {} missing, {} displaced with places of their own, {} rejected ({} for "
        "the shape of their light: dust), {} saturated\n",
        found.complete, found.found, found.missing, found.displaced, found.rejected, found.blemished, found.saturated);
    fmt::print("light reaches {} of them whole: {} of these found, {} used\n", found.whole, found.whole_found,
               found.whole_placed);
    fmt::print("residual {:.4f} / {:.4f} px, cross-validated {:.4f} / {:.4f} px (x / y, rms)\n", fit.rms_x_px,
               fit.rms_y_px, fit.cv_x_rms_px, fit.cv_y_rms_px);
    if (directions) {
        fmt::print("directions: {}\n", directions->reason);
        fmt::print(
            "scale {:.3f} +- {:.3f} px a radian, stage turned by {:.4f} +- {:.4f} degrees{}, undeflected light at "
            "{:.3f}, {:.3f} px from the centres\n",
            directions->scale_px_a_rad, directions->scale_sigma,
            directions->stage_rotation_rad * 180 / std::numbers::pi,
            directions->stage_rotation_sigma * 180 / std::numbers::pi, directions->mirrored ? " and mirrored" : "",
            directions->map.zero_px.x_px, directions->map.zero_px.y_px);
    }
}

Exit run_calibrate(const CalibrateArguments& arguments) {
    const std::string tilts =
        arguments.tilts.empty() ? "" : (std::filesystem::path(arguments.tilts) / "tilts.toml").string();
    if (auto fine = check_outputs({{"--out", arguments.out}, {"--centres", arguments.centres}},
                                  {arguments.white, arguments.dark, arguments.flat, tilts});
        !fine)
        return complain(fine.error());
    const auto white = read_raw_frame(arguments.white);
    if (!white) return complain(white.error());
    auto frames = read_sensor_frames(arguments.dark, arguments.flat, *white, {});
    if (!frames) return complain(frames.error());
    std::optional<Progress> progress(std::in_place, "calibrate");
    const double share = arguments.tilts.empty() ? 1 : 0.3;  // of the grid in the progress
    calib::GridOptions options;
    options.flat = view_of(frames->flat);
    options.progress = [&](double done) { progress->show(share * done); };
    const auto found = calib::calibrate_grid(white->view(), view_of(frames->dark), options);
    if (!found) {
        progress.reset();
        return complain(about(arguments.white, found.error()));
    }
    std::optional<calib::DirectionFit> directions;
    if (!arguments.tilts.empty()) {
        auto fit = calibrate_directions(arguments.tilts, *found, *white, std::move(*frames),
                                        [&](double done) { progress->show(share + (1 - share) * done); });
        progress.reset();
        if (!fit) return complain(fit.error());
        directions = std::move(*fit);
    }
    progress.reset();

    const std::time_t now = std::time(nullptr);
    const calib::GridStamp stamp{arguments.camera, fmt::format("{:%Y-%m-%dT%H:%M:%SZ}", fmt::gmtime(now)),
                                 arguments.white, arguments.dark};
    calib::GridFile file = calib::file_of(*found, stamp);
    if (directions) calib::add_directions(file, *directions);
    if (!arguments.pictures.empty()) {
        if (auto done = write_calibration_pictures(arguments.pictures, white->view(), *found); !done)
            return complain(done.error());
    }
    if (!arguments.force) {
        if (auto fine = may_replace(arguments.out, file); !fine) return complain(fine.error());
    }
    if (auto done = calib::write_grid(arguments.out, file); !done) return complain(done.error());
    if (!arguments.centres.empty()) {
        if (auto done = calib::write_centres(arguments.centres, *found); !done) return complain(done.error());
    }
    for (const std::string& warning : found->warnings) print_message("hordctl: warning: {}\n", warning);
    if (arguments.json) {
        fmt::print("{}\n", store::to_text(to_json(arguments, *found, directions)));
        return Exit::good;
    }
    print_found(*found, directions);
    fmt::print("{}\n", arguments.out);
    return Exit::good;
}

}  // namespace

void add_calibrate(CLI::App& program, Exit& status) {
    auto* command = program.add_subcommand("calibrate", "Find the lenslet grid of a sensor in a white frame");
    auto arguments = std::make_shared<CalibrateArguments>();
    command->add_option("WHITE", arguments->white, "A frame of even light: 8- or 16-bit grey")->required();
    command->add_option("--dark", arguments->dark, "A frame without light, of the same size");
    command->add_option("--flat", arguments->flat,
                        "A frame of even light without lenslets: what each pixel makes of it");
    command->add_option(
        "--tilts", arguments->tilts,
        "Folder with captures of collimated light at known directions (tilts or wedges), listed in its tilts.toml");
    command->add_option("--out", arguments->out, "Calibration file to write (TOML)")->required();
    command->add_option("--centres", arguments->centres,
                        "Lenslet centres to write (CSV: m,n,x_px,y_px; pixel (0,0) is the centre of the top-left one)");
    command->add_option("--pictures", arguments->pictures, "Folder for residuals.png, centres.png and models.png");
    command->add_flag("--force", arguments->force,
                      "Overwrite --out even by a worse calibration, or one of another camera");
    command->add_option("--camera", arguments->camera, "Identity of the camera, kept in the file")
        ->capture_default_str();
    command->add_flag("--json", arguments->json, "Print one JSON object");
    command->footer(
        "tilts.toml: empty = \"empty.png\" (collimated, no part, no tilt), dark and flat if any, and for each capture\n"
        "  [[tilt]] with frame = \"1.png\" and x_rad, y_rad (or x_deg, y_deg).\n"
        "Exit status: 0 written (warnings go to the standard error output), 2 no white frame, a grid that does not fit "
        "all "
        "of it,\nunreadable input, or worse than what --out holds, or of another camera.\nExample: hordctl "
        "calibrate white.png --dark dark.png --tilts tilts --out grid.toml");
    command->callback([arguments, &status] { status = run_calibrate(*arguments); });
}

}  // namespace hord::firmware
