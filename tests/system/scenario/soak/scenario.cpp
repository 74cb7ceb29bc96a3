#include <gtest/gtest.h>

#include "lab/soak/soak.h"

namespace hord::lab {
namespace {

TEST(Soak, no_promise_is_broken_and_every_planned_fault_fired) {
    SoakOptions options;
    options.parts = 60'000;
    options.parts_an_episode = 1'000;
    options.real_parts = false;  // tested by real-parts/
    const auto report = soak(options);
    ASSERT_TRUE(report) << report.error().message();
    EXPECT_TRUE(report->good()) << describe(*report);
    EXPECT_GE(report->results, report->parts / 2);
}

TEST(Soak, the_same_seed_gives_the_same_bits) {
    SoakOptions options;
    options.parts = 3'000;
    options.parts_an_episode = 1'000;
    options.seed = 7;
    options.real_parts = false;
    const auto first = soak(options), second = soak(options);
    options.threads = 3;
    const auto third = soak(options);
    ASSERT_TRUE(first && second && third);
    EXPECT_EQ(first->fingerprint, second->fingerprint);
    EXPECT_EQ(first->fingerprint, third->fingerprint) << "the number of threads shows";
    EXPECT_EQ(describe(*first), describe(*third));
    options.seed = 8;
    EXPECT_NE(first->fingerprint, soak(options)->fingerprint);
}

TEST(Soak, impossible_options_are_refused) {
    SoakOptions options;
    options.parts = 0;
    EXPECT_FALSE(soak(options));
}

}  // namespace
}  // namespace hord::lab
