// A scene: one part with its defects, the light, the camera. Read from TOML; seeded and complete.
//
// Lengths in millimetres, angles in radians, wavelengths in nanometres. The part's frame: origin on the measurement
// plane at the field's centre, x to the right and y downwards in the image, z along the light towards the camera.
#pragma once

#include <cstdint>
#include <filesystem>
#include <string>
#include <string_view>
#include <variant>
#include <vector>

#include "algo/light_field.h"
#include "algo/result.h"

namespace hord::sim {

struct Vec3 {
    double x = 0, y = 0, z = 0;
};

// The part. NoPart: an empty field.
struct NoPart {};
struct DoubleConvexLens {
    double radius_of_curvature_mm = 190;  // both faces
    double aperture_radius_mm = 10;
    double edge_thickness_mm = 4;
    double refractive_index = 1.5;
};
struct Wedge {
    double half_size_mm = 8;
    double centre_thickness_mm = 4;
    double tilt_x_rad = 0, tilt_y_rad = 0;  // of the camera-side face; positive: thicker, and light bent, to the right / downwards
    double refractive_index = 1.5;
};
struct PlanoConvexLens {  // curved towards the camera
    double radius_of_curvature_mm = 100;
    double aperture_radius_mm = 10;
    double edge_thickness_mm = 3;
    double refractive_index = 1.5;
};
struct CylinderLens {  // curved towards the camera, across x; straight along y
    double radius_of_curvature_mm = 100;
    double half_width_mm = 8, half_length_mm = 9;  // x, y
    double edge_thickness_mm = 3;
    double refractive_index = 1.5;
};
struct Plate {
    double half_size_mm = 8;
    double thickness_mm = 4;
    double refractive_index = 1.5;
};
struct Vial {  // a tube along y, closed by its contents' ends
    double outer_radius_mm = 6, inner_radius_mm = 5;
    double half_height_mm = 10;
    double refractive_index = 1.5;
    double contents_index = 1.33;
};
using Part = std::variant<NoPart, DoubleConvexLens, Wedge, PlanoConvexLens, CylinderLens, Plate, Vial>;

struct AirBubble {  // a sphere of index 1 inside the part
    Vec3 centre_mm;
    double radius_mm = 0.5;
};
struct SphericalCut {  // a sphere of index 1 that bites into the surface
    Vec3 centre_mm;
    double radius_mm = 1;
};
struct AbsorbingSpeck {  // a thin disc across the light that lets `transmission` of the light through
    Vec3 centre_mm;
    double radius_mm = 0.5;
    double transmission = 0;  // 0..1
};
struct Inclusion {  // a sphere of another index inside the part
    Vec3 centre_mm;
    double radius_mm = 0.5;
    double refractive_index = 1.6;
};
struct Scratch {  // a round groove of this radius along a straight line
    Vec3 from_mm, to_mm;
    double radius_mm = 0.05;
};
using SceneDefect = std::variant<AirBubble, SphericalCut, AbsorbingSpeck, Inclusion, Scratch>;

struct Pose {
    double x_mm = 0, y_mm = 0;  // shift of the part on the measurement plane
    double rotation_rad = 0;    // about z
};

struct Light {
    double source_radius_bins = 0.61;  // angular radius of the collimated source, bin pitches
};

struct Camera {
    algo::Extents extents{111, 111, 9, 9};
    double field_mm = 24;          // width of the lenslet field on the measurement plane
    double bin_pitch_rad = 0.015;  // slope of one bin
    int bits = 8;
    double full_bin_dn = 240;      // DN of a bin filled by the source, before noise
};

// Effects that a scene names. Off by default: an effect that is off costs nothing.
struct Effects {
    bool fresnel = false;  // light lost by reflection at every face; ghosts are not followed
};

// The conventional camera beside the other: it sees along the axis, in front of a panel of light behind the part.
struct TelecentricCamera {
    int width_px = 333, height_px = 333;
    double field_mm = 24;           // width
    double panel_half_mm = 60;      // half side of the square panel
    double panel_distance_mm = 40;  // from the measurement plane
    int rays_per_side = 4;          // squared: rays a pixel
};

// EMVA 1288, a subset. Off by default: an effect that is off costs nothing.
struct SensorNoise {
    double electrons_per_dn = 0;  // 0: no photon noise
    double read_e = 0;            // rms electrons
    double dark_dn = 0;           // pedestal
};

struct Scene {
    std::string name = "scene";
    std::uint64_t seed = 1;
    Part part;
    std::vector<SceneDefect> defects;
    Pose pose;
    Light light;
    Camera camera;
    SensorNoise noise;
    Effects effects;
    TelecentricCamera telecentric;
};

// What keeps a scene from being rendered. `table` and `key` are those of the scene file (docs/scene.md).
struct SceneProblem {
    std::string table;  // "part", "pose", "light", "camera", "noise", "defect"
    std::size_t index = 0;  // which defect, from 0
    std::string key, what, cure;
    [[nodiscard]] std::string message() const;
};

// All of them; none when the scene can be rendered.
std::vector<SceneProblem> problems(const Scene& scene);

// The presets' names in scene files, as `part.kind` and `defect.kind`.
std::string_view name_of(const Part& part);
std::string_view name_of(const SceneDefect& defect);

// Fails with unreadable/invalid_argument; every problem of the file at once, each with its line and cure.
Result<Scene> load_scene(const std::filesystem::path& file);

}  // namespace hord::sim
