// Highway against algo/simd on two kernels: the same bits, and the ratio of times, pair by pair (docs/adr/0011).
#include <algorithm>
#include <bit>
#include <chrono>
#include <cstdint>
#include <cstdio>
#include <random>
#include <vector>

#include <hwy/targets.h>

#include "tests/bench/highway/kernels.h"

namespace {

using namespace hord::bench;
using hord::algo::Isa;

constexpr int kCalls = 20'000, kRepetitions = 31, kRows = 60;
constexpr std::size_t kStride = 560, kShifts = 500;

template <class Call>
double ns_a_call(const Call& call) {
    const auto start = std::chrono::steady_clock::now();
    for (std::size_t k = 0; k < kCalls; ++k) call(k % kShifts);
    return std::chrono::duration<double, std::nano>(std::chrono::steady_clock::now() - start).count() / kCalls;
}

struct Inputs {
    std::vector<float> a = std::vector<float>(81 * kStride + 64), b = a, cost = std::vector<float>(kRows * kLanes);
    Lit lit{};
    Inputs() {
        std::mt19937 random(1);
        std::uniform_real_distribution<float> share(0, 1);
        for (auto* values : {&a, &b, &cost}) std::ranges::generate(*values, [&] { return share(random); });
        for (int k = 30; k < 52; ++k) lit[static_cast<std::size_t>(k / 64)] |= 1ULL << (k % 64);
    }
};

int different_results(const Inputs& in, Isa isa) {
    const auto bits = [](float value) { return std::bit_cast<std::uint32_t>(value); };
    int different = 0;
    for (std::size_t k = 0; k < kShifts; ++k) {
        float x[kLanes], y[kLanes], least = 0, also_least = 0;
        ours_chi2(&in.a[k], &in.b[k], kStride, in.lit, x, isa);
        highway_chi2(&in.a[k], &in.b[k], kStride, in.lit, y);
        different += std::ranges::equal(x, y, {}, bits, bits) ? 0 : 1;
        const int here = ours_cheapest(in.cost.data(), &in.a[k], in.a[k], kRows, &least, isa);
        const int there = highway_cheapest(in.cost.data(), &in.a[k], in.a[k], kRows, &also_least);
        different += here != there || least != also_least ? 1 : 0;
    }
    return different;
}

}  // namespace

int main() {
    const Inputs in;
    struct Target {
        Isa isa;
        std::int64_t highway;
        const char* name;
    };
    // The lowest x86 target of Highway 1.0.3 is SSSE3; it has none for plain SSE2.
    for (const auto& [isa, highway, name] :
         {Target{Isa::portable, HWY_SSSE3, "SSE2, Highway with SSSE3"}, Target{Isa::avx2, HWY_AVX2, "AVX2"},
          Target{Isa::avx512, HWY_AVX3, "AVX-512"}}) {
        if (!hord::algo::has(isa)) {
            std::printf("%s: this processor has none\n", name);
            continue;
        }
        choose_highway_target(highway);
        float out[kLanes], least = 0;
        std::vector<double> chi2, cheapest;
        for (int repetition = 0; repetition < kRepetitions; ++repetition) {
            const double ours =
                ns_a_call([&, isa = isa](std::size_t k) { ours_chi2(&in.a[k], &in.b[k], kStride, in.lit, out, isa); });
            chi2.push_back(ns_a_call([&](std::size_t k) { highway_chi2(&in.a[k], &in.b[k], kStride, in.lit, out); }) /
                           ours);
            const double also_ours = ns_a_call(
                [&, isa = isa](std::size_t k) { ours_cheapest(in.cost.data(), &in.a[k], 0.5F, kRows, &least, isa); });
            cheapest.push_back(
                ns_a_call([&](std::size_t k) { highway_cheapest(in.cost.data(), &in.a[k], 0.5F, kRows, &least); }) /
                also_ours);
        }
        std::ranges::sort(chi2);
        std::ranges::sort(cheapest);
        std::printf("%s: %d results differ; time of Highway over ours, median of %d: chi2 %.2f, cheapest %.2f\n", name,
                    different_results(in, isa), kRepetitions, chi2[kRepetitions / 2], cheapest[kRepetitions / 2]);
    }
}
