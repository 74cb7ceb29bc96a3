#include "calib/lattice/lattice.h"

#include <algorithm>
#include <cmath>
#include <complex>
#include <numbers>
#include <vector>

#include <fmt/format.h>
#include <opencv2/imgproc.hpp>

#include "calib/lattice/autocorrelation.h"

namespace hord::calib {
namespace {

using algo::kHalfSqrt3;

constexpr int kLargestSide = 640;   // of the analysed part
constexpr double kShortestLag = 3;  // px
constexpr double kRepeats = 0.8;    // of the highest peak: it is one of the lattice, too
// One in so many pixels: darker ones are made alike. The latter for two dark rows of twenty.
constexpr std::size_t kDarkest = 50, kDarkRows = 10;
constexpr double kMinStrength = 0.08;  // of the autocorrelation at a lattice vector, against 1 at lag 0
// Of a pitch: what distortion and the autocorrelation may make of one at a limit.
constexpr double kPitchError = 0.005;

struct Part {
    int x = 0, y = 0, width = 0, height = 0;
};

// The part of the frame to analyse: all of it, or the most structured of five parts of a large frame.
Part choose_part(const WhiteImage& image) {
    Part whole{0, 0, image.width_px(), image.height_px()};
    const int width = std::min(whole.width, kLargestSide);
    const int height = std::min(whole.height, kLargestSide);
    if (width == whole.width && height == whole.height) return whole;
    const int spare_x = whole.width - width;
    const int spare_y = whole.height - height;
    Part best;
    double best_score = -1;
    for (const auto& [fx, fy] : {std::pair{0.5, 0.5}, {0.25, 0.25}, {0.75, 0.25}, {0.25, 0.75}, {0.75, 0.75}}) {
        const Part part{static_cast<int>(fx * spare_x), static_cast<int>(fy * spare_y), width, height};
        // Mean absolute step over 5 px, every 7th pixel: light that changes within a lenslet.
        double score = 0;
        for (int y = 0; y < height; y += 7) {
            for (int x = 0; x + 5 < width; x += 7) {
                score += std::abs(image.at(part.x + x + 5, part.y + y) - image.at(part.x + x, part.y + y));
            }
        }
        if (best_score < 0) score *= 1.5;  // prefers the middle, unless another is much better
        if (score > best_score) {
            best_score = score;
            best = part;
        }
    }
    return best;
}

// The part as square roots of light, less the local mean, windowed: reduces hot pixels and bright corners. The darkest
// pixels, one in `darkest`, are made alike.
cv::Mat1f flatten(const WhiteImage& image, const Part& part, std::size_t darkest) {
    cv::Mat1f light(part.height, part.width);
    image.window(part.x, part.y, part.width, part.height, light.ptr<float>(0), part.width);
    std::vector<float> sorted;  // every 13th pixel
    for (int k = 0; k < part.width * part.height; k += 13) sorted.push_back(light(k / part.width, k % part.width));
    const auto dim = sorted.begin() + static_cast<std::ptrdiff_t>(sorted.size() / darkest);
    std::nth_element(sorted.begin(), dim, sorted.end());
    const float floor = *dim;
    light -= floor;
    cv::max(light, 0.0, light);
    cv::sqrt(light, light);
    cv::Mat1f mean;
    const int reach = std::min(129, (std::min(part.width, part.height) - 1) | 1);
    cv::blur(light, mean, {reach, reach}, {-1, -1}, cv::BORDER_REFLECT_101);
    light -= mean;
    const std::vector<float> across = hann(part.width);
    const std::vector<float> down = hann(part.height);
    for (int y = 0; y < part.height; ++y) {
        float* row = light.ptr<float>(y);
        for (int x = 0; x < part.width; ++x)
            row[x] *= across[static_cast<std::size_t>(x)] * down[static_cast<std::size_t>(y)];
    }
    return light;
}

struct Basis {
    Vec a, b;
};

Basis reduce(Basis basis) {
    for (int k = 0; k < 20; ++k) {
        if (norm(basis.b) < norm(basis.a)) std::swap(basis.a, basis.b);
        const double turns = std::round(dot(basis.a, basis.b) / dot(basis.a, basis.a));
        if (turns == 0) break;
        basis.b = basis.b - turns * basis.a;
    }
    if (dot(basis.a, basis.b) < 0) basis.b = -1.0 * basis.b;
    return basis;
}

// Refines the steps to a small fraction of a pixel: least squares over the peaks at p a + q b, at longer and longer
// lags.
Basis refine(const Autocorrelation& correlation, Basis basis, double least_height) {
    const double pitch = std::min(norm(basis.a), norm(basis.b));
    for (double reach = 2.3 * pitch; reach < 3.0 * kLargestSide; reach *= 1.6) {
        double pp = 0, pq = 0, qq = 0;
        Vec pv, qv;
        const int most = static_cast<int>(reach / pitch) + 1;
        bool any = false;
        for (int q = 0; q <= most; ++q) {
            for (int p = -most; p <= most; ++p) {
                const Vec lag = static_cast<double>(p) * basis.a + static_cast<double>(q) * basis.b;
                if ((p == 0 && q == 0) || norm(lag) > reach || !correlation.within(lag, 6)) continue;
                any = any || norm(lag) > reach / 1.6;
                const auto peak = correlation.peak_near(lag, static_cast<int>(0.2 * pitch) + 1);
                if (!peak || peak->height < least_height) continue;
                pp += p * p;
                pq += p * q;
                qq += q * q;
                pv = pv + static_cast<double>(p) * peak->lag;
                qv = qv + static_cast<double>(q) * peak->lag;
            }
        }
        const double determinant = pp * qq - pq * pq;
        if (determinant < 1e-6 * pp * qq || determinant <= 0) break;
        const Basis next{(1 / determinant) * (qq * pv - pq * qv), (1 / determinant) * (pp * qv - pq * pv)};
        if (norm(next.a - basis.a) > 0.1 * pitch || norm(next.b - basis.b) > 0.1 * pitch) break;
        basis = next;
        if (!any) break;
    }
    return basis;
}

// The position of the lenslet nearest to the middle of the part, from the phases of the two fundamentals.
Vec place(const cv::Mat1f& windowed, const Basis& basis) {
    const double area = cross(basis.a, basis.b);
    const Vec frequency[2] = {{basis.b.y / area, -basis.b.x / area}, {-basis.a.y / area, basis.a.x / area}};
    double turns[2];
    for (int k = 0; k < 2; ++k) {
        std::vector<std::complex<float>> across(static_cast<std::size_t>(windowed.cols));
        for (int x = 0; x < windowed.cols; ++x) {
            across[static_cast<std::size_t>(x)] =
                std::polar(1.0F, static_cast<float>(-2 * std::numbers::pi * std::remainder(frequency[k].x * x, 1.0)));
        }
        std::complex<double> sum = 0;
        for (int y = 0; y < windowed.rows; ++y) {
            const float* row = windowed.ptr<float>(y);
            float re = 0;
            float im = 0;
            for (int x = 0; x < windowed.cols; ++x) {
                re += row[x] * across[static_cast<std::size_t>(x)].real();
                im += row[x] * across[static_cast<std::size_t>(x)].imag();
            }
            sum += std::complex<double>(re, im) *
                std::polar(1.0, -2 * std::numbers::pi * std::remainder(frequency[k].y * y, 1.0));
        }
        turns[k] = -std::arg(sum) / (2 * std::numbers::pi);
    }
    const Vec origin = turns[0] * basis.a + turns[1] * basis.b;
    const Vec middle = Vec{0.5 * windowed.cols, 0.5 * windowed.rows} - origin;
    const double p = std::round(dot(middle, frequency[0]));
    const double q = std::round(dot(middle, frequency[1]));
    return origin + p * basis.a + q * basis.b;
}

Vec turned(Vec a, double degrees) {
    const double angle = degrees * std::numbers::pi / 180;
    return {std::cos(angle) * a.x - std::sin(angle) * a.y, std::sin(angle) * a.x + std::cos(angle) * a.y};
}

// The lattice vector, of either sign, nearest to a direction.
Vec nearest(const std::vector<Vec>& vectors, Vec direction) {
    Vec best;
    double most = -1e300;
    for (const Vec& v : vectors) {
        for (const double sign : {1.0, -1.0}) {
            const double along = sign * dot(v, direction) / norm(v);
            if (along > most + 1e-9) {
                most = along;
                best = sign * v;
            }
        }
    }
    return best;
}

}  // namespace

double Lattice::pitch_px() const { return std::sqrt(std::abs(step_u.x_px * step_v.y_px - step_u.y_px * step_v.x_px)); }

namespace {

Result<Lattice> lattice_of(const WhiteImage& image, const Part& part, std::size_t darkest, const LatticeHint& hint) {
    const auto refuse = [](std::string what, std::string cure) {
        return fail(ErrorCode::refused, std::move(what), std::move(cure));
    };
    const cv::Mat1f windowed = flatten(image, part, darkest);
    const Autocorrelation correlation(windowed);
    const double shortest = hint.pitch_px > 0 ? 0.8 * hint.pitch_px : 0.9 * kMinPitch;
    const double longest = hint.pitch_px > 0 ? 1.8 * hint.pitch_px : 1.5 * kMaxPitch;
    const auto peaks = peaks_of(correlation, shortest, longest);
    double highest = 0;
    for (const auto& peak : peaks) highest = std::max(highest, peak.height);
    if (highest < kMinStrength) {
        return refuse(
            fmt::format("the white frame shows no lattice: its autocorrelation reaches {:.3f} of {:.2f} needed",
                        highest, kMinStrength),
            "light the lenslets evenly, below saturation, and focus the sensor on them");
    }
    // Lenslets nearer than the smallest pitch: what was found are lags of several of their pitches.
    if (hint.pitch_px == 0) {
        for (const auto& peak : peaks_of(correlation, kShortestLag, shortest)) {
            if (peak.height < kRepeats * highest) continue;
            return refuse(
                fmt::format("a lenslet pitch of about {:.1f} px", norm(peak.lag)),
                "use a sensor with 8 to 64 px a lenslet; if it has them, record lenslets without dark rows, in one "
                "exposure while array and light are still: rows without light and two exposures show other pitches");
        }
    }
    // A row of lenslets that is dark as a whole is alike along itself, and raises the peaks along it over all others:
    // these are compared with the highest of them.
    std::optional<Basis> found;
    double beside = 0;
    for (std::size_t first = 0; first < peaks.size() && !found; ++first) {
        if (peaks[first].height < 0.6 * highest) continue;
        const Vec a = peaks[first].lag;
        const auto apart = [&](Vec b) { return std::abs(cross(a, b)) >= 0.5 * norm(a) * norm(b); };
        beside = 0;
        for (const auto& peak : peaks) beside = apart(peak.lag) ? std::max(beside, peak.height) : beside;
        if (beside < kMinStrength) continue;
        for (std::size_t second = 0; second < peaks.size() && !found; ++second) {
            const double least = (second < first ? 0.6 : 0.5) * beside;
            if (peaks[second].height >= least && apart(peaks[second].lag)) found = Basis{a, peaks[second].lag};
        }
    }
    if (!found) {
        return refuse("the white frame repeats itself in one direction only: a single row of lenslets, or stripes",
                      "show at least three rows and three columns of lenslets");
    }
    const Basis basis = refine(correlation, reduce(*found), 0.3 * beside);
    const double ratio = norm(basis.b) / norm(basis.a);
    const double angle = std::acos(std::clamp(dot(basis.a, basis.b) / (norm(basis.a) * norm(basis.b)), -1.0, 1.0)) *
        180 / std::numbers::pi;
    const bool square = std::abs(angle - 90) < 6 && ratio < 1.15;
    const bool hexagonal = std::abs(angle - 60) < 6 && ratio < 1.15;
    if (!square && !hexagonal) {
        return refuse(
            fmt::format("the lattice is neither square nor hexagonal: steps of {:.2f} and {:.2f} px at {:.1f} degrees",
                        norm(basis.a), norm(basis.b), angle),
            "check that the frame shows one lenslet array, undistorted by its optics, without rows of dark lenslets, "
            "in one exposure while array and light are still");
    }
    Lattice lattice;
    lattice.kind = square ? algo::LatticeKind::square : algo::LatticeKind::hexagonal;
    if (hint.kind && *hint.kind != lattice.kind) {
        return refuse(fmt::format("the lattice is {}, not {}", name_of(lattice.kind), name_of(*hint.kind)),
                      "correct the hint, or leave it away");
    }
    std::vector<Vec> vectors{basis.a, basis.b};
    Vec u;
    Vec v;
    if (square) {
        u = nearest(vectors, {1, 1e-6});
        v = nearest(vectors, turned(u, 90));
    } else {
        vectors.push_back(basis.b - basis.a);
        u = nearest(vectors, {1, 1e-6});
        v = nearest(vectors, {1e-6, 1});
        if (std::abs(u.y) * norm(v) <= std::abs(v.x) * norm(u)) {
            lattice.stagger = algo::Stagger::rows;
            v = (1 / kHalfSqrt3) * (nearest(vectors, turned(u, 60)) - 0.5 * u);
        } else {
            lattice.stagger = algo::Stagger::columns;
            u = (1 / kHalfSqrt3) * (nearest(vectors, turned(v, -60)) - 0.5 * v);
        }
    }
    const double pitch = std::sqrt(std::abs(cross(u, v)));
    if (pitch < (1 - kPitchError) * kMinPitch || pitch > (1 + kPitchError) * kMaxPitch) {
        return refuse(fmt::format("a lenslet pitch of {:.2f} px", pitch), "use a sensor with 8 to 64 px a lenslet");
    }
    const Vec seed = place(windowed, basis);
    lattice.step_u = {u.x, u.y};
    lattice.step_v = {v.x, v.y};
    lattice.seed_px = {part.x + seed.x, part.y + seed.y};
    lattice.reach_px = 0.5 * std::min(part.width, part.height);
    lattice.strength = highest;
    return lattice;
}

}  // namespace

Result<Lattice> find_lattice(const WhiteImage& image, const LatticeHint& hint) {
    const Part part = choose_part(image);
    auto lattice = lattice_of(image, part, kDarkest, hint);
    if (lattice) return lattice;
    // A row of lenslets that is dark is deeper than gaps with soft edges, and alike along itself only.
    auto without_dark_row = lattice_of(image, part, kDarkRows, hint);
    return without_dark_row ? without_dark_row : lattice;
}

}  // namespace hord::calib
