// The register map as Markdown, CSV, JSON, Structured Text and Telegraf configuration.
#include <cctype>
#include <optional>
#include <set>

#include <fmt/format.h>
#include <nlohmann/json.hpp>

#include "firmware/registers/register_map.h"

namespace hord::firmware {
namespace {

std::string values_of(const Register& row) {
    std::string text;
    const bool bits = row.type == RegisterType::bits16 || row.type == RegisterType::bits32;
    for (const NamedValue& value : row.values) {
        text += fmt::format("{}{}{} {}", text.empty() ? "" : ", ", bits ? "bit " : "", value.value, value.name);
    }
    return text;
}

// The number in the register that means "not available"; none: the row is always available.
std::optional<std::int64_t> sentinel_of(RegisterType type) {
    switch (type) {
        case RegisterType::u16: return 0xFFFF;
        case RegisterType::s16: return -0x8000;
        case RegisterType::u32: return 0xFFFFFFFF;
        case RegisterType::s32: return -0x80000000LL;
        case RegisterType::bits16:
        case RegisterType::bits32:
        case RegisterType::text: break;
    }
    return std::nullopt;
}

std::string upper(std::string_view text) {
    std::string out;
    for (const char c : text) {
        const bool letter = std::isalnum(static_cast<unsigned char>(c)) != 0;
        out += letter ? static_cast<char>(std::toupper(static_cast<unsigned char>(c))) : '_';
    }
    return out;
}

std::string measurement_of(const Block& block) {
    std::string out = "hord_";
    for (const char c : block.name) out += static_cast<char>(std::tolower(static_cast<unsigned char>(c)));
    return out;
}

std::string_view name_of(RegisterAccess access) { return access == RegisterAccess::read ? "r" : "rw"; }

constexpr char kMarkdownHead[] = R"(# Register map

<!-- Generated: hordctl registers --format md > docs/registers.md. A test compares it with the code. -->

Map version {}, CRC-32 0x{:08X}. Addresses count from 0, as they travel in the request; tools that count from 1 add one.

- Holding registers (FC 3) and input registers (FC 4) show the same values.
- 32-bit values: high word first. Text: UTF-8, first byte in the high byte, padded with zeros.
- Whole numbers, no floats: value in its unit = register * scale.
- Not available: 0xFFFF (u16), 0x8000 (s16), 0xFFFFFFFF (u32), 0x80000000 (s32). Values beyond the range stop one short
  of it. bits16 and bits32 (bit sets, checksums, free-running counters) are always available. Registers of a block that
  no row names read 0xFFFF.
- The map is a chain: every block begins with [id, length]; the next block begins `length` registers after that header;
  id 0xFFFF ends it. Skip ids that you do not know. Id 0 leads across addresses that do not exist (exception 02).
- One request sees one moment: read a block whole (at most 125 registers) and its values belong together.
- Bits (FC 1 and 2): 0 to 15 are STATUS `bits`, 16 to 47 `faults_active`, 48 to 79 `faults_latched`; 80 is the lowest
  bit of the PLC's `heartbeat`, the only bit that can be written.
- Only rows marked rw can be written, whole values at a time; a value that means "not available" cannot (exception 03),
  unless its row says what it means.
- Rows are only ever added. Check `magic` for the byte order, and `map_version` or `map_crc32` for the map.
)";

std::string as_markdown() {
    std::string out = fmt::format(kMarkdownHead, kMapVersion, map_crc32());
    for (const Block& block : register_blocks()) {
        if (block.registers.empty()) continue;
        out += fmt::format("\n## {} at {}\n\n{}. Id {}, length {}.\n\n", block.name, block.base, block.meaning,
                           static_cast<int>(block.id), block.length);
        if (block.slots > 0) {
            out += fmt::format("{} slots of {} registers; the addresses below are those of slot 0.\n\n", block.slots,
                               block.slot_words);
        }
        out +=
            "| address | name | type | registers | unit | scale | access | meaning "
            "|\n|---|---|---|---|---|---|---|---|\n";
        for (const Register& row : block.registers) {
            const std::string values = values_of(row);
            out += fmt::format("| {} | `{}` | {} | {} | {} | {} | {} | {}{}{} |\n", row.address, row.name,
                               firmware::name_of(row.type), row.words, row.unit, row.scale, name_of(row.access),
                               row.meaning, values.empty() ? "" : "; ", values);
        }
    }
    return out;
}

std::string as_csv() {
    std::string out = "block,address,name,type,registers,unit,scale,access,meaning,values\n";
    const auto field = [](std::string_view text) {
        std::string doubled;
        for (const char c : text) doubled += c == '"' ? std::string("\"\"") : std::string(1, c);
        return '"' + doubled + '"';
    };
    for (const Block& block : register_blocks()) {
        for (const Register& row : block.registers) {
            out += fmt::format("{},{},{},{},{},{},{},{},{},{}\n", block.name, row.address, row.name,
                               firmware::name_of(row.type), row.words, row.unit, row.scale, name_of(row.access),
                               field(row.meaning), field(values_of(row)));
        }
    }
    return out;
}

std::string as_json() {
    using Json = nlohmann::ordered_json;
    Json blocks = Json::array();
    for (const Block& block : register_blocks()) {
        if (block.registers.empty()) continue;
        Json registers = Json::array();
        for (const Register& row : block.registers) {
            Json values = Json::object();
            for (const NamedValue& value : row.values) values[std::to_string(value.value)] = value.name;
            registers.push_back({{"address", row.address},
                                 {"name", row.name},
                                 {"type", firmware::name_of(row.type)},
                                 {"registers", row.words},
                                 {"unit", row.unit},
                                 {"scale", row.scale},
                                 {"access", name_of(row.access)},
                                 {"not_available", sentinel_of(row.type) ? Json(*sentinel_of(row.type)) : Json()},
                                 {"meaning", row.meaning},
                                 {"values", std::move(values)}});
        }
        blocks.push_back({{"id", static_cast<int>(block.id)},
                          {"name", block.name},
                          {"base", block.base},
                          {"length", block.length},
                          {"slots", block.slots},
                          {"slot_registers", block.slot_words},
                          {"meaning", block.meaning},
                          {"registers", std::move(registers)}});
    }
    return Json{{"map_version", kMapVersion}, {"map_crc32", map_crc32()}, {"blocks", std::move(blocks)}}.dump(1) + "\n";
}

// Constants of IEC 61131-3: addresses, bit masks, codes. Codes that two rows share are written once, of the row that a
// PLC writes.
std::string as_structured_text() {
    std::string out = fmt::format(
        "(* Generated: hordctl registers --format st > deploy/plc/hord_registers.st. Map version {}. *)\n\n"
        "VAR_GLOBAL CONSTANT\n    HORD_MAP_VERSION : UINT := {};\n    HORD_MAP_CRC32 : UDINT := {};\n"
        "    HORD_RING_SLOTS : UINT := {};\n    HORD_RESULT_WORDS : UINT := {};\n",
        kMapVersion, kMapVersion, map_crc32(), kRingSlots, kResultWords);
    const auto is_bits = [](const Register& row) {
        return row.type == RegisterType::bits16 || row.type == RegisterType::bits32;
    };
    std::set<std::pair<const NamedValue*, bool>> written, of_a_writable_row;
    for (const Block& block : register_blocks()) {
        for (const Register& row : block.registers) {
            if (row.access == RegisterAccess::read_write) of_a_writable_row.emplace(row.values.data(), is_bits(row));
        }
    }
    for (const Block& block : register_blocks()) {
        if (block.registers.empty() || block.id == BlockId::last) continue;  // RING has the same rows
        const bool slots = block.slots > 0;
        out += fmt::format("\n    (* {}: {} *)\n    HORD_{} : UINT := {};\n", block.name, block.meaning, block.name,
                           slots ? kRingBase : block.base);
        for (const Register& row : block.registers) {
            const std::string name = fmt::format("HORD_{}_{}", block.name, upper(row.name));
            out += fmt::format("    {} : UINT := {};{}\n", name, row.address - (slots ? kRingBase : 0),
                               slots ? "    (* from the slot's first register *)" : "");
            const std::pair names(row.values.data(), is_bits(row));
            if (row.values.empty() || (row.access == RegisterAccess::read && of_a_writable_row.contains(names)))
                continue;
            if (!written.insert(names).second) continue;
            for (const NamedValue& value : row.values) {
                if (row.type == RegisterType::bits16) {
                    out += fmt::format("    {}_{} : WORD := 16#{:04X};\n", name, upper(value.name), 1U << value.value);
                } else if (row.type == RegisterType::bits32) {
                    out += fmt::format("    {}_{} : DWORD := 16#{:08X};\n", name, upper(value.name), 1U << value.value);
                } else {
                    out += fmt::format("    {}_{} : UINT := {};\n", name, upper(value.name), value.value);
                }
            }
        }
    }
    return out + "END_VAR\n";
}

// Removes fields that are "not available". Telegraf has scaled them, so half a step decides.
constexpr char kTelegrafProcessor[] = R"(
# Removes what is "not available", so that no series shows the number that stands for it.
[[processors.starlark]]
  namepass = ["hord_*"]
  source = '''
NOT_AVAILABLE = {{
{}}}

def apply(metric):
    for name, (value, half_step) in NOT_AVAILABLE.get(metric.name, {{}}).items():
        if name in metric.fields:
            difference = metric.fields[name] - value
            if difference < half_step and difference > -half_step:
                metric.fields.pop(name)
    return metric
'''
)";

// Telegraf's modbus input, one request a block, and a processor that removes values that are not available.
std::string as_telegraf() {
    std::string out =
        "[[inputs.modbus]]\n"
        "  name = \"hord\"\n"
        "  controller = \"tcp://localhost:502\"\n"
        "  timeout = \"1s\"\n"
        "  configuration_type = \"request\"\n";
    std::string sentinels;
    for (const Block& block : register_blocks()) {
        if (block.id == BlockId::ident || block.registers.empty()) continue;
        const std::string measurement = measurement_of(block);
        out += fmt::format(
            "\n  [[inputs.modbus.request]]\n    slave_id = 1\n    byte_order = \"ABCD\"\n    register = "
            "\"holding\"\n"
            "    measurement = \"{}\"\n    fields = [\n",
            measurement);
        std::string of_block;
        for (const Register& row : block.registers) {
            if (row.type == RegisterType::text) continue;
            const bool is_signed = row.type == RegisterType::s16 || row.type == RegisterType::s32;
            out += fmt::format("      {{ address = {}, name = \"{}\", type = \"{}{}\"{} }},\n", row.address, row.name,
                               is_signed ? "INT" : "UINT", row.words == 2 ? "32" : "16",
                               row.scale != 1 ? fmt::format(", scale = {}", row.scale) : "");
            if (const auto sentinel = sentinel_of(row.type)) {
                of_block += fmt::format("{}\"{}\": ({}, {})", of_block.empty() ? "" : ", ", row.name,
                                        static_cast<double>(*sentinel) * row.scale, row.scale / 2);
            }
        }
        out += "    ]\n";
        if (!of_block.empty()) sentinels += fmt::format("    \"{}\": {{{}}},\n", measurement, of_block);
    }
    return out + fmt::format(kTelegrafProcessor, sentinels);
}

}  // namespace

std::string format_registers(std::string_view format) {
    return format == "csv"     ? as_csv()
        : format == "json"     ? as_json()
        : format == "st"       ? as_structured_text()
        : format == "telegraf" ? as_telegraf()
                               : as_markdown();
}

}  // namespace hord::firmware
