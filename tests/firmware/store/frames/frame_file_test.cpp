// One retained frame as a file: whole, or recognised as torn.

#include <random>

#include <nlohmann/json.hpp>

#include "firmware/store/frames/frame_metadata.h"
#include "firmware/store/frames/frame_png.h"
#include "tests/firmware/store/frames/retained_parts.h"

namespace hord::firmware::store::test {
namespace {

using Json = nlohmann::json;

TEST(FrameMetadata, has_the_bits_of_a_sample) {
    FrameMetadata metadata;
    metadata.bits = 12;
    metadata.grid = kExtents;
    EXPECT_EQ(Json::parse(metadata.to_json()).at("bits"), 12);
}

TEST(FrameMetadata, its_maps_are_those_that_the_inspection_made) {
    const std::vector<float> map(6, 1.5F);
    const std::vector<std::uint8_t> mask(6, 1);
    algo::Inspection inspection;
    inspection.gradient = inspection.frobenius = inspection.transmission = inspection.z_score = map;
    inspection.mask = mask;
    for (const bool compares : {true, false}) {
        inspection.compares = compares ? std::optional(algo::Feature::emd) : std::nullopt;
        EXPECT_EQ(bytes_of_maps(inspection).size(), 6 * ((compares ? 3 : 4) * sizeof(float) + 1)) << compares;
    }
}
TEST(FrameMetadata, of_before_two_reasons_were_renamed_is_read_with_the_present_names) {
    FrameMetadata data;
    data.grid = kExtents;
    data.role = "reject";
    data.judgement = {"reject", "slope", 1.5F, Json::array(), ""};
    EXPECT_EQ(FrameMetadata::from_json(data.to_json(), "frame").value().judgement.reason, "deflection-gradient");
    data.judgement.reason = "deflection";
    EXPECT_EQ(FrameMetadata::from_json(data.to_json(), "frame").value().judgement.reason, "neighbours-disagree");
}
TEST(FramePng, gives_back_every_bit_and_every_word) {
    for (const int bits : {8, 10, 12, 16}) {
        const Frame frame = part_frame(1, true, bits);
        const std::string text = "{\"recipe\":\"a \\\"b\\\"\\n µ\"}";
        const auto png = encode_png(frame.view(), text);
        ASSERT_TRUE(png) << png.error().message();
        const auto back = decode_png(*png, "f.png");
        ASSERT_TRUE(back) << back.error().message();
        EXPECT_EQ(back->frame.bits(), bits);
        EXPECT_TRUE(std::equal(frame.bytes().begin(), frame.bytes().end(), back->frame.bytes().begin(),
                               back->frame.bytes().end()));
        EXPECT_EQ(back->metadata, text);
    }
}

TEST(FramePng, recognises_every_cut_and_every_changed_byte) {
    const Frame frame = part_frame(1, true);
    const auto png = encode_png(frame.view(), "{}");
    ASSERT_TRUE(png);
    for (std::size_t length = 0; length < png->size(); length += 1 + length / 50) {
        EXPECT_FALSE(decode_png(std::span(*png).first(length), "f.png"))
            << "cut at " << length << " of " << png->size();
    }
    std::mt19937 random(7);
    for (int k = 0; k < 300; ++k) {
        auto changed = *png;
        changed[random() % changed.size()] ^= static_cast<std::uint8_t>(1U << (random() % 8));
        EXPECT_FALSE(decode_png(changed, "f.png")) << k;
    }
    auto longer = *png;
    longer.push_back(0);
    EXPECT_FALSE(decode_png(longer, "f.png"));
}

}  // namespace
}  // namespace hord::firmware::store::test
