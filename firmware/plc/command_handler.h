// Executes commands that arrive by registers: the state machine's, recipes, self-test, teach; and handles the PLC's
// heartbeat and acknowledgements.
//
// PlcInterface (plc_interface.h) has removed repetitions. Loop thread only. Every command and every change of the
// recipe is recorded with the one who asked.
#pragma once

#include <functional>
#include <string>

#include "firmware/plc/plc_interface.h"
#include "firmware/recipes/recipe_file.h"
#include "firmware/recipes/teach_in.h"
#include "firmware/station/inspector.h"
#include "firmware/station/result_sink.h"
#include "firmware/station/station.h"

namespace hord::firmware {

class CommandHandler final : public PlcHandler {
  public:
    // All outlive this object. Null and empty members are optional.
    struct Dependencies {
        Station& station;
        Inspector& inspector;
        PlcInterface& plc_interface;
        algo::Extents extents;  // of the inspector's light field
        ResultSink* recorder = nullptr;
        TeachIn* teacher = nullptr;                                               // null: teach is not supported
        std::function<Result<void>()> check_judgement = {};                       // part of the self-test
        std::function<Result<NumberedRecipe>(std::uint16_t number)> recipe = {};  // fails with not_found
        std::function<void(const NumberedRecipe&)> recipe_changed = {};  // called after the recipe in use has changed
        std::function<Result<void>(const NumberedRecipe&)> keep = {};    // writes it: a restart uses it again
        std::function<void()> publish = {};              // updates the registers; called before a command is answered
        std::function<void(const Error&)> trouble = {};  // logs an error, once
    };
    // `recipe`: in use by the inspector, and kept by the caller. To be called before the loop runs.
    void begin(Dependencies dependencies, NumberedRecipe recipe);

    [[nodiscard]] const NumberedRecipe& recipe() const { return recipe_; }

    // Switches to another recipe. A running teach is cancelled and a waiting learned reference is discarded, because
    // they belong to the old recipe. Fails with refused (the station executes), the pipeline's error, or io if a
    // restart would not use it again; the old recipe stays.
    Result<void> use(const RequestOrigin& who, NumberedRecipe recipe);

    // Switches to the learned reference if one waits, the station does not execute and the line is empty; else does
    // nothing. Call it when that may have become true. Fails with the inspector's error; the old recipe stays. Where
    // `keep` fails the teach-in's own file still serves a restart: that is reported.
    Result<void> use_learned_reference();

    CommandOutcome on_command(const modbus::Origin& origin, const CommandRequest& request) override;
    modbus::Exception on_acknowledged(const modbus::Origin& origin, std::uint32_t sequence) override;
    void on_plc_lost(PlcPolicy policy) override;
    void on_plc_back() override;

  private:
    [[nodiscard]] CommandOutcome carry_out(const RequestOrigin& who, const CommandRequest& request);
    [[nodiscard]] CommandOutcome use_recipe(const RequestOrigin& who, const CommandRequest& request);
    [[nodiscard]] CommandOutcome self_test(const RequestOrigin& who, const CommandRequest& request);
    [[nodiscard]] CommandOutcome outcome_of_use(const Result<void>& done);
    [[nodiscard]] CommandOutcome commit_recipe(const RequestOrigin& who, const StagedRecipe& staged);
    [[nodiscard]] CommandOutcome teach(const RequestOrigin& who, const CommandRequest& request);
    void on_learned(Result<TeachResult> result);
    void end_teach(const CommandOutcome& outcome);
    bool cancel_teach(const std::string& why);
    void adopt(const RequestOrigin& who, NumberedRecipe recipe);
    [[nodiscard]] Result<void> keep(const NumberedRecipe& recipe) const;
    void record(const RequestOrigin& who, const CommandRequest& request, State before, const CommandOutcome& outcome);
    [[nodiscard]] CommandOutcome refuse(CommandError error, const Error& why) const;
    void report(const Error& error) const;

    std::optional<Dependencies> dependencies_;
    NumberedRecipe recipe_;
    struct RunningTeach {
        RequestOrigin who;
        CommandRequest request;
        State before = State::preoperational;
        std::uint32_t parts = 0;
    };
    std::optional<RunningTeach> running_teach_;  // under way
    struct PendingReference {
        RequestOrigin who;
        NumberedRecipe recipe;
    };
    std::optional<PendingReference> pending_reference_;  // learned; used as soon as the line is empty
};

}  // namespace hord::firmware
