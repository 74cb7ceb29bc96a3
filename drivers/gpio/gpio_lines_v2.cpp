// libgpiod 2.x. The kernel numbers the edges of a line: gaps count the edges that it dropped.
#include <array>
#include <cerrno>
#include <optional>
#include <utility>

#include <fcntl.h>
#include <gpiod.h>

#include "drivers/gpio/gpio_lines.h"

namespace hord::drivers {
namespace {

constexpr const char* kConsumer = "hord";
constexpr std::size_t kKernelBuffer = 256;

struct Free {
    void operator()(gpiod_chip* chip) const { gpiod_chip_close(chip); }
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
using Chip = Owned<gpiod_chip>;

Result<Chip> open_chip(const GpioLine& line) {
    Chip found;
    std::string labels, found_at;
    bool denied = false;
    for (const std::string& path : gpio::chip_paths()) {
        Chip chip(gpiod_chip_open(path.c_str()));
        const Owned<gpiod_chip_info> info(chip ? gpiod_chip_get_info(chip.get()) : nullptr);
        if (!info) {
            denied = denied || errno == EACCES || errno == EPERM;
            continue;
        }
        const std::string label = gpiod_chip_info_get_label(info.get());
        labels += (labels.empty() ? "\"" : ", \"") + label + "\"";
        if (path == line.chip || gpiod_chip_info_get_name(info.get()) == line.chip) return chip;
        if (label != line.chip) continue;
        if (found) return gpio::two_chips(line, found_at, path);
        found = std::move(chip);
        found_at = path;
    }
    if (!found) return gpio::no_chip(line, labels, denied);
    return found;
}

Result<unsigned> find_line(gpiod_chip* chip, const GpioLine& line) {
    int offset = gpio::offset_of(line.line);
    if (offset < 0) offset = gpiod_chip_get_line_offset_from_name(chip, line.line.c_str());
    if (offset < 0 || !Owned<gpiod_line_info>(gpiod_chip_get_line_info(chip, static_cast<unsigned>(offset))))
        return gpio::no_line(line);
    return static_cast<unsigned>(offset);
}

std::string holder_of(gpiod_chip* chip, unsigned offset) {
    const Owned<gpiod_line_info> info(gpiod_chip_get_line_info(chip, offset));
    const char* consumer = info ? gpiod_line_info_get_consumer(info.get()) : nullptr;
    return consumer == nullptr ? std::string() : std::string(consumer);
}
bool used(gpiod_chip* chip, unsigned offset) {
    const Owned<gpiod_line_info> info(gpiod_chip_get_line_info(chip, offset));
    return info && gpiod_line_info_is_used(info.get());
}

class Outputs final : public GpioOutputs {
  public:
    // One request for the lines of a chip.
    struct Bank {
        std::string path;
        Chip chip;
        std::vector<unsigned> offsets;
        std::vector<std::size_t> channels;  // of offsets[k]
        Owned<gpiod_line_request> request;
    };

    static Result<std::unique_ptr<GpioOutputs>> request(const std::vector<GpioLine>& lines) {
        auto outputs = std::make_unique<Outputs>();
        outputs->lines_ = lines;
        for (std::size_t channel = 0; channel < lines.size(); ++channel) {
            auto chip = open_chip(lines[channel]);
            if (!chip) return tl::unexpected(chip.error());
            const std::string path = gpiod_chip_get_path(chip->get());
            Bank* bank = nullptr;
            for (Bank& other : outputs->banks_) {
                if (other.path == path) bank = &other;
            }
            if (bank == nullptr) {
                bank = &outputs->banks_.emplace_back();
                bank->path = path;
                bank->chip = std::move(*chip);
            }
            const auto offset = find_line(bank->chip.get(), lines[channel]);
            if (!offset) return tl::unexpected(offset.error());
            for (const unsigned other : bank->offsets) {
                if (other == *offset) return gpio::named_twice(lines[channel]);
            }
            bank->offsets.push_back(*offset);
            bank->channels.push_back(channel);
        }
        for (Bank& bank : outputs->banks_) {
            if (auto done = outputs->take(bank); !done) return tl::unexpected(done.error());
        }
        return outputs;
    }

    Result<void> set(std::uint32_t active) override {
        std::optional<Error> wrong;
        for (Bank& bank : banks_) {  // also after a failure: other lines may have to go off
            std::array<gpiod_line_value, 32> values{};
            for (std::size_t k = 0; k < bank.channels.size(); ++k) {
                values[k] =
                    ((active >> bank.channels[k]) & 1U) != 0 ? GPIOD_LINE_VALUE_ACTIVE : GPIOD_LINE_VALUE_INACTIVE;
            }
            if (gpiod_line_request_set_values(bank.request.get(), values.data()) != 0 && !wrong) {
                wrong = gpio::failed(lines_[bank.channels[0]], "cannot be set", errno).value();
            }
        }
        if (wrong) return tl::unexpected(*wrong);
        return {};
    }

  private:
    Result<void> take(Bank& bank) {
        const Owned<gpiod_line_config> config(gpiod_line_config_new());
        const Owned<gpiod_request_config> request(gpiod_request_config_new());
        const Owned<gpiod_line_settings> settings(gpiod_line_settings_new());
        const GpioLine& first = lines_[bank.channels[0]];
        if (!config || !request || !settings) return gpio::failed(first, "no memory for its request", errno);
        gpiod_request_config_set_consumer(request.get(), kConsumer);
        gpiod_line_settings_set_direction(settings.get(), GPIOD_LINE_DIRECTION_OUTPUT);
        gpiod_line_settings_set_output_value(settings.get(), GPIOD_LINE_VALUE_INACTIVE);
        for (std::size_t k = 0; k < bank.channels.size(); ++k) {
            gpiod_line_settings_set_active_low(settings.get(), lines_[bank.channels[k]].active_low);
            if (gpiod_line_config_add_line_settings(config.get(), &bank.offsets[k], 1, settings.get()) != 0) {
                return gpio::failed(lines_[bank.channels[k]], "cannot be described", errno);
            }
        }
        bank.request.reset(gpiod_chip_request_lines(bank.chip.get(), request.get(), config.get()));
        if (bank.request) return {};
        const int error = errno;
        std::size_t at = 0;
        for (std::size_t k = bank.offsets.size(); error == EBUSY && k > 0; --k) {
            if (used(bank.chip.get(), bank.offsets[k - 1])) at = k - 1;
        }
        return gpio::failed(lines_[bank.channels[at]], "cannot be taken as an output", error,
                            error == EBUSY ? holder_of(bank.chip.get(), bank.offsets[at]) : std::string());
    }

    std::vector<GpioLine> lines_;
    std::vector<Bank> banks_;
};

class Input final : public GpioInput {
  public:
    static Result<std::unique_ptr<GpioInput>> request(const GpioLine& wanted, GpioEdges edges) {
        auto input = std::make_unique<Input>();
        input->name_ = wanted;
        auto chip = open_chip(wanted);
        if (!chip) return tl::unexpected(chip.error());
        const auto offset = find_line(chip->get(), wanted);
        if (!offset) return tl::unexpected(offset.error());
        const Owned<gpiod_line_config> config(gpiod_line_config_new());
        const Owned<gpiod_request_config> request(gpiod_request_config_new());
        const Owned<gpiod_line_settings> settings(gpiod_line_settings_new());
        input->buffer_.reset(gpiod_edge_event_buffer_new(kKernelBuffer));
        if (!config || !request || !settings || !input->buffer_)
            return gpio::failed(wanted, "no memory for its request", errno);
        gpiod_request_config_set_consumer(request.get(), kConsumer);
        gpiod_request_config_set_event_buffer_size(request.get(), kKernelBuffer);
        gpiod_line_settings_set_direction(settings.get(), GPIOD_LINE_DIRECTION_INPUT);
        gpiod_line_settings_set_edge_detection(
            settings.get(), edges == GpioEdges::both ? GPIOD_LINE_EDGE_BOTH : GPIOD_LINE_EDGE_RISING);
        gpiod_line_settings_set_event_clock(settings.get(), GPIOD_LINE_CLOCK_MONOTONIC);
        gpiod_line_settings_set_active_low(settings.get(), wanted.active_low);
        constexpr std::array kBiases{GPIOD_LINE_BIAS_AS_IS, GPIOD_LINE_BIAS_DISABLED, GPIOD_LINE_BIAS_PULL_UP,
                                     GPIOD_LINE_BIAS_PULL_DOWN};
        gpiod_line_settings_set_bias(settings.get(), kBiases[static_cast<std::size_t>(wanted.bias)]);
        if (gpiod_line_config_add_line_settings(config.get(), &*offset, 1, settings.get()) != 0)
            return gpio::failed(wanted, "cannot be described", errno);
        input->request_.reset(gpiod_chip_request_lines(chip->get(), request.get(), config.get()));
        if (!input->request_) {
            const int error = errno;
            return gpio::failed(wanted, "cannot be taken as an input with edges", error,
                                error == EBUSY ? holder_of(chip->get(), *offset) : std::string());
        }
        input->offset_ = *offset;
        const int fd = input->fd();
        if (fcntl(fd, F_SETFL, fcntl(fd, F_GETFL) | O_NONBLOCK) != 0)
            return gpio::failed(wanted, "cannot be read without waiting", errno);
        return input;
    }

    [[nodiscard]] int fd() const override { return gpiod_line_request_get_fd(request_.get()); }

    Result<void> read(std::vector<GpioEdge>& into) override {
        for (;;) {
            const int count = gpiod_line_request_read_edge_events(request_.get(), buffer_.get(), kKernelBuffer);
            if (count < 0) {
                if (errno == EAGAIN || errno == EWOULDBLOCK) return {};
                if (errno == EINTR) continue;
                return gpio::failed(name_, "its edges cannot be read", errno);
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
        if (value == GPIOD_LINE_VALUE_ERROR) return gpio::failed(name_, "cannot be read", errno);
        return value == GPIOD_LINE_VALUE_ACTIVE;
    }

  private:
    GpioLine name_;
    unsigned offset_ = 0;
    Owned<gpiod_line_request> request_;
    Owned<gpiod_edge_event_buffer> buffer_;
    std::uint32_t last_number_ = 0;  // the kernel counts from 1
};

}  // namespace

Result<std::unique_ptr<GpioOutputs>> request_outputs(const std::vector<GpioLine>& lines) {
    return Outputs::request(lines);
}
Result<std::unique_ptr<GpioInput>> request_input(const GpioLine& line, GpioEdges edges) {
    return Input::request(line, edges);
}
std::string gpiod_version() { return gpiod_api_version(); }

}  // namespace hord::drivers
