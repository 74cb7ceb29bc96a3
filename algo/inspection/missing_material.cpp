#include "algo/inspection/missing_material.h"

#include <algorithm>
#include <cmath>
#include <cstdlib>
#include <limits>

#include "algo/frame/mask.h"

namespace hord::algo {
namespace {

constexpr int kSmallestField = 11;  // blocks

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
    of_hole_.resize(size);
    region_.resize(size);
    samples_.reserve(2 * kMaxSamples + 4);
}

std::optional<MissingMaterial> MissingMaterialFinder::find(std::span<const std::uint32_t> sums,
                                                           std::span<const std::uint8_t> mask,
                                                           const SoughtMaterial& sought) {
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
    Squares squares{.level = &lenslets, .half = 0, .sought = sought, .seen_excess = kAny};
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
    if (squares.half == 0) noise_of_lenslet_ = sigma.value_or(0);
    if (!sigma) return;
    squares.limit = std::max(kMinExcess, kMinExcessSigmas * *sigma);
    find_regions(squares, best);
    if (best.score < 1 && form_ == PartForm::plate) look_again(squares, best);
}

// A hole that is no small share of the part raises the noise: many pairs lie across its outline. Light that varies from
// lenslet to lenslet alone gives the least limit. What could be a hole by it is left out of a second estimate; where
// too few pairs are left for one, no lamp may explain its light. Of plates only: the light of lenses and webs varies
// over large squares, so that nearly each of them would be searched twice.
void MissingMaterialFinder::look_again(Squares& squares, MissingMaterial& best) {
    Squares trial = squares;
    trial.is_trial = true;
    trial.limit = std::max(kMinExcess, kMinExcessSigmas * noise_of_lenslet_ / static_cast<float>(squares.side()));
    if (trial.limit >= squares.limit) return;
    std::fill_n(of_hole_.begin(), squares.level->light.size(), std::uint8_t{0});
    find_regions(trial, best);
    if (!std::ranges::any_of(std::span(of_hole_).first(squares.level->light.size()), [](auto of) { return of != 0; }))
        return;
    if (const std::optional<float> sigma = noise(trial)) {
        if (kMinExcessSigmas * *sigma >= squares.limit) return;
        squares.limit = std::max(trial.limit, kMinExcessSigmas * *sigma);
    } else {  // nearly all pairs lie at the outline. Of 3 x 3 lenslets only: beyond, more than a lamp varies
        if (squares.level->block > 1 || !is_step_of_light(trial)) return;
        squares.limit = trial.limit;
    }
    find_regions(squares, best);
}

void MissingMaterialFinder::find_regions(const Squares& squares, MissingMaterial& best) {
    const Level& level = *squares.level;
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

}  // namespace hord::algo
