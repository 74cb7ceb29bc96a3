// The generalised Cramér-von Mises distance of two HORDs by localised cumulative distributions (LCD).
//
//     F(m, b) = sum over bins of h(r) exp(-|r - m|^2 / (2 b^2))                       LCD of h at place m and width b
//     D       = integral over b from 0 to B of 1/b times the integral over all m of (F_a(m, b) - F_b(m, b))^2
//
// U. D. Hanebeck and V. Klumpp, "Localized cumulative distributions and a multivariate generalization of the Cramér-von
// Mises distance", MFI 2008; for deflection maps: J. Meyer, T. Längle, J. Beyerer, "General Cramér-von Mises, a helpful
// ally for transparent object inspection using deflection maps?", SCIA 2017, DOI 10.1007/978-3-319-59126-1_44.
// The inner integral of two Gaussians is pi b^2 exp(-r^2 / (4 b^2)), so with s = r^2 / (4 B^2)
//
//     D = -sum over pairs of bins of d_i d_j g(|r_i - r_j|),    g(r) = pi/2 (B^2 (1 - exp(-s)) + r^2 / 4 E1(s))
//
// d = h_a - h_b sums to 0. sqrt(D) is a metric, in bin pitches. Only +, -, *, / and sqrt: the same bits on every
// platform. Absolute error of sqrt(D) below 1e-7 (the sum cancels). Test: tests/algo/features/distance_test.cpp.
#pragma once

#include <span>
#include <vector>

#include "algo/emd/projection.h"

namespace hord::algo {

class CramerVonMises {
  public:
    // `directions`: one a bin, bin pitches. `width`: B, bin pitches, > 0.
    CramerVonMises(std::span<const Direction> directions, double width);

    // D times the square of the common denominator.
    [[nodiscard]] double squared(const Difference& difference) const;

  private:
    std::size_t bins_;
    std::vector<double> g_;  // of each pair of bins
};

}  // namespace hord::algo
