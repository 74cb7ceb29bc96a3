#include "firmware/registers/register_client.h"

#include <algorithm>
#include <array>
#include <cerrno>
#include <charconv>
#include <random>
#include <thread>
#include <utility>

#include <fmt/format.h>
#include <modbus/modbus.h>

#include "common/tcp_listener.h"
#include "firmware/core/states.h"

namespace hord::firmware::modbus {
namespace {

constexpr auto kAskAgainAfter = std::chrono::milliseconds(20);
constexpr std::size_t kMaxBlocks = 64;  // a longer chain has a loop

}  // namespace

Result<Endpoint> parse_endpoint(std::string_view text) {
    const auto wrong = [&] {
        return fail(ErrorCode::invalid_argument, fmt::format("\"{}\" is not a Modbus address", text),
                    "write HOST:PORT, for example 127.0.0.1:502");
    };
    Endpoint endpoint;
    const std::size_t from = text.starts_with('[') ? 1 : 0;
    const auto end = text.find(from == 1 ? ']' : ':');
    if (from == 1 && end == std::string_view::npos) return wrong();
    endpoint.host = text.substr(from, end - from);
    if (endpoint.host.empty()) return wrong();
    const std::string_view port = end == std::string_view::npos ? "" : text.substr(end + from);
    if (port.empty()) return endpoint;
    const auto [rest, error] = std::from_chars(port.data() + 1, port.data() + port.size(), endpoint.port);
    if (port[0] != ':' || error != std::errc{} || rest != port.data() + port.size() || endpoint.port == 0)
        return wrong();
    return endpoint;
}

void Client::FreeContext::operator()(modbus_t* context) const {
    modbus_close(context);
    modbus_free(context);
}

std::string Client::where() const { return fmt::format("Modbus station {}:{}", endpoint_.host, endpoint_.port); }

Result<void> Client::ensure_connected() {
    if (context_) return {};
    std::unique_ptr<modbus_t, FreeContext> fresh(
        modbus_new_tcp_pi(endpoint_.host.c_str(), std::to_string(endpoint_.port).c_str()));
    if (!fresh) return fail(ErrorCode::invalid_argument, where() + ": not an address", "write HOST:PORT");
    const auto seconds = static_cast<std::uint32_t>(timeout_.count() / 1000);
    const auto micros = static_cast<std::uint32_t>(timeout_.count() % 1000 * 1000);
    modbus_set_response_timeout(fresh.get(), seconds, micros);
    modbus_set_byte_timeout(fresh.get(), seconds, micros);
    errno = 0;
    if (modbus_connect(fresh.get()) != 0) {
        const int error = errno;  // of a name that cannot be resolved libmodbus makes ECONNREFUSED
        if (const std::string unknown = common::resolve_problem(endpoint_.host); !unknown.empty())
            return fail(ErrorCode::disconnected, fmt::format("{} cannot be reached: {}", where(), unknown),
                        "check the name, or give the address");
        if (error == ETIMEDOUT || error == EINPROGRESS) {
            return fail(ErrorCode::timeout, fmt::format("{} does not answer within {} ms", where(), timeout_.count()),
                        "check the address, the cable and the firewall");
        }
        return fail(ErrorCode::disconnected, fmt::format("{} cannot be reached: {}", where(), modbus_strerror(error)),
                    "check the address, and that the station runs");
    }
    context_ = std::move(fresh);
    return {};
}

tl::unexpected<Error> Client::failed(const std::string& doing) {
    const int error = errno;
    if (error > MODBUS_ENOBASE && error < EMBBADCRC) {
        const char* cure = error == EMBXSBUSY ? "it is executing a command: try again in a moment"
            : error == EMBXILFUN              ? "who may write is listed in the station's modbus.may_write"
                                              : "compare the addresses with `hordctl registers`";
        return fail(error == EMBXSBUSY ? ErrorCode::busy : ErrorCode::refused,
                    fmt::format("{} refuses {}: exception {:02} ({})", where(), doing, error - MODBUS_ENOBASE,
                                modbus_strerror(error)),
                    cure);
    }
    context_.reset();
    places_.clear();
    if (error == ETIMEDOUT) {
        return fail(ErrorCode::timeout,
                    fmt::format("{} did not answer {} within {} ms", where(), doing, timeout_.count()),
                    "check that the station runs and the network is not overloaded");
    }
    return fail(ErrorCode::disconnected,
                fmt::format("{}: connection lost during {}: {}", where(), doing, modbus_strerror(error)),
                "check that the station runs");
}

Result<Client> Client::connect(Endpoint endpoint, std::chrono::milliseconds timeout) {
    Client client(std::move(endpoint), timeout);
    if (auto done = client.ensure_connected(); !done) return tl::unexpected(done.error());
    return client;
}

Result<std::vector<std::uint16_t>> Client::read(std::uint16_t address, std::size_t count) {
    if (count == 0 || count > MODBUS_MAX_READ_REGISTERS) {
        return fail(ErrorCode::invalid_argument, fmt::format("{} registers cannot be read in one request", count),
                    "read 1 to 125");
    }
    if (auto done = ensure_connected(); !done) return tl::unexpected(done.error());
    std::vector<std::uint16_t> words(count);
    const int done = modbus_read_registers(context_.get(), address, static_cast<int>(count), words.data());
    if (done != static_cast<int>(count)) return failed(fmt::format("reading {} registers at {}", count, address));
    return words;
}

Result<void> Client::write(std::uint16_t address, std::span<const std::uint16_t> values) {
    if (values.empty() || values.size() > MODBUS_MAX_WRITE_REGISTERS) {
        return fail(ErrorCode::invalid_argument,
                    fmt::format("{} registers cannot be written in one request", values.size()), "write 1 to 123");
    }
    if (auto done = ensure_connected(); !done) return tl::unexpected(done.error());
    const int done = modbus_write_registers(context_.get(), address, static_cast<int>(values.size()), values.data());
    if (done != static_cast<int>(values.size()))
        return failed(fmt::format("writing {} registers at {}", values.size(), address));
    return {};
}

Result<std::vector<Client::Place>> Client::walk() {
    const auto not_ours = [&](std::string what) {
        return fail(ErrorCode::unreadable, fmt::format("{} {}", where(), what),
                    "check that the address is a HORD station's");
    };
    auto first = read(0, 4);
    if (!first && first.error().code == ErrorCode::refused) return not_ours("has no registers at 0");
    if (!first) return tl::unexpected(first.error());
    const std::uint32_t magic = std::uint32_t{(*first)[2]} << 16U | (*first)[3];
    if ((*first)[0] != static_cast<std::uint16_t>(BlockId::ident) || magic != kMapMagic)
        return not_ours("does not speak this register map");

    std::vector<Place> places;
    for (std::uint32_t base = 0; base < 0xFFFF && places.size() < kMaxBlocks;) {
        const auto header = read(static_cast<std::uint16_t>(base), kBlockHeader);
        if (!header) return tl::unexpected(header.error());
        if ((*header)[0] == static_cast<std::uint16_t>(BlockId::end)) return places;
        places.push_back({(*header)[0], static_cast<std::uint16_t>(base), (*header)[1]});
        base += std::uint32_t{(*header)[1]} + kBlockHeader;
    }
    return not_ours("has a chain of blocks without an end");
}

Result<std::vector<Reading>> Client::read_block(BlockId id) {
    if (places_.empty()) {
        auto places = walk();
        if (!places) return tl::unexpected(places.error());
        places_ = std::move(*places);
    }
    const Block& block = *find_block(id);
    const auto place = std::ranges::find(places_, static_cast<std::uint16_t>(id), &Place::id);
    if (place == places_.end())
        return fail(ErrorCode::not_found, fmt::format("{} has no block {}", where(), block.name),
                    "update the station's firmware");
    const auto image =
        read(place->base, std::min<std::size_t>({std::size_t{place->length} + kBlockHeader, block.size(), kMaxRead}));
    if (!image) return tl::unexpected(image.error());
    return decode(block, *image);
}

Result<std::vector<Reading>> Client::read_result(std::uint32_t sequence) {
    const auto slot = read(address_of_result(sequence), kResultWords);
    if (!slot) return tl::unexpected(slot.error());
    auto readings = decode_slot(*find_block(BlockId::ring), *slot);
    if (readings && readings->front().number != static_cast<double>(sequence)) {
        return fail(ErrorCode::not_found, fmt::format("{} no longer holds result {}", where(), sequence),
                    fmt::format("read the last {} results; acknowledge them in time", kRingSlots));
    }
    return readings;
}

std::string Client::Reply::cure(bool (*offered)(Command)) const {
    switch (error) {
        case CommandError::bad_argument:
        case CommandError::no_such_recipe:
            if (!remarks.empty() && !remarks.ends_with("...")) return {};  // they have the cure
            break;
        default: break;
    }
    switch (error) {
        case CommandError::not_in_this_state:
            return station_state ? possible_commands_text(*station_state, offered)
                                 : "the station is in another state: see its state";
        case CommandError::device_down: return "see the active faults (on its page, or hordctl status)";
        case CommandError::plc_lost: return "the PLC's heartbeat is missing: check the PLC, or change plc.policy";
        case CommandError::not_yet:
            return "a line stop is newer than 200 ms, parts are on the line, or the ejector still acts: stop the feed "
                   "and try again in a moment";
        case CommandError::no_such_recipe:
            return "no usable recipe of the station's folder has this number: name the folder in hordd.toml "
                   "(inspection.recipes), and see what is in it: hordctl recipe list FOLDER";
        case CommandError::wrong_checksum: return "the recipe is not the one that was meant";
        case CommandError::cancelled: return "abort, halt or another recipe ended it: teach again";
        case CommandError::bad_argument: return "see the station's journal for what is wrong with it";
        default: return "see the station's journal";
    }
}

Result<Client::Reply> Client::command(Command code, std::uint32_t argument, std::uint32_t argument2,
                                      std::chrono::milliseconds patience, std::string_view who) {
    const auto boot = read(find_register(BlockId::ident, "boot_id")->address, 2);
    if (!boot) return tl::unexpected(boot.error());
    std::random_device random;
    std::uint32_t token = 0;
    while (token == 0) token = random();
    const auto high = [](std::uint32_t v) { return static_cast<std::uint16_t>(v >> 16U); };
    const auto low = [](std::uint32_t v) { return static_cast<std::uint16_t>(v & 0xFFFFU); };
    std::vector<std::uint16_t> request{high(token),    low(token),    (*boot)[1],      static_cast<std::uint16_t>(code),
                                       high(argument), low(argument), high(argument2), low(argument2)};
    if (!who.empty()) {  // an older station has no such row
        const std::size_t most = std::size_t{2} * find_register(BlockId::command, "who")->words;
        if (who.size() > most)
            return fail(ErrorCode::invalid_argument, fmt::format("\"{}\" is too long a name", who),
                        fmt::format("use at most {} characters", most));
        for (std::size_t k = 0; k < most; k += 2) {
            const auto at = [&](std::size_t c) {
                return static_cast<unsigned>(c < who.size() ? static_cast<unsigned char>(who[c]) : 0);
            };
            request.push_back(static_cast<std::uint16_t>(at(k) << 8U | at(k + 1)));
        }
    }
    const Block& reply = *find_block(BlockId::reply);
    const auto at = [&](std::string_view row) {
        return std::size_t{find_register(BlockId::reply, row)->address} - reply.base;
    };
    const auto until = std::chrono::steady_clock::now() + patience;
    const std::uint16_t command_at = find_register(BlockId::command, "token")->address;
    while (true) {
        const auto written = write(command_at, request);
        const bool uncertain =
            !written && (written.error().code == ErrorCode::timeout || written.error().code == ErrorCode::disconnected);
        const bool busy = !written && written.error().code == ErrorCode::busy;
        if (!written && !uncertain && !busy) return tl::unexpected(written.error());
        const auto words = read(reply.base, reply.size());
        if (words) {
            const bool mine = (*words)[at("token")] == request[0] && (*words)[at("token") + 1] == request[1];
            const auto state = static_cast<CommandState>((*words)[at("state")]);
            if (mine && state != CommandState::executing) {
                const auto rows = decode(reply, *words);
                Reply answer{state, static_cast<CommandError>((*words)[at("error")]),
                             std::uint32_t{(*words)[at("result")]} << 16U | (*words)[at("result") + 1]};
                for (const Reading& row : *rows) {
                    if (row.what->name == "error") answer.error_name = row.text.substr(row.text.find(' ') + 1);
                    if (row.what->name == "remarks" && row.text != "-") answer.remarks = row.text;
                }
                if (answer.error == CommandError::not_in_this_state) {
                    if (const auto now = read(find_register(BlockId::status, "state")->address, 1))
                        answer.station_state = static_cast<State>((*now)[0]);
                }
                return answer;
            }
        }
        if (std::chrono::steady_clock::now() < until) {
            std::this_thread::sleep_for(kAskAgainAfter);
            continue;
        }
        if (!written) return tl::unexpected(written.error());
        if (!words) return tl::unexpected(words.error());
        return fail(ErrorCode::timeout,
                    fmt::format("{} has not finished the command within {} ms", where(), patience.count()),
                    "see hordctl status");
    }
}

}  // namespace hord::firmware::modbus
