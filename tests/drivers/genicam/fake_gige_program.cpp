// A GigE Vision camera for tests: Aravis's fake camera, with the features that it lacks of a real one. kUsage has its
// options.
// ADDRESS is one of this machine's. Frames: the files, one after the other; without files, sample (x, y) of the n-th
// frame is (x + 3 y + n) of the format's bits; `still` draws one frame only, and counts in its first sample. `size`: of
// its sensor. `late`: it obeys every third trigger so much later. `asleep`: it says "ready" so long before it is
// there. `lines`: it has LineSelector, LineMode and
// LineSource. `test-packets`: it sends a packet of its packet size when it is told to, by which that is negotiated.
// `wire`: TriggerSource Line1, an input that SIGUSR1 activates and SIGUSR2 deactivates; software triggers then do
// nothing. `events`: it tells the edges of this input as events, which the description numbers by their ports or
// (`value`) by their features' values. A message is sent until it is answered; the N-th one is lost (`lose-event`), or
// each comes twice (`twice`). The network is network_between.h (`resend` is its lose_every). Prints "ready" and runs
// until it is killed.
#include <algorithm>
#include <array>
#include <atomic>
#include <csignal>
#include <cstdio>
#include <cstring>
#include <fstream>
#include <iterator>
#include <string>
#include <utility>
#include <vector>

#include <arv.h>
#include <fcntl.h>
#include <netinet/in.h>
#include <poll.h>
#include <sys/mman.h>
#include <sys/socket.h>
#include <unistd.h>

#include "drivers/files/frame_file.h"
#include "tests/drivers/genicam/network_between.h"

namespace {

constexpr const char* kUsage =
    "usage: hord_fake_gige ADDRESS SERIAL [OPTION ...] [FRAME.png ...]\n"
    "  of the camera:  name=USER_NAME lost=RATIO latch=no broken-xml formats=8 lines size=WIDTHxHEIGHT still wire\n"
    "                  events[=value] late=MS test-packets asleep=MS lose-answers=N\n"
    "  of the network: mtu=BYTES delay=MS reorder=N resend=N never=ID block-zero leader=AT:VALUE lose-event=N twice\n";

using hord::Frame;

constexpr std::uint32_t kLatchValue = 0x3008, kUserName = 0x00E8, kSensorHeight = 0x118, kSensorWidth = 0x11C;
constexpr std::uint32_t kSoftwareTrigger = 0x30C, kEventNotification = 0x3114;
constexpr std::uint32_t kCapability = 0x0934, kResendsPackets = 1U << 2U;
constexpr std::uint32_t kStreamPort = 0x0D00, kPacketSize = 0x0D04, kStreamAddress = 0x0D18,
                        kFireTestPacket = 1U << 31U;
constexpr std::uint32_t kChannelCount = 0x0900, kChannelPort = 0x0B00, kChannelAddress = 0x0B10;
constexpr unsigned kRising = 0x9011, kFalling = 0x9012;

struct Content {
    std::vector<Frame> files;
    std::uint64_t made = 0;
    bool still = false;
    unsigned late_ms = 0;
};

int bits_of(ArvPixelFormat format) {
    switch (format) {
        case 0x0110'0003:
        case 0x010C'0004:
        case 0x010A'0046: return 10;
        case 0x0110'0005:
        case 0x010C'0006:
        case 0x010C'0047: return 12;
        case ARV_PIXEL_FORMAT_MONO_16: return 16;
        default: return 8;
    }
}

// Written bit by bit from the formats' definitions, independently of the station's unpacking.
void put(std::uint8_t* data, ArvPixelFormat format, std::size_t k, unsigned value) {
    const int bits = bits_of(format);
    if (bits == 8) {
        data[k] = static_cast<std::uint8_t>(value);
    } else if (format == 0x010A'0046 || format == 0x010C'0047) {  // Mono10p, Mono12p
        for (std::size_t bit = 0; bit < static_cast<std::size_t>(bits); ++bit) {
            const std::size_t at = k * static_cast<std::size_t>(bits) + bit;
            data[at / 8] =
                static_cast<std::uint8_t>((data[at / 8] & ~(1U << (at % 8))) | ((value >> bit & 1U) << (at % 8)));
        }
    } else if (format == 0x010C'0004 || format == 0x010C'0006) {  // Mono10Packed, Mono12Packed
        const int low = bits - 8;
        std::uint8_t* const group = data + k / 2 * 3;
        group[k % 2 == 0 ? 0 : 2] = static_cast<std::uint8_t>(value >> low);
        const unsigned shift = k % 2 == 0 ? 0 : 4, mask = (1U << low) - 1U;
        group[1] = static_cast<std::uint8_t>((group[1] & ~(mask << shift)) | (value & mask) << shift);
    } else {
        data[2 * k] = static_cast<std::uint8_t>(value);
        data[2 * k + 1] = static_cast<std::uint8_t>(value >> 8U);
    }
}

void fill(ArvBuffer* buffer, void* user_data, guint32, guint32, ArvPixelFormat format) {
    auto& content = *static_cast<Content*>(user_data);
    std::size_t unused = 0;
    auto* const data = static_cast<std::uint8_t*>(const_cast<void*>(arv_buffer_get_data(buffer, &unused)));
    const int width = arv_buffer_get_image_width(buffer), height = arv_buffer_get_image_height(buffer);
    const std::uint64_t number = content.made++;
    if (content.late_ms > 0 && number % 3 == 2) {
        g_usleep(content.late_ms * 1000UL);
        arv_buffer_set_timestamp(buffer, static_cast<guint64>(g_get_real_time()) * 1000);
    }
    const Frame* const file = content.files.empty() ? nullptr : &content.files[number % content.files.size()];
    const unsigned mask = (1U << bits_of(format)) - 1U;
    // The camera keeps one buffer for all frames.
    if (content.still && number > 0) return put(data, format, 0, static_cast<unsigned>(number) & mask);
    for (int y = 0; y < height; ++y) {
        for (int x = 0; x < width; ++x) {
            const unsigned made = static_cast<unsigned>(x + 3 * y) + static_cast<unsigned>(number);
            put(data, format,
                static_cast<std::size_t>(y) * static_cast<std::size_t>(width) + static_cast<std::size_t>(x),
                (file == nullptr ? made : file->view().sample(x, y)) & mask);
        }
    }
}

std::string text_of(unsigned hexadecimal) {
    std::array<char, 16> text{};
    std::snprintf(text.data(), text.size(), "%x", hexadecimal);
    return text.data();
}

// A feature of an event: by its value, or at a port that is the event's.
std::string event(const std::string& name, unsigned id, bool by_value) {
    if (by_value)
        return "<Integer Name=\"" + name + "\" NameSpace=\"Standard\"><Value>" + std::to_string(id) +
            "</Value></Integer>";
    return "<Integer Name=\"" + name + "Timestamp\" NameSpace=\"Standard\"><pValue>" + name +
        "TimestampRegister</pValue></Integer><IntReg Name=\"" + name +
        "TimestampRegister\" NameSpace=\"Custom\"><Address>0x8</Address><Length>8</Length><AccessMode>RO</AccessMode>"
        "<pPort>" +
        name + "Port</pPort><Sign>Unsigned</Sign><Endianess>BigEndian</Endianess></IntReg><Port Name=\"" + name +
        "Port\" NameSpace=\"Custom\"><EventID>" + text_of(id) + "</EventID></Port>";
}

struct Has {
    bool latch = true, all_formats = true, lines = false, test_packets = false, wire = false, events = false,
         numbered_by_value = false;
};

std::string description(ArvFakeCamera* camera, const Has& has) {
    std::size_t size = 0;
    const char* const text = arv_fake_camera_get_genicam_xml(camera, &size);
    std::string xml(text, size);
    const auto insert_before = [&](const std::string& place, const std::string& what) {
        xml.insert(xml.find(place), what);
    };
    std::string formats;
    for (const auto& [name, value] : std::vector<std::pair<std::string, unsigned>>{{"Mono10", 0x0110'0003},
                                                                                   {"Mono10Packed", 0x010C'0004},
                                                                                   {"Mono10p", 0x010A'0046},
                                                                                   {"Mono12", 0x0110'0005},
                                                                                   {"Mono12Packed", 0x010C'0006},
                                                                                   {"Mono12p", 0x010C'0047}}) {
        formats += "<EnumEntry Name=\"" + name + "\" NameSpace=\"Standard\"><Value>" + std::to_string(value) +
            "</Value></EnumEntry>";
    }
    if (has.all_formats) insert_before("<pValue>PixelFormatRegister</pValue>", formats);
    const auto reg = [](const std::string& name, const char* address, const char* length) {
        return "<IntReg Name=\"" + name + "\" NameSpace=\"Custom\"><Address>" + address + "</Address><Length>" +
            length +
            "</Length><AccessMode>RW</AccessMode><pPort>Device</pPort><Cachable>NoCache</Cachable><Sign>Unsigned</Sign>"
            "<Endianess>BigEndian</Endianess></IntReg>";
    };
    const auto choice = [&](const std::string& name, const std::vector<std::string>& entries, const char* address) {
        std::string all = "<Enumeration Name=\"" + name + "\" NameSpace=\"Standard\">";
        for (std::size_t k = 0; k < entries.size(); ++k)
            all += "<EnumEntry Name=\"" + entries[k] + "\" NameSpace=\"Standard\"><Value>" + std::to_string(k) +
                "</Value></EnumEntry>";
        return all + "<pValue>" + name + "Register</pValue></Enumeration>" + reg(name + "Register", address, "4");
    };
    if (has.events) {
        insert_before("</RegisterDescription>",
                      choice("EventSelector", {"ExposureStart", "Line1RisingEdge", "Line1FallingEdge"}, "0x3110") +
                          choice("EventNotification", {"Off", "On"}, "0x3114"));
        for (const auto& [name, id] : {std::pair("EventLine1RisingEdge", kRising), {"EventLine1FallingEdge", kFalling}})
            insert_before("</RegisterDescription>", event(name, id, has.numbered_by_value));
    }
    if (has.wire) {
        // The fake camera exposes at software triggers alone: Line1 has their number, and the command does nothing.
        insert_before("<EnumEntry Name=\"Software\" NameSpace=\"Standard\">",
                      "<EnumEntry Name=\"Line1\" NameSpace=\"Standard\"><Value>1</Value></EnumEntry>");
        const std::size_t at = xml.find("0x30c");
        if (at != std::string::npos) xml.replace(at, 5, "0x3200");
    }
    if (has.lines) {
        insert_before("</RegisterDescription>",
                      choice("LineSelector", {"Line1", "Line2"}, "0x3100") +
                          choice("LineMode", {"Input", "Output"}, "0x3104") +
                          choice("LineSource", {"Off", "ExposureActive"}, "0x3108"));
    }
    if (has.test_packets) {
        insert_before(
            "</RegisterDescription>",
            "<Command Name=\"GevSCPSFireTestPacket\" NameSpace=\"Standard\"><pValue>TestPacketRegister</pValue>"
            "<CommandValue>1</CommandValue></Command>" +
                reg("TestPacketRegister", "0x3300", "4"));
    }
    if (has.latch) {
        insert_before("</RegisterDescription>",
                      "<Command Name=\"TimestampLatch\" NameSpace=\"Standard\"><pValue>LatchRegister</pValue>"
                      "<CommandValue>1</CommandValue></Command>" +
                          reg("LatchRegister", "0x3000", "4") +
                          "<Integer Name=\"TimestampLatchValue\" NameSpace=\"Standard\"><pValue>LatchValueRegister"
                          "</pValue></Integer>" +
                          reg("LatchValueRegister", "0x3008", "8"));
    }
    return xml;
}

// The input Line1 and its messages.
class Input {
  public:
    std::uint64_t lose = 0;  // the n-th message
    bool twice = false, triggers = false, tells = false;

    void change(ArvFakeCamera* camera, bool active) {
        if (active && triggers) arv_fake_camera_write_register(camera, kSoftwareTrigger, 1);
        guint32 on = 0, port = 0, address = 0;
        arv_fake_camera_read_register(camera, kEventNotification, &on);
        arv_fake_camera_read_register(camera, kChannelPort, &port);
        arv_fake_camera_read_register(camera, kChannelAddress, &address);
        if (!tells || on == 0 || port == 0) return;
        const std::uint64_t time = static_cast<std::uint64_t>(g_get_real_time()) * 1000;
        const unsigned id = active ? kRising : kFalling;
        request_ = request_ % 65535 + 1;
        if (++sent_ == lose) return;
        twice_now_ = twice;
        std::array<std::uint8_t, 24> message{0x42, 0x01, 0x00, 0xC0, 0, 16};
        message[6] = static_cast<std::uint8_t>(request_ >> 8U);
        message[7] = static_cast<std::uint8_t>(request_ & 0xFFU);
        message[10] = static_cast<std::uint8_t>(id >> 8U);
        message[11] = static_cast<std::uint8_t>(id & 0xFFU);
        for (unsigned k = 0; k < 8; ++k) message[16 + k] = static_cast<std::uint8_t>(time >> (56 - 8 * k));
        sockaddr_in to{};
        to.sin_family = AF_INET;
        to.sin_port = htons(static_cast<std::uint16_t>(port));
        to.sin_addr.s_addr = htonl(address);
        for (int tries = 0; tries < 6; ++tries) {
            ::sendto(socket_, message.data(), message.size(), 0, reinterpret_cast<const sockaddr*>(&to), sizeof to);
            if (answered(message[6], message[7]) && !std::exchange(twice_now_, false)) break;
        }
    }

  private:
    bool answered(std::uint8_t high, std::uint8_t low) const {
        pollfd ready{socket_, POLLIN, 0};
        std::array<std::uint8_t, 8> answer{};
        return ::poll(&ready, 1, 20) == 1 && ::recv(socket_, answer.data(), answer.size(), 0) == 8 &&
            answer == std::array<std::uint8_t, 8>{0, 0, 0, 0xC1, 0, 0, high, low};
    }

    const int socket_ = ::socket(AF_INET, SOCK_DGRAM, 0);
    std::uint64_t sent_ = 0;
    unsigned request_ = 65533;
    bool twice_now_ = false;
};

ArvFakeCamera* the_camera = nullptr;
std::size_t mtu_bytes = 0;  // of the network between; 0: any

// Sends a packet of the packet size, unfragmented, if the camera was told to.
void fire_test_packet() {
    guint32 size = 0, port = 0, to_address = 0;
    arv_fake_camera_read_register(the_camera, kPacketSize, &size);
    if ((size & kFireTestPacket) == 0) return;
    arv_fake_camera_write_register(the_camera, kPacketSize, size & ~kFireTestPacket);
    arv_fake_camera_read_register(the_camera, kStreamPort, &port);
    arv_fake_camera_read_register(the_camera, kStreamAddress, &to_address);
    constexpr std::size_t kHeaders = 20 + 8;  // IP and UDP
    const std::vector<char> bytes(std::max<std::size_t>(size & 0xFFFFU, kHeaders) - kHeaders);
    if (mtu_bytes > 0 && bytes.size() + kHeaders > mtu_bytes) return;
    static const int socket = ::socket(AF_INET, SOCK_DGRAM, 0);
    const int whole = IP_PMTUDISC_DO;
    ::setsockopt(socket, IPPROTO_IP, IP_MTU_DISCOVER, &whole, sizeof whole);
    sockaddr_in to{};
    to.sin_family = AF_INET;
    to.sin_port = htons(static_cast<std::uint16_t>(port & 0xFFFFU));
    to.sin_addr.s_addr = htonl(to_address);
    (void)::sendto(socket, bytes.data(), bytes.size(), 0, reinterpret_cast<const sockaddr*>(&to), sizeof to);
}

int edges[2];  // a pipe
void on_signal(int signal) {
    const char edge = signal == SIGUSR1 ? 1 : 0;
    (void)!::write(edges[1], &edge, 1);
}

}  // namespace

int main(int argc, char** argv) {
    if (argc < 3) {
        std::fputs(kUsage, stderr);
        return 2;
    }
    const std::string address = argv[1], serial = argv[2];
    std::string name;
    double lost = 0;
    bool broken = false;
    Has has;
    static Input input;
    unsigned width = 0, height = 0, asleep_ms = 0;
    hord::test::NetworkBetween network;
    static Content content;
    for (int k = 3; k < argc; ++k) {
        const std::string argument = argv[k];
        if (argument.starts_with("name=")) name = argument.substr(5);
        else if (argument.starts_with("lost=")) lost = std::stod(argument.substr(5));
        else if (argument == "latch=no") has.latch = false;
        else if (argument == "broken-xml") broken = true;
        else if (argument == "formats=8") has.all_formats = false;
        else if (argument == "lines") has.lines = true;
        else if (argument == "test-packets") has.test_packets = true;
        else if (argument == "wire") has.wire = input.triggers = true;
        else if (argument == "events") has.events = input.tells = true;
        else if (argument == "events=value") has.events = has.numbered_by_value = input.tells = true;
        else if (argument.starts_with("lose-answers="))
            hord::test::lose_answers(static_cast<unsigned>(std::stoul(argument.substr(13))));
        else if (argument == "twice") input.twice = true;
        else if (argument.starts_with("lose-event=")) input.lose = std::stoul(argument.substr(11));
        else if (argument == "still") content.still = true;
        else if (std::sscanf(argument.c_str(), "size=%ux%u", &width, &height) == 2) continue;
        else if (std::sscanf(argument.c_str(), "leader=%zu:%u", &network.leader_at, &network.leader_value) == 2)
            continue;
        else if (std::sscanf(argument.c_str(), "late=%u", &content.late_ms) == 1) continue;
        else if (std::sscanf(argument.c_str(), "asleep=%u", &asleep_ms) == 1) continue;
        else if (argument.starts_with("mtu=")) network.mtu_bytes = std::stoul(argument.substr(4));
        else if (argument == "block-zero") network.block_zero = true;
        else if (argument.starts_with("delay="))
            network.delay = std::chrono::milliseconds(std::stol(argument.substr(6)));
        else if (argument.starts_with("reorder=")) network.reorder_every = std::stoul(argument.substr(8));
        else if (std::sscanf(argument.c_str(), "resend=%u", &network.lose_every) == 1) continue;
        else if (std::sscanf(argument.c_str(), "never=%u", &network.never) == 1) continue;
        else if (auto frame = hord::drivers::read_frame(argument)) content.files.push_back(std::move(*frame));
        else return std::fprintf(stderr, "%s\n", frame.error().what.c_str()), 2;
    }
    if (asleep_ms > 0) {
        std::puts("ready");
        std::fflush(stdout);
        ::usleep(asleep_ms * 1000);
    }
    std::string xml;
    {
        ArvFakeCamera* const plain = arv_fake_camera_new(serial.c_str());
        xml = description(plain, has);
        g_object_unref(plain);
    }
    if (broken) xml.resize(xml.size() / 2);
    const int file = ::memfd_create("genicam.xml", 0);
    if (::write(file, xml.data(), xml.size()) != static_cast<ssize_t>(xml.size())) return 2;
    ArvGvFakeCamera* const camera =
        arv_gv_fake_camera_new_full(address.c_str(), serial.c_str(), ("/proc/self/fd/" + std::to_string(file)).c_str());
    if (camera == nullptr || !arv_gv_fake_camera_is_running(camera)) {
        std::fputs("the fake camera does not run\n", stderr);
        return 1;
    }
    g_object_set(camera, "gvsp-lost-ratio", lost, nullptr);
    ArvFakeCamera* const inner = arv_gv_fake_camera_get_fake_camera(camera);
    arv_fake_camera_set_fill_pattern(inner, fill, &content);
    arv_fake_camera_set_trigger_frequency(inner, 1000);  // how often it looks for a software trigger
    for (const auto& [at, pixels] : {std::pair(kSensorWidth, width), {kSensorHeight, height}}) {
        const guint32 value = GUINT32_TO_BE(pixels);
        if (pixels > 0) arv_fake_camera_write_memory(inner, at, sizeof value, &value);
    }
    if (network.lose_every > 0) arv_fake_camera_write_register(inner, kCapability, kResendsPackets);
    hord::test::put_between(network);
    the_camera = inner;
    mtu_bytes = network.mtu_bytes;
    if (has.test_packets) hord::test::before_each_answer(fire_test_packet);
    if (!name.empty())
        arv_fake_camera_write_memory(inner, kUserName, static_cast<guint32>(name.size() + 1), name.c_str());
    if (has.events) arv_fake_camera_write_register(inner, kChannelCount, 1);
    if (::pipe2(edges, O_NONBLOCK) != 0) return 2;
    for (const int signal : {SIGUSR1, SIGUSR2}) std::signal(signal, on_signal);
    std::puts("ready");
    std::fflush(stdout);
    // The camera's clock: the time of day, as its frames have it. A latch reads what was written last.
    for (;;) {
        const guint64 time = GUINT64_TO_BE(static_cast<guint64>(g_get_real_time()) * 1000);
        arv_fake_camera_write_memory(inner, kLatchValue, sizeof time, &time);
        char edge = 0;
        if (::read(edges[0], &edge, 1) == 1) input.change(inner, edge != 0);
        ::usleep(200);
    }
}
