#include "algo/inspection/pipeline.h"

#include <algorithm>
#include <cmath>
#include <optional>
#include <string>
#include <vector>

#include "algo/features/transmission.h"
#include "algo/frame/lenslet_scan.h"
#include "algo/inspection/pipeline_workspace.h"
#include "algo/light/sample_depth.h"

namespace hord::algo {
namespace {

std::vector<std::string> problems_of(const LightLevels& levels, const Extents& extents, int bits) {
    std::vector<std::string> messages;
    const std::uint32_t full_scale = (1U << bits) - 1U;
    const std::string of_bits = " of " + std::to_string(bits) + "-bit samples, " + std::to_string(full_scale);
    if (levels.saturated > full_scale) messages.push_back("saturated_dn must be at most the full scale" + of_bits);
    if (levels.dark >= full_scale) messages.push_back("dark_dn must be below the full scale" + of_bits);
    else if (levels.dark >= levels.saturated)
        messages.push_back("saturated_dn must be above the dark level, " + std::to_string(levels.dark) + " DN");
    const std::uint64_t most = std::uint64_t{full_scale} * static_cast<std::uint64_t>(extents.bins());
    if (levels.min_sum > most) {
        messages.push_back("min_sum_dn " + std::to_string(levels.min_sum) + " is more than a lenslet of " +
                           std::to_string(extents.bins()) + " bins can hold, " + std::to_string(most));
    }
    return messages;
}

std::string joined(const std::vector<std::string>& messages) {
    std::string text;
    for (const std::string& message : messages) text += (text.empty() ? "" : "; ") + message;
    return text;
}

}  // namespace

// The columns of each row where a bound of the EMD gradient is wanted: where it is judged.
void Pipeline::Workspace::find_bounded_columns(int first_row, int last_row) {
    const std::uint8_t left_out = gradient_left_out();
    for (int n = first_row; n < last_row; ++n) {
        const std::uint8_t* const of_row = mask.data() + extents.index(0, n);
        Columns columns{0, extents.m - 1};
        while (columns.first < extents.m && (of_row[columns.first] & left_out) != 0) ++columns.first;
        while (columns.last >= columns.first && (of_row[columns.last] & left_out) != 0) --columns.last;
        bounded_columns[static_cast<std::size_t>(n)] = columns.last < columns.first ? Columns{extents.m, -1} : columns;
    }
}

// A part of which very many lenslets have twice the slope that rejects it is rejected, whatever the EMD. Bounds of
// large boxes of lit bins, which take most of the time of such a frame, are then not worth it.
int Pipeline::Workspace::most_bins_to_bound() const {
    constexpr std::size_t kManyOf = 16;  // of the judged lenslets
    constexpr float kFarAbove = 2;       // times the limit
    constexpr int kLargeBox = 16;        // bins
    if (!recipe.slopes || comparison) return kMaxBinCount;
    const auto is_judged = [of = mask.data()](std::size_t k) { return (of[k] & (kNoGradient | kNotJudged)) == 0; };
    const auto is_steep = [=, slope = frobenius.data(), limit = kFarAbove * recipe.frobenius_limit_bins,
                           own = rim.own_slopes().data()](std::size_t k) {
        return is_judged(k) & ((own != nullptr ? slope_beyond(own[k], slope[k]) : slope[k]) >= limit);
    };
    const std::size_t judged = count_suiting(0, mask.size(), is_judged),
                      steep = count_suiting(0, mask.size(), is_steep);
    return steep == 0 || kManyOf * steep < judged ? kMaxBinCount : kLargeBox;
}

// The second look at a frame, once it is known that it can be judged: bounds of the EMD gradient, and how every lenslet
// differs from the reference at the part's pose. Row by row, so that a row is read from memory once.
void Pipeline::Workspace::look_again(const FrameView& frame, const Registered& registered, Stopwatch& watch,
                                     StageTimes& times) {
    std::optional<PoseMap> pose;
    const int rows = pool->rows_a_band(extents.n), bands = (extents.n + rows - 1) / rows;
    if (comparison) pose.emplace(registered.pose, extents);
    // Before any bound: a row's bounds need the columns of the rows around it.
    pool->share_out(bands, [&](int, int band) {
        const int first = band * rows, last = std::min(first + rows, extents.n);
        if (comparison) comparison->outline.take_in(*pose, zones, mask, first, last);
        if (emd_bounds) find_bounded_columns(first, last);
    });
    const int most_bins = emd_bounds ? most_bins_to_bound() : 0;
    const auto columns = static_cast<std::size_t>(extents.m);
    const auto of_row = [&](auto& map, int n) { return std::span(map).subspan(extents.index(0, n), columns); };
    pool->share_out(bands, [&](int worker, int band) {
        Stopwatch untimed(nullptr);
        StageTimes unused;
        const bool caller = worker == 0;
        Stopwatch& by = caller ? watch : untimed;
        StageTimes& to = caller ? times : unused;
        PipelineWorker& w = workers[static_cast<std::size_t>(worker)];
        const int first = band * rows;
        int next = first - 1;  // row to load for the bounds
        for (int n = first; n < std::min(first + rows, extents.n); ++n) {
            if (emd_bounds) bound_row(*w.shares, frame, n, next, most_bins);
            by.lap(to.bound_ns);
            if (!comparison) continue;
            const std::span<const std::uint32_t> of_sums = of_row(sums, n);
            const std::span<const std::uint8_t> of_mask = of_row(mask, n);
            w.comparer->compare_row(frame, of_sums, of_mask, n, *pose, registered.light, levels.dark,
                                    of_row(comparison->differences, n));
            comparison->defect_finder.score_row({comparison->differences, gradient, judged_slopes(), mask}, n,
                                                comparison->z_score);
            by.lap(to.compare_ns);
        }
    });
    watch.lap(comparison ? times.compare_ns : times.bound_ns);
}

void Pipeline::Workspace::bound_row(SoaDistances& rows, const FrameView& frame, int n, int& next, int most_bins) {
    float* const gradients = gradient.data() + extents.index(0, n);
    if (bounded_columns[static_cast<std::size_t>(n)].last < 0) {
        std::fill_n(gradients, extents.m, 0.0F);
        return;
    }
    for (next = std::max(next, n - 1); next <= n + 1; ++next) {
        Columns columns{extents.m, -1};  // that some row needs of this one
        for (int near = std::max(next - 1, 0); near <= std::min(next + 1, extents.n - 1); ++near) {
            columns.first = std::min(columns.first, bounded_columns[static_cast<std::size_t>(near)].first);
            columns.last = std::max(columns.last, bounded_columns[static_cast<std::size_t>(near)].last);
        }
        rows.load_blocks(frame, levels, next, (columns.first - 1) / SoaRow::kLanes,
                         (columns.last + 1) / SoaRow::kLanes);
    }
    emd_bounds->row(rows, n, mask.data() + extents.index(0, n), gradient_left_out(), gradients, most_bins);
}

LensletCounts Pipeline::Workspace::count_lenslets() const {
    const auto count = [this](std::uint8_t bits_set, std::uint8_t value) {
        return count_suiting(0, mask.size(),
                             [=, of = mask.data()](std::size_t k) { return (of[k] & bits_set) == value; });
    };
    return {count(kNotJudged, 0), count(kNotJudged | kDark, 0), count(kNotJudged | kSaturated, kSaturated)};
}

// Why the frame cannot be judged; none if it can.
Reason Pipeline::Workspace::unfit_reason(const LensletCounts& lenslets) const {
    if (lenslets.judged == 0) {
        const std::size_t lit =
            count_suiting(0, mask.size(), [of = mask.data()](std::size_t k) { return (of[k] & kDark) == 0; });
        const bool dark = static_cast<float>(lit) < recipe.min_lit_share * static_cast<float>(mask.size());
        return dark ? Reason::too_dark : Reason::nothing_to_see;
    }
    const auto share_of_judged = [&](std::size_t of_judged) {
        return static_cast<float>(of_judged) / static_cast<float>(lenslets.judged);
    };
    if (lenslets.lit == 0 || share_of_judged(lenslets.lit) < recipe.min_lit_share) return Reason::too_dark;
    if (share_of_judged(lenslets.saturated) > recipe.max_saturated_share) return Reason::saturated;
    return Reason::none;
}

// A pixel changes one lenslet, and the gradients of those beside it: larger defects are none of one sample.
LoneSample Pipeline::Workspace::lone_sample(const FrameView& frame, const Defect& defect, float noise_dn) const {
    constexpr std::uint32_t kMaxArea = 9;  // lenslets
    constexpr float kMinSigmas = 6;        // above the dark level, which lies about three above the pedestal
    if (defect.area > kMaxArea) return {};
    const auto above_dark = [&](int x, int y) {
        const std::uint32_t sample = frame.sample(x, y);
        return sample > levels.dark ? sample - levels.dark : 0U;
    };
    const auto least = std::max(1U, static_cast<std::uint32_t>(std::ceil(kMinSigmas * noise_dn)));
    LoneSample found;
    int number = 0;
    const auto look_at = [&](int x, int y) {
        const std::uint32_t dn = above_dark(x, y);
        if (dn < least) return;
        for (int b = std::max(y - 1, 0); b <= std::min(y + 1, frame.height_px - 1); ++b) {
            for (int a = std::max(x - 1, 0); a <= std::min(x + 1, frame.width_px - 1); ++a) {
                if ((a != x || b != y) && above_dark(a, b) > 0) return;
            }
        }
        found = {x, y, dn};
        ++number;
    };
    extents.for_each_around(static_cast<int>(std::lround(defect.m)), static_cast<int>(std::lround(defect.n)), 2,
                            [&](int m, int n) {
                                for (int b = 0; b < extents.bins(); ++b)
                                    look_at(m * extents.i + b % extents.i, n * extents.j + b / extents.i);
                            });
    if (number != 1) return {};
    // Where lenslets around it have light at the same bin, it is what a defect leaves of a spot.
    bool of_spot = false;
    const int column = found.x / extents.i, row = found.y / extents.j;
    extents.for_each_around(column, row, 2, [&](int m, int n) {
        if (m == column && n == row) return;
        of_spot |= above_dark(m * extents.i + found.x % extents.i, n * extents.j + found.y % extents.j) >= least;
    });
    return of_spot ? LoneSample{} : found;
}

// Looks for the part's outline. With a reference and several threads also for its pose, at the same time: it is needed
// unless the frame cannot be judged.
std::optional<Registered> Pipeline::Workspace::mark_part() {
    const auto mark = [&] {
        rim.mark(deflections, sums, mask);
        for (std::size_t k = 0; k < mask.size(); ++k) mask[k] |= zones[k];
    };
    std::optional<Registered> registered;
    if (comparison && pool->threads() > 1) {
        std::ranges::copy(mask, comparison->without_part.begin());
        pool->share_out(2, [&](int, int task) {
            if (task == 0) mark();
            else registered = find_pose(comparison->without_part);
        });
    } else {
        mark();
    }
    return registered;
}

// The transmission of every lenslet, and the alternation of the field.
Alternation Pipeline::Workspace::measure_light() {
    const int rows = (pool->rows_a_band(extents.n) + kAlternationBlock - 1) / kAlternationBlock * kAlternationBlock,
              bands = recipe.check_period ? (extents.n + rows - 1) / rows : 0;
    for (PipelineWorker& worker : workers) worker.alternation = {};
    pool->share_out(bands + 1, [&](int worker, int task) {
        if (task < bands) {
            Alternation& of_worker = workers[static_cast<std::size_t>(worker)].alternation;
            const int first = task * rows, last = std::min(first + rows, extents.n);
            of_worker = of_worker.or_stronger(alternation(extents, deflections, sums, mask, first, last));
        } else if (!transmission.empty()) {
            typical = typical_light(sums, mask, recipe.transmission_limit, scratch);
            transmissions(sums, mask, typical, transmission);
        }
    });
    Alternation strongest;
    for (const PipelineWorker& worker : workers) strongest = strongest.or_stronger(worker.alternation);
    return strongest;
}

// Of a plate that lets through less than the limit of the transmission, with a hole over a tenth of it or more: the
// typical light is the hole's, so that the plate around it would be a stain. It is the median, where the search for
// missing material sees a hole: that is rejected for itself. Without one, the plate may be covered: nothing changes.
void Pipeline::Workspace::disregard_light_of_hole() {
    const double beside = rim.found().light_beside;
    if (!missing_material || transmission.empty() || beside <= 0 || typical < kShadedLight * beside) return;
    const std::uint32_t median = typical_light(sums, mask, 0, scratch);
    if (median == typical || !seek_missing()) return;
    typical = median;
    transmissions(sums, mask, typical, transmission);
}

std::optional<MissingMaterial> Pipeline::Workspace::seek_missing() {
    return missing_material->find(
        sums, mask, {.min_area = recipe.min_area, .light_beside = static_cast<float>(rim.found().light_beside)});
}

// Finds the pose of the part. `lit`: kDark and kSaturated of every lenslet.
Registered Pipeline::Workspace::find_pose(std::span<const std::uint8_t> lit) {
    const Reference& reference = *recipe.reference;
    return comparison->registrar.find(reference.maps(), deflections, sums, lit,
                                      static_cast<double>(reference.sensor.electrons_per_dn), reference.parts);
}

// Defects of a part that is compared with itself. Solves the gradients that the result needs; `bounded` if not all.
Result<FoundDefects> Pipeline::Workspace::find_defects(bool& bounded) {
    Features features{gradient, judged_slopes(), transmission, mask};
    features.own_slopes = rim.own_slopes();
    if (!exact) return defect_finder.find(features);
    features.bounds = exact->bounds();
    bounded = !exact->solve_from(1, exact->least_gradient(1),
                                 [&](std::size_t k) { return defect_finder.severities(features, k).gradient; });
    auto found = defect_finder.find(features);
    if (!found || !found->defects.empty()) return found;
    if (bounded) {  // bounds above the limit, in regions of too few lenslets
        found->score = std::nextafter(1.0F, 0.0F);
        return found;
    }
    bool known = true;
    found->score = exact->largest(
        found->score, 1,
        [&](std::size_t k) {
            const DefectFinder::Severities s = defect_finder.severities(features, k);
            return s.others < 1 ? s.gradient : 0;  // a region of too few lenslets does not count
        },
        known);
    bounded = !known;
    return found;
}

// Of a part that passes, or that bounds alone may reject: a place where material is missing is its only defect, unless
// the bounds' score is larger.
void Pipeline::Workspace::find_missing(Inspection& result) {
    const std::optional<MissingMaterial> found = seek_missing();
    if (!found || (result.verdict == Verdict::reject && found->score <= result.score)) return;
    missing = {.m = found->m,
               .n = found->n,
               .area = found->area,
               .peak = found->excess,
               .length = found->length,
               .width = found->width};
    result.defects = {&missing, 1};
    result.reason = Reason::missing_material;
    result.score = found->score;
    result.verdict = Verdict::reject;
}

// Of a part without a defect: unfit if a piece of it is missing, as where the free light enters it.
void Pipeline::Workspace::check_good(Inspection& result, bool lacks_outline) {
    if (checks.has_known_outline()) rim.look_for_missing_pieces({deflections, sums, mask});
    const Reason reason = lacks_outline ? checks.judge_open_outline() : checks.judge_good(rim.found());
    if (reason == Reason::none) return;
    result.frame = checks.findings();
    result.verdict = Verdict::unfit;
    result.reason = reason;
    result.score = 0;
    result.bounded = result.out_of_time = false;
}

// The same of a part that is compared with a reference.
FoundDefects Pipeline::Workspace::find_differences(const FrameView& frame, const Registered& registered,
                                                   bool& bounded) {
    ReferenceDefects& finder = comparison->defect_finder;
    const Pose& pose = registered.pose;
    ComparedFrame compared{comparison->differences, gradient, judged_slopes(), mask};
    compared.light = {frame, levels.dark, registered.light};
    if (!exact) return finder.find(compared, pose);
    compared.bounds = exact->bounds();
    const float grow = finder.grow_severity();
    bounded = !exact->solve_from(grow, 0, [&](std::size_t k) { return finder.severity_by_gradient(k); });
    FoundDefects found = finder.find(compared, pose, !bounded);
    if (!found.defects.empty()) return found;
    bool known = true;
    found.by_lenslets = exact->largest(
        found.by_lenslets, grow, [&](std::size_t k) { return finder.severity(compared, k); }, known);
    found.score = std::max(found.by_lenslets, found.score);
    bounded = bounded || !known;
    return found;
}

Result<void> check_recipe(const Recipe& recipe, const Extents& extents, int bits) {
    if (auto fine = check(extents); !fine) return fine;
    if (auto fine = check_bits(bits); !fine) return fine;
    std::vector<std::string> messages = problems(recipe, extents);
    for (std::string& message : problems_of(light_levels(recipe, bits), extents, bits))
        messages.push_back(std::move(message));
    for (std::string& message : problems_of_reference(recipe)) messages.push_back(std::move(message));
    if (!messages.empty()) return fail(ErrorCode::invalid_argument, "recipe \"" + recipe.name + "\"", joined(messages));
    // The reference may have been given without the recipe: it is named, not the recipe.
    if (const auto other = mismatches_of_reference(recipe, extents, bits); !other.empty())
        return fail(ErrorCode::invalid_argument, joined(other),
                    "give the reference that was learned from such frames, or learn one (hordctl learn)");
    return {};
}

Result<Pipeline> Pipeline::create(const Extents& extents, int bits, const Recipe& recipe, int threads, MapSet maps) {
    return create(extents, bits, recipe, threads, maps, nullptr);
}

Result<Pipeline> Pipeline::create(const GridDecoder& decoder, int bits, const Recipe& recipe, int threads,
                                  MapSet maps) {
    return create(decoder.extents(), bits, recipe, threads, maps, &decoder);
}

Result<Pipeline> Pipeline::create(const Extents& extents, int bits, const Recipe& recipe, int threads, MapSet maps,
                                  const GridDecoder* decoder) {
    if (auto fine = check_recipe(recipe, extents, bits); !fine) return tl::unexpected(fine.error());
    auto pool = RowThreadPool::create(threads);
    if (!pool) return tl::unexpected(pool.error());
    std::vector<PipelineWorker> workers;
    const auto reference_soa = recipe.reference ? std::make_shared<const ReferenceSoa>(*recipe.reference) : nullptr;
    for (int worker = 0; worker < threads; ++worker) {
        PipelineWorker& made = workers.emplace_back();
        if (decoder != nullptr) made.raw.emplace(*decoder, bits);
        if (recipe.reference) made.comparer.emplace(*recipe.reference, widest_isa(), reference_soa);
        const bool by_emd = recipe.gradient == Feature::emd;
        if (!by_emd || maps == MapSet::judged) {
            const Feature over_neighbours =
                by_emd ? Feature::jacobian_frobenius : recipe.gradient.value_or(Feature::jacobian_frobenius);
            made.soa.emplace(extents, over_neighbours, best_isa(), true);
            if (by_emd) made.shares.emplace(extents, Feature::emd, best_isa());
            continue;
        }
        const auto ground = GroundDistance::between_bins(extents.i, extents.j);
        if (!ground) return tl::unexpected(ground.error());
        auto solver = EmdSolver::create(*ground);
        if (!solver) return tl::unexpected(solver.error());
        made.emd.emplace(extents, std::move(*solver));
    }
    auto workspace = common::make_opaque<Workspace>(extents, bits, recipe, maps, std::move(*pool), std::move(workers));
    if (decoder != nullptr) workspace->macro_pixels = decoder->frame(bits);
    if (recipe.gradient == Feature::emd && maps == MapSet::judged) {
        workspace->emd_bounds.emplace(extents, widest_isa());
        workspace->bounded_columns.resize(static_cast<std::size_t>(extents.n));
        auto exact = ExactGradients::create(extents, recipe.emd_limit_bins, *workspace->pool);
        if (!exact) return tl::unexpected(exact.error());
        workspace->exact.emplace(std::move(*exact));
    }
    return Pipeline(std::move(workspace));
}

Result<Inspection> Pipeline::inspect(const FrameView& given, NowNs now, const InspectionLimits& limits) {
    Workspace& w = *workspace_;
    const std::int64_t end_ns = now != nullptr && limits.time_ns > 0 ? now() + limits.time_ns : 0;
    Stopwatch total(now), watch(now);
    const Result<FrameView> taken_in = w.take_in(given);
    if (!taken_in) return tl::unexpected(taken_in.error());
    const FrameView& frame = *taken_in;
    Inspection result;
    watch.lap(result.times.resample_ns);
    result.macro_pixels = frame;
    result.compares = w.recipe.gradient;
    result.gradient = w.gradient;
    if (w.recipe.gradient == Feature::emd) result.emd = w.gradient;
    result.has_bounds = w.exact.has_value();
    result.frobenius = w.frobenius;
    result.transmission = w.transmission;
    result.spectral = w.spectral;
    result.nuclear = w.nuclear;
    result.anisotropy = w.anisotropy;
    result.mask = w.mask;
    result.sums = w.sums;

    w.levels = w.checks.levels_of(frame);
    result.dark_dn = w.levels.dark;
    watch.lap(result.times.feature_ns);
    w.compute_maps(frame, watch, result.times);
    const std::optional<Registered> registered = w.mark_part();
    // A part that was learned is recognised by its pose.
    if (!w.comparison) w.rim.measure_edges({w.deflections, w.sums, w.mask}, w.checks.scale_of(frame, w.rim.found()));
    const Alternation alternation = w.measure_light();
    watch.lap(result.times.feature_ns);

    result.lenslets = w.count_lenslets();
    result.reason = w.unfit_reason(result.lenslets);
    const bool shows_little = result.reason == Reason::too_dark || result.reason == Reason::nothing_to_see;
    if (shows_little && w.checks.has_other_period(frame)) result.reason = Reason::unexpected_geometry;
    // Light that enters through a bite leaves no outline of the frame's own. The reference's tells what is to be
    // judged.
    const bool lacks_outline = w.comparison && result.reason == Reason::nothing_to_see;
    if (lacks_outline) result.reason = Reason::none;
    if (result.reason == Reason::none)
        result.reason = w.checks.judge(frame, {w.deflections, w.sums, w.mask}, w.rim.found(), alternation);
    result.frame = w.checks.findings();
    if (result.reason == Reason::too_dark || static_cast<double>(result.frame.lost_share) > kMaxLostLight)
        result.frame.fewer_bits = fewer_bits(frame, w.extents.lenslets());
    watch.lap(result.times.feature_ns);
    if (result.reason == Reason::none && w.comparison) {
        result.registered = registered ? *registered : w.find_pose(w.mask);
        if (result.registered.outcome == Registered::Outcome::blurred) {
            result.reason = Reason::unexpected_light;
            result.frame.fault = FrameFault::blurred_edge;
        } else if (!result.registered.found()) {
            result.reason = result.registered.shows_no_part() ? Reason::no_part : Reason::not_registered;
        }
        watch.lap(result.times.register_ns);
    }
    if (result.reason == Reason::none && (w.emd_bounds || w.comparison))
        w.look_again(frame, result.registered, watch, result.times);
    if (result.reason == Reason::none && lacks_outline) {
        result.lenslets = w.count_lenslets();
        result.reason = w.unfit_reason(result.lenslets);
    }
    if (result.reason == Reason::none) {
        w.disregard_light_of_hole();
        if (w.exact) w.exact->start(frame, w.levels, w.mask, w.gradient, limits, now, end_ns);
        const Result<FoundDefects> found = w.comparison ? w.find_differences(frame, result.registered, result.bounded)
                                                        : w.find_defects(result.bounded);
        if (!found) return tl::unexpected(found.error());
        result.defects = found->defects;
        result.reason = found->reason;
        const auto significant = [](float score) { return score > kInsignificantScore ? score : 0; };
        result.score = significant(found->score);
        result.by_lenslets = significant(found->by_lenslets), result.together = found->together;
        result.out_of_time = result.bounded && w.exact->out_of_time();
        result.verdict = found->defects.empty() ? Verdict::pass : Verdict::reject;
        if ((result.verdict == Verdict::pass || result.bounded) && w.missing_material) w.find_missing(result);
        if (result.verdict == Verdict::pass) w.check_good(result, lacks_outline);
        if (w.comparison) {
            result.z_score = w.comparison->z_score;
            auto& compared = w.comparison->compared;
            for (std::size_t k = 0; k < compared.size(); ++k) compared[k] = w.comparison->differences[k].has_light;
            result.compared = compared;
        }
    }
    if (!result.defects.empty())
        result.lone_sample = w.lone_sample(frame, result.defects.front(), result.frame.dark_noise_dn);
    if (result.verdict == Verdict::unfit && w.emd_bounds) std::ranges::fill(w.gradient, 0.0F);
    watch.lap(result.times.decide_ns);
    total.lap(result.times.total_ns);
    return result;
}

}  // namespace hord::algo
