#include "firmware/config/config.h"

#include <algorithm>
#include <tuple>

#include <fmt/format.h>

#include "algo/frame/extents.h"
#include "common/file_kind.h"
#include "common/name_bytes.h"
#include "common/toml_fields.h"
#include "common/utf8.h"
#include "firmware/config/device_sections.h"
#include "firmware/config/shared_keys.h"

namespace hord::firmware {
namespace {

using common::TomlProblems;
using common::TomlTable;

// "9x9": bin columns by bin rows.
void macro(TomlTable& table, std::string_view key, int& bins_i, int& bins_j) {
    std::string text = std::to_string(bins_i) + "x" + std::to_string(bins_j);
    table.text(key, text);
    const auto bins = algo::parse_bins(text);
    if (!bins) {
        return table.problem(key, "\"" + text + "\" is not a macro-pixel",
                             "write columns x rows, 3 to 15 bins a side, as in \"9x9\"");
    }
    std::tie(bins_i, bins_j) = *bins;
}

// A path, relative to `folder` unless absolute; empty if the key is empty, or absent without a default.
std::filesystem::path path(TomlTable& table, std::string_view key, const std::filesystem::path& folder,
                           std::string text = {}) {
    table.text(key, text);
    return text.empty() ? std::filesystem::path() : folder / text;
}

void read_line(TomlTable line, CoreConfig& core) {
    line.choice("tracking", {"time", "encoder"}, core.by_encoder);
    ms(line, "transport_ms", core.transport, 1, 600'000);
    line.integer("transport_counts", core.transport_counts, 1, 1'000'000'000);
    ms(line, "encoder_timeout_ms", core.encoder_timeout, 1, 60'000);
    ms(line, "exposure_delay_ms", core.exposure_delay, 0, 60'000);
    line.integer("exposure_counts", core.exposure_counts, 0, 1'000'000'000);
    ms(line, "min_gap_ms", core.min_gap, 0.1, 60'000);
    line.integer("min_gap_counts", core.min_gap_counts, 1, 1'000'000'000);
    ms(line, "max_part_ms", core.max_part, 0, 60'000);
    line.integer("max_part_counts", core.max_part_counts, 0, 1'000'000'000);
    line.integer("max_parts", core.max_parts, 1, kLineCapacity);
}

void read_timing(TomlTable timing, CoreConfig& core, InspectionConfig& inspection) {
    us(timing, "exposure_us", core.exposure, 1, 1'000'000);
    ms(timing, "trigger_lead_ms", core.trigger_lead, 0, 60'000);
    us(timing, "strobe_delay_us", core.strobe_delay, 0, 1'000'000);
    us(timing, "strobe_us", core.strobe, 1, 1'000'000);
    us(timing, "strobe_window_us", core.strobe_window, 1, 1'000'000);
    us(timing, "frame_window_us", core.frame_window, 1, 10'000'000);
    ms(timing, "frame_timeout_ms", core.frame_timeout, 1, 60'000);
    ms(timing, "inspect_budget_ms", inspection.budget, 0, 60'000);
}

// Addresses and networks that may write, then those that may only read.
std::vector<modbus::AccessRule> access(TomlTable& table) {
    std::vector<modbus::AccessRule> rules;
    const auto read = [&](std::string_view key, std::vector<std::string> networks, bool may_write) {
        table.texts(key, networks);
        for (const std::string& text : networks) {
            const auto network = modbus::parse_network(text);
            if (network) rules.push_back({*network, may_write});
            else table.problem(key, network.error().what, network.error().cure);
        }
    };
    read("may_write", {"127.0.0.0/8", "::1"}, true);
    read("may_read", {"0.0.0.0/0", "::/0"}, false);
    return rules;
}

void read_modbus(TomlTable table, TcpServer& value) {
    host(table, "host", value.host);
    table.integer("port", value.port, 0, 65535);
    table.integer("read_only_port", value.read_only_port, 0, 65535);
    table.integer("max_connections", value.max_connections, 1, 512);
    value.access = access(table);
    if (value.read_only_port != 0 && value.read_only_port == value.port) {
        table.problem("read_only_port", "is modbus.port, too", "give it another one, or 0 for none");
    }
}

void read_serial(TomlTable table, SerialLine& value) {
    modbus::SerialOptions line;
    line.device.clear();
    table.text("device", line.device);
    baud(table, line.baud);
    table.choice("parity", {"none", "even", "odd"}, line.parity);
    table.integer("unit", line.unit, 1, 247);
    table.boolean("rs485", line.rs485);
    table.boolean("may_write", line.may_write);
    ms(table, "gap_ms", line.gap, 1, 1000);
    if (!line.device.empty()) value = line;
}

void read_plc(TomlTable plc, PlcConfig& value, CoreConfig& core) {
    plc.choice("policy", {"none", "stop", "reject_all"}, core.plc_policy);
    ms(plc, "timeout_ms", value.timeout, 200, 60'000);
}

// Without a calibration the frame is divided into macro-pixels; of a GenICam camera any region can be taken.
void check_macro(TomlTable& inspection, const InspectionConfig& value, const SensorConfig& sensor) {
    const auto* const camera = std::get_if<drivers::GenicamSensorOptions>(&sensor);
    if (camera == nullptr || !value.grid.empty()) return;
    const std::string cure = "make them whole lenslets, or name the calibration in inspection.grid";
    if (camera->width_px % value.bins_i != 0 || camera->height_px % value.bins_j != 0)
        return inspection.problem("macro",
                                  "of " + std::to_string(value.bins_i) + "x" + std::to_string(value.bins_j) +
                                      " does not divide the frame of sensor.width_px and height_px",
                                  cure);
    if (camera->width_px == 0 || camera->height_px == 0) return;  // the camera's own, which it says at the start
    const auto extents = algo::extents_of_frame(camera->width_px, camera->height_px, value.bins_i, value.bins_j);
    if (!extents)
        inspection.problem("macro", "and sensor.width_px and height_px make " + extents.error().what,
                           extents.error().cure);
}

void read_inspection(TomlTable inspection, InspectionConfig& value, const std::filesystem::path& folder,
                     const SensorConfig& sensor) {
    macro(inspection, "macro", value.bins_i, value.bins_j);
    value.grid = path(inspection, "grid", folder);
    value.recipe = path(inspection, "recipe", folder);
    value.recipes = path(inspection, "recipes", folder, "recipes");
    inspection.integer("threads", value.threads, 1, 64);
    inspection.integer("queue", value.queue, 1, 256);
    check_macro(inspection, value, sensor);
}

void read_optics(TomlTable optics, OpticsConfig& value) {
    optics.integer("window_parts", value.window_parts, 25, 1000);
    optics.number("least_light", value.least_light, 0.05, 0.95);
    optics.number("most_dark_drift_dn", value.most_dark_drift_dn, 0, 65535);
    optics.number("most_uneven", value.most_uneven, 0.02, 0.9);
}

void read_store(TomlTable store, StoreConfig& value, const std::filesystem::path& folder) {
    store.boolean("enabled", value.enabled);
    value.folder = path(store, "folder", folder);
    store.integer("keep_days", value.keep_days, 0, 36'500);
    store.integer("keep_mb", value.keep_mb, 0, 10'000'000);
    store.integer("frames_mb", value.frames_mb, 0, 100'000'000);
    store.integer("free_mb", value.free_mb, 0, 100'000'000);
    store.integer("frames_before", value.frames_before, 0, 64);
    store.integer("frames_after", value.frames_after, 0, 64);
    store.integer("sample_every", value.sample_every, 0, 1'000'000'000);
    store.integer("frame_buffers", value.frame_buffers, 1, 1024);
    if (value.frames_before >= value.frame_buffers) {
        store.problem("frames_before", "is more than there are buffers for", "raise store.frame_buffers");
    }
}

Result<Config> read(TomlTable root, std::string_view name, const std::filesystem::path& folder, NamedBackends backends,
                    TomlProblems& found) {
    Config config;
    TomlTable station = root.table("station");
    station.name("name", config.name);
    station.boolean("autostart", config.autostart);
    ms(station, "heartbeat_ms", config.core.station_heartbeat, 10, 60'000);
    station.integer("max_failures_in_a_row", config.core.max_failures_in_a_row, 0, 1'000'000);
    read_line(root.table("line"), config.core);
    read_timing(root.table("timing"), config.core, config.inspection);
    const auto device = [&](const char* key) {
        TomlTable table = root.table(key);
        if (backends == NamedBackends::required && !table.has("backend")) {
            table.problem("backend", "is missing",
                          "name the device's backend; one that is meant to be simulated is backend = \"simulated\"");
        }
        return table;
    };
    const TomlTable sensor = device("sensor");
    read_sensor(sensor, config.sensor, folder);
    if (auto* const camera = std::get_if<drivers::GenicamSensorOptions>(&config.sensor))
        camera->exposure_us = config.core.exposure / std::chrono::microseconds(1);
    read_rejector(device("rejector"), config.rejector, config.core);
    SensorConfig* const seen_by = sensor.misread() ? nullptr : &config.sensor;
    read_strobe(device("strobe"), config.strobe, config.core, seen_by);
    read_part_sensor(device("part_sensor"), config.part_sensor, config.core, seen_by);
    read_modbus(root.table("modbus"), config.modbus);
    read_serial(root.table("serial"), config.serial);
    read_plc(root.table("plc"), config.plc, config.core);
    read_inspection(root.table("inspection"), config.inspection, folder, config.sensor);
    read_optics(root.table("optics"), config.optics);
    read_store(root.table("store"), config.store, folder);
    root.refuse_unknown_keys();
    for (const std::string& problem : problems(config.core)) {  // "what: cure"
        const auto end = std::min(problem.find(": "), problem.size());
        found.add(fmt::format("{}: {}", name, problem.substr(0, end)),
                  problem.substr(std::min(end + 2, problem.size())));
    }
    if (!found.empty()) return found.as_error();
    return config;
}

}  // namespace

std::vector<modbus::AccessRule> TcpServer::default_access() {
    TomlProblems none;
    TomlTable empty = TomlTable::parse_text("", "defaults", none);
    return hord::firmware::access(empty);
}

Result<Config> load_config(const std::filesystem::path& file, NamedBackends backends) {
    if (auto right = common::require_kind(file, common::FileKind::configuration); !right)
        return tl::unexpected(right.error());
    TomlProblems found;
    TomlTable root = TomlTable::parse_file(file, found);
    if (!found.empty()) return found.as_error();
    auto config = read(std::move(root), file.string(), file.parent_path(), backends, found);
    if (config) config->file = file;
    return config;
}

Result<Config> parse_config(std::string_view text, std::string_view name, const std::filesystem::path& folder,
                            NamedBackends backends) {
    TomlProblems found;
    TomlTable root = TomlTable::parse_text(text, name, found);
    if (!found.empty()) return found.as_error();
    return read(std::move(root), name, folder, backends, found);
}

std::filesystem::path store_folder(const Config& config) {
    if (!config.store.enabled) return {};
    if (!config.store.folder.empty()) return config.store.folder;
    return config.state_folder.empty() ? std::filesystem::path() : config.state_folder / "store";
}

std::vector<Error> notes(const Config& config) {
    std::vector<Error> found;
    const auto add = [&](const char* what, const char* cure) {
        found.push_back({ErrorCode::invalid_argument, what, cure});
    };
    if (std::holds_alternative<SimulatedSensor>(config.sensor)) {
        if (!config.strobe.simulated())
            add("the sensor is simulated and the strobe is not: a simulated sensor sees simulated light alone, so "
                "every "
                "part is rejected as too-dark",
                "set strobe.backend to \"simulated\", or name the camera in [sensor]");
    } else if (!std::holds_alternative<FrameFolder>(config.sensor) && config.strobe.simulated()) {
        const auto* const genicam = std::get_if<drivers::GenicamSensorOptions>(&config.sensor);
        if (genicam != nullptr && genicam->trigger == drivers::CameraTrigger::line)
            add("the camera is triggered by a line and the strobe is simulated: no wire rises, so no frame comes",
                "set sensor.trigger to \"software\" for a trial, or describe the light in [strobe]");
        else
            add("the strobe is simulated and the camera is not: no light of this station falls on the parts",
                "light them by hand for a trial, or describe the light in [strobe]");
    }
    if (config.name.size() > common::kNameBytes) {
        const std::string_view held = common::utf8_prefix(config.name, common::kNameBytes);
        found.push_back({ErrorCode::invalid_argument,
                         fmt::format("station.name has {} bytes, and registers hold {} of them (\"{}\")",
                                     config.name.size(), common::kNameBytes, held),
                         "shorten it"});
    }
    if (auto cut = common::may_have_lost_its_end(config.file)) found.push_back(std::move(*cut));
    return found;
}

}  // namespace hord::firmware
