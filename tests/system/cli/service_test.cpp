// hordd as systemd meets it, without a booted systemd: sockets, reload, the PLC, files, journal, sandbox. Readiness and
// watchdog: manager_test.cpp.
#include <algorithm>
#include <chrono>
#include <csignal>
#include <filesystem>
#include <fstream>
#include <map>
#include <optional>
#include <regex>
#include <set>
#include <span>
#include <sstream>
#include <stop_token>
#include <thread>

#include <arpa/inet.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <netinet/in.h>
#include <sched.h>
#include <sys/socket.h>
#include <unistd.h>

#include "firmware/core/station_types.h"
#include "firmware/registers/register_client.h"
#include "tests/system/cli/notify_socket.h"
#include "tests/system/cli/program.h"
#include "tests/system/cli/service_fixture.h"

namespace hord::test {
namespace {

using ::testing::HasSubstr;
using ::testing::Not;

const std::filesystem::path kDeploy = std::filesystem::path(HORD_SOURCE_DIR) / "deploy";
const std::string kHordSafe = std::string(HORD_BIN_DIR) + "/hord-safe";

std::string text_of(const std::filesystem::path& file) {
    std::ifstream in(file);
    std::stringstream text;
    text << in.rdbuf();
    return text.str();
}

TEST_F(Service, reads_its_configuration_again_without_stopping) {
    write_config();
    NotifySocket manager(folder / "notify");
    Running service("/usr/bin/env", under({"NOTIFY_SOCKET=" + (folder / "notify")}));
    ASSERT_TRUE(service.says("registers at", kPatience)) << service.so_far().err;
    auto plc = client_at(port_of(service.so_far()));
    ASSERT_TRUE(plc) << plc.error().message();
    const std::uint16_t beat[] = {1};
    EXPECT_TRUE(plc->write(8102, beat));

    write_config("[plc]\ntimeout_ms = 5000\n[strobe]\nmin_rest_ms = 6\n", "port = 0\nmay_write = []\n");
    service.signal(SIGHUP);
    EXPECT_NE(manager.hears("RELOADING=1"), "");
    ASSERT_TRUE(service.says("configuration read again", kPatience));
    EXPECT_THAT(service.so_far().err, HasSubstr("[strobe]"));  // reports that [strobe] changes at the next restart
    EXPECT_NE(manager.hears("READY=1"), "");
    EXPECT_FALSE(plc->write(8102, beat));  // on the open connection
    EXPECT_EQ(plc->read(8106, 1)->at(0), 5000);

    write_config("", "prot = 0\n");
    service.signal(SIGHUP);
    ASSERT_TRUE(service.says("the old configuration stays", kPatience));
    EXPECT_THAT(service.so_far().err, HasSubstr("c.toml:6"));
    EXPECT_TRUE(plc->read(8106, 1));

    std::filesystem::resize_file(folder / "c.toml", std::uintmax_t{1} << 31);  // sparse; to read it takes seconds
    service.signal(SIGHUP);
    ASSERT_TRUE(service.says("larger than such a file can be", kPatience));
    EXPECT_TRUE(plc->read(8106, 1));
    EXPECT_EQ(service.stop(SIGTERM).status, 0);
}

// A PLC that sends its heartbeat on its own connection, until it is destroyed.
class BeatingPlc {
  public:
    explicit BeatingPlc(firmware::modbus::Client client)
        : client_(std::move(client)), beats_([this](const std::stop_token& over) {
              for (std::uint16_t beat = 1; !over.stop_requested(); ++beat) {
                  (void)client_.write(8102, std::span(&beat, 1));
                  std::this_thread::sleep_for(std::chrono::milliseconds(50));
              }
          }) {}

  private:
    firmware::modbus::Client client_;
    std::jthread beats_;
};

// All times of this line are long, so that the speed of the machine does not matter. The recipe passes every lit part.
// One long test, because the service is started only once.
TEST_F(Service, rejects_every_part_while_the_plc_is_silent_and_inspects_again_when_it_is_back) {
    std::ofstream(folder / "wide.toml")
        << "schema = 1\nname = \"wide\"\nnumber = 7\n[limits]\nemd_bins = 30\nfrobenius_bins = 30\ntransmission = 0\n";
    std::ofstream(folder / "c.toml")
        << "[station]\nmax_failures_in_a_row = 0\n[line]\nexposure_delay_ms = 400\ntransport_ms = 3000\nmin_gap_ms = "
           "450\n"
           "[timing]\nstrobe_window_us = 150000\nframe_window_us = 200000\nframe_timeout_ms = 1500\ntrigger_lead_ms = "
           "300\n"
           "[rejector]\nearly_ms = 400\npulse_ms = 440\nconfirm_timeout_ms = 10000\n[modbus]\nport = 0\n"
           "[inspection]\nmacro = \"3x3\"\nrecipe = \"wide.toml\"\n[plc]\npolicy = \"reject_all\"\ntimeout_ms = 2000\n";
    Running service("hordctl",
                    {"run", "--simulate", "--config", folder / "c.toml", "--rate", "2", "--variety", "1", "--state",
                     folder / "made/state"});
    ASSERT_TRUE(service.says("registers at", kPatience)) << service.so_far().err << service.so_far().out;
    const std::string port = port_of(service.so_far());
    auto scada = client_at(port);  // reads and commands; the heartbeat comes from the PLC
    ASSERT_TRUE(scada) << scada.error().message();
    const auto two = [&](std::uint16_t address) {
        const auto words = scada->read(address, 2);
        return words ? std::uint32_t{words->at(0)} << 16U | words->at(1) : 0;
    };
    const auto comes = [](const auto& what) {
        for (const auto until = std::chrono::steady_clock::now() + kPatience;
             std::chrono::steady_clock::now() < until;) {
            if (what()) return true;
            std::this_thread::sleep_for(std::chrono::milliseconds(20));
        }
        return false;
    };
    const auto missed = [&] { return (scada->read(103, 1).value_or(std::vector<std::uint16_t>{0})[0] & 0x80U) != 0; };
    const auto parts_seen = [&] { return two(142); };
    struct Newest {
        std::uint32_t part = 0;
        std::uint16_t verdict = 0;
    };
    const auto newest = [&]() -> Newest {  // result, read in one request
        const auto last = scada->read(202, 24);
        if (!last) return {};
        return {std::uint32_t{last->at(2)} << 16U | last->at(3), last->at(8)};
    };
    const auto passes_after = [&](std::uint32_t part) {
        return comes([&] {
            const Newest now = newest();
            return now.part > part && now.verdict == 1;
        });
    };

    auto connection = client_at(port);
    ASSERT_TRUE(connection) << connection.error().message();
    std::optional<BeatingPlc> plc(std::in_place, std::move(*connection));
    ASSERT_TRUE(passes_after(0)) << "with the PLC there, parts are inspected";

    plc.reset();
    ASSERT_TRUE(comes(missed));
    const std::uint32_t when_lost = parts_seen();
    ASSERT_TRUE(comes([&] { return newest().part > when_lost + 5; }));
    for (std::uint32_t sequence = two(106); sequence > 0; --sequence) {
        const auto result = scada->read_result(sequence);
        ASSERT_TRUE(result) << result.error().message();
        const auto said = [&](std::string_view name) {
            for (const auto& row : *result) {
                if (row.what->name == name) return row.text;
            }
            return std::string("?");
        };
        if (std::stoul(said("part")) <= when_lost) break;
        EXPECT_THAT(said("verdict"), HasSubstr("unfit"));
        EXPECT_THAT(said("reason"), HasSubstr("plc-lost"));
        EXPECT_THAT(said("flags"), HasSubstr("rejected"));
    }
    EXPECT_EQ(two(113) & firmware::kFaultPlc, firmware::kFaultPlc);
    EXPECT_EQ(scada->read(102, 1)->at(0), static_cast<std::uint16_t>(firmware::State::continuous_execution));
    EXPECT_THAT(run("hordctl", {"status", "--modbus", "127.0.0.1:" + port}).out, HasSubstr("plc-lost"));
    EXPECT_TRUE(service.says("the PLC's heartbeat has stopped", kPatience)) << service.so_far().err;

    auto again = client_at(port);
    ASSERT_TRUE(again) << again.error().message();
    plc.emplace(std::move(*again));
    ASSERT_TRUE(comes([&] { return !missed(); }));
    EXPECT_TRUE(passes_after(parts_seen()));
    EXPECT_EQ(two(115) & firmware::kFaultPlc, firmware::kFaultPlc);  // latched until a reset
    for (const auto command : {firmware::Command::halt, firmware::Command::reset}) {
        EXPECT_TRUE(comes([&] {  // reset: not_yet while the line stop of the halt is too new to have been seen
            const auto reply = scada->command(command, 0, 0, std::chrono::seconds(60));
            return reply && reply->error == firmware::CommandError::none;
        })) << name_of(command);
    }
    EXPECT_EQ(two(115) & firmware::kFaultPlc, 0U);
    // The client that halted the station starts it again; commands for steps that it has already taken are refused.
    EXPECT_TRUE(comes([&] {
        for (const auto command :
             {firmware::Command::initialise, firmware::Command::arm, firmware::Command::start_continuous}) {
            (void)scada->command(command, 0, 0, std::chrono::seconds(60));
        }
        return scada->read(102, 1).value_or(std::vector<std::uint16_t>{0})[0] ==
            static_cast<std::uint16_t>(firmware::State::continuous_execution);
    })) << service.so_far().err;
    EXPECT_TRUE(passes_after(parts_seen()));
    service.stop(SIGINT);

    const Said kept =
        run("hordctl", {"results", "--store", folder / "made/state/store", "--reason", "plc-lost", "--format", "csv"});
    EXPECT_GE(std::ranges::count(kept.out, '\n'), 6) << kept.out << kept.err;
}

TEST_F(Service, takes_the_socket_that_systemd_opened) {
    const std::string activate = "/usr/bin/systemd-socket-activate";
    if (!std::filesystem::exists(activate)) GTEST_SKIP() << activate << " is not installed (package systemd)";
    // A port that is free now.
    const int probe = socket(AF_INET, SOCK_STREAM, 0);
    sockaddr_in address{};
    address.sin_family = AF_INET;
    address.sin_addr.s_addr = htonl(INADDR_LOOPBACK);
    socklen_t size = sizeof address;
    ASSERT_EQ(bind(probe, reinterpret_cast<sockaddr*>(&address), size), 0);
    ASSERT_EQ(getsockname(probe, reinterpret_cast<sockaddr*>(&address), &size), 0);
    const std::string port = std::to_string(ntohs(address.sin_port));
    close(probe);

    write_config("", "port = 502\n");
    Running service("/usr/bin/env",
                    {"CACHE_DIRECTORY=" + cache, activate, "-E", "CACHE_DIRECTORY", "--listen=127.0.0.1:" + port,
                     "--fdname=modbus", kHordd, "--config", folder / "c.toml"});
    ASSERT_TRUE(service.says("Listening on", kPatience)) << service.so_far().err;
    auto plc = client_at(port);  // before the service runs: the connection waits and is not refused
    ASSERT_TRUE(plc) << plc.error().message();
    ASSERT_TRUE(service.says("registers at", kPatience)) << service.so_far().err;
    EXPECT_EQ(port_of(service.so_far()), port);
    const auto magic = plc->read(2, 2);
    ASSERT_TRUE(magic) << magic.error().message();
    EXPECT_EQ(magic->at(0), 0x484F);
    EXPECT_EQ(service.stop(SIGTERM).status, 0);
}

TEST_F(Service, refuses_two_sockets_for_one_port) {
    write_config();
    const Said said = run("/bin/sh",
                          {"-c",
                           "LISTEN_PID=$$ LISTEN_FDS=2 exec " + kHordd + " --config " + (folder / "c.toml") +
                               " 3</dev/null 4</dev/null"});
    EXPECT_EQ(said.status, 2);
    EXPECT_THAT(said.err, HasSubstr("two sockets for the same register port"));
}

TEST_F(Service, times_in_real_time_and_inspects_in_what_is_left) {
    sched_param param{};
    param.sched_priority = 1;
    if (sched_setscheduler(0, SCHED_FIFO, &param) != 0)
        GTEST_SKIP() << "real-time policies are refused here (run as root, or raise LimitRTPRIO)";
    param.sched_priority = 0;
    ASSERT_EQ(sched_setscheduler(0, SCHED_OTHER, &param), 0);

    write_config();
    NotifySocket manager(folder / "notify");
    Running service("/usr/bin/env", under({"NOTIFY_SOCKET=" + (folder / "notify")}, {"--realtime", "1"}));
    EXPECT_NE(manager.hears("STATUS=ContinuousExecution"), "") << service.so_far().err;
    EXPECT_EQ(sched_getscheduler(service.pid()), SCHED_FIFO);
    int ordinary = 0;
    for (const auto& task : std::filesystem::directory_iterator("/proc/" + std::to_string(service.pid()) + "/task")) {
        std::string name;
        std::getline(std::ifstream(task.path() / "comm"), name);
        if (name.ends_with("-ust")) continue;  // idle threads of LTTng-UST, which libcamera loads
        ordinary += sched_getscheduler(std::stoi(task.path().filename().string())) == SCHED_OTHER ? 1 : 0;
    }
    EXPECT_EQ(ordinary, 1);  // the inspection thread
    EXPECT_EQ(service.stop(SIGTERM).status, 0);
}

TEST_F(Service, starts_warm_from_what_it_rendered_before) {
    write_config();
    const std::vector<std::string> arguments = under({"CACHE_DIRECTORY=" + folder.path().string()});
    std::vector<std::filesystem::path> kept;
    for (int start = 0; start < 2; ++start) {
        Running service("/usr/bin/env", arguments);
        ASSERT_TRUE(service.says("registers at", kPatience)) << service.so_far().err;
        EXPECT_EQ(service.stop(SIGTERM).status, 0);
        for (const auto& entry : std::filesystem::directory_iterator(folder.path())) {
            if (entry.path().extension() == ".cache") kept.push_back(entry.path());
        }
    }
    ASSERT_EQ(kept.size(), 2U);
    EXPECT_EQ(kept[0], kept[1]);
}

TEST_F(Service, proves_an_empty_line_at_an_orderly_end_and_at_no_other) {
    write_config("[station]\nautostart = false\n");
    const std::string proof = folder / "line-empty";
    for (const int signal : {SIGTERM, SIGKILL, SIGTERM}) {
        Running service("/usr/bin/env", under({"STATE_DIRECTORY=" + folder.path().string()}));
        ASSERT_TRUE(service.says("Preoperational to Initialized", kPatience)) << service.so_far().err;
        EXPECT_FALSE(std::filesystem::exists(proof)) << "withdrawn before the line may run";
        service.stop(signal);
        EXPECT_EQ(std::filesystem::exists(proof), signal == SIGTERM) << service.so_far().err;
    }
}

// 78: systemd would start it again and again with any other status.
TEST_F(Service, refuses_files_that_cannot_be_used_before_anything_is_rendered) {
    const std::filesystem::path empty = folder / "empty";
    std::filesystem::create_directories(empty);
    std::filesystem::create_symlink("nowhere", folder / "link.toml");
    std::ofstream(folder / "bad.toml") << "schema = 1\nnumber = 1\n[limits]\nemd_bins = -1\n";
    const auto refused = [&](const std::string& what, const std::string& name) {
        const Said check = run("/usr/bin/env", under({}, {"--check"}));
        const Said start = run("/usr/bin/env", under({"CACHE_DIRECTORY=" + empty.string()}));
        EXPECT_EQ(check.status, 78) << what;
        EXPECT_EQ(start.status, 78) << what << start.err;
        EXPECT_THAT(start.err, HasSubstr(name)) << what;
        const Said line = run("hordctl", {"run", "--config", folder / "c.toml", "--parts", "1"});
        EXPECT_EQ(line.status, 2) << what;
        EXPECT_THAT(line.err, testing::AllOf(HasSubstr(name), Not(HasSubstr("render")))) << what;
    };
    for (const std::string key : {"recipe", "grid"}) {
        for (const std::string file : {"none.toml", "bad.toml", "link.toml", "empty"}) {
            std::ofstream(folder / "c.toml") << simulated_beside("[modbus]\nport = 0\n[inspection]\nmacro = \"3x3\"\n" +
                                                                 key + " = \"" + file + "\"\n");
            refused(key + " " + file, file);
        }
    }
    for (const std::string folder_key : {"backend = \"frames\"\nfolder", "backend = \"simulated\"\nscenes"}) {
        for (const std::string file : {"none", "c.toml"}) {
            std::ofstream(folder / "c.toml")
                << simulated_beside("[modbus]\nport = 0\n[sensor]\n" + folder_key + " = \"" + file + "\"\n");
            refused(folder_key + " " + file, file);
        }
    }
    EXPECT_TRUE(std::filesystem::is_empty(empty)) << "a cell was rendered";
}

TEST_F(Service, that_is_started_by_hand_says_that_it_stores_nothing) {
    const std::string why = "no result and no frame is stored: store.folder is empty, and there is no state directory";
    write_config("[station]\nautostart = false\n");
    Running service("/usr/bin/env", under({}));
    EXPECT_TRUE(service.says(why, kPatience)) << service.so_far().err;
    const Said checked = run("/usr/bin/env", under({}, {"--check"}));
    EXPECT_THAT(checked.out, HasSubstr("note: " + why));
    EXPECT_THAT(checked.out, HasSubstr("\nthe default recipe (inspection.recipe names none): note: a round part"));
    EXPECT_THAT(run("/usr/bin/env", under({"STATE_DIRECTORY=" + folder.path().string()}, {"--check"})).out,
                Not(HasSubstr(why)));
    write_config("[store]\nenabled = false\n");
    EXPECT_THAT(run("/usr/bin/env", under({}, {"--check"})).out, Not(HasSubstr(why)));
}

TEST_F(Service, that_could_not_store_its_results_ends_with_a_status_of_its_own) {
    write_config();
    const auto state = folder.path() / "state";
    std::filesystem::create_directories(state / "store");
    std::ofstream(state / "store/results.db") << std::string(10'000, 'x');
    NotifySocket manager(folder / "notify");
    Running service("/usr/bin/env",
                    under({"NOTIFY_SOCKET=" + (folder / "notify"), "STATE_DIRECTORY=" + state.string()}));
    ASSERT_TRUE(service.says("results.db is damaged", kPatience)) << service.so_far().err;
    std::string status = manager.hears("STATUS=ContinuousExecution");
    while (status.find(", 0 parts") != std::string::npos) status = manager.hears("STATUS=ContinuousExecution");
    ASSERT_NE(status, "") << service.so_far().err;
    const Said said = service.stop(SIGTERM);
    EXPECT_EQ(said.status, 3);
    EXPECT_THAT(said.err, HasSubstr("stopped as asked; "));
    EXPECT_THAT(said.err, HasSubstr("could not be stored before the end"));
}

TEST_F(Service, refuses_a_bad_configuration_with_a_status_that_systemd_does_not_repeat) {
    write_config("", "prot = 0\n");
    for (const char* only : {"--check", ""}) {
        const Said said = run(kHordd,
                              *only != 0 ? std::vector<std::string>{"--config", folder / "c.toml", only}
                                         : std::vector<std::string>{"--config", folder / "c.toml"});
        EXPECT_EQ(said.status, 78);
        EXPECT_THAT(said.err, HasSubstr("c.toml:6"));
    }
    write_config();
    EXPECT_EQ(run(kHordd, {"--config", folder / "c.toml", "--check"}).status, 0);
    EXPECT_THAT(text_of(kDeploy / "hordd.service"), HasSubstr("RestartPreventExitStatus=78"));
}

TEST_F(Service, cannot_make_a_rejector_safe_that_does_not_answer_and_says_so) {
    write_config("[rejector]\nbackend = \"modbus\"\nport = 1\n");
    const std::vector<std::string> how{"--config", folder / "c.toml"};
    const Said said = run(kHordSafe, how);
    EXPECT_EQ(said.status, 2);
    EXPECT_THAT(said.err, HasSubstr("stop the line by hand"));
    write_config();
    EXPECT_EQ(run(kHordSafe, how).status, 0);  // a simulated station
    write_config("[rejector]\nport = -1\n");
    EXPECT_EQ(run(kHordSafe, how).status, 78);
    EXPECT_THAT(text_of(kDeploy / "hordd.service"), HasSubstr("ExecStopPost=/usr/libexec/hord/hord-safe\n"));
}

TEST(ServiceFiles, the_catalogue_in_the_tree_is_what_the_code_prints) {
    EXPECT_EQ(run(kHordd, {"--catalog"}).out, text_of(kDeploy / "hord.catalog"))
        << "run: hordd --catalog > deploy/hord.catalog";
}

TEST(ServiceFiles, every_message_id_is_there_once_and_its_cure_with_it) {
    const std::string catalog = text_of(kDeploy / "hord.catalog");
    std::set<std::string> ids;
    const std::regex id("\n-- ([0-9a-f]{32})\n");
    for (auto it = std::sregex_iterator(catalog.begin(), catalog.end(), id); it != std::sregex_iterator(); ++it) {
        EXPECT_TRUE(ids.insert((*it)[1].str()).second);
    }
    EXPECT_GE(ids.size(), 19U);
    EXPECT_THAT(catalog, HasSubstr("take the parts behind the ejector off the line"));
}

TEST(ServiceFiles, the_units_are_sound_and_expose_little) {
    const std::string analyze = "/usr/bin/systemd-analyze";
    if (!std::filesystem::exists(analyze)) GTEST_SKIP() << analyze << " is not installed (package systemd)";
    for (const auto& [unit, threshold] : std::map<std::string, std::string>{
             {"hordd.service", "17"}, {"hord-page.service", "15"}, {"hord-mqtt.service", "13"}}) {
        const Said security =
            run(analyze,
                {"security", "--offline=true", "--no-pager", "--threshold=" + threshold, (kDeploy / unit).string()});
        EXPECT_EQ(security.status, 0) << unit
                                      << security.out.substr(security.out.size() -
                                                             std::min<std::size_t>(security.out.size(), 200));
        EXPECT_THAT(security.out, HasSubstr("Overall exposure level"));
        // Reports of the program or man page not being installed are ignored; a line that systemd rejects is an error.
        const Said verified = run(analyze, {"verify", "--man=no", (kDeploy / unit).string()});
        EXPECT_THAT(verified.err, Not(HasSubstr("ignoring"))) << unit;
    }
}

}  // namespace
}  // namespace hord::test
