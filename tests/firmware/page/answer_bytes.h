// The page's reply to the bytes of one connection: the same parser, without a socket.
#pragma once

#include <string>
#include <string_view>
#include <utility>

#include "firmware/page/http_connection.h"
#include "firmware/page/server.h"

namespace hord::firmware::page::test {

class MemoryStream final : public ByteStream {
  public:
    explicit MemoryStream(std::string_view bytes) : bytes_(bytes) {}
    ssize_t receive(char* into, std::size_t size, Clock::time_point) override {
        const std::size_t count = bytes_.copy(into, size);
        bytes_.remove_prefix(count);
        return static_cast<ssize_t>(count);
    }
    ssize_t send(const char* bytes, std::size_t size, Clock::time_point) override {
        answer.append(bytes, size);
        return static_cast<ssize_t>(size);
    }
    // A viewer of events leaves after the first one.
    bool alive() override { return answer.find("event: page") == std::string::npos; }
    std::pair<std::string, int> peer() const override { return {"memory", 0}; }
    socket_t socket() const override { return -1; }
    std::string answer;

  private:
    std::string_view bytes_;
};

inline std::string answer_bytes(Pages& pages, Viewers& viewers, std::string_view bytes) {
    MemoryStream stream(bytes);
    serve_connection(pages, viewers, stream);
    return std::move(stream.answer);
}

}  // namespace hord::firmware::page::test
