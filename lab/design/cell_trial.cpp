#include "lab/design/cell_trial.h"

#include <algorithm>
#include <cmath>
#include <functional>
#include <numbers>

#include <fmt/format.h>

#include "hal_sim/optics/camera/render.h"
#include "hal_sim/optics/trace/trace.h"
#include "hal_sim/world/random.h"
#include "lab/report/cpu_time.h"
#include "lab/report/statistics.h"

namespace hord::lab {
namespace {

constexpr int kSurvey = 96;                                                 // rays a side
constexpr int kMaxWindow = 33, kMinWindow = 15, kLargestDefectWindow = 61;  // lenslets a side
constexpr double kSizes[] = {0.25, 0.4, 0.63, 1, 1.6};                      // of the wanted size
constexpr std::size_t kWanted = 3;                                          // index of 1
constexpr double kMargin = 1.01;                                            // of a limit over the largest good value
constexpr double kSameRatio = 0.1;
// work_of(), of a lenslet, in bins read. Slopes take no measurable time: of equal sets, the smaller one is chosen.
constexpr double kLensletWork = 107, kSlopesWork = 1, kDistanceWork = 12, kEmdWork = 90;
constexpr double kSteepest = 0.35;  // slope of light that no camera is built for: of bevels
enum Stream : std::uint64_t { kPlaces = 0xDE5, kNoise = 0xDE6 };

int odd(double lenslets) { return static_cast<int>(lenslets) / 2 * 2 + 1; }

// The frames of one window, for all feature sets.
class WindowFrames {
  public:
    static Result<WindowFrames> render(const sim::Scene& window, const DesignTask& task) {
        WindowFrames frames;
        auto light = sim::render(window, {task.threads, {}});
        if (!light) return tl::unexpected(light.error());
        frames.light_ = std::move(*light);
        frames.scene_ = window;
        algo::Recipe recipe;  // no outline in sight
        recipe.form = algo::PartForm::web;
        recipe.part_required = false;
        auto values = FrameValues::create(window.camera.extents, window.camera.bits, recipe);
        if (!values) return tl::unexpected(values.error());
        frames.values_.emplace(std::move(*values));
        return frames;
    }
    [[nodiscard]] Frame expose(std::uint64_t seed) const { return sim::expose(light_, scene_, seed); }
    Result<PartValues> values(std::uint64_t seed) { return values_->of(expose(seed).view()); }

  private:
    sim::LightField light_;
    sim::Scene scene_;
    std::optional<FrameValues> values_;
};

struct Lenslet {
    int m = 0, n = 0;
};
Lenslet lenslet_at(const sim::Scene& scene, const PartSurvey& survey, const Place& place) {
    const sim::Landing landing = sim::shine(survey.body, place.x_mm, place.y_mm);
    const algo::Extents& e = scene.camera.extents;
    const double pitch = scene.camera.field_mm / e.m, c = std::cos(scene.pose.rotation_rad),
                 s = std::sin(scene.pose.rotation_rad);
    const double x = c * landing.x - s * landing.y + scene.pose.x_mm,
                 y = s * landing.x + c * landing.y + scene.pose.y_mm;
    return {static_cast<int>(std::lround(x / pitch + 0.5 * (e.m - 1))),
            static_cast<int>(std::lround(y / pitch + 0.5 * (e.n - 1)))};
}

// Processor time of the set's verdict, ns a lenslet: the least of a few.
Result<double> time_a_lenslet(const WindowFrames& frames, const sim::Scene& window, const JudgedSet& set,
                              const PartValues& limits) {
    algo::Recipe base;
    base.form = algo::PartForm::web, base.part_required = false;
    auto pipeline = algo::Pipeline::create(window.camera.extents, window.camera.bits, recipe_of(set, limits, base));
    if (!pipeline) return tl::unexpected(pipeline.error());
    double least = kNeverFound;
    for (std::uint64_t k = 0; k < 5; ++k) {
        const Frame frame = frames.expose(k);
        const auto start = thread_cpu_time();
        if (const auto found = pipeline->inspect(frame.view()); !found) return tl::unexpected(found.error());
        least = std::min(least, static_cast<double>((thread_cpu_time() - start).count()));
    }
    return least / static_cast<double>(window.camera.extents.lenslets());
}

FoundSize found_size(std::span<const DetectionTrial> trials, double smallest) {
    FoundSize found;
    const auto all_at = [&](double size) {
        return std::ranges::all_of(trials, [&](const DetectionTrial& t) { return t.size != size || t.found; });
    };
    if (std::ranges::all_of(trials, &DetectionTrial::found)) return {smallest, smallest, true};
    const PodCurve curve = pod_curve(trials);
    if (curve.a90) found.a90_mm = std::max(*curve.a90, smallest);
    double largest = 0;
    for (const DetectionTrial& t : trials) largest = std::max(largest, t.size);
    if (curve.a90_95 && *curve.a90_95 <= largest) found.a90_95_mm = *curve.a90_95;
    if (found.a90_mm > largest && !all_at(largest)) found = {};  // beyond what was tried
    return found;
}

// Share of the field's edge that the part covers.
double share_of_edge(const sim::Scene& part, const sim::Body& body) {
    const double half = 0.5 * part.camera.field_mm, c = std::cos(part.pose.rotation_rad),
                 s = std::sin(part.pose.rotation_rad);
    const auto covers = [&](double x, double y) {  // or takes its light
        sim::RayPolyline line;
        if (sim::shine(body, x, y, &line).path == 0) return true;
        return std::any_of(line.in_part, line.in_part + line.count, std::identity());
    };
    int covered = 0;
    for (int k = 0; k < 4 * kSurvey; ++k) {
        const double along = (2.0 * (k % kSurvey) / (kSurvey - 1) - 1) * half,
                     across = k / kSurvey % 2 == 0 ? half : -half;
        const bool is_row = k / kSurvey < 2;
        const double x = (is_row ? along : across) - part.pose.x_mm, y = (is_row ? across : along) - part.pose.y_mm;
        if (covers(c * x + s * y, c * y - s * x)) ++covered;
    }
    return static_cast<double>(covered) / (4 * kSurvey);
}

}  // namespace

Result<PartSurvey> PartSurvey::of(const sim::Scene& part) {
    PartSurvey survey;
    sim::Scene untilted = part;
    untilted.pose.tilt_x_rad = untilted.pose.tilt_y_rad = untilted.pose.z_mm = 0;
    survey.body = sim::body_of(untilted, false);
    const double step = part.camera.field_mm / kSurvey;
    for (int b = 0; b < kSurvey; ++b) {
        for (int a = 0; a < kSurvey; ++a) {
            const double x = (a + 0.5 - 0.5 * kSurvey) * step, y = (b + 0.5 - 0.5 * kSurvey) * step;
            if (!survey.holds(x, y, step)) continue;
            const sim::Landing landing = sim::shine(survey.body, x, y);
            survey.area_mm2 += step * step;
            ThroughPart way;
            way_through(survey.body, x, y, way);
            survey.thickest_mm = std::max(survey.thickest_mm, length(way.leaves - way.enters));
            survey.largest_slope = std::max({survey.largest_slope, std::abs(landing.u), std::abs(landing.v)});
        }
    }
    if (survey.area_mm2 == 0) {
        return fail(ErrorCode::invalid_argument, "part " + part.name + " has no middle of one solid body in the field",
                    "give a scene with a lens, a plate, a wedge or a solid; hollow parts are not designed for");
    }
    const double edge = share_of_edge(part, survey.body);
    survey.fills_field = edge == 1;
    if (edge > 0 && edge < 1) {
        return fail(ErrorCode::invalid_argument,
                    fmt::format("part {} reaches beyond the field of {:g} mm", part.name, part.camera.field_mm),
                    "give a scene with a larger camera.field_mm, or one that the part fills (a web)");
    }
    return survey;
}

bool PartSurvey::holds(double x_mm, double y_mm, double radius_mm) const {
    const auto is_glass = [&](double x, double y) {
        ThroughPart way;
        if (!way_through(body, x, y, way)) return false;
        const sim::Landing landing = sim::shine(body, x, y);
        return std::max(std::abs(landing.u), std::abs(landing.v)) < kSteepest;
    };
    if (!is_glass(x_mm, y_mm)) return false;
    for (int k = 0; k < 8; ++k) {
        const double angle = k * std::numbers::pi / 4;
        if (!is_glass(x_mm + radius_mm * std::cos(angle), y_mm + radius_mm * std::sin(angle))) return false;
    }
    return true;
}

Result<std::vector<Place>> draw_places(const PartSurvey& survey, const sim::Scene& part, double radius_mm,
                                       std::size_t count, std::uint64_t seed) {
    std::vector<Place> places;
    constexpr std::uint64_t kMaxTries = 20'000;
    for (std::uint64_t k = 0; places.size() < count && k < kMaxTries; ++k) {
        const double half = 0.5 * part.camera.field_mm;
        const Place place{half * sim::random_sign(seed, kPlaces, 3 * k),
                          half * sim::random_sign(seed, kPlaces, 3 * k + 1),
                          std::numbers::pi * sim::random_unit(seed, kPlaces, 3 * k + 2)};
        if (survey.holds(place.x_mm, place.y_mm, radius_mm)) places.push_back(place);
    }
    if (places.size() == count) return places;
    return fail(ErrorCode::invalid_argument,
                "part " + part.name + " is too small for windows of " + std::to_string(radius_mm) + " mm",
                "give a camera with more pixels, or a scene with a smaller field_mm");
}

bool is_better(const SetTrial& a, const SetTrial& b) {
    if (a.holds_rate != b.holds_rate) return a.holds_rate;
    const bool a_never = a.worst_ratio == kNeverFound, b_never = b.worst_ratio == kNeverFound;
    if (a_never != b_never) return b_never;
    // Steps of a tenth, so that the order is one.
    const auto step = [](double ratio) { return std::lround(std::log(ratio) / std::log1p(kSameRatio)); };
    if (!a_never && step(a.worst_ratio) != step(b.worst_ratio)) return a.worst_ratio < b.worst_ratio;
    return a.work < b.work;
}

double work_of(const JudgedSet& set, const algo::Extents& extents) {
    const double gradient = !set.gradient ? 0 : *set.gradient == algo::Feature::emd ? kEmdWork : kDistanceWork;
    const double lenslet = kLensletWork + extents.bins() + (set.slopes ? kSlopesWork : 0) + gradient;
    return static_cast<double>(extents.lenslets()) * lenslet;
}

namespace {

// One cell's trials.
class Trials {
  public:
    Trials(const DesignTask& task, const PartSurvey& survey, const CellChoice& cell, const Effort& effort)
        : task_(task), survey_(survey), effort_(effort), scene_(scene_of(cell, task.part, task.camera)),
          pitch_(scene_.camera.field_mm / scene_.camera.extents.m) {}

    Result<CellTrial> run(const CellChoice& cell) {
        CellTrial trial{cell, {}, {}};
        for (const JudgedSet& set : judged_sets()) trial.sets.push_back({set, {}, {}, 0, 0, false});
        if (auto done = clean_windows(trial); !done) return tl::unexpected(done.error());
        for (const WantedDefect& defect : task_.defects) {
            if (auto done = try_defect(defect, trial); !done) return tl::unexpected(done.error());
        }
        for (SetTrial& set : trial.sets) {
            set.holds_rate = set.time_ms * 1e-3 * task_.rate <= kUseOfCore * task_.inspection_threads;
            set.worst_ratio = worst_ratio(set.found, task_.defects);
        }
        std::ranges::stable_sort(trial.sets, is_better);
        return trial;
    }

    Result<std::vector<FoundSize>> sizes_at(const JudgedSet& set, const PartValues& limits) {
        CellTrial trial;
        trial.sets.push_back({set, limits, {}, 0, 0, false});
        for (const WantedDefect& defect : task_.defects) {
            if (auto done = try_defect(defect, trial); !done) return tl::unexpected(done.error());
        }
        return std::move(trial.sets.front().found);
    }

  private:
    Result<void> clean_windows(CellTrial& trial) {
        const double across = 2 * std::sqrt(survey_.area_mm2 / std::numbers::pi);
        const int side = std::clamp(odd(0.4 * across / pitch_), 9, kMaxWindow);
        const auto places = draw_places(survey_, task_.part, 0.71 * side * pitch_, effort_.clean_windows, task_.seed);
        if (!places) return tl::unexpected(places.error());
        std::array<std::vector<double>, kPartValues> good;
        std::optional<WindowFrames> last;
        sim::Scene window;
        for (std::size_t p = 0; p < places->size(); ++p) {
            const Lenslet at = lenslet_at(scene_, survey_, (*places)[p]);
            window = window_of(scene_, at.m, at.n, side);
            auto frames = WindowFrames::render(window, task_);
            if (!frames) return tl::unexpected(frames.error());
            for (int d = 0; d < 3 * effort_.draws; ++d) {
                const auto values = frames->values(noise_seed(p, d));
                if (!values) return tl::unexpected(values.error());
                for (std::size_t v = 0; v < kPartValues; ++v) good[v].push_back((*values)[v]);
            }
            last.emplace(std::move(*frames));
        }
        const double windows_a_part = std::max(1.0, survey_.area_mm2 / (side * side * pitch_ * pitch_));
        PartValues limits{};
        for (std::size_t v = 0; v < kPartValues; ++v) {
            const double largest = *std::ranges::max_element(good[v]);
            limits[v] =
                std::max({gumbel_limit(good[v], task_.false_rejects / windows_a_part), kMargin * largest, 1e-3});
        }
        for (SetTrial& set : trial.sets) {
            set.limits = limits;
            const auto ns = time_a_lenslet(*last, window, set.set, limits);
            if (!ns) return tl::unexpected(ns.error());
            set.time_ms = *ns * 1e-6 * static_cast<double>(scene_.camera.extents.lenslets());
            set.work = work_of(set.set, scene_.camera.extents);
        }
        return {};
    }

    Result<void> try_defect(const WantedDefect& defect, CellTrial& trial) {
        // The places keep all sizes within the glass.
        const double largest = std::end(kSizes)[-1] * defect.size_mm;
        const auto places = draw_places(survey_, task_.part, reach_mm(defect.kind, largest) + 6 * pitch_,
                                        effort_.places, task_.seed + 1 + static_cast<std::uint64_t>(defect.kind));
        if (!places) return tl::unexpected(places.error());
        std::vector<std::vector<DetectionTrial>> trials(trial.sets.size());
        double smallest = kNeverFound;
        const auto run_size = [&](std::size_t k) -> Result<double> {  // the best set's share
            const double size = kSizes[k] * defect.size_mm;
            smallest = std::min(smallest, size);
            std::vector<int> found(trial.sets.size());
            int tried = 0;
            for (std::size_t p = 0; p < places->size(); ++p) {
                auto frames = with_defect(defect.kind, size, (*places)[p]);
                if (!frames) return tl::unexpected(frames.error());
                for (int d = 0; d < effort_.draws; ++d, ++tried) {
                    const auto values = frames->values(noise_seed(100 + p, d));
                    if (!values) return tl::unexpected(values.error());
                    for (std::size_t s = 0; s < trial.sets.size(); ++s) {
                        const bool is_found = finds(trial.sets[s], *values);
                        trials[s].push_back({size, is_found});
                        found[s] += is_found ? 1 : 0;
                    }
                }
            }
            return static_cast<double>(*std::ranges::max_element(found)) / tried;
        };
        auto share = run_size(kWanted);
        if (!share) return tl::unexpected(share.error());
        if (*share < 0.9) {
            for (std::size_t k = kWanted + 1; k < std::size(kSizes); ++k) {
                if (auto larger = run_size(k); !larger) return tl::unexpected(larger.error());
            }
        }
        for (std::size_t k = kWanted; k-- > 0 && *share >= 0.3;) {
            share = run_size(k);
            if (!share) return tl::unexpected(share.error());
        }
        for (std::size_t s = 0; s < trial.sets.size(); ++s)
            trial.sets[s].found.push_back(found_size(trials[s], smallest));
        return {};
    }

    Result<WindowFrames> with_defect(WantedKind kind, double size_mm, const Place& place) const {
        auto defect = make_defect(kind, size_mm, scene_, survey_.body, place.x_mm, place.y_mm, place.turn_rad);
        if (!defect) return tl::unexpected(defect.error());
        const Lenslet at = lenslet_at(scene_, survey_, place);
        const int side = std::clamp(odd(2.5 * reach_mm(kind, size_mm) / pitch_) + 8, kMinWindow, kLargestDefectWindow);
        sim::Scene window = window_of(scene_, at.m, at.n, side);
        window.defects = {*defect};
        return WindowFrames::render(window, task_);
    }

    static bool finds(const SetTrial& set, const PartValues& values) {
        for (std::size_t v = 0; v < kPartValues; ++v) {
            if (set.set.has(v) && values[v] >= set.limits[v]) return true;
        }
        return false;
    }
    [[nodiscard]] std::uint64_t noise_seed(std::size_t window, int draw) const {
        return sim::random_bits(task_.seed, kNoise + window, static_cast<std::uint64_t>(draw));
    }

    const DesignTask& task_;
    const PartSurvey& survey_;
    Effort effort_;
    sim::Scene scene_;
    double pitch_;
};

}  // namespace

Result<CellTrial> try_cell(const CellChoice& cell, const DesignTask& task, const PartSurvey& survey,
                           const Effort& effort) {
    if (std::string problem = problem_of(cell, task.part, task.camera, survey.largest_slope); !problem.empty())
        return CellTrial{cell, std::move(problem), {}};
    return Trials(task, survey, cell, effort).run(cell);
}

Result<std::vector<FoundSize>> find_sizes(const CellChoice& cell, const JudgedSet& set, const PartValues& limits,
                                          const DesignTask& task, const PartSurvey& survey, const Effort& effort) {
    return Trials(task, survey, cell, effort).sizes_at(set, limits);
}

double worst_ratio(const std::vector<FoundSize>& found, const std::vector<WantedDefect>& wanted) {
    double worst = 0;
    for (std::size_t d = 0; d < found.size(); ++d) worst = std::max(worst, found[d].a90_mm / wanted[d].size_mm);
    return worst;
}

}  // namespace hord::lab
