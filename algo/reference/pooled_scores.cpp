#include "algo/reference/pooled_scores.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <numbers>

#include "algo/frame/mask.h"
#include "algo/frame/spread.h"
#include "algo/simd/multiversion.h"

namespace hord::algo {
namespace {

constexpr int kDirections = 8;
constexpr int kPad = 16;                       // lenslets beside the field, 0: more than a band reaches
constexpr int kBandRows = 32;                  // rows of the field that are summed together: the sums stay in cache
constexpr int kReach = 10;                     // rows that a band reaches beyond its first lenslet, with its profile
constexpr float kMinShare = 0.7F;              // of a filter's lenslets that must show the part
constexpr float kMedianOfSquare = 0.4549364F;  // of a squared normal variable
constexpr float kLearnedParts = 3;             // the learned variance counts so many times as the frame's own
constexpr int kMinSampled = 512, kMinRows = 12;
constexpr int kFitted = 512, kFits = 4;  // lenslets of a plane's fit; its iterations
constexpr float kOutlier = 3;            // standard deviations

// The step of each direction after one, two and four lenslets, along the rows or the columns (is_steep).
struct Direction {
    bool is_steep;
    int side[3];  // lenslets to the side after 1, 2 and 4
    float across_x, across_y;
};
constexpr float kSin = 0.38268343F, kCos = 0.92387953F, kHalf = 0.70710678F;
constexpr Direction kDirection[kDirections] = {{false, {0, 0, 0}, 0, 1},
                                               {false, {0, 1, 2}, -kSin, kCos},
                                               {false, {1, 2, 4}, -kHalf, kHalf},
                                               {true, {0, 1, 2}, -kCos, kSin},
                                               {true, {0, 0, 0}, -1, 0},
                                               {true, {0, -1, -2}, -kCos, -kSin},
                                               {false, {-1, -2, -4}, kHalf, kHalf},
                                               {false, {0, -1, -2}, kSin, kCos}};

// Weights of the lines beside the band's first one, -2 to 2 of them to the side.
struct Profile {
    std::array<float, 5> weights;
    int lines;
    float middle;
};
constexpr std::size_t kProfiles = 6, kShiftProfiles = 4;  // the first of shift, the others of light
constexpr Profile kProfile[kProfiles] = {{{0, -1, 0, 1, 0}, 2, 0},  {{-1, -1, 1, 1, 0}, 4, -0.5F},
                                         {{-1, -1, 0, 1, 1}, 4, 0}, {{0, 0, 1, 0, 0}, 1, 0},
                                         {{0, 0, 1, 0, 0}, 1, 0},   {{0, 0, 1, 1, 0}, 2, 0.5F}};
constexpr int kLengths[] = {4, 8};

// Squares and a disc: half-open ranges of rows and columns, and whether the corners are left out.
struct Patch {
    Deviation deviation;
    int from, to;
    bool round;
    int lenslets;
};
constexpr Patch kPatches[] = {{Deviation::light, 0, 1, false, 1},       {Deviation::light, 0, 2, false, 4},
                              {Deviation::light, -1, 2, false, 9},      {Deviation::scattering, 0, 2, false, 4},
                              {Deviation::scattering, -1, 2, false, 9}, {Deviation::scattering, -2, 3, true, 21}};
constexpr std::size_t kPatchCount = std::size(kPatches);
constexpr std::size_t kBands = kDirections * std::size(kLengths) * kProfiles, kFilters = kBands + kPatchCount;

constexpr std::array<PooledFilter, kFilters> kAll = [] {
    std::array<PooledFilter, kFilters> all{};
    std::size_t f = 0;
    for (int d = 0; d < kDirections; ++d) {
        for (const int length : kLengths) {
            for (std::size_t p = 0; p < kProfiles; ++p)
                all[f++] = {p < kShiftProfiles ? Deviation::deflection_shift : Deviation::light,
                            static_cast<std::uint8_t>(d), static_cast<std::uint8_t>(length),
                            static_cast<std::uint8_t>(p)};
        }
    }
    for (const Patch& patch : kPatches) all[f++] = {patch.deviation, 0, 0, static_cast<std::uint8_t>(patch.lenslets)};
    return all;
}();

enum Plane : std::uint8_t { kLight, kX, kY, kScattering, kHas, kPlanes };

}  // namespace

struct PooledScorer::Work {
    Extents extents;
    std::ptrdiff_t pitch = 0;  // floats a row
    // Standardised deviations, a border of kPad zeros on all sides; kHas: 1 where they count.
    std::array<std::vector<float>, kPlanes> planes;
    // Of a band of rows: shift across the direction; sums of 2, 4 and 8 lenslets of shift, light and count.
    std::vector<float> across, twos;
    std::array<std::array<std::vector<float>, 3>, 2> lines;
    std::vector<int> sampled_rows;
    std::array<std::vector<float>, kFilters> samples;  // squared scores of the sampled rows, -1: no room
    std::array<float, kFilters> highest{}, scale{};    // squared score; standard deviation
    std::array<int, kFilters> highest_band{};          // its first row
    void (*sum_band)(Work&, int first, int last) = nullptr;

    [[nodiscard]] float* row(Plane p, int n) { return planes[p].data() + (n + kPad) * pitch + kPad; }
    void load(std::span<const Difference> differences, std::span<const std::uint8_t> mask, const Reference& reference);
    void take_off_plane(Plane p, std::span<const Difference> differences, const Reference& reference);
    void sum();
    [[nodiscard]] std::pair<float, float> at(std::size_t filter, int m, int n);
};

namespace {

using Work = PooledScorer::Work;

// Squares of a filter's sums over their counts: their maximum, of the wanted sign, and samples.
template <class V>
struct Highest {
    V value{};
    // `sign`: 1 or -1: of sums of that sign only; 0: of both.
    HORD_ALWAYS_INLINE void add(const V& sum, const V& count, float least, int sign, float* sample) {
        using Mask = decltype(sum < sum);  // as_lanes(): GCC 12 combines masks of 64 bytes lane by lane
        const V nothing{};
        const V squared = sum * sum / max(count, nothing + 1.0F);
        const Mask room = as_lanes(count >= nothing + least);
        if (sample != nullptr) store(room ? squared : nothing - 1.0F, sample);
        const Mask wanted = sign == 0 ? room
            : sign > 0                ? room & as_lanes(sum > nothing)
                                      : room & as_lanes(sum < nothing);
        value = max(value, wanted ? squared : nothing);
    }
    [[nodiscard]] float most() const {
        float lanes[sizeof(V) / sizeof(float)];
        store(value, lanes);
        return *std::ranges::max_element(lanes);
    }
};

template <int Bytes>
HORD_ALWAYS_INLINE void sum_band(Work& w, int first, int last) {
    using V = Vector<float, Bytes>;
    constexpr int kWide = Bytes / static_cast<int>(sizeof(float));
    const std::ptrdiff_t pitch = w.pitch;
    const int rows = last - first, columns = static_cast<int>(pitch) - 2 * kPad;  // the same for all vectors
    // Where row `first` of the field begins in the buffers of a band.
    const auto in_band = [&](std::vector<float>& of) { return of.data() + kPad * pitch + kPad; };
    const auto sample_of = [&](std::size_t filter, int n) -> float* {
        const auto at = std::ranges::lower_bound(w.sampled_rows, n);
        if (at == w.sampled_rows.end() || *at != n) return nullptr;
        return w.samples[filter].data() + (at - w.sampled_rows.begin()) * (pitch - 2 * kPad);
    };
    const auto keep = [&](std::size_t filter, float most) {
        if (most > w.highest[filter]) w.highest[filter] = most, w.highest_band[filter] = first;
    };
    const float* const light = w.row(kLight, first);
    const float* const x = w.row(kX, first);
    const float* const y = w.row(kY, first);
    const float* const has = w.row(kHas, first);
    std::size_t filter = 0;
    for (const Direction& d : kDirection) {
        const auto step = [&](int k) {
            const int along = 1 << k;
            return d.is_steep ? along * pitch + d.side[k] : along + d.side[k] * pitch;
        };
        const std::ptrdiff_t side = d.is_steep ? 1 : pitch;
        float* const across = in_band(w.across);
        for (int n = -kReach; n < rows + kReach; ++n) {
            for (std::ptrdiff_t at = n * pitch - kPad; at < n * pitch - kPad + pitch; at += kWide)
                store(load<V>(x + at) * d.across_x + load<V>(y + at) * d.across_y, across + at);
        }
        const float* const sources[3] = {across, light, has};
        for (std::size_t s = 0; s < 3; ++s) {
            float* const twos = in_band(w.twos);
            float* const fours = in_band(w.lines[0][s]);
            float* const eights = in_band(w.lines[1][s]);
            const auto add = [&](const float* of, float* to, int k, int from_row, int to_row)
                __attribute__((always_inline)) {
                const std::ptrdiff_t by = step(k);
                for (int n = from_row; n < to_row; ++n) {
                    for (std::ptrdiff_t at = n * pitch - 8; at < n * pitch + columns + 8; at += kWide)
                        store(load<V>(of + at) + load<V>(of + at + by), to + at);
                }
            };
            add(sources[s], twos, 0, -8, rows + 9);
            add(twos, fours, 1, -6, rows + 7);
            add(fours, eights, 2, -2, rows + 3);
        }
        for (std::size_t l = 0; l < std::size(kLengths); ++l, filter += kProfiles) {
            const float* const shift_line = in_band(w.lines[l][0]);
            const float* const light_line = in_band(w.lines[l][1]);
            const float* const count_line = in_band(w.lines[l][2]);
            const auto length = static_cast<float>(kLengths[l]) * kMinShare;
            Highest<V> of[kProfiles];
            for (int n = 0; n < rows; ++n) {
                float* samples[kProfiles];
                for (std::size_t p = 0; p < kProfiles; ++p) samples[p] = sample_of(filter + p, first + n);
                for (int m = 0; m < columns; m += kWide) {
                    const std::ptrdiff_t at = n * pitch + m;
                    const auto line = [&](const float* lines, int j) __attribute__((always_inline)) {
                        return load<V>(lines + at + j * side);
                    };
                    const V c0 = line(count_line, -2), c1 = line(count_line, -1), c2 = line(count_line, 0),
                            c3 = line(count_line, 1), c4 = line(count_line, 2);
                    const V s0 = line(shift_line, -2), s1 = line(shift_line, -1), s2 = line(shift_line, 0),
                            s3 = line(shift_line, 1), s4 = line(shift_line, 2);
                    const V l2 = line(light_line, 0), l3 = line(light_line, 1);
                    const auto sample = [&](std::size_t p) { return samples[p] == nullptr ? nullptr : samples[p] + m; };
                    of[0].add(s3 - s1, c1 + c3, 2 * length, 0, sample(0));
                    of[1].add((s2 + s3) - (s0 + s1), (c0 + c1) + (c2 + c3), 4 * length, 0, sample(1));
                    of[2].add((s3 + s4) - (s0 + s1), (c0 + c1) + (c3 + c4), 4 * length, 0, sample(2));
                    of[3].add(s2, c2, length, 0, sample(3));
                    of[4].add(l2, c2, length, -1, sample(4));
                    of[5].add(l2 + l3, c2 + c3, 2 * length, -1, sample(5));
                }
            }
            for (std::size_t p = 0; p < kProfiles; ++p) keep(filter + p, of[p].most());
        }
    }
    for (const Patch& patch : kPatches) {
        const float* const of = w.row(patch.deviation == Deviation::light ? kLight : kScattering, first);
        Highest<V> most;
        for (int n = 0; n < rows; ++n) {
            float* const sample = sample_of(filter, first + n);
            for (int m = 0; m < columns; m += kWide) {
                V sum{}, count{};
                for (int j = patch.from; j < patch.to; ++j) {
                    const int corner = patch.round && (j == patch.from || j == patch.to - 1) ? 1 : 0;
                    for (int i = patch.from + corner; i < patch.to - corner; ++i) {
                        const std::ptrdiff_t at = (n + j) * pitch + m + i;
                        sum += load<V>(of + at);
                        count += load<V>(has + at);
                    }
                }
                most.add(sum, count, kMinShare * static_cast<float>(patch.lenslets),
                         patch.deviation == Deviation::light ? -1 : 1, sample == nullptr ? nullptr : sample + m);
            }
        }
        keep(filter++, most.most());
    }
}

HORD_FOR_EACH_ISA(sum_band_for, sum_band)

// The median of what is not negative; -1 if less than `least` of all are.
float median_of(std::span<const float> values, std::size_t least) {
    const auto below = [values](float limit) {
        int count = 0;
        for (const float v : values) count += v < limit ? 1 : 0;
        return count;
    };
    const int none = below(0), half = (static_cast<int>(values.size()) - none) / 2;
    if (values.size() - static_cast<std::size_t>(none) < std::max<std::size_t>(least, 1)) return -1;
    float high = 1;
    while (below(high) - none <= half && high < 1e12F) high *= 4;
    float low = high > 1 ? high / 4 : 0;
    for (int step = 0; step < 12; ++step) {
        const float middle = (low + high) / 2;
        (below(middle) - none <= half ? low : high) = middle;
    }
    return high;
}

}  // namespace

std::span<const PooledFilter> pooled_filters() { return kAll; }

PooledScorer::PooledScorer(const Extents& extents, Isa isa) : work_(std::make_unique<Work>()) {
    Work& w = *work_;
    w.extents = extents;
    w.pitch = (extents.m + 15) / 16 * 16 + 2 * kPad;
    const auto pitch = static_cast<std::size_t>(w.pitch);
    for (auto& plane : w.planes) plane.assign(pitch * static_cast<std::size_t>(extents.n + 2 * kPad), 0);
    const std::size_t band = pitch * (kBandRows + 2 * kPad);
    w.across.resize(band), w.twos.resize(band);
    for (auto& of_length : w.lines) {
        for (auto& sums : of_length) sums.resize(band);
    }
    w.sampled_rows = spread(extents.n, std::max(kMinRows, (kMinSampled + extents.m - 1) / extents.m));
    for (auto& samples : w.samples) samples.assign(w.sampled_rows.size() * (pitch - 2 * kPad), -1.0F);
    w.sum_band = sum_band_for(isa);
}
PooledScorer::~PooledScorer() = default;
PooledScorer::PooledScorer(PooledScorer&&) noexcept = default;
PooledScorer& PooledScorer::operator=(PooledScorer&&) noexcept = default;

// A plane over the field, fitted to the deviations over their standard deviations, outliers with little weight.
void PooledScorer::Work::take_off_plane(Plane p, std::span<const Difference> differences, const Reference& reference) {
    const auto which = p == kLight ? Deviation::light
        : p == kScattering         ? Deviation::scattering
                                   : Deviation::deflection_shift;
    const std::vector<float>& spread_of = reference.spread[static_cast<std::size_t>(which)];
    const auto variance = [&](const Difference& d) {
        const float noise = p == kLight ? d.light_variance
            : p == kX                   ? d.x_variance
            : p == kY                   ? d.y_variance
                                        : d.scattering_variance;
        return noise + spread_of[d.at];
    };
    const double middle_m = 0.5 * (extents.m - 1), middle_n = 0.5 * (extents.n - 1);
    struct Point {
        double u, v, z, weight;  // from -1 to 1; standardised; 1 / standard deviation
    };
    std::array<Point, 2 * kFitted> points;
    std::size_t count = 0;
    const auto every = std::max<std::size_t>(1, (extents.lenslets() + kFitted - 1) / kFitted);
    // Rows of a length that `every` divides would give columns: each row begins elsewhere.
    for (std::size_t k = 0; k < extents.lenslets() && count < points.size(); k += every) {
        const int n = static_cast<int>(k) / extents.m, m = (static_cast<int>(k) % extents.m + 7 * n) % extents.m;
        if (row(kHas, n)[m] == 0) continue;
        const double weight = 1 / std::sqrt(static_cast<double>(variance(differences[extents.index(m, n)])));
        points[count++] = {(m - middle_m) / std::max(middle_m, 1.0), (n - middle_n) / std::max(middle_n, 1.0),
                           static_cast<double>(row(p, n)[m]), weight};
    }
    if (count < 9) return;
    double a = 0, b = 0, c = 0;
    for (int fit = 0; fit < kFits; ++fit) {
        double s = 0, su = 0, sv = 0, suu = 0, suv = 0, svv = 0, sz = 0, suz = 0, svz = 0;
        for (const Point& q : std::span(points).first(count)) {
            const double rest = (q.z - q.weight * (a + b * q.u + c * q.v)) / static_cast<double>(kOutlier),
                         share = fit == 0 ? 1 : 1 / (1 + rest * rest), w = share * q.weight * q.weight,
                         z = share * q.weight * q.z;
            s += w, su += w * q.u, sv += w * q.v, suu += w * q.u * q.u, suv += w * q.u * q.v, svv += w * q.v * q.v;
            sz += z, suz += z * q.u, svz += z * q.v;
        }
        const double cuu = suu * svv - suv * suv, cu = suv * sv - su * svv, cv = su * suv - suu * sv,
                     determinant = s * cuu + su * cu + sv * cv;
        if (!(determinant > 1e-6 * s * suu * svv)) return;
        a = (cuu * sz + cu * suz + cv * svz) / determinant;
        b = (cu * sz + (s * svv - sv * sv) * suz + (su * sv - s * suv) * svz) / determinant;
        c = (cv * sz + (su * sv - s * suv) * suz + (s * suu - su * su) * svz) / determinant;
    }
    const auto step_m = static_cast<float>(b / std::max(middle_m, 1.0));
    for (int n = 0; n < extents.n; ++n) {
        float* const of = row(p, n);
        const float* const has = row(kHas, n);
        const auto at_0 = static_cast<float>(a - b + c * (n - middle_n) / std::max(middle_n, 1.0));
        for (int m = 0; m < extents.m; ++m) {
            if (has[m] == 0) continue;
            of[m] -= (at_0 + step_m * static_cast<float>(m)) / std::sqrt(variance(differences[extents.index(m, n)]));
        }
    }
}

void PooledScorer::Work::load(std::span<const Difference> differences, std::span<const std::uint8_t> mask,
                              const Reference& reference) {
    const auto spread_of = [&](Deviation which) { return reference.spread[static_cast<std::size_t>(which)].data(); };
    const float* const of_light = spread_of(Deviation::light);
    const float* const of_shift = spread_of(Deviation::deflection_shift);
    const float* const of_scattering = spread_of(Deviation::scattering);
    for (int n = 0; n < extents.n; ++n) {
        float* const light = row(kLight, n);
        float* const x = row(kX, n);
        float* const y = row(kY, n);
        float* const scattering = row(kScattering, n);
        float* const has = row(kHas, n);
        for (int m = 0; m < extents.m; ++m) {
            const std::size_t k = extents.index(m, n);
            const Difference& d = differences[k];
            if ((mask[k] & (kOutside | kSaturated)) != 0 || !d.has_light) {
                light[m] = x[m] = y[m] = scattering[m] = has[m] = 0;
                continue;
            }
            has[m] = 1;
            light[m] = d.light / std::sqrt(d.light_variance + of_light[d.at]);
            if (d.has_hord) {
                x[m] = d.x / std::sqrt(d.x_variance + of_shift[d.at]);
                y[m] = d.y / std::sqrt(d.y_variance + of_shift[d.at]);
                scattering[m] = d.scattering / std::sqrt(d.scattering_variance + of_scattering[d.at]);
            } else {
                x[m] = y[m] = scattering[m] = 0;
            }
        }
    }
    for (const Plane p : {kLight, kX, kY, kScattering}) take_off_plane(p, differences, reference);
}

void PooledScorer::Work::sum() {
    highest.fill(0);
    for (int first = 0; first < extents.n; first += kBandRows)
        sum_band(*this, first, std::min(first + kBandRows, extents.n));
    const auto columns = static_cast<std::size_t>(pitch - 2 * kPad);
    for (std::size_t f = 0; f < kFilters; ++f) {
        const float median = median_of(samples[f], columns / 4);
        scale[f] = median < 0 ? 0 : std::sqrt(median / kMedianOfSquare);
    }
}

// Calls visit(column, row, weight) for the lenslets of a filter whose first one is (m, n).
template <class Visit>
void for_each_of(std::size_t filter, int m, int n, Visit&& visit) {
    const PooledFilter& f = kAll[filter];
    if (!f.is_band()) {
        const Patch& p = kPatches[filter - kBands];
        for (int j = p.from; j < p.to; ++j) {
            const int corner = p.round && (j == p.from || j == p.to - 1) ? 1 : 0;
            for (int i = p.from + corner; i < p.to - corner; ++i) visit(m + i, n + j, 1.0F);
        }
        return;
    }
    const Direction& d = kDirection[f.direction];
    for (int line = -2; line <= 2; ++line) {
        const float weight = kProfile[f.profile].weights[static_cast<std::size_t>(line + 2)];
        if (weight == 0) continue;
        for (int t = 0; t < f.length; ++t) {
            int side = line;
            for (int k = 0; k < 3; ++k) side += (t >> k & 1) != 0 ? d.side[k] : 0;
            visit(m + (d.is_steep ? side : t), n + (d.is_steep ? t : side), weight);
        }
    }
}

// The sum of a filter whose first lenslet is (m, n), and how many lenslets it has there.
std::pair<float, float> PooledScorer::Work::at(std::size_t filter, int m, int n) {
    const Deviation deviation = kAll[filter].deviation;
    const Direction& d = kDirection[kAll[filter].direction];
    float sum = 0, count = 0;
    for_each_of(filter, m, n, [&](int a, int b, float weight) {
        const float value = deviation == Deviation::light ? row(kLight, b)[a]
            : deviation == Deviation::scattering          ? row(kScattering, b)[a]
                                                          : d.across_x * row(kX, b)[a] + d.across_y * row(kY, b)[a];
        sum += weight * value;
        count += row(kHas, b)[a];
    });
    return {sum, count};
}

std::span<const float> PooledScorer::measure(std::span<const Difference> differences,
                                             std::span<const std::uint8_t> mask, const Reference& reference) {
    work_->load(differences, mask, reference);
    work_->sum();
    return work_->scale;
}

PooledPeak PooledScorer::highest(std::span<const Difference> differences, std::span<const std::uint8_t> mask,
                                 const Reference& reference) {
    PooledPeak peak;
    if (reference.pooled_scales.size() != kFilters) return peak;
    measure(differences, mask, reference);
    Work& w = *work_;
    float worst = 0;
    for (std::size_t f = 0; f < kFilters; ++f) {
        const float own = w.scale[f], learned = reference.pooled_scales[f];
        if (!(own > 0) || !(learned > 0)) continue;
        const float squared = w.highest[f] * (1 + kLearnedParts) / (own * own + kLearnedParts * learned * learned);
        if (squared > worst) worst = squared, peak.filter = f;
    }
    peak.score = std::sqrt(worst);
    return peak;
}

void PooledScorer::find(PooledPeak& peak, std::span<const Difference> differences) {
    Work& w = *work_;
    const PooledFilter& f = kAll[peak.filter];
    const int sign = f.deviation == Deviation::light ? -1 : f.deviation == Deviation::scattering ? 1 : 0;
    const int lines = f.is_band() ? kProfile[f.profile].lines : 1,
              lenslets = f.is_band() ? f.length * lines : f.profile;
    float best = -1;
    int at_m = 0, at_n = 0;
    const int first = w.highest_band[peak.filter];
    for (int n = first; n < std::min(first + kBandRows, w.extents.n); ++n) {
        for (int m = 0; m < static_cast<int>(w.pitch) - 2 * kPad; ++m) {
            const auto [sum, room] = w.at(peak.filter, m, n);
            if (room < kMinShare * static_cast<float>(lenslets) || static_cast<float>(sign) * sum < 0) continue;
            if (sum * sum / std::max(room, 1.0F) <= best) continue;
            best = sum * sum / std::max(room, 1.0F), at_m = m, at_n = n;
        }
    }
    const Direction& d = kDirection[f.direction];
    double value = 0;
    for_each_of(peak.filter, at_m, at_n, [&](int m, int n, float weight) {
        if (m < 0 || n < 0 || m >= w.extents.m || n >= w.extents.n || w.row(kHas, n)[m] == 0) return;
        const Difference& one = differences[w.extents.index(m, n)];
        ++peak.area;
        value += static_cast<double>(weight) *
            static_cast<double>(f.deviation == Deviation::light            ? one.light
                                    : f.deviation == Deviation::scattering ? one.scattering
                                                                           : d.across_x * one.x + d.across_y * one.y);
    });
    peak.value = static_cast<float>(value / std::max(peak.area, 1U));
    if (f.is_band()) {
        const float along = 0.5F * static_cast<float>(f.length - 1);
        // The mean of the steps to the side.
        const float side = kProfile[f.profile].middle +
            0.5F * static_cast<float>(d.side[0] + d.side[1] + (f.length > 4 ? d.side[2] : 0));
        peak.m = static_cast<float>(at_m) + (d.is_steep ? side : along);
        peak.n = static_cast<float>(at_n) + (d.is_steep ? along : side);
        const float major = d.is_steep ? std::abs(d.across_x) : std::abs(d.across_y);  // cosine to the row or column
        peak.length = static_cast<float>(f.length) / major;
        peak.width = static_cast<float>(f.profile < kShiftProfiles - 1 && lines == 4 ? 4
                                            : f.profile == 0                         ? 3
                                                                                     : lines) *
            major;
        return;
    }
    const Patch& patch = kPatches[peak.filter - kBands];
    const float middle = 0.5F * static_cast<float>(patch.from + patch.to - 1);
    peak.m = static_cast<float>(at_m) + middle, peak.n = static_cast<float>(at_n) + middle;
    peak.length = peak.width = static_cast<float>(patch.to - patch.from);
}

}  // namespace hord::algo
