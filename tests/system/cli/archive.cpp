// Fills a store's frames folder as a station does, without a line: hord_test_archive STORE FRAMES [LENSLETS BINS].
// All frames differ, some are rejects. For tests that need frames but no real time, and to measure a replay.
#include <cmath>
#include <cstdlib>
#include <filesystem>
#include <random>

#include <fmt/format.h>

#include "algo/inspection/pipeline.h"
#include "firmware/recipes/recipe_file.h"
#include "firmware/store/frames/frame_retention.h"

using namespace hord;
using namespace hord::firmware;

namespace {

// One spot of light a lenslet, about a bin wide, whose position varies slowly over the part. In a bad part the spots of
// one patch are displaced.
Frame part_frame(const algo::Extents& e, std::uint32_t seed, bool bad) {
    Frame frame(e.width_px(), e.height_px(), 8);
    std::mt19937 random(seed);
    for (int n = 0; n < e.n; ++n) {
        for (int m = 0; m < e.m; ++m) {
            const bool jumps = bad && std::abs(m - e.m / 2) <= 1 && std::abs(n - e.n / 2) <= 1 && (m + n) % 2 == 0;
            const int middle_i = e.i / 2, middle_j = e.j / 2;
            const double x = jumps ? 0.2 : middle_i + 0.5 * m / e.m, y = middle_j + 0.3 * n / e.n;
            for (int j = 0; j < e.j; ++j) {
                for (int i = 0; i < e.i; ++i) {
                    const double spot = 200 * std::exp(-((i - x) * (i - x) + (j - y) * (j - y)));
                    frame.set(m * e.i + i, n * e.j + j,
                              static_cast<std::uint32_t>(spot + static_cast<double>(random() % 3)));
                }
            }
        }
    }
    return frame;
}

Result<void> fill(const std::filesystem::path& store, std::uint32_t count, const algo::Extents& extents) {
    algo::Recipe recipe;
    recipe.part_required = false;  // the drawn part fills the field
    auto pipeline = algo::Pipeline::create(extents, 8, recipe);
    if (!pipeline) return tl::unexpected(pipeline.error());
    std::error_code error;
    std::filesystem::create_directories(store, error);
    store::FrameRetentionOptions options;
    options.extents = extents;
    options.station = "test";
    options.software = "test";
    options.sample_every = 1;
    options.before = options.after = 0;
    options.thread = false;
    store::FrameRetention keeper(
        [&] {
            return store::FrameArchive::open(store / store::kFramesFolder,
                                             {.max_bytes = 100'000'000'000, .min_free_bytes = 0});
        },
        options, [] { return store::UtcMicros{1'790'000'000'000'000}; });
    keeper.set_recipe(format_recipe({.number = 1, .version = 1, .recipe = recipe}));
    for (std::uint32_t part = 1; part <= count; ++part) {
        const Frame frame = part_frame(extents, part, part % 10 == 0);
        const auto inspection = pipeline->inspect(frame.view());
        if (!inspection) return tl::unexpected(inspection.error());
        keeper.on_inspection(part, frame.view(), *inspection);
        while (keeper.step()) {
        }
    }
    if (keeper.counts().kept != count)
        return fail(ErrorCode::io, fmt::format("{} of {} frames were kept", keeper.counts().kept, count),
                    "see the disk");
    return {};
}

}  // namespace

int main(int argc, char** argv) {
    if (argc < 3) {
        fmt::print(stderr, "usage: hord_test_archive STORE FRAMES [LENSLETS BINS]\n");
        return 2;
    }
    const int lenslets = argc > 3 ? std::atoi(argv[3]) : 24, bins = argc > 4 ? std::atoi(argv[4]) : 5;
    const auto done = fill(argv[1], static_cast<std::uint32_t>(std::atoi(argv[2])), {lenslets, lenslets, bins, bins});
    if (!done) fmt::print(stderr, "hord_test_archive: {}\n", done.error().message());
    return done ? 0 : 1;
}
