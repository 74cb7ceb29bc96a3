// Frames for the tests of algo: real ones from files, drawn ones, and changes to either.
#pragma once

#include <cstdint>
#include <filesystem>
#include <functional>
#include <optional>
#include <string>

#include "algo/frame/extents.h"
#include "common/frame.h"

namespace hord::algo::testing {

// A light field traced by POV-Ray, an independent program ($HORD_DATA or ../shared/data, povray/NAME_raw.png; 9x9
// bins); nullopt if the file is missing.
std::optional<Frame> povray(const std::string& name);
constexpr Extents kPovray{111, 111, 9, 9};

// What a lenslet of a drawn frame shows: a square spot 1.22 bins wide, evenly lit.
struct Spot {
    double x = 0, y = 0;  // deflection, bins from the centre
    double light = 1;     // 1: a bin filled by the spot reads `full_bin`
};
Frame drawn(const Extents& extents, int bits, double full_bin_dn, const std::function<Spot(int m, int n)>& spot);

// A round lens with free light around it. Deflection grows to `rim_bins` at `radius` lenslets from the centre.
std::function<Spot(int, int)> lens(const Extents& extents, double radius, double rim_bins);

// Photon and read noise: a sample of s DN is Poisson(s * light * electrons_per_dn) plus normal read noise. If `bits`
// is more than the frame's, the samples are first scaled by the ratio of the full scales.
struct Noise {
    double electrons_per_dn = 10;  // at 8 bits
    double read_electrons = 2;
    double light = 1;
};
Frame noisy(const Frame& frame, const Noise& noise, std::uint64_t seed, int bits = 8);

// Samples scaled to another bit depth, without noise.
Frame at_bits(const Frame& frame, int bits);
// Rows and columns exchanged, lenslets and bins both.
Frame transposed(const Frame& frame);
// Left and right exchanged, lenslets and bins both.
Frame mirrored(const Frame& frame);
// Moved by whole lenslets; lenslets that enter the field repeat the top-left lenslet (free light).
Frame shifted(const Frame& frame, const Extents& extents, int dm, int dn);
// Light of the lenslets within `radius` of (m, n) multiplied by `transmission`; partly covered ones in proportion.
Frame specked(const Frame& frame, const Extents& extents, double m, double n, double radius, double transmission);

}  // namespace hord::algo::testing
