// A rotated, distorted, hexagonal array is calibrated from its white frame and decoded. Its features are compared with
// those of an ideal, aligned square array that sees the same scene.
#include <cmath>

#include <gtest/gtest.h>

#include "algo/frame/regrid.h"
#include "algo/inspection/pipeline.h"
#include "tests/calib/support/synthetic.h"
#include "tests/support/decode_whole.h"

namespace hord::calib {
namespace {

constexpr int kBins = 9;
// Limits on the RMS difference of EMD gradients away from the rims, bins: required, and the aim that the square array
// meets.
constexpr double kFeatureRms = 0.05;
constexpr double kFeatureAim = 0.02;

// A scene: the deflection of the light, bins, at a place on the sensor. `scale`: its shortest period, lenslets.
struct Scene {
    double pitch_px, scale, strength;
    [[nodiscard]] std::pair<double, double> deflection_bins(double x, double y) const {
        const double k = 2 * 3.14159265358979323846 / (scale * pitch_px);
        return {strength * std::sin(k * x + 0.4 * std::sin(0.7 * k * y)),
                strength * std::cos(0.8 * k * y - 0.3) * std::sin(0.5 * k * x + 1)};
    }
};

constexpr double kSpotBins = 0.9;  // sigma of the single spot in a HORD

test::White array(bool hexagonal, double pitch) {
    test::White white;
    white.width_px = white.height_px = 900;
    white.hexagonal = hexagonal;
    white.pitch_px = pitch;
    white.rotation_deg = 3;
    white.perspective_x = 0.002;
    white.perspective_y = -0.002;
    white.k1 = 0.004;
    return white;
}

// The ideal frame: each bin's share of a Gaussian spot, in the same DN as the raw frame's pixels.
Frame ideal(const algo::Extents& extents, algo::PixelPoint first, double pitch, const Scene& scene, double peak_dn) {
    Frame frame(extents.width_px(), extents.height_px(), 16);
    const double a = 1 / (std::sqrt(2.0) * kSpotBins);
    const double area = 2 * 3.14159265358979323846 * kSpotBins * kSpotBins;
    for (int n = 0; n < extents.n; ++n) {
        for (int m = 0; m < extents.m; ++m) {
            const auto [dx, dy] = scene.deflection_bins(first.x_px + m * pitch, first.y_px + n * pitch);
            for (int j = 0; j < kBins; ++j) {
                for (int i = 0; i < kBins; ++i) {
                    const double x = i - 4 - dx, y = j - 4 - dy;
                    const double share = 0.25 * (std::erf(a * (x + 0.5)) - std::erf(a * (x - 0.5))) *
                        (std::erf(a * (y + 0.5)) - std::erf(a * (y - 0.5)));
                    frame.set(m * kBins + i, n * kBins + j,
                              static_cast<std::uint32_t>(std::lround(peak_dn * area * share)));
                }
            }
        }
    }
    return frame;
}

struct Difference {
    double rms = 0, mean_emd = 0;
    int compared = 0;
};

Difference compare_emd(const Frame& decoded, const Frame& wanted, const algo::Extents& extents) {
    algo::Recipe recipe;
    recipe.dark_dn = 1;
    recipe.rim_margin = 0;
    auto one = algo::Pipeline::create(extents, 16, recipe, 1, algo::MapSet::exact);
    auto two = algo::Pipeline::create(extents, 16, recipe, 1, algo::MapSet::exact);
    const auto a = one->inspect(decoded.view());
    const auto b = two->inspect(wanted.view());
    Difference out;
    for (int n = 3; n < extents.n - 3; ++n) {
        for (int m = 3; m < extents.m - 3; ++m) {
            const auto k = static_cast<std::size_t>(n * extents.m + m);
            if (a->mask[k] != algo::kValid || b->mask[k] != algo::kValid) continue;
            ++out.compared;
            out.rms += std::pow(a->emd[k] - b->emd[k], 2);
            out.mean_emd += b->emd[k];
        }
    }
    out.rms = std::sqrt(out.rms / out.compared);
    out.mean_emd /= out.compared;
    return out;
}

Difference decode_and_compare(bool hexagonal, double pitch, const Scene& scene, bool noise) {
    test::White white = array(hexagonal, pitch);
    const auto calibration = calibrate_grid(test::draw(white).frame.view());
    EXPECT_TRUE(calibration);
    const algo::BinLayout layout = algo::even_layout(calibration->fit.grid, kBins, kBins);
    auto regridder = algo::Regridder::create(calibration->fit.grid, layout);
    EXPECT_TRUE(regridder);
    test::White object = white;
    object.seed = 5;
    object.noise = noise;
    object.background_dn = 0;
    object.disc_radius_px = -kSpotBins * layout.box_x_px;
    object.deflect = [&](double x, double y) {
        const auto [dx, dy] = scene.deflection_bins(x, y);
        return std::pair(dx * layout.box_x_px, dy * layout.box_y_px);
    };
    const auto decoded = hord::test::decode_whole(*regridder, test::draw(object).frame.view());
    const auto wanted =
        ideal(regridder->extents(), regridder->first_px(), regridder->pitch_px(), scene, object.peak_dn);
    return compare_emd(decoded, wanted, regridder->extents());
}

TEST(DecodeFeatures, a_rotated_distorted_hexagonal_array_sees_what_the_ideal_one_sees) {
    const Difference found = decode_and_compare(true, 20.6, {.pitch_px = 20.6, .scale = 30, .strength = 2}, false);
    EXPECT_GT(found.compared, 1000);
    EXPECT_GT(found.mean_emd, 0.2);  // the scene has visible gradients
    RecordProperty("hexagonal, bin RMS", test::text(found.rms));
    EXPECT_LT(found.rms, kFeatureRms);
}

TEST(DecodeFeatures, so_does_a_square_one_and_one_with_photon_noise) {
    const double square = decode_and_compare(false, 22.3, {.pitch_px = 22.3, .scale = 30, .strength = 2}, false).rms;
    const double noisy = decode_and_compare(true, 20.6, {.pitch_px = 20.6, .scale = 30, .strength = 2}, true).rms;
    RecordProperty("square, bin RMS", test::text(square));
    RecordProperty("hexagonal with photon noise, bin RMS", test::text(noisy));
    EXPECT_LT(square, kFeatureAim);
    EXPECT_LT(noisy, kFeatureRms);
}

}  // namespace
}  // namespace hord::calib
