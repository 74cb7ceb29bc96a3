// What an inspection says of a part.
#pragma once

#include <cstdint>
#include <string_view>

namespace hord::algo {

// `unfit`: the frame does not allow a judgement (no light, saturated, no part in it); the station rejects it.
enum class Verdict : std::uint8_t { pass, reject, unfit };

// Why. One reason a part: the first of `unfit`'s that applies, else the most severe of `reject`'s.
enum class Reason : std::uint8_t {
    none,            // passed
    deflection,      // neighbouring HORDs disagree (a distance above its limit)
    slope,           // the mean deflection changes too fast (Jacobian norm above its limit)
    absorption,      // light is missing (transmission below its limit)
    too_dark,        // unfit: too few lenslets with light
    saturated,       // unfit: too many saturated lenslets
    nothing_to_see,  // unfit: no lenslet is left to judge after masks and zones
    not_registered,  // unfit: it does not lie where the reference's parts did, or does not look like them
};

enum class DefectKind : std::uint8_t { unknown, scattering, absorbing, surface, scratch };

// A connected region of lenslets above a limit. Position in lenslets, (0,0) the centre of the top-left lenslet.
struct Defect {
    float m = 0;  // centroid, lenslets
    float n = 0;
    std::uint32_t area = 0;  // lenslets
    float peak = 0;          // largest value of the feature that found it, in that feature's unit
    DefectKind kind = DefectKind::unknown;
    float length = 0;  // lenslets: of a bar with the region's second moments; 0: not known
    float width = 0;
    float score = 0;  // over its limit; 0: not known
};

constexpr std::string_view name_of(Verdict v) {
    constexpr std::string_view names[] = {"pass", "reject", "unfit"};
    return names[static_cast<unsigned>(v)];
}
constexpr std::string_view name_of(Reason r) {
    constexpr std::string_view names[] = {"none",     "deflection", "slope",          "absorption",
                                          "too-dark", "saturated",  "nothing-to-see", "not-registered"};
    return names[static_cast<unsigned>(r)];
}
constexpr std::string_view name_of(DefectKind k) {
    constexpr std::string_view names[] = {"unknown", "scattering", "absorbing", "surface", "scratch"};
    return names[static_cast<unsigned>(k)];
}

}  // namespace hord::algo
