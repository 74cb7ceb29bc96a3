#include "firmware/hordctl/frames/frame_reader.h"

#include <algorithm>
#include <filesystem>
#include <set>

#include <fmt/format.h>

#include "calib/files/grid_toml.h"
#include "common/crc32.h"
#include "firmware/diagnostics/feature_views.h"

namespace hord::firmware {

void add_frame_options(CLI::App& command, FrameOptions& options) {
    command.add_option("--macro", options.macro,
                       fmt::format("Bins a lenslet of a macro-pixel frame, columns x rows; without it what the frame's "
                                   "geometry note says, else {}x{}",
                                   kDefaultBins, kDefaultBins));
    command.add_option("--grid", options.grid,
                       "Calibration file (hordctl calibrate): decodes raw frames into --macro bins a lenslet");
    command
        .add_option("--bits", options.bits,
                    "Bits a sample that the sensor recorded, for 9- to 15-bit samples in 16-bit files")
        ->check(in_range(8, 16));
}

namespace {

// The sizes of macro-pixels that divide the frame.
std::string macro_cure(int width_px, int height_px) {
    std::string sizes;
    for (int bins = algo::kMinBins; bins <= algo::kMaxBins; ++bins) {
        if (width_px % bins == 0 && height_px % bins == 0)
            sizes += fmt::format("{}{}x{}", sizes.empty() ? "" : ", ", bins, bins);
    }
    if (sizes.empty()) {
        return fmt::format(
            "no square macro-pixel of {} to {} bins divides it: give the columns x rows that it was "
            "recorded with, or --grid for a raw frame",
            algo::kMinBins, algo::kMaxBins);
    }
    return "it can be divided into " + sizes + " bins a lenslet: give --macro with the one that it was recorded with";
}

}  // namespace

Error about(const std::string& file, const Error& error) { return {error.code, file + ": " + error.what, error.cure}; }

Result<FrameReader> FrameReader::create(const FrameOptions& options) {
    FrameReader reader;
    reader.options_ = options;
    if (!options.macro.empty()) {
        const auto bins = algo::parse_bins(options.macro);
        if (!bins)
            return fail(ErrorCode::invalid_argument, "--macro " + options.macro + " is not a macro-pixel size",
                        "write columns x rows, 3 to 15 bins a side, as in 9x9");
        reader.bins_ = *bins;
    }
    const auto [i, j] = reader.bins_;
    if (options.grid.empty()) return reader;
    auto grid = calib::read_grid(options.grid);
    if (!grid) return tl::unexpected(grid.error());
    auto decoder = algo::GridDecoder::create(grid->grid, grid->directions, i, j);
    if (!decoder) return tl::unexpected(about(options.grid, decoder.error()));
    reader.calibration_ = {options.grid, grid->stamp.camera, grid->stamp.date, common::crc32(calib::to_toml(*grid))};
    reader.bin_rad_ = decoder->bin_rad();
    reader.decoder_ = std::make_shared<algo::GridDecoder>(std::move(*decoder));
    return reader;
}

namespace {

int fewer_bits(const FrameView& frame) {
    if (frame.bits != 16) return 0;
    std::uint32_t largest = 0;
    for (int y = 0; y < frame.height_px; ++y) {
        for (int x = 0; x < frame.width_px; ++x) largest = std::max(largest, frame.sample(x, y));
    }
    if (largest < 256) return 0;  // no light at any depth
    for (const int bits : {10, 12, 14}) {
        if (largest < 1U << static_cast<unsigned>(bits)) return bits;
    }
    return 0;
}

}  // namespace

// The note against the options that were given.
Result<void> FrameReader::compare(const drivers::FrameGeometry& noted, const std::string& file) const {
    const auto refuse = [&](const std::string& given, const std::string& cure) {
        return fail(ErrorCode::invalid_argument, file + " says " + describe(noted) + ", and " + given, cure);
    };
    if (options_.bits != 0 && options_.bits != noted.bits) {
        return refuse(fmt::format("--bits says {}", options_.bits),
                      fmt::format("leave --bits out, or give --bits {}", noted.bits));
    }
    if (noted.kind == drivers::FrameKind::raw) {
        if (decoder_) return {};
        return refuse("without --grid it would be read as macro-pixels",
                      "give --grid with the calibration of its sensor (hordctl calibrate)");
    }
    if (decoder_)
        return refuse("--grid " + options_.grid + " decodes raw frames", "leave --grid out, or give the raw frame");
    if (options_.macro.empty() || std::pair(noted.grid.i, noted.grid.j) == bins_) return {};
    return refuse(fmt::format("--macro says {}x{}", bins_.first, bins_.second),
                  fmt::format("leave --macro out, or give --macro {}x{}", noted.grid.i, noted.grid.j));
}

Result<MacroPixelFrame> FrameReader::read(const std::string& file) const {
    auto read = drivers::read_noted_frame(file, {.bits = options_.bits});
    if (!read) return tl::unexpected(read.error());
    const auto& noted = read->geometry;
    if (noted) {
        if (auto fine = compare(*noted, file); !fine) return tl::unexpected(fine.error());
    }
    MacroPixelFrame out{std::move(read->frame), {}, GeometryFrom::program};
    if (!options_.macro.empty()) out.geometry_from = GeometryFrom::option;
    if (!noted && options_.bits == 0) out.fewer_bits = fewer_bits(out.frame.view());
    if (noted && noted->kind == drivers::FrameKind::macro_pixels) {
        if (options_.macro.empty()) out.geometry_from = GeometryFrom::frame;
        out.extents = noted->grid;
        return out;
    }
    if (decoder_) {
        auto decoded = decoder_->decode(out.frame.view());
        if (!decoded) return tl::unexpected(about(file, decoded.error()));
        out.frame = std::move(*decoded);
    }
    auto extents = algo::extents_of_frame(out.frame.width_px(), out.frame.height_px(), bins_.first, bins_.second);
    if (!extents) {
        Error error = about(file, extents.error());
        if (!decoder_) error.cure = macro_cure(out.frame.width_px(), out.frame.height_px());
        return tl::unexpected(error);
    }
    out.extents = *extents;
    return out;
}

Result<Frame> read_raw_frame(const std::string& file, const drivers::ExpectedFrame& expected) {
    auto read = drivers::read_noted_frame(file, expected);
    if (!read) return tl::unexpected(read.error());
    if (read->geometry && read->geometry->kind == drivers::FrameKind::macro_pixels) {
        return fail(ErrorCode::invalid_argument,
                    file + " says " + describe(*read->geometry) + ", and a calibration needs a raw frame",
                    "give the sensor's frame as it came");
    }
    return std::move(read->frame);
}

std::vector<std::string> every_feature() {
    std::vector<std::string> all(algo::kFeatureNames.begin(), algo::kFeatureNames.end());
    all.insert(all.end(), {std::string(kZScore), std::string(kSums)});
    return all;
}

Result<void> check_result_names(const std::vector<std::string>& frames, const std::string& folder,
                                const std::vector<std::string>& endings, const std::vector<std::string>& inputs) {
    std::set<std::string> names;
    std::vector<OutputFile> results;
    for (const std::string& frame : frames) {
        const std::string name = std::filesystem::path(frame).stem().string();
        if (!names.insert(name).second) {
            return fail(ErrorCode::invalid_argument,
                        "two frames named " + name + " would overwrite each other in " + folder,
                        "rename one, or give different folders");
        }
        for (const std::string& ending : endings)
            results.push_back({"in --out,", (std::filesystem::path(folder) / (name + ending)).string()});
    }
    std::vector<std::string> read = frames;
    read.insert(read.end(), inputs.begin(), inputs.end());
    return check_overwrites(results, read);
}

}  // namespace hord::firmware
