#include "algo/soa/soa_distances.h"

#include <algorithm>
#include <cmath>
#include <cstring>

#include "algo/features/jacobian.h"
#include "algo/features/stencil.h"
#include "algo/simd/multiversion.h"

namespace hord::algo {
namespace {

constexpr int kLanes = SoaRow::kLanes;
// Avoids 0 / 0; too far below any share of light (2^-24) to change one.
constexpr float kNothing = 1e-30F;

using Lit = SoaRow::Lit;

template <Feature kFeature>
HORD_ALWAYS_INLINE float term(float a, float b) {
    const float difference = a - b;
    if constexpr (kFeature == Feature::chi2) return difference * difference / (a + b + kNothing);
    if constexpr (kFeature == Feature::hellinger) return difference * difference;
    return std::abs(difference);
}

// The squared distance from the sums of terms.
template <Feature kFeature>
HORD_ALWAYS_INLINE float squared_distance(float x, float y) {
    if constexpr (kFeature == Feature::chi2) return x * x * 0.25F;
    if constexpr (kFeature == Feature::hellinger) return x * 0.5F;
    return x * x + y * y;
}

template <int Bytes, Feature kFeature>
HORD_ALWAYS_INLINE void add_up(const float* a, const float* b, std::size_t stride, const Lit& lit, int along_x,
                               float* __restrict squared) {
    float x[kLanes] = {}, y[kLanes] = {};
    if constexpr (kFeature == Feature::marginal) {
        for (int k = 0; k < along_x; ++k, a += stride, b += stride) {
            for (int l = 0; l < kLanes; ++l) x[l] += term<kFeature>(a[l], b[l]);
        }
        const int arrays = __builtin_popcountll(lit[0]);
        for (int k = along_x; k < arrays; ++k, a += stride, b += stride) {
            for (int l = 0; l < kLanes; ++l) y[l] += term<kFeature>(a[l], b[l]);
        }
    } else {
        for (std::size_t w = 0; w < lit.size(); ++w) {
            for (std::uint64_t rest = lit[w]; rest != 0; rest &= rest - 1) {
                const std::size_t at = (w * 64 + static_cast<std::size_t>(__builtin_ctzll(rest))) * stride;
                for (int l = 0; l < kLanes; ++l)
                    x[l] += term<kFeature>(a[at + static_cast<std::size_t>(l)], b[at + static_cast<std::size_t>(l)]);
            }
        }
    }
    for (int l = 0; l < kLanes; ++l) squared[l] = squared_distance<kFeature>(x[l], y[l]);
}

HORD_FOR_EACH_ISA(add_chi2, add_up, Feature::chi2)
HORD_FOR_EACH_ISA(add_hellinger, add_up, Feature::hellinger)
HORD_FOR_EACH_ISA(add_marginal, add_up, Feature::marginal)

template <int Bytes>
HORD_ALWAYS_INLINE void divide(const std::int32_t* moment, const std::uint32_t* sum, int count,
                               std::int32_t* __restrict mean) {
    for (int m = 0; m < count; ++m) mean[m] = quotient_q24(moment[m], sum[m] == 0 ? 1 : sum[m]);
}

template <int Bytes>
HORD_ALWAYS_INLINE void slopes(const SoaDistances::MeanRows& r, bool centroid, int count, float* __restrict values) {
    const auto [x_left, x_right, x_above, x_below, y_left, y_right, y_above, y_below] = r;
    if (centroid) {
        for (int m = 0; m < count; ++m) {
            const double a = x_right[m] - x_left[m], b = x_below[m] - x_above[m], c = y_right[m] - y_left[m],
                         d = y_below[m] - y_above[m];
            values[m] = static_cast<float>(std::sqrt((a * a + c * c) + (b * b + d * d)) * 0x1p-24);
        }
        return;
    }
    for (int m = 0; m < count; ++m) {
        const std::int32_t raw = frobenius_raw(x_right[m] - x_left[m], x_below[m] - x_above[m], y_right[m] - y_left[m],
                                               y_below[m] - y_above[m]);
        values[m] = static_cast<float>(raw * 0x1p-25);
    }
}
HORD_FOR_EACH_ISA(divide_for, divide)
HORD_FOR_EACH_ISA(slopes_for, slopes)

SoaUse use_of(Feature feature) {
    switch (feature) {
        case Feature::emd:
        case Feature::chi2: return SoaUse::shares;
        case Feature::hellinger: return SoaUse::roots;
        case Feature::marginal: return SoaUse::marginals;
        default: return SoaUse::sums;
    }
}

// Every lenslet of the block has a HORD.
bool all_have_hords(const SoaRow& row, int block) {
    std::uint64_t masks[kLanes / 8];
    std::memcpy(masks, row.mask().data() + block * kLanes, sizeof masks);
    return (masks[0] | masks[1]) == 0;
}

double squared(double v) { return v * v; }

}  // namespace

bool SoaDistances::covers(Feature feature) {
    return feature == Feature::centroid || feature == Feature::marginal || feature == Feature::hellinger ||
        feature == Feature::chi2 || (feature >= Feature::jacobian_frobenius && feature <= Feature::anisotropy);
}

SoaDistances::SoaDistances(const Extents& extents, Feature feature, Isa isa, bool keeps_deflections)
    : extents_(extents), feature_(feature), along_x_(extents.i - 1), divide_(divide_for(isa)),
      slopes_(slopes_for(isa)) {
    const bool of_sums = use_of(feature) == SoaUse::sums, moments = of_sums || keeps_deflections;
    for (int place = 0; place < 3; ++place) rows_.emplace_back(extents, use_of(feature), isa, moments);
    if (moments) {
        for (Means& means : means_) {
            means.x.resize(rows_[0].sums().size());
            means.y.resize(rows_[0].sums().size());
        }
    }
    if (!of_sums) {
        stride_ = rows_[0].stride();
    }
    add_up_ = feature == Feature::chi2  ? add_chi2(isa)
        : feature == Feature::hellinger ? add_hellinger(isa)
                                        : add_marginal(isa);
}

void SoaDistances::load(const FrameView& frame, const LightLevels& levels, int n, int from) {
    SoaRow& r = row(n);
    r.decode(frame, levels, from);
    Means& means = means_[static_cast<std::size_t>(n % 3)];
    const auto count = static_cast<int>(means.x.size());
    divide_(r.moments_x().data(), r.sums().data(), count, means.x.data());
    divide_(r.moments_y().data(), r.sums().data(), count, means.y.data());
}

// Of two single lenslets: those in the first lane.
float SoaDistances::squared_alone(const SoaRow& a, int m_a, const SoaRow& b, int m_b) const {
    Lit lit = a.lit(m_a / kLanes);
    unite(lit, b.lit(m_b / kLanes));
    float squares[kLanes];
    add_up_(a.array(0) + m_a, b.array(0) + m_b, stride_, lit, along_x_, squares);
    return squares[0];
}

Jacobian SoaDistances::jacobian(int m, int n) const {
    const SoaRow& here = loaded(n);
    const Stencil across = stencil(here.has_hord(m - 1), here.has_hord(m + 1)),
                  down = stencil(loaded(n + 2).has_hord(m), loaded(n + 1).has_hord(m));
    return jacobian_of(across, deflection(m + across.before, n), deflection(m + across.after, n), down,
                       deflection(m, n + down.before), deflection(m, n + down.after));
}

float SoaDistances::by_deflections(Feature which, int m, int n) const {
    switch (which) {
        case Feature::centroid: break;
        case Feature::jacobian_spectral: return singular_norms(jacobian(m, n)).spectral.to_float_rounded();
        case Feature::jacobian_nuclear: return singular_norms(jacobian(m, n)).nuclear.to_float_rounded();
        case Feature::anisotropy: return singular_norms(jacobian(m, n)).anisotropy.to_float_rounded();
        default: return frobenius_norm(jacobian(m, n)).to_float_rounded();
    }
    const SoaRow& here = loaded(n);
    const Stencil across = stencil(here.has_hord(m - 1), here.has_hord(m + 1)),
                  down = stencil(loaded(n + 2).has_hord(m), loaded(n + 1).has_hord(m));
    const Deflection left = deflection(m + across.before, n), right = deflection(m + across.after, n),
                     up = deflection(m, n + down.before), low = deflection(m, n + down.after);
    const double x = squared(right.x.raw() - left.x.raw()) + squared(right.y.raw() - left.y.raw());
    const double y = squared(low.x.raw() - up.x.raw()) + squared(low.y.raw() - up.y.raw());
    return static_cast<float>(std::sqrt(squared(across.weight()) * x + squared(down.weight()) * y) * 0x1p-24);
}

// Every lenslet of the block, and every neighbour of one, has a HORD.
bool SoaDistances::all_neighbours_have_hords(int n, int block) const {
    const auto of = [&](int r) -> const SoaRow& { return rows_[static_cast<std::size_t>(r % 3)]; };
    const SoaRow& here = of(n);
    return all_have_hords(here, block) && all_have_hords(of(n + 1), block) && all_have_hords(of(n + 2), block) &&
        (block == 0 || all_have_hords(here, block - 1)) &&
        (block + 1 == here.blocks() || all_have_hords(here, block + 1));
}

// One block: first as if every neighbour had a HORD, then lenslets beside a hole again.
void SoaDistances::compare_block(int n, int block, float* values, const std::uint8_t* mask) {
    const SoaRow &above = row(n - 1), &here = row(n), &below = row(n + 1);
    const int first = block * kLanes, count = std::min(kLanes, extents_.m - first);
    Lit lit = here.lit(block);
    if (block > 0) unite(lit, here.lit(block - 1));
    if (block + 1 < here.blocks()) unite(lit, here.lit(block + 1));
    float across[kLanes], down[kLanes];
    add_up_(here.array(0) + first - 1, here.array(0) + first + 1, stride_, lit, along_x_, across);
    lit = above.lit(block);
    unite(lit, below.lit(block));
    add_up_(above.array(0) + first, below.array(0) + first, stride_, lit, along_x_, down);
    for (int l = 0; l < count; ++l) values[first + l] = std::sqrt(across[l] + down[l]);
    if (all_neighbours_have_hords(n, block)) return;
    for (int l = 0; l < count; ++l) {
        const int m = first + l;
        if ((mask[m] & kNoGradient) != 0) {
            values[m] = 0;
            continue;
        }
        const Stencil s = stencil(here.has_hord(m - 1), here.has_hord(m + 1)),
                      t = stencil(above.has_hord(m), below.has_hord(m));
        if (s.weight() == 1 && t.weight() == 1) continue;
        const float x = s.weight() == 1 ? across[l] : 4 * squared_alone(here, m + s.before, here, m + s.after);
        const float y = t.weight() == 1 ? down[l] : 4 * squared_alone(row(n + t.before), m, row(n + t.after), m);
        values[m] = std::sqrt(x + y);
    }
}

void SoaDistances::mark_row(int n, std::uint8_t* mask) const {
    const SoaRow &above = loaded(n + 2), &here = loaded(n), &below = loaded(n + 1);
    const bool edge = n == 0 || n == extents_.n - 1;
    std::copy_n(here.mask().begin(), extents_.m, mask);
    for (int block = 0; block < here.blocks() && !edge; ++block) {
        if (all_have_hords(here, block) && all_have_hords(above, block))
            continue;  // each has a neighbour in either direction
        for (int m = std::max(block * kLanes, 1); m < std::min((block + 1) * kLanes, extents_.m - 1); ++m) {
            if (mask[m] != kValid) continue;
            const bool alone =
                (!here.has_hord(m - 1) && !here.has_hord(m + 1)) || (!above.has_hord(m) && !below.has_hord(m));
            if (alone) mask[m] |= kBorder;
        }
    }
    for (int m = 0; m < extents_.m; m += edge ? 1 : extents_.m - 1) mask[m] |= kBorder;
}

void SoaDistances::compare_row(int n, float* values, const std::uint8_t* mask) {
    if (stride_ == 0) {
        slopes_row(feature_, n, values, mask);
    } else if (n == 0 || n == extents_.n - 1) {
        std::fill_n(values, extents_.m, 0.0F);
    } else {
        for (int block = 0; block < row(n).blocks(); ++block) compare_block(n, block, values, mask);
        values[0] = values[extents_.m - 1] = 0;
    }
}

void SoaDistances::slopes_row(int n, float* frobenius, const std::uint8_t* mask) {
    slopes_row(Feature::jacobian_frobenius, n, frobenius, mask);
}

// The quick features first as if every neighbour had a HORD; then lenslets beside a hole one by one.
void SoaDistances::slopes_row(Feature which, int n, float* values, const std::uint8_t* mask) {
    if (n == 0 || n == extents_.n - 1) {
        std::fill_n(values, extents_.m, 0.0F);
        return;
    }
    const bool quick = which == Feature::centroid || which == Feature::jacobian_frobenius;
    const SoaRow &above = row(n + 2), &here = row(n), &below = row(n + 1);
    if (quick) {
        const Means &up = means_[static_cast<std::size_t>((n + 2) % 3)], &at = means_[static_cast<std::size_t>(n % 3)],
                    &low = means_[static_cast<std::size_t>((n + 1) % 3)];
        slopes_({at.x.data(), at.x.data() + 2, up.x.data() + 1, low.x.data() + 1, at.y.data(), at.y.data() + 2,
                 up.y.data() + 1, low.y.data() + 1},
                which == Feature::centroid, extents_.m - 2, values + 1);
    }
    for (int m = 0; m < extents_.m; ++m) {
        if (quick && m % kLanes == 0 && all_neighbours_have_hords(n, m / kLanes)) {
            m += kLanes - 1;
        } else if ((mask[m] & kNoGradient) != 0) {
            values[m] = 0;
        } else if (!quick || !here.has_hord(m - 1) || !here.has_hord(m + 1) || !above.has_hord(m) ||
                   !below.has_hord(m)) {
            values[m] = by_deflections(which, m, n);
        }
    }
    values[0] = values[extents_.m - 1] = 0;
}

void SoaDistances::over_neighbours(const FrameView& frame, const LightLevels& levels, int first, int last,
                                   float* values, std::uint8_t* mask, bool goes_on) {
    const auto compare = [&](int n) {
        const std::ptrdiff_t at = std::ptrdiff_t{n} * extents_.m;
        mark_row(n, mask + at);
        compare_row(n, values + at, mask + at);
    };
    for (int n = goes_on ? first + 1 : std::max(first - 1, 0); n < std::min(last + 1, extents_.n); ++n) {
        load(frame, levels, n);
        if (n > first) compare(n - 1);
    }
    if (last == extents_.n) compare(last - 1);
}

void SoaDistances::against(const FrameView& frame, const FrameView& reference, const LightLevels& levels, int first,
                           int last, float* values, std::uint8_t* mask) {
    for (int n = first; n < last; ++n) {
        rows_[0].decode(frame, levels, n);
        rows_[1].decode(reference, levels, n);
        compare_with_reference(values + std::ptrdiff_t{n} * extents_.m, mask + std::ptrdiff_t{n} * extents_.m);
    }
}

// The frame's row is in place 0, the reference's in place 1.
void SoaDistances::compare_with_reference(float* values, std::uint8_t* mask) {
    const SoaRow &here = rows_[0], &reference = rows_[1];
    for (int m = 0; m < extents_.m; ++m) {
        mask[m] = static_cast<std::uint8_t>(here.mask()[static_cast<std::size_t>(m)] |
                                            (reference.has_hord(m) ? kValid : kBorder));
    }
    if (feature_ == Feature::centroid) {
        const auto mean = [](const SoaRow& r, int m) {
            const auto k = static_cast<std::size_t>(m);
            return mean_deflection(r.sums()[k], r.moments_x()[k], r.moments_y()[k]);
        };
        for (int m = 0; m < extents_.m; ++m) {
            values[m] = 0;
            if ((mask[m] & kNoGradient) != 0) continue;
            const Deflection a = mean(here, m), b = mean(reference, m);
            values[m] = static_cast<float>(std::sqrt(squared(a.x.raw() - b.x.raw()) + squared(a.y.raw() - b.y.raw())) *
                                           0x1p-24);
        }
        return;
    }
    for (int block = 0; block < here.blocks(); ++block) {
        const int from = block * kLanes;
        Lit lit = here.lit(block);
        unite(lit, reference.lit(block));
        float squares[kLanes];
        add_up_(here.array(0) + from, reference.array(0) + from, stride_, lit, along_x_, squares);
        for (int l = 0; l < std::min(kLanes, extents_.m - from); ++l) {
            values[from + l] = (mask[from + l] & kNoGradient) == 0 ? std::sqrt(squares[l]) : 0.0F;
        }
    }
}

}  // namespace hord::algo
