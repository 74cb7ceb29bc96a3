#include "lab/design/wanted_defect.h"

#include <algorithm>
#include <array>
#include <charconv>
#include <cmath>

#include <fmt/format.h>

#include "hal_sim/optics/trace/trace.h"

namespace hord::lab {
namespace {

using namespace sim;

constexpr std::array<std::string_view, 8> kNames{"bubble",    "cut",     "dimple", "speck",
                                                 "inclusion", "scratch", "stria",  "haze"};
constexpr double kInclusionIndex = 0.1;  // above the part's
constexpr double kStriaIndex = 1e-3;     // the same
constexpr double kDimpleRad = 0.011;     // deflection at its rim: docs/notes/optics.md
constexpr double kHazeRad = 0.015;       // rms along each axis
constexpr double kLongTimes = 10;        // length of a scratch or a stria: so many times its width,
constexpr double kLongMm = 0.4;          // at least
constexpr double kSizes[] = {1e-4, 10};  // mm

double half_length(double width_mm) { return std::max(kLongTimes * width_mm, kLongMm) / 2; }

Result<WantedDefect> parse_one(const std::string& text) {
    const std::size_t equals = text.find('=');
    const auto kind = std::ranges::find(kNames, std::string_view(text).substr(0, equals));
    double size = 0;
    const char* end = text.data() + text.size();
    const bool read = equals != std::string::npos &&
        std::from_chars(text.data() + equals + 1, end, size) == std::from_chars_result{end, std::errc()};
    if (kind == kNames.end() || !read || !(size >= kSizes[0] && size <= kSizes[1])) {
        return fail(ErrorCode::invalid_argument, "defect \"" + text + "\" is not KIND=MM",
                    fmt::format("write a kind ({}) and a size of {} to {} mm, as in bubble=0.2,scratch=0.03",
                                fmt::join(kNames, ", "), kSizes[0], kSizes[1]));
    }
    return WantedDefect{static_cast<WantedKind>(kind - kNames.begin()), size};
}

}  // namespace

std::string_view WantedDefect::name() const { return kNames[static_cast<std::size_t>(kind)]; }

Result<std::vector<WantedDefect>> parse_defects(const std::string& text) {
    std::vector<WantedDefect> all;
    for (std::size_t at = 0; at <= text.size();) {
        const std::size_t comma = std::min(text.find(',', at), text.size());
        const auto one = parse_one(text.substr(at, comma - at));
        if (!one) return tl::unexpected(one.error());
        if (std::ranges::find(all, one->kind, &WantedDefect::kind) != all.end())
            return fail(ErrorCode::invalid_argument, fmt::format("defect {} is named twice", one->name()),
                        "name its smallest size alone");
        all.push_back(*one);
        at = comma + 1;
    }
    return all;
}

bool way_through(const Body& clean, double x_mm, double y_mm, ThroughPart& way) {
    RayPolyline line;
    if (shine(clean, x_mm, y_mm, &line).path == 0) return false;
    int stretches = 0;
    for (int k = 1; k < line.count; ++k) {
        if (!line.in_part[k]) continue;
        if (++stretches == 1) way.enters = line.points[k - 1];
        way.leaves = line.points[k];
    }
    return stretches == 1 && way.leaves.z > way.enters.z;
}

Result<SceneDefect> make_defect(WantedKind kind, double size_mm, const Scene& part, const Body& clean, double x_mm,
                                double y_mm, double turn_rad) {
    ThroughPart way, right, down;
    constexpr double kStep = 0.05;  // mm, for the face's slopes
    if (!way_through(clean, x_mm, y_mm, way) || !way_through(clean, x_mm + kStep, y_mm, right) ||
        !way_through(clean, x_mm, y_mm + kStep, down)) {
        return fail(ErrorCode::invalid_argument,
                    fmt::format("part {} has no single piece of glass at ({:.2f}, {:.2f}) mm", part.name, x_mm, y_mm),
                    "design for a part whose middle is one solid body");
    }
    const double r = size_mm / 2, index = index_of(part.part);
    const Vec3 middle = 0.5 * (way.enters + way.leaves);
    // Out of the glass, towards the camera and towards the source.
    const Vec3 out = unit(cross(right.leaves - way.leaves, down.leaves - way.leaves)),
               back = -1.0 * unit(cross(right.enters - way.enters, down.enters - way.enters));
    const auto along_face = [&](const Vec3& at, const Vec3& normal) {
        const Vec3 along = unit(cross(normal, {std::cos(turn_rad), std::sin(turn_rad), 0}));
        return std::pair{at - half_length(size_mm) * along, at + half_length(size_mm) * along};
    };
    switch (kind) {
        case WantedKind::bubble: return AirBubble{middle, r};
        case WantedKind::cut:  // a ball as wide as twice its rim: 0.13 of the rim deep
            return SphericalCut{way.leaves + std::sqrt(3.0) * r * out, 2 * r};
        case WantedKind::dimple: {
            const double ball = r * (index - 1) / kDimpleRad;
            return Dimple{way.enters + std::sqrt(ball * ball - r * r) * back, ball};
        }
        case WantedKind::speck: return AbsorbingSpeck{middle, r, 0};
        case WantedKind::inclusion: return Inclusion{middle, r, index + kInclusionIndex};
        case WantedKind::scratch: {
            const auto [from, to] = along_face(way.leaves, out);
            return Scratch{from, to, r};
        }
        case WantedKind::stria: {
            const auto [from, to] = along_face(middle, out);
            return Stria{from, to, r, kStriaIndex};
        }
        case WantedKind::haze: return Haze{way.enters, r, kHazeRad};
    }
    return fail(ErrorCode::internal, "a defect of no kind", "report this");
}

double reach_mm(WantedKind kind, double size_mm) {
    const bool is_long = kind == WantedKind::scratch || kind == WantedKind::stria;
    return size_mm / 2 + (is_long ? half_length(size_mm) : 0);
}

}  // namespace hord::lab
