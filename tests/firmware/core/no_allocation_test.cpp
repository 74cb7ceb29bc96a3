// After construction the core does not allocate: every operator new of this program is counted.
#include <memory>

#include "tests/firmware/core/core_rig.h"
#include "tests/support/counted_heap.h"

namespace hord::firmware {
namespace {

using hord::test::allocations;

TEST(NoAllocation, the_counter_counts) {
    const std::uint64_t before = allocations;
    ::operator delete(::operator new(8));
    EXPECT_EQ(allocations, before + 1);
}

TEST(NoAllocation, a_thousand_parts_of_every_fate_take_no_memory) {
    CoreConfig config = quick_line();
    config.max_failures_in_a_row = 0;
    auto core = std::make_unique<Core>(config);
    auto actions = std::make_unique<Actions>();
    TimePoint now(std::chrono::seconds(1));
    std::uint32_t frame = 0;
    const auto send = [&](const Event& e) { core->step(e, now, *actions); };
    send(Command::initialise);
    for (int d = 0; d < kDevices; ++d) send(DeviceUp{static_cast<Device>(d)});
    send(Command::arm);
    send(Command::start_continuous);

    const std::uint64_t before = allocations;
    for (std::uint32_t part = 1; part <= 1000; ++part) {
        const TimePoint exposure = now + config.exposure_delay;
        send(hal::PartEdge{hal::PartEdge::Kind::arrives, now, part, {}});
        now += milliseconds(10);
        if (part % 7 != 0) send(hal::StrobeReport{part, part % 11 != 0, exposure + config.strobe_delay, config.strobe});
        if (part % 5 != 0) send(FrameArrived{1, {++frame, exposure, part % 13 == 0 ? 10U : 1000U, false}});
        if (part % 6 != 0)
            send(Judged{part, part % 17 == 0, part % 2 == 0 ? algo::Verdict::pass : algo::Verdict::reject, {}, 0, 0});
        const TimePoint next = now + milliseconds(90);
        while (core->next_wake() <= next) {
            now = core->next_wake();
            send(Tick{});
            for (const Action& action : *actions) {
                if (const auto* command = std::get_if<hal::RejectCommand>(&action)) {
                    const auto told = *command;
                    send(hal::RejectReport{told.part, hal::RejectReport::Outcome::confirmed, now});
                    break;
                }
            }
        }
        now = next;
    }
    EXPECT_EQ(allocations, before);
    EXPECT_EQ(core->snapshot().counters.seen, 1000U);
    EXPECT_GT(core->snapshot().counters.pass, 100U);
    EXPECT_GT(core->snapshot().counters.reject_confirmed, 100U);
}

TEST(NoAllocation, a_core_is_a_value) {
    CoreRig rig;
    rig.bring_to(State::continuous_execution);
    const auto part = rig.part_is_seen();
    const Core copy = rig.core;
    rig.judged(part, algo::Verdict::pass);
    EXPECT_EQ(copy.snapshot().counters.pass, 0U);
    EXPECT_EQ(rig.shot().counters.pass, 1U);
}

}  // namespace
}  // namespace hord::firmware
