// Parts are registered to a reference and compared with it.
#include <cmath>

#include <gtest/gtest.h>

#include "algo/frame/mask.h"
#include "algo/reference/reference_comparison.h"
#include "algo/reference/reference_sampler.h"
#include "tests/algo/reference/good_parts.h"

namespace hord::algo {
namespace {

using namespace testing;

TEST(Reference, parts_are_registered_to_a_small_fraction_of_a_lenslet) {
    ASSERT_TRUE(learned().left_out.empty()) << learned().left_out[0].why;
    // The reference's pose is the median of the parts': only differences are compared.
    for (std::uint64_t k = 0; k < 16; ++k) {
        const Pose a = wobble(k), b = wobble((k + 1) % 16);
        const Pose &p = *learned().poses[k], &q = *learned().poses[(k + 1) % 16];
        EXPECT_NEAR(p.x - q.x, a.x - b.x, 0.1) << k;
        EXPECT_NEAR(p.y - q.y, a.y - b.y, 0.1) << k;
        EXPECT_NEAR(p.sine - q.sine, a.sine - b.sine, 0.01) << k;  // 0.15 lenslet at the rim
    }
}

// Dark bins have little noise. A dark bin at ten standard deviations looks like a shift.
TEST(Reference, one_reading_beside_a_spot_is_no_bend) {
    const Reference& r = learned().reference;
    const Pose pose{0.2, -0.1, 0};
    Frame frame = part(pose);  // without noise
    constexpr std::uint32_t kReading = 8;
    std::vector<std::uint8_t> read_there(kField.lenslets());
    for (int n = 10; n < 27; n += 2) {
        for (int m = 8; m < 33; m += 2) {
            const auto sample = [&](int i, int j) { return frame.view().sample(m * kField.i + i, n * kField.j + j); };
            int row = 0, left = 0;  // row of the brightest bin; column of the first lit bin to its left
            for (int k = 0; k < kField.bins(); ++k) {
                if (sample(k % kField.i, k / kField.i) > sample(left, row)) left = k % kField.i, row = k / kField.i;
            }
            while (left > 0 && sample(left - 1, row) > kLevels.dark) --left;
            if (left == 0) continue;
            frame.set(m * kField.i + left - 1, n * kField.j + row, kLevels.dark + kReading);
            read_there[static_cast<std::size_t>(n * kField.m + m)] = 1;
        }
    }
    ReferenceComparer comparer(r);
    HordRow row(kField);
    std::vector<Difference> differences(static_cast<std::size_t>(kField.m));
    int looked_at = 0;
    for (int n = 0; n < kField.n; ++n) {
        decode_row(frame.view(), kField, kLevels, n, row);
        comparer.compare_row(frame.view(), row.sums(), row.mask(), n, PoseMap(pose, kField), 1, kLevels.dark,
                             differences);
        for (int m = 0; m < kField.m; ++m) {
            if (read_there[static_cast<std::size_t>(n * kField.m + m)] == 0 ||
                !differences[static_cast<std::size_t>(m)].has_hord)
                continue;
            ++looked_at;
            EXPECT_LT(scores_of(differences[static_cast<std::size_t>(m)],
                                r)[static_cast<std::size_t>(Deviation::deflection_shift)],
                      4)
                << m << ", " << n;
        }
    }
    EXPECT_GT(looked_at, 80);
}

// Along a part's row reference HORDs are interpolated between rows, then between columns: if the row is horizontal, the
// same as from all sixteen lenslets around at once.
TEST(Reference, reference_hords_along_a_row_are_those_of_single_places) {
    const Reference& r = learned().reference;
    const ReferenceSampler reader(r, best_isa());
    const ReferenceSoa planes(r);
    const int at_once = lanes_at_once(best_isa());
    for (const double sine : {0.0, 0.0175, -0.0175, 0.06}) {
        ReferenceRowSampler row(r, planes, best_isa());
        const PoseMap map(Pose{0.37, -0.23, sine}, kField);
        int compared = 0, with_hord = 0, wide = 0;
        for (int n = 0; n < kField.n; ++n) {
            row.start_row(map, n, 0.8);
            for (int m = 0; m < kField.m; ++m) {
                const auto at = map.to_reference(m, n);
                const int column = static_cast<int>(std::floor(at.m)), block = (column - 1) >> 4,
                          lane = (column - 1) & 15, first = lane / at_once * at_once;
                std::vector<float> alone(r.stride() + 16);
                const ReferenceSampler::ReferenceHord a = reader.read(at.m, at.n, 0.8, alone.data());
                with_hord += a.has_hord ? 1 : 0;
                row.move_to(block);
                if ((row.complete() >> lane & 1U) == 0) continue;
                ReferenceRowSampler::Lanes lanes{};
                for (std::size_t c = 0; c < 4; ++c)
                    lanes.weights[c][lane] = static_cast<float>(cubic_at(at.m - column).of[c]);
                const BinRect& lit = row.lit();
                std::vector<float> along(static_cast<std::size_t>(lit.columns() * lit.rows() * at_once));
                row.interpolate(first, lit, lanes, along.data(), lit.columns());
                ASSERT_TRUE(a.has_hord) << m << ", " << n;
                const double close = sine == 0 ? 2e-6 : std::abs(sine) < 0.02 ? 0.02 : 0.1;
                EXPECT_NEAR(lanes.light[lane], a.light, close * a.light) << m << ", " << n;
                EXPECT_NEAR(lanes.share[lane], a.share, close) << m << ", " << n;
                double differs = 0;
                for (int j = 0; j < kField.j; ++j) {
                    for (int i = 0; i < kField.i; ++i) {
                        const float here = lit.has(i, j)
                            ? along[static_cast<std::size_t>(((j - lit.top) * lit.columns() + i - lit.left) * at_once +
                                                             lane - first)]
                            : 0.0F;
                        differs += static_cast<double>(std::abs(alone[r.place(i, j)] - here));
                    }
                }
                EXPECT_LT(differs, close) << m << ", " << n;
                ++compared;
                wide += lit.columns() > 5 ? 1 : 0;
            }
        }
        EXPECT_GT(compared, 400);
        EXPECT_GT(wide, 50);
        // All lanes are compared, except those at the edges of the reference and a few more if the row is steep.
        EXPECT_GT(compared, with_hord * 6 / 10) << sine;
    }
}

// Noise in a dark bin beside a narrow spot, which scattered light would reach, is no haze.
TEST(Reference, one_dark_reading_beside_a_narrow_spot_is_no_scattering) {
    const Extents e{24, 8, 9, 9};
    constexpr double kElectrons = 2000, kSigma = 0.6;
    constexpr std::uint32_t kReading = 24;  // DN above the dark level
    const auto share = [](int bin) {
        const auto below = [&](double edge) { return 0.5 * std::erf(edge / (kSigma * std::sqrt(2.0))); };
        return below(bin - 3.5) - below(bin - 4.5);
    };
    Reference r;
    r.extents = e;
    r.bits = 12;
    r.levels = kLevels;
    r.sensor = {1, 2, 6};
    r.parts = 24;
    r.shares.assign(e.lenslets() * r.stride(), 0);
    r.light.assign(e.lenslets(), static_cast<float>(kElectrons));
    for (auto* map : {&r.x, &r.y, &r.emd, &r.frobenius}) map->assign(e.lenslets(), 0);
    r.mask.assign(e.lenslets(), kValid);
    for (auto& spread : r.spread) spread.assign(e.lenslets(), 1e-5F);
    for (std::size_t k = 0; k < e.lenslets(); ++k) {
        for (int b = 0; b < e.bins(); ++b)
            r.shares[k * r.stride() + r.place(b % 9, b / 9)] =
                static_cast<std::uint16_t>(32767 * share(b % 9) * share(b / 9));
    }
    Frame frame(e.width_px(), e.height_px(), 12);
    for (int y = 0; y < e.height_px(); ++y) {
        for (int x = 0; x < e.width_px(); ++x) {
            const auto light = static_cast<std::uint32_t>(std::lround(kElectrons * share(x % 9) * share(y % 9)));
            frame.set(x, y, kLevels.dark + light + (x % 9 == 6 && y % 9 == 6 ? kReading : 0));
        }
    }
    ReferenceComparer comparer(r);
    HordRow row(e);
    std::vector<Difference> out(static_cast<std::size_t>(e.m));
    decode_row(frame.view(), e, kLevels, 4, row);
    comparer.compare_row(frame.view(), row.sums(), row.mask(), 4, PoseMap({}, e), 1, kLevels.dark, out);
    ASSERT_TRUE(out[12].has_hord);
    EXPECT_LT(std::abs(scores_of(out[12], r)[static_cast<std::size_t>(Deviation::scattering)]), 4);
}

// Rows and columns of bins are processed differently (algo/reference/template_fit.h), but a shift along either has the
// same result.
TEST(Reference, light_moves_as_far_along_rows_of_bins_as_along_columns) {
    const Extents e{24, 8, 9, 9};
    Reference r;
    r.extents = e;
    r.bits = 12;
    r.levels = kLevels;
    r.sensor = {2.5F, 1.5F, 3.0F};
    r.parts = 16;
    r.shares.assign(e.lenslets() * r.stride(), 0);
    r.light.assign(e.lenslets(), 2000), r.x.assign(e.lenslets(), 0), r.y.assign(e.lenslets(), 0),
        r.emd.assign(e.lenslets(), 0), r.frobenius.assign(e.lenslets(), 0);
    r.mask.assign(e.lenslets(), kValid);
    for (auto& spread : r.spread) spread.assign(e.lenslets(), 1e-4F);
    const auto weight = [](int k) { return k == 4 ? 2 : k == 3 || k == 5 ? 1 : 0; };  // of 4
    for (std::size_t k = 0; k < e.lenslets(); ++k) {
        for (int b = 0; b < e.bins(); ++b)
            r.shares[k * r.stride() + r.place(b % 9, b / 9)] =
                static_cast<std::uint16_t>(weight(b % 9) * weight(b / 9) * 2047);
    }
    constexpr int kFifths = 1;  // of the light move by one bin
    const auto differences = [&](bool along_rows) {
        Frame frame(e.width_px(), e.height_px(), 12);
        for (int y = 0; y < e.height_px(); ++y) {
            for (int x = 0; x < e.width_px(); ++x) {
                const int i = x % 9, j = y % 9,
                          before = along_rows ? weight(i - 1) * weight(j) : weight(i) * weight(j - 1);
                frame.set(x, y,
                          kLevels.dark +
                              static_cast<std::uint32_t>(
                                  2000 * ((5 - kFifths) * weight(i) * weight(j) + kFifths * before) / (5 * 16)));
            }
        }
        ReferenceComparer comparer(r);
        HordRow row(e);
        std::vector<Difference> out(static_cast<std::size_t>(e.m));
        decode_row(frame.view(), e, kLevels, 4, row);
        comparer.compare_row(frame.view(), row.sums(), row.mask(), 4, PoseMap({}, e), 1, kLevels.dark, out);
        return out[12];
    };
    const Difference across = differences(true), down = differences(false);
    ASSERT_TRUE(across.has_hord && down.has_hord);
    EXPECT_GT(across.x, 0.1);  // not 0.2: part of it counts as scattered, and the spot is as narrow as the differences
    EXPECT_NEAR(down.y, across.x, 1e-4);
    EXPECT_NEAR(down.x, across.y, 1e-4);
    EXPECT_NEAR(down.y_variance / across.x_variance, 1, 1e-3);
    EXPECT_NEAR(down.scattering, across.scattering, 1e-4);
    EXPECT_NEAR(down.chi2 / across.chi2, 1, 1e-3);
}

TEST(Reference, the_comparison_has_the_same_bits_on_every_instruction_set) {
    const Frame frame = seen(part(wobble(12)), 12);
    HordRow row(kField);
    std::vector<std::vector<Difference>> all;
    for (const Isa isa : {Isa::portable, Isa::avx2, Isa::avx512}) {
        if (!has(isa)) continue;
        ReferenceComparer comparer(learned().reference, isa);
        std::vector<Difference> differences(kField.lenslets());
        for (int n = 0; n < kField.n; ++n) {
            decode_row(frame.view(), kField, kLevels, n, row);
            comparer.compare_row(
                frame.view(), row.sums(), row.mask(), n, PoseMap({0.3, -0.4, 0.01}, kField), 1, kLevels.dark,
                std::span(differences)
                    .subspan(static_cast<std::size_t>(n * kField.m), static_cast<std::size_t>(kField.m)));
        }
        all.push_back(std::move(differences));
    }
    for (std::size_t k = 0; k < all[0].size(); ++k) {
        for (const auto& other : all) {
            const Difference &a = all[0][k], &b = other[k];
            const bool same = a.has_hord == b.has_hord && a.light == b.light && a.x == b.x && a.y == b.y &&
                a.scattering == b.scattering && a.chi2 == b.chi2 && a.degrees == b.degrees &&
                a.x_variance == b.x_variance && a.scattering_variance == b.scattering_variance;
            ASSERT_TRUE(same) << k;
        }
    }
}

}  // namespace
}  // namespace hord::algo
