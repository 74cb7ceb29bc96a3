#include "firmware/diagnostics/verdict_text.h"

#include <algorithm>
#include <cmath>
#include <numbers>
#include <utility>
#include <vector>

#include <fmt/format.h>

#include "algo/frame/mask.h"
#include "algo/inspection/frame_checks.h"
#include "algo/inspection/reference_defects.h"
#include "algo/inspection/rim.h"
#include "algo/reference/pose_tolerance.h"

namespace hord::firmware {
namespace {

std::string length_text(float lenslets, const algo::Recipe& recipe) {
    return recipe.lenslet_mm > 0 ? fmt::format("{:.2g} mm", lenslets * recipe.lenslet_mm)
                                 : fmt::format("{:.1f} lenslets", lenslets);
}

std::string place_text(const algo::Defect& d, const algo::Recipe& recipe, const algo::Extents& e) {
    const float m = d.m - 0.5F * static_cast<float>(e.m - 1), n = d.n - 0.5F * static_cast<float>(e.n - 1);
    if (recipe.lenslet_mm > 0) return fmt::format("({:.2f}, {:.2f}) mm", m * recipe.lenslet_mm, n * recipe.lenslet_mm);
    return fmt::format("lenslet ({:.1f}, {:.1f})", d.m, d.n);
}

// A value on the wrong side of its limit, with as many digits as tell them apart.
std::string beyond(double value, double limit, int digits = 0) {
    constexpr int kMaxDigits = 4;
    std::string text = fmt::format("{:.{}f}", value, digits);
    while (digits < kMaxDigits && text == fmt::format("{:.{}f}", limit, digits))
        text = fmt::format("{:.{}f}", value, ++digits);
    return text;
}

std::string beyond_percent(float share, double limit) { return beyond(100 * static_cast<double>(share), 100 * limit); }

std::string_view what_is(const algo::Defect& defect) {
    const algo::DefectKind kind = defect.kind;
    if (defect.weak && kind == algo::DefectKind::scattering) return "haze";
    if (defect.weak && kind == algo::DefectKind::surface && defect.length >= algo::kScratchLength) return "a stria";
    switch (kind) {
        case algo::DefectKind::scattering: return "a scattering defect";
        case algo::DefectKind::absorbing: return "an absorbing defect";
        case algo::DefectKind::surface: return "a surface defect";
        case algo::DefectKind::scratch: return "a scratch";
        case algo::DefectKind::unknown: break;
    }
    return "a defect";
}

// What is wrong with the light, and the cure.
std::string light_fault(const algo::FrameFindings& f, const algo::Recipe& recipe, const algo::Extents& e) {
    switch (f.fault) {
        case algo::FrameFault::pedestal:
            return fmt::format(
                "the dark bins read {} DN (at most {:.0f}): keep stray light out, lower the sensor's black level, "
                "or raise [light] max_dark_rise_dn",
                beyond(static_cast<double>(f.pedestal_dn), static_cast<double>(f.dark_limit_dn), 1), f.dark_limit_dn);
        case algo::FrameFault::noise:
            return fmt::format(
                "the frame is too noisy: the dark bins vary by {:.1f} DN about {:.1f} DN, and {:.0f} DN would have to "
                "be subtracted (at most {:.0f}): lower the sensor's gain, cool it, or raise [light] max_dark_rise_dn",
                f.dark_noise_dn, f.pedestal_dn, f.wanted_dark_dn, f.noise_limit_dn);
        case algo::FrameFault::off_centre: {
            const bool across = std::abs(f.x_bins) >= std::abs(f.y_bins);
            const float by = across ? f.x_bins : f.y_bins;
            const std::string_view where =
                across ? (by > 0 ? "to the right of" : "to the left of") : (by > 0 ? "below" : "above");
            return fmt::format(
                "the free light is {} bins {} the middle (at most {:.2g}): calibrate again, or check that nothing "
                "moved",
                beyond(static_cast<double>(std::abs(by)), static_cast<double>(recipe.max_offset_bins), 2), where,
                recipe.max_offset_bins);
        }
        case algo::FrameFault::wide_spot:
            return fmt::format(
                "spots are {:.1f} x {:.1f} bins wide (at most {:.1f}): focus the collimator and the "
                "lenslets, or raise [light] max_spot_bins for a wide source",
                f.spot_x_bins, f.spot_y_bins, recipe.max_spot_bins);
        case algo::FrameFault::wide_inside:
            return fmt::format(
                "spots between the edges are {:.1f} x {:.1f} bins wide, beside them {:.1f} x {:.1f}: a plate makes "
                "none "
                "wider; check that it is there and does not scatter light all over (haze, a rough face, dirt), or "
                "learn "
                "a reference (hordctl learn)",
                f.inside_x_bins, f.inside_y_bins, f.spot_x_bins, f.spot_y_bins);
        case algo::FrameFault::fog_beside:
            return fmt::format(
                "bins without light read {:.1f} DN beside the part and {:.1f} DN behind it, where no glass takes light "
                "away: keep fog and stray light out, or learn a reference (hordctl learn)",
                f.floor_dn, f.inside_floor_dn);
        case algo::FrameFault::second_spot:
            return fmt::format(
                "{:.0f} % of the light is in a second spot: look for a reflection, a second lamp, two exposures "
                "in one frame, or light of the next lenslet (calibrate again)",
                100 * f.second_share);
        case algo::FrameFault::alternating: {
            const bool halves = 4 * f.alternation_bins > static_cast<float>(std::min(e.i, e.j));
            return fmt::format(
                "neighbouring lenslets differ in turn, by {:.2f} bins or {:.0f} % of their light: {}look for "
                "interlaced exposures, and for taps of the sensor that differ{}",
                2 * f.alternation_bins, 200 * f.alternation_light,
                halves ? fmt::format("macro-pixels of {0}x{1}, {0}x{3} or {2}x{1} samples do so: give --macro; else ",
                                     2 * e.i, 2 * e.j, e.i, e.j)
                       : "",
                recipe.form == algo::PartForm::web
                    ? "; the walls of a part that is no web do so, too: set [part] form to the part's"
                    : "");
        }
        case algo::FrameFault::glare:
            return fmt::format(
                "{:.0f} % of the part is far brighter than the free light beside it: look for a second lamp, a "
                "reflection, or stray light",
                100 * f.glare_share);
        case algo::FrameFault::blurred_edge:
            return fmt::format(
                "the light falls over {} lenslets at the part's edges (at most {}): look for a part that moves while "
                "the light is on (a shorter flash) or that is exposed twice, and see that it lies in the measurement "
                "plane{}",
                f.edge_width, algo::kMaxEdgeWidth,
                recipe.form == algo::PartForm::plate
                    ? "; the bevels of a good plate that bend light can look alike: learn a reference (hordctl learn), "
                      "with which this is not asked"
                    : "");
        default:
            return fmt::format(
                "a row or column of lenslets shows free light in {} % of what lies beside the part (at least "
                "{:.0f} %): look for lost rows of the frame, something across the field, a part that reaches from "
                "border to border, or bins that do not lie where the light does (calibrate again)",
                beyond_percent(f.free_beside, algo::kMinFreeBeside), 100 * algo::kMinFreeBeside);
    }
}

// `margin`: lenslets along the outline that are not judged.
std::string missing_part(const algo::FrameFindings& f, algo::PartForm form, int margin) {
    switch (f.fault) {
        case algo::FrameFault::nothing:
            if (form == algo::PartForm::plate)
                return "no edges enclose a sixteenth of the field: check that the plate was there, and the trigger's "
                       "delay; edges and bevels narrower than a lenslet may not be seen (use smaller lenslets, or "
                       "learn "
                       "a reference with hordctl learn)";
            if (form == algo::PartForm::tube)
                return "no two straight edges in the field enclose a sixteenth of it: check that the tube was "
                       "there, and the trigger's delay; walls narrower than a lenslet may not be seen (use smaller "
                       "lenslets, or learn a reference with hordctl learn)";
            return "nothing in the field is large enough to be a part (a sixteenth of it): check that the part was "
                   "there, "
                   "and the trigger's delay";
        case algo::FrameFault::no_outline:
            if (form == algo::PartForm::tube)
                return fmt::format(
                    "the light jumps across {} % of the tube's edges only (at least {:.0f} %): its walls may "
                    "be too thin for these lenslets and bins, or the light uneven: learn a reference (hordctl "
                    "learn), use smaller lenslets, or check the lamp",
                    beyond_percent(f.sharp_share, algo::kMinSharpOutline), 100 * algo::kMinSharpOutline);
            return fmt::format(
                "the light jumps across {} % of the outline only (at least {:.0f} %), as beside an uneven lamp or "
                "edges narrower than a lenslet: check the lamp and the optics; of a part with such edges learn a "
                "reference (hordctl learn), or use smaller lenslets",
                beyond_percent(f.sharp_share, algo::kMinSharpOutline), 100 * algo::kMinSharpOutline);
        case algo::FrameFault::several:
            if (form != algo::PartForm::round)
                return fmt::format(
                    "there are {} parts in the field, or pieces beside the {} that let light through: space them; of a "
                    "part that has such pieces learn a reference (hordctl learn)",
                    f.parts, form == algo::PartForm::tube ? "tube" : "plate");
            return fmt::format(
                "there are {} parts in the field: space them, or set [part] form = \"plate\" if it is "
                "one whose middle does not deflect light",
                f.parts);
        case algo::FrameFault::cut_by_field:
            if (form == algo::PartForm::plate)
                return "the field's border cuts the plate, and what lies beyond is not seen: set the trigger's delay, "
                       "or "
                       "show the whole plate; of one that is larger than the field in every frame set [part] outline = "
                       "\"any\" (only what is in the field is then judged)";
            if (form == algo::PartForm::tube)
                return "the field's border cuts off one end of the tube, and what lies beyond is not seen: set the "
                       "trigger's delay, or show both ends or none; if every frame shows one end set [part] outline = "
                       "\"any\" (only what is in the field is then judged)";
            return "the field's border cuts the part, or the frame's last rows are lost: set the trigger's delay, or "
                   "show "
                   "the whole part";
        case algo::FrameFault::lopsided:
            if (form == algo::PartForm::plate)
                return "the plate's outline is neither a rectangle nor symmetric, or is a rectangle or a disc in most "
                       "places only, as if a corner or a piece of its edge were missing, or an edge were not seen (one "
                       "narrower than a lenslet): check the part, or set [part] outline = \"any\" if it has this shape";
            return "the part's outline is not symmetric, as if a piece were missing: check the part, or set [part] "
                   "outline = \"any\" if it has this shape";
        case algo::FrameFault::notched:
            if (form == algo::PartForm::plate)
                return "the light beside the plate goes on inside its outline, as if a piece of its edge were missing: "
                       "check the part, or set [part] outline = \"any\" if it has this shape";
            return fmt::format(
                "the part's outline is not convex, as if pieces were missing ({:.0f} % of its hull): check the part, "
                "or set [part] outline = \"any\" if it has this shape",
                100 * (1 - f.convexity));
        case algo::FrameFault::no_flanks:
            return "the edges of the tube show no flank on both sides: show it whole, or set [part] form if it "
                   "is none; of one whose walls hardly darken or bend light learn a reference (hordctl learn)";
        case algo::FrameFault::hollow:
            if (form == algo::PartForm::tube) {
                return fmt::format(
                    "{:.0f} % of the tube between its flanks does not deflect light, as if only two rails were there: "
                    "check that the tube is there; the bins may be too wide to see its walls bend light (use narrower "
                    "ones), or learn a reference (hordctl learn)",
                    100 * (1 - f.deflecting));
            }
            return fmt::format(
                "{:.0f} % of what the outline encloses does not deflect light, as if nothing were in it: check that "
                "the part is there; of a flat one learn a reference (hordctl learn), or set [part] form = \"plate\"",
                100 * (1 - f.deflecting));
        case algo::FrameFault::not_flat:
            return fmt::format(
                "{:.0f} % of what the edges enclose deflects light, and the field cuts it: show the whole part, check "
                "the frame (lost samples move all light behind them), or learn a reference (hordctl learn)",
                100 * f.deflecting);
        case algo::FrameFault::no_steps:
            return fmt::format(
                "the light on both sides of the plate's edges can be compared at {} places only (at least {}), and "
                "hardly any light inside is deflected: show {} lenslets of free light or more beside the edges (a "
                "larger field, or a smaller rim_margin), or learn a reference (hordctl learn)",
                f.shaded_steps, algo::kMinShadedSteps, margin + 2);
        case algo::FrameFault::shadow:
            return "the light grows away from the edges as beside the soft shadow of hairs or of a frame, and hardly "
                   "any light between them is deflected: check that the plate is there, and that the lamp is not "
                   "darker in the middle; or learn a reference (hordctl learn)";
        case algo::FrameFault::clear_middle:
            return "light is lost across the plate's edges, but its middle is as light as the field beside it, "
                   "as where a hole is, or hairs or a frame with a soft shadow: check that the plate is there "
                   "and whole; of one with a hole learn a reference (hordctl learn)";
        case algo::FrameFault::unproven:
            return fmt::format(
                "{} % of the steps across the edges lead to less light (at least {:.0f} %), and hardly any light "
                "between them is deflected, as if only hairs or a frame were there: check that the plate is there; of "
                "one whose faces are coated learn a reference (hordctl learn)",
                beyond_percent(f.shaded, algo::kMinShadedShare), 100 * algo::kMinShadedShare);
        default:
            return "no free light surrounds the part: show the whole part, calibrate again if free light does "
                   "surround it (the bins then do not lie where the light does), or set [part] form = \"web\" if it "
                   "fills the field";
    }
}

std::string period_fault(const algo::FrameFindings& f, const algo::Extents& e) {
    if (f.fault == algo::FrameFault::split_spots) {
        return fmt::format(
            "in {:.0f} % of the lenslets the light lies at opposite edges of the bins, as if the macro-pixels drifted "
            "against the frame: give the frame as the sensor recorded it, or calibrate again",
            100 * f.split_share);
    }
    if (f.fault == algo::FrameFault::turned) {
        return fmt::format(
            "the free light drifts as if the bins were turned against the frame by {:.2f} degrees: calibrate again, or "
            "set the camera straight",
            f.turned_rad * 180 / std::numbers::pi_v<float>);
    }
    const int i = f.period_x == 0 ? e.i : f.period_x, j = f.period_y == 0 ? e.j : f.period_y;
    return fmt::format(
        "the light repeats every {} x {} samples, not every {} x {}: give --macro {}x{}; of the sensor's own lenslet "
        "frame give --grid with its calibration (hordctl calibrate), or calibrate again",
        i, j, e.i, e.j, i, j);
}

std::string why_unfit(const algo::Inspection& found, const algo::Recipe& recipe, const algo::Extents& extents) {
    switch (found.reason) {
        case algo::Reason::too_dark:
            if (found.frame.fault == algo::FrameFault::dim)
                return fmt::format(
                    "the dark level, {} DN, takes {} % of the light, and what is seen is not surely one whole part, as "
                    "it must be above {:.0f} %: check that the light flashes while the sensor exposes, and raise its "
                    "current, the exposure or the "
                    "gain",
                    found.dark_dn, beyond_percent(found.frame.lost_share, algo::kMaxLostLight),
                    100 * algo::kMaxLostLight);
            return fmt::format(
                "{} have light enough (at least {:.2g} %): check that the light flashes while the sensor exposes, and "
                "raise its current, the exposure or the gain",
                found.lenslets.judged == 0
                    ? "too few lenslets of the field"
                    : fmt::format("{} of {} lenslets of the part", found.lenslets.lit, found.lenslets.judged),
                100 * recipe.min_lit_share);
        case algo::Reason::saturated:
            return fmt::format(
                "{} of {} lenslets of the part are saturated (at most {:.2g} %): lower the exposure, the light's "
                "current or the gain",
                found.lenslets.saturated, found.lenslets.judged, 100 * recipe.max_saturated_share);
        case algo::Reason::no_part:
            if (found.registered.outcome == algo::Registered::Outcome::no_part) return algo::explain(found.registered);
            return missing_part(found.frame, recipe.form,
                                recipe.rim_margin < 0 ? algo::default_rim_margin(extents) : recipe.rim_margin);
        case algo::Reason::unexpected_light: return light_fault(found.frame, recipe, extents);
        case algo::Reason::unexpected_geometry: return period_fault(found.frame, extents);
        case algo::Reason::not_registered: return algo::explain(found.registered);
        default:
            if (recipe.form == algo::PartForm::tube)
                return "no lenslet is left to judge between the tube's flanks: use wider bins or smaller lenslets, "
                       "lower rim_margin, see to the zones, or learn a reference (hordctl learn)";
            return "no lenslet is left to judge: the part is too small for its rim margin, or the zones leave nothing "
                   "of it; lower rim_margin, or see to the zones";
    }
}

constexpr std::size_t kSteepPartOf = 8;  // a place of 1/8 of the judged lenslets is no usual defect

// The worst defect's middle lies within three lenslets of the rim.
bool is_beside_rim(const algo::Inspection& found, const algo::Extents& e) {
    constexpr int kNear = 3;
    const algo::Defect& d = found.defects[0];
    if (found.mask.empty()) return false;
    bool any = false;
    e.for_each_around(static_cast<int>(std::lround(d.m)), static_cast<int>(std::lround(d.n)), kNear,
                      [&](int m, int n) { any = any || (found.mask[e.index(m, n)] & algo::kRim) != 0; });
    return any;
}

// Lenslets without light, or with less than the recipe allows, that lie along the rim from there inwards.
struct DarkEdge {
    int width = 0;     // lenslets beyond the rim, at its widest
    double share = 0;  // of the outline
};

DarkEdge dark_edge(const algo::Inspection& found, const algo::Recipe& recipe, const algo::Extents& e) {
    constexpr int kWidest = 6;
    // Fewer of the lenslets beside the rim are no bevel, but a place, such as a hole: a short side of a plate that is
    // three times as long as wide is an eighth. Farther from the rim a sixteenth.
    constexpr std::size_t kSideOf = 8, kSomeOf = 16;
    if (found.mask.empty() || found.transmission.empty()) return {};
    std::vector<std::uint8_t> seen(found.mask.size());
    std::vector<std::size_t> at, next;
    for (std::size_t k = 0; k < seen.size(); ++k) {
        seen[k] = (found.mask[k] & algo::kNotJudged) != 0 ? 1 : 0;
        if ((found.mask[k] & algo::kRim) != 0) at.push_back(k);
    }
    DarkEdge edge;
    for (int width = 1; width <= kWidest; ++width) {
        next.clear();
        std::size_t dark = 0;
        for (const std::size_t k : at) {
            e.for_each_around(static_cast<int>(k) % e.m, static_cast<int>(k) / e.m, 1, [&](int m, int n) {
                const std::size_t beside = e.index(m, n);
                if (seen[beside] != 0) return;
                seen[beside] = 1;
                next.push_back(beside);
                const bool is_dark =
                    (found.mask[beside] & algo::kDark) != 0 || found.transmission[beside] < recipe.transmission_limit;
                dark += is_dark ? 1 : 0;
            });
        }
        if ((width == 1 ? kSideOf : kSomeOf) * dark < next.size() || next.empty()) break;
        edge.width = width;
        edge.share = std::max(edge.share, static_cast<double>(dark) / static_cast<double>(next.size()));
        std::swap(at, next);
    }
    return edge;
}

// A bevel that is wider than the rim's margin is dark along the outline.
std::string dark_edge_hint(const algo::Inspection& found, const algo::Recipe& recipe, const algo::Extents& e) {
    const DarkEdge edge = dark_edge(found, recipe, e);
    if (edge.width == 0) return "";
    const int margin = recipe.rim_margin < 0 ? algo::default_rim_margin(e) : recipe.rim_margin;
    return fmt::format(
        " It is dark along {:.0f} % of the outline, up to {} lenslets beyond the rim: if good parts have such a bevel, "
        "set rim_margin = {}.",
        100 * edge.share, edge.width, margin + edge.width);
}

// Of a tube that is compared with itself: the light of the worst defect is there, and it is half as long as the field.
bool is_along_tube(const algo::Inspection& found, const algo::Recipe& recipe, const algo::Extents& e) {
    return recipe.form == algo::PartForm::tube && !recipe.reference && found.reason != algo::Reason::absorption &&
        2 * found.defects[0].length >= static_cast<float>(std::min(e.m, e.n));
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
            "before the part is judged.",
            found.dark_dn, 100 * found.frame.lost_share);
    };
    if (is_dim) return dim_hint();
    const bool light_is_there = found.reason != algo::Reason::absorption;
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

}  // namespace

float size_of(const algo::Defect& d) {
    const bool band = d.kind == algo::DefectKind::scratch || d.weak;
    return band && d.length > 0 ? d.length : 2 * algo::radius_of(d);
}

std::string size_text(const algo::Defect& d, const algo::Recipe& recipe) { return length_text(size_of(d), recipe); }

std::string explain(const algo::Inspection& found, const algo::Recipe& recipe, const algo::Extents& extents) {
    if (found.verdict == algo::Verdict::unfit) return fmt::format("Not judged: {}.", why_unfit(found, recipe, extents));
    const char* const bounds = !found.bounded ? ""
        : found.out_of_time                   ? " Some values are bounds: the time ran out."
                                              : " Some values are bounds: the limit of work was reached.";
    const char* const at_most = found.bounded ? "at most " : "";  // a bound can be several times the exact value
    if (found.defects.empty())
        return fmt::format("Passed: the worst place reaches {}{:.0f} % of its limit.{}", at_most, 100 * found.score,
                           bounds);
    const algo::Defect& d = found.defects.front();
    if (found.reason == algo::Reason::missing_material) {
        return fmt::format(
            "Rejected: light passes as if material were missing at {}: {:.0f} % more than beside it, over {}, {}{:.1f} "
            "times its limit.{} If good parts are thinner or clearer there, learn a reference (hordctl learn).",
            place_text(d, recipe, extents), 100 * d.peak, length_text(d.length, recipe), at_most, found.score, bounds);
    }
    const std::string what = is_along_tube(found, recipe, extents)
        ? "a place along the tube, of " + length_text(d.length, recipe)
        : fmt::format("{} of {}", what_is(d), size_text(d, recipe));
    std::string text = fmt::format("Rejected: {} at {}, {}{:.1f} times its limit", what, place_text(d, recipe, extents),
                                   at_most, found.score);
    const std::size_t more = found.defects.size() - 1;
    if (more > 0) text += fmt::format("; {} weaker {}", more, more == 1 ? "one" : "ones");
    return text + "." + moved_optics(found) + bounds + hint(found, recipe, extents);
}

std::vector<std::string> labels_of(const algo::Inspection& found, const algo::Recipe& recipe) {
    std::vector<std::string> labels;
    for (const algo::Defect& d : found.defects) {
        labels.push_back(fmt::format("{} {}{}", name_of(d.kind), size_text(d, recipe),
                                     d.score > 0 ? fmt::format(", {:.1f}x", d.score) : ""));
    }
    return labels;
}

}  // namespace hord::firmware
