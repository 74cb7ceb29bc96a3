// Lines of lenslets across the places where a reference's light steps from one level to another, in a registered part.
#pragma once

#include <array>
#include <cmath>
#include <cstddef>
#include <span>

#include "algo/frame/extents.h"
#include "algo/reference/pose.h"
#include "algo/reference/registered_maps.h"

namespace hord::algo {

struct StepLine {
    static constexpr int kReach = 5;  // lenslets before and behind the one where the step is
    static constexpr int kFlat = 3;   // from here on a step, one that moved by three lenslets too, shows its level

    double along;                              // of the line, lenslets along the step
    double place;                              // of the step, lenslets from the middle one
    double slant;                              // lenslets that the step moves from one line to the next
    double before, behind;                     // the reference's light, of the typical one
    std::array<double, 2 * kReach + 1> light;  // the part's, of the typical one

    [[nodiscard]] double at(int k) const { return light[static_cast<std::size_t>(k + kReach)]; }
    // Share of lenslet `k` behind a sharp step that lies `aside` behind the reference's.
    [[nodiscard]] double share(int k, double aside) const;
};

// About kMax lines, evenly over all, before and behind the middle of these.
struct StepLines {
    static constexpr std::size_t kMax = 256, kMin = 8;  // fewer are specks
    std::array<std::array<StepLine, kMax>, 2> of;
    std::array<std::size_t, 2> count{};

    [[nodiscard]] std::span<StepLine> side(std::size_t which) { return std::span(of[which]).first(count[which]); }
    // `axis`: 0 for steps across x, 1 across y. `typical`: the reference's typical light, DN. `light`: the part's light
    // over the reference's. Precondition: empty.
    void collect(const Extents& extents, const ReferenceMaps& reference, const PartMaps& part, const PoseMap& map,
                 std::size_t axis, double typical, double light);
};

}  // namespace hord::algo
