// Messages to a journal that reads, that takes nothing for a while, and that is not there.
#include "firmware/service/journal_socket.h"

#include <array>
#include <chrono>
#include <filesystem>
#include <string>
#include <vector>

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <unistd.h>

#include "tests/support/datagram_reader.h"

namespace hord::firmware {
namespace {

using ::testing::ElementsAre;
using ::testing::HasSubstr;
using Reader = testing_support::DatagramReader;

std::string first_line(const std::string& datagram) { return datagram.substr(0, datagram.find('\n')); }

class JournalSocketTest : public ::testing::Test {
  protected:
    JournalSocketTest() { std::filesystem::remove(path_); }
    ~JournalSocketTest() override { std::filesystem::remove(path_); }
    JournalSocketTest(const JournalSocketTest&) = delete;
    JournalSocketTest& operator=(const JournalSocketTest&) = delete;

    void write(const std::string& message) { journal_.write(entry_of(JournalEvent::trouble), message, {}); }
    // Writes `count` messages: "0", "1", ...
    void write_numbers(std::size_t count) {
        for (std::size_t k = 0; k < count; ++k) write(std::to_string(k));
    }
    // Until nothing comes any more.
    static std::vector<std::string> read_all(Reader& reader, JournalSocket& from) {
        std::vector<std::string> lines;
        for (;;) {
            from.flush();
            const std::vector<std::string> some = reader.read();
            if (some.empty()) return lines;
            for (const std::string& datagram : some) lines.push_back(first_line(datagram));
        }
    }

    const std::string path_ = ::testing::TempDir() + "journal-" + std::to_string(::getpid());
    JournalSocket journal_{path_};
};

TEST(JournalDatagram, has_a_length_before_a_value_of_several_lines) {
    const Entry entry{"0123", 4, "", "", ""};
    EXPECT_EQ(journal_datagram(entry, "one", std::array{Field{"HORD_STATE", "Ready"}}),
              "MESSAGE=one\nMESSAGE_ID=0123\nPRIORITY=4\nSYSLOG_IDENTIFIER=test_firmware_service\nHORD_STATE=Ready\n");
    std::string lines = "MESSAGE\n";
    lines += '\7';
    lines.append(7, '\0');
    lines += "one\ntwo\nMESSAGE_ID=0123\n";
    EXPECT_THAT(journal_datagram(entry, "one\ntwo", {}), HasSubstr(lines));
}

TEST_F(JournalSocketTest, does_not_wait_for_a_reader_that_takes_nothing_and_keeps_its_messages) {
    Reader reader(path_);
    const auto begun = std::chrono::steady_clock::now();
    write_numbers(common::DatagramQueue::kMaxWaiting);
    EXPECT_LT(std::chrono::steady_clock::now() - begun, std::chrono::seconds(10)) << "a reader that waits: for ever";
    const std::vector<std::string> got = read_all(reader, journal_);
    ASSERT_EQ(got.size(), common::DatagramQueue::kMaxWaiting);
    for (std::size_t k = 0; k < got.size(); ++k) EXPECT_EQ(got[k], "MESSAGE=" + std::to_string(k));
}

// The kernel keeps some, too: of twice as many messages some are lost.
TEST_F(JournalSocketTest, says_how_many_messages_were_lost_where_they_are_missing) {
    constexpr std::size_t kMany = 3 * common::DatagramQueue::kMaxWaiting;
    Reader reader(path_);
    write_numbers(kMany);
    std::vector<std::string> got = read_all(reader, journal_);
    ASSERT_GE(got.size(), common::DatagramQueue::kMaxWaiting);
    ASSERT_LT(got.size(), kMany);
    EXPECT_EQ(got.back(), "MESSAGE=" + std::to_string(got.size() - 1)) << "the last ones are lost";
    const std::size_t lost = kMany - got.size();
    write("after them");
    write("and again");
    EXPECT_THAT(read_all(reader, journal_),
                ElementsAre("MESSAGE=" + std::to_string(lost) +
                                " messages before this could not be written: the journal took nothing",
                            "MESSAGE=after them", "MESSAGE=and again"));
}

TEST_F(JournalSocketTest, keeps_messages_for_a_journal_that_starts_later_or_again) {
    write("early");
    {
        Reader reader(path_);
        EXPECT_THAT(read_all(reader, journal_), ElementsAre("MESSAGE=early"));
    }
    write("between");
    std::filesystem::remove(path_);
    Reader again(path_);
    EXPECT_THAT(read_all(again, journal_), ElementsAre("MESSAGE=between"));
}

TEST_F(JournalSocketTest, cuts_a_message_that_is_too_large_for_a_datagram) {
    Reader reader(path_);
    write(std::string(kMaxMessageBytes + 5, 'x'));
    write("next");
    EXPECT_THAT(read_all(reader, journal_),
                ElementsAre("MESSAGE=" + std::string(kMaxMessageBytes, 'x') + " ... (5 more bytes)", "MESSAGE=next"));
}

TEST_F(JournalSocketTest, is_not_waited_for_longer_than_asked_at_the_end) {
    write("nobody is there");
    const auto begun = std::chrono::steady_clock::now();
    journal_.finish(std::chrono::milliseconds(50));
    const auto waited = std::chrono::steady_clock::now() - begun;
    EXPECT_GE(waited, std::chrono::milliseconds(50));
    EXPECT_LT(waited, std::chrono::seconds(10));
}

}  // namespace
}  // namespace hord::firmware
