// Several stations side by side (`hord-page --stations FILE`): each is polled over Modbus as a single station's page
// does it. Any thread.
#pragma once

#include <chrono>
#include <filesystem>
#include <memory>
#include <string>
#include <vector>

#include "common/result.h"
#include "firmware/page/live.h"
#include "firmware/page/station_watch.h"
#include "firmware/store/results/json_text.h"

namespace hord::firmware::page {

struct WallStation {
    std::string name;
    modbus::Endpoint modbus;
    std::string page;  // address of its own page, http:// or https://; empty: no link
};

constexpr std::size_t kMaxWallStations = 64;

// [[station]] name, modbus, page. Fails with invalid_argument (all problems, with their lines), not_found.
Result<std::vector<WallStation>> load_stations(const std::filesystem::path& file);

class Wall {
  public:
    // Polls from here on, a thread each.
    Wall(std::vector<WallStation> stations, std::chrono::milliseconds poll);
    ~Wall();

    // {"stations":[{"name","page","state","results":[the newest last]},...]} in the order of the file.
    [[nodiscard]] store::Json json() const;

  private:
    struct Cell;
    std::vector<std::unique_ptr<const Cell>> cells_;
};

}  // namespace hord::firmware::page
