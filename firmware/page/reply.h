// A request and its reply, without a socket.
#pragma once

#include <cstddef>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include "common/result.h"
#include "common/unique_fd.h"
#include "firmware/page/results.h"

namespace hord::firmware::page {

struct Request {
    std::string method, path;  // decoded
    Fields query;              // decoded
    std::string body;
    std::string host, origin, fetch_site, authorization, content_type;
    std::string peer;  // address, for the log
};

struct Reply {
    int status = 200;
    std::string type = "application/json";
    std::string body = {};
    struct File {  // sent after the body; read while it is sent
        common::UniqueFd fd = {};
        std::size_t size = 0;
    } file = {};
    std::string tail = {};                                          // sent after the file
    std::vector<std::pair<std::string, std::string>> headers = {};  // beside those of every reply
    bool events = false;                                            // Viewers sends the rest; body is the beginning
};

// JSON of what is wrong and how it is cured. The status of an Error: 404 not_found, 400 invalid_argument, 503 busy,
// timeout and disconnected, 500 the others.
Reply refusal(int status, std::string_view what, std::string_view cure);
Reply refusal(const Error& error);

}  // namespace hord::firmware::page
