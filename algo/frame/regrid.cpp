#include "algo/frame/regrid.h"

#include <algorithm>
#include <cmath>
#include <optional>

#include "algo/simd/multiversion.h"

namespace hord::algo {
namespace {

constexpr int kMaxSteps = 20;
constexpr double kSettled = 1e-6;  // px

// Inverts the grid by Newton's method from `start`; none if it does not converge (far outside the lattice, where a
// polynomial may fold).
std::optional<LensletGrid::Uv> place_of(const LensletGrid& grid, PixelPoint wanted, LensletGrid::Uv start) {
    LensletGrid::Uv at = start;
    for (int k = 0; k < kMaxSteps; ++k) {
        const PixelPoint here = grid.at(at);
        const double dx = wanted.x_px - here.x_px;
        const double dy = wanted.y_px - here.y_px;
        if (dx < kSettled && dx > -kSettled && dy < kSettled && dy > -kSettled) return at;
        const LensletGrid::Steps steps = grid.steps_px(at);  // of one pitch, 1 / span of u and v
        const double area = steps.area_px2();
        if (!(area > 1e-9 || area < -1e-9)) return std::nullopt;
        at.u += (dx * steps.along_v.y_px - dy * steps.along_v.x_px) / area / grid.span;
        at.v += (dy * steps.along_u.x_px - dx * steps.along_u.y_px) / area / grid.span;
    }
    return std::nullopt;
}

// (sum of w * sample + 128) >> 8, of four lenslets.
template <int>
HORD_ALWAYS_INLINE void mixed(const Regridder::WeightedSources& f, int bins, std::uint16_t* to) {
    const std::uint16_t *a = f.from[0], *b = f.from[1], *c = f.from[2], *d = f.from[3];
    for (int k = 0; k < bins; ++k)
        to[k] = static_cast<std::uint16_t>(
            (f.weight[0] * a[k] + f.weight[1] * b[k] + f.weight[2] * c[k] + f.weight[3] * d[k] + 128U) >> 8U);
}
// The same of 8-bit samples, in 16 bits: at most 256 * 255 + 128 < 2^16. The last vector may reach beyond the bins,
// into kRoom.
template <int>
HORD_ALWAYS_INLINE void mixed_8bit(const Regridder::WeightedSources& f, int bins, std::uint16_t* to) {
    using Words = Vector<std::uint16_t, 32>;
    const auto w = [&f](int k) { return Words{} + static_cast<std::uint16_t>(f.weight[k]); };
    const Words w0 = w(0), w1 = w(1), w2 = w(2), w3 = w(3);
    for (int k = 0; k < bins; k += 16) {
        const Words sum = w0 * load<Words>(f.from[0] + k) + w1 * load<Words>(f.from[1] + k) +
            w2 * load<Words>(f.from[2] + k) + w3 * load<Words>(f.from[3] + k);
        store<Words>((sum + std::uint16_t{128}) >> 8, to + k);
    }
}
HORD_FOR_EACH_ISA(mixed_for, mixed)
HORD_FOR_EACH_ISA(mixed_8bit_for, mixed_8bit)

}  // namespace

Regridder::Source Regridder::source_at(const LensletGrid& grid, LensletGrid::Uv where) {
    double along = where.u * grid.span + grid.origin_u;   // in pitches: along the rows of lenslets,
    double across = where.v * grid.span + grid.origin_v;  // and from row to row
    const bool by_columns = grid.stagger == Stagger::columns;
    if (by_columns) std::swap(along, across);
    const bool hexagonal = grid.stagger != Stagger::none;
    // Skew coordinates in which the lattice points are the integers.
    const double b = hexagonal ? across / kHalfSqrt3 : across;
    const double a = hexagonal ? along - 0.5 * (b + grid.parity) : along;
    const int first_a = static_cast<int>(std::floor(a));
    const int first_b = static_cast<int>(std::floor(b));
    const double fa = a - first_a;
    const double fb = b - first_b;
    struct Corner {
        int a, b;
        double weight;
    };
    const bool upper = fa + fb < 1;
    const Corner triangle[kAround] = {upper ? Corner{0, 0, 1 - fa - fb} : Corner{1, 1, fa + fb - 1},
                                      {1, 0, upper ? fa : 1 - fb},
                                      {0, 1, upper ? fb : 1 - fa},
                                      {0, 0, 0}};
    const Corner cell[kAround] = {
        {0, 0, (1 - fa) * (1 - fb)}, {1, 0, fa * (1 - fb)}, {0, 1, (1 - fa) * fb}, {1, 1, fa * fb}};
    const Corner* corners = hexagonal ? triangle : cell;
    Source source{};
    int left = 256;
    int largest = 0;
    for (int k = 0; k < kAround; ++k) {
        const int weight = static_cast<int>(std::floor(256 * corners[k].weight + 0.5));
        const int row = first_b + corners[k].b;
        const int skew = first_a + corners[k].a;
        const int column = hexagonal ? skew + (row + grid.parity - shifted(row, grid.parity)) / 2 : skew;
        const int m = by_columns ? row : column;
        const int n = by_columns ? column : row;
        if (weight > 0 && (m < 0 || n < 0 || m >= grid.columns || n >= grid.rows)) return {};
        source.m[k] = static_cast<std::int16_t>(weight > 0 ? m : 0);
        source.n[k] = static_cast<std::int16_t>(weight > 0 ? n : -1);
        source.weight[k] = static_cast<std::uint16_t>(weight);
        left -= weight;
        if (weight > source.weight[largest]) largest = k;
    }
    source.weight[largest] = static_cast<std::uint16_t>(source.weight[largest] + left);  // remainder of rounding
    return source;
}

Result<Regridder> Regridder::create(const LensletGrid& grid, const BinLayout& layout) {
    auto resampler = Resampler::create(grid, layout);
    if (!resampler) return tl::unexpected(resampler.error());
    Regridder out(std::move(*resampler));
    out.pitch_px_ = grid.steps_px({0, 0}).mean_px();
    const int columns = static_cast<int>(std::floor(grid.width_px / out.pitch_px_));
    const int rows = static_cast<int>(std::floor(grid.height_px / out.pitch_px_));
    out.extents_ = {columns, rows, layout.bins_i, layout.bins_j};
    if (auto fine = check(out.extents_); !fine) return tl::unexpected(fine.error());
    out.first_px_ = {0.5 * (grid.width_px - 1) - 0.5 * (columns - 1) * out.pitch_px_,
                     0.5 * (grid.height_px - 1) - 0.5 * (rows - 1) * out.pitch_px_};

    const auto middle = place_of(grid, {0.5 * (grid.width_px - 1), 0.5 * (grid.height_px - 1)}, {0, 0});
    if (!middle)
        return fail(ErrorCode::invalid_argument, "a grid that does not reach the middle of its frame",
                    "calibrate again");
    int most_rows = 1;
    for (int n = 0; n < rows; ++n) {
        int low = grid.rows;
        int high = -1;
        LensletGrid::Uv start = n > 0 ? LensletGrid::Uv{} : *middle;
        for (int m = 0; m < columns; ++m) {
            const auto at =
                place_of(grid, {out.first_px_.x_px + m * out.pitch_px_, out.first_px_.y_px + n * out.pitch_px_}, start);
            if (at) start = *at;
            const Source source = at ? source_at(grid, *at) : Source{};
            for (int k = 0; k < kAround; ++k) {
                if (source.weight[k] == 0) continue;
                low = std::min<int>(low, source.n[k]);
                high = std::max<int>(high, source.n[k]);
            }
            out.sources_.push_back(source);
        }
        most_rows = std::max(most_rows, high - low + 1);
    }
    out.ring_rows_ = most_rows;
    out.ring_row_.assign(static_cast<std::size_t>(most_rows), -1);
    out.ring_.resize(static_cast<std::size_t>(most_rows) * static_cast<std::size_t>(grid.columns) *
                     static_cast<std::size_t>(out.extents_.bins()));
    out.mixed_.resize(static_cast<std::size_t>(out.extents_.bins()) + kRoom);
    out.ring_.resize(out.ring_.size() + kRoom);
    out.mix_ = mixed_for(best_isa());
    out.mix_8bit_ = mixed_8bit_for(best_isa());
    return out;
}

void Regridder::begin_frame() { std::fill(ring_row_.begin(), ring_row_.end(), -1); }

const std::uint16_t* Regridder::row(const FrameView& raw, int n) {
    const auto place = static_cast<std::size_t>(n % ring_rows_);
    const std::size_t length = (ring_.size() - kRoom) / static_cast<std::size_t>(ring_rows_);
    std::uint16_t* const samples = ring_.data() + place * length;
    if (ring_row_[place] != n) {
        resampler_.decode_row_by_lenslet(raw, n, {samples, length});
        ring_row_[place] = n;
    }
    return samples;
}

void Regridder::decode_row(const FrameView& raw, int n, std::span<std::uint16_t> out) {
    const int bins = extents_.bins();
    const int stride = extents_.m * extents_.i;
    for (int m = 0; m < extents_.m; ++m) {
        const Source& source = sources_[extents_.index(m, n)];
        const std::uint16_t* from[kAround] = {};
        const std::uint16_t* any = nullptr;
        for (int k = 0; k < kAround; ++k) {
            if (source.weight[k] == 0) continue;
            from[k] = any = row(raw, source.n[k]) + static_cast<std::ptrdiff_t>(source.m[k]) * bins;
        }
        if (any == nullptr) {
            std::fill(mixed_.begin(), mixed_.end(), std::uint16_t{0});
        } else {
            // A source without a weight reads the samples of another one. Selected in registers: through memory a row
            // of a hexagonal lattice takes a third longer.
            const auto& w = source.weight;
            const WeightedSources sources{{w[0] > 0 ? from[0] : any, w[1] > 0 ? from[1] : any, w[2] > 0 ? from[2] : any,
                                           w[3] > 0 ? from[3] : any},
                                          {w[0], w[1], w[2], w[3]}};
            (raw.bits > 8 ? mix_ : mix_8bit_)(sources, bins, mixed_.data());
        }
        for (int j = 0; j < extents_.j; ++j)
            std::copy_n(mixed_.data() + j * extents_.i, extents_.i, out.data() + j * stride + m * extents_.i);
    }
}

}  // namespace hord::algo
