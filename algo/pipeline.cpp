#include "algo/pipeline.h"

#include <algorithm>
#include <array>
#include <cstdlib>
#include <string>
#include <vector>

#include "algo/decode.h"
#include "algo/defects.h"
#include "algo/deflection.h"
#include "algo/emd.h"
#include "algo/gradient.h"
#include "algo/jacobian.h"
#include "algo/rim.h"
#include "algo/transmission.h"
#include "algo/zones.h"

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

LightLevels light_levels(const Recipe& recipe, int bits) {
    const std::uint32_t full_scale = (1U << bits) - 1U;
    const std::uint32_t per_8_bit_dn = 1U << (bits - 8);
    return {recipe.dark_dn == 0 ? kDarkDn8Bit * per_8_bit_dn : recipe.dark_dn,
            recipe.min_sum_dn == 0 ? kMinSumDn8Bit * per_8_bit_dn : recipe.min_sum_dn,
            recipe.saturated_dn == 0 ? full_scale : recipe.saturated_dn};
}

std::vector<std::string> problems_of(const LightLevels& levels, int bits) {
    std::vector<std::string> lines;
    const std::uint32_t full_scale = (1U << bits) - 1U;
    const std::string of_bits = " of " + std::to_string(bits) + "-bit samples, " + std::to_string(full_scale);
    if (levels.saturated > full_scale) lines.push_back("saturated_dn must be at most the full scale" + of_bits);
    if (levels.dark >= levels.saturated) lines.push_back("dark_dn must be below saturated_dn, or the full scale" + of_bits);
    return lines;
}

std::string joined(const std::vector<std::string>& lines) {
    std::string text;
    for (const std::string& line : lines) text += (text.empty() ? "" : "; ") + line;
    return text;
}

std::string size_of(int width, int height) { return std::to_string(width) + "x" + std::to_string(height); }

}  // namespace

struct Pipeline::Workspace {
    Workspace(const Extents& e, int sample_bits, const Recipe& r, EmdSolver emd_solver)
        : extents(e), bits(sample_bits), recipe(r), levels(light_levels(r, sample_bits)), solver(std::move(emd_solver)),
          rows{HordRow(e), HordRow(e), HordRow(e)}, zones(e.lenslets()), deflections(e.lenslets()), sums(e.lenslets()), scratch(e.lenslets()),
          mask(e.lenslets()), emd(e.lenslets()), frobenius(e.lenslets()), transmission(e.lenslets()),
          rim(e, r.rim_margin < 0 ? default_rim_margin(e) : r.rim_margin), defect_finder(e, r) {
        paint_zones(recipe.zones, extents, zones);
    }

    Extents extents;
    int bits;
    Recipe recipe;
    LightLevels levels;
    EmdSolver solver;
    std::array<HordRow, 3> rows;  // lenslet row n is in rows[n % 3]

    // One value a lenslet.
    std::vector<std::uint8_t> zones;
    std::vector<Deflection> deflections;
    std::vector<std::uint32_t> sums, scratch;
    std::vector<std::uint8_t> mask;
    std::vector<float> emd, frobenius, transmission;

    RimFinder rim;
    DefectFinder defect_finder;

    [[nodiscard]] HordRow& row(int n) { return rows[static_cast<std::size_t>(n % 3)]; }
    [[nodiscard]] std::size_t at(int m, int n) const { return static_cast<std::size_t>(n) * static_cast<std::size_t>(extents.m) + static_cast<std::size_t>(m); }
    [[nodiscard]] Result<void> check_frame(const FrameView& frame) const;
    void load_row(const FrameView& frame, int n, Stopwatch& watch, StageTimes& times);
    void compare_row(int n);
    [[nodiscard]] Reason unfit_reason() const;
};

Result<void> Pipeline::Workspace::check_frame(const FrameView& frame) const {
    if (frame.width_px != extents.width_px() || frame.height_px != extents.height_px() || frame.bits != bits) {
        return fail(ErrorCode::invalid_argument,
                    "a frame of " + size_of(frame.width_px, frame.height_px) + " pixels at " + std::to_string(frame.bits) + " bits",
                    "this pipeline was set up for " + size_of(extents.width_px(), extents.height_px()) + " at " + std::to_string(bits));
    }
    const std::ptrdiff_t row_bytes = std::ptrdiff_t{frame.width_px} * frame.sample_bytes();
    if (frame.data == nullptr || std::abs(frame.stride_bytes) < row_bytes) {
        return fail(ErrorCode::invalid_argument, "a frame whose rows are " + std::to_string(frame.stride_bytes) + " bytes apart",
                    "rows of this frame need " + std::to_string(row_bytes));
    }
    if (frame.bits > 8 && (reinterpret_cast<std::uintptr_t>(frame.data) % 2 != 0 || frame.stride_bytes % 2 != 0)) {
        return fail(ErrorCode::invalid_argument, "two-byte samples at an odd address", "align the frame's rows to two bytes");
    }
    return {};
}

// Decodes row n and notes what is needed of it later.
void Pipeline::Workspace::load_row(const FrameView& frame, int n, Stopwatch& watch, StageTimes& times) {
    HordRow& hords = row(n);
    decode_row(frame, extents, levels, n, hords);
    watch.lap(times.decode_ns);
    mean_deflections(hords, std::span(deflections).subspan(at(0, n), static_cast<std::size_t>(extents.m)));
    std::ranges::copy(hords.sums(), sums.begin() + static_cast<std::ptrdiff_t>(at(0, n)));
    std::ranges::copy(hords.mask(), mask.begin() + static_cast<std::ptrdiff_t>(at(0, n)));
    watch.lap(times.hord_ns);
}

// The gradients of row n, once its neighbours are loaded.
void Pipeline::Workspace::compare_row(int n) {
    const bool edge_row = n == 0 || n == extents.n - 1;
    for (int m = 0; m < extents.m; ++m) {
        const std::size_t k = at(m, n);
        emd[k] = 0;
        frobenius[k] = 0;
        if (edge_row || m == 0 || m == extents.m - 1) {
            mask[k] |= kBorder;
            continue;
        }
        if ((mask[k] & kNoHord) != 0) continue;
        const Stencil across = stencil(row(n).has_hord(m - 1), row(n).has_hord(m + 1));
        const Stencil down = stencil(row(n - 1).has_hord(m), row(n + 1).has_hord(m));
        if (!across.valid() || !down.valid()) {
            mask[k] |= kBorder;
            continue;
        }
        const int left = m + across.before, right = m + across.after, above = n + down.before, below = n + down.after;
        emd[k] = static_cast<float>(
            emd_gradient(solver, across, row(n).hord(left), row(n).hord(right), down, row(above).hord(m), row(below).hord(m)).norm());
        frobenius[k] = frobenius_norm(jacobian_of(across, deflections[at(left, n)], deflections[at(right, n)], down, deflections[at(m, above)],
                                                  deflections[at(m, below)]))
                           .to_float_rounded();
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
    const auto share_of_judged = [&](std::size_t count) { return static_cast<float>(count) / static_cast<float>(judged); };
    if (lit == 0 || share_of_judged(lit) < recipe.min_lit_share) return Reason::too_dark;
    if (share_of_judged(saturated) > recipe.max_saturated_share) return Reason::saturated;
    return Reason::none;
}

Result<Pipeline> Pipeline::create(const Extents& extents, int bits, const Recipe& recipe) {
    if (auto fine = check(extents); !fine) return tl::unexpected(fine.error());
    if (bits < 8 || bits > 16) return fail(ErrorCode::invalid_argument, "samples of " + std::to_string(bits) + " bits", "use 8 to 16 bits");
    std::vector<std::string> lines = problems(recipe, extents);
    for (std::string& line : problems_of(light_levels(recipe, bits), bits)) lines.push_back(std::move(line));
    if (!lines.empty()) return fail(ErrorCode::invalid_argument, "recipe \"" + recipe.name + "\"", joined(lines));
    auto ground = GroundDistance::between_bins(extents.i, extents.j);
    if (!ground) return tl::unexpected(ground.error());
    auto solver = EmdSolver::create(*ground);
    if (!solver) return tl::unexpected(solver.error());
    return Pipeline(std::make_unique<Workspace>(extents, bits, recipe, std::move(*solver)));
}

Result<Inspection> Pipeline::inspect(const FrameView& frame, NowNs now) {
    Workspace& w = *workspace_;
    if (auto fine = w.check_frame(frame); !fine) return tl::unexpected(fine.error());
    Inspection result;
    result.emd = w.emd;
    result.frobenius = w.frobenius;
    result.transmission = w.transmission;
    result.mask = w.mask;

    Stopwatch total(now), watch(now);
    for (int n = 0; n < w.extents.n; ++n) {
        w.load_row(frame, n, watch, result.times);
        if (n > 0) w.compare_row(n - 1);
        watch.lap(result.times.feature_ns);
    }
    w.compare_row(w.extents.n - 1);
    watch.lap(result.times.feature_ns);

    w.rim.mark(w.deflections, w.sums, w.mask);
    for (std::size_t k = 0; k < w.mask.size(); ++k) w.mask[k] |= w.zones[k];
    transmissions(w.sums, w.mask, typical_light(w.sums, w.mask, w.scratch), w.transmission);
    watch.lap(result.times.feature_ns);

    result.reason = w.unfit_reason();
    if (result.reason == Reason::none) {
        auto found = w.defect_finder.find({w.emd, w.frobenius, w.transmission, w.mask});
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
