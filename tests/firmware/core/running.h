// A station in continuous execution.
#pragma once

#include "tests/firmware/core/core_rig.h"

namespace hord::firmware {

class Running : public ::testing::Test {
  protected:
    Running() { rig.bring_to(State::continuous_execution); }

    // The part gets no valid verdict and is rejected, for this reason.
    void expect_fail_safe(std::uint32_t part, PartReason reason) {
        ASSERT_TRUE(rig.advance_until_rejected(part));
        rig.confirmed(part);
        for (const PartResult& r : rig.results) {
            if (r.part != part) continue;
            EXPECT_EQ(r.verdict, PartVerdict::unfit);
            EXPECT_EQ(r.reason, reason) << name_of(r.reason);
            EXPECT_EQ(r.reject, RejectState::confirmed);
            return;
        }
        ADD_FAILURE() << "no result for part " << part;
    }

    CoreRig rig;
};

}  // namespace hord::firmware
