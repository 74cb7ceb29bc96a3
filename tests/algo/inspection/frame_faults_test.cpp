// Each limit of the frame checks (docs/notes/inspection.md) from both sides, on values of the decoded field and of the
// part that was found. Whole frames: frame_checks_test.cpp.
#include <functional>
#include <numbers>
#include <string>
#include <vector>

#include <gtest/gtest.h>

#include "algo/frame/mask.h"
#include "algo/inspection/frame_checks.h"
#include "tests/support/light_image.h"

namespace hord::algo {
namespace {

using namespace hord::algo::testing;
using enum FrameFault;

constexpr Extents kField{24, 24, 9, 9};

DeflectionQ bins(double value) {
    return DeflectionQ::from_raw(static_cast<std::int64_t>(value * (1 << DeflectionQ::kFractionBits)));
}

Frame spot_frame(double x = 0, double y = 0, double spread = 0.6, const Sensor& sensor = {}) {
    return exposed(spots(kField, 200, spread, [=](int, int) { return Spot{x, y, 1}; }), sensor, 1);
}

const Frame& usual_frame() {
    static const Frame frame = spot_frame();
    return frame;
}

// A good part in free light: every lenslet is judged and shows free light, too, unless a test changes it.
struct Case {
    Recipe recipe;
    Frame frame = usual_frame();
    std::vector<Deflection> deflections = std::vector<Deflection>(kField.lenslets());
    std::vector<std::uint32_t> sums = std::vector<std::uint32_t>(kField.lenslets(), 1000U);
    std::vector<std::uint8_t> mask = std::vector<std::uint8_t>(kField.lenslets(), kValid);
    std::vector<std::uint8_t> state = std::vector<std::uint8_t>(kField.lenslets(), FoundPart::kFreeField);
    FoundPart part{.free_light = true,
                   .parts = 1,
                   .area = 200,
                   .at_border = 0,
                   .sharp_outline = 1,
                   .free_beside = 1,
                   .symmetry = 1,
                   .convexity = 1,
                   .deflecting = 1};

    [[nodiscard]] FrameFindings found() {
        FrameChecks checks(kField, 8, recipe);
        (void)checks.levels_of(frame.view());
        part.state = state;
        reason = checks.judge(frame.view(), {deflections, sums, mask}, part,
                              alternation(kField, deflections, sums, mask, 0, kField.n));
        return checks.findings();
    }
    FrameFault fault() { return found().fault; }
    Reason reason = Reason::none;
};

// The fault with a change of the good case.
FrameFault with(const std::function<void(Case&)>& change) {
    Case c;
    change(c);
    return c.fault();
}

TEST(FrameFaults, of_a_good_part_are_none) {
    Case c;
    EXPECT_EQ(c.fault(), none);
    EXPECT_EQ(c.reason, Reason::none);
}

// The disc of 200 lenslets has a diameter of 15.96.
TEST(FrameFaults, of_the_part_have_limits) {
    struct Limit {
        const char* name;
        std::function<void(FoundPart&)> within, beyond;
        FrameFault fault;
    };
    const Limit limits[] = {
        {"parts", [](FoundPart& p) { p.parts = 1; }, [](FoundPart& p) { p.parts = 2; }, several},
        {"islands", [](FoundPart& p) { p.islands = 0; }, [](FoundPart& p) { p.islands = 1; }, several},
        {"no part", [](FoundPart& p) { p.parts = 1; }, [](FoundPart& p) { p.parts = 0; }, nothing},
        {"outline", [](FoundPart& p) { p.sharp_outline = 0.5; }, [](FoundPart& p) { p.sharp_outline = 0.499; },
         no_outline},
        {"border", [](FoundPart& p) { p.at_border = 7; }, [](FoundPart& p) { p.at_border = 8; }, cut_by_field},
        {"beside", [](FoundPart& p) { p.free_beside = 0.5; }, [](FoundPart& p) { p.free_beside = 0.499; }, interrupted},
        {"symmetry", [](FoundPart& p) { p.symmetry = 0.913; }, [](FoundPart& p) { p.symmetry = 0.912; }, lopsided},
        {"convexity", [](FoundPart& p) { p.convexity = 0.863; }, [](FoundPart& p) { p.convexity = 0.862; }, notched},
        {"edges", [](FoundPart& p) { p.edge_width = 2; }, [](FoundPart& p) { p.edge_width = 3; }, blurred_edge},
        {"inside", [](FoundPart& p) { p.deflecting = 0.25; }, [](FoundPart& p) { p.deflecting = 0.249; }, hollow},
        {"flanks", [](FoundPart& p) { p.lacks_flanks = false; }, [](FoundPart& p) { p.lacks_flanks = true; },
         no_flanks},
    };
    for (const Limit& limit : limits) {
        EXPECT_EQ(with([&](Case& c) { limit.within(c.part); }), none) << limit.name;
        EXPECT_EQ(with([&](Case& c) { limit.beyond(c.part); }), limit.fault) << limit.name;
        // Where no part is required nothing of it counts.
        EXPECT_EQ(with([&](Case& c) {
                      limit.beyond(c.part);
                      c.recipe.part_required = false;
                  }),
                  none)
            << limit.name;
        Case of_limit;
        limit.beyond(of_limit.part);
        (void)of_limit.found();
        const bool of_light = limit.fault == interrupted || limit.fault == blurred_edge;
        EXPECT_EQ(of_limit.reason, of_light ? Reason::unexpected_light : Reason::no_part) << limit.name;
    }
}

// What decoding leaves of the light, 20 % less and more. A third of the part deflects light.
TEST(FrameFaults, of_a_part_in_little_light_are_that_light) {
    const auto found_in_light = [](double sum, double sharp_outline, int parts = 1, double deflected_bins = 1) {
        Case c;
        std::fill_n(c.deflections.begin(), c.deflections.size() / 3, Deflection{bins(deflected_bins), {}});
        std::ranges::fill(c.sums, static_cast<std::uint32_t>(sum));
        c.part.sharp_outline = sharp_outline;
        c.part.parts = parts;
        const FrameFindings found = c.found();
        EXPECT_EQ(c.reason,
                  found.fault == dim        ? Reason::too_dark
                      : found.fault == none ? Reason::none
                                            : Reason::no_part);
        return found;
    };
    const double light = 100 / (1 - static_cast<double>(found_in_light(100, 1).lost_share));
    EXPECT_EQ(found_in_light(0.81 * light, 0).fault, no_outline);
    EXPECT_EQ(found_in_light(0.79 * light, 0).fault, dim);
    EXPECT_EQ(found_in_light(0.79 * light, 1).fault, none);        // a whole part is seen: it is judged
    EXPECT_EQ(found_in_light(0.79 * light, 1, 0).fault, nothing);  // free light all over
    // The light that is lost may have moved free light by 0.21 bin. Of more light `deflecting` of the part counts.
    EXPECT_EQ(found_in_light(0.79 * light, 1, 1, 0.47).fault, none);
    EXPECT_EQ(found_in_light(0.79 * light, 1, 1, 0.45).fault, dim);
    EXPECT_EQ(found_in_light(0.81 * light, 1, 1, 0.45).fault, none);
}

TEST(FrameFaults, of_the_outline_count_for_the_forms_that_have_it) {
    const auto of_form = [](PartForm form, const std::function<void(FoundPart&)>& change) {
        return with([&](Case& c) {
            c.recipe.form = form;
            c.part.deflecting = 0.5;
            c.part.shaded_steps = 8;
            change(c.part);
        });
    };
    for (const PartForm form : {PartForm::tube, PartForm::plate}) {
        EXPECT_EQ(of_form(form, [](FoundPart& p) { p.symmetry = p.convexity = p.free_beside = 0; }), none);
        EXPECT_EQ(of_form(form, [](FoundPart& p) { p.at_border = 60; }), none);
        EXPECT_EQ(of_form(form, [](FoundPart& p) { p.sharp_outline = 0.4; }), no_outline);
    }
    EXPECT_EQ(of_form(PartForm::tube, [](FoundPart& p) { p.deflecting = 0.249; }), hollow);
    EXPECT_EQ(of_form(PartForm::tube, [](FoundPart& p) { p.deflecting = 0.25; }), none);
    // A plate deflects light, or takes it.
    EXPECT_EQ(of_form(PartForm::plate, [](FoundPart& p) { p.deflecting = 0, p.shaded = 0.75; }), none);
    EXPECT_EQ(of_form(PartForm::plate, [](FoundPart& p) { p.deflecting = 0, p.shaded = 0.749; }), unproven);
    EXPECT_EQ(of_form(PartForm::plate, [](FoundPart& p) { p.deflecting = 0.249, p.shaded = 0; }), unproven);
    EXPECT_EQ(of_form(PartForm::plate, [](FoundPart& p) { p.deflecting = 0, p.shaded = 1; }), none);
    EXPECT_EQ(of_form(PartForm::plate, [](FoundPart& p) { p.deflecting = 0, p.shaded = 1, p.soft_shadow = true; }),
              shadow);
    EXPECT_EQ(of_form(PartForm::plate,
                      [](FoundPart& p) { p.deflecting = 0, p.shaded = 1, p.soft_shadow = p.clear_middle = true; }),
              clear_middle);
    EXPECT_EQ(of_form(PartForm::plate, [](FoundPart& p) { p.deflecting = 0.25, p.soft_shadow = true; }), none);
    EXPECT_EQ(of_form(PartForm::plate, [](FoundPart& p) { p.deflecting = 0, p.shaded = 1, p.shaded_steps = 7; }),
              no_steps);
    EXPECT_EQ(of_form(PartForm::plate, [](FoundPart& p) { p.deflecting = 0.25, p.shaded_steps = 0; }), none);
    EXPECT_EQ(of_form(PartForm::plate, [](FoundPart& p) { p.deflecting = 0.25, p.shaded = 0; }), none);
    EXPECT_EQ(of_form(PartForm::plate, [](FoundPart& p) { p.deflecting = 0.75, p.at_border = 8; }), none);
    EXPECT_EQ(of_form(PartForm::plate, [](FoundPart& p) { p.deflecting = 0.751, p.at_border = 7; }), none);
    EXPECT_EQ(of_form(PartForm::plate, [](FoundPart& p) { p.deflecting = 0.751, p.at_border = 8; }), not_flat);
    EXPECT_EQ(of_form(PartForm::tube, [](FoundPart& p) { p.deflecting = 1; }), none);
    EXPECT_EQ(with([](Case& c) {
                  c.recipe.symmetric_outline = false;
                  c.part.symmetry = c.part.convexity = 0;
              }),
              none);
}

TEST(FrameFaults, least_symmetry_and_convexity_grow_with_the_part) {
    const auto of_diameter = [](double d) { return static_cast<std::size_t>(d * d * std::numbers::pi / 4); };
    EXPECT_NEAR(min_symmetry(of_diameter(100)), 0.944, 1e-4);
    EXPECT_NEAR(min_symmetry(of_diameter(20)), 0.92, 1e-3);
    EXPECT_NEAR(min_convexity(of_diameter(100)), 0.894, 1e-4);
    EXPECT_NEAR(min_convexity(of_diameter(20)), 0.87, 1e-3);
    EXPECT_EQ(min_symmetry(0), 0.8);
    EXPECT_EQ(min_symmetry(9), 0.8);
    EXPECT_EQ(min_convexity(9), 0.8);
}

// Without free light: a holder, or a part that fills the field.
TEST(FrameFaults, of_a_frame_without_free_light) {
    const auto holder = [](int lit_outermost, int lit, int deflecting, double by = 0.3) {
        return with([=](Case& c) {
            c.part = {};
            std::ranges::fill(c.state, std::uint8_t{0});
            std::ranges::fill(c.mask, kDark);
            // The outermost lenslets first, then those of the inside.
            for (int m = 0; m < lit_outermost; ++m) c.mask[kField.index(m % 24, m / 24 * 23)] = kValid;
            for (int k = 0; k < lit - lit_outermost; ++k) {
                const std::size_t at = kField.index(1 + k % 22, 1 + k / 22);
                c.mask[at] = kValid;
                if (k < deflecting)
                    c.deflections[at] = k % 2 == 0 ? Deflection{bins(by), {}} : Deflection{{}, bins(-by)};
            }
        });
    };
    // 9 of 92 outermost lenslets are less than a tenth; 36 of 576 lit ones are a sixteenth; a quarter of them deflect.
    EXPECT_EQ(holder(9, 100, 25), none);
    EXPECT_EQ(holder(10, 100, 25), fills_field);
    EXPECT_EQ(holder(0, 36, 9), none);
    EXPECT_EQ(holder(0, 35, 35), nothing);
    EXPECT_EQ(holder(0, 100, 24), nothing);
    EXPECT_EQ(holder(0, 100, 25, 0.24), nothing);
    EXPECT_EQ(holder(0, 100, 25, 0.26), none);
}

TEST(FrameFaults, of_the_light_have_limits) {
    const auto of_frame = [](const Frame& frame, const Recipe& recipe = {}) {
        return with([&](Case& c) {
            c.frame = frame;
            c.recipe = recipe;
            std::ranges::fill(c.sums, 2000U);  // of the widest spot, too, less than a fifth is lost
        });
    };
    for (const double sign : {1.0, -1.0}) {
        EXPECT_EQ(of_frame(spot_frame(sign * 0.46, 0)), none);
        EXPECT_EQ(of_frame(spot_frame(0, sign * 0.46)), none);
        EXPECT_EQ(of_frame(spot_frame(sign * 0.54, 0)), off_centre);
        EXPECT_EQ(of_frame(spot_frame(0, sign * 0.54)), off_centre);
    }
    Recipe wide;
    wide.max_offset_bins = 0;
    EXPECT_EQ(of_frame(spot_frame(2, 0), wide), none);
    EXPECT_EQ(of_frame(spot_frame(0, 0, 0.9)), none);
    EXPECT_EQ(of_frame(spot_frame(0, 0, 1.1)), wide_spot);
    wide = {};
    wide.max_spot_bins = 0;
    EXPECT_EQ(of_frame(spot_frame(0, 0, 1.1), wide), none);
    EXPECT_EQ(of_frame(spot_frame(0, 0, 0.6, {20, 0.6})), pedestal);
    EXPECT_EQ(of_frame(spot_frame(0, 0, 0.6, {10, 5})), noise);
    EXPECT_EQ(of_frame(spot_frame(0, 0, 0.6, {8, 1})), none);
}

// Of 576 judged lenslets 9 are 1/64.
TEST(FrameFaults, of_glare_need_more_than_a_sixty_fourth_of_the_judged_lenslets) {
    const auto bright = [](int count, std::uint32_t sum, std::uint8_t others) {
        return with([=](Case& c) {
            for (int k = 0; k < count; ++k) c.sums[static_cast<std::size_t>(7 * k)] = sum;
            for (std::size_t k = 300; k < 400; ++k) c.mask[k] |= others;
        });
    };
    EXPECT_EQ(bright(9, 2501, kValid), none);
    EXPECT_EQ(bright(10, 2501, kValid), glare);
    EXPECT_EQ(bright(10, 2500, kValid), none);
    for (const std::uint8_t bit : {kRim, kOutside}) EXPECT_EQ(bright(9, 2501, bit), glare) << int{bit};  // of 476
    EXPECT_EQ(with([](Case& c) {
                  std::ranges::fill(c.mask, kRim);  // nothing is judged
                  std::ranges::fill(c.sums, 9000U);
              }),
              none);
}

TEST(FrameFaults, of_alternation_have_limits_and_are_switched_off_with_the_period) {
    const auto in_turn = [](double by_bins, std::uint32_t by_light, bool check_period) {
        return with([=](Case& c) {
            c.recipe.check_period = check_period;
            for (std::size_t k = 0; k < c.sums.size(); ++k) {
                const bool odd = k % 2 == 1;
                c.deflections[k].x = bins(odd ? -by_bins : by_bins);
                c.sums[k] += odd ? by_light : 0;
            }
        });
    };
    EXPECT_EQ(in_turn(0.149, 0, true), none);
    EXPECT_EQ(in_turn(0.151, 0, true), alternating);
    EXPECT_EQ(in_turn(0.151, 0, false), none);
    EXPECT_EQ(in_turn(0, 220, true), none);  // half the difference over the mean: 110 / 1110
    EXPECT_EQ(in_turn(0, 225, true), alternating);
}

// The edges of a plate in a corner of the field fill a block of lenslets: that it is cut says more.
TEST(FrameFaults, of_alternation_on_a_plate_that_the_field_cuts_are_that_cut) {
    const auto cut = [](PartForm form, double by, bool symmetric) {
        return with([=](Case& c) {
            c.recipe.form = form;
            c.recipe.symmetric_outline = symmetric;
            c.part.cut = by;
            for (std::size_t k = 1; k < c.sums.size(); k += 2) c.sums[k] += 300;
        });
    };
    EXPECT_EQ(cut(PartForm::plate, 0.6, true), cut_by_field);
    EXPECT_EQ(cut(PartForm::plate, 0.5, true), alternating);
    EXPECT_EQ(cut(PartForm::plate, 0.6, false), alternating);
    EXPECT_EQ(cut(PartForm::round, 0.6, true), alternating);
}

// The light of fewer than eight lenslets tells nothing but the dark level.
TEST(FrameFaults, of_the_light_need_eight_lenslets_of_free_light) {
    const auto free_lenslets = [](int count, const Frame& frame) {
        return with([&](Case& c) {
            c.frame = frame;
            for (std::size_t k = static_cast<std::size_t>(count); k < c.state.size(); ++k) c.state[k] = 0;
        });
    };
    EXPECT_EQ(free_lenslets(8, spot_frame(0.8, 0)), off_centre);
    EXPECT_EQ(free_lenslets(7, spot_frame(0.8, 0)), none);
    EXPECT_EQ(free_lenslets(7, spot_frame(0, 0, 0.6, {20, 0.6})), pedestal);
    EXPECT_EQ(with([](Case& c) {
                  c.frame = spot_frame(0.8, 0);
                  std::ranges::fill(c.mask, kDark);
              }),
              none);
}

TEST(FrameFaults, tell_what_was_measured) {
    Case c;
    c.frame = spot_frame(0.3, -0.2, 0.7);
    c.part.at_border = 5;
    const FrameFindings f = c.found();
    EXPECT_TRUE(f.in_free_light && f.spot_measured && f.dark_measured);
    EXPECT_NEAR(f.x_bins, 0.3, 0.02);
    EXPECT_NEAR(f.y_bins, -0.2, 0.02);
    EXPECT_NEAR(f.spot_x_bins, std::hypot(0.7, 0.29), 0.03);
    EXPECT_NEAR(f.border_cut, 5 / 15.958, 1e-3);
    EXPECT_EQ(f.parts, 1);
    EXPECT_EQ(f.period_x, 0);  // not looked for where the free light is as it should be
    EXPECT_GT(f.lit_share, 0.1);
    EXPECT_LT(f.lit_share, 0.4);
}

}  // namespace
}  // namespace hord::algo
