// Rows in SoA layout hold the values of decode_row(); features computed from them keep the bounds of
// algo/soa/soa_distances.h.
#include "algo/soa/soa_distances.h"

#include <algorithm>
#include <cmath>
#include <random>
#include <vector>

#include <gtest/gtest.h>

#include "algo/features/distance.h"
#include "algo/features/stencil.h"

namespace hord::algo {
namespace {

constexpr double kShareError = 0x1p-22;  // of itself: algo/soa/soa_row.h
constexpr double kDistanceError = 2e-5;  // algo/soa/soa_distances.h; the contract is 1e-4
constexpr double kGradientError = 6e-5;
constexpr double kSlopeError = 0x1p-21;

// Every kind of lenslet: dark, one photon, sparse, dense, full, saturated.
Frame hostile(const Extents& e, int bits, std::uint64_t seed) {
    std::mt19937_64 random(seed);
    const std::uint32_t full = (1U << bits) - 1;
    Frame frame(e.width_px(), e.height_px(), bits);
    for (int n = 0; n < e.n; ++n) {
        for (int m = 0; m < e.m; ++m) {
            const auto kind = random() % 12;
            for (int k = 0; k < e.bins(); ++k) {
                std::uint32_t dn = 0;
                if (kind >= 9) dn = static_cast<std::uint32_t>(random() % full);
                if (kind >= 2 && kind < 9 && random() % static_cast<unsigned>(e.bins()) < 5)
                    dn = static_cast<std::uint32_t>(random() % full);
                if (kind == 1 && k == e.bins() / 2) dn = 2;
                if (kind == 5 && random() % 40 == 0) dn = full;
                frame.set(m * e.i + k % e.i, n * e.j + k / e.i, dn);
            }
        }
    }
    return frame;
}

const Extents kGeometries[] = {{47, 5, 9, 9},  {16, 4, 3, 3}, {3, 3, 15, 15}, {33, 4, 15, 4},
                               {18, 5, 5, 14}, {5, 6, 8, 8},  {64, 3, 13, 7}};

std::vector<Isa> isas() {
    std::vector<Isa> all;
    for (const Isa isa : {Isa::portable, Isa::avx2, Isa::avx512}) {
        if (has(isa)) all.push_back(isa);
    }
    return all;
}

TEST(SoaRow, holds_what_decode_row_gives) {
    for (const Extents& e : kGeometries) {
        for (const int bits : {8, 10, 16}) {
            const Frame frame = hostile(e, bits, 3);
            const LightLevels levels{1, 4, (1U << bits) - 1};
            HordRow right(e);
            for (const Isa isa : isas()) {
                SoaRow shares(e, SoaUse::shares, isa), roots(e, SoaUse::roots, isa),
                    marginals(e, SoaUse::marginals, isa);
                for (int n = 0; n < e.n; ++n) {  // in order: a row must not affect the next one
                    decode_row(frame.view(), e, levels, n, right);
                    for (SoaRow* row : {&shares, &roots, &marginals}) row->decode(frame.view(), levels, n);
                    for (int m = 0; m < e.m; ++m) {
                        const auto at = static_cast<std::size_t>(m);
                        for (const SoaRow* row : {&shares, &roots, &marginals}) {
                            ASSERT_EQ(row->sums()[at], right.sums()[at]);
                            ASSERT_EQ(row->moments_x()[at], right.moments_x()[at]);
                            ASSERT_EQ(row->moments_y()[at], right.moments_y()[at]);
                            ASSERT_EQ(row->mask()[at], right.mask()[at]);
                        }
                        const Hord hord = right.hord(m);
                        const double sum = right.has_hord(m) ? hord.sum : 0;
                        std::vector<double> x(static_cast<std::size_t>(e.i)), y(static_cast<std::size_t>(e.j));
                        for (int k = 0; k < e.bins(); ++k) {
                            const double h = sum > 0 ? hord.mass[k] / sum : 0;
                            ASSERT_NEAR(shares.array(k)[m], h, kShareError * h);
                            ASSERT_NEAR(roots.array(k)[m], std::sqrt(h), kShareError * std::sqrt(h));
                            x[static_cast<std::size_t>(k % e.i)] += h;
                            y[static_cast<std::size_t>(k / e.i)] += h;
                        }
                        double passed = 0;
                        for (int k = 0; k < e.i - 1; ++k)
                            ASSERT_NEAR(marginals.array(k)[m], passed += x[static_cast<std::size_t>(k)],
                                        2 * kShareError);
                        passed = 0;
                        for (int k = 0; k < e.j - 1; ++k)
                            ASSERT_NEAR(marginals.array(e.i - 1 + k)[m], passed += y[static_cast<std::size_t>(k)],
                                        2 * kShareError);
                    }
                }
            }
        }
    }
}

// Windows of bins begin and end differently for every number of bins; half a lenslet at full scale has the largest
// moments.
TEST(SoaRow, holds_for_every_number_of_bins_however_the_light_lies) {
    std::mt19937 random(6);
    for (int i = kMinBins; i <= kMaxBins; ++i) {
        for (const int bits : {8, 16}) {
            const Extents e{19, 5, i, kMaxBins};
            const std::uint32_t full = (1U << bits) - 1;
            const LightLevels levels{0, 1, 1U << bits};
            Frame frame(e.width_px(), e.height_px(), bits);
            for (int y = 0; y < e.height_px(); ++y) {
                // The lit bins of a line are the same range for all lenslets of the row, or another for each.
                for (int m = 0; m < e.m; ++m) {
                    const int n = y / e.j;
                    int from = 0, to = i / 2;
                    if (n == 1) from = i - i / 2, to = i;
                    if (n == 2) from = y % i, to = std::min(from + 1 + y / i % 3, i);
                    if (n >= 3)
                        from = static_cast<int>(random() % static_cast<unsigned>(i)),
                        to = std::min(from + static_cast<int>(random() % 9), i);
                    for (int k = from; k < to; ++k)
                        frame.set(m * i + k, y, n < 2 ? full : 1 + static_cast<std::uint32_t>(random() % full));
                }
            }
            HordRow right(e);
            for (const Isa isa : isas()) {
                SoaRow shares(e, SoaUse::shares, isa), sums(e, SoaUse::sums, isa),
                    marginals(e, SoaUse::marginals, isa, false);
                for (int n = 0; n < e.n; ++n) {
                    decode_row(frame.view(), e, levels, n, right);
                    for (SoaRow* row : {&shares, &sums, &marginals}) row->decode(frame.view(), levels, n);
                    for (int m = 0; m < e.m; ++m) {
                        const auto at = static_cast<std::size_t>(m);
                        for (const SoaRow* row : {&shares, &sums, &marginals}) {
                            ASSERT_EQ(row->sums()[at], right.sums()[at]) << i << " bins, row " << n;
                            ASSERT_EQ(row->mask()[at], right.mask()[at]);
                            ASSERT_EQ(row->moments_x()[at], row == &marginals ? 0 : right.moments_x()[at])
                                << i << " bins, row " << n;
                            ASSERT_EQ(row->moments_y()[at], row == &marginals ? 0 : right.moments_y()[at]);
                        }
                        const Hord hord = right.hord(m);
                        std::uint32_t passed = 0;
                        for (int k = 0; k < e.bins(); ++k) {
                            const float share =
                                static_cast<float>(hord.mass[k]) * (1.0F / static_cast<float>(hord.sum));
                            ASSERT_EQ(shares.array(k)[m], right.has_hord(m) ? share : 0.0F);
                        }
                        for (int k = 0; k + 1 < i; ++k) {
                            for (int j = 0; j < e.j; ++j) passed += hord.mass[j * i + k];
                            ASSERT_EQ(marginals.array(k)[m],
                                      right.has_hord(m)
                                          ? static_cast<float>(passed) * (1.0F / static_cast<float>(hord.sum))
                                          : 0.0F);
                        }
                    }
                }
            }
        }
    }
}

TEST(SoaRow, a_dark_level_above_the_full_scale_leaves_no_light) {
    const Extents e{20, 3, 9, 9};
    for (const int bits : {8, 16}) {
        const Frame frame = hostile(e, bits, 8);
        const LightLevels levels{(1U << bits) + 40, 1, 1U << 17};
        HordRow right(e);
        SoaRow planes(e, SoaUse::shares, best_isa());
        decode_row(frame.view(), e, levels, 1, right);
        planes.decode(frame.view(), levels, 1);
        for (std::size_t m = 0; m < static_cast<std::size_t>(e.m); ++m) {
            EXPECT_EQ(right.sums()[m], 0U);
            EXPECT_EQ(planes.sums()[m], 0U);
            EXPECT_EQ(right.mask()[m], kDark);
            EXPECT_EQ(planes.mask()[m], kDark);
        }
    }
}

double bound(Feature feature, double right, double of_others) {
    return feature == Feature::centroid ? kSlopeError + 0x1p-24 * right : of_others;
}

TEST(SoaDistances, keeps_its_error_bounds_on_hostile_frames) {
    for (const Extents& e : kGeometries) {
        for (const int bits : {8, 12, 16}) {
            const Frame frame = hostile(e, bits, 4), reference = hostile(e, bits, 5);
            const LightLevels levels{1, 4, (1U << bits) - 1};
            std::vector<HordRow> rows, wanted;
            for (int n = 0; n < e.n; ++n) {
                decode_row(frame.view(), e, levels, n, rows.emplace_back(e));
                decode_row(reference.view(), e, levels, n, wanted.emplace_back(e));
            }
            const auto has_hord = [&](int m, int n) { return rows[static_cast<std::size_t>(n)].has_hord(m); };
            const auto hord = [&](int m, int n) { return rows[static_cast<std::size_t>(n)].hord(m); };
            for (const Feature feature : {Feature::chi2, Feature::hellinger, Feature::marginal, Feature::centroid}) {
                auto distance = Distance::create(feature, e.i, e.j);
                SoaDistances planes(e, feature, best_isa());
                std::vector<float> values(e.lenslets());
                std::vector<std::uint8_t> mask(e.lenslets());
                planes.over_neighbours(frame.view(), levels, 0, e.n, values.data(), mask.data());
                for (int n = 0; n < e.n; ++n) {
                    for (int m = 0; m < e.m; ++m) {
                        const auto k = static_cast<std::size_t>(n * e.m + m);
                        double right = 0;
                        if (m > 0 && n > 0 && m < e.m - 1 && n < e.n - 1 && has_hord(m, n)) {
                            const Stencil s = stencil(has_hord(m - 1, n), has_hord(m + 1, n)),
                                          t = stencil(has_hord(m, n - 1), has_hord(m, n + 1));
                            if (s.valid() && t.valid()) {
                                const double x = (*distance)(hord(m + s.before, n), hord(m + s.after, n)) * s.weight();
                                const double y = (*distance)(hord(m, n + t.before), hord(m, n + t.after)) * t.weight();
                                right = std::sqrt(x * x + y * y);
                            }
                            ASSERT_EQ((mask[k] & kNoGradient) == 0, s.valid() && t.valid());
                        }
                        ASSERT_NEAR(values[k], right, bound(feature, right, kGradientError))
                            << name_of(feature) << " " << m << ", " << n;
                    }
                }
                planes.against(frame.view(), reference.view(), levels, 0, e.n, values.data(), mask.data());
                for (int n = 0; n < e.n; ++n) {
                    for (int m = 0; m < e.m; ++m) {
                        const auto k = static_cast<std::size_t>(n * e.m + m);
                        const bool both = has_hord(m, n) && wanted[static_cast<std::size_t>(n)].has_hord(m);
                        ASSERT_EQ((mask[k] & kNoGradient) == 0, both);
                        const double right =
                            both ? (*distance)(hord(m, n), wanted[static_cast<std::size_t>(n)].hord(m)) : 0;
                        ASSERT_NEAR(values[k], right, bound(feature, right, kDistanceError));
                    }
                }
            }
        }
    }
}

// Lenslets beside a hole are computed one by one, the others sixteen at a time: same bits wherever the blocks begin.
TEST(SoaDistances, does_not_depend_on_where_the_blocks_begin) {
    const Extents wide{40, 7, 9, 9}, moved{35, 7, 9, 9};
    const Frame frame = hostile(wide, 8, 6);
    Frame cut(moved.width_px(), moved.height_px(), 8);
    for (int y = 0; y < cut.height_px(); ++y) {
        for (int x = 0; x < cut.width_px(); ++x) cut.set(x, y, frame.view().sample(x + 5 * 9, y));
    }
    for (std::size_t f = 0; f <= static_cast<std::size_t>(Feature::anisotropy); ++f) {
        const auto feature = static_cast<Feature>(f);
        if (!SoaDistances::covers(feature)) continue;
        std::vector<float> a(wide.lenslets()), b(moved.lenslets());
        std::vector<std::uint8_t> mask(wide.lenslets());
        SoaDistances(wide, feature, best_isa()).over_neighbours(frame.view(), {1, 4, 255}, 0, 7, a.data(), mask.data());
        SoaDistances(moved, feature, best_isa()).over_neighbours(cut.view(), {1, 4, 255}, 0, 7, b.data(), mask.data());
        for (int n = 1; n < 6; ++n) {
            for (int m = 1; m < moved.m - 1; ++m)
                ASSERT_EQ(a[static_cast<std::size_t>(n * 40 + m + 5)], b[static_cast<std::size_t>(n * 35 + m)])
                    << name_of(feature);
        }
    }
}

}  // namespace
}  // namespace hord::algo
