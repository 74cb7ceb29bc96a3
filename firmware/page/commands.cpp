#include "firmware/page/commands.h"

#include <algorithm>
#include <array>
#include <optional>
#include <set>
#include <string_view>

#include <fmt/format.h>

#include "firmware/core/enum_values.h"
#include "firmware/store/results/json_text.h"

namespace hord::firmware::page {
namespace {

using store::Json;

constexpr std::string_view kBearer = "Bearer ";
constexpr std::uint64_t kRefusalsLogged = 5;  // in kRefusalPeriod
constexpr auto kRefusalPeriod = std::chrono::seconds(60);

std::optional<Command> command_of(std::string_view name) {
    const auto command = command_named(name);
    return command && page_offers(*command) ? command : std::nullopt;
}

const std::string kCommandsOfThePage = [] {
    std::string names;
    for (const Command command : kValuesOf<Command>) {
        if (command_of(name_of(command)))
            names += (names.empty() ? "use one of " : ", ") + std::string(name_of(command));
    }
    return names;
}();

std::string cure_of_unknown(std::string_view name) {
    if (name == name_of(Command::teach)) return "at the station: hordctl teach; or from the PLC";
    if (command_named(name)) return "commit_recipe is the PLC's; a recipe's number is taken by use_recipe";
    return kCommandsOfThePage;
}

std::optional<std::uint32_t> number_in(const Json& body, const char* name) {
    if (!body.contains(name)) return 0;
    const Json& value = body[name];
    if (!value.is_number_unsigned() || value.get<std::uint64_t>() > 0xFFFFFFFFU) return std::nullopt;
    return value.get<std::uint32_t>();
}

// An object with known members, each once: of a repeated one the parser would keep the last.
std::optional<Json> object_in(const std::string& text) {
    bool exact = true;
    std::set<std::string> members;
    const auto check = [&](int depth, Json::parse_event_t event, const Json& key) {
        constexpr std::array<std::string_view, 3> kMembers{"command", "argument", "argument2"};
        if (event != Json::parse_event_t::key) return true;
        const auto name = key.get<std::string>();
        exact =
            exact && depth == 1 && std::ranges::find(kMembers, name) != kMembers.end() && members.insert(name).second;
        return true;
    };
    Json body = Json::parse(text, check, false);
    if (!exact || !body.is_object()) return std::nullopt;
    return body;
}

// Browsers name the origin of a request.
bool is_from_another_site(const Request& request) {
    const bool foreign_site =
        !request.fetch_site.empty() && request.fetch_site != "same-origin" && request.fetch_site != "none";
    const bool foreign_origin = !request.origin.empty() && request.origin != "http://" + request.host &&
        request.origin != "https://" + request.host;
    return foreign_site || foreign_origin;
}

Error refused(const char* what, std::string cure) { return {ErrorCode::refused, what, std::move(cure)}; }

}  // namespace

Reply Commands::execute(const Request& request) {
    if (tokens_.empty())
        return refuse(
            403,
            refused("this page only shows", "to allow commands, name a file of tokens in page.toml: [actions] tokens"),
            request);
    if (!request.content_type.starts_with("application/json"))
        return refuse(415, refused("a command is JSON", "send {\"command\":\"stop\"} as application/json"), request);
    if (is_from_another_site(request))
        return refuse(403, refused("another site may not command the station", "give the command on the page itself"),
                      request);
    const std::string_view shown = request.authorization;
    const auto who = shown.starts_with(kBearer) ? tokens_.owner(shown.substr(kBearer.size())) : std::nullopt;
    if (!who) {
        Reply reply =
            refuse(401, refused("the token is not known", "enter a token of the file that page.toml names"), request);
        reply.headers.emplace_back("WWW-Authenticate", "Bearer");
        return reply;
    }
    const auto order = order_in(request.body);
    return order ? send(*order, *who, request) : refuse(400, order.error(), request);
}

Result<Commands::Order> Commands::order_in(const std::string& text) {
    const auto body = object_in(text);
    if (!body || !body->contains("command") || !(*body)["command"].is_string())
        return tl::unexpected(refused("that is no command", "send {\"command\":\"stop\"}"));
    const auto name = (*body)["command"].get<std::string>();
    const auto command = command_of(name);
    if (!command) {
        const char* what = command_named(name) ? "the page does not send this command" : "there is no such command";
        return tl::unexpected(refused(what, cure_of_unknown(name)));
    }
    const auto argument = number_in(*body, "argument"), argument2 = number_in(*body, "argument2");
    constexpr const char* kUseRecipe = "send {\"command\":\"use_recipe\",\"argument\":7}";
    if (!argument || !argument2)
        return tl::unexpected(refused("an argument is no whole number of 0 to 4294967295", kUseRecipe));
    if (*command == Command::use_recipe && !body->contains("argument"))
        return tl::unexpected(refused("use_recipe needs the recipe's number", kUseRecipe));
    return Order{*command, *argument, *argument2};
}

Reply Commands::send(const Order& order, const std::string& who, const Request& request) {
    const auto done = send_(order.command, order.argument, order.argument2, who);
    const bool completed = done && done->state == CommandState::completed;
    count(completed ? "completed" : "failed");
    const std::string_view name = name_of(order.command);
    if (log_) {
        const std::string end = completed ? "done" : done ? done->why() : done.error().message();
        log_(fmt::format("{} for {} from {}: {}", name, who, request.peer, end));
    }
    if (!done)
        return refusal(done.error().code == ErrorCode::refused ? 403 : 503, done.error().what, done.error().cure);
    if (!completed)
        return {.status = 409,
                .body = store::to_text({{"error", fmt::format("the station refuses {}: {}", name, done->why())},
                                        {"reason", done->error_name},
                                        {"cure", done->cure(page_offers)}})};
    return {.body = store::to_text(Json{{"done", name}, {"result", done->result}})};
}

std::map<std::string, std::uint64_t> Commands::counts() const {
    const std::lock_guard lock(mutex_);
    return counts_;
}

void Commands::count(const char* end) {
    const std::lock_guard lock(mutex_);
    ++counts_[end];
}

Reply Commands::refuse(int status, const Error& error, const Request& request) {
    count("refused");
    log_refusal(fmt::format("a command from {} is refused: {}", request.peer, error.what));
    return refusal(status, error.what, error.cure);
}

// A client may send refused commands without end: most are only counted.
void Commands::log_refusal(const std::string& line) {
    if (!log_) return;
    std::uint64_t not_logged = 0;
    {
        const std::lock_guard lock(mutex_);
        if (const auto now = std::chrono::steady_clock::now(); now - refusals_since_ >= kRefusalPeriod) {
            not_logged = refusals_ > kRefusalsLogged ? refusals_ - kRefusalsLogged : 0;
            refusals_ = 0;
            refusals_since_ = now;
        }
        if (++refusals_ > kRefusalsLogged) return;
    }
    if (not_logged > 0) log_(fmt::format("{} more commands were refused and not logged", not_logged));
    log_(line);
}

}  // namespace hord::firmware::page
