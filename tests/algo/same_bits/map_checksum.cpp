// Prints one number for the bits of every map, and of how random frames differ from references, over random frames and
// over the frames named: map_checksum [FRAME.raw ...]. The same on every processor, compiler and instruction set: the
// tests also build and run this program for arm64 and compare. Exit status 1: two instruction sets of this processor
// disagree; 77: a frame is missing.
//
// FRAME.raw: eight little-endian bytes, columns and rows of lenslets; then their samples, 9x9 bins of 8 bits.
#include <bit>
#include <cinttypes>
#include <cstdio>
#include <cstring>
#include <fstream>
#include <iterator>
#include <string>
#include <vector>

#include "algo/frame/mask.h"
#include "algo/maps/feature_map.h"
#include "algo/recipe/recipe.h"
#include "algo/reference/reference_comparison.h"
#include "algo/soa/soa_emd_bounds.h"

namespace {

using namespace hord;
using namespace hord::algo;

// xorshift64*: the standard library's distributions differ between platforms.
struct Random {
    std::uint64_t state = 0x9E3779B97F4A7C15U;
    std::uint32_t below(std::uint32_t limit) {
        state ^= state >> 12;
        state ^= state << 25;
        state ^= state >> 27;
        return static_cast<std::uint32_t>(((state * 0x2545F4914F6CDD1DU) >> 32) % limit);
    }
};

struct Checksum {
    std::uint64_t value = 0xCBF29CE484222325U;  // FNV-1a over 64-bit words
    void add(std::uint64_t word) { value = (value ^ word) * 0x100000001B3U; }
    void add(std::span<const float> map) {
        for (const float v : map) add(std::uint64_t{std::bit_cast<std::uint32_t>(v)});
    }
    void add(std::span<const std::uint8_t> map) {
        for (const auto v : map) add(std::uint64_t{v});
    }
};

// Lenslets of every kind: dark, sparse, dense, and spots that move smoothly.
Frame random_frame(const Extents& e, int bits, Random& random) {
    const std::uint32_t full = (1U << bits) - 1;
    Frame frame(e.width_px(), e.height_px(), bits);
    for (int n = 0; n < e.n; ++n) {
        for (int m = 0; m < e.m; ++m) {
            const std::uint32_t kind = random.below(10);
            for (int k = 0; k < e.bins(); ++k) {
                const int far = std::abs(k % e.i - m % e.i) + std::abs(k / e.i - n % e.j);
                const bool lit = kind == 0 ? false : kind == 1 ? random.below(4) == 0 : kind == 2 ? true : far < 3;
                frame.set(m * e.i + k % e.i, n * e.j + k / e.i, lit ? random.below(full) : 0);
            }
        }
    }
    return frame;
}

std::uint64_t of_frames(const Extents& e, const FrameView& frame, const FrameView& reference, Isa isa) {
    Checksum sum;
    const LightLevels levels = light_levels({}, frame.bits);
    for (std::size_t f = 0; f < static_cast<std::size_t>(Feature::transmission); ++f) {
        const auto feature = static_cast<Feature>(f);
        auto mapper = FeatureMapper::create(e, frame.bits, levels, feature, {.threads = 2, .isa = isa});
        const auto map = mapper->over_neighbours(frame);
        sum.add(map->values);
        sum.add(map->mask);
        if (is_distance(feature)) sum.add(mapper->against(frame, reference)->values);
    }
    SoaDistances rows(e, Feature::emd, isa, true);
    const SoaEmdBounds bounds(e, isa);
    std::vector<std::uint8_t> mask(static_cast<std::size_t>(e.m));
    std::vector<float> upper(mask.size());
    rows.load(frame, levels, 0);
    for (int n = 0; n < e.n; ++n) {
        if (n + 1 < e.n) rows.load(frame, levels, n + 1);
        rows.mark_row(n, mask.data());
        bounds.row(rows, n, mask.data(), kNoGradient, upper.data());
        sum.add(std::span<const float>(upper));
    }
    return sum.value;
}

// Reference HORDs of even spots, narrow ones at the left and wide ones at the right, that move from lenslet to lenslet;
// some are dark, some unknown.
Reference reference_of(const Extents& e, int bits, Random& random) {
    Reference r;
    r.extents = e;
    r.bits = bits;
    r.levels = light_levels({}, bits);
    r.sensor = {2.5F, 1.5F, 3.0F};
    r.parts = 16;
    const std::size_t count = e.lenslets();
    r.shares.assign(count * r.stride(), 0);
    r.x.assign(count, 0), r.y.assign(count, 0), r.mask.assign(count, kValid), r.emd.assign(count, 0),
        r.frobenius.assign(count, 0);
    for (auto& spread : r.spread) spread.assign(count, 1e-4F);
    std::vector<int> weight(static_cast<std::size_t>(e.bins()));
    for (int n = 0; n < e.n; ++n) {
        for (int m = 0; m < e.m; ++m) {
            const auto k = static_cast<std::size_t>(n * e.m + m);
            r.light.push_back(static_cast<float>(900 + random.below(64)));
            if (random.below(40) == 0) {
                r.mask[k] = random.below(2) == 0 ? kDark : kOutside;
                continue;
            }
            const int reach = m < e.m / 2 ? 12 : 30;  // eighths of a bin
            int sum = 0;
            for (int b = 0; b < e.bins(); ++b) {
                const int x = std::abs(8 * (b % e.i) - 4 * (e.i - 1) - m % 9 + 4),
                          y = std::abs(8 * (b / e.i) - 4 * (e.j - 1) - n % 7 + 3);
                sum += weight[static_cast<std::size_t>(b)] = std::max(0, reach - x) * std::max(0, reach - y);
            }
            for (int b = 0; b < e.bins(); ++b)
                r.shares[k * r.stride() + r.place(b % e.i, b / e.i)] =
                    static_cast<std::uint16_t>(weight[static_cast<std::size_t>(b)] * 32760 / sum);
        }
    }
    return r;
}

// The comparison of a frame with it, for a part that is turned a little.
std::uint64_t of_comparison(const Reference& r, const FrameView& frame, Isa isa) {
    Checksum sum;
    ReferenceComparer comparer(r, isa);
    HordRow row(r.extents);
    std::vector<Difference> differences(static_cast<std::size_t>(r.extents.m));
    const PoseMap pose({0.4, -0.3, 1.0 / 128}, r.extents);
    for (int n = 0; n < r.extents.n; ++n) {
        decode_row(frame, r.extents, r.levels, n, row);
        comparer.compare_row(frame, row.sums(), row.mask(), n, pose, 0.9, r.levels.dark, differences);
        for (const Difference& d : differences) {
            sum.add(std::uint64_t{d.has_light} + 2 * std::uint64_t{d.has_hord});
            const Scores scores = scores_of(d, r);
            sum.add(std::span<const float>(scores));
            const float all[] = {d.light,      d.light_variance,      d.x,    d.y,       d.x_variance, d.y_variance,
                                 d.scattering, d.scattering_variance, d.chi2, d.degrees, d.sum};
            sum.add(std::span<const float>(all));
        }
    }
    return sum.value;
}

Checksum of_everything(const std::vector<Frame>& given, Isa isa) {
    Checksum all;
    Random random;
    for (const auto& [e, bits] : {std::pair(Extents{37, 9, 9, 9}, 8), std::pair(Extents{18, 5, 15, 4}, 16),
                                  std::pair(Extents{20, 7, 8, 8}, 12), std::pair(Extents{16, 6, 3, 3}, 10)}) {
        const Frame frame = random_frame(e, bits, random), reference = random_frame(e, bits, random);
        all.add(of_frames(e, frame.view(), reference.view(), isa));
    }
    for (const auto& [e, bits] : {std::pair(Extents{40, 23, 9, 9}, 12), std::pair(Extents{24, 12, 15, 6}, 16),
                                  std::pair(Extents{16, 10, 5, 5}, 8)}) {
        const Reference reference = reference_of(e, bits, random);
        // Reference light, noise, and lenslets of every other kind.
        Frame frame = random_frame(e, bits, random);
        for (int n = 0; n < e.n; ++n) {
            for (int m = 0; m < e.m; ++m) {
                const auto k = static_cast<std::size_t>(n * e.m + m);
                if (random.below(8) == 0) continue;
                const auto light = static_cast<std::uint32_t>(bits == 8 ? 700 : 1000);
                for (int b = 0; b < e.bins(); ++b) {
                    const std::uint32_t reference_hord =
                        reference.shares[k * reference.stride() + reference.place(b % e.i, b / e.i)];
                    frame.set(m * e.i + b % e.i, n * e.j + b / e.i,
                              std::min((1U << bits) - 2,
                                       reference_hord * light / 32768 + random.below(6) + reference.levels.dark));
                }
            }
        }
        all.add(of_comparison(reference, frame.view(), isa));
    }
    for (const Frame& frame : given)
        all.add(of_frames({frame.width_px() / 9, frame.height_px() / 9, 9, 9}, frame.view(), frame.view(), isa));
    return all;
}

}  // namespace

int main(int argc, char** argv) {
    std::vector<Frame> given;
    for (int k = 1; k < argc; ++k) {
        std::ifstream file(argv[k], std::ios::binary);
        const std::string bytes{std::istreambuf_iterator<char>(file), {}};
        std::uint32_t size[2] = {};
        if (bytes.size() < sizeof size) return 77;
        std::memcpy(size, bytes.data(), sizeof size);
        Frame frame(static_cast<int>(size[0]) * 9, static_cast<int>(size[1]) * 9, 8);
        if (bytes.size() != sizeof size + frame.bytes().size()) return 77;
        std::memcpy(frame.bytes().data(), bytes.data() + sizeof size, frame.bytes().size());
        given.push_back(std::move(frame));
    }
    const std::uint64_t portable = of_everything(given, Isa::portable).value;
    for (const Isa isa : {Isa::avx2, Isa::avx512}) {
        if (has(isa) && of_everything(given, isa).value != portable) return 1;
    }
    std::printf("%016" PRIx64 "\n", portable);
}
