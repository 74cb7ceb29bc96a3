#include "algo/bin_fit.h"

#include <algorithm>
#include <cstring>

#include "algo/isa_targets.h"

namespace hord::algo {

namespace {

using Slot = BinFitter::Slot;
using Layout = BinFitter::Layout;
constexpr int kAtOnce = BinFitter::kAtOnce, kRoom = BinFitter::kRoom, kLanes = BinFitter::kLanes, kLine = GoldenLines::kLine;

using Eight = Vector<float, kLanes * sizeof(float)>;
using EightInts = Vector<std::int32_t, kLanes * sizeof(std::int32_t)>;
using FourDoubles = Vector<double, kAtOnce * sizeof(double)>;

void clear(float* places, int first, int end) {
    for (int k = first; k < end; k += kLanes) store(Eight{}, places + kRoom + k);
}

// Values where there is a bin, else 0.
HORD_ALWAYS_INLINE Eight only(const EightInts& here, const Eight& values) {
    EightInts bits;
    std::memcpy(&bits, &values, sizeof bits);
    bits &= here;
    Eight masked;
    std::memcpy(&masked, &bits, sizeof masked);
    return masked;
}

// Sums of eight lanes of four slots.
HORD_ALWAYS_INLINE FourDoubles totals(const float (*lanes)[kLanes]) {
    using Four = Vector<float, 4 * sizeof(float)>;
    const auto halves = [&](int k) { return load<Four>(lanes[k]) + load<Four>(lanes[k] + kLanes / 2); };
    const Four a = halves(0), b = halves(1), c = halves(2), d = halves(3);
    const Four ab_low = __builtin_shufflevector(a, b, 0, 4, 1, 5), ab_high = __builtin_shufflevector(a, b, 2, 6, 3, 7);
    const Four cd_low = __builtin_shufflevector(c, d, 0, 4, 1, 5), cd_high = __builtin_shufflevector(c, d, 2, 6, 3, 7);
    const auto wide = [](const Four& lane) { return __builtin_convertvector(lane, FourDoubles); };
    return ((wide(__builtin_shufflevector(ab_low, cd_low, 0, 1, 4, 5)) + wide(__builtin_shufflevector(ab_low, cd_low, 2, 3, 6, 7))) +
            wide(__builtin_shufflevector(ab_high, cd_high, 0, 1, 4, 5))) +
           wide(__builtin_shufflevector(ab_high, cd_high, 2, 3, 6, 7));
}

// Masses of the bins, 0 beside them. Sixteen at a time, whatever a line has: what is too much is 0, and written over by the next line.
template <int Bytes>
HORD_ALWAYS_INLINE void spread_out(const LensletSamples& samples, const Layout& layout, float* __restrict out) {
    using Line = Vector<std::uint16_t, kLine * sizeof(std::uint16_t)>;
    Line ours{};
    for (int l = 0; l < layout.columns; ++l) ours[l] = 0xFFFF;
    const Line dark = Line{} + static_cast<std::uint16_t>(samples.dark);
    const auto lines = [&](const auto* from, auto sample) {
        for (int j = 0; j < layout.rows; ++j, from += samples.line_stride, out += layout.pitch) {
            const auto line = __builtin_convertvector(load<decltype(sample)>(from), Line);
            const Line mass = ((line > dark ? line : dark) - dark) & ours;
            using HalfLine = Vector<std::uint16_t, kLanes * sizeof(std::uint16_t)>;
            const auto low = __builtin_shufflevector(mass, mass, 0, 1, 2, 3, 4, 5, 6, 7), high = __builtin_shufflevector(mass, mass, 8, 9, 10, 11, 12, 13, 14, 15);
            static_assert(sizeof(low) == sizeof(HalfLine));
            store(__builtin_convertvector(__builtin_convertvector(low, EightInts), Eight), out);
            store(__builtin_convertvector(__builtin_convertvector(high, EightInts), Eight), out + kLanes);
        }
    };
    if (samples.wide) lines(static_cast<const std::uint16_t*>(samples.first), Line{});
    else lines(static_cast<const std::uint8_t*>(samples.first), Vector<std::uint8_t, kLine>{});
}

// Golden bins scattered by the binomial 1 4 6 4 1 along both axes. What lies around the bins is dark, and there is room for it.
template <int Bytes>
HORD_ALWAYS_INLINE void scatter(Slot* slots, int count, const Layout& layout) {
    const auto binomial = [](const float* at, std::ptrdiff_t step) {
        const Eight middle = load<Eight>(at), beside = load<Eight>(at - step) + load<Eight>(at + step), outer = load<Eight>(at - 2 * step) + load<Eight>(at + 2 * step);
        return (outer + 6.0F * middle) + 4.0F * beside;
    };
    for (int s = 0; s < count; ++s) {
        Slot& slot = slots[s];
        int k = slot.at.lit.first - 2;
        for (; k <= slot.at.lit.last + 2; k += kLanes) store(binomial(slot.golden + kRoom + k, 1) * 0x1p-8F, slot.half + kRoom + k);
        slot.half_first = slot.at.lit.first - 2, slot.half_end = k;
    }
    for (int s = 0; s < count; ++s) {
        Slot& slot = slots[s];
        const float* half = slot.half + kRoom + slot.window.first;
        float* out = slot.scattered + kRoom + slot.window.first;
        for (int block = 0; block < slot.window.blocks; ++block, half += slot.window.step, out += slot.window.step) store(binomial(half, layout.pitch), out);
    }
}

template <int Bytes>
HORD_ALWAYS_INLINE void solve(const Slot* slots, int count, const Layout& layout, BinFitter::Solution& out) {
    float lanes[BinFitter::kSums][kAtOnce][kLanes];
    for (int s = 0; s < kAtOnce; ++s) {
        const Slot& slot = slots[s < count ? s : 0];
        const float *golden = slot.golden + kRoom, *scattered = slot.scattered + kRoom, *mass = slot.mass + kRoom;
        const BinNoise& noise = slot.noise;
        const float n = slot.light, a = noise.a_dn, soft = noise.soft;
        // The bin's variance, e a + empty + lit e / (e + soft), times (e + soft).
        const float linear = (a * soft + noise.empty) + noise.lit, constant = noise.empty * soft;
        Eight rx{}, ry{}, rb{}, xx{}, xy{}, xb{}, yy{}, yb{}, bb{};
        for (int block = 0, at = slot.window.first; block < slot.window.blocks; ++block, at += slot.window.step) {
            const auto g = load<Eight>(golden + at);
            const Eight e = n * g;
            const Eight w = only(load<EightInts>(layout.here + at), (e + soft) / ((a * e + linear) * e + constant));
            const Eight r = load<Eight>(mass + at) - e;
            const Eight x = load<Eight>(golden + at - 1) - load<Eight>(golden + at + 1);
            const Eight y = load<Eight>(golden + at - layout.pitch) - load<Eight>(golden + at + layout.pitch);
            const Eight b = load<Eight>(scattered + at) - g;
            const Eight wx = w * x, wy = w * y, wb = w * b;
            rx += wx * r;
            ry += wy * r;
            rb += wb * r;
            xx += wx * x;
            xy += wx * y;
            xb += wx * b;
            yy += wy * y;
            yb += wy * b;
            bb += wb * b;
        }
        const Eight all[] = {rx, ry, rb, xx, xy, xb, yy, yb, bb};
        for (int k = 0; k < BinFitter::kSums; ++k) store(all[k], lanes[k][s]);
    }
    using Sums = BinFitter;
    const auto of = [&](Sums::Sum which) { return totals(lanes[which]); };
    const FourDoubles s_xx = of(Sums::xx), s_xy = of(Sums::xy), s_xb = of(Sums::xb), s_yy = of(Sums::yy), s_yb = of(Sums::yb), s_bb = of(Sums::bb);
    const FourDoubles s_rx = of(Sums::rx), s_ry = of(Sums::ry), s_rb = of(Sums::rb);
    // The inverse of the symmetric matrix of templates, by cofactors.
    const FourDoubles c_xx = s_yy * s_bb - s_yb * s_yb, c_xy = s_xb * s_yb - s_xy * s_bb, c_xb = s_xy * s_yb - s_yy * s_xb;
    const FourDoubles c_yy = s_xx * s_bb - s_xb * s_xb, c_yb = s_xy * s_xb - s_xx * s_yb, c_bb = s_xx * s_yy - s_xy * s_xy;
    const FourDoubles determinant = s_xx * c_xx + s_xy * c_xy + s_xb * c_xb;
    const FourDoubles nothing{}, least = 1e-9 * s_xx * s_yy * s_bb, inverse = 1 / determinant;
    store((determinant > least) & (determinant > nothing), out.found);
    store((c_xx * s_rx + c_xy * s_ry + c_xb * s_rb) * inverse, out.a);
    store((c_xy * s_rx + c_yy * s_ry + c_yb * s_rb) * inverse, out.b);
    store((c_xb * s_rx + c_yb * s_ry + c_bb * s_rb) * inverse, out.c);
    store(c_xx * inverse, out.c_xx);
    store(c_yy * inverse, out.c_yy);
    store(c_bb * inverse, out.c_bb);
}

// Chi-square of what is left. In dark bins it is weighed with the whole reading noise: one outlying reading does not move it far. `narrowed`: by how much, in
// units of lit soft, noise alone makes it less than one a bin; `bins`: of the window. Their masses are 0 after that: the others are dark.
template <int Bytes>
HORD_ALWAYS_INLINE void look_at_rest(Slot* slots, int count, const Layout& layout, const BinFitter::Solution& solution, BinFitter::Rest& out) {
    float chi2[kAtOnce][kLanes], narrowed[kAtOnce][kLanes], bins[kAtOnce][kLanes], dark[kAtOnce][kLanes];
    for (int s = 0; s < kAtOnce; ++s) {
        Eight squares{}, less{}, bins_here{};
        Slot& slot = slots[s < count ? s : 0];
        const float *golden = slot.golden + kRoom, *scattered = slot.scattered + kRoom;
        const float n = slot.light, read = slot.noise.quiet + slot.noise.lit, a_dn = slot.noise.a_dn, soft = slot.noise.soft;
        const auto a = static_cast<float>(solution.a[s]), b = static_cast<float>(solution.b[s]), c = static_cast<float>(solution.c[s]);
        for (int block = 0, at = slot.window.first; s < count && block < slot.window.blocks; ++block, at += slot.window.step) {
            float* const mass = slot.mass + kRoom + at;
            const auto g = load<Eight>(golden + at);
            const Eight e = n * g, lit = e + soft;
            const Eight rest = (load<Eight>(mass) - e) - a * (load<Eight>(golden + at - 1) - load<Eight>(golden + at + 1)) -
                               b * (load<Eight>(golden + at - layout.pitch) - load<Eight>(golden + at + layout.pitch)) - c * (load<Eight>(scattered + at) - g);
            const auto here = load<EightInts>(layout.here + at);
            const Eight w = only(here, 1.0F / ((a_dn * e + read) * lit));
            squares += (w * lit) * (rest * rest);
            less += w;
            bins_here += only(here, Eight{} + 1.0F);
            store(Eight{}, mass);
        }
        store(squares, chi2[s]);
        store(less, narrowed[s]);
        store(bins_here, bins[s]);
    }
    for (int s = 0; s < kAtOnce; ++s) {
        const float* mass = slots[s < count ? s : 0].mass + kRoom;
        Eight squares{};
        for (int k = layout.first_block * kLanes; k < (layout.last_block + 1) * kLanes; k += kLanes) {
            const auto o = load<Eight>(mass + k);
            squares += o * o;
        }
        store(squares, dark[s]);
    }
    store(totals(chi2), out.chi2);
    store(totals(narrowed), out.narrowed);
    store(totals(bins), out.bins);
    store(totals(dark), out.dark);
}

HORD_FOR_EACH_ISA(spread_out_for, void, spread_out, (const LensletSamples& samples, const Layout& layout, float* out), (samples, layout, out))
HORD_FOR_EACH_ISA(scatter_for, void, scatter, (Slot * slots, int count, const Layout& layout), (slots, count, layout))
HORD_FOR_EACH_ISA(solve_for, void, solve, (const Slot* slots, int count, const Layout& layout, BinFitter::Solution& out), (slots, count, layout, out))
HORD_FOR_EACH_ISA(look_at_rest_for, void, look_at_rest, (Slot * slots, int count, const Layout& layout, const BinFitter::Solution& solution, BinFitter::Rest& out),
                  (slots, count, layout, solution, out))

}  // namespace

BinFitter::BinFitter(const Extents& extents, std::size_t stride, Isa isa)
    : columns_(extents.i), rows_(extents.j), pitch_(extents.i + 2), blocks_(static_cast<int>(stride) / kLanes), here_(kPlaces), slots_(kAtOnce),
      spread_out_(spread_out_for(isa)), scatter_(scatter_for(isa)), solve_(solve_for(isa)), look_at_rest_(look_at_rest_for(isa)) {
    const auto place = [&](int i, int j) { return kRoom + (j + 1) * pitch_ + i + 1; };
    for (int j = 0; j < rows_; ++j) {
        for (int i = 0; i < columns_; ++i) here_[static_cast<std::size_t>(place(i, j))] = -1;
    }
    layout_ = {here_.data() + kRoom, columns_, rows_, pitch_, (place(0, 0) - kRoom) / kLanes, (place(columns_ - 1, rows_ - 1) - kRoom) / kLanes};
}

const GoldenReader::Golden& BinFitter::take(int slot, const GoldenReader& reader, double m, double n, double light) {
    Slot& s = slots_[static_cast<std::size_t>(slot)];
    clear(s.golden, s.at.written.first, s.at.written.end());
    clear(s.half, s.half_first, s.half_end);
    s.half_first = s.half_end = 0;
    s.at = reader.read(m, n, light, s.golden + kRoom);
    return s.at;
}

// All bins with light, and what scattering reaches.
BinFitter::Window BinFitter::window_of(const LitPlaces& lit) const {
    if (lit.right - lit.left < kLanes - 4 && pitch_ >= kLanes) {
        const int top = std::max(1, lit.top - 2), bottom = std::min(rows_, lit.bottom + 2);
        return {top * pitch_ + lit.left - 2, pitch_, bottom - top + 1};
    }
    const int first = std::max(0, lit.first - 2 * pitch_ - 2) / kLanes, last = std::min(blocks_ - 1, (lit.last + 2 * pitch_ + 2) / kLanes);
    return {first * kLanes, kLanes, last - first + 1};
}

void BinFitter::put(int slot, const LensletSamples& samples, float light, const BinNoise& noise) {
    Slot& s = slots_[static_cast<std::size_t>(slot)];
    s.window = window_of(s.at.lit);
    s.samples = samples;
    s.light = light;
    s.noise = noise;
    spread_out_(samples, layout_, s.mass + kRoom + pitch_ + 1);
}

// The largest reading of the window's dark bins becomes the second largest; nothing where they are equal.
BinFitter::Reading BinFitter::limit_largest_dark(Slot& slot) const {
    float largest = 0, second = 0;
    int at = -1;
    for (int block = 0; block < slot.window.blocks; ++block) {
        for (int l = 0; l < kLanes; ++l) {
            const int place = slot.window.first + block * slot.window.step + l;
            const float mass = slot.mass[kRoom + place];
            if (layout_.here[place] == 0 || slot.light * slot.golden[kRoom + place] >= slot.noise.soft) continue;
            if (mass > largest) second = largest, largest = mass, at = place;
            else second = std::max(second, mass);
        }
    }
    if (!(largest > second)) return {};
    slot.mass[kRoom + at] = second;
    return {slot.mass + kRoom + at, largest};
}

void BinFitter::fit(int count, std::array<Fit, kAtOnce>& fits) {
    Solution solution;
    Rest rest;
    const double all = columns_ * rows_;
    scatter_(slots_.data(), count, layout_);
    solve_(slots_.data(), count, layout_, solution);
    // Bends once more without the largest dark reading.
    Solution bend = solution;
    std::array<Reading, kAtOnce> limited{};
    bool any = false;
    for (std::size_t s = 0; s < static_cast<std::size_t>(count); ++s) {
        const double bent = solution.a[s] * solution.a[s] / solution.c_xx[s] + solution.b[s] * solution.b[s] / solution.c_yy[s];
        if (solution.found[s] == 0 || !(bent > kNotable * kNotable)) continue;
        limited[s] = limit_largest_dark(slots_[s]);
        any = any || limited[s].mass != nullptr;
    }
    if (any) {
        solve_(slots_.data(), count, layout_, bend);
        for (const Reading& reading : limited) {
            if (reading.mass != nullptr) *reading.mass = reading.was;
        }
    }
    look_at_rest_(slots_.data(), count, layout_, solution, rest);
    for (std::size_t s = 0; s < static_cast<std::size_t>(count); ++s) {
        const Slot& slot = slots_[s];
        Fit& fit = fits[s];
        fit.found = solution.found[s] != 0;
        if (!fit.found) continue;
        const double per_dn = 1 / static_cast<double>(slot.light), of_shift = 2 * per_dn;  // differences are over two bins
        fit.a = bend.a[s] * of_shift, fit.b = bend.b[s] * of_shift, fit.c = solution.c[s] * per_dn;
        fit.a_variance = bend.c_xx[s] * (of_shift * of_shift);
        fit.b_variance = bend.c_yy[s] * (of_shift * of_shift);
        fit.c_variance = solution.c_bb[s] * (per_dn * per_dn);
        const double lit = static_cast<double>(slot.noise.lit), per_read = 1 / (static_cast<double>(slot.noise.quiet) + lit);
        fit.chi2 = rest.chi2[s] + rest.dark[s] * per_read;
        fit.degrees = all - lit * ((all - rest.bins[s]) * per_read + static_cast<double>(slot.noise.soft) * rest.narrowed[s]);
    }
}

BinFitter::Bins BinFitter::bins_of(int slot) {
    Slot& s = slots_[static_cast<std::size_t>(slot)];
    spread_out_(s.samples, layout_, s.mass + kRoom + pitch_ + 1);
    return {s.mass + kRoom, s.golden + kRoom};
}

}  // namespace hord::algo
