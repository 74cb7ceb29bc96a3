// The lenslet grid of a sensor: the position of the centre of lenslet (m, n) in the raw frame.
//
// calib/ finds it, a calibration file stores it, the decoders are built from it. (0, 0) is the centre of the top-left
// pixel, x to the right, y down. Only + - * / and the square root are used, which IEEE 754 rounds exactly: the same
// file gives the same bits on every machine (the build disables fused multiply-add).
#pragma once

#include <array>
#include <cmath>
#include <cstdint>
#include <string_view>
#include <vector>

#include "common/result.h"

namespace hord::algo {

enum class LatticeKind : std::uint8_t { square, hexagonal };

// The lenslets of a hexagonal lattice that are shifted by half a pitch: every second row (to the right) or every second
// column (downwards).
enum class Stagger : std::uint8_t { none, rows, columns };

// Models from normalised lattice coordinates (u, v) to pixels, with their numbers of parameters, simplest first. r is
// the distance from the centre of distortion before the distortion, in units of `radius_px`; the distortion multiplies
// it.
enum class GridModelKind : std::uint8_t {
    similarity,          // 4: shift, rotation, one pitch
    similarity_radial1,  // 5: + 1 + k1 r^2 about the middle of the frame
    affine,              // 6: shift, rotation, two pitches, shear
    homography,          // 8: + perspective
    radial1,             // 9: + 1 + k1 r^2 about the middle of the frame
    division1,           // 9: + 2 / (1 + sqrt(1 - 4 k1 r^2)), the division model: barrel distortion that never folds
    radial2,             // 12: + 1 + k1 r^2 + k2 r^4 and the centre of distortion
    rational2,           // 12: + (1 + k1 r^2) / (1 + k2 r^2) and the centre of distortion
    cubic,               // 20: two polynomials of order 3
    quintic,             // 42: two polynomials of order 5
};
inline constexpr std::array kGridModels{GridModelKind::similarity, GridModelKind::similarity_radial1,
                                        GridModelKind::affine,     GridModelKind::homography,
                                        GridModelKind::radial1,    GridModelKind::division1,
                                        GridModelKind::radial2,    GridModelKind::rational2,
                                        GridModelKind::cubic,      GridModelKind::quintic};

[[nodiscard]] std::string_view name_of(GridModelKind model);
[[nodiscard]] int parameter_count(GridModelKind model);
[[nodiscard]] std::string_view name_of(LatticeKind kind);
[[nodiscard]] std::string_view name_of(Stagger stagger);

// The name of a parameter: tx, ty, a, b ... or x_u2v1 for the factor of u^2 v in x.
[[nodiscard]] std::string parameter_name(GridModelKind model, int index);

inline constexpr double kHalfSqrt3 = 0.86602540378443864676;  // between the rows of a hexagonal lattice, pitches
// 1 if the row (or column) of this number is shifted, else 0.
constexpr int shifted(int index, int parity) { return static_cast<int>(static_cast<unsigned>(index + parity) & 1U); }

struct PixelPoint {
    double x_px = 0, y_px = 0;
};

// Ideal lattice coordinates in units of the pitch, then normalised: u = (U - origin_u) / span, and v likewise.
//   square: U = m, V = n.   rows staggered: U = m + s(n)/2, V = n sqrt(3)/2.   columns: U = m sqrt(3)/2, V = n +
//   s(m)/2.
// s(k) is 1 where k + parity is odd, else 0.
struct LensletGrid {
    LatticeKind kind = LatticeKind::square;
    Stagger stagger = Stagger::none;
    int parity = 0;             // 0 or 1
    int columns = 0, rows = 0;  // lenslets m in [0, columns), n in [0, rows); not all need lie inside the frame
    double origin_u = 0, origin_v = 0, span = 1;

    GridModelKind model = GridModelKind::similarity;
    std::vector<double> parameters;           // parameter_count(model) of them
    double middle_x_px = 0, middle_y_px = 0;  // centre of radial distortion, before the fitted shift
    double radius_px = 1;                     // unit of the radial terms k1, k2

    int width_px = 0, height_px = 0;  // of the raw frame

    // Each lenslet's offset from the model, row by row, columns x rows; empty: all 0.
    std::vector<PixelPoint> shifts_px;

    [[nodiscard]] bool contains(int m, int n) const { return m >= 0 && n >= 0 && m < columns && n < rows; }
    // Whether a point lies on a pixel of the frame.
    [[nodiscard]] bool in_frame(PixelPoint p) const {
        return p.x_px >= -0.5 && p.y_px >= -0.5 && p.x_px < width_px - 0.5 && p.y_px < height_px - 0.5;
    }
    // Of lenslet (m, n) in arrays of columns x rows, row by row.
    [[nodiscard]] std::size_t index(int m, int n) const {
        return static_cast<std::size_t>(n) * static_cast<std::size_t>(columns) + static_cast<std::size_t>(m);
    }

    // Normalised lattice coordinates of lenslet (m, n).
    struct Uv {
        double u = 0, v = 0;
    };
    [[nodiscard]] Uv uv(int m, int n) const;
    [[nodiscard]] PixelPoint at(Uv where) const;
    [[nodiscard]] PixelPoint centre_px(int m, int n) const {
        const PixelPoint ideal = at(uv(m, n));
        if (shifts_px.empty() || !contains(m, n)) return ideal;
        const PixelPoint& shift = shifts_px[index(m, n)];
        return {ideal.x_px + shift.x_px, ideal.y_px + shift.y_px};
    }

    // The step of one pitch along u and along v at a point, by central differences of half a pitch.
    struct Steps {
        PixelPoint along_u, along_v;
        [[nodiscard]] double area_px2() const {  // negative if the axes are mirrored
            return along_u.x_px * along_v.y_px - along_u.y_px * along_v.x_px;
        }
        [[nodiscard]] double mean_px() const { return std::sqrt(std::abs(area_px2())); }
    };
    [[nodiscard]] Steps steps_px(Uv where) const;
};

// The radial distortion of a model: where it is in the parameters, and what it does.
struct RadialTerms {
    int first = -1;       // index of k1; -1: the model has no distortion
    bool second = false;  // has k2, cx and cy after k1
};
[[nodiscard]] RadialTerms radial_terms(GridModelKind model);
// Distance from the centre of distortion after the distortion over that before it, minus 1. r2 as of GridModelKind.
[[nodiscard]] double radial_stretch(GridModelKind model, double k1, double k2, double r2);

// Checks counts, parameters and ranges. Fails with invalid_argument, naming the first problem.
Result<void> check(const LensletGrid& grid);

}  // namespace hord::algo
