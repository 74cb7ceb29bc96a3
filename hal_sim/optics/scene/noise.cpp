#include "hal_sim/optics/scene/noise.h"

#include <cmath>

#include "hal_sim/optics/scene/exact_math.h"

namespace hord::sim {
namespace {

// ln(k!) for k >= 0: exact products up to 9, then Stirling's series (error below 1e-13 from 10 on).
double log_factorial(double k) {
    if (k < 10) {
        double product = 1;
        for (double f = 2; f <= k; ++f) product *= f;
        return exact::log(product);
    }
    constexpr double kHalfLog2Pi = 0.91893853320467274178;
    const double x = k + 1, r = 1 / x, r2 = r * r;
    const double series = r * (1.0 / 12 - r2 * (1.0 / 360 - r2 * (1.0 / 1260 - r2 * (1.0 / 1680 - r2 / 1188))));
    return (x - 0.5) * exact::log(x) - x + kHalfLog2Pi + series;
}

template <int N>
double polynomial(const double (&c)[N], double x) {
    double sum = c[N - 1];
    for (int k = N - 2; k >= 0; --k) sum = sum * x + c[k];
    return sum;
}

}  // namespace

void philox(std::uint32_t counter[4], const std::uint32_t key[2]) {
    std::uint32_t k0 = key[0], k1 = key[1];
    for (int round = 0; round < 10; ++round) {
        const std::uint64_t a = std::uint64_t{0xD2511F53U} * counter[0], b = std::uint64_t{0xCD9E8D57U} * counter[2];
        const std::uint32_t next[4] = {
            static_cast<std::uint32_t>(b >> 32) ^ counter[1] ^ k0, static_cast<std::uint32_t>(b),
            static_cast<std::uint32_t>(a >> 32) ^ counter[3] ^ k1, static_cast<std::uint32_t>(a)};
        for (int w = 0; w < 4; ++w) counter[w] = next[w];
        k0 += 0x9E3779B9U;
        k1 += 0xBB67AE85U;
    }
}

Noise::Noise(std::uint64_t seed, std::uint64_t place, std::uint32_t purpose)
    : key_{static_cast<std::uint32_t>(seed), static_cast<std::uint32_t>(seed >> 32)},
      place_{static_cast<std::uint32_t>(place), static_cast<std::uint32_t>(place >> 32)}, purpose_(purpose), word_{} {}

double Noise::uniform() {
    if (left_ == 0) {
        word_[0] = place_[0], word_[1] = place_[1], word_[2] = purpose_, word_[3] = block_++;
        philox(word_, key_);
        left_ = 4;
    }
    const std::uint64_t high = word_[left_ - 1], low = word_[left_ - 2];
    left_ -= 2;
    const std::uint64_t bits = (high << 21) ^ (low >> 11);  // 53 bits
    return (static_cast<double>(bits) + 0.5) * 0x1p-53;
}

double Noise::normal() {
    static constexpr double a[] = {3.3871328727963666080e0,  1.3314166789178437745e+2, 1.9715909503065514427e+3,
                                   1.3731693765509461125e+4, 4.5921953931549871457e+4, 6.7265770927008700853e+4,
                                   3.3430575583588128105e+4, 2.5090809287301226727e+3};
    static constexpr double b[] = {1.0,
                                   4.2313330701600911252e+1,
                                   6.8718700749205790830e+2,
                                   5.3941960214247511077e+3,
                                   2.1213794301586595867e+4,
                                   3.9307895800092710610e+4,
                                   2.8729085735721942674e+4,
                                   5.2264952788528545610e+3};
    static constexpr double c[] = {1.42343711074968357734e0,  4.63033784615654529590e0, 5.76949722146069140550e0,
                                   3.64784832476320460504e0,  1.27045825245236838258e0, 2.41780725177450611770e-1,
                                   2.27238449892691845833e-2, 7.74545014278341407640e-4};
    static constexpr double d[] = {1.0,
                                   2.05319162663775882187e0,
                                   1.67638483018380384940e0,
                                   6.89767334985100004550e-1,
                                   1.48103976427480074590e-1,
                                   1.51986665636164571966e-2,
                                   5.47593808499534494600e-4,
                                   1.05075007164441684324e-9};
    static constexpr double e[] = {6.65790464350110377720e0,  5.46378491116411436990e0,  1.78482653991729133580e0,
                                   2.96560571828504891230e-1, 2.65321895265761230930e-2, 1.24266094738807843860e-3,
                                   2.71155556874348757815e-5, 2.01033439929228813265e-7};
    static constexpr double f[] = {1.0,
                                   5.99832206555887937690e-1,
                                   1.36929880922735805310e-1,
                                   1.48753612908506148525e-2,
                                   7.86869131145613259100e-4,
                                   1.84631831751005468180e-5,
                                   1.42151175831644588870e-7,
                                   2.04426310338993978564e-15};
    const double p = uniform(), q = p - 0.5;
    if (std::abs(q) <= 0.425) {
        const double r = 0.180625 - q * q;
        return q * polynomial(a, r) / polynomial(b, r);
    }
    const double r = std::sqrt(-exact::log(q < 0 ? p : 1 - p));
    const double x =
        r <= 5 ? polynomial(c, r - 1.6) / polynomial(d, r - 1.6) : polynomial(e, r - 5) / polynomial(f, r - 5);
    return q < 0 ? -x : x;
}

std::uint64_t Noise::poisson(double mean) {
    if (!(mean > 0)) return 0;
    if (mean < 10) {
        double term = exact::exp(-mean), u = uniform() - term;
        std::uint64_t k = 0;
        while (u > 0 && k < 200) {
            term *= mean / static_cast<double>(++k);
            u -= term;
        }
        return k;
    }
    const double b = 0.931 + 2.53 * std::sqrt(mean), a = -0.059 + 0.02483 * b;
    const double inverse_alpha = 1.1239 + 1.1328 / (b - 3.4), log_mean = exact::log(mean);
    const double v_r = 0.9277 - 3.6224 / (b - 2);
    for (;;) {
        const double u = uniform() - 0.5, v = uniform();
        const double us = 0.5 - std::abs(u);
        const double k = std::floor((2 * a / us + b) * u + mean + 0.43);
        if (us >= 0.07 && v <= v_r) return static_cast<std::uint64_t>(k);
        if (k < 0 || (us < 0.013 && v > us)) continue;
        if (exact::log(v * inverse_alpha / (a / (us * us) + b)) <= k * log_mean - mean - log_factorial(k)) {
            return static_cast<std::uint64_t>(k);
        }
    }
}

}  // namespace hord::sim
