// Recipes and verdicts in Python.
#pragma once

#include "firmware/recipes/recipe_file.h"
#include "lab/python/module.h"

namespace hord::lab::python {

struct Recipe {
    firmware::NumberedRecipe numbered;
};

// `recipe`: a Recipe, its file, or None for the default recipe.
firmware::NumberedRecipe recipe_of(const py::object& recipe);

// One value a lenslet of a feature, with what is needed to read it.
struct Map {
    std::string name, unit;
    py::array_t<float> values;
    py::array_t<std::uint8_t> mask;
    std::uint8_t no_value = 0, not_judged = 0;
    float limit = 0;      // 0: nothing is judged by it
    bool bounds = false;  // upper bounds where the verdict needed no value

    // Float32 with NaN where there is no value.
    [[nodiscard]] py::array_t<float> filled() const;
};

}  // namespace hord::lab::python
