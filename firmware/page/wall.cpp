#include "firmware/page/wall.h"

#include <algorithm>
#include <set>
#include <utility>

#include <fmt/format.h>

#include "common/file_kind.h"
#include "common/toml_fields.h"

namespace hord::firmware::page {
namespace {

using common::TomlProblems;
using common::TomlTable;
using store::Json;

constexpr std::size_t kResultsShown = 14;  // of each station
constexpr const char* kBlocksShown[] = {"ident", "status", "counters", "health", "recipe"};

WallStation read_station(TomlTable& table) {
    WallStation station;
    std::string modbus;
    table.text("name", station.name);
    table.text("modbus", modbus);
    table.text("page", station.page);
    if (station.name.empty() || station.name.size() > 40)
        table.problem("name", "a station has no name, or a long one", "write name = \"Cell 3\", at most 40 characters");
    if (!station.page.empty() && !station.page.starts_with("http://") && !station.page.starts_with("https://"))
        table.problem("page", "\"" + station.page + "\" is no address of a page",
                      "write page = \"http://cell3.plant.example:8070/\"");
    if (auto endpoint = modbus::parse_endpoint(modbus)) station.modbus = std::move(*endpoint);
    else table.problem("modbus", endpoint.error().what, endpoint.error().cure);
    return station;
}

}  // namespace

Result<std::vector<WallStation>> load_stations(const std::filesystem::path& file) {
    if (auto right = common::require_kind(file, common::FileKind::stations); !right)
        return tl::unexpected(right.error());
    TomlProblems problems;
    TomlTable root = TomlTable::parse_file(file, problems);
    std::vector<WallStation> stations;
    std::set<std::string> names;
    for (TomlTable& table : root.tables("station")) {
        stations.push_back(read_station(table));
        if (!names.insert(stations.back().name).second)
            table.problem("name", "two stations are called \"" + stations.back().name + "\"", "give each its own name");
    }
    root.refuse_unknown_keys();
    if (problems.empty() && (stations.empty() || stations.size() > kMaxWallStations))
        root.problem("station", fmt::format("{} stations are listed", stations.size()),
                     fmt::format("list 1 to {}, each as [[station]] with name, modbus and page", kMaxWallStations));
    if (!problems.empty()) return problems.as_error();
    return stations;
}

struct Wall::Cell {
    Cell(WallStation of, std::chrono::milliseconds poll)
        : station(std::move(of)), watch(station.modbus, poll, live, nullptr) {}
    const WallStation station;
    Viewers nobody{0};  // browsers ask the wall
    Live live{nobody};
    StationWatch watch;
};

Wall::Wall(std::vector<WallStation> stations, std::chrono::milliseconds poll) {
    for (WallStation& station : stations) cells_.push_back(std::make_unique<const Cell>(std::move(station), poll));
}

Wall::~Wall() = default;

Json Wall::json() const {
    Json list = Json::array();
    for (const auto& cell : cells_) {
        Json page = cell->live.page_json(), rows = Json::object(), results = Json::array();
        for (const char* block : kBlocksShown) {
            if (page["state"]["rows"].contains(block)) rows[block] = std::move(page["state"]["rows"][block]);
        }
        page["state"]["rows"] = std::move(rows);
        const std::size_t all = page["results"].size();
        for (std::size_t k = all - std::min(all, kResultsShown); k < all; ++k)
            results.push_back({{"part", page["results"][k]["part"]}, {"verdict", page["results"][k]["verdict"]}});
        list.push_back({{"name", cell->station.name},
                        {"page", cell->station.page},
                        {"state", std::move(page["state"])},
                        {"results", std::move(results)}});
    }
    return Json{{"stations", std::move(list)}};
}

}  // namespace hord::firmware::page
