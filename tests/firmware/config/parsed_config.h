// Configurations as texts, and the documented file.
#pragma once

#include <filesystem>
#include <fstream>
#include <sstream>
#include <string>
#include <string_view>

#include "firmware/config/config.h"

namespace hord::firmware::test {

inline Result<Config> parse(std::string_view text) {
    return parse_config(text, "cell.toml", "/etc/hord", NamedBackends::optional);
}
inline std::string problems_of(std::string_view text) {
    const auto config = parse(text);
    return config ? std::string("no problem") : config.error().message();
}

inline const std::filesystem::path kDeploy = std::filesystem::path(HORD_SOURCE_DIR) / "deploy";
inline std::string text_of(const std::filesystem::path& file) {
    std::ifstream in(file);
    std::stringstream text;
    text << in.rdbuf();
    return text.str();
}

}  // namespace hord::firmware::test
