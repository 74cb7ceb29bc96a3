// From a request to a reply, without a socket. Any thread.
//
//   / and the site's files               firmware/page/site
//   /api/stations                        of a wall: all of them, as JSON
//   /metrics                             for Prometheus
//   /api/page, /api/state                state and newest results, as JSON; state alone
//   /api/events                          both, as events
//   /api/history?span=15m|24h            for the charts
//   /api/results, /api/results.csv, /api/counts, /api/scores, /api/recipe, /api/changes   from the store
//   /api/reference, /reference/CRC32.png   the reference that the newest recipe of the store names, and its picture
//   /parts/KEY/FILE                      part.json, record.json, record.tar, frame.png, map.png, found.json of one part
//   /api/command                         POST {"command":"stop"}, with a token
//
// Everything but /api/command only reads. It refuses requests with an unknown Host (DNS rebinding), and commands that
// another site made the browser send (cross-site request forgery).
#pragma once

#include <atomic>
#include <chrono>
#include <functional>
#include <map>
#include <mutex>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include "common/unique_fd.h"
#include "firmware/page/fair_mutex.h"
#include "firmware/page/kept_frames.h"
#include "firmware/page/live.h"
#include "firmware/page/metrics.h"
#include "firmware/page/page_config.h"
#include "firmware/page/part_picture.h"
#include "firmware/page/results.h"
#include "firmware/page/tokens.h"
#include "firmware/page/wall.h"
#include "firmware/registers/register_client.h"

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

// Security headers of every reply: no content of other sites, no framing, no guessing of types.
const std::vector<std::pair<std::string, std::string>>& headers_of_every_reply();

class Pages {
  public:
    using Command = std::function<Result<modbus::Client::Reply>(Command code, std::uint32_t argument,
                                                                std::uint32_t argument2, const std::string& who)>;
    struct Dependencies {
        const PageConfig& config;
        const Tokens& tokens;
        Viewers& viewers;
        Live& live;
        Results& results;
        KeptFrames& frames;
        PartPictures& pictures;
        Command command;
        std::function<void(const std::string&)> log;  // one line: a command, a wrong token
        std::string version;
        const Wall* wall = nullptr;  // shows several stations, and nothing else
    };
    explicit Pages(Dependencies dependencies) : deps_(std::move(dependencies)) {}

    [[nodiscard]] Reply answer(const Request& request);
    // The answer needs neither the store nor a frame nor the station: it is there at once.
    [[nodiscard]] static bool is_in_memory(const Request& request);

    void count_turned_away() { ++turned_away_; }

  private:
    [[nodiscard]] Reply get(const Request& request);
    [[nodiscard]] Reply part(const Request& request, std::string_view key, std::string_view file);
    [[nodiscard]] Reply part_for_people(PartKey key, const std::string& map);
    [[nodiscard]] Reply reference_picture_named(std::string_view name);
    [[nodiscard]] Reply metrics();
    [[nodiscard]] bool may_be_called(std::string_view host) const;
    [[nodiscard]] Reply refuse_command(int status, const char* what, const char* cure, const Request& request);
    [[nodiscard]] Reply reply_to(const Request& request);
    [[nodiscard]] Reply execute(const Request& request);
    void log_refusal(const std::string& line);

    const Dependencies deps_;
    FairMutex frame_mutex_;  // frames are large: one in memory at a time
    std::mutex mutex_;
    std::map<int, std::uint64_t> replies_;
    std::map<std::string, std::uint64_t> commands_{{"completed", 0}, {"failed", 0}, {"refused", 0}};
    std::atomic<std::uint64_t> turned_away_{0};
    std::chrono::steady_clock::time_point refusals_since_{};
    std::uint64_t refusals_ = 0;  // since then
};

}  // namespace hord::firmware::page
