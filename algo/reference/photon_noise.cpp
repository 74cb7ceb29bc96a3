#include "algo/reference/photon_noise.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <span>
#include <vector>

#include "algo/frame/mask.h"
#include "common/statistics.h"

namespace hord::algo {
namespace {

constexpr std::size_t kMinChosen = 60, kMaxChosen = 600;  // lenslets
constexpr std::size_t kShareChosen = 20;                  // one of so many
constexpr double kLitNoises = 20;                  // a sample counts from so many standard deviations of reading on
constexpr double kMaxNoises = 6;                   // of the reference's own noise: the flattest places change less
constexpr double kMaxRatio = 3;                    // of the median place's variance
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

}  // namespace

Result<std::optional<float>> electrons_per_dn_of(
    const Reference& reference, double pedestal_dn, std::size_t count,
    const std::function<Result<std::optional<Frame>>(std::size_t part)>& frame_of) {
    const Extents& e = reference.extents;
    const std::vector<FlatPlace> places = flattest(reference);
    if (places.size() < kMinChosen) return std::nullopt;
    const double read = static_cast<double>(reference.sensor.read_dn), reading = read * read + 1.0 / 12,
                 lit = kLitNoises * std::sqrt(reading);
    // The lit bins of the places, place by place.
    struct LitBin {
        int x, y;  // of its sample
        double sample = 0, sum = 0, squares = 0;
    };
    struct Place {
        std::size_t first = 0, end = 0;   // of its bins
        double expected = 0, scales = 0;  // DN; sum over the frames
    };
    std::vector<LitBin> bins;
    std::vector<Place> chosen;
    for (const FlatPlace& flat : places) {
        Place place{.first = bins.size()};
        const int left = static_cast<int>(flat.k) % e.m * e.i, top = static_cast<int>(flat.k) / e.m * e.j;
        for (int b = 0; b < e.bins(); ++b) {
            const int i = b % e.i, j = b / e.i;
            const double light = static_cast<double>(reference.light[flat.k]) * 0x1p-15 *
                reference.shares[flat.k * reference.stride() + reference.place(i, j)];
            if (light < lit) continue;
            bins.push_back({left + i, top + j});
            place.expected += light;
        }
        place.end = bins.size();
        if (place.end - place.first > 1) chosen.push_back(place);
    }
    if (chosen.size() < kMinChosen) return std::nullopt;
    double frames = 0;
    for (std::size_t part = 0; part < count; ++part) {
        const auto frame = frame_of(part);
        if (!frame) return tl::unexpected(frame.error());
        if (!*frame) continue;
        const FrameView view = (*frame)->view();
        for (Place& place : chosen) {
            const auto of_place = std::span(bins).subspan(place.first, place.end - place.first);
            double light = 0;
            for (LitBin& bin : of_place) light += bin.sample = view.sample(bin.x, bin.y) - pedestal_dn;
            const double scale = place.expected / std::max(light, 1.0);
            place.scales += scale;
            for (LitBin& bin : of_place)
                bin.sum += scale * bin.sample, bin.squares += scale * scale * bin.sample * bin.sample;
        }
        frames += 1;
    }
    if (frames < Reference::kMinParts) return std::nullopt;
    // A sample of the share h of n lit bins, scaled by s to the mean v, has the variance
    // (1 - h) s v / gain + (1 - 2 h + n h^2) s^2 reading.
    struct Noise {
        double variance, light;  // by photons, DN^2; DN
        [[nodiscard]] double per_light() const { return variance / light; }
    };
    std::vector<Noise> noises;
    std::vector<double> ratios;
    for (const Place& place : chosen) {
        const double scale = place.scales / frames, lit_bins = static_cast<double>(place.end - place.first);
        double variance = 0, light = 0;
        for (const LitBin& bin : std::span(bins).subspan(place.first, place.end - place.first)) {
            const double mean = bin.sum / frames, share = mean / place.expected;
            variance += (bin.squares - frames * mean * mean) / (frames - 1) -
                scale * scale * reading * (1 - 2 * share + lit_bins * share * share);
            light += scale * mean * (1 - share);
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
    // Differences of the reference's own mean deflections, by noise alone: about 0.6 bin over the root of its
    // electrons.
    const double electrons = gain * static_cast<double>(reference.light[places.back().k]) * frames;
    if (places.back().change > kMaxNoises * (0.6 / std::sqrt(electrons) + 1.0 / (1 << 12))) return std::nullopt;
    return static_cast<float>(gain);
}

}  // namespace hord::algo
