// Checks the station's store and journal against what the station reported.
//
// Uses the real recorder and its queue, on a disk in memory that the faults make slow, full, broken or in doubt,
// with a wall clock that jumps. A timer replaces the queue's thread; each process has a store of its own. The
// journal is the service's, written to this class.
#pragma once

#include <array>
#include <cstdint>
#include <deque>
#include <functional>
#include <memory>
#include <optional>
#include <span>
#include <string>
#include <string_view>

#include "drivers/hal/event_loop.h"
#include "firmware/service/journal.h"
#include "firmware/station/result_sink.h"
#include "firmware/station/station.h"
#include "firmware/store/recorder/station_recorder.h"
#include "lab/soak/invariants.h"
#include "lab/soak/memory_store.h"

namespace hord::lab {

using namespace firmware;

class StoreObserver final : public ResultSink {
  public:
    static constexpr std::size_t kCapacity = 24;  // results that may wait: few, so that some outages lose results
    static constexpr Duration kBatchEvery = milliseconds(100);
    static constexpr Duration kRetryEvery = milliseconds(1000);
    static constexpr Duration kWorksAgainWithin = milliseconds(2500);  // after the disk's last disk_error

    StoreObserver(hal::EventLoop& loop, Invariants& invariants) : loop_(loop), invariants_(invariants) {}

    // Three events: a process starts; it stops cleanly and writes the waiting results if the disk works; it has ended.
    // `faults` receives the FaultBits of the store whenever they change.
    void open(std::uint32_t boot, const Station& station, std::function<void(std::uint32_t faults)> faults);
    void close();
    void detach();
    void destroy_recorder() { recorder_.reset(); }  // once no call can reach it

    // A fault of the disk or of the wall clock.
    void apply_fault(sim::InjectedFault fault, Duration amount);

    // ResultSink and the journal, called as in the service.
    void on_result(const PartResult& result) override;
    AckStatus on_acknowledged(const RequestOrigin& who, std::uint32_t sequence) override;
    void on_change(const Change& change) override;
    void on_inspection(std::uint32_t, const FrameView&, const algo::Inspection&) override {}
    void state(State from, State to, std::uint32_t active);
    void fault(std::uint32_t raised, const LineStop& why);

    // Call before each command: its record must name the state at this point.
    void before_command() { state_at_command_ = journal_state_; }
    // Commands that the station has told the recorder of.
    [[nodiscard]] std::uint64_t commands_told() const { return commands_told_; }

    // Between two steps: journal, store and station must agree.
    void check(const Snapshot& now);
    // After calm_from(): every result must be on the disk, or reported as lost.
    void end(const Snapshot& last);

    // Results may still wait for the disk until then.
    [[nodiscard]] hal::TimePoint calm_from() const { return trouble_until_ + kWorksAgainWithin; }

    [[nodiscard]] std::uint64_t stored() const { return stored_; }  // results on disks
    [[nodiscard]] std::uint64_t lost() const { return lost_; }      // results that the stores report as lost
    [[nodiscard]] std::uint64_t entries() const { return journal_entries_; }

  private:
    struct ReportedResult {
        PartResult result;
        store::UtcMicros arrived_us = 0;  // by the wall clock at the time of the report
    };
    [[nodiscard]] store::UtcMicros wall() const;
    [[nodiscard]] std::optional<Error> disk_error() const;
    void begin_run();
    void write_soon(Duration after);
    void write();
    void read_new_entries();
    void read(const store::ResultRecord& record);
    void stored_up_to(std::uint32_t sequence);
    void read(const store::ChangeRecord& record);
    void read_command(const store::ChangeRecord& record);
    void read(const store::AcknowledgeRecord& record);
    void read(const store::StartRecord& record);
    void journal(const Entry& entry, std::span<const Field> fields);
    void check_faults();  // once a second
    void report_fault(std::uint32_t faults);
    void violation(const std::string& what, std::uint64_t part = 0) {
        invariants_.broken(Promise::one_story, what, part);
    }

    hal::EventLoop& loop_;
    Invariants& invariants_;
    Duration wall_offset_ = std::chrono::hours(24 * 365 * 50);  // of the machine's clock against the station's

    // Ends of the faults of the disk.
    hal::TimePoint broken_until_{}, full_until_{}, in_doubt_until_{}, slow_until_{}, trouble_until_{};

    // Of this process.
    std::unique_ptr<store::MemoryDisk> disk_;
    std::unique_ptr<store::StationRecorder> recorder_;
    std::function<void(std::uint32_t)> faults_;
    const Station* station_ = nullptr;  // null: the process is gone
    std::uint64_t run_ = 0;
    hal::EventLoop::TimerId timer_ = hal::EventLoop::TimerId::none, fault_timer_ = hal::EventLoop::TimerId::none;
    int pending_fault_reports_ = 0;        // changes of the store's fault that the station has not received yet
    std::deque<ReportedResult> reported_;  // neither stored nor lost; the first is result stored_to_ + 1
    std::uint32_t reported_to_ = 0;
    std::uint64_t read_to_ = 0;                        // the disk's entries that were checked, by number
    std::uint32_t stored_to_ = 0;                      // sequence
    std::uint32_t missing_from_ = 0, missing_to_ = 0;  // sequences that a later entry must report as lost
    std::uint64_t lost_in_run_ = 0;
    Counters stored_counts_;       // sums over the results on the disk
    std::deque<Change> commands_;  // reported, and not on the disk yet

    StationJournal story_{
        [this](const Entry& entry, std::string_view, std::span<const Field> fields) { journal(entry, fields); }};
    std::uint64_t commands_told_ = 0;
    std::string journal_state_, state_at_command_;
    std::uint32_t journal_faults_ = 0;

    std::uint64_t stored_ = 0, lost_ = 0, journal_entries_ = 0;
};

}  // namespace hord::lab
