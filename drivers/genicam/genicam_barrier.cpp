#include "drivers/genicam/genicam_barrier.h"

#include <algorithm>
#include <array>
#include <atomic>
#include <cerrno>
#include <charconv>
#include <cstring>
#include <thread>

#include <netinet/in.h>
#include <poll.h>
#include <sys/socket.h>

#include "common/unique_fd.h"
#include "drivers/camera_process/camera_port.h"
#include "drivers/genicam/genicam_features.h"

namespace hord::drivers {
namespace {

// Bootstrap registers (GigE Vision).
constexpr std::uint32_t kChannelCount = 0x0900, kChannelPort = 0x0B00, kChannelAddress = 0x0B10,
                        kChannelTimeout = 0x0B14, kChannelRetries = 0x0B18;
constexpr std::uint32_t kAnswerWithinMs = 20, kRetries = 5;
constexpr int kLookMs = 50;   // how soon the thread sees that it is to end
constexpr int kMaxLinks = 8;  // from a feature to its port

// "Off" is none.
constexpr std::array kOn{"On", "GigEVisionEvent", "GenICamEvent"};

ArvGcPropertyNode* property_of(ArvGcNode* node, const char* name) {
    for (ArvDomNode* child = arv_dom_node_get_first_child(ARV_DOM_NODE(node)); child != nullptr;
         child = arv_dom_node_get_next_sibling(child)) {
        if (ARV_IS_GC_PROPERTY_NODE(child) && std::strcmp(arv_dom_node_get_node_name(child), name) == 0)
            return ARV_GC_PROPERTY_NODE(child);
    }
    return nullptr;
}

// The EventID (hexadecimal digits) of the port at which the event's data arrives. 0: none.
std::uint16_t id_of_port(ArvDevice* device, const std::string& feature) {
    ArvGcNode* node = arv_device_get_feature(device, feature.c_str());
    for (int k = 0; k < kMaxLinks && node != nullptr; ++k) {
        if (ARV_IS_GC_PORT(node)) {
            ArvGcPropertyNode* const event = property_of(node, "EventID");
            ArvFailure failed;
            const char* const text = event != nullptr ? arv_gc_property_node_get_string(event, failed.out()) : nullptr;
            std::uint16_t id = 0;
            if (text != nullptr) std::from_chars(text, text + std::strlen(text), id, 16);
            return id;
        }
        ArvGcPropertyNode* next = property_of(node, "pPort");
        if (next == nullptr) next = property_of(node, "pValue");
        node = next != nullptr ? arv_gc_property_node_get_linked_node(next) : nullptr;
    }
    return 0;
}

Result<std::uint16_t> set_event(ArvDevice* device, const std::string& name) {
    if (auto selected = set_feature(device, "EventSelector", name); !selected) return tl::unexpected(selected.error());
    guint count = 0;
    ArvFailure failed;
    const GlibOwned<const char*> entries(arv_device_dup_available_enumeration_feature_values_as_strings(
        device, "EventNotification", &count, failed.out()));
    const std::vector<std::string> there(entries.get(), entries.get() + (entries ? count : 0));
    const auto on =
        std::ranges::find_if(kOn, [&](const char* word) { return std::ranges::find(there, word) != there.end(); });
    if (auto set = set_feature(device, "EventNotification", on == kOn.end() ? "On" : *on); !set)
        return tl::unexpected(set.error());
    for (const char* const of : {"Timestamp", ""}) {
        if (const std::uint16_t id = id_of_port(device, "Event" + name + of)) return id;
    }
    const gint64 value = arv_device_get_integer_feature_value(device, ("Event" + name).c_str(), failed.out());
    if (!failed && value > 0 && value <= 0xFFFF) return static_cast<std::uint16_t>(value);
    return fail(ErrorCode::unsupported, "the camera's description does not number its event " + name,
                "wire the light barrier to a GPIO line (part_sensor.backend = \"gpio\")");
}

sockaddr_in ip_of(GSocketAddress* address) {
    sockaddr_in out{};
    ArvFailure failed;
    g_socket_address_to_native(address, &out, sizeof out, failed.out());
    return out;
}

class Channel final : public MessageChannel {
  public:
    Channel(common::UniqueFd socket, in_addr_t camera, Take take)
        : socket_(std::move(socket)), camera_(camera), take_(std::move(take)), thread_([this] { run(); }) {}
    ~Channel() override {
        ending_ = true;
        thread_.join();
    }

  private:
    void run() {
        while (!ending_) {
            pollfd ready{socket_.get(), POLLIN, 0};
            if (::poll(&ready, 1, kLookMs) != 1) continue;
            std::array<std::uint8_t, 1500> bytes{};
            sockaddr_in from{};
            socklen_t size = sizeof from;
            const ssize_t got = ::recvfrom(socket_.get(), bytes.data(), bytes.size(), MSG_DONTWAIT | MSG_TRUNC,
                                           reinterpret_cast<sockaddr*>(&from), &size);
            if (got <= 0 || got > static_cast<ssize_t>(bytes.size()) || from.sin_addr.s_addr != camera_) continue;
            const auto message = parse_gvcp_message(std::span(bytes).first(static_cast<std::size_t>(got)));
            if (!message) continue;
            if (message->wants_answer) {
                const auto answer = gvcp_answer(*message);
                (void)::sendto(socket_.get(), answer.data(), answer.size(), MSG_NOSIGNAL,
                               reinterpret_cast<const sockaddr*>(&from), size);
            }
            take_(*message);
        }
    }

    const common::UniqueFd socket_;
    const in_addr_t camera_;
    const Take take_;
    std::atomic<bool> ending_ = false;
    std::thread thread_;
};

}  // namespace

Result<InputEvents> set_input_events(ArvDevice* device, const std::string& line) {
    if (!has_feature(device, "EventSelector") || !has_feature(device, "EventNotification"))
        return fail(ErrorCode::unsupported, "the camera has no events (EventSelector, EventNotification)",
                    "wire the light barrier to a GPIO line (part_sensor.backend = \"gpio\")");
    const auto rising = set_event(device, line + "RisingEdge");
    if (!rising) return tl::unexpected(rising.error());
    const auto falling = set_event(device, line + "FallingEdge");
    if (!falling) return tl::unexpected(falling.error());
    return InputEvents{*rising, *falling};
}

Result<std::unique_ptr<MessageChannel>> MessageChannel::open(ArvDevice* device, Take take) {
    ArvFailure failed;
    guint32 count = 0;
    if (ARV_IS_GV_DEVICE(device)) arv_device_read_register(device, kChannelCount, &count, failed.out());
    if (failed || count == 0)
        return fail(ErrorCode::unsupported, "the camera sends no events: only GigE cameras with a message channel do",
                    "wire the light barrier to a GPIO line (part_sensor.backend = \"gpio\")");
    sockaddr_in own = ip_of(arv_gv_device_get_interface_address(ARV_GV_DEVICE(device)));
    const in_addr_t camera = ip_of(arv_gv_device_get_device_address(ARV_GV_DEVICE(device))).sin_addr.s_addr;
    own.sin_port = 0;
    common::UniqueFd socket(::socket(AF_INET, SOCK_DGRAM | SOCK_CLOEXEC, 0));
    socklen_t size = sizeof own;
    if (!socket || ::bind(socket.get(), reinterpret_cast<const sockaddr*>(&own), sizeof own) != 0 ||
        ::getsockname(socket.get(), reinterpret_cast<sockaddr*>(&own), &size) != 0)
        return fail(ErrorCode::io, std::string("no socket for the camera's events: ") + std::strerror(errno),
                    "look at the addresses of this machine's network interfaces");
    auto channel = std::make_unique<Channel>(std::move(socket), camera, std::move(take));
    for (const auto& [reg, value] : {std::pair(kChannelTimeout, kAnswerWithinMs),
                                     {kChannelRetries, kRetries},
                                     {kChannelAddress, ntohl(own.sin_addr.s_addr)},
                                     {kChannelPort, std::uint32_t{ntohs(own.sin_port)}}}) {
        arv_device_write_register(device, reg, value, failed.out());
        if (failed)
            return fail(ErrorCode::refused, "the camera refuses its message channel: " + failed.what(),
                        "switch it off and on");
    }
    return channel;
}

}  // namespace hord::drivers
