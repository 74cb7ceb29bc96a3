// Runs every kernel once between count_begin() and count_end(), and prints a line a kernel: its name, what it is
// counted by, and how many of them it computed. What count_kernels.sh counts. The work is drawn by integers: the same
// on every processor.
#include <cmath>
#include <cstdint>
#include <cstdio>
#include <cstdlib>
#include <vector>

#include "algo/emd/emd_solver.h"
#include "algo/features/deflection.h"
#include "algo/features/transmission.h"
#include "algo/frame/grid_decoder.h"
#include "algo/maps/feature_map.h"
#include "algo/recipe/recipe.h"
#include "algo/reference/reference_comparison.h"
#include "algo/soa/soa_emd_bounds.h"

// The counter looks for the blocks of these two.
extern "C" [[gnu::noinline]] void count_begin() { asm volatile(""); }
extern "C" [[gnu::noinline]] void count_end() { asm volatile(""); }

namespace {

using namespace hord;
using namespace hord::algo;

constexpr int kBins = 9;
constexpr int kBinCount = kBins * kBins;
constexpr Extents kField{80, 10, kBins, kBins};
constexpr LightLevels kLevels{3, 16, 255};

std::size_t index(int k) { return static_cast<std::size_t>(k); }

// xorshift64*: the standard library's distributions differ between platforms.
struct Random {
    std::uint64_t state = 0x9E3779B97F4A7C15U;
    int below(int limit) {
        state ^= state >> 12U;
        state ^= state << 25U;
        state ^= state >> 27U;
        return static_cast<int>(((state * 0x2545F4914F6CDD1DU) >> 32U) % static_cast<std::uint64_t>(limit));
    }
};

// The work runs once before it is counted: memory is allocated then.
template <class Work>
void count(const char* name, const char* unit, int units, Work work) {
    work();
    count_begin();
    work();
    count_end();
    std::printf("%s;%s;%d\n", name, unit, units);
}

template <class T>
T value_of(Result<T> result) {
    if (!result) {
        std::fprintf(stderr, "%s\n", result.error().message().c_str());
        std::exit(1);
    }
    return std::move(*result);
}

// A spot of 250 DN at (x, y), 64ths of a bin, on bin (i, j): falls to nothing at `reach`.
int spot(int i, int j, int x, int y, int reach) {
    const int dx = 64 * i - x, dy = 64 * j - y, rest = reach * reach - dx * dx - dy * dy;
    return rest <= 0 ? 0 : 250 * (rest / 64) / (reach * reach / 64);
}

// Seven lit bins a lenslet; the spot moves from lenslet to lenslet.
Frame smooth_frame(Random& random) {
    Frame frame(kField.width_px(), kField.height_px(), 8);
    for (int n = 0; n < kField.n; ++n) {
        for (int m = 0; m < kField.m; ++m) {
            const int x = 256 + m - kField.m / 2 + random.below(4), y = 256 + 3 * n + random.below(4);
            for (int b = 0; b < kBinCount; ++b)
                frame.set(m * kBins + b % kBins, n * kBins + b / kBins,
                          static_cast<std::uint32_t>(spot(b % kBins, b / kBins, x, y, 96) + random.below(3)));
        }
    }
    return frame;
}

// Pairs of HORDs, of which light(random, pair, bin) draws each.
struct Pairs {
    std::vector<std::vector<std::uint16_t>> mass;
    std::vector<std::uint32_t> sum;

    template <class Light>
    Pairs(int count, Light light) {
        Random random;
        for (int k = 0; k < 2 * count; ++k) {
            const auto at = light(random);
            std::vector<std::uint16_t> h(kBinCount);
            std::uint32_t total = 0;
            for (int b = 0; b < kBinCount; ++b) {
                const int dn = at(b % kBins, b / kBins);
                total += h[index(b)] = static_cast<std::uint16_t>(dn <= 3 ? 0 : dn);
            }
            mass.push_back(h);
            sum.push_back(total);
        }
    }
    [[nodiscard]] Hord at(std::size_t k) const { return {mass[k].data(), sum[k]}; }
};

void count_emd(const char* name, const Pairs& pairs) {
    auto solver = value_of(EmdSolver::create(value_of(GroundDistance::between_bins(kBins, kBins))));
    std::vector<double> out(pairs.sum.size() / 2);
    count(name, "pair", static_cast<int>(out.size()), [&] {
        for (std::size_t k = 0; k < out.size(); ++k) solver.submit(pairs.at(2 * k), pairs.at(2 * k + 1), &out[k]);
        solver.finish();
    });
}

void count_sparse_emd(const FrameView& frame) {
    auto solver = value_of(EmdSolver::create(value_of(GroundDistance::between_bins(kBins, kBins))));
    std::vector<HordRow> rows(2, HordRow(kField));
    std::vector<std::vector<SparseHord>> sparse(2, std::vector<SparseHord>(index(kField.m)));
    std::vector<double> out(2 * kField.lenslets());
    const int pairs = (kField.m - 1) * kField.n + kField.m * (kField.n - 1);
    count("EMD, sparse pairs", "pair", pairs, [&] {
        double* to = out.data();
        for (int n = 0; n < kField.n; ++n) {
            HordRow& row = rows[index(n % 2)];
            auto &here = sparse[index(n % 2)], &above = sparse[index(1 - n % 2)];
            decode_row(frame, kField, kLevels, n, row);
            solver.compact()(row.hord(0).mass, row.sums(), kBinCount, here.data());
            for (std::size_t m = 0; m < here.size(); ++m) {
                if (m > 0) solver.submit(here[m - 1], here[m], to++);
                if (n > 0) solver.submit(above[m], here[m], to++);
            }
            solver.finish();
        }
    });
}

void count_every_emd(const FrameView& frame) {
    count_sparse_emd(frame);
    count_emd("EMD, two lobes", Pairs(400, [](Random& random) {
                  const int x0 = 128 + random.below(256), y0 = 128 + random.below(256), x1 = 128 + random.below(256),
                            y1 = 128 + random.below(256), share = 30 + random.below(40);
                  return [=](int i, int j) {
                      return (share * spot(i, j, x0, y0, 96) + (100 - share) * spot(i, j, x1, y1, 96)) / 100;
                  };
              }));
    count_emd("EMD, mid", Pairs(60, [](Random& random) {
                  const int x = 224 + random.below(64), y = 224 + random.below(64);
                  return [=, &random](int i, int j) { return spot(i, j, x, y, 224) * (50 + random.below(50)) / 100; };
              }));
    count_emd("EMD, dense",
              Pairs(20, [](Random& random) { return [&random](int, int) { return 5 + random.below(245); }; }));
}

void count_maps(const FrameView& frame) {
    for (const Feature feature :
         {Feature::chi2, Feature::hellinger, Feature::marginal, Feature::centroid, Feature::jacobian_frobenius}) {
        auto mapper = value_of(FeatureMapper::create(kField, 8, kLevels, feature));
        count(std::string(name_of(feature)).c_str(), "lenslet", static_cast<int>(kField.lenslets()),
              [&] { mapper.over_neighbours(frame); });
    }
    HordRow row(kField);
    count("HORD masses, sums and moments", "lenslet", static_cast<int>(kField.lenslets()), [&] {
        for (int n = 0; n < kField.n; ++n) decode_row(frame, kField, kLevels, n, row);
    });
    SoaRow sums(kField, SoaUse::sums, best_isa());
    count("HORD sums and moments alone", "lenslet", static_cast<int>(kField.lenslets()), [&] {
        for (int n = 0; n < kField.n; ++n) sums.decode(frame, kLevels, n);
    });
    std::vector<std::uint32_t> light(kField.lenslets()), scratch(light.size());
    std::vector<std::uint8_t> mask(light.size(), kValid);
    std::vector<float> transmission(light.size());
    Random random;
    for (auto& one : light) one = static_cast<std::uint32_t>(900 + random.below(64));
    count("transmission", "lenslet", static_cast<int>(light.size()),
          [&] { transmissions(light, mask, typical_light(light, mask, 0.2F, scratch), transmission); });
    SoaDistances rows(kField, Feature::emd, best_isa(), true);
    const SoaEmdBounds bounds(kField, best_isa());
    std::vector<float> upper(index(kField.m));
    rows.load(frame, kLevels, 0);
    rows.load(frame, kLevels, 1);
    rows.load(frame, kLevels, 2);
    rows.mark_row(1, mask.data());
    count("EMD bounds", "lenslet", kField.m, [&] { bounds.row(rows, 1, mask.data(), kNoGradient, upper.data()); });
}

void count_decode(bool hexagonal) {
    LensletGrid grid;
    grid.kind = hexagonal ? LatticeKind::hexagonal : LatticeKind::square;
    grid.stagger = hexagonal ? Stagger::rows : Stagger::none;
    grid.width_px = 512, grid.height_px = 128;
    const double pitch = hexagonal ? 9.4 * 1.0745699318235 : 9.4, turn = hexagonal ? 0.0523599 : 0.0004;
    grid.columns = hexagonal ? 60 : 52, grid.rows = hexagonal ? 18 : 12;
    grid.origin_u = 0.5 * (grid.columns - 1);
    grid.origin_v = 0.5 * (grid.rows - 1) * (hexagonal ? kHalfSqrt3 : 1);
    grid.model = GridModelKind::similarity;
    grid.parameters = {0.5 * grid.width_px, 0.5 * grid.height_px, pitch * std::cos(turn), pitch * std::sin(turn)};
    auto decoder = value_of(GridDecoder::create(grid, std::nullopt, kBins, kBins));
    Frame raw(grid.width_px, grid.height_px, 8), out = decoder.frame(8);
    Random random;
    for (std::byte& sample : raw.bytes()) sample = static_cast<std::byte>(random.below(256));
    count(hexagonal ? "decode, hexagonal lattice" : "decode, square lattice", "lenslet",
          static_cast<int>(decoder.extents().lenslets()), [&] { value_of(decoder.decode(raw.view())); });
}

// Even spots that move from lenslet to lenslet, and a part whose light differs from them by noise.
void count_comparison() {
    Reference r;
    r.extents = kField;
    r.bits = 12;
    r.levels = light_levels({}, r.bits);
    r.sensor = {2.5F, 1.5F, 3.0F};
    r.parts = 16;
    const std::size_t lenslets = kField.lenslets();
    r.shares.assign(lenslets * r.stride(), 0);
    r.light.assign(lenslets, 930);
    r.x.assign(lenslets, 0), r.y.assign(lenslets, 0), r.mask.assign(lenslets, kValid), r.emd.assign(lenslets, 0),
        r.frobenius.assign(lenslets, 0);
    for (auto& spread : r.spread) spread.assign(lenslets, 1e-4F);
    Frame frame(kField.width_px(), kField.height_px(), r.bits);
    Random random;
    std::vector<int> weight(kBinCount);
    for (int n = 0; n < kField.n; ++n) {
        for (int m = 0; m < kField.m; ++m) {
            int sum = 0;
            for (int b = 0; b < kBinCount; ++b)
                sum += weight[index(b)] = spot(b % kBins, b / kBins, 256 + m % 9 - 4, 256 + n % 7 - 3, 128);
            for (int b = 0; b < kBinCount; ++b) {
                const int share = weight[index(b)] * 32760 / sum;
                r.shares[index(n * kField.m + m) * r.stride() + r.place(b % kBins, b / kBins)] =
                    static_cast<std::uint16_t>(share);
                frame.set(m * kBins + b % kBins, n * kBins + b / kBins,
                          static_cast<std::uint32_t>(share * 930 / 32768 + random.below(6)) + r.levels.dark);
            }
        }
    }
    ReferenceComparer comparer(r);
    std::vector<HordRow> rows(index(kField.n), HordRow(kField));
    for (int n = 0; n < kField.n; ++n) decode_row(frame.view(), kField, r.levels, n, rows[index(n)]);
    std::vector<Difference> differences(index(kField.m));
    const PoseMap pose({0.4, -0.3, 1.0 / 128}, kField);
    count("comparison with a reference", "lenslet", static_cast<int>(lenslets), [&] {
        for (int n = 0; n < kField.n; ++n)
            comparer.compare_row(frame.view(), rows[index(n)].sums(), rows[index(n)].mask(), n, pose, 0.9,
                                 r.levels.dark, differences);
    });
}

}  // namespace

int main() {
    Random random;
    const Frame frame = smooth_frame(random);
    count_every_emd(frame.view());
    count_maps(frame.view());
    count_decode(false);
    count_decode(true);
    count_comparison();
}
