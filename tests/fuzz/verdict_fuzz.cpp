// Arbitrary changes of a clean frame, by arbitrary recipes: a verdict by bounds is that of the exact map; where a limit
// of work is reached, no part passes that the exact map rejects. The input is a recipe's byte, then changes of five
// bytes each: kind, x, y, width or amount, height or seed.
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
#include <random>

#include "algo/inspection/pipeline.h"

namespace {

using namespace hord;
using namespace hord::algo;

constexpr Extents kField{21, 21, 9, 9};
constexpr int kChange_bytes = 5;

void require(bool holds) {
    if (!holds) std::abort();
}

Frame clean_frame() {
    Frame frame(kField.width_px(), kField.height_px(), 8);
    for (int y = 0; y < frame.height_px(); ++y) {
        for (int x = 0; x < frame.width_px(); ++x) {
            const double u = (x / kField.i - 10) / 8.4, v = (y / kField.j - 10) / 8.4, bend = u * u + v * v < 1 ? 1 : 0,
                         i = x % kField.i - 4 - bend * u, j = y % kField.j - 4 - bend * v;
            frame.set(x, y, static_cast<std::uint32_t>(std::lround(230 * std::exp(-(i * i + j * j) / (2 * 0.36)))));
        }
    }
    return frame;
}

struct Change {
    int kind, x, y, a, b;
};

int changed(const FrameView& from, const Change& c, int x, int y, std::minstd_rand& random) {
    const int width = from.width_px, height = from.height_px;
    const auto at = [&](int px, int py) {
        return static_cast<int>(from.sample(((px % width) + width) % width, ((py % height) + height) % height));
    };
    const int dn = at(x, y), left = c.x * width / 256, top = c.y * height / 256;
    const bool inside = x >= left && y >= top && x < left + 1 + c.a * width / 256 && y < top + 1 + c.b * height / 256;
    switch (c.kind % 16) {
        case 0: return dn + c.a % 32;                                                       // pedestal
        case 1: return dn * c.a / 128;                                                      // exposure
        case 2: return dn + static_cast<int>(random() % (2 * (c.a % 16U) + 1)) - c.a % 16;  // noise
        case 3: return (at(x - 1, y) + at(x + 1, y) + at(x, y - 1) + at(x, y + 1) + dn) / 5;
        case 4: return at(x + c.x % 9 - 4, y + c.y % 9 - 4);  // shifted
        case 5: return inside ? 0 : dn;                       // a shadow
        case 6: return inside ? c.kind : dn;                  // flat
        case 7: return inside ? at(x + 9, y) : dn;            // a copy of the neighbours
        case 8: return inside ? dn / 2 : dn;
        case 9: return inside ? static_cast<int>(random() % 256) : dn;
        case 10: return inside ? at(x + 1, y) : dn;                   // deflected
        case 11: return dn & c.a;                                     // dead bits
        case 12: return y % (c.a % 20 + 2) == 0 ? at(x, y + 1) : dn;  // lost rows
        case 13: return x % 9 < c.a % 9 ? dn : at(x - 9, y);
        case 14: return dn + at(x + c.x % 64, y + c.y % 64) * (c.a % 64) / 64;  // a ghost
        default: return at(y * width / height, x * height / width);             // transposed
    }
}

Frame shown(const Frame& clean, const std::uint8_t* data, std::size_t size) {
    Frame frame = clean;
    for (std::size_t k = 1; k + kChange_bytes <= std::min<std::size_t>(size, 1 + 8 * kChange_bytes);
         k += kChange_bytes) {
        const Frame before = frame;
        const Change c{data[k], data[k + 1], data[k + 2], data[k + 3], data[k + 4]};
        std::minstd_rand random(data[k + 4] + 1U);
        for (int y = 0; y < frame.height_px(); ++y) {
            for (int x = 0; x < frame.width_px(); ++x)
                frame.set(x, y,
                          static_cast<std::uint32_t>(std::clamp(changed(before.view(), c, x, y, random), 0, 255)));
        }
    }
    return frame;
}

Recipe recipe_of(unsigned byte) {
    Recipe r;
    r.form = std::array{PartForm::round, PartForm::tube, PartForm::plate, PartForm::web}.at(byte & 3U);
    r.part_required = r.form != PartForm::web;
    r.slopes = (byte & 4U) == 0;
    r.light = (byte & 8U) == 0;
    if ((byte & 16U) != 0) {  // judges nearly any frame
        r.part_required = r.check_period = false;
        r.max_offset_bins = r.max_spot_bins = r.max_second_share = 0;
        r.max_dark_rise_dn = 60;
    }
    r.emd_limit_bins = std::array{1.0F, 0.2F, 0.05F, 3.0F, 1.0F, 0.5F, 8.0F, 0.01F}.at(byte >> 5U);
    return r;
}

double cpu_us() {
    timespec now{};
    clock_gettime(CLOCK_THREAD_CPUTIME_ID, &now);
    return static_cast<double>(now.tv_sec) * 1e6 + static_cast<double>(now.tv_nsec) / 1e3;
}

class Judge {
  public:
    explicit Judge(unsigned recipe)
        : judging_(*Pipeline::create(kField, 8, recipe_of(recipe))),
          exactly_(*Pipeline::create(kField, 8, recipe_of(recipe), 1, MapSet::exact)) {}

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
    static const Frame clean = clean_frame();
    static std::array<std::unique_ptr<Judge>, 256> judges;
    static const bool timed = std::getenv("HORD_FUZZ_TIMES") != nullptr;
    static Times times;
    const unsigned recipe = size > 0 ? data[0] : 0;
    if (!judges.at(recipe)) judges.at(recipe) = std::make_unique<Judge>(recipe);
    const Frame frame = shown(clean, data, size);
    if (timed) times.add(*judges.at(recipe), recipe, clean, frame);
    else judges.at(recipe)->compare(frame);
    return 0;
}
