#include "algo/compare.h"

#include <algorithm>
#include <cmath>

#include "algo/mask.h"

namespace hord::algo {

namespace {

constexpr int kLine = GoldenLines::kLine;
constexpr int kCopiedFrom = 2, kCopied = kLine * kMaxBins + kLine;  // places: of a copied lenslet's first sample; of all
constexpr int kAhead = 8, kFetchTogether = 3;  // lenslets: so far before they are needed samples are fetched; so many share the lines of a cache
constexpr float kEdgeBins = 0.2F, kEdgeLight = 0.1F;  // second differences of a golden map: what interpolation cannot follow

constexpr int floor_of(double v) {
    const int towards_zero = static_cast<int>(v);
    return towards_zero - (v < towards_zero ? 1 : 0);
}

// With operations alone that are rounded alike everywhere.
double exp_of(double x) {
    int halved = 0;
    for (; x > 0.5; x *= 0.5) ++halved;
    double sum = 1, term = 1;
    for (int k = 1; k <= 14; ++k) sum += term *= x / k;
    for (; halved > 0; --halved) sum *= sum;
    return sum;
}

// The variance of what a normal number of this variance has above `clip`, nothing where it has not.
double clipped_variance(double variance, double clip) {
    const double from = clip / std::sqrt(variance), step = 1.0 / 32;
    double mean = 0, square = 0;
    for (int k = 0; k < 8 * 32; ++k) {
        const double above = (k + 0.5) * step, z = from + above, density = 0.3989422804 * step / exp_of(0.5 * z * z);
        mean += density * above;
        square += density * above * above;
    }
    return variance * (square - mean * mean);
}

}  // namespace

Comparer::Comparer(const Reference& reference, Isa isa)
    : reference_(reference), golden_(reference, isa), fitter_(reference.extents, reference.stride(), isa), edge_(reference.extents.lenslets()),
      copied_(static_cast<std::size_t>(BinFitter::kAtOnce * kCopied)) {
    const double clip = static_cast<double>(reference.sensor.clip_dn), gain = static_cast<double>(reference.sensor.electrons_per_dn), read = static_cast<double>(reference.sensor.read_dn);
    double clipped = 0, light = 0;
    for (std::size_t k = 0; k < edge_.size(); ++k) {
        if (reference.mask[k] != kValid) continue;
        const std::uint16_t* share = reference.shares.data() + k * reference.stride();
        double cut = 0;
        for (std::size_t b = 0; b < reference.stride(); ++b) cut += std::min(clip, static_cast<double>(share[b]) * 0x1p-15 * static_cast<double>(reference.light[k]));
        clipped += cut, light += static_cast<double>(reference.light[k]);
    }
    clipped_ = light > 0 ? clipped / light : 0;
    find_edges();
    floor_ = read * read + 1.0 / 12;
    const double quiet = clipped_variance(floor_, clip), empty = std::max({2 * quiet, floor_ / 16, 1.0 / 12});
    noise_ = {0, static_cast<float>(clip / gain + floor_ - quiet), static_cast<float>(std::sqrt(floor_)), static_cast<float>(empty), static_cast<float>(quiet)};
    noise_at_edges_ = noise_;
    noise_at_edges_.empty = static_cast<float>(floor_);
}

void Comparer::find_edges() {
    const Extents& e = reference_.extents;
    const auto at = [&](int m, int n) { return static_cast<std::size_t>(n * e.m + m); };
    for (int n = 0; n < e.n; ++n) {
        for (int m = 0; m < e.m; ++m) {
            if (reference_.mask[at(m, n)] == kOutside) continue;
            bool edge = reference_.mask[at(m, n)] != kValid;
            const auto bends = [&](std::size_t before, std::size_t k, std::size_t after) {
                if ((reference_.mask[before] | reference_.mask[k] | reference_.mask[after]) != kValid) return;
                const auto second = [&](const std::vector<float>& map) { return std::abs(map[before] - 2 * map[k] + map[after]); };
                edge = edge || second(reference_.x) > kEdgeBins || second(reference_.y) > kEdgeBins || second(reference_.light) > kEdgeLight * reference_.light[k];
            };
            if (m > 0 && m + 1 < e.m) bends(at(m - 1, n), at(m, n), at(m + 1, n));
            if (n > 0 && n + 1 < e.n) bends(at(m, n - 1), at(m, n), at(m, n + 1));
            for (int y = std::max(0, n - 2); edge && y <= std::min(e.n - 1, n + 2); ++y) {
                for (int x = std::max(0, m - 2); x <= std::min(e.m - 1, m + 2); ++x) edge_[at(x, y)] = 1;
            }
        }
    }
}

// Of a part at `light_` times the reference's light.
BinNoise Comparer::at_light(const BinNoise& noise) const {
    BinNoise here = noise;
    here.a_dn = static_cast<float>(golden_share_ / static_cast<double>(reference_.sensor.electrons_per_dn));
    // Of a spot's fringes, weaker light leaves below the dark level what is not quiet.
    if (light_ < 1) here.empty = std::max(here.empty, static_cast<float>(floor_ * (1 - light_) * (1 - light_)));
    return here;
}

void Comparer::start_row(const PoseMap& pose, int n, double light) {
    pose_ = &pose;
    light_ = (light + clipped_) / (1 + clipped_);
    golden_.start_row(pose, n, light_);
    golden_share_ = 1 + light_ / reference_.parts;  // less light than its own: less of its noise
    noise_now_ = at_light(noise_), noise_at_edges_now_ = at_light(noise_at_edges_);
}

// Of the lenslets at the ends of the frame's lines: so that around each line can be read.
template <class Sample>
LensletSamples Comparer::copy_of(const Sample& sample, std::uint32_t dark) {
    std::uint16_t* const copied = copied_.data() + std::ptrdiff_t{waiting_count_} * kCopied + kCopiedFrom;
    for (int j = 0; j < reference_.extents.j; ++j) {
        for (int i = 0; i < reference_.extents.i; ++i) copied[j * kLine + i] = sample(i, j);
    }
    return {copied, kLine, true, dark};
}

void Comparer::compare_row(const HordRow& row, int n, const PoseMap& pose, double light, std::span<Difference> out) {
    start_row(pose, n, light);
    for (int m = 0; m < reference_.extents.m; ++m) {
        const auto k = static_cast<std::size_t>(m);
        out[k] = {};
        if ((row.mask()[k] & kSaturated) != 0) continue;
        const std::uint16_t* mass = row.hord(m).mass;
        LensletSamples samples{mass, reference_.extents.i, true, 0};
        if (m == 0) samples = copy_of([&](int i, int j) { return mass[j * reference_.extents.i + i]; }, 0);
        compare(samples, row.sums()[k], row.has_hord(m), m, n, out[k]);
    }
    finish_waiting();
}

void Comparer::compare_row(const FrameView& frame, std::span<const std::uint32_t> sums, std::span<const std::uint8_t> mask, int n, const PoseMap& pose, double light,
                           std::span<Difference> out) {
    start_row(pose, n, light);
    const Extents& e = reference_.extents;
    const bool wide = frame.sample_bytes() == 2;
    const auto bytes = static_cast<std::ptrdiff_t>(frame.sample_bytes());
    const auto* first = reinterpret_cast<const std::uint8_t*>(frame.data) + std::ptrdiff_t{n} * e.j * frame.stride_bytes;
    const int read_in_place = std::max(0, (frame.width_px - kLine) / e.i + 1);
    for (int m = 0; m < e.m; ++m) {
        const auto k = static_cast<std::size_t>(m);
        if ((mask[k] & kOutside) != 0) continue;
        out[k] = {};
        if ((mask[k] & kSaturated) != 0) continue;
        if (m % kFetchTogether == 0 && m + kAhead < e.m) {
            for (int j = 0; j < e.j; ++j) __builtin_prefetch(first + std::ptrdiff_t{m + kAhead} * e.i * bytes + j * frame.stride_bytes);
        }
        LensletSamples samples{first + std::ptrdiff_t{m} * e.i * bytes, frame.stride_bytes / bytes, wide, reference_.levels.dark};
        if (m == 0 || m >= read_in_place) samples = copy_of([&](int i, int j) { return static_cast<std::uint16_t>(frame.sample(m * e.i + i, n * e.j + j)); }, reference_.levels.dark);
        compare(samples, sums[k], (mask[k] & kNoHord) == 0, m, n, out[k]);
    }
    finish_waiting();
}

// Its light at once; its bins when there are enough lenslets to be fitted together.
void Comparer::compare(const LensletSamples& samples, std::uint32_t sum, bool has_hord, int m, int n, Difference& out) {
    const Extents& e = reference_.extents;
    const auto q = pose_->to_reference(m, n);
    const GoldenReader::Golden& golden = fitter_.take(waiting_count_, golden_, q);
    if (!golden.known) return;
    out.at = static_cast<std::uint32_t>(std::clamp(floor_of(q.n + 0.5), 0, e.n - 1) * e.m + std::clamp(floor_of(q.m + 0.5), 0, e.m - 1));
    const double expected = golden.light * golden.share;
    out.sum = static_cast<float>(sum);
    if (expected < static_cast<double>(reference_.levels.min_sum)) return;
    out.has_light = true;
    const double per_expected = 1 / expected, a_dn = static_cast<double>(noise_now_.a_dn);
    out.light = static_cast<float>(static_cast<double>(sum) * per_expected - 1);
    constexpr double kBinsLit = 9;  // that add their floor to the sum
    out.light_variance = static_cast<float>((a_dn * expected + kBinsLit * floor_ * golden_share_) * per_expected * per_expected);
    if (!golden.has_hord || !has_hord) return;
    fitter_.put(waiting_count_, samples, static_cast<float>(static_cast<double>(sum) / golden.share), edge_[out.at] != 0 ? noise_at_edges_now_ : noise_now_);
    // The turn of the part turns its deflections: that is no deviation.
    const auto gx = static_cast<double>(reference_.x[out.at]), gy = static_cast<double>(reference_.y[out.at]);
    const auto turned = pose_->turned(gx, gy);
    waiting_[static_cast<std::size_t>(waiting_count_++)] = {&out, turned.m - gx, turned.n - gy};
    if (waiting_count_ == BinFitter::kAtOnce) finish_waiting();
}

void Comparer::finish_waiting() {
    std::array<BinFitter::Fit, BinFitter::kAtOnce> fits;
    if (waiting_count_ > 0) fitter_.fit(waiting_count_, fits);
    for (int slot = 0; slot < waiting_count_; ++slot) {
        const BinFitter::Fit& fit = fits[static_cast<std::size_t>(slot)];
        const Waiting& waiting = waiting_[static_cast<std::size_t>(slot)];
        if (!fit.found) continue;
        Difference& out = *waiting.out;
        out.has_hord = true;
        out.x = static_cast<float>(fit.a), out.y = static_cast<float>(fit.b), out.blur = static_cast<float>(fit.c);
        out.x_variance = static_cast<float>(fit.a_variance);
        out.y_variance = static_cast<float>(fit.b_variance);
        out.blur_variance = static_cast<float>(fit.c_variance);
        out.chi2 = static_cast<float>(fit.chi2);
        out.degrees = static_cast<float>(std::max(1.0, fit.degrees - 3));
        if (std::sqrt(2 * out.chi2) > std::sqrt(2 * out.degrees) + kMuch) look_how_far(slot, out);
        out.x -= static_cast<float>(waiting.x);
        out.y -= static_cast<float>(waiting.y);
    }
    waiting_count_ = 0;
}

// Where a fit of small shifts does not say how far light went: by the mean of all bins.
void Comparer::look_how_far(int slot, Difference& out) {
    const BinFitter::Bins bins = fitter_.bins_of(slot);
    const double a_dn = golden_share_ / static_cast<double>(reference_.sensor.electrons_per_dn), quiet = static_cast<double>(noise_.quiet);
    struct Moments {
        double light = 0, x = 0, y = 0, xx = 0, yy = 0;
        void add(double v, double at_x, double at_y) { light += v, x += v * at_x, y += v * at_y, xx += v * at_x * at_x, yy += v * at_y * at_y; }
    } seen, wanted, places;
    for (int j = 0; j < reference_.extents.j; ++j) {
        for (int i = 0; i < reference_.extents.i; ++i) {
            const auto k = reference_.place(i, j);
            const double x = i - 0.5 * (reference_.extents.i - 1), y = j - 0.5 * (reference_.extents.j - 1);
            seen.add(static_cast<double>(bins.mass[k]), x, y), places.add(1, x, y);
            wanted.add(static_cast<double>(bins.golden[k]), x, y);
        }
    }
    if (!(seen.light > 0) || !(wanted.light > 0)) return;
    const double mean_x = wanted.x / wanted.light, mean_y = wanted.y / wanted.light;
    const double moved_x = seen.x / seen.light - mean_x, moved_y = seen.y / seen.light - mean_y;
    // At an edge the mean moves with how the edge lies in the lenslet.
    const int columns = reference_.extents.m, at_m = static_cast<int>(out.at) % columns, at_n = static_cast<int>(out.at) / columns;
    float least_x = 8, most_x = -8, least_y = 8, most_y = -8;
    for (int y = std::max(0, at_n - 1); y <= std::min(reference_.extents.n - 1, at_n + 1); ++y) {
        for (int x = std::max(0, at_m - 1); x <= std::min(columns - 1, at_m + 1); ++x) {
            const auto k = static_cast<std::size_t>(y * columns + x);
            if (reference_.mask[k] != kValid) continue;
            least_x = std::min(least_x, reference_.x[k]), most_x = std::max(most_x, reference_.x[k]);
            least_y = std::min(least_y, reference_.y[k]), most_y = std::max(most_y, reference_.y[k]);
        }
    }
    const double far = kFarBins + static_cast<double>(std::max(0.0F, std::max(most_x - least_x, most_y - least_y)));
    if (moved_x * moved_x + moved_y * moved_y <= far * far) return;
    out.x = static_cast<float>(moved_x);
    out.y = static_cast<float>(moved_y);
    const auto variance = [&](double squares, double mean, double of_places) { return (squares / wanted.light - mean * mean) * a_dn / seen.light + quiet * of_places / (seen.light * seen.light); };
    out.x_variance = static_cast<float>(std::max(variance(wanted.xx, mean_x, places.xx), static_cast<double>(out.x_variance)));
    out.y_variance = static_cast<float>(std::max(variance(wanted.yy, mean_y, places.yy), static_cast<double>(out.y_variance)));
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
