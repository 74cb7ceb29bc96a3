#include "firmware/page/part_picture.h"

#include <algorithm>
#include <optional>

#include <fmt/format.h>

#include "algo/inspection/pipeline.h"
#include "firmware/diagnostics/map_images.h"
#include "firmware/diagnostics/verdict_text.h"
#include "firmware/recipes/recipe_file.h"
#include "firmware/store/frames/frame_retention.h"
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

struct PartPictures::Parts {
    std::string pipeline_key;  // extents, depth and recipe that `pipeline` was made for
    algo::Recipe recipe;
    std::optional<algo::Pipeline> pipeline;
};

PartPictures::PartPictures() : parts_(std::make_unique<Parts>()) {}
PartPictures::~PartPictures() = default;

Result<std::shared_ptr<const DrawnPart>> PartPictures::draw(const KeptFrame& kept, const std::string& feature) {
    const std::lock_guard lock(mutex_);
    const std::string id = kept.name + " " + feature;
    for (const auto& [cached_id, drawn] : drawn_) {
        if (cached_id == id) return drawn;
    }
    const auto unreadable = [&](const std::string& why) {
        return fail(ErrorCode::unreadable, kept.name + " has metadata that cannot be read (" + why + ")",
                    "it is no frame that a station has kept");
    };
    algo::Extents extents;
    std::string recipe_text, verdict_then, maps_then;
    std::uint32_t part = 0;
    try {
        const Json metadata = Json::parse(kept.frame.metadata);
        const Json& grid = metadata.at("grid");
        extents = {grid.at("m").get<int>(), grid.at("n").get<int>(), grid.at("i").get<int>(), grid.at("j").get<int>()};
        recipe_text = metadata.at("recipe").get<std::string>();
        verdict_then = metadata.at("verdict").get<std::string>();
        maps_then = metadata.at("maps_sha256").get<std::string>();
        part = metadata.at("part").get<std::uint32_t>();
    } catch (const Json::exception& error) {
        return unreadable(error.what());
    }
    const FrameView frame = kept.frame.frame.view();
    Parts& p = *parts_;
    std::string key =
        fmt::format("{}x{} {}x{} {} {}", extents.m, extents.n, extents.i, extents.j, frame.bits, recipe_text);
    if (!p.pipeline || p.pipeline_key != key) {
        p.pipeline.reset();
        auto recipe = parse_recipe(recipe_text, kept.name);
        if (!recipe) return tl::unexpected(recipe.error());
        auto pipeline = algo::Pipeline::create(extents, frame.bits, *recipe);
        if (!pipeline) return tl::unexpected(pipeline.error());
        p.recipe = std::move(*recipe);
        p.pipeline.emplace(std::move(*pipeline));
        p.pipeline_key = std::move(key);
    }
    const auto inspection = p.pipeline->inspect(frame);
    if (!inspection) return tl::unexpected(inspection.error());
    std::vector<float> nothing;
    const std::vector<FeatureView> views = views_of(*inspection, p.recipe, nothing);
    const auto shown = chosen(views, feature, inspection->reason);
    if (!shown) {
        std::string names;
        for (const FeatureView& view : views) names += (names.empty() ? "" : ", ") + view.name;
        return fail(ErrorCode::invalid_argument, "there is no map of that name", "ask for one of " + names);
    }

    const std::vector<std::string> labels = labels_of(*inspection, p.recipe);
    const std::string sentence = explain(*inspection, p.recipe, extents);
    const Picture picture =
        hord::firmware::draw(scale_to(shown->title, shown->unit, shown->map, inspection->mask, shown->limit),
                             shown->map, inspection->mask, extents, inspection->defects, labels);
    auto png = encode_png(picture);
    if (!png) return tl::unexpected(png.error());

    Json found{{"part", part},
               {"verdict", algo::name_of(inspection->verdict)},
               {"reason", algo::name_of(inspection->reason)},
               {"score", inspection->score},
               {"sentence", sentence},
               {"map", shown->name},
               {"width", picture.width},
               {"height", picture.height},
               {"same_as_then",
                store::digest_of_maps(*inspection) == maps_then && algo::name_of(inspection->verdict) == verdict_then}};
    Json list = Json::array();
    for (std::size_t k = 0; k < labels.size() && k < 20; ++k) {
        const algo::Defect& d = inspection->defects[k];
        list.push_back({{"words", labels[k]}, {"m", d.m}, {"n", d.n}, {"kind", algo::name_of(d.kind)}});
    }
    found["defects"] = std::move(list);
    found["defect_count"] = labels.size();
    auto drawn = std::make_shared<const DrawnPart>(DrawnPart{kept.name, std::move(*png), to_text(found)});
    drawn_.emplace_front(id, drawn);
    if (drawn_.size() > kMaxCached) drawn_.pop_back();
    return drawn;
}

double brightest_share(const FrameView& frame) {
    const int full = (1 << frame.bits) - 1;
    std::vector<std::uint32_t> counts(static_cast<std::size_t>(full) + 1);
    std::uint64_t all = 0;
    for (int y = 0; y < frame.height_px; ++y) {
        const std::byte* row = frame.data + y * frame.stride_bytes;
        for (int x = 0; x < frame.width_px; ++x, ++all) {
            int value = 0;
            if (frame.bits > 8) value = reinterpret_cast<const std::uint16_t*>(row)[x];
            else value = static_cast<int>(row[x]);
            ++counts[static_cast<std::size_t>(std::min(value, full))];
        }
    }
    std::uint64_t above = 0;
    int value = full;
    while (value > 0 && (above += counts[static_cast<std::size_t>(value)]) <= all / 1000) --value;
    return static_cast<double>(value) / full;
}

}  // namespace hord::firmware::page
