// What one lenslet's light looks like: halves, second moments, lobes, edges, gradients, differences from the profile.
#include <algorithm>
#include <cmath>

#include <opencv2/imgproc.hpp>

#include "calib/lattice/centre_kernels.h"

namespace hord::calib {
namespace {

constexpr double kInside = 0.7, kSmallestInside = 2;  // of the half height, and px: the inside of a lenslet

constexpr double kSlopeStep = 2 * kTableStep;
// How different two changes of shape are: 0 if they are alike, 1 if they have nothing in common. Of spots it is 0.06 at
// most, of lenslets with an edge up to 0.8.
constexpr double kMinApart = 0.15;

// Which of the two halves of a lenslet's light a pixel belongs to: alternate sectors of eight about the centre, rotated
// by 0.2 rad, so that no pixel is on their edges.
bool in_second_half(double dx, double dy) {
    constexpr double kTurnX = 0.98006657784124163, kTurnY = 0.19866933079506122;
    const double u = kTurnX * dx + kTurnY * dy, v = kTurnX * dy - kTurnY * dx;
    return ((u > 0) != (v > 0)) != (std::abs(u) > std::abs(v));
}

}  // namespace

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
    const auto of = pixels_about(centre);
    if (!of) return std::nullopt;
    const double a = of->background, b = of->amplitude;
    algo::PixelPoint place[2];
    for (const bool second : {false, true}) {
        double mx = 0, my = 0, xx = 0, xy = 0, yy = 0;
        for (const WindowPixels::Pixel& p : of->pixels) {
            if (in_second_half(p.dx, p.dy) != second) continue;
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
    return algo::PixelPoint{0.5 * halves * (place[0].x_px - place[1].x_px),
                            0.5 * halves * (place[0].y_px - place[1].y_px)};
}

// How many times the noise of half the sum of what both halves measure is that of half their difference, `weight` what
// a pixel's light makes of it: with rho the correlation of the halves' noise, the root of (1 + rho) / (1 - rho). Pixels
// have independent noise, whose variance is that of the light (photons); smoothing spreads a pixel's noise over both
// halves. 1 in a frame that is not smoothed.
double CentreFinder::Kernels::noise_of_halves(const std::function<double(double, double)>& weight) const {
    const double sigma = image->smoothed_px();
    if (sigma == 0) return 1;
    const int reach = half + static_cast<int>(std::ceil(3 * sigma)), width = 2 * reach + 1;
    cv::Mat1d first(width, width, 0.0), second(width, width, 0.0);  // what each half makes of the light
    for (int y = -half; y <= half; ++y) {
        for (int x = -half; x <= half; ++x)
            (in_second_half(x, y) ? second : first)(y + reach, x + reach) = weight(x, y);
    }
    for (cv::Mat1d* of : {&first, &second}) cv::GaussianBlur(*of, *of, {0, 0}, sigma, sigma, cv::BORDER_CONSTANT);
    double common = 0, own = 0;
    for (int y = -reach; y <= reach; ++y) {
        for (int x = -reach; x <= reach; ++x) {
            const double a = first(y + reach, x + reach), b = second(y + reach, x + reach);
            const double variance = lookup(weights.profile, std::hypot(x, y)) + weights.floor;
            common += variance * a * b;
            own += variance * (a * a + b * b) / 2;
        }
    }
    return own > std::abs(common) ? std::sqrt((own + common) / (own - common)) : 1;
}
void CentreFinder::Kernels::learn_noise_of_halves() {
    double sum = 0, mean = 0;  // of the window, and of the profile in it
    for (int y = -half; y <= half; ++y) {
        for (int x = -half; x <= half; ++x) {
            const double r = std::hypot(x, y), window = lookup(weights.window, r);
            sum += window;
            mean += window * lookup(weights.profile, r);
        }
    }
    halves = noise_of_halves([&](double dx, double dy) { return lookup(weights.shift, std::hypot(dx, dy)) * dx; });
    halves_light = noise_of_halves([&](double dx, double dy) {
        const double r = std::hypot(dx, dy);
        return lookup(weights.window, r) * (lookup(weights.profile, r) - mean / sum);
    });
}

std::optional<double> CentreFinder::Kernels::light_noise(algo::PixelPoint centre) const {
    const auto of = pixels_about(centre);
    if (!of) return std::nullopt;
    double of_half[2] = {};
    for (const bool second : {false, true}) {
        double sum = 0, sum_t = 0, sum_tt = 0, sum_l = 0, sum_lt = 0;
        for (const WindowPixels::Pixel& p : of->pixels) {
            if (in_second_half(p.dx, p.dy) != second) continue;
            sum += p.window;
            sum_t += p.window * p.shape;
            sum_tt += p.window * p.shape * p.shape;
            sum_l += p.window * p.light;
            sum_lt += p.window * p.light * p.shape;
        }
        const double spread = sum * sum_tt - sum_t * sum_t;
        if (!(spread > 0)) return std::nullopt;
        of_half[second ? 1 : 0] = (sum * sum_lt - sum_t * sum_l) / spread;
    }
    return 0.5 * halves_light * (of_half[0] - of_half[1]) / of->amplitude;
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

std::optional<algo::PixelPoint> CentreFinder::split(algo::PixelPoint centre) const { return kernels_->split(centre); }
std::optional<double> CentreFinder::light_noise(algo::PixelPoint centre) const { return kernels_->light_noise(centre); }
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
