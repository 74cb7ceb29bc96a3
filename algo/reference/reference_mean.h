// The mean of good parts at the same places of the part: reference HORDs and typical light. Parts are added, and taken
// out again, so that a part can be compared with the mean of the others. A user of algo/reference/reference_learner.h
// only.
#pragma once

#include <cstdint>
#include <span>
#include <vector>

#include "algo/features/deflection.h"
#include "algo/reference/pose.h"
#include "algo/reference/reference.h"

namespace hord::algo {

// A decoded part, one value a lenslet; `shares` (Reference::stride() a lenslet) only on request.
struct DecodedPart {
    std::vector<std::uint32_t> sums;
    std::vector<Deflection> deflections;
    std::vector<std::uint8_t> mask;
    std::vector<float> light, x, y;
    std::vector<std::uint16_t> shares;

    [[nodiscard]] ReferenceMaps maps() const { return {light, x, y, mask}; }
};

class ReferenceMean {
  public:
    explicit ReferenceMean(const Extents& extents) : extents_(extents) {}

    void clear();  // to no parts; allocates

    // Adds the HORDs of a part that lies at `pose` and has `light` times the reference's light. remove() with the same
    // arguments takes it out again.
    void add(const DecodedPart& part, const PoseMap& pose, double light) { sum_up(part, pose, light, 1); }
    void remove(const DecodedPart& part, const PoseMap& pose, double light) { sum_up(part, pose, light, -1); }

    // Writes shares, light, x, y, mask and parts of `reference`, whose extents and sensor are given. `parts`: how many
    // were added; `light`: the median of theirs.
    void finish(double parts, double light, Reference& reference) const;

  private:
    void sum_up(const DecodedPart& part, const PoseMap& pose, double light, int sign);
    [[nodiscard]] static std::size_t stride_of(const Extents& extents);

    Extents extents_;
    std::vector<float> shares_;  // sums, as Reference::shares
    std::vector<double> light_;
    std::vector<std::uint16_t> light_count_, hord_count_;  // parts
};

}  // namespace hord::algo
