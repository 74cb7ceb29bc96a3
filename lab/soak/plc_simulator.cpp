#include "lab/soak/plc_simulator.h"

#include <algorithm>

#include "hal_sim/world/random.h"

namespace hord::lab {
namespace {

constexpr modbus::Origin kPlc{"192.0.2.7:50123"};

std::uint16_t at(BlockId block, std::string_view name) { return find_register(block, name)->address; }
// Looked up in the register table once.
struct Addresses {
    std::uint16_t boot_id = at(BlockId::ident, "boot_id"), state = at(BlockId::status, "state"),
                  newest = at(BlockId::status, "last_sequence"), seen = at(BlockId::counters, "seen"),
                  heartbeat = at(BlockId::status, "heartbeat"), token = at(BlockId::command, "token"),
                  beat = at(BlockId::plc, "heartbeat"), staged = at(BlockId::recipe, "staged_number");
};
const Addresses& addresses() {
    static const Addresses all;
    return all;
}

std::uint32_t double_word(const std::vector<std::uint16_t>& words, std::size_t k) {
    return std::uint32_t{words[k]} << 16U | words[k + 1];
}
std::uint16_t high(std::uint32_t value) { return static_cast<std::uint16_t>(value >> 16U); }
std::uint16_t low(std::uint32_t value) { return static_cast<std::uint16_t>(value); }

// The first command on a shortest path from one state to another; none if it is there already, or there is no path.
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

// -- the station's side

PlcEndpoint::PlcEndpoint(hal::EventLoop& loop, const CoreConfig& config, std::uint32_t boot_id)
    : plc_(loop, handler_, PlcOptions{config.plc_policy, PlcSimulator::kTimeout, boot_id}),
      registers_(StationIdentity{.boot_id = boot_id}, &plc_) {}

void PlcEndpoint::open(Station& station, Inspector& inspector, ResultSink& recorder) {
    station_ = &station;
    handler_.commands.begin({.station = station,
                             .inspector = inspector,
                             .plc_interface = plc_,
                             .extents = {61, 61, 9, 9},  // only named where a commit is refused
                             .recorder = &recorder,
                             .publish = [this] { publish(); }},
                            {});
}

void PlcEndpoint::publish() {
    registers_.publish(station_->snapshot(), unpublished_);
    unpublished_.clear();
}

CommandOutcome PlcEndpoint::CountingHandler::on_command(const modbus::Origin& origin, const CommandRequest& request) {
    tokens_[next_++ % tokens_.size()] = request.token;
    return commands.on_command(origin, request);
}
int PlcEndpoint::CountingHandler::executed(std::uint32_t token) const {
    return static_cast<int>(std::count(tokens_.begin(), tokens_.end(), token));
}

// -- the PLC

PlcSimulator::Words PlcSimulator::read(std::uint16_t address, std::uint16_t count) {
    Words words(count);
    if (endpoint_ == nullptr || endpoint_->registers().read_registers(address, words) != modbus::Exception::none)
        words.clear();
    return words;
}

modbus::Exception PlcSimulator::write(std::uint16_t address, const Words& words) {
    return endpoint_ == nullptr ? modbus::Exception::busy
                                : endpoint_->registers().write_registers(kPlc, address, words);
}

void PlcSimulator::cycle() {
    if (endpoint_ == nullptr) return;
    endpoint_->check_plc_heartbeat();
    endpoint_->publish();
    if (loop_.now() < silent_until_) return;
    const Words ident = read(addresses().boot_id, 2);
    if (const std::uint32_t boot = double_word(ident, 0); boot != boot_id_) {
        boot_id_ = boot;
        read_ = to_acknowledge_ = acknowledged_ = 0;
    }
    if (write(addresses().beat, {++beat_}) != modbus::Exception::none)
        invariants_.broken(Promise::one_story, "a heartbeat was refused");
    check_status();
    store_observer_.check(endpoint_->station().snapshot());
    check_results();
    if (loop_.now() < restless_until_) return send_random_command();
    if (loop_.now() >= idle_until_) recover_station();
}

void PlcSimulator::check_status() {
    const Snapshot now = endpoint_->station().snapshot();
    const Words status = read(addresses().state, 2), counters = read(addresses().seen, 20);
    const bool executes = executing(now.state);
    const unsigned bits = (executes ? 1U : 0U) | (now.run_permit ? 2U : 0U) | (now.line_stop ? 4U : 0U);
    if (status[0] != static_cast<std::uint16_t>(now.state) || (status[1] & 7U) != bits) {
        invariants_.broken(Promise::one_story, "the registers show another state than the station is in");
    }
    invariants_.faults_shown(now.first_fault, now.faults_latched);
    if (const std::uint16_t beat = read(addresses().heartbeat, 1)[0];
        beat != station_beat_ || station_beat_at_ == TimePoint{}) {
        station_beat_ = beat;
        station_beat_at_ = loop_.now();
    } else if (loop_.now() - station_beat_at_ > kMaxBeat) {
        invariants_.broken(Promise::one_story, "the station's heartbeat stands");
    }
    const Counters& c = now.counters;
    const std::array expected{
        c.seen,          c.inspected,  c.pass, c.reject, c.unfit, c.missed, c.reject_commanded, c.reject_confirmed,
        c.reject_failed, c.reject_late};
    for (std::size_t k = 0; k < expected.size(); ++k) {
        if (double_word(counters, 2 * k) != expected[k])
            return invariants_.broken(Promise::one_story, "the registers show other counters than the station's");
    }
}

void PlcSimulator::check_results() {
    const std::uint32_t newest = double_word(read(addresses().newest, 2), 0);
    if (newest > read_ + kRingSlots) read_ = newest - kRingSlots;
    for (std::uint32_t sequence = read_ + 1; sequence <= newest; ++sequence) {
        const Words slot = read(address_of_result(sequence), kResultWords);
        const PartResult& r = expected_results_[sequence % expected_results_.size()];
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
    if (to_acknowledge_ <= acknowledged_) to_acknowledge_ = read_;  // a refused acknowledgement is repeated first
    if (to_acknowledge_ == acknowledged_) return;
    switch (write(static_cast<std::uint16_t>(addresses().beat + 1), {high(to_acknowledge_), low(to_acknowledge_)})) {
        case modbus::Exception::none: acknowledged_ = to_acknowledge_; return;
        case modbus::Exception::busy:                    // not on the disk yet,
        case modbus::Exception::device_failure: return;  // or the disk fails; StoreObserver checks whether it does
        default: invariants_.broken(Promise::one_story, "an acknowledgement of what can be read was refused");
    }
}

// The commands that start a stopped station again.
void PlcSimulator::recover_station() {
    const Snapshot now = endpoint_->station().snapshot();
    switch (now.state) {
        case State::preoperational: return command(Command::initialise);
        case State::halted:
            if (now.line_stop) take_parts_off_();
            return command(Command::reset);
        case State::initialized:  // arm is refused while a device is down; reset looks for it again
            return command(endpoint_->station().core().all_devices_up() ? Command::arm : Command::reset);
        case State::ready: return command(Command::start_continuous);
        case State::error:  // a person resets it
        case State::single_execution:
        case State::continuous_execution: return;
    }
}

void PlcSimulator::command(Command code, bool meant_for_this_boot) {
    if (endpoint_ == nullptr || boot_id_ == 0) return;  // the boot id is not known yet
    const bool acts_always = code == Command::stop || code == Command::abort || code == Command::halt;
    const bool to_this_boot =
        acts_always || (meant_for_this_boot && double_word(read(addresses().boot_id, 2), 0) == boot_id_);
    const std::uint32_t token = ++token_;
    const std::uint32_t other_boot = double_word(read(addresses().boot_id, 2), 0) ^ 0x5A5AU;
    const std::uint16_t boot = low(meant_for_this_boot ? boot_id_ : other_boot);
    const Words words{high(token), low(token), boot, static_cast<std::uint16_t>(code)};
    const int copies = 1 + std::exchange(repeats_, 0);
    for (int copy = 1; copy <= copies; ++copy) {
        PlcEndpoint* before = endpoint_;
        if (before == nullptr) return;
        store_observer_.before_command();
        const std::uint64_t told = store_observer_.commands_told();
        const int executed_before = before->executed(token);
        const auto answer = write(addresses().token, words);
        if (endpoint_ != before) return;  // the process died during the command
        const int once = answer == modbus::Exception::none && to_this_boot ? 1 : 0;
        const int executed = endpoint_->executed(token), wanted = acts_always ? copy : once;
        if (executed != wanted) {
            invariants_.broken(
                Promise::commands_once,
                "a command was carried out " + std::to_string(executed) + " times, not " + std::to_string(wanted));
        }
        if (store_observer_.commands_told() - told != static_cast<std::uint64_t>(executed - executed_before))
            invariants_.broken(Promise::one_story, "a command was carried out, and the recorder was not told once");
    }
}

// -- misbehaviour

// Random words to random registers, also parts of a command, but never to a whole command or the PLC's own registers.
void PlcSimulator::write_nonsense() {
    for (int k = 0; k < 5; ++k) {
        Words words(1 + draw() % 20);
        for (auto& word : words) word = static_cast<std::uint16_t>(draw());
        auto address = static_cast<std::uint16_t>(draw() % 9000);
        if (k == 0) address = static_cast<std::uint16_t>(addresses().token + 1 + draw() % 10);
        if (k == 1) address = static_cast<std::uint16_t>(addresses().staged + draw() % 8);
        if (k > 1 && address + words.size() > addresses().token && address < addresses().staged) address = 0;
        (void)write(address, words);
    }
    command(Command::start_continuous, false);  // with the id of an earlier boot
    command(static_cast<Command>(100 + draw() % 1000));
}

void PlcSimulator::read_everything() {
    for (int k = 0; k < 20; ++k)
        (void)read(static_cast<std::uint16_t>(draw() % 9000), static_cast<std::uint16_t>(1 + draw() % kMaxRead));
}

// Sends the same command four times, as after three lost answers.
void PlcSimulator::repeat_a_command() {
    repeats_ = 3;
    command(Command::start_continuous);
}

// A random command in any state. The PLC recovers the station half a second later at the earliest.
void PlcSimulator::misuse_commands() {
    leave_alone(milliseconds(500));
    send_random_command();
}

void PlcSimulator::send_random_command() { command_with_care(static_cast<Command>(1 + draw() % 9)); }

void PlcSimulator::command_with_care(Command code) {
    if (code == Command::reset && endpoint_ != nullptr && endpoint_->station().snapshot().line_stop) take_parts_off_();
    command(code);
}

// Commands the station to a random state. There the PLC waits, or stays silent beyond its timeout, or sends random
// commands.
void PlcSimulator::walk_states(Duration amount) {
    constexpr std::array kTargets{State::preoperational, State::halted, State::initialized, State::ready,
                                  State::single_execution};
    const State target = kTargets[draw() % kTargets.size()];
    const std::uint64_t behaviour = draw() % 3;
    leave_alone(amount);
    for (int k = 0; k < 6 && endpoint_ != nullptr; ++k) {
        const auto next = first_command(endpoint_->station().core().state(), target);
        if (!next) break;
        command_with_care(*next);
    }
    if (behaviour == 1) be_silent(amount);
    if (behaviour == 2) restless_until_ = idle_until_;
}

}  // namespace hord::lab
