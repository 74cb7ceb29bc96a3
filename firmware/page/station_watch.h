// Polls the station over Modbus, as any other client, and updates Live. A thread of its own; connects again when the
// station does not answer.
#pragma once

#include <chrono>
#include <functional>
#include <thread>

#include "firmware/page/live.h"
#include "firmware/registers/register_client.h"

namespace hord::firmware::page {

class StationWatch {
  public:
    // `every_round` is called after each poll, on the polling thread.
    StationWatch(modbus::Endpoint endpoint, std::chrono::milliseconds poll, Live& live,
                 std::function<void()> every_round);

  private:
    void work(const std::stop_token& stop);
    Result<void> poll();
    Result<void> read(BlockId id);
    Result<void> follow(std::uint32_t newest, std::uint32_t oldest);

    const modbus::Endpoint endpoint_;
    const std::chrono::milliseconds poll_;
    Live& live_;
    const std::function<void()> every_round_;

    std::optional<modbus::Client> client_;
    RegisterSnapshot snapshot_;
    std::string last_status_;
    std::chrono::steady_clock::time_point slow_blocks_at_{}, sample_at_{};
    std::uint32_t boot_ = 0, seen_ = 0;
    bool began_ = false;

    std::jthread thread_;
};

}  // namespace hord::firmware::page
