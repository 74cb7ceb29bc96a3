#include "firmware/soak/soak.h"

#include <algorithm>
#include <set>

#include "firmware/soak/simulated_line.h"
#include "hal_sim/cell/random.h"

namespace hord::firmware {
namespace {

using sim::Fault;
using sim::FaultRule;

constexpr std::uint64_t kPlanStream = 0x50A7;

// One to three faults. Each fires surely once, early in the episode, and then now and then until nine tenths of it; in the
// last tenth the line must find back.
std::vector<FaultRule> draw_plan(std::uint64_t seed, std::uint64_t parts) {
    std::vector<FaultRule> plan;
    auto draw = [&, n = std::uint64_t{0}]() mutable { return sim::random_bits(seed, kPlanStream, n++); };
    const std::uint64_t count = 1 + draw() % 3;
    for (std::uint64_t k = 0; k < count; ++k) {
        const auto fault = static_cast<Fault>(draw() % sim::kFaults);
        if (std::any_of(plan.begin(), plan.end(), [&](const FaultRule& r) { return r.fault == fault; })) continue;
        const bool each_command = fault >= Fault::reject_lost;  // only rejected parts are an opportunity: one in ten, or fewer
        const std::uint64_t opportunities = each_command ? parts / 20 : parts / 2;
        const std::uint64_t first = draw() % std::max<std::uint64_t>(opportunities / 4, 1);
        constexpr double kRates[] = {0.001, 0.005, 0.02};
        plan.push_back({fault, 1, first, first, {}});
        plan.push_back({fault, kRates[draw() % 3], first + 1, each_command ? parts / 12 : parts * 9 / 10, {}});
    }
    return plan;
}

std::string text_of(const std::vector<FaultRule>& plan) {
    std::string text;
    for (const FaultRule& rule : plan) {
        const std::string name(sim::name_of(rule.fault));
        if (text.find(name) == std::string::npos) text += (text.empty() ? "" : ",") + name;
    }
    return text;
}

void add_episode(SoakReport& report, SimulatedLine& line, bool over, const std::string& label, std::set<std::pair<int, int>>& pairs) {
    const Invariants& seen = line.invariants();
    const auto violation = [&](const std::string& text) {
        if (report.violations++ == 0) report.parts_to_violation = report.parts + line.cell().world().totals().arrived;
        if (report.first_violations.size() < 20) report.first_violations.push_back(label + ": " + text);
    };
    report.results += seen.results();
    if (report.violations == 0 && seen.violations() > 0) report.parts_to_violation = report.parts + seen.parts_to_violation();
    report.violations += seen.violations();
    for (const std::string& text : seen.first_violations()) {
        if (report.first_violations.size() < 20) report.first_violations.push_back(label + ": " + text);
    }
    if (!over) violation("did not end");
    const Snapshot last = line.snapshot();
    if (last.state != State::continuous_execution || last.line_stop) violation("ended in " + std::string(name_of(last.state)));
    report.line_stops += line.line_stops();
    report.resets += line.resets();
    report.excused += seen.excused();
    report.virtual_s += static_cast<std::uint64_t>(std::chrono::duration_cast<std::chrono::seconds>(line.loop().now().time_since_epoch()).count());
    for (std::size_t k = 0; k < report.reasons.size(); ++k) report.reasons[k] += seen.of(static_cast<PartReason>(k));
    const sim::FaultPlan& faults = line.cell().faults();
    for (std::size_t a = 0; a < sim::kFaults; ++a) {
        const auto fired = faults.fired(static_cast<Fault>(a));
        report.planned[a] += faults.names(static_cast<Fault>(a)) ? 1U : 0U;
        report.fired[a] += fired;
        for (std::size_t b = 0; fired > 0 && b < a; ++b) {
            if (faults.fired(static_cast<Fault>(b)) > 0) pairs.emplace(static_cast<int>(a), static_cast<int>(b));
        }
    }
    for (const Fault fault : faults.never_fired()) report.never_fired.push_back(label + ": " + std::string(sim::name_of(fault)));
    report.fingerprint = sim::mix64(report.fingerprint ^ seen.fingerprint());
}

}  // namespace

Result<SoakReport> soak(const SoakOptions& options) {
    if (options.parts == 0 || options.parts_an_episode < 200) {
        return fail(ErrorCode::invalid_argument, "a soak of " + std::to_string(options.parts) + " parts, " +
                    std::to_string(options.parts_an_episode) + " an episode", "use at least 1 part, and 200 an episode");
    }
    SoakReport report;
    std::set<std::pair<int, int>> pairs;
    for (std::uint64_t episode = options.first_episode; report.parts < options.parts; ++episode) {
        const std::uint64_t parts = options.parts_an_episode;
        const std::uint64_t seed = sim::random_bits(options.seed, kPlanStream, episode);
        LineOptions line = seed % 2 == 0 ? timed_line(seed, parts) : encoder_line(seed, parts);
        line.cell.faults = options.faults.empty() ? draw_plan(seed, parts) : options.faults;
        auto made = SimulatedLine::make(line);
        if (!made) return tl::unexpected(made.error());
        const bool over = (*made)->run();
        const std::string label = "seed " + std::to_string(options.seed) + ", episode " + std::to_string(episode) +
                                  (seed % 2 == 0 ? ", timed line, " : ", encoder line, ") + text_of(line.cell.faults);
        add_episode(report, **made, over, label, pairs);
        ++report.episodes;
        report.parts += parts;
        if (options.until_violation && report.violations > 0) break;
        if (options.progress) options.progress(std::min(1.0, static_cast<double>(report.parts) / static_cast<double>(options.parts)));
    }
    report.pairs = pairs.size();
    return report;
}

std::string describe(const SoakReport& r) {
    const auto line = [](const std::string& name, std::uint64_t value) { return name + std::string(28 - std::min<std::size_t>(27, name.size()), ' ') + std::to_string(value) + "\n"; };
    std::string text = line("parts", r.parts) + line("episodes", r.episodes) + line("results", r.results) +
                       line("hours of production", r.virtual_s / 3600) + line("line stops", r.line_stops) + line("resets", r.resets) +
                       line("excused (invisible faults)", r.excused) + line("fault pairs", r.pairs) + line("violations", r.violations);
    text += "faults fired\n";
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
