#include "calib/files/accept_calibration.h"

#include <algorithm>
#include <cmath>

#include <fmt/format.h>

namespace hord::calib {
namespace {

constexpr double kFewer = 0.01;  // share of the complete lenslets

// The factor by which an RMS may be larger by chance, for these numbers of independent pairs.
double chance(int fresh, int held) { return 1 + 2 * std::sqrt(0.25 / std::max(1, fresh) + 0.25 / std::max(1, held)); }

// Expected error of a lenslet's centre in another frame, px.
double expected_error(const GridFile& file) {
    const GridStatistics& s = file.statistics;
    return s.shifts.share > 0 ? std::hypot(s.shifts.left_x_px, s.shifts.left_y_px)
                              : std::hypot(s.cv_x_rms_px, s.cv_y_rms_px);
}

bool is_named(const std::string& camera) { return !camera.empty() && camera != kUnnamedCamera; }

double share_found(const GridStatistics& s) {
    return s.complete > 0 ? static_cast<double>(s.found - s.rejected) / s.complete : 0;
}

}  // namespace

Result<void> accept_calibration(const GridFile& fresh, const GridFile& held) {
    const auto worse = [](std::string what, const char* cure) {
        return fail(ErrorCode::refused, std::move(what), cure);
    };
    const std::string& camera = held.stamp.camera;
    if (is_named(camera) && fresh.stamp.camera != camera) {
        if (!is_named(fresh.stamp.camera))
            return worse(fmt::format("the calibration in its place is of camera {}, this one names no camera", camera),
                         "give its name with --camera, another --out for another camera, or --force");
        return worse(fmt::format("the calibration in its place is of camera {}, this one of camera {}", camera,
                                 fresh.stamp.camera),
                     "give another --out: each camera has a calibration of its own; or, if this camera takes the place "
                     "of the other, --force");
    }
    if (fresh.grid.width_px != held.grid.width_px || fresh.grid.height_px != held.grid.height_px) {
        return worse(fmt::format("the calibration in its place is of frames of {}x{} px, this one of {}x{} px",
                                 held.grid.width_px, held.grid.height_px, fresh.grid.width_px, fresh.grid.height_px),
                     "give another --out, or --force");
    }
    if (fresh.grid.kind != held.grid.kind) {
        return worse(fmt::format("the calibration in its place is of a {} lattice, this one of a {} one",
                                 name_of(held.grid.kind), name_of(fresh.grid.kind)),
                     "give another --out for another array, or --force");
    }
    const GridStatistics& a = fresh.statistics;
    const GridStatistics& b = held.statistics;
    const double is = expected_error(fresh);
    const double was = expected_error(held);
    if (is > chance(a.blocks, b.blocks) * was) {
        return worse(fmt::format("the calibration in its place is better: unseen lenslets are predicted to {:.4f} px "
                                 "by it, to {:.4f} px by this one",
                                 was, is),
                     "record a better white frame, or give --force");
    }
    if (share_found(a) < share_found(b) - kFewer) {
        return worse(fmt::format("the calibration in its place measured {:.1f} % of the lenslets, this one {:.1f} %",
                                 100 * share_found(b), 100 * share_found(a)),
                     "record a better white frame, or give --force");
    }
    if (!held.directions) return {};
    if (!fresh.directions)
        return worse("the calibration in its place has a direction map, this one has none", "give --tilts, or --force");
    const DirectionStatistics& c = fresh.direction_statistics;
    const DirectionStatistics& d = held.direction_statistics;
    const double left_out = std::hypot(c.left_out_x_px, c.left_out_y_px);
    const double left_out_before = std::hypot(d.left_out_x_px, d.left_out_y_px);
    if (left_out > chance(c.captures, d.captures) * left_out_before) {
        return worse(fmt::format("the direction map in its place is better: unseen captures are predicted to {:.4f} px "
                                 "by it, to {:.4f} px by this one",
                                 left_out_before, left_out),
                     "capture the tilts again, or give --force");
    }
    return {};
}

}  // namespace hord::calib
