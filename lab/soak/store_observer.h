// What the station writes down: its store and its journal, held against what it reported.
//
// The real recorder and its queue, on a disk in memory that is slow, full, broken or in doubt as the faults say, under
// a wall clock that somebody sets. The queue's thread is played by a timer; one run of the store a process. The journal
// is the service's own, told to a list.
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
#include "firmware/store/results/memory_store.h"
#include "lab/soak/invariants.h"

namespace hord::lab {

using namespace firmware;

class StoreObserver final : public ResultSink {
  public:
    static constexpr std::size_t kCapacity = 24;  // results that may wait: few, so that some outages lose some
    static constexpr Duration kBatchEvery = milliseconds(100);
    static constexpr Duration kRetryEvery = milliseconds(1000);
    static constexpr Duration kWorksAgainWithin = milliseconds(2500);  // after the disk's last trouble

    StoreObserver(hal::EventLoop& loop, Invariants& invariants) : loop_(loop), invariants_(invariants) {}

    // A process begins to write, stops in order (what waits is written, if the disk lets it), or is gone.
    // `faults`: FaultBits of the store, as they are from now on.
    void open(std::uint32_t boot, const Station& station, std::function<void(std::uint32_t faults)> faults);
    void close();
    void die();
    void bury() { recorder_.reset(); }  // when nobody can call it any more

    // The disk's and the wall clock's faults.
    void strike(sim::Fault fault, Duration amount);

    // As the service does it.
    void on_result(const PartResult& result) override;
    Taken on_acknowledged(const Who& who, std::uint32_t sequence) override;
    void on_change(const Change& change) override;
    void on_inspection(std::uint32_t, const FrameView&, const algo::Inspection&) override {}
    void state(State from, State to, std::uint32_t active);

    // A command is about to be given: what it changes is changed from now.
    void command_comes() { state_at_command_ = journal_state_; }

    // At a quiet moment: journal, store and station tell the same of it.
    void check(const Snapshot& now);
    // The disk works and time enough has passed: everything must be on it.
    void end(const Snapshot& last);

    // Until then what waits may not be on the disk.
    [[nodiscard]] hal::TimePoint calm_from() const { return trouble_until_ + kWorksAgainWithin; }

    [[nodiscard]] std::uint64_t stored() const { return stored_; }  // results on disks
    [[nodiscard]] std::uint64_t lost() const { return lost_; }      // results that the stores say they do not have
    [[nodiscard]] std::uint64_t entries() const { return journal_entries_; }

  private:
    struct Told {
        PartResult result;
        store::UtcMicros arrived_us = 0;  // by the wall clock as it was when the result was told
    };
    [[nodiscard]] store::UtcMicros wall() const;
    [[nodiscard]] std::optional<Error> trouble() const;
    void begin_run();
    void write_soon(Duration after);
    void write();
    void read_new_entries();
    void read(const store::ResultRecord& record);
    void stored_up_to(std::uint32_t sequence);
    void read(const store::ChangeRecord& record);
    void read(const store::CommandRecord& record);
    void read(const store::AcknowledgeRecord& record);
    void read(const store::StartRecord& record);
    void journal(const Entry& entry, std::span<const Field> fields);
    void look_at_faults();  // once a second
    void tell_fault(std::uint32_t faults);
    void wrong(const std::string& what, std::uint64_t part = 0) { invariants_.broken(Promise::one_story, what, part); }

    hal::EventLoop& loop_;
    Invariants& invariants_;
    Duration wall_offset_ = std::chrono::hours(24 * 365 * 50);  // of the machine's clock against the station's

    // The disk, as the faults make it.
    hal::TimePoint broken_until_{}, full_until_{}, in_doubt_until_{}, slow_until_{}, trouble_until_{};

    // Of this process.
    std::unique_ptr<store::MemoryDisk> disk_;
    std::unique_ptr<store::StationRecorder> recorder_;
    std::function<void(std::uint32_t)> faults_;
    const Station* station_ = nullptr;  // null: the process is gone
    std::uint64_t run_ = 0;
    hal::EventLoop::TimerId timer_ = hal::EventLoop::TimerId::none, look_ = hal::EventLoop::TimerId::none;
    int untold_ = 0;         // the store's fault has changed, and the station does not know yet
    std::deque<Told> told_;  // and neither stored nor said to be lost; the first is result stored_to_ + 1
    std::uint32_t told_to_ = 0;
    std::uint64_t read_to_ = 0;                        // the disk's entries by number
    std::uint32_t stored_to_ = 0;                      // sequence
    std::uint32_t missing_from_ = 0, missing_to_ = 0;  // sequences that a later entry must account for
    std::uint64_t lost_in_run_ = 0;
    Counters stored_counts_;       // summed from what is on the disk
    std::deque<Change> commands_;  // told, and not on the disk yet

    StationJournal story_{
        [this](const Entry& entry, std::string_view, std::span<const Field> fields) { journal(entry, fields); }};
    std::string journal_state_, state_at_command_;
    std::uint32_t journal_faults_ = 0;

    std::uint64_t stored_ = 0, lost_ = 0, journal_entries_ = 0;
};

}  // namespace hord::lab
