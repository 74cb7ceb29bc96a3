#include "firmware/hordctl/frames/calibrate_pictures.h"

#include <algorithm>
#include <cmath>

#include <fmt/format.h>
#include <opencv2/core.hpp>
#include <opencv2/imgproc.hpp>

#include "common/cli/program.h"
#include "common/statistics.h"
#include "firmware/diagnostics/map_images.h"

namespace hord::firmware {
namespace {

constexpr int kSide = 1200;  // of a map's longer side, px
constexpr int kTitle = 64;
constexpr int kMargin = 24;
constexpr int kMaxMarks = 3600;  // lenslets of a picture: with more, a regular part is drawn
const cv::Scalar kPaper(255, 255, 255), kInk(40, 40, 40), kFaint(205, 205, 205);
const cv::Scalar kGood(60, 160, 30), kMissing(30, 30, 220), kRejected(0, 150, 255), kDisplaced(200, 60, 160);  // BGR

void text(cv::Mat& image, const std::string& what, cv::Point at, double size = 0.6, const cv::Scalar& colour = kInk) {
    cv::putText(image, what, at, cv::FONT_HERSHEY_SIMPLEX, size, colour, 1, cv::LINE_AA);
}

// Width of a text in pixels.
int width_of(const std::string& what, double size = 0.6) {
    return cv::getTextSize(what, cv::FONT_HERSHEY_SIMPLEX, size, 1, nullptr).width;
}

Picture to_picture(const cv::Mat& image) {
    const cv::Mat whole = image.isContinuous() ? image : image.clone();
    return {whole.cols, whole.rows, std::vector<unsigned char>(whole.datastart, whole.dataend)};
}

// A picture of the sensor's field, with room for a title.
struct FieldPicture {
    explicit FieldPicture(const algo::LensletGrid& grid)
        : scale(static_cast<double>(kSide) / std::max(grid.width_px, grid.height_px)),
          image(kTitle + kMargin + static_cast<int>(grid.height_px * scale),
                2 * kMargin + static_cast<int>(grid.width_px * scale), CV_8UC3, kPaper) {}
    // From the frame's pixels to the picture's.
    cv::Point at(double x_px, double y_px) const {
        return {kMargin + static_cast<int>(std::lround(x_px * scale)),
                kTitle + static_cast<int>(std::lround(y_px * scale))};
    }
    double scale;
    cv::Mat image;
};

// Step, in columns and rows, between the lenslets that are drawn.
int every_of(std::size_t lenslets) {
    return std::max(1, static_cast<int>(std::ceil(std::sqrt(static_cast<double>(lenslets) / kMaxMarks))));
}

cv::Mat draw_residuals(const calib::GridCalibration& found) {
    const algo::LensletGrid& grid = found.fit.grid;
    FieldPicture picture(grid);
    cv::Mat& image = picture.image;
    const int every = every_of(found.observations.size());
    std::vector<double> lengths;
    for (const auto& seen : found.observations) {
        const auto at = grid.at(grid.uv(seen.m, seen.n));
        if (seen.used) lengths.push_back(std::hypot(seen.centre_px.x_px - at.x_px, seen.centre_px.y_px - at.y_px));
    }
    const auto rank_98 = [&] { return static_cast<std::size_t>(0.98 * static_cast<double>(lengths.size() - 1)); };
    const double longest = lengths.empty() ? 1 : std::max(1e-6, common::nth_smallest(std::span(lengths), rank_98()));
    // The 98th percentile is drawn as long as four fifths of the step between drawn lenslets.
    const double enlarge = 0.8 * every * found.pitch_px / longest;
    cv::Mat ramp(1, 256, CV_8U), colours;
    for (int k = 0; k < 256; ++k)
        ramp.at<unsigned char>(0, k) = static_cast<unsigned char>(k * 9 / 10);  // viridis without its pale end
    cv::applyColorMap(ramp, colours, cv::COLORMAP_VIRIDIS);
    for (const auto& seen : found.observations) {
        if (seen.m % every != 0 || seen.n % every != 0) continue;
        const auto at = grid.at(grid.uv(seen.m, seen.n));
        const cv::Point from = picture.at(at.x_px, at.y_px);
        if (!seen.used) {
            cv::drawMarker(image, from, seen.displaced ? kDisplaced : kRejected, cv::MARKER_TILTED_CROSS, 7, 1,
                           cv::LINE_AA);
            continue;
        }
        const double dx = seen.centre_px.x_px - at.x_px, dy = seen.centre_px.y_px - at.y_px;
        const auto colour =
            colours.at<cv::Vec3b>(0, static_cast<int>(255 * std::min(1.0, std::hypot(dx, dy) / longest)));
        cv::arrowedLine(image, from, picture.at(at.x_px + enlarge * dx, at.y_px + enlarge * dy),
                        cv::Scalar(colour[0], colour[1], colour[2]), 1, cv::LINE_AA, 0, 0.3);
    }
    const auto& fit = found.fit;
    text(image,
         fmt::format("Residuals of {}: {:.4f} / {:.4f} px rms (x / y), {:.3f} px at most; arrows {:.0f} times enlarged",
                     name_of(fit.grid.model), fit.rms_x_px, fit.rms_y_px, fit.max_px, enlarge),
         {kMargin, 26});
    text(image,
         fmt::format(
             "{} lenslets fitted{}; crosses: {} displaced, with a place of their own (violet), {} rejected, {} of them "
             "for the shape of their light (orange)",
             fit.used, every > 1 ? fmt::format(", every {}th column and row drawn", every) : "", fit.displaced,
             fit.rejected, found.blemished),
         {kMargin, 50}, 0.5);
    return image;
}

cv::Mat draw_centres(const FrameView& white, const calib::GridCalibration& found) {
    const algo::LensletGrid& grid = found.fit.grid;
    FieldPicture picture(grid);
    cv::Mat& image = picture.image;
    const cv::Mat raw(white.height_px, white.width_px, white.bits > 8 ? CV_16U : CV_8U,
                      const_cast<std::byte*>(white.data), static_cast<std::size_t>(white.stride_bytes));
    double top = 1;
    cv::minMaxLoc(raw, nullptr, &top);
    cv::Mat grey, small;
    raw.convertTo(grey, CV_8U, 150 / std::max(top, 1.0), 40);  // dim, so that the marks stand out
    cv::resize(grey, small, {image.cols - 2 * kMargin, image.rows - kTitle - kMargin}, 0, 0,
               picture.scale < 1 ? cv::INTER_AREA : cv::INTER_NEAREST);
    cv::Mat colour;
    cv::cvtColor(small, colour, cv::COLOR_GRAY2BGR);
    colour.copyTo(image(cv::Rect(kMargin, kTitle, colour.cols, colour.rows)));
    std::vector<char> state(static_cast<std::size_t>(grid.columns) * static_cast<std::size_t>(grid.rows), 'm');
    const auto place = [&](int m, int n) {
        return static_cast<std::size_t>(n) * static_cast<std::size_t>(grid.columns) + static_cast<std::size_t>(m);
    };
    for (const auto& seen : found.observations)
        state[place(seen.m, seen.n)] = seen.used ? 'g' : seen.displaced ? 'd' : 'r';
    const auto nodes = found.nodes();
    const int every = every_of(nodes.size());
    const int size = std::clamp(static_cast<int>(0.35 * found.pitch_px * picture.scale * every), 5, 15);
    for (const auto& node : nodes) {
        const char kind = state[place(node.m, node.n)];
        if (kind == 'g' && (node.m % every != 0 || node.n % every != 0)) continue;  // draw all of the other kinds
        const cv::Scalar& ink = kind == 'g' ? kGood : kind == 'd' ? kDisplaced : kind == 'r' ? kRejected : kMissing;
        cv::drawMarker(image, picture.at(node.centre_px.x_px, node.centre_px.y_px), ink,
                       kind == 'g' ? cv::MARKER_CROSS : cv::MARKER_TILTED_CROSS, size, kind == 'g' ? 1 : 2,
                       cv::LINE_AA);
    }
    text(image,
         fmt::format("{} lattice, pitch {:.3f} px, turned by {:.3f} degrees", name_of(grid.kind), found.pitch_px,
                     found.rotation_rad * 180 / 3.14159265358979323846),
         {kMargin, 26});
    text(image, fmt::format("green: {} fit", found.found - found.rejected - found.displaced), {kMargin, 50}, 0.5,
         kGood);
    text(image, fmt::format("violet: {} displaced", found.displaced), {kMargin + 170, 50}, 0.5, kDisplaced);
    text(image, fmt::format("orange: {} rejected ({} for dust)", found.rejected, found.blemished), {kMargin + 380, 50},
         0.5, kRejected);
    text(image, "red: without a centre (missing, or cut by the frame's rim)", {kMargin + 650, 50}, 0.5, kMissing);
    return image;
}

cv::Mat draw_models(const calib::GridCalibration& found) {
    const auto& candidates = found.fit.candidates;
    constexpr int kRow = 64, kLeft = 310, kBar = 640, kTop = 90;
    constexpr double kVerdictSize = 0.42;
    const std::string title =
        "Error on lenslets that a model has not seen, px (both axes together, rms over blocks left out; single "
        "lenslets: of another frame)";
    int width = std::max(kLeft + kBar + 170, width_of(title) + 2 * kMargin);
    for (const auto& model : candidates)
        width = std::max(width, kLeft + width_of(model.verdict, kVerdictSize) + kMargin);
    cv::Mat image(kTop + kRow * static_cast<int>(candidates.size()) + 50, width, CV_8UC3, kPaper);
    const auto error_of = [](const auto& model) {  // 0: not known
        const double error = std::hypot(model.cv_x_rms_px, model.cv_y_rms_px);
        return std::isfinite(error) ? error : 0;
    };
    double low = 1e9, high = 1e-9;
    for (const auto& model : candidates) {
        const double error = error_of(model);
        if (error == 0) continue;
        low = std::min(low, error);
        high = std::max(high, error);
    }
    // Whole decades around the values.
    const double first = std::floor(std::log10(low) - 0.1), last = std::max(first + 1, std::ceil(std::log10(high)));
    const auto x_of = [&](double error) {
        return kLeft + static_cast<int>(std::lround(kBar * (std::log10(error) - first) / (last - first)));
    };
    text(image, title, {kMargin, 28});
    text(image, found.fit.reason.substr(0, found.fit.reason.find(';')), {kMargin, 54}, 0.45);
    const int bottom = kTop + kRow * static_cast<int>(candidates.size());
    for (double decade = first; decade <= last; decade += 1) {
        const int x = x_of(std::pow(10, decade));
        cv::line(image, {x, kTop - 14}, {x, bottom}, kFaint, 1);
        text(image, fmt::format("{:g}", std::pow(10, decade)), {x - 18, bottom + 24}, 0.5);
    }
    for (std::size_t k = 0; k < candidates.size(); ++k) {
        const auto& model = candidates[k];
        const int y = kTop + kRow * static_cast<int>(k);
        const cv::Scalar ink = model.chosen ? kGood : cv::Scalar(180, 140, 90);
        text(image, fmt::format("{} ({})", name_of(model), model.parameters), {kMargin, y + 20}, 0.5,
             model.chosen ? kGood : kInk);
        text(image, model.verdict, {kLeft + 4, y + 42}, kVerdictSize);
        const double error = error_of(model);
        if (error == 0) continue;
        cv::rectangle(image, {kLeft, y + 6}, {std::max(kLeft + 2, x_of(error)), y + 26}, ink, cv::FILLED);
        text(image, fmt::format("{:.4f}", error), {x_of(error) + 8, y + 22}, 0.5);
    }
    return image;
}

}  // namespace

Result<void> write_calibration_pictures(const std::filesystem::path& folder, const FrameView& white,
                                        const calib::GridCalibration& found) {
    if (auto made = make_folder(folder); !made) return made;
    try {
        const std::pair<const char*, cv::Mat> pictures[] = {{"residuals.png", draw_residuals(found)},
                                                            {"centres.png", draw_centres(white, found)},
                                                            {"models.png", draw_models(found)}};
        for (const auto& [name, image] : pictures) {
            if (auto done = write_png(folder / name, to_picture(image)); !done) return done;
        }
    } catch (const cv::Exception& problem) {
        return fail(ErrorCode::internal, "pictures of the calibration cannot be drawn: " + problem.err,
                    "leave --pictures away, and report this");
    }
    return {};
}

}  // namespace hord::firmware
