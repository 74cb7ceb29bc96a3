#include "firmware/page/page_config.h"

#include <algorithm>
#include <cctype>

#include <arpa/inet.h>

#include "common/file_kind.h"
#include "common/toml_fields.h"
#include "firmware/registers/register_client.h"

namespace hord::firmware::page {
namespace {

namespace fs = std::filesystem;
using common::TomlProblems;
using common::TomlTable;

fs::path beside(const fs::path& file, const std::string& name) {
    return name.empty() || fs::path(name).is_absolute() ? fs::path(name) : file.parent_path() / name;
}

bool is_address(int family, const std::string& text) {
    in6_addr address{};
    return ::inet_pton(family, text.c_str(), &address) == 1;
}

// A name, an IPv4 address, or an IPv6 address with or without brackets; without a port.
bool may_be_a_host(const std::string& name) {
    if (name.starts_with('[') && name.ends_with(']')) return is_address(AF_INET6, name.substr(1, name.size() - 2));
    if (name.find(':') != std::string::npos) return is_address(AF_INET6, name);
    if (name.find_first_not_of("0123456789.") == std::string::npos) return is_address(AF_INET, name);
    const auto plain = [](unsigned char c) { return std::isalnum(c) != 0 || c == '.' || c == '-' || c == '_'; };
    return name.size() < 256 && std::all_of(name.begin(), name.end(), plain);
}

// "06:00"
bool is_time_of_day(const std::string& text) {
    const auto digit = [&](std::size_t k) { return text[k] >= '0' && text[k] <= '9'; };
    return text.size() == 5 && text[2] == ':' && digit(0) && digit(1) && digit(3) && digit(4) &&
        text.substr(0, 2) < "24" && text[3] < '6';
}

Result<PageConfig> read(TomlTable root, const fs::path& file, TomlProblems& problems) {
    PageConfig config;
    TomlTable page = root.table("page");
    page.text("host", config.host);
    page.integer("port", config.port, 0, 65535);
    page.texts("names", config.names);
    page.integer("viewers", config.viewers, 1, 64);
    page.texts("shifts", config.shifts);
    if (config.shifts.empty() || !std::ranges::all_of(config.shifts, is_time_of_day))
        page.problem("shifts", "a shift's start is no time of day", "write [\"06:00\", \"14:00\", \"22:00\"]");
    for (std::string& name : config.names) {
        if (!may_be_a_host(name))
            page.problem("names", "\"" + name + "\" is no host's name or address",
                         "write it without a port and without http://");
        name = lower(is_address(AF_INET6, name) ? "[" + name + "]" : name);  // as browsers send it
    }
    if (!may_be_a_host(config.host))
        page.problem("host", "\"" + config.host + "\" is no address to listen at",
                     "write \"127.0.0.1\", or \"0.0.0.0\" for every interface");

    TomlTable station = root.table("station");
    station.text("modbus", config.modbus);
    if (const auto endpoint = modbus::parse_endpoint(config.modbus); !endpoint)
        station.problem("modbus", endpoint.error().what, endpoint.error().cure);
    std::string store = config.store.string();
    station.text("store", store);
    config.store = beside(file, store);
    int poll_ms = static_cast<int>(config.poll.count());
    station.integer("poll_ms", poll_ms, 20, 10'000);
    config.poll = std::chrono::milliseconds(poll_ms);

    TomlTable actions = root.table("actions");
    std::string tokens;
    actions.text("tokens", tokens);
    config.tokens = beside(file, tokens);

    root.refuse_unknown_keys();
    if (!problems.empty()) return problems.as_error();
    return config;
}

}  // namespace

std::string lower(std::string_view text) {
    std::string out(text);
    std::ranges::transform(out, out.begin(), [](unsigned char c) { return static_cast<char>(std::tolower(c)); });
    return out;
}

Result<PageConfig> load_page_config(const fs::path& file) {
    if (auto right = common::require_kind(file, common::FileKind::page); !right) return tl::unexpected(right.error());
    TomlProblems problems;
    return read(TomlTable::parse_file(file, problems), file, problems);
}

Result<PageConfig> parse_page_config(std::string_view text, const fs::path& file) {
    TomlProblems problems;
    return read(TomlTable::parse_text(text, file.string(), problems), file, problems);
}

}  // namespace hord::firmware::page
