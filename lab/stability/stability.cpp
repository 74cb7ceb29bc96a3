#include "lab/stability/stability.h"

#include <algorithm>
#include <cmath>
#include <utility>

#include <fmt/format.h>

#include "lab/report/template.h"

namespace hord::lab {
namespace {

const char* verdict_of(const StabilityRow& row) { return row.good ? "right" : "WRONG"; }

}  // namespace

void StabilityTable::holds(const std::string& name, const std::string& expected, const std::string& got, bool good) {
    rows_.push_back({group_, name, expected, got, good});
}

void StabilityTable::near(const std::string& name, double expected, double got, double tolerance) {
    holds(name, fmt::format("{:.12g} +- {:.2g}", expected, tolerance), fmt::format("{:.12g}", got),
          std::isfinite(got) && std::abs(got - expected) <= tolerance);
}

void StabilityTable::at_most(const std::string& name, double limit, double got) {
    holds(name, fmt::format("at most {:.3g}", limit), fmt::format("{:.3g}", got), std::isfinite(got) && got <= limit);
}

void StabilityTable::same(const std::string& name, std::int64_t expected, std::int64_t got) {
    holds(name, fmt::format("{}", expected), fmt::format("{}", got), got == expected);
}

std::size_t StabilityTable::wrong() const {
    return static_cast<std::size_t>(std::ranges::count_if(rows_, [](const StabilityRow& row) { return !row.good; }));
}

StabilityTable check_stability(const StabilityOptions& options) {
    StabilityTable table;
    check_hords(options, table);
    options.progress(0.1);
    check_frames(options, table);
    options.progress(0.2);
    check_transport(options, table);
    options.progress(1);
    return table;
}

Table table_of(const StabilityTable& cases) {
    Table table{{"extreme", "case", "expected", "got", "verdict"}, {}};
    for (const StabilityRow& row : cases.rows())
        table.rows.push_back({row.group, row.name, row.expected, row.got, verdict_of(row)});
    return table;
}

Result<ExperimentReport> run_stability(const ExperimentOptions& options) {
    StabilityOptions wanted;
    wanted.seed = options.seed;
    if (options.quick) wanted.degenerate_pairs = 100'000;
    wanted.progress = [&](double done) { options.progress(done, ""); };
    const StabilityTable table = check_stability(wanted);

    ExperimentReport report;
    for (const StabilityRow& row : table.rows()) {
        auto claim = std::ranges::find(report.claims, row.group, &Claim::text);
        if (claim == report.claims.end()) claim = report.claims.insert(claim, {row.group, true, ""});
        if (!row.good && *claim->holds) {
            claim->holds = false;
            claim->evidence = fmt::format("{}: expected {}, got {}", row.name, row.expected, row.got);
        }
    }
    for (Claim& claim : report.claims) {
        if (*claim.holds)
            claim.evidence =
                fmt::format("{} cases, all right", std::ranges::count(table.rows(), claim.text, &StabilityRow::group));
    }
    const auto times = measure_verdict_times(options);
    if (!times) return tl::unexpected(times.error());
    for (const auto& [name, of] : {std::pair{"stability.csv", table_of(table)}, {"times.csv", times->frames}}) {
        if (auto done = write_csv(options.out / name, of); !done) return tl::unexpected(done.error());
        report.files.push_back(options.out / name);
    }
    report.text = fill_report("stability",
                              {{"quick", options.quick ? "yes" : ""},
                               {"lenslets", options.lenslets > 0 ? std::to_string(options.lenslets) : ""},
                               {"frames", options.frames.string()},
                               {"seed", std::to_string(options.seed)},
                               {"claims", describe(report.claims)},
                               {"cases", std::to_string(table.rows().size())},
                               {"wrong", std::to_string(table.wrong())},
                               {"rows", to_markdown(table_of(table))},
                               {"sizes", to_markdown(times->sizes)},
                               {"frames", to_markdown(times->frames)}});
    return report;
}

}  // namespace hord::lab
