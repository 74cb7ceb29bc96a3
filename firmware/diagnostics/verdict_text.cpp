#include "firmware/diagnostics/verdict_text.h"

#include <fmt/format.h>

#include "algo/inspection/reference_defects.h"
#include "firmware/diagnostics/along_outline.h"
#include "firmware/diagnostics/unfit_text.h"
#include "firmware/diagnostics/verdict_hints.h"

namespace hord::firmware {
namespace {

std::string length_text(float lenslets, const algo::Recipe& recipe) {
    return recipe.lenslet_mm > 0 ? fmt::format("{:.2g} mm", lenslets * recipe.lenslet_mm)
                                 : fmt::format("{:.1f} lenslets", lenslets);
}

std::string place_text(algo::Point at, const algo::Recipe& recipe, const algo::Extents& e) {
    const float m = at.m - 0.5F * static_cast<float>(e.m - 1), n = at.n - 0.5F * static_cast<float>(e.n - 1);
    if (recipe.lenslet_mm > 0) return fmt::format("({:.2f}, {:.2f}) mm", m * recipe.lenslet_mm, n * recipe.lenslet_mm);
    return fmt::format("lenslet ({:.1f}, {:.1f})", at.m, at.n);
}

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

// What the worst defect is, how large, and where.
std::string worst_text(const algo::Inspection& found, const algo::Recipe& recipe, const algo::Extents& e) {
    const algo::Defect& d = found.defects.front();
    if (const auto edge = defect_along_outline(found, recipe, e)) {
        const algo::Point worst{static_cast<float>(static_cast<int>(edge->worst) % e.m),
                                static_cast<float>(static_cast<int>(edge->worst) / e.m)};
        return fmt::format("{} along {:.0f} % of the outline, worst at {}", what_is(d), 100 * edge->share,
                           place_text(worst, recipe, e));
    }
    const std::string what = is_along_tube(found, recipe, e)
        ? "a place along the tube, of " + length_text(d.length, recipe)
        : fmt::format("{} of {}", what_is(d), size_text(d, recipe));
    return fmt::format("{} at {}", what, place_text({d.m, d.n}, recipe, e));
}

}  // namespace

float size_of(const algo::Defect& d) {
    const bool band = d.kind == algo::DefectKind::scratch || d.weak;
    return band && d.length > 0 ? d.length : 2 * algo::radius_of(d);
}

std::string size_text(const algo::Defect& d, const algo::Recipe& recipe) { return length_text(size_of(d), recipe); }

std::string explain(const algo::Inspection& found, const algo::Recipe& recipe, const algo::Extents& extents) {
    if (found.verdict == algo::Verdict::unfit)
        return fmt::format("Not judged: {}.{}", why_unfit(found, recipe, extents), fewer_bits_hint(found.frame));
    const char* const bounds = !found.bounded ? ""
        : found.out_of_time                   ? " Some values are bounds: the time ran out."
                                              : " Some values are bounds: the limit of work was reached.";
    const char* const at_most = found.bounded ? "at most " : "";  // a bound can be several times the exact value
    if (found.defects.empty())
        return fmt::format("Passed: the worst place reaches {}{:.0f} % of its limit.{}", at_most, 100 * found.score,
                           bounds);
    const algo::Defect& d = found.defects.front();
    if (found.reason == algo::Reason::missing_material) {
        const bool learned = recipe.reference != nullptr;
        const char* const than = learned ? "in the parts that were learned" : "beside it";
        const char* const cure = learned ? "If good parts are as clear there, learn from such parts, too."
                                         : "If good parts are thinner or clearer there, learn a reference (hordctl "
                                           "learn).";
        return fmt::format(
            "Rejected: light passes as if material were missing at {}: {:.0f} % more than {}, over {}, {}{:.1f} times "
            "its limit.{} {}",
            place_text({d.m, d.n}, recipe, extents), 100 * d.peak, than, length_text(d.length, recipe), at_most,
            found.score, bounds, cure);
    }
    std::string text =
        fmt::format("Rejected: {}, {}{:.1f} times its limit", worst_text(found, recipe, extents), at_most, found.score);
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
