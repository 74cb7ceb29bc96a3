// The numbers of a scene file, table by table: each with its key, its place in the scene and its range.
//
// One list for two visitors: the reader (scene_file.cpp) uses the keys, the checks (scene_problems.cpp) also the
// ranges. `on` has number(), integer(), pair(), vector(), and number_or_none() for numbers that may also be 0.
#pragma once

#include <concepts>
#include <limits>
#include <type_traits>

#include "hal_sim/optics/scene/scene.h"

namespace hord::sim {

constexpr double kThinnest = 1e-6, kLargest = 1e4;  // mm

// T for the reader, const T for the checks.
template <class T, class... Plain>
concept Is = (std::same_as<std::remove_const_t<T>, Plain> || ...);

// -- parts

void fields(auto&, Is<NoPart> auto&) {}
void fields(auto& on, Is<DoubleConvexLens, PlanoConvexLens, CylinderLens> auto& lens) {
    on.number("radius_of_curvature_mm", lens.radius_of_curvature_mm, kThinnest, kLargest);
    if constexpr (requires { lens.aperture_radius_mm; }) {
        on.number("aperture_radius_mm", lens.aperture_radius_mm, kThinnest, kLargest);
    } else {
        on.number("half_width_mm", lens.half_width_mm, kThinnest, kLargest);
        on.number("half_length_mm", lens.half_length_mm, kThinnest, kLargest);
    }
    on.number("edge_thickness_mm", lens.edge_thickness_mm, 0, kLargest);
    on.number("refractive_index", lens.refractive_index, 1, 4);
}
void fields(auto& on, Is<Wedge> auto& wedge) {
    on.number("half_size_mm", wedge.half_size_mm, kThinnest, kLargest);
    on.number("centre_thickness_mm", wedge.centre_thickness_mm, kThinnest, kLargest);
    on.number("tilt_x_rad", wedge.tilt_x_rad, -1.2, 1.2);
    on.number("tilt_y_rad", wedge.tilt_y_rad, -1.2, 1.2);
    on.number("refractive_index", wedge.refractive_index, 1, 4);
}
void fields(auto& on, Is<Plate> auto& plate) {
    on.number("half_size_mm", plate.half_size_mm, kThinnest, kLargest);
    on.number("thickness_mm", plate.thickness_mm, kThinnest, kLargest);
    on.number("refractive_index", plate.refractive_index, 1, 4);
}
void fields(auto& on, Is<Waviness> auto& wave) {
    on.number("wavefront_nm", wave.wavefront_nm, 0, 1e6);
    on.number("period_mm", wave.period_mm, 0.01, kLargest);
    on.number("direction_rad", wave.direction_rad, -1e3, 1e3);
    on.number("phase_rad", wave.phase_rad, -1e3, 1e3);
}
void fields(auto& on, Is<Vial> auto& vial) {
    on.number("outer_radius_mm", vial.outer_radius_mm, kThinnest, kLargest);
    on.number("inner_radius_mm", vial.inner_radius_mm, kThinnest, kLargest);
    on.number("half_height_mm", vial.half_height_mm, kThinnest, kLargest);
    on.number("refractive_index", vial.refractive_index, 1, 4);
    on.number("contents_index", vial.contents_index, 1, 4);
}
void fields(auto& on, Is<SolidPart> auto& part) { on.number("refractive_index", part.refractive_index, 1, 4); }
void fields(auto& on, Is<Shape> auto& shape) {
    using Kind = Shape::Kind;
    on.vector("position_mm", shape.position_mm, -kLargest, kLargest);
    on.vector("rotation_rad", shape.rotation_rad, -1e3, 1e3);
    if (shape.kind == Kind::sphere || shape.kind == Kind::cylinder || shape.kind == Kind::cone)
        on.number("radius_mm", shape.radius_mm, kThinnest, kLargest);
    if (shape.kind == Kind::cylinder) on.number("half_height_mm", shape.half_height_mm, kThinnest, kLargest);
    if (shape.kind == Kind::cone) on.number("height_mm", shape.height_mm, kThinnest, kLargest);
    if (shape.kind == Kind::block) on.vector("half_size_mm", shape.half_size_mm, kThinnest, kLargest);
    if (shape.kind == Kind::asphere) {
        on.number_of_either_sign("radius_of_curvature_mm", shape.radius_of_curvature_mm, kThinnest, 1e6);
        on.number("conic", shape.conic, -1e3, 1e3);
        on.number("aperture_radius_mm", shape.aperture_radius_mm, kThinnest, kLargest);
    }
}
void fields(auto& on, Is<Glass> auto& glass) {
    on.number_or_none("abbe_number", glass.abbe_number, 10, 200);
    on.number("absorption_per_mm", glass.absorption_per_mm, 0, 1e3);
}
void fields(auto& on, Is<Pose> auto& pose) {
    on.number("x_mm", pose.x_mm, -kLargest, kLargest);
    on.number("y_mm", pose.y_mm, -kLargest, kLargest);
    on.number("rotation_rad", pose.rotation_rad, -1e3, 1e3);
    on.number("tilt_x_rad", pose.tilt_x_rad, -1.5, 1.5);
    on.number("tilt_y_rad", pose.tilt_y_rad, -1.5, 1.5);
    on.number("z_mm", pose.z_mm, -kLargest, kLargest);
}
void fields(auto& on, Is<Motion> auto& motion) {
    on.pair("velocity_mm_s", motion.velocity_x_mm_s, motion.velocity_y_mm_s, -1e5, 1e5);
    on.number("strobe_us", motion.strobe_us, 0, 1e7);
}

// -- defects: balls about a centre, threads from a place to another

void fields(auto& on, Is<AirBubble, SphericalCut, Dimple, AbsorbingSpeck, Inclusion, Absorber, Haze> auto& ball) {
    on.vector("centre_mm", ball.centre_mm, -kLargest, kLargest);
    on.number("radius_mm", ball.radius_mm, kThinnest, kLargest);
    if constexpr (requires { ball.transmission; }) on.number("transmission", ball.transmission, 0, 1);
    if constexpr (requires { ball.scatter_rad; }) on.number("scatter_rad", ball.scatter_rad, 1e-6, 0.5);
    if constexpr (requires { ball.refractive_index; }) on.number("refractive_index", ball.refractive_index, 1, 4);
    if constexpr (requires { ball.abbe_number; }) on.number_or_none("abbe_number", ball.abbe_number, 10, 200);
    if constexpr (requires { ball.absorption_per_mm; }) on.number("absorption_per_mm", ball.absorption_per_mm, 0, 1e6);
}
void fields(auto& on, Is<Scratch, Stria> auto& thread) {
    on.vector("from_mm", thread.from_mm, -kLargest, kLargest);
    on.vector("to_mm", thread.to_mm, -kLargest, kLargest);
    on.number("radius_mm", thread.radius_mm, kThinnest, kLargest);
    if constexpr (requires { thread.index_difference; })
        on.number("index_difference", thread.index_difference, -0.5, 0.5);
}

// -- light and camera

void fields(auto& on, Is<Light> auto& light) {
    on.number("source_radius_bins", light.source_radius_bins, 1e-3, 8);
    on.number("wavelength_nm", light.wavelength_nm, 300, 2000);
    on.number("bandwidth_nm", light.bandwidth_nm, 0, 1000);
}
void fields(auto& on, Is<Collimator> auto& source) {
    on.pair("direction_rad", source.direction_x_rad, source.direction_y_rad, -0.5, 0.5);
    on.number("radius_rad", source.radius_rad, 1e-6, 0.5);
    on.number("power", source.power, 0, 1e6);
    on.number("wavelength_nm", source.wavelength_nm, 300, 2000);
    on.number("bandwidth_nm", source.bandwidth_nm, 0, 1000);
}
void fields(auto& on, Is<Relay> auto& relay) {
    on.number("f1_mm", relay.f1_mm, 1e-3, kLargest);
    on.number("f2_mm", relay.f2_mm, 1e-3, kLargest);
    on.number("stop_radius_mm", relay.stop_radius_mm, 0, kLargest);
    on.number("lens1_radius_mm", relay.lens1_radius_mm, 0, kLargest);
    on.number("lens2_radius_mm", relay.lens2_radius_mm, 0, kLargest);
}
void fields(auto& on, Is<Dust> auto& dust) {
    on.number("x_mm", dust.x_mm, -kLargest, kLargest);
    on.number("y_mm", dust.y_mm, -kLargest, kLargest);
    on.number("radius_mm", dust.radius_mm, kThinnest, kLargest);
    on.number("transmission", dust.transmission, 0, 1);
}
void fields(auto& on, Is<LensletArray> auto& array) {
    on.number("pitch_um", array.pitch_um, 0, 1e5);
    on.number("focal_um", array.focal_um, 0, 1e6);
    on.number("pitch_px", array.pitch_px, 0, 128);
    on.number("rotation_rad", array.rotation_rad, -1e3, 1e3);
    on.pair("offset_px", array.offset_x_px, array.offset_y_px, -1e4, 1e4);
    on.pair("tilt_rad", array.tilt_x_rad, array.tilt_y_rad, -0.5, 0.5);
    on.number("distortion", array.distortion, -0.1, 0.1);
    on.integer("width_px", array.width_px, 0, 32768);
    on.integer("height_px", array.height_px, 0, 32768);
    on.number("dead_share", array.dead_share, 0, 1);
}
void fields(auto& on, Is<MainLens> auto& lens) {
    on.number("focal_mm", lens.focal_mm, 0, kLargest);
    on.number("distance_mm", lens.distance_mm, 0, kLargest);
}
void fields(auto& on, Is<Camera> auto& camera) {
    on.integer("m", camera.extents.m, algo::kMinLenslets, algo::kMaxLenslets);
    on.integer("n", camera.extents.n, algo::kMinLenslets, algo::kMaxLenslets);
    on.integer("i", camera.extents.i, algo::kMinBins, algo::kMaxBins);
    on.integer("j", camera.extents.j, algo::kMinBins, algo::kMaxBins);
    on.number("field_mm", camera.field_mm, 1e-3, 1e4);
    on.number("bin_pitch_rad", camera.bin_pitch_rad, 1e-6, 0.2);
    on.integer("bits", camera.bits, 8, 16);
    const bool depth = camera.bits >= 8 && camera.bits <= 16;  // else the last DN is undefined
    on.number("full_bin_dn", camera.full_bin_dn, depth ? 1 : -std::numeric_limits<double>::max(),
              depth ? (1 << camera.bits) - 1 : std::numeric_limits<double>::max());
}
void fields(auto& on, Is<SensorNoise> auto& noise) {
    on.number("electrons_per_dn", noise.electrons_per_dn, 0, 1e6);
    on.number("read_e", noise.read_e, 0, 1e6);
    on.number("dark_dn", noise.dark_dn, 0, 65535);
    on.number("dark_e_per_s", noise.dark_e_per_s, 0, 1e9);
    on.number("exposure_ms", noise.exposure_ms, 0, 1e6);
    on.number("dsnu_e", noise.dsnu_e, 0, 1e6);
    on.number("prnu", noise.prnu, 0, 0.5);
    on.number("full_well_e", noise.full_well_e, 0, 1e9);
}
void fields(auto& on, Is<TelecentricCamera> auto& camera) {
    on.integer("width_px", camera.width_px, 1, 8192);
    on.integer("height_px", camera.height_px, 1, 8192);
    on.number("field_mm", camera.field_mm, 1e-3, 1e4);
    on.number("panel_half_mm", camera.panel_half_mm, 1e-3, 1e4);
    on.number("panel_distance_mm", camera.panel_distance_mm, 1e-3, 1e4);
    on.integer("rays_per_side", camera.rays_per_side, 1, 64);
}

}  // namespace hord::sim
