// Runs an edge node: broker connection, results of the store, station's registers. One thread, one step at a time.
#pragma once

#include <chrono>
#include <deque>
#include <functional>
#include <memory>
#include <optional>
#include <random>
#include <string>
#include <utility>

#include "firmware/mqtt/broker_link.h"
#include "firmware/mqtt/edge_node.h"
#include "firmware/mqtt/mqtt_config.h"
#include "firmware/mqtt/result_feed.h"

namespace hord::firmware::mqtt {

class Agent {
  public:
    using Clock = std::chrono::steady_clock;
    // The station's registers; empty: it does not answer. May block as long as a Modbus request.
    using ReadStation = std::function<std::vector<Reading>()>;
    // Log lines: the same line at most once in ten minutes or a session; ten at once, then one a second.
    // A connection that the broker ends again and again soon after it was accepted is taken for one whose place another
    // client of the same name takes: not every broker says so.
    using Log = std::function<void(const std::string&)>;

    // Locks and reads the state file. Fails as lock_cursor() and read_cursor() do.
    static Result<std::unique_ptr<Agent>> open(MqttConfig config, std::unique_ptr<ResultSource> results,
                                               ReadStation read_station, Log log);

    // Does what is due; waits at most `wait` for the broker.
    void step(std::chrono::milliseconds wait);

    // Publishes the death certificate, disconnects, saves the cursor.
    void close();

    [[nodiscard]] const EdgeNode& node() const { return node_; }
    [[nodiscard]] std::string status() const;  // one line for people

  private:
    Agent(MqttConfig config, std::unique_ptr<ResultSource> results, ReadStation read_station, Log log,
          common::UniqueFd lock, const Cursor& cursor);
    void connect();
    void drop_connection(const Error& error);
    void handle(const BrokerLink::Event& event);
    void read_results();
    void poll_station();
    void send();
    bool save_cursor(bool now);
    void log(const std::string& line);        // subject to the limits of Log
    void log_event(const std::string& line);  // begins the repetition anew
    bool may_log(Clock::time_point now);

    const MqttConfig config_;
    const std::unique_ptr<ResultSource> results_;
    const ReadStation read_station_;
    const Log log_;
    const common::UniqueFd lock_;  // of the state file
    EdgeNode node_;
    std::unique_ptr<BrokerLink> link_;
    std::mt19937 random_{std::random_device{}()};

    Clock::time_point connect_at_{}, station_at_{}, read_at_{}, write_at_{};
    std::chrono::milliseconds backoff_{0};          // before the next attempt
    bool useful_ = false;                           // this connection delivered a result
    std::optional<Clock::time_point> accepted_at_;  // this connection
    int ended_soon_ = 0;                            // accepted connections in a row that ended soon
    std::string store_;
    std::deque<std::pair<std::string, Clock::time_point>> recent_lines_;  // the newest few
    double lines_left_ = 10;
    Clock::time_point lines_at_{};
    std::int64_t newest_ = 0;
    bool store_was_missing_ = false;
    Cursor saved_;
};

}  // namespace hord::firmware::mqtt
