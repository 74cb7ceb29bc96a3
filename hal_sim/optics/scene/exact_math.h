// Elementary functions of +, -, *, / and sqrt only, whose rounding IEEE 754 defines: the same bits on every machine.
// (The last bit of libm results differs between libraries. This file is compiled without contraction.)
//
// Accuracy, against libm, tested: relative 4e-16 for log away from 1 and exp, absolute 3e-16 for atan2, sin, cos.
#pragma once

namespace hord::sim::exact {

// (-pi, pi]; 0 at the origin. The Cephes rational approximation (S. Moshier, Methods and Programs for Mathematical
// Functions, 1989).
double atan2(double y, double x);
double log(double x);  // x > 0, finite; by atanh's series on [sqrt(1/2), sqrt(2))
double exp(double x);  // -700 < x < 700, clamped beyond; by Taylor's series on [-ln 2 / 2, ln 2 / 2]
void sin_cos(double x, double& sine, double& cosine);  // |x| < 1e5; Taylor's series on [-pi/4, pi/4]

}  // namespace hord::sim::exact
