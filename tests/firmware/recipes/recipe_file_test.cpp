#include "firmware/recipes/recipe_file.h"

#include <algorithm>
#include <fstream>

#include <fmt/format.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <unistd.h>

#include "common/file_writing.h"
#include "firmware/recipes/recipe_folder.h"

namespace hord::firmware {
namespace {

using ::testing::HasSubstr;

const std::filesystem::path kDeploy = std::filesystem::path(HORD_SOURCE_DIR) / "deploy";

TEST(Recipe, the_documented_file_is_the_defaults) {
    const auto numbered = load_numbered_recipe(kDeploy / "recipes/default.toml");
    ASSERT_TRUE(numbered) << numbered.error().what;
    const algo::Recipe* file = &numbered->recipe;
    const algo::Recipe d;
    EXPECT_EQ(
        std::tie(file->name, file->dark_dn, file->min_sum_dn, file->saturated_dn, file->min_area, file->rim_margin),
        std::tie(d.name, d.dark_dn, d.min_sum_dn, d.saturated_dn, d.min_area, d.rim_margin));
    EXPECT_EQ(std::tie(file->emd_limit_bins, file->frobenius_limit_bins, file->transmission_limit,
                       file->max_saturated_share, file->min_lit_share),
              std::tie(d.emd_limit_bins, d.frobenius_limit_bins, d.transmission_limit, d.max_saturated_share,
                       d.min_lit_share));
    EXPECT_EQ(std::tie(file->gradient, file->slopes, file->light), std::tie(d.gradient, d.slopes, d.light));
    EXPECT_TRUE(file->zones.empty());
}

TEST(Recipe, the_form_of_a_part_says_whether_a_frame_must_show_one) {
    const auto usual = parse_recipe("", "r.toml");
    EXPECT_EQ(std::tie(usual->form, usual->part_required), std::tuple(algo::PartForm::round, true));
    const auto web = parse_recipe("[part]\nform = \"web\"\n", "r.toml");
    EXPECT_EQ(std::tie(web->form, web->part_required), std::tuple(algo::PartForm::web, false));
    const auto tube = parse_recipe("[part]\nform = \"tube\"\npresent = \"unchecked\"\n", "r.toml");
    EXPECT_EQ(std::tie(tube->form, tube->part_required), std::tuple(algo::PartForm::tube, false));
    for (const auto& recipe : {*usual, *web, *tube}) {
        const auto again = parse_recipe(format_recipe({.recipe = recipe}), "r.toml");
        EXPECT_EQ(std::tie(again->form, again->part_required), std::tie(recipe.form, recipe.part_required));
    }
    const auto refused = parse_recipe("[part]\nform = \"web\"\npresent = \"required\"\n", "r.toml");
    ASSERT_FALSE(refused);
    EXPECT_THAT(refused.error().what, HasSubstr("web has no outline"));
    EXPECT_FALSE(refused.error().cure.empty());
    EXPECT_THAT(parse_recipe("[part]\nform = \"cube\"\n", "r.toml").error().what, HasSubstr("cube"));
}

TEST(Recipe, the_checks_of_light_and_outline_are_read_written_and_omitted_where_usual) {
    const auto usual = parse_recipe("", "r.toml");
    const std::string text = format_recipe({.recipe = *usual});
    for (const char* key :
         {"max_dark_rise_dn", "max_offset_bins", "max_spot_bins", "max_second_share", "period", "outline"})
        EXPECT_THAT(text, Not(HasSubstr(key)));
    const auto other = parse_recipe(
        "[part]\noutline = \"any\"\n[light]\nmax_dark_rise_dn = 40\nmax_offset_bins = 0\n"
        "max_spot_bins = 1.5\nmax_second_share = 0.2\nperiod = \"unchecked\"\n",
        "r.toml");
    ASSERT_TRUE(other) << other.error().message();
    const auto again = parse_recipe(format_recipe({.recipe = *other}), "r.toml");
    ASSERT_TRUE(again);
    for (const auto& recipe : {*other, *again}) {
        EXPECT_FALSE(recipe.symmetric_outline);
        EXPECT_FALSE(recipe.check_period);
        EXPECT_EQ(recipe.max_dark_rise_dn, 40U);
        EXPECT_EQ(recipe.max_offset_bins, 0);
        EXPECT_EQ(recipe.max_spot_bins, 1.5F);
        EXPECT_EQ(recipe.max_second_share, 0.2F);
    }
    const auto refused = parse_recipe("[light]\nmax_second_share = 2\nperiod = \"often\"\n", "r.toml");
    ASSERT_FALSE(refused);
    EXPECT_THAT(refused.error().what, HasSubstr("max_second_share"));
    EXPECT_THAT(refused.error().what, HasSubstr("often"));
}

TEST(Recipe, zones_are_circles_and_polygons) {
    const auto recipe = parse_recipe(R"(
[[zone]]
shape = "circle"
centre = [55, 54.5]
radius = 40
[[zone]]
use = "ignore"
shape = "polygon"
corners = [10, 11, 20, 10, 20, 30]
)",
                                     "r.toml");
    ASSERT_TRUE(recipe) << recipe.error().what;
    ASSERT_EQ(recipe->zones.size(), 2U);
    EXPECT_EQ(recipe->zones[0].use, algo::Zone::Use::inspect);
    EXPECT_FLOAT_EQ(recipe->zones[0].centre.n, 54.5F);
    EXPECT_FLOAT_EQ(recipe->zones[0].radius, 40.0F);
    EXPECT_EQ(recipe->zones[1].use, algo::Zone::Use::ignore);
    ASSERT_EQ(recipe->zones[1].corners.size(), 3U);
    EXPECT_FLOAT_EQ(recipe->zones[1].corners[0].n, 11.0F);
}

TEST(Recipe, zones_may_be_in_mm_from_the_middle_of_the_field) {
    const std::string text = R"(
[scale]
lenslet_mm = 0.216
[[zone]]
use = "ignore"
shape = "circle"
centre_mm = [-3.1, 1.7]
radius_mm = 0.3
[[zone]]
shape = "polygon"
corners_mm = [-5, -5, 5, -5, 0, 5]
)";
    const auto recipe = parse_numbered_recipe(text, "r.toml");
    ASSERT_TRUE(recipe) << recipe.error().message();
    const auto& zones = recipe->recipe.zones;
    ASSERT_EQ(zones.size(), 2U);
    EXPECT_EQ(zones[0].unit, algo::Zone::Unit::mm);
    EXPECT_EQ(zones[0].centre.m, -3.1F);
    EXPECT_EQ(zones[0].radius, 0.3F);
    EXPECT_EQ(zones[1].corners[2].n, 5);
    // Writing and reading returns the same values, bit for bit.
    const std::string written = format_recipe(*recipe);
    EXPECT_THAT(written, HasSubstr("centre_mm = [-3.1, 1.7]\nradius_mm = 0.3\n"));
    EXPECT_THAT(written, HasSubstr("corners_mm = [-5, -5, 5, -5, 0, 5]\n"));
    const auto again = parse_numbered_recipe(written, "again.toml");
    ASSERT_TRUE(again) << again.error().message();
    EXPECT_EQ(crc32_of(*again), crc32_of(*recipe));
    EXPECT_EQ(again->recipe.zones[0].unit, algo::Zone::Unit::mm);
}

TEST(Recipe, zones_in_mixed_units_or_without_the_lenslets_size_are_refused) {
    const auto problems = [](std::string_view text) {
        const auto recipe = parse_numbered_recipe(text, "r.toml");
        return recipe ? std::string() : recipe.error().message();
    };
    const std::string scale = "[scale]\nlenslet_mm = 0.2\n";
    const std::string in_mm = "[[zone]]\nshape = \"circle\"\ncentre_mm = [0, 0]\nradius_mm = 1\n";
    EXPECT_EQ(problems(scale + in_mm), "");
    EXPECT_THAT(problems(in_mm),
                AllOf(HasSubstr("is in mm, and the size of a lenslet is not known"),
                      HasSubstr("give [scale] lenslet_mm"), HasSubstr("r.toml:2")));
    EXPECT_THAT(problems(scale + "[[zone]]\nshape = \"circle\"\ncentre = [0, 0]\nradius_mm = 1\n"),
                HasSubstr("radius_mm: stands beside a place without _mm"));
    EXPECT_THAT(problems(scale + in_mm + "[[zone]]\nshape = \"circle\"\ncentre = [5, 5]\nradius = 2\n"),
                HasSubstr("has another unit than the zones before it"));
    EXPECT_THAT(problems(scale + "[[zone]]\nshape = \"circle\"\ncentre_mm = [0, 0]\n"),
                HasSubstr("radius_mm: is missing"));
    EXPECT_THAT(problems(scale + "[[zone]]\nshape = \"polygon\"\ncorners_mm = [0, 0, 1, 0, 1]\n"),
                HasSubstr("corners_mm"));
    EXPECT_THAT(problems(scale + "[[zone]]\nshape = \"polygon\"\ncorners_mm = [0, 0, 1, 0, 1, 1, 2]\n"),
                HasSubstr("give x and y of each corner"));
}

TEST(Recipe, problems_of_zones_are_told_with_their_cure) {
    const auto problems = [](std::string_view text) {
        const auto recipe = parse_recipe(text, "r.toml");
        return recipe ? std::string("no problem") : recipe.error().message();
    };
    EXPECT_THAT(problems("[[zone]]\nshape = \"circle\"\n"), HasSubstr("write centre = [m, n]"));
    const std::string not_a_number = problems("[[zone]]\nshape = \"circle\"\ncentre = [nan, 3]\nradius = 5\n");
    EXPECT_THAT(not_a_number, AllOf(HasSubstr("centre: is not a list of numbers"), Not(HasSubstr("is missing"))));
    EXPECT_THAT(problems("[[zone]]\nuse = \"ignore\"\n"), HasSubstr("shape: is missing"));
    EXPECT_THAT(problems("[[zone]]\nshape = \"polygon\"\ncorners = [1,2,3,4,5,6,7]\n"),
                HasSubstr("give m and n of each corner"));
    EXPECT_THAT(problems("[[zone]]\nshape = \"polygon\"\ncorners = [1,2,3,4]\n"), HasSubstr("has 4 numbers"));
    EXPECT_THAT(problems("[limits]\nemd_bin = 1\n"), HasSubstr("did you mean emd_bins?"));
    EXPECT_THAT(problems("[limits]\nemd_bins = 0\n"), HasSubstr("out of range"));
}

TEST(Recipe, what_it_says_survives_being_written_and_read) {
    const auto recipe = parse_numbered_recipe(R"(
name = "quo\"te \\ ä"
number = 12
version = 4
rim_margin = 2
[light]
dark_dn = 7
min_lit_share = 0.0512
[limits]
emd_bins = 0.123456
transmission = 0.333
[[zone]]
shape = "circle"
centre = [5.25, 6]
radius = 2.5
[[zone]]
use = "ignore"
shape = "polygon"
corners = [1, 2, 3, 4, 5.5, 0.1]
)",
                                              "r.toml");
    ASSERT_TRUE(recipe) << recipe.error().what;
    const std::string text = format_recipe(*recipe);
    const auto again = parse_numbered_recipe(text, "again.toml");
    ASSERT_TRUE(again) << again.error().what;
    EXPECT_EQ(format_recipe(*again), text);
    EXPECT_EQ(again->recipe.name, recipe->recipe.name);
    EXPECT_EQ(again->number, 12);
    EXPECT_EQ(again->version, 4U);
    EXPECT_EQ(again->recipe.emd_limit_bins, recipe->recipe.emd_limit_bins);
    ASSERT_EQ(again->recipe.zones.size(), 2U);
    EXPECT_EQ(again->recipe.zones[1].corners.size(), 3U);
    EXPECT_EQ(crc32_of(*again), crc32_of(*recipe));
    NumberedRecipe other = *recipe;
    other.recipe.zones[0].radius = 2.6F;
    EXPECT_NE(crc32_of(other), crc32_of(*recipe));
}

// Text and checksum of a recipe without `features` never change: stations have stored them.
TEST(Recipe, the_usual_features_are_not_written) {
    const std::string text = format_recipe({});
    EXPECT_EQ(text.find("features"), std::string::npos);
    EXPECT_EQ(text,
              format_recipe(*parse_numbered_recipe("features = [\"transmission\", \"emd\", \"jacobian-frobenius\"]\n",
                                                   "r.toml")));
    EXPECT_EQ(crc32_of(NumberedRecipe{}), 0x2571D927U);  // the checksum that stations have stored
}

TEST(Recipe, features_are_chosen_and_survive_being_written_and_read) {
    const struct {
        const char* text;
        std::optional<algo::Feature> gradient;
        bool slopes, light;
        float limit;
    } cases[] = {
        {"features = [\"chi2\", \"jacobian-frobenius\"]\n[limits]\nchi2 = 0.4\nfrobenius_bins = 0.3\n",
         algo::Feature::chi2, true, false, 0.4F},
        {"features = [\"marginal\"]\n[limits]\nmarginal_bins = 0.7\n", algo::Feature::marginal, false, false, 0.7F},
        {"features = [\"hellinger\", \"transmission\"]\n[limits]\nhellinger = 0.2\ntransmission = 0.8\n",
         algo::Feature::hellinger, false, true, 0.2F},
        {"features = [\"emd\"]\n[limits]\nemd_bins = 0.5\n", algo::Feature::emd, false, false, 0.5F},
        {"features = [\"transmission\"]\n", std::nullopt, false, true, 0},
    };
    for (const auto& c : cases) {
        const auto read = parse_numbered_recipe(c.text, "r.toml");
        ASSERT_TRUE(read) << read.error().what;
        const auto again = parse_numbered_recipe(format_recipe(*read), "again.toml");
        ASSERT_TRUE(again) << again.error().what;
        for (const algo::Recipe& recipe : {read->recipe, again->recipe}) {
            EXPECT_EQ(recipe.gradient, c.gradient) << c.text;
            EXPECT_EQ(recipe.slopes, c.slopes);
            EXPECT_EQ(recipe.light, c.light);
            EXPECT_EQ(limit_of_gradient(recipe), c.limit);
            EXPECT_TRUE(problems(recipe, {40, 36, 9, 9}).empty());
        }
        EXPECT_EQ(crc32_of(*again), crc32_of(*read));
        EXPECT_NE(crc32_of(*read), crc32_of(NumberedRecipe{}));
    }
}

TEST(Recipe, features_that_contradict_are_told_with_their_cure) {
    const auto said = [](std::string_view text) {
        const auto recipe = parse_recipe(text, "r.toml");
        return recipe ? std::string("no problem") : recipe.error().message();
    };
    EXPECT_THAT(said("features = [\"emd\", \"emd\"]\n"), HasSubstr("r.toml:1: features: has emd twice"));
    EXPECT_THAT(
        said("features = [\"edm\"]\n"),
        HasSubstr("has edm, which is none: use emd, marginal, hellinger, chi2, jacobian-frobenius, transmission"));
    EXPECT_THAT(said("features = [\"sliced\"]\n"), HasSubstr("has sliced, by which no part is judged"));
    EXPECT_THAT(said("features = [\"reference-chi2\"]\n"), HasSubstr("has reference-chi2, by which no part is judged"));
    EXPECT_THAT(said("features = [\"emd\", \"hellinger\"]\n[limits]\nhellinger = 1\n"),
                HasSubstr("has hellinger beside emd: compare neighbours by one distance"));
    EXPECT_THAT(said("features = []\n"), HasSubstr("leaves nothing to judge parts by"));
    EXPECT_THAT(said("features = [\"transmission\"]\n[limits]\ntransmission = 0\n"),
                HasSubstr("leaves nothing to judge parts by"));
    EXPECT_THAT(said("features = [\"chi2\"]\n"), HasSubstr("limits.chi2: is missing"));
    EXPECT_THAT(said("features = [\"chi2\"]\n[limits]\nchi2 = 3.5\n"), HasSubstr("out of range"));
    EXPECT_THAT(said("features = [\"transmission\"]\n[limits]\nemd_bins = 1\n"),
                HasSubstr("r.toml:3: limits.emd_bins: is a limit of emd, which is not among the features"));
    EXPECT_THAT(said("[limits]\nchi2 = 1\n"),
                HasSubstr("is a limit of chi2, which is not among the features: remove it, or add that to features"));
    EXPECT_THAT(said("features = [\"emd\"]\n[limits]\nfrobenius_bins = 1\ntransmission = 0.5\n"),
                HasSubstr("is a limit of transmission"));
    // An invalid value that was set without a file, as by registers, is refused when it is written and read.
    NumberedRecipe changed;
    changed.recipe.slopes = false;
    changed.recipe.frobenius_limit_bins = 0.7F;
    EXPECT_THAT(said(format_recipe(changed)), HasSubstr("is a limit of jacobian-frobenius"));
}

TEST(Recipe, for_another_program_and_with_a_broken_seal_is_refused) {
    EXPECT_FALSE(parse_numbered_recipe("schema = 2\n", "r.toml"));
    const auto broken = parse_numbered_recipe("crc32 = \"12345678\"\n", "r.toml");
    ASSERT_FALSE(broken);
    EXPECT_THAT(broken.error().what, HasSubstr("r.toml:1"));
}

// Reading a file refuses what the pipeline would refuse, with its line.
TEST(Recipe, limits_that_no_pipeline_takes_are_refused_at_reading) {
    for (const char* text : {"[limits]\ntransmission = 1\n", "[light]\nsaturated_dn = 65536\n",
                             "[light]\ndark_dn = 200\nsaturated_dn = 100\n"}) {
        const auto recipe = parse_numbered_recipe(text, "r.toml");
        EXPECT_FALSE(recipe) << text;
    }
}

TEST(RecipeFile, a_file_that_lost_a_part_of_it_is_refused_or_noted) {
    const std::string whole =
        "schema = 1\nname = \"lens\"\nnumber = 3\nversion = 1\n[limits]\nemd_bins = 0.5\n"
        "frobenius_bins = 0.5\ntransmission = 0.8\n[light]\ndark_dn = 2\n";
    const auto said = [](const std::string& text) {
        const auto recipe = parse_recipe_file(text, "r.toml");
        return recipe ? "" : recipe.error().message();
    };
    ASSERT_EQ(said(whole), "");
    const auto only_of_round_parts = ::testing::ElementsAre(HasSubstr("a round part is compared with itself"));
    EXPECT_THAT(notes(*parse_recipe_file(whole, "r.toml")), only_of_round_parts);
    // Cut anywhere: refused, or its notes name the limits that were lost.
    for (std::size_t length = 0; length < whole.find("[light]"); ++length) {
        const std::string rest = whole.substr(0, length);
        const auto recipe = parse_recipe_file(rest, "r.toml");
        if (!rest.ends_with('\n')) {
            EXPECT_FALSE(recipe) << rest;
        } else if (recipe) {
            EXPECT_EQ(rest.find("transmission") == rest.npos,
                      !notes(*recipe).empty() && notes(*recipe).back().find("transmission") != std::string::npos)
                << rest;
        }
    }
    EXPECT_THAT(said(whole.substr(0, whole.size() - 1)), HasSubstr("r.toml:10: the last line has no line end"));
    EXPECT_THAT(said(whole.substr(whole.find("name"))), HasSubstr("schema: is missing: write schema = 1"));
    const auto cut = parse_recipe_file(whole.substr(0, whole.find("[limits]")), "r.toml");
    ASSERT_TRUE(cut);
    EXPECT_THAT(cut->unset_limits, ::testing::ElementsAre("emd_bins", "frobenius_bins", "transmission"));
    EXPECT_THAT(notes(*cut).back(), HasSubstr("transmission = "));
    const auto light = parse_recipe_file("schema = 1\nfeatures = [\"transmission\"]\n", "r.toml");
    ASSERT_TRUE(light) << light.error().message();
    EXPECT_THAT(light->unset_limits, ::testing::ElementsAre("transmission")) << "those of its features";
    // What the programs write is whole.
    const auto written = parse_recipe_file(format_recipe(*cut), "r.toml");
    ASSERT_TRUE(written) << written.error().message();
    EXPECT_THAT(notes(*written), ::testing::Each(::testing::Not(HasSubstr("does not set"))));
}

TEST(RecipeFile, an_inspect_zone_outside_of_every_field_is_noted) {
    const auto noted = [](const std::string& place, const std::string& use = "inspect") {
        const auto recipe = parse_numbered_recipe(
            "[scale]\nlenslet_mm = 0.1\n[[zone]]\nuse = \"" + use + "\"\nshape = \"circle\"\n" + place, "r.toml");
        EXPECT_TRUE(recipe) << recipe.error().message();
        const auto all = recipe ? algo::notes(recipe->recipe) : std::vector<std::string>();
        return std::ranges::any_of(
            all, [](const std::string& note) { return note.starts_with("an inspect zone lies outside"); });
    };
    EXPECT_TRUE(noted("centre = [-20, 50]\nradius = 10\n"));
    EXPECT_TRUE(noted("centre = [50, 5000]\nradius = 10\n"));
    EXPECT_TRUE(noted("centre_mm = [40, 0]\nradius_mm = 1\n"));
    EXPECT_FALSE(noted("centre = [-5, 50]\nradius = 10\n"));
    EXPECT_FALSE(noted("centre = [500, 500]\nradius = 10\n")) << "on a large field";
    EXPECT_FALSE(noted("centre_mm = [0, 0]\nradius_mm = 1\n"));
    EXPECT_FALSE(noted("centre = [-20, 50]\nradius = 10\n", "ignore"));
}

TEST(RecipeFile, a_name_that_registers_cut_is_noted) {
    NumberedRecipe recipe;
    recipe.recipe.name = "Glas für die Linsen der Zelle Süd";
    EXPECT_THAT(notes(recipe), ::testing::Contains(HasSubstr("name has 35 bytes, and registers hold 32")));
    recipe.recipe.name = "Zelle Süd";
    EXPECT_THAT(notes(recipe), ::testing::Each(::testing::Not(HasSubstr("bytes"))));
}

TEST(RecipeInUse, is_remembered_until_another_one_is_configured) {
    const auto folder = std::filesystem::temp_directory_path() / ("hord-recipes-" + std::to_string(::getpid()));
    std::filesystem::create_directories(folder);
    NumberedRecipe in_use;
    in_use.number = 5;
    const NumberedRecipe configured{.number = 1}, other{.number = 2};
    ASSERT_TRUE(remember_recipe(folder / "in-use", crc32_of(configured), in_use));
    const auto again = remembered_recipe(folder / "in-use", configured);
    ASSERT_TRUE(again && *again && (*again)->recipe);
    EXPECT_EQ((*again)->recipe->number, 5);
    EXPECT_EQ((*again)->crc32, crc32_of(in_use));
    const auto over = remembered_recipe(folder / "in-use", other);  // another one is configured meanwhile
    ASSERT_TRUE(over && *over);
    EXPECT_FALSE((*over)->recipe);
    EXPECT_EQ((*over)->crc32, crc32_of(in_use));
    ASSERT_TRUE(remember_recipe(folder / "as configured", crc32_of(configured), configured));
    const auto edited = remembered_recipe(folder / "as configured", other);  // nobody had chosen another one
    ASSERT_TRUE(edited && *edited);
    EXPECT_FALSE((*edited)->recipe);
    EXPECT_EQ((*edited)->crc32, crc32_of(configured));
    EXPECT_FALSE(remembered_recipe(folder / "nowhere", configured)->has_value());
    in_use.reference_file = folder / "gone.hordref";
    ASSERT_TRUE(remember_recipe(folder / "in-use", crc32_of(configured), in_use));
    const auto lost = remembered_recipe(folder / "in-use", configured);
    ASSERT_FALSE(lost);
    EXPECT_THAT(lost.error().what, HasSubstr("gone.hordref"));
    std::filesystem::remove_all(folder);
}

TEST(RecipeInUse, is_refused_wherever_it_was_cut_or_changed) {
    const auto folder = std::filesystem::path(::testing::TempDir()) / fmt::format("hord-in-use-{}", ::getpid());
    std::filesystem::create_directories(folder);
    const auto file = folder / "in-use";
    const auto write = [&](std::string_view text) { std::ofstream(file, std::ios::binary) << text; };
    const NumberedRecipe configured{.number = 1};
    NumberedRecipe in_use{.number = 70};
    in_use.recipe.emd_limit_bins = 0.1F;
    in_use.recipe.min_area = 12;
    ASSERT_TRUE(remember_recipe(file, crc32_of(configured), in_use));
    const std::string whole = common::read_file(file).value();
    const auto refused = [&](std::string_view text) {
        write(text);
        const auto read = remembered_recipe(file, configured);
        return !read && read.error().code == ErrorCode::invalid_argument &&
            read.error().what.find(file.string()) != std::string::npos && !std::filesystem::exists(file) &&
            common::read_file(damaged_recipe(file)) == text;
    };
    for (std::size_t size = 0; size < whole.size(); ++size)
        EXPECT_TRUE(refused(whole.substr(0, size))) << "cut behind byte " << size;
    for (std::size_t k = 0; k < whole.size(); ++k) {
        std::string other = whole;
        other[k] ^= 1;
        EXPECT_TRUE(refused(other)) << "changed byte " << k;
    }
    EXPECT_TRUE(refused(std::string(whole.size(), '\0')));
    write(whole);
    std::filesystem::resize_file(file, std::uintmax_t{3} << 30U);  // is not read into memory
    EXPECT_FALSE(remembered_recipe(file, configured));
    EXPECT_FALSE(std::filesystem::exists(file));
    std::filesystem::remove(damaged_recipe(file));
    std::filesystem::remove(file);
    std::filesystem::create_directories(file);
    EXPECT_FALSE(remembered_recipe(file, configured)) << "a folder in its place";
    std::filesystem::remove_all(folder);
}

TEST(RecipeInUse, of_an_earlier_version_is_taken_if_it_has_its_last_line_end_and_its_limits) {
    const auto folder = std::filesystem::path(::testing::TempDir()) / fmt::format("hord-in-use-old-{}", ::getpid());
    std::filesystem::create_directories(folder);
    const NumberedRecipe configured{.number = 1};
    const std::string head =
        fmt::format("# In use since it was committed. Configured then: {:08X}\n", crc32_of(configured));
    const std::string whole = head + format_recipe(NumberedRecipe{.number = 70});
    const auto read = [&](std::string_view text) {
        std::ofstream(folder / "in-use", std::ios::binary) << text;
        return remembered_recipe(folder / "in-use", configured);
    };
    const auto taken = read(whole);
    ASSERT_TRUE(taken && *taken);
    EXPECT_EQ((*taken)->recipe.value().number, 70);
    EXPECT_EQ((*taken)->crc32, 0U);
    EXPECT_FALSE(read(whole.substr(0, whole.size() - 1)));
    EXPECT_FALSE(read(whole.substr(0, whole.find("emd_bins"))));
    EXPECT_FALSE(read(head));
    std::filesystem::remove_all(folder);
}

}  // namespace
}  // namespace hord::firmware
