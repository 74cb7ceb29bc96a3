// Regions, positions, reasons and kinds, on maps drawn as text.
#include "algo/inspection/defects.h"

#include <string>
#include <vector>

#include <gtest/gtest.h>

#include "algo/frame/mask.h"

namespace hord::algo {
namespace {

// Each letter is a lenslet: '.' good, 'e' emd 3, 'E' emd 6, 'f' frobenius 2 and emd 4, 't' transmission 0.2, 'b' emd 3
// and transmission 0.2, 'd' dark, 's' saturated, 'r' rim with emd 9, 'o' outside and dark, 'x' border.
struct Maps {
    Extents extents;
    std::vector<float> emd, frobenius, transmission;
    std::vector<std::uint8_t> mask;
    [[nodiscard]] Features features() const { return {emd, frobenius, transmission, mask}; }
};

Maps maps_of(const std::vector<std::string>& rows) {
    Maps maps;
    maps.extents = {static_cast<int>(rows[0].size()), static_cast<int>(rows.size()), 9, 9};
    for (const std::string& row : rows) {
        for (const char c : row) {
            maps.emd.push_back(c == 'e' || c == 'b' ? 3
                                   : c == 'E'       ? 6
                                   : c == 'f'       ? 4
                                   : c == 'r'       ? 9
                                   : c == '.'       ? 0.5F
                                                    : 0);
            maps.frobenius.push_back(c == 'f' ? 2 : 0.1F);
            maps.transmission.push_back(c == 't' || c == 'b' ? 0.2F : c == 'd' || c == 's' || c == 'o' ? 0 : 1);
            maps.mask.push_back(c == 'd'       ? kDark
                                    : c == 's' ? kSaturated
                                    : c == 'r' ? kRim
                                    : c == 'o' ? kOutside | kDark
                                    : c == 'x' ? kBorder
                                               : kValid);
        }
    }
    return maps;
}

struct Found {
    std::vector<Defect> defects;
    Reason reason;
    float score;
};

Recipe limits() {
    Recipe recipe;
    recipe.emd_limit_bins = 2;
    recipe.frobenius_limit_bins = 1;
    recipe.transmission_limit = 0.5F;
    return recipe;
}

Found find(const std::vector<std::string>& rows, const Recipe& recipe = limits()) {
    const Maps maps = maps_of(rows);
    DefectFinder finder(maps.extents, recipe);
    const auto found = finder.find(maps.features());
    EXPECT_TRUE(found);
    return {{found->defects.begin(), found->defects.end()}, found->reason, found->score};
}

TEST(Defects, none_leaves_the_worst_good_value_as_score) {
    const Found found = find({"......", "......", "......"});
    EXPECT_TRUE(found.defects.empty());
    EXPECT_EQ(found.reason, Reason::none);
    EXPECT_FLOAT_EQ(found.score, 0.25F);  // value 0.5, limit 2
}

TEST(Defects, have_a_centroid_an_area_and_a_peak) {
    const Found found = find({"........", ".ee.....", ".eE.....", "........"});
    ASSERT_EQ(found.defects.size(), 1U);
    EXPECT_FLOAT_EQ(found.defects[0].m, 1.5F);
    EXPECT_FLOAT_EQ(found.defects[0].n, 1.5F);
    EXPECT_EQ(found.defects[0].area, 4U);
    EXPECT_EQ(found.defects[0].peak, 6);
    EXPECT_EQ(found.reason, Reason::neighbours_disagree);
    EXPECT_FLOAT_EQ(found.score, 3);
}

TEST(Defects, lit_up_around_an_unlit_middle_are_one_at_the_middle) {
    const Found ring = find({".......", "...e...", "..e.e..", "...e...", "......."});
    ASSERT_EQ(ring.defects.size(), 1U);
    EXPECT_FLOAT_EQ(ring.defects[0].m, 3);
    EXPECT_FLOAT_EQ(ring.defects[0].n, 2);
    EXPECT_EQ(ring.defects[0].area, 4U);
}

TEST(Defects, are_apart_from_two_good_lenslets_between_them_on) {
    EXPECT_EQ(find({"......", ".e.e..", "......"}).defects.size(), 1U);
    EXPECT_EQ(find({".......", ".e...e.", "......."}).defects.size(), 2U);
}

TEST(Defects, come_most_severe_first_and_give_the_reason) {
    const Found found = find({"e.....t.....E", "............."});
    ASSERT_EQ(found.defects.size(), 3U);
    EXPECT_EQ(found.defects[0].m, 12);  // emd 6, limit 2
    EXPECT_EQ(found.defects[1].m, 6);   // 0.8 of the light missing, limit 0.5
    EXPECT_EQ(found.defects[2].m, 0);   // emd 3, limit 2
    EXPECT_EQ(found.reason, Reason::neighbours_disagree);
    EXPECT_EQ(find({"...f...", "......."}).reason, Reason::deflection_gradient);
    EXPECT_EQ(find({"...t...", "......."}).reason, Reason::absorption);
    EXPECT_FLOAT_EQ(find({"...t...", "......."}).defects[0].peak, 0.8F);
}

TEST(Defects, smaller_than_the_least_area_are_none) {
    Recipe recipe = limits();
    recipe.min_area = 3;
    const std::vector<std::string> rows = {"ee.......", ".........", "......eee"};
    EXPECT_EQ(find(rows, recipe).defects.size(), 1U);
    recipe.min_area = 4;
    const Found found = find(rows, recipe);
    EXPECT_TRUE(found.defects.empty());
    EXPECT_LT(found.score, 1);
}

TEST(Defects, dark_lenslets_are_missing_light_and_rim_and_outside_are_not_judged) {
    const Found found = find({"rrrrrrrr", "r......o", "r..dd..o", "rx.....o"});
    ASSERT_EQ(found.defects.size(), 1U);
    EXPECT_EQ(found.reason, Reason::absorption);
    EXPECT_EQ(found.defects[0].area, 2U);
    EXPECT_EQ(found.defects[0].peak, 1);
    EXPECT_TRUE(find({"rrrr", "r..o"}).defects.empty());
}

TEST(Defects, saturated_lenslets_are_not_taken_for_missing_light) {
    EXPECT_TRUE(find({"....", ".ss.", "...."}).defects.empty());
}

TEST(Defects, a_transmission_limit_of_0_switches_missing_light_off) {
    Recipe recipe = limits();
    recipe.transmission_limit = 0;
    EXPECT_TRUE(find({"....", ".td.", "...."}, recipe).defects.empty());
}

TEST(Defects, get_a_kind) {
    EXPECT_EQ(find({"...", ".e.", "..."}).defects[0].kind, DefectKind::scattering);
    EXPECT_EQ(find({"...", ".f.", "..."}).defects[0].kind, DefectKind::surface);
    EXPECT_EQ(find({"...", ".t.", "..."}).defects[0].kind, DefectKind::absorbing);
    EXPECT_EQ(find({"...", ".b.", "..."}).defects[0].kind, DefectKind::unknown);
    EXPECT_EQ(find({"............", ".eeeeeeeeee.", "............"}).defects[0].kind, DefectKind::scratch);
    EXPECT_EQ(find({"b.........", ".b........", "..b.......", "...b......", "....b.....", ".....b....", "......b...",
                    ".......b.."})
                  .defects[0]
                  .kind,
              DefectKind::scratch);
}

}  // namespace
}  // namespace hord::algo
