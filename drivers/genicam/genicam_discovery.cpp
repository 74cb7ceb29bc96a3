#include "drivers/genicam/genicam_discovery.h"

#include <algorithm>
#include <array>
#include <cerrno>
#include <cstring>
#include <vector>

#include <arpa/inet.h>
#include <ifaddrs.h>
#include <poll.h>
#include <sys/socket.h>

#include "common/unique_fd.h"
#include "drivers/camera_process/camera_port.h"

namespace hord::drivers {
namespace {

constexpr int kAnswerWithinMs = 200;

// The user-defined name in a GigE camera's bootstrap registers (GigE Vision: 16 bytes at 0x00E8), by one READMEM_CMD
// that needs no control. Aravis opens cameras by this name but does not list it. Empty: none, or no answer.
std::string user_defined_name(const std::string& address) {
    constexpr std::size_t kHeader = 12;
    constexpr std::array<std::uint8_t, 16> kAsk{0x42, 0x01, 0x00, 0x84, 0, 8, 0x48, 0x4F,
                                                0,    0,    0x00, 0xE8, 0, 0, 0,    16};
    const common::UniqueFd socket(::socket(AF_INET, SOCK_DGRAM | SOCK_CLOEXEC, 0));
    sockaddr_in to{};
    to.sin_family = AF_INET;
    to.sin_port = htons(3956);
    if (!socket || ::inet_pton(AF_INET, address.c_str(), &to.sin_addr) != 1 ||
        ::connect(socket.get(), reinterpret_cast<const sockaddr*>(&to), sizeof to) != 0 ||
        ::send(socket.get(), kAsk.data(), kAsk.size(), MSG_NOSIGNAL) < 0)
        return {};
    pollfd ready{socket.get(), POLLIN, 0};
    std::array<char, 64> answer{};
    if (::poll(&ready, 1, kAnswerWithinMs) != 1) return {};
    const ssize_t count = ::recv(socket.get(), answer.data(), answer.size() - 1, 0);
    // Status 0, READMEM_ACK, and the id of the request.
    if (count < static_cast<ssize_t>(kHeader + 16) || std::memcmp(answer.data(), "\0\0\0\x85", 4) != 0 ||
        std::memcmp(answer.data() + 6, kAsk.data() + 6, 2) != 0)
        return {};
    return std::string(answer.data() + kHeader, ::strnlen(answer.data() + kHeader, 16));
}

struct Listed {
    std::string id;                  // Aravis's, unique
    std::vector<std::string> names;  // all that it answers to
    std::string text;                // for people
};

std::vector<Listed> list_cameras() {
    arv_update_device_list();
    std::vector<Listed> all;
    for (unsigned k = 0; k < arv_get_n_devices(); ++k) {
        const auto text = [](const char* value) { return std::string(value != nullptr ? value : ""); };
        Listed one;
        one.id = text(arv_get_device_id(k));
        const std::string serial = text(arv_get_device_serial_nbr(k)), address = text(arv_get_device_address(k));
        const std::string name =
            text(arv_get_device_protocol(k)) == "GigEVision" ? user_defined_name(address) : std::string();
        one.names = {one.id, serial, name, address, text(arv_get_device_physical_id(k))};
        one.text = one.id + " (serial " + serial + (name.empty() ? "" : ", name \"" + name + "\"") +
            (address.empty() ? "" : ", at " + address) + ")";
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

}  // namespace

Result<TakenCamera> take_genicam_camera(const std::string& wanted) {
    if (auto may = may_list_interfaces(); !may) return tl::unexpected(may.error());
    const auto there = list_cameras();
    const auto id = choose(there, wanted);
    if (!id) return tl::unexpected(id.error());
    ArvFailure failed;
    const ArvOwned<ArvDevice> device(arv_open_device(id->c_str(), failed.out()));
    std::string name = wanted.empty() ? *id : wanted;
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
