#include "algo/compare.h"

#include <algorithm>
#include <cmath>
#include <cstring>

#include "algo/isa_targets.h"
#include "algo/mask.h"

namespace hord::algo {

// Sums over bins of products of residual r and templates x, y, b (for blur), each over the bin's variance; per lane.
struct Comparer::Templates {
    static constexpr int kLanes = 16;
    float rr[kLanes], rx[kLanes], ry[kLanes], rb[kLanes], xx[kLanes], xy[kLanes], xb[kLanes], yy[kLanes], yb[kLanes], bb[kLanes], degrees[kLanes];
};

namespace {

constexpr int kLanes = Comparer::Templates::kLanes;
constexpr float kLitDn = 1;  // a bin that expects less reads nothing, mostly

template <int Bytes>
HORD_ALWAYS_INLINE float gather(const Comparer::Taps& taps, int blocks, int first, int last, float* __restrict out) {
    float all[kLanes] = {};
    for (int block = 0; block < blocks; ++block) {
        const int k = block * kLanes;
        if (block < first || block > last) {
            for (int l = 0; l < kLanes; ++l) out[k + l] = 0;
            continue;
        }
        std::int32_t sum[kLanes] = {};
        for (int t = 0; t < taps.count; ++t) {
            const std::uint16_t* at = taps.from[t] + k;
            const std::int32_t w = taps.weights[t];
            for (int l = 0; l < kLanes; ++l) sum[l] += w * at[l];
        }
        for (int l = 0; l < kLanes; ++l) {
            const float g = static_cast<float>(sum[l] > 0 ? sum[l] : 0) * 0x1p-29F;
            const float seen = taps.light * g - (1.0F - taps.light) * (g < taps.clip ? g : taps.clip);
            out[k + l] = seen > 0.0F ? seen : 0.0F;
            all[l] += out[k + l];
        }
    }
    float total = 0;
    for (int l = 0; l < kLanes; ++l) total += all[l];
    return total;
}

// The binomial 1 4 6 4 1 along both axes, each as 1 2 1 twice. What lies around the bins is dark, and there is room for it.
template <int Bytes>
HORD_ALWAYS_INLINE void scatter(const float* g, int blocks, int row, float* __restrict half, float* __restrict other_half, float* __restrict out) {
    const int end = blocks * kLanes;
    for (int k = -3 * kLanes; k < end + 3 * kLanes; ++k) half[k] = (g[k - 1] + g[k + 1]) + 2.0F * g[k];
    for (int k = -3 * kLanes; k < end + 3 * kLanes; ++k) other_half[k] = (half[k - 1] + half[k + 1]) + 2.0F * half[k];
    for (int k = -2 * kLanes; k < end + 2 * kLanes; ++k) half[k] = (other_half[k - row] + other_half[k + row]) + 2.0F * other_half[k];
    for (int k = 0; k < end; ++k) out[k] = ((half[k - row] + half[k + row]) + 2.0F * half[k]) * 0x1p-8F;
}

// Sixteen at a time, whatever a row has: what is too much is overwritten by the next row, or lies where there are no bins.
template <int Bytes>
HORD_ALWAYS_INLINE void spread_out(const std::uint16_t* masses, int columns, int rows, float* __restrict out) {
    for (int j = 0; j < rows; ++j, masses += columns, out += columns + 2) {
        for (int l = 0; l < kLanes; ++l) out[l] = static_cast<float>(masses[l]);
    }
}

template <int Bytes>
HORD_ALWAYS_INLINE void project(const Comparer::Bins& bins, int first, int last, Comparer::Templates& out) {
    float rr[kLanes] = {}, rx[kLanes] = {}, ry[kLanes] = {}, rb[kLanes] = {}, xx[kLanes] = {}, xy[kLanes] = {}, xb[kLanes] = {}, yy[kLanes] = {}, yb[kLanes] = {},
          bb[kLanes] = {}, degrees[kLanes] = {};
    const float n = bins.light, inverse_gain = bins.inverse_gain, floor = bins.floor, inverse_floor = 1 / bins.floor;
    for (int block = 0; block < bins.blocks; ++block) {
        const int at = block * kLanes;
        const float *o = bins.mass + at, *h = bins.here + at;
        if (block < first || block > last) {  // no light is expected here
            for (int l = 0; l < kLanes; ++l) rr[l] += h[l] * inverse_floor * o[l] * o[l];
            continue;
        }
        const float *g = bins.golden + at, *s = bins.scattered + at, *above = g - bins.row, *below = g + bins.row;
        for (int l = 0; l < kLanes; ++l) {
            const float e = n * g[l];
            const float noise = e * inverse_gain;
            const float w = h[l] / (noise + floor);
            const float r = o[l] - e;
            const float x = 0.5F * n * (g[l - 1] - g[l + 1]);
            const float y = 0.5F * n * (above[l] - below[l]);
            const float b = n * (s[l] - g[l]);
            const float wr = w * r, wx = w * x, wy = w * y, wb = w * b;
            rr[l] += wr * r;
            rx[l] += wr * x;
            ry[l] += wr * y;
            rb[l] += wr * b;
            xx[l] += wx * x;
            xy[l] += wx * y;
            xb[l] += wx * b;
            yy[l] += wy * y;
            yb[l] += wy * b;
            bb[l] += wb * b;
            degrees[l] += w * (e > kLitDn ? noise + floor : noise);
        }
    }
    std::memcpy(out.rr, rr, sizeof rr), std::memcpy(out.rx, rx, sizeof rx), std::memcpy(out.ry, ry, sizeof ry), std::memcpy(out.rb, rb, sizeof rb);
    std::memcpy(out.xx, xx, sizeof xx), std::memcpy(out.xy, xy, sizeof xy), std::memcpy(out.xb, xb, sizeof xb), std::memcpy(out.yy, yy, sizeof yy);
    std::memcpy(out.yb, yb, sizeof yb), std::memcpy(out.bb, bb, sizeof bb), std::memcpy(out.degrees, degrees, sizeof degrees);
}

HORD_FOR_EACH_ISA(gather_for, float, gather, (const Comparer::Taps& taps, int blocks, int first, int last, float* out), (taps, blocks, first, last, out))
HORD_FOR_EACH_ISA(scatter_for, void, scatter, (const float* g, int blocks, int row, float* half, float* other_half, float* out), (g, blocks, row, half, other_half, out))
HORD_FOR_EACH_ISA(spread_out_for, void, spread_out, (const std::uint16_t* masses, int columns, int rows, float* out), (masses, columns, rows, out))
HORD_FOR_EACH_ISA(project_for, void, project, (const Comparer::Bins& bins, int first, int last, Comparer::Templates& out), (bins, first, last, out))

double total(const float (&lanes)[kLanes]) {
    double sum = 0;
    for (const float v : lanes) sum += static_cast<double>(v);
    return sum;
}

// Weights as integers in 1/128, which sum to 128.
void quantised(const CubicWeights& w, std::int32_t (&q)[4]) {
    std::int32_t sum = 0;
    for (int k = 0; k < 4; ++k) sum += q[k] = static_cast<std::int32_t>(std::floor(w.of[k] * 128 + 0.5));
    q[w.of[1] >= w.of[2] ? 1 : 2] += 128 - sum;  // one of the middle ones is always used
}

}  // namespace

constexpr int kRoom = 4 * kLanes;  // before the first bin and after the last

Comparer::Comparer(const Reference& reference, Isa isa)
    : reference_(reference), padded_i_(reference.extents.i + 2), blocks_(static_cast<int>(reference.stride()) / kLanes), lit_(reference.extents.lenslets()),
      golden_(reference.stride() + 2 * kRoom), scattered_(golden_.size()), half_(golden_.size()), other_half_(golden_.size()), mass_(golden_.size()),
      here_(golden_.size()), gather_(gather_for(isa)), scatter_(scatter_for(isa)), spread_out_(spread_out_for(isa)),
      project_(project_for(isa)) {
    for (int j = 0; j < reference.extents.j; ++j) {
        for (int i = 0; i < reference.extents.i; ++i) here_[kRoom + reference.place(i, j)] = 1;
    }
    const auto stride = reference.stride();
    double clipped = 0, light = 0;
    for (std::size_t k = 0; k < lit_.size(); ++k) {
        const std::uint16_t* share = reference.shares.data() + k * stride;
        const auto lit = [](std::uint16_t v) { return v > 0; };
        const auto first = static_cast<int>(std::find_if(share, share + stride, lit) - share);
        int last = static_cast<int>(stride) - 1;
        while (last > first && share[last] == 0) --last;
        const auto block = [&](int at) { return static_cast<std::uint8_t>(std::clamp(at / kLanes, 0, blocks_ - 1)); };
        if (reference.mask[k] == kValid) {
            double cut = 0;
            for (std::size_t b = 0; b < stride; ++b) cut += std::min(static_cast<double>(reference.sensor.clip_dn), static_cast<double>(share[b]) * 0x1p-15 * static_cast<double>(reference.light[k]));
            clipped += cut, light += static_cast<double>(reference.light[k]);
        }
        lit_[k] = {block(std::max(0, first - 2 * padded_i_)), block(last + 2 * padded_i_)};
    }
    clipped_ = light > 0 ? clipped / light : 0;
}

// The golden HORD and its light at a place of the reference, from the lenslets around it. False: nothing is known there. `bits`: the masks of those used.
bool Comparer::interpolate(double m, double n, double light, float& expected, std::uint8_t& bits) {
    const Extents& e = reference_.extents;
    const auto columns = static_cast<std::size_t>(e.m);
    const auto index = [&](int x, int y) { return static_cast<std::size_t>(y) * columns + static_cast<std::size_t>(x); };
    const auto near = Surroundings::of(m, n, e, [&](int x, int y) { return (reference_.mask[index(x, y)] & (kOutside | kDark)) == 0; });
    // Dark ones nearby: the light alone, evenly.
    const auto use = near.found ? near : Surroundings::of(m, n, e, [&](int x, int y) { return (reference_.mask[index(x, y)] & kOutside) == 0; });
    if (!use.found) return false;
    std::int32_t qm[4], qn[4];
    quantised(near.found ? use.along : CubicWeights::linear_at(m - std::floor(m)), qm);
    quantised(near.found ? use.across : CubicWeights::linear_at(n - std::floor(n)), qn);
    Taps taps;
    taps.count = 0;
    double sum = 0;
    bits = 0;
    Lit lit{255, 0};
    for (int r = 0; r < 4; ++r) {
        for (int c = 0; c < 4; ++c) {
            const std::int32_t w = qm[c] * qn[r];
            if (w == 0) continue;
            const std::size_t k = index(use.m + c, use.n + r);
            bits |= reference_.mask[k];
            sum += static_cast<double>(w) * static_cast<double>(reference_.light[k]);
            lit = {std::min(lit.first, lit_[k].first), std::max(lit.last, lit_[k].last)};
            taps.from[taps.count] = reference_.shares.data() + k * reference_.stride();
            taps.weights[taps.count++] = static_cast<std::int16_t>(w);
        }
    }
    const double golden = sum * 0x1p-14;
    expected = static_cast<float>(golden * light);
    if ((bits & kOutside) != 0) return false;
    if ((bits & kDark) != 0 || !(golden > 0)) return true;
    taps.light = static_cast<float>(light);
    taps.clip = static_cast<float>(static_cast<double>(reference_.sensor.clip_dn) / golden);
    around_ = lit;
    share_ = gather_(taps, blocks_, lit.first, lit.last, golden_.data() + kRoom);
    scatter_(golden_.data() + kRoom, blocks_, padded_i_, half_.data() + kRoom, other_half_.data() + kRoom, scattered_.data() + kRoom);
    expected = static_cast<float>(golden * static_cast<double>(share_));
    return true;
}

void Comparer::compare_row(const HordRow& row, int n, const PoseMap& pose, double light, std::span<Difference> out) {
    const double true_light = (light + clipped_) / (1 + clipped_);
    for (int m = 0; m < reference_.extents.m; ++m) compare(row, m, n, pose, true_light, out[static_cast<std::size_t>(m)]);
}

void Comparer::compare(const HordRow& row, int m, int n, const PoseMap& pose, double light, Difference& out) {
    out = {};
    const auto k = static_cast<std::size_t>(m);
    if ((row.mask()[k] & kSaturated) != 0) return;
    const Extents& e = reference_.extents;
    const auto q = pose.to_reference(m, n);
    float golden_light = 0;  // at the part's light
    std::uint8_t bits = 0;
    if (!interpolate(q.m, q.n, light, golden_light, bits)) return;
    out.at = static_cast<std::uint32_t>(std::clamp(static_cast<int>(std::floor(q.n + 0.5)), 0, e.n - 1) * e.m + std::clamp(static_cast<int>(std::floor(q.m + 0.5)), 0, e.m - 1));
    const double gain = static_cast<double>(reference_.sensor.electrons_per_dn), read = static_cast<double>(reference_.sensor.read_dn);
    const double floor = read * read + 1.0 / 12, golden_share = 1 + 1.0 / reference_.parts;
    const double expected = static_cast<double>(golden_light);
    const double sum = static_cast<double>(row.sums()[k]);
    out.sum = static_cast<float>(sum);
    if (expected < static_cast<double>(reference_.levels.min_sum)) return;
    out.has_light = true;
    out.light = static_cast<float>(sum / expected - 1);
    constexpr double kBinsLit = 9;  // that add their floor to the sum
    out.light_variance = static_cast<float>((expected / gain + kBinsLit * floor) * golden_share / (expected * expected));
    if ((bits & kDark) != 0 || !row.has_hord(m) || !(share_ > 0)) return;

    spread_out_(row.hord(m).mass, e.i, e.j, mass_.data() + kRoom + reference_.place(0, 0));
    Templates t;
    project_({golden_.data() + kRoom, scattered_.data() + kRoom, mass_.data() + kRoom, here_.data() + kRoom, blocks_, padded_i_, static_cast<float>(sum / static_cast<double>(share_)),
              static_cast<float>(golden_share / gain), static_cast<float>(floor)},
             around_.first, around_.last, t);
    const double xx = total(t.xx), xy = total(t.xy), xb = total(t.xb), yy = total(t.yy), yb = total(t.yb), bb = total(t.bb);
    const double rx = total(t.rx), ry = total(t.ry), rb = total(t.rb);
    // The inverse of the symmetric matrix of templates, by cofactors.
    const double c_xx = yy * bb - yb * yb, c_xy = xb * yb - xy * bb, c_xb = xy * yb - yy * xb, c_yy = xx * bb - xb * xb, c_yb = xy * xb - xx * yb,
                 c_bb = xx * yy - xy * xy;
    const double determinant = xx * c_xx + xy * c_xy + xb * c_xb;
    if (!(determinant > 1e-9 * xx * yy * bb) || !(determinant > 0)) return;
    const double a = (c_xx * rx + c_xy * ry + c_xb * rb) / determinant, b = (c_xy * rx + c_yy * ry + c_yb * rb) / determinant,
                 c = (c_xb * rx + c_yb * ry + c_bb * rb) / determinant;
    out.has_hord = true;
    // The turn of the part turns its deflections: that is no deviation.
    const auto gx = static_cast<double>(reference_.x[out.at]), gy = static_cast<double>(reference_.y[out.at]);
    const auto turned = pose.turned(gx, gy);
    out.x = static_cast<float>(a - (turned.m - gx));
    out.y = static_cast<float>(b - (turned.n - gy));
    out.blur = static_cast<float>(c);
    out.x_variance = static_cast<float>(c_xx / determinant);
    out.y_variance = static_cast<float>(c_yy / determinant);
    out.blur_variance = static_cast<float>(c_bb / determinant);
    out.chi2 = static_cast<float>(std::max(0.0, total(t.rr) - (a * rx + b * ry + c * rb)));
    out.degrees = static_cast<float>(std::max(1.0, total(t.degrees) - 3));
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
