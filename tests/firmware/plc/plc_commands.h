// A station commanded through its registers, in virtual time, with devices controlled by the test.
#pragma once

#include <optional>
#include <string>
#include <vector>

#include <gtest/gtest.h>

#include "firmware/plc/command_handler.h"
#include "firmware/plc/register_server_model.h"
#include "lab/virtual_time/virtual_time.h"
#include "tests/firmware/station/fake_devices.h"

namespace hord::firmware {

using Words = std::vector<std::uint16_t>;

struct Notes final : ResultSink {
    std::vector<Change> changes;
    std::vector<std::uint32_t> acknowledged;
    void on_result(const PartResult&) override {}
    AckStatus answer = AckStatus::recorded;
    AckStatus on_acknowledged(const RequestOrigin&, std::uint32_t sequence) override {
        if (answer == AckStatus::recorded) acknowledged.push_back(sequence);
        return answer;
    }
    void on_change(const Change& change) override { changes.push_back(change); }
    void on_inspection(std::uint32_t, const FrameView&, const algo::Inspection&) override {}
};

// Answers as set by the test. Refuses recipes as a light field of 8x8 lenslets would.
class ToldInspector final : public Inspector {
  public:
    explicit ToldInspector(hal::EventLoop& loop) : loop_(loop) {}
    Judged answer{0, false, algo::Verdict::pass, algo::Reason::none, 0, 0.5F};
    std::uint16_t number = 0;

    void start(Listener& listener) override { listener_ = &listener; }
    Result<void> submit(std::uint32_t part, hal::FrameLease) override {
        Judged judged = answer;
        judged.part = part;
        judged.recipe = number;
        loop_.call_after(milliseconds(20), [this, judged] {
            if (listener_ != nullptr) listener_->on_judged(judged);
        });
        return {};
    }
    Result<void> use(const algo::Recipe& recipe, std::uint16_t n) override {
        if (recipe.rim_margin > 3 || recipe.min_area > 64)
            return fail(ErrorCode::invalid_argument, "recipe", "rim_margin or min_area");
        number = n;
        return {};
    }
    void stop() override { listener_ = nullptr; }

  private:
    hal::EventLoop& loop_;
    Listener* listener_ = nullptr;
};

class PlcCommands : public ::testing::Test, public StationObserver {
  protected:
    void open(PlcPolicy policy = PlcPolicy::none) {
        CoreConfig config;
        config.plc_policy = policy;
        station.emplace(config, Cell{loop, part_sensor, strobe, sensor, rejector, inspector}, this);
        plc_interface.emplace(loop, operations, PlcOptions{policy, milliseconds(500), 0xB007});
        image.emplace(StationIdentity{.boot_id = 0xB007}, &*plc_interface);
        CommandHandler::Dependencies works{.station = *station,
                                           .inspector = inspector,
                                           .plc_interface = *plc_interface,
                                           .extents = {8, 8, 9, 9},
                                           .recorder = &notes,
                                           .teacher = teacher};
        works.publish = [this] { publish(); };
        works.recipe = [](std::uint16_t number) -> Result<NumberedRecipe> {
            if (number == 88) {  // judged by the light alone
                NumberedRecipe by_light{.number = 88};
                by_light.recipe.gradient.reset();
                by_light.recipe.slopes = false;
                return by_light;
            }
            if (number != 7) return fail(ErrorCode::not_found, "no recipe 7", "make one");
            NumberedRecipe seven{.number = 7};
            seven.recipe.name = "seven";
            seven.recipe.emd_limit_bins = 0.75F;
            return seven;
        };
        works.keep = [this](const NumberedRecipe& recipe) {
            if (disk) kept = recipe.number;
            return disk;
        };
        works.check_judgement = [this] { return judgement; };
        works.trouble = [this](const Error& error) { troubles.push_back(error.message()); };
        NumberedRecipe first{.number = 3};
        algo::Zone middle;
        middle.centre = {4, 4};
        middle.radius = 3;
        first.recipe.zones.push_back(middle);
        operations.begin(std::move(works), first);
        publish();
    }
    void publish() {
        image->publish(station->snapshot(), results);
        results.clear();
    }
    void on_result(const PartResult& result) override { results.push_back(result); }

    void devices_up() { rejector.link(true); }
    void ready() {
        EXPECT_EQ(command(Command::initialise), CommandError::none);
        devices_up();
        EXPECT_EQ(command(Command::arm), CommandError::none);
    }
    void running() {
        ready();
        EXPECT_EQ(command(Command::start_continuous), CommandError::none);
        EXPECT_EQ(state(), firmware::State::continuous_execution);
    }
    firmware::State state() { return static_cast<firmware::State>(read(102, 1)[0]); }
    Words read(std::uint16_t address, std::size_t count) {
        Words words(count);
        EXPECT_EQ(image->read_registers(address, words), modbus::Exception::none);
        return words;
    }
    std::uint32_t read32(std::uint16_t address) {
        const Words w = read(address, 2);
        return std::uint32_t{w[0]} << 16U | w[1];
    }
    modbus::Exception write(std::uint16_t address, const Words& words) {
        return image->write_registers({.peer = "192.0.2.7:50123"}, address, words);
    }
    modbus::Exception send(std::uint32_t as, Command code, std::uint32_t argument = 0, std::uint32_t argument2 = 0) {
        const auto low = [](std::uint32_t v) { return static_cast<std::uint16_t>(v & 0xFFFFU); };
        return write(8002,
                     {low(as >> 16U), low(as), 0xB007, static_cast<std::uint16_t>(code), low(argument >> 16U),
                      low(argument), low(argument2 >> 16U), low(argument2)});
    }
    // Sends a new command; returns the error of its reply.
    CommandError command(Command code, std::uint32_t argument = 0, std::uint32_t argument2 = 0) {
        EXPECT_EQ(send(++token, code, argument, argument2), modbus::Exception::none);
        EXPECT_EQ(read32(8022), token);
        return static_cast<CommandError>(read(8026, 1)[0]);
    }
    CommandState reply_state() { return static_cast<CommandState>(read(8025, 1)[0]); }
    std::string remarks() {
        std::string text;
        for (const std::uint16_t word : read(8031, 60)) {
            for (const unsigned c : {unsigned{word} >> 8U, word & 0xFFU}) {
                if (c != 0) text += static_cast<char>(c);
            }
        }
        return text;
    }
    void beat() { EXPECT_EQ(write(8102, {++beats}), modbus::Exception::none); }
    // Advances time and checks the heartbeat, as the service does.
    void pass(Duration time) {
        for (Duration done{}; done < time; done += milliseconds(50)) {
            loop.run_for(milliseconds(50));
            plc_interface->check_plc_heartbeat();
            (void)operations.use_learned_reference();
            publish();
        }
    }
    std::uint32_t part() {
        part_sensor.listener->on_edge({hal::PartEdge::Kind::arrives, loop.now(), ++edges, {}});
        return edges;
    }
    void light_and_frame() {
        loop.run_for(milliseconds(10));
        const auto& pulse = strobe.pulses.back();
        strobe.listener->on_strobe({pulse.exposure, true, pulse.start, pulse.width});
        sensor.deliver(sensor.requests.back().start);
        loop.run_for(milliseconds(25));
    }

    lab::VirtualTime loop;
    FakePartSensor part_sensor;
    FakeStrobe strobe;
    FakeSensor sensor;
    FakeRejector rejector;
    ToldInspector inspector{loop};
    Notes notes;
    TeachIn* teacher = nullptr;
    CommandHandler operations;
    Result<void> judgement, disk;  // `disk`: of writing the recipe in use
    int kept = -1;                 // number of the recipe that a restart would use
    std::vector<std::string> troubles;
    std::vector<PartResult> results;
    std::optional<Station> station;
    std::optional<PlcInterface> plc_interface;
    std::optional<RegisterServerModel> image;
    std::uint32_t token = 70, edges = 0;
    std::uint16_t beats = 0;
};

}  // namespace hord::firmware
