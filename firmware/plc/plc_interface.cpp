#include "firmware/plc/plc_interface.h"

#include <algorithm>
#include <string>
#include <utility>

#include "firmware/core/states.h"
#include "firmware/registers/register_map.h"

namespace hord::firmware {
namespace {

using modbus::Exception;

std::uint32_t double_word(std::span<const std::uint16_t> words) { return std::uint32_t{words[0]} << 16U | words[1]; }

// The address of a row, from the table.
std::uint16_t address_of(BlockId id, std::string_view name) { return find_register(id, name)->address; }

bool means_not_available(const Register& row, std::span<const std::uint16_t> words) {
    switch (row.type) {
        case RegisterType::u16: return words[0] == 0xFFFF;
        case RegisterType::s16: return words[0] == 0x8000;
        case RegisterType::u32: return double_word(words) == 0xFFFFFFFF;
        case RegisterType::s32: return double_word(words) == 0x80000000;
        case RegisterType::bits16:
        case RegisterType::bits32:
        case RegisterType::text: break;
    }
    return false;
}

// Checks that the values are whole writable rows of the block and that no value is a sentinel, but in nullable rows.
Exception check_rows(const Block& block, std::uint16_t address, std::span<const std::uint16_t> values) {
    std::size_t covered = 0;
    for (const Register& row : block.registers) {
        const int begin = std::max<int>(row.address, address);
        const int end = std::min<int>(row.address + row.words, address + static_cast<int>(values.size()));
        if (begin >= end) continue;
        if (row.access != RegisterAccess::read_write) return Exception::illegal_address;
        if (end - begin != row.words) return Exception::illegal_value;
        if (!row.nullable &&
            means_not_available(row, values.subspan(static_cast<std::size_t>(row.address - address), row.words))) {
            return Exception::illegal_value;
        }
        covered += row.words;
    }
    return covered == values.size() ? Exception::none : Exception::illegal_address;
}

// Registers as text: two printable ASCII characters each, zeros behind the last. Other bytes: empty, because the text
// goes into records.
std::optional<std::string> printable_text(std::span<const std::uint16_t> words) {
    std::string text;
    bool ended = false;
    for (const std::uint16_t word : words) {
        for (const unsigned c : {unsigned{word} >> 8U, unsigned{word} & 0xFFU}) {
            ended = ended || c == 0;
            if (c == 0) continue;
            if (ended || c < 0x20 || c > 0x7E) return std::nullopt;
            text += static_cast<char>(c);
        }
    }
    return text;
}

bool may_interrupt(std::uint16_t code) {
    const auto command = static_cast<Command>(code);
    return command == Command::stop || command == Command::abort || command == Command::halt;
}

// The commands of which an argument that is left out does not mean 0.
bool needs_argument(std::uint16_t code) {
    const auto command = static_cast<Command>(code);
    return command == Command::use_recipe || command == Command::commit_recipe;
}

// A teach needs parts, and parts need other commands to start the station.
bool goes_on_beside_others(std::uint16_t code) { return static_cast<Command>(code) == Command::teach; }

}  // namespace

PlcInterface::PlcInterface(const hal::Clock& clock, PlcHandler& handler, PlcOptions options)
    : clock_(clock), handler_(handler), options_(options) {
    clients_.reserve(kMaxClients);
}

Exception PlcInterface::write(const modbus::Origin& origin, const StationNow& now, std::uint16_t address,
                              std::span<const std::uint16_t> values) {
    for (const BlockId id : {BlockId::command, BlockId::plc, BlockId::recipe}) {
        const Block& block = *find_block(id);
        if (address < block.base || address >= block.base + block.size()) continue;
        if (const auto wrong = check_rows(block, address, values); wrong != Exception::none) return wrong;
        switch (id) {
            case BlockId::command:
                if (address != address_of(id, "token")) return Exception::illegal_value;
                return write_command(origin, now, values);
            case BlockId::plc: return write_plc(origin, now, address, values);
            default:
                std::copy(values.begin(), values.end(),
                          staged_words_.begin() + (address - address_of(id, "staged_number")));
                return Exception::none;
        }
    }
    return Exception::illegal_address;
}

// -- commands

void PlcInterface::Remembered::set(const CommandOutcome& outcome, hal::TimePoint now) {
    reply.state = outcome.state;
    reply.error = outcome.error;
    reply.result = outcome.result;
    reply.remarks = outcome.remarks;
    replied_at = now;
}

// A client that reconnects has another port.
PlcInterface::Client& PlcInterface::client_at(std::string_view peer) {
    const std::string_view address = peer.substr(0, peer.rfind(':'));
    const auto known =
        std::find_if(clients_.begin(), clients_.end(), [&](const Client& c) { return c.address == address; });
    if (known != clients_.end()) return *known;
    if (clients_.size() == kMaxClients) return clients_.back();
    return clients_.emplace_back(Client{std::string(address), {}});
}

const PlcInterface::Remembered* PlcInterface::kept_reply(const Client& client, const CommandRequest& request) const {
    const auto found = std::find_if(memory_.begin(), memory_.end(),
                                    [&](const Remembered& r) { return r.client == &client && r.request == request; });
    if (found == memory_.end()) return nullptr;
    return found->executing() || clock_.now() - found->replied_at <= kReplyKept ? &*found : nullptr;
}

PlcInterface::Remembered& PlcInterface::remember(Client& client, const CommandRequest& request) {
    client.used.insert(request.token);
    while (memory_[next_].executing()) next_ = (next_ + 1) % memory_.size();
    Remembered& mine = memory_[next_];
    next_ = (next_ + 1) % memory_.size();
    mine = {.client = &client,
            .request = request,
            .reply = {.token = request.token, .code = request.code, .state = CommandState::executing}};
    return mine;
}

Exception PlcInterface::write_command(const modbus::Origin& origin, const StationNow& now,
                                      std::span<const std::uint16_t> values) {
    if (values.size() < 4) return Exception::illegal_value;  // token, boot, code
    CommandRequest request{.token = double_word(values), .boot = values[2], .code = values[3]};
    const bool has_argument = values.size() >= 6;
    if (has_argument) request.argument = double_word(values.subspan(4));
    if (values.size() >= 8) request.argument2 = double_word(values.subspan(6));
    if (values.size() > 8) {
        const auto who = printable_text(values.subspan(8));
        if (!who) return Exception::illegal_value;
        request.who = ShortText(*who);
    }
    if (request.token == 0) return Exception::illegal_value;

    Client& client = client_at(origin.peer);
    if (may_interrupt(request.code)) {
        const CommandOutcome outcome = handler_.on_command(origin, request);
        const Remembered* before = kept_reply(client, request);
        if (before != nullptr && outcome.error == CommandError::not_in_this_state) {
            shown_ = *before;  // a repeat, and nothing was left to stop
            return Exception::none;
        }
        ++commands_done_;
        Remembered& mine = remember(client, request);
        mine.set(outcome, clock_.now());
        shown_ = mine;
        return Exception::none;
    }
    if (const Remembered* before = kept_reply(client, request)) {
        shown_ = *before;
        return Exception::none;
    }
    if (client.used.contains(request.token)) {
        shown_ = {.client = &client,
                  .request = request,
                  .reply = {.token = request.token,
                            .code = request.code,
                            .state = CommandState::failed,
                            .error = CommandError::token_reused}};
        return Exception::none;
    }
    const auto must_be_alone = [&](const Remembered& r) {
        return r.executing() && !goes_on_beside_others(r.request.code);
    };
    if (std::any_of(memory_.begin(), memory_.end(), must_be_alone)) return Exception::busy;

    // Remembered before it is executed, so that a reentrant write of this token does nothing.
    Remembered& mine = remember(client, request);
    mine.set(execute(origin, now, request, has_argument), clock_.now());
    shown_ = mine;
    return Exception::none;
}

CommandOutcome PlcInterface::execute(const modbus::Origin& origin, const StationNow& now, const CommandRequest& request,
                                     bool has_argument) {
    const auto refuse = [](CommandError error) { return CommandOutcome{CommandState::failed, error, 0}; };
    if (request.boot != 0 && request.boot != (options_.boot_id & 0xFFFFU)) return refuse(CommandError::other_boot);
    if (!has_argument && needs_argument(request.code)) {
        CommandOutcome outcome = refuse(CommandError::bad_argument);
        outcome.remarks = RemarkText(std::string_view("argument (8006) was left out: write it with the code"));
        return outcome;
    }
    if (static_cast<Command>(request.code) == Command::commit_recipe) {
        if (executing(now.state)) return refuse(CommandError::not_in_this_state);
        if (request.argument2 != 0) {  // a checksum in the wrong place, perhaps
            CommandOutcome outcome = refuse(CommandError::bad_argument);
            outcome.remarks = RemarkText(std::string_view("argument2 (8008): commit_recipe takes none: write 0"));
            return outcome;
        }
        if (request.argument != crc32_of(staged_words_)) return refuse(CommandError::wrong_checksum);
    }
    ++commands_done_;
    return handler_.on_command(origin, request);
}

void PlcInterface::finish(const CommandRequest& request, const CommandOutcome& outcome) {
    for (Remembered& mine : memory_) {
        if (!mine.executing() || mine.request != request) continue;
        const bool shown = shown_.client == mine.client && shown_.request == request;
        mine.set(outcome, clock_.now());
        if (shown) shown_ = mine;
    }
}

// -- heartbeat and results

Exception PlcInterface::write_plc(const modbus::Origin& origin, const StationNow& now, std::uint16_t address,
                                  std::span<const std::uint16_t> values) {
    const std::uint16_t beat_at = address_of(BlockId::plc, "heartbeat"),
                        taken_at = address_of(BlockId::plc, "acknowledged");
    const bool beats = address == beat_at;
    const bool takes = address + values.size() > taken_at;
    const std::uint32_t taken = takes ? double_word(values.subspan(taken_at - address)) : 0;
    if (takes && (taken < acknowledged_ || taken > now.newest_sequence)) return Exception::illegal_value;

    if (beats && (!heartbeat_at_ || values[0] != heartbeat_)) {
        heartbeat_ = values[0];
        heartbeat_at_ = clock_.now();
        if (std::exchange(lost_, false)) handler_.on_plc_back();
    }
    if (takes) {
        if (!std::exchange(acknowledges_, true)) {  // results overwritten before the first acknowledgement do not count
            counted_until_ = now.newest_sequence > kRingSlots ? now.newest_sequence - kRingSlots : 0;
        }
        if (taken == acknowledged_) return Exception::none;
        if (const auto refused = handler_.on_acknowledged(origin, taken); refused != Exception::none) return refused;
        acknowledged_ = taken;
    }
    return Exception::none;
}

void PlcInterface::note_results(std::uint32_t newest_sequence) {
    if (!acknowledges_ || newest_sequence <= kRingSlots) return;
    const std::uint32_t gone = newest_sequence - kRingSlots;
    const std::uint32_t known = std::max(acknowledged_, counted_until_);
    if (gone <= known) return;
    overruns_ += gone - known;
    counted_until_ = gone;
}

void PlcInterface::check_plc_heartbeat() {
    if (!heartbeat_at_ || lost_ || clock_.now() - *heartbeat_at_ <= options_.timeout) return;
    lost_ = true;
    handler_.on_plc_lost(options_.policy);
}

// -- view

PlcView PlcInterface::view() const {
    const auto ms = [](hal::Duration d) { return std::chrono::duration_cast<std::chrono::milliseconds>(d).count(); };
    PlcView view{.command = shown_.request,
                 .reply = shown_.reply,
                 .commands_done = commands_done_,
                 .plc_heartbeat = heartbeat_,
                 .plc_heartbeat_age_ms = {},
                 .lost = lost_,
                 .policy = options_.policy,
                 .timeout_ms = static_cast<std::uint16_t>(std::min<std::int64_t>(ms(options_.timeout), 0xFFFE)),
                 .acknowledged = acknowledged_,
                 .overruns = overruns_,
                 .staged = std::bit_cast<StagedRecipe>(staged_words_),
                 .staged_crc32 = crc32_of(staged_words_)};
    if (heartbeat_at_) {
        view.plc_heartbeat_age_ms =
            static_cast<std::uint32_t>(std::min<std::int64_t>(ms(clock_.now() - *heartbeat_at_), 0xFFFFFFFE));
    }
    return view;
}

}  // namespace hord::firmware
