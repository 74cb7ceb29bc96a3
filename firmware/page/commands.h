// Commands that the page passes to the station: POST /api/command. Any thread.
//
// A command needs a token, and is refused if another site made the browser send it (cross-site request forgery).
#pragma once

#include <chrono>
#include <cstdint>
#include <functional>
#include <map>
#include <mutex>
#include <string>

#include "firmware/page/reply.h"
#include "firmware/page/tokens.h"
#include "firmware/registers/register_client.h"

namespace hord::firmware::page {

// The commands that the page sends: a recipe is selected by number, its limits are set and a reference is taught
// elsewhere.
constexpr bool page_offers(Command command) { return command != Command::commit_recipe && command != Command::teach; }

class Commands {
  public:
    // Sends the command to the station and waits for its end. `who`: the token's owner.
    using Send = std::function<Result<modbus::Client::Reply>(Command code, std::uint32_t argument,
                                                             std::uint32_t argument2, const std::string& who)>;
    using Log = std::function<void(const std::string& line)>;

    // `tokens` must outlive this. Without tokens every command is refused. `log` may be empty.
    Commands(const Tokens& tokens, Send send, Log log)
        : tokens_(tokens), send_(std::move(send)), log_(std::move(log)) {}

    // {"command":"stop"}, with "argument" and "argument2" (whole numbers of 32 bits, 0 if they are missing).
    [[nodiscard]] Reply execute(const Request& request);

    // By how they ended: completed, failed, refused.
    [[nodiscard]] std::map<std::string, std::uint64_t> counts() const;

  private:
    struct Order {
        Command command;
        std::uint32_t argument, argument2;
    };
    [[nodiscard]] static Result<Order> order_in(const std::string& body);
    [[nodiscard]] Reply send(const Order& order, const std::string& who, const Request& request);
    [[nodiscard]] Reply refuse(int status, const Error& error, const Request& request);
    void log_refusal(const std::string& line);
    void count(const char* end);

    const Tokens& tokens_;
    const Send send_;
    const Log log_;
    mutable std::mutex mutex_;
    std::map<std::string, std::uint64_t> counts_{{"completed", 0}, {"failed", 0}, {"refused", 0}};
    std::chrono::steady_clock::time_point refusals_since_{};
    std::uint64_t refusals_ = 0;  // since then
};

}  // namespace hord::firmware::page
