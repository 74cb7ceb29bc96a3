#include "algo/reference/reference_learner.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <memory>

#include "algo/frame/mask.h"
#include "algo/maps/feature_map.h"
#include "algo/reference/reference_comparison.h"
#include "common/statistics.h"

namespace hord::algo {
namespace {

constexpr double kShareOne = 1 << Reference::kShareBits;
// A part is not strange for less: so much good parts differ where they are interpolated between lenslets, each by how
// it lies.
constexpr float kStrange[kDeviations] = {0.05F, 0.05F, 0.02F, 0.05F};
// Standard deviations of a bin's mean, with a sixteenth of the reading noise in dark bins
// (algo/reference/reference_comparison.h), that noise alone has seldom.
constexpr double kNoise = 3;
constexpr float kMinSpread[kDeviations] = {1e-6F, 1e-5F, 1e-5F, 0};  // 0.1 % of light, 0.003 bin: rounding

// Gives a vector's memory back: the sums and shares of a large light field are most of what learning takes, and no pass
// needs all of them.
template <class T>
void release(std::vector<T>& what) {
    std::vector<T>().swap(what);
}

// A part's light, and, where asked for, its HORDs as shares.
struct Part {
    std::vector<std::uint32_t> sums;
    std::vector<Deflection> deflections;
    std::vector<std::uint8_t> mask;
    std::vector<float> light, x, y;
    std::vector<std::uint16_t> shares;

    [[nodiscard]] ReferenceMaps maps() const { return {light, x, y, mask}; }
};

double median_or_0(std::vector<double> values) { return values.empty() ? 0 : common::upper_median(std::span(values)); }

// What share of the sum of `parts` squared normal numbers the largest may have (Grubbs; about one in a thousand
// lenslets has more).
double grubbs_share(double parts) {
    const double t = 4.4 + 28 / (parts - 2), t2 = t * t;
    return (parts - 1) / parts * t2 / (parts - 2 + t2);
}

class Learner {
  public:
    Learner(const Extents& extents, int bits, std::size_t count, const FrameOfPart& frame_of,
            const LearnOptions& options)
        : extents_(extents), count_(count), frame_of_(frame_of), options_(options), row_(extents), registrar_(extents),
          poses_(count), lights_(count, 1.0), left_out_(count, false) {
        reference_.extents = extents;
        reference_.bits = bits;
        reference_.levels = options.levels;
        reference_.sensor = {options.electrons_per_dn.value_or(10.0F), options.read_dn,
                             std::max(0.0F, static_cast<float>(options.levels.dark) - options.pedestal_dn)};
    }
    Result<Learned> run();

  private:
    Result<Frame> frame(std::size_t part);
    void decode(const FrameView& frame, Part& part, bool with_shares);
    Result<bool> find_poses_from(std::size_t origin);
    void centre_poses();
    Result<void> learn_mean_hords(bool register_again);
    void add_reference_hord(const Part& part, const PoseMap& pose, double light);
    void finish_mean_hords(double parts, double light);
    void drop_noise(std::size_t k, double least);
    Result<void> learn_spread();
    void add_spread(std::uint32_t part, const Difference& d);
    void finish_spread(double parts);
    bool name_outliers();
    void leave_out(std::size_t part, std::string why);
    [[nodiscard]] std::size_t left() const { return count_ - left_out_list_.size(); }
    [[nodiscard]] Result<void> enough() const;
    void tick() {
        options_.progress(std::min(0.99, static_cast<double>(++ticks_) / (static_cast<double>(count_) * 6)));
    }

    Extents extents_;
    std::size_t count_;
    const FrameOfPart& frame_of_;
    const LearnOptions& options_;
    Reference reference_;
    HordRow row_;
    Registrar registrar_;
    std::vector<std::optional<Pose>> poses_;
    std::vector<double> lights_;  // of a part over the reference's
    std::vector<bool> left_out_;
    std::vector<LeftOut> left_out_list_;
    std::size_t ticks_ = 0;

    // Sums while reference HORDs are learned.
    std::vector<float> reference_hords_;
    std::vector<double> light_;
    std::vector<std::uint16_t> seen_light_, seen_hord_;

    // And while their spread is.
    struct Spread {
        std::array<float, kDeviations> squares{}, largest{}, variance{};
        float scores = 0, largest_score = 0;
        std::uint32_t largest_part = 0;
        std::uint16_t count = 0, hords = 0;
        float emd = 0, frobenius = 0;
    };
    std::vector<Spread> spread_;
    std::vector<double> chi2_ratios_;
};

Result<Frame> Learner::frame(std::size_t part) {
    auto frame = frame_of_(part);
    if (!frame) return frame;
    if (auto fine = check_frame(frame->view(), extents_, reference_.bits); !fine) return tl::unexpected(fine.error());
    tick();
    return frame;
}

void Learner::decode(const FrameView& frame, Part& part, bool with_shares) {
    const std::size_t count = extents_.lenslets(), stride = reference_.stride();
    part.sums.resize(count), part.deflections.resize(count), part.mask.resize(count);
    part.light.resize(count), part.x.resize(count), part.y.resize(count);
    if (with_shares) part.shares.assign(count * stride, 0);
    for (int n = 0; n < extents_.n; ++n) {
        decode_row(frame, extents_, reference_.levels, n, row_);
        const std::size_t at = static_cast<std::size_t>(n) * static_cast<std::size_t>(extents_.m);
        mean_deflections(row_, std::span(part.deflections).subspan(at, static_cast<std::size_t>(extents_.m)));
        for (int m = 0; m < extents_.m; ++m) {
            const std::size_t k = at + static_cast<std::size_t>(m);
            const Hord hord = row_.hord(m);
            part.sums[k] = hord.sum;
            part.mask[k] = row_.mask()[static_cast<std::size_t>(m)];
            part.light[k] = static_cast<float>(hord.sum);
            part.x[k] = part.deflections[k].x.to_float_rounded();
            part.y[k] = part.deflections[k].y.to_float_rounded();
            if (!with_shares || !row_.has_hord(m)) continue;
            for (int b = 0; b < extents_.bins(); ++b) {
                part.shares[k * stride + reference_.place(b % extents_.i, b / extents_.i)] =
                    static_cast<std::uint16_t>(std::lround(hord.mass[b] * kShareOne / hord.sum));
            }
        }
    }
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
        why += (why.empty() ? ": part " : "; part ") + std::to_string(out.part + 1) + ": " + out.why;
    return fail(ErrorCode::invalid_argument,
                std::to_string(left()) + " of " + std::to_string(count_) + " parts can be learned from" + why,
                "give at least " + std::to_string(Reference::kMinParts) + " frames of good parts that lie alike");
}

// Pass 1: false when most parts do not lie where this one does.
Result<bool> Learner::find_poses_from(std::size_t origin) {
    auto first = frame(origin);
    if (!first) return tl::unexpected(first.error());
    Part wanted, part;
    decode(first->view(), wanted, false);
    std::vector<LeftOut> out;
    for (std::size_t k = 0; k < count_; ++k) {
        auto one = frame(k);
        if (!one) return tl::unexpected(one.error());
        decode(one->view(), part, false);
        const Registered found = registrar_.find(wanted.maps(), part.deflections, part.sums, part.mask,
                                                 static_cast<double>(reference_.sensor.electrons_per_dn), 1);
        if (!found.found()) {
            out.push_back({k, explain(found.outcome)});
            continue;
        }
        poses_[k] = found.pose;
        lights_[k] = found.light;
    }
    if (2 * out.size() > count_) return false;
    for (LeftOut& o : out) leave_out(o.part, std::move(o.why));
    return true;
}

// Poses compared with the middle one.
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

// Adds a part's HORDs at the places of the reference's lenslets.
void Learner::add_reference_hord(const Part& part, const PoseMap& pose, double light) {
    const std::size_t stride = reference_.stride();
    const auto columns = static_cast<std::size_t>(extents_.m);
    std::size_t k = 0;
    for (int n = 0; n < extents_.n; ++n) {
        for (int m = 0; m < extents_.m; ++m, ++k) {
            const auto p = pose.to_part(m, n);
            const auto at = [&](int x, int y) {
                return static_cast<std::size_t>(y) * columns + static_cast<std::size_t>(x);
            };
            auto near = Surroundings::of(p.m, p.n, extents_,
                                         [&](int x, int y) { return (part.mask[at(x, y)] & kNoHord) == 0; });
            const bool dark = !near.found;
            if (dark) {
                near = Surroundings::of(p.m, p.n, extents_,
                                        [&](int x, int y) { return (part.mask[at(x, y)] & kSaturated) == 0; });
                if (!near.found) continue;
                near.along = CubicWeights::linear_at(p.m - std::floor(p.m)),
                near.across = CubicWeights::linear_at(p.n - std::floor(p.n));
            }
            float* to = reference_hords_.data() + k * stride;
            double sum = 0;
            for (int r = 0; r < 4; ++r) {
                for (int c = 0; c < 4; ++c) {
                    const double w = near.along.of[c] * near.across.of[r];
                    if (w == 0) continue;
                    const std::size_t from = at(near.m + c, near.n + r);
                    sum += w * static_cast<double>(part.sums[from]);
                    if (dark) continue;
                    const std::uint16_t* share = part.shares.data() + from * stride;
                    const auto weight = static_cast<float>(w);
                    for (std::size_t b = 0; b < stride; ++b) to[b] += weight * static_cast<float>(share[b]);
                }
            }
            light_[k] += sum / light;
            ++seen_light_[k];
            if (!dark) ++seen_hord_[k];
        }
    }
}

// Forgets what single readings left in bins far from all light, for the comparison need not look where nothing is
// expected: of the sums of shares, those below `least` but beside none that is as large, and those below a third of it.
void Learner::drop_noise(std::size_t k, double least) {
    float* const bins = reference_hords_.data() + k * reference_.stride();
    const auto limit = static_cast<float>(least);
    std::array<bool, kMaxBins * kMaxBins> keep{};
    const auto at = [&](int i, int j) { return static_cast<std::size_t>(j * extents_.i + i); };
    for (int j = 0; j < extents_.j; ++j) {
        for (int i = 0; i < extents_.i; ++i) {
            if (bins[reference_.place(i, j)] < limit) continue;
            for (int y = std::max(0, j - 1); y <= std::min(extents_.j - 1, j + 1); ++y) {
                for (int x = std::max(0, i - 1); x <= std::min(extents_.i - 1, i + 1); ++x) keep[at(x, y)] = true;
            }
        }
    }
    for (int j = 0; j < extents_.j; ++j) {
        for (int i = 0; i < extents_.i; ++i) {
            float& share = bins[reference_.place(i, j)];
            if (!keep[at(i, j)] || share < limit / 3) share = 0;
        }
    }
}

void Learner::finish_mean_hords(double parts, double light) {
    Reference& r = reference_;
    const std::size_t count = extents_.lenslets(), stride = r.stride();
    r.parts = static_cast<std::uint32_t>(parts);
    r.shares.assign(count * stride, 0);
    r.light.assign(count, 0);
    r.x.assign(count, 0);
    r.y.assign(count, 0);
    r.mask.assign(count, kOutside);
    const double read = static_cast<double>(r.sensor.read_dn),
                 least_dn = kNoise * std::sqrt((read * read + 1.0 / 12) / 16 / parts);
    for (std::size_t k = 0; k < count; ++k) {
        if (2 * seen_light_[k] < parts) continue;
        r.mask[k] = kDark;
        r.light[k] = static_cast<float>(std::max(0.0, light_[k] / seen_light_[k] * light));
        if (2 * seen_hord_[k] < parts) continue;
        if (r.light[k] > 0) drop_noise(k, seen_hord_[k] * least_dn / static_cast<double>(r.light[k]) * kShareOne);
        double sum = 0, x = 0, y = 0;
        for (int b = 0; b < extents_.bins(); ++b) {
            const double share = std::max(
                0.0, static_cast<double>(reference_hords_[k * stride + r.place(b % extents_.i, b / extents_.i)]));
            sum += share;
            x += share * (b % extents_.i - 0.5 * (extents_.i - 1));
            y += share * (b / extents_.i - 0.5 * (extents_.j - 1));
        }
        if (!(sum > 0)) continue;
        r.mask[k] = kValid;
        r.x[k] = static_cast<float>(x / sum);
        r.y[k] = static_cast<float>(y / sum);
        for (std::size_t b = 0; b < stride; ++b) {
            const long share =
                std::lround(std::max(0.0, static_cast<double>(reference_hords_[k * stride + b])) / sum * kShareOne);
            r.shares[k * stride + b] = static_cast<std::uint16_t>(std::min(share, long{Reference::kMaxShare}));
        }
    }
}

// Passes 2 and 3.
Result<void> Learner::learn_mean_hords(bool register_again) {
    const std::size_t count = extents_.lenslets();
    release(reference_.shares);  // found anew; registering needs its maps alone
    release(spread_);
    release(chi2_ratios_);
    reference_hords_.assign(count * reference_.stride(), 0);
    light_.assign(count, 0);
    seen_light_.assign(count, 0);
    seen_hord_.assign(count, 0);
    Part part;
    std::vector<double> lights;
    for (std::size_t k = 0; k < count_; ++k) {
        if (left_out_[k]) continue;
        auto one = frame(k);
        if (!one) return tl::unexpected(one.error());
        decode(one->view(), part, true);
        if (register_again) {
            const Registered found =
                registrar_.find(reference_.maps(), part.deflections, part.sums, part.mask,
                                static_cast<double>(reference_.sensor.electrons_per_dn), reference_.parts);
            if (!found.found()) {
                leave_out(k, explain(found.outcome));
                continue;
            }
            poses_[k] = found.pose;
            lights_[k] = found.light;
        }
        add_reference_hord(part, PoseMap(*poses_[k], extents_), lights_[k]);
        lights.push_back(lights_[k]);
    }
    if (auto fine = enough(); !fine) return fine;
    release(part.shares);
    finish_mean_hords(static_cast<double>(lights.size()), median_or_0(lights));
    release(reference_hords_);
    return {};
}

void Learner::add_spread(std::uint32_t part, const Difference& d) {
    if (!d.has_light) return;
    Spread& s = spread_[d.at];
    double score = 0;
    const auto add = [&](Deviation which, float square, float variance) {
        const auto w = static_cast<std::size_t>(which);
        s.squares[w] += square;
        s.largest[w] = std::max(s.largest[w], square);
        s.variance[w] += variance;
        score += static_cast<double>(square / (variance + kStrange[w] * kStrange[w]));
    };
    ++s.count;
    add(Deviation::light, d.light * d.light, d.light_variance);
    if (d.has_hord) {
        ++s.hords;
        add(Deviation::deflection_shift, (d.x * d.x + d.y * d.y) / 2, (d.x_variance + d.y_variance) / 2);
        add(Deviation::scattering, d.scattering * d.scattering, d.blur_variance);
        const auto w = static_cast<std::size_t>(Deviation::shape);
        const float excess = (d.chi2 - d.degrees) / d.sum;
        s.squares[w] += excess;
        s.largest[w] = std::max(s.largest[w], excess);
        score += static_cast<double>(std::max(0.0F, excess / (std::sqrt(2 * d.degrees) / d.sum + kStrange[w])));
        if (chi2_ratios_.size() < 4'000'000) chi2_ratios_.push_back(static_cast<double>(d.chi2 / d.degrees));
    }
    s.scores += static_cast<float>(score);
    if (static_cast<float>(score) > s.largest_score) {
        s.largest_score = static_cast<float>(score);
        s.largest_part = part;
    }
}

void Learner::finish_spread(double parts) {
    const std::size_t count = extents_.lenslets();
    const double own = parts / (parts - 1);            // each part is part of the mean
    const double largest = 2 * std::log(parts) - 0.6;  // of squared normal numbers
    const double trimmed = 1 / (parts - largest);      // and of their sum without it
    std::vector<float> tail(count, 0);                 // the excess that the largest alone would mean
    std::vector<double> tails;
    std::array<std::vector<float>, kDeviations> alone;
    for (std::size_t w = 0; w < kDeviations; ++w) {
        alone[w].assign(count, -1);
        std::ranges::fill(tail, 0.0F);
        for (std::size_t k = 0; k < count; ++k) {
            const Spread& s = spread_[k];
            const double seen = w == 0 ? s.count : s.hords;
            if (2 * seen < parts) continue;
            double excess = 0;
            if (w == static_cast<std::size_t>(Deviation::shape)) {
                excess = static_cast<double>(s.squares[w] - s.largest[w]) / std::max(1.0, seen - 1);
            } else {
                const double noise = static_cast<double>(s.variance[w]) / seen;
                // By as much as it may be larger than it looks (two standard deviations of nine lenslets): with more
                // light that is what is left.
                const double unsure = 2 * noise * std::sqrt(2 / (9 * parts));
                excess =
                    unsure + own * static_cast<double>(s.squares[w] - s.largest[w]) * trimmed * parts / seen - noise;
                tail[k] = static_cast<float>(own * static_cast<double>(s.largest[w]) / largest - noise + unsure);
            }
            alone[w][k] = static_cast<float>(excess);
        }
        auto& spread = reference_.spread[w];
        spread.assign(count, 0);
        for (int n = 0; n < extents_.n; ++n) {
            for (int m = 0; m < extents_.m; ++m) {
                double sum = 0, number = 0;
                tails.clear();
                for (int y = std::max(0, n - 1); y <= std::min(extents_.n - 1, n + 1); ++y) {
                    for (int x = std::max(0, m - 1); x <= std::min(extents_.m - 1, m + 1); ++x) {
                        const auto k = static_cast<std::size_t>(y * extents_.m + x);
                        if (2 * (w == 0 ? spread_[k].count : spread_[k].hords) < parts) continue;
                        sum += static_cast<double>(alone[w][k]);
                        number += 1;
                        tails.push_back(static_cast<double>(tail[k]));
                    }
                }
                spread[static_cast<std::size_t>(n * extents_.m + m)] = std::max(
                    kMinSpread[w], static_cast<float>(number > 0 ? std::max(sum / number, median_or_0(tails)) : 0));
            }
        }
    }
    reference_.emd.assign(count, 0);
    reference_.frobenius.assign(count, 0);
    for (std::size_t k = 0; k < count; ++k) {
        if (spread_[k].hords == 0) continue;
        reference_.emd[k] = spread_[k].emd / spread_[k].hords;
        reference_.frobenius[k] = spread_[k].frobenius / spread_[k].hords;
    }
}

// Pass 4.
Result<void> Learner::learn_spread() {
    std::array<std::optional<FeatureMapper>, 2> mappers;
    for (std::size_t f = 0; f < 2; ++f) {
        auto mapper = FeatureMapper::create(extents_, reference_.bits, reference_.levels,
                                            f == 0 ? Feature::emd : Feature::jacobian_frobenius,
                                            {{}, options_.threads, best_isa()});
        if (!mapper) return tl::unexpected(mapper.error());
        mappers[f].emplace(std::move(*mapper));
    }
    ReferenceComparer comparer(reference_);
    std::vector<Difference> differences(static_cast<std::size_t>(extents_.m));
    Part part;
    spread_.assign(extents_.lenslets(), {});
    chi2_ratios_.clear();
    for (std::size_t p = 0; p < count_; ++p) {
        if (left_out_[p]) continue;
        auto one = frame(p);
        if (!one) return tl::unexpected(one.error());
        decode(one->view(), part, false);
        const Registered found =
            registrar_.find(reference_.maps(), part.deflections, part.sums, part.mask,
                            static_cast<double>(reference_.sensor.electrons_per_dn), reference_.parts);
        if (!found.found()) {
            leave_out(p, explain(found.outcome));
            continue;
        }
        poses_[p] = found.pose;
        auto emd = mappers[0]->over_neighbours(one->view());
        if (!emd) return tl::unexpected(emd.error());
        auto frobenius = mappers[1]->over_neighbours(one->view());
        if (!frobenius) return tl::unexpected(frobenius.error());
        const PoseMap pose(found.pose, extents_);
        for (int n = 0; n < extents_.n; ++n) {
            decode_row(one->view(), extents_, reference_.levels, n, row_);
            comparer.compare_row(row_, n, pose, found.light, differences);
            for (std::size_t m = 0; m < differences.size(); ++m) {
                const Difference& d = differences[m];
                add_spread(static_cast<std::uint32_t>(p), d);
                if (!d.has_hord) continue;
                const std::size_t k = static_cast<std::size_t>(n) * differences.size() + m;
                spread_[d.at].emd += emd->values[k];
                spread_[d.at].frobenius += frobenius->values[k];
            }
        }
    }
    if (auto fine = enough(); !fine) return fine;
    finish_spread(static_cast<double>(left()));
    return {};
}

// Leaves out the parts that alone make the spread of many lenslets; false when there is none.
bool Learner::name_outliers() {
    const double most = grubbs_share(static_cast<double>(left()));
    std::vector<double> alone(count_, 0);
    for (const Spread& s : spread_) {
        if (s.largest_score > 25 && static_cast<double>(s.largest_score) > most * static_cast<double>(s.scores))
            ++alone[s.largest_part];
    }
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

Result<Learned> Learner::run() {
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
    bool calibrated = options_.electrons_per_dn.has_value();
    for (;;) {
        if (auto done = learn_mean_hords(true); !done) return tl::unexpected(done.error());
        if (auto done = learn_spread(); !done) return tl::unexpected(done.error());
        if (!calibrated && !chi2_ratios_.empty()) {
            // Twice: the floor of read noise does not scale.
            for (int again = 0; again < 2; ++again) {
                const double ratio = std::clamp(median_or_0(chi2_ratios_), 1e-3, 1e3);
                reference_.sensor.electrons_per_dn = static_cast<float>(
                    std::clamp(static_cast<double>(reference_.sensor.electrons_per_dn) / ratio, 1e-3, 1e5));
                if (auto done = learn_spread(); !done) return tl::unexpected(done.error());
            }
            calibrated = true;
        }
        if (!name_outliers()) break;
        if (auto fine = enough(); !fine) return tl::unexpected(fine.error());
    }
    options_.progress(1);
    reference_.parts = static_cast<std::uint32_t>(left());
    return Learned{std::move(reference_), std::move(left_out_list_), std::move(poses_)};
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
