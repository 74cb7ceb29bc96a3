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
#include "algo/features/transmission.h"
#include "algo/frame/decode.h"
#include "algo/inspection/defects.h"
#include "algo/inspection/reference_defects.h"
#include "algo/inspection/rim.h"
#include "algo/maps/row_thread_pool.h"
#include "algo/recipe/zones.h"
#include "algo/soa/soa_distances.h"

namespace hord::algo {
namespace {

// Reads the caller's clock and adds what has passed to a stage; without a clock, nothing.
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
    std::vector<std::string> lines;
    const std::uint32_t full_scale = (1U << bits) - 1U;
    const std::string of_bits = " of " + std::to_string(bits) + "-bit samples, " + std::to_string(full_scale);
    if (levels.saturated > full_scale) lines.push_back("saturated_dn must be at most the full scale" + of_bits);
    if (levels.dark >= levels.saturated)
        lines.push_back("dark_dn must be below saturated_dn, or the full scale" + of_bits);
    return lines;
}

std::string joined(const std::vector<std::string>& lines) {
    std::string text;
    for (const std::string& line : lines) text += (text.empty() ? "" : "; ") + line;
    return text;
}

// Rows a band has when there are several threads; it decodes one row more at either end. As many rows of EMD gradients
// are asked for before they are finished, so that the solver finds many small problems alike.
constexpr int kBandRows = 16;

// For the EMD: three rows of HORDs, closed up too, and their mean deflections, row n in place n % 3.
struct EmdRows {
    EmdRows(const Extents& e, EmdSolver emd_solver)
        : solver(std::move(emd_solver)), hords{HordRow(e), HordRow(e), HordRow(e)},
          gradients(static_cast<std::size_t>(kBandRows * e.m)) {
        for (auto& row : deflections) row.resize(static_cast<std::size_t>(e.m));
        for (auto& row : closed) row.resize(static_cast<std::size_t>(e.m));
    }
    EmdSolver solver;
    std::array<HordRow, 3> hords;
    std::array<AlignedVector<SparseHord>, 3> closed;
    std::array<std::vector<Deflection>, 3> deflections;
    std::vector<EmdGradient> gradients;  // of the rows asked for, one after the other
    std::size_t asked = 0;

    [[nodiscard]] HordRow& hords_of(int n) { return hords[static_cast<std::size_t>(n % 3)]; }
    [[nodiscard]] std::vector<Deflection>& deflections_of(int n) {
        return deflections[static_cast<std::size_t>(n % 3)];
    }
    [[nodiscard]] AlignedVector<SparseHord>& sparse_of(int n) { return closed[static_cast<std::size_t>(n % 3)]; }
    [[nodiscard]] const SparseHord& sparse_hord(int m, int n) { return sparse_of(n)[static_cast<std::size_t>(m)]; }
    [[nodiscard]] Deflection deflection(int m, int n) { return deflections_of(n)[static_cast<std::size_t>(m)]; }
};

// What one thread works with: rows of HORDs for the EMD, else rows of planes, which are read three times as fast.
struct Worker {
    std::optional<EmdRows> rows;
    std::optional<SoaDistances> planes;
    std::optional<ReferenceComparer> comparer;  // where there is a reference
};

}  // namespace

struct Pipeline::Workspace {
    Workspace(const Extents& e, int sample_bits, const Recipe& r, MapSet maps, std::unique_ptr<RowThreadPool> the_crew,
              std::vector<Worker> the_workers)
        : extents(e), bits(sample_bits), recipe(r), levels(light_levels(r, sample_bits)), crew(std::move(the_crew)),
          workers(std::move(the_workers)), zones(e.lenslets()), deflections(e.lenslets()), sums(e.lenslets()),
          scratch(e.lenslets()), mask(e.lenslets()), gradient(r.gradient ? e.lenslets() : 0),
          frobenius(r.slopes || maps == MapSet::all ? e.lenslets() : 0),
          transmission(r.light || maps == MapSet::all ? e.lenslets() : 0),
          spectral(maps == MapSet::all ? e.lenslets() : 0), nuclear(spectral.size()), anisotropy(spectral.size()),
          rim(e, r.rim_margin < 0 ? default_rim_margin(e) : r.rim_margin), defect_finder(e, r) {
        paint_zones(recipe.zones, extents, zones, recipe.lenslet_mm);
        if (recipe.reference) against.emplace(e, recipe);
    }

    Extents extents;
    int bits;
    Recipe recipe;
    LightLevels levels;
    std::unique_ptr<RowThreadPool> crew;
    std::vector<Worker> workers;

    // One value a lenslet; none of a map that is not wanted.
    std::vector<std::uint8_t> zones;
    std::vector<Deflection> deflections;
    std::vector<std::uint32_t> sums, scratch;
    std::vector<std::uint8_t> mask;
    std::vector<float> gradient, frobenius, transmission;
    std::vector<float> spectral, nuclear, anisotropy;

    RimFinder rim;
    DefectFinder defect_finder;

    // What a reference needs.
    struct AgainstReference {
        AgainstReference(const Extents& e, const Recipe& r)
            : registrar(e), judge(e, r), differences(e.lenslets()), z_score(e.lenslets()) {}
        Registrar registrar;
        ReferenceDefects judge;
        std::vector<Difference> differences;
        std::vector<float> z_score;
    };
    std::optional<AgainstReference> against;

    [[nodiscard]] std::size_t at(int m, int n) const {
        return static_cast<std::size_t>(n) * static_cast<std::size_t>(extents.m) + static_cast<std::size_t>(m);
    }
    void compute_maps(const FrameView& frame, Stopwatch& watch, StageTimes& times);
    void compute_band(EmdRows& rows, const FrameView& frame, int first, int last, Stopwatch& watch, StageTimes& times);
    void compare_row(EmdRows& rows, int n);
    void finish_rows(EmdRows& rows, int last);
    void compute_band(SoaDistances& planes, const FrameView& frame, int first, int last, Stopwatch& watch,
                      StageTimes& times);
    void compare_row(SoaDistances& planes, int n);
    [[nodiscard]] std::span<const float> judged_slopes() const {
        return recipe.slopes ? std::span<const float>(frobenius) : std::span<const float>();
    }
    [[nodiscard]] Reason unfit_reason() const;
    Registered compare_with_reference(const FrameView& frame);
};

// The gradients of every row, and what the rest needs of the HORDs.
void Pipeline::Workspace::compute_maps(const FrameView& frame, Stopwatch& watch, StageTimes& times) {
    const int rows = crew->rows_a_band(extents.n);
    crew->share_out((extents.n + rows - 1) / rows, [&](int worker, int band) {
        Stopwatch untimed(nullptr);
        StageTimes nobodys;
        const bool caller = worker == 0;
        const int first = band * rows, last = std::min(first + rows, extents.n);
        Worker& w = workers[static_cast<std::size_t>(worker)];
        if (w.rows) compute_band(*w.rows, frame, first, last, caller ? watch : untimed, caller ? times : nobodys);
        else compute_band(*w.planes, frame, first, last, caller ? watch : untimed, caller ? times : nobodys);
    });
    watch.lap(times.feature_ns);
}

// Streams rows first..last-1, and one more at either end to compare with, through three rows.
void Pipeline::Workspace::compute_band(EmdRows& rows, const FrameView& frame, int first, int last, Stopwatch& watch,
                                       StageTimes& times) {
    const auto ours = [&](int n) { return n >= first && n < last; };
    for (int n = std::max(first - 1, 0); n < std::min(last + 1, extents.n); ++n) {
        const HordRow& hords = rows.hords_of(n);
        decode_row(frame, extents, levels, n, rows.hords_of(n));
        watch.lap(times.decode_ns);
        mean_deflections(hords, rows.deflections_of(n));
        rows.solver.compact()(hords.hord(0).mass, hords.sums(), extents.bins(), rows.sparse_of(n).data());
        if (ours(n)) {
            const auto row = static_cast<std::ptrdiff_t>(at(0, n));
            std::ranges::copy(rows.deflections_of(n), deflections.begin() + row);
            std::ranges::copy(hords.sums(), sums.begin() + row);
            std::ranges::copy(hords.mask(), mask.begin() + row);
        }
        watch.lap(times.hord_ns);
        if (ours(n - 1)) compare_row(rows, n - 1);
        watch.lap(times.feature_ns);
    }
    if (last == extents.n) compare_row(rows, last - 1);
    finish_rows(rows, last);
    watch.lap(times.feature_ns);
}

// The gradients of row n, whose neighbours are among the rows; the EMD's are only asked for.
void Pipeline::Workspace::compare_row(EmdRows& rows, int n) {
    const bool edge_row = n == 0 || n == extents.n - 1;
    const HordRow& row = rows.hords_of(n);
    for (int m = 0; m < extents.m; ++m) {
        const std::size_t k = at(m, n);
        EmdGradient& wanted = rows.gradients[rows.asked++];
        wanted = {};
        Jacobian jacobian;
        if (edge_row || m == 0 || m == extents.m - 1) {
            mask[k] |= kBorder;
        } else if ((mask[k] & kNoHord) == 0) {
            const Stencil across = stencil(row.has_hord(m - 1), row.has_hord(m + 1));
            const Stencil down = stencil(rows.hords_of(n - 1).has_hord(m), rows.hords_of(n + 1).has_hord(m));
            if (across.valid() && down.valid()) {
                const int left = m + across.before, right = m + across.after, above = n + down.before,
                          below = n + down.after;
                submit_emd_gradient(rows.solver, across, rows.sparse_hord(left, n), rows.sparse_hord(right, n), down,
                                    rows.sparse_hord(m, above), rows.sparse_hord(m, below), wanted);
                jacobian = jacobian_of(across, rows.deflection(left, n), rows.deflection(right, n), down,
                                       rows.deflection(m, above), rows.deflection(m, below));
            } else {
                mask[k] |= kBorder;
            }
        }
        if (!frobenius.empty()) frobenius[k] = frobenius_norm(jacobian).to_float_rounded();
        if (spectral.empty()) continue;
        const SingularNorms norms = singular_norms(jacobian);
        spectral[k] = norms.spectral.to_float_rounded();
        nuclear[k] = norms.nuclear.to_float_rounded();
        anisotropy[k] = norms.anisotropy.to_float_rounded();
    }
    if (rows.asked == rows.gradients.size()) finish_rows(rows, n + 1);
}

// Writes the EMD gradients of the rows asked for; `last` is the row after them.
void Pipeline::Workspace::finish_rows(EmdRows& rows, int last) {
    rows.solver.finish();
    float* out = gradient.data() + at(0, last) - rows.asked;
    for (std::size_t k = 0; k < rows.asked; ++k) out[k] = static_cast<float>(rows.gradients[k].norm());
    rows.asked = 0;
}

// The same where there is no EMD.
void Pipeline::Workspace::compute_band(SoaDistances& planes, const FrameView& frame, int first, int last,
                                       Stopwatch& watch, StageTimes& times) {
    const auto ours = [&](int n) { return n >= first && n < last; };
    for (int n = std::max(first - 1, 0); n < std::min(last + 1, extents.n); ++n) {
        planes.load(frame, levels, n);
        watch.lap(times.decode_ns);
        if (ours(n)) {
            const SoaRow& row = planes.loaded(n);
            std::copy_n(row.sums().begin(), extents.m, sums.begin() + static_cast<std::ptrdiff_t>(at(0, n)));
            for (int m = 0; m < extents.m; ++m) {
                deflections[at(m, n)] =
                    (row.mask()[static_cast<std::size_t>(m)] & kDark) != 0 ? Deflection{} : planes.deflection(m, n);
            }
        }
        watch.lap(times.hord_ns);
        if (ours(n - 1)) compare_row(planes, n - 1);
        watch.lap(times.feature_ns);
    }
    if (last == extents.n) compare_row(planes, last - 1);
    watch.lap(times.feature_ns);
}

void Pipeline::Workspace::compare_row(SoaDistances& planes, int n) {
    std::uint8_t* const of_row = mask.data() + at(0, n);
    planes.mark_row(n, of_row);
    if (!gradient.empty()) planes.compare_row(n, gradient.data() + at(0, n), of_row);
    if (!frobenius.empty()) planes.slopes_row(n, frobenius.data() + at(0, n), of_row);
    if (spectral.empty()) return;
    for (int m = 0; m < extents.m; ++m) {
        const SingularNorms norms =
            (of_row[m] & kNoGradient) == 0 ? singular_norms(planes.jacobian(m, n)) : SingularNorms{};
        spectral[at(m, n)] = norms.spectral.to_float_rounded();
        nuclear[at(m, n)] = norms.nuclear.to_float_rounded();
        anisotropy[at(m, n)] = norms.anisotropy.to_float_rounded();
    }
}

// Why the frame does not allow a judgement; none if it does.
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

// Where the part lies, and how every lenslet of it differs from the reference's there.
Registered Pipeline::Workspace::compare_with_reference(const FrameView& frame) {
    const Reference& reference = *recipe.reference;
    const Registered found =
        against->registrar.find(reference.maps(), deflections, sums, mask,
                                static_cast<double>(reference.sensor.electrons_per_dn), reference.parts);
    if (!found.found()) return found;
    const PoseMap pose(found.pose, extents);
    crew->share_out((extents.n + kBandRows - 1) / kBandRows, [&](int worker, int band) {
        ReferenceComparer& comparer = *workers[static_cast<std::size_t>(worker)].comparer;
        const auto columns = static_cast<std::size_t>(extents.m);
        for (int n = band * kBandRows; n < std::min((band + 1) * kBandRows, extents.n); ++n) {
            comparer.compare_row(frame, std::span<const std::uint32_t>(sums).subspan(at(0, n), columns),
                                 std::span<const std::uint8_t>(mask).subspan(at(0, n), columns), n, pose, found.light,
                                 std::span(against->differences).subspan(at(0, n), columns));
        }
    });
    return found;
}

Result<Pipeline> Pipeline::create(const Extents& extents, int bits, const Recipe& recipe, int threads, MapSet maps) {
    if (auto fine = check(extents); !fine) return tl::unexpected(fine.error());
    if (auto fine = check_bits(bits); !fine) return tl::unexpected(fine.error());
    std::vector<std::string> lines = problems(recipe, extents);
    for (std::string& line : problems_of(light_levels(recipe, bits), bits)) lines.push_back(std::move(line));
    for (std::string& line : problems_of_reference(recipe, extents, bits)) lines.push_back(std::move(line));
    if (!lines.empty()) return fail(ErrorCode::invalid_argument, "recipe \"" + recipe.name + "\"", joined(lines));
    auto crew = RowThreadPool::create(threads);
    if (!crew) return tl::unexpected(crew.error());
    std::vector<Worker> workers;
    const auto planes = recipe.reference ? std::make_shared<const ReferenceSoa>(*recipe.reference) : nullptr;
    for (int worker = 0; worker < threads; ++worker) {
        Worker& made = workers.emplace_back();
        if (recipe.reference) made.comparer.emplace(*recipe.reference, widest_isa(), planes);
        if (recipe.gradient != Feature::emd) {
            made.planes.emplace(extents, recipe.gradient.value_or(Feature::jacobian_frobenius), best_isa(), true);
            continue;
        }
        const auto ground = GroundDistance::between_bins(extents.i, extents.j);
        if (!ground) return tl::unexpected(ground.error());
        auto solver = EmdSolver::create(*ground);
        if (!solver) return tl::unexpected(solver.error());
        made.rows.emplace(extents, std::move(*solver));
    }
    return Pipeline(std::make_unique<Workspace>(extents, bits, recipe, maps, std::move(*crew), std::move(workers)));
}

Result<Inspection> Pipeline::inspect(const FrameView& frame, NowNs now) {
    Workspace& w = *workspace_;
    if (auto fine = check_frame(frame, w.extents, w.bits); !fine) return tl::unexpected(fine.error());
    Inspection result;
    result.compares = w.recipe.gradient;
    result.gradient = w.gradient;
    if (w.recipe.gradient == Feature::emd) result.emd = w.gradient;
    result.frobenius = w.frobenius;
    result.transmission = w.transmission;
    result.spectral = w.spectral;
    result.nuclear = w.nuclear;
    result.anisotropy = w.anisotropy;
    result.mask = w.mask;
    result.sums = w.sums;

    Stopwatch total(now), watch(now);
    w.compute_maps(frame, watch, result.times);
    w.rim.mark(w.deflections, w.sums, w.mask);
    for (std::size_t k = 0; k < w.mask.size(); ++k) w.mask[k] |= w.zones[k];
    if (!w.transmission.empty())
        transmissions(w.sums, w.mask, typical_light(w.sums, w.mask, w.scratch), w.transmission);
    watch.lap(result.times.feature_ns);

    result.reason = w.unfit_reason();
    if (result.reason == Reason::none && w.against) {
        result.registered = w.compare_with_reference(frame);
        if (!result.registered.found()) result.reason = Reason::not_registered;
        watch.lap(result.times.feature_ns);
    }
    if (result.reason == Reason::none && w.against) {
        const FoundDefects found =
            w.against->judge.find({w.against->differences, w.gradient, w.judged_slopes(), w.mask},
                                  result.registered.pose, w.against->z_score);
        result.defects = found.defects;
        result.reason = found.reason;
        result.score = found.score;
        result.z_score = w.against->z_score;
        result.verdict = found.defects.empty() ? Verdict::pass : Verdict::reject;
    } else if (result.reason == Reason::none) {
        auto found = w.defect_finder.find({w.gradient, w.judged_slopes(), w.transmission, w.mask});
        if (!found) return tl::unexpected(found.error());
        result.defects = found->defects;
        result.reason = found->reason;
        result.score = found->score;
        result.verdict = found->defects.empty() ? Verdict::pass : Verdict::reject;
    }
    watch.lap(result.times.decide_ns);
    total.lap(result.times.total_ns);
    return result;
}

Pipeline::Pipeline(std::unique_ptr<Workspace> workspace) : workspace_(std::move(workspace)) {}
Pipeline::Pipeline(Pipeline&&) noexcept = default;
Pipeline& Pipeline::operator=(Pipeline&&) noexcept = default;
Pipeline::~Pipeline() = default;

}  // namespace hord::algo
