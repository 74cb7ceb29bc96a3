// The quick form of `hord-lab experiment paper`: its claims come out as docs/results/paper.md has them, and an
// interrupted run continues.
#include "lab/paper/paper.h"

#include <fstream>
#include <iterator>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "tests/lab/support/folder.h"

namespace hord::lab {
namespace {

TEST(PaperExperiment, claims_come_out_as_written_down_and_an_interrupted_run_gives_the_same_bits) {
    const test::Folder folder;
    ExperimentOptions options;
    options.out = folder.path();
    options.quick = true;
    options.threads = 2;
    double last = 0;
    options.progress = [&](double done, const std::string&) {
        EXPECT_GE(done, last);
        EXPECT_LE(done, 1.0);
        last = done;
    };
    const auto report = run_paper(options);
    ASSERT_TRUE(report) << report.error().message();
    EXPECT_EQ(last, 1.0);
    EXPECT_GE(report->claims.size(), 14U);
    for (const Claim& claim : report->claims) EXPECT_TRUE(claim.as_expected()) << claim.text << ": " << claim.evidence;
    for (const auto& file : report->files) EXPECT_TRUE(std::filesystem::exists(file)) << file;

    // As after an interruption while the bubble was being written: two scenes are done; one thread computes the rest
    // again.
    const auto cells = folder.path() / "cells.jsonl";
    std::string text;
    {
        std::ifstream stream(cells);
        text.assign(std::istreambuf_iterator<char>(stream), {});
    }
    const auto bubble = text.find("frame bubble");
    ASSERT_NE(bubble, std::string::npos);
    std::ofstream(cells, std::ios::trunc) << text.substr(0, bubble + 5);
    options.threads = 1;
    last = 0;
    const auto again = run_paper(options);
    ASSERT_TRUE(again) << again.error().message();
    EXPECT_EQ(again->text, report->text);

    options.seed = 2;
    const auto other = run_paper(options);
    ASSERT_FALSE(other);
    EXPECT_THAT(other.error().message(), ::testing::HasSubstr("other parameters"));
}

}  // namespace
}  // namespace hord::lab
