// One connection to an MQTT broker over libmosquitto. Each session has a new one, so nothing of an old one is resent.
//
// One thread; serve() does all the work. Memory: the caller's messages in flight, and one incoming packet of at most 16
// kB (MQTT 5 announces that limit to the broker; 3.1.1 cannot, and the service's MemoryMax is the limit).
#pragma once

#include <chrono>
#include <cstdint>
#include <filesystem>
#include <memory>
#include <string>
#include <vector>

#include "firmware/mqtt/edge_node.h"

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
        std::string topic, payload;  // message
        std::uint64_t token = 0;     // confirmed
        bool retained = false;       // message: a retained one
        bool had_subscriber = true;  // confirmed: somebody is subscribed to it
        Error error = {};            // closed
    };

    // Resolves and connects: blocks for as long as the system takes for that. The broker's answer comes as an event:
    // subscribed once it has accepted login, and then every topic. Fails with not_found (a TLS file), disconnected,
    // invalid_argument.
    static Result<std::unique_ptr<BrokerLink>> connect(const BrokerOptions& options, const Outgoing& will,
                                                       std::vector<std::string> topics);
    ~BrokerLink();

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
    struct Parts;
    explicit BrokerLink(std::unique_ptr<Parts> parts);
    std::unique_ptr<Parts> parts_;
};

}  // namespace hord::firmware::mqtt
