// hordctl inspect: judge recorded frames; write maps, pictures and JSON.
#include <algorithm>
#include <chrono>
#include <fstream>
#include <memory>
#include <optional>
#include <set>

#include <fmt/format.h>
#include <fmt/ranges.h>

#include "algo/inspection/pipeline.h"
#include "algo/maps/feature_map.h"
#include "common/assign.h"
#include "firmware/diagnostics/map_images.h"
#include "firmware/diagnostics/verdict_text.h"
#include "firmware/hordctl/commands.h"
#include "firmware/hordctl/frames/frame_reader.h"
#include "firmware/recipes/recipe_file.h"
#include "firmware/recipes/reference_file.h"
#include "firmware/store/results/json_text.h"
#include "firmware/store/results/records.h"

namespace hord::firmware {
namespace {

namespace fs = std::filesystem;
using store::Json;

struct InspectOptions {
    std::vector<std::string> frames;
    FrameOptions reading;
    std::string recipe;
    std::string feature;  // empty: the feature that the recipe judges
    std::string reference;
    std::string out;
    bool json = false;
};

// A map that the inspection computes. Other features need a FeatureMapper.
struct InspectedMap {
    algo::Map algo::Inspection::*map;
    float limit = 0;  // 0: no part is judged by it, and the inspection computes it with MapSet::all only
};

// Empty: the feature needs a FeatureMapper.
std::optional<InspectedMap> inspected_map(const algo::FeatureChoice& choice, const algo::Recipe& recipe) {
    using algo::Feature, algo::Inspection;
    if (choice.against_reference) return std::nullopt;
    if (choice.feature == recipe.gradient) return InspectedMap{&Inspection::gradient, limit_of_gradient(recipe)};
    switch (choice.feature) {
        case Feature::jacobian_frobenius:
            return InspectedMap{&Inspection::frobenius, recipe.slopes ? recipe.frobenius_limit_bins : 0};
        case Feature::jacobian_spectral: return InspectedMap{&Inspection::spectral};
        case Feature::jacobian_nuclear: return InspectedMap{&Inspection::nuclear};
        case Feature::anisotropy: return InspectedMap{&Inspection::anisotropy};
        case Feature::transmission:
            return InspectedMap{&Inspection::transmission, recipe.light ? recipe.transmission_limit : 0};
        default: return std::nullopt;
    }
}

constexpr const char* kZScore = "z-score";

// The feature that is shown by default.
std::string shown_of(const algo::Recipe& recipe) {
    if (recipe.gradient) return std::string(name_of(*recipe.gradient));
    if (recipe.reference) return kZScore;
    return std::string(name_of(recipe.slopes ? algo::Feature::jacobian_frobenius : algo::Feature::transmission));
}

std::string known_features() {
    return fmt::format("{}; the distances also as reference-NAME", fmt::join(algo::kFeatureNames, ", "));
}

// The requested map with the data to show it.
struct FeatureView {
    std::string name;
    std::string unit;
    algo::Map map;
    std::span<const std::uint8_t> mask;
    float limit = 0;  // 0: none
};

std::string unit_for_people(algo::Feature feature) {
    if (feature == algo::Feature::transmission) return "of the typical lenslet";
    const std::string_view unit = algo::unit_of(feature);
    if (!unit.empty()) return std::string(unit);
    return feature == algo::Feature::bhattacharyya ? "-ln of the overlap" : "0 to 1";
}

struct Statistics {
    float p50 = 0, p99 = 0, max = 0;
    std::size_t valid = 0;
};

// Over the lenslets that are judged.
Statistics statistics_of(algo::Map map, std::span<const std::uint8_t> mask) {
    std::vector<float> values;
    for (std::size_t k = 0; k < map.size(); ++k) {
        if ((mask[k] & ~algo::kAtLimit) == algo::kValid) values.push_back(map[k]);
    }
    if (values.empty()) return {};
    std::sort(values.begin(), values.end());
    const auto at = [&](double share) {
        return values[static_cast<std::size_t>(share * static_cast<double>(values.size() - 1))];
    };
    return {at(0.50), at(0.99), values.back(), values.size()};
}

double milliseconds(std::int64_t ns) { return static_cast<double>(ns) / 1e6; }

// What the checks of the whole frame measured.
Json light_json(const algo::Inspection& found) {
    const algo::FrameFindings& f = found.frame;
    Json json{{"dark_dn", found.dark_dn}};
    if (f.dark_measured) {
        json["pedestal_dn"] = f.pedestal_dn;
        json["dark_noise_dn"] = f.dark_noise_dn;
    }
    if (f.spot_measured) {
        json["free"] = f.in_free_light;
        json["offset_bins"] = {f.x_bins, f.y_bins};
        json["spot_bins"] = {f.spot_x_bins, f.spot_y_bins};
        json["second_share"] = f.second_share;
        json["lit_share"] = f.lit_share;
    }
    if (f.period_x > 0 || f.period_y > 0) json["period"] = {f.period_x, f.period_y};
    return json;
}

Json to_json(const std::string& frame, const algo::Extents& extents, const algo::Inspection& found,
             const FeatureView& feature, double bin_rad, const algo::Recipe& recipe) {
    const Statistics s = statistics_of(feature.map, feature.mask);
    Json defects = store::to_json(found.defects);
    for (std::size_t k = 0; k < found.defects.size(); ++k) {
        const algo::Defect& d = found.defects[k];
        Json& defect = defects[k];
        if (recipe.reference) {
            defect["score"] = d.score;
            defect["length"] = d.length;
            defect["width"] = d.width;
        }
        if (recipe.lenslet_mm > 0) {
            const auto from_middle = [&](float at, int count) {
                return (at - 0.5F * static_cast<float>(count - 1)) * recipe.lenslet_mm;
            };
            defect["x_mm"] = from_middle(d.m, extents.m);
            defect["y_mm"] = from_middle(d.n, extents.n);
            defect["area_mm2"] = static_cast<float>(d.area) * recipe.lenslet_mm * recipe.lenslet_mm;
        }
    }
    Json json{{"frame", frame},
              {"grid", {{"m", extents.m}, {"n", extents.n}, {"i", extents.i}, {"j", extents.j}}},
              {"verdict", name_of(found.verdict)},
              {"reason", name_of(found.reason)},
              {"score", found.score},
              {"defects", defects},
              {"light", light_json(found)},
              {"feature",
               {{"name", feature.name},
                {"unit", feature.unit},
                {"p50", s.p50},
                {"p99", s.p99},
                {"max", s.max},
                {"valid", s.valid}}},
              {"ms",
               {{"decode", milliseconds(found.times.decode_ns)},
                {"hord", milliseconds(found.times.hord_ns)},
                {"feature", milliseconds(found.times.feature_ns)},
                {"decide", milliseconds(found.times.decide_ns)},
                {"total", milliseconds(found.times.total_ns)}}}};
    if (recipe.reference) {
        json["explain"] = explain(found, recipe, extents);
        if (found.registered.found()) {
            json["pose"] = {{"x", found.registered.pose.x},
                            {"y", found.registered.pose.y},
                            {"turn_rad", found.registered.pose.turn_rad()},
                            {"light", found.registered.light}};
        }
    }
    if (bin_rad > 0 && (feature.unit == "bin pitches" || feature.unit == "bin pitches a lenslet")) {
        json["feature"]["bin_rad"] = bin_rad;
        json["feature"]["rad"] = {{"p50", s.p50 * bin_rad}, {"p99", s.p99 * bin_rad}, {"max", s.max * bin_rad}};
    }
    return json;
}

void print_for_people(const std::string& frame, const algo::Inspection& found) {
    std::string where;
    for (std::size_t k = 0; k < std::min<std::size_t>(found.defects.size(), 3); ++k) {
        const algo::Defect& d = found.defects[k];
        where += fmt::format("{}({:.1f}, {:.1f}) {} lenslets", where.empty() ? " at " : ", ", d.m, d.n, d.area);
    }
    fmt::print("{:<32} {:<7} {:<14} score {:.2f}, {} defect{}{}\n", frame, name_of(found.verdict),
               name_of(found.reason), found.score, found.defects.size(), found.defects.size() == 1 ? "" : "s", where);
}

Result<void> write_results(const fs::path& out, const std::string& frame, const algo::Extents& extents,
                           const algo::Inspection& found, const FeatureView& feature, const Json& json,
                           const algo::Recipe& recipe) {
    const std::string name = fs::path(frame).stem().string();
    const auto picture = scale_to(fmt::format("{}: {} ({})", name, feature.name, name_of(found.verdict)), feature.unit,
                                  feature.map, feature.mask, feature.limit);
    const bool explained = recipe.reference != nullptr;
    const auto labels = explained ? labels_of(found, recipe) : std::vector<std::string>{};
    const std::string caption = explained ? explain(found, recipe, extents) : std::string{};
    if (auto done = write_float_tiff(out / fmt::format("{}.{}.tiff", name, feature.name), feature.map, extents); !done)
        return done;
    if (auto done = write_png(out / fmt::format("{}.{}.png", name, feature.name),
                              draw(picture, feature.map, feature.mask, extents, found.defects, labels, caption));
        !done) {
        return done;
    }
    const fs::path file = out / (name + ".json");
    std::ofstream stream(file);
    stream << store::to_text(json, 2) << '\n';
    if (!stream.flush())
        return fail(ErrorCode::io, file.string() + " cannot be written",
                    "check that the folder may be written to and has space");
    return {};
}

// Whether the first bytes of a file are those of a reference file (hordctl learn).
bool is_reference(const std::string& file) {
    std::ifstream stream(file, std::ios::binary);
    char magic[7] = {};
    return stream.read(magic, sizeof magic) && std::string_view(magic, sizeof magic) == "HORDREF";
}

std::int64_t steady_ns() {
    return std::chrono::duration_cast<std::chrono::nanoseconds>(std::chrono::steady_clock::now().time_since_epoch())
        .count();
}

class Inspector {
  public:
    explicit Inspector(const InspectOptions& options) : options_(options) {}

    Result<void> prepare() {
        if (auto done = assign(reader_, FrameReader::create(options_.reading)); !done) return done;
        if (!options_.reference.empty() && is_reference(options_.reference)) {
            if (auto done = assign(learned_, read_reference(options_.reference)); !done) return done;
        }
        auto recipe = recipe_or_default(options_.recipe);
        if (!recipe) return tl::unexpected(recipe.error());
        recipe_ = std::move(recipe->recipe);
        if (learned_) recipe_.reference = learned_;
        std::string feature = options_.feature.empty() ? shown_of(recipe_) : options_.feature;
        if (feature == "surprise") {
            fmt::print(stderr, "hordctl: the feature \"surprise\" is called \"{}\" now\n", kZScore);
            feature = kZScore;
        }
        const auto refuse = [](std::string what, std::string cure) {
            return fail(ErrorCode::invalid_argument, std::move(what), std::move(cure));
        };
        const auto choice = algo::feature_named(feature);
        show_z_score_ = !choice && feature == kZScore;
        if (!choice && !show_z_score_)
            return refuse("feature " + feature + " is not known", "use one of " + known_features());
        if (show_z_score_ && !recipe_.reference) {
            return refuse("the z-score is measured against a learned reference",
                          "give --reference REFERENCE (hordctl learn)");
        }
        if (choice) choice_ = *choice;
        if (choice_.against_reference && options_.reference.empty())
            return refuse("feature " + feature + " needs something to compare with", "give --reference FRAME");
        if (!choice_.against_reference && !options_.reference.empty() && !learned_) {
            return refuse("feature " + feature + " does not look at --reference",
                          "ask for reference-" + feature + ", or leave it out");
        }
        if (learned_ && choice_.against_reference) {
            return refuse(
                options_.reference + " is a learned reference, and feature " + feature + " compares with a frame",
                "give a frame, or leave --feature out");
        }
        if (choice_.against_reference) {
            if (auto done = assign(reference_, reader_.read(options_.reference)); !done) return done;
        }
        if (options_.out.empty()) return {};
        std::set<std::string> names;
        for (const std::string& frame : options_.frames) {
            const std::string name = fs::path(frame).stem().string();
            if (!names.insert(name).second) {
                return refuse("two frames named " + name + " would overwrite each other in " + options_.out,
                              "rename one, or inspect them into different folders");
            }
        }
        return make_folder(options_.out);
    }

    Result<algo::Verdict> inspect(const std::string& file) {
        auto frame = reader_.read(file);
        if (!frame) return tl::unexpected(frame.error());
        auto extents = reader_.extents_of(*frame, file);
        if (!extents) return tl::unexpected(extents.error());
        if (!pipeline_ || !(*extents == extents_) || frame->bits() != bits_) {
            if (auto made = set_up(*extents, frame->bits()); !made) return tl::unexpected(about(file, made.error()));
        }
        auto found = pipeline_->inspect(frame->view(), steady_ns);
        if (!found) return tl::unexpected(about(file, found.error()));
        auto feature = view(frame->view(), *found);
        if (!feature) return tl::unexpected(about(file, feature.error()));
        const Json json = to_json(file, extents_, *found, *feature, reader_.bin_rad(), recipe_);
        if (options_.json) {
            fmt::print("{}\n", store::to_text(json));
        } else {
            print_for_people(file, *found);
            if (recipe_.reference) fmt::print("    {}\n", explain(*found, recipe_, extents_));
        }
        if (!options_.out.empty()) {
            if (auto done = write_results(options_.out, file, extents_, *found, *feature, json, recipe_); !done)
                return tl::unexpected(done.error());
        }
        return found->verdict;
    }

  private:
    Result<void> set_up(const algo::Extents& extents, int bits) {
        const auto inspected = show_z_score_ ? std::nullopt : inspected_map(choice_, recipe_);
        const auto maps = inspected && inspected->limit == 0 ? algo::MapSet::all : algo::MapSet::judged;
        auto pipeline = algo::Pipeline::create(extents, bits, recipe_, 1, maps);
        if (!inspected && !show_z_score_) {
            auto mapper =
                algo::FeatureMapper::create(extents, bits, algo::light_levels(recipe_, bits), choice_.feature);
            if (auto done = assign(mapper_, std::move(mapper)); !done) return done;
        }
        if (auto done = assign(pipeline_, std::move(pipeline)); !done) return done;
        extents_ = extents;
        bits_ = bits;
        return {};
    }

    // The map of the requested feature. The time of a FeatureMapper is added to the inspection's.
    Result<FeatureView> view(const FrameView& frame, algo::Inspection& found) {
        if (show_z_score_) {
            FeatureView seen{kZScore, "noises", found.z_score, found.mask, recipe_.reject_score};
            if (found.z_score.empty()) {  // unfit: nothing was compared
                nothing_.assign(found.mask.size(), 0.0F);
                seen.map = nothing_;
            }
            // Rims and lenslets without neighbours are compared, too.
            mask_.resize(found.mask.size());
            for (std::size_t k = 0; k < mask_.size(); ++k)
                mask_[k] = static_cast<std::uint8_t>(found.mask[k] & (algo::kSaturated | algo::kOutside));
            seen.mask = mask_;
            return seen;
        }
        FeatureView result{algo::name_of(choice_), unit_for_people(choice_.feature), {}, found.mask, 0};
        if (const auto inspected = inspected_map(choice_, recipe_)) {
            result.map = found.*inspected->map;
            result.limit = inspected->limit;
            return result;
        }
        const std::int64_t start = steady_ns();
        auto map =
            choice_.against_reference ? mapper_->against(frame, reference_.view()) : mapper_->over_neighbours(frame);
        if (!map)
            return tl::unexpected(choice_.against_reference ? about(options_.reference, map.error()) : map.error());
        const std::int64_t took = steady_ns() - start;
        found.times.feature_ns += took;
        found.times.total_ns += took;
        // Rim and zones come from the inspection; which lenslets can be compared, from the map.
        mask_.assign(map->mask.begin(), map->mask.end());
        for (std::size_t k = 0; k < mask_.size(); ++k)
            mask_[k] = static_cast<std::uint8_t>(mask_[k] | (found.mask[k] & algo::kNotJudged));
        result.map = map->values;
        result.mask = mask_;
        return result;
    }

    const InspectOptions& options_;
    FrameReader reader_;
    std::shared_ptr<const algo::Reference> learned_;  // none: references are frames
    bool show_z_score_ = false;                       // the requested map
    std::vector<float> nothing_;
    algo::FeatureChoice choice_;
    algo::Recipe recipe_;
    Frame reference_;
    std::optional<algo::Pipeline> pipeline_;
    std::optional<algo::FeatureMapper> mapper_;
    std::vector<std::uint8_t> mask_;
    algo::Extents extents_;
    int bits_ = 0;
};

Exit run_inspect(const InspectOptions& options) {
    Inspector inspector(options);
    if (auto ready = inspector.prepare(); !ready) return complain(ready.error());
    bool rejected = false, unfit = false, bad = false;
    for (const std::string& frame : options.frames) {
        const auto verdict = inspector.inspect(frame);
        if (!verdict) {
            complain(verdict.error());
            bad = true;
            continue;
        }
        rejected = rejected || *verdict == algo::Verdict::reject;
        unfit = unfit || *verdict == algo::Verdict::unfit;
    }
    return bad ? Exit::bad_input : rejected ? Exit::rejected : unfit ? Exit::unfit : Exit::good;
}

}  // namespace

void add_inspect(CLI::App& program, Exit& status) {
    auto* command = program.add_subcommand("inspect", "Judge recorded frames");
    auto options = std::make_shared<InspectOptions>();
    command->add_option("FRAME", options->frames, "Frames: 8- or 16-bit grey images")->required();
    add_frame_options(*command, options->reading);
    command->add_option("--recipe", options->recipe, "Limits, masks and zones (TOML); without it the default recipe");
    const auto* feature = command->add_option(
        "--feature", options->feature,
        "Feature whose map and statistics are written; without it, what the recipe judges by (emd). One of " +
            known_features());
    command->add_option("--reference", options->reference,
                        "What hordctl learn has learned: parts are judged against it, and --feature z-score shows "
                        "where they differ. Or a frame of a good part at the same place, for the reference- features");
    command->add_option("--out", options->out, "Folder for NAME.FEATURE.tiff, NAME.FEATURE.png and NAME.json");
    command->add_flag("--json", options->json, "Print one JSON object a frame");
    command->footer(
        "Example: hordctl inspect frames/*.png --macro 9x9 --out maps --json\n"
        "         hordctl inspect part.png --feature reference-chi2 --reference good_part.png --out maps\n"
        "         hordctl inspect part.png --reference lens.hordref --out maps");
    command->callback([options, feature, &status] {
        if (feature->count() == 0 && is_reference(options->reference)) options->feature = kZScore;
        status = run_inspect(*options);
    });
}

}  // namespace hord::firmware
