#include "drivers/gpio/gpio_lines.h"

#include <algorithm>
#include <cerrno>
#include <charconv>
#include <cstring>
#include <filesystem>

#include <fcntl.h>
#include <gpiod.h>

#include "drivers/gpio/gpio_chip.h"

namespace hord::drivers {
namespace gpio {

std::string name_of(const GpioLine& line) { return "GPIO line \"" + line.line + "\" of chip \"" + line.chip + "\""; }

int offset_of(const std::string& line) {
    int offset = -1;
    const auto read = std::from_chars(line.data(), line.data() + line.size(), offset);
    return read.ec == std::errc() && read.ptr == line.data() + line.size() && offset >= 0 ? offset : -1;
}

tl::unexpected<Error> failed(const GpioLine& line, const char* what, int error, const std::string& holder) {
    if (error == EBUSY) {
        return fail(
            ErrorCode::busy,
            name_of(line) + ": " + what + ": " + (holder.empty() ? "it is in use" : "\"" + holder + "\" holds it"),
            "stop the program or the kernel driver that holds it (gpioinfo), or name another line");
    }
    const bool gone = error == ENODEV || error == ENXIO;
    return fail(gone ? ErrorCode::disconnected : ErrorCode::io,
                name_of(line) + ": " + what + ": " + (gone ? "the chip is gone" : std::strerror(error)),
                gone ? "check its cable and its driver" : "look at the kernel's log");
}

std::vector<std::string> chip_paths(const std::filesystem::path& dev) {
    std::vector<std::string> paths;
    std::error_code error;
    for (const auto& entry : std::filesystem::directory_iterator(dev, error)) {
        if (entry.path().filename().string().starts_with("gpiochip") && !entry.is_symlink(error))
            paths.push_back(entry.path().string());
    }
    std::ranges::sort(paths, {}, [](const std::string& path) { return std::pair(path.size(), path); });
    return paths;
}

}  // namespace gpio
namespace {

struct FoundLine {
    std::string path;  // of the chip
    gpio::Chip chip;
    unsigned offset = 0;
};

Result<FoundLine> find(const GpioLine& line) {
    FoundLine found;
    std::string labels;
    bool denied = false;
    for (const std::string& path : gpio::chip_paths("/dev")) {
        gpio::Chip chip(gpiod_chip_open(path.c_str()));
        const auto names = chip ? gpio::names_of(chip.get()) : std::nullopt;
        if (!names) {
            denied = denied || errno == EACCES || errno == EPERM;
            continue;
        }
        labels += (labels.empty() ? "\"" : ", \"") + names->label + "\"";
        const bool unique = path == line.chip || names->name == line.chip;
        if (!unique && names->label != line.chip) continue;
        if (found.chip && !unique)
            return fail(ErrorCode::invalid_argument,
                        gpio::name_of(line) + ": " + found.path + " and " + path + " have this label, both",
                        "name the chip by its path");
        found.chip = std::move(chip);
        found.path = path;
        if (unique) break;
    }
    if (!found.chip)
        return fail(denied && labels.empty() ? ErrorCode::io : ErrorCode::not_found,
                    gpio::name_of(line) + ": there is no such chip; " + (denied ? "some may not be opened; " : "") +
                        (labels.empty() ? "none was found" : "there are: " + labels),
                    denied ? "give the service's user the GPIO chips (udev), or run as root"
                           : "check the board's driver, and the label that gpiodetect prints");
    int offset = gpio::offset_of(line.line);
    if (offset < 0) offset = gpio::find_line(found.chip.get(), line.line);
    if (offset < 0 || !gpio::has_line(found.chip.get(), static_cast<unsigned>(offset)))
        return fail(ErrorCode::not_found, gpio::name_of(line) + " does not exist",
                    "use a name or an offset that gpioinfo prints");
    found.offset = static_cast<unsigned>(offset);
    return found;
}

class Outputs final : public GpioOutputs {
  public:
    static Result<std::unique_ptr<GpioOutputs>> request(const std::vector<GpioLine>& lines) {
        auto outputs = std::make_unique<Outputs>();
        outputs->lines_ = lines;
        for (std::size_t channel = 0; channel < lines.size(); ++channel) {
            auto found = find(lines[channel]);
            if (!found) return tl::unexpected(found.error());
            auto bank = std::ranges::find(outputs->banks_, found->path, &Bank::path);
            if (bank == outputs->banks_.end())
                bank = outputs->banks_.insert(bank, Bank{found->path, std::move(found->chip), {}, {}, {}});
            if (std::ranges::find(bank->offsets, found->offset) != bank->offsets.end())
                return fail(ErrorCode::invalid_argument, gpio::name_of(lines[channel]) + " is named twice",
                            "give each channel a line of its own");
            bank->offsets.push_back(found->offset);
            bank->channels.push_back(channel);
        }
        for (Bank& bank : outputs->banks_) {
            const std::uint32_t active_low =
                bank.gather([&](std::size_t channel) { return lines[channel].active_low; });
            bank.request = gpio::request_bank(bank.chip.get(), bank.offsets, active_low);
            if (bank.request) continue;
            const int error = errno;
            for (std::size_t k = 0; error == EBUSY && k < bank.offsets.size(); ++k) {
                if (const auto holder = gpio::holder_of(bank.chip.get(), bank.offsets[k]))
                    return gpio::failed(lines[bank.channels[k]], kNotTaken, error, *holder);
            }
            return gpio::failed(lines[bank.channels[0]], kNotTaken, error);
        }
        return outputs;
    }

    Result<void> set(std::uint32_t active) override {
        Result<void> done;
        for (Bank& bank : banks_) {  // also after a failure: other lines may have to go off
            if (!bank.request->set(bank.gather([&](std::size_t channel) { return (active >> channel & 1U) != 0; })) &&
                done)
                done = gpio::failed(lines_[bank.channels[0]], "cannot be set", errno);
        }
        return done;
    }

  private:
    static constexpr const char* kNotTaken = "cannot be taken as an output";
    // The lines of one chip.
    struct Bank {
        std::string path;
        gpio::Chip chip;
        std::vector<unsigned> offsets;
        std::vector<std::size_t> channels;  // of offsets[k]
        std::unique_ptr<gpio::OutputBank> request;

        template <class BitOf>
        [[nodiscard]] std::uint32_t gather(BitOf bit_of) const {
            std::uint32_t bits = 0;
            for (std::size_t k = 0; k < channels.size(); ++k) bits |= (bit_of(channels[k]) ? 1U : 0U) << k;
            return bits;
        }
    };
    std::vector<GpioLine> lines_;
    std::vector<Bank> banks_;
};

}  // namespace

Result<std::unique_ptr<GpioOutputs>> request_outputs(const std::vector<GpioLine>& lines) {
    return Outputs::request(lines);
}

Result<std::unique_ptr<GpioInput>> request_input(const GpioLine& line, GpioEdges edges) {
    auto found = find(line);
    if (!found) return tl::unexpected(found.error());
    auto input = gpio::request_line(found->chip, found->offset, line, edges);
    if (!input) {
        const int error = errno;
        return gpio::failed(line, "cannot be taken as an input with edges", error,
                            gpio::holder_of(found->chip.get(), found->offset).value_or(""));
    }
    if (fcntl(input->fd(), F_SETFL, fcntl(input->fd(), F_GETFL) | O_NONBLOCK) != 0)
        return gpio::failed(line, "cannot be read without waiting", errno);
    return input;
}

}  // namespace hord::drivers
