#include "hal_sim/optics/camera/source_area.h"

#include <cmath>
#include <numeric>
#include <vector>

#include <gtest/gtest.h>

namespace hord::sim {
namespace {

constexpr double kPi = 3.14159265358979323846;

TEST(SourceArea, all_of_a_disc_inside_the_bins_is_found) {
    const algo::Extents e{3, 3, 9, 9};
    for (const double r : {0.05, 0.61, 2.0}) {
        for (const double at : {0.0, 0.5, -1.37}) {
            std::vector<double> bins(81);
            SlopeMap map;
            map.s = at, map.t = 0.3 * at;
            add_source(SlopeGrid::of(e), map, r, {-4.5, 4.5, -4.5, 4.5}, 1, bins.data());
            EXPECT_NEAR(std::accumulate(bins.begin(), bins.end(), 0.0), kPi * r * r, 1e-13) << r << " " << at;
        }
    }
}

TEST(SourceArea, a_centred_disc_is_cut_by_its_bins_in_closed_form) {
    const algo::Extents e{3, 3, 9, 9};
    std::vector<double> bins(81);
    add_source(SlopeGrid::of(e), {}, 0.61, {-4.5, 4.5, -4.5, 4.5}, 1, bins.data());
    const double r = 0.61, h = 0.5;
    const double segment = r * r * std::acos(h / r) - h * std::sqrt(r * r - h * h);
    EXPECT_NEAR(bins[4 * 9 + 4], kPi * r * r - 4 * segment, 1e-14);
    for (const int neighbour : {3 * 9 + 4, 5 * 9 + 4, 4 * 9 + 3, 4 * 9 + 5})
        EXPECT_NEAR(bins[static_cast<std::size_t>(neighbour)], segment, 1e-14);
    EXPECT_NEAR(bins[3 * 9 + 3], 0, 1e-15);
}

TEST(SourceArea, agrees_with_counting_points_for_sheared_turned_and_mirrored_maps) {
    const algo::Extents e{3, 3, 7, 6};  // an odd and an even number of bins
    for (const auto& [a, b, c, d] :
         {std::array{1.1, 0.2, -0.1, 0.9}, {0.0, -1.3, 0.8, 0.1}, {-1.0, 0.05, 0.1, 0.95}, {3.0, 0.4, 0.2, 2.5}}) {
        SlopeMap map{0.4, -0.7, 0.9, 0.6, a, b, c, d};
        const SlopeBox box{-2.2, 3.1, -2.9, 2.05};
        std::vector<double> exact(42), counted(42);
        add_source(SlopeGrid::of(e), map, 1.3, box, 2.0, exact.data());
        constexpr int kPoints = 900;
        for (int y = 0; y < kPoints; ++y) {
            for (int x = 0; x < kPoints; ++x) {
                const double u = box.u0 + (x + 0.5) / kPoints * (box.u1 - box.u0),
                             v = box.v0 + (y + 0.5) / kPoints * (box.v1 - box.v0);
                const double s = map.s + a * (u - map.at_u) + b * (v - map.at_v),
                             t = map.t + c * (u - map.at_u) + d * (v - map.at_v);
                if (s * s + t * t < 1.3 * 1.3) {
                    counted[static_cast<std::size_t>(std::floor(v + 3) * 7 + std::floor(u + 3.5))] +=
                        2.0 * box.area() / kPoints / kPoints;
                }
            }
        }
        // Counting misplaces each of a bin's four edges by up to half a step between points; the disc's own edge
        // averages out.
        const double counting = 2.0 * 4 * 0.5 * (box.u1 - box.u0) / kPoints;
        for (std::size_t k = 0; k < exact.size(); ++k) EXPECT_NEAR(exact[k], counted[k], counting) << k;
    }
}

}  // namespace
}  // namespace hord::sim
