// The simulated rejector: its ejector hits the part that is in front of it. The acknowledgement is simulated
// separately, so it may be wrong or missing.
#pragma once

#include <optional>

#include "drivers/hal/event_loop.h"
#include "drivers/hal/reject_ledger.h"
#include "drivers/hal/rejector.h"
#include "hal_sim/devices/pending.h"
#include "hal_sim/world/fault_injection.h"
#include "hal_sim/world/latency.h"
#include "hal_sim/world/world.h"

namespace hord::sim {

struct RejectorOptions {
    LatencyOptions write{std::chrono::microseconds(300), {}};     // command to acknowledgement
    hal::Duration link_after = std::chrono::milliseconds(5);      // start() to link up
    hal::Duration give_up_after = std::chrono::milliseconds(50);  // no acknowledgement: failed
    bool permit_moves_belt = false;                               // the belt stops while the run permit is down
};

class SimRejector final : public hal::Rejector {
  public:
    SimRejector(hal::EventLoop& loop, World& world, InjectionPlan& faults, const RejectorOptions& options,
                std::uint64_t seed)
        : loop_(loop), world_(world), faults_(faults), options_(options), latency_(options.write, seed, 0x4E7E),
          jobs_(loop, [this](const Job& job) { settle(job); }),
          pulses_(loop, [this](const Pulse& pulse) { step(pulse); }) {}
    ~SimRejector() override;

    [[nodiscard]] bool run_permit() const { return permit_; }  // the module's coil

    // The link goes down now, for this long.
    void unplug(hal::Duration gone_for) {
        if (up_) link_goes_down(gone_for);
    }

  private:
    struct Job {  // a report to be sent
        hal::RejectReport report;
        std::optional<std::size_t> ledger_slot;  // empty: a command repeated after its report
    };
    struct Pulse {
        hal::TimePoint from, until;
        bool open = false;
    };
    Result<void> do_start(Listener& listener) override;
    Result<void> do_reject(const hal::RejectCommand& command) override;
    void do_set_run_permit(bool permit) override;
    void do_stop() override;

    void carry_out(const hal::RejectCommand& command, std::size_t ledger_slot);
    void settle(const Job& job);
    void step(Pulse pulse);  // opens the valve, then closes it
    void valve(bool open, hal::TimePoint at);
    void link_goes_up();
    void link_goes_down(hal::Duration gone_for);
    void move_permit(bool permit);

    hal::EventLoop& loop_;
    World& world_;
    InjectionPlan& faults_;
    RejectorOptions options_;
    Latency latency_;
    Listener* listener_ = nullptr;
    bool up_ = false, permit_ = false;
    int open_ = 0;  // overlapping pulses; the valve is open while above 0
    hal::EventLoop::TimerId link_timer_{}, down_timer_{};
    hal::RejectLedger ledger_;
    Pending<Job> jobs_;
    Pending<Pulse> pulses_;
};

}  // namespace hord::sim
