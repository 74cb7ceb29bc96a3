// One edge node at work: its connection, its results and its station, carried forward a step at a time on one thread.
#pragma once

#include <chrono>
#include <deque>
#include <filesystem>
#include <functional>
#include <memory>
#include <optional>
#include <random>
#include <string>
#include <utility>

#include "firmware/mqtt/broker_link.h"
#include "firmware/mqtt/edge_node.h"
#include "firmware/mqtt/result_feed.h"

namespace hord::firmware::mqtt {

struct AgentOptions {
    BrokerOptions broker;
    NodeOptions node;
    std::filesystem::path state_file;
    std::chrono::milliseconds look_every{1000};
};

class Agent {
  public:
    using Clock = std::chrono::steady_clock;
    // What the station says of itself now; empty: it is not reached. May block for as long as a Modbus answer takes.
    using ReadStation = std::function<std::vector<Reading>()>;
    // Told what a person should know: the same line once in ten minutes or a session, and no more than about one a
    // second, whoever sends what.
    using Log = std::function<void(const std::string&)>;

    // Reads the state file. Fails as read_cursor() does.
    static Result<std::unique_ptr<Agent>> open(AgentOptions options, std::unique_ptr<ResultSource> results,
                                               ReadStation read_station, Log log);

    // Everything that is due, and at most `wait` for the broker.
    void step(std::chrono::milliseconds wait);

    // Death certificate, goodbye, and the cursor written down.
    void close();

    [[nodiscard]] const EdgeNode& node() const { return node_; }
    [[nodiscard]] std::string status() const;  // one line for people

  private:
    Agent(AgentOptions options, std::unique_ptr<ResultSource> results, ReadStation read_station, Log log,
          const Cursor& cursor);
    void connect();
    void drop_connection(const Error& error);
    void handle(const BrokerLink::Event& event);
    void read_results();
    void poll_station();
    void send();
    bool save_cursor(bool now);
    void log(const std::string& line);        // if there is room for it
    void log_event(const std::string& line);  // in any case; what follows is new

    const AgentOptions options_;
    const std::unique_ptr<ResultSource> results_;
    const ReadStation read_station_;
    const Log log_;
    EdgeNode node_;
    std::unique_ptr<BrokerLink> link_;
    std::mt19937 random_{std::random_device{}()};

    Clock::time_point connect_at_{}, station_at_{}, read_at_{}, write_at_{};
    std::chrono::milliseconds backoff_{0};  // before the next attempt
    bool useful_ = false;                   // this connection took a result
    std::string store_;
    std::deque<std::pair<std::string, Clock::time_point>> recent_lines_;  // the newest few
    double lines_left_ = 10;
    Clock::time_point lines_at_{};
    std::int64_t newest_ = 0;
    bool store_was_missing_ = false;
    Cursor saved_;
};

}  // namespace hord::firmware::mqtt
