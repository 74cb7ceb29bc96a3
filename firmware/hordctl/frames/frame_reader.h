// Reads a recorded frame as macro-pixels: as it is, or decoded through a calibration.
#pragma once

#include <memory>
#include <string>

#include "algo/frame/grid_decoder.h"
#include "common/cli/program.h"
#include "common/frame.h"

namespace hord::firmware {

struct FrameOptions {
    std::string macro = "9x9";  // bins a lenslet, columns x rows
    std::string grid;           // a calibration file; empty: frames are macro-pixels already
    int bits = 0;               // a sample that the sensor recorded; 0: as the file has
};

// --macro, --grid and --bits.
void add_frame_options(CLI::App& command, FrameOptions& options);

// The same error with the file's name added.
Error about(const std::string& file, const Error& error);

class FrameReader {
  public:
    // Fails with invalid_argument (--macro), and as calib::read_grid() and GridDecoder::create() do.
    static Result<FrameReader> create(const FrameOptions& options);

    // Errors name the file.
    Result<Frame> read(const std::string& file) const;

    // The light field in such a frame. The error names the file.
    Result<algo::Extents> extents_of(const Frame& frame, const std::string& file) const;

    [[nodiscard]] std::pair<int, int> bins() const { return bins_; }
    [[nodiscard]] double bin_rad() const { return bin_rad_; }  // one bin pitch; 0: not known

  private:
    std::pair<int, int> bins_{9, 9};
    int bits_ = 0;
    double bin_rad_ = 0;
    std::shared_ptr<algo::GridDecoder> decoder_;  // none: frames are macro-pixels
};

}  // namespace hord::firmware
