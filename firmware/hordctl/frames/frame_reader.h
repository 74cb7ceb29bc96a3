// Reads a recorded frame as macro-pixels: as it is, or decoded through a calibration. What the frame's file says of its
// geometry is compared with the options of the command line.
#pragma once

#include <cstdint>
#include <memory>
#include <optional>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include "algo/frame/grid_decoder.h"
#include "common/cli/program.h"
#include "common/frame.h"
#include "drivers/files/frame_file.h"

namespace hord::firmware {

struct FrameOptions {
    std::string macro;  // bins a lenslet, columns x rows; empty: what the frame's note says, else kDefaultBins
    std::string grid;   // a calibration file; empty: frames are macro-pixels already
    int bits = 0;       // a sample that the sensor recorded; 0: as the frame's note or its file has
};
inline constexpr int kDefaultBins = 9;

// --macro, --grid and --bits.
void add_frame_options(CLI::App& command, FrameOptions& options);

// The same error with the file's name added.
Error about(const std::string& file, const Error& error);

// Where a frame's bins a lenslet come from.
enum class GeometryFrom : std::uint8_t { option, frame, program };
constexpr std::string_view name_of(GeometryFrom from) {
    constexpr std::string_view names[] = {"option", "frame", "default"};
    return names[static_cast<unsigned>(from)];
}

struct MacroPixelFrame {
    Frame frame;
    algo::Extents extents;
    GeometryFrom geometry_from = GeometryFrom::program;
    // Of a frame of 16 bits whose depth nobody told: 10, 12 or 14 bits that hold all its samples; 0: none do.
    int fewer_bits = 0;
};

// The calibration of --grid.
struct CalibrationInUse {
    std::string file, camera, date;
    std::uint32_t crc32 = 0;  // the id in the register block CALIBRATION
};

class FrameReader {
  public:
    // Fails with invalid_argument (--macro), and as calib::read_grid() and GridDecoder::create() do.
    static Result<FrameReader> create(const FrameOptions& options);

    // Errors name the file. Fails with invalid_argument if the frame's geometry note (drivers/files/frame_geometry.h)
    // says something else than --macro, --grid or --bits, or if the bins do not divide the frame; as
    // drivers::read_noted_frame() and GridDecoder::decode() do.
    [[nodiscard]] Result<MacroPixelFrame> read(const std::string& file) const;

    [[nodiscard]] double bin_rad() const { return bin_rad_; }  // one bin pitch; 0: not known

    [[nodiscard]] const std::optional<CalibrationInUse>& calibration() const { return calibration_; }

  private:
    [[nodiscard]] Result<void> compare(const drivers::FrameGeometry& noted, const std::string& file) const;

    FrameOptions options_;
    std::pair<int, int> bins_{kDefaultBins, kDefaultBins};  // of --macro
    double bin_rad_ = 0;
    std::optional<CalibrationInUse> calibration_;
    std::shared_ptr<algo::GridDecoder> decoder_;  // none: frames are macro-pixels
};

// A frame for a calibration. Fails with invalid_argument if its note says that it holds macro-pixels, and as
// drivers::read_noted_frame() does.
Result<Frame> read_raw_frame(const std::string& file, const drivers::ExpectedFrame& expected = {});

// Every name of a map that an inspection may show.
std::vector<std::string> every_feature();

// For a command that writes files named as its frames into `folder`: "lens.png" yields "lens" with each of `endings`.
// Fails with invalid_argument if two frames have one name, and with refused if a result is one of the frames or of
// `inputs`.
Result<void> check_result_names(const std::vector<std::string>& frames, const std::string& folder,
                                const std::vector<std::string>& endings, const std::vector<std::string>& inputs);

}  // namespace hord::firmware
