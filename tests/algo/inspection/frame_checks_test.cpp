// Frames that show nothing to judge are unfit or rejected; good parts pass. Kinds: tests/support/odd_frames.h.
#include "algo/inspection/frame_checks.h"

#include <cstdio>
#include <cstdlib>

#include <gtest/gtest.h>

#include "algo/inspection/pipeline.h"
#include "tests/support/odd_frames.h"

namespace hord::algo {
namespace {

using namespace hord::algo::testing;

const Extents kGeometries[] = {{111, 111, 9, 9}, {45, 45, 9, 9}, {45, 45, 5, 5},
                               {45, 45, 15, 15}, {40, 36, 9, 9}, {36, 45, 7, 8}};

Inspection inspected(const Extents& e, const Frame& frame, const Recipe& recipe = {}) {
    auto pipeline = Pipeline::create(e, frame.bits(), recipe);
    EXPECT_TRUE(pipeline);
    auto found = pipeline->inspect(frame.view());
    EXPECT_TRUE(found);
    Inspection copy = *found;  // its spans are not valid any more
    copy.defects = {};
    return copy;
}

std::string told(const Inspection& found) {
    const FrameFindings& f = found.frame;
    char text[400];
    std::snprintf(text, sizeof text,
                  "%s %s fault %d dark %u (%.2f +- %.2f) free %d offset %.2f %.2f spot %.2f %.2f second %.3f lit %.2f "
                  "period %d %d parts %d cut %.2f sharp %.2f beside %.2f symmetry %.2f score %.2f",
                  std::string(name_of(found.verdict)).c_str(), std::string(name_of(found.reason)).c_str(),
                  static_cast<int>(f.fault), found.dark_dn, double(f.pedestal_dn), double(f.dark_noise_dn),
                  f.in_free_light, double(f.x_bins), double(f.y_bins), double(f.spot_x_bins), double(f.spot_y_bins),
                  double(f.second_share), double(f.lit_share), f.period_x, f.period_y, f.parts, double(f.border_cut),
                  double(f.sharp_share), double(f.free_beside), double(f.symmetry), double(found.score));
    return text;
}

class Field : public ::testing::TestWithParam<Extents> {};

TEST_P(Field, that_shows_nothing_to_judge_never_passes) {
    for (const Kind& kind : unfit_kinds()) {
        for (const std::uint64_t seed : {1U, 2U}) {
            const auto frame = kind.frame(GetParam(), seed);
            if (!frame) continue;
            const Inspection found = inspected(GetParam(), *frame);
            if (std::getenv("HORD_TABLE")) std::printf("%-50s %s\n", kind.name.c_str(), told(found).c_str());
            EXPECT_NE(found.verdict, Verdict::pass) << kind.name << ": " << told(found);
        }
    }
}

TEST_P(Field, of_a_good_part_passes) {
    for (const Kind& kind : good_kinds()) {
        for (const std::uint64_t seed : {1U, 2U}) {
            const auto frame = kind.frame(GetParam(), seed);
            if (!frame) continue;
            const Inspection found = inspected(GetParam(), *frame);
            if (std::getenv("HORD_TABLE")) std::printf("%-50s %s\n", kind.name.c_str(), told(found).c_str());
            EXPECT_EQ(found.verdict, Verdict::pass) << kind.name << ": " << told(found);
        }
    }
}

std::string name_of_field(const ::testing::TestParamInfo<Extents>& field) {
    const Extents& e = field.param;
    return std::to_string(e.m) + "x" + std::to_string(e.n) + "_of_" + std::to_string(e.i) + "x" + std::to_string(e.j);
}

INSTANTIATE_TEST_SUITE_P(Of, Field, ::testing::ValuesIn(kGeometries), name_of_field);

}  // namespace
}  // namespace hord::algo
