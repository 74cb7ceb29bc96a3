// The pipeline's contract: refusals, extreme frames, symmetries, memory.
#include "algo/inspection/pipeline.h"

#include <cmath>
#include <vector>

#include <gtest/gtest.h>

#include "tests/support/counted_heap.h"
#include "tests/support/frames.h"

namespace hord::algo {
namespace {

using namespace hord;
using namespace hord::algo::testing;

constexpr Extents kField{40, 36, 9, 9};

Pipeline pipeline_for(const Extents& extents, int bits = 8, const Recipe& recipe = {}) {
    auto pipeline = Pipeline::create(extents, bits, recipe);
    EXPECT_TRUE(pipeline) << pipeline.error().message();
    return std::move(*pipeline);
}

void expect_finite(const Inspection& seen) {
    EXPECT_TRUE(std::isfinite(seen.score));
    EXPECT_GE(seen.score, 0);
    for (std::size_t k = 0; k < seen.mask.size(); ++k) {
        for (const float value : {seen.emd[k], seen.frobenius[k], seen.transmission[k]}) {
            ASSERT_TRUE(std::isfinite(value)) << "lenslet " << k;
            ASSERT_GE(value, 0);
        }
        if ((seen.mask[k] & kNoGradient) != 0) {
            ASSERT_EQ(seen.emd[k], 0);
            ASSERT_EQ(seen.frobenius[k], 0);
        }
        if ((seen.mask[k] & kSaturated) != 0) {
            ASSERT_EQ(seen.transmission[k], 0);
        }
    }
    for (const Defect& d : seen.defects) {
        EXPECT_TRUE(std::isfinite(d.m) && std::isfinite(d.n) && std::isfinite(d.peak));
        EXPECT_GT(d.area, 0U);
    }
}

Frame filled(const Extents& e, int bits, std::uint32_t value) {
    Frame frame(e.width_px(), e.height_px(), bits);
    for (int y = 0; y < e.height_px(); ++y) {
        for (int x = 0; x < e.width_px(); ++x) frame.set(x, y, value);
    }
    return frame;
}

// By hand: 3x3 lenslets of 3x3 bins. The middle's left neighbour has its light one bin to the left, the right one one
// bin to the right; the upper and lower ones have theirs in the centre and half in the centre, half one bin down.
TEST(Pipeline, computes_a_light_field_by_hand) {
    const Extents e{3, 3, 3, 3};
    Frame frame(9, 9, 8);
    const auto light = [&](int m, int n, int i, int j, std::uint32_t dn) { frame.set(m * 3 + i, n * 3 + j, dn + 1); };
    for (const auto& [m, n] :
         {std::pair(0, 0), std::pair(2, 0), std::pair(0, 2), std::pair(2, 2), std::pair(1, 1), std::pair(1, 0)})
        light(m, n, 1, 1, 100);
    light(0, 1, 0, 1, 100);
    light(2, 1, 2, 1, 100);
    light(1, 2, 1, 1, 50);
    light(1, 2, 1, 2, 50);
    Recipe recipe;
    recipe.dark_dn = 1;
    recipe.form = PartForm::web;  // nine lenslets show no outline
    recipe.part_required = false;
    recipe.rim_margin = 0;
    recipe.emd_limit_bins = 2;
    recipe.frobenius_limit_bins = 2;
    Pipeline pipeline = pipeline_for(e, 8, recipe);
    const auto seen = pipeline.inspect(frame.view());
    ASSERT_TRUE(seen);
    expect_finite(*seen);
    EXPECT_FLOAT_EQ(seen->emd[4], std::sqrt(2.0F * 2.0F + 0.5F * 0.5F));          // 2 bins across, half a bin down
    EXPECT_FLOAT_EQ(seen->frobenius[4], std::sqrt(1.0F * 1.0F + 0.25F * 0.25F));  // half of each, per lenslet
    for (std::size_t k = 0; k < 9; ++k) {
        EXPECT_EQ(seen->transmission[k], 1.0F);
        EXPECT_EQ(seen->mask[k] & kNoGradient, k == 4 ? kValid : kBorder);
    }
    EXPECT_EQ(seen->verdict, Verdict::reject);
    EXPECT_EQ(seen->reason, Reason::neighbours_disagree);
    ASSERT_EQ(seen->defects.size(), 1U);
    EXPECT_EQ(seen->defects[0].m, 1);
    EXPECT_EQ(seen->defects[0].n, 1);
    EXPECT_EQ(seen->defects[0].area, 1U);
    EXPECT_FLOAT_EQ(seen->defects[0].peak, seen->emd[4]);
    EXPECT_FLOAT_EQ(seen->score, seen->emd[4] / 2);
}

TEST(Pipeline, refuses_what_it_cannot_do_and_names_it) {
    EXPECT_FALSE(Pipeline::create({2, 36, 9, 9}, 8, {}));
    EXPECT_FALSE(Pipeline::create(kField, 7, {}));
    EXPECT_FALSE(Pipeline::create(kField, 17, {}));
    Recipe recipe;
    recipe.name = "lid";
    recipe.emd_limit_bins = 0;
    recipe.transmission_limit = 1.5F;
    recipe.rim_margin = 18;
    recipe.saturated_dn = 256;
    recipe.zones.resize(2);
    recipe.zones[1].shape = Zone::Shape::polygon;
    const auto refused = Pipeline::create(kField, 8, recipe);
    ASSERT_FALSE(refused);
    EXPECT_EQ(refused.error().code, ErrorCode::invalid_argument);
    for (const char* part :
         {"lid", "emd_limit_bins", "transmission_limit", "rim_margin 18", "saturated_dn", "zone[0]", "zone[1]"}) {
        EXPECT_NE(refused.error().message().find(part), std::string::npos)
            << part << " is not in: " << refused.error().message();
    }
}

TEST(Pipeline, refuses_a_frame_it_was_not_set_up_for) {
    Pipeline pipeline = pipeline_for(kField);
    const Frame wrong_size(kField.width_px() + 9, kField.height_px(), 8),
        wrong_bits(kField.width_px(), kField.height_px(), 12);
    EXPECT_EQ(pipeline.inspect(wrong_size.view()).error().code, ErrorCode::invalid_argument);
    EXPECT_EQ(pipeline.inspect(wrong_bits.view()).error().code, ErrorCode::invalid_argument);
    FrameView none = Frame(kField.width_px(), kField.height_px(), 8).view();
    none.data = nullptr;
    EXPECT_EQ(pipeline.inspect(none).error().code, ErrorCode::invalid_argument);
    const Frame good(kField.width_px(), kField.height_px(), 8);
    FrameView overlapping = good.view();
    overlapping.stride_bytes -= 1;
    EXPECT_EQ(pipeline.inspect(overlapping).error().code, ErrorCode::invalid_argument);
    EXPECT_TRUE(pipeline.inspect(good.view()));
}

TEST(Pipeline, says_unfit_and_why) {
    Pipeline pipeline = pipeline_for(kField);
    const auto reason_for = [&](const Frame& frame) {
        const auto seen = pipeline.inspect(frame.view());
        EXPECT_TRUE(seen);
        expect_finite(*seen);
        EXPECT_EQ(seen->verdict, Verdict::unfit);
        EXPECT_TRUE(seen->defects.empty());
        return seen->reason;
    };
    EXPECT_EQ(reason_for(filled(kField, 8, 0)), Reason::too_dark);
    EXPECT_EQ(reason_for(filled(kField, 8, 3)), Reason::too_dark);  // the default dark level
    EXPECT_EQ(reason_for(filled(kField, 8, 255)), Reason::saturated);
    for (const PartForm form : {PartForm::tube, PartForm::plate}) {
        Recipe recipe;
        recipe.form = form;
        pipeline = *Pipeline::create(kField, 8, recipe);
        EXPECT_EQ(reason_for(filled(kField, 8, 0)), Reason::too_dark) << "of a form of which nothing is left to judge";
    }
    Recipe nowhere;
    nowhere.zones.resize(1);
    nowhere.zones[0].centre = {10.5F, 10.5F};  // between lenslets
    nowhere.zones[0].radius = 0.1F;
    pipeline = pipeline_for(kField, 8, nowhere);
    EXPECT_EQ(reason_for(drawn(kField, 8, 240, lens(kField, 14, 2))), Reason::nothing_to_see);
}

TEST(Pipeline, keeps_its_head_at_the_extremes) {
    for (const int bits : {8, 10, 12, 16}) {
        for (const Extents& e :
             {Extents{3, 3, 3, 3}, Extents{3, 40, 15, 15}, Extents{40, 3, 4, 7}, Extents{17, 19, 9, 9}}) {
            SCOPED_TRACE(std::to_string(bits) + " bits, " + std::to_string(e.m) + "x" + std::to_string(e.n));
            Pipeline pipeline = pipeline_for(e, bits);
            const std::uint32_t full = (1U << bits) - 1;
            std::vector<Frame> frames;
            for (const std::uint32_t value : {0U, 1U, full / 2, full - 1, full})
                frames.push_back(filled(e, bits, value));
            Frame one_bin(e.width_px(), e.height_px(), bits);
            one_bin.set(e.width_px() / 2, e.height_px() / 2, full - 1);
            frames.push_back(one_bin);
            one_bin.set(0, 0, 1);
            frames.push_back(one_bin);
            Frame checkered(e.width_px(), e.height_px(), bits);  // neighbours at opposite ends of the range
            for (int n = 0; n < e.n; ++n) {
                for (int m = 0; m < e.m; ++m)
                    checkered.set(m * e.i + ((m / 2 + n / 2) % 2) * (e.i - 1), n * e.j + ((m / 2) % 2) * (e.j - 1),
                                  full - 1);
            }
            frames.push_back(checkered);
            for (const Frame& frame : frames) {
                const auto seen = pipeline.inspect(frame.view());
                ASSERT_TRUE(seen);
                expect_finite(*seen);
            }
        }
    }
}

TEST(Pipeline, allocates_nothing_for_a_good_part) {
    for (const auto& [bits, threads] : {std::pair(8, 1), std::pair(16, 1), std::pair(8, 2), std::pair(12, 3)}) {
        const Frame frame = drawn(kField, bits, 0.9 * ((1 << bits) - 1), lens(kField, 14, 2));
        auto created = Pipeline::create(kField, bits, {}, threads, MapSet::all);
        ASSERT_TRUE(created);
        Pipeline pipeline = std::move(*created);
        const std::uint64_t before = hord::test::allocations;
        const auto seen = pipeline.inspect(frame.view());
        const std::uint64_t after = hord::test::allocations;
        ASSERT_TRUE(seen);
        EXPECT_EQ(seen->verdict, Verdict::pass);
        EXPECT_EQ(after - before, 0U);
    }
    EXPECT_EQ(hord::test::allocated_by([] { ::operator delete(::operator new(8)); }), 1U) << "the guard does not count";
}

TEST(Pipeline, computes_the_other_norms_only_when_asked) {
    const Frame frame = drawn(kField, 8, 240, lens(kField, 14, 2));
    Pipeline pipeline = pipeline_for(kField);
    EXPECT_TRUE(pipeline.inspect(frame.view())->spectral.empty());
    auto all = Pipeline::create(kField, 8, {}, 1, MapSet::all);
    ASSERT_TRUE(all);
    const auto seen = all->inspect(frame.view());
    ASSERT_TRUE(seen);
    for (std::size_t k = 0; k < seen->mask.size();
         ++k) {  // for two singular values: nuclear^2 + (nuclear * anisotropy)^2 = 2 frobenius^2
        const double nuclear = seen->nuclear[k], difference = nuclear * seen->anisotropy[k];
        EXPECT_NEAR(nuclear * nuclear + difference * difference, 2.0 * seen->frobenius[k] * seen->frobenius[k], 1e-5);
        EXPECT_NEAR(seen->spectral[k], (nuclear + difference) / 2, 1e-5);
        if ((seen->mask[k] & kNoGradient) != 0) {
            EXPECT_EQ(seen->nuclear[k], 0);
        }
    }
}

TEST(Pipeline, gives_the_same_answer_twice_and_after_other_frames) {
    const Frame good = drawn(kField, 8, 240, lens(kField, 14, 2));
    const Frame bad = noisy(specked(good, kField, 20, 18, 2, 0), {}, 3);
    Pipeline pipeline = pipeline_for(kField);
    const auto remember = [&](const Frame& frame) {
        const auto seen = pipeline.inspect(frame.view());
        EXPECT_TRUE(seen);
        return std::tuple(seen->verdict, seen->score, std::vector(seen->emd.begin(), seen->emd.end()),
                          std::vector(seen->mask.begin(), seen->mask.end()), seen->defects.size());
    };
    const auto first_good = remember(good), first_bad = remember(bad);
    EXPECT_EQ(std::get<0>(first_good), Verdict::pass);
    EXPECT_EQ(std::get<0>(first_bad), Verdict::reject);
    EXPECT_EQ(remember(filled(kField, 8, 255)), remember(filled(kField, 8, 255)));
    EXPECT_EQ(remember(good), first_good);
    EXPECT_EQ(remember(bad), first_bad);
}

TEST(Pipeline, reports_the_time_of_every_stage_of_the_callers_clock) {
    const Frame frame = drawn(kField, 8, 240, lens(kField, 14, 2));
    static std::int64_t ticks;
    ticks = 0;
    Pipeline pipeline = pipeline_for(kField);
    const auto seen = pipeline.inspect(frame.view(), [] { return ++ticks; });
    ASSERT_TRUE(seen);
    const StageTimes& t = seen->times;
    for (const std::int64_t stage : {t.decode_ns, t.hord_ns, t.feature_ns, t.decide_ns}) EXPECT_GT(stage, 0);
    EXPECT_GE(t.total_ns, t.decode_ns + t.hord_ns + t.feature_ns + t.decide_ns);
    const auto untimed = pipeline.inspect(frame.view());
    EXPECT_EQ(untimed->times.total_ns, 0);
}

// A dim frame is looked at for fewer bits than were said; a bright one of the same samples at their own depth is not.
TEST(Pipeline, tells_of_a_dim_frame_that_its_samples_look_like_fewer_bits) {
    const Frame ten = drawn(kField, 10, 600, lens(kField, 12, 1.5));
    Frame twelve(kField.width_px(), kField.height_px(), 12);
    for (int y = 0; y < kField.height_px(); ++y) {
        for (int x = 0; x < kField.width_px(); ++x) twelve.set(x, y, ten.view().sample(x, y));
    }
    EXPECT_EQ(pipeline_for(kField, 10).inspect(ten.view())->frame.fewer_bits, 0);
    EXPECT_EQ(pipeline_for(kField, 12).inspect(twelve.view())->frame.fewer_bits, 10);
}

}  // namespace
}  // namespace hord::algo
