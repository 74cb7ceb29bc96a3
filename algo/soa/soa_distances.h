// The features that need little arithmetic, at the speed at which a frame can be read: chi2, hellinger, marginal,
// centroid, and the Jacobian's. Sixteen lenslets are worked on at once (algo/soa/soa_row.h); the bins' directions are
// one pitch apart.
//
// Numbers. centroid and the Jacobian's are made of mean deflections (algo/features/deflection.h,
// algo/features/jacobian.h): centroid from their exact differences, in double: within 2^-21 bin and 2^-24 of itself of
// exact. The others are floats of the shares (each within 2^-22 of itself), whose differences and sums round by 2^-24 a
// step, 225 steps at most:
//   hellinger  of roots: |error| < 2^-22 * sqrt(2) + 225 * 2^-24 of itself < 2e-5   (contract: 1e-4)
//   chi2       a term (h-g)^2 / (h+g) is off by at most 2 * 2^-22 * (h+g) + its own rounding: in all below 2e-5
//   (contract: 1e-4) marginal   of cumulative sums, exact before they are scaled: below 28 * 2^-22 + rounding: 2e-5 bin
// A gradient's norm adds two such errors, twice each beside a hole: below 6e-5. Where the same lanes are computed one
// by one (beside lenslets without a HORD) the order is the same: a value does not depend on how it was computed.
//
// Test: tests/algo/soa/soa_distances_test.cpp, against the definitions in double.
#pragma once

#include <array>
#include <cstdint>
#include <vector>

#include "algo/features/deflection.h"
#include "algo/features/feature.h"
#include "algo/features/jacobian.h"
#include "algo/soa/soa_row.h"

namespace hord::algo {

class SoaDistances {
  public:
    static bool covers(Feature feature);

    // A feature that is covered. Mean deflections are kept if it is made of them, or somebody wants them.
    SoaDistances(const Extents& extents, Feature feature, Isa isa, bool keeps_deflections = false);

    // Rows first .. last-1 of a whole field's map; algo/maps/feature_map.h says what is in it. No allocation.
    // `goes_on`: the call before was of the rows before, of this frame.
    void over_neighbours(const FrameView& frame, const LightLevels& levels, int first, int last, float* values,
                         std::uint8_t* mask, bool goes_on = false);
    void against(const FrameView& frame, const FrameView& reference, const LightLevels& levels, int first, int last,
                 float* values, std::uint8_t* mask);
    void against(const FrameView& frame, std::span<const Hord> reference, const LightLevels& levels, int first,
                 int last, float* values, std::uint8_t* mask);

    // The same row by row, for whoever needs more of the rows (algo/inspection/pipeline.h): load(n-1), load(n) and
    // load(n+1), those that exist, then what is asked of row n. Deflections and what is made of them: only of a
    // SoaDistances that keeps them.
    void load(const FrameView& frame, const LightLevels& levels, int n);
    [[nodiscard]] const SoaRow& loaded(int n) const { return rows_[static_cast<std::size_t>(n % 3)]; }
    [[nodiscard]] Deflection deflection(int m, int n) const {
        const Means& means = means_[static_cast<std::size_t>(n % 3)];
        return {DeflectionQ::from_raw(means.x[static_cast<std::size_t>(m)]),
                DeflectionQ::from_raw(means.y[static_cast<std::size_t>(m)])};
    }
    void mark_row(int n, std::uint8_t* mask) const;
    void compare_row(int n, float* values, const std::uint8_t* mask);  // mask as mark_row() left it
    void slopes_row(int n, float* frobenius,
                    const std::uint8_t* mask);            // the Jacobian's Frobenius norm, whatever the feature
    [[nodiscard]] Jacobian jacobian(int m, int n) const;  // where the mask does not say kNoGradient

    // Raw mean deflections around lenslets 0, 1, ...; values come out for lenslets that have all four neighbours.
    struct MeanRows {
        const std::int32_t *x_left, *x_right, *x_above, *x_below, *y_left, *y_right, *y_above, *y_below;
    };

  private:
    [[nodiscard]] SoaRow& row(int n) { return rows_[static_cast<std::size_t>(n % 3)]; }
    // Mean deflections of a row, raw.
    struct Means {
        std::vector<std::int32_t> x, y;
    };
    void compare_with_reference(float* values, std::uint8_t* mask);
    void slopes_row(Feature which, int n, float* values, const std::uint8_t* mask);
    [[nodiscard]] bool surrounded(int n, int block) const;
    void compare_planes(int n, int block, float* values, const std::uint8_t* mask);
    [[nodiscard]] float squared_alone(const SoaRow& a, int m_a, const SoaRow& b, int m_b) const;
    [[nodiscard]] float by_deflections(Feature which, int m, int n) const;

    Extents extents_;
    Feature feature_;
    std::vector<SoaRow> rows_;    // three; row n in place n % 3
    std::array<Means, 3> means_;  // empty unless the feature is made of them
    std::size_t stride_ = 0;      // from a plane to the next
    int along_x_ = 0;             // planes of the marginal along x
    void (*divide_)(const std::int32_t* moment, const std::uint32_t* sum, int count, std::int32_t* mean);
    void (*slopes_)(const MeanRows& rows, bool centroid, int count, float* values);
    // Squared distances of sixteen lenslets of a from sixteen of b, over the lit planes.
    void (*add_up_)(const float* a, const float* b, std::size_t stride, const SoaRow::Lit& lit, int along_x,
                    float* squared);
};

}  // namespace hord::algo
