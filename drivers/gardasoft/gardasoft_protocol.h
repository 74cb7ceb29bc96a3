// The text commands of Gardasoft RT controllers, as their manual prints them. Pure.
//
// A command line ends with CR. The controller returns the line, then what the command prints, then ">".
#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <string_view>

#include "common/result.h"
#include "drivers/gardasoft/gardasoft_options.h"

namespace hord::drivers::gardasoft {

std::string rating_command(const GardasoftChannel& channel);
// Pulse mode. The retrigger delay is pulse and rest of the channel's limits, in whole 0.1 ms, rounded down: the
// controller ignores a trigger that comes sooner, whoever sends it.
std::string pulse_command(const GardasoftChannel& channel, hal::Duration pulse, hal::Duration delay);
// Continuous mode at 0 percent: dark, and triggers do nothing.
std::string dark_command(const GardasoftChannel& channel);
// Triggers the channels of the bit set, in one line.
std::string trigger_command(const GardasoftStrobeOptions& options, std::uint32_t channels);

// What a command printed, without echo, prompt and line ends. `raw` ends with ">". Fails with refused and the
// controller's "Err" in words; also with its warning 5 (it has changed a value). Fails with unreadable if `raw` has no
// ">" or text beside an "Err".
Result<std::string> text_of_reply(std::string_view command, std::string_view raw);

// The error of events "Evtc,e" (output c or 0, event e) in words. None: the text is empty, or no event in it is an
// error. Fails with unreadable: the text is something else.
Result<std::optional<std::string>> error_of_events(std::string_view command, std::string_view text);

// Checks the answer of a command that prints nothing (RS, RT, VL, TR, TT, GT) or the last event (GR). Events are
// accepted for all of these: until it gets "GT0" a controller may send them by itself. Fails with refused if an event
// is an error, with unreadable if `text` is anything else.
Result<void> acknowledged(std::string_view command, std::string_view text);

// The answer of "VR", such as "RT420-20 (HW02) V031". Fails with unreadable if it has another form.
Result<std::string> parse_version(std::string_view text);

// What "ST" says of one channel.
struct ChannelState {
    enum class Mode : std::uint8_t { continuous, pulse, switched, selected };
    int output = 0;
    Mode mode = Mode::continuous;
    double percent = 0;
    hal::Duration delay{}, pulse{}, retrigger{};
    double rated_a = 0;
};
// Fails with unreadable.
Result<ChannelState> parse_channel(std::string_view text);

// How the state differs from what was set, in words; empty: it does not.
std::string difference(const ChannelState& state, const GardasoftChannel& channel, hal::Duration pulse,
                       hal::Duration delay);

}  // namespace hord::drivers::gardasoft
