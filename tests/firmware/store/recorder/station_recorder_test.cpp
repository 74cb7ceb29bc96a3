// What the station reports, as it stands in the store.
#include "firmware/store/recorder/station_recorder.h"

#include "lab/virtual_time/virtual_time.h"
#include "tests/firmware/store/results/samples.h"

namespace hord::firmware::store::test {
namespace {

using ::testing::ElementsAre;
using ::testing::HasSubstr;
using ::testing::IsEmpty;
using ::testing::SizeIs;

class Recorder : public ::testing::Test {
  protected:
    TempFolder folder;
    lab::VirtualTime clock;
    UtcMicros utc = kNoon;
    bool disk_works = true;
    std::unique_ptr<StationRecorder> recorder;
    Frame frame{9, 9, 8};

    void SetUp() override {
        StationRecorderOptions options;
        options.start = start();
        options.queue.thread = false;
        options.ignored_part = 99;
        const auto open = [this]() -> Result<std::unique_ptr<ResultStore>> {
            if (!disk_works) return fail(ErrorCode::io, "no disk", "find one");
            return open_sqlite_store(folder.path());
        };
        recorder = std::make_unique<StationRecorder>(
            clock, [this] { return utc; }, open, options, StoreQueue::Listener{}, nullptr);
    }
    void inspected(std::uint32_t part, const std::vector<algo::Defect>& defects) {
        algo::Inspection inspection;
        inspection.defects = defects;
        recorder->on_inspection(part, frame.view(), inspection);
    }
    void result_of(std::uint32_t part, hal::Duration ago = {}) {
        PartResult result;
        result.part = part;
        result.sequence = ++sequence;
        result.arrived_ns = (clock.now() - ago).time_since_epoch().count();
        recorder->on_result(result);
    }
    static algo::Defect at(float m) { return {m, 1, 2, 3, algo::DefectKind::scratch}; }
    std::uint32_t sequence = 0;
};

TEST_F(Recorder, a_result_has_the_defects_of_its_own_inspection_and_the_time_of_its_edge) {
    inspected(5, {at(50)});
    inspected(6, {at(60), at(61)});
    inspected(7, {});
    clock.run_for(std::chrono::seconds(2));
    result_of(6, std::chrono::milliseconds(300));
    result_of(5);
    result_of(7);
    result_of(5);
    ASSERT_TRUE(recorder->step());
    const auto all = results(folder);
    ASSERT_THAT(all, SizeIs(4));
    EXPECT_EQ(all[0].time_us, kNoon - 300'000);
    EXPECT_THAT(all[0].defects, ::testing::AllOf(HasSubstr("\"m\":60"), HasSubstr("\"m\":61")));
    EXPECT_EQ(all[1].time_us, kNoon);
    EXPECT_THAT(all[1].defects, HasSubstr("\"m\":50"));
    EXPECT_EQ(all[2].defects, "[]");
    EXPECT_EQ(all[3].defects, "[]") << "defects belong to one result";
    EXPECT_EQ(all[0].boot, 7U);
    EXPECT_EQ(changes(folder).at(0).time_us, kNoon) << "the run begins now";
}

TEST_F(Recorder, an_inspection_that_has_its_result_is_forgotten) {
    for (const float m : {50.0F, 51.0F}) {
        inspected(5, {at(m)});
        result_of(5);
    }
    ASSERT_TRUE(recorder->step());
    EXPECT_THAT(results(folder).at(1).defects, HasSubstr("\"m\":51"));
}

TEST_F(Recorder, the_inspection_of_a_self_test_is_not_kept) {
    inspected(99, {at(1)});
    result_of(99);
    ASSERT_TRUE(recorder->step());
    EXPECT_EQ(results(folder).at(0).defects, "[]");
}

TEST_F(Recorder, defects_of_parts_whose_result_never_comes_are_forgotten_the_oldest_first) {
    for (std::uint32_t part = 1000; part < 1513; ++part) inspected(part, {at(7)});
    result_of(1000);
    result_of(1001);
    result_of(1512);
    ASSERT_TRUE(recorder->step());
    const auto all = results(folder);
    EXPECT_EQ(all.at(0).defects, "[]");
    EXPECT_NE(all.at(1).defects, "[]");
    EXPECT_NE(all.at(2).defects, "[]");
}

TEST_F(Recorder, changes_are_recorded_with_who_made_them) {
    using What = Change::What;
    recorder->on_change({What::command, {"10.0.0.1:5 for anna", 77}, "arm", "Initialized", "completed"});
    recorder->on_change({What::recipe, {"10.0.0.2:6", 78}, "lens", "old", "new"});
    recorder->on_change({What::configuration, {"10.0.0.3:7", 79}, "hordd.toml", "a", "b"});
    ASSERT_TRUE(recorder->step());
    std::vector<std::string> told;
    for (const StoredChange& c : changes(folder)) {
        if (c.what != "start")
            told.push_back(c.what + " " + c.peer + " " + std::to_string(c.token) + " " + c.name + " " + c.before + " " +
                           c.after);
    }
    EXPECT_THAT(told,
                ElementsAre("command 10.0.0.1:5 for anna 77 arm Initialized completed",
                            "recipe 10.0.0.2:6 78 lens old new", "configuration 10.0.0.3:7 79 hordd.toml a b"));
}

TEST_F(Recorder, what_is_in_use_is_recorded_when_it_is_new) {
    using What = ChangeRecord::What;
    recorder->in_use(What::recipe, "lens", "one");
    recorder->in_use(What::recipe, "lens", "one");
    recorder->in_use(What::recipe, "lens", "two");
    result_of(1);
    ASSERT_TRUE(recorder->step());
    std::vector<std::string> told;
    for (const StoredChange& c : changes(folder)) {
        if (c.what == "recipe") told.push_back(c.before + ">" + c.after);
    }
    EXPECT_THAT(told, ElementsAre(">one", "one>two"));
    EXPECT_EQ(results(folder).at(0).recipe, "lens");
}

TEST_F(Recorder, a_result_is_acknowledged_when_it_is_stored) {
    result_of(1);
    EXPECT_EQ(recorder->on_acknowledged({"plc", 0}, 1), AckStatus::not_yet);
    ASSERT_TRUE(recorder->step());
    EXPECT_EQ(recorder->state().durable_sequence, 1U);
    EXPECT_EQ(recorder->on_acknowledged({"plc", 0}, 1), AckStatus::recorded);
}

TEST_F(Recorder, its_end_names_what_is_in_no_store) {
    result_of(1);
    ASSERT_TRUE(recorder->step());
    EXPECT_THAT(recorder->finish(), IsEmpty());
    SetUp();
    disk_works = false;
    sequence = 10;
    result_of(1);
    result_of(2);
    EXPECT_FALSE(recorder->step());
    const auto lost = recorder->finish();
    ASSERT_THAT(lost, SizeIs(1));
    EXPECT_THAT(lost[0].what, HasSubstr("2 results (sequences 11 to 12)"));
    EXPECT_THAT(lost[0].cure, HasSubstr("no disk"));
}

// -- as the configuration wants it

}  // namespace
}  // namespace hord::firmware::store::test
