#include "firmware/exchange/viewpoint_file.h"

#include <cstdint>
#include <cstring>
#include <memory>
#include <optional>
#include <vector>

#include <tiffio.h>

#include "algo/frame/extents.h"
#include "drivers/files/frame_file.h"

namespace hord::firmware {
namespace {

struct CloseTiff {
    void operator()(TIFF* tiff) const { TIFFClose(tiff); }
};
using Tiff = std::unique_ptr<TIFF, CloseTiff>;

std::uint32_t sample(const std::vector<std::uint8_t>& line, std::size_t k, bool wide) {
    if (!wide) return line[k];
    std::uint16_t value = 0;
    std::memcpy(&value, line.data() + 2 * k, sizeof value);
    return value;
}

// None: another layout, or damaged.
std::optional<Frame> read_colour(const std::filesystem::path& file) {
    // libtiff prints what it finds; the caller has a sentence of its own.
    TIFFSetErrorHandler(nullptr);
    TIFFSetWarningHandler(nullptr);
    const Tiff tiff(TIFFOpen(file.c_str(), "r"));
    if (!tiff || TIFFIsTiled(tiff.get()) != 0) return std::nullopt;
    std::uint32_t width = 0, height = 0;
    std::uint16_t channels = 0, bits = 0, planes = 0, format = 0;
    TIFFGetField(tiff.get(), TIFFTAG_IMAGEWIDTH, &width);
    TIFFGetField(tiff.get(), TIFFTAG_IMAGELENGTH, &height);
    TIFFGetFieldDefaulted(tiff.get(), TIFFTAG_SAMPLESPERPIXEL, &channels);
    TIFFGetFieldDefaulted(tiff.get(), TIFFTAG_BITSPERSAMPLE, &bits);
    TIFFGetFieldDefaulted(tiff.get(), TIFFTAG_PLANARCONFIG, &planes);
    TIFFGetFieldDefaulted(tiff.get(), TIFFTAG_SAMPLEFORMAT, &format);
    if (channels != 3 || (bits != 8 && bits != 16) || planes != PLANARCONFIG_CONTIG || format != SAMPLEFORMAT_UINT)
        return std::nullopt;
    if (width == 0 || height == 0 || width > algo::kMaxLenslets || height > algo::kMaxLenslets) return std::nullopt;
    std::vector<std::uint8_t> line(std::size_t{width} * 3 * bits / 8);
    if (TIFFScanlineSize64(tiff.get()) != line.size()) return std::nullopt;
    Frame frame(static_cast<int>(width), static_cast<int>(height), bits);
    for (std::uint32_t y = 0; y < height; ++y) {
        if (TIFFReadScanline(tiff.get(), line.data(), y, 0) != 1) return std::nullopt;
        for (std::uint32_t x = 0; x < width; ++x) {
            std::uint32_t sum = 1;  // rounds
            for (std::size_t c = 0; c < 3; ++c) sum += sample(line, 3 * std::size_t{x} + c, bits == 16);
            frame.set(static_cast<int>(x), static_cast<int>(y), sum / 3);
        }
    }
    return frame;
}

}  // namespace

Result<Viewpoint> read_viewpoint(const std::filesystem::path& file) {
    auto grey = drivers::read_frame(file);
    if (grey) return Viewpoint{std::move(*grey), false};
    if (grey.error().code == ErrorCode::unsupported) {
        if (auto colour = read_colour(file)) return Viewpoint{std::move(*colour), true};
    }
    return tl::unexpected(grey.error());
}

}  // namespace hord::firmware
