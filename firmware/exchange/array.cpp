#include "firmware/exchange/array.h"

#include <algorithm>
#include <charconv>
#include <cstring>

#include <fmt/format.h>
#include <fmt/ranges.h>

#include "common/frame_size.h"

namespace hord::firmware {
namespace {

constexpr std::string_view kMagic = "\x93NUMPY";

std::string_view descr(ArrayType type) {
    constexpr std::string_view names[] = {"|u1", "<u2", "<f4"};
    return names[static_cast<std::size_t>(type)];
}

// What follows 'KEY': in the header, a Python dict of fixed form.
std::string_view value_of(std::string_view header, std::string_view key) {
    const auto at = header.find(key);
    if (at == std::string_view::npos) return {};
    auto rest = header.substr(at + key.size());
    rest.remove_prefix(std::min(rest.find_first_not_of(" :"), rest.size()));
    return rest;
}

}  // namespace

std::size_t bytes_of(ArrayType type) { return type == ArrayType::uint8 ? 1 : type == ArrayType::uint16 ? 2 : 4; }

std::size_t Array::count() const {
    std::size_t count = 1;
    for (const std::size_t side : shape) count *= side;
    return count;
}

std::vector<std::uint8_t> encode_npy(const Array& array) {
    std::string header = fmt::format("{{'descr': '{}', 'fortran_order': False, 'shape': ({}{}), }}", descr(array.type),
                                     fmt::join(array.shape, ", "), array.shape.size() == 1 ? "," : "");
    // The data begin at a multiple of 64 bytes.
    const std::size_t before = kMagic.size() + 4;
    header.append((64 - (before + header.size() + 1) % 64) % 64, ' ');
    header += '\n';
    std::string head(kMagic);
    head += {'\1', '\0', static_cast<char>(header.size() & 0xFFU), static_cast<char>(header.size() >> 8U)};
    head += header;
    std::vector<std::uint8_t> out(head.size() + array.bytes.size());
    std::memcpy(out.data(), head.data(), head.size());
    std::memcpy(out.data() + head.size(), array.bytes.data(), array.bytes.size());
    return out;
}

Result<Array> decode_npy(std::span<const std::byte> bytes, std::string_view name) {
    const std::string_view text(reinterpret_cast<const char*>(bytes.data()), bytes.size());
    const auto damaged = [&] {
        return fail(ErrorCode::unreadable, std::string(name) + " is no .npy file, or is cut off", "save it again");
    };
    if (text.size() < 12 || !text.starts_with(kMagic)) return damaged();
    const bool first = text[6] == 1;
    const std::size_t sized = first ? 2 : 4;
    std::size_t length = 0;
    for (std::size_t k = 0; k < sized; ++k)
        length |= static_cast<std::size_t>(static_cast<unsigned char>(text[8 + k])) << (8 * k);
    if (length > text.size() - 8 - sized) return damaged();
    const std::string_view header = text.substr(8 + sized, length);
    Array array;
    const std::string_view type = value_of(header, "'descr'");
    if (type.starts_with("'|u1'")) array.type = ArrayType::uint8;
    else if (type.starts_with("'<u2'")) array.type = ArrayType::uint16;
    else if (type.starts_with("'>u2'"))
        return fail(ErrorCode::unsupported, std::string(name) + " holds big-endian uint16",
                    "save it as little-endian: array.astype('<u2')");
    else
        return fail(ErrorCode::unsupported, std::string(name) + " holds no uint8 and no uint16",
                    "save samples as uint8 or uint16");
    if (!value_of(header, "'fortran_order'").starts_with("False"))
        return fail(ErrorCode::unsupported, std::string(name) + " is in Fortran order",
                    "save numpy.ascontiguousarray() of it");
    std::string_view shape = value_of(header, "'shape'");
    std::uint64_t count = 1;
    if (!shape.starts_with('(')) return damaged();
    shape.remove_prefix(1);
    while (!shape.empty() && shape.front() != ')') {
        std::size_t side = 0;
        const auto [end, error] = std::from_chars(shape.data(), shape.data() + shape.size(), side);
        if (error != std::errc{} || side == 0 || side > common::kMaxFrameSamples || array.shape.size() == 8)
            return damaged();
        array.shape.push_back(side);
        if (count > common::kMaxFrameSamples / side) return damaged();
        count *= side;
        shape.remove_prefix(static_cast<std::size_t>(end - shape.data()));
        shape.remove_prefix(std::min(shape.find_first_not_of(", "), shape.size()));
    }
    const std::span<const std::byte> data = bytes.subspan(8 + sized + length);
    if (data.size() != count * bytes_of(array.type)) return damaged();
    array.bytes.assign(data.begin(), data.end());
    return array;
}

}  // namespace hord::firmware
