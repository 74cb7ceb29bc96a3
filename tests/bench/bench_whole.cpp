// The whole way of a 25-megapixel frame: raw samples -> calibrated decode -> HORDs and features -> comparison with a
// reference -> verdict, against summing the raw frame's bytes in the same run; on one core and on two (./dev bench).
//
// Work: tests/bench/drawn_raw.h, a square and a hexagonal lattice of 555 x 555 lenslets, 9 x 9 bins, 8 bits; the
// reference is learned from kMinParts other parts. Rounds are interleaved: in each, everything is measured once, and
// medians of the rounds count. One core: processor time. Two cores against one: elapsed time, the ratio of runs one
// right after the other. `bench_whole ROUNDS` (default 31); `bench_whole 1 once` inspects one frame, for counting
// instructions.
#include <algorithm>
#include <cstdio>
#include <cstdlib>
#include <ctime>
#include <memory>
#include <optional>
#include <string>
#include <string_view>
#include <thread>
#include <vector>

#include "algo/ageing/drift.h"
#include "algo/frame/grid_decoder.h"
#include "algo/inspection/pipeline.h"
#include "algo/reference/reference_learner.h"
#include "tests/bench/drawn_raw.h"
#include "tests/bench/sum_of_bytes.h"

namespace {

using namespace hord;
using namespace hord::bench;

constexpr int kBins = 9;
constexpr double kMinOfSum = 80, kAimOfSum = 50, kMinTwo = 1.85, kAimTwo = 1.95;
constexpr double kMaxDriftShare = 0.02;  // of the whole way

double ms_of(clockid_t clock) {
    timespec now{};
    clock_gettime(clock, &now);
    return static_cast<double>(now.tv_sec) * 1e3 + static_cast<double>(now.tv_nsec) * 1e-6;
}
double cpu_ms() { return ms_of(CLOCK_THREAD_CPUTIME_ID); }
double elapsed_ms() { return ms_of(CLOCK_MONOTONIC); }
std::int64_t now_ns() { return static_cast<std::int64_t>(cpu_ms() * 1e6); }

template <class T>
T median(std::vector<T> of) {
    std::sort(of.begin(), of.end());
    return of[of.size() / 2];
}

double least(const std::vector<double>& of) { return *std::min_element(of.begin(), of.end()); }

[[noreturn]] void stop(const Error& error) {
    std::fprintf(stderr, "%s\n", error.message().c_str());
    std::exit(1);
}
template <class T>
T value_of(Result<T> result) {
    if (!result) stop(result.error());
    return std::move(*result);
}

// A pipeline for raw frames.
struct Way {
    Way(const algo::GridDecoder& decoder, const algo::Recipe& recipe, int threads)
        : pipeline(value_of(algo::Pipeline::create(decoder, 8, recipe, threads))) {}
    algo::Pipeline pipeline;

    algo::Inspection inspect(const Frame& raw, algo::NowNs now = nullptr) {
        return value_of(pipeline.inspect(raw.view(), now));
    }
};

struct Kind {
    std::string name;
    Frame raw, with_defect;
    std::optional<algo::GridDecoder> decoder;
    algo::Recipe recipe;
    std::unique_ptr<Way> one, two, other;
    Frame decoded;  // of `raw`
    std::uint32_t dark_dn = 0;
    std::optional<algo::DriftEstimator> drift;

    explicit Kind(bool hexagonal) : name(hexagonal ? "hexagonal" : "square") {
        const algo::LensletGrid grid = raw_grid(hexagonal);
        decoder = value_of(algo::GridDecoder::create(grid, std::nullopt, kBins, kBins));
        const auto frame_of = [&](std::size_t part) {
            const auto k = static_cast<double>(part);
            return decoder->decode(drawn_raw(grid, 0.03 * k - 0.1, 0.08 - 0.02 * k, 100 + part).view());
        };
        std::vector<Frame> parts;
        for (std::size_t k = 0; k < algo::Reference::kMinParts; ++k) parts.push_back(value_of(frame_of(k)));
        algo::LearnOptions learning;
        learning.levels = algo::light_levels(recipe, 8);
        learning.electrons_per_dn = static_cast<float>(kElectronsPerDn);
        learning.read_dn = static_cast<float>(kReadDn);
        learning.threads = 2;
        auto learned = value_of(algo::learn_reference(
            decoder->extents(), 8, parts.size(), [&](std::size_t k) -> Result<Frame> { return parts[k]; }, learning));
        recipe.reference = std::make_shared<const algo::Reference>(std::move(learned.reference));
        raw = drawn_raw(grid, 0.03, 0.02, 7);
        with_defect = drawn_raw(grid, 0.03, 0.02, 7, true);
        decoded = value_of(decoder->decode(raw.view()));
        dark_dn = learning.levels.dark;
        drift = value_of(algo::DriftEstimator::create(decoder->extents(), learning.levels));
        one = std::make_unique<Way>(*decoder, recipe, 1);
        other = std::make_unique<Way>(*decoder, recipe, 1);
        two = std::make_unique<Way>(*decoder, recipe, 2);
    }
    std::vector<double> cpu, one_ms, two_ms, pair_ms, drift_ms;
    std::vector<algo::StageTimes> stages;
};

void measure(Kind& kind) {
    double begin = cpu_ms();
    kind.stages.push_back(kind.one->inspect(kind.raw, now_ns).times);
    kind.cpu.push_back(cpu_ms() - begin);
    begin = cpu_ms();
    for (int k = 0; k < algo::DriftEstimator::kWindow; ++k) kind.drift->add(kind.decoded.view(), kind.dark_dn);
    kind.drift_ms.push_back((cpu_ms() - begin) / algo::DriftEstimator::kWindow);
    begin = elapsed_ms();
    kind.one->inspect(kind.raw);
    kind.one_ms.push_back(elapsed_ms() - begin);
    begin = elapsed_ms();
    kind.two->inspect(kind.raw);
    kind.two_ms.push_back(elapsed_ms() - begin);
    begin = elapsed_ms();
    {
        std::jthread beside([&] { kind.other->inspect(kind.raw); });
        kind.one->inspect(kind.raw);
    }
    kind.pair_ms.push_back(elapsed_ms() - begin);
}

const char* reached(double value, double least, double aim, bool less) {
    const auto good = [&](double limit) { return less ? value <= limit : value >= limit; };
    return good(aim) ? "aim reached" : good(least) ? "least reached" : "not reached";
}

double stage_ms(const Kind& kind, std::int64_t algo::StageTimes::*stage) {
    std::vector<double> all;
    for (const algo::StageTimes& times : kind.stages) all.push_back(static_cast<double>(times.*stage) * 1e-6);
    return median(all);
}

}  // namespace

int main(int argc, char** argv) {
    const int rounds = argc > 1 ? std::max(std::atoi(argv[1]), 1) : 31;
    const bool once = argc > 2 && std::string_view(argv[2]) == "once";
    if (once) {
        Kind kind(argc > 3 && std::string_view(argv[3]) == "hexagonal");
        for (int k = 0; k < rounds; ++k) kind.one->inspect(kind.raw);
        return 0;
    }
    std::vector<Kind> kinds;
    for (const bool hexagonal : {false, true}) kinds.emplace_back(hexagonal);
    for (Kind& kind : kinds) {
        const auto good = kind.one->inspect(kind.raw), bad = kind.one->inspect(kind.with_defect);
        std::printf("%s: %dx%d lenslets; good part: %s, score %.2f; with a defect: %s, %s, score %.1f\n",
                    kind.name.c_str(), kind.decoder->extents().m, kind.decoder->extents().n,
                    std::string(algo::name_of(good.verdict)).c_str(), static_cast<double>(good.score),
                    std::string(algo::name_of(bad.verdict)).c_str(), std::string(algo::name_of(bad.reason)).c_str(),
                    static_cast<double>(bad.score));
    }
    std::vector<double> sums;
    const auto bytes = kinds[0].raw.bytes();
    volatile std::uint64_t seen = 0;
    for (int round = 0; round < rounds; ++round) {
        for (Kind& kind : kinds) {
            const double begin = cpu_ms();
            for (int k = 0; k < 8; ++k)
                seen = seen + sum_of_bytes(reinterpret_cast<const std::uint8_t*>(bytes.data()), bytes.size());
            sums.push_back((cpu_ms() - begin) / 8);
            measure(kind);
        }
    }
    const double sum = median(sums), least_sum = least(sums);
    std::printf(
        "\nRaw 25 megapixels to a verdict with reference, one core: processor time, medians of %d rounds. Bytes "
        "summed: "
        "%.2f ms, quietest %.2f ms\n\n| ms | square | hexagonal |\n|---|---|---|\n",
        rounds, sum, least_sum);
    struct Stage {
        const char* name;
        std::int64_t algo::StageTimes::*of;
    };
    for (const Stage& stage :
         {Stage{"raw samples to macro-pixels", &algo::StageTimes::resample_ns},
          Stage{"macro-pixels to HORDs: sums and moments", &algo::StageTimes::decode_ns},
          Stage{"mean deflections", &algo::StageTimes::hord_ns},
          Stage{"slopes, rim, light, frame checks", &algo::StageTimes::feature_ns},
          Stage{"registration", &algo::StageTimes::register_ns},
          Stage{"comparison with the reference", &algo::StageTimes::compare_ns},
          Stage{"bounds of the EMD", &algo::StageTimes::bound_ns}, Stage{"verdict", &algo::StageTimes::decide_ns}}) {
        std::printf("| %s | %.1f | %.1f |\n", stage.name, stage_ms(kinds[0], stage.of), stage_ms(kinds[1], stage.of));
    }
    std::printf("| all | %.1f | %.1f |\n", median(kinds[0].cpu), median(kinds[1].cpu));
    std::printf("| all, quietest | %.1f | %.1f |\n", least(kinds[0].cpu), least(kinds[1].cpu));
    std::printf(
        "\nOf the sum: on a busy machine the sum waits for memory more than the way does, so that the larger of both "
        "ratios counts. Two cores: elapsed time; the smaller ratio counts.\n\n"
        "| lattice | of the sum, median | quietest | at least | aim | |\n|---|---|---|---|---|---|\n");
    for (const Kind& kind : kinds) {
        const double by_median = median(kind.cpu) / sum, quietest = least(kind.cpu) / least_sum;
        std::printf("| %s | %.0fx | %.0fx | %.0fx | %.0fx | %s |\n", kind.name.c_str(), by_median, quietest, kMinOfSum,
                    kAimOfSum, reached(std::max(by_median, quietest), kMinOfSum, kAimOfSum, true));
    }
    std::printf(
        "\n| lattice | two cores over one, median | quietest | at least | aim | | the machine gives, median | quietest "
        "|\n|---|---|---|---|---|---|---|---|\n");
    for (const Kind& kind : kinds) {
        std::vector<double> ratios, machine;
        for (std::size_t k = 0; k < kind.one_ms.size(); ++k) {
            ratios.push_back(kind.one_ms[k] / kind.two_ms[k]);
            machine.push_back(2 * kind.one_ms[k] / kind.pair_ms[k]);
        }
        const double by_median = median(ratios), quietest = least(kind.one_ms) / least(kind.two_ms);
        std::printf("| %s | %.2fx | %.2fx | %.2fx | %.2fx | %s | %.2fx | %.2fx |\n", kind.name.c_str(), by_median,
                    quietest, kMinTwo, kAimTwo, reached(std::min(by_median, quietest), kMinTwo, kAimTwo, false),
                    median(machine), 2 * least(kind.one_ms) / least(kind.pair_ms));
    }
    std::printf(
        "\nThe drift check (algo/ageing/drift.h), which a frame pays beside this: mean of a window of %d frames\n\n"
        "| lattice | drift check, ms | of the whole way | at most | |\n|---|---|---|---|---|\n",
        algo::DriftEstimator::kWindow);
    for (const Kind& kind : kinds) {
        const double share = median(kind.drift_ms) / median(kind.cpu);
        std::printf("| %s | %.3f | %.2f %% | %.0f %% | %s |\n", kind.name.c_str(), median(kind.drift_ms), 100 * share,
                    100 * kMaxDriftShare, share <= kMaxDriftShare ? "reached" : "not reached");
    }
}
