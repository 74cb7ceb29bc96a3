#include "firmware/hordctl/frames/frame_reader.h"

#include <cstdio>

#include "calib/files/grid_toml.h"
#include "drivers/files/frame_file.h"

namespace hord::firmware {

void add_frame_options(CLI::App& command, FrameOptions& options) {
    command.add_option("--macro", options.macro, "Bins a lenslet of a macro-pixel frame, columns x rows")
        ->capture_default_str();
    command.add_option("--grid", options.grid,
                       "Calibration file (hordctl calibrate): decodes raw frames into --macro bins a lenslet");
    command
        .add_option("--bits", options.bits,
                    "Bits a sample that the sensor recorded, for 9- to 15-bit samples in 16-bit files")
        ->check(CLI::Range(8, 16));
}

Error about(const std::string& file, const Error& error) { return {error.code, file + ": " + error.what, error.cure}; }

Result<FrameReader> FrameReader::create(const FrameOptions& options) {
    FrameReader reader;
    auto& [i, j] = reader.bins_;
    char rest = 0;
    if (std::sscanf(options.macro.c_str(), "%dx%d%c", &i, &j, &rest) != 2)
        return fail(ErrorCode::invalid_argument, "--macro " + options.macro + " is not a macro-pixel size",
                    "write columns x rows of bins, as in 9x9");
    reader.bits_ = options.bits;
    if (options.grid.empty()) return reader;
    auto grid = calib::read_grid(options.grid);
    if (!grid) return tl::unexpected(grid.error());
    auto decoder = algo::GridDecoder::create(grid->grid, grid->directions, i, j);
    if (!decoder) return tl::unexpected(about(options.grid, decoder.error()));
    reader.bin_rad_ = decoder->bin_rad();
    reader.decoder_ = std::make_shared<algo::GridDecoder>(std::move(*decoder));
    return reader;
}

Result<Frame> FrameReader::read(const std::string& file) const {
    auto frame = drivers::read_frame(file, {.bits = bits_});
    if (!frame || !decoder_) return frame;
    auto decoded = decoder_->decode(frame->view());
    if (!decoded) return tl::unexpected(about(file, decoded.error()));
    return decoded;
}

Result<algo::Extents> FrameReader::extents_of(const Frame& frame, const std::string& file) const {
    auto extents = algo::extents_of_frame(frame.width_px(), frame.height_px(), bins_.first, bins_.second);
    if (!extents) return tl::unexpected(about(file, extents.error()));
    return extents;
}

}  // namespace hord::firmware
