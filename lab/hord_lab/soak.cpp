// hord-lab soak: runs many parts in virtual time, with faults, and checks every promise.
#include "lab/soak/soak.h"

#include <algorithm>
#include <chrono>
#include <memory>
#include <optional>
#include <string>

#include <fmt/format.h>

#include "common/cli/message.h"
#include "common/cli/progress.h"
#include "lab/hord_lab/commands.h"
#include "lab/soak/shrink.h"

namespace hord::lab {
namespace {

struct SoakArguments {
    std::uint64_t parts = 100'000, episode_parts = 5'000;
    std::optional<std::uint64_t> seed, episode;
    std::string line = "timed", faults;
    bool coverage = false, shrink = false, real = false, stand_in = false;
    int threads = 1;
    std::string profile = "random";
};

Exit show(const SoakReport& report, const SoakArguments& arguments) {
    fmt::print("{}", describe(report));
    if (arguments.coverage) fmt::print("{}", describe(report.coverage));
    if (arguments.shrink && report.first_broken) {
        const auto shrunk = shrink(*report.first_broken, try_episode);
        if (!shrunk) return complain(shrunk.error());
        fmt::print("smallest episode that still breaks {} ({} tried):\n    {}\n", shrunk->promise, shrunk->runs,
                   command_of(shrunk->plan));
    }
    return report.good() ? Exit::good : Exit::rejected;
}

Exit run_one_episode(const SoakArguments& arguments) {
    EpisodePlan plan{*arguments.episode,
                     arguments.parts,
                     arguments.line == "timed" ? LineProfile::timed : LineProfile::encoder,
                     arguments.real,
                     {}};
    auto faults = faults_of(arguments.faults);
    if (!faults) return complain(faults.error());
    plan.faults = std::move(*faults);
    const auto report = run_episode(plan);
    return report ? show(*report, arguments) : complain(report.error());
}

// 20261123 on 2026-11-23, UTC.
std::uint64_t seed_of_today() {
    const std::chrono::year_month_day today(std::chrono::floor<std::chrono::days>(std::chrono::system_clock::now()));
    return static_cast<std::uint64_t>(static_cast<int>(today.year())) * 10'000 +
        static_cast<unsigned>(today.month()) * 100U + static_cast<unsigned>(today.day());
}

Exit run_soak(const SoakArguments& arguments) {
    if (arguments.episode) return run_one_episode(arguments);
    SoakOptions options;
    options.parts = arguments.parts;
    options.all_pairs = arguments.profile == "nightly";
    options.seed = arguments.seed.value_or(options.all_pairs ? seed_of_today() : 1);
    options.real_parts = !arguments.stand_in;
    options.parts_an_episode = std::min(arguments.episode_parts, arguments.parts);
    options.threads = arguments.threads;
    auto progress = std::make_unique<Progress>("soak");
    options.progress = [&](double done) { progress->show(done); };
    print_message("seed {}, {} parts\n", options.seed, arguments.parts);
    const auto report = soak(options);
    progress.reset();
    if (!report) return complain(report.error());
    return show(*report, arguments);
}

}  // namespace

void add_soak(CLI::App& program, Exit& status) {
    auto* command =
        program.add_subcommand("soak", "Run the station on a simulated line in virtual time, with random faults");
    auto arguments = std::make_shared<SoakArguments>();
    command->add_option("--parts", arguments->parts, "How many parts")->check(positive())->capture_default_str();
    command->add_option(
        "--seed", arguments->seed,
        "Seed of lines and faults; the same seed gives the same run. Without it 1, or in the nightly profile "
        "the date (UTC): 20261123 on 2026-11-23");
    command
        ->add_option("--episode-parts", arguments->episode_parts,
                     "Parts an episode; each draws its own line and faults")
        ->check(positive())
        ->capture_default_str();
    command
        ->add_option("--threads", arguments->threads,
                     "Episodes at the same time; the report is the same for every number")
        ->check(in_range(1, 256))
        ->capture_default_str();
    command->add_option("--episode", arguments->episode,
                        "Run one episode of this seed, as a violation prints it, with --parts, --line and --faults");
    command->add_option("--line", arguments->line, "Of the episode: followed by time or by an encoder")
        ->check(CLI::IsMember({"timed", "encoder"}));
    command->add_flag("--real", arguments->real, "Of the episode: rendered frames and the real pipeline");
    command->add_flag(
        "--stand-in", arguments->stand_in,
        "No episode with rendered frames and the real pipeline: a stand-in judges every part, in a fraction of "
        "the time");
    command->add_option("--faults", arguments->faults,
                        "Of the episode: NAME@FIRST-LAST:PROBABILITY+TIME, several with commas");
    command->add_flag("--coverage", arguments->coverage, "Show which states met which events, and which faults met");
    command
        ->add_option("--profile", arguments->profile,
                     "nightly: first an episode for each pair of faults, and walks through all states with each fault; "
                     "then up to --parts in all")
        ->check(CLI::IsMember({"random", "nightly"}))
        ->capture_default_str();
    command->add_flag("--shrink", arguments->shrink,
                      "When a promise is broken: find the smallest episode that still breaks it");
    command->footer(
        "Exit status: 0 every promise kept, 1 a violation or a planned fault that never fired, 2 usage.\n"
        "Example: hord-lab soak --parts 1000000 --seed 1");
    command->callback([arguments, &status] { status = run_soak(*arguments); });
}

}  // namespace hord::lab
