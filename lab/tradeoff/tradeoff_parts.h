// The parts of the trade-off: small cylinder lenses with defects of known size, traced and exposed by the simulation.
//
// A part is a strip of 8 x 32 lenslets of 0.1 mm, wholly inside a cylinder lens whose curvature makes the mean
// deflection change by `slope` over two lenslets across x. Slopes are in bins of the nine-bin camera (15 mrad), so they
// mean the same part for every camera. Unless the point says otherwise, all see the same 135 mrad with the same source,
// divided into more or fewer bins.
// Each good part has its own pose (0.1 lenslet about one of four nominal places); each bad one has four separate
// defects, log-uniform in size. Bubbles and inclusions are traced. Haze is added to the light field: in a
// disc of 1.2 lenslets radius, a share of every lenslet's light is spread by a Gaussian of 15 mrad. The sensor: one
// electron a DN, 16 bit, read noise 2 electrons, no pedestal; photon noise.
//
// Good and bad parts, places and exposures are drawn from disjoint streams of one seed.
#pragma once

#include <array>
#include <cstdint>
#include <functional>
#include <string>
#include <vector>

#include "algo/frame/decode.h"
#include "hal_sim/optics/camera/render.h"

namespace hord::lab {

struct TradeoffPoint {
    int bins = 9;               // a side
    double slope = 0.15;        // bins of the nine-bin camera over two lenslets
    int photons = 2000;         // electrons a lenslet and frame
    int frames = 1;             // averaged
    int stride = 1;             // every stride-th lenslet of every stride-th row is used
    double range_mrad = 135;    // of all bins
    double source_mrad = 9.15;  // angular radius of the source
    [[nodiscard]] std::string key() const;
    friend bool operator==(const TradeoffPoint&, const TradeoffPoint&) = default;
};

enum class Family : std::uint8_t { bubble, inclusion, haze };  // air; glass of index 1.52 in glass of 1.5; scattering
constexpr std::size_t kFamilies = 3;
constexpr std::array<std::string_view, kFamilies> kFamilyNames = {"bubble", "inclusion", "haze"};
// Sizes: radii in lenslets of stride 1; of haze, the share of the light that is scattered.
constexpr std::array<double, kFamilies> kSmallest = {0.02, 0.1, 0.01}, kLargest = {1.2, 1.2, 1.0};

struct PlacedDefect {
    double m = 0, n = 0;  // used lenslets (every stride-th)
    double size = 0;      // as kSmallest
};
struct PartLight {
    sim::LightField light;  // every stride-th lenslet
    int place = 0;          // its nominal place, 0..kPlaces-1
    Family family = Family::bubble;
    std::vector<PlacedDefect> defects;  // none: a good part
};
constexpr int kPlaces = 4;
constexpr int kColumns = 8, kRows = 32;  // of lenslets used

struct TradeoffParts {
    sim::Scene scene;                      // the nominal part: camera, light, sensor
    std::vector<sim::LightField> nominal;  // by place, for references
    std::vector<PartLight> good, bad;
};

struct PartCounts {
    int good = 40;             // parts
    int bad_of_a_family = 30;  // parts, with four defects each
};
// Traces the parts. Depends only on the point's bins, slope and stride.
Result<TradeoffParts> trace_parts(const TradeoffPoint& point, const PartCounts& counts, std::uint64_t seed, int threads,
                                  const std::function<void(double)>& progress);

// The average of `point.frames` exposures at point.photons. Each `exposure` has its own noise.
Frame expose_part(const TradeoffParts& parts, const sim::LightField& light, const TradeoffPoint& point,
                  std::uint64_t seed, std::uint64_t exposure);
// Without noise, in 16 bits.
Frame expose_exactly(const TradeoffParts& parts, const sim::LightField& light);

// The light levels of the station's recipe: the dark level is three times the read noise of the average, and a lenslet
// is dark below a tenth of the light of 200 photons.
algo::LightLevels levels_at(const TradeoffPoint& point);
constexpr algo::LightLevels kExactLevels{0, 1, 65535};

}  // namespace hord::lab
