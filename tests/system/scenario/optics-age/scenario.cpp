#include "tests/system/scenario/scenario.h"

#include <cmath>
#include <vector>

#include "firmware/monitoring/optics_monitor.h"
#include "lab/soak/real_parts.h"
#include "tests/system/scenario/optics-age/ageing_frames.h"

namespace hord::lab {
namespace {

constexpr algo::Extents kField{24, 24, 9, 9};  // of lab/soak/real_parts.h
constexpr int kWindow = 50;

// Keeps the monitor's reports, each with its inspection number.
class Watcher final : public InspectionObserver {
  public:
    struct News {
        std::uint64_t inspection;
        OpticsMonitor::View view;
    };
    explicit Watcher(int window = kWindow)
        : watch_(std::move(*OpticsMonitor::create(kField, {.window_parts = window}))) {}
    void on_inspection(std::uint32_t, const FrameView& frame, const algo::Inspection& inspection) override {
        ++inspections;
        if (watch_->add(frame, inspection)) news.push_back({inspections, watch_->view()});
    }
    [[nodiscard]] OpticsMonitor::View view() const { return watch_->view(); }
    // The first report from inspection `from` on with the fault present (or absent); nullptr: none.
    [[nodiscard]] const News* first(std::uint64_t from, FaultBit fault, bool present) const {
        for (const News& n : news) {
            if (n.inspection >= from && ((n.view.faults & fault) != 0) == present) return &n;
        }
        return nullptr;
    }

    std::uint64_t inspections = 0;
    std::vector<News> news;

  private:
    std::unique_ptr<OpticsMonitor> watch_;
};

// Runs real parts through optics that age as `of_exposure` says.
std::unique_ptr<SimulatedLine> run_ageing(std::uint64_t seed, std::uint64_t parts, Watcher& watcher,
                                          std::unique_ptr<sim::AgeingFrames>& frames,
                                          const std::function<sim::CellAge(std::uint64_t)>& of_exposure) {
    LineOptions options = timed_line(seed, parts);
    if (const auto shown = show_real_parts(options); !shown) {
        ADD_FAILURE() << shown.error().message();
        return nullptr;
    }
    frames = std::make_unique<sim::AgeingFrames>(*options.frames, kField, of_exposure);
    auto judge = make_pipeline_judge({.extents = kField, .bits = 8, .recipe = {}, .observer = &watcher});
    if (!judge) {
        ADD_FAILURE() << judge.error().message();
        return nullptr;
    }
    options.frames = frames.get();
    options.judge = std::move(*judge);
    return run_scenario(options);
}

TEST(OpticsAge, dust_and_a_fading_led_are_told_in_time_with_their_place_and_are_over_when_cured) {
    Watcher watcher;
    std::unique_ptr<sim::AgeingFrames> frames;
    const auto line = run_ageing(7, 1000, watcher, frames, [](std::uint64_t k) {
        sim::CellAge age;
        if (k >= 170 && k < 400) age.dust = {{14, 9, 0.6, 0.7}};
        if (k >= 500 && k < 800) age.light = 1 - 0.34 * std::min(1.0, static_cast<double>(k - 500) / 100);
        return age;
    });
    ASSERT_NE(line, nullptr);
    ASSERT_EQ(watcher.inspections, 1000U);
    const auto* dusty = watcher.first(0, kFaultDust, true);
    ASSERT_NE(dusty, nullptr);
    EXPECT_GT(dusty->inspection, 170U);
    EXPECT_LE(dusty->inspection, 170U + 2 * kWindow);
    EXPECT_NEAR(dusty->view.dust->largest[0].m, 14, 0.5);
    EXPECT_NEAR(dusty->view.dust->largest[0].n, 9, 0.5);
    EXPECT_EQ(dusty->view.dust->specks, 1U);
    const auto* clean = watcher.first(dusty->inspection, kFaultDust, false);
    ASSERT_NE(clean, nullptr);
    EXPECT_GT(clean->inspection, 400U);
    EXPECT_LE(clean->inspection, 400U + 2 * kWindow);
    EXPECT_EQ(watcher.first(clean->inspection, kFaultDust, true), nullptr);

    const auto* fading = watcher.first(0, kFaultLightFading, true);
    ASSERT_NE(fading, nullptr);
    EXPECT_GT(fading->inspection, 500U);
    EXPECT_LE(fading->inspection, 800U);
    const auto* bright = watcher.first(fading->inspection, kFaultLightFading, false);
    ASSERT_NE(bright, nullptr);
    EXPECT_GT(bright->inspection, 800U);
    EXPECT_EQ(watcher.view().faults, 0U);
    EXPECT_EQ(line->invariants().passed_bad(), 0U) << "no part passes for it";
}

TEST(OpticsAge, without_ageing_nothing_is_told) {
    Watcher watcher;
    std::unique_ptr<sim::AgeingFrames> frames;
    const char* parts = std::getenv("HORD_AGEING_PARTS");  // a longer run, started manually
    const std::uint64_t count = parts != nullptr ? std::strtoull(parts, nullptr, 10) : 3000;
    ASSERT_NE(run_ageing(8, count, watcher, frames, [](std::uint64_t) { return sim::CellAge{}; }), nullptr);
    EXPECT_EQ(watcher.inspections, count);
    EXPECT_TRUE(watcher.news.empty()) << watcher.news.size() << " of " << count / kWindow << " windows";
    ASSERT_TRUE(watcher.view().light);
    EXPECT_NEAR(watcher.view().light->light, 1, 0.02);
    EXPECT_EQ(watcher.view().light->dark_drift_dn, 0);
    EXPECT_EQ(watcher.view().dust->specks, 0U);
}

TEST(OpticsAge, a_dark_level_that_rises_is_told) {
    Watcher watcher;
    std::unique_ptr<sim::AgeingFrames> frames;
    ASSERT_NE(
        run_ageing(9, 300, watcher, frames,
                   [](std::uint64_t k) { return sim::CellAge{.light = 1, .dark_dn = k < 150 ? 0 : 2, .dust = {}}; }),
        nullptr);
    const auto* drifted = watcher.first(0, kFaultDarkDrift, true);
    ASSERT_NE(drifted, nullptr);
    EXPECT_LE(drifted->inspection, 150U + 2 * kWindow);
    EXPECT_NEAR(drifted->view.light->dark_drift_dn, 2, 0.2);
}

}  // namespace
}  // namespace hord::lab
