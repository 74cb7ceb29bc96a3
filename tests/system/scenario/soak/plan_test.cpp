// Plans as text, and the shrinking of a failing plan.
#include <gtest/gtest.h>

#include "lab/soak/shrink.h"

namespace hord::lab {
namespace {

using sim::InjectedFault;
using sim::InjectionRule;

TEST(Plan, survives_as_text) {
    for (std::uint64_t seed = 1; seed <= 300; ++seed) {
        const EpisodePlan plan = draw_plan(seed, 1'000);
        const auto again = faults_of(text_of(plan.faults));
        ASSERT_TRUE(again) << again.error().message();
        ASSERT_EQ(again->size(), plan.faults.size());
        for (std::size_t k = 0; k < plan.faults.size(); ++k) {
            const InjectionRule &a = plan.faults[k], &b = (*again)[k];
            EXPECT_TRUE(a.fault == b.fault && a.probability == b.probability && a.first == b.first &&
                        a.last == b.last && a.amount == b.amount)
                << text_of({a});
            EXPECT_TRUE(possible(a.fault, plan.line));
        }
    }
}

TEST(Plan, nonsense_is_refused_by_name) {
    for (const char* text : {"frame-drup", "frame-drop@", "frame-drop@x", "frame-drop@7-3", "frame-drop:2",
                             "frame-drop:x", "frame-late+5", "frame-late+5h", "frame-drop@1!"}) {
        const auto read = faults_of(text);
        ASSERT_FALSE(read) << text;
        EXPECT_NE(read.error().message().find(text), std::string::npos);
    }
}

TEST(Shrink, finds_the_two_faults_that_must_meet_and_no_more) {
    // Fails if a frame is dropped at exposure 37 and an edge is lost at arrival 40, with 41 parts or more.
    const auto fires = [](const EpisodePlan& plan, InjectedFault fault, std::uint64_t at) {
        for (const InjectionRule& rule : plan.faults) {
            if (rule.fault == fault && rule.first <= at && at <= rule.last) return true;
        }
        return false;
    };
    const Try attempt = [&](const EpisodePlan& plan) -> Result<Breakage> {
        if (plan.parts > 40 && fires(plan, InjectedFault::frame_drop, 37) && fires(plan, InjectedFault::edge_lost, 40))
            return Breakage{"own-data", 41};
        return Breakage{};
    };
    EpisodePlan plan{5, 5'000, LineProfile::timed, false, {}};
    for (const InjectedFault fault : {InjectedFault::strobe_dead, InjectedFault::frame_drop, InjectedFault::reject_lost,
                                      InjectedFault::edge_lost, InjectedFault::process_crash}) {
        plan.faults.push_back({fault, 0.02, 3, 4'500, {}});
    }
    const auto shrunk = shrink(plan, attempt);
    ASSERT_TRUE(shrunk) << shrunk.error().message();
    EXPECT_EQ(shrunk->promise, "own-data");
    EXPECT_EQ(shrunk->plan.parts, 41U);
    EXPECT_EQ(text_of(shrunk->plan.faults), "frame-drop@37,edge-lost@40");
}

TEST(Shrink, refuses_an_episode_that_breaks_nothing) {
    EXPECT_FALSE(shrink({5, 300, LineProfile::timed, false, {}}, try_episode));
}

}  // namespace
}  // namespace hord::lab
