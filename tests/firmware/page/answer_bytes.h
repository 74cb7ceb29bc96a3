// The page's reply to the bytes of one connection, through the same parser as from a network.
#pragma once

#include <array>
#include <string>
#include <string_view>

#include <sys/socket.h>

#include "common/unique_fd.h"
#include "firmware/page/server.h"

namespace hord::firmware::page::test {

// A client that sends all, closes its side and reads until the end; a viewer of events leaves after the first one.
inline std::string answer_bytes(Pages& pages, Viewers& viewers, std::string_view bytes) {
    std::array<int, 2> ends{};
    if (::socketpair(AF_UNIX, SOCK_STREAM | SOCK_CLOEXEC | SOCK_NONBLOCK, 0, ends.data()) != 0) return "no socket";
    const common::UniqueFd client(ends[0]);
    std::string answer;
    const auto turn = [&] {
        if (!bytes.empty()) {
            const ssize_t sent = ::send(client.get(), bytes.data(), bytes.size(), MSG_NOSIGNAL);
            if (sent > 0) bytes.remove_prefix(static_cast<std::size_t>(sent));
        }
        if (bytes.empty()) ::shutdown(client.get(), SHUT_WR);
        std::array<char, 65536> into{};
        for (ssize_t got = 0; (got = ::recv(client.get(), into.data(), into.size(), 0)) > 0;)
            answer.append(into.data(), static_cast<std::size_t>(got));
        return answer.find("event: page") == std::string::npos;
    };
    turn();
    serve_connection(pages, viewers, ends[1], turn);
    turn();
    return answer;
}

}  // namespace hord::firmware::page::test
