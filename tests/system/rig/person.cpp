#include "tests/system/rig/person.h"

#include <optional>
#include <stdexcept>

#include "firmware/registers/register_client.h"

namespace hord::rig {
namespace {

using namespace std::chrono_literals;

// Register addresses (docs/registers.md): STATUS starts at 102; reject_failed is in COUNTERS.
constexpr std::uint16_t kState = 102, kRejectFailed = 158;
constexpr std::uint16_t kContinuousExecution = 8, kLineStop = 1U << 2U;

std::uint32_t pair_at(const std::vector<std::uint16_t>& words, std::size_t at) {
    return static_cast<std::uint32_t>(words[at]) << 16U | words[at + 1];
}

}  // namespace

Person::Person(const std::string& station) : thread_([this, station] { run(station); }) {}
Person::~Person() {
    stopping_ = true;
    thread_.join();
}

void Person::run(const std::string& station) {
    using namespace firmware;
    const auto endpoint = modbus::parse_endpoint(station);
    if (!endpoint) return;
    std::optional<modbus::Client> client;
    int stood = 0;  // consecutive reads in which the station stood
    for (; !stopping_; std::this_thread::sleep_for(100ms)) {
        if (!client) {
            executes_ = false;
            if (auto reached = modbus::Client::connect(*endpoint, 2s)) client.emplace(std::move(*reached));
            else continue;
        }
        const auto status = client->read(kState, 20);
        const auto failed = client->read(kRejectFailed, 2);
        if (!status || !failed) {
            client.reset();
            continue;
        }
        executes_ = (*status)[0] == kContinuousExecution;
        if (((*status)[1] & kLineStop) != 0) line_stop_ = true;
        faults_ |= pair_at(*status, 13);
        reject_failed_ = pair_at(*failed, 0);
        // If nothing prevents it, the station starts by itself: no command is needed.
        stood = executes_ ? 0 : stood + 1;
        if (stood < 10 || !may_reset_) continue;
        stood = 0;
        if (const auto reply = client->command(Command::reset, 0, 0, 10s, "rig");
            reply && reply->state == CommandState::completed)
            ++resets_;
    }
}

}  // namespace hord::rig
