// The commands of a Rejector backend, kept so that a repeated command does not eject twice and is reported as well.
//
// Loop thread only. A command repeats another if it has the same part number and its start is within kSamePart of the
// other's. Part numbers start again when the station arms; then the starts are further apart.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <utility>

#include "drivers/hal/rejector.h"

namespace hord::hal {

class RejectLedger {
  public:
    static constexpr Duration kSamePart = std::chrono::seconds(1);
    static constexpr std::size_t kPending = 32;  // commands accepted and not yet settled

    enum class Entered : std::uint8_t {
        fresh,    // carry it out and settle() it
        repeat,   // the first one is not settled yet; its report will be delivered once more
        settled,  // deliver `report` again
        full,     // refuse it as busy
    };
    struct Entry {
        Entered entered = Entered::full;
        std::size_t slot = 0;  // of a fresh command, for settle()
        RejectReport report;
    };

    Entry enter(const RejectCommand& command) {
        for (std::size_t k = 0; k < kCapacity; ++k) {
            Record& record = records_[k];
            if (!record.used || record.part != command.part) continue;
            const Duration apart =
                record.start < command.start ? command.start - record.start : record.start - command.start;
            if (apart >= kSamePart) continue;
            if (record.owed == 0) return {Entered::settled, k, record.report};
            ++record.owed;
            return {Entered::repeat, k, {}};
        }
        if (pending_ == kPending) return {};
        while (records_[next_].used && records_[next_].owed > 0)
            next_ = (next_ + 1) % kCapacity;  // terminates: fewer commands are pending than there are records
        records_[next_] = {true, command.part, 1, command.start, {}};
        ++pending_;
        const std::size_t slot = next_;
        next_ = (next_ + 1) % kCapacity;
        return {Entered::fresh, slot, {}};
    }

    // Settles the command in `slot`. Returns how often `report` must be delivered; 0 if it was settled before.
    std::uint32_t settle(std::size_t slot, const RejectReport& report) {
        Record& record = records_[slot];
        if (record.owed == 0) return 0;
        record.report = report;
        --pending_;
        return std::exchange(record.owed, 0);
    }

    // Settles all pending commands and calls deliver(report) as often as each report is owed.
    template <class Deliver>
    void settle_all(RejectReport::Outcome outcome, TimePoint at, Deliver&& deliver) {
        for (std::size_t slot = 0; slot < kCapacity; ++slot) {
            const RejectReport report{records_[slot].part, outcome, at};
            for (auto owed = settle(slot, report); owed > 0; --owed) deliver(report);
        }
    }

    void clear() { *this = RejectLedger{}; }

  private:
    static constexpr std::size_t kCapacity = 256;
    struct Record {
        bool used = false;
        std::uint32_t part = 0;
        std::uint32_t owed = 0;  // deliveries of the report; 0: settled
        TimePoint start;
        RejectReport report;
    };
    std::array<Record, kCapacity> records_{};
    std::size_t next_ = 0;
    std::size_t pending_ = 0;
};

}  // namespace hord::hal
