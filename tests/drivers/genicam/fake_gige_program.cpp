// A GigE Vision camera for tests: Aravis's fake camera, with the features that it lacks of a real one.
//     hord_fake_gige ADDRESS SERIAL [name=USER_NAME] [lost=RATIO] [latch=no] [broken-xml] [formats=8] [lines]
//                    [size=WIDTHxHEIGHT] [still] [FRAME.png ...]
//                    and of the network: [mtu=BYTES] [delay=MS] [reorder=N]
// ADDRESS is one of this machine's. Frames: the files, one after the other; without files, sample (x, y) of the n-th
// frame is (x + 3 y + n) of the format's bits; `still` draws one frame only, and counts in its first sample. `size`: of
// its sensor. `lines`: it has LineSelector, LineMode and LineSource. The network is network_between.h. Prints "ready"
// and runs until it is killed.
#include <atomic>
#include <cstdio>
#include <cstring>
#include <fstream>
#include <iterator>
#include <string>
#include <vector>

#include <arv.h>
#include <sys/mman.h>
#include <unistd.h>

#include "drivers/files/frame_file.h"
#include "tests/drivers/genicam/network_between.h"

namespace {

using hord::Frame;

constexpr std::uint32_t kLatchValue = 0x3008, kUserName = 0x00E8, kSensorHeight = 0x118, kSensorWidth = 0x11C;

struct Content {
    std::vector<Frame> files;
    std::uint64_t made = 0;
    bool still = false;
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

std::string description(ArvFakeCamera* camera, bool latch, bool all_formats, bool lines) {
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
    if (all_formats) insert_before("<pValue>PixelFormatRegister</pValue>", formats);
    const auto reg = [](const std::string& name, const char* address, const char* length) {
        return "<IntReg Name=\"" + name + "\" NameSpace=\"Custom\"><Address>" + address + "</Address><Length>" +
            length +
            "</Length><AccessMode>RW</AccessMode><pPort>Device</pPort><Cachable>NoCache</Cachable><Sign>Unsigned</Sign>"
            "<Endianess>BigEndian</Endianess></IntReg>";
    };
    if (lines) {
        const auto choice = [&](const std::string& name, const std::vector<std::string>& entries, const char* address) {
            std::string all = "<Enumeration Name=\"" + name + "\" NameSpace=\"Standard\">";
            for (std::size_t k = 0; k < entries.size(); ++k)
                all += "<EnumEntry Name=\"" + entries[k] + "\" NameSpace=\"Standard\"><Value>" + std::to_string(k) +
                    "</Value></EnumEntry>";
            return all + "<pValue>" + name + "Register</pValue></Enumeration>" + reg(name + "Register", address, "4");
        };
        insert_before("</RegisterDescription>",
                      choice("LineSelector", {"Line1", "Line2"}, "0x3100") +
                          choice("LineMode", {"Input", "Output"}, "0x3104") +
                          choice("LineSource", {"Off", "ExposureActive"}, "0x3108"));
    }
    if (latch) {
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

}  // namespace

int main(int argc, char** argv) {
    if (argc < 3) return 2;
    const std::string address = argv[1], serial = argv[2];
    std::string name;
    double lost = 0;
    bool latch = true, broken = false, all_formats = true, lines = false;
    unsigned width = 0, height = 0;
    hord::test::NetworkBetween network;
    static Content content;
    for (int k = 3; k < argc; ++k) {
        const std::string argument = argv[k];
        if (argument.starts_with("name=")) name = argument.substr(5);
        else if (argument.starts_with("lost=")) lost = std::stod(argument.substr(5));
        else if (argument == "latch=no") latch = false;
        else if (argument == "broken-xml") broken = true;
        else if (argument == "formats=8") all_formats = false;
        else if (argument == "lines") lines = true;
        else if (argument == "still") content.still = true;
        else if (std::sscanf(argument.c_str(), "size=%ux%u", &width, &height) == 2) continue;
        else if (argument.starts_with("mtu=")) network.mtu_bytes = std::stoul(argument.substr(4));
        else if (argument.starts_with("delay="))
            network.delay = std::chrono::milliseconds(std::stol(argument.substr(6)));
        else if (argument.starts_with("reorder=")) network.reorder_every = std::stoul(argument.substr(8));
        else if (auto frame = hord::drivers::read_frame(argument)) content.files.push_back(std::move(*frame));
        else return std::fprintf(stderr, "%s\n", frame.error().what.c_str()), 2;
    }
    std::string xml;
    {
        ArvFakeCamera* const plain = arv_fake_camera_new(serial.c_str());
        xml = description(plain, latch, all_formats, lines);
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
    hord::test::put_between(network);
    if (!name.empty())
        arv_fake_camera_write_memory(inner, kUserName, static_cast<guint32>(name.size() + 1), name.c_str());
    std::puts("ready");
    std::fflush(stdout);
    // The camera's clock: the time of day, as its frames have it. A latch reads what was written last.
    for (;;) {
        const guint64 time = GUINT64_TO_BE(static_cast<guint64>(g_get_real_time()) * 1000);
        arv_fake_camera_write_memory(inner, kLatchValue, sizeof time, &time);
        ::usleep(200);
    }
}
