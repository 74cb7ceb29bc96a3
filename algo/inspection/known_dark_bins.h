// The bins of a frame that hold no light, by its reference: bins at least kBinsFromLight from every bin in which good
// parts have light, there or within kLensletsAround lenslets. A good part that is registered cannot reach them.
//
// Readings in these bins are the sensor's pedestal and noise, even where the other bins hold light. They are compared
// with the reference one by one, so a few readings above the dark level count as scattered light in every lenslet. The
// level must let through as few as it did when the reference was learned. Which rule, and what it does not see:
// docs/notes/inspection.md.
#pragma once

#include <cstdint>
#include <vector>

#include "algo/frame/extents.h"
#include "algo/light/dark_bins.h"
#include "algo/reference/reference.h"
#include "common/frame.h"

namespace hord::algo {

// So many of the readings in bins without light may exceed the dark level. Where the reference's read noise is too
// small to be seen (0; below 0.25 DN), its level is not by noise, and up to 2 % of its own readings exceeded it.
constexpr double kRareShare = 0.005, kRareShareOfQuiet = 0.015;

class KnownDarkBins {
  public:
    static constexpr int kBinsFromLight = 3, kLensletsAround = 3;
    static constexpr int kBlock = 6;                  // sampled lenslets a side; blocks are compared with each other
    static constexpr std::size_t kMinReadings = 200;  // of a block; with fewer its level is not known
    static constexpr std::size_t kMinBlocks = 4;

    // Knows none.
    KnownDarkBins() = default;
    // Of the lenslets that `sampled` visits. Allocates all memory.
    KnownDarkBins(const Reference& reference, const DarkBinMeter& sampled);

    [[nodiscard]] bool any() const { return blocks_.size() >= kMinBlocks; }

    // The lowest level, `lowest`..`highest` DN, that at most a rare share of the readings exceeds in a quarter of the
    // blocks. `lowest` if there are fewer than kMinBlocks blocks.
    std::uint32_t level_of(const FrameView& frame, std::uint32_t lowest, std::uint32_t highest);

  private:
    template <class Sample>
    void find_levels(const FrameView& frame, std::uint32_t lowest);

    struct Place {
        std::uint16_t x, y;  // pixels
    };
    struct Block {
        std::size_t first, end;  // of its places
    };
    double rare_share_ = kRareShare;
    std::vector<Place> places_;
    std::vector<Block> blocks_;
    std::vector<std::uint32_t> levels_, above_;  // one a block; readings above the lowest level
};

}  // namespace hord::algo
