// How fast the mean deflection changes from lenslet to lenslet: its Jacobian by central differences (Eqs. 12-14).
//
//     J = | (x(m+1) - x(m-1)) / 2    (x(n+1) - x(n-1)) / 2 |     unit: bin pitches a lenslet
//         | (y(m+1) - y(m-1)) / 2    (y(n+1) - y(n-1)) / 2 |
//
// and one-sided beside a lenslet without a HORD (algo/features/stencil.h).
//
// Halving is exact (the point moves: Q7.24 becomes Q6.25). A deflection is at most 7, a weighted difference at most
// 2 * 14 < 128, an entry at most 14 and wrong by less than 2^-23 where the deflections are by 2^-24. Norms are Q6.25: a
// raw entry is below 2^29, exact in a double; the sum of four squares below 2^60, each operation rounded by 2^-53 of
// itself; its root is below 2^30 and truncated, so the Frobenius norm is within 2 * 2^-23 + 2^-25 + 2^-45 < 2^-12 of
// exact (tests/algo/features/jacobian_test.cpp).
//
// Frobenius alone cannot tell one strong direction from two moderate ones; the singular values s1 >= s2 can. With
//
//     p = |(x_m + y_n, x_n - y_m)|     q = |(x_m - y_n, x_n + y_m)|     (x_m: change of x by m, and so on)
//
// s1 + s2 = max(p, q) and s1 - s2 = min(p, q): two roots of sums of two squares, no subtraction of nearly equal numbers
// and nothing special about singular, zero or nearly rank-one Jacobians. A sum of two raw entries is below 2^30, two
// squares of such below 2^61; both roots are floored to Q6.25.
//   nuclear     s1 + s2 = max(p, q)                 below 40; error below sqrt(2) * 2^-22 + 2^-25 < 2^-21
//   spectral    s1 = (p + q) / 2, exact from p, q    at most 28; error below 2^-21
//   anisotropy  (s1 - s2) / (s1 + s2) = min / max    0 (no direction) to 1 (one direction only); 0 for a zero Jacobian.
//   Q0.24,
//               rounded; its error is that of p and q over max(p, q): it means something only where the slope does.
#pragma once

#include <cmath>

#include "algo/features/deflection.h"
#include "algo/features/stencil.h"

namespace hord::algo {

using SlopeQ = Q<6, 25>;

struct Jacobian {
    SlopeQ x_by_m, x_by_n, y_by_m, y_by_n;
};

// The mean deflections of the lenslets that the stencils name.
Jacobian jacobian_of(const Stencil& across, const Deflection& left, const Deflection& right, const Stencil& down,
                     const Deflection& above, const Deflection& below);

// sqrt of the sum of the squared entries (Eq. 14); of their raw values, written so that a compiler can do many at once.
inline std::int32_t frobenius_raw(std::int32_t x_m, std::int32_t x_n, std::int32_t y_m, std::int32_t y_n) {
    const double a = x_m, b = x_n, c = y_m, d = y_n;
    return static_cast<std::int32_t>(std::sqrt((a * a + b * b) + (c * c + d * d)));
}
SlopeQ frobenius_norm(const Jacobian& jacobian);

using ShareQ = Q<1, 24>;

struct SingularNorms {
    SlopeQ nuclear;
    Q<5, 26> spectral;
    ShareQ anisotropy;
};
SingularNorms singular_norms(const Jacobian& jacobian);

}  // namespace hord::algo
