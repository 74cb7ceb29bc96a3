// Verdicts on drawn tubes in noise, with and without a reference; and what a reference knows of a part's outline.
#include <algorithm>
#include <cmath>
#include <random>
#include <string>
#include <vector>

#include <gtest/gtest.h>

#include "algo/frame/mask.h"
#include "algo/inspection/pipeline.h"
#include "algo/inspection/rim.h"
#include "algo/recipe/recipe.h"
#include "algo/reference/reference_learner.h"
#include "tests/support/frames.h"

namespace hord::algo {
namespace {

using namespace hord::algo::testing;

// A drawn tube: flanks whose thickness varies, a band whose light is deflected by `slope` bins a lenslet.
struct DrawnTube {
    Extents extents{45, 51, 9, 9};
    double half_width = 15, half_length = 18;  // lenslets; a half_length beyond the field: open ends
    int flank = 3;
    double slope = 0.12;
    double skew = 0;      // lenslets across, a lenslet along
    double centre = 0.3;  // lenslets from the middle of the field
    double along = 0;     // the same, along the tube
    [[nodiscard]] bool is_open() const { return half_length > 0.5 * extents.n; }
};

// A dark disc; radius below 0.5: one lenslet.
struct DarkSpot {
    double m = 0, n = 0, radius = 0;
};

double across_tube(const DrawnTube& t, int m, int n) {
    return m - 0.5 * (t.extents.m - 1) - t.centre - t.skew * (n - 0.5 * (t.extents.n - 1));
}

Frame drawn_tube(const DrawnTube& t, std::uint64_t seed, const DarkSpot* spot = nullptr, double light = 1) {
    std::mt19937_64 random(seed);
    std::vector<int> thickness(static_cast<std::size_t>(2 * t.extents.n));
    for (int& flank : thickness) flank = t.flank + static_cast<int>(random() % 2);
    const Frame frame = drawn(t.extents, 8, 240, [&](int m, int n) -> Spot {
        const double x = across_tube(t, m, n), y = n - 0.5 * (t.extents.n - 1) - t.along;
        if (spot != nullptr && std::hypot(m - spot->m, n - spot->n) <= std::max(spot->radius, 0.1)) return {0, 0, 0};
        if (std::abs(x) > t.half_width || std::abs(y) > t.half_length) return {};
        const auto row = static_cast<std::size_t>(2 * n + (x > 0 ? 1 : 0));
        if (std::abs(x) > t.half_width - thickness[row]) return {0, 0, 0};
        return {t.slope * x, 0, 1};
    });
    return noisy(frame, {10, 2, light}, seed);
}

Recipe tube_recipe() {
    Recipe recipe;
    recipe.form = PartForm::tube;
    return recipe;
}

struct Judged {
    Verdict verdict;
    Reason reason;
};
Judged judged(const Frame& frame, const Extents& e, const Recipe& recipe) {
    auto pipeline = Pipeline::create(e, frame.bits(), recipe);
    EXPECT_TRUE(pipeline) << pipeline.error().message();
    const auto seen = pipeline->inspect(frame.view());
    EXPECT_TRUE(seen);
    return {seen->verdict, seen->reason};
}
Judged judged_both_ways(const Frame& frame, const Extents& e, const Recipe& recipe) {
    const Judged straight = judged(frame, e, recipe), across = judged(transposed(frame), {e.n, e.m, e.j, e.i}, recipe);
    EXPECT_EQ(straight.verdict, across.verdict);
    EXPECT_EQ(straight.reason, across.reason);
    return straight;
}

const DrawnTube kTubes[] = {
    {},                                                          // thin flanks, each below 1/16 of the field
    {.extents = {45, 41, 9, 9}, .half_length = 99, .flank = 2},  // open at both ends
    {.extents = {60, 38, 9, 9}, .half_length = 99, .flank = 8, .slope = 0.2},     // thick flanks
    {.extents = {48, 48, 5, 5}, .half_length = 20, .slope = 0.05, .skew = 0.07},  // askew; the band is free light
    {.extents = {41, 60, 8, 10}, .half_width = 9, .half_length = 25, .flank = 2, .centre = -4.6},
};

// Half a tube is not known to be good. One that reaches from border to border is longer than the field.
TEST(Tube, of_which_one_end_lies_outside_is_unfit_unless_the_recipe_allows_any_outline) {
    for (DrawnTube tube : kTubes) {
        for (const double along : {-0.7, 0.7}) {
            tube.half_length = 0.5 * tube.extents.n;
            tube.along = along * tube.half_length;
            const Frame half = drawn_tube(tube, 5);
            const Judged found = judged_both_ways(half, tube.extents, tube_recipe());
            EXPECT_EQ(found.verdict, Verdict::unfit) << tube.extents.m << ", " << along;
            EXPECT_EQ(found.reason, Reason::no_part);
            Recipe any = tube_recipe();
            any.symmetric_outline = false;
            EXPECT_EQ(judged_both_ways(half, tube.extents, any).verdict, Verdict::pass);
            tube.half_length *= 3;
            EXPECT_EQ(judged_both_ways(drawn_tube(tube, 5), tube.extents, tube_recipe()).verdict, Verdict::pass);
        }
    }
}

// Belts, rails: flanks with nothing between them.
TEST(Tube, is_no_part_where_free_light_lies_between_its_flanks) {
    for (const double half_length : {18.0, 40.0}) {
        const DrawnTube tube{.half_length = half_length, .slope = 0};
        const Judged found = judged_both_ways(drawn_tube(tube, 5), tube.extents, tube_recipe());
        EXPECT_EQ(found.verdict, Verdict::unfit);
        EXPECT_EQ(found.reason, Reason::no_part);
    }
}

// An empty nest: what is dark at two sides of the field, however thin or thick it is, are no flanks of a tube.
TEST(Tube, is_no_part_where_an_empty_field_is_dark_at_two_sides) {
    const Extents e{45, 51, 9, 9};
    for (const int dark : {1, 2, 5, 12, 17}) {
        for (const double x : {0.0, 0.4}) {  // the light's place in its bins
            const auto spot = [&](int m, int) {
                return m < dark + 1 || m >= e.m - dark ? Spot{0, 0, 0} : Spot{x, 0, 1};
            };
            const Frame nest = noisy(drawn(e, 8, 240, spot), {10, 2, 1}, 3);
            const Judged found = judged_both_ways(nest, e, tube_recipe());
            EXPECT_EQ(found.verdict, Verdict::unfit) << dark << ", " << x;
            EXPECT_EQ(found.reason, Reason::no_part) << dark << ", " << x;
        }
    }
}

// Half a tube, cut lengthwise by the field's border; and one of which half lies outside.
TEST(Tube, is_no_part_where_the_field_shows_one_flank_only) {
    for (const double centre : {-22.0, 22.0}) {
        const DrawnTube tube{.half_length = 40, .centre = centre};
        const Frame frame = drawn_tube(tube, 6);
        const Judged found = judged_both_ways(frame, tube.extents, tube_recipe());
        EXPECT_EQ(found.verdict, Verdict::unfit);
        EXPECT_EQ(found.reason, Reason::no_part);
        auto pipeline = Pipeline::create(tube.extents, 8, tube_recipe());
        ASSERT_TRUE(pipeline);
        EXPECT_EQ(pipeline->inspect(frame.view())->frame.fault, FrameFault::no_flanks);
    }
}

// The mean of exposures of a tube at these distances across its axis, lenslets.
Frame moved_tube(const DrawnTube& tube, const std::vector<int>& distances) {
    std::vector<Frame> all;
    for (const int distance : distances) {
        DrawnTube moved = tube;
        moved.centre += distance;
        all.push_back(drawn_tube(moved, 7));
    }
    Frame mean = all.front();
    for (int y = 0; y < mean.height_px(); ++y) {
        for (int x = 0; x < mean.width_px(); ++x) {
            std::uint32_t sum = 0;
            for (const Frame& one : all) sum += one.view().sample(x, y);
            mean.set(x, y, sum / static_cast<std::uint32_t>(all.size()));
        }
    }
    return mean;
}

// An edge in focus covers one lenslet in part; that of a tube that moved covers as many as it moved by.
TEST(Tube, that_moved_or_was_exposed_twice_is_told_by_its_edges) {
    const DrawnTube tube{.extents = {61, 51, 9, 9}, .half_width = 18, .half_length = 99, .slope = 0.06};
    const Extents turned{51, 61, 9, 9};
    const auto fault_of = [&](const Frame& frame, const Extents& e) {
        auto pipeline = Pipeline::create(e, 8, tube_recipe());
        const auto seen = pipeline->inspect(frame.view());
        EXPECT_EQ(seen->verdict == Verdict::pass, seen->frame.fault == FrameFault::none) << name_of(seen->reason);
        return seen->frame.fault;
    };
    for (const std::vector<int>& distances :
         {std::vector{0}, {0, 1}, {0, 3}, {0, 4}, {-2, -1, 0, 1, 2}, {-4, -3, -2, -1, 0, 1, 2, 3, 4}}) {
        const Frame frame = moved_tube(tube, distances);
        const FrameFault expected =
            distances.back() - distances.front() < 3 ? FrameFault::none : FrameFault::blurred_edge;
        // What moved by nine lenslets has no outline any more.
        for (const FrameFault fault : {fault_of(frame, tube.extents), fault_of(transposed(frame), turned)})
            EXPECT_EQ(fault, distances.size() > 5 ? FrameFault::no_outline : expected) << distances.back();
    }
}

// A tenth of the light: the dark level takes most of it where it is spread over many bins.
TEST(Tube, in_too_little_light_is_told_as_that) {
    const DrawnTube tube{.slope = 0.12};
    auto pipeline = Pipeline::create(tube.extents, 8, tube_recipe());
    ASSERT_TRUE(pipeline);
    int dim = 0;
    for (const double light : {0.12, 0.1, 0.08, 0.06}) {
        const auto seen = pipeline->inspect(drawn_tube(tube, 5, nullptr, light).view());
        ASSERT_TRUE(seen);
        EXPECT_NE(seen->reason, Reason::no_part) << light;
        dim += seen->frame.fault == FrameFault::dim ? 1 : 0;
    }
    EXPECT_GE(dim, 1);
}

// What has no flanks is no tube: a sheet that lies across a third of the field.
TEST(Tube, is_no_part_where_light_is_deflected_in_a_third_of_the_field) {
    const Extents e{45, 51, 9, 9};
    const Frame sheet = drawn(e, 8, 240, [&](int m, int) { return m < 30 ? Spot{} : Spot{1.5, 0, 1}; });
    EXPECT_EQ(judged_both_ways(noisy(sheet, {10, 2, 1}, 1), e, tube_recipe()).reason, Reason::no_part);
}

// Light bent in waves all over the field, a fifth of it lost at two sides: the field shows no free light.
TEST(Tube, is_no_part_where_light_is_bent_in_waves) {
    const Extents e{40, 40, 7, 7};
    for (const double dim : {0.8, 0.3}) {
        const Frame frame = noisy(drawn(e, 8, 200,
                                        [&](int m, int n) -> Spot {
                                            const bool side = m < 5 || m > 34;
                                            return {1.2 * std::sin(m / 6.0), 1.2 * std::cos(n / 5.5), side ? dim : 1};
                                        }),
                                  {10, 2, 1}, 3);
        const auto found = judged(frame, e, tube_recipe());
        if (dim > 0.5) EXPECT_EQ(found.verdict, Verdict::unfit);
        else EXPECT_NE(found.reason, Reason::no_part);
    }
}

// A vial filled with water, or one of thick walls. What is steep along the tube on one side of its axis, or steeper
// there than farther out, is not the tube's own.
TEST(Tube, may_be_steep_along_its_whole_length_if_it_is_so_on_both_sides) {
    const DrawnTube t{.extents = {43, 60, 9, 9}, .half_width = 10, .half_length = 99, .flank = 3, .slope = 0.55};
    struct Case {
        const char* what;
        Verdict right;
        double (*deflection)(double x, int n);
    };
    const Case all[] = {
        {"good", Verdict::pass, [](double x, int) { return 0.55 * x; }},
        {"steeper outside", Verdict::pass, [](double x, int) { return (0.4 + 0.02 * std::abs(x)) * x; }},
        {"steep on one side", Verdict::reject, [](double x, int) { return (x > 0 ? 0.6 : 0.1) * x; }},
        {"bent one way on both sides", Verdict::reject,
         [](double x, int) { return 0.7 * (std::hypot(x, 3) - 3) - 1.5; }},
        {"a line beside the axis", Verdict::reject, [](double x, int) { return 0.5 * x + (x > 2 && x < 4 ? 0.8 : 0); }},
        {"a line on the axis", Verdict::reject,
         [](double x, int) { return 0.45 * x + std::clamp(x, -1.5, 1.5) * 0.6; }},
        {"a small place", Verdict::reject,
         [](double x, int n) { return 0.55 * x + (n >= 20 && n <= 22 && x > 1 && x < 3.5 ? 1 : 0); }},
        {"steep for a third of its length", Verdict::reject, [](double x, int n) { return (n < 20 ? 0.6 : 0.1) * x; }},
    };
    for (const Case& c : all) {
        const Frame frame = drawn(t.extents, 8, 240, [&](int m, int n) -> Spot {
            const double x = across_tube(t, m, n), depth = t.half_width - std::abs(x);
            return depth < 0 ? Spot{} : depth < t.flank ? Spot{0, 0, 0} : Spot{c.deflection(x, n), 0, 1};
        });
        for (std::uint64_t seed = 1; seed <= 3; ++seed) {
            const Frame shown = noisy(frame, {10, 2, 1}, seed);
            EXPECT_EQ(judged(shown, t.extents, tube_recipe()).verdict, c.right) << c.what;
            EXPECT_EQ(judged(transposed(shown), {t.extents.n, t.extents.m, 9, 9}, tube_recipe()).verdict, c.right)
                << c.what;
        }
    }
}

// The property: a fully dark speck in the band, of one lenslet up to the band's width, is rejected wherever it lies.
// Left out are specks that do not reach further than margin + 1 lenslets from the flanks and the ends into the band.
TEST(Tube, with_a_dark_speck_in_its_band_is_rejected_wherever_it_lies_and_however_large_it_is) {
    int specks = 0;
    for (std::size_t which = 0; which < std::size(kTubes); ++which) {
        const DrawnTube& t = kTubes[which];
        const int margin = default_rim_margin(t.extents);
        for (std::uint64_t seed = 1; seed <= 3; ++seed) {
            for (const double light : {1.0, 0.5, 0.25}) {
                EXPECT_EQ(judged_both_ways(drawn_tube(t, seed, nullptr, light), t.extents, tube_recipe()).verdict,
                          Verdict::pass)
                    << which << " seed " << seed << " light " << light;
            }
        }
        std::mt19937_64 random(17 + which);
        const double band = t.half_width - t.flank - 1;
        const auto draw = [&](double from, double to) {
            return from + (to - from) * static_cast<double>(random() % 10000) / 10000;
        };
        for (int tried = 0; tried < 60; ++tried) {
            const double axis = 0.5 * (t.extents.m - 1) + t.centre,
                         length = t.is_open() ? 0.5 * (t.extents.n - 1) : t.half_length,
                         n = 0.5 * (t.extents.n - 1) + std::round(draw(-length, length)),
                         middle = axis + t.skew * (n - 0.5 * (t.extents.n - 1));
            // On the axis, beside it, or anywhere.
            const double x = tried % 3 == 0 ? 0 : tried % 3 == 1 ? draw(-2, 2) : draw(-band, band);
            const DarkSpot spot{std::round(middle + x), n, tried % 4 == 0 ? 0 : draw(0, band)};
            bool reaches_in = false;
            for (int row = 0; row < t.extents.n; ++row) {
                for (int m = 0; m < t.extents.m; ++m) {
                    const double y = std::abs(row - 0.5 * (t.extents.n - 1));
                    reaches_in = reaches_in ||
                        (std::hypot(m - spot.m, row - spot.n) <= std::max(spot.radius, 0.1) &&
                         std::abs(across_tube(t, m, row)) < band - margin - 1 && y < length - margin - 1);
                }
            }
            if (!reaches_in) continue;
            ++specks;
            const auto seed = static_cast<std::uint64_t>(100 + tried);
            EXPECT_EQ(judged_both_ways(drawn_tube(t, seed, &spot, tried % 2 == 0 ? 1 : 0.3), t.extents, tube_recipe())
                          .verdict,
                      Verdict::reject)
                << "tube " << which << ": speck of " << spot.radius << " at " << spot.m << ", " << spot.n;
        }
    }
    EXPECT_GT(specks, 200);
}

TEST(Tube, shows_a_speck_on_its_flank_to_a_reference_only) {
    const DrawnTube t{.extents = {45, 45, 9, 9}, .half_length = 99, .flank = 3};
    enum class Speck { none, on_flank, on_axis };
    const auto frame_of = [&](std::uint64_t seed, Speck speck) {
        const Frame frame = drawn(t.extents, 8, 240, [&](int m, int n) -> Spot {
            const double x = across_tube(t, m, n);
            if (std::abs(x) > t.half_width) return {};
            const double into_flank = std::abs(x) - (t.half_width - t.flank);
            const int at = speck == Speck::on_flank ? 9 : 22;
            if (speck != Speck::none && std::abs(m - at) <= 1 && std::abs(n - 20) <= 1) return {0, 0, 0};
            return into_flank > 0 ? Spot{2 * (x > 0 ? 1.0 : -1.0), 0, 0.5} : Spot{0.1 * x, 0, 1};
        });
        return noisy(frame, {10, 2, 1}, seed);
    };
    Recipe recipe = tube_recipe();
    EXPECT_EQ(notes(recipe),
              (std::vector<std::string>{
                  "the flanks and ends of a tube are not judged without a reference, holes and cracks in its "
                  "wall can pass, and so can slopes that are alike along its whole length and on both sides of "
                  "its axis; good tubes whose walls hardly bend light, or with few lenslets across, can be "
                  "unfit or rejected: learn one with `hordctl learn`"}));
    EXPECT_EQ(judged(frame_of(50, Speck::on_flank), t.extents, recipe).verdict, Verdict::pass);
    LearnOptions options{.levels = light_levels(recipe, 8), .electrons_per_dn = 10.0F};
    const auto learned = learn_reference(
        t.extents, 8, 10, [&](std::size_t part) -> Result<Frame> { return frame_of(part, Speck::none); }, options);
    ASSERT_TRUE(learned) << learned.error().message();
    recipe.reference = std::make_shared<const Reference>(learned->reference);
    EXPECT_TRUE(notes(recipe).empty());
    // With the reference a speck in the band is found by the rule for round parts, too.
    for (const PartForm form : {PartForm::tube, PartForm::round}) {
        recipe.form = form;
        EXPECT_EQ(judged(frame_of(50, Speck::on_flank), t.extents, recipe).verdict, Verdict::reject);
        EXPECT_EQ(judged(frame_of(52, Speck::on_axis), t.extents, recipe).verdict, Verdict::reject);
    }
    recipe.form = PartForm::tube;
    EXPECT_EQ(judged(frame_of(51, Speck::none), t.extents, recipe).verdict, Verdict::pass);
}

// A chip through which free light passes changes the outline of a single frame. The reference's outline stays.
TEST(Reference, keeps_what_broke_out_of_a_part_inside_it) {
    const Extents e{45, 45, 9, 9};
    const auto frame_of = [&](std::uint64_t seed, bool chip) {
        const auto whole = lens(e, 17, 3);
        return noisy(drawn(e, 8, 240,
                           [&](int m, int n) { return chip && std::hypot(m - 37, n - 22) < 6 ? Spot{} : whole(m, n); }),
                     {10, 2, 1}, seed);
    };
    Recipe recipe;
    recipe.gradient.reset();
    recipe.slopes = false;
    EXPECT_EQ(judged(frame_of(50, true), e, recipe).verdict, Verdict::unfit);
    recipe.symmetric_outline = false;
    EXPECT_EQ(judged(frame_of(50, true), e, recipe).verdict, Verdict::pass);
    const auto learned =
        learn_reference(e, 8, 10, [&](std::size_t part) -> Result<Frame> { return frame_of(part, false); },
                        {.levels = light_levels(recipe, 8), .electrons_per_dn = 10.0F});
    ASSERT_TRUE(learned) << learned.error().message();
    recipe.reference = std::make_shared<const Reference>(learned->reference);
    EXPECT_EQ(judged(frame_of(51, false), e, recipe).verdict, Verdict::pass);
    auto pipeline = Pipeline::create(e, 8, recipe);
    ASSERT_TRUE(pipeline);
    const auto seen = pipeline->inspect(frame_of(50, true).view());
    ASSERT_TRUE(seen);
    EXPECT_EQ(seen->verdict, Verdict::reject);
    const auto inside = [&](int m, int n) { return (seen->mask[e.index(m, n)] & kOutside) == 0; };
    EXPECT_TRUE(inside(35, 22)) << "in the chip";
    EXPECT_FALSE(inside(42, 22)) << "beside the part";
}

}  // namespace
}  // namespace hord::algo
