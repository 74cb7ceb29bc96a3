// A reference as a file: what is written is read again, damaged files are refused; and recipes that name a reference.
#include "firmware/recipes/reference_file.h"

#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <filesystem>
#include <fstream>
#include <iterator>

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <sys/stat.h>

#include "algo/reference/pooled_scores.h"
#include "common/crc32.h"
#include "firmware/recipes/recipe_file.h"

namespace hord::firmware {
namespace {

using ::testing::HasSubstr;

algo::Reference small() {
    algo::Reference r;
    r.extents = {5, 4, 3, 3};
    r.bits = 12;
    r.levels = {6, 60, 4095};
    r.sensor = {1.5F, 2.0F, 6.0F};
    r.parts = 9;
    const std::size_t count = r.extents.lenslets();
    r.shares.assign(count * r.stride(), 0);
    r.light.assign(count, 1234.5F);
    r.x.assign(count, 0.25F);
    r.y.assign(count, -0.5F);
    r.mask.assign(count, 0);
    for (auto& map : r.spread) map.assign(count, 1e-4F);
    r.emd.assign(count, 0.1F);
    r.frobenius.assign(count, 0.05F);
    r.pooled_scales.assign(algo::pooled_filters().size(), 1.25F);
    r.size_limits = {0.25F, 0.5F};
    r.blur_limits = {0.125F, 0.75F};
    r.patch_limit = 6.5F;
    for (std::size_t k = 0; k < count; ++k)
        r.shares[k * r.stride() + r.place(1, 1)] = static_cast<std::uint16_t>(30000 + k);
    return r;
}

class ReferenceFile : public ::testing::Test {
  protected:
    void SetUp() override {
        std::string pattern = (std::filesystem::temp_directory_path() / "hord-reference-XXXXXX").string();
        ASSERT_NE(mkdtemp(pattern.data()), nullptr);
        folder = pattern;
        file = folder / "part.hordref";
        ASSERT_TRUE(write_reference(file, small()));
    }
    void TearDown() override { std::filesystem::remove_all(folder); }
    [[nodiscard]] std::string text() const {
        std::ifstream stream(file, std::ios::binary);
        return {std::istreambuf_iterator<char>(stream), {}};
    }
    void put(const std::string& bytes) const { std::ofstream(file, std::ios::binary) << bytes; }
    std::filesystem::path folder, file;
};

TEST_F(ReferenceFile, what_is_written_is_read) {
    const auto read = read_reference(file);
    ASSERT_TRUE(read) << read.error().message();
    const algo::Reference &a = **read, b = small();
    EXPECT_EQ(a.extents, b.extents);
    EXPECT_EQ(a.shares, b.shares);
    EXPECT_EQ(a.light, b.light);
    EXPECT_EQ(a.x, b.x);
    EXPECT_EQ(a.y, b.y);
    EXPECT_EQ(a.mask, b.mask);
    EXPECT_EQ(a.spread, b.spread);
    EXPECT_EQ(a.emd, b.emd);
    EXPECT_EQ(a.frobenius, b.frobenius);
    EXPECT_EQ(a.pooled_scales, b.pooled_scales);
    EXPECT_EQ(a.size_limits, b.size_limits);
    EXPECT_EQ(a.blur_limits, b.blur_limits);
    EXPECT_EQ(a.patch_limit, b.patch_limit);
    EXPECT_EQ(a.parts, b.parts);
    EXPECT_EQ(a.sensor.clip_dn, b.sensor.clip_dn);
    EXPECT_EQ(a.levels.saturated, b.levels.saturated);
}

TEST_F(ReferenceFile, a_damaged_byte_is_noticed) {
    const std::string whole = text();
    for (std::size_t at = 0; at < whole.size(); at += 11) {
        std::string damaged = whole;
        damaged[at] = static_cast<char>(damaged[at] ^ 0x40);
        put(damaged);
        EXPECT_FALSE(read_reference(file)) << "byte " << at;
    }
}

TEST_F(ReferenceFile, what_is_cut_off_of_another_version_or_missing_is_refused_with_a_cure) {
    const std::string whole = text();
    for (const std::size_t size :
         {std::size_t{0}, std::size_t{7}, std::size_t{20}, whole.size() / 2, whole.size() - 1}) {
        put(whole.substr(0, size));
        EXPECT_FALSE(read_reference(file)) << size << " bytes";
    }
    std::string newer = whole;
    newer[8] = 5;
    put(newer);
    const auto refused = read_reference(file);
    ASSERT_FALSE(refused);
    EXPECT_EQ(refused.error().code, ErrorCode::unsupported);
    EXPECT_THAT(refused.error().cure, HasSubstr("hordctl learn"));
    EXPECT_EQ(read_reference(folder / "none").error().code, ErrorCode::not_found);
}

TEST_F(ReferenceFile, that_cannot_be_read_says_why) {
    const auto refusal = [](const std::filesystem::path& path) {
        const auto read = read_reference(path);
        return read ? "none" : read.error().message();
    };
    const std::string cure = "): give a file that hordctl learn has written", pipe = folder / "pipe.hordref";
    EXPECT_EQ(refusal(folder), folder.string() + ": cannot be read (Is a directory" + cure);
    ASSERT_EQ(::mkfifo(pipe.c_str(), 0600), 0);
    EXPECT_EQ(refusal(pipe), pipe + " is a pipe, not a regular file" + cure.substr(1));
    EXPECT_EQ(refusal("/dev/zero"), "/dev/zero is a device, not a regular file" + cure.substr(1));
    std::filesystem::remove(pipe);
}

// Bytes of a file before its checksum, as an older version has them.
std::string as_version(char version, const std::string& whole) {
    const std::size_t scales = 4 * algo::pooled_filters().size(), end = whole.size() - 4 - scales;
    const std::size_t fourth = sizeof small().blur_limits + sizeof small().patch_limit,
                      sizes = version < 3 ? sizeof small().size_limits : 0;
    std::string older = whole.substr(0, end - fourth - sizes);
    if (version >= 2) older += whole.substr(end, scales);
    older[8] = version;
    const std::uint32_t sum = common::crc32(older);
    return older.append(reinterpret_cast<const char*>(&sum), sizeof sum);
}

TEST_F(ReferenceFile, the_third_version_is_read_and_judges_neither_blur_nor_squares) {
    put(as_version(3, text()));
    const auto read = read_reference(file);
    ASSERT_TRUE(read) << read.error().message();
    EXPECT_EQ((*read)->size_limits, small().size_limits);
    EXPECT_EQ((*read)->pooled_scales, small().pooled_scales);
    EXPECT_EQ((*read)->blur_limits, (std::array<float, 2>{}));
    EXPECT_EQ((*read)->patch_limit, 0);
}

TEST_F(ReferenceFile, the_second_version_is_read_and_refuses_no_size) {
    put(as_version(2, text()));
    const auto read = read_reference(file);
    ASSERT_TRUE(read) << read.error().message();
    EXPECT_EQ((*read)->pooled_scales, small().pooled_scales);
    EXPECT_EQ((*read)->size_limits, (std::array<float, 2>{}));
}

// A program of before wrote no scales of what lenslets show together.
TEST_F(ReferenceFile, the_first_version_is_read_and_judges_no_lenslets_together) {
    put(as_version(1, text()));
    const auto read = read_reference(file);
    ASSERT_TRUE(read) << read.error().message();
    EXPECT_TRUE((*read)->pooled_scales.empty());
    EXPECT_EQ((*read)->frobenius, small().frobenius);
    algo::Recipe recipe;
    recipe.reference = *read;
    EXPECT_TRUE(notes(recipe).empty());
    recipe.pooled_score = 7;
    ASSERT_EQ(notes(recipe).size(), 1U);
    EXPECT_THAT(notes(recipe)[0], HasSubstr("pooled_score changes nothing"));
}

TEST_F(ReferenceFile, what_is_not_sound_is_not_written) {
    algo::Reference few = small();
    few.parts = 7;
    EXPECT_FALSE(write_reference(file, few));
    algo::Reference wild = small();
    wild.light[3] = -1;
    EXPECT_FALSE(write_reference(file, wild));
    algo::Reference no_limit = small();
    no_limit.size_limits[1] = std::numeric_limits<float>::quiet_NaN();
    EXPECT_FALSE(write_reference(file, no_limit));
}

TEST_F(ReferenceFile, a_recipe_that_names_it_survives_being_written_and_read) {
    const std::filesystem::path recipe = folder / "r.toml";
    std::ofstream(recipe) << "schema = 1\n[scale]\nlenslet_mm = 0.5\nbin_rad = 0.015\n[reference]\nfile = "
                             "\"part.hordref\"\nreject_score = 5.5\npooled_score = 6.25\n"
                             "[[tolerate]]\nkinds = [\"scratch\", \"absorbing\"]\nlargest_mm = 1.5\ndeepest_rad = "
                             "0.01\nnumber = 3\nshape = \"circle\"\ncentre = [0.5, -0.25]\nradius = 0.75\n";
    const auto once = load_numbered_recipe(recipe);
    ASSERT_TRUE(once) << once.error().message();
    ASSERT_TRUE(once->recipe.reference);
    EXPECT_EQ(once->recipe.reject_score, 5.5F);
    EXPECT_EQ(once->recipe.pooled_score, 6.25F);
    ASSERT_EQ(once->recipe.tolerances.size(), 1U);
    const algo::Tolerance& t = once->recipe.tolerances[0];
    EXPECT_TRUE(t.applies_to(algo::DefectKind::scratch) && t.applies_to(algo::DefectKind::absorbing) &&
                !t.applies_to(algo::DefectKind::surface));
    ASSERT_TRUE(t.where);
    EXPECT_FLOAT_EQ(t.where->centre.m, 3);  // the middle of 5 is 2, and 0.5 mm is a lenslet
    EXPECT_FLOAT_EQ(t.where->centre.n, 1);
    EXPECT_FLOAT_EQ(t.where->radius, 1.5F);
    const auto twice = parse_numbered_recipe(format_recipe(*once), "again");
    ASSERT_TRUE(twice) << twice.error().message();
    EXPECT_EQ(format_recipe(*twice), format_recipe(*once));
}

TEST_F(ReferenceFile, where_something_is_tolerated_may_be_named_with_mm_as_zones_are) {
    const auto read = [&](const std::string& place) {
        std::ofstream(folder / "r.toml") << "schema = 1\n[scale]\nlenslet_mm = 0.5\n[reference]\nfile = "
                                            "\"part.hordref\"\n[[tolerate]]\nlargest_mm = 1.5\n"
                                         << place;
        return load_numbered_recipe(folder / "r.toml");
    };
    const auto plain = read("shape = \"circle\"\ncentre = [0.5, -0.25]\nradius = 0.75\n"),
               named = read("shape = \"circle\"\ncentre_mm = [0.5, -0.25]\nradius_mm = 0.75\n");
    ASSERT_TRUE(plain) << plain.error().message();
    ASSERT_TRUE(named) << named.error().message();
    EXPECT_EQ(crc32_of(*named), crc32_of(*plain));
    EXPECT_FLOAT_EQ(named->recipe.tolerances[0].where->centre.m, 3);
    EXPECT_EQ(named->recipe.tolerances[0].where->unit, algo::Zone::Unit::lenslets);
    EXPECT_FALSE(read("shape = \"circle\"\ncentre_mm = [0.5, -0.25]\nradius = 0.75\n"));
    // Zones in lenslets are allowed beside a tolerance in mm.
    EXPECT_TRUE(
        read("shape = \"circle\"\ncentre_mm = [0.5, -0.25]\nradius_mm = 0.75\n[[zone]]\nshape = \"circle\"\ncentre = "
             "[2, 2]\nradius = 1\n"));
}

TEST_F(ReferenceFile, a_seal_covers_what_is_in_it_and_not_where_it_lies) {
    const auto recipe_in = [](const std::filesystem::path& where, const std::string& seal) {
        std::ofstream(where / "r.toml") << "schema = 1\n" << seal << "[reference]\nfile = \"part.hordref\"\n";
        return load_numbered_recipe(where / "r.toml");
    };
    const auto open = recipe_in(folder, "");
    ASSERT_TRUE(open) << open.error().message();
    char seal[32];
    std::snprintf(seal, sizeof seal, "crc32 = \"%08X\"\n", crc32_of(*open));
    EXPECT_TRUE(recipe_in(folder, seal));

    const std::filesystem::path elsewhere = folder / "moved" / "here";
    std::filesystem::create_directories(elsewhere);
    std::filesystem::copy_file(file, elsewhere / "part.hordref");
    const auto moved = recipe_in(elsewhere, seal);
    EXPECT_TRUE(moved) << moved.error().message();

    algo::Reference other = small();
    other.light[3] += 1;
    ASSERT_TRUE(write_reference(elsewhere / "part.hordref", other));
    const auto changed = recipe_in(elsewhere, seal);
    ASSERT_FALSE(changed);
    EXPECT_THAT(changed.error().message(), HasSubstr("crc32"));
}

TEST_F(ReferenceFile, its_checksum_is_the_one_of_the_file) {
    const std::string whole = text();
    std::uint32_t at_end = 0;
    std::memcpy(&at_end, whole.data() + whole.size() - sizeof at_end, sizeof at_end);
    EXPECT_EQ(crc32_of(std::make_shared<const algo::Reference>(small())), at_end);
}

TEST(Recipe, says_nothing_new_where_there_is_no_reference) {
    const std::string text = format_recipe({});
    for (const char* key : {"[scale]", "[reference]", "[[tolerate]]"})
        EXPECT_THAT(text, ::testing::Not(HasSubstr(key)));
}

TEST(Recipe, a_missing_reference_is_one_problem_among_all) {
    const auto refused = parse_recipe(
        "schema = 1\n[reference]\nfile = \"/nowhere/x.hordref\"\ngrow_score = 9.0\n[[tolerate]]\nlargest_mm = 1.0\n",
        "r.toml");
    ASSERT_FALSE(refused);
    for (const char* problem : {"/nowhere/x.hordref", "grow_score", "lenslet_mm"})
        EXPECT_THAT(refused.error().what + refused.error().cure, HasSubstr(problem));
}

}  // namespace
}  // namespace hord::firmware
