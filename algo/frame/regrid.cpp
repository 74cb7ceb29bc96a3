#include "algo/frame/regrid.h"

#include <algorithm>
#include <cmath>
#include <cstring>
#include <optional>
#include <type_traits>
#include <utility>

#include "algo/frame/occupied_bins.h"
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
HORD_ALWAYS_INLINE void mixed(const Regridder::WeightedSources<std::uint16_t>& f, int bins, std::uint16_t* to) {
    const std::uint16_t *a = f.from[0], *b = f.from[1], *c = f.from[2], *d = f.from[3];
    for (int k = 0; k < bins; ++k)
        to[k] = static_cast<std::uint16_t>(
            (f.weight[0] * a[k] + f.weight[1] * b[k] + f.weight[2] * c[k] + f.weight[3] * d[k] + 128U) >> 8U);
}
// The same of 8-bit samples, in 16 bits: at most 256 * 255 + 128 < 2^16. The last vector may reach beyond the bins,
// into kRoom.
template <int>
HORD_ALWAYS_INLINE void mixed_8bit(const Regridder::WeightedSources<std::uint8_t>& f, int bins, std::uint8_t* to) {
    using Words = Vector<std::uint16_t, 32>;
    using Bytes = Vector<std::uint8_t, 16>;
    const auto w = [&f](int k) { return Words{} + static_cast<std::uint16_t>(f.weight[k]); };
    const auto samples = [&f](int k, int at) __attribute__((always_inline)) {
        return __builtin_convertvector(load<Bytes>(f.from[k] + at), Words);
    };
    const Words w0 = w(0), w1 = w(1), w2 = w(2), w3 = w(3), half = Words{} + std::uint16_t{128};
    const auto add_up = [&](auto four) __attribute__((always_inline)) {
        for (int at = 0; at < bins; at += 16) {
            Words sum = w0 * samples(0, at) + w1 * samples(1, at) + w2 * samples(2, at) + half;
            if constexpr (four) sum += w3 * samples(3, at);
            store<Bytes>(__builtin_convertvector(sum >> 8, Bytes), to + at);
        }
    };
    if (f.weight[3] == 0) add_up(std::false_type{});  // a hexagonal lattice
    else add_up(std::true_type{});
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
    Tables tables;
    tables.columns.resize(static_cast<std::size_t>(grid.rows));
    int most_rows = 1;
    for (int n = 0; n < rows; ++n) {
        Range of_row;
        LensletGrid::Uv start = n > 0 ? LensletGrid::Uv{} : *middle;
        for (int m = 0; m < columns; ++m) {
            const auto at =
                place_of(grid, {out.first_px_.x_px + m * out.pitch_px_, out.first_px_.y_px + n * out.pitch_px_}, start);
            if (at) start = *at;
            const Source source = at ? source_at(grid, *at) : Source{};
            for (int k = 0; k < kAround; ++k) {
                if (source.weight[k] == 0) continue;
                of_row.cover(source.n[k]);
                tables.columns[static_cast<std::size_t>(source.n[k])].cover(source.m[k]);
            }
            tables.sources.push_back(source);
        }
        tables.rows.push_back(of_row);
        most_rows = std::max(most_rows, of_row.last - of_row.first + 1);
    }
    out.tables_ = std::make_shared<const Tables>(std::move(tables));
    out.ring_rows_ = most_rows;
    out.ring_row_.assign(static_cast<std::size_t>(most_rows), -1);
    out.offsets_.resize(static_cast<std::size_t>(most_rows));
    out.ring_.resize(static_cast<std::size_t>(most_rows) * static_cast<std::size_t>(grid.columns) *
                     static_cast<std::size_t>(out.extents_.bins()));
    out.mixed_.resize(static_cast<std::size_t>(out.extents_.bins()) + kRoom);
    out.ring_.resize(out.ring_.size() + kRoom);
    out.mix_ = mixed_for(best_isa());
    out.mix_8bit_ = mixed_8bit_for(best_isa());
    return out;
}

void Regridder::begin_frame() { std::fill(ring_row_.begin(), ring_row_.end(), -1); }

template <class Sample>
Sample* Regridder::slot(int n) {
    const std::size_t length = (ring_.size() - kRoom) / static_cast<std::size_t>(ring_rows_);
    return reinterpret_cast<Sample*>(ring_.data()) + static_cast<std::size_t>(n % ring_rows_) * length;
}

// `room`: 16 samples may be written to each line of `out`.
template <class Sample>
void Regridder::mix(const WeightedSources<Sample>& sources, Sample* out, std::ptrdiff_t line_stride, bool room) {
    auto* const mixed = reinterpret_cast<Sample*>(mixed_.data());
    if constexpr (sizeof(Sample) == 1) mix_8bit_(sources, extents_.bins(), mixed);
    else mix_(sources, extents_.bins(), mixed);
    for (int j = 0; j < extents_.j; ++j) {
        if (room) std::memcpy(out + j * line_stride, mixed + j * extents_.i, kRoom * sizeof(Sample));
        else std::copy_n(mixed + j * extents_.i, extents_.i, out + j * line_stride);
    }
}

template <class Sample>
void Regridder::decode_row(const FrameView& raw, int n, Sample* out, std::ptrdiff_t line_stride) {
    const std::ptrdiff_t bins = extents_.bins();
    const Range rows = tables_->rows[static_cast<std::size_t>(n)];
    for (int row = rows.first; row <= rows.last; ++row) {
        Sample* const samples = slot<Sample>(row);
        int& in_slot = ring_row_[static_cast<std::size_t>(row % ring_rows_)];
        if (std::exchange(in_slot, row) != row) {
            const Range columns = tables_->columns[static_cast<std::size_t>(row)];
            resampler_.decode_row_by_lenslet(raw, row, columns.first, columns.last, samples);
        }
        offsets_[static_cast<std::size_t>(row - rows.first)] = samples - slot<Sample>(0);
    }
    const Sample* const lattice = slot<Sample>(0);
    for (int m = 0; m < extents_.m; ++m) {
        const Source& source = tables_->sources[extents_.index(m, n)];
        Sample* const to = out + m * extents_.i;
        const auto& w = source.weight;
        const int any = w[0] != 0 ? 0 : w[1] != 0 ? 1 : w[2] != 0 ? 2 : 3;
        if (w[any] == 0) {
            for (int j = 0; j < extents_.j; ++j) std::fill_n(to + j * line_stride, extents_.i, Sample{0});
            continue;
        }
        // A source without a weight reads the samples of another one. Selected in registers: through memory a row of a
        // hexagonal lattice takes a third longer.
        const auto from = [&](int k) {
            const int used = w[k] != 0 ? k : any;
            return lattice + offsets_[static_cast<std::size_t>(source.n[used] - rows.first)] + source.m[used] * bins;
        };
        mix<Sample>({{from(0), from(1), from(2), from(3)}, {w[0], w[1], w[2], w[3]}}, to, line_stride,
                    m * extents_.i + static_cast<int>(kRoom) <= extents_.width_px());
    }
}

template <class Sample>
void Regridder::decode_lenslet(const FrameView& raw, int m, int n, Sample* out, std::ptrdiff_t line_stride) {
    const Source& source = tables_->sources[extents_.index(m, n)];
    Sample around[kAround][kMaxBinCount + kRoom] = {};
    WeightedSources<Sample> sources{};
    for (int k = 0; k < kAround; ++k) {
        sources.from[k] = around[k];
        sources.weight[k] = source.weight[k];
        if (source.weight[k] != 0) resampler_.decode_lenslet(raw, source.m[k], source.n[k], around[k], extents_.i);
    }
    mix(sources, out, line_stride, false);
}

template void Regridder::decode_row(const FrameView&, int, std::uint8_t*, std::ptrdiff_t);
template void Regridder::decode_row(const FrameView&, int, std::uint16_t*, std::ptrdiff_t);
template void Regridder::decode_lenslet(const FrameView&, int, int, std::uint8_t*, std::ptrdiff_t);
template void Regridder::decode_lenslet(const FrameView&, int, int, std::uint16_t*, std::ptrdiff_t);

}  // namespace hord::algo
