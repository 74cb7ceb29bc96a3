#include "lab/soak/shrink.h"

#include <algorithm>

#include "lab/soak/soak.h"

namespace hord::lab {
namespace {

using sim::InjectionRule;

class Shrinker {
  public:
    Shrinker(const EpisodePlan& plan, const Try& attempt, std::uint64_t max_runs)
        : best_(plan), attempt_(attempt), max_runs_(max_runs) {}

    Result<Shrunk> run() {
        const auto first = attempt_(best_);
        ++runs_;
        if (!first) return tl::unexpected(first.error());
        if (first->promise.empty())
            return fail(ErrorCode::invalid_argument, "this episode keeps every promise",
                        "shrink one that breaks a promise");
        promise_ = first->promise;
        cut_parts(first->parts);
        for (bool better = true; better && runs_ < max_runs_;) {
            better = drop_rules();
            better = pin_rules() || better;
        }
        cut_parts(parts_needed_);
        return Shrunk{best_, promise_, runs_};
    }

  private:
    // Whether the plan still breaks the same promise; then it becomes the best one.
    bool still_breaks(const EpisodePlan& plan) {
        if (runs_ >= max_runs_) return false;
        ++runs_;
        const auto outcome = attempt_(plan);
        if (!outcome || outcome->promise != promise_) return false;
        best_ = plan;
        parts_needed_ = outcome->parts;
        return true;
    }

    // Cuts the parts after the violation, except a few that may be needed for it to be noticed.
    void cut_parts(std::uint64_t needed) {
        parts_needed_ = needed;
        for (const std::uint64_t more : {std::uint64_t{0}, std::uint64_t{2}, std::uint64_t{10}, std::uint64_t{50}}) {
            EpisodePlan plan = best_;
            plan.parts = std::max<std::uint64_t>(1, needed + more);
            if (plan.parts >= best_.parts) return;
            if (still_breaks(plan)) return;
        }
    }

    bool drop_rules() {
        bool any = false;
        for (std::size_t k = best_.faults.size(); k-- > 0;) {
            EpisodePlan plan = best_;
            plan.faults.erase(plan.faults.begin() + static_cast<std::ptrdiff_t>(k));
            any = still_breaks(plan) || any;
        }
        return any;
    }

    // Halves the range of opportunities in which a rule fires, until it is one.
    bool pin_rules() {
        bool any = false;
        for (std::size_t k = 0; k < best_.faults.size(); ++k) {
            for (bool halved = true; halved;) {
                halved = false;
                const InjectionRule rule = best_.faults[k];
                const std::uint64_t last = std::min(rule.last, rule.first + best_.parts);
                if (rule.first >= last) break;
                const std::uint64_t middle = rule.first + (last - rule.first) / 2;
                for (const auto& [from, to] : {std::pair{rule.first, middle}, std::pair{middle + 1, last}}) {
                    EpisodePlan plan = best_;
                    plan.faults[k].first = from;
                    plan.faults[k].last = to;
                    if (from == to) plan.faults[k].probability = 1;
                    if (!still_breaks(plan)) continue;
                    halved = any = true;
                    break;
                }
            }
        }
        return any;
    }

    EpisodePlan best_;
    const Try& attempt_;
    std::uint64_t max_runs_, runs_ = 0, parts_needed_ = 0;
    std::string promise_;
};

}  // namespace

Result<Shrunk> shrink(const EpisodePlan& plan, const Try& attempt, std::uint64_t max_runs) {
    return Shrinker(plan, attempt, max_runs).run();
}

Result<Breakage> try_episode(const EpisodePlan& plan) {
    const auto report = run_episode(plan);
    if (!report) return tl::unexpected(report.error());
    Breakage breakage;
    if (report->violations == 0) return breakage;
    const std::string& first = report->first_violations.front();
    breakage.promise = first.substr(0, first.find(':'));
    breakage.parts = report->parts_to_violation;
    return breakage;
}

}  // namespace hord::lab
