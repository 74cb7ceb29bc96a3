#include "firmware/diagnostics/verdict_hints.h"

#include <algorithm>
#include <cmath>
#include <numbers>

#include <fmt/format.h>

#include "algo/frame/mask.h"
#include "algo/inspection/frame_checks.h"
#include "algo/inspection/rim.h"
#include "algo/reference/pose_tolerance.h"
#include "firmware/diagnostics/along_outline.h"

namespace hord::firmware {
namespace {

constexpr std::size_t kSteepPartOf = 8;  // a place of 1/8 of the judged lenslets is no usual defect

// Lenslet (m, n) lies within three lenslets of the rim.
bool is_beside_rim(const algo::Inspection& found, const algo::Extents& e, int m, int n) {
    constexpr int kNear = 3;
    if (found.mask.empty()) return false;
    bool any = false;
    e.for_each_around(m, n, kNear, [&](int x, int y) { any = any || (found.mask[e.index(x, y)] & algo::kRim) != 0; });
    return any;
}

// The worst defect's middle does.
bool is_beside_rim(const algo::Inspection& found, const algo::Extents& e) {
    const algo::Defect& d = found.defects[0];
    return is_beside_rim(found, e, static_cast<int>(std::lround(d.m)), static_cast<int>(std::lround(d.n)));
}

int margin_of(const algo::Recipe& recipe, const algo::Extents& e) {
    return recipe.rim_margin < 0 ? algo::default_rim_margin(e) : recipe.rim_margin;
}

// A bevel that is wider than the rim's margin is dark along the outline.
std::string dark_edge_hint(const algo::Inspection& found, const algo::Recipe& recipe, const algo::Extents& e) {
    const AlongOutline edge = dark_along_outline(found, recipe, e);
    if (edge.width == 0) return "";
    return fmt::format(
        " It is dark along {:.0f} % of the outline, up to {} lenslets beyond the rim: if good parts have such a bevel, "
        "set rim_margin = {}.",
        100 * edge.share, edge.width, margin_of(recipe, e) + edge.width);
}

// The bevel of a plate may bend light beyond the rim's margin.
std::string bent_edge_hint(const algo::Inspection& found, const algo::Recipe& recipe, const algo::Extents& e) {
    constexpr const char* kCause =
        " There it may be a bevel that bends light: if good plates have it, learn a reference (hordctl learn), or";
    const auto edge = defect_along_outline(found, recipe, e);
    if (edge && edge->width > 0)
        return fmt::format("{} set rim_margin = {}{}, which hides more of what moves.", kCause,
                           margin_of(recipe, e) + edge->width, edge->at_least ? " or wider" : "");
    if (!edge && !is_beside_rim(found, e)) return "";
    return fmt::format("{} set rim_margin wider.", kCause);
}

// Of a part that is compared with a reference: the worst defect lies at an edge that its pose moves farther than the
// reference allows (algo/reference/pose_tolerance.h).
std::string moved_edge(const algo::Inspection& found, const algo::Recipe& recipe, const algo::Extents& e) {
    constexpr double kNear = 1.5;  // lenslets
    if (!found.registered.found() || found.defects.empty()) return "";
    const algo::Pose& pose = found.registered.pose;
    const algo::Defect& worst = found.defects.front();
    const auto at = algo::PoseMap(pose, e).to_reference(static_cast<double>(worst.m), static_cast<double>(worst.n));
    const auto near = [&](int m, int n) { return std::hypot(m - at.m, n - at.n) <= kNear; };
    if (!algo::moves_edges_too_far(*recipe.reference, pose, static_cast<double>(recipe.reject_score), near)) return "";
    return fmt::format(
        " An edge of the part is there, and the part lies {:.2f} lenslets and {:.1f} degrees from the reference's "
        "pose: "
        "if it is good, learn from parts that lie as differently.",
        std::hypot(pose.x, pose.y), std::abs(pose.turn_rad()) * 180 / std::numbers::pi);
}

}  // namespace

bool is_along_tube(const algo::Inspection& found, const algo::Recipe& recipe, const algo::Extents& e) {
    return recipe.form == algo::PartForm::tube && !recipe.reference && found.reason != algo::Reason::absorption &&
        2 * found.defects[0].length >= static_cast<float>(std::min(e.m, e.n));
}

// What the reason of a reject may be beside a defect, as a sentence of its own; "": nothing.
std::string hint(const algo::Inspection& found, const algo::Recipe& recipe, const algo::Extents& e) {
    // In so little light a lenslet's own spot may be one sample.
    const bool is_dim = static_cast<double>(found.frame.lost_share) > algo::kMaxLostLight;
    const algo::LoneSample& lone = found.lone_sample;
    if (lone.dn > 0 && !is_dim) {
        return fmt::format(
            " Sample ({}, {}) of the macro-pixels alone reads {} DN more than all around it: if it does in every "
            "frame, a pixel of the sensor is warm there; have the camera correct it, or cool the sensor.",
            lone.x, lone.y, lone.dn);
    }
    if (recipe.reference) return moved_edge(found, recipe, e);
    const auto dim_hint = [&] {
        return fmt::format(
            " The dark level, {} DN, takes {:.0f} % of the light: raise the light's current, the exposure or the gain "
            "before the part is judged.{}",
            found.dark_dn, 100 * found.frame.lost_share, fewer_bits_hint(found.frame));
    };
    const bool light_is_there = found.reason != algo::Reason::absorption;
    // A bevel bends bright light as far as faint light.
    if (recipe.form == algo::PartForm::plate && light_is_there) {
        if (std::string text = bent_edge_hint(found, recipe, e); !text.empty()) return text;
    }
    if (is_dim) return dim_hint();
    if (is_along_tube(found, recipe, e))
        return " What goes on along the tube may be the slope of the tube and what is in it, which single "
               "frames cannot tell from a defect: learn a reference (hordctl learn), use wider bins, or raise "
               "the limits.";
    if (recipe.form == algo::PartForm::tube && light_is_there && is_beside_rim(found, e))
        return " Beside a flank it may be the tube's wall, which single frames cannot tell from a defect: if "
               "good tubes have it, learn a reference (hordctl learn).";
    const auto is_line = [](const algo::Defect& d) { return d.kind == algo::DefectKind::scratch; };
    const auto side = static_cast<float>(std::min(e.m, e.n));
    if ((recipe.form == algo::PartForm::plate || recipe.form == algo::PartForm::round) && !light_is_there) {
        // Where the dark level takes a tenth of the light, it makes edges wider: a wider margin would be no cure.
        constexpr float kWidensEdges = 0.1F;
        if (is_mostly_dark(found, recipe))
            return " Most of the part is that dark beside its brightest tenth, which may be a hole in tinted glass.";
        if (std::string text = dark_edge_hint(found, recipe, e); !text.empty())
            return found.frame.lost_share < kWidensEdges ? text : dim_hint();
    }
    if (recipe.form == algo::PartForm::plate && is_line(found.defects[0]) && is_beside_rim(found, e))
        return " A line along an edge may be the plate's bevel: set rim_margin wider, or show the plate square to "
               "the light.";
    if (recipe.form == algo::PartForm::round && light_is_there && found.lenslets.judged > 0 &&
        kSteepPartOf * found.defects[0].area >= found.lenslets.judged)
        return " So large a place may be the slope of the part itself: if good parts have it, use wider bins, or raise "
               "the limits (hordctl tune).";
    if (recipe.form != algo::PartForm::round || found.defects.size() < 2) return "";
    const auto [shorter, longer] = std::minmax(found.defects[0].length, found.defects[1].length);
    const bool flanks =
        is_line(found.defects[0]) && is_line(found.defects[1]) && 3 * shorter >= side && 4 * longer <= 5 * shorter;
    return flanks
        ? " Two lines of one length may be the flanks of a tube: set [part] form = \"tube\" if the part is one."
        : "";
}

std::string fewer_bits_hint(const algo::FrameFindings& frame) {
    if (frame.fewer_bits == 0) return "";
    return fmt::format(
        " No sample exceeds {}, as if they had {} bits: see what the camera sends, and set sensor.bits (or "
        "--bits) to it.",
        (1 << frame.fewer_bits) - 1, frame.fewer_bits);
}

// With a reference: moved optics move the light of the part and of the free light beside it alike. Free light of good
// parts lies within 0.002 bins of where the reference had it, at 2000 electrons a lenslet.
std::string moved_optics(const algo::Inspection& found) {
    constexpr float kMovedBins = 0.015F;
    const float x = found.frame.x_bins, y = found.frame.y_bins;
    if (!found.registered.found() || found.defects.front().kind != algo::DefectKind::surface ||
        !found.frame.in_free_light || std::max(std::abs(x), std::abs(y)) < kMovedBins)
        return {};
    return fmt::format(
        " The free light beside the part moved by {:.2f} bins, too: see whether the optics moved, calibrate again, or "
        "learn the reference anew.",
        std::hypot(x, y));
}

}  // namespace hord::firmware
