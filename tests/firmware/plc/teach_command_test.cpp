// The command teach in every state: when it is accepted, what a PLC reads meanwhile, when the reference comes into use,
// what cancels it.
#include <gmock/gmock.h>

#include "tests/firmware/plc/plc_commands.h"

namespace hord::firmware {
namespace {

using modbus::Exception;
using ::testing::ElementsAre;
using ::testing::HasSubstr;
using State = firmware::State;

// A TeachIn controlled by the test.
class RecordingTeachIn final : public TeachIn {
  public:
    Result<void> answer;
    std::vector<std::uint32_t> begun;
    int cancelled = 0;
    std::vector<std::string> discarded, used;

    // The learned recipe; its name stands for the reference's content.
    NumberedRecipe comes_to(std::string remarks = {}, int rim_margin = -1) {
        TeachResult taught{recipe_, std::move(remarks)};
        taught.recipe.recipe.name = "taught";
        taught.recipe.recipe.rim_margin = rim_margin;
        const NumberedRecipe recipe = taught.recipe;
        listener_.done(std::move(taught));
        return recipe;
    }
    void fails(Error error) { listener_.done(tl::unexpected(std::move(error))); }
    void takes(std::uint32_t parts) { listener_.taken(parts); }

    Result<void> begin(std::uint32_t parts, const NumberedRecipe& recipe, Listener listener) override {
        if (!answer) return answer;
        begun.push_back(parts);
        recipe_ = recipe;
        listener_ = std::move(listener);
        return {};
    }
    void cancel() override { ++cancelled; }
    void discard(const NumberedRecipe& taught) override { discarded.push_back(taught.recipe.name); }
    void in_use(const NumberedRecipe& recipe) override { used.push_back(recipe.recipe.name); }

  private:
    NumberedRecipe recipe_;
    Listener listener_;
};

class Teach : public PlcCommands {
  protected:
    Teach() { teacher = &told; }
    // Reads the reply to the teach command by writing its token again, also after other commands.
    CommandError reply_to(std::uint32_t asked, std::uint32_t parts = 0) {
        EXPECT_EQ(send(asked, Command::teach, parts), Exception::none);
        EXPECT_EQ(read32(8022), asked);
        return static_cast<CommandError>(read(8026, 1)[0]);
    }
    const Change* recorded(Change::What what) const {
        const auto found =
            std::find_if(notes.changes.rbegin(), notes.changes.rend(), [&](const Change& c) { return c.what == what; });
        return found == notes.changes.rend() ? nullptr : &*found;
    }
    RecordingTeachIn told;
};

TEST_F(Teach, is_not_supported_where_nothing_can_be_learned) {
    teacher = nullptr;
    open();
    ready();
    EXPECT_EQ(command(Command::teach), CommandError::not_supported);
}

TEST_F(Teach, takes_as_many_parts_as_it_is_told_from_8_to_64_and_16_when_it_is_not) {
    open();
    ready();
    for (const std::uint32_t bad : {1U, 7U, 65U, 0x10010U})
        EXPECT_EQ(command(Command::teach, bad), CommandError::bad_argument);
    for (const std::uint32_t good : {0U, 8U, 64U}) {
        EXPECT_EQ(command(Command::teach, good), CommandError::none);
        EXPECT_EQ(reply_state(), CommandState::executing);
        EXPECT_EQ(command(Command::abort), CommandError::none);
    }
    EXPECT_THAT(told.begun, ElementsAre(16U, 8U, 64U));
}

TEST_F(Teach, is_accepted_wherever_parts_come_or_can_be_started) {
    open();
    EXPECT_EQ(command(Command::teach), CommandError::not_in_this_state);  // Preoperational
    EXPECT_EQ(command(Command::initialise), CommandError::none);
    EXPECT_EQ(command(Command::teach), CommandError::none);
    EXPECT_EQ(command(Command::abort), CommandError::none);
    devices_up();
    EXPECT_EQ(command(Command::arm), CommandError::none);
    EXPECT_EQ(command(Command::start_single), CommandError::none);
    EXPECT_EQ(command(Command::teach), CommandError::none);
    EXPECT_EQ(command(Command::halt), CommandError::none);
    EXPECT_EQ(command(Command::teach), CommandError::not_in_this_state);  // Halted
    EXPECT_EQ(told.begun.size(), 2U);
}

TEST_F(Teach, only_one_at_a_time) {
    open();
    ready();
    EXPECT_EQ(command(Command::teach), CommandError::none);
    EXPECT_EQ(command(Command::teach), CommandError::not_yet);
    EXPECT_EQ(command(Command::abort), CommandError::none);
    told.answer = fail(ErrorCode::busy, "the end of another one", "wait");
    EXPECT_EQ(command(Command::teach), CommandError::not_yet);
    told.answer = fail(ErrorCode::io, "the disk is gone", "look for it");
    EXPECT_EQ(command(Command::teach), CommandError::failed);
    EXPECT_THAT(troubles.back(), HasSubstr("the disk is gone"));
    EXPECT_EQ(told.begun.size(), 1U);
}

TEST_F(Teach, goes_on_while_the_line_is_started_and_stopped_and_shows_how_far_it_is) {
    open();
    ready();
    EXPECT_EQ(command(Command::teach), CommandError::none);
    const std::uint32_t asked = token;
    EXPECT_EQ(command(Command::start_continuous), CommandError::none);
    told.takes(5);
    EXPECT_EQ(command(Command::stop), CommandError::none);
    EXPECT_EQ(command(Command::disarm), CommandError::none);
    EXPECT_EQ(told.cancelled, 0);
    EXPECT_EQ(reply_to(asked), CommandError::none);
    EXPECT_EQ(reply_state(), CommandState::executing);
    EXPECT_EQ(read32(8027), 5U);
    EXPECT_EQ(told.begun.size(), 1U);  // the repeated token began nothing
}

TEST_F(Teach, what_was_taught_is_in_use_at_once_where_the_line_stands_and_the_record_says_who_asked) {
    open();
    ready();
    EXPECT_EQ(command(Command::teach, 9), CommandError::none);
    const std::uint32_t asked = token;
    const NumberedRecipe taught = told.comes_to();
    EXPECT_EQ(reply_to(asked, 9), CommandError::none);
    EXPECT_EQ(reply_state(), CommandState::completed);
    EXPECT_EQ(read32(8027), crc32_of(taught));
    EXPECT_EQ(operations.recipe().recipe.name, "taught");
    const Change* change = recorded(Change::What::recipe);
    ASSERT_NE(change, nullptr);
    EXPECT_EQ(change->who.peer, "192.0.2.7:50123");
    EXPECT_EQ(change->who.token, asked);
    EXPECT_THAT(change->before, HasSubstr("name = \"default\""));
    EXPECT_THAT(change->after, HasSubstr("name = \"taught\""));
    const Change* ended = recorded(Change::What::command);
    ASSERT_NE(ended, nullptr);
    EXPECT_EQ(ended->name, "teach");
    EXPECT_EQ(ended->after, "completed");
    EXPECT_EQ(ended->who.token, asked);
}

TEST_F(Teach, no_recipe_changes_while_parts_are_under_way) {
    open();
    running();
    EXPECT_EQ(command(Command::teach), CommandError::none);
    const std::uint32_t asked = token;
    part();
    const NumberedRecipe taught = told.comes_to();
    pass(milliseconds(50));
    EXPECT_EQ(reply_to(asked), CommandError::none);
    EXPECT_EQ(reply_state(), CommandState::completed);  // learned and kept ...
    EXPECT_EQ(read32(8027), crc32_of(taught));
    EXPECT_EQ(operations.recipe().recipe.name, "default");  // ... and not yet in use
    EXPECT_EQ(command(Command::teach), CommandError::not_yet);
    EXPECT_EQ(command(Command::abort), CommandError::none);  // the teach has ended: nothing to cancel
    EXPECT_EQ(state(), State::ready);
    pass(milliseconds(100));
    EXPECT_EQ(station->core().line().size(), 1U);
    EXPECT_EQ(operations.recipe().recipe.name, "default");
    pass(milliseconds(250));  // at the ejector
    rejector.listener->on_reject({1, hal::RejectReport::Outcome::confirmed, loop.now()});
    pass(milliseconds(500));
    EXPECT_EQ(station->core().line().size(), 0U);
    EXPECT_EQ(operations.recipe().recipe.name, "taught");
    EXPECT_EQ(recorded(Change::What::recipe)->who.token, asked);
    EXPECT_EQ(told.cancelled, 0);
    EXPECT_EQ(command(Command::teach), CommandError::none);
}

TEST_F(Teach, names_the_parts_that_were_left_out_in_the_reply_as_far_as_they_fit) {
    open();
    ready();
    EXPECT_EQ(command(Command::teach), CommandError::none);
    EXPECT_EQ(remarks(), "");
    std::uint32_t asked = token;
    (void)told.comes_to("part 12 was left out: it differs from all others");
    EXPECT_EQ(reply_to(asked), CommandError::none);
    EXPECT_EQ(remarks(), "part 12 was left out: it differs from all others");
    EXPECT_EQ(command(Command::disarm), CommandError::none);  // another command has none
    EXPECT_EQ(remarks(), "");
    EXPECT_EQ(reply_to(asked), CommandError::none);  // repeated: the same reply
    EXPECT_EQ(remarks(), "part 12 was left out: it differs from all others");

    EXPECT_EQ(command(Command::teach), CommandError::none);
    asked = token;
    const std::string about = std::string(106, 'x') + "\u00E4 and much more";  // the letter takes bytes 106 and 107
    (void)told.comes_to(about);
    EXPECT_EQ(reply_to(asked), CommandError::none);
    EXPECT_EQ(remarks(), std::string(106, 'x') + "... (journal)");
    EXPECT_THAT(troubles.back(), HasSubstr(about));  // the journal has it all
}

TEST_F(Teach, that_fails_says_why_and_the_old_recipe_stays) {
    open();
    running();
    EXPECT_EQ(command(Command::teach), CommandError::none);
    const std::uint32_t asked = token;
    told.fails({ErrorCode::io, "the disk is full", "make room"});
    EXPECT_EQ(reply_to(asked), CommandError::failed);
    EXPECT_EQ(remarks(), "the disk is full: make room");
    EXPECT_THAT(troubles, ElementsAre("the disk is full: make room"));
    EXPECT_EQ(recorded(Change::What::command)->after, "failed failed");
    EXPECT_EQ(recorded(Change::What::recipe), nullptr);
    EXPECT_EQ(operations.recipe().recipe.name, "default");
    EXPECT_EQ(command(Command::teach), CommandError::none);  // another may be tried
}

TEST_F(Teach, what_the_inspector_cannot_judge_with_is_discarded) {
    open();
    ready();
    EXPECT_EQ(command(Command::teach), CommandError::none);
    const std::uint32_t asked = token;
    (void)told.comes_to({}, 4);
    EXPECT_EQ(reply_to(asked), CommandError::failed);
    EXPECT_EQ(operations.recipe().recipe.name, "default");
    EXPECT_THAT(told.discarded, ElementsAre("taught"));
    EXPECT_EQ(troubles.size(), 1U) << "and why";
}

TEST_F(Teach, names_the_parts_that_were_left_out) {
    open();
    ready();
    EXPECT_EQ(command(Command::teach), CommandError::none);
    (void)told.comes_to("part 12 was left out: it differs from all others");
    ASSERT_EQ(troubles.size(), 1U);
    EXPECT_THAT(troubles[0], HasSubstr("part 12"));
}

TEST_F(Teach, is_ended_by_an_abort_and_by_a_halt_and_says_so) {
    open();
    running();
    for (const Command by : {Command::abort, Command::halt}) {
        EXPECT_EQ(command(Command::teach), CommandError::none);
        const std::uint32_t asked = token;
        EXPECT_EQ(command(by), CommandError::none);
        EXPECT_EQ(reply_to(asked), CommandError::cancelled);
        EXPECT_EQ(reply_state(), CommandState::failed);
        if (state() == State::ready) {
            EXPECT_EQ(command(Command::start_continuous), CommandError::none);
        }
    }
    EXPECT_EQ(state(), State::halted);
    EXPECT_EQ(told.cancelled, 2);
    EXPECT_THAT(troubles.back(), HasSubstr("halt was commanded"));
    EXPECT_EQ(operations.recipe().recipe.name, "default");
}

TEST_F(Teach, can_be_aborted_where_nothing_else_could_be) {
    open();
    ready();
    EXPECT_EQ(command(Command::abort), CommandError::not_in_this_state);
    EXPECT_EQ(command(Command::teach), CommandError::none);
    EXPECT_EQ(command(Command::abort), CommandError::none);
    EXPECT_EQ(state(), State::ready);
    EXPECT_EQ(told.cancelled, 1);
    EXPECT_EQ(command(Command::abort), CommandError::not_in_this_state);
}

TEST_F(Teach, outlives_an_error_and_its_reset) {
    open();
    running();
    EXPECT_EQ(command(Command::teach), CommandError::none);
    const std::uint32_t asked = token;
    sensor.listener->on_sensor_lost({ErrorCode::disconnected, "/dev/video0", "plug it in"});
    publish();
    EXPECT_EQ(state(), State::error);
    EXPECT_EQ(command(Command::teach), CommandError::not_in_this_state);
    EXPECT_EQ(command(Command::reset), CommandError::none);
    EXPECT_EQ(reply_to(asked), CommandError::none);
    EXPECT_EQ(reply_state(), CommandState::executing);
    EXPECT_EQ(told.cancelled, 0);
}

TEST_F(Teach, is_about_the_recipe_in_use_and_ends_with_it) {
    open();
    ready();
    EXPECT_EQ(command(Command::teach), CommandError::none);
    const std::uint32_t asked = token;
    EXPECT_EQ(command(Command::use_recipe, 8), CommandError::no_such_recipe);
    EXPECT_EQ(told.cancelled, 0);
    EXPECT_EQ(command(Command::use_recipe, 7), CommandError::none);
    EXPECT_EQ(told.cancelled, 1);
    EXPECT_EQ(reply_to(asked), CommandError::cancelled);
    EXPECT_EQ(operations.recipe().recipe.name, "seven");
}

TEST_F(Teach, what_waits_for_the_line_to_stop_is_dropped_when_another_recipe_is_taken) {
    open();
    running();
    EXPECT_EQ(command(Command::teach), CommandError::none);
    part();
    (void)told.comes_to();
    EXPECT_EQ(command(Command::abort), CommandError::none);
    EXPECT_EQ(command(Command::use_recipe, 7), CommandError::none);
    EXPECT_THAT(told.discarded, ElementsAre("taught"));
    pass(milliseconds(1500));
    EXPECT_EQ(operations.recipe().recipe.name, "seven");
    EXPECT_THAT(troubles.back(), HasSubstr("recipe 7 was taken"));
}

}  // namespace
}  // namespace hord::firmware
