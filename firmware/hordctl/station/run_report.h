// Summary of a run: every part's verdict compared with the truth if it is known, latencies, throughput.
#pragma once

#include <cstddef>
#include <map>
#include <string>

#include "drivers/hal/clock.h"
#include "firmware/core/station_types.h"
#include "firmware/devices/device_factory.h"
#include "firmware/hordctl/station/resource_monitor.h"

namespace hord::firmware {

class RunReport {
  public:
    // A part without a kind has no known truth, one without `ejected` no known way: neither is counted as wrong.
    void add(const PartResult& result, const Backends::Fate& fate);

    [[nodiscard]] std::size_t parts() const { return verdicts_.count(); }

    // Several lines for a person; `elapsed` is the time the line ran.
    [[nodiscard]] std::string text(hal::Duration elapsed) const;

  private:
    struct Row {
        std::size_t parts = 0, pass = 0, reject = 0, unfit = 0, ejected = 0;
    };
    LatencyCounts verdicts_, rejects_;
    std::map<std::string, Row> rows_;
    std::map<PartReason, std::size_t> reasons_;
    std::size_t wrong_ = 0;  // good and ejected, or defective and not
    std::size_t taken_off_ = 0, on_line_ = 0;
    bool ways_known_ = true;  // every part's way off the line is known
};

}  // namespace hord::firmware
