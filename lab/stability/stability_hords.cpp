// Pairs of HORDs at the extremes, under every distance; expected values are closed forms or long-double definitions.
#include <algorithm>
#include <array>
#include <cmath>
#include <numeric>
#include <random>

#include <fmt/format.h>

#include "algo/features/distance.h"
#include "algo/frame/extents.h"
#include "lab/experiment/transport_check.h"
#include "lab/stability/stability.h"

namespace hord::lab {
namespace {

using algo::Distance;
using algo::Feature;
using Random = std::mt19937_64;

constexpr int kMax = algo::kMaxBins;  // bins a side
constexpr std::uint16_t kFull = 65535;
constexpr double kExact =
    1e-9;  // the contract of every distance (algo/features/distance.h, algo/emd/emd_solver.h), per bin pitch of scale
constexpr double kInf = 1e300;

std::vector<Feature> distances() {
    std::vector<Feature> all;
    for (std::size_t k = 0; algo::is_distance(static_cast<Feature>(k)); ++k) all.push_back(static_cast<Feature>(k));
    return all;
}

std::string name(Feature feature) { return std::string(algo::name_of(feature)); }

algo::Hord hord(const Masses& h) { return {h.data(), std::accumulate(h.begin(), h.end(), std::uint32_t{0})}; }

struct Measure {
    Measure(Feature f, int i, int j, const Distance::Options& options = {})
        : distance(std::move(*Distance::create(f, i, j, options))) {}
    double operator()(const Masses& a, const Masses& b) { return distance(hord(a), hord(b)); }
    Distance distance;
};

// `mass` in bin (i, j), nothing elsewhere.
Masses spot(int bins_i, int bins_j, int i, int j, std::uint16_t mass) {
    Masses h(static_cast<std::size_t>(bins_i * bins_j));
    h[static_cast<std::size_t>(j * bins_i + i)] = mass;
    return h;
}

// The expected distance when all light moves by (x, y) bins and the supports are disjoint.
double of_moved_spot(Feature feature, double x, double y, int longer_side) {
    const double length = std::hypot(x, y);
    switch (feature) {
        case Feature::emd_l1: return std::abs(x) + std::abs(y);
        case Feature::emd_sq: return length * length;
        case Feature::sliced: {
            double sum = 0;
            const double pi = std::acos(-1.0);
            for (int k = 0; k < 8; ++k) sum += std::abs(x * std::cos(k * pi / 8) + y * std::sin(k * pi / 8));
            return std::sin(pi / 16) * sum;
        }
        case Feature::max_sliced: {
            double largest = 0;
            const double pi = std::acos(-1.0);
            for (int k = 0; k < 8; ++k)
                largest = std::max(largest, std::abs(x * std::cos(k * pi / 8) + y * std::sin(k * pi / 8)));
            return largest;
        }
        case Feature::cramer_von_mises: {  // E1(s) = -Ei(-s)
            const double width2 = longer_side * longer_side, s = length * length / (4 * width2), pi = std::acos(-1.0);
            return std::sqrt(pi * (width2 * (1 - std::exp(-s)) - length * length / 4 * std::expint(-s)));
        }
        case Feature::bhattacharyya: return 24 * std::log(2.0);
        case Feature::hellinger:
        case Feature::chi2: return 1;
        default: return length;  // emd, centroid, marginal
    }
}

Masses random_hord(Random& random, int bins, int lit, int most) {
    Masses h(static_cast<std::size_t>(bins));
    for (int k = 0; k < lit; ++k)
        h[random() % h.size()] = static_cast<std::uint16_t>(1 + random() % static_cast<unsigned>(most));
    return h;
}

// A random histogram: sparse, dense, one photon, full scale, or all bins equal.
Masses any_hord(Random& random, int bins) {
    switch (random() % 6) {
        case 0: return random_hord(random, bins, 1, 1);
        case 1: return random_hord(random, bins, 3, 2);
        case 2: return random_hord(random, bins, 7, 255);
        case 3: return random_hord(random, bins, bins, kFull);
        case 4: return Masses(static_cast<std::size_t>(bins), kFull);
        default: return random_hord(random, bins, bins / 2, 4095);
    }
}

void dark_hords(StabilityTable& table) {
    table.begin("all zero");
    const Masses dark(81), lit = spot(9, 9, 2, 7, 9);
    for (const Feature f : distances()) {
        Measure measure(f, 9, 9);
        table.near(name(f) + " of two dark HORDs, and of a dark and a lit one", 0,
                   std::abs(measure(dark, dark)) + std::abs(measure(dark, lit)) + std::abs(measure(lit, dark)), 0);
    }
}

void single_bins(StabilityTable& table) {
    for (const auto& [group, mass_a, mass_b] : {std::tuple("one photon", 1, 1), std::tuple("one bin", 1, 65535)}) {
        table.begin(group);
        for (const auto& [bins_i, bins_j, x, y] :
             {std::tuple(9, 9, 3, 4), std::tuple(15, 15, 14, 14), std::tuple(4, 3, 3, 0)}) {
            const Masses a = spot(bins_i, bins_j, 0, 0, static_cast<std::uint16_t>(mass_a)),
                         b = spot(bins_i, bins_j, x, y, static_cast<std::uint16_t>(mass_b));
            for (const Feature f : distances()) {
                Measure measure(f, bins_i, bins_j);
                const double right = of_moved_spot(f, x, y, std::max(bins_i, bins_j));
                table.near(fmt::format("{}: {} DN moved by ({}, {}) in {}x{} bins, now {} DN", name(f), mass_a, x, y,
                                       bins_i, bins_j, mass_b),
                           right, measure(a, b), kExact * std::max(1.0, right));
                table.near(fmt::format("{}: the same bin at {} and {} DN ({}x{} bins)", name(f), mass_a, mass_b, bins_i,
                                       bins_j),
                           0, measure(a, spot(bins_i, bins_j, 0, 0, static_cast<std::uint16_t>(mass_b))), kExact);
            }
        }
    }
    // One bin against all: every unit comes from the corner.
    const Masses corner = spot(9, 9, 0, 0, 1), all(81, kFull);
    double mean[3] = {};
    for (int k = 0; k < 81; ++k) {
        mean[0] += std::hypot(k % 9, k / 9) / 81;
        mean[1] += (k % 9 + k / 9) / 81.0;
        mean[2] += (k % 9 * (k % 9) + k / 9 * (k / 9)) / 81.0;
    }
    for (const auto& [f, right] :
         {std::pair(Feature::emd, mean[0]), std::pair(Feature::emd_l1, mean[1]), std::pair(Feature::emd_sq, mean[2])}) {
        table.near(name(f) + " of one photon in a corner against 81 full bins", right, Measure(f, 9, 9)(corner, all),
                   kExact * right);
    }
}

void saturated_hords(StabilityTable& table) {
    table.begin("all saturated");
    const Masses full(kMax * kMax, kFull), photon = spot(kMax, kMax, 7, 7, 1);
    const double shared = 1.0 / (kMax * kMax);
    for (const Feature f : distances()) {
        Measure measure(f, kMax, kMax);
        table.near(name(f) + " of two full HORDs, 15x15 bins at 16 bit", 0, measure(full, full), kExact);
        const double one_against_all = measure(full, photon);
        if (f == Feature::centroid)
            table.near("centroid of full against one photon in the centre", 0, one_against_all, kExact);
        if (f == Feature::hellinger)
            table.near("hellinger of full against one photon", std::sqrt(1 - std::sqrt(shared)), one_against_all,
                       kExact);
        if (f == Feature::bhattacharyya)
            table.near("bhattacharyya of full against one photon", -std::log(std::sqrt(shared)), one_against_all,
                       kExact);
        if (f == Feature::chi2) {
            const double right = ((1 - shared) * (1 - shared) / (1 + shared) + (1 - shared)) / 2;
            table.near("chi2 of full against one photon", right, one_against_all, kExact);
        }
    }
}

void disjoint_and_equal(const StabilityOptions& options, StabilityTable& table) {
    table.begin("disjoint supports");
    Masses left(kMax * kMax), right(kMax * kMax);  // 7 full columns each, 8 apart
    for (std::size_t k = 0; k < left.size(); ++k) {
        left[k] = k % kMax < 7 ? kFull : std::uint16_t{0};
        right[k] = k % kMax >= 8 ? kFull : std::uint16_t{0};
    }
    for (const Feature f : distances()) {
        Measure measure(f, kMax, kMax);
        if (f == Feature::cramer_von_mises) continue;  // its closed form is of spots
        const double expected = of_moved_spot(f, 8, 0, kMax);
        // The sliced distance of two blocks moved along x: every projection moves by its part of 8.
        table.near(name(f) + ": seven full columns moved by 8 bins", expected, measure(left, right),
                   kExact * std::max(1.0, expected));
        table.same(name(f) + ": results flagged as a limit", f == Feature::bhattacharyya ? 1 : 0,
                   static_cast<std::int64_t>(measure.distance.saturated()));
    }

    table.begin("equal histograms");
    Random random(options.seed);
    for (const Feature f : distances()) {
        double worst = 0;
        Measure measure(f, 9, 9);
        for (int n = 0; n < options.random_pairs; ++n) {
            const Masses h = any_hord(random, 81);
            worst = std::max(worst, std::abs(measure(h, h)));
        }
        table.at_most(fmt::format("{} of {} random HORDs with themselves", name(f), options.random_pairs), kExact,
                      worst);
    }
}

// The definitions in long double, for pairs without a simple closed form.
struct Definition {
    long double hellinger = 0, chi2 = 0, overlap = 0, x = 0, y = 0;
    Definition(const Masses& a, const Masses& b, int bins_i) {
        const long double sum_a = hord(a).sum, sum_b = hord(b).sum;
        long double squares = 0;
        for (std::size_t k = 0; k < a.size(); ++k) {
            const long double h = a[k] / sum_a, g = b[k] / sum_b;
            const long double difference = (a[k] * sum_b - b[k] * sum_a) / (sum_a * sum_b);
            const long double root = h + g > 0 ? difference / (std::sqrt(h) + std::sqrt(g)) : 0;
            squares += root * root / 2;
            chi2 += h + g > 0 ? difference * difference / (h + g) / 2 : 0;
            overlap += std::sqrt(h * g);
            x += difference * static_cast<long double>(k % static_cast<std::size_t>(bins_i));
            y += difference * static_cast<long double>(k / static_cast<std::size_t>(bins_i));
        }
        hellinger = std::sqrt(squares);
    }
};

void smallest_differences(StabilityTable& table) {
    const auto by_definition = [&](const std::string& what, const Masses& a, const Masses& b, int bins_i,
                                   double tolerance) {
        const Definition right(a, b, bins_i);
        const int bins_j = static_cast<int>(a.size()) / bins_i;
        table.near("hellinger: " + what, static_cast<double>(right.hellinger),
                   Measure(Feature::hellinger, bins_i, bins_j)(a, b), tolerance);
        table.near("chi2: " + what, static_cast<double>(right.chi2), Measure(Feature::chi2, bins_i, bins_j)(a, b),
                   tolerance);
        table.near("bhattacharyya: " + what, static_cast<double>(-std::log(right.overlap)),
                   Measure(Feature::bhattacharyya, bins_i, bins_j)(a, b), tolerance);
        table.near("centroid: " + what, static_cast<double>(std::hypot(right.x, right.y)),
                   Measure(Feature::centroid, bins_i, bins_j)(a, b), tolerance);
    };

    table.begin("1 DN differences at 16 bit");
    Masses one_less(kMax * kMax, kFull), another(kMax * kMax, kFull);
    one_less.front() = another.back() = kFull - 1;
    const double sum = 225.0 * kFull - 1, far = 14 * std::sqrt(2.0);
    table.near("emd: full HORDs, 1 DN less in opposite corners", far / sum,
               Measure(Feature::emd, kMax, kMax)(one_less, another), kExact * far / sum);
    table.near("emd-l1: the same", 28 / sum, Measure(Feature::emd_l1, kMax, kMax)(one_less, another),
               kExact * 28 / sum);
    // Squared costs: 1 DN goes from corner to corner in 14 diagonal steps of one unit each, 2 a step.
    table.near("emd-sq: the same, moved step by step", 28 / sum,
               Measure(Feature::emd_sq, kMax, kMax)(one_less, another), 1e-9);
    table.near("marginal: the same", far / sum, Measure(Feature::marginal, kMax, kMax)(one_less, another),
               kExact * far / sum);
    by_definition("the same", one_less, another, kMax, 1e-9);

    table.begin("sums at the type's limit");
    Masses half(kMax * kMax),
        other(kMax * kMax);  // every other bin full, with 15x14 bins: as many of either colour
    half.resize(15 * 14);
    other.resize(15 * 14);
    for (std::size_t k = 0; k < half.size(); ++k) (((k % 15) + (k / 15)) % 2 == 0 ? half : other)[k] = kFull;
    table.same("sum of 15x15 bins at 65535", 14745375, hord(Masses(kMax * kMax, kFull)).sum);
    table.near("emd of a full chequerboard and its negative, 15x14 bins", 1, Measure(Feature::emd, 15, 14)(half, other),
               kExact);
    table.near("emd-l1 of the same", 1, Measure(Feature::emd_l1, 15, 14)(half, other), kExact);
    table.near("emd-sq of the same", 1, Measure(Feature::emd_sq, 15, 14)(half, other), kExact);
    by_definition(
        "full against full but one dark bin", Masses(kMax * kMax, kFull),
        [] {
            Masses h(kMax * kMax, kFull);
            h[0] = 0;
            return h;
        }(),
        kMax, 1e-9);

    table.begin("masses differing by 1");
    for (const int k : {1, 255, 4095, 65534}) {
        const auto low = static_cast<std::uint16_t>(k), high = static_cast<std::uint16_t>(k + 1);
        Masses a = spot(9, 9, 1, 1, high), b = spot(9, 9, 1, 1, low);
        a[7 * 9 + 4] = low;
        b[7 * 9 + 4] = high;
        const double right = std::hypot(3, 6) / (2.0 * k + 1);
        table.near(fmt::format("emd of {{{}, {}}} and {{{}, {}}}, (3, 6) bins apart", k + 1, k, k, k + 1), right,
                   Measure(Feature::emd, 9, 9)(a, b), kExact * right);
        by_definition(fmt::format("the same at {}", k), a, b, 9, 1e-9);
    }
}

void collinear(const StabilityOptions& options, StabilityTable& table) {
    table.begin("collinear supports");
    Random random(options.seed + 1);
    // Along a row, a column, a diagonal: the distance is that of the cumulative sums.
    for (const auto& [what, first, step, pitch] :
         {std::tuple("a row", 3 * 9, 1, 1.0), std::tuple("a column", 5, 9, 1.0),
          std::tuple("the diagonal", 0, 10, std::sqrt(2.0))}) {
        double worst = 0;
        Measure measure(Feature::emd, 9, 9);
        for (int n = 0; n < options.random_pairs; ++n) {
            Masses a(81), b(81);
            for (int k = 0; k < 9; ++k) {
                const auto bin = static_cast<std::size_t>(first + k * step);
                a[bin] = static_cast<std::uint16_t>(random() % 3 == 0 ? random() % 65536 : random() % 2);
                b[bin] = static_cast<std::uint16_t>(random() % 3 == 0 ? random() % 65536 : random() % 2);
            }
            if (hord(a).sum == 0 || hord(b).sum == 0) continue;
            double passed = 0, right = 0;
            for (int k = 0; k < 9; ++k) {
                const auto bin = static_cast<std::size_t>(first + k * step);
                passed += static_cast<double>(a[bin]) / hord(a).sum - static_cast<double>(b[bin]) / hord(b).sum;
                right += std::abs(passed) * pitch;
            }
            worst = std::max(worst, std::abs(measure(a, b) - right));
        }
        table.at_most(fmt::format("emd along {}: worst difference from the cumulative sums, {} pairs", what,
                                  options.random_pairs),
                      kExact, worst);
    }
}

void properties(const StabilityOptions& options, StabilityTable& table) {
    table.begin("identity, symmetry, triangle, bounds");
    Random random(options.seed + 2);
    const std::vector<Feature> all = distances();
    std::vector<Measure> measures;
    for (const Feature f : all) measures.emplace_back(f, 9, 9);
    // chi2 and emd-sq are squares of metrics; bhattacharyya is none.
    const auto as_metric = [](Feature f, double d) {
        return f == Feature::chi2 || f == Feature::emd_sq ? std::sqrt(std::max(0.0, d)) : d;
    };
    std::vector<double> asymmetry(all.size()), triangle(all.size(), -kInf), exposure(all.size()), turned(all.size());
    double means = -kInf, marginal = -kInf, sliced = -kInf;
    std::int64_t unreal = 0;
    for (int n = 0; n < options.random_pairs; ++n) {
        const Masses a = any_hord(random, 81), b = any_hord(random, 81), c = any_hord(random, 81);
        Masses dim = a, bright, at(81), bt(81), am(81), bm(81);
        for (auto& mass : dim) mass = static_cast<std::uint16_t>(mass / 16 * 4);  // also a quarter as bright
        Masses quarter = dim, four = dim;
        for (std::size_t k = 0; k < 81; ++k) {
            quarter[k] = static_cast<std::uint16_t>(dim[k] / 4);
            four[k] = static_cast<std::uint16_t>(dim[k] * 4);
            at[k % 9 * 9 + k / 9] = a[k], bt[k % 9 * 9 + k / 9] = b[k];
            am[k / 9 * 9 + 8 - k % 9] = a[k], bm[k / 9 * 9 + 8 - k % 9] = b[k];
        }
        std::vector<double> ab(all.size());
        for (std::size_t k = 0; k < all.size(); ++k) {
            ab[k] = measures[k](a, b);
            const double ac = measures[k](a, c), cb = measures[k](c, b);
            unreal += std::isfinite(ab[k]) && ab[k] >= 0 ? 0 : 1;
            asymmetry[k] = std::max(asymmetry[k], std::abs(ab[k] - measures[k](b, a)));
            triangle[k] =
                std::max(triangle[k], as_metric(all[k], ab[k]) - as_metric(all[k], ac) - as_metric(all[k], cb));
            if (hord(dim).sum > 0) {
                const double d = measures[k](dim, b);
                exposure[k] =
                    std::max({exposure[k], std::abs(measures[k](quarter, b) - d), std::abs(measures[k](four, b) - d)});
            }
            turned[k] =
                std::max({turned[k], std::abs(measures[k](at, bt) - ab[k]), std::abs(measures[k](am, bm) - ab[k])});
        }
        const auto of = [&](Feature f) { return ab[static_cast<std::size_t>(f)]; };
        means = std::max(means, of(Feature::centroid) - of(Feature::emd));
        marginal = std::max(marginal, of(Feature::marginal) - of(Feature::emd));
        sliced = std::max(sliced, of(Feature::sliced) - of(Feature::emd));
    }
    const std::string count = fmt::format(", {} random pairs", options.random_pairs);
    table.same("distances that are negative, NaN or infinite, of all features" + count, 0, unreal);
    for (std::size_t k = 0; k < all.size(); ++k) {
        const double scale = all[k] == Feature::emd_sq ? 128 : 12;
        table.at_most(name(all[k]) + ": |d(a, b) - d(b, a)|" + count, 0, asymmetry[k]);
        if (all[k] != Feature::bhattacharyya) {
            // At zero, an error of 1e-9 in a square is an error of up to 3.2e-5 in its root.
            const bool is_square = as_metric(all[k], 4) == 2;
            table.at_most((is_square ? "root of " : "") + name(all[k]) + ": d(a, b) - d(a, c) - d(c, b)" + count,
                          is_square ? std::sqrt(kExact * scale) : kExact, triangle[k]);
        }
    }
    table.at_most("distance of means - emd" + count, kExact, means);
    table.at_most("marginal - emd" + count, kExact, marginal);
    table.at_most("sliced - emd" + count, kExact, sliced);
    table.begin("invariance to exposure, transposition, mirroring");
    for (std::size_t k = 0; k < all.size(); ++k) {
        const double scale = all[k] == Feature::emd_sq ? 128 : 12;
        table.at_most(name(all[k]) + ": change when one HORD gets 1/4 or 4 times the light" + count, kExact * scale,
                      exposure[k]);
        table.at_most(name(all[k]) + ": change when both are transposed or mirrored" + count, kExact * scale,
                      turned[k]);
    }
}

}  // namespace

void check_hords(const StabilityOptions& options, StabilityTable& table) {
    dark_hords(table);
    single_bins(table);
    saturated_hords(table);
    disjoint_and_equal(options, table);
    smallest_differences(table);
    collinear(options, table);
    properties(options, table);
}

}  // namespace hord::lab
