#include "firmware/hordctl/frames/frame_reader.h"

#include <cstdio>

#include "calib/files/grid_toml.h"
#include "drivers/files/frame_file.h"

namespace hord::firmware {
namespace {

Result<std::pair<int, int>> parse_macro(const std::string& text) {
    int i = 0, j = 0;
    char rest = 0;
    if (std::sscanf(text.c_str(), "%dx%d%c", &i, &j, &rest) == 2) return std::pair(i, j);
    return fail(ErrorCode::invalid_argument, "--macro " + text + " is not a macro-pixel size",
                "write columns x rows of bins, as in 9x9");
}

}  // namespace

Result<FrameReader> FrameReader::create(const std::string& macro, const std::string& grid_file, int bits) {
    FrameReader reader;
    auto bins = parse_macro(macro);
    if (!bins) return tl::unexpected(bins.error());
    reader.bins_ = *bins;
    reader.bits_ = bits;
    if (grid_file.empty()) return reader;
    auto grid = calib::read_grid(grid_file);
    if (!grid) return tl::unexpected(grid.error());
    auto decoder = algo::GridDecoder::create(grid->grid, grid->directions, bins->first, bins->second);
    if (!decoder) return fail(decoder.error().code, grid_file + ": " + decoder.error().what, decoder.error().cure);
    reader.bin_rad_ = decoder->bin_rad();
    reader.decoder_ = std::make_shared<algo::GridDecoder>(std::move(*decoder));
    return reader;
}

Result<Frame> FrameReader::read(const std::string& file) const {
    auto frame = drivers::read_frame(file, {.bits = bits_});
    if (!frame || !decoder_) return frame;
    auto decoded = decoder_->decode(frame->view());
    if (!decoded) return fail(decoded.error().code, file + ": " + decoded.error().what, decoded.error().cure);
    return decoded;
}

}  // namespace hord::firmware
