#include "lab/soak/ordered_stops.h"

#include <array>

namespace hord::lab {

void OrderedStops::order(Duration amount) {
    if (commands_left_ > 0) return;
    constexpr std::array kFirst{Command::stop, Command::stop, Command::abort, Command::halt};
    amount_ = amount;
    next_ = kFirst[draw() % kFirst.size()];
    commands_left_ = 1 + static_cast<int>(draw() % 3);
    feeder_stops_ = draw() % 2 == 0;
    if (feeder_stops_) effects_.feed(false);
    await_next();
}

void OrderedStops::await_next() {
    // Without feed every moment comes; with it, the line is never empty.
    moment_ = static_cast<Moment>(draw() % (feeder_stops_ ? 5 : 4));
    awaits_ = true;
    plc_.leave_alone(kPatience);
    loop_.call_after(moment_ == Moment::at_once ? Duration{} : kPatience, [this, moment = ++awaited_] {
        if (awaits_ && moment == awaited_) send_soon();
    });
}

bool OrderedStops::has_come(const Core& core) const {
    const Line& line = core.line();
    if (moment_ == Moment::line_empty) return line.size() == 0;
    for (std::uint32_t k = 0; k < line.size(); ++k) {
        const Part& part = line[k];
        const bool undone = part.phase == Part::Phase::waiting || part.phase == Part::Phase::decided;
        if (moment_ == Moment::before_camera        ? undone && !part.exposed
                : moment_ == Moment::before_ejector ? undone && part.exposed
                                                    : part.phase == Part::Phase::commanded)
            return true;
    }
    return false;
}

void OrderedStops::stepped(const Core& core) {
    if (awaits_ && moment_ != Moment::at_once && has_come(core)) send_soon();
}

// Half of the commands come right after the step that brought the moment, the others up to 20 ms later.
void OrderedStops::send_soon() {
    awaits_ = false;
    const std::uint64_t bits = draw();
    const auto after = bits % 2 == 0 ? Duration{} : Duration(static_cast<Duration::rep>(bits / 2 % 20'000'000));
    loop_.call_after(after, [this] { send(); });
}

void OrderedStops::send() {
    effects_.interferes(amount_);
    plc_.leave_alone(amount_);
    plc_.command_with_care(next_);
    if (--commands_left_ > 0) {
        next_ = static_cast<Command>(1 + draw() % 9);
        return await_next();
    }
    if (feeder_stops_) loop_.call_after(amount_, [this] { effects_.feed(true); });
}

}  // namespace hord::lab
