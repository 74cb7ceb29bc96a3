#include "algo/reference/reference_comparison.h"

#include <algorithm>
#include <cmath>

#include "algo/frame/mask.h"
#include "algo/reference/clipped_noise.h"

namespace hord::algo {

namespace {

constexpr int kCopiedLine = 16, kCopied = kCopiedLine * kMaxBins;  // samples: of a copied lenslet's line; of all
static_assert(kCopiedLine >= (kMaxBins + 7) / 8 * 8);

}  // namespace

ReferenceComparer::ReferenceComparer(const Reference& reference, Isa isa, std::shared_ptr<const ReferenceSoa> soa)
    : reference_(reference), soa_(soa ? std::move(soa) : std::make_shared<const ReferenceSoa>(reference)),
      row_sampler_(reference, *soa_, isa), sampler_(reference, isa), fitter_(reference.extents, isa),
      sampled_bins_(kLanes * reference.stride()), copied_(static_cast<std::size_t>(kLanes * kCopied)) {
    const double clip = static_cast<double>(reference.sensor.clip_dn),
                 gain = static_cast<double>(reference.sensor.electrons_per_dn),
                 read = static_cast<double>(reference.sensor.read_dn);
    double clipped = 0, light = 0;
    for (std::size_t k = 0; k < reference.extents.lenslets(); ++k) {
        if (reference.mask[k] != kValid) continue;
        const std::uint16_t* share = reference.shares.data() + k * reference.stride();
        double cut = 0;
        for (std::size_t b = 0; b < reference.stride(); ++b)
            cut += std::min(clip, static_cast<double>(share[b]) * 0x1p-15 * static_cast<double>(reference.light[k]));
        clipped += cut, light += static_cast<double>(reference.light[k]);
    }
    clipped_ = light > 0 ? clipped / light : 0;
    floor_ = read * read + 1.0 / 12;
    const double quiet = clipped_noise(floor_, clip).variance;
    fits_.noise = {0, static_cast<float>(clip / gain + floor_ - quiet), static_cast<float>(std::sqrt(floor_)),
                   static_cast<float>(floor_ / 2), static_cast<float>(quiet)};
}

void ReferenceComparer::start_row(const PoseMap& pose, int n, double light) {
    pose_ = &pose;
    light_ = (light + clipped_) / (1 + clipped_);
    row_sampler_.start_row(pose, n, light_);
    group_.live = 0;
    variance_factor_ = 1 + light_ / reference_.parts;  // the reference's own noise scales with the light
    fits_.noise.a_dn = static_cast<float>(variance_factor_ / static_cast<double>(reference_.sensor.electrons_per_dn));
}

std::uint32_t ReferenceComparer::nearest(const PoseMap::Place& at) const {
    const Extents& e = reference_.extents;
    return static_cast<std::uint32_t>(std::clamp(floor_of(at.n + 0.5), 0, e.n - 1) * e.m +
                                      std::clamp(floor_of(at.m + 0.5), 0, e.m - 1));
}

// Adds a lenslet to the group and returns its lane; -1 if the group must be compared first.
int ReferenceComparer::add_to_group(int m, int n, std::uint32_t sum, bool has_hord, Difference& out) {
    const auto at = pose_->to_reference(m, n);
    const int column = floor_of(at.m), block = (column - 1) >> 4, lane = (column - 1) & (kLanes - 1);
    static_assert(kLanes == 16);
    Group& g = group_;
    // Lenslets of a turned part lie less than one apart in the reference: sometimes two share a column.
    if (g.live != 0 && (block != g.block || lane <= g.last)) return -1;
    if (g.live == 0) g.with_hord = 0;
    g.block = block;
    g.last = lane;
    g.live |= 1U << lane;
    if (has_hord) g.with_hord |= 1U << lane;
    g.at[lane] = at;
    g.sum[lane] = sum;
    g.out[lane] = &out;
    const QuantisedCubic& along = cubic_at(at.m - column);
    for (int c = 0; c < ReferenceSoa::kCubicRows; ++c)
        reference_hords_.weights[c][lane] = static_cast<float>(along.of[c]);
    return lane;
}

// A copy with room behind each line, for lenslets at the ends of the frame's lines.
template <class Sample>
LensletSamples<Sample> ReferenceComparer::copy_of(const LensletSamples<Sample>& samples, int lane) {
    auto* const copied = reinterpret_cast<Sample*>(copied_.data() + std::ptrdiff_t{lane} * kCopied);
    for (int j = 0; j < reference_.extents.j; ++j)
        std::copy_n(samples.first + j * samples.line_stride, reference_.extents.i,
                    copied + std::ptrdiff_t{j} * kCopiedLine);
    return {copied, kCopiedLine};
}

void ReferenceComparer::compare_row(const FrameView& frame, std::span<const std::uint32_t> sums,
                                    std::span<const std::uint8_t> mask, int n, const PoseMap& pose, double light,
                                    std::uint32_t dark, std::span<Difference> out) {
    start_row(pose, n, light);
    const Extents& e = reference_.extents;
    const auto compare_samples = [&]<class Sample>(LensletSamples<Sample>(&waiting)[kLanes]) {
        const std::ptrdiff_t stride = frame.stride_bytes / static_cast<std::ptrdiff_t>(sizeof(Sample));
        const auto* first = reinterpret_cast<const Sample*>(frame.data) + std::ptrdiff_t{n} * e.j * stride;
        for (int m = 0; m < e.m; ++m) {
            const auto k = static_cast<std::size_t>(m);
            if ((mask[k] & kOutside) != 0) continue;
            out[k] = {};
            if ((mask[k] & kSaturated) != 0) continue;
            int lane = add_to_group(m, n, sums[k], (mask[k] & kNoHord) == 0, out[k]);
            if (lane < 0) {
                compare(waiting, dark);
                lane = add_to_group(m, n, sums[k], (mask[k] & kNoHord) == 0, out[k]);
            }
            const LensletSamples<Sample> samples{first + std::ptrdiff_t{m} * e.i, stride};
            waiting[lane] = m * e.i + fitter_.readable() <= frame.width_px ? samples : copy_of(samples, lane);
        }
        compare(waiting, dark);
    };
    if (frame.sample_bytes() == 2) compare_samples(group_.wide);
    else compare_samples(group_.narrow);
}

// Compares the group and empties it.
template <class Sample>
void ReferenceComparer::compare(LensletSamples<Sample> (&samples)[kLanes], std::uint32_t dark) {
    Group& g = group_;
    if (g.live == 0) return;
    row_sampler_.move_to(g.block);
    const std::uint32_t complete = row_sampler_.complete() & g.live;
    BinRect lit;
    if (complete != 0) lit = row_sampler_.lit();
    ReferenceSampler::ReferenceHord alone[kLanes];
    for (std::uint32_t left = g.live & ~complete; left != 0; left &= left - 1) {
        const int l = __builtin_ctz(left);
        ReferenceSampler::ReferenceHord& reference_hord = alone[l];
        reference_hord = sampler_.read(g.at[l].m, g.at[l].n, light_,
                                       sampled_bins_.data() + static_cast<std::size_t>(l) * reference_.stride());
        if (reference_hord.has_hord) lit.cover(reference_hord.lit.bins);
    }
    const int at_once = fitter_.at_once();
    if (!lit.none()) {
        const LensletSamples<Sample> any = samples[__builtin_ctz(g.live)];
        for (std::uint32_t dead = ~g.live & 0xFFFFU; dead != 0; dead &= dead - 1) samples[__builtin_ctz(dead)] = any;
        fitter_.load_masses(samples, dark);
    }
    for (int first = 0; first < kLanes; first += at_once) {
        const std::uint32_t lanes = g.live & ((1U << at_once) - 1U) << first;
        if (lanes == 0) continue;
        if (!lit.none()) {
            fitter_.start(first, lit);
            row_sampler_.interpolate(first, lit, reference_hords_, fitter_.reference_hord(lit.left, lit.top),
                                     fitter_.reference_pitch());
        }
        std::uint32_t fitted = 0;
        for (std::uint32_t left = lanes; left != 0; left &= left - 1) {
            const int l = __builtin_ctz(left);
            bool has_hord = true;
            if ((complete >> l & 1U) != 0) {
                has_hord = compare_light(l, static_cast<double>(reference_hords_.light[l]),
                                         static_cast<double>(reference_hords_.share[l]));
            } else {
                const ReferenceSampler::ReferenceHord& reference_hord = alone[l];
                has_hord = reference_hord.has_light && compare_light(l, reference_hord.light, reference_hord.share) &&
                    reference_hord.has_hord;
                if (!has_hord) continue;
                const float* bins = sampled_bins_.data() + static_cast<std::size_t>(l) * reference_.stride();
                for (int j = lit.top; j <= lit.bottom; ++j) {
                    for (int i = lit.left; i <= lit.right; ++i) {
                        const auto place = static_cast<int>(reference_.place(i, j));
                        fitter_.reference_hord(i, j)[l - first] =
                            place >= reference_hord.written.first && place < reference_hord.written.end() ? bins[place]
                                                                                                          : 0.0F;
                    }
                }
            }
            if (!has_hord || (g.with_hord >> l & 1U) == 0) continue;
            fitted |= 1U << l;
        }
        if (fitted == 0) continue;
        for (int l = first; l < first + at_once; ++l) {
            if ((fitted >> l & 1U) == 0) fits_.light[l] = 1;
        }
        fitter_.fit(fits_, fitted);
        for (; fitted != 0; fitted &= fitted - 1) finish(__builtin_ctz(fitted));
    }
    g.live = 0;
}

// Compares the light of a lane; false if the reference expects none.
bool ReferenceComparer::compare_light(int lane, double light, double share) {
    Difference& out = *group_.out[lane];
    const std::uint32_t sum = group_.sum[lane];
    out.at = nearest(group_.at[lane]);
    out.sum = static_cast<float>(sum);
    const double expected = light * share;
    if (!(light > 0) || expected < static_cast<double>(reference_.levels.min_sum)) return false;
    out.has_light = true;
    const double per_expected = 1 / expected, a_dn = static_cast<double>(fits_.noise.a_dn);
    out.light = static_cast<float>(static_cast<double>(sum) * per_expected - 1);
    constexpr double kBinsLit = 9;  // typical number of lit bins; each adds its reading noise to the sum
    out.light_variance =
        static_cast<float>((a_dn * expected + kBinsLit * floor_ * variance_factor_) * per_expected * per_expected);
    fits_.light[lane] = static_cast<float>(static_cast<double>(sum) / share);
    return true;
}

void ReferenceComparer::finish(int l) {
    if (fits_.found[l] == 0) return;
    Difference& out = *group_.out[l];
    out.has_hord = true;
    out.x = fits_.x[l], out.y = fits_.y[l], out.scattering = fits_.scattering[l];
    out.x_variance = fits_.x_variance[l], out.y_variance = fits_.y_variance[l],
    out.scattering_variance = fits_.scattering_variance[l];
    out.chi2 = fits_.chi2[l];
    out.degrees = std::max(1.0F, fits_.degrees[l] - 3);
    if (std::sqrt(2 * out.chi2) > std::sqrt(2 * out.degrees) + kLargeRest) measure_large_shift(l, out);
    // The turn of the part turns its deflections, which is no deviation.
    const auto gx = static_cast<double>(reference_.x[out.at]), gy = static_cast<double>(reference_.y[out.at]);
    const auto turned = pose_->turned(gx, gy);
    out.x -= static_cast<float>(turned.m - gx);
    out.y -= static_cast<float>(turned.n - gy);
}

// Measures a shift that is too large for the fit: by the mean over all bins.
void ReferenceComparer::measure_large_shift(int lane, Difference& out) const {
    const double a_dn = variance_factor_ / static_cast<double>(reference_.sensor.electrons_per_dn),
                 quiet = static_cast<double>(fits_.noise.quiet);
    struct Moments {
        double light = 0, x = 0, y = 0, xx = 0, yy = 0;
        void add(double v, double at_x, double at_y) {
            light += v, x += v * at_x, y += v * at_y, xx += v * at_x * at_x, yy += v * at_y * at_y;
        }
    } measured, expected, places;
    for (int j = 0; j < reference_.extents.j; ++j) {
        for (int i = 0; i < reference_.extents.i; ++i) {
            const double x = i - 0.5 * (reference_.extents.i - 1), y = j - 0.5 * (reference_.extents.j - 1);
            measured.add(static_cast<double>(fitter_.mass(lane, i, j)), x, y), places.add(1, x, y);
            expected.add(static_cast<double>(fitter_.reference_hord(lane, i, j)), x, y);
        }
    }
    if (!(measured.light > 0) || !(expected.light > 0)) return;
    const double mean_x = expected.x / expected.light, mean_y = expected.y / expected.light;
    const double moved_x = measured.x / measured.light - mean_x, moved_y = measured.y / measured.light - mean_y;
    // Next to an edge the mean depends on where in the lenslet the edge lies.
    const int columns = reference_.extents.m, at_m = static_cast<int>(out.at) % columns,
              at_n = static_cast<int>(out.at) / columns;
    float least_x = 8, most_x = -8, least_y = 8, most_y = -8;
    reference_.extents.for_each_around(at_m, at_n, 1, [&](int x, int y) {
        const std::size_t k = reference_.extents.index(x, y);
        if (reference_.mask[k] != kValid) return;
        least_x = std::min(least_x, reference_.x[k]), most_x = std::max(most_x, reference_.x[k]);
        least_y = std::min(least_y, reference_.y[k]), most_y = std::max(most_y, reference_.y[k]);
    });
    const double far =
        kLargeShiftBins + static_cast<double>(std::max(0.0F, std::max(most_x - least_x, most_y - least_y)));
    if (moved_x * moved_x + moved_y * moved_y <= far * far) return;
    out.x = static_cast<float>(moved_x);
    out.y = static_cast<float>(moved_y);
    const auto variance = [&](double squares, double mean, double of_places) {
        return (squares / expected.light - mean * mean) * a_dn / measured.light +
            quiet * of_places / (measured.light * measured.light);
    };
    out.x_variance =
        static_cast<float>(std::max(variance(expected.xx, mean_x, places.xx), static_cast<double>(out.x_variance)));
    out.y_variance =
        static_cast<float>(std::max(variance(expected.yy, mean_y, places.yy), static_cast<double>(out.y_variance)));
}

Scores scores_of(const Difference& d, const Reference& reference) {
    Scores scores{};
    const auto spread = [&](Deviation which) { return reference.spread[static_cast<std::size_t>(which)][d.at]; };
    const auto set = [&](Deviation which, float z) { scores[static_cast<std::size_t>(which)] = z; };
    if (d.has_light) set(Deviation::light, d.light / std::sqrt(d.light_variance + spread(Deviation::light)));
    if (!d.has_hord) return scores;
    const float deflection_shift = spread(Deviation::deflection_shift);
    set(Deviation::deflection_shift,
        std::sqrt(d.x * d.x / (d.x_variance + deflection_shift) + d.y * d.y / (d.y_variance + deflection_shift)));
    set(Deviation::scattering, d.scattering / std::sqrt(d.scattering_variance + spread(Deviation::scattering)));
    // sqrt(2 chi2) is about normal; the excess of good parts widens it.
    const float excess = spread(Deviation::shape) * d.sum, expected = d.degrees + excess;
    const float width = std::sqrt((d.degrees + 2 * excess + excess * excess) / expected);
    set(Deviation::shape, (std::sqrt(2 * d.chi2) - std::sqrt(2 * expected)) / width);
    return scores;
}

Scores noise_shares(const Difference& d, const Reference& reference) {
    Scores shares{};
    const auto set = [&](Deviation which, float noise, float per_spread) {
        const auto w = static_cast<std::size_t>(which);
        shares[w] = noise / (noise + per_spread * reference.spread[w][d.at]);
    };
    set(Deviation::light, d.light_variance, 1);
    set(Deviation::deflection_shift, 0.5F * (d.x_variance + d.y_variance), 1);
    set(Deviation::scattering, d.scattering_variance, 1);
    set(Deviation::shape, d.degrees, d.sum);
    return shares;
}

}  // namespace hord::algo
