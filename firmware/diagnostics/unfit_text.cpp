#include "firmware/diagnostics/unfit_text.h"

#include <algorithm>
#include <cmath>
#include <numbers>

#include <fmt/format.h>

#include "algo/inspection/frame_checks.h"
#include "algo/inspection/rim.h"

namespace hord::firmware {
namespace {

// A value on the wrong side of its limit, with as many digits as tell them apart.
std::string beyond(double value, double limit, int digits = 0) {
    constexpr int kMaxDigits = 4;
    std::string text = fmt::format("{:.{}f}", value, digits);
    while (digits < kMaxDigits && text == fmt::format("{:.{}f}", limit, digits))
        text = fmt::format("{:.{}f}", value, ++digits);
    return text;
}

std::string beyond_percent(float share, double limit) { return beyond(100 * static_cast<double>(share), 100 * limit); }

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
                "in one frame, or light of the next lenslet (calibrate again){}",
                100 * f.second_share,
                recipe.form == algo::PartForm::plate && f.undeflected_share == f.second_share
                    ? "; the bevels of a good plate that bend light far can look alike: set a wider rim_margin"
                    : "");
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
                      "whose edges they are compared with"
                    : "");
        default:
            return fmt::format(
                "a row or column of lenslets shows free light in {} % of what lies beside the part (at least "
                "{:.0f} %): look for lost rows of the frame, something across the field, a part that reaches from "
                "border to border, or bins that do not lie where the light does (calibrate again)",
                beyond_percent(f.free_beside, algo::kMinFreeBeside), 100 * algo::kMinFreeBeside);
    }
}

// What is wrong with the part, and the cure. First the faults whose sentence depends on the form.
std::string no_part_seen(algo::PartForm form) {
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
}

std::string weak_outline(const algo::FrameFindings& f, algo::PartForm form) {
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
}

std::string several_parts(const algo::FrameFindings& f, algo::PartForm form) {
    if (form != algo::PartForm::round)
        return fmt::format(
            "there are {} parts in the field, or pieces beside the {} that let light through: space them; of a "
            "part that has such pieces learn a reference (hordctl learn)",
            f.parts, form == algo::PartForm::tube ? "tube" : "plate");
    return fmt::format(
        "there are {} parts in the field: space them, or set [part] form = \"plate\" if it is "
        "one whose middle does not deflect light",
        f.parts);
}

std::string cut_part(algo::PartForm form) {
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
}

std::string lopsided_part(algo::PartForm form) {
    if (form == algo::PartForm::plate)
        return "the plate's outline is neither a rectangle nor symmetric, or is a rectangle or a disc in most "
               "places only, as if a corner or a piece of its edge were missing, or an edge were not seen (one "
               "narrower than a lenslet): check the part, or set [part] outline = \"any\" if it has this shape";
    return "the part's outline is not symmetric, as if a piece were missing: check the part, or set [part] "
           "outline = \"any\" if it has this shape";
}

std::string notched_part(const algo::FrameFindings& f, algo::PartForm form) {
    if (form == algo::PartForm::plate)
        return "the light beside the plate goes on inside its outline, as if a piece of its edge were missing: "
               "check the part, or set [part] outline = \"any\" if it has this shape";
    return fmt::format(
        "the part's outline is not convex, as if pieces were missing ({:.0f} % of its hull): check the part, "
        "or set [part] outline = \"any\" if it has this shape",
        100 * (1 - f.convexity));
}

std::string hollow_part(const algo::FrameFindings& f, algo::PartForm form) {
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
}

// `margin`: lenslets along the outline that are not judged.
std::string missing_part(const algo::FrameFindings& f, algo::PartForm form, int margin) {
    switch (f.fault) {
        case algo::FrameFault::nothing: return no_part_seen(form);
        case algo::FrameFault::no_outline: return weak_outline(f, form);
        case algo::FrameFault::several: return several_parts(f, form);
        case algo::FrameFault::cut_by_field: return cut_part(form);
        case algo::FrameFault::lopsided: return lopsided_part(form);
        case algo::FrameFault::notched: return notched_part(f, form);
        case algo::FrameFault::no_flanks:
            return "the edges of the tube show no flank on both sides: show it whole, or set [part] form if it "
                   "is none; of one whose walls hardly darken or bend light learn a reference (hordctl learn)";
        case algo::FrameFault::hollow: return hollow_part(f, form);
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
        "the light repeats every {} x {} samples, not every {} x {}: of a frame of macro-pixels give --macro {}x{}; of "
        "the sensor's own lenslet frame give --grid with its calibration (hordctl calibrate); if it was given, the "
        "frame "
        "is of another camera, or calibrate again",
        i, j, e.i, e.j, i, j);
}

}  // namespace

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
            if (found.registered.shows_no_part()) return algo::explain(found.registered);
            return missing_part(found.frame, recipe.form,
                                recipe.rim_margin < 0 ? algo::default_rim_margin(extents) : recipe.rim_margin);
        case algo::Reason::unexpected_light:
            if (found.registered.outcome == algo::Registered::Outcome::blurred) return algo::explain(found.registered);
            return light_fault(found.frame, recipe, extents);
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

}  // namespace hord::firmware
