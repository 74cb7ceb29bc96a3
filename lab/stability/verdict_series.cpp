#include "lab/stability/verdict_series.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <span>

#include <fmt/format.h>

#include "common/statistics.h"
#include "lab/report/cpu_time.h"

namespace hord::lab {
namespace {

constexpr std::size_t kRepeats = 9;
constexpr double kMinMs = 0.1;  // of one measurement: reading the clock takes less than a hundredth of it
constexpr int kMaxVerdicts = 100;

struct FrameToTime {
    algo::Pipeline& pipeline;
    const Frame& frame;
};

// Medians of the processor time of a verdict, ms; what was found in the second frame.
struct TimesInTurn {
    double first_ms = 0, second_ms = 0;
    algo::Verdict found = algo::Verdict::unfit;
    bool bounded = false;
};

// Of each of `verdicts`, ms.
Result<double> time_of(const FrameToTime& one, int verdicts, TimesInTurn& seen) {
    const auto before = thread_cpu_time();
    for (int k = 0; k < verdicts; ++k) {
        const auto found = one.pipeline.inspect(one.frame.view());
        if (!found) return tl::unexpected(found.error());
        seen.found = found->verdict;
        seen.bounded = found->bounded;
    }
    return std::chrono::duration<double, std::milli>(thread_cpu_time() - before).count() / verdicts;
}

// In turn, so that a busy machine slows both alike.
Result<TimesInTurn> time_in_turn(const FrameToTime& first, const FrameToTime& second) {
    TimesInTurn times;
    const std::array both{first, second};
    std::array<std::array<double, kRepeats>, 2> all{};
    std::array<int, 2> verdicts{};
    for (const std::size_t which : {0U, 1U}) {  // not counted
        const auto once = time_of(both.at(which), 1, times);
        if (!once) return tl::unexpected(once.error());
        verdicts.at(which) = std::clamp(static_cast<int>(std::ceil(kMinMs / std::max(*once, 1e-3))), 1, kMaxVerdicts);
    }
    for (std::size_t k = 0; k < kRepeats; ++k) {
        for (const std::size_t which : {0U, 1U}) {
            const auto took = time_of(both.at(which), verdicts.at(which), times);
            if (!took) return tl::unexpected(took.error());
            all.at(which).at(k) = *took;
        }
    }
    times.first_ms = common::lower_median(std::span<double>(all[0]));
    times.second_ms = common::lower_median(std::span<double>(all[1]));
    return times;
}

}  // namespace

Result<VerdictSeries> VerdictSeries::of(const algo::Extents& e, const algo::Recipe& recipe, Frame clean,
                                        std::string shown) {
    auto pipeline = algo::Pipeline::create(e, clean.bits(), recipe);
    if (!pipeline) return tl::unexpected(pipeline.error());
    auto exactly = algo::Pipeline::create(e, clean.bits(), recipe, 1, algo::MapSet::exact);
    if (!exactly) return tl::unexpected(exactly.error());
    VerdictSeries series(std::move(*pipeline), std::move(clean), fmt::format("{}x{} of {}x{} bins", e.m, e.n, e.i, e.j),
                         std::move(shown));
    const auto times = time_in_turn({*exactly, series.clean_}, {series.pipeline_, series.clean_});
    if (!times) return tl::unexpected(times.error());
    series.clean_ms_ = times->second_ms;
    series.of_exact_ = times->second_ms / times->first_ms;
    return series;
}

Result<void> VerdictSeries::add(const Frame& frame, std::string_view name, VerdictTimes& times) {
    const auto both = time_in_turn({pipeline_, clean_}, {pipeline_, frame});
    if (!both) return tl::unexpected(both.error());
    const double ratio = both->second_ms / both->first_ms;
    times.frames.rows.push_back({size_, shown_, std::string(name), fmt::format("{:.2f}", ratio),
                                 std::string(name_of(both->found)), both->bounded ? "yes" : "no"});
    if (ratio > worst_) worst_ = ratio, worst_name_ = name;
    return {};
}

std::vector<std::string> VerdictSeries::summary() const {
    const auto reached = [](bool good) { return good ? "reached" : "not reached"; };
    return {size_,
            shown_,
            fmt::format("{:.3g}", clean_ms_),
            fmt::format("{:.2f}", of_exact_),
            reached(of_exact_ <= kMaxOfExact),
            worst_name_,
            fmt::format("{:.2f}", worst_),
            reached(worst_ <= kMaxOverClean)};
}

}  // namespace hord::lab
