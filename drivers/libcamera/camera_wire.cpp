#include "drivers/libcamera/camera_wire.h"

#include <algorithm>
#include <array>
#include <cerrno>
#include <charconv>
#include <cstring>
#include <sstream>
#include <string_view>

#include <poll.h>
#include <sys/socket.h>
#include <unistd.h>

#include "drivers/libcamera/libcamera_options.h"

namespace hord::drivers {
namespace {

constexpr std::size_t kBuffersMax = CameraSensor::kMaxBuffers, kTextMax = 60'000;

template <class Number>
bool read_number(std::string_view text, Number& number) {
    const auto [end, error] = std::from_chars(text.data(), text.data() + text.size(), number);
    return error == std::errc() && end == text.data() + text.size();
}

// One line: the text may come from a device.
std::string line_of(std::string text) {
    std::ranges::replace(text, '\n', ' ');
    return text;
}

std::optional<Result<CameraAnswer>> understand(const std::string& text, std::vector<int>& fds) {
    std::istringstream in(text);
    std::string kind;
    std::getline(in, kind);
    if (kind == "error") {
        int code = 0;
        std::string number, what, cure;
        if (!std::getline(in, number) || !read_number(number, code) || !std::getline(in, what)) return std::nullopt;
        std::getline(in, cure);
        return tl::unexpected(Error{static_cast<ErrorCode>(code), what, cure});
    }
    if (kind != "ok") return std::nullopt;
    CameraAnswer answer;
    CameraFormat& format = answer.format;
    std::size_t buffers = 0;
    if (!(in >> format.width_px >> format.height_px >> format.stride_bytes >> format.grey.bits >> format.grey.packed >>
          format.grey.green >> buffers))
        return std::nullopt;
    if (buffers != fds.size()) return std::nullopt;
    for (const int fd : fds) {
        CameraBuffer buffer{fd};
        if (!(in >> buffer.offset >> buffer.bytes)) return std::nullopt;
        answer.buffers.push_back(buffer);
    }
    in >> format.grey.name;
    fds.clear();
    return answer;
}

}  // namespace

std::vector<std::string> camera_arguments(CameraCommand command, const LibcameraSensorOptions& r) {
    std::vector<std::string> out{command == CameraCommand::look ? "look" : "start", r.camera};
    for (const int number : {r.width_px, r.height_px, r.bits, r.buffers, r.green ? 1 : 0})
        out.push_back(std::to_string(number));
    for (const auto& [name, value] : r.controls) {
        out.push_back(name);
        out.push_back(std::to_string(value));
    }
    return out;
}

std::optional<CameraArguments> parse_camera_arguments(const std::vector<std::string>& arguments) {
    if (arguments.size() < 7 || arguments.size() % 2 == 0 || (arguments[0] != "look" && arguments[0] != "start"))
        return std::nullopt;
    CameraArguments order{arguments[0] == "look" ? CameraCommand::look : CameraCommand::start,
                          {.camera = arguments[1]}};
    LibcameraSensorOptions& r = order.request;
    int green = 0;
    if (!read_number(arguments[2], r.width_px) || !read_number(arguments[3], r.height_px) ||
        !read_number(arguments[4], r.bits) || !read_number(arguments[5], r.buffers) ||
        !read_number(arguments[6], green)) {
        return std::nullopt;
    }
    r.green = green != 0;
    for (std::size_t k = 7; k < arguments.size(); k += 2) {
        std::int64_t value = 0;
        if (!read_number(arguments[k + 1], value)) return std::nullopt;
        r.controls.emplace_back(arguments[k], value);
    }
    return order;
}

bool send_answer(int socket, const Result<CameraAnswer>& answer) {
    std::ostringstream out;
    std::vector<int> fds;
    if (answer) {
        const CameraFormat& f = answer->format;
        out << "ok\n"
            << f.width_px << ' ' << f.height_px << ' ' << f.stride_bytes << ' ' << f.grey.bits << ' ' << f.grey.packed
            << ' ' << f.grey.green << ' ' << answer->buffers.size();
        for (const CameraBuffer& buffer : answer->buffers) {
            out << ' ' << buffer.offset << ' ' << buffer.bytes;
            fds.push_back(buffer.fd);
        }
        out << ' ' << f.grey.name;
    } else {
        out << "error\n"
            << static_cast<int>(answer.error().code) << '\n'
            << line_of(answer.error().what) << '\n'
            << line_of(answer.error().cure);
    }
    std::string text = out.str();
    text.resize(std::min(text.size(), kTextMax));
    if (fds.size() > kBuffersMax) return false;
    iovec part{text.data(), text.size()};
    msghdr message{};
    message.msg_iov = &part;
    message.msg_iovlen = 1;
    alignas(cmsghdr) std::array<char, CMSG_SPACE(kBuffersMax * sizeof(int))> control{};
    if (!fds.empty()) {
        message.msg_control = control.data();
        message.msg_controllen = CMSG_SPACE(fds.size() * sizeof(int));
        cmsghdr* const head = CMSG_FIRSTHDR(&message);
        head->cmsg_level = SOL_SOCKET;
        head->cmsg_type = SCM_RIGHTS;
        head->cmsg_len = CMSG_LEN(fds.size() * sizeof(int));
        std::memcpy(CMSG_DATA(head), fds.data(), fds.size() * sizeof(int));
    }
    return ::sendmsg(socket, &message, MSG_NOSIGNAL) == static_cast<ssize_t>(text.size());
}

std::optional<Result<CameraAnswer>> receive_answer(int socket, hal::Duration patience) {
    pollfd ready{socket, POLLIN, 0};
    const auto wait_ms = std::chrono::duration_cast<std::chrono::milliseconds>(patience).count();
    int polled = 0;
    while ((polled = ::poll(&ready, 1, static_cast<int>(wait_ms))) < 0 && errno == EINTR) {
    }
    if (polled <= 0) return std::nullopt;
    std::string text(kTextMax, '\0');
    iovec part{text.data(), text.size()};
    alignas(cmsghdr) std::array<char, CMSG_SPACE(kBuffersMax * sizeof(int))> control{};
    msghdr message{};
    message.msg_iov = &part;
    message.msg_iovlen = 1;
    message.msg_control = control.data();
    message.msg_controllen = control.size();
    const ssize_t count = ::recvmsg(socket, &message, MSG_CMSG_CLOEXEC);
    std::vector<int> fds;
    for (cmsghdr* head = CMSG_FIRSTHDR(&message); count >= 0 && head != nullptr; head = CMSG_NXTHDR(&message, head)) {
        if (head->cmsg_level != SOL_SOCKET || head->cmsg_type != SCM_RIGHTS) continue;
        fds.resize((head->cmsg_len - CMSG_LEN(0)) / sizeof(int));
        std::memcpy(fds.data(), CMSG_DATA(head), fds.size() * sizeof(int));
    }
    std::optional<Result<CameraAnswer>> answer;
    if (count > 0 && (message.msg_flags & (MSG_TRUNC | MSG_CTRUNC)) == 0) {
        text.resize(static_cast<std::size_t>(count));
        answer = understand(text, fds);
    }
    for (const int fd : fds) ::close(fd);  // of a malformed answer
    return answer;
}

}  // namespace hord::drivers
