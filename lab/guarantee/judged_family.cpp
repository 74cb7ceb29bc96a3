#include "lab/guarantee/judged_family.h"

#include <algorithm>
#include <memory>
#include <utility>

#include "algo/good_parts/distinct_parts.h"
#include "algo/good_parts/false_rejects.h"
#include "algo/good_parts/reference_check.h"
#include "algo/inspection/pipeline.h"
#include "algo/reference/read_noise.h"
#include "algo/reference/reference_learner.h"

namespace hord::lab {
namespace {

enum : std::uint32_t { kLearn = 1, kTune = 2, kTest = 3, kFlawed = 4 };

// The recipe that a user gets, for parts that fill the field.
algo::Recipe filling_recipe() {
    algo::Recipe recipe;
    recipe.part_required = false;
    return recipe;
}

// Learns the recipe's reference, and what is told of it.
Result<algo::Recipe> learn(std::size_t family, std::uint64_t seed, JudgedFamily& judged) {
    const algo::Extents& e = kFamilyExtents;
    std::vector<Frame> frames;  // drawn once: learning reads each some fifty times
    for (std::uint32_t k = 0; k < kLearnedParts; ++k) frames.push_back(draw_good_part(family, seed, kLearn, k));
    const algo::FrameOfPart frame_of = [&](std::size_t k) -> Result<Frame> { return frames[k]; };
    algo::Recipe recipe = filling_recipe();
    algo::CheckOptions checking;
    checking.recipe = recipe;
    checking.trials = 0;
    algo::LearnOptions& learning = checking.learning;
    learning.levels = algo::light_levels(recipe, kFamilyBits);
    learning.dark_from_noise = true;
    const auto read_dn = algo::read_noise_of(e, learning.levels, kLearnedParts, frame_of);
    if (!read_dn) return tl::unexpected(read_dn.error());
    learning.read_dn = *read_dn;
    auto learned = algo::learn_reference(e, kFamilyBits, kLearnedParts, frame_of, learning);
    if (!learned) return tl::unexpected(learned.error());
    learning.electrons_per_dn = learned->reference.sensor.electrons_per_dn;
    std::vector<std::size_t> numbers;
    for (std::size_t k = 0; k < kLearnedParts; ++k) numbers.push_back(k);
    std::vector<bool> used(kLearnedParts, true);
    for (const algo::LeftOut& out : learned->left_out) used[out.part] = false;
    const auto check = algo::check_reference(e, kFamilyBits, kLearnedParts, frame_of, numbers, used, checking);
    if (!check) return tl::unexpected(check.error());
    judged.learn_bound = check->not_checked.empty() ? check->false_rejects.bound() : 1;
    recipe.reference = std::make_shared<const algo::Reference>(std::move(learned->reference));
    return recipe;
}

// Scores of frames by a recipe.
class Scorer {
  public:
    static Result<Scorer> create(const algo::Recipe& recipe) {
        auto pipeline = algo::Pipeline::create(kFamilyExtents, kFamilyBits, recipe);
        if (!pipeline) return tl::unexpected(pipeline.error());
        return Scorer(std::move(*pipeline));
    }
    Result<double> score(const Frame& frame) {
        const auto seen = pipeline_.inspect(frame.view());
        if (!seen) return tl::unexpected(seen.error());
        together_ = static_cast<double>(seen->together), by_lenslets_ = static_cast<double>(seen->by_lenslets);
        return seen->verdict == algo::Verdict::unfit ? algo::ReferenceCheck::kUnfit : static_cast<double>(seen->score);
    }
    [[nodiscard]] double together() const { return together_; }
    [[nodiscard]] double by_lenslets() const { return by_lenslets_; }

  private:
    explicit Scorer(algo::Pipeline pipeline) : pipeline_(std::move(pipeline)) {}
    algo::Pipeline pipeline_;
    double together_ = 0, by_lenslets_ = 0;
};

// As hordctl tune does: the worst score of each distinct part sets a factor on all limits. A part in which the
// reference is not found sets none.
Result<void> tune(std::size_t family, std::uint64_t seed, algo::Recipe& recipe, JudgedFamily& judged) {
    recipe.pooled_score = algo::kPooledUnreached;
    auto scorer = Scorer::create(recipe);
    if (!scorer) return tl::unexpected(scorer.error());
    algo::DistinctParts distinct(kFamilyExtents, recipe.reference->levels.dark);
    std::vector<double> scores, by_lenslets, together;
    for (int k = 0; k < kTunedParts + kTunedAgain; ++k) {
        const Frame frame =
            draw_good_part(family, seed, kTune, static_cast<std::uint32_t>(k % kTunedParts), k >= kTunedParts ? 1 : 0);
        distinct.add(frame.view());
        const auto score = scorer->score(frame);
        if (!score) return tl::unexpected(score.error());
        scores.push_back(*score);
        by_lenslets.push_back(scorer->by_lenslets()), together.push_back(scorer->together());
    }
    const auto groups = distinct.groups();
    judged.counted = groups.at_least;
    // Of each part the worst frame.
    const auto worst_of = [&](const std::vector<double>& of_frames) {
        std::vector<double> worst(groups.parts);
        for (std::size_t k = 0; k < of_frames.size(); ++k)
            worst[groups.part_of[k]] = std::max(worst[groups.part_of[k]], of_frames[k]);
        return worst;
    };
    judged.to_tune = worst_of(scores);
    std::vector<double> lenslets = worst_of(by_lenslets), pooled = worst_of(together), found[2];
    for (std::size_t k = 0; k < groups.parts; ++k) {
        if (judged.to_tune[k] >= algo::ReferenceCheck::kUnfit) continue;
        found[0].push_back(lenslets[k]), found[1].push_back(pooled[k]);
    }
    judged.limit = algo::predicted_limit(found[0], kTuneShare / 2);
    judged.pooled_limit = algo::predicted_light_tailed_limit(found[1], kTuneShare / 2);
    for (std::size_t k = 0; k < groups.parts; ++k) {
        double& score = judged.to_tune[k];
        if (score < algo::ReferenceCheck::kUnfit)
            score = std::max(lenslets[k] / judged.limit, pooled[k] / judged.pooled_limit);
    }
    judged.tune_bound = algo::false_rejects_at(judged.to_tune, 1, groups.at_least).bound();
    algo::scale_score_limits(recipe, judged.limit);
    recipe.pooled_score = static_cast<float>(judged.pooled_limit);
    for (float* limit : {&recipe.emd_limit_bins, &recipe.frobenius_limit_bins})
        *limit = static_cast<float>(static_cast<double>(*limit) * judged.limit);
    return {};
}

}  // namespace

Result<JudgedFamily> judge_family(std::size_t family, std::uint64_t seed, int good, int flawed) {
    JudgedFamily judged;
    auto recipe = learn(family, seed, judged);
    if (!recipe) return tl::unexpected(recipe.error());
    auto by_recipe = Scorer::create(*recipe);
    if (!by_recipe) return tl::unexpected(by_recipe.error());
    if (auto tuned = tune(family, seed, *recipe, judged); !tuned) return tl::unexpected(tuned.error());
    auto by_tuned = Scorer::create(*recipe);
    if (!by_tuned) return tl::unexpected(by_tuned.error());
    for (int k = 0; k < good; ++k) {
        const Frame frame = draw_good_part(family, seed, kTest, static_cast<std::uint32_t>(k));
        for (const auto& [scorer, scores] :
             {std::pair(&*by_recipe, &judged.by_recipe), std::pair(&*by_tuned, &judged.by_tuned)}) {
            const auto score = scorer->score(frame);
            if (!score) return tl::unexpected(score.error());
            scores->push_back(*score);
        }
    }
    for (std::size_t flaw = 0; flaw < kDrawnFlaws.size(); ++flaw) {
        for (int k = 0; k < flawed; ++k) {
            const DrawnPart part =
                draw_part(family, seed, kFlawed, static_cast<std::uint32_t>(k), 0, static_cast<DrawnFlaw>(flaw));
            const auto score = by_tuned->score(part.frame);
            if (!score) return tl::unexpected(score.error());
            judged.flawed[flaw].push_back({part.size, *score});
        }
    }
    return judged;
}

}  // namespace hord::lab
