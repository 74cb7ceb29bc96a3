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

#include "algo/result.h"
#include "firmware/snapshot.h"

#include <cstdint>
#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <vector>

namespace hord::firmware {

// Raised when rows are added; the CRC-32 of the table changes with it (map_crc32()).
inline constexpr std::uint16_t kMapVersion = 1;
inline constexpr std::uint32_t kMapMagic = 0x484F5244;  // "HORD"
inline constexpr std::uint16_t kBlockHeader = 2;        // registers [id, length]
inline constexpr std::uint16_t kMaxRead = 125;  // registers in one request: a block is one coherent read

enum class RegisterType : std::uint8_t { u16, s16, u32, s32, bits16, bits32, text };
enum class RegisterAccess : std::uint8_t { read, read_write };

// Who the station is; the same strings are in Modbus device identification (FC 43/14).
struct StationIdentity {
    std::string vendor = "HORD";
    std::string product = "HORD station";
    std::string firmware;  // version, "0.1.0"
    std::string serial;
    std::uint32_t boot_id = 0;  // another number after every start: a reset of the sequence cannot be misread
};

// What the encoder reads. `result` is the one that a slot or LAST shows.
struct RegisterSource {
    const StationIdentity& identity;
    const Snapshot& snapshot;
    const PartResult& result;
};

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
    std::optional<double> (*number)(const RegisterSource&) = nullptr;
    std::string_view (*text)(const RegisterSource&) = nullptr;
};

enum class BlockId : std::uint16_t {
    gap = 0,  // addresses that lead to the next block; reading inside is exception 02
    ident = 1,
    status = 2,
    counters = 3,
    last = 4,
    end = 0xFFFF,
};

struct Block {
    BlockId id = BlockId::gap;
    std::string_view name;
    std::uint16_t base = 0;    // address of the header
    std::uint16_t length = 0;  // registers after the header
    std::string_view meaning;
    std::span<const Register> registers;
    [[nodiscard]] constexpr std::uint16_t size() const {
        return static_cast<std::uint16_t>(length + kBlockHeader);
    }
};

// Every block in the order of its address, the terminator last.
[[nodiscard]] std::span<const Block> register_blocks();
[[nodiscard]] const Block* find_block(BlockId id);
[[nodiscard]] const Register* find_register(BlockId id, std::string_view name);

// CRC-32 (IEEE 802.3) over every row's address, type, width, name, unit, scale and access.
[[nodiscard]] std::uint32_t map_crc32();

// The whole block with its header. `image` has block.size() registers.
void encode(const Block& block, const RegisterSource& source, std::span<std::uint16_t> image);

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

enum class MapFormat : std::uint8_t { markdown, csv, json, telegraf };
[[nodiscard]] std::optional<MapFormat> map_format_of(std::string_view name);  // md, csv, json, telegraf
[[nodiscard]] std::string format_registers(MapFormat format);

[[nodiscard]] std::string_view name_of(RegisterType type);

}  // namespace hord::firmware
