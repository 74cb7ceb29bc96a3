#include "lab/soak/soak.h"

#include <algorithm>
#include <cstdio>
#include <map>
#include <mutex>
#include <thread>
#include <utility>

#include "hal_sim/world/random.h"
#include "lab/soak/real_parts.h"

namespace hord::lab {
namespace {

using sim::InjectedFault;

constexpr std::uint64_t kEpisodeStream = 0xE915;
constexpr std::uint64_t kPairStream = 0x9A12;
constexpr std::uint64_t kPairParts = 400;
constexpr std::size_t kWalks = 24;  // episodes for each fault
constexpr std::size_t kViolationsShown = 20;

// The numbers that add up over episodes, as describe() names them.
struct Counter {
    const char* name;
    std::uint64_t SoakReport::*count;
    std::uint64_t unit = 1;
};
constexpr Counter kCounters[] = {
    {"parts", &SoakReport::parts},
    {"episodes", &SoakReport::episodes},
    {"results the station told", &SoakReport::results},
    {"hours of production", &SoakReport::virtual_s, 3600},
    {"line stops", &SoakReport::line_stops},
    {"resets", &SoakReport::resets},
    {"excused (invisible faults)", &SoakReport::excused},
    {"parts with nothing wrong", &SoakReport::undisturbed},
    {"parts seen through optics", &SoakReport::real_parts},
    {"bad ones the pipeline passed", &SoakReport::passed_bad},
    {"processes", &SoakReport::processes},
    {"results on disks", &SoakReport::stored},
    {"results lost, and said so", &SoakReport::lost},
};

SoakReport report_of(SimulatedLine& line, bool over, const EpisodePlan& plan) {
    const Invariants& invariants = line.invariants();
    const std::string command = command_of(plan);
    SoakReport report;
    report.parts = plan.parts;
    report.episodes = 1;
    report.results = invariants.results();
    report.virtual_s = static_cast<std::uint64_t>(
        std::chrono::duration_cast<std::chrono::seconds>(line.loop().now().time_since_epoch()).count());
    report.line_stops = line.line_stops();
    report.resets = line.resets();
    report.excused = invariants.excused();
    report.undisturbed = invariants.undisturbed();
    report.real_parts = plan.real ? plan.parts : 0;
    report.passed_bad = invariants.passed_bad();
    report.processes = line.processes();
    report.stored = line.store_observer().stored();
    report.lost = line.store_observer().lost();
    for (std::size_t k = 0; k < report.reasons.size(); ++k)
        report.reasons[k] = invariants.of(static_cast<PartReason>(k));

    report.violations = invariants.violations();
    report.parts_to_violation = report.violations > 0 ? invariants.parts_to_violation() : 0;
    for (std::size_t k = 0; k < kPromises; ++k) report.broken[k] = invariants.violations_of(static_cast<Promise>(k));
    const auto show = [&](const std::string& text) {
        if (report.first_violations.size() < kViolationsShown)
            report.first_violations.push_back(text + "\n    " + command);
    };
    for (const std::string& text : invariants.first_violations()) show(text);
    const auto violation = [&](const std::string& text) {
        if (report.violations++ == 0) report.parts_to_violation = line.cell().world().totals().arrived;
        show(text);
    };
    if (!over) violation("did not end");
    const Snapshot last = line.snapshot();
    if (last.state != State::continuous_execution || last.line_stop)
        violation("ended in " + std::string(name_of(last.state)));
    if (report.violations > 0) report.first_broken = plan;

    report.coverage = line.coverage();
    const sim::InjectionPlan& faults = line.cell().faults();
    for (std::size_t a = 0; a < sim::kInjectedFaults; ++a) {
        const auto fired = faults.fired(static_cast<InjectedFault>(a));
        report.planned[a] = faults.names(static_cast<InjectedFault>(a)) ? 1U : 0U;
        report.fired[a] = fired;
        for (std::size_t b = 0; fired > 0 && b < a; ++b) {
            if (faults.fired(static_cast<InjectedFault>(b)) > 0)
                report.coverage.fired_together(static_cast<InjectedFault>(a), static_cast<InjectedFault>(b));
        }
    }
    for (const InjectedFault fault : faults.never_fired())
        report.never_fired.push_back(command + ": " + std::string(sim::name_of(fault)));
    report.fingerprint = sim::mix64(invariants.fingerprint());
    return report;
}

}  // namespace

Result<LineOptions> line_of(const EpisodePlan& plan) {
    LineOptions line =
        plan.line == LineProfile::timed ? timed_line(plan.seed, plan.parts) : encoder_line(plan.seed, plan.parts);
    line.cell.faults = plan.faults;
    line.core.plc_policy = static_cast<PlcPolicy>(sim::random_bits(plan.seed, kEpisodeStream, 0) % 3);
    if (sim::random_bits(plan.seed, kEpisodeStream, 1) % 2 == 0)
        line.cell.sensor.buffers = 2 * line.queue;  // decides whether the sensor or the inspector is full first
    if (plan.real) {
        if (auto shown = show_real_parts(line); !shown) return tl::unexpected(shown.error());
    }
    return line;
}

std::string command_of(const EpisodePlan& plan) {
    return "hord-lab soak --episode " + std::to_string(plan.seed) + " --parts " + std::to_string(plan.parts) +
        " --line " + std::string(name_of(plan.line)) + (plan.real ? " --real" : "") +
        (plan.faults.empty() ? "" : " --faults " + text_of(plan.faults));
}

Result<SoakReport> run_episode(const EpisodePlan& plan) {
    const auto line = line_of(plan);
    if (!line) return tl::unexpected(line.error());
    auto made = SimulatedLine::make(*line);
    if (!made) return tl::unexpected(made.error());
    const bool over = (*made)->run();
    return report_of(**made, over, plan);
}

void SoakReport::add(const SoakReport& later) {
    if (violations == 0 && later.violations > 0) parts_to_violation = parts + later.parts_to_violation;
    if (!first_broken) first_broken = later.first_broken;
    for (const Counter& counter : kCounters) this->*counter.count += later.*counter.count;
    violations += later.violations;
    for (std::size_t k = 0; k < kPromises; ++k) broken[k] += later.broken[k];
    for (const std::string& text : later.first_violations) {
        if (first_violations.size() < kViolationsShown) first_violations.push_back(text);
    }
    for (std::size_t k = 0; k < reasons.size(); ++k) reasons[k] += later.reasons[k];
    for (std::size_t k = 0; k < sim::kInjectedFaults; ++k) {
        planned[k] += later.planned[k];
        fired[k] += later.fired[k];
    }
    coverage.merge(later.coverage);
    never_fired.insert(never_fired.end(), later.never_fired.begin(), later.never_fired.end());
    fingerprint = sim::mix64(fingerprint ^ later.fingerprint);
}

namespace {

// The episodes of a soak by number: first the pairs of faults, and walks through the states with each fault, then
// random ones.
class EpisodePlans {
  public:
    explicit EpisodePlans(const SoakOptions& options) : options_(options) {
        for (std::size_t a = 0; options.all_pairs && a < sim::kInjectedFaults; ++a) {
            for (std::size_t b = 0; b < a; ++b)
                pairs_.push_back({static_cast<InjectedFault>(a), static_cast<InjectedFault>(b)});
        }
        for (std::size_t k = 0; options.all_pairs && k < kWalks * sim::kInjectedFaults; ++k) {
            pairs_.push_back({InjectedFault::plc_walks, static_cast<InjectedFault>(k % sim::kInjectedFaults)});
        }
        const std::uint64_t of_pairs = pairs_.size() * kPairParts,
                            rest = options.parts > of_pairs ? options.parts - of_pairs : 0;
        count_ = pairs_.size() + (rest + options.parts_an_episode - 1) / options.parts_an_episode;
    }
    [[nodiscard]] std::uint64_t count() const { return count_; }
    [[nodiscard]] EpisodePlan operator[](std::uint64_t number) const {
        if (number < pairs_.size()) {
            const auto& pair = pairs_[number];
            EpisodePlan plan = draw_plan(sim::random_bits(options_.seed, kPairStream, number), kPairParts, pair);
            const bool walks = number >= pairs_.size() - kWalks * sim::kInjectedFaults;
            for (sim::InjectionRule& rule : plan.faults) {
                if (walks && rule.probability < 1) rule.probability = std::max(rule.probability, 0.03);
            }
            return plan;
        }
        EpisodePlan plan = draw_plan(sim::random_bits(options_.seed, kEpisodeStream, number - pairs_.size()),
                                     options_.parts_an_episode);
        plan.real = plan.real && options_.real_parts;
        return plan;
    }

  private:
    const SoakOptions& options_;
    std::vector<std::vector<InjectedFault>> pairs_;
    std::uint64_t count_ = 0;
};

// Runs episodes on several threads and adds their reports in the order of the episodes.
class EpisodeRunner {
  public:
    EpisodeRunner(const SoakOptions& options, const EpisodePlans& plans) : options_(options), plans_(plans) {}

    Result<SoakReport> run() {
        std::vector<std::thread> threads;
        for (int k = 1; k < options_.threads; ++k) threads.emplace_back([this] { work(); });
        work();
        for (std::thread& thread : threads) thread.join();
        if (error_) return tl::unexpected(*error_);
        return std::move(report_);
    }

  private:
    void work() {
        std::unique_lock lock(mutex_);
        while (!over() && next_ < plans_.count()) {
            const std::uint64_t number = next_++;
            lock.unlock();
            auto episode = run_episode(plans_[number]);
            lock.lock();
            if (!episode) {
                error_ = episode.error();
                return;
            }
            finished_.emplace(number, std::move(*episode));
            while (!over() && !finished_.empty() && finished_.begin()->first == added_) {
                report_.add(finished_.begin()->second);
                finished_.erase(finished_.begin());
                ++added_;
                if (options_.progress)
                    options_.progress(static_cast<double>(added_) / static_cast<double>(plans_.count()));
            }
        }
    }
    [[nodiscard]] bool over() const { return error_ || (options_.until_violation && report_.violations > 0); }

    const SoakOptions& options_;
    const EpisodePlans& plans_;
    std::mutex mutex_;  // guards the rest
    std::uint64_t next_ = 0, added_ = 0;
    std::map<std::uint64_t, SoakReport> finished_;
    SoakReport report_;
    std::optional<Error> error_;
};

}  // namespace

Result<SoakReport> soak(const SoakOptions& options) {
    if (options.parts == 0 || options.parts_an_episode < 200 || options.threads < 1) {
        return fail(ErrorCode::invalid_argument,
                    "a soak of " + std::to_string(options.parts) + " parts, " +
                        std::to_string(options.parts_an_episode) + " an episode, on " +
                        std::to_string(options.threads) + " threads",
                    "use at least 1 part, 200 an episode, and 1 thread");
    }
    const EpisodePlans plans(options);
    return EpisodeRunner(options, plans).run();
}

std::string describe(const SoakReport& r) {
    const auto hex = [](std::uint64_t value) {
        std::array<char, 17> digits{};
        std::snprintf(digits.data(), digits.size(), "%016llx", static_cast<unsigned long long>(value));
        return std::string(digits.data());
    };
    const auto line = [](const std::string& name, std::uint64_t value) {
        return name + std::string(28 - std::min<std::size_t>(27, name.size()), ' ') + std::to_string(value) + "\n";
    };
    std::string text;
    for (const Counter& counter : kCounters) text += line(counter.name, r.*counter.count / counter.unit);
    text += line("fault pairs", r.coverage.pairs()) + line("violations", r.violations);
    for (std::size_t k = 0; k < kPromises; ++k) {
        if (r.broken[k] > 0) text += line("  " + std::string(name_of(static_cast<Promise>(k))), r.broken[k]);
    }
    text += "fingerprint                 " + hex(r.fingerprint) + "\nfaults fired\n";
    for (std::size_t k = 0; k < sim::kInjectedFaults; ++k) {
        if (r.planned[k] > 0) text += line("  " + std::string(sim::name_of(static_cast<InjectedFault>(k))), r.fired[k]);
    }
    text += "verdicts by reason\n";
    for (std::size_t k = 0; k < r.reasons.size(); ++k) {
        if (r.reasons[k] > 0) text += line("  " + std::string(name_of(static_cast<PartReason>(k))), r.reasons[k]);
    }
    for (const std::string& violation : r.first_violations) text += "VIOLATION " + violation + "\n";
    for (const std::string& fault : r.never_fired) text += "NEVER FIRED " + fault + "\n";
    return text;
}

}  // namespace hord::lab
