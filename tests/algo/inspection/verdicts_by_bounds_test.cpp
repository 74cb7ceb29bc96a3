// Verdicts by bounds of the EMD gradient over many random and rendered frames: the verdict, the reason, the score and
// the defects are those of the exact map, and where a limit of work is reached no part passes that the exact map
// rejects. HORD_BOUNDS_FRAMES=1000000 sets the number of frames, HORD_BOUNDS_SEED the seed, for several runs at once.
// docs/results/inspection.md has the result.
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <filesystem>
#include <memory>
#include <vector>

#include <gtest/gtest.h>

#include "algo/reference/reference_learner.h"
#include "hal_sim/optics/camera/render.h"
#include "tests/algo/inspection/judged_alike.h"
#include "tests/support/frames.h"

namespace hord::algo {
namespace {

using namespace testing;

// One value a sample, row by row of the macro-pixel frame; 1 is a full bin.
struct LightImage {
    Extents extents;
    std::vector<float> samples;
    [[nodiscard]] float& at(int x, int y) { return samples[static_cast<std::size_t>(y * extents.width_px() + x)]; }
    [[nodiscard]] float at(int x, int y) const { return samples[static_cast<std::size_t>(y * extents.width_px() + x)]; }
};

double real(std::mt19937_64& random, double low, double high) {
    return std::uniform_real_distribution<double>(low, high)(random);
}

// Rendered light fields with defects, of 40 x 40 lenslets: 9 x 9 bins, and fewer and more.
const std::vector<LightImage>& rendered_fields() {
    static const std::vector<LightImage> all = [] {
        std::vector<LightImage> fields;
        for (const char* name : {"bubble", "scratch", "web", "wedge", "vial-empty", "plate", "cut"}) {
            for (const int bins : {9, 5, 13}) {
                auto file = std::filesystem::path(HORD_SOURCE_DIR) / "hal_sim/scenes" / name;
                auto scene = sim::load_scene(file += ".toml");
                EXPECT_TRUE(scene) << scene.error().message();
                scene->camera.extents = {40, 40, bins, bins};
                const auto field = sim::render(*scene, {1, {}});
                EXPECT_TRUE(field) << field.error().message();
                fields.push_back({field->extents, field->bins});
            }
        }
        return fields;
    }();
    return all;
}

LightImage cut_out(const LightImage& field, std::mt19937_64& random) {
    const Extents& e = field.extents;
    const int most = 8 * 81 / e.bins() + 8;
    const Extents small{pick(random, 5, std::min(most, 30)), pick(random, 5, std::min(most, 30)), e.i, e.j};
    LightImage cut{small, std::vector<float>(small.lenslets() * static_cast<std::size_t>(small.bins()))};
    const int left = e.i * pick(random, 0, e.m - small.m), top = e.j * pick(random, 0, e.n - small.n);
    for (int y = 0; y < small.height_px(); ++y) {
        for (int x = 0; x < small.width_px(); ++x) cut.at(x, y) = field.at(left + x, top + y);
    }
    return cut;
}

// A lens of random strength and size in the field, light everywhere, or single bins lit at random.
LightImage drawn_light(std::mt19937_64& random, const Extents& e) {
    LightImage light{e, std::vector<float>(e.lenslets() * static_cast<std::size_t>(e.bins()))};
    const double radius = real(random, 0.2, 0.8) * std::min(e.m, e.n), width = real(random, 0.4, 2),
                 rim = real(random, 0, 0.45);
    const int kind = pick(random, 0, 5), lit = pick(random, 1, e.bins());
    for (int y = 0; y < e.height_px(); ++y) {
        for (int x = 0; x < e.width_px(); ++x) {
            const double u = (x / e.i - 0.5 * (e.m - 1)) / radius, v = (y / e.j - 0.5 * (e.n - 1)) / radius,
                         bend = u * u + v * v < 1 ? rim : 0, i = x % e.i - 0.5 * (e.i - 1) - bend * e.i * u,
                         j = y % e.j - 0.5 * (e.j - 1) - bend * e.j * v;
            double value = std::exp(-(i * i + j * j) / (2 * width * width));
            if (kind == 0) value = pick(random, 0, 255) / 255.0;
            if (kind == 1) value = pick(random, 1, e.bins()) <= lit ? real(random, 0.1, 1) : 0;
            light.at(x, y) = static_cast<float>(value);
        }
    }
    return light;
}

// Extents whose exact map takes about as long as any other's: 3 to 15 bins, 5 to 30 lenslets along an axis.
Extents any_extents(std::mt19937_64& random) {
    const int i = pick(random, 3, 15), j = pick(random, 3, 15), most = std::clamp(1000 / (i * j) + 5, 6, 30);
    return {pick(random, 5, most), pick(random, 5, most), i, j};
}

void scale_lenslet(LightImage& light, int m, int n, double factor) {
    const Extents& e = light.extents;
    for (int j = 0; j < e.j; ++j) {
        for (int i = 0; i < e.i; ++i) light.at(m * e.i + i, n * e.j + j) *= static_cast<float>(factor);
    }
}

// Moves the light of a lenslet by a share of a bin.
void deflect_lenslet(LightImage& light, int m, int n, double right) {
    const Extents& e = light.extents;
    for (int j = 0; j < e.j; ++j) {
        for (int i = e.i - 1; i > 0; --i) {
            float &here = light.at(m * e.i + i, n * e.j + j), &before = light.at(m * e.i + i - 1, n * e.j + j);
            const auto moved = static_cast<float>(right) * before;
            here += moved;
            before -= moved;
        }
    }
}

// A defect of one lenslet or a few, or none.
LightImage with_defect(LightImage light, std::mt19937_64& random) {
    const int kind = pick(random, 0, 3), size = pick(random, 1, 2);
    const int m = pick(random, 1, light.extents.m - 3), n = pick(random, 1, light.extents.n - 3);
    const double strength = real(random, 0, 1);
    for (int k = 0; k < size * size; ++k) {
        if (kind == 1) scale_lenslet(light, m + k % size, n + k / size, 1 - strength);
        if (kind == 2) deflect_lenslet(light, m + k % size, n + k / size, strength);
    }
    return light;
}

// The mean of each sample and its neighbours, over the borders of lenslets, too.
LightImage blurred(const LightImage& light) {
    LightImage out = light;
    const int width = light.extents.width_px(), height = light.extents.height_px();
    for (int y = 0; y < height; ++y) {
        for (int x = 0; x < width; ++x) {
            const float sum = light.at(std::max(x - 1, 0), y) + light.at(std::min(x + 1, width - 1), y) +
                light.at(x, std::max(y - 1, 0)) + light.at(x, std::min(y + 1, height - 1));
            out.at(x, y) = (light.at(x, y) + sum) / 5;
        }
    }
    return out;
}

Frame exposed(const LightImage& light, double full_dn, double pedestal_dn, double noise_dn, std::mt19937_64& random) {
    Frame frame(light.extents.width_px(), light.extents.height_px(), 8);
    for (int y = 0; y < frame.height_px(); ++y) {
        for (int x = 0; x < frame.width_px(); ++x) {
            // The sum of four uniform values, of standard deviation 1.
            const std::uint64_t r = random();
            const double noise =
                (static_cast<double>((r & 0xFFFF) + (r >> 16 & 0xFFFF) + (r >> 32 & 0xFFFF) + (r >> 48)) / 65536 - 2) *
                1.7320508;
            frame.set(x, y,
                      static_cast<std::uint32_t>(std::clamp(
                          std::lround(full_dn * static_cast<double>(light.at(x, y)) + pedestal_dn + noise_dn * noise),
                          0L, 254L)));
        }
    }
    return frame;
}

Frame any_exposure(const LightImage& light, std::mt19937_64& random) {
    const double pedestal = pick(random, 0, 2) > 0 ? pick(random, 0, 20) : 0,
                 noise = pick(random, 0, 3) > 0 ? real(random, 0, 6) : 0;
    const bool blur = pick(random, 0, 4) == 0;
    return exposed(blur ? blurred(light) : light, real(random, 40, 230), pedestal, noise, random);
}

// Limits near values that the exact map of a frame has.
Recipe any_recipe(const LightImage& light, std::mt19937_64& random) {
    Recipe recipe = pick(random, 0, 4) == 0 ? Recipe{} : unchecked();
    if (pick(random, 0, 4) > 0) recipe.max_dark_rise_dn = 60;
    constexpr std::array kForms{PartForm::round, PartForm::web, PartForm::tube, PartForm::plate};
    recipe.form = kForms.at(static_cast<std::size_t>(pick(random, 0, 3)));
    recipe.slopes = pick(random, 0, 2) > 0;
    recipe.light = pick(random, 0, 2) > 0;
    recipe.min_area = pick(random, 0, 3) == 0 ? 2 : 1;
    if (recipe.slopes && pick(random, 0, 1) == 0)
        recipe.frobenius_limit_bins = static_cast<float>(real(random, 0.1, 2));
    const Frame frame = any_exposure(light, random);
    Pipeline exactly = pipeline_for(light.extents, 8, unchecked(), MapSet::exact);
    const auto exact = exactly.inspect(frame.view());
    float most = 0;
    for (std::size_t k = 0; k < exact->mask.size(); ++k) {
        if ((exact->mask[k] & (kNoGradient | kNotJudged)) == 0) most = std::max(most, exact->emd[k]);
    }
    const float value = pick(random, 0, 3) == 0 ? 1 : most * static_cast<float>(real(random, 0.5, 1.2));
    recipe.emd_limit_bins = std::clamp(value, 0.01F, 20.0F);
    return recipe;
}

struct Count {
    std::size_t frames = 0, passed = 0, rejected = 0, unfit = 0, with_reference = 0;
    std::size_t bounded = 0, needlessly_rejected = 0, towards_pass = 0;
};

// A recipe with its two pipelines, for many frames.
class Line {
  public:
    Line(const Extents& e, const Recipe& recipe)
        : exactly_(pipeline_for(e, 8, recipe, MapSet::exact)), judging_(pipeline_for(e, 8, recipe, MapSet::judged)) {}

    void judge(const Frame& frame, Count& count) {
        const auto exact = exactly_.inspect(frame.view());
        ASSERT_TRUE(exact) << exact.error().message();
        const auto seen = judging_.inspect(frame.view(), nullptr, kUnlimited);
        ASSERT_FALSE(seen->bounded);
        ++count.frames;
        (exact->verdict == Verdict::pass         ? count.passed
             : exact->verdict == Verdict::reject ? count.rejected
                                                 : count.unfit) += 1;
        count.towards_pass += seen->verdict == Verdict::pass && exact->verdict != Verdict::pass ? 1 : 0;
        ASSERT_NO_FATAL_FAILURE(expect_same_verdict(*seen, *exact));
        for (const InspectionLimits& limits : {InspectionLimits{}, InspectionLimits{0, 5'000, 0}}) {
            const auto hasty = judging_.inspect(frame.view(), nullptr, limits);
            if (!hasty->bounded) {
                ASSERT_NO_FATAL_FAILURE(expect_same_verdict(*hasty, *exact));
                continue;
            }
            ++count.bounded;
            count.needlessly_rejected += hasty->verdict != exact->verdict ? 1 : 0;
            count.towards_pass += hasty->verdict == Verdict::pass && exact->verdict != Verdict::pass ? 1 : 0;
            // A plate that the field cuts is unfit only if no defect is found on it, and a bound may show one (ADR 21).
            if (hasty->verdict == Verdict::unfit || exact->frame.fault != FrameFault::cut_by_field) {
                ASSERT_EQ(hasty->verdict == Verdict::unfit, exact->verdict == Verdict::unfit);
            }
            ASSERT_GE(hasty->score, exact->score);
        }
        ASSERT_EQ(count.towards_pass, 0U);
    }

  private:
    Pipeline exactly_, judging_;
};

// A lens in free light, and the reference learned from eight exposures of it.
struct LearnedPart {
    LightImage light;
    std::shared_ptr<const Reference> reference;
};
std::vector<LearnedPart> learned_parts(std::mt19937_64& random) {
    std::vector<LearnedPart> parts;
    for (const Extents& e : {Extents{24, 22, 9, 9}, {20, 26, 5, 7}, {22, 20, 7, 5}, {30, 24, 3, 3}}) {
        LightImage light{e, std::vector<float>(e.lenslets() * static_cast<std::size_t>(e.bins()))};
        for (int y = 0; y < e.height_px(); ++y) {
            for (int x = 0; x < e.width_px(); ++x) {
                const double u = x / e.i - 0.5 * (e.m - 1), v = y / e.j - 0.5 * (e.n - 1);
                const bool inside = std::hypot(u / (0.36 * e.m), v / (0.3 * e.n)) < 1;
                const double i = x % e.i - 0.5 * (e.i - 1) - (inside ? 0.08 * e.i / 9 * u : 0),
                             j = y % e.j - 0.5 * (e.j - 1) - (inside ? 0.05 * e.j / 9 * v : 0);
                light.at(x, y) = static_cast<float>((inside ? 0.9 : 1) * std::exp(-(i * i + j * j) / (2 * 0.49)));
            }
        }
        LearnOptions options;
        options.levels = light_levels(Recipe{}, 8);
        options.electrons_per_dn = 10.0F;
        options.read_dn = 0.6F;
        const auto learned = learn_reference(
            e, 8, 8, [&](std::size_t) -> Result<Frame> { return exposed(light, 220, 0, 0.6, random); }, options);
        EXPECT_TRUE(learned) << learned.error().message();
        if (learned) parts.push_back({light, std::make_shared<Reference>(learned->reference)});
    }
    return parts;
}

// Nearly all lenslets have the same small value there: the search for the largest one must not solve them all.
TEST(VerdictsByBounds, of_flat_frames_without_noise_are_found_within_the_limit_of_work) {
    for (const char* name : {"web", "wedge"}) {
        auto file = std::filesystem::path(HORD_SOURCE_DIR) / "hal_sim/scenes" / name;
        auto scene = sim::load_scene(file += ".toml");
        ASSERT_TRUE(scene);
        const auto field = sim::render(*scene, {1, {}});
        ASSERT_TRUE(field);
        std::mt19937_64 random(72);
        const Frame frame = exposed({field->extents, field->bins}, 240, 0, 0, random);
        for (const bool slopes : {true, false}) {
            Recipe recipe = unchecked();
            recipe.form = PartForm::web;
            recipe.zones = {Zone{.centre = {55, 55}, .radius = 30, .corners = {}}};  // inside the wedge
            recipe.slopes = recipe.light = slopes;
            const auto seen = pipeline_for(field->extents, 8, recipe, MapSet::judged).inspect(frame.view());
            EXPECT_EQ(seen->verdict, Verdict::pass) << name;
            EXPECT_FALSE(seen->bounded) << name << ", score " << seen->score;
        }
    }
}

TEST(VerdictsByBounds, of_random_and_rendered_frames_never_pass_what_the_exact_map_rejects) {
    const auto number = [](const char* name, std::size_t otherwise) {
        const char* const given = std::getenv(name);
        return given != nullptr ? std::strtoull(given, nullptr, 10) : otherwise;
    };
    const std::size_t frames = number("HORD_BOUNDS_FRAMES", 3000);
    constexpr int kFramesOfLine = 50;
    std::mt19937_64 random(number("HORD_BOUNDS_SEED", 71));
    const std::vector<LearnedPart> parts = learned_parts(random);
    ASSERT_EQ(parts.size(), 4U);
    Count count;
    for (std::size_t line = 0; count.frames < frames; ++line) {
        SCOPED_TRACE("line " + std::to_string(line));
        const bool compared = line % 10 == 9;
        const LearnedPart& part = parts[line / 10 % parts.size()];
        const LightImage light = compared ? part.light
            : line % 2 == 0               ? cut_out(rendered_fields()[random() % rendered_fields().size()], random)
                                          : drawn_light(random, any_extents(random));
        Recipe recipe = any_recipe(light, random);
        if (compared) {
            recipe.form = PartForm::round;
            recipe.light = true;
            recipe.reference = part.reference;
            if (pick(random, 0, 1) == 0) recipe.reject_score = 40, recipe.grow_score = 20;  // the gradients decide
        }
        Line both(light.extents, recipe);
        for (int k = 0; k < kFramesOfLine; ++k) {
            const LightImage shown = with_defect(light, random);
            const Frame frame = compared ? exposed(shown, real(random, 200, 230), 0, real(random, 0.5, 1.5), random)
                                         : any_exposure(shown, random);
            ASSERT_NO_FATAL_FAILURE(both.judge(frame, count)) << "frame " << k;
        }
        count.with_reference += compared ? kFramesOfLine : 0;
    }
    std::printf(
        "%zu frames (%zu with a reference): %zu pass, %zu rejected, %zu unfit by the exact map; differ towards pass: "
        "%zu; of %zu verdicts with a small limit of work %zu used bounds, %zu of them reject needlessly\n",
        count.frames, count.with_reference, count.passed, count.rejected, count.unfit, count.towards_pass,
        2 * count.frames, count.bounded, count.needlessly_rejected);
    EXPECT_EQ(count.towards_pass, 0U);
    EXPECT_GT(count.passed, count.frames / 20);
    EXPECT_GT(count.rejected, count.frames / 20);
    EXPECT_GT(count.bounded, count.frames / 20);
}

}  // namespace
}  // namespace hord::algo
