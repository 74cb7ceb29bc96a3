// hord-lab render: a frame of the simulated cell from a scene file, with its ground truth.
#include "hal_sim/optics/camera/render.h"

#include <fstream>
#include <optional>

#include <fmt/format.h>
#include <nlohmann/json.hpp>

#include "common/cli/message.h"
#include "common/cli/progress.h"
#include "drivers/files/frame_file.h"
#include "hal_sim/optics/scene/array_geometry.h"
#include "hal_sim/optics/scene/scene.h"
#include "lab/hord_lab/commands.h"
#include "lab/optics/truth.h"
#include "lab/optics/views.h"

namespace hord::lab {
namespace {

using Json = nlohmann::ordered_json;

struct RenderArguments {
    std::string scene, out, truth, raw, centres;
    std::optional<std::uint64_t> seed;
    int threads = 0;
};

Json to_json(const sim::Scene& scene, const lab::Truth& truth) {
    const algo::Extents& e = scene.camera.extents;
    Json defects = Json::array();
    for (const lab::TruthDefect& d : truth.defects) {
        defects.push_back({{"kind", d.kind},
                           {"m", d.m},
                           {"n", d.n},
                           {"radius_lenslets", d.radius_lenslets},
                           {"area_lenslets", d.area_lenslets}});
    }
    return {{"scene", scene.name},
            {"seed", scene.seed},
            {"grid", {{"m", e.m}, {"n", e.n}, {"i", e.i}, {"j", e.j}}},
            {"bin_pitch_rad", scene.camera.bin_pitch_rad},
            {"field_mm", scene.camera.field_mm},
            {"bits", scene.camera.bits},
            {"defect_free", truth.defect_free},
            {"defects", defects},
            {"labels_of",
             "one a lenslet, row by row: 0 free field, 1 part, 2 border, 3 defect, 4 defect inside the border"},
            {"labels", truth.labels}};
}

std::optional<Error> write_text(const std::string& file, const std::string& text) {
    std::ofstream stream(file);
    stream << text;
    if (stream.flush()) return std::nullopt;
    return Error{ErrorCode::io, file + " cannot be written",
                 "check that the folder exists, may be written to, and has space"};
}

std::string centres_of(const sim::Scene& scene) {
    const sim::ArrayGeometry array(scene);
    std::string text = "m,n,x_px,y_px\n";
    for (int n = 0; n < scene.camera.extents.n; ++n) {
        for (int m = 0; m < scene.camera.extents.m; ++m) {
            const auto at = array.centre_px(m, n);
            if (array.is_dead(m, n) || at.x < -0.5 || at.y < -0.5 || at.x >= array.width_px() - 0.5 ||
                at.y >= array.height_px() - 0.5)
                continue;
            text += fmt::format("{},{},{:.6f},{:.6f}\n", m, n, at.x, at.y);
        }
    }
    return text;
}

// The sensor's frame behind the lenslet array, not decoded.
std::optional<Error> write_raw(const sim::Scene& scene, const RenderArguments& arguments) {
    std::optional<Progress> progress(std::in_place, "render " + scene.name + " as the sensor sees it");
    const auto raw = lab::render_raw(scene, {arguments.threads, [&](double done) { progress->show(done); }});
    progress.reset();
    if (!raw) return raw.error();
    const Frame frame = sim::expose(raw->light, raw->width_px, raw->height_px, scene, scene.seed);
    const drivers::FrameGeometry geometry{drivers::FrameKind::raw, {}, frame.bits()};
    if (auto done = drivers::write_frame(arguments.raw, frame.view(), geometry); !done) return done.error();
    fmt::print("{}: {}x{} pixels, {} bit, raw, seed {}\n", arguments.raw, frame.width_px(), frame.height_px(),
               frame.bits(), scene.seed);
    return std::nullopt;
}

Exit run_render(const RenderArguments& arguments) {
    const OutputFile out{"--out", arguments.out}, raw{"--raw", arguments.raw};
    if (auto fine = check_outputs({out, raw, {"--truth", arguments.truth}, {"--centres", arguments.centres}},
                                  {arguments.scene});
        !fine)
        return complain(fine.error());
    for (const OutputFile& frame : {out, raw}) {
        if (auto fine = check_extension(frame, {".png"}); !fine) return complain(fine.error());
    }
    auto scene = sim::load_scene(arguments.scene);
    if (!scene) return complain(scene.error());
    if (arguments.seed) scene->seed = *arguments.seed;
    if (arguments.seed && !scene->noise.is_random() && scene->camera.array.dead_share == 0) {
        print_message(
            "hord-lab: --seed changes nothing: {} has no noise; give it electrons_per_dn in [noise] "
            "(docs/scene.md)\n",
            arguments.scene);
    }
    std::optional<Progress> progress(std::in_place, "render " + scene->name);
    auto field = sim::render(*scene, {arguments.threads, [&](double done) { progress->show(done); }});
    progress.reset();
    if (!field) return complain(field.error());
    const Frame frame = sim::expose(*field, *scene, scene->seed);
    const drivers::FrameGeometry geometry{drivers::FrameKind::macro_pixels, scene->camera.extents, frame.bits()};
    if (auto done = drivers::write_frame(arguments.out, frame.view(), geometry); !done) return complain(done.error());
    fmt::print("{}: {}x{} pixels, {} bit, seed {}\n", arguments.out, frame.width_px(), frame.height_px(), frame.bits(),
               scene->seed);
    if (!arguments.raw.empty()) {
        if (const auto error = write_raw(*scene, arguments)) return complain(*error);
    }
    if (!arguments.centres.empty()) {
        if (const auto error = write_text(arguments.centres, centres_of(*scene))) return complain(*error);
    }
    if (!arguments.truth.empty()) {
        if (const auto error = write_text(arguments.truth, to_json(*scene, lab::truth_of(*scene)).dump(1) + '\n'))
            return complain(*error);
    }
    return Exit::good;
}

}  // namespace

void add_render(CLI::App& program, Exit& status) {
    auto* command = program.add_subcommand("render", "Trace a scene into a frame");
    auto arguments = std::make_shared<RenderArguments>();
    command->add_option("SCENE", arguments->scene, "Scene (TOML, docs/scene.md)")->required();
    command->add_option("--out", arguments->out, "Macro-pixel frame to write (PNG, with its geometry in a text chunk)")
        ->required();
    command->add_option("--truth", arguments->truth, "Ground truth to write (JSON)");
    command->add_option("--raw", arguments->raw,
                        "The sensor's frame behind the scene's lenslet array to write, too (PNG)");
    command->add_option("--centres", arguments->centres,
                        "Where the living lenslets' centres are on the sensor (CSV: m,n,x_px,y_px)");
    command->add_option("--seed", arguments->seed, "Seed of the noise, in place of the scene's");
    command->add_option("--threads", arguments->threads, "Threads (0: one a core); the frame does not depend on it")
        ->check(in_range(0, 256));
    command->footer(
        "Example: hord-lab render hal_sim/scenes/bubble.toml --out bubble.png --truth bubble.json --seed 7");
    command->callback([arguments, &status] { status = run_render(*arguments); });
}

}  // namespace hord::lab
