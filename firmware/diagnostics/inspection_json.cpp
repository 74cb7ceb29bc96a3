#include "firmware/diagnostics/inspection_json.h"

#include <algorithm>
#include <vector>

#include <fmt/format.h>

#include "firmware/diagnostics/verdict_text.h"
#include "firmware/store/results/records.h"

namespace hord::firmware {
namespace {

using store::Json;

constexpr int kSchema = 1;  // of the object

struct Statistics {
    float min = 0, p50 = 0, p99 = 0, max = 0;
    std::size_t valid = 0;  // 0: the others are not known
};

// Over the lenslets that are judged.
Statistics statistics_of(const FeatureView& view) {
    std::vector<float> values;
    for (std::size_t k = 0; k < view.map.size(); ++k) {
        if (view.is_judged(k)) values.push_back(view.map[k]);
    }
    if (values.empty()) return {};
    std::sort(values.begin(), values.end());
    const auto at = [&](double share) {
        return values[static_cast<std::size_t>(share * static_cast<double>(values.size() - 1))];
    };
    return {values.front(), at(0.50), at(0.99), values.back(), values.size()};
}

Json to_json(const FeatureView& feature, double bin_rad) {
    const Statistics s = statistics_of(feature);
    const auto known = [&](auto value) { return s.valid > 0 ? Json(value) : Json(); };
    Json json{{"name", feature.name}, {"unit", feature.unit}, {"min", known(s.min)}, {"p50", known(s.p50)},
              {"p99", known(s.p99)},  {"max", known(s.max)},  {"valid", s.valid}};
    if (bin_rad > 0 && (feature.unit == "bin pitches" || feature.unit == "bin pitches a lenslet")) {
        json["bin_rad"] = bin_rad;
        json["rad"] = {
            {"p50", known(s.p50 * bin_rad)}, {"p99", known(s.p99 * bin_rad)}, {"max", known(s.max * bin_rad)}};
    }
    return json;
}

double milliseconds(std::int64_t ns) { return static_cast<double>(ns) / 1e6; }

// What the checks of the whole frame measured.
Json light_json(const algo::Inspection& found) {
    const algo::FrameFindings& f = found.frame;
    Json json{{"dark_dn", found.dark_dn}};
    if (f.dark_measured) {
        json["pedestal_dn"] = f.pedestal_dn;
        json["dark_noise_dn"] = f.dark_noise_dn;
    }
    if (f.spot_measured) {
        json["free"] = f.in_free_light;
        json["offset_bins"] = {f.x_bins, f.y_bins};
        json["spot_bins"] = {f.spot_x_bins, f.spot_y_bins};
        json["second_share"] = f.second_share;
        json["lit_share"] = f.lit_share;
    }
    if (f.period_x > 0 || f.period_y > 0) json["period"] = {f.period_x, f.period_y};
    return json;
}

}  // namespace

store::Json recipe_json(const NumberedRecipe& recipe) {
    return {{"name", recipe.recipe.name},
            {"number", recipe.number},
            {"version", recipe.version},
            {"crc32", fmt::format("{:08X}", crc32_of(recipe))}};
}

store::Json inspection_json(const algo::Inspection& found, const FeatureView& feature, double bin_rad,
                            const algo::Recipe& recipe, const store::Json& judged_by, const algo::Extents& extents) {
    Json defects = store::to_json(found.defects);
    for (std::size_t k = 0; k < found.defects.size(); ++k) {
        const algo::Defect& d = found.defects[k];
        Json& defect = defects[k];
        defect["size"] = size_of(d);
        if (recipe.reference) {
            defect["score"] = d.score;
            defect["length"] = d.length;
            defect["width"] = d.width;
            defect["radius"] = algo::radius_of(d);
        }
        if (recipe.lenslet_mm > 0) {
            const auto from_middle = [&](float at, int count) {
                return (at - 0.5F * static_cast<float>(count - 1)) * recipe.lenslet_mm;
            };
            defect["size_mm"] = size_of(d) * recipe.lenslet_mm;
            defect["x_mm"] = from_middle(d.m, extents.m);
            defect["y_mm"] = from_middle(d.n, extents.n);
            if (recipe.reference) defect["radius_mm"] = algo::radius_of(d) * recipe.lenslet_mm;
            defect["area_mm2"] = static_cast<float>(d.area) * recipe.lenslet_mm * recipe.lenslet_mm;
        }
    }
    Json json{{"schema", kSchema},
              {"software", HORD_VERSION},
              {"grid", {{"m", extents.m}, {"n", extents.n}, {"i", extents.i}, {"j", extents.j}}},
              {"verdict", name_of(found.verdict)},
              {"reason", name_of(found.reason)},
              {"score", found.score},
              {"defects", defects},
              {"explain", explain(found, recipe, extents)},
              {"light", light_json(found)},
              {"feature", to_json(feature, bin_rad)},
              {"ms",
               {{"decode", milliseconds(found.times.decode_ns)},
                {"hord", milliseconds(found.times.hord_ns)},
                {"feature",
                 milliseconds(found.times.feature_ns + found.times.register_ns + found.times.compare_ns +
                              found.times.bound_ns)},
                {"decide", milliseconds(found.times.decide_ns)},
                {"total", milliseconds(found.times.total_ns)}}},
              {"recipe", judged_by}};
    if (found.bounded) json["bounded"] = true;
    if (found.has_bounds && found.compares && feature.name == name_of(*found.compares))
        json["feature"]["bounds"] = true;
    if (recipe.reference && found.registered.found()) {
        json["pose"] = {{"x", found.registered.pose.x},
                        {"y", found.registered.pose.y},
                        {"turn_rad", found.registered.pose.turn_rad()},
                        {"light", found.registered.light}};
    }
    return json;
}

}  // namespace hord::firmware
