#include "firmware/diagnostics/inspection_self_test.h"

#include <algorithm>
#include <cmath>

#include "algo/inspection/pipeline.h"

namespace hord::firmware {
namespace {

constexpr int kLenslets = 15;
constexpr int kPatch = 1;  // half the side of the disturbed region, in lenslets

// Every lenslet holds a spot of light a bin wide; its position changes smoothly by half a bin across the part. In
// the middle of a bad part the light of every other lenslet lies at the edge of its bins.
Frame draw(int bins_i, int bins_j, int bits, bool bad) {
    Frame frame(kLenslets * bins_i, kLenslets * bins_j, bits);
    const double brightest = 0.8 * ((1 << bits) - 1);
    const int middle = kLenslets / 2;
    for (int n = 0; n < kLenslets; ++n) {
        for (int m = 0; m < kLenslets; ++m) {
            const bool disturbed =
                bad && std::abs(m - middle) <= kPatch && std::abs(n - middle) <= kPatch && (m + n) % 2 == 0;
            const double centre_i = disturbed ? 0.0 : (bins_i - 1) / 2.0 + 0.5 * (m - middle) / kLenslets;
            const double centre_j = (bins_j - 1) / 2.0 + 0.5 * (n - middle) / kLenslets;
            for (int j = 0; j < bins_j; ++j) {
                for (int i = 0; i < bins_i; ++i) {
                    const double r2 = (i - centre_i) * (i - centre_i) + (j - centre_j) * (j - centre_j);
                    frame.set(m * bins_i + i, n * bins_j + j,
                              static_cast<std::uint32_t>(std::lround(brightest * std::exp(-r2))));
                }
            }
        }
    }
    return frame;
}

}  // namespace

Result<void> check_judgement(int bins_i, int bins_j, int bits) {
    algo::Recipe recipe;
    recipe.form = algo::PartForm::web;  // the drawn part fills the field
    recipe.part_required = false;
    auto pipeline = algo::Pipeline::create({kLenslets, kLenslets, bins_i, bins_j}, bits, recipe);
    if (!pipeline) return tl::unexpected(pipeline.error());
    for (const bool bad : {false, true}) {
        const Frame frame = draw(bins_i, bins_j, bits, bad);
        const auto inspection = pipeline->inspect(frame.view());
        if (!inspection) return tl::unexpected(inspection.error());
        const auto right = bad ? algo::Verdict::reject : algo::Verdict::pass;
        if (inspection->verdict == right) continue;
        return fail(ErrorCode::internal,
                    std::string("a drawn ") + (bad ? "bad" : "good") + " part was judged " +
                        std::string(algo::name_of(inspection->verdict)) + ", reason " +
                        std::string(algo::name_of(inspection->reason)),
                    "do not use this station: the program or the processor is not what was tested; install it again, "
                    "run memtest86+");
    }
    return {};
}

}  // namespace hord::firmware
