#include "firmware/page/part_picture.h"

#include <algorithm>
#include <numeric>

#include <fmt/format.h>

#include "algo/inspection/pipeline.h"
#include "firmware/diagnostics/feature_views.h"
#include "firmware/diagnostics/map_images.h"
#include "firmware/diagnostics/verdict_text.h"
#include "firmware/store/results/json_text.h"

namespace hord::firmware::page {
namespace {

using store::Json;
using store::to_text;

constexpr std::string_view kSlope = "slope";  // the page's name of the Jacobian's Frobenius norm

std::string_view name_on_page(const FeatureView& view) {
    return view.name == algo::name_of(algo::Feature::jacobian_frobenius) ? kSlope : std::string_view(view.name);
}

// Empty: the view that decided. Null: no map of that name.
const FeatureView* chosen(const FeatureViews& views, const std::string& feature) {
    if (feature.empty()) return &views.deciding();
    const std::string_view name = feature == "surprise" ? kZScore : std::string_view(feature);  // its former name
    for (const FeatureView& view : views.judged()) {
        if (name_on_page(view) == name) return &view;
    }
    return name == kSums || name == name_of(algo::Feature::transmission) ? views.find(name) : nullptr;
}

// The defects that are marked, with their places in the picture and in the field.
Json defects_of(const algo::Inspection& exact, const std::vector<std::string>& labels, const algo::Recipe& recipe,
                const algo::Extents& extents) {
    Json list = Json::array();
    for (std::size_t k = 0; k < labels.size() && k < kMaxMarked; ++k) {
        const algo::Defect& d = exact.defects[k];
        const PicturePoint at = point_in_picture(extents, d.m, d.n);
        Json defect{{"words", labels[k]}, {"m", d.m}, {"n", d.n}, {"kind", algo::name_of(d.kind)}};
        const PictureBox mark = mark_in_picture(extents, exact.defects, labels, k);
        defect["at"] = {at.x, at.y};  // in the picture, px
        defect["mark"] = {mark.x, mark.y, mark.width, mark.height};
        if (recipe.lenslet_mm > 0) {  // from the middle of the field, as in the recipe's zones
            defect["x_mm"] = (d.m - 0.5F * static_cast<float>(extents.m - 1)) * recipe.lenslet_mm;
            defect["y_mm"] = (d.n - 0.5F * static_cast<float>(extents.n - 1)) * recipe.lenslet_mm;
        }
        list.push_back(std::move(defect));
    }
    return list;
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
    const store::Judgement now = store::judgement_of(*inspection), &then = kept.metadata.judgement;
    const algo::Recipe recipe = replay_.recipe();
    const algo::Extents& extents = kept.metadata.grid;
    // What is shown is exact everywhere; the verdict alone does without.
    const FrameView frame = kept.frame.frame.view();
    auto pipeline = algo::Pipeline::create(extents, frame.bits, recipe, 1, algo::MapSet::all);
    if (!pipeline) return tl::unexpected(pipeline.error());
    const auto exact = pipeline->inspect(frame);
    if (!exact) return tl::unexpected(exact.error());
    const FeatureViews views(*exact, recipe, extents);
    const FeatureView* shown = chosen(views, feature);
    if (shown == nullptr) {
        std::string names;
        for (const FeatureView& view : views.judged()) names += std::string(name_on_page(view)) + ", ";
        return fail(ErrorCode::invalid_argument, "there is no map of that name",
                    "ask for one of " + names + std::string(kSums));
    }

    const std::vector<std::string> labels = labels_of(*exact, recipe);
    const std::string sentence = explain(*exact, recipe, extents);
    const Picture picture = hord::firmware::draw(scale_to(shown->title, *shown, recipe), shown->map, shown->mask,
                                                 extents, exact->defects, labels);
    auto png = encode_png(picture);
    if (!png) return tl::unexpected(png.error());

    Json found{{"part", kept.metadata.part},
               {"verdict", now.verdict},
               {"reason", now.reason},
               {"score", now.score},
               {"sentence", sentence},
               {"map", name_on_page(*shown)},
               {"width", picture.width},
               {"height", picture.height},
               {"same_as_then", now.maps_sha256 == then.maps_sha256 && now.verdict == then.verdict}};
    found["maps"] = Json::array();
    for (const FeatureView& view : views.judged())
        found["maps"].push_back({{"name", name_on_page(view)}, {"title", view.title}});
    found["maps"].push_back({{"name", kSums}, {"title", "light"}});
    found["defects"] = defects_of(*exact, labels, recipe, extents);
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
