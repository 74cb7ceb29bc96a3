// A simulated Modbus TCP module on loopback, in its own thread: coils 0 to 15, and Read Device Identification. It has
// its own framing, independent of the driver's library. (tests/support/modbus_module simulates the other kinds of
// modules, serial lines and faults.)
//
//     auto module = sim::CoilModule::open(clock);
//     (*module)->on_coil([&](int coil, bool on, hal::TimePoint at) {                        // module's thread
//         if (coil == 0) loop.post([&world, on, at] { world.set_ejector(on, at); });
//     });
#pragma once

#include <array>
#include <cstdint>
#include <functional>
#include <memory>
#include <span>
#include <thread>
#include <vector>

#include "common/result.h"
#include "common/unique_fd.h"
#include "drivers/hal/clock.h"

namespace hord::sim {

class CoilModule {
  public:
    // Listens on 127.0.0.1, on a free port, when this returns. `clock` is read on the module's thread and outlives it.
    // `realtime`: SCHED_FIFO priority of its thread, so that it answers in time even when this machine is busy; With 0,
    // or if the system refuses it, the thread keeps the caller's policy. Fails with io.
    static Result<std::unique_ptr<CoilModule>> open(const hal::Clock& clock, int realtime = 0);
    ~CoilModule();  // all coils fall to 0
    CoilModule(const CoilModule&) = delete;
    CoilModule& operator=(const CoilModule&) = delete;

    [[nodiscard]] int port() const { return port_; }

    // Called on the module's thread when a coil moves. Set it before the first connection.
    void on_coil(std::function<void(int coil, bool on, hal::TimePoint at)> callback) { on_coil_ = std::move(callback); }

  private:
    using Bytes = std::vector<std::uint8_t>;
    explicit CoilModule(const hal::Clock& clock) : clock_(clock) {}
    Result<void> listen();
    void serve();
    void accept_one();
    bool answer(int client);  // one request; false: the connection ended
    Bytes reply_to(std::span<const std::uint8_t> request);
    void move(std::size_t coil, bool on);

    const hal::Clock& clock_;
    int port_ = 0;
    common::UniqueFd listener_, stop_;
    std::vector<common::UniqueFd> clients_;
    std::array<bool, 16> coils_{};
    std::function<void(int, bool, hal::TimePoint)> on_coil_;
    std::thread thread_;
};

}  // namespace hord::sim
