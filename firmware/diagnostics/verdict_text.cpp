#include "firmware/diagnostics/verdict_text.h"

#include <algorithm>
#include <cmath>
#include <numbers>

#include <fmt/format.h>

namespace hord::firmware {
namespace {

// Of scratches the length, of others the diameter of a disc of their area.
float size_of(const algo::Defect& d) {
    return d.kind == algo::DefectKind::scratch && d.length > 0
        ? d.length
        : 2 * std::sqrt(static_cast<float>(d.area) * std::numbers::inv_pi_v<float>);
}

std::string length(float lenslets, const algo::Recipe& recipe) {
    return recipe.lenslet_mm > 0 ? fmt::format("{:.2g} mm", lenslets * recipe.lenslet_mm)
                                 : fmt::format("{:.1f} lenslets", lenslets);
}

std::string place(const algo::Defect& d, const algo::Recipe& recipe, const algo::Extents& e) {
    const float m = d.m - 0.5F * static_cast<float>(e.m - 1), n = d.n - 0.5F * static_cast<float>(e.n - 1);
    if (recipe.lenslet_mm > 0) return fmt::format("({:.2f}, {:.2f}) mm", m * recipe.lenslet_mm, n * recipe.lenslet_mm);
    return fmt::format("lenslet ({:.1f}, {:.1f})", d.m, d.n);
}

std::string_view what_is(algo::DefectKind kind) {
    switch (kind) {
        case algo::DefectKind::scattering: return "a scattering defect";
        case algo::DefectKind::absorbing: return "an absorbing defect";
        case algo::DefectKind::surface: return "a surface defect";
        case algo::DefectKind::scratch: return "a scratch";
        case algo::DefectKind::unknown: break;
    }
    return "a defect";
}

std::string_view why_unfit(algo::Reason reason, const algo::Registered& registered) {
    switch (reason) {
        case algo::Reason::too_dark: return "there is too little light";
        case algo::Reason::saturated: return "too many lenslets are saturated";
        case algo::Reason::no_part: return "there is not one whole part in the field";
        case algo::Reason::unexpected_light: return "the light is not that of the calibrated cell";
        case algo::Reason::unexpected_geometry: return "its macro-pixels have another size";
        case algo::Reason::not_registered: return algo::explain(registered.outcome);
        default: return "no lenslet is left to judge";
    }
}

}  // namespace

std::string explain(const algo::Inspection& found, const algo::Recipe& recipe, const algo::Extents& extents) {
    if (found.verdict == algo::Verdict::unfit)
        return fmt::format("Not judged: {}.", why_unfit(found.reason, found.registered));
    const char* const bounds = !found.bounded ? ""
        : found.out_of_time                   ? " Some values are bounds: the time ran out."
                                              : " Some values are bounds: the limit of work was reached.";
    if (found.defects.empty())
        return fmt::format("Passed: the worst place reaches {:.0f} % of its limit.{}", 100 * found.score, bounds);
    const algo::Defect& d = found.defects.front();
    std::string text = fmt::format("Rejected: {} of {} at {}, {:.1f} times its limit", what_is(d.kind),
                                   length(size_of(d), recipe), place(d, recipe, extents), found.score);
    const std::size_t more = found.defects.size() - 1;
    if (more > 0) text += fmt::format("; {} weaker {}", more, more == 1 ? "one" : "ones");
    return text + "." + bounds;
}

std::vector<std::string> labels_of(const algo::Inspection& found, const algo::Recipe& recipe) {
    std::vector<std::string> labels;
    for (const algo::Defect& d : found.defects) {
        labels.push_back(fmt::format("{} {}{}", name_of(d.kind), length(size_of(d), recipe),
                                     d.score > 0 ? fmt::format(", {:.1f}x", d.score) : ""));
    }
    return labels;
}

}  // namespace hord::firmware
