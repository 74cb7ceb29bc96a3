#include "lab/soak/plc_simulator.h"

#include <algorithm>

#include "hal_sim/world/random.h"

namespace hord::lab {
namespace {

constexpr modbus::Origin kPlc{"192.0.2.7:50123"};

std::uint16_t at(BlockId block, std::string_view name) { return find_register(block, name)->address; }
// From the table once: these never move.
struct Places {
    std::uint16_t boot_id = at(BlockId::ident, "boot_id"), state = at(BlockId::status, "state"),
                  newest = at(BlockId::status, "last_sequence"), seen = at(BlockId::counters, "seen"),
                  token = at(BlockId::command, "token"), beat = at(BlockId::plc, "heartbeat"),
                  staged = at(BlockId::recipe, "staged_number");
};
const Places& places() {
    static const Places all;
    return all;
}

std::uint32_t double_word(const std::vector<std::uint16_t>& words, std::size_t k) {
    return std::uint32_t{words[k]} << 16U | words[k + 1];
}
std::uint16_t high(std::uint32_t value) { return static_cast<std::uint16_t>(value >> 16U); }
std::uint16_t low(std::uint32_t value) { return static_cast<std::uint16_t>(value); }

// The first command of a shortest way from one state to another; none when it is there, or no command leads on.
std::optional<Command> first_command(State from, State to) {
    if (from == to) return std::nullopt;
    struct Reached {
        State state;
        Command first;
    };
    std::vector<Reached> reached;
    const auto go_on = [&](State at, std::optional<Command> first) {
        for (const Transition& t : kTransitions) {
            const Command* command = std::get_if<Command>(&t.cause);
            const bool known = t.to == from ||
                std::any_of(reached.begin(), reached.end(), [&](const Reached& r) { return r.state == t.to; });
            if (t.from == at && command != nullptr && !known) reached.push_back({t.to, first.value_or(*command)});
        }
    };
    go_on(from, std::nullopt);
    for (std::size_t k = 0; k < reached.size(); ++k) {
        if (reached[k].state == to) return reached[k].first;
        const Reached next = reached[k];
        go_on(next.state, next.first);
    }
    return std::nullopt;
}

}  // namespace

// -- the station's half

PlcEndpoint::PlcEndpoint(hal::EventLoop& loop, const CoreConfig& config, std::uint32_t boot_id)
    : handler_(loop), desk_(loop, handler_, PlcOptions{config.plc_policy, PlcSimulator::kTimeout, boot_id}),
      registers_(StationIdentity{.boot_id = boot_id}, &desk_) {}

void PlcEndpoint::open(Station& station, Inspector& inspector, ResultSink& recorder) {
    station_ = &station;
    handler_.operations.begin({.station = station,
                               .inspector = inspector,
                               .plc_interface = desk_,
                               .recorder = &recorder,
                               .publish = [this] { publish(); }},
                              {});
}

void PlcEndpoint::publish() {
    registers_.publish(station_->snapshot(), unpublished_);
    unpublished_.clear();
}

CommandOutcome PlcEndpoint::Counting::on_command(const modbus::Origin& origin, const CommandRequest& request) {
    count(request.token);
    return operations.on_command(origin, request);
}
CommandOutcome PlcEndpoint::Counting::on_recipe(const modbus::Origin& origin, const CommandRequest& request,
                                                const StagedRecipe& staged) {
    count(request.token);
    return operations.on_recipe(origin, request, staged);
}
int PlcEndpoint::Counting::executed(std::uint32_t token) const {
    return static_cast<int>(std::count(tokens_.begin(), tokens_.end(), token));
}

// -- the PLC's

PlcSimulator::Words PlcSimulator::read(std::uint16_t address, std::uint16_t count) {
    Words words(count);
    if (doors_ == nullptr || doors_->registers().read_registers(address, words) != modbus::Exception::none)
        words.clear();
    return words;
}

modbus::Exception PlcSimulator::write(std::uint16_t address, const Words& words) {
    return doors_ == nullptr ? modbus::Exception::busy : doors_->registers().write_registers(kPlc, address, words);
}

void PlcSimulator::cycle() {
    if (doors_ == nullptr) return;
    doors_->check_plc_heartbeat();
    doors_->publish();
    if (loop_.now() < silent_until_) return;
    const Words ident = read(places().boot_id, 2);
    if (const std::uint32_t boot = double_word(ident, 0); boot != boot_id_) {
        boot_id_ = boot;
        read_ = asked_ = taken_ = 0;
    }
    if (write(places().beat, {++beat_}) != modbus::Exception::none)
        invariants_.broken(Promise::one_story, "a heartbeat was refused");
    check_status();
    books_.check(doors_->station().snapshot());
    check_results();
    if (loop_.now() < restless_until_) return try_anything();
    if (loop_.now() >= leave_alone_until_) bring_back();
}

void PlcSimulator::check_status() {
    const Snapshot now = doors_->station().snapshot();
    const Words status = read(places().state, 2), counters = read(places().seen, 20);
    const bool executes = executing(now.state);
    const unsigned bits = (executes ? 1U : 0U) | (now.run_permit ? 2U : 0U) | (now.line_stop ? 4U : 0U);
    if (status[0] != static_cast<std::uint16_t>(now.state) || (status[1] & 7U) != bits) {
        invariants_.broken(Promise::one_story, "the registers show another state than the station is in");
    }
    const Counters& c = now.counters;
    const std::array told{
        c.seen,          c.inspected,  c.pass, c.reject, c.unfit, c.missed, c.reject_commanded, c.reject_confirmed,
        c.reject_failed, c.reject_late};
    for (std::size_t k = 0; k < told.size(); ++k) {
        if (double_word(counters, 2 * k) != told[k])
            return invariants_.broken(Promise::one_story, "the registers show other counters than the station's");
    }
}

void PlcSimulator::check_results() {
    const std::uint32_t newest = double_word(read(places().newest, 2), 0);
    if (newest > read_ + kRingSlots) read_ = newest - kRingSlots;
    for (std::uint32_t sequence = read_ + 1; sequence <= newest; ++sequence) {
        const Words slot = read(address_of_result(sequence), kResultWords);
        const PartResult& r = told_[sequence % told_.size()];
        const bool same = r.sequence == sequence && double_word(slot, 0) == sequence &&
            double_word(slot, 22) == sequence && double_word(slot, 2) == r.part &&
            double_word(slot, 4) == r.arrived_ns / 1'000'000'000 &&
            double_word(slot, 6) == r.arrived_ns / 1000 % 1'000'000 &&
            slot[8] == static_cast<std::uint16_t>(r.verdict) && slot[9] == static_cast<std::uint16_t>(r.reason) &&
            slot[17] == static_cast<std::uint16_t>(r.reject) && double_word(slot, 13) == r.latency_us;
        if (!same)
            invariants_.broken(Promise::one_story, "the registers show another result than the station reported",
                               r.part);
    }
    read_ = std::max(read_, newest);
    if (asked_ <= taken_) asked_ = read_;  // what was refused is asked for again first
    if (asked_ == taken_) return;
    switch (write(static_cast<std::uint16_t>(places().beat + 1), {high(asked_), low(asked_)})) {
        case modbus::Exception::none: taken_ = asked_; return;
        case modbus::Exception::busy:                    // not on the disk yet,
        case modbus::Exception::device_failure: return;  // or it cannot be: the books know whether that is so
        default: invariants_.broken(Promise::one_story, "an acknowledgement of what can be read was refused");
    }
}

// What a PLC does with a station that somebody has stopped.
void PlcSimulator::bring_back() {
    const Snapshot now = doors_->station().snapshot();
    switch (now.state) {
        case State::preoperational: return command(Command::initialise);
        case State::halted:
            if (now.line_stop) take_parts_off_();
            return command(Command::reset);
        case State::initialized:  // arm is refused while a device is down; reset looks for it again
            return command(doors_->station().core().all_devices_up() ? Command::arm : Command::reset);
        case State::ready: return command(Command::start_continuous);
        case State::error:  // a person's business
        case State::single_execution:
        case State::continuous_execution: return;
    }
}

void PlcSimulator::command(Command code, bool meant_for_this_boot) {
    if (doors_ == nullptr || boot_id_ == 0) return;  // it has not asked yet whom it speaks to
    const bool to_this_boot = meant_for_this_boot && double_word(read(places().boot_id, 2), 0) == boot_id_;
    const std::uint32_t token = ++token_;
    const std::uint32_t other_boot = double_word(read(places().boot_id, 2), 0) ^ 0x5A5AU;  // whichever it remembers
    const std::uint16_t boot = low(meant_for_this_boot ? boot_id_ : other_boot);
    const Words words{high(token), low(token), boot, static_cast<std::uint16_t>(code)};
    for (int copies = 1 + std::exchange(repeats_, 0); copies > 0; --copies) {
        PlcEndpoint* before = doors_;
        if (before == nullptr) return;
        books_.command_comes();
        const auto answer = write(places().token, words);
        if (doors_ != before) return;  // the process died of it
        const int executed = doors_->executed(token),
                  wanted = answer == modbus::Exception::none && to_this_boot ? 1 : 0;
        if (executed != wanted) {
            invariants_.broken(
                Promise::commands_once,
                "a command was carried out " + std::to_string(executed) + " times, not " + std::to_string(wanted));
        }
    }
}

// -- misbehaviour

// Any registers but a whole command and the PLC's own; half a command, too.
void PlcSimulator::write_nonsense() {
    for (int k = 0; k < 5; ++k) {
        Words words(1 + draw() % 20);
        for (auto& word : words) word = static_cast<std::uint16_t>(draw());
        auto address = static_cast<std::uint16_t>(draw() % 9000);
        if (k == 0) address = static_cast<std::uint16_t>(places().token + 1 + draw() % 10);
        if (k == 1) address = static_cast<std::uint16_t>(places().staged + draw() % 8);
        if (k > 1 && address + words.size() > places().token && address < places().staged) address = 0;
        (void)write(address, words);
    }
    command(Command::start_continuous, false);  // meant for the boot before
    command(static_cast<Command>(100 + draw() % 1000));
}

void PlcSimulator::read_everything() {
    for (int k = 0; k < 20; ++k)
        (void)read(static_cast<std::uint16_t>(draw() % 9000), static_cast<std::uint16_t>(1 + draw() % kMaxRead));
}

// The answer is lost, and lost again: the same command comes four times.
void PlcSimulator::repeat_a_command() {
    repeats_ = 3;
    command(Command::start_continuous);
}

// Any command, in any state; half a second later it sees what it has done.
void PlcSimulator::command_something() {
    leave_alone_until_ = loop_.now() + milliseconds(500);
    try_anything();
}

void PlcSimulator::try_anything() { command_with_care(static_cast<Command>(1 + draw() % 9)); }

// Who resets after line stop takes the parts off first.
void PlcSimulator::command_with_care(Command code) {
    if (code == Command::reset && doors_ != nullptr && doors_->station().snapshot().line_stop) take_parts_off_();
    command(code);
}

// To any state that commands lead to. There it waits, or is silent for longer than the station bears, or cannot keep
// its fingers still.
void PlcSimulator::walk(Duration amount) {
    constexpr std::array kTargets{State::preoperational, State::halted, State::initialized, State::ready,
                                  State::single_execution};
    const State target = kTargets[draw() % kTargets.size()];
    const std::uint64_t mood = draw() % 3;
    leave_alone_until_ = loop_.now() + amount;
    for (int k = 0; k < 6 && doors_ != nullptr; ++k) {
        const auto next = first_command(doors_->station().core().state(), target);
        if (!next) break;
        command_with_care(*next);
    }
    if (mood == 1) be_silent(amount);
    if (mood == 2) restless_until_ = leave_alone_until_;
}

}  // namespace hord::lab
