#include "firmware/registers/register_map.h"

#include <bit>
#include <fstream>
#include <iterator>
#include <set>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "common/toml_library.h"
#include "firmware/core/faults.h"

namespace hord::firmware {
namespace {

using ::testing::ElementsAre;
using ::testing::HasSubstr;

Snapshot example() {
    Snapshot s;
    s.state = State::continuous_execution;
    s.run_permit = true;
    s.faults_latched = kFaultRejector | kFaultLightLevel;
    s.first_fault = 4;
    s.station_heartbeat = 0xFFFF;
    s.counters.seen = 0x00012345;
    s.counters.pass = 7;
    s.last = {.sequence = 0x10002,
              .part = 9,
              .arrived_ns = 12'345'678'901'234,
              .verdict = PartVerdict::reject,
              .reason = PartReason::deflection_gradient,
              .defects = 2,
              .score = 1.2345F,
              .latency_us = 4321,
              .reject_latency_us = 70000,
              .reject = RejectState::confirmed};
    return s;
}

std::vector<std::uint16_t> image_of(BlockId id, const Snapshot& snapshot, const StationIdentity& identity = {},
                                    const RegisterExtras& extras = {}) {
    const Block& block = *find_block(id);
    std::vector<std::uint16_t> image(block.size());
    encode(block, {.identity = identity, .snapshot = snapshot, .result = snapshot.last, .extras = extras}, image);
    return image;
}

// The literals come from the documentation, not from the table.
TEST(Registers, status_is_encoded_as_documented) {
    const auto image = image_of(BlockId::status, example());
    EXPECT_THAT(std::vector(image.begin(), image.begin() + 20),
                ElementsAre(2, 38,           // id, length
                            8,               // ContinuousExecution
                            0b010011,        // executing, run permit, latched fault
                            0xFFFF,          // heartbeat
                            0xFFFF,          // no PLC heartbeat yet
                            1, 2,            // last sequence 0x10002, high word first
                            0, 0xFF03,       // oldest: 255 before it
                            0xFFFF, 0, 0,    // no recipe
                            0, 0,            // active faults
                            0, 0b100001000,  // latched: rejector, light level
                            4,               // first: rejector
                            0, 0));          // parts on the line
    EXPECT_EQ(image.back(), 0xFFFF) << "a register without a row";
}

TEST(Registers, a_text_that_an_older_station_does_not_have_is_empty) {
    const Block& reply = *find_block(BlockId::reply);
    std::vector<std::uint16_t> image(reply.size(), 0xFFFF);
    image[0] = static_cast<std::uint16_t>(BlockId::reply), image[1] = reply.length;
    const auto readings = decode(reply, image);
    ASSERT_TRUE(readings);
    EXPECT_EQ(readings->back().what->name, "remarks");
    EXPECT_EQ(readings->back().text, "");
}

TEST(Registers, a_name_is_utf8_cut_between_two_characters) {
    const auto shown = [](const std::string& name) {
        RegisterExtras extras;
        extras.recipe.name = ShortText(name);
        std::vector<std::string> texts;
        for (const auto& [block, row] : {std::pair(BlockId::ident, "serial"), std::pair(BlockId::recipe, "name")}) {
            const auto image = image_of(block, example(), {.serial = name}, extras);
            const auto readings = decode(*find_block(block), image);
            for (const Reading& r : readings.value()) {
                if (r.what->name == row) texts.push_back(r.text);
            }
        }
        return texts;
    };
    EXPECT_THAT(shown("Zelle Süd"), ElementsAre("Zelle Süd", "Zelle Süd"));
    EXPECT_THAT(shown("€ 𝄞"), ElementsAre("€ 𝄞", "€ 𝄞"));
    const std::string all = std::string(30, 'x') + "ü";
    EXPECT_THAT(shown(all), ElementsAre(all, all)) << "32 bytes";
    const std::string fits(31, 'x');
    EXPECT_THAT(shown(fits + "ü"), ElementsAre(fits, fits));
    EXPECT_THAT(shown(fits + "𝄞"), ElementsAre(fits, fits));
    // What must not reach a terminal or is no UTF-8: control characters, Latin-1, overlong, surrogates, cut.
    for (const char* bad : {"a\x1B", "a\x7F", "a\xC2\x9B", "a\xFC", "a\xC0\xAF", "a\xE2\x82"})
        EXPECT_EQ(shown(bad)[0].substr(0, 2), "a?") << bad;
    EXPECT_THAT(shown("\xED\xA0\x80"), ElementsAre("???", "???"));
}

TEST(Registers, a_result_is_encoded_as_documented) {
    const auto image = image_of(BlockId::last, example());
    EXPECT_THAT(std::vector(image.begin() + 2, image.begin() + 26),
                ElementsAre(1, 2, 0, 9, 0, 12345, 678901 >> 16, 678901 & 0xFFFF, 2, 2, 2, 0, 1235, 0, 4321, 1, 4464, 2,
                            0xFFFF, 0xFFFF, 0xFFFF, 0b11, 1, 2));
}

TEST(Registers, a_result_by_upper_bounds_says_so_in_its_flags) {
    Snapshot s = example();
    s.last.bounded = true;
    EXPECT_EQ(image_of(BlockId::last, s)[23], 0b111);
}

TEST(Registers, before_the_first_result_its_values_are_not_available) {
    const auto readings = decode(*find_block(BlockId::last), image_of(BlockId::last, Snapshot{}));
    ASSERT_TRUE(readings);
    for (const Reading& reading : *readings) {
        const bool has_value = reading.what->name.starts_with("sequence") || reading.what->name == "flags";
        EXPECT_EQ(reading.text, reading.what->name == "flags" ? "none" : has_value ? "0" : "-") << reading.what->name;
    }
}

TEST(Registers, values_beyond_the_range_stop_short_of_the_sentinel) {
    Snapshot s = example();
    s.last.score = 1e30F;
    s.last.defects = 0xFFFF;
    const auto image = image_of(BlockId::last, s);
    EXPECT_EQ(image[12], 0xFFFE);
    EXPECT_EQ(image[13], 0xFFFF);
    EXPECT_EQ(image[14], 0xFFFE);
}

TEST(Registers, signed_values_keep_their_sign_and_stop_short_of_the_sentinel) {
    const auto decoded = [](double value) {
        RegisterExtras extras;
        extras.health.processor_celsius = extras.health.optics.dark_drift_dn = value;
        std::vector<std::string> texts;
        const auto readings = decode(*find_block(BlockId::health), image_of(BlockId::health, example(), {}, extras));
        for (const Reading& r : readings.value()) {
            if (r.what->name == "processor" || r.what->name == "dark_drift") texts.push_back(r.text);
        }
        return texts;
    };
    EXPECT_THAT(decoded(-12.5), ElementsAre("-12.5", "-12.50"));
    EXPECT_THAT(decoded(1e12), ElementsAre("3276.7", "21474836.47"));
    EXPECT_THAT(decoded(-1e12), ElementsAre("-3276.7", "-21474836.47"));
}

TEST(Registers, decoding_gives_back_names_units_and_values) {
    const StationIdentity identity{.firmware = "0.1.0", .serial = "H-0042", .boot_id = 0xDEADBEEF};
    std::string text;
    for (const BlockId id : {BlockId::ident, BlockId::status, BlockId::counters, BlockId::last}) {
        const auto readings = decode(*find_block(id), image_of(id, example(), identity));
        ASSERT_TRUE(readings);
        for (const Reading& r : *readings)
            text += std::string(r.what->name) + '=' + r.text + ' ' + std::string(r.what->unit) + '\n';
    }
    for (const char* line :
         {"magic=0x484F5244", "boot_id=0xDEADBEEF", "firmware=0.1.0", "serial=H-0042", "state=8 ContinuousExecution",
          "bits=executing, run_permit, fault_latched", "plc_heartbeat_age=- ms", "heartbeat=65535",
          "faults_latched=rejector, light-level", "first_fault=4 rejector", "seen=74565 parts", "verdict=2 reject",
          "reason=2 deflection-gradient", "score=1.235", "latency=4321 us", "reject_latency=70000 us",
          "reject_state=2 confirmed"}) {
        EXPECT_THAT(text, HasSubstr(line));
    }
}

TEST(Registers, a_shorter_block_of_an_older_station_is_decoded_as_far_as_it_goes) {
    auto image = image_of(BlockId::counters, example());
    image[1] = 4;
    const auto readings = decode(*find_block(BlockId::counters), image);
    ASSERT_TRUE(readings);
    EXPECT_EQ(readings->size(), 2U);
}

TEST(Registers, a_foreign_block_is_not_decoded) {
    const auto readings = decode(*find_block(BlockId::counters), image_of(BlockId::status, example()));
    ASSERT_FALSE(readings);
    EXPECT_EQ(readings.error().code, ErrorCode::unreadable);
}

std::string_view name_in_map(BlockId id, std::string_view row, std::uint32_t value) {
    for (const NamedValue& named : find_register(id, row)->values) {
        if (named.value == value) return named.name;
    }
    return "unknown";
}

TEST(Registers, every_reason_and_fault_has_the_cores_name) {
    int reasons = 0;
    for (std::uint16_t reason = 0; reason < 256; ++reason) {
        const std::string_view name = name_of(static_cast<PartReason>(reason));
        EXPECT_EQ(name_in_map(BlockId::last, "reason", reason), name);
        reasons += name == "unknown" ? 0 : 1;
    }
    EXPECT_GE(reasons, 20);
    for (const FaultInfo& fault : kFaultTable) {
        const auto bit = static_cast<std::uint32_t>(std::countr_zero(static_cast<std::uint32_t>(fault.bit)));
        EXPECT_EQ(name_in_map(BlockId::status, "faults_active", bit), fault.name);
        EXPECT_EQ(name_in_map(BlockId::status, "faults_latched", bit), fault.name);
        EXPECT_EQ(name_in_map(BlockId::status, "first_fault", bit + 1), fault.name);
    }
    EXPECT_EQ(find_register(BlockId::status, "faults_active")->values.size(), kFaultTable.size());
}

TEST(Registers, what_the_map_does_not_have_is_not_found) {
    EXPECT_EQ(find_block(static_cast<BlockId>(77)), nullptr);
    EXPECT_EQ(find_register(static_cast<BlockId>(77), "state"), nullptr);
    EXPECT_EQ(find_register(BlockId::status, "no such row"), nullptr);
    EXPECT_NE(find_register(BlockId::status, "state"), nullptr);
}

TEST(Registers, names_are_unique_in_their_block) {
    for (const Block& block : register_blocks()) {
        std::set<std::string_view> names;
        for (const Register& row : block.registers)
            EXPECT_TRUE(names.insert(row.name).second) << block.name << ' ' << row.name;
    }
}

TEST(Registers, the_documentation_in_the_tree_is_what_the_code_prints) {
    std::ifstream in(HORD_SOURCE_DIR "/docs/registers.md", std::ios::binary);
    const std::string tree{std::istreambuf_iterator<char>(in), std::istreambuf_iterator<char>()};
    EXPECT_EQ(tree, format_registers("md")) << "run: hordctl registers --format md > docs/registers.md";
}

TEST(Registers, the_constants_for_a_plc_in_the_tree_are_what_the_code_prints) {
    std::ifstream in(HORD_SOURCE_DIR "/deploy/plc/hord_registers.st", std::ios::binary);
    const std::string tree{std::istreambuf_iterator<char>(in), std::istreambuf_iterator<char>()};
    EXPECT_EQ(tree, format_registers("st")) << "run: hordctl registers --format st > deploy/plc/hord_registers.st";
}

TEST(Registers, rows_that_were_released_stay_where_they_are) {
    std::ifstream in(HORD_SOURCE_DIR "/tests/firmware/registers/registers_v1.csv");
    const std::string now = format_registers("csv");
    std::string line;
    int lines = 0;
    while (std::getline(in, line)) {
        ++lines;
        EXPECT_THAT(now, HasSubstr('\n' + line + ','))
            << "a released row may not move, change its type or scale, or go";
    }
    EXPECT_GT(lines, 40);
}

TEST(Registers, every_format_is_known_by_its_name) {
    for (const char* name : {"md", "csv", "json", "telegraf"}) {
        EXPECT_THAT(format_registers(name), HasSubstr("reject_confirmed"));
    }
    EXPECT_THAT(format_registers("csv"), HasSubstr(",degC,0.1,r,\"temperature\",\"\"\n"));
    EXPECT_THAT(format_registers("st"), HasSubstr("HORD_COUNTERS_REJECT_CONFIRMED : UINT := 156;"));
}

TEST(Registers, telegraf_is_told_each_number_with_its_address_and_type) {
    const toml::table all = toml::parse(format_registers("telegraf"));
    const auto* requests = all.at_path("inputs.modbus[0].request").as_array();
    ASSERT_NE(requests, nullptr);
    std::size_t told = 0;
    for (const Block& block : register_blocks()) {
        if (block.id == BlockId::ident || block.registers.empty()) continue;
        std::string measurement = "hord_" + std::string(block.name);
        for (char& c : measurement) c = static_cast<char>(std::tolower(static_cast<unsigned char>(c)));
        const toml::table* request = nullptr;
        for (const auto& candidate : *requests) {
            if (candidate.at_path("measurement").value<std::string>() == measurement) request = candidate.as_table();
        }
        ASSERT_NE(request, nullptr) << measurement;
        EXPECT_EQ(request->at_path("register").value<std::string>(), "holding");
        for (const Register& row : block.registers) {
            if (row.type == RegisterType::text) continue;
            ++told;
            const toml::table* field = nullptr;
            for (const auto& candidate : *request->at_path("fields").as_array()) {
                if (candidate.at_path("address").value<int>() == int{row.address}) field = candidate.as_table();
            }
            ASSERT_NE(field, nullptr) << row.name;
            EXPECT_EQ(field->at_path("name").value<std::string>(), std::string(row.name));
            EXPECT_EQ(field->at_path("scale").value_or(1.0), row.scale) << row.name;
            const std::string type = field->at_path("type").value_or<std::string>("");
            EXPECT_TRUE(type.ends_with(row.words == 2 ? "32" : "16")) << row.name << ' ' << type;
            EXPECT_EQ(type.starts_with("INT"), row.type == RegisterType::s16 || row.type == RegisterType::s32)
                << row.name;
        }
    }
    EXPECT_GT(told, 60U);
}

}  // namespace
}  // namespace hord::firmware
