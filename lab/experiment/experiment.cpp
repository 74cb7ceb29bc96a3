#include "lab/experiment/experiment.h"

#include <algorithm>
#include <fstream>

#include <fmt/format.h>

namespace hord::lab {

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

}  // namespace hord::lab
