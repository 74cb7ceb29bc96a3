// An array for other programs, and NumPy's file of one (.npy, version 1.0).
#pragma once

#include <cstddef>
#include <cstdint>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "common/result.h"

namespace hord::firmware {

enum class ArrayType : std::uint8_t { uint8, uint16, float32 };
[[nodiscard]] std::size_t bytes_of(ArrayType type);

// Elements row by row (C order), in this machine's byte order, which is little-endian.
struct Array {
    ArrayType type = ArrayType::uint8;
    std::vector<std::size_t> shape;
    std::vector<std::byte> bytes;

    [[nodiscard]] std::size_t count() const;
};

// The file's bytes.
[[nodiscard]] std::vector<std::uint8_t> encode_npy(const Array& array);

// Reads uint8 and uint16 in C order. Fails with unreadable (not .npy, truncated), unsupported (another type, Fortran
// order, big-endian). `name` is used in the message.
Result<Array> decode_npy(std::span<const std::byte> bytes, std::string_view name);

}  // namespace hord::firmware
