// What a Pipeline works with. Internal to algo/inspection: pipeline.cpp, pipeline_maps.cpp.
#pragma once

#include <array>
#include <cstdint>
#include <memory>
#include <optional>
#include <span>
#include <vector>

#include "algo/emd/emd_solver.h"
#include "algo/features/deflection.h"
#include "algo/features/gradient.h"
#include "algo/features/jacobian.h"
#include "algo/features/row_window.h"
#include "algo/frame/decode.h"
#include "algo/inspection/defects.h"
#include "algo/inspection/exact_gradients.h"
#include "algo/inspection/frame_checks.h"
#include "algo/inspection/missing_material.h"
#include "algo/inspection/pipeline.h"
#include "algo/inspection/raw_rows.h"
#include "algo/inspection/reference_defects.h"
#include "algo/inspection/reference_outline.h"
#include "algo/inspection/rim.h"
#include "algo/maps/row_thread_pool.h"
#include "algo/recipe/zones.h"
#include "algo/soa/soa_distances.h"
#include "algo/soa/soa_emd_bounds.h"

namespace hord::algo {

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

// Rows of EMD gradients that are submitted together: the solver batches small problems of one shape.
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

    void load(const FrameView& frame, const LightLevels& levels, int n, int from) {
        window.decode(frame, levels, n, from);
    }
    [[nodiscard]] std::vector<Deflection>& deflections_of(int n) {
        return deflections[static_cast<std::size_t>(n % 3)];
    }
    [[nodiscard]] Deflection deflection(int m, int n) { return deflections_of(n)[static_cast<std::size_t>(m)]; }
};

// The working memory of one thread.
struct PipelineWorker {
    std::optional<RawRows> raw;                 // if frames are raw
    std::optional<EmdRows> emd;                 // if the map of the EMD is wanted;
    std::optional<SoaDistances> soa;            // else decoded into the SoA layout, which is three times as fast
    std::optional<SoaDistances> shares;         // if the EMD is bounded: for its second look at the frame
    std::optional<ReferenceComparer> comparer;  // if the recipe has a reference
    int next_row = -1;                          // the row after the last band of this frame
    Alternation alternation;                    // of the rows of this frame that the thread looked at
};

struct Pipeline::Workspace {
    Workspace(const Extents& e, int sample_bits, const Recipe& r, MapSet maps,
              std::unique_ptr<RowThreadPool> thread_pool, std::vector<PipelineWorker> thread_workers)
        : extents(e), bits(sample_bits), recipe(r), levels(light_levels(r, sample_bits)), pool(std::move(thread_pool)),
          workers(std::move(thread_workers)), zones(e.lenslets()), deflections(e.lenslets()), sums(e.lenslets()),
          scratch(e.lenslets()), mask(e.lenslets()), gradient(r.gradient ? e.lenslets() : 0),
          frobenius(r.slopes || maps == MapSet::all ? e.lenslets() : 0),
          transmission(r.light || maps == MapSet::all ? e.lenslets() : 0),
          spectral(maps == MapSet::all ? e.lenslets() : 0), nuclear(spectral.size()), anisotropy(spectral.size()),
          checks(e, sample_bits, r), rim(RimFinder::of(r, e)), defect_finder(e, r) {
        paint_zones(recipe.zones, extents, zones, recipe.lenslet_mm);
        if (recipe.reference) comparison.emplace(e, recipe, maps);
        else if (recipe.light && recipe.transmission_limit > 0) missing_material.emplace(e, r.form);
    }

    Extents extents;
    int bits;
    Recipe recipe;
    LightLevels levels;                 // of the current frame
    FrameView raw;                      // the current frame, if frames are raw,
    std::optional<Frame> macro_pixels;  // and what is decoded from it
    std::unique_ptr<RowThreadPool> pool;
    std::vector<PipelineWorker> workers;  // one a thread

    // One value a lenslet, row by row; empty if the map is not computed.
    std::vector<std::uint8_t> zones;
    std::vector<Deflection> deflections;
    std::vector<std::uint32_t> sums, scratch;
    std::uint32_t typical = 0;  // typical_light(), what a transmission is relative to
    std::vector<std::uint8_t> mask;
    std::vector<float> gradient, frobenius, transmission;
    std::vector<float> spectral, nuclear, anisotropy;

    FrameChecks checks;
    RimFinder rim;
    DefectFinder defect_finder;
    std::optional<MissingMaterialFinder> missing_material;  // without a reference, if light is judged
    Defect missing;                                         // what it found
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
            : registrar(e), outline(r, e), defect_finder(e, r), without_part(e.lenslets()), differences(e.lenslets()),
              z_score(e.lenslets()), compared(maps == MapSet::all ? e.lenslets() : 0) {}
        Registrar registrar;
        ReferenceOutline outline;
        ReferenceDefects defect_finder;
        std::vector<std::uint8_t> without_part;  // the mask before the part was marked
        std::vector<Difference> differences;
        std::vector<float> z_score;
        std::vector<std::uint8_t> compared;
    };
    std::optional<Comparison> comparison;  // if the recipe has a reference

    Result<FrameView> take_in(const FrameView& frame);
    void compute_maps(const FrameView& frame, Stopwatch& watch, StageTimes& times);
    template <class Rows>
    void compute_band(PipelineWorker& worker, Rows& rows, const FrameView& frame, int first, int last, Stopwatch& watch,
                      StageTimes& times);
    template <class Rows>
    void load(PipelineWorker& worker, Rows& rows, const FrameView& frame, int n, bool in_band, Stopwatch& watch,
              StageTimes& times);
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
        return comparison ? kNoGradient | kOutside : kNoGradient | kNotJudged;
    }
    [[nodiscard]] LensletCounts count_lenslets() const;
    [[nodiscard]] Reason unfit_reason(const LensletCounts& lenslets) const;
    [[nodiscard]] LoneSample lone_sample(const FrameView& frame, const Defect& defect, float noise_dn) const;
    std::optional<Registered> mark_part();
    Alternation measure_light();
    void disregard_light_of_hole();
    std::optional<MissingMaterial> seek_missing();
    Registered find_pose(std::span<const std::uint8_t> lit);
    void look_again(const FrameView& frame, const Registered& registered, Stopwatch& watch, StageTimes& times);
    void find_bounded_columns(int first_row, int last_row);
    void bound_row(SoaDistances& rows, const FrameView& frame, int n, int& next, int most_bins);
    [[nodiscard]] int most_bins_to_bound() const;
    Result<FoundDefects> find_defects(bool& bounded);
    void find_missing(Inspection& result);
    void check_good(Inspection& result, bool lacks_outline);
    FoundDefects find_differences(const FrameView& frame, const Registered& registered, bool& bounded);
};

}  // namespace hord::algo
