// hordctl learn: a reference from frames of good parts, and what these parts support.
#include <filesystem>
#include <memory>
#include <numeric>
#include <optional>

#include <fmt/format.h>

#include "algo/good_parts/distinct_parts.h"
#include "algo/good_parts/reference_check.h"
#include "algo/good_parts/variation.h"
#include "algo/reference/read_noise.h"
#include "algo/reference/reference_learner.h"
#include "common/cli/progress.h"
#include "firmware/hordctl/commands.h"
#include "firmware/hordctl/frames/frame_reader.h"
#include "firmware/hordctl/frames/learn_report.h"
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
    int trials = static_cast<int>(algo::CheckOptions{}.trials);
    bool check = true;
};

// The frames of one command: sizes and depths are compared with the first one's.
struct GoodFrames {
    const FrameReader& reader;
    std::vector<std::string> files;
    algo::Extents extents;
    int bits;

    [[nodiscard]] Result<Frame> operator()(std::size_t part) const {
        const std::string& file = files[part];
        auto read = reader.read(file);
        if (!read) return tl::unexpected(read.error());
        if (!(read->extents == extents) || read->frame.bits() != bits) {
            return fail(ErrorCode::invalid_argument, file + " is not of the size and depth of " + files.front(),
                        "give frames of one camera");
        }
        return std::move(read->frame);
    }
};

Result<algo::Variation> variation_of(const GoodFrames& frames, const algo::Learned& learned) {
    algo::VariationMeter meter(learned.reference);
    for (std::size_t k = 0, added = 0; k < frames.files.size() && added < algo::VariationMeter::kMaxParts; ++k) {
        if (!learned.poses[k]) continue;
        const auto frame = frames(k);
        if (!frame) return tl::unexpected(frame.error());
        meter.add(frame->view(), *learned.poses[k]);
        ++added;
    }
    constexpr std::size_t kModes = 3;
    return meter.finish(kModes);
}

Exit run_learn(const LearnArguments& arguments) {
    std::vector<std::string> inputs = arguments.frames;
    inputs.insert(inputs.end(), {arguments.recipe, arguments.reading.grid});
    if (auto fine = check_outputs({{"--out", arguments.out}}, inputs); !fine) return complain(fine.error());
    const auto reader = FrameReader::create(arguments.reading);
    if (!reader) return complain(reader.error());
    const auto recipe = recipe_or_default(arguments.recipe);
    if (!recipe) return complain(recipe.error());
    const auto first = reader->read(arguments.frames.front());
    if (!first) return complain(first.error());
    GoodFrames frames{*reader, arguments.frames, first->extents, first->frame.bits()};

    auto progress = std::make_unique<Progress>("learn");
    algo::LearnOptions options = arguments.learning;
    options.levels = algo::light_levels(recipe->recipe, frames.bits);
    options.max_dark_rise_dn = recipe->recipe.max_dark_rise_dn;
    options.dark_from_noise = recipe->recipe.dark_dn == 0;
    const double learning_share = arguments.check ? 0.25 : 1;
    options.progress = [&](double done) { progress->show(learning_share * done); };
    const auto read_dn = arguments.read_dn
        ? Result<float>(*arguments.read_dn)
        : algo::read_noise_of(frames.extents, options.levels, frames.files.size(), frames);
    if (!read_dn) return complain(read_dn.error());
    options.read_dn = *read_dn;
    const auto parts = algo::parts_to_learn(frames.extents, frames.files.size(), frames, options);
    if (!parts) return complain(parts.error());
    std::vector<std::string> one_a_part;
    for (const std::size_t k : parts->frames) one_a_part.push_back(frames.files[k]);
    frames.files = std::move(one_a_part);
    const auto learned = algo::learn_reference(frames.extents, frames.bits, frames.files.size(), frames, options);
    if (!learned) return complain(learned.error());
    if (auto done = write_reference(arguments.out, learned->reference); !done) return complain(done.error());

    const algo::Reference& r = learned->reference;
    LearnReport report{
        .frames = frames.files,
        .learned = *learned,
        .recipe = recipe->recipe,
        .summary = fmt::format("{}: {}x{} lenslets of {}x{} bins, {} of {} parts, {} {:.3g} electrons a DN, "
                               "{} read noise {:.2g} DN",
                               arguments.out, r.extents.m, r.extents.n, r.extents.i, r.extents.j, r.parts,
                               frames.files.size(), options.electrons_per_dn ? "given" : "estimated",
                               r.sensor.electrons_per_dn, arguments.read_dn ? "given" : "estimated", r.sensor.read_dn),
        .distinct = parts->repeated,
        .check = {},
        .variation = {}};
    for (const std::string& unsure : algo::unsure_of(*learned, "give the sensor's with --electrons-per-dn"))
        report.summary += ". " + unsure;
    std::vector<std::filesystem::path> written;
    if (arguments.check) {
        algo::CheckOptions checking;
        checking.learning = options;
        checking.learning.electrons_per_dn = r.sensor.electrons_per_dn;
        checking.learning.progress = [](double) {};
        checking.recipe = recipe->recipe;
        checking.trials = static_cast<std::size_t>(arguments.trials);
        checking.progress = [&](double done) { progress->show(0.25 + 0.75 * done); };
        std::vector<std::size_t> part_of(frames.files.size());
        std::iota(part_of.begin(), part_of.end(), std::size_t{0});
        std::vector<bool> used(frames.files.size(), true);
        for (const algo::LeftOut& out : learned->left_out) used[out.part] = false;
        auto check =
            algo::check_reference(frames.extents, frames.bits, frames.files.size(), frames, part_of, used, checking);
        if (check) report.check = std::move(*check);
        else report.check.not_checked = check.error().what;
        auto variation = variation_of(frames, *learned);
        if (!variation) return complain(variation.error());
        report.variation = std::move(*variation);
        auto files = write_learn_report(report, arguments.out);
        if (!files) return complain(files.error());
        written = std::move(*files);
    }
    progress.reset();
    if (first->geometry_from == GeometryFrom::frame)
        fmt::print("{}x{} bins a lenslet, as {} says\n", r.extents.i, r.extents.j, arguments.frames.front());
    if (arguments.check) {
        for (const std::string& line : describe(report)) fmt::print("{}\n", line);
    } else {
        fmt::print("{}\n", report.summary);
        if (!parts->repeated.empty()) fmt::print("{}\n", parts->repeated);
        for (const algo::LeftOut& out : learned->left_out)
            fmt::print("Left out: {}: {}.\n", frames.files[out.part], out.why);
    }
    for (const std::filesystem::path& file : written) fmt::print("{}\n", file.string());
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
        ->check(in_range(1e-3, 1e5));
    command
        ->add_option("--read-dn", arguments->read_dn,
                     "Read noise of the sensor, DN; without it it is estimated from the bins that no light reaches")
        ->check(in_range(0.0, 1e4));
    add_number(*command, "--pedestal-dn", arguments->learning.pedestal_dn, "What the camera adds to every sample, DN",
               0.0, 65535.0);
    add_number(*command, "--threads", arguments->learning.threads, "Threads", 1, 64);
    command->add_flag("!--no-check", arguments->check,
                      "Learn only: do not judge parts by what is learned from the others, write no report");
    add_number(*command, "--flaws", arguments->trials, "Painted flaws of each kind that the check tries", 0, 100000);
    command->footer(
        "Beside REFERENCE.hordref go REFERENCE.learn.md, .csv and .png: poses, what varies between the parts, the "
        "bound "
        "of false\n"
        "rejects, and the sizes of flaws that will be found. Copies and repeated exposures of a part count once.\n"
        "Example: hordctl learn good/*.png --out lens.hordref\n"
        "         hordctl inspect part.png --reference lens.hordref --out maps");
    command->callback([arguments, &status] { status = run_learn(*arguments); });
}

}  // namespace hord::firmware
