#include "drivers/camera_process/camera_wire.h"

#include <algorithm>
#include <array>
#include <cerrno>
#include <cstring>
#include <string_view>

#include <nlohmann/json.hpp>
#include <poll.h>
#include <sys/socket.h>
#include <unistd.h>

namespace hord::hal {

NLOHMANN_DEFINE_TYPE_NON_INTRUSIVE(ListedFormat, name, bits, width_px, height_px, sizes)
NLOHMANN_DEFINE_TYPE_NON_INTRUSIVE(ListedCamera, name, text, holder, formats, triggers, problem, cure)

}  // namespace hord::hal

namespace hord::drivers {

NLOHMANN_DEFINE_TYPE_NON_INTRUSIVE(GreyFormat, name, bits, layout)
NLOHMANN_DEFINE_TYPE_NON_INTRUSIVE(CameraFormat, width_px, height_px, grey, stride_bytes)
NLOHMANN_DEFINE_TYPE_NON_INTRUSIVE(CameraBuffer, offset, bytes)
NLOHMANN_DEFINE_TYPE_NON_INTRUSIVE(CameraAnswer, format, buffers, cameras)

namespace {

using Json = nlohmann::json;

constexpr std::array<std::string_view, 3> kCommandWords{"look", "start", "list"};  // as CameraCommand
constexpr std::size_t kBuffersMax = CameraSensor::kMaxBuffers, kTextMax = 60'000;

std::string text_of(const Json& json) { return json.dump(-1, ' ', false, Json::error_handler_t::replace); }

// The text may come from a device.
std::string line_of(std::string text) { return one_line(std::move(text)).substr(0, kTextMax / 8); }

hal::ListedCamera lines_of(hal::ListedCamera camera) {
    for (std::string* text : {&camera.name, &camera.text, &camera.holder, &camera.problem, &camera.cure})
        *text = line_of(std::move(*text));
    for (std::string& trigger : camera.triggers) trigger = line_of(std::move(trigger));
    for (hal::ListedFormat& format : camera.formats) format.name = line_of(std::move(format.name));
    return camera;
}

// An answer has whole numbers only. get() converts others, and of a large number the result is undefined.
Json parse_answer(std::string_view text) {
    return Json::parse(text, [](int, Json::parse_event_t, const Json& value) {
        if (value.is_number_float()) throw Json::type_error::create(302, "no whole number", &value);
        return true;
    });
}

std::optional<Result<CameraAnswer>> understand(std::string_view text, std::vector<int>& fds) {
    try {
        const Json json = parse_answer(text);
        if (const auto error = json.find("error"); error != json.end())
            return tl::unexpected(Error{error->at(0).get<ErrorCode>(), error->at(1), error->at(2)});
        auto answer = json.get<CameraAnswer>();
        if (answer.buffers.size() != fds.size()) return std::nullopt;
        for (std::size_t k = 0; k < fds.size(); ++k) answer.buffers[k].fd = fds[k];
        fds.clear();
        return answer;
    } catch (const Json::exception&) {
        return std::nullopt;
    }
}

}  // namespace

std::vector<std::string> camera_arguments(CameraCommand command, const std::string& request) {
    return {std::string(kCommandWords[static_cast<std::size_t>(command)]), request};
}

std::optional<CameraArguments> parse_camera_arguments(const std::vector<std::string>& arguments) {
    if (arguments.size() != 2) return std::nullopt;
    const auto word = std::ranges::find(kCommandWords, arguments[0]);
    if (word == kCommandWords.end()) return std::nullopt;
    return CameraArguments{static_cast<CameraCommand>(word - kCommandWords.begin()), arguments[1]};
}

bool send_answer(int socket, const Result<CameraAnswer>& answer) {
    Json json;
    std::vector<int> fds;
    if (answer) {
        CameraAnswer told = *answer;
        for (hal::ListedCamera& camera : told.cameras) camera = lines_of(std::move(camera));
        json = told;
        for (const CameraBuffer& buffer : answer->buffers) fds.push_back(buffer.fd);
    } else {
        json["error"] = {answer.error().code, line_of(answer.error().what), line_of(answer.error().cure)};
    }
    std::string text = text_of(json);
    if (text.size() > kTextMax || fds.size() > kBuffersMax) return false;
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
    std::array<char, kTextMax> text;  // only what is received is read
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
    if (count > 0 && (message.msg_flags & (MSG_TRUNC | MSG_CTRUNC)) == 0)
        answer = understand({text.data(), static_cast<std::size_t>(count)}, fds);
    for (const int fd : fds) ::close(fd);  // of a malformed answer
    return answer;
}

}  // namespace hord::drivers
