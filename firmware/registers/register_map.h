// The register map: one table for encoding, decoding and documentation of the registers (docs/registers.md).
//
// To add a register: its row (station_blocks.h or plc_blocks.h), its value and kMapVersion (register_values.h), and
// where the value is filled. Then print docs/registers.md again. A released row keeps its address, type and scale.
//
// Registers have 16 bits; a value of 32 bits has its high word first. docs/registers.md says how text, values that are
// not available, and the chain of blocks are represented.
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
    bool nullable = false;  // "not available" may be written, too; `meaning` says what it means then
    std::string_view meaning = {};
    std::span<const NamedValue> values = {};  // names of values; of a bit set: of bits
    // Exactly one of the two, by type. No number: not available.
    std::optional<double> (*number)(const RegisterValues&) = nullptr;
    std::string_view (*text)(const RegisterValues&) = nullptr;
};

enum class BlockId : std::uint16_t {
    gap = 0,  // unused addresses up to the next block; reading inside is exception 02
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
    std::uint16_t slots = 0, slot_words = 0;  // of a ring buffer: `registers` are those of slot 0
    [[nodiscard]] constexpr std::uint16_t size() const { return static_cast<std::uint16_t>(length + kBlockHeader); }
};

// All blocks by ascending address, the terminator last.
[[nodiscard]] std::span<const Block> register_blocks();
[[nodiscard]] const Block* find_block(BlockId id);
[[nodiscard]] const Register* find_register(BlockId id, std::string_view name);

// CRC-32 (IEEE 802.3) over every row's address, type, width, name, unit, scale and access.
[[nodiscard]] std::uint32_t map_crc32();

// Encodes a block with its header (block.size() registers), or one slot of a ring (block.slot_words registers).
void encode(const Block& block, const RegisterValues& source, std::span<std::uint16_t> image);
void encode_slot(const Block& ring, const RegisterValues& source, std::span<std::uint16_t> slot);

// Result `sequence` is in slot (sequence mod kRingSlots).
inline constexpr std::uint16_t kRingSlots = 256;
inline constexpr std::uint16_t kRingBase = 1000;  // of slot 0
inline constexpr std::uint16_t kResultWords = 24;
constexpr std::uint16_t address_of_result(std::uint32_t sequence) {
    return static_cast<std::uint16_t>(kRingBase + kResultWords * (sequence % kRingSlots));
}

// CRC-32 (IEEE 802.3) over registers in transmission order: high byte first.
[[nodiscard]] std::uint32_t crc32_of(std::span<const std::uint16_t> words);

// One decoded register, for people: number in its unit and text ("6 Ready", "0.935", "run_permit, line_stop";
// "-" when not available).
struct Reading {
    const Register* what = nullptr;
    std::optional<double> number;
    std::string text;
};

// `image`: registers read from block.base on, with the header. Rows behind its end are left out (an older station).
// Fails with unreadable when the header is not this block's.
[[nodiscard]] Result<std::vector<Reading>> decode(const Block& block, std::span<const std::uint16_t> image);
// One slot of a ring. Fails with busy when its two sequence numbers differ: it was overwritten during the read.
[[nodiscard]] Result<std::vector<Reading>> decode_slot(const Block& ring, std::span<const std::uint16_t> slot);

// The map as "md", "csv", "json", constants of Structured Text ("st"), or a configuration of "telegraf".
[[nodiscard]] std::string format_registers(std::string_view format);

[[nodiscard]] std::string_view name_of(RegisterType type);

}  // namespace hord::firmware
