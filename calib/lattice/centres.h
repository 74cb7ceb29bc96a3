// Sub-pixel centres of lenslets, by a matched, radially symmetric weight w that is learned from the frame: the centre c
// solves sum w(|x - c|) (x - c) I(x) = 0. A constant background cancels exactly; gradients of background and light
// cancel as far as the profile allows (immunity()). Derivation: docs/notes/calibration.md.
#pragma once

#include <complex>
#include <optional>
#include <span>
#include <vector>

#include "algo/frame/lenslet_grid.h"
#include "calib/lattice/white_image.h"
#include "common/opaque.h"
#include "common/result.h"

namespace hord::calib {

struct Spot {
    algo::PixelPoint centre_px;
    double amplitude_dn = 0;  // of the profile, over the background
    double match = 0;         // correlation with the profile, -1..1
    double step_px = 0;       // from the prediction to the centre
};

// The shape of a lenslet's light, by its second moments.
struct Elongation {
    double along_x = 0;  // (xx - yy) / (xx + yy): above 0 for a lenslet that is wider along x
    double aslant = 0;   // 2 xy / (xx + yy)
};

// How a lenslet's light differs, as shares of its power.
struct Unlike {
    double profile = 0;  // from the profile
    double turned = 0;   // from itself, turned by 180 degrees: 0 for round, square and hexagonal lenslets
};

struct Immunity {
    bool background_gradient = false;
    bool vignetting = false;
};

// When the weight is made orthogonal to gradients of background and light, which adds noise.
enum class AgainstGradients {
    where_cheap,  // where the noise grows little
    always        // wherever a plateau separates them from a shift
};

struct Weights;  // calib/lattice/centre_weights.h

class CentreFinder {
  public:
    // Learns the profile from the lenslets near `seeds` (predicted to a quarter of a pitch; at most 400 are used).
    // Fails with `refused` if fewer than 4 of them are alike.
    static Result<CentreFinder> learn(const WhiteImage& image, std::span<const algo::PixelPoint> seeds, double pitch_px,
                                      AgainstGradients against = AgainstGradients::where_cheap);

    // Measures the lenslet predicted at `at`, iterating until it moves less than 0.02 px. None if its window is not
    // inside the frame, it has no light, or it moved by more than `most_px`.
    [[nodiscard]] std::optional<Spot> measure(algo::PixelPoint at, double most_px) const;

    // Measures the centre by each of two halves of the lenslet's light; half of the difference, first minus second. The
    // halves are alternate sectors of eight about the centre: both respond to x and y alike, and share no pixel. In a
    // smoothed frame they share noise, and differ by less than the centre is off: there the difference is enlarged, so
    // that its noise is that of the centre. None if it cannot be measured.
    [[nodiscard]] std::optional<algo::PixelPoint> split(algo::PixelPoint centre) const;

    // The noise of a lenslet's light, over that: half the difference of what both halves measure, first minus second,
    // enlarged in a smoothed frame as that of split(). None if it cannot be measured.
    [[nodiscard]] std::optional<double> light_noise(algo::PixelPoint centre) const;

    // None if it cannot be measured.
    [[nodiscard]] std::optional<Elongation> elongation(algo::PixelPoint centre) const;

    // How far the light of a lenslet has corners: its part with `count` lobes about the centre, over all of it, both
    // times the squared distance; the angle is that of the lobes, times `count`. 0 for a round lenslet. `count` is
    // even. None if it cannot be measured.
    [[nodiscard]] std::optional<std::complex<double>> lobes(algo::PixelPoint centre, int count) const;

    // How much more a lenslet's edge is blurred one way than across: by the variance of its place, px^2. The angle is
    // twice that of the way. Two exposures that lie d apart make it d^2 / 4; a lenslet that is longer one way, but
    // sharp all around, has 0. None for spots, which cannot be distinguished so, or if it cannot be measured.
    [[nodiscard]] std::optional<std::complex<double>> edge_blur_px2(algo::PixelPoint centre) const;

    // How much brighter a lenslet is towards +x and +y: the change of its light from the middle to its half height,
    // over the mean, from the pixels well inside. None for a spot, which has no inside, or if it cannot be measured.
    [[nodiscard]] std::optional<algo::PixelPoint> gradient(algo::PixelPoint centre) const;

    // True if the window of a lenslet at `at` is inside the frame.
    [[nodiscard]] bool complete(algo::PixelPoint at) const;

    // The light of a lenslet at `at`, DN: amplitude of the profile over the background; 0 light outside the frame.
    [[nodiscard]] double amplitude_dn(algo::PixelPoint at) const;

    // Share of the samples in the window that are saturated.
    [[nodiscard]] double saturated_share(algo::PixelPoint at) const;

    [[nodiscard]] const Weights& weights() const;
    [[nodiscard]] double window_radius_px() const;
    [[nodiscard]] double half_height_radius_px() const;  // of the profile
    [[nodiscard]] double stretch_shown()
        const;  // of a lenslet's stretch: the window cuts its rim, and smoothing does not stretch
    [[nodiscard]] double edge_variance_px2() const;  // of its edge's place, by blur; at least what the profile can show
    [[nodiscard]] Immunity immunity() const;
    [[nodiscard]] AgainstGradients against() const;  // as learned
    // How far a centre moves, px, where light changes by 1 a pixel, relative to itself. 0 if immune to vignetting.
    [[nodiscard]] double shift_by_gradient_px2() const;
    // None if it cannot be measured.
    [[nodiscard]] std::optional<Unlike> unlike(algo::PixelPoint centre) const;
    // Both parts of Unlike beside a lenslet's centre, over the square of that distance, px^-2; for small ones.
    [[nodiscard]] double unlike_by_shift_px2() const;
    [[nodiscard]] double typical_amplitude_dn() const;  // median of the lenslets learned from

  private:
    struct Kernels;
    explicit CentreFinder(common::Opaque<Kernels> kernels) : kernels_(std::move(kernels)) {}
    common::Opaque<Kernels> kernels_;
};

}  // namespace hord::calib
