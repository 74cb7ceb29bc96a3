// The connection to a rejector module: identification, wrong answers, reading of coils and registers.
#include "drivers/modbus/coil_link.h"

#include <thread>

#include <sys/socket.h>

#include "common/tcp_listener.h"
#include "tests/drivers/modbus/rejector_bench.h"
#include "tests/support/answering_server.h"

namespace hord::drivers {
namespace {

// An answer with `count` objects, of which these follow; it comes after `delay`.
Result<std::string> identification(int count, const std::string& objects, hal::Duration delay = {}) {
    const test::AnsweringServer server([&](const std::string& sent) {
        std::this_thread::sleep_for(delay);
        const std::string data = std::string("\x2b\x0e\1\1\0\0", 6) + static_cast<char>(count) + objects;
        const std::size_t length = data.size() + 1;
        return sent.substr(0, 4) + static_cast<char>(length >> 8U) + static_cast<char>(length) + sent[6] + data;
    });
    const auto loop = std::move(*firmware::SdEventLoop::open());
    CoilLink link(*loop, {.host = "127.0.0.1", .port = server.port()}, 10s);
    EXPECT_TRUE(link.connect());
    return link.identify();
}

TEST(Identification, is_read_no_further_than_its_answer) {
    const std::string first("\0\4Acme", 6);
    EXPECT_EQ(identification(2, first + std::string("\1\2X1", 4)).value_or("nothing"), "Acme X1");
    EXPECT_EQ(identification(1, first + std::string("\1\2X1", 4)).value_or("nothing"), "Acme");
    EXPECT_EQ(identification(3, first).value_or("nothing"), "Acme") << "objects are missing";
    EXPECT_EQ(identification(2, first + '\1').value_or("nothing"), "Acme") << "cut before a length";
    EXPECT_EQ(identification(2, first + std::string("\1\x63X1", 4)).value_or("nothing"), "Acme X1") << "cut in a text";
}

// The error of identify() on a module that gives this answer, "\1" standing for the unit.
Error unidentified(const std::string& answer, int unit = 1) {
    const test::AnsweringServer server([&](const std::string& sent) { return sent.substr(0, 2) + answer; });
    const auto loop = std::move(*firmware::SdEventLoop::open());
    CoilLink link(*loop, {.host = "127.0.0.1", .port = server.port(), .unit = unit}, 10s);
    EXPECT_TRUE(link.connect());
    const auto said = link.identify();
    EXPECT_FALSE(said) << *said;
    return said ? Error{} : said.error();
}

TEST(Identification, that_is_none_says_who_answers) {
    const std::string none("\0\0", 2), three("\0\3", 2), nine("\0\x9", 2), refused("\xAB", 1);
    struct Case {
        std::string answer;
        ErrorCode code;
        const char* what;
    };
    const Case cases[] = {
        {none + three + "\1" + refused + "\1", ErrorCode::unsupported, "has no device identification"},
        {none + three + "\1" + refused + "\xA", ErrorCode::refused, "a gateway does, in its place, for unit 1"},
        {none + three + "\1" + refused + "\xB", ErrorCode::refused, "a gateway does, in its place, for unit 1"},
        {none + three + "\7" + refused + "\1", ErrorCode::refused, "answers as unit 7, not as unit 1"},
        {none + std::string("\0\x9", 2) + "\7\x2b\xe\1\1" + std::string("\0\0\0", 3), ErrorCode::refused,
         "answers as unit 7, not as unit 1"},
        {std::string("\0\1", 2) + three + "\1" + refused + "\1", ErrorCode::unreadable, "not as a Modbus module does"},
        {std::string("\1\0", 2) + three + "\1" + refused + "\1", ErrorCode::unreadable, "not as a Modbus module does"},
        {none + three + "\1\x2a\1", ErrorCode::unreadable, "not as a Modbus module does"},
        {none + nine + "\1\x2b\xf\1\1" + std::string("\0\0\0", 3), ErrorCode::unreadable,
         "not as a Modbus module does"},
        {none + std::string("\0\x7", 2) + "\1\x2b\xe\1\1" + std::string("\0", 1), ErrorCode::unreadable,
         "not as a Modbus module does"},
        {none + std::string("\0\2", 2) + "\1" + refused, ErrorCode::timeout, "does not say what it is"},
    };
    for (const Case& one : cases) {
        const Error error = unidentified(one.answer);
        EXPECT_EQ(error.code, one.code) << one.what;
        EXPECT_THAT(error.what, HasSubstr(one.what));
        EXPECT_FALSE(error.cure.empty());
    }
    EXPECT_THAT(unidentified(none + three + "\7" + refused + "\xA", 7).what, HasSubstr("for unit 7"));
}

TEST(Identification, shows_letters_and_a_question_mark_for_what_is_none) {
    EXPECT_EQ(identification(1,
                             std::string("\0\6", 2) +
                                 std::string(" ~\x1f\x7f\xe9"
                                             "A",
                                             6))
                  .value_or("nothing"),
              " ~???A");
    EXPECT_EQ(identification(3,
                             std::string("\0\1"
                                         "A\1\0\2\1"
                                         "C",
                                         8))
                  .value_or("nothing"),
              "A  C")
        << "an empty object between two spaces";
}

TEST(Identification, that_never_ends_is_read_up_to_the_longest_answer) {
    const std::string long_one = std::string("\0\xC8", 2) + std::string(200, 'a');
    const auto said = identification(3, long_one + std::string("\1\xC8", 2) + std::string(200, 'b') + long_one);
    ASSERT_TRUE(said) << said.error().message();
    EXPECT_THAT(*said, testing::StartsWith(std::string(200, 'a')));
}

TEST(Identification, that_ends_with_the_connection_is_told_as_that_and_not_as_silence) {
    const test::AnsweringServer server([](const std::string&) { return std::string(); });
    const auto loop = std::move(*firmware::SdEventLoop::open());
    CoilLink link(*loop, {.host = "127.0.0.1", .port = server.port()}, 10s);
    ASSERT_TRUE(link.connect());
    const auto said = link.identify();
    ASSERT_FALSE(said);
    EXPECT_THAT(said.error().what, HasSubstr("closes the connection without an answer as unit 1"));
}

TEST(Identification, of_a_module_that_thinks_is_waited_for) {
    EXPECT_EQ(identification(1, std::string("\0\4Acme", 6), 50ms).value_or("nothing"), "Acme");
}

// What read(5) makes of this answer; the requests are those of the link, so that `change` may build on them.
template <class Change>
Result<bool> read_of(Change change, int times = 1) {
    const test::AnsweringServer server(change);
    const auto loop = std::move(*firmware::SdEventLoop::open());
    CoilLink link(*loop, {.host = "127.0.0.1", .port = server.port()}, 10s);
    Result<bool> done = false;
    for (int k = 0; k < times; ++k) {
        EXPECT_TRUE(link.connect());
        done = link.read(5);
    }
    EXPECT_EQ(link.connected(), done || done.error().code == ErrorCode::refused);
    return done;
}

// The header of the request with another length, then these bytes.
std::string with_pdu(const std::string& sent, const std::string& pdu) {
    return sent.substr(0, 4) + std::string(1, '\0') + static_cast<char>(pdu.size() + 1) + sent[6] + pdu;
}

TEST(CoilLink, asks_for_one_coil_and_takes_its_lowest_bit) {
    std::string asked;
    for (const char value : {'\0', '\1', '\2', '\xFF'}) {
        const auto read = read_of([&](const std::string& sent) {
            asked = sent;
            return with_pdu(sent, std::string("\1\1") + value);
        });
        ASSERT_TRUE(read) << read.error().message();
        EXPECT_EQ(*read, (value & 1) != 0);
    }
    EXPECT_EQ(asked, std::string("\0\1\0\0\0\6\1\1\0\5\0\1", 12));
}

TEST(CoilLink, tells_what_is_wrong_with_an_answer) {
    struct Case {
        std::string pdu;
        ErrorCode code;
        const char *what, *cure;
    };
    const Case cases[] = {
        {"\x81\1", ErrorCode::refused, "has no such output or register", "hordctl devices --module"},
        {"\x81\2", ErrorCode::refused, "has no such output or register", "rejector.profile"},
        {"\x81\3", ErrorCode::refused, "has no such output or register", "rejector.unit"},
        {"\x81\4", ErrorCode::refused, "coil 5 of the rejector module at 127.0.0.1:", "the module's own fault display"},
        {"\x81\6", ErrorCode::refused, "cannot be read: ", "the module's own fault display"},
        {"\x81\xA", ErrorCode::refused, "a gateway answers, not the module behind it", "behind the gateway"},
        {"\x81\xB", ErrorCode::refused, "a gateway answers, not the module behind it", "behind the gateway"},
        {"\x81\xC", ErrorCode::disconnected, "the answer is none of Modbus", "is the rejector's module really at"},
        {std::string("\x81\0", 2), ErrorCode::disconnected, "the answer is none of Modbus", "really at"},
        {"\2\1\1", ErrorCode::disconnected, "the answer is none of Modbus", "really at"},
        {"\1\2\1\1", ErrorCode::disconnected, "the answer is none of Modbus", "really at"},
    };
    for (const Case& one : cases) {
        const auto read = read_of([&](const std::string& sent) { return with_pdu(sent, one.pdu); });
        ASSERT_FALSE(read) << one.pdu;
        EXPECT_EQ(read.error().code, one.code) << one.what;
        EXPECT_THAT(read.error().what, HasSubstr(one.what));
        EXPECT_THAT(read.error().cure, HasSubstr(one.cure));
    }
}

TEST(CoilLink, takes_no_answer_to_another_request_and_says_so_of_that_request_alone) {
    for (const std::size_t at : {0U, 1U, 2U, 3U}) {
        const auto read = read_of([&](const std::string& sent) {
            std::string answer = with_pdu(sent, "\1\1\1");
            answer[at] = static_cast<char>(answer[at] + 1);
            return answer;
        });
        ASSERT_FALSE(read) << at;
        EXPECT_THAT(read.error().what, HasSubstr("the answer is none of Modbus"));
    }
    const auto of_another = [](std::string sent) {
        sent = with_pdu(sent, "\1\1\1");
        sent[6] = 9;
        return sent;
    };
    const auto first = read_of(of_another);
    ASSERT_FALSE(first);
    EXPECT_THAT(first.error().what, HasSubstr("unit 9 answers, not unit 1"));
    EXPECT_THAT(first.error().cure, HasSubstr("such as a gateway"));
    int answers = 0;
    const auto second = read_of(
        [&](const std::string& sent) { return ++answers == 1 ? of_another(sent) : with_pdu(sent, "\2\1\1"); }, 2);
    ASSERT_FALSE(second);
    EXPECT_THAT(second.error().what, HasSubstr("the answer is none of Modbus"));
}

TEST(CoilLink, that_is_not_connected_asks_nothing) {
    const auto loop = std::move(*firmware::SdEventLoop::open());
    CoilLink link(*loop, {.host = "127.0.0.1", .port = 1}, 1s);
    EXPECT_EQ(link.read(5).error().code, ErrorCode::disconnected);
    EXPECT_EQ(link.identify().error().code, ErrorCode::disconnected);
    const auto refused = link.connect();
    ASSERT_FALSE(refused);
    EXPECT_EQ(refused.error().code, ErrorCode::disconnected);
    EXPECT_THAT(refused.error().what, HasSubstr("127.0.0.1:1 cannot be reached: Connection refused"));
    EXPECT_FALSE(link.connected());
    EXPECT_EQ(link.typical_response(), hal::Duration::zero());
}

// Nobody accepts its connections, and its queue is full.
TEST(CoilLink, to_a_host_that_takes_no_connection_says_that_it_does_not_answer) {
    auto listener = common::listen_on("test", "127.0.0.1", 0);
    ASSERT_TRUE(listener);
    ASSERT_EQ(::listen(listener->get(), 0), 0);
    const auto loop = std::move(*firmware::SdEventLoop::open());
    const ModuleAddress address{.host = "127.0.0.1", .port = common::local_port(listener->get())};
    CoilLink first(*loop, address, 10s), second(*loop, address, 700ms);
    ASSERT_TRUE(first.connect());
    const hal::TimePoint from = loop->now();
    const auto unanswered = second.connect();
    EXPECT_GE(loop->now() - from, 700ms);
    ASSERT_FALSE(unanswered);
    EXPECT_EQ(unanswered.error().code, ErrorCode::timeout);
    EXPECT_THAT(unanswered.error().what, HasSubstr("does not answer"));
    EXPECT_THAT(unanswered.error().cure, HasSubstr("rejector.host"));
}

TEST(Registers, have_their_high_byte_first) {
    const test::AnsweringServer server([](const std::string& sent) {
        return sent.substr(0, 5) + std::string("\x07", 1) + sent.substr(6, 2) + std::string("\4\1\2\3\4");
    });
    const auto loop = std::move(*firmware::SdEventLoop::open());
    CoilLink link(*loop, {.host = "127.0.0.1", .port = server.port()}, 10s);
    ASSERT_TRUE(link.connect());
    EXPECT_THAT(link.read_registers(CoilLink::RegisterKind::holding, 0, 2).value_or(std::vector<std::uint16_t>{}),
                testing::ElementsAre(0x0102, 0x0304));
}

TEST(Registers, are_named_by_their_kind) {
    const test::AnsweringServer server([](const std::string& sent) {
        const char function = static_cast<char>(static_cast<unsigned char>(sent[7]) | 0x80U);
        return with_pdu(sent, {function, '\2'});
    });
    const auto loop = std::move(*firmware::SdEventLoop::open());
    CoilLink link(*loop, {.host = "127.0.0.1", .port = server.port()}, 10s);
    using Kind = CoilLink::RegisterKind;
    for (const auto& [kind, name] : {std::pair(Kind::holding, "register 7 of"), {Kind::input, "input register 7 of"}}) {
        ASSERT_TRUE(link.connect());
        EXPECT_THAT(link.read_registers(kind, 7, 1).error().what, testing::StartsWith(name));
    }
}

}  // namespace
}  // namespace hord::drivers
