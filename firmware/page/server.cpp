#include "firmware/page/server.h"

#include <algorithm>
#include <atomic>
#include <cerrno>
#include <chrono>
#include <condition_variable>
#include <cstring>
#include <deque>
#include <functional>
#include <thread>
#include <utility>
#include <vector>

#include <fmt/format.h>

#include "firmware/page/http_connection.h"

namespace hord::firmware::page {
namespace {

constexpr int kRequestsOfOneConnection = 100, kBacklog = 128;
constexpr std::size_t kThreadsBesideViewers = 12, kMaxWaiting = 32;
constexpr auto kHeadTimeout = std::chrono::seconds(5), kIdleTimeout = std::chrono::seconds(3);
constexpr auto kKeepAlive = std::chrono::milliseconds(3000);  // comment to a browser without an event

thread_local Connection* current_connection = nullptr;  // the connection that this thread serves
thread_local bool rejecting = false;

Request request_from(const httplib::Request& from) {
    Request request;
    request.method = from.method;
    request.path = from.path;
    for (const auto& [name, value] : from.params) request.query.emplace(name, value);
    request.body = from.body;
    request.host = from.get_header_value("Host");
    request.origin = from.get_header_value("Origin");
    request.fetch_site = from.get_header_value("Sec-Fetch-Site");
    request.authorization = from.get_header_value("Authorization");
    request.content_type = from.get_header_value("Content-Type");
    request.peer = from.remote_addr;
    return request;
}

// A fixed number of threads with a bounded queue. A connection beyond the queue is served at once by the accepting
// thread, with `rejecting` set: it is answered 503.
class Threads final : public httplib::TaskQueue {
  public:
    Threads(std::size_t count, std::atomic<int>& waiting) : count_(waiting) {
        for (std::size_t k = 0; k < count; ++k) threads_.emplace_back([this] { work(); });
    }
    // void in cpp-httplib 0.11, bool (whether it was taken) from 0.14 on.
    using Taken = decltype(std::declval<httplib::TaskQueue&>().enqueue(std::function<void()>()));
    Taken enqueue(std::function<void()> task) override {
        {
            const std::lock_guard lock(mutex_);
            if (!ended_ && waiting_.size() < kMaxWaiting) {
                waiting_.push_back(std::move(task));
                ++count_;
                wake_.notify_one();
                return static_cast<Taken>(true);
            }
        }
        rejecting = true;
        task();
        rejecting = false;
        return static_cast<Taken>(true);
    }
    void shutdown() override {
        {
            const std::lock_guard lock(mutex_);
            ended_ = true;
        }
        wake_.notify_all();
        for (std::thread& thread : threads_) thread.join();
        threads_.clear();
    }

  private:
    void work() {
        while (true) {
            std::function<void()> task;
            {
                std::unique_lock lock(mutex_);
                wake_.wait(lock, [this] { return ended_ || !waiting_.empty(); });
                if (waiting_.empty()) return;
                task = std::move(waiting_.front());
                waiting_.pop_front();
                --count_;
            }
            task();
        }
    }
    std::atomic<int>& count_;  // of waiting_
    std::mutex mutex_;
    std::condition_variable wake_;
    std::deque<std::function<void()>> waiting_;
    bool ended_ = false;
    std::vector<std::thread> threads_;
};

class HttpServer final : public httplib::Server {
  public:
    HttpServer(Pages& pages, Viewers& viewers) : pages_(pages), viewers_(viewers) {
        httplib::Headers headers;
        for (const auto& [name, value] : headers_of_every_reply()) headers.emplace(name, value);
        set_default_headers(headers);
        set_payload_max_length(kLargestBody);
        set_tcp_nodelay(true);
        set_keep_alive_max_count(kRequestsOfOneConnection);  // for the header Keep-Alive; serve() enforces it
        set_keep_alive_timeout(kIdleTimeout.count());
        set_socket_options([](socket_t fd) {
            const int yes = 1;
            ::setsockopt(fd, SOL_SOCKET, SO_REUSEADDR, &yes, sizeof yes);
        });
        set_pre_routing_handler([this](const httplib::Request& request, httplib::Response& response) {
            if (!request.get_header_value("Content-Encoding").empty() ||
                !request.get_header_value("Transfer-Encoding").empty()) {
                send_reply(
                    {415,
                     "application/json",
                     R"({"error":"a packed or chunked body is not read","cure":"send it plainly, with its length"})",
                     {},
                     false},
                    response);
                return HandlerResponse::Handled;
            }
            auto reply = pages_.answer_without_body(request_from(request));
            if (!reply) return HandlerResponse::Unhandled;
            send_reply(std::move(*reply), response);
            return HandlerResponse::Handled;
        });
        Post("/api/command", [this](const httplib::Request& request, httplib::Response& response) {
            send_reply(pages_.answer_command(request_from(request)), response);
        });
        set_error_handler(Handler([](const httplib::Request&, httplib::Response& response) {
            if (response.body.empty())
                response.set_content(R"({"error":"the request cannot be read","cure":"see docs/page.md"})",
                                     "application/json");
        }));
        set_exception_handler([](const httplib::Request&, httplib::Response& response, const std::exception_ptr&) {
            response.status = 500;
            response.set_content(R"({"error":"the page failed at this request","cure":"report it"})",
                                 "application/json");
        });
    }

    // cpp-httplib 0.11 asks the stream for its addresses; 0.18 takes them as arguments.
    template <class Stream>
    bool answer(Stream& stream, bool last, bool& closed) {
        if constexpr (requires { this->process_request(stream, last, closed, nullptr); }) {
            return this->process_request(stream, last, closed, nullptr);
        } else {
            std::string remote, local;
            int remote_port = 0, local_port = 0;
            stream.get_remote_ip_and_port(remote, remote_port);
            stream.get_local_ip_and_port(local, local_port);
            return this->process_request(stream, remote, remote_port, local, local_port, last, closed, nullptr);
        }
    }

    void serve(ByteStream& stream) {
        Connection connection(stream);
        current_connection = &connection;
        auto timeout = kHeadTimeout;
        for (int k = 0; k < kRequestsOfOneConnection; ++k, timeout = kIdleTimeout) {
            const auto head = connection.next(timeout);
            if (head == Connection::Head::none) break;
            if (head != Connection::Head::whole) {
                connection.send_text(
                    head == Connection::Head::too_large
                        ? "HTTP/1.1 431 Request Header Fields Too Large\r\nContent-Length: 0\r\nConnection: "
                          "close\r\n\r\n"
                        : "HTTP/1.1 400 Bad Request\r\nContent-Length: 0\r\nConnection: close\r\n\r\n");
                break;
            }
            // The bytes of a body that was not read would be parsed as the next request.
            const bool last = connection.has_body() || k + 1 == kRequestsOfOneConnection || ending;
            bool closed = false;
            if (!answer(connection, last, closed) || closed || last) break;
        }
        current_connection = nullptr;
    }

    // For serve_connection(): cpp-httplib ends the streams of a server that does not listen.
    void pretend_to_listen() { svr_sock_ = 0; }

    // cpp-httplib's backlog is 5 connections. A browser opens 6 at once, and one beyond the backlog waits a second.
    void raise_backlog() { (void)::listen(svr_sock_, kBacklog); }

    std::atomic<bool> ending{false};
    std::atomic<int> waiting{0};

  private:
    bool process_and_close_socket(socket_t fd) override {
        SocketStream stream(fd, ending, waiting);
        if (rejecting) {
            pages_.count_turned_away();
            constexpr std::string_view kFull =
                "HTTP/1.1 503 Service Unavailable\r\nRetry-After: 2\r\nContent-Length: 0\r\nConnection: close\r\n\r\n";
            (void)::send(fd, kFull.data(), kFull.size(), MSG_NOSIGNAL | MSG_DONTWAIT);
        } else {
            serve(stream);
        }
        ::shutdown(fd, SHUT_RDWR);
        ::close(fd);
        return true;
    }

    void send_reply(Reply reply, httplib::Response& response) {
        response.status = reply.status;
        for (const auto& [name, value] : reply.headers) response.set_header(name, value);
        if (!reply.events) {
            response.set_content(std::move(reply.body), reply.type);  // NOLINT: 0.11 copies, 0.18 moves
            return;
        }
        std::shared_ptr<Viewers::Viewer> viewer = viewers_.enter();
        if (!viewer) {
            response.status = 503;
            response.set_header("Retry-After", "2");
            response.set_content(R"({"error":"as many viewers as may be are told of changes",)"
                                 R"("cure":"ask for /api/page every two seconds, or raise page.viewers"})",
                                 "application/json");
            return;
        }
        if (current_connection != nullptr) current_connection->begin_events();
        // The viewer is registered before it loads the page's data: no event is lost in between.
        auto beginning = std::make_shared<std::string>(std::move(reply.body) + "event: page\ndata: {}\n\n");
        response.set_chunked_content_provider(reply.type, [viewer, beginning](std::size_t, httplib::DataSink& sink) {
            if (!beginning->empty()) {
                const std::string text = std::exchange(*beginning, {});
                return sink.write(text.data(), text.size());
            }
            if (!sink.is_writable()) return false;  // the browser has left
            const auto text = viewer->next(kKeepAlive);
            if (!text) {
                sink.done();
                return true;
            }
            return sink.write(text->data(), text->size());
        });
    }

    Pages& pages_;
    Viewers& viewers_;
};

}  // namespace

struct PageServer::Parts {
    Parts(Pages& pages, Viewers& all) : http(pages, all), viewers(all) {}
    HttpServer http;
    Viewers& viewers;
    int port = 0;
    std::atomic<bool> started{false}, ended{false};
};

PageServer::PageServer(std::unique_ptr<Parts> parts) : parts_(std::move(parts)) {}
PageServer::~PageServer() = default;

Result<std::unique_ptr<PageServer>> PageServer::open(const PageConfig& config, Pages& pages, Viewers& viewers) {
    auto parts = std::make_unique<Parts>(pages, viewers);
    const auto threads = static_cast<std::size_t>(config.viewers) + kThreadsBesideViewers;
    parts->http.new_task_queue = [threads, http = &parts->http] { return new Threads(threads, http->waiting); };
    errno = 0;
    if (config.port == 0) parts->port = parts->http.bind_to_any_port(config.host);
    else parts->port = parts->http.bind_to_port(config.host, config.port) ? config.port : -1;
    if (parts->port <= 0) {
        const bool taken = errno == EADDRINUSE;
        return fail(taken ? ErrorCode::busy : ErrorCode::invalid_argument,
                    fmt::format("the page cannot listen at {}:{} ({})", config.host, config.port,
                                errno != 0 ? std::strerror(errno) : "no such address"),
                    taken ? "end the program that has this port, or choose another in page.toml: [page] port"
                          : "name an address of this machine in page.toml: [page] host");
    }
    parts->http.raise_backlog();
    return std::unique_ptr<PageServer>(new PageServer(std::move(parts)));
}

std::uint16_t PageServer::port() const { return static_cast<std::uint16_t>(parts_->port); }

void PageServer::run() {
    parts_->started = true;
    if (!parts_->http.ending) parts_->http.listen_after_bind();
    parts_->ended = true;
}

void PageServer::stop() {
    parts_->http.ending = true;
    parts_->viewers.end();
    // stop() has no effect on a server that has not begun to listen: wait until it has.
    while (parts_->started && !parts_->ended && !parts_->http.is_running())
        std::this_thread::sleep_for(std::chrono::milliseconds(5));
    parts_->http.stop();
}

void serve_connection(Pages& pages, Viewers& viewers, ByteStream& stream) {
    HttpServer http(pages, viewers);
    http.pretend_to_listen();
    http.serve(stream);
}

}  // namespace hord::firmware::page
