// Prints the tables of docs/results/calibration.md (tests/calib/calibrate/calibration_page.py): the accuracy of the
// calibration on frames of known truth and on photographs.
//   calibration_table [FOLDER with lenslet/ [synthetic|answers|photographs]]
#include <cstdio>
#include <ctime>
#include <filesystem>
#include <string>
#include <utility>

#include <opencv2/core.hpp>
#include <opencv2/imgcodecs.hpp>

#include "tests/calib/support/synthetic.h"

namespace {

using namespace hord;
using calib::test::White;

double cpu_ms() { return 1e3 * static_cast<double>(std::clock()) / CLOCKS_PER_SEC; }

void synthetic_row(const char* name, const White& white) {
    const auto drawn = calib::test::draw(white);
    const double before = cpu_ms();
    const auto calibration = calib::calibrate_grid(drawn.frame.view());
    const double spent = cpu_ms() - before;
    if (!calibration) {
        std::printf("| %s | refused: %s | | | | | |\n", name, calibration.error().message().c_str());
        return;
    }
    const auto compared = calib::test::compare(drawn, *calibration, white.pitch_px);
    std::printf("| %s | %d of %d | %d | %.5f | %.5f | %s | %.0f |\n", name, compared.found_alive,
                compared.alive_complete, compared.invented, compared.rms_px, compared.max_px,
                name_of(calibration->fit.grid.model).data(), spent);
    std::fflush(stdout);
}

// The beginnings of the warnings; "" without any.
std::string warned_of(const calib::GridCalibration& calibration) {
    std::string all;
    for (const std::string& warning : calibration.warnings)
        all += (all.empty() ? "" : "; ") + warning.substr(0, warning.find(':'));
    return all;
}

// A frame on which a grid could be wrong without a word: what is answered, and how far a grid that is given is off.
void answer_row(const char* name, const calib::test::Drawn& drawn, double pitch_px) {
    const auto calibration = calib::calibrate_grid(drawn.frame.view());
    if (!calibration) {
        std::printf("| %s | refused: %s | | |\n", name, calibration.error().what.c_str());
        return;
    }
    const auto compared = calib::test::compare(drawn, *calibration, pitch_px);
    const std::string warned = warned_of(*calibration);
    const std::string answer = warned.empty() ? "a grid" : "a grid, and a warning: " + warned;
    std::printf("| %s | %s | %.4f | %.4f |\n", name, answer.c_str(), compared.rms_px, compared.max_px);
    std::fflush(stdout);
}
void answer_row(const char* name, const White& white) { answer_row(name, calib::test::draw(white), white.pitch_px); }

// The truth is that of `white`; with other noise, the same lenslets are moved by `dx` along the rows, in every second
// row or as a second exposure of half of the light.
void twice_row(const char* what, const White& white, double dx, bool interlaced) {
    White moved = white;
    moved.offset_x_px += dx, moved.seed += 1;
    auto drawn = calib::test::draw(white);
    const Frame other = calib::test::draw(moved).frame;
    for (int y = 0; y < other.height_px(); ++y) {
        for (int x = 0; x < other.width_px(); ++x) {
            const auto a = drawn.frame.view().sample(x, y), b = other.view().sample(x, y);
            drawn.frame.set(x, y, interlaced ? (y % 2 == 0 ? a : b) : (a + b) / 2);
        }
    }
    char name[96];
    std::snprintf(name, sizeof name, "%s %g px apart", what, dx);
    answer_row(name, drawn, white.pitch_px);
}
void twice(const White& base) {
    for (const double dx : {0.05, 0.5, 2.0}) twice_row("interlaced rows,", base, dx, true);
    for (const double dx : {1.0, 2.0, 6.0}) twice_row("discs exposed twice,", base, dx, false);
    White spots = base;
    spots.disc_radius_px = -1.6;
    for (const double dx : {1.0, 2.0, 6.0}) twice_row("spots of 1.6 px sigma exposed twice,", spots, dx, false);
}

// Sharp checkerboards, along the pixels, turned by 3 degrees and diagonal: how many are refused or warned of.
void checkerboards() {
    constexpr int kSide = 600;
    int refused = 0, warned = 0, all = 0;
    for (const double degrees : {0.0, 3.0, 45.0}) {
        const double c = std::cos(degrees * 3.14159265358979323846 / 180),
                     s = std::sin(degrees * 3.14159265358979323846 / 180);
        for (const int field : {4, 5, 6, 7, 8, 9, 10, 11, 12, 13, 14, 15, 16, 18, 20, 24, 30}) {
            calib::test::Random random(3);
            Frame frame(kSide, kSide, 16);
            for (int y = 0; y < kSide; ++y) {
                for (int x = 0; x < kSide; ++x) {
                    const double u = std::floor((c * x + s * y) / field), v = std::floor((c * y - s * x) / field);
                    const double dn = std::fmod(std::abs(u + v), 2) != 0 ? 20000 : 200;
                    frame.set(x, y, static_cast<std::uint32_t>(std::max(0.0, dn + random.normal() * std::sqrt(dn))));
                }
            }
            const auto calibration = calib::calibrate_grid(frame.view());
            ++all;
            if (!calibration) ++refused;
            else if (!calibration->warnings.empty()) ++warned;
        }
    }
    std::printf(
        "| %d sharp checkerboards of 600 x 600 px: fields of 4 to 30 px, along the pixels, at 3 and 45 degrees | "
        "%d refused, %d a grid and a warning, %d a grid | | |\n",
        all, refused, warned, all - refused - warned);
}

void answers() {
    std::printf(
        "\n## Frames on which a grid could be wrong without a word\n\n1000 x 1000 px, square, pitch 17.3 px, turned by "
        "2 "
        "degrees, if not said otherwise; RMS and max: of the grid from the truth, px, over all lenslets. Barrel and "
        "pincushion distortion by k1 at half the side; a relay lens scales the lenslets, too, else they overlap in the "
        "corners.\n\n| frame | answer | RMS | max |\n|---|---|---|---|\n");
    const White base{.width_px = 1000, .height_px = 1000, .pitch_px = 17.3, .rotation_deg = 2};
    answer_row("even light", base);
    for (const double k1 : {-0.05, -0.06, -0.08, 0.1}) {
        for (const bool to_scale : {true, false}) {
            White white = base;
            white.k1 = k1;
            white.to_scale = to_scale;
            char name[64];
            std::snprintf(name, sizeof name, "k1 %.2f, %s", k1, to_scale ? "lenslets scaled" : "lenslets of one size");
            answer_row(name, white);
        }
    }
    constexpr double kTurn = 2 * 3.14159265358979323846;
    White white = base;
    white.disc_radius_px = -1.6;
    for (const double k1 : {-0.07, -0.0725, -0.08}) {
        white.k1 = k1;
        white.to_scale = true;
        char name[64];
        std::snprintf(name, sizeof name, "k1 %.4f, spots scaled", k1);
        answer_row(name, white);
    }
    white.k1 = 0;
    for (const double spot : {0.0, -1.6, -2.5}) {
        for (const double gradient : {0.02, 0.03, 0.06, 0.16}) {
            if (spot == 0 && gradient < 0.16) continue;
            white.disc_radius_px = spot;
            white.gradient = [=](double x, double) { return std::pair(x < 500 ? gradient : 0.0, 0.0); };
            char name[96];
            const char* shape = spot < 0 ? "spots of %.1f px sigma" : "discs";
            char lenslets[32];
            std::snprintf(lenslets, sizeof lenslets, shape, -spot);
            std::snprintf(name, sizeof name, "%s, light brighter by %.0f %% on one side in half of the frame", lenslets,
                          100 * gradient);
            answer_row(name, white);
        }
        white.gradient = [](double, double) { return std::pair(0.16, 0.0); };
        answer_row(
            spot < 0 ? "the same, by 16 % all over the frame (not detected)" : "discs, by 16 % all over the frame",
            white);
    }
    white = base;
    white.light = [](double x, double y) { return x < 150 && y > 850 ? 0.0 : 1.0; };
    answer_row("a corner dark", white);
    white = base;
    white.disc_radius_px = -1.6;
    for (const double period : {64.0, 128.0}) {
        white.light = [=](double x, double y) {
            return 1 - 0.3 * (0.5 + 0.25 * std::sin(kTurn * x / period) + 0.25 * std::cos(kTurn * y / period));
        };
        answer_row(("spots, an object of 30 % contrast in the light, period " +
                    std::to_string(static_cast<int>(period)) + " px")
                       .c_str(),
                   white);
    }
    white = base;
    white.deflect = [](double x, double y) {
        const double u = (x - 500) / 350, v = (y - 500) / 350;
        return u * u + v * v < 1 ? std::pair(u, v) : std::pair(0.0, 0.0);
    };
    answer_row("a lens in the light that moves centres by up to 1 px", white);
    white.deflect = [](double x, double y) {
        const double u = (x - 500) / 350, v = (y - 500) / 350;
        return u * u + v * v < 1 ? std::pair(6 * u, 6 * v) : std::pair(0.0, 0.0);
    };
    answer_row("one that moves them by up to 6 px", white);
    white = base;
    white.pitch_px = 24;
    white.disc_radius_px = -2;
    white.deflect = [](double x, double y) {
        const double u = (x - 500) / 500, v = (y - 500) / 500;
        return std::pair(2 * (3 * u * u + v * v), 4 * u * v);
    };
    answer_row("spots of 24 px pitch with coma", white);
    white.deflect = [](double x, double y) {
        const double u = (x - 500) / 500, v = (y - 500) / 500;
        return std::pair(2 * u * (u * u + v * v), 2 * v * (u * u + v * v));
    };
    answer_row("with spherical aberration (the same as distortion: not detected)", white);
    white = base;
    white.light = [](double x, double y) { return x > 500 && y > 500 ? 0.0 : 1.0; };
    answer_row("a quarter of the frame dark", white);
    white = base;
    white.peak_dn = 200'000;
    answer_row("even light, three times the full scale", white);
    white = base;
    white.misplaced_px = 0.15;
    answer_row("lenslets misplaced by 0.15 px", white);
    white = base;
    for (const double shift : {0.1, 0.25, 0.5, 1.0, 2.0}) {
        white.stop = [=](double x, double y) { return std::pair(shift * (500 - x) / 500, shift * (500 - y) / 500); };
        char name[96];
        std::snprintf(name, sizeof name, "cat's eye: a stop that cuts lenslets by %g px at the border", shift);
        answer_row(name, white);
    }
    for (const double k1 : {-0.04, 0.05}) {
        for (const bool to_scale : {false, true}) {
            white.k1 = k1, white.to_scale = to_scale;
            white.stop = [](double x, double y) { return std::pair((500 - x) / 500, (500 - y) / 500); };
            char name[96];
            std::snprintf(name, sizeof name, "the same by 1 px, k1 %.2f, lenslets %s", k1,
                          to_scale ? "scaled" : "of one size");
            answer_row(name, white);
        }
    }
    white = base;
    for (const double middle_x : {0.0, -500.0, -2000.0}) {
        for (const double shift : {0.3, 1.0}) {
            white.stop = [=](double x, double y) {
                return std::pair(shift * (middle_x - x) / 500, shift * (500 - y) / 500);
            };
            char name[128];
            std::snprintf(name, sizeof name, "the same by %g px more for every 500 px from a middle at column %g",
                          shift, middle_x);
            answer_row(name, white);
        }
    }
    white = base;
    for (const double gradient : {0.3, 0.34, 0.45, 0.7}) {
        white.gradient = [=](double, double) { return std::pair(gradient, 0.0); };
        char name[96];
        std::snprintf(name, sizeof name, "discs, light brighter by %.0f %% on one side all over the frame",
                      100 * gradient);
        answer_row(name, white);
    }
    twice(base);
    white = base;
    white.square = true, white.edge_px = 1, white.subpixels = 4;
    for (const double pitch : {10.0, 12.0, 16.0, 17.3}) {
        for (const double turn : {0.0, 0.6, 2.0}) {
            white.pitch_px = pitch, white.rotation_deg = turn, white.disc_radius_px = 0.44 * pitch;
            char name[96];
            std::snprintf(name, sizeof name, "sharp squares, pitch %g px, turned by %g degrees, 88 %% of the pitch",
                          pitch, turn);
            answer_row(name, white);
        }
    }
    white = base;
    white.deflect = [](double x, double y) { return std::pair((x - 500) / 500, (y - 500) / 500); };
    answer_row("a weak lens that fills the field: centres move outwards by 1 px at the border (not detected)", white);
    white.deflect = [](double, double) { return std::pair(1.0, 0.0); };
    answer_row("light that falls in at a tilt: all centres move by 1 px (not detected)", white);
    checkerboards();
}

void real_row(const std::filesystem::path& folder, const char* name) {
    const cv::Mat pixels =
        cv::imread((folder / "lenslet" / (std::string(name) + ".png")).string(), cv::IMREAD_UNCHANGED);
    if (pixels.empty()) return;
    const FrameView view{reinterpret_cast<const std::byte*>(pixels.data), pixels.cols, pixels.rows,
                         static_cast<std::ptrdiff_t>(pixels.step[0]), pixels.depth() == CV_8U ? 8 : 16};
    const auto calibration = calib::calibrate_grid(view);
    if (!calibration) {
        std::printf("| %s | | | | | | | | refused: %s | | |\n", name, calibration.error().what.c_str());
        return;
    }
    const auto& fit = calibration->fit;
    char single[64] = "not needed";
    if (fit.shifts.share > 0)
        std::snprintf(single, sizeof single, "%.4f / %.4f", fit.shifts.left_x_px, fit.shifts.left_y_px);
    std::printf("| %s | %s | %.3f | %d | %d of %d | %d | %d | %.4f / %.4f | %s | %s | %s |\n", name,
                name_of(fit.grid.kind).data(), calibration->pitch_px, calibration->found, calibration->whole_found,
                calibration->whole, calibration->displaced, calibration->rejected, fit.cv_x_rms_px, fit.cv_y_rms_px,
                name_of(fit.grid.model).data(), single, warned_of(*calibration).c_str());
}

void synthetic() {
    std::printf(
        "## Synthetic, 5000 x 5000 px, 16 bit, 20 ke- a pixel, 2 %% dead lenslets\n\n"
        "Rotation up to 10 degrees, shear 0.002, perspective 0.002, k1 0.004; distances of the fitted grid to the "
        "truth in px, over all lenslets "
        "inside the frame; time is CPU time of one thread, the frame in memory, nothing warmed up.\n\n"
        "| frame | found of complete | invented | RMS | max | model | ms |\n|---|---|---|---|---|---|---|\n");
    for (const bool hexagonal : {false, true}) {
        for (const double pitch : {14.3, 22.7, 49.6}) {
            for (const double sign : {1.0, -1.0}) {
                White white;
                white.width_px = white.height_px = 5000;
                white.hexagonal = hexagonal;
                white.pitch_px = pitch;
                white.rotation_deg = sign * (hexagonal ? 7.3 : 9.8);
                white.shear = 0.002 * sign;
                white.perspective_x = 0.002;
                white.perspective_y = -0.002 * sign;
                white.k1 = 0.004 * sign;
                white.dead_share = 0.02;
                const std::string name = std::string(hexagonal ? "hexagonal " : "square ") +
                    std::to_string(pitch).substr(0, 4) + " px, " + std::to_string(white.rotation_deg).substr(0, 4) +
                    " degrees";
                synthetic_row(name.c_str(), white);
                if (sign > 0) {
                    white.vignetting = 0.2;
                    synthetic_row((name + ", 20 % vignetting in the corners' lenslets").c_str(), white);
                }
            }
        }
    }
}

void photographs(const std::filesystem::path& folder) {
    std::printf(
        "\n## Photographs\n\nCross-validated over blocks of lenslets that the model has not seen, px an axis (x / y). "
        "`whole` lenslets have their whole "
        "window in the frame and light reaches them whole (on the sensors behind a telescope's pupil it does not reach "
        "all). `displaced` ones were found off the model, by "
        "both halves of their light, and have a place of their own; `rejected` ones do not fit otherwise. Where both "
        "halves of the lenslets' light ask for it, each lenslet has its own place; `with single lenslets` is how well "
        "another frame "
        "would be predicted then.\n\n"
        "| frame | lattice | pitch | found | found of whole | displaced | rejected | cross-validated | model | with "
        "single lenslets | warned of |\n|---|---|---|---|---|---|---|---|---|---|---|\n");
    for (const char* name : {"lf_sq_napariLF_white", "lf_sq_napariLF_object", "sh_sq_mmt_LED", "sh_sq_mmt_binospec_ref",
                             "sh_sq_mmt_f5hecto_ref", "sh_sq_mmt_mmirs1_ref", "sh_hex_mmt_f9_ref", "sh_sq_yuuto",
                             "sh_bad_mmt_mmirs_blank", "sh_bad_mmt_mmirs_bogus"}) {
        real_row(folder, name);
    }
}

}  // namespace

int main(int count, char** arguments) {
    const std::filesystem::path folder = count > 1 ? arguments[1] : HORD_SOURCE_DIR "/../shared/data";
    const std::string part = count > 2 ? arguments[2] : "";
    if (part.empty() || part == "synthetic") synthetic();
    if (part.empty() || part == "answers") answers();
    if (part.empty() || part == "photographs") photographs(folder);
    return 0;
}
