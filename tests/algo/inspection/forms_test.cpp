// Forms of parts (docs/notes/inspection.md): what is part, flank and field, on fields drawn as text.
#include <algorithm>
#include <cmath>
#include <string>
#include <utility>
#include <vector>

#include <gtest/gtest.h>

#include "tests/algo/inspection/drawn_forms.h"
#include "tests/support/counted_heap.h"

namespace hord::algo {
namespace {

using namespace hord::algo::testing;

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
