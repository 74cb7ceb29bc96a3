#include "algo/reference/template_fit.h"

#include <algorithm>
#include <cstring>

#include "algo/simd/multiversion.h"

namespace hord::algo {

namespace {

constexpr int kLanes = TemplateFitter::kLanes;
constexpr int kReach = 2;       // bins, of scattering
constexpr int kCacheLine = 64;  // bytes
constexpr int kMaxBinCount = kMaxBins * kMaxBins;
// Buffers have room for the reach around the bins: reference bins once above and below and twice to the left and right,
// rows scattered along x twice above and below.
constexpr int kMaxReference = (kMaxBins + 2 * kReach) * (kMaxBins + 4 * kReach),
              kMaxHalf = (kMaxBins + 4 * kReach) * kMaxBins;

}  // namespace

// Buffers of the lanes that are fitted together, `lanes` floats a bin.
struct TemplateFitter::Work {
    int lanes = 0, first = 0;
    BinRect lit, window;                  // lit bins; the bins that scattering reaches, within the HORD
    int reference_pitch = 0;              // bins
    BinRect reference_clear, half_clear;  // the sizes for which the buffers' borders are 0
    alignas(64) float reference_hord[kMaxReference * kLanes];
    alignas(64) float half[kMaxHalf * kLanes];            // scattered along the rows
    alignas(64) float scattering[kMaxBinCount * kLanes];  // of the window: the template b,
    alignas(64) float residual[kMaxBinCount * kLanes];    // and r
    alignas(64) float mass[kMaxBinCount][kLanes];         // of all sixteen lanes

    [[nodiscard]] float* reference_hord_at(int i, int j) {
        return reference_hord +
            std::ptrdiff_t{(j - lit.top + kReach) * reference_pitch + i - lit.left + 2 * kReach} * lanes;
    }
};

namespace {

using Work = TemplateFitter::Work;
using Eight = Vector<std::uint16_t, 16>;

// Transposes 8x8, by three perfect shuffles.
HORD_ALWAYS_INLINE void transpose(Eight (&v)[8]) {
    for (int shuffle = 0; shuffle < 3; ++shuffle) {
        Eight out[8];
        for (int k = 0; k < 4; ++k) {
            out[2 * k] = __builtin_shufflevector(v[k], v[k + 4], 0, 8, 1, 9, 2, 10, 3, 11);
            out[2 * k + 1] = __builtin_shufflevector(v[k], v[k + 4], 4, 12, 5, 13, 6, 14, 7, 15);
        }
        std::copy_n(out, 8, v);
    }
}

HORD_ALWAYS_INLINE void store_floats(const Eight& v, float* to) {
    using FourInts = Vector<std::int32_t, 16>;
    using Four = Vector<float, 16>;
    const Eight nothing{};
    const auto low = __builtin_shufflevector(v, nothing, 0, 8, 1, 9, 2, 10, 3, 11),
               high = __builtin_shufflevector(v, nothing, 4, 12, 5, 13, 6, 14, 7, 15);
    const auto floats = [](const auto& pairs) {  // little-endian
        FourInts ints;
        std::memcpy(&ints, &pairs, sizeof ints);
        return __builtin_convertvector(ints, Four);
    };
    store(floats(low), to);
    store(floats(high), to + 4);
}

template <int Bytes, class Sample>
HORD_ALWAYS_INLINE void load_masses(const LensletSamples<Sample> (&samples)[kLanes], const Extents& extents,
                                    std::uint32_t dark_dn, Work& work) {
    constexpr int kFew = 2;  // columns: with no more, scalar code is faster than a transposition
    const auto dark = static_cast<std::uint16_t>(dark_dn);
    const Eight dark_all = Eight{} + dark;
    const int columns = extents.i, rows = extents.j;
    for (int half = 0; half < kLanes; half += 8) {
        const Sample* line[8];
        std::ptrdiff_t stride[8];
        for (int l = 0; l < 8; ++l) line[l] = samples[half + l].first, stride[l] = samples[half + l].line_stride;
        float(*out)[kLanes] = work.mass;
        for (int j = 0; j < rows; ++j, out += columns) {
            int i = 0;
            for (; i + kFew < columns; i += 8) {
                Eight v[8];
                for (int l = 0; l < 8; ++l)
                    v[l] = __builtin_convertvector((load<Vector<Sample, 8 * sizeof(Sample)>>(line[l] + i)), Eight);
                transpose(v);
                for (int k = 0; k < std::min(8, columns - i); ++k)
                    store_floats((v[k] > dark_all ? v[k] : dark_all) - dark_all, out[i + k] + half);
            }
            for (; i < columns; ++i) {
                for (int l = 0; l < 8; ++l) {
                    const auto sample = static_cast<std::uint16_t>(line[l][i]);
                    out[i][half + l] = static_cast<float>(std::max(sample, dark) - dark);
                }
            }
            // Prefetch the line of the next sixteen lenslets.
            const char* const ahead = reinterpret_cast<const char*>(line[0] + (kLanes - half) * columns);
            for (int at = 0; half == 0 && at <= kLanes * columns * static_cast<int>(sizeof(Sample)); at += kCacheLine)
                __builtin_prefetch(ahead + at);
            for (int l = 0; l < 8; ++l) line[l] += stride[l];
        }
    }
}

// Reference bins scattered along their rows, by the binomial 1 4 6 4 1.
template <int Bytes>
HORD_ALWAYS_INLINE void scatter(Work& work) {
    constexpr int kWide = Bytes / static_cast<int>(sizeof(float));
    using Floats = Vector<float, Bytes>;
    const BinRect &lit = work.lit, &window = work.window;
    float* half = work.half + std::ptrdiff_t{2 * kReach * window.columns()} * kWide;
    for (int j = lit.top; j <= lit.bottom; ++j) {
        const float* at = work.reference_hord_at(window.left, j);
        for (int i = window.left; i <= window.right; ++i, at += kWide, half += kWide) {
            const Floats beside = load<Floats>(at - kWide) + load<Floats>(at + kWide),
                         outer = load<Floats>(at - 2 * kWide) + load<Floats>(at + 2 * kWide);
            store(((outer + 6.0F * load<Floats>(at)) + 4.0F * beside) * 0x1p-8F, half);
        }
    }
}

// The role of a bin decides which templates are not 0 there, and whether light is expected.
enum class BinRole : std::uint8_t {
    reached,  // by scattering only
    beside,   // left or right of the lit bins
    above,    // above or below them
    bright    // lit
};

// Calls run<role>(end) for the runs of bins of one role in row j of the window, from left to right.
template <class Run>
HORD_ALWAYS_INLINE void for_parts(int j, const BinRect& lit, const BinRect& window, const Run& run) {
    if (j >= lit.top && j <= lit.bottom) {
        run.template operator()<BinRole::reached>(lit.left - 1);
        run.template operator()<BinRole::beside>(lit.left);
        run.template operator()<BinRole::bright>(lit.right + 1);
        run.template operator()<BinRole::beside>(std::min(lit.right + 2, window.right + 1));
    } else if (j == lit.top - 1 || j == lit.bottom + 1) {
        run.template operator()<BinRole::reached>(lit.left);
        run.template operator()<BinRole::above>(lit.right + 1);
    }
    run.template operator()<BinRole::reached>(window.right + 1);
}

// One function, though long: the sums stay in registers from the loop over bins to the solution.
template <int Bytes>
HORD_ALWAYS_INLINE void fit(Work& work, const Extents& extents, TemplateFitter::Fits& fits) {
    constexpr int kWide = Bytes / static_cast<int>(sizeof(float));
    using Floats = Vector<float, Bytes>;
    const BinRect lit = work.lit, window = work.window;
    const int first = work.first, columns = window.columns(), bin_columns = extents.i;
    const std::ptrdiff_t pitch = std::ptrdiff_t{work.reference_pitch} * kWide,
                         half_pitch = std::ptrdiff_t{columns} * kWide;
    const BinNoise noise = fits.noise;
    const float a_dn = noise.a_dn, soft = noise.soft;
    const auto n = load<Floats>(fits.light + first);
    const auto mass_of = [&](int bin) { return load<Floats>(work.mass[bin] + first); };

    // The bin's variance, e a + empty + (read - empty) e / (e + soft), times (e + soft).
    const float read = noise.quiet + noise.lit, linear = a_dn * soft + read, constant = noise.empty * soft;
    const Floats dark_weight = Floats{} + 1.0F / noise.empty;
    Floats rx{}, ry{}, rb{}, xx{}, xy{}, xb{}, yy{}, yb{}, bb{};
    // Adds a bin to the sums.
    const auto add = [&]<BinRole part>(int bin, const float* g, const float* half, float* scattering, float* residual)
        __attribute__((always_inline)) {
        const Floats outer = load<Floats>(half - 2 * half_pitch) + load<Floats>(half + 2 * half_pitch),
                     inner = load<Floats>(half - half_pitch) + load<Floats>(half + half_pitch);
        Floats b = (outer + 6.0F * load<Floats>(half)) + 4.0F * inner;
        Floats r = mass_of(bin), w = dark_weight;
        if constexpr (part == BinRole::bright) {
            const auto here = load<Floats>(g);
            const Floats e = n * here;
            w = (e + soft) / ((a_dn * e + linear) * e + constant);
            b -= here;
            r -= e;
        }
        store(b, scattering);
        store(r, residual);
        const Floats wb = w * b;
        rb += wb * r;
        bb += wb * b;
        if constexpr (part == BinRole::bright || part == BinRole::beside) {
            const Floats x = load<Floats>(g - kWide) - load<Floats>(g + kWide), wx = w * x;
            rx += wx * r;
            xx += wx * x;
            xb += wx * b;
            if constexpr (part == BinRole::bright) xy += wx * (load<Floats>(g - pitch) - load<Floats>(g + pitch));
        }
        if constexpr (part == BinRole::bright || part == BinRole::above) {
            const Floats y = load<Floats>(g - pitch) - load<Floats>(g + pitch), wy = w * y;
            ry += wy * r;
            yy += wy * y;
            yb += wy * b;
        }
    };
    const float* half = work.half + (window.top - lit.top + 2 * kReach) * half_pitch;
    float *scattering = work.scattering, *residual = work.residual;
    for (int j = window.top; j <= window.bottom; ++j) {
        int i = window.left, bin = j * bin_columns + i;
        const float* g = work.reference_hord_at(i, j);
        const auto run = [&]<BinRole part>(int end) __attribute__((always_inline)) {
            for (; i < end; ++i, ++bin, g += kWide, half += kWide, scattering += kWide, residual += kWide)
                add.template operator()<part>(bin, g, half, scattering, residual);
        };
        for_parts(j, lit, window, run);
    }

    // The inverse of the symmetric matrix of templates, by cofactors.
    constexpr int kHalf = kWide / 2;
    using Doubles = Vector<double, Bytes>;
    using Halves = Vector<float, Bytes / 2>;
    float a[kWide], b[kWide], c[kWide];
    for (int h = 0; h < 2; ++h) {
        const auto of = [&](const Floats& sum) __attribute__((always_inline)) {
            float all[kWide];
            store(sum, all);
            return __builtin_convertvector(load<Halves>(all + h * kHalf), Doubles);
        };
        const Doubles s_xx = of(xx), s_xy = of(xy), s_xb = of(xb), s_yy = of(yy), s_yb = of(yb), s_bb = of(bb),
                      s_rx = of(rx), s_ry = of(ry), s_rb = of(rb);
        const Doubles c_xx = s_yy * s_bb - s_yb * s_yb, c_xy = s_xb * s_yb - s_xy * s_bb,
                      c_xb = s_xy * s_yb - s_yy * s_xb;
        const Doubles c_yy = s_xx * s_bb - s_xb * s_xb, c_yb = s_xy * s_xb - s_xx * s_yb,
                      c_bb = s_xx * s_yy - s_xy * s_xy;
        const Doubles determinant = s_xx * c_xx + s_xy * c_xy + s_xb * c_xb;
        const Doubles nothing{}, least = 1e-9 * s_xx * s_yy * s_bb;
        const auto fine = (determinant > least) & (determinant > nothing);
        const Doubles inverse = 1 / (fine ? determinant : nothing + 1.0);
        const Doubles of_a = (c_xx * s_rx + c_xy * s_ry + c_xb * s_rb) * inverse,
                      of_b = (c_xy * s_rx + c_yy * s_ry + c_yb * s_rb) * inverse;
        const Doubles of_c = (c_xb * s_rx + c_yb * s_ry + c_bb * s_rb) * inverse;
        const auto halves = [&](const Doubles& v, float* to) __attribute__((always_inline)) {
            store(__builtin_convertvector(v, Halves), to);
        };
        halves(of_a, a + h * kHalf), halves(of_b, b + h * kHalf), halves(of_c, c + h * kHalf);
        const Doubles per_dn = 1 / of(n), of_shift = 2 * per_dn;  // differences are over two bins
        const int at = first + h * kHalf;
        halves(of_a * of_shift, fits.x + at), halves(of_b * of_shift, fits.y + at),
            halves(of_c * per_dn, fits.scattering + at);
        const Doubles to_shift = inverse * of_shift, to_variance = to_shift * of_shift;
        halves(c_xx * to_variance, fits.x_variance + at), halves(c_yy * to_variance, fits.y_variance + at),
            halves(c_bb * inverse * (per_dn * per_dn), fits.scattering_variance + at);
        halves(c_xx * to_shift, fits.xx + at), halves(c_xy * to_shift, fits.xy + at),
            halves(c_xb * to_shift, fits.xb + at), halves(c_yy * to_shift, fits.yy + at),
            halves(c_yb * to_shift, fits.yb + at);
        std::int64_t found[kHalf];
        store(fine, found);
        for (int l = 0; l < kHalf; ++l) fits.found[at + l] = found[l] != 0 ? 1 : 0;
    }

    // Chi-square of the rest. Dark bins are weighted with the whole reading noise: one outlier changes it little.
    // `narrowed`: how much less than one a lit bin noise alone contributes, in units of lit * soft.
    const auto of_a = load<Floats>(a), of_b = load<Floats>(b), of_c = load<Floats>(c);
    const float per_read = 1.0F / read;
    Floats squares{}, dark{}, narrowed{};
    scattering = work.scattering, residual = work.residual;
    for (int j = window.top; j <= window.bottom; ++j) {
        int i = window.left;
        const float* g = work.reference_hord_at(i, j);
        const auto run = [&]<BinRole part>(int end) __attribute__((always_inline)) {
            for (; i < end; ++i, g += kWide, scattering += kWide, residual += kWide) {
                Floats rest = load<Floats>(residual);
                if constexpr (part == BinRole::bright || part == BinRole::beside)
                    rest -= of_a * (load<Floats>(g - kWide) - load<Floats>(g + kWide));
                if constexpr (part == BinRole::bright || part == BinRole::above)
                    rest -= of_b * (load<Floats>(g - pitch) - load<Floats>(g + pitch));
                rest -= of_c * load<Floats>(scattering);
                if constexpr (part == BinRole::bright) {
                    const Floats e = n * load<Floats>(g), more = e + soft, w = 1.0F / ((a_dn * e + read) * more);
                    squares += (w * more) * (rest * rest);
                    narrowed += w;
                } else {
                    dark += rest * rest;
                }
            }
        };
        for_parts(j, lit, window, run);
    }
    const auto add_outside = [&](int bin, int end) __attribute__((always_inline)) {
        for (; bin < end; ++bin) {
            const Floats mass = mass_of(bin);
            dark += mass * mass;
        }
    };
    add_outside(0, window.top * bin_columns);
    for (int j = window.top; j <= window.bottom; ++j) {
        add_outside(j * bin_columns, j * bin_columns + window.left);
        add_outside(j * bin_columns + window.right + 1, (j + 1) * bin_columns);
    }
    add_outside((window.bottom + 1) * bin_columns, extents.bins());
    store(squares + per_read * dark, fits.chi2 + first);
    const auto all = static_cast<float>(extents.bins()),
               not_lit = static_cast<float>(extents.bins() - lit.columns() * lit.rows());
    store(all - noise.lit * (not_lit * per_read + soft * narrowed), fits.degrees + first);
}

HORD_FOR_EACH_ISA(load8_for, load_masses, std::uint8_t)
HORD_FOR_EACH_ISA(load16_for, load_masses, std::uint16_t)
HORD_FOR_EACH_ISA(scatter_for, scatter)
HORD_FOR_EACH_ISA(fit_for, fit)

}  // namespace

TemplateFitter::TemplateFitter(const Extents& extents, Isa isa)
    : extents_(extents), at_once_(lanes_at_once(isa)), work_(common::make_opaque<Work>()), load8_(load8_for(isa)),
      load16_(load16_for(isa)), scatter_(scatter_for(isa)), fit_(fit_for(isa)) {
    work_->lanes = at_once_;
}

void TemplateFitter::load_masses(const LensletSamples<std::uint8_t> (&samples)[kLanes], std::uint32_t dark) {
    load8_(samples, extents_, dark, *work_);
}
void TemplateFitter::load_masses(const LensletSamples<std::uint16_t> (&samples)[kLanes], std::uint32_t dark) {
    load16_(samples, extents_, dark, *work_);
}

void TemplateFitter::start(int first, const BinRect& lit) {
    Work& w = *work_;
    w.first = first;
    w.lit = lit;
    const auto least = [](int v) { return static_cast<std::int16_t>(std::max(v - kReach, 0)); };
    const auto most = [](int v, int end) { return static_cast<std::int16_t>(std::min(v + kReach, end - 1)); };
    w.window = {least(lit.left), most(lit.right, extents_.i), least(lit.top), most(lit.bottom, extents_.j)};
    w.reference_pitch = lit.columns() + 4 * kReach;
    const auto same_size = [](const BinRect& a, const BinRect& b) {
        return a.columns() == b.columns() && a.rows() == b.rows();
    };
    if (!same_size(w.reference_clear, lit)) {
        std::fill_n(w.reference_hord, w.reference_pitch * (lit.rows() + 2 * kReach) * w.lanes, 0.0F);
        w.reference_clear = lit;
    }
    const BinRect half{w.window.left, w.window.right, lit.top, lit.bottom};
    if (!same_size(w.half_clear, half)) {
        std::fill_n(w.half, half.columns() * (lit.rows() + 4 * kReach) * w.lanes, 0.0F);
        w.half_clear = half;
    }
}

float* TemplateFitter::reference_hord(int i, int j) { return work_->reference_hord_at(i, j); }
int TemplateFitter::reference_pitch() const { return work_->reference_pitch; }

float TemplateFitter::mass(int lane, int i, int j) const { return work_->mass[j * extents_.i + i][lane]; }
float TemplateFitter::reference_hord(int lane, int i, int j) const {
    return work_->lit.has(i, j) ? work_->reference_hord_at(i, j)[lane - work_->first] : 0.0F;
}

float TemplateFitter::scattering_of(int lane, int i, int j) const {
    const BinRect& window = work_->window;
    return work_
        ->scattering[((j - window.top) * window.columns() + i - window.left) * work_->lanes + lane - work_->first];
}

// Corrects the shift as if the largest reading of the dark bins that scattering reaches were the second largest.
void TemplateFitter::limit_largest_dark(Fits& fits, int lane) const {
    const BinRect& window = work_->window;
    float largest = 0, second = 0;
    int at_i = -1, at_j = -1;
    for (int j = window.top; j <= window.bottom; ++j) {
        for (int i = window.left; i <= window.right; ++i) {
            const float reading = mass(lane, i, j);
            if (reading <= second || scattering_of(lane, i, j) == 0 ||
                fits.light[lane] * reference_hord(lane, i, j) >= fits.noise.soft)
                continue;
            if (reading > largest) second = largest, largest = reading, at_i = i, at_j = j;
            else second = reading;
        }
    }
    if (!(largest > second)) return;
    const BinNoise& noise = fits.noise;
    const float e = fits.light[lane] * reference_hord(lane, at_i, at_j),
                w = (e + noise.soft) /
        ((noise.a_dn * e + (noise.a_dn * noise.soft + noise.quiet + noise.lit)) * e + noise.empty * noise.soft),
                less = w * (second - largest);
    const float x = reference_hord(lane, at_i - 1, at_j) - reference_hord(lane, at_i + 1, at_j),
                y = reference_hord(lane, at_i, at_j - 1) - reference_hord(lane, at_i, at_j + 1);
    const float b = scattering_of(lane, at_i, at_j);
    fits.x[lane] += less * (fits.xx[lane] * x + fits.xy[lane] * y + fits.xb[lane] * b);
    fits.y[lane] += less * (fits.xy[lane] * x + fits.yy[lane] * y + fits.yb[lane] * b);
}

void TemplateFitter::fit(Fits& fits, std::uint32_t wanted) {
    scatter_(*work_);
    fit_(*work_, extents_, fits);
    for (int l = work_->first; l < work_->first + at_once_; ++l) {
        if ((wanted >> l & 1U) == 0 || fits.found[l] == 0) continue;
        const float shift2 = fits.x[l] * fits.x[l] / fits.x_variance[l] + fits.y[l] * fits.y[l] / fits.y_variance[l];
        if (shift2 > static_cast<float>(kSignificant * kSignificant)) limit_largest_dark(fits, l);
    }
}

}  // namespace hord::algo
