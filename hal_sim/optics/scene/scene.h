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

#include "algo/frame/extents.h"
#include "common/result.h"

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
    double tilt_x_rad = 0, tilt_y_rad = 0;  // of one face; positive: thicker, and light bent, to the right / downwards
    double refractive_index = 1.5;
    bool tilts_source_side = false;  // the face towards the source; else the camera's
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
struct Waviness {             // one wave of the transmitted wavefront, across the light
    double wavefront_nm = 0;  // peak to valley, as of ISO 10110-14; 0: none
    double period_mm = 2;
    double direction_rad = 0;  // in which it changes, from x towards y
    double phase_rad = 0;      // at the part's middle: 0 where the wavefront is half way up
};
struct Plate {
    double half_size_mm = 8;
    double thickness_mm = 4;
    double refractive_index = 1.5;
    Waviness waviness = {};
};
struct Vial {  // a tube along y, closed by its contents' ends
    double outer_radius_mm = 6, inner_radius_mm = 5;
    double half_height_mm = 10;
    double refractive_index = 1.5;
    double contents_index = 1.33;
};
// A shape of the scene's own, or several of them put together. In its own frame; then turned about x, y, z, then moved.
struct Shape {
    enum class Kind : std::uint8_t {
        union_of,
        intersection,
        difference,  // of the shapes in `of`; difference: of the first, without all others
        sphere,      // radius_mm about the origin
        half_space,  // z < 0
        cylinder,    // radius_mm about z, to half_height_mm either way
        cone,        // from its apex at the origin to radius_mm at z = height_mm
        asphere,     // z < s(r): curved towards +z where radius_of_curvature_mm is positive, flat at the vertex
        block,       // half_size_mm either way
    };
    Kind kind = Kind::sphere;
    Vec3 position_mm, rotation_rad;
    double radius_mm = 5, half_height_mm = 5, height_mm = 5;
    Vec3 half_size_mm{5, 5, 5};
    double radius_of_curvature_mm = 100, conic = 0;  // -1: a paraboloid
    std::vector<double> coefficients;                // of r^4, r^6, ... in mm^-3, mm^-5, ...
    double aperture_radius_mm = 10;                  // rim of the asphere; beyond it the height is linear in r^2
    std::vector<Shape> of;
};
struct SolidPart {
    Shape shape;
    double refractive_index = 1.5;
};
using Part = std::variant<NoPart, DoubleConvexLens, Wedge, PlanoConvexLens, CylinderLens, Plate, Vial, SolidPart>;

struct AirBubble {  // a sphere of index 1 inside the part
    Vec3 centre_mm;
    double radius_mm = 0.5;
};
struct SphericalCut {  // a sphere of index 1 that bites into the surface
    Vec3 centre_mm;
    double radius_mm = 1;
};
struct Dimple {  // a shallow hollow: a cut by a sphere so large that its rim deflects light by mrad
    Vec3 centre_mm;
    double radius_mm = 15;
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
    double abbe_number = 0;
    // Instead of a ball: a lens of this radius, a quarter as thick as wide, that deflects light by kSoftRim times the
    // difference of the indices at its rim, and evenly less towards its middle. An inclusion whose index fades out has
    // no steep flanks.
    bool soft = false;
    static constexpr double kSoftRim = 16.0 / 15;  // 2 tan of the caps' slope: sin = 8 / 17
};
struct Scratch {  // a round groove of this radius along a straight line
    Vec3 from_mm, to_mm;
    double radius_mm = 0.05;
};
struct Absorber {  // a ball of dark glass inside the part
    Vec3 centre_mm;
    double radius_mm = 0.5;
    bool opaque = false;
    double absorption_per_mm = 1;  // natural: exp(-absorption * length) passes; not used where opaque
};
struct Stria {  // a straight thread of glass of slightly another index
    Vec3 from_mm, to_mm;
    double radius_mm = 0.1;
    double index_difference = 1e-3;
    // Instead of round: its thickness along the light falls evenly from 2 radius_mm in the middle to 0 at its edges,
    // and both halves deflect light by 2 index_difference. A stria whose index fades out has no steep flanks.
    bool soft = false;
};
// A disc across the light that scatters: structures far smaller than a lenslet spread the slopes of what passes by a
// Gaussian. No light is lost. Its plane is the one that the camera sees sharply, or near it: light is spread, not
// moved.
struct Haze {
    Vec3 centre_mm;
    double radius_mm = 0.5;
    double scatter_rad = 0.015;  // rms along each axis
};
using SceneDefect =
    std::variant<AirBubble, SphericalCut, AbsorbingSpeck, Inclusion, Scratch, Absorber, Stria, Haze, Dimple>;

constexpr double kLineD = 587.56;  // nm; refractive indices are given for this wavelength

// Dispersion and absorption of the part's glass; 0: none.
struct Glass {
    double abbe_number = 0;        // (n_d - 1) / (n_F - n_C); n = a + b / wavelength^2 (Cauchy)
    double absorption_per_mm = 0;  // natural
};

struct Pose {
    double x_mm = 0, y_mm = 0;  // shift of the part on the measurement plane
    double rotation_rad = 0;    // about z
    // Before that, in the part's own frame: tilted about x, then y, then moved along the light.
    double tilt_x_rad = 0, tilt_y_rad = 0, z_mm = 0;
};

struct Collimator {
    double direction_x_rad = 0, direction_y_rad = 0;  // slope of its light
    double radius_rad = 0.00915;                      // angular radius of its disc
    double wavelength_nm = kLineD;
    double bandwidth_nm = 0;  // full width of its even spectrum
    double power = 1;         // radiance; 1 fills a bin to full_bin_dn
};

struct Light {
    double source_radius_bins = 0.61;  // angular radius of the one collimated source, bin pitches
    double wavelength_nm = kLineD;
    double bandwidth_nm = 0;
    std::vector<Collimator> collimators;  // in place of that one
};

// Each effect is on if its size is above 0.
struct Relay {
    double f1_mm = 100, f2_mm = 100;  // of the 4f camera's lenses; their distances from part and array
    double stop_radius_mm = 0;        // in the focal plane that they share
    double lens1_radius_mm = 0, lens2_radius_mm = 0;
};

// What lies on a surface of the camera's optics. It stays where it is when the part moves.
struct Dust {
    enum class Plane : std::uint8_t { lens1, stop, lens2, lenslets };
    Plane plane = Plane::lens1;
    double x_mm = 0, y_mm = 0, radius_mm = 0.1;  // on that surface
    double transmission = 0;
};

// The lenslet array and where its lenslets are on the sensor (array_geometry.h). The default is aligned, one pixel
// a bin.
struct LensletArray {
    double pitch_um = 0, focal_um = 0;  // 0: unset; with the relay they determine field_mm and bin_pitch_rad
    bool hexagonal = false;   // rows packed at sqrt(3)/2 of the pitch, every second one half a pitch to the right
    double pitch_px = 0;      // 0: as many pixels as there are bins
    double rotation_rad = 0;  // of the array on the sensor
    double offset_x_px = 0, offset_y_px = 0;
    double tilt_x_rad = 0,
           tilt_y_rad = 0;            // about the sensor's axes: pitches shrink, and distances to the sensor differ
    double distortion = 0;            // k1: centres move out by k1 r^2, r = 1 at half the sensor's longer side
    int width_px = 0, height_px = 0;  // of the sensor; 0: as large as the array
    double dead_share = 0;            // of lenslets without light, drawn by the scene's seed
    struct Lenslet {
        int m = 0, n = 0;
    };
    std::vector<Lenslet> dead;  // and these
};

// A conventional plenoptic camera, to compare: one lens between part and lenslets in place of the relay (the paper's
// Fig. 1).
struct MainLens {
    double focal_mm = 0;     // 0: there is none, the camera is a 4f
    double distance_mm = 0;  // from the measurement plane; beyond the focal length
};

struct Camera {
    algo::Extents extents{111, 111, 9, 9};
    double field_mm = 24;          // width of the lenslet field on the measurement plane
    double bin_pitch_rad = 0.015;  // slope of one bin
    int bits = 8;
    double full_bin_dn = 240;  // DN of a bin filled by the source, before noise
    Relay relay;
    LensletArray array;
    MainLens main_lens;
    std::vector<Dust> dust;
};

// The part moves along while the strobe is lit.
struct Motion {
    double velocity_x_mm_s = 0, velocity_y_mm_s = 0;
    double strobe_us = 0;
    [[nodiscard]] double way_x_mm() const { return velocity_x_mm_s * strobe_us * 1e-6; }
    [[nodiscard]] double way_y_mm() const { return velocity_y_mm_s * strobe_us * 1e-6; }
};

// Effects that are on or off. Other effects are on if their parameters are set (lab/optics/effects.h lists all).
struct Effects {
    bool fresnel = false;      // light lost by reflection at every face
    bool ghosts = false;       // that light, where two reflections bring it to the camera; needs fresnel
    bool diffraction = false;  // blur by the lenslets' square apertures; needs the array's pitch and focal length
    bool crosstalk = false;    // light beyond a lenslet's bins falls into its neighbours' (3x3), instead of being lost
};

// The conventional telecentric camera, for comparison: it sees along the axis, with a light panel behind the part.
struct TelecentricCamera {
    int width_px = 333, height_px = 333;
    double field_mm = 24;           // width
    double panel_half_mm = 60;      // half side of the square panel
    double panel_distance_mm = 40;  // from the measurement plane
    int rays_per_side = 4;          // squared: rays a pixel
};

// The linear sensor of EMVA 1288. Quantisation and saturation at the last DN are always there.
struct SensorNoise {
    double electrons_per_dn = 0;     // 1 / system gain; 0: no photon noise
    double read_e = 0;               // temporal dark noise, rms electrons
    double dark_dn = 0;              // pedestal
    double dark_e_per_s = 0;         // dark current: electrons a second and pixel, with their shot noise
    double exposure_ms = 1;          // for which it flows
    double dsnu_e = 0;               // rms of the pixels' dark offsets, electrons
    double prnu = 0;                 // rms of the pixels' sensitivities about 1
    double full_well_e = 0;          // electrons that a pixel holds; 0: more than the last DN shows
    std::uint64_t pattern_seed = 1;  // of dsnu and prnu: the camera's own, the same in every frame
    bool photon_noise = true;        // false: electrons are counted without their shot noise

    // Whether two frames of a scene differ by their seed.
    [[nodiscard]] bool is_random() const { return electrons_per_dn > 0 && (photon_noise || read_e > 0); }
};

struct Scene {
    std::string name = "scene";
    std::uint64_t seed = 1;
    Part part;
    Glass glass;
    std::vector<SceneDefect> defects;
    Pose pose;
    Motion motion;
    Light light;
    Camera camera;
    SensorNoise noise;
    Effects effects;
    TelecentricCamera telecentric;
};

// A problem that prevents rendering. `table` and `key` are those of the scene file (docs/scene.md).
struct SceneProblem {
    std::string table;      // "part", "pose", "light", "camera.relay", "noise", "defect", ...
    std::size_t index = 0;  // which defect, collimator or grain of dust, from 0
    std::string key, what, cure;
    [[nodiscard]] std::string message() const;
};

// All of them; none when the scene can be rendered.
std::vector<SceneProblem> problems(const Scene& scene);

// The scene's collimators: those it lists, else the one of source_radius_bins.
std::vector<Collimator> collimators_of(const Scene& scene);

// Whether any of its glasses has dispersion.
bool is_dispersive(const Scene& scene);

// The part's refractive index at kLineD; 1 without a part.
double index_of(const Part& part);

// The presets' names in scene files, as `part.kind` and `defect.kind`.
std::string_view name_of(const Part& part);
std::string_view name_of(const SceneDefect& defect);

// Fails with unreadable/invalid_argument; every problem of the file at once, each with its line and cure.
Result<Scene> load_scene(const std::filesystem::path& file);

}  // namespace hord::sim
