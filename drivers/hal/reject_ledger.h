// What a Rejector backend remembers of its commands, so that a repeated one neither ejects twice nor goes unreported.
//
// Loop thread only. A command repeats another when it names the same part for a start within kSamePart of it; part
// numbers may begin anew when the station arms again, and then the starts are further apart.
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
        repeat,   // under way: its report is owed once more; nothing to do
        settled,  // done before: deliver `report` again
        full,     // refuse it as busy
    };
    struct Entry {
        Entered entered = Entered::full;
        std::size_t slot = 0;  // of a fresh command, for settle()
        RejectReport report;
    };

    Entry enter(const RejectCommand& command) {
        for (std::size_t k = 0; k < kRemembered; ++k) {
            Line& line = lines_[k];
            if (!line.used || line.part != command.part) continue;
            const Duration apart = line.start < command.start ? command.start - line.start : line.start - command.start;
            if (apart >= kSamePart) continue;
            if (line.owed == 0) return {Entered::settled, k, line.report};
            ++line.owed;
            return {Entered::repeat, k, {}};
        }
        if (pending_ == kPending) return {};
        while (lines_[next_].used && lines_[next_].owed > 0)
            next_ = (next_ + 1) % kRemembered;  // fewer pending than lines
        lines_[next_] = {true, command.part, 1, command.start, {}};
        ++pending_;
        const std::size_t slot = next_;
        next_ = (next_ + 1) % kRemembered;
        return {Entered::fresh, slot, {}};
    }

    // The command in `slot` is settled. Returns how many times the report is owed; 0 when it was settled before.
    std::uint32_t settle(std::size_t slot, const RejectReport& report) {
        Line& line = lines_[slot];
        if (line.owed == 0) return 0;
        line.report = report;
        --pending_;
        return std::exchange(line.owed, 0);
    }

    // Settles everything that is not, and calls deliver(report) as often as each report is owed.
    template <class Deliver>
    void settle_all(RejectReport::Outcome outcome, TimePoint at, Deliver&& deliver) {
        for (std::size_t slot = 0; slot < kRemembered; ++slot) {
            const RejectReport report{lines_[slot].part, outcome, at};
            for (auto owed = settle(slot, report); owed > 0; --owed) deliver(report);
        }
    }

    [[nodiscard]] std::size_t pending() const { return pending_; }
    void forget() { *this = RejectLedger{}; }

  private:
    static constexpr std::size_t kRemembered = 256;
    struct Line {
        bool used = false;
        std::uint32_t part = 0;
        std::uint32_t owed = 0;  // reports; 0: settled
        TimePoint start;
        RejectReport report;
    };
    std::array<Line, kRemembered> lines_{};
    std::size_t next_ = 0;
    std::size_t pending_ = 0;
};

}  // namespace hord::hal
