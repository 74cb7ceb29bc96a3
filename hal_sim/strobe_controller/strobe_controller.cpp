#include "hal_sim/strobe_controller/strobe_controller.h"

#include <algorithm>
#include <array>
#include <cerrno>
#include <cmath>
#include <cstdlib>
#include <cstring>
#include <sstream>

#include <fcntl.h>
#include <fmt/format.h>
#include <netinet/in.h>
#include <poll.h>
#include <sys/eventfd.h>
#include <sys/socket.h>
#include <termios.h>

namespace hord::sim {
namespace {

constexpr int kInvalid = 1, kUnknown = 2, kBadNumber = 3, kWrongCount = 4, kAdjusted = 5;
constexpr auto kLate = std::chrono::milliseconds(300);

std::string error(int number) { return number == 0 ? std::string() : fmt::format("Err {}", number); }

// The longest pulse and the largest share of time at a brightness, as the manual's table has them.
bool allowed(double percent, double pulse_ms) {
    if (percent <= 100) return pulse_ms <= 999;
    if (percent <= 200) return pulse_ms <= 30;
    if (percent <= 300) return pulse_ms <= 10;
    if (percent <= 500) return pulse_ms <= 2;
    return pulse_ms <= 1;
}

// "0.5A", "100ma", "20us", "0.02": a number in A or ms.
std::optional<double> number_of(std::string text) {
    std::erase(text, ' ');
    std::size_t used = 0;
    double value = 0;
    try {
        value = std::stod(text, &used);
    } catch (const std::exception&) {
        return std::nullopt;
    }
    std::string unit = text.substr(used);
    std::transform(unit.begin(), unit.end(), unit.begin(), [](unsigned char c) { return std::tolower(c); });
    if (unit.empty() || unit == "ms" || unit == "a") return value;
    if (unit == "us" || unit == "ma") return value / 1000;
    if (unit == "s") return value * 1000;
    return std::nullopt;
}

}  // namespace

StrobeController::StrobeController(const hal::Clock& clock, Options options)
    : clock_(clock), options_(options), outputs_(static_cast<std::size_t>(options.outputs)) {}

Result<std::unique_ptr<StrobeController>> StrobeController::open(const hal::Clock& clock, Options options) {
    std::unique_ptr<StrobeController> made(new StrobeController(clock, options));
    made->wake_.reset(eventfd(0, EFD_CLOEXEC | EFD_NONBLOCK));
    if (options.serial) {
        made->client_.reset(posix_openpt(O_RDWR | O_NOCTTY | O_CLOEXEC));
        std::array<char, 64> name{};
        if (!made->client_ || grantpt(made->client_.get()) != 0 || unlockpt(made->client_.get()) != 0 ||
            ptsname_r(made->client_.get(), name.data(), name.size()) != 0)
            return fail(ErrorCode::io, "the strobe controller has no pseudo-terminal", "check /dev/pts");
        made->device_ = name.data();
        // Held open, so that the driver's end may close and open again. Raw before the driver opens it: no echo.
        made->far_end_.reset(::open(made->device_.c_str(), O_RDWR | O_NOCTTY | O_CLOEXEC));
        termios line{};
        tcgetattr(made->far_end_.get(), &line);
        cfmakeraw(&line);
        tcsetattr(made->far_end_.get(), TCSANOW, &line);
    } else if (auto listening = made->listen(0); !listening) {
        return tl::unexpected(listening.error());
    }
    made->thread_ = std::thread([raw = made.get()] { raw->serve(); });
    return made;
}

StrobeController::~StrobeController() {
    if (!thread_.joinable()) return;
    {
        const std::scoped_lock lock(mutex_);
        stop_ = true;
    }
    eventfd_write(wake_.get(), 1);
    thread_.join();
}

Result<void> StrobeController::listen(int port) {
    listener_.reset(socket(AF_INET, SOCK_STREAM | SOCK_CLOEXEC, 0));
    const int yes = 1;
    setsockopt(listener_.get(), SOL_SOCKET, SO_REUSEADDR, &yes, sizeof yes);
    sockaddr_in address{};
    address.sin_family = AF_INET;
    address.sin_addr.s_addr = htonl(INADDR_LOOPBACK);
    address.sin_port = htons(static_cast<std::uint16_t>(port));
    socklen_t size = sizeof address;
    auto* const name = reinterpret_cast<sockaddr*>(&address);
    if (bind(listener_.get(), name, size) != 0 || ::listen(listener_.get(), 1) != 0 ||
        getsockname(listener_.get(), name, &size) != 0)
        return fail(ErrorCode::io, std::string("the strobe controller cannot listen: ") + std::strerror(errno),
                    "check the limit of open files");
    port_ = ntohs(address.sin_port);
    return {};
}

void StrobeController::drop_client() {
    if (!options_.serial) client_.reset();
    received_.clear();
}

void StrobeController::serve() {
    for (;;) {
        {
            const std::scoped_lock lock(mutex_);
            if (stop_) return;
            if (std::exchange(drop_, false)) drop_client();
            if (!options_.serial && !plugged_) {
                listener_.reset();
                drop_client();
            } else if (!options_.serial && !listener_) {
                (void)listen(port_);
            }
        }
        std::array<pollfd, 3> fds{{{wake_.get(), POLLIN, 0}, {listener_.get(), POLLIN, 0}, {client_.get(), POLLIN, 0}}};
        if (poll(fds.data(), fds.size(), -1) < 0 && errno != EINTR) return;
        if (fds[0].revents != 0) {
            eventfd_t count = 0;
            eventfd_read(wake_.get(), &count);
            continue;
        }
        if (fds[1].revents != 0) {  // a new connection replaces the old one
            common::UniqueFd fresh(accept4(listener_.get(), nullptr, nullptr, SOCK_CLOEXEC));
            const std::scoped_lock lock(mutex_);
            ++connections_;
            client_ = std::move(fresh);
            received_.clear();
        } else if (fds[2].revents != 0 && !receive()) {
            if (options_.serial) return;
            drop_client();
        }
    }
}

bool StrobeController::receive() {
    std::array<char, 256> bytes{};
    const ssize_t count = ::read(client_.get(), bytes.data(), bytes.size());
    if (count <= 0) return false;
    received_.append(bytes.data(), static_cast<std::size_t>(count));
    for (std::size_t end = received_.find('\r'); end != std::string::npos; end = received_.find('\r')) {
        const std::string line = received_.substr(0, end);
        received_.erase(0, end + 1);
        answer(line);
    }
    return true;
}

void StrobeController::answer(const std::string& line) {
    std::string text;
    Fault fault{};
    {
        const std::scoped_lock lock(mutex_);
        fault = line.starts_with(fault_at_) ? fault_ : Fault::none;
        if (fault == Fault::silent) return;
        text = reply_to(line);
    }
    // The controller returns the line, then what it printed, LF CR, and the prompt.
    std::string reply = line + text + "\n\r>";
    if (fault == Fault::garbage) reply = "\x01\x02zz?!>";
    if (fault == Fault::endless) reply.assign(8000, 'x');
    if (fault == Fault::busy) std::this_thread::sleep_for(kLate);
    // A peer that has closed the connection must not raise SIGPIPE.
    if (options_.serial) (void)!::write(client_.get(), reply.data(), reply.size());
    else (void)send(client_.get(), reply.data(), reply.size(), MSG_NOSIGNAL);
}

std::string StrobeController::reply_to(const std::string& line) {
    std::istringstream commands(line);
    std::string all;
    for (std::string one; std::getline(commands, one, ';');) {
        std::erase(one, ' ');
        all += execute(one);
    }
    return all;
}

std::string StrobeController::execute(std::string_view command) {
    if (command.size() < 2) return error(kUnknown);
    const std::string_view name = command.substr(0, 2);
    std::vector<double> numbers;
    std::istringstream list{std::string(command.substr(2))};
    for (std::string one; std::getline(list, one, ',');) {
        const auto value = number_of(one);
        if (!value) return error(kBadNumber);
        numbers.push_back(*value);
    }
    if (name == "VR") return fmt::format("RT{}20-20 (HW02) V031", options_.outputs);
    if (name == "GT" || name == "AW") return {};
    if (name == "TT") return numbers.empty() ? error(kWrongCount) : std::string();
    if (name == "GR") return fault_ == Fault::overheated ? "Evt0,130;" : "";
    if (name == "ST" || name == "RS" || name == "RW" || name == "RT" || name == "TR" || name == "VL")
        return execute_channel(name, numbers);
    return error(kUnknown);
}

std::string StrobeController::execute_channel(std::string_view name, const std::vector<double>& numbers) {
    if (numbers.empty()) return error(kWrongCount);
    const auto output = static_cast<int>(numbers[0]);
    if (output < 1 || output > options_.outputs) return error(kInvalid);
    Output& out = outputs_[static_cast<std::size_t>(output) - 1];
    const auto count = [&](std::size_t least, std::size_t most) {
        return numbers.size() >= least && numbers.size() <= most;
    };
    if (name == "ST") return describe(fault_ == Fault::wrong_output ? output % options_.outputs + 1 : output);
    if (name == "TR") return error(fault_ == Fault::refuses ? kInvalid : fire(output));
    if (name == "VL") {
        if (!count(3, 3)) return error(kWrongCount);
        if (numbers[2] != 0 && (numbers[2] < 0.01 || numbers[2] > 3)) return error(kInvalid);
        out.rated_a = numbers[2];
        return {};
    }
    if (name == "RT") {
        if (!count(4, 5)) return error(kWrongCount);
        const double pulse = numbers[1], delay = numbers[2], percent = numbers[3];
        if (percent < 0 || percent > 999 || pulse < 0.02 || pulse > 999 || delay > 999 || !allowed(percent, pulse) ||
            percent / 100 * out.rated_a > 20)
            return error(kInvalid);
        out = {.mode = fault_ == Fault::stays_on ? Mode::continuous : Mode::pulse,
               .percent = percent,
               .rated_a = out.rated_a,
               .pulse_ms = fault_ == Fault::adjusts || fault_ == Fault::rounds ? pulse * 2 : pulse,
               .delay_ms = std::max(delay, 0.02),
               .retrigger_ms = numbers.size() == 5 ? numbers[4] : 0,
               .triggered = out.triggered};
        return error(fault_ == Fault::adjusts || delay < 0.02 ? kAdjusted : 0);
    }
    if (!count(2, 4)) return error(kWrongCount);
    if (numbers[1] < 0 || numbers[1] > 100) return error(kInvalid);
    out.mode = name == "RS" ? Mode::continuous : Mode::switched;
    out.percent = numbers[1];
    return {};
}

std::string StrobeController::describe(int output) const {
    const Output& out = outputs_[static_cast<std::size_t>(output) - 1];
    return fmt::format("CH{},MD{},S {:.1f}, 0.0,DL{:.3f}ms,PU{:.3f}ms,RT {:.1f}us,IP{},FL0,CS0.000A,RA{:.3f}A", output,
                       static_cast<int>(out.mode), out.percent, out.delay_ms, out.pulse_ms, out.retrigger_ms * 1000,
                       output, out.rated_a);
}

int StrobeController::fire(int output) {
    Output& out = outputs_[static_cast<std::size_t>(output) - 1];
    if (out.mode != Mode::pulse) return 0;  // the trigger has no effect
    const hal::TimePoint now = clock_.now();
    const auto ms = [](double value) { return hal::Duration(std::llround(value * 1e6)); };
    if (out.triggered && now - *out.triggered < ms(out.retrigger_ms)) {
        ++ignored_;
        return 0;
    }
    out.triggered = now;
    pulses_.push_back({output, now + ms(out.delay_ms), ms(out.pulse_ms), out.percent / 100 * out.rated_a});
    return 0;
}

void StrobeController::misbehave(Fault fault, std::string command) {
    const std::scoped_lock lock(mutex_);
    fault_ = fault;
    fault_at_ = std::move(command);
}

void StrobeController::power_cycle() {
    {
        const std::scoped_lock lock(mutex_);
        outputs_.assign(outputs_.size(), {});
        drop_ = true;
    }
    eventfd_write(wake_.get(), 1);
}

void StrobeController::plug(bool in) {
    {
        const std::scoped_lock lock(mutex_);
        plugged_ = in;
    }
    eventfd_write(wake_.get(), 1);
}

void StrobeController::turn_knob(int output, double percent) {
    const std::scoped_lock lock(mutex_);
    outputs_[static_cast<std::size_t>(output) - 1].percent = percent;
}

void StrobeController::trigger(int output) {
    const std::scoped_lock lock(mutex_);
    fire(output);
}

std::vector<StrobeController::Pulse> StrobeController::pulses() const {
    const std::scoped_lock lock(mutex_);
    return pulses_;
}

bool StrobeController::continuous() const {
    const std::scoped_lock lock(mutex_);
    return std::ranges::any_of(outputs_, [](const Output& out) { return out.mode != Mode::pulse && out.percent > 0; });
}

int StrobeController::ignored() const {
    const std::scoped_lock lock(mutex_);
    return ignored_;
}

int StrobeController::connections() const {
    const std::scoped_lock lock(mutex_);
    return connections_;
}

}  // namespace hord::sim
