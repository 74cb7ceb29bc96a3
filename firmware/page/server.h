// The page's door: HTTP over sockets (cpp-httplib), with bounds of its own on what a connection may cost.
//
// A head must arrive within 5 s and have at most 8 KiB, a body at most 4 KiB, each line of a reply be taken within 5 s
// and a whole reply within 30 s. So many connections as threads, some more wait (who is silent meanwhile is sent away
// after 0.4 s), further ones are answered 503 at once. A slow, broken or hostile client costs its own connection and
// nothing else.
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
    // Listens; nothing is answered before run(). Fails with busy (the port is taken), invalid_argument (no such
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

// What one connection on which these bytes arrive is answered: the same parsing, without a socket. For tests.
std::string answer_bytes(Pages& pages, Viewers& viewers, std::string_view bytes);

}  // namespace hord::firmware::page
