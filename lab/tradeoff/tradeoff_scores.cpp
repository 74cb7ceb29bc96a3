#include "lab/tradeoff/tradeoff_scores.h"

#include <algorithm>
#include <atomic>
#include <cmath>
#include <optional>
#include <thread>

#include "algo/features/transmission.h"
#include "algo/frame/mask.h"
#include "algo/maps/feature_map.h"

namespace hord::lab {
namespace {

constexpr int kReferenceExposures = 16;
enum Stream : std::uint64_t {
    kGood = 0x1'0000'0000,
    kBad = 0x2'0000'0000,
    kReference = 0x3'0000'0000
};  // of exposures

// The frames of all parts at one point, shared by all features.
struct Exposures {
    struct Shot {
        Frame frame;
        const PartLight* part;
        std::uint32_t number;  // of the part, good ones first
    };
    std::vector<Shot> good, bad;
    std::vector<Frame> references;  // one a place
};

Exposures expose_all(const TradeoffParts& parts, const TradeoffPoint& point, const ScoreOptions& options) {
    Exposures all;
    for (std::size_t k = 0; k < parts.good.size(); ++k) {
        for (int e = 0; e < options.good_exposures; ++e) {
            const std::uint64_t turn = kGood + k * 256 + static_cast<std::uint64_t>(e);
            all.good.push_back({expose_part(parts, parts.good[k].light, point, options.seed, turn), &parts.good[k],
                                static_cast<std::uint32_t>(k)});
        }
    }
    for (std::size_t k = 0; k < parts.bad.size(); ++k) {
        for (int e = 0; e < options.bad_exposures; ++e) {
            const std::uint64_t turn = kBad + k * 256 + static_cast<std::uint64_t>(e);
            all.bad.push_back({expose_part(parts, parts.bad[k].light, point, options.seed, turn), &parts.bad[k],
                               static_cast<std::uint32_t>(parts.good.size() + k)});
        }
    }
    TradeoffPoint averaged = point;
    averaged.frames = kReferenceExposures;
    for (std::size_t place = 0; place < parts.nominal.size(); ++place) {
        all.references.push_back(expose_part(parts, parts.nominal[place], averaged, options.seed, kReference + place));
    }
    return all;
}

Exposures expose_all_exactly(const TradeoffParts& parts) {
    Exposures all;
    for (std::size_t k = 0; k < parts.good.size(); ++k)
        all.good.push_back({expose_exactly(parts, parts.good[k].light), &parts.good[k], static_cast<std::uint32_t>(k)});
    for (std::size_t k = 0; k < parts.bad.size(); ++k) {
        all.bad.push_back({expose_exactly(parts, parts.bad[k].light), &parts.bad[k],
                           static_cast<std::uint32_t>(parts.good.size() + k)});
    }
    for (const auto& nominal : parts.nominal) all.references.push_back(expose_exactly(parts, nominal));
    return all;
}

// One feature over frames: values where there are some, else 0.
class Eye {
  public:
    static Result<Eye> create(algo::FeatureChoice choice, const algo::Extents& extents, const algo::LightLevels& levels,
                              const std::vector<Frame>& references) {
        Eye eye(choice, extents, levels, references);
        if (choice.feature == algo::Feature::transmission) return eye;
        auto mapper = algo::FeatureMapper::create(extents, 16, levels, choice.feature);
        if (!mapper) return tl::unexpected(mapper.error());
        eye.mapper_ = std::move(*mapper);
        return eye;
    }

    Result<std::span<const float>> look(const Frame& frame, int place) {
        if (!mapper_) return look_at_light(frame);
        auto map = choice_.against_reference
            ? mapper_->against(frame.view(), (*references_)[static_cast<std::size_t>(place)].view())
            : mapper_->over_neighbours(frame.view());
        if (!map) return tl::unexpected(map.error());
        values_.assign(map->values.begin(), map->values.end());
        for (std::size_t k = 0; k < values_.size(); ++k) {
            if ((map->mask[k] & algo::kNoGradient) != 0) values_[k] = 0;
        }
        return values_;
    }

  private:
    Eye(algo::FeatureChoice choice, const algo::Extents& extents, const algo::LightLevels& levels,
        const std::vector<Frame>& references)
        : choice_(choice), extents_(extents), levels_(levels), references_(&references), row_(extents) {}

    std::span<const float> look_at_light(const Frame& frame) {
        std::vector<std::uint32_t> sums;
        for (int n = 0; n < extents_.n; ++n) {
            algo::decode_row(frame.view(), extents_, levels_, n, row_);
            sums.insert(sums.end(), row_.sums().begin(), row_.sums().end());
        }
        std::vector<std::uint32_t> scratch(sums.size());
        const std::vector<std::uint8_t> mask(sums.size(), algo::kValid);
        values_.resize(sums.size());
        algo::transmissions(sums, mask, algo::typical_light(sums, mask, 0, scratch), values_);
        for (float& v : values_) v = std::abs(1 - v);
        return values_;
    }

    algo::FeatureChoice choice_;
    algo::Extents extents_;
    algo::LightLevels levels_;
    const std::vector<Frame>* references_;
    std::optional<algo::FeatureMapper> mapper_;
    algo::HordRow row_;
    std::vector<float> values_;
};

float patch_score(std::span<const float> values, int m, int n) {
    float most = 0;
    for (int y = n - 1; y <= n + 1; ++y) {
        for (int x = m - 1; x <= m + 1; ++x) most = std::max(most, values[static_cast<std::size_t>(y * kColumns + x)]);
    }
    return most;
}
float defect_score(std::span<const float> values, const PlacedDefect& defect) {
    return patch_score(values, std::clamp(static_cast<int>(std::lround(defect.m)), 2, kColumns - 3),
                       std::clamp(static_cast<int>(std::lround(defect.n)), 2, kRows - 3));
}

// The scores of one feature over all frames.
struct Seen {
    std::vector<ScoredPlace> good;                        // patches
    std::array<std::vector<ScoredPlace>, kFamilies> bad;  // defects, by family
    std::array<std::vector<double>, kFamilies> sizes;     // of the same
    std::vector<std::vector<float>> good_values;          // one map a good shot
};
Result<Seen> see(Eye& eye, const Exposures& shots) {
    Seen seen;
    for (const auto& shot : shots.good) {
        const auto values = eye.look(shot.frame, shot.part->place);
        if (!values) return tl::unexpected(values.error());
        for (int n = 2; n < kRows - 2; n += 3) {
            for (int m = 2; m < kColumns - 2; m += 3)
                seen.good.push_back({patch_score(*values, m, n), shot.number, false});
        }
        seen.good_values.emplace_back(values->begin(), values->end());
    }
    for (const auto& shot : shots.bad) {
        const auto values = eye.look(shot.frame, shot.part->place);
        if (!values) return tl::unexpected(values.error());
        const auto family = static_cast<std::size_t>(shot.part->family);
        for (const PlacedDefect& defect : shot.part->defects) {
            seen.bad[family].push_back({defect_score(*values, defect), shot.number, true});
            seen.sizes[family].push_back(defect.size);
        }
    }
    return seen;
}

Json to_json(const Estimate& e) { return {e.value, e.low, e.high}; }
Json to_json(const std::optional<double>& value) { return value ? Json(*value) : Json(nullptr); }

// Over the judged lenslets of good parts; a part's exact map serves all its exposures.
double root_mean_square_error(const Seen& noisy, const Seen& exact, int exposures) {
    double squares = 0, count = 0;
    for (std::size_t k = 0; k < noisy.good_values.size(); ++k) {
        const auto& truth = exact.good_values[k / static_cast<std::size_t>(exposures)];
        for (int n = 1; n < kRows - 1; ++n) {
            for (int m = 1; m < kColumns - 1; ++m) {
                const auto at = static_cast<std::size_t>(n * kColumns + m);
                const double d = static_cast<double>(noisy.good_values[k][at]) - static_cast<double>(truth[at]);
                squares += d * d, count += 1;
            }
        }
    }
    return count > 0 ? std::sqrt(squares / count) : 0;
}

Result<Json> score(algo::FeatureChoice choice, const Exposures& shots, const Exposures& exact_shots,
                   const algo::Extents& extents, const TradeoffPoint& point, const ScoreOptions& options) {
    auto eye = Eye::create(choice, extents, levels_at(point), shots.references);
    if (!eye) return tl::unexpected(eye.error());
    auto exact_eye = Eye::create(choice, extents, kExactLevels, exact_shots.references);
    if (!exact_eye) return tl::unexpected(exact_eye.error());
    const auto seen = see(*eye, shots);
    if (!seen) return tl::unexpected(seen.error());
    const auto exact = see(*exact_eye, exact_shots);
    if (!exact) return tl::unexpected(exact.error());

    Json found;
    double flips = 0, defects = 0;
    for (std::size_t family = 0; family < kFamilies; ++family) {
        std::vector<ScoredPlace> all = seen->good;
        all.insert(all.end(), seen->bad[family].begin(), seen->bad[family].end());
        const Detection detection = detection_of(all, kFalsePositives, options.repeats, options.seed);
        std::vector<DetectionTrial> tried;
        for (std::size_t k = 0; k < seen->bad[family].size(); ++k) {
            tried.push_back({seen->sizes[family][k], seen->bad[family][k].score > detection.threshold});
        }
        // Shots of one part follow one another, each with the same defects.
        const std::size_t per_part = seen->bad[family].size() / exact->bad[family].size();
        const std::size_t each = exact_shots.bad.front().part->defects.size();
        for (std::size_t k = 0; k < tried.size(); ++k) {
            const auto& truth = exact->bad[family][k / (per_part * each) * each + k % each];
            flips += tried[k].found != (truth.score > detection.threshold) ? 1 : 0;
            defects += 1;
        }
        const PodCurve curve = pod_curve(tried);
        found[std::string(kFamilyNames[family])] = {{"auc", to_json(detection.auc)},
                                                    {"tpr", to_json(detection.tpr)},
                                                    {"a50", to_json(curve.a50)},
                                                    {"a90", to_json(curve.a90)},
                                                    {"a90_95", to_json(curve.a90_95)},
                                                    {"b0", curve.b0},
                                                    {"b1", curve.b1}};
        found["threshold"] = detection.threshold;
    }
    found["error"] = root_mean_square_error(*seen, *exact, options.good_exposures);
    found["flips"] = defects > 0 ? flips / defects : 0.0;
    return found;
}

}  // namespace

std::vector<algo::FeatureChoice> every_choice() {
    std::vector<algo::FeatureChoice> choices;
    for (std::size_t k = 0; k < algo::kFeatureNames.size(); ++k)
        choices.push_back({static_cast<algo::Feature>(k), false});
    for (std::size_t k = 0; k < algo::kFeatureNames.size(); ++k) {
        if (algo::is_distance(static_cast<algo::Feature>(k))) choices.push_back({static_cast<algo::Feature>(k), true});
    }
    return choices;
}

Result<Json> score_features(const TradeoffParts& parts, const TradeoffPoint& point, const ScoreOptions& options) {
    const Exposures shots = expose_all(parts, point, options), exact = expose_all_exactly(parts);
    const algo::Extents& extents = parts.nominal.front().extents;
    // Features are independent, so the result does not depend on the threads.
    const auto choices = every_choice();
    std::vector<Result<Json>> scored(choices.size());
    std::atomic<std::size_t> next = 0;
    const auto work = [&] {
        for (std::size_t k = next++; k < choices.size(); k = next++)
            scored[k] = score(choices[k], shots, exact, extents, point, options);
    };
    {
        const int threads =
            options.threads > 0 ? options.threads : static_cast<int>(std::max(1U, std::thread::hardware_concurrency()));
        std::vector<std::jthread> helpers;
        for (int k = 1; k < threads; ++k) helpers.emplace_back(work);
        work();
    }
    Json found;
    for (std::size_t k = 0; k < choices.size(); ++k) {
        if (!scored[k]) return scored[k];
        found[name_of(choices[k])] = std::move(*scored[k]);
    }
    return found;
}

}  // namespace hord::lab
