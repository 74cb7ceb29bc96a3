#include "tests/support/modbus_module/modbus_module.h"

#include <algorithm>
#include <array>
#include <cerrno>
#include <condition_variable>
#include <cstdlib>
#include <cstring>
#include <mutex>
#include <span>
#include <thread>
#include <utility>

#include <fcntl.h>
#include <netinet/in.h>
#include <netinet/tcp.h>
#include <poll.h>
#include <sched.h>
#include <sys/eventfd.h>
#include <sys/socket.h>
#include <termios.h>
#include <unistd.h>

namespace hord::test {
namespace {

using namespace std::chrono_literals;
using Bytes = std::vector<std::uint8_t>;

constexpr std::size_t kMbapBytes = 7, kMaxAdu = 260;
constexpr auto kSilence = 20ms;  // serial: a request begins after this silence

std::uint16_t crc_of(std::span<const std::uint8_t> bytes) {
    unsigned crc = 0xFFFF;
    for (const unsigned byte : bytes) {
        crc ^= byte;
        for (int bit = 0; bit < 8; ++bit) crc = (crc & 1U) != 0 ? crc >> 1U ^ 0xA001U : crc >> 1U;
    }
    return static_cast<std::uint16_t>(crc);
}

// Bytes of a request on a serial line, with its CRC; 0: not known yet, or unknown function.
std::size_t request_size(std::span<const std::uint8_t> frame) {
    if (frame.size() < 2) return 0;
    if (frame[1] == 43) return 7;
    return frame[1] >= 1 && frame[1] <= 6 ? 8 : 0;
}

}  // namespace

struct ModbusModule::Module {
    const hal::Clock& clock;
    const ModbusModuleOptions options;
    int port = 0;
    int listener = -1, wake = -1;
    int line = -1;            // serial: the module's end
    int line_kept_open = -1;  // the driver's end, kept open: no hang-up between drivers
    std::string device;
    std::vector<int> clients;  // owned by the module's thread; by the caller while it is off
    Bytes heard;               // serial: bytes of an incomplete request
    hal::TimePoint heard_at;
    std::thread thread;
    std::function<void(int, bool, hal::TimePoint)> on_coil;

    struct Fault {
        ModuleFault how = ModuleFault::none;
        int left = 0;  // requests; -1: all
        hal::Duration delay{};
    };
    mutable std::mutex mutex;
    std::condition_variable woken;
    bool stopping = false;
    static constexpr std::ptrdiff_t kHistory = 10'000;
    std::vector<Move> history;
    std::vector<bool> state;
    int accepted = 0, misbehaved = 0;
    Fault write_fault, read_fault;
    std::vector<std::pair<int, bool>> inputs_to_set;
    bool expired = false;
    int triggers = 0;
    ModuleImage image;  // module's thread; or anyone while it is off

    Module(const hal::Clock& c, const ModbusModuleOptions& o)
        : clock(c), options(o), port(o.port), state(static_cast<std::size_t>(o.coils)),
          image(o.kind, o.coils, o.pulse, o.watchdog) {
        image.moved = [this](int coil, bool on, hal::TimePoint at) { remember(coil, on, at); };
    }

    ~Module() {
        off();
        for (const int fd : {wake, line, line_kept_open}) {
            if (fd >= 0) close(fd);
        }
    }

    Result<void> on() {
        auto ready = options.serial ? open_line() : listen_on_loopback();
        if (!ready) return ready;
        stopping = false;
        thread = std::thread([this] {
            sched_param param{};
            param.sched_priority = options.realtime;
            if (options.realtime > 0) ::sched_setscheduler(0, SCHED_FIFO, &param);
            serve();
        });
        return {};
    }

    Result<void> listen_on_loopback() {
        listener = socket(AF_INET, SOCK_STREAM | SOCK_CLOEXEC, 0);
        sockaddr_in address{};
        address.sin_family = AF_INET;
        address.sin_port = htons(static_cast<std::uint16_t>(port));
        address.sin_addr.s_addr = htonl(INADDR_LOOPBACK);
        const int yes = 1;
        setsockopt(listener, SOL_SOCKET, SO_REUSEADDR, &yes, sizeof yes);
        socklen_t size = sizeof address;
        if (bind(listener, reinterpret_cast<sockaddr*>(&address), size) != 0 || listen(listener, 8) != 0) {
            const int error = errno;
            close(std::exchange(listener, -1));
            return fail(
                error == EADDRINUSE ? ErrorCode::busy : ErrorCode::io,
                "the coil module cannot listen on 127.0.0.1:" + std::to_string(port) + ": " + std::strerror(error),
                "use another port, or 0 for a free one");
        }
        getsockname(listener, reinterpret_cast<sockaddr*>(&address), &size);
        port = ntohs(address.sin_port);
        return {};
    }

    Result<void> open_line() {
        if (line >= 0) {  // discards what was sent while it was off
            std::array<std::uint8_t, kMaxAdu> bytes{};
            while (read(line, bytes.data(), bytes.size()) > 0) continue;
            heard.clear();
            return {};
        }
        line = posix_openpt(O_RDWR | O_NOCTTY | O_NONBLOCK | O_CLOEXEC);
        std::array<char, 64> name{};
        if (line < 0 || grantpt(line) != 0 || unlockpt(line) != 0 || ptsname_r(line, name.data(), name.size()) != 0) {
            return fail(ErrorCode::io, std::string("the coil module has no pseudo-terminal: ") + std::strerror(errno),
                        "mount devpts");
        }
        device = name.data();
        line_kept_open = ::open(device.c_str(), O_RDWR | O_NOCTTY | O_CLOEXEC);
        termios raw{};
        if (line_kept_open < 0 || tcgetattr(line_kept_open, &raw) != 0) {
            return fail(ErrorCode::io, device + " cannot be opened: " + std::strerror(errno), "mount devpts");
        }
        cfmakeraw(&raw);
        tcsetattr(line_kept_open, TCSANOW, &raw);
        return {};
    }

    void off() {
        if (!thread.joinable()) return;
        {
            const std::scoped_lock lock(mutex);
            stopping = true;
        }
        woken.notify_all();
        ring();
        thread.join();
    }

    void ring() const {
        const std::uint64_t one = 1;
        [[maybe_unused]] const auto bytes = write(wake, &one, sizeof one);
    }

    // Serves requests, ends pulses and expires the watchdog, until stopped.
    void serve() {
        for (;;) {
            std::vector<pollfd> fds = {{wake, POLLIN, 0}, {options.serial ? line : listener, POLLIN, 0}};
            for (const int client : clients) fds.push_back({client, POLLIN, 0});
            const hal::TimePoint next = image.next();
            timespec wait{};
            if (next != hal::TimePoint::max()) {
                const auto ns = std::max<std::int64_t>(0, (next - clock.now()).count());
                wait = {ns / 1'000'000'000, ns % 1'000'000'000};
            }
            if (ppoll(fds.data(), fds.size(), next == hal::TimePoint::max() ? nullptr : &wait, nullptr) < 0 &&
                errno != EINTR)
                break;
            if (!wake_up()) break;
            image.advance(clock.now());
            if (options.serial) {
                if ((fds[1].revents & POLLIN) != 0) hear();
            } else {
                if ((fds[1].revents & POLLIN) != 0) accept_one();
                for (std::size_t k = 2; k < fds.size(); ++k) {
                    if (fds[k].revents != 0 && !answer_client(fds[k].fd)) drop(fds[k].fd);
                }
            }
            const std::scoped_lock lock(mutex);
            expired = image.watchdog_expired();
            triggers = image.triggers();
        }
        while (!clients.empty()) drop(clients.back());
        if (listener >= 0) close(std::exchange(listener, -1));
        image.power_off(clock.now());
    }

    // Carries out the orders of other threads; false if one of them is to stop.
    bool wake_up() {
        std::uint64_t count = 0;
        [[maybe_unused]] const auto bytes = read(wake, &count, sizeof count);
        const std::scoped_lock lock(mutex);
        for (const auto& [number, on] : std::exchange(inputs_to_set, {})) image.set_input(number, on);
        return !stopping;
    }

    void accept_one() {
        const int client = accept4(listener, nullptr, nullptr, SOCK_CLOEXEC);
        if (client < 0) return;
        const int yes = 1;
        setsockopt(client, IPPROTO_TCP, TCP_NODELAY, &yes, sizeof yes);
        clients.push_back(client);
        const std::scoped_lock lock(mutex);
        ++accepted;
    }

    void drop(int client) {
        close(client);
        std::erase(clients, client);
    }

    void remember(int coil, bool on, hal::TimePoint at) {
        {
            const std::scoped_lock lock(mutex);
            state[static_cast<std::size_t>(coil)] = on;
            history.push_back({coil, on, at});
            if (history.size() >= 2 * static_cast<std::size_t>(kHistory))
                history.erase(history.begin(), history.begin() + kHistory);
        }
        if (on_coil) on_coil(coil, on, at);
    }

    Fault fault_for(bool is_write) {
        const std::scoped_lock lock(mutex);
        Fault& fault = is_write ? write_fault : read_fault;
        if (fault.how == ModuleFault::none || fault.left == 0) return {};
        if (fault.left > 0) --fault.left;
        ++misbehaved;
        return fault;
    }

    // Waits; returns early if the module stops.
    void wait(hal::Duration duration) {
        std::unique_lock lock(mutex);
        woken.wait_for(lock, duration, [this] { return stopping; });
    }

    // Serves one request of a client; false when the connection ended.
    bool answer_client(int client) {
        std::array<std::uint8_t, kMaxAdu> frame{};
        if (recv(client, frame.data(), kMbapBytes, MSG_WAITALL) != static_cast<ssize_t>(kMbapBytes)) return false;
        const std::size_t rest = static_cast<std::size_t>(frame[4] << 8 | frame[5]) - 1;
        if (rest < 1 || rest > kMaxAdu - kMbapBytes) return false;
        if (recv(client, frame.data() + kMbapBytes, rest, MSG_WAITALL) != static_cast<ssize_t>(rest)) return false;
        return answer({frame.data() + kMbapBytes, rest}, [&](const Bytes& pdu) {
            Bytes reply(frame.begin(), frame.begin() + kMbapBytes);
            reply[4] = static_cast<std::uint8_t>((pdu.size() + 1) >> 8);
            reply[5] = static_cast<std::uint8_t>((pdu.size() + 1) & 0xFF);
            reply.insert(reply.end(), pdu.begin(), pdu.end());
            return std::pair(client, reply);
        });
    }

    // Reads from the serial line. Bytes before a silence that are not a whole request are discarded.
    void hear() {
        std::array<std::uint8_t, kMaxAdu> bytes{};
        const ssize_t count = read(line, bytes.data(), bytes.size());
        if (count <= 0) return;
        const hal::TimePoint now = clock.now();
        if (now - heard_at > kSilence || heard.size() > kMaxAdu) heard.clear();
        heard_at = now;
        heard.insert(heard.end(), bytes.begin(), bytes.begin() + count);
        const std::size_t size = request_size(heard);
        if (size == 0 || heard.size() < size) return;
        const Bytes frame(heard.begin(), heard.begin() + static_cast<std::ptrdiff_t>(size));
        heard.erase(heard.begin(), heard.begin() + static_cast<std::ptrdiff_t>(size));
        const bool whole = crc_of(std::span(frame).first(size - 2)) == (frame[size - 2] | frame[size - 1] << 8);
        if (!whole || frame[0] != options.unit) return;
        (void)answer(std::span(frame).subspan(1, size - 3), [&](const Bytes& pdu) {
            Bytes reply{frame[0]};
            reply.insert(reply.end(), pdu.begin(), pdu.end());
            const std::uint16_t crc = crc_of(reply);
            reply.push_back(static_cast<std::uint8_t>(crc & 0xFF));
            reply.push_back(static_cast<std::uint8_t>(crc >> 8));
            return std::pair(line, reply);
        });
    }

    // Carries a request out, with its fault if there is one; `framed` frames the reply. Returns false to hang up.
    template <class Framed>
    bool answer(std::span<const std::uint8_t> pdu, Framed framed) {
        const bool is_write = pdu[0] == 5 || pdu[0] == 6;
        const Fault fault = fault_for(is_write);
        switch (fault.how) {
            case ModuleFault::silent: return true;
            case ModuleFault::close: return false;
            case ModuleFault::exception: return send_all(framed({static_cast<std::uint8_t>(pdu[0] | 0x80), 4}));
            case ModuleFault::stuck: return send_all(framed(Bytes(pdu.begin(), pdu.end())));
            default: break;
        }
        auto [to, reply] = framed(image.answer(pdu, clock.now()));
        if (fault.how == ModuleFault::late) wait(fault.delay);
        if (fault.how == ModuleFault::damaged) reply[reply.size() - 2] ^= 0x10;
        if (fault.how == ModuleFault::noise) reply.insert(reply.begin(), {0xFF, 0x00, 0x55});
        if (fault.how != ModuleFault::drip) return send_all({to, reply});
        for (const std::uint8_t byte : reply) {
            if (!send_all({to, {byte}})) return false;
            wait(fault.delay);
        }
        return true;
    }

    bool send_all(const std::pair<int, Bytes>& message) const {
        const auto& [to, bytes] = message;
        const ssize_t sent =
            options.serial ? write(to, bytes.data(), bytes.size()) : send(to, bytes.data(), bytes.size(), MSG_NOSIGNAL);
        return sent == static_cast<ssize_t>(bytes.size());
    }
};

ModbusModule::ModbusModule(std::unique_ptr<Module> module) : module_(std::move(module)) {}
ModbusModule::~ModbusModule() = default;

Result<std::unique_ptr<ModbusModule>> ModbusModule::open(const hal::Clock& clock, const ModbusModuleOptions& options) {
    auto module = std::make_unique<Module>(clock, options);
    module->wake = eventfd(0, EFD_CLOEXEC | EFD_NONBLOCK);
    if (module->wake < 0) return fail(ErrorCode::io, "the coil module cannot be made", "check the limit of open files");
    if (auto listening = module->on(); !listening) return tl::unexpected(listening.error());
    return std::unique_ptr<ModbusModule>(new ModbusModule(std::move(module)));
}

int ModbusModule::port() const { return module_->port; }
std::string ModbusModule::device() const { return module_->device; }

bool ModbusModule::coil(int number) const {
    const std::scoped_lock lock(module_->mutex);
    return module_->state[static_cast<std::size_t>(number)];
}

std::vector<ModbusModule::Move> ModbusModule::history() const {
    const std::scoped_lock lock(module_->mutex);
    return module_->history;
}

int ModbusModule::connections() const {
    const std::scoped_lock lock(module_->mutex);
    return module_->accepted;
}

void ModbusModule::misbehave(ModuleFault fault, int writes, hal::Duration delay, bool reads) {
    const std::scoped_lock lock(module_->mutex);
    module_->write_fault = {fault, writes, delay};
    module_->read_fault = {fault, reads ? -1 : 0, delay};
}

void ModbusModule::misbehave_at_reads(ModuleFault fault, int reads, hal::Duration delay) {
    const std::scoped_lock lock(module_->mutex);
    module_->read_fault = {fault, reads, delay};
}

int ModbusModule::misbehaved() const {
    const std::scoped_lock lock(module_->mutex);
    return module_->misbehaved;
}

void ModbusModule::set_input(int number, bool on) {
    {
        const std::scoped_lock lock(module_->mutex);
        module_->inputs_to_set.emplace_back(number, on);
    }
    module_->ring();
}

bool ModbusModule::watchdog_expired() const {
    const std::scoped_lock lock(module_->mutex);
    return module_->expired;
}

int ModbusModule::watchdog_triggers() const {
    const std::scoped_lock lock(module_->mutex);
    return module_->triggers;
}

void ModbusModule::power_off() { module_->off(); }
Result<void> ModbusModule::power_on() { return module_->thread.joinable() ? Result<void>{} : module_->on(); }

void ModbusModule::on_coil(std::function<void(int coil, bool on, hal::TimePoint at)> callback) {
    module_->on_coil = std::move(callback);
}

}  // namespace hord::test
