// hordctl soak: many parts in virtual time, with faults, every promise checked.
#include <algorithm>
#include <memory>

#include <fmt/format.h>

#include "firmware/hordctl/commands.h"
#include "firmware/hordctl/progress.h"
#include "firmware/soak/soak.h"

namespace hord::firmware {
namespace {

struct SoakArguments {
    std::uint64_t parts = 100'000, seed = 1, episode_parts = 5'000, first_episode = 0;
};

Exit run_soak(const SoakArguments& arguments) {
    SoakOptions options;
    options.parts = arguments.parts;
    options.seed = arguments.seed;
    options.parts_an_episode = std::min(arguments.episode_parts, arguments.parts);
    options.first_episode = arguments.first_episode;
    auto progress = std::make_unique<Progress>("soak");
    options.progress = [&](double done) { progress->show(done); };
    fmt::print(stderr, "seed {}, {} parts\n", arguments.seed, arguments.parts);
    const auto report = soak(options);
    progress.reset();
    if (!report) return complain(report.error());
    fmt::print("{}", describe(*report));
    return report->good() ? Exit::good : Exit::rejected;
}

}  // namespace

void add_soak(CLI::App& program, Exit& status) {
    auto* command = program.add_subcommand("soak", "Run the station on a simulated line in virtual time, with random faults");
    auto arguments = std::make_shared<SoakArguments>();
    command->add_option("--parts", arguments->parts, "How many parts")->check(CLI::PositiveNumber)->capture_default_str();
    command->add_option("--seed", arguments->seed, "Seed of lines and faults; the same seed gives the same run")->capture_default_str();
    command->add_option("--episode-parts", arguments->episode_parts, "Parts an episode; each draws its own line and faults")
        ->check(CLI::PositiveNumber)
        ->capture_default_str();
    command->add_option("--first-episode", arguments->first_episode, "Start with this episode (to run a failing one again)")->capture_default_str();
    command->footer("Exit status: 0 every promise kept, 1 a violation or a planned fault that never fired, 2 usage.\n"
                    "Example: hordctl soak --parts 1000000 --seed 1");
    command->callback([arguments, &status] { status = run_soak(*arguments); });
}

}  // namespace hord::firmware
