#include "lab/design/part_values.h"

#include <algorithm>

#include "algo/frame/mask.h"

namespace hord::lab {
namespace {

using algo::Feature;

constexpr JudgedSet kSets[] = {{{}, false, true},
                               {{}, true, true},
                               {Feature::marginal, true, true},
                               {Feature::hellinger, true, true},
                               {Feature::chi2, true, true},
                               {Feature::emd, true, true}};

constexpr double kMinTransmission = 0.01;  // a limit of 0 would switch the feature off

std::size_t value_of(Feature gradient) {
    return static_cast<std::size_t>(std::ranges::find(algo::kJudgedGradients, gradient) -
                                    algo::kJudgedGradients.begin());
}

double worst_of(algo::Map map, std::span<const std::uint8_t> mask, unsigned excluded, bool missing) {
    double worst = 0;
    for (std::size_t k = 0; k < map.size(); ++k) {
        if ((mask[k] & excluded) != 0) continue;
        const auto value = static_cast<double>(map[k]);
        worst = std::max(worst, missing ? 1 - value : value);
    }
    return worst;
}

}  // namespace

bool JudgedSet::has(std::size_t value) const {
    if (value == kSlopesValue) return slopes;
    if (value == kLightValue) return light;
    return gradient && value_of(*gradient) == value;
}

std::string JudgedSet::name() const {
    std::string text;
    const auto add = [&](std::string_view feature) { text += (text.empty() ? "" : ", ") + std::string(feature); };
    if (gradient) add(name_of(*gradient));
    if (slopes) add(name_of(Feature::jacobian_frobenius));
    if (light) add(name_of(Feature::transmission));
    return text;
}

std::span<const JudgedSet> judged_sets() { return kSets; }

algo::Recipe recipe_of(const JudgedSet& set, const PartValues& limits, const algo::Recipe& base) {
    algo::Recipe recipe = base;
    recipe.gradient = set.gradient;
    recipe.slopes = set.slopes;
    recipe.light = set.light;
    if (set.gradient == Feature::emd) recipe.emd_limit_bins = static_cast<float>(limits[value_of(Feature::emd)]);
    else if (set.gradient) recipe.gradient_limit = static_cast<float>(limits[value_of(*set.gradient)]);
    if (set.slopes) recipe.frobenius_limit_bins = static_cast<float>(limits[kSlopesValue]);
    if (set.light)
        recipe.transmission_limit = static_cast<float>(std::clamp(1 - limits[kLightValue], kMinTransmission, 1.0));
    return recipe;
}

Result<FrameValues> FrameValues::create(const algo::Extents& extents, int bits, const algo::Recipe& base,
                                        std::optional<JudgedSet> only) {
    FrameValues values;
    std::vector<JudgedSet> sets;
    if (only) sets.push_back(*only);
    else {
        for (const Feature gradient : algo::kJudgedGradients)
            sets.push_back({gradient, gradient == Feature::emd, gradient == Feature::emd});
    }
    for (const JudgedSet& set : sets) {
        algo::Recipe recipe = base;
        recipe.gradient = set.gradient, recipe.slopes = set.slopes, recipe.light = set.light;
        if (set.gradient && set.gradient != Feature::emd) recipe.gradient_limit = 1;
        auto pipeline = algo::Pipeline::create(extents, bits, recipe, 1, algo::MapSet::exact);
        if (!pipeline) return tl::unexpected(pipeline.error());
        values.pipelines_.emplace_back(set, std::move(*pipeline));
    }
    return values;
}

Result<PartValues> FrameValues::of(const FrameView& frame) {
    PartValues values{};
    for (auto& [set, pipeline] : pipelines_) {
        const auto found = pipeline.inspect(frame);
        if (!found) return tl::unexpected(found.error());
        verdict_ = found->verdict, reason_ = found->reason;
        constexpr unsigned kNoSlope = algo::kNotJudged | algo::kNoGradient;
        if (set.gradient) values[value_of(*set.gradient)] = worst_of(found->gradient, found->mask, kNoSlope, false);
        if (set.slopes) values[kSlopesValue] = worst_of(found->frobenius, found->mask, kNoSlope, false);
        if (set.light)
            values[kLightValue] = worst_of(found->transmission, found->mask, algo::kNotJudged | algo::kSaturated, true);
    }
    return values;
}

}  // namespace hord::lab
