// The page's HTTP server (cpp-httplib), with limits on the cost of a connection.
//
// Limits: a head of 8 KiB within 5 s, a body of 4 KiB, 5 s for each write, 30 s for a whole reply. Each connection has
// a thread; 32 more wait (a silent client is closed after 0.4 s while others wait), further ones are answered 503 at
// once. A slow, broken or hostile client affects its own connection only.
#pragma once

#include <cstdint>
#include <memory>
#include <string>
#include <string_view>

#include "common/result.h"
#include "firmware/page/pages.h"

namespace hord::firmware::page {

class PageServer {
  public:
    // Listens; requests are answered from run() on. Fails with busy (the port is taken), invalid_argument (no such
    // address).
    static Result<std::unique_ptr<PageServer>> open(const PageConfig& config, Pages& pages, Viewers& viewers);
    ~PageServer();

    [[nodiscard]] std::uint16_t port() const;
    void run();   // until stop()
    void stop();  // any thread, also before run(); not a signal handler

  private:
    struct Parts;
    explicit PageServer(std::unique_ptr<Parts> parts);
    std::unique_ptr<Parts> parts_;
};

// The reply to the bytes of one connection, by the same parser, without a socket. For tests.
std::string answer_bytes(Pages& pages, Viewers& viewers, std::string_view bytes);

}  // namespace hord::firmware::page
