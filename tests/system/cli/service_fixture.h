// hordd on a small simulated cell, for the tests of the service.
#pragma once

#include <chrono>
#include <filesystem>
#include <fstream>
#include <regex>
#include <string>
#include <vector>

#include <gtest/gtest.h>

#include "firmware/registers/register_client.h"
#include "tests/system/cli/program.h"

namespace hord::test {

inline const std::string kHordd = std::string(HORD_BIN_DIR) + "/hordd";
inline constexpr auto kPatience = std::chrono::seconds(120);

// A small simulated cell: few bins, so that its parts are rendered quickly.
class Service : public ::testing::Test {
  protected:
    void write_config(const std::string& more = "", const std::string& modbus = "port = 0\n") {
        std::ofstream(folder / "c.toml") << simulated_beside(
            "[inspection]\nmacro = \"3x3\"\n[line]\nexposure_delay_ms = 100\n[modbus]\n" + modbus + more);
    }
    std::vector<std::string> under(const std::vector<std::string>& environment,
                                   const std::vector<std::string>& more = {}) {
        std::vector<std::string> arguments{"CACHE_DIRECTORY=" + cache};
        arguments.insert(arguments.end(), environment.begin(), environment.end());
        arguments.insert(arguments.end(), {kHordd, "--config", folder / "c.toml"});
        arguments.insert(arguments.end(), more.begin(), more.end());
        return arguments;
    }
    static std::string port_of(const Said& said) {
        std::smatch found;
        const std::string text = said.err + said.out;
        return std::regex_search(text, found, std::regex("registers at [^ ]*:([0-9]+)")) ? found[1].str() : "";
    }
    static Result<firmware::modbus::Client> client_at(const std::string& port) {
        return firmware::modbus::Client::connect({"127.0.0.1", static_cast<std::uint16_t>(std::stoi(port))},
                                                 std::chrono::seconds(10));
    }

    TemporaryFolder folder;
    // Rendered parts are cached for the next test.
    const std::string cache = [] {
        const std::string made = std::string(HORD_BIN_DIR) + "/../service-cache";
        std::filesystem::create_directories(made);
        return made;
    }();
};

}  // namespace hord::test
