#include "algo/recipe/zones.h"

#include <cmath>
#include <limits>
#include <string>
#include <vector>

#include <gtest/gtest.h>

#include "algo/frame/mask.h"

namespace hord::algo {
namespace {

constexpr Extents kField{7, 5, 9, 9};

Zone circle(Zone::Use use, Point centre, float radius) {
    Zone zone;
    zone.use = use;
    zone.centre = centre;
    zone.radius = radius;
    return zone;
}

Zone polygon(Zone::Use use, std::vector<Point> corners) {
    Zone zone;
    zone.shape = Zone::Shape::polygon;
    zone.use = use;
    zone.corners = std::move(corners);
    return zone;
}

std::vector<std::string> painted(const std::vector<Zone>& zones, float lenslet_mm = 0) {
    std::vector<std::uint8_t> mask(kField.lenslets(), 255);
    paint_zones(zones, kField, mask, lenslet_mm);
    std::vector<std::string> rows;
    for (std::size_t k = 0; k < mask.size(); ++k) {
        if (k % 7 == 0) rows.emplace_back();
        rows.back() += mask[k] == kOutside ? '.' : mask[k] == kValid ? '#' : '?';
    }
    return rows;
}

using Rows = std::vector<std::string>;
using Use = Zone::Use;

TEST(Zones, none_means_everywhere) { EXPECT_EQ(painted({}), Rows(5, "#######")); }

TEST(Zones, a_circle_includes_its_edge) {
    EXPECT_EQ(painted({circle(Use::inspect, {3, 2}, 2)}),
              (Rows{"...#...", "..###..", ".#####.", "..###..", "...#..."}));
}

// 7 x 5 lenslets of 0.5 mm: lenslet (3, 2) is the middle.
TEST(Zones, in_mm_count_from_the_middle_of_the_field_to_the_right_and_down) {
    Zone zone = circle(Use::inspect, {0, 0}, 1);
    zone.unit = Zone::Unit::mm;
    EXPECT_EQ(painted({zone}, 0.5F), (Rows{"...#...", "..###..", ".#####.", "..###..", "...#..."}));
    zone.centre = {1, -0.5F};  // two lenslets to the right, one up
    zone.radius = 0.1F;
    EXPECT_EQ(painted({zone}, 0.5F), (Rows{".......", ".....#.", ".......", ".......", "......."}));
    Zone corner = polygon(Use::ignore, {{-2, -2}, {-0.75F, -2}, {-0.75F, 0.25F}, {-2, 0.25F}});
    corner.unit = Zone::Unit::mm;
    EXPECT_EQ(painted({corner}, 0.5F), (Rows{"..#####", "..#####", "..#####", "#######", "#######"}));
}

TEST(Zones, in_mm_of_a_field_with_an_even_number_of_lenslets_count_from_between_them) {
    std::vector<std::uint8_t> mask(16);
    Zone zone = circle(Use::inspect, {0, 0}, 0.15F);
    zone.unit = Zone::Unit::mm;
    paint_zones(std::vector{zone}, {4, 4, 9, 9}, mask, 0.2F);
    for (std::size_t k = 0; k < mask.size(); ++k)
        EXPECT_EQ(mask[k] == kValid, k == 5 || k == 6 || k == 9 || k == 10) << k;
}

TEST(Zones, that_cannot_be_placed_are_named) {
    Recipe recipe;
    recipe.zones = {circle(Use::ignore, {0, 0}, 1)};
    recipe.zones[0].unit = Zone::Unit::mm;
    ASSERT_EQ(problems(recipe, kField).size(), 1U);
    EXPECT_NE(problems(recipe, kField)[0].find("zone[0]: is in mm, and the size of a lenslet is not known"),
              std::string::npos);
    recipe.lenslet_mm = 0.2F;
    EXPECT_TRUE(problems(recipe, kField).empty());
    recipe.zones.push_back(circle(Use::ignore, {3, 3}, 1));
    ASSERT_EQ(problems(recipe, kField).size(), 1U);
    EXPECT_NE(problems(recipe, kField)[0].find("some zones are in lenslets and some in mm"), std::string::npos);
}

TEST(Zones, ignore_wins_over_inspect_and_alone_takes_from_everywhere) {
    EXPECT_EQ(painted({circle(Use::inspect, {3, 2}, 2), circle(Use::ignore, {3, 2}, 1)}),
              (Rows{"...#...", "..#.#..", ".#...#.", "..#.#..", "...#..."}));
    EXPECT_EQ(painted({circle(Use::ignore, {0, 0}, 1)}), (Rows{"..#####", ".######", "#######", "#######", "#######"}));
}

TEST(Zones, polygons_may_be_concave_and_are_unions_with_others) {
    EXPECT_EQ(painted({polygon(Use::inspect,
                               {{0.5F, 0.5F}, {5.5F, 0.5F}, {5.5F, 3.5F}, {3.5F, 3.5F}, {3.5F, 1.5F}, {0.5F, 1.5F}})}),
              (Rows{".......", ".#####.", "....##.", "....##.", "......."}));
    EXPECT_EQ(painted({polygon(Use::inspect, {{-1, -1}, {2.5F, -1}, {2.5F, 9}, {-1, 9}}),
                       circle(Use::inspect, {6, 4}, 0.5F)}),
              (Rows{"###....", "###....", "###....", "###....", "###...#"}));
}

TEST(Zones, neighbouring_polygons_share_no_lenslet_and_leave_none_out) {
    const Zone left = polygon(Use::inspect, {{0, 0}, {3, 0}, {3, 4}, {0, 4}}),
               right = polygon(Use::inspect, {{3, 0}, {6, 0}, {6, 4}, {3, 4}});
    for (int n = 0; n < 4; ++n) {
        for (int m = 0; m < 6; ++m) {
            const auto x = static_cast<float>(m), y = static_cast<float>(n);
            EXPECT_NE(left.contains(x, y), right.contains(x, y)) << m << ", " << n;
        }
    }
}

TEST(Zones, problems_name_the_zone) {
    Recipe recipe;
    EXPECT_TRUE(problems(recipe, kField).empty());
    recipe.zones = {circle(Use::inspect, {0, 0}, 0), polygon(Use::ignore, {{0, 0}, {1, 1}}),
                    circle(Use::inspect, {std::numeric_limits<float>::quiet_NaN(), 0}, 1),
                    circle(Use::inspect, {0, 0}, 1)};
    const std::vector<std::string> lines = problems(recipe, kField);
    ASSERT_EQ(lines.size(), 3U);
    EXPECT_EQ(lines[0].find("zone[0]: "), 0U);
    EXPECT_EQ(lines[1].find("zone[1]: "), 0U);
    EXPECT_EQ(lines[2].find("zone[2]: "), 0U);
}

TEST(Zones, problems_name_a_zone_that_holds_no_lenslet_of_the_field) {
    Recipe recipe;
    recipe.lenslet_mm = 0.5F;
    Zone outside_mm = circle(Use::inspect, {0, 3}, 1.5F), inside_mm = circle(Use::inspect, {1, 1}, 0.5F);
    outside_mm.unit = inside_mm.unit = Zone::Unit::mm;
    // The field has 7 x 5 lenslets: 0 to 6 and 0 to 4, or -1.5 to 1.5 mm and -1 to 1 mm.
    for (const Zone& zone : {circle(Use::inspect, {9, 2}, 2.5F), circle(Use::ignore, {3, -4}, 3.5F),
                             polygon(Use::inspect, {{6.1F, 0}, {9, 0}, {9, 4}}), outside_mm}) {
        recipe.zones = {zone};
        const auto lines = problems(recipe, kField);
        ASSERT_EQ(lines.size(), 1U);
        EXPECT_EQ(lines[0], "zone[0]: lies outside the field of 7x5 lenslets: move it into the field, or leave it out");
    }
    for (const Zone& zone :
         {circle(Use::inspect, {9, 2}, 3), polygon(Use::ignore, {{6, 0}, {9, 0}, {9, 4}}), inside_mm}) {
        recipe.zones = {zone};
        EXPECT_TRUE(problems(recipe, kField).empty());
    }
}

}  // namespace
}  // namespace hord::algo
