// What explains how a lenslet's bins differ from its reference HORD: light that is shifted, light that is scattered,
// and a rest.
//
// With the reference shares g and the light n that the lenslet has, n g is expected in the bins. r = mass - n g is
// explained by weighted least squares as
//
//     r = n (a G_x + b G_y + c G_s) + rest       weights 1 / variance of the bin
//
// G_x, G_y: what a shift of the light by one bin changes (central differences of g). G_s: what scattering all of it
// changes (by the binomial 1 4 6 4 1 along each axis, whose variance is one bin squared).
// algo/reference/reference_comparison.h says what the numbers mean, and where the variances come from.
//
// One reading is no deflection_shift. Dark bins count with little noise, for most of them read nothing: one that does,
// beside a spot, looks like a deflection_shift of five standard deviations. So where a fit says more than kNotable, the
// largest reading of a dark bin counts as much as the second largest, and the deflection_shift is fitted again: light
// that is bent is missing where it was.
//
// Where the work is. Sixteen lenslets at a time, bin by bin, as many side by side as an instruction takes. Only around
// the reference HORDs' light is there anything to fit: the bins that are lit in any of the sixteen, those beside them,
// which a shift changes, and those that scattering reaches. All others, and those where nothing is expected, count in
// chi-square alone.
//
// Formats. Floats, a lenslet's bins summed in a fixed order in its lane, the three unknowns solved in double: the same
// bits on every instruction set.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <memory>

#include "algo/frame/extents.h"
#include "algo/reference/reference_row_sampler.h"
#include "algo/simd/isa.h"

namespace hord::algo {

struct BinNoise {
    float a_dn = 0;   // variance a DN of light
    float lit = 0;    // more of it in a lit bin
    float soft = 0;   // DN, about where a bin is lit
    float empty = 0;  // variance that a dark bin counts with in the fit
    float quiet = 0;  // that it has
};

// Where a lenslet's samples are.
template <class Sample>
struct LensletSamples {
    const Sample* first = nullptr;
    std::ptrdiff_t line_stride = 0;  // samples
};

class TemplateFitter {
  public:
    static constexpr int kLanes = kGoldenLanes;
    static constexpr double kNotable = 3;  // standard deviations by noise alone

    // Takes all memory.
    TemplateFitter(const Extents& extents, Isa isa);
    TemplateFitter(TemplateFitter&&) noexcept;
    ~TemplateFitter();

    // The masses of sixteen lenslets: their samples less `dark`, never below 0. From the start of each line
    // `readable()` samples are read.
    void take(const LensletSamples<std::uint8_t> (&samples)[kLanes], std::uint32_t dark);
    void take(const LensletSamples<std::uint16_t> (&samples)[kLanes], std::uint32_t dark);
    [[nodiscard]] int readable() const { return (extents_.i + 7) / 8 * 8; }

    // Lanes that are fitted at once.
    [[nodiscard]] int at_once() const { return at_once_; }

    // Begins at_once() lenslets, from lane `first` on, whose reference HORDs have light in these bins alone. Their
    // reference bins are to be written to reference(i, j), lane by lane; those of the next bin are at_once() further,
    // of the next row of bins reference_pitch() bins.
    void start(int first, const BinRect& lit);
    float* reference_hord(int i, int j);
    [[nodiscard]] int reference_pitch() const;

    // One value a lane.
    struct Fits {
        // In: n, DN; the bins' noise, but what a dark bin counts with, which each lane has.
        alignas(64) float light[kLanes], empty[kLanes];
        BinNoise noise;
        // Out, in the header's units. `found`: the bins can be told apart by the three; else nothing else means
        // anything.
        alignas(64) std::int32_t found[kLanes];
        alignas(64) float x[kLanes], y[kLanes], scattering[kLanes];  // a, b, c
        alignas(64) float x_variance[kLanes], y_variance[kLanes], blur_variance[kLanes];
        alignas(64) float chi2[kLanes],
            degrees[kLanes];  // of the rest, with the whole reading noise in dark bins; what noise alone would give
        // A shift's right-hand side by one DN, of a template's weighed value: for one reading that is changed.
        alignas(64) float xx[kLanes], xy[kLanes], xb[kLanes], yy[kLanes], yb[kLanes];
    };
    // Fits the lanes begun. `wanted`, bit l: lane l; others mean nothing.
    void fit(Fits& fits, std::uint32_t wanted);

    // A lane's bin among those begun last.
    [[nodiscard]] float mass(int lane, int i, int j) const;
    [[nodiscard]] float reference_hord(int lane, int i, int j) const;

    struct Work;  // algo/reference/template_fit.cpp

  private:
    void limit_largest_dark(Fits& fits, int lane) const;
    [[nodiscard]] float scattering_of(int lane, int i, int j) const;

    Extents extents_;
    int at_once_;
    std::unique_ptr<Work> work_;
    void (*take8_)(const LensletSamples<std::uint8_t> (&samples)[kLanes], const Extents& extents, std::uint32_t dark,
                   Work& work);
    void (*take16_)(const LensletSamples<std::uint16_t> (&samples)[kLanes], const Extents& extents, std::uint32_t dark,
                    Work& work);
    void (*scatter_)(Work& work);
    void (*fit_)(Work& work, const Extents& extents, Fits& fits);
};

}  // namespace hord::algo
