// Parts that pass or fail the inspection, and a keeper of their frames over a folder.
#pragma once

#include <cmath>
#include <cstdint>
#include <filesystem>
#include <memory>
#include <optional>
#include <random>
#include <string>
#include <utility>
#include <vector>

#include <gtest/gtest.h>

#include "algo/inspection/pipeline.h"
#include "firmware/recipes/recipe_file.h"
#include "firmware/store/frames/frame_archive.h"
#include "firmware/store/frames/frame_retention.h"
#include "tests/firmware/store/results/samples.h"

namespace hord::firmware::store::test {

constexpr algo::Extents kExtents{24, 24, 5, 5};

// Every lenslet holds a spot about a bin wide, with its own noise; in a bad part the spots of one patch are displaced.
inline Frame part_frame(std::uint32_t seed, bool bad, int bits = 8) {
    Frame frame(kExtents.width_px(), kExtents.height_px(), bits);
    std::mt19937 random(seed);
    const double brightest = 0.8 * ((1 << bits) - 1);
    for (int n = 0; n < kExtents.n; ++n) {
        for (int m = 0; m < kExtents.m; ++m) {
            const bool jumps = bad && std::abs(m - 12) <= 1 && std::abs(n - 11) <= 1 && (m + n) % 2 == 0;
            const double x = jumps ? 0.2 : 2.0 + 0.5 * m / kExtents.m, y = 2.0;
            for (int j = 0; j < kExtents.j; ++j) {
                for (int i = 0; i < kExtents.i; ++i) {
                    const double spot = brightest * std::exp(-((i - x) * (i - x) + (j - y) * (j - y)));
                    const double noise = static_cast<double>(random() % 1000) / 1000.0 * 0.01 * brightest;
                    frame.set(m * kExtents.i + i, n * kExtents.j + j, static_cast<std::uint32_t>(spot + noise));
                }
            }
        }
    }
    return frame;
}
inline std::vector<std::string> names(const std::filesystem::path& folder) {
    std::vector<std::string> all;
    const auto files = list_frames(folder);
    EXPECT_TRUE(files);
    for (const ArchivedFile& file : *files) all.push_back(file.file.filename().string());
    return all;
}
// The drawn part fills the field.
inline algo::Recipe unchecked_part() {
    algo::Recipe recipe;
    recipe.part_required = false;
    return recipe;
}

// A keeper without a thread over a folder, and an inspection pipeline.
struct Cell {
    explicit Cell(FrameRetentionOptions options = {}, const ArchiveDisk& disk = real_disk(),
                  const algo::Recipe& recipe = unchecked_part(), algo::MapSet maps = algo::MapSet::judged,
                  int sample_bits = 8)
        : bits(sample_bits), pipeline(algo::Pipeline::create(kExtents, bits, recipe, 1, maps).value()),
          keeper(
              [this, disk] {
                  return FrameArchive::open(folder.path() / "frames", {.max_bytes = 100'000'000, .min_free_bytes = 0},
                                            disk);
              },
              complete(std::move(options)), [] { return kNoon; },
              {[this](const Error& e) { said.push_back(e.message()); }, [this] { said.emplace_back("works again"); }}) {
        keeper.set_recipe(format_recipe({.number = 3, .version = 1, .recipe = recipe}));
    }
    static FrameRetentionOptions complete(FrameRetentionOptions options) {
        options.extents = kExtents;
        options.station = "cell 3";
        options.software = "0.1.0";
        options.boot = 7;
        options.thread = false;
        return options;
    }
    void inspect(std::uint32_t part, bool bad) {
        const Frame frame = part_frame(part, bad, bits);
        const auto inspection = pipeline.inspect(frame.view());
        ASSERT_TRUE(inspection);
        ASSERT_EQ(inspection->verdict, bad ? algo::Verdict::reject : algo::Verdict::pass);
        keeper.on_inspection(part, frame.view(), *inspection);
    }
    void write_all() {
        while (keeper.step()) {
        }
    }
    // "p12-reject" ...
    std::vector<std::string> kept() {
        write_all();
        std::vector<std::string> all;
        if (!std::filesystem::exists(folder.path() / "frames")) return all;
        for (const std::string& name : names(folder.path() / "frames")) {
            const auto from = name.find("-p") + 1;
            all.push_back(name.substr(from, name.size() - from - 4));
        }
        return all;
    }
    TempFolder folder;
    std::vector<std::string> said;
    int bits;
    algo::Pipeline pipeline;
    FrameRetention keeper;
};

}  // namespace hord::firmware::store::test
