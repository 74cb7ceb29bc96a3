#include "firmware/soak/soak.h"

#include <algorithm>
#include <cstdio>
#include <utility>

#include "hal_sim/cell/random.h"

namespace hord::firmware {
namespace {

using sim::Fault;

constexpr std::uint64_t kEpisodeStream = 0xE915;
constexpr std::uint64_t kPairStream = 0x9A12;
constexpr std::uint64_t kPairParts = 400;

void add_episode(SoakReport& report, SimulatedLine& line, bool over, const std::string& label) {
    const Invariants& seen = line.invariants();
    const auto violation = [&](const std::string& text) {
        if (report.violations++ == 0) report.parts_to_violation = report.parts + line.cell().world().totals().arrived;
        if (report.first_violations.size() < 20) report.first_violations.push_back(text + "\n    " + label);
    };
    report.results += seen.results();
    if (report.violations == 0 && seen.violations() > 0) report.parts_to_violation = report.parts + seen.parts_to_violation();
    report.violations += seen.violations();
    for (const std::string& text : seen.first_violations()) {
        if (report.first_violations.size() < 20) report.first_violations.push_back(text + "\n    " + label);
    }
    if (!over) violation("did not end");
    const Snapshot last = line.snapshot();
    if (last.state != State::continuous_execution || last.line_stop) violation("ended in " + std::string(name_of(last.state)));
    report.line_stops += line.line_stops();
    report.resets += line.resets();
    report.excused += seen.excused();
    report.virtual_s += static_cast<std::uint64_t>(std::chrono::duration_cast<std::chrono::seconds>(line.loop().now().time_since_epoch()).count());
    for (std::size_t k = 0; k < report.reasons.size(); ++k) report.reasons[k] += seen.of(static_cast<PartReason>(k));
    report.coverage.merge(line.coverage());
    report.undisturbed += seen.undisturbed();
    report.processes += line.processes();
    const sim::FaultPlan& faults = line.cell().faults();
    for (std::size_t a = 0; a < sim::kFaults; ++a) {
        const auto fired = faults.fired(static_cast<Fault>(a));
        report.planned[a] += faults.names(static_cast<Fault>(a)) ? 1U : 0U;
        report.fired[a] += fired;
        for (std::size_t b = 0; fired > 0 && b < a; ++b) {
            if (faults.fired(static_cast<Fault>(b)) > 0) report.coverage.fired_together(static_cast<Fault>(a), static_cast<Fault>(b));
        }
    }
    for (const Fault fault : faults.never_fired()) report.never_fired.push_back(label + ": " + std::string(sim::name_of(fault)));
    report.fingerprint = sim::mix64(report.fingerprint ^ seen.fingerprint());
}

}  // namespace

LineOptions line_of(const EpisodePlan& plan) {
    LineOptions line = plan.line == LineProfile::timed ? timed_line(plan.seed, plan.parts) : encoder_line(plan.seed, plan.parts);
    line.cell.faults = plan.faults;
    line.core.plc_policy = static_cast<PlcPolicy>(sim::random_bits(plan.seed, kEpisodeStream, 0) % 3);
    return line;
}

std::string command_of(const EpisodePlan& plan) {
    return "hordctl soak --episode " + std::to_string(plan.seed) + " --parts " + std::to_string(plan.parts) + " --line " +
           std::string(name_of(plan.line)) + (plan.faults.empty() ? "" : " --faults " + text_of(plan.faults));
}

Result<void> run_episode(const EpisodePlan& plan, SoakReport& report) {
    auto made = SimulatedLine::make(line_of(plan));
    if (!made) return tl::unexpected(made.error());
    const bool over = (*made)->run();
    add_episode(report, **made, over, command_of(plan));
    if (report.violations > 0 && !report.first_broken) report.first_broken = plan;
    ++report.episodes;
    report.parts += plan.parts;
    return {};
}

Result<SoakReport> soak(const SoakOptions& options) {
    if (options.parts == 0 || options.parts_an_episode < 200) {
        return fail(ErrorCode::invalid_argument, "a soak of " + std::to_string(options.parts) + " parts, " +
                    std::to_string(options.parts_an_episode) + " an episode", "use at least 1 part, and 200 an episode");
    }
    SoakReport report;
    const auto ends = [&] { return options.until_violation && report.violations > 0; };
    if (options.all_pairs) {
        for (std::size_t a = 0; a < sim::kFaults && !ends(); ++a) {
            for (std::size_t b = 0; b < a; ++b) {
                const std::vector<Fault> pair{static_cast<Fault>(a), static_cast<Fault>(b)};
                const std::uint64_t seed = sim::random_bits(options.seed, kPairStream, a * sim::kFaults + b);
                if (auto done = run_episode(draw_plan(seed, kPairParts, pair), report); !done) return tl::unexpected(done.error());
            }
            if (options.progress) options.progress(static_cast<double>(a) / sim::kFaults);
        }
    }
    for (std::uint64_t episode = 0; report.parts < options.parts && !ends(); ++episode) {
        const std::uint64_t seed = sim::random_bits(options.seed, kEpisodeStream, episode);
        if (auto done = run_episode(draw_plan(seed, options.parts_an_episode), report); !done) return tl::unexpected(done.error());
        if (options.progress) options.progress(std::min(1.0, static_cast<double>(report.parts) / static_cast<double>(options.parts)));
    }
    return report;
}

std::string describe(const SoakReport& r) {
    const auto hex = [](std::uint64_t value) {
        std::array<char, 17> digits{};
        std::snprintf(digits.data(), digits.size(), "%016llx", static_cast<unsigned long long>(value));
        return std::string(digits.data());
    };
    const auto line = [](const std::string& name, std::uint64_t value) { return name + std::string(28 - std::min<std::size_t>(27, name.size()), ' ') + std::to_string(value) + "\n"; };
    std::string text = line("parts", r.parts) + line("episodes", r.episodes) + line("results", r.results) +
                       line("hours of production", r.virtual_s / 3600) + line("line stops", r.line_stops) + line("resets", r.resets) +
                       line("excused (invisible faults)", r.excused) + line("parts with nothing wrong", r.undisturbed) + line("processes", r.processes) + line("fault pairs", r.coverage.pairs()) + line("violations", r.violations);
    text += "fingerprint                 " + hex(r.fingerprint) + "\nfaults fired\n";
    for (std::size_t k = 0; k < sim::kFaults; ++k) {
        if (r.planned[k] > 0) text += line("  " + std::string(sim::name_of(static_cast<Fault>(k))), r.fired[k]);
    }
    text += "verdicts by reason\n";
    for (std::size_t k = 0; k < r.reasons.size(); ++k) {
        if (r.reasons[k] > 0) text += line("  " + std::string(name_of(static_cast<PartReason>(k))), r.reasons[k]);
    }
    for (const std::string& violation : r.first_violations) text += "VIOLATION " + violation + "\n";
    for (const std::string& fault : r.never_fired) text += "NEVER FIRED " + fault + "\n";
    return text;
}

}  // namespace hord::firmware
