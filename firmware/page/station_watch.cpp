#include "firmware/page/station_watch.h"

#include <algorithm>
#include <condition_variable>
#include <ctime>
#include <mutex>
#include <span>
#include <utility>

namespace hord::firmware::page {
namespace {

using Steady = std::chrono::steady_clock;
constexpr auto kTimeout = std::chrono::milliseconds(1000);
constexpr auto kAskAgain = std::chrono::milliseconds(500);
constexpr auto kSlowBlocks = std::chrono::milliseconds(1000);
constexpr std::uint32_t kResultsInOneRead = kMaxRead / kResultWords;
constexpr std::uint32_t kFirstResults = 60;  // earlier results read at the start
constexpr std::int64_t kSameMachine_ns = 60'000'000'000;

std::int64_t nanoseconds_of(clockid_t clock) {
    timespec now{};
    ::clock_gettime(clock, &now);
    return std::int64_t{now.tv_sec} * 1'000'000'000 + now.tv_nsec;
}

RingResult result_from(const std::vector<Reading>& readings, std::uint32_t boot) {
    RegisterSnapshot m;
    m.set(BlockId::ring, readings);
    const auto number = [&](std::string_view row) { return m.number(BlockId::ring, row); };
    RingResult result;
    result.boot = boot;
    result.sequence = static_cast<std::uint32_t>(number("sequence").value_or(0));
    result.part = static_cast<std::uint32_t>(number("part").value_or(0));
    result.defects = static_cast<std::uint32_t>(number("defects").value_or(0));
    result.verdict = m.text(BlockId::ring, "verdict");
    result.reason = m.text(BlockId::ring, "reason");
    result.reject = m.text(BlockId::ring, "reject_state");
    result.score = number("score");
    result.bounded = m.text(BlockId::ring, "flags").find("bounded") != std::string::npos;
    result.latency_us = number("latency");
    if (result.reject == "confirmed" || result.reject == "late") result.reject_latency_us = number("reject_latency");
    // On the station's machine both have the same monotonic clock.
    const double arrived_s = number("arrived_s").value_or(0), arrived_us = number("arrived_us").value_or(0);
    const auto verdict_ns = static_cast<std::int64_t>(arrived_s) * 1'000'000'000 +
        static_cast<std::int64_t>(arrived_us + result.latency_us.value_or(0)) * 1000;
    const std::int64_t age_ns = nanoseconds_of(CLOCK_MONOTONIC) - verdict_ns;
    const bool same_machine = age_ns >= 0 && age_ns < kSameMachine_ns;
    result.verdict_ms = (nanoseconds_of(CLOCK_REALTIME) - (same_machine ? age_ns : 0)) / 1'000'000;
    return result;
}

}  // namespace

StationWatch::StationWatch(modbus::Endpoint endpoint, std::chrono::milliseconds poll, Live& live,
                           std::function<void()> every_round)
    : endpoint_(std::move(endpoint)), poll_(poll), live_(live), every_round_(std::move(every_round)),
      thread_([this](const std::stop_token& stop) { work(stop); }) {}

void StationWatch::work(const std::stop_token& stop) {
    std::mutex mutex;
    std::unique_lock lock(mutex);
    std::condition_variable_any pause_over;
    std::chrono::milliseconds pause{0};
    for (; !stop.stop_requested(); pause_over.wait_for(lock, stop, pause, [] { return false; })) {
        const auto looked = poll();
        if (!looked) {
            client_.reset();
            live_.set_unreachable(looked.error());
        }
        const auto now = Steady::now();
        if (now - sample_at_ >= std::chrono::seconds(History::kShortStep_s)) {
            // Keeps its rhythm, but does not catch up after a long silence.
            sample_at_ = now - sample_at_ > std::chrono::seconds(10)
                ? now
                : sample_at_ + std::chrono::seconds(History::kShortStep_s);
            live_.sample(static_cast<std::int64_t>(std::time(nullptr)));
        }
        if (every_round_) every_round_();
        pause = looked ? poll_ : kAskAgain;
    }
}

Result<void> StationWatch::read(BlockId id) {
    auto readings = client_->read_block(id);
    if (readings) snapshot_.set(id, std::move(*readings));
    else if (readings.error().code != ErrorCode::not_found) return tl::unexpected(readings.error());
    return {};  // an older station does not have every block
}

Result<void> StationWatch::poll() {
    const auto now = Steady::now();
    if (!client_) {
        auto client = modbus::Client::connect(endpoint_, kTimeout);
        if (!client) return tl::unexpected(client.error());
        client_.emplace(std::move(*client));
        snapshot_ = {};
        if (auto done = read(BlockId::ident); !done) return done;
        slow_blocks_at_ = {};
        last_status_.clear();
        const std::uint32_t boot = snapshot_.bits(BlockId::ident, "boot_id");
        if (boot != std::exchange(boot_, boot)) began_ = false;
    }
    if (auto done = read(BlockId::status); !done) return done;
    const bool all = now - slow_blocks_at_ >= kSlowBlocks;
    if (all) {
        slow_blocks_at_ = now;
        for (const BlockId id :
             {BlockId::counters, BlockId::health, BlockId::plc, BlockId::recipe, BlockId::calibration}) {
            if (auto done = read(id); !done) return done;
        }
    }
    // Between two full polls only a change of state, bits or faults is published.
    std::string status = snapshot_.text(BlockId::status, "state");
    for (const char* row : {"bits", "faults_active", "faults_latched"})
        status += " " + snapshot_.text(BlockId::status, row);
    if (all || status != last_status_) live_.set_station(snapshot_);
    last_status_ = std::move(status);
    return follow(snapshot_.bits(BlockId::status, "last_sequence"), snapshot_.bits(BlockId::status, "oldest_sequence"));
}

Result<void> StationWatch::follow(std::uint32_t newest, std::uint32_t oldest) {
    if (newest == 0) return {};
    if (!began_ || newest < seen_)
        seen_ = std::max(newest > kFirstResults ? newest - kFirstResults : 0, oldest > 0 ? oldest - 1 : 0);
    else if (oldest > seen_ + 1) {
        live_.add_missed(oldest - seen_ - 1);
        seen_ = oldest - 1;
    }
    began_ = true;
    const Block& ring = *find_block(BlockId::ring);
    while (seen_ < newest) {
        const std::uint32_t next = seen_ + 1,
                            count = std::min({newest - seen_, kResultsInOneRead, kRingSlots - next % kRingSlots});
        const auto words = client_->read(address_of_result(next), std::size_t{count} * kResultWords);
        if (!words) return tl::unexpected(words.error());
        for (std::uint32_t k = 0; k < count; ++k) {
            const auto readings =
                decode_slot(ring, std::span(*words).subspan(std::size_t{k} * kResultWords, kResultWords));
            const RingResult result = readings ? result_from(*readings, boot_) : RingResult{};
            if (result.sequence == next + k) live_.add_result(result);
            else live_.add_missed(1);  // overwritten meanwhile
        }
        seen_ += count;
    }
    return {};
}

}  // namespace hord::firmware::page
