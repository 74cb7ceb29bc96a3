#include "lab/tradeoff/tradeoff_rating.h"

#include <algorithm>

#include "lab/tradeoff/tradeoff_scores.h"

namespace hord::lab {
namespace {

constexpr double kFaster = 0.95;  // of the other's time

Estimate estimate(const Json& json) { return {json[0].get<double>(), json[1].get<double>(), json[2].get<double>()}; }
std::optional<double> optional_of(const Json& json) {
    return json.is_null() ? std::nullopt : std::optional(json.get<double>());
}

}  // namespace

std::vector<Rated> rated_at(const TradeoffResults& results, const TradeoffPoint& point) {
    std::vector<Rated> all;
    const Json* scores = results.scores_at(point);
    const Json* times = results.times_at(point);
    if (scores == nullptr) return all;
    for (const algo::FeatureChoice choice : every_choice()) {
        Rated rated;
        rated.name = name_of(choice);
        rated.kind = choice.against_reference               ? Kind::reference
            : choice.feature == algo::Feature::transmission ? Kind::light
                                                            : Kind::neighbours;
        const Json& s = (*scores)[rated.name];
        for (std::size_t f = 0; f < kFamilies; ++f) {
            const Json& family = s[std::string(kFamilyNames[f])];
            rated.auc[f] = estimate(family["auc"]);
            rated.tpr[f] = estimate(family["tpr"]);
            rated.a90[f] = optional_of(family["a90"]);
            rated.a90_95[f] = optional_of(family["a90_95"]);
        }
        const double threshold = s["threshold"].get<double>();
        rated.error_of_threshold = threshold > 0 ? s["error"].get<double>() / threshold : 0;
        rated.flips = s["flips"].get<double>();
        if (times != nullptr) {
            rated.median_ms = (*times)[rated.name]["median_ms"].get<double>();
            rated.p99_ms = (*times)[rated.name]["p99_ms"].get<double>();
        }
        all.push_back(std::move(rated));
    }
    return all;
}

bool dominates(const Rated& a, const Rated& b) {
    if (a.median_ms > b.median_ms) return false;
    bool clearly = a.median_ms < kFaster * b.median_ms;
    for (std::size_t f = 0; f < kFamilies; ++f) {
        if (a.tpr[f].value < b.tpr[f].value) return false;
        clearly = clearly || a.tpr[f].low > b.tpr[f].high;
    }
    return clearly;
}

const Rated* dominator(const std::vector<Rated>& all, const Rated& one, bool of_its_kind) {
    const Rated* best = nullptr;
    for (const Rated& other : all) {
        if ((of_its_kind && other.kind != one.kind) || !dominates(other, one)) continue;
        if (best == nullptr || other.mean_tpr() > best->mean_tpr()) best = &other;
    }
    return best;
}

const Rated* best_of(const std::vector<Rated>& all, Kind kind) {
    const Rated* best = nullptr;
    for (const Rated& one : all) {
        if (one.kind == kind && (best == nullptr || one.mean_tpr() > best->mean_tpr())) best = &one;
    }
    return best;
}
const Rated* fastest_as_good(const std::vector<Rated>& all, const Rated& best) {
    const Rated* fastest = &best;
    for (const Rated& one : all) {
        if (one.kind == best.kind && one.mean_tpr() >= best.mean_tpr() - best.half_width() &&
            one.median_ms < fastest->median_ms)
            fastest = &one;
    }
    return fastest;
}
const Rated& named(const std::vector<Rated>& all, std::string_view name) {
    return *std::ranges::find(all, name, &Rated::name);
}

}  // namespace hord::lab
