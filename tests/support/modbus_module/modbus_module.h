// A simulated Modbus module for the rejector's driver, in its own thread, over real sockets (Modbus TCP on loopback) or
// a pseudo-terminal (Modbus RTU). It has its own framing, independent of the driver's library, to reveal bugs there.
// Simulates each kind of module that has a profile. Records when which output moved, and misbehaves on demand.
//
//     auto module = test::ModbusModule::open(clock, {.port = 0});
//     (*module)->on_coil([&](int coil, bool on, hal::TimePoint at) {                        // module's thread
//         if (coil == 0) loop.post([&world, on, at] { world.set_ejector(on, at); });
//     });
#pragma once

#include <functional>
#include <memory>
#include <string>
#include <vector>

#include "common/result.h"
#include "drivers/hal/clock.h"
#include "tests/support/modbus_module/module_image.h"

namespace hord::test {

struct ModbusModuleOptions {
    int port = 0;  // 0: a free one, chosen by the kernel
    int coils = 16;
    ModuleKind kind = ModuleKind::plain;
    bool serial = false;                                  // Modbus RTU on a pseudo-terminal instead of TCP: device()
    int unit = 1;                                         // serial: its address
    hal::Duration pulse = std::chrono::milliseconds(10);  // moxa: width of a pulse coil's pulse
    hal::Duration watchdog{};                             // moxa: its own watchdog; zero: none
    // SCHED_FIFO priority of its thread: a real module answers in time even when this machine is busy. 0, or if the
    // kernel refuses it: the caller's policy.
    int realtime = 0;
};

// What happens to a request.
enum class ModuleFault : std::uint8_t {
    none,
    silent,     // read, neither carried out nor answered
    late,       // carried out at once, answered `delay` later
    drip,       // carried out, answered byte by byte, `delay` apart
    damaged,    // carried out, one bit of the answer is wrong
    noise,      // carried out, meaningless bytes precede the answer
    exception,  // refused: exception 04, server device failure
    close,      // the connection closes instead (serial: silence)
    stuck,      // acknowledged, the coil does not move
};

class ModbusModule {
  public:
    struct Move {
        int coil = 0;
        bool on = false;
        hal::TimePoint at;
    };

    // Listens on 127.0.0.1, or answers on its pseudo-terminal, when this returns. `clock` is read on the module's
    // thread and outlives it. Fails with busy (the port) or io.
    static Result<std::unique_ptr<ModbusModule>> open(const hal::Clock& clock, const ModbusModuleOptions& options = {});
    ~ModbusModule();

    // All functions are thread-safe.
    [[nodiscard]] int port() const;
    [[nodiscard]] std::string device() const;  // serial: the end that a driver opens
    [[nodiscard]] bool coil(int number) const;
    [[nodiscard]] std::vector<Move> history() const;  // the newest 10,000 moves or more
    [[nodiscard]] int connections() const;            // accepted since open()

    // The fault applies to the next `writes` write requests (-1: all), and with `reads` to read requests, too.
    void misbehave(ModuleFault fault, int writes = -1, hal::Duration delay = {}, bool reads = false);
    void misbehave_at_reads(ModuleFault fault, int reads,
                            hal::Duration delay = {});  // the next `reads` read requests only
    [[nodiscard]] int misbehaved() const;               // requests, since open()

    void set_input(int number, bool on);  // a discrete input; as a sensor wired to it
    [[nodiscard]] bool watchdog_expired() const;
    [[nodiscard]] int watchdog_triggers() const;

    void power_off();         // connections drop, nothing answers, all coils fall to 0
    Result<void> power_on();  // the same port again. Fails with busy

    // Called on the module's thread, without any lock; before the first connection.
    void on_coil(std::function<void(int coil, bool on, hal::TimePoint at)> callback);

  private:
    struct Module;
    explicit ModbusModule(std::unique_ptr<Module> module);
    std::unique_ptr<Module> module_;
};

}  // namespace hord::test
