#include "firmware/diagnostics/map_images.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <utility>

#include <fmt/format.h>
#include <opencv2/core.hpp>
#include <opencv2/imgproc.hpp>

#include "common/statistics.h"
#include "firmware/diagnostics/drawing.h"
#include "firmware/diagnostics/map_marks.h"

namespace hord::firmware {
namespace {

constexpr int kScaleWidth = 118, kBareScaleWidth = 76;  // without room for the limit and the unit
constexpr int kAxisWidth = 40, kAxisHeight = 34;        // left of the map, below it
constexpr int kLineHeight = 18;                         // of the legend

// Levels from 0 to 255 as colours.
cv::Mat colours_of(const cv::Mat& levels, const MapPicture& what) {
    cv::Mat colours;
    if (what.grey) cv::cvtColor(levels, colours, cv::COLOR_GRAY2BGR);
    else cv::applyColorMap(levels, colours, cv::COLORMAP_VIRIDIS);
    return colours;
}

// The colour scale right of the map, with ticks, unit and the limit.
void draw_scale(cv::Mat& sheet, const MapPicture& what, int from, int top, int height) {
    const auto px = [&](int of) { return scaled(of, what.letters); };
    const double size = 0.36 * what.letters;
    const int left = from + 8, right = left + px(14);
    cv::Mat ramp(height, 1, CV_8U);
    for (int y = 0; y < height; ++y)
        ramp.at<unsigned char>(y) = static_cast<unsigned char>(255 - 255 * y / std::max(1, height - 1));
    cv::resize(colours_of(ramp, what), sheet(cv::Rect(left, top, px(14), height)), cv::Size(px(14), height), 0, 0,
               cv::INTER_NEAREST);
    const bool marked = what.limit != 0 && what.limit >= what.low && what.limit <= what.high;
    const auto place = [&](float value) {
        return top +
            static_cast<int>(
                   std::lround(static_cast<float>(height - 1) * (what.high - value) / (what.high - what.low)));
    };
    const auto text_at = [&](int y) { return std::clamp(y + px(4), top + px(9), top + height - 1); };
    constexpr int kTicks = 4, kApart = 13;
    for (int k = 0; k <= kTicks; ++k) {
        const float value = what.high + (what.low - what.high) * static_cast<float>(k) / kTicks;
        const int y = place(value);
        cv::line(sheet, {right, y}, {right + px(4), y}, kInk);
        if (marked && std::abs(text_at(y) - text_at(place(what.limit))) < px(kApart)) continue;
        write_text(sheet, fmt::format("{:.3g}", value), {right + px(7), text_at(y)}, size);
    }
    if (marked) {
        const int y = place(what.limit);
        const std::string text = what.limit_text.empty() ? fmt::format("limit {:.3g}", what.limit) : what.limit_text;
        cv::line(sheet, {left - 3, y}, {right + px(6), y}, kPaper, 3);
        cv::line(sheet, {left - 3, y}, {right + px(6), y}, kMark, 1);
        write_text(sheet, text, {right + px(9), text_at(y)}, fitting(text, px(kScaleWidth - 32), size), kMark);
    }
    write_text(sheet, what.unit, {left - 4, top - px(8)}, fitting(what.unit, px(kScaleWidth - 6), size));
}

// The smallest of 1, 2, 5, 10, ... times a power of ten that makes at most `most` steps of `range`.
double nice_step(double range, int most) {
    double step = std::pow(10, std::floor(std::log10(range / most)));
    for (const double factor : {2.0, 2.5, 2.0}) {
        if (range / step <= most) break;
        step *= factor;
    }
    return step;
}

struct Tick {
    double lenslet;  // from the first one that is shown
    std::string text;
};

// The ticks of an axis over `count` lenslets.
std::vector<Tick> ticks_of(int count, int first, float lenslet_mm) {
    constexpr int kMax = 6;
    std::vector<Tick> ticks;
    if (lenslet_mm <= 0) {
        const int step = std::max(1, static_cast<int>(nice_step(count, kMax)));
        for (int at = (first + step - 1) / step * step; at < first + count; at += step)
            ticks.push_back({static_cast<double>(at - first), std::to_string(at)});
        return ticks;
    }
    const double pitch = static_cast<double>(lenslet_mm), middle = 0.5 * (count - 1),
                 step = nice_step(count * pitch, kMax);
    const int most = static_cast<int>(middle * pitch / step);
    for (int k = -most; k <= most; ++k) ticks.push_back({middle + k * step / pitch, fmt::format("{:g}", k * step)});
    return ticks;
}

// Axes left of the map and below it.
void draw_axes(cv::Mat& sheet, const MapPicture& what, const algo::Extents& extents, const cv::Rect& map, int zoom) {
    const auto pixel = [&](double lenslet) { return static_cast<int>((lenslet + 0.5) * zoom); };
    const auto width = [](const std::string& text) {
        return cv::getTextSize(text, cv::FONT_HERSHEY_SIMPLEX, 0.36, 1, nullptr).width;
    };
    const int below = map.y + map.height;
    for (const Tick& tick : ticks_of(extents.m, what.first_m, what.lenslet_mm)) {
        const int x = map.x + pixel(tick.lenslet);
        cv::line(sheet, {x, below}, {x, below + 4}, kInk);
        write_text(sheet, tick.text, {x - width(tick.text) / 2, below + 15}, 0.36);
    }
    for (const Tick& tick : ticks_of(extents.n, what.first_n, what.lenslet_mm)) {
        const int y = map.y + pixel(tick.lenslet);
        cv::line(sheet, {map.x - 5, y}, {map.x - 1, y}, kInk);
        write_text(sheet, tick.text, {map.x - 8 - width(tick.text), y + 4}, 0.36);
    }
    const std::string across = what.lenslet_mm > 0 ? "x, mm" : "lenslet m", down = what.lenslet_mm > 0 ? "y, mm" : "n";
    write_text(sheet, across, {map.x + (map.width - width(across)) / 2, below + 29}, 0.36);
    write_text(sheet, down, {2, below + 15}, 0.36);
}

// Why a lenslet has no value, or is not judged; `none`: it has one that is judged.
enum class NoData : std::uint8_t { none, dark, saturated, border, outside, other, not_judged };
constexpr std::size_t kNoDatas = 7;

NoData no_data_of(const MapPicture& what, float value, std::uint8_t bits) {
    const auto missing = static_cast<std::uint8_t>(bits & what.no_value);
    if ((missing & algo::kSaturated) != 0) return NoData::saturated;
    if ((missing & algo::kDark) != 0) return NoData::dark;
    if ((missing & algo::kBorder) != 0) return NoData::border;
    if ((missing & algo::kOutside) != 0) return NoData::outside;
    if (missing != 0 || !std::isfinite(value)) return NoData::other;
    return (bits & what.not_judged) != 0 ? NoData::not_judged : NoData::none;
}

// Grey with diagonal lines. The colour map has no grey.
cv::Vec3b hatch(NoData reason, int x, int y) {
    const bool line = (x + y) % 6 < 2;
    switch (reason) {
        case NoData::dark: return line ? cv::Vec3b(110, 110, 110) : cv::Vec3b(60, 60, 60);
        case NoData::saturated: return line ? cv::Vec3b(190, 190, 190) : cv::Vec3b(245, 245, 245);
        default: return line ? cv::Vec3b(120, 120, 120) : cv::Vec3b(170, 170, 170);
    }
}

cv::Vec3b dimmed(const cv::Vec3b& colour) {
    cv::Vec3b out;
    for (int channel = 0; channel < 3; ++channel) out[channel] = static_cast<unsigned char>(colour[channel] / 2 + 60);
    return out;
}

constexpr const char* text_of(NoData reason) {
    switch (reason) {
        case NoData::dark: return "no value: dark";
        case NoData::saturated: return "no value: saturated";
        case NoData::border: return "no value: border, nothing to compare";
        case NoData::outside: return "no value: outside";
        case NoData::not_judged: return "dimmed: rim or outside, not judged";
        default: return "no value";
    }
}

// The map at a pixel a lenslet in the colour map, enlarged, with its lenslets without data hatched; marks in `occurs`
// what the legend has to explain.
cv::Mat coloured(const MapPicture& what, algo::Map map, std::span<const std::uint8_t> mask,
                 const algo::Extents& extents, int zoom, std::array<bool, kNoDatas>& occurs) {
    cv::Mat level(extents.n, extents.m, CV_8U), reason(extents.n, extents.m, CV_8U);
    for (int n = 0; n < extents.n; ++n) {
        for (int m = 0; m < extents.m; ++m) {
            const std::size_t k = extents.index(m, n);
            const NoData no_data = no_data_of(what, map[k], mask[k]);
            occurs[static_cast<std::size_t>(no_data)] = true;
            reason.at<unsigned char>(n, m) = static_cast<unsigned char>(no_data);
            const float share = std::isfinite(map[k]) ? (map[k] - what.low) / (what.high - what.low) : 0.0F;
            level.at<unsigned char>(n, m) =
                static_cast<unsigned char>(std::lround(255.0F * std::clamp(share, 0.0F, 1.0F)));
        }
    }
    cv::Mat picture;
    cv::resize(colours_of(level, what), picture, {}, zoom, zoom, cv::INTER_NEAREST);
    for (int y = 0; y < picture.rows; ++y) {
        for (int x = 0; x < picture.cols; ++x) {
            const auto no_data = static_cast<NoData>(reason.at<unsigned char>(y / zoom, x / zoom));
            auto& pixel = picture.at<cv::Vec3b>(y, x);
            if (no_data == NoData::not_judged) pixel = dimmed(pixel);
            else if (no_data != NoData::none) pixel = hatch(no_data, x, y);
        }
    }
    return picture;
}

// A line of the legend at `y`: a swatch and its words.
void draw_legend(cv::Mat& sheet, NoData reason, int left, int y) {
    constexpr int kSide = 12;
    for (int dy = 0; dy < kSide; ++dy) {
        for (int dx = 0; dx < kSide; ++dx) {
            sheet.at<cv::Vec3b>(y + dy, left + dx) =
                reason == NoData::not_judged ? dimmed({140, 145, 33}) : hatch(reason, dx, dy);  // viridis, its middle
        }
    }
    cv::rectangle(sheet, {left, y}, {left + kSide, y + kSide}, kInk);
    write_text(sheet, text_of(reason), {left + kSide + 6, y + 10}, 0.36);
}

}  // namespace

MapPicture scale_to(std::string title, std::string unit, algo::Map map, std::span<const std::uint8_t> mask,
                    float limit) {
    std::vector<float> judged;
    for (std::size_t k = 0; k < map.size(); ++k) {
        if (mask[k] == algo::kValid) judged.push_back(map[k]);
    }
    float low = 0, high = limit;
    if (!judged.empty()) {
        low = std::min(low, *std::min_element(judged.begin(), judged.end()));
        high = std::max(high, common::nth_smallest(std::span(judged), (judged.size() - 1) * 999 / 1000));
    }
    if (!(high > low)) high = low + 1;
    return {std::move(title), std::move(unit), low, high, limit};
}

MapPicture scale_to(std::string title, const FeatureView& view, const algo::Recipe& recipe) {
    std::vector<std::uint8_t> judged(view.mask.size());
    for (std::size_t k = 0; k < judged.size(); ++k) judged[k] = view.is_judged(k) ? algo::kValid : algo::kOutside;
    MapPicture picture = scale_to(std::move(title), view.unit, view.map, judged, view.limit);
    picture.limit_text = view.limit_text;
    picture.no_value = view.no_value;
    picture.not_judged = view.is_light ? std::uint8_t{0} : view.not_judged;
    picture.lenslet_mm = recipe.lenslet_mm;
    picture.grey = view.is_light;
    return picture;
}

Picture draw(const MapPicture& what, algo::Map map, std::span<const std::uint8_t> mask, const algo::Extents& extents,
             std::span<const algo::Defect> defects, std::span<const std::string> labels, const std::string& caption) {
    const int zoom = enlargement(std::max(extents.m, extents.n));
    std::array<bool, kNoDatas> occurs{};
    cv::Mat map_picture = coloured(what, map, mask, extents, zoom, occurs);
    draw_defects(map_picture, defects, labels, zoom);
    occurs[static_cast<std::size_t>(NoData::none)] = false;

    const bool some_hidden = defects.size() > kMaxMarked;
    const auto px = [&](int of) { return scaled(of, what.letters); };
    const int left = what.axes ? kAxisWidth : 0, title_height = px(kTitleHeight);
    const int legend = what.axes ? static_cast<int>(std::ranges::count(occurs, true)) + (some_hidden ? 1 : 0) : 0;
    const int foot = (what.axes ? kAxisHeight + legend * kLineHeight : 0) + (caption.empty() ? 0 : px(kTitleHeight));
    const int scale_width = px(what.axes ? kScaleWidth : kBareScaleWidth);
    cv::Mat sheet(map_picture.rows + title_height + foot, left + map_picture.cols + scale_width, CV_8UC3, kPaper);
    const cv::Rect place(left, title_height, map_picture.cols, map_picture.rows);
    map_picture.copyTo(sheet(place));
    const std::string title = what.unit.empty() ? what.title : what.title + ", " + what.unit;
    write_text(sheet, title, {4, px(18)}, fitting(title, left + map_picture.cols - 12, 0.5 * what.letters));
    draw_scale(sheet, what, place.x + place.width, title_height, map_picture.rows);
    if (what.axes) draw_axes(sheet, what, extents, place, zoom);
    int y = place.y + place.height + kAxisHeight;
    for (std::size_t reason = 0; what.axes && reason < occurs.size(); ++reason) {
        if (!occurs[reason]) continue;
        draw_legend(sheet, static_cast<NoData>(reason), kAxisWidth, y + 2);
        y += kLineHeight;
    }
    if (what.axes && some_hidden) {
        write_text(sheet, fmt::format("{} of {} defects shown", kMaxMarked, defects.size()), {kAxisWidth, y + 12}, 0.4,
                   kMark);
    }
    if (!caption.empty()) {
        write_text(sheet, caption, {4, sheet.rows - 8}, fitting(caption, sheet.cols - 8, 0.5 * what.letters));
    }
    return to_picture(sheet);
}

PicturePoint point_in_picture(const algo::Extents& extents, float m, float n) {
    const auto zoom = static_cast<float>(enlargement(std::max(extents.m, extents.n)));
    return {kAxisWidth + static_cast<int>((m + 0.5F) * zoom), kTitleHeight + static_cast<int>((n + 0.5F) * zoom)};
}

PictureBox mark_in_picture(const algo::Extents& extents, std::span<const algo::Defect> defects,
                           std::span<const std::string> labels, std::size_t k) {
    const int zoom = enlargement(std::max(extents.m, extents.n));
    const Mark mark = marks_of(defects, labels, zoom, {extents.m * zoom, extents.n * zoom}).at(k);
    const cv::Point reach(mark.radius + 5, mark.radius + 5);  // with the outline of the circle
    const cv::Point outline(kLabelOutline, kLabelOutline);
    const cv::Rect all = cv::Rect(mark.centre - reach, mark.centre + reach) |
        cv::Rect(mark.text.tl() - outline, mark.text.br() + outline);
    return {all.x + kAxisWidth, all.y + kTitleHeight, all.width, all.height};
}

}  // namespace hord::firmware
