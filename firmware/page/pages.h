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
// Everything but /api/command (firmware/page/commands.h) only reads. Requests with an unknown Host are refused (DNS
// rebinding).
#pragma once

#include <atomic>
#include <map>
#include <mutex>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include "firmware/page/commands.h"
#include "firmware/page/fair_mutex.h"
#include "firmware/page/kept_frames.h"
#include "firmware/page/live.h"
#include "firmware/page/metrics.h"
#include "firmware/page/page_config.h"
#include "firmware/page/part_picture.h"
#include "firmware/page/reply.h"
#include "firmware/page/results.h"
#include "firmware/page/tokens.h"
#include "firmware/page/wall.h"

namespace hord::firmware::page {

// Security headers of every reply: no content of other sites, no framing, no guessing of types.
const std::vector<std::pair<std::string, std::string>>& headers_of_every_reply();

class Pages {
  public:
    struct Dependencies {
        const PageConfig& config;
        const Tokens& tokens;
        Viewers& viewers;
        Live& live;
        Results& results;
        KeptFrames& frames;
        PartPictures& pictures;
        Commands::Send command;
        Commands::Log log;  // one line: a command, a wrong token
        std::string version;
        const Wall* wall = nullptr;  // shows several stations, and nothing else
    };
    explicit Pages(Dependencies dependencies)
        : deps_(std::move(dependencies)), commands_(deps_.tokens, deps_.command, deps_.log) {}

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
    [[nodiscard]] Reply reply_to(const Request& request);

    const Dependencies deps_;
    Commands commands_;
    FairMutex frame_mutex_;  // frames are large: one in memory at a time
    std::mutex mutex_;
    std::map<int, std::uint64_t> replies_;
    std::atomic<std::uint64_t> turned_away_{0};
};

}  // namespace hord::firmware::page
