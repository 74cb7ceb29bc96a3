#include "firmware/modbus/dispatcher.h"

#include <algorithm>
#include <array>

namespace hord::firmware::modbus {
namespace {

using Bytes = std::span<const std::uint8_t>;

constexpr std::size_t kMaxReadBits = 2000, kMaxWriteBits = 1968;
constexpr std::size_t kMaxReadRegisters = 125, kMaxWriteRegisters = 123, kMaxReadWriteRegisters = 121;

std::uint16_t word_at(Bytes bytes, std::size_t at) {
    return static_cast<std::uint16_t>(bytes[at] << 8U | bytes[at + 1]);
}

// A reply under construction, or the exception that replaces it.
class Reply {
  public:
    Reply(std::uint8_t function, std::span<std::uint8_t, kMaxPdu> out) : out_(out) { byte(function); }

    void byte(std::size_t value) { out_[size_++] = static_cast<std::uint8_t>(value & 0xFFU); }
    void word(std::size_t value) {
        byte(value >> 8U);
        byte(value);
    }
    void bytes(Bytes all) {
        for (const std::uint8_t b : all) byte(b);
    }
    void text(std::string_view all) {
        for (const char c : all) byte(static_cast<unsigned char>(c));
    }
    std::uint8_t& at(std::size_t index) { return out_[index]; }
    [[nodiscard]] std::size_t size() const { return size_; }
    [[nodiscard]] std::size_t room() const { return out_.size() - size_; }

    std::size_t refuse(Exception exception) {
        const std::uint8_t function = out_[0];
        size_ = 0;
        byte(function | 0x80U);
        byte(static_cast<std::uint8_t>(exception));
        return size_;
    }

  private:
    std::span<std::uint8_t, kMaxPdu> out_;
    std::size_t size_ = 0;
};

// The last address must not exceed 65535.
Exception check_range(std::size_t address, std::size_t count, std::size_t most) {
    if (count == 0 || count > most) return Exception::illegal_value;
    return address + count > 0x10000 ? Exception::illegal_address : Exception::none;
}

// Each function below writes its reply after the function code, or returns the exception that replaces it.

Exception read_bits(RegisterModel& model, Bytes request, Reply& reply) {
    if (request.size() != 5) return Exception::illegal_value;
    const std::size_t count = word_at(request, 3);
    if (const auto wrong = check_range(word_at(request, 1), count, kMaxReadBits); wrong != Exception::none)
        return wrong;
    std::array<bool, kMaxReadBits> bits{};
    const auto wrong = model.read_bits(word_at(request, 1), std::span(bits).first(count));
    reply.byte((count + 7) / 8);
    for (std::size_t k = 0; k < count; k += 8) {
        unsigned packed = 0;
        for (std::size_t bit = 0; bit < 8 && k + bit < count; ++bit) packed |= (bits[k + bit] ? 1U : 0U) << bit;
        reply.byte(packed);
    }
    return wrong;
}

Exception read_words(RegisterModel& model, std::uint16_t address, std::size_t count, Reply& reply) {
    if (const auto wrong = check_range(address, count, kMaxReadRegisters); wrong != Exception::none) return wrong;
    std::array<std::uint16_t, kMaxReadRegisters> words{};
    const auto wrong = model.read_registers(address, std::span(words).first(count));
    reply.byte(2 * count);
    for (std::size_t k = 0; k < count; ++k) reply.word(words[k]);
    return wrong;
}

// `data`: two bytes a word.
Exception write_words(RegisterModel& model, const Origin& origin, std::uint16_t address, Bytes data) {
    std::array<std::uint16_t, kMaxWriteRegisters> words{};
    for (std::size_t k = 0; k < data.size() / 2; ++k) words[k] = word_at(data, 2 * k);
    return model.write_registers(origin, address, std::span<const std::uint16_t>(words).first(data.size() / 2));
}

Exception read_registers(RegisterModel& model, Bytes request, Reply& reply) {
    if (request.size() != 5) return Exception::illegal_value;
    return read_words(model, word_at(request, 1), word_at(request, 3), reply);
}

// FC 5, 6: the reply repeats the request.
Exception write_one(RegisterModel& model, const Origin& origin, Bytes request, Reply& reply) {
    if (request.size() != 5) return Exception::illegal_value;
    const std::uint16_t address = word_at(request, 1), value = word_at(request, 3);
    reply.bytes(request.subspan(1));
    if (request[0] == 6) return model.write_registers(origin, address, std::span(&value, 1));
    if (value != 0xFF00 && value != 0) return Exception::illegal_value;
    const bool on = value != 0;
    return model.write_bits(origin, address, std::span(&on, 1));
}

// FC 15, 16: the reply repeats address and count.
Exception write_many(RegisterModel& model, const Origin& origin, Bytes request, Reply& reply) {
    if (request.size() < 6) return Exception::illegal_value;
    const bool bits = request[0] == 15;
    const std::uint16_t address = word_at(request, 1);
    const std::size_t count = word_at(request, 3), size = bits ? (count + 7) / 8 : 2 * count;
    if (const auto wrong = check_range(address, count, bits ? kMaxWriteBits : kMaxWriteRegisters);
        wrong != Exception::none) {
        return wrong;
    }
    if (request[5] != size || request.size() != 6 + size) return Exception::illegal_value;
    reply.bytes(request.subspan(1, 4));
    const Bytes data = request.subspan(6);
    if (!bits) return write_words(model, origin, address, data);
    std::array<bool, kMaxWriteBits> values{};
    for (std::size_t k = 0; k < count; ++k) values[k] = (data[k / 8] >> (k % 8) & 1U) != 0;
    return model.write_bits(origin, address, std::span(values).first(count));
}

// FC 22: register = (register AND and_mask) OR (or_mask AND NOT and_mask).
Exception mask_write(RegisterModel& model, const Origin& origin, Bytes request, Reply& reply) {
    if (request.size() != 7) return Exception::illegal_value;
    const std::uint16_t address = word_at(request, 1);
    const unsigned and_mask = word_at(request, 3), or_mask = word_at(request, 5);
    std::uint16_t value = 0;
    if (const auto wrong = model.read_registers(address, std::span(&value, 1)); wrong != Exception::none) return wrong;
    value = static_cast<std::uint16_t>((value & and_mask) | (or_mask & ~and_mask & 0xFFFFU));
    reply.bytes(request.subspan(1));
    return model.write_registers(origin, address, std::span<const std::uint16_t>(&value, 1));
}

// FC 23: the write comes first. If the read would fail, nothing is written.
Exception read_write(RegisterModel& model, const Origin& origin, Bytes request, Reply& reply) {
    if (request.size() < 10) return Exception::illegal_value;
    const std::uint16_t read_at = word_at(request, 1), write_at = word_at(request, 5);
    const std::size_t read_count = word_at(request, 3), write_count = word_at(request, 7);
    if (const auto wrong = check_range(read_at, read_count, kMaxReadRegisters); wrong != Exception::none) return wrong;
    if (const auto wrong = check_range(write_at, write_count, kMaxReadWriteRegisters); wrong != Exception::none)
        return wrong;
    if (request[9] != 2 * write_count || request.size() != 10 + 2 * write_count) return Exception::illegal_value;
    std::array<std::uint16_t, kMaxReadRegisters> before{};
    auto wrong = model.read_registers(read_at, std::span(before).first(read_count));
    if (wrong == Exception::none) wrong = write_words(model, origin, write_at, request.subspan(10));
    return wrong == Exception::none ? read_words(model, read_at, read_count, reply) : wrong;
}

// FC 43/14. Stream access (1 basic, 2 regular, 3 extended) continues in a later request when the reply is full;
// 4 requests one object.
Exception identify(const RegisterModel& model, Bytes request, Reply& reply) {
    if (request.size() < 2 || request[1] != 14) return Exception::illegal_function;
    if (request.size() != 4 || request[2] < 1 || request[2] > 4) return Exception::illegal_value;
    const std::uint8_t kind = request[2];
    constexpr std::array<std::size_t, 5> kEnd{0, 0x03, 0x80, 0x100, 0x100};
    constexpr std::size_t kLongest = kMaxPdu - 9;  // seven bytes before the first object, two of its own
    const auto object_text = [&](std::size_t object) {
        return model.identification(static_cast<std::uint8_t>(object)).substr(0, kLongest);
    };

    std::size_t object = request[3];
    if (kind == 4 && object_text(object).empty()) return Exception::illegal_address;
    if (kind != 4 && (object >= kEnd[kind] || object_text(object).empty()))
        object = 0;  // required by the specification
    const std::size_t end = kind == 4 ? object + 1 : kEnd[kind];

    reply.byte(14);
    reply.byte(kind);
    reply.byte(0x83);  // conformity level: extended, stream and individual access
    const std::size_t more = reply.size();
    reply.word(0);  // more follows, next object
    reply.byte(0);  // number of objects
    for (; object < end; ++object) {
        const std::string_view text = object_text(object);
        if (text.empty()) continue;
        if (text.size() + 2 > reply.room()) {
            reply.at(more) = 0xFF;
            reply.at(more + 1) = static_cast<std::uint8_t>(object);
            break;
        }
        reply.byte(object);
        reply.byte(text.size());
        reply.text(text);
        ++reply.at(more + 2);
    }
    return Exception::none;
}

Exception answer(RegisterModel& model, const Origin& origin, Bytes request, Reply& reply) {
    switch (request[0]) {
        case 1:
        case 2: return read_bits(model, request, reply);
        case 3:
        case 4: return read_registers(model, request, reply);
        case 43: return identify(model, request, reply);
        default: break;
    }
    if (!origin.may_write) return Exception::illegal_function;
    switch (request[0]) {
        case 5:
        case 6: return write_one(model, origin, request, reply);
        case 15:
        case 16: return write_many(model, origin, request, reply);
        case 22: return mask_write(model, origin, request, reply);
        case 23: return read_write(model, origin, request, reply);
        default: return Exception::illegal_function;
    }
}

}  // namespace

Exception RegisterModel::read_bits(std::uint16_t, std::span<bool>) { return Exception::illegal_address; }
Exception RegisterModel::write_registers(const Origin&, std::uint16_t, std::span<const std::uint16_t>) {
    return Exception::illegal_address;
}
Exception RegisterModel::write_bits(const Origin&, std::uint16_t, std::span<const bool>) {
    return Exception::illegal_address;
}
std::string_view RegisterModel::identification(std::uint8_t) const { return {}; }

std::size_t dispatch(RegisterModel& model, const Origin& origin, Bytes request, std::span<std::uint8_t, kMaxPdu> out) {
    Reply reply(request[0], out);
    const Exception wrong = answer(model, origin, request, reply);
    return wrong == Exception::none ? reply.size() : reply.refuse(wrong);
}

}  // namespace hord::firmware::modbus
