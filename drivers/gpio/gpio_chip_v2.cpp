// libgpiod 2.x. The kernel numbers the edges of a line: gaps count the edges that it dropped.
#include <array>
#include <cerrno>
#include <utility>

#include <gpiod.h>

#include "drivers/gpio/gpio_chip.h"

namespace hord::drivers::gpio {
namespace {

constexpr std::size_t kKernelBuffer = 256;

struct Free {
    void operator()(gpiod_chip_info* info) const { gpiod_chip_info_free(info); }
    void operator()(gpiod_line_info* info) const { gpiod_line_info_free(info); }
    void operator()(gpiod_line_settings* settings) const { gpiod_line_settings_free(settings); }
    void operator()(gpiod_line_config* config) const { gpiod_line_config_free(config); }
    void operator()(gpiod_request_config* config) const { gpiod_request_config_free(config); }
    void operator()(gpiod_line_request* request) const { gpiod_line_request_release(request); }
    void operator()(gpiod_edge_event_buffer* buffer) const { gpiod_edge_event_buffer_free(buffer); }
};
template <class T>
using Owned = std::unique_ptr<T, Free>;

// The request of lines that differ only in active_low. Null: errno says why.
Owned<gpiod_line_request> request(gpiod_chip* chip, std::span<const unsigned> offsets, gpiod_line_settings* settings,
                                  std::uint32_t active_low) {
    const Owned<gpiod_line_config> config(gpiod_line_config_new());
    const Owned<gpiod_request_config> options(gpiod_request_config_new());
    if (!config || !options) return nullptr;
    gpiod_request_config_set_consumer(options.get(), kConsumer);
    gpiod_request_config_set_event_buffer_size(options.get(), kKernelBuffer);  // of inputs
    for (std::size_t k = 0; k < offsets.size(); ++k) {
        gpiod_line_settings_set_active_low(settings, (active_low >> k & 1U) != 0);
        if (gpiod_line_config_add_line_settings(config.get(), &offsets[k], 1, settings) != 0) return nullptr;
    }
    return Owned<gpiod_line_request>(gpiod_chip_request_lines(chip, options.get(), config.get()));
}

class Bank final : public OutputBank {
  public:
    explicit Bank(Owned<gpiod_line_request> request) : request_(std::move(request)) {}
    bool set(std::uint32_t active) override {
        std::array<gpiod_line_value, 32> values{};
        for (std::size_t k = 0; k < values.size(); ++k)
            values[k] = (active >> k & 1U) != 0 ? GPIOD_LINE_VALUE_ACTIVE : GPIOD_LINE_VALUE_INACTIVE;
        return gpiod_line_request_set_values(request_.get(), values.data()) == 0;
    }

  private:
    Owned<gpiod_line_request> request_;
};

class Input final : public GpioInput {
  public:
    Input(GpioLine name, unsigned offset, Owned<gpiod_line_request> request, Owned<gpiod_edge_event_buffer> buffer)
        : name_(std::move(name)), offset_(offset), request_(std::move(request)), buffer_(std::move(buffer)) {}

    [[nodiscard]] int fd() const override { return gpiod_line_request_get_fd(request_.get()); }

    Result<void> read(std::vector<GpioEdge>& into) override {
        for (;;) {
            const int count = gpiod_line_request_read_edge_events(request_.get(), buffer_.get(), kKernelBuffer);
            if (count < 0) {
                if (errno == EAGAIN || errno == EWOULDBLOCK) return {};
                if (errno == EINTR) continue;
                return failed(name_, "its edges cannot be read", errno);
            }
            for (int k = 0; k < count; ++k) {
                gpiod_edge_event* event =
                    gpiod_edge_event_buffer_get_event(buffer_.get(), static_cast<unsigned long>(k));
                const auto number = static_cast<std::uint32_t>(gpiod_edge_event_get_line_seqno(event));
                const hal::TimePoint at{std::chrono::nanoseconds(gpiod_edge_event_get_timestamp_ns(event))};
                into.push_back({gpiod_edge_event_get_event_type(event) == GPIOD_EDGE_EVENT_RISING_EDGE, at,
                                number - last_number_ - 1});
                last_number_ = number;
            }
            if (static_cast<std::size_t>(count) < kKernelBuffer) return {};
        }
    }

    [[nodiscard]] Result<bool> active() override {
        const gpiod_line_value value = gpiod_line_request_get_value(request_.get(), offset_);
        if (value == GPIOD_LINE_VALUE_ERROR) return failed(name_, "cannot be read", errno);
        return value == GPIOD_LINE_VALUE_ACTIVE;
    }

  private:
    GpioLine name_;
    unsigned offset_;
    Owned<gpiod_line_request> request_;
    Owned<gpiod_edge_event_buffer> buffer_;
    std::uint32_t last_number_ = 0;  // the kernel counts from 1
};

}  // namespace

void CloseChip::operator()(gpiod_chip* chip) const { gpiod_chip_close(chip); }

std::optional<ChipNames> names_of(gpiod_chip* chip) {
    const Owned<gpiod_chip_info> info(gpiod_chip_get_info(chip));
    if (!info) return std::nullopt;
    return ChipNames{gpiod_chip_info_get_name(info.get()), gpiod_chip_info_get_label(info.get())};
}

int find_line(gpiod_chip* chip, const std::string& name) {
    return gpiod_chip_get_line_offset_from_name(chip, name.c_str());
}

bool has_line(gpiod_chip* chip, unsigned offset) {
    return Owned<gpiod_line_info>(gpiod_chip_get_line_info(chip, offset)) != nullptr;
}

std::optional<std::string> holder_of(gpiod_chip* chip, unsigned offset) {
    const Owned<gpiod_line_info> info(gpiod_chip_get_line_info(chip, offset));
    if (!info || !gpiod_line_info_is_used(info.get())) return std::nullopt;
    const char* consumer = gpiod_line_info_get_consumer(info.get());
    return consumer == nullptr ? "" : consumer;
}

std::vector<ListedLine> lines_of(gpiod_chip* chip) {
    std::vector<ListedLine> lines;
    const Owned<gpiod_chip_info> chip_info(gpiod_chip_get_info(chip));
    const std::size_t count = chip_info ? gpiod_chip_info_get_num_lines(chip_info.get()) : 0;
    for (unsigned offset = 0; offset < count; ++offset) {
        const Owned<gpiod_line_info> info(gpiod_chip_get_line_info(chip, offset));
        if (!info) continue;
        const char* name = gpiod_line_info_get_name(info.get());
        lines.push_back({offset, name == nullptr ? "" : name, holder_of(chip, offset),
                         gpiod_line_info_get_direction(info.get()) == GPIOD_LINE_DIRECTION_OUTPUT});
    }
    return lines;
}

std::unique_ptr<OutputBank> request_bank(gpiod_chip* chip, std::span<const unsigned> offsets,
                                         std::uint32_t active_low) {
    const Owned<gpiod_line_settings> settings(gpiod_line_settings_new());
    if (!settings) return nullptr;
    gpiod_line_settings_set_direction(settings.get(), GPIOD_LINE_DIRECTION_OUTPUT);
    gpiod_line_settings_set_output_value(settings.get(), GPIOD_LINE_VALUE_INACTIVE);
    auto made = request(chip, offsets, settings.get(), active_low);
    if (!made) return nullptr;
    return std::make_unique<Bank>(std::move(made));
}

std::unique_ptr<GpioInput> request_line(Chip& chip, unsigned offset, const GpioLine& line, GpioEdges edges) {
    const Owned<gpiod_line_settings> settings(gpiod_line_settings_new());
    Owned<gpiod_edge_event_buffer> buffer(gpiod_edge_event_buffer_new(kKernelBuffer));
    if (!settings || !buffer) return nullptr;
    gpiod_line_settings_set_direction(settings.get(), GPIOD_LINE_DIRECTION_INPUT);
    gpiod_line_settings_set_edge_detection(settings.get(),
                                           edges == GpioEdges::both ? GPIOD_LINE_EDGE_BOTH : GPIOD_LINE_EDGE_RISING);
    gpiod_line_settings_set_event_clock(settings.get(), GPIOD_LINE_CLOCK_MONOTONIC);
    constexpr std::array kBiases{GPIOD_LINE_BIAS_AS_IS, GPIOD_LINE_BIAS_DISABLED, GPIOD_LINE_BIAS_PULL_UP,
                                 GPIOD_LINE_BIAS_PULL_DOWN};
    gpiod_line_settings_set_bias(settings.get(), kBiases[static_cast<std::size_t>(line.bias)]);
    auto made = request(chip.get(), {&offset, 1}, settings.get(), line.active_low ? 1 : 0);
    if (!made) return nullptr;
    return std::make_unique<Input>(line, offset, std::move(made), std::move(buffer));
}

}  // namespace hord::drivers::gpio

namespace hord::drivers {

std::string gpiod_version() { return gpiod_api_version(); }

}  // namespace hord::drivers
