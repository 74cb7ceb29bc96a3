#include "algo/reference/registration.h"

#include <algorithm>
#include <array>
#include <cmath>

#include "algo/frame/mask.h"
#include "algo/reference/free_light.h"
#include "algo/reference/light_steps.h"
#include "algo/reference/map_reader.h"
#include "common/statistics.h"

namespace hord::algo {
namespace {

constexpr int kSampledSide = 40;
constexpr int kSteps = 30;
constexpr double kSettled = 5e-3;        // lenslets that a step moves the field's rim: the end
constexpr double kSwings = 1.0 / 8;      // factor of a step, after three reversals: then the halved step decides
constexpr double kNearlySettled = 0.03;  // lenslets: from here on with the whole sample
constexpr int kCoarseSteps = 12;
constexpr std::size_t kMinCoarse = 64;
constexpr double kShiftPrior = 1, kTurnPrior = 0.02;  // lenslets, radians
constexpr double kLightFloor = 0.05,
                 kDeflectionFloor = 0.03;  // spread of good parts: of the typical light; bin pitches
constexpr double kCurvatureNoise = 0.3;    // noise, of the slope's change over a lenslet
constexpr double kTail = 3;                // standard deviations from which a residual loses weight
constexpr double kNoiseRidge = 4;          // weight of the prior that the reference's own noise needs
constexpr double kHold = 1e12;             // weight of a prior that fixes an unknown
constexpr double kTurnShare = 0.05;        // of the maps' changes that a turn must show: else the part is round
// A pose is refused if so much of the edges of one axis is missing: one of two opposite sides may be, and a third of
// the other.
constexpr double kLostEdges = 2.0 / 3;
constexpr double kWrong = 0.3;  // lenslets that the edges lie beside the reference's: the steps ended in a wrong place
constexpr double kPhase = 0.5;  // lenslets that the edges of both sides may lie beside those of the reference
// A shift or turn as far as is allowed must change the maps by so many standard deviations, root mean square, beyond a
// change that is the same everywhere: a tilt of the part, or of the light, makes that, too.
constexpr double kDetermined = 0.5;
constexpr std::array<double, 3> kFarthest{kFarthestLenslets, kFarthestLenslets, kFarthestSine};

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
    // By Cholesky decomposition; the priors keep the matrix positive definite.
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

// How the unknowns change a map over the field: sums of (shift x, shift y, turn).
struct Changes {
    double count = 0;
    std::array<double, 3> sum{}, squares{};
    void add(const std::array<double, 3>& slope) {
        count += 1;
        for (std::size_t u = 0; u < 3; ++u) sum[u] += slope[u], squares[u] += slope[u] * slope[u];
    }
    // Sum of squares about the mean.
    [[nodiscard]] double uneven(std::size_t u) const { return count > 0 ? squares[u] - sum[u] * sum[u] / count : 0; }
};

// A place within a step, 0..step - 1, by the golden ratio: successive rows of the sample have every place alike often,
// and so have every second ones.
int staggered(int row, int step) { return row * 1597 % 2584 * step / 2584; }

}  // namespace

// Staggered: the straight edge of a plate that lies along the rows crosses a lattice's rows nowhere, or all along.
Registrar::Registrar(const Extents& extents) : extents_(extents) {
    const int step = std::max(1, (std::max(extents.m, extents.n) + kSampledSide / 2) / kSampledSide);
    for (const bool coarse : {true, false}) {
        for (int row = 0; row * step < extents.n; ++row) {
            for (int column = 0; column * step < extents.m; ++column) {
                const int m = column * step + staggered(row, step), n = row * step + staggered(column, step);
                if (m < extents.m && n < extents.n && (row % 2 == 0 && column % 2 == 0) == coarse)
                    sample_.push_back({static_cast<std::uint32_t>(extents.index(m, n)), static_cast<double>(m),
                                       static_cast<double>(n)});
            }
        }
        if (coarse) coarse_ = sample_.size();
    }
    if (coarse_ < kMinCoarse) coarse_ = sample_.size();
    if (std::min(extents.m, extents.n) >= kMinFieldByEdges) {
        blocks_ = std::make_unique<CoarseMaps>(extents);
        on_blocks_ = std::make_unique<Registrar>(blocks_->extents());
    }
    ratios_.resize(sample_.size());
}

// What is compared.
struct Registrar::Problem {
    const ReferenceMaps& reference;
    const PartMaps part;
    double electrons_per_dn;
    std::uint32_t parts;
    double typical = 0;  // the reference's light, mean over the sample, DN
    double light = 1;    // the part's over it
};

// The sums of one Gauss-Newton step over the sample.
struct Registrar::Step {
    double turn, cosine;  // sine and cosine of the turn
    double light_noise, deflection_noise;
    double light_own, deflection_own;  // a sample's share in noise_of_shift
    Normal normal{};
    std::array<Changes, 3> changes{};  // of light and both deflections
    double compared = 0, foreign = 0;  // samples
    // Normal-matrix entries of shift and turn that the reference's own noise makes (its slopes have half of a lenslet's
    // variance), and that of the turn if every change of the maps showed in it.
    double noise_of_shift = 0, noise_of_turn = 0, all_of_turn = 0;

    Step(double sine, double electrons, std::uint32_t parts)
        : turn(sine), cosine(std::sqrt(1 - sine * sine)),
          light_noise(std::sqrt(1 / electrons + kLightFloor * kLightFloor)),
          deflection_noise(std::sqrt(0.3 / electrons + kDeflectionFloor * kDeflectionFloor)),
          light_own(0.5 / (electrons * parts * light_noise * light_noise)),
          deflection_own(0.15 / (electrons * parts * deflection_noise * deflection_noise)) {}

    // Whether the maps say where the part lies: not if they change by the same everywhere.
    [[nodiscard]] bool determines(std::size_t unknown) const {
        double uneven = 0;
        for (const Changes& change : changes) uneven += change.uneven(unknown);
        return kFarthest[unknown] * kFarthest[unknown] * uneven > kDetermined * kDetermined * compared;
    }

    // One value of the part against the reference's map at (x, y) from the middle. `turned`: its change by the turn of
    // the deflection itself.
    void add(double part, const MapAt& at, double x, double y, double turned, double plain_noise, double own,
             Changes& change) {
        const double curvature = kCurvatureNoise * at.curvature,
                     noise = std::sqrt(plain_noise * plain_noise + curvature * curvature);
        // Of the reference at q by the pose: dq/dx = -R(-turn) e_x, dq/dturn = (y', -x') with (x', y') = q.
        const std::array<double, 3> slope{(-at.by_m * cosine + at.by_n * turn) / noise,
                                          (-at.by_m * turn - at.by_n * cosine) / noise,
                                          (at.by_m * y - at.by_n * x + turned) / noise};
        const double r = (part - at.value) / noise, tail = r / kTail;
        const double weight = 1 / (1 + tail * tail);
        normal.add(slope, r, weight);
        change.add(slope);
        const double radius2 = x * x + y * y;
        noise_of_shift += weight * own;
        noise_of_turn += weight * own * radius2;
        all_of_turn += weight * ((at.by_m * at.by_m + at.by_n * at.by_n) * radius2 + turned * turned) / (noise * noise);
    }
};

// The ratio of both typical lights, from the `count` ratios that the last step left; false if they are too few.
bool Registrar::update_light(std::size_t count, std::size_t used, double& typical, double& light) {
    if (count < 16 || count * 50 < used) return false;
    typical /= static_cast<double>(count);
    light = std::max(common::lower_median(std::span(ratios_).first(count)), 1e-6);
    return true;
}

// Compares the first `used` samples with the reference. Returns how many ratios of light it has left in ratios_, and in
// `next_typical` the sum of the reference's light there.
std::size_t Registrar::compare(const Problem& of, const PoseMap& map, std::size_t used, double typical,
                               double light_ratio, Step& step, double& next_typical) {
    const ReferenceMaps& reference = of.reference;
    const PartMaps& part = of.part;
    CubicReader reader(extents_, reference.mask);
    const double middle_m = 0.5 * (extents_.m - 1), middle_n = 0.5 * (extents_.n - 1);
    const auto bins = [](DeflectionQ q) { return q.to_double_rounded(); };
    const double cosine = step.cosine, turn = step.turn;
    std::size_t count = 0;
    for (std::size_t k = 0; k < used; ++k) {
        const SamplePoint& s = sample_[k];
        if ((part.mask[s.k] & kSaturated) != 0) continue;
        const auto q = map.to_reference(s.m, s.n);
        if (!reader.move_to(q.m, q.n)) continue;
        const std::uint8_t around = reader.mask();
        if ((around & (kOutside | kSaturated)) != 0) continue;
        const bool has_hord = ((part.mask[s.k] | around) & kDark) == 0;
        const double x = q.m - middle_m, y = q.n - middle_n;
        MapAt light = reader.read(reference.light);
        if (has_hord && light.value > 0) {
            ratios_[count++] = static_cast<double>(part.sums[s.k]) / light.value;
            next_typical += light.value;
        }
        light = {light.value / typical, light.by_m / typical, light.by_n / typical, light.curvature / typical};
        const double measured = static_cast<double>(part.sums[s.k]) / (light_ratio * typical);
        step.add(measured, light, x, y, 0, step.light_noise, step.light_own, step.changes[0]);
        step.compared += 1;
        bool foreign = std::abs(measured - light.value) > kForeignLight;
        if (has_hord) {
            const MapAt dx = reader.read(reference.x), dy = reader.read(reference.y);
            const auto expected = map.turned(dx.value, dy.value);
            const Deflection& d = part.deflections[s.k];
            // Turning the part turns its deflections, too.
            const MapAt along_x{expected.m, dx.by_m * cosine - dy.by_m * turn, dx.by_n * cosine - dy.by_n * turn,
                                dx.curvature};
            const MapAt along_y{expected.n, dy.by_m * cosine + dx.by_m * turn, dy.by_n * cosine + dx.by_n * turn,
                                dy.curvature};
            step.add(bins(d.x), along_x, x, y, -expected.n, step.deflection_noise, step.deflection_own,
                     step.changes[1]);
            step.add(bins(d.y), along_y, x, y, expected.m, step.deflection_noise, step.deflection_own, step.changes[2]);
            foreign =
                foreign || std::max(std::abs(bins(d.x) - expected.m), std::abs(bins(d.y) - expected.n)) > kForeignBins;
        }
        step.foreign += foreign ? 1 : 0;
    }
    return count;
}

// Gauss-Newton from `start`, near which the pose stays in what the maps do not determine.
Registered Registrar::settle(const Problem& of, const Pose& start) {
    Registered result;
    Pose& pose = result.pose;
    pose = start;
    result.light = of.light;
    const double reach = std::max(0.5 * (extents_.m - 1), 0.5 * (extents_.n - 1));
    double turn = start.sine;
    double typical = of.typical;
    double shorter = 1;  // factor of a step: reduced while the steps oscillate
    std::array<double, 3> before{};
    bool round = false;  // a turn of the part does not show in the maps; decided at the first step
    std::array<bool, 3> determined{}, held{};  // by the maps, decided at the first step; at the farthest allowed
    bool settling = false;                     // the last steps, with the whole sample
    int began = 0;                             // the first of them; 0 before: the quarter may have led far away
    std::size_t used = sample_.size(), count = 0;
    const auto outcome = [&](Registered::Outcome unless_foreign) {
        result.outcome = result.disagreeing > kForeignShare ? Registered::Outcome::foreign : unless_foreign;
        return result;
    };
    for (int k = 0;; ++k) {
        pose.sine = turn;
        Step step(turn, typical * result.light * of.electrons_per_dn, of.parts);
        double next_typical = 0;
        count = compare(of, PoseMap(pose, extents_), used, typical, result.light, step, next_typical);
        result.disagreeing = step.compared > 0 ? step.foreign / step.compared : 1;
        const auto add_prior = [&](std::size_t unknown, double weight, double at) {
            step.normal.a[unknown][unknown] += weight;
            step.normal.b[unknown] -= weight * at;
        };
        add_prior(0, 1 / (kShiftPrior * kShiftPrior) + kNoiseRidge * step.noise_of_shift, pose.x - start.x);
        add_prior(1, 1 / (kShiftPrior * kShiftPrior) + kNoiseRidge * step.noise_of_shift, pose.y - start.y);
        if (k == 0) {
            round = step.normal.a[2][2] < kTurnShare * step.all_of_turn;
            for (std::size_t u = 0; u < 3; ++u) determined[u] = step.determines(u);
            result.determined = {determined[0], determined[1], determined[2] || round};
        }
        for (std::size_t u = 0; u < 3; ++u) {
            if (held[u]) step.normal.a[u][u] += kHold;
        }
        add_prior(2, round ? kHold : 1 / (kTurnPrior * kTurnPrior) + kNoiseRidge * step.noise_of_turn,
                  turn - start.sine);
        const auto by = step.normal.solved();
        const double moved = std::max(std::abs(by[0]), std::abs(by[1])) + std::abs(by[2]) * reach;
        typical = next_typical;
        if (!update_light(count, used, typical, result.light)) return result;
        // The reference's interpolation has kinks at its own lenslets: full steps could oscillate across one.
        const double turned_back = by[0] * before[0] + by[1] * before[1] + reach * reach * by[2] * before[2];
        shorter = (settling || moved < kNearlySettled) && turned_back < 0 ? 0.5 * shorter : std::min(1.0, 2 * shorter);
        before = by;
        if (settling && (moved < kSettled || (shorter <= kSwings && shorter * moved < kSettled))) break;
        if (k == kSteps) {
            // Oscillates within a tenth of a lenslet (the last steps were at most a quarter of that), or the maps do
            // not determine the pose any better: another step would lower the sum of squares by less than one.
            double gain = 0;
            for (std::size_t u = 0; u < 3; ++u) gain += by[u] * step.normal.b[u];
            if (shorter * moved < 0.1 || gain < 1) break;
            return outcome(Registered::Outcome::unsettled);
        }
        // At most a lenslet a step; later steps are shorter, because the weights may make the pose oscillate.
        const int since = k - began;
        const double damping = since < 6 ? 1.0 : since < 12 ? 0.5 : 0.25;
        const double shortened = shorter * std::min(damping, 1.0 / std::max(moved, 1e-9));
        pose.x += shortened * by[0];
        pose.y += shortened * by[1];
        turn += shortened * by[2];
        const std::array<double*, 3> unknowns{&pose.x, &pose.y, &turn};
        const std::array<double, 3> from{start.x, start.y, start.sine};
        for (std::size_t u = 0; u < 3; ++u) {
            const double moved_by = *unknowns[u] - from[u];
            if (determined[u] || std::abs(moved_by) < kFarthest[u]) continue;
            *unknowns[u] = from[u] + std::copysign(kFarthest[u], moved_by);
            held[u] = true;
        }
        if (!settling && (moved < kNearlySettled || k >= kCoarseSteps)) settling = true, began = k + 1;
        used = settling ? sample_.size() : coarse_;
        if (!(std::abs(pose.x - start.x) < 2 * kFarthestLenslets &&
              std::abs(pose.y - start.y) < 2 * kFarthestLenslets && std::abs(turn) < 2 * kFarthestSine))
            return outcome(Registered::Outcome::too_far);
    }
    return outcome(Registered::Outcome::found);
}

// Compares the edges at a pose that the steps have found, and refuses one that is too far.
void Registrar::check(const Problem& of, bool afar, Registered& result) const {
    if (!result.found()) return;
    const EdgeAgreement edges =
        compare_edges(extents_, of.reference, of.part, PoseMap(result.pose, extents_), of.typical, result.light);
    result.missing_edges = edges.missing_share();
    result.has_edges = edges.tells(0) || edges.tells(1);
    result.size =
        compare_sizes(extents_, of.reference, of.part, PoseMap(result.pose, extents_), of.typical, result.light);
    for (std::size_t axis : {0U, 1U}) {
        if (blocks_ && edges.tells_by_light(axis)) result.farthest[axis] = kFarthestByEdges;
    }
    const auto far = [&](double shift, std::size_t axis) {
        const bool known = blocks_ && afar && edges.tells_by_light(axis) && result.missing_edges <= kForeignShare &&
            result.size.known[axis] && result.size.apart[axis] <= kPhase;
        return std::abs(shift) > (known ? kFarthestByEdges : kFarthestLenslets);
    };
    if (far(result.pose.x, 0) || far(result.pose.y, 1) || std::abs(result.pose.sine) > kFarthestSine)
        result.outcome =
            result.disagreeing > kForeignShare ? Registered::Outcome::foreign : Registered::Outcome::too_far;
}

bool Registrar::begin(Problem& of) {
    std::size_t count = 0;
    for (const SamplePoint& s : sample_) {
        if ((of.part.mask[s.k] & kNoHord) != 0 || (of.reference.mask[s.k] & (kOutside | kNoHord)) != 0 ||
            !(of.reference.light[s.k] > 0))
            continue;
        ratios_[count++] = static_cast<double>(of.part.sums[s.k]) / static_cast<double>(of.reference.light[s.k]);
        of.typical += static_cast<double>(of.reference.light[s.k]);
    }
    return update_light(count, sample_.size(), of.typical, of.light);
}

// From where the coarse maps say that the part lies.
Registered Registrar::settle_from_afar(const Problem& of) {
    blocks_->fill(of.reference, of.part);
    const ReferenceMaps reference = blocks_->reference();
    Problem coarse{reference, blocks_->part(), of.electrons_per_dn, of.parts};
    if (!on_blocks_->begin(coarse)) return {};
    const Registered from = on_blocks_->settle(coarse, {});
    const auto known = [&](std::size_t unknown, double value) { return from.determined[unknown] ? value : 0; };
    return settle(of,
                  {known(0, CoarseMaps::kBlock * from.pose.x), known(1, CoarseMaps::kBlock * from.pose.y),
                   known(2, from.pose.sine)});
}

Registered Registrar::find(const ReferenceMaps& reference, std::span<const Deflection> deflections,
                           std::span<const std::uint32_t> sums, std::span<const std::uint8_t> mask,
                           double electrons_per_dn, std::uint32_t parts) {
    Problem of{reference, {deflections, sums, mask}, electrons_per_dn, parts};
    if (!begin(of)) return {};
    Registered result = find_pose(of);
    if (!result.found()) {
        if (is_empty(of)) result.outcome = Registered::Outcome::no_part;
    } else if (!result.has_edges &&
               is_rather_empty(extents_, of.reference, of.part, PoseMap(result.pose, extents_), of.electrons_per_dn,
                               of.parts)) {
        result.outcome = Registered::Outcome::free_light;  // any field fits a reference without edges
    } else {
        check_steps(of, result);
    }
    return result;
}

// Where the light has no edges, it may have steps.
void Registrar::check_steps(const Problem& of, Registered& result) const {
    const auto all_known = [](const std::array<bool, 2>& known) { return known[0] && known[1]; };
    if (!result.found() || (all_known(result.size.known) && all_known(result.blur.known))) return;
    const LightSteps steps =
        compare_light_steps(extents_, of.reference, of.part, PoseMap(result.pose, extents_), of.typical, result.light);
    for (const std::size_t axis : {0U, 1U}) {
        if (!result.size.known[axis]) result.size.take(axis, steps.size);
        if (!result.blur.known[axis]) result.blur.take(axis, steps.blur);
    }
    if (result.blur.exceeds()) result.outcome = Registered::Outcome::blurred;
    else if (result.size.exceeds()) result.outcome = Registered::Outcome::other_size;
}

// The reference has edges, and the part's maps show none.
bool Registrar::is_empty(const Problem& of) const {
    const EdgeAgreement edges =
        compare_edges(extents_, of.reference, of.part, PoseMap({}, extents_), of.typical, of.light);
    return (edges.tells(0) || edges.tells(1)) && !shows_edges(extents_, of.part, of.typical * of.light);
}

Registered Registrar::find_pose(const Problem& of) {
    Registered result = settle(of, {});
    check(of, false, result);
    if (blocks_ && !(result.found() && result.missing_edges <= kForeignShare)) {
        Registered other = settle_from_afar(of);
        check(of, true, other);
        const bool better = other.missing_edges < result.missing_edges || (other.found() && !result.found());
        if (better && other.missing_edges <= kForeignShare) result = other;
    }
    if (result.found() && result.size.shifted() > kWrong) {
        const Pose& at = result.pose;
        const std::array<double, 2>& by = result.size.shift;
        Registered other = settle(of, {at.x + by[0], at.y + by[1], at.sine});
        check(of, true, other);
        if (other.found() && other.missing_edges <= kForeignShare && other.size.shifted() < result.size.shifted())
            result = other;
    }
    if (result.found() && result.missing_edges > kLostEdges) result.outcome = Registered::Outcome::other_edges;
    if (!result.found()) return result;
    result.size =
        compare_sizes(extents_, of.reference, of.part, PoseMap(result.pose, extents_), of.typical, result.light);
    result.blur = compare_blur(extents_, of.reference, of.part, PoseMap(result.pose, extents_), result.size, of.typical,
                               result.light);
    if (result.blur.exceeds()) result.outcome = Registered::Outcome::blurred;
    else if (result.size.exceeds()) result.outcome = Registered::Outcome::other_size;
    return result;
}

}  // namespace hord::algo
