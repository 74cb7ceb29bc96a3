#include "lab/experiment/experiment.h"

#include <algorithm>
#include <fstream>

#include <fmt/format.h>

#include "lab/report/tables.h"

namespace hord::lab {

std::string ExperimentOptions::arguments() const {
    return fmt::format(" --seed {}{}{}{}", seed, quick ? " --quick" : "", tuned_limits ? " --tuned-limits" : "",
                       lenslets > 0 ? fmt::format(" --lenslets {}", lenslets) : "");
}

bool ExperimentReport::as_expected() const {
    return std::ranges::all_of(claims, [](const Claim& claim) { return claim.as_expected(); });
}

std::string describe(std::span<const Claim> claims) {
    if (claims.empty()) return {};
    Table table{{"claim", "outcome", "evidence"}, {}};
    for (const Claim& claim : claims) {
        const std::string outcome = !claim.holds ? "**undecided**" : *claim.holds ? "holds" : "does not hold";
        table.rows.push_back(
            {claim.text, outcome + (claim.as_expected() ? "" : " (**not as expected**)"), claim.evidence});
    }
    return to_markdown(table);
}

Result<void> write_report(const std::filesystem::path& file, const ExperimentReport& report) {
    std::ofstream stream(file);
    stream << report.text;
    if (!stream.flush())
        return fail(ErrorCode::io, file.string() + " cannot be written",
                    "check that the folder may be written to and has space");
    return {};
}

}  // namespace hord::lab
