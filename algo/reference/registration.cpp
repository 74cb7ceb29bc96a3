#include "algo/reference/registration.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstring>

#include "algo/frame/mask.h"
#include "common/statistics.h"

namespace hord::algo {
namespace {

constexpr int kSampledSide = 40;
constexpr int kSteps = 30;
constexpr double kSettled = 5e-3;        // lenslets, at the field's rim
constexpr double kSwings = 1.0 / 8;      // of a step, after three that turned back
constexpr double kNearlySettled = 0.03;  // where a quarter of the sample has done its part
constexpr int kCoarseSteps = 12;
constexpr std::size_t kMinCoarse = 64;
constexpr double kShiftPrior = 1, kTurnPrior = 0.02;  // lenslets, radians
constexpr double kLightFloor = 0.05,
                 kDeflectionFloor = 0.03;  // of the typical light; bin pitches: what good parts differ by
constexpr double kBendNoise = 0.3;         // of the slope's change over a lenslet
constexpr double kTail = 3;                // noises
constexpr double kNoiseRidge = 4;          // priors count the reference's own noise so many times
constexpr double kTurnShare = 0.05;        // of the maps' changes, to be seen in a turn: else the part is round
constexpr double kForeignLight = 0.25, kForeignBins = 0.4;

// Sums of a weighted least-squares problem in (shift x, shift y, turn).
struct Normal {
    std::array<std::array<double, 3>, 3> a{};
    std::array<double, 3> b{};

    void add(const std::array<double, 3>& slope, double residual, double weight) {
        for (std::size_t r = 0; r < 3; ++r) {
            for (std::size_t c = r; c < 3; ++c) a[r][c] += weight * slope[r] * slope[c];
            b[r] += weight * slope[r] * residual;
        }
    }
    // By Cholesky; the priors keep it positive.
    [[nodiscard]] std::array<double, 3> solved() const {
        std::array<std::array<double, 3>, 3> l{};
        for (std::size_t r = 0; r < 3; ++r) {
            for (std::size_t c = 0; c <= r; ++c) {
                double sum = a[c][r];
                for (std::size_t k = 0; k < c; ++k) sum -= l[r][k] * l[c][k];
                l[r][c] = r == c ? std::sqrt(std::max(sum, 1e-12)) : sum / l[c][c];
            }
        }
        std::array<double, 3> y{}, x{};
        for (std::size_t r = 0; r < 3; ++r) {
            double sum = b[r];
            for (std::size_t k = 0; k < r; ++k) sum -= l[r][k] * y[k];
            y[r] = sum / l[r][r];
        }
        for (std::size_t r = 3; r-- > 0;) {
            double sum = y[r];
            for (std::size_t k = r + 1; k < 3; ++k) sum -= l[k][r] * x[k];
            x[r] = sum / l[r][r];
        }
        return x;
    }
};

}  // namespace

const char* explain(Registered::Outcome outcome) {
    switch (outcome) {
        case Registered::Outcome::found: return "it lies where the reference's parts do";
        case Registered::Outcome::too_little: return "too little of it is seen to find where it lies";
        case Registered::Outcome::too_far:
            return "it lies too far from where the reference's parts did, or is turned too much";
        case Registered::Outcome::foreign: return "it does not look like the reference's parts";
        case Registered::Outcome::unsettled: return "where it lies cannot be settled";
    }
    return "";
}

bool CubicReader::move_to(double m, double n) {
    const double floor_m = std::floor(m), floor_n = std::floor(n);
    const int first_m = static_cast<int>(floor_m) - 1, first_n = static_cast<int>(floor_n) - 1;
    if (first_m < 0 || first_n < 0 || first_m + 3 >= extents_.m || first_n + 3 >= extents_.n) return false;
    corner_ =
        static_cast<std::size_t>(first_n) * static_cast<std::size_t>(extents_.m) + static_cast<std::size_t>(first_m);
    const auto keep = [](const CubicWeights& from, float(&to)[4]) {
        for (int k = 0; k < 4; ++k) to[k] = static_cast<float>(from.of[k]);
    };
    keep(CubicWeights::at(m - floor_m), wm_), keep(CubicWeights::at(n - floor_n), wn_);
    keep(CubicWeights::slope_at(m - floor_m), dm_), keep(CubicWeights::slope_at(n - floor_n), dn_);
    return true;
}

std::uint8_t CubicReader::mask() const {
    std::uint32_t all = 0;
    for (std::size_t r = 0; r < 4; ++r) {
        std::uint32_t row = 0;
        std::memcpy(&row, mask_.data() + corner_ + r * static_cast<std::size_t>(extents_.m), sizeof row);
        all |= row;
    }
    all |= all >> 16U;
    return static_cast<std::uint8_t>(all | all >> 8U);
}

MapAt CubicReader::read(std::span<const float> map) const {
    const float* row[4];
    for (std::size_t r = 0; r < 4; ++r) row[r] = map.data() + corner_ + r * static_cast<std::size_t>(extents_.m);
    float value[4], slope[4];  // of the columns
    for (int c = 0; c < 4; ++c) {
        value[c] = (wn_[0] * row[0][c] + wn_[1] * row[1][c]) + (wn_[2] * row[2][c] + wn_[3] * row[3][c]);
        slope[c] = (dn_[0] * row[0][c] + dn_[1] * row[1][c]) + (dn_[2] * row[2][c] + dn_[3] * row[3][c]);
    }
    const auto along_row = [](const float(&w)[4], const float(&v)[4]) {
        return static_cast<double>((w[0] * v[0] + w[1] * v[1]) + (w[2] * v[2] + w[3] * v[3]));
    };
    MapAt at;
    at.value = along_row(wm_, value), at.by_m = along_row(dm_, value), at.by_n = along_row(wm_, slope);
    const auto outer = [&](int r) { return (row[r][0] - row[r][1]) - (row[r][2] - row[r][3]); };
    const auto inner = [&](int r) { return row[r][1] + row[r][2]; };
    const float along = outer(1) + outer(2), across = (inner(0) - inner(1)) - (inner(2) - inner(3));
    at.deflection_shift = 0.25 * static_cast<double>(std::max(std::abs(along), std::abs(across)));
    return at;
}

Registrar::Registrar(const Extents& extents) : extents_(extents) {
    const int step = std::max(1, (std::max(extents.m, extents.n) + kSampledSide / 2) / kSampledSide);
    for (const bool coarse : {true, false}) {
        for (int n = step / 2, row = 0; n < extents.n; n += step, ++row) {
            for (int m = step / 2, column = 0; m < extents.m; m += step, ++column) {
                if ((row % 2 == 0 && column % 2 == 0) == coarse)
                    sample_.push_back({static_cast<std::uint32_t>(n * extents.m + m), static_cast<double>(m),
                                       static_cast<double>(n)});
            }
        }
        if (coarse) coarse_ = sample_.size();
    }
    if (coarse_ < kMinCoarse) coarse_ = sample_.size();
    ratios_.resize(sample_.size());
}

Registered Registrar::find(const ReferenceMaps& reference, std::span<const Deflection> deflections,
                           std::span<const std::uint32_t> sums, std::span<const std::uint8_t> mask,
                           double electrons_per_dn, std::uint32_t parts) {
    Registered found;
    CubicReader reader(extents_, reference.mask);
    const double middle_m = 0.5 * (extents_.m - 1), middle_n = 0.5 * (extents_.n - 1),
                 reach = std::max(middle_m, middle_n);
    const auto bins = [](DeflectionQ q) { return q.to_double_rounded(); };
    double turn = 0, typical = 0;
    double shorter = 1;  // of a step, where the ones before went to and fro
    std::array<double, 3> before{};
    bool round = false;     // decided at the first step
    bool settling = false;  // the last steps
    std::size_t used = sample_.size(), count = 0;
    // The light: the parts' typical ones are to be equal. Each step finds it anew for the next.
    const auto weigh_light = [&]() -> bool {
        if (count < 16 || count * 50 < used) return false;
        typical /= static_cast<double>(count);
        found.light = std::max(common::lower_median(std::span(ratios_).first(count)), 1e-6);
        return true;
    };
    for (const Sampled& s : sample_) {
        if ((mask[s.k] & kNoHord) != 0 || (reference.mask[s.k] & (kOutside | kNoHord)) != 0 ||
            !(reference.light[s.k] > 0))
            continue;
        ratios_[count++] = static_cast<double>(sums[s.k]) / static_cast<double>(reference.light[s.k]);
        typical += static_cast<double>(reference.light[s.k]);
    }
    if (!weigh_light()) return found;
    for (int step = 0;; ++step) {
        found.pose.sine = turn;
        const PoseMap map(found.pose, extents_);
        const double electrons = typical * found.light * electrons_per_dn;
        const double light_noise = std::sqrt(1 / electrons + kLightFloor * kLightFloor);
        const double deflection_noise = std::sqrt(0.3 / electrons + kDeflectionFloor * kDeflectionFloor);
        double next_typical = 0;
        count = 0;

        Normal normal;
        double compared = 0, foreign = 0;
        // What the reference's own noise seems to say of shift and turn (its slopes have half of a lenslet's variance),
        // and all that its maps say if every change of theirs were seen in a turn.
        double noise_of_shift = 0, noise_of_turn = 0, all_of_turn = 0;
        const double light_in = 0.5 / (electrons * parts * light_noise * light_noise),
                     deflection_in = 0.15 / (electrons * parts * deflection_noise * deflection_noise);
        const double cosine = std::sqrt(1 - turn * turn);
        const auto add = [&](double part, const MapAt& at, double x, double y, double turned, double plain_noise,
                             double own) {
            const double deflection_shift = kBendNoise * at.deflection_shift,
                         noise = std::sqrt(plain_noise * plain_noise + deflection_shift * deflection_shift);
            // Of the reference at q by the pose: dq/dx = -R(-turn) e_x, dq/dturn = (y', -x') with (x', y') = q.
            const std::array<double, 3> slope{(-at.by_m * cosine + at.by_n * turn) / noise,
                                              (-at.by_m * turn - at.by_n * cosine) / noise,
                                              (at.by_m * y - at.by_n * x + turned) / noise};
            const double r = (part - at.value) / noise, tail = r / kTail;
            const double weight = 1 / (1 + tail * tail);
            normal.add(slope, r, weight);
            const double radius2 = x * x + y * y;
            noise_of_shift += weight * own;
            noise_of_turn += weight * own * radius2;
            all_of_turn +=
                weight * ((at.by_m * at.by_m + at.by_n * at.by_n) * radius2 + turned * turned) / (noise * noise);
        };
        for (std::size_t k = 0; k < used; ++k) {
            const Sampled& s = sample_[k];
            if ((mask[s.k] & kSaturated) != 0) continue;
            const auto q = map.to_reference(s.m, s.n);
            if (!reader.move_to(q.m, q.n)) continue;
            const std::uint8_t around = reader.mask();
            if ((around & (kOutside | kSaturated)) != 0) continue;
            const double x = q.m - middle_m, y = q.n - middle_n;
            MapAt light = reader.read(reference.light);
            if (((mask[s.k] | around) & kDark) == 0 && light.value > 0) {
                ratios_[count++] = static_cast<double>(sums[s.k]) / light.value;
                next_typical += light.value;
            }
            light = {light.value / typical, light.by_m / typical, light.by_n / typical,
                     light.deflection_shift / typical};
            const double seen = static_cast<double>(sums[s.k]) / (found.light * typical);
            add(seen, light, x, y, 0, light_noise, light_in);
            compared += 1;
            bool strange = std::abs(seen - light.value) > kForeignLight;
            if (((mask[s.k] | around) & kDark) == 0) {
                const MapAt dx = reader.read(reference.x), dy = reader.read(reference.y);
                const auto wanted = map.turned(dx.value, dy.value);
                const Deflection& d = deflections[s.k];
                // Turning the part turns its deflections, too.
                const MapAt along_x{wanted.m, dx.by_m * cosine - dy.by_m * turn, dx.by_n * cosine - dy.by_n * turn,
                                    dx.deflection_shift};
                const MapAt along_y{wanted.n, dy.by_m * cosine + dx.by_m * turn, dy.by_n * cosine + dx.by_n * turn,
                                    dy.deflection_shift};
                add(bins(d.x), along_x, x, y, -wanted.n, deflection_noise, deflection_in);
                add(bins(d.y), along_y, x, y, wanted.m, deflection_noise, deflection_in);
                strange =
                    strange || std::max(std::abs(bins(d.x) - wanted.m), std::abs(bins(d.y) - wanted.n)) > kForeignBins;
            }
            foreign += strange ? 1 : 0;
        }
        found.disagreeing = compared > 0 ? foreign / compared : 1;
        const auto give = [&](std::size_t k, double prior, double at) {
            normal.a[k][k] += prior;
            normal.b[k] -= prior * at;
        };
        give(0, 1 / (kShiftPrior * kShiftPrior) + kNoiseRidge * noise_of_shift, found.pose.x);
        give(1, 1 / (kShiftPrior * kShiftPrior) + kNoiseRidge * noise_of_shift, found.pose.y);
        if (step == 0) round = normal.a[2][2] < kTurnShare * all_of_turn;
        give(2, round ? 1e12 : 1 / (kTurnPrior * kTurnPrior) + kNoiseRidge * noise_of_turn, turn);
        const auto by = normal.solved();
        const double moved = std::max(std::abs(by[0]), std::abs(by[1])) + std::abs(by[2]) * reach;
        typical = next_typical;
        if (!weigh_light()) return found;
        // Where the reference's interpolation has a kink, at its own lenslets, each full step leads across it, again
        // and again.
        const double turned_back = by[0] * before[0] + by[1] * before[1] + reach * reach * by[2] * before[2];
        shorter = moved < kNearlySettled && turned_back < 0 ? 0.5 * shorter : std::min(1.0, 2 * shorter);
        before = by;
        if (settling && (moved < kSettled || (shorter <= kSwings && shorter * moved < kSettled))) break;
        if (step == kSteps) {
            if (moved < 0.1) break;  // it swings within a tenth of a lenslet, and the last steps were a quarter of that
            found.outcome =
                found.disagreeing > kForeignShare ? Registered::Outcome::foreign : Registered::Outcome::unsettled;
            return found;
        }
        // At most a lenslet a step; less and less where the weights make it swing.
        const double shortened = shorter *
            std::min(step < 6        ? 1.0
                         : step < 12 ? 0.5
                                     : 0.25,
                     1.0 / std::max(moved, 1e-9));
        found.pose.x += shortened * by[0];
        found.pose.y += shortened * by[1];
        turn += shortened * by[2];
        settling = settling || moved < kNearlySettled || step >= kCoarseSteps;
        used = settling ? sample_.size() : coarse_;
        if (!(std::abs(found.pose.x) < 2 * kFarthestLenslets && std::abs(found.pose.y) < 2 * kFarthestLenslets &&
              std::abs(turn) < 2 * kFarthestSine)) {
            found.outcome =
                found.disagreeing > kForeignShare ? Registered::Outcome::foreign : Registered::Outcome::too_far;
            return found;
        }
    }
    const bool far = std::abs(found.pose.x) > kFarthestLenslets || std::abs(found.pose.y) > kFarthestLenslets ||
        std::abs(turn) > kFarthestSine;
    found.outcome = found.disagreeing > kForeignShare ? Registered::Outcome::foreign
        : far                                         ? Registered::Outcome::too_far
                                                      : Registered::Outcome::found;
    return found;
}

}  // namespace hord::algo
