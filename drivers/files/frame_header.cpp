#include "drivers/files/frame_header.h"

#include <algorithm>
#include <array>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "algo/frame/extents.h"
#include "common/crc32.h"

namespace hord::drivers {
namespace {

using Bytes = std::span<const std::byte>;

constexpr std::uint64_t kLargestSide = std::uint64_t{algo::kMaxLenslets} * algo::kMaxBins;
constexpr const char* kRecordAgain = "record or copy it again";
constexpr const char* kUseGrey = "save it as 8- or 16-bit grey PNG, TIFF or binary PGM, one channel";

tl::unexpected<Error> truncated(std::string_view name, const std::string& detail) {
    return fail(ErrorCode::unreadable, std::string(name) + " is truncated (" + detail + ")", kRecordAgain);
}
tl::unexpected<Error> damaged(std::string_view name, const std::string& detail) {
    return fail(ErrorCode::unreadable, std::string(name) + " is damaged (" + detail + ")", kRecordAgain);
}
tl::unexpected<Error> not_grey(std::string_view name, const std::string& detail) {
    return fail(ErrorCode::unsupported, std::string(name) + " is not a grey frame (" + detail + ")", kUseGrey);
}

Result<FrameHeader> checked_size(FrameHeader header, std::uint64_t width, std::uint64_t height, std::string_view name) {
    if (width == 0 || height == 0 || width > kLargestSide || height > kLargestSide) {
        return fail(ErrorCode::unsupported,
                    std::string(name) + " is " + std::to_string(width) + "x" + std::to_string(height) +
                        " pixels; a frame has 1 to " + std::to_string(kLargestSide) + " a side",
                    "give a frame of the lenslet sensor");
    }
    header.width_px = static_cast<int>(width);
    header.height_px = static_cast<int>(height);
    return header;
}

std::uint64_t number(Bytes file, std::size_t at, std::size_t size, bool big_endian) {
    std::uint64_t value = 0;
    for (std::size_t k = 0; k < size; ++k) {
        value = (value << 8U) | std::to_integer<std::uint64_t>(file[at + (big_endian ? k : size - 1 - k)]);
    }
    return value;
}

bool begins_with(Bytes file, std::string_view magic) {
    return file.size() >= magic.size() && std::equal(magic.begin(), magic.end(), file.begin(), [](char c, std::byte b) {
               return static_cast<unsigned char>(c) == std::to_integer<unsigned char>(b);
           });
}

std::uint32_t crc32(Bytes bytes) {
    common::Crc32 crc;
    crc.add(bytes);
    return crc.value();
}

Result<FrameHeader> png_header(Bytes file, std::string_view name) {
    FrameHeader header{.format = FrameHeader::Format::png};
    std::uint64_t width = 0, height = 0;
    for (std::size_t at = 8;;) {  // chunks: length, type, data, checksum
        if (file.size() - at < 12) return truncated(name, "its end chunk is missing");
        const std::uint64_t length = number(file, at, 4, true);
        if (length > file.size() - at - 12) return truncated(name, "a chunk ends behind the file");
        const Bytes type_and_data = file.subspan(at + 4, 4 + static_cast<std::size_t>(length));
        if (crc32(type_and_data) != number(file, at + 8 + static_cast<std::size_t>(length), 4, true)) {
            return damaged(name, "a chunk's checksum is wrong");
        }
        const bool first = at == 8;
        if (first != begins_with(type_and_data, "IHDR") || (first && length != 13))
            return damaged(name, "no PNG header");
        if (first) {
            width = number(file, at + 8, 4, true);
            height = number(file, at + 12, 4, true);
            const auto depth = static_cast<int>(number(file, at + 16, 1, true));
            const auto colour = number(file, at + 17, 1, true);
            constexpr std::array<const char*, 7> kinds = {
                "grey", "", "colour", "palette", "grey with alpha", "", "colour with alpha"};
            if (colour != 0) return not_grey(name, colour < kinds.size() ? kinds[colour] : "unknown colour type");
            if (depth != 8 && depth != 16) return not_grey(name, std::to_string(depth) + " bits a sample");
            header.bits = depth;
        }
        if (begins_with(type_and_data, "IEND")) return checked_size(header, width, height, name);
        at += 12 + static_cast<std::size_t>(length);
    }
}

// TIFF 6.0, classic. Reads only the tags that decide whether the file is a frame.
class TiffDirectory {
  public:
    TiffDirectory(Bytes file, bool big_endian) : file_(file), big_endian_(big_endian) {}

    bool open() {
        const auto at = static_cast<std::size_t>(number(file_, 4, 4, big_endian_));
        if (at < 8 || at > file_.size() || file_.size() - at < 2) return false;
        entries_ = static_cast<std::size_t>(number(file_, at, 2, big_endian_));
        first_ = at + 2;
        return file_.size() - first_ >= entries_ * 12 + 4;
    }
    [[nodiscard]] bool has_next() const { return number(file_, first_ + entries_ * 12, 4, big_endian_) != 0; }

    // All values of a tag. Empty: absent; none: they lie outside the file.
    [[nodiscard]] std::optional<std::vector<std::uint64_t>> values(std::uint64_t tag) const {
        std::vector<std::uint64_t> out;
        for (std::size_t e = 0; e < entries_; ++e) {
            const std::size_t at = first_ + e * 12;
            if (number(file_, at, 2, big_endian_) != tag) continue;
            const std::uint64_t type = number(file_, at + 2, 2, big_endian_);
            const std::uint64_t count = number(file_, at + 4, 4, big_endian_);
            const std::size_t size = type == 1 ? 1 : type == 3 ? 2 : type == 4 ? 4 : 0;
            if (size == 0 || count > file_.size()) return std::nullopt;
            const std::size_t bytes = size * static_cast<std::size_t>(count);
            const std::size_t from =
                bytes <= 4 ? at + 8 : static_cast<std::size_t>(number(file_, at + 8, 4, big_endian_));
            if (from > file_.size() || bytes > file_.size() - from) return std::nullopt;
            for (std::size_t k = 0; k < count; ++k) out.push_back(number(file_, from + k * size, size, big_endian_));
        }
        return out;
    }
    [[nodiscard]] std::uint64_t value(std::uint64_t tag, std::uint64_t absent) const {
        const auto all = values(tag);
        return all && !all->empty() ? all->front() : absent;
    }

  private:
    Bytes file_;
    bool big_endian_;
    std::size_t first_ = 0, entries_ = 0;
};

Result<FrameHeader> tiff_header(Bytes file, std::string_view name) {
    constexpr std::uint64_t kWidth = 256, kHeight = 257, kBits = 258, kPhotometric = 262, kStripOffsets = 273,
                            kOrientation = 274, kSamplesPerPixel = 277, kStripBytes = 279, kTileOffsets = 324,
                            kTileBytes = 325, kSampleFormat = 339;
    constexpr std::uint64_t kMinIsBlack = 1, kUnsigned = 1, kTopLeft = 1, kTransposed = 5;  // and 6 to 8
    FrameHeader header{.format = FrameHeader::Format::tiff};
    TiffDirectory directory(file, begins_with(file, "MM"));
    if (file.size() < 8 || !directory.open()) return truncated(name, "its directory is missing");
    if (directory.has_next()) {
        return fail(ErrorCode::unsupported, std::string(name) + " holds more than one image",
                    "split it, one frame a file");
    }
    if (const auto samples = directory.value(kSamplesPerPixel, 1); samples != 1) {
        return not_grey(name, std::to_string(samples) + " samples a pixel");
    }
    if (directory.value(kPhotometric, kMinIsBlack) != kMinIsBlack)
        return not_grey(name, "palette, colour or inverted grey");
    header.bits = static_cast<int>(directory.value(kBits, 1));
    if (directory.value(kSampleFormat, kUnsigned) != kUnsigned)
        return not_grey(name, "samples are not unsigned integers");
    if (header.bits != 8 && header.bits != 16) return not_grey(name, std::to_string(header.bits) + " bits a sample");

    std::size_t parts = 0;
    for (const auto& [offsets_tag, bytes_tag] :
         {std::pair{kStripOffsets, kStripBytes}, std::pair{kTileOffsets, kTileBytes}}) {
        const auto offsets = directory.values(offsets_tag), bytes = directory.values(bytes_tag);
        if (!offsets || !bytes || offsets->size() != bytes->size())
            return truncated(name, "the table of its parts is cut off");
        for (std::size_t k = 0; k < offsets->size(); ++k, ++parts) {
            if ((*offsets)[k] > file.size() || (*bytes)[k] > file.size() - (*offsets)[k]) {
                return truncated(name, "samples lie behind the end of the file");
            }
        }
    }
    if (parts == 0) return damaged(name, "it has no samples");
    std::uint64_t width = directory.value(kWidth, 0), height = directory.value(kHeight, 0);
    if (directory.value(kOrientation, kTopLeft) >= kTransposed) std::swap(width, height);
    return checked_size(header, width, height, name);
}

// "P5", width, height, maximum, each after white space or a comment; then one white space and the samples.
Result<FrameHeader> pgm_header(Bytes file, std::string_view name) {
    FrameHeader header{.format = FrameHeader::Format::pgm};
    std::size_t at = 2;
    const auto byte = [&] { return at < file.size() ? std::to_integer<char>(file[at]) : '\0'; };
    const auto is_space = [](char c) { return c == ' ' || (c >= '\t' && c <= '\r'); };
    const auto next_number = [&]() -> std::optional<std::uint64_t> {
        while (is_space(byte()) || byte() == '#') {
            if (byte() == '#')
                while (at < file.size() && byte() != '\n') ++at;
            else ++at;
        }
        if (byte() < '0' || byte() > '9') return std::nullopt;
        std::uint64_t value = 0;
        for (; byte() >= '0' && byte() <= '9'; ++at)
            value = std::min<std::uint64_t>(value * 10 + static_cast<std::uint64_t>(byte() - '0'), 1U << 30U);
        return value;
    };
    const auto width = next_number(), height = next_number(), maximum = next_number();
    if (!width || !height || !maximum || !is_space(byte())) {
        return at >= file.size() ? truncated(name, "its header is cut off")
                                 : damaged(name, "its PGM header has no size");
    }
    if (*maximum == 0 || *maximum > 65535) return damaged(name, "its PGM maximum is not in 1..65535");
    header.samples_at = at + 1;
    header.bits = 8;
    while ((1ULL << static_cast<unsigned>(header.bits)) - 1 < *maximum) ++header.bits;
    return checked_size(header, *width, *height, name).and_then([&](FrameHeader sized) -> Result<FrameHeader> {
        const std::uint64_t need = *width * *height * (sized.bits > 8 ? 2 : 1);
        if (file.size() - sized.samples_at < need) {
            return truncated(
                name,
                std::to_string(file.size() - sized.samples_at) + " of " + std::to_string(need) + " bytes of samples");
        }
        return sized;
    });
}

}  // namespace

Result<FrameHeader> read_frame_header(Bytes file, std::string_view name) {
    using namespace std::string_view_literals;
    if (file.empty()) return truncated(name, "it is empty");
    if (begins_with(file, "\x89PNG\r\n\x1a\n"sv)) return png_header(file, name);
    if (begins_with(file, "II*\0"sv) || begins_with(file, "MM\0*"sv)) return tiff_header(file, name);
    if (begins_with(file, "P5"sv)) return pgm_header(file, name);
    if (begins_with(file, "P6"sv) || begins_with(file, "P3"sv)) return not_grey(name, "a colour PPM");
    if (begins_with(file, "P2"sv))
        return fail(ErrorCode::unsupported, std::string(name) + " is a text PGM", "save it as binary PGM (P5)");
    if (begins_with(file, "\xFF\xD8\xFF"sv)) {
        return fail(ErrorCode::unsupported, std::string(name) + " is a JPEG, which loses what is measured here",
                    kUseGrey);
    }
    return fail(ErrorCode::unreadable, std::string(name) + " is not a PNG, TIFF or binary PGM image", kUseGrey);
}

}  // namespace hord::drivers
