// Learning a reference from good parts, registering a part, and judging it against the reference.
#include <array>
#include <cmath>
#include <cstdlib>
#include <memory>
#include <random>

#include <gtest/gtest.h>

#include "algo/ageing/dust.h"
#include "algo/ageing/light_trend.h"
#include "algo/frame/mask.h"
#include "algo/inspection/pipeline.h"
#include "algo/reference/read_noise.h"
#include "algo/reference/reference_comparison.h"
#include "algo/reference/reference_learner.h"
#include "algo/reference/reference_sampler.h"
#include "tests/support/frames.h"

namespace hord::algo {
namespace {

using testing::drawn;
using testing::noisy;
using testing::Spot;

constexpr Extents kField{41, 37, 9, 9};
constexpr int kBits = 12;
constexpr double kElectrons = 2000;  // a lenslet
constexpr float kReadDn = 2;
const LightLevels kLevels{6, 60, 4095};
constexpr double kHalfM = 15, kHalfN = 12;  // of the elliptic part, lenslets

// A part in free light that deflects light more along x than along y, so that it is not round. One electron a DN.
Frame part(
    const Pose& pose, const std::function<void(int, int, Spot&)>& defect = [](int, int, Spot&) {}) {
    const PoseMap map(pose, kField);
    const double full_bin = kElectrons / (1.22 * 1.22);
    const auto inside = [&](int m, int n) {  // share of the lenslet, of 7x7 points
        double share = 0;
        for (int k = 0; k < 49; ++k) {
            const auto q = map.to_reference(m + (k % 7 - 3) / 7.0, n + (k / 7 - 3) / 7.0);
            share += std::hypot((q.m - 0.5 * (kField.m - 1)) / kHalfM, (q.n - 0.5 * (kField.n - 1)) / kHalfN) < 1
                ? 1.0 / 49
                : 0;
        }
        return share;
    };
    Frame frame = drawn(kField, kBits, full_bin, [&](int m, int n) {
        const auto q = map.to_reference(m, n);
        const auto deflection_shift =
            map.turned(0.15 * (q.m - 0.5 * (kField.m - 1)), 0.08 * (q.n - 0.5 * (kField.n - 1)));
        Spot spot{deflection_shift.m, deflection_shift.n, 0.9};
        defect(m, n, spot);
        spot.light *= inside(m, n);
        return spot;
    });
    const Frame beside = drawn(kField, kBits, full_bin, [&](int m, int n) { return Spot{0, 0, 1 - inside(m, n)}; });
    for (int y = 0; y < frame.height_px(); ++y) {
        for (int x = 0; x < frame.width_px(); ++x)
            frame.set(x, y, frame.view().sample(x, y) + beside.view().sample(x, y));
    }
    return frame;
}
Frame seen(const Frame& frame, std::uint64_t seed, double light = 1) {
    return noisy(frame, {1, 2, light}, seed, kBits);
}

Pose wobble(std::uint64_t seed) {
    std::mt19937_64 random(seed);
    std::uniform_real_distribution<double> shift(-0.5, 0.5), turn(-0.0175, 0.0175);
    const double x = shift(random), y = shift(random);
    return {x, y, std::sin(turn(random))};
}

Result<Learned> learn(std::size_t count, const std::function<Frame(std::size_t)>& frame,
                      std::optional<float> gain = 1.0F) {
    LearnOptions options;
    options.levels = kLevels;
    options.electrons_per_dn = gain;
    options.read_dn = kReadDn;
    return learn_reference(
        kField, kBits, count, [&](std::size_t k) -> Result<Frame> { return frame(k); }, options);
}

// Learned from sixteen parts with slightly different poses.
const Learned& learned() {
    static const Learned all = [] {
        std::vector<Frame> frames;
        for (std::uint64_t k = 0; k < 16; ++k) frames.push_back(seen(part(wobble(k)), k));
        return learn(frames.size(), [&](std::size_t k) { return frames[k]; }).value();
    }();
    return all;
}

Recipe recipe() {
    Recipe r;
    r.dark_dn = kLevels.dark, r.min_sum_dn = kLevels.min_sum, r.saturated_dn = kLevels.saturated;
    r.reference = std::make_shared<Reference>(learned().reference);
    return r;
}
struct Judged {
    Verdict verdict;
    Reason reason;
    std::vector<Defect> defects;
    std::vector<float> z_score;
    Registered registered;
};
Judged judge(const Frame& frame, const Recipe& with = recipe(), int threads = 1) {
    auto pipeline = Pipeline::create(kField, kBits, with, threads);
    EXPECT_TRUE(pipeline) << pipeline.error().message();
    const auto found = pipeline->inspect(frame.view());
    EXPECT_TRUE(found);
    return {found->verdict,
            found->reason,
            {found->defects.begin(), found->defects.end()},
            {found->z_score.begin(), found->z_score.end()},
            found->registered};
}

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

TEST(Reference, good_parts_score_about_normally_from_200_to_4000_electrons) {
    for (const double light : {0.1, 0.7, 1.0, 2.0}) {
        std::array<double, kDeviations> squares{};
        double count = 0;
        const Reference& r = learned().reference;
        ReferenceComparer comparer(r);
        Registrar registrar(kField);
        HordRow row(kField);
        std::vector<Difference> differences(static_cast<std::size_t>(kField.m));
        for (std::uint64_t seed = 100; seed < 106; ++seed) {
            const Frame frame = seen(part(wobble(seed)), seed, light);
            std::vector<std::uint32_t> sums;
            std::vector<std::uint8_t> mask;
            std::vector<Deflection> deflections(kField.lenslets());
            for (int n = 0; n < kField.n; ++n) {
                decode_row(frame.view(), kField, kLevels, n, row);
                sums.insert(sums.end(), row.sums().begin(), row.sums().end());
                mask.insert(mask.end(), row.mask().begin(), row.mask().end());
                mean_deflections(
                    row,
                    std::span(deflections)
                        .subspan(static_cast<std::size_t>(n * kField.m), static_cast<std::size_t>(kField.m)));
            }
            const Registered at = registrar.find(r.maps(), deflections, sums, mask, 1, r.parts);
            ASSERT_TRUE(at.found());
            EXPECT_NEAR(at.light, light, 0.2 * light);  // the dark level takes more of weak light
            for (int n = 0; n < kField.n; ++n) {
                decode_row(frame.view(), kField, kLevels, n, row);
                comparer.compare_row(frame.view(), row.sums(), row.mask(), n, PoseMap(at.pose, kField), at.light, differences);
                for (const Difference& d : differences) {
                    if (!d.has_hord) continue;
                    const Scores scores = scores_of(d, r);
                    for (std::size_t w = 0; w < kDeviations; ++w)
                        squares[w] += static_cast<double>(scores[w]) * static_cast<double>(scores[w]);
                    count += 1;
                }
            }
        }
        // Light and the rest: variance 1; deflection_shift: of two, 2.
        for (std::size_t w = 0; w < kDeviations; ++w) {
            const double variance = squares[w] / count / (w == 1 ? 2 : 1);
            // For the scattering, dark bins count with more noise than they have (docs/notes/reference.md).
            EXPECT_GT(variance, w == 2 ? 0.1 : 0.3) << "light " << light << ", score " << w;
            EXPECT_LT(variance, 1.7) << "light " << light << ", score " << w;
        }
    }
}

TEST(Reference, a_good_part_passes_however_it_lies) {
    for (std::uint64_t seed = 200; seed < 220; ++seed) {
        const Judged judged = judge(seen(part(wobble(seed)), seed, seed % 2 == 0 ? 1.0 : 0.7));
        EXPECT_EQ(judged.verdict, Verdict::pass) << seed << ": " << explain(judged.registered.outcome);
        for (const Defect& d : judged.defects)
            ADD_FAILURE() << seed << ": " << name_of(d.kind) << " at " << d.m << ", " << d.n << ", " << d.area
                          << " lenslets, score " << d.score << ", peak " << d.peak;
    }
}

// Below the limits of gradients and transmission: a tenth less light, a spread a third wider in two lenslets, a shift
// of a tenth of a bin.
TEST(Reference, weak_defects_are_found_where_they_are_and_named) {
    struct Case {
        const char* name;
        DefectKind kind;
        std::function<void(int, int, Spot&)> change;
    };
    const auto near = [](int m, int n) { return std::abs(m - 24) <= 1 && std::abs(n - 15) <= 1; };
    const Case cases[] = {
        {"absorbing", DefectKind::absorbing,
         [&](int m, int n, Spot& s) {
             if (near(m, n)) s.light *= 0.75;
         }},
        {"surface", DefectKind::surface,
         [&](int m, int n, Spot& s) {
             if (near(m, n)) s.x += 0.2;
         }},
    };
    for (const Case& c : cases) {
        const Judged judged = judge(seen(part(wobble(7), c.change), 7));
        ASSERT_EQ(judged.verdict, Verdict::reject) << c.name;
        EXPECT_NEAR(judged.defects[0].m, 24, 0.7) << c.name;
        EXPECT_NEAR(judged.defects[0].n, 15, 0.7) << c.name;
        EXPECT_EQ(judged.defects[0].kind, c.kind) << c.name << ", got " << name_of(judged.defects[0].kind);
        EXPECT_EQ(judged.defects.size(), 1U) << c.name;
    }
}

// The mean light of several parts whose lenslets lie at different positions.
Frame mean_of(const std::vector<Frame>& frames) {
    Frame mean(frames[0].width_px(), frames[0].height_px(), frames[0].bits());
    const auto count = static_cast<std::uint32_t>(frames.size());
    for (int y = 0; y < mean.height_px(); ++y) {
        for (int x = 0; x < mean.width_px(); ++x) {
            std::uint32_t sum = count / 2;
            for (const Frame& frame : frames) sum += frame.view().sample(x, y);
            mean.set(x, y, sum / count);
        }
    }
    return mean;
}

// Both widen the spread of deflections: a dimple because it deflects the light of one lenslet to several places.
TEST(Reference, a_dimple_is_a_surface_and_haze_scatters) {
    for (const double radius : {1.5, 2.5}) {
        std::vector<Frame> dimple, haze;
        for (int k = 0; k < 9; ++k) {
            const double dx = (k % 3 - 1) / 3.0, dy = (k / 3 - 1) / 3.0;
            dimple.push_back(part(wobble(7), [&](int m, int n, Spot& s) {
                const double x = m + dx - 24.3, y = n + dy - 15.2;
                if (std::hypot(x, y) < radius) s.x += 0.33 * x, s.y += 0.33 * y;
            }));
            haze.push_back(part(wobble(7), [&](int m, int n, Spot& s) {
                if (std::hypot(m - 24, n - 15) < radius && k % 2 == 0 && k != 4)
                    s.x += 4.5 * dx, s.y += 4.5 * dy;  // four ninths of it, by 1.5 bins
            }));
        }
        for (const auto& [frames, kind] :
             {std::pair(&dimple, DefectKind::surface), std::pair(&haze, DefectKind::scattering)}) {
            for (const double light : {0.5, 1.0, 2.0}) {
                const Judged judged = judge(seen(mean_of(*frames), 7, light));
                ASSERT_EQ(judged.verdict, Verdict::reject) << radius;
                EXPECT_EQ(judged.defects[0].kind, kind)
                    << radius << " lenslets, light " << light << ", got " << name_of(judged.defects[0].kind);
            }
        }
    }
}

// One lenslet inside the rim, where the margin of the gradients hides everything.
TEST(Reference, a_defect_beside_the_rim_is_found) {
    const Pose pose{0.3, -0.2, 0.01};
    const auto at = PoseMap(pose, kField).to_part(0.5 * (kField.m - 1) + kHalfM - 1.5, 0.5 * (kField.n - 1));
    const Judged judged = judge(seen(part(pose,
                                          [&](int m, int n, Spot& s) {
                                              if (m == std::lround(at.m) && n == std::lround(at.n)) s.light *= 0.4;
                                          }),
                                     3));
    ASSERT_EQ(judged.verdict, Verdict::reject);
    EXPECT_NEAR(judged.defects[0].m, at.m, 1);
    EXPECT_NEAR(judged.defects[0].n, at.n, 1);
}

TEST(Reference, a_part_that_does_not_lie_where_it_should_is_unfit) {
    const Judged far = judge(seen(part({6, 0, 0}), 1));
    EXPECT_EQ(far.verdict, Verdict::unfit);
    EXPECT_EQ(far.reason, Reason::not_registered);
    const Judged other = judge(seen(drawn(kField, kBits, 1300, testing::lens(kField, 8, 3.5)), 1));
    EXPECT_EQ(other.verdict, Verdict::unfit);
    EXPECT_EQ(other.reason, Reason::not_registered);
    EXPECT_TRUE(other.z_score.empty());
}

TEST(Reference, small_defects_are_tolerated_as_the_recipe_says) {
    Recipe r = recipe();
    r.lenslet_mm = 0.2F;
    const auto two_specks = [](int m, int n, Spot& s) {
        if (n == 18 && (m == 12 || m == 28)) s.light *= 0.3;
    };
    const Frame frame = seen(part(wobble(9), two_specks), 9);
    ASSERT_EQ(judge(frame, r).defects.size(), 2U);
    r.tolerances = {{.kinds = 1U << static_cast<unsigned>(DefectKind::absorbing),
                     .where = std::nullopt,
                     .largest_mm = 0.7F,
                     .number = 2}};
    EXPECT_EQ(judge(frame, r).verdict, Verdict::pass);
    r.tolerances[0].number = 1;
    EXPECT_EQ(judge(frame, r).defects.size(), 1U);
    r.tolerances[0].number = 2;
    r.tolerances[0].largest_mm = 0.1F;
    EXPECT_EQ(judge(frame, r).defects.size(), 2U);
    r.tolerances[0].largest_mm = 0.7F;
    r.tolerances[0].where =
        Zone{.shape = Zone::Shape::circle, .use = {}, .centre = {12, 18}, .radius = 4, .corners = {}};
    const Judged one = judge(frame, r);
    ASSERT_EQ(one.defects.size(), 1U);
    EXPECT_NEAR(one.defects[0].m, 28, 1);
    r.lenslet_mm = 0;
    EXPECT_FALSE(Pipeline::create(kField, kBits, r));
}

// Without the EMD rows are decoded into the SoA layout; the comparison with the reference is the same.
TEST(Reference, judges_the_same_without_any_gradient) {
    const Frame bad = seen(part({0.3, -0.2, 0},
                                [](int m, int n, Spot& spot) {
                                    if (std::abs(m - 22) <= 1 && std::abs(n - 15) <= 1) spot.light *= 0.6;
                                }),
                           81);
    const Judged usual = judge(bad);
    ASSERT_EQ(usual.verdict, Verdict::reject);
    Recipe without = recipe();
    without.gradient.reset();
    without.slopes = without.light = false;
    for (const int threads : {1, 2}) {
        const Judged found = judge(bad, without, threads);
        EXPECT_EQ(found.verdict, Verdict::reject);
        EXPECT_EQ(found.reason, Reason::absorption);
        EXPECT_EQ(found.z_score, usual.z_score);
        EXPECT_EQ(found.registered.pose.x, usual.registered.pose.x);
        EXPECT_EQ(found.registered.light, usual.registered.light);
    }
    without.gradient = Feature::chi2;
    without.gradient_limit = 1;
    const auto refused = Pipeline::create(kField, kBits, without);
    ASSERT_FALSE(refused);
    EXPECT_NE(refused.error().message().find("choose emd or no gradient"), std::string::npos)
        << refused.error().message();
}

TEST(Reference, the_judgement_does_not_depend_on_the_number_of_threads) {
    const Frame frame = seen(part(wobble(11)), 11);
    const Judged alone = judge(frame);
    for (const int threads : {2, 5}) EXPECT_EQ(judge(frame, recipe(), threads).z_score, alone.z_score);
}

// Dark bins count with little noise. One that reads ten standard deviations of it looks like a shift.
TEST(Reference, one_reading_beside_a_spot_is_no_bend) {
    const Reference& r = learned().reference;
    const Pose pose{0.2, -0.1, 0};
    Frame frame = part(pose);  // without noise
    constexpr std::uint32_t kReading = 8;
    std::vector<std::uint8_t> read_there(kField.lenslets());
    for (int n = 10; n < 27; n += 2) {
        for (int m = 8; m < 33; m += 2) {
            const auto sample = [&](int i, int j) { return frame.view().sample(m * kField.i + i, n * kField.j + j); };
            int row = 0, left = 0;  // of the brightest bin; the first that is lit to its left
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
        comparer.compare_row(frame.view(), row.sums(), row.mask(), n, PoseMap(pose, kField), 1, differences);
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
TEST(Reference, golden_hords_along_a_row_are_those_of_single_places) {
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
        // All lanes but those at the edges of the reference, and a few more if the row is steep.
        EXPECT_GT(compared, with_hord * 6 / 10) << sine;
    }
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
    constexpr int kFifths = 1;  // of the light: moves by one bin
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
        comparer.compare_row(frame.view(), row.sums(), row.mask(), 4, PoseMap({}, e), 1, out);
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
                frame.view(), row.sums(), row.mask(), n, PoseMap({0.3, -0.4, 0.01}, kField), 1,
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

TEST(Learning, names_the_parts_that_differ_from_all_others) {
    const auto speck = [](int m, int n, Spot& s) {
        if (std::hypot(m - 25, n - 20) < 2.5) s.light *= 0.4;
    };
    std::vector<Frame> frames;
    for (std::uint64_t k = 0; k < 12; ++k)
        frames.push_back(seen(k == 4 ? part(wobble(k), speck) : k == 9 ? part({9, 3, 0}) : part(wobble(k)), k));
    const auto all = learn(frames.size(), [&](std::size_t k) { return frames[k]; });
    ASSERT_TRUE(all) << all.error().message();
    EXPECT_EQ(all->reference.parts, 10U);
    ASSERT_EQ(all->left_out.size(), 2U);
    EXPECT_EQ(all->left_out[0].part, 9U);  // it cannot be registered, which is checked first
    EXPECT_EQ(all->left_out[1].part, 4U);
    EXPECT_FALSE(all->poses[4]);
}

TEST(Learning, estimates_the_sensors_gain) {
    std::vector<Frame> frames;
    for (std::uint64_t k = 0; k < 12; ++k) frames.push_back(seen(part(wobble(k)), k));
    const auto all = learn(
        frames.size(), [&](std::size_t k) { return frames[k]; }, std::nullopt);
    ASSERT_TRUE(all);
    EXPECT_NEAR(all->reference.sensor.electrons_per_dn, 1, 0.3);
}

TEST(Learning, single_readings_far_from_all_light_leave_nothing_in_the_golden_hords) {
    const Reference& r = learned().reference;
    int valid = 0, far_light = 0, without_light = 0;
    for (std::size_t k = 0; k < r.mask.size(); ++k) {
        if (r.mask[k] != kValid) continue;
        ++valid;
        int lit = 0, far = 0;
        for (int j = 0; j < 9; ++j) {
            for (int i = 0; i < 9; ++i) {
                if (r.shares[k * r.stride() + r.place(i, j)] == 0) continue;
                ++lit;
                far += std::hypot(i - 4 - static_cast<double>(r.x[k]), j - 4 - static_cast<double>(r.y[k])) > 4 ? 1 : 0;
            }
        }
        far_light += far > 0 ? 1 : 0;
        without_light += lit < 2 ? 1 : 0;
    }
    EXPECT_GT(valid, 500);
    EXPECT_EQ(without_light, 0);
    EXPECT_LT(far_light, valid / 50);  // where they stay it is three tenths
}

TEST(Learning, tells_the_read_noise_from_the_bins_without_light) {
    const auto told = [](const Frame& frame, const LightLevels& levels) {
        return read_noise_of(kField, levels, 4, [&](std::size_t) -> Result<Frame> { return frame; });
    };
    const Frame clean = part({});
    for (const double electrons : {0.0, 1.0, 2.0, 4.0}) {
        const auto read = told(noisy(clean, {1, electrons, 1}, 7, kBits), kLevels);
        ASSERT_TRUE(read) << read.error().message();
        EXPECT_NEAR(*read, electrons, 0.1 * electrons) << electrons;
    }
    // 8 bits: noise is less than a DN and values below 0 are clipped.
    const Frame coarse = drawn(kField, 8, 150, [](int, int) { return Spot{0.3, -0.4, 0.9}; });
    for (const double dn : {0.4, 0.6, 1.0}) {
        const auto read = told(noisy(coarse, {10, 10 * dn, 1}, 8), {3, 20, 255});
        ASSERT_TRUE(read) << read.error().message();
        EXPECT_NEAR(*read, dn, 0.1 * dn);
    }
    // Light everywhere: there are no dark bins.
    Frame bright = clean;
    for (int y = 0; y < bright.height_px(); ++y) {
        for (int x = 0; x < bright.width_px(); ++x) bright.set(x, y, 1000);
    }
    const auto none = told(bright, kLevels);
    ASSERT_FALSE(none);
    EXPECT_NE(none.error().cure.find("--read-dn"), std::string::npos);
}

TEST(Learning, needs_eight_parts_that_lie_alike) {
    std::vector<Frame> frames;
    for (std::uint64_t k = 0; k < 9; ++k) frames.push_back(seen(k < 7 ? part(wobble(k)) : part({8, 8, 0}), k));
    const auto few = learn(7, [&](std::size_t k) { return frames[k]; });
    ASSERT_FALSE(few);
    const auto strangers = learn(9, [&](std::size_t k) { return frames[k]; });
    ASSERT_FALSE(strangers);
    EXPECT_NE(strangers.error().what.find("part 8"), std::string::npos) << strangers.error().what;
}

TEST(Learning, the_same_frames_give_the_same_reference) {
    std::vector<Frame> frames;
    for (std::uint64_t k = 0; k < 8; ++k) frames.push_back(seen(part(wobble(k)), k));
    const auto a = learn(8, [&](std::size_t k) { return frames[k]; }),
               b = learn(8, [&](std::size_t k) { return frames[k]; });
    ASSERT_TRUE(a && b);
    EXPECT_EQ(a->reference.shares, b->reference.shares);
    EXPECT_EQ(a->reference.spread, b->reference.spread);
    EXPECT_TRUE(check(a->reference));
}

// Parts of changing poses, some with a flaw, judged against the reference: no false dust; fading light and a speck are
// found.
TEST(Reference, ageing_optics_are_told_from_parts_that_wobble) {
    constexpr int kWindow = 50;
    const char* more = std::getenv("HORD_AGEING_PARTS");                // by hand
    const int clean = more != nullptr ? std::atoi(more) / kWindow : 3;  // windows
    auto pipeline = Pipeline::create(kField, kBits, recipe());
    ASSERT_TRUE(pipeline);
    auto dust = DustEstimator::create(kField, kWindow);
    auto light = LightTrend::create(kField, kWindow);
    ASSERT_TRUE(dust && light);
    std::vector<Frame> pool;
    for (std::uint64_t k = 0; k < 24; ++k) {
        pool.push_back(part(wobble(300 + k), [&](int m, int n, Spot& spot) {
            if (k < 4 && std::hypot(m - 10.0 - 6.0 * static_cast<double>(k), n - 18.0) < 2) spot.light *= 0.6;
        }));
    }
    int windows = 0, alarms = 0;
    const auto next = [&](int k, double led, bool speck) {
        Frame frame = pool[static_cast<std::size_t>(k) % pool.size()];
        if (speck) frame = testing::specked(frame, kField, 24, 15, 0.7, 0.5);
        frame = seen(frame, 5000 + static_cast<std::uint64_t>(k), led);
        const auto found = pipeline->inspect(frame.view());
        ASSERT_TRUE(found);
        light->add(frame.view(), *found);
        if (!dust->add(*found)) return;
        ++windows;
        alarms += dust->latest()->specks > 0 ? 1 : 0;
    };
    int k = 0;
    for (; windows < clean && k < 2 * clean * kWindow; ++k) next(k, 1, false);
    ASSERT_EQ(windows, clean);
    EXPECT_EQ(alarms, 0);
    EXPECT_NEAR(light->latest()->light, 1, 0.02);
    EXPECT_NEAR(light->latest()->uneven, 0, 0.05);
    for (const int end = k + 2 * kWindow; windows == clean && k < end; ++k) next(k, 0.7, true);
    EXPECT_NEAR(light->latest()->light, 1 - 0.3 * 0.25, 0.03);
    ASSERT_EQ(dust->latest()->specks, 1U);
    EXPECT_NEAR(dust->latest()->largest[0].m, 24, 0.5);
    EXPECT_NEAR(dust->latest()->largest[0].n, 15, 0.5);
    ASSERT_TRUE(dust->latest()->pose_spread);
    EXPECT_NEAR(*dust->latest()->pose_spread, 0.29, 0.1);  // of +-0.5 lenslet
}

}  // namespace
}  // namespace hord::algo
