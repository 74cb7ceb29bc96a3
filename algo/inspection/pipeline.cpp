#include "algo/inspection/pipeline.h"

#include <algorithm>
#include <array>
#include <cstdlib>
#include <optional>
#include <string>
#include <vector>

#include "algo/emd/emd_solver.h"
#include "algo/features/deflection.h"
#include "algo/features/gradient.h"
#include "algo/features/jacobian.h"
#include "algo/features/row_window.h"
#include "algo/features/transmission.h"
#include "algo/frame/decode.h"
#include "algo/inspection/defects.h"
#include "algo/inspection/exact_gradients.h"
#include "algo/inspection/frame_checks.h"
#include "algo/inspection/reference_defects.h"
#include "algo/inspection/reference_outline.h"
#include "algo/inspection/rim.h"
#include "algo/maps/row_thread_pool.h"
#include "algo/recipe/zones.h"
#include "algo/soa/soa_distances.h"
#include "algo/soa/soa_emd_bounds.h"

namespace hord::algo {
namespace {

// Adds the time since the last call to a stage, by the caller's clock. Does nothing without a clock.
class Stopwatch {
  public:
    explicit Stopwatch(NowNs now) : now_(now), last_(now ? now() : 0) {}
    void lap(std::int64_t& stage) {
        if (now_ == nullptr) return;
        const std::int64_t at = now_();
        stage += at - last_;
        last_ = at;
    }

  private:
    NowNs now_;
    std::int64_t last_;
};

std::vector<std::string> problems_of(const LightLevels& levels, int bits) {
    std::vector<std::string> messages;
    const std::uint32_t full_scale = (1U << bits) - 1U;
    const std::string of_bits = " of " + std::to_string(bits) + "-bit samples, " + std::to_string(full_scale);
    if (levels.saturated > full_scale) messages.push_back("saturated_dn must be at most the full scale" + of_bits);
    if (levels.dark >= levels.saturated)
        messages.push_back("dark_dn must be below saturated_dn, or the full scale" + of_bits);
    return messages;
}

std::string joined(const std::vector<std::string>& messages) {
    std::string text;
    for (const std::string& message : messages) text += (text.empty() ? "" : "; ") + message;
    return text;
}

// Rows of EMD gradients that are submitted together: the solver batches small problems of one shape.
// Also the rows of a band in the comparison with a reference.
constexpr int kBandRows = 16;

// A thread's rows where neighbours are compared by the EMD, exactly everywhere.
struct EmdRows {
    EmdRows(const Extents& e, EmdSolver emd_solver)
        : solver(std::move(emd_solver)), window(e, solver.compact()),
          gradients(static_cast<std::size_t>(kBandRows * e.m)) {
        for (auto& row : deflections) row.resize(static_cast<std::size_t>(e.m));
    }
    EmdSolver solver;
    RowWindow window;
    std::array<std::vector<Deflection>, 3> deflections;  // of the window's rows, row n in place n % 3
    std::vector<EmdGradient> gradients;                  // of the submitted rows, one after the other
    std::size_t submitted = 0;                           // gradients

    void load(const FrameView& frame, const LightLevels& levels, int n) { window.decode(frame, levels, n); }
    [[nodiscard]] std::vector<Deflection>& deflections_of(int n) {
        return deflections[static_cast<std::size_t>(n % 3)];
    }
    [[nodiscard]] Deflection deflection(int m, int n) { return deflections_of(n)[static_cast<std::size_t>(m)]; }
};

// The working memory of one thread.
struct Worker {
    std::optional<EmdRows> emd;                 // if the map of the EMD is wanted;
    std::optional<SoaDistances> soa;            // else decoded into the SoA layout, which is three times as fast
    std::optional<SoaDistances> shares;         // if the EMD is bounded: for its second look at the frame
    std::optional<ReferenceComparer> comparer;  // if the recipe has a reference
};

}  // namespace

struct Pipeline::Workspace {
    Workspace(const Extents& e, int sample_bits, const Recipe& r, MapSet maps,
              std::unique_ptr<RowThreadPool> thread_pool, std::vector<Worker> thread_workers)
        : extents(e), bits(sample_bits), recipe(r), levels(light_levels(r, sample_bits)), pool(std::move(thread_pool)),
          workers(std::move(thread_workers)), zones(e.lenslets()), deflections(e.lenslets()), sums(e.lenslets()),
          scratch(e.lenslets()), mask(e.lenslets()), gradient(r.gradient ? e.lenslets() : 0),
          frobenius(r.slopes || maps == MapSet::all ? e.lenslets() : 0),
          transmission(r.light || maps == MapSet::all ? e.lenslets() : 0),
          spectral(maps == MapSet::all ? e.lenslets() : 0), nuclear(spectral.size()), anisotropy(spectral.size()),
          checks(e, sample_bits, r), rim(RimFinder::of(r, e)), defect_finder(e, r) {
        paint_zones(recipe.zones, extents, zones, recipe.lenslet_mm);
        if (recipe.reference) comparison.emplace(e, recipe, maps);
    }

    Extents extents;
    int bits;
    Recipe recipe;
    LightLevels levels;  // of the current frame
    std::unique_ptr<RowThreadPool> pool;
    std::vector<Worker> workers;  // one a thread

    // One value a lenslet, row by row; empty if the map is not computed.
    std::vector<std::uint8_t> zones;
    std::vector<Deflection> deflections;
    std::vector<std::uint32_t> sums, scratch;
    std::vector<std::uint8_t> mask;
    std::vector<float> gradient, frobenius, transmission;
    std::vector<float> spectral, nuclear, anisotropy;

    FrameChecks checks;
    RimFinder rim;
    DefectFinder defect_finder;
    // If neighbours are judged by the EMD, and its map is not wanted.
    std::optional<SoaEmdBounds> emd_bounds;
    std::optional<ExactGradients> exact;
    struct Columns {
        int first = 0, last = -1;
    };
    std::vector<Columns> bounded_columns;  // of each row: where bounds are wanted

    // The comparison with a reference.
    struct Comparison {
        Comparison(const Extents& e, const Recipe& r, MapSet maps)
            : registrar(e), outline(r, e), defect_finder(e, r), differences(e.lenslets()), z_score(e.lenslets()),
              compared(maps == MapSet::all ? e.lenslets() : 0) {}
        Registrar registrar;
        ReferenceOutline outline;
        ReferenceDefects defect_finder;
        std::vector<Difference> differences;
        std::vector<float> z_score;
        std::vector<std::uint8_t> compared;
    };
    std::optional<Comparison> comparison;  // if the recipe has a reference

    void compute_maps(const FrameView& frame, Stopwatch& watch, StageTimes& times);
    void bound_gradients(const FrameView& frame);
    void bound_band(SoaDistances& rows, const FrameView& frame, int first, int last);
    template <class Rows>
    void compute_band(Rows& rows, const FrameView& frame, int first, int last, Stopwatch& watch, StageTimes& times);
    void finish_decoding(EmdRows& rows, int n, bool in_band);
    void finish_decoding(SoaDistances& rows, int n, bool in_band);
    void compare_row(EmdRows& rows, int n);
    void compare_row(SoaDistances& rows, int n);
    void finish_gradients(EmdRows& rows, int last);
    void finish_gradients(SoaDistances&, int) {}
    void store_norms(std::size_t k, const Jacobian& jacobian);
    [[nodiscard]] std::span<const float> judged_slopes() const {
        return recipe.slopes ? std::span<const float>(frobenius) : std::span<const float>();
    }
    // Lenslets whose gradient no verdict needs. A defect against a reference may reach over the part's rim.
    [[nodiscard]] std::uint8_t gradient_left_out() const {
        return comparison ? kNoGradient : static_cast<std::uint8_t>(kNoGradient | kNotJudged);
    }
    [[nodiscard]] Reason unfit_reason() const;
    Registered compare_with_reference(const FrameView& frame);
    Result<FoundDefects> find_defects(bool& bounded);
    FoundDefects find_differences(const Pose& pose, bool& bounded);
};

// Sums, mean deflections, mask and the features over neighbours, of every lenslet.
void Pipeline::Workspace::compute_maps(const FrameView& frame, Stopwatch& watch, StageTimes& times) {
    const int rows = pool->rows_a_band(extents.n);
    pool->share_out((extents.n + rows - 1) / rows, [&](int worker, int band) {
        Stopwatch untimed(nullptr);
        StageTimes unused;
        const bool caller = worker == 0;
        const int first = band * rows, last = std::min(first + rows, extents.n);
        Worker& w = workers[static_cast<std::size_t>(worker)];
        if (w.emd) compute_band(*w.emd, frame, first, last, caller ? watch : untimed, caller ? times : unused);
        else compute_band(*w.soa, frame, first, last, caller ? watch : untimed, caller ? times : unused);
    });
    watch.lap(times.feature_ns);
}

// The maps of rows first..last-1. Rows first-1 and last, if they exist, are decoded for the gradients.
template <class Rows>
void Pipeline::Workspace::compute_band(Rows& rows, const FrameView& frame, int first, int last, Stopwatch& watch,
                                       StageTimes& times) {
    const auto in_band = [&](int n) { return n >= first && n < last; };
    for (int n = std::max(first - 1, 0); n < std::min(last + 1, extents.n); ++n) {
        rows.load(frame, levels, n);
        watch.lap(times.decode_ns);
        finish_decoding(rows, n, in_band(n));
        watch.lap(times.hord_ns);
        if (in_band(n - 1)) compare_row(rows, n - 1);
        watch.lap(times.feature_ns);
    }
    if (last == extents.n) compare_row(rows, last - 1);
    finish_gradients(rows, last);
    watch.lap(times.feature_ns);
}

// What compare_row() needs of row n, and the maps of sums and mean deflections if it is in the band.
void Pipeline::Workspace::finish_decoding(EmdRows& rows, int n, bool in_band) {
    const HordRow& hords = rows.window.row(n);
    mean_deflections(hords, rows.deflections_of(n));
    rows.window.compact_row(n);
    if (!in_band) return;
    const auto row = static_cast<std::ptrdiff_t>(extents.index(0, n));
    std::ranges::copy(rows.deflections_of(n), deflections.begin() + row);
    std::ranges::copy(hords.sums(), sums.begin() + row);
}

void Pipeline::Workspace::finish_decoding(SoaDistances& rows, int n, bool in_band) {
    if (!in_band) return;
    const SoaRow& row = rows.loaded(n);
    std::copy_n(row.sums().begin(), extents.m, sums.begin() + static_cast<std::ptrdiff_t>(extents.index(0, n)));
    for (int m = 0; m < extents.m; ++m) {
        const bool dark = (row.mask()[static_cast<std::size_t>(m)] & kDark) != 0;
        deflections[extents.index(m, n)] = dark ? Deflection{} : rows.deflection(m, n);
    }
}

// Mask and features of row n; rows n-1 and n+1 are decoded. EMD gradients are submitted to the solver.
void Pipeline::Workspace::compare_row(EmdRows& rows, int n) {
    const RowWindow& window = rows.window;
    for (int m = 0; m < extents.m; ++m) {
        const std::size_t k = extents.index(m, n);
        EmdGradient& submitted = rows.gradients[rows.submitted++];
        submitted = {};
        Jacobian jacobian;
        const RowWindow::Neighbours next = window.neighbours(m, n);
        mask[k] = next.mask;
        if ((next.mask & kNoGradient) == 0) {
            submit_emd_gradient(rows.solver, next.across, window.sparse(next.left, n), window.sparse(next.right, n),
                                next.down, window.sparse(m, next.above), window.sparse(m, next.below), submitted);
            jacobian = jacobian_of(next.across, rows.deflection(next.left, n), rows.deflection(next.right, n),
                                   next.down, rows.deflection(m, next.above), rows.deflection(m, next.below));
        }
        if (!frobenius.empty()) frobenius[k] = frobenius_norm(jacobian).to_float_rounded();
        if (!spectral.empty()) store_norms(k, jacobian);
    }
    if (rows.submitted == rows.gradients.size()) finish_gradients(rows, n + 1);
}

void Pipeline::Workspace::compare_row(SoaDistances& rows, int n) {
    std::uint8_t* const of_row = mask.data() + extents.index(0, n);
    rows.mark_row(n, of_row);
    if (!gradient.empty() && !emd_bounds) {
        float* const gradients = gradient.data() + extents.index(0, n);
        rows.compare_row(n, gradients, of_row);
    }
    if (!frobenius.empty()) rows.slopes_row(n, frobenius.data() + extents.index(0, n), of_row);
    if (spectral.empty()) return;
    for (int m = 0; m < extents.m; ++m)
        store_norms(extents.index(m, n), (of_row[m] & kNoGradient) == 0 ? rows.jacobian(m, n) : Jacobian{});
}

// The upper bounds of the EMD gradient, where it is judged: in a second look at a frame that can be judged, so that the
// others need not be bounded.
void Pipeline::Workspace::bound_gradients(const FrameView& frame) {
    const std::uint8_t left_out = gradient_left_out();
    for (int n = 0; n < extents.n; ++n) {
        Columns& of_row = bounded_columns[static_cast<std::size_t>(n)];
        of_row = {extents.m, -1};
        for (int m = 0; m < extents.m; ++m) {
            if ((mask[extents.index(m, n)] & left_out) != 0) continue;
            of_row.first = std::min(of_row.first, m);
            of_row.last = m;
        }
    }
    const int rows = pool->rows_a_band(extents.n);
    pool->share_out((extents.n + rows - 1) / rows, [&](int worker, int band) {
        bound_band(*workers[static_cast<std::size_t>(worker)].shares, frame, band * rows,
                   std::min((band + 1) * rows, extents.n));
    });
}

void Pipeline::Workspace::bound_band(SoaDistances& rows, const FrameView& frame, int first, int last) {
    const std::uint8_t left_out = gradient_left_out();
    int next = first - 1;  // to load
    for (int n = first; n < last; ++n) {
        float* const gradients = gradient.data() + extents.index(0, n);
        if (bounded_columns[static_cast<std::size_t>(n)].last < 0) {
            std::fill_n(gradients, extents.m, 0.0F);
            continue;
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
        emd_bounds->row(rows, n, mask.data() + extents.index(0, n), left_out, gradients);
    }
}

// Solves the submitted EMD gradients and writes them to the map; `last` is the row after theirs.
void Pipeline::Workspace::finish_gradients(EmdRows& rows, int last) {
    rows.solver.finish();
    float* out = gradient.data() + extents.index(0, last) - rows.submitted;
    for (std::size_t k = 0; k < rows.submitted; ++k) out[k] = static_cast<float>(rows.gradients[k].norm());
    rows.submitted = 0;
}

void Pipeline::Workspace::store_norms(std::size_t k, const Jacobian& jacobian) {
    const SingularNorms norms = singular_norms(jacobian);
    spectral[k] = norms.spectral.to_float_rounded();
    nuclear[k] = norms.nuclear.to_float_rounded();
    anisotropy[k] = norms.anisotropy.to_float_rounded();
}

// Why the frame cannot be judged; none if it can.
Reason Pipeline::Workspace::unfit_reason() const {
    std::size_t judged = 0, lit = 0, saturated = 0;
    for (const std::uint8_t bits_of_lenslet : mask) {
        if ((bits_of_lenslet & kNotJudged) != 0) continue;
        ++judged;
        if ((bits_of_lenslet & kDark) == 0) ++lit;
        if ((bits_of_lenslet & kSaturated) != 0) ++saturated;
    }
    if (judged == 0) return Reason::nothing_to_see;
    const auto share_of_judged = [&](std::size_t count) {
        return static_cast<float>(count) / static_cast<float>(judged);
    };
    if (lit == 0 || share_of_judged(lit) < recipe.min_lit_share) return Reason::too_dark;
    if (share_of_judged(saturated) > recipe.max_saturated_share) return Reason::saturated;
    return Reason::none;
}

// Finds the pose of the part. If it is found, computes how every lenslet differs from the reference there.
Registered Pipeline::Workspace::compare_with_reference(const FrameView& frame) {
    const Reference& reference = *recipe.reference;
    const Registered registered =
        comparison->registrar.find(reference.maps(), deflections, sums, mask,
                                   static_cast<double>(reference.sensor.electrons_per_dn), reference.parts);
    if (!registered.found()) return registered;
    const PoseMap pose(registered.pose, extents);
    comparison->outline.take_in(pose, zones, mask);
    pool->share_out((extents.n + kBandRows - 1) / kBandRows, [&](int worker, int band) {
        ReferenceComparer& comparer = *workers[static_cast<std::size_t>(worker)].comparer;
        const auto columns = static_cast<std::size_t>(extents.m);
        for (int n = band * kBandRows; n < std::min((band + 1) * kBandRows, extents.n); ++n) {
            comparer.compare_row(frame, std::span<const std::uint32_t>(sums).subspan(extents.index(0, n), columns),
                                 std::span<const std::uint8_t>(mask).subspan(extents.index(0, n), columns), n, pose,
                                 registered.light, levels.dark,
                                 std::span(comparison->differences).subspan(extents.index(0, n), columns));
        }
    });
    return registered;
}

// Defects of a part that is compared with itself. Solves the gradients that the result needs; `bounded` if not all.
Result<FoundDefects> Pipeline::Workspace::find_defects(bool& bounded) {
    Features features{gradient, judged_slopes(), transmission, mask};
    if (!exact) return defect_finder.find(features);
    features.bounds = exact->bounds();
    bounded = !exact->solve_from(1, exact->least_gradient(1), [&](std::size_t k) {
        return (mask[k] & (kNotJudged | kNoGradient)) == 0 ? gradient[k] / recipe.emd_limit_bins : 0;
    });
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

// The same of a part that is compared with a reference.
FoundDefects Pipeline::Workspace::find_differences(const Pose& pose, bool& bounded) {
    ReferenceDefects& finder = comparison->defect_finder;
    ComparedFrame compared{comparison->differences, gradient, judged_slopes(), mask};
    finder.score_lenslets(compared, comparison->z_score);
    if (!exact) return finder.find(compared, pose);
    compared.bounds = exact->bounds();
    const float grow = finder.grow_severity();
    bounded = !exact->solve_from(grow, 0, [&](std::size_t k) { return finder.severity_by_gradient(compared, k); });
    FoundDefects found = finder.find(compared, pose, !bounded);
    if (!found.defects.empty()) return found;
    bool known = true;
    found.score = exact->largest(
        found.score, grow, [&](std::size_t k) { return finder.severity(compared, k); }, known);
    bounded = bounded || !known;
    return found;
}

Result<Pipeline> Pipeline::create(const Extents& extents, int bits, const Recipe& recipe, int threads, MapSet maps) {
    if (auto fine = check(extents); !fine) return tl::unexpected(fine.error());
    if (auto fine = check_bits(bits); !fine) return tl::unexpected(fine.error());
    std::vector<std::string> messages = problems(recipe, extents);
    for (std::string& message : problems_of(light_levels(recipe, bits), bits)) messages.push_back(std::move(message));
    for (std::string& message : problems_of_reference(recipe, extents, bits)) messages.push_back(std::move(message));
    if (!messages.empty()) return fail(ErrorCode::invalid_argument, "recipe \"" + recipe.name + "\"", joined(messages));
    auto pool = RowThreadPool::create(threads);
    if (!pool) return tl::unexpected(pool.error());
    std::vector<Worker> workers;
    const auto reference_soa = recipe.reference ? std::make_shared<const ReferenceSoa>(*recipe.reference) : nullptr;
    for (int worker = 0; worker < threads; ++worker) {
        Worker& made = workers.emplace_back();
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
    if (recipe.gradient == Feature::emd && maps == MapSet::judged) {
        workspace->emd_bounds.emplace(extents, widest_isa());
        workspace->bounded_columns.resize(static_cast<std::size_t>(extents.n));
        auto exact = ExactGradients::create(extents, recipe.emd_limit_bins, *workspace->pool);
        if (!exact) return tl::unexpected(exact.error());
        workspace->exact.emplace(std::move(*exact));
    }
    return Pipeline(std::move(workspace));
}

Result<Inspection> Pipeline::inspect(const FrameView& frame, NowNs now, const InspectionLimits& limits) {
    Workspace& w = *workspace_;
    if (auto fine = check_frame(frame, w.extents, w.bits); !fine) return tl::unexpected(fine.error());
    Inspection result;
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

    const std::int64_t end_ns = now != nullptr && limits.time_ns > 0 ? now() + limits.time_ns : 0;
    Stopwatch total(now), watch(now);
    w.levels = w.checks.levels_of(frame);
    result.dark_dn = w.levels.dark;
    watch.lap(result.times.feature_ns);
    w.compute_maps(frame, watch, result.times);
    w.rim.mark(w.deflections, w.sums, w.mask);
    for (std::size_t k = 0; k < w.mask.size(); ++k) w.mask[k] |= w.zones[k];
    if (!w.transmission.empty())
        transmissions(w.sums, w.mask, typical_light(w.sums, w.mask, w.recipe.transmission_limit, w.scratch),
                      w.transmission);
    watch.lap(result.times.feature_ns);

    result.reason = w.unfit_reason();
    if (result.reason == Reason::none)
        result.reason = w.checks.judge(frame, {w.deflections, w.sums, w.mask}, w.rim.found());
    result.frame = w.checks.findings();
    if (result.reason == Reason::none && w.comparison) {
        result.registered = w.compare_with_reference(frame);
        if (!result.registered.found()) result.reason = Reason::not_registered;
        watch.lap(result.times.feature_ns);
    }
    if (result.reason == Reason::none) {
        if (w.emd_bounds) {
            w.bound_gradients(frame);
            watch.lap(result.times.feature_ns);
        }
        if (w.exact) w.exact->start(frame, w.levels, w.mask, w.gradient, limits, now, end_ns);
        const Result<FoundDefects> found =
            w.comparison ? w.find_differences(result.registered.pose, result.bounded) : w.find_defects(result.bounded);
        if (!found) return tl::unexpected(found.error());
        result.defects = found->defects;
        result.reason = found->reason;
        result.score = found->score > kInsignificantScore ? found->score : 0;
        result.out_of_time = result.bounded && w.exact->out_of_time();
        result.verdict = found->defects.empty() ? Verdict::pass : Verdict::reject;
        if (w.comparison) {
            result.z_score = w.comparison->z_score;
            auto& compared = w.comparison->compared;
            for (std::size_t k = 0; k < compared.size(); ++k) compared[k] = w.comparison->differences[k].has_light;
            result.compared = compared;
        }
    }
    if (result.verdict == Verdict::unfit && w.emd_bounds) std::ranges::fill(w.gradient, 0.0F);
    watch.lap(result.times.decide_ns);
    total.lap(result.times.total_ns);
    return result;
}

}  // namespace hord::algo
