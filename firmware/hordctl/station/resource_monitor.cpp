#include "firmware/hordctl/station/resource_monitor.h"

#include <algorithm>
#include <cmath>
#include <ctime>
#include <filesystem>
#include <fstream>
#include <iterator>

#include <fmt/format.h>
#include <unistd.h>

#include "common/statistics.h"

namespace hord::firmware {
namespace {

std::uint64_t entries_of(const char* folder) {
    std::error_code ignored;
    const std::filesystem::directory_iterator all(folder, ignored);
    return static_cast<std::uint64_t>(std::distance(begin(all), end(all)));
}

std::uint64_t resident_kb() {
    std::ifstream in("/proc/self/statm");
    std::uint64_t all = 0, resident = 0;
    in >> all >> resident;
    return resident * static_cast<std::uint64_t>(::sysconf(_SC_PAGESIZE)) / 1024;
}

}  // namespace

void LatencyCounts::add(std::uint32_t us) {
    ++steps_[std::min((us + kStepUs - 1) / kStepUs, kSteps)];
    ++count_;
    max_us_ = std::max(max_us_, us);
}

void LatencyCounts::clear() {
    std::fill(steps_.begin(), steps_.end(), 0U);
    count_ = 0;
    max_us_ = 0;
}

double LatencyCounts::percentile_ms(double share) const {
    if (count_ == 0) return 0;
    const auto rank =
        std::max<std::uint64_t>(1, static_cast<std::uint64_t>(std::ceil(share * static_cast<double>(count_))));
    std::uint64_t seen = 0;
    for (std::uint32_t step = 0; step < kSteps; ++step) {
        seen += steps_[step];
        if (seen >= rank) return std::min(step * kStepUs, max_us_) / 1e3;
    }
    return max_ms();
}

void ResourceMonitor::add(const PartResult& result) {
    ++now_.parts;
    now_.late += result.reason == PartReason::verdict_late ? 1U : 0U;
    now_.unfit += result.verdict == PartVerdict::unfit ? 1U : 0U;
    latencies_.add(result.latency_us);
}

void ResourceMonitor::sample(double at_s) {
    // Processor time of all threads.
    const double used_s = static_cast<double>(std::clock()) / CLOCKS_PER_SEC,
                 before_s = samples_.empty() ? 0 : samples_.back().at_s;
    now_.at_s = at_s;
    now_.p50_ms = latencies_.percentile_ms(0.5);
    now_.p99_ms = latencies_.percentile_ms(0.99);
    now_.max_ms = latencies_.max_ms();
    now_.memory_kb = resident_kb();
    now_.descriptors = entries_of("/proc/self/fd");
    now_.threads = entries_of("/proc/self/task");
    now_.processor = processor_s_ > 0 && at_s > before_s ? (used_s - processor_s_) / (at_s - before_s) : 0;
    processor_s_ = used_s;
    samples_.push_back(now_);
    now_ = {};
    latencies_.clear();
}

std::string ResourceMonitor::text() const {
    if (samples_.empty()) return {};
    std::string out =
        fmt::format("\n{:>8} {:>8} {:>6} {:>6} {:>9} {:>9} {:>9} {:>10} {:>12} {:>8} {:>10}\n", "until s", "parts",
                    "late", "unfit", "p50 ms", "p99 ms", "max ms", "memory kB", "descriptors", "threads", "processor");
    const std::size_t rows = std::min<std::size_t>(10, samples_.size());
    for (std::size_t row = 0; row < rows; ++row) {  // the last sample of each tenth; sums and maxima over all of it
        const std::size_t from = row * samples_.size() / rows, to = (row + 1) * samples_.size() / rows;
        Sample sum = samples_[to - 1];
        for (std::size_t k = from; k + 1 < to; ++k) {
            sum.parts += samples_[k].parts;
            sum.late += samples_[k].late;
            sum.unfit += samples_[k].unfit;
            sum.p99_ms = std::max(sum.p99_ms, samples_[k].p99_ms);
            sum.max_ms = std::max(sum.max_ms, samples_[k].max_ms);
            sum.memory_kb = std::max(sum.memory_kb, samples_[k].memory_kb);
            sum.descriptors = std::max(sum.descriptors, samples_[k].descriptors);
            sum.processor += samples_[k].processor;
        }
        sum.processor /= static_cast<double>(to - from);
        out += fmt::format("{:>8.0f} {:>8} {:>6} {:>6} {:>9.2f} {:>9.2f} {:>9.2f} {:>10} {:>12} {:>8} {:>9.0f}%\n",
                           sum.at_s, sum.parts, sum.late, sum.unfit, sum.p50_ms, sum.p99_ms, sum.max_ms, sum.memory_kb,
                           sum.descriptors, sum.threads, 100 * sum.processor);
    }
    if (samples_.size() < 8) return out;
    // The first tenth is warm-up. Medians are robust against single outliers.
    const std::size_t warm = samples_.size() / 10, quarter = (samples_.size() - warm) / 4;
    const auto median_from = [&](std::size_t first, auto get) {
        std::vector<double> values;
        for (std::size_t k = first; k < first + quarter; ++k) values.push_back(static_cast<double>(get(samples_[k])));
        return common::upper_median(std::span(values));
    };
    const auto change = [&](auto get) { return median_from(samples_.size() - quarter, get) - median_from(warm, get); };
    out += fmt::format(
        "from the first quarter to the last: memory {:+.0f} kB, descriptors {:+.0f}, median latency {:+.2f} ms\n",
        change([](const Sample& s) { return s.memory_kb; }), change([](const Sample& s) { return s.descriptors; }),
        change([](const Sample& s) { return s.p50_ms; }));
    return out;
}

Result<void> ResourceMonitor::write(const std::string& file) const {
    std::ofstream out(file, std::ios::trunc);
    out << "until_s,parts,late,unfit,p50_ms,p99_ms,max_ms,memory_kb,descriptors,threads,processor\n";
    for (const Sample& s : samples_) {
        out << fmt::format("{:.1f},{},{},{},{:.2f},{:.2f},{:.2f},{},{},{},{:.3f}\n", s.at_s, s.parts, s.late, s.unfit,
                           s.p50_ms, s.p99_ms, s.max_ms, s.memory_kb, s.descriptors, s.threads, s.processor);
    }
    if (!out.flush())
        return fail(ErrorCode::io, file + " cannot be written", "name a file in a folder that exists and has room");
    return {};
}

}  // namespace hord::firmware
