#include "firmware/plc/command_handler.h"

#include <algorithm>
#include <cmath>
#include <utility>

#include <fmt/format.h>

#include "firmware/core/faults.h"
#include "firmware/core/states.h"
#include "firmware/registers/register_map.h"

namespace hord::firmware {
namespace {

// A flash, its frame and its judgement take less, or are not to be had.
constexpr Duration kTestPatience = milliseconds(2000);

constexpr CommandOutcome done(std::uint32_t result = 0) {
    return {CommandState::completed, CommandError::none, result};
}
constexpr CommandOutcome failed(CommandError error, std::uint32_t result = 0) {
    return {CommandState::failed, error, result};
}

std::optional<Command> command_of(std::uint16_t code) {
    switch (static_cast<CommandCode>(code)) {
        case CommandCode::initialise: return Command::initialise;
        case CommandCode::arm: return Command::arm;
        case CommandCode::disarm: return Command::disarm;
        case CommandCode::start_single: return Command::start_single;
        case CommandCode::start_continuous: return Command::start_continuous;
        case CommandCode::stop: return Command::stop;
        case CommandCode::abort: return Command::abort;
        case CommandCode::halt: return Command::halt;
        case CommandCode::reset: return Command::reset;
        default: return std::nullopt;
    }
}

CommandOutcome outcome_of(Answer answer) {
    switch (answer) {
        case Answer::done: return done();
        case Answer::not_in_this_state: return failed(CommandError::not_in_this_state);
        case Answer::device_down: return failed(CommandError::device_down);
        case Answer::plc_lost: return failed(CommandError::plc_lost);
        case Answer::pulse_under_way: return failed(CommandError::not_yet);
    }
    return failed(CommandError::failed);
}

std::string name_in_map(std::string_view row, std::uint32_t value) {
    for (const NamedValue& named : find_register(BlockId::reply, row)->values) {
        if (named.value == value) return std::string(named.name);
    }
    return fmt::format("{}", value);
}

Who who_is(const modbus::Origin& origin) { return {std::string(origin.peer), 0}; }
// "127.0.0.1:50123 for anna": whom the sender names is recorded beside the address, never instead of it.
Who who_is(const modbus::Origin& origin, const CommandRequest& request) {
    const std::string_view name = request.who.view();
    return {name.empty() ? std::string(origin.peer) : fmt::format("{} for {}", origin.peer, name), request.token};
}

std::uint16_t scaled(double value, double scale) {
    return static_cast<std::uint16_t>(std::clamp(std::lround(value * scale), 0L, 0xFFFEL));
}

// What nothing is judged by is not available; another value in its place is a contradiction that a recipe is refused
// for.
constexpr std::uint16_t kNotJudged = 0xFFFF;

// A limit keeps what registers cannot say of it, unless they say something else.
void take(float& limit, std::uint16_t staged, std::uint16_t was, double scale) {
    if (staged != was) limit = static_cast<float>(staged / scale);
}

}  // namespace

StagedRecipe staged_from(const NumberedRecipe& numbered) {
    const algo::Recipe& r = numbered.recipe;
    return {.number = numbered.number,
            .emd_limit_mbins = r.gradient == algo::Feature::emd ? scaled(r.emd_limit_bins, 1e3) : kNotJudged,
            .frobenius_limit_mbins = r.slopes ? scaled(r.frobenius_limit_bins, 1e3) : kNotJudged,
            .transmission_permille = r.light ? scaled(r.transmission_limit, 1e3) : kNotJudged,
            .min_area = static_cast<std::uint16_t>(std::min<std::uint32_t>(r.min_area, 0xFFFE)),
            .rim_margin = static_cast<std::int16_t>(r.rim_margin),
            .max_saturated_permyriad = scaled(r.max_saturated_share, 1e4),
            .min_lit_permyriad = scaled(r.min_lit_share, 1e4)};
}

NumberedRecipe with_staged(NumberedRecipe base, const StagedRecipe& staged) {
    const StagedRecipe was = staged_from(base);
    algo::Recipe& r = base.recipe;
    base.number = staged.number;
    take(r.emd_limit_bins, staged.emd_limit_mbins, was.emd_limit_mbins, 1e3);
    take(r.frobenius_limit_bins, staged.frobenius_limit_mbins, was.frobenius_limit_mbins, 1e3);
    take(r.transmission_limit, staged.transmission_permille, was.transmission_permille, 1e3);
    if (staged.min_area != was.min_area) r.min_area = staged.min_area;
    if (staged.rim_margin != was.rim_margin) r.rim_margin = staged.rim_margin;
    take(r.max_saturated_share, staged.max_saturated_permyriad, was.max_saturated_permyriad, 1e4);
    take(r.min_lit_share, staged.min_lit_permyriad, was.min_lit_permyriad, 1e4);
    return base;
}

CommandHandler::~CommandHandler() = default;

void CommandHandler::begin(Dependencies works, NumberedRecipe recipe) {
    works_.emplace(std::move(works));
    recipe_ = std::move(recipe);
    works_->desk.stage(staged_from(recipe_));
    if (works_->recipe_changed) works_->recipe_changed(recipe_);
}

// -- commands

CommandOutcome CommandHandler::on_command(const modbus::Origin& origin, const CommandRequest& request) {
    const Who who = who_is(origin, request);
    const State before = works_->station.core().state();
    const CommandOutcome outcome = carry_out(who, request);
    if (outcome.state != CommandState::executing) record(who, request, before, outcome);
    if (works_->publish) works_->publish();
    return outcome;
}

CommandOutcome CommandHandler::carry_out(const Who& who, const CommandRequest& request) {
    if (const auto command = command_of(request.code)) {
        const bool ends_teach = *command == Command::abort || *command == Command::halt;
        const bool cancelled = ends_teach && cancel_teach(name_in_map("code", request.code) + " was commanded");
        const Answer answer = works_->station.request(*command);
        // Nothing was on the line to be aborted; the teach was.
        if (cancelled && *command == Command::abort && answer == Answer::not_in_this_state) return done();
        return outcome_of(answer);
    }
    switch (static_cast<CommandCode>(request.code)) {
        case CommandCode::use_recipe: return use_recipe(who, request);
        case CommandCode::self_test: return self_test(who, request);
        case CommandCode::teach: return teach(who, request);
        default: return failed(CommandError::unknown_command);
    }
}

void CommandHandler::record(const Who& who, const CommandRequest& request, State before,
                            const CommandOutcome& outcome) {
    if (works_->recorder == nullptr) return;
    std::string came_to = name_in_map("state", static_cast<std::uint32_t>(outcome.state));
    if (outcome.error != CommandError::none)
        came_to += " " + name_in_map("error", static_cast<std::uint32_t>(outcome.error));
    works_->recorder->on_change(
        {Change::What::command, who, name_in_map("code", request.code), std::string(name_of(before)), came_to});
}

void CommandHandler::report(const Error& error) const {
    if (works_->trouble) works_->trouble(error);
}

// -- recipes

Result<void> CommandHandler::use(const Who& who, NumberedRecipe recipe) {
    const State state = works_->station.core().state();
    if (executing(state)) {
        return fail(ErrorCode::refused,
                    fmt::format("recipe {} cannot be taken while the station executes", recipe.number),
                    "stop it first");
    }
    // What a file may not say, registers may not either.
    if (auto checked = parse_numbered_recipe(format_recipe(recipe), fmt::format("recipe {}", recipe.number));
        !checked) {
        return tl::unexpected(checked.error());
    }
    const std::string why = fmt::format("recipe {} was taken", recipe.number);
    if (auto taken = take(who, std::move(recipe)); !taken) return taken;
    (void)cancel_teach(why);
    if (const auto dropped = std::exchange(waiting_, std::nullopt)) {
        works_->teacher->discard(dropped->recipe);
        report({ErrorCode::refused, "what was taught is dropped before it came into use: " + why, "teach again"});
    }
    return {};
}

// With the inspector's consent it is in use, remembered and recorded.
Result<void> CommandHandler::take(const Who& who, NumberedRecipe recipe) {
    if (auto taken = works_->inspector.use(recipe.recipe, recipe.number); !taken) return taken;
    const NumberedRecipe before = std::exchange(recipe_, std::move(recipe));
    works_->desk.stage(staged_from(recipe_));
    if (works_->recipe_changed) works_->recipe_changed(recipe_);
    if (works_->recorder != nullptr) {
        works_->recorder->on_change(
            {Change::What::recipe, who, recipe_.recipe.name, format_recipe(before), format_recipe(recipe_)});
    }
    return {};
}

CommandOutcome CommandHandler::used(const Result<void>& result) {
    if (result) return done(crc32_of(recipe_));
    report(result.error());
    return failed(result.error().code == ErrorCode::refused ? CommandError::not_in_this_state
                                                            : CommandError::bad_argument);
}

CommandOutcome CommandHandler::use_recipe(const Who& who, const CommandRequest& request) {
    if (executing(works_->station.core().state())) return failed(CommandError::not_in_this_state);
    if (request.argument > 0xFFFE) return failed(CommandError::bad_argument);
    if (!works_->recipe) return failed(CommandError::no_such_recipe);
    auto recipe = works_->recipe(static_cast<std::uint16_t>(request.argument));
    if (!recipe) {
        report(recipe.error());
        return failed(CommandError::no_such_recipe);
    }
    if (request.argument2 != 0 && request.argument2 != crc32_of(*recipe))
        return failed(CommandError::wrong_checksum, crc32_of(*recipe));
    return used(use(who, std::move(*recipe)));
}

CommandOutcome CommandHandler::on_recipe(const modbus::Origin& origin, const CommandRequest& request,
                                         const StagedRecipe& staged) {
    const Who who = who_is(origin, request);
    const State before = works_->station.core().state();
    const CommandOutcome outcome = used(use(who, with_staged(recipe_, staged)));
    record(who, request, before, outcome);
    if (works_->publish) works_->publish();
    return outcome;
}

// -- self-test

// The judgement on drawn parts at once; then one flash and one frame of the empty line, which answer later.
CommandOutcome CommandHandler::self_test(const Who& who, const CommandRequest& request) {
    Station& station = works_->station;
    const State state = station.core().state();
    if (state != State::initialized && state != State::ready) return failed(CommandError::not_in_this_state);
    std::uint32_t found = station.snapshot().faults_active;
    if (!station.core().all_devices_up()) return failed(CommandError::device_down, found);
    if (!station.test_possible()) return failed(CommandError::not_yet);
    if (works_->check_judgement) {
        if (const auto checked = works_->check_judgement(); !checked) {
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
        const CommandOutcome outcome = faults == 0 ? done() : failed(CommandError::failed, faults);
        if (faults != 0)
            report({ErrorCode::internal, "the self-test found: " + names_of_faults(faults),
                    "see the cure of each fault: hordctl status"});
        works_->desk.finish(request.token, outcome);
        record(who, request, state, outcome);
    });
    return {CommandState::executing, CommandError::none, 0};
}

// -- teaching

CommandOutcome CommandHandler::teach(const Who& who, const CommandRequest& request) {
    if (works_->teacher == nullptr) return failed(CommandError::not_supported);
    const State state = works_->station.core().state();
    if (state != State::initialized && state != State::ready && !executing(state))
        return failed(CommandError::not_in_this_state);
    const std::uint32_t parts = request.argument == 0 ? TeachIn::kUsualParts : request.argument;
    if (parts < TeachIn::kMinParts || parts > TeachIn::kMaxParts) return failed(CommandError::bad_argument);
    if (teach_ || waiting_) return failed(CommandError::not_yet);
    TeachIn::Listener listener;
    listener.taken = [this, token = request.token](std::uint32_t taken) {
        works_->desk.finish(token, {CommandState::executing, CommandError::none, taken});
    };
    listener.done = [this](Result<TeachResult> result) { taught(std::move(result)); };
    if (auto begun = works_->teacher->begin(parts, recipe_, std::move(listener)); !begun) {
        if (begun.error().code == ErrorCode::busy) return failed(CommandError::not_yet);
        report(begun.error());
        return failed(CommandError::failed);
    }
    teach_ = Teach{who, request, state, parts};
    return {CommandState::executing, CommandError::none, 0};
}

void CommandHandler::taught(Result<TeachResult> result) {
    if (!result) {
        report(result.error());
        return end_teach(failed(CommandError::failed));
    }
    if (!result->remarks.empty()) {
        report({ErrorCode::refused, fmt::format("taught from {} parts: {}", teach_->parts, result->remarks),
                "look at these parts; if they are good, teach again with more parts"});
    }
    const std::uint32_t crc = crc32_of(result->recipe);
    waiting_ = Waiting{teach_->who, std::move(result->recipe)};
    const auto used = use_learned_reference();  // at once, or later
    end_teach(used ? done(crc) : failed(CommandError::failed));
}

void CommandHandler::end_teach(const CommandOutcome& outcome) {
    const Teach ended = std::move(*teach_);
    teach_.reset();
    record(ended.who, ended.request, ended.before, outcome);
    works_->desk.finish(ended.request.token, outcome);
    if (works_->publish) works_->publish();
}

bool CommandHandler::cancel_teach(const std::string& why) {
    if (!teach_) return false;
    works_->teacher->cancel();
    report({ErrorCode::refused, "the teach is cancelled: " + why, "teach again"});
    end_teach(failed(CommandError::cancelled));
    return true;
}

Result<void> CommandHandler::use_learned_reference() {
    if (!waiting_ || executing(works_->station.core().state()) || works_->station.core().line().size() != 0) return {};
    Waiting now = std::move(*waiting_);
    waiting_.reset();
    const NumberedRecipe recipe = now.recipe;
    auto taken = take(now.who, std::move(now.recipe));
    if (!taken) {
        works_->teacher->discard(recipe);
        report(taken.error());
    }
    if (works_->publish) works_->publish();
    return taken;
}

// -- the PLC itself

modbus::Exception CommandHandler::on_acknowledged(const modbus::Origin& origin, std::uint32_t sequence) {
    const Taken taken =
        works_->recorder != nullptr ? works_->recorder->on_acknowledged(who_is(origin), sequence) : Taken::yes;
    switch (taken) {
        case Taken::yes: return modbus::Exception::none;
        case Taken::not_yet: return modbus::Exception::busy;
        case Taken::cannot: break;
    }
    return modbus::Exception::device_failure;
}

void CommandHandler::on_plc_lost(PlcPolicy policy) {
    report({ErrorCode::timeout, "the PLC's heartbeat has stopped",
            policy == PlcPolicy::none ? "check the PLC and its network; the station goes on (plc.policy)"
                : policy == PlcPolicy::stop
                ? "check the PLC and its network; the station stops, start it again when the PLC is back"
                : "check the PLC and its network; every part is rejected until it is back"});
    works_->station.plc_lost();
    if (works_->publish) works_->publish();
}

void CommandHandler::on_plc_back() {
    works_->station.plc_back();
    if (works_->publish) works_->publish();
}

}  // namespace hord::firmware
