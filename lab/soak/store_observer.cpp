#include "lab/soak/store_observer.h"

#include <algorithm>
#include <utility>

#include <nlohmann/json.hpp>

#include "firmware/core/faults.h"
#include "hal_sim/world/random.h"

namespace hord::lab {

using sim::InjectedFault;

namespace {

// The queue's thread does not wake in phase with the PLC's cycle.
constexpr Duration kFirstBatch = milliseconds(37);
constexpr std::uint64_t kClockStream = 0xC10C;

bool same(const PartResult& a, const PartResult& b) {
    return a.sequence == b.sequence && a.part == b.part && a.arrived_ns == b.arrived_ns && a.verdict == b.verdict &&
        a.reason == b.reason && a.defects == b.defects && a.latency_us == b.latency_us &&
        a.reject_latency_us == b.reject_latency_us && a.reject == b.reject && a.position_m == b.position_m &&
        a.position_n == b.position_n && a.recipe == b.recipe;
}

}  // namespace

// -- a process's life

void StoreObserver::open(std::uint32_t boot, const Station& station, std::function<void(std::uint32_t)> faults) {
    detach();
    destroy_recorder();
    begin_run();
    station_ = &station;
    faults_ = std::move(faults);
    disk_->on_open = disk_->on_write = [this] { return disk_error(); };
    disk_->on_written = [this]() -> std::optional<Error> {
        if (loop_.now() >= in_doubt_until_) return std::nullopt;
        return Error{ErrorCode::io, "the disk does not say whether it has written", "see the kernel's log"};
    };
    store::StationRecorderOptions options;
    options.start.boot = boot;
    options.queue.capacity = kCapacity;
    options.queue.thread = false;
    options.ignored_part = Station::kTestPart;
    const store::StoreQueue::Listener listener{[this](const Error&) { report_fault(kFaultStore); },
                                               [this] { report_fault(0); }};
    recorder_ = std::make_unique<store::StationRecorder>(
        loop_, [this] { return wall(); }, [this] { return store::MemoryStore::open(*disk_); }, options, listener,
        nullptr);
    recorder_->in_use(store::ChangeRecord::What::configuration, "defaults", "");
    fault_timer_ = loop_.call_after(milliseconds(1000), [this] { check_faults(); });
    write();
    write_soon(kFirstBatch);
}

void StoreObserver::begin_run() {
    ++run_;
    disk_ = std::make_unique<store::MemoryDisk>();
    pending_fault_reports_ = 0;
    reported_to_ = stored_to_ = missing_from_ = missing_to_ = 0;
    read_to_ = lost_in_run_ = 0;
    stored_counts_ = {};
    commands_.clear();
    reported_.clear();
    story_ = StationJournal(
        [this](const Entry& entry, std::string_view, std::span<const Field> fields) { journal(entry, fields); });
    journal_state_ = name_of(State::preoperational);
    journal_faults_ = 0;
}

void StoreObserver::close() {
    if (station_ == nullptr) return;
    write();
    detach();
}

void StoreObserver::detach() {
    station_ = nullptr;
    loop_.cancel(timer_);
    loop_.cancel(fault_timer_);
}

// In the service the disk's thread reports to the loop's thread.
void StoreObserver::report_fault(std::uint32_t faults) {
    ++pending_fault_reports_;
    loop_.post([this, faults, run = run_] {
        if (run != run_ || station_ == nullptr) return;
        --pending_fault_reports_;
        faults_(faults);
    });
}

// -- the disk and the clock

void StoreObserver::apply_fault(InjectedFault fault, Duration amount) {
    const hal::TimePoint until = loop_.now() + amount;
    const auto lasts = [&](hal::TimePoint& what) {
        what = std::max(what, until);
        trouble_until_ = std::max(trouble_until_, until);
    };
    switch (fault) {
        case InjectedFault::store_error: return lasts(broken_until_);
        case InjectedFault::disk_full: return lasts(full_until_);
        case InjectedFault::store_in_doubt: return lasts(in_doubt_until_);
        case InjectedFault::store_slow: return lasts(slow_until_);
        case InjectedFault::clock_set:
            wall_offset_ += sim::random_bits(run_, kClockStream, reported_to_) % 2 == 0 ? amount : -amount;
            return;
        default: return;
    }
}

store::UtcMicros StoreObserver::wall() const { return (loop_.now().time_since_epoch() + wall_offset_).count() / 1000; }

std::optional<Error> StoreObserver::disk_error() const {
    if (loop_.now() < full_until_) return Error{ErrorCode::io, "no space left on the disk", "make room"};
    if (loop_.now() < broken_until_) return Error{ErrorCode::io, "the disk answers with an error", "replace it"};
    return std::nullopt;
}

void StoreObserver::write_soon(Duration after) {
    loop_.cancel(timer_);
    timer_ = loop_.call_after(after, [this] {
        if (loop_.now() < slow_until_) return write_soon(slow_until_ - loop_.now());
        write();
        write_soon(recorder_->state().failing ? kRetryEvery : kBatchEvery);
    });
}

void StoreObserver::write() {
    (void)recorder_->step();
    read_new_entries();
    if (recorder_->state().waiting > kCapacity + 1024)
        invariants_.broken(Promise::bounded, "too many records wait for the disk");
}

// -- reports of the station

void StoreObserver::on_result(const PartResult& result) {
    reported_to_ = result.sequence;
    reported_.push_back({result, (result.arrived_ns + wall_offset_.count()) / 1000});
    recorder_->on_result(result);
}

AckStatus StoreObserver::on_acknowledged(const RequestOrigin& who, std::uint32_t sequence) {
    const AckStatus taken = recorder_->on_acknowledged(who, sequence);
    switch (taken) {
        case AckStatus::recorded:
            if (sequence > stored_to_) violation("a PLC was given a result that a loss of power would take away");
            break;
        case AckStatus::not_yet:
            if (loop_.now() >= slow_until_) write_soon(milliseconds(1));
            break;
        case AckStatus::failed:
            if (loop_.now() > calm_from()) violation("an acknowledgement was refused, and the disk works");
            break;
    }
    return taken;
}

void StoreObserver::on_change(const Change& change) {
    if (change.what == Change::What::command) {
        commands_.push_back(change);
        ++commands_told_;
        if (change.before != state_at_command_)
            violation("a command's record says " + change.before + ", the journal was at " + state_at_command_);
    }
    recorder_->on_change(change);
}

// -- what is on the disk

void StoreObserver::read_new_entries() {
    auto& entries = disk_->entries;
    for (const store::Entry& entry : entries) {
        if (entry.number != 0 && entry.number <= read_to_) continue;  // checked before
        if (entry.number > read_to_ + 1) violation("the store has lost record " + std::to_string(read_to_ + 1));
        read_to_ = std::max(read_to_, entry.number);
        std::visit([this](const auto& record) { read(record); }, entry.record);
    }
    // The store recognises its run by the last entry.
    if (entries.size() > 1) entries.erase(entries.begin(), entries.end() - 1);
}

void StoreObserver::read(const store::StartRecord& record) {
    if (read_to_ != 0) violation("the store has a second start of one run, at " + std::to_string(record.time_us));
}

void StoreObserver::read(const store::ResultRecord& record) {
    const PartResult& r = record.result;
    if (r.sequence <= stored_to_ || r.sequence > reported_to_) return violation("is stored out of order", r.part);
    if (r.sequence != stored_to_ + 1) {
        if (missing_from_ != 0)
            violation("results " + std::to_string(missing_from_) + " to " + std::to_string(missing_to_) +
                      " are missing, and nothing says so");
        missing_from_ = stored_to_ + 1;
        missing_to_ = r.sequence - 1;
    }
    stored_up_to(r.sequence - 1);
    const ReportedResult reported = reported_.front();
    stored_up_to(r.sequence);
    ++stored_;
    if (!same(r, reported.result)) violation("is stored otherwise than it was reported", r.part);
    if (std::abs(record.time_us - reported.arrived_us) > 1)
        violation("is stored with a time that no clock showed", r.part);
    switch (r.verdict) {
        case PartVerdict::pass: ++stored_counts_.pass; break;
        case PartVerdict::reject: ++stored_counts_.reject; break;
        case PartVerdict::unfit: ++stored_counts_.unfit; break;
    }
    stored_counts_.reject_confirmed += r.reject == RejectState::confirmed ? 1U : 0U;
    stored_counts_.reject_failed += r.reject == RejectState::failed ? 1U : 0U;
    stored_counts_.reject_late += r.reject == RejectState::late ? 1U : 0U;
}

void StoreObserver::stored_up_to(std::uint32_t sequence) {
    for (; stored_to_ < sequence; ++stored_to_) reported_.pop_front();
}

void StoreObserver::read(const store::ChangeRecord& record) {
    if (record.what == store::ChangeRecord::What::command) return read_command(record);
    if (record.what != store::ChangeRecord::What::lost) return;
    const auto said = nlohmann::json::parse(record.after);
    const auto from = said["from_sequence"].get<std::uint32_t>(), to = said["to_sequence"].get<std::uint32_t>();
    if (from == stored_to_ + 1 && to >= from && to <= reported_to_) {
        stored_up_to(to);
    } else if (from != missing_from_ || to != missing_to_) {
        violation("the store says that results " + std::to_string(from) + " to " + std::to_string(to) +
                  " are lost, missing are " + std::to_string(missing_from_) + " to " + std::to_string(missing_to_));
    }
    missing_from_ = missing_to_ = 0;
    lost_in_run_ += to - from + 1;
    lost_ += to - from + 1;
}

void StoreObserver::read_command(const store::ChangeRecord& record) {
    if (commands_.empty()) return violation("the store has a command that nobody gave");
    const Change& reported = commands_.front();
    if (record.token != reported.who.token || record.name != reported.name || record.before != reported.before ||
        record.after != reported.after) {
        violation("a command is stored otherwise than it was carried out");
    }
    commands_.pop_front();
}

void StoreObserver::read(const store::AcknowledgeRecord& record) {
    if (record.sequence > stored_to_) violation("the store says that a PLC has taken what was not stored before");
}

// -- the journal

void StoreObserver::state(State from, State to, std::uint32_t active) { story_.state(from, to, active); }

void StoreObserver::fault(std::uint32_t raised, const LineStop& why) { story_.raised(raised, why); }

void StoreObserver::check_faults() {
    fault_timer_ = loop_.call_after(milliseconds(1000), [this] { check_faults(); });
    const std::uint32_t active = station_->snapshot().faults_active;
    story_.faults(active);
    if (journal_faults_ != active) violation("the journal's faults are not the station's");
}

void StoreObserver::journal(const Entry& entry, std::span<const Field> fields) {
    ++journal_entries_;
    for (const Field& field : fields) {
        if (field.name == "HORD_FROM" && field.value != journal_state_)
            violation("the journal goes on from " + field.value + ", and was at " + journal_state_);
        if (field.name != "HORD_FAULT") continue;
        const auto texts = kFaultTable;
        const auto fault =
            std::find_if(texts.begin(), texts.end(), [&](const FaultInfo& text) { return text.name == field.value; });
        const bool over = entry.id == entry_of(JournalEvent::fault_cleared).id;
        if (fault == texts.end() || ((journal_faults_ & fault->bit) != 0) != over)
            return violation("the journal tells of fault " + field.value + " twice");
        journal_faults_ ^= fault->bit;
    }
    for (const Field& field : fields) {
        if (field.name != "HORD_STATE") continue;
        journal_state_ = field.value;
        if (field.value == name_of(State::error) && journal_faults_ == 0)
            violation("the journal tells of Error, and of no fault before it");
    }
}

// -- agreement

void StoreObserver::check(const Snapshot& now) {
    if (station_ == nullptr) return;
    if (journal_state_ != name_of(now.state))
        violation("the journal is at " + journal_state_ + ", the station in " + std::string(name_of(now.state)));
    const store::StoreQueueState queue = recorder_->state();
    if (pending_fault_reports_ == 0 && queue.failing != ((now.faults_active & kFaultStore) != 0))
        violation("the registers show another state of the store than it is in");
    if (queue.failing && loop_.now() > calm_from())
        invariants_.broken(Promise::ready_again, "the disk works, and nothing is stored");
}

void StoreObserver::end(const Snapshot& last) {
    if (station_ == nullptr) return;
    write();
    check_faults();
    check(last);
    if (missing_from_ != 0) write();  // a loss is recorded with the next batch
    if (missing_from_ != 0 || stored_to_ != reported_to_) {
        violation("results up to " + std::to_string(reported_to_) + " were reported, the store knows of those up to " +
                  std::to_string(stored_to_));
    }
    if (!commands_.empty()) violation("a command was carried out and is not stored");
    if (lost_in_run_ != 0) return;
    const Counters &c = stored_counts_, &shown = last.counters;
    const bool agree = c.pass == shown.pass && c.reject == shown.reject && c.unfit == shown.unfit &&
        c.reject_confirmed == shown.reject_confirmed && c.reject_failed == shown.reject_failed &&
        c.reject_late == shown.reject_late;
    if (!agree) violation("what is stored does not come to what the counters say");
}

}  // namespace hord::lab
