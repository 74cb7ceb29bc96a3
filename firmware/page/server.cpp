// The only file that includes cpp-httplib.
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
#include <httplib.h>
#include <poll.h>

namespace hord::firmware::page {
namespace {

using Clock = std::chrono::steady_clock;
constexpr std::size_t kLargestHead = 8 * 1024, kLargestBody = 4 * 1024;
constexpr auto kHeadPatience = std::chrono::seconds(5), kIdlePatience = std::chrono::seconds(3),
               kWritePatience = std::chrono::seconds(5), kReplyPatience = std::chrono::seconds(30);
constexpr auto kPressedPatience = std::chrono::milliseconds(400);  // with who is silent while others wait
constexpr auto kSlice = std::chrono::milliseconds(200);            // a page that ends is not kept waiting longer
constexpr auto kStillHere = std::chrono::milliseconds(3000);
constexpr int kRequestsOfOneConnection = 100, kBacklog = 128;
constexpr std::size_t kThreadsBesideViewers = 12, kMaxWaiting = 32;

// Where bytes come from and go to.
class Wire {
  public:
    virtual ~Wire() = default;
    virtual ssize_t receive(char* into, std::size_t size,
                            Clock::time_point until) = 0;  // 0: ended; -1: error or too late
    virtual ssize_t send(const char* bytes, std::size_t size, Clock::time_point until) = 0;
    virtual bool alive() = 0;
    virtual std::pair<std::string, int> peer() const = 0;
    virtual socket_t socket() const = 0;
};

class SocketWire final : public Wire {
  public:
    // `waiting`: connections that no thread has time for yet.
    SocketWire(socket_t fd, const std::atomic<bool>& ending, const std::atomic<int>& waiting)
        : fd_(fd), ending_(ending), waiting_(waiting) {}
    ssize_t receive(char* into, std::size_t size, Clock::time_point until) override {
        return wait(POLLIN, until) ? ::recv(fd_, into, size, MSG_DONTWAIT) : -1;
    }
    ssize_t send(const char* bytes, std::size_t size, Clock::time_point until) override {
        return wait(POLLOUT, until) ? ::send(fd_, bytes, size, MSG_NOSIGNAL | MSG_DONTWAIT) : -1;
    }
    bool alive() override {
        pollfd state{fd_, POLLRDHUP, 0};
        return !ending_ && ::poll(&state, 1, 0) >= 0 && (state.revents & (POLLRDHUP | POLLHUP | POLLERR)) == 0;
    }
    std::pair<std::string, int> peer() const override {
        sockaddr_storage address{};
        socklen_t size = sizeof address;
        char host[NI_MAXHOST] = "", port[NI_MAXSERV] = "0";
        if (::getpeername(fd_, reinterpret_cast<sockaddr*>(&address), &size) != 0) return {"?", 0};
        if (::getnameinfo(reinterpret_cast<sockaddr*>(&address), size, host, sizeof host, port, sizeof port,
                          NI_NUMERICHOST | NI_NUMERICSERV) != 0)
            return {"?", 0};
        return {host, std::atoi(port)};
    }
    socket_t socket() const override { return fd_; }

  private:
    bool wait(short what, Clock::time_point until) {
        const auto began = Clock::now();
        while (!ending_) {
            if (what == POLLIN && waiting_ > 0 && Clock::now() - began > kPressedPatience) return false;
            const auto left = std::chrono::duration_cast<std::chrono::milliseconds>(until - Clock::now());
            if (left.count() <= 0) return false;
            pollfd state{fd_, what, 0};
            const int ready =
                ::poll(&state, 1, static_cast<int>(std::min<std::chrono::milliseconds>(left, kSlice).count()));
            if (ready > 0) return true;
            if (ready < 0 && errno != EINTR) return false;
        }
        return false;
    }
    const socket_t fd_;
    const std::atomic<bool>& ending_;
    const std::atomic<int>& waiting_;
};

class MemoryWire final : public Wire {
  public:
    explicit MemoryWire(std::string_view bytes) : bytes_(bytes) {}
    ssize_t receive(char* into, std::size_t size, Clock::time_point) override {
        const std::size_t count = std::min(size, bytes_.size());
        std::memcpy(into, bytes_.data(), count);
        bytes_.remove_prefix(count);
        return static_cast<ssize_t>(count);
    }
    ssize_t send(const char* bytes, std::size_t size, Clock::time_point) override {
        answer.append(bytes, size);
        return static_cast<ssize_t>(size);
    }
    bool alive() override {
        return answer.find("event: page") == std::string::npos;
    }  // a viewer leaves after the first event
    std::pair<std::string, int> peer() const override { return {"memory", 0}; }
    socket_t socket() const override { return -1; }
    std::string answer;

  private:
    std::string_view bytes_;
};

// One connection as cpp-httplib sees it: heads come whole and checked, and every wait has an end.
class Connection final : public httplib::Stream {
  public:
    explicit Connection(Wire& wire) : wire_(wire) {}

    enum class Head : std::uint8_t { whole, none, too_large, malformed };
    // Reads the next request's head. Whole: read() gives it, without what this page does not serve.
    Head next(std::chrono::seconds patience) {
        const auto until = Clock::now() + patience;
        std::size_t end = std::string::npos;
        while ((end = buffer_.find("\r\n\r\n")) == std::string::npos) {
            if (buffer_.size() > kLargestHead) return Head::too_large;
            char bytes[4096];
            const ssize_t got = wire_.receive(bytes, sizeof bytes, until);
            if (got <= 0) return Head::none;
            buffer_.append(bytes, static_cast<std::size_t>(got));
        }
        if (end > kLargestHead) return Head::too_large;
        end += 4;
        auto checked = checked_head(std::string_view(buffer_).substr(0, end));
        if (!checked) return Head::malformed;
        buffer_.replace(0, end, *checked);
        may_read_ = checked->size() + kLargestBody + 1;  // one more than allowed: httplib finds that it is too much
        read_until_ = Clock::now() + kHeadPatience;
        reply_until_ = Clock::now() + kReplyPatience;
        events_ = false;
        return Head::whole;
    }
    [[nodiscard]] bool has_body() const { return has_body_; }
    void begin_events() { events_ = true; }
    void say(std::string_view text) { (void)wire_.send(text.data(), text.size(), Clock::now() + kSlice); }

    bool is_readable() const override { return !buffer_.empty(); }
    bool is_writable() const override { return wire_.alive(); }
    ssize_t read(char* into, std::size_t size) override {
        size = std::min(size, may_read_);
        if (size == 0) return -1;
        ssize_t got = 0;
        if (!buffer_.empty()) {
            got = static_cast<ssize_t>(std::min(size, buffer_.size()));
            std::memcpy(into, buffer_.data(), static_cast<std::size_t>(got));
            buffer_.erase(0, static_cast<std::size_t>(got));
        } else {
            got = wire_.receive(into, size, read_until_);
        }
        if (got > 0) may_read_ -= static_cast<std::size_t>(got);
        return got;
    }
    ssize_t write(const char* bytes, std::size_t size) override {
        const auto soon = Clock::now() + kWritePatience;
        return wire_.send(bytes, size, events_ ? soon : std::min(soon, reply_until_));
    }
    void get_remote_ip_and_port(std::string& ip, int& port) const override { std::tie(ip, port) = wire_.peer(); }
    void get_local_ip_and_port(std::string& ip, int& port) const override {
        ip.clear();
        port = 0;
    }
    socket_t socket() const override { return wire_.socket(); }

  private:
    // Nothing for what no browser sends: control characters, folded lines, a head without a colon, Host or
    // Content-Length twice. Range is left out: replies are small and whole.
    std::optional<std::string> checked_head(std::string_view head) {
        std::string out;
        int hosts = 0, lengths = 0, number = 0;
        has_body_ = false;
        while (head != "\r\n") {
            const auto end = head.find("\r\n");
            const std::string_view line = head.substr(0, end);
            head.remove_prefix(end + 2);
            for (const char c : line) {
                if ((static_cast<unsigned char>(c) < 0x20 && c != '\t') || c == 0x7F) return std::nullopt;
            }
            if (number++ == 0) {
                if (line.find('\t') != std::string_view::npos) return std::nullopt;
                out.append(line).append("\r\n");
                continue;
            }
            const auto colon = line.find(':');
            if (colon == std::string_view::npos || colon == 0 ||
                line.substr(0, colon).find_first_of(" \t") != std::string_view::npos)
                return std::nullopt;
            std::string name(line.substr(0, colon));
            std::transform(name.begin(), name.end(), name.begin(),
                           [](unsigned char c) { return static_cast<char>(std::tolower(c)); });
            hosts += name == "host" ? 1 : 0;
            lengths += name == "content-length" ? 1 : 0;
            has_body_ = has_body_ || name == "content-length" || name == "transfer-encoding";
            if (name == "range" || name == "if-range") continue;
            out.append(line).append("\r\n");
        }
        if (hosts > 1 || lengths > 1) return std::nullopt;
        return out + "\r\n";
    }

    Wire& wire_;
    std::string buffer_;
    std::size_t may_read_ = 0;
    Clock::time_point read_until_{}, reply_until_{};
    bool has_body_ = false, events_ = false;
};

thread_local Connection* here = nullptr;  // the connection that this thread serves
thread_local bool turning_away = false;

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

// A fixed number of threads; what none of them has time for soon is run here and now, marked.
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
        turning_away = true;
        task();
        turning_away = false;
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

class Door final : public httplib::Server {
  public:
    Door(Pages& pages, Viewers& viewers) : pages_(pages), viewers_(viewers) {
        httplib::Headers headers;
        for (const auto& [name, value] : headers_of_every_reply()) headers.emplace(name, value);
        set_default_headers(headers);
        set_payload_max_length(kLargestBody);
        set_tcp_nodelay(true);
        set_keep_alive_max_count(kRequestsOfOneConnection);  // what replies say; serve() sees to it
        set_keep_alive_timeout(kIdlePatience.count());
        set_socket_options([](socket_t fd) {
            const int yes = 1;
            ::setsockopt(fd, SOL_SOCKET, SO_REUSEADDR, &yes, sizeof yes);
        });
        set_pre_routing_handler([this](const httplib::Request& request, httplib::Response& response) {
            if (!request.get_header_value("Content-Encoding").empty() ||
                !request.get_header_value("Transfer-Encoding").empty()) {
                give({415,
                      "application/json",
                      R"({"error":"a packed or chunked body is not read","cure":"send it plainly, with its length"})",
                      {},
                      false},
                     response);
                return HandlerResponse::Handled;
            }
            auto reply = pages_.answer_without_body(request_from(request));
            if (!reply) return HandlerResponse::Unhandled;
            give(std::move(*reply), response);
            return HandlerResponse::Handled;
        });
        Post("/api/command", [this](const httplib::Request& request, httplib::Response& response) {
            give(pages_.answer_command(request_from(request)), response);
        });
        set_error_handler(Handler([](const httplib::Request&, httplib::Response& response) {
            if (response.body.empty())
                response.set_content(R"({"error":"the request cannot be read","cure":"see docs/page.md"})",
                                     "application/json");
        }));
        set_exception_handler([](const httplib::Request&, httplib::Response& response, std::exception_ptr) {
            response.status = 500;
            response.set_content(R"({"error":"the page failed at this request","cure":"report it"})",
                                 "application/json");
        });
    }

    // cpp-httplib asked the stream itself who is at its ends (0.11); later it is told (0.18).
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

    void serve(Wire& wire) {
        Connection connection(wire);
        here = &connection;
        auto patience = kHeadPatience;
        for (int k = 0; k < kRequestsOfOneConnection; ++k, patience = kIdlePatience) {
            const auto head = connection.next(patience);
            if (head == Connection::Head::none) break;
            if (head != Connection::Head::whole) {
                connection.say(head == Connection::Head::too_large
                                   ? "HTTP/1.1 431 Request Header Fields Too Large\r\nContent-Length: 0\r\nConnection: "
                                     "close\r\n\r\n"
                                   : "HTTP/1.1 400 Bad Request\r\nContent-Length: 0\r\nConnection: close\r\n\r\n");
                break;
            }
            // A body that was refused unread would be taken for the next request.
            const bool last = connection.has_body() || k + 1 == kRequestsOfOneConnection || ending;
            bool closed = false;
            if (!answer(connection, last, closed) || closed || last) break;
        }
        here = nullptr;
    }

    // cpp-httplib ends the streams of a server that does not listen; without a socket it is to be told otherwise.
    void seem_to_listen() { svr_sock_ = 0; }

    // The library lets five connections wait for the system; a browser opens six at once, and what does not fit waits a
    // second.
    void let_more_wait() { (void)::listen(svr_sock_, kBacklog); }

    std::atomic<bool> ending{false};
    std::atomic<int> waiting{0};

  private:
    bool process_and_close_socket(socket_t fd) override {
        SocketWire wire(fd, ending, waiting);
        if (turning_away) {
            pages_.count_turned_away();
            constexpr std::string_view kFull =
                "HTTP/1.1 503 Service Unavailable\r\nRetry-After: 2\r\nContent-Length: 0\r\nConnection: close\r\n\r\n";
            (void)::send(fd, kFull.data(), kFull.size(), MSG_NOSIGNAL | MSG_DONTWAIT);
        } else {
            serve(wire);
        }
        ::shutdown(fd, SHUT_RDWR);
        ::close(fd);
        return true;
    }

    void give(Reply reply, httplib::Response& response) {
        response.status = reply.status;
        for (const auto& [name, value] : reply.headers) response.set_header(name, value);
        if (!reply.events) {
            response.set_content(std::move(reply.body), reply.type);
            return;
        }
        std::shared_ptr<Viewers::Viewer> viewer = viewers_.enter();
        if (!viewer) {
            response.status = 503;
            response.set_header("Retry-After", "2");
            response.set_content(
                R"({"error":"as many viewers as may be are told of changes","cure":"ask for /api/page every two seconds, or raise page.viewers"})",
                "application/json");
            return;
        }
        if (here != nullptr) here->begin_events();
        // Entered first, then told everything: nothing falls between.
        auto beginning = std::make_shared<std::string>(std::move(reply.body) + "event: page\ndata: {}\n\n");
        response.set_chunked_content_provider(reply.type, [viewer, beginning](std::size_t, httplib::DataSink& sink) {
            if (!beginning->empty()) {
                const std::string text = std::exchange(*beginning, {});
                return sink.write(text.data(), text.size());
            }
            if (!sink.is_writable()) return false;  // the browser has left
            const auto text = viewer->next(kStillHere);
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
    Parts(Pages& pages, Viewers& all) : door(pages, all), viewers(all) {}
    Door door;
    Viewers& viewers;
    int port = 0;
    std::atomic<bool> started{false}, ended{false};
};

PageServer::PageServer(std::unique_ptr<Parts> parts) : parts_(std::move(parts)) {}
PageServer::~PageServer() = default;

Result<std::unique_ptr<PageServer>> PageServer::open(const PageConfig& config, Pages& pages, Viewers& viewers) {
    auto parts = std::make_unique<Parts>(pages, viewers);
    const auto threads = static_cast<std::size_t>(config.viewers) + kThreadsBesideViewers;
    parts->door.new_task_queue = [threads, door = &parts->door] { return new Threads(threads, door->waiting); };
    errno = 0;
    if (config.port == 0) parts->port = parts->door.bind_to_any_port(config.host);
    else parts->port = parts->door.bind_to_port(config.host, config.port) ? config.port : -1;
    if (parts->port <= 0) {
        const bool taken = errno == EADDRINUSE;
        return fail(taken ? ErrorCode::busy : ErrorCode::invalid_argument,
                    fmt::format("the page cannot listen at {}:{} ({})", config.host, config.port,
                                errno != 0 ? std::strerror(errno) : "no such address"),
                    taken ? "end the program that has this port, or choose another in page.toml: [page] port"
                          : "name an address of this machine in page.toml: [page] host");
    }
    parts->door.let_more_wait();
    return std::unique_ptr<PageServer>(new PageServer(std::move(parts)));
}

std::uint16_t PageServer::port() const { return static_cast<std::uint16_t>(parts_->port); }

void PageServer::run() {
    parts_->started = true;
    if (!parts_->door.ending) parts_->door.listen_after_bind();
    parts_->ended = true;
}

void PageServer::stop() {
    parts_->door.ending = true;
    parts_->viewers.end();
    // A door that is about to listen would not hear that it shall not.
    while (parts_->started && !parts_->ended && !parts_->door.is_running())
        std::this_thread::sleep_for(std::chrono::milliseconds(5));
    parts_->door.stop();
}

std::string answer_bytes(Pages& pages, Viewers& viewers, std::string_view bytes) {
    Door door(pages, viewers);
    door.seem_to_listen();
    MemoryWire wire(bytes);
    door.serve(wire);
    return std::move(wire.answer);
}

}  // namespace hord::firmware::page
