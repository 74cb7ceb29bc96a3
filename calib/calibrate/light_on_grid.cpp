#include "calib/calibrate/light_on_grid.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <numbers>
#include <numeric>

#include "algo/simd/multiversion.h"
#include "calib/calibrate/frame_regions.h"
#include "common/statistics.h"

namespace hord::calib {
namespace {

using algo::PixelPoint;

constexpr double kMinBrightOfRegion = 0.25;  // bright pixels of a region that is judged, over those of a typical one

// The pixels of single rows that lie in the cells of measured lenslets: within half a diagonal of their centres.
class Cells {
  public:
    Cells(const GridCalibration& calibration, int width, int height)
        : reach_(calibration.lattice.pitch_px() / std::numbers::sqrt2), width_(width),
          first_(static_cast<std::size_t>(height) + 1), bits_((static_cast<std::size_t>(width) + 63) / 64) {
        // The centres by the row of pixels they lie in.
        const auto row_of = [&](const Observation& seen) {
            return static_cast<std::size_t>(std::clamp(static_cast<int>(seen.centre_px.y_px), 0, height - 1));
        };
        for (const Observation& seen : calibration.observations) ++first_[row_of(seen) + 1];
        std::partial_sum(first_.begin(), first_.end(), first_.begin());
        std::vector<std::size_t> next = first_;
        centres_.resize(calibration.observations.size());
        for (const Observation& seen : calibration.observations) centres_[next[row_of(seen)]++] = seen.centre_px;
    }

    // One bit a pixel of row y, 64 a word, the first pixel lowest. Valid until the next call.
    const std::vector<std::uint64_t>& of_row(int y) {
        std::fill(bits_.begin(), bits_.end(), 0);
        const int rows = static_cast<int>(first_.size()) - 1, most = static_cast<int>(reach_) + 1;
        const auto first = first_[static_cast<std::size_t>(std::max(0, y - most))];
        const auto last = first_[static_cast<std::size_t>(std::min(rows, y + most + 1))];
        for (std::size_t k = first; k < last; ++k) {
            const double dy = y - centres_[k].y_px, left = reach_ * reach_ - dy * dy;
            if (left < 0) continue;
            const double half = std::sqrt(left);
            const int from = std::max(0, static_cast<int>(std::ceil(centres_[k].x_px - half)));
            const int to = std::min(width_ - 1, static_cast<int>(std::floor(centres_[k].x_px + half)));
            mark(from, to);
        }
        return bits_;
    }
    // The same, of the pixels within the square in each cell only: no square roots. Half a pitch, less what rounding
    // may add to a place, so that no pixel beside the cells is marked.
    const std::vector<std::uint64_t>& squares_of_row(int y) {
        std::fill(bits_.begin(), bits_.end(), 0);
        const double half = reach_ / std::numbers::sqrt2 - kRounding;
        if (half < 1) return bits_;
        // Of a centre in row r the distance is between y - r - 1 and y - r.
        const int rows = static_cast<int>(first_.size()) - 1, above = static_cast<int>(half), below = above - 1;
        const auto first = first_[static_cast<std::size_t>(std::max(0, y - above))];
        const auto last = first_[static_cast<std::size_t>(std::min(rows, y + below + 1))];
        for (std::size_t k = first; k < last; ++k)
            mark(std::max(0, static_cast<int>(centres_[k].x_px - half) + 1),
                 std::min(width_ - 1, static_cast<int>(centres_[k].x_px + half)));
        return bits_;
    }
    [[nodiscard]] static bool has(const std::vector<std::uint64_t>& bits, int x) {
        return (bits[static_cast<std::size_t>(x) / 64] >> (x & 63) & 1U) != 0;
    }

  private:
    static constexpr double kRounding = 0.01;  // px

    void mark(int from, int to) {
        for (int x = from; x <= to; x = (x | 63) + 1) {
            const int count = std::min(to, x | 63) - x + 1;
            bits_[static_cast<std::size_t>(x) / 64] |= ~std::uint64_t{0} >> (64 - count) << (x & 63);
        }
    }

    double reach_;
    int width_;
    std::vector<std::size_t> first_;  // of centres_, one a row and the end
    std::vector<PixelPoint> centres_;
    std::vector<std::uint64_t> bits_;
};

// Pixels of a row from x on, up to `end`, with `bright` light or more; and those of them in cells.
struct Bright {
    std::size_t all = 0, on_grid = 0;
};
Bright count_bright(const float* row, const std::vector<std::uint64_t>& cells, int x, int end, float bright) {
    using Lights = algo::Vector<float, 16>;
    using Lanes = algo::Vector<std::int32_t, 16>;
    Bright out;
    const auto one = [&] {
        if (!(row[x] >= bright)) return;
        ++out.all;
        if (Cells::has(cells, x)) ++out.on_grid;
    };
    for (; x < end && x % 4 != 0; ++x) one();
    constexpr Lanes kLane{1, 2, 4, 8};
    Lanes all{}, on_grid{};
    for (; x + 4 <= end; x += 4) {
        const Lanes lit = algo::load<Lights>(row + x) >= bright;  // -1 where true
        const auto four = static_cast<std::int32_t>(cells[static_cast<std::size_t>(x) / 64] >> (x & 63) & 0xFU);
        all -= lit;
        on_grid -= lit & ((four & kLane) != 0);
    }
    for (int lane = 0; lane < 4; ++lane) {
        out.all += static_cast<std::size_t>(all[lane]);
        out.on_grid += static_cast<std::size_t>(on_grid[lane]);
    }
    for (; x < end; ++x) one();
    return out;
}

// Half the light of the measured lenslets: between dark and bright pixels of their cells. Of high frames only some rows
// are read, at distances without a period, because the lenslets have one.
float half_light(const WhiteImage& image, Cells& cells) {
    constexpr int kRows = 512;
    const int width = image.width_px(), height = image.height_px(), rows = std::min(height, kRows);
    std::vector<float> light, row(static_cast<std::size_t>(width));
    for (int k = 0; k < rows; ++k) {
        double whole = 0;
        const int y = rows == height ? k : static_cast<int>(std::modf(k * (std::numbers::phi - 1), &whole) * height);
        image.window(0, y, width, 1, row.data(), width);
        const std::vector<std::uint64_t>& bits = cells.of_row(y);
        const auto before = static_cast<std::int64_t>(y) * width;  // every third pixel of the frame
        for (int x = static_cast<int>((3 - before % 3) % 3); x < width; x += 3) {
            if (Cells::has(bits, x)) light.push_back(row[static_cast<std::size_t>(x)]);
        }
    }
    if (light.empty()) return std::numeric_limits<float>::infinity();
    const float dark = common::nth_smallest(std::span(light), light.size() * 5 / 100);
    return (dark + common::nth_smallest(std::span(light), light.size() * 95 / 100)) / 2;
}

}  // namespace

LightOnGrid light_on_grid(const WhiteImage& image, const GridCalibration& calibration) {
    const int width = image.width_px(), height = image.height_px();
    Cells cells(calibration, width, height);
    const float bright = half_light(image, cells);
    if (std::isinf(bright)) return {.share = 0, .worst = 0};
    const Regions regions(calibration);
    std::vector<std::size_t> all(regions.count()), on_grid(regions.count());
    const int border = static_cast<int>(std::ceil(1.5 * calibration.lattice.pitch_px()));
    std::vector<int> ends;  // of the columns of regions
    for (int x = border + 1; x <= width - border; ++x) {
        if (x == width - border || regions.at(x, 0) != regions.at(x - 1, 0)) ends.push_back(x);
    }
    std::vector<Bright> found(ends.size());
    // Counts the bright pixels of a row; true if all of them are `marked`.
    const auto count = [&](const std::vector<float>& light, const std::vector<std::uint64_t>& marked) {
        bool on_cells = true;
        int x = border;
        for (std::size_t k = 0; k < ends.size(); x = ends[k++]) {
            found[k] = count_bright(light.data(), marked, x, ends[k], bright);
            on_cells = on_cells && found[k].all == found[k].on_grid;
        }
        return on_cells;
    };
    std::vector<float> row(static_cast<std::size_t>(width));
    for (int y = border; y < height - border; ++y) {
        image.window(0, y, width, 1, row.data(), width);
        // Most rows have no bright pixel beside the squares.
        if (!count(row, cells.squares_of_row(y))) count(row, cells.of_row(y));
        int x = border;
        for (std::size_t k = 0; k < ends.size(); x = ends[k++]) {
            const std::size_t region = regions.at(x, y);
            all[region] += found[k].all;
            on_grid[region] += found[k].on_grid;
        }
    }
    LightOnGrid out;
    std::size_t sum = 0, sum_on_grid = 0;
    std::vector<std::size_t> sorted = all;
    const auto typical = static_cast<double>(common::upper_median(std::span(sorted)));
    for (std::size_t k = 0; k < all.size(); ++k) {
        sum += all[k];
        sum_on_grid += on_grid[k];
        const double share = all[k] > 0 ? static_cast<double>(on_grid[k]) / static_cast<double>(all[k]) : 1;
        if (static_cast<double>(all[k]) < kMinBrightOfRegion * typical || share >= out.worst) continue;
        out.worst = share;
        out.region = k;
    }
    if (sum > 0) out.share = static_cast<double>(sum_on_grid) / static_cast<double>(sum);
    return out;
}

}  // namespace hord::calib
