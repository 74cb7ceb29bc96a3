#include "firmware/mqtt/agent.h"

#include <algorithm>
#include <utility>

#include <fmt/format.h>

namespace hord::firmware::mqtt {
namespace {

using std::chrono::milliseconds;

constexpr milliseconds kFirstPatience(500), kLongestPatience(30'000);  // between attempts to connect
constexpr milliseconds kReadEvery(100);                                // results, while nothing else asks for them
constexpr milliseconds kRetryStore(1000);
constexpr milliseconds kWriteEvery(500);  // the cursor: what is not written down is sent once more after a crash
constexpr milliseconds kGoodbye(2000);
constexpr std::chrono::minutes kSayAgain(10);
constexpr std::size_t kRemembered = 16;
constexpr double kMaxLines = 10;  // at once; then one a second

UtcMs utc_now() {
    return std::chrono::duration_cast<milliseconds>(std::chrono::system_clock::now().time_since_epoch()).count();
}

}  // namespace

Result<std::unique_ptr<Agent>> Agent::open(AgentOptions options, std::unique_ptr<ResultSource> results, Look look,
                                           Say say) {
    const auto cursor = read_cursor(options.state_file);
    if (!cursor) return tl::unexpected(cursor.error());
    return std::unique_ptr<Agent>(
        new Agent(std::move(options), std::move(results), std::move(look), std::move(say), cursor->value_or(Cursor{})));
}

Agent::Agent(AgentOptions options, std::unique_ptr<ResultSource> results, Look look, Say say, const Cursor& cursor)
    : options_(std::move(options)), results_(std::move(results)), look_(std::move(look)), say_(std::move(say)),
      node_(options_.node, cursor), written_(cursor) {}

void Agent::say(const std::string& line) {
    if (line.empty()) return;
    const auto now = Clock::now();
    lines_left_ =
        std::min(lines_left_ + std::chrono::duration<double>(now - std::exchange(lines_at_, now)).count(), kMaxLines);
    const auto known = std::find_if(said_.begin(), said_.end(), [&](const auto& said) { return said.first == line; });
    if (known != said_.end() && now - known->second < kSayAgain) return;
    if (lines_left_ < 1) return;
    lines_left_ -= 1;
    if (known != said_.end()) said_.erase(known);
    said_.emplace_back(line, now);
    if (said_.size() > kRemembered) said_.pop_front();
    say_(line);
}

void Agent::say_event(const std::string& line) {
    said_.clear();
    say_(line);
}

void Agent::step(milliseconds wait) {
    const auto now = Clock::now();
    if (!link_ && now >= connect_at_) connect();
    if (now >= look_at_) look();
    if (!link_ || !link_->congested()) node_.step(utc_now());
    read_results();
    send();
    if (link_) {
        for (const BrokerLink::Event& event : link_->serve(wait)) take(event);
        if (node_.wants_to_leave()) {
            send();
            link_->leave(kGoodbye);
            link_.reset();
            node_.disconnected();
            say_event("the primary host is gone: results wait in the store until it is back");
        }
    }
    say(node_.trouble());
    write_down(false);
}

// -- the connection

void Agent::connect() {
    const Outgoing will = node_.begin_session(utc_now());
    // bdSeq is written down before anybody can see it, so that no two sessions share one.
    if (!write_down(true)) return lose({ErrorCode::io, "", ""});
    auto link = BrokerLink::connect(options_.broker, will, node_.topics());
    if (!link) return lose(link.error());
    link_ = std::move(*link);
}

void Agent::lose(const Error& error) {
    link_.reset();
    node_.disconnected();
    if (!error.what.empty()) say(error.message());
    // A broker that comes back meets a whole fleet: everybody waits for a time of their own. Two stations of one name
    // would push each other out for ever.
    patience_ =
        std::clamp(std::exchange(useful_, false) ? kFirstPatience : patience_ * 2, kFirstPatience, kLongestPatience);
    if (error.code == ErrorCode::busy) patience_ = kLongestPatience;
    connect_at_ = Clock::now() +
        milliseconds(std::uniform_int_distribution<std::int64_t>(patience_.count() / 2, patience_.count())(random_));
}

void Agent::take(const BrokerLink::Event& event) {
    const UtcMs now = utc_now();
    switch (event.kind) {
        case BrokerLink::Event::Kind::subscribed:
            node_.connected(now);
            say_event(fmt::format("connected with {}:{} as {}/{}{}", options_.broker.host, options_.broker.port,
                                  options_.node.group, options_.node.node,
                                  node_.waits_for_host()
                                      ? ", waiting for the primary host " + options_.node.primary_host
                                      : std::string()));
            break;
        case BrokerLink::Event::Kind::message: node_.message(event.topic, event.payload, now, event.retained); break;
        case BrokerLink::Event::Kind::confirmed:
            useful_ |= event.heard;
            node_.confirmed(event.token, event.heard, now);
            break;
        case BrokerLink::Event::Kind::closed: lose(event.error); break;
    }
}

void Agent::send() {
    for (const Outgoing& message : node_.take()) {
        if (!link_) return;
        if (auto done = link_->publish(message); !done) return lose(done.error());
    }
}

// -- what is told

void Agent::look() {
    look_at_ = Clock::now() + options_.look_every;
    if (link_ && link_->congested()) return;  // a broker that does not read gets results later, and no old states
    node_.tell(look_(), utc_now());
}

void Agent::read_results() {
    const auto now = Clock::now();
    if (now < read_at_) return;
    read_at_ = now + kReadEvery;
    const auto where = results_->look();
    if (!where) {
        read_at_ = now + kRetryStore;
        store_was_missing_ |= where.error().code == ErrorCode::not_found;
        return say(where.error().message());
    }
    if (where->id != store_ || where->newest < newest_) {
        node_.use_store(where->id, where->newest, store_was_missing_);
        store_ = where->id;
    }
    newest_ = where->newest;
    if (link_ && link_->congested()) return;
    const auto wish = node_.wish(utc_now());
    if (!wish || wish->after >= newest_) return;
    const auto results = results_->read(wish->after, wish->count);
    if (!results) return say(results.error().message());
    node_.offer(*results, newest_, utc_now());
    if (results->size() == wish->count) read_at_ = now;  // there is more
}

bool Agent::write_down(bool at_once) {
    if (node_.cursor() == written_ || (!at_once && Clock::now() < write_at_)) return true;
    write_at_ = Clock::now() + kWriteEvery;
    if (auto done = write_cursor(options_.state_file, node_.cursor()); !done) {
        say(done.error().message());
        return false;
    }
    written_ = node_.cursor();
    return true;
}

void Agent::close() {
    if (link_) {
        node_.goodbye(utc_now());
        send();
        if (link_) link_->leave(kGoodbye);
        link_.reset();
    }
    write_down(true);
}

std::string Agent::status() const {
    const auto& figures = node_.figures();
    const char* state = node_.born() ? "connected"
        : node_.waits_for_host()     ? "waiting for the primary host"
                                     : "not connected";
    return fmt::format("{}; results handed over up to {} of {}, {} lost, commands refused {}", state,
                       node_.cursor().confirmed, newest_, node_.cursor().lost, figures.refused);
}

}  // namespace hord::firmware::mqtt
