// Verdicts on light fields that an independent program traced: good parts pass, defects are found at their true
// positions; also with noise, at other exposures and bit depths, and for other positions of the part in the field.
#include <cmath>
#include <string>
#include <vector>

#include <gtest/gtest.h>

#include "algo/inspection/pipeline.h"
#include "tests/support/frames.h"

namespace hord::algo {
namespace {

using namespace hord;
using namespace hord::algo::testing;

constexpr float kNear = 2;  // lenslets, from the found centre to the true one

struct Scene {
    const char* name;
    bool good;
    Point defect;  // true centre, lenslets
    friend std::ostream& operator<<(std::ostream& out, const Scene& s) { return out << s.name; }
};

// The truth is in the frames' own JSON files.
const Scene kGood[] = {{"lens_111", true, {}}, {"wedge_111", true, {}}};
const Scene kBad[] = {{"bubble_r500_111", false, {55.0F, 55.0F}}, {"cutout_111", false, {34.1875F, 34.1875F}}};

void expect_true_verdict(const Scene& scene, const Frame& frame, Point moved = {}, const Recipe& recipe = {}) {
    auto pipeline = Pipeline::create(kPovray, frame.bits(), recipe);
    ASSERT_TRUE(pipeline) << pipeline.error().message();
    const auto seen = pipeline->inspect(frame.view());
    ASSERT_TRUE(seen) << seen.error().message();
    if (scene.good) {
        EXPECT_EQ(seen->verdict, Verdict::pass) << name_of(seen->reason);
        EXPECT_TRUE(seen->defects.empty());
        EXPECT_LT(seen->score, 1);
        return;
    }
    EXPECT_EQ(seen->verdict, Verdict::reject);
    EXPECT_GE(seen->score, 1);
    ASSERT_EQ(seen->defects.size(), 1U);
    EXPECT_NEAR(seen->defects[0].m, scene.defect.m + moved.m, kNear);
    EXPECT_NEAR(seen->defects[0].n, scene.defect.n + moved.n, kNear);
}

class RealFrame : public ::testing::TestWithParam<Scene> {
  protected:
    void SetUp() override {
        auto frame = povray(GetParam().name);
        if (!frame) GTEST_SKIP() << GetParam().name << "_raw.png is neither below $HORD_DATA nor in ../shared/data";
        frame_ = std::move(*frame);
    }
    Frame frame_;
};

TEST_P(RealFrame, is_judged_truly) { expect_true_verdict(GetParam(), frame_); }

TEST_P(RealFrame, is_judged_truly_in_photon_and_read_noise) {
    for (std::uint64_t seed = 1; seed <= 5; ++seed) {
        SCOPED_TRACE(seed);
        expect_true_verdict(GetParam(), noisy(frame_, {10, 2, 1.0}, seed));  // 2800 electrons a lenslet
    }
}

TEST_P(RealFrame, is_judged_truly_at_a_quarter_of_the_light) {
    for (std::uint64_t seed = 1; seed <= 5; ++seed) {
        SCOPED_TRACE(seed);
        expect_true_verdict(GetParam(), noisy(frame_, {10, 2, 0.25}, seed));  // 700 electrons
    }
}

TEST_P(RealFrame, is_judged_truly_at_12_and_16_bits) {
    expect_true_verdict(GetParam(), at_bits(frame_, 12));
    expect_true_verdict(GetParam(), noisy(frame_, {10, 2, 1.0}, 6, 12));
    expect_true_verdict(GetParam(), at_bits(frame_, 16));
    expect_true_verdict(GetParam(), noisy(frame_, {10, 2, 1.0}, 7, 16));
}

TEST_P(RealFrame, is_judged_truly_wherever_the_part_lies) {
    for (const auto& [dm, dn] : {std::pair(5, -3), std::pair(-8, 8), std::pair(-9, 0), std::pair(0, 10)}) {
        SCOPED_TRACE(std::to_string(dm) + ", " + std::to_string(dn));
        expect_true_verdict(GetParam(), shifted(frame_, kPovray, dm, dn),
                            {static_cast<float>(dm), static_cast<float>(dn)});
    }
}

// A third of the part lies outside the field.
TEST_P(RealFrame, is_no_part_where_the_field_cuts_it_and_judged_truly_where_that_is_allowed) {
    const Frame cut = shifted(frame_, kPovray, -30, 12);
    auto pipeline = Pipeline::create(kPovray, 8, {});
    ASSERT_TRUE(pipeline);
    const auto seen = pipeline->inspect(cut.view());
    ASSERT_TRUE(seen);
    EXPECT_EQ(seen->verdict, Verdict::unfit);
    EXPECT_EQ(seen->reason, Reason::no_part);
    EXPECT_EQ(seen->frame.fault, FrameFault::cut_by_field);
    Recipe unchecked;
    unchecked.part_required = false;
    expect_true_verdict(GetParam(), cut, {-30, 12}, unchecked);
}

TEST(EmptyField, is_no_part_in_any_light) {
    const auto empty = povray("empty_111");
    if (!empty) GTEST_SKIP() << "empty_111_raw.png is neither below $HORD_DATA nor in ../shared/data";
    for (const double light : {0.25, 1.0}) {
        for (const int bits : {8, 12, 16}) {
            auto pipeline = Pipeline::create(kPovray, bits, {});
            ASSERT_TRUE(pipeline);
            const Frame frame = noisy(*empty, {10, 2, light}, 1, bits);
            const auto seen = pipeline->inspect(frame.view());
            ASSERT_TRUE(seen);
            EXPECT_EQ(seen->verdict, Verdict::unfit);
            EXPECT_EQ(seen->reason, Reason::no_part);
            EXPECT_EQ(seen->frame.fault, FrameFault::nothing);
        }
    }
}

TEST_P(RealFrame, is_judged_truly_when_transposed_or_mirrored) {
    Scene scene = GetParam();  // the true centres lie on the diagonal
    expect_true_verdict(scene, transposed(frame_));
    scene.defect.m = static_cast<float>(kPovray.m - 1) - scene.defect.m;
    expect_true_verdict(scene, mirrored(frame_));
}

class GoodPart : public RealFrame {};
class BadPart : public RealFrame {};

TEST_P(GoodPart, with_an_absorbing_speck_is_rejected_at_the_speck) {
    for (const auto& [m, n, radius, transmission] :
         {std::tuple(70.0, 40.0, 2.0, 0.0), std::tuple(48.3, 61.7, 1.0, 0.0), std::tuple(60.0, 75.0, 3.0, 0.5)}) {
        SCOPED_TRACE(m);
        const Frame speck = specked(frame_, kPovray, m, n, radius, transmission);
        const Scene truth{GetParam().name, false, {static_cast<float>(m), static_cast<float>(n)}};
        expect_true_verdict(truth, speck);
        expect_true_verdict(truth, noisy(speck, {10, 2, 1.0}, 9));
    }
}

TEST_P(BadPart, is_judged_only_inside_its_zones) {
    Zone around;
    around.centre = GetParam().defect;
    around.radius = 9;
    Recipe recipe;
    recipe.zones = {around};
    expect_true_verdict(GetParam(), frame_, {}, recipe);
    recipe.zones[0].use = Zone::Use::ignore;
    expect_true_verdict({GetParam().name, true, {}}, frame_, {}, recipe);
}

// povray/poses: 61 x 61 lenslets, 16 bits, without noise. docs/results/inspection.md has the table.
class PosedPart : public ::testing::Test {
  protected:
    void SetUp() override {
        if (!povray("poses/lens_pose00"))
            GTEST_SKIP() << "poses/lens_pose00_raw.png is neither below $HORD_DATA nor in ../shared/data";
    }
    struct Result {
        Verdict verdict = Verdict::unfit;
        Reason reason = Reason::none;
        std::vector<Defect> defects;
    };
    static Result judged(const std::string& name, const Recipe& recipe = {}) {
        const auto frame = povray("poses/" + name);
        EXPECT_TRUE(frame) << name;
        if (!frame) return {};
        auto pipeline = Pipeline::create({61, 61, 9, 9}, frame->bits(), recipe);
        EXPECT_TRUE(pipeline);
        const auto seen = pipeline->inspect(frame->view());
        EXPECT_FALSE(seen->bounded) << name;
        return {seen->verdict, seen->reason, {seen->defects.begin(), seen->defects.end()}};
    }
    static void expect_rejected_at(Point defect, const std::string& name, const Recipe& recipe = {}) {
        const Result seen = judged(name, recipe);
        EXPECT_EQ(seen.verdict, Verdict::reject) << name;
        ASSERT_EQ(seen.defects.size(), 1U) << name;
        EXPECT_NEAR(seen.defects[0].m, defect.m, kNear) << name;
        EXPECT_NEAR(seen.defects[0].n, defect.n, kNear) << name;
    }
    static std::string pose(const std::string& part, int k) {
        return part + "_pose" + (k < 10 ? "0" : "") + std::to_string(k);
    }
};

TEST_F(PosedPart, lenses_pass_in_every_pose_and_flaws_of_half_a_lenslet_are_found) {
    for (int k = 0; k < 22; ++k) EXPECT_EQ(judged(pose("lens", k)).verdict, Verdict::pass) << k;
    expect_rejected_at({26.7F, 45.9F}, "lens_bubble070");
    expect_rejected_at({20.7F, 38.5F}, "lens_cut0");
    expect_rejected_at({22.9F, 49.3F}, "lens_speck050");
}

// The plate's polished walls show no edge. The default recipe judges none; one that looks for no part does.
TEST_F(PosedPart, plates_without_visible_edges_are_no_part_or_judged_as_webs) {
    Recipe web;
    web.form = PartForm::web;
    web.part_required = false;
    for (int k = 0; k < 22; ++k) {
        EXPECT_EQ(judged(pose("plate", k)).reason, Reason::no_part) << k;
        EXPECT_EQ(judged(pose("plate", k), web).verdict, Verdict::pass) << k;
    }
    for (const auto& [name, place] :
         {std::pair("plate_bubble035", Point{14.9F, 42.0F}), std::pair("plate_bubble070", Point{42.6F, 45.3F}),
          std::pair("plate_cut0", Point{15.4F, 20.6F}), std::pair("plate_speck050", Point{23.9F, 33.8F})}) {
        EXPECT_EQ(judged(name).reason, Reason::no_part) << name;
        expect_rejected_at(place, name, web);
    }
}

std::string name_of_scene(const ::testing::TestParamInfo<Scene>& scene) { return scene.param.name; }

INSTANTIATE_TEST_SUITE_P(Good, RealFrame, ::testing::ValuesIn(kGood), name_of_scene);
INSTANTIATE_TEST_SUITE_P(Bad, RealFrame, ::testing::ValuesIn(kBad), name_of_scene);
INSTANTIATE_TEST_SUITE_P(Good, GoodPart, ::testing::ValuesIn(kGood), name_of_scene);
INSTANTIATE_TEST_SUITE_P(Bad, BadPart, ::testing::ValuesIn(kBad), name_of_scene);

}  // namespace
}  // namespace hord::algo
