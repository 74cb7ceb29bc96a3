// Finds the lattice of lenslets in a white image, from the peaks of its autocorrelation and without hints. Works for
// any shape of the spots. How: docs/notes/calibration.md.
#pragma once

#include <optional>

#include "algo/frame/lenslet_grid.h"
#include "calib/lattice/white_image.h"
#include "common/result.h"

namespace hord::calib {

inline constexpr double kMinPitch = 8;
inline constexpr double kMaxPitch = 64;

struct Lattice {
    algo::LatticeKind kind = algo::LatticeKind::square;
    algo::Stagger stagger = algo::Stagger::none;
    algo::PixelPoint step_u, step_v;  // one pitch along the ideal axes U and V (see algo/frame/lenslet_grid.h), px
    algo::PixelPoint seed_px;         // the centre of a lenslet near the middle of the analysed part of the frame
    double reach_px = 0;              // half the side of the analysed part: range of the steps from the seed
    double strength = 0;              // autocorrelation at the nearest lattice vectors, 0..1, including noise

    [[nodiscard]] double pitch_px() const;
};

struct LatticeHint {
    std::optional<algo::LatticeKind> kind;
    double pitch_px = 0;  // 0: none; else to +-20 %
};

// Fails with `refused`, with the reason, if there is no lattice (a blank or fully saturated frame), if it is periodic
// in one direction only, or if it is neither square (within 15 % and 6 degrees) nor hexagonal.
Result<Lattice> find_lattice(const WhiteImage& image, const LatticeHint& hint = {});

}  // namespace hord::calib
