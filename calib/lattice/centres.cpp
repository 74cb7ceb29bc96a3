#include "calib/lattice/centres.h"

#include <algorithm>
#include <cmath>

#include <fmt/format.h>

#include "algo/simd/multiversion.h"
#include "calib/lattice/centre_kernels.h"
#include "common/statistics.h"

namespace hord::calib {
namespace {

constexpr std::size_t kMaxSeeds = 400;
// A profile learned about centres that are off is blurred by the square of that, and so is the weight made of it. Light
// that is brighter on one side takes more rounds until all centres together no longer move.
constexpr int kMinRounds = 3, kMaxRounds = 8;
constexpr double kSettled = 0.001;  // px

// Always sixteen lanes, in registers of any width: every machine sums in the same order.
constexpr int kLanes = 16;
using Floats = algo::Vector<float, kLanes * sizeof(float)>;

template <int>
HORD_ALWAYS_INLINE Responses responses(const float* kernels, const float* light, std::ptrdiff_t size) {
    const float* of_window = kernels + 3 * size;
    Floats sum{};
    for (std::ptrdiff_t k = 0; k < size; k += kLanes)
        sum += algo::load<Floats>(of_window + k) * algo::load<Floats>(light + k);
    float mean = 0;
    for (int lane = 0; lane < kLanes; ++lane) mean += sum[lane];
    // Sums of differences from the mean, for which single precision suffices.
    Floats x{}, y{}, amplitude{}, power{};
    for (std::ptrdiff_t k = 0; k < size; k += kLanes) {
        const Floats off = algo::load<Floats>(light + k) - mean;
        x += algo::load<Floats>(kernels + k) * off;
        y += algo::load<Floats>(kernels + size + k) * off;
        amplitude += algo::load<Floats>(kernels + 2 * size + k) * off;
        power += algo::load<Floats>(of_window + k) * off * off;
    }
    Responses out;
    for (int lane = 0; lane < kLanes; ++lane) {
        out.x += x[lane];
        out.y += y[lane];
        out.amplitude += amplitude[lane];
        out.power += power[lane];
    }
    return out;
}
HORD_FOR_EACH_ISA(responses_for, responses)

}  // namespace

CentreFinder::Kernels::Kernels(const WhiteImage& of) : image(&of), respond(responses_for(algo::widest_isa())) {}

void CentreFinder::Kernels::sample(const Weights& from) {
    weights = from;
    half = static_cast<int>(std::ceil(weights.radius + 0.5));
    side = 2 * half + 1;
    phases = side > 40 ? 8 : 16;
    size = static_cast<Eigen::Index>((side * side + kLanes - 1) / kLanes * kLanes);
    light = Eigen::VectorXf::Zero(size);
    bank = Eigen::MatrixXf::Zero(size, static_cast<Eigen::Index>(4) * phases * phases);
    Eigen::VectorXf shape = Eigen::VectorXf::Zero(size);
    for (int phase = 0; phase < phases * phases; ++phase) {
        const double fx = (phase % phases + 0.5) / phases - 0.5;
        const double fy =
            (phase / phases + 0.5) / phases - 0.5;  // NOLINT(bugprone-integer-division): the row of phases
        const auto first = static_cast<Eigen::Index>(4) * phase;
        double share = 0;
        double mean = 0;
        for (int y = -half; y <= half; ++y) {
            for (int x = -half; x <= half; ++x) {
                const double dx = x - fx;
                const double dy = y - fy;
                const double r = std::sqrt(dx * dx + dy * dy);
                const auto at = static_cast<Eigen::Index>((y + half) * side + x + half);
                const double w = lookup(weights.shift, r);
                const double window = lookup(weights.window, r);
                bank(at, first) = static_cast<float>(w * dx);
                bank(at, first + 1) = static_cast<float>(w * dy);
                bank(at, first + 3) = static_cast<float>(window);
                bank(at, first + 2) = static_cast<float>(lookup(weights.profile, r) * window);
                shape(at) = static_cast<float>(lookup(weights.profile, r));
                share += window;
                mean += lookup(weights.profile, r) * window;
            }
        }
        // The amplitude kernel responds with 1 to the profile and 0 to a constant; the window kernel averages.
        double own = 0;
        const double level = mean / share;
        for (Eigen::Index at = 0; at < side * side; ++at) {
            const double window = bank(at, first + 3);
            const double profile = window > 0 ? bank(at, first + 2) / window : 0;
            own += window * (profile - level) * (profile - level);
            bank(at, first + 2) = static_cast<float>(window * (profile - level));
            bank(at, first + 3) = static_cast<float>(window / share);
        }
        bank.col(first + 2) /= static_cast<float>(own);
        own_match = std::sqrt(own / share);
        // On the pixel grid of this phase, too, the moments of a constant and of the profile are 0.
        for (int axis = 0; axis < 2; ++axis) {
            auto moment = bank.col(first + axis);
            moment -= moment.sum() * (bank.col(first + 3) - static_cast<float>(level) * bank.col(first + 2));
            moment -= moment.dot(shape) * bank.col(first + 2);
        }
    }
}

CentreFinder::Kernels::Moments CentreFinder::Kernels::moments(algo::PixelPoint at) const {
    const double fx = std::floor(at.x_px + 0.5);
    const double fy = std::floor(at.y_px + 0.5);
    const int phase_x = std::min(phases - 1, static_cast<int>((at.x_px + 0.5 - fx) * phases));
    const int phase_y = std::min(phases - 1, static_cast<int>((at.y_px + 0.5 - fy) * phases));
    image->window(static_cast<int>(fx) - half, static_cast<int>(fy) - half, side, side, light.data(), side);
    const auto first = static_cast<Eigen::Index>(4) * (phase_y * phases + phase_x);
    const Responses response = respond(bank.col(first).data(), light.data(), size);
    Moments out;
    out.x = response.x;
    out.y = response.y;
    out.amplitude = response.amplitude;
    out.match = response.power > 0 ? out.amplitude * own_match / std::sqrt(response.power) : 0;
    out.about = {fx + (phase_x + 0.5) / phases - 0.5, fy + (phase_y + 0.5) / phases - 0.5};
    return out;
}

bool CentreFinder::Kernels::complete(algo::PixelPoint at) const {
    const double reach = weights.radius - 0.5 + image->margin_px();
    return at.x_px >= reach && at.y_px >= reach && at.x_px <= image->width_px() - 1 - reach &&
        at.y_px <= image->height_px() - 1 - reach;
}

std::optional<Spot> CentreFinder::Kernels::measure(algo::PixelPoint at, double most_px) const {
    constexpr int kMaxSteps = 12;
    const double longest = std::min(1.0, 0.5 * weights.radius);
    algo::PixelPoint here = at;
    for (int k = 0; k < kMaxSteps; ++k) {
        if (!complete(here)) return std::nullopt;
        const Moments m = moments(here);
        if (!(m.amplitude > 0)) return std::nullopt;
        double dx = m.x / (m.amplitude * gain);
        double dy = m.y / (m.amplitude * gain);
        const double length = std::hypot(dx, dy);
        if (length > longest) {
            dx *= longest / length;
            dy *= longest / length;
        }
        const algo::PixelPoint next{m.about.x_px + dx, m.about.y_px + dy};
        // Done if the centre lies in the cell of its phase: the error of the gain is then negligible.
        const bool settled = std::max(std::abs(dx), std::abs(dy)) < 0.6 / phases;
        // If the steps from two cells lead into each other, the centre is half way.
        const bool swings =
            k + 1 == kMaxSteps && std::hypot(next.x_px - here.x_px, next.y_px - here.y_px) < 2.0 / phases;
        here = swings ? algo::PixelPoint{0.5 * (here.x_px + next.x_px), 0.5 * (here.y_px + next.y_px)} : next;
        const double away = std::hypot(here.x_px - at.x_px, here.y_px - at.y_px);
        if (away > most_px) return std::nullopt;
        if (settled || swings) return Spot{here, m.amplitude, m.match, away};
    }
    return std::nullopt;
}

// Sets `gain`, from the moments one phase to either side of known centres.
void CentreFinder::Kernels::calibrate_gain(std::span<const algo::PixelPoint> centres) {
    const double step = 1.0 / phases;
    double answered = 0;
    double shift = 0;
    for (const algo::PixelPoint& c : centres) {
        if (!complete({c.x_px - 0.5, c.y_px - 0.5}) || !complete({c.x_px + 0.5, c.y_px + 0.5})) continue;
        const double amplitude = moments(c).amplitude;
        if (!(amplitude > 0)) continue;
        const Moments left = moments({c.x_px - step, c.y_px});
        const Moments right = moments({c.x_px + step, c.y_px});
        const Moments above = moments({c.x_px, c.y_px - step});
        const Moments below = moments({c.x_px, c.y_px + step});
        // A quotient of sums: the light of a dead lenslet is rounding, and its own quotient may have any size.
        answered += left.x - right.x + above.y - below.y;
        shift += amplitude * (right.about.x_px - left.about.x_px + below.about.y_px - above.about.y_px);
    }
    gain = shift > 0 ? answered / shift : 0;
}

Result<CentreFinder> CentreFinder::learn(const WhiteImage& image, std::span<const algo::PixelPoint> seeds,
                                         double pitch_px, AgainstGradients against) {
    auto kernels = common::make_opaque<Kernels>(image);
    kernels->against = against;
    std::vector<algo::PixelPoint> starts(seeds.begin(), seeds.end());
    if (starts.size() > kMaxSeeds) starts.resize(kMaxSeeds);

    const double widest = 0.5 * pitch_px;
    Profile profile = raised_cosine(widest);
    double radius = widest;
    std::vector<Spot> spots;
    for (int round = 0; round < kMaxRounds; ++round) {
        kernels->sample(design_weights(profile, radius, round > 0 ? std::optional(against) : std::nullopt));
        kernels->calibrate_gain(starts);
        if (!(kernels->gain > 0)) break;
        spots.clear();
        double moved_x = 0, moved_y = 0;  // all lenslets together
        for (const algo::PixelPoint& start : starts) {
            const auto spot = kernels->measure(start, 0.3 * pitch_px);
            if (!spot) continue;
            spots.push_back(*spot);
            moved_x += spot->centre_px.x_px - start.x_px;
            moved_y += spot->centre_px.y_px - start.y_px;
        }
        if (spots.size() < 4) break;
        const double moved = std::hypot(moved_x, moved_y) / static_cast<double>(spots.size());
        std::vector<double> amplitudes(spots.size());
        std::transform(spots.begin(), spots.end(), amplitudes.begin(), [](const Spot& s) { return s.amplitude_dn; });
        const double median = common::upper_median(std::span(amplitudes));
        kernels->typical_amplitude = median;
        std::erase_if(spots,
                      [&](const Spot& s) { return s.amplitude_dn < 0.3 * median || s.amplitude_dn > 3 * median; });
        if (spots.size() < 4) break;
        starts.clear();
        for (const Spot& spot : spots) starts.push_back(spot.centre_px);
        kernels->calibrate_gain(starts);
        if (round + 1 == kMaxRounds || (round + 1 >= kMinRounds && moved < kSettled)) {
            kernels->learn_noise_of_halves();
            return CentreFinder(std::move(kernels));
        }
        profile = measure_profile(image, spots, widest);
        // The window of a small spot ends shortly after the profile.
        std::size_t last = profile.value.size() - 1;
        while (last > 0 && profile.value[last] < 0.02) --last;
        radius = std::min(widest, static_cast<double>(last) * kTableStep + 1.5 + kTaper);
    }
    return fail(ErrorCode::refused,
                fmt::format("only {} of {} lenslets near the middle look like one another", spots.size(), seeds.size()),
                "light the lenslets evenly, below saturation, focus the sensor on them, and record one exposure while "
                "array and light are still");
}

std::optional<Spot> CentreFinder::measure(algo::PixelPoint at, double most_px) const {
    return kernels_->measure(at, most_px);
}
bool CentreFinder::complete(algo::PixelPoint at) const { return kernels_->complete(at); }
double CentreFinder::amplitude_dn(algo::PixelPoint at) const { return kernels_->moments(at).amplitude; }
const Weights& CentreFinder::weights() const { return kernels_->weights; }
double CentreFinder::window_radius_px() const { return kernels_->weights.radius; }
double CentreFinder::half_height_radius_px() const {
    return static_cast<double>(half_height(kernels_->weights.profile)) * kTableStep;
}
double CentreFinder::stretch_shown() const {
    return calib::stretch_shown(kernels_->weights, kernels_->image->smoothed_px());
}
double CentreFinder::edge_variance_px2() const { return edge_variance(kernels_->weights); }
Immunity CentreFinder::immunity() const { return kernels_->weights.immunity; }
AgainstGradients CentreFinder::against() const { return kernels_->against; }
double CentreFinder::shift_by_gradient_px2() const { return shift_by_gradient(kernels_->weights); }
double CentreFinder::unlike_by_shift_px2() const { return unlike_by_shift(kernels_->weights); }
double CentreFinder::typical_amplitude_dn() const { return kernels_->typical_amplitude; }

}  // namespace hord::calib
