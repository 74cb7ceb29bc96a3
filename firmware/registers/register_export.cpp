// The register map as Markdown, CSV, JSON and Telegraf configuration.
#include <fmt/format.h>

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

std::string_view name_of(RegisterAccess access) { return access == RegisterAccess::read ? "r" : "rw"; }

std::string as_markdown() {
    std::string out = fmt::format(
        "# Register map\n\n"
        "<!-- Generated: hordctl registers --format md > docs/registers.md. A test compares it with the "
        "code. -->\n\n"
        "Map version {}, CRC-32 0x{:08X}. Addresses count from 0, as they travel in the request; tools that "
        "count from 1 add one.\n\n"
        "- Holding registers (FC 3) and input registers (FC 4) show the same values.\n"
        "- 32-bit values: high word first. Text: ASCII, first character in the high byte, padded with "
        "zeros.\n"
        "- Whole numbers, no floats: value in its unit = register * scale.\n"
        "- Not available: 0xFFFF (u16), 0x8000 (s16), 0xFFFFFFFF (u32), 0x80000000 (s32). Values beyond the "
        "range stop one short of\n"
        "  it. bits16 and bits32 (bit sets, checksums, free-running counters) are always available. "
        "Registers of a block that no\n"
        "  row names read 0xFFFF.\n"
        "- The map is a chain: every block begins with [id, length]; the next block begins `length` "
        "registers after that header;\n"
        "  id 0xFFFF ends it. Skip ids that you do not know. Id 0 leads across addresses that do not exist "
        "(exception 02).\n"
        "- One request sees one moment: read a block whole (at most 125 registers) and its values belong "
        "together.\n"
        "- Bits (FC 1 and 2): 0 to 15 are STATUS `bits`, 16 to 47 `faults_active`, 48 to 79 "
        "`faults_latched`; 80 is the lowest\n"
        "  bit of the PLC's `heartbeat`, the only bit that can be written.\n"
        "- Only rows marked rw can be written, whole values at a time; a value that means \"not available\" "
        "cannot (exception 03).\n"
        "- Rows are only ever added. Check `magic` for the byte order, and `map_version` or `map_crc32` for "
        "the map.\n",
        kMapVersion, map_crc32());
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

std::string quoted(std::string_view text) {
    std::string out = "\"";
    for (const char c : text) {
        if (c == '"' || c == '\\') out += '\\';
        out += c;
    }
    return out + '"';
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
    std::string out = fmt::format("{{\"map_version\": {}, \"map_crc32\": {}, \"blocks\": [", kMapVersion, map_crc32());
    std::string_view comma;
    for (const Block& block : register_blocks()) {
        if (block.registers.empty()) continue;
        out += fmt::format(
            "{}\n  {{\"id\": {}, \"name\": {}, \"base\": {}, \"length\": {}, \"slots\": {}, "
            "\"slot_registers\": {}, "
            "\"meaning\": {}, \"registers\": "
            "[",
            comma, static_cast<int>(block.id), quoted(block.name), block.base, block.length, block.slots,
            block.slot_words, quoted(block.meaning));
        comma = ",";
        std::string_view row_comma;
        for (const Register& row : block.registers) {
            out += fmt::format(
                "{}\n    {{\"address\": {}, \"name\": {}, \"type\": {}, \"registers\": {}, \"unit\": {}, "
                "\"scale\": {}, \"access\": {}, "
                "\"meaning\": {}, \"values\": {{",
                row_comma, row.address, quoted(row.name), quoted(firmware::name_of(row.type)), row.words,
                quoted(row.unit), row.scale, quoted(name_of(row.access)), quoted(row.meaning));
            row_comma = ",";
            std::string_view value_comma;
            for (const NamedValue& value : row.values) {
                out += fmt::format("{}\"{}\": {}", value_comma, value.value, quoted(value.name));
                value_comma = ", ";
            }
            out += "}}";
        }
        out += "]}";
    }
    return out + "\n]}\n";
}

// Telegraf's modbus input, one request a block. Values that are not available arrive as their sentinel.
std::string as_telegraf() {
    std::string out =
        "[[inputs.modbus]]\n"
        "  name = \"hord\"\n"
        "  controller = \"tcp://localhost:502\"\n"
        "  timeout = \"1s\"\n"
        "  configuration_type = \"request\"\n";
    for (const Block& block : register_blocks()) {
        if (block.id == BlockId::ident || block.registers.empty()) continue;
        std::string measurement = "hord_";
        for (const char c : block.name) measurement += static_cast<char>(c >= 'A' && c <= 'Z' ? c - 'A' + 'a' : c);
        out += fmt::format(
            "\n  [[inputs.modbus.request]]\n    slave_id = 1\n    byte_order = \"ABCD\"\n    register = "
            "\"holding\"\n"
            "    measurement = \"{}\"\n    fields = [\n",
            measurement);
        for (const Register& row : block.registers) {
            if (row.type == RegisterType::text) continue;
            const bool is_signed = row.type == RegisterType::s16 || row.type == RegisterType::s32;
            out += fmt::format("      {{ address = {}, name = \"{}\", type = \"{}{}\"{} }},\n", row.address, row.name,
                               is_signed ? "INT" : "UINT", row.words == 2 ? "32" : "16",
                               row.scale != 1 ? fmt::format(", scale = {}", row.scale) : "");
        }
        out += "    ]\n";
    }
    return out;
}

}  // namespace

std::optional<MapFormat> map_format_of(std::string_view name) {
    if (name == "md") return MapFormat::markdown;
    if (name == "csv") return MapFormat::csv;
    if (name == "json") return MapFormat::json;
    if (name == "telegraf") return MapFormat::telegraf;
    return std::nullopt;
}

std::string format_registers(MapFormat format) {
    switch (format) {
        case MapFormat::markdown: return as_markdown();
        case MapFormat::csv: return as_csv();
        case MapFormat::json: return as_json();
        case MapFormat::telegraf: return as_telegraf();
    }
    return {};
}

}  // namespace hord::firmware
