#include "firmware/plc/register_server_model.h"

#include <atomic>
#include <thread>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

namespace hord::firmware {
namespace {

using modbus::Exception;
using ::testing::ElementsAre;
using Words = std::vector<std::uint16_t>;

// Every field contains its sequence number, so that a mixture of two results is detected.
PartResult result_of(std::uint32_t sequence) {
    return {.sequence = sequence,
            .part = sequence ^ 0x55AA55AA,
            .arrived_ns = std::int64_t{sequence} * 1'000'000'000,
            .verdict = sequence % 2 == 0 ? PartVerdict::pass : PartVerdict::reject,
            .reason = PartReason::none,
            .defects = static_cast<std::uint16_t>(sequence % 1000),
            .score = 0.5F,
            .latency_us = sequence * 3,
            .reject_latency_us = sequence * 5,
            .reject = RejectState::confirmed};
}

Snapshot snapshot_of(State state, std::uint32_t seen, const PartResult& last) {
    Snapshot snapshot;
    snapshot.state = state;
    snapshot.counters.seen = seen;
    snapshot.counters.reject_late = ~seen & 0x7FFFFFFF;
    snapshot.last = last;
    return snapshot;
}

class Image : public ::testing::Test {
  protected:
    RegisterServerModel image{StationIdentity{.vendor = "V", .firmware = "0.1.0", .serial = "S", .boot_id = 0xB007}};
    Words read(std::uint16_t address, std::size_t count) {
        Words words(count);
        EXPECT_EQ(image.read_registers(address, words), Exception::none) << address;
        return words;
    }
    Exception outcome(std::uint16_t address, std::size_t count) {
        Words words(count);
        return image.read_registers(address, words);
    }
    void publish_results(std::uint32_t from, std::uint32_t to) {
        std::vector<PartResult> all;
        for (std::uint32_t s = from; s <= to; ++s) all.push_back(result_of(s));
        image.publish(snapshot_of(State::ready, to, all.back()), all);
    }
};

TEST_F(Image, the_chain_leads_from_the_first_block_to_the_end) {
    Words ids;
    std::uint16_t base = 0;
    while (ids.size() < 64) {
        const Words header = read(base, 2);
        ids.push_back(header[0]);
        if (header[0] == 0xFFFF) break;
        base = static_cast<std::uint16_t>(base + 2 + header[1]);
    }
    EXPECT_THAT(ids, ElementsAre(1, 2, 3, 4, 0, 5, 0, 6, 7, 8, 9, 0, 10, 11, 0xFFFF));
    EXPECT_EQ(base, 8600);
}

TEST_F(Image, nothing_is_read_inside_a_gap_or_past_the_end) {
    EXPECT_EQ(outcome(300, 2), Exception::none) << "a gap's header";
    EXPECT_EQ(outcome(300, 3), Exception::illegal_address);
    EXPECT_EQ(outcome(997, 3), Exception::illegal_address);
    EXPECT_EQ(outcome(998, 125), Exception::none);
    EXPECT_EQ(outcome(7143, 3), Exception::none);
    EXPECT_EQ(outcome(7146, 1), Exception::illegal_address);
    EXPECT_EQ(outcome(7999, 2), Exception::illegal_address);
    EXPECT_EQ(outcome(8000, 125), Exception::none);
    EXPECT_EQ(outcome(8600, 2), Exception::none);
    EXPECT_EQ(outcome(8601, 2), Exception::illegal_address);
    EXPECT_EQ(outcome(65500, 36), Exception::illegal_address);
}

TEST_F(Image, every_part_of_a_request_is_what_single_reads_give) {
    publish_results(1, 20);
    for (const int address : {0, 50, 99, 120, 200, 998, 1013, 1100, 7046, 8000, 8090, 8200, 8400, 8480}) {
        const Words all = read(static_cast<std::uint16_t>(address), 100);
        for (int k = 0; k < 100; ++k) {
            const Words one = read(static_cast<std::uint16_t>(address + k), 1);
            ASSERT_EQ(all[static_cast<std::size_t>(k)], one[0]) << address << " + " << k;
        }
    }
}

TEST_F(Image, results_stand_in_the_ring_by_their_sequence) {
    publish_results(1, 300);
    const Words slot = read(address_of_result(300), kResultWords);
    EXPECT_EQ(address_of_result(300), 1000 + 24 * 44);
    EXPECT_EQ(slot[1], 300);
    EXPECT_EQ(slot[23], 300);
    EXPECT_THAT(read(202, 24), slot) << "LAST is the newest";
    EXPECT_EQ(read(address_of_result(45), 2)[1], 45) << "the oldest that is still there";
    EXPECT_THAT(read(106, 4), ElementsAre(0, 300, 0, 45));
}

TEST_F(Image, results_of_one_publication_appear_with_its_counters) {
    std::vector<PartResult> two{result_of(1), result_of(2)};
    image.publish(snapshot_of(State::ready, 2, two.back()), two);
    EXPECT_EQ(read(143, 1)[0], 2);
    EXPECT_EQ(read(address_of_result(1) + 1, 1)[0], 1);
    EXPECT_EQ(read(address_of_result(2) + 1, 1)[0], 2);
}

TEST_F(Image, an_older_result_does_not_come_back) {
    publish_results(1, 5);
    std::vector<PartResult> older{result_of(3), result_of(4)};
    image.publish(snapshot_of(State::ready, 9, result_of(2)), older);
    EXPECT_EQ(read(203, 1)[0], 5) << "LAST is the newest";
    EXPECT_EQ(read(143, 1)[0], 9) << "counters are those that were published last";
}

TEST_F(Image, a_slot_without_a_result_has_sequence_zero) {
    const auto readings = decode_slot(*find_block(BlockId::ring), read(1000, kResultWords));
    ASSERT_TRUE(readings);
    EXPECT_EQ(readings->front().number, 0);
    EXPECT_EQ(readings->at(1).text, "-");
}

TEST_F(Image, a_slot_whose_ends_differ_is_not_decoded) {
    publish_results(1, 3);
    Words slot = read(address_of_result(3), kResultWords);
    slot[23] = 4;
    const auto readings = decode_slot(*find_block(BlockId::ring), slot);
    ASSERT_FALSE(readings);
    EXPECT_EQ(readings.error().code, ErrorCode::busy);
}

TEST_F(Image, latencies_and_the_rate_are_those_of_the_results) {
    EXPECT_EQ(read(8404, 2), (Words{0xFFFF, 0xFFFF})) << "no result yet";
    publish_results(1, 100);  // latencies 3, 6, ... 300; rejections 5, 10, ... 500; one a second
    EXPECT_THAT(read(8404, 13), ElementsAre(0, 150, 0, 297, 0, 300, 0, 250, 0, 495, 0, 500, 600));
}

TEST_F(Image, the_pace_falls_when_no_part_comes) {
    const auto pace = [&](std::int64_t second) {
        Snapshot snapshot = snapshot_of(State::ready, 100, result_of(100));
        snapshot.taken_ns = second * 1'000'000'000;
        image.publish(snapshot);
        return read(8416, 1)[0];
    };
    const std::vector last{result_of(99), result_of(100)};
    publish_results(1, 98);
    Snapshot snapshot = snapshot_of(State::ready, 100, last.back());
    snapshot.taken_ns = 101'000'000'000;
    image.publish(snapshot, last);
    EXPECT_EQ(pace(101), 600) << "one a second";
    EXPECT_EQ(pace(104), 600) << "three intervals";
    EXPECT_EQ(pace(111), 60) << "ten seconds";
    EXPECT_EQ(pace(164), 10);
    EXPECT_EQ(pace(165), 0);
    EXPECT_EQ(pace(4000), 0);
}

TEST_F(Image, the_pace_is_that_of_the_line_that_runs_again) {
    publish_results(1, 10);
    std::vector<PartResult> later{result_of(11), result_of(12), result_of(13)};
    later[0].arrived_ns = 4'000'000'000'000;
    later[1].arrived_ns = 4'002'000'000'000;
    later[2].arrived_ns = 4'004'000'000'000;
    image.publish(snapshot_of(State::ready, 13, later.back()), later);
    EXPECT_EQ(read(8416, 1)[0], 300) << "the hour without parts is not counted";
}

TEST_F(Image, a_slow_line_has_a_pace) {
    PartResult first = result_of(1), second = result_of(2);
    second.arrived_ns = first.arrived_ns + 200'000'000'000;
    image.publish(snapshot_of(State::ready, 1, first));
    EXPECT_EQ(read(8416, 1)[0], 0xFFFF);
    image.publish(snapshot_of(State::ready, 2, second));
    EXPECT_EQ(read(8416, 1)[0], 3);
}

TEST_F(Image, parts_that_were_not_rejected_have_no_part_in_the_times_of_rejections) {
    PartResult passed = result_of(1), rejected = result_of(2);
    passed.reject_latency_us = 0;
    image.publish(snapshot_of(State::ready, 2, rejected), std::vector{passed, rejected});
    EXPECT_THAT(read(8410, 6), ElementsAre(0, 10, 0, 10, 0, 10));
}

TEST_F(Image, what_is_published_of_health_calibration_and_recipe_is_read) {
    image.publish(
        HealthReport{.uptime_s = 70'000, .modbus_evicted = 3, .processor_celsius = -12.34, .disk_free_percent = 87.65});
    image.publish(CalibrationReport{.id = 0xCAFE0001, .residual_px = 0.0423, .drift_px = -0.02});
    image.publish(
        RecipeInUse{.number = 7, .crc32 = 0x89ABCDEF, .name = ShortText("bottle, 0.5 l, a name that is far too long")});
    EXPECT_THAT(read(8402, 2), ElementsAre(1, 4464));
    EXPECT_THAT(read(8417, 2), ElementsAre(0xFFFF, 0xFFFF)) << "not published";
    EXPECT_THAT(read(8432, 2), ElementsAre(static_cast<std::uint16_t>(-123), 877));
    EXPECT_THAT(read(8502, 8),
                ElementsAre(0xCAFE, 1, 0xFFFF, 0xFFFF, 42, static_cast<std::uint16_t>(-20), 0xFFFF, 0xFFFF));
    EXPECT_THAT(read(110, 3), ElementsAre(7, 0x89AB, 0xCDEF));
    const auto readings = decode(*find_block(BlockId::recipe), read(8200, 100));
    ASSERT_TRUE(readings);
    EXPECT_EQ(readings->back().text, "bottle, 0.5 l, a name that is fa");
}

TEST_F(Image, bits_are_those_of_the_status_block) {
    Snapshot snapshot = snapshot_of(State::error, 0, {});
    snapshot.line_stop = true;
    snapshot.faults_active = 0x80000001;
    snapshot.faults_latched = 0x00010002;
    image.publish(snapshot);
    std::array<bool, 81> bits{};
    ASSERT_EQ(image.read_bits(0, bits), Exception::none);
    Words on;
    for (std::size_t k = 0; k < bits.size(); ++k) {
        if (bits[k]) on.push_back(static_cast<std::uint16_t>(k));
    }
    EXPECT_THAT(on, ElementsAre(2, 3, 4, 5, 16, 47, 49, 64));
    EXPECT_EQ(image.read_bits(80, std::span(bits).first(2)), Exception::illegal_address);
}

TEST_F(Image, identification_gives_what_ident_gives) {
    EXPECT_EQ(image.identification(0), "V");
    EXPECT_EQ(image.identification(2), "0.1.0");
    EXPECT_EQ(image.identification(0x80), "S");
    EXPECT_EQ(image.identification(0x81), "0000B007");
    EXPECT_EQ(image.identification(3), "");
}

// A writer without pauses. Each answer must be consistent (STATUS, COUNTERS and LAST agree), each slot must hold one
// result, and no slot may be older than an earlier answer showed.
TEST_F(Image, a_million_reads_against_a_spinning_writer_are_neither_torn_nor_stale) {
    constexpr int kReads = 1'000'000;
    std::atomic<bool> stop = false;
    std::atomic<std::uint32_t> published = 0;
    std::thread writer([&] {
        for (std::uint32_t s = 1; !stop; ++s) {
            const PartResult result = result_of(s);
            image.publish(snapshot_of(State::ready, s, result), std::span(&result, 1));
            published = s;
        }
    });
    const auto at = [](std::span<const std::uint16_t> w, std::size_t k) {
        return std::uint32_t{w[k]} << 16U | w[k + 1];
    };
    int torn = 0, stale = 0, fresh = 0;
    std::uint32_t newest = 0;
    std::array<std::uint16_t, kMaxRead> words{};
    for (int k = 0; k < kReads; ++k) {
        if (k % 10'000 == 0) {  // locks are not fair: let the writer in
            for (const std::uint32_t before = published; published == before;) std::this_thread::yield();
        }
        if (k % 2 == 0) {
            (void)image.read_registers(102, words);  // STATUS, COUNTERS and the first half of LAST
            const std::uint32_t now = at(words, 4);
            torn += now != 0 && (at(words, 40) != now || at(words, 58) != (~now & 0x7FFFFFFF) || at(words, 100) != now)
                ? 1
                : 0;
            stale += now < newest ? 1 : 0;
            fresh += now > newest ? 1 : 0;
            newest = now;
        } else if (newest > 0) {
            const auto slot = std::span(words).first(kResultWords);
            (void)image.read_registers(address_of_result(newest), slot);
            const std::uint32_t s = at(slot, 0);
            stale += s < newest ? 1 : 0;
            torn += at(slot, 22) != s || at(slot, 2) != (s ^ 0x55AA55AA) || at(slot, 4) != s || slot[10] != s % 1000 ||
                    at(slot, 13) != s * 3 || at(slot, 15) != s * 5
                ? 1
                : 0;
        }
    }
    stop = true;
    writer.join();
    EXPECT_EQ(torn, 0);
    EXPECT_EQ(stale, 0);
    EXPECT_GE(fresh, 50) << "the writer did not run";
}

}  // namespace
}  // namespace hord::firmware
