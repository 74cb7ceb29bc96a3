#include "firmware/hordctl/run_report.h"

#include <algorithm>
#include <array>

#include <fmt/format.h>

namespace hord::firmware {
namespace {

struct Percentiles {
    double p50 = 0, p99 = 0, max = 0;
    std::size_t count = 0;
};

Percentiles percentiles_ms(std::vector<std::uint32_t> us) {
    if (us.empty()) return {};
    std::sort(us.begin(), us.end());
    const auto at = [&](double share) { return us[static_cast<std::size_t>(share * static_cast<double>(us.size() - 1))] / 1e3; };
    return {at(0.5), at(0.99), us.back() / 1e3, us.size()};
}

std::string line(const char* what, const Percentiles& p) {
    if (p.count == 0) return fmt::format("{:<28} none\n", what);
    return fmt::format("{:<28} p50 {:7.2f}   p99 {:7.2f}   max {:7.2f} ms   ({} parts)\n", what, p.p50, p.p99, p.max, p.count);
}

}  // namespace

void RunReport::add(const PartResult& result, const std::string& kind, bool ejected) {
    results_.push_back(result);
    Row& row = rows_[kind];
    ++row.parts;
    row.pass += result.verdict == PartVerdict::pass ? 1 : 0;
    row.reject += result.verdict == PartVerdict::reject ? 1 : 0;
    row.unfit += result.verdict == PartVerdict::unfit ? 1 : 0;
    row.ejected += ejected ? 1 : 0;
    if (result.reason != PartReason::none) ++reasons_[result.reason];
    if (!kind.empty() && (kind == "good") == ejected) ++wrong_;
}

std::string RunReport::text(hal::Duration elapsed) const {
    std::string out;
    const bool truth_known = std::any_of(rows_.begin(), rows_.end(), [](const auto& row) { return !row.first.empty(); });
    out += truth_known ? fmt::format("{:<12} {:>7} {:>7} {:>7} {:>7} {:>9}\n", "truth", "parts", "pass", "reject", "unfit", "ejected")
                       : fmt::format("{:<12} {:>7} {:>7} {:>7} {:>7}\n", "", "parts", "pass", "reject", "unfit");
    for (const auto& [kind, row] : rows_) {
        out += fmt::format("{:<12} {:>7} {:>7} {:>7} {:>7}", kind.empty() ? "all" : kind, row.parts, row.pass, row.reject, row.unfit);
        out += kind.empty() ? std::string("\n") : fmt::format(" {:>9}\n", row.ejected);
    }
    if (truth_known) out += fmt::format("{} of {} parts left the line by the right way\n", results_.size() - wrong_, results_.size());

    if (!reasons_.empty()) {
        out += "reasons:";
        for (const auto& [reason, count] : reasons_) out += fmt::format(" {} {}", name_of(reason), count);
        out += '\n';
    }
    std::vector<std::uint32_t> verdict_us, reject_us;
    for (const PartResult& result : results_) {
        verdict_us.push_back(result.latency_us);
        if (result.reject == RejectState::confirmed) reject_us.push_back(result.reject_latency_us);
    }
    out += '\n' + line("part sensor to verdict", percentiles_ms(std::move(verdict_us)));
    out += line("part sensor to reject", percentiles_ms(std::move(reject_us)));
    const double seconds = std::chrono::duration<double>(elapsed).count();
    out += fmt::format("{:<28} {:.1f} parts a second over {:.1f} s\n", "throughput", seconds > 0 ? static_cast<double>(results_.size()) / seconds : 0.0, seconds);
    return out;
}

}  // namespace hord::firmware
