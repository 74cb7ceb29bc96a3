// What a run came to: every part's verdict against the truth where it is known, latencies, throughput.
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
    // Without a kind, nobody knows what the part truly was; then it does not matter whether it was ejected.
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
    std::size_t taken_off_ = 0;
};

}  // namespace hord::firmware
