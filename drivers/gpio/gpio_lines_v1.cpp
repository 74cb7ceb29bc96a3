// libgpiod 1.6. The kernel buffers 16 edges of a line and drops further ones without a sign.
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
constexpr std::size_t kKernelBuffer = 16;

struct CloseChip {
    void operator()(gpiod_chip* chip) const { gpiod_chip_close(chip); }  // releases its lines, too
};
using Chip = std::unique_ptr<gpiod_chip, CloseChip>;

Result<Chip> open_chip(const GpioLine& line) {
    Chip found;
    std::string labels, found_at;
    bool denied = false;
    for (const std::string& path : gpio::chip_paths()) {
        Chip chip(gpiod_chip_open(path.c_str()));
        if (!chip) {
            denied = denied || errno == EACCES || errno == EPERM;
            continue;
        }
        const std::string label = gpiod_chip_label(chip.get());
        labels += (labels.empty() ? "\"" : ", \"") + label + "\"";
        if (path == line.chip || gpiod_chip_name(chip.get()) == line.chip) return chip;
        if (label != line.chip) continue;
        if (found) return gpio::two_chips(line, found_at, path);
        found = std::move(chip);
        found_at = path;
    }
    if (!found) return gpio::no_chip(line, labels, denied);
    return found;
}

Result<gpiod_line*> find_line(gpiod_chip* chip, const GpioLine& line) {
    const int offset = gpio::offset_of(line.line);
    gpiod_line* found = offset >= 0 ? gpiod_chip_get_line(chip, static_cast<unsigned>(offset))
                                    : gpiod_chip_find_line(chip, line.line.c_str());
    if (found == nullptr) return gpio::no_line(line);
    return found;
}

std::string holder_of(gpiod_line* line) {
    const char* consumer = gpiod_line_update(line) == 0 ? gpiod_line_consumer(line) : nullptr;
    return consumer == nullptr ? std::string() : std::string(consumer);
}

class Outputs final : public GpioOutputs {
  public:
    // One request for the lines of a chip. active_low is applied here: the kernel's flag would hold for the whole
    // request.
    struct Bank {
        Chip chip;
        gpiod_line_bulk lines{};
        std::vector<std::size_t> channels;  // of lines.lines[k]
    };

    static Result<std::unique_ptr<GpioOutputs>> request(const std::vector<GpioLine>& lines) {
        auto outputs = std::make_unique<Outputs>();
        outputs->lines_ = lines;
        for (std::size_t channel = 0; channel < lines.size(); ++channel) {
            auto chip = open_chip(lines[channel]);
            if (!chip) return tl::unexpected(chip.error());
            const std::string name = gpiod_chip_name(chip->get());
            Bank* bank = nullptr;
            for (Bank& other : outputs->banks_) {
                if (gpiod_chip_name(other.chip.get()) == name) bank = &other;
            }
            if (bank == nullptr) {
                bank = &outputs->banks_.emplace_back();
                bank->chip = std::move(*chip);
                gpiod_line_bulk_init(&bank->lines);
            }
            const auto line = find_line(bank->chip.get(), lines[channel]);
            if (!line) return tl::unexpected(line.error());
            for (unsigned k = 0; k < bank->lines.num_lines; ++k) {
                if (bank->lines.lines[k] == *line) return gpio::named_twice(lines[channel]);
            }
            gpiod_line_bulk_add(&bank->lines, *line);
            bank->channels.push_back(channel);
        }
        gpiod_line_request_config config{};
        config.consumer = kConsumer;
        config.request_type = GPIOD_LINE_REQUEST_DIRECTION_OUTPUT;
        for (Bank& bank : outputs->banks_) {
            const auto levels = outputs->levels(bank, 0);
            if (gpiod_line_request_bulk(&bank.lines, &config, levels.data()) == 0) continue;
            const int error = errno;
            std::size_t at = 0;
            std::string holder;
            for (unsigned k = 0; error == EBUSY && k < bank.lines.num_lines; ++k) {
                if (holder = holder_of(bank.lines.lines[k]);
                    !holder.empty() || gpiod_line_is_used(bank.lines.lines[k])) {
                    at = k;
                    break;
                }
            }
            return gpio::failed(lines[bank.channels[at]], "cannot be taken as an output", error, holder);
        }
        return outputs;
    }

    Result<void> set(std::uint32_t active) override {
        std::optional<Error> wrong;
        for (Bank& bank : banks_) {  // also after a failure: other lines may have to go off
            const auto values = levels(bank, active);
            if (gpiod_line_set_value_bulk(&bank.lines, values.data()) != 0 && !wrong) {
                wrong = gpio::failed(lines_[bank.channels[0]], "cannot be set", errno).value();
            }
        }
        if (wrong) return tl::unexpected(*wrong);
        return {};
    }

  private:
    [[nodiscard]] std::array<int, GPIOD_LINE_BULK_MAX_LINES> levels(const Bank& bank, std::uint32_t active) const {
        std::array<int, GPIOD_LINE_BULK_MAX_LINES> values{};
        for (std::size_t k = 0; k < bank.channels.size(); ++k) {
            const std::size_t channel = bank.channels[k];
            values[k] = (((active >> channel) & 1U) != 0) != lines_[channel].active_low ? 1 : 0;
        }
        return values;
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
        const auto line = find_line(chip->get(), wanted);
        if (!line) return tl::unexpected(line.error());
        gpiod_line_request_config config{};
        config.consumer = kConsumer;
        config.request_type =
            edges == GpioEdges::both ? GPIOD_LINE_REQUEST_EVENT_BOTH_EDGES : GPIOD_LINE_REQUEST_EVENT_RISING_EDGE;
        if (wanted.active_low) config.flags |= GPIOD_LINE_REQUEST_FLAG_ACTIVE_LOW;
        if (wanted.bias == GpioLine::Bias::disabled) config.flags |= GPIOD_LINE_REQUEST_FLAG_BIAS_DISABLE;
        if (wanted.bias == GpioLine::Bias::pull_up) config.flags |= GPIOD_LINE_REQUEST_FLAG_BIAS_PULL_UP;
        if (wanted.bias == GpioLine::Bias::pull_down) config.flags |= GPIOD_LINE_REQUEST_FLAG_BIAS_PULL_DOWN;
        if (gpiod_line_request(*line, &config, 0) != 0) {
            const int error = errno;
            return gpio::failed(wanted, "cannot be taken as an input with edges", error, holder_of(*line));
        }
        input->chip_ = std::move(*chip);
        input->line_ = *line;
        const int fd = input->fd();
        if (fcntl(fd, F_SETFL, fcntl(fd, F_GETFL) | O_NONBLOCK) != 0)
            return gpio::failed(wanted, "cannot be read without waiting", errno);
        return input;
    }

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
                return gpio::failed(name_, "its edges cannot be read", errno);
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
        if (value < 0) return gpio::failed(name_, "cannot be read", errno);
        return value != 0;
    }

  private:
    GpioLine name_;
    Chip chip_;
    gpiod_line* line_ = nullptr;
};

}  // namespace

Result<std::unique_ptr<GpioOutputs>> request_outputs(const std::vector<GpioLine>& lines) {
    return Outputs::request(lines);
}
Result<std::unique_ptr<GpioInput>> request_input(const GpioLine& line, GpioEdges edges) {
    return Input::request(line, edges);
}
std::string gpiod_version() { return gpiod_version_string(); }

}  // namespace hord::drivers
