// Place and size of a flaw from the light that is not where a good part has it: missing from the lenslet, or bent to
// other bins. A region of lenslets that deviate is larger than the flaw: a lenslet that a hundredth of the flaw covers
// belongs to it.
//
// A lenslet's displaced share is the light that its bins lack, each of what it is expected to hold, over all expected
// light: 1 where a flaw covers the lenslet and takes or bends all light. What noise, ripple and the part's form make
// of it is the median of the lenslets around the region, and subtracted. Derivation: docs/notes/reference.md.
#pragma once

#include <cstdint>
#include <optional>
#include <span>
#include <vector>

#include "algo/reference/pose.h"
#include "algo/reference/reference.h"
#include "algo/reference/reference_sampler.h"
#include "common/frame.h"

namespace hord::algo {

// The frame that was compared: the dark level that was subtracted, DN, and the part's light over the reference's.
struct ComparedLight {
    FrameView frame;
    std::uint32_t dark = 0;
    double light = 1;
};

struct FlawSize {
    double m = 0, n = 0;  // centroid of the displaced light, lenslets
    double area = 0;      // displaced light, in lenslets that it would fill alone
    double radius = 0;    // lenslets, of a disc that displaces an even share of its light
    double length = 0;    // of a bar of the same second moments; 0: shorter than a lenslet
};

class FlawSizer {
  public:
    static constexpr int kBeside = 1;                 // lenslets from the region up to which light counts as the flaw's
    static constexpr std::size_t kMaxLenslets = 400;  // of a region; larger ones are not measured

    // `reference` outlives it. Allocates all memory.
    explicit FlawSizer(const Reference& reference);

    // Lenslets read by measure() since start_frame(): a measure of its cost, because reading takes most of the time.
    void start_frame() { lenslets_read_ = 0; }
    [[nodiscard]] std::size_t lenslets_read() const { return lenslets_read_; }

    // `region`: indices of its lenslets. `is_defect(k)`: lenslet k belongs to a region. Empty if the light around the
    // region is not known, or no light is displaced.
    template <class IsDefect>
    std::optional<FlawSize> measure(const ComparedLight& seen, const PoseMap& pose,
                                    std::span<const std::uint32_t> region, IsDefect&& is_defect) {
        if (region.size() > kMaxLenslets) return std::nullopt;
        gather(region);
        ring_.clear();
        for (const std::uint32_t k : near_) {
            if (distance_[k] > kBeside && !is_defect(k)) ring_.push_back(k);
        }
        return measure_gathered(seen, pose);
    }

  private:
    void gather(std::span<const std::uint32_t> region);
    std::optional<FlawSize> measure_gathered(const ComparedLight& seen, const PoseMap& pose);
    [[nodiscard]] double disc_radius(const FlawSize& size, double usual, double noise) const;
    std::optional<double> displaced_share(const ComparedLight& seen, const PoseMap& pose, std::uint32_t k);

    const Reference& reference_;
    ReferenceSampler sampler_;
    std::vector<float> bins_;
    std::vector<std::uint8_t> distance_;      // of a lenslet from the region, while it is measured
    std::vector<std::uint32_t> near_, ring_;  // lenslets up to kRing from the region; those that are light around it
    std::vector<double> shares_;
    std::size_t lenslets_read_ = 0;
};

}  // namespace hord::algo
