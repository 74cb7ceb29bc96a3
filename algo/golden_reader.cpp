#include "algo/golden_reader.h"

#include <cmath>
#include <cstring>

#if defined(__x86_64__)
#include <immintrin.h>
#endif

#include "algo/isa_targets.h"
#include "algo/mask.h"
#include "algo/pose.h"

namespace hord::algo {

namespace {

constexpr int kLanes = 8, kLine = GoldenLines::kLine;
constexpr int kAhead = 6;  // lenslets: so far before they are needed, golden HORDs are fetched

using Eight = Vector<float, kLanes * sizeof(float)>;
using EightInts = Vector<std::int32_t, kLanes * sizeof(std::int32_t)>;

// What eight shares mean at the part's light. Nothing where the dark level leaves nothing.
HORD_ALWAYS_INLINE Eight at_light(const Eight& share, float light, float clip) {
    const Eight nothing{};
    const Eight g = share > nothing ? share : nothing;
    const Eight seen = light * g - (1.0F - light) * (g < clip ? g : nothing + clip);
    return seen > nothing ? seen : nothing;
}
HORD_ALWAYS_INLINE Eight at_light(const EightInts& sum, float light, float clip) { return at_light(__builtin_convertvector(sum, Eight) * 0x1p-29F, light, clip); }
HORD_ALWAYS_INLINE float total(const Eight& lanes) {
    const auto pair = [&](int k) { return lanes[k] + lanes[k + 4]; };
    return (pair(0) + pair(1)) + (pair(2) + pair(3));
}

float gather_portable(const GoldenReader::Taps& taps, GoldenLines lines, float* __restrict out) {
    Eight all{};
    for (int k = lines.first; k < lines.end(); k += kLanes) {
        EightInts sum{};
        for (int t = 0; t < 16; ++t) {
            const std::uint16_t* at = taps.from[t] + k;
            const std::int32_t w = taps.weights[t];
            for (int l = 0; l < kLanes; ++l) sum[l] += w * at[l];
        }
        const Eight seen = at_light(sum, taps.light, taps.clip);
        store(seen, out + k);
        all += seen;
    }
    return total(all);
}

void join_portable(const std::uint16_t* const (&from)[4], const std::int16_t* weights, GoldenLines lines, float* __restrict out) {
    for (int k = lines.first; k < lines.end(); ++k) {
        std::int32_t sum = 0;
        for (int t = 0; t < 4; ++t) sum += std::int32_t{weights[t]} * from[t][k];
        out[k] = static_cast<float>(sum);
    }
}

// Between four columns.
template <int Bytes>
HORD_ALWAYS_INLINE Eight between_columns(const GoldenReader::Between& b, std::ptrdiff_t k) {
    const auto of = [&](int c) { return b.weights[c] * load<Eight>(b.from[c] + k); };
    return at_light((of(0) + of(1)) + (of(2) + of(3)), b.light, b.clip);
}
template <int Bytes>
HORD_ALWAYS_INLINE float along_lines(const GoldenReader::Between& between, GoldenLines lines, float* __restrict out) {
    Eight all{};
    for (int k = lines.first; k < lines.end(); k += kLanes) {
        const Eight seen = between_columns<Bytes>(between, k);
        store(seen, out + k);
        all += seen;
    }
    return total(all);
}
template <int Bytes>
HORD_ALWAYS_INLINE float along_rows(const GoldenReader::Between& between, int rows, int pitch, float* __restrict out) {
    Eight all{};
    out += NarrowRows::kTop * NarrowRows::kPitch + NarrowRows::kFirst;
    for (int row = 0; row < rows; ++row, out += NarrowRows::kPitch) {
        const Eight seen = between_columns<Bytes>(between, std::ptrdiff_t{row} * pitch);
        store(seen, out);
        all += seen;
    }
    for (int row = 0; row < NarrowRows::kTop; ++row, out += NarrowRows::kPitch) store(Eight{}, out);
    return total(all);
}
HORD_FOR_EACH_ISA(along_lines_for, float, along_lines, (const GoldenReader::Between& between, GoldenLines lines, float* out), (between, lines, out))
HORD_FOR_EACH_ISA(along_rows_for, float, along_rows, (const GoldenReader::Between& between, int rows, int pitch, float* out), (between, rows, pitch, out))

#if defined(__x86_64__)
// The same integers, two taps in one multiplication.
[[gnu::target("avx2")]] float gather_avx2(const GoldenReader::Taps& taps, GoldenLines lines, float* __restrict out) {
    const auto sixteen = [](const std::uint16_t* from) __attribute__((target("avx2"), always_inline)) { return _mm256_loadu_si256(reinterpret_cast<const __m256i*>(from)); };
    __m256i weights[8];
    for (int t = 0; t < 8; ++t) {
        std::int32_t two;
        std::memcpy(&two, taps.weights + std::ptrdiff_t{2} * t, sizeof two);
        weights[t] = _mm256_set1_epi32(two);
    }
    Eight all{};
    for (int k = lines.first; k < lines.end(); k += kLine) {
        __m256i even = _mm256_setzero_si256(), odd = even;
        for (int t = 0; t < 8; ++t) {
            const __m256i a = sixteen(taps.from[2 * t] + k), b = sixteen(taps.from[2 * t + 1] + k);
            even = _mm256_add_epi32(even, _mm256_madd_epi16(_mm256_unpacklo_epi16(a, b), weights[t]));
            odd = _mm256_add_epi32(odd, _mm256_madd_epi16(_mm256_unpackhi_epi16(a, b), weights[t]));
        }
        const Eight first = at_light(reinterpret_cast<EightInts>(_mm256_permute2x128_si256(even, odd, 0x20)), taps.light, taps.clip);
        const Eight second = at_light(reinterpret_cast<EightInts>(_mm256_permute2x128_si256(even, odd, 0x31)), taps.light, taps.clip);
        store(first, out + k);
        store(second, out + k + kLanes);
        all += first;
        all += second;
    }
    return total(all);
}
[[gnu::target("avx2")]] void join_avx2(const std::uint16_t* const (&from)[4], const std::int16_t* weights, GoldenLines lines, float* __restrict out) {
    const auto sixteen = [](const std::uint16_t* at) __attribute__((target("avx2"), always_inline)) { return _mm256_loadu_si256(reinterpret_cast<const __m256i*>(at)); };
    std::int32_t two[2];
    std::memcpy(two, weights, sizeof two);
    const __m256i upper = _mm256_set1_epi32(two[0]), lower = _mm256_set1_epi32(two[1]);
    for (int k = lines.first; k < lines.end(); k += kLine) {
        const __m256i a = sixteen(from[0] + k), b = sixteen(from[1] + k), c = sixteen(from[2] + k), d = sixteen(from[3] + k);
        const __m256i even = _mm256_add_epi32(_mm256_madd_epi16(_mm256_unpacklo_epi16(a, b), upper), _mm256_madd_epi16(_mm256_unpacklo_epi16(c, d), lower));
        const __m256i odd = _mm256_add_epi32(_mm256_madd_epi16(_mm256_unpackhi_epi16(a, b), upper), _mm256_madd_epi16(_mm256_unpackhi_epi16(c, d), lower));
        _mm256_storeu_ps(out + k, _mm256_cvtepi32_ps(_mm256_permute2x128_si256(even, odd, 0x20)));
        _mm256_storeu_ps(out + k + kLanes, _mm256_cvtepi32_ps(_mm256_permute2x128_si256(even, odd, 0x31)));
    }
}
auto gather_for(Isa isa) { return isa == Isa::portable ? gather_portable : gather_avx2; }
auto join_for(Isa isa) { return isa == Isa::portable ? join_portable : join_avx2; }
#else
auto gather_for(Isa) { return gather_portable; }
auto join_for(Isa) { return join_portable; }
#endif

constexpr int floor_of(double v) {
    const int towards_zero = static_cast<int>(v);
    return towards_zero - (v < towards_zero ? 1 : 0);
}

// Weights as integers in 1/128, which sum to 128.
struct Quantised {
    std::int16_t of[4];
};
constexpr Quantised quantised(const CubicWeights& w) {
    Quantised q{};
    int sum = 0;
    for (int k = 0; k < 4; ++k) {
        q.of[k] = static_cast<std::int16_t>(floor_of(w.of[k] * 128 + 0.5));
        sum += q.of[k];
    }
    std::int16_t& middle = q.of[w.of[1] >= w.of[2] ? 1 : 2];  // one of the middle ones is always used
    middle = static_cast<std::int16_t>(middle + 128 - sum);
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

}  // namespace

GoldenReader::GoldenReader(const Reference& reference, Isa isa)
    : reference_(reference), lit_(reference.extents.lenslets()), lit_of_four_(lit_.size()), plain_(lit_.size()), column_bins_(kColumns * (reference.stride() + kLine)), gather_(gather_for(isa)),
      join_(join_for(isa)), along_lines_(along_lines_for(isa)), along_rows_(along_rows_for(isa)) {
    for (std::size_t c = 0; c < columns_.size(); ++c) columns_[c].bins = column_bins_.data() + c * (reference.stride() + kLine);
    const Extents& e = reference.extents;
    const auto stride = reference.stride(), pitch = static_cast<std::size_t>(e.i + 2);
    for (std::size_t k = 0; k < lit_.size(); ++k) {
        const std::uint16_t* share = reference.shares.data() + k * stride;
        for (std::size_t place = 0; place < stride; ++place) {
            if (share[place] == 0) continue;
            lit_[k].cover(static_cast<int>(place), static_cast<int>(place % pitch), static_cast<int>(place / pitch));
        }
    }
    for (int n = 0; n + 3 < e.n; ++n) {
        for (int m = 0; m < e.m; ++m) {
            const auto first = static_cast<std::size_t>(n * e.m + m);
            bool all = true;
            for (std::size_t r = 0; r < 4; ++r) {
                const std::size_t k = first + r * static_cast<std::size_t>(e.m);
                all = all && reference.mask[k] == kValid && !lit_[k].none();
                lit_of_four_[first].cover(lit_[k]);
            }
            plain_[first] = all ? 1 : 0;
        }
    }
}

void GoldenReader::start_row(const PoseMap& pose, int n, double light) {
    const auto first = pose.to_reference(0, n), last = pose.to_reference(reference_.extents.m - 1, n);
    line_m_ = first.m, line_n_ = first.n;
    line_slope_ = (last.n - first.n) / (last.m - first.m);
    row_light_ = light;
    for (Column& c : columns_) c.m = kNone;
}

void GoldenReader::join_column(int m, Column& c) {
    const Extents& e = reference_.extents;
    c.m = m;
    c.plain = false;
    if (m < 0 || m >= e.m) return;
    const double n = line_n_ + line_slope_ * (m - line_m_);
    const int floor_n = floor_of(n);
    if (floor_n < 1 || floor_n + 2 >= e.n) return;
    const auto columns = static_cast<std::size_t>(e.m), stride = reference_.stride(), k = static_cast<std::size_t>(floor_n - 1) * columns + static_cast<std::size_t>(m);
    if (plain_[k] == 0) return;
    c.plain = true;
    for (int at = c.written.first; at < c.written.end(); at += kLanes) store(Eight{}, c.bins + at);
    c.lit = lit_of_four_[k];
    const int lines = (c.lit.last() - c.lit.first()) / kLine + 1;
    c.written = {std::min<int>(c.lit.first(), static_cast<int>(stride) - lines * kLine), lines};
    const Quantised& across = kCubic.at(n - floor_n);
    const std::uint16_t* from[4];
    float light[4];
    for (std::size_t r = 0; r < 4; ++r) {
        from[r] = reference_.shares.data() + (k + r * columns) * stride;
        light[r] = static_cast<float>(across.of[r]) * reference_.light[k + r * columns];
    }
    c.light = (light[0] + light[1]) + (light[2] + light[3]);
    join_(from, across.of, c.written, c.bins);
    if (m + kAhead < e.m) {
        const std::uint16_t* soon = from[3] + kAhead * stride;
        __builtin_prefetch(soon + c.lit.first());
        __builtin_prefetch(soon + c.lit.last());
    }
}

void GoldenReader::read_in_row(PoseMap::Place at, float* bins, float* narrow, Golden& golden) {
    const int floor_m = floor_of(at.m);
    static_cast<void>(column(floor_m + 3));  // ahead: what it writes is read for the next lenslet only
    const Column* around[4];
    bool plain = true;
    for (int c = 0; c < 4; ++c) {
        around[c] = &column(floor_m - 1 + c);
        plain = plain && around[c]->plain;
    }
    if (!plain) {
        golden = read(at.m, at.n, row_light_, bins);
        return;
    }
    const Quantised& along = kCubic.at(at.m - floor_m);
    golden = {};
    golden.known = true;
    golden.share = row_light_;
    float light[4];
    Between between;
    for (int c = 0; c < 4; ++c) {
        const auto weight = static_cast<float>(along.of[c]);
        light[c] = weight * around[c]->light;
        between.weights[c] = weight * 0x1p-29F;
        golden.lit.cover(around[c]->lit);
    }
    golden.light = static_cast<double>(((light[0] + light[1]) + (light[2] + light[3])) * 0x1p-14F);
    if (!(golden.light > 0)) return;
    between.light = static_cast<float>(row_light_);
    between.clip = static_cast<float>(static_cast<double>(reference_.sensor.clip_dn) / golden.light);
    const int pitch = reference_.extents.i + 2;
    golden.narrow = golden.lit.right() - golden.lit.left() < NarrowRows::kMostColumns && golden.lit.left() <= NarrowRows::kMostLeft && pitch >= kLanes;
    if (golden.narrow) {
        const int first = golden.lit.top() * pitch + golden.lit.left() - 2;
        for (int c = 0; c < 4; ++c) between.from[c] = around[c]->bins + first;
        golden.share = static_cast<double>(along_rows_(between, golden.lit.bottom() - golden.lit.top() + 1, pitch, narrow));
    } else {
        for (int c = 0; c < 4; ++c) between.from[c] = around[c]->bins;
        const int lines = (golden.lit.last() - golden.lit.first()) / kLine + 1;
        golden.written = {std::min<int>(golden.lit.first(), static_cast<int>(reference_.stride()) - lines * kLine), lines};
        golden.share = static_cast<double>(along_lines_(between, golden.written, bins));
    }
    golden.has_hord = golden.share > 0;
}

GoldenReader::Golden GoldenReader::read(double m, double n, double light, float* bins) const {
    const Extents& e = reference_.extents;
    const auto columns = static_cast<std::size_t>(e.m), stride = reference_.stride();
    const auto index = [&](int x, int y) { return static_cast<std::size_t>(y) * columns + static_cast<std::size_t>(x); };
    const int floor_m = floor_of(m), floor_n = floor_of(n);
    Taps taps;
    double sum = 0;
    std::uint8_t mask = 0;
    Golden golden;
    const auto near = Surroundings::of(m, n, e, [&](int x, int y) { return (reference_.mask[index(x, y)] & (kOutside | kDark)) == 0; });
    // Dark ones nearby: the light alone, evenly.
    const auto around = near.found ? near : Surroundings::of(m, n, e, [&](int x, int y) { return (reference_.mask[index(x, y)] & kOutside) == 0; });
    if (!around.found) return golden;
    const Quantised along = quantised(near.found ? around.along : CubicWeights::linear_at(m - floor_m)), across = quantised(near.found ? around.across : CubicWeights::linear_at(n - floor_n));
    int count = 0;
    for (int r = 0; r < 4; ++r) {
        for (int c = 0; c < 4; ++c) {
            const int w = along.of[c] * across.of[r];
            if (w == 0) continue;
            const std::size_t k = index(around.m + c, around.n + r);
            mask |= reference_.mask[k];
            sum += w * static_cast<double>(reference_.light[k]);
            golden.lit.cover(lit_[k]);
            taps.from[count] = reference_.shares.data() + k * stride;
            taps.weights[count++] = static_cast<std::int16_t>(w);
        }
    }
    for (int t = count; t < 16; ++t) taps.from[t] = reference_.shares.data(), taps.weights[t] = 0;
    if ((mask & kOutside) != 0) return golden;
    golden.known = true;
    golden.light = sum * 0x1p-14;
    golden.share = light;
    if ((mask & kDark) != 0 || !(golden.light > 0) || golden.lit.none()) return golden;
    taps.light = static_cast<float>(light);
    taps.clip = static_cast<float>(static_cast<double>(reference_.sensor.clip_dn) / golden.light);
    const int lines = (golden.lit.last() - golden.lit.first()) / kLine + 1;
    golden.written = {std::min<int>(golden.lit.first(), static_cast<int>(stride) - lines * kLine), lines};
    golden.share = static_cast<double>(gather_(taps, golden.written, bins));
    golden.has_hord = golden.share > 0;
    return golden;
}

}  // namespace hord::algo
