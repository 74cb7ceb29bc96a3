// libgpiod 1.6. The kernel buffers 16 edges of a line and drops further ones without notice.
#include <array>
#include <cerrno>
#include <utility>

#include <gpiod.h>

#include "drivers/gpio/gpio_chip.h"

namespace hord::drivers::gpio {
namespace {

constexpr std::size_t kKernelBuffer = 16;

// active_low is applied here: the kernel's flag would hold for the whole request.
class Bank final : public OutputBank {
  public:
    explicit Bank(std::uint32_t active_low) : active_low_(active_low) { gpiod_line_bulk_init(&lines_); }

    bool request(gpiod_chip* chip, std::span<const unsigned> offsets) {
        for (const unsigned offset : offsets) gpiod_line_bulk_add(&lines_, gpiod_chip_get_line(chip, offset));
        gpiod_line_request_config config{};
        config.consumer = kConsumer;
        config.request_type = GPIOD_LINE_REQUEST_DIRECTION_OUTPUT;
        return gpiod_line_request_bulk(&lines_, &config, levels(0).data()) == 0;
    }
    bool set(std::uint32_t active) override { return gpiod_line_set_value_bulk(&lines_, levels(active).data()) == 0; }

  private:
    [[nodiscard]] std::array<int, GPIOD_LINE_BULK_MAX_LINES> levels(std::uint32_t active) const {
        std::array<int, GPIOD_LINE_BULK_MAX_LINES> values{};
        for (unsigned k = 0; k < lines_.num_lines; ++k) values[k] = static_cast<int>((active ^ active_low_) >> k & 1U);
        return values;
    }
    std::uint32_t active_low_;
    gpiod_line_bulk lines_{};
};

class Input final : public GpioInput {
  public:
    Input(GpioLine name, Chip chip, gpiod_line* line) : name_(std::move(name)), chip_(std::move(chip)), line_(line) {}

    [[nodiscard]] int fd() const override { return gpiod_line_event_get_fd(line_); }

    Result<void> read(std::vector<GpioEdge>& into) override {
        std::array<gpiod_line_event, kKernelBuffer> events{};
        std::size_t taken = 0;
        for (;;) {
            const int count =
                gpiod_line_event_read_fd_multiple(fd(), events.data(), static_cast<unsigned>(events.size()));
            if (count < 0) {
                if (errno == EAGAIN || errno == EWOULDBLOCK) return {};
                if (errno == EINTR) continue;
                return failed(name_, "its edges cannot be read", errno);
            }
            for (int k = 0; k < count; ++k) {
                const gpiod_line_event& event = events[static_cast<std::size_t>(k)];
                const hal::TimePoint at{std::chrono::seconds(event.ts.tv_sec) +
                                        std::chrono::nanoseconds(event.ts.tv_nsec)};
                // The buffer was full: at least one edge may have been dropped.
                const bool buffer_was_full = ++taken == kKernelBuffer;
                into.push_back({event.event_type == GPIOD_LINE_EVENT_RISING_EDGE, at, buffer_was_full ? 1U : 0U});
            }
            if (static_cast<std::size_t>(count) < events.size()) return {};
        }
    }

    [[nodiscard]] Result<bool> active() override {
        const int value = gpiod_line_get_value(line_);
        if (value < 0) return failed(name_, "cannot be read", errno);
        return value != 0;
    }

  private:
    GpioLine name_;
    Chip chip_;
    gpiod_line* line_;
};

}  // namespace

void CloseChip::operator()(gpiod_chip* chip) const { gpiod_chip_close(chip); }  // releases its lines, too

std::optional<ChipNames> names_of(gpiod_chip* chip) { return ChipNames{gpiod_chip_name(chip), gpiod_chip_label(chip)}; }

int find_line(gpiod_chip* chip, const std::string& name) {
    gpiod_line* line = gpiod_chip_find_line(chip, name.c_str());
    return line == nullptr ? -1 : static_cast<int>(gpiod_line_offset(line));
}

bool has_line(gpiod_chip* chip, unsigned offset) { return gpiod_chip_get_line(chip, offset) != nullptr; }

std::optional<std::string> holder_of(gpiod_chip* chip, unsigned offset) {
    gpiod_line* line = gpiod_chip_get_line(chip, offset);
    const char* consumer = gpiod_line_update(line) == 0 ? gpiod_line_consumer(line) : nullptr;
    if (consumer != nullptr) return consumer;
    return gpiod_line_is_used(line) ? std::optional<std::string>("") : std::nullopt;
}

std::vector<ListedLine> lines_of(gpiod_chip* chip) {
    std::vector<ListedLine> lines;
    for (unsigned offset = 0; offset < gpiod_chip_num_lines(chip); ++offset) {
        gpiod_line* line = gpiod_chip_get_line(chip, offset);
        if (line == nullptr) continue;
        const char* name = gpiod_line_name(line);
        lines.push_back({offset, name == nullptr ? "" : name, holder_of(chip, offset),
                         gpiod_line_direction(line) == GPIOD_LINE_DIRECTION_OUTPUT});
    }
    return lines;
}

std::unique_ptr<OutputBank> request_bank(gpiod_chip* chip, std::span<const unsigned> offsets,
                                         std::uint32_t active_low) {
    auto bank = std::make_unique<Bank>(active_low);
    if (!bank->request(chip, offsets)) return nullptr;
    return bank;
}

std::unique_ptr<GpioInput> request_line(Chip& chip, unsigned offset, const GpioLine& wanted, GpioEdges edges) {
    gpiod_line* line = gpiod_chip_get_line(chip.get(), offset);
    gpiod_line_request_config config{};
    config.consumer = kConsumer;
    config.request_type =
        edges == GpioEdges::both ? GPIOD_LINE_REQUEST_EVENT_BOTH_EDGES : GPIOD_LINE_REQUEST_EVENT_RISING_EDGE;
    constexpr std::array<int, 4> kBiases{0, GPIOD_LINE_REQUEST_FLAG_BIAS_DISABLE, GPIOD_LINE_REQUEST_FLAG_BIAS_PULL_UP,
                                         GPIOD_LINE_REQUEST_FLAG_BIAS_PULL_DOWN};
    config.flags = kBiases[static_cast<std::size_t>(wanted.bias)];
    if (wanted.active_low) config.flags |= GPIOD_LINE_REQUEST_FLAG_ACTIVE_LOW;
    if (gpiod_line_request(line, &config, 0) != 0) return nullptr;
    return std::make_unique<Input>(wanted, std::move(chip), line);
}

}  // namespace hord::drivers::gpio

namespace hord::drivers {

std::string gpiod_version() { return gpiod_version_string(); }

}  // namespace hord::drivers
