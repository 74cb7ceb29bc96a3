// hord-mqtt against a real mosquitto: brokers that restart, networks that fail, processes that are killed, and invalid
// commands. Every result arrives, and repeats are recognised by their number.
#include <csignal>
#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <random>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "firmware/store/results/sqlite_store.h"
#include "tests/firmware/store/results/samples.h"
#include "tests/system/broker/world.h"

namespace hord::test {
namespace {

namespace fs = std::filesystem;
using firmware::store::open_sqlite_store;
using firmware::store::test::result;
using firmware::store::test::start;
using ::testing::HasSubstr;
using ::testing::SizeIs;

constexpr std::uint64_t kBoot = 20'103, kVerdict = 20'106;

// A station's store, written as a station writes it.
class WrittenStore {
  public:
    explicit WrittenStore(const std::string& folder) {
        fs::create_directories(folder);
        auto opened = open_sqlite_store(folder);
        if (!opened) throw std::runtime_error(opened.error().message());
        store_ = std::move(*opened);
    }
    void add(std::uint32_t count) {
        std::vector<firmware::store::Entry> entries{{0, start()}};
        for (std::uint32_t k = 0; k < count; ++k) {
            ++written_;
            entries.push_back(
                {written_,
                 result(written_, written_ % 10 == 0 ? firmware::PartVerdict::reject : firmware::PartVerdict::pass)});
        }
        const auto done = store_->write(entries);
        ASSERT_TRUE(done) << done.error().message();
    }
    [[nodiscard]] std::uint32_t written() const { return written_; }

  private:
    std::unique_ptr<firmware::store::ResultStore> store_;
    std::uint32_t written_ = 0;
};

class Mqtt : public ::testing::Test {
  protected:
    void SetUp() override {
        if (const std::string missing = missing_tools(); !missing.empty()) GTEST_SKIP() << missing;
    }
    // `modbus` 1: a port without a listener.
    void write_config(int broker_port, const std::string& results = "begin = \"all\"\n",
                      const std::string& sparkplug = "", const std::string& broker = "", int modbus = 1) {
        std::ofstream(folder / "mqtt.toml")
            << "[broker]\nhost = \"127.0.0.1\"\nport = " << broker_port << "\nkeepalive_s = 5\n"
            << broker << "[sparkplug]\ngroup = \"g\"\nnode = \"n\"\n"
            << sparkplug << "[results]\nstore = \"store\"\nstate_file = \"cursor\"\n"
            << results << "[station]\nmodbus = \"127.0.0.1:" << modbus << "\"\nevery_ms = 200\n";
    }
    std::unique_ptr<Running> node() {
        return std::make_unique<Running>("hord-mqtt", std::vector<std::string>{"--config", folder / "mqtt.toml"});
    }
    static void publish(int port, const std::string& topic, const std::string& payload,
                        const std::vector<std::string>& more = {}) {
        std::vector<std::string> arguments{"-h", "127.0.0.1", "-p",   std::to_string(port), "-t", topic, "-q",
                                           "1",  "-m",        payload};
        arguments.insert(arguments.end(), more.begin(), more.end());
        const Said said = run("/usr/bin/mosquitto_pub", arguments);
        EXPECT_EQ(said.status, 0) << said.err;
    }
    TemporaryFolder folder;
};

// First: each number up to `last` came at least once. Second: the number of repeats.
std::pair<std::uint32_t, int> arrived(Consumer& consumer) {
    std::uint32_t whole = 0;
    int repeats = 0;
    for (const auto& [number, times] : consumer.results()) {
        if (number == whole + 1) ++whole;
        repeats += times - 1;
    }
    return {whole, repeats};
}

std::string rebirth() { return std::string("\x12\x1A\x0A\x14Node Control/Rebirth\x20\x0B\x70\x01", 28); }

// One test from birth to death: starting a broker and a line for each step would take minutes.
TEST_F(Mqtt, station_is_born_told_asked_again_and_dies_while_its_line_goes_on) {
    Broker broker(folder.path().string());
    Consumer consumer(folder.path().string(), broker.port());
    const int modbus = free_port();
    // Small parts, far apart, all passed, with long times for a busy machine: this test is not about the line.
    std::ofstream(folder / "lenient.toml")
        << "schema = 1\nname = \"lenient\"\nnumber = 9\nversion = 1\n[limits]\nemd_bins = 10.0\nfrobenius_bins = "
           "10.0\ntransmission = 0.01\n";
    std::ofstream(folder / "station.toml")
        << "[station]\nmax_failures_in_a_row = 0\n[inspection]\nmacro = \"3x3\"\nrecipe = \"lenient.toml\"\n"
           "[line]\nexposure_delay_ms = 250\ntransport_ms = 1500\nmin_gap_ms = 220\n"
           "[timing]\ntrigger_lead_ms = 200\nframe_timeout_ms = 500\nstrobe_window_us = 50000\nframe_window_us = "
           "40000\n[rejector]\nearly_ms = 100\npulse_ms = 200\nconfirm_timeout_ms = 10000\nresponse_timeout_ms = "
           "1000\n[store]\nframes_mb = 0\n";
    // The station runs in real time; on a busy machine its line can stop before the test has begun. Then it is
    // started again.
    std::unique_ptr<Running> running;
    for (int attempt = 0; attempt < 10 && !running; ++attempt) {
        fs::remove_all(folder / "store");
        auto next = std::make_unique<Running>(
            "hordctl",
            std::vector<std::string>{"run", "--simulate", "--config", folder / "station.toml", "--rate", "4", "--good",
                                     "1", "--variety", "1", "--modbus", "127.0.0.1:" + std::to_string(modbus), "--json",
                                     "--store", folder / "store"});
        ASSERT_TRUE(next->says("to ContinuousExecution", std::chrono::seconds(120))) << next->so_far().err;
        if (next->says("\"part\":3,", std::chrono::seconds(20))) running = std::move(next);
    }
    ASSERT_TRUE(running);
    Running& station = *running;
    write_config(broker.port(), "begin = \"all\"\nrepeat = 0\n", "", "", modbus);
    auto mqtt = node();
    ASSERT_TRUE(wait_until([&] { return !consumer.results().empty(); })) << mqtt->so_far().err;

    const auto births = consumer.of("NBIRTH");
    ASSERT_THAT(births, SizeIs(1));
    const ReadMessage& birth = births[0];
    EXPECT_EQ(birth.seq, 0U);
    EXPECT_EQ(birth.topic, "spBv1.0/g/NBIRTH/n");
    ASSERT_NE(birth.find("bdSeq"), nullptr);
    EXPECT_EQ(birth.find("bdSeq")->whole, 0U);
    EXPECT_EQ(birth.find("Node Control/Rebirth")->alias, 0U);
    EXPECT_TRUE(birth.find("Station/Online")->truth);
    EXPECT_EQ(birth.find("Station/STATUS/state")->whole, 8U);  // ContinuousExecution
    EXPECT_EQ(birth.find("Station/IDENT/product")->type, 12U);
    std::map<std::uint64_t, std::string> names;
    for (const ReadMetric& metric : birth.metrics) names[metric.alias] = metric.name;
    std::uint64_t seq = 0;
    for (const ReadMessage& data : consumer.of("NDATA")) {
        EXPECT_EQ(data.seq, ++seq % 256);
        for (const ReadMetric& metric : data.metrics) EXPECT_FALSE(names[metric.alias].empty()) << metric.alias;
        if (const ReadMetric* verdict = data.find(kVerdict)) {
            EXPECT_THAT(verdict->text, ::testing::AnyOf("pass", "reject", "unfit"));
        }
    }
    if (std::system("command -v protoc >/dev/null") == 0) {
        std::ofstream(folder / "birth", std::ios::binary) << birth.payload;
        const Said said =
            run("/bin/sh",
                {"-c",
                 "protoc --decode=hord.sparkplug.Payload -I" HORD_SOURCE_DIR "/firmware/mqtt sparkplug_b.proto <" +
                     (folder / "birth")});
        EXPECT_EQ(said.status, 0) << said.err;
        EXPECT_THAT(said.out, HasSubstr("name: \"Node Control/Rebirth\""));
        EXPECT_THAT(said.out, HasSubstr("name: \"Result/Number\"\n  alias: 20100\n"));
        EXPECT_EQ(said.out.find("\n  16:"), std::string::npos);
    }

    // A rebirth request: the same bdSeq, seq 0 again.
    publish(broker.port(), "spBv1.0/g/NCMD/n", rebirth());
    ASSERT_TRUE(wait_until([&] { return consumer.of("NBIRTH").size() == 2; }));
    EXPECT_EQ(consumer.of("NBIRTH")[1].seq, 0U);
    EXPECT_EQ(consumer.of("NBIRTH")[1].find("bdSeq")->whole, 0U);

    // Invalid commands are counted, reported, and have no effect.
    const std::vector<std::string> hostile{"garbage", "", std::string(8000, 'x'), "\x12\x06\x10\x66\x58\x03\x20\x08",
                                           std::string("\x12\x1A\x0A\x14Node Control/REBIRTH\x20\x0B\x70\x01", 28)};
    for (const std::string& bytes : hostile) publish(broker.port(), "spBv1.0/g/NCMD/n", bytes);
    const auto refused = [&] {
        std::uint64_t count = 0;
        for (const ReadMessage& data : consumer.of("NDATA")) {
            if (const ReadMetric* told = data.find(20'001)) count = told->whole;
        }
        return count;
    };
    EXPECT_TRUE(wait_until([&] { return refused() == hostile.size(); })) << refused();
    EXPECT_THAT(consumer.of("NBIRTH"), SizeIs(2));

    // Killed: the broker publishes the death, with the bdSeq of the birth. The line is not affected.
    mqtt->stop(SIGKILL);
    ASSERT_TRUE(wait_until([&] { return consumer.of("NDEATH").size() == 1; }));
    const ReadMessage death = consumer.of("NDEATH")[0];
    EXPECT_FALSE(death.seq);
    ASSERT_THAT(death.metrics, SizeIs(1));
    EXPECT_EQ(death.metrics[0].whole, 0U);
    const auto parts = [&] {
        std::size_t count = 0;
        const std::string& out = station.so_far().out;
        for (std::size_t at = out.find("\"part\":"); at != std::string::npos; at = out.find("\"part\":", at + 1))
            ++count;
        return count;
    };
    const std::size_t before = parts();
    EXPECT_TRUE(station.says("\"part\":" + std::to_string(before + 5) + ",", std::chrono::seconds(120)));

    // Restarted: another bdSeq, and all results of the time between.
    mqtt = node();
    ASSERT_TRUE(wait_until([&] { return consumer.of("NBIRTH").size() == 3; }));
    EXPECT_EQ(consumer.of("NBIRTH")[2].find("bdSeq")->whole, 1U);
    EXPECT_TRUE(wait_until([&] { return arrived(consumer).first >= before + 5; }));
    const Said said = mqtt->stop(SIGTERM);
    EXPECT_EQ(said.status, 0) << said.err;
    ASSERT_TRUE(wait_until([&] { return consumer.of("NDEATH").size() == 2; }));
    EXPECT_EQ(consumer.of("NDEATH")[1].metrics[0].whole, 1U);
    station.stop(SIGINT);
    EXPECT_EQ(run("hordctl", {"results", "verify", "--store", folder / "store"}).status, 0);
}

TEST_F(Mqtt, every_result_arrives_over_broken_networks_restarted_brokers_and_killed_processes) {
    Broker broker(folder.path().string());
    Consumer consumer(folder.path().string(), broker.port());
    Network network(broker.port());
    WrittenStore store(folder / "store");
    write_config(network.port(), "begin = \"all\"\nrepeat = 20\nhistory_per_s = 0\n");
    auto mqtt = node();
    const unsigned seed = 20'261'121;
    std::mt19937 random(seed);  // the same parts in every run; the times of the failures depend on the machine
    for (int round = 0; round < 16; ++round) {
        store.add(static_cast<std::uint32_t>(40 + random() % 100));
        // Messages are in flight when the failure comes.
        ASSERT_TRUE(wait_until([&] { return arrived(consumer).first + 200 > store.written(); }))
            << "round " << round << ": " << mqtt->so_far().err;
        switch (round % 4) {
            case 0: network.cut(); break;
            case 1:
                mqtt->stop(SIGKILL);
                mqtt = node();
                break;
            case 2:
                broker.stop(SIGTERM);
                store.add(30);
                broker.start();
                break;
            default:
                network.refuse(true);
                network.cut();
                store.add(50);
                network.refuse(false);
        }
    }
    EXPECT_TRUE(wait_until([&] { return arrived(consumer).first == store.written(); }))
        << arrived(consumer).first << " of " << store.written() << "\n"
        << mqtt->so_far().err;
    const Said said = mqtt->stop(SIGTERM);
    EXPECT_EQ(said.status, 0);
    EXPECT_THAT(
        said.err,
        HasSubstr(" of " + std::to_string(store.written())));  // the broker's last confirmations may not have arrived
    const auto numbers = consumer.results();
    EXPECT_EQ(numbers.size(), store.written());  // no unknown number arrived
    EXPECT_EQ(numbers.rbegin()->first, store.written());
    // A repeat has the same content.
    std::map<std::uint64_t, std::string> said_before;
    for (const ReadMessage& data : consumer.of("NDATA")) {
        if (data.find(20'100) == nullptr) continue;
        std::string content;
        for (const ReadMetric& metric : data.metrics)
            content += std::to_string(metric.time) + " " + std::to_string(metric.whole) + " " + metric.text + ";";
        const auto [at, is_new] = said_before.emplace(data.find(20'100)->whole, content);
        EXPECT_EQ(at->second, content);
    }
    RecordProperty("results", static_cast<int>(store.written()));
    RecordProperty("repeats", arrived(consumer).second);
}

TEST_F(Mqtt, results_wait_for_the_primary_host_and_come_as_history) {
    Broker broker(folder.path().string());
    WrittenStore store(folder / "store");
    store.add(5);
    publish(broker.port(), "spBv1.0/STATE/scada", R"({"online":false,"timestamp":1000})", {"-r"});
    Consumer consumer(folder.path().string(), broker.port());
    write_config(broker.port(), "begin = \"all\"\nrepeat = 0\n", "primary_host = \"scada\"\n");
    auto mqtt = node();
    ASSERT_TRUE(mqtt->says("waiting for the primary host scada", std::chrono::seconds(120))) << mqtt->so_far().err;
    EXPECT_TRUE(consumer.of("NBIRTH").empty());
    publish(broker.port(), "spBv1.0/STATE/scada", R"({"online":true,"timestamp":2000})", {"-r"});
    ASSERT_TRUE(wait_until([&] { return arrived(consumer).first == 5; }));
    for (const ReadMessage& data : consumer.of("NDATA")) {
        if (data.find(20'100) == nullptr) continue;
        for (const ReadMetric& metric : data.metrics) EXPECT_TRUE(metric.historical);
        EXPECT_EQ(data.find(20'100)->time,
                  static_cast<std::uint64_t>(firmware::store::test::kNoon / 1000) + data.find(20'100)->whole * 100);
        EXPECT_EQ(data.find(kBoot)->whole, 7U);
    }
    publish(broker.port(), "spBv1.0/STATE/scada", R"({"online":false,"timestamp":2000})", {"-r"});
    ASSERT_TRUE(wait_until([&] { return consumer.of("NDEATH").size() == 1; }));
    store.add(5);
    ASSERT_TRUE(mqtt->says("the primary host is gone", std::chrono::seconds(120)));
    EXPECT_EQ(arrived(consumer).first, 5U);
    publish(broker.port(), "spBv1.0/STATE/scada", R"({"online":true,"timestamp":3000})", {"-r"});
    EXPECT_TRUE(wait_until([&] { return arrived(consumer).first == 10; }));
    EXPECT_EQ(arrived(consumer).second, 0);
}

// Without a subscriber MQTT 5 returns a reason code; results stay in the store until there is one.
TEST_F(Mqtt, results_wait_until_somebody_listens) {
    Broker broker(folder.path().string());
    WrittenStore store(folder / "store");
    store.add(30);
    write_config(broker.port());
    auto mqtt = node();
    ASSERT_TRUE(mqtt->says("nobody who reads results", std::chrono::seconds(120))) << mqtt->so_far().err;
    Consumer consumer(folder.path().string(), broker.port());
    EXPECT_TRUE(wait_until([&] { return arrived(consumer).first == 30; })) << arrived(consumer).first;
}

TEST_F(Mqtt, speaks_3_1_1_and_qos_0_where_it_is_told_to) {
    Broker broker(folder.path().string());
    Consumer consumer(folder.path().string(), broker.port());
    WrittenStore store(folder / "store");
    store.add(700);
    write_config(broker.port(), "begin = \"all\"\nqos = 0\nhistory_per_s = 0\n", "", "protocol = \"3.1.1\"\n");
    auto mqtt = node();
    EXPECT_TRUE(wait_until([&] { return arrived(consumer).first == 700; })) << arrived(consumer).first;
    for (const ReadMessage& data : consumer.of("NDATA")) EXPECT_EQ(data.qos, 0);
    EXPECT_THAT(mqtt->stop(SIGTERM).err, HasSubstr("up to 700 of 700"));
}

// A long time without a broker: results wait on the disk, not in memory.
TEST_F(Mqtt, needs_no_more_memory_for_a_long_outage) {
    Broker broker(folder.path().string());
    broker.stop(SIGTERM);
    WrittenStore store(folder / "store");
    store.add(20'000);
    write_config(broker.port(), "begin = \"all\"\nhistory_per_s = 0\nrepeat = 0\n");
    const auto mqtt = node();
    ASSERT_TRUE(mqtt->says("cannot be reached", std::chrono::seconds(120))) << mqtt->so_far().err;
    const auto largest_kb = [&] {
        std::ifstream in("/proc/" + std::to_string(mqtt->pid()) + "/status");
        for (std::string line; std::getline(in, line);) {
            if (line.starts_with("VmHWM:")) return std::stol(line.substr(6));
        }
        return 0L;
    };
    const long before = largest_kb();
    ASSERT_GT(before, 0);
    broker.start();
    Consumer consumer(folder.path().string(), broker.port());
    ASSERT_TRUE(wait_until([&] { return fs::file_size(folder / "messages") > 20'000U * 300U; }))
        << fs::file_size(folder / "messages");
    EXPECT_LT(largest_kb() - before, 8'000);
    // Results and the node's own metrics are mixed; their order is kept.
    std::optional<std::uint64_t> seq;
    for (const ReadMessage& message : consumer.all()) {
        if (message.topic.ends_with("/NBIRTH/n")) seq = 0;
        else if (message.topic.ends_with("/NDATA/n") && seq) {
            seq = (*seq + 1) % 256;
            ASSERT_EQ(message.seq, seq);
        }
    }
    EXPECT_TRUE(seq);
}

TEST_F(Mqtt, uses_its_certificate_and_password_and_says_which_of_them_is_wrong) {
    // A certificate authority (CA) with certificates for broker and station, and another CA.
    const std::string script =
        "set -e; cd \"$1\"\n"
        "for ca in ca other; do openssl req -x509 -newkey ec -pkeyopt ec_paramgen_curve:prime256v1 -nodes -keyout "
        "$ca.key -out $ca.pem -subj /CN=$ca -days 2; done\n"
        "for who in broker station; do\n"
        "  openssl req -newkey ec -pkeyopt ec_paramgen_curve:prime256v1 -nodes -keyout $who.key -out $who.csr -subj "
        "/CN=$who\n"
        "  echo subjectAltName=IP:127.0.0.1 >ext; openssl x509 -req -in $who.csr -CA ca.pem -CAkey ca.key "
        "-CAcreateserial -out $who.pem -days 2 -extfile ext\n"
        "done\n"
        "mosquitto_passwd -c -b passwords cell-3 secret; printf 'secret\\n' >password; chmod 600 password; chmod 644 "
        "passwords\n";
    const Said made = run("/bin/sh", {"-c", script, "sh", folder.path().string()});
    ASSERT_EQ(made.status, 0) << made.err;
    Broker broker(folder.path().string(), "allow_anonymous false\npassword_file " + (folder / "passwords") + "\n",
                  true);
    const std::vector<std::string> tls{"--cafile", folder / "ca.pem",
                                       "--cert",   folder / "station.pem",
                                       "--key",    folder / "station.key",
                                       "-u",       "cell-3",
                                       "-P",       "secret"};
    Consumer consumer(folder.path().string(), broker.port(), tls);
    WrittenStore store(folder / "store");
    store.add(3);
    const std::string login = "user = \"cell-3\"\npassword_file = \"password\"\n";
    const auto with = [&](const std::string& ca, const std::string& certificate, const std::string& user) {
        const std::string own =
            certificate.empty() ? "" : "certificate = \"" + certificate + ".pem\"\nkey = \"" + certificate + ".key\"\n";
        write_config(broker.port(), "begin = \"all\"\n", "",
                     user + (ca.empty() ? "" : "[tls]\nca = \"" + ca + ".pem\"\n" + own));
        return node();
    };
    const auto complains = [&](std::unique_ptr<Running> mqtt, const std::string& text) {
        EXPECT_TRUE(mqtt->says(text, std::chrono::seconds(120))) << mqtt->so_far().err;
        EXPECT_EQ(mqtt->so_far().err.find("secret"), std::string::npos);
    };
    complains(with("other", "station", login), "check [tls]");  // the wrong CA
    complains(with("ca", "", login),
              "hord-mqtt: broker 127.0.0.1:" + std::to_string(broker.port()));  // without a client certificate
    complains(with("nowhere", "station", login), "the certificate authority");
    complains(with("ca", "station", ""), "refuses the login of nobody");
    std::ofstream(folder / "password") << "wrong\n";
    complains(with("ca", "station", login), "refuses the login of \"cell-3\"");
    std::ofstream(folder / "password") << "secret\n";
    EXPECT_TRUE(consumer.all().empty());
    const auto mqtt = with("ca", "station", login);
    EXPECT_TRUE(wait_until([&] { return arrived(consumer).first == 3; })) << mqtt->so_far().err;
}

// This broker ends the connection of the one that was there, without a word.
TEST_F(Mqtt, says_that_another_client_has_its_name_and_leaves_it_the_place_for_a_while) {
    Broker broker(folder.path().string());
    write_config(broker.port());
    const auto one = node();
    ASSERT_TRUE(one->says("connected with", std::chrono::seconds(120))) << one->so_far().err;
    const Said twice = run("hord-mqtt", {"--config", folder / "mqtt.toml"});
    EXPECT_EQ(twice.status, 2);
    EXPECT_THAT(twice.err, HasSubstr("cursor is in use by another hord-mqtt"));
    {
        std::string text;
        std::getline(std::ifstream(folder / "mqtt.toml"), text, '\0');
        std::ofstream(folder / "other.toml") << text.replace(text.find("\"cursor\""), 8, "\"other\"");
    }
    Running two("hord-mqtt", {"--config", folder / "other.toml"});
    const std::string reason = "another client that calls itself \"hord-g-n\" probably takes its place";
    const auto both = [&] { return one->so_far().err + two.so_far().err; };
    const auto sessions = [&] {
        int found = 0;
        const std::string text = both(), what = "connected with";
        for (auto at = text.find(what); at != std::string::npos; at = text.find(what, at + 1)) ++found;
        return found;
    };
    constexpr std::chrono::seconds kMoment(1), kWhile(5);
    ASSERT_TRUE(wait_until([&] { return one->says(reason, kMoment) || two.says(reason, kMoment); })) << both();
    const int before = sessions();
    // The one that was displaced stays away for 15 s; what says() waits for is never said.
    (void)(one->says("\n\n", kWhile) || two.says("\n\n", kWhile));
    EXPECT_LE(sessions(), before + 4) << both();
}

TEST_F(Mqtt, says_what_it_cannot_use_and_ends) {
    write_config(free_port());
    std::ofstream(folder / "cursor") << "garbage\n";
    const Said damaged = run("hord-mqtt", {"--config", folder / "mqtt.toml"});
    EXPECT_EQ(damaged.status, 2);
    EXPECT_THAT(damaged.err, HasSubstr("cursor is damaged"));
    std::ofstream(folder / "mqtt.toml") << "[broker]\nport = \"x\"\nhosts = 1\n";
    const Said wrong = run("hord-mqtt", {"--config", folder / "mqtt.toml"});
    EXPECT_EQ(wrong.status, 78);
    EXPECT_THAT(wrong.err, HasSubstr("mqtt.toml:2"));
    EXPECT_THAT(wrong.err, HasSubstr("mqtt.toml:3"));
    EXPECT_EQ(run("hord-mqtt", {"--config", folder / "nowhere.toml"}).status, 78);
    EXPECT_EQ(run("hord-mqtt", {"--check", "--config", std::string(HORD_SOURCE_DIR) + "/deploy/mqtt.toml"}).status, 0);
}

}  // namespace
}  // namespace hord::test
