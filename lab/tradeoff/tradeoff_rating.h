// Compares the features at one point of the trade-off.
#pragma once

#include <array>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "lab/report/statistics.h"
#include "lab/tradeoff/tradeoff.h"

namespace hord::lab {

constexpr TradeoffPoint kCentre{};

// The comparison that a feature makes for a lenslet: with its neighbours, with a reference, or none (light alone).
enum class Kind : std::uint8_t { light, neighbours, reference };
constexpr std::string_view kKindNames[] = {"the light alone", "over neighbours", "against a reference"};

// One feature at one point.
struct Rated {
    std::string name;
    Kind kind = Kind::neighbours;
    double median_ms = 0, p99_ms = 0;
    std::array<Estimate, kFamilies> auc, tpr;  // by family
    std::array<std::optional<double>, kFamilies> a90, a90_95;
    double error_of_threshold = 0;  // error over threshold
    double flips = 0;

    // Mean over the families, and half of its interval.
    [[nodiscard]] double mean_tpr() const {
        double sum = 0;
        for (const Estimate& t : tpr) sum += t.value;
        return sum / kFamilies;
    }
    [[nodiscard]] double half_width() const {
        double sum = 0;
        for (const Estimate& t : tpr) sum += (t.high - t.low) / 2;
        return sum / kFamilies;
    }
};

// All features at a point; their times are 0 if it was not timed. Empty if it was not scored.
std::vector<Rated> rated_at(const TradeoffResults& results, const TradeoffPoint& point);

// The features shown in plots and in tables over many points.
constexpr const char* kShown[] = {"emd",          "bhattacharyya", "chi2",           "jacobian-frobenius",
                                  "transmission", "reference-emd", "reference-chi2", "reference-centroid"};
const Rated& named(const std::vector<Rated>& all, std::string_view name);  // must be among them

// Not slower, finds no less of any family, and is clearly better in one of these.
bool dominates(const Rated& a, const Rated& b);
// Of the features that dominate it (all, or those of its own kind), the one that finds most; null for none.
const Rated* dominator(const std::vector<Rated>& all, const Rated& one, bool of_its_kind);
// The feature of a kind that finds most. fastest_as_good(): the fastest of that kind within the interval of `best`.
const Rated* best_of(const std::vector<Rated>& all, Kind kind);
const Rated* fastest_as_good(const std::vector<Rated>& all, const Rated& best);

}  // namespace hord::lab
