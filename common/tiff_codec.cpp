#include "common/tiff_codec.h"

#include <algorithm>
#include <array>
#include <cstdarg>
#include <cstddef>
#include <cstdio>
#include <cstring>
#include <exception>
#include <memory>
#include <string>

#include <tiffio.h>

namespace hord::common {
namespace {

constexpr std::uint32_t kLargestSide = 32'768;  // larger than any light field
// Highest compression ratio: LZW, at most 4096 bytes (its table's longest chain) in a code of 12 bits. Deflate has
// 1032, PackBits 64.
constexpr std::uint64_t kMaxUnpacked = 4096 * 8 / 12;
// The largest allocation of libtiff beside the file's size: its tables.
constexpr tmsize_t kTables = 16 << 20;
// A file whose tags and parts do not overlap is read once, its directory a few times. libtiff keeps every tag's values,
// known or not.
constexpr std::uint64_t kMaxReadings = 2;
constexpr std::uint64_t kDirectoryReadings = 1 << 20;

// A file in memory for libtiff, and libtiff's first error.
struct MemoryFile {
    std::span<const std::uint8_t> to_read{};
    std::vector<std::uint8_t> written{};
    bool writing = false;
    std::uint64_t at = 0;
    std::uint64_t have_read = 0;
    std::string why{};

    [[nodiscard]] std::uint64_t size() const { return writing ? written.size() : to_read.size(); }
};
MemoryFile& file_of(thandle_t handle) { return *static_cast<MemoryFile*>(handle); }

tmsize_t on_read(thandle_t handle, void* to, tmsize_t count) {
    MemoryFile& file = file_of(handle);
    const std::uint64_t left = file.size() - std::min(file.at, file.size());
    const auto copied =
        static_cast<std::size_t>(std::min(left, static_cast<std::uint64_t>(std::max<tmsize_t>(count, 0))));
    file.have_read += copied;
    if (!file.writing && file.have_read > kMaxReadings * file.size() + kDirectoryReadings) {
        if (file.why.empty()) file.why = "its tags or parts overlap";
        return 0;
    }
    // libtiff treats some short reads as zeros.
    if (!file.writing && copied < static_cast<std::uint64_t>(count) && file.why.empty()) file.why = "it is cut off";
    if (copied > 0) std::memcpy(to, (file.writing ? file.written.data() : file.to_read.data()) + file.at, copied);
    file.at += copied;
    return static_cast<tmsize_t>(copied);
}
tmsize_t on_write(thandle_t handle, void* from, tmsize_t count) {
    MemoryFile& file = file_of(handle);
    const auto end = static_cast<std::size_t>(file.at) + static_cast<std::size_t>(count);
    if (!file.writing) return -1;
    try {
        if (end > file.written.size()) file.written.resize(end);
    } catch (const std::exception&) {  // must not pass through libtiff
        return -1;
    }
    std::memcpy(file.written.data() + file.at, from, static_cast<std::size_t>(count));
    file.at = end;
    return count;
}
toff_t on_seek(thandle_t handle, toff_t offset, int from) {
    MemoryFile& file = file_of(handle);
    file.at = (from == SEEK_SET ? 0 : from == SEEK_CUR ? file.at : file.size()) + offset;
    return file.at;
}
int on_close(thandle_t /*handle*/) { return 0; }
toff_t on_size(thandle_t handle) { return file_of(handle).size(); }
int on_error(TIFF* /*tiff*/, void* user, const char* /*module*/, const char* format, va_list values) {
    std::string& why = static_cast<MemoryFile*>(user)->why;
    std::array<char, 240> text{};
    if (why.empty() && std::vsnprintf(text.data(), text.size(), format, values) > 0) why = text.data();
    return 1;
}
int on_warning(TIFF* /*tiff*/, void* /*user*/, const char* /*module*/, const char* /*format*/, va_list /*values*/) {
    return 1;
}

struct Close {
    void operator()(TIFF* tiff) const { TIFFClose(tiff); }
};
using Tiff = std::unique_ptr<TIFF, Close>;

Tiff open(MemoryFile& file) {
    const std::unique_ptr<TIFFOpenOptions, decltype(&TIFFOpenOptionsFree)> options(TIFFOpenOptionsAlloc(),
                                                                                   &TIFFOpenOptionsFree);
    TIFFOpenOptionsSetMaxSingleMemAlloc(options.get(), kTables + 2 * static_cast<tmsize_t>(file.to_read.size()));
    TIFFOpenOptionsSetErrorHandlerExtR(options.get(), on_error, &file);
    TIFFOpenOptionsSetWarningHandlerExtR(options.get(), on_warning, &file);
    return Tiff(TIFFClientOpenExt("", file.writing ? "w" : "rm", &file, on_read, on_write, on_seek, on_close, on_size,
                                  nullptr, nullptr, options.get()));
}

template <class T>
T tag(const Tiff& tiff, std::uint32_t which) {  // 0: absent without a default
    T value = 0;
    TIFFGetFieldDefaulted(tiff.get(), which, &value);
    return value;
}

// Where a file's samples go in the frame, in samples: (x, y) goes to origin + x * per_column + y * per_row.
struct Orientation {
    bool transposed = false;
    std::ptrdiff_t origin = 0, per_column = 1, per_row = 0;
};
Orientation orientation(std::uint16_t named, std::ptrdiff_t width, std::ptrdiff_t height) {
    const std::ptrdiff_t last = width * height - 1;
    switch (named) {
        case ORIENTATION_TOPRIGHT: return {false, width - 1, -1, width};
        case ORIENTATION_BOTRIGHT: return {false, last, -1, -width};
        case ORIENTATION_BOTLEFT: return {false, last - (width - 1), 1, -width};
        case ORIENTATION_LEFTTOP: return {true, 0, height, 1};
        case ORIENTATION_RIGHTTOP: return {true, height - 1, height, -1};
        case ORIENTATION_RIGHTBOT: return {true, last, -height, -1};
        case ORIENTATION_LEFTBOT: return {true, last - (height - 1), -height, 1};
        default: return {false, 0, 1, width};
    }
}

// One strip or tile: the position of its first sample in the image, and its size.
struct Part {
    std::uint32_t number = 0, x = 0, y = 0;
    std::uint32_t width = 0, height = 0;  // as stored
};

class GreyReader {
  public:
    GreyReader(const Tiff& tiff, const MemoryFile& file)
        : tiff_(tiff), file_(file), width_(tag<std::uint32_t>(tiff, TIFFTAG_IMAGEWIDTH)),
          height_(tag<std::uint32_t>(tiff, TIFFTAG_IMAGELENGTH)),
          bits_(tag<std::uint16_t>(tiff, TIFFTAG_BITSPERSAMPLE)), tiled_(TIFFIsTiled(tiff.get()) != 0),
          part_width_(tiled_ ? tag<std::uint32_t>(tiff, TIFFTAG_TILEWIDTH) : width_),
          part_height_(tiled_ ? tag<std::uint32_t>(tiff, TIFFTAG_TILELENGTH)
                              : std::min(tag<std::uint32_t>(tiff, TIFFTAG_ROWSPERSTRIP), height_)) {}

    // Empty if the image can be read, else the reason.
    [[nodiscard]] std::string unsupported() const {
        if (TIFFLastDirectory(tiff_.get()) == 0) return "it holds more than one image";
        if (const auto samples = tag<std::uint16_t>(tiff_, TIFFTAG_SAMPLESPERPIXEL); samples != 1)
            return std::to_string(samples) + " samples a pixel";
        if (bits_ != 8 && bits_ != 16) return std::to_string(bits_) + " bits a sample";
        std::uint16_t shown = PHOTOMETRIC_MINISBLACK;
        if (TIFFGetField(tiff_.get(), TIFFTAG_PHOTOMETRIC, &shown) == 1 && shown != PHOTOMETRIC_MINISBLACK)
            return "palette, colour or inverted grey";
        if (tag<std::uint16_t>(tiff_, TIFFTAG_SAMPLEFORMAT) != SAMPLEFORMAT_UINT)
            return "samples are not unsigned integers";
        constexpr std::array<std::uint16_t, 5> known = {COMPRESSION_NONE, COMPRESSION_LZW, COMPRESSION_ADOBE_DEFLATE,
                                                        COMPRESSION_DEFLATE, COMPRESSION_PACKBITS};
        const auto packing = tag<std::uint16_t>(tiff_, TIFFTAG_COMPRESSION);
        if (std::ranges::find(known, packing) == known.end())
            return "packed with TIFF's method " + std::to_string(packing);
        return {};
    }

    // Empty if the samples can be decompressed, else the reason.
    [[nodiscard]] std::string damaged() const {
        for (const std::uint32_t side : {width_, height_, part_width_, part_height_}) {
            if (side == 0 || side > kLargestSide) return "it has no size that an image can have";
        }
        const auto whole = [this](std::uint32_t side, std::uint32_t part) {
            return tiled_ ? std::uint64_t{(side - 1) / part + 1} * part : side;
        };
        const std::uint64_t unpacked = whole(width_, part_width_) * whole(height_, part_height_) * (bits_ / 8U);
        if (unpacked > kMaxUnpacked * file_.size()) return "it is too short for the size that it says";
        return {};
    }

    [[nodiscard]] Result<void> check_size(std::string_view name, const AcceptSize& accept) const {
        const bool transposed = orientation(tag<std::uint16_t>(tiff_, TIFFTAG_ORIENTATION), width_, height_).transposed;
        return check_declared_size(name, transposed ? height_ : width_, transposed ? width_ : height_, accept);
    }

    // False: libtiff failed (its error says why), or there are too few samples.
    bool read(Frame& frame) const {
        const Orientation to = orientation(tag<std::uint16_t>(tiff_, TIFFTAG_ORIENTATION), width_, height_);
        frame = Frame(static_cast<int>(to.transposed ? height_ : width_),
                      static_cast<int>(to.transposed ? width_ : height_), bits_);
        std::vector<std::byte> samples;
        Part part{.width = part_width_, .height = part_height_};
        for (part.y = 0; part.y < height_; part.y += std::min(part_height_, height_ - part.y)) {
            for (part.x = 0; part.x < width_; part.x += std::min(part_width_, width_ - part.x), ++part.number) {
                if (!tiled_) part.height = std::min(part_height_, height_ - part.y);
                if (!unpack(part, samples)) return false;
                if (bits_ == 8) place<std::uint8_t>(samples, part, to, frame);
                else place<std::uint16_t>(samples, part, to, frame);
            }
        }
        return true;
    }

  private:
    bool unpack(const Part& part, std::vector<std::byte>& samples) const {
        samples.resize(std::size_t{part.width} * part.height * (bits_ / 8U));
        const auto wanted = static_cast<tmsize_t>(samples.size());
        return (tiled_ ? TIFFReadEncodedTile(tiff_.get(), part.number, samples.data(), wanted)
                       : TIFFReadEncodedStrip(tiff_.get(), part.number, samples.data(), wanted)) == wanted;
    }

    template <class Sample>
    void place(const std::vector<std::byte>& samples, const Part& part, const Orientation& to, Frame& frame) const {
        const std::uint32_t columns = std::min(part.width, width_ - part.x),
                            rows = std::min(part.height, height_ - part.y);
        const auto* from = reinterpret_cast<const Sample*>(samples.data());
        auto* out = reinterpret_cast<Sample*>(frame.bytes().data());
        for (std::uint32_t y = 0; y < rows; ++y, from += part.width) {
            Sample* row = out + to.origin + static_cast<std::ptrdiff_t>(part.y + y) * to.per_row +
                static_cast<std::ptrdiff_t>(part.x) * to.per_column;
            if (to.per_column == 1) {
                std::copy_n(from, columns, row);
            } else {
                for (std::uint32_t x = 0; x < columns; ++x)
                    row[static_cast<std::ptrdiff_t>(x) * to.per_column] = from[x];
            }
        }
    }

    const Tiff& tiff_;
    const MemoryFile& file_;
    std::uint32_t width_, height_;
    std::uint16_t bits_;
    bool tiled_;
    std::uint32_t part_width_, part_height_;
};

// `rows`: one after the other, `stride_bytes` apart.
bool write(const Tiff& tiff, int width_px, int height_px, int bits, std::uint16_t format, const std::byte* rows,
           std::ptrdiff_t stride_bytes) {
    const auto width = static_cast<std::uint32_t>(width_px), height = static_cast<std::uint32_t>(height_px);
    TIFF* to = tiff.get();
    bool good = TIFFSetField(to, TIFFTAG_IMAGEWIDTH, width) == 1 &&
        TIFFSetField(to, TIFFTAG_IMAGELENGTH, height) == 1 && TIFFSetField(to, TIFFTAG_SAMPLESPERPIXEL, 1) == 1 &&
        TIFFSetField(to, TIFFTAG_BITSPERSAMPLE, bits) == 1 && TIFFSetField(to, TIFFTAG_SAMPLEFORMAT, format) == 1 &&
        TIFFSetField(to, TIFFTAG_PHOTOMETRIC, PHOTOMETRIC_MINISBLACK) == 1 &&
        TIFFSetField(to, TIFFTAG_COMPRESSION, COMPRESSION_NONE) == 1 &&
        TIFFSetField(to, TIFFTAG_PLANARCONFIG, PLANARCONFIG_CONTIG) == 1 &&
        TIFFSetField(to, TIFFTAG_ROWSPERSTRIP, TIFFDefaultStripSize(to, 0)) == 1;
    for (std::uint32_t y = 0; good && y < height; ++y) {
        good = TIFFWriteScanline(to, const_cast<std::byte*>(rows + std::ptrdiff_t{y} * stride_bytes), y, 0) == 1;
    }
    return good && TIFFWriteDirectory(to) == 1;
}

}  // namespace

Result<Frame> decode_grey_tiff(std::span<const std::uint8_t> bytes, std::string_view name, const AcceptSize& accept) {
    MemoryFile file{.to_read = bytes};
    const auto damaged = [&](const std::string& why) {
        return fail(
            ErrorCode::unreadable,
            std::string(name) + " is truncated or damaged (" + (why.empty() ? "its samples are cut off" : why) + ")",
            "record or copy it again");
    };
    const Tiff tiff = open(file);
    if (!tiff) return damaged(file.why);
    const GreyReader reader(tiff, file);
    if (const std::string what = reader.unsupported(); !what.empty()) {
        return fail(ErrorCode::unsupported, std::string(name) + " is not a grey frame that can be read (" + what + ")",
                    "save it as 8- or 16-bit grey, one channel, uncompressed or with LZW, deflate or PackBits");
    }
    if (const std::string why = reader.damaged(); !why.empty()) return damaged(why);
    if (auto good = reader.check_size(name, accept); !good) return tl::unexpected(good.error());
    Frame frame;
    if (!reader.read(frame) || !file.why.empty()) return damaged(file.why);
    return frame;
}

Result<std::vector<std::uint8_t>> encode_float_tiff(int width_px, int height_px, std::span<const float> values) {
    if (width_px <= 0 || height_px <= 0 ||
        values.size() != static_cast<std::size_t>(width_px) * static_cast<std::size_t>(height_px)) {
        return fail(ErrorCode::invalid_argument,
                    "a map of " + std::to_string(width_px) + "x" + std::to_string(height_px) + " has " +
                        std::to_string(values.size()) + " values, and cannot be made a TIFF",
                    "report it");
    }
    MemoryFile file{.writing = true};
    bool good = false;
    if (const Tiff tiff = open(file); tiff) {
        good =
            write(tiff, width_px, height_px, 32, SAMPLEFORMAT_IEEEFP, reinterpret_cast<const std::byte*>(values.data()),
                  static_cast<std::ptrdiff_t>(sizeof(float)) * width_px);
    }
    if (!good || !file.why.empty())
        return fail(ErrorCode::internal, "a map cannot be made a TIFF (" + file.why + ")", "report it");
    return std::move(file.written);
}

Result<std::vector<std::uint8_t>> encode_grey_tiff(const FrameView& frame) {
    MemoryFile file{.writing = true};
    bool good = false;
    if (const Tiff tiff = open(file); tiff) {
        good = write(tiff, frame.width_px, frame.height_px, frame.bits > 8 ? 16 : 8, SAMPLEFORMAT_UINT, frame.data,
                     frame.stride_bytes);
    }
    if (!good || !file.why.empty())
        return fail(ErrorCode::internal, "a frame cannot be made a TIFF (" + file.why + ")", "report it");
    return std::move(file.written);
}

}  // namespace hord::common
