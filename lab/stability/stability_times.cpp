// Processor time of a verdict over that of a clean frame of the same geometry, whatever a frame shows.
#include <algorithm>
#include <array>
#include <cmath>
#include <numeric>
#include <random>
#include <vector>

#include <fmt/format.h>

#include "lab/stability/stability.h"
#include "lab/stability/verdict_series.h"

namespace hord::lab {
namespace {

constexpr int kFullScale = 254;

struct Light {
    double pedestal_dn = 0, noise_dn = 0.6, radius_bins = 0.6;
    int lit = 0;            // bins lit at random; 0: a spot
    double shift_bins = 0;  // of each lenslet's spot, at random, at most so far along each axis
    double dim_share = 0;   // of lenslets with a random share of the light
};

// What the frame shows, and the form of part that judges it.
struct Shown {
    const char* name;
    algo::PartForm form;
};
constexpr std::array kShown{Shown{"lens", algo::PartForm::round}, Shown{"web", algo::PartForm::web}};

// A lens in free light that deflects by up to 3.5 of 9 bins, or a film that fills the field and deflects by up to 1
// bin; 8 bits. As many bins along both axes.
Frame drawn(const algo::Extents& e, const Shown& shown, const Light& light, std::uint64_t seed) {
    std::mt19937_64 random(seed);
    std::normal_distribution<double> noise(0, 1);
    std::uniform_real_distribution<double> share(0, 1);
    Frame frame(e.width_px(), e.height_px(), 8);
    const double radius = 0.4 * e.m;
    const int side = e.i, lit = std::min(light.lit, e.bins());
    const double middle = 0.5 * (side - 1);
    std::vector<int> bins(static_cast<std::size_t>(e.bins()));  // the first `lit` are lit
    std::iota(bins.begin(), bins.end(), 0);
    std::vector<double> dn(bins.size());
    for (int n = 0; n < e.n; ++n) {
        for (int m = 0; m < e.m; ++m) {
            if (lit > 0) {
                std::shuffle(bins.begin(), bins.end(), random);
                std::ranges::fill(dn, 0.0);
                for (int k = 0; k < lit; ++k)
                    dn.at(static_cast<std::size_t>(bins.at(static_cast<std::size_t>(k)))) =
                        20 + static_cast<double>(random() % 200);
            } else {
                const double x = (m - 0.5 * (e.m - 1)) / radius, y = (n - 0.5 * (e.n - 1)) / radius;
                const bool lens = shown.form == algo::PartForm::round;
                const double bend = x * x + y * y < 1 ? 3.5 / 4 * middle : 0,
                             right = (lens ? bend * x : std::sin(2 * x)) + light.shift_bins * (2 * share(random) - 1),
                             down = (lens ? bend * y : std::sin(2 * y)) + light.shift_bins * (2 * share(random) - 1),
                             full_dn = share(random) < light.dim_share ? 240 * share(random) : 240;
                const auto profile = [&](int bin, double centre) {
                    const double off = bin - middle - centre;
                    return std::exp(-off * off / (2 * light.radius_bins * light.radius_bins));
                };
                for (int j = 0; j < side; ++j) {
                    const double row_dn = full_dn * profile(j, down);
                    for (int i = 0; i < side; ++i)
                        dn.at(static_cast<std::size_t>(j * side + i)) = row_dn * profile(i, right);
                }
            }
            for (int k = 0; k < e.bins(); ++k) {
                double sample = dn.at(static_cast<std::size_t>(k)) + light.pedestal_dn;
                if (light.noise_dn > 0) sample += light.noise_dn * noise(random);
                frame.set(m * side + k % side, n * side + k / side,
                          static_cast<std::uint32_t>(std::clamp(std::lround(sample), 0L, long{kFullScale})));
            }
        }
    }
    return frame;
}

algo::Recipe recipe_for(const Shown& shown) {
    algo::Recipe recipe;
    recipe.form = shown.form;
    recipe.part_required = shown.form != algo::PartForm::web;
    return recipe;
}

std::vector<std::pair<std::string, Light>> all_lights() {
    std::vector<std::pair<std::string, Light>> all;
    for (const int dn : {1, 2, 4, 8, 20}) {
        all.push_back({fmt::format("pedestal of {} DN", dn), {.pedestal_dn = static_cast<double>(dn), .noise_dn = 0}});
        all.push_back(
            {fmt::format("pedestal of {} +- 1 DN", dn), {.pedestal_dn = static_cast<double>(dn), .noise_dn = 1}});
    }
    for (int dn = 0; dn <= 6; ++dn)
        all.push_back({fmt::format("read noise of {} DN", dn), {.noise_dn = static_cast<double>(dn)}});
    for (const double radius : {1.0, 2.0, 4.0})
        all.push_back({fmt::format("spots of {} bins", radius), {.radius_bins = radius}});
    for (const double bins : {0.2, 0.5, 1.0, 3.0}) {
        all.push_back({fmt::format("each spot moved by up to {} bins", bins), {.shift_bins = bins}});
        all.push_back({fmt::format("wide noisy spots moved by up to {} bins", bins),
                       {.noise_dn = 2, .radius_bins = 1, .shift_bins = bins, .dim_share = 0.1}});
    }
    for (const int percent : {1, 10, 100})
        all.push_back({fmt::format("{} % of the lenslets dim", percent), {.dim_share = 0.01 * percent}});
    for (const int lit : {1, 3, 7, 15, 30, 50, 81})
        all.push_back({fmt::format("{} bins lit at random", lit), {.noise_dn = 0, .lit = lit}});
    return all;
}

struct FieldSize {
    int lenslets, bins;  // along each axis
};
std::vector<FieldSize> sizes_of(const ExperimentOptions& options) {
    std::vector<FieldSize> sizes{{111, 9}, {40, 7}, {50, 6}, {80, 5}};
    if (!options.quick) sizes.push_back({555, 9});
    if (options.lenslets == 0) return sizes;
    std::erase_if(sizes, [&](const FieldSize& size) { return size.lenslets != options.lenslets; });
    return sizes.empty() ? std::vector<FieldSize>{{options.lenslets, 9}} : sizes;
}

}  // namespace

Result<VerdictTimes> measure_verdict_times(const ExperimentOptions& options) {
    VerdictTimes all{
        {{"lenslets", "shown", "clean frame, ms", fmt::format("of the exact map's time (goal: {})", kMaxOfExact),
          "goal", "worst frame", fmt::format("of the clean frame's time (goal: {})", kMaxOverClean), "goal"},
         {}},
        {{"lenslets", "shown", "frame", "of the clean frame's time", "verdict", "a limit of work was reached"}, {}}};
    for (const auto& [lenslets, bins] : sizes_of(options)) {
        const algo::Extents e{lenslets, lenslets, bins, bins};
        for (const Shown& shown : kShown) {
            auto series = VerdictSeries::of(e, recipe_for(shown), drawn(e, shown, {}, options.seed), shown.name);
            if (!series) return tl::unexpected(series.error());
            for (const auto& [name, light] : all_lights()) {
                if (auto done = series->add(drawn(e, shown, light, options.seed), name, all); !done)
                    return tl::unexpected(done.error());
            }
            all.sizes.rows.push_back(series->summary());
        }
    }
    if (options.frames.empty()) return all;
    std::vector<int> of_corpus{21, 111};
    if (!options.quick) of_corpus.push_back(555);
    if (options.lenslets > 0) of_corpus = {options.lenslets};
    for (const int lenslets : of_corpus) {
        if (auto done = add_changed_frames(options.frames / "verdict", lenslets, all); !done)
            return tl::unexpected(done.error());
    }
    if (auto done = add_frame_files(options.frames / "frame_file", all); !done) return tl::unexpected(done.error());
    return all;
}

}  // namespace hord::lab
