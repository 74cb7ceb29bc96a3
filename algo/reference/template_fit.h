// Weighted least-squares fit of a lenslet's difference from its reference HORD by three templates: shift along x, shift
// along y, scattering. The rest is chi-square. Sixteen lenslets at a time.
//
//     mass - n g = n (a G_x + b G_y + c G_s) + rest       weights 1 / variance of the bin
//
// n: light of the lenslet; g: reference shares; G_x, G_y: changes by a shift of one bin; G_s: change if all light is
// scattered. Templates, variances, and why single readings of dark bins are limited: docs/notes/reference.md.
//
// Formats. Floats, a lenslet's bins summed in a fixed order in its lane, the three unknowns solved in double: the same
// bits on every instruction set.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>

#include "algo/frame/extents.h"
#include "algo/reference/reference_row_sampler.h"
#include "algo/simd/isa.h"
#include "common/opaque.h"

namespace hord::algo {

struct BinNoise {
    float a_dn = 0;   // variance a DN of light
    float lit = 0;    // additional variance of a lit bin
    float soft = 0;   // DN, width of the transition from dark to lit
    float empty = 0;  // variance of a dark bin in the fit
    float quiet = 0;  // true variance of a dark bin
};

// A lenslet's samples in memory.
template <class Sample>
struct LensletSamples {
    const Sample* first = nullptr;
    std::ptrdiff_t line_stride = 0;  // samples
};

class TemplateFitter {
  public:
    static constexpr int kLanes = kReferenceLanes;
    static constexpr double kSignificant = 3;  // standard deviations by noise alone

    // Allocates all memory.
    TemplateFitter(const Extents& extents, Isa isa);

    // Loads the masses of sixteen lenslets: samples less `dark`, not below 0. Reads `readable()` samples from the start
    // of each line.
    void load_masses(const LensletSamples<std::uint8_t> (&samples)[kLanes], std::uint32_t dark);
    void load_masses(const LensletSamples<std::uint16_t> (&samples)[kLanes], std::uint32_t dark);
    [[nodiscard]] int readable() const { return (extents_.i + 7) / 8 * 8; }

    // Lanes that are fitted together.
    [[nodiscard]] int at_once() const { return at_once_; }

    // Begins at_once() lenslets, from lane `first` on, whose reference HORDs have light in `lit` only. The caller then
    // writes their reference bins to reference_hord(i, j): at_once() lanes of a bin, then the next bin; rows of bins
    // are reference_pitch() bins apart.
    void start(int first, const BinRect& lit);
    float* reference_hord(int i, int j);
    [[nodiscard]] int reference_pitch() const;

    // One value a lane.
    struct Fits {
        // In: n, DN, of each lane; the noise of all lanes.
        alignas(64) float light[kLanes];
        BinNoise noise;
        // Out. found: 1 if the templates are linearly independent; else the other results are not valid.
        alignas(64) std::int32_t found[kLanes];
        alignas(64) float x[kLanes], y[kLanes], scattering[kLanes];  // a, b, c
        alignas(64) float x_variance[kLanes], y_variance[kLanes], scattering_variance[kLanes];
        alignas(64) float chi2[kLanes], degrees[kLanes];  // of the rest; its expectation by noise alone
        // Inverse matrix: the change of (x, y) by the weighted template values of one reading that changes by a DN.
        alignas(64) float xx[kLanes], xy[kLanes], xb[kLanes], yy[kLanes], yb[kLanes];
    };
    // Fits the lanes begun; only those of `wanted` (bit l: lane l) are valid.
    void fit(Fits& fits, std::uint32_t wanted);

    // A bin of a lane that was begun last.
    [[nodiscard]] float mass(int lane, int i, int j) const;
    [[nodiscard]] float reference_hord(int lane, int i, int j) const;

    struct Work;  // algo/reference/template_fit.cpp

  private:
    void limit_largest_dark(Fits& fits, int lane) const;
    [[nodiscard]] float scattering_of(int lane, int i, int j) const;

    Extents extents_;
    int at_once_;
    common::Opaque<Work> work_;
    void (*load8_)(const LensletSamples<std::uint8_t> (&samples)[kLanes], const Extents& extents, std::uint32_t dark,
                   Work& work);
    void (*load16_)(const LensletSamples<std::uint16_t> (&samples)[kLanes], const Extents& extents, std::uint32_t dark,
                    Work& work);
    void (*scatter_)(Work& work);
    void (*fit_)(Work& work, const Extents& extents, Fits& fits);
};

}  // namespace hord::algo
