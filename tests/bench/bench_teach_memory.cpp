// Memory that a teach-in needs: bench_teach_memory [LENSLETS [BINS [BITS [PARTS]]]], by default 555 9 8 8. The teach-in
// of the service (firmware/recipes/teach_in.h) gets drawn parts one after the other, as on the line. Prints the peak
// memory of the process minus its memory before the teach-in, without and with the report that the service writes of
// it. The frames are stored in the folder TMPDIR. A report needs 11 parts to be whole.
#include <algorithm>
#include <cmath>
#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <random>
#include <string>
#include <vector>

#include <fmt/format.h>
#include <time.h>

#include "firmware/diagnostics/learn_report.h"
#include "firmware/recipes/teach_in.h"
#include "lab/virtual_time/virtual_time.h"

namespace {

using namespace hord;
namespace fs = std::filesystem;

// "VmHWM" or "VmRSS" of this process, MB.
double megabytes(const std::string& which) {
    std::ifstream status("/proc/self/status");
    for (std::string line; std::getline(status, line);) {
        if (line.starts_with(which + ":")) return std::strtod(line.c_str() + which.size() + 1, nullptr) * 1024 / 1e6;
    }
    return 0;
}

double processor_seconds() {
    timespec cpu{};
    ::clock_gettime(CLOCK_PROCESS_CPUTIME_ID, &cpu);
    return static_cast<double>(cpu.tv_sec) + 1e-9 * static_cast<double>(cpu.tv_nsec);
}

// A weak lens that fills the field. Pose, power and noise vary from part to part; one electron a DN.
void draw(Frame& frame, const algo::Extents& e, std::uint64_t part) {
    std::mt19937_64 random(part);
    std::normal_distribution<float> normal;
    std::uniform_real_distribution<float> wobble(-0.3F, 0.3F);
    const float x0 = wobble(random), y0 = wobble(random);
    const float power_x = 1.4F + 0.1F * wobble(random), power_y = 1.0F + 0.1F * wobble(random);
    std::vector<float> noise(4096);
    for (float& n : noise) n = normal(random);
    const float full = static_cast<float>((1U << static_cast<unsigned>(frame.bits())) - 1), light = 0.4F * full;
    std::size_t k = part;
    for (int y = 0; y < frame.height_px(); ++y) {
        for (int x = 0; x < frame.width_px(); ++x) {
            const int m = x / e.i, n = y / e.j;
            const float dx = static_cast<float>(x % e.i - e.i / 2) -
                power_x * ((static_cast<float>(m) - x0) / static_cast<float>(e.m) - 0.5F);
            const float dy = static_cast<float>(y % e.j - e.j / 2) -
                power_y * ((static_cast<float>(n) - y0) / static_cast<float>(e.n) - 0.5F);
            const float clean = light * std::exp(-(dx * dx + dy * dy) / 0.7F);
            const float noisy = clean + std::sqrt(clean + 4) * noise[k++ % noise.size()];
            if (k % 4093 == 0) k += random() % 1024;
            frame.set(x, y, static_cast<std::uint32_t>(std::clamp(noisy + 0.5F, 0.0F, full)));
        }
    }
}

}  // namespace

int main(int argc, char** argv) {
    const auto given = [&](int k, int otherwise) { return argc > k ? std::atoi(argv[k]) : otherwise; };
    const int lenslets = given(1, 555), bins = given(2, 9), bits = given(3, 8), parts = given(4, 8);
    const algo::Extents extents{lenslets, lenslets, bins, bins};
    std::string name = fs::temp_directory_path() / "hord-teach-memory-XXXXXX";
    if (!algo::check(extents) || !algo::check_bits(bits) || parts < 8 || parts > 64 ||
        ::mkdtemp(name.data()) == nullptr) {
        fmt::print(stderr,
                   "usage: bench_teach_memory [LENSLETS [BINS [BITS [PARTS]]]], 8 to 64 parts; the folder of TMPDIR "
                   "must be writable\n");
        return 2;
    }

    lab::VirtualTime loop;
    firmware::NumberedRecipe recipe;
    recipe.number = 1;
    recipe.recipe.name = "drawn";
    recipe.recipe.emd_limit_bins = recipe.recipe.frobenius_limit_bins =
        100;  // no part is rejected: verdicts do not matter here
    recipe.recipe.transmission_limit = 0;
    recipe.recipe.reject_score = recipe.recipe.grow_score = recipe.recipe.cluster_score = 1000;
    Frame frame(extents.width_px(), extents.height_px(), bits);
    draw(frame, extents, 1);
    const double before = megabytes("VmRSS");

    std::string outcome, report = "no report";
    double taught_mb = 0, taught_s = 0;
    {
        firmware::TeachInOptions options;
        options.extents = extents;
        options.bits = bits;
        options.folder = name;
        options.thread = false;
        options.report = [&](const firmware::LearnedParts& learned) -> Result<void> {
            taught_mb = megabytes("VmHWM") - before, taught_s = processor_seconds();
            const auto checked = firmware::check_learned(learned);
            if (!checked) return tl::unexpected(checked.error());
            report = checked->check.not_checked.empty() ? "checked" : "not checked: " + checked->check.not_checked;
            return firmware::write_learn_report(*checked).map([](const auto&) {});
        };
        firmware::LineTeachIn teacher(loop, options);
        const auto begun = teacher.begin(static_cast<std::uint32_t>(parts), recipe,
                                         {{}, [&](Result<firmware::TeachResult> taught) {
                                              outcome = taught
                                                  ? "taught" + (taught->remarks.empty() ? "" : ": " + taught->remarks)
                                                  : taught.error().message();
                                          }});
        if (!begun) outcome = begun.error().message();
        for (int part = 1; part <= parts && outcome.empty(); ++part) {
            draw(frame, extents, static_cast<std::uint64_t>(part));
            algo::Inspection seen;
            seen.reason = algo::Reason::none;
            teacher.on_inspection(static_cast<std::uint32_t>(part), frame.view(), seen);
            loop.run_for(std::chrono::milliseconds(1));
        }
    }
    std::error_code ignored;
    fs::remove_all(name, ignored);
    fmt::print("{}x{} lenslets of {}x{} bins, {} bits ({:.0f} MB a frame), {} parts: {}\n", lenslets, lenslets, bins,
               bins, bits, static_cast<double>(frame.bytes().size()) / 1e6, parts, outcome);
    fmt::print(
        "the teach took {:.0f} MB at most, {:.0f} s of processor time; with its report ({}) {:.0f} MB, {:.0f} s\n",
        taught_mb, taught_s, report, megabytes("VmHWM") - before, processor_seconds());
    return outcome.starts_with("taught") ? 0 : 1;
}
