// A ray at the boundary of two media: Snell's law, total reflection, Fresnel transmission.
#pragma once

#include <cmath>

#include "hal_sim/optics/scene/geometry.h"

namespace hord::sim {

struct Refraction {
    Vec3 direction;          // unit
    bool reflected = false;  // total reflection
    double cos_in = 1;       // cosines of the angles to the normal, before and after
    double cos_out = 1;
};

// `normal`: unit, either orientation. 1 - (n sin)^2 is computed from the tangential part of the direction, not from its
// cosine: no cancellation near the critical angle.
inline Refraction refract(const Vec3& direction, const Vec3& normal, double index_before, double index_after) {
    double cosine = dot(direction, normal);
    const Vec3 tangent = direction - cosine * normal;
    const Vec3 onwards = cosine < 0 ? -1.0 * normal : normal;
    if (cosine < 0) cosine = -cosine;
    const double ratio = index_before / index_after;
    const double square = 1 - ratio * ratio * dot(tangent, tangent);
    if (square <= 0) return {unit(tangent - cosine * onwards), true, cosine, cosine};
    const double cos_out = std::sqrt(square);
    const Vec3 out = ratio * tangent + cos_out * onwards;
    return {(1.5 - 0.5 * dot(out, out)) * out, false, cosine, cos_out};  // one Newton step back to unit length
}

inline Vec3 mirrored(const Vec3& direction, const Vec3& normal) {
    return unit(direction - (2 * dot(direction, normal)) * normal);
}

// Transmitted share of unpolarised light; the rest is reflected (Born and Wolf, section 1.5.2).
inline double fresnel_transmission(const Refraction& at, double index_before, double index_after) {
    if (at.reflected) return 0;
    const double s =
        (index_before * at.cos_in - index_after * at.cos_out) / (index_before * at.cos_in + index_after * at.cos_out);
    const double p =
        (index_before * at.cos_out - index_after * at.cos_in) / (index_before * at.cos_out + index_after * at.cos_in);
    return 1 - 0.5 * (s * s + p * p);
}

}  // namespace hord::sim
