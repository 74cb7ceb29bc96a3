#include "firmware/plc/command_handler.h"

#include <algorithm>
#include <utility>

#include <fmt/format.h>

#include "common/utf8.h"
#include "firmware/core/faults.h"
#include "firmware/core/states.h"
#include "firmware/plc/staged_recipe.h"
#include "firmware/recipes/recipe_folder.h"
#include "firmware/recipes/reference_file.h"

namespace hord::firmware {
namespace {

// Longest time for a flash, its frame and its judgement.
constexpr Duration kTestPatience = milliseconds(2000);

constexpr CommandOutcome done(std::uint32_t result = 0) {
    return {CommandState::completed, CommandError::none, result};
}
constexpr CommandOutcome failed(CommandError error, std::uint32_t result = 0) {
    return {CommandState::failed, error, result};
}

CommandOutcome outcome_of(Answer answer) {
    switch (answer) {
        case Answer::done: return done();
        case Answer::not_in_this_state: return failed(CommandError::not_in_this_state);
        case Answer::device_down: return failed(CommandError::device_down);
        case Answer::plc_lost: return failed(CommandError::plc_lost);
        case Answer::not_yet: return failed(CommandError::not_yet);
    }
    return failed(CommandError::failed);
}

// The value's name, or its number if it has none.
template <class E>
std::string name_or_number(E value) {
    const std::string_view name = name_of(value);
    return name == "unknown" ? fmt::format("{}", static_cast<int>(value)) : std::string(name);
}

RequestOrigin who_asked(const modbus::Origin& origin) { return {std::string(origin.peer), 0}; }
// "127.0.0.1:50123 for anna": the name that the sender gives is recorded beside its address.
RequestOrigin who_asked(const modbus::Origin& origin, const CommandRequest& request) {
    const std::string_view name = request.who.view();
    return {name.empty() ? std::string(origin.peer) : fmt::format("{} for {}", origin.peer, name), request.token};
}

constexpr std::uint16_t kMaxRecipeNumber = 0xFFFE;

// As much of an error as REPLY holds, in one line. A cure that fits behind the reason's first characters stays whole,
// and the reason is cut: a person acts by the cure. The journal has all.
RemarkText remark_of(const Error& error) {
    constexpr std::string_view kCut = "...: ", kRest = "... (journal)";
    constexpr std::size_t kMinReason = 40;
    std::string text = error.message();
    if (text.size() > kRemarkChars) {
        const std::size_t behind = kCut.size() + error.cure.size();
        if (!error.cure.empty() && kMinReason + behind <= kRemarkChars) {
            text = fmt::format("{}{}{}", common::utf8_prefix(error.what, kRemarkChars - behind), kCut, error.cure);
        } else {
            text = fmt::format("{}{}", common::utf8_prefix(text, kRemarkChars - kRest.size()), kRest);
        }
    }
    std::ranges::replace(text, '\n', ' ');
    return RemarkText(text);
}

// The file comes last: REPLY holds the reason rather than a path.
Error of_recipe(const NumberedRecipe& recipe, Error error) {
    const std::string reference = recipe.reference_file.string();
    error.what = fmt::format("recipe {}: {}{}", recipe.number, error.what,
                             reference.empty() ? "" : " (its reference: " + reference + ")");
    return error;
}

}  // namespace

void CommandHandler::begin(Dependencies dependencies, NumberedRecipe recipe) {
    dependencies_.emplace(std::move(dependencies));
    recipe_ = std::move(recipe);
    dependencies_->plc_interface.stage(staged_from(recipe_));
    if (dependencies_->recipe_changed) dependencies_->recipe_changed(recipe_);
}

// -- commands

CommandOutcome CommandHandler::on_command(const modbus::Origin& origin, const CommandRequest& request) {
    const RequestOrigin who = who_asked(origin, request);
    const State before = dependencies_->station.core().state();
    const CommandOutcome outcome = carry_out(who, request);
    if (outcome.state != CommandState::executing) record(who, request, before, outcome);
    if (dependencies_->publish) dependencies_->publish();
    return outcome;
}

CommandOutcome CommandHandler::carry_out(const RequestOrigin& who, const CommandRequest& request) {
    const auto command = static_cast<Command>(request.code);
    if (is_state_command(command)) {
        const bool ends_teach = command == Command::abort || command == Command::halt;
        const bool cancelled = ends_teach && cancel_teach(std::string(name_of(command)) + " was commanded");
        const Answer answer = dependencies_->station.request(command);
        // Nothing was on the line; the abort was for the teach.
        if (cancelled && command == Command::abort && answer == Answer::not_in_this_state) return done();
        return outcome_of(answer);
    }
    switch (command) {
        case Command::commit_recipe: return commit_recipe(who, dependencies_->plc_interface.view().staged);
        case Command::use_recipe: return use_recipe(who, request);
        case Command::self_test: return self_test(who, request);
        case Command::teach: return teach(who, request);
        default: return failed(CommandError::unknown_command);
    }
}

void CommandHandler::record(const RequestOrigin& who, const CommandRequest& request, State before,
                            const CommandOutcome& outcome) {
    if (dependencies_->recorder == nullptr) return;
    std::string after = name_or_number(outcome.state);
    if (outcome.error != CommandError::none) after += " " + name_or_number(outcome.error);
    dependencies_->recorder->on_change({Change::What::command, who, name_or_number(static_cast<Command>(request.code)),
                                        std::string(name_of(before)), after});
}

// The journal has the whole text, REPLY as much of it as it holds.
CommandOutcome CommandHandler::refuse(CommandError error, const Error& why) const {
    report(why);
    CommandOutcome outcome = failed(error);
    outcome.remarks = remark_of(why);
    return outcome;
}

void CommandHandler::report(const Error& error) const {
    if (dependencies_->trouble) dependencies_->trouble(error);
}

// -- recipes

Result<void> CommandHandler::use(const RequestOrigin& who, NumberedRecipe recipe) {
    const State state = dependencies_->station.core().state();
    if (executing(state)) {
        return fail(ErrorCode::refused,
                    fmt::format("recipe {} cannot be taken while the station executes", recipe.number),
                    "stop it first");
    }
    // The same checks as for a recipe file.
    if (auto checked = parse_numbered_recipe(format_recipe(recipe), fmt::format("recipe {}", recipe.number));
        !checked) {
        return tl::unexpected(checked.error());
    } else if (recipe.recipe.reference && crc32_of(checked->recipe.reference) != crc32_of(recipe.recipe.reference)) {
        // A restart would read the file, and find another recipe than the one that was in use.
        return fail(ErrorCode::invalid_argument,
                    fmt::format("recipe {}: its reference {} was replaced since it was read", recipe.number,
                                recipe.reference_file.string()),
                    "put the old one back, or select the recipe again");
    }
    const std::string why = fmt::format("recipe {} was taken", recipe.number);
    if (auto taken = dependencies_->inspector.use(recipe.recipe, recipe.number); !taken)
        return tl::unexpected(of_recipe(recipe, taken.error()));
    if (auto kept = keep(recipe); !kept) {
        if (const auto back = dependencies_->inspector.use(recipe_.recipe, recipe_.number); !back) report(back.error());
        return kept;
    }
    adopt(who, std::move(recipe));
    (void)cancel_teach(why);
    if (const auto dropped = std::exchange(pending_reference_, std::nullopt)) {
        dependencies_->teacher->discard(dropped->recipe);
        report({ErrorCode::refused, "what was taught is dropped before it came into use: " + why, "teach again"});
    }
    return {};
}

// Always io: `refused` would mean that the station executes.
Result<void> CommandHandler::keep(const NumberedRecipe& recipe) const {
    if (!dependencies_->keep) return {};
    return dependencies_->keep(recipe).map_error([](Error error) {
        error.code = ErrorCode::io;
        return error;
    });
}

// Shows and records the recipe that the inspector has accepted.
void CommandHandler::adopt(const RequestOrigin& who, NumberedRecipe recipe) {
    const NumberedRecipe before = std::exchange(recipe_, std::move(recipe));
    dependencies_->plc_interface.stage(staged_from(recipe_));
    if (dependencies_->recipe_changed) dependencies_->recipe_changed(recipe_);
    if (dependencies_->recorder != nullptr) {
        dependencies_->recorder->on_change(
            {Change::What::recipe, who, recipe_.recipe.name, recorded_recipe(before), recorded_recipe(recipe_)});
    }
}

CommandOutcome CommandHandler::outcome_of_use(const Result<void>& result) {
    if (result) return done(crc32_of(recipe_));
    switch (result.error().code) {
        case ErrorCode::refused: return refuse(CommandError::not_in_this_state, result.error());
        case ErrorCode::io: return refuse(CommandError::failed, result.error());
        default: return refuse(CommandError::bad_argument, result.error());
    }
}

CommandOutcome CommandHandler::commit_recipe(const RequestOrigin& who, const StagedRecipe& staged) {
    const bool unjudged = gives_unjudged_limit(recipe_, staged);
    const auto used = unjudged ? Result<void>() : use(who, with_staged(recipe_, staged));
    if (unjudged || (!used && used.error().code != ErrorCode::refused)) {
        const std::string bad = bad_registers(recipe_, staged, dependencies_->extents);
        if (!bad.empty()) return refuse(CommandError::bad_argument, {ErrorCode::invalid_argument, bad, ""});
    }
    return outcome_of_use(used);
}

CommandOutcome CommandHandler::use_recipe(const RequestOrigin& who, const CommandRequest& request) {
    if (!is_possible(dependencies_->station.core().state(), Command::use_recipe))
        return failed(CommandError::not_in_this_state);
    if (request.argument > kMaxRecipeNumber) {
        return refuse(
            CommandError::bad_argument,
            {ErrorCode::invalid_argument, fmt::format("argument (8006): no recipe has number {}", request.argument),
             fmt::format("use 0 to {}", kMaxRecipeNumber)});
    }
    if (!dependencies_->recipe) return failed(CommandError::no_such_recipe);
    auto recipe = dependencies_->recipe(static_cast<std::uint16_t>(request.argument));
    if (!recipe) return refuse(CommandError::no_such_recipe, recipe.error());
    if (request.argument2 != 0 && request.argument2 != crc32_of(*recipe))
        return failed(CommandError::wrong_checksum, crc32_of(*recipe));
    return outcome_of_use(use(who, std::move(*recipe)));
}

// -- self-test

// Judges rendered parts at once; then one flash and one frame of the empty line, whose outcome comes later.
CommandOutcome CommandHandler::self_test(const RequestOrigin& who, const CommandRequest& request) {
    Station& station = dependencies_->station;
    const State state = station.core().state();
    if (!is_possible(state, Command::self_test)) return failed(CommandError::not_in_this_state);
    std::uint32_t found = station.snapshot().faults_active;
    if (!station.core().all_devices_up()) return failed(CommandError::device_down, found);
    if (!station.test_possible()) return failed(CommandError::not_yet);
    if (dependencies_->check_judgement) {
        if (const auto checked = dependencies_->check_judgement(); !checked) {
            report(checked.error());
            found |= kFaultInspector;
        }
    }
    station.test_flash(kTestPatience, [this, who, request, state, found](const Station::FlashTest& flash) {
        std::uint32_t faults = found;
        if (!flash.lit) faults |= kFaultStrobe;
        if (!flash.frame) faults |= kFaultSensor;
        if (flash.frame && !flash.judged) faults |= kFaultInspector;
        if (flash.reason == algo::Reason::too_dark || flash.reason == algo::Reason::saturated)
            faults |= kFaultLightLevel;
        CommandOutcome outcome = done();
        if (faults != 0) {
            outcome = refuse(CommandError::failed,
                             {ErrorCode::internal, "the self-test found: " + names_of_faults(faults),
                              "see the cure of each fault: hordctl status"});
            outcome.result = faults;
        }
        dependencies_->plc_interface.finish(request, outcome);
        record(who, request, state, outcome);
    });
    return {CommandState::executing, CommandError::none, 0};
}

// -- teaching

CommandOutcome CommandHandler::teach(const RequestOrigin& who, const CommandRequest& request) {
    if (dependencies_->teacher == nullptr) return failed(CommandError::not_supported);
    const State state = dependencies_->station.core().state();
    if (!is_possible(state, Command::teach)) return failed(CommandError::not_in_this_state);
    const std::uint32_t parts = request.argument == 0 ? TeachIn::kUsualParts : request.argument;
    if (parts < TeachIn::kMinParts || parts > TeachIn::kMaxParts) {
        return refuse(CommandError::bad_argument,
                      {ErrorCode::invalid_argument, fmt::format("argument (8006): {} parts is out of range", parts),
                       fmt::format("use {} to {}", TeachIn::kMinParts, TeachIn::kMaxParts)});
    }
    if (running_teach_ || pending_reference_) return failed(CommandError::not_yet);
    TeachIn::Listener listener;
    listener.taken = [this, request](std::uint32_t taken) {
        dependencies_->plc_interface.finish(request, {CommandState::executing, CommandError::none, taken});
    };
    listener.done = [this](Result<TeachResult> result) { on_learned(std::move(result)); };
    if (auto begun = dependencies_->teacher->begin(parts, recipe_, std::move(listener)); !begun) {
        if (begun.error().code == ErrorCode::busy) return failed(CommandError::not_yet);
        return refuse(CommandError::failed, begun.error());
    }
    running_teach_ = RunningTeach{who, request, state, parts};
    return {CommandState::executing, CommandError::none, 0};
}

void CommandHandler::on_learned(Result<TeachResult> result) {
    if (!result) {
        report(result.error());
        CommandOutcome outcome = failed(CommandError::failed);
        outcome.remarks = remark_of(result.error());
        return end_teach(outcome);
    }
    if (!result->remarks.empty()) {
        report({ErrorCode::refused, fmt::format("taught from {} parts: {}", running_teach_->parts, result->remarks),
                "look at parts that it names; if they are good, teach again with more parts"});
    }
    const std::uint32_t crc = crc32_of(result->recipe);
    pending_reference_ = PendingReference{running_teach_->who, std::move(result->recipe)};
    const auto used = use_learned_reference();  // at once, or later
    CommandOutcome outcome = used ? done(crc) : failed(CommandError::failed);
    outcome.remarks = remark_of(used ? Error{ErrorCode::refused, result->remarks, {}} : used.error());
    end_teach(outcome);
}

void CommandHandler::end_teach(const CommandOutcome& outcome) {
    const RunningTeach ended = std::move(*running_teach_);
    running_teach_.reset();
    record(ended.who, ended.request, ended.before, outcome);
    dependencies_->plc_interface.finish(ended.request, outcome);
    if (dependencies_->publish) dependencies_->publish();
}

bool CommandHandler::cancel_teach(const std::string& why) {
    if (!running_teach_) return false;
    dependencies_->teacher->cancel();
    report({ErrorCode::refused, "the teach is cancelled: " + why, "teach again"});
    end_teach(failed(CommandError::cancelled));
    return true;
}

Result<void> CommandHandler::use_learned_reference() {
    if (!pending_reference_ || executing(dependencies_->station.core().state()) ||
        dependencies_->station.core().line().size() != 0)
        return {};
    PendingReference now = std::move(*pending_reference_);
    pending_reference_.reset();
    auto taken = dependencies_->inspector.use(now.recipe.recipe, now.recipe.number);
    if (taken) {
        if (const auto kept = keep(now.recipe); !kept) report(kept.error());
        adopt(now.who, std::move(now.recipe));
    } else {
        dependencies_->teacher->discard(now.recipe);
        report(taken.error());
    }
    if (dependencies_->publish) dependencies_->publish();
    return taken;
}

// -- the PLC itself

modbus::Exception CommandHandler::on_acknowledged(const modbus::Origin& origin, std::uint32_t sequence) {
    const AckStatus taken = dependencies_->recorder != nullptr
        ? dependencies_->recorder->on_acknowledged(who_asked(origin), sequence)
        : AckStatus::recorded;
    switch (taken) {
        case AckStatus::recorded: return modbus::Exception::none;
        case AckStatus::not_yet: return modbus::Exception::busy;
        case AckStatus::failed: break;
    }
    return modbus::Exception::device_failure;
}

void CommandHandler::on_plc_lost(PlcPolicy policy) {
    report({ErrorCode::timeout, "the PLC's heartbeat has stopped",
            policy == PlcPolicy::none ? "check the PLC and its network; the station goes on (plc.policy)"
                : policy == PlcPolicy::stop
                ? "check the PLC and its network; the station stops, start it again when the PLC is back"
                : "check the PLC and its network; every part is rejected until it is back"});
    dependencies_->station.plc_lost();
    if (dependencies_->publish) dependencies_->publish();
}

void CommandHandler::on_plc_back() {
    dependencies_->station.plc_back();
    if (dependencies_->publish) dependencies_->publish();
}

}  // namespace hord::firmware
