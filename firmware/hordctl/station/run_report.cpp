#include "firmware/hordctl/station/run_report.h"

#include <algorithm>

#include <fmt/format.h>

namespace hord::firmware {
namespace {

std::string line(const char* what, const LatencyCounts& counts) {
    if (counts.count() == 0) return fmt::format("{:<28} none\n", what);
    return fmt::format("{:<28} p50 {:7.2f}   p99 {:7.2f}   p99.9 {:7.2f}   max {:7.2f} ms   ({} parts)\n", what,
                       counts.percentile_ms(0.5), counts.percentile_ms(0.99), counts.percentile_ms(0.999),
                       counts.max_ms(), counts.count());
}

}  // namespace

void RunReport::add(const PartResult& result, const Backends::Fate& fate) {
    verdicts_.add(result.latency_us);
    if (result.reject == RejectState::confirmed) rejects_.add(result.reject_latency_us);
    Row& row = rows_[fate.kind];
    ++row.parts;
    row.pass += result.verdict == PartVerdict::pass ? 1 : 0;
    row.reject += result.verdict == PartVerdict::reject ? 1 : 0;
    row.unfit += result.verdict == PartVerdict::unfit ? 1 : 0;
    row.ejected += fate.ejected.value_or(false) ? 1 : 0;
    ways_known_ = ways_known_ && (fate.ejected.has_value() || fate.on_line);
    if (result.reason != PartReason::none) ++reasons_[result.reason];
    taken_off_ += fate.taken_off ? 1U : 0U;
    on_line_ += fate.on_line ? 1U : 0U;
    if (!fate.kind.empty() && !fate.taken_off && fate.ejected == (fate.kind == "good")) ++wrong_;
}

std::string RunReport::text(hal::Duration elapsed) const {
    std::string out;
    const bool truth_known =
        std::any_of(rows_.begin(), rows_.end(), [](const auto& row) { return !row.first.empty(); });
    out += truth_known
        ? fmt::format("{:<12} {:>7} {:>7} {:>7} {:>7} {:>9}\n", "truth", "parts", "pass", "reject", "unfit", "ejected")
        : fmt::format("{:<12} {:>7} {:>7} {:>7} {:>7}\n", "", "parts", "pass", "reject", "unfit");
    for (const auto& [kind, row] : rows_) {
        out += fmt::format("{:<12} {:>7} {:>7} {:>7} {:>7}", kind.empty() ? (truth_known ? "not known" : "all") : kind,
                           row.parts, row.pass, row.reject, row.unfit);
        if (!kind.empty()) out += fmt::format(" {:>9}", ways_known_ ? std::to_string(row.ejected) : "-");
        out += '\n';
    }
    if (truth_known && ways_known_)
        out += fmt::format("{} of {} parts left the line by the right way\n", parts() - taken_off_ - on_line_ - wrong_,
                           parts());
    if (on_line_ > 0) out += fmt::format("{} were on the line when the station ended\n", on_line_);
    if (taken_off_ > 0) out += fmt::format("{} were taken off the stopped line by hand\n", taken_off_);

    if (!reasons_.empty()) {
        out += "reasons:";
        for (const auto& [reason, count] : reasons_) out += fmt::format(" {} {}", name_of(reason), count);
        out += '\n';
    }
    out += '\n' + line("part sensor to verdict", verdicts_);
    out += line("part sensor to reject", rejects_);
    const double seconds = std::chrono::duration<double>(elapsed).count();
    out += fmt::format("{:<28} {:.1f} parts a second over {:.1f} s\n", "throughput",
                       seconds > 0 ? static_cast<double>(parts()) / seconds : 0.0, seconds);
    return out;
}

}  // namespace hord::firmware
