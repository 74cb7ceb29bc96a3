#include "firmware/plc/register_server_model.h"

#include <algorithm>
#include <utility>

#include <fmt/format.h>

#include "common/statistics.h"

namespace hord::firmware {
namespace {

using modbus::Exception;

constexpr std::size_t kBits = 81, kHeartbeatBit = 80;
constexpr std::size_t kMaxSlots = kMaxRead / kResultWords + 2;  // that one request can overlap

// The common addresses of a request and some registers: [begin, end).
struct Overlap {
    std::size_t begin = 0, end = 0;
    Overlap(std::size_t a, std::size_t a_size, std::size_t b, std::size_t b_size)
        : begin(std::max(a, b)), end(std::min(a + a_size, b + b_size)) {}
    [[nodiscard]] bool empty() const { return begin >= end; }
};

// Nearest rank: the smallest value that at least `percent` of all do not exceed. `values` is reordered.
std::optional<std::uint32_t> percentile(std::span<std::uint32_t> values, std::size_t percent) {
    if (values.empty()) return std::nullopt;
    return common::nth_smallest(values, (values.size() * percent + 99) / 100 - 1);
}

// Parts a minute, from the mean interval of the arrivals within a minute of the newest one (two at least). After three
// intervals without a result the time since then (`waiting_ns`) counts as the interval; after a minute besides, the
// pace is 0. None: fewer than two arrivals. `arrivals_ns` is sorted.
std::optional<double> pace(std::span<std::int64_t> arrivals_ns, std::int64_t waiting_ns) {
    constexpr std::int64_t kMinute_ns = 60'000'000'000;
    if (arrivals_ns.size() < 2) return std::nullopt;
    std::ranges::sort(arrivals_ns);
    const std::int64_t newest = arrivals_ns.back();
    const auto from = std::min(std::ranges::lower_bound(arrivals_ns, newest - kMinute_ns), arrivals_ns.end() - 2);
    const std::int64_t interval_ns = (newest - *from) / (arrivals_ns.end() - 1 - from);
    if (waiting_ns > 3 * interval_ns + kMinute_ns) return 0;
    const std::int64_t counted_ns = waiting_ns > 3 * interval_ns ? waiting_ns : interval_ns;
    if (counted_ns == 0) return std::nullopt;
    return static_cast<double>(kMinute_ns) / static_cast<double>(counted_ns);
}

}  // namespace

RegisterServerModel::RegisterServerModel(StationIdentity identity, PlcInterface* plc_interface)
    : identity_(std::move(identity)), boot_text_(fmt::format("{:08X}", identity_.boot_id)),
      map_text_(fmt::format("{} {:08X}", kMapVersion, map_crc32())), plc_interface_(plc_interface) {}

void RegisterServerModel::publish(const Snapshot& snapshot, std::span<const PartResult> results) {
    const std::lock_guard lock(mutex_);
    const auto add = [&](const PartResult& result) {
        if (result.sequence <= state_.newest.sequence) return;
        ring_[result.sequence % kRingSlots] = result;
        state_.newest = result;
        state_.newest_at_ns = snapshot.taken_ns;
    };
    for (const PartResult& result : results) add(result);
    add(snapshot.last);
    state_.snapshot = snapshot;
}

StationNow RegisterServerModel::now() {
    const std::lock_guard lock(mutex_);
    return {.state = state_.snapshot.state, .newest_sequence = state_.newest.sequence};
}

ResultStatistics RegisterServerModel::statistics() {
    std::array<std::uint32_t, kRingSlots> latency, reject;
    std::size_t latencies = 0, rejects = 0;
    std::array<std::int64_t, kRingSlots> arrival_ns;
    std::int64_t waiting_ns = 0;
    {
        const std::lock_guard lock(mutex_);
        waiting_ns = state_.snapshot.taken_ns - state_.newest_at_ns;
        for (const PartResult& result : ring_) {
            if (result.sequence == 0) continue;
            arrival_ns[latencies] = result.arrived_ns;
            latency[latencies++] = result.latency_us;
            if (result.reject_latency_us != 0) reject[rejects++] = result.reject_latency_us;
        }
    }
    const auto all = std::span(latency).first(latencies), rejected = std::span(reject).first(rejects);
    return {.latency_p50_us = percentile(all, 50),
            .latency_p99_us = percentile(all, 99),
            .latency_max_us = percentile(all, 100),
            .reject_p50_us = percentile(rejected, 50),
            .reject_p99_us = percentile(rejected, 99),
            .reject_max_us = percentile(rejected, 100),
            .parts_per_minute = pace(std::span(arrival_ns).first(latencies), waiting_ns)};
}

Exception RegisterServerModel::read_registers(std::uint16_t address, std::span<std::uint16_t> out) {
    // Gaps have nothing but their headers; beyond the end there is nothing.
    const Block& end = register_blocks().back();
    if (address + out.size() > std::size_t{end.base} + end.size()) return Exception::illegal_address;
    for (const Block& block : register_blocks()) {
        if (block.id == BlockId::gap &&
            !Overlap(address, out.size(), block.base + std::size_t{kBlockHeader}, block.length).empty()) {
            return Exception::illegal_address;
        }
    }
    const auto touches = [&](BlockId id) {
        const Block& block = *find_block(id);
        return !Overlap(address, out.size(), block.base, block.size()).empty();
    };

    const Overlap in_ring(address, out.size(), kRingBase, std::size_t{kRingSlots} * kResultWords);
    const std::size_t first_slot = in_ring.empty() ? 0 : (in_ring.begin - kRingBase) / kResultWords;
    const std::size_t last_slot = in_ring.empty() ? 0 : (in_ring.end - 1 - kRingBase) / kResultWords + 1;
    std::array<PartResult, kMaxSlots> slots{};
    State state;
    {
        const std::lock_guard lock(mutex_);
        state = state_;
        std::copy(ring_.begin() + static_cast<std::ptrdiff_t>(first_slot),
                  ring_.begin() + static_cast<std::ptrdiff_t>(last_slot), slots.begin());
    }
    if (touches(BlockId::health)) state.extras.statistics = statistics();
    if (plc_interface_ != nullptr) {
        plc_interface_->note_results(state.newest.sequence);
        state.extras.plc = plc_interface_->view();
    }
    const auto values = [&](const PartResult& result) {
        return RegisterValues{identity_, state.snapshot, result, state.extras};
    };

    std::array<std::uint16_t, kMaxRead> image;
    const auto copy = [&](std::size_t base, std::size_t size) {
        const Overlap part(address, out.size(), base, size);
        if (part.empty()) return;
        std::copy_n(image.begin() + static_cast<std::ptrdiff_t>(part.begin - base), part.end - part.begin,
                    out.begin() + static_cast<std::ptrdiff_t>(part.begin - address));
    };
    for (const Block& block : register_blocks()) {
        if (Overlap(address, out.size(), block.base, block.size()).empty()) continue;
        if (block.registers.empty() || block.slots > 0) {
            image[0] = static_cast<std::uint16_t>(block.id);
            image[1] = block.length;
            copy(block.base, kBlockHeader);
        } else {
            encode(block, values(state.newest), std::span(image).first(block.size()));
            copy(block.base, block.size());
        }
        for (std::size_t slot = first_slot; block.slots > 0 && slot < last_slot; ++slot) {
            encode_slot(block, values(slots[slot - first_slot]), std::span(image).first(kResultWords));
            copy(kRingBase + slot * kResultWords, kResultWords);
        }
    }
    return Exception::none;
}

Exception RegisterServerModel::read_bits(std::uint16_t address, std::span<bool> out) {
    if (address + out.size() > kBits) return Exception::illegal_address;
    const std::uint16_t bits_at = find_register(BlockId::status, "bits")->address;
    const std::uint16_t active_at = find_register(BlockId::status, "faults_active")->address;
    const std::uint16_t latched_at = find_register(BlockId::status, "faults_latched")->address;
    std::array<std::uint16_t, 32> words{};
    if (const auto wrong = read_registers(bits_at, words); wrong != Exception::none) return wrong;
    const auto bit_of_pair = [&](std::size_t at, std::size_t bit) {
        return (words[at - bits_at + (bit < 16 ? 1U : 0U)] >> (bit % 16) & 1U) != 0;
    };
    std::array<bool, kBits> all{};
    for (std::size_t bit = 0; bit < 16; ++bit) all[bit] = (words[0] >> bit & 1U) != 0;
    for (std::size_t bit = 0; bit < 32; ++bit) {
        all[16 + bit] = bit_of_pair(active_at, bit);
        all[48 + bit] = bit_of_pair(latched_at, bit);
    }
    all[kHeartbeatBit] = plc_interface_ != nullptr && (plc_interface_->view().plc_heartbeat & 1U) != 0;
    std::copy_n(all.begin() + address, out.size(), out.begin());
    return Exception::none;
}

Exception RegisterServerModel::write_registers(const modbus::Origin& origin, std::uint16_t address,
                                               std::span<const std::uint16_t> values) {
    return plc_interface_ == nullptr ? Exception::illegal_address
                                     : plc_interface_->write(origin, now(), address, values);
}

Exception RegisterServerModel::write_bits(const modbus::Origin& origin, std::uint16_t address,
                                          std::span<const bool> values) {
    if (address != kHeartbeatBit || values.size() != 1) return Exception::illegal_address;
    const std::uint16_t beat = values[0] ? 1 : 0;
    return write_registers(origin, find_register(BlockId::plc, "heartbeat")->address, std::span(&beat, 1));
}

std::string_view RegisterServerModel::identification(std::uint8_t object) const {
    switch (object) {
        case 0x00: return identity_.vendor;
        case 0x01:
        case 0x04: return identity_.product;
        case 0x02: return identity_.firmware;
        case 0x80: return identity_.serial;
        case 0x81: return boot_text_;
        case 0x82: return map_text_;
        default: return {};
    }
}

}  // namespace hord::firmware
