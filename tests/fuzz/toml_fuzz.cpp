// Arbitrary text as one of the station's TOML files; the first byte chooses which. The result is a value, or an error
// that says what is wrong and is no bug. A grid gets its checksum: else nearly every input would be refused for it.
#include <cstdlib>
#include <string_view>

#include <fmt/format.h>

#include "calib/files/grid_toml.h"
#include "common/hash.h"
#include "firmware/config/config.h"
#include "firmware/mqtt/mqtt_config.h"
#include "firmware/page/page_config.h"
#include "firmware/recipes/recipe_file.h"

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
    using namespace hord;
    using namespace hord::firmware;
    if (size == 0) return 0;
    const std::string_view text(reinterpret_cast<const char*>(data) + 1, size - 1);
    const auto check = [](const auto& read) {
        if (!read && (read.error().what.empty() || read.error().code == ErrorCode::internal)) std::abort();
    };
    switch (data[0]) {
        case 'c': check(parse_config(text, "hordd.toml", "/etc/hord")); break;
        case 'r': check(parse_recipe(text, "recipe.toml")); break;
        case 'g': {
            common::Fnv1a64 sum;
            sum.add(text);
            const auto sealed = fmt::format("checksum = \"fnv1a64:{:016x}\"\n{}", sum.value(), text);
            if (const auto grid = calib::parse_grid(sealed, "grid.toml"); grid) {
                if (!calib::parse_grid(calib::to_toml(*grid), "again.toml")) std::abort();
            } else {
                check(grid);
            }
            break;
        }
        case 'm': check(mqtt::parse_mqtt_config(text, "mqtt.toml", "/etc/hord")); break;
        default: check(page::parse_page_config(text, "/etc/hord/page.toml"));
    }
    return 0;
}
