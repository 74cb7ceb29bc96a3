// The frame's own dark level: pedestal and noise of its darkest bins, and the dark level that follows from them.
//
// A spot of collimated light covers at most kSpotBins x kSpotBins bins of a lenslet; the other bins are dark. From the
// histogram of the samples of at most kSampled x kSampled lenslets: the median of the dark bins is the pedestal, and
// the distance to their quantile at -1 sigma is the noise; at +1 sigma where that below reads 0. A sample of v DN
// counts as spread evenly over v +- 0.5 DN, so that a constant level has the noise of rounding.
//
// Where most dark bins read 0, the sensor has clipped them. If the samples above 0 are the upper half of a normal
// distribution about 0, its standard deviation is the noise; else nothing is known of them. Why, and what is not seen:
// docs/notes/inspection.md.
#pragma once

#include <cstdint>
#include <vector>

#include "algo/frame/decode.h"
#include "algo/frame/extents.h"
#include "common/frame.h"

namespace hord::algo {

constexpr int kSpotBins = 4;              // bins along an axis that a spot may cover
constexpr double kMinDarkShare = 0.25;    // of a lenslet's bins; with fewer dark bins nothing is measured
constexpr double kDarkNoiseFactor = 3;    // a raised dark level lies so many sigma of the noise above the pedestal
constexpr double kKeptShare = 14.0 / 15;  // of the dark bins: a chosen dark level that so many do not exceed is kept
constexpr std::uint32_t kDarkRiseDn8Bit = 8;  // DN at 8 bits; at b bits 2^(b-8) times as many
constexpr std::uint32_t default_dark_rise(int bits) { return kDarkRiseDn8Bit << (bits - 8); }

// Share of a lenslet's bins that no spot covers, 0..1.
double share_of_dark_bins(const Extents& extents);

struct DarkBins {
    bool measured = false;   // lenslets have enough dark bins to tell
    double pedestal_dn = 0;  // median of the dark bins; at most 0.5 where most of them read 0
    double noise_dn = 0;     // standard deviation; about 0.3, rounding alone, in a quiet frame
    double upper_dn = 0;     // kKeptShare of the dark bins are not above it
    bool at_zero = true;     // most dark bins read 0, and their noise is not known
};

// The light levels to decode a frame with.
struct FrameLevels {
    LightLevels levels;
    bool pedestal_allowed = true;  // the pedestal is at most max_rise_dn above the given dark level
    bool noise_allowed = true;     // pedestal and noise together take at most twice that
    double wanted_dn = 0;          // the dark level that pedestal and noise ask for; 0: not measured
};

enum class DarkLevel : std::uint8_t { chosen, by_default };

// The levels given. If more than 1 - kKeptShare of the dark bins exceed the dark level, it is raised to pedestal +
// kDarkNoiseFactor noise, rounded up; a level by default already if it lies below that without the noise of rounding.
// Exactly the given levels if nothing was measured or DarkBins::at_zero. Where the rise is not allowed the dark level
// is the highest that is.
FrameLevels levels_above_dark_bins(const LightLevels& given, const DarkBins& dark, std::uint32_t max_rise_dn,
                                   DarkLevel kind = DarkLevel::chosen);

class DarkBinMeter {
  public:
    static constexpr int kSampled = 24;  // lenslets a side, at most

    // bits: 8..16. Allocates all memory.
    DarkBinMeter(const Extents& extents, int bits);

    // `frame` has the extents' size and the bit depth given.
    DarkBins measure(const FrameView& frame);

    // Calls visit(m, n) for every lenslet that measure() reads.
    template <class Visit>
    void for_each_sampled(Visit&& visit) const {
        for (const int n : rows_) {
            for (const int m : columns_) visit(m, n);
        }
    }

  private:
    template <class Sample>
    void count(const FrameView& frame);
    [[nodiscard]] double quantile(double share) const;
    [[nodiscard]] double noise_clipped_at_zero() const;

    Extents extents_;
    double dark_share_;
    std::vector<int> columns_, rows_;    // of sampled lenslets
    std::vector<std::uint32_t> counts_;  // of samples of each value
};

}  // namespace hord::algo
