#include "calib/lattice/centres.h"

#include <algorithm>
#include <cmath>

#include <Eigen/Dense>
#include <fmt/format.h>

#include "algo/simd/multiversion.h"
#include "calib/lattice/centre_weights.h"
#include "common/statistics.h"

namespace hord::calib {
namespace {

constexpr std::size_t kMaxSeeds = 400;
// A profile learned about centres that are off is blurred by the square of that, and so is the weight made of it. Light
// that is brighter on one side takes more rounds until all centres together no longer move.
constexpr int kMinRounds = 3, kMaxRounds = 8;
constexpr double kSettled = 0.001;                    // px
constexpr double kInside = 0.7, kSmallestInside = 2;  // of the half height, and px: the inside of a lenslet

constexpr double kSlopeStep = 2 * kTableStep;
// How different two changes of shape are: 0 if they are alike, 1 if they have nothing in common. Of spots it is 0.06 at
// most, of lenslets with an edge up to 0.8.
constexpr double kMinApart = 0.15;

// Response of one window to the kernels of one phase (see CentreFinder::Kernels::bank).
struct Responses {
    float x = 0, y = 0, amplitude = 0, power = 0;
};

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

// The pixels of the window about a centre, with the radial tables at their places.
struct WindowPixels {
    struct Pixel {
        double dx, dy, shape, window, light, weight, steepness;
    };
    std::vector<Pixel> pixels;
    double background = 0, amplitude = 0;  // of the profile, by least squares
};

}  // namespace

// The weights, sampled for every sub-pixel phase; each a window of `side` x `side` floats.
struct CentreFinder::Kernels {
    explicit Kernels(const WhiteImage& of) : image(&of) {}

    const WhiteImage* image;
    Weights weights;
    AgainstGradients against = AgainstGradients::where_cheap;
    int half = 0, side = 0, phases = 16;
    Eigen::Index size = 0;
    Responses (*respond)(const float*, const float*, std::ptrdiff_t) = responses_for(algo::widest_isa());
    double gain = 0;       // first moment a pixel of shift and DN of amplitude
    double own_match = 1;  // keeps `match` in -1..1
    double typical_amplitude = 0;
    // Four kernels a phase: moment x, moment y, amplitude, window share.
    Eigen::Matrix<float, Eigen::Dynamic, Eigen::Dynamic> bank;
    mutable Eigen::VectorXf light;  // of the window that is measured, side x side and room for whole vectors

    void sample(const Weights& from);
    struct Moments {
        double x = 0, y = 0, amplitude = 0, match = 0;
        algo::PixelPoint about;
    };
    [[nodiscard]] Moments moments(algo::PixelPoint at) const;
    [[nodiscard]] bool complete(algo::PixelPoint at) const;
    [[nodiscard]] std::optional<Spot> measure(algo::PixelPoint at, double most_px) const;
    [[nodiscard]] std::optional<WindowPixels> pixels_about(algo::PixelPoint centre) const;
    [[nodiscard]] std::optional<algo::PixelPoint> split(algo::PixelPoint centre) const;
    [[nodiscard]] std::optional<Elongation> elongation(algo::PixelPoint centre) const;
    [[nodiscard]] double turned(algo::PixelPoint centre) const;
    void calibrate_gain(std::span<const algo::PixelPoint> centres);
};

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

std::optional<WindowPixels> CentreFinder::Kernels::pixels_about(algo::PixelPoint centre) const {
    if (!complete(centre)) return std::nullopt;
    WindowPixels out;
    out.pixels.reserve(static_cast<std::size_t>(side * side));
    const auto cx = static_cast<int>(std::lround(centre.x_px)), cy = static_cast<int>(std::lround(centre.y_px));
    double sum = 0, sum_t = 0, sum_tt = 0, sum_l = 0, sum_lt = 0;
    for (int y = std::max(0, cy - half); y <= std::min(image->height_px() - 1, cy + half); ++y) {
        for (int x = std::max(0, cx - half); x <= std::min(image->width_px() - 1, cx + half); ++x) {
            WindowPixels::Pixel p{};
            p.dx = x - centre.x_px;
            p.dy = y - centre.y_px;
            const double at = std::sqrt(p.dx * p.dx + p.dy * p.dy) / kTableStep;
            const auto k = static_cast<std::size_t>(at);
            if (k + 1 >= weights.window.size()) continue;
            const double part = at - static_cast<double>(k);
            const auto here = [&](const Table& table) { return table[k] + part * (table[k + 1] - table[k]); };
            p.window = here(weights.window);
            if (p.window == 0) continue;
            p.shape = here(weights.profile);
            p.weight = here(weights.shift);
            p.steepness = here(weights.steepness);
            p.light = image->at(x, y);
            sum += p.window;
            sum_t += p.window * p.shape;
            sum_tt += p.window * p.shape * p.shape;
            sum_l += p.window * p.light;
            sum_lt += p.window * p.light * p.shape;
            out.pixels.push_back(p);
        }
    }
    const double spread = sum * sum_tt - sum_t * sum_t;
    if (!(spread > 0)) return std::nullopt;
    out.amplitude = (sum * sum_lt - sum_t * sum_l) / spread;
    out.background = (sum_l - out.amplitude * sum_t) / sum;
    if (!(out.amplitude > 0)) return std::nullopt;
    return out;
}

// With the weight itself instead of sampled kernels. The light of a half is a + b T + s . dT; the moment of the
// remainder after a and b depends on the shift s only.
std::optional<algo::PixelPoint> CentreFinder::Kernels::split(algo::PixelPoint centre) const {
    constexpr double kTurnX = 0.98006657784124163,
                     kTurnY = 0.19866933079506122;  // sectors are rotated by 0.2 rad: no pixel on their edges
    const auto of = pixels_about(centre);
    if (!of) return std::nullopt;
    const double a = of->background, b = of->amplitude;
    algo::PixelPoint place[2];
    for (const bool second : {false, true}) {
        double mx = 0, my = 0, xx = 0, xy = 0, yy = 0;
        for (const WindowPixels::Pixel& p : of->pixels) {
            const double u = kTurnX * p.dx + kTurnY * p.dy, v = kTurnX * p.dy - kTurnY * p.dx;
            if ((((u > 0) != (v > 0)) != (std::abs(u) > std::abs(v))) != second) continue;
            const double left = p.weight * (p.light - a - b * p.shape), steep = p.weight * p.steepness * b;
            mx += left * p.dx;
            my += left * p.dy;
            xx += steep * p.dx * p.dx;
            xy += steep * p.dx * p.dy;
            yy += steep * p.dy * p.dy;
        }
        const double determinant = xx * yy - xy * xy;
        if (!(std::abs(determinant) > 1e-12 * xx * yy) || !(xx > 0)) return std::nullopt;
        place[second ? 1 : 0] = {(yy * mx - xy * my) / determinant, (xx * my - xy * mx) / determinant};
    }
    return algo::PixelPoint{0.5 * (place[0].x_px - place[1].x_px), 0.5 * (place[0].y_px - place[1].y_px)};
}

std::optional<Elongation> CentreFinder::Kernels::elongation(algo::PixelPoint centre) const {
    const auto of = pixels_about(centre);
    if (!of) return std::nullopt;
    double xx = 0, xy = 0, yy = 0;
    for (const WindowPixels::Pixel& p : of->pixels) {
        const double here = p.window * (p.light - of->background);
        xx += here * p.dx * p.dx;
        xy += here * p.dx * p.dy;
        yy += here * p.dy * p.dy;
    }
    if (!(xx + yy > 0)) return std::nullopt;
    return Elongation{(xx - yy) / (xx + yy), 2 * xy / (xx + yy)};
}

// Power of the light that a turn by 180 degrees changes. Both places of a pair lie alike between the pixels, so that
// both are blurred alike by the interpolation.
double CentreFinder::Kernels::turned(algo::PixelPoint centre) const {
    const int left = static_cast<int>(std::floor(centre.x_px)), top = static_cast<int>(std::floor(centre.y_px));
    const double part_x = centre.x_px - left, part_y = centre.y_px - top;
    const int reach = std::min({half, left, top, image->width_px() - 2 - left, image->height_px() - 2 - top});
    const auto light_at = [&](int x, int y) {
        const double above = image->at(left + x, top + y) * (1 - part_x) + image->at(left + x + 1, top + y) * part_x;
        const double below =
            image->at(left + x, top + y + 1) * (1 - part_x) + image->at(left + x + 1, top + y + 1) * part_x;
        return above * (1 - part_y) + below * part_y;
    };
    double sum = 0;
    for (int y = 0; y <= reach; ++y) {
        for (int x = y == 0 ? 1 : -reach; x <= reach; ++x) {
            const double window = lookup(weights.window, std::hypot(x, y));
            if (window > 0) sum += window * std::pow(light_at(x, y) - light_at(-x, -y), 2) / 2;  // of both places
        }
    }
    return sum;
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
        if (round + 1 == kMaxRounds || (round + 1 >= kMinRounds && moved < kSettled))
            return CentreFinder(std::move(kernels));
        profile = measure_profile(image, spots, widest);
        // The window of a small spot ends shortly after the profile.
        std::size_t last = profile.value.size() - 1;
        while (last > 0 && profile.value[last] < 0.02) --last;
        radius = std::min(widest, static_cast<double>(last) * kTableStep + 1.5 + kTaper);
    }
    return fail(ErrorCode::refused,
                fmt::format("only {} of {} lenslets near the middle look like one another", spots.size(), seeds.size()),
                "light the lenslets evenly, below saturation, and focus the sensor on them");
}

std::optional<Spot> CentreFinder::measure(algo::PixelPoint at, double most_px) const {
    return kernels_->measure(at, most_px);
}
std::optional<algo::PixelPoint> CentreFinder::split(algo::PixelPoint centre) const { return kernels_->split(centre); }
std::optional<Elongation> CentreFinder::elongation(algo::PixelPoint centre) const {
    return kernels_->elongation(centre);
}
std::optional<std::complex<double>> CentreFinder::lobes(algo::PixelPoint centre, int count) const {
    const auto of = kernels_->pixels_about(centre);
    if (!of) return std::nullopt;
    double sum_re = 0, sum_im = 0, all = 0;
    for (const WindowPixels::Pixel& p : of->pixels) {
        const double square = p.dx * p.dx + p.dy * p.dy, here = p.window * (p.light - of->background);
        if (square == 0) continue;
        double re = here, im = 0;  // times (dx + i dy) to the power of `count`, over that of the distance less two
        for (int k = 0; k < count; ++k) {
            const double next = re * p.dx - im * p.dy;
            im = re * p.dy + im * p.dx;
            re = next;
        }
        for (int k = 2; k < count; k += 2) re /= square, im /= square;
        sum_re += re;
        sum_im += im;
        all += here * square;
    }
    if (!(all > 0)) return std::nullopt;
    return std::complex(sum_re / all, sum_im / all);
}
// With T(r) the profile, a lenslet that is longer one way adds a part of r T', and one whose edge is more blurred one
// way a part of T'' - T' / r, both times cos(2 angle): b of it adds 4 b to the variance along that way, less that
// across. Both are fitted together. Those of a Gaussian spot are the same.
std::optional<std::complex<double>> CentreFinder::edge_blur_px2(algo::PixelPoint centre) const {
    const auto of = kernels_->pixels_about(centre);
    if (!of) return std::nullopt;
    const Table& steepness = kernels_->weights.steepness;
    double longer_longer = 0, longer_blurred = 0, blurred_blurred = 0;
    std::complex<double> longer, blurred;
    for (const WindowPixels::Pixel& p : of->pixels) {
        const double square = p.dx * p.dx + p.dy * p.dy, r = std::sqrt(square);
        if (r < kSlopeStep) continue;
        const double slope = (lookup(steepness, r + kSlopeStep) - lookup(steepness, r - kSlopeStep)) / (2 * kSlopeStep);
        const double stretch = square * p.steepness, blur = -r * slope;
        const double left = p.window * (p.light - of->background - of->amplitude * p.shape) / of->amplitude;
        const std::complex<double> way = std::pow(std::complex(p.dx, p.dy), 2) / square;
        longer_longer += p.window * stretch * stretch / 2;
        longer_blurred += p.window * stretch * blur / 2;
        blurred_blurred += p.window * blur * blur / 2;
        longer += left * stretch * way;
        blurred += left * blur * way;
    }
    const double determinant = longer_longer * blurred_blurred - longer_blurred * longer_blurred;
    if (!(determinant > kMinApart * longer_longer * blurred_blurred)) return std::nullopt;
    return 4.0 * (longer_longer * blurred - longer_blurred * longer) / determinant;
}
std::optional<algo::PixelPoint> CentreFinder::gradient(algo::PixelPoint centre) const {
    const double half = half_height_radius_px(), inside = std::min(half - kTaper, kInside * half);
    if (!kernels_->weights.plateau || inside < kSmallestInside) return std::nullopt;
    const auto of = kernels_->pixels_about(centre);
    if (!of) return std::nullopt;
    double count = 0, x = 0, y = 0, xx = 0, yy = 0, all = 0, lx = 0, ly = 0;
    for (const WindowPixels::Pixel& p : of->pixels) {
        if (p.dx * p.dx + p.dy * p.dy > inside * inside) continue;
        const double light = p.light - of->background;
        count += 1;
        x += p.dx;
        y += p.dy;
        xx += p.dx * p.dx;
        yy += p.dy * p.dy;
        all += light;
        lx += p.dx * light;
        ly += p.dy * light;
    }
    if (!(count > 0 && all > 0)) return std::nullopt;
    const double to_mean = half * count / all;
    return algo::PixelPoint{to_mean * (lx - all * x / count) / (xx - x * x / count),
                            to_mean * (ly - all * y / count) / (yy - y * y / count)};
}
bool CentreFinder::complete(algo::PixelPoint at) const { return kernels_->complete(at); }
double CentreFinder::amplitude_dn(algo::PixelPoint at) const { return kernels_->moments(at).amplitude; }
double CentreFinder::window_radius_px() const { return kernels_->weights.radius; }
double CentreFinder::half_height_radius_px() const {
    return static_cast<double>(half_height(kernels_->weights.profile)) * kTableStep;
}
double CentreFinder::stretch_shown() const { return calib::stretch_shown(kernels_->weights); }
double CentreFinder::edge_variance_px2() const { return edge_variance(kernels_->weights); }
Immunity CentreFinder::immunity() const { return kernels_->weights.immunity; }
AgainstGradients CentreFinder::against() const { return kernels_->against; }
double CentreFinder::shift_by_gradient_px2() const { return shift_by_gradient(kernels_->weights); }
double CentreFinder::unlike_by_shift_px2() const { return unlike_by_shift(kernels_->weights); }
std::optional<Unlike> CentreFinder::unlike(algo::PixelPoint centre) const {
    const auto of = kernels_->pixels_about(centre);
    if (!of) return std::nullopt;
    double area = 0, mean = 0, square = 0, left = 0;
    for (const WindowPixels::Pixel& p : of->pixels) {
        area += p.window;
        mean += p.window * p.light;
        square += p.window * p.light * p.light;
        left += p.window * std::pow(p.light - of->background - of->amplitude * p.shape, 2);
    }
    const double power = square - mean * mean / area;
    return Unlike{left / power, kernels_->turned(centre) / power};
}
double CentreFinder::typical_amplitude_dn() const { return kernels_->typical_amplitude; }

double CentreFinder::saturated_share(algo::PixelPoint at) const {
    const int half = kernels_->half;
    const auto cx = static_cast<int>(std::lround(at.x_px));
    const auto cy = static_cast<int>(std::lround(at.y_px));
    const WhiteImage& image = *kernels_->image;
    const double r2 = kernels_->weights.radius * kernels_->weights.radius;
    int inside = 0;
    int saturated = 0;
    for (int y = std::max(0, cy - half); y <= std::min(image.height_px() - 1, cy + half); ++y) {
        for (int x = std::max(0, cx - half); x <= std::min(image.width_px() - 1, cx + half); ++x) {
            const double dx = x - at.x_px;
            const double dy = y - at.y_px;
            if (dx * dx + dy * dy > r2) continue;
            ++inside;
            if (image.saturated(x, y)) ++saturated;
        }
    }
    return inside > 0 ? static_cast<double>(saturated) / inside : 0;
}

}  // namespace hord::calib
