// Effects that exclude each other in a scene file, and the field that follows from its lenslet array.
#include <filesystem>
#include <fstream>
#include <string>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "hal_sim/optics/scene/scene.h"

namespace hord::sim {
namespace {

using ::testing::HasSubstr;

std::string refusal(const std::string& text) {
    const auto file = std::filesystem::path(::testing::TempDir()) / "effects_refusal.toml";
    std::ofstream(file) << text;
    const auto scene = load_scene(file);
    return scene ? std::string("accepted") : scene.error().message();
}

TEST(Effects, that_contradict_one_another_are_refused_all_at_once_with_line_and_cure) {
    const std::string all = refusal(R"([part]
kind = "plate"
abbe_number = 60
[effects]
ghosts = true
crosstalk = true
[camera.relay]
stop_radius_mm = 5
[motion]
velocity_mm_s = [500, 0]
[[defect]]
kind = "absorber"
opaque = true
absorption_per_mm = 2
[camera.array]
pitch_um = 100
)");
    EXPECT_THAT(all, HasSubstr(":3: part.abbe_number: changes nothing at the one wavelength"));
    EXPECT_THAT(all, HasSubstr(":5: effects.ghosts: are made of the light that fresnel splits off: name fresnel, too"));
    EXPECT_THAT(all, HasSubstr(":8: camera.relay.stop_radius_mm: lets no light beyond the bins' range"));
    EXPECT_THAT(all, HasSubstr(":9: motion.strobe_us: is 0"));
    EXPECT_THAT(all, HasSubstr(":14: defect[0].absorption_per_mm: contradicts opaque = true"));
    EXPECT_THAT(all, HasSubstr(":16: camera.array.pitch_um: stands alone"));
    EXPECT_THAT(refusal("[light]\nsource_radius_bins = 1\n[[light.collimator]]\npower = 1\n"),
                HasSubstr(":2: light.source_radius_bins: is of the one source"));
    EXPECT_THAT(refusal("[light]\n[[light.collimator]]\npower = 0\n"), HasSubstr("no collimator gives light"));
    EXPECT_THAT(refusal("[camera]\nfield_mm = 20\n[camera.array]\npitch_um = 100\nfocal_um = 300\n"),
                HasSubstr(":2: camera.field_mm: is said by camera.array"));
    const std::string haze = "[[defect]]\nkind = \"haze\"\ncentre_mm = [0, 0, 0]\n",
                      plate = "[part]\nkind = \"plate\"\n";
    EXPECT_EQ(refusal(plate + haze), "accepted");
    EXPECT_THAT(refusal(plate + haze + haze), HasSubstr(":7: defect[1].kind: is a second haze"));
    EXPECT_THAT(refusal(plate + haze + "[[dust]]\nplane = \"lens1\"\n"),
                HasSubstr("cannot be rendered with diffraction"));
    EXPECT_THAT(refusal("[part]\nabbe_number = 60\n"), HasSubstr("there is no glass to have a colour"));
    EXPECT_THAT(refusal("[[dust]]\nplane = \"lens3\"\n"),
                HasSubstr("did you mean lens1? It is one of lens1, stop, lens2, lenslets"));
    EXPECT_THAT(refusal("[motion]\nvelocity_mm_s = [1, 0]\nstrobe_us = 1e7\n"), HasSubstr("lenslets while it is lit"));
}

TEST(Effects, the_array_and_the_relay_say_field_and_bin_pitch) {
    const auto file = std::filesystem::path(::testing::TempDir()) / "effects_array.toml";
    std::ofstream(file) << "[camera]\nm = 100\ni = 9\n[camera.relay]\nf1_mm = 200\nf2_mm = "
                           "100\n[camera.array]\npitch_um = 90\nfocal_um = 500\n";
    const Scene scene = *load_scene(file);
    EXPECT_NEAR(scene.camera.field_mm, 100 * 0.09 * 2, 1e-12);
    EXPECT_NEAR(scene.camera.bin_pitch_rad, 0.01 / 0.5 / 2, 1e-12);
}

}  // namespace
}  // namespace hord::sim
