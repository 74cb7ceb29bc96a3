// What tuning measures of a frame, for every feature set at once.
#pragma once

#include <algorithm>
#include <array>
#include <cstddef>
#include <cstdint>
#include <map>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "algo/recipe/recipe.h"
#include "lab/tune/tune.h"

namespace hord::lab {

// The values that have limits: the gradients, then slopes and light.
constexpr std::size_t kGradients = algo::kJudgedGradients.size(), kSlopes = kGradients, kLight = kGradients + 1,
                      kValues = kGradients + 2;
using FeatureValues = std::array<double, kValues>;

// The place of a gradient among FeatureValues.
std::size_t index_of(algo::Feature gradient);

// A frame of a part.
struct MeasuredPart {
    std::string file;
    bool bad = false;
    std::uint32_t number = 0;  // the same for all frames of a part; good parts first
    FeatureValues values{};
    // Of the sets with a reference, in order: Inspection::by_lenslets and together.
    std::vector<double> by_lenslets, together;
    std::vector<bool> registered;
};

// The worst of value(part), of std::optional<double>, of each distinct good part for which it has one.
template <class Value>
std::vector<double> worst_of_good(std::span<const MeasuredPart> parts, const Value& value) {
    std::map<std::uint32_t, double> worst;
    for (const MeasuredPart& part : parts) {
        if (part.bad) continue;
        const std::optional<double> here = value(part);
        if (!here) continue;
        const auto [at, is_new] = worst.try_emplace(part.number, *here);
        if (!is_new) at->second = std::max(at->second, *here);
    }
    std::vector<double> values;
    for (const auto& [number, here] : worst) values.push_back(here);
    return values;
}

// The base recipe with the set's features, and the default limits of those that it does not have.
algo::Recipe recipe_of(const FeatureSet& set, const algo::Recipe& base);

}  // namespace hord::lab
