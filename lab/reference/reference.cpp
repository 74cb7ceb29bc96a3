#include "lab/reference/reference.h"

#include <algorithm>
#include <cmath>
#include <memory>
#include <random>

#include <fmt/format.h>

#include "algo/inspection/pipeline.h"
#include "algo/recipe/recipe.h"
#include "algo/reference/read_noise.h"
#include "algo/reference/reference_learner.h"
#include "common/statistics.h"
#include "lab/reference/light_fields.h"
#include "lab/report/tables.h"
#include "lab/report/template.h"

namespace hord::lab {
namespace {

constexpr std::size_t kJudged = 6;  // good parts of a family that are judged; the reference learns from the others
constexpr std::array kLights = {0.25, 0.5, 0.8, 1.0};
constexpr std::array kElectrons = {2'000.0, 6'000.0, 20'000.0};  // of a filled bin at full light
constexpr std::array kBits = {8, 12};
constexpr std::array kRipples = {Ripple::none, Ripple::sensor, Ripple::part};
constexpr std::size_t kSplits = 4,
                      kSplitsQuick = 2;  // into parts to learn from and to judge: the first by name, the others drawn
constexpr double kNear = 1.5;            // lenslets from a flaw's outline: a defect there has found it
constexpr double kCountedFlaw = 0.35;    // lenslets, radius: from here on flaws must be found
constexpr double kSizedFlaw = 0.5;       // lenslets: from here on place and size are compared
constexpr std::array kGoalFalse = {0.01, 0.02};  // largest share of good exposures not passed; with ripple
constexpr double kGoalFound = 0.95, kGoalError = 0.25;

// One exposure, judged.
struct Judged {
    std::string family, name;
    std::size_t split = 0;
    Exposure exposure;
    bool flawed = false;
    double radius = 0;  // of the flaw, lenslets
    algo::Verdict verdict = algo::Verdict::unfit;
    algo::Reason reason = algo::Reason::none;
    double score = 0;
    bool found = false;  // of a flawed one: a defect lies there
    std::optional<algo::Defect> worst;
    std::optional<double> place_error, size_error;  // lenslets; size: told less true radius

    [[nodiscard]] bool passed() const { return verdict == algo::Verdict::pass; }
};

struct Split {
    std::vector<const TracedPart*> learned, judged;
};

Split split_of(const TracedFamily& family, std::size_t which, std::uint64_t seed) {
    std::vector<const TracedPart*> parts;
    for (const TracedPart& part : family.good) parts.push_back(&part);
    if (which > 0) std::shuffle(parts.begin(), parts.end(), std::mt19937_64(seed * 100 + which));
    const auto first_learned = parts.begin() + std::min(kJudged, parts.size());
    return {{first_learned, parts.end()}, {parts.begin(), first_learned}};
}

// As `hordctl learn` does.
Result<algo::Recipe> learn(const std::vector<Frame>& frames, const algo::Extents& extents, Table& learnings,
                           std::vector<std::string> row, double true_gain) {
    algo::Recipe recipe;
    const int bits = frames.front().bits();
    algo::LearnOptions options;
    options.levels = algo::light_levels(recipe, bits);
    options.dark_from_noise = recipe.dark_dn == 0;
    const auto frame_of = [&](std::size_t k) -> Result<Frame> { return frames[k]; };
    const auto read = algo::read_noise_of(extents, options.levels, frames.size(), frame_of);
    if (!read) return tl::unexpected(read.error());
    options.read_dn = *read;
    auto learned = algo::learn_reference(extents, bits, frames.size(), frame_of, options);
    if (!learned) return tl::unexpected(learned.error());
    const algo::SensorModel& sensor = learned->reference.sensor;
    for (const std::string& value :
         {fmt::format("{}", learned->left_out.size()), fmt::format("{:.3g}", sensor.electrons_per_dn),
          fmt::format("{:.3g}", true_gain), fmt::format("{:.3g}", sensor.read_dn),
          fmt::format("{:.3g}", kReadElectrons / true_gain)})
        row.push_back(value);
    learnings.rows.push_back(std::move(row));
    recipe.reference = std::make_shared<const algo::Reference>(std::move(learned->reference));
    return recipe;
}

void compare_with_flaw(const TracedFlaw& flaw, std::span<const algo::Defect> defects, Judged& judged) {
    const auto distance = [&](const algo::Defect& d) {
        return flaw.distance(static_cast<double>(d.m), static_cast<double>(d.n));
    };
    const auto nearest =
        std::ranges::min_element(defects, [&](const auto& a, const auto& b) { return distance(a) < distance(b); });
    if (nearest == defects.end() || distance(*nearest) > flaw.radius.value_or(1) + kNear) return;
    judged.found = true;
    if (flaw.radius.value_or(0) < kSizedFlaw) return;
    judged.place_error = distance(*nearest);
    judged.size_error = static_cast<double>(algo::radius_of(*nearest)) - *flaw.radius;
}

class Yardstick {
  public:
    explicit Yardstick(const ExperimentOptions& options) : options_(options) {}
    Result<void> run();
    [[nodiscard]] Result<ExperimentReport> report() const;

  private:
    Result<void> judge(const std::string& name, const TracedFamily& family, std::size_t split,
                       const Exposure& exposure);
    Table false_rejects() const;
    Table flaws() const;

    const ExperimentOptions& options_;
    std::vector<Judged> judged_;
    Table learnings_{{"family", "split", "bits", "electrons", "ripple", "left out", "electrons a DN", "true",
                      "read noise (DN)", "true (DN)"},
                     {}};
};

Result<void> Yardstick::judge(const std::string& name, const TracedFamily& family, std::size_t which,
                              const Exposure& exposure) {
    const Split split = split_of(family, which, options_.seed);
    const algo::Extents extents = family.good.front().extents;
    std::uint64_t seed = options_.seed * 1'000'003;
    const auto exposed = [&](const TracedPart& part, double light) {
        Exposure one = exposure;
        one.light = light, one.seed = ++seed;
        return expose(part, one);
    };
    std::vector<Frame> frames;
    for (const TracedPart* part : split.learned) frames.push_back(exposed(*part, 1));
    const auto recipe =
        learn(frames, extents, learnings_,
              {name, std::to_string(which), std::to_string(exposure.bits), fmt::format("{:g}", exposure.electrons),
               kRippleNames[static_cast<std::size_t>(exposure.ripple)]},
              electrons_per_dn(exposure));
    if (!recipe) return tl::unexpected(recipe.error());
    auto pipeline = algo::Pipeline::create(extents, exposure.bits, *recipe);
    if (!pipeline) return tl::unexpected(pipeline.error());
    std::vector<const TracedPart*> parts = split.judged;
    for (const TracedPart& part : family.flawed) parts.push_back(&part);
    for (const TracedPart* part : parts) {
        for (const double light : kLights) {
            const auto found = pipeline->inspect(exposed(*part, light).view());
            if (!found) return tl::unexpected(found.error());
            Judged one;
            one.family = name, one.name = part->name, one.split = which, one.exposure = exposure;
            one.exposure.light = light, one.flawed = part->flaw.has_value();
            one.radius = part->flaw ? part->flaw->radius.value_or(0) : 0;
            one.verdict = found->verdict, one.reason = found->reason, one.score = static_cast<double>(found->score);
            if (!found->defects.empty()) one.worst = found->defects.front();
            if (part->flaw) compare_with_flaw(*part->flaw, found->defects, one);
            judged_.push_back(std::move(one));
        }
    }
    return {};
}

Result<void> Yardstick::run() {
    const auto families = read_light_fields(options_.frames);
    if (!families) return tl::unexpected(families.error());
    const std::size_t splits = options_.quick ? kSplitsQuick : kSplits;
    std::vector<double> strengths(kElectrons.begin(), kElectrons.end());
    if (options_.quick) strengths = {kElectrons.back()};
    const double cells =
        static_cast<double>(families->size() * splits * strengths.size() * kBits.size() * kRipples.size());
    double done = 0;
    for (const auto& [name, family] : *families) {
        if (family.good.size() < kJudged + algo::Reference::kMinParts)
            return fail(ErrorCode::invalid_argument, fmt::format("{} has {} good parts", name, family.good.size()),
                        fmt::format("trace at least {}", kJudged + algo::Reference::kMinParts));
        for (std::size_t split = 0; split < splits; ++split) {
            for (const double electrons : strengths) {
                for (const int bits : kBits) {
                    for (const Ripple ripple : kRipples) {
                        options_.progress(done++ / cells, fmt::format("{}, split {}", name, split));
                        if (auto one = judge(name, family, split, {bits, electrons, 1, ripple, 0}); !one) return one;
                    }
                }
            }
        }
    }
    return {};
}

// "3 + 1 of 144 (2.8 %)": rejected and unfit.
template <class Where>
std::string share_not_passed(const std::vector<Judged>& judged, Where&& where) {
    std::size_t rejected = 0, unfit = 0, all = 0;
    for (const Judged& one : judged) {
        if (one.flawed || !where(one)) continue;
        ++all;
        rejected += one.verdict == algo::Verdict::reject ? 1U : 0U,
            unfit += one.verdict == algo::Verdict::unfit ? 1U : 0U;
    }
    return all == 0 ? "-"
                    : fmt::format("{} + {} of {} ({:.1f} %)", rejected, unfit, all,
                                  100.0 * static_cast<double>(rejected + unfit) / static_cast<double>(all));
}

std::vector<std::string> families_of(const std::vector<Judged>& judged) {
    std::vector<std::string> names;
    for (const Judged& one : judged) {
        if (std::ranges::find(names, one.family) == names.end()) names.push_back(one.family);
    }
    return names;
}

Table Yardstick::false_rejects() const {
    Table table{{"family", "ripple"}, {}};
    for (const double light : kLights) table.header.push_back(fmt::format("light x{:g}", light));
    for (const int bits : kBits) table.header.push_back(fmt::format("{} bits", bits));
    for (const double electrons : kElectrons) table.header.push_back(fmt::format("{:g} electrons", electrons));
    for (const std::string& family : families_of(judged_)) {
        for (const Ripple ripple : kRipples) {
            std::vector<std::string> row{family, kRippleNames[static_cast<std::size_t>(ripple)]};
            const auto add = [&](auto&& also) {
                row.push_back(share_not_passed(judged_, [&](const Judged& j) {
                    return j.family == family && j.exposure.ripple == ripple && also(j.exposure);
                }));
            };
            for (const double light : kLights) add([&](const Exposure& e) { return e.light == light; });
            for (const int bits : kBits) add([&](const Exposure& e) { return e.bits == bits; });
            for (const double electrons : kElectrons) add([&](const Exposure& e) { return e.electrons == electrons; });
            table.rows.push_back(std::move(row));
        }
    }
    return table;
}

template <class Value>
std::string median_of(const std::vector<const Judged*>& judged, Value&& value) {
    std::vector<double> values;
    for (const Judged* one : judged) {
        if (const auto v = value(*one)) values.push_back(*v);
    }
    return values.empty() ? "-" : fmt::format("{:.2f}", common::quantile(values, 0.5));
}

Table Yardstick::flaws() const {
    Table table{{"flaw", "ripple", "found", "place error (lenslets)", "told less true radius (lenslets)"}, {}};
    std::map<std::pair<std::string, Ripple>, std::vector<const Judged*>> groups;
    for (const Judged& one : judged_) {
        if (one.flawed) groups[{one.name, one.exposure.ripple}].push_back(&one);
    }
    for (const auto& [which, all] : groups) {
        const auto found = std::ranges::count_if(all, [](const Judged* j) { return j->found; });
        table.rows.push_back({which.first, kRippleNames[static_cast<std::size_t>(which.second)],
                              fmt::format("{} of {}", found, all.size()),
                              median_of(all, [](const Judged& j) { return j.place_error; }),
                              median_of(all, [](const Judged& j) { return j.size_error; })});
    }
    return table;
}

Result<ExperimentReport> Yardstick::report() const {
    ExperimentReport report;
    for (const bool ripple : {false, true}) {
        const auto where = [&](const Judged& j) { return (j.exposure.ripple != Ripple::none) == ripple; };
        std::size_t good = 0, passed = 0, flawed = 0, found = 0;
        std::vector<double> place, size;
        for (const Judged& one : judged_) {
            if (!where(one)) continue;
            if (one.radius >= kCountedFlaw) ++flawed, found += one.found ? 1U : 0U;
            if (!one.flawed) ++good, passed += one.passed() ? 1U : 0U;
            if (one.place_error) place.push_back(*one.place_error), size.push_back(std::abs(*one.size_error));
        }
        const char* with = ripple ? ", with 1.5 % of ripple" : "";
        const double goal = kGoalFalse[ripple ? 1 : 0];
        const auto share = [](std::size_t part, std::size_t all) {
            return all == 0 ? 0 : static_cast<double>(part) / static_cast<double>(all);
        };
        report.claims.push_back(
            {fmt::format("At most {:g} % of the good exposures are rejected or unfit{}", 100 * goal, with),
             share(good - passed, good) <= goal,
             fmt::format("{} of {}, {:.2f} %", good - passed, good, 100 * share(good - passed, good))});
        if (flawed == 0) continue;
        report.claims.push_back({fmt::format("At least {:g} % of the flaws of {:g} lenslet and more are found{}",
                                             100 * kGoalFound, kCountedFlaw, with),
                                 share(found, flawed) >= kGoalFound, fmt::format("{} of {}", found, flawed)});
        if (place.empty()) continue;
        const double place_error = common::quantile(place, 0.5), size_error = common::quantile(size, 0.5);
        report.claims.push_back(
            {fmt::format("Place and radius of those of {:g} lenslet and more are right to {:g} lenslet{}", kSizedFlaw,
                         kGoalError, with),
             place_error <= kGoalError && size_error <= kGoalError,
             fmt::format("medians {:.2f} and {:.2f}", place_error, size_error)});
    }
    Table all{{"family", "name", "split", "bits", "electrons", "ripple", "light", "verdict", "reason", "score", "found",
               "place_error", "size_error", "m", "n", "area", "kind"},
              {}};
    for (const Judged& j : judged_) {
        const auto number = [](const std::optional<double>& v) { return v ? fmt::format("{:.3f}", *v) : ""; };
        all.rows.push_back({j.family, j.name, std::to_string(j.split), std::to_string(j.exposure.bits),
                            fmt::format("{:g}", j.exposure.electrons),
                            kRippleNames[static_cast<std::size_t>(j.exposure.ripple)],
                            fmt::format("{:g}", j.exposure.light), std::string(name_of(j.verdict)),
                            std::string(name_of(j.reason)), fmt::format("{:.3f}", j.score),
                            j.flawed ? (j.found ? "yes" : "no") : "", number(j.place_error), number(j.size_error)});
        std::vector<std::string> where(4);
        if (j.worst)
            where = {fmt::format("{:.1f}", j.worst->m), fmt::format("{:.1f}", j.worst->n),
                     std::to_string(j.worst->area), std::string(name_of(j.worst->kind))};
        all.rows.back().insert(all.rows.back().end(), where.begin(), where.end());
    }
    for (const auto& [name, table] :
         {std::pair("judged.csv", &std::as_const(all)), std::pair("learned.csv", &learnings_)}) {
        if (auto written = write_csv(options_.out / name, *table); !written) return tl::unexpected(written.error());
        report.files.push_back(options_.out / name);
    }
    report.text = fill_report("reference",
                              {{"quick", options_.quick ? "yes" : ""},
                               {"seed", std::to_string(options_.seed)},
                               {"judged", std::to_string(kJudged)},
                               {"splits", std::to_string(options_.quick ? kSplitsQuick : kSplits)},
                               {"claims", describe(report.claims)},
                               {"false_rejects", to_markdown(false_rejects())},
                               {"flaws", to_markdown(flaws())}});
    return report;
}

}  // namespace

Result<ExperimentReport> run_reference(const ExperimentOptions& options) {
    Yardstick experiment(options);
    if (auto done = experiment.run(); !done) return tl::unexpected(done.error());
    options.progress(1, "");
    return experiment.report();
}

}  // namespace hord::lab
