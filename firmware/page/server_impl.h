// What the two halves of the page's server share (server.cpp, server_requests.cpp): libmicrohttpd is in them alone.
#pragma once

#include <atomic>
#include <chrono>
#include <condition_variable>
#include <cstddef>
#include <cstdint>
#include <deque>
#include <list>
#include <mutex>
#include <optional>
#include <string>
#include <string_view>
#include <thread>
#include <vector>

#include <microhttpd.h>

#include "firmware/page/server.h"

namespace hord::firmware::page {

using Clock = std::chrono::steady_clock;

inline constexpr auto kRequestTimeout =
    std::chrono::seconds(5);  // until a request is there, from the connection or from the last reply

// A connection. All under Impl::mutex, except `peer`.
struct Client {
    int fd = -1;
    std::string peer;  // its address, without the port
    Clock::time_point since, due;
    bool asking = true;  // no request of it is whole
    bool ended = false;  // shut down; the library closes it soon
};

struct Exchange;  // a request until its reply is sent

struct PageServer::Impl {
    Impl(Pages& p, Viewers& v) : pages(p), viewers(v) {}
    Impl(const Impl&) = delete;
    Impl& operator=(const Impl&) = delete;
    ~Impl();

    bool start(unsigned flags, std::vector<MHD_OptionItem> options);
    void begin_threads();

    // -- connections

    static MHD_Result on_accept(void* self, const sockaddr* address, socklen_t length);
    static void on_connection(void* self, MHD_Connection* connection, void** context,
                              MHD_ConnectionNotificationCode what);
    void check_times();
    void wait_for(MHD_Connection* connection, bool asking);
    static void end(Client& client);

    // -- requests

    static MHD_Result on_request(void* self, MHD_Connection* connection, const char* url, const char* method,
                                 const char* version, const char* body, std::size_t* body_size, void** exchange);
    static void on_completed(void* self, MHD_Connection* connection, void** exchange, MHD_RequestTerminationCode why);
    std::optional<Reply> read_head(MHD_Connection* connection, std::string_view url, Request& request);
    MHD_Result answer(MHD_Connection* connection, Exchange& exchange);
    Reply reply_to(const Request& request) noexcept;
    void work();
    MHD_Result send(MHD_Connection* connection, Reply reply, bool last = false);

    struct Body;
    struct Events;
    struct Job {
        MHD_Connection* connection;
        Exchange* exchange;
    };

    Pages& pages;
    Viewers& viewers;
    MHD_Daemon* daemon = nullptr;
    std::string address;
    std::atomic<std::size_t> reply_bytes{0};

    std::mutex mutex;
    std::condition_variable_any wake;
    std::list<Client> clients;
    std::deque<Job> jobs;
    bool ending = false;
    std::vector<std::thread> workers;
    std::jthread ticker;
};

}  // namespace hord::firmware::page
