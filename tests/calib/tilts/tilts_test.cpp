// The direction map from captures at known tilts: accuracy and refusals.
#include "calib/tilts/tilts.h"

#include <numbers>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "calib/files/grid_toml.h"
#include "tests/calib/support/synthetic.h"

namespace hord::calib {
namespace {

using algo::DirectionRad;
using algo::PixelPoint;
using test::White;
using ::testing::HasSubstr;

// Required accuracy of the prediction of a capture that is left out of the fit, px.
constexpr double kLeftOut = 0.02;

// A camera whose lenslets show direction t, stage axes turned by `turn`, at zero + scale * (t + k |t|^2 t) + shear.
struct Camera {
    double pitch = 24;
    PixelPoint zero{0.7, -0.4};
    double scale = 160;  // px a rad
    double shear = 0.01, cubic = 4;
    double turn = 5 * std::numbers::pi / 180;
    bool mirrored = false;

    [[nodiscard]] PixelPoint place(DirectionRad sensor) const {
        const double r2 = sensor.x_rad * sensor.x_rad + sensor.y_rad * sensor.y_rad;
        const double x = sensor.x_rad * (1 + cubic * r2), y = sensor.y_rad * (1 + cubic * r2);
        return {zero.x_px + scale * (x + shear * y), zero.y_px + scale * (y + shear * x)};
    }
    [[nodiscard]] DirectionRad sensor_of(DirectionRad stage) const {
        if (mirrored) stage.y_rad = -stage.y_rad;
        return {std::cos(turn) * stage.x_rad - std::sin(turn) * stage.y_rad,
                std::sin(turn) * stage.x_rad + std::cos(turn) * stage.y_rad};
    }
};

std::vector<DirectionRad> ring(int count, double radius_rad, double start = 0.3) {
    std::vector<DirectionRad> out;
    for (int k = 0; k < count; ++k) {
        const double angle = start + 2 * std::numbers::pi * k / count;
        out.push_back({radius_rad * std::cos(angle), radius_rad * std::sin(angle)});
    }
    return out;
}

// Input of a fit: captures at `stage` directions; `noise_px` is the standard deviation of each mean.
std::vector<Tilt> tilts_of(const Camera& camera, const std::vector<DirectionRad>& stage, double noise_px,
                           std::uint64_t seed) {
    test::Random random(seed);
    std::vector<Tilt> out;
    for (const DirectionRad& direction : stage) {
        PixelPoint at = camera.place(camera.sensor_of(direction));
        at.x_px += noise_px * random.normal();
        at.y_px += noise_px * random.normal();
        out.push_back({"", direction, {at, 100}});
    }
    return out;
}
SpotPlace empty_of(const Camera& camera) { return {camera.zero, 100}; }

double worst(const Camera& camera, const algo::DirectionMap& map, double reach_rad) {
    double most = 0;
    for (double x = -reach_rad; x <= reach_rad; x += reach_rad / 5) {
        for (double y = -reach_rad; y <= reach_rad; y += reach_rad / 5) {
            if (std::hypot(x, y) > reach_rad) continue;
            const PixelPoint is = map.place_px({x, y}), should = camera.place({x, y});
            most = std::max(most, std::hypot(is.x_px - should.x_px, is.y_px - should.y_px));
        }
    }
    return most;
}

std::vector<DirectionRad> together(std::vector<DirectionRad> a, const std::vector<DirectionRad>& b) {
    a.insert(a.end(), b.begin(), b.end());
    return a;
}

TEST(DirectionFit, scale_rotation_offset_and_distortion_are_found) {
    const Camera camera;
    const auto tilts = tilts_of(camera, together(ring(6, 0.03), ring(8, 0.055)), 0.002, 3);
    const auto fit = fit_directions(empty_of(camera), tilts, camera.pitch);
    ASSERT_TRUE(fit) << fit.error().message();
    EXPECT_NEAR(fit->stage_rotation_rad, camera.turn, 4 * fit->stage_rotation_sigma);
    EXPECT_NEAR(fit->scale_px_a_rad, camera.scale, 0.01 * camera.scale);
    EXPECT_LT(fit->scale_sigma, 0.005 * camera.scale);
    EXPECT_LE(fit->left_out_x_px, kLeftOut) << fit->reason;
    EXPECT_LE(fit->left_out_y_px, kLeftOut) << fit->reason;
    EXPECT_LT(worst(camera, fit->map, 0.055), kLeftOut) << fit->reason;
    EXPECT_EQ(fit->captures, 15);
    EXPECT_FALSE(fit->mirrored);
}

TEST(DirectionFit, a_linear_camera_needs_no_cubic_and_a_stage_in_the_mirror_is_recognised) {
    Camera camera;
    camera.cubic = camera.shear = 0;
    camera.mirrored = true;
    const auto tilts = tilts_of(camera, together(ring(6, 0.03), ring(8, 0.06)), 0.005, 4);
    const auto fit = fit_directions(empty_of(camera), tilts, camera.pitch);
    ASSERT_TRUE(fit) << fit.error().message();
    EXPECT_EQ(fit->map.model, algo::GridModelKind::similarity) << fit->reason;
    EXPECT_TRUE(fit->mirrored);
    EXPECT_LT(worst(camera, fit->map, 0.06), kLeftOut);
}

TEST(DirectionFit, three_tilts_give_an_affine_map_and_fewer_are_refused) {
    Camera camera;
    camera.cubic = 0;
    camera.shear = 0.05;
    const auto fit = fit_directions(empty_of(camera), tilts_of(camera, ring(3, 0.05), 0.001, 1), camera.pitch);
    ASSERT_TRUE(fit) << fit.error().message();
    EXPECT_LE(fit->map.model, algo::GridModelKind::affine);
    const auto two = fit_directions(empty_of(camera), tilts_of(camera, ring(2, 0.05), 0.001, 1), camera.pitch);
    ASSERT_FALSE(two);
    EXPECT_THAT(two.error().message(), HasSubstr("2 tilts"));
}

TEST(DirectionFit, a_cubic_map_needs_ten_tilts) {
    const Camera camera;
    const auto tilts = tilts_of(camera, together(ring(4, 0.03), ring(5, 0.055)), 0.0005, 1);
    const auto nine = fit_directions(empty_of(camera), tilts, camera.pitch);
    ASSERT_TRUE(nine) << nine.error().message();
    for (const ModelReport& model : nine->candidates) EXPECT_NE(model.model, algo::GridModelKind::cubic);
}

TEST(DirectionFit, nearly_collinear_tilts_are_refused) {
    const Camera camera;
    std::vector<DirectionRad> line;
    for (int k = -6; k <= 6; ++k) {
        if (k != 0) line.push_back({0.008 * k, 0.004 * k + (k == 3 ? 0.002 : 0.0)});
    }
    const auto fit = fit_directions(empty_of(camera), tilts_of(camera, line, 0.002, 1), camera.pitch);
    ASSERT_FALSE(fit);
    EXPECT_EQ(fit.error().code, ErrorCode::refused);
    EXPECT_THAT(fit.error().message(), HasSubstr("one line"));
    EXPECT_FALSE(
        fit_directions(empty_of(camera), tilts_of(camera, std::vector<DirectionRad>(5), 0.002, 1), camera.pitch));
}

TEST(DirectionFit, frames_that_do_not_belong_to_their_angles_are_refused) {
    const Camera camera;
    auto tilts = tilts_of(camera, together(ring(6, 0.03), ring(6, 0.055)), 0.002, 3);
    std::swap(tilts[2].direction, tilts[9].direction);
    const auto fit = fit_directions(empty_of(camera), tilts, camera.pitch);
    ASSERT_FALSE(fit);
    EXPECT_THAT(fit.error().message(), HasSubstr("no map"));
}

TEST(DirectionFit, ninety_five_percent_intervals_of_the_rotation_cover_it) {
    // 400 runs: the standard error of the coverage is 1.1 %; 92..98 % is not quite three of them.
    Camera camera;
    camera.cubic = camera.shear = 0;
    const auto stage = together(ring(8, 0.03), ring(12, 0.06));
    int inside = 0;
    for (std::uint64_t run = 0; run < 400; ++run) {
        const auto fit = fit_directions(empty_of(camera), tilts_of(camera, stage, 0.01, 100 + run), camera.pitch);
        ASSERT_TRUE(fit);
        if (std::abs(fit->stage_rotation_rad - camera.turn) < 2.02 * fit->stage_rotation_sigma)
            ++inside;  // Student, 38 degrees of freedom
    }
    RecordProperty("coverage of the rotation", test::text(inside / 400.0));
    EXPECT_GT(inside, 368);
    EXPECT_LT(inside, 392);
}

// Frames: a white one, and captures of one spot a lenslet.
class TiltFrames : public ::testing::Test {
  protected:
    static constexpr int kSide = 420;
    static inline const Camera camera;

    static White white() {
        return {.width_px = kSide, .height_px = kSide, .pitch_px = camera.pitch, .rotation_deg = 1.5};
    }
    static Frame capture(DirectionRad stage, std::uint64_t seed,
                         const std::function<double(double, double)>& pixel_answer = nullptr) {
        White spots = white();
        const PixelPoint at = camera.place(camera.sensor_of(stage));
        spots.offset_x_px += at.x_px;
        spots.offset_y_px += at.y_px;
        spots.disc_radius_px = -1.4;
        spots.seed = seed;
        spots.light = pixel_answer;
        return test::draw(spots).frame;
    }
};

TEST_F(TiltFrames, captured_frames_give_the_map_to_a_fiftieth_of_a_pixel) {
    const auto grid = calibrate_grid(test::draw(white()).frame.view());
    ASSERT_TRUE(grid) << grid.error().message();
    const auto empty = measure_spots(capture({}, 50).view(), {}, {}, *grid);
    ASSERT_TRUE(empty) << empty.error().message();
    EXPECT_NEAR(empty->offset_px.x_px, camera.zero.x_px, kLeftOut);
    EXPECT_NEAR(empty->offset_px.y_px, camera.zero.y_px, kLeftOut);
    std::vector<Tilt> tilts;
    for (const DirectionRad& stage : together(ring(5, 0.03), ring(7, 0.055))) {
        const auto spot = measure_spots(capture(stage, 60 + tilts.size()).view(), {}, {}, *grid);
        ASSERT_TRUE(spot) << spot.error().message();
        tilts.push_back({"", stage, *spot});
    }
    const auto fit = fit_directions(*empty, tilts, grid->pitch_px);
    ASSERT_TRUE(fit) << fit.error().message();
    RecordProperty("left out, px x and y", test::text(fit->left_out_x_px) + " and " + test::text(fit->left_out_y_px));
    EXPECT_LE(fit->left_out_x_px, kLeftOut) << fit->reason;
    EXPECT_LE(fit->left_out_y_px, kLeftOut) << fit->reason;
    EXPECT_LT(worst(camera, fit->map, 0.055), kLeftOut);

    // The calibration file keeps the map to the last bit, and bins are equal steps of direction.
    GridFile file = file_of(*grid, {});
    add_directions(file, *fit);
    const auto read = parse_grid(to_toml(file), "grid.toml");
    ASSERT_TRUE(read) << read.error().message();
    ASSERT_TRUE(read->directions);
    EXPECT_EQ(read->directions->parameters, fit->map.parameters);
    EXPECT_EQ(read->direction_statistics.stage_rotation_rad, fit->stage_rotation_rad);
    const algo::BinLayout layout = algo::layout_of(read->grid, *read->directions, 9, 9);
    EXPECT_NEAR(layout.step_i_rad, camera.pitch / 9 / camera.scale, 0.01 * layout.step_i_rad);
    for (const int bin : {0, 8, 40, 44, 72}) {
        const PixelPoint should =
            camera.place({(bin % 9 - 4) * layout.step_i_rad,
                          (bin / 9 - 4) * layout.step_j_rad});  // NOLINT(bugprone-integer-division)
        if (bin % 8 == 0 && bin != 40) continue;                // corners lie beyond the tilts
        EXPECT_NEAR(layout.offsets_px[static_cast<std::size_t>(bin)].x_px, should.x_px, 2 * kLeftOut) << bin;
        EXPECT_NEAR(layout.offsets_px[static_cast<std::size_t>(bin)].y_px, should.y_px, 2 * kLeftOut) << bin;
    }
}

TEST_F(TiltFrames, a_flat_frame_takes_away_what_single_pixels_do) {
    // The response rises from 0.75 to 1.25 across every 12 px, which moves all spots the same way. Without the flat
    // frame this is measured as a shift.
    const auto answer = [](double x, double) { return 0.75 + 0.5 * (std::fmod(x, 12.0) / 12.0); };
    Frame flat(kSide, kSide, 16);
    for (int y = 0; y < kSide; ++y) {
        for (int x = 0; x < kSide; ++x) flat.set(x, y, static_cast<std::uint32_t>(20000 * answer(x, y)));
    }
    const auto grid = calibrate_grid(test::draw(white()).frame.view());
    ASSERT_TRUE(grid);
    const auto frame = capture({0.02, 0.01}, 7, answer);
    const PixelPoint truth = camera.place(camera.sensor_of({0.02, 0.01}));
    const auto without = measure_spots(frame.view(), {}, {}, *grid);
    const auto with = measure_spots(frame.view(), {}, flat.view(), *grid);
    ASSERT_TRUE(without && with);
    EXPECT_LT(std::abs(with->offset_px.x_px - truth.x_px), 0.2 * std::abs(without->offset_px.x_px - truth.x_px));
    const Frame dark(kSide, kSide, 16);
    EXPECT_FALSE(measure_spots(frame.view(), {}, dark.view(), *grid));
}

TEST_F(TiltFrames, a_capture_without_spots_or_of_another_size_is_refused) {
    const auto grid = calibrate_grid(test::draw(white()).frame.view());
    ASSERT_TRUE(grid);
    EXPECT_FALSE(measure_spots(Frame(kSide, kSide, 16).view(), {}, {}, *grid));
    EXPECT_FALSE(measure_spots(Frame(kSide, kSide - 1, 16).view(), {}, {}, *grid));
}

TEST(TiltList, angles_are_read_in_radians_or_degrees_and_problems_are_named) {
    const auto list = parse_tilts(
        "empty = \"e.png\"\ndark = \"d.png\"\n[[tilt]]\nframe = \"1.png\"\nx_deg = 1.0\ny_rad = 0.01\n", "tilts.toml");
    ASSERT_TRUE(list) << list.error().message();
    ASSERT_EQ(list->tilts.size(), 1U);
    EXPECT_NEAR(list->tilts[0].direction.x_rad, std::numbers::pi / 180, 1e-15);
    EXPECT_EQ(list->tilts[0].direction.y_rad, 0.01);
    const auto bad = parse_tilts("[[tilt]]\nframe = \"1.png\"\nx_deg = 1.0\nx_rad = 0.1\n", "tilts.toml");
    ASSERT_FALSE(bad);
    EXPECT_THAT(bad.error().message(), HasSubstr("empty"));
    EXPECT_THAT(bad.error().message(), HasSubstr("x_rad"));
    EXPECT_THAT(bad.error().message(), HasSubstr("y_rad"));
}

}  // namespace
}  // namespace hord::calib
