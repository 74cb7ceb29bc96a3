// `hordctl run --json`: one JSON object a part on stdout, with the sentence that explains its verdict.
#pragma once

#include <cstdint>
#include <deque>
#include <map>
#include <memory>
#include <mutex>
#include <string>

#include "algo/inspection/pipeline.h"
#include "firmware/core/station_types.h"
#include "firmware/devices/device_factory.h"

namespace hord::firmware {

// Keeps the sentence of each inspected part until the part's result comes.
class PartLines {
  public:
    // Any thread.
    void set_recipe(std::shared_ptr<const algo::Recipe> recipe);
    void keep(std::uint32_t part, const algo::Inspection& found, const algo::Extents& extents);

    // One thread, which never waits for the reader: lines that it does not take yet wait here. Fails with io, once: a
    // line could not be written, or too many wait; the first part that has none is named. The station goes on, and
    // later lines are not printed, so that a reader never takes a part of a line for a line.
    Result<void> print(const PartResult& result, const Backends::Fate& fate);

    // Writes what waits, at most so long without progress. Fails with io, once, as print() does.
    Result<void> finish(int patience_ms);
    [[nodiscard]] bool lost() const { return lost_; }  // some line

  private:
    std::string take(std::uint32_t part);  // empty: the part was not inspected
    Result<void> write(int patience_ms, const char* then);

    static constexpr std::size_t kMax = 1000;                // parts whose result has not come
    static constexpr std::size_t kMaxWaiting = 1024 * 1024;  // bytes, about 3,000 parts
    std::mutex mutex_;
    std::shared_ptr<const algo::Recipe> recipe_ = std::make_shared<const algo::Recipe>();
    std::map<std::uint32_t, std::string> by_part_;
    std::string waiting_;                      // lines that are not written; the first may be begun
    std::deque<std::uint32_t> waiting_parts_;  // whose lines these are
    bool lost_ = false;
};

}  // namespace hord::firmware
