#include "drivers/genicam/genicam_discovery.h"

#include <algorithm>
#include <array>
#include <cerrno>
#include <cstring>
#include <optional>
#include <vector>

#include <arpa/inet.h>
#include <ifaddrs.h>
#include <poll.h>
#include <sys/socket.h>

#include "common/unique_fd.h"
#include "drivers/camera_process/camera_port.h"

namespace hord::drivers {
namespace {

constexpr int kAnswerWithinMs = 200, kTries = 3;
constexpr const char* kOther = "another program";

// The data of a GigE camera's answer to a command (GigE Vision) that needs no control. None: no answer came.
std::optional<std::string> ask(const std::string& camera, std::uint8_t command, const std::string& data = {}) {
    constexpr std::size_t kHeader = 8;
    const std::string id = "HO";
    const std::string wanted = {0, 0, 0, static_cast<char>(command + 1)};  // status 0, the command's acknowledgement
    const std::string request =
        std::string({0x42, 0x01, 0, static_cast<char>(command), 0, static_cast<char>(data.size())}) + id + data;
    const common::UniqueFd socket(::socket(AF_INET, SOCK_DGRAM | SOCK_CLOEXEC, 0));
    sockaddr_in to{};
    to.sin_family = AF_INET;
    to.sin_port = htons(3956);
    if (!socket || ::inet_pton(AF_INET, camera.c_str(), &to.sin_addr) != 1 ||
        ::connect(socket.get(), reinterpret_cast<const sockaddr*>(&to), sizeof to) != 0)
        return std::nullopt;
    for (int k = 0; k < kTries; ++k) {
        pollfd ready{socket.get(), POLLIN, 0};
        std::array<char, 576> answer{};
        if (::send(socket.get(), request.data(), request.size(), MSG_NOSIGNAL) < 0) return std::nullopt;
        if (::poll(&ready, 1, kAnswerWithinMs) != 1) continue;
        const ssize_t got = ::recv(socket.get(), answer.data(), answer.size(), 0);
        if (got < static_cast<ssize_t>(kHeader)) continue;
        const std::string text(answer.data(), static_cast<std::size_t>(got));
        if (text.starts_with(wanted) && text.compare(6, 2, id) == 0) return text.substr(kHeader);
    }
    return std::nullopt;
}

// Aravis opens cameras by this name but does not list it. From the answer that Aravis has it from, to DISCOVERY_CMD.
// None: no answer.
std::optional<std::string> user_defined_name(const std::string& address) {
    constexpr std::size_t kAt = 0xE8, kBytes = 16;
    const auto answer = ask(address, 0x02);
    if (!answer || answer->size() < kAt + kBytes) return std::nullopt;
    const std::string name = answer->substr(kAt, kBytes);
    return name.substr(0, name.find('\0'));
}

// The control channel privilege register: a program controls the camera.
bool is_controlled(const std::string& address) {
    const auto answer = ask(address, 0x84, {0, 0, 0x0A, 0, 0, 0, 0, 4});  // READMEM_CMD: 4 bytes of 0x0A00
    return answer && answer->size() >= 8 && ((*answer)[7] & 0x03) != 0;
}

struct Listed {
    std::string id;                  // Aravis's, unique
    std::vector<std::string> names;  // all that it answers to
    std::string text;                // for people
    std::string serial, address;
    bool gige = false;
    bool name_known = true;
};

std::vector<Listed> list_cameras() {
    arv_update_device_list();
    std::vector<Listed> all;
    for (unsigned k = 0; k < arv_get_n_devices(); ++k) {
        const auto text = [](const char* value) { return std::string(value != nullptr ? value : ""); };
        Listed one;
        one.id = text(arv_get_device_id(k));
        one.serial = text(arv_get_device_serial_nbr(k));
        one.address = text(arv_get_device_address(k));
        one.gige = text(arv_get_device_protocol(k)) == "GigEVision";
        const auto told = one.gige ? user_defined_name(one.address) : std::string();
        one.name_known = told.has_value();
        const std::string name = told.value_or("");
        one.names = {one.id, one.serial, name, one.address, text(arv_get_device_physical_id(k))};
        one.text = one.id + " (serial " + one.serial + (name.empty() ? "" : ", name \"" + name + "\"") +
            (one.address.empty() ? "" : ", at " + one.address) + ")";
        all.push_back(std::move(one));
    }
    return all;
}

std::string texts_of(const std::vector<Listed>& cameras) {
    std::vector<std::string> texts;
    for (const Listed& camera : cameras) texts.push_back(camera.text);
    return list_of(texts);
}

// Aravis finds no network interface without this call, and says nothing.
Result<void> may_list_interfaces() {
    ifaddrs* all = nullptr;
    if (::getifaddrs(&all) == 0) {
        ::freeifaddrs(all);
        return {};
    }
    return fail(ErrorCode::io, std::string("the network interfaces cannot be listed: ") + std::strerror(errno),
                "let the service use AF_NETLINK: install /usr/share/doc/hord-station/genicam.conf as "
                "/etc/systemd/system/hordd.service.d/genicam.conf");
}

// The id to open, or what Aravis may know the camera by.
Result<std::string> choose(const std::vector<Listed>& there, const std::string& wanted) {
    std::vector<Listed> matching;
    for (const Listed& camera : there) {
        if (wanted.empty() || std::ranges::find(camera.names, wanted) != camera.names.end()) matching.push_back(camera);
    }
    // Of several that have a name Aravis opens any.
    const bool by_name = !wanted.empty() && std::ranges::all_of(matching, [&](const Listed& camera) {
        return wanted != camera.id && wanted != camera.serial && wanted != camera.address;
    });
    const auto unknown = std::ranges::find(there, false, &Listed::name_known);
    if (by_name && matching.size() < 2 && unknown != there.end()) {
        return fail(ErrorCode::io, unknown->text + " does not say whether its name is \"" + wanted + "\", too",
                    "name the camera in sensor.camera by its serial number or address; check the network's errors "
                    "(ip -s link)");
    }
    if (matching.size() == 1) return matching.front().id;
    if (matching.size() > 1) {
        return fail(
            ErrorCode::invalid_argument,
            (wanted.empty() ? "several cameras are there: " : "several cameras are called \"" + wanted + "\": ") +
                texts_of(matching),
            "name one in sensor.camera, by its serial number or address");
    }
    if (wanted.empty()) {
        return fail(ErrorCode::not_found, "no GenICam camera is there",
                    "check its cable and power; a GigE camera must have an address of this machine's network");
    }
    return wanted;
}

using Entries = GlibOwned<const char*>;

std::vector<std::string> texts_of(const Entries& entries, guint count) {
    return {entries.get(), entries.get() + (entries ? count : 0)};
}

// Opens the camera, which takes its control while this runs.
void read_formats(const std::string& id, hal::ListedCamera& listed) {
    ArvFailure failed;
    const ArvOwned<ArvDevice> device(arv_open_device(id.c_str(), failed.out()));
    if (ARV_IS_GV_DEVICE(device.get()) && arv_gv_device_is_controller(ARV_GV_DEVICE(device.get())) == FALSE) {
        listed.holder = kOther;
        return;
    }
    const ArvOwned<ArvCamera> camera(device ? arv_camera_new_with_device(device.get(), failed.out()) : nullptr);
    if (!camera) {
        listed.problem = "cannot be opened: " + failed.what();
        listed.cure =
            "close the program that uses it; check that its address fits this machine's network, and for USB "
            "the rights of its device file";
        return;
    }
    int width = 0, height = 0;
    arv_camera_get_sensor_size(camera.get(), &width, &height, failed.out());
    guint count = 0;
    const Entries formats(arv_camera_dup_available_pixel_formats_as_strings(camera.get(), &count, failed.out()));
    for (const std::string& name : texts_of(formats, count)) {
        hal::ListedFormat& format = listed.formats.emplace_back();
        format.name = name;
        format.bits = genicam_bits(name);
        format.width_px = width;
        format.height_px = height;
        if (width > 0) format.sizes = {"up to " + std::to_string(width) + "x" + std::to_string(height)};
    }
    guint sources_count = 0;
    const Entries sources(arv_camera_dup_available_trigger_sources(camera.get(), &sources_count, failed.out()));
    listed.triggers = texts_of(sources, sources_count);
    if (!listed.formats.empty()) return;
    listed.problem = "does not say its formats: " + failed.what();
    listed.cure = "update the camera's firmware";
}

}  // namespace

int genicam_bits(const std::string& format) {
    const auto known = std::ranges::find(genicam_formats(), format, &GreyFormat::name);
    return known == genicam_formats().end() ? 0 : known->bits;
}

const std::vector<GreyFormat>& genicam_formats() {
    static const std::vector<GreyFormat> formats{{"Mono8", 8},
                                                 {"Mono10", 10},
                                                 {"Mono10p", 10, SampleLayout::pfnc},
                                                 {"Mono10Packed", 10, SampleLayout::gige},
                                                 {"Mono12", 12},
                                                 {"Mono12p", 12, SampleLayout::pfnc},
                                                 {"Mono12Packed", 12, SampleLayout::gige},
                                                 {"Mono16", 16}};
    return formats;
}

Result<std::vector<hal::ListedCamera>> list_genicam_cameras() {
    if (auto may = may_list_interfaces(); !may) return tl::unexpected(may.error());
    std::vector<hal::ListedCamera> cameras;
    for (const Listed& one : list_cameras()) {
        hal::ListedCamera& listed = cameras.emplace_back();
        listed.name = one.serial.empty() ? one.id : one.serial;
        listed.text = one.text;
        if (one.gige && is_controlled(one.address)) {
            listed.holder = kOther;
        } else {
            read_formats(one.id, listed);
        }
    }
    return cameras;
}

Result<TakenCamera> take_genicam_camera(const std::string& wanted) {
    if (auto may = may_list_interfaces(); !may) return tl::unexpected(may.error());
    auto there = list_cameras();
    // Discovery is one packet and its answer, and either may be lost.
    if (there.empty()) there = list_cameras();
    const auto id = choose(there, wanted);
    if (!id) return tl::unexpected(id.error());
    ArvFailure failed;
    const ArvOwned<ArvDevice> device(arv_open_device(id->c_str(), failed.out()));
    std::string name = one_line(wanted.empty() ? *id : wanted);
    constexpr const char* kBusyCure =
        "close the program that uses it; a program that crashed keeps it for its heartbeat time, some 3 s";
    if (!device && failed.is(ARV_DEVICE_ERROR_NOT_FOUND)) {
        return fail(ErrorCode::not_found, "camera \"" + name + "\" is not there; cameras: " + texts_of(there),
                    "check its cable and power, and sensor.camera: a serial number, user-defined name or address");
    }
    // libxml2 reads a damaged description as far as it goes. Every whole one has the port of the registers.
    if (device ? !ARV_IS_GC_PORT(arv_device_get_feature(device.get(), "Device"))
               : failed.is(ARV_DEVICE_ERROR_GENICAM_NOT_FOUND)) {
        return fail(
            ErrorCode::unsupported,
            name + ": its description (GenICam XML) " + (device ? "is incomplete" : "cannot be read: " + failed.what()),
            "update the camera's firmware");
    }
    if (!device &&
        (failed.is(ARV_DEVICE_ERROR_NOT_CONTROLLER) || failed.is(ARV_DEVICE_ERROR_PROTOCOL_ERROR_ACCESS_DENIED)))
        return fail(ErrorCode::busy, name + " is controlled by another program", kBusyCure);
    if (!device) {
        return fail(ErrorCode::io, name + " cannot be opened: " + failed.what(),
                    "switch it off and on; check its cable and that its address fits this machine's network");
    }
    if (ARV_IS_GV_DEVICE(device.get()) && arv_gv_device_is_controller(ARV_GV_DEVICE(device.get())) == FALSE)
        return fail(ErrorCode::busy, name + " is controlled by another program", kBusyCure);
    ArvOwned<ArvCamera> camera(arv_camera_new_with_device(device.get(), failed.out()));
    if (!camera) return fail(ErrorCode::io, name + " cannot be used: " + failed.what(), "switch it off and on");
    return TakenCamera{std::move(camera), std::move(name)};
}

}  // namespace hord::drivers
