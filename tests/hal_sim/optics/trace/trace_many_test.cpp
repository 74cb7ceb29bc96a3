// trace_many() returns bit-identical results to trace() for every instruction set and combination of rays.
#include <bit>
#include <random>

#include <gtest/gtest.h>

#include "hal_sim/optics/trace/trace.h"

namespace hord::sim {
namespace {

using algo::Isa;

Scene with(const Part& part, std::vector<SceneDefect> defects = {}) {
    Scene scene;
    scene.part = part;
    scene.defects = std::move(defects);
    return scene;
}

bool same_bits(const Arrival& a, const Arrival& b) {
    const auto equal = [](double x, double y) {
        return std::bit_cast<std::uint64_t>(x) == std::bit_cast<std::uint64_t>(y);
    };
    return equal(a.u, b.u) && equal(a.v, b.v) && equal(a.x, b.x) && equal(a.y, b.y) && equal(a.weight, b.weight) &&
        a.path == b.path;
}

// Rays scattered over the field, then neighbours along lines across rims and defects, then a fan through one point.
std::vector<CameraRay> rays() {
    std::mt19937_64 random(7);
    const auto draw = [&](double half) { return half * (2 * static_cast<double>(random() >> 11) * 0x1p-53 - 1); };
    std::vector<CameraRay> out;
    for (int k = 0; k < 3000; ++k) out.push_back({draw(12), draw(12), draw(0.1), draw(0.1)});
    for (int k = 0; k < 3000; ++k) out.push_back({-12 + 0.008 * k, 0.1, 0.02, -0.01});
    for (int k = 0; k < 500; ++k) out.push_back({0.3, 0.2, draw(0.6), draw(0.6)});
    for (int k = 0; k < 301; ++k) out.push_back({9.9 + 0.001 * k, 0, 0, 0});  // along the axis, onto a rim
    return out;
}

std::vector<Scene> scenes() {
    const AirBubble bubble{{0.5, 0.2, 0}, 0.6};
    Shape ball, hole, drilled, asphere, cone, block, across;
    ball.radius_mm = 6;
    hole.kind = Shape::Kind::cylinder, hole.radius_mm = 1, hole.half_height_mm = 8, hole.rotation_rad = {1.2, 0.3, 0};
    drilled.kind = Shape::Kind::difference, drilled.of = {ball, hole};
    asphere.kind = Shape::Kind::asphere, asphere.radius_of_curvature_mm = -60, asphere.conic = -2.3,
    asphere.aperture_radius_mm = 9, asphere.position_mm = {0, 0, 1};
    block.kind = Shape::Kind::block, block.half_size_mm = {7, 6, 2};
    cone.kind = Shape::Kind::cone, cone.position_mm = {0, 0, -2};
    across.kind = Shape::Kind::intersection, across.of = {asphere, block};
    Shape both = drilled;
    both.kind = Shape::Kind::union_of, both.of = {cone, across};
    std::vector<Scene> out{with(NoPart{}),
                           with(DoubleConvexLens{}),
                           with(DoubleConvexLens{}, {bubble, AbsorbingSpeck{{2, 0, 0}, 0.7, 0.3}}),
                           with(Vial{}, {Scratch{{-4, 0, 5}, {4, 1, 5}, 0.2}}),
                           with(Wedge{8, 4, 0.06, 0.03, 1.5}, {SphericalCut{{-2, -2, 2}, 1}}),
                           with(PlanoConvexLens{}, {Stria{{-3, 0, 0}, {3, 0, 0}, 0.4, 0.01}}),
                           with(CylinderLens{}, {Inclusion{{0, 0, 0}, 1, 1.7}}),
                           with(DoubleConvexLens{5, 5, 0, 1.5}),
                           with(SolidPart{drilled, 1.52}),
                           with(SolidPart{across, 1.6}),
                           with(SolidPart{both, 1.6})};
    Plate wavy;
    wavy.waviness = {.wavefront_nm = 900, .period_mm = 1.5, .direction_rad = 0.4, .phase_rad = 1};
    out.push_back(with(wavy, {bubble}));
    Scene lossy =
        with(DoubleConvexLens{}, {bubble, Absorber{{3, 0, 0}, 0.8, false, 0.7}, Absorber{{-3, 0, 0}, 0.8, true}});
    lossy.glass.absorption_per_mm = 0.01;
    lossy.pose.tilt_x_rad = 0.05;
    out.push_back(lossy);
    lossy.effects.fresnel = true;
    out.push_back(lossy);
    return out;
}

TEST(TraceMany, gives_the_bits_of_single_rays_for_every_instruction_set) {
    const auto all = rays();
    int compared = 0, bent = 0, lost = 0;
    for (const Scene& scene : scenes()) {
        const Body body = body_of(scene, true);
        for (const Ghost ghost : {Ghost{}, Ghost{1, 2}}) {
            if (ghost.is_one() && !scene.effects.fresnel) continue;
            std::vector<Arrival> alone;
            for (const CameraRay& ray : all) alone.push_back(trace(body, ray, nullptr, ghost));
            for (const Isa isa : {Isa::portable, Isa::avx2, Isa::avx512}) {
                if (!algo::has(isa)) continue;
                for (const std::size_t first : {std::size_t{0}, std::size_t{3}}) {  // other rays in the same vector
                    std::vector<Arrival> many(all.size());
                    trace_many(body, std::span(all).subspan(first), many.data() + first, ghost, isa);
                    for (std::size_t k = first; k < all.size(); ++k) {
                        ASSERT_TRUE(same_bits(alone[k], many[k])) << "part " << scene.part.index() << ", ray " << k
                                                                  << ", instruction set " << static_cast<int>(isa);
                    }
                    compared += static_cast<int>(all.size() - first);
                }
            }
            for (const Arrival& each : alone)
                bent += each.weight > 0 && each.path != kFreePath, lost += each.weight == 0;
        }
    }
    EXPECT_GT(compared, 100000);
    EXPECT_GT(bent, 30000);
    EXPECT_GT(lost, 1000);
}

TEST(TraceMany, takes_any_number_of_rays) {
    const Body body = body_of(with(DoubleConvexLens{}, {AirBubble{}}), true);
    const auto all = rays();
    for (std::size_t count = 0; count < 40; ++count) {
        std::vector<Arrival> many(count + 1, Arrival{9, 9, 9, 9, 9, 9});
        trace_many(body, std::span(all).first(count), many.data());
        for (std::size_t k = 0; k < count; ++k)
            ASSERT_TRUE(same_bits(trace(body, all[k]), many[k])) << k << " of " << count;
        ASSERT_EQ(many[count].u, 9) << count;  // no write past the last ray
    }
}

}  // namespace
}  // namespace hord::sim
