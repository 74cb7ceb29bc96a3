// Arbitrary changes of a clean frame, by arbitrary recipes: a verdict by bounds is that of the exact map; where a limit
// of work is reached, no part passes that the exact map rejects. The input: lab/stability/changed_frames.h.
//
// With HORD_FUZZ_TIMES set, the longest processor time of a verdict over the clean frame's is printed, a line a recipe.
#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <cstdio>
#include <cstdlib>
#include <ctime>
#include <memory>

#include "algo/inspection/pipeline.h"
#include "lab/stability/changed_frames.h"

namespace {

using namespace hord;
using namespace hord::algo;

constexpr Extents kField{21, 21, 9, 9};

void require(bool holds) {
    if (!holds) std::abort();
}

double cpu_us() {
    timespec now{};
    clock_gettime(CLOCK_THREAD_CPUTIME_ID, &now);
    return static_cast<double>(now.tv_sec) * 1e6 + static_cast<double>(now.tv_nsec) / 1e3;
}

class Judge {
  public:
    explicit Judge(unsigned recipe)
        : judging_(*Pipeline::create(kField, 8, lab::recipe_of_byte(recipe))),
          exactly_(*Pipeline::create(kField, 8, lab::recipe_of_byte(recipe), 1, MapSet::exact)) {}

    void compare(const Frame& frame) {
        const auto exact = exactly_.inspect(frame.view());
        require(exact.has_value());
        for (const InspectionLimits& limits : {InspectionLimits{}, InspectionLimits{0, 5'000, 0}}) {
            const auto seen = judging_.inspect(frame.view(), nullptr, limits);
            require(seen.has_value() && std::isfinite(seen->score));
            require((seen->verdict == Verdict::unfit) == (exact->verdict == Verdict::unfit));
            if (seen->bounded) {
                require(seen->score >= exact->score);
                require(seen->verdict != Verdict::pass || exact->verdict == Verdict::pass);
            } else {
                require(seen->verdict == exact->verdict && seen->reason == exact->reason &&
                        seen->score == exact->score);
                require(seen->defects.size() == exact->defects.size());
            }
        }
    }

    // The least of `repeats` verdicts, us.
    double time(const Frame& frame, int repeats) {
        double least = 1e9;
        for (int k = 0; k < repeats; ++k) {
            const double before = cpu_us();
            (void)judging_.inspect(frame.view());
            least = std::min(least, cpu_us() - before);
        }
        return least;
    }

  private:
    Pipeline judging_, exactly_;
};

// The longest time over the clean frame's, of each recipe.
class Times {
  public:
    void add(Judge& judge, unsigned recipe, const Frame& clean, const Frame& frame) {
        double &usual = clean_us_.at(recipe), &worst = worst_.at(recipe);
        if (usual == 0) usual = judge.time(clean, 50);
        if (judge.time(frame, 2) > worst * usual) worst = std::max(worst, judge.time(frame, 30) / usual);
    }
    ~Times() {
        for (unsigned k = 0; k < worst_.size(); ++k) {
            if (worst_.at(k) > 0)
                std::printf("recipe %u: clean %.0f us, longest %.2f of it\n", k, clean_us_.at(k), worst_.at(k));
        }
    }

  private:
    std::array<double, 256> clean_us_{}, worst_{};
};

}  // namespace

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
    static const Frame clean = lab::clean_frame(kField);
    static std::array<std::unique_ptr<Judge>, 256> judges;
    static const bool timed = std::getenv("HORD_FUZZ_TIMES") != nullptr;
    static Times times;
    const unsigned recipe = size > 0 ? data[0] : 0;
    if (!judges.at(recipe)) judges.at(recipe) = std::make_unique<Judge>(recipe);
    const Frame frame = lab::changed_frame(clean, {data, size});
    if (timed) times.add(*judges.at(recipe), recipe, clean, frame);
    else judges.at(recipe)->compare(frame);
    return 0;
}
