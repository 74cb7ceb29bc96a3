// The register map: one table, from which come the registers' images, their documentation and their decoding.
//
// 16-bit registers; 32-bit values high word first; text in ASCII, first character in the high byte, padded
// with zeros. Scaled whole numbers, no floats. A value that is not available reads 0xFFFF (u16), 0x8000
// (s16), 0xFFFFFFFF (u32), 0x80000000 (s32); values beyond the range stop one short of that. Bit sets and
// free-running counters (bits16, bits32) have no such value. Registers of a block that no row names read
// 0xFFFF.
//
// The map is a chain: every block begins with [id, length], the next block begins `length` registers after
// that header, and the chain ends with id 0xFFFF. A reader walks it from address 0 and skips ids it does not
// know. Addresses are append-only: a row, once released, keeps its address, type and scale for ever.
#pragma once

#include <cstdint>
#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "common/result.h"
#include "firmware/registers/register_values.h"

namespace hord::firmware {

inline constexpr std::uint32_t kMapMagic = 0x484F5244;  // "HORD"
inline constexpr std::uint16_t kBlockHeader = 2;        // registers [id, length]
inline constexpr std::uint16_t kMaxRead = 125;          // registers in one request: a block is one coherent read

enum class RegisterType : std::uint8_t { u16, s16, u32, s32, bits16, bits32, text };
enum class RegisterAccess : std::uint8_t { read, read_write };

struct NamedValue {
    std::uint32_t value;  // of a bit set: the bit's number
    std::string_view name;
};

struct Register {
    std::uint16_t address = 0;
    RegisterType type = RegisterType::u16;
    std::uint16_t words = 1;
    std::string_view name = {};  // unique in its block
    std::string_view unit = {};
    double scale = 1;  // value in `unit` = scale * number in the register
    RegisterAccess access = RegisterAccess::read;
    std::string_view meaning = {};
    std::span<const NamedValue> values = {};  // names of values, or of bits
    // Exactly one of the two, by type. Empty: not available.
    std::optional<double> (*number)(const RegisterValues&) = nullptr;
    std::string_view (*text)(const RegisterValues&) = nullptr;
};

enum class BlockId : std::uint16_t {
    gap = 0,  // addresses that lead to the next block; reading inside is exception 02
    ident = 1,
    status = 2,
    counters = 3,
    last = 4,
    ring = 5,
    command = 6,
    reply = 7,
    plc = 8,
    recipe = 9,
    health = 10,
    calibration = 11,
    end = 0xFFFF,
};

struct Block {
    BlockId id = BlockId::gap;
    std::string_view name;
    std::uint16_t base = 0;    // address of the header
    std::uint16_t length = 0;  // registers after the header
    std::string_view meaning;
    std::span<const Register> registers;
    std::uint16_t slots = 0, slot_words = 0;  // of a ring: `registers` are those of slot 0
    [[nodiscard]] constexpr std::uint16_t size() const { return static_cast<std::uint16_t>(length + kBlockHeader); }
};

// Every block in the order of its address, the terminator last.
[[nodiscard]] std::span<const Block> register_blocks();
[[nodiscard]] const Block* find_block(BlockId id);
[[nodiscard]] const Register* find_register(BlockId id, std::string_view name);

// CRC-32 (IEEE 802.3) over every row's address, type, width, name, unit, scale and access.
[[nodiscard]] std::uint32_t map_crc32();

// The whole block with its header, of block.size() registers; of a ring, one slot, of block.slot_words.
void encode(const Block& block, const RegisterValues& source, std::span<std::uint16_t> image);
void encode_slot(const Block& ring, const RegisterValues& source, std::span<std::uint16_t> slot);

// Results 1, 2, ... stand at slot (sequence mod kRingSlots).
inline constexpr std::uint16_t kRingSlots = 256;
inline constexpr std::uint16_t kRingBase = 1000;  // of slot 0
inline constexpr std::uint16_t kResultWords = 24;
constexpr std::uint16_t address_of_result(std::uint32_t sequence) {
    return static_cast<std::uint16_t>(kRingBase + kResultWords * (sequence % kRingSlots));
}

// CRC-32 (IEEE 802.3) over registers as they travel: high byte first.
[[nodiscard]] std::uint32_t crc32_of(std::span<const std::uint16_t> words);

// One decoded register, for people: number in its unit and text ("6 Ready", "0.935", "run_permit, line_stop";
// "-" when not available).
struct Reading {
    const Register* what = nullptr;
    std::optional<double> number;
    std::string text;
};

// `image` as read from `block.base`, header included; rows beyond what was read are left out (an older
// station). Fails with unreadable when the header is not this block's.
[[nodiscard]] Result<std::vector<Reading>> decode(const Block& block, std::span<const std::uint16_t> image);
// One slot of a ring. Fails with busy when its sequences differ: it was overwritten while it was read.
[[nodiscard]] Result<std::vector<Reading>> decode_slot(const Block& ring, std::span<const std::uint16_t> slot);

enum class MapFormat : std::uint8_t { markdown, csv, json, telegraf };
[[nodiscard]] std::optional<MapFormat> map_format_of(std::string_view name);  // md, csv, json, telegraf
[[nodiscard]] std::string format_registers(MapFormat format);

[[nodiscard]] std::string_view name_of(RegisterType type);

}  // namespace hord::firmware
