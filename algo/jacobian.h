// How fast the mean deflection changes from lenslet to lenslet: its Jacobian by central differences (Eqs. 12-14).
//
//     J = | (x(m+1) - x(m-1)) / 2    (x(n+1) - x(n-1)) / 2 |     unit: bin pitches a lenslet
//         | (y(m+1) - y(m-1)) / 2    (y(n+1) - y(n-1)) / 2 |
//
// and one-sided beside a lenslet without a HORD (algo/stencil.h).
//
// Halving is exact (the point moves: Q7.24 becomes Q6.25). A deflection is at most 7, a weighted difference at most
// 2 * 14 < 128, an entry at most 14 and wrong by less than 2^-23 where the deflections are by 2^-24. Norms are Q6.25: a
// raw entry is below 2^29, the sum of four squares below 2^60, its root below 2^30; the root is floored, so the Frobenius
// norm is within 2 * 2^-23 + 2^-25 < 2^-12 of exact (tests/algo/jacobian_test.cpp).
#pragma once

#include "algo/deflection.h"
#include "algo/stencil.h"

namespace hord::algo {

using SlopeQ = Q<6, 25>;

struct Jacobian {
    SlopeQ x_by_m, x_by_n, y_by_m, y_by_n;
};

// The mean deflections of the lenslets that the stencils name.
Jacobian jacobian_of(const Stencil& across, const Deflection& left, const Deflection& right, const Stencil& down, const Deflection& above,
                     const Deflection& below);

// sqrt of the sum of the squared entries (Eq. 14).
SlopeQ frobenius_norm(const Jacobian& jacobian);

}  // namespace hord::algo
