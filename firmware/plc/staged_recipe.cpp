// The staged recipe's registers, for the recipe in use and back, and which of them cannot be used.
#include "firmware/plc/staged_recipe.h"

#include <algorithm>
#include <bit>
#include <cmath>
#include <span>
#include <vector>

#include <fmt/format.h>
#include <fmt/ranges.h>

#include "firmware/registers/register_map.h"

namespace hord::firmware {
namespace {

std::uint16_t scaled(double value, double scale) {
    return static_cast<std::uint16_t>(std::clamp(std::lround(value * scale), 0L, 0xFFFEL));
}

// Shown as the limit of a feature that the recipe does not judge by; a commit with another value there is refused.
// Written: the limit of the recipe in use.
constexpr std::uint16_t kNotJudged = 0xFFFF;
constexpr std::uint32_t kMaxStagedArea = 0xFFFE;  // a recipe's file may give a larger min_area

// Takes the staged limit only if it was changed: an unchanged one keeps the digits that registers cannot show.
void set_if_changed(float& limit, std::uint16_t staged, std::uint16_t was, double scale) {
    if (staged != was && staged != kNotJudged) limit = static_cast<float>(staged / scale);
}

// Why the recipe cannot be used; empty: it can. `max_area`: the largest min_area that it may have.
std::string problems_of(const NumberedRecipe& recipe, const algo::Extents& extents, std::uint32_t max_area) {
    if (const auto checked = parse_numbered_recipe(format_recipe(recipe), "recipe", max_area); !checked) {
        const std::string why = checked.error().message();  // "recipe:15: limits.emd_bins: 60 is ..."
        return why.substr(why.find(": ") + 2);
    }
    return fmt::format("{}", fmt::join(algo::problems(recipe.recipe, extents), ", "));
}

// Registers 8202 to 8209.
std::span<const Register> staged_rows() { return find_block(BlockId::recipe)->registers.first<StagedWords{}.size()>(); }

// Register `k` gives a limit of a feature that the recipe in use does not judge by.
bool is_unjudged(const StagedWords& in_use, const StagedWords& staged, std::size_t k) {
    return staged_rows()[k].nullable && in_use[k] == kNotJudged && staged[k] != kNotJudged;
}

}  // namespace

StagedRecipe staged_from(const NumberedRecipe& numbered) {
    const algo::Recipe& r = numbered.recipe;
    return {.number = numbered.number,
            .emd_limit_mbins = r.gradient == algo::Feature::emd ? scaled(r.emd_limit_bins, 1e3) : kNotJudged,
            .frobenius_limit_mbins = r.slopes ? scaled(r.frobenius_limit_bins, 1e3) : kNotJudged,
            .transmission_permille = r.light ? scaled(r.transmission_limit, 1e3) : kNotJudged,
            .min_area = static_cast<std::uint16_t>(std::min(r.min_area, kMaxStagedArea)),
            .rim_margin = static_cast<std::int16_t>(r.rim_margin),
            .max_saturated_permyriad = scaled(r.max_saturated_share, 1e4),
            .min_lit_permyriad = scaled(r.min_lit_share, 1e4)};
}

NumberedRecipe with_staged(NumberedRecipe in_use, const StagedRecipe& staged) {
    const StagedRecipe was = staged_from(in_use);
    algo::Recipe& r = in_use.recipe;
    in_use.number = staged.number;
    set_if_changed(r.emd_limit_bins, staged.emd_limit_mbins, was.emd_limit_mbins, 1e3);
    set_if_changed(r.frobenius_limit_bins, staged.frobenius_limit_mbins, was.frobenius_limit_mbins, 1e3);
    set_if_changed(r.transmission_limit, staged.transmission_permille, was.transmission_permille, 1e3);
    if (staged.min_area != was.min_area) r.min_area = staged.min_area;
    if (staged.rim_margin != was.rim_margin) r.rim_margin = staged.rim_margin;
    set_if_changed(r.max_saturated_share, staged.max_saturated_permyriad, was.max_saturated_permyriad, 1e4);
    set_if_changed(r.min_lit_share, staged.min_lit_permyriad, was.min_lit_permyriad, 1e4);
    return in_use;
}

bool gives_unjudged_limit(const NumberedRecipe& in_use, const StagedRecipe& staged) {
    const auto was = std::bit_cast<StagedWords>(staged_from(in_use)), now = std::bit_cast<StagedWords>(staged);
    for (std::size_t k = 0; k < now.size(); ++k) {
        if (is_unjudged(was, now, k)) return true;
    }
    return false;
}

std::string bad_registers(const NumberedRecipe& in_use, const StagedRecipe& staged, const algo::Extents& extents) {
    const auto was = std::bit_cast<StagedWords>(staged_from(in_use)), now = std::bit_cast<StagedWords>(staged);
    const bool usable = problems_of(in_use, extents, kMaxArea).empty();  // its reference may have gone
    std::vector<std::uint16_t> addresses;
    std::vector<std::string> reasons;
    for (std::size_t k = 0; k < now.size(); ++k) {
        if (now[k] == was[k]) continue;
        StagedWords alone = was;
        alone[k] = now[k];
        std::string why;
        if (is_unjudged(was, now, k)) {
            why = "the recipe does not judge by it: write 65535, or name it in the recipe's features";
        } else if (usable) {
            const NumberedRecipe changed = with_staged(in_use, std::bit_cast<StagedRecipe>(alone));
            // An area that was not staged may be larger than its register holds.
            const bool staged_area = changed.recipe.min_area != in_use.recipe.min_area;
            why = problems_of(changed, extents, staged_area ? kMaxStagedArea : kMaxArea);
        }
        if (why.empty()) continue;
        const Register& row = staged_rows()[k];
        addresses.push_back(row.address);
        reasons.push_back(fmt::format("{} {}: {}", row.address, row.name, why));
    }
    const std::string all = fmt::format("{}", fmt::join(reasons, "; "));
    return addresses.size() > 1 ? fmt::format("{} cannot be used; {}", fmt::join(addresses, ", "), all) : all;
}

}  // namespace hord::firmware
