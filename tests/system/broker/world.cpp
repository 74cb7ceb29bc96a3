#include "tests/system/broker/world.h"

#include <csignal>
#include <cstdlib>
#include <fstream>
#include <list>
#include <sstream>
#include <stdexcept>

#include <arpa/inet.h>
#include <netinet/in.h>
#include <poll.h>
#include <sys/socket.h>
#include <unistd.h>

namespace hord::test {
namespace {

sockaddr_in loopback(int port) {
    sockaddr_in address{};
    address.sin_family = AF_INET;
    address.sin_addr.s_addr = htonl(INADDR_LOOPBACK);
    address.sin_port = htons(static_cast<std::uint16_t>(port));
    return address;
}

int listen_anywhere(int& port) {
    const int fd = socket(AF_INET, SOCK_STREAM | SOCK_CLOEXEC, 0);
    sockaddr_in address = loopback(0);
    socklen_t size = sizeof address;
    if (fd < 0 || bind(fd, reinterpret_cast<sockaddr*>(&address), size) != 0 || listen(fd, 16) != 0)
        throw std::runtime_error("no port");
    getsockname(fd, reinterpret_cast<sockaddr*>(&address), &size);
    port = ntohs(address.sin_port);
    return fd;
}

bool answers(int port) {
    const int fd = socket(AF_INET, SOCK_STREAM | SOCK_CLOEXEC, 0);
    const sockaddr_in address = loopback(port);
    const bool connected = connect(fd, reinterpret_cast<const sockaddr*>(&address), sizeof address) == 0;
    close(fd);
    return connected;
}

bool installed(const char* tool) {
    return std::system((std::string("PATH=$PATH:/usr/sbin command -v ") + tool + " >/dev/null").c_str()) == 0;
}

}  // namespace

std::string missing_tools() {
    for (const char* tool : {"mosquitto", "mosquitto_sub", "mosquitto_pub", "openssl"}) {
        if (!installed(tool))
            return std::string(tool) + " is not installed (apt-get install mosquitto mosquitto-clients openssl)";
    }
    return {};
}

int free_port() {
    int port = 0;
    close(listen_anywhere(port));
    return port;
}

bool wait_until(const std::function<bool()>& holds, std::chrono::seconds patience) {
    const auto until = std::chrono::steady_clock::now() + patience;
    while (!holds()) {
        if (std::chrono::steady_clock::now() > until) return false;
        poll(nullptr, 0, 20);
    }
    return true;
}

// -- the broker

Broker::Broker(const std::string& folder, const std::string& more, bool tls) : folder_(folder) {
    std::ofstream out(folder + "/mosquitto.conf");
    out << "listener " << port_ << " 127.0.0.1\npersistence true\npersistence_location " << folder
        << "/\nmax_queued_messages 0\nautosave_interval 1\n";
    if (getuid() == 0) out << "user root\n";
    if (tls)
        out << "cafile " << folder << "/ca.pem\ncertfile " << folder << "/broker.pem\nkeyfile " << folder
            << "/broker.key\nrequire_certificate true\n";
    out << (more.empty() ? "allow_anonymous true\n" : more);
    out.close();
    start();
}

void Broker::start() {
    const char* program = access("/usr/sbin/mosquitto", X_OK) == 0 ? "/usr/sbin/mosquitto" : "/usr/bin/mosquitto";
    process_ = std::make_unique<Running>(program, std::vector<std::string>{"-c", folder_ + "/mosquitto.conf"});
    if (!wait_until([&] { return answers(port_); }))
        throw std::runtime_error("mosquitto does not start: " + process_->so_far().err);
}

void Broker::stop(int signal) {
    process_->stop(signal);
    process_.reset();
}

// -- the network

Network::Network(int to_port) : to_port_(to_port), listener_(listen_anywhere(port_)), thread_([this] { run(); }) {}

Network::~Network() {
    ends_ = true;
    thread_.join();
    close(listener_);
}

void Network::run() {
    struct Pair {
        int a, b;
    };
    std::list<Pair> pairs;
    int cuts = cuts_;
    const auto drop = [](const Pair& pair) {
        close(pair.a);
        close(pair.b);
    };
    const auto pass = [](int from, int to) {
        char bytes[4096];
        const ssize_t got = recv(from, bytes, sizeof bytes, 0);
        return got > 0 && send(to, bytes, static_cast<std::size_t>(got), MSG_NOSIGNAL) == got;
    };
    while (!ends_) {
        if (cuts != cuts_) {
            cuts = cuts_;
            for (const Pair& pair : pairs) drop(pair);
            pairs.clear();
        }
        std::vector<pollfd> fds{{listener_, POLLIN, 0}};
        for (const Pair& pair : pairs) {
            fds.push_back({pair.a, POLLIN, 0});
            fds.push_back({pair.b, POLLIN, 0});
        }
        if (poll(fds.data(), fds.size(), 5) <= 0) continue;
        std::size_t at = 1;
        for (auto pair = pairs.begin(); pair != pairs.end(); at += 2) {
            const bool alive = (fds[at].revents == 0 || pass(pair->a, pair->b)) &&
                (fds[at + 1].revents == 0 || pass(pair->b, pair->a));
            if (!alive) drop(*pair);
            pair = alive ? std::next(pair) : pairs.erase(pair);
        }
        if (fds[0].revents == 0) continue;
        const int a = accept4(listener_, nullptr, nullptr, SOCK_CLOEXEC);
        const int b = socket(AF_INET, SOCK_STREAM | SOCK_CLOEXEC, 0);
        const sockaddr_in address = loopback(to_port_);
        if (refuses_ || connect(b, reinterpret_cast<const sockaddr*>(&address), sizeof address) != 0) drop({a, b});
        else pairs.push_back({a, b});
    }
    for (const Pair& pair : pairs) drop(pair);
}

// -- the decoder

std::vector<Field> fields_of(const std::string& bytes) {
    std::vector<Field> fields;
    std::size_t at = 0;
    const auto varint = [&] {
        std::uint64_t value = 0;
        for (int shift = 0; at < bytes.size(); shift += 7) {
            const auto byte = static_cast<unsigned char>(bytes[at++]);
            value |= static_cast<std::uint64_t>(byte & 0x7F) << shift;
            if (byte < 0x80) break;
        }
        return value;
    };
    while (at < bytes.size()) {
        const std::uint64_t key = varint();
        Field field;
        field.number = static_cast<std::uint32_t>(key >> 3);
        if ((key & 7) == 0) field.value = varint();
        else if ((key & 7) == 2) {
            const std::size_t size = varint();
            field.bytes = bytes.substr(at, size);
            at += size;
        } else if ((key & 7) == 1) {
            field.bytes = bytes.substr(at, 8);
            at += 8;
        } else {
            throw std::runtime_error("no payload of a station");
        }
        fields.push_back(std::move(field));
    }
    return fields;
}

const ReadMetric* ReadMessage::find(const std::string& name) const {
    for (const ReadMetric& metric : metrics) {
        if (metric.name == name) return &metric;
    }
    return nullptr;
}
const ReadMetric* ReadMessage::find(std::uint64_t alias) const {
    for (const ReadMetric& metric : metrics) {
        if (metric.alias == alias) return &metric;
    }
    return nullptr;
}

namespace {

ReadMessage decode(const std::string& topic, int qos, const std::string& payload) {
    ReadMessage message;
    message.topic = topic;
    message.payload = payload;
    message.qos = qos;
    if (topic.find("/STATE/") != std::string::npos || topic.find("/NCMD/") != std::string::npos)
        return message;  // not from a station
    for (const Field& field : fields_of(payload)) {
        if (field.number == 3) message.seq = field.value;
        if (field.number != 2) continue;
        ReadMetric metric;
        for (const Field& f : fields_of(field.bytes)) {
            switch (f.number) {
                case 1: metric.name = f.bytes; break;
                case 2: metric.alias = f.value; break;
                case 3: metric.time = f.value; break;
                case 4: metric.type = f.value; break;
                case 5: metric.historical = f.value != 0; break;
                case 7: metric.null = f.value != 0; break;
                case 11: metric.whole = f.value; break;
                case 14: metric.truth = f.value != 0; break;
                case 15: metric.text = f.bytes; break;
                default: break;
            }
        }
        message.metrics.push_back(std::move(metric));
    }
    return message;
}

}  // namespace

// -- the consumer

Consumer::Consumer(const std::string& folder, int port, const std::vector<std::string>& more)
    : file_(folder + "/messages") {
    std::vector<std::string> arguments{"-c",       "out=$1; shift; exec stdbuf -oL mosquitto_sub \"$@\" >\"$out\"",
                                       "sh",       file_,
                                       "-h",       "127.0.0.1",
                                       "-p",       std::to_string(port),
                                       "-t",       "spBv1.0/#",
                                       "-q",       "1",
                                       "-c",       "-i",
                                       "consumer", "-k",
                                       "5",        "-F",
                                       "%t %q %x", "-d"};
    arguments.insert(arguments.end(), more.begin(), more.end());
    process_ = std::make_unique<Running>("/bin/sh", arguments);
    if (!wait_until([&] {
            std::ifstream in(file_);
            std::stringstream text;
            text << in.rdbuf();
            return text.str().find("SUBACK") != std::string::npos;
        })) {
        throw std::runtime_error("no consumer: " + process_->stop(SIGTERM).err);
    }
}

std::vector<ReadMessage> Consumer::all() {
    std::ifstream in(file_);
    std::vector<ReadMessage> messages;
    for (std::string line; std::getline(in, line) && !in.eof();) {
        if (!line.starts_with("spBv1.0/")) continue;  // -d also prints the client's own actions
        std::istringstream words(line);
        std::string topic, hex, bytes;
        int qos = 0;
        words >> topic >> qos >> hex;
        for (std::size_t k = 0; k + 1 < hex.size(); k += 2)
            bytes += static_cast<char>(std::stoi(hex.substr(k, 2), nullptr, 16));
        messages.push_back(decode(topic, qos, bytes));
    }
    return messages;
}

std::vector<ReadMessage> Consumer::of(const std::string& type) {
    std::vector<ReadMessage> some;
    for (ReadMessage& message : all()) {
        if (message.topic.find("/" + type + "/") != std::string::npos) some.push_back(std::move(message));
    }
    return some;
}

std::map<std::uint64_t, int> Consumer::results() {
    std::map<std::uint64_t, int> numbers;
    for (const ReadMessage& message : of("NDATA")) {
        if (const ReadMetric* number = message.find(20'100)) ++numbers[number->whole];
    }
    return numbers;
}

}  // namespace hord::test
