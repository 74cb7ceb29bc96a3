// The rule of the rim (docs/notes/inspection.md), step by step, on fields drawn as text.
#include "algo/inspection/rim.h"

#include <string>
#include <vector>

#include <gtest/gtest.h>

#include "algo/frame/mask.h"

namespace hord::algo {
namespace {

// '.' free light, 'p' deflected by a bin, '1' to '5' by so many fifths of a bin, 'd' dark, 'z' light that is not
// deflected but inside the part, 'h' half the ring's light less one, 's' saturated.
struct Field {
    Extents extents;
    std::vector<Deflection> deflections;
    std::vector<std::uint32_t> sums;
    std::vector<std::uint8_t> mask;
};

Field field_of(const std::vector<std::string>& rows, double offset_bins = 0) {
    Field f;
    f.extents = {static_cast<int>(rows[0].size()), static_cast<int>(rows.size()), 9, 9};
    for (const std::string& row : rows) {
        for (const char c : row) {
            const double deflected = c == 'p' ? 1 : c >= '1' && c <= '5' ? (c - '0') / 5.0 : 0;
            const double x = c == 'd' ? 0 : deflected + offset_bins;
            f.deflections.push_back({DeflectionQ::from_raw(static_cast<std::int64_t>(x * (1 << 24))), {}});
            f.sums.push_back(c == 'd' ? 0 : c == 'h' ? 99 : 200);
            f.mask.push_back(c == 'd' ? kDark : c == 's' ? kSaturated : kValid);
        }
    }
    return f;
}

// 'o' outside, 'r' rim, 'j' judged.
std::vector<std::string> marked(Field f, int margin) {
    RimFinder finder(f.extents, margin);
    finder.mark(f.deflections, f.sums, f.mask);
    std::vector<std::string> rows;
    for (std::size_t k = 0; k < f.mask.size(); ++k) {
        if (k % static_cast<std::size_t>(f.extents.m) == 0) rows.emplace_back();
        rows.back() += (f.mask[k] & kOutside) != 0 ? 'o' : (f.mask[k] & kRim) != 0 ? 'r' : 'j';
    }
    return rows;
}

using Rows = std::vector<std::string>;

TEST(RimMargin, is_2_at_111_lenslets_and_4_at_555) {
    EXPECT_EQ(default_rim_margin({111, 111, 9, 9}), 2);
    EXPECT_EQ(default_rim_margin({555, 555, 9, 9}), 4);
    EXPECT_EQ(default_rim_margin({555, 111, 9, 9}), 4);
    EXPECT_EQ(default_rim_margin({3, 3, 9, 9}), 2);
}

TEST(Rim, of_a_part_in_the_open_is_its_outline) {
    const Rows expected = {"ooooooooooo", "ooooooooooo", "oorrrrrrroo", "oorjjjjjroo", "oorjjjjjroo",
                           "oorjjjjjroo", "oorrrrrrroo", "ooooooooooo", "ooooooooooo"};
    EXPECT_EQ(marked(field_of({"...........", "...........", "..ppppppp..", "..ppppppp..", "..ppppppp..", "..ppppppp..",
                               "..ppppppp..", "...........", "..........."}),
                     1),
              expected);
    // The middle of a lens does not deflect, a cut is dark, a bubble is disturbed: all are inside and judged.
    EXPECT_EQ(marked(field_of({"...........", "...........", "..ppppppp..", "..pzzzdpp..", "..pzzzddp..", "..pzzzppp..",
                               "..ppppppp..", "...........", "..........."}),
                     1),
              expected);
    // The same for a camera that is off by half a bin.
    EXPECT_EQ(marked(field_of({"...........", "...........", "..ppppppp..", "..ppppppp..", "..ppppppp..", "..ppppppp..",
                               "..ppppppp..", "...........", "..........."},
                              0.5),
                     1),
              expected);
}

TEST(Rim, is_wider_with_a_wider_margin) {
    EXPECT_EQ(
        marked(field_of({".........", ".ppppppp.", ".ppppppp.", ".ppppppp.", ".ppppppp.", ".ppppppp.", "........."}),
               2),
        (Rows{"ooooooooo", "orrrrrrro", "orrrrrrro", "orrjjjrro", "orrrrrrro", "orrrrrrro", "ooooooooo"}));
}

TEST(Rim, without_a_part_is_the_fields_own_border) {
    const Rows expected = {"rrrrrr", "rjjjjr", "rjjjjr", "rjjjjr", "rrrrrr"};
    EXPECT_EQ(marked(field_of({"......", "......", "......", "......", "......"}), 1), expected);
    EXPECT_EQ(marked(field_of({"pppppp", "pppppp", "pppppp", "pppppp", "pppppp"}), 1),
              expected);  // a part that fills the field
    EXPECT_EQ(marked(field_of({"dddddd", "dddddd", "dddddd", "dddddd", "dddddd"}), 1), expected);
    EXPECT_EQ(marked(field_of({"......", "...d..", "......", "......", "......"}), 1),
              expected);  // a region as small as a defect is no part
    const Rows everything(5, "jjjjjj");
    EXPECT_EQ(marked(field_of({"......", "......", "......", "......", "......"}), 0), everything);
}

TEST(Rim, of_a_flat_window_is_followed_along_its_dark_wall_even_through_a_gap_of_two) {
    const Rows expected = {"oooooooooo", "orrrrrrrro", "orjjjjjjro", "orjjjjjjro",
                           "orjjjjjjro", "orjjjjjjro", "orrrrrrrro", "oooooooooo"};
    EXPECT_EQ(marked(field_of({"..........", ".dddddddd.", ".dzzzzzzd.", ".dzzzzzzd.", ".dzzzzzzd.", ".dzzzzzzd.",
                               ".dddddddd.", ".........."}),
                     1),
              expected);
    const auto leaky = marked(field_of({"..........", ".dddddddd.", ".dzzzzzzd.", ".dzzzzzzz.", ".dzzzzzzz.",
                                        ".dzzzzzzd.", ".dddddddd.", ".........."}),
                              1);
    EXPECT_EQ(leaky[3].substr(1, 6), "rjjjjj");
    EXPECT_EQ(leaky[4].substr(1, 6), "rjjjjj");
    const auto half_lit_wall = marked(field_of({"..........", ".hhhhhhhh.", ".hzzzzzzh.", ".hzzzzzzh.", ".hzzzzzzh.",
                                                ".hzzzzzzh.", ".hhhhhhhh.", ".........."}),
                                      1);
    EXPECT_EQ(half_lit_wall, expected);
}

TEST(Rim, leaves_the_undeflected_middle_of_a_cylinder_lens_inside) {
    const auto rows = marked(field_of({"...............", "..54321012345..", "..54321012345..", "..54321012345..",
                                       "..54321012345..", "..54321012345..", "..............."}),
                             0);
    for (std::size_t n = 1; n <= 5; ++n) EXPECT_EQ(rows[n], "oojjjjjjjjjjjoo");
}

// No rim lies between the middle and its sides, and a steep slope beside the middle is no edge: it goes on.
TEST(Rim, has_none_beside_the_undeflected_middle_of_a_cylinder_lens) {
    for (const std::string row : {"..54321012345..", "..pp42...24pp.."}) {
        const auto rows = marked(field_of({"...............", row, row, row, row, row, "..............."}), 1);
        for (std::size_t n = 2; n <= 4; ++n) EXPECT_EQ(rows[n], "oorjjjjjjjjjroo") << row;
    }
}

// From both sides the light jumps to the part: that is no middle, but a slot.
TEST(Rim, leaves_a_slot_in_a_part_outside) {
    const auto rows = marked(field_of({"...............", "..pppp...pppp..", "..pppp...pppp..", "..pppp...pppp..",
                                       "..ppppppppppp..", "..ppppppppppp..", "..............."}),
                             0);
    for (std::size_t n = 1; n <= 3; ++n) EXPECT_EQ(rows[n], "oojjjjooojjjjoo");
    for (std::size_t n = 4; n <= 5; ++n) EXPECT_EQ(rows[n], "oojjjjjjjjjjjoo");
    // Its edges cover lenslets in part; then the light changes no more, or too little, or the other way, or is dark.
    for (const std::string side : {"pp2", "p42d", "p543", "p242", "pd42"}) {
        const std::string mirrored(side.rbegin(), side.rend()), row = ".." + side + "..." + mirrored + "..";
        const std::string free(row.size(), '.'), whole = ".." + std::string(row.size() - 4, 'p') + "..";
        const auto slotted = marked(field_of({free, row, row, row, whole, whole, free}), 0);
        for (std::size_t n = 1; n <= 3; ++n) EXPECT_EQ(slotted[n].substr(2 + side.size(), 3), "ooo") << row;
    }
}

TEST(Rim, of_a_part_that_leaves_the_field_follows_the_fields_border) {
    EXPECT_EQ(
        marked(field_of({".........", "....ppppp", "....ppppp", "....ppppp", "....ppppp", "....ppppp", "........."}),
               1),
        (Rows{"ooooooooo", "oooorrrrr", "oooorjjjr", "oooorjjjr", "oooorjjjr", "oooorrrrr", "ooooooooo"}));
}

TEST(Rim, ignores_dust_beside_the_part_and_light_that_saturates) {
    EXPECT_EQ(marked(field_of({"...........", ".........d.", "..ppppp....", "..ppppp..s.", "..ppppp.s..", "..ppppp....",
                               "..ppppp...d", "...........", "..s........"}),
                     1),
              (Rows{"ooooooooooo", "ooooooooooo", "oorrrrroooo", "oorjjjroooo", "oorjjjroooo", "oorjjjroooo",
                    "oorrrrroooo", "ooooooooooo", "ooooooooooo"}));
}

}  // namespace
}  // namespace hord::algo
