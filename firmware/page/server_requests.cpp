// Requests to the page, and their replies.
#include <algorithm>
#include <charconv>
#include <exception>
#include <memory>
#include <utility>

#include <unistd.h>

#include "firmware/page/server_impl.h"

namespace hord::firmware::page {

// A request until its reply is sent.
struct Exchange {
    Request request;
    std::optional<Reply> reply;
};

namespace {

constexpr auto kReplyTimeout = std::chrono::seconds(30);  // until the reply is taken, from the request
constexpr unsigned kEventTimeout_s = 10;                  // of a viewer that takes nothing
constexpr std::size_t kLargestHead = 8 * 1024, kLargestBody = 4 * 1024;
constexpr std::size_t kChunk = 32 * 1024;                 // of a reply
constexpr std::size_t kMaxReplyBytes = 64 * 1024 * 1024;  // of all replies in memory; frames stay in their files
constexpr std::size_t kMaxWaiting = 64;                   // requests, for a worker

std::optional<std::string> percent_decoded(std::string_view text) {
    std::string out;
    for (std::size_t k = 0; k < text.size(); ++k) {
        unsigned value = static_cast<unsigned char>(text[k]);
        if (text[k] == '%') {
            if (k + 2 >= text.size()) return std::nullopt;
            const auto read = std::from_chars(text.data() + k + 1, text.data() + k + 3, value, 16);
            if (read.ptr != text.data() + k + 3) return std::nullopt;
            k += 2;
        }
        out += static_cast<char>(value);
    }
    return out;
}

Reply error_reply(int status, std::string_view what, std::string_view cure) {
    Reply reply{.status = status, .body = store::to_text({{"error", what}, {"cure", cure}})};
    if (status == 503) reply.headers.emplace_back("Retry-After", "2");
    return reply;
}

Client& client_of(MHD_Connection* connection) {
    return *static_cast<Client*>(
        MHD_get_connection_info(connection, MHD_CONNECTION_INFO_SOCKET_CONTEXT)->socket_context);
}

// Collects the header lines that count; `wrong`: one that no browser sends.
struct Head {
    Request& request;
    int hosts = 0, lengths = 0;
    std::string length = {};
    bool encoded = false, wrong = false;

    void add(std::string_view name, std::string_view value) {
        const auto control = [](unsigned char c) { return (c < 0x20 && c != '\t') || c == 0x7F; };
        wrong = wrong || name.empty() || name.find_first_of(" \t") != std::string_view::npos ||
            std::ranges::any_of(name, control) || std::ranges::any_of(value, control);
        const std::string key = lower(name);
        if (key == "host") request.host = value, ++hosts;
        else if (key == "origin") request.origin = value;
        else if (key == "sec-fetch-site") request.fetch_site = value;
        else if (key == "authorization") request.authorization = value;
        else if (key == "content-type") request.content_type = value;
        else if (key == "content-length") length = value, ++lengths;
        else if (key == "content-encoding" || key == "transfer-encoding") encoded = true;
    }
};

}  // namespace

// A reply's bytes: text, a file, text.
struct PageServer::Impl::Body {
    Body(Impl& server, Reply&& reply)
        : held(server.reply_bytes), head(std::move(reply.body)), file(std::move(reply.file)),
          tail(std::move(reply.tail)) {
        held += head.size() + tail.size();
    }
    Body(const Body&) = delete;
    Body& operator=(const Body&) = delete;
    ~Body() { held -= head.size() + tail.size(); }

    static ssize_t read(void* self, std::uint64_t at, char* into, std::size_t size) {
        const Body& body = *static_cast<Body*>(self);
        for (const std::string* text : {&body.head, &body.tail}) {
            if (at < text->size()) return static_cast<ssize_t>(text->copy(into, size, at));
            at -= text->size();
            if (text == &body.tail) break;
            if (at < body.file.size) {
                const std::size_t left = std::min<std::uint64_t>(size, body.file.size - at);
                const ssize_t got = ::pread(body.file.fd.get(), into, left, static_cast<off_t>(at));
                return got > 0 ? got : MHD_CONTENT_READER_END_WITH_ERROR;
            }
            at -= body.file.size;
        }
        return MHD_CONTENT_READER_END_OF_STREAM;
    }
    static void free(void* self) { delete static_cast<Body*>(self); }

    std::atomic<std::size_t>& held;
    const std::string head;
    const Reply::File file;
    const std::string tail;
};

// A viewer's connection is suspended while there is no event.
struct PageServer::Impl::Events {
    std::unique_ptr<Viewers::Viewer> viewer;
    std::string text;

    static ssize_t read(void* self, std::uint64_t, char* into, std::size_t size) {
        auto& events = *static_cast<Events*>(self);
        if (events.text.empty()) {
            auto next = events.viewer->next();
            if (!next) return MHD_CONTENT_READER_END_OF_STREAM;
            events.text = std::move(*next);
        }
        const std::size_t count = events.text.copy(into, size);
        events.text.erase(0, count);
        return static_cast<ssize_t>(count);
    }
    static void free(void* self) { delete static_cast<Events*>(self); }
};

void PageServer::Impl::wait_for(MHD_Connection* connection, bool asking) {
    const std::lock_guard lock(mutex);
    Client& client = client_of(connection);
    client.asking = asking;
    client.since = Clock::now();
    client.due = client.since + (asking ? Clock::duration(kRequestTimeout) : Clock::duration(kReplyTimeout));
}

MHD_Result PageServer::Impl::on_request(void* self, MHD_Connection* connection, const char* url, const char* method,
                                        const char* /*version*/, const char* body, std::size_t* body_size,
                                        void** exchange) try {
    auto& server = *static_cast<Impl*>(self);
    if (*exchange == nullptr) {
        auto made = std::make_unique<Exchange>();
        made->request.method = method;
        auto refused = server.read_head(connection, url, made->request);
        *exchange = made.release();
        return refused ? server.send(connection, std::move(*refused), true) : MHD_YES;
    }
    auto& known = *static_cast<Exchange*>(*exchange);
    if (*body_size > 0) {  // at most kLargestBody in all: read_head() has checked
        known.request.body.append(body, std::exchange(*body_size, 0));
        return MHD_YES;
    }
    return known.reply ? server.send(connection, std::move(*known.reply)) : server.answer(connection, known);
} catch (const std::exception&) {
    return MHD_NO;  // closes the connection
}

void PageServer::Impl::on_completed(void* self, MHD_Connection* connection, void** exchange,
                                    MHD_RequestTerminationCode /*why*/) {
    delete static_cast<Exchange*>(*exchange);
    *exchange = nullptr;
    static_cast<Impl*>(self)->wait_for(connection, true);
}

// Empty: the head is good. Else the refusal; the connection ends after it, since its body is not read.
std::optional<Reply> PageServer::Impl::read_head(MHD_Connection* connection, std::string_view url, Request& request) {
    request.peer = client_of(connection).peer;
    const auto size = MHD_get_connection_info(connection, MHD_CONNECTION_INFO_REQUEST_HEADER_SIZE)->header_size;
    if (size > kLargestHead) return error_reply(431, "the head of the request is too large", "send at most 8 KiB");
    Head head{request};
    const auto each = [](void* to, MHD_ValueKind, const char* name, std::size_t name_size, const char* value,
                         std::size_t value_size) {
        static_cast<Head*>(to)->add({name, name_size}, {value, value_size});
        return MHD_YES;
    };
    MHD_get_connection_values_n(connection, MHD_HEADER_KIND, +each, &head);
    std::size_t length = 0;
    const auto read = std::from_chars(head.length.data(), head.length.data() + head.length.size(), length);
    const bool whole_number = head.lengths == 0 ||
        (read.ec != std::errc::invalid_argument && read.ptr == head.length.data() + head.length.size());
    auto path = percent_decoded(url);
    bool query_good = true;
    std::pair<Fields*, bool*> query{&request.query, &query_good};
    const auto each_field = [](void* to, MHD_ValueKind, const char* name, std::size_t name_size, const char* value,
                               std::size_t value_size) {
        auto& [fields, good] = *static_cast<std::pair<Fields*, bool*>*>(to);
        auto key = percent_decoded({name, name_size}), text = percent_decoded({value, value_size});
        *good = *good && key && text;
        if (key && text) fields->emplace(std::move(*key), std::move(*text));
        return MHD_YES;
    };
    MHD_get_connection_values_n(connection, MHD_GET_ARGUMENT_KIND, +each_field, &query);
    if (head.wrong || head.hosts > 1 || head.lengths > 1 || !whole_number || !path || !query_good)
        return error_reply(400, "the request cannot be read", "see docs/page.md");
    if (head.encoded)
        return error_reply(415, "a packed or chunked body is not read", "send it plainly, with its length");
    if (read.ec == std::errc::result_out_of_range || length > kLargestBody)
        return error_reply(413, "the body is too large", "send at most 4 KiB");
    request.path = std::move(*path);
    return std::nullopt;
}

Reply PageServer::Impl::reply_to(const Request& request) noexcept try {
    return pages.answer(request);
} catch (const std::exception&) {
    return error_reply(500, "the page failed at this request", "report it");
}

MHD_Result PageServer::Impl::answer(MHD_Connection* connection, Exchange& exchange) {
    wait_for(connection, false);
    if (!workers.empty() && !Pages::is_in_memory(exchange.request)) {
        std::unique_lock lock(mutex);
        if (!ending && jobs.size() < kMaxWaiting) {
            MHD_suspend_connection(connection);
            jobs.push_back({connection, &exchange});
            wake.notify_all();  // the ticker waits for it, too
            return MHD_YES;
        }
        lock.unlock();
        return send(connection, error_reply(503, "too many requests wait", "try again in a moment"));
    }
    return send(connection, reply_to(exchange.request));
}

void PageServer::Impl::work() {
    std::unique_lock lock(mutex);
    while (true) {
        wake.wait(lock, [this] { return ending || !jobs.empty(); });
        if (jobs.empty()) return;
        const Job job = jobs.front();
        jobs.pop_front();
        lock.unlock();
        job.exchange->reply = reply_to(job.exchange->request);
        MHD_resume_connection(job.connection);
        lock.lock();
    }
}

MHD_Result PageServer::Impl::send(MHD_Connection* connection, Reply reply, bool last) {
    std::unique_ptr<Viewers::Viewer> viewer;
    if (reply.events) {
        viewer = viewers.enter([connection] { MHD_suspend_connection(connection); },
                               [connection] { MHD_resume_connection(connection); });
        if (!viewer) {
            reply = error_reply(503, "as many viewers as may be are told of changes",
                                "ask for /api/page every two seconds, or raise page.viewers");
        }
    }
    if (reply_bytes + reply.body.size() + reply.tail.size() > kMaxReplyBytes)
        reply = error_reply(503, "too many replies wait for slow clients", "try again in a moment");
    const auto status = static_cast<unsigned>(reply.status);
    auto headers = std::move(reply.headers);
    headers.emplace_back("Content-Type", std::move(reply.type));
    if (last || viewer) headers.emplace_back("Connection", "close");
    MHD_Response* response = nullptr;
    if (viewer) {
        // The viewer is registered before it loads the page's data: no event is lost in between.
        auto events = std::make_unique<Events>(Events{std::move(viewer), reply.body + "event: page\ndata: {}\n\n"});
        response =
            MHD_create_response_from_callback(MHD_SIZE_UNKNOWN, kChunk, &Events::read, events.get(), &Events::free);
        if (response != nullptr) (void)events.release();
        MHD_set_connection_option(connection, MHD_CONNECTION_OPTION_TIMEOUT, kEventTimeout_s);
        const std::lock_guard lock(mutex);
        client_of(connection).due = Clock::time_point::max();
    } else {
        auto body = std::make_unique<Body>(*this, std::move(reply));
        const std::size_t size = body->head.size() + body->file.size + body->tail.size();
        response = MHD_create_response_from_callback(size, std::clamp<std::size_t>(size, 1, kChunk), &Body::read,
                                                     body.get(), &Body::free);
        if (response != nullptr) (void)body.release();
    }
    if (response == nullptr) return MHD_NO;
    for (const auto& [name, value] : headers_of_every_reply())
        MHD_add_response_header(response, name.c_str(), value.c_str());
    for (const auto& [name, value] : headers) MHD_add_response_header(response, name.c_str(), value.c_str());
    const MHD_Result queued = MHD_queue_response(connection, status, response);
    MHD_destroy_response(response);
    return queued;
}

}  // namespace hord::firmware::page
