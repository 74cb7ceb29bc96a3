// hordctl learn: a reference from frames of good parts.
#include <memory>
#include <optional>

#include <fmt/format.h>

#include "algo/reference/read_noise.h"
#include "algo/reference/reference_learner.h"
#include "common/cli/progress.h"
#include "firmware/hordctl/commands.h"
#include "firmware/hordctl/frames/frame_reader.h"
#include "firmware/recipes/recipe_file.h"
#include "firmware/recipes/reference_file.h"

namespace hord::firmware {
namespace {

struct LearnArguments {
    std::vector<std::string> frames;
    FrameOptions reading;
    std::string out, recipe;
    algo::LearnOptions learning;
    std::optional<float> read_dn;
};

Exit run_learn(const LearnArguments& arguments) {
    const auto reader = FrameReader::create(arguments.reading);
    if (!reader) return complain(reader.error());
    const auto recipe = recipe_or_default(arguments.recipe);
    if (!recipe) return complain(recipe.error());
    const auto first = reader->read(arguments.frames.front());
    if (!first) return complain(first.error());
    const algo::Extents& extents = first->extents;
    const int bits = first->frame.bits();

    auto progress = std::make_unique<Progress>("learn");
    algo::LearnOptions options = arguments.learning;
    options.levels = algo::light_levels(recipe->recipe, bits);
    options.max_dark_rise_dn = recipe->recipe.max_dark_rise_dn;
    options.dark_from_noise = recipe->recipe.dark_dn == 0;
    options.progress = [&](double done) { progress->show(done); };
    const auto frame_of = [&](std::size_t part) -> Result<Frame> {
        const std::string& file = arguments.frames[part];
        auto read = reader->read(file);
        if (!read) return tl::unexpected(read.error());
        if (!(read->extents == extents) || read->frame.bits() != bits) {
            return fail(ErrorCode::invalid_argument,
                        file + " is not of the size and depth of " + arguments.frames.front(),
                        "give frames of one camera");
        }
        return std::move(read->frame);
    };
    const auto read_dn = arguments.read_dn
        ? Result<float>(*arguments.read_dn)
        : algo::read_noise_of(extents, options.levels, arguments.frames.size(), frame_of);
    if (!read_dn) return complain(read_dn.error());
    options.read_dn = *read_dn;
    const auto learned = algo::learn_reference(extents, bits, arguments.frames.size(), frame_of, options);
    progress.reset();
    if (!learned) return complain(learned.error());
    if (auto done = write_reference(arguments.out, learned->reference); !done) return complain(done.error());
    for (const algo::LeftOut& out : learned->left_out)
        fmt::print("left out: {}: {}\n", arguments.frames[out.part], out.why);
    const algo::Reference& r = learned->reference;
    if (first->geometry_from == GeometryFrom::frame)
        fmt::print("{}x{} bins a lenslet, as {} says\n", r.extents.i, r.extents.j, arguments.frames.front());
    fmt::print("{}: {}x{} lenslets of {}x{} bins, {} of {} parts, {} {:.3g} electrons a DN, {} read noise {:.2g} DN\n",
               arguments.out, r.extents.m, r.extents.n, r.extents.i, r.extents.j, r.parts, arguments.frames.size(),
               options.electrons_per_dn ? "given" : "estimated", r.sensor.electrons_per_dn,
               arguments.read_dn ? "given" : "estimated", r.sensor.read_dn);
    return Exit::good;
}

}  // namespace

void add_learn(CLI::App& program, Exit& status) {
    auto* command = program.add_subcommand("learn", "Learn what good parts look like: a reference to inspect against");
    auto arguments = std::make_shared<LearnArguments>();
    command
        ->add_option("FRAMES", arguments->frames,
                     "Frames of at least 8 good parts; those that differ from all others are named and left out")
        ->required();
    command->add_option("--out", arguments->out, "File for the reference")->required();
    add_frame_options(*command, arguments->reading);
    command->add_option("--recipe", arguments->recipe,
                        "Recipe whose light levels are used (TOML); without it the default recipe");
    command
        ->add_option("--electrons-per-dn", arguments->learning.electrons_per_dn,
                     "Of the sensor; without it they are estimated from the frames")
        ->check(CLI::Range(1e-3, 1e5));
    command
        ->add_option("--read-dn", arguments->read_dn,
                     "Read noise of the sensor, DN; without it it is estimated from the bins that no light reaches")
        ->check(CLI::Range(0.0, 1e4));
    add_number(*command, "--pedestal-dn", arguments->learning.pedestal_dn, "What the camera adds to every sample, DN",
               0.0, 65535.0);
    add_number(*command, "--threads", arguments->learning.threads, "Threads", 1, 64);
    command->footer(
        "Example: hordctl learn good/*.png --out lens.hordref\n"
        "         hordctl inspect part.png --reference lens.hordref --out maps");
    command->callback([arguments, &status] { status = run_learn(*arguments); });
}

}  // namespace hord::firmware
