#include "algo/reference/reference_learner.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <memory>

#include "algo/maps/feature_map.h"
#include "algo/reference/learning_frames.h"
#include "algo/reference/light_patches.h"
#include "algo/reference/limit_of_parts.h"
#include "algo/reference/photon_noise.h"
#include "algo/reference/pooled_scores.h"
#include "algo/reference/reference_comparison.h"
#include "algo/reference/reference_mean.h"
#include "algo/reference/spread_estimate.h"

namespace hord::algo {
namespace {

// The spread is that of parts from the mean of the others: as many times parts are left out of it.
constexpr std::size_t kMaxFolds = 16;
// Of the score of a square of lenslets: noise reaches more in every part.
constexpr float kMinPatch = 3;

// Frees a vector's memory. Sums and shares of a large light field are most of the memory of learning, and no pass needs
// all of them.
template <class T>
void release(std::vector<T>& values) {
    std::vector<T>().swap(values);
}

class Learner {
  public:
    Learner(const Extents& extents, int bits, std::size_t count, const FrameOfPart& frame_of,
            const LearnOptions& options)
        : extents_(extents), count_(count), options_(options), frames_(extents, bits, count, frame_of, options),
          registrar_(extents), poses_(count), lights_(count, 1.0), determined_(count), left_out_(count, false),
          mean_(extents) {
        reference_.extents = extents;
        reference_.bits = bits;
        reference_.levels = options.levels;
        reference_.sensor = {options.electrons_per_dn.value_or(10.0F), options.read_dn,
                             std::max(0.0F, static_cast<float>(options.levels.dark) - options.pedestal_dn)};
    }
    Result<Learned> run();

  private:
    Result<void> estimate_photon_noise();
    Result<Frame> decode(std::size_t of, DecodedPart& part, bool with_shares = false) {
        tick();
        return frames_.decode(of, reference_, part, with_shares);
    }
    Registered find(const ReferenceMaps& reference, const DecodedPart& part, std::uint32_t parts);
    bool find_pose(std::size_t k, const DecodedPart& part);
    Result<bool> find_poses_from(std::size_t origin);
    void centre_poses();
    Result<void> learn_mean_hords(bool register_again);
    Result<void> learn_spread();
    Result<void> learn_spread_of(std::span<const std::size_t> fold, const Reference& others,
                                 std::array<std::optional<FeatureMapper>, 2>& mappers);
    Result<void> change_mean(std::span<const std::size_t> fold, bool add);
    Result<void> learn_pooled_scales();
    bool name_outliers();
    void leave_out(std::size_t part, std::string why);
    [[nodiscard]] std::size_t left() const { return count_ - left_out_list_.size(); }
    [[nodiscard]] Result<void> enough() const;
    [[nodiscard]] std::array<bool, 3> pose_determined() const;
    void tick() {
        options_.progress(std::min(0.99, static_cast<double>(++ticks_) / (static_cast<double>(count_) * 8)));
    }

    Extents extents_;
    std::size_t count_;
    const LearnOptions& options_;
    Reference reference_;
    LearningFrames frames_;
    Registrar registrar_;
    std::vector<std::optional<Pose>> poses_;
    std::vector<double> lights_;  // of a part over the reference's
    std::vector<std::array<bool, 3>> determined_;
    std::vector<bool> left_out_;
    std::vector<LeftOut> left_out_list_;
    std::size_t ticks_ = 0;
    bool calibrated_ = false;  // the sensor's electrons a DN are known
    bool gain_unsure_ = false;

    ReferenceMean mean_;
    double typical_light_ = 1;  // of the parts of the mean
    std::optional<SpreadEstimate> spread_;
    SizeSpread sizes_;
    BlurSpread blurs_;
};

// Keeps the estimate of learn_spread() if no place of the field shows the photon noise alone.
Result<void> Learner::estimate_photon_noise() {
    const auto lowered = [&](std::size_t part) -> Result<std::optional<Frame>> {
        if (left_out_[part]) return std::nullopt;
        auto frame = frames_.lowered(part, reference_);
        if (!frame) return tl::unexpected(frame.error());
        return std::optional(std::move(*frame));
    };
    const double pedestal =
        static_cast<double>(reference_.levels.dark) - static_cast<double>(reference_.sensor.clip_dn);
    const auto found = electrons_per_dn_of(reference_, pedestal, count_, lowered);
    if (!found) return tl::unexpected(found.error());
    if (*found) reference_.sensor.electrons_per_dn = **found, calibrated_ = true;
    return {};
}

Registered Learner::find(const ReferenceMaps& reference, const DecodedPart& part, std::uint32_t parts) {
    return registrar_.find(reference, part.deflections, part.sums, part.mask,
                           static_cast<double>(reference_.sensor.electrons_per_dn), parts);
}

// Registers a part to the reference as learned so far; leaves it out if that fails.
bool Learner::find_pose(std::size_t k, const DecodedPart& part) {
    const Registered found = find(reference_.maps(), part, reference_.parts);
    if (!found.found()) {
        leave_out(k, explain(found));
        return false;
    }
    poses_[k] = found.pose;
    lights_[k] = found.light;
    determined_[k] = found.determined;
    return true;
}

void Learner::leave_out(std::size_t part, std::string why) {
    left_out_[part] = true;
    poses_[part].reset();
    left_out_list_.push_back({part, std::move(why)});
}

Result<void> Learner::enough() const {
    if (left() >= Reference::kMinParts) return {};
    std::string why;
    for (const LeftOut& out : left_out_list_)
        why += (why.empty() ? ": " : "; ") + options_.name_of(out.part) + ": " + out.why;
    return fail(ErrorCode::invalid_argument,
                std::to_string(left()) + " of " + std::to_string(count_) + " parts can be learned from" + why,
                "give at least " + std::to_string(Reference::kMinParts) + " frames of good parts that lie alike");
}

// Pass 1, with part `origin` as the reference. False if most parts cannot be registered to it.
Result<bool> Learner::find_poses_from(std::size_t origin) {
    DecodedPart reference, part;
    if (auto first = decode(origin, reference); !first) return tl::unexpected(first.error());
    std::vector<LeftOut> out;
    for (std::size_t k = 0; k < count_; ++k) {
        if (auto one = decode(k, part); !one) return tl::unexpected(one.error());
        const Registered found = find(reference.maps(), part, 1);
        if (!found.found()) {
            out.push_back({k, explain(found)});
            continue;
        }
        poses_[k] = found.pose;
        lights_[k] = found.light;
    }
    if (2 * out.size() > count_) return false;
    for (LeftOut& o : out) leave_out(o.part, std::move(o.why));
    return true;
}

// Makes poses relative to their median.
void Learner::centre_poses() {
    std::vector<double> x, y, turn;
    for (const auto& pose : poses_) {
        if (pose) x.push_back(pose->x), y.push_back(pose->y), turn.push_back(pose->turn_rad());
    }
    const double mx = median_or_0(x), my = median_or_0(y), mt = median_or_0(turn);
    for (auto& pose : poses_) {
        if (!pose) continue;
        const double t = pose->turn_rad() - mt, s = std::sin(t), c = std::cos(t);
        *pose = {pose->x - (c * mx - s * my), pose->y - (c * my + s * mx), s};
    }
}

// Passes 2 and 3.
Result<void> Learner::learn_mean_hords(bool register_again) {
    release(reference_.shares);  // registration needs only the maps
    spread_.reset();
    mean_.clear();
    DecodedPart part;
    std::vector<double> lights;
    for (std::size_t k = 0; k < count_; ++k) {
        if (left_out_[k]) continue;
        if (auto one = decode(k, part, true); !one) return tl::unexpected(one.error());
        if (register_again && !find_pose(k, part)) continue;
        mean_.add(part, PoseMap(*poses_[k], extents_), lights_[k]);
        lights.push_back(lights_[k]);
    }
    if (auto fine = enough(); !fine) return fine;
    release(part.shares);
    typical_light_ = median_or_0(lights);
    mean_.finish(static_cast<double>(lights.size()), typical_light_, reference_);
    return {};
}

// Adds parts to the mean or takes them out of it.
Result<void> Learner::change_mean(std::span<const std::size_t> fold, bool add) {
    DecodedPart part;
    for (const std::size_t p : fold) {
        if (auto one = decode(p, part, true); !one) return tl::unexpected(one.error());
        const PoseMap pose(*poses_[p], extents_);
        if (add) mean_.add(part, pose, lights_[p]);
        else mean_.remove(part, pose, lights_[p]);
    }
    return {};
}

// Pass 4. A part that is part of the mean lies nearer to it than the next one will: light that only this part has
// somewhere is then expected there. So each part is compared with the mean of the others.
Result<void> Learner::learn_spread() {
    std::array<std::optional<FeatureMapper>, 2> mappers;
    for (std::size_t f = 0; f < 2; ++f) {
        auto mapper = FeatureMapper::create(extents_, reference_.bits, reference_.levels,
                                            f == 0 ? Feature::emd : Feature::jacobian_frobenius,
                                            {{}, options_.threads, best_isa()});
        if (!mapper) return tl::unexpected(mapper.error());
        mappers[f].emplace(std::move(*mapper));
    }
    release(reference_.shares);
    spread_.emplace(extents_);
    sizes_ = {};
    blurs_ = {};
    std::vector<std::size_t> parts;
    for (std::size_t p = 0; p < count_; ++p) {
        if (!left_out_[p]) parts.push_back(p);
    }
    const std::size_t folds = std::min(parts.size(), kMaxFolds);
    Reference others = reference_;
    std::vector<std::size_t> fold;
    for (std::size_t f = 0; f < folds; ++f) {
        fold.clear();
        for (std::size_t k = f; k < parts.size(); k += folds) fold.push_back(parts[k]);
        if (auto done = change_mean(fold, false); !done) return done;
        mean_.finish(static_cast<double>(parts.size() - fold.size()), typical_light_, others);
        if (auto done = learn_spread_of(fold, others, mappers); !done) return done;
        if (auto done = change_mean(fold, true); !done) return done;
    }
    if (auto fine = enough(); !fine) return fine;
    mean_.finish(static_cast<double>(parts.size()), typical_light_, reference_);
    spread_->finish(static_cast<double>(left()), reference_);
    return {};
}

// Adds the deviations of parts from `others`, the mean of the other parts.
Result<void> Learner::learn_spread_of(std::span<const std::size_t> fold, const Reference& others,
                                      std::array<std::optional<FeatureMapper>, 2>& mappers) {
    ReferenceComparer comparer(others);
    std::vector<Difference> differences(static_cast<std::size_t>(extents_.m));
    DecodedPart part;
    for (const std::size_t p : fold) {
        const auto one = decode(p, part);
        if (!one) return tl::unexpected(one.error());
        const Registered found = find(others.maps(), part, others.parts);
        if (!found.found()) continue;
        auto emd = mappers[0]->over_neighbours(one->view());
        if (!emd) return tl::unexpected(emd.error());
        auto frobenius = mappers[1]->over_neighbours(one->view());
        if (!frobenius) return tl::unexpected(frobenius.error());
        sizes_.add(found.size);
        blurs_.add(found.blur);
        const PoseMap pose(found.pose, extents_);
        for (int n = 0; n < extents_.n; ++n) {
            const std::size_t first = extents_.index(0, n);
            comparer.compare_row(one->view(), std::span(part.sums).subspan(first, differences.size()),
                                 std::span(part.mask).subspan(first, differences.size()), n, pose, found.light,
                                 reference_.levels.dark, differences);
            for (std::size_t m = 0; m < differences.size(); ++m) {
                const std::size_t k = first + m;
                spread_->add(static_cast<std::uint32_t>(p), differences[m], emd->values[k], frobenius->values[k]);
            }
        }
    }
    return {};
}

// Pass 5: also the limit of squares of lenslets. Each part is part of the mean here, which makes its deviations from it
// smaller; they are corrected as independent ones.
Result<void> Learner::learn_pooled_scales() {
    ReferenceComparer comparer(reference_);
    PooledScorer scorer(extents_);
    LightPatches patches(reference_);
    std::vector<double> highest;  // score of a square of each part
    std::vector<Difference> differences(extents_.lenslets());
    std::vector<std::vector<double>> scales(pooled_filters().size());
    const auto columns = static_cast<std::size_t>(extents_.m);
    DecodedPart part;
    for (std::size_t p = 0; p < count_; ++p) {
        if (left_out_[p]) continue;
        const auto one = decode(p, part);
        if (!one) return tl::unexpected(one.error());
        const Registered found = find(reference_.maps(), part, reference_.parts);
        if (!found.found()) continue;
        const PoseMap pose(found.pose, extents_);
        for (int n = 0; n < extents_.n; ++n) {
            const std::size_t first = extents_.index(0, n);
            comparer.compare_row(one->view(), std::span(part.sums).subspan(first, columns),
                                 std::span(part.mask).subspan(first, columns), n, pose, found.light,
                                 reference_.levels.dark, std::span(differences).subspan(first, columns));
        }
        patches.load(differences, part.mask, reference_);
        const LightPatch patch = patches.strongest(kMinPatch);
        highest.push_back(std::max(static_cast<double>(std::abs(patch.score)), static_cast<double>(kMinPatch)));
        const std::span<const float> of_part = scorer.measure(differences, part.mask, reference_);
        for (std::size_t f = 0; f < scales.size(); ++f) {
            if (of_part[f] > 0) scales[f].push_back(static_cast<double>(of_part[f]));
        }
    }
    const auto parts = static_cast<double>(left());
    const double correction = std::sqrt((parts + 1) / (parts - 1));
    reference_.patch_limit = static_cast<float>(correction * limit_of_parts(highest));
    reference_.pooled_scales.clear();
    for (std::vector<double>& of_filter : scales)
        reference_.pooled_scales.push_back(static_cast<float>(correction * median_or_0(std::move(of_filter))));
    return {};
}

// Leaves out parts that dominate the spread of many lenslets; false if there are none.
bool Learner::name_outliers() {
    const std::vector<double> alone = spread_->sole_deviations(count_, static_cast<double>(left()));
    std::vector<double> counts;
    for (std::size_t p = 0; p < count_; ++p) {
        if (!left_out_[p]) counts.push_back(alone[p]);
    }
    const double limit = kOutlierLenslets + 4 * median_or_0(counts);
    bool any = false;
    for (std::size_t p = 0; p < count_; ++p) {
        if (left_out_[p] || alone[p] <= limit) continue;
        leave_out(p, "it differs from all others in " + std::to_string(static_cast<int>(alone[p])) + " lenslets");
        any = true;
    }
    return any;
}

// By most of the parts that are left.
std::array<bool, 3> Learner::pose_determined() const {
    std::array<std::size_t, 3> counts{};
    for (std::size_t p = 0; p < count_; ++p) {
        for (std::size_t u = 0; u < 3; ++u) counts[u] += !left_out_[p] && determined_[p][u] ? 1 : 0;
    }
    return {2 * counts[0] > left(), 2 * counts[1] > left(), 2 * counts[2] > left()};
}

Result<Learned> Learner::run() {
    if (options_.dark_from_noise) {
        if (auto done = frames_.choose_dark_level(reference_); !done) return tl::unexpected(done.error());
    }
    bool agreed = false;
    for (std::size_t origin = 0; origin < std::min<std::size_t>(count_, 3) && !agreed; ++origin) {
        poses_.assign(count_, std::nullopt);
        auto done = find_poses_from(origin);
        if (!done) return tl::unexpected(done.error());
        agreed = *done;
    }
    if (!agreed) {
        return fail(ErrorCode::invalid_argument,
                    "most of the parts do not lie where the others do, or do not look alike",
                    "give frames of one kind of part, placed within two lenslets and three degrees");
    }
    if (auto fine = enough(); !fine) return tl::unexpected(fine.error());
    centre_poses();
    if (auto done = learn_mean_hords(false); !done) return tl::unexpected(done.error());
    calibrated_ = options_.electrons_per_dn.has_value();
    if (!calibrated_) {
        if (auto done = estimate_photon_noise(); !done) return tl::unexpected(done.error());
    }
    for (;;) {
        if (auto done = learn_mean_hords(true); !done) return tl::unexpected(done.error());
        if (auto done = learn_spread(); !done) return tl::unexpected(done.error());
        if (!calibrated_ && !spread_->empty()) {
            // Twice, because read noise does not scale with the light.
            for (int again = 0; again < 2; ++again) {
                const double ratio = std::clamp(spread_->median_chi2_ratio(), 1e-3, 1e3);
                reference_.sensor.electrons_per_dn = static_cast<float>(
                    std::clamp(static_cast<double>(reference_.sensor.electrons_per_dn) / ratio, 1e-3, 1e5));
                if (auto done = learn_spread(); !done) return tl::unexpected(done.error());
            }
            calibrated_ = gain_unsure_ = true;
        }
        if (!name_outliers()) break;
        if (auto fine = enough(); !fine) return tl::unexpected(fine.error());
    }
    reference_.parts = static_cast<std::uint32_t>(left());
    reference_.size_limits = sizes_.limits();
    reference_.blur_limits = blurs_.limits();
    if (auto done = learn_pooled_scales(); !done) return tl::unexpected(done.error());
    options_.progress(1);
    const std::array<bool, 3> determined = pose_determined();
    return Learned{std::move(reference_), std::move(left_out_list_), std::move(poses_), gain_unsure_, determined};
}

}  // namespace

Result<Learned> learn_reference(const Extents& extents, int bits, std::size_t count, const FrameOfPart& frame_of,
                                const LearnOptions& options) {
    if (auto fine = check(extents); !fine) return tl::unexpected(fine.error());
    if (auto fine = check_bits(bits); !fine) return tl::unexpected(fine.error());
    if (count < Reference::kMinParts || count > 60'000) {
        return fail(ErrorCode::invalid_argument, std::to_string(count) + " frames to learn from",
                    "give at least " + std::to_string(Reference::kMinParts));
    }
    return Learner(extents, bits, count, frame_of, options).run();
}

}  // namespace hord::algo
