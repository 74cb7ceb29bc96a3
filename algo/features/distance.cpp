#include "algo/features/distance.h"

#include <algorithm>
#include <cmath>
#include <optional>
#include <vector>

#include "algo/emd/emd_solver.h"
#include "algo/emd/projection.h"
#include "algo/features/cramer_von_mises.h"
#include "algo/features/logarithm.h"
#include "algo/frame/occupied_bins.h"
#include "common/fixed.h"

namespace hord::algo {
namespace {

constexpr int kSlices = 8;
// cos and sin of k * 22.5 degrees and sin(pi/16), as literals: library functions round differently per platform.
constexpr double kC1 = 0.92387953251128674, kS1 = 0.38268343236508977, kC2 = 0.70710678118654752;
constexpr double kSliceDirections[kSlices][2] = {{1, 0}, {kC1, kS1},  {kC2, kC2},  {kS1, kC1},
                                                 {0, 1}, {-kS1, kC1}, {-kC2, kC2}, {-kC1, kS1}};
constexpr double kSliceScale = 0.19509032201612825;

// Calls visit(bin, a * S_b, b * S_a) for every bin lit in either; a mass < 2^16 and a sum < 2^24: exact.
template <class Visit>
void for_each_lit(const Hord& a, const Hord& b, int bins, Visit visit) {
    expect_no_overflow(a.sum < kSumLimit && b.sum < kSumLimit);
    OccupiedBins(a.mass, b.mass, bins).for_each([&](int k) {
        visit(k, static_cast<double>(std::int64_t{a.mass[k]} * b.sum),
              static_cast<double>(std::int64_t{b.mass[k]} * a.sum));
    });
}

}  // namespace

struct Distance::State {
    Feature feature = Feature::emd;
    int bins = 0;
    std::vector<Direction> directions;
    std::vector<Projection> projections;
    std::optional<EmdSolver> emd;
    std::optional<CramerVonMises> cramer_von_mises;
    Difference difference;
    std::uint64_t saturated = 0;

    double centroid(const Hord& a, const Hord& b);
    double projected(const Hord& a, const Hord& b);
    double bhattacharyya(const Hord& a, const Hord& b);
    double evaluate(const Hord& a, const Hord& b);
};

double Distance::State::centroid(const Hord& a, const Hord& b) {
    double x = 0, y = 0;
    for_each_lit(a, b, bins, [&](int k, double p, double q) {
        x += (p - q) * directions[static_cast<std::size_t>(k)].x;
        y += (p - q) * directions[static_cast<std::size_t>(k)].y;
    });
    return std::sqrt(x * x + y * y);
}

double Distance::State::projected(const Hord& a, const Hord& b) {
    difference.count = 0;
    for_each_lit(a, b, bins, [&](int k, double p, double q) {
        difference.bin[static_cast<std::size_t>(difference.count)] = static_cast<std::uint8_t>(k);
        difference.mass[static_cast<std::size_t>(difference.count)] = p - q;
        ++difference.count;
    });
    if (feature == Feature::marginal) {
        const double x = projections[0].distance(difference);
        const double y = projections[1].distance(difference);
        return std::sqrt(x * x + y * y);
    }
    if (feature == Feature::cramer_von_mises) return std::sqrt(cramer_von_mises->squared(difference));
    double sum = 0, largest = 0;
    for (const Projection& projection : projections) {
        const double w1 = projection.distance(difference);
        sum += w1;
        largest = std::max(largest, w1);
    }
    return feature == Feature::max_sliced ? largest : kSliceScale * sum;
}

double Distance::State::bhattacharyya(const Hord& a, const Hord& b) {
    double overlap = 0;
    for_each_lit(a, b, bins, [&](int, double p, double q) { overlap += std::sqrt(p) * std::sqrt(q); });
    if (overlap == 0) {
        ++saturated;
        return kBhattacharyyaLimit;
    }
    const double share = overlap / (static_cast<double>(a.sum) * static_cast<double>(b.sum));
    return share >= 1 ? 0 : -exact_logarithm(share);
}

double Distance::State::evaluate(const Hord& a, const Hord& b) {
    if (a.sum == 0 || b.sum == 0) return 0;
    const double unit = static_cast<double>(a.sum) * static_cast<double>(b.sum);
    double sum = 0;
    switch (feature) {
        case Feature::centroid: return centroid(a, b) / unit;
        case Feature::marginal:
        case Feature::sliced:
        case Feature::cramer_von_mises:
        case Feature::max_sliced: return projected(a, b) / unit;
        case Feature::bhattacharyya: return bhattacharyya(a, b);
        case Feature::hellinger:
            for_each_lit(a, b, bins, [&](int, double p, double q) {
                const double root = std::sqrt(p) - std::sqrt(q);
                sum += root * root;
            });
            return std::sqrt(sum / (2 * unit));
        case Feature::chi2:
            for_each_lit(a, b, bins, [&](int, double p, double q) { sum += (p - q) * (p - q) / (p + q); });
            return sum / (2 * unit);
        default: return emd->distance(a, b);
    }
}

Result<Distance> Distance::create(Feature feature, int bins_i, int bins_j, const Options& options, Isa isa) {
    if (!is_distance(feature)) {
        return fail(ErrorCode::invalid_argument, std::string(name_of(feature)) + " is not a distance between two HORDs",
                    "use one of emd, emd-l1, emd-sq, centroid, marginal, sliced, bhattacharyya, hellinger, chi2, "
                    "cramer-von-mises, max-sliced");
    }
    const auto norm = feature == Feature::emd_l1 ? GroundNorm::manhattan
        : feature == Feature::emd_sq             ? GroundNorm::squared_euclidean
                                                 : GroundNorm::euclidean;
    const auto ground = options.directions.empty()
        ? GroundDistance::between_bins(bins_i, bins_j, norm, options.threshold)
        : GroundDistance::between_directions(bins_i, bins_j, options.directions, norm, options.threshold);
    if (!ground) return tl::unexpected(ground.error());

    auto state = common::make_opaque<State>();
    state->feature = feature;
    state->bins = ground->bins();
    state->directions.assign(ground->directions().begin(), ground->directions().end());
    if (feature <= Feature::emd_sq) {
        auto emd = EmdSolver::create(*ground, isa);
        if (!emd) return tl::unexpected(emd.error());
        state->emd.emplace(std::move(*emd));
    }
    if (feature == Feature::marginal) {
        state->projections.emplace_back(state->directions, 1.0, 0.0);
        state->projections.emplace_back(state->directions, 0.0, 1.0);
    }
    if (feature == Feature::cramer_von_mises)
        state->cramer_von_mises.emplace(state->directions, static_cast<double>(std::max(bins_i, bins_j)));
    if (feature == Feature::sliced || feature == Feature::max_sliced) {
        for (const auto& [x, y] : kSliceDirections) state->projections.emplace_back(state->directions, x, y);
    }
    return Distance(std::move(state));
}

double Distance::operator()(const Hord& a, const Hord& b) { return state_->evaluate(a, b); }

void Distance::submit(const Hord& a, const Hord& b, double* out) {
    if (state_->emd) {
        state_->emd->submit(a, b, out);
    } else {
        *out = state_->evaluate(a, b);
    }
}

void Distance::submit(const SparseHord& a, const SparseHord& b, double* out) {
    if (state_->emd) {
        state_->emd->submit(a, b, out);
    } else {
        *out = state_->evaluate(a.hord(), b.hord());
    }
}

CompactFunction Distance::compact() const {
    return state_->emd ? state_->emd->compact() : sparse_kernels(Isa::portable).compact;
}

void Distance::finish() {
    if (state_->emd) state_->emd->finish();
}

std::uint64_t Distance::saturated() const { return state_->saturated; }

}  // namespace hord::algo
