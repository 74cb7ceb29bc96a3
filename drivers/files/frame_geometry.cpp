#include "drivers/files/frame_geometry.h"

#include <stdexcept>

#include <nlohmann/json.hpp>

namespace hord::drivers {
namespace {

using Json = nlohmann::ordered_json;

constexpr int kSchema = 1;
constexpr const char* kMacroPixels = "macro-pixels";
constexpr const char* kRaw = "raw";
constexpr const char* kCure = "write the frame again, or correct its note (docs/commands.md)";

std::string size_text(int width, int height) { return std::to_string(width) + "x" + std::to_string(height); }

tl::unexpected<Error> damaged(const std::string& name, const std::string& why) {
    return fail(ErrorCode::unreadable, name + " has a geometry note that cannot be used (" + why + ")", kCure);
}

}  // namespace

std::string describe(const FrameGeometry& g) {
    const std::string bits = std::to_string(g.bits) + " bits";
    if (g.kind == FrameKind::raw) return "a raw frame of " + bits;
    return "macro-pixels of " + size_text(g.grid.i, g.grid.j) + " bins, " + size_text(g.grid.m, g.grid.n) +
        " lenslets, " + bits;
}

std::string to_json(const FrameGeometry& g) {
    Json json{{"schema", kSchema}, {"kind", g.kind == FrameKind::raw ? kRaw : kMacroPixels}};
    if (g.kind == FrameKind::macro_pixels)
        json["grid"] = {{"m", g.grid.m}, {"n", g.grid.n}, {"i", g.grid.i}, {"j", g.grid.j}};
    json["bits"] = g.bits;
    return json.dump();
}

Result<FrameGeometry> geometry_from_json(const std::string& text, const std::string& name) {
    FrameGeometry g;
    try {
        const Json json = Json::parse(text);
        if (!json.is_object()) return damaged(name, "it is no JSON object");
        const bool kept = !json.contains("schema") && json.contains("hord");  // the metadata of a kept frame
        const auto whole = [](const Json& number) {
            const auto value = number.is_number_integer() ? number.get<std::int64_t>() : -1;
            if (value < 0 || value > 1'000'000) throw std::invalid_argument("a number is not whole, or out of range");
            return static_cast<int>(value);
        };
        if (const int schema = whole(json.at(kept ? "hord" : "schema")); schema != kSchema) {
            return fail(ErrorCode::unsupported,
                        name + " has a geometry note of schema " + std::to_string(schema) +
                            ", which this program does not know",
                        "use a newer program");
        }
        const std::string kind = kept ? json.value("kind", kMacroPixels) : json.at("kind").get<std::string>();
        if (kind != kMacroPixels && kind != kRaw) return damaged(name, "its kind is \"" + kind + "\"");
        g.kind = kind == kRaw ? FrameKind::raw : FrameKind::macro_pixels;
        if (!kept || json.contains("bits")) g.bits = whole(json.at("bits"));
        if (g.kind == FrameKind::raw && json.contains("grid"))
            return damaged(name, "it contradicts itself: a raw frame has no grid of macro-pixels");
        if (g.kind == FrameKind::macro_pixels) {
            const Json& grid = json.at("grid");
            g.grid = {whole(grid.at("m")), whole(grid.at("n")), whole(grid.at("i")), whole(grid.at("j"))};
        }
    } catch (const std::exception& error) {  // nlohmann's, and ours
        return damaged(name, error.what());
    }
    if (g.bits < 8 || g.bits > 16) return damaged(name, "it says " + std::to_string(g.bits) + " bits, not 8 to 16");
    if (g.kind == FrameKind::macro_pixels) {
        if (const auto fine = algo::check(g.grid); !fine) return damaged(name, fine.error().what);
    }
    return g;
}

Result<void> check_against(const FrameGeometry& g, const Frame& frame, const std::string& name) {
    if (g.kind == FrameKind::macro_pixels &&
        (g.grid.width_px() != frame.width_px() || g.grid.height_px() != frame.height_px())) {
        return fail(ErrorCode::unreadable,
                    name + " contradicts its geometry note: " + describe(g) + " are " +
                        size_text(g.grid.width_px(), g.grid.height_px()) + " pixels, and it has " +
                        size_text(frame.width_px(), frame.height_px()),
                    kCure);
    }
    const bool fits = g.bits == frame.bits() || (frame.bits() == 16 && g.bits > 8);
    if (fits) return {};
    return fail(ErrorCode::unreadable,
                name + " contradicts its geometry note: it has samples of " + std::to_string(frame.bits()) +
                    " bits, and the note says " + std::to_string(g.bits),
                kCure);
}

}  // namespace hord::drivers
