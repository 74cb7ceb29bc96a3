#include "algo/reference/pose_tolerance.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <functional>
#include <utility>
#include <vector>

#include "algo/frame/mask.h"

namespace hord::algo {
namespace {

constexpr double kJump = 0.25;                // across a lenslet or beside it, of the typical light: an edge
constexpr double kLitBins = 9;                // of a lenslet, each with its reading noise
constexpr double kWorst = 0.5 * kWorstShift;  // of an edge's jump: more interpolation does not err

// A lenslet whose light an edge changes. DN.
struct EdgeLenslet {
    int m = 0, n = 0;
    // A lenslet of shift along x and y: the edge's jump, and how much of it interpolation does not expect.
    std::array<double, 2> jump{}, error{};
    double sigma = 0;  // standard deviation of good parts, noise included

    // Lenslets of shift along the axis until `scores` standard deviations are reached; none: they never are.
    [[nodiscard]] std::optional<double> allowed(std::size_t axis, double scores) const {
        if (scores * sigma >= kWorst * jump[axis]) return std::nullopt;
        return scores * sigma / error[axis];
    }
    // Whether a shift along both axes reaches them.
    [[nodiscard]] bool reached(double x, double y, double scores) const {
        double deviation = 0;
        for (const auto& [axis, shift] : {std::pair{0U, x}, std::pair{1U, y}})
            deviation += std::min(std::abs(shift) * error[axis], kWorst * jump[axis]);
        return deviation > scores * sigma;
    }
};

double typical_light(const Reference& r) {
    double sum = 0, count = 0;
    for (std::size_t k = 0; k < r.light.size(); ++k) {
        if (r.mask[k] == kValid) sum += static_cast<double>(r.light[k]), count += 1;
    }
    return count > 0 ? sum / count : 0;
}

std::vector<EdgeLenslet> edge_lenslets(const Reference& r) {
    const Extents& e = r.extents;
    const double least = kJump * typical_light(r), gain = static_cast<double>(r.sensor.electrons_per_dn),
                 read = static_cast<double>(r.sensor.read_dn);
    std::vector<EdgeLenslet> edges;
    if (r.light.size() != e.lenslets()) return edges;
    for (int n = 1; n + 1 < e.n; ++n) {
        for (int m = 1; m + 1 < e.m; ++m) {
            const std::size_t k = e.index(m, n), down = static_cast<std::size_t>(e.m);
            const unsigned around = r.mask[k] | r.mask[k - 1] | r.mask[k + 1] | r.mask[k - down] | r.mask[k + down];
            const auto light = static_cast<double>(r.light[k]);
            if ((around & kOutside) != 0 || light < static_cast<double>(r.levels.min_sum)) continue;
            EdgeLenslet edge{m, n, {}, {}, 0};
            for (const auto& [axis, apart] : {std::pair{0U, std::size_t{1}}, std::pair{1U, down}}) {
                const double before = light - static_cast<double>(r.light[k - apart]),
                             behind = static_cast<double>(r.light[k + apart]) - light,
                             across = std::abs(before + behind);
                edge.jump[axis] = std::max({std::abs(before), std::abs(behind), across});
                edge.error[axis] = edge.jump[axis] - 0.5 * across;
            }
            if (std::max(edge.jump[0], edge.jump[1]) <= least) continue;
            const double spread = static_cast<double>(r.spread[static_cast<std::size_t>(Deviation::light)][k]);
            edge.sigma = std::sqrt(light / gain + kLitBins * (read * read + 1.0 / 12) + spread * light * light);
            edges.push_back(edge);
        }
    }
    return edges;
}

// Standard deviations that are left for the pose: noise alone reaches sqrt(2 ln N) in the largest of N lenslets.
double scores_left(double reject_score, std::size_t edges) {
    return std::max(0.0, reject_score - std::sqrt(2 * std::log(static_cast<double>(std::max<std::size_t>(edges, 1)))));
}

}  // namespace

std::optional<double> edge_tolerance(const Reference& reference, double reject_score) {
    const std::vector<EdgeLenslet> edges = edge_lenslets(reference);
    const double scores = scores_left(reject_score, edges.size());
    std::optional<double> least;
    for (const EdgeLenslet& edge : edges) {
        for (const std::size_t axis : {0U, 1U}) {
            const auto allowed = edge.allowed(axis, scores);
            if (allowed && (!least || *allowed < *least)) least = allowed;
        }
    }
    return least;
}

std::optional<double> edge_tolerance(const Reference& reference, std::vector<double> shifts, double reject_score) {
    constexpr double kAllowed = 2;
    const auto least = edge_tolerance(reference, reject_score);
    if (!least || shifts.size() < 2) return least;
    std::ranges::nth_element(shifts, shifts.begin() + 1, std::greater());
    const double tolerance = std::max(*least, kAllowed * shifts[1]);
    return tolerance < kWorstShift ? std::optional(tolerance) : std::nullopt;
}

bool moves_edges_too_far(const Reference& reference, const Pose& pose, double reject_score,
                         const std::function<bool(int, int)>& asked) {
    const std::vector<EdgeLenslet> edges = edge_lenslets(reference);
    const double scores = scores_left(reject_score, edges.size());
    const PoseMap map(pose, reference.extents);
    return std::ranges::any_of(edges, [&](const EdgeLenslet& edge) {
        const auto at = map.to_part(edge.m, edge.n);
        return edge.reached(at.m - edge.m, at.n - edge.n, scores) && asked(edge.m, edge.n);
    });
}

}  // namespace hord::algo
