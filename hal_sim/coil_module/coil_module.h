// A Modbus module as the rejector drives one: a peer of its own, in its own thread, over real sockets (Modbus TCP on
// loopback) or a pseudo-terminal (Modbus RTU). Its framing is its own, so that a bug in the driver's library shows.
// Plays each kind of module that has a profile. Remembers when which output moved, and misbehaves when told to.
//
//     auto module = sim::CoilModule::open(clock, {.port = 0});
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
#include "hal_sim/coil_module/module_image.h"

namespace hord::sim {

struct CoilModuleOptions {
    int port = 0;  // 0: a free one, chosen by the kernel
    int coils = 16;
    ModuleKind kind = ModuleKind::plain;
    bool serial = false;                                  // Modbus RTU on a pseudo-terminal instead of TCP: device()
    int unit = 1;                                         // serial: the one it answers to
    hal::Duration pulse = std::chrono::milliseconds(10);  // moxa: what a pulse coil gives
    hal::Duration watchdog{};                             // moxa: its own watchdog; zero: none
    // SCHED_FIFO with this priority, as a module is a machine of its own, which answers in time however busy this one
    // is; 0, or where it is refused: the caller's policy.
    int realtime = 0;
};

// What happens to a request.
enum class CoilFault : std::uint8_t {
    none,
    silent,     // read, neither carried out nor answered
    late,       // carried out at once, answered `delay` later
    drip,       // carried out, answered byte by byte, `delay` apart
    damaged,    // carried out, one bit of the answer is wrong
    noise,      // carried out, the answer comes behind bytes that are none
    exception,  // refused: exception 04, server device failure
    close,      // the connection closes instead (serial: silence)
    stuck,      // acknowledged, the coil does not move
};

class CoilModule {
  public:
    struct Move {
        int coil = 0;
        bool on = false;
        hal::TimePoint at;
    };

    // Listens on 127.0.0.1 (answers on its pseudo-terminal) when it returns. `clock` is asked on the module's thread
    // and outlives it. Fails with busy (the port), io.
    static Result<std::unique_ptr<CoilModule>> open(const hal::Clock& clock, const CoilModuleOptions& options = {});
    ~CoilModule();

    // Any thread, all of them.
    [[nodiscard]] int port() const;
    [[nodiscard]] std::string device() const;  // serial: the end that a driver opens
    [[nodiscard]] bool coil(int number) const;
    [[nodiscard]] std::vector<Move> history() const;  // of the newest 10,000 or more
    [[nodiscard]] int connections() const;            // accepted since open()

    // The next `writes` write requests misbehave (-1: all); reading requests do so only with `reads`, too.
    void misbehave(CoilFault fault, int writes = -1, hal::Duration delay = {}, bool reads = false);
    void misbehave_at_reads(CoilFault fault, int reads,
                            hal::Duration delay = {});  // the next so many reading requests alone
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
    explicit CoilModule(std::unique_ptr<Module> module);
    std::unique_ptr<Module> module_;
};

}  // namespace hord::sim
