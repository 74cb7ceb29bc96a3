// The page's HTTP server (libmicrohttpd), with limits on the cost of a client.
//
// One thread serves all connections and answers what is in memory. Four more answer what reads the store or a frame, or
// commands; 64 requests may wait for them. docs/page.md lists the limits. A slow, broken or hostile client costs its
// own connection, and other clients of its address at most.
#pragma once

#include <functional>
#include <memory>
#include <string>

#include "common/result.h"
#include "firmware/page/pages.h"
#include "firmware/page/viewers.h"

namespace hord::firmware::page {

class PageServer {
  public:
    // Listens and answers until it is destroyed. `pages` and `viewers` outlive it. Fails as common::listen_on(), and
    // with io.
    static Result<std::unique_ptr<PageServer>> open(const PageConfig& config, Pages& pages, Viewers& viewers);
    // Ends `viewers`, too. Waits for the requests that are being answered.
    ~PageServer();

    [[nodiscard]] std::string address() const;  // that it listens at: "127.0.0.1:8070"

  private:
    struct Impl;
    explicit PageServer(std::unique_ptr<Impl> impl);
    std::unique_ptr<Impl> impl_;
    friend void serve_connection(Pages& pages, Viewers& viewers, int fd, const std::function<bool()>& turn);
};

// Serves one connected socket in the calling thread until the client or turn() ends it. turn() is called after each
// step of the server; false: the connection is closed. Takes ownership of `fd`.
void serve_connection(Pages& pages, Viewers& viewers, int fd, const std::function<bool()>& turn);

}  // namespace hord::firmware::page
