// What hord-mqtt reads and keeps on the disk: its configuration, its secret, its cursor, and the store.
#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <iterator>

#include <fmt/format.h>
#include <sys/stat.h>

#include "common/crc32.h"
#include "firmware/mqtt/cursor.h"
#include "firmware/mqtt/mqtt_config.h"
#include "firmware/mqtt/result_feed.h"
#include "tests/firmware/store/results/samples.h"

namespace hord::firmware::mqtt::test {
namespace {

namespace fs = std::filesystem;
using store::test::read_text;
using store::test::TempFolder;
using store::test::write_text;
using ::testing::HasSubstr;
using ::testing::SizeIs;

std::string problems(const std::string& text) {
    const auto config = parse_mqtt_config(text, "mqtt.toml", "/etc/hord");
    return config ? "" : config.error().message();
}

TEST(MqttConfig, as_delivered_holds_every_key_at_its_default) {
    const auto config = load_mqtt_config(fs::path(HORD_SOURCE_DIR) / "deploy/mqtt.toml");
    ASSERT_TRUE(config) << config.error().message();
    const auto bare = parse_mqtt_config("", "empty", "/etc/hord");
    ASSERT_TRUE(bare) << bare.error().message();
    EXPECT_EQ(config->broker.host, bare->broker.host);
    EXPECT_EQ(config->broker.port, bare->broker.port);
    EXPECT_EQ(config->broker.protocol, bare->broker.protocol);
    EXPECT_EQ(config->broker.keepalive_s, bare->broker.keepalive_s);
    EXPECT_EQ(config->broker.client_id, bare->broker.client_id);
    EXPECT_EQ(config->node.group, bare->node.group);
    EXPECT_EQ(config->node.qos, bare->node.qos);
    EXPECT_EQ(config->node.in_flight, bare->node.in_flight);
    EXPECT_EQ(config->node.repeat, bare->node.repeat);
    EXPECT_EQ(config->node.history_per_s, bare->node.history_per_s);
    EXPECT_EQ(config->node.begin_with_all, bare->node.begin_with_all);
    EXPECT_EQ(config->store, bare->store);
    EXPECT_EQ(config->look_every, bare->look_every);
    EXPECT_EQ(config->station.port, bare->station.port);
}

TEST(MqttConfig, refuses_what_cannot_be_with_line_and_cure) {
    EXPECT_THAT(problems("[broker]\nhots = \"x\"\n"), HasSubstr("host"));
    EXPECT_THAT(problems("[broker]\nport = 0\n"), HasSubstr("mqtt.toml:2"));
    EXPECT_THAT(problems("[sparkplug]\nnode = \"a/b\"\n"), HasSubstr("cannot be part of a topic"));
    EXPECT_THAT(problems("[sparkplug]\ngroup = \"#\"\n"), HasSubstr("cannot be part of a topic"));
    EXPECT_THAT(problems("[tls]\nca = \"ca.pem\"\ncertificate = \"c.pem\"\n"), HasSubstr("needs the other of the two"));
    EXPECT_THAT(problems("[tls]\ncertificate = \"c.pem\"\nkey = \"k.pem\"\n"), HasSubstr("without an authority"));
    EXPECT_THAT(problems("[broker]\nhost = \"plant\"\nuser = \"u\"\npassword_file = \"p\"\n"),
                HasSubstr("readable for everybody"));
    EXPECT_THAT(problems("[broker]\npassword_file = \"p\"\n"), HasSubstr("without a user"));
    EXPECT_THAT(problems("[station]\nmodbus = \"::\"\n"), HasSubstr("not a Modbus address"));
    EXPECT_THAT(problems("[results]\nqos = 2\nin_flight = 0\n"), HasSubstr("in_flight"));
    const auto tls = parse_mqtt_config("[tls]\nca = \"ca.pem\"\n", "mqtt.toml", "/etc/hord");
    ASSERT_TRUE(tls);
    EXPECT_EQ(tls->broker.port, 8883);
    EXPECT_EQ(tls->broker.ca, "/etc/hord/ca.pem");
}

TEST(Cursor, is_of_one_process) {
    const TempFolder folder;
    const fs::path file = folder.path() / "cursor";
    {
        const auto lock = lock_cursor(file);
        ASSERT_TRUE(lock);
        const auto second = lock_cursor(file);
        ASSERT_FALSE(second);
        EXPECT_EQ(second.error().code, ErrorCode::busy);
        EXPECT_THAT(second.error().message(), HasSubstr("results.state_file"));
    }
    EXPECT_TRUE(lock_cursor(file)) << "its end ends the lock";
    EXPECT_TRUE(lock_cursor(folder.path() / "none" / "cursor")) << "writing tells what is wrong";
}

// Opening a pipe would wait for ever.
TEST(MqttConfig, refuses_pipes_in_the_place_of_the_files_that_it_names) {
    const TempFolder folder;
    const fs::path pipe = folder.path() / "pipe", file = folder.path() / "mqtt.toml";
    ASSERT_EQ(::mkfifo(pipe.c_str(), 0600), 0);
    for (const auto& [key, text] :
         {std::pair("broker.password_file", "[broker]\nuser = \"u\"\npassword_file = \"pipe\"\n"),
          std::pair("tls.ca", "[tls]\nca = \"pipe\"\n"),
          std::pair("tls.key", "[tls]\nca = \"ca\"\ncertificate = \"certificate\"\nkey = \"pipe\"\n"),
          std::pair("tls.certificate", "[tls]\nca = \"ca\"\ncertificate = \"pipe\"\nkey = \"key\"\n"),
          std::pair("results.state_file", "[results]\nstate_file = \"pipe\"\n")}) {
        write_text(file, text);
        const auto config = load_mqtt_config(file);
        ASSERT_FALSE(config) << key;
        EXPECT_EQ(config.error().message(),
                  std::string(key) + ": " + pipe.string() + " is a pipe, not a regular file: name a regular file");
    }
    EXPECT_THAT(read_secret(pipe).error().message(), HasSubstr(pipe.string() + " is a pipe, not a regular file"));
    EXPECT_THAT(read_cursor(pipe).error().message(), HasSubstr(pipe.string() + " is a pipe, not a regular file"));
}

TEST(MqttConfig, takes_a_password_that_only_its_owner_may_read) {
    const TempFolder folder;
    const fs::path file = folder.path() / "mqtt.password";
    EXPECT_THAT(read_secret(file).error().message(), HasSubstr("cannot be read"));
    write_text(file, "secret\r\nmore\n");
    ::chmod(file.c_str(), 0644);
    EXPECT_THAT(read_secret(file).error().message(), HasSubstr("chmod 600"));
    ::chmod(file.c_str(), 0600);
    EXPECT_EQ(read_secret(file).value(), "secret");
    write_text(file, "");
    EXPECT_THAT(read_secret(file).error().message(), HasSubstr("holds no password"));
    // The service manager's copy is used; the permissions of the original do not matter.
    fs::create_directory(folder.path() / "credentials");
    write_text(folder.path() / "credentials/mqtt.password", "from systemd\n");
    ::setenv("CREDENTIALS_DIRECTORY", (folder.path() / "credentials").c_str(), 1);
    EXPECT_EQ(read_secret(file).value(), "from systemd");
    write_text(folder.path() / "credentials/mqtt.password", "-");  // root has none
    EXPECT_THAT(read_secret(file).error().message(), HasSubstr(file.string() + " holds no password"));
    ::unsetenv("CREDENTIALS_DIRECTORY");
}

TEST(Cursor, is_read_as_it_was_written_and_a_damaged_one_is_refused) {
    const TempFolder folder;
    const fs::path file = folder.path() / "cursor";
    const auto none = read_cursor(file);
    ASSERT_TRUE(none);
    EXPECT_FALSE(*none);
    const Cursor cursor{"0123abcd", 5, 4711, 200, 3, 9};
    ASSERT_TRUE(write_cursor(file, cursor));
    EXPECT_EQ(read_cursor(file)->value(), cursor);
    const std::string whole = read_text(file);
    for (std::size_t size = 0; size < whole.size(); ++size) {
        write_text(file, whole.substr(0, size));
        EXPECT_FALSE(read_cursor(file)) << size;
    }
    for (std::size_t at = 0; at < whole.size(); ++at) {
        std::string changed = whole;
        changed[at] = static_cast<char>(changed[at] ^ 1);
        write_text(file, changed);
        const auto read = read_cursor(file);
        ASSERT_FALSE(read) << at;
        EXPECT_THAT(read.error().message(), HasSubstr("move it away"));
    }
    EXPECT_FALSE(write_cursor("/nowhere/cursor", cursor));
}

TEST(Cursor, with_numbers_that_it_cannot_have_is_refused_even_if_its_checksum_fits) {
    const TempFolder folder;
    const fs::path file = folder.path() / "cursor";
    const auto with = [&](const std::string& session, const std::string& lost) {
        const std::string text = R"({"store":"0123abcd","origin":5,"confirmed":4711,"bdSeq":)" + session +
            R"(,"lost":)" + lost + R"(,"lost_until":9})";
        write_text(file, fmt::format("{}\n{:08X}\n", text, common::crc32(text)));
        return read_cursor(file).has_value();
    };
    EXPECT_TRUE(with("255", "18446744073709551615"));
    for (const char* const session : {"256", "-1", "1.5", "8e64", "true", "\"1\""}) EXPECT_FALSE(with(session, "3"));
    for (const char* const lost : {"-3", "18446744073709551616", "3.0"}) EXPECT_FALSE(with("200", lost)) << lost;
}

TEST(ResultFeed, follows_a_store_that_is_being_written_and_notices_another) {
    const TempFolder folder;
    ResultFeed feed(folder.path());
    EXPECT_EQ(feed.look().error().code, ErrorCode::not_found);
    store::test::Story story;
    story.add_results(1, 5);
    const auto writer = store::test::open(folder);
    ASSERT_TRUE(writer->write(story.entries()));
    const auto where = feed.look();
    ASSERT_TRUE(where) << where.error().message();
    EXPECT_EQ(where->newest, 5);
    const auto some = feed.read(2, 2);
    ASSERT_TRUE(some);
    ASSERT_THAT(*some, SizeIs(2));
    EXPECT_EQ(some->front().number, 3);
    story.add_results(6, 12);
    ASSERT_TRUE(writer->write(story.entries()));
    EXPECT_EQ(feed.look()->newest, 12);
    EXPECT_THAT(*feed.read(5, 100), SizeIs(7));

    for (const auto& entry : fs::directory_iterator(folder.path())) {
        if (entry.path().filename().string().starts_with("results.db"))
            fs::rename(entry.path(), entry.path().string() + ".damaged");
    }
    EXPECT_FALSE(feed.look());
    const TempFolder elsewhere;
    store::test::write(elsewhere, store::test::Story().add_results(1, 1));
    fs::copy_file(elsewhere.path() / "results.db", folder.path() / "results.db");
    EXPECT_EQ(feed.look()->newest, 1);
    EXPECT_NE(feed.look()->id, where->id);
}

}  // namespace
}  // namespace hord::firmware::mqtt::test
