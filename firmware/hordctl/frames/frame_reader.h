// Reads a recorded frame as macro-pixels: as it is, or decoded through a calibration.
#pragma once

#include <memory>
#include <string>
#include <utility>

#include "algo/frame/grid_decoder.h"
#include "common/frame.h"
#include "common/result.h"

namespace hord::firmware {

class FrameReader {
  public:
    // `macro`: bins a lenslet, columns x rows, as in 9x9. `grid`: a calibration file; empty: frames are macro-pixels
    // already. `bits` a sample that the sensor recorded; 0: as the file has. Fails with what is wrong with them.
    static Result<FrameReader> create(const std::string& macro, const std::string& grid, int bits);

    // Errors name the file.
    Result<Frame> read(const std::string& file) const;

    [[nodiscard]] std::pair<int, int> bins() const { return bins_; }
    [[nodiscard]] double bin_rad() const { return bin_rad_; }  // one bin pitch; 0: not known

  private:
    std::pair<int, int> bins_{9, 9};
    int bits_ = 0;
    double bin_rad_ = 0;
    std::shared_ptr<algo::GridDecoder> decoder_;  // none: frames are macro-pixels
};

}  // namespace hord::firmware
