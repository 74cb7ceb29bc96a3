#include "algo/compare.h"

#include <algorithm>
#include <cmath>
#include <cstring>

#if defined(__x86_64__)
#include <immintrin.h>
#endif

#include "algo/isa_targets.h"
#include "algo/mask.h"

namespace hord::algo {

namespace {

constexpr int kLanes = 8, kLine = 16;
constexpr float kEdgeBins = 0.2F, kEdgeLight = 0.1F;  // second differences of a golden map: what interpolation cannot follow
constexpr int kRoom = 64;  // before the first bin and after the last: two rows and two bins of the largest HORDs, in whole blocks, and one more
static_assert(kRoom >= 2 * (kMaxBins + 2) + 2 + 2 * kLanes && kRoom % kLanes == 0);

constexpr std::uint16_t kNoShare = 65535;

using Eight = Vector<float, kLanes * sizeof(float)>;

}  // namespace

// Sums over bins, per lane: products of residual r and templates x, y, b (for blur), each over the bin's variance; and what no template explains.
struct Comparer::Templates {
    enum Sum : std::uint8_t { rx, ry, rb, xx, xy, xb, yy, yb, bb, kSums };
    float of[kSums][kLanes];
};
struct Comparer::Rest {
    float chi2[kLanes], degrees[kLanes];
};

namespace {

// What sixteen sums of shares times weights mean at the part's light. Returns nothing where the dark level leaves nothing.
HORD_ALWAYS_INLINE void at_light(const std::int32_t (&sum)[kLine], const Comparer::Taps& taps, float (&all)[kLine], float* __restrict out) {
    for (int l = 0; l < kLine; ++l) {
        const float g = static_cast<float>(sum[l] > 0 ? sum[l] : 0) * 0x1p-29F;
        const float seen = taps.light * g - (1.0F - taps.light) * (g < taps.clip ? g : taps.clip);
        out[l] = seen > 0.0F ? seen : 0.0F;
        all[l] += out[l];
    }
}
HORD_ALWAYS_INLINE float sum_of(const float (&all)[kLine]) {
    float total = 0;
    for (int l = 0; l < kLine; ++l) total += all[l];
    return total;
}

// From the line of share `first` to that of share `last`, sixteen at a time: a Reference's stride is a multiple of that.
float gather_portable(const Comparer::Taps& taps, int first, int last, float* __restrict out) {
    float all[kLine] = {};
    for (int k = first / kLine * kLine; k <= last; k += kLine) {
        std::int32_t sum[kLine] = {};
        for (int t = 0; t < 16; ++t) {
            const std::uint16_t* at = taps.from[t] + k;
            const std::int32_t w = taps.weights[t];
            for (int l = 0; l < kLine; ++l) sum[l] += w * at[l];
        }
        at_light(sum, taps, all, out + k);
    }
    return sum_of(all);
}

#if defined(__x86_64__)
// The same integers, two taps in one multiplication.
[[gnu::target("avx2")]] float gather_avx2(const Comparer::Taps& taps, int first, int last, float* __restrict out) {
    const auto sixteen = [](const std::uint16_t* from) __attribute__((target("avx2"), always_inline)) { return _mm256_loadu_si256(reinterpret_cast<const __m256i*>(from)); };
    __m256i weights[8];
    for (int t = 0; t < 8; ++t) {
        const auto low = static_cast<std::uint16_t>(taps.weights[2 * t]), high = static_cast<std::uint16_t>(taps.weights[2 * t + 1]);
        weights[t] = _mm256_set1_epi32(static_cast<int>(static_cast<std::uint32_t>(high) << 16U | low));
    }
    float all[kLine] = {};
    for (int k = first / kLine * kLine; k <= last; k += kLine) {
        __m256i even = _mm256_setzero_si256(), odd = even;
        for (int t = 0; t < 8; ++t) {
            const __m256i a = sixteen(taps.from[2 * t] + k), b = sixteen(taps.from[2 * t + 1] + k);
            even = _mm256_add_epi32(even, _mm256_madd_epi16(_mm256_unpacklo_epi16(a, b), weights[t]));
            odd = _mm256_add_epi32(odd, _mm256_madd_epi16(_mm256_unpackhi_epi16(a, b), weights[t]));
        }
        std::int32_t sum[kLine];
        store(_mm256_permute2x128_si256(even, odd, 0x20), sum);
        store(_mm256_permute2x128_si256(even, odd, 0x31), sum + kLanes);
        at_light(sum, taps, all, out + k);
    }
    return sum_of(all);
}
auto gather_for(Isa isa) { return isa == Isa::portable ? gather_portable : gather_avx2; }
#else
auto gather_for(Isa) { return gather_portable; }
#endif

// Whole blocks that cover two rows.
int reach_of(int row) { return (2 * row + kLanes - 1) / kLanes * kLanes; }

// The binomial 1 4 6 4 1 along both axes, of the blocks first to last; light is in the shares from lit_first to lit_last alone. What lies around the
// bins is dark, and there is room for it.
template <int Bytes>
HORD_ALWAYS_INLINE void scatter(const float* g, int first, int last, int lit_first, int lit_last, int row, float* __restrict half, float* __restrict out) {
    const auto binomial = [](const float* at, std::ptrdiff_t step) {
        const Eight middle = load<Eight>(at), beside = load<Eight>(at - step) + load<Eight>(at + step), outer = load<Eight>(at - 2 * step) + load<Eight>(at + 2 * step);
        return (outer + 6.0F * middle) + 4.0F * beside;
    };
    const int begin = first * kLanes, end = (last + 1) * kLanes, reach = reach_of(row);
    int k = begin - reach;
    for (; k + kLanes <= lit_first - 2; k += kLanes) store(Eight{}, half + k);
    for (; k <= lit_last + 2; k += kLanes) store(binomial(g + k, 1), half + k);
    for (; k < end + reach; k += kLanes) store(Eight{}, half + k);
    for (int at = begin; at < end; at += kLanes) store(binomial(half + at, row) * 0x1p-8F, out + at);
}

// Sixteen at a time, whatever a line has: what is too much is overwritten by the next one, or lies where there are no bins.
template <int Bytes>
HORD_ALWAYS_INLINE void spread_out(const void* samples, std::ptrdiff_t line_stride, bool wide, std::uint32_t dark, int columns, int rows, float* __restrict out) {
    const auto lines = [&](const auto* from) {
        for (int j = 0; j < rows; ++j, from += line_stride, out += columns + 2) {
            for (int l = 0; l < kLine; ++l) {
                const std::int32_t above = static_cast<std::int32_t>(from[l]) - static_cast<std::int32_t>(dark);
                out[l] = static_cast<float>(above > 0 ? above : 0);
            }
        }
    };
    if (wide) lines(static_cast<const std::uint16_t*>(samples));
    else lines(static_cast<const std::uint8_t*>(samples));
}

template <int Bytes>
HORD_ALWAYS_INLINE void project(const Comparer::Bins& bins, int first, int last, Comparer::Templates& out) {
    using Sums = Comparer::Templates;
    Eight sum[Sums::kSums] = {};
    const float n = bins.light;
    for (int block = first; block <= last; ++block) {
        const int at = block * kLanes;
        const float* golden = bins.golden + at;
        const auto o = load<Eight>(bins.mass + at), h = load<Eight>(bins.here + at), g = load<Eight>(golden), s = load<Eight>(bins.scattered + at);
        const Eight e = n * g, lit = e + bins.noise.soft;
        const Eight w = h * lit / ((e * bins.noise.a_dn + bins.noise.empty) * lit + bins.noise.lit * e);
        const Eight r = o - e;
        const Eight x = (0.5F * n) * (load<Eight>(golden - 1) - load<Eight>(golden + 1));
        const Eight y = (0.5F * n) * (load<Eight>(golden - bins.row) - load<Eight>(golden + bins.row));
        const Eight b = n * (s - g);
        const Eight wr = w * r, wx = w * x, wy = w * y, wb = w * b;
        sum[Sums::rx] += wr * x;
        sum[Sums::ry] += wr * y;
        sum[Sums::rb] += wr * b;
        sum[Sums::xx] += wx * x;
        sum[Sums::xy] += wx * y;
        sum[Sums::xb] += wx * b;
        sum[Sums::yy] += wy * y;
        sum[Sums::yb] += wy * b;
        sum[Sums::bb] += wb * b;
    }
    for (int k = 0; k < Sums::kSums; ++k) store(sum[k], out.of[k]);
}

// In dark bins weighed with the whole reading noise: one outlying reading does not move it far.
template <int Bytes>
HORD_ALWAYS_INLINE void look_at_rest(const Comparer::Bins& bins, int first, int last, float a, float b, float c, Comparer::Rest& out) {
    Eight chi2 = {}, degrees = {};
    const float n = bins.light, read = bins.noise.quiet + bins.noise.lit, half_a = 0.5F * a * n, half_b = 0.5F * b * n, all_c = c * n, per_read = 1 / read, quiet = bins.noise.quiet * per_read;
    const auto dark = [&](int block) {  // no light is expected there
        const auto o = load<Eight>(bins.mass + block * kLanes), h = load<Eight>(bins.here + block * kLanes);
        chi2 += h * o * o * per_read;
        degrees += h * quiet;
    };
    for (int block = 0; block < first; ++block) dark(block);
    for (int block = first; block <= last; ++block) {
        const int at = block * kLanes;
        const float* golden = bins.golden + at;
        const auto o = load<Eight>(bins.mass + at), h = load<Eight>(bins.here + at), g = load<Eight>(golden), s = load<Eight>(bins.scattered + at);
        const Eight e = n * g, photons = e * bins.noise.a_dn, lit = e + bins.noise.soft;
        const Eight rest = (o - e) - half_a * (load<Eight>(golden - 1) - load<Eight>(golden + 1)) - half_b * (load<Eight>(golden - bins.row) - load<Eight>(golden + bins.row)) - all_c * (s - g);
        const Eight w = h / ((photons + read) * lit);
        chi2 += w * lit * rest * rest;
        degrees += w * ((photons + bins.noise.quiet) * lit + bins.noise.lit * e);
    }
    for (int block = last + 1; block < bins.blocks; ++block) dark(block);
    store(chi2, out.chi2);
    store(degrees, out.degrees);
}

HORD_FOR_EACH_ISA(scatter_for, void, scatter, (const float* g, int first, int last, int lit_first, int lit_last, int row, float* half, float* out),
                  (g, first, last, lit_first, lit_last, row, half, out))
HORD_FOR_EACH_ISA(spread_out_for, void, spread_out, (const void* samples, std::ptrdiff_t line_stride, bool wide, std::uint32_t dark, int columns, int rows, float* out),
                  (samples, line_stride, wide, dark, columns, rows, out))
HORD_FOR_EACH_ISA(project_for, void, project, (const Comparer::Bins& bins, int first, int last, Comparer::Templates& out), (bins, first, last, out))
HORD_FOR_EACH_ISA(look_at_rest_for, void, look_at_rest, (const Comparer::Bins& bins, int first, int last, float a, float b, float c, Comparer::Rest& out),
                  (bins, first, last, a, b, c, out))

double total(const float (&lanes)[kLanes]) {
    double sum = 0;
    for (int l = 0; l < kLanes / 2; ++l) sum += static_cast<double>(lanes[l] + lanes[l + kLanes / 2]);
    return sum;
}
// The same of four at once.
void totals(const float (*lanes)[kLanes], double* sums) {
    using Four = Vector<float, 4 * sizeof(float)>;
    using FourDoubles = Vector<double, 4 * sizeof(double)>;
    const auto halves = [&](int k) { return load<Four>(lanes[k]) + load<Four>(lanes[k] + kLanes / 2); };
    const Four a = halves(0), b = halves(1), c = halves(2), d = halves(3);
    const Four ab_low = __builtin_shufflevector(a, b, 0, 4, 1, 5), ab_high = __builtin_shufflevector(a, b, 2, 6, 3, 7);
    const Four cd_low = __builtin_shufflevector(c, d, 0, 4, 1, 5), cd_high = __builtin_shufflevector(c, d, 2, 6, 3, 7);
    const auto wide = [](const Four& lane) { return __builtin_convertvector(lane, FourDoubles); };
    store(((wide(__builtin_shufflevector(ab_low, cd_low, 0, 1, 4, 5)) + wide(__builtin_shufflevector(ab_low, cd_low, 2, 3, 6, 7))) +
           wide(__builtin_shufflevector(ab_high, cd_high, 0, 1, 4, 5))) +
              wide(__builtin_shufflevector(ab_high, cd_high, 2, 3, 6, 7)),
          sums);
}

constexpr int floor_of(double v) {
    const int towards_zero = static_cast<int>(v);
    return towards_zero - (v < towards_zero ? 1 : 0);
}

// Weights as integers in 1/128, which sum to 128.
struct Quantised {
    std::int32_t of[4];
};
constexpr Quantised quantised(const CubicWeights& w) {
    Quantised q{};
    std::int32_t sum = 0;
    for (int k = 0; k < 4; ++k) sum += q.of[k] = floor_of(w.of[k] * 128 + 0.5);
    q.of[w.of[1] >= w.of[2] ? 1 : 2] += 128 - sum;  // one of the middle ones is always used
    return q;
}
// Of places a 1024th of a lenslet apart.
struct CubicTable {
    static constexpr int kPlaces = 1024;
    Quantised of[kPlaces + 1]{};
    constexpr CubicTable() {
        for (int k = 0; k <= kPlaces; ++k) of[k] = quantised(CubicWeights::at(static_cast<double>(k) / kPlaces));
    }
    [[nodiscard]] const Quantised& at(double t) const { return of[static_cast<int>(t * kPlaces + 0.5)]; }
};
constexpr CubicTable kCubic;

// With operations alone that are rounded alike everywhere.
double exp_of(double x) {
    int halved = 0;
    for (; x > 0.5; x *= 0.5) ++halved;
    double sum = 1, term = 1;
    for (int k = 1; k <= 14; ++k) sum += term *= x / k;
    for (; halved > 0; --halved) sum *= sum;
    return sum;
}

// The variance of what a normal number of this variance has above `clip`, nothing where it has not.
double clipped_variance(double variance, double clip) {
    const double from = clip / std::sqrt(variance), step = 1.0 / 32;
    double mean = 0, square = 0;
    for (int k = 0; k < 8 * 32; ++k) {
        const double above = (k + 0.5) * step, z = from + above, density = 0.3989422804 * step / exp_of(0.5 * z * z);
        mean += density * above;
        square += density * above * above;
    }
    return variance * (square - mean * mean);
}

}  // namespace

Comparer::Comparer(const Reference& reference, Isa isa)
    : reference_(reference), padded_i_(reference.extents.i + 2), blocks_(static_cast<int>(reference.stride()) / kLanes), lit_(reference.extents.lenslets()),
      lit_of_sixteen_(lit_.size()), plain_(lit_.size()), edge_(lit_.size()), golden_(reference.stride() + 2 * kRoom), scattered_(golden_.size()), half_(golden_.size()), mass_(golden_.size()), here_(golden_.size()), copied_(static_cast<std::size_t>(kLine * kMaxBins)), gather_(gather_for(isa)), scatter_(scatter_for(isa)),
      spread_out_(spread_out_for(isa)), project_(project_for(isa)), look_at_rest_(look_at_rest_for(isa)) {
    const Extents& e = reference.extents;
    for (int j = 0; j < e.j; ++j) {
        for (int i = 0; i < e.i; ++i) here_[kRoom + reference.place(i, j)] = 1;
    }
    const auto stride = reference.stride();
    double clipped = 0, light = 0;
    for (std::size_t k = 0; k < lit_.size(); ++k) {
        const std::uint16_t* share = reference.shares.data() + k * stride;
        std::size_t first = 0, last = stride - 1;
        while (first < last && share[first] == 0) ++first;
        while (last > first && share[last] == 0) --last;
        if (reference.mask[k] == kValid) {
            double cut = 0;
            for (std::size_t b = 0; b < stride; ++b) cut += std::min(static_cast<double>(reference.sensor.clip_dn), static_cast<double>(share[b]) * 0x1p-15 * static_cast<double>(reference.light[k]));
            clipped += cut, light += static_cast<double>(reference.light[k]);
        }
        lit_[k] = {static_cast<std::uint16_t>(first), static_cast<std::uint16_t>(last)};
    }
    clipped_ = light > 0 ? clipped / light : 0;
    for (int n = 0; n + 3 < e.n; ++n) {
        for (int m = 0; m + 3 < e.m; ++m) {
            bool all = true;
            Lit lit{kNoShare, 0};
            for (int c = 0; c < 16; ++c) {
                const auto k = static_cast<std::size_t>((n + c / 4) * e.m + m + c % 4);
                all = all && reference.mask[k] == kValid;
                lit = {std::min(lit.first, lit_[k].first), std::max(lit.last, lit_[k].last)};
            }
            plain_[static_cast<std::size_t>(n * e.m + m)] = all ? 1 : 0;
            lit_of_sixteen_[static_cast<std::size_t>(n * e.m + m)] = lit;
        }
    }
    find_edges();
    const double gain = static_cast<double>(reference.sensor.electrons_per_dn), read = static_cast<double>(reference.sensor.read_dn), clip = static_cast<double>(reference.sensor.clip_dn);
    const double floor = read * read + 1.0 / 12, quiet = clipped_variance(floor, clip), empty = std::max({2 * quiet, floor / 16, 1.0 / 12});
    noise_ = {0, static_cast<float>(clip / gain + floor - quiet), static_cast<float>(std::sqrt(floor)), static_cast<float>(empty),
              static_cast<float>(quiet)};
    noise_at_edges_ = noise_;
    noise_at_edges_.empty = static_cast<float>(floor);
}

void Comparer::find_edges() {
    const Extents& e = reference_.extents;
    const auto at = [&](int m, int n) { return static_cast<std::size_t>(n * e.m + m); };
    for (int n = 0; n < e.n; ++n) {
        for (int m = 0; m < e.m; ++m) {
            if (reference_.mask[at(m, n)] == kOutside) continue;
            bool edge = reference_.mask[at(m, n)] != kValid;
            const auto bends = [&](std::size_t before, std::size_t k, std::size_t after) {
                if ((reference_.mask[before] | reference_.mask[k] | reference_.mask[after]) != kValid) return;
                const auto second = [&](const std::vector<float>& map) { return std::abs(map[before] - 2 * map[k] + map[after]); };
                edge = edge || second(reference_.x) > kEdgeBins || second(reference_.y) > kEdgeBins || second(reference_.light) > kEdgeLight * reference_.light[k];
            };
            if (m > 0 && m + 1 < e.m) bends(at(m - 1, n), at(m, n), at(m + 1, n));
            if (n > 0 && n + 1 < e.n) bends(at(m, n - 1), at(m, n), at(m, n + 1));
            for (int y = std::max(0, n - 2); edge && y <= std::min(e.n - 1, n + 2); ++y) {
                for (int x = std::max(0, m - 2); x <= std::min(e.m - 1, m + 2); ++x) edge_[at(x, y)] = 1;
            }
        }
    }
}

// The golden HORD and its light at a place of the reference, from the lenslets around it. False: nothing is known there. `bits`: the masks of those used.
bool Comparer::interpolate(double m, double n, double light, float& expected, std::uint8_t& bits) {
    const Extents& e = reference_.extents;
    const auto columns = static_cast<std::size_t>(e.m);
    const auto index = [&](int x, int y) { return static_cast<std::size_t>(y) * columns + static_cast<std::size_t>(x); };
    const int floor_m = floor_of(m), floor_n = floor_of(n);
    const bool plain = floor_m >= 1 && floor_n >= 1 && floor_m + 2 < e.m && floor_n + 2 < e.n && plain_[index(floor_m - 1, floor_n - 1)] != 0;
    Taps taps;
    int count = 0;
    double sum = 0;
    bits = 0;
    Lit lit{kNoShare, 0};
    const auto use = [&](std::size_t k, std::int32_t w) {
        bits |= reference_.mask[k];
        sum += static_cast<double>(w) * static_cast<double>(reference_.light[k]);
        lit = {std::min(lit.first, lit_[k].first), std::max(lit.last, lit_[k].last)};
        taps.from[count] = reference_.shares.data() + k * reference_.stride();
        taps.weights[count++] = static_cast<std::int16_t>(w);
    };
    if (plain) {
        const auto &qm = kCubic.at(m - floor_m).of, &qn = kCubic.at(n - floor_n).of;
        const std::size_t corner = index(floor_m - 1, floor_n - 1);
        lit = lit_of_sixteen_[corner];
        for (int r = 0; r < 4; ++r) {
            const std::size_t k = corner + index(0, r);
            const float* row = reference_.light.data() + k;
            sum += qn[r] * ((qm[0] * static_cast<double>(row[0]) + qm[1] * static_cast<double>(row[1])) + (qm[2] * static_cast<double>(row[2]) + qm[3] * static_cast<double>(row[3])));
            for (int c = 0; c < 4; ++c) {
                taps.from[4 * r + c] = reference_.shares.data() + (k + static_cast<std::size_t>(c)) * reference_.stride();
                taps.weights[4 * r + c] = static_cast<std::int16_t>(qm[c] * qn[r]);
            }
        }
    } else {
        const auto near = Surroundings::of(m, n, e, [&](int x, int y) { return (reference_.mask[index(x, y)] & (kOutside | kDark)) == 0; });
        // Dark ones nearby: the light alone, evenly.
        const auto around = near.found ? near : Surroundings::of(m, n, e, [&](int x, int y) { return (reference_.mask[index(x, y)] & kOutside) == 0; });
        if (!around.found) return false;
        const Quantised along = quantised(near.found ? around.along : CubicWeights::linear_at(m - floor_m)), across = quantised(near.found ? around.across : CubicWeights::linear_at(n - floor_n));
        for (int r = 0; r < 4; ++r) {
            for (int c = 0; c < 4; ++c) {
                const std::int32_t w = along.of[c] * across.of[r];
                if (w != 0) use(index(around.m + c, around.n + r), w);
            }
        }
        for (int t = count; t < 16; ++t) taps.from[t] = reference_.shares.data(), taps.weights[t] = 0;
    }
    const double golden = sum * 0x1p-14;
    expected = static_cast<float>(golden * light);
    if ((bits & kOutside) != 0) return false;
    if ((bits & kDark) != 0 || !(golden > 0)) return true;
    taps.light = static_cast<float>(light);
    taps.clip = static_cast<float>(static_cast<double>(reference_.sensor.clip_dn) / golden);
    const int reach = reach_of(padded_i_), first = lit.first, last = lit.last;
    around_ = {std::max(0, first - 2 * padded_i_ - 2) / kLanes, std::min(blocks_ - 1, (last + 2 * padded_i_ + 2) / kLanes)};
    float* const out = golden_.data() + kRoom;
    std::fill(out + around_.first * kLanes - reach - kLanes, out + first, 0.0F);
    std::fill(out + last, out + (around_.last + 1) * kLanes + reach + kLanes, 0.0F);
    lit_now_ = lit;
    share_ = gather_(taps, first, last, out);
    expected = static_cast<float>(golden * static_cast<double>(share_));
    return true;
}

void Comparer::compare_row(const HordRow& row, int n, const PoseMap& pose, double light, std::span<Difference> out) {
    const double true_light = (light + clipped_) / (1 + clipped_);
    for (int m = 0; m < reference_.extents.m; ++m) {
        const auto k = static_cast<std::size_t>(m);
        out[k] = {};
        if ((row.mask()[k] & kSaturated) != 0) continue;
        compare({row.hord(m).mass, reference_.extents.i, true, 0, row.sums()[k], row.has_hord(m)}, m, n, pose, true_light, out[k]);
    }
}

void Comparer::compare_row(const FrameView& frame, std::span<const std::uint32_t> sums, std::span<const std::uint8_t> mask, int n, const PoseMap& pose, double light,
                           std::span<Difference> out) {
    const Extents& e = reference_.extents;
    const double true_light = (light + clipped_) / (1 + clipped_);
    const bool wide = frame.sample_bytes() == 2;
    const auto bytes = static_cast<std::ptrdiff_t>(frame.sample_bytes());
    const auto* first = reinterpret_cast<const std::uint8_t*>(frame.data) + std::ptrdiff_t{n} * e.j * frame.stride_bytes;
    const int read_in_place = std::max(0, (frame.width_px - kLine) / e.i + 1);
    for (int m = 0; m < e.m; ++m) {
        const auto k = static_cast<std::size_t>(m);
        out[k] = {};
        if ((mask[k] & (kSaturated | kOutside)) != 0) continue;
        const std::uint8_t* samples = first + std::ptrdiff_t{m} * e.i * bytes;
        Lenslet lenslet{samples, frame.stride_bytes / bytes, wide, reference_.levels.dark, sums[k], (mask[k] & kNoHord) == 0};
        if (m >= read_in_place) {
            for (int j = 0; j < e.j; ++j) {
                for (int i = 0; i < e.i; ++i) copied_[static_cast<std::size_t>(j * kLine + i)] = static_cast<std::uint16_t>(frame.sample(m * e.i + i, n * e.j + j));
            }
            lenslet.samples = copied_.data(), lenslet.line_stride = kLine, lenslet.wide = true;
        }
        compare(lenslet, m, n, pose, true_light, out[k]);
    }
}

void Comparer::compare(const Lenslet& lenslet, int m, int n, const PoseMap& pose, double light, Difference& out) {
    const Extents& e = reference_.extents;
    const auto q = pose.to_reference(m, n);
    float golden_light = 0;  // at the part's light
    std::uint8_t bits = 0;
    if (!interpolate(q.m, q.n, light, golden_light, bits)) return;
    out.at = static_cast<std::uint32_t>(std::clamp(floor_of(q.n + 0.5), 0, e.n - 1) * e.m + std::clamp(floor_of(q.m + 0.5), 0, e.m - 1));
    const double gain = static_cast<double>(reference_.sensor.electrons_per_dn), read = static_cast<double>(reference_.sensor.read_dn);
    const double floor = read * read + 1.0 / 12, golden_share = 1 + light / reference_.parts;  // less light than its own: less of its noise
    const double expected = static_cast<double>(golden_light);
    const double sum = static_cast<double>(lenslet.sum);
    out.sum = static_cast<float>(sum);
    if (expected < static_cast<double>(reference_.levels.min_sum)) return;
    out.has_light = true;
    out.light = static_cast<float>(sum / expected - 1);
    constexpr double kBinsLit = 9;  // that add their floor to the sum
    out.light_variance = static_cast<float>((expected / gain + kBinsLit * floor) * golden_share / (expected * expected));
    if ((bits & kDark) != 0 || !lenslet.has_hord || !(share_ > 0)) return;

    spread_out_(lenslet.samples, lenslet.line_stride, lenslet.wide, lenslet.dark, e.i, e.j, mass_.data() + kRoom + reference_.place(0, 0));
    scatter_(golden_.data() + kRoom, around_.first, around_.last, lit_now_.first, lit_now_.last, padded_i_, half_.data() + kRoom, scattered_.data() + kRoom);
    using Sums = Templates;
    Templates t;
    Bins bins{golden_.data() + kRoom, scattered_.data() + kRoom, mass_.data() + kRoom, here_.data() + kRoom, blocks_, padded_i_, static_cast<float>(sum / static_cast<double>(share_)),
              edge_[out.at] != 0 ? noise_at_edges_ : noise_};
    bins.noise.a_dn = static_cast<float>(golden_share / gain);
    // Of a spot's fringes, weaker light leaves below the dark level what is not quiet.
    if (light < 1) bins.noise.empty = std::max(bins.noise.empty, static_cast<float>(floor * (1 - light) * (1 - light)));
    project_(bins, around_.first, around_.last, t);
    double sums[Sums::kSums];
    totals(t.of, sums), totals(t.of + 4, sums + 4);
    sums[8] = total(t.of[8]);
    static_assert(Sums::kSums == 9);
    const auto of = [&](Sums::Sum which) { return sums[which]; };
    const double xx = of(Sums::xx), xy = of(Sums::xy), xb = of(Sums::xb), yy = of(Sums::yy), yb = of(Sums::yb), bb = of(Sums::bb);
    const double rx = of(Sums::rx), ry = of(Sums::ry), rb = of(Sums::rb);
    // The inverse of the symmetric matrix of templates, by cofactors.
    const double c_xx = yy * bb - yb * yb, c_xy = xb * yb - xy * bb, c_xb = xy * yb - yy * xb, c_yy = xx * bb - xb * xb, c_yb = xy * xb - xx * yb,
                 c_bb = xx * yy - xy * xy;
    const double determinant = xx * c_xx + xy * c_xy + xb * c_xb;
    if (!(determinant > 1e-9 * xx * yy * bb) || !(determinant > 0)) return;
    const double inverse = 1 / determinant;
    const double a = (c_xx * rx + c_xy * ry + c_xb * rb) * inverse, b = (c_xy * rx + c_yy * ry + c_yb * rb) * inverse,
                 c = (c_xb * rx + c_yb * ry + c_bb * rb) * inverse;
    out.has_hord = true;
    out.x = static_cast<float>(a), out.y = static_cast<float>(b), out.blur = static_cast<float>(c);
    out.x_variance = static_cast<float>(c_xx * inverse);
    out.y_variance = static_cast<float>(c_yy * inverse);
    out.blur_variance = static_cast<float>(c_bb * inverse);
    Rest rest;
    look_at_rest_(bins, around_.first, around_.last, out.x, out.y, out.blur, rest);
    out.chi2 = static_cast<float>(total(rest.chi2));
    out.degrees = static_cast<float>(std::max(1.0, total(rest.degrees) - 3));
    if (std::sqrt(2 * out.chi2) > std::sqrt(2 * out.degrees) + kMuch) look_how_far(bins, out);
    // The turn of the part turns its deflections: that is no deviation.
    const auto gx = static_cast<double>(reference_.x[out.at]), gy = static_cast<double>(reference_.y[out.at]);
    const auto turned = pose.turned(gx, gy);
    out.x -= static_cast<float>(turned.m - gx);
    out.y -= static_cast<float>(turned.n - gy);
}

// Where a fit of small shifts does not say how far light went: by the mean of all bins.
void Comparer::look_how_far(const Bins& bins, Difference& out) const {
    const double a_dn = static_cast<double>(bins.noise.a_dn), quiet = static_cast<double>(bins.noise.quiet);
    struct Moments {
        double light = 0, x = 0, y = 0, xx = 0, yy = 0;
        void add(double v, double at_x, double at_y) { light += v, x += v * at_x, y += v * at_y, xx += v * at_x * at_x, yy += v * at_y * at_y; }
    } seen, wanted, places;
    for (int j = 0; j < reference_.extents.j; ++j) {
        for (int i = 0; i < reference_.extents.i; ++i) {
            const auto k = static_cast<std::ptrdiff_t>(reference_.place(i, j));
            const double x = i - 0.5 * (reference_.extents.i - 1), y = j - 0.5 * (reference_.extents.j - 1);
            seen.add(static_cast<double>(bins.mass[k]), x, y), places.add(1, x, y);
            if (k >= around_.first * kLanes && k < (around_.last + 1) * kLanes) wanted.add(static_cast<double>(bins.golden[k]), x, y);  // beyond, what is left of other lenslets
        }
    }
    if (!(seen.light > 0) || !(wanted.light > 0)) return;
    const double mean_x = wanted.x / wanted.light, mean_y = wanted.y / wanted.light;
    const double moved_x = seen.x / seen.light - mean_x, moved_y = seen.y / seen.light - mean_y;
    // At an edge the mean moves with how the edge lies in the lenslet.
    const int columns = reference_.extents.m, at_m = static_cast<int>(out.at) % columns, at_n = static_cast<int>(out.at) / columns;
    float least_x = 8, most_x = -8, least_y = 8, most_y = -8;
    for (int y = std::max(0, at_n - 1); y <= std::min(reference_.extents.n - 1, at_n + 1); ++y) {
        for (int x = std::max(0, at_m - 1); x <= std::min(columns - 1, at_m + 1); ++x) {
            const auto k = static_cast<std::size_t>(y * columns + x);
            if (reference_.mask[k] != kValid) continue;
            least_x = std::min(least_x, reference_.x[k]), most_x = std::max(most_x, reference_.x[k]);
            least_y = std::min(least_y, reference_.y[k]), most_y = std::max(most_y, reference_.y[k]);
        }
    }
    const double far = kFarBins + static_cast<double>(std::max(0.0F, std::max(most_x - least_x, most_y - least_y)));
    if (moved_x * moved_x + moved_y * moved_y <= far * far) return;
    out.x = static_cast<float>(moved_x);
    out.y = static_cast<float>(moved_y);
    const auto variance = [&](double squares, double mean, double of_places) { return (squares / wanted.light - mean * mean) * a_dn / seen.light + quiet * of_places / (seen.light * seen.light); };
    out.x_variance = static_cast<float>(std::max(variance(wanted.xx, mean_x, places.xx), static_cast<double>(out.x_variance)));
    out.y_variance = static_cast<float>(std::max(variance(wanted.yy, mean_y, places.yy), static_cast<double>(out.y_variance)));
}

Scores scores_of(const Difference& d, const Reference& reference) {
    Scores scores{};
    const auto spread = [&](Deviation which) { return reference.spread[static_cast<std::size_t>(which)][d.at]; };
    const auto set = [&](Deviation which, float z) { scores[static_cast<std::size_t>(which)] = z; };
    if (d.has_light) set(Deviation::light, d.light / std::sqrt(d.light_variance + spread(Deviation::light)));
    if (!d.has_hord) return scores;
    const float bend = spread(Deviation::bend);
    set(Deviation::bend, std::sqrt(d.x * d.x / (d.x_variance + bend) + d.y * d.y / (d.y_variance + bend)));
    set(Deviation::blur, d.blur / std::sqrt(d.blur_variance + spread(Deviation::blur)));
    // sqrt(2 chi2) is about normal; the good parts' own excess widens it.
    const float excess = spread(Deviation::shape) * d.sum, expected = d.degrees + excess;
    const float width = std::sqrt((d.degrees + 2 * excess + excess * excess) / expected);
    set(Deviation::shape, (std::sqrt(2 * d.chi2) - std::sqrt(2 * expected)) / width);
    return scores;
}

}  // namespace hord::algo
