// The lenslet grid of a real sensor: where in the raw frame the centre of lenslet (m, n) lies.
//
// This is what a calibration file states and what the decode is built from; calib/ finds it. Pixel (0, 0) is the
// centre of the top-left pixel, x to the right, y down. Only +, -, *, / are used, so that the same file gives the
// same bits on every machine (the build forbids contraction to fused multiply-add).
#pragma once

#include <array>
#include <cstdint>
#include <string_view>
#include <vector>

#include "common/result.h"

namespace hord::algo {

enum class LatticeKind : std::uint8_t { square, hexagonal };

// Which lenslets of a hexagonal lattice are shifted by half a pitch: those of every second row (to the right), or
// those of every second column (downwards).
enum class Stagger : std::uint8_t { none, rows, columns };

// The ladder of models, simplest first. Each maps normalised lattice coordinates (u, v) to pixels.
enum class GridModelKind : std::uint8_t {
    similarity,  // 4: shift, rotation, one pitch
    affine,      // 6: + two pitches, shear
    homography,  // 8: + perspective
    radial1,     // 9: + k1 about the middle of the frame
    radial2,     // 12: + k2 and the centre of distortion
    cubic,       // 20: two polynomials of order 3
    quintic,     // 42: two polynomials of order 5
};
inline constexpr std::array kGridModels{GridModelKind::similarity, GridModelKind::affine,  GridModelKind::homography,
                                        GridModelKind::radial1,    GridModelKind::radial2, GridModelKind::cubic,
                                        GridModelKind::quintic};

[[nodiscard]] std::string_view name_of(GridModelKind model);
[[nodiscard]] int parameter_count(GridModelKind model);
[[nodiscard]] std::string_view name_of(LatticeKind kind);
[[nodiscard]] std::string_view name_of(Stagger stagger);

// The name of a parameter: tx, ty, a, b ... or x_u2v1 for the factor of u^2 v in x.
[[nodiscard]] std::string parameter_name(GridModelKind model, int index);

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
    std::vector<double> parameters;           // parameter_count(rung) of them
    double middle_x_px = 0, middle_y_px = 0;  // of radial distortion, before the fitted shift
    double radius_px = 1;                     // where the radial terms are k1, k2

    int width_px = 0, height_px = 0;  // of the raw frame

    // Where single lenslets are not where the model has them: how far each is from there, row by row, columns x rows;
    // empty: nowhere.
    std::vector<PixelPoint> shifts_px;

    // Normalised lattice coordinates of lenslet (m, n).
    struct Uv {
        double u = 0, v = 0;
    };
    [[nodiscard]] Uv uv(int m, int n) const;
    [[nodiscard]] PixelPoint at(Uv where) const;
    [[nodiscard]] PixelPoint centre_px(int m, int n) const {
        const PixelPoint ideal = at(uv(m, n));
        if (shifts_px.empty() || m < 0 || n < 0 || m >= columns || n >= rows) return ideal;
        const PixelPoint& shift =
            shifts_px[static_cast<std::size_t>(n) * static_cast<std::size_t>(columns) + static_cast<std::size_t>(m)];
        return {ideal.x_px + shift.x_px, ideal.y_px + shift.y_px};
    }

    // The local step of one pitch along u and along v at (u, v), from central differences of half a pitch.
    struct Steps {
        PixelPoint along_u, along_v;
    };
    [[nodiscard]] Steps steps_px(Uv where) const;
};

// Counts, parameters and ranges; invalid_argument names the first thing that is wrong.
Result<void> check(const LensletGrid& grid);

}  // namespace hord::algo
