// The Jacobian of the mean deflection by central differences (Eqs. 12-14).
//
//     J = | (x(m+1) - x(m-1)) / 2    (x(n+1) - x(n-1)) / 2 |     unit: bin pitches per lenslet
//         | (y(m+1) - y(m-1)) / 2    (y(n+1) - y(n-1)) / 2 |
//
// One-sided beside a lenslet without a HORD (algo/features/stencil.h). Derivation and error bounds of the numbers:
// docs/notes/features.md. Test: tests/algo/features/jacobian_test.cpp.
//
//   entries     Q6.25: at most 14, error < 2^-23 if deflections are wrong by 2^-24
//   Frobenius   Q6.25: error < 2^-12
//   nuclear     s1 + s2 of the singular values s1 >= s2: below 40, error < 2^-21
//   spectral    s1: at most 28, error < 2^-21
//   anisotropy  (s1 - s2) / (s1 + s2): 0 (no direction) to 1 (one direction only); 0 for a zero Jacobian. Q0.24,
//               rounded; significant only where the Jacobian is
#pragma once

#include <cmath>

#include "algo/features/deflection.h"
#include "algo/features/stencil.h"

namespace hord::algo {

using SlopeQ = Q<6, 25>;

struct Jacobian {
    SlopeQ x_by_m, x_by_n, y_by_m, y_by_n;
};

// From the mean deflections of the lenslets of the stencils.
Jacobian jacobian_of(const Stencil& across, const Deflection& left, const Deflection& right, const Stencil& down,
                     const Deflection& above, const Deflection& below);

// sqrt of the sum of the squared entries (Eq. 14), of raw values. A compiler can vectorise loops over it.
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
