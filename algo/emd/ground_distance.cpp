#include "algo/emd/ground_distance.h"

#include <algorithm>
#include <cmath>

#include "algo/frame/extents.h"

namespace hord::algo {
namespace {

// sqrt, not std::hypot: sqrt is correctly rounded on every platform.
double cost_between(const Direction& a, const Direction& b, GroundNorm norm, double threshold) {
    const double dx = a.x - b.x;
    const double dy = a.y - b.y;
    const double squared = dx * dx + dy * dy;
    const double cost = norm == GroundNorm::euclidean ? std::sqrt(squared)
        : norm == GroundNorm::manhattan               ? std::abs(dx) + std::abs(dy)
                                                      : squared;
    return std::min(cost, threshold);
}

}  // namespace

Result<GroundDistance> GroundDistance::between_bins(int bins_i, int bins_j, GroundNorm norm, double threshold) {
    if (auto fine = check(Extents{kMinLenslets, kMinLenslets, bins_i, bins_j}); !fine)
        return tl::unexpected(fine.error());
    std::vector<Direction> directions;
    for (int j = 0; j < bins_j; ++j) {
        for (int i = 0; i < bins_i; ++i) directions.push_back({static_cast<double>(i), static_cast<double>(j)});
    }
    return between_directions(bins_i, bins_j, directions, norm, threshold);
}

Result<GroundDistance> GroundDistance::between_directions(int bins_i, int bins_j, std::span<const Direction> directions,
                                                          GroundNorm norm, double threshold) {
    if (auto fine = check(Extents{kMinLenslets, kMinLenslets, bins_i, bins_j}); !fine)
        return tl::unexpected(fine.error());
    const auto bins = static_cast<std::size_t>(bins_i) * static_cast<std::size_t>(bins_j);
    if (directions.size() != bins) {
        return fail(ErrorCode::invalid_argument,
                    "a direction map of " + std::to_string(directions.size()) + " directions for " +
                        std::to_string(bins) + " bins",
                    "give one direction a bin");
    }
    for (std::size_t k = 0; k < bins; ++k) {
        const bool good = std::abs(directions[k].x) <= kMaxDirection && std::abs(directions[k].y) <= kMaxDirection;
        if (!good) {
            return fail(ErrorCode::invalid_argument,
                        "the direction of bin " + std::to_string(k) + " is not finite or beyond 1e6 bin pitches",
                        "give directions in bin pitches");
        }
    }
    if (!(threshold > 0)) {
        return fail(ErrorCode::invalid_argument, "a ground-distance threshold of " + std::to_string(threshold),
                    "give a positive threshold, or none");
    }

    GroundDistance ground;
    ground.bins_i_ = bins_i;
    ground.bins_j_ = bins_j;
    ground.norm_ = norm;
    ground.threshold_ = threshold;
    ground.directions_.assign(directions.begin(), directions.end());
    ground.cost_.resize(bins * bins);
    for (std::size_t p = 0; p < bins; ++p) {
        for (std::size_t q = 0; q < bins; ++q) {
            ground.cost_[p * bins + q] = cost_between(directions[p], directions[q], norm, threshold);
        }
    }
    ground.largest_ = *std::max_element(ground.cost_.begin(), ground.cost_.end());
    return ground;
}

}  // namespace hord::algo
