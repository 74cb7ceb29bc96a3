#include "firmware/page/part_picture.h"

#include <algorithm>
#include <numeric>
#include <optional>

#include <fmt/format.h>

#include "algo/inspection/pipeline.h"
#include "firmware/diagnostics/map_images.h"
#include "firmware/diagnostics/verdict_text.h"
#include "firmware/store/results/json_text.h"

namespace hord::firmware::page {
namespace {

using store::Json;
using store::to_text;

struct FeatureView {
    std::string name, title, unit;
    algo::Map map;
    float limit;
};

std::string_view title_of(algo::Feature distance) {
    switch (distance) {
        case algo::Feature::emd: return "earth mover's distance";
        case algo::Feature::marginal: return "distance of the marginals";
        case algo::Feature::hellinger: return "Hellinger distance";
        default: return "chi-square distance";
    }
}

// The maps of the recipe's features; with a reference alone the z-scores (`nothing`, zeros, if nothing was compared).
std::vector<FeatureView> views_of(const algo::Inspection& found, const algo::Recipe& recipe,
                                  std::vector<float>& nothing) {
    std::vector<FeatureView> views;
    if (found.compares) {
        const std::string_view unit = algo::unit_of(*found.compares);
        views.push_back({std::string(name_of(*found.compares)),
                         fmt::format("neighbours disagree ({})", title_of(*found.compares)), std::string(unit),
                         found.gradient, limit_of_gradient(recipe)});
    }
    if (recipe.slopes)
        views.push_back({"slope", "slope of the deflection (Jacobian, Frobenius)", "bin pitches a lenslet",
                         found.frobenius, recipe.frobenius_limit_bins});
    if (recipe.light)
        views.push_back({"transmission", "light that comes through", "of a typical lenslet", found.transmission,
                         recipe.transmission_limit});
    if (recipe.reference && !found.compares) {
        if (found.z_score.empty()) nothing.assign(found.mask.size(), 0.0F);
        views.push_back({"z-score", "differs from good parts", "noises",
                         found.z_score.empty() ? algo::Map(nothing) : found.z_score, recipe.reject_score});
    }
    return views;
}

// Empty: no map of that name.
std::optional<FeatureView> chosen(const std::vector<FeatureView>& views, const std::string& feature,
                                  algo::Reason reason) {
    const auto named = [&](std::string_view name) { return std::ranges::find(views, name, &FeatureView::name); };
    auto found = named(feature == "surprise"                             ? "z-score"  // its former name
                           : !feature.empty()                            ? std::string_view(feature)
                           : reason == algo::Reason::deflection_gradient ? "slope"
                           : reason == algo::Reason::absorption          ? "transmission"
                                                                         : "");
    if (found == views.end() && feature.empty()) found = views.begin();
    if (found == views.end()) return std::nullopt;
    return *found;
}

}  // namespace

Result<std::shared_ptr<const DrawnPart>> PartPictures::draw(const KeptFrame& kept, const std::string& feature) {
    const std::lock_guard lock(mutex_);
    const std::string id = kept.name + " " + feature;
    for (const auto& [cached_id, drawn] : drawn_) {
        if (cached_id == id) return drawn;
    }
    const auto inspection = replay_.inspect(kept.frame.frame.view(), kept.metadata, kept.name);
    if (!inspection) return tl::unexpected(inspection.error());
    const algo::Recipe& recipe = replay_.recipe();
    const algo::Extents& extents = kept.metadata.grid;
    std::vector<float> nothing;
    const std::vector<FeatureView> views = views_of(*inspection, recipe, nothing);
    const auto shown = chosen(views, feature, inspection->reason);
    if (!shown) {
        std::string names;
        for (const FeatureView& view : views) names += (names.empty() ? "" : ", ") + view.name;
        return fail(ErrorCode::invalid_argument, "there is no map of that name", "ask for one of " + names);
    }

    const std::vector<std::string> labels = labels_of(*inspection, recipe);
    const std::string sentence = explain(*inspection, recipe, extents);
    const Picture picture =
        hord::firmware::draw(scale_to(shown->title, shown->unit, shown->map, inspection->mask, shown->limit),
                             shown->map, inspection->mask, extents, inspection->defects, labels);
    auto png = encode_png(picture);
    if (!png) return tl::unexpected(png.error());

    const store::Judgement now = store::judgement_of(*inspection), &then = kept.metadata.judgement;
    Json found{{"part", kept.metadata.part},
               {"verdict", now.verdict},
               {"reason", now.reason},
               {"score", now.score},
               {"sentence", sentence},
               {"map", shown->name},
               {"width", picture.width},
               {"height", picture.height},
               {"same_as_then", now.maps_sha256 == then.maps_sha256 && now.verdict == then.verdict}};
    Json list = Json::array();
    for (std::size_t k = 0; k < labels.size() && k < 20; ++k) {
        const algo::Defect& d = inspection->defects[k];
        list.push_back({{"words", labels[k]}, {"m", d.m}, {"n", d.n}, {"kind", algo::name_of(d.kind)}});
    }
    found["defects"] = std::move(list);
    found["defect_count"] = labels.size();
    auto drawn = std::make_shared<const DrawnPart>(DrawnPart{std::move(*png), to_text(found)});
    drawn_.emplace_front(id, drawn);
    if (drawn_.size() > kMaxCached) drawn_.pop_back();
    return drawn;
}

double brightest_share(const FrameView& frame) {
    const std::uint32_t full = frame.full_scale();
    std::vector<std::uint64_t> counts(full + 1);
    for (int y = 0; y < frame.height_px; ++y) {
        for (int x = 0; x < frame.width_px; ++x) ++counts[std::min(frame.sample(x, y), full)];
    }
    const std::uint64_t all = std::accumulate(counts.begin(), counts.end(), std::uint64_t{0});
    std::uint64_t above = 0;
    std::uint32_t value = full;
    while (value > 0 && (above += counts[value]) <= all / 1000) --value;
    return static_cast<double>(value) / full;
}

}  // namespace hord::firmware::page
