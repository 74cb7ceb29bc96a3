// The page's HTTP server (cpp-httplib), with limits on the cost of a connection.
//
// Limits: a head of 8 KiB within 5 s, a body of 4 KiB, 5 s for each write, 30 s for a whole reply. Each connection has
// a thread; 32 more wait (a silent client is closed after 0.4 s while others wait), further ones are answered 503 at
// once. A slow, broken or hostile client affects its own connection only.
#pragma once

#include <cstdint>
#include <memory>

#include "common/result.h"
#include "firmware/page/pages.h"
#include "firmware/page/viewers.h"

namespace hord::firmware::page {

class ByteStream;

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

// Serves one connection, without a server's socket and threads.
void serve_connection(Pages& pages, Viewers& viewers, ByteStream& stream);

}  // namespace hord::firmware::page
