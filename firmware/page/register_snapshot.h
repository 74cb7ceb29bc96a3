// A station's registers at one moment, by their names in the register map.
#pragma once

#include <map>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "firmware/registers/register_map.h"

namespace hord::firmware::page {

class RegisterSnapshot {
  public:
    void set(BlockId block, std::vector<Reading> readings) { blocks_.insert_or_assign(block, std::move(readings)); }
    [[nodiscard]] const std::map<BlockId, std::vector<Reading>>& blocks() const { return blocks_; }

    // Nothing when the station does not know it.
    [[nodiscard]] std::optional<double> number(BlockId block, std::string_view row) const {
        const Reading* reading = find(block, row);
        return reading != nullptr ? reading->number : std::nullopt;
    }
    // "6 Ready" is "Ready" here; "-" when it is not known.
    [[nodiscard]] std::string text(BlockId block, std::string_view row) const {
        const Reading* reading = find(block, row);
        return reading != nullptr ? plain_text(*reading) : std::string("-");
    }
    [[nodiscard]] std::uint32_t bits(BlockId block, std::string_view row) const {
        return static_cast<std::uint32_t>(number(block, row).value_or(0));
    }

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

}  // namespace hord::firmware::page
