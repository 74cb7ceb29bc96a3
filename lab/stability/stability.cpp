#include "lab/stability/stability.h"

#include <algorithm>
#include <cmath>
#include <fstream>
#include <string_view>

#include <fmt/format.h>

namespace hord::lab {
namespace {

std::string csv_cell(std::string_view text) {
    std::string result = "\"";
    for (const char c : text) result += c == '"' ? std::string("\"\"") : std::string(1, c);
    return result + '"';
}

const char* verdict_of(const StabilityRow& row) { return row.good ? "right" : "WRONG"; }

Result<void> write(const std::filesystem::path& file, const std::string& text) {
    std::ofstream stream(file);
    stream << text;
    if (stream.flush()) return {};
    return fail(ErrorCode::io, file.string() + " cannot be written",
                "check that the folder may be written to and has space");
}

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

std::string as_text(const StabilityTable& table) {
    std::string text, group;
    for (const StabilityRow& row : table.rows()) {
        if (row.group != group) text += fmt::format("\n{}\n", group = row.group);
        text +=
            fmt::format("  {:5}  {:<72}  expected {:<34}  got {}\n", verdict_of(row), row.name, row.expected, row.got);
    }
    return text + fmt::format("\n{} cases, {} wrong\n", table.rows().size(), table.wrong());
}

std::string as_csv(const StabilityTable& table) {
    std::string text = "extreme,case,expected,got,verdict\n";
    for (const StabilityRow& row : table.rows()) {
        text += fmt::format("{},{},{},{},{}\n", csv_cell(row.group), csv_cell(row.name), csv_cell(row.expected),
                            csv_cell(row.got), verdict_of(row));
    }
    return text;
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
    report.text = fmt::format("# Stability at the extremes\n\nSeed {}.\n\n```{}```\n\n## Claims\n\n{}\n# Times\n{}",
                              options.seed, as_text(table), describe(report.claims), *times);
    report.files = {options.out / "stability.csv", options.out / "stability.txt"};
    if (auto done = write(report.files[0], as_csv(table)); !done) return tl::unexpected(done.error());
    if (auto done = write(report.files[1], as_text(table)); !done) return tl::unexpected(done.error());
    return report;
}

}  // namespace hord::lab
