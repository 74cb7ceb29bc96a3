#include "firmware/modbus/dispatcher.h"

#include <algorithm>
#include <map>
#include <random>
#include <vector>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

namespace hord::firmware::modbus {
namespace {

using ::testing::ElementsAre;
using ::testing::IsEmpty;
using Bytes = std::vector<std::uint8_t>;

// 200 registers and 200 bits, all writable; register 150 is busy.
class Memory : public RegisterModel {
  public:
    std::array<std::uint16_t, 200> words{};
    std::array<bool, 200> bits{};
    std::map<int, std::string> objects{{0, "V"}, {1, "P"}, {2, "1.0"}, {4, "Product"}, {0x80, "serial"}};
    std::vector<std::string> writers;

    Exception read_registers(std::uint16_t address, std::span<std::uint16_t> out) override {
        if (address + out.size() > words.size()) return Exception::illegal_address;
        std::copy_n(words.begin() + address, out.size(), out.begin());
        return Exception::none;
    }
    Exception read_bits(std::uint16_t address, std::span<bool> out) override {
        if (address + out.size() > bits.size()) return Exception::illegal_address;
        std::copy_n(bits.begin() + address, out.size(), out.begin());
        return Exception::none;
    }
    Exception write_registers(const Origin& origin, std::uint16_t address,
                              std::span<const std::uint16_t> values) override {
        if (address + values.size() > words.size()) return Exception::illegal_address;
        if (address == 150) return Exception::busy;
        std::copy(values.begin(), values.end(), words.begin() + address);
        writers.emplace_back(origin.peer);
        return Exception::none;
    }
    Exception write_bits(const Origin&, std::uint16_t address, std::span<const bool> values) override {
        if (address + values.size() > bits.size()) return Exception::illegal_address;
        std::copy(values.begin(), values.end(), bits.begin() + address);
        return Exception::none;
    }
    std::string_view identification(std::uint8_t object) const override {
        const auto found = objects.find(object);
        return found == objects.end() ? std::string_view{} : std::string_view(found->second);
    }
};

class Dispatcher : public ::testing::Test {
  protected:
    Memory memory;
    Bytes ask(const Bytes& request, bool may_write = true) {
        std::array<std::uint8_t, kMaxPdu> reply{};
        const std::size_t size = dispatch(memory, {.peer = "192.0.2.7:50123", .may_write = may_write}, request, reply);
        return {reply.begin(), reply.begin() + static_cast<std::ptrdiff_t>(size)};
    }
};

TEST_F(Dispatcher, reads_registers_high_byte_first_with_both_functions) {
    memory.words[0x6B] = 0x022B;
    memory.words[0x6D] = 0x0064;
    EXPECT_THAT(ask({3, 0, 0x6B, 0, 3}), ElementsAre(3, 6, 0x02, 0x2B, 0, 0, 0, 0x64));
    EXPECT_THAT(ask({4, 0, 0x6B, 0, 1}), ElementsAre(4, 2, 0x02, 0x2B));
}

TEST_F(Dispatcher, reads_bits_lowest_first_and_pads_with_zeros) {
    memory.bits[20] = memory.bits[22] = memory.bits[29] = true;
    EXPECT_THAT(ask({1, 0, 20, 0, 10}), ElementsAre(1, 2, 0b101, 0b10));
    EXPECT_THAT(ask({2, 0, 20, 0, 9}), ElementsAre(2, 2, 0b101, 0));
}

TEST_F(Dispatcher, reads_up_to_125_registers_and_no_more) {
    EXPECT_EQ(ask({3, 0, 0, 0, 125}).size(), 252U);
    EXPECT_THAT(ask({3, 0, 0, 0, 126}), ElementsAre(0x83, 3));
    EXPECT_THAT(ask({3, 0, 0, 0, 0}), ElementsAre(0x83, 3));
    EXPECT_THAT(ask({4, 0, 0, 1, 0}), ElementsAre(0x84, 3));
    EXPECT_THAT(ask({1, 0, 0, 0x07, 0xD1}), ElementsAre(0x81, 3)) << "2001 bits";
}

TEST_F(Dispatcher, an_address_outside_the_map_is_exception_02) {
    EXPECT_THAT(ask({3, 0, 200, 0, 1}), ElementsAre(0x83, 2));
    EXPECT_THAT(ask({3, 0, 199, 0, 2}), ElementsAre(0x83, 2));
    EXPECT_THAT(ask({3, 0xFF, 0xFF, 0, 2}), ElementsAre(0x83, 2)) << "past 65535";
    EXPECT_THAT(ask({16, 0, 199, 0, 2, 4, 0, 1, 0, 2}), ElementsAre(0x90, 2));
}

TEST_F(Dispatcher, an_unknown_function_is_exception_01) {
    for (const int function : {0, 7, 8, 11, 17, 20, 21, 24, 42, 44, 100, 127}) {
        EXPECT_THAT(ask({static_cast<std::uint8_t>(function), 0, 0, 0, 1}), ElementsAre(function | 0x80, 1))
            << function;
    }
    EXPECT_THAT(ask({0x83}), ElementsAre(0x83, 1)) << "an exception is no request";
    EXPECT_THAT(ask({43, 13, 0, 0}), ElementsAre(0xAB, 1)) << "another MEI type";
}

TEST_F(Dispatcher, a_request_of_the_wrong_length_is_exception_03) {
    const Bytes good[] = {{1, 0, 0, 0, 1},        {3, 0, 0, 0, 1},
                          {5, 0, 0, 0xFF, 0},     {6, 0, 0, 0, 1},
                          {15, 0, 0, 0, 1, 1, 1}, {16, 0, 0, 0, 1, 2, 0, 1},
                          {22, 0, 0, 0, 0, 0, 0}, {23, 0, 0, 0, 1, 0, 0, 0, 1, 2, 0, 1},
                          {43, 14, 1, 0}};
    for (Bytes request : good) {
        EXPECT_LT(ask(request)[0], 0x80) << int{request[0]};
        request.push_back(0);
        EXPECT_THAT(ask(request), ElementsAre(request[0] | 0x80, 3)) << int{request[0]};
        request.pop_back();
        while (request.size() > (request[0] == 43 ? 2U : 1U)) {
            request.pop_back();
            EXPECT_THAT(ask(request), ElementsAre(request[0] | 0x80, 3))
                << int{request[0]} << " with " << request.size();
        }
    }
}

TEST_F(Dispatcher, writes_one_register_or_bit_and_repeats_the_request) {
    EXPECT_THAT(ask({6, 0, 7, 0x12, 0x34}), ElementsAre(6, 0, 7, 0x12, 0x34));
    EXPECT_EQ(memory.words[7], 0x1234);
    EXPECT_THAT(memory.writers, ElementsAre("192.0.2.7:50123"));
    EXPECT_THAT(ask({5, 0, 7, 0xFF, 0}), ElementsAre(5, 0, 7, 0xFF, 0));
    EXPECT_TRUE(memory.bits[7]);
    EXPECT_THAT(ask({5, 0, 7, 0x01, 0}), ElementsAre(0x85, 3)) << "neither on nor off";
    EXPECT_TRUE(memory.bits[7]);
}

TEST_F(Dispatcher, writes_many_at_once) {
    EXPECT_THAT(ask({16, 0, 1, 0, 2, 4, 0, 0x0A, 0x01, 0x02}), ElementsAre(16, 0, 1, 0, 2));
    EXPECT_EQ(memory.words[1], 0x000A);
    EXPECT_EQ(memory.words[2], 0x0102);
    EXPECT_THAT(ask({15, 0, 19, 0, 10, 2, 0xCD, 0x01}), ElementsAre(15, 0, 19, 0, 10));
    EXPECT_THAT(std::vector(memory.bits.begin() + 19, memory.bits.begin() + 29),
                ElementsAre(true, false, true, true, false, false, true, true, true, false));
}

TEST_F(Dispatcher, a_byte_count_that_does_not_fit_the_count_is_exception_03) {
    EXPECT_THAT(ask({16, 0, 1, 0, 2, 3, 0, 1, 0}), ElementsAre(0x90, 3));
    EXPECT_THAT(ask({15, 0, 1, 0, 9, 1, 0xFF}), ElementsAre(0x8F, 3));
    EXPECT_THAT(ask({23, 0, 0, 0, 1, 0, 0, 0, 1, 4, 0, 1}), ElementsAre(0x97, 3));
    EXPECT_THAT(memory.writers, IsEmpty());
}

TEST_F(Dispatcher, mask_write_follows_the_specifications_formula) {
    memory.words[4] = 0x12;
    EXPECT_THAT(ask({22, 0, 4, 0, 0xF2, 0, 0x25}), ElementsAre(22, 0, 4, 0, 0xF2, 0, 0x25));
    EXPECT_EQ(memory.words[4], 0x17);
}

TEST_F(Dispatcher, read_write_writes_first_and_writes_nothing_when_it_cannot_read) {
    EXPECT_THAT(ask({23, 0, 3, 0, 2, 0, 4, 0, 1, 2, 0xAB, 0xCD}), ElementsAre(23, 4, 0, 0, 0xAB, 0xCD));
    EXPECT_THAT(ask({23, 0, 199, 0, 2, 0, 4, 0, 1, 2, 0, 0}), ElementsAre(0x97, 2));
    EXPECT_EQ(memory.words[4], 0xABCD);
}

TEST_F(Dispatcher, what_the_model_refuses_is_passed_on) { EXPECT_THAT(ask({6, 0, 150, 0, 1}), ElementsAre(0x86, 6)); }

TEST_F(Dispatcher, a_read_only_listener_knows_no_writing_function) {
    for (const Bytes& request :
         {Bytes{5, 0, 0, 0xFF, 0}, Bytes{6, 0, 0, 0, 1}, Bytes{15, 0, 0, 0, 1, 1, 1}, Bytes{16, 0, 0, 0, 1, 2, 0, 1},
          Bytes{22, 0, 0, 0, 0, 0, 0}, Bytes{23, 0, 0, 0, 1, 0, 0, 0, 1, 2, 0, 1}}) {
        EXPECT_THAT(ask(request, false), ElementsAre(request[0] | 0x80, 1));
    }
    EXPECT_THAT(memory.writers, IsEmpty());
    EXPECT_THAT(ask({3, 0, 0, 0, 1}, false), ElementsAre(3, 2, 0, 0));
}

TEST_F(Dispatcher, identifies_the_device) {
    EXPECT_THAT(ask({43, 14, 1, 0}), ElementsAre(43, 14, 1, 0x83, 0, 0, 3, 0, 1, 'V', 1, 1, 'P', 2, 3, '1', '.', '0'));
    EXPECT_THAT(ask({43, 14, 4, 0x80}), ElementsAre(43, 14, 4, 0x83, 0, 0, 1, 0x80, 6, 's', 'e', 'r', 'i', 'a', 'l'));
    EXPECT_EQ(ask({43, 14, 2, 0})[6], 4) << "regular: four objects";
    EXPECT_EQ(ask({43, 14, 3, 0})[6], 5) << "extended: all";
    EXPECT_EQ(ask({43, 14, 1, 9}), ask({43, 14, 1, 0})) << "a stream from an unknown object starts at the first";
    EXPECT_EQ(ask({43, 14, 1, 4}), ask({43, 14, 1, 0})) << "object 4 is known, and no basic one";
    EXPECT_THAT(ask({43, 14, 4, 9}), ElementsAre(0xAB, 2));
    EXPECT_THAT(ask({43, 14, 5, 0}), ElementsAre(0xAB, 3));
}

TEST_F(Dispatcher, long_identification_goes_on_in_the_next_request) {
    memory.objects[0] = std::string(200, 'v');
    memory.objects[1] = std::string(300, 'p');
    const Bytes first = ask({43, 14, 1, 0});
    EXPECT_THAT(std::vector(first.begin() + 4, first.begin() + 7), ElementsAre(0xFF, 1, 1))
        << "more follows from object 1";
    const Bytes second = ask({43, 14, 1, 1});
    EXPECT_THAT(std::vector(second.begin() + 4, second.begin() + 7), ElementsAre(0xFF, 2, 1));
    EXPECT_EQ(second[8], 244) << "cut to what fits";
    EXPECT_EQ(ask({43, 14, 1, 2})[4], 0) << "nothing more";
}

TEST_F(Dispatcher, whatever_the_request_the_reply_is_legal) {
    int exceptions = 0;
    for (std::uint32_t seed = 0; seed < 20'000; ++seed) {
        std::mt19937 random(seed);
        Bytes request(1 + random() % kMaxPdu);
        for (auto& byte : request) byte = static_cast<std::uint8_t>(random() % (seed % 3 == 0 ? 4 : 256));
        constexpr std::uint8_t functions[] = {1, 2, 3, 4, 5, 6, 15, 16, 22, 23, 43};
        if (seed % 2 == 0) request[0] = functions[random() % std::size(functions)];
        if (seed % 4 == 0) request.resize(std::min<std::size_t>(request.size(), 5));
        const Bytes reply = ask(request);
        ASSERT_GE(reply.size(), 2U) << seed;
        if (reply[0] >= 0x80) {
            ASSERT_EQ(reply[0], request[0] | 0x80);
            ASSERT_EQ(reply.size(), 2U);
            ++exceptions;
        } else {
            ASSERT_EQ(reply[0], request[0]);
        }
    }
    EXPECT_GT(exceptions, 1000);
    EXPECT_LT(exceptions, 20'000);
}

}  // namespace
}  // namespace hord::firmware::modbus
