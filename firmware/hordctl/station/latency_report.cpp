#include "firmware/hordctl/station/latency_report.h"

#include <algorithm>
#include <bit>
#include <cmath>
#include <fstream>
#include <thread>

#include <fmt/format.h>
#include <sys/utsname.h>

namespace hord::firmware {
namespace {

// Nearest rank: a fraction p of the samples does not exceed it.
double quantile_us(const std::vector<Duration>& sorted, double p) {
    const auto rank = static_cast<std::size_t>(std::ceil(p * static_cast<double>(sorted.size())));
    return static_cast<double>(sorted[std::clamp<std::size_t>(rank, 1, sorted.size()) - 1].count()) / 1e3;
}

std::string line_of(const char* file) {
    std::ifstream in(file);
    std::string line;
    std::getline(in, line);
    return line.empty() ? "unknown" : line;
}

}  // namespace

void Series::add(std::optional<Duration> sample) {
    if (sample) samples.push_back(*sample);
    else ++missed;
}

std::string text_of(Series series) {
    std::string out = fmt::format("{}: {} measured, {} missed", series.what, series.samples.size(), series.missed);
    if (series.samples.empty()) return out + "\n";
    std::ranges::sort(series.samples);
    const auto& s = series.samples;
    out += fmt::format("; p50 {:.0f} us, p99 {:.0f} us, ", quantile_us(s, 0.5), quantile_us(s, 0.99));
    out +=
        s.size() >= 1000 ? fmt::format("p99.9 {:.0f} us, ", quantile_us(s, 0.999)) : std::string("p99.9 needs 1000, ");
    out += fmt::format("max {:.0f} us\n", quantile_us(s, 1));
    // A histogram with one bar for each octave of microseconds.
    std::vector<int> bars;
    for (const Duration sample : s) {
        const auto us = static_cast<std::uint64_t>(std::max<std::int64_t>(0, sample.count() / 1000));
        const auto octave = static_cast<std::size_t>(std::bit_width(us));
        if (bars.size() <= octave) bars.resize(octave + 1);
        ++bars[octave];
    }
    const auto first = static_cast<std::size_t>(std::ranges::find_if(bars, [](int n) { return n > 0; }) - bars.begin());
    const int most = *std::ranges::max_element(bars);
    for (std::size_t k = first; k < bars.size(); ++k) {
        const std::uint64_t from = k == 0 ? 0 : std::uint64_t{1} << (k - 1), to = std::uint64_t{1} << k;
        out += fmt::format("  {:>7} to {:>7} us  {:<40} {}\n", from, to,
                           std::string(static_cast<std::size_t>((bars[k] * 40 + most - 1) / most), '#'), bars[k]);
    }
    return out;
}

std::string machine_text() {
    utsname system{};
    uname(&system);
    const std::string version = system.version;
    const char* preemption = version.find("PREEMPT_RT") != std::string::npos ? "fully preemptible (PREEMPT_RT)"
        : version.find("PREEMPT_DYNAMIC") != std::string::npos
        ? "PREEMPT_DYNAMIC: chosen at boot (preempt=), which a program cannot see"
        : version.find("PREEMPT") != std::string::npos ? "preemptible (PREEMPT)"
                                                       : "not said by the kernel: probably none or voluntary";
    return fmt::format(
        "machine: {} processors for this program, Linux {}\nkernel preemption: {}\nclock source: {} (hpet and acpi_pm "
        "take a microsecond a read)\nprocessor speed governor: {}\n",
        std::thread::hardware_concurrency(), system.release, preemption,
        line_of("/sys/devices/system/clocksource/clocksource0/current_clocksource"),
        line_of("/sys/devices/system/cpu/cpu0/cpufreq/scaling_governor"));
}

}  // namespace hord::firmware
