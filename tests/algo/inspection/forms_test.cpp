// Forms of parts (docs/notes/inspection.md): what is part, flank and field, on fields drawn as text; what the recipe's
// notes say.
#include <algorithm>
#include <array>
#include <cmath>
#include <cstdlib>
#include <functional>
#include <string>
#include <string_view>
#include <vector>

#include <gtest/gtest.h>

#include "algo/frame/mask.h"
#include "algo/inspection/pipeline.h"
#include "algo/inspection/rim.h"
#include "algo/recipe/recipe.h"
#include "algo/reference/reference.h"
#include "tests/support/counted_heap.h"
#include "tests/support/frames.h"

namespace hord::algo {
namespace {

using namespace hord::algo::testing;
using Rows = std::vector<std::string>;

// '.' free light, 'p' deflected by a bin, '+' and '-' by 0.8 bin to either side, 'd' dark, 'h' with a third of the
// light, 'q' with 120 of 200, 'g' with 196, 'b' with 198.
struct Marked {
    Rows rows;  // 'o' outside, 'r' rim, 'j' judged
    FoundPart found;
};

Marked marked(const Rows& drawing, PartForm form, int margin = 1, float steepest = 0) {
    const Extents e{static_cast<int>(drawing[0].size()), static_cast<int>(drawing.size()), 9, 9};
    std::vector<Deflection> deflections;
    std::vector<std::uint32_t> sums;
    std::vector<std::uint8_t> mask;
    for (const std::string& row : drawing) {
        for (const char c : row) {
            const double x = c == 'p' ? 1 : c == '+' ? 0.8 : c == '-' ? -0.8 : 0;
            deflections.push_back({DeflectionQ::from_raw(static_cast<std::int64_t>(x * (1 << 24))), {}});
            const std::string_view letters = "dhqgb";
            constexpr std::array<std::uint32_t, 6> light{0, 66, 120, 196, 198, 200};
            sums.push_back(light.at(std::min(letters.find(c), letters.size())));
            mask.push_back(c == 'd' ? kDark : kValid);
        }
    }
    RimFinder finder(e, margin, form, steepest);
    finder.mark(deflections, sums, mask);
    Marked result{{}, finder.found()};
    for (std::size_t k = 0; k < mask.size(); ++k) {
        if (k % static_cast<std::size_t>(e.m) == 0) result.rows.emplace_back();
        result.rows.back() += (mask[k] & kOutside) != 0 ? 'o' : (mask[k] & kRim) != 0 ? 'r' : 'j';
    }
    return result;
}

Rows turned(const Rows& rows) {
    Rows out(rows[0].size(), std::string(rows.size(), ' '));
    for (std::size_t n = 0; n < rows.size(); ++n) {
        for (std::size_t m = 0; m < rows[n].size(); ++m) out[m][n] = rows[n][m];
    }
    return out;
}

Rows repeated(const std::string& row, std::size_t times) { return Rows(times, row); }

Rows joined(std::initializer_list<Rows> blocks) {
    Rows all;
    for (const Rows& block : blocks) all.insert(all.end(), block.begin(), block.end());
    return all;
}

TEST(Tube, is_judged_between_its_flanks_along_either_axis_though_its_band_shows_free_light) {
    const Rows drawing = joined({repeated("....................", 2), repeated("...d............d...", 12),
                                 repeated("....................", 2)});
    const Rows expected = joined({repeated("oooooooooooooooooooo", 2), repeated("ooorrrrrrrrrrrrrrooo", 2),
                                  repeated("ooorrjjjjjjjjjjrrooo", 8), repeated("ooorrrrrrrrrrrrrrooo", 2),
                                  repeated("oooooooooooooooooooo", 2)});
    const Marked tube = marked(drawing, PartForm::tube);
    EXPECT_EQ(tube.rows, expected);
    EXPECT_EQ(tube.found.parts, 1);
    EXPECT_EQ(tube.found.at_border, 0U);
    EXPECT_TRUE(tube.found.free_light);
    EXPECT_EQ(marked(turned(drawing), PartForm::tube).rows, turned(expected));
    // By the rule for round parts each flank is too small to be a part: the whole field is judged, the flanks too.
    EXPECT_EQ(marked(drawing, PartForm::round).rows[8], "rjjjjjjjjjjjjjjjjjjr");
}

TEST(Tube, may_leave_the_field_at_both_ends) {
    const Marked tube = marked(repeated("....dd..........dd....", 14), PartForm::tube);
    EXPECT_EQ(tube.rows[0], "oooorrrrrrrrrrrrrroooo");
    for (std::size_t n = 1; n < 13; ++n) EXPECT_EQ(tube.rows[n], "oooorrrjjjjjjjjrrroooo");
    EXPECT_EQ(tube.found.at_border, 28U);
}

TEST(Tube, keeps_what_reaches_out_of_a_flank_and_what_crosses_the_band_judged) {
    Rows drawing = repeated("....dd..........dd....", 18);
    drawing[5] = "....ddddddd.....dd....";   // a tongue from a flank
    drawing[9] = "....dddddddddddddd....";   // across the band
    drawing[12] = "....dd..........ddd...";  // dirt outside
    drawing[13] = "....d...........dd....";  // a flank that is thinner
    drawing[15] = "................dd....";  // a gap of one lenslet
    const Marked tube = marked(drawing, PartForm::tube);
    for (const std::size_t n : {5U, 9U, 13U, 15U}) EXPECT_EQ(tube.rows[n], "oooorrrjjjjjjjjrrroooo") << n;
    EXPECT_EQ(tube.rows[12], "oooorrrjjjjjjjjrrrrooo");
}

// What lies beyond the ends is not judged.
TEST(Tube, with_a_neck_and_a_flange_keeps_its_edges_and_ends) {
    Rows drawing = repeated("....dd..........dd....", 26);
    drawing[0] = drawing[1] = drawing[2] = "........dd..dd........";
    drawing[24] = drawing[25] = ".dddddddddddddddddddd.";
    const Marked tube = marked(drawing, PartForm::tube);
    EXPECT_EQ(tube.rows[12], "oooorrrjjjjjjjjrrroooo");
    EXPECT_EQ(tube.rows[2], "oooooooorrrrrroooooooo");
    EXPECT_EQ(tube.rows[4], "oooorrrrrrrrrrrrrroooo");
    EXPECT_EQ(tube.rows[5], "oooorrrjjjjjjjjrrroooo");
    EXPECT_EQ(tube.rows[21], "oooorrrjjjjjjjjrrroooo");
    EXPECT_EQ(tube.rows[25], "orrrrrrrrrrrrrrrrrrrro");
}

// A dark corner hides one edge at an end: the other edge shows where the tube ends.
TEST(Tube, with_a_dark_corner_is_judged_there) {
    Rows drawing = joined({repeated("......................", 4), repeated("....dd..........dd....", 26),
                           repeated("......................", 4)});
    for (std::size_t n = 0; n < 9; ++n) drawing[n].replace(0, 11, "ddddddddddd");
    for (const Rows& rows :
         {marked(drawing, PartForm::tube).rows, turned(marked(turned(drawing), PartForm::tube).rows)}) {
        for (std::size_t n = 6; n < 28; ++n) EXPECT_EQ(rows[n].substr(7, 8), "jjjjjjjj") << n;
    }
}

TEST(Tube, is_found_by_flanks_that_are_broken_into_pieces) {
    Rows drawing = repeated("....dd..........dd....", 24);
    for (const std::size_t n : {7U, 8U, 9U, 10U, 15U, 16U, 17U}) drawing[n] = "................dd....";
    const Marked tube = marked(drawing, PartForm::tube);
    for (std::size_t n = 1; n < 23; ++n) EXPECT_EQ(tube.rows[n].substr(7, 8), "jjjjjjjj") << n;
}

TEST(Tube, that_lies_askew_is_followed) {
    Rows drawing;
    for (std::size_t n = 0; n < 30; ++n) {
        std::string row(34, '.');
        const std::size_t at = 6 + n / 4;
        row[at] = row[at + 1] = row[at + 14] = row[at + 15] = 'd';
        drawing.push_back(row);
    }
    for (const Rows& rows :
         {marked(drawing, PartForm::tube).rows, turned(marked(turned(drawing), PartForm::tube).rows)}) {
        for (std::size_t n = 2; n < 28; ++n) {
            const std::size_t at = 6 + n / 4;
            EXPECT_EQ(rows[n].substr(0, at - 1).find_first_not_of('o'), std::string::npos) << n << ": " << rows[n];
            EXPECT_EQ(rows[n].substr(at, 2), "rr") << n << ": " << rows[n];
            EXPECT_EQ(rows[n].substr(at + 4, 8), "jjjjjjjj") << n << ": " << rows[n];
            EXPECT_EQ(rows[n].substr(at + 14, 2), "rr") << n << ": " << rows[n];
        }
    }
}

// The edges step by a lenslet once in 60 lines: most places that are half of the field apart show no slope. The outline
// follows the step to two lines; by the medians alone it follows 45 lines.
TEST(Tube, that_lies_a_little_askew_is_followed_to_a_lenslet) {
    Rows drawing;
    const auto edge = [](std::size_t n) { return 6 + (n + 15) / 60; };
    for (std::size_t n = 0; n < 60; ++n) {
        std::string row(34, '.');
        row[edge(n)] = row[edge(n) + 1] = row[edge(n) + 14] = row[edge(n) + 15] = 'd';
        drawing.push_back(row);
    }
    const Marked tube = marked(drawing, PartForm::tube);
    int followed = 0;
    for (std::size_t n = 0; n < 60; ++n) followed += tube.rows[n].find_first_not_of('o') == edge(n) ? 1 : 0;
    EXPECT_GE(followed, 58);
    EXPECT_GT(tube.found.sharp_outline, 0.9);
}

// The band's last lenslets before a flank lose light or are steep: they are flank. A band that is steep all over is
// not.
TEST(Tube, has_flanks_up_to_where_the_light_and_the_slope_are_those_of_the_band) {
    const Marked dim = marked(repeated("....dh..........hd....", 14), PartForm::tube);
    EXPECT_EQ(dim.rows[7], "oooorrrjjjjjjjjrrroooo");
    const Rows steep = repeated("....d-+..........-+d....", 14);
    EXPECT_EQ(marked(steep, PartForm::tube, 1, 0.3F).rows[7], "oooorrrrrjjjjjjrrrrroooo");
    EXPECT_EQ(marked(steep, PartForm::tube, 1, 0).rows[7], "oooorrjjjjjjjjjjjjrroooo");
    const Rows all_steep = repeated("....d--++--++--++--d....", 14);
    EXPECT_EQ(marked(all_steep, PartForm::tube, 1, 0.1F).rows[7], marked(all_steep, PartForm::tube, 1, 0).rows[7]);
}

// What is dark along the whole length is no flank if the other side has none like it.
TEST(Tube, has_flanks_alike_on_both_sides) {
    EXPECT_EQ(marked(repeated("....dd..............dd....", 14), PartForm::tube).rows[7], "oooorrrjjjjjjjjjjjjrrroooo");
    EXPECT_EQ(marked(repeated("....dddddddddd......dd....", 14), PartForm::tube).rows[7], "oooorrrrrjjjjjjjjjjrrroooo");
}

TEST(Tube, without_a_band_has_nothing_to_judge_and_one_flank_is_no_tube) {
    for (const std::string& row : marked(repeated("....dddddddddddddd....", 14), PartForm::tube).rows)
        EXPECT_EQ(row, "oooorrrrrrrrrrrrrroooo");
    for (const std::string& row : marked(repeated("..........ddd.........", 14), PartForm::tube).rows)
        EXPECT_EQ(row.find('j'), std::string::npos) << row;
    const Marked empty = marked(repeated("......................", 14), PartForm::tube);
    EXPECT_EQ(empty.found.parts, 0);
    EXPECT_EQ(empty.rows[7], "rjjjjjjjjjjjjjjjjjjjjr");
}

TEST(Tube, that_fills_the_field_is_seen_by_its_flanks) {
    const Rows drawing = repeated("dddppppppppppppppppddd", 14);
    EXPECT_EQ(marked(turned(drawing), PartForm::tube).found.parts, 1);
    const Marked tube = marked(drawing, PartForm::tube);
    EXPECT_EQ(tube.rows[7], "rrrrjjjjjjjjjjjjjjrrrr");
    EXPECT_EQ(tube.found.parts, 1);
    EXPECT_FALSE(tube.found.free_light);
    EXPECT_EQ(marked(repeated("pppppppppppppppppppppp", 14), PartForm::tube).found.parts, 0);
}

// Free light is seen on two sides only: the tube covers more than half of the outermost lenslets.
TEST(Tube, may_cover_most_of_the_fields_border) {
    const Rows drawing = repeated("..dddppppppppppppppddd..", 8);
    for (const Marked& tube : {marked(drawing, PartForm::tube), marked(turned(drawing), PartForm::tube)}) {
        EXPECT_TRUE(tube.found.free_light);
        EXPECT_EQ(tube.found.parts, 1);
    }
    EXPECT_EQ(marked(drawing, PartForm::tube).rows[4], "oorrrrjjjjjjjjjjjjrrrroo");
    EXPECT_EQ(marked(drawing, PartForm::round).found.free_light, false);
}

// No form allocates after set-up.
TEST(Form, of_any_kind_is_found_without_allocating) {
    const Extents e{60, 50, 9, 9};
    std::vector<Deflection> deflections(e.lenslets());
    std::vector<std::uint32_t> sums(e.lenslets(), 100);
    std::vector<std::uint8_t> dark(e.lenslets()), mask;
    for (int n = 5; n < 45; ++n) {
        for (const int m : {10, 11, 48, 49}) dark[e.index(m, n)] = kDark;
        if (n == 5 || n == 44) {
            for (int m = 10; m < 50; ++m) dark[e.index(m, n)] = kDark;
        }
    }
    for (const PartForm form : {PartForm::round, PartForm::tube, PartForm::plate, PartForm::web}) {
        RimFinder finder(e, 2, form, 0.3F);
        mask = dark;
        EXPECT_EQ(test::allocated_by([&] { finder.mark(deflections, sums, mask); }), 0U) << static_cast<int>(form);
        EXPECT_EQ(finder.found().parts, form == PartForm::web ? 0 : 1) << static_cast<int>(form);
    }
}

// A field of 16 x 12 lenslets with what is drawn at (left, top).
Rows in_field(const Rows& part, int left, int top) {
    Rows field(12, std::string(16, '.'));
    for (std::size_t n = 0; n < part.size(); ++n)
        field[static_cast<std::size_t>(top) + n].replace(static_cast<std::size_t>(left), part[n].size(), part[n]);
    return field;
}
FoundPart found_in(const Rows& part, int left = 4, int top = 3) {
    return marked(in_field(part, left, top), PartForm::round).found;
}

TEST(FoundPart, is_described_by_its_outline) {
    const FoundPart whole = found_in(Rows(6, "pppppppp"));
    EXPECT_TRUE(whole.free_light);
    EXPECT_EQ(whole.parts, 1);
    EXPECT_EQ(whole.area, 48U);
    EXPECT_EQ(whole.at_border, 0U);
    for (const double one : {whole.sharp_outline, whole.free_beside, whole.symmetry, whole.convexity, whole.deflecting})
        EXPECT_EQ(one, 1);
    EXPECT_EQ(found_in(Rows(6, "pppppppp"), 0, 3).at_border, 6U);
    EXPECT_EQ(found_in(Rows(6, "pppppppp"), 4, 6).at_border, 8U);
    // A corner of 4 x 3 is missing: 36 lenslets, and no centre about which more than 24 of them meet their own images.
    const FoundPart corner = found_in({"pppp", "pppp", "pppp", "pppppppp", "pppppppp", "pppppppp"});
    EXPECT_EQ(corner.area, 36U);
    EXPECT_LT(corner.symmetry, 0.75);
    EXPECT_NEAR(corner.convexity, 36.0 / 39, 1e-9);
    // A plus of 20 lenslets in a hull of 32: symmetric, and not convex.
    const FoundPart plus = found_in({"..pp..", "..pp..", "pppppp", "pppppp", "..pp..", "..pp.."});
    EXPECT_EQ(plus.area, 20U);
    EXPECT_EQ(plus.symmetry, 1);
    EXPECT_EQ(plus.convexity, 20.0 / 24);
}

TEST(FoundPart, has_a_sharp_outline_where_light_jumps) {
    for (const std::string row : {"pppppppp", "hhhhhhhh", "dddddddd"})
        EXPECT_EQ(found_in(Rows(6, row)).sharp_outline, 1);
}

TEST(FoundPart, knows_how_much_of_its_inside_deflects_light) {
    const auto inside = [](const std::string& middle) {
        const std::string row = "pp" + middle + "pp";
        return found_in({"pppppppp", "pppppppp", row, row, "pppppppp", "pppppppp"}).deflecting;
    };
    EXPECT_EQ(inside("pppp"), 1);
    EXPECT_EQ(inside("dddd"), 1);
    EXPECT_NEAR(inside("...."), 1 - 8.0 / 24, 1e-9);
    EXPECT_NEAR(inside("hhhh"), 1 - 8.0 / 24, 1e-9);  // dim, and not deflected
    EXPECT_NEAR(inside("..hp"), 1 - 6.0 / 24, 1e-9);
}

TEST(FoundPart, has_free_light_beside_it) {
    Rows field = in_field(Rows(6, "pppppp"), 5, 3);
    field[5][0] = 'd';
    EXPECT_NEAR(marked(field, PartForm::round).found.free_beside, 9.0 / 10, 1e-9);
    field[5][15] = 'd';
    EXPECT_NEAR(marked(field, PartForm::round).found.free_beside, 8.0 / 10, 1e-9);
    Rows column = in_field(Rows(6, "pppppp"), 5, 3);
    column[0][6] = 'd';
    // Of its row; its column has six lenslets beside the part, too few to tell.
    EXPECT_NEAR(marked(column, PartForm::round).found.free_beside, 15.0 / 16, 1e-9);
}

TEST(FoundPart, counts_parts_across_whose_gap_the_light_jumps) {
    EXPECT_EQ(found_in(Rows(6, "ppp....ppp"), 3).parts, 2);
    EXPECT_EQ(found_in(Rows(6, "ddd....ddd"), 3).parts, 2);
}

TEST(Plate, is_what_its_edges_enclose_though_they_have_gaps) {
    const Rows whole = {"..............", "..............", "..dddddddddd..", "..d........d..", "..d........d..",
                        "..d........d..", "..d........d..", "..dddddddddd..", "..............", ".............."};
    const Rows expected = {"oooooooooooooo", "oooooooooooooo", "oorrrrrrrrrroo", "oorjjjjjjjjroo", "oorjjjjjjjjroo",
                           "oorjjjjjjjjroo", "oorjjjjjjjjroo", "oorrrrrrrrrroo", "oooooooooooooo", "oooooooooooooo"};
    EXPECT_EQ(marked(whole, PartForm::plate).rows, expected);
    EXPECT_EQ(marked(whole, PartForm::plate).found.parts, 1);
    Rows gaps = whole;
    gaps[4] = gaps[5] = "...........d..";
    gaps[6] = "..........dd..";
    gaps[2] = "..ddd...dddd..";
    gaps[4][6] = 'd';  // a speck on the plate
    const Marked open = marked(gaps, PartForm::plate);
    EXPECT_EQ(open.rows, expected);
    EXPECT_EQ(open.found.parts, 1);
}

// A triangle is missing at a corner: the hull of what is left is convex. A small one is within the outline's error.
TEST(Plate, tells_that_its_outline_lacks_a_corner) {
    const auto without_corner = [](int corner, int left) {
        Rows drawing(24, std::string(28, '.'));
        for (int n = 3; n < 21; ++n) {
            for (int m = left; m < 25; ++m) {
                const bool gone = m - left + n - 3 < corner,
                           at_edge = n == 3 || n == 20 || m == left || m == 24 || m - left + n - 3 == corner;
                if (!gone && at_edge) drawing[static_cast<std::size_t>(n)][static_cast<std::size_t>(m)] = 'd';
            }
        }
        return marked(drawing, PartForm::plate).found;
    };
    EXPECT_FALSE(without_corner(0, 3).lacks_place);
    EXPECT_FALSE(without_corner(3, 3).lacks_place);
    EXPECT_TRUE(without_corner(8, 3).lacks_place);
    EXPECT_FALSE(without_corner(8, 0).lacks_place);  // the field cuts it
}

TEST(Plate, may_leave_the_field_on_one_or_two_sides) {
    const Rows right = {"..............", "..............", "..dddddddddddd", "..d...........", "..d...........",
                        "..d...........", "..d...........", "..dddddddddddd", "..............", ".............."};
    const Marked one = marked(right, PartForm::plate);
    EXPECT_EQ(one.rows[2], "oorrrrrrrrrrrr");
    for (std::size_t n = 3; n < 7; ++n) EXPECT_EQ(one.rows[n], "oorjjjjjjjjjjr");
    EXPECT_EQ(one.found.at_border, 6U);
    EXPECT_EQ(one.found.cut, 1);
    Rows corner = right;
    corner[7] = corner[8] = corner[9] = corner[3];
    for (const bool upside_down : {false, true}) {
        Rows drawing = corner;
        if (upside_down) std::ranges::reverse(drawing);
        const Marked cut = marked(drawing, PartForm::plate);
        EXPECT_GT(cut.found.cut, 1);
        Rows rows = cut.rows;
        if (upside_down) std::ranges::reverse(rows);
        EXPECT_EQ(rows[1], "oooooooooooooo");
        EXPECT_EQ(rows[2], "oorrrrrrrrrrrr");
        for (std::size_t n = 3; n < 9; ++n) EXPECT_EQ(rows[n], "oorjjjjjjjjjjr");
    }
    const Marked strip = marked({"..............", "..............", "dddddddddddddd", "..............",
                                 "..............", "..............", "dddddddddddddd", ".............."},
                                PartForm::plate);
    EXPECT_EQ(strip.rows[4], "rjjjjjjjjjjjjr");
    EXPECT_EQ(strip.rows[0], "oooooooooooooo");
    EXPECT_EQ(strip.found.cut, 0);
}

// Dirt beside the plate, and a plate of which one edge is seen: it could lie on either side.
TEST(Plate, is_not_found_by_dust_or_by_one_edge) {
    Rows drawing = repeated("..............", 16);
    EXPECT_EQ(marked(drawing, PartForm::plate).found.parts, 0);
    drawing[3][2] = drawing[8][11] = 'd';
    EXPECT_EQ(marked(drawing, PartForm::plate).rows[7], "rjjjjjjjjjjjjr");
    for (std::string& row : drawing) row[6] = 'd';
    const Marked edge = marked(drawing, PartForm::plate);
    EXPECT_EQ(edge.found.parts, 0);
    EXPECT_EQ(edge.rows[7], "rjjjjjjjjjjjjr");
}

TEST(Web, is_judged_everywhere_and_has_a_rim_only_if_the_recipe_says_so) {
    const Rows drawing = {"pp......", "pppd....", "pppp....", "pppp....", "....dd..", "....dddd"};
    for (const std::string& row : marked(drawing, PartForm::web, 0).rows) EXPECT_EQ(row, "jjjjjjjj");
    EXPECT_EQ(marked(drawing, PartForm::web, 1).rows,
              (Rows{"rrrrrrrr", "rjjjjjjr", "rjjjjjjr", "rjjjjjjr", "rjjjjjjr", "rrrrrrrr"}));
    Recipe recipe;
    recipe.form = PartForm::web;
    const Extents e{20, 20, 9, 9};
    std::vector<Deflection> deflections(e.lenslets());
    const std::vector<std::uint32_t> sums(e.lenslets(), 100);
    std::vector<std::uint8_t> mask(e.lenslets());
    RimFinder::of(recipe, e).mark(deflections, sums, mask);
    EXPECT_EQ(std::ranges::count(mask, kValid), 400);
}

Verdict verdict_on(const Frame& frame, const Extents& e, const Recipe& recipe) {
    auto pipeline = Pipeline::create(e, frame.bits(), recipe);
    EXPECT_TRUE(pipeline) << pipeline.error().message();
    const auto seen = pipeline->inspect(frame.view());
    EXPECT_TRUE(seen);
    return seen->verdict;
}

// A smaller part beside the part: what lets light through. Dust is opaque, or below a 64th of the part.
TEST(Parts, that_are_smaller_count_and_dust_does_not) {
    Rows lens = repeated("........................................", 24);
    for (std::size_t n = 3; n < 21; ++n) lens[n].replace(3, 18, 18, 'p');
    const auto with = [&](std::size_t size, char what, std::size_t m = 30) {
        Rows rows = lens;
        for (std::size_t n = 8; n < 8 + size; ++n) rows[n].replace(m, size, size, what);
        return marked(rows, PartForm::round).found;
    };
    EXPECT_EQ(marked(lens, PartForm::round).found.islands, 0);
    for (const std::size_t size : {3U, 4U, 6U, 7U}) {  // 8: a region of 1/16 of the field
        EXPECT_EQ(with(size, 'p').islands, 1) << size;
        EXPECT_EQ(with(size, '+', 40 - size).islands, 1) << size;  // cut by the border
        EXPECT_EQ(with(size, 'd').islands, 0) << size;             // opaque
    }
    EXPECT_EQ(with(2, 'p').islands, 0);  // 4 of 324 lenslets
    // Two plates: the hull of both encloses the field between them.
    for (const std::size_t size : {4U, 6U, 8U}) {
        Rows plates = lens;
        for (std::size_t n = 4; n < 20; ++n) plates[n].replace(4, 16, 16, '.');
        for (std::size_t n = 3; n < 21; ++n) plates[n][3] = plates[n][20] = 'd';
        plates[3].replace(3, 18, 18, 'd'), plates[20].replace(3, 18, 18, 'd');
        EXPECT_EQ(marked(plates, PartForm::plate).found.islands, 0);
        for (std::size_t n = 8; n < 8 + size; ++n) plates[n].replace(28, size, size, 'd');
        for (std::size_t n = 9; n < 7 + size; ++n) plates[n].replace(29, size - 2, size - 2, '.');
        EXPECT_EQ(marked(plates, PartForm::plate).found.islands, 1) << size;
    }
}

// A corner is missing: the hull encloses half of it, and dust that lies there is outside as the free light around it
// is.
TEST(Parts, that_lack_a_corner_do_not_enclose_dust_that_lies_there) {
    Rows rows = repeated("..............................", 30);
    for (std::size_t n = 3; n < 27; ++n) rows[n].replace(3, n < 17 ? 10 : 24, n < 17 ? 10 : 24, 'p');
    for (std::size_t n = 10; n < 14; ++n) rows[n].replace(16, 4, 4, 'd');
    const Marked part = marked(rows, PartForm::round);
    EXPECT_EQ(part.rows[11], "ooorjjjjjjjjr" + std::string(17, 'o'));
    EXPECT_EQ(part.rows[20], "ooor" + std::string(22, 'j') + "rooo");
}

// A plate with dark edges in a field with `beside` lenslets of free light on all sides, filled by `row`.
Rows plate_of(const std::string& row, std::size_t rows, std::size_t beside) {
    const std::size_t columns = row.size() + 2 + 2 * beside;
    const Rows outside = repeated(std::string(columns, '.'), beside);
    const auto line = [&](const std::string& of_plate) {
        return std::string(beside, '.') + of_plate + std::string(beside, '.');
    };
    const Rows edge = {line(std::string(row.size() + 2, 'd'))};
    return joined({outside, edge, repeated(line("d" + row + "d"), rows), edge, outside});
}

TEST(Plate, tells_at_how_many_steps_across_its_edges_light_is_lost) {
    const auto shaded = [](const Rows& drawing) { return marked(drawing, PartForm::plate).found.shaded; };
    EXPECT_EQ(shaded(plate_of("gggggggggg", 10, 5)), 1);  // 0.98 of the light
    EXPECT_EQ(shaded(plate_of("bbbbbbbbbb", 10, 5)), 0);  // 0.99 of it
    EXPECT_EQ(shaded(plate_of("..........", 10, 5)), 0);
    EXPECT_EQ(shaded(plate_of("ggggg.....", 10, 5)), 0.5);
    EXPECT_EQ(shaded(turned(plate_of("ggggg.....", 10, 5))), 0.5);
    // What the edge itself dims, one lenslet here, does not count, on either side; what lies further in does.
    EXPECT_EQ(shaded(plate_of("q........q", 10, 5)), 2.0 * 2 / 40);
    EXPECT_EQ(shaded(plate_of(".q......q.", 10, 5)), (2.0 * 10 + 2 * 2) / 40);
    // A deflected middle is not compared.
    EXPECT_EQ(marked(plate_of("pppppppppp", 10, 5), PartForm::plate).found.shaded, 0);
    // Two lenslets on either side are enough, the margin apart; one is not.
    EXPECT_EQ(shaded(plate_of("gggggggggg", 10, 3)), 1);
    EXPECT_EQ(shaded(plate_of("gggggggggg", 10, 2)), 0);
}

TEST(Plate, tells_how_many_steps_can_be_compared) {
    for (const int rows : {7, 8}) {
        // The plate leaves the field on the left, and too little light is seen above and below it.
        const Rows free = repeated("................", 2), edge = {"ddddddddddd....."};
        const Rows drawing =
            joined({free, edge, repeated("ggggggggggd.....", static_cast<std::size_t>(rows)), edge, free});
        const FoundPart found = marked(drawing, PartForm::plate).found;
        EXPECT_EQ(found.shaded, 1);
        EXPECT_EQ(found.shaded_steps, rows);
    }
}

// What two faces of glass let through.
constexpr double kGlass = 0.92;

Frame lines_across(const Extents& e, double between, double middle, int width) {
    const auto is_line = [width](int m) { return (m >= 10 && m < 10 + width) || (m >= 29 && m < 29 + width); };
    return noisy(drawn(e, 8, 240,
                       [&](int m, int) {
                           const bool inside = m >= 10 && m <= 29;
                           return Spot{0, 0, is_line(m) ? 0 : inside ? between : m < 10 ? 1 : middle};
                       }),
                 {10, 2, 1}, 3);
}

// Hairs have two edges; a plate has something between them that reflects light.
TEST(Plate, is_none_where_the_light_between_two_lines_is_that_beside_them) {
    const Extents e{40, 44, 9, 9}, turned{44, 40, 9, 9};
    Recipe plate;
    plate.form = PartForm::plate;
    for (const int width : {1, 2}) {
        for (const auto& [between, beside] : {std::pair{1.0, 1.0}, {1.05, 1.0}, {1.0, 1.1}, {0.97, 0.94}}) {
            const Frame frame = lines_across(e, between, beside, width);
            EXPECT_EQ(verdict_on(frame, e, plate), Verdict::unfit) << width << ", " << between;
            EXPECT_EQ(verdict_on(transposed(frame), turned, plate), Verdict::unfit) << width << ", " << between;
        }
        const Frame glass = lines_across(e, kGlass, 1, width);
        EXPECT_EQ(verdict_on(glass, e, plate), Verdict::pass) << width;
        EXPECT_EQ(verdict_on(transposed(glass), turned, plate), Verdict::pass) << width;
    }
}

// The light grows away from the lines, on both sides until it is alike, or outside only: a shadow that reaches the
// middle. Beside the lines it is darker inside. Glass in a faint shadow of the same kind is a plate. An even shadow
// that ends within the lenslets that the edge hides is a filter: it is not drawn.
TEST(Plate, is_none_where_lines_cast_a_soft_shadow) {
    const Extents e{61, 61, 9, 9};
    Recipe plate;
    plate.form = PartForm::plate;
    for (const bool closed : {false, true}) {
        for (const bool reaches_middle : {false, true}) {
            for (const double width : {2.0, 3.0, 4.0, 6.0, 8.0}) {
                if (reaches_middle && width < 3) continue;
                for (const auto& light : {std::pair{1.0, 0.1}, {1.0, 0.3}, {kGlass, 0.03}}) {
                    const double between = light.first, depth = light.second;
                    const auto spot = [&](int m, int n) {
                        const int x = std::abs(m - 30), y = std::abs(n - 30), from = (closed ? std::max(x, y) : x) - 12;
                        const double share =
                            from < 0 && reaches_middle ? 1 : std::exp(-from * from / (2 * width * width));
                        const double shadow = (from < 0 || reaches_middle ? depth : depth / 2) * share;
                        return Spot{0, 0, from == 0 ? 0 : (from < 0 ? between : 1) * (1 - shadow)};
                    };
                    EXPECT_EQ(verdict_on(noisy(drawn(e, 8, 240, spot), {10, 2, 1}, 3), e, plate),
                              between < 1 ? Verdict::pass : Verdict::unfit)
                        << closed << reaches_middle << ", " << width << ", " << depth;
                }
            }
        }
    }
}

// A lamp that is darker in the middle: two hairs, or a frame of hairs, in an empty field are no plate. Glass in the
// same light is one. Beside the dark of a hair are lenslets that it covers in part; along a hair they look tinted.
TEST(Plate, is_none_where_the_lamp_is_darker_between_two_hairs) {
    Recipe plate;
    plate.form = PartForm::plate;
    for (const int side : {50, 61, 80}) {
        const Extents e{side, side, 9, 9};
        const int hair = side / 4;  // lenslets from the field's border to its middle
        for (const bool closed : {false, true}) {
            for (const double depth : {0.06, 0.1, 0.15}) {
                for (const double width : {0.3, 0.4, 0.6, 0.0}) {  // of half the field; 0: a parabola
                    for (const double between : {1.0, kGlass}) {
                        const auto spot = [&](int m, int n) {
                            const int across = std::min(m, side - 1 - m), down = std::min(n, side - 1 - n),
                                      inside = closed ? std::min(across, down) : across;
                            const double u = 2 * (m + 0.5) / side - 1, v = closed ? 2 * (n + 0.5) / side - 1 : 0,
                                         squared = u * u + v * v,
                                         lamp = 1 -
                                depth * (width > 0 ? std::exp(-squared / (2 * width * width)) : 1 - squared / 2);
                            if (between == 1 && (inside == hair - 1 || inside == hair + 2))
                                return Spot{0, 0, 0.6 * lamp};
                            return Spot{0, 0,
                                        inside == hair || inside == hair + 1 ? 0.05
                                            : inside > hair                  ? between * lamp
                                                                             : lamp};
                        };
                        EXPECT_EQ(verdict_on(noisy(drawn(e, 8, 240, spot), {10, 2, 1}, 3), e, plate),
                                  between < 1 ? Verdict::pass : Verdict::unfit)
                            << side << closed << ", " << depth << ", " << width;
                    }
                }
            }
        }
    }
}

// The lamp is a little darker in the middle of the field. A plate with a hole there is not told to be a hair's shadow.
TEST(Plate, with_a_hole_in_its_middle_is_told_by_its_clear_middle) {
    const Extents e{61, 61, 9, 9};
    for (const int hole : {4, 9}) {  // half its width; 4: the middle that is compared is clear
        for (const bool nothing_else : {false, true}) {
            const auto spot = [&](int m, int n) {
                const int x = std::abs(m - 30), y = std::abs(n - 30), from = std::max(x, y);
                const double lamp = 0.99 + 0.01 * from / 30;
                if (from == 18 || from == hole) return Spot{0, 0, 0};
                return Spot{0, 0, lamp * (from < 18 && from > hole && !nothing_else ? kGlass : 1)};
            };
            Recipe plate;
            plate.form = PartForm::plate;
            auto pipeline = Pipeline::create(e, 8, plate);
            ASSERT_TRUE(pipeline);
            const auto seen = pipeline->inspect(noisy(drawn(e, 8, 240, spot), {10, 2, 1}, 3).view());
            ASSERT_TRUE(seen);
            EXPECT_EQ(seen->reason, Reason::no_part);
            EXPECT_EQ(seen->frame.fault == FrameFault::clear_middle, !nothing_else) << hole << nothing_else;
        }
    }
}

TEST(Plate, may_be_tinted_to_less_than_half_of_the_light) {
    const Extents e{40, 44, 9, 9}, turned{44, 40, 9, 9};
    Recipe plate;
    plate.form = PartForm::plate;
    for (const double light : {0.6, 0.5, 0.4, 0.2, 0.1}) {
        const Frame glass = lines_across(e, light, 1, 1);
        EXPECT_EQ(verdict_on(glass, e, plate), Verdict::pass) << light;
        EXPECT_EQ(verdict_on(transposed(glass), turned, plate), Verdict::pass) << light;
    }
}

// Of a plate only a piece may be in the field: half a part is not known to be good. One that reaches from border to
// border, as wide on both sides, is longer than the field. A corner that the border takes off is less than the margin.
TEST(Plate, that_the_field_cuts_is_unfit_unless_the_recipe_allows_any_outline) {
    struct Place {
        const char* what;
        double m, n, half_m, half_n, turn;  // lenslets, rad
        bool is_cut;
    };
    constexpr double kFar = 100, kDiagonal = 0.7854;
    const Place places[] = {{"inside", 30, 30, 15, 12, 0, false},
                            {"a third", 66, 30, 16, 12, 0, true},
                            {"two thirds", -2, 30, 16, 12, 0, true},
                            {"narrow, an end beyond", 44, 30, 40, 8, 0, true},
                            {"a corner", 58, 58, 20, 20, 0, true},
                            {"a corner that points inwards", 30, 75, 30, 30, kDiagonal, true},
                            {"from border to border", 30, 30, kFar, 10, 0, false},
                            {"from border to border, askew", 30, 30, kFar, 10, 0.2, false},
                            {"from border to border, more askew", 30, 30, kFar, 7, 0.14, false},
                            {"from border to border, down", 25, 30, 11, kFar, 0, false},
                            {"from border to border, turned", 30, 30, kFar, 10, 0.5, false},
                            {"from corner to corner of the field", 28, 30, kFar, 10, kDiagonal, true},
                            {"corners that touch two borders", 23, 23, 17, 17, kDiagonal, false},
                            {"corners that touch all borders", 30, 30, 22, 22, kDiagonal, false},
                            {"less a tip", 30, 44, 14, 14, kDiagonal, false}};
    const Extents e{61, 61, 9, 9};
    for (const Place& p : places) {
        const Frame frame =
            noisy(drawn(e, 8, 240,
                        [&](int m, int n) {
                            const double x = m - p.m, y = n - p.n, u = x * std::cos(p.turn) + y * std::sin(p.turn),
                                         v = y * std::cos(p.turn) - x * std::sin(p.turn),
                                         depth = std::min(p.half_m - std::abs(u), p.half_n - std::abs(v));
                            return Spot{0, 0, depth < -1 ? 1 : depth < 0 ? 0.6 : depth < 1.5 ? 0 : kGlass};
                        }),
                  {10, 2, 1}, 3);
        Recipe plate;
        plate.form = PartForm::plate;
        auto pipeline = Pipeline::create(e, 8, plate);
        ASSERT_TRUE(pipeline);
        const auto seen = pipeline->inspect(frame.view());
        ASSERT_TRUE(seen);
        EXPECT_EQ(seen->verdict, p.is_cut ? Verdict::unfit : Verdict::pass) << p.what;
        EXPECT_EQ(seen->frame.fault, p.is_cut ? FrameFault::cut_by_field : FrameFault::none) << p.what;
        plate.symmetric_outline = false;
        EXPECT_EQ(verdict_on(frame, e, plate), Verdict::pass) << p.what;
    }
}

// A ring, a nest, a cross of hairs: nothing is in them.
// Verdicts: a corner that is missing, unless the recipe allows any outline; spots that are wider than beside the plate.
TEST(Plate, without_a_corner_or_with_wide_spots_all_over_is_unfit) {
    const Extents e{50, 44, 9, 9};
    const auto plate = [&](int corner, double wider) {
        Frame frame = drawn(e, 8, 220, [&](int m, int n) -> Spot {
            const int left = m - 9, top = n - 9, right = 40 - m, bottom = 34 - n;
            const int inside = std::min(std::min({left, right, top, bottom}), left + top - corner);
            return {0, 0, inside < 0 ? 1 : inside == 0 ? 0.05 : wider > 0 ? 0.3 : 0.92};
        });
        if (wider > 0) {  // as much light again, one and two bins to the left and to the right
            for (int n = 12; n < 32; ++n) {
                for (int m = 12; m < 38; ++m) {
                    for (int j = 3; j < 6; ++j) {
                        for (const int i : {2, 3, 5, 6}) {
                            const int x = m * 9 + i, y = n * 9 + j;
                            frame.set(x, y, frame.view().sample(x, y) + (j == 4 ? 25U : 3U));
                        }
                    }
                }
            }
        }
        return noisy(frame, {10, 2, 1}, 5);
    };
    Recipe recipe;
    recipe.form = PartForm::plate;
    const auto fault_of = [&](const Frame& frame) {
        auto pipeline = Pipeline::create(e, 8, recipe);
        const auto found = pipeline->inspect(frame.view());
        EXPECT_EQ(found->verdict == Verdict::unfit, found->frame.fault != FrameFault::none);
        return found->frame.fault;
    };
    EXPECT_EQ(verdict_on(plate(0, 0), e, recipe), Verdict::pass);
    EXPECT_EQ(fault_of(plate(12, 0)), FrameFault::lopsided);
    EXPECT_EQ(fault_of(plate(0, 1)), FrameFault::wide_inside);
    recipe.symmetric_outline = false;
    EXPECT_EQ(verdict_on(plate(12, 0), e, recipe), Verdict::pass);
    EXPECT_EQ(fault_of(plate(0, 1)), FrameFault::wide_inside);
}

// Fog lights bins that a collimated source leaves dark; glass takes no light from them.
TEST(Plate, is_none_where_fog_leaves_a_clear_rectangle) {
    const Extents e{44, 44, 9, 9};
    Recipe recipe;
    recipe.form = PartForm::plate;
    int as_fog = 0;
    const auto judged = [&](int border, double edge, double glass, double fog_beside, double fog_behind,
                            std::uint64_t seed) {
        const auto depth = [=](int m, int n) { return std::min({m, n, 43 - m, 43 - n}) - border; };
        const auto is_inside = [=](int m, int n) { return depth(m, n) >= 0; };
        Frame frame = drawn(e, 12, 3840, [&](int m, int n) {
            return Spot{0, 0, depth(m, n) == 0 ? edge : is_inside(m, n) ? glass : 1};
        });
        for (int y = 0; y < e.height_px(); ++y) {
            for (int x = 0; x < e.width_px(); ++x) {
                const double fog = 16 * (is_inside(x / e.i, y / e.j) ? fog_behind : fog_beside);
                frame.set(x, y, std::min(frame.view().sample(x, y) + static_cast<std::uint32_t>(fog), 4095U));
            }
        }
        auto pipeline = Pipeline::create(e, 8, recipe);
        const Frame exposed = noisy(frame, {10.0 / 16, 2, 1}, seed, 8);
        const auto found = pipeline->inspect(exposed.view());
        as_fog += found->frame.fault == FrameFault::fog_beside ? 1 : 0;
        return found->verdict;
    };
    for (const double fog : {1.0, 2.0, 4.0, 6.0, 8.0, 10.0, 12.0, 14.0}) {
        for (const int border : {7, 8, 12}) {
            for (const double edge : {1.0, 0.05})  // the second: hairs around the rectangle
                EXPECT_EQ(judged(border, edge, 1, fog, 0, 1), Verdict::unfit) << fog << ", " << border << ", " << edge;
        }
    }
    EXPECT_GT(as_fog, 0);
    as_fog = 0;
    // Glass in fog that is everywhere, a pedestal.
    for (const double fog : {0.0, 2.0, 4.0, 6.0}) EXPECT_EQ(judged(8, 0.05, 0.92, fog, fog, 1), Verdict::pass) << fog;
    EXPECT_EQ(as_fog, 0);
}

TEST(Plate, is_none_where_an_outline_has_nothing_in_it) {
    const Extents e{40, 44, 9, 9};
    Recipe plate;
    plate.form = PartForm::plate;
    const auto judged = [&](auto&& is_dark, double between) {
        return verdict_on(noisy(drawn(e, 8, 240,
                                      [&](int m, int n) {
                                          const bool inside = m > 8 && m < 31 && n > 8 && n < 35;
                                          return Spot{0, 0, is_dark(m, n) ? 0 : inside ? between : 1};
                                      }),
                                {10, 2, 1}, 3),
                          e, plate);
    };
    const auto box = [](int m, int n) {
        return m >= 8 && m <= 31 && n >= 8 && n <= 35 && (m == 8 || m == 31 || n == 8 || n == 35);
    };
    EXPECT_EQ(judged(box, 1), Verdict::unfit);
    EXPECT_EQ(judged(box, kGlass), Verdict::pass);
    EXPECT_EQ(judged([](int m, int n) { return m == n || m + n == 39; }, 1), Verdict::unfit);
    EXPECT_EQ(judged([](int m, int n) { return m == 12 || n == 20; }, 1), Verdict::unfit);
}

// Samples that a transfer lost: one edge, and behind it all light is moved. A wedge inside the field may be judged so.
TEST(Plate, is_none_where_all_light_behind_an_edge_is_deflected) {
    const Extents e{40, 44, 9, 9};
    Recipe plate;
    plate.form = PartForm::plate;
    for (const double bins : {0.4, 1.0, 2.0, 3.0}) {
        for (const int from : {14, 22, 30}) {
            const Frame step = noisy(drawn(e, 8, 240,
                                           [&](int, int n) {
                                               return n < from ? Spot{} : Spot{bins, 0, 1};
                                           }),
                                     {10, 2, 1}, 3);
            EXPECT_EQ(verdict_on(step, e, plate), Verdict::unfit) << bins << ", " << from;
            EXPECT_EQ(verdict_on(transposed(step), {e.n, e.m, 9, 9}, plate), Verdict::unfit) << bins << ", " << from;
        }
    }
    for (const double bins : {0.0, 1.0}) {
        const auto whole = [bins](int m, int n) {
            return m < 8 || m > 31 || n < 8 || n > 35    ? Spot{}
                : m == 8 || m == 31 || n == 8 || n == 35 ? Spot{0, 0, 0}
                                                         : Spot{bins, 0, kGlass};
        };
        EXPECT_EQ(verdict_on(noisy(drawn(e, 8, 240, whole), {10, 2, 1}, 3), e, plate), Verdict::pass) << bins;
    }
}

// Those that a round part's usual recipe does not have.
std::vector<std::string> added_notes(const Recipe& of) {
    std::vector<std::string> added = notes(of);
    const std::vector<std::string> usual = notes(Recipe{});
    std::erase_if(added, [&](const std::string& note) { return std::ranges::find(usual, note) != usual.end(); });
    return added;
}

// The statements of the notes.
TEST(Notes, of_plates_and_webs_are_true) {
    const Extents e{40, 40, 9, 9};
    const Frame empty = noisy(drawn(e, 8, 240, [](int, int) { return Spot{}; }), {10, 2, 1}, 3);
    Recipe web;
    web.form = PartForm::web;
    web.part_required = false;
    ASSERT_EQ(notes(web).size(), 2U);
    EXPECT_NE(notes(web)[0].find("a hole in a film that takes less than 3 % of the light"), std::string::npos);
    EXPECT_NE(notes(web)[0].find("hordctl learn"), std::string::npos);
    EXPECT_EQ(notes(web)[1], "whether a part is there is not checked: a frame of the empty field can pass");
    EXPECT_EQ(verdict_on(empty, e, web), Verdict::pass);
    Recipe plate;
    plate.form = PartForm::plate;
    ASSERT_EQ(notes(plate).size(), 1U);
    EXPECT_NE(notes(plate)[0].find("neither darken nor deflect light"), std::string::npos);
    EXPECT_NE(notes(plate)[0].find("hordctl learn"), std::string::npos);
    EXPECT_EQ(verdict_on(empty, e, plate), Verdict::unfit);
    plate.symmetric_outline = false;
    ASSERT_EQ(notes(plate).size(), 2U);
    EXPECT_NE(notes(plate)[1].find("outline = \"any\" takes a broken part for one of another shape"),
              std::string::npos);
    plate.reference = std::make_shared<const Reference>();
    EXPECT_TRUE(notes(plate).empty());
}

TEST(Notes, say_that_scores_without_a_reference_change_nothing) {
    for (float Recipe::*const score : {&Recipe::reject_score, &Recipe::grow_score, &Recipe::cluster_score}) {
        Recipe recipe;
        recipe.*score += 0.25F;
        ASSERT_EQ(added_notes(recipe).size(), 1U);
        EXPECT_NE(added_notes(recipe)[0].find("it names no file"), std::string::npos);
        recipe.reference = std::make_shared<const Reference>();
        EXPECT_TRUE(added_notes(recipe).empty());
    }
}

TEST(Notes, say_that_no_defect_can_reach_the_limits) {
    const auto every_part_passes = [](const Recipe& of) {
        return !added_notes(of).empty() && added_notes(of)[0].find("every part passes") != std::string::npos;
    };
    Recipe recipe;
    recipe.transmission_limit = 0;
    EXPECT_FALSE(every_part_passes(recipe));
    recipe.emd_limit_bins = 28;
    recipe.frobenius_limit_bins = 14;
    ASSERT_EQ(added_notes(recipe).size(), 1U);
    EXPECT_TRUE(every_part_passes(recipe));
    recipe.frobenius_limit_bins = 13.9F;
    EXPECT_FALSE(every_part_passes(recipe));
    recipe.slopes = false;
    recipe.transmission_limit = 0.01F;
    ASSERT_EQ(added_notes(recipe).size(), 1U);
    EXPECT_FALSE(every_part_passes(recipe));
    recipe.light = false;
    EXPECT_EQ(added_notes(recipe).size(), 1U);
    EXPECT_TRUE(every_part_passes(recipe));
    recipe.gradient = Feature::hellinger;
    EXPECT_FALSE(every_part_passes(recipe));
}

// The largest gradients of 15x15 bins: light that jumps between opposite corners.
TEST(Notes, say_which_limits_no_light_field_reaches) {
    const Extents e{10, 10, 15, 15};  // few lenslets: all are solved within the limit of work
    const Frame corners = drawn(e, 8, 240, [](int m, int n) {
        const bool first = ((m / 2) + (n / 2)) % 2 == 0;
        return Spot{first ? -7.0 : 7.0, first ? -7.0 : 7.0, 1};
    });
    Recipe web;
    web.form = PartForm::web;
    web.part_required = web.light = web.check_period = false;
    web.max_offset_bins = web.max_spot_bins = web.max_second_share = 0;
    web.transmission_limit = Recipe{}.transmission_limit;
    const auto told = [](const Recipe& of, const char* key) {
        return std::ranges::any_of(added_notes(of), [&](const std::string& note) {
            return note.starts_with(key) && note.find("reached by no light field") != std::string::npos;
        });
    };
    for (const bool emd : {true, false}) {
        Recipe one = web;
        one.slopes = !emd;
        if (!emd) one.gradient.reset();
        float& limit = emd ? one.emd_limit_bins : one.frobenius_limit_bins;
        const float largest = emd ? 28 : 14;
        const char* const key = emd ? "emd_bins" : "frobenius_bins";
        limit = largest - 0.5F;
        EXPECT_EQ(verdict_on(corners, e, one), Verdict::reject) << key;
        one.light = true;
        EXPECT_FALSE(told(one, key));
        limit = largest;
        EXPECT_TRUE(told(one, key));
        one.light = false;
        limit = largest + 0.1F;
        EXPECT_EQ(verdict_on(corners, e, one), Verdict::pass) << key;
    }
}

bool some_note_has(const Recipe& of, const char* text) {
    return std::ranges::any_of(added_notes(of),
                               [&](const std::string& n) { return n.find(text) != std::string::npos; });
}

TEST(Notes, say_which_light_levels_leave_little_to_judge) {
    Recipe recipe;
    recipe.dark_dn = 63;
    EXPECT_TRUE(added_notes(recipe).empty());
    recipe.dark_dn = 64;
    EXPECT_TRUE(some_note_has(recipe, "dark_dn takes 64 of 255 DN"));
    recipe = {};
    recipe.max_dark_rise_dn = 60;  // on top of the default level of 3
    EXPECT_TRUE(added_notes(recipe).empty());
    recipe.max_dark_rise_dn = 61;
    EXPECT_TRUE(some_note_has(recipe, "max_dark_rise_dn lets fog or a black level of 64 of 255 DN"));
    recipe = {};
    recipe.saturated_dn = 64;
    EXPECT_TRUE(added_notes(recipe).empty());
    recipe.saturated_dn = 63;
    EXPECT_TRUE(some_note_has(recipe, "a sample of 63 DN (saturated_dn) are not judged"));
    recipe.saturated_dn = 1;
    const auto refused = Pipeline::create({20, 20, 9, 9}, 8, recipe);
    ASSERT_FALSE(refused);
    EXPECT_NE(refused.error().message().find("saturated_dn must be above the dark level, 3 DN"), std::string::npos);
}

TEST(Notes, say_that_many_lenslets_may_be_saturated) {
    Recipe recipe;
    recipe.max_saturated_share = 0.25F;
    EXPECT_TRUE(added_notes(recipe).empty());
    recipe.max_saturated_share = 1;
    EXPECT_TRUE(some_note_has(recipe, "100 % of a part may be (max_saturated_share)"));
    recipe.saturated_dn = 20;
    EXPECT_TRUE(some_note_has(recipe, "passes unjudged (max_saturated_share)"));
}

TEST(Notes, say_that_light_alone_is_judged) {
    Recipe recipe;
    recipe.gradient.reset();
    EXPECT_TRUE(added_notes(recipe).empty());
    recipe.slopes = false;
    EXPECT_TRUE(some_note_has(recipe, "nothing but light is judged"));
    recipe.reference = std::make_shared<const Reference>();
    EXPECT_FALSE(some_note_has(recipe, "nothing but light is judged"));
}

TEST(Notes, say_which_scores_hardly_any_defect_reaches) {
    Recipe recipe;
    recipe.reference = std::make_shared<const Reference>();
    recipe.reject_score = 100;
    recipe.cluster_score = 1000;
    EXPECT_TRUE(added_notes(recipe).empty());
    recipe.reject_score = 101;
    EXPECT_TRUE(some_note_has(recipe, "reject_score 101 is reached by hardly any defect"));
    recipe.cluster_score = 1001;
    EXPECT_TRUE(some_note_has(recipe, "cluster_score 1001 is reached by hardly any region"));
}

TEST(Notes, say_which_margins_and_zones_leave_nothing) {
    Recipe recipe;
    recipe.rim_margin = 15;
    EXPECT_TRUE(added_notes(recipe).empty());
    recipe.rim_margin = 30;
    EXPECT_TRUE(some_note_has(recipe, "1 lenslets across of 61 and 51 of 111"));
    recipe.rim_margin = 500;
    EXPECT_TRUE(some_note_has(recipe, "leaves nothing to judge of a field of 1000 lenslets across or less"));
    EXPECT_FALSE(Pipeline::create({40, 1000, 3, 3}, 8, recipe));
    recipe = {};
    Zone all;
    all.use = Zone::Use::ignore;
    all.corners = {{-1, -1}, {70, -1}, {70, 70}, {-1, 70}};
    all.shape = Zone::Shape::polygon;
    recipe.zones = {all};
    EXPECT_TRUE(some_note_has(recipe, "leave nothing of a field of 61x61 lenslets"));
    recipe.zones[0].corners = {{-1, -1}, {10, -1}, {10, 70}, {-1, 70}};
    EXPECT_TRUE(added_notes(recipe).empty());
}

// A dark lenslet has no gradient, and neither have its neighbours.
TEST(Notes, say_that_dark_defects_pass_where_missing_light_is_not_judged) {
    const Extents e{24, 24, 9, 9};
    const Frame speck = noisy(drawn(e, 8, 240,
                                    [](int m, int n) {
                                        const bool dark = m > 9 && m < 14 && n > 9 && n < 14;
                                        return Spot{0, 0, dark ? 0.0 : 1.0};
                                    }),
                              {10, 2, 1}, 3);
    const auto tell = [](const Recipe& of) {
        return !added_notes(of).empty() && added_notes(of)[0].find("missing light is not judged") != std::string::npos;
    };
    Recipe web;
    web.form = PartForm::web;
    web.part_required = false;
    EXPECT_EQ(verdict_on(speck, e, web), Verdict::reject);
    EXPECT_FALSE(tell(web));
    Recipe without = web, at_zero = web;
    without.light = false;
    at_zero.transmission_limit = 0;
    for (Recipe& blind : {std::ref(without), std::ref(at_zero)}) {
        EXPECT_EQ(verdict_on(speck, e, blind), Verdict::pass);
        EXPECT_TRUE(tell(blind));
        blind.reference = std::make_shared<const Reference>();
        EXPECT_FALSE(tell(blind));
    }
}

TEST(Notes, say_that_a_large_least_area_passes_defects_and_which_sum_no_lenslet_holds) {
    Recipe recipe;
    recipe.min_area = 16;
    EXPECT_TRUE(added_notes(recipe).empty());
    recipe.min_area = 12321;
    ASSERT_EQ(added_notes(recipe).size(), 1U);
    EXPECT_NE(added_notes(recipe)[0].find("fewer than 12321 lenslets pass"), std::string::npos);
    EXPECT_NE(added_notes(recipe)[0].find("125 lenslets across"), std::string::npos);
    recipe = {};
    recipe.min_sum_dn = 81 * 255;
    EXPECT_TRUE(added_notes(recipe).empty());
    const Extents e{20, 20, 9, 9};
    EXPECT_TRUE(Pipeline::create(e, 8, recipe));
    ++recipe.min_sum_dn;
    EXPECT_EQ(added_notes(recipe).size(), 1U);
    const auto refused = Pipeline::create(e, 8, recipe);
    ASSERT_FALSE(refused);
    EXPECT_NE(refused.error().message().find("min_sum_dn 20656 is more than a lenslet of 81 bins can hold, 20655"),
              std::string::npos);
    EXPECT_TRUE(Pipeline::create(e, 10, recipe));
}

// A small speck anywhere on a web is found, at the field's border, too.
TEST(Web, with_a_dark_lenslet_anywhere_is_rejected) {
    const Extents e{30, 30, 9, 9};
    Recipe web;
    web.form = PartForm::web;
    web.part_required = false;
    for (const auto& [m, n] :
         {std::pair(0, 0), std::pair(29, 12), std::pair(15, 15), std::pair(1, 28), std::pair(7, 0)}) {
        const Frame frame = drawn(e, 8, 240, [&, m = m, n = n](int x, int y) {
            return x == m && y == n ? Spot{0, 0, 0} : Spot{};
        });
        EXPECT_EQ(verdict_on(noisy(frame, {10, 2, 1}, 4), e, web), Verdict::reject) << m << ", " << n;
    }
}

// Spots repeat after 1 % more than a macro-pixel: over the field they drift through two of them.
TEST(Web, that_is_resized_by_a_hundredth_is_no_frame_of_this_geometry) {
    Recipe web;
    web.form = PartForm::web;
    web.part_required = false;
    for (const Extents& e : {Extents{200, 150, 5, 5}, {111, 111, 9, 9}, {120, 100, 7, 7}}) {
        const auto judged = [&](double scale) {
            Frame frame(e.width_px(), e.height_px(), 8);
            for (int y = 0; y < frame.height_px(); ++y) {
                for (int x = 0; x < frame.width_px(); ++x) {
                    const double u = std::fmod((x + 0.5) / scale, e.i) - 0.5 * e.i,
                                 v = std::fmod((y + 0.5) / scale, e.j) - 0.5 * e.j;
                    frame.set(x, y, static_cast<std::uint32_t>(std::lround(230 * std::exp(-(u * u + v * v)))));
                }
            }
            auto pipeline = Pipeline::create(e, 8, web);
            EXPECT_TRUE(pipeline);
            const auto seen = pipeline->inspect(noisy(frame, {10, 2, 1}, 7).view());
            EXPECT_TRUE(seen);
            return std::pair(seen->verdict, seen->frame);
        };
        const auto [good, of_good] = judged(1);
        EXPECT_EQ(good, Verdict::pass) << e.i;
        EXPECT_LT(of_good.split_share, 0.001F) << e.i;
        const auto [resized, found] = judged(1.01);
        EXPECT_EQ(resized, Verdict::unfit) << e.i;
        // In 7 x 7 and 9 x 9 bins the mean of all spots shows it first.
        if (e.i == 5) {
            EXPECT_EQ(found.fault, FrameFault::split_spots);
        }
    }
}

}  // namespace
}  // namespace hord::algo
