// The result of an inspection: verdict, reason, defects. The one table of their codes and printed names.
#pragma once

#include <cmath>
#include <cstdint>
#include <numbers>
#include <string_view>

namespace hord::algo {

// `unfit`: the frame cannot be judged (no light, saturated, no part in it). The station rejects the part.
enum class Verdict : std::uint8_t { pass, reject, unfit };

// One reason a part. Unfit: the first reason that applies. Rejected: the reason of the most severe defect.
// Registers and stored results hold the numbers: append, never renumber.
enum class Reason : std::uint8_t {
    none,                 // passed
    neighbours_disagree,  // neighbouring HORDs differ too much (a distance at or above its limit)
    deflection_gradient,  // the mean deflection changes too fast (Jacobian norm at or above its limit)
    absorption,           // light is missing (transmission below its limit)
    too_dark,             // unfit: too few lenslets with light
    saturated,            // unfit: too many saturated lenslets
    nothing_to_see,       // unfit: masks and zones leave no lenslet to judge
    not_registered,       // unfit: the part is not where the reference's parts were, or does not resemble them
    no_part,              // unfit: no part in the field, or not one whole part
    unexpected_light,  // unfit: the light is not that of the calibrated cell (fog, defocus, shift, ghost, dark level)
    unexpected_geometry,  // unfit: the frame has macro-pixels of another size, or none
    missing_material,  // light passes through a place of the part as where there is none (more than the part beside it)
};

enum class DefectKind : std::uint8_t { unknown, scattering, absorbing, surface, scratch };

// A connected region of lenslets above a limit. Position in lenslets, (0,0) the centre of the top-left lenslet.
struct Defect {
    float m = 0;  // centroid, lenslets
    float n = 0;
    std::uint32_t area = 0;  // lenslets
    float peak = 0;          // largest value of the feature that exceeds its limit most, in that feature's unit
    DefectKind kind = DefectKind::unknown;
    float length = 0;   // lenslets, of a uniform bar with the region's second moments; 0: unknown
    float width = 0;    // the same
    float score = 0;    // severity: value over limit; 0: unknown
    float radius = 0;   // lenslets, of a disc that takes or bends as much light; 0: unknown
    bool weak = false;  // found by what several lenslets show together (algo/reference/pooled_scores.h): haze, striae
};

// The radius that the light says; where that is unknown, of a disc of the region's area. Lenslets.
inline float radius_of(const Defect& d) {
    return d.radius > 0 ? d.radius : std::sqrt(static_cast<float>(d.area) * std::numbers::inv_pi_v<float>);
}

constexpr std::string_view name_of(Verdict v) {
    constexpr std::string_view names[] = {"pass", "reject", "unfit"};
    return names[static_cast<unsigned>(v)];
}

constexpr std::string_view name_of(Reason r) {
    constexpr std::string_view names[] = {"none",     "neighbours-disagree", "deflection-gradient", "absorption",
                                          "too-dark", "saturated",           "nothing-to-see",      "not-registered",
                                          "no-part",  "unexpected-light",    "unexpected-geometry", "missing-material"};
    return names[static_cast<unsigned>(r)];
}

// The former names of two reasons, which stores and kept frames may hold.
struct FormerReasonName {
    std::string_view name;
    Reason reason;
};
inline constexpr FormerReasonName kFormerReasonNames[] = {{"deflection", Reason::neighbours_disagree},
                                                          {"slope", Reason::deflection_gradient}};

// The present name of a reason; `name` itself if it is no former name.
constexpr std::string_view present_reason_name(std::string_view name) {
    for (const FormerReasonName& former : kFormerReasonNames) {
        if (name == former.name) return name_of(former.reason);
    }
    return name;
}

constexpr std::string_view name_of(DefectKind k) {
    constexpr std::string_view names[] = {"unknown", "scattering", "absorbing", "surface", "scratch"};
    return names[static_cast<unsigned>(k)];
}

}  // namespace hord::algo
