#include "calib/calibrate/white_frame_checks.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <complex>
#include <limits>
#include <numbers>
#include <numeric>
#include <optional>
#include <tuple>

#include <fmt/format.h>

#include "algo/simd/multiversion.h"
#include "common/statistics.h"

namespace hord::calib {
namespace {

using algo::LensletGrid;
using algo::PixelPoint;

// Of the frame's bright pixels. Light beside the grid is that of another pattern, such as through a part.
constexpr double kMinLightOnGrid = 0.85;
// The same, of one region of the frame: less means that the grid does not reach its lenslets.
constexpr double kMinLightOnGridOfRegion = 0.5;
constexpr double kMinBrightOfRegion = 0.25;  // bright pixels of a region that is judged, over those of a typical one
constexpr int kMaxRegions = 8;               // of the frame along its width and height
constexpr double kMinRegion = 4;             // pitches: side of a region

constexpr int kFewestOfRegion = 8;     // lenslets of a region that is judged
constexpr int kFewestFollowing = 100;  // residuals, for their dependence on the light
constexpr double kMaxRejected = 0.5;   // of a region's lenslets
constexpr double kMinArea = 0.15;      // of a lenslet's cell, over that in the middle: less is a fold
constexpr double kMaxTorn = 0.002;     // pairs of neighbours, over the lenslets
constexpr double kMaxWaves = 0.985;    // PatternShape
constexpr double kMaxFirst = 0.997;
constexpr double kMinEven = 0.004, kMaxEven = 0.98;
// Dark dots on a bright ground, on a square lattice (a hexagonal one has two gaps a dot, and no lattice of them): what
// was taken for lenslets are the gaps between them. Between small dots it is bright
// everywhere; round lenslets that touch leave more dark. Between large dots the gaps are stars; spots with the cross of
// diffraction are smaller.
constexpr double kMaxBetween = 0.8, kMinDark = 0.17, kMaxDarkOfStars = 0.8, kMaxStar = 0.1;
constexpr double kMaxOneSided = 0.35;  // of the light; below, centres are off by 0.06 px at the most
constexpr double kMaxRoughness = 0.08;
constexpr double kMaxFollowed = 0.3;     // of the residuals' power: what gradients of the light explain
constexpr double kMinFollowed = 0.0002;  // of a pitch: explained residuals that matter
constexpr double kMaxOff = 0.08;         // of the found lenslets
constexpr double kMaxBend = 0.005;       // of a pitch: by polynomials beyond every lens model
// Of neighbours' residuals, and in standard deviations of that of independent pairs: frames of few lenslets.
constexpr double kMaxAlike = 0.2, kMaxAlikeDeviations = 4;
constexpr double kMaxCommon = 0.0002;  // of a pitch: the common part of residuals
// CutLenslets::narrower beyond what the grid's distortion makes of it, and in its standard errors. These are too small
// by half where neighbouring regions differ from the law alike: 8 are 4 then.
constexpr double kMaxCut = 0.002, kMaxCutDeviations = 8;
constexpr double kMaxUneven = 0.012;     // CutLenslets::uneven; a real white frame has 0.9 %
constexpr double kMaxMissing = 0.1;      // of the complete lenslets
constexpr double kMaxSaturated = 0.1;    // of the found lenslets
constexpr double kMaxOffOfRegion = 0.2;  // of a region's lenslets: missing or rejected
constexpr int kFewestOff = 5;            // of them: fewer may be dust

constexpr const char* kCure = "record evenly lit lenslets, without a part in the light, in focus";

// The frame in equal regions, row by row.
class Regions {
  public:
    explicit Regions(const GridCalibration& calibration)
        : width_(calibration.fit.grid.width_px), height_(calibration.fit.grid.height_px),
          side_(std::clamp(static_cast<int>(std::min(width_, height_) / (kMinRegion * calibration.lattice.pitch_px())),
                           1, kMaxRegions)) {}

    [[nodiscard]] std::size_t count() const {
        return static_cast<std::size_t>(side_) * static_cast<std::size_t>(side_);
    }
    [[nodiscard]] std::size_t at(double x, double y) const {
        return static_cast<std::size_t>(part(y, height_) * side_ + part(x, width_));
    }
    [[nodiscard]] bool at_border(std::size_t region) const {
        const auto outer = [this](int k) { return k == 0 || k == side_ - 1; };
        return outer(static_cast<int>(region) / side_) || outer(static_cast<int>(region) % side_);
    }
    // Where a region lies, for a person.
    [[nodiscard]] std::string place(std::size_t region) const {
        const auto third = [this](int k) { return 3 * k < side_ - 1 ? 0U : 3 * k > 2 * (side_ - 1) ? 2U : 1U; };
        static constexpr std::array<std::array<const char*, 3>, 3> kNames{
            {{"at the top left", "at the top", "at the top right"},
             {"at the left", "in the middle", "at the right"},
             {"at the bottom left", "at the bottom", "at the bottom right"}}};
        return kNames[third(static_cast<int>(region) / side_)][third(static_cast<int>(region) % side_)];
    }

  private:
    [[nodiscard]] int part(double at, int size) const {
        return std::clamp(static_cast<int>(side_ * at / size), 0, side_ - 1);
    }
    int width_, height_, side_;
};

struct LightOnGrid {
    double share = 1;        // of the whole frame
    double worst = 1;        // of the worst region
    std::size_t region = 0;  // that one
};

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
            for (int x = from; x <= to; x = (x | 63) + 1) {
                const int count = std::min(to, x | 63) - x + 1;
                bits_[static_cast<std::size_t>(x) / 64] |= ~std::uint64_t{0} >> (64 - count) << (x & 63);
            }
        }
        return bits_;
    }
    [[nodiscard]] static bool has(const std::vector<std::uint64_t>& bits, int x) {
        return (bits[static_cast<std::size_t>(x) / 64] >> (x & 63) & 1U) != 0;
    }

  private:
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

// Share of the frame's bright pixels, those with half the light of the measured lenslets or more, that lie in the cells
// of these lenslets. Low where the light of a region does not fit the grid of the others: a part bends it, and scales
// its pattern. A region without light has no bright pixels. Lenslets that the frame's border cuts are not measured:
// what lies within 1.5 pitches of it does not count. 1 for a frame without any other bright pixel.
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
    std::vector<float> row(static_cast<std::size_t>(width));
    for (int y = border; y < height - border; ++y) {
        image.window(0, y, width, 1, row.data(), width);
        const std::vector<std::uint64_t>& bits = cells.of_row(y);
        int x = border;
        for (const int end : ends) {
            const std::size_t region = regions.at(x, y);
            const Bright here = count_bright(row.data(), bits, x, end, bright);
            all[region] += here.all;
            on_grid[region] += here.on_grid;
            x = end;
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

// The light of each lenslet of the grid, row by row; 0 where none is measured.
std::vector<double> light_of(const LensletGrid& grid, std::span<const Observation> observations) {
    std::vector<double> light(static_cast<std::size_t>(grid.columns) * static_cast<std::size_t>(grid.rows));
    for (const Observation& seen : observations) {
        if (grid.contains(seen.m, seen.n)) light[grid.index(seen.m, seen.n)] = seen.light_dn;
    }
    return light;
}

// Lenslets of one region.
struct RegionCount {
    int measured = 0, rejected = 0, missing = 0;
    std::size_t region = 0;
    [[nodiscard]] int off() const { return rejected + missing; }
    [[nodiscard]] int all() const { return measured + missing; }
};

std::vector<RegionCount> count_regions(const GridCalibration& calibration) {
    const Regions regions(calibration);
    std::vector<RegionCount> counts(regions.count());
    for (std::size_t k = 0; k < counts.size(); ++k) counts[k].region = k;
    for (const Observation& seen : calibration.observations) {
        RegionCount& count = counts[regions.at(seen.centre_px.x_px, seen.centre_px.y_px)];
        ++count.measured;
        if (!seen.used && !seen.displaced) ++count.rejected;
    }
    for (const PixelPoint& at : calibration.missing_px) ++counts[regions.at(at.x_px, at.y_px)].missing;
    return counts;
}

// The region at the border of the frame with the largest share of rejected lenslets: where a model ends, it stops
// fitting first. Single lenslets, dirt and bubbles do not reject half of a region.
RegionCount worst_border(const GridCalibration& calibration) {
    const Regions regions(calibration);
    RegionCount worst;
    for (const RegionCount& count : count_regions(calibration)) {
        if (count.measured < kFewestOfRegion || !regions.at_border(count.region)) continue;
        if (worst.measured == 0 || count.rejected * worst.measured > worst.rejected * count.measured) worst = count;
    }
    return worst;
}

// The region with the largest share of lenslets that are missing or rejected: there the grid is that of the model.
RegionCount least_covered(const GridCalibration& calibration) {
    RegionCount worst;
    for (const RegionCount& count : count_regions(calibration)) {
        if (count.all() < kFewestOfRegion) continue;
        if (worst.all() == 0 || count.off() * worst.all() > worst.off() * count.all()) worst = count;
    }
    return worst;
}

// Where the distortion folds the frame, if it does: two lenslets of the grid in one place. Some lenslets are looked at,
// and all of those in the corners, where folds begin.
std::optional<PixelPoint> fold_of(const LensletGrid& grid) {
    const double middle = grid.steps_px({0, 0}).area_px2();
    const double middle_x = 0.5 * grid.width_px, middle_y = 0.5 * grid.height_px;
    const double corner2 = 0.8 * (middle_x * middle_x + middle_y * middle_y);  // squared distance from the middle
    const int step = std::max(1, std::max(grid.columns, grid.rows) / 64);
    for (int n = 0; n < grid.rows; ++n) {
        for (int m = 0; m < grid.columns; ++m) {
            const LensletGrid::Uv uv = grid.uv(m, n);
            const PixelPoint at = grid.at(uv);
            const double x = at.x_px - middle_x, y = at.y_px - middle_y;
            if (!grid.in_frame(at) || (x * x + y * y < corner2 && (m % step != 0 || n % step != 0))) continue;
            if (grid.steps_px(uv).area_px2() / middle < kMinArea) return at;
        }
    }
    return std::nullopt;
}

}  // namespace

namespace {

// The mean of some lenslets, in cells along the primitive steps of the lattice: u and v, or for a hexagonal one two
// steps 60 degrees apart.
struct MeanLenslet {
    static constexpr int kSide = 16;  // cells along each step
    std::array<double, static_cast<std::size_t>(kSide) * kSide> sums{}, hits{};

    static std::size_t cell(double u, double v) {
        const auto part = [](double at) { return static_cast<std::size_t>((at - std::floor(at)) * kSide) % kSide; };
        return part(v + 0.5) * kSide + part(u + 0.5);
    }
    // Light about a place, in steps from the lenslet's centre: the mean of 4x4 cells.
    [[nodiscard]] double at(double u, double v) const {
        double sum = 0, count = 0;
        for (const double dv : {-1.5, -0.5, 0.5, 1.5}) {
            for (const double du : {-1.5, -0.5, 0.5, 1.5}) {
                const std::size_t k = cell(u + du / kSide, v + dv / kSide);
                sum += sums[k];
                count += hits[k];
            }
        }
        return count > 0 ? sum / count : 0;
    }
};

MeanLenslet mean_lenslet(const WhiteImage& image, const GridCalibration& calibration) {
    constexpr std::size_t kLenslets = 300;
    const LensletGrid& grid = calibration.fit.grid;
    MeanLenslet mean;
    const std::size_t every = std::max<std::size_t>(1, calibration.observations.size() / kLenslets);
    for (std::size_t k = 0; k < calibration.observations.size(); k += every) {
        const Observation& seen = calibration.observations[k];
        if (!seen.used) continue;
        const LensletGrid::Steps steps = grid.steps_px(grid.uv(seen.m, seen.n));
        PixelPoint a = steps.along_u, b = steps.along_v;
        const auto mixed = [](PixelPoint p, double s, PixelPoint q, double t) {
            return PixelPoint{s * p.x_px + t * q.x_px, s * p.y_px + t * q.y_px};
        };
        if (grid.stagger == algo::Stagger::rows) b = mixed(a, 0.5, b, algo::kHalfSqrt3);
        if (grid.stagger == algo::Stagger::columns) a = mixed(b, 0.5, a, algo::kHalfSqrt3);
        const double det = a.x_px * b.y_px - a.y_px * b.x_px;
        const int reach = static_cast<int>(std::ceil(0.75 * (std::hypot(a.x_px, a.y_px) + std::hypot(b.x_px, b.y_px))));
        const auto cx = static_cast<int>(std::lround(seen.centre_px.x_px));
        const auto cy = static_cast<int>(std::lround(seen.centre_px.y_px));
        if (cx < reach || cy < reach || cx + reach >= image.width_px() || cy + reach >= image.height_px()) continue;
        for (int y = cy - reach; y <= cy + reach; ++y) {
            for (int x = cx - reach; x <= cx + reach; ++x) {
                const double dx = x - seen.centre_px.x_px, dy = y - seen.centre_px.y_px;
                const double u = (dx * b.y_px - dy * b.x_px) / det, v = (dy * a.x_px - dx * a.y_px) / det;
                if (std::abs(u) >= 0.5 || std::abs(v) >= 0.5) continue;
                const std::size_t cell = MeanLenslet::cell(u, v);
                mean.sums[cell] += image.at(x, y);
                mean.hits[cell] += 1;
            }
        }
    }
    return mean;
}

// Share of the cells with less than half of the light.
double dark_share(const MeanLenslet& mean) {
    std::vector<double> light;
    for (std::size_t k = 0; k < mean.sums.size(); ++k) {
        if (mean.hits[k] > 0) light.push_back(mean.sums[k] / mean.hits[k]);
    }
    if (light.empty()) return 1;
    const auto [low, high] = std::ranges::minmax_element(light);
    const double half = (*low + *high) / 2;
    return static_cast<double>(std::ranges::count_if(light, [=](double of) { return of < half; })) /
        static_cast<double>(light.size());
}

// Light half way to the neighbours, over that in the middle of a lenslet, both less that of the places farthest from
// all lenslets: 1 if what lies between dark dots was taken for lenslets.
double light_between(const MeanLenslet& mean, algo::LatticeKind kind) {
    const bool square = kind == algo::LatticeKind::square;
    // Of a hexagonal lattice, the third neighbour lies at the difference of the steps.
    const double between =
        square ? (mean.at(0.5, 0) + mean.at(0, 0.5)) / 2 : (mean.at(0.5, 0) + mean.at(0, 0.5) + mean.at(0.5, -0.5)) / 3;
    const double farthest = square ? mean.at(0.5, 0.5) : (mean.at(1 / 3.0, 1 / 3.0) + mean.at(-1 / 3.0, -1 / 3.0)) / 2;
    const double lenslet = mean.at(0, 0) - farthest;
    return lenslet > 0 ? (between - farthest) / lenslet : 0;
}

}  // namespace

PatternShape shape_of(const WhiteImage& image, const GridCalibration& calibration) {
    constexpr int kSide = MeanLenslet::kSide;
    const LensletGrid& grid = calibration.fit.grid;
    const MeanLenslet of = mean_lenslet(image, calibration);
    const auto &sums = of.sums, &hits = of.hits;
    // Where the pitch is a whole number of pixels, or small, no pixel lies in some cells: these do not count.
    const auto cells_hit = static_cast<double>(std::count_if(hits.begin(), hits.end(), [](double h) { return h > 0; }));
    if (cells_hit == 0) return {.even_share = 1};
    double mean = 0;
    for (std::size_t cell = 0; cell < sums.size(); ++cell) {
        if (hits[cell] > 0) mean += sums[cell] / hits[cell] / cells_hit;
    }
    constexpr int kHarmonics = 4;
    const bool square = grid.kind == algo::LatticeKind::square;
    double all = 0, waves = 0, first = 0, even = 0;
    for (int q = -kHarmonics; q <= kHarmonics; ++q) {
        for (int p = -kHarmonics; p <= kHarmonics; ++p) {
            if (p == 0 && q == 0) continue;
            std::complex<double> sum;
            for (int y = 0; y < kSide; ++y) {
                for (int x = 0; x < kSide; ++x) {
                    const auto cell = static_cast<std::size_t>(y * kSide + x);
                    if (hits[cell] == 0) continue;
                    sum += (sums[cell] / hits[cell] - mean) *
                        std::polar(1.0, -2 * std::numbers::pi * (p * x + q * y) / kSide);
                }
            }
            const double power = std::norm(sum);
            all += power;
            // Of a hexagonal lattice, steps 60 degrees apart have a third fundamental at (1, 1) or (1, -1).
            const bool third = !square && std::abs(p) == 1 && std::abs(q) == 1 &&
                p * q * (grid.steps_px({0, 0}).area_px2() > 0 ? 1 : -1) > 0;
            if (std::abs(p) + std::abs(q) == 1 || third) waves += power;
            if (std::abs(p) <= 1 && std::abs(q) <= 1) first += power;
            if ((p + q) % 2 == 0) even += power;
        }
    }
    if (!(all > 0)) return {.even_share = 1};
    return {waves / all, square ? first / all : 0, square ? even / all : 1, light_between(of, grid.kind),
            dark_share(of)};
}

double light_roughness(const LensletGrid& grid, std::span<const Observation> observations) {
    const std::vector<double> light = light_of(grid, observations);
    std::vector<double> differences;
    for (const Observation& seen : observations) {
        double sum = 0;
        int count = 0;
        for (const auto& [dm, dn] : {std::pair{1, 0}, {-1, 0}, {0, 1}, {0, -1}}) {
            if (!grid.contains(seen.m + dm, seen.n + dn) || light[grid.index(seen.m + dm, seen.n + dn)] <= 0) continue;
            sum += light[grid.index(seen.m + dm, seen.n + dn)];
            ++count;
        }
        if (count == 4) differences.push_back(std::abs(light[grid.index(seen.m, seen.n)] / (sum / 4) - 1));
    }
    // The median, over that of a normal distribution: dust and dead lenslets are few.
    return differences.empty() ? 0 : common::upper_median(std::span(differences)) / 0.6745;
}

LightFollowing light_following(const LensletGrid& grid, std::span<const Observation> observations) {
    const std::vector<double> light = light_of(grid, observations);
    double gg = 0, gr = 0, rr = 0;
    int count = 0;
    for (const Observation& seen : observations) {
        const auto at = [&](int dm, int dn) {
            const int m = seen.m + dm, n = seen.n + dn;
            return grid.contains(m, n) ? light[grid.index(m, n)] : 0.0;
        };
        const double left = at(-1, 0), right = at(1, 0), above = at(0, -1), below = at(0, 1);
        if (!(left > 0 && right > 0 && above > 0 && below > 0) || !(seen.used || seen.displaced)) continue;
        const LensletGrid::Uv uv = grid.uv(seen.m, seen.n);
        const LensletGrid::Steps steps = grid.steps_px(uv);
        const PixelPoint model = grid.at(uv);
        // Along the lattice's steps; rows that are staggered to and fro average out.
        for (const auto& [low, high, step] : {std::tuple{left, right, steps.along_u}, {above, below, steps.along_v}}) {
            const double length = std::hypot(step.x_px, step.y_px);
            const double off =
                ((seen.centre_px.x_px - model.x_px) * step.x_px + (seen.centre_px.y_px - model.y_px) * step.y_px) /
                length;
            const double gradient = (high - low) / (high + low);
            gg += gradient * gradient;
            gr += gradient * off;
            rr += off * off;
            ++count;
        }
    }
    if (count < kFewestFollowing || !(gg > 0) || !(rr > 0)) return {};
    return {gr * gr / (gg * rr), std::abs(gr) / std::sqrt(gg * count)};
}

SmoothResiduals smooth_residuals(const LensletGrid& grid, std::span<const Observation> observations) {
    struct Residual {
        double x = 0, y = 0;
        bool known = false;
    };
    std::vector<Residual> residuals(grid.index(0, grid.rows));
    for (const Observation& seen : observations) {
        if (!grid.contains(seen.m, seen.n) || !(seen.used || seen.displaced)) continue;
        const PixelPoint model = grid.at(grid.uv(seen.m, seen.n));  // without shifts of single lenslets
        residuals[grid.index(seen.m, seen.n)] = {seen.centre_px.x_px - model.x_px, seen.centre_px.y_px - model.y_px,
                                                 true};
    }
    double products = 0, squares = 0;
    int pairs = 0;
    for (int n = 0; n < grid.rows; ++n) {
        for (int m = 0; m < grid.columns; ++m) {
            const Residual& a = residuals[grid.index(m, n)];
            for (const auto& [dm, dn] : {std::pair{1, 0}, {0, 1}}) {
                if (!a.known || !grid.contains(m + dm, n + dn)) continue;
                const Residual& b = residuals[grid.index(m + dm, n + dn)];
                if (!b.known) continue;
                products += a.x * b.x + a.y * b.y;
                squares += (a.x * a.x + a.y * a.y + b.x * b.x + b.y * b.y) / 2;
                ++pairs;
            }
        }
    }
    if (pairs < kFewestFollowing || !(squares > 0)) return {};
    return {products / squares, std::sqrt(std::max(0.0, products) / pairs), pairs};
}

Result<void> check_white_frame(const WhiteImage& image, const GridCalibration& calibration) {
    const auto refuse = [](std::string what, const char* cure = kCure) {
        return fail(ErrorCode::refused, std::move(what), cure);
    };
    const LightOnGrid light = light_on_grid(image, calibration);
    if (light.share < kMinLightOnGrid) {
        return refuse(
            fmt::format("this is no white frame: only {:.0f} % of its light fits the grid, {:.0f} % is the least",
                        100 * light.share, 100 * kMinLightOnGrid));
    }
    if (light.worst < kMinLightOnGridOfRegion) {
        return refuse(fmt::format("the grid does not reach the lenslets {}: only {:.0f} % of the light there fits it",
                                  Regions(calibration).place(light.region), 100 * light.worst),
                      "record evenly lit lenslets in focus up to the frame's corners, or stop the optics down: the "
                      "lenslets overlap or the distortion is too strong there");
    }
    const RegionCount misfit = worst_border(calibration);
    if (misfit.rejected > kMaxRejected * misfit.measured) {
        return refuse(fmt::format("the grid does not fit the lenslets {}: {} of {} measured there are off it",
                                  Regions(calibration).place(misfit.region), misfit.rejected, misfit.measured),
                      "record evenly lit lenslets in focus up to the frame's corners; if they are, the optics distort "
                      "more than the grid's models can describe");
    }
    if (calibration.torn > std::max(3.0, kMaxTorn * calibration.found)) {
        return refuse(fmt::format("the lenslets cannot be numbered: {} pairs of neighbours are not one pitch apart",
                                  calibration.torn));
    }
    if (const auto fold = fold_of(calibration.fit.grid)) {
        const Regions regions(calibration);
        return refuse(fmt::format("the grid folds inside the frame, {}: its distortion places two lenslets in one spot",
                                  regions.place(regions.at(fold->x_px, fold->y_px))),
                      "record evenly lit lenslets up to the frame's corners, or use optics with less distortion");
    }
    const PatternShape& shape = calibration.shape;
    if (shape.wave_share > kMaxWaves || shape.first_share > kMaxFirst) {
        return refuse(
            fmt::format("this is no white frame: {:.1f} % of its pattern are plain waves, as of gratings or of "
                        "lenslets far out of focus",
                        100 * std::max(shape.wave_share, shape.first_share)),
            "focus the sensor on the lenslets, and record them in even light");
    }
    if (shape.even_share < kMinEven) {
        return refuse("this is no white frame: its dark and bright places have the same shape, as of a checkerboard",
                      "record a lenslet array in even light");
    }
    if (calibration.fit.grid.kind == algo::LatticeKind::square && shape.even_share > kMaxEven) {
        return refuse("the grid has every second lenslet only: the same light lies in the middle of four of them",
                      "record lenslets with a pitch of 8 px or more");
    }
    if (calibration.fit.grid.kind == algo::LatticeKind::square &&
        ((shape.between > kMaxBetween && shape.dark_share < kMinDark) ||
         (shape.dark_share < kMaxDarkOfStars && shape.corners < -kMaxStar))) {
        return refuse("this is no white frame: between its lenslets it is as bright as in them, as between dark dots",
                      "record the light behind a lenslet array, bright on dark, not inverted");
    }
    return {};
}

std::vector<std::string> warnings_about(const GridCalibration& calibration) {
    std::vector<std::string> out;
    if (calibration.apart > 0) {
        out.push_back(
            fmt::format("{} lenslets are apart from the others: no chain of lit neighbours says which ones "
                        "they are; light the whole array, or check them in centres.png",
                        calibration.apart));
    }
    if (calibration.missing > kMaxMissing * calibration.complete) {
        out.push_back(
            fmt::format("{} of {} lenslets have no centre: the grid there is only that of the model; if the "
                        "light should reach them, record the frame again, without a part in the light",
                        calibration.missing, calibration.complete));
    }
    if (calibration.saturated > kMaxSaturated * calibration.found) {
        out.push_back(
            fmt::format("{} of {} measured lenslets are saturated: what is uneven in their light is cut off and cannot "
                        "be checked; lower the exposure or the light until the brightest samples are below full "
                        "scale, and record the frame again",
                        calibration.saturated, calibration.found));
    }
    if (calibration.light_roughness > kMaxRoughness) {
        out.push_back(
            fmt::format("the light differs by {:.0f} % from lenslet to lenslet: a white frame is even; take "
                        "objects out of the light and clean the optics",
                        100 * calibration.light_roughness));
    }
    const LightFollowing& following = calibration.light_following;
    if (following.share > kMaxFollowed && following.px > kMinFollowed * calibration.pitch_px) {
        out.push_back(
            fmt::format("the centres follow the light, by {:.3f} px rms: something in the light is brighter on "
                        "one side of a lenslet; take objects out of the light",
                        following.px));
    }
    const SmoothResiduals& smooth = calibration.smooth_residuals;
    const double by_chance = kMaxAlikeDeviations / std::sqrt(2.0 * std::max(1, smooth.pairs));  // along x and y
    if (smooth.correlation > std::max(kMaxAlike, by_chance) && smooth.px > kMaxCommon * calibration.pitch_px) {
        out.push_back(fmt::format(
            "the centres are off the grid together with their neighbours, by {:.3f} px rms: lenslets are not "
            "misplaced so, bent light and light that is brighter on one side of the lenslets move centres "
            "so, and the grid may be off by ten times as much; take objects out of the light, and use "
            "diffuse or collimated light without other optics",
            smooth.px));
    }
    const CutLenslets& cut = calibration.cut;
    const double beyond_grid = cut.narrower - std::max(0.0, cut.of_grid);
    if (beyond_grid > std::max(kMaxCut, kMaxCutDeviations * cut.sigma)) {
        out.push_back(fmt::format(
            "the lenslets are narrower outwards than across, by {:.1f} % at the corners: the stop of the "
            "optics cuts them, and their centres may be off by tenths of a pixel; stop the optics down until "
            "the corners' lenslets are whole, and compare the pitch",
            100 * beyond_grid));
    } else if (cut.uneven > std::max(kMaxUneven, kMaxCutDeviations * cut.uneven_sigma)) {
        out.push_back(fmt::format(
            "the shape of the lenslets changes from border to border of the frame, by {:.1f} %: something on one side "
            "of the optics cuts their light, and the grid may be off by pixels; centre the array on the optics' axis "
            "and stop the optics down until the lenslets at all borders are whole",
            200 * cut.uneven));
    }
    if (calibration.one_sided > kMaxOneSided) {
        out.push_back(fmt::format(
            "all lenslets are brighter on the same side, by {:.0f} % at their rim: their centres may be off by tenths "
            "of a pixel; light the array evenly from all directions",
            100 * calibration.one_sided));
    }
    if (calibration.rejected > kMaxOff * calibration.found) {
        out.push_back(
            fmt::format("{} of {} measured lenslets are off the grid: clean the array and the optics, or take "
                        "objects out of the light; centres.png shows where",
                        calibration.rejected, calibration.found));
    }
    const RegionCount worst = least_covered(calibration);
    const bool all_over = calibration.missing > kMaxMissing * calibration.complete ||
        calibration.rejected > kMaxOff * calibration.found;  // told above
    if (!all_over && worst.off() >= kFewestOff && worst.off() > kMaxOffOfRegion * worst.all()) {
        out.push_back(
            fmt::format("{} of {} lenslets {} have no centre or are off the grid: the grid there is only that of the "
                        "model; light the array evenly and in focus up to there, or use optics that distort less",
                        worst.off(), worst.all(), Regions(calibration).place(worst.region)));
    }
    // How far the selected polynomial leaves the best model of a lens, from their errors on unseen lenslets.
    const GridFit& fit = calibration.fit;
    if (fit.grid.model == algo::GridModelKind::cubic || fit.grid.model == algo::GridModelKind::quintic) {
        double best = std::numeric_limits<double>::infinity();
        for (const ModelReport& model : fit.candidates) {
            if (model.model < algo::GridModelKind::cubic)
                best = std::min(best, std::hypot(model.cv_x_rms_px, model.cv_y_rms_px));
        }
        const double bend =
            std::sqrt(std::max(0.0, best * best - std::pow(std::hypot(fit.cv_x_rms_px, fit.cv_y_rms_px), 2)));
        if (bend > kMaxBend * calibration.pitch_px) {
            out.push_back(
                fmt::format("the grid bends by {:.3f} px rms as no lens distorts: if the light on the array is "
                            "aberrated, its spots are not the lenslets' centres; use collimated or diffuse "
                            "light without other optics",
                            bend));
        }
    }
    return out;
}

}  // namespace hord::calib
