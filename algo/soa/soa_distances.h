// The cheap features at the speed of reading a frame: chi2, hellinger, marginal, centroid and those of the Jacobian.
// Sixteen lenslets at once (algo/soa/soa_row.h); the directions of the bins are one pitch apart.
//
// Error: chi2, hellinger, marginal (bins) < 2e-5; centroid within 2^-21 bin + 2^-24 of itself; the norm of a gradient
// < 6e-5. Lenslets beside a hole are computed one by one in the same order: same bits. Derivation:
// docs/notes/features.md. Test: tests/algo/soa/soa_distances_test.cpp, against the definitions in double.
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

    // `feature`: one that is covered; or emd, whose rows can be loaded for algo/soa/soa_emd_bounds.h, and whose
    // compare_row() and over_neighbours() must not be called. Mean deflections are kept if it needs them, or with
    // `keeps_deflections`.
    SoaDistances(const Extents& extents, Feature feature, Isa isa, bool keeps_deflections = false);

    // Rows first .. last-1 of the map of a whole field (algo/maps/feature_map.h). No allocation. `goes_on`: the
    // previous call computed the previous rows of the same frame.
    void over_neighbours(const FrameView& frame, const LightLevels& levels, int first, int last, float* values,
                         std::uint8_t* mask, bool goes_on = false);
    void against(const FrameView& frame, const FrameView& reference, const LightLevels& levels, int first, int last,
                 float* values, std::uint8_t* mask);

    // The same row by row, for callers that also need the rows (algo/inspection/pipeline.h): load() rows n-1, n and n+1
    // of those that exist, then compute row n. Deflections and the Jacobian only if deflections are kept.
    void load(const FrameView& frame, const LightLevels& levels, int n) { load(frame, levels, n, n); }
    // As row n, row `from` of the frame.
    void load(const FrameView& frame, const LightLevels& levels, int n, int from);
    // Only the blocks first to last (algo/soa/soa_row.h); without deflections.
    void load_blocks(const FrameView& frame, const LightLevels& levels, int n, int first, int last) {
        row(n).decode(frame, levels, n, first, last);
    }
    [[nodiscard]] const SoaRow& loaded(int n) const { return rows_[static_cast<std::size_t>(n % 3)]; }
    [[nodiscard]] Deflection deflection(int m, int n) const {
        const Means& means = means_[static_cast<std::size_t>(n % 3)];
        return {DeflectionQ::from_raw(means.x[static_cast<std::size_t>(m)]),
                DeflectionQ::from_raw(means.y[static_cast<std::size_t>(m)])};
    }
    void mark_row(int n, std::uint8_t* mask) const;
    // Every lenslet of a block of row n, and every neighbour of one, has a HORD.
    [[nodiscard]] bool all_neighbours_have_hords(int n, int block) const;
    void compare_row(int n, float* values, const std::uint8_t* mask);  // mask: from mark_row()
    // The Frobenius norm of the Jacobian, for every feature.
    void slopes_row(int n, float* frobenius, const std::uint8_t* mask);
    [[nodiscard]] Jacobian jacobian(int m, int n) const;  // only where the mask has no kNoGradient bit

    // Raw mean deflections of the neighbours of lenslets 0, 1, ...
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
    void compare_block(int n, int block, float* values, const std::uint8_t* mask);
    [[nodiscard]] float squared_alone(const SoaRow& a, int m_a, const SoaRow& b, int m_b) const;
    [[nodiscard]] float by_deflections(Feature which, int m, int n) const;

    Extents extents_;
    Feature feature_;
    std::vector<SoaRow> rows_;    // three; row n in place n % 3
    std::array<Means, 3> means_;  // empty unless deflections are kept
    std::size_t stride_ = 0;      // from an array to the next
    int along_x_ = 0;             // arrays of the marginal along x
    void (*divide_)(const std::int32_t* moment, const std::uint32_t* sum, int count, std::int32_t* mean);
    void (*slopes_)(const MeanRows& rows, bool centroid, int count, float* values);
    // Squared distances between sixteen lenslets of a and of b, over the lit arrays.
    void (*add_up_)(const float* a, const float* b, std::size_t stride, const SoaRow::Lit& lit, int along_x,
                    float* squared);
};

}  // namespace hord::algo
