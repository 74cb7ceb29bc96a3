// The recipe in use as registers 8202 to 8209, what a PLC changed of it, and which of them cannot be used.
#pragma once

#include <string>

#include "algo/frame/extents.h"
#include "firmware/recipes/recipe_file.h"
#include "firmware/registers/register_values.h"

namespace hord::firmware {

// 0xFFFF: the limit of a feature that the recipe does not judge by.
StagedRecipe staged_from(const NumberedRecipe& numbered);

// The recipe in use with the staged values. What was not changed keeps the digits that registers cannot show; 0xFFFF as
// a limit, and what has no register, leave it as it is.
NumberedRecipe with_staged(NumberedRecipe in_use, const StagedRecipe& staged);

// Whether a limit of a feature is given that the recipe in use does not judge by. with_staged() does not show it: a
// recipe's text has no usual values of such limits.
bool gives_unjudged_limit(const NumberedRecipe& in_use, const StagedRecipe& staged);

// "8203 staged_emd_limit: limits.emd_bins: 60 is out of range: use 0.001 to 30", for each staged register that alone
// makes the recipe in use unusable on this light field; empty: none does. The addresses of several come first.
std::string bad_registers(const NumberedRecipe& in_use, const StagedRecipe& staged, const algo::Extents& extents);

}  // namespace hord::firmware
