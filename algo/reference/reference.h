// What good parts look like, lenslet by lenslet: learned once (algo/reference/reference_learner.h), kept in a file
// (firmware/recipes/reference_file.h), never changed while parts are inspected.
#pragma once

#include <array>
#include <cstdint>
#include <vector>

#include "algo/frame/decode.h"
#include "algo/frame/extents.h"
#include "algo/reference/registration.h"
#include "common/result.h"

namespace hord::algo {

// The sensor's noise, in DN: a sample of x DN above the dark level varies by x / electrons_per_dn + read_dn^2 + 1/12.
struct SensorModel {
    float electrons_per_dn = 10;
    float read_dn = 0.6F;
    float clip_dn =
        0;  // of light that the dark level cuts off every lit bin: the dark level, less the camera's own pedestal
};

// By how much a lenslet may differ from the reference HORD; one number each.
enum class Deviation : std::uint8_t {
    light,             // missing or additional light, of what is expected
    deflection_shift,  // the mean deflection, bin pitches
    scattering,        // the spread of the deflections: the share of the light that is scattered by about a bin
    shape,             // all that these do not describe
};
inline constexpr std::size_t kDeviations = 4;

struct Reference {
    static constexpr int kShareBits = 15;  // a share of the light, Q0.15,
    static constexpr std::uint16_t kMaxShare =
        (1U << kShareBits) - 1;  // below 1: it is multiplied as a signed number, too
    static constexpr std::uint32_t kMinParts = 8;

    Extents extents;
    int bits = 8;
    LightLevels levels;
    SensorModel sensor;
    std::uint32_t parts = 0;  // learned from

    // Reference HORDs: `stride()` shares a lenslet, bin (i, j) at place(i, j); a border of dark bins around them, and
    // the rest, are 0.
    std::vector<std::uint16_t> shares;
    // One value a lenslet.
    std::vector<float> light;        // DN: the typical part's sum
    std::vector<float> x, y;         // mean deflection, bin pitches
    std::vector<std::uint8_t> mask;  // kDark: no reference HORD; kOutside: not seen often enough to say anything
    std::array<std::vector<float>, kDeviations> spread;  // variance of good parts beyond noise, in the deviation's unit
                                                         // squared; of shape: excess of chi-square a DN of light
    std::vector<float> emd, frobenius;                   // the gradients of a typical good part

    [[nodiscard]] std::size_t stride() const {
        return (static_cast<std::size_t>((extents.i + 2) * (extents.j + 2)) + 15) / 16 * 16;
    }
    [[nodiscard]] std::size_t place(int i, int j) const {
        return static_cast<std::size_t>((j + 1) * (extents.i + 2) + i + 1);
    }
    [[nodiscard]] ReferenceMaps maps() const { return {light, x, y, mask}; }
};

// Sizes and ranges; invalid_argument names the first thing that is wrong.
Result<void> check(const Reference& reference);

}  // namespace hord::algo
