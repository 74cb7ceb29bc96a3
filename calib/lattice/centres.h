// Sub-pixel centres of lenslets, by one matched, radially symmetric weight that is learned from the frame itself.
//
// The mean radial profile T(r) of the frame's own lenslets gives the weight w(r); the centre c is where
// sum w(|x - c|) (x - c) I(x) = 0. Because the weight is symmetric about the centre that it finds, a constant
// background drops out exactly. w starts as -T'(r)/r, the most efficient weight for a shift of T, and is made
// orthogonal to what is not a shift: to a gradient of the background, u, and to a gradient of light inside the
// lenslet (vignetting), u T(r), of which a plain centre of gravity would make an error of g R / 8. Where the
// profile does not let them be told apart (a spot as small as its own blur), the condition is left away, and
// `immunity()` says so.
#pragma once

#include <memory>
#include <optional>
#include <span>
#include <vector>

#include "algo/frame/lenslet_grid.h"
#include "calib/lattice/white_image.h"
#include "common/result.h"

namespace hord::calib {

struct Spot {
    algo::PixelPoint centre_px;
    double amplitude_dn = 0;  // of the profile, over the background
    double match = 0;         // correlation with the profile, -1..1
    double step_px = 0;       // from the prediction to the centre
};

struct Immunity {
    bool background_gradient = false;
    bool vignetting = false;
};

class CentreFinder {
  public:
    // Learns the profile from the lenslets near `seeds` (predicted to within a quarter pitch; at most 400 are used).
    // Fails with `refused` when fewer than 4 of them look like one another.
    static Result<CentreFinder> learn(const WhiteImage& image, std::span<const algo::PixelPoint> seeds,
                                      double pitch_px);

    // The lenslet predicted at `at`, iterated until it moves less than 0.02 px. None where its window is not wholly
    // inside the frame, it holds no light, or it moved further than `most_px`.
    [[nodiscard]] std::optional<Spot> measure(algo::PixelPoint at, double most_px) const;

    // What two halves of the lenslet's light say of its centre, each for itself: half of their difference, the first
    // less the second. The halves are every second of eight sectors about the centre, so that each sees a shift along x
    // and y alike and no pixel is in both: they share the lenslet's true place, and not their noise. None where it
    // cannot be said.
    [[nodiscard]] std::optional<algo::PixelPoint> split(algo::PixelPoint centre) const;

    // Whether the window of a lenslet at `at` lies wholly inside the frame.
    [[nodiscard]] bool complete(algo::PixelPoint at) const;

    // The light of a lenslet at `at`, in DN: how much of the profile is there, over the background. Outside the frame
    // it is dark.
    [[nodiscard]] double amplitude_dn(algo::PixelPoint at) const;

    // Saturated samples inside the window, as a share of it.
    [[nodiscard]] double saturated_share(algo::PixelPoint at) const;

    [[nodiscard]] double window_radius_px() const;
    [[nodiscard]] Immunity immunity() const;
    [[nodiscard]] double typical_amplitude_dn() const;      // median of the lenslets learned from
    [[nodiscard]] std::span<const double> profile() const;  // T(r), one value each 0.05 px, 1 at the top

    CentreFinder(CentreFinder&&) noexcept;
    CentreFinder& operator=(CentreFinder&&) noexcept;
    ~CentreFinder();

  private:
    struct Kernels;
    explicit CentreFinder(std::unique_ptr<Kernels> kernels);
    std::unique_ptr<Kernels> kernels_;
};

}  // namespace hord::calib
