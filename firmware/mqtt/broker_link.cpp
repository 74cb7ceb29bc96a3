#include "firmware/mqtt/broker_link.h"

#include <algorithm>
#include <cerrno>
#include <cstring>
#include <utility>

#include <fmt/format.h>
#include <mosquitto.h>
#include <mqtt_protocol.h>
#include <unistd.h>

namespace hord::firmware::mqtt {
namespace {

using Clock = std::chrono::steady_clock;

constexpr std::uint32_t kLargestPacket = 16'384;
constexpr std::size_t kMaxUnanswered = 1100;              // more than results may be in flight
constexpr auto kAnswerWithin = std::chrono::seconds(15);  // from the connection to the last subscription

// libmosquitto is initialised once a process.
struct Library {
    Library() { mosquitto_lib_init(); }
    ~Library() { mosquitto_lib_cleanup(); }
    Library(const Library&) = delete;
    Library& operator=(const Library&) = delete;
};

struct FreeProperties {
    void operator()(mosquitto_property* all) const { mosquitto_property_free_all(&all); }
};

// A key with a passphrase cannot be used: there is no terminal.
int no_passphrase(char*, int, int, void*) { return 0; }

Result<void> check_readable(const std::filesystem::path& file, const char* what) {
    if (::access(file.c_str(), R_OK) == 0) return {};
    return fail(ErrorCode::not_found,
                fmt::format("{} {} cannot be read ({})", what, file.string(), std::strerror(errno)),
                "check [tls] in the configuration, and the file's owner");
}

}  // namespace

void BrokerLink::FreeClient::operator()(mosquitto* client) const { mosquitto_destroy(client); }

std::string BrokerLink::where() const { return fmt::format("broker {}:{}", options_.host, options_.port); }

void BrokerLink::close(ErrorCode code, const std::string& what, const std::string& cure) {
    if (std::exchange(closed_, true)) return;
    events_.push_back({.kind = Event::Kind::closed, .error = {code, where() + " " + what, cure}});
}

void BrokerLink::on_connect(int code) {
    if (code == 0) {
        for (const std::string& topic : topics_) {
            const int done = mosquitto_subscribe(client_.get(), nullptr, topic.c_str(), 1);
            if (done != MOSQ_ERR_SUCCESS)
                close(ErrorCode::disconnected,
                      std::string("cannot be asked for ") + topic + ": " + mosquitto_strerror(done),
                      "it is tried again");
        }
        return;
    }
    const bool v5 = options_.protocol == 5;
    const std::string reason = v5 && code >= 0x80 ? mosquitto_reason_string(code) : mosquitto_connack_string(code);
    if (code == 4 || code == 5 || code == MQTT_RC_BAD_USERNAME_OR_PASSWORD || code == MQTT_RC_NOT_AUTHORIZED) {
        close(ErrorCode::refused,
              fmt::format("refuses the login of {} ({})",
                          options_.user.empty() ? "nobody" : "\"" + options_.user + "\"", reason),
              "check broker.user, the password file, and the broker's access list");
    } else if (code == 1 || code == MQTT_RC_UNSUPPORTED_PROTOCOL_VERSION) {
        close(ErrorCode::unsupported, fmt::format("does not speak this MQTT version ({})", reason),
              "set broker.protocol = \"3.1.1\"");
    } else {
        close(ErrorCode::refused, fmt::format("refuses the connection ({})", reason), "see the broker's log");
    }
}

void BrokerLink::on_subscribe(int id, std::span<const int> granted) {
    if (const auto fence = tokens_.find(id); fence != tokens_.end()) {
        events_.push_back({.kind = Event::Kind::confirmed, .token = fence->second});
        tokens_.erase(fence);
        return;
    }
    if (std::ranges::any_of(granted, [](int qos) { return qos >= 0x80; }))
        return close(ErrorCode::refused, "does not let this station read " + topics_.front(),
                     "let its user read that topic in the broker's access list");
    if (++subscriptions_ < topics_.size() || std::exchange(subscribed_, true)) return;
    events_.push_back({.kind = Event::Kind::subscribed});
}

void BrokerLink::on_publish(int id, int code) {
    const auto at = tokens_.find(id);
    if (at == tokens_.end()) return;
    if (code >= 0x80) {
        return close(ErrorCode::refused,
                     fmt::format("refuses what this station publishes ({})", mosquitto_reason_string(code)),
                     "let this station's user write its topics in the broker's access list");
    }
    if (at->second != 0) {
        events_.push_back({.kind = Event::Kind::confirmed,
                           .token = at->second,
                           .had_subscriber = code != MQTT_RC_NO_MATCHING_SUBSCRIBERS});
    }
    tokens_.erase(at);
}

void BrokerLink::on_disconnect(int code) {
    if (code != MQTT_RC_SESSION_TAKEN_OVER) return;
    close(ErrorCode::busy, "has let another station in that calls itself \"" + options_.client_id + "\"",
          "give each station a sparkplug.node of its own");
}

void BrokerLink::on_message(const mosquitto_message& message) {
    Event& event = events_.emplace_back();
    event.kind = Event::Kind::message;
    event.topic = message.topic;
    event.retained = message.retain;
    // One byte above the limit is enough to refuse a payload that is too large.
    event.payload.assign(static_cast<const char*>(message.payload),
                         std::min<std::size_t>(static_cast<std::size_t>(message.payloadlen), kMaxCommandBytes + 1));
}

Result<void> BrokerLink::use_tls() {
    if (options_.ca.empty()) return {};
    if (auto done = check_readable(options_.ca, "the certificate authority"); !done) return done;
    const bool own = !options_.certificate.empty();
    if (own) {
        if (auto done = check_readable(options_.certificate, "the client certificate"); !done) return done;
        if (auto done = check_readable(options_.key, "the client certificate's key"); !done) return done;
    }
    const int done =
        mosquitto_tls_set(client_.get(), options_.ca.c_str(), nullptr, own ? options_.certificate.c_str() : nullptr,
                          own ? options_.key.c_str() : nullptr, no_passphrase);
    if (done != MOSQ_ERR_SUCCESS)
        return fail(ErrorCode::invalid_argument, fmt::format("TLS cannot be set up ({})", mosquitto_strerror(done)),
                    "check [tls] in the configuration");
    return {};
}

Result<void> BrokerLink::prepare(const Outgoing& will) {
    mosquitto* const client = client_.get();
    const int size = static_cast<int>(will.payload.size());
    const std::pair<int, const char*> settings[] = {
        {mosquitto_int_option(client, MOSQ_OPT_PROTOCOL_VERSION,
                              options_.protocol == 5 ? MQTT_PROTOCOL_V5 : MQTT_PROTOCOL_V311),
         "protocol"},
        {mosquitto_int_option(client, MOSQ_OPT_TCP_NODELAY, 1), "option"},
        {mosquitto_int_option(client, MOSQ_OPT_SEND_MAXIMUM, 65'535), "option"},  // the broker's own limit holds
        {options_.user.empty() ? MOSQ_ERR_SUCCESS
                               : mosquitto_username_pw_set(client, options_.user.c_str(), options_.password.c_str()),
         "login"},
        {mosquitto_will_set(client, will.topic.c_str(), size, will.payload.data(), will.qos, false), "will"},
    };
    for (const auto& [code, what] : settings) {
        if (code == MOSQ_ERR_SUCCESS) continue;
        return fail(ErrorCode::invalid_argument,
                    fmt::format("{} {} cannot be used ({})", where(), what, mosquitto_strerror(code)),
                    "check [broker] in the configuration");
    }
    if (auto done = use_tls(); !done) return done;
    mosquitto_connect_v5_callback_set(client, [](mosquitto*, void* self, int code, int, const mosquitto_property*) {
        static_cast<BrokerLink*>(self)->on_connect(code);
    });
    mosquitto_subscribe_v5_callback_set(
        client, [](mosquitto*, void* self, int id, int count, const int* granted, const mosquitto_property*) {
            static_cast<BrokerLink*>(self)->on_subscribe(id, {granted, static_cast<std::size_t>(count)});
        });
    mosquitto_publish_v5_callback_set(client, [](mosquitto*, void* self, int id, int code, const mosquitto_property*) {
        static_cast<BrokerLink*>(self)->on_publish(id, code);
    });
    mosquitto_disconnect_v5_callback_set(client, [](mosquitto*, void* self, int code, const mosquitto_property*) {
        static_cast<BrokerLink*>(self)->on_disconnect(code);
    });
    mosquitto_message_v5_callback_set(
        client, [](mosquitto*, void* self, const mosquitto_message* message, const mosquitto_property*) {
            static_cast<BrokerLink*>(self)->on_message(*message);
        });
    return {};
}

Result<std::unique_ptr<BrokerLink>> BrokerLink::connect(const BrokerOptions& options, const Outgoing& will,
                                                        std::vector<std::string> topics) {
    static const Library library;
    std::unique_ptr<BrokerLink> link(new BrokerLink(options, std::move(topics)));
    link->client_.reset(mosquitto_new(options.client_id.c_str(), true, link.get()));
    if (!link->client_)
        return fail(ErrorCode::invalid_argument, "\"" + options.client_id + "\" cannot be a client id",
                    "set broker.client_id to a name without control characters");
    if (auto done = link->prepare(will); !done) return tl::unexpected(done.error());

    mosquitto_property* list = nullptr;
    if (options.protocol == 5) mosquitto_property_add_int32(&list, MQTT_PROP_MAXIMUM_PACKET_SIZE, kLargestPacket);
    const std::unique_ptr<mosquitto_property, FreeProperties> properties(list);
    errno = 0;
    const int done = mosquitto_connect_bind_v5(link->client_.get(), options.host.c_str(), options.port,
                                               options.keepalive_s, nullptr, properties.get());
    if (done != MOSQ_ERR_SUCCESS) {
        const int why = errno;
        const std::string reason = done == MOSQ_ERR_ERRNO ? std::strerror(why) : mosquitto_strerror(done);
        const char* cure = done == MOSQ_ERR_TLS
            ? "check [tls]: authority, certificate, key, and that the broker's certificate names this host"
            : "check broker.host and broker.port, and that the broker runs";
        return fail(ErrorCode::disconnected, link->where() + " cannot be reached (" + reason + ")", cure);
    }
    return link;
}

std::vector<BrokerLink::Event> BrokerLink::serve(std::chrono::milliseconds wait) {
    if (!closed_) {
        errno = 0;
        const int done = mosquitto_loop(client_.get(), static_cast<int>(wait.count()), 1);
        if (done == MOSQ_ERR_TLS) {
            close(ErrorCode::refused, "and this station do not agree on TLS",
                  "check [tls]: authority, certificate, key, and that the broker's certificate names this host");
        } else if (done != MOSQ_ERR_SUCCESS && !leaving_ && !(done == MOSQ_ERR_ERRNO && errno == EINTR)) {
            close(ErrorCode::disconnected, fmt::format("is gone ({})", mosquitto_strerror(done)),
                  "it is tried again; see the broker's log and the network");
        } else if (!subscribed_ && Clock::now() - began_ > kAnswerWithin) {
            close(ErrorCode::timeout, "does not answer",
                  "check that an MQTT broker listens there, and whether it wants TLS");
        }
    }
    return std::exchange(events_, {});
}

Result<void> BrokerLink::publish(const Outgoing& message) {
    int id = 0;
    const int done = message.fence
        ? mosquitto_subscribe(client_.get(), &id, message.topic.c_str(), message.qos)
        : mosquitto_publish(client_.get(), &id, message.topic.c_str(), static_cast<int>(message.payload.size()),
                            message.payload.data(), message.qos, false);
    if (done != MOSQ_ERR_SUCCESS)
        return fail(ErrorCode::disconnected, where() + " is gone (" + mosquitto_strerror(done) + ")",
                    "it is tried again; see the broker's log and the network");
    if (message.qos > 0) tokens_.emplace(id, message.token);
    return {};
}

bool BrokerLink::congested() const { return mosquitto_want_write(client_.get()) || tokens_.size() > kMaxUnanswered; }

void BrokerLink::leave(std::chrono::milliseconds patience) {
    leaving_ = true;
    const auto until = Clock::now() + patience;
    while (!closed_ && (mosquitto_want_write(client_.get()) || !tokens_.empty())) {
        if (Clock::now() > until || mosquitto_loop(client_.get(), 10, 1) != MOSQ_ERR_SUCCESS) return;
    }
    if (closed_) return;
    mosquitto_disconnect(client_.get());
    for (int k = 0; k < 10 && mosquitto_want_write(client_.get()); ++k) mosquitto_loop(client_.get(), 10, 1);
}

}  // namespace hord::firmware::mqtt
