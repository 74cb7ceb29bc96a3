// Upper bounds of the EMD gradient hold what EmdSolver gives, and are close to it where spots move.
#include "algo/soa/soa_emd_bounds.h"

#include <algorithm>
#include <cmath>
#include <cstdlib>
#include <vector>

#include <gtest/gtest.h>

#include "algo/maps/feature_map.h"
#include "tests/support/histograms.h"

namespace hord::algo {
namespace {

using namespace testing;

std::vector<Isa> isas() {
    std::vector<Isa> all;
    for (const Isa isa : {Isa::portable, Isa::avx2, Isa::avx512}) {
        if (has(isa)) all.push_back(isa);
    }
    return all;
}

std::vector<float> bounds_of(const Frame& frame, const Extents& e, const LightLevels& levels, Isa isa) {
    SoaDistances rows(e, Feature::emd, isa, true);
    const SoaEmdBounds bounds(e, isa);
    std::vector<std::uint8_t> mask(e.lenslets());
    std::vector<float> upper(e.lenslets());
    rows.load(frame.view(), levels, 0);
    for (int n = 0; n < e.n; ++n) {
        if (n + 1 < e.n) rows.load(frame.view(), levels, n + 1);
        rows.mark_row(n, mask.data() + e.index(0, n));
        bounds.row(rows, n, mask.data() + e.index(0, n), kNoGradient, upper.data() + e.index(0, n));
    }
    return upper;
}

void put(Frame& frame, const Extents& e, int m, int n, const Histogram& h) {
    for (int k = 0; k < e.bins(); ++k) frame.set(m * e.i + k % e.i, n * e.j + k / e.i, h[static_cast<std::size_t>(k)]);
}

// Spots, two spots, scattered and dense light, single bins in corners, light beside noise, dark and saturated lenslets.
Frame any_frame(const Extents& e, int bits, Random& random) {
    const int full = (1 << bits) - 1;
    Frame frame(e.width_px(), e.height_px(), bits);
    const int kinds = pick(random, 1, 7);  // frames of one kind, and of many
    for (int n = 0; n < e.n; ++n) {
        for (int m = 0; m < e.m; ++m) {
            Histogram h(static_cast<std::size_t>(e.bins()));
            switch (pick(random, 0, kinds)) {
                case 0: h = blob(random, e.i, e.j, full - 1, 0.7); break;
                case 1: h = blob(random, e.i, e.j, full - 1, 0.3 * e.i); break;
                case 2: h = scattered(random, e.bins(), pick(random, 1, e.bins()), pick(random, 1, full - 1)); break;
                case 3: h = two_lobes(random, e.i, e.j, full - 1); break;
                case 4:  // a corner
                    h[static_cast<std::size_t>((pick(random, 0, 1) * (e.j - 1)) * e.i +
                                               pick(random, 0, 1) * (e.i - 1))] = static_cast<std::uint16_t>(full - 1);
                    break;
                case 5:  // a spot on a pedestal with noise
                    h = blob(random, e.i, e.j, full / 2, 0.7);
                    for (auto& v : h) v = static_cast<std::uint16_t>(v + pick(random, 3, 9));
                    break;
                case 6:
                    if (pick(random, 0, 3) == 0) h[0] = static_cast<std::uint16_t>(full);  // saturated
                    break;                                                                 // or dark
                default:
                    for (auto& v : h) v = static_cast<std::uint16_t>(pick(random, 0, full - 1));
            }
            put(frame, e, m, n, h);
        }
    }
    return frame;
}

// A million lenslets of bins of every size and depth; with HORD_LONG_TESTS ten million.
TEST(SoaEmdBounds, hold_the_exact_gradient_of_any_lenslet) {
    const int rounds = std::getenv("HORD_LONG_TESTS") != nullptr ? 10 : 1;
    Random random(21);
    std::size_t compared = 0;
    for (int round = 0; round < rounds; ++round) {
        for (int i = kMinBins; i <= kMaxBins; ++i) {
            for (int j = kMinBins; j <= kMaxBins; ++j) {
                const int bits = pick(random, 8, 16), few = i * j > 60 ? 1 : 8;
                const Extents e{pick(random, 3, 40), pick(random, 3, 8), i, j};
                for (int f = 0; f < few * 6; ++f) {
                    const Frame frame = any_frame(e, bits, random);
                    const LightLevels levels{static_cast<std::uint32_t>(pick(random, 0, 2)), 2, (1U << bits) - 1};
                    auto mapper = FeatureMapper::create(e, bits, levels, Feature::emd);
                    ASSERT_TRUE(mapper);
                    const auto exact = mapper->over_neighbours(frame.view());
                    const std::vector<float> upper = bounds_of(frame, e, levels, widest_isa());
                    for (std::size_t k = 0; k < e.lenslets(); ++k) {
                        if ((exact->mask[k] & kNoGradient) != 0) {
                            ASSERT_EQ(upper[k], 0);
                            continue;
                        }
                        ASSERT_GE(upper[k], exact->values[k]) << i << "x" << j << " " << bits << " bits, lenslet " << k;
                        ASSERT_LE(upper[k],
                                  40 * 1.5F * 2);  // finite: two plans over at most 28 bins, twice beside a hole
                        ++compared;
                    }
                }
            }
        }
    }
    EXPECT_GT(compared, std::size_t{50'000} * static_cast<std::size_t>(rounds));
}

TEST(SoaEmdBounds, have_the_same_bits_on_every_instruction_set) {
    Random random(22);
    for (const Extents& e :
         {Extents{37, 6, 9, 9}, Extents{18, 5, 15, 4}, Extents{16, 4, 3, 3}, Extents{20, 4, 8, 15}}) {
        for (const int bits : {8, 12}) {
            for (int round = 0; round < 8; ++round) {
                const Frame frame = any_frame(e, bits, random);
                const LightLevels levels{1, 4, (1U << bits) - 1};
                const std::vector<float> portable = bounds_of(frame, e, levels, Isa::portable);
                for (const Isa isa : isas()) EXPECT_EQ(bounds_of(frame, e, levels, isa), portable);
            }
        }
    }
}

// The middle one of 3x3 lenslets, whose neighbours hold one bin each.
float of_single_bins(const Extents& bins, int left, int right, int above, int below) {
    const Extents e{3, 3, bins.i, bins.j};
    Frame frame(e.width_px(), e.height_px(), 8);
    const auto light = [&](int m, int n, int bin) {
        Histogram h(static_cast<std::size_t>(e.bins()));
        h[static_cast<std::size_t>(bin)] = 200;
        put(frame, e, m, n, h);
    };
    for (int n = 0; n < 3; ++n) {
        for (int m = 0; m < 3; ++m) light(m, n, 0);
    }
    light(0, 1, left), light(2, 1, right), light(1, 0, above), light(1, 2, below);
    return bounds_of(frame, e, {1, 4, 255}, best_isa())[4];
}

// By hand. A step right costs 1. A step right and down: half of the light turns at its bin, half at the other's, and
// one of the halves takes the diagonal: (2 + sqrt(2)) / 2. Three right and one down cost two steps more.
TEST(SoaEmdBounds, are_the_costs_of_the_plans) {
    const Extents bins{3, 3, 9, 9};
    const float margin = 2 * (SoaEmdBounds::kMarginBins + 8 * SoaEmdBounds::kRelativeMargin);
    EXPECT_NEAR(of_single_bins(bins, 40, 41, 40, 40), 1, margin);
    EXPECT_NEAR(of_single_bins(bins, 40, 50, 40, 40), 1 + std::sqrt(0.5F), margin);
    EXPECT_NEAR(of_single_bins(bins, 40, 48, 40, 40), 1 + std::sqrt(0.5F), margin);  // left and down
    EXPECT_NEAR(of_single_bins(bins, 40, 52, 40, 40), 3 + std::sqrt(0.5F), margin);
    EXPECT_NEAR(of_single_bins(bins, 40, 41, 40, 49), std::sqrt(2.0F), margin);  // across and down, both 1
    EXPECT_NEAR(of_single_bins(bins, 7, 7, 7, 7), 0, margin);
}

// Spots that move by a share of a bin, the usual light: within 15 % of the exact gradient, half of them within 5 %.
TEST(SoaEmdBounds, are_close_where_spots_move) {
    const Extents e{60, 60, 9, 9};
    Frame frame(e.width_px(), e.height_px(), 8);
    for (int n = 0; n < e.n; ++n) {
        for (int m = 0; m < e.m; ++m) {
            Histogram h(81);
            const double x = 4 + 0.1 * (m - 30) + 0.02 * (n - 30), y = 4 + 0.09 * (n - 30);
            for (int k = 0; k < 81; ++k) {
                const double r2 = std::pow(k % 9 - x, 2) + std::pow(k / 9 - y, 2);
                h[static_cast<std::size_t>(k)] = static_cast<std::uint16_t>(240 * std::exp(-r2 / 0.98));
            }
            put(frame, e, m, n, h);
        }
    }
    const LightLevels levels{3, 16, 255};
    auto mapper = FeatureMapper::create(e, 8, levels, Feature::emd);
    const auto exact = mapper->over_neighbours(frame.view());
    const std::vector<float> upper = bounds_of(frame, e, levels, best_isa());
    std::vector<float> ratios;
    for (std::size_t k = 0; k < e.lenslets(); ++k) {
        if ((exact->mask[k] & kNoGradient) == 0) ratios.push_back(upper[k] / exact->values[k]);
    }
    std::ranges::sort(ratios);
    EXPECT_LT(ratios[ratios.size() / 2], 1.05F);
    EXPECT_LT(ratios.back(), 1.15F);
}

}  // namespace
}  // namespace hord::algo
