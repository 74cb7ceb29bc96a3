#include "algo/good_parts/reference_check.h"

#include <algorithm>
#include <cctype>
#include <cmath>
#include <cstdio>
#include <map>
#include <memory>
#include <numbers>
#include <random>
#include <set>

#include "algo/frame/mask.h"
#include "algo/inspection/pipeline.h"
#include "common/statistics.h"

namespace hord::algo {
namespace {

constexpr double kApart = 9;               // lenslets between flaws of one frame
constexpr std::size_t kFieldAFlaw = 2000;  // lenslets of the field for each flaw in a frame
constexpr std::size_t kMaxFlaws = 6;
constexpr double kAtFlaw = 2;  // lenslets: a defect so far beside the flaw's disc is the flaw

struct Placed {
    double m = 0, n = 0, size = 0, angle = 0;
};

class Checker {
  public:
    Checker(const Extents& extents, int bits, const FrameOfPart& frame_of, const CheckOptions& options)
        : extents_(extents), bits_(bits), frame_of_(frame_of), options_(options), random_(options.seed) {}

    Result<void> judge(const std::vector<std::size_t>& learn_from, const std::vector<std::size_t>& held_out,
                       const std::vector<std::size_t>& part_of, std::size_t trials_a_frame, ReferenceCheck& check);
    [[nodiscard]] const std::vector<DetectionTrial>& trials(std::size_t kind) const { return trials_[kind]; }

  private:
    double uniform() { return (static_cast<double>(random_() >> 11U) + 0.5) * 0x1p-53; }
    std::vector<Placed> places_for(PaintedFlaw flaw, std::span<const std::uint8_t> mask, std::size_t count);
    Result<void> try_flaws(Pipeline& pipeline, const Frame& clean, std::span<const std::uint8_t> mask,
                           std::size_t trials);

    const Extents& extents_;
    int bits_;
    const FrameOfPart& frame_of_;
    const CheckOptions& options_;
    std::mt19937_64 random_;
    std::array<std::vector<DetectionTrial>, kPaintedFlaws.size()> trials_;
};

Result<void> Checker::judge(const std::vector<std::size_t>& learn_from, const std::vector<std::size_t>& held_out,
                            const std::vector<std::size_t>& part_of, std::size_t trials_a_frame,
                            ReferenceCheck& check) {
    LearnOptions learning = options_.learning;
    learning.name_of = [&](std::size_t k) { return options_.learning.name_of(learn_from[k]); };
    auto learned = learn_reference(
        extents_, bits_, learn_from.size(), [&](std::size_t k) { return frame_of_(learn_from[k]); }, learning);
    if (!learned) return tl::unexpected(learned.error());
    Recipe recipe = options_.recipe;
    recipe.reference = std::make_shared<const Reference>(std::move(learned->reference));
    if (!(recipe.pooled_score > 0)) recipe.pooled_score = kPooledUnreached;
    auto pipeline = Pipeline::create(extents_, bits_, recipe, options_.learning.threads);
    if (!pipeline) return tl::unexpected(pipeline.error());
    for (const std::size_t k : held_out) {
        const auto frame = frame_of_(k);
        if (!frame) return tl::unexpected(frame.error());
        const auto seen = pipeline->inspect(frame->view());
        if (!seen) return tl::unexpected(seen.error());
        const bool unfit = seen->verdict == Verdict::unfit;
        check.judged.push_back({k, part_of[k], unfit ? ReferenceCheck::kUnfit : static_cast<double>(seen->score),
                                seen->verdict == Verdict::pass ? "" : std::string(name_of(seen->reason)),
                                static_cast<double>(seen->by_lenslets), static_cast<double>(seen->together)});
        if (seen->verdict != Verdict::pass) continue;
        const std::vector<std::uint8_t> mask(seen->mask.begin(), seen->mask.end());
        if (auto done = try_flaws(*pipeline, *frame, mask, trials_a_frame); !done) return done;
    }
    return {};
}

// Places at least two lenslets inside what is judged, kApart from each other.
std::vector<Placed> Checker::places_for(PaintedFlaw flaw, std::span<const std::uint8_t> mask, std::size_t count) {
    const PaintedFlawKind& kind = kind_of(flaw);
    std::vector<Placed> places;
    for (int attempt = 0; attempt < 400 && places.size() < count; ++attempt) {
        Placed p{uniform() * extents_.m - 0.5, uniform() * extents_.n - 0.5,
                 kind.least * std::pow(kind.most / kind.least, uniform()), 2 * std::numbers::pi * uniform()};
        bool inside = true;
        const int m = static_cast<int>(std::lround(p.m)), n = static_cast<int>(std::lround(p.n));
        if (m < 2 || n < 2 || m + 2 >= extents_.m || n + 2 >= extents_.n) continue;
        extents_.for_each_around(m, n, 2, [&](int x, int y) {
            inside = inside && (mask[extents_.index(x, y)] & (kNoHord | kNotJudged)) == 0;
        });
        for (const Placed& other : places) inside = inside && std::hypot(p.m - other.m, p.n - other.n) >= kApart;
        if (inside) places.push_back(p);
    }
    return places;
}

Result<void> Checker::try_flaws(Pipeline& pipeline, const Frame& clean, std::span<const std::uint8_t> mask,
                                std::size_t trials) {
    const std::size_t at_once = std::clamp<std::size_t>(extents_.lenslets() / kFieldAFlaw, 1, kMaxFlaws);
    for (std::size_t which = 0; which < kPaintedFlaws.size(); ++which) {
        const auto flaw = static_cast<PaintedFlaw>(which);
        for (std::size_t done = 0; done < trials;) {
            const auto places = places_for(flaw, mask, std::min(at_once, trials - done));
            if (places.empty()) return {};
            Frame frame = clean;
            for (const Placed& p : places)
                paint(frame, extents_, flaw, p.m, p.n, p.size, p.angle,
                      static_cast<double>(options_.learning.pedestal_dn));
            const auto seen = pipeline.inspect(frame.view());
            if (!seen) return tl::unexpected(seen.error());
            for (const Placed& p : places) {
                const double reach = kAtFlaw +
                    (flaw == PaintedFlaw::hole          ? p.size
                         : flaw == PaintedFlaw::scratch ? kPaintedScratch / 2
                                                        : kPaintedDimple);
                const bool found =
                    seen->verdict == Verdict::reject && std::ranges::any_of(seen->defects, [&](const Defect& d) {
                        return std::hypot(static_cast<double>(d.m) - p.m, static_cast<double>(d.n) - p.n) <= reach;
                    });
                trials_[which].push_back({p.size, found});
            }
            done += places.size();
        }
    }
    return {};
}

// Two digits, without an exponent where people read one badly.
std::string number(double value) {
    char text[32];
    const double last_digit = std::abs(value) < 100 ? 0 : std::pow(10, std::floor(std::log10(std::abs(value))) - 1);
    if (last_digit > 0) std::snprintf(text, sizeof text, "%.0f", std::round(value / last_digit) * last_digit);
    else std::snprintf(text, sizeof text, "%.2g", value);
    return text;
}

}  // namespace

void keep_to_tried(PodCurve& curve, const PaintedFlawKind& kind) {
    for (auto* size : {&curve.a90, &curve.a90_95}) {
        if (*size && **size > kind.most) size->reset();
        if (*size) **size = std::max(**size, kind.least);
    }
}

Result<ReferenceCheck> check_reference(const Extents& extents, int bits, std::size_t count, const FrameOfPart& frame_of,
                                       const std::vector<std::size_t>& part_of, const std::vector<bool>& used,
                                       const CheckOptions& options) {
    ReferenceCheck check;
    std::map<std::size_t, std::size_t> order;  // of the parts
    std::size_t frames = 0;
    for (std::size_t k = 0; k < count; ++k) {
        if (used[k]) order.try_emplace(part_of[k], order.size()), ++frames;
    }
    std::size_t folds = std::min(options.folds, order.size());
    const auto held_out_of = [&](std::size_t fold) {
        std::vector<std::size_t> held_out;
        for (std::size_t k = 0; k < count; ++k) {
            if (used[k] && order.at(part_of[k]) % folds == fold) held_out.push_back(k);
        }
        return held_out;
    };
    std::size_t largest = 0;
    for (std::size_t fold = 0; fold < folds; ++fold) largest = std::max(largest, held_out_of(fold).size());
    if (folds < 2 || frames < largest + Reference::kMinParts) {
        const std::size_t needed = Reference::kMinParts + (Reference::kMinParts + 2) / 3;
        check.not_checked = std::to_string(order.size()) +
            (order.size() == 1 ? " distinct part is" : " distinct parts are") +
            " too few to judge some by what is learned from the others: give at least " + std::to_string(needed);
        return check;
    }
    const std::size_t trials_a_frame = (options.trials + frames - 1) / frames;
    Checker checker(extents, bits, frame_of, options);
    for (std::size_t fold = 0; fold < folds; ++fold) {
        const std::vector<std::size_t> held_out = held_out_of(fold);
        std::vector<std::size_t> learn_from;
        for (std::size_t k = 0; k < count; ++k) {
            if (used[k] && order.at(part_of[k]) % folds != fold) learn_from.push_back(k);
        }
        if (auto done = checker.judge(learn_from, held_out, part_of, options.trials > 0 ? trials_a_frame : 0, check);
            !done)
            return tl::unexpected(done.error());
        options.progress(static_cast<double>(fold + 1) / static_cast<double>(folds));
    }
    std::ranges::sort(check.judged, {}, &ReferenceCheck::Judged::frame);
    struct Worst {
        double score = 0, by_lenslets = 0, together = 0;
    };
    std::map<std::size_t, Worst> worst;
    for (const ReferenceCheck::Judged& j : check.judged) {
        Worst& of = worst[j.part];
        of = {std::max(of.score, j.score), std::max(of.by_lenslets, j.by_lenslets), std::max(of.together, j.together)};
    }
    std::vector<double> by_lenslets, together;
    for (const auto& [part, of] : worst) {
        check.worst_scores.push_back(of.score);
        if (of.score < ReferenceCheck::kUnfit) by_lenslets.push_back(of.by_lenslets), together.push_back(of.together);
    }
    check.false_rejects = false_rejects_at(check.worst_scores, 1);
    check.factor = limit_for(by_lenslets, kAimedFalseRejects / 2);
    if (std::ranges::any_of(together, [](double score) { return score > 0; }))
        check.pooled_score = std::max(1.0, predicted_light_tailed_limit(together, kAimedFalseRejects / 2));
    for (std::size_t kind = 0; kind < kPaintedFlaws.size(); ++kind) {
        const auto& trials = checker.trials(kind);
        auto& found = check.flaws[kind];
        found.trials = trials.size();
        found.found = static_cast<std::size_t>(std::ranges::count_if(trials, &DetectionTrial::found));
        found.curve = pod_curve(trials);
        keep_to_tried(found.curve, kPaintedFlaws[kind]);
    }
    return check;
}

CheckSentences describe(const ReferenceCheck& check, const Recipe& recipe, std::span<const std::string> frames) {
    CheckSentences told;
    if (!check.not_checked.empty()) {
        told.judged.push_back("Not checked: " + check.not_checked + ".");
        return told;
    }
    const double worst = *std::ranges::max_element(check.worst_scores),
                 typical = common::quantile(check.worst_scores, 0.5);
    told.judged.push_back(
        "Each part was judged by what is learned from the others: the median part's worst place has " +
        number(typical) + " of the limit, the worst part's " +
        (worst >= ReferenceCheck::kUnfit ? "could not be judged" : number(worst)) + ".");
    for (const ReferenceCheck::Judged& j : check.judged) {
        if (!j.reason.empty()) told.judged.push_back("Would be rejected: " + frames[j.frame] + ": " + j.reason + ".");
    }
    told.false_rejects.push_back(describe(check.false_rejects));
    const std::string half = number(100 * kAimedFalseRejects / 2) + " %";
    Recipe scaled = recipe;
    scale_score_limits(scaled, check.factor);
    told.false_rejects.push_back(
        "The recipe's limits are reject_score " + number(static_cast<double>(recipe.reject_score)) +
        ", cluster_score " + number(static_cast<double>(recipe.cluster_score)) + ". With reject_score " +
        number(static_cast<double>(scaled.reject_score)) + ", grow_score " +
        number(static_cast<double>(scaled.grow_score)) + ", cluster_score " +
        number(static_cast<double>(scaled.cluster_score)) + " the bound by that distribution would be " + half +
        " for what lenslets show by themselves.");
    if (check.pooled_score > 0) {
        told.false_rejects.push_back("With pooled_score " + number(check.pooled_score) +
                                     ", as hordctl tune would set it, " + half + " of further good parts would be " +
                                     "rejected in the mean, by that distribution, for what several lenslets show " +
                                     "together.");
    }
    for (std::size_t kind = 0; kind < kPaintedFlaws.size(); ++kind) {
        const PaintedFlawKind& k = kPaintedFlaws[kind];
        const ReferenceCheck::Found& found = check.flaws[kind];
        if (found.trials == 0) continue;
        const auto size = [&](double value) {
            std::string text = number(value) + (k.unit.empty() ? "" : " " + std::string(k.unit));
            if (k.unit == "lenslets" && recipe.lenslet_mm > 0)
                text += " (" + number(value * static_cast<double>(recipe.lenslet_mm)) + " mm)";
            if (k.unit == "bins" && recipe.bin_rad > 0)
                text += " (" + number(1e3 * value * static_cast<double>(recipe.bin_rad)) + " mrad)";
            return text;
        };
        std::string line = std::string(k.name) + ": ";
        line.front() = static_cast<char>(std::toupper(line.front()));
        if (found.curve.a90)
            line += (*found.curve.a90 > k.least ? "" : "the smallest that was tried, ") + std::string(k.size) + " " +
                size(*found.curve.a90) + (*found.curve.a90 > k.least ? "" : ",") + " is found in nine of ten cases" +
                (found.curve.a90_95 ? ", " + size(*found.curve.a90_95) + " with 95 % confidence"
                                    : "; more trials would be needed for a confidence");
        else line += "none of the sizes tried, up to " + size(k.most) + ", is found in nine of ten cases";
        told.flaws.push_back(line + " (" + std::to_string(found.trials) + " painted into these parts, " +
                             std::to_string(found.found) + " found).");
    }
    return told;
}

}  // namespace hord::algo
