#include "algo/bin_fit.h"

#include <algorithm>
#include <cstring>

#include "algo/isa_targets.h"

namespace hord::algo {

namespace {

using Slot = BinFitter::Slot;
using Layout = BinFitter::Layout;
static_assert(NarrowRows::kMostColumns == BinFitter::kLanes - 4);  // what scattering reaches has room
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
    const Four even = __builtin_shufflevector(ab_low, cd_low, 0, 1, 4, 5) + __builtin_shufflevector(ab_low, cd_low, 2, 3, 6, 7);
    const Four odd = __builtin_shufflevector(ab_high, cd_high, 0, 1, 4, 5) + __builtin_shufflevector(ab_high, cd_high, 2, 3, 6, 7);
    return __builtin_convertvector(even + odd, FourDoubles);
}
HORD_ALWAYS_INLINE float total(const Eight& lanes) {
    const auto pair = [&](int k) { return lanes[k] + lanes[k + 4]; };
    return (pair(0) + pair(1)) + (pair(2) + pair(3));
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

// The masses in a narrow window, and the sum of the squares of those outside it.
template <int Bytes>
HORD_ALWAYS_INLINE float take_rows(const LensletSamples& samples, const Layout& layout, const BinFitter::Rows& rows, float* __restrict out) {
    using Line = Vector<std::uint16_t, kLine * sizeof(std::uint16_t)>;
    using HalfLine = Vector<std::uint16_t, kLanes * sizeof(std::uint16_t)>;
    Line ours{};
    for (int l = 0; l < layout.columns; ++l) ours[l] = 0xFFFF;
    const Line beside = ours & load<Line>(rows.beside), dark = Line{} + static_cast<std::uint16_t>(samples.dark);
    const HalfLine half_dark = HalfLine{} + static_cast<std::uint16_t>(samples.dark);
    Eight squares{};
    const std::ptrdiff_t stride = samples.line_stride, left = rows.left;  // what is written below might be any of these, for all that the compiler knows
    const int first = rows.first, last = rows.last, count = layout.rows;
    const auto lines = [&](const auto* from, auto sixteen, auto eight) {
        for (int j = 0; j < count; ++j, from += stride) {
            const bool inside = j >= first && j <= last;
            const auto line = __builtin_convertvector(load<decltype(sixteen)>(from), Line);
            const Line mass = ((line > dark ? line : dark) - dark) & (inside ? beside : ours);
            EightInts pairs;
            std::memcpy(&pairs, &mass, sizeof pairs);
            const Eight even = __builtin_convertvector(pairs & 0xFFFF, Eight), odd = __builtin_convertvector((pairs >> 16) & 0xFFFF, Eight);
            squares += even * even + odd * odd;
            if (!inside) continue;
            const auto here = __builtin_convertvector(load<decltype(eight)>(from + left), HalfLine);
            store(__builtin_convertvector(__builtin_convertvector((here > half_dark ? here : half_dark) - half_dark, EightInts), Eight), out);
            out += NarrowRows::kPitch;
        }
    };
    if (samples.wide) lines(static_cast<const std::uint16_t*>(samples.first), Line{}, HalfLine{});
    else lines(static_cast<const std::uint8_t*>(samples.first), Vector<std::uint8_t, kLine>{}, Vector<std::uint8_t, kLanes>{});
    return total(squares);
}

// A narrow window's golden bins scattered by the binomial 1 4 6 4 1 along both axes: the rows of the light along theirs, each window row from five of those.
template <int Bytes>
HORD_ALWAYS_INLINE void scatter_narrow(Slot& slot) {
    constexpr int kPitch = NarrowRows::kPitch, kFirst = NarrowRows::kTop * kPitch + NarrowRows::kFirst;
    const int end = kFirst + slot.lit_rows * kPitch, below = slot.window.first + (slot.window.blocks - 1) * kPitch;
    const auto row_at = [&](int at) {
        const float* golden = slot.narrow.golden + at;
        const Eight beside = load<Eight>(golden - 1) + load<Eight>(golden + 1), outer = load<Eight>(golden - 2) + load<Eight>(golden + 2);
        return ((outer + 6.0F * load<Eight>(golden)) + 4.0F * beside) * 0x1p-8F;
    };
    Eight rows[5] = {};  // around the one that is written
    for (int at = kFirst - 2 * kPitch; at <= below; at += kPitch) {
        rows[0] = rows[1], rows[1] = rows[2], rows[2] = rows[3], rows[3] = rows[4];
        rows[4] = at + 2 * kPitch < end ? row_at(at + 2 * kPitch) : Eight{};
        store(((rows[0] + rows[4]) + 6.0F * rows[2]) + 4.0F * (rows[1] + rows[3]), slot.narrow.scattered + at);
    }
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
        if (slot.narrow_window) {
            scatter_narrow<Bytes>(slot);
            continue;
        }
        const float* golden = slot.wide.golden + kRoom;
        float* half = slot.wide.half + kRoom;
        int k = slot.at.lit.first() - 2;
        for (; k <= slot.at.lit.last() + 2; k += kLanes) store(binomial(golden + k, 1) * 0x1p-8F, half + k);
        slot.half_first = slot.at.lit.first() - 2, slot.half_end = k;
    }
    for (int s = 0; s < count; ++s) {
        Slot& slot = slots[s];
        if (slot.narrow_window) continue;
        const float* half = slot.wide.half + kRoom + slot.window.first;
        float* out = slot.wide.scattered + kRoom + slot.window.first;
        for (int block = 0; block < slot.window.blocks; ++block, half += slot.window.step, out += slot.window.step) store(binomial(half, layout.pitch), out);
    }
}

struct Sums {
    Eight rx{}, ry{}, rb{}, xx{}, xy{}, xb{}, yy{}, yb{}, bb{};
    HORD_ALWAYS_INLINE void keep(float (*lanes)[kAtOnce][kLanes], int s) const {
        store(rx, lanes[BinFitter::rx][s]), store(ry, lanes[BinFitter::ry][s]), store(rb, lanes[BinFitter::rb][s]);
        store(xx, lanes[BinFitter::xx][s]), store(xy, lanes[BinFitter::xy][s]), store(xb, lanes[BinFitter::xb][s]);
        store(yy, lanes[BinFitter::yy][s]), store(yb, lanes[BinFitter::yb][s]), store(bb, lanes[BinFitter::bb][s]);
    }
};

// A block where the golden HORD has light. `w` of the light that is expected.
template <class Weight>
HORD_ALWAYS_INLINE void add_lit(Sums& sums, const float* golden, const float* scattered, const float* mass, int pitch, float n, const Weight& weight) {
    const auto g = load<Eight>(golden);
    const Eight e = n * g, w = weight(e);
    const Eight r = load<Eight>(mass) - e;
    const Eight x = load<Eight>(golden - 1) - load<Eight>(golden + 1);
    const Eight y = load<Eight>(golden - pitch) - load<Eight>(golden + pitch);
    const Eight b = load<Eight>(scattered) - g;
    const Eight wx = w * x, wy = w * y, wb = w * b;
    sums.rx += wx * r;
    sums.ry += wy * r;
    sums.rb += wb * r;
    sums.xx += wx * x;
    sums.xy += wx * y;
    sums.xb += wx * b;
    sums.yy += wy * y;
    sums.yb += wy * b;
    sums.bb += wb * b;
}

// The rows of a narrow window: of two rows outside the light the outer has nothing but what is scattered there, the inner what is shifted there, too.
template <class Outer, class Inner, class Lit>
HORD_ALWAYS_INLINE void for_rows(const Slot& slot, const Outer& outer, const Inner& inner, const Lit& lit) {
    constexpr int kPitch = NarrowRows::kPitch;
    int at = slot.window.first;
    const int lit_first = NarrowRows::kTop * kPitch + NarrowRows::kFirst, lit_end = lit_first + slot.lit_rows * kPitch, end = at + slot.window.blocks * kPitch;
    if (at == lit_first - 2 * kPitch) outer(at), at += kPitch;
    if (at == lit_first - kPitch) inner(at, at + kPitch, -1.0F), at += kPitch;
    for (; at < lit_end; at += kPitch) lit(at);
    if (at < end) inner(at, at - kPitch, 1.0F), at += kPitch;
    if (at < end) outer(at);
}

template <int Bytes>
HORD_ALWAYS_INLINE void solve(const Slot* slots, int count, const Layout& layout, BinFitter::Solution& out) {
    float lanes[BinFitter::kSums][kAtOnce][kLanes];
    for (int s = 0; s < kAtOnce; ++s) {
        const Slot& slot = slots[s < count ? s : 0];
        const BinNoise& noise = slot.noise;
        const float n = slot.light, a = noise.a_dn, soft = noise.soft;
        // The bin's variance, e a + empty + lit e / (e + soft), times (e + soft).
        const float linear = (a * soft + noise.empty) + noise.lit, constant = noise.empty * soft;
        const auto weight = [&](const Eight& e) { return (e + soft) / ((a * e + linear) * e + constant); };
        Sums sums;
        if (slot.narrow_window) {
            const float *golden = slot.narrow.golden, *scattered = slot.narrow.scattered, *mass = slot.narrow.mass;
            const auto here = load<EightInts>(slot.here);
            const Eight dark = only(here, weight(Eight{}));
            for_rows(
                slot,
                [&](int at) {
                    const auto b = load<Eight>(scattered + at);
                    const Eight wb = dark * b;
                    sums.rb += wb * load<Eight>(mass + at);
                    sums.bb += wb * b;
                },
                [&](int at, int beside, float sign) {
                    const auto r = load<Eight>(mass + at), b = load<Eight>(scattered + at);
                    const Eight y = sign * load<Eight>(golden + beside), wy = dark * y, wb = dark * b;
                    sums.ry += wy * r;
                    sums.rb += wb * r;
                    sums.yy += wy * y;
                    sums.yb += wy * b;
                    sums.bb += wb * b;
                },
                [&](int at) { add_lit(sums, golden + at, scattered + at, mass + at, NarrowRows::kPitch, n, [&](const Eight& e) { return only(here, weight(e)); }); });
        } else {
            const float *golden = slot.wide.golden + kRoom, *scattered = slot.wide.scattered + kRoom, *mass = slot.wide.mass + kRoom;
            const std::int32_t* here = slot.here;
            for (int block = 0, at = slot.window.first; block < slot.window.blocks; ++block, at += slot.window.step, here += slot.window.step) {
                add_lit(sums, golden + at, scattered + at, mass + at, layout.pitch, n, [&](const Eight& e) { return only(load<EightInts>(here), weight(e)); });
            }
        }
        sums.keep(lanes, s);
    }
    using Of = BinFitter;
    const auto of = [&](Of::Sum which) { return totals(lanes[which]); };
    const FourDoubles s_xx = of(Of::xx), s_xy = of(Of::xy), s_xb = of(Of::xb), s_yy = of(Of::yy), s_yb = of(Of::yb), s_bb = of(Of::bb);
    const FourDoubles s_rx = of(Of::rx), s_ry = of(Of::ry), s_rb = of(Of::rb);
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
// units of lit soft, noise alone makes it less than one a bin. A wide window's masses are 0 after that: the others are dark.
template <int Bytes>
HORD_ALWAYS_INLINE void look_at_rest(Slot* slots, int count, const Layout& layout, const BinFitter::Solution& solution, BinFitter::Rest& out) {
    float chi2[kAtOnce][kLanes], narrowed[kAtOnce][kLanes];
    for (int s = 0; s < kAtOnce; ++s) {
        Eight squares{}, less{};
        const Slot& slot = slots[s < count ? s : 0];
        const float n = slot.light, read = slot.noise.quiet + slot.noise.lit, a_dn = slot.noise.a_dn, soft = slot.noise.soft;
        const auto a = static_cast<float>(solution.a[s]), b = static_cast<float>(solution.b[s]), c = static_cast<float>(solution.c[s]);
        const auto add_at = [&](const float* golden, const float* scattered, const float* mass, int pitch, const EightInts& here) {
            const auto g = load<Eight>(golden);
            const Eight e = n * g, lit = e + soft;
            const Eight rest = (load<Eight>(mass) - e) - a * (load<Eight>(golden - 1) - load<Eight>(golden + 1)) - b * (load<Eight>(golden - pitch) - load<Eight>(golden + pitch)) -
                               c * (load<Eight>(scattered) - g);
            const Eight w = only(here, 1.0F / ((a_dn * e + read) * lit));
            squares += (w * lit) * (rest * rest);
            less += w;
        };
        if (s >= count) {
        } else if (slot.narrow_window) {
            const float *golden = slot.narrow.golden, *scattered = slot.narrow.scattered, *mass = slot.narrow.mass;
            const auto here = load<EightInts>(slot.here);
            const Eight w = only(here, Eight{} + 1.0F / (read * soft)), w_soft = w * soft;
            const auto add_dark = [&](const Eight& rest) {
                squares += w_soft * (rest * rest);
                less += w;
            };
            for_rows(
                slot, [&](int at) { add_dark(load<Eight>(mass + at) - c * load<Eight>(scattered + at)); },
                [&](int at, int beside, float sign) { add_dark((load<Eight>(mass + at) - (sign * b) * load<Eight>(golden + beside)) - c * load<Eight>(scattered + at)); },
                [&](int at) { add_at(golden + at, scattered + at, mass + at, NarrowRows::kPitch, here); });
        } else {
            const float *golden = slot.wide.golden + kRoom, *scattered = slot.wide.scattered + kRoom, *mass = slot.wide.mass + kRoom;
            const std::int32_t* here = slot.here;
            for (int block = 0, at = slot.window.first; block < slot.window.blocks; ++block, at += slot.window.step, here += slot.window.step) {
                add_at(golden + at, scattered + at, mass + at, layout.pitch, load<EightInts>(here));
            }
        }
        store(squares, chi2[s]);
        store(less, narrowed[s]);
    }
    for (int s = 0; s < count; ++s) {
        Slot& slot = slots[s];
        if (slot.narrow_window) {
            out.dark[s] = static_cast<double>(slot.dark);
            continue;
        }
        Eight squares{};
        float* const mass = slot.wide.mass + kRoom;
        for (int block = 0, at = slot.window.first; block < slot.window.blocks; ++block, at += slot.window.step) store(Eight{}, mass + at);
        for (int k = layout.first_block * kLanes; k < (layout.last_block + 1) * kLanes; k += kLanes) {
            const auto o = load<Eight>(mass + k);
            squares += o * o;
        }
        out.dark[s] = static_cast<double>(total(squares));
    }
    store(totals(chi2), out.chi2);
    store(totals(narrowed), out.narrowed);
}

HORD_FOR_EACH_ISA(spread_out_for, void, spread_out, (const LensletSamples& samples, const Layout& layout, float* out), (samples, layout, out))
HORD_FOR_EACH_ISA(take_rows_for, float, take_rows, (const LensletSamples& samples, const Layout& layout, const BinFitter::Rows& rows, float* out), (samples, layout, rows, out))
HORD_FOR_EACH_ISA(scatter_for, void, scatter, (Slot * slots, int count, const Layout& layout), (slots, count, layout))
HORD_FOR_EACH_ISA(solve_for, void, solve, (const Slot* slots, int count, const Layout& layout, BinFitter::Solution& out), (slots, count, layout, out))
HORD_FOR_EACH_ISA(look_at_rest_for, void, look_at_rest, (Slot * slots, int count, const Layout& layout, const BinFitter::Solution& solution, BinFitter::Rest& out),
                  (slots, count, layout, solution, out))

}  // namespace

BinFitter::BinFitter(const Extents& extents, std::size_t stride, Isa isa)
    : columns_(extents.i), rows_(extents.j), pitch_(extents.i + 2), blocks_(static_cast<int>(stride) / kLanes), here_(kPlaces), slots_(kAtOnce),
      here_narrow_(static_cast<std::size_t>((columns_ + 1) * kLanes)), beside_(static_cast<std::size_t>((columns_ + 1) * kLine)),
      spread_out_(spread_out_for(isa)), take_rows_(take_rows_for(isa)), scatter_(scatter_for(isa)), solve_(solve_for(isa)), look_at_rest_(look_at_rest_for(isa)) {
    const auto place = [&](int i, int j) { return kRoom + (j + 1) * pitch_ + i + 1; };
    for (int j = 0; j < rows_; ++j) {
        for (int i = 0; i < columns_; ++i) here_[static_cast<std::size_t>(place(i, j))] = -1;
    }
    layout_ = {here_.data() + kRoom, columns_, rows_, pitch_, (place(0, 0) - kRoom) / kLanes, (place(columns_ - 1, rows_ - 1) - kRoom) / kLanes};
    for (int left = 1; left <= columns_; ++left) {  // place of the first column with light, 1 of the first bin; the window begins two before
        for (int l = 0; l < kLanes; ++l) here_narrow_[static_cast<std::size_t>(left * kLanes + l)] = left - 3 + l >= 0 && left - 3 + l < columns_ ? -1 : 0;
        for (int i = 0; i < kLine; ++i) beside_[static_cast<std::size_t>(left * kLine + i)] = i < left - 3 || i >= left - 3 + kLanes ? 0xFFFF : 0;
    }
}

const GoldenReader::Golden& BinFitter::take(int slot, GoldenReader& reader, PoseMap::Place at) {
    Slot& s = slots_[static_cast<std::size_t>(slot)];
    clear(s.wide.golden, s.written.first, s.written.end());
    clear(s.wide.half, s.half_first, s.half_end);
    s.half_first = s.half_end = 0;
    reader.read_in_row(at, s.wide.golden + kRoom, s.narrow.golden, s.at);
    s.written = s.at.written;
    s.narrow_window = s.at.narrow;
    return s.at;
}

// All bins with light, and what scattering reaches.
BinFitter::Window BinFitter::window_of(const LitPlaces& lit) const {
    if (lit.right() - lit.left() < kLanes - 4 && pitch_ >= kLanes) {
        const int top = std::max(1, lit.top() - 2), bottom = std::min(rows_, lit.bottom() + 2);
        return {top * pitch_ + lit.left() - 2, pitch_, bottom - top + 1};
    }
    const int first = std::max(0, lit.first() - 2 * pitch_ - 2) / kLanes, last = std::min(blocks_ - 1, (lit.last() + 2 * pitch_ + 2) / kLanes);
    return {first * kLanes, kLanes, last - first + 1};
}

void BinFitter::put(int slot, const LensletSamples& samples, float light, const BinNoise& noise) {
    Slot& s = slots_[static_cast<std::size_t>(slot)];
    s.samples = samples;
    s.light = light;
    s.noise = noise;
    const LitPlaces& lit = s.at.lit;
    if (s.at.narrow) {
        const int top = std::max(1, lit.top() - 2), bottom = std::min(rows_, lit.bottom() + 2), row = NarrowRows::kTop + top - lit.top();
        s.lit_rows = lit.bottom() - lit.top() + 1;
        s.window = {row * NarrowRows::kPitch + NarrowRows::kFirst, NarrowRows::kPitch, bottom - top + 1};
        s.here = here_narrow_.data() + std::ptrdiff_t{lit.left()} * kLanes;
        s.bins = static_cast<float>(s.window.blocks * (std::min(columns_, lit.left() + 5) - std::max(1, lit.left() - 2) + 1));
        s.dark = take_rows_(samples, layout_, {top - 1, bottom - 1, lit.left() - 3, beside_.data() + std::ptrdiff_t{lit.left()} * kLine}, s.narrow.mass + s.window.first);
        return;
    }
    s.window = window_of(lit);
    s.here = layout_.here + s.window.first;
    int bins = 0;
    for (int block = 0; block < s.window.blocks; ++block) {
        for (int l = 0; l < kLanes; ++l) bins -= s.here[block * s.window.step + l];
    }
    s.bins = static_cast<float>(bins);
    spread_out_(samples, layout_, s.wide.mass + kRoom + pitch_ + 1);
}

// The largest reading of the window's dark bins becomes the second largest; nothing where they are equal.
BinFitter::Reading BinFitter::limit_largest_dark(Slot& slot) const {
    Planes& planes = slot.narrow_window ? slot.narrow : slot.wide;
    const int first = slot.window.first + (slot.narrow_window ? 0 : kRoom), here_step = slot.narrow_window ? 0 : slot.window.step;
    float largest = 0, second = 0;
    int at = -1;
    for (int block = 0; block < slot.window.blocks; ++block) {
        for (int l = 0; l < kLanes; ++l) {
            const int place = first + block * slot.window.step + l;
            const float mass = planes.mass[place];
            if (slot.here[block * here_step + l] == 0 || slot.light * planes.golden[place] >= slot.noise.soft) continue;
            if (mass > largest) second = largest, largest = mass, at = place;
            else second = std::max(second, mass);
        }
    }
    if (!(largest > second)) return {};
    planes.mass[at] = second;
    return {planes.mass + at, largest};
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
        fit.degrees = all - lit * ((all - static_cast<double>(slot.bins)) * per_read + static_cast<double>(slot.noise.soft) * rest.narrowed[s]);
    }
}

BinFitter::Bins BinFitter::bins_of(int slot) {
    Slot& s = slots_[static_cast<std::size_t>(slot)];
    spread_out_(s.samples, layout_, s.wide.mass + kRoom + pitch_ + 1);
    if (s.at.narrow) {  // brought to where the others are
        const LitPlaces& lit = s.at.lit;
        for (int row = lit.top(); row <= lit.bottom(); ++row) {
            const float* from = s.narrow.golden + (NarrowRows::kTop + row - lit.top()) * NarrowRows::kPitch + NarrowRows::kFirst + 2;
            std::copy_n(from, lit.right() - lit.left() + 1, s.wide.golden + kRoom + row * pitch_ + lit.left());
        }
        s.written = {0, blocks_ / 2};
    }
    return {s.wide.mass + kRoom, s.wide.golden + kRoom};
}

}  // namespace hord::algo
