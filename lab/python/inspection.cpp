#include "lab/python/inspection.h"

#include <chrono>
#include <map>
#include <mutex>

#include <fmt/format.h>

#include "algo/inspection/pipeline.h"
#include "algo/maps/row_thread_pool.h"
#include "firmware/diagnostics/feature_views.h"
#include "firmware/diagnostics/inspection_json.h"
#include "firmware/diagnostics/verdict_text.h"
#include "lab/python/light_field.h"
#include "lab/python/reference.h"

namespace hord::lab::python {
namespace {

using firmware::store::Json;

py::object to_python(const Json& json) {
    if (json.is_null()) return py::none();
    if (json.is_boolean()) return py::bool_(json.get<bool>());
    if (json.is_number_float()) return py::float_(json.get<double>());
    if (json.is_number_integer()) return py::int_(json.get<std::int64_t>());
    if (json.is_string()) return py::str(json.get<std::string>());
    if (json.is_array()) {
        py::list list;
        for (const Json& one : json) list.append(to_python(one));
        return list;
    }
    py::dict dict;
    for (const auto& [key, value] : json.items()) dict[py::str(key)] = to_python(value);
    return dict;
}

std::int64_t steady_ns() {
    return std::chrono::duration_cast<std::chrono::nanoseconds>(std::chrono::steady_clock::now().time_since_epoch())
        .count();
}

algo::MapSet map_set_of(const std::string& name) {
    if (name == "judged") return algo::MapSet::judged;
    if (name == "exact") return algo::MapSet::exact;
    if (name == "all") return algo::MapSet::all;
    refuse("maps \"" + name + "\" are not known", "use judged, exact or all");
}

struct Inspection {
    std::string verdict, reason, sentence;
    double score = 0;
    bool bounded = false;
    std::string decided_by;
    std::map<std::string, Map> maps;
    Json json;
};

Map map_of(const firmware::FeatureView& view, const algo::Inspection& found, const algo::Extents& extents) {
    Map map{view.name,
            view.unit,
            lenslet_array<float>(view.map, extents),
            lenslet_array<std::uint8_t>(view.mask, extents),
            view.no_value,
            view.not_judged,
            view.limit};
    map.bounds = found.has_bounds && found.compares && view.name == name_of(*found.compares);
    return map;
}

// Inspects frames of one recipe; keeps the pipeline of the last size of frame.
class Inspector {
  public:
    Inspector(const py::object& recipe, const py::object& reference, int threads, const std::string& maps)
        : recipe_(recipe_of(recipe)), judged_by_(firmware::recipe_json(recipe_)), threads_(threads),
          maps_(map_set_of(maps)) {
        constexpr int kMax = algo::RowThreadPool::kMaxThreads;
        if (threads < 1 || threads > kMax)
            refuse(fmt::format("threads={} is not possible", threads), fmt::format("use 1 to {}", kMax));
        if (!reference.is_none()) {
            recipe_.recipe.reference = reference_of(reference);
            recipe_.reference_file.clear();
        }
    }

    Inspection inspect(const py::object& frame, const py::object& bins, const py::object& grid, int bits) {
        const LightField field = field_of(frame, bins, grid, bits);
        Inspection out;
        const algo::Inspection* found = nullptr;
        std::unique_lock lock(mutex_, std::defer_lock);
        std::optional<algo::Inspection> result;
        without_gil([&] {
            lock.lock();
            check_samples(field.frame.view);
            const int depth = field.frame.view.bits;
            if (!pipeline_ || !(extents_ == field.extents) || bits_ != depth) {
                pipeline_.reset();
                pipeline_.emplace(
                    unwrap(algo::Pipeline::create(field.extents, depth, recipe_.recipe, threads_, maps_)));
                extents_ = field.extents;
                bits_ = depth;
            }
            result = unwrap(pipeline_->inspect(field.frame.view, steady_ns));
            found = &*result;
        });
        // The maps are copied under the lock: the next frame overwrites them.
        const firmware::FeatureViews views(*found, recipe_.recipe, extents_);
        const firmware::FeatureView& deciding = views.deciding();
        out.verdict = name_of(found->verdict);
        out.reason = name_of(found->reason);
        out.score = static_cast<double>(found->score);
        out.bounded = found->bounded;
        out.sentence = firmware::explain(*found, recipe_.recipe, extents_);
        out.decided_by = deciding.name;
        out.json = firmware::inspection_json(*found, deciding, field.bin_rad, recipe_.recipe, judged_by_, extents_);
        const auto add = [&](std::string_view name) {
            if (const firmware::FeatureView* view = views.find(name); view != nullptr && !view->map.empty())
                out.maps.insert_or_assign(std::string(name), map_of(*view, *found, extents_));
        };
        for (const std::string_view name : algo::kFeatureNames) add(name);
        add(firmware::kZScore);
        add(firmware::kSums);
        return out;
    }

    [[nodiscard]] Recipe recipe() const { return {recipe_}; }

  private:
    firmware::NumberedRecipe recipe_;
    Json judged_by_;  // without a reference that was given beside the recipe
    int threads_;
    algo::MapSet maps_;
    std::mutex mutex_;
    std::optional<algo::Pipeline> pipeline_;
    algo::Extents extents_;
    int bits_ = 0;
};

Inspection inspect(const py::object& frame, const py::object& recipe, const py::object& reference,
                   const py::object& bins, const py::object& grid, int bits, int threads, const std::string& maps) {
    return Inspector(recipe, reference, threads, maps).inspect(frame, bins, grid, bits);
}

void add_recipe_class(py::module_& module) {
    py::class_<Recipe>(module, "Recipe",
                       "What is tolerated on a part: features, limits, zones. Recipe() is the default one.")
        .def(py::init([] { return Recipe{recipe_of(py::none())}; }))
        .def_static(
            "load",
            [](const File& file) {
                return without_gil([&] { return Recipe{unwrap(firmware::load_numbered_recipe(file))}; });
            },
            py::arg("file"), "Reads a recipe file (TOML). Raises InvalidArgument with all problems, NotFound.")
        .def_static(
            "parse",
            [](const std::string& text, const std::string& name) {
                return Recipe{unwrap(firmware::parse_numbered_recipe(text, name))};
            },
            py::arg("text"), py::arg("name") = "recipe", "A recipe from TOML text. Raises InvalidArgument.")
        .def_property_readonly(
            "name", [](const Recipe& r) { return r.numbered.recipe.name; }, "Name of the recipe.")
        .def_property_readonly(
            "number", [](const Recipe& r) { return r.numbered.number; }, "By which a PLC selects it.")
        .def_property_readonly(
            "version", [](const Recipe& r) { return r.numbered.version; }, "Raised by whoever changes the recipe.")
        .def_property_readonly(
            "crc32", [](const Recipe& r) { return fmt::format("{:08X}", crc32_of(r.numbered)); },
            "Of the content, 8 hexadecimal digits, as hordctl says it.")
        .def(
            "toml", [](const Recipe& r) { return format_recipe(r.numbered); }, "The text of its file.")
        .def("__repr__", [](const Recipe& r) {
            return fmt::format("<hord.Recipe {} \"{}\" version {}>", r.numbered.number, r.numbered.recipe.name,
                               r.numbered.version);
        });
}

}  // namespace

py::array_t<float> Map::filled() const {
    py::array_t<float> out({values.shape(0), values.shape(1)});
    const std::size_t count = static_cast<std::size_t>(values.size());
    const auto filled = firmware::with_no_data({values.data(), count}, {mask.data(), count}, no_value);
    std::copy(filled.begin(), filled.end(), out.mutable_data());
    return out;
}

firmware::NumberedRecipe recipe_of(const py::object& recipe) {
    if (py::isinstance<Recipe>(recipe)) return recipe.cast<Recipe>().numbered;
    const std::filesystem::path file =
        recipe.is_none() ? std::filesystem::path() : path_of(recipe, "a recipe is a Recipe or the path of its file");
    return without_gil([&] { return unwrap(firmware::recipe_or_default(file)); });
}

void add_inspection(py::module_& module) {
    add_recipe_class(module);
    py::class_<Map>(module, "Map", "One value a lenslet of a feature.")
        .def_readonly("name", &Map::name, "Name of the feature.")
        .def_readonly("unit", &Map::unit, "Unit of the values, for people.")
        .def_readonly("values", &Map::values, "float32 [n, m]; finite, 0 where there is no value.")
        .def_readonly("mask", &Map::mask, "uint8 [n, m]: bits DARK, SATURATED, BORDER, RIM, OUTSIDE, AT_LIMIT.")
        .def_property_readonly(
            "valid", [](const Map& m) { return m.mask.attr("__and__")(m.no_value).attr("__eq__")(0); },
            "bool [n, m]: lenslets with a value.")
        .def_property_readonly(
            "judged", [](const Map& m) { return m.mask.attr("__and__")(m.no_value | m.not_judged).attr("__eq__")(0); },
            "bool [n, m]: lenslets with a value that is judged (not rim, not outside).")
        .def_property_readonly("filled", &Map::filled,
                               "float32 [n, m]: NaN where there is no value, as in the TIFF of hordctl inspect.")
        .def_readonly("limit", &Map::limit, "The value that rejects; 0: nothing is judged by it.")
        .def_readonly("bounds", &Map::bounds,
                      "Whether some values are upper bounds: the verdict did not need them (maps=\"judged\").")
        .def("__repr__", [](const Map& m) {
            return fmt::format("<hord.Map {} {}x{} lenslets, {}>", m.name, m.values.shape(1), m.values.shape(0),
                               m.unit.empty() ? "no unit" : m.unit);
        });
    py::class_<Inspection>(module, "Inspection", "The verdict of a frame, as hordctl inspect gives it.")
        .def_readonly("verdict", &Inspection::verdict, "\"pass\", \"reject\" or \"unfit\".")
        .def_readonly("reason", &Inspection::reason, "Name of the reason; \"none\" for a pass.")
        .def_readonly("score", &Inspection::score, "The worst value over its limit: 1 and above rejects.")
        .def_readonly("explain", &Inspection::sentence, "One sentence for people.")
        .def_readonly("bounded", &Inspection::bounded,
                      "A limit of work was reached: score and peaks may be upper bounds.")
        .def_readonly("decided_by", &Inspection::decided_by, "Name of the map that decided.")
        .def_readonly("maps", &Inspection::maps,
                      "Map by name: those that the recipe judges, and sums; all with maps=\"all\".")
        .def_property_readonly(
            "defects", [](const Inspection& i) { return to_python(i.json.at("defects")); },
            "A dict a defect, largest peak first: m, n (lenslets), area (lenslets), peak, kind; with a reference "
            "score, "
            "length, width, radius; x_mm, y_mm, area_mm2 and radius_mm if the recipe has lenslet_mm.")
        .def(
            "to_dict", [](const Inspection& i) { return to_python(i.json); },
            "The object of hordctl inspect --json, without what it says of files: frame, grid_from, calibration and "
            "the "
            "recipe's file.")
        .def("__repr__", [](const Inspection& i) {
            return fmt::format("<hord.Inspection {} {} score {:.2f}>", i.verdict, i.reason, i.score);
        });
    py::class_<Inspector>(module, "Inspector", R"(Inspects frames by one recipe. Faster than inspect() for many frames.

A second thread that calls it waits; give each thread an Inspector of its own.)")
        .def(py::init<const py::object&, const py::object&, int, const std::string&>(), py::arg("recipe") = py::none(),
             py::arg("reference") = py::none(), py::arg("threads") = 1, py::arg("maps") = "judged")
        .def("inspect", &Inspector::inspect, py::arg("frame"), py::arg("bins") = py::none(),
             py::arg("grid") = py::none(), py::arg("bits") = 0,
             "Inspects a LightField, an array or a file. Arguments and errors as of inspect().")
        .def_property_readonly("recipe", &Inspector::recipe, "The recipe in use.");
    module.def("inspect", &inspect, py::arg("frame"), py::arg("recipe") = py::none(), py::arg("reference") = py::none(),
               py::arg("bins") = py::none(), py::arg("grid") = py::none(), py::arg("bits") = 0, py::arg("threads") = 1,
               py::arg("maps") = "judged", R"(The verdict of a frame: the same, to the bit, as hordctl inspect.

frame: a LightField, an array (see decode) or a file (see read); bins, grid and bits are theirs.
recipe: a Recipe or its file; None: the default recipe. reference: a Reference or its file.
threads: 1 to 64, the calling one included. maps: "judged" (what the verdict needs; the EMD is bounded elsewhere),
"exact", or "all" (also the other maps of the Jacobian). Releases the GIL.

Raises InvalidArgument: a recipe or reference that does not fit the frame; and as decode() and read() do.)");
}

}  // namespace hord::lab::python
