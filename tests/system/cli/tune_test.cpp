// `hordctl tune` as a person meets it: choices, written files, refusals.
#include <algorithm>
#include <cmath>
#include <fstream>
#include <iterator>
#include <map>
#include <random>

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <nlohmann/json.hpp>

#include "drivers/files/frame_file.h"
#include "tests/support/frames.h"
#include "tests/system/cli/program.h"

namespace hord::test {
namespace {

using ::testing::AnyOf;
using ::testing::HasSubstr;
using ::testing::Not;
using Json = nlohmann::json;

constexpr int kColumns = 26, kRows = 24;
enum class Flaw { none, speck, haze, dent };

// A weak lens that fills the field, 12 bits in a 16-bit file, one electron a DN. A speck takes a fifth of the light of
// nine lenslets. Haze widens their spots by sqrt(2) without loss of light; their mean deflection is unchanged.
// A dent moves them by a bin and takes half of their light: every feature sees it.
// `again`: the seed of another exposure's noise.
Frame part(std::uint64_t seed, Flaw flaw, int columns = kColumns, std::uint64_t again = 0) {
    std::mt19937_64 random(seed);
    std::normal_distribution<double> normal;
    std::uniform_real_distribution<double> wobble(-0.3, 0.3);
    const double x0 = wobble(random), y0 = wobble(random);
    if (again != 0) random.seed(again);
    Frame frame(columns * 9, kRows * 9, 12);
    for (int y = 0; y < frame.height_px(); ++y) {
        for (int x = 0; x < frame.width_px(); ++x) {
            const int m = x / 9, n = y / 9;
            const bool flawed = std::abs(m - 15) <= 1 && std::abs(n - 9) <= 1, dent = flawed && flaw == Flaw::dent;
            const double dx = x % 9 - 4 - 0.08 * (m - 12.5 - x0) - (dent ? 1 : 0),
                         dy = y % 9 - 4 - 0.06 * (n - 11.5 - y0);
            const double r2 = dx * dx + dy * dy;
            double light = (dent ? 500 : 1000) * std::exp(-r2 / 0.7);
            if (flawed && flaw == Flaw::speck) light *= 0.8;
            if (flawed && flaw == Flaw::haze) light = 500 * std::exp(-r2 / 1.4);
            const double noisy = light + std::sqrt(light + 4) * normal(random);
            frame.set(x, y, static_cast<std::uint32_t>(std::clamp(std::lround(noisy), 0L, 4095L)));
        }
    }
    return frame;
}

std::string text_of(const std::string& file) {
    std::ifstream stream(file, std::ios::binary);
    return {std::istreambuf_iterator<char>(stream), {}};
}

// The drawn part fills the field.
constexpr const char* kFillsField = "schema = 1\n[part]\npresent = \"unchecked\"\n";

class Tune : public ::testing::Test {
  protected:
    void write(const std::string& name, const Frame& frame) {
        ASSERT_TRUE(drivers::write_frame(folder / name, frame.view()));
    }
    void frames(int good, int bad, Flaw flaw) {
        std::filesystem::create_directories(folder / "good");
        std::filesystem::create_directories(folder / "bad");
        for (int k = 0; k < good; ++k)
            write("good/" + std::to_string(10 + k) + ".png", part(static_cast<std::uint64_t>(k) + 1, Flaw::none));
        for (int k = 0; k < bad; ++k)
            write("bad/" + std::to_string(10 + k) + ".png", part(static_cast<std::uint64_t>(k) + 1001, flaw));
    }
    Said tune(std::vector<std::string> more) {
        std::vector<std::string> arguments{"tune", "--good", folder / "good", "--bad", folder / "bad", "--bits", "12"};
        if (std::ranges::find(more, "--recipe") == more.end()) {
            std::ofstream(folder / "unchecked.toml") << kFillsField;
            arguments.insert(arguments.end(), {"--recipe", folder / "unchecked.toml"});
        }
        arguments.insert(arguments.end(), more.begin(), more.end());
        return run("hordctl", arguments);
    }
    int judge(std::uint64_t seed, Flaw flaw, const std::string& recipe) {
        write("part.png", part(seed, flaw));
        return run("hordctl", {"inspect", folder / "part.png", "--bits", "12", "--recipe", folder / recipe}).status;
    }
    TemporaryFolder folder;
};

// The sets of an answer, by name, without their times.
std::map<std::string, Json> without_times(const std::string& out) {
    std::map<std::string, Json> all;
    const Json json = Json::parse(out);
    for (Json set : json.at("feature_sets")) {
        set.erase("ms");
        set.erase("fits");
        set.erase("behind_best");  // the best may tie
        const auto name = set.at("feature_set").get<std::string>();
        all[name] = std::move(set);
    }
    return all;
}

void expect_the_fastest_that_is_as_good(const Json& json) {
    double best = 0;
    for (const Json& set : json.at("feature_sets"))
        best = std::max(best, set.at("fits").get<bool>() ? set.at("auc").at("value").get<double>() : 0.0);
    double least = 1e300, chosen = 0;
    for (const Json& set : json.at("feature_sets")) {
        if (!set.at("fits").get<bool>() || set.at("auc").at("value").get<double>() < best - 0.005 - 1e-9) continue;
        least = std::min(least, set.at("ms").at("wall").get<double>());
        if (set.at("feature_set") == json.at("chosen")) chosen = set.at("ms").at("wall").get<double>();
    }
    EXPECT_GT(chosen, 0) << json.at("chosen");
    EXPECT_LE(chosen, 1.05 * least);
}

TEST_F(Tune, frames_that_are_told_apart_worse_than_by_guessing_are_refused) {
    frames(8, 8, Flaw::dent);
    for (const auto& [from, to] : {std::pair("good", "kept"), {"bad", "good"}, {"kept", "bad"}})  // exchanged
        std::filesystem::rename(folder / from, folder / to);
    const Said said = tune({"--budget", "100000", "--out", folder / "lens.toml"});
    EXPECT_EQ(said.status, 2);
    EXPECT_THAT(said.err, HasSubstr("no feature set tells these frames apart"));
    EXPECT_FALSE(std::filesystem::exists(folder / "lens.toml"));
}

TEST_F(Tune, parts_that_lack_light_are_judged_by_their_light) {
    frames(12, 8, Flaw::speck);
    const Said said = tune({"--budget", "100000", "--out", folder / "lens.toml", "--json"});
    ASSERT_EQ(said.status, 0) << said.err;
    const Json json = Json::parse(said.out);
    expect_the_fastest_that_is_as_good(json);
    EXPECT_THAT(json.at("chosen").get<std::string>(), HasSubstr("transmission"));
    const auto sets = without_times(said.out);
    ASSERT_EQ(sets.size(), 11U);
    EXPECT_GT(sets.at("transmission").at("auc").at("value"), 0.99);
    EXPECT_LT(sets.at("jacobian-frobenius").at("auc").at("value"), 0.9);
    EXPECT_EQ(sets.at("transmission").at("good_rejected"), 0);

    // The written recipe judges parts that were not used for tuning.
    const std::string recipe = text_of(folder / "lens.toml");
    EXPECT_THAT(recipe, HasSubstr("# Made by hordctl tune on 20"));
    EXPECT_THAT(recipe, HasSubstr("rest on 12 distinct good parts"));
    EXPECT_THAT(recipe, HasSubstr("features = ["));
    EXPECT_EQ(judge(501, Flaw::none, "lens.toml"), 0);
    EXPECT_EQ(judge(502, Flaw::speck, "lens.toml"), 1);
    EXPECT_EQ(run("hordctl", {"recipe", "check", folder / "lens.toml"}).status, 0);
    EXPECT_THAT(text_of(folder / "lens.tune.md"), HasSubstr("| transmission |"));
    EXPECT_THAT(text_of(folder / "lens.tune.csv"), HasSubstr("feature_set,auc,auc_low"));
    EXPECT_THAT(text_of(folder / "lens.tune.gp"), HasSubstr("title 'chosen'"));
    if (!std::filesystem::exists(folder / "lens.tune.png")) {
        EXPECT_THAT(said.err, HasSubstr("install gnuplot"));
    }

    // An existing file is refused before anything is measured. The same frames yield the same answer.
    const Said again = tune({"--budget", "100000", "--out", folder / "lens.toml"});
    EXPECT_EQ(again.status, 2);
    EXPECT_THAT(again.err,
                HasSubstr("lens.toml is there already: it is not overwritten: give another --out, or --force"));
    EXPECT_EQ(text_of(folder / "lens.toml"), recipe);
    const Said forced = tune({"--budget", "100000", "--out", folder / "lens.toml", "--force", "--json"});
    ASSERT_EQ(forced.status, 0) << forced.err;
    EXPECT_EQ(without_times(forced.out), sets);
}

TEST_F(Tune, parts_that_scatter_are_judged_by_a_distance) {
    frames(12, 8, Flaw::haze);
    std::ofstream(folder / "base.toml")
        << kFillsField << "[light]\ndark_dn = 1\nmin_sum_dn = 60\n";  // low, so that light spread thinly counts
    const Said said = tune({"--budget", "100000", "--recipe", folder / "base.toml", "--out", folder / "haze.toml"});
    ASSERT_EQ(said.status, 0) << said.err;
    EXPECT_THAT(said.out, HasSubstr("12 good and 8 bad frames of 26x24 lenslets of 9x9 bins, 12 bits"));
    EXPECT_THAT(said.out, HasSubstr("Chosen: "));
    EXPECT_THAT(said.out, HasSubstr("(95 % sure, from 12 distinct good parts, none of them rejected)"));
    EXPECT_THAT(said.out, HasSubstr("at most 22 %"));  // 1 - 0.05^(1/12)
    EXPECT_THAT(said.out, HasSubstr("0.3 % takes 986 more parts, 0.1 % 2983 more"));
    const std::string recipe = text_of(folder / "haze.toml");
    EXPECT_THAT(recipe,
                AnyOf(HasSubstr("\"emd\""), HasSubstr("\"marginal\""), HasSubstr("\"hellinger\""),
                      HasSubstr("\"chi2\""), Not(HasSubstr("features"))));
    EXPECT_THAT(recipe, HasSubstr("dark_dn = 1\n"));
    EXPECT_EQ(judge(501, Flaw::none, "haze.toml"), 0);
    EXPECT_EQ(judge(502, Flaw::haze, "haze.toml"), 1);
}

TEST_F(Tune, copies_and_repeated_exposures_count_once) {
    frames(9, 4, Flaw::speck);
    const Said once = tune({"--budget", "100000", "--json"});
    ASSERT_EQ(once.status, 0) << once.err;
    for (int k = 0; k < 5; ++k)  // of the first bad part
        std::filesystem::copy_file(folder / "bad/10.png", folder / ("bad/copy" + std::to_string(k) + ".png"));
    const Said copied = tune({"--budget", "100000", "--json"});
    ASSERT_EQ(copied.status, 0) << copied.err;
    const auto before = without_times(once.out), after = without_times(copied.out);
    for (const auto& [name, set] : before) EXPECT_EQ(set.at("auc"), after.at(name).at("auc")) << name;
    for (int k = 0; k < 9; ++k) {  // each three times more: the file, the frame mirrored, another exposure
        const auto seed = static_cast<std::uint64_t>(k) + 1;
        const std::string name = std::to_string(10 + k) + ".png";
        std::filesystem::copy_file(folder / ("good/" + name), folder / ("good/copy" + name));
        write("good/mirrored" + name, algo::testing::mirrored(part(seed, Flaw::none)));
        write("good/again" + name, part(seed, Flaw::none, kColumns, 100 + seed));
    }
    const Said said = tune({"--budget", "100000", "--json"});
    ASSERT_EQ(said.status, 0) << said.err;
    const Json json = Json::parse(said.out);
    EXPECT_EQ(json.at("good"), 36);
    EXPECT_EQ(json.at("good_parts"), 9);
    EXPECT_EQ(json.at("bad"), 9);
    EXPECT_EQ(json.at("bad_parts"), 4);
    for (const Json& set : json.at("feature_sets")) {
        if (!set.contains("false_rejects")) continue;
        EXPECT_EQ(set.at("false_rejects").at("parts"), 9);
        EXPECT_GE(set.at("false_rejects").at("at_most_by_any").get<double>(), 1 - std::pow(0.05, 1.0 / 9) - 1e-9);
    }
}

TEST_F(Tune, too_few_distinct_parts_are_refused) {
    frames(7, 3, Flaw::speck);
    const auto copy = [&](const std::string& kind, int count) {
        for (int k = 0; k < count; ++k)
            std::filesystem::copy_file(folder / (kind + "/10.png"),
                                       folder / (kind + "/copy" + std::to_string(k) + ".png"));
    };
    copy("good", 3), copy("bad", 2);
    const Said good = tune({"--budget", "100000", "--out", folder / "lens.toml"});
    EXPECT_EQ(good.status, 2);
    EXPECT_THAT(good.err,
                HasSubstr("of the good parts, 10 frames show 7 distinct parts: 3 are copies of earlier ones. Each part "
                          "counts once. At least 8 distinct good parts are needed: give frames of at least 1 more, "
                          "each of another part or of one that was placed anew"));
    write("good/18.png", part(9, Flaw::none));
    const Said bad = tune({"--budget", "100000", "--out", folder / "lens.toml"});
    EXPECT_EQ(bad.status, 2);
    EXPECT_THAT(bad.err,
                HasSubstr("of the bad parts, 5 frames show 3 distinct parts: 2 are copies of earlier ones. Each part "
                          "counts once. At least 4 distinct bad parts are needed: give frames of at least 1 more"));
    EXPECT_FALSE(std::filesystem::exists(folder / "lens.toml"));
}

TEST_F(Tune, starts_from_a_recipe_and_measures_a_reference) {
    frames(12, 6, Flaw::speck);
    std::vector<std::string> learn{"learn",     "--bits", "12",    "--electrons-per-dn",   "1",
                                   "--read-dn", "2",      "--out", folder / "lens.hordref"};
    for (int k = 0; k < 8; ++k) {
        write("learn" + std::to_string(k) + ".png", part(static_cast<std::uint64_t>(k) + 2001, Flaw::none));
        learn.push_back(folder / ("learn" + std::to_string(k) + ".png"));
    }
    ASSERT_EQ(run("hordctl", learn).status, 0);
    std::ofstream(folder / "base.toml") << "schema = 1\nname = \"lens\"\nnumber = 7\nversion = 3\n[limits]\nmin_area = "
                                           "4\n[[zone]]\nshape = \"circle\"\ncentre = [13, 11]\nradius = 20\n"
                                        << "[part]\npresent = \"unchecked\"\n";
    const Said said = tune({"--budget", "100000", "--recipe", folder / "base.toml", "--reference",
                            folder / "lens.hordref", "--out", folder / "lens.toml", "--json"});
    ASSERT_EQ(said.status, 0) << said.err;
    const auto sets = without_times(said.out);
    ASSERT_EQ(sets.size(), 14U);
    for (const char* name : {"reference", "reference + jacobian-frobenius", "reference + emd + jacobian-frobenius"}) {
        EXPECT_GT(sets.at(name).at("auc").at("value"), 0.99) << name;
        EXPECT_THAT(sets.at(name).at("limits").get<std::string>(), HasSubstr("reject_score"));
    }
    const std::string recipe = text_of(folder / "lens.toml");
    for (const char* kept : {"name = \"lens\"", "number = 7", "version = 4", "min_area = 4", "radius = 20"})
        EXPECT_THAT(recipe, HasSubstr(kept));
    EXPECT_EQ(judge(501, Flaw::none, "lens.toml"), 0);
    EXPECT_EQ(judge(502, Flaw::speck, "lens.toml"), 1);
    // A reference learned from other frames does not fit.
    write("good/10.png", part(1, Flaw::none, 30));
    const Said other = tune({"--budget", "100000", "--reference", folder / "lens.hordref"});
    EXPECT_EQ(other.status, 2);
    EXPECT_THAT(other.err, HasSubstr("the reference was learned from 26x24 lenslets"));
}

TEST_F(Tune, a_budget_that_nothing_fits_is_an_error_and_writes_nothing) {
    frames(8, 4, Flaw::speck);
    const Said said = tune({"--budget", "0.000001", "--out", folder / "lens.toml"});
    EXPECT_EQ(said.status, 2);
    EXPECT_THAT(said.err, HasSubstr("no feature set fits 1e-06 ms: the fastest, "));
    EXPECT_THAT(said.err, HasSubstr("allow more (--budget)"));
    EXPECT_THAT(said.out, HasSubstr("over budget"));
    EXPECT_FALSE(std::filesystem::exists(folder / "lens.toml"));
}

TEST_F(Tune, frames_that_cannot_be_used_are_named) {
    frames(9, 4, Flaw::speck);
    const auto refused = [&](const std::string& why) {
        const Said said = tune({"--budget", "100000", "--out", folder / "lens.toml"});
        EXPECT_EQ(said.status, 2);
        EXPECT_THAT(said.err, HasSubstr(why));
        EXPECT_FALSE(std::filesystem::exists(folder / "lens.toml"));
    };
    // A dark frame is left out and named; then the frames are one too few as well.
    write("good/18.png", Frame(kColumns * 9, kRows * 9, 12));
    const Said said = tune({"--budget", "100000"});
    EXPECT_EQ(said.status, 0) << said.err;
    EXPECT_THAT(said.out, HasSubstr("left out: " + folder / "good/18.png" + ": not judged: too-dark"));
    EXPECT_THAT(said.out, HasSubstr("8 good and 4 bad frames"));
    std::filesystem::remove(folder / "good/17.png");
    refused("7 frames of good parts that can be judged");
    std::filesystem::remove(folder / "good/18.png");
    refused("7 frames of good parts: give at least 8");
    write("good/17.png", part(77, Flaw::none));
    write("bad/13.png", part(78, Flaw::speck, 30));
    refused("bad/13.png is not of the size and depth of " + folder / "good/10.png");
    std::ofstream(folder / "bad/13.png") << "no image";
    refused("bad/13.png");
    std::filesystem::remove_all(folder / "bad");
    std::filesystem::create_directories(folder / "bad");
    refused("bad holds no frame");
    std::filesystem::remove_all(folder / "bad");
    refused(folder / "bad is not there");
    for (const char* out : {"nowhere/lens.toml", "lens.txt"}) {
        const Said wrong = tune({"--budget", "100000", "--out", folder / out});
        EXPECT_EQ(wrong.status, 2);
        EXPECT_THAT(wrong.err, AnyOf(HasSubstr("is no folder"), HasSubstr("is not named as recipes are")));
    }
    EXPECT_EQ(tune({"--budget", "-1"}).status, 2);
    const Said both =
        run("hordctl", {"tune", "--good", folder / "good", "--bad", folder / "good/10.png", "--budget", "10"});
    EXPECT_EQ(both.status, 2);
    EXPECT_THAT(both.err, HasSubstr("good/10.png is among the good frames, too"));
}

}  // namespace
}  // namespace hord::test
