// The operator of the simulated line: stops it by commands of the PLC at moments that matter, and lets it start again.
//
// An order is one to three commands, each at a moment of its own: the first ends the production (stop, abort or halt),
// the others are any commands. In half of the orders the feeder stops with it, as at the end of a batch: only then the
// line becomes empty. `amount` after the last command the feeder is on again and the PLC starts the station.
#pragma once

#include <cstdint>
#include <functional>

#include "drivers/hal/event_loop.h"
#include "firmware/core/core.h"
#include "hal_sim/world/random.h"
#include "lab/soak/plc_simulator.h"

namespace hord::lab {

using namespace firmware;

class OrderedStops {
  public:
    struct Effects {
        std::function<void(bool on)> feed;                // switches the feeder
        std::function<void(Duration amount)> interferes;  // a command follows: the line may stand for `amount`
    };
    OrderedStops(hal::EventLoop& loop, PlcSimulator& plc, std::uint64_t seed, Effects effects)
        : loop_(loop), plc_(plc), seed_(seed), effects_(std::move(effects)) {}

    // Begins an order; an order that is still being carried out goes on, and nothing else happens.
    void order(Duration amount);
    // After each step of the core: whether the moment of the next command has come.
    void stepped(const Core& core);

  private:
    enum class Moment : std::uint8_t { at_once, before_camera, before_ejector, pulse_pending, line_empty };
    // A command whose moment does not come within this time is sent nevertheless.
    static constexpr Duration kPatience = milliseconds(2000);

    [[nodiscard]] std::uint64_t draw() { return sim::random_bits(seed_, 0x09DE5, drawn_++); }
    [[nodiscard]] bool has_come(const Core& core) const;
    void await_next();
    void send_soon();
    void send();

    hal::EventLoop& loop_;
    PlcSimulator& plc_;
    std::uint64_t seed_, drawn_ = 0;
    Effects effects_;
    Duration amount_{};
    int commands_left_ = 0;
    bool awaits_ = false, feeder_stops_ = false;
    std::uint64_t awaited_ = 0;  // number of the moment that is awaited
    Moment moment_ = Moment::at_once;
    Command next_ = Command::stop;
};

}  // namespace hord::lab
