#include "firmware/mqtt/edge_node.h"

#include <algorithm>
#include <utility>

#include <fmt/format.h>
#include <nlohmann/json.hpp>

namespace hord::firmware::mqtt {
namespace {

constexpr std::string_view kRebirth = "Node Control/Rebirth";
constexpr UtcMs kBirthEvery = 1000;  // requests for a birth that come faster share one
constexpr UtcMs kProbeEvery = 2000;  // without a subscriber: period of sending one result
constexpr std::size_t kMaxStateBytes = 1024;

Metric named(std::string name, DataType type, MetricValue value) {
    return {.name = std::move(name), .type = type, .value = std::move(value)};
}

}  // namespace

EdgeNode::EdgeNode(NodeOptions options, Cursor cursor) : options_(std::move(options)), cursor_(std::move(cursor)) {}

std::string EdgeNode::topic(const char* type) const {
    return fmt::format("spBv1.0/{}/{}/{}", options_.group, type, options_.node);
}
std::string EdgeNode::state_topic() const { return "spBv1.0/STATE/" + options_.primary_host; }

std::vector<std::string> EdgeNode::topics() const {
    std::vector<std::string> topics{topic("NCMD")};
    if (!options_.primary_host.empty()) topics.push_back(state_topic());
    return topics;
}

// -- sessions

Payload EdgeNode::death(UtcMs now) const {
    Payload payload;
    payload.time_ms = now;
    payload.metrics.push_back(named("bdSeq", DataType::int64, std::int64_t{cursor_.bd_seq}));
    payload.metrics.back().time_ms = now;
    return payload;  // a death has no seq
}

Outgoing EdgeNode::begin_session(UtcMs now) {
    disconnected();
    ++cursor_.bd_seq;  // 255 is followed by 0
    return {topic("NDEATH"), encode(death(now)), 1, 0, false};
}

void EdgeNode::connected(UtcMs now) {
    session_ = Session::waiting;
    if (options_.primary_host.empty()) birth(now);
}

void EdgeNode::disconnected() {
    session_ = Session::none;
    leaving_ = rebirth_ = no_subscriber_ = false;
    outbox_.clear();
    open_.clear();
}

void EdgeNode::publish_death(UtcMs now) {
    if (session_ == Session::born) outbox_.push_back({topic("NDEATH"), encode(death(now)), 1, 0, false});
    session_ = Session::none;
}

std::vector<Metric> EdgeNode::node_metrics() const {
    const std::int64_t waiting = store_known_ ? std::max<std::int64_t>(newest_ - cursor_.confirmed, 0) : 0;
    std::vector<Metric> metrics{named("Node/Software", DataType::text, options_.software),
                                named("Node/Commands Refused", DataType::uint64, refused_),
                                named("Node/Results Waiting", DataType::uint64, static_cast<std::uint64_t>(waiting)),
                                named("Node/Results Lost", DataType::uint64, cursor_.lost),
                                named("Station/Online", DataType::boolean, !readings_.empty())};
    for (std::size_t k = 0; k < metrics.size(); ++k) metrics[k].alias = kNodeAlias + k;
    const auto station = station_metrics(readings_);
    metrics.insert(metrics.end(), station.begin(), station.end());
    return metrics;
}

void EdgeNode::birth(UtcMs now) {
    session_ = Session::born;
    seq_ = 0;
    rebirth_ = false;
    born_at_ = now;
    Payload payload;
    payload.metrics.push_back(named("bdSeq", DataType::int64, std::int64_t{cursor_.bd_seq}));
    payload.metrics.push_back(
        named(std::string(kRebirth), DataType::boolean, false));  // has no alias: hosts write it by name
    published_ = node_metrics();
    payload.metrics.insert(payload.metrics.end(), published_.begin(), published_.end());
    const auto declared = result_metrics(nullptr, {}, false);
    payload.metrics.insert(payload.metrics.end(), declared.begin(), declared.end());
    for (Metric& metric : payload.metrics) metric.time_ms = now;
    publish("NBIRTH", std::move(payload), 0, now);
    begin_results();
}

void EdgeNode::publish(const char* type, Payload payload, std::uint64_t token, UtcMs now) {
    payload.time_ms = now;
    payload.seq = seq_++;  // 255 is followed by 0
    outbox_.push_back({topic(type), encode(payload), options_.qos, token, false});
}

void EdgeNode::set_readings(const std::vector<Reading>& readings, UtcMs now) {
    readings_ = readings;
    if (session_ != Session::born) return;
    const auto metrics = node_metrics();
    Payload payload;
    for (std::size_t k = 0; k < metrics.size(); ++k) {
        if (metrics[k].value == published_[k].value) continue;
        payload.metrics.push_back({.alias = metrics[k].alias, .time_ms = now, .value = metrics[k].value});
    }
    published_ = metrics;
    if (!payload.metrics.empty()) publish("NDATA", std::move(payload), 0, now);
}

void EdgeNode::step(UtcMs now) {
    const bool due = now - born_at_ >= kBirthEvery || now < born_at_;
    if (session_ == Session::born && rebirth_ && due) birth(now);
}

// -- incoming messages

void EdgeNode::message(const std::string& from, std::string_view payload, UtcMs now, bool retained) {
    if (session_ == Session::none) return;
    if (from == topic("NCMD") && retained)
        refuse("a command that the broker keeps for everybody who connects: remove it there");
    else if (from == topic("NCMD")) command(payload);
    else if (!options_.primary_host.empty() && from == state_topic()) host_state(payload, now);
    else refuse("a message on the topic \"" + from.substr(0, 100) + "\", which was not asked for");
    step(now);
}

void EdgeNode::refuse(const std::string& why) {
    ++refused_;
    trouble_ = "refused: " + why;
}

// The only command is a rebirth. A payload with any other metric is refused as a whole.
void EdgeNode::command(std::string_view bytes) {
    const auto payload = decode_command(bytes);
    if (!payload) return refuse(payload.error().message());
    if (payload->metrics.empty()) return refuse("a command without a metric");
    for (const Metric& metric : payload->metrics) {
        if (metric.name != kRebirth) {
            const std::string name = metric.name.empty() ? fmt::format("alias {}", metric.alias.value_or(0))
                                                         : fmt::format("\"{:.60}\"", metric.name);
            return refuse("a command to write " + name + ": a station takes no commands here but " +
                          std::string(kRebirth));
        }
        const bool* wanted = std::get_if<bool>(&metric.value);
        if (wanted == nullptr || (metric.type != DataType::none && metric.type != DataType::boolean)) {
            return refuse(std::string(kRebirth) + " with a value that is no Boolean");
        }
        if (!*wanted) return refuse(std::string(kRebirth) + " with the value false");
    }
    rebirth_ = true;
}

void EdgeNode::host_state(std::string_view text, UtcMs now) {
    const auto json = text.size() <= kMaxStateBytes ? nlohmann::json::parse(text, nullptr, false) : nlohmann::json();
    const bool understood = json.is_object() && json.contains("online") && json["online"].is_boolean() &&
        json.contains("timestamp") && json["timestamp"].is_number_integer();
    if (!understood) return refuse("a state of the primary host that is no {\"online\":...,\"timestamp\":...}");
    const auto time = json["timestamp"].get<std::int64_t>();
    if (time < host_time_) return;  // older than the known state
    // A time in the future would make every later state too old: it counts as now.
    host_time_ = std::min<std::int64_t>(time, now);
    const bool online = json["online"].get<bool>();
    if (online && session_ == Session::waiting) birth(now);
    if (!online && session_ == Session::born) {
        publish_death(now);
        leaving_ = true;
    }
}

// -- results

void EdgeNode::use_store(const std::string& id, std::int64_t newest, bool is_new) {
    newest_ = newest;
    if (cursor_.store.empty()) {
        cursor_.store = id;
        cursor_.origin = cursor_.confirmed = options_.begin_with_all || is_new ? 0 : newest;
    } else if (cursor_.store != id) {
        trouble_ = "the station has another store now; its results are handed over from the first one on";
        const std::uint64_t lost = cursor_.lost;
        cursor_ = {id, 0, 0, cursor_.bd_seq, lost, 0};
    } else if (newest < cursor_.confirmed) {
        trouble_ = fmt::format(
            "the store ends with result {}, and {} were handed over: it was put back to an older state, and who reads "
            "takes numbers that come again for repeats",
            newest, cursor_.confirmed);
        cursor_.confirmed = newest;
        cursor_.origin = std::min(cursor_.origin, newest);
        cursor_.lost_until = std::min(cursor_.lost_until, newest);
    }
    store_known_ = true;
    open_.clear();
    begin_results();
}

// After a birth, or with another store.
void EdgeNode::begin_results() {
    next_ = std::max(cursor_.origin, cursor_.confirmed - options_.repeat) + 1;
    old_until_.reset();
    probe_at_ = 0;
    allowance_ = static_cast<double>(options_.in_flight);
}

std::optional<EdgeNode::Demand> EdgeNode::demand(UtcMs now) {
    if (session_ != Session::born || !store_known_) return std::nullopt;
    const std::size_t window = no_subscriber_ ? 1 : options_.in_flight;
    const bool too_early = now < probe_at_ && probe_at_ - now <= kProbeEvery;
    if (open_.size() >= window || too_early) return std::nullopt;
    std::size_t count = window - open_.size();
    const bool old = !old_until_ || next_ <= *old_until_;
    if (old && options_.history_per_s > 0) {
        const double passed_s =
            static_cast<double>(std::clamp<UtcMs>(now - std::exchange(allowance_at_, now), 0, 1000)) / 1000;
        allowance_ = std::min(allowance_ + passed_s * options_.history_per_s, static_cast<double>(options_.in_flight));
        count = std::min(count, static_cast<std::size_t>(allowance_));
        if (count == 0) return std::nullopt;
    }
    return Demand{next_ - 1, count};
}

void EdgeNode::offer(std::span<const store::StoredResult> results, std::int64_t newest, UtcMs now) {
    newest_ = newest;
    if (session_ != Session::born) return;
    if (!old_until_) old_until_ = newest;
    for (const store::StoredResult& result : results) {
        if (result.number < next_) continue;
        // Numbers have no gaps: missing results that were not delivered are lost.
        const std::int64_t missing = std::max({next_, cursor_.confirmed + 1, cursor_.lost_until + 1});
        if (result.number > missing) {
            cursor_.lost += static_cast<std::uint64_t>(result.number - missing);
            cursor_.lost_until = result.number - 1;
            trouble_ = fmt::format(
                "results {} to {} were removed from the store before they could be handed over: keep results longer "
                "(store.keep_days, store.keep_mb)",
                missing, result.number - 1);
        }
        const bool historical = result.number <= *old_until_;
        if (historical) allowance_ -= 1;
        next_ = result.number + 1;
        if (options_.qos > 0 || &result == results.data()) ++token_;
        open_.push_back({token_, result.number, Delivery::pending});
        Payload payload;
        payload.metrics = result_metrics(&result, cursor_.store, historical);
        publish("NDATA", std::move(payload), options_.qos > 0 ? token_ : 0, now);
    }
    if (options_.qos == 0 && !results.empty()) outbox_.push_back({topics().front(), {}, 1, token_, true});
}

void EdgeNode::confirmed(std::uint64_t token, bool had_subscriber, UtcMs now) {
    for (Open& open : open_) {
        if (open.token == token) open.delivery = had_subscriber ? Delivery::confirmed : Delivery::no_subscriber;
    }
    settle(now);
}

void EdgeNode::settle(UtcMs now) {
    while (!open_.empty() && open_.front().delivery == Delivery::confirmed) {
        cursor_.confirmed = std::max(cursor_.confirmed, open_.front().number);
        open_.pop_front();
        no_subscriber_ = false;
    }
    if (open_.empty() || open_.front().delivery != Delivery::no_subscriber) return;
    // No subscriber. When all results are answered, one result at a time probes for a subscriber.
    if (std::any_of(open_.begin(), open_.end(), [](const Open& open) { return open.delivery == Delivery::pending; }))
        return;
    if (!no_subscriber_) trouble_ = "the broker has nobody who reads results: they wait in the store";
    open_.clear();
    no_subscriber_ = true;
    next_ = cursor_.confirmed + 1;
    probe_at_ = now + kProbeEvery;
}

}  // namespace hord::firmware::mqtt
