// hordctl export and import: light fields and maps to and from the files of other programs.
#include <filesystem>
#include <memory>

#include <fmt/format.h>

#include "algo/inspection/pipeline.h"
#include "algo/maps/feature_map.h"
#include "algo/maps/optical_map.h"
#include "common/file_writing.h"
#include "common/tiff_codec.h"
#include "firmware/diagnostics/feature_views.h"
#include "firmware/diagnostics/inspection_json.h"
#include "firmware/diagnostics/map_files.h"
#include "firmware/exchange/array.h"
#include "firmware/exchange/hdf5_file.h"
#include "firmware/exchange/light_field_import.h"
#include "firmware/hordctl/commands.h"
#include "firmware/hordctl/frames/frame_reader.h"
#include "firmware/recipes/recipe_file.h"
#include "firmware/recipes/reference_file.h"

namespace hord::firmware {
namespace {

namespace fs = std::filesystem;

struct ExportOptions {
    std::vector<std::string> frames, features;
    FrameOptions reading;
    std::string recipe, reference, out, format = "npy";
    bool no_light_field = false;
};

// A map with what is needed to read it, owned: the pipeline's are overwritten.
struct NamedMap {
    std::string name, unit;
    std::vector<float> values;  // NaN: no value
    std::vector<std::uint8_t> mask;
    std::uint8_t no_value = 0, not_judged = 0;
};

template <class T>
Array array_of(ArrayType type, std::vector<std::size_t> shape, const std::vector<T>& values) {
    Array array{type, std::move(shape), {}};
    const auto bytes = std::as_bytes(std::span(values));
    array.bytes.assign(bytes.begin(), bytes.end());
    return array;
}

std::vector<std::size_t> shape_of(const algo::Extents& e) {
    return {static_cast<std::size_t>(e.n), static_cast<std::size_t>(e.m)};
}

// Samples [n, m, j, i].
Array light_field_of(const Frame& frame, const algo::Extents& e) {
    const FrameView view = frame.view();
    const auto size = static_cast<std::size_t>(view.sample_bytes()), columns = static_cast<std::size_t>(e.i);
    Array array{size == 1 ? ArrayType::uint8 : ArrayType::uint16, shape_of(e), {}};
    array.shape.insert(array.shape.end(), {static_cast<std::size_t>(e.j), columns});
    array.bytes.reserve(array.count() * size);
    for (int n = 0; n < e.n; ++n) {
        for (int m = 0; m < e.m; ++m) {
            for (int j = 0; j < e.j; ++j) {
                const std::byte* row = view.data + (n * e.j + j) * view.stride_bytes +
                    static_cast<std::ptrdiff_t>(m) * e.i * view.sample_bytes();
                array.bytes.insert(array.bytes.end(), row, row + columns * size);
            }
        }
    }
    return array;
}

class Exporter {
  public:
    explicit Exporter(const ExportOptions& options) : options_(options) {}

    Result<void> prepare() {
        auto reader = FrameReader::create(options_.reading);
        if (!reader) return tl::unexpected(reader.error());
        reader_ = std::move(*reader);
        auto recipe = recipe_or_default(options_.recipe);
        if (!recipe) return tl::unexpected(recipe.error());
        recipe_json_ = recipe_json(*recipe);
        recipe_ = std::move(recipe->recipe);
        if (!options_.reference.empty()) {
            auto reference = read_reference(options_.reference);
            if (!reference) return tl::unexpected(reference.error());
            recipe_.reference = std::move(*reference);
        }
        for (const std::string& name : options_.features) {
            const auto choice = algo::feature_named(name);
            if (std::ranges::find(algo::kOpticalNames, name) != algo::kOpticalNames.end()) {
                return fail(ErrorCode::invalid_argument, "export does not write the map " + name,
                            "use hordctl inspect FRAME --feature " + name + " --out FOLDER: it writes the map as TIFF");
            }
            if (!choice || choice->against_reference || choice->feature == algo::Feature::transmission) {
                return fail(ErrorCode::invalid_argument, "feature " + name + " is no feature over neighbours",
                            "leave --feature out for the maps of an inspection, or name one such as emd or marginal");
            }
        }
        if (auto fine = check_result_names(options_.frames, options_.out, endings(),
                                           {options_.recipe, options_.reference, options_.reading.grid});
            !fine)
            return fine;
        return make_folder(options_.out);
    }

    // Returns what was written, for people.
    Result<std::string> write(const std::string& file) {
        const auto read = reader_.read(file);
        if (!read) return tl::unexpected(read.error());
        auto pipeline = algo::Pipeline::create(read->extents, read->frame.bits(), recipe_, 1, algo::MapSet::all);
        if (!pipeline) return tl::unexpected(about(file, pipeline.error()));
        const auto found = pipeline->inspect(read->frame.view());
        if (!found) return tl::unexpected(about(file, found.error()));
        const FeatureViews views(*found, recipe_, read->extents);
        std::vector<NamedMap> maps = maps_of(views);
        for (const std::string& name : options_.features) {
            auto map = map_over_neighbours(name, *read);
            if (!map) return tl::unexpected(about(file, map.error()));
            std::erase_if(maps, [&](const NamedMap& one) { return one.name == name; });
            maps.push_back(std::move(*map));
        }
        const fs::path stem = fs::path(options_.out) / fs::path(file).stem();
        if (options_.format == "hdf5") {
            const store::Json json =
                inspection_json(*found, views.deciding(), reader_.bin_rad(), recipe_, recipe_json_, read->extents);
            const std::string to = stem.string() + ".h5";
            return write_one_file(to, *read, maps, file, json).map([&] { return contents(maps) + ": " + to; });
        }
        return write_files(stem.string(), *read, maps).map([&] {
            return fmt::format("{}: {}.*.{}", contents(maps), stem.string(), options_.format);
        });
    }

  private:
    // "a light field and 7 maps with masks".
    [[nodiscard]] std::string contents(const std::vector<NamedMap>& maps) const {
        return fmt::format("{}{} maps with masks", options_.no_light_field ? "" : "a light field and ", maps.size());
    }

    // What follows a frame's name in the names of its files.
    [[nodiscard]] std::vector<std::string> endings() const {
        if (options_.format == "hdf5") return {".h5"};
        const std::string kind = options_.format == "tiff" ? ".tiff" : ".npy";
        std::vector<std::string> all{".light_field" + kind};
        for (const std::string& feature : every_feature()) {
            for (const char* mask : {"", ".mask"}) all.push_back("." + feature + mask + kind);
        }
        return all;
    }

    // Every map of the inspection.
    static std::vector<NamedMap> maps_of(const FeatureViews& views) {
        std::vector<NamedMap> maps;
        const auto add = [&](std::string_view name) {
            const FeatureView* view = views.find(name);
            if (view == nullptr || view->map.empty()) return;
            maps.push_back({view->name,
                            view->unit,
                            with_no_data(view->map, view->mask, view->no_value),
                            {view->mask.begin(), view->mask.end()},
                            view->no_value,
                            view->not_judged});
        };
        for (const std::string_view name : algo::kFeatureNames) add(name);
        add(kZScore);
        add(kSums);
        return maps;
    }

    // Exact, over the whole field: rim and zones are not marked.
    [[nodiscard]] Result<NamedMap> map_over_neighbours(const std::string& name, const MacroPixelFrame& read) const {
        const algo::Feature feature = algo::feature_named(name)->feature;
        const int bits = read.frame.bits();
        auto mapper = algo::FeatureMapper::create(read.extents, bits, algo::light_levels(recipe_, bits), feature);
        if (!mapper) return tl::unexpected(mapper.error());
        const auto map = mapper->over_neighbours(read.frame.view());
        if (!map) return tl::unexpected(map.error());
        return NamedMap{name,
                        unit_for_people(feature),
                        with_no_data(map->values, map->mask, algo::kNoGradient),
                        {map->mask.begin(), map->mask.end()},
                        algo::kNoGradient,
                        algo::kNotJudged};
    }

    static Result<void> save(const std::string& file, const Array& array) {
        return common::write_atomically(file, encode_npy(array));
    }

    // NAME.light_field.npy or .tiff, NAME.FEATURE.npy or .tiff, NAME.FEATURE.mask.npy or .tiff.
    [[nodiscard]] Result<void> write_files(const std::string& stem, const MacroPixelFrame& read,
                                           const std::vector<NamedMap>& maps) const {
        const bool tiff = options_.format == "tiff";
        const algo::Extents& e = read.extents;
        const auto save_grey = [](const std::string& file, const FrameView& view) {
            return common::encode_grey_tiff(view).and_then(
                [&](const auto& bytes) { return common::write_atomically(file, bytes); });
        };
        if (!options_.no_light_field) {
            if (auto done = tiff ? save_grey(stem + ".light_field.tiff", read.frame.view())
                                 : save(stem + ".light_field.npy", light_field_of(read.frame, e));
                !done)
                return done;
        }
        for (const NamedMap& map : maps) {
            const std::string name = stem + "." + map.name;
            const FrameView mask{reinterpret_cast<const std::byte*>(map.mask.data()), e.m, e.n, e.m, 8};
            if (auto done = tiff ? write_float_tiff(name + ".tiff", map.values, e)
                                 : save(name + ".npy", array_of(ArrayType::float32, shape_of(e), map.values));
                !done)
                return done;
            if (auto done = tiff ? save_grey(name + ".mask.tiff", mask)
                                 : save(name + ".mask.npy", array_of(ArrayType::uint8, shape_of(e), map.mask));
                !done)
                return done;
        }
        return {};
    }

    // One HDF5 file: /light_field, /maps/FEATURE, /masks/FEATURE.
    [[nodiscard]] Result<void> write_one_file(const std::string& to, const MacroPixelFrame& read,
                                              const std::vector<NamedMap>& maps, const std::string& file,
                                              const store::Json& json) const {
        const algo::Extents& e = read.extents;
        std::vector<Dataset> datasets;
        if (!options_.no_light_field) {
            datasets.push_back({"/light_field",
                                light_field_of(read.frame, e),
                                {{"axes", "n m j i"}, {"unit", "DN"}, {"bits", fmt::format("{}", read.frame.bits())}}});
        }
        for (const NamedMap& map : maps) {
            const Attributes about{{"axes", "n m"},
                                   {"unit", map.unit},
                                   {"no_value_bits", fmt::format("{}", map.no_value)},
                                   {"not_judged_bits", fmt::format("{}", map.not_judged)}};
            datasets.push_back({"/maps/" + map.name, array_of(ArrayType::float32, shape_of(e), map.values), about});
            datasets.push_back({"/masks/" + map.name, array_of(ArrayType::uint8, shape_of(e), map.mask), {}});
        }
        return write_hdf5(to, datasets,
                          {{"schema", "1"},
                           {"software", "hord-station " HORD_VERSION},
                           {"frame", file},
                           {"inspection", store::to_text(json)}});
    }

    const ExportOptions& options_;
    FrameReader reader_;
    algo::Recipe recipe_;
    store::Json recipe_json_;
};

Exit run_export(const ExportOptions& options) {
    Exporter exporter(options);
    if (auto ready = exporter.prepare(); !ready) return complain(ready.error());
    Exit status = Exit::good;
    for (const std::string& frame : options.frames) {
        const auto written = exporter.write(frame);
        if (written) fmt::print("{}: {}\n", frame, *written);
        else status = complain(written.error());
    }
    return status;
}

Exit run_import(const std::string& from, const std::string& out) {
    const OutputFile output{"--out", out};
    if (auto fine = check_outputs({output}, {from}); !fine) return complain(fine.error());
    if (auto fine = check_extension(output, {".png"}); !fine) return complain(fine.error());
    const auto imported = import_light_field(from);
    if (!imported) return complain(imported.error());
    if (auto done = drivers::write_frame(out, imported->frame.view(), imported->geometry); !done)
        return complain(done.error());
    fmt::print("{}: {}, of {}\n", out, describe(imported->geometry), imported->from);
    return Exit::good;
}

}  // namespace

void add_export(CLI::App& program, Exit& status) {
    auto* command = program.add_subcommand("export", "Write light fields and maps for other programs");
    auto options = std::make_shared<ExportOptions>();
    command->add_option("FRAME", options->frames, "Frames: 8- or 16-bit grey images")->required();
    add_frame_options(*command, options->reading);
    command->add_option("--out", options->out, "Folder for the files")->required();
    command
        ->add_option("--format", options->format,
                     "npy: NAME.light_field.npy [n, m, j, i], NAME.FEATURE.npy [n, m] (NaN: no value) and "
                     "NAME.FEATURE.mask.npy; tiff: the same as images; hdf5: all in NAME.h5")
        ->check(CLI::IsMember({"npy", "tiff", "hdf5"}))
        ->capture_default_str();
    command->add_option(
        "--feature", options->features,
        "Also these features over neighbours, exact over the whole field, without rim and zones, in place of the "
        "inspection's map of the same name (repeatable); maps in dioptres: "
        "hordctl inspect --feature optical-power");
    command->add_option("--recipe", options->recipe, "Limits and zones (TOML); without it the default recipe");
    command->add_option("--reference", options->reference, "What hordctl learn has learned: adds the z-score");
    command->add_flag("--no-light-field", options->no_light_field, "Only the maps");
    command->footer(
        "Exit status: 0 written (whatever the verdict), 2 usage or unreadable input.\n"
        "Example: hordctl export part.png --format hdf5 --feature marginal --out exported");
    command->callback([options, &status] { status = run_export(*options); });
}

void add_import(CLI::App& program, Exit& status) {
    auto* command = program.add_subcommand("import", "Read a light field or a raw frame of another program");
    auto from = std::make_shared<std::string>(), out = std::make_shared<std::string>();
    command
        ->add_option(
            "FILE", *from,
            "LFToolbox's .mat of version 7.3, a folder of PlenoptiCam's viewpoints (J_I.tiff, or .png in grey), "
            "Lytro's .lfp or .lfr (the raw frame), .npy [n, m, j, i], or HDF5 of hordctl export")
        ->required();
    command->add_option("--out", *out, "Frame to write (PNG, with its geometry in a text chunk)")->required();
    command->footer(
        "A Lytro's raw frame is kept as it is, under its colour filters: calibrate and inspect it with --grid.\n"
        "Exit status: 0 written, 2 usage or unreadable input.\n"
        "Example: hordctl import IMG_0001__Decoded.mat --out part.png");
    command->callback([from, out, &status] { status = run_import(*from, *out); });
}

}  // namespace hord::firmware
