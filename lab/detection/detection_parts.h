// The simulated production of `hord-lab experiment detection`: parts that each have a slightly different pose, good
// or with one flaw, traced by the optics, exposed by the sensor model.
//
// The round part is a double-convex lens of 9.5 lenslets radius in a field of 27x27 lenslets of 0.2 mm, free light
// around it, its mean deflection changing by 0.2 bin over two lenslets. The strip is a cylinder lens that fills a field
// of 10x24 lenslets, of any slope. 9x9 bins of 15 mrad, 2,000 electrons a lenslet, 12 bits, one electron a DN, read
// noise 2 electrons. The pose wobble is +-0.5 lenslet and +-1 degree.
//
// Bubbles, dimples (a shallow spherical hollow, radius of curvature 20 mm) and scratches (a groove of 0.03 mm radius)
// are traced. Specks let half of the light through, and haze spreads a tenth of the light by a Gaussian of one bin, in
// a disc. Both are applied to the traced light of a good part: the optics do not scatter.
#pragma once

#include <cstdint>
#include <memory>
#include <optional>
#include <span>
#include <string_view>

#include "algo/inspection/pipeline.h"
#include "algo/reference/reference_learner.h"
#include "hal_sim/optics/camera/render.h"

namespace hord::lab {

enum class Flaw : std::uint8_t { none, bubble, dimple, scratch, speck, haze };
constexpr std::string_view kFlawNames[] = {"good", "bubble", "dimple", "scratch", "speck", "haze"};

struct PlacedFlaw {
    double m = 0, n = 0;  // lenslets
    double size = 0;      // radius, lenslets; of a scratch half its length
};

struct ProductionPart {
    sim::LightField light;
    PlacedFlaw flaw;
};

// Disjoint streams of one seed for learning, tuning and testing.
enum class Stream : std::uint32_t { learn = 0x1EA2, tune = 0x7E57, test = 0xD37E };

sim::Scene round_part();
sim::Scene strip(double slope);  // bins over two lenslets

// Part `number` of a stream. `wobble` 1: the pose wobble above, 0: none. `size` of the flaw; 0: log-uniform from 0.1
// to 1.5 lenslets.
Result<ProductionPart> make_part(const sim::Scene& scene, Flaw flaw, double size, double wobble, std::uint64_t seed,
                                 Stream stream, std::uint32_t number);
// Adds a speck or haze at a random place to a good part's light.
void add_flaw(ProductionPart& part, Flaw flaw, double size, std::uint64_t seed, Stream stream, std::uint32_t number);

Frame expose_part(const sim::LightField& light, const sim::Scene& scene, std::uint64_t seed, std::uint64_t exposure,
                  double led = 1);

constexpr double kProductionElectrons = 2000;  // a lenslet
constexpr float kProductionGain = 1, kProductionReadDn = 2;
// The recipe that a user gets, at this production's scale.
algo::Recipe production_recipe();
// A reference from frames of good parts, as `hordctl learn` makes it without options: electrons a DN, read noise and
// dark level are estimated from the frames.
Result<std::shared_ptr<const algo::Reference>> learn_as_a_user(const sim::Camera& camera,
                                                               std::span<const Frame> frames);
Result<std::shared_ptr<const algo::Reference>> learn_production(const sim::Scene& scene, int parts, double wobble,
                                                                std::uint64_t seed, double led = 1);

}  // namespace hord::lab
