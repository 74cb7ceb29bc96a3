// hordctl tune: chooses the features that separate a user's good parts from bad ones, and writes the recipe.
#include "lab/tune/tune.h"

#include <ctime>
#include <memory>
#include <set>

#include <fmt/chrono.h>
#include <fmt/format.h>
#include <fmt/ranges.h>

#include "common/cli/message.h"
#include "common/cli/progress.h"
#include "drivers/files/frame_file.h"
#include "firmware/hordctl/commands.h"
#include "firmware/hordctl/frames/frame_reader.h"
#include "firmware/recipes/reference_file.h"
#include "firmware/store/results/json_text.h"
#include "lab/tune/tune_report.h"

namespace hord::firmware {

using namespace lab;
namespace {

namespace fs = std::filesystem;

struct TuneArguments {
    std::vector<std::string> good, bad;
    TuneOptions tuning;
    double false_rejects_percent = 0.1;
    FrameOptions reading;
    std::string out, recipe, reference;
    bool json = false, force = false;
};

Result<std::vector<std::string>> files_of(const std::vector<std::string>& names) {
    auto files = drivers::list_frames(std::vector<fs::path>(names.begin(), names.end()));
    if (!files) return tl::unexpected(files.error());
    return std::vector<std::string>(files->begin(), files->end());
}

// Checks that the output can be written before anything is measured.
Result<void> check_out(const TuneArguments& arguments) {
    if (arguments.out.empty()) return {};
    const fs::path out = arguments.out;
    if (out.extension() != ".toml")
        return fail(ErrorCode::invalid_argument, "--out " + arguments.out + " is not named as recipes are",
                    "call it " + out.stem().string() + ".toml");
    std::error_code error;
    const fs::path folder = out.has_parent_path() ? out.parent_path() : fs::path(".");
    if (!fs::is_directory(folder, error))
        return fail(ErrorCode::not_found, folder.string() + " is no folder", "make it, or give another --out");
    if (!arguments.force && fs::exists(out, error))
        return fail(ErrorCode::refused, arguments.out + " is there already: it is not overwritten",
                    "give another --out, or --force");
    return {};
}

Result<void> check_apart(const std::vector<std::string>& good, const std::vector<std::string>& bad) {
    std::set<fs::path> known;
    std::error_code error;
    for (const std::string& file : good) known.insert(fs::weakly_canonical(file, error));
    for (const std::string& file : bad) {
        if (known.contains(fs::weakly_canonical(file, error)))
            return fail(ErrorCode::invalid_argument, file + " is among the good frames, too",
                        "say of each part what it is");
    }
    return {};
}

Result<NumberedRecipe> base_of(const TuneArguments& arguments) {
    auto base = recipe_or_default(arguments.recipe);
    if (!base) return base;
    if (base->recipe.name == algo::Recipe{}.name) base->recipe.name = "tuned";
    if (!arguments.recipe.empty()) ++base->version;
    if (!arguments.reference.empty()) {
        auto learned = read_reference(arguments.reference);
        if (!learned) return tl::unexpected(learned.error());
        base->recipe.reference = std::move(*learned);
        base->reference_file = fs::absolute(arguments.reference);
    }
    return base;
}

TuneOptions options_of(const TuneArguments& arguments, NumberedRecipe base, const FrameReader& reader,
                       const std::string& first_file, std::pair<int, int> bins) {
    TuneOptions options = arguments.tuning;
    options.false_rejects = arguments.false_rejects_percent / 100;
    options.base = std::move(base);
    options.bins = bins;
    options.read = [&reader, first_file, bins](const std::string& file) -> Result<Frame> {
        auto read = reader.read(file);
        if (!read) return tl::unexpected(read.error());
        if (std::pair(read->extents.i, read->extents.j) != bins) {
            return fail(ErrorCode::invalid_argument,
                        fmt::format("{} has {}x{} bins a lenslet, and {} {}x{}", file, read->extents.i, read->extents.j,
                                    first_file, bins.first, bins.second),
                        "give frames of one camera");
        }
        return std::move(read->frame);
    };
    return options;
}

// The recipe and its report: the files written.
Result<std::vector<fs::path>> write_choice(Tuned& tuned, const TuneArguments& arguments) {
    if (!tuned.chosen || arguments.out.empty()) return std::vector<fs::path>{};
    const std::string made =
        fmt::format("Made by hordctl tune on {:%Y-%m-%d}, good frames from {}, bad ones from {}.",
                    fmt::gmtime(std::time(nullptr)), fmt::join(arguments.good, " "), fmt::join(arguments.bad, " "));
    return write_report(tuned, arguments.out, made);
}

// Why no set is chosen.
Error why_none(const Tuned& tuned, double budget_ms) {
    if (tuned.best) {
        return {ErrorCode::refused,
                fmt::format("no feature set tells these frames apart: the best has an AUC of {:.2f}, and guessing 0.5",
                            tuned.feature_sets[*tuned.best].auc.value),
                "see that --good and --bad are not exchanged, and that the flaws are in the field"};
    }
    const auto fastest = std::ranges::min_element(
        tuned.feature_sets, {}, [](const MeasuredFeatureSet& m) { return m.no_limit.empty() ? m.wall_ms : 1e300; });
    if (!fastest->no_limit.empty())
        return {ErrorCode::refused, "no feature has a limit that lets these good parts pass: " + fastest->no_limit,
                "see that the frames are of good parts"};
    return {ErrorCode::refused,
            fmt::format("no feature set fits {:g} ms: the fastest, {}, takes {:.3g} ms", budget_ms, fastest->set.name(),
                        fastest->wall_ms),
            "allow more (--budget), use more threads (--threads), or a smaller part of the field"};
}

Exit run_tune(const TuneArguments& arguments) {
    if (auto fine = check_out(arguments); !fine) return complain(fine.error());
    const auto good = files_of(arguments.good), bad = files_of(arguments.bad);
    if (!good) return complain(good.error());
    if (!bad) return complain(bad.error());
    if (auto fine = check_apart(*good, *bad); !fine) return complain(fine.error());
    const auto reader = FrameReader::create(arguments.reading);
    if (!reader) return complain(reader.error());
    const auto first = reader->read(good->front());
    if (!first) return complain(first.error());
    auto base = base_of(arguments);
    if (!base) return complain(base.error());

    auto progress = std::make_unique<Progress>("tune", arguments.json);
    TuneOptions options =
        options_of(arguments, std::move(*base), *reader, good->front(), {first->extents.i, first->extents.j});
    options.progress = [&](double done, const std::string& note) { progress->show(done, note); };
    auto tuned = tune(*good, *bad, options);
    progress.reset();
    if (!tuned) return complain(tuned.error());

    if (!arguments.json) {
        if (first->geometry_from == GeometryFrom::frame)
            fmt::print("{}x{} bins a lenslet, as {} says\n", options.bins.first, options.bins.second, good->front());
        for (const LeftOut& out : tuned->left_out) fmt::print("left out: {}: {}\n", out.file, out.why);
        fmt::print("{}\n{}", to_text(table_of(*tuned)), describe(*tuned));
    }
    if (tuned->chosen && !options.base.recipe.tolerances.empty() &&
        !tuned->feature_sets[*tuned->chosen].set.reference) {
        print_message(
            "hordctl: the tolerances of {} need a reference, which this feature set does without: they are left out\n",
            arguments.recipe);
    }
    const auto written = write_choice(*tuned, arguments);
    if (!written) return complain(written.error());
    store::Json json = to_json(*tuned);
    for (const fs::path& file : *written) {
        if (arguments.json) json["written"].push_back(file.string());
        else fmt::print("{}\n", file.string());
    }
    if (arguments.json) fmt::print("{}\n", store::to_text(json));
    return tuned->chosen ? Exit::good : complain(why_none(*tuned, options.budget_ms));
}

}  // namespace

void add_tune(CLI::App& program, Exit& status) {
    auto* command = program.add_subcommand(
        "tune", "Choose the features that judge your parts, from frames of good and bad ones, and write the recipe");
    auto arguments = std::make_shared<TuneArguments>();
    command
        ->add_option("--good", arguments->good,
                     fmt::format("Folder (or files) with frames of at least {} good parts, a frame a part", kMinGood))
        ->required();
    command
        ->add_option("--bad", arguments->bad,
                     fmt::format("The same of at least {} bad parts, such as must be found", kMinBad))
        ->required();
    command
        ->add_option(
            "--budget", arguments->tuning.budget_ms,
            "Longest time that judging a frame may take on this machine, ms; decoding by --grid is not counted")
        ->required()
        ->check(positive());
    command->add_option(
        "--out", arguments->out,
        "Recipe to write (RECIPE.toml); beside it go RECIPE.tune.md, .csv, .png, .svg and .gp with what it rests on");
    command->add_flag("--force", arguments->force, "Overwrite --out");
    command->add_option("--recipe", arguments->recipe,
                        "Recipe to start from: its light levels, zones, rim, smallest area, reference and tolerances "
                        "stay; without it the default recipe");
    command->add_option(
        "--reference", arguments->reference,
        "What hordctl learn has learned from other good parts: feature sets that use it are measured, too");
    add_number(*command, "--false-rejects", arguments->false_rejects_percent,
               "Share of good parts that each limit may reject, by a fit to the good frames, %", 1e-4, 50.0);
    add_frame_options(*command, arguments->reading);
    add_number(*command, "--threads", arguments->tuning.threads, "Threads that judge a frame", 1, 64);
    command->add_flag("--json", arguments->json, "Print one JSON object");
    command->footer(
        "Chosen is the fastest feature set whose area under the ROC curve is within 0.005 of the best "
        "that fits the budget;\n"
        "of those within 5 % of its time, the one with the fewest features. Times are of this machine as it is now: "
        "see that it is quiet.\n"
        "Exit status: 0 a feature set was chosen, 2 usage, unreadable or too few frames, no feature set fits, or --out "
        "exists.\n"
        "Example: hordctl tune --good good --bad bad --budget 40 --out lens.toml\n"
        "         hordctl tune --good new_good --bad bad --budget 200 --reference lens.hordref --out lens.toml");
    command->callback([arguments, &status] { status = run_tune(*arguments); });
}

}  // namespace hord::firmware
