// A run that was interrupted continues; one with other parameters does not.
#include "lab/experiment/result_cache.h"

#include <fstream>
#include <iterator>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "tests/lab/support/folder.h"

namespace hord::lab {
namespace {

using test::Folder;

const Json kParameters{{"experiment", "test"}, {"seed", 1}};

std::string text_of(const std::filesystem::path& file) {
    std::ifstream stream(file);
    return {std::istreambuf_iterator<char>(stream), {}};
}

TEST(ResultCache, finished_cells_are_taken_up_to_the_bit_and_not_computed_again) {
    const Folder folder;
    const auto file = folder.path() / "cells.jsonl";
    int computed = 0;
    const auto compute = [&]() -> Result<Json> { return Json{{"value", 0.1 + 0.2}, {"time", ++computed}}; };
    {
        auto cells = ResultCache::open(file, kParameters);
        ASSERT_TRUE(cells);
        ASSERT_TRUE(cells->value("a", compute));
    }
    auto cells = ResultCache::open(file, kParameters);
    ASSERT_TRUE(cells);
    EXPECT_EQ(cells->taken_up(), 1U);
    const auto kept = cells->value("a", compute);
    ASSERT_TRUE(kept);
    EXPECT_EQ((*kept)["value"].get<double>(), 0.1 + 0.2);
    EXPECT_EQ(computed, 1);
    ASSERT_TRUE(cells->value("b", compute));
    EXPECT_EQ(computed, 2);
    EXPECT_EQ(cells->size(), 2U);
}

TEST(ResultCache, a_line_cut_off_by_an_interrupt_is_dropped_and_the_file_stays_whole) {
    const Folder folder;
    const auto file = folder.path() / "cells.jsonl";
    {
        auto cells = ResultCache::open(file, kParameters);
        ASSERT_TRUE(cells && cells->add("a", 1) && cells->add("b", 2));
    }
    const auto size = std::filesystem::file_size(file);
    for (std::uintmax_t cut = 1; cut <= 23; ++cut) {
        SCOPED_TRACE(cut);
        const auto torn = folder.path() / ("torn" + std::to_string(cut) + ".jsonl");
        std::filesystem::copy_file(file, torn);
        std::filesystem::resize_file(torn, size - cut);
        auto cells = ResultCache::open(torn, kParameters);
        ASSERT_TRUE(cells);
        EXPECT_NE(cells->find("a"), nullptr);
        EXPECT_EQ(cells->find("b"), nullptr);
        ASSERT_TRUE(cells->add("b", 2));
        EXPECT_EQ(text_of(torn), text_of(file));
    }
}

TEST(ResultCache, a_file_whose_first_line_was_cut_off_is_begun_again) {
    const Folder folder;
    const auto file = folder.path() / "cells.jsonl";
    std::ofstream(file) << R"({"experi)";
    const auto cells = ResultCache::open(file, kParameters);
    ASSERT_TRUE(cells);
    EXPECT_EQ(cells->size(), 0U);
    EXPECT_TRUE(ResultCache::open(file, kParameters));
}

TEST(ResultCache, other_parameters_and_foreign_files_are_refused_with_the_cure) {
    const Folder folder;
    const auto file = folder.path() / "cells.jsonl";
    ASSERT_TRUE(ResultCache::open(file, kParameters));
    const auto other = ResultCache::open(file, Json{{"experiment", "test"}, {"seed", 2}});
    ASSERT_FALSE(other);
    EXPECT_THAT(other.error().message(), ::testing::HasSubstr("another --out folder"));
    std::ofstream(file, std::ios::app) << "not a cell\n";
    EXPECT_FALSE(ResultCache::open(file, kParameters));
    const auto nowhere = ResultCache::open(folder.path() / "no" / "such.jsonl", kParameters);
    ASSERT_FALSE(nowhere);
    EXPECT_EQ(nowhere.error().code, ErrorCode::io);
}

}  // namespace
}  // namespace hord::lab
