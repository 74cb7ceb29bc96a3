#include "lab/tune/worst_value.h"

#include <algorithm>

#include "algo/frame/mask.h"
#include "algo/inspection/defects.h"

namespace hord::lab {
namespace {

// The largest value of the lenslets that have none of the bits of `excluded`, or 0.
template <class Value>
double largest(algo::Map map, std::span<const std::uint8_t> mask, int excluded, const Value& value) {
    double worst = 0;
    for (std::size_t k = 0; k < map.size(); ++k) {
        if ((mask[k] & excluded) == 0) worst = std::max(worst, value(static_cast<double>(map[k])));
    }
    return worst;
}

}  // namespace

template <class MakeFeatures>
Result<double> WorstValue::of_region(double worst, const MakeFeatures& make_features) const {
    if (min_area_ <= 1 || worst <= 0) return worst;
    double low = 0, high = worst;  // regions shrink as the limit grows
    for (int step = 0; step < 12; ++step) {
        const double middle = (low + high) / 2;
        algo::Recipe recipe;
        recipe.min_area = min_area_;
        const algo::Features features = make_features(recipe, static_cast<float>(middle));
        const auto found = algo::DefectFinder(extents_, recipe).find(features);
        if (!found) return tl::unexpected(found.error());
        (found->defects.empty() ? high : low) = middle;
    }
    return high;
}

Result<double> WorstValue::of_gradient(algo::Map map, std::span<const std::uint8_t> mask) const {
    const double worst =
        largest(map, mask, algo::kNotJudged | algo::kNoGradient, [](double gradient) { return gradient; });
    return of_region(worst, [&](algo::Recipe& recipe, float limit) {
        recipe.light = false;
        recipe.emd_limit_bins = limit;
        return algo::Features{map, {}, {}, mask};
    });
}

Result<double> WorstValue::of_light(algo::Map transmission, std::span<const std::uint8_t> mask) const {
    const double worst = largest(transmission, mask, algo::kNotJudged | algo::kSaturated,
                                 [](double transmitted) { return 1 - transmitted; });
    return of_region(worst, [&](algo::Recipe& recipe, float limit) {
        recipe.transmission_limit = 1 - limit;
        return algo::Features{{}, {}, transmission, mask};
    });
}

}  // namespace hord::lab
