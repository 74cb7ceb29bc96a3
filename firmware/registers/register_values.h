// The values behind the registers. Each struct is published by the component that knows it; an empty optional is shown
// as "not available".
#pragma once

#include <algorithm>
#include <array>
#include <cstdint>
#include <optional>
#include <string>
#include <string_view>

#include "common/name_bytes.h"
#include "common/utf8.h"
#include "firmware/core/commands.h"
#include "firmware/core/station_types.h"

namespace hord::firmware {

// Incremented when a row is added to the register map (station_blocks.h, plc_blocks.h).
inline constexpr std::uint16_t kMapVersion = 7;

// Also served as Modbus device identification (FC 43/14).
struct StationIdentity {
    std::string vendor = "HORD";
    std::string product = "HORD station";
    std::string firmware = {};  // version, "0.1.0"
    std::string serial = {};
    std::uint32_t boot_id = 0;    // random at every start: sequence numbers of different boots cannot be confused
    std::uint32_t simulated = 0;  // the fault bits of the devices that are simulated, or play recorded frames
};

// Text of at most `most` bytes, copied without allocating; longer text is cut between two characters.
template <std::size_t most>
class FixedText {
  public:
    FixedText() = default;
    FixedText(std::string_view text) { std::ranges::copy(common::utf8_prefix(text, most), chars_.begin()); }
    [[nodiscard]] std::string_view view() const {
        return {chars_.data(),
                static_cast<std::size_t>(std::find(chars_.begin(), chars_.end(), '\0') - chars_.begin())};
    }
    bool operator==(const FixedText&) const = default;

  private:
    std::array<char, most> chars_{};
};
using ShortText = FixedText<common::kNameBytes>;
inline constexpr std::size_t kRemarkChars = 120;
using RemarkText = FixedText<kRemarkChars>;

struct RecipeInUse {
    std::optional<std::uint16_t> number = {};
    std::optional<std::uint32_t> crc32 = {};
    ShortText name = {};
};

// How light and optics age (firmware/monitoring/optics_monitor.h).
struct OpticsReport {
    std::optional<double> light_percent = {}, dark_drift_dn = {}, uneven_percent = {};
    std::optional<std::uint16_t> uneven_m = {}, uneven_n = {};
    std::optional<std::uint32_t> specks = {};
    // Of the largest speck.
    std::optional<std::uint16_t> dust_m = {}, dust_n = {};
    std::optional<std::uint32_t> dust_lenslets = {};
    std::optional<double> dust_share_percent = {}, dust_x_mm = {}, dust_y_mm = {};
};

// Health values that are not computed from results (those: ResultStatistics).
struct HealthReport {
    std::optional<std::uint32_t> uptime_s = {};
    std::optional<std::uint32_t> frames_lost = {}, frames_corrupt = {};
    std::optional<std::uint16_t> frames_waiting = {};
    std::optional<std::uint32_t> bounded = {};
    std::optional<std::uint32_t> modbus_connections = {}, modbus_requests = {}, modbus_exceptions = {};
    std::optional<std::uint32_t> modbus_evicted = {}, modbus_broken = {};
    std::optional<double> processor_celsius = {}, disk_free_percent = {};
    OpticsReport optics = {};
};

struct CalibrationReport {
    std::optional<std::uint32_t> id = {};  // CRC-32 of the grid file
    std::optional<std::uint32_t> age_s = {};
    std::optional<double> residual_px = {}, drift_px = {};
    std::optional<std::uint16_t> lenslets_m = {}, lenslets_n = {};
};

// Over the results in the ring.
struct ResultStatistics {
    std::optional<std::uint32_t> latency_p50_us = {}, latency_p99_us = {}, latency_max_us = {};
    std::optional<std::uint32_t> reject_p50_us = {}, reject_p99_us = {}, reject_max_us = {};
    std::optional<double> parts_per_minute = {};
};

// -- the PLC's side (plc_interface.h)

enum class CommandState : std::uint16_t { none = 0, executing = 1, completed = 2, failed = 3 };
constexpr std::string_view name_of(CommandState state) {
    constexpr std::string_view kNames[] = {"none", "executing", "completed", "failed"};
    const auto number = static_cast<std::size_t>(state);
    return number < std::size(kNames) ? kNames[number] : "unknown";
}

enum class CommandError : std::uint16_t {
    none = 0,
    unknown_command = 1,
    not_in_this_state = 2,
    device_down = 3,
    bad_argument = 4,
    wrong_checksum = 5,
    token_reused = 6,
    other_boot = 7,
    not_supported = 8,
    failed = 9,
    plc_lost = 10,  // start: the PLC's heartbeat is missing
    not_yet = 11,   // arm: the ejector is still acting; self_test: or parts are on the line; teach: another is running;
                    // reset: the line stop was not up for kMinLineStop
    no_such_recipe = 12,  // use_recipe: no usable file has this number
    cancelled = 13,       // teach: abort, halt or another recipe ended it
};
constexpr std::string_view name_of(CommandError error) {
    constexpr std::string_view kNames[] = {"none",           "unknown_command", "not_in_this_state", "device_down",
                                           "bad_argument",   "wrong_checksum",  "token_reused",      "other_boot",
                                           "not_supported",  "failed",          "plc_lost",          "not_yet",
                                           "no_such_recipe", "cancelled"};
    const auto number = static_cast<std::size_t>(error);
    return number < std::size(kNames) ? kNames[number] : "unknown";
}

struct CommandRequest {
    std::uint32_t token = 0;  // chosen by the sender, never 0
    std::uint16_t boot = 0;   // low half of boot_id, or 0: any
    std::uint16_t code = 0;   // a Command, or an unknown number
    std::uint32_t argument = 0, argument2 = 0;
    ShortText who = {};  // on whose behalf, at most 20 printable ASCII characters; empty: the sender itself
    bool operator==(const CommandRequest&) const = default;
};
struct CommandReply {
    std::uint32_t token = 0;
    std::uint16_t code = 0;
    CommandState state = CommandState::none;
    CommandError error = CommandError::none;
    std::uint32_t result = 0;
    RemarkText remarks = {};
};

// Limits of algo/recipe/recipe.h as integers in the map's units.
struct StagedRecipe {
    std::uint16_t number = 0;
    std::uint16_t emd_limit_mbins = 1000, frobenius_limit_mbins = 1000, transmission_permille = 500;
    std::uint16_t min_area = 1;
    std::int16_t rim_margin = -1;
    std::uint16_t max_saturated_permyriad = 200, min_lit_permyriad = 500;
    bool operator==(const StagedRecipe&) const = default;
};
using StagedWords = std::array<std::uint16_t, 8>;  // registers 8202 to 8209: StagedRecipe's members in their order

struct PlcView {
    CommandRequest command;  // the last one written
    CommandReply reply;      // to it
    std::uint32_t commands_done = 0;
    std::uint16_t plc_heartbeat = 0;
    std::optional<std::uint32_t> plc_heartbeat_age_ms;  // empty: no heartbeat since the start
    bool lost = false;
    PlcPolicy policy = PlcPolicy::none;
    std::uint16_t timeout_ms = 0;
    std::uint32_t acknowledged = 0, overruns = 0;
    StagedRecipe staged;
    std::uint32_t staged_crc32 = 0;
};

struct RegisterExtras {
    RecipeInUse recipe;
    HealthReport health;
    CalibrationReport calibration;
    ResultStatistics statistics;
    std::optional<PlcView> plc;  // empty: the station has no PLC interface
};

// Input of the encoder. `result` is shown in the ring's slot or in LAST.
struct RegisterValues {
    const StationIdentity& identity;
    const Snapshot& snapshot;
    const PartResult& result;
    const RegisterExtras& extras;
};

}  // namespace hord::firmware
