#include "firmware/station/empty_line_proof.h"

#include <gtest/gtest.h>

#include "tests/support/temp_folder.h"

namespace hord::firmware {
namespace {

using testing_support::TempFolder;

TEST(EmptyLineProof, holds_for_the_next_process_only) {
    const TempFolder folder;
    const EmptyLineProof proof(folder.path());
    EXPECT_FALSE(proof.withdraw().value());  // a new folder proves nothing
    ASSERT_TRUE(proof.give());
    EXPECT_TRUE(EmptyLineProof(folder.path()).withdraw().value());
    EXPECT_FALSE(EmptyLineProof(folder.path()).withdraw().value());  // the process before has crashed
}

TEST(EmptyLineProof, a_file_that_is_not_whole_proves_nothing) {
    const TempFolder folder;
    const EmptyLineProof proof(folder.path());
    ASSERT_TRUE(proof.give());
    const auto file = folder.path() / "line-empty";
    std::filesystem::resize_file(file, std::filesystem::file_size(file) - 1);
    EXPECT_FALSE(proof.withdraw().value());
    folder.write("line-empty", "");
    EXPECT_FALSE(proof.withdraw().value());
}

// A folder in the file's place stands for a disk that can neither be written nor read.
TEST(EmptyLineProof, a_disk_that_fails_is_told_and_proves_nothing) {
    const TempFolder folder;
    std::filesystem::create_directories(folder.path() / "line-empty" / "x");
    const EmptyLineProof proof(folder.path());
    EXPECT_FALSE(proof.withdraw());
    EXPECT_FALSE(proof.give());
    EXPECT_FALSE(EmptyLineProof(folder.path() / "gone").withdraw());
}

TEST(EmptyLineProof, without_a_folder_nothing_is_proven) {
    const EmptyLineProof proof{{}};
    EXPECT_TRUE(proof.give());
    EXPECT_FALSE(proof.withdraw().value());
}

}  // namespace
}  // namespace hord::firmware
