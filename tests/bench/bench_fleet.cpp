// A fleet of stations on one mosquitto: messages a second, CPU time and memory of the broker and of a station.
// docs/fleet.md.
//
//     bench_fleet [STATIONS [SECONDS]]        200 stations, 20 s a line
//
// Each station is an edge node of hord-mqtt with its own connection; its results are generated, without a store. A few
// processes hold all stations. One consumer subscribes to everything with QoS 1 and counts. The last line adds one real
// hord-mqtt with a real store. Everything shares this machine.
#include <cerrno>
#include <chrono>
#include <csignal>
#include <cstdio>
#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <set>
#include <sstream>
#include <string>
#include <thread>
#include <vector>

#include <fmt/format.h>
#include <mosquitto.h>
#include <sys/prctl.h>
#include <sys/wait.h>
#include <unistd.h>

#include "firmware/mqtt/agent.h"
#include "firmware/store/results/sqlite_store.h"

namespace {

using namespace hord;
using namespace hord::firmware;
using Clock = std::chrono::steady_clock;
using std::chrono::milliseconds;
namespace fs = std::filesystem;

constexpr int kPort = 18'830, kProcesses = 4;

double seconds(Clock::duration d) { return std::chrono::duration<double>(d).count(); }
std::int64_t utc_us() {
    return std::chrono::duration_cast<std::chrono::microseconds>(std::chrono::system_clock::now().time_since_epoch())
        .count();
}

[[noreturn]] void give_up(const std::string& why) {
    fmt::print(stderr, "bench_fleet: {}\n", why);
    std::exit(2);
}

// CPU seconds and resident kilobytes of a process.
struct Use {
    double cpu_s = 0;
    long resident_kb = 0;
};
Use use_of(pid_t pid) {
    Use use;
    std::ifstream stat(fmt::format("/proc/{}/stat", pid));
    std::string text((std::istreambuf_iterator<char>(stat)), {});
    if (text.rfind(')') == std::string::npos) return use;
    std::istringstream words(text.substr(text.rfind(')') + 2));
    std::string word;
    std::vector<std::string> all;
    while (words >> word) all.push_back(word);
    use.cpu_s = (std::stod(all.at(11)) + std::stod(all.at(12))) / static_cast<double>(::sysconf(_SC_CLK_TCK));
    use.resident_kb = std::stol(all.at(21)) * ::sysconf(_SC_PAGESIZE) / 1024;
    return use;
}

// Generates results at a fixed rate, without a line: number k at `begin` + k / rate. If the rate is 0, `waiting`
// results exist from the start.
class CountedResults final : public mqtt::ResultSource {
  public:
    CountedResults(std::string id, double rate, std::int64_t waiting)
        : id_(std::move(id)), rate_(rate), waiting_(waiting) {}

    Result<Where> look() override { return Where{id_, newest()}; }
    Result<std::vector<store::StoredResult>> read(std::int64_t after, std::size_t count) override {
        std::vector<store::StoredResult> results;
        for (std::int64_t k = after + 1; k <= newest() && results.size() < count; ++k) {
            store::StoredResult r;
            r.number = k;
            r.time_us = rate_ > 0
                ? begin_us_ + static_cast<std::int64_t>(static_cast<double>(k - waiting_) / rate_ * 1e6)
                : begin_us_;
            r.boot = 7;
            r.sequence = r.part = static_cast<std::uint32_t>(k);
            const bool reject = k % 10 == 0;
            r.verdict = reject ? "reject" : "pass";
            r.reason = reject ? "neighbours-disagree" : "none";
            r.reject = reject ? "confirmed" : "not-needed";
            r.score = reject ? 1.7 : 0.4;
            r.defect_count = reject ? 1 : 0;
            r.defects = reject ? R"([{"m":12.25,"n":3.5,"area":9,"peak":1.7,"kind":"scratch"}])" : "[]";
            r.latency_us = 42'000;
            r.reject_latency_us = reject ? 400'000 : 0;
            r.recipe = "lens-40mm";
            results.push_back(std::move(r));
        }
        return results;
    }

  private:
    std::int64_t newest() const {
        return waiting_ + static_cast<std::int64_t>(static_cast<double>(utc_us() - begin_us_) * 1e-6 * rate_);
    }
    const std::string id_;
    const double rate_;
    const std::int64_t waiting_, begin_us_ = utc_us();
};

mqtt::MqttConfig options_of(int station, const fs::path& folder) {
    mqtt::MqttConfig options;
    options.broker.host = "127.0.0.1";
    options.broker.port = kPort;
    options.node.group = "fleet";
    options.node.node = fmt::format("cell-{:04}", station);
    options.node.begin_with_all = true;
    options.node.repeat = 0;
    options.node.history_per_s = 0;
    options.node.software = "bench";
    options.broker.client_id = options.node.node;
    options.state_file = folder / options.node.node;
    return options;
}

// Registers that change as in a running station: counters and latencies, every second.
std::vector<Reading> readings_now() {
    std::vector<Reading> readings;
    const double now = static_cast<double>(utc_us() / 1'000'000 % 1'000'000);
    for (const BlockId id : mqtt::published_blocks()) {
        for (const Register& row : find_block(id)->registers) {
            const bool changes = id == BlockId::counters
                ? row.name == "seen" || row.name == "inspected" || row.name == "pass"
                : row.name.starts_with("latency_");
            if (row.type == RegisterType::text) readings.push_back({&row, std::nullopt, "HORD station"});
            else readings.push_back({&row, changes ? now : 1, "1"});
        }
    }
    return readings;
}

[[noreturn]] void hold_stations(int from, int to, double rate, std::int64_t waiting, const fs::path& folder) {
    ::prctl(PR_SET_PDEATHSIG, SIGKILL);
    std::vector<std::unique_ptr<mqtt::Agent>> agents;
    for (int k = from; k < to; ++k) {
        auto results = std::make_unique<CountedResults>(fmt::format("{:032x}", k), rate, waiting);
        auto agent =
            mqtt::Agent::open(options_of(k, folder), std::move(results), readings_now, [](const std::string&) {});
        if (!agent) give_up(agent.error().message());
        agents.push_back(std::move(*agent));
    }
    while (true) {
        for (auto& agent : agents) agent->step(milliseconds(0));
        std::this_thread::sleep_for(milliseconds(rate > 0 ? 20 : 5));
    }
}

// Totals of the received messages.
struct Counted {
    std::uint64_t messages = 0, results = 0, bytes = 0, births = 0, birth_bytes = 0;
};

class Consumer {
  public:
    Consumer() : client_(mosquitto_new("consumer", true, this)) {
        mosquitto_int_option(client_, MOSQ_OPT_RECEIVE_MAXIMUM, 1000);
        mosquitto_message_callback_set(client_, [](mosquitto*, void* self, const mosquitto_message* m) {
            static_cast<Consumer*>(self)->take(*m);
        });
        if (mosquitto_connect(client_, "127.0.0.1", kPort, 60) != MOSQ_ERR_SUCCESS)
            give_up("the consumer cannot connect");
        mosquitto_subscribe(client_, nullptr, "spBv1.0/#", 1);
    }
    ~Consumer() { mosquitto_destroy(client_); }
    Consumer(const Consumer&) = delete;
    Consumer& operator=(const Consumer&) = delete;
    void serve(milliseconds wait) {
        if (mosquitto_loop(client_, static_cast<int>(wait.count()), 100) != MOSQ_ERR_SUCCESS)
            give_up("the consumer lost its connection");
    }
    Counted counted;

  private:
    void take(const mosquitto_message& m) {
        ++counted.messages;
        const std::string_view topic = m.topic;
        if (topic.find("/NBIRTH/") != std::string_view::npos) {
            ++counted.births;
            counted.birth_bytes = static_cast<std::uint64_t>(m.payloadlen);
        }
        // A result begins with its number: field 2, alias 20100.
        const auto* bytes = static_cast<const unsigned char*>(m.payload);
        if (m.payloadlen < 20 || bytes[7] != 0x12 || bytes[9] != 0x10 || bytes[10] != 0x84 || bytes[11] != 0x9D ||
            bytes[12] != 0x01)
            return;
        ++counted.results;
        counted.bytes +=
            static_cast<std::uint64_t>(m.payloadlen) + topic.size() + 9;  // header 5, topic length 2, message id 2
    }
    mosquitto* client_;
};

class Fleet {
  public:
    Fleet() {
        std::string name = fs::exists("/dev/shm") ? "/dev/shm/hord-fleet-XXXXXX" : "/tmp/hord-fleet-XXXXXX";
        if (::mkdtemp(name.data()) == nullptr) give_up("no folder");
        folder_ = name;
        std::ofstream(folder_ / "conf")
            << "listener " << kPort
            << " 127.0.0.1\nallow_anonymous true\nmax_queued_messages 0\nmax_inflight_messages 1000\n"
            << (::getuid() == 0 ? "user root\n" : "");
        broker_ = start({"/usr/sbin/mosquitto", "-c", (folder_ / "conf").string()}, "/dev/null");
        std::this_thread::sleep_for(milliseconds(500));
    }
    ~Fleet() {
        for (const pid_t pid : stations_) end(pid);
        end(broker_);
        fs::remove_all(folder_);
    }
    Fleet(const Fleet&) = delete;
    Fleet& operator=(const Fleet&) = delete;

    static pid_t start(const std::vector<std::string>& command, const std::string& log) {
        const pid_t pid = ::fork();
        if (pid == 0) {
            ::prctl(PR_SET_PDEATHSIG, SIGKILL);
            std::vector<char*> argv;
            for (const std::string& word : command) argv.push_back(const_cast<char*>(word.c_str()));
            argv.push_back(nullptr);
            if (std::freopen(log.c_str(), "w", stderr) == nullptr) std::_Exit(127);
            ::execv(argv[0], argv.data());
            std::_Exit(127);
        }
        return pid;
    }
    static void end(pid_t pid) {
        ::kill(pid, SIGKILL);
        int status = 0;
        ::waitpid(pid, &status, 0);
    }
    void launch(int stations, double rate, std::int64_t waiting) {
        for (int p = 0; p < kProcesses; ++p) {
            const int from = stations * p / kProcesses, to = stations * (p + 1) / kProcesses;
            const pid_t pid = ::fork();
            if (pid == 0) hold_stations(from, to, rate, waiting, folder_);
            stations_.push_back(pid);
        }
    }
    [[nodiscard]] double stations_cpu() const {
        double sum = 0;
        for (const pid_t pid : stations_) sum += use_of(pid).cpu_s;
        return sum;
    }
    [[nodiscard]] pid_t broker() const { return broker_; }
    [[nodiscard]] const fs::path& folder() const { return folder_; }

  private:
    fs::path folder_;
    pid_t broker_ = -1;
    std::vector<pid_t> stations_;
};

void steady(int stations, double rate, int duration_s) {
    Fleet fleet;
    Consumer consumer;
    const long empty_kb = use_of(fleet.broker()).resident_kb;
    fleet.launch(stations, rate, 0);
    const auto settle = Clock::now() + std::chrono::seconds(30);
    while (consumer.counted.births < static_cast<std::uint64_t>(stations) && Clock::now() < settle)
        consumer.serve(milliseconds(10));
    for (const auto until = Clock::now() + std::chrono::seconds(3); Clock::now() < until;)
        consumer.serve(milliseconds(10));
    const Counted before = consumer.counted;
    const double broker = use_of(fleet.broker()).cpu_s, station = fleet.stations_cpu(), own = use_of(::getpid()).cpu_s;
    const auto began = Clock::now();
    while (Clock::now() - began < std::chrono::seconds(duration_s)) consumer.serve(milliseconds(10));
    const double took = seconds(Clock::now() - began);
    const Counted& now = consumer.counted;
    const double results = static_cast<double>(now.results - before.results),
                 messages = static_cast<double>(now.messages - before.messages);
    const double broker_s = use_of(fleet.broker()).cpu_s - broker;
    fmt::print(
        "| {} | {:g} | {:.0f} | {:.0f} | {:.1f} % | {:.1f} us | {:.1f} MB | {:.0f} kB | {:.2f} % | {:.1f} % | {:.0f} "
        "|\n",
        stations, rate, results / took, messages / took, 100 * broker_s / took, 1e6 * broker_s / messages,
        static_cast<double>(use_of(fleet.broker()).resident_kb) / 1000,
        static_cast<double>(use_of(fleet.broker()).resident_kb - empty_kb) / stations,
        100 * (fleet.stations_cpu() - station) / took / stations, 100 * (use_of(::getpid()).cpu_s - own) / took,
        static_cast<double>(now.bytes - before.bytes) / results);
    std::fflush(stdout);
}

void flood(int stations, std::int64_t waiting) {
    Fleet fleet;
    Consumer consumer;
    fleet.launch(stations, 0, waiting);
    const std::uint64_t all = static_cast<std::uint64_t>(stations) * static_cast<std::uint64_t>(waiting);
    while (consumer.counted.results == 0) consumer.serve(milliseconds(10));
    const double broker = use_of(fleet.broker()).cpu_s, station = fleet.stations_cpu(), own = use_of(::getpid()).cpu_s;
    const auto began = Clock::now();
    while (consumer.counted.results < all) {
        consumer.serve(milliseconds(10));
        if (Clock::now() - began > std::chrono::minutes(5)) give_up("results are missing");
    }
    const double took = seconds(Clock::now() - began);
    const double count = static_cast<double>(all);
    fmt::print(
        "\n{} stations with {} results each that waited: {} results in {:.1f} s, {:.0f} a second; processor time a "
        "result: broker {:.1f} us, stations {:.1f} us, consumer {:.1f} us\n",
        stations, waiting, all, took, count / took, 1e6 * (use_of(fleet.broker()).cpu_s - broker) / count,
        1e6 * (fleet.stations_cpu() - station) / count, 1e6 * (use_of(::getpid()).cpu_s - own) / count);
    std::fflush(stdout);
}

// The real program over a real store that is written ten times a second, as a station does.
void real_program(const std::string& program, double rate, int duration_s) {
    Fleet fleet;
    Consumer consumer;
    fs::create_directories(fleet.folder() / "store");
    auto store = store::open_sqlite_store(fleet.folder() / "store");
    if (!store) give_up(store.error().message());
    std::uint32_t written = 0;
    const auto write = [&](int count) {
        std::vector<store::Entry> entries{{0, store::StartRecord{utc_us(), 7, "cell", "bench"}}};
        for (int k = 0; k < count; ++k) {
            store::ResultRecord record;
            record.result.sequence = record.result.part = ++written;
            record.result.verdict = PartVerdict::pass;
            record.result.latency_us = 42'000;
            record.time_us = utc_us();
            entries.push_back({written, record});
        }
        if (auto done = (*store)->write(entries); !done) give_up(done.error().message());
    };
    write(1);
    std::ofstream(fleet.folder() / "mqtt.toml") << "[broker]\nhost = \"127.0.0.1\"\nport = " << kPort
                                                << "\n[results]\nstore = \"store\"\nstate_file = \"cursor\"\nbegin = "
                                                   "\"all\"\n[station]\nmodbus = \"127.0.0.1:1\"\n";
    const pid_t node =
        Fleet::start({program, "--config", (fleet.folder() / "mqtt.toml").string()}, (fleet.folder() / "log").string());
    while (consumer.counted.results == 0) consumer.serve(milliseconds(10));
    const auto began = Clock::now();
    const double cpu = use_of(node).cpu_s;
    while (Clock::now() - began < std::chrono::seconds(duration_s)) {
        const int due = static_cast<int>(seconds(Clock::now() - began) * rate) + 1 - static_cast<int>(written);
        if (due > 0) write(due);
        consumer.serve(milliseconds(100));
    }
    const double took = seconds(Clock::now() - began);
    fmt::print(
        "\nhord-mqtt itself, {:g} results a second from a store: {:.2f} % of a core, {:.1f} MB resident; {} of {} "
        "results at the consumer; a birth has {} bytes\n",
        rate, 100 * (use_of(node).cpu_s - cpu) / took, static_cast<double>(use_of(node).resident_kb) / 1000,
        consumer.counted.results, written, consumer.counted.birth_bytes);
    Fleet::end(node);
}

}  // namespace

int main(int argc, char** argv) {
    mosquitto_lib_init();
    const int stations = argc > 1 ? std::atoi(argv[1]) : 200, duration_s = argc > 2 ? std::atoi(argv[2]) : 20;
    if (stations < 1 || duration_s < 1) give_up("usage: bench_fleet [STATIONS [SECONDS]]");
    const std::string program = (fs::read_symlink("/proc/self/exe").parent_path() / "hord-mqtt").string();
    fmt::print(
        "| stations | parts/s each | results/s | messages/s | broker | broker a message | broker memory | a station "
        "more | station (simulated) | consumer | bytes a result |\n|---|---|---|---|---|---|---|---|---|---|---|\n");
    for (const double rate : {0.1, 1.0, 5.0, 10.0}) steady(stations, rate, duration_s);
    steady(stations / 2, 10, duration_s);
    flood(stations, 500);
    if (fs::exists(program)) real_program(program, 10, duration_s);
    return 0;
}
