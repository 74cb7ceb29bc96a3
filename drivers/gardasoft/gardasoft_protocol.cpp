#include "drivers/gardasoft/gardasoft_protocol.h"

#include <algorithm>
#include <charconv>
#include <cmath>
#include <vector>

#include <fmt/format.h>

namespace hord::drivers::gardasoft {
namespace {

using hal::Duration;

constexpr int kMaxOutputs = 8;

double ms(Duration time) { return static_cast<double>(time.count()) / 1e6; }

Duration retrigger_of(const GardasoftChannel& channel, Duration pulse) {
    constexpr Duration kStep = std::chrono::microseconds(100);
    return (pulse + channel.limits.rest_after(pulse)) / kStep * kStep;
}

std::string_view trimmed(std::string_view text) {
    const auto is_space = [](char c) { return c == ' ' || c == '\r' || c == '\n' || c == '\t'; };
    while (!text.empty() && is_space(text.front())) text.remove_prefix(1);
    while (!text.empty() && is_space(text.back())) text.remove_suffix(1);
    return text;
}

// A number with its unit behind it.
struct Quantity {
    double number = 0;
    std::string_view unit;
};
std::optional<Quantity> quantity(std::string_view text) {
    text = trimmed(text);
    Quantity q;
    const auto [end, error] = std::from_chars(text.data(), text.data() + text.size(), q.number);
    if (error != std::errc{} || !std::isfinite(q.number)) return std::nullopt;
    q.unit = trimmed(text.substr(static_cast<std::size_t>(end - text.data())));
    return q;
}
std::optional<Duration> time_of(std::string_view text) {
    const auto q = quantity(text);
    if (!q || std::abs(q->number) > 1e6) return std::nullopt;
    const double ns = q->unit == "us" ? 1e3 : q->unit == "ms" || q->unit.empty() ? 1e6 : q->unit == "s" ? 1e9 : 0;
    if (ns == 0) return std::nullopt;
    return Duration(std::llround(q->number * ns));
}

bool take(std::string_view& text, std::string_view word) {
    if (!text.starts_with(word)) return false;
    text = trimmed(text.substr(word.size()));
    return true;
}
// A whole number from 0 on at the text's front.
std::optional<int> take_number(std::string_view& text) {
    int number = 0;
    const auto [end, error] = std::from_chars(text.data(), text.data() + text.size(), number);
    if (error != std::errc{} || number < 0) return std::nullopt;
    text = trimmed(text.substr(static_cast<std::size_t>(end - text.data())));
    return number;
}

tl::unexpected<Error> unreadable(std::string_view command, std::string_view text) {
    return fail(ErrorCode::unreadable,
                fmt::format("the strobe controller answers \"{}\" with {:?}", command, text.substr(0, 120)),
                "is it a Gardasoft controller of the RT series?");
}

Error error_of(int number, std::string_view command) {
    const std::string what = fmt::format("the strobe controller answers \"{}\" with Err {}", command, number);
    switch (number) {
        case 1:
            return {ErrorCode::refused, what + ", a value is invalid",
                    "check strobe.channel.output (it has fewer outputs?), rated_ma and brightness_percent"};
        case 2:
            return {ErrorCode::refused, what + ", it does not know the command",
                    "this backend is for controllers of the RT series: check the model and its firmware"};
        case 5:
            if (!command.starts_with("RT"))  // it sets none of our values
                return {ErrorCode::refused, what + ", it has changed a value",
                        "read the controller's events, then switch it off and on"};
            return {ErrorCode::refused, what + ", it has changed a value",
                    "set timing.strobe_us, strobe.delay_us and strobe.channel.brightness_percent within its ranges"};
        default: return {ErrorCode::refused, what, "see the error codes in the controller's manual"};
    }
}

// None: the event is no error.
std::optional<std::string> words_of_event(int event) {
    switch (event) {
        case 128:  // a light was connected and works
        case 138:  // SafePower training is complete
            return std::nullopt;
        case 40:
        case 41:
        case 44:
        case 130: return "the controller is too hot";
        case 45:
        case 131: return "more current than expected";
        case 46:
        case 47: return "too much heat in an output";
        case 129: return "a light was connected and has no rating";
        case 132: return "the light could not be sensed";
        case 140: return "the light was turned off: its duty cycle is too high";
        default: return fmt::format("event {}", event);
    }
}

}  // namespace

std::string rating_command(const GardasoftChannel& channel) {
    return fmt::format("VL{},0,{:.3f}A", channel.output, channel.rated_ma / 1000.0);
}

std::string pulse_command(const GardasoftChannel& channel, Duration pulse, Duration delay) {
    return fmt::format("RT{},{:.3f},{:.3f},{:.1f},{:.1f}", channel.output, ms(pulse), ms(delay),
                       channel.brightness_percent, ms(retrigger_of(channel, pulse)));
}

std::string dark_command(const GardasoftChannel& channel) { return fmt::format("RS{},0", channel.output); }

std::string trigger_command(const GardasoftStrobeOptions& options, std::uint32_t channels) {
    std::string line;
    for (std::size_t k = 0; k < options.channels.size(); ++k) {
        if (((channels >> k) & 1U) != 0)
            line += fmt::format("{}TR{}", line.empty() ? "" : ";", options.channels[k].output);
    }
    return line;
}

Result<std::string> text_of_reply(std::string_view command, std::string_view raw) {
    std::string_view text = trimmed(raw);
    if (text.empty() || text.back() != '>') {
        return fail(ErrorCode::unreadable, fmt::format("the strobe controller's answer to \"{}\" has no end", command),
                    "is it a Gardasoft controller of the RT series?");
    }
    text = trimmed(text.substr(0, text.size() - 1));
    if (text.starts_with(command)) text = trimmed(text.substr(command.size()));
    std::optional<int> first;  // of several commands in a line, each may have its own
    for (std::string_view rest = text; take(rest, "Err");) {
        const auto number = take_number(rest);
        if (!number || !(rest.empty() || rest.starts_with("Err"))) return unreadable(command, text);
        if (!first) first = number;
    }
    if (first) return tl::unexpected(error_of(*first, command));
    return std::string(text);
}

Result<std::optional<std::string>> error_of_events(std::string_view command, std::string_view text) {
    std::optional<std::string> first;
    for (std::string_view rest = trimmed(text); !rest.empty();) {
        const auto output = take(rest, "Evt") ? take_number(rest) : std::nullopt;
        const auto event = output && take(rest, ",") ? take_number(rest) : std::nullopt;
        if (!event || *output > kMaxOutputs || !(rest.empty() || take(rest, ";") || rest.starts_with("Evt")))
            return unreadable(command, text);
        if (!first) first = words_of_event(*event);
    }
    return first;
}

Result<void> acknowledged(std::string_view command, std::string_view text) {
    const auto error = error_of_events(command, text);
    if (!error) return tl::unexpected(error.error());
    if (!*error) return {};
    return fail(ErrorCode::refused, "the strobe controller reports: " + **error,
                "check the lights and their wires; the controller's display shows the error");
}

Result<std::string> parse_version(std::string_view text) {
    std::string_view rest = text;
    (void)take(rest, "TR-");
    const bool printable = std::ranges::all_of(text, [](char c) { return c >= ' ' && c <= '~'; });
    const std::size_t hardware = rest.find(" (HW"), firmware = rest.find(") V");
    if (printable && rest.starts_with("RT") && hardware != std::string_view::npos &&
        firmware != std::string_view::npos && hardware < firmware)
        return std::string(text);
    return unreadable("VR", text);
}

Result<ChannelState> parse_channel(std::string_view text) {
    enum Field : unsigned {
        output = 1,
        mode = 2,
        percent = 4,
        delay = 8,
        pulse = 16,
        retrigger = 32,
        rated = 64,
        all = 127
    };
    ChannelState state;
    unsigned found = 0;
    const auto bad = [&] {
        return fail(ErrorCode::unreadable,
                    fmt::format("the strobe controller describes a channel as {:?}", text.substr(0, 120)),
                    "is it a Gardasoft controller of the RT series?");
    };
    // False: no such value, or the field is there twice.
    const auto keep = [&](Field field, auto& into, const auto& value) {
        if (!value || (found & field) != 0) return false;
        into = *value;
        found |= field;
        return true;
    };
    const auto number = [](std::string_view of) -> std::optional<double> {
        const auto q = quantity(of);
        return q ? std::optional(q->number) : std::nullopt;
    };
    const auto whole = [&](std::string_view of, int most) -> std::optional<int> {
        const auto value = number(of);
        if (!value || *value != std::floor(*value) || *value < 0 || *value > most) return std::nullopt;
        return static_cast<int>(*value);
    };
    for (std::size_t at = 0; at < text.size();) {
        const std::size_t comma = std::min(text.find(',', at), text.size());
        const std::string_view field = trimmed(text.substr(at, comma - at));
        at = comma + 1;
        const std::string_view name = field.substr(0, 2), value = field.substr(std::min<std::size_t>(2, field.size()));
        int number_of_mode = 0;
        bool good = true;
        if (name == "CH") good = keep(output, state.output, whole(value, 255));
        else if (name == "MD") good = keep(mode, number_of_mode, whole(value, 3));
        else if (name == "DL") good = keep(delay, state.delay, time_of(value));
        else if (name == "PU") good = keep(pulse, state.pulse, time_of(value));
        else if (name == "RT") good = keep(retrigger, state.retrigger, time_of(value));
        else if (name == "RA") good = keep(rated, state.rated_a, number(value));
        else if (name.starts_with('S')) good = keep(percent, state.percent, number(field.substr(1)));
        if (!good) return bad();
        if (name == "MD") state.mode = static_cast<ChannelState::Mode>(number_of_mode);
    }
    if (found != all) return bad();
    return state;
}

std::string difference(const ChannelState& state, const GardasoftChannel& channel, Duration pulse, Duration delay) {
    // Half of the last digit that the controller prints, and some.
    static constexpr Duration kStep = std::chrono::microseconds(1);
    const auto near = [](Duration a, Duration b) { return std::chrono::abs(a - b) <= kStep; };
    if (state.output != channel.output) return fmt::format("it answers for output {}", state.output);
    if (state.mode != ChannelState::Mode::pulse) return "it is not in pulse mode";
    if (std::abs(state.percent - channel.brightness_percent) > 0.06)
        return fmt::format("its brightness is {} %, not {} %", state.percent, channel.brightness_percent);
    if (!near(state.pulse, pulse)) return fmt::format("its pulse is {} ms, not {} ms", ms(state.pulse), ms(pulse));
    if (!near(state.delay, delay)) return fmt::format("its delay is {} ms, not {} ms", ms(state.delay), ms(delay));
    if (!near(state.retrigger, retrigger_of(channel, pulse)))
        return fmt::format("its retrigger delay is {} ms, not {} ms", ms(state.retrigger),
                           ms(retrigger_of(channel, pulse)));
    if (std::abs(state.rated_a * 1000 - channel.rated_ma) > 0.6)
        return fmt::format("its light is rated {} A, not {} mA", state.rated_a, channel.rated_ma);
    return {};
}

}  // namespace hord::drivers::gardasoft
