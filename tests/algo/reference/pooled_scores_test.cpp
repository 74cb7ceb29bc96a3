// What several lenslets show together: on drawn fields of deviations, with noise of one standard deviation.
#include "algo/reference/pooled_scores.h"

#include <cmath>
#include <functional>
#include <random>

#include <gtest/gtest.h>

#include "algo/frame/mask.h"

namespace hord::algo {
namespace {

constexpr Extents kField{37, 41, 9, 9};
constexpr float kSigma = 0.02F;  // of every deviation

struct Field {
    std::vector<Difference> differences;
    std::vector<std::uint8_t> mask;
};

Field field(
    std::uint64_t seed, const std::function<void(int, int, Difference&)>& change = [](int, int, Difference&) {}) {
    std::mt19937_64 random(seed);
    std::normal_distribution<float> normal(0, kSigma);
    Field f{std::vector<Difference>(kField.lenslets()), std::vector<std::uint8_t>(kField.lenslets(), kValid)};
    for (int n = 0; n < kField.n; ++n) {
        for (int m = 0; m < kField.m; ++m) {
            Difference& d = f.differences[kField.index(m, n)];
            d.has_light = d.has_hord = true;
            d.at = static_cast<std::uint32_t>(kField.index(m, n));
            d.light = normal(random), d.x = normal(random), d.y = normal(random), d.scattering = normal(random);
            d.light_variance = d.x_variance = d.y_variance = d.scattering_variance = kSigma * kSigma;
            change(m, n, d);
        }
    }
    return f;
}

// Without spread; with the scales of twelve good fields.
const Reference& reference() {
    static const Reference learned = [] {
        Reference r;
        r.extents = kField;
        for (auto& spread : r.spread) spread.assign(kField.lenslets(), 0);
        PooledScorer scorer(kField);
        r.pooled_scales.assign(pooled_filters().size(), 0);
        for (std::uint64_t seed = 0; seed < 12; ++seed) {
            const Field f = field(1000 + seed);
            const auto scales = scorer.measure(f.differences, f.mask, r);
            for (std::size_t k = 0; k < scales.size(); ++k) r.pooled_scales[k] += scales[k] / 12;
        }
        return r;
    }();
    return learned;
}

PooledPeak peak_of(const Field& f, Isa isa = widest_isa()) {
    PooledScorer scorer(kField, isa);
    PooledPeak peak = scorer.highest(f.differences, f.mask, reference());
    scorer.find(peak, f.differences);
    return peak;
}

TEST(PooledScores, sums_of_noise_have_its_standard_deviation) {
    for (const float scale : reference().pooled_scales) EXPECT_NEAR(scale, 1, 0.1);
}

TEST(PooledScores, good_fields_score_low_and_tilts_do_not_count) {
    for (std::uint64_t seed = 0; seed < 40; ++seed) {
        EXPECT_LT(peak_of(field(seed)).score, 6) << seed;
        const auto tilted = [](int m, int n, Difference& d) {
            d.x += 0.004F * static_cast<float>(m), d.y -= 0.003F * static_cast<float>(n), d.light += 0.05F;
        };
        EXPECT_LT(peak_of(field(seed, tilted)).score, 6) << seed;
    }
}

// No lenslet of these deviates by more than three standard deviations of its noise.
TEST(PooledScores, haze_striae_and_faint_scratches_are_found_where_they_are) {
    struct Case {
        Deviation deviation;
        bool band;
        double m, n;
        std::function<void(int, int, Difference&)> change;
    };
    const Case cases[] = {
        {Deviation::scattering, false, 20, 12,
         [](int m, int n, Difference& d) {
             if (std::hypot(m - 20, n - 12) < 1.5) d.scattering += 3 * kSigma;
         }},
        {Deviation::light, true, 14.5, 30,
         [](int m, int n, Difference& d) {
             if (n == 30 && m >= 11 && m <= 18) d.light -= 3 * kSigma;
         }},
        {Deviation::light, true, 24.5, 20.5,  // along the diagonal
         [](int m, int n, Difference& d) {
             if (m - n == 4 && m >= 21 && m <= 28) d.light -= 3 * kSigma;
         }},
        {Deviation::deflection_shift, true, 25.5, 18.5,
         [](int m, int n, Difference& d) {
             if (n >= 15 && n <= 22 && m >= 24 && m <= 27) d.x += (m >= 26 ? 3 : -3) * kSigma;
         }},
    };
    for (const Case& c : cases) {
        for (std::uint64_t seed = 200; seed < 205; ++seed) {
            const PooledPeak peak = peak_of(field(seed, c.change));
            SCOPED_TRACE(seed);
            EXPECT_GT(peak.score, 7);
            EXPECT_EQ(pooled_filters()[peak.filter].deviation, c.deviation);
            EXPECT_EQ(pooled_filters()[peak.filter].is_band(), c.band);
            EXPECT_NEAR(peak.m, c.m, 1.6);
            EXPECT_NEAR(peak.n, c.n, 1.6);
            EXPECT_EQ(peak.length > 5, c.band);
        }
    }
}

// Waves over the whole field are how good parts vary: they hide as much as they are high, and are no defect.
TEST(PooledScores, waves_widen_the_scale) {
    const auto wave = [](int m, int, Difference& d) { d.x += 4 * kSigma * std::sin(0.9F * static_cast<float>(m)); };
    const PooledPeak peak = peak_of(field(1, wave));
    EXPECT_LT(peak.score, 6);
}

TEST(PooledScores, what_is_outside_or_without_scales_does_not_count) {
    Field f = field(3, [](int m, int n, Difference& d) {
        if (n < 6 && m < 20) d.light -= 0.5F;
    });
    EXPECT_GT(peak_of(f).score, 10);
    for (int n = 0; n < 6; ++n) {
        for (int m = 0; m < 20; ++m) f.mask[kField.index(m, n)] = m % 2 == 0 ? kOutside : kSaturated;
    }
    EXPECT_LT(peak_of(f).score, 6);
    Reference unknown = reference();
    unknown.pooled_scales.clear();
    EXPECT_EQ(PooledScorer(kField).highest(f.differences, f.mask, unknown).score, 0);
}

TEST(PooledScores, every_instruction_set_gives_the_same_bits) {
    for (std::uint64_t seed = 0; seed < 5; ++seed) {
        const Field f = field(seed);
        const PooledPeak portable = peak_of(f, Isa::portable);
        for (const Isa isa : {Isa::avx2, Isa::avx512}) {
            if (!has(isa)) continue;
            const PooledPeak peak = peak_of(f, isa);
            EXPECT_EQ(peak.score, portable.score);
            EXPECT_EQ(peak.filter, portable.filter);
            EXPECT_EQ(peak.m, portable.m);
        }
    }
}

}  // namespace
}  // namespace hord::algo
