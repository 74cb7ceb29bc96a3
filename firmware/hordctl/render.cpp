// hordctl render: a frame of the simulated cell from a scene file, with its ground truth.
#include <fstream>
#include <optional>

#include <fmt/format.h>
#include <nlohmann/json.hpp>

#include "drivers/frame_file.h"
#include "firmware/hordctl/commands.h"
#include "firmware/hordctl/progress.h"
#include "hal_sim/optics/render.h"
#include "hal_sim/optics/scene.h"

namespace hord::firmware {
namespace {

using Json = nlohmann::ordered_json;

struct RenderArguments {
    std::string scene, out, truth;
    std::optional<std::uint64_t> seed;
    int threads = 0;
};

Json to_json(const sim::Scene& scene, const sim::Truth& truth) {
    const algo::Extents& e = scene.camera.extents;
    Json defects = Json::array();
    for (const sim::TruthDefect& d : truth.defects) {
        defects.push_back({{"kind", d.kind}, {"m", d.m}, {"n", d.n}, {"radius_lenslets", d.radius_lenslets}, {"area_lenslets", d.area_lenslets}});
    }
    return {{"scene", scene.name},
            {"seed", scene.seed},
            {"grid", {{"m", e.m}, {"n", e.n}, {"i", e.i}, {"j", e.j}}},
            {"bin_pitch_rad", scene.camera.bin_pitch_rad},
            {"field_mm", scene.camera.field_mm},
            {"bits", scene.camera.bits},
            {"defect_free", truth.defect_free},
            {"defects", defects},
            {"labels_of", "one a lenslet, row by row: 0 free field, 1 part, 2 border, 3 defect, 4 defect inside the border"},
            {"labels", truth.labels}};
}

Exit run_render(const RenderArguments& arguments) {
    auto scene = sim::load_scene(arguments.scene);
    if (!scene) return complain(scene.error());
    if (arguments.seed) scene->seed = *arguments.seed;
    std::optional<Progress> progress(std::in_place, "render " + scene->name);
    auto field = sim::render(*scene, {arguments.threads, [&](double done) { progress->show(done); }});
    progress.reset();
    if (!field) return complain(field.error());
    const algo::Frame frame = sim::expose(*field, *scene, scene->seed);
    if (auto done = drivers::write_frame(arguments.out, frame.view()); !done) return complain(done.error());
    fmt::print("{}: {}x{} pixels, {} bit, seed {}\n", arguments.out, frame.width_px(), frame.height_px(), frame.bits(), scene->seed);
    if (arguments.truth.empty()) return Exit::good;
    std::ofstream stream(arguments.truth);
    stream << to_json(*scene, sim::truth_of(*scene)).dump(1) << '\n';
    if (!stream.flush()) {
        return complain({ErrorCode::io, arguments.truth + " cannot be written", "check that the folder exists, may be written to, and has space"});
    }
    return Exit::good;
}

}  // namespace

void add_render(CLI::App& program, Exit& status) {
    auto* command = program.add_subcommand("render", "Trace a scene into a frame");
    auto arguments = std::make_shared<RenderArguments>();
    command->add_option("SCENE", arguments->scene, "Scene (TOML, docs/scene.md)")->required();
    command->add_option("--out", arguments->out, "Macro-pixel frame to write (PNG)")->required();
    command->add_option("--truth", arguments->truth, "Ground truth to write (JSON)");
    command->add_option("--seed", arguments->seed, "Seed of the noise, in place of the scene's");
    command->add_option("--threads", arguments->threads, "Threads (0: one a core); the frame does not depend on it")->check(CLI::Range(0, 256));
    command->footer("Example: hordctl render hal_sim/scenes/bubble.toml --out bubble.png --truth bubble.json --seed 7");
    command->callback([arguments, &status] { status = run_render(*arguments); });
}

}  // namespace hord::firmware
