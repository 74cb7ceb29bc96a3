// hord-lab design: the cell that finds the wanted defects on a part.
#include "lab/design/design.h"

#include <algorithm>
#include <fstream>
#include <optional>

#include <fmt/format.h>

#include "common/cli/progress.h"
#include "lab/hord_lab/commands.h"

namespace hord::lab {
namespace {

struct DesignArguments {
    std::string part, defects, out, pixels = "25M", form;
    DesignTask task;
    bool quick = false;
};

// "25M", "5M", "400k" or a number.
Result<double> parse_pixels(const std::string& text) {
    std::size_t used = 0;
    double pixels = 0;
    try {
        pixels = std::stod(text, &used);
    } catch (const std::exception&) {
        used = 0;
    }
    const std::string unit = text.substr(used);
    pixels *= unit == "M" ? 1e6 : unit == "k" ? 1e3 : 1;
    if (used > 0 && (unit.empty() || unit == "M" || unit == "k") && pixels >= 1e4 && pixels <= 2e8) return pixels;
    return fail(ErrorCode::invalid_argument, "--pixels " + text + " is not a number of pixels",
                "write 25M, 5M or 400k; 10k to 200M");
}

Exit run_design(DesignArguments& arguments) {
    DesignTask& task = arguments.task;
    auto part = sim::load_scene(arguments.part);
    if (!part) return complain(part.error());
    auto defects = parse_defects(arguments.defects);
    if (!defects) return complain(defects.error());
    const auto pixels = parse_pixels(arguments.pixels);
    if (!pixels) return complain(pixels.error());
    const auto survey = PartSurvey::of(*part);
    if (!survey) return complain(survey.error());
    task.base.symmetric_outline = !std::holds_alternative<sim::SolidPart>(part->part);
    task.part = std::move(*part);
    task.defects = std::move(*defects);
    task.camera.pixels = *pixels;
    task.camera.diffraction =
        std::ranges::find(task.defects, WantedKind::haze, &WantedDefect::kind) == task.defects.end();
    task.base.form = arguments.form == "web" || (arguments.form.empty() && survey->fills_field) ? algo::PartForm::web
        : arguments.form == "plate"                                                             ? algo::PartForm::plate
                                                                                                : algo::PartForm::round;
    if (task.base.form == algo::PartForm::web) task.base.part_required = false;
    if (auto checked = check_task(task, *survey); !checked) return complain(checked.error());
    std::optional<Progress> progress(std::in_place, "design for " + task.part.name);
    DesignOptions options;
    options.quick = arguments.quick;
    options.progress = [&](double done, const std::string& note) { progress->show(done, note); };
    if (arguments.form.empty()) task.base.form = form_of(task, *survey, options);
    if (auto made = make_folder(arguments.out); !made) return complain(made.error());

    const auto design = design_cell(task, options);
    progress.reset();
    if (!design) return complain(design.error());
    auto files = write_design(arguments.out, arguments.part, *design, task, *survey);
    if (!files) return complain(files.error());
    const std::string text = describe(*design, task);
    const auto report = std::filesystem::path(arguments.out) / "design.md";
    std::ofstream stream(report);
    stream << text;
    if (!stream.flush())
        return complain({ErrorCode::io, report.string() + " cannot be written", "check the folder and its space"});
    fmt::print("{}\n{}\n", text, report.string());
    for (const auto& file : *files) fmt::print("{}\n", file.string());
    fmt::print("run it: hordctl run --simulate --config {} --rate {:g} --parts 20\n",
               (std::filesystem::path(arguments.out) / "hordd.toml").string(), task.rate);
    return meets(*design, task) ? Exit::good : Exit::rejected;
}

}  // namespace

void add_design(CLI::App& program, Exit& status) {
    auto* command = program.add_subcommand(
        "design", "Search the camera, light and features that find the wanted defects on a part, by simulation");
    auto arguments = std::make_shared<DesignArguments>();
    DesignTask& task = arguments->task;
    command->add_option("PART", arguments->part, "Scene with the part in a field of its size (TOML, docs/scene.md)")
        ->required();
    command
        ->add_option("--defects", arguments->defects,
                     "Kinds and sizes in mm that must be found: bubble, cut, dimple, speck, inclusion and haze by "
                     "diameter, scratch and stria by width; bubble=0.2,scratch=0.03")
        ->required();
    command->add_option("--out", arguments->out, "Folder for hordd.toml, recipe.toml, scenes and design.md")
        ->required();
    command->add_option("--pixels", arguments->pixels, "Pixels of the camera")->capture_default_str();
    command->add_option("--bits", task.camera.bits, "Bits of a sample")
        ->check(CLI::IsMember({8, 10, 12, 16}))
        ->capture_default_str();
    add_number(*command, "--full-well", task.camera.full_well_e, "Electrons of the full scale", 100.0, 1e7);
    add_number(*command, "--read-noise", task.camera.read_e, "Electrons, rms", 0.0, 1e4);
    add_number(*command, "--pixel-um", task.camera.pixel_um, "Width of a pixel, for lenslets to order", 0.5, 100.0);
    add_number(*command, "--fastest", task.camera.fastest_lenslet, "Smallest f-number of the lenslets", 0.3, 100.0);
    add_number(*command, "--rate", task.rate, fmt::format("Parts a second, at most {:g}", kHighestRate), 0.1, 1000.0);
    add_number(*command, "--inspection-threads", task.inspection_threads, "Cores that inspect parts", 1, 64);
    add_number(*command, "--false-rejects", task.false_rejects, "Share of good parts that may be rejected", 1e-6, 0.1);
    command
        ->add_option("--form", arguments->form,
                     "Form of the part in the recipe; without it, the one in which a good part is judged")
        ->check(CLI::IsMember({"round", "plate", "web"}));
    command->add_flag(
        "--quick", arguments->quick,
        "Fewer cells, trials and parts: a first look. Its time grows with the pixels: half a minute of one core with "
        "--pixels 1M, more than two minutes with 5M");
    command->add_option("--seed", task.seed, "Seed of places and noise")->capture_default_str();
    command
        ->add_option("--threads", task.threads,
                     "Threads (0: one a core); the answer depends on them by its times alone")
        ->check(in_range(0, 256));
    command->footer(
        "Exit status: 0 a cell finds every wanted size at the rate and is not seen to reject too many good parts, 1 "
        "none does, 2 usage, or no cell shows the part.\n"
        "Example: hord-lab design hal_sim/scenes/lens.toml --defects bubble=0.1,scratch=0.02 --pixels 5M --rate 10 "
        "--out lens-cell");
    command->callback([arguments, &status] { status = run_design(*arguments); });
}

}  // namespace hord::lab
