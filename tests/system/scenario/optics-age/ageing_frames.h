// Adds ageing to any frame source: a weaker LED, a drifting dark level, dust on the lenslets.
//
// The source itself renders the weaker light, so its noise is correct. Dust lies on the lenslet array (or close to it:
// the plane of the part's image) and scales all bins of a lenslet by the uncovered area (64 sample points a lenslet);
// the noise is scaled with the signal. The dark level is added to every sample, in whole DN, up to full scale.
#pragma once

#include <functional>
#include <vector>

#include "algo/frame/extents.h"
#include "hal_sim/world/frame_source.h"

namespace hord::sim {

struct DustOnLenslets {
    double m = 0, n = 0;  // centre, lenslets
    double radius = 0.5;  // lenslets
    double transmission = 0;
};

struct CellAge {
    double light = 1;  // relative to the new LED
    int dark_dn = 0;   // increase since the camera was new
    std::vector<DustOnLenslets> dust;
};

class AgeingFrames final : public FrameSource {
  public:
    // `of_exposure`: the cell's age at the k-th exposure, from 0. `young` outlives this; its frames are macro-pixel
    // frames of these extents.
    AgeingFrames(FrameSource& young, const algo::Extents& extents,
                 std::function<CellAge(std::uint64_t exposure)> of_exposure)
        : young_(young), extents_(extents), of_exposure_(std::move(of_exposure)) {}

    [[nodiscard]] Format format() const override { return young_.format(); }
    FrameView expose(const Exposure& exposure, std::span<std::byte> scratch) override;

    [[nodiscard]] std::uint64_t exposures() const { return exposures_; }

  private:
    FrameSource& young_;
    algo::Extents extents_;
    std::function<CellAge(std::uint64_t)> of_exposure_;
    std::uint64_t exposures_ = 0;
};

}  // namespace hord::sim
