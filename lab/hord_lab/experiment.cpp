// hord-lab experiment: runs an experiment on the simulated cell and writes its report.
#include <memory>

#include <fmt/format.h>

#include "common/cli/message.h"
#include "common/cli/progress.h"
#include "lab/detection/detection.h"
#include "lab/guarantee/guarantee.h"
#include "lab/hord_lab/commands.h"
#include "lab/hord_lab/experiments.h"
#include "lab/reference/reference.h"
#include "lab/stability/stability.h"
#include "lab/tradeoff/tradeoff_whole.h"

namespace hord::lab {
namespace {

struct ExperimentArguments {
    std::string out, frames;
    bool quick = false, finished = false, tuned_limits = false;
    std::uint64_t seed = 1;
    int lenslets = 0, threads = 0;
};

Exit run_experiment(const Experiment& experiment, const ExperimentArguments& arguments) {
    std::error_code error;
    std::filesystem::create_directories(arguments.out, error);
    if (error)
        return complain({ErrorCode::io, arguments.out + " cannot be created (" + error.message() + ")",
                         "give a folder that may be written to"});
    print_message("experiment {}{}, seed {}; takes {}\n", experiment.name, arguments.quick ? " (quick)" : "",
                  arguments.seed, arguments.quick ? "less than a minute" : std::string(experiment.takes));
    auto progress = std::make_unique<Progress>(std::string(experiment.name));
    const auto run = !arguments.finished  ? experiment.run
        : experiment.run == run_guarantee ? report_finished_guarantee
        : experiment.run == run_whole     ? report_finished_whole
                                          : report_finished_detection;
    const auto report = run({arguments.out, arguments.frames, arguments.quick, arguments.seed, arguments.tuned_limits,
                             arguments.lenslets, arguments.threads,
                             [&](double done, const std::string& note) { progress->show(done, note); }});
    progress.reset();
    if (!report) return complain(report.error());
    const auto file = std::filesystem::path(arguments.out) / (std::string(experiment.name) + ".md");
    if (auto done = write_report(file, *report); !done) return complain(done.error());
    fmt::print("{}\n{}\n", report->text, file.string());
    for (const auto& written : report->files) fmt::print("{}\n", written.string());
    return report->as_expected() ? Exit::good : Exit::rejected;
}

}  // namespace

void add_experiment(CLI::App& program, Exit& status) {
    auto* command =
        program.add_subcommand("experiment", "Ask the simulated cell a question; files, a report and checked claims");
    command->require_subcommand(1);
    for (const Experiment& experiment : experiments()) {
        auto* one = command->add_subcommand(std::string(experiment.name), std::string(experiment.what));
        auto arguments = std::make_shared<ExperimentArguments>();
        one->add_option("--out", arguments->out, "Folder for its files; a run that was interrupted there continues")
            ->required();
        one->add_flag(
            "--quick", arguments->quick,
            "A smaller form that takes less than a minute: no comparison with docs/results, because claims may come "
            "out otherwise on so little");
        one->add_option("--seed", arguments->seed,
                        "Seed of everything random; the same seed gives the same files, but for times")
            ->capture_default_str();
        one->add_option("--threads", arguments->threads, "Threads (0: one a core); results do not depend on it")
            ->check(in_range(0, 64));
        if (experiment.run == run_detection || experiment.run == run_guarantee || experiment.run == run_whole)
            one->add_flag("--finished", arguments->finished,
                          "Report what an interrupted run has finished; compute nothing");
        if (experiment.run == run_detection) {
            one->add_flag(
                "--tuned-limits", arguments->tuned_limits,
                "Judge by limits that are tuned on good parts of another stream, not by the default recipe's");
        }
        if (experiment.run == run_stability) {
            one->add_option(
                   "--lenslets", arguments->lenslets,
                   "Lenslets a side of the field whose verdicts are timed, instead of all sizes: 555, for example")
                ->check(in_range(15, 2048));
            one->add_option("--frames", arguments->frames,
                            "Folder of the fuzz corpus (tests/fuzz/corpus): the time of a verdict on its frames, too");
        }
        const bool has_frames = experiment.run == run_reference;
        if (has_frames)
            one->add_option("--frames", arguments->frames,
                            "Folder of light fields without noise: NAME_raw.png and NAME.json")
                ->required();
        one->footer(fmt::format(
            "The full form takes {}.\n"
            "Exit status: 0 every claim was decided and came out as expected of this form, 1 one was not or "
            "did not, 2 usage.\n"
            "Example: hord-lab experiment {}{} --out {} --quick",
            experiment.takes, experiment.name, has_frames ? " --frames poses" : "", experiment.name));
        one->callback([&experiment, arguments, &status] { status = run_experiment(experiment, *arguments); });
    }
}

}  // namespace hord::lab
