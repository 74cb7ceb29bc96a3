// Inspectors: bounded queues, answers on the loop's thread, every frame returned.
#include "firmware/station/inspector.h"

#include <atomic>
#include <cmath>
#include <future>
#include <thread>

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <sched.h>

#include "drivers/event_loop/event_loop_sd.h"
#include "lab/stand_in/stand_in_inspector.h"
#include "lab/virtual_time/virtual_time.h"
#include "tests/firmware/station/fake_devices.h"

namespace hord::firmware {
namespace {

struct Ear final : Inspector::Listener {
    std::vector<Judged> answers;
    std::thread::id thread;
    std::function<void()> then = [] {};
    void on_judged(const Judged& judged) override {
        answers.push_back(judged);
        thread = std::this_thread::get_id();
        then();
    }
};

// A frame of 27x27 lenslets, all light in the centre bin: no deflection, no defect.
class FlatFrames : public hal::Sensor {
  public:
    FlatFrames() : frame_(27 * 9, 27 * 9, 8) {
        for (int y = 4; y < frame_.height_px(); y += 9) {
            for (int x = 4; x < frame_.width_px(); x += 9) frame_.set(x, y, 200);
        }
    }
    // The light of some lenslets around (m, n) goes three bins to the right: a deflection that the neighbours have not.
    void deflect(int m, int n) {
        for (int y = 9 * (n - 1) + 4; y <= 9 * (n + 1) + 4; y += 9) {
            for (int x = 9 * (m - 1) + 4; x <= 9 * (m + 1) + 4; x += 9) {
                frame_.set(x, y, 0);
                frame_.set(x + 3, y, 200);
            }
        }
    }
    hal::FrameLease lend() { return {*this, 0, frame_.view(), {1, {}, frame_.bytes().size(), false}}; }
    hal::FrameLease lend_half() {
        auto view = frame_.view();
        view.height_px /= 2;
        return {*this, 0, view, {1, {}, frame_.bytes().size(), false}};
    }
    std::atomic<int> given_back{0};
    hal::SensorFormat format() const override { return {27 * 9, 27 * 9, 8, 8}; }

  private:
    Result<void> do_start(Listener&) override { return {}; }
    Result<void> do_trigger(const hal::ExposureRequest&) override { return {}; }
    void do_stop() override {}
    void do_give_back(std::uint32_t) noexcept override { ++given_back; }
    Frame frame_;
};

InspectorSettings settings() {
    InspectorSettings s;
    s.extents = {27, 27, 9, 9};
    s.queue = 2;
    return s;
}

// The real pipeline in virtual time: answers `modelled` later. Null when the pipeline cannot be made.
std::unique_ptr<Inspector> inline_inspector(hal::EventLoop& loop, const InspectorSettings& with,
                                            hal::Duration modelled) {
    auto judge = make_pipeline_judge(with);
    if (!judge) return nullptr;
    return lab::make_stand_in_inspector(loop, with.queue,
                                        [judge = *judge, modelled](std::uint32_t part, const hal::FrameLease& frame) {
                                            return lab::StandInAnswer{judge(part, frame), modelled};
                                        });
}

TEST(InlineInspector, runs_the_real_pipeline_and_answers_after_the_modelled_time) {
    lab::VirtualTime loop;
    FlatFrames frames;
    Ear ear;
    auto inspector = inline_inspector(loop, settings(), std::chrono::milliseconds(30));
    ASSERT_TRUE(inspector);
    inspector->start(ear);
    ASSERT_TRUE(inspector->submit(7, frames.lend()));
    loop.run_for(std::chrono::milliseconds(29));
    EXPECT_TRUE(ear.answers.empty());
    loop.run_for(std::chrono::milliseconds(1));
    ASSERT_EQ(ear.answers.size(), 1U);
    EXPECT_EQ(ear.answers[0].part, 7U);
    EXPECT_FALSE(ear.answers[0].failed);
    EXPECT_EQ(frames.given_back, 1);
}

TEST(StandInInspector, refuses_a_part_when_its_queue_is_full) {
    lab::VirtualTime loop;
    FlatFrames frames;
    Ear ear;
    auto inspector = lab::make_stand_in_inspector(loop, 2, [](std::uint32_t, const hal::FrameLease&) {
        return lab::StandInAnswer{{}, std::chrono::milliseconds(30)};
    });
    inspector->start(ear);
    for (std::uint32_t part = 1; part <= 2; ++part) EXPECT_TRUE(inspector->submit(part, frames.lend()));
    const auto third = inspector->submit(3, frames.lend());
    ASSERT_FALSE(third);
    EXPECT_EQ(third.error().code, ErrorCode::busy);
    loop.run_for(std::chrono::milliseconds(30));
    EXPECT_EQ(ear.answers.size(), 2U);
    EXPECT_EQ(frames.given_back, 3);
}

TEST(InlineInspector, a_frame_of_the_wrong_size_fails_that_part_only) {
    lab::VirtualTime loop;
    FlatFrames frames;
    Ear ear;
    struct Told final : InspectionObserver {
        std::vector<std::uint32_t> parts;
        void on_inspection(std::uint32_t part, const FrameView&, const algo::Inspection&) override {
            parts.push_back(part);
        }
    } told;
    auto with = settings();
    with.observer = &told;
    auto inspector = inline_inspector(loop, with, std::chrono::milliseconds(1));
    ASSERT_TRUE(inspector);
    inspector->start(ear);
    ASSERT_TRUE(inspector->submit(1, frames.lend_half()));
    ASSERT_TRUE(inspector->submit(2, frames.lend()));
    loop.run_for(std::chrono::milliseconds(10));
    EXPECT_EQ(told.parts, std::vector<std::uint32_t>{2}) << "there is nothing to tell of the other one";
    ASSERT_EQ(ear.answers.size(), 2U);
    EXPECT_TRUE(ear.answers[0].failed);
    EXPECT_FALSE(ear.answers[1].failed);
}

TEST(InlineInspector, an_observer_sees_frame_and_maps) {
    struct Seen final : InspectionObserver {
        std::uint32_t part = 0;
        std::size_t values = 0;
        int width = 0;
        void on_inspection(std::uint32_t p, const FrameView& frame, const algo::Inspection& inspection) override {
            part = p;
            width = frame.width_px;
            values = inspection.emd.size();
        }
    } seen;
    lab::VirtualTime loop;
    FlatFrames frames;
    Ear ear;
    auto with = settings();
    with.observer = &seen;
    auto inspector = inline_inspector(loop, with, std::chrono::milliseconds(1));
    ASSERT_TRUE(inspector);
    inspector->start(ear);
    ASSERT_TRUE(inspector->submit(3, frames.lend()));
    EXPECT_EQ(seen.part, 3U);
    EXPECT_EQ(seen.width, 243);
    EXPECT_EQ(seen.values, 729U);
}

TEST(InlineInspector, a_judgement_is_what_the_pipeline_found) {
    struct Found final : InspectionObserver {
        algo::Inspection inspection;
        std::vector<algo::Defect> defects;
        void on_inspection(std::uint32_t, const FrameView&, const algo::Inspection& found) override {
            inspection = found;
            defects.assign(found.defects.begin(), found.defects.end());
        }
    } found;
    lab::VirtualTime loop;
    FlatFrames frames;
    frames.deflect(8, 18);
    Ear ear;
    auto with = settings();
    with.recipe.part_required = false;
    with.recipe_number = 7;
    with.observer = &found;
    auto inspector = inline_inspector(loop, with, std::chrono::milliseconds(1));
    ASSERT_TRUE(inspector);
    inspector->start(ear);
    ASSERT_TRUE(inspector->submit(3, frames.lend()));
    loop.run_for(std::chrono::milliseconds(1));
    ASSERT_EQ(ear.answers.size(), 1U);
    const Judged& judged = ear.answers[0];
    EXPECT_EQ(judged.verdict, algo::Verdict::reject);
    EXPECT_EQ(judged.verdict, found.inspection.verdict);
    EXPECT_NE(judged.reason, algo::Reason::none);
    EXPECT_EQ(judged.reason, found.inspection.reason);
    EXPECT_GT(judged.score, 1);
    EXPECT_EQ(judged.score, found.inspection.score);
    EXPECT_EQ(judged.bounded, found.inspection.bounded);
    EXPECT_EQ(judged.recipe, 7);
    ASSERT_FALSE(found.defects.empty());
    EXPECT_EQ(judged.defects, found.defects.size());
    EXPECT_EQ(judged.position_m, std::lround(found.defects.front().m));
    EXPECT_EQ(judged.position_n, std::lround(found.defects.front().n));
    EXPECT_NEAR(judged.position_m, 8, 2);
    EXPECT_NEAR(judged.position_n, 18, 2);
}

TEST(InlineInspector, a_judgement_says_that_the_effort_was_at_its_limit) {
    lab::VirtualTime loop;
    FlatFrames frames;
    frames.deflect(8, 18);
    for (const bool limited : {false, true}) {
        Ear ear;
        auto with = settings();
        with.recipe.part_required = false;
        if (limited) with.limits = {.work_a_lenslet = 0, .work = 1};
        auto inspector = inline_inspector(loop, with, std::chrono::milliseconds(1));
        ASSERT_TRUE(inspector);
        inspector->start(ear);
        ASSERT_TRUE(inspector->submit(3, frames.lend()));
        loop.run_for(std::chrono::milliseconds(1));
        ASSERT_EQ(ear.answers.size(), 1U);
        EXPECT_EQ(ear.answers[0].bounded, limited);
    }
}

TEST(InlineInspector, an_impossible_recipe_is_refused_at_once) {
    lab::VirtualTime loop;
    auto impossible = settings();
    impossible.extents.i = 99;
    EXPECT_FALSE(inline_inspector(loop, impossible, std::chrono::milliseconds(1)));
    EXPECT_FALSE(make_threaded_inspector(loop, impossible));
}

TEST(Inspectors, refuse_frames_before_they_are_started_and_give_them_back) {
    lab::VirtualTime loop;
    FlatFrames frames;
    auto stand_in = lab::make_stand_in_inspector(
        loop, 1, [](std::uint32_t, const hal::FrameLease&) { return lab::StandInAnswer{}; });
    EXPECT_FALSE(stand_in->submit(1, frames.lend()));
    auto threaded = make_threaded_inspector(loop, settings());
    ASSERT_TRUE(threaded);
    EXPECT_FALSE((*threaded)->submit(1, frames.lend()));
    EXPECT_EQ(frames.given_back, 2);
}

TEST(ThreadedInspector, answers_on_the_loops_thread) {
    auto loop = SdEventLoop::open();
    ASSERT_TRUE(loop);
    FlatFrames frames;
    Ear ear;
    ear.then = [&] {
        if (ear.answers.size() == 2) (*loop)->request_stop();
    };
    auto with = settings();
    with.threads = 2;
    auto inspector = make_threaded_inspector(**loop, with);
    ASSERT_TRUE(inspector) << inspector.error().message();
    (*inspector)->start(ear);
    ASSERT_TRUE((*inspector)->submit(1, frames.lend()));
    ASSERT_TRUE((*inspector)->submit(2, frames.lend()));
    ASSERT_TRUE((*loop)->run());
    EXPECT_EQ(ear.answers.size(), 2U);
    EXPECT_EQ(ear.thread, std::this_thread::get_id());
    EXPECT_EQ(frames.given_back, 2);
}

// As from a loop's thread under SCHED_FIFO, whose policy its threads would have. Everyone may set SCHED_BATCH.
TEST(ThreadedInspector, its_threads_are_scheduled_as_ordinary_ones) {
    auto loop = SdEventLoop::open();
    ASSERT_TRUE(loop);
    FlatFrames frames;
    Ear ear;
    ear.then = [&] { (*loop)->request_stop(); };
    std::atomic<int> policy{-1};
    std::vector<InspectFunction> judges{[&](std::uint32_t, const hal::FrameLease&) {
        policy = ::sched_getscheduler(0);
        return Judged{};
    }};
    auto inspector = make_threaded_inspector(**loop, 1, std::move(judges), {});
    const sched_param none{};
    ASSERT_EQ(::sched_setscheduler(0, SCHED_BATCH, &none), 0);
    inspector->start(ear);
    ASSERT_EQ(::sched_setscheduler(0, SCHED_OTHER, &none), 0);
    ASSERT_TRUE(inspector->submit(1, frames.lend()));
    ASSERT_TRUE((*loop)->run());
    EXPECT_EQ(policy, SCHED_OTHER);
}

// The first frame is being judged and waits for the test; the queue holds two more.
TEST(ThreadedInspector, a_full_queue_refuses_and_stop_gives_every_frame_back) {
    auto loop = SdEventLoop::open();
    ASSERT_TRUE(loop);
    FlatFrames frames;
    Ear ear;
    std::promise<void> begun, may_end;
    std::vector<InspectFunction> judges;
    judges.emplace_back([&, ending = may_end.get_future().share()](std::uint32_t part, const hal::FrameLease&) {
        if (part == 1) begun.set_value();
        ending.wait();
        return Judged{};
    });
    auto inspector = make_threaded_inspector(**loop, 2, std::move(judges));
    inspector->start(ear);
    ASSERT_TRUE(inspector->submit(1, frames.lend()));
    begun.get_future().wait();
    EXPECT_TRUE(inspector->submit(2, frames.lend()));
    EXPECT_TRUE(inspector->submit(3, frames.lend()));
    const auto fourth = inspector->submit(4, frames.lend());
    ASSERT_FALSE(fourth);
    EXPECT_EQ(fourth.error().code, ErrorCode::busy);
    may_end.set_value();
    inspector->stop();
    EXPECT_EQ(frames.given_back, 4);
    (*loop)->request_stop();
    ASSERT_TRUE((*loop)->run());
    EXPECT_TRUE(ear.answers.empty()) << "nothing reaches the listener after stop()";
}

TEST(ThreadedInspector, can_be_started_again) {
    auto loop = SdEventLoop::open();
    ASSERT_TRUE(loop);
    FlatFrames frames;
    Ear ear;
    ear.then = [&] { (*loop)->request_stop(); };
    auto with = settings();
    with.threads = 0;  // one is made all the same
    auto inspector = make_threaded_inspector(**loop, with);
    ASSERT_TRUE(inspector);
    (*inspector)->start(ear);
    (*inspector)->stop();
    (*inspector)->start(ear);
    ASSERT_TRUE((*inspector)->submit(9, frames.lend()));
    ASSERT_TRUE((*loop)->run());
    ASSERT_EQ(ear.answers.size(), 1U);
    EXPECT_EQ(ear.answers[0].part, 9U);
}

TEST(ThreadedInspector, that_is_stopped_does_not_begin_by_itself_with_another_recipe) {
    lab::VirtualTime loop;
    FlatFrames frames;
    Ear ear;
    auto inspector = make_threaded_inspector(loop, settings());
    ASSERT_TRUE(inspector);
    (*inspector)->start(ear);
    (*inspector)->stop();
    ASSERT_TRUE((*inspector)->use(algo::Recipe{}, 5));
    EXPECT_EQ((*inspector)->submit(1, frames.lend()).error().code, ErrorCode::disconnected);
}

// The watchdog depends on it: while one of two threads hangs, no call is answered, even if repeated.
TEST(ThreadedInspector, a_roll_call_is_answered_when_every_thread_has_taken_a_turn) {
    auto loop = SdEventLoop::open();
    ASSERT_TRUE(loop);
    FlatFrames frames;
    Ear ear;
    std::promise<void> begun, may_end;
    const auto ending = may_end.get_future().share();
    std::vector<InspectFunction> judges(2, [&](std::uint32_t part, const hal::FrameLease&) {
        if (part == 1) {
            begun.set_value();
            ending.wait();
        }
        return Judged{};
    });
    auto inspector = make_threaded_inspector(**loop, 2, std::move(judges));
    int answered = 0;
    const auto call = [&] {
        inspector->liveness_check([&] {
            ++answered;
            (*loop)->request_stop();
        });
    };
    call();
    EXPECT_EQ(answered, 1);  // answered at once before start(): no thread to check
    inspector->start(ear);
    ASSERT_TRUE(inspector->submit(1, frames.lend()));
    begun.get_future().wait();
    call();
    ear.then = [&] { (*loop)->request_stop(); };
    ASSERT_TRUE(inspector->submit(2, frames.lend()));  // the other thread goes on working
    ASSERT_TRUE((*loop)->run());
    EXPECT_EQ(answered, 1);
    ear.then = [] {};
    call();
    may_end.set_value();
    while (answered == 1) ASSERT_TRUE((*loop)->run());
    EXPECT_EQ(answered, 2);
    inspector->stop();
}

TEST(ThreadedInspector, judges_with_another_recipe_when_told_and_with_the_old_one_when_that_is_bad) {
    auto loop = SdEventLoop::open();
    ASSERT_TRUE(loop);
    FlatFrames frames;
    Ear ear;
    ear.then = [&] { (*loop)->request_stop(); };
    auto inspector = make_threaded_inspector(**loop, settings());
    ASSERT_TRUE(inspector);
    (*inspector)->start(ear);
    algo::Recipe bad;
    bad.rim_margin = 1000;
    EXPECT_EQ((*inspector)->use(bad, 4).error().code, ErrorCode::invalid_argument);
    ASSERT_TRUE((*inspector)->submit(1, frames.lend()));
    ASSERT_TRUE((*loop)->run());
    ASSERT_TRUE((*inspector)->use(algo::Recipe{}, 5));
    ASSERT_TRUE((*inspector)->submit(2, frames.lend()));
    ASSERT_TRUE((*loop)->run());
    ASSERT_EQ(ear.answers.size(), 2U);
    EXPECT_EQ(ear.answers[0].recipe, kNoNumber);
    EXPECT_EQ(ear.answers[1].recipe, 5);
}

}  // namespace
}  // namespace hord::firmware
