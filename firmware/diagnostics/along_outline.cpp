#include "firmware/diagnostics/along_outline.h"

#include <algorithm>
#include <cstdint>
#include <utility>
#include <vector>

#include "algo/frame/mask.h"

namespace hord::firmware {
namespace {

// Lenslets of a severity of 1 and above, layer by layer from the rim inwards.
template <class Severity>
AlongOutline along_outline(const algo::Inspection& found, const algo::Extents& e, Severity&& severity) {
    constexpr int kWidest = 6;
    // Fewer of the lenslets beside the rim are no bevel, but a place, such as a hole: a short side of a plate that is
    // three times as long as wide is an eighth. Farther from the rim a sixteenth.
    constexpr std::size_t kSideOf = 8, kSomeOf = 16;
    std::vector<std::uint8_t> seen(found.mask.size());
    std::vector<std::size_t> at, next;
    for (std::size_t k = 0; k < seen.size(); ++k) {
        seen[k] = (found.mask[k] & algo::kNotJudged) != 0 ? 1 : 0;
        if ((found.mask[k] & algo::kRim) != 0) at.push_back(k);
    }
    AlongOutline edge;
    float most = 0;
    for (int width = 1; width <= kWidest; ++width) {
        next.clear();
        std::size_t exceed = 0, worst = 0;
        float most_here = 0;
        for (const std::size_t k : at) {
            e.for_each_around(static_cast<int>(k) % e.m, static_cast<int>(k) / e.m, 1, [&](int m, int n) {
                const std::size_t beside = e.index(m, n);
                if (seen[beside] != 0) return;
                seen[beside] = 1;
                next.push_back(beside);
                const float here = severity(beside);
                exceed += here >= 1 ? 1 : 0;
                if (here > most_here) most_here = here, worst = beside;
            });
        }
        if ((width == 1 ? kSideOf : kSomeOf) * exceed < next.size() || next.empty()) break;
        edge.width = width;
        edge.share = std::max(edge.share, static_cast<double>(exceed) / static_cast<double>(next.size()));
        if (most_here > most) most = most_here, edge.worst = worst;
        std::swap(at, next);
    }
    return edge;
}

enum class Of : std::uint8_t { all, exact };  // features; the gradient of neighbours may be a bound

// As algo/inspection/defects.h says, of parts without a slope of their own.
float severity_of(const algo::Inspection& found, const algo::Recipe& recipe, std::size_t k, Of of) {
    if ((found.mask[k] & algo::kNotJudged) != 0) return 0;
    float worst = 0;
    if ((found.mask[k] & algo::kNoGradient) == 0) {
        if (of == Of::all && !found.gradient.empty())
            worst = std::max(worst, found.gradient[k] / algo::limit_of_gradient(recipe));
        if (recipe.slopes && !found.frobenius.empty())
            worst = std::max(worst, found.frobenius[k] / recipe.frobenius_limit_bins);
    }
    if (recipe.light && !found.transmission.empty() && (found.mask[k] & algo::kSaturated) == 0)
        worst = std::max(worst, (1 - found.transmission[k]) / (1 - recipe.transmission_limit));
    return worst;
}

}  // namespace

bool is_mostly_dark(const algo::Inspection& found, const algo::Recipe& recipe) {
    if (!recipe.light || found.mask.empty() || found.transmission.empty()) return false;
    std::size_t judged = 0, dark = 0;
    for (std::size_t k = 0; k < found.mask.size(); ++k) {
        if ((found.mask[k] & (algo::kNotJudged | algo::kNoHord)) != 0) continue;
        ++judged;
        dark += found.transmission[k] < recipe.transmission_limit ? 1 : 0;
    }
    return 2 * dark > judged;
}

AlongOutline dark_along_outline(const algo::Inspection& found, const algo::Recipe& recipe, const algo::Extents& e) {
    if (found.mask.empty() || found.transmission.empty() || is_mostly_dark(found, recipe)) return {};
    return along_outline(found, e, [&](std::size_t k) {
        const bool is_dark = (found.mask[k] & algo::kDark) != 0 || found.transmission[k] < recipe.transmission_limit;
        return is_dark ? 1.0F : 0.0F;
    });
}

std::optional<AlongOutline> defect_along_outline(const algo::Inspection& found, const algo::Recipe& recipe,
                                                 const algo::Extents& e) {
    const bool has_outline = recipe.form == algo::PartForm::plate || recipe.form == algo::PartForm::round;
    if (!has_outline || recipe.reference || found.mask.empty() || is_mostly_dark(found, recipe)) return std::nullopt;
    const auto severity = [&](std::size_t k) { return severity_of(found, recipe, k, Of::all); };
    AlongOutline edge = along_outline(found, e, severity);
    if (edge.width == 0) return std::nullopt;
    const float worst = severity(edge.worst);
    for (std::size_t k = 0; k < found.mask.size(); ++k) {
        if (severity(k) > worst) return std::nullopt;
    }
    if (found.bounded) {
        edge.at_least = true;
        edge.width =
            along_outline(found, e, [&](std::size_t k) { return severity_of(found, recipe, k, Of::exact); }).width;
    }
    return edge;
}

}  // namespace hord::firmware
