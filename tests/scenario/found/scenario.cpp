#include <gtest/gtest.h>

#include "firmware/soak/soak.h"
#include "tests/scenario/found/found.h"

namespace hord::firmware {
namespace {

TEST(Found, breaks_no_promise_any_more) {
    for (const Found& found : kFound) {
        const auto plan = plan_of(found);
        ASSERT_TRUE(plan) << plan.error().message();
        SoakReport report;
        ASSERT_TRUE(run_episode(*plan, report));
        EXPECT_TRUE(report.good()) << found.bug << "\n" << describe(report);
    }
}

}  // namespace
}  // namespace hord::firmware
