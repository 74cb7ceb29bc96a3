// Carries out what a PLC, or anybody else who may write registers, asks of the station.
//
// The desk (plc_interface.h) has made sure that it comes once; here it happens: the state machine's commands, the
// recipe in use, the self-test, teaching, and what the PLC's heartbeat and acknowledgements mean. Loop thread only.
// Every command and every change of the recipe is told to the recorder with who asked for it.
#pragma once

#include <functional>
#include <string>

#include "drivers/hal/event_loop.h"
#include "firmware/plc/plc_interface.h"
#include "firmware/recipes/recipe_file.h"
#include "firmware/recipes/teach_in.h"
#include "firmware/station/inspector.h"
#include "firmware/station/result_sink.h"
#include "firmware/station/station.h"

namespace hord::firmware {

// A recipe as eight registers, and back: limits come from the registers; zones, light levels and the name from `base`.
StagedRecipe staged_from(const NumberedRecipe& recipe);
NumberedRecipe with_staged(NumberedRecipe base, const StagedRecipe& staged);

class CommandHandler final : public PlcHandler {
  public:
    explicit CommandHandler(hal::EventLoop& loop) : loop_(loop) {}
    ~CommandHandler() override;
    CommandHandler(const CommandHandler&) = delete;
    CommandHandler& operator=(const CommandHandler&) = delete;

    // What it works on. All outlive it; what is empty is left out.
    struct Dependencies {
        Station& station;
        Inspector& inspector;
        PlcInterface& desk;
        ResultSink* recorder = nullptr;
        TeachIn* teacher = nullptr;                          // none: teach is not supported
        std::function<Result<void>()> check_judgement = {};  // part of the self-test
        std::function<Result<NumberedRecipe>(std::uint16_t number)> recipe =
            {};  // the recipe of this number; not_found: there is none
        std::function<void(const NumberedRecipe&)> recipe_changed = {};  // it is in use from now on
        std::function<void()> publish = {};              // registers follow before a command is answered
        std::function<void(const Error&)> trouble = {};  // to be logged, once
    };
    // `recipe` is what the inspector judges with. Before the loop runs.
    void begin(Dependencies works, NumberedRecipe recipe);

    [[nodiscard]] const NumberedRecipe& recipe() const { return recipe_; }

    // Judges with another recipe. Fails, and the old one stays, with refused (the station executes) and with what the
    // pipeline says of the recipe.
    // A teach that is under way is cancelled, and what was taught and waits is dropped: that was about the old one.
    Result<void> use(const Who& who, NumberedRecipe recipe);

    // Judges with what was taught, once the station does not execute and the line is empty. To be called whenever that
    // may have come about. Fails with what the inspector says; then the old recipe stays.
    Result<void> use_learned_reference();

    CommandOutcome on_command(const modbus::Origin& origin, const CommandRequest& request) override;
    CommandOutcome on_recipe(const modbus::Origin& origin, const CommandRequest& request,
                             const StagedRecipe& staged) override;
    modbus::Exception on_acknowledged(const modbus::Origin& origin, std::uint32_t sequence) override;
    void on_plc_lost(PlcPolicy policy) override;
    void on_plc_back() override;

  private:
    [[nodiscard]] CommandOutcome carry_out(const Who& who, const CommandRequest& request);
    [[nodiscard]] CommandOutcome use_recipe(const Who& who, const CommandRequest& request);
    [[nodiscard]] CommandOutcome self_test(const Who& who, const CommandRequest& request);
    [[nodiscard]] CommandOutcome used(const Result<void>& done);
    [[nodiscard]] CommandOutcome teach(const Who& who, const CommandRequest& request);
    void taught(Result<TeachResult> result);
    void end_teach(const CommandOutcome& outcome);
    bool cancel_teach(const std::string& why);
    Result<void> take(const Who& who, NumberedRecipe recipe);
    void record(const Who& who, const CommandRequest& request, State before, const CommandOutcome& outcome);
    void report(const Error& error) const;

    hal::EventLoop& loop_;
    std::optional<Dependencies> works_;
    NumberedRecipe recipe_;
    struct Teach {
        Who who;
        CommandRequest request;
        State before = State::preoperational;
        std::uint32_t parts = 0;
    };
    std::optional<Teach> teach_;  // under way
    struct Waiting {
        Who who;
        NumberedRecipe recipe;
    };
    std::optional<Waiting> waiting_;  // taught, and in use as soon as the line is empty
};

}  // namespace hord::firmware
