// A stream of requests [length, PDU...] to all registers of a station. Every reply must be legal, and no token may
// execute two commands.
#include <algorithm>
#include <cstdlib>
#include <set>

#include "firmware/plc/register_server_model.h"

namespace {

using namespace hord;
using namespace hord::firmware;

class Still : public hal::Clock {
  public:
    hal::TimePoint now() const override { return hal::TimePoint(std::chrono::seconds(1)); }
};

class Handler : public PlcHandler {
  public:
    std::set<std::uint32_t> tokens;
    CommandOutcome on_command(const modbus::Origin&, const CommandRequest& request) override {
        if (request.token == 0 || !tokens.insert(request.token).second) std::abort();
        return {request.code % 7 == 0 ? CommandState::executing : CommandState::completed, CommandError::none, 0};
    }
    modbus::Exception on_acknowledged(const modbus::Origin&, std::uint32_t sequence) override {
        if (sequence > 300) std::abort();
        return sequence % 7 == 0 ? modbus::Exception::busy : modbus::Exception::none;
    }
    void on_plc_lost(PlcPolicy) override {}
    void on_plc_back() override {}
};

}  // namespace

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
    Still clock;
    Handler handler;
    PlcInterface desk(clock, handler, {});
    RegisterServerModel image(StationIdentity{}, &desk);
    Snapshot snapshot;
    snapshot.last.sequence = 300;
    image.publish(snapshot);
    std::span<const std::uint8_t> rest(data, size);
    for (int requests = 0; rest.size() > 1 && requests < 200; ++requests) {
        const std::size_t length = std::min<std::size_t>({1 + rest[0] % modbus::kMaxPdu, rest.size() - 1});
        const auto request = rest.subspan(1, length);
        rest = rest.subspan(1 + length);
        std::array<std::uint8_t, modbus::kMaxPdu> reply{};
        const std::size_t count = modbus::dispatch(image, {.peer = "fuzz", .may_write = true}, request, reply);
        if (count < 2 || count > reply.size()) std::abort();
        if ((reply[0] & 0x7FU) != (request[0] & 0x7FU)) std::abort();
        if ((reply[0] & 0x80U) != 0 && count != 2) std::abort();
    }
    return 0;
}
