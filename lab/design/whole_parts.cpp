#include "lab/design/whole_parts.h"

#include <algorithm>
#include <cmath>
#include <numbers>
#include <numeric>

#include "algo/good_parts/false_rejects.h"
#include "algo/inspection/rim.h"
#include "hal_sim/optics/trace/trace.h"
#include "hal_sim/world/random.h"
#include "lab/report/cpu_time.h"
#include "lab/report/statistics.h"

namespace hord::lab {
namespace {

constexpr double kMargin = 1.05;  // of a limit over the largest good value
// Beside the part's edge light is dark (bevels), or differs much from part to part. The rim is widened, by at most
// kWiderRim lenslets, until good parts miss less light than the default recipe tolerates, and one lenslet more lowers
// no largest value of theirs to less than kSteady of it.
constexpr double kTolerableLight = 0.3, kSteady = 0.9;
constexpr int kWiderRim = 6;
constexpr std::uint64_t kOtherSeed = 1000, kTrialSeed = 100;
enum Stream : std::uint64_t { kPose = 0xDE7, kExposure = 0xDE8 };

// What makes good parts fit that are unfit for this reason.
const char* cure_of(algo::Reason reason, algo::PartForm form) {
    if (reason == algo::Reason::no_part && form == algo::PartForm::plate) {
        return "a plate is told by its dark edges and by the light that its faces reflect: give a part with bevels "
               "(kind "
               "\"solid\") and [effects] fresnel = true, as hal_sim/scenes/plate.toml has, or one that fills the field "
               "(--form web)";
    }
    if (reason == algo::Reason::unexpected_light)
        return "noise reaches bins without light: lower --read-noise, or raise --full-well";
    return "give the part's form (--form), or a scene in which the whole part is in the field";
}

// Fails with unsupported where the last frame of good parts was unfit.
Result<void> check_fit(const FrameValues& measured, algo::PartForm form) {
    if (measured.verdict() != algo::Verdict::unfit) return {};
    return fail(ErrorCode::unsupported, "good parts are unfit in this cell: " + std::string(name_of(measured.reason())),
                cure_of(measured.reason(), form));
}

class WholeParts {
  public:
    WholeParts(const CellChoice& cell, const SetTrial& set, const DesignTask& task, const PartSurvey& survey,
               const CheckEffort& effort, const std::function<void(double)>& progress)
        : cell_(cell), set_(set), task_(task), survey_(survey), effort_(effort), progress_(progress),
          steps_(effort.poses * (3.0 * effort.exposures + 1) +
                 2.0 * effort.bad * static_cast<double>(task.defects.size())) {}

    Result<WholeCheck> run() {
        WholeCheck check;
        if (auto done = find_limits(check); !done) return tl::unexpected(done.error());
        if (auto done = judge_good(check); !done) return tl::unexpected(done.error());
        for (std::size_t d = 0; d < task_.defects.size(); ++d) {
            DefectCheck of{{task_.defects[d].size_mm, 0, 0}, {check.found[d].a90_mm, 0, 0}};
            for (SizeCheck* size : {&of.wanted, &of.a90}) {
                if (size->size_mm == kNeverFound) continue;
                if (auto done = judge_bad(task_.defects[d].kind, *size); !done) return tl::unexpected(done.error());
            }
            check.defects.push_back(of);
        }
        return check;
    }

  private:
    void step() { progress_(std::min(1.0, ++done_ / steps_)); }

    Result<sim::LightField> render(const sim::Scene& scene) {
        auto field = sim::render(scene, {task_.threads, {}});
        step();
        return field;
    }
    static std::uint64_t exposure_seed(std::uint64_t seed, int part, int exposure) {
        return sim::random_bits(seed, kExposure + static_cast<std::uint64_t>(part),
                                static_cast<std::uint64_t>(exposure));
    }

    // The values of good frames with one margin of the rim.
    struct RimValues {
        int margin = 0;
        FrameValues measure;
        std::vector<PartValues> values;
    };
    // From the asked margin to kWiderRim lenslets more; a web has no rim.
    Result<std::vector<RimValues>> rims_of(int bits) {
        const int asked = base_.rim_margin;
        const int start = asked < 0 ? algo::default_rim_margin(extents_) : asked;
        std::vector<RimValues> rims;
        for (int wider = 0; wider <= (base_.form == algo::PartForm::web ? 0 : kWiderRim); ++wider) {
            algo::Recipe base = base_;
            if (wider > 0) base.rim_margin = start + wider;
            auto measure = FrameValues::create(extents_, bits, base, set_.set);
            if (!measure) return tl::unexpected(measure.error());
            rims.push_back({base.rim_margin, std::move(*measure), {}});
        }
        return rims;
    }
    // Adds a good frame. Fails where it is unfit with the asked margin; wider ones that make it unfit are dropped.
    Result<void> measure(const Frame& frame, std::vector<RimValues>& rims) const {
        for (std::size_t k = 0; k < rims.size(); ++k) {
            const auto of = rims[k].measure.of(frame.view());
            if (!of) return tl::unexpected(of.error());
            if (auto fit = check_fit(rims[k].measure, base_.form); !fit) {
                if (k == 0) return fit;
                rims.erase(rims.begin() + static_cast<std::ptrdiff_t>(k), rims.end());
                return {};
            }
            rims[k].values.push_back(*of);
        }
        return {};
    }

    // The narrowest rim that is wide enough. The asked one if none is wide enough for the light.
    static const RimValues& wide_enough(const std::vector<RimValues>& rims) {
        std::size_t k = 0;
        for (; k + 1 < rims.size(); ++k) {
            const PartValues worst = largest(rims[k].values);
            if (worst[kLightValue] < kTolerableLight && is_steady(worst, largest(rims[k + 1].values))) break;
        }
        return largest(rims[k].values)[kLightValue] < kTolerableLight ? rims[k] : rims.front();
    }
    static PartValues largest(const std::vector<PartValues>& all) {
        PartValues worst{};
        for (const PartValues& of : all) {
            for (std::size_t v = 0; v < kPartValues; ++v) worst[v] = std::max(worst[v], of[v]);
        }
        return worst;
    }
    static bool is_steady(const PartValues& worst, const PartValues& with_wider_rim) {
        for (std::size_t v = 0; v < kPartValues; ++v) {
            if (with_wider_rim[v] < kSteady * worst[v]) return false;
        }
        return true;
    }

    Result<void> find_limits(WholeCheck& check) {
        std::vector<RimValues> rims;
        const int count = effort_.poses * effort_.exposures;
        for (int k = 0; k < count; ++k, step()) {
            const sim::Scene scene = spread_part(cell_, task_, k, count);
            const auto field = render(scene);
            if (!field) return tl::unexpected(field.error());
            extents_ = scene.camera.extents;
            for (int x = 0; x < effort_.limit_exposures; ++x) {
                const Frame frame = sim::expose(*field, scene, exposure_seed(task_.seed, k, x));
                if (rims.empty()) {
                    auto made = rims_of(frame.bits());
                    if (!made) return tl::unexpected(made.error());
                    rims = std::move(*made);
                }
                if (auto done = measure(frame, rims); !done) return done;
            }
        }
        const RimValues& rim = wide_enough(rims);
        base_.rim_margin = rim.margin;
        check.limit_frames = static_cast<int>(rim.values.size());
        PartValues limits{};
        for (std::size_t v = 0; v < kPartValues; ++v) {
            std::vector<double> good;
            for (const PartValues& of : rim.values) good.push_back(of[v]);
            const double largest = *std::ranges::max_element(good);
            limits[v] = std::max(
                1e-3, limit_above(std::max(algo::predicted_limit(good, task_.false_rejects), kMargin * largest)));
        }
        check.recipe = recipe_of(set_.set, limits, base_);
        DesignTask other_places = task_;
        other_places.seed += kTrialSeed;
        auto found = find_sizes(cell_, set_.set, limits, other_places, survey_, effort_.trials);
        if (!found) return tl::unexpected(found.error());
        check.found = std::move(*found);
        check.worst_ratio = worst_ratio(check.found, task_.defects);
        return {};
    }

    Result<void> judge_good(WholeCheck& check) {
        std::vector<double> times;
        for (int k = 0; k < effort_.poses; ++k) {
            const sim::Scene scene = good_part(cell_, task_, task_.seed + kOtherSeed, k);
            auto field = render(scene);
            if (!field) return tl::unexpected(field.error());
            if (!pipeline_) {
                auto made = algo::Pipeline::create(scene.camera.extents, scene.camera.bits, check.recipe);
                if (!made) return tl::unexpected(made.error());
                pipeline_.emplace(std::move(*made));
            }
            for (int x = 0; x < effort_.exposures; ++x, step()) {
                const Frame frame = sim::expose(*field, scene, exposure_seed(task_.seed + kOtherSeed, k, x));
                const auto start = thread_cpu_time();
                const auto found = pipeline_->inspect(frame.view());
                if (!found) return tl::unexpected(found.error());
                times.push_back(std::chrono::duration<double, std::milli>(thread_cpu_time() - start).count());
                ++check.good;
                if (found->verdict == algo::Verdict::pass) continue;
                if (check.rejected++ == 0) check.reason = found->reason;
            }
            if (k == 0) scene_ = scene, field_ = std::move(*field);
        }
        check.time_ms = quantile(times, 0.5);
        check.longest_ms = *std::ranges::max_element(times);
        return {};
    }

    Result<void> judge_bad(WantedKind kind, SizeCheck& check) {
        const algo::Extents& e = scene_.camera.extents;
        const double pitch = scene_.camera.field_mm / e.m;
        const auto places = draw_places(survey_, task_.part, reach_mm(kind, check.size_mm) + 6 * pitch,
                                        static_cast<std::size_t>(effort_.bad), task_.seed + kOtherSeed);
        if (!places) return tl::unexpected(places.error());
        for (const Place& place : *places) {
            auto defect =
                make_defect(kind, check.size_mm, scene_, survey_.body, place.x_mm, place.y_mm, place.turn_rad);
            if (!defect) return tl::unexpected(defect.error());
            const sim::Landing landing = sim::shine(survey_.body, place.x_mm, place.y_mm);
            const int m = static_cast<int>(std::lround((landing.x + scene_.pose.x_mm) / pitch + 0.5 * (e.m - 1))),
                      n = static_cast<int>(std::lround((landing.y + scene_.pose.y_mm) / pitch + 0.5 * (e.n - 1)));
            const int half = static_cast<int>(std::ceil(1.25 * reach_mm(kind, check.size_mm) / pitch)) + 4;
            sim::Scene window = window_of(scene_, m, n, 2 * half + 1);
            window.defects = {*defect};
            const auto light = sim::render(window, {task_.threads, {}});
            if (!light) return tl::unexpected(light.error());
            sim::LightField bad = field_;
            paste(bad, *light, m, n);
            const Frame frame = sim::expose(bad, scene_, exposure_seed(task_.seed + kOtherSeed, 100, check.tried));
            const auto found = pipeline_->inspect(frame.view());
            if (!found) return tl::unexpected(found.error());
            ++check.tried;
            check.found += found->verdict == algo::Verdict::pass ? 0 : 1;
            step();
        }
        return {};
    }

    const CellChoice& cell_;
    const SetTrial& set_;
    const DesignTask& task_;
    const PartSurvey& survey_;
    CheckEffort effort_;
    const std::function<void(double)>& progress_;
    double steps_, done_ = 0;
    algo::Recipe base_ = task_.base;
    algo::Extents extents_;
    std::optional<algo::Pipeline> pipeline_;
    sim::Scene scene_;       // a good part of the other seed,
    sim::LightField field_;  // and its light
};

}  // namespace

sim::Scene good_part(const CellChoice& cell, const DesignTask& task, std::uint64_t seed, int k) {
    sim::Scene scene = scene_of(cell, task.part, task.camera);
    const auto index = static_cast<std::uint64_t>(k);
    scene.pose.x_mm += kWobbleMm * sim::random_sign(seed, kPose, 2 * index);
    scene.pose.y_mm += kWobbleMm * sim::random_sign(seed, kPose, 2 * index + 1);
    return scene;
}

sim::Scene spread_part(const CellChoice& cell, const DesignTask& task, int k, int count) {
    sim::Scene scene = scene_of(cell, task.part, task.camera);
    const double pitch = scene.camera.field_mm / scene.camera.extents.m;
    int step = static_cast<int>(std::lround(count / std::numbers::phi));  // from one y to the next
    while (std::gcd(step, count) != 1) ++step;
    scene.pose.x_mm += ((k + 0.5) / count - 0.5) * pitch;
    scene.pose.y_mm += ((k * step % count + 0.5) / count - 0.5) * pitch;
    return scene;
}

Result<void> check_good_part(const CellChoice& cell, const DesignTask& task) {
    const sim::Scene scene = good_part(cell, task, task.seed, 0);
    const auto field = sim::render(scene, {task.threads, {}});
    if (!field) return tl::unexpected(field.error());
    auto measure = FrameValues::create(scene.camera.extents, scene.camera.bits, task.base, JudgedSet{{}, false, true});
    if (!measure) return tl::unexpected(measure.error());
    if (const auto of = measure->of(sim::expose(*field, scene, task.seed).view()); !of)
        return tl::unexpected(of.error());
    return check_fit(*measure, task.base.form);
}

void paste(sim::LightField& whole, const sim::LightField& window, int m, int n) {
    const algo::Extents &to = whole.extents, &from = window.extents;
    const int m0 = m - from.m / 2, n0 = n - from.n / 2;
    const auto bins_a_row = static_cast<std::size_t>(to.i);
    for (int y = 0; y < from.n * from.j; ++y) {
        const int row = n0 * to.j + y;
        if (row < 0 || row >= to.height_px()) continue;
        for (int k = 0; k < from.m; ++k) {
            if (m0 + k < 0 || m0 + k >= to.m) continue;
            const std::size_t source = static_cast<std::size_t>(y) * static_cast<std::size_t>(from.width_px()) +
                static_cast<std::size_t>(k) * bins_a_row;
            const std::size_t target = static_cast<std::size_t>(row) * static_cast<std::size_t>(to.width_px()) +
                static_cast<std::size_t>(m0 + k) * bins_a_row;
            std::copy_n(window.bins.begin() + static_cast<std::ptrdiff_t>(source), bins_a_row,
                        whole.bins.begin() + static_cast<std::ptrdiff_t>(target));
        }
    }
}

Result<WholeCheck> check_whole_parts(const CellChoice& cell, const SetTrial& set, const DesignTask& task,
                                     const PartSurvey& survey, const CheckEffort& effort,
                                     const std::function<void(double)>& progress) {
    return WholeParts(cell, set, task, survey, effort, progress).run();
}

}  // namespace hord::lab
