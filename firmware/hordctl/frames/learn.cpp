// hordctl learn: a reference from frames of good parts, and what these parts support.
#include <cmath>
#include <filesystem>
#include <memory>
#include <numbers>
#include <optional>

#include <fmt/format.h>

#include "algo/good_parts/distinct_parts.h"
#include "algo/reference/read_noise.h"
#include "algo/reference/reference_learner.h"
#include "algo/reference/registration.h"
#include "common/cli/progress.h"
#include "firmware/diagnostics/learn_report.h"
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
    options.name_of = [files = frames.files](std::size_t part) { return files[part]; };
    auto learned = algo::learn_reference(frames.extents, frames.bits, frames.files.size(), frames, options);
    if (!learned) return complain(learned.error());
    options.progress = [](double) {};
    const std::vector<std::string> unsure = algo::unsure_of(*learned, "give the sensor's with --electrons-per-dn",
                                                            static_cast<double>(recipe->recipe.reject_score));
    const LearnedParts report_of{.file = arguments.out,
                                 .reference = std::make_shared<const algo::Reference>(std::move(learned->reference)),
                                 .recipe = recipe->recipe,
                                 .frames = frames.files,
                                 .left_out = learned->left_out,
                                 .poses = learned->poses,
                                 .frame_of = frames,
                                 .repeated = parts->repeated,
                                 .unsure = unsure,
                                 .learning = options,
                                 .electrons_from = options.electrons_per_dn ? "given" : "estimated",
                                 .read_noise_from = arguments.read_dn ? "given" : "estimated"};
    const algo::Reference& r = *report_of.reference;
    if (auto done = write_reference(arguments.out, r); !done) return complain(done.error());
    std::vector<std::string> told{summary_of(report_of) + "."};
    std::vector<std::filesystem::path> written;
    if (arguments.check) {
        const auto report = check_learned(report_of, static_cast<std::size_t>(arguments.trials),
                                          [&](double done) { progress->show(0.25 + 0.75 * done); });
        if (!report) return complain(report.error());
        auto files = write_learn_report(*report);
        if (!files) return complain(files.error());
        written = std::move(*files);
        for (LearnSentence& sentence : describe(*report)) told.push_back(std::move(sentence.text));
    } else {
        for (const std::string& sentence : report_of.unsure) told.push_back(sentence + ".");
        if (!parts->repeated.empty()) told.push_back(parts->repeated);
        for (const algo::LeftOut& out : learned->left_out)
            told.push_back(fmt::format("Left out: {}: {}.", frames.files[out.part], out.why));
    }
    progress.reset();
    if (first->geometry_from == GeometryFrom::frame)
        fmt::print("{}x{} bins a lenslet, as {} says\n", r.extents.i, r.extents.j, arguments.frames.front());
    for (const std::string& line : told) fmt::print("{}\n", line);
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
    command->footer(fmt::format(
        "Beside REFERENCE.hordref go REFERENCE.learn.md, .csv, .png and .json: poses, what varies between the parts, "
        "the\nbound of false rejects, and the sizes of flaws that will be found. Copies and repeated exposures of a "
        "part count once.\n"
        "A reference finds parts up to {:g} lenslets along each axis and {:.1f} degrees from the pose of those that it "
        "was\nlearned from; up to {:g} lenslets along an axis across which edges of the light show where they lie "
        "(fields of {}\nlenslets or more).\n"
        "Exit status: 0 the reference is written, also where the parts were too few to check it (`not_checked` in the "
        ".json),\n2 it is not, or usage.\n"
        "Example: hordctl learn good/*.png --out lens.hordref\n"
        "         hordctl inspect part.png --reference lens.hordref --out maps",
        algo::kFarthestLenslets, std::asin(algo::kFarthestSine) * 180 / std::numbers::pi, algo::kFarthestByEdges,
        algo::kMinFieldByEdges));
    command->callback([arguments, &status] { status = run_learn(*arguments); });
}

}  // namespace hord::firmware
