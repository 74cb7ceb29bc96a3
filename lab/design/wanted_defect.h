// The defects that a designed cell must find: a kind and a size each.
#pragma once

#include <cstdint>
#include <string>
#include <string_view>
#include <vector>

#include "common/result.h"
#include "hal_sim/optics/scene/scene.h"
#include "hal_sim/optics/scene/solid.h"

namespace hord::lab {

enum class WantedKind : std::uint8_t { bubble, cut, dimple, speck, inclusion, scratch, stria, haze };

struct WantedDefect {
    WantedKind kind = WantedKind::bubble;
    double size_mm = 0;  // diameter; of a cut and a dimple that of its rim, of a scratch and a stria the width
    [[nodiscard]] std::string_view name() const;
};

// "bubble=0.2,scratch=0.03": each kind once, sizes in mm, 1e-4 to 10. Fails with invalid_argument.
Result<std::vector<WantedDefect>> parse_defects(const std::string& text);

// The light's way through the clean part that passes (x, y) in front of it, in the part's own frame.
struct ThroughPart {
    sim::Vec3 enters, leaves;
};
// False where the light does not pass the part, or more of it than one body.
bool way_through(const sim::Body& clean, double x_mm, double y_mm, ThroughPart& way);

// A defect of this kind on the light's way at (x, y). `turn_rad`: direction of a scratch or a stria. Bubbles, specks
// and inclusions lie in the middle of the glass, cuts and scratches in the face towards the camera, dimples and haze
// in that towards the source. Fails with invalid_argument where the part has no glass there.
Result<sim::SceneDefect> make_defect(WantedKind kind, double size_mm, const sim::Scene& part, const sim::Body& clean,
                                     double x_mm, double y_mm, double turn_rad);

// Largest distance of its light from its middle, mm.
double reach_mm(WantedKind kind, double size_mm);

}  // namespace hord::lab
