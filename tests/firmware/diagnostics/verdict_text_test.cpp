// The sentence of every verdict, with and without a reference.
#include <string>
#include <vector>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "tests/firmware/diagnostics/told.h"

namespace hord::firmware {
namespace {

TEST(VerdictText, of_a_part_that_passed_says_how_near_to_its_limit_it_came) {
    algo::Inspection found;
    found.verdict = Verdict::pass;
    found.reason = Reason::none;
    found.score = 0.424F;
    EXPECT_EQ(told(found), "Passed: the worst place reaches 42 % of its limit.");
    found.bounded = true;
    EXPECT_EQ(told(found),
              "Passed: the worst place reaches at most 42 % of its limit. Some values are bounds: the limit of work "
              "was reached.");
    found.out_of_time = true;
    EXPECT_EQ(told(found),
              "Passed: the worst place reaches at most 42 % of its limit. Some values are bounds: the time ran out.");
}

// What several lenslets show together (algo/reference/pooled_scores.h).
TEST(VerdictText, of_a_weak_defect_names_haze_and_striae_with_their_length) {
    const auto told_of = [](algo::DefectKind kind, float length) {
        algo::Inspection found;
        found.verdict = Verdict::reject;
        found.score = 1.5F;
        const std::vector<algo::Defect> one{
            {.m = 20, .n = 12, .area = 16, .kind = kind, .length = length, .width = 2, .score = 1.5F, .weak = true}};
        found.defects = one;
        return told(found);
    };
    EXPECT_EQ(told_of(algo::DefectKind::surface, 8),
              "Rejected: a stria of 8.0 lenslets at lenslet (20.0, 12.0), 1.5 times its limit.");
    EXPECT_EQ(told_of(algo::DefectKind::scattering, 3),
              "Rejected: haze of 3.0 lenslets at lenslet (20.0, 12.0), 1.5 times its limit.");
    EXPECT_EQ(told_of(algo::DefectKind::scratch, 8),
              "Rejected: a scratch of 8.0 lenslets at lenslet (20.0, 12.0), 1.5 times its limit.");
    EXPECT_EQ(told_of(algo::DefectKind::surface, 4.3F),
              "Rejected: a surface defect of 4.3 lenslets at lenslet (20.0, 12.0), 1.5 times its limit.");
}

TEST(VerdictText, of_a_rejected_part_says_what_was_found_how_large_and_where) {
    algo::Inspection found;
    found.verdict = Verdict::reject;
    found.score = 2.5F;
    std::vector<algo::Defect> defects{{.m = 25, .n = 5, .area = 9, .peak = 1}};
    for (const Reason reason : {Reason::neighbours_disagree, Reason::deflection_gradient, Reason::absorption}) {
        found.reason = reason;
        for (const auto& [kind, name] : {std::pair(algo::DefectKind::unknown, "a defect"),
                                         std::pair(algo::DefectKind::scattering, "a scattering defect"),
                                         std::pair(algo::DefectKind::absorbing, "an absorbing defect"),
                                         std::pair(algo::DefectKind::surface, "a surface defect")}) {
            defects[0].kind = kind;
            found.defects = defects;
            EXPECT_EQ(
                told(found),
                std::string("Rejected: ") + name + " of 3.4 lenslets at lenslet (25.0, 5.0), 2.5 times its limit.");
        }
    }
    defects[0].radius = 1.2F;  // by the light
    EXPECT_THAT(told(found), ::testing::HasSubstr(" of 2.4 lenslets "));
    defects[0].kind = algo::DefectKind::scratch;
    defects[0].length = 12;
    EXPECT_EQ(told(found), "Rejected: a scratch of 12.0 lenslets at lenslet (25.0, 5.0), 2.5 times its limit.");
    EXPECT_EQ(told(found, 0.2F), "Rejected: a scratch of 2.4 mm at (1.00, -2.00) mm, 2.5 times its limit.");
    defects.resize(2, {.m = 3, .n = 4, .area = 1});
    found.defects = defects;
    EXPECT_THAT(told(found), ::testing::EndsWith("; 1 weaker one."));
    defects.resize(3);
    found.defects = defects;
    found.bounded = true;
    EXPECT_THAT(told(found),
                ::testing::EndsWith("at most 2.5 times its limit; 2 weaker ones. Some values are bounds: "
                                    "the limit of work was reached."));
}

TEST(VerdictText, of_missing_material_says_where_and_how_much_light_passes) {
    algo::Inspection found;
    const algo::Defect hole{.m = 20, .n = 35, .area = 9, .peak = 0.082F, .length = 3, .width = 3};
    found.verdict = algo::Verdict::reject;
    found.reason = Reason::missing_material;
    found.score = 2.3F;
    found.defects = {&hole, 1};
    EXPECT_EQ(explain(found, recipe(false), kField),
              "Rejected: light passes as if material were missing at lenslet (20.0, 35.0): 8 % more than beside it, "
              "over 3.0 lenslets, 2.3 times its limit. If good parts are thinner or clearer there, learn a reference "
              "(hordctl "
              "learn).");
    EXPECT_THAT(explain(found, recipe(true), kField),
                ::testing::HasSubstr("8 % more than in the parts that were learned, over 3.0 lenslets, 2.3 times its "
                                     "limit. If good parts are as clear there, learn from such parts, too."));
}

}  // namespace
}  // namespace hord::firmware
