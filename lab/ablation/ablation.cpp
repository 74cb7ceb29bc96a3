#include "lab/ablation/ablation.h"

#include <algorithm>
#include <array>
#include <cmath>

#include <fmt/format.h>

#include "algo/frame/mask.h"
#include "algo/inspection/pipeline.h"
#include "lab/experiment/inspected_maps.h"
#include "lab/experiment/result_cache.h"
#include "lab/experiment/scenes.h"
#include "lab/optics/effects.h"
#include "lab/optics/truth.h"
#include "lab/report/cpu_time.h"
#include "lab/report/tables.h"
#include "lab/report/template.h"

namespace hord::lab {
namespace {

constexpr double kMatters = 0.1;  // relative change of a contrast, or change of a clean part's score
constexpr double kPlain = 10;     // contrasts are limited to this value: the defect is obvious
constexpr double kLargest = 999;  // of a contrast: a flat part without noise has no texture at all
constexpr const char* kNothing = "nothing";
constexpr std::array<const char*, 3> kFeatures = {"EMD", "Frobenius", "transmission"};

// -- scenes

// A plausible cell with every effect that a scene can name.
sim::Scene with_everything(sim::Scene scene, std::uint64_t seed) {
    scene.seed = seed;
    scene.camera.bits = 12;
    scene.camera.full_bin_dn = 3600;
    scene.camera.array.pitch_um = 1e3 * scene.camera.field_mm / scene.camera.extents.m;
    scene.camera.array.focal_um = scene.camera.array.pitch_um / scene.camera.extents.i / scene.camera.bin_pitch_rad;
    scene.camera.relay.stop_radius_mm = 8;
    scene.camera.relay.lens1_radius_mm = scene.camera.relay.lens2_radius_mm = 22;
    for (const double x : {-6.0, 2.0, 7.0}) scene.camera.dust.push_back({sim::Dust::Plane::lens1, x, x / 2, 0.3, 0});
    scene.light.bandwidth_nm = 20;
    scene.glass = {58, 0.002};
    scene.motion = {500, 0, 100};
    scene.effects = {true, true, true, true};
    scene.noise.electrons_per_dn = 2.5;
    scene.noise.read_e = 3;
    scene.noise.dark_dn = 16;
    scene.noise.dark_e_per_s = 20;
    scene.noise.exposure_ms = 0.1;
    scene.noise.dsnu_e = 1;
    scene.noise.prnu = 0.01;
    scene.noise.full_well_e = 10'500;
    return scene;
}

std::vector<sim::Scene> scenes_of(bool quick, std::uint64_t seed) {
    constexpr int kLenslets = 45;
    std::vector<sim::Scene> scenes;
    const auto add = [&](const char* name, const sim::Part& part, const sim::SceneDefect& defect) {
        if (quick && std::string_view(name) != "inclusion") return;
        sim::Scene scene = lens_scene(kLenslets);
        scene.name = name;
        scene.part = part;
        scene.defects = {defect};
        scene = with_everything(scene, seed);
        scene.effects.crosstalk = false;  // eight times the rendering time
        scenes.push_back(std::move(scene));
    };
    const sim::DoubleConvexLens lens;
    // The first four deflect light by one to four bins, which the EMD and the Jacobian see at this pitch; the last two
    // take it away, which the transmission sees.
    add("inclusion", lens,
        sim::Inclusion{.centre_mm = {2, -3, 0}, .radius_mm = 1.6, .refractive_index = 1.53, .soft = true});
    add("dimple", lens, cut_of_lens(0.05, 15));
    add("stria", sim::CylinderLens{}, sim::Stria{{-3, -4, 0}, {2, 5, 0}, 0.3, 0.01});
    add("wedge", sim::Wedge{.tilt_x_rad = 0.03},
        sim::Inclusion{.centre_mm = {-2, 3, 0}, .radius_mm = 1.6, .refractive_index = 1.53, .soft = true});
    add("bubble", lens, bubble_of_lens(0.5));
    add("absorber", lens, absorber_of_lens(0.5));
    return scenes;
}

std::string describe_effects() {
    return "a stop of 8 mm and lenses of 22 mm radius in a 4f relay of 100 mm; three grains of dust of 0.3 mm on the "
           "first lens; light of 20 nm bandwidth, glass of Abbe number 58 and\n"
           "0.002 / mm absorption; Fresnel losses and ghosts; diffraction at the lenslets; 0.5 m/s during a strobe of "
           "100 us; a 12-bit sensor of 2.5 electrons a DN,\n"
           "9000 electrons in a bin filled by the source, read noise 3, dark current 20 / s, offsets of 1 electron, "
           "PRNU 1 %, full well 10,500, pedestal 16 DN.";
}

// -- measurement

sim::Scene clean_of(sim::Scene scene) {
    scene.defects.clear();
    return scene;
}

struct Lights {
    sim::LightField clean, defect;
    double seconds = 0;  // processor time of both
};
Result<Lights> lights_of(const sim::Scene& scene, int threads) {
    const double begin_ms = process_cpu_ms();
    auto clean = sim::render(clean_of(scene), {threads, {}});
    if (!clean) return tl::unexpected(clean.error());
    auto defect = sim::render(scene, {threads, {}});
    if (!defect) return tl::unexpected(defect.error());
    return Lights{std::move(*clean), std::move(*defect), 1e-3 * (process_cpu_ms() - begin_ms)};
}

struct InspectedPart {
    InspectedMaps maps;
    algo::Verdict verdict;
    double score;
};
Result<InspectedPart> inspect_part(const sim::LightField& light, const sim::Scene& scene) {
    const Frame frame = sim::expose(light, scene, scene.seed);
    auto maps = inspect_frame(frame, scene.camera.extents, 1);
    if (!maps) return tl::unexpected(maps.error());
    auto pipeline = algo::Pipeline::create(scene.camera.extents, frame.bits(), {}, 1);
    if (!pipeline) return tl::unexpected(pipeline.error());
    const auto found = pipeline->inspect(frame.view());
    if (!found) return tl::unexpected(found.error());
    return InspectedPart{std::move(*maps), found->verdict, static_cast<double>(found->score)};
}

// {"contrast": one a feature, "clean": {"verdict", "score"}, "defect": the same, "seconds": rendering time, if
// rendered}
Result<Json> measure(const Lights& lights, const sim::Scene& scene, const TruthDefect& where) {
    const auto clean = inspect_part(lights.clean, scene), defect = inspect_part(lights.defect, scene);
    if (!clean) return tl::unexpected(clean.error());
    if (!defect) return tl::unexpected(defect.error());
    const auto missing = [](const InspectedMaps& maps) {
        std::vector<float> out;
        for (const float t : maps.transmission) out.push_back(std::abs(1 - t));
        return out;
    };
    std::vector<std::uint8_t> light_mask = clean->maps.mask, defect_light_mask = defect->maps.mask;
    for (auto* mask : {&light_mask, &defect_light_mask}) {
        for (std::uint8_t& bits : *mask)
            bits &= algo::kNotJudged | algo::kSaturated;  // a dark lenslet has a transmission
    }
    const auto contrast = [&](std::span<const float> clean_signal, std::span<const std::uint8_t> clean_mask,
                              std::span<const float> signal, std::span<const std::uint8_t> mask, double floor) {
        const Interior clean_part = interior_of(clean_signal, clean_mask);
        return std::min(contrast_of(signal, mask, scene.camera.extents, where, clean_part, floor).ratio, kLargest);
    };
    Json found{{"contrast",
                {contrast(clean->maps.emd, clean->maps.mask, defect->maps.emd, defect->maps.mask, 0),
                 contrast(clean->maps.frobenius, clean->maps.mask, defect->maps.frobenius, defect->maps.mask, 0),
                 contrast(missing(clean->maps), light_mask, missing(defect->maps), defect_light_mask, 0.01)}}};
    for (const auto& [name, one] : {std::pair("clean", &*clean), std::pair("defect", &*defect)})
        found[name] = {{"verdict", name_of(one->verdict)}, {"score", one->score}};
    return found;
}

// -- the grid

// The scene with this effect alone. Ghosts keep the Fresnel losses, since they need the reflected light.
sim::Scene with_only(sim::Scene scene, Effect effect) {
    for (std::size_t k = 0; k < kEffects; ++k) {
        const auto other = static_cast<Effect>(k);
        if (other != effect && !(effect == Effect::ghosts && other == Effect::fresnel))
            scene = without(std::move(scene), other);
    }
    return scene;
}
sim::Scene with_nothing(sim::Scene scene) {
    for (std::size_t k = 0; k < kEffects; ++k) scene = without(std::move(scene), static_cast<Effect>(k));
    return scene;
}

struct Ablated {
    std::string scene;
    std::vector<std::pair<std::string, Json>> rows;  // without effects, then each effect alone

    [[nodiscard]] const Json& nothing() const { return rows.front().second; }
    [[nodiscard]] const Json* with(std::string_view effect) const {
        const auto found = std::ranges::find(rows, effect, [](const auto& row) { return std::string_view(row.first); });
        return found == rows.end() ? nullptr : &found->second;
    }
};

Result<Ablated> ablate(const sim::Scene& scene, const ExperimentOptions& options, ResultCache& cells,
                       const std::function<void(const std::string&)>& starting) {
    const auto truth = truth_of(scene);
    if (truth.defects.empty())
        return fail(ErrorCode::internal, "scene " + scene.name + " has no defect in sight", "report this");
    const TruthDefect& where = truth.defects[0];
    const sim::Scene plain = with_nothing(scene);
    std::optional<Lights> plain_lights;  // rendered on first use; shared by effects of the sensor
    Ablated ablated{scene.name, {}};
    const auto add = [&](const std::string& name, const sim::Scene& changed, bool of_light) -> Result<void> {
        starting(name);
        auto cell = cells.value(scene.name + ": " + name, [&]() -> Result<Json> {
            std::optional<Lights> own;
            std::optional<Lights>& lights = of_light ? own : plain_lights;
            if (!lights) {
                auto rendered = lights_of(of_light ? changed : plain, options.threads);
                if (!rendered) return tl::unexpected(rendered.error());
                lights = std::move(*rendered);
            }
            auto found = measure(*lights, changed, where);
            if (found && (of_light || name == kNothing)) (*found)["seconds"] = lights->seconds;
            return found;
        });
        if (!cell) return tl::unexpected(cell.error());
        ablated.rows.emplace_back(name, std::move(*cell));
        return {};
    };
    if (auto done = add(kNothing, plain, false); !done) return tl::unexpected(done.error());
    for (const Effect effect : effects_of(scene)) {
        if (auto done = add(std::string(name_of(effect)), with_only(scene, effect), !is_of_sensor(effect)); !done)
            return tl::unexpected(done.error());
    }
    return ablated;
}

// -- the report

double contrast_of(const Json& row, std::size_t feature) { return row["contrast"][feature].get<double>(); }
std::string verdict_of(const Json& row, const char* part) { return row[part]["verdict"].get<std::string>(); }
double score_of(const Json& row, const char* part) { return row[part]["score"].get<double>(); }

// Largest relative change of a contrast that is visible in either row, with contrasts limited to kPlain.
double change_of(const Json& nothing, const Json& row) {
    double most = 0;
    for (std::size_t f = 0; f < kFeatures.size(); ++f) {
        const double a = std::min(contrast_of(nothing, f), kPlain), b = std::min(contrast_of(row, f), kPlain);
        if (std::max(a, b) >= kVisible) most = std::max(most, std::abs(b - a) / a);
    }
    return most;
}
bool changes_verdict(const Json& nothing, const Json& row) {
    return verdict_of(nothing, "clean") != verdict_of(row, "clean") ||
        verdict_of(nothing, "defect") != verdict_of(row, "defect");
}
bool matters(const Json& nothing, const Json& row) {
    return change_of(nothing, row) > kMatters ||
        std::abs(score_of(row, "clean") - score_of(nothing, "clean")) > kMatters || changes_verdict(nothing, row);
}

Table table_of(const Ablated& scene) {
    Table table{{"with", "EMD", "Frobenius", "transmission", "clean part: verdict, score",
                 "defective part: verdict, score", "rendering, s", "matters"},
                {}};
    for (const auto& [name, row] : scene.rows) {
        std::vector<std::string> line{name == kNothing ? "(no effect)" : name};
        for (std::size_t f = 0; f < kFeatures.size(); ++f) line.push_back(fmt::format("{:.2f}", contrast_of(row, f)));
        for (const char* part : {"clean", "defect"})
            line.push_back(fmt::format("{}, {:.2f}", verdict_of(row, part), score_of(row, part)));
        line.push_back(row.contains("seconds") ? fmt::format("{:.2f}", row["seconds"].get<double>()) : "");
        line.emplace_back(matters(scene.nothing(), row) ? "yes" : "");
        table.rows.push_back(std::move(line));
    }
    return table;
}

// One effect over all scenes.
struct Summary {
    std::string effect;
    double most = 0;   // largest change of a contrast
    double costs = 0;  // largest ratio of the rendering time with it to that without effects
    std::string matters_in, verdict_in;
};
std::vector<Summary> summaries_of(const std::vector<Ablated>& scenes) {
    std::vector<Summary> all;
    for (std::size_t k = 0; k < kEffects; ++k) {
        Summary s{std::string(name_of(static_cast<Effect>(k))), 0, 0, {}, {}};
        bool named = false;
        for (const Ablated& scene : scenes) {
            const Json* row = scene.with(s.effect);
            if (row == nullptr) continue;
            named = true;
            s.most = std::max(s.most, change_of(scene.nothing(), *row));
            if (matters(scene.nothing(), *row)) s.matters_in += (s.matters_in.empty() ? "" : ", ") + scene.scene;
            if (changes_verdict(scene.nothing(), *row))
                s.verdict_in += (s.verdict_in.empty() ? "" : ", ") + scene.scene;
            if (row->contains("seconds") && scene.nothing().contains("seconds"))
                s.costs = std::max(s.costs, (*row)["seconds"].get<double>() / scene.nothing()["seconds"].get<double>());
        }
        if (named) all.push_back(std::move(s));
    }
    return all;
}

std::vector<Claim> claims_of(const std::vector<Ablated>& scenes, const std::vector<Summary>& summaries) {
    const auto summary = [&](Effect effect) {
        return *std::ranges::find(summaries, name_of(effect), &Summary::effect);
    };
    const auto most = [&](Effect effect) {
        return fmt::format("largest change of a contrast {:.1f} %", 100 * summary(effect).most);
    };
    std::vector<Claim> claims;
    claims.push_back({"Fresnel losses and ghosts matter in no scene",
                      summary(Effect::fresnel).matters_in.empty() && summary(Effect::ghosts).matters_in.empty(),
                      "fresnel: " + most(Effect::fresnel) + "; ghosts: " + most(Effect::ghosts)});
    claims.push_back({"Photon noise matters in some scene", !summary(Effect::photon_noise).matters_in.empty(),
                      most(Effect::photon_noise) + "; in " + summary(Effect::photon_noise).matters_in});
    bool all_found = true, all_pass = true;
    std::string lost, alarmed;
    for (const Ablated& scene : scenes) {
        for (const auto& [name, row] : scene.rows) {
            if (verdict_of(row, "defect") != "reject")
                all_found = false, lost += (lost.empty() ? "" : ", ") + scene.scene + " with " + name;
            if (verdict_of(row, "clean") != "pass")
                all_pass = false, alarmed += (alarmed.empty() ? "" : ", ") + scene.scene + " with " + name;
        }
    }
    claims.push_back({"With any one of the effects, the default recipe rejects every defective part", all_found,
                      all_found ? "all" : "not " + lost});
    claims.push_back({"With any one of the effects, the default recipe passes every clean part", all_pass,
                      all_pass ? "all" : "not " + alarmed});
    return claims;
}

}  // namespace

Result<ExperimentReport> run_ablation(const ExperimentOptions& options) {
    auto cells =
        ResultCache::open(options.out / "cells.jsonl",
                          {{"experiment", "ablation"}, {"quick", options.quick}, {"seed", options.seed}, {"form", 1}});
    if (!cells) return tl::unexpected(cells.error());
    const auto scenes = scenes_of(options.quick, options.seed);
    std::vector<Ablated> ablated;
    double done = 0;
    const double total = static_cast<double>(scenes.size() * (kEffects + 1));
    for (const sim::Scene& scene : scenes) {
        auto one = ablate(scene, options, *cells, [&](const std::string& name) {
            options.progress(std::min(done++ / total, 1.0), scene.name + " with " + name);
        });
        if (!one) return tl::unexpected(one.error());
        ablated.push_back(std::move(*one));
    }
    options.progress(1, "");
    const auto summaries = summaries_of(ablated);

    ExperimentReport report;
    report.claims = claims_of(ablated, summaries);
    Table summary{{"effect", "largest change of a contrast", "matters in", "changes a verdict in",
                   "rendering time, times that without"},
                  {}};
    std::string needed, not_needed;
    for (const Summary& s : summaries) {
        summary.rows.push_back({s.effect, fmt::format("{:.1f} %", 100 * s.most),
                                s.matters_in.empty() ? "-" : s.matters_in, s.verdict_in.empty() ? "-" : s.verdict_in,
                                s.costs > 0 ? fmt::format("{:.1f}", s.costs) : "of the exposure only"});
        std::string& list = s.matters_in.empty() ? not_needed : needed;
        list += (list.empty() ? "" : ", ") + s.effect;
    }
    if (auto written = write_csv(options.out / "ablation.csv", summary); !written)
        return tl::unexpected(written.error());
    report.files.push_back(options.out / "ablation.csv");

    const algo::Extents& e = scenes.front().camera.extents;
    std::string scene_tables;
    for (const Ablated& scene : ablated)
        scene_tables += (scene_tables.empty() ? "## " : "\n## ") + scene.scene + "\n\n" + to_markdown(table_of(scene));
    report.text = fill_report("ablation",
                              {{"quick", options.quick ? "yes" : ""},
                               {"seed", std::to_string(options.seed)},
                               {"m", std::to_string(e.m)},
                               {"n", std::to_string(e.n)},
                               {"effects", describe_effects()},
                               {"visible", fmt::format("{:g}", kVisible)},
                               {"matters_percent", fmt::format("{:.0f}", 100 * kMatters)},
                               {"plain", fmt::format("{:g}", kPlain)},
                               {"matters", fmt::format("{:g}", kMatters)},
                               {"claims", describe(report.claims)},
                               {"summary", to_markdown(summary)},
                               {"needed", needed.empty() ? "none" : needed},
                               {"not_needed", not_needed.empty() ? "none" : not_needed},
                               {"scenes", scene_tables}});
    return report;
}

}  // namespace hord::lab
