#include "algo/inspection/frame_checks.h"

#include <algorithm>
#include <cmath>

#include "algo/frame/lenslet_scan.h"
#include "algo/frame/mask.h"
#include "algo/reference/reference.h"
#include "common/statistics.h"

namespace hord::algo {
namespace {

constexpr std::size_t kMaxChosen = 256, kMaxInside = 1024;  // lenslets whose light is measured
constexpr std::size_t kMinChosen = 8;
constexpr std::uint32_t kMaxKnownRise8Bit = 2;  // DN at 8 bits; a sensor of which most dark bins read 0 needs no more
constexpr double kPi = 3.141592653589793;

bool is_light(FrameFault fault) { return fault >= FrameFault::pedestal && fault <= FrameFault::interrupted; }

// Little light may be the cause. (Where nothing but free light is seen, it is none.)
bool hides_part(FrameFault fault) { return fault != FrameFault::none && fault != FrameFault::nothing; }

Reason reason_of(FrameFault fault) {
    if (fault == FrameFault::none) return Reason::none;
    if (fault == FrameFault::dim) return Reason::too_dark;
    if (fault >= FrameFault::other_period && fault <= FrameFault::turned) return Reason::unexpected_geometry;
    return is_light(fault) ? Reason::unexpected_light : Reason::no_part;
}

template <class Visit>
void for_each_outermost(const Extents& e, Visit&& visit) {
    for (int n = 0; n < e.n; ++n) {
        const bool whole_row = n == 0 || n == e.n - 1;
        for (int m = 0; m < e.m; m += whole_row ? 1 : e.m - 1) visit(e.index(m, n));
    }
}

// The typical good part as a frame.
Frame frame_of(const Reference& r) {
    const Extents& e = r.extents;
    Frame frame(e.width_px(), e.height_px(), r.bits);
    for (std::size_t k = 0; k < e.lenslets(); ++k) {
        const int m = static_cast<int>(k) % e.m, n = static_cast<int>(k) / e.m;
        for (int b = 0; b < e.bins(); ++b) {
            const int i = b % e.i, j = b / e.i;
            const float light = r.light[k] * 0x1p-15F * r.shares[k * r.stride() + r.place(i, j)];
            frame.set(m * e.i + i, n * e.j + j,
                      std::min(static_cast<std::uint32_t>(light), (1U << static_cast<unsigned>(r.bits)) - 1U));
        }
    }
    return frame;
}

// The widest spot along an axis of so many bins.
double widest(float limit_bins, int bins) {
    return std::min(static_cast<double>(limit_bins), kMaxSpotOfEven * rms_of_even_light(bins));
}

// The coarser the outline, the less regular it is.
double least_of_outline(double of_fine_one, std::size_t area) {
    const double diameter = 2 * std::sqrt(static_cast<double>(area) / kPi);
    return std::max(0.8, of_fine_one - 0.6 / std::max(diameter, 1.0));
}

}  // namespace

FrameChecks::FrameChecks(const Extents& extents, int bits, const Recipe& recipe)
    : extents_(extents), levels_(light_levels(recipe, bits)), max_dark_rise_dn_(max_dark_rise(recipe, bits)),
      dark_level_(kind_of_dark_level(recipe)), max_offset_bins_(recipe.max_offset_bins),
      max_spot_bins_(recipe.max_spot_bins), max_second_share_(recipe.max_second_share), form_(recipe.form),
      check_period_(recipe.check_period), part_required_(recipe.part_required), symmetric_(recipe.symmetric_outline),
      has_reference_(recipe.reference != nullptr), dark_bins_(extents, bits), period_(extents) {
    chosen_.reserve(kMaxInside);
    scratch_.resize(kMaxChosen);
    if (!recipe.reference) return;
    expect_light_of_reference(*recipe.reference);
    if (recipe.dark_dn == 0 && recipe.reference->extents == extents) known_dark_ = {*recipe.reference, dark_bins_};
}

// Free light is expected where the outermost lenslets that the reference knows show it: parts that lie elsewhere, or
// turned, leave some at the field's border unknown. Where fewer than half of them have light, the middle of the bins
// stays. A part whose light moves evenly from lenslet to lenslet repeats with another period than the macro-pixels:
// that of the reference's own light is expected, too.
void FrameChecks::expect_light_of_reference(const Reference& reference) {
    if (!(reference.extents == extents_)) return;
    // The first and last lenslets that it knows of every row and column: of turned parts they make no rectangle.
    std::vector<std::size_t> outermost;
    const auto add_ends = [&](int lines, int length, auto&& index) {
        const auto is_known = [&](int line, int at) { return (reference.mask[index(line, at)] & kOutside) == 0; };
        for (int line = 0; line < lines; ++line) {
            int first = 0, last = length - 1;
            while (first < length && !is_known(line, first)) ++first;
            while (last > first && !is_known(line, last)) --last;
            if (first < length) outermost.push_back(index(line, first));
            if (first < last) outermost.push_back(index(line, last));
        }
    };
    add_ends(extents_.n, extents_.m, [&](int n, int m) { return extents_.index(m, n); });
    add_ends(extents_.m, extents_.n, [&](int m, int n) { return extents_.index(m, n); });
    std::vector<float> x, y;
    for (const std::size_t k : outermost) {
        if (reference.mask[k] != kValid) continue;
        x.push_back(reference.x[k]);
        y.push_back(reference.y[k]);
    }
    if (check_period_) period_of_reference_ = period_.find(frame_of(reference).view());
    if (outermost.empty() || 2 * x.size() < outermost.size()) return;
    expected_x_ = static_cast<double>(common::lower_median(std::span(x)));
    expected_y_ = static_cast<double>(common::lower_median(std::span(y)));
}

LightLevels FrameChecks::levels_of(const FrameView& frame) {
    const DarkBins dark = dark_bins_.measure(frame);
    FrameLevels found = levels_above_dark_bins(levels_, dark, max_dark_rise_dn_, dark_level_);
    if (known_dark_.any()) {
        const std::uint32_t by_fractions = levels_.dark + (kMaxKnownRise8Bit << static_cast<unsigned>(frame.bits - 8));
        found.levels.dark = known_dark_.level_of(frame, levels_.dark, std::max(found.levels.dark, by_fractions));
    }
    findings_ = {.dark_measured = dark.measured,
                 .pedestal_dn = static_cast<float>(dark.pedestal_dn),
                 .dark_noise_dn = static_cast<float>(dark.noise_dn),
                 .wanted_dark_dn = static_cast<float>(found.wanted_dn),
                 .dark_limit_dn = static_cast<float>(levels_.dark + max_dark_rise_dn_),
                 .noise_limit_dn = static_cast<float>(levels_.dark + 2 * max_dark_rise_dn_)};
    fault_of_dark_ = !found.pedestal_allowed ? FrameFault::pedestal
        : !found.noise_allowed               ? FrameFault::noise
                                             : FrameFault::none;
    dark_dn_ = found.levels.dark;
    return found.levels;
}

// The lenslets that suit, evenly thinned.
template <class Suits>
void FrameChecks::choose_lenslets(std::size_t lenslets, std::size_t most, Suits suits) {
    const std::size_t count = count_suiting(0, lenslets, suits);
    const std::size_t step = std::max<std::size_t>((count + most - 1) / most, 1);
    chosen_.clear();
    std::size_t nth = 0, next = 0;  // of those that suit
    for (std::size_t k = 0; k < lenslets; k += kScanBlock) {
        const std::size_t end = std::min(k + kScanBlock, lenslets), here = count_suiting(k, end, suits);
        for (std::size_t at = k, n = nth; next < nth + here; ++at) {
            if (!suits(at) || n++ != next) continue;
            chosen_.push_back(static_cast<std::uint32_t>(at));
            next += step;
        }
        nth += here;
    }
}

// Without dark bins the pedestal is not known: a pedestal would count as light.
LightScale FrameChecks::scale_of(const FrameView& frame, const FoundPart& part) {
    constexpr std::size_t kMaxOfScale = 64;  // lenslets: the mean of a bin of 10 DN is right to 2 % at 3 electrons a DN
    if (!findings_.dark_measured || !part.free_light) return {};
    choose_lenslets(part.state.size(), kMaxOfScale,
                    [state = part.state](std::size_t k) { return (state[k] & FoundPart::kFreeField) != 0; });
    return {frame, extents_, chosen_, static_cast<double>(findings_.pedestal_dn), static_cast<double>(dark_dn_)};
}

Deflection FrameChecks::median_of_chosen(const DecodedField& field) {
    const auto median = [&](auto&& value_of) {
        for (std::size_t k = 0; k < chosen_.size(); ++k) scratch_[k] = value_of(field.deflections[chosen_[k]]);
        return DeflectionQ::from_raw(common::lower_median(std::span(scratch_).first(chosen_.size())));
    };
    return {median([](const Deflection& d) { return std::int64_t{d.x.raw()}; }),
            median([](const Deflection& d) { return std::int64_t{d.y.raw()}; })};
}

FrameFault FrameChecks::check_light(const FrameView& frame, const DecodedField& field, const FoundPart& part,
                                    const Alternation& alternation) {
    // Those of the free light; without free light all that have a HORD.
    const auto has_hord = [mask = field.mask](std::size_t k) { return (mask[k] & kNoHord) == 0; };
    if (part.free_light) {
        choose_lenslets(field.mask.size(), kMaxChosen, [=, state = part.state](std::size_t k) {
            return has_hord(k) & ((state[k] & FoundPart::kFreeField) != 0);
        });
    } else {
        choose_lenslets(field.mask.size(), kMaxChosen, has_hord);
    }
    findings_.in_free_light = part.free_light;
    if (chosen_.size() < kMinChosen) return fault_of_dark_;
    const MeanSpot spot = part.free_light ? mean_spot(frame, extents_, dark_dn_, chosen_)
                                          : mean_spot(frame, extents_, dark_dn_, chosen_, field.deflections);
    if (!spot.measured) return fault_of_dark_;
    // A round part or a tube that fills the field may deflect all light; a web or a plate leaves most light where it
    // is.
    const bool shows_middle = part.free_light || form_ == PartForm::web || form_ == PartForm::plate;
    const Deflection middle = part.free_light ? Deflection{} : median_of_chosen(field);
    const double x = part.free_light ? spot.x : middle.x.to_double_rounded(),
                 y = part.free_light ? spot.y : middle.y.to_double_rounded();
    findings_.spot_measured = true;
    findings_.floor_dn = static_cast<float>(spot.floor_dn);
    findings_.x_bins = static_cast<float>(x - expected_x_);
    findings_.y_bins = static_cast<float>(y - expected_y_);
    findings_.spot_x_bins = static_cast<float>(spot.rms_x);
    findings_.spot_y_bins = static_cast<float>(spot.rms_y);
    findings_.second_share = static_cast<float>(spot.second_share);
    findings_.lit_share = static_cast<float>(spot.lit_share);
    findings_.lost_share = static_cast<float>(lost_share(field, spot));
    if (fault_of_dark_ != FrameFault::none) return fault_of_dark_;
    if (max_second_share_ > 0 && findings_.second_share > max_second_share_) return FrameFault::second_spot;
    if (max_spot_bins_ > 0 &&
        (spot.rms_x > widest(max_spot_bins_, extents_.i) || spot.rms_y > widest(max_spot_bins_, extents_.j)))
        return FrameFault::wide_spot;
    const float offset = std::max(std::abs(findings_.x_bins), std::abs(findings_.y_bins));
    if (max_offset_bins_ > 0 && shows_middle && offset > max_offset_bins_) return FrameFault::off_centre;
    if (part.free_light) findings_.glare_share = static_cast<float>(glare_share(field));
    if (static_cast<double>(findings_.glare_share) > kMaxGlareShare) return FrameFault::glare;
    if (part.free_light && max_second_share_ > 0) {
        findings_.second_share =
            std::max(findings_.second_share, static_cast<float>(second_share_of_places(frame, field, part)));
        if (findings_.second_share > max_second_share_) return FrameFault::second_spot;
    }
    return check_exposures(frame, field, alternation);
}

double FrameChecks::median_light(const DecodedField& field) {
    for (std::size_t k = 0; k < chosen_.size(); ++k) scratch_[k] = field.sums[chosen_[k]];
    return static_cast<double>(common::lower_median(std::span(scratch_).first(chosen_.size())));
}

double FrameChecks::lost_share(const DecodedField& field, const MeanSpot& spot) const {
    if (!findings_.dark_measured) return 0;  // a pedestal would count as light
    double left = 0;
    for (const std::uint32_t k : chosen_) left += field.sums[k];
    return std::max(0.0, 1 - left / (static_cast<double>(chosen_.size()) * spot.light_dn));
}

double FrameChecks::glare_share(const DecodedField& field) {
    const double free = median_light(field);
    const auto limit = static_cast<std::uint32_t>(std::min(kMaxLight * free, static_cast<double>(UINT32_MAX)));
    const auto is_judged = [mask = field.mask](std::size_t k) { return (mask[k] & kNotJudged) == 0; };
    const std::size_t judged = count_suiting(0, field.mask.size(), is_judged),
                      bright = count_suiting(0, field.mask.size(), [=, sums = field.sums](std::size_t k) {
                          return is_judged(k) & (sums[k] > limit);
                      });
    return judged == 0 ? 0 : static_cast<double>(bright) / static_cast<double>(judged);
}

// Another exposure in the same frame.
FrameFault FrameChecks::check_exposures(const FrameView& frame, const DecodedField& field,
                                        const Alternation& alternation) {
    choose_lenslets(field.mask.size(), kMaxInside,
                    [mask = field.mask](std::size_t k) { return (mask[k] & (kNoHord | kNotJudged)) == 0; });
    if (max_second_share_ > 0) {
        findings_.undeflected_share =
            static_cast<float>(undeflected_share(frame, extents_, dark_dn_, chosen_, expected_x_, expected_y_));
        if (findings_.undeflected_share > max_second_share_) {
            findings_.second_share = findings_.undeflected_share;
            return FrameFault::second_spot;
        }
    }
    if (!check_period_) return FrameFault::none;
    findings_.split_share = static_cast<float>(split_share(frame, extents_, dark_dn_, chosen_));
    if (static_cast<double>(findings_.split_share) > kMaxSplitShare) return FrameFault::split_spots;
    findings_.alternation_bins = static_cast<float>(alternation.bins);
    findings_.alternation_light = static_cast<float>(alternation.light);
    return alternation.bins > kMaxAlternationBins || alternation.light > kMaxAlternationLight ? FrameFault::alternating
                                                                                              : FrameFault::none;
}

// A piece that is missing at one side, of the share f of the part, takes 2 f: 0.95 is a fortieth.
double min_symmetry(std::size_t area) { return least_of_outline(0.95, area); }

// Pieces that are missing between others, of the share f of the whole part, take f.
double min_convexity(std::size_t area) { return least_of_outline(0.9, area); }

// Light behind a part is deflected by the slopes of an optical path, which have no curl. Light that lies turned about a
// place has: x grows downwards as much as y falls to the right. Planes are fitted to both deflections of the outermost
// lenslets that have a HORD.
double FrameChecks::turn_of_bins(const DecodedField& field) const {
    struct Sums {
        double n = 0, m = 0, mm = 0, x = 0, xx = 0, xm = 0;
        void add(double at, double value) {
            ++n, m += at, mm += at * at, x += value, xx += value * value, xm += at * value;
        }
        [[nodiscard]] double slope() const { return (xm - m * x / n) / (mm - m * m / n); }
        // Of the rest, mean square.
        [[nodiscard]] double rest() const { return (xx - x * x / n - slope() * (xm - m * x / n)) / n; }
    };
    Sums x_down, y_right;
    std::size_t outermost = 0;
    for_each_outermost(extents_, [&](std::size_t k) {
        ++outermost;
        if ((field.mask[k] & kNoHord) != 0) return;
        const int m = static_cast<int>(k) % extents_.m, n = static_cast<int>(k) / extents_.m;
        x_down.add(n, field.deflections[k].x.to_double_rounded());
        y_right.add(m, field.deflections[k].y.to_double_rounded());
    });
    if (2 * x_down.n < static_cast<double>(outermost)) return 0;
    const double drift = 0.5 * (x_down.slope() - y_right.slope());  // bin pitches a lenslet
    constexpr double kMaxRest = kFreeToleranceBins * kFreeToleranceBins;
    const bool is_plane = x_down.rest() < kMaxRest && y_right.rest() < kMaxRest;
    const bool is_turn = std::abs(x_down.slope() + y_right.slope()) < std::abs(drift);
    return is_plane && is_turn ? drift / std::max(extents_.i, extents_.j) : 0;
}

// Without free light: an opaque holder leaves the outermost lenslets dark, and the part is what is lit inside it. It
// shows itself by deflecting light; a hole without a part, or a window in a hole, does not.
FrameFault FrameChecks::check_holder(const DecodedField& field) const {
    std::size_t outermost = 0, lit_outermost = 0, lit = 0, deflecting = 0;
    for_each_outermost(extents_, [&](std::size_t k) {
        ++outermost;
        lit_outermost += (field.mask[k] & kDark) == 0 ? 1 : 0;
    });
    if (10 * lit_outermost > outermost) return FrameFault::fills_field;
    for (std::size_t k = 0; k < field.mask.size(); ++k) {
        if ((field.mask[k] & kNoHord) != 0) continue;
        ++lit;
        const double x = field.deflections[k].x.to_double_rounded() - expected_x_,
                     y = field.deflections[k].y.to_double_rounded() - expected_y_;
        deflecting += std::max(std::abs(x), std::abs(y)) > kFreeToleranceBins ? 1 : 0;
    }
    const bool any = lit * kSmallestPart >= field.mask.size() &&
        static_cast<double>(deflecting) >= kMinDeflectingShare * static_cast<double>(lit);
    return any ? FrameFault::none : FrameFault::nothing;
}

// The share of light that the dark level takes moves the mean of a spot by as many bins at most: what is lost lies
// within a bin of the middle. So less light makes no free light deflected light. A dark lenslet may show free light.
double FrameChecks::surely_deflecting(const DecodedField& field, const FoundPart& part) const {
    const double least = kFreeToleranceBins + static_cast<double>(findings_.lost_share);
    const double free_x = part.free.x.to_double_rounded(), free_y = part.free.y.to_double_rounded();
    std::size_t inside = 0, deflecting = 0;
    for (std::size_t k = 0; k < field.mask.size(); ++k) {
        if ((field.mask[k] & kNotJudged) != 0) continue;
        ++inside;
        if ((field.mask[k] & kDark) != 0) continue;
        const double x = field.deflections[k].x.to_double_rounded() - free_x,
                     y = field.deflections[k].y.to_double_rounded() - free_y;
        deflecting += std::max(std::abs(x), std::abs(y)) > least ? 1 : 0;
    }
    return inside == 0 ? part.deflecting : static_cast<double>(deflecting) / static_cast<double>(inside);
}

FrameFault FrameChecks::check_part(const DecodedField& field, const FoundPart& part) {
    findings_.parts = part.parts + part.islands;
    findings_.sharp_share = static_cast<float>(part.sharp_outline);
    findings_.edge_width = part.edge_width;
    findings_.free_beside = static_cast<float>(part.free_beside);
    findings_.symmetry = static_cast<float>(part.symmetry);
    findings_.convexity = static_cast<float>(part.convexity);
    findings_.shaded = static_cast<float>(part.shaded);
    findings_.shaded_steps = part.shaded_steps;
    findings_.deflecting = static_cast<float>(is_dim() ? surely_deflecting(field, part) : part.deflecting);
    if (part.area > 0) {
        const double diameter = 2 * std::sqrt(static_cast<double>(part.area) / kPi);
        findings_.border_cut = static_cast<float>(static_cast<double>(part.at_border) / diameter);
    }
    // A part that was learned is recognised by its pose: registration decides.
    if (!part_required_ || has_reference_) return FrameFault::none;
    if (part.lacks_flanks) return FrameFault::no_flanks;
    if (part.parts == 0) return part.free_light ? FrameFault::nothing : check_holder(field);
    if (part.free_light && part.sharp_outline < kMinSharpOutline) return FrameFault::no_outline;
    if (part.islands > 0) return FrameFault::several;
    if (part.edge_width > kMaxEdgeWidth) return FrameFault::blurred_edge;
    // Whether the field cuts a tube or a plate is asked of good ones (judge_good()). A plate may show its edges alone.
    if (form_ == PartForm::tube && !deflects()) return FrameFault::hollow;
    if (form_ == PartForm::plate) return check_plate(part);
    if (form_ != PartForm::round) return FrameFault::none;
    if (part.parts > 1) return FrameFault::several;
    if (is_cut_by_field()) return FrameFault::cut_by_field;
    if (part.free_beside < kMinFreeBeside) return FrameFault::interrupted;
    if (symmetric_ && part.symmetry < min_symmetry(part.area)) return FrameFault::lopsided;
    if (symmetric_ && part.convexity < min_convexity(part.area)) return FrameFault::notched;
    return deflects() ? FrameFault::none : FrameFault::hollow;
}

// What one edge or two seem to enclose, and the field cuts, is a plate if it is flat. Hairs and empty frames have
// edges, too: a plate shows itself by the light that its faces reflect, or that it deflects.
FrameFault FrameChecks::check_plate(const FoundPart& part) const {
    if (is_cut_by_field() && part.deflecting > 1 - kMinDeflectingShare) return FrameFault::not_flat;
    if (deflects()) return FrameFault::none;
    if (part.shaded_steps < kMinShadedSteps) return FrameFault::no_steps;
    if (part.soft_shadow) return part.clear_middle ? FrameFault::clear_middle : FrameFault::shadow;
    return part.shaded < kMinShadedShare ? FrameFault::unproven : FrameFault::none;
}

bool FrameChecks::must_be_whole() const {
    return (form_ == PartForm::plate || form_ == PartForm::tube) && has_known_outline();
}

Reason FrameChecks::judge_good(const FoundPart& part) {
    if (must_be_whole() && part.cut > kMaxBorderCut) findings_.fault = FrameFault::cut_by_field;
    else if (has_known_outline() && part.lacks_place) findings_.fault = FrameFault::lopsided;
    else if (has_known_outline() && part.notched) findings_.fault = FrameFault::notched;
    return reason_of(findings_.fault);
}

Reason FrameChecks::judge_open_outline() {
    findings_.fault = FrameFault::lopsided;
    return reason_of(findings_.fault);
}

// Whether fog in the free light alone adds as much to the lit bins as the least loss that shows a plate, and more than
// noise explains. (A median of n values of noise varies by 1.25 / sqrt(n) of it.)
bool FrameChecks::is_fog_beside(const DecodedField& field, const FoundPart& part) {
    const double fog = static_cast<double>(findings_.floor_dn) - static_cast<double>(findings_.inside_floor_dn);
    const double dark_bins = share_of_dark_bins(extents_) * extents_.bins();
    const double error = 1.25 * static_cast<double>(findings_.dark_noise_dn) *
        std::sqrt(2 / (static_cast<double>(chosen_.size()) * std::max(dark_bins, 1.0)));
    choose_lenslets(field.mask.size(), kMaxChosen, [mask = field.mask, state = part.state](std::size_t k) {
        return ((mask[k] & kNoHord) == 0) & ((state[k] & FoundPart::kFreeField) != 0);
    });
    if (chosen_.empty()) return false;
    const double light = median_light(field);
    const double added = fog * static_cast<double>(findings_.lit_share) * extents_.bins();
    return added > (1 - kShadedLight) * light && fog > kMinFogSigmas * error;
}

// A plate turns no spot into a wider one. What does so all over is no plate, or one that scatters. And it takes no
// light from bins that have none: where they read more beside it, the difference of the light may be fog.
FrameFault FrameChecks::check_spread(const FrameView& frame, const DecodedField& field, const FoundPart& part) {
    if (form_ != PartForm::plate || !part_required_ || has_reference_ || !part.free_light || !findings_.spot_measured ||
        deflects())
        return FrameFault::none;
    choose_lenslets(field.mask.size(), kMaxChosen,
                    [mask = field.mask](std::size_t k) { return (mask[k] & (kNoHord | kNotJudged)) == 0; });
    if (chosen_.size() < kMinChosen) return FrameFault::none;
    const MeanSpot spot = mean_spot(frame, extents_, dark_dn_, chosen_, field.deflections);
    if (!spot.measured) return FrameFault::none;
    findings_.inside_floor_dn = static_cast<float>(spot.floor_dn);
    if (is_fog_beside(field, part)) return FrameFault::fog_beside;
    findings_.inside_x_bins = static_cast<float>(spot.rms_x);
    findings_.inside_y_bins = static_cast<float>(spot.rms_y);
    const auto is_wider = [](double inside, double free) {
        return inside * inside - free * free > kMaxAddedSpread * kMaxAddedSpread;
    };
    return is_wider(spot.rms_x, static_cast<double>(findings_.spot_x_bins)) ||
            is_wider(spot.rms_y, static_cast<double>(findings_.spot_y_bins))
        ? FrameFault::wide_inside
        : FrameFault::none;
}

bool FrameChecks::has_other_period(const FrameView& frame) {
    if (!check_period_) return false;
    const MacroPeriod period = period_.find(frame);
    findings_.period_x = period.x;
    findings_.period_y = period.y;
    const auto other = [](int found, int bins, int of_reference) {
        return found != 0 && found != bins && found != of_reference;
    };
    if (!other(period.x, extents_.i, period_of_reference_.x) && !other(period.y, extents_.j, period_of_reference_.y))
        return false;
    findings_.fault = FrameFault::other_period;
    return true;
}

Reason FrameChecks::judge(const FrameView& frame, const DecodedField& field, const FoundPart& part,
                          const Alternation& alternation) {
    FrameFault fault = check_light(frame, field, part, alternation);
    // Free light that is as it should be cannot have another period: the period is only looked for where it is not.
    if ((fault != FrameFault::none || !part.free_light) && has_other_period(frame)) fault = FrameFault::other_period;
    if (max_offset_bins_ > 0 && fault == FrameFault::none && !part.free_light) {
        findings_.turned_rad = static_cast<float>(turn_of_bins(field));
        const int half = std::max(extents_.width_px(), extents_.height_px()) / 2;
        if (std::abs(findings_.turned_rad) * static_cast<float>(half) > max_offset_bins_) fault = FrameFault::turned;
    }
    // The edges of a plate that lies in a corner of the field may fill a block of lenslets.
    if (fault == FrameFault::alternating && must_be_whole() && part.cut > kMaxBorderCut)
        fault = FrameFault::cut_by_field;
    const FrameFault of_part = check_part(field, part);
    if (fault == FrameFault::none) fault = is_dim() && hides_part(of_part) ? FrameFault::dim : of_part;
    if (fault == FrameFault::none) fault = check_spread(frame, field, part);
    findings_.fault = fault;
    return reason_of(fault);
}

}  // namespace hord::algo
