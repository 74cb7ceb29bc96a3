#include <algorithm>
#include <cmath>
#include <span>

#include <fmt/format.h>

#include "algo/features/deflection.h"
#include "algo/features/distance.h"
#include "algo/features/feature.h"
#include "algo/features/transmission.h"
#include "algo/maps/feature_map.h"
#include "firmware/diagnostics/feature_views.h"
#include "lab/python/inspection.h"
#include "lab/python/light_field.h"

namespace hord::lab::python {
namespace {

using DarkLevel = std::optional<std::uint32_t>;  // DN; none: the recipe's

// The HORDs of a light field: masses, sums, mean deflections.
struct Hords {
    py::array_t<std::uint16_t> masses;
    py::array_t<std::uint32_t> sums;
    py::array_t<std::uint8_t> mask;
    py::array_t<double> x, y;
};

// decode_row() over all rows; the masses only if `with_masses`.
Hords decode_hords(const LightField& field, const py::object& recipe, DarkLevel dark_dn, bool with_masses) {
    const algo::Extents& e = field.extents;
    algo::LightLevels levels = light_levels(recipe_of(recipe).recipe, field.frame.view.bits);
    if (dark_dn) levels.dark = *dark_dn;
    Hords out{with_masses ? py::array_t<std::uint16_t>({e.n, e.m, e.j, e.i}) : py::array_t<std::uint16_t>(),
              py::array_t<std::uint32_t>({e.n, e.m}), py::array_t<std::uint8_t>({e.n, e.m}),
              py::array_t<double>({e.n, e.m}), py::array_t<double>({e.n, e.m})};
    std::uint16_t* masses = out.masses.mutable_data();
    std::uint32_t* sums = out.sums.mutable_data();
    std::uint8_t* mask = out.mask.mutable_data();
    double *x = out.x.mutable_data(), *y = out.y.mutable_data();
    without_gil([&] {
        check_samples(field.frame.view);
        unwrap(algo::check_frame(field.frame.view, e, field.frame.view.bits));
        algo::HordRow row(e);
        std::vector<algo::Deflection> deflections(static_cast<std::size_t>(e.m));
        for (int n = 0; n < e.n; ++n) {
            algo::decode_row(field.frame.view, e, levels, n, row);
            algo::mean_deflections(row, deflections);
            const std::size_t first = e.index(0, n);
            if (with_masses) {
                const std::size_t count = static_cast<std::size_t>(e.m) * static_cast<std::size_t>(e.bins());
                std::copy_n(row.hord(0).mass, count, masses + first * static_cast<std::size_t>(e.bins()));
            }
            std::copy(row.sums().begin(), row.sums().end(), sums + first);
            std::copy(row.mask().begin(), row.mask().end(), mask + first);
            for (std::size_t m = 0; m < deflections.size(); ++m) {
                const bool known = row.has_hord(static_cast<int>(m));
                x[first + m] = known ? deflections[m].x.to_double_rounded() : std::nan("");
                y[first + m] = known ? deflections[m].y.to_double_rounded() : std::nan("");
            }
        }
    });
    return out;
}

// Shares of the light, mass / sum (Eq. 8).
py::array_t<double> shares(const Hords& h) {
    py::array_t<double> out({h.masses.shape(0), h.masses.shape(1), h.masses.shape(2), h.masses.shape(3)});
    const auto bins = static_cast<std::size_t>(h.masses.shape(2) * h.masses.shape(3));
    const std::uint16_t* mass = h.masses.data();
    double* to = out.mutable_data();
    for (std::size_t k = 0; k < static_cast<std::size_t>(h.sums.size()); ++k) {
        const bool known = h.mask.data()[k] == algo::kValid;
        for (std::size_t b = 0; b < bins; ++b, ++mass, ++to)
            *to = known ? static_cast<double>(*mass) / static_cast<double>(h.sums.data()[k]) : 0.0;
    }
    return out;
}

// The transmission of the whole field: no lenslet is taken as rim or outside.
Map transmission(const LightField& field, const firmware::NumberedRecipe& recipe, const py::object& recipe_given) {
    const Hords hords = decode_hords(field, recipe_given, std::nullopt, false);
    const auto count = static_cast<std::size_t>(hords.sums.size());
    const std::span sums(hords.sums.data(), count);
    const std::span mask(hords.mask.data(), count);
    Map out{"transmission",
            firmware::unit_for_people(algo::Feature::transmission),
            py::array_t<float>({field.extents.n, field.extents.m}),
            hords.mask,
            algo::kSaturated,
            algo::kNotJudged};
    std::vector<std::uint32_t> scratch(count);
    const std::uint32_t typical = algo::typical_light(sums, mask, recipe.recipe.transmission_limit, scratch);
    algo::transmissions(sums, mask, typical, {out.values.mutable_data(), count});
    return out;
}

Map feature(const LightField& field, const std::string& name, const py::object& reference, const py::object& recipe,
            int threads) {
    const auto choice = algo::feature_named(name);
    if (!choice) {
        refuse("feature " + name + " is not known", "use one of hord.FEATURES; the distances also as reference-NAME");
    }
    if (choice->against_reference == reference.is_none()) {
        refuse(choice->against_reference ? "feature " + name + " needs something to compare with"
                                         : "feature " + name + " does not look at a reference",
               choice->against_reference ? "give reference, a frame of a good part" : "leave reference out");
    }
    const firmware::NumberedRecipe used = recipe_of(recipe);
    if (choice->feature == algo::Feature::transmission) return transmission(field, used, recipe);
    std::optional<LightField> good;
    if (choice->against_reference) {
        const py::tuple bins = py::make_tuple(field.extents.i, field.extents.j);
        good = field_of(reference, bins, py::none(), field.frame.view.bits == 8 ? 0 : field.frame.view.bits);
    }
    const int bits = field.frame.view.bits;
    Map out{name,
            firmware::unit_for_people(choice->feature, choice->against_reference),
            py::array_t<float>({field.extents.n, field.extents.m}),
            py::array_t<std::uint8_t>({field.extents.n, field.extents.m}),
            algo::kNoGradient,
            algo::kNotJudged};
    float* values = out.values.mutable_data();
    std::uint8_t* mask = out.mask.mutable_data();
    without_gil([&] {
        check_samples(field.frame.view);
        if (good) check_samples(good->frame.view);
        auto mapper = unwrap(algo::FeatureMapper::create(field.extents, bits, light_levels(used.recipe, bits),
                                                         choice->feature, {.threads = threads}));
        const algo::FeatureMap map = good ? unwrap(mapper.against(field.frame.view, good->frame.view))
                                          : unwrap(mapper.over_neighbours(field.frame.view));
        std::copy(map.values.begin(), map.values.end(), values);
        std::copy(map.mask.begin(), map.mask.end(), mask);
    });
    return out;
}

py::tuple deflection(const LightField& field, const py::object& recipe, DarkLevel dark_dn) {
    const Hords hords = decode_hords(field, recipe, dark_dn, false);
    return py::make_tuple(hords.x, hords.y, hords.mask);
}

using Masses = py::array_t<std::uint16_t, py::array::c_style | py::array::forcecast>;

// Whole numbers of any type, 0 to 65535. Shares, which are fractions, would all become 0.
Masses masses_of(const py::array& given) {
    const char kind = given.dtype().kind();
    if (kind != 'u' && kind != 'i') {
        refuse("a HORD of type " + py::str(given.dtype()).cast<std::string>() + " is not supported",
               "give whole masses [j, i], as in hords().masses, not their shares");
    }
    const auto wide = py::array_t<std::int64_t, py::array::c_style | py::array::forcecast>(given);
    const std::span values(wide.data(), static_cast<std::size_t>(wide.size()));
    if (std::ranges::any_of(values, [](std::int64_t mass) { return mass < 0 || mass > 0xFFFF; }))
        refuse("a mass is below 0 or above 65535", "give masses of 16 bits");
    return Masses(given);
}

double distance(const std::string& name, const py::array& first, const py::array& second) {
    const Masses a = masses_of(first), b = masses_of(second);
    const auto choice = algo::feature_named(name);
    if (!choice || choice->against_reference || !is_distance(choice->feature)) {
        std::string names;
        for (const std::string_view known : algo::kFeatureNames) {
            if (is_distance(algo::feature_named(known)->feature))
                names += (names.empty() ? "" : ", ") + std::string(known);
        }
        refuse("feature " + name + " is no distance between two HORDs", "use one of " + names);
    }
    if (a.ndim() != 2 || b.ndim() != 2 || a.shape(0) != b.shape(0) || a.shape(1) != b.shape(1) ||
        a.shape(0) > algo::kMaxBins || a.shape(1) > algo::kMaxBins) {
        refuse("the two HORDs are not of one number of bins", "give masses [j, i] of the same shape");
    }
    // Distance gives 0 for a HORD without light and leaves it to its caller to mask those.
    const auto has_light = [](const Masses& masses) {
        return std::ranges::any_of(std::span(masses.data(), static_cast<std::size_t>(masses.size())),
                                   [](std::uint16_t mass) { return mass > 0; });
    };
    if (!has_light(a) || !has_light(b)) return std::nan("");
    const auto hord = [](const Masses& masses) {
        std::uint32_t sum = 0;
        for (py::ssize_t k = 0; k < masses.size(); ++k) sum += masses.data()[k];
        return algo::Hord{masses.data(), sum};
    };
    auto measure =
        unwrap(algo::Distance::create(choice->feature, static_cast<int>(a.shape(1)), static_cast<int>(a.shape(0))));
    return measure(hord(a), hord(b));
}

}  // namespace

void add_features(py::module_& module) {
    py::class_<Hords>(module, "Hords", "The HORDs of a light field, as integers: h = masses / sums (Eq. 8).")
        .def_readonly("masses", &Hords::masses, "uint16 [n, m, j, i], DN above the dark level.")
        .def_readonly("sums", &Hords::sums, "uint32 [n, m], DN: the light of a lenslet.")
        .def_readonly("mask", &Hords::mask, "uint8 [n, m]: DARK and SATURATED lenslets have no HORD.")
        .def_readonly("x", &Hords::x, "float64 [n, m]: mean deflection to the right, bin pitches; NaN: no HORD.")
        .def_readonly("y", &Hords::y, "float64 [n, m]: mean deflection downwards, bin pitches; NaN: no HORD.")
        .def("shares", &shares, "float64 [n, m, j, i]: h, the shares of the light; 0 where there is no HORD.");
    auto field = module.attr("LightField").cast<py::class_<LightField>>();
    field.def(
        "hords",
        [](const LightField& f, const py::object& recipe, DarkLevel dark_dn) {
            return decode_hords(f, recipe, dark_dn, true);
        },
        py::arg("recipe") = py::none(), py::arg("dark_dn") = py::none(),
        "The HORDs, with the light levels of a recipe (None: the default recipe). dark_dn: subtracted from every "
        "sample "
        "instead of the recipe's level. Releases the GIL.");
    field.def("deflection", &deflection, py::arg("recipe") = py::none(), py::arg("dark_dn") = py::none(),
              "(x, y, mask): mean deflection (Eq. 12), float64 [n, m], bin pitches to the right and downwards, NaN "
              "without a HORD; error below 2^-24. Arguments as of hords().");
    field.def("feature", &feature, py::arg("name"), py::arg("reference") = py::none(), py::arg("recipe") = py::none(),
              py::arg("threads") = 1, R"(The Map of a feature, exact everywhere.

name: one of FEATURES, over neighbours; a distance also as "reference-NAME", against the same place of `reference`,
a LightField, array or file of a good part. recipe: its light levels are used. Releases the GIL.

Transmission is relative to the whole field's typical lenslet here: only an inspection knows the part's outline.
Raises InvalidArgument: no such feature, a reference of another size.)");
    module.def("distance", &distance, py::arg("name"), py::arg("a"), py::arg("b"),
               R"(The distance between two HORDs, float. a, b: masses [j, i], 3 to 15 bins a side.

a, b: whole numbers 0 to 65535, not shares. name: a distance of FEATURES, over HORDs: emd ... max-sliced.
Its unit is that of the feature's Map. NaN if either has no light. Raises InvalidArgument.)");
}

}  // namespace hord::lab::python
