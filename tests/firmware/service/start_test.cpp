// When a starting service opens its register ports.
#include <filesystem>
#include <utility>
#include <vector>

#include <arpa/inet.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <netinet/in.h>
#include <sys/socket.h>

#include "common/frame.h"
#include "common/tcp_listener.h"
#include "common/unique_fd.h"
#include "drivers/files/frame_file.h"
#include "firmware/service/service.h"

namespace hord::firmware {
namespace {

namespace fs = std::filesystem;
using ::testing::Contains;
using ::testing::Each;

bool takes_connections(std::uint16_t port) {
    const common::UniqueFd fd(::socket(AF_INET, SOCK_STREAM | SOCK_CLOEXEC, 0));
    sockaddr_in address{};
    address.sin_family = AF_INET;
    address.sin_addr.s_addr = htonl(INADDR_LOOPBACK);
    address.sin_port = htons(port);
    return ::connect(fd.get(), reinterpret_cast<const sockaddr*>(&address), sizeof address) == 0;
}

// A service that plays a few recorded frames; everything else of its cell is simulated.
class StartedService : public ::testing::Test {
  protected:
    StartedService() {
        std::string name = fs::temp_directory_path() / "hord-start-XXXXXX";
        folder = ::mkdtemp(name.data());
        for (int k = 0; k < 4; ++k)
            EXPECT_TRUE(drivers::write_frame(folder / (std::to_string(k) + ".png"), Frame(15, 15, 8).view()));
        config.sensor = FrameFolder{folder, 0, 0, 0};
        config.inspection.bins_i = config.inspection.bins_j = 5;
        config.modbus.host = "127.0.0.1";
    }
    ~StartedService() override { fs::remove_all(folder); }

    // Starts it, and notes each time that a frame was read whether the port takes connections.
    Result<std::unique_ptr<Service>> start(std::uint16_t port, const ListenSockets& sockets = {}) {
        SimulationOptions simulation;
        simulation.progress = [this, port](double) { while_reading.push_back(takes_connections(port)); };
        return Service::open(config, std::move(*read_station_files(config)), simulation, {}, sockets);
    }

    fs::path folder;
    Config config;
    std::vector<bool> while_reading;
};

TEST_F(StartedService, opens_its_own_port_when_recorded_frames_are_read) {
    {
        const auto free = common::listen_on("test", "127.0.0.1", 0);
        ASSERT_TRUE(free);
        config.modbus.port = common::local_port(free->get());
    }
    const auto service = start(config.modbus.port);
    ASSERT_TRUE(service) << service.error().message();
    EXPECT_THAT(while_reading, Contains(false));
    EXPECT_THAT(while_reading, Each(false)) << "it listened, and nobody answered";
    EXPECT_TRUE(takes_connections(config.modbus.port));
}

TEST_F(StartedService, refuses_a_port_that_is_taken_before_it_reads_frames) {
    const auto taken = common::listen_on("test", "127.0.0.1", 0);
    ASSERT_TRUE(taken);
    config.modbus.port = common::local_port(taken->get());
    const auto service = start(config.modbus.port);
    ASSERT_FALSE(service);
    EXPECT_EQ(service.error().code, ErrorCode::busy) << service.error().message();
    EXPECT_TRUE(while_reading.empty());
}

// As hordd.socket: clients wait from the first moment on.
TEST_F(StartedService, keeps_a_port_of_systemd_open_all_the_time) {
    auto listening = common::listen_on("test", "127.0.0.1", 0);
    ASSERT_TRUE(listening);
    const std::uint16_t port = common::local_port(listening->get());
    const auto service = start(port, {.modbus = listening->release()});
    ASSERT_TRUE(service) << service.error().message();
    EXPECT_THAT(while_reading, Contains(true));
    EXPECT_THAT(while_reading, Each(true));
    EXPECT_EQ((*service)->registers_address(), "127.0.0.1:" + std::to_string(port));
}

}  // namespace
}  // namespace hord::firmware
