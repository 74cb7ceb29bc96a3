#include "firmware/diagnostics/feature_views.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <numbers>

#include <fmt/format.h>

#include "algo/reference/pose.h"
#include "algo/reference/reference.h"

namespace hord::firmware {

using algo::Feature;

std::string unit_for_people(Feature feature, bool against_reference) {
    if (feature == Feature::transmission) return "of the typical lenslet";
    const std::string_view unit = algo::unit_of(feature);
    if (!unit.empty()) return std::string(unit);
    if (feature == Feature::bhattacharyya) return "-ln of the overlap";
    const bool of_two_directions = !against_reference && (feature == Feature::hellinger || feature == Feature::chi2);
    return of_two_directions ? "0 to 1.41" : "0 to 1";
}

std::vector<float> with_no_data(algo::Map map, std::span<const std::uint8_t> mask, std::uint8_t no_value) {
    std::vector<float> out(map.begin(), map.end());
    for (std::size_t k = 0; k < out.size(); ++k) {
        if ((mask[k] & no_value) != 0) out[k] = std::numeric_limits<float>::quiet_NaN();
    }
    return out;
}

FeatureViews::FeatureViews(const algo::Inspection& found, const algo::Recipe& recipe, const algo::Extents& extents)
    : found_(found), recipe_(recipe), extents_(extents) {
    add_sums();
    if (recipe.reference) add_z_score();
    if (found.compares) add_gradient();
    add_maps_of_jacobian();
    if (!found.transmission.empty()) add_transmission();
}

// With a reference a gradient is judged less the good part's at the same place.
std::string FeatureViews::limit_text(float limit) const {
    return fmt::format("limit {:.3g}{}", limit, recipe_.reference ? " + good" : "");
}

void FeatureViews::add_sums() {
    sums_.assign(found_.sums.begin(), found_.sums.end());
    mask_of_sums_.assign(found_.mask.begin(), found_.mask.end());
    for (std::uint8_t& bits : mask_of_sums_) {
        bits &= static_cast<std::uint8_t>(~(algo::kDark | algo::kBorder));  // their light is a value like any other
        if ((bits & algo::kSaturated) != 0) bits |= algo::kAtLimit;         // the sum is a lower limit
    }
    FeatureView view{.name = std::string(kSums), .title = "light of each lenslet", .unit = "DN", .map = sums_};
    view.mask = mask_of_sums_;
    view.no_value = 0;
    view.is_light = true;
    others_.push_back(std::move(view));
}

// Rims and lenslets without neighbours are compared, too. kBorder: the reference has nothing to compare with.
void FeatureViews::add_z_score() {
    const std::size_t lenslets = found_.mask.size();
    mask_of_score_.resize(lenslets);
    for (std::size_t k = 0; k < lenslets; ++k) {
        const bool nothing = found_.z_score.empty() || (!found_.compared.empty() && found_.compared[k] == 0);
        mask_of_score_[k] = static_cast<std::uint8_t>((found_.mask[k] & (algo::kSaturated | algo::kOutside)) |
                                                      (nothing ? algo::kBorder : 0));
    }
    FeatureView view{.name = std::string(kZScore), .title = "differs from good parts", .unit = "noises"};
    view.map = found_.z_score;
    if (found_.z_score.empty()) {  // unfit: nothing was compared
        no_scores_.assign(lenslets, 0.0F);
        view.map = no_scores_;
    }
    view.mask = mask_of_score_;
    view.no_value = algo::kSaturated | algo::kOutside | algo::kBorder;
    view.not_judged = algo::kOutside;
    view.limit = recipe_.reject_score;
    view.limit_text = fmt::format("limit {:.3g}", view.limit);
    judged_.push_back(std::move(view));
}

void FeatureViews::add_gradient() {
    const auto title = [](Feature distance) {
        switch (distance) {
            case Feature::emd: return "earth mover's distance";
            case Feature::marginal: return "distance of the marginals";
            case Feature::hellinger: return "Hellinger distance";
            default: return "chi-square distance";
        }
    };
    FeatureView view{.name = std::string(name_of(*found_.compares)),
                     .title = fmt::format("neighbours disagree ({})", title(*found_.compares)),
                     .unit = unit_for_people(*found_.compares),
                     .map = found_.gradient};
    view.mask = found_.mask;
    view.limit = limit_of_gradient(recipe_);
    view.limit_text = limit_text(view.limit);
    judged_.push_back(std::move(view));
}

void FeatureViews::add_maps_of_jacobian() {
    const auto add = [&](Feature feature, const char* title, algo::Map map, std::vector<FeatureView>& to) {
        if (map.empty()) return;
        FeatureView view{.name = std::string(name_of(feature)), .title = title, .unit = unit_for_people(feature)};
        view.map = map;
        view.mask = found_.mask;
        if (feature == Feature::jacobian_frobenius && recipe_.slopes) {
            view.limit = recipe_.frobenius_limit_bins;
            view.limit_text = limit_text(view.limit);
        }
        to.push_back(std::move(view));
    };
    add(Feature::jacobian_frobenius, "slope of the deflection (Jacobian, Frobenius)", found_.frobenius,
        recipe_.slopes ? judged_ : others_);
    add(Feature::jacobian_spectral, "steepest slope (Jacobian, spectral)", found_.spectral, others_);
    add(Feature::jacobian_nuclear, "sum of the slopes (Jacobian, nuclear)", found_.nuclear, others_);
    add(Feature::anisotropy, "anisotropy of the Jacobian", found_.anisotropy, others_);
}

void FeatureViews::add_transmission() {
    constexpr std::uint8_t kMatters = algo::kSaturated | algo::kNotJudged;
    const bool any_light =
        std::ranges::any_of(found_.transmission, [](float value) { return value > 0; });  // else none is typical
    mask_of_light_.resize(found_.mask.size());
    for (std::size_t k = 0; k < mask_of_light_.size(); ++k)
        mask_of_light_[k] = any_light ? found_.mask[k] & kMatters : found_.mask[k] | algo::kDark;
    FeatureView view{.name = std::string(name_of(Feature::transmission)),
                     .title = "light that comes through",
                     .unit = unit_for_people(Feature::transmission),
                     .map = found_.transmission};
    view.mask = mask_of_light_;
    view.no_value = algo::kSaturated | algo::kDark;
    // With a reference the score of the light is judged instead.
    const bool judged = recipe_.light && !recipe_.reference && recipe_.transmission_limit > 0;
    if (judged) {
        view.limit = recipe_.transmission_limit;
        view.limit_text = fmt::format("limit {:.3g}", view.limit);
    }
    (judged ? judged_ : others_).push_back(std::move(view));
}

// The value over its limit, as the inspection judges it (algo/inspection/defects.h, reference_defects.h), without the
// noise allowance for dark places of a part that is compared with a reference.
float FeatureViews::severity(const FeatureView& view, std::size_t k) const {
    if (!view.is_judged(k)) return 0;
    if (view.name == name_of(Feature::transmission)) return std::max(0.0F, (1 - view.map[k]) / (1 - view.limit));
    float value = view.map[k];
    if (recipe_.reference && view.name != kZScore) {
        const algo::PoseMap pose(found_.registered.pose, extents_);
        const int columns = extents_.m, row = static_cast<int>(k) / columns, column = static_cast<int>(k) % columns;
        const auto place = pose.to_reference(column, row);
        const int m = static_cast<int>(std::lround(place.m)), n = static_cast<int>(std::lround(place.n));
        if (m < 0 || n < 0 || m >= columns || n >= extents_.n) return 0;
        const auto& good =
            view.name == name_of(Feature::jacobian_frobenius) ? recipe_.reference->frobenius : recipe_.reference->emd;
        if (!good.empty()) value -= good[extents_.index(m, n)];
    }
    return value / view.limit;
}

bool FeatureViews::in_worst_defect(std::size_t k) const {
    const algo::Defect& d = found_.defects.front();
    const float disc = std::sqrt(static_cast<float>(d.area) * std::numbers::inv_pi_v<float>);
    const float radius = std::max(disc, d.length / 2) + 1.5F;
    const int row = static_cast<int>(k) / extents_.m, column = static_cast<int>(k) % extents_.m;
    return std::hypot(static_cast<float>(column) - d.m, static_cast<float>(row) - d.n) <= radius;
}

const FeatureView& FeatureViews::deciding() const {
    const FeatureView& sums = others_.front();
    if (found_.verdict == algo::Verdict::unfit || judged_.empty()) return sums;
    if (!recipe_.reference && !found_.defects.empty()) {
        const Feature feature = found_.reason == algo::Reason::absorption ? Feature::transmission
            : found_.reason == algo::Reason::deflection_gradient          ? Feature::jacobian_frobenius
                                                                          : found_.compares.value_or(Feature::emd);
        if (const FeatureView* view = find(name_of(feature))) return *view;
    }
    const FeatureView* best = &judged_.front();
    float largest = -1;
    for (const FeatureView& view : judged_) {
        for (std::size_t k = 0; k < view.map.size(); ++k) {
            if (!found_.defects.empty() && !in_worst_defect(k)) continue;
            const float here = severity(view, k);
            if (here <= largest) continue;
            largest = here;
            best = &view;
        }
    }
    return *best;
}

const FeatureView* FeatureViews::find(std::string_view name) const {
    for (const auto* views : {&judged_, &others_}) {
        const auto view = std::ranges::find(*views, name, &FeatureView::name);
        if (view != views->end()) return &*view;
    }
    return nullptr;
}

}  // namespace hord::firmware
