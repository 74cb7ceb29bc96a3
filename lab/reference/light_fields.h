// Light fields in a folder, and their exposures: NAME_raw.png (16 bit, macro-pixels, without noise, kFilledBin is a bin
// filled by the source) and NAME.json, which says what was traced.
//
// Keys: `part` (the family), `angular` (bins along an axis, 9 if it is missing). A part without a defect has
// `defect_free` true. A defect has `centre_lenslet` [m, n] and `radius_lenslets`; a scratch has `length_lenslets`, too,
// and `deg` in its `defect`, from m towards n.
#pragma once

#include <array>
#include <cstdint>
#include <filesystem>
#include <map>
#include <optional>
#include <string>
#include <vector>

#include "algo/frame/extents.h"
#include "common/frame.h"
#include "common/result.h"

namespace hord::lab {

constexpr double kFilledBin = 40'000;

struct TracedFlaw {
    double m = 0, n = 0;           // lenslets
    std::optional<double> radius;  // lenslets, of a scratch half its width; none: without a size
    double length = 0;             // lenslets, of a scratch
    double angle = 0;              // radians, from m towards n

    // Lenslets from the middle line of a scratch, or from the centre.
    [[nodiscard]] double distance(double at_m, double at_n) const;
};
struct TracedPart {
    std::string name, family;
    algo::Extents extents;
    std::vector<float> light;  // row by row; 1 is a bin filled by the source
    std::optional<TracedFlaw> flaw;
};

// Of each family, by name: the good parts and those with a flaw.
struct TracedFamily {
    std::vector<TracedPart> good, flawed;
};

// Fails with not_found (no light field), unreadable.
Result<std::map<std::string, TracedFamily>> read_light_fields(const std::filesystem::path& folder);

// What the light of a lenslet has beyond photon statistics.
enum class Ripple : std::uint8_t {
    none,
    sensor,  // the same in every frame
    part,    // of every part its own, the same in all its exposures
};
inline constexpr std::array kRippleNames = {"none", "sensor", "part"};
constexpr double kRippleShare = 0.015;  // standard deviation of a lenslet's light, relative

struct Exposure {
    int bits = 12;
    double electrons = 10'000;  // of a filled bin at full light
    double light = 1;
    Ripple ripple = Ripple::none;
    std::uint64_t seed = 1;
};

// Electrons a DN of a sensor on which a filled bin reads 240/255 of the full scale.
double electrons_per_dn(const Exposure& exposure);

// With photon noise and kReadElectrons of read noise. No pedestal: the sensor clips at 0.
constexpr double kReadElectrons = 4;
Frame expose(const TracedPart& part, const Exposure& exposure);

}  // namespace hord::lab
