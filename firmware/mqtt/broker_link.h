// One connection to an MQTT broker over libmosquitto. Each session has a new one, so nothing of an old one is resent.
//
// One thread; serve() does all the work. Memory: the caller's messages in flight, and one incoming packet of at most 16
// kB (MQTT 5 announces that limit to the broker; 3.1.1 cannot, and the service's MemoryMax is the limit).
#pragma once

#include <chrono>
#include <cstdint>
#include <filesystem>
#include <memory>
#include <span>
#include <string>
#include <unordered_map>
#include <utility>
#include <vector>

#include "firmware/mqtt/edge_node.h"

struct mosquitto;  // of libmosquitto
struct mosquitto_message;

namespace hord::firmware::mqtt {

struct BrokerOptions {
    std::string host = "localhost";
    std::uint16_t port = 1883;
    int protocol = 5;  // MQTT 5, or 4: 3.1.1
    int keepalive_s = 30;
    std::string client_id;
    std::string user, password;
    std::filesystem::path ca, certificate, key;  // ca empty: no TLS
};

class BrokerLink {
  public:
    struct Event {
        enum class Kind : std::uint8_t { subscribed, message, confirmed, closed };
        Kind kind = Kind::closed;
        std::string topic = {}, payload = {};  // message
        std::uint64_t token = 0;               // confirmed
        bool retained = false;                 // message: a retained one
        bool had_subscriber = true;            // confirmed: the topic has a subscriber
        Error error = {};                      // closed
    };

    // Resolves and connects: blocks for as long as the system takes for that. The broker's answer comes as an event:
    // subscribed, after it has accepted the login and every topic. Fails with not_found (a TLS file), disconnected,
    // invalid_argument.
    static Result<std::unique_ptr<BrokerLink>> connect(const BrokerOptions& options, const Outgoing& will,
                                                       std::vector<std::string> topics);
    BrokerLink(const BrokerLink&) = delete;  // libmosquitto holds its address
    BrokerLink& operator=(const BrokerLink&) = delete;

    // Blocks for at most `wait`. After `closed` nothing follows.
    std::vector<Event> serve(std::chrono::milliseconds wait);

    // Fails with disconnected.
    Result<void> publish(const Outgoing& message);
    // The broker does not read or answer: send nothing that can wait.
    [[nodiscard]] bool congested() const;

    // Disconnects when everything is answered, so the broker does not publish the will. Blocks for at most `patience`;
    // after that the connection is dropped and the broker publishes the will.
    void leave(std::chrono::milliseconds patience);

  private:
    struct FreeClient {
        void operator()(mosquitto* client) const;
    };
    BrokerLink(BrokerOptions options, std::vector<std::string> topics)
        : options_(std::move(options)), topics_(std::move(topics)) {}
    Result<void> prepare(const Outgoing& will);
    Result<void> use_tls();
    [[nodiscard]] std::string where() const;
    void close(ErrorCode code, const std::string& what, const std::string& cure);
    // The broker's answers; `code` of MQTT 3.1.1 or 5.
    void on_connect(int code);
    void on_subscribe(int id, std::span<const int> granted);
    void on_publish(int id, int code);
    void on_disconnect(int code);
    void on_message(const mosquitto_message& message);

    const BrokerOptions options_;
    const std::vector<std::string> topics_;
    std::unique_ptr<mosquitto, FreeClient> client_;
    std::vector<Event> events_;
    std::unordered_map<int, std::uint64_t> tokens_;  // of unanswered message ids; 0: no confirmation wanted
    std::size_t subscriptions_ = 0;                  // answered
    const std::chrono::steady_clock::time_point began_ = std::chrono::steady_clock::now();
    bool subscribed_ = false, closed_ = false, leaving_ = false;
};

}  // namespace hord::firmware::mqtt
