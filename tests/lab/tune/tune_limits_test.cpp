// Which limits tune() sets: of single features the quantile of a fitted distribution, of scores against a reference the
// predicted limit, of lenslets and of what they show together each for half of the share
// (docs/adr/0017-limits-from-few-parts.md, docs/adr/0019-scores-of-several-lenslets.md).
#include <algorithm>
#include <cmath>
#include <functional>
#include <memory>
#include <string>
#include <vector>

#include <gtest/gtest.h>

#include "algo/good_parts/false_rejects.h"
#include "algo/inspection/pipeline.h"
#include "algo/reference/reference_learner.h"
#include "lab/guarantee/drawn_families.h"
#include "lab/tune/tune.h"
#include "lab/tune/tune_report.h"
#include "lab/tune/worst_value.h"

namespace hord::lab {
namespace {

constexpr std::size_t kFamily = 9, kGood = 20, kBad = 4;
constexpr double kShare = 1e-3;

Frame frame_of(const std::string& file) {
    const auto number = static_cast<std::uint32_t>(std::stoul(file.substr(1)));
    return file[0] == 'g' ? draw_good_part(kFamily, 5, 2, number)
                          : draw_part(kFamily, 5, 4, number, 0, DrawnFlaw::speck).frame;
}

algo::Recipe base_recipe() {
    algo::Recipe recipe;
    recipe.part_required = false;
    std::vector<Frame> frames;
    for (std::uint32_t k = 0; k < 8; ++k) frames.push_back(draw_good_part(kFamily, 5, 1, k));
    algo::LearnOptions options;
    options.levels = algo::light_levels(recipe, kFamilyBits);
    options.dark_from_noise = true;
    options.electrons_per_dn = 1;
    options.read_dn = 2;
    auto learned = algo::learn_reference(
        kFamilyExtents, kFamilyBits, frames.size(), [&](std::size_t k) -> Result<Frame> { return frames[k]; }, options);
    recipe.reference = std::make_shared<const algo::Reference>(std::move(learned.value().reference));
    return recipe;
}

// A value of every good part, as `value` takes it from what a recipe finds.
std::vector<double> of_good(const algo::Recipe& recipe, const std::function<double(const algo::Inspection&)>& value) {
    auto pipeline = algo::Pipeline::create(kFamilyExtents, kFamilyBits, recipe, 1, algo::MapSet::exact);
    std::vector<double> values;
    for (std::size_t k = 0; k < kGood; ++k)
        values.push_back(value(pipeline.value().inspect(frame_of("g" + std::to_string(k)).view()).value()));
    return values;
}

TEST(Tune, sets_the_fitted_limit_of_a_feature_and_the_predicted_ones_against_a_reference) {
    TuneOptions options;
    options.budget_ms = 1000;
    options.false_rejects = kShare;
    options.base.recipe = base_recipe();
    options.read = [](const std::string& file) -> Result<Frame> { return frame_of(file); };
    std::vector<std::string> good, bad;
    for (std::size_t k = 0; k < kGood; ++k) good.push_back("g" + std::to_string(k));
    for (std::size_t k = 0; k < kBad; ++k) bad.push_back("b" + std::to_string(k));
    const auto tuned = tune(good, bad, options);
    ASSERT_TRUE(tuned) << tuned.error().message();
    ASSERT_EQ(tuned->parts.parts, kGood);
    const auto set_of = [&](const std::string& name) {
        return *std::ranges::find(tuned->feature_sets, name, [](const auto& m) { return m.set.name(); });
    };

    algo::Recipe plain = options.base.recipe;
    plain.reference.reset();
    const std::vector<double> slopes = of_good(plain, [&](const algo::Inspection& i) {
        return WorstValue(kFamilyExtents, plain).of_gradient(i.frobenius, i.mask).value();
    });
    const double fitted = limit_above(gumbel_limit(slopes, kShare)),
                 predicted = limit_above(algo::predicted_limit(slopes, kShare));
    ASSERT_GT(predicted, fitted);
    EXPECT_FLOAT_EQ(set_of("jacobian-frobenius").recipe.recipe.frobenius_limit_bins, static_cast<float>(fitted));

    algo::Recipe alone = options.base.recipe;  // the set of the reference alone
    alone.gradient.reset();
    alone.slopes = alone.light = false;
    alone.pooled_score = algo::kPooledUnreached;
    const auto by_lenslets =
                   of_good(alone, [](const algo::Inspection&i) { return static_cast<double>(i.by_lenslets); }),
               together = of_good(alone, [](const algo::Inspection&i) { return static_cast<double>(i.together); });
    const algo::Recipe set = set_of("reference").recipe.recipe;
    const double factor = limit_above(algo::predicted_limit(by_lenslets, kShare / 2));
    EXPECT_NEAR(static_cast<double>(set.reject_score), 6 * factor, 1e-4);
    EXPECT_NEAR(static_cast<double>(set.pooled_score),
                limit_above(algo::predicted_light_tailed_limit(together, kShare / 2)), 1e-4);

    const auto json = to_json(*tuned);
    for (const auto& one : json.at("feature_sets")) {
        if (!one.contains("limits")) continue;  // a good part has a place without light
        const auto name = one.at("feature_set").get<std::string>(), limits = one.at("limits").get<std::string>();
        EXPECT_EQ(limits.find("pooled_score") != std::string::npos, name.starts_with("reference")) << name;
        if (name.ends_with("jacobian-frobenius")) {
            EXPECT_NE(limits.find("jacobian-frobenius "), std::string::npos) << name;
        }
    }
}

}  // namespace
}  // namespace hord::lab
