// Plates (docs/notes/inspection.md): whether anything is between their edges, and what is no plate.
#include <algorithm>
#include <cmath>
#include <cstdlib>
#include <string>
#include <utility>

#include <gtest/gtest.h>

#include "tests/algo/inspection/drawn_forms.h"

namespace hord::algo {
namespace {

using namespace hord::algo::testing;

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

// Light falls towards the middle in the lines through the spot alone: no lamp or shadow makes it so.
TEST(Plate, of_clear_glass_with_a_spot_in_its_middle_is_rejected_for_the_spot) {
    const Extents e{61, 61, 9, 9};
    Recipe recipe;
    recipe.form = PartForm::plate;
    for (const double radius : {3.0, 4.0, 5.0}) {
        for (const double spot : {0.3, 0.5}) {
            const Frame plate = drawn(e, 8, 220, [&](int m, int n) -> Spot {
                const int into = std::min(18 - std::abs(m - 30), 14 - std::abs(n - 30));
                const bool in_spot = std::hypot(m - 30, n - 30) < radius;
                return {0, 0, into < 0 ? 1 : into < 1 ? 0 : in_spot ? spot : 0.92};
            });
            for (const std::uint64_t seed : {1U, 2U, 3U})
                EXPECT_EQ(verdict_on(noisy(plate, {10, 2, 1}, seed), e, recipe), Verdict::reject)
                    << radius << " " << spot << " " << seed;
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

// A ring, a nest, a cross of hairs: nothing is in them.
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

}  // namespace
}  // namespace hord::algo
