#include <gtest/gtest.h>

#include "lab/soak/soak.h"
#include "tests/system/scenario/found/found.h"

namespace hord::lab {
namespace {

TEST(Found, breaks_no_promise_any_more) {
    for (const Found& found : kFound) {
        const auto plan = plan_of(found);
        ASSERT_TRUE(plan) << plan.error().message();
        const auto report = run_episode(*plan);
        ASSERT_TRUE(report) << report.error().message();
        EXPECT_TRUE(report->good()) << found.bug << "\n" << describe(*report);
    }
}

}  // namespace
}  // namespace hord::lab
