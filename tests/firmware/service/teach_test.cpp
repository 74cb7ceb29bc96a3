// The whole service learns a reference from the running line and judges by it, also after a restart.
#include <algorithm>
#include <atomic>
#include <filesystem>
#include <fstream>
#include <map>
#include <thread>

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <unistd.h>

#include "firmware/recipes/recipe_file.h"
#include "firmware/registers/register_client.h"
#include "firmware/registers/register_map.h"
#include "firmware/service/service.h"

namespace hord::firmware {
namespace {

namespace fs = std::filesystem;
using ::testing::ElementsAre;

constexpr auto kPatience = std::chrono::seconds(200);
// Ten seconds of processor time, at the priority of the teach-in: long beside other work.
constexpr auto kReportPatience = std::chrono::seconds(600);

// The PLC, on a thread of its own; the service runs on the test's thread.
class Plc {
  public:
    explicit Plc(const std::string& address) {
        auto endpoint = modbus::parse_endpoint(address);
        auto client = modbus::Client::connect(*endpoint, std::chrono::seconds(20));
        EXPECT_TRUE(client) << client.error().message();
        client_.emplace(std::move(*client));
    }
    std::uint32_t read32(std::uint16_t address) {
        const auto words = client_->read(address, 2);
        EXPECT_TRUE(words) << words.error().message();
        return words ? std::uint32_t{(*words)[0]} << 16U | (*words)[1] : 0;
    }
    modbus::Client::Reply command(Command code, std::uint32_t argument = 0) {
        const auto reply = client_->command(code, argument, 0, kPatience);
        EXPECT_TRUE(reply) << reply.error().message();
        return reply ? *reply : modbus::Client::Reply{};
    }
    // Polls until the condition holds; false after `patience`. With pauses, because the line needs the processor.
    bool sees(const std::function<bool()>& what, std::chrono::seconds patience = kPatience) {
        const auto end = std::chrono::steady_clock::now() + patience;
        for (; !what(); std::this_thread::sleep_for(std::chrono::milliseconds(20))) {
            if (std::chrono::steady_clock::now() > end) return false;
        }
        return true;
    }
    bool is(State state) {
        return client_->read(102, 1).value_or(std::vector<std::uint16_t>(1)).at(0) == static_cast<std::uint16_t>(state);
    }

  private:
    std::optional<modbus::Client> client_;
};

bool passed(const PartResult& r) { return r.verdict == PartVerdict::pass; }
bool judged_bad(const PartResult& r) { return r.verdict != PartVerdict::pass && r.reason < PartReason::verdict_late; }

class TeachService : public ::testing::Test {
  protected:
    TeachService() {
        std::string name = fs::temp_directory_path() / "hord-teach-XXXXXX";
        folder = ::mkdtemp(name.data());
        fs::create_directories(folder / "state");
        // Without a reference it passes every part with light.
        std::ofstream(folder / "wide.toml") << "schema = 1\nname = \"wide\"\nnumber = 7\n[limits]\nemd_bins = "
                                               "30\nfrobenius_bins = 30\ntransmission = 0\n"
                                               "[reference]\nreject_score = 12\ncluster_score = 18\n";
        const auto wide = load_numbered_recipe(folder / "wide.toml");
        EXPECT_TRUE(wide) << wide.error().message();
        configured = crc32_of(*wide);
    }
    ~TeachService() override { fs::remove_all(folder); }

    struct Seen {
        std::string kind;
        PartResult result;
    };
    // One run of the service: `plc` runs on a thread of its own, then the service ends. On a slow machine the station
    // may stop with an error; it is reset then.
    void live(double good_share, const std::function<void(Plc&)>& plc) {
        Config config;
        // A slow line whose waits fill the time between two parts: a busy machine may hold it up for 200 ms. With the
        // default lead of 5 ms and ten parts a second, lateness stopped it again and again, and the inspection left the
        // learning thread no processor.
        const Duration pitch = milliseconds(250);
        config.core.exposure_delay = config.core.confirm_timeout = pitch;
        config.core.transport = 4 * pitch;
        config.core.trigger_lead = config.core.reject_pulse = pitch * 4 / 5;
        config.core.reject_lead = config.core.reject_early = pitch * 2 / 5;
        config.inspection.bins_i = config.inspection.bins_j = 5;
        config.inspection.recipe = folder / "wide.toml";
        config.modbus.port = 0;
        config.state_folder = folder / "state";
        config.store.free_mb = 1;
        config.optics.window_parts = 25;
        SimulationOptions simulation;
        simulation.good_share = good_share;
        simulation.variety = 16;
        simulation.parts_per_second = 4;  // one each pitch
        simulation.cache = std::string(HORD_BIN_DIR) + "/../service-cache";
        fs::create_directories(simulation.cache);
        std::map<std::int64_t, PartResult> results;
        std::map<std::int64_t, std::string> kinds;
        ServiceWatchers watchers;
        watchers.result = [&](const PartResult& r) {
            results[r.arrived_ns] = r;
            passes += r.verdict == PartVerdict::pass ? 1 : 0;
            rejects += judged_bad(r) ? 1 : 0;
        };
        watchers.trouble = [](const Error& error) { std::fprintf(stderr, "trouble: %s\n", error.message().c_str()); };
        watchers.fate = [&](const Backends::Fate& fate) { kinds[fate.arrived.time_since_epoch().count()] = fate.kind; };
        auto service = Service::open(config, std::move(*read_station_files(config)), simulation, watchers);
        ASSERT_TRUE(service) << service.error().message();
        std::atomic<bool> over{false};
        std::thread person([&] {
            Plc with((*service)->registers_address());
            EXPECT_TRUE(with.sees([&] {
                if (with.is(State::error)) (void)with.command(Command::reset);
                return over.load();
            }));
        });
        std::thread other([&] {
            Plc with((*service)->registers_address());
            plc(with);
            over = true;
            person.join();
            (*service)->stop();
        });
        EXPECT_TRUE((*service)->run());
        other.join();
        seen.clear();
        for (const auto& [arrived, result] : results) {
            if (kinds.contains(arrived)) seen.push_back({kinds[arrived], result});
        }
    }
    // Counts the good or bad parts of the last run with known fate for which `is` holds.
    template <class F>
    std::size_t count(bool good, F is) const {
        return static_cast<std::size_t>(std::count_if(
            seen.begin(), seen.end(), [&](const Seen& s) { return (s.kind == "good") == good && is(s.result); }));
    }
    std::vector<std::string> files() const {
        std::vector<std::string> names;
        for (const auto& entry : fs::recursive_directory_iterator(folder / "state")) {
            const std::string name = fs::relative(entry.path(), folder / "state");
            const bool elses =
                name.starts_with("store") || name == "line-empty";  // results; no part may be on the line at the end
            if (entry.is_regular_file() && !elses) names.push_back(name);
        }
        std::sort(names.begin(), names.end());
        return names;
    }

    fs::path folder;
    std::uint32_t configured = 0;
    std::vector<Seen> seen;
    std::atomic<int> passes{0}, rejects{0};
};

TEST_F(TeachService, learns_from_distinct_parts_judges_by_them_and_still_does_after_a_restart) {
    std::uint32_t taught = 0;
    live(1, [&](Plc& plc) {
        EXPECT_EQ(plc.read32(111), configured);
        modbus::Client::Reply reply;
        EXPECT_TRUE(plc.sees([&] {
            reply = plc.command(Command::teach, 24);
            return reply.error != CommandError::not_in_this_state;  // until the station can be started
        }));
        EXPECT_EQ(reply.state, CommandState::completed) << reply.error_name;
        taught = reply.result;
        EXPECT_NE(taught, configured);
        // Asked again: a stop is refused while a line stop of a busy machine waits for its reset, which starts the
        // line.
        EXPECT_TRUE(plc.sees([&] {
            (void)plc.command(Command::stop);
            return plc.read32(111) == taught;
        }));
        // Its report follows, the JSON last.
        EXPECT_TRUE(
            plc.sees([&] { return fs::exists(folder / "state/references/taught-7-1.learn.json"); }, kReportPatience));
    });
    const auto left = ElementsAre("recipe-in-use.crc32", "recipe-in-use.toml", "references/taught-7-1.hordref",
                                  "references/taught-7-1.learn.csv", "references/taught-7-1.learn.json",
                                  "references/taught-7-1.learn.md", "references/taught-7-1.learn.png", "station.lock");
    EXPECT_THAT(files(), left);

    passes = rejects = 0;
    live(0.5, [&](Plc& plc) {
        EXPECT_EQ(plc.read32(111), taught);
        EXPECT_TRUE(plc.sees([&] { return passes >= 5 && rejects >= 5; }));
        // After 25 parts HEALTH shows the ageing of light and optics: none, measured against the reference of the run
        // before.
        EXPECT_TRUE(plc.sees([&] { return plc.read32(8434) >> 16U != 0xFFFF; }));
        EXPECT_NEAR(plc.read32(8434) >> 16U, 1000, 50);  // light_output, tenths of a percent
        EXPECT_NE(plc.read32(8440), 0xFFFFFFFFU);        // dust; its value from repeated frames is not checked
    });
    // Parts rejected for lateness on a busy machine do not count.
    EXPECT_GE(count(true, passed), 4U);  // one may not have left the line before the end
    EXPECT_GE(count(false, judged_bad), 4U);
    EXPECT_EQ(count(true, judged_bad), 0U);
    EXPECT_EQ(count(false, passed), 0U);
    EXPECT_THAT(files(), left);
}

}  // namespace
}  // namespace hord::firmware
