#include "algo/reference/photon_noise.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <span>
#include <utility>
#include <vector>

#include "algo/frame/mask.h"
#include "common/statistics.h"

namespace hord::algo {
namespace {

constexpr std::size_t kMinChosen = 60, kMaxChosen = 600;  // lenslets
constexpr std::size_t kShareChosen = 20;                  // one of so many
// A sample counts from so many standard deviations of reading on; where too few lenslets have two of them, from half
// as many on.
constexpr double kLitNoises = 20, kLitNoisesAtLeast = 10;
constexpr double kMaxNoises = 6;                   // of the reference's own noise: the flattest places change less
constexpr double kMaxRatio = 3;                    // of the median place's variance
constexpr std::size_t kMinBinsOfShift = 6;         // lit bins of a place from which on a shift is told from noise
constexpr double kNewColumn = 1e-6;                // least share of a column's squares beyond the others
constexpr double kMinGain = 1e-3, kMaxGain = 1e5;  // electrons a DN

struct FlatPlace {
    double change = 0;  // largest difference of the mean deflection within two lenslets, bins
    std::size_t k = 0;
};

// The places that change least, flattest first.
std::vector<FlatPlace> flattest(const Reference& r) {
    const Extents& e = r.extents;
    std::vector<FlatPlace> places;
    for (int n = 2; n + 2 < e.n; ++n) {
        for (int m = 2; m + 2 < e.m; ++m) {
            const std::size_t k = e.index(m, n);
            double change = 0;
            e.for_each_around(m, n, 2, [&](int x, int y) {
                const std::size_t other = e.index(x, y);
                if ((r.mask[other] | r.mask[k]) != kValid) {
                    change = std::numeric_limits<double>::infinity();
                    return;
                }
                const auto differ = [&](const std::vector<float>& map) {
                    change = std::max(change, std::abs(static_cast<double>(map[other] - map[k])));
                };
                differ(r.x), differ(r.y);
            });
            if (std::isfinite(change)) places.push_back({change, k});
        }
    }
    const std::size_t chosen =
        std::min({std::max(places.size() / kShareChosen, kMinChosen), kMaxChosen, places.size()});
    std::ranges::partial_sort(places, places.begin() + static_cast<std::ptrdiff_t>(chosen), {}, &FlatPlace::change);
    places.resize(chosen);
    return places;
}

// The noise of the reference's mean deflections at these places, bins: from second differences, to which a slope adds
// nothing. Photons, and readings above the dark level.
double deflection_noise_at(const Reference& r, const std::vector<FlatPlace>& places) {
    std::vector<double> second;
    for (const FlatPlace& place : places) {
        for (const std::vector<float>* map : {&r.x, &r.y}) {
            for (const std::size_t step : {std::size_t{1}, static_cast<std::size_t>(r.extents.m)})
                second.push_back(std::abs(
                    static_cast<double>((*map)[place.k - step] - 2 * (*map)[place.k] + (*map)[place.k + step])));
        }
    }
    return 1.4826 * common::upper_median(std::span(second)) / std::sqrt(6.0);
}

struct LitBin {
    int x, y;          // of its sample
    double light = 0;  // of the reference, DN
    double sample = 0, rest_sum = 0, rest_squares = 0;
};
// What brightness and a shift do to the bins of a place: columns that are orthonormal where a bin's weight is 1 /
// light.
struct LitPlace {
    std::size_t first = 0, end = 0;   // of its bins
    double expected = 0, scales = 0;  // DN; sum over the frames
    std::vector<std::vector<double>> columns;
};
struct LitBins {
    std::vector<LitBin> bins;
    std::vector<LitPlace> places;  // with two bins and more
    [[nodiscard]] std::span<LitBin> of(const LitPlace& place) {
        return std::span(bins).subspan(place.first, place.end - place.first);
    }
};

// Adds what is new in `column`; nothing if that is little.
void add_column(LitPlace& place, std::span<const LitBin> bins, std::vector<double> column) {
    const auto product = [&](const std::vector<double>& a, const std::vector<double>& b) {
        double sum = 0;
        for (std::size_t k = 0; k < bins.size(); ++k) sum += a[k] * b[k] / bins[k].light;
        return sum;
    };
    const double whole = product(column, column);
    for (const std::vector<double>& other : place.columns) {
        const double along = product(column, other);
        for (std::size_t k = 0; k < column.size(); ++k) column[k] -= along * other[k];
    }
    const double rest = product(column, column);
    if (!(rest > kNewColumn * whole)) return;
    for (double& value : column) value /= std::sqrt(rest);
    place.columns.push_back(std::move(column));
}

// The bins of these places with at least `lit` DN above the pedestal.
LitBins lit_bins(const Reference& r, const std::vector<FlatPlace>& places, double lit) {
    const Extents& e = r.extents;
    LitBins found;
    for (const FlatPlace& flat : places) {
        LitPlace place;
        place.first = found.bins.size();
        const int left = static_cast<int>(flat.k) % e.m * e.i, top = static_cast<int>(flat.k) / e.m * e.j;
        for (int b = 0; b < e.bins(); ++b) {
            const int i = b % e.i, j = b / e.i;
            const double light =
                static_cast<double>(r.light[flat.k]) * 0x1p-15 * r.shares[flat.k * r.stride() + r.place(i, j)] +
                static_cast<double>(r.sensor.clip_dn);
            if (light < lit) continue;
            found.bins.push_back({left + i, top + j, light});
            place.expected += light;
        }
        place.end = found.bins.size();
        if (place.end - place.first < 2) continue;
        const auto bins = found.of(place);
        std::vector<double> column;
        for (const LitBin& bin : bins) column.push_back(bin.light);
        add_column(place, bins, std::move(column));
        // A small shift carries light across the border of two bins: about the geometric mean of theirs.
        const auto light_at = [&](int i, int j) {
            return static_cast<double>(r.shares[flat.k * r.stride() + r.place(i, j)]);
        };
        for (const auto& [di, dj] : {std::pair(1, 0), std::pair(0, 1)}) {
            if (bins.size() < kMinBinsOfShift) break;
            column.clear();
            for (const LitBin& bin : bins) {
                const int i = bin.x - left, j = bin.y - top;
                column.push_back(std::sqrt(light_at(i, j)) *
                                 (std::sqrt(light_at(i - di, j - dj)) - std::sqrt(light_at(i + di, j + dj))));
            }
            add_column(place, bins, std::move(column));
        }
        found.places.push_back(std::move(place));
    }
    return found;
}

}  // namespace

Result<std::optional<float>> electrons_per_dn_of(
    const Reference& reference, double pedestal_dn, std::size_t count,
    const std::function<Result<std::optional<Frame>>(std::size_t part)>& frame_of) {
    const std::vector<FlatPlace> places = flattest(reference);
    if (places.size() < kMinChosen) return std::nullopt;
    const double read = static_cast<double>(reference.sensor.read_dn), reading = read * read + 1.0 / 12;
    LitBins lit = lit_bins(reference, places, kLitNoises * std::sqrt(reading));
    if (lit.places.size() < kMinChosen) lit = lit_bins(reference, places, kLitNoisesAtLeast * std::sqrt(reading));
    if (lit.places.size() < kMinChosen) return std::nullopt;
    double frames = 0;
    for (std::size_t part = 0; part < count; ++part) {
        const auto frame = frame_of(part);
        if (!frame) return tl::unexpected(frame.error());
        if (!*frame) continue;
        const FrameView view = (*frame)->view();
        for (LitPlace& place : lit.places) {
            const auto bins = lit.of(place);
            double light = 0;
            for (LitBin& bin : bins) light += bin.sample = view.sample(bin.x, bin.y) - pedestal_dn;
            const double scale = place.expected / std::max(light, 1.0);
            place.scales += scale;
            std::vector<double> along;
            for (const std::vector<double>& column : place.columns) {
                along.push_back(0);
                for (std::size_t k = 0; k < bins.size(); ++k)
                    along.back() += column[k] * bins[k].sample / bins[k].light;
            }
            for (std::size_t k = 0; k < bins.size(); ++k) {
                double rest = bins[k].sample;
                for (std::size_t c = 0; c < along.size(); ++c) rest -= along[c] * place.columns[c][k];
                bins[k].rest_sum += scale * rest, bins[k].rest_squares += scale * scale * rest * rest;
            }
        }
        frames += 1;
    }
    if (frames < Reference::kMinParts) return std::nullopt;
    // The rest is linear in the samples, and a sample of v DN, scaled by s, has the variance s v / gain + s^2 reading.
    struct Noise {
        double variance, light;  // by photons, DN^2; DN
        [[nodiscard]] double per_light() const { return variance / light; }
    };
    std::vector<Noise> noises;
    std::vector<double> ratios;
    for (const LitPlace& place : lit.places) {
        const double scale = place.scales / frames;
        const auto bins = lit.of(place);
        double variance = 0, light = 0;
        for (std::size_t k = 0; k < bins.size(); ++k) {
            variance += (bins[k].rest_squares - bins[k].rest_sum * bins[k].rest_sum / frames) / (frames - 1);
            for (std::size_t from = 0; from < bins.size(); ++from) {
                double share = from == k ? 1 : 0;
                for (const std::vector<double>& column : place.columns)
                    share -= column[k] * column[from] / bins[from].light;
                variance -= share * share * scale * scale * reading;
                light += share * share * scale * bins[from].light;
            }
        }
        noises.push_back({variance, light});
        ratios.push_back(noises.back().per_light());
    }
    // A place where anything else changed varies more than the others.
    const double most = kMaxRatio * common::upper_median(std::span(ratios));
    Noise all{};
    for (const Noise& noise : noises) {
        if (noise.per_light() < most) all.variance += noise.variance, all.light += noise.light;
    }
    const double gain =
        all.light > 0 ? std::clamp(all.light / std::max(all.variance, 1e-12), kMinGain, kMaxGain) : kMaxGain;
    // The reference's own mean deflections change by noise, too: photons alone give about 0.6 bin over the root of
    // their number.
    const double electrons = gain * static_cast<double>(reference.light[places.back().k]) * frames,
                 noise = std::max(0.6 / std::sqrt(electrons), deflection_noise_at(reference, places));
    if (places.back().change > kMaxNoises * (noise + 1.0 / (1 << 12))) return std::nullopt;
    return static_cast<float>(gain);
}

}  // namespace hord::algo
