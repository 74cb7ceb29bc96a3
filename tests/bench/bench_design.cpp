// The work of a verdict by bins and judged features, which hord-lab design counts (lab/design/cell_trial.h, work_of):
// processor time of one thread a lenslet, of drawn frames of 281x281 lenslets without a defect. All are timed in turn;
// the table has medians of nine.
#include <algorithm>
#include <cmath>
#include <cstdio>
#include <string>
#include <vector>

#include "lab/design/part_values.h"
#include "lab/report/cpu_time.h"
#include "tests/calib/support/synthetic.h"

namespace {

using namespace hord;

constexpr int kSide = 281, kRuns = 9, kBins[] = {3, 5, 7, 9, 15};

// Spots of 1.2 bins radius whose place changes over the frame by a third of the bins, 12 bits.
Frame spots(int bins) {
    Frame frame(kSide * bins, kSide * bins, 12);
    calib::test::Random random(1);
    for (int y = 0; y < frame.height_px(); ++y) {
        for (int x = 0; x < frame.width_px(); ++x) {
            const auto off = [&](int at) {
                return at % bins - 0.5 * (bins - 1) - 0.3 * bins * (at / bins - 140) / kSide;
            };
            const double light = 16 + 3500 * std::clamp(1.2 - std::hypot(off(x), off(y)), 0.0, 1.0);
            frame.set(x, y, static_cast<std::uint32_t>(light + 0.65 * std::sqrt(light) * random.normal()));
        }
    }
    return frame;
}

struct Timed {
    std::size_t frame, set;
    algo::Pipeline pipeline;
    std::vector<double> ns{};
};

}  // namespace

int main() {
    algo::Recipe base;
    base.form = algo::PartForm::web, base.part_required = false;
    lab::PartValues limits{};
    limits.fill(0.5);
    limits[lab::kLightValue] = 0.1;
    const auto sets = lab::judged_sets();
    std::vector<Frame> frames;
    std::vector<Timed> all;
    for (const int bins : kBins) {
        frames.push_back(spots(bins));
        for (std::size_t s = 0; s < sets.size(); ++s) {
            auto pipeline =
                algo::Pipeline::create({kSide, kSide, bins, bins}, 12, lab::recipe_of(sets[s], limits, base));
            if (!pipeline) return std::fprintf(stderr, "%s\n", pipeline.error().what.c_str()), 1;
            all.push_back({frames.size() - 1, s, std::move(*pipeline)});
        }
    }
    for (int run = 0; run < kRuns; ++run) {
        for (Timed& one : all) {
            const auto start = lab::thread_cpu_time();
            if (!one.pipeline.inspect(frames[one.frame].view())) return 1;
            one.ns.push_back(static_cast<double>((lab::thread_cpu_time() - start).count()) / kSide / kSide);
        }
    }
    std::printf("| judged by, ns a lenslet |");
    for (const int bins : kBins) std::printf(" %dx%d bins |", bins, bins);
    std::printf("\n|---|---|---|---|---|---|\n");
    for (std::size_t s = 0; s < sets.size(); ++s) {
        std::printf("| %s |", sets[s].name().c_str());
        for (Timed& one : all) {
            if (one.set != s) continue;
            std::ranges::sort(one.ns);
            std::printf(" %.0f |", one.ns[kRuns / 2]);
        }
        std::printf("\n");
    }
    return 0;
}
