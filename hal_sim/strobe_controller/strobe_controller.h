// A simulated strobe controller that speaks the text commands of the Gardasoft RT series, in its own thread: VR, ST,
// GR, GT, TT, VL, RS, RW, RT, TR, AW. Written from the manual, with a parser of its own, independent of the driver's.
//
//     auto controller = sim::StrobeController::open(clock, {.outputs = 2});
//     options.host = "127.0.0.1", options.port = (*controller)->port();
#pragma once

#include <cstdint>
#include <memory>
#include <mutex>
#include <optional>
#include <string>
#include <string_view>
#include <thread>
#include <vector>

#include "common/result.h"
#include "common/unique_fd.h"
#include "drivers/hal/clock.h"

namespace hord::sim {

class StrobeController {
  public:
    struct Options {
        int outputs = 2;
        bool serial = false;  // a pseudo-terminal (device()) instead of TCP on loopback
    };
    // How it misbehaves from now on.
    enum class Fault : std::uint8_t {
        none,
        silent,        // does not answer
        garbage,       // answers with bytes that mean nothing
        endless,       // answers with text without the prompt
        busy,          // answers 300 ms late
        wrong_output,  // describes another output than it was asked for
        adjusts,       // changes a pulse's width and warns (Err 5)
        rounds,        // changes a pulse's width and does not say it
        stays_on,      // takes a pulse's settings and stays in continuous mode
        refuses,       // Err 1 to every trigger
        overheated,    // reports an over-temperature event
    };

    // Fails with io. `clock` is read on the controller's thread and outlives it.
    static Result<std::unique_ptr<StrobeController>> open(const hal::Clock& clock, Options options);
    ~StrobeController();
    StrobeController(const StrobeController&) = delete;
    StrobeController& operator=(const StrobeController&) = delete;

    [[nodiscard]] int port() const { return port_; }
    [[nodiscard]] const std::string& device() const { return device_; }

    // Any thread, all of them.
    void misbehave(Fault fault, std::string command = {});  // at this command only ("GR"); empty: at every one
    void power_cycle();  // closes the connection; its saved settings: every output at 50 percent, continuous
    void plug(bool in);  // the network cable (TCP alone): out, it listens no more
    void turn_knob(int output, double percent);  // at its front panel
    void trigger(int output);                    // at its input
    struct Pulse {
        int output = 0;
        hal::TimePoint at;
        hal::Duration width{};
        double amperes = 0;
    };
    [[nodiscard]] std::vector<Pulse> pulses() const;
    [[nodiscard]] bool continuous() const;  // an output is lit without a pulse
    [[nodiscard]] int ignored() const;      // triggers within the retrigger delay
    [[nodiscard]] int connections() const;  // accepted so far

  private:
    enum class Mode : std::uint8_t { continuous, pulse, switched };
    struct Output {
        Mode mode = Mode::continuous;
        double percent = 50, rated_a = 0;
        double pulse_ms = 1, delay_ms = 1, retrigger_ms = 0;
        std::optional<hal::TimePoint> triggered;
    };
    StrobeController(const hal::Clock& clock, Options options);
    Result<void> listen(int port);
    void serve();
    bool receive();  // false: the connection ended
    void answer(const std::string& line);
    std::string reply_to(const std::string& line);
    std::string execute(std::string_view command);
    std::string execute_channel(std::string_view name, const std::vector<double>& numbers);
    std::string describe(int output) const;
    int fire(int output);  // error number
    void drop_client();

    const hal::Clock& clock_;
    const Options options_;
    int port_ = 0;
    std::string device_;
    common::UniqueFd listener_, client_, wake_, far_end_;
    std::string received_;
    mutable std::mutex mutex_;
    std::vector<Output> outputs_;
    std::vector<Pulse> pulses_;
    Fault fault_ = Fault::none;
    std::string fault_at_;
    bool plugged_ = true, drop_ = false, stop_ = false;
    int ignored_ = 0, connections_ = 0;
    std::thread thread_;
};

}  // namespace hord::sim
