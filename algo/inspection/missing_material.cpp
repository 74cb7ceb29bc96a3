#include "algo/inspection/missing_material.h"

#include <algorithm>
#include <cmath>
#include <cstdlib>
#include <limits>

#include "algo/frame/mask.h"
#include "common/statistics.h"

namespace hord::algo {
namespace {

constexpr int kPad = 10;            // twice the distance of squares of 3 x 3
constexpr int kSmallestField = 11;  // blocks
constexpr std::size_t kMaxSamples = 2048, kMinSamples = 32;
constexpr float kSigmasOfQuartile = 1 / 0.3186F;  // of a normal distribution, by the lower quartile of absolute values
constexpr float kErrorOfQuartile = 1.79F;         // standard error, relative, of one sample; of n: over sqrt(n)
constexpr float kNextShare = 0.618034F;  // (sqrt(5) - 1) / 2: its multiples, less whole ones, are spread evenly
constexpr float kSurely = 3;             // standard errors that the noise is taken to be larger than it seems
constexpr int kSharpOf = 4, kSharp = 3;  // of the outline of a region leads down: 3/4
constexpr float kGoesOnOf = 4;           // at most 1/4 of the change across the outline goes on beyond

// The lamp of a web, and its density, may vary over more lenslets as a step between two large squares does.
constexpr int kLargestInWeb = 10;  // lenslets between squares that are compared: between those of 6 x 6

// The walls of a tube gather light in lines along its axis, which single lenslets cut into pieces.
constexpr int kSingle = 2;  // lenslets between single ones that are compared

// How many of the four ways from a bright place must lead down at least, if the squares that are compared are so many
// lenslets apart. The others end where nothing is judged.
int min_steps(PartForm form, int lenslets_apart) {
    if (form == PartForm::tube && lenslets_apart <= kSingle) return 4;
    switch (form) {
        case PartForm::round: return 3;
        case PartForm::tube:
        case PartForm::plate: return 2;
        case PartForm::web: return 1;
    }
    return 3;
}

}  // namespace

MissingMaterialFinder::Level::Level(int columns, int rows, int lenslets_a_block)
    : m(columns), n(rows), block(lenslets_a_block), stride(static_cast<std::size_t>(columns) + 2 * kPad),
      light(stride * (static_cast<std::size_t>(rows) + 2 * kPad)), count(light.size()) {}

std::size_t MissingMaterialFinder::Level::index(int column, int row) const {
    return static_cast<std::size_t>(row + kPad) * stride + static_cast<std::size_t>(column + kPad);
}

MissingMaterialFinder::MissingMaterialFinder(const Extents& extents, PartForm form) : form_(form) {
    int m = extents.m, n = extents.n, block = 1;
    do {
        levels_.emplace_back(m, n, block);
        m /= 2, n /= 2, block *= 2;
    } while (std::max(m, n) >= kSmallestField);
    const std::size_t size = levels_.front().light.size();
    for (auto* const map : {&light_, &count_, &mean_, &least_, &excess_}) map->resize(size);
    for (auto& map : met_) map.resize(size);
    for (auto* const map : {&steps_, &ways_}) map->resize(size);
    returns_.resize(size);
    region_.resize(size);
    samples_.reserve(2 * kMaxSamples + 4);
}

std::optional<MissingMaterial> MissingMaterialFinder::find(std::span<const std::uint32_t> sums,
                                                           std::span<const std::uint8_t> mask, std::uint32_t min_area) {
    Level& lenslets = levels_.front();
    std::size_t k = 0;
    for (int n = 0; n < lenslets.n; ++n) {
        const std::size_t row = lenslets.index(0, n);
        for (std::size_t m = 0; m < static_cast<std::size_t>(lenslets.m); ++m, ++k) {
            const float counts = (mask[k] & (kDark | kNotJudged)) == 0 ? 1.0F : 0.0F;
            lenslets.light[row + m] = counts * static_cast<float>(static_cast<std::int32_t>(sums[k]));
            lenslets.count[row + m] = counts;
        }
    }
    for (std::size_t l = 1; l < levels_.size(); ++l) {
        const Level& finer = levels_[l - 1];
        Level& level = levels_[l];
        const auto halve = [&](const std::vector<float>& from, std::vector<float>& to) {
            for (int n = 0; n < level.n; ++n) {
                const float* const a = from.data() + finer.index(0, 2 * n);
                const float* const b = a + finer.stride;
                float* const out = to.data() + level.index(0, n);
                for (int m = 0; m < level.m; ++m) out[m] = a[2 * m] + a[2 * m + 1] + b[2 * m] + b[2 * m + 1];
            }
        };
        halve(finer.light, level.light);
        halve(finer.count, level.count);
    }
    MissingMaterial best;
    constexpr float kAny = std::numeric_limits<float>::max();
    Squares squares{.level = &lenslets, .half = 0, .min_area = min_area, .seen_excess = kAny};
    look_at(squares, best);
    squares.half = 1;
    for (const Level& level : levels_) {
        squares.level = &level;
        if (best.score >= 1 || (form_ == PartForm::web && squares.lenslets_apart() > kLargestInWeb)) break;
        squares.limit = kAny;
        look_at(squares, best);
        squares.seen_excess = squares.limit;
    }
    if (best.score < 1) return std::nullopt;
    return best;
}

void MissingMaterialFinder::look_at(Squares& squares, MissingMaterial& best) {
    const Level& level = *squares.level;
    const auto least = kMinOfSideSquare * static_cast<float>(squares.side()) * static_cast<float>(squares.side());
    if (squares.half > 0) sum_squares(level);
    const std::vector<float>&light = squares.half > 0 ? light_ : level.light,
          &count = squares.half > 0 ? count_ : level.count;
    float* const mean = mean_.data();
    const float *const of_light = light.data(), *const of_count = count.data();
    const std::size_t size = level.light.size();
    for (std::size_t k = 0; k < size; ++k)
        mean[k] = of_count[k] >= least ? of_light[k] / std::max(of_count[k], 1.0F) : 0;
    std::int32_t judged = 0;
    for (std::size_t k = 0; k < size; ++k) judged += mean[k] > 0 ? 1 : 0;
    squares.judged = static_cast<std::size_t>(judged);
    const std::optional<float> sigma = noise(squares);
    if (!sigma) return;
    squares.limit = std::max(kMinExcess, kMinExcessSigmas * *sigma);
    if (!find_steps(squares)) return;
    std::fill_n(returns_.begin(), level.light.size(), std::uint8_t{0});
    for (const Direction direction : {right, left, down, up}) follow(squares, direction);
    std::fill_n(excess_.begin(), level.light.size(), 0.0F);
    count_steps(level);
    const int least_steps = min_steps(form_, squares.lenslets_apart());
    for (int steps = least_steps == 4 ? 4 : 3; steps >= least_steps; --steps) {
        if (!mark_bright(level, steps)) continue;
        for (int n = 0; n < level.n; ++n) {
            const std::size_t row = level.index(0, n);
            for (std::size_t k = row; k < row + static_cast<std::size_t>(level.m); ++k) {
                if (excess_[k] > 0) take_region(squares, k, best);
            }
        }
    }
}

// Sets ways_ and least_ from what is met on the four ways from each square.
void MissingMaterialFinder::count_steps(const Level& level) {
    const float *const a = met_[right].data(), *const b = met_[left].data(), *const c = met_[down].data(),
                       *const d = met_[up].data();
    // What has no end along the axis of a tube is such a line.
    const bool is_tube = form_ == PartForm::tube;
    const auto none_to_far = [](float met) { return met > 0 ? met : std::numeric_limits<float>::max(); };
    for (int n = 0; n < level.n; ++n) {
        const std::size_t row = level.index(0, n);
        for (std::size_t k = row; k < row + static_cast<std::size_t>(level.m); ++k) {
            const std::int32_t in_row = (a[k] > 0 ? 1 : 0) + (b[k] > 0 ? 1 : 0),
                               in_column = (c[k] > 0 ? 1 : 0) + (d[k] > 0 ? 1 : 0),
                               ways = ((in_row > 0) & (in_column > 0)) | !is_tube ? in_row + in_column : 0;
            const bool steps_up = std::min(std::min(a[k], b[k]), std::min(c[k], d[k])) < 0;
            ways_[k] = steps_up ? -1 : ways;
            least_[k] = std::min(std::min(none_to_far(a[k]), none_to_far(b[k])),
                                 std::min(none_to_far(c[k]), none_to_far(d[k])));
        }
    }
}

// Sets excess_ where at least `steps` ways lead down and none up; false if there is no such square. Beyond a dark
// stripe or a stain the light is as before, so that only what it surrounds can be a hole.
bool MissingMaterialFinder::mark_bright(const Level& level, int steps) {
    std::int32_t any = 0;
    for (int n = 0; n < level.n; ++n) {
        const std::size_t row = level.index(0, n);
        for (std::size_t k = row; k < row + static_cast<std::size_t>(level.m); ++k) {
            const bool is_bright = (ways_[k] >= steps) & ((steps >= 3) | (returns_[k] == 0));
            excess_[k] = is_bright ? least_[k] : 0;
            any += is_bright ? 1 : 0;
        }
    }
    if (any == 0) return false;
    // Noise hides the step of single rows and columns.
    for (int n = 0; n < level.n; ++n) {
        const std::size_t row = level.index(0, n);
        for (std::size_t k = row; k < row + static_cast<std::size_t>(level.m); ++k) {
            if (excess_[k] > 0 || ways_[k] < 0 || mean_[k] <= 0) continue;
            excess_[k] = std::max(std::min(excess_[k - 1], excess_[k + 1]),
                                  std::min(excess_[k - level.stride], excess_[k + level.stride]));
        }
    }
    return true;
}

// Whether two squares of the part differ by the limit: in most good parts none do, and the search ends here.
bool MissingMaterialFinder::any_change(const Squares& squares) const {
    const Level& level = *squares.level;
    const std::size_t across = static_cast<std::size_t>(squares.distance()), along = across * level.stride;
    const float factor = 1 + squares.limit;
    std::int32_t changes = 0;
    for (int n = 0; n < level.n; ++n) {
        const float *const a = mean_.data() + level.index(0, n), *const b = a + across, *const c = a + along;
        for (int m = 0; m < level.m; ++m) {
            const bool in_row = (std::min(a[m], b[m]) > 0) & (std::max(a[m], b[m]) > factor * std::min(a[m], b[m])),
                       in_column = (std::min(a[m], c[m]) > 0) & (std::max(a[m], c[m]) > factor * std::min(a[m], c[m]));
            changes += (in_row | in_column) ? 1 : 0;
        }
    }
    return changes > 0;
}

// Sets steps_; false if there are none.
bool MissingMaterialFinder::find_steps(const Squares& squares) {
    if (!any_change(squares)) return false;
    const Level& level = *squares.level;
    const auto across = static_cast<std::ptrdiff_t>(squares.distance()),
               along = across * static_cast<std::ptrdiff_t>(level.stride);
    const float factor = 1 + squares.limit;
    const int columns = level.m;  // a local copy: a store to steps_ may change anything else
    std::int32_t any = 0;
    std::fill_n(steps_.begin(), level.light.size(), 0);
    for (int n = 0; n < level.n; ++n) {
        const std::size_t row = level.index(0, n);
        const float* const here = mean_.data() + row;
        std::int32_t* const steps = steps_.data() + row;
        const auto look = [=](std::ptrdiff_t step, std::int32_t bit) {
            const float *const before = here - step, *const beyond = here + step, *const farther = beyond + step;
            for (int m = 0; m < columns; ++m) {
                const float rises = std::max(before[m] - here[m], 0.0F), falls = std::max(beyond[m] - farther[m], 0.0F),
                            goes_on = rises + (farther[m] > 0 ? falls : 0.0F);
                const bool is_step = (beyond[m] > 0) & (here[m] > factor * beyond[m]) & (here[m] - beyond[m] > goes_on);
                steps[m] |= is_step ? bit : 0;
            }
        };
        look(across, 1 << right);
        look(-across, 1 << left);
        look(along, 1 << down);
        look(-along, 1 << up);
        for (int m = 0; m < columns; ++m) any |= steps[m];
    }
    return any != 0;
}

// What is met first on the way from each square in one direction.
void MissingMaterialFinder::follow(const Squares& squares, Direction direction) {
    const Level& level = *squares.level;
    const bool in_row = direction == right || direction == left, forward = direction == right || direction == down;
    const auto unit = static_cast<std::ptrdiff_t>(in_row ? 1 : level.stride);
    const std::ptrdiff_t way = forward ? unit : -unit, step = way * squares.distance();
    const int down_this_way = 1 << direction, down_back = 1 << (direction ^ 1);
    std::vector<float>& met = met_[direction];
    const int lines = in_row ? level.n : level.m, length = in_row ? level.m : level.n;
    for (int line = 0; line < lines; ++line) {
        const int last = forward ? length - 1 : 0;
        auto at = static_cast<std::ptrdiff_t>(in_row ? level.index(last, line) : level.index(line, last));
        float state = 0;
        bool returns = false;  // the light steps up again beyond the step
        for (int k = 0; k < length; ++k, at -= way) {
            const auto here = static_cast<std::size_t>(at);
            if (mean_[here] <= 0) {
                state = 0;
            } else if ((steps_[here] & down_this_way) != 0) {
                returns = state < 0 || (state > 0 && returns);
                state = mean_[here] / mean_[beside(here, step)] - 1;
            } else if ((steps_[beside(here, step)] & down_back) != 0) {
                state = -1;
            }
            met[here] = state;
            returns_[here] |= static_cast<std::uint8_t>(state > 0 && returns ? down_this_way : 0);
        }
    }
}

// Takes the bright squares that touch `seed` as one region: their excess becomes negative. It is the best one if its
// score is the largest yet, and its outline that of a hole.
void MissingMaterialFinder::take_region(const Squares& squares, std::size_t seed, MissingMaterial& best) {
    const Level& level = *squares.level;
    const auto stride = static_cast<std::ptrdiff_t>(level.stride);
    const std::array<std::ptrdiff_t, 4> ways{1, -1, stride, -stride};  // by Direction
    Region region;
    const auto add = [&](std::size_t at) {
        region.most = std::max(region.most, excess_[at]);
        excess_[at] = -excess_[at];
        region_[region.squares++] = static_cast<std::uint32_t>(at);
        region.light += mean_[at];
        const auto [n, m] = std::div(static_cast<int>(at), static_cast<int>(level.stride));
        region.left = std::min(region.left, m), region.right = std::max(region.right, m);
        region.top = std::min(region.top, n), region.bottom = std::max(region.bottom, n);
        region.sum_m += m, region.sum_n += n;
    };
    add(seed);
    for (std::size_t q = 0; q < region.squares; ++q) {
        for (const std::ptrdiff_t way : ways) {
            const std::size_t next = beside(region_[q], way);
            if (excess_[next] > 0) add(next);
        }
    }
    if (region.most <= squares.limit * best.score || !is_sharp(squares, region) || is_part(squares, region)) return;
    const auto middle = [&](double sum) {
        const double block = sum / static_cast<double>(region.squares) - kPad + 0.5;
        return static_cast<float>(block * level.block - 0.5);
    };
    const auto lenslets = [&](int blocks) { return std::max(blocks * level.block, squares.side()); };
    const auto wide = static_cast<float>(lenslets(region.right - region.left + 1)),
               high = static_cast<float>(lenslets(region.bottom - region.top + 1));
    const std::size_t area = std::max(region.squares * static_cast<std::size_t>(level.block * level.block),
                                      static_cast<std::size_t>(squares.side() * squares.side()));
    if (area < squares.min_area) return;
    best = {.m = middle(region.sum_m),
            .n = middle(region.sum_n),
            .area = static_cast<std::uint32_t>(area),
            .length = std::max(wide, high),
            .width = std::min(wide, high),
            .excess = region.most,
            .score = region.most / squares.limit};
}

// Most steps out of the region lead down, to light that goes on no farther down; and it is no bump that smaller squares
// would have shown if it were a hole.
bool MissingMaterialFinder::is_sharp(const Squares& squares, const Region& region) const {
    const int distance = squares.distance();
    const auto stride = static_cast<std::ptrdiff_t>(squares.level->stride);
    const std::array<std::ptrdiff_t, 4> ways{1, -1, stride, -stride};
    const auto largest_bump = static_cast<std::size_t>(4 * distance * distance);
    if (region.most > squares.seen_excess && region.squares < largest_bump) return false;
    int exits = 0, sharp = 0;
    float change = 0, farther_change = 0;
    for (const std::uint32_t at : std::span(region_).first(region.squares)) {
        for (const std::ptrdiff_t way : ways) {
            const std::size_t next = beside(at, way);
            if (excess_[next] < 0 || mean_[next] <= 0) continue;
            ++exits;
            // The largest change on the way out: the outline lies within the distance of two squares.
            float largest = 0, goes_on = 0;
            bool is_step = false;
            for (int back = 0; back <= distance; ++back) {
                const std::size_t from = beside(at, -back * way), to = beside(from, distance * way);
                const float here = mean_[from], beyond = mean_[to], farther = mean_[beside(to, distance * way)];
                if (beyond <= 0 || here - beyond <= largest) continue;
                largest = here - beyond;
                goes_on = farther > 0 ? beyond - farther : 0;
                is_step = is_step || here > (1 + squares.limit / 2) * beyond;
            }
            sharp += is_step ? 1 : 0;
            change += largest;
            farther_change += goes_on;
        }
    }
    return kSharpOf * sharp >= kSharp * exits && kGoesOnOf * farther_change <= change;
}

// What a dark rim or ring surrounds: most of the squares in and about the region are as bright. A web has no rim, and
// most of it may be torn off.
bool MissingMaterialFinder::is_part(const Squares& squares, const Region& region) const {
    if (form_ == PartForm::web) return false;
    const int wide = region.right - region.left + 1, high = region.bottom - region.top + 1;
    const float least = region.light / static_cast<float>(region.squares) / (1 + region.most / 2);
    std::size_t all = 0, bright = 0;
    for (int n = std::max(region.top - high, kPad); n <= std::min(region.bottom + high, squares.level->n - 1 + kPad);
         ++n) {
        const float* const row = mean_.data() + static_cast<std::size_t>(n) * squares.level->stride;
        for (int m = std::max(region.left - wide, kPad);
             m <= std::min(region.right + wide, squares.level->m - 1 + kPad); ++m) {
            all += row[m] > 0 ? 1 : 0;
            bright += row[m] > least ? 1 : 0;
        }
    }
    return 2 * bright > all;
}

// Of the 3 x 3 blocks about each.
void MissingMaterialFinder::sum_squares(const Level& level) {
    const auto sum = [&](const std::vector<float>& from, std::vector<float>& to) {
        const std::size_t stride = level.stride, last = level.light.size() - stride - 1;
        std::fill_n(to.begin(), stride + 1, 0.0F);
        std::fill_n(to.begin() + static_cast<std::ptrdiff_t>(last), stride + 1, 0.0F);
        for (std::size_t k = stride + 1; k < last; ++k) {
            const float *const a = from.data() + k - stride, *const b = from.data() + k, *const c = b + stride;
            to[k] = a[-1] + a[0] + a[1] + b[-1] + b[0] + b[1] + c[-1] + c[0] + c[1];
        }
    };
    sum(level.light, light_);
    sum(level.count, count_);
}

// Standard deviation of the relative difference of two squares, of up to kMaxSamples in places all over the part; by
// the lower quartile, so that pairs across the outline of what is missing hardly add to it. None if there are too few.
// Sums of light are whole numbers. Where they are small, most differences are 0, 1 or 2, and so is their quartile.
// Therefore a part of 1, from -1/2 to 1/2, is added to each, every time another (dither).
std::optional<float> MissingMaterialFinder::noise(const Squares& squares) {
    const Level& level = *squares.level;
    const std::vector<float>& count = squares.half > 0 ? count_ : level.count;
    float share = 0;  // in [0, 1)
    samples_.clear();
    const auto blocks = static_cast<std::size_t>(level.m) * static_cast<std::size_t>(level.n);
    const auto shift = static_cast<std::size_t>(squares.distance()), below = shift * level.stride;
    const std::size_t step = std::max<std::size_t>((2 * squares.judged + kMaxSamples - 1) / kMaxSamples, 1);
    for (std::size_t k = 0; k < blocks; k += step) {
        const auto row = k / static_cast<std::size_t>(level.m), column = k % static_cast<std::size_t>(level.m);
        const std::size_t at = level.index(static_cast<int>(column), static_cast<int>(row));
        if (mean_[at] <= 0) continue;
        for (const std::size_t other : {at + shift, at + below}) {
            if (mean_[other] <= 0) continue;
            share += share < 1 - kNextShare ? kNextShare : kNextShare - 1;
            samples_.push_back(std::abs((mean_[at] + (share - 0.5F) / count[at]) / mean_[other] - 1));
        }
    }
    if (samples_.size() < kMinSamples) return std::nullopt;
    const float margin = 1 + kSurely * kErrorOfQuartile / std::sqrt(static_cast<float>(samples_.size()));
    return margin * kSigmasOfQuartile * common::nth_smallest(std::span(samples_), samples_.size() / 4);
}

}  // namespace hord::algo
