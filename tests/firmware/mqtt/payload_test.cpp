// Payloads as bytes: compared with bytes written by hand and with protoc; untrusted input.
#include "firmware/mqtt/payload.h"

#include <cstdio>
#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <iterator>
#include <random>

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <unistd.h>

namespace hord::firmware::mqtt::test {
namespace {

using namespace std::string_literals;
using ::testing::HasSubstr;
using ::testing::SizeIs;

Metric metric(std::string name, MetricValue value, DataType type = DataType::none) {
    Metric made;
    made.name = std::move(name);
    made.type = type;
    made.value = std::move(value);
    return made;
}

TEST(Payload, is_written_with_the_published_field_numbers) {
    Payload payload;
    payload.time_ms = 300;
    payload.seq = 255;
    Metric one = metric("a", std::uint64_t{1}, DataType::uint64);
    one.alias = 2;
    one.time_ms = 3;
    one.historical = true;
    payload.metrics = {
        one, metric("", true), metric("", 0.5), metric("", "x"s), metric("", {}), metric("", std::int64_t{-1})};
    EXPECT_EQ(encode(payload),
              "\x08\xAC\x02"  // 1: 300
              "\x12\x0D\x0A\x01"
              "a"
              "\x10\x02\x18\x03\x20\x08\x28\x01\x58\x01"  // name, alias, time, type, historical, long
              "\x12\x02\x70\x01"                          // 14: true
              "\x12\x09\x69\0\0\0\0\0\0\xE0\x3F"          // 13: 0.5
              "\x12\x03\x7A\x01"
              "x"                                                     // 15
              "\x12\x02\x38\x01"                                      // 7: null
              "\x12\x0B\x58\xFF\xFF\xFF\xFF\xFF\xFF\xFF\xFF\xFF\x01"  // 11: -1
              "\x18\xFF\x01"s);                                       // 3: 255
}

TEST(Payload, that_was_written_is_read_as_it_was) {
    Payload payload;
    payload.time_ms = 1'790'000'000'000;
    payload.seq = 0;
    payload.metrics = {metric("Node Control/Rebirth", true, DataType::boolean), metric("b", -0.0, DataType::real),
                       metric("c", "\0\xFFµ"s, DataType::text)};
    payload.metrics[1].alias = ~0ULL;
    const auto back = decode_command(encode(payload));
    ASSERT_TRUE(back) << back.error().message();
    EXPECT_EQ(*back, payload);
}

TEST(Payload, of_strangers_is_read_or_refused_and_never_more_than_it_holds) {
    for (const std::string& bad : {"\x08"s, "\x12\x7F"s, "\x12\x05\x0A\xFF\xFF\xFF\x0F"s, "\x0B"s, "\x07"s, "\x00\x00"s,
                                   "\x08\xFF\xFF\xFF\xFF\xFF\xFF\xFF\xFF\xFF\x02"s,
                                   "\x12\xFF\xFF\xFF\xFF\xFF\xFF\xFF\xFF\xFF\x01"s, "\x0D\x01"s, "\x09\x01\x02\x03"s}) {
        EXPECT_FALSE(decode_command(bad)) << testing::PrintToString(bad);
    }
    EXPECT_TRUE(decode_command(""));
    EXPECT_TRUE(
        decode_command("\x2A\x03"
                       "abc"
                       "\x25\x01\x02\x03\x04\x98\x06\x01"s));  // unknown fields
    EXPECT_THAT(decode_command(std::string(kMaxCommandBytes + 1, 'x')).error().message(),
                HasSubstr("a command of more than 4096 bytes"));
    std::string many;
    for (std::size_t k = 0; k <= kMaxCommandMetrics; ++k) many += "\x12\x00"s;
    EXPECT_FALSE(decode_command(many));
    EXPECT_THAT(decode_command(many.substr(2))->metrics, SizeIs(kMaxCommandMetrics));

    std::mt19937 random(11);
    Payload payload;
    payload.time_ms = 1;
    payload.metrics = {metric("Node Control/Rebirth", true, DataType::boolean), metric("x", 1.5), metric("y", "text"s)};
    const std::string good = encode(payload);
    for (std::size_t size = 0; size < good.size(); ++size) (void)decode_command(std::string_view(good).substr(0, size));
    for (int k = 0; k < 200'000; ++k) {
        std::string bytes = k % 2 == 0 ? good : std::string(random() % 64, '\0');
        for (unsigned changes = 1 + random() % 8; changes > 0 && !bytes.empty(); --changes)
            bytes[random() % bytes.size()] = static_cast<char>(random());
        const auto read = decode_command(bytes);
        if (!read) continue;
        std::size_t held = 0;
        for (const Metric& m : read->metrics)
            held += m.name.size() +
                (std::holds_alternative<std::string>(m.value) ? std::get<std::string>(m.value).size() : 0);
        ASSERT_LE(held, bytes.size());
    }
}

// -- protoc, an independent implementation

std::string through_protoc(const std::string& mode, const std::string& input) {
    const auto folder = std::filesystem::temp_directory_path() / ("hord-protoc-" + std::to_string(::getpid()));
    std::filesystem::create_directories(folder);
    std::ofstream(folder / "in", std::ios::binary) << input;
    const std::string command = "protoc --" + mode +
        "=hord.sparkplug.Payload -I" HORD_SOURCE_DIR "/firmware/mqtt sparkplug_b.proto <" + (folder / "in").string() +
        " >" + (folder / "out").string();
    EXPECT_EQ(std::system(command.c_str()), 0) << command;
    std::ifstream in(folder / "out", std::ios::binary);
    std::string out{std::istreambuf_iterator<char>(in), {}};
    std::filesystem::remove_all(folder);
    return out;
}
bool have_protoc() { return std::system("command -v protoc >/dev/null") == 0; }

TEST(Payload, says_the_same_to_protoc) {
    if (!have_protoc()) GTEST_SKIP() << "protoc is not installed (apt-get install protobuf-compiler)";
    Payload payload;
    payload.time_ms = 1'790'000'000'000;
    payload.seq = 7;
    payload.metrics = {metric("Latency", std::uint64_t{4200}, DataType::uint64), metric("Score", 0.25, DataType::real),
                       metric("", {}, DataType::text)};
    payload.metrics[0].unit = "us";
    payload.metrics[0].alias = 20'114;
    payload.metrics[1].historical = true;
    const std::string text = through_protoc("decode", encode(payload));
    EXPECT_EQ(text,
              "timestamp: 1790000000000\n"
              "metrics {\n  name: \"Latency\"\n  alias: 20114\n  datatype: 8\n  properties {\n    keys: \"engUnit\"\n  "
              "  values {\n      type: 12\n      string_value: \"us\"\n    }\n  }\n"
              "  long_value: 4200\n}\n"
              "metrics {\n  name: \"Score\"\n  datatype: 10\n  is_historical: true\n  double_value: 0.25\n}\n"
              "metrics {\n  datatype: 12\n  is_null: true\n}\n"
              "seq: 7\n");
    EXPECT_EQ(through_protoc("encode", text), encode(payload));
}

TEST(Payload, of_protoc_is_read) {
    if (!have_protoc()) GTEST_SKIP() << "protoc is not installed (apt-get install protobuf-compiler)";
    const auto read =
        decode_command(through_protoc("encode",
                                      "timestamp: 9 metrics { name: \"Node Control/Rebirth\" timestamp: 8 datatype: 11 "
                                      "boolean_value: true } metrics { alias: 3 float_value: 1.5 }"));
    ASSERT_TRUE(read);
    ASSERT_THAT(read->metrics, SizeIs(2));
    EXPECT_EQ(read->metrics[0].name, "Node Control/Rebirth");
    EXPECT_EQ(read->metrics[0].value, MetricValue(true));
    EXPECT_EQ(read->metrics[1].alias, 3U);
    EXPECT_EQ(read->metrics[1].value, MetricValue(1.5));
}

}  // namespace
}  // namespace hord::firmware::mqtt::test
