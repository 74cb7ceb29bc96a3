// The environment of hord-mqtt: a mosquitto on its own port, a network that can be cut, a consumer, and a decoder that
// shares no code with the station.
#pragma once

#include <atomic>
#include <chrono>
#include <cstdint>
#include <functional>
#include <map>
#include <memory>
#include <optional>
#include <string>
#include <thread>
#include <vector>

#include "tests/system/cli/program.h"

namespace hord::test {

// Empty if all of them are installed; else the one-line reason for skipping the test.
std::string missing_tools();

int free_port();
bool wait_until(const std::function<bool()>& holds, std::chrono::seconds patience = std::chrono::seconds(120));

class Broker {
  public:
    // `more`: further configuration lines. With `tls`, clients need a certificate of the CA.
    Broker(const std::string& folder, const std::string& more = {}, bool tls = false);
    void start();
    void stop(int signal);
    [[nodiscard]] int port() const { return port_; }

  private:
    std::string folder_;
    int port_ = free_port();
    std::unique_ptr<Running> process_;
};

// A TCP connection to the broker that can be cut, or can discard all data.
class Network {
  public:
    explicit Network(int to_port);
    ~Network();
    Network(const Network&) = delete;
    Network& operator=(const Network&) = delete;
    [[nodiscard]] int port() const { return port_; }
    void cut() { ++cuts_; }                            // ends all connections; new ones work
    void refuse(bool whether) { refuses_ = whether; }  // new connections end at once

  private:
    void run();
    int to_port_, port_ = 0, listener_ = -1;
    std::atomic<int> cuts_{0};
    std::atomic<bool> refuses_{false}, ends_{false};
    std::thread thread_;
};

// One field of a protobuf message, decoded without a library.
struct Field {
    std::uint32_t number = 0;
    std::uint64_t value = 0;
    std::string bytes;
};
std::vector<Field> fields_of(const std::string& bytes);

struct ReadMetric {
    std::string name, text;
    std::uint64_t alias = 0, time = 0, type = 0, whole = 0;
    bool historical = false, null = false, truth = false;
};
struct ReadMessage {
    std::string topic, payload;
    int qos = 0;
    std::optional<std::uint64_t> seq;
    std::vector<ReadMetric> metrics;
    [[nodiscard]] const ReadMetric* find(const std::string& name) const;
    [[nodiscard]] const ReadMetric* find(std::uint64_t alias) const;
};

// Subscribes to everything with QoS 1 in a persistent session: the broker queues messages while it is disconnected.
class Consumer {
  public:
    Consumer(const std::string& folder, int port, const std::vector<std::string>& more = {});
    std::vector<ReadMessage> all();
    std::vector<ReadMessage> of(const std::string& type);  // "NBIRTH"
    // Arrivals of each result, by its number.
    std::map<std::uint64_t, int> results();

  private:
    std::string file_;
    std::unique_ptr<Running> process_;
};

}  // namespace hord::test
