#include "firmware/registers/register_map.h"

#include <algorithm>
#include <array>
#include <cmath>

#include <fmt/format.h>

#include "common/crc32.h"
#include "common/utf8.h"

namespace hord::firmware {
namespace {

bool is_bits(RegisterType type) { return type == RegisterType::bits16 || type == RegisterType::bits32; }
bool is_signed(RegisterType type) { return type == RegisterType::s16 || type == RegisterType::s32; }

// The whole number that means "not available", or empty for types that have none.
std::optional<std::int64_t> sentinel_of(RegisterType type) {
    switch (type) {
        case RegisterType::u16: return 0xFFFF;
        case RegisterType::s16: return -0x8000;
        case RegisterType::u32: return 0xFFFFFFFFLL;
        case RegisterType::s32: return -0x80000000LL;
        case RegisterType::bits16:
        case RegisterType::bits32:
        case RegisterType::text: break;
    }
    return std::nullopt;
}

// Rounds to nearest and stops one short of the sentinel, so that no value is mistaken for "not available".
std::int64_t whole_number(const Register& row, std::optional<double> value) {
    const auto sentinel = sentinel_of(row.type);
    if (!value || std::isnan(*value)) return sentinel.value_or(0);
    const double wide = std::round(*value / row.scale);
    const double most = row.words == 2 ? 4294967295.0 : 65535.0;
    if (is_bits(row.type)) return static_cast<std::int64_t>(std::clamp(wide, 0.0, most));
    const double low = is_signed(row.type) ? -(most - 1) / 2 : 0;
    const double high = is_signed(row.type) ? (most - 1) / 2 : most - 1;
    return static_cast<std::int64_t>(std::clamp(wide, low, high));
}

void put(const Register& row, std::span<std::uint16_t> words, const RegisterValues& source) {
    if (row.type == RegisterType::text) {
        const std::string_view text = common::utf8_prefix(row.text(source), 2 * words.size());
        for (std::size_t k = 0; k < words.size(); ++k) {
            const auto at = [&](std::size_t c) { return c < text.size() ? static_cast<unsigned char>(text[c]) : 0U; };
            words[k] = static_cast<std::uint16_t>(at(2 * k) << 8U | at(2 * k + 1));
        }
        return;
    }
    const auto raw = static_cast<std::uint64_t>(whole_number(row, row.number(source)));
    if (row.words == 2) words[0] = static_cast<std::uint16_t>(raw >> 16U & 0xFFFFU);
    words[row.words - 1U] = static_cast<std::uint16_t>(raw & 0xFFFFU);
}

std::string_view name_among(std::span<const NamedValue> values, std::uint32_t value) {
    const auto found = std::ranges::find(values, value, &NamedValue::value);
    return found == values.end() ? std::string_view{} : found->name;
}

// Bytes that are no UTF-8, and control characters, which must not reach a terminal, become question marks.
std::string printable(std::string_view bytes) {
    std::string out;
    while (!bytes.empty()) {
        const std::size_t length = common::utf8_length(bytes);
        const auto second = static_cast<unsigned char>(length == 2 ? bytes[1] : 0);
        const bool control = length == 1 ? bytes[0] < 0x20 || bytes[0] == 0x7F : bytes[0] == '\xC2' && second < 0xA0;
        if (length == 0 || control) out += '?';
        else out += bytes.substr(0, length);
        bytes.remove_prefix(std::max<std::size_t>(length, 1));
    }
    return out;
}

Reading take(const Register& row, std::span<const std::uint16_t> words) {
    Reading reading{.what = &row, .number = {}, .text = "-"};
    if (row.type == RegisterType::text) {
        std::string bytes;
        for (const std::uint16_t word : words) {
            if (word == 0xFFFF) break;  // an older station: it has no such row
            bytes += static_cast<char>(word >> 8U);
            bytes += static_cast<char>(word & 0xFFU);
        }
        bytes.resize(std::min(bytes.find('\0'), bytes.size()));
        reading.text = printable(bytes);
        return reading;
    }
    const std::uint32_t raw = row.words == 2 ? std::uint32_t{words[0]} << 16U | words[1] : words[0];
    std::int64_t whole = raw;
    if (row.type == RegisterType::s16) whole = static_cast<std::int16_t>(raw);
    if (row.type == RegisterType::s32) whole = static_cast<std::int32_t>(raw);
    if (whole == sentinel_of(row.type)) return reading;
    // Scales below 1 are powers of ten: the quotient is the double nearest to the decimal number, and prints as it.
    reading.number =
        row.scale < 1 ? static_cast<double>(whole) / std::round(1 / row.scale) : static_cast<double>(whole) * row.scale;

    if (is_bits(row.type) && !row.values.empty()) {
        std::vector<std::string> on;
        for (std::uint32_t bit = 0; bit < 32; ++bit) {
            if ((raw >> bit & 1U) == 0) continue;
            const auto name = name_among(row.values, bit);
            on.push_back(name.empty() ? fmt::format("bit {}", bit) : std::string(name));
        }
        reading.text = on.empty() ? "none" : fmt::format("{}", fmt::join(on, ", "));
    } else if (is_bits(row.type)) {
        reading.text = row.words == 2 ? fmt::format("0x{:08X}", raw) : fmt::format("{}", raw);
    } else if (const auto name = name_among(row.values, raw); !name.empty()) {
        reading.text = fmt::format("{} {}", whole, name);
    } else if (row.scale != 1) {
        reading.text = fmt::format("{:.{}f}", *reading.number, static_cast<int>(std::ceil(-std::log10(row.scale))));
    } else {
        reading.text = fmt::format("{}", whole);
    }
    return reading;
}

// The image's registers from `base` on.
void encode_rows(const Block& block, std::size_t base, const RegisterValues& source, std::span<std::uint16_t> image) {
    std::fill(image.begin(), image.end(), std::uint16_t{0xFFFF});
    for (const Register& row : block.registers) put(row, image.subspan(row.address - base, row.words), source);
}

std::vector<Reading> decode_rows(std::span<const Register> rows, std::size_t base,
                                 std::span<const std::uint16_t> image) {
    std::vector<Reading> readings;
    for (const Register& row : rows) {
        const std::size_t at = row.address - base;
        if (at + row.words <= image.size()) readings.push_back(take(row, image.subspan(at, row.words)));
    }
    return readings;
}

}  // namespace

std::string_view name_of(RegisterType type) {
    constexpr std::string_view kNames[] = {"u16", "s16", "u32", "s32", "bits16", "bits32", "text"};
    return kNames[static_cast<std::size_t>(type)];
}

const Block* find_block(BlockId id) {
    const auto blocks = register_blocks();
    const auto found = std::ranges::find(blocks, id, &Block::id);
    return found == blocks.end() ? nullptr : &*found;
}

const Register* find_register(BlockId id, std::string_view name) {
    const Block* block = find_block(id);
    if (block == nullptr) return nullptr;
    const auto found = std::ranges::find(block->registers, name, &Register::name);
    return found == block->registers.end() ? nullptr : &*found;
}

std::uint32_t map_crc32() {
    static const std::uint32_t crc = [] {
        std::string lines;
        for (const Block& block : register_blocks()) {
            lines += fmt::format("{},{},{},{}\n", static_cast<int>(block.id), block.base, block.length, block.slots);
            for (const Register& row : block.registers) {
                lines += fmt::format("{},{},{},{},{},{},{}\n", row.address, name_of(row.type), row.words, row.name,
                                     row.unit, row.scale, static_cast<int>(row.access));
            }
        }
        return common::crc32(lines);
    }();
    return crc;
}

std::uint32_t crc32_of(std::span<const std::uint16_t> words) {
    common::Crc32 crc;
    for (const std::uint16_t word : words) {
        crc.add(static_cast<std::uint8_t>(word >> 8U));
        crc.add(static_cast<std::uint8_t>(word & 0xFFU));
    }
    return crc.value();
}

void encode(const Block& block, const RegisterValues& source, std::span<std::uint16_t> image) {
    encode_rows(block, block.base, source, image);
    image[0] = static_cast<std::uint16_t>(block.id);
    image[1] = block.length;
}

void encode_slot(const Block& ring, const RegisterValues& source, std::span<std::uint16_t> slot) {
    encode_rows(ring, ring.base + std::size_t{kBlockHeader}, source, slot);
}

Result<std::vector<Reading>> decode(const Block& block, std::span<const std::uint16_t> image) {
    if (image.size() < kBlockHeader || image[0] != static_cast<std::uint16_t>(block.id)) {
        return fail(ErrorCode::unreadable, fmt::format("register {} does not begin block {}", block.base, block.name),
                    "find the block by walking the chain from register 0");
    }
    const auto there = std::min<std::size_t>(image.size(), std::size_t{image[1]} + kBlockHeader);
    return decode_rows(block.registers, block.base, image.first(there));
}

Result<std::vector<Reading>> decode_slot(const Block& ring, std::span<const std::uint16_t> slot) {
    const std::size_t size = slot.size();
    if (size != ring.slot_words || slot[0] != slot[size - 2] || slot[1] != slot[size - 1]) {
        return fail(ErrorCode::busy, fmt::format("the slot of {} was overwritten while it was read", ring.name),
                    "read it in one request");
    }
    return decode_rows(ring.registers, ring.base + std::size_t{kBlockHeader}, slot);
}

}  // namespace hord::firmware
