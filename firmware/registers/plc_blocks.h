// Rows of COMMAND, REPLY, PLC, RECIPE, HEALTH and CALIBRATION. Append only.
#pragma once

#include <algorithm>
#include <limits>

#include "firmware/registers/register_rows.h"

namespace hord::firmware::rows {

inline constexpr Register kCommand[] = {
    writable(number(8002, Type::bits32, "token", "",
                    "chosen by the sender, another one for every command, never 0; repeated, it does nothing twice",
                    plc_bits<&PlcView::command, &CommandRequest::token>)),
    writable(number(8004, Type::bits16, "boot", "", "low half of boot_id: any other boot refuses it; 0: any",
                    plc_bits<&PlcView::command, &CommandRequest::boot>)),
    writable(number(8005, Type::u16, "code", "", "the command", plc<&PlcView::command, &CommandRequest::code>,
                    kNamesOf<Command>)),
    writable(
        number(8006, Type::bits32, "argument", "",
               "commit_recipe: staged_crc32; use_recipe: the recipe's number; teach: parts, 8 to 64, or 0: 16; else 0",
               plc_bits<&PlcView::command, &CommandRequest::argument>)),
    writable(number(8008, Type::bits32, "argument2", "",
                    "use_recipe: the recipe's CRC-32, or 0: whatever it is; else 0",
                    plc_bits<&PlcView::command, &CommandRequest::argument2>)),
    writable(text(
        8010, 10, "who",
        "for whom the sender asks, as it is recorded with its address: printable ASCII; empty, or left out: for itself",
        [](const Source& s) { return s.extras.plc ? s.extras.plc->command.who.view() : std::string_view{}; })),
};

inline constexpr Register kReply[] = {
    number(8022, Type::bits32, "token", "", "of the command that was written last; 0: none since this boot",
           plc_bits<&PlcView::reply, &CommandReply::token>),
    number(8024, Type::u16, "code", "", "the command", plc<&PlcView::reply, &CommandReply::code>, kNamesOf<Command>),
    number(8025, Type::u16, "state", "", "what became of it", plc<&PlcView::reply, &CommandReply::state>,
           kNamesOf<CommandState>),
    number(8026, Type::u16, "error", "", "why it failed", plc<&PlcView::reply, &CommandReply::error>,
           kNamesOf<CommandError>),
    number(8027, Type::bits32, "result", "",
           "what the command gives back; self_test: the faults found, as in faults_active; commit_recipe, use_recipe: "
           "CRC-32 of the recipe now in use; teach: parts taken so far, and when completed the CRC-32 of the recipe "
           "with its new reference; else 0",
           plc_bits<&PlcView::reply, &CommandReply::result>),
    number(8029, Type::u32, "commands_done", "",
           "commands that the station executed or refused since this boot; those that REPLY refuses before (token, "
           "boot, checksum, argument left out) and repeats do not count",
           plc<&PlcView::commands_done>),
    text(
        8031, kRemarkChars / 2, "remarks",
        "why a command failed, where `error` does not say all: commit_recipe names each register whose value cannot be "
        "used, and its range; of a completed teach: which parts were left out, counted once or would be rejected, and "
        "what they do not determine; ends with ... where the journal has more; else empty",
        [](const Source& s) { return s.extras.plc ? s.extras.plc->reply.remarks.view() : std::string_view{}; }),
};

inline constexpr Register kPlc[] = {
    writable(number(8102, Type::bits16, "heartbeat", "", "the PLC writes another value within `timeout`, for ever",
                    plc_bits<&PlcView::plc_heartbeat>)),
    writable(
        number(8103, Type::u32, "acknowledged", "",
               "newest result that the PLC has taken; goes forward only; a PLC that was restarted reads it to go on",
               plc<&PlcView::acknowledged>)),
    number(8105, Type::u16, "policy", "", "what the station does when the heartbeat stops; from its configuration",
           plc<&PlcView::policy>, kNamesOf<PlcPolicy>),
    number(8106, Type::u16, "timeout", "ms", "after which the PLC counts as lost; from the configuration",
           plc<&PlcView::timeout_ms>),
    number(8107, Type::u32, "overruns", "results",
           "results overwritten before they were acknowledged, since the first acknowledgement",
           plc<&PlcView::overruns>),
    number(8109, Type::u32, "unacknowledged", "results", "results newer than `acknowledged`",
           [](const Source& s) {
               const std::uint32_t newest = s.result.sequence;
               return from_plc(s, [&](auto& p) { return newest - std::min(p.acknowledged, newest); });
           }),
};

// A limit of the staged recipe. Read 0xFFFF: the recipe does not judge by the feature. Written 0xFFFF: the recipe's
// own. commit_recipe takes registers 8202 to 8209.
template <auto limit>
Number in_thousandths(const Source& s) {
    return from_plc(s, [](const PlcView& view) {
        const std::uint16_t staged = view.staged.*limit;
        return staged == 0xFFFF ? std::numeric_limits<double>::quiet_NaN() : staged / 1000.0;
    });
}
template <auto share>
Number in_ten_thousandths(const Source& s) {
    return from_plc(s, [](const PlcView& view) { return view.staged.*share / 10000.0; });
}

inline constexpr Register kRecipe[] = {
    writable(number(8202, Type::u16, "staged_number", "", "number that the recipe will have, 0 to 65534",
                    plc<&PlcView::staged, &StagedRecipe::number>)),
    nullable(writable(number(8203, Type::u16, "staged_emd_limit", "bin pitches",
                             "largest gradient of the earth mover's distance, 0.001 to 30; 65535 read: not judged by "
                             "it, written: left as it is",
                             in_thousandths<&StagedRecipe::emd_limit_mbins>, {}, 0.001))),
    nullable(writable(number(
        8204, Type::u16, "staged_frobenius_limit", "bin pitches a lenslet",
        "largest norm of the deflection's Jacobian, 0.001 to 30; 65535 read: not judged by it, written: left as it is",
        in_thousandths<&StagedRecipe::frobenius_limit_mbins>, {}, 0.001))),
    nullable(writable(number(8205, Type::u16, "staged_transmission_limit", "",
                             "least light relative to a typical lenslet, 0 (off) to 0.999; 65535 read: not judged by "
                             "it, written: left as it is",
                             in_thousandths<&StagedRecipe::transmission_permille>, {}, 0.001))),
    writable(number(8206, Type::u16, "staged_min_area", "lenslets",
                    "smaller regions are no defects; 1 to 65534, at most all lenslets of the field",
                    plc<&PlcView::staged, &StagedRecipe::min_area>)),
    writable(number(8207, Type::s16, "staged_rim_margin", "lenslets",
                    "not judged inside the part's rim; 0 to 1000, less than half of the field's shorter side; -1: "
                    "chosen by the station",
                    plc<&PlcView::staged, &StagedRecipe::rim_margin>)),
    writable(number(8208, Type::u16, "staged_max_saturated_share", "",
                    "more saturated lenslets make the frame unfit, 0 to 1",
                    in_ten_thousandths<&StagedRecipe::max_saturated_permyriad>, {}, 0.0001)),
    writable(number(8209, Type::u16, "staged_min_lit_share", "", "fewer lit lenslets make the frame unfit, 0 to 1",
                    in_ten_thousandths<&StagedRecipe::min_lit_permyriad>, {}, 0.0001)),
    number(8210, Type::bits32, "staged_crc32", "",
           "CRC-32 of registers 8202 to 8209 as they travel: the argument of commit_recipe",
           plc_bits<&PlcView::staged_crc32>),
    number(8212, Type::u16, "number", "", "number of the recipe in use",
           [](const Source& s) { return maybe(s.extras.recipe.number); }),
    number(8213, Type::bits32, "crc32", "", "CRC-32 of the recipe in use; 0: not known",
           [](const Source& s) -> Number { return s.extras.recipe.crc32.value_or(0); }),
    text(8215, 16, "name", "of the recipe in use", [](const Source& s) { return s.extras.recipe.name.view(); }),
};

inline constexpr Register kHealth[] = {
    number(8402, Type::u32, "uptime", "s", "since the start", health<&HealthReport::uptime_s>),
    number(8404, Type::u32, "latency_p50", "us", "edge to verdict, median of the ring's results",
           statistic<&ResultStatistics::latency_p50_us>),
    number(8406, Type::u32, "latency_p99", "us", "the same, 99 of 100", statistic<&ResultStatistics::latency_p99_us>),
    number(8408, Type::u32, "latency_max", "us", "the same, the longest", statistic<&ResultStatistics::latency_max_us>),
    number(8410, Type::u32, "reject_p50", "us", "edge to confirmed rejection, median of the ring's results",
           statistic<&ResultStatistics::reject_p50_us>),
    number(8412, Type::u32, "reject_p99", "us", "the same, 99 of 100", statistic<&ResultStatistics::reject_p99_us>),
    number(8414, Type::u32, "reject_max", "us", "the same, the longest", statistic<&ResultStatistics::reject_max_us>),
    number(8416, Type::u16, "parts_per_minute", "1/min",
           "of the last minute with parts; falls when no part comes, to 0 after a minute",
           statistic<&ResultStatistics::parts_per_minute>, {}, 0.1),
    number(8417, Type::u32, "frames_lost", "frames", "asked for and never delivered",
           health<&HealthReport::frames_lost>),
    number(8419, Type::u32, "frames_corrupt", "frames", "short, flagged by the device, old or repeated",
           health<&HealthReport::frames_corrupt>),
    number(8421, Type::u16, "frames_waiting", "frames", "for an inspection thread, now",
           health<&HealthReport::frames_waiting>),
    number(8422, Type::u32, "modbus_connections", "", "to this server, now", health<&HealthReport::modbus_connections>),
    number(8424, Type::u32, "modbus_requests", "", "answered since the start", health<&HealthReport::modbus_requests>),
    number(8426, Type::u32, "modbus_exceptions", "", "of these, with an exception",
           health<&HealthReport::modbus_exceptions>),
    number(8428, Type::u32, "modbus_evicted", "", "connections closed to make room for others",
           health<&HealthReport::modbus_evicted>),
    number(8430, Type::u32, "modbus_broken", "", "connections closed for bytes that are not Modbus",
           health<&HealthReport::modbus_broken>),
    number(8432, Type::s16, "processor", "degC", "temperature", health<&HealthReport::processor_celsius>, {}, 0.1),
    number(8433, Type::u16, "disk_free", "%", "of the disk with the results", health<&HealthReport::disk_free_percent>,
           {}, 0.1),
    number(
        8434, Type::u16, "light_output", "%",
        "light of the parts, of what the reference's had; without a reference: of what the first had since the start "
        "or the recipe's change",
        optics<&OpticsReport::light_percent>, {}, 0.1),
    number(8435, Type::s32, "dark_drift", "DN",
           "change of the sensor's dark level since the start, or the recipe's change",
           optics<&OpticsReport::dark_drift_dn>, {}, 0.01),
    number(8437, Type::s16, "uneven", "%",
           "of the region whose share of the light changed most; below 0: darker than it was",
           optics<&OpticsReport::uneven_percent>, {}, 0.1),
    number(8438, Type::u16, "uneven_m", "lenslets", "column of its middle", optics<&OpticsReport::uneven_m>),
    number(8439, Type::u16, "uneven_n", "lenslets", "row of its middle", optics<&OpticsReport::uneven_n>),
    number(8440, Type::u32, "dust", "specks",
           "places that respond in most parts: dust on the optics, or the same flaw in every part",
           optics<&OpticsReport::specks>),
    number(8442, Type::u16, "dust_m", "lenslets", "column of the largest one's centre", optics<&OpticsReport::dust_m>),
    number(8443, Type::u16, "dust_n", "lenslets", "row of it", optics<&OpticsReport::dust_n>),
    number(8444, Type::u32, "dust_lenslets", "lenslets", "that it covers", optics<&OpticsReport::dust_lenslets>),
    number(8446, Type::u16, "dust_share", "%", "of the parts in which it responds",
           optics<&OpticsReport::dust_share_percent>, {}, 0.1),
    number(8447, Type::s32, "dust_x", "mm",
           "its centre to the right of the field's middle; needs the recipe's lenslet_mm",
           optics<&OpticsReport::dust_x_mm>, {}, 0.001),
    number(8449, Type::s32, "dust_y", "mm", "the same, downwards", optics<&OpticsReport::dust_y_mm>, {}, 0.001),
    number(8451, Type::u32, "bounded", "parts",
           "inspected with upper bounds, because a limit of work or time was reached; may be rejected needlessly",
           health<&HealthReport::bounded>),
};

inline constexpr Register kCalibration[] = {
    number(8502, Type::bits32, "id", "", "CRC-32 of the lenslet grid in use; 0: none, frames are macro-pixels",
           [](const Source& s) -> Number { return s.extras.calibration.id.value_or(0); }),
    number(8504, Type::u32, "age", "s", "since the calibration was made", calibration<&CalibrationReport::age_s>),
    number(8506, Type::u16, "residual", "px", "root mean square of the fit",
           calibration<&CalibrationReport::residual_px>, {}, 0.001),
    number(8507, Type::s16, "drift", "px",
           "of the grid since the calibration; of macro-pixel frames: since the first parts",
           calibration<&CalibrationReport::drift_px>, {}, 0.001),
    number(8508, Type::u16, "lenslets_m", "lenslets", "columns", calibration<&CalibrationReport::lenslets_m>),
    number(8509, Type::u16, "lenslets_n", "lenslets", "rows", calibration<&CalibrationReport::lenslets_n>),
};

}  // namespace hord::firmware::rows
