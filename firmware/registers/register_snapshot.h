// A station's registers as read at one time, by the names of the register map.
#pragma once

#include <map>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "firmware/registers/register_map.h"

namespace hord::firmware {

class RegisterSnapshot {
  public:
    void set(BlockId block, std::vector<Reading> readings) { blocks_.insert_or_assign(block, std::move(readings)); }
    [[nodiscard]] const std::map<BlockId, std::vector<Reading>>& blocks() const { return blocks_; }

    // Empty if the station does not know the value, or the block was not read.
    [[nodiscard]] std::optional<double> number(BlockId block, std::string_view row) const {
        const Reading* reading = find(block, row);
        return reading != nullptr ? reading->number : std::nullopt;
    }
    // The text without the number: "Ready" for "6 Ready"; "-" if it is not known.
    [[nodiscard]] std::string text(BlockId block, std::string_view row) const {
        const Reading* reading = find(block, row);
        return reading != nullptr ? plain_text(*reading) : std::string("-");
    }
    // 0 if the value is not known.
    [[nodiscard]] std::uint32_t bits(BlockId block, std::string_view row) const {
        return static_cast<std::uint32_t>(number(block, row).value_or(0));
    }

    // One bit of STATUS's row "bits" by its name ("line_stop"); false when it is not known.
    [[nodiscard]] bool status_bit(std::string_view name) const {
        const Reading* reading = find(BlockId::status, "bits");
        return reading != nullptr && has_bit(*reading, name);
    }

    // The bit of this name in the register map is set in `reading`.
    static bool has_bit(const Reading& reading, std::string_view name) {
        const auto bits = static_cast<std::uint32_t>(reading.number.value_or(0));
        for (const NamedValue& bit : reading.what->values) {
            if (bit.name == name) return (bits >> bit.value & 1U) != 0;
        }
        return false;
    }

    // A reading's text without the number of a named value.
    static std::string plain_text(const Reading& reading) {
        const bool named = reading.what->type == RegisterType::u16 && !reading.what->values.empty();
        const auto space = reading.text.find(' ');
        return named && space != std::string::npos ? reading.text.substr(space + 1) : reading.text;
    }

  private:
    [[nodiscard]] const Reading* find(BlockId block, std::string_view row) const {
        const auto at = blocks_.find(block);
        if (at == blocks_.end()) return nullptr;
        for (const Reading& reading : at->second) {
            if (reading.what->name == row) return &reading;
        }
        return nullptr;
    }
    std::map<BlockId, std::vector<Reading>> blocks_;
};

}  // namespace hord::firmware
