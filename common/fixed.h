// Fixed-point numbers: Q<I, F> has I integer bits, F fraction bits and a sign; value = raw / 2^F, |value| < 2^I.
//
// Only functions with `rounded` or `floored` in their name round. All others are exact: the caller ensures that the
// result is in range, and a build with HORD_CHECKED traps if it is not.
#pragma once

#include <cmath>
#include <cstdint>
#include <type_traits>

namespace hord {

// Marks arithmetic that cannot overflow, for a stated reason. The checked build traps if it does.
constexpr void expect_no_overflow([[maybe_unused]] bool fits) {
#ifdef HORD_CHECKED
    if (!fits) __builtin_trap();
#endif
}

// numerator / denominator to the nearest integer, halves away from zero; denominator > 0, |numerator| < 2^62.
constexpr std::int64_t divide_rounded(std::int64_t numerator, std::int64_t denominator) {
    const std::int64_t half = denominator / 2;
    return (numerator >= 0 ? numerator + half : numerator - half) / denominator;
}

// The largest r with r * r <= value; value < 2^62. The double root is off by at most one, and is then corrected.
inline std::uint64_t square_root_floored(std::uint64_t value) {
    auto root = static_cast<std::uint64_t>(std::sqrt(static_cast<double>(value)));
    root -= root * root > value ? 1U : 0U;
    root += (root + 1) * (root + 1) <= value ? 1U : 0U;
    return root;
}

template <int I, int F>
class Q {
    static_assert(I >= 0 && F >= 0 && I + F <= 62);

  public:
    static constexpr int kFractionBits = F;
    using Raw = std::conditional_t<(I + F <= 31), std::int32_t, std::int64_t>;

    constexpr Q() = default;
    static constexpr Q from_raw(std::int64_t raw) {
        expect_no_overflow(raw < (std::int64_t{1} << (I + F)) && raw >= -(std::int64_t{1} << (I + F)));
        return Q(static_cast<Raw>(raw));
    }
    // numerator / denominator; denominator > 0, |numerator| < 2^(62 - F).
    static constexpr Q from_ratio_rounded(std::int64_t numerator, std::int64_t denominator) {
        return from_raw(divide_rounded(numerator * (std::int64_t{1} << F), denominator));
    }

    [[nodiscard]] constexpr Raw raw() const { return raw_; }
    [[nodiscard]] constexpr double to_double_rounded() const {  // exact up to 53 bits
        return static_cast<double>(raw_) / static_cast<double>(std::int64_t{1} << F);
    }
    [[nodiscard]] constexpr float to_float_rounded() const { return static_cast<float>(to_double_rounded()); }

    // Exactly half: the same bits with the binary point moved.
    [[nodiscard]] constexpr Q<I - 1, F + 1> halved() const { return Q<I - 1, F + 1>::from_raw(raw_); }

    friend constexpr Q operator+(Q a, Q b) { return from_raw(std::int64_t{a.raw_} + b.raw_); }
    friend constexpr Q operator-(Q a, Q b) { return from_raw(std::int64_t{a.raw_} - b.raw_); }
    friend constexpr bool operator==(Q, Q) = default;
    friend constexpr auto operator<=>(Q, Q) = default;

  private:
    constexpr explicit Q(Raw raw) : raw_(raw) {}
    Raw raw_ = 0;
};

}  // namespace hord
