// Whole frames at the extremes: the pipeline's maps and masks.
#include <algorithm>
#include <cmath>
#include <random>

#include <fmt/format.h>

#include "algo/features/distance.h"
#include "algo/features/jacobian.h"
#include "algo/inspection/pipeline.h"
#include "lab/stability/stability.h"

namespace hord::lab {
namespace {

using algo::Extents;
using algo::Pipeline;
using algo::Recipe;

constexpr double kMap = 1e-5;  // maps are floats: 2^-24 of values up to 20, plus the error of their doubles

// Light falls off linearly over 2 bins around a place, measured from the centre of the bins: the mean of its samples is
// that place.
double tent(int k, int bins, double at) { return std::max(0.0, 1 - std::abs(k - (bins - 1) / 2.0 - at) / 2); }

struct Spot {
    double x = 0, y = 0, light = 1;
};

template <class Where>
Frame drawn(const Extents& e, int bits, double full_dn, Where spot_at, double pedestal_dn = 0) {
    Frame frame(e.width_px(), e.height_px(), bits);
    for (int y = 0; y < e.height_px(); ++y) {
        for (int x = 0; x < e.width_px(); ++x) {
            const Spot s = spot_at(x / e.i, y / e.j);
            const double light = s.light * tent(x % e.i, e.i, s.x) * tent(y % e.j, e.j, s.y);
            frame.set(x, y, static_cast<std::uint32_t>(std::lround(full_dn * light) + std::lround(pedestal_dn)));
        }
    }
    return frame;
}

Frame noise(const Extents& e, int bits, std::uint64_t seed) {
    std::mt19937_64 random(seed);
    Frame frame(e.width_px(), e.height_px(), bits);
    for (int y = 0; y < e.height_px(); ++y) {
        for (int x = 0; x < e.width_px(); ++x) {
            const auto drawn_dn = static_cast<std::uint32_t>(random() % (1U << bits));
            frame.set(x, y, (x / e.i + y / e.j) % 5 == 0 ? 0 : drawn_dn >> (random() % static_cast<unsigned>(bits)));
        }
    }
    return frame;
}

Frame transposed(const Frame& frame) {
    Frame result(frame.height_px(), frame.width_px(), frame.bits());
    for (int y = 0; y < frame.height_px(); ++y) {
        for (int x = 0; x < frame.width_px(); ++x) result.set(y, x, frame.view().sample(x, y));
    }
    return result;
}

Frame mirrored(const Frame& frame) {
    Frame result(frame.width_px(), frame.height_px(), frame.bits());
    for (int y = 0; y < frame.height_px(); ++y) {
        for (int x = 0; x < frame.width_px(); ++x) result.set(frame.width_px() - 1 - x, y, frame.view().sample(x, y));
    }
    return result;
}

// A copy of an inspection.
struct Seen {
    algo::Verdict verdict = algo::Verdict::pass;
    algo::Reason reason = algo::Reason::none;
    std::vector<float> emd, frobenius, transmission, spectral, nuclear, anisotropy;
    std::vector<std::uint8_t> mask;
    std::int64_t unreal = 0;  // NaN, infinite or negative values

    [[nodiscard]] std::int64_t count(std::uint8_t bits) const {
        return std::ranges::count_if(mask, [&](std::uint8_t m) { return (m & bits) == bits; });
    }
};

Seen inspected(const Extents& e, const Frame& frame, const Recipe& recipe = {}) {
    Seen seen;
    auto pipeline = Pipeline::create(e, frame.bits(), recipe, 1, algo::MapSet::all);
    if (!pipeline) return seen;
    const auto found = pipeline->inspect(frame.view());
    if (!found) return seen;
    seen.verdict = found->verdict;
    seen.reason = found->reason;
    seen.mask.assign(found->mask.begin(), found->mask.end());
    const auto copy = [&](algo::Map map, std::vector<float>& to) {
        to.assign(map.begin(), map.end());
        seen.unreal += std::ranges::count_if(to, [](float v) { return !(std::isfinite(v) && v >= 0); });
    };
    copy(found->emd, seen.emd);
    copy(found->frobenius, seen.frobenius);
    copy(found->transmission, seen.transmission);
    copy(found->spectral, seen.spectral);
    copy(found->nuclear, seen.nuclear);
    copy(found->anisotropy, seen.anisotropy);
    return seen;
}

// Deflection grows by a quarter of a bin a lenslet to the right, and half of that downwards.
Spot ramp(int m, int n) { return {0.25 * (m - 6), 0.125 * (n - 6), 1}; }

void unfit_frames(StabilityTable& table) {
    const Extents e{12, 10, 9, 9};
    const auto total = static_cast<std::int64_t>(e.lenslets());
    table.begin("all zero");
    const Seen dark = inspected(e, Frame(e.width_px(), e.height_px(), 8));
    table.holds("frame", "unfit: too-dark", fmt::format("{}: {}", name_of(dark.verdict), name_of(dark.reason)),
                dark.verdict == algo::Verdict::unfit && dark.reason == algo::Reason::too_dark);
    table.same("lenslets flagged dark", total, dark.count(algo::kDark));
    table.same("values that are NaN, infinite or negative", 0, dark.unreal);

    table.begin("one photon");
    Frame photon(e.width_px(), e.height_px(), 16);
    photon.set(5 * 9 + 4, 5 * 9 + 4, 1);
    Recipe sensitive;
    sensitive.dark_dn = 0;
    const Seen single = inspected(e, photon, sensitive);
    table.same("a frame with a single DN: lenslets flagged dark", total, single.count(algo::kDark));
    table.same("values that are NaN, infinite or negative", 0, single.unreal);

    table.begin("all saturated");
    for (const int bits : {8, 10, 12, 16}) {
        const Seen full = inspected(e, drawn(e, bits, 0, ramp, (1 << bits) - 1));
        table.holds(fmt::format("frame at {} bit", bits), "unfit: saturated",
                    fmt::format("{}: {}", name_of(full.verdict), name_of(full.reason)),
                    full.verdict == algo::Verdict::unfit && full.reason == algo::Reason::saturated);
        table.same(fmt::format("lenslets flagged saturated at {} bit", bits), total, full.count(algo::kSaturated));
        table.same(fmt::format("values that are NaN, infinite or negative at {} bit", bits), 0, full.unreal);
    }
    Frame hot = drawn(e, 8, 240, ramp);
    hot.set(6 * 9 + 1, 5 * 9 + 1, 255);
    const Seen one_hot = inspected(e, hot);
    table.same("one sample at full scale: lenslets flagged saturated", 1, one_hot.count(algo::kSaturated));
    table.near("and no gradient there", 0, one_hot.emd[5 * 12 + 6] + one_hot.frobenius[5 * 12 + 6], 0);
}

void thin_fields(StabilityTable& table) {
    table.begin("one lenslet row");
    for (const Extents& e : {Extents{64, 1, 9, 9}, Extents{1, 64, 9, 9}, Extents{64, 2, 9, 9}}) {
        const auto refused = Pipeline::create(e, 8, {});
        table.holds(fmt::format("a field of {}x{} lenslets has no neighbours on both sides", e.m, e.n),
                    "refused, with a cure", refused ? "accepted" : refused.error().message(),
                    !refused && !refused.error().cure.empty());
    }
    // The thinnest frame: one row with neighbours above and below, of the largest width.
    for (const Extents& e : {Extents{2048, 3, 3, 3}, Extents{3, 2048, 3, 3}}) {
        const auto flat = [](int, int) { return Spot{}; };
        const Seen seen = inspected(e, drawn(e, 8, 200, flat));
        table.same(fmt::format("{}x{} lenslets: gradients not at the border", e.m, e.n), 2046,
                   static_cast<std::int64_t>(e.lenslets()) - seen.count(algo::kBorder));
        table.near("largest gradient of equal lenslets", 0, *std::ranges::max_element(seen.emd), 0);
    }
    // Light in one row only: no neighbours above and below.
    const Extents e{13, 9, 9, 9};
    const Seen row = inspected(e, drawn(e, 8, 240, [](int m, int n) { return n == 4 ? ramp(m, n) : Spot{0, 0, 0}; }));
    table.same("one lit row: lit lenslets, all flagged as border", 13,
               row.count(algo::kBorder) - row.count(algo::kBorder | algo::kDark));
    table.near("largest gradient", 0, *std::ranges::max_element(row.emd), 0);
    table.same("values that are NaN, infinite or negative", 0, row.unreal);
}

void dark_neighbours(StabilityTable& table) {
    table.begin("dark neighbours");
    const Extents e{13, 13, 9, 9};
    const std::size_t middle = 6 * 13 + 6, right = middle + 1, below = middle + 13;
    // The spot moves along one axis between two neighbours: their EMD is the distance of the means. Rounding to whole
    // DN moves a mean of nine lit bins by at most 0.01 bin.
    const double full = 4000, rounding = 0.01;
    Recipe recipe;
    recipe.dark_dn = 1;
    const auto with_hole = [&](bool dark) {
        Frame frame = drawn(e, 12, full, ramp);
        if (dark) {
            for (int k = 0; k < 81; ++k) frame.set(6 * 9 + k % 9, 6 * 9 + k / 9, 0);
        } else {
            frame.set(6 * 9 + 4, 6 * 9 + 4, 4095);
        }
        return inspected(e, frame, recipe);
    };
    for (const bool dark : {true, false}) {
        const char* what = dark ? "dark" : "saturated";
        const Seen hole = with_hole(dark);
        table.same(fmt::format("lenslets flagged {}", what), 1, hole.count(dark ? algo::kDark : algo::kSaturated));
        table.near(fmt::format("no gradient at the {} lenslet", what), 0, hole.emd[middle] + hole.frobenius[middle], 0);
        for (const std::size_t k : {right, below}) {
            const char* where = k == right ? "right of" : "below";
            table.near(fmt::format("Frobenius norm {} the {} lenslet: that of the smooth field", where,
                                   dark ? "dark" : "saturated"),
                       std::hypot(0.25, 0.125), hole.frobenius[k], rounding);
            table.near(fmt::format("EMD gradient {} the {} lenslet: that of the smooth field", where,
                                   dark ? "dark" : "saturated"),
                       2 * std::hypot(0.25, 0.125), hole.emd[k], rounding);
        }
        table.same("values that are NaN, infinite or negative", 0, hole.unreal);
    }
    const Seen alone = inspected(e,
                                 drawn(e, 12, full,
                                       [](int m, int n) {
                                           return (m + n) % 2 == 0 ? ramp(m, n) : Spot{0, 0, 0};
                                       }),
                                 recipe);
    table.same("every other lenslet dark: lit ones without any neighbour flagged as border", 85,
               alone.count(algo::kBorder) - alone.count(algo::kBorder | algo::kDark));
    table.same("values that are NaN, infinite or negative", 0, alone.unreal);
}

void pedestals(StabilityTable& table) {
    table.begin("pedestals");
    const Extents e{14, 12, 9, 9};
    Recipe none, subtracted;
    none.dark_dn = 1;
    subtracted.dark_dn = 701;
    none.min_sum_dn = subtracted.min_sum_dn = 16;
    const Seen clean = inspected(e, drawn(e, 16, 40000, ramp), none),
               raised = inspected(e, drawn(e, 16, 40000, ramp, 700), subtracted);
    table.same("700 DN under every sample, subtracted: maps of the EMD gradient that differ", 0,
               clean.emd == raised.emd ? 0 : 1);
    table.same("maps of the Frobenius norm that differ", 0, clean.frobenius == raised.frobenius ? 0 : 1);
    // A dark level that is not subtracted shifts the mean: 1 DN in each of 81 bins beside 1000 DN, 3 bins off the
    // centre.
    const auto moved = [](double pedestal, int x) {
        algo::Hord h;
        static std::vector<std::uint16_t> masses[2];
        auto& mass = masses[x == 0 ? 0 : 1];
        mass.assign(81, static_cast<std::uint16_t>(pedestal));
        mass[static_cast<std::size_t>(4 * 9 + 4 + x)] =
            static_cast<std::uint16_t>(mass[static_cast<std::size_t>(4 * 9 + 4 + x)] + 1000);
        h.mass = mass.data();
        h.sum = static_cast<std::uint32_t>(1000 + 81 * pedestal);
        return h;
    };
    auto mean = std::move(*algo::Distance::create(algo::Feature::centroid, 9, 9));
    auto emd = std::move(*algo::Distance::create(algo::Feature::emd, 9, 9));
    table.near("1 DN not subtracted shrinks a deflection of 3 bins to 3000 / 1081", 3000.0 / 1081,
               mean(moved(1, 0), moved(1, 3)), 1e-9);
    table.near("and the EMD alike", 3000.0 / 1081, emd(moved(1, 0), moved(1, 3)), 1e-9);
    table.near("subtracted it is 3", 3, emd(moved(0, 0), moved(0, 3)), 1e-9);
}

void invariances(StabilityTable& table) {
    table.begin("invariance to exposure, transposition, mirroring");
    const Extents e{17, 14, 9, 8};
    const auto scene = [](int m, int n) { return m == 9 && n == 5 ? Spot{-1.5, 1, 0.4} : ramp(m, n); };
    Recipe recipe;
    recipe.dark_dn = 1;
    recipe.min_sum_dn = 16;
    // Samples are multiples of 16, so that every exposure is exact; the dark level of 1 DN is added, and
    // subtracted again.
    const auto exposed = [&](double times) {
        Frame frame = drawn(e, 16, 900, scene);
        for (int y = 0; y < e.height_px(); ++y) {
            for (int x = 0; x < e.width_px(); ++x)
                frame.set(x, y, 1 + static_cast<std::uint32_t>(frame.view().sample(x, y) * 16 * times));
        }
        return inspected(e, frame, recipe);
    };
    const Seen nominal = exposed(1);
    const auto worst = [](const std::vector<float>& a, const std::vector<float>& b) {
        double most = a.size() == b.size() ? 0 : 1e9;
        for (std::size_t k = 0; k < std::min(a.size(), b.size()); ++k)
            most = std::max(most, std::abs(static_cast<double>(a[k]) - b[k]));
        return most;
    };
    for (const double times : {0.25, 0.5, 2.0, 4.0}) {
        const Seen other = exposed(times);
        table.at_most(fmt::format("light x{}: change of the EMD gradient", times), kMap, worst(nominal.emd, other.emd));
        table.at_most(fmt::format("light x{}: change of the Frobenius norm", times), kMap,
                      worst(nominal.frobenius, other.frobenius));
        table.at_most(fmt::format("light x{}: change of the nuclear norm", times), kMap,
                      worst(nominal.nuclear, other.nuclear));
        table.at_most(fmt::format("light x{}: change of the transmission", times), kMap,
                      worst(nominal.transmission, other.transmission));
        table.same(fmt::format("light x{}: masks that differ", times), 0, nominal.mask == other.mask ? 0 : 1);
    }
    const Frame frame = drawn(e, 12, 3900, scene);
    const Seen straight = inspected(e, frame);
    for (const bool turn : {true, false}) {
        const Extents f = turn ? Extents{e.n, e.m, e.j, e.i} : e;
        const Seen other = inspected(f, turn ? transposed(frame) : mirrored(frame));
        const auto back = [&](const std::vector<float>& map) {
            std::vector<float> result(map.size());
            for (int n = 0; n < e.n; ++n) {
                for (int m = 0; m < e.m; ++m) {
                    result[static_cast<std::size_t>(n * e.m + m)] =
                        map[static_cast<std::size_t>(turn ? m * e.n + n : n * e.m + e.m - 1 - m)];
                }
            }
            return result;
        };
        const char* what = turn ? "transposed" : "mirrored";
        table.at_most(fmt::format("{}: change of the EMD gradient", what), kMap, worst(straight.emd, back(other.emd)));
        for (const auto& [name, map] :
             {std::pair("Frobenius norm", &Seen::frobenius), std::pair("spectral norm", &Seen::spectral),
              std::pair("nuclear norm", &Seen::nuclear), std::pair("anisotropy", &Seen::anisotropy),
              std::pair("transmission", &Seen::transmission)}) {
            table.at_most(fmt::format("{}: change of the {}", what, name), 0, worst(straight.*map, back(other.*map)));
        }
    }
}

void jacobians(StabilityTable& table) {
    table.begin("singular, zero, huge, nearly rank-one Jacobians");
    const double bound = std::ldexp(1.0, -12);  // bin, the contract; algo/features/jacobian.h derives 2^-21
    const auto check = [&](const std::string& what, double a, double b, double c, double d) {
        const auto q = [](double value) { return algo::SlopeQ::from_raw(std::lround(std::ldexp(value, 25))); };
        const algo::Jacobian j{q(a), q(b), q(c), q(d)};
        // Singular values of a 2x2 matrix, by its Frobenius norm and determinant, in long double.
        const long double squares = static_cast<long double>(a) * a + static_cast<long double>(b) * b +
            static_cast<long double>(c) * c + static_cast<long double>(d) * d;
        const long double det = std::abs(static_cast<long double>(a) * d - static_cast<long double>(b) * c);
        const auto nuclear = static_cast<double>(std::sqrt(squares + 2 * det)),
                   gap = static_cast<double>(std::sqrt(std::max(0.0L, squares - 2 * det)));
        const algo::SingularNorms norms = algo::singular_norms(j);
        table.near(what + ": Frobenius", static_cast<double>(std::sqrt(squares)),
                   algo::frobenius_norm(j).to_double_rounded(), bound);
        table.near(what + ": nuclear", nuclear, norms.nuclear.to_double_rounded(), bound);
        table.near(what + ": spectral", (nuclear + gap) / 2, norms.spectral.to_double_rounded(), bound);
        const double right = nuclear > 0 ? gap / nuclear : 0;
        table.near(what + ": anisotropy", right, norms.anisotropy.to_double_rounded(),
                   nuclear > 0 ? std::ldexp(1.0, -20) / nuclear + std::ldexp(1.0, -23) : 0);
    };
    check("zero", 0, 0, 0, 0);
    check("singular", 3, 4, 1.5, 2);
    check("one entry", 0, 0, -7, 0);
    check("huge: +-14 a lenslet", 14, 14, 14, -14);
    check("huge and singular", 14, 14, 14, 14);
    check("huge rotation", 0, -14, 14, 0);
    check("nearly rank one", 3, 4, 1.5, 2 + std::ldexp(1.0, -25));
    check("nearly rank one, huge", 14, 14, 14, 14 - std::ldexp(1.0, -20));
    check("the smallest entry", std::ldexp(1.0, -25), 0, 0, 0);
    check("huge beside the smallest", 14, 0, 0, std::ldexp(1.0, -25));
}

void anything(const StabilityOptions& options, StabilityTable& table) {
    table.begin("no NaN, no infinity, whatever the frame");
    std::uint64_t seed = options.seed;
    for (const Extents& e : {Extents{3, 3, 3, 3}, Extents{5, 4, 15, 15}, Extents{11, 7, 3, 15}, Extents{8, 9, 10, 4},
                             Extents{40, 31, 9, 9}}) {
        for (const int bits : {8, 10, 12, 16}) {
            Recipe recipe;
            recipe.dark_dn = 1;
            recipe.min_sum_dn = 1;
            const Seen seen = inspected(e, noise(e, bits, seed++), recipe);
            table.same(fmt::format("noise of every level, {}x{} lenslets of {}x{} bins at {} bit: values that are none",
                                   e.m, e.n, e.i, e.j, bits),
                       0, seen.emd.size() == e.lenslets() ? seen.unreal : -1);
        }
    }
}

}  // namespace

void check_frames(const StabilityOptions& options, StabilityTable& table) {
    unfit_frames(table);
    thin_fields(table);
    dark_neighbours(table);
    pedestals(table);
    invariances(table);
    jacobians(table);
    anything(options, table);
}

}  // namespace hord::lab
