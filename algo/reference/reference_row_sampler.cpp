#include "algo/reference/reference_row_sampler.h"

#include <array>

#include "algo/frame/mask.h"
#include "algo/simd/multiversion.h"

namespace hord::algo {

namespace {

constexpr int kLanes = kReferenceLanes, kBlockPair = ReferenceRowSampler::kBlockPair,
              kCubicRows = ReferenceSoa::kCubicRows, kMaxRows = ReferenceSoa::kMaxRows;

constexpr QuantisedCubic quantised_of(const CubicWeights& w) {
    QuantisedCubic q{};
    int sum = 0;
    for (int k = 0; k < 4; ++k) {
        q.of[k] = static_cast<std::int16_t>(floor_of(w.of[k] * 128 + 0.5));
        sum += q.of[k];
    }
    std::int16_t& middle = q.of[w.of[1] >= w.of[2] ? 1 : 2];  // one of the middle ones is always used
    middle = static_cast<std::int16_t>(middle + 128 - sum);
    return q;
}
struct CubicTable {
    static constexpr int kPlaces = 1024;
    QuantisedCubic of[kPlaces + 1]{};
    constexpr CubicTable() {
        for (int k = 0; k <= kPlaces; ++k) of[k] = quantised_of(CubicWeights::at(static_cast<double>(k) / kPlaces));
    }
};
constexpr CubicTable kCubic;

// Interpolates `bins` of a block's columns between rows; bins outside `lit` become 0.
template <int Bytes>
HORD_ALWAYS_INLINE void interpolate_rows(const ReferenceRowSampler::RowTaps& from, const BinRect& bins,
                                         const BinRect& lit, int bin_columns, float* __restrict out) {
    constexpr int kWide = Bytes / static_cast<int>(sizeof(float));
    using Floats = Vector<float, Bytes>;
    const auto clear = [&](int j, int left, int right) {
        float* to = out + std::ptrdiff_t{j * bin_columns + left} * kBlockPair;
        for (int i = left; i <= right; ++i, to += kBlockPair) {
            for (int l = 0; l < kLanes; l += kWide) store(Floats{}, to + l);
        }
    };
    for (int j = bins.top; bins != lit && j <= bins.bottom; ++j) {
        if (j < lit.top || j > lit.bottom) clear(j, bins.left, bins.right);
        else clear(j, bins.left, lit.left - 1), clear(j, lit.right + 1, bins.right);
    }
    for (int l = 0; l < kLanes; l += kWide) {
        Floats weights[kMaxRows];
        for (int r = 0; r < kMaxRows; ++r) weights[r] = load<Floats>(from.weights[r] + l);
        for (int j = lit.top; j <= lit.bottom; ++j) {
            const float* at[kMaxRows];
            for (int r = 0; r < from.rows; ++r)
                at[r] = from.from[r] +
                    std::ptrdiff_t{(j - from.stored[r].top) * from.stored[r].columns() + lit.left -
                                   from.stored[r].left} *
                        kLanes +
                    l;
            float* to = out + std::ptrdiff_t{j * bin_columns + lit.left} * kBlockPair + l;
            const int end = lit.columns() * kLanes;
            const auto four = [&](int k) __attribute__((always_inline)) {
                return (weights[0] * load<Floats>(at[0] + k) + weights[1] * load<Floats>(at[1] + k)) +
                    (weights[2] * load<Floats>(at[2] + k) + weights[3] * load<Floats>(at[3] + k));
            };
            if (from.rows == kCubicRows) {
                for (int k = 0; k < end; k += kLanes, to += kBlockPair) store(four(k), to);
            } else {
                for (int k = 0; k < end; k += kLanes, to += kBlockPair)
                    store(four(k) + weights[4] * load<Floats>(at[4] + k), to);
            }
        }
    }
}

// Interpolates lenslets between four columns, at the part's light (docs/notes/reference.md); not below 0.
template <int Bytes>
HORD_ALWAYS_INLINE void interpolate_columns(const ReferenceRowSampler::ColumnTaps& taps, int first, const BinRect& bins,
                                            const float* light, ReferenceRowSampler::Lanes& lanes,
                                            float* __restrict out, int pitch) {
    constexpr int kWide = Bytes / static_cast<int>(sizeof(float));
    using Floats = Vector<float, Bytes>;
    const Floats nothing{};
    Floats weights[kCubicRows], sum{};
    for (int c = 0; c < kCubicRows; ++c) weights[c] = load<Floats>(lanes.weights[c] + first);
    const auto along = [&](const float* columns) {
        return (weights[0] * load<Floats>(columns) + weights[1] * load<Floats>(columns + 1)) +
            (weights[2] * load<Floats>(columns + 2) + weights[3] * load<Floats>(columns + 3));
    };
    const Floats light_dn = along(light + first) * 0x1p-14F;
    store(light_dn, lanes.light + first);
    const Floats clip = taps.clip_dn / (light_dn > nothing ? light_dn : nothing + 1.0F);
    for (Floats& w : weights) w *= 0x1p-29F;
    const float missing = 1.0F - taps.light;
    for (int j = bins.top; j <= bins.bottom; ++j, out += std::ptrdiff_t{pitch} * kWide) {
        const float* columns = taps.columns + std::ptrdiff_t{j * taps.bin_columns + bins.left} * kBlockPair + first;
        float* to = out;
        for (int i = bins.left; i <= bins.right; ++i, columns += kBlockPair, to += kWide) {
            Floats g = along(columns);
            g = g > nothing ? g : nothing;
            Floats seen = taps.light * g - missing * (g < clip ? g : clip);
            seen = seen > nothing ? seen : nothing;
            store(seen, to);
            sum += seen;
        }
    }
    store(sum, lanes.share + first);
}

HORD_FOR_EACH_ISA(interpolate_rows_for, interpolate_rows)
HORD_FOR_EACH_ISA(interpolate_columns_for, interpolate_columns)

}  // namespace

QuantisedCubic quantised(const CubicWeights& weights) { return quantised_of(weights); }
const QuantisedCubic& cubic_at(double t) { return kCubic.of[static_cast<int>(t * CubicTable::kPlaces + 0.5)]; }

ReferenceSoa::ReferenceSoa(const Reference& reference)
    : blocks_((reference.extents.m + kLanes - 1) / kLanes),
      blocks_of_(static_cast<std::size_t>(reference.extents.n) * static_cast<std::size_t>(blocks_)),
      light_(blocks_of_.size()) {
    const Extents& e = reference.extents;
    const std::size_t stride = reference.stride();
    std::vector<BinRect> own(blocks_of_.size());  // of this row alone
    std::vector<std::uint16_t> has_hord(blocks_of_.size());
    for (int n = 0; n < e.n; ++n) {
        for (int m = 0; m < e.m; ++m) {
            const std::size_t at = index(n, m / kLanes), k = e.index(m, n);
            light_[at].of[m % kLanes] = reference.light[k];
            const std::uint16_t* share = reference.shares.data() + k * stride;
            BinRect lit;
            for (int j = 0; j < e.j; ++j) {
                for (int i = 0; i < e.i; ++i) {
                    const auto column = static_cast<std::int16_t>(i), row = static_cast<std::int16_t>(j);
                    if (share[reference.place(i, j)] != 0) lit.cover({column, column, row, row});
                }
            }
            own[at].cover(lit);
            if (reference.mask[k] == kValid && !lit.none())
                has_hord[at] = static_cast<std::uint16_t>(has_hord[at] | 1U << (m % kLanes));
        }
    }
    const auto last = [&](int n) { return std::min(n + kMaxRows, e.n); };
    std::size_t vectors = 0;
    for (int n = 0; n < e.n; ++n) {
        for (int b = 0; b < blocks_; ++b) {
            Block& block = blocks_of_[index(n, b)];
            for (int row = n; row < last(n); ++row) block.lit.cover(own[index(row, b)]);
            block.complete = n + kCubicRows <= e.n ? 0xFFFF : 0;
            for (int row = n; row < std::min(n + kCubicRows, e.n); ++row) block.complete &= has_hord[index(row, b)];
            for (int row = std::max(0, n - kMaxRows + 1); row <= n; ++row)
                block.stored.cover(blocks_of_[index(row, b)].lit);
            block.first = static_cast<std::uint32_t>(vectors);
            vectors += static_cast<std::size_t>(block.stored.columns() * block.stored.rows());
        }
    }
    shares_.resize(vectors + 1);  // + 1: `first` of a last block without light is valid
    auto to = shares_.begin();
    for (int n = 0; n < e.n; ++n) {
        for (int b = 0; b < blocks_; ++b) {
            const BinRect& stored = block(n, b).stored;
            const int columns = std::min(kLanes, e.m - b * kLanes);
            for (int j = stored.top; j <= stored.bottom; ++j) {
                for (int i = stored.left; i <= stored.right; ++i, ++to) {
                    for (int c = 0; c < columns; ++c)
                        to->of[c] = static_cast<float>(
                            reference.shares[e.index(b * kLanes + c, n) * stride + reference.place(i, j)]);
                }
            }
        }
    }
}

ReferenceRowSampler::ReferenceRowSampler(const Reference& reference, const ReferenceSoa& soa, Isa isa)
    : reference_(reference), soa_(soa), columns_(static_cast<std::size_t>(reference.extents.bins() * 2)),
      interpolate_rows_(interpolate_rows_for(isa)), interpolate_columns_(interpolate_columns_for(isa)) {}

void ReferenceRowSampler::start_row(const PoseMap& pose, int n, double light) {
    const auto first = pose.to_reference(0, n), last = pose.to_reference(reference_.extents.m - 1, n);
    line_m_ = first.m, line_n_ = first.n;
    line_slope_ = (last.n - first.n) / (last.m - first.m);
    row_light_ = light;
    here_.block = next_.block = kNone;
}

// The rows and weights of a block's columns where the line crosses them, and its light.
void ReferenceRowSampler::set_up(int block, ColumnBlock& side, int lane) {
    side.block = block;
    side.complete = 0;
    side.lit = side.ready = {};
    float* const light = light_ + lane;
    std::fill_n(light, kLanes, 0.0F);
    if (block < 0 || block >= soa_.blocks()) return;
    const int rows = reference_.extents.n;
    int row[kLanes], top = rows;
    double past[kLanes];
    for (int c = 0; c < kLanes; ++c) {
        const double n = line_n_ + line_slope_ * (block * kLanes + c - line_m_);
        const int floor_n = n > 0 && n < rows ? floor_of(n) : -1;
        row[c] = -1, past[c] = n - floor_n;
        if (floor_n < 1 || floor_n + 2 >= rows || (soa_.block(floor_n - 1, block).complete >> c & 1U) == 0) continue;
        row[c] = floor_n - 1;
        top = std::min(top, row[c]);
    }
    RowTaps& taps = side.taps;
    for (auto& weights : taps.weights) std::fill_n(weights, kLanes, 0.0F);
    taps.rows = kCubicRows;
    for (int c = 0; c < kLanes; ++c) {
        const int below = row[c] - top;
        if (row[c] < 0 || below > 1) continue;  // steeper than a part may lie: left to ReferenceSampler
        side.complete |= 1U << c;
        if (below == 1) taps.rows = kMaxRows;
        const QuantisedCubic& across = cubic_at(past[c]);
        for (int r = 0; r < kCubicRows; ++r) taps.weights[below + r][c] = static_cast<float>(across.of[r]);
    }
    if (side.complete == 0) return;
    side.lit = soa_.block(top, block).lit;
    for (int r = 0; r < taps.rows; ++r) {
        const ReferenceSoa::Block& from = soa_.block(top + r, block);
        taps.from[r] = soa_.shares(from);
        taps.stored[r] = from.stored;
        const float* of_row = soa_.light(top + r, block);
        for (int c = 0; c < kLanes; ++c) light[c] += taps.weights[r][c] * of_row[c];
    }
}

void ReferenceRowSampler::interpolate_rows(const BinRect& bins, ColumnBlock& side, int lane) {
    interpolate_rows_(side.taps, bins, side.lit, reference_.extents.i, columns_.front().of + lane);
    side.ready = bins;
}

void ReferenceRowSampler::move_to(int block) {
    if (here_.block == block) return;
    if (next_.block == block) {
        here_ = next_;
        const BinRect& ready = here_.ready;
        for (int j = ready.top; j <= ready.bottom; ++j) {
            LaneFloats* at = columns_.data() + std::ptrdiff_t{j * reference_.extents.i + ready.left} * 2;
            for (int i = ready.left; i <= ready.right; ++i, at += 2) at[0] = at[1];
        }
        std::copy_n(light_ + kLanes, kLanes, light_);
    } else {
        set_up(block, here_, 0);
    }
    set_up(block + 1, next_, kLanes);
    const std::uint32_t columns = here_.complete | next_.complete << kLanes;
    complete_ = columns & columns >> 1 & columns >> 2 & columns >> 3 & 0xFFFFU;
    lit_ = {};
    if (complete_ == 0) return;
    lit_ = here_.lit;
    lit_.cover(next_.lit);
}

void ReferenceRowSampler::interpolate(int first, const BinRect& bins, Lanes& lanes, float* out, int pitch) {
    if (!here_.ready.has(bins)) interpolate_rows(bins, here_, 0);
    if (!next_.ready.has(bins)) interpolate_rows(bins, next_, kLanes);
    const ColumnTaps taps{columns_.front().of, reference_.extents.i, static_cast<float>(row_light_),
                          reference_.sensor.clip_dn};
    interpolate_columns_(taps, first, bins, light_, lanes, out, pitch);
}

}  // namespace hord::algo
