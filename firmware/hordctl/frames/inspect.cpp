// hordctl inspect: judge recorded frames; write maps, pictures and JSON.
#include <algorithm>
#include <chrono>
#include <fstream>
#include <memory>
#include <optional>

#include <fmt/format.h>
#include <fmt/ranges.h>

#include "algo/inspection/pipeline.h"
#include "algo/maps/feature_map.h"
#include "algo/maps/optical_map.h"
#include "common/assign.h"
#include "common/cli/message.h"
#include "common/file_writing.h"
#include "firmware/diagnostics/feature_views.h"
#include "firmware/diagnostics/inspection_json.h"
#include "firmware/diagnostics/map_files.h"
#include "firmware/diagnostics/map_images.h"
#include "firmware/diagnostics/verdict_text.h"
#include "firmware/hordctl/commands.h"
#include "firmware/hordctl/frames/frame_reader.h"
#include "firmware/recipes/recipe_file.h"
#include "firmware/recipes/reference_file.h"
#include "firmware/store/results/json_text.h"

namespace hord::firmware {
namespace {

namespace fs = std::filesystem;
using store::Json;

struct InspectOptions {
    std::vector<std::string> frames;
    FrameOptions reading;
    std::string recipe;
    std::string feature;  // empty: the one that decided
    std::string reference;
    std::string out;
    bool json = false;
};

std::string known_features() {
    return fmt::format("{}, {}, {}, {}; the distances also as reference-NAME", fmt::join(algo::kFeatureNames, ", "),
                       fmt::join(algo::kOpticalNames, ", "), kZScore, kSums);
}

std::optional<algo::Optical> optical_named(std::string_view name) {
    const auto found = std::ranges::find(algo::kOpticalNames, name);
    if (found == algo::kOpticalNames.end()) return std::nullopt;
    return static_cast<algo::Optical>(found - algo::kOpticalNames.begin());
}

// Null without --grid.
Json calibration_json(const std::optional<CalibrationInUse>& used) {
    if (!used) return {};
    return {{"file", used->file},
            {"camera", used->camera},
            {"date", used->date},
            {"crc32", fmt::format("{:08X}", used->crc32)}};
}

Json to_json(const std::string& frame, const MacroPixelFrame& read, const Json& inspection) {
    Json json{{"schema", inspection["schema"]},
              {"software", inspection["software"]},
              {"frame", frame},
              {"grid", inspection["grid"]},
              {"grid_from", name_of(read.geometry_from)}};
    json.update(inspection);
    return json;
}

// " No sample exceeds 4095: ...", of a frame that cannot be judged; "" else.
std::string bits_hint(const MacroPixelFrame& read, const algo::Inspection& found) {
    if (found.verdict != algo::Verdict::unfit || read.fewer_bits == 0 || found.frame.fewer_bits != 0) return "";
    return fmt::format(" No sample exceeds {}: if the sensor records {} bits, give --bits {}.",
                       (1 << read.fewer_bits) - 1, read.fewer_bits, read.fewer_bits);
}

void print_for_people(const std::string& file, const MacroPixelFrame& read, const algo::Inspection& found,
                      const algo::Recipe& recipe) {
    std::string where;
    for (std::size_t k = 0; k < std::min<std::size_t>(found.defects.size(), 3); ++k) {
        const algo::Defect& d = found.defects[k];
        where += fmt::format("{}({:.1f}, {:.1f}) of {}", where.empty() ? " at " : ", ", d.m, d.n, size_text(d, recipe));
    }
    fmt::print("{:<32} {:<7} {:<14} score {:.2f}, {} defect{}{}\n", file, name_of(found.verdict), name_of(found.reason),
               found.score, found.defects.size(), found.defects.size() == 1 ? "" : "s", where);
    fmt::print("    {}{}\n", explain(found, recipe, read.extents), bits_hint(read, found));
    if (read.geometry_from == GeometryFrom::frame)
        fmt::print("    {}x{} bins a lenslet, as the frame says\n", read.extents.i, read.extents.j);
}

Result<void> write_results(const fs::path& out, const std::string& frame, const algo::Extents& extents,
                           const algo::Inspection& found, const FeatureView& feature, const Json& json,
                           const algo::Recipe& recipe) {
    const std::string name = fs::path(frame).stem().string();
    const auto picture =
        scale_to(fmt::format("{}: {} ({})", name, feature.name, name_of(found.verdict)), feature, recipe);
    const auto map = out / fmt::format("{}.{}", name, feature.name);
    if (auto done = write_float_tiff(map.string() + ".tiff", feature, extents); !done) return done;
    if (auto done = write_mask_png(out / (name + ".mask.png"), feature, extents); !done) return done;
    const auto drawn = draw(picture, feature.map, feature.mask, extents, found.defects, labels_of(found, recipe),
                            explain(found, recipe, extents));
    if (auto done = write_png(map.string() + ".png", drawn); !done) return done;
    const std::string text = store::to_text(json, 2) + '\n';
    return common::write_atomically(out / (name + ".json"),
                                    {reinterpret_cast<const std::uint8_t*>(text.data()), text.size()});
}

// Whether the first bytes of a file are those of a reference file (hordctl learn).
bool is_reference(const std::string& file) {
    std::error_code error;
    if (!std::filesystem::is_regular_file(file, error)) return false;  // a pipe could block
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
        recipe_json_ = {{"file", options_.recipe.empty() ? Json() : Json(options_.recipe)}};
        recipe_json_.update(recipe_json(*recipe));
        recipe_ = std::move(recipe->recipe);
        if (learned_) recipe_.reference = learned_;
        if (auto done = choose_feature(); !done) return done;
        if (options_.out.empty()) return {};
        std::vector<std::string> endings{".mask.png", ".json"};
        for (const std::string& feature : feature_.empty() ? every_feature() : std::vector{feature_})
            endings.insert(endings.end(), {"." + feature + ".tiff", "." + feature + ".png"});
        if (auto fine = check_result_names(options_.frames, options_.out, endings,
                                           {options_.recipe, options_.reference, options_.reading.grid});
            !fine)
            return fine;
        return make_folder(options_.out);
    }

    Result<algo::Verdict> inspect(const std::string& file) {
        auto read = reader_.read(file);
        if (!read) return tl::unexpected(read.error());
        const Frame& frame = read->frame;
        if (!pipeline_ || !(read->extents == extents_) || frame.bits() != bits_) {
            if (auto made = set_up(read->extents, frame.bits()); !made)
                return tl::unexpected(about(file, made.error()));
        }
        auto found = pipeline_->inspect(frame.view(), steady_ns);
        if (!found) return tl::unexpected(about(file, found.error()));
        if (!shows_map()) {
            print_for_people(file, *read, *found, recipe_);
            return found->verdict;
        }
        const FeatureViews views(*found, recipe_, extents_);
        auto feature = view(frame.view(), *found, views);
        if (!feature) return tl::unexpected(about(file, feature.error()));
        Json json = to_json(file, *read,
                            inspection_json(*found, *feature, reader_.bin_rad(), recipe_, recipe_json_, read->extents));
        json["explain"] = json["explain"].get<std::string>() + bits_hint(*read, *found);
        json["calibration"] = calibration_json(reader_.calibration());
        if (options_.json) fmt::print("{}\n", store::to_text(json));
        else print_for_people(file, *read, *found, recipe_);
        if (!options_.out.empty()) {
            if (auto done = write_results(options_.out, file, extents_, *found, *feature, json, recipe_); !done)
                return tl::unexpected(done.error());
        }
        return found->verdict;
    }

  private:
    // Without --feature, --json and --out only the verdict is wanted.
    [[nodiscard]] bool shows_map() const { return options_.json || !options_.out.empty() || !feature_.empty(); }

    // The feature of --feature; without it each frame shows the one that decided. Also reads a frame that is given as
    // --reference.
    Result<void> choose_feature() {
        feature_ = options_.feature;
        if (feature_ == "surprise") {
            print_message("hordctl: the feature \"surprise\" is called \"{}\" now\n", kZScore);
            feature_ = kZScore;
        }
        const auto refuse = [](std::string what, std::string cure) {
            return fail(ErrorCode::invalid_argument, std::move(what), std::move(cure));
        };
        const std::string& reference = options_.reference;
        const bool a_frame = !reference.empty() && !learned_;
        const auto choice = algo::feature_named(feature_);
        optical_ = optical_named(feature_);
        if (optical_ >= algo::Optical::power && !(scale().lenslet_mm > 0 && scale().bin_rad > 0)) {
            return refuse("feature " + feature_ + " needs the width of a lenslet and of a bin",
                          "give a --recipe with [scale] lenslet_mm and bin_rad");
        }
        if (choice) choice_ = *choice;
        else if (optical_) choice_ = {};
        else if (!feature_.empty() && feature_ != kZScore && feature_ != kSums)
            return refuse("feature " + feature_ + " is not known", "use one of " + known_features());
        if (feature_ == kZScore && !recipe_.reference) {
            return refuse("the z-score is measured against a learned reference",
                          "give --reference REFERENCE (hordctl learn)");
        }
        if (choice_.against_reference && reference.empty())
            return refuse("feature " + feature_ + " needs something to compare with", "give --reference FRAME");
        if (choice_.against_reference && learned_) {
            return refuse(reference + " is a learned reference, and feature " + feature_ + " compares with a frame",
                          "give a frame, or leave --feature out");
        }
        if (!a_frame) return {};
        auto read = reader_.read(reference);
        if (!read && read.error().code == ErrorCode::invalid_argument) return tl::unexpected(read.error());
        if (!read) {
            return fail(read.error().code,
                        "--reference " + reference + " is no learned reference, and no frame that can be read (" +
                            read.error().what + ")",
                        "give what hordctl learn wrote, or a frame of a good part; " + read.error().cure);
        }
        if (!choice_.against_reference) {
            const std::string name = algo::feature_named("reference-" + feature_) ? feature_ : "emd";
            return refuse("--reference " + reference + " is a frame, and " +
                              (feature_.empty() ? "no feature that compares with a frame is asked for"
                                                : "feature " + feature_ + " does not look at it"),
                          "ask for --feature reference-" + name + ", or leave --reference out");
        }
        reference_ = std::move(*read);
        return {};
    }

    // A map that was asked for must be exact everywhere. The verdict does without, and so do the numbers of --json:
    // they say where they are bounds.
    [[nodiscard]] algo::MapSet map_set() const {
        if (feature_.empty() && options_.out.empty()) return algo::MapSet::judged;
        const bool cheap = !choice_.against_reference && recipe_.light &&
            choice_.feature == algo::Feature::transmission && !feature_.empty() && feature_ != kZScore;
        return cheap || optical_ || feature_ == kSums ? algo::MapSet::judged : algo::MapSet::all;
    }

    // Whether the feature's map is none of the inspection's.
    [[nodiscard]] bool needs_mapper() const {
        if (!algo::feature_named(feature_)) return false;
        if (choice_.against_reference) return true;
        using algo::Feature;
        switch (choice_.feature) {
            case Feature::jacobian_frobenius:
            case Feature::jacobian_spectral:
            case Feature::jacobian_nuclear:
            case Feature::anisotropy:
            case Feature::transmission: return false;
            default: return choice_.feature != recipe_.gradient;
        }
    }

    Result<void> set_up(const algo::Extents& extents, int bits) {
        if (choice_.against_reference && !(reference_.extents == extents)) {
            return fail(
                ErrorCode::invalid_argument,
                fmt::format("--reference {} has {}x{} lenslets of {}x{} bins, and the frame {}x{} of {}x{}",
                            options_.reference, reference_.extents.m, reference_.extents.n, reference_.extents.i,
                            reference_.extents.j, extents.m, extents.n, extents.i, extents.j),
                "give frames of one camera");
        }
        auto pipeline = algo::Pipeline::create(extents, bits, recipe_, 1, map_set());
        if (needs_mapper()) {
            auto mapper =
                algo::FeatureMapper::create(extents, bits, algo::light_levels(recipe_, bits), choice_.feature);
            if (auto done = assign(mapper_, std::move(mapper)); !done) return done;
        }
        if (auto done = assign(pipeline_, std::move(pipeline)); !done) return done;
        extents_ = extents;
        bits_ = bits;
        return {};
    }

    // The map to show. The time of a FeatureMapper is added to the inspection's.
    Result<FeatureView> view(const FrameView& frame, algo::Inspection& found, const FeatureViews& views) {
        if (feature_.empty()) return views.deciding();
        if (const FeatureView* of_inspection = views.find(feature_)) return *of_inspection;
        if (optical_) return optical_view(frame, found);
        const std::int64_t start = steady_ns();
        auto map = choice_.against_reference ? mapper_->against(frame, reference_.frame.view())
                                             : mapper_->over_neighbours(frame);
        if (!map)
            return tl::unexpected(choice_.against_reference ? about(options_.reference, map.error()) : map.error());
        const std::int64_t took = steady_ns() - start;
        found.times.feature_ns += took;
        found.times.total_ns += took;
        // Rim and zones come from the inspection; which lenslets can be compared, from the map.
        mask_.assign(map->mask.begin(), map->mask.end());
        for (std::size_t k = 0; k < mask_.size(); ++k)
            mask_[k] = static_cast<std::uint8_t>(mask_[k] | (found.mask[k] & algo::kNotJudged));
        FeatureView result{
            .name = feature_, .title = feature_, .unit = unit_for_people(choice_.feature, choice_.against_reference)};
        result.map = map->values;
        result.mask = mask_;
        return result;
    }

    [[nodiscard]] algo::OpticalScale scale() const {
        return {static_cast<double>(recipe_.lenslet_mm),
                recipe_.bin_rad > 0 ? static_cast<double>(recipe_.bin_rad) : reader_.bin_rad()};
    }

    Result<FeatureView> optical_view(const FrameView& frame, const algo::Inspection& found) {
        auto map = algo::optical_map(frame, extents_, bits_, algo::light_levels(recipe_, bits_), *optical_, scale());
        if (!map) return tl::unexpected(map.error());
        optical_map_ = std::move(*map);
        for (std::size_t k = 0; k < found.mask.size(); ++k)
            optical_map_.mask[k] = static_cast<std::uint8_t>(optical_map_.mask[k] | (found.mask[k] & algo::kNotJudged));
        const bool of_power = optical_ >= algo::Optical::power;
        FeatureView result{.name = feature_,
                           .title = feature_,
                           .unit = of_power          ? "dioptres"
                               : scale().bin_rad > 0 ? "mrad"
                                                     : "bin pitches"};
        result.map = optical_map_.values;
        result.mask = optical_map_.mask;
        return result;
    }

    const InspectOptions& options_;
    FrameReader reader_;
    std::shared_ptr<const algo::Reference> learned_;  // none: references are frames
    std::string feature_;                             // empty: the one that decided
    algo::FeatureChoice choice_;
    std::optional<algo::Optical> optical_;  // --feature names one of these
    algo::OpticalMap optical_map_;
    algo::Recipe recipe_;
    Json recipe_json_;
    MacroPixelFrame reference_;
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
    command->add_option("--feature", options->feature,
                        "Feature whose map and statistics are written; without it, for each frame the one that decided "
                        "(of a pass: that comes closest to its limit; of an unfit frame: sums). One of " +
                            known_features());
    command->add_option("--reference", options->reference,
                        "What hordctl learn has learned: parts are judged against it, and --feature z-score shows "
                        "where they differ. Or a frame of a good part at the same place, for the reference- features");
    command->add_option("--out", options->out,
                        "Folder for NAME.FEATURE.tiff (NaN: no value), NAME.mask.png (why), NAME.FEATURE.png and "
                        "NAME.json");
    command->add_flag("--json", options->json, "Print one JSON object a frame");
    command->footer(
        "Example: hordctl inspect frames/*.png --macro 9x9 --out maps --json\n"
        "         hordctl inspect part.png --feature reference-chi2 --reference good_part.png --out maps\n"
        "         hordctl inspect part.png --reference lens.hordref --out maps");
    command->callback([options, &status] { status = run_inspect(*options); });
}

}  // namespace hord::firmware
