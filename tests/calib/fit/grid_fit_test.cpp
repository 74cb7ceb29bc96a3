// Model selection, derivatives, covariance and refusals, on centres made from formulas.
#include "calib/fit/grid_fit.h"

#include <array>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "tests/calib/support/synthetic.h"

namespace hord::calib {
namespace {

using algo::GridModelKind;
using algo::LensletGrid;
using test::Random;

// A coordinate frame for columns x rows lenslets at 20 px that fill the image.
LensletGrid frame_of(int columns, int rows) {
    LensletGrid grid;
    grid.columns = columns;
    grid.rows = rows;
    grid.width_px = 20 * columns;
    grid.height_px = 20 * rows;
    grid.origin_u = 0.5 * (columns - 1);
    grid.origin_v = 0.5 * (rows - 1);
    grid.span = 0.5 * std::max(columns, rows);
    grid.middle_x_px = 0.5 * (grid.width_px - 1);
    grid.middle_y_px = 0.5 * (grid.height_px - 1);
    grid.radius_px = 0.5 * std::max(grid.width_px, grid.height_px);
    return grid;
}

// A true grid of each model, with all of its terms in use.
LensletGrid true_grid(GridModelKind model, int columns = 24, int rows = 20) {
    LensletGrid grid = frame_of(columns, rows);
    const double s = 20 * grid.span;
    grid.model = model;
    grid.parameters.assign(static_cast<std::size_t>(parameter_count(model)), 0.0);
    std::vector<double>& p = grid.parameters;
    if (model == GridModelKind::cubic || model == GridModelKind::quintic) {
        const std::size_t half = p.size() / 2;
        Random random(7);
        for (double& value : p) value = random.uniform() - 0.5;
        p[0] = grid.middle_x_px;
        p[1] = s;
        p[half] = grid.middle_y_px;
        p[half + 2] = s;
        return grid;
    }
    const std::vector<double> all{grid.middle_x_px + 1.3,
                                  grid.middle_y_px - 0.7,
                                  s,
                                  -0.04 * s,
                                  0.045 * s,
                                  1.01 * s,
                                  0.004,
                                  -0.003,
                                  -0.006,
                                  0.003,
                                  0.05,
                                  -0.04};
    if (model == GridModelKind::similarity_radial1) {
        p = {all[0], all[1], s, 3, -0.006};
        return grid;
    }
    std::copy(all.begin(), all.begin() + static_cast<std::ptrdiff_t>(p.size()), p.begin());
    return grid;
}

std::vector<Observation> observe(const LensletGrid& grid, double noise_px, std::uint64_t seed) {
    Random random(seed);
    std::vector<Observation> out;
    for (int n = 0; n < grid.rows; ++n) {
        for (int m = 0; m < grid.columns; ++m) {
            const auto at = grid.centre_px(m, n);
            out.push_back({m, n, {at.x_px + noise_px * random.normal(), at.y_px + noise_px * random.normal()}, true});
        }
    }
    return out;
}

double worst(const LensletGrid& a, const LensletGrid& b) {
    double most = 0;
    for (int n = 0; n < a.rows; ++n) {
        for (int m = 0; m < a.columns; ++m) {
            const auto p = a.centre_px(m, n);
            const auto q = b.centre_px(m, n);
            most = std::max(most, std::hypot(p.x_px - q.x_px, p.y_px - q.y_px));
        }
    }
    return most;
}

Result<GridFit> fit_only(GridModelKind model, const LensletGrid& frame, std::vector<Observation>& seen) {
    return fit_grid(frame, seen, std::span(&model, 1));
}

TEST(GridFit, analytic_derivatives_agree_with_numeric_ones) {
    for (const GridModelKind model : algo::kGridModels) {
        SCOPED_TRACE(name_of(model));
        LensletGrid grid = true_grid(model);
        const auto count = static_cast<std::size_t>(parameter_count(model));
        for (const LensletGrid::Uv uv : {LensletGrid::Uv{0.3, -0.7}, {-0.9, 0.2}, {0, 0}, {1, 1}}) {
            std::vector<double> of_x(count), of_y(count);
            derivatives(grid, uv, of_x.data(), of_y.data());
            for (std::size_t k = 0; k < count; ++k) {
                const double step = 1e-5;
                const double kept = grid.parameters[k];
                grid.parameters[k] = kept + step;
                const auto high = grid.at(uv);
                grid.parameters[k] = kept - step;
                const auto low = grid.at(uv);
                grid.parameters[k] = kept;
                const double size = 1 + std::abs(of_x[k]) + std::abs(of_y[k]);
                // Central differences: the truncation error is below step^2, the rounding below 1e-13 / step.
                EXPECT_NEAR((high.x_px - low.x_px) / (2 * step), of_x[k], 1e-6 * size)
                    << parameter_name(model, static_cast<int>(k));
                EXPECT_NEAR((high.y_px - low.y_px) / (2 * step), of_y[k], 1e-6 * size)
                    << parameter_name(model, static_cast<int>(k));
            }
        }
    }
}

TEST(GridFit, every_rung_finds_its_own_grid_again) {
    for (const GridModelKind model : algo::kGridModels) {
        SCOPED_TRACE(name_of(model));
        const LensletGrid truth = true_grid(model);
        auto seen = observe(truth, 0, 1);
        const auto fit = fit_only(model, frame_of(24, 20), seen);
        ASSERT_TRUE(fit) << fit.error().message();
        EXPECT_LT(worst(fit->grid, truth), 1e-6);
    }
}

TEST(GridFit, the_image_gets_the_model_that_it_requires_and_no_more) {
    for (const GridModelKind model : {GridModelKind::similarity, GridModelKind::affine, GridModelKind::homography,
                                      GridModelKind::radial1, GridModelKind::cubic, GridModelKind::similarity_radial1,
                                      GridModelKind::division1, GridModelKind::rational2}) {
        SCOPED_TRACE(name_of(model));
        auto truth = true_grid(model);
        if (model == GridModelKind::similarity) truth.parameters[3] = 3;
        // Distortion that the models of fewer terms cannot follow to the corners.
        if (model == GridModelKind::division1) truth.parameters[8] = -0.08;
        if (model == GridModelKind::rational2) truth.parameters[8] = 0.1, truth.parameters[9] = 0.25;
        auto seen = observe(truth, 0.01, 3);
        const auto fit = fit_grid(frame_of(24, 20), seen);
        ASSERT_TRUE(fit) << fit.error().message();
        EXPECT_EQ(fit->grid.model, model) << fit->reason;
        EXPECT_THAT(fit->reason, ::testing::HasSubstr(std::string(name_of(model))));
        EXPECT_EQ(std::count_if(fit->candidates.begin(), fit->candidates.end(),
                                [](const ModelReport& r) { return r.chosen; }),
                  1);
    }
}

TEST(GridFit, block_cross_validation_agrees_with_refitting_without_each_block) {
    // Linear models: one step is exact. Each lenslet is its own block here, so refitting is easy to do by hand.
    const LensletGrid truth = true_grid(GridModelKind::affine, 6, 5);
    const auto seen = observe(truth, 0.02, 9);
    auto all = seen;
    const auto fit = fit_only(GridModelKind::affine, frame_of(6, 5), all);
    ASSERT_TRUE(fit);
    ASSERT_EQ(fit->blocks, 30);
    double x = 0;
    for (std::size_t left = 0; left < seen.size(); ++left) {
        auto others = seen;
        others.erase(others.begin() + static_cast<std::ptrdiff_t>(left));
        const auto without = fit_only(GridModelKind::affine, frame_of(6, 5), others);
        const double off = without->grid.centre_px(seen[left].m, seen[left].n).x_px - seen[left].centre_px.x_px;
        x += off * off;
    }
    EXPECT_NEAR(fit->cv_x_rms_px, std::sqrt(x / 30), 1e-9);
}

// A bump in the middle of the frame: a quintic follows it, and leaves the corners where it likes.
TEST(GridFit, a_model_that_loses_the_corners_is_not_taken) {
    auto seen = observe(true_grid(GridModelKind::affine, 40, 40), 0.01, 3);
    for (Observation& o : seen) {
        const double u = (o.m - 19.5) / 20, v = (o.n - 19.5) / 20;
        o.centre_px.x_px += 0.12 * std::exp(-(u * u + v * v) / 0.25);
    }
    constexpr std::array kTwo{GridModelKind::affine, GridModelKind::quintic};
    const auto fit = fit_grid(frame_of(40, 40), seen, kTwo);
    ASSERT_TRUE(fit);
    EXPECT_EQ(fit->grid.model, GridModelKind::affine) << fit->reason;
    EXPECT_GT(fit->candidates[1].gain_t, 2);
    EXPECT_GT(fit->candidates[1].corner_px, 2 * fit->corner_px);
    EXPECT_THAT(fit->candidates[1].verdict, ::testing::HasSubstr("worst corner"));
}

TEST(GridFit, thirty_percent_wrong_centres_are_let_go) {
    const LensletGrid truth = true_grid(GridModelKind::radial1);
    auto seen = observe(truth, 0.005, 5);
    Random random(11);
    int wrong = 0;
    for (Observation& o : seen) {
        if (random.uniform() > 0.3) continue;
        o.centre_px.x_px += 8 * random.uniform() + 0.5;
        o.centre_px.y_px += 6 * random.uniform() - 3;
        ++wrong;
    }
    const auto fit = fit_grid(frame_of(24, 20), seen);
    ASSERT_TRUE(fit) << fit.error().message();
    EXPECT_NEAR(fit->rejected, wrong, 3);
    EXPECT_LT(worst(fit->grid, truth), 0.01);
}

TEST(GridFit, one_row_leaves_the_other_direction_unobservable_and_says_so) {
    const LensletGrid truth = true_grid(GridModelKind::similarity, 24, 1);
    auto seen = observe(truth, 0.005, 5);
    const auto fit = fit_only(GridModelKind::affine, frame_of(24, 1), seen);
    ASSERT_TRUE(fit) << fit.error().message();
    std::vector<std::string> names;
    for (const Unobservable& u : fit->unobservable) names.push_back(u.name);
    EXPECT_THAT(names, ::testing::UnorderedElementsAre("b", "d"));
    EXPECT_EQ(fit->sigma[3], 0);
    EXPECT_EQ(fit->sigma[5], 0);
    EXPECT_GT(fit->sigma[2], 0);
}

TEST(GridFit, an_insignificant_k1_keeps_the_centre_of_distortion_fixed_and_named) {
    auto seen = observe(true_grid(GridModelKind::homography), 0.01, 2);
    const auto fit = fit_only(GridModelKind::radial2, frame_of(24, 20), seen);
    ASSERT_TRUE(fit) << fit.error().message();
    std::vector<std::string> names;
    for (const Unobservable& u : fit->unobservable) names.push_back(u.name);
    EXPECT_THAT(names, ::testing::IsSupersetOf({"cx", "cy"}));
}

TEST(GridFit, degenerate_centres_are_answered_and_never_abort) {
    const LensletGrid frame = frame_of(5, 5);
    std::vector<Observation> same(25);
    for (int k = 0; k < 25; ++k) same[static_cast<std::size_t>(k)] = {2, 2, {10, 10}, true};
    (void)fit_grid(frame, same);
    std::vector<Observation> crowded;
    for (int k = 0; k < 25; ++k) crowded.push_back({k % 5, k / 5, {1, 1}, true});
    (void)fit_grid(frame, crowded);
    std::vector<Observation> broken{
        {0, 0, {std::nan(""), 0}, true}, {1, 0, {1, 0}, true}, {0, 1, {0, 1}, true}, {1, 1, {1, 1}, true}};
    EXPECT_FALSE(fit_grid(frame, broken));
    std::vector<Observation> none;
    EXPECT_FALSE(fit_grid(frame, none));
    std::vector<Observation> huge;
    for (int k = 0; k < 25; ++k) huge.push_back({k % 5, k / 5, {1e200 * k, -1e200 * k}, true});
    EXPECT_FALSE(fit_grid(frame, huge));
}

TEST(GridFit, the_optimum_does_not_depend_on_where_the_search_starts) {
    const LensletGrid truth = true_grid(GridModelKind::radial2);
    const auto seen = observe(truth, 0.01, 8);
    std::optional<LensletGrid> first;
    for (const auto& [origin, span] : {std::pair{11.5, 12.0}, {0.0, 12.0}, {11.5, 40.0}, {23.0, 7.0}}) {
        LensletGrid frame = frame_of(24, 20);
        frame.origin_u = origin;
        frame.span = span;
        auto copy = seen;
        const auto fit = fit_only(GridModelKind::radial2, frame, copy);
        ASSERT_TRUE(fit) << fit.error().message();
        if (!first) first = fit->grid;
        EXPECT_LT(worst(fit->grid, *first), 1e-5);
    }
}

TEST(GridFit, ninety_five_percent_intervals_cover_the_truth) {
    // 240 frames of 480 centres. 8 parameters each: 1920 intervals; the standard error of their coverage is 0.5 %
    // (parameters of one frame are hardly correlated), so that 93..97 % is four of them.
    const LensletGrid truth = true_grid(GridModelKind::homography);
    int inside = 0;
    int all = 0;
    for (std::uint64_t run = 0; run < 240; ++run) {
        auto seen = observe(truth, 0.02, 1000 + run);
        const auto fit = fit_only(GridModelKind::homography, frame_of(24, 20), seen);
        ASSERT_TRUE(fit);
        for (std::size_t k = 0; k < truth.parameters.size(); ++k) {
            ++all;
            if (std::abs(fit->grid.parameters[k] - truth.parameters[k]) < 1.95996 * fit->sigma[k]) ++inside;
        }
    }
    const double coverage = static_cast<double>(inside) / all;
    RecordProperty("coverage of 1920 intervals in 240 runs", test::text(coverage));
    EXPECT_GT(coverage, 0.93);
    EXPECT_LT(coverage, 0.97);
}

TEST(GridFit, residuals_that_are_alike_among_neighbours_widen_the_intervals) {
    LensletGrid truth = true_grid(GridModelKind::affine);
    auto seen = observe(truth, 0.002, 4);
    for (Observation& o : seen) o.centre_px.x_px += 0.02 * std::sin(0.4 * o.m) * std::cos(0.5 * o.n);
    const auto fit = fit_only(GridModelKind::affine, frame_of(24, 20), seen);
    ASSERT_TRUE(fit);
    EXPECT_GT(fit->correlation_inflation, 1.5);
    auto plain = observe(truth, 0.02, 4);
    EXPECT_EQ(fit_only(GridModelKind::affine, frame_of(24, 20), plain)->correlation_inflation, 1);
}

}  // namespace
}  // namespace hord::calib
