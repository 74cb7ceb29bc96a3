// What hordctl devices finds: below folders that stand for a machine's, with a simulated module and a program that
// replaces hord-camera. Every suggested line must be one that the configuration accepts.
#include "firmware/devices/device_inventory.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <sys/inotify.h>
#include <unistd.h>

#include "common/tcp_listener.h"
#include "common/unique_fd.h"
#include "drivers/event_loop/event_loop_sd.h"
#include "drivers/libcamera/libcamera_request.h"
#include "firmware/config/config.h"
#include "tests/support/answering_server.h"
#include "tests/support/modbus_module/modbus_module.h"
#include "tests/support/temp_folder.h"

namespace hord::firmware {
namespace {

namespace fs = std::filesystem;
using ::testing::AllOf;
using ::testing::HasSubstr;
using ::testing::IsEmpty;
using testing_support::TempFolder;

Config parsed(const std::string& text) {
    const auto config = parse_config(text, "suggested", "/etc/hord", NamedBackends::optional);
    EXPECT_TRUE(config) << config.error().message() << '\n' << text;
    return config.value_or(Config{});
}

class Inventory : public ::testing::Test {
  protected:
    Inventory() : loop_(std::move(*SdEventLoop::open())) {
        for (const char* folder : {"dev", "proc", "sys/class/tty"}) fs::create_directories(root_.path() / folder);
        options_.root = root_.path();
        options_.libcamera_program = options_.genicam_program = "/no/such/program";
    }
    fs::path file(const std::string& name, const std::string& text = {}) const {
        fs::create_directories((root_.path() / name).parent_path());
        return root_.write(name, text);
    }
    void process(const std::string& pid, const std::string& name, const std::string& arguments = {}) const {
        file("proc/" + pid + "/comm", name + "\n");
        file("proc/" + pid + "/cmdline", arguments);
        fs::create_directories(root_.path() / "proc" / pid / "fd");
    }
    InventorySection section(const std::string& key) {
        for (InventorySection& one : list_devices(*loop_, options_)) {
            if (one.key == key) return one;
        }
        ADD_FAILURE() << key;
        return {};
    }

    TempFolder root_;
    InventoryOptions options_;
    std::unique_ptr<SdEventLoop> loop_;
};

TEST_F(Inventory, of_nothing_says_what_was_looked_for_and_how_to_attach_it) {
    for (const InventorySection& one : list_devices(*loop_, options_)) {
        EXPECT_THAT(one.items, IsEmpty()) << one.key;
        EXPECT_NE(one.looked_for.empty(), one.problem.empty()) << one.key;
        EXPECT_FALSE(one.cure.empty()) << one.key;
    }
    EXPECT_THAT(section("libcamera").problem, HasSubstr("/no/such/program"));
}

TEST_F(Inventory, skips_a_process_that_ends_while_it_is_read) {
    fs::create_directories(root_.path() / "proc/811/comm");  // opens, and its reading fails, as that of a process gone
    process("812", "hordd");
    fs::create_directories(root_.path() / "proc/813/cmdline");
    file("proc/813/comm", "hordd\n");
    EXPECT_THAT(section("gpio").looked_for, HasSubstr("no GPIO chip found"));
}

TEST_F(Inventory, names_files_that_are_no_devices) {
    file("dev/gpiochip0");
    file("dev/video3");
    file("dev/video-cam");
    const auto gpio = section("gpio").items, video = section("v4l2").items;
    ASSERT_EQ(gpio.size(), 1U);
    EXPECT_THAT(gpio[0].problem, HasSubstr("cannot be read"));
    EXPECT_THAT(gpio[0].config, IsEmpty());
    ASSERT_EQ(video.size(), 1U);
    EXPECT_EQ(video[0].problem, "is no video device");
    EXPECT_THAT(video[0].config, IsEmpty());
}

TEST_F(Inventory, lists_serial_ports_that_exist_by_their_lasting_names_with_who_uses_them) {
    for (const char* port : {"ttyS0", "ttyS1", "ttyUSB0", "ttyAMA0", "tty1", "ttyprintk"})
        file(std::string("dev/") + port);
    file("sys/class/tty/ttyS0/type", "4\n");
    file("sys/class/tty/ttyS1/type", "0\n");  // the kernel made its file, no port is there
    fs::create_directories(root_.path() / "dev/serial/by-id");
    fs::create_symlink("../../ttyUSB0", root_.path() / "dev/serial/by-id/usb-FTDI_RS485");
    process("812", "hordd");
    fs::create_symlink(root_.path() / "dev/ttyS0", root_.path() / "proc/812/fd/7");
    const common::UniqueFd opened(::inotify_init1(IN_NONBLOCK | IN_CLOEXEC));
    ASSERT_GE(::inotify_add_watch(opened.get(), (root_.path() / "dev/ttyS0").c_str(), IN_OPEN), 0);
    const auto ports = section("serial").items;
    char event[1024];
    EXPECT_LT(::read(opened.get(), event, sizeof event), 0) << "a port is opened: that moves its control lines";
    ASSERT_EQ(ports.size(), 3U);
    EXPECT_EQ(ports[0].name, root_.path() / "dev/ttyS0");
    EXPECT_EQ(ports[0].holder, "hordd (process 812)");
    EXPECT_EQ(ports[1].name, root_.path() / "dev/ttyAMA0");
    EXPECT_EQ(ports[2].name, root_.path() / "dev/serial/by-id/usb-FTDI_RS485");
    EXPECT_THAT(ports[2].holder, IsEmpty());
    const auto config = parsed(ports[2].config);
    EXPECT_EQ(std::get<drivers::ModbusRejectorOptions>(config.rejector).address.serial->device, ports[2].name);
}

TEST_F(Inventory, of_a_gpio_chip_suggests_lines_that_nobody_uses) {
    drivers::ListedChip chip{.path = "/dev/gpiochip0", .label = "pinctrl-bcm2711"};
    chip.lines = {{0, "ID_SDA", "i2c", false},
                  {1, "LED", std::nullopt, true},
                  {2, "GPIO17", std::nullopt, false},
                  {3, "NC", std::nullopt, false},
                  {4, "NC", std::nullopt, false}};
    const auto config = parsed(describe_chip(chip, false).config);
    ASSERT_EQ(config.strobe.gpio.size(), 1U);
    EXPECT_EQ(config.strobe.gpio[0].line.chip, "pinctrl-bcm2711");
    EXPECT_EQ(config.strobe.gpio[0].line.line, "GPIO17");
    EXPECT_EQ(std::get<drivers::GpioPartSensorOptions>(config.part_sensor).line.line, "3") << "its name is not unique";
    EXPECT_EQ(parsed(describe_chip(chip, true).config).strobe.gpio[0].line.chip, "/dev/gpiochip0");
    chip.lines.resize(3);
    EXPECT_THAT(describe_chip(chip, false).config, IsEmpty()) << "one line is free";
}

TEST_F(Inventory, of_a_camera_suggests_its_deepest_grey_format_and_its_trigger) {
    hal::ListedCamera camera{.name = "S1", .formats = {{"RGB8", 0, 0, 0, {}}, {"Mono8", 8, 2048, 1536, {}}}};
    camera.formats.push_back({"Mono12p", 12, 2048, 1536, {}});
    camera.triggers = {"Software", "Line1"};
    const auto genicam =
        std::get<drivers::GenicamSensorOptions>(parsed(describe_camera(camera, "genicam").config).sensor);
    EXPECT_EQ(genicam.camera, "S1");
    EXPECT_EQ(std::tie(genicam.width_px, genicam.height_px, genicam.bits), std::make_tuple(2016, 1512, 12));
    EXPECT_EQ(genicam.trigger, drivers::CameraTrigger::line);
    EXPECT_EQ(genicam.trigger_source, "Line1");
    camera.triggers = {"Software"};
    EXPECT_EQ(std::get<drivers::GenicamSensorOptions>(parsed(describe_camera(camera, "genicam").config).sensor).trigger,
              drivers::CameraTrigger::software);
    camera.name = "/dev/video0";
    EXPECT_EQ(std::get<drivers::V4l2SensorOptions>(parsed(describe_camera(camera, "v4l2").config).sensor).device,
              "/dev/video0");
    camera.holder = "cheese (process 5)";
    EXPECT_THAT(describe_camera(camera, "v4l2").config, IsEmpty()) << "it is in use";
    camera.holder.clear();
    camera.formats.resize(1);
    const auto colour = describe_camera(camera, "v4l2");
    EXPECT_THAT(colour.problem, HasSubstr("no grey format"));
    EXPECT_THAT(colour.config, IsEmpty());
    camera.formats.clear();
    EXPECT_EQ(describe_camera(camera, "v4l2").problem, "names no format");
}

TEST_F(Inventory, lists_cameras_of_libcamera_through_their_process) {
    options_.libcamera_program = fs::path(HORD_BIN_DIR) / "hord_fake_camera";
    const auto cameras = section("libcamera").items;
    ASSERT_EQ(cameras.size(), 2U);
    const auto mono = std::get<drivers::LibcameraSensorOptions>(parsed(cameras[0].config).sensor);
    EXPECT_EQ(std::tie(mono.camera, mono.width_px, mono.bits), std::make_tuple("mono", 1456, 10));
    EXPECT_FALSE(mono.green);
    EXPECT_TRUE(std::get<drivers::LibcameraSensorOptions>(parsed(cameras[1].config).sensor).green);
}

TEST_F(Inventory, leaves_libcamera_alone_while_the_station_holds_a_camera_and_says_who_holds_it) {
    const auto request = drivers::request_of(drivers::LibcameraSensorOptions{.camera = "imx296"});
    process("77", "hord-camera",
            "/usr/libexec/hord/hord-camera" + std::string(1, '\0') + "start" + std::string(1, '\0') + request +
                std::string(1, '\0'));
    const auto cameras = section("libcamera").items;  // the program that would list them does not exist
    ASSERT_EQ(cameras.size(), 1U);
    EXPECT_EQ(cameras[0].name, "imx296");
    EXPECT_THAT(cameras[0].holder, HasSubstr("hord-camera (process 77)"));
    EXPECT_THAT(cameras[0].config, IsEmpty());
}

struct Kind {
    test::ModuleKind kind;
    const char* text;
    const char* profile;
};
class InventoryOfModule : public Inventory, public ::testing::WithParamInterface<Kind> {};

TEST_P(InventoryOfModule, asks_it_what_it_is_and_writes_nothing) {
    auto module = std::move(*test::ModbusModule::open(*loop_, {.kind = GetParam().kind}));
    module->misbehave(test::ModuleFault::close);  // any write
    options_.module = drivers::ModuleAddress{.port = module->port()};
    options_.patience = std::chrono::seconds(20);
    const auto items = section("module").items;
    ASSERT_EQ(items.size(), 1U);
    EXPECT_EQ(items[0].text, GetParam().text) << items[0].problem;
    EXPECT_THAT(items[0].config, HasSubstr("profile = \"" + std::string(GetParam().profile) + "\""));
    EXPECT_EQ(std::get<drivers::ModbusRejectorOptions>(parsed(items[0].config).rejector).address.port, module->port());
    EXPECT_EQ(module->misbehaved(), 0) << "it wrote";
    if (items[0].text.empty()) {
        EXPECT_THAT(
            items[0].cure,
            AllOf(HasSubstr("rejector.profile: plain-coils"), HasSubstr("wago-750, moxa-iologik, advantech-adam")));
    }
    EXPECT_THAT(module->history(), IsEmpty());
}

INSTANTIATE_TEST_SUITE_P(Of, InventoryOfModule,
                         ::testing::Values(Kind{test::ModuleKind::plain, "HORD coil module 1.0", "plain-coils"},
                                           Kind{test::ModuleKind::wago, "WAGO 750-352", "wago-750"},
                                           Kind{test::ModuleKind::moxa, "E1213", "moxa-iologik"},
                                           Kind{test::ModuleKind::adam, "", "plain-coils"}));

TEST_F(Inventory, of_what_is_no_rejectors_module_no_lines_are_proposed) {
    const std::string station = "HORD station";
    const std::string objects = std::string("\0\4HORD\1", 7) + static_cast<char>(station.size()) + station;
    const std::string text = std::string("\1\x2B\x0E\1\x83\0\0\2", 8) + objects;
    const struct {
        std::string answer;  // empty: what was sent
        const char* said;
    } cases[] = {
        {"HTTP/1.1 400 Bad Request\r\nServer: x\r\n\r\n<html>", "not as a Modbus module does"},
        {"", "not as a Modbus module does"},
        {std::string("\0\0\0\0\0", 5) + static_cast<char>(text.size()) + text, "is a station, not a rejector"},
    };
    for (const auto& c : cases) {
        const test::AnsweringServer server([&](const std::string& sent) { return c.answer.empty() ? sent : c.answer; });
        options_.module = drivers::ModuleAddress{.port = server.port()};
        options_.patience = std::chrono::seconds(5);
        const auto items = section("module").items;
        ASSERT_EQ(items.size(), 1U);
        EXPECT_THAT(items[0].problem, HasSubstr(c.said));
        EXPECT_THAT(items[0].config, IsEmpty()) << c.said;
    }
}

TEST_F(Inventory, of_a_module_that_is_silent_or_behind_a_gateway_says_so_and_proposes_no_lines) {
    const auto refused = [](const std::string& sent, char code) {
        if (sent.size() < 8) return std::string();
        const char function = static_cast<char>(static_cast<unsigned char>(sent[7]) | 0x80U);
        return sent.substr(0, 2) + std::string("\0\0\0\3", 4) + sent[6] + function + code;
    };
    const std::pair<std::function<std::string(const std::string&)>, const char*> cases[] = {
        {[](const std::string&) { return std::string(); }, "closes the connection without an answer as unit 3"},
        {[&](const std::string& sent) { return refused(sent, 10); }, "a gateway does, in its place, for unit 3"},
        {[&](const std::string& sent) { return refused(sent, 11); }, "a gateway does, in its place, for unit 3"},
        {[&](std::string sent) { return refused(sent.replace(6, 1, "\7"), 1); }, "answers as unit 7, not as unit 3"},
    };
    for (const auto& [answer, said] : cases) {
        const test::AnsweringServer server(answer);
        options_.module = drivers::ModuleAddress{.port = server.port(), .unit = 3};
        options_.patience = std::chrono::seconds(5);
        const auto items = section("module").items;
        ASSERT_EQ(items.size(), 1U);
        EXPECT_THAT(items[0].problem, HasSubstr(said));
        EXPECT_THAT(items[0].cure, HasSubstr("unit"));
        EXPECT_THAT(items[0].config, IsEmpty()) << said;
    }
    const auto listener = common::listen_on("test", "127.0.0.1", 0);  // its connections are made and never answered
    ASSERT_TRUE(listener);
    options_.module = drivers::ModuleAddress{.port = common::local_port(listener->get()), .unit = 3};
    options_.patience = std::chrono::milliseconds(20);
    EXPECT_THAT(section("module").items[0].problem, HasSubstr("does not answer as unit 3"));
}

TEST_F(Inventory, an_ipv6_address_is_printed_as_it_is_given) {
    options_.module = drivers::ModuleAddress{.host = "::1", .port = 1};
    EXPECT_EQ(section("module").items[0].name, "[::1]:1 unit 1");
    EXPECT_THAT(section("module").items[0].problem, HasSubstr("[::1]:1"));
}

TEST_F(Inventory, of_a_module_that_is_not_there_names_its_address_and_a_cure) {
    auto module = std::move(*test::ModbusModule::open(*loop_));
    options_.module = drivers::ModuleAddress{.port = module->port()};
    module->power_off();
    const auto items = section("module").items;
    ASSERT_EQ(items.size(), 1U);
    EXPECT_THAT(items[0].problem, HasSubstr("127.0.0.1:" + std::to_string(options_.module->port)));
    EXPECT_THAT(items[0].cure, HasSubstr("check"));
    EXPECT_THAT(items[0].config, IsEmpty());
}

TEST(InventoryText, of_several_devices_is_a_configuration_when_all_lines_are_pasted) {
    drivers::ListedChip chip;
    chip.label = "pinctrl";
    chip.lines = {{1, "A", {}, false}, {2, "B", {}, false}};
    const auto camera = [](const char* name, const char* backend) {
        hal::ListedCamera seen;
        seen.name = name;
        seen.formats = {{.name = "Mono8", .bits = 8, .width_px = 720, .height_px = 720}};
        return describe_camera(seen, backend);
    };
    const auto rejector = [](const char* name, const char* at) {
        InventoryItem item;
        item.name = name;
        item.config = "[rejector]\nbackend = \"modbus\"\n" + std::string(at);
        return item;
    };
    std::vector<InventorySection> sections(4);
    sections[0].items = {describe_chip(chip, false), describe_chip(chip, false)};
    sections[1].items = {camera("/dev/video0", "v4l2")};
    sections[2].items = {camera("S1", "genicam"), camera("S\n2", "genicam")};
    sections[3].items = {rejector("/dev/ttyS0", "device = \"/dev/ttyS0\"\n"),
                         rejector("/dev/ttyS1", "device = \"/dev/ttyS1\"\n")};
    EXPECT_THAT(make_one_file(sections), IsEmpty());
    std::string all;
    for (const InventorySection& section : sections) {
        for (const InventoryItem& item : section.items) all += item.config;
    }
    const auto config = parse_config(all, "pasted", "/etc/hord");
    ASSERT_TRUE(config) << config.error().message() << '\n' << all;
    EXPECT_EQ(std::get<drivers::GenicamSensorOptions>(config->sensor).camera, "S1");
    EXPECT_EQ(config->strobe.gpio.size(), 1U);
    EXPECT_EQ(std::get<drivers::ModbusRejectorOptions>(config->rejector).address.serial->device, "/dev/ttyS0");
    EXPECT_THAT(all, HasSubstr("# or, instead of [sensor] of \"S1\":\n# [sensor]\n# backend = \"genicam\"\n"));
    sections[0].items.clear();  // a machine without GPIO lines
    EXPECT_THAT(make_one_file(sections), testing::ElementsAre("[strobe]", "[part_sensor]"));
}

}  // namespace
}  // namespace hord::firmware
