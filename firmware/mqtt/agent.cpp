#include "firmware/mqtt/agent.h"

#include <algorithm>
#include <utility>

#include <fmt/format.h>

namespace hord::firmware::mqtt {
namespace {

using std::chrono::milliseconds;

constexpr milliseconds kFirstBackoff(500), kLongestBackoff(30'000);  // between attempts to connect
constexpr milliseconds kReadEvery(100);  // period of reading results; at once while more wait
constexpr milliseconds kRetryStore(1000);
constexpr milliseconds kWriteEvery(500);  // the cursor: results above the saved one are sent again after a crash
constexpr milliseconds kGoodbye(2000);
constexpr std::chrono::seconds kSoon(10);  // a connection of a broker that works lasts longer
constexpr int kAgainAndAgain = 4;          // connections in a row
constexpr std::chrono::minutes kRepeatAfter(10);
constexpr std::size_t kRecentLines = 16;
constexpr double kMaxLines = 10;  // at once; then one a second

UtcMs utc_now() {
    return std::chrono::duration_cast<milliseconds>(std::chrono::system_clock::now().time_since_epoch()).count();
}

}  // namespace

Result<std::unique_ptr<Agent>> Agent::open(MqttConfig config, std::unique_ptr<ResultSource> results,
                                           ReadStation read_station, Log log) {
    auto lock = lock_cursor(config.state_file);
    if (!lock) return tl::unexpected(lock.error());
    const auto cursor = read_cursor(config.state_file);
    if (!cursor) return tl::unexpected(cursor.error());
    return std::unique_ptr<Agent>(new Agent(std::move(config), std::move(results), std::move(read_station),
                                            std::move(log), std::move(*lock), cursor->value_or(Cursor{})));
}

Agent::Agent(MqttConfig config, std::unique_ptr<ResultSource> results, ReadStation read_station, Log log,
             common::UniqueFd lock, const Cursor& cursor)
    : config_(std::move(config)), results_(std::move(results)), read_station_(std::move(read_station)),
      log_(std::move(log)), lock_(std::move(lock)), node_(config_.node, cursor), saved_(cursor) {}

bool Agent::may_log(Clock::time_point now) {
    lines_left_ =
        std::min(lines_left_ + std::chrono::duration<double>(now - std::exchange(lines_at_, now)).count(), kMaxLines);
    if (lines_left_ < 1) return false;
    lines_left_ -= 1;
    return true;
}

void Agent::log(const std::string& line) {
    if (line.empty()) return;
    const auto now = Clock::now();
    const auto known =
        std::find_if(recent_lines_.begin(), recent_lines_.end(), [&](const auto& said) { return said.first == line; });
    if (known != recent_lines_.end() && now - known->second < kRepeatAfter) return;
    if (!may_log(now)) return;
    if (known != recent_lines_.end()) recent_lines_.erase(known);
    recent_lines_.emplace_back(line, now);
    if (recent_lines_.size() > kRecentLines) recent_lines_.pop_front();
    log_(line);
}

void Agent::log_event(const std::string& line) {
    recent_lines_.clear();
    if (may_log(Clock::now())) log_(line);
}

void Agent::step(milliseconds wait) {
    const auto now = Clock::now();
    if (!link_ && now >= connect_at_) connect();
    if (now >= station_at_) poll_station();
    if (!link_ || !link_->congested()) node_.step(utc_now());
    read_results();
    send();
    if (link_) {
        for (const BrokerLink::Event& event : link_->serve(wait)) handle(event);
        if (node_.wants_to_leave()) {
            send();
            link_->leave(kGoodbye);
            link_.reset();
            accepted_at_.reset();
            node_.disconnected();
            log_event("the primary host is gone: results wait in the store until it is back");
        }
    }
    log(node_.trouble());
    save_cursor(false);
}

// -- the connection

void Agent::connect() {
    const Outgoing will = node_.begin_session(utc_now());
    // bdSeq is saved before it is used, so that no two sessions share one.
    if (!save_cursor(true)) return drop_connection({ErrorCode::io, "", ""});
    auto link = BrokerLink::connect(config_.broker, will, node_.topics());
    if (!link) return drop_connection(link.error());
    link_ = std::move(*link);
}

void Agent::drop_connection(const Error& error) {
    link_.reset();
    node_.disconnected();
    const auto now = Clock::now();
    const auto accepted_at = std::exchange(accepted_at_, std::nullopt);
    const bool soon = error.code == ErrorCode::disconnected && accepted_at && now - *accepted_at < kSoon;
    ended_soon_ = soon ? ended_soon_ + 1 : 0;
    const bool displaced = error.code == ErrorCode::busy || ended_soon_ >= kAgainAndAgain;
    if (soon && displaced) {
        log(
            fmt::format("broker {}:{} accepts this station and ends the connection within {} s, again and again: "
                        "another client that calls itself \"{}\" probably takes its place: give each station a "
                        "sparkplug.node of its own, and run hord-mqtt once; else see the broker's log",
                        config_.broker.host, config_.broker.port, kSoon.count(), config_.broker.client_id));
    } else if (!error.what.empty()) {
        log(error.message());
    }
    // A random delay: a whole fleet reconnects to a broker that comes back. The longest one when another client has
    // taken the session: two stations of one name would disconnect each other forever.
    backoff_ = std::clamp(std::exchange(useful_, false) ? kFirstBackoff : backoff_ * 2, kFirstBackoff, kLongestBackoff);
    if (displaced) backoff_ = kLongestBackoff;
    connect_at_ = now +
        milliseconds(std::uniform_int_distribution<std::int64_t>(backoff_.count() / 2, backoff_.count())(random_));
}

void Agent::handle(const BrokerLink::Event& event) {
    const UtcMs now = utc_now();
    switch (event.kind) {
        case BrokerLink::Event::Kind::subscribed:
            accepted_at_ = Clock::now();
            node_.connected(now);
            log_event(fmt::format("connected with {}:{} as {}/{}{}", config_.broker.host, config_.broker.port,
                                  config_.node.group, config_.node.node,
                                  node_.waits_for_host() ? ", waiting for the primary host " + config_.node.primary_host
                                                         : std::string()));
            break;
        case BrokerLink::Event::Kind::message: node_.message(event.topic, event.payload, now, event.retained); break;
        case BrokerLink::Event::Kind::confirmed:
            useful_ |= event.had_subscriber;
            node_.confirmed(event.token, event.had_subscriber, now);
            break;
        case BrokerLink::Event::Kind::closed: drop_connection(event.error); break;
    }
}

void Agent::send() {
    for (const Outgoing& message : node_.take_outgoing()) {
        if (!link_) return;
        if (auto done = link_->publish(message); !done) return drop_connection(done.error());
    }
}

// -- publishing

void Agent::poll_station() {
    station_at_ = Clock::now() + config_.look_every;
    if (link_ && link_->congested()) return;  // a broker that does not read gets results later, and no old states
    node_.set_readings(read_station_(), utc_now());
}

void Agent::read_results() {
    const auto now = Clock::now();
    if (now < read_at_) return;
    read_at_ = now + kReadEvery;
    const auto where = results_->look();
    if (!where) {
        read_at_ = now + kRetryStore;
        store_was_missing_ |= where.error().code == ErrorCode::not_found;
        return log(where.error().message());
    }
    if (where->id != store_ || where->newest < newest_) {
        node_.use_store(where->id, where->newest, store_was_missing_);
        store_ = where->id;
    }
    newest_ = where->newest;
    if (link_ && link_->congested()) return;
    const auto demand = node_.demand(utc_now());
    if (!demand || demand->after >= newest_) return;
    const auto results = results_->read(demand->after, demand->count);
    if (!results) return log(results.error().message());
    node_.offer(*results, newest_, utc_now());
    if (results->size() == demand->count) read_at_ = now;  // there is more
}

bool Agent::save_cursor(bool at_once) {
    if (node_.cursor() == saved_ || (!at_once && Clock::now() < write_at_)) return true;
    write_at_ = Clock::now() + kWriteEvery;
    if (auto done = write_cursor(config_.state_file, node_.cursor()); !done) {
        log(done.error().message());
        return false;
    }
    saved_ = node_.cursor();
    return true;
}

void Agent::close() {
    if (link_) {
        node_.publish_death(utc_now());
        send();
        if (link_) link_->leave(kGoodbye);
        link_.reset();
    }
    save_cursor(true);
}

std::string Agent::status() const {
    const char* state = node_.born() ? "connected"
        : node_.waits_for_host()     ? "waiting for the primary host"
                                     : "not connected";
    return fmt::format("{}; results handed over up to {} of {}, {} lost, commands refused {}", state,
                       node_.cursor().confirmed, newest_, node_.cursor().lost, node_.refused());
}

}  // namespace hord::firmware::mqtt
