#include "firmware/experiment/experiment.h"

#include <algorithm>
#include <fstream>

#include <fmt/format.h>

#include "firmware/experiment/ablation.h"
#include "firmware/experiment/detection.h"
#include "firmware/experiment/paper.h"
#include "firmware/experiment/stability.h"
#include "firmware/experiment/tradeoff.h"

namespace hord::firmware {

std::span<const Experiment> experiments() {
    static constexpr Experiment kExperiments[] = {
        {"paper", "The paper's figure: which of its claims hold, and for which light and bubbles",
         "about one minute on two cores", run_paper},
        {"tradeoff", "Speed against accuracy: every feature over light, bins, slopes, strides and frames",
         "about six minutes on two cores", run_tradeoff},
        {"detection",
         "Judging against a reference: false rejects, bubbles, kinds, slopes, contrast and time on simulated "
         "production",
         "about twenty-five minutes on one core (estimated from its parts)", run_detection},
        {"ablation", "What each physical effect does to detection, and what it costs", "about two minutes on two cores",
         run_ablation},
        {"stability", "Do the features keep their promises at the extremes? A table of case, expected, got, verdict",
         "about half a minute", run_stability},
    };
    return kExperiments;
}

bool ExperimentReport::as_expected() const {
    return std::ranges::all_of(claims, [](const Claim& claim) { return claim.as_expected(); });
}

std::string describe(std::span<const Claim> claims) {
    std::string text = "| claim | outcome | evidence |\n|---|---|---|\n";
    for (const Claim& claim : claims) {
        const char* outcome = !claim.holds ? "**undecided**" : *claim.holds ? "holds" : "does not hold";
        text += fmt::format("| {} | {}{} | {} |\n", claim.text, outcome,
                            claim.as_expected() ? "" : " (**not as expected**)", claim.evidence);
    }
    return text;
}

std::string to_markdown(const ExperimentReport& report) {
    const std::string claims = report.claims.empty() ? "" : "## Claims\n\n" + describe(report.claims) + "\n";
    return report.opening.empty() ? report.text + "\n" + claims : report.opening + "\n" + claims + report.text;
}

Result<void> write_report(const std::filesystem::path& file, const ExperimentReport& report) {
    std::ofstream stream(file);
    stream << to_markdown(report);
    if (!stream.flush())
        return fail(ErrorCode::io, file.string() + " cannot be written",
                    "check that the folder may be written to and has space");
    return {};
}

}  // namespace hord::firmware
