// How far from the reference's pose a good part may lie before its edges count as defects.
//
// Between lenslets the reference is interpolated. The light of a lenslet that an edge halves changes with the pose by
// twice as much as interpolation expects, so that half of the change is left as a deviation. A part that was learned
// from poses as far away is allowed it; one that lies farther is not (docs/notes/reference.md, "How far a part may
// lie").
#pragma once

#include <functional>
#include <optional>
#include <vector>

#include "algo/reference/pose.h"
#include "algo/reference/reference.h"

namespace hord::algo {

// Interpolation is at its worst with an edge so many lenslets off.
constexpr double kWorstShift = 0.44;

// Lenslets by which an edge may lie off its place in the reference. Beyond it good parts may be rejected, at the edge
// that allows least. None: interpolation errors stay within the spread of the learned parts, however far they lie.
// `reject_score`: the recipe's.
std::optional<double> edge_tolerance(const Reference& reference, double reject_score);

// As that, and at least twice as far as two of the learned parts lay: the spread allows the next part as much
// (algo/reference/spread_estimate.h). `shifts`: how far each lay from the reference's pose, lenslets.
std::optional<double> edge_tolerance(const Reference& reference, std::vector<double> shifts, double reject_score);

// Whether `pose` moves an edge of the reference farther than that, of the lenslets of the reference that are `asked`
// for.
bool moves_edges_too_far(
    const Reference& reference, const Pose& pose, double reject_score,
    const std::function<bool(int, int)>& asked = [](int, int) { return true; });

}  // namespace hord::algo
