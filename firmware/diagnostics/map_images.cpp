#include "firmware/diagnostics/map_images.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <utility>

#include <fmt/format.h>
#include <nlohmann/json.hpp>
#include <opencv2/core.hpp>
#include <opencv2/imgproc.hpp>

#include "common/file_writing.h"
#include "common/png_codec.h"
#include "common/statistics.h"
#include "common/tiff_codec.h"

namespace hord::firmware {
namespace {

constexpr int kMapSide = 444;  // pictures are enlarged until their longer side has at least this many pixels
constexpr int kTitleHeight = 26;
constexpr int kScaleWidth = 118, kBareScaleWidth = 76;  // without room for the limit and the unit
constexpr int kAxisWidth = 40, kAxisHeight = 34;        // left of the map, below it
constexpr int kLineHeight = 18;                         // of the legend
const cv::Scalar kInk(40, 40, 40);
const cv::Scalar kPaper(255, 255, 255);
const cv::Scalar kMark(40, 40, 230);  // of defects and limits

// Levels from 0 to 255 as colours.
cv::Mat colours_of(const cv::Mat& levels, const MapPicture& what) {
    cv::Mat colours;
    if (what.grey) cv::cvtColor(levels, colours, cv::COLOR_GRAY2BGR);
    else cv::applyColorMap(levels, colours, cv::COLORMAP_VIRIDIS);
    return colours;
}

int enlargement(int side) { return std::max(1, (kMapSide + side - 1) / side); }

int thickness(double size) { return std::max(1, static_cast<int>(std::lround(1.6 * size))); }

void write_text(cv::Mat& image, const std::string& text, cv::Point at, double size, const cv::Scalar& colour = kInk) {
    cv::putText(image, text, at, cv::FONT_HERSHEY_SIMPLEX, size, colour, thickness(size), cv::LINE_AA);
}

int scaled(int px, float letters) { return static_cast<int>(std::lround(static_cast<float>(px) * letters)); }

// Largest text size up to `size` at which `text` fits into `width` pixels.
double fitting(const std::string& text, int width, double size) {
    int baseline = 0;
    const int needed = cv::getTextSize(text, cv::FONT_HERSHEY_SIMPLEX, size, 1, &baseline).width;
    return needed <= width ? size : size * width / needed;
}

Picture to_picture(const cv::Mat& image) {
    Picture picture{image.cols, image.rows, {}};
    picture.bgr.assign(image.datastart, image.dataend);
    return picture;
}

cv::Mat to_mat(const Picture& picture) {
    return {picture.height, picture.width, CV_8UC3, const_cast<unsigned char*>(picture.bgr.data())};
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

constexpr int kLetters = 12, kDescent = 5, kOutline = 3;  // px, of a label

// Circle and label of a defect, in pixels of the enlarged map.
struct Mark {
    cv::Point centre;
    int radius = 0;
    std::string label;
    cv::Rect text;  // the letters of the label; its base line is kDescent above the lower edge

    [[nodiscard]] cv::Rect circle() const { return {centre.x - radius, centre.y - radius, 2 * radius, 2 * radius}; }
};

// The label of mark `k` is beside its circle, or below it where the map ends. Where it would cover a circle or an
// earlier label, it takes the next free line below or above, if there is one.
void place_label(std::span<Mark> marks, std::size_t k, const cv::Size& map) {
    constexpr int kLine = kLetters + kDescent, kMaxLines = 8;
    Mark& mark = marks[k];
    const int right = mark.centre.x + mark.radius + 3,
              left = std::max(0, std::min(right, map.width - mark.text.width - 2));
    const bool beside = left == right;
    const int down = mark.centre.y + (beside ? 4 - kLetters : mark.radius + 2),
              up = beside ? down - kLine : mark.centre.y - mark.radius - 2 - kLine;
    const auto is_free = [&](int top) {
        mark.text.y = top;
        if (top < 0 || top + kLine > map.height) return false;
        const auto covers = [&](const cv::Rect& other) { return (other & mark.text).area() > 0; };
        return std::ranges::none_of(marks, [&](const Mark& one) { return covers(one.circle()); }) &&
            std::ranges::none_of(marks.first(k), [&](const Mark& one) { return covers(one.text); });
    };
    mark.text.x = left;
    for (int line = 0; line < kMaxLines; ++line) {
        if (is_free(down + line * kLine) || is_free(up - line * kLine)) return;
    }
    mark.text.y = down;
}

// Of the defects that are marked. `map`: of the enlarged map, px.
std::vector<Mark> marks_of(std::span<const algo::Defect> defects, std::span<const std::string> labels, int zoom,
                           const cv::Size& map) {
    std::vector<Mark> marks;
    for (std::size_t k = 0; k < std::min(defects.size(), kMaxMarked); ++k) {
        Mark mark;
        mark.centre = {static_cast<int>((defects[k].m + 0.5F) * static_cast<float>(zoom)),
                       static_cast<int>((defects[k].n + 0.5F) * static_cast<float>(zoom))};
        const double radius_lenslets = std::sqrt(static_cast<double>(defects[k].area) / 3.14159) + 2.0;
        mark.radius = std::max(8, static_cast<int>(radius_lenslets * zoom));
        mark.label = k < labels.size() ? fmt::format("{} {}", k + 1, labels[k]) : std::to_string(k + 1);
        mark.text = {0, 0, cv::getTextSize(mark.label, cv::FONT_HERSHEY_SIMPLEX, 0.45, 1, nullptr).width,
                     kLetters + kDescent};
        marks.push_back(std::move(mark));
    }
    for (std::size_t k = 0; k < marks.size(); ++k) place_label(marks, k, map);
    return marks;
}

// Labels above all circles.
void draw_defects(cv::Mat& map, std::span<const algo::Defect> defects, std::span<const std::string> labels, int zoom) {
    const std::vector<Mark> marks = marks_of(defects, labels, zoom, map.size());
    for (const Mark& mark : marks) {
        cv::circle(map, mark.centre, mark.radius + 1, cv::Scalar(255, 255, 255), 3, cv::LINE_AA);
        cv::circle(map, mark.centre, mark.radius, kMark, 2, cv::LINE_AA);
    }
    for (std::size_t k = 0; k < marks.size(); ++k) {
        const cv::Point at(marks[k].text.x, marks[k].text.y + kLetters);
        if (k < labels.size()) {  // legible on any colour
            cv::putText(map, marks[k].label, at, cv::FONT_HERSHEY_SIMPLEX, 0.45, cv::Scalar(255, 255, 255), kOutline,
                        cv::LINE_AA);
        }
        write_text(map, marks[k].label, at, 0.45, kMark);
    }
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
    const cv::Point outline(kOutline, kOutline);
    const cv::Rect all = cv::Rect(mark.centre - reach, mark.centre + reach) |
        cv::Rect(mark.text.tl() - outline, mark.text.br() + outline);
    return {all.x + kAxisWidth, all.y + kTitleHeight, all.width, all.height};
}

Picture draw(const std::string& title, const FrameView& frame, const algo::Extents& extents) {
    cv::Mat samples(frame.height_px, frame.width_px, frame.bits > 8 ? CV_16U : CV_8U,
                    const_cast<std::byte*>(frame.data), static_cast<std::size_t>(frame.stride_bytes));
    // Most bins are dark: reduced and stretched to the brightest pixel, else the picture would be black.
    const int zoom = enlargement(std::max(extents.m, extents.n));
    cv::Mat reduced, resized;
    cv::resize(samples, reduced, cv::Size(extents.m * zoom, extents.n * zoom), 0, 0, cv::INTER_AREA);
    double brightest = 0;
    cv::minMaxLoc(reduced, nullptr, &brightest);
    reduced.convertTo(resized, CV_8U, brightest > 0 ? 255.0 / brightest : 0.0);
    cv::Mat sheet(resized.rows + kTitleHeight, resized.cols, CV_8UC3, kPaper);
    cv::Mat inner = sheet(cv::Rect(0, kTitleHeight, resized.cols, resized.rows));
    cv::cvtColor(resized, inner, cv::COLOR_GRAY2BGR);
    write_text(sheet, title, {4, 18}, fitting(title, resized.cols - 8, 0.5));
    return to_picture(sheet);
}

Picture montage(std::span<const MontageRow> rows, float letters) {
    constexpr int kGap = 8;
    const int label_width = scaled(110, letters);
    std::vector<int> columns;  // their widths
    int height = kGap;
    for (const MontageRow& row : rows) {
        columns.resize(std::max(columns.size(), row.pictures.size()));
        int row_height = 0;
        for (std::size_t k = 0; k < row.pictures.size(); ++k) {
            columns[k] = std::max(columns[k], row.pictures[k].width);
            row_height = std::max(row_height, row.pictures[k].height);
        }
        height += row_height + kGap;
    }
    int width = label_width + kGap;
    for (const int column : columns) width += column + kGap;
    cv::Mat sheet(height, width, CV_8UC3, kPaper);
    int y = kGap;
    for (const MontageRow& row : rows) {
        int x = label_width + kGap, row_height = 0;
        for (std::size_t k = 0; k < row.pictures.size(); ++k) {
            const Picture& picture = row.pictures[k];
            to_mat(picture).copyTo(sheet(cv::Rect(x, y, picture.width, picture.height)));
            x += columns[k] + kGap;
            row_height = std::max(row_height, picture.height);
        }
        // One word a line, so that long labels fit.
        int line = y + row_height / 2 - 8;
        for (std::size_t from = 0; from < row.label.size();) {
            const std::size_t to = std::min(row.label.find(' ', from), row.label.size());
            write_text(sheet, row.label.substr(from, to - from), {kGap, line},
                       fitting(row.label.substr(from, to - from), label_width - 4, 0.5 * letters));
            line += scaled(18, letters);
            from = to + 1;
        }
        y += row_height + kGap;
    }
    return to_picture(sheet);
}

Picture halved(const Picture& picture) {
    const cv::Mat whole(picture.height, picture.width, CV_8UC3, const_cast<unsigned char*>(picture.bgr.data()));
    cv::Mat half;
    cv::resize(whole, half, {picture.width / 2, picture.height / 2}, 0, 0, cv::INTER_AREA);
    return {half.cols, half.rows, {half.datastart, half.dataend}};
}

Result<std::vector<std::uint8_t>> encode_png(const Picture& picture) {
    return common::encode_bgr_png(picture.width, picture.height, picture.bgr);
}

Result<void> write_png(const std::filesystem::path& file, const Picture& picture) {
    return encode_png(picture).and_then([&](const auto& bytes) { return common::write_atomically(file, bytes); });
}

Result<void> write_float_tiff(const std::filesystem::path& file, algo::Map map, const algo::Extents& extents) {
    return common::encode_float_tiff(extents.m, extents.n, map).and_then([&](const auto& bytes) {
        return common::write_atomically(file, bytes);
    });
}

Result<void> write_float_tiff(const std::filesystem::path& file, const FeatureView& view,
                              const algo::Extents& extents) {
    return write_float_tiff(file, with_no_data(view.map, view.mask, view.no_value), extents);
}

namespace {

struct MaskReason {
    algo::MaskBit bit;
    const char* name;
    common::PngColour colour;
};
// The first that applies gives the colour of a mask value.
constexpr MaskReason kMaskReasons[] = {
    {algo::kSaturated, "saturated", {255, 255, 255}},
    {algo::kDark, "dark", {0, 0, 0}},
    {algo::kBorder, "border", {128, 128, 128}},
    {algo::kOutside, "outside", {60, 90, 160}},
    {algo::kRim, "rim", {130, 180, 230}},
    {algo::kAtLimit, "at-limit", {240, 160, 30}},
};
constexpr common::PngColour kJudgedColour{40, 130, 60};
constexpr unsigned kMaskValues = 64;

std::string hex(const common::PngColour& c) { return fmt::format("#{:02x}{:02x}{:02x}", c.red, c.green, c.blue); }

}  // namespace

Result<void> write_mask_png(const std::filesystem::path& file, const FeatureView& view, const algo::Extents& extents) {
    std::vector<common::PngColour> palette(kMaskValues, kJudgedColour);
    for (unsigned value = 0; value < kMaskValues; ++value) {
        const auto* reason =
            std::ranges::find_if(kMaskReasons, [&](const MaskReason& r) { return (value & r.bit) != 0; });
        if (reason != std::end(kMaskReasons)) palette[value] = reason->colour;
    }
    nlohmann::ordered_json legend{{"schema", 1}, {"feature", view.name}};
    for (const MaskReason& reason : kMaskReasons) {
        legend["bits"][reason.name] = static_cast<int>(reason.bit);
        legend["colours"][reason.name] = hex(reason.colour);
    }
    legend["colours"]["judged"] = hex(kJudgedColour);
    legend["no_value"] = static_cast<int>(view.no_value);
    legend["not_judged"] = static_cast<int>(view.not_judged);
    return common::encode_index_png(extents.m, extents.n, view.mask, palette,
                                    common::PngNote{"hord-mask", legend.dump()})
        .and_then([&](const auto& bytes) { return common::write_atomically(file, bytes); });
}

}  // namespace hord::firmware
