// Which lenslets of a map have a value, and which map decided.
#include "firmware/diagnostics/feature_views.h"

#include <cmath>
#include <memory>

#include <gtest/gtest.h>

#include "algo/reference/reference.h"

namespace hord::firmware {
namespace {

constexpr algo::Extents kExtents{.m = 12, .n = 10, .i = 9, .j = 9};

// An inspection of a good part: all values are far below their limits. The ring of the field is border.
struct Made {
    Made() {
        for (int n = 0; n < kExtents.n; ++n) {
            for (int m = 0; m < kExtents.m; ++m) {
                if (m == 0 || n == 0 || m + 1 == kExtents.m || n + 1 == kExtents.n)
                    mask[kExtents.index(m, n)] = algo::kBorder;
            }
        }
        found.verdict = algo::Verdict::pass;
        found.reason = algo::Reason::none;
        found.compares = algo::Feature::emd;
        found.gradient = found.emd = gradient;
        found.frobenius = frobenius;
        found.transmission = transmission;
        found.mask = mask;
        found.sums = sums;
    }
    void reject(int m, int n, algo::Reason reason) {
        defects = {{.m = static_cast<float>(m), .n = static_cast<float>(n), .area = 1}};
        found.verdict = algo::Verdict::reject;
        found.reason = reason;
        found.defects = defects;
    }
    void compare_with_reference() {
        reference->extents = kExtents;
        reference->emd.assign(kExtents.lenslets(), 0.1F);
        reference->frobenius.assign(kExtents.lenslets(), 0.05F);
        recipe.reference = reference;
        found.z_score = z_score;
        found.compared = compared;
    }
    [[nodiscard]] std::string decided() const { return FeatureViews(found, recipe, kExtents).deciding().name; }

    std::vector<float> gradient = std::vector<float>(kExtents.lenslets(), 0.2F),
                       frobenius = std::vector<float>(kExtents.lenslets(), 0.04F),
                       transmission = std::vector<float>(kExtents.lenslets(), 1.0F),
                       z_score = std::vector<float>(kExtents.lenslets(), 0.5F);
    std::vector<std::uint8_t> mask = std::vector<std::uint8_t>(kExtents.lenslets()),
                              compared = std::vector<std::uint8_t>(kExtents.lenslets(), 1);
    std::vector<std::uint32_t> sums = std::vector<std::uint32_t>(kExtents.lenslets(), 400);
    std::vector<algo::Defect> defects;
    std::shared_ptr<algo::Reference> reference = std::make_shared<algo::Reference>();
    algo::Recipe recipe;
    algo::Inspection found;
};

const std::size_t kPlace = kExtents.index(5, 4);

TEST(Views, of_a_dark_lenslet_have_its_transmission_and_no_gradient) {
    Made made;
    made.mask[kPlace] = algo::kDark;
    made.mask[kPlace + 1] = algo::kSaturated;
    made.mask[kPlace + 2] = algo::kRim;
    const FeatureViews views(made.found, made.recipe, kExtents);
    for (const char* name : {"emd", "jacobian-frobenius"}) {
        const FeatureView* view = views.find(name);
        ASSERT_NE(view, nullptr) << name;
        EXPECT_FALSE(view->has_value(kPlace)) << name;
        EXPECT_FALSE(view->has_value(kPlace + 1)) << name;
        EXPECT_TRUE(view->has_value(kPlace + 2)) << name;
        EXPECT_FALSE(view->is_judged(kPlace + 2)) << name;
        EXPECT_FALSE(view->has_value(0)) << name;  // border
    }
    const FeatureView* light = views.find("transmission");
    ASSERT_NE(light, nullptr);
    EXPECT_TRUE(light->is_judged(kPlace));
    EXPECT_EQ(light->mask[kPlace], algo::kValid);
    EXPECT_FALSE(light->has_value(kPlace + 1));
    EXPECT_TRUE(light->has_value(kPlace + 2));
    EXPECT_FALSE(light->is_judged(kPlace + 2));
    EXPECT_TRUE(light->is_judged(0));  // missing light is judged at the border, too
    for (std::size_t k = 0; k < kExtents.lenslets(); ++k) EXPECT_TRUE(views.find(kSums)->has_value(k));
    EXPECT_NE(views.find(kSums)->mask[kPlace + 1] & algo::kAtLimit, 0);  // a saturated sum is a lower limit
    EXPECT_EQ(views.find(kSums)->mask[kPlace], algo::kValid);            // little light is a value like any other
    EXPECT_EQ(views.find(kSums)->mask[0], algo::kValid);
    EXPECT_EQ(views.find(kSums)->mask[kPlace + 2], algo::kRim);
}

TEST(Views, name_the_range_of_an_overlap_by_what_it_is_taken_over) {
    EXPECT_EQ(unit_for_people(algo::Feature::chi2), "0 to 1.41");
    EXPECT_EQ(unit_for_people(algo::Feature::hellinger, true), "0 to 1");
    EXPECT_EQ(unit_for_people(algo::Feature::anisotropy), "0 to 1");
}

TEST(Views, of_a_frame_without_light_have_no_transmission) {
    Made made;
    std::ranges::fill(made.transmission, 0.0F);  // none is typical
    std::ranges::fill(made.mask, algo::kDark);
    const FeatureViews views(made.found, made.recipe, kExtents);
    for (std::size_t k = 0; k < kExtents.lenslets(); ++k) EXPECT_FALSE(views.find("transmission")->has_value(k));
}

TEST(Views, are_NaN_where_there_is_no_value_and_keep_every_other_one) {
    Made made;
    made.mask[kPlace] = algo::kDark;
    made.gradient[kPlace] = 0;
    made.mask[kPlace + 1] = algo::kOutside;
    const FeatureViews views(made.found, made.recipe, kExtents);
    const FeatureView& view = *views.find("emd");
    const auto values = with_no_data(view.map, view.mask, view.no_value);
    for (std::size_t k = 0; k < values.size(); ++k) {
        EXPECT_EQ(std::isnan(values[k]), (made.mask[k] & algo::kNoGradient) != 0) << k;
        if (!std::isnan(values[k])) {
            EXPECT_EQ(values[k], 0.2F);
        }
    }
}

TEST(Views, the_reason_of_a_reject_names_the_map_that_decided) {
    Made made;
    for (const auto& [reason, name] : {std::pair(algo::Reason::neighbours_disagree, "emd"),
                                       std::pair(algo::Reason::deflection_gradient, "jacobian-frobenius"),
                                       std::pair(algo::Reason::absorption, "transmission")}) {
        made.reject(5, 4, reason);
        EXPECT_EQ(made.decided(), name);
    }
}

TEST(Views, of_a_pass_the_feature_closest_to_its_limit_decided) {
    Made made;  // limits 1, 0.4 and 0.7
    EXPECT_EQ(made.decided(), "emd");
    made.frobenius[kPlace] = 0.3F;
    EXPECT_EQ(made.decided(), "jacobian-frobenius");
    made.transmission[0] = 0.75F;  // at the border: five sixths of what may be missing
    EXPECT_EQ(made.decided(), "transmission");
    made.gradient[kPlace] = 0.9F;
    EXPECT_EQ(made.decided(), "emd");
    made.mask[kPlace] = algo::kRim;  // not judged
    EXPECT_EQ(made.decided(), "transmission");
}

TEST(Views, of_an_unfit_frame_show_its_light) {
    Made made;
    made.found.verdict = algo::Verdict::unfit;
    made.found.reason = algo::Reason::saturated;
    EXPECT_EQ(made.decided(), "sums");
}

TEST(Views, with_a_reference_the_worst_defect_names_the_map_that_decided) {
    Made made;
    made.compare_with_reference();
    made.reject(5, 4, algo::Reason::deflection_gradient);
    made.z_score[kPlace] = 9;
    made.gradient[kPlace] = 1.2F;  // 1.1 more than the good part's
    EXPECT_EQ(made.decided(), "z-score");
    made.gradient[kPlace] = 2.2F;
    EXPECT_EQ(made.decided(), "emd");
    made.reference->emd[kPlace] = 2.1F;  // as good parts have it
    EXPECT_EQ(made.decided(), "z-score");
    made.gradient[kExtents.index(10, 8)] = 3;  // not in the worst defect
    EXPECT_EQ(made.decided(), "z-score");
}

TEST(Views, with_a_reference_nothing_is_shown_where_nothing_was_compared) {
    Made made;
    made.compare_with_reference();
    made.compared[kPlace] = 0;
    made.mask[kPlace + 1] = algo::kOutside;
    made.mask[kPlace + 2] = algo::kDark;
    made.mask[kPlace + 3] = algo::kRim;
    {
        const FeatureViews views(made.found, made.recipe, kExtents);
        const FeatureView& view = *views.find(kZScore);
        EXPECT_FALSE(view.has_value(kPlace));
        EXPECT_FALSE(view.has_value(kPlace + 1));
        for (const std::size_t k : {kPlace + 2, kPlace + 3, std::size_t{0}}) EXPECT_TRUE(view.is_judged(k));
        // The score of the light is judged instead of the transmission.
        EXPECT_EQ(views.find("transmission")->limit, 0);
    }
    made.found.verdict = algo::Verdict::unfit;
    made.found.z_score = {};
    const FeatureViews unfit(made.found, made.recipe, kExtents);
    const FeatureView& none = *unfit.find(kZScore);
    ASSERT_EQ(none.map.size(), kExtents.lenslets());
    for (std::size_t k = 0; k < kExtents.lenslets(); ++k) EXPECT_FALSE(none.has_value(k));
}

}  // namespace
}  // namespace hord::firmware
