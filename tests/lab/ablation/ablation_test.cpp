// The quick form of `hord-lab experiment ablation`: its claims come out as docs/results/ablation.md has them.
#include "lab/ablation/ablation.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "tests/lab/support/folder.h"

namespace hord::lab {
namespace {

TEST(AblationExperiment, claims_come_out_as_written_down_and_every_effect_is_looked_at) {
    const test::Folder folder;
    ExperimentOptions options;
    options.out = folder.path();
    options.quick = true;
    const auto report = run_ablation(options);
    ASSERT_TRUE(report) << report.error().message();
    EXPECT_GE(report->claims.size(), 4U);
    for (const Claim& claim : report->claims) EXPECT_TRUE(claim.as_expected()) << claim.text << ": " << claim.evidence;
    for (const char* effect :
         {"fresnel", "ghosts", "absorption", "dispersion", "diffraction", "stop", "vignetting", "dust", "motion",
          "photon-noise", "read-noise", "dark-current", "pedestal", "prnu", "full-well"}) {
        EXPECT_THAT(report->text, ::testing::HasSubstr(std::string("| ") + effect + " |")) << effect;
    }
    // A second run reuses all cached results: the same text, processor times included.
    const auto again = run_ablation(options);
    ASSERT_TRUE(again);
    EXPECT_EQ(again->text, report->text);
}

}  // namespace
}  // namespace hord::lab
