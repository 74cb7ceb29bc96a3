// The metrics of station and page for Prometheus (/metrics). docs/page.md lists them.
#pragma once

#include <cstdint>
#include <map>
#include <string>

#include "firmware/page/live.h"

namespace hord::firmware::page {

// The page's own figures.
struct PageFigures {
    std::string version;
    std::size_t viewers = 0;
    std::map<int, std::uint64_t> replies;           // by status
    std::map<std::string, std::uint64_t> commands;  // by outcome: "completed", "failed", "refused"
    std::uint64_t turned_away = 0;                  // connections beyond the limit
};

std::string metrics_text(const Live::Figures& station, const PageFigures& page);

}  // namespace hord::firmware::page
