// A page over a store and a picture ring of its own, without a station, a socket or a browser.
#pragma once

#include <cmath>
#include <string>
#include <vector>

#include "algo/inspection/pipeline.h"
#include "firmware/page/pages.h"
#include "firmware/page/server.h"
#include "firmware/recipes/recipe_file.h"
#include "firmware/store/frames/frame_archive.h"
#include "firmware/store/frames/frame_retention.h"
#include "tests/firmware/store/results/samples.h"

namespace hord::firmware::page::test {

constexpr std::uint32_t kBoot = 7;
constexpr std::uint32_t kBadPart = 110;  // result 10, whose frame is kept
constexpr const char* kToken = "0123456789abcdef01234567";

// A spot of light in every lenslet; in a bad part the spots of one patch are displaced.
inline Frame part_frame(const algo::Extents& e, bool bad) {
    Frame frame(e.width_px(), e.height_px(), 8);
    for (int n = 0; n < e.n; ++n) {
        for (int m = 0; m < e.m; ++m) {
            const bool jumps = bad && std::abs(m - 12) <= 1 && std::abs(n - 11) <= 1 && (m + n) % 2 == 0;
            const double x = jumps ? 0.2 : 2.0;
            for (int j = 0; j < e.j; ++j) {
                for (int i = 0; i < e.i; ++i)
                    frame.set(m * e.i + i, n * e.j + j,
                              static_cast<std::uint32_t>(200 * std::exp(-((i - x) * (i - x) + (j - 2.0) * (j - 2.0)))));
            }
        }
    }
    return frame;
}

// Of the kept frames: their part fills the field.
constexpr std::string_view kKeptRecipe =
    "name = \"lens\"\n[part]\npresent = \"unchecked\"\n[scale]\nlenslet_mm = 0.5\n";

// Frames as a station keeps them.
inline void keep_frame(const std::filesystem::path& store, std::uint32_t part, bool bad) {
    const algo::Extents extents{24, 24, 5, 5};
    store::FrameRetentionOptions options;
    options.extents = extents;
    options.boot = kBoot;
    options.thread = false;
    store::FrameRetention keeper(
        [&] {
            return store::FrameArchive::open(store / store::kFramesFolder, {1'000'000'000, 0});
        },
        options, [] { return store::test::kNoon; });
    const auto recipe = parse_recipe(kKeptRecipe, "lens.toml");
    keeper.set_recipe(std::string(kKeptRecipe));
    auto pipeline = algo::Pipeline::create(extents, 8, *recipe);
    const Frame frame = part_frame(extents, bad);
    keeper.on_inspection(part, frame.view(), *pipeline->inspect(frame.view()));
    while (keeper.step()) {
    }
}

class SmallPage {
  public:
    explicit SmallPage(std::string_view tokens = "anna 0123456789abcdef01234567\n") {
        store::test::Story story(store::test::start(kBoot));
        story.add(store::test::recipe("lens", "name = \"lens\"\n")).add_results(1, 30);
        store::test::write(folder, story);
        keep_frame(folder.path(), kBadPart, true);
        if (!tokens.empty()) known = *Tokens::parse(tokens, "tokens");
        config.names = {"wall.example"};
    }

    Reply get(const std::string& path, Fields query = {}) {
        Request request;
        request.method = "GET";
        request.path = path;
        request.query = std::move(query);
        request.host = "127.0.0.1:8070";
        return reply_to(request);
    }
    Reply reply_to(const Request& request) {
        Reply reply = pages.answer(request);
        std::string file(reply.file.size, '\0');  // the body whole, as a client gets it
        if (::pread(reply.file.fd.get(), file.data(), file.size(), 0) > 0) reply.body += file + reply.tail;
        return reply;
    }
    Request command(const std::string& body, const std::string& token = kToken) {
        Request request;
        request.method = "POST";
        request.path = "/api/command";
        request.body = body;
        request.host = request.origin = "127.0.0.1:8070";
        request.origin = "http://" + request.host;
        request.authorization = "Bearer " + token;
        request.content_type = "application/json";
        request.peer = "127.0.0.1";
        return request;
    }

    struct Commanded {
        Command code;
        std::string who;
    };
    store::test::TempFolder folder;
    PageConfig config;
    Tokens known;
    Viewers viewers{2};
    Live live{viewers};
    Results results{folder.path()};
    KeptFrames frames{folder.path() / store::kFramesFolder};
    PartPictures pictures;
    std::vector<Commanded> commands;
    std::vector<std::string> log;
    modbus::Client::Reply answer{CommandState::completed, CommandError::none, 0, "none"};
    Pages pages{
        {config, known, viewers, live, results, frames, pictures,
         [this](Command code, std::uint32_t, std::uint32_t, const std::string& who) -> Result<modbus::Client::Reply> {
             commands.push_back({code, who});
             return answer;
         },
         [this](const std::string& line) { log.push_back(line); }, "0.0.1"}};
};

// A station's answers.
inline RegisterSnapshot example_snapshot(State state = State::continuous_execution,
                                         std::uint32_t faults = kFaultLightLevel) {
    StationIdentity identity;
    identity.firmware = "0.1.0";
    identity.boot_id = kBoot;
    Snapshot snapshot;
    snapshot.state = state;
    snapshot.run_permit = true;
    snapshot.faults_active = faults;
    snapshot.faults_latched = faults | kFaultRejector;
    snapshot.counters.seen = 12;
    snapshot.counters.pass = 9;
    RegisterExtras extras;
    extras.recipe = {7, 0xCAFE, ShortText("lens \"a\"\\")};
    HealthReport& health = extras.health;
    health.uptime_s = health.frames_lost = health.frames_corrupt = health.modbus_connections = health.modbus_requests =
        health.modbus_exceptions = health.modbus_evicted = health.modbus_broken = 1;
    health.frames_waiting = std::uint16_t{1};
    health.processor_celsius = health.disk_free_percent = 50;
    health.optics.light_percent = 95;
    health.optics.dark_drift_dn = 0.5;
    health.optics.uneven_percent = -12;
    health.optics.specks = 1;
    extras.calibration = {1, 2, 0.01, 0.02, 60, 60};
    extras.statistics = {1, 2, 3, 4, 5, 6, 90.5};
    extras.plc.emplace();
    extras.plc->plc_heartbeat_age_ms = 20;
    extras.plc->staged.emd_limit_mbins = 700;
    RegisterSnapshot blocks;
    for (const BlockId id : {BlockId::ident, BlockId::status, BlockId::counters, BlockId::plc, BlockId::recipe,
                             BlockId::health, BlockId::calibration}) {
        const Block& block = *find_block(id);
        std::vector<std::uint16_t> image(block.size());
        encode(block, {identity, snapshot, snapshot.last, extras}, image);
        blocks.set(id, *decode(block, std::span(image).first(std::min<std::size_t>(image.size(), kMaxRead))));
    }
    return blocks;
}

inline RingResult seen(std::uint32_t sequence, const std::string& verdict = "pass") {
    RingResult result;
    result.boot = kBoot;
    result.sequence = sequence;
    result.part = sequence + 100;
    result.verdict = verdict;
    result.reason = verdict == "pass" ? "none" : "neighbours-disagree";
    result.reject = verdict == "pass" ? "not_needed" : "confirmed";
    result.score = 0.5;
    result.latency_us = 120'000;
    if (verdict != "pass") result.reject_latency_us = 400'000;
    return result;
}

}  // namespace hord::firmware::page::test
