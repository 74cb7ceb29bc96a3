#include "algo/frame/direction_map.h"

#include <cmath>
#include <string>

namespace hord::algo {
namespace {

LensletGrid model_of(const DirectionMap& map) {
    LensletGrid grid;
    grid.model = map.model;
    grid.parameters = map.parameters;
    grid.middle_x_px = map.zero_px.x_px;  // distortion is about undeflected light
    grid.middle_y_px = map.zero_px.y_px;
    grid.radius_px = map.radius_px;
    return grid;
}

}  // namespace

PixelPoint DirectionMap::place_px(DirectionRad direction) const {
    const LensletGrid grid = model_of(*this);
    const PixelPoint at = grid.at({direction.x_rad / span_rad, direction.y_rad / span_rad});
    const PixelPoint zero = grid.at({0, 0});
    return {at.x_px - zero.x_px + zero_px.x_px, at.y_px - zero.y_px + zero_px.y_px};
}

LensletGrid::Steps DirectionMap::px_a_rad(DirectionRad direction) const {
    const LensletGrid grid = model_of(*this);
    const double half = 0.5e-3;  // of the span
    const auto [u, v] = LensletGrid::Uv{direction.x_rad / span_rad, direction.y_rad / span_rad};
    const PixelPoint right = grid.at({u + half, v}), left = grid.at({u - half, v});
    const PixelPoint below = grid.at({u, v + half}), above = grid.at({u, v - half});
    const double a_step = 1 / (2 * half * span_rad);
    return {{a_step * (right.x_px - left.x_px), a_step * (right.y_px - left.y_px)},
            {a_step * (below.x_px - above.x_px), a_step * (below.y_px - above.y_px)}};
}

Result<void> check(const DirectionMap& map) {
    const auto bad = [](std::string what) {
        return fail(ErrorCode::invalid_argument, std::move(what),
                    "calibrate again, or use an unchanged calibration file");
    };
    if (static_cast<int>(map.parameters.size()) != parameter_count(map.model)) {
        return bad("a " + std::string(name_of(map.model)) + " direction map with " +
                   std::to_string(map.parameters.size()) + " parameters, not " +
                   std::to_string(parameter_count(map.model)));
    }
    for (const double p : map.parameters) {
        if (!std::isfinite(p)) return bad("a parameter of the direction map that is not a number");
    }
    if (!(map.span_rad > 0) || !(map.radius_px > 0)) return bad("a direction map whose scale is not positive");
    if (!std::isfinite(map.zero_px.x_px) || !std::isfinite(map.zero_px.y_px))
        return bad("a direction map without a place of undeflected light");
    if (!(map.px_a_rad({}).area_px2() > 0)) return bad("a direction map that folds directions onto one another");
    return {};
}

BinLayout even_layout(const LensletGrid& grid, int bins_i, int bins_j) {
    const double pitch = grid.steps_px({0, 0}).mean_px();
    BinLayout layout{bins_i, bins_j, {}, pitch / bins_i, pitch / bins_j, 0, 0};
    for (int j = 0; j < bins_j; ++j) {
        for (int i = 0; i < bins_i; ++i)
            layout.offsets_px.push_back(
                {(i - 0.5 * (bins_i - 1)) * layout.box_x_px, (j - 0.5 * (bins_j - 1)) * layout.box_y_px});
    }
    return layout;
}

BinLayout layout_of(const LensletGrid& grid, const DirectionMap& map, int bins_i, int bins_j) {
    const double pitch = grid.steps_px({0, 0}).mean_px();
    const LensletGrid::Steps steps = map.px_a_rad({});
    BinLayout layout{bins_i, bins_j, {}, pitch / bins_i, pitch / bins_j, 0, 0};
    layout.step_i_rad = layout.box_x_px / steps.along_u.x_px;
    layout.step_j_rad = layout.box_y_px / steps.along_v.y_px;
    for (int j = 0; j < bins_j; ++j) {
        for (int i = 0; i < bins_i; ++i) {
            layout.offsets_px.push_back(map.place_px(
                {(i - 0.5 * (bins_i - 1)) * layout.step_i_rad, (j - 0.5 * (bins_j - 1)) * layout.step_j_rad}));
        }
    }
    return layout;
}

}  // namespace hord::algo
