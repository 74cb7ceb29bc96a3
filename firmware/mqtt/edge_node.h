// A station as a Sparkplug B edge node, without I/O: events in, messages to publish out. docs/mqtt.md has its
// guarantees.
//
// A session is one MQTT connection. It begins with a birth certificate (all metrics, seq 0), ends with a death
// certificate that the broker holds as its will, and both carry the same bdSeq. In between every message counts seq on,
// 0 to 255 and again.
//
// Results are published in the order of their numbers and stay open until confirmed; the cursor is below the oldest
// open one. Results not confirmed at the end of a session are published again in the next: none is lost, and a
// subscriber recognises a repeat by its store and number.
#pragma once

#include <cstdint>
#include <deque>
#include <optional>
#include <span>
#include <string>
#include <utility>
#include <vector>

#include "firmware/mqtt/cursor.h"
#include "firmware/mqtt/metrics.h"

namespace hord::firmware::mqtt {

struct NodeOptions {
    std::string group = "hord", node;
    std::string primary_host;     // its host id; empty: none
    std::string software;         // version
    int qos = 1;                  // of all messages with seq: brokers may reorder messages of different QoS
    std::size_t in_flight = 64;   // most open results
    int repeat = 100;             // newest confirmed results published again after each birth
    int history_per_s = 500;      // rate of results older than the birth; 0: no limit
    bool begin_with_all = false;  // at the first start: also the results already in the store
};

struct Outgoing {
    std::string topic, payload;
    int qos = 0;
    std::uint64_t token = 0;  // not 0: confirmed() must be called with it
    bool fence = false;       // publishes nothing: confirms `token` when the broker has read all before it
};

class EdgeNode {
  public:
    EdgeNode(NodeOptions options, Cursor cursor);

    // -- the connection. Times are UTC; the clock may be set meanwhile.

    // Before each attempt to connect: increments bdSeq (save it before the attempt) and returns the will.
    Outgoing begin_session(UtcMs now);
    [[nodiscard]] std::vector<std::string> topics() const;  // to subscribe to, with QoS 1
    void connected(UtcMs now);                              // and subscribed
    void disconnected();
    void message(const std::string& topic, std::string_view payload, UtcMs now, bool retained = false);
    // `had_subscriber`: the broker delivered it to at least one subscriber.
    void confirmed(std::uint64_t token, bool had_subscriber, UtcMs now);

    // -- the data

    // The store of the results and its newest number: before the first demand(), and whenever the store changes.
    // `is_new`: it did not exist before, so nothing in it is older than this node.
    void use_store(const std::string& id, std::int64_t newest, bool is_new = false);
    struct Demand {
        std::int64_t after = 0;
        std::size_t count = 0;
    };
    // The results to offer() now: `count` from number after + 1 on.
    [[nodiscard]] std::optional<Demand> demand(UtcMs now);
    void offer(std::span<const store::StoredResult> results, std::int64_t newest, UtcMs now);

    // The station's registers; empty: it does not answer. Publishes the changes.
    void set_readings(const std::vector<Reading>& readings, UtcMs now);
    void step(UtcMs now);           // call regularly
    void publish_death(UtcMs now);  // publishes the death certificate

    [[nodiscard]] std::vector<Outgoing> take_outgoing() { return std::exchange(outbox_, {}); }
    // The primary host is offline: disconnect and connect again.
    [[nodiscard]] bool wants_to_leave() const { return leaving_; }

    // -- the state

    [[nodiscard]] std::uint64_t refused() const { return refused_; }  // commands
    [[nodiscard]] const Cursor& cursor() const { return cursor_; }
    [[nodiscard]] bool born() const { return session_ == Session::born; }
    [[nodiscard]] bool waits_for_host() const { return session_ == Session::waiting; }
    [[nodiscard]] std::size_t open() const { return open_.size(); }
    // A new problem to log, once: "a command of 9999 bytes: ...". Empty: none.
    [[nodiscard]] std::string trouble() { return std::exchange(trouble_, {}); }

  private:
    enum class Session : std::uint8_t { none, waiting, born };
    enum class Delivery : std::uint8_t { pending, confirmed, no_subscriber };
    struct Open {
        std::uint64_t token;
        std::int64_t number;
        Delivery delivery;
    };
    [[nodiscard]] std::string topic(const char* type) const;
    [[nodiscard]] std::string state_topic() const;
    [[nodiscard]] Payload death(UtcMs now) const;
    [[nodiscard]] std::vector<Metric> node_metrics() const;
    void birth(UtcMs now);
    void publish(const char* type, Payload payload, std::uint64_t token, UtcMs now);
    void host_state(std::string_view text, UtcMs now);
    void command(std::string_view bytes);
    void refuse(const std::string& why);
    void settle(UtcMs now);
    void begin_results();

    const NodeOptions options_;
    Cursor cursor_;
    Session session_ = Session::none;
    std::vector<Outgoing> outbox_;
    std::uint64_t refused_ = 0;
    std::string trouble_;
    bool leaving_ = false;

    std::uint8_t seq_ = 0;
    UtcMs born_at_ = 0;
    bool rebirth_ = false;
    std::int64_t host_time_ = 0;  // of the newest state of the primary host

    std::vector<Reading> readings_;
    std::vector<Metric> published_;  // as last published

    bool store_known_ = false;
    std::int64_t next_ = 1, newest_ = 0;
    std::optional<std::int64_t> old_until_;  // results up to this number are older than the birth: historical
    std::deque<Open> open_;
    std::uint64_t token_ = 0;
    double allowance_ = 0;
    UtcMs allowance_at_ = 0;
    bool no_subscriber_ = false;
    UtcMs probe_at_ = 0;
};

}  // namespace hord::firmware::mqtt
