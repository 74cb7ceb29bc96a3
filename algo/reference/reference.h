// The reference: light, HORD and spread of good parts, lenslet by lenslet. Learned once
// (algo/reference/reference_learner.h), stored in a file (firmware/recipes/reference_file.h), constant during
// inspection.
#pragma once

#include <algorithm>
#include <array>
#include <cstdint>
#include <vector>

#include "algo/frame/decode.h"
#include "algo/frame/extents.h"
#include "algo/reference/registration.h"
#include "common/result.h"

namespace hord::algo {

// The sensor's noise: a sample of x DN above the dark level has the variance x / electrons_per_dn + read_dn^2 + 1/12
// DN^2.
struct SensorModel {
    float electrons_per_dn = 10;
    float read_dn = 0.6F;
    float clip_dn =
        0;  // light that the dark level removes from every lit bin: the dark level less the camera's pedestal
};

// The ways in which a lenslet is compared with the reference HORD; one number each.
enum class Deviation : std::uint8_t {
    light,             // missing or additional light, relative to the expected light
    deflection_shift,  // change of the mean deflection, bin pitches
    scattering,        // change of the spread of deflections: the share of the light that is scattered by about a bin
    shape,             // the remainder of the HORD's difference
};
inline constexpr std::size_t kDeviations = 4;

// A rectangle of bins, both ends included; empty by default.
struct BinRect {
    std::int16_t left = 0, right = -1, top = 0, bottom = -1;

    [[nodiscard]] bool none() const { return right < left; }
    [[nodiscard]] int columns() const { return right - left + 1; }
    [[nodiscard]] int rows() const { return bottom - top + 1; }
    [[nodiscard]] bool has(int i, int j) const { return i >= left && i <= right && j >= top && j <= bottom; }
    [[nodiscard]] bool has(const BinRect& r) const {
        return r.none() || (has(r.left, r.top) && has(r.right, r.bottom));
    }
    void cover(const BinRect& r) {
        if (r.none()) return;
        if (none()) *this = r;
        left = std::min(left, r.left), right = std::max(right, r.right), top = std::min(top, r.top),
        bottom = std::max(bottom, r.bottom);
    }
    friend bool operator==(const BinRect&, const BinRect&) = default;
};

struct Reference {
    static constexpr int kShareBits = 15;                               // a share of the light is Q0.15,
    static constexpr std::uint16_t kMaxShare = (1U << kShareBits) - 1;  // below 1, so that it fits std::int16_t
    static constexpr std::uint32_t kMinParts = 8;

    Extents extents;
    int bits = 8;
    LightLevels levels;
    SensorModel sensor;
    std::uint32_t parts = 0;  // learned from

    // Reference HORDs: `stride()` shares a lenslet, bin (i, j) at place(i, j), with a border of dark bins around them.
    // Border and padding are 0.
    std::vector<std::uint16_t> shares;
    // One value a lenslet.
    std::vector<float> light;        // DN: the typical part's sum
    std::vector<float> x, y;         // mean deflection, bin pitches
    std::vector<std::uint8_t> mask;  // kDark: no reference HORD; kOutside: too few parts show this lenslet
    // Variance of good parts beyond noise, in the deviation's unit squared; of shape: excess of chi-square a DN of
    // light.
    std::array<std::vector<float>, kDeviations> spread;
    // The gradients of a typical good part; near jumps those that good parts reach.
    std::vector<float> emd, frobenius;
    // The standard deviation of what several lenslets show together in a typical good part, one a filter
    // (algo/reference/pooled_scores.h); 0: it has no room. Empty: learned before they were, none is judged.
    std::vector<float> pooled_scales;
    // Lenslets by which a good part's opposite edges lie farther apart than the reference's, or closer, at most: along
    // x and y (algo/reference/size_difference.h). 0: not known, no size is refused.
    std::array<float, 2> size_limits{};
    // By how much a good part's edges are blurred at most (algo/reference/edge_blur.h). 0: not known, none is refused.
    std::array<float, 2> blur_limits{};
    // What a square of lenslets of a good part may score (algo/reference/light_patches.h). 0: not known, none is
    // judged.
    float patch_limit = 0;

    [[nodiscard]] std::size_t stride() const {
        return (static_cast<std::size_t>((extents.i + 2) * (extents.j + 2)) + 15) / 16 * 16;
    }
    [[nodiscard]] std::size_t place(int i, int j) const {
        return static_cast<std::size_t>((j + 1) * (extents.i + 2) + i + 1);
    }
    [[nodiscard]] ReferenceMaps maps() const { return {light, x, y, mask, size_limits, blur_limits}; }
};

// Checks sizes and ranges. Fails with invalid_argument, naming the first problem.
Result<void> check(const Reference& reference);

}  // namespace hord::algo
