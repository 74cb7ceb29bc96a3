#include "lab/python/reference.h"

#include <algorithm>
#include <cmath>

#include <fmt/format.h>

#include "algo/good_parts/distinct_parts.h"
#include "algo/inspection/pipeline.h"
#include "algo/reference/read_noise.h"
#include "algo/reference/reference_comparison.h"
#include "algo/reference/reference_learner.h"
#include "firmware/recipes/reference_file.h"
#include "lab/python/inspection.h"
#include "lab/python/light_field.h"

namespace hord::lab::python {
namespace {

struct LearnedParts {
    ReferenceHandle reference;
    std::vector<std::pair<std::size_t, std::string>> left_out;
    std::vector<std::optional<algo::Pose>> poses;
};

Frame copy_of(const FrameView& view) {
    Frame copy(view.width_px, view.height_px, view.bits);
    const std::size_t line = static_cast<std::size_t>(view.width_px) * static_cast<std::size_t>(view.sample_bytes());
    for (int y = 0; y < view.height_px; ++y) {
        const auto row = std::span(view.data + y * view.stride_bytes, line);
        std::copy(row.begin(), row.end(), copy.bytes().subspan(static_cast<std::size_t>(y) * line).begin());
    }
    return copy;
}

// The frames as a list: a generator would be at its end after the first reading. One frame, or a path, is refused: its
// letters or rows would be taken as frames.
py::list list_of(const py::object& frames) {
    const bool one = may_be_path(frames) || py::isinstance<LightField>(frames) ||
        (py::isinstance<py::array>(frames) && frames.cast<py::array>().ndim() < 3);
    if (one || !py::hasattr(frames, "__iter__")) {
        const auto type = py::str(py::type::of(frames).attr("__name__")).cast<std::string>();
        throw py::type_error(
            fmt::format("hord.learn: frames is a list of LightFields, arrays or files, not {}: give for "
                        "example sorted(glob.glob(\"good/*.png\"))",
                        type));
    }
    return py::list(frames);
}

// Refuses a number that hordctl learn would refuse: "read_dn=nan is not possible".
void check_number(const char* name, std::optional<float> value, double low, double high) {
    if (value && !(static_cast<double>(*value) >= low && static_cast<double>(*value) <= high))
        refuse(fmt::format("{}={} is not possible", name, *value), fmt::format("give {} to {}", low, high));
}

LearnedParts learn(const py::object& given, const py::object& recipe, std::optional<float> electrons_per_dn,
                   std::optional<float> read_dn, float pedestal_dn, const py::object& bins, const py::object& grid,
                   int bits, int threads) {
    check_number("electrons_per_dn", electrons_per_dn, 1e-3, 1e5);
    check_number("read_dn", read_dn, 0, 1e4);
    check_number("pedestal_dn", pedestal_dn, 0, 65535);
    const py::list frames = list_of(given);
    if (py::len(frames) == 0) refuse("there is no frame to learn from", "give frames of at least 8 good parts");
    const auto field = [&](std::size_t part) { return field_of(frames[part], bins, grid, bits); };
    const LightField first = field(0);
    const int depth = first.frame.view.bits;
    const firmware::NumberedRecipe used = recipe_of(recipe);
    const std::size_t count = py::len(frames);
    const auto frame_of_part = [&](std::size_t part) -> Result<Frame> {
        // What the list holds is Python's: an array, or a file that is read. It is let go before the GIL is.
        const py::gil_scoped_acquire held;
        try {
            const LightField one = field(part);
            if (one.is_like(first)) return copy_of(one.frame.view);
        } catch (const Failure& failure) {
            return tl::unexpected(failure.error);
        }
        return fail(ErrorCode::invalid_argument, fmt::format("frame {} is not of the size and depth of frame 0", part),
                    "give frames of one camera");
    };
    LearnedParts out;
    without_gil([&] {
        algo::LearnOptions options;
        options.levels = algo::light_levels(used.recipe, depth);
        options.max_dark_rise_dn = used.recipe.max_dark_rise_dn;
        options.dark_from_noise = used.recipe.dark_dn == 0;
        options.electrons_per_dn = electrons_per_dn;
        options.pedestal_dn = pedestal_dn;
        options.threads = threads;
        options.read_dn =
            read_dn ? *read_dn : unwrap(algo::read_noise_of(first.extents, options.levels, count, frame_of_part));
        const algo::PartsToLearn parts = unwrap(algo::parts_to_learn(first.extents, count, frame_of_part, options));
        auto learned = unwrap(algo::learn_reference(
            first.extents, depth, parts.frames.size(),
            [&](std::size_t part) { return frame_of_part(parts.frames[part]); }, options));
        out.reference.reference = std::make_shared<const algo::Reference>(std::move(learned.reference));
        out.poses.resize(count);
        std::vector<bool> learned_from(count, false);
        for (std::size_t k = 0; k < parts.frames.size(); ++k) {
            learned_from[parts.frames[k]] = true;
            out.poses[parts.frames[k]] = learned.poses[k];
        }
        for (const algo::LeftOut& one : learned.left_out) out.left_out.emplace_back(parts.frames[one.part], one.why);
        for (std::size_t k = 0; k < count; ++k) {
            if (!learned_from[k]) out.left_out.emplace_back(k, "it shows the same part as an earlier frame");
        }
        std::ranges::sort(out.left_out);
    });
    return out;
}

py::object pose_dict(const algo::Pose& pose) {
    using namespace py::literals;
    return py::dict("x"_a = pose.x, "y"_a = pose.y, "turn_rad"_a = pose.turn_rad());
}

// A read-only view of one value a lenslet, in the reference's memory.
template <class T>
py::array view_of(const ReferenceHandle& handle, const std::vector<T>& values) {
    const algo::Extents& e = handle.reference->extents;
    auto* owner = new std::shared_ptr<const algo::Reference>(handle.reference);
    const py::capsule kept(owner, [](void* p) { delete static_cast<std::shared_ptr<const algo::Reference>*>(p); });
    return read_only(py::array_t<T>({e.n, e.m}, values.data(), kept));
}

// Shares of the light [n, m, j, i], 0..1.
py::array_t<float> hords(const ReferenceHandle& handle) {
    const algo::Reference& r = *handle.reference;
    const algo::Extents& e = r.extents;
    py::array_t<float> out({e.n, e.m, e.j, e.i});
    float* to = out.mutable_data();
    for (std::size_t k = 0; k < e.lenslets(); ++k) {
        for (int j = 0; j < e.j; ++j) {
            for (int i = 0; i < e.i; ++i)
                *to++ = static_cast<float>(r.shares[k * r.stride() + r.place(i, j)]) / (1U << r.kShareBits);
        }
    }
    return out;
}

// What a part shows beside the reference, one value a lenslet.
struct Comparison {
    bool found = false;
    std::string outcome;
    algo::Registered registered;
    py::array_t<float> light, x, y, scattering, shape, scores;
    py::array_t<std::uint8_t> mask;
    py::array_t<bool> has_light, has_hord;
};

Comparison compare(const py::object& frame, const py::object& reference, const py::object& recipe,
                   const py::object& bins, const py::object& grid, int bits) {
    const LightField field = field_of(frame, bins, grid, bits);
    firmware::NumberedRecipe used = recipe_of(recipe);
    used.recipe.reference = reference_of(reference);
    const algo::Reference& good = *used.recipe.reference;
    const algo::Extents& e = field.extents;
    std::vector<algo::Difference> differences(e.lenslets());
    std::vector<std::uint8_t> mask;
    Comparison out;
    without_gil([&] {
        check_samples(field.frame.view);
        auto pipeline = unwrap(algo::Pipeline::create(e, field.frame.view.bits, used.recipe, 1, algo::MapSet::all));
        const auto found = unwrap(pipeline.inspect(field.frame.view));
        mask.assign(found.mask.begin(), found.mask.end());
        out.registered = found.registered;
        out.found = found.registered.found();
        out.outcome = algo::explain(found.registered.outcome);
        if (!out.found) return;
        const algo::PoseMap pose(found.registered.pose, e);
        algo::ReferenceComparer comparer(good);
        const auto columns = static_cast<std::size_t>(e.m);
        for (int n = 0; n < e.n; ++n) {
            const std::size_t first = e.index(0, n);
            comparer.compare_row(field.frame.view, found.sums.subspan(first, columns),
                                 std::span<const std::uint8_t>(mask).subspan(first, columns), n, pose,
                                 found.registered.light, found.dark_dn, std::span(differences).subspan(first, columns));
        }
    });
    const auto map = [&](auto value) {
        using T = decltype(value(differences.front()));
        py::array_t<T> values({e.n, e.m});
        std::transform(differences.begin(), differences.end(), values.mutable_data(), value);
        return values;
    };
    using algo::Difference;
    constexpr float kNone = std::numeric_limits<float>::quiet_NaN();
    out.mask = lenslet_array<std::uint8_t>(mask, e);
    out.has_light = map([](const Difference& d) { return d.has_light; });
    out.has_hord = map([](const Difference& d) { return d.has_hord; });
    out.light = map([](const Difference& d) { return d.has_light ? d.light : kNone; });
    out.x = map([](const Difference& d) { return d.has_hord ? d.x : kNone; });
    out.y = map([](const Difference& d) { return d.has_hord ? d.y : kNone; });
    out.scattering = map([](const Difference& d) { return d.has_hord ? d.scattering : kNone; });
    out.shape = map([](const Difference& d) { return d.has_hord ? d.chi2 / d.degrees : kNone; });
    out.scores = py::array_t<float>({static_cast<int>(algo::kDeviations), e.n, e.m});
    auto scores = out.scores.mutable_unchecked<3>();
    for (int n = 0; n < e.n; ++n) {
        for (int m = 0; m < e.m; ++m) {
            const Difference& d = differences[e.index(m, n)];
            const algo::Scores of = d.has_light ? algo::scores_of(d, good) : algo::Scores{};
            for (std::size_t k = 0; k < algo::kDeviations; ++k) scores(static_cast<py::ssize_t>(k), n, m) = of[k];
        }
    }
    return out;
}

void add_reference_class(py::module_& module) {
    using H = ReferenceHandle;
    const auto at = [](auto member) { return [member](const H& h) { return view_of(h, (*h.reference).*member); }; };
    py::class_<H>(module, "Reference",
                  "Good parts, learned: light, HORD and spread of every lenslet. Arrays are read-only views.")
        .def_static(
            "load",
            [](const File& file) { return without_gil([&] { return H{unwrap(firmware::read_reference(file))}; }); },
            py::arg("file"), "Reads what hordctl learn or save() wrote. Raises NotFound, Unreadable, Unsupported.")
        .def(
            "save",
            [](const H& h, const File& file) {
                without_gil([&] { unwrap(firmware::write_reference(file, *h.reference)); });
            },
            py::arg("file"),
            "Writes the file that hordctl --reference and recipes name. Raises NotFound, Refused or "
            "IoError.")
        .def_property_readonly(
            "shape",
            [](const H& h) {
                const algo::Extents& e = h.reference->extents;
                return py::make_tuple(e.n, e.m, e.j, e.i);
            },
            "(N, M, J, I).")
        .def_property_readonly(
            "bits", [](const H& h) { return h.reference->bits; }, "Of the samples learned from.")
        .def_property_readonly(
            "parts", [](const H& h) { return h.reference->parts; }, "Number of parts learned from.")
        .def_property_readonly(
            "electrons_per_dn", [](const H& h) { return h.reference->sensor.electrons_per_dn; }, "Of the sensor.")
        .def_property_readonly(
            "read_dn", [](const H& h) { return h.reference->sensor.read_dn; }, "Read noise of the sensor, DN.")
        .def_property_readonly("light", at(&algo::Reference::light), "float32 [n, m], DN: the typical part's sums.")
        .def_property_readonly("x", at(&algo::Reference::x),
                               "float32 [n, m]: mean deflection to the right, bin pitches.")
        .def_property_readonly("y", at(&algo::Reference::y), "float32 [n, m]: mean deflection downwards, bin pitches.")
        .def_property_readonly("mask", at(&algo::Reference::mask),
                               "uint8 [n, m]: DARK: no reference HORD; OUTSIDE: too few parts show this lenslet.")
        .def("hords", &hords, "float32 [n, m, j, i]: reference HORDs, shares of the light, 0 to 1. A copy.")
        .def("__repr__", [](const H& h) {
            const algo::Extents& e = h.reference->extents;
            return fmt::format("<hord.Reference {}x{} lenslets of {}x{} bins, {} parts>", e.m, e.n, e.i, e.j,
                               h.reference->parts);
        });
}

}  // namespace

std::shared_ptr<const algo::Reference> reference_of(const py::object& reference) {
    if (py::isinstance<ReferenceHandle>(reference)) return reference.cast<ReferenceHandle>().reference;
    const auto file = path_of(reference, "a reference is a Reference or the path of its file");
    return without_gil([&] { return unwrap(firmware::read_reference(file)); });
}

void add_reference(py::module_& module) {
    add_reference_class(module);
    py::class_<LearnedParts>(module, "Learned", "What learn() returns.")
        .def_readonly("reference", &LearnedParts::reference, "The Reference.")
        .def_readonly("left_out", &LearnedParts::left_out, "(index, why) of the frames that were left out.")
        .def_property_readonly(
            "poses",
            [](const LearnedParts& l) {
                py::list poses;
                for (const auto& pose : l.poses) poses.append(pose ? pose_dict(*pose) : py::none());
                return poses;
            },
            "A dict a frame: x, y (lenslets), turn_rad, relative to the reference; None if left out.");
    module.def("learn", &learn, py::arg("frames"), py::arg("recipe") = py::none(),
               py::arg("electrons_per_dn") = py::none(), py::arg("read_dn") = py::none(), py::arg("pedestal_dn") = 0.0F,
               py::arg("bins") = py::none(), py::arg("grid") = py::none(), py::arg("bits") = 0, py::arg("threads") = 1,
               R"(A reference from frames of at least 8 good parts: the same, to the bit, as hordctl learn makes.

frames: a list of LightFields, arrays or files (any iterable). Each is read several times.
recipe: its light levels are used. electrons_per_dn, read_dn: of the sensor; None: estimated from the frames.
pedestal_dn: what the camera adds to every sample, DN. bins, grid, bits: as of decode(). Releases the GIL.

A part counts once: left_out names the frames that repeat one.
Raises InvalidArgument: frames that differ in size or depth, fewer than 8 distinct parts left; and as decode() and read() do.)");
    py::class_<Comparison>(module, "Comparison", "A part beside the reference. NaN: nothing to compare.")
        .def_readonly("found", &Comparison::found, "Whether the part was registered; if not, all values are NaN.")
        .def_readonly("outcome", &Comparison::outcome, "One sentence on the registration.")
        .def_property_readonly(
            "pose",
            [](const Comparison& c) -> py::object { return c.found ? pose_dict(c.registered.pose) : py::none(); },
            "x, y (lenslets), turn_rad, relative to the reference: a dict; None if not found.")
        .def_property_readonly(
            "light_ratio", [](const Comparison& c) { return c.registered.light; },
            "The part's light over the reference's.")
        .def_readonly("light", &Comparison::light, "float32 [n, m]: light over the expected light, minus 1.")
        .def_readonly("x", &Comparison::x, "float32 [n, m]: shift of the mean deflection to the right, bin pitches.")
        .def_readonly("y", &Comparison::y, "float32 [n, m]: the same downwards.")
        .def_readonly("scattering", &Comparison::scattering,
                      "float32 [n, m]: share of the light that is scattered by about a bin.")
        .def_readonly("shape", &Comparison::shape, "float32 [n, m]: chi-square of the rest over its expectation.")
        .def_readonly("scores", &Comparison::scores,
                      "float32 [4, n, m]: z-scores of light, shift, scattering, shape; 0 where nothing is compared.")
        .def_readonly("mask", &Comparison::mask, "uint8 [n, m], as of an inspection.")
        .def_readonly("has_light", &Comparison::has_light, "bool [n, m]: light is compared.")
        .def_readonly("has_hord", &Comparison::has_hord, "bool [n, m]: the others are compared.");
    module.def("compare", &compare, py::arg("frame"), py::arg("reference"), py::arg("recipe") = py::none(),
               py::arg("bins") = py::none(), py::arg("grid") = py::none(), py::arg("bits") = 0,
               R"(What a part shows beside a reference, lenslet by lenslet: the differences that a verdict is made of.

frame: a LightField, an array or a file. reference: a Reference or its file. recipe: its light levels and checks.
Releases the GIL. Raises as inspect() does.)");
}

}  // namespace hord::lab::python
