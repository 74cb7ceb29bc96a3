// What a run came to: every part's verdict against the truth where it is known, latencies, throughput.
#pragma once

#include <cstddef>
#include <map>
#include <string>

#include "drivers/hal/clock.h"
#include "firmware/core/station_types.h"
#include "firmware/hordctl/station/resource_monitor.h"

namespace hord::firmware {

class RunReport {
  public:
    // `kind` is what the part truly was ("good", "bubble", ...); empty where nobody knows. `ejected` is whether it
    // truly left the line through the ejector; only looked at where the kind is known. `taken_off`: a person took it
    // off the stopped line.
    void add(const PartResult& result, const std::string& kind, bool ejected, bool taken_off);

    [[nodiscard]] std::size_t parts() const { return verdicts_.count(); }

    // Parts that were good and rejected, or defective and let through; 0 where the truth is not known.
    [[nodiscard]] std::size_t wrong() const { return wrong_; }

    // Several lines for a person; `elapsed` is the time the line ran.
    [[nodiscard]] std::string text(hal::Duration elapsed) const;

  private:
    struct Row {
        std::size_t parts = 0, pass = 0, reject = 0, unfit = 0, ejected = 0;
    };
    LatencyCounts verdicts_, rejects_;
    std::map<std::string, Row> rows_;
    std::map<PartReason, std::size_t> reasons_;
    std::size_t wrong_ = 0, taken_off_ = 0;
};

}  // namespace hord::firmware
