// The simulated line's kinds of defect: what ordinary cameras do not see, HORDs do.
#include "lab/kinds/kinds.h"

#include <set>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "lab/experiment/inspected_maps.h"
#include "lab/kinds/kind_contrast.h"
#include "tests/lab/support/folder.h"

namespace hord::lab {
namespace {

using algo::Reason;
using algo::Verdict;

constexpr int kThreads = 0;
constexpr double kRejected = 1 - 0.7;  // missing light that the default transmission_limit rejects

double contrast(const SeenPart& part, LineView view) { return part.contrast[static_cast<std::size_t>(view)]; }

class KindOfDefect : public ::testing::TestWithParam<sim::PartClass> {};

TEST_P(KindOfDefect, that_takes_no_light_is_rejected_for_a_reason_of_hords_and_not_seen_by_an_ordinary_camera) {
    for (const std::uint64_t seed : {101, 102, 103}) {
        const auto parts = see_parts({GetParam()}, seed, kThreads);
        ASSERT_TRUE(parts) << parts.error().message();
        EXPECT_EQ(parts->at(0).verdict, Verdict::pass) << seed;
        const SeenPart& part = parts->at(1);
        EXPECT_EQ(part.verdict, Verdict::reject) << seed;
        EXPECT_THAT(part.reason, ::testing::AnyOf(Reason::neighbours_disagree, Reason::deflection_gradient)) << seed;
        EXPECT_LT(contrast(part, LineView::telecentric), kVisible) << seed;
        // Haze spreads light over bins that are darker than the dark level.
        const bool spreads = GetParam() == sim::PartClass::haze;
        EXPECT_LT(part.missing_light, spreads ? kRejected : kRejected / 2) << seed;
        if (!spreads) {
            EXPECT_LT(contrast(part, LineView::transmission), kVisible) << seed;
        }
        EXPECT_GE(contrast(part, LineView::emd), kVisible) << seed;
    }
}

INSTANTIATE_TEST_SUITE_P(All, KindOfDefect,
                         ::testing::Values(sim::PartClass::dimple, sim::PartClass::stria, sim::PartClass::inclusion,
                                           sim::PartClass::haze),
                         [](const auto& of) { return std::string(name_of(of.param)); });

// The views can see: else their blindness above would mean nothing.
TEST(KindsOfDefect, a_speck_is_seen_by_the_telecentric_camera_and_in_the_transmission) {
    const auto parts = see_parts({sim::PartClass::speck}, 101, kThreads);
    ASSERT_TRUE(parts) << parts.error().message();
    const SeenPart& speck = parts->at(1);
    EXPECT_EQ(speck.reason, Reason::absorption);
    EXPECT_GE(contrast(speck, LineView::telecentric), kVisible);
    EXPECT_GE(contrast(speck, LineView::transmission), kVisible);
}

TEST(KindsExperiment, claims_come_out_as_written_down) {
    const test::Folder folder;
    ExperimentOptions options;
    options.out = folder.path();
    options.quick = true;
    const auto report = run_kinds(options);
    ASSERT_TRUE(report) << report.error().message();
    EXPECT_GE(report->claims.size(), 6U);
    for (const Claim& claim : report->claims) EXPECT_TRUE(claim.as_expected()) << claim.text << ": " << claim.evidence;
    for (const std::string_view kind : sim::kPartClassNames)
        EXPECT_THAT(report->text, ::testing::HasSubstr("\n| " + std::string(kind) + " |"));
    EXPECT_THAT(report->text, ::testing::Not(::testing::HasSubstr("{{")));
    const auto again = run_kinds(options);
    ASSERT_TRUE(again);
    EXPECT_EQ(again->text, report->text);
}

}  // namespace
}  // namespace hord::lab
