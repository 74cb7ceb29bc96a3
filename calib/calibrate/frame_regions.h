// A white frame in equal regions, for checks that name a place, and its lenslets region by region. Used by
// calib/calibrate only.
#pragma once

#include <algorithm>
#include <array>
#include <cstddef>
#include <string>
#include <vector>

#include "calib/calibrate/calibrate_grid.h"

namespace hord::calib {

inline constexpr int kMaxRegions = 8;    // of the frame along its width and height
inline constexpr double kMinRegion = 4;  // pitches: side of a region
inline constexpr int kMinOfRegion = 8;   // lenslets of a region that is judged

// The frame in equal regions, row by row.
class Regions {
  public:
    explicit Regions(const GridCalibration& calibration)
        : width_(calibration.fit.grid.width_px), height_(calibration.fit.grid.height_px),
          side_(std::clamp(static_cast<int>(std::min(width_, height_) / (kMinRegion * calibration.lattice.pitch_px())),
                           1, kMaxRegions)) {}

    [[nodiscard]] std::size_t count() const {
        return static_cast<std::size_t>(side_) * static_cast<std::size_t>(side_);
    }
    [[nodiscard]] std::size_t at(double x, double y) const {
        return static_cast<std::size_t>(part(y, height_) * side_ + part(x, width_));
    }
    [[nodiscard]] bool at_border(std::size_t region) const {
        const auto outer = [this](int k) { return k == 0 || k == side_ - 1; };
        return outer(static_cast<int>(region) / side_) || outer(static_cast<int>(region) % side_);
    }
    // Where a region lies, for a person.
    [[nodiscard]] std::string place(std::size_t region) const {
        const auto third = [this](int k) { return 3 * k < side_ - 1 ? 0U : 3 * k > 2 * (side_ - 1) ? 2U : 1U; };
        static constexpr std::array<std::array<const char*, 3>, 3> kNames{
            {{"at the top left", "at the top", "at the top right"},
             {"at the left", "in the middle", "at the right"},
             {"at the bottom left", "at the bottom", "at the bottom right"}}};
        return kNames[third(static_cast<int>(region) / side_)][third(static_cast<int>(region) % side_)];
    }

  private:
    [[nodiscard]] int part(double at, int size) const {
        return std::clamp(static_cast<int>(side_ * at / size), 0, side_ - 1);
    }
    int width_, height_, side_;
};

// Lenslets of one region. Rejected: off the grid by 0.002 pitch or more, not by the missing light of a neighbour.
struct RegionCount {
    int measured = 0, rejected = 0, missing = 0;
    std::size_t region = 0;
    [[nodiscard]] int off() const { return rejected + missing; }
    [[nodiscard]] int all() const { return measured + missing; }
};

// Of every region, in their order.
std::vector<RegionCount> count_regions(const GridCalibration& calibration);

}  // namespace hord::calib
