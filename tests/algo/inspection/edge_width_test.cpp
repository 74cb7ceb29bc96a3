// Over how many lenslets the light changes at a part's edges: a part that moved, or was exposed twice, is told by them.
#include <algorithm>
#include <cmath>
#include <cstdint>
#include <vector>

#include <gtest/gtest.h>

#include "algo/frame/mask.h"
#include "algo/inspection/pipeline.h"
#include "algo/inspection/rim.h"
#include "algo/recipe/recipe.h"
#include "tests/support/frames.h"

namespace hord::algo {
namespace {

using namespace hord::algo::testing;

constexpr Extents kField{61, 61, 9, 9};
const std::vector<int> kAtRest = {0};

Frame mean_of(const std::vector<Frame>& all) {
    Frame mean = all.front();
    for (int y = 0; y < mean.height_px(); ++y) {
        for (int x = 0; x < mean.width_px(); ++x) {
            std::uint32_t sum = 0;
            for (const Frame& one : all) sum += one.view().sample(x, y);
            mean.set(x, y, sum / static_cast<std::uint32_t>(all.size()));
        }
    }
    return mean;
}

// The mean of exposures of a part that lies so many lenslets to the right.
template <class Place, class Part>
Frame exposed_at(const std::vector<Place>& places, Part&& part, double peak_dn = 220) {
    std::vector<Frame> all;
    for (const Place place : places)
        all.push_back(drawn(kField, 8, peak_dn, [&](int m, int n) { return part(m - place, n); }));
    return noisy(mean_of(all), {10, 2, 1}, 5);
}

FrameFault fault_of(const Frame& frame, PartForm form = PartForm::round) {
    Recipe recipe;
    recipe.form = form;
    auto pipeline = Pipeline::create(kField, 8, recipe);
    EXPECT_TRUE(pipeline);
    const auto seen = pipeline->inspect(frame.view());
    EXPECT_TRUE(seen);
    return seen->frame.fault;
}

// Its edges take no light: the mixed light there is deflected, from none to the most.
TEST(EdgeWidth, of_a_weak_lens_tells_that_it_moved_or_was_exposed_twice) {
    const std::vector<int> three = {-1, 0, 1}, five = {-2, -1, 0, 1, 2}, seven = {-3, -2, -1, 0, 1, 2, 3},
                           twice = {-3, 4};
    for (const double rim_bins : {1.2, 1.6, 2.0}) {
        const auto part = lens(kField, 19.4, rim_bins);
        for (const auto& places : {kAtRest, three, five, seven, twice}) {
            const Frame frame = exposed_at(places, part);
            for (const Frame& seen : {frame, transposed(frame)}) {
                const FrameFault found = fault_of(seen);
                if (places.size() == 1 || places.size() == 3) EXPECT_EQ(found, FrameFault::none);
                else EXPECT_TRUE(found == FrameFault::blurred_edge || found == FrameFault::no_outline);
                if (HasFailure()) FAIL() << rim_bins << " bins, " << places.size() << " exposures";
            }
        }
    }
}

// A plate whose bevel lets no light through, of glass that lets so much through; the mean of 7 x 7 places a lenslet.
struct TintedPlate {
    double turn = 0, bevel = 0.7, light = 0.8;  // rad, lenslets
    Spot operator()(double m, double n) const {
        constexpr int kPlaces = 7;
        double sum = 0;
        for (int k = 0; k < kPlaces * kPlaces; ++k) {
            const double x = m - 30.3 + (k % kPlaces - 3.0) / kPlaces, y = n - 30.1 + (k / kPlaces - 3.0) / kPlaces,
                         u = std::cos(turn) * x + std::sin(turn) * y, v = std::cos(turn) * y - std::sin(turn) * x,
                         into = std::min(18 - std::abs(u), 13.5 - std::abs(v));
            sum += into < 0 ? 1 : into < bevel ? 0 : light;
        }
        return {0, 0, sum / (kPlaces * kPlaces)};
    }
};

// A narrow bevel darkens no lenslet wholly: the light of the glass beside it is no part of the edge.
TEST(EdgeWidth, of_a_tinted_plate_at_rest_is_that_of_its_bevel) {
    for (const double bevel : {0.5, 0.7, 1.0, 1.2}) {
        for (const double light : {0.84, 0.8, 0.76, 0.7, 0.6, 0.4}) {
            for (const double turn : {0.0, 0.1, 0.4, 0.8})
                EXPECT_NE(fault_of(exposed_at(kAtRest, TintedPlate{turn, bevel, light}), PartForm::plate),
                          FrameFault::blurred_edge)
                    << bevel << " " << light << " " << turn;
        }
    }
}

// By two lenslets and more. What is as light as half of the free light shows no outline.
TEST(EdgeWidth, of_a_tinted_plate_tells_that_it_moved_or_was_exposed_twice) {
    const std::vector<double> two = {-1, -0.5, 0, 0.5, 1}, four = {-2, -1.5, -1, -0.5, 0, 0.5, 1, 1.5, 2},
                              twice_2 = {-1, 1}, twice_3 = {-1.5, 1.5}, twice_4 = {-2, 2};
    for (const double bevel : {0.5, 0.7, 1.2}) {
        for (const double light : {0.76, 0.7, 0.6}) {
            for (const auto& places : {two, four, twice_2, twice_3, twice_4}) {
                for (const double turn : {0.0, 0.3}) {
                    const Frame frame = exposed_at(places, TintedPlate{turn, bevel, light});
                    for (const Frame& seen : {frame, transposed(frame)})
                        EXPECT_NE(fault_of(seen, PartForm::plate), FrameFault::none)
                            << bevel << " " << light << " " << turn << " " << places.size() << " " << places.back();
                }
            }
        }
    }
}

// Little light hides no motion: lenslets that the edge covers in part tell of it even where they have too little light
// for a HORD.
TEST(EdgeWidth, of_a_tinted_plate_that_moved_shows_in_little_light) {
    const std::vector<double> two = {-1, -0.75, -0.5, -0.25, 0, 0.25, 0.5, 0.75, 1};
    for (const double light : {1.0, 0.5, 0.25, 0.2, 0.15, 0.12}) {
        const Frame frame = exposed_at(two, TintedPlate{0, 1, 0.7}, 220 * light);
        EXPECT_NE(fault_of(frame, PartForm::plate), FrameFault::none) << light;
    }
}

// The dark level takes more of faint light than of bright light: what is lit in part looks darker than it is.
TEST(EdgeWidth, of_a_tinted_plate_that_moved_is_the_same_where_the_dark_level_takes_light) {
    const std::vector<double> two_and_a_half = {-1.25, -1, -0.75, -0.5, -0.25, 0, 0.25, 0.5, 0.75, 1, 1.25};
    for (const double glass : {0.3, 0.4, 0.6}) {
        for (const double bevel : {1.0, 1.4}) {
            for (const double light : {1.0, 0.5, 0.35, 0.25}) {
                const Frame frame = exposed_at(two_and_a_half, TintedPlate{0, bevel, glass}, 220 * light);
                EXPECT_NE(fault_of(frame, PartForm::plate), FrameFault::none) << glass << " " << bevel << " " << light;
            }
        }
    }
}

// A plate whose bevels bend light by so many bins outwards and take no more of it than the glass.
Frame bevelled(double glass, double bevel, double bins, double peak_dn) {
    constexpr int kPlaces = 3;
    std::vector<Frame> all;
    for (int k = 0; k < kPlaces * kPlaces; ++k) {
        const double right = (k % kPlaces - 1.0) / kPlaces, down = (k / kPlaces - 1.0) / kPlaces;
        all.push_back(drawn(kField, 12, 16 * peak_dn, [&](int m, int n) -> Spot {
            const double x = m - 30.3 + right, y = n - 30.1 + down, from_side = 18 - std::abs(x),
                         from_end = 13.5 - std::abs(y), into = std::min(from_side, from_end);
            if (into < 0) return {};
            if (into >= bevel) return {0, 0, glass};
            return from_side < from_end ? Spot{std::copysign(bins, x), 0, glass}
                                        : Spot{0, std::copysign(bins, y), glass};
        }));
    }
    return noisy(mean_of(all), {10.0 / 16, 2, 1}, 5);  // drawn with 12 bits: rounding takes no light
}

// A bevel that bends light and takes none leaves no dark edge: the darkest lenslet there is one of the glass, by noise.
TEST(EdgeWidth, of_a_plate_at_rest_whose_bevels_bend_light_is_that_of_one_edge) {
    for (const double glass : {0.84, 0.7}) {
        for (const double bevel : {0.6, 1.0}) {
            for (const double bins : {1.0, 2.0}) {
                for (const double light : {1.0, 0.25})
                    EXPECT_NE(fault_of(bevelled(glass, bevel, bins, 220 * light), PartForm::plate),
                              FrameFault::blurred_edge)
                        << glass << " " << bevel << " " << bins << " " << light;
            }
        }
    }
}

// Glass of 163 DN with noise of 8 DN, and an edge that falls from 200 DN over four lenslets: noise hides the fifths of
// the step, so that nothing proves a part at rest.
TEST(EdgeWidth, of_a_step_that_noise_hides_is_not_that_of_a_part_at_rest) {
    const Extents e{40, 40, 9, 9};
    std::vector<Deflection> deflections(e.lenslets());
    std::vector<std::uint32_t> sums(e.lenslets(), 200);
    std::vector<std::uint8_t> mask(e.lenslets(), kValid);
    for (int n = 0; n < e.n; ++n) {
        for (int m = 0; m < e.m; ++m) {
            const int into = std::min({m, n, e.m - 1 - m, e.n - 1 - n}) - 8;
            const std::size_t k = e.index(m, n);
            if (into >= 0) sums[k] = (m + n) % 2 == 0 ? 155 : 171;
            else if (into >= -4) sums[k] = static_cast<std::uint32_t>(174 - 7 * (into + 1));
            if (into == -1 || into == -2) deflections[k].x = DeflectionQ::from_raw(std::int64_t{1} << 23);
        }
    }
    RimFinder finder(e, 1, PartForm::plate);
    finder.mark(deflections, sums, mask);
    finder.measure_edges({deflections, sums, mask}, LightScale());
    EXPECT_GT(finder.found().edge_width, kMaxEdgeWidth);
}

// A disc with a dark rim that bends light in rings: the slope beside the rim is the part's own, and goes on inside.
TEST(EdgeWidth, of_a_part_that_bends_light_by_its_own_slope_is_none) {
    for (const double ring : {12.0, 20.0, 24.0, 28.0}) {  // lenslets
        const auto rings = [&](int m, int n) -> Spot {
            const double x = m - 30, y = n - 30, r = std::hypot(x, y), into = 22 - r;
            if (into < 0 || r == 0) return {};
            const double bend = 0.05 * ring * std::sin(6.2832 * into / ring);
            return {bend * x / r, bend * y / r, into < 1 ? 0.0 : 0.92};
        };
        EXPECT_EQ(fault_of(exposed_at(kAtRest, rings)), FrameFault::none) << ring;
    }
}

}  // namespace
}  // namespace hord::algo
