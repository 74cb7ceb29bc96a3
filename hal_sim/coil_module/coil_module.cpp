#include "hal_sim/coil_module/coil_module.h"

#include <modbus/modbus.h>
#include <netinet/in.h>
#include <poll.h>
#include <sched.h>
#include <sys/eventfd.h>
#include <sys/socket.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <cerrno>
#include <condition_variable>
#include <cstring>
#include <mutex>
#include <string>
#include <thread>

namespace hord::sim {
namespace {

constexpr int kMbapBytes = 7;
constexpr std::uint8_t kWriteCoil = 5, kWriteCoils = 15;

}  // namespace

struct CoilModule::Module {
    const hal::Clock& clock;
    int coils;
    int port = 0;
    modbus_t* context = nullptr;
    modbus_mapping_t* mapping = nullptr;
    int listener = -1, wake = -1;
    std::vector<int> clients;  // module's thread; or anyone while it is off
    std::thread thread;
    int realtime = 0;
    std::function<void(int, bool, hal::TimePoint)> on_coil;

    mutable std::mutex mutex;
    std::condition_variable woken;
    bool stopping = false;
    static constexpr std::ptrdiff_t kHistory = 10'000;
    std::vector<Move> history;
    std::vector<bool> state;
    int accepted = 0, misbehaved = 0;
    CoilFault fault = CoilFault::none;
    int fault_writes = 0;
    bool fault_reads = false;
    hal::Duration fault_delay{};

    Module(const hal::Clock& c, int count) : clock(c), coils(count), state(static_cast<std::size_t>(count)) {}

    ~Module() {
        off();
        if (mapping != nullptr) modbus_mapping_free(mapping);
        if (context != nullptr) modbus_free(context);
        if (wake >= 0) close(wake);
    }

    Result<void> on() {
        modbus_free(context);
        context = modbus_new_tcp("127.0.0.1", port);
        if (context == nullptr) return fail(ErrorCode::io, "the coil module has no Modbus context", "check memory");
        listener = modbus_tcp_listen(context, 8);
        if (listener < 0) {
            const int error = errno;
            return fail(error == EADDRINUSE ? ErrorCode::busy : ErrorCode::io,
                        "the coil module cannot listen on 127.0.0.1:" + std::to_string(port) + ": " + std::strerror(error),
                        "use another port, or 0 for a free one");
        }
        sockaddr_in address{};
        socklen_t size = sizeof address;
        getsockname(listener, reinterpret_cast<sockaddr*>(&address), &size);
        port = ntohs(address.sin_port);
        stopping = false;
        thread = std::thread([this] {
            sched_param param{};
            param.sched_priority = realtime;
            if (realtime > 0) ::sched_setscheduler(0, SCHED_FIFO, &param);
            serve();
        });
        return {};
    }

    void off() {
        if (!thread.joinable()) return;
        {
            const std::scoped_lock lock(mutex);
            stopping = true;
        }
        woken.notify_all();
        const std::uint64_t one = 1;
        [[maybe_unused]] const auto bytes = write(wake, &one, sizeof one);
        thread.join();
    }

    void serve() {
        for (;;) {
            std::vector<pollfd> fds = {{wake, POLLIN, 0}, {listener, POLLIN, 0}};
            for (const int client : clients) fds.push_back({client, POLLIN, 0});
            if (poll(fds.data(), fds.size(), -1) < 0 && errno != EINTR) break;
            if (is_stopping()) break;
            if ((fds[1].revents & POLLIN) != 0) accept_one();
            for (std::size_t k = 2; k < fds.size(); ++k) {
                if (fds[k].revents != 0 && !answer(fds[k].fd)) drop(fds[k].fd);
            }
        }
        std::uint64_t count = 0;
        [[maybe_unused]] const auto bytes = read(wake, &count, sizeof count);
        while (!clients.empty()) drop(clients.back());
        close(std::exchange(listener, -1));
        for (int coil = 0; coil < coils; ++coil) move(coil, false);
    }

    bool is_stopping() const {
        const std::scoped_lock lock(mutex);
        return stopping;
    }

    void accept_one() {
        const int client = accept4(listener, nullptr, nullptr, SOCK_CLOEXEC);
        if (client < 0) return;
        clients.push_back(client);
        const std::scoped_lock lock(mutex);
        ++accepted;
    }

    void drop(int client) {
        close(client);
        std::erase(clients, client);
    }

    // Moves a coil in the mapping and tells who listens; once the change is real.
    void move(int coil, bool on) {
        mapping->tab_bits[coil] = on ? 1 : 0;
        const hal::TimePoint at = clock.now();
        {
            const std::scoped_lock lock(mutex);
            const auto index = static_cast<std::size_t>(coil);
            if (state[index] == on) return;
            state[index] = on;
            history.push_back({coil, on, at});
            if (history.size() >= 2 * static_cast<std::size_t>(kHistory)) history.erase(history.begin(), history.begin() + kHistory);
        }
        if (on_coil) on_coil(coil, on, at);
    }

    CoilFault fault_for(bool is_write) {
        const std::scoped_lock lock(mutex);
        if (fault == CoilFault::none || (!is_write && !fault_reads)) return CoilFault::none;
        if (is_write && fault_writes == 0) return CoilFault::none;
        if (is_write && fault_writes > 0) --fault_writes;
        ++misbehaved;
        return fault;
    }

    // Waits, but not longer than the module runs.
    void wait(hal::Duration duration) {
        std::unique_lock lock(mutex);
        woken.wait_for(lock, duration, [this] { return stopping; });
    }

    // One request of a client; false when the connection is over.
    bool answer(int client) {
        std::array<std::uint8_t, MODBUS_TCP_MAX_ADU_LENGTH> request{};
        modbus_set_socket(context, client);
        const int length = modbus_receive(context, request.data());
        if (length <= kMbapBytes) return length == 0;
        const std::uint8_t function = request[kMbapBytes];
        const bool is_write = function == kWriteCoil || function == kWriteCoils;
        const CoilFault how = fault_for(is_write);
        const hal::Duration delay = [this] {
            const std::scoped_lock lock(mutex);
            return fault_delay;
        }();
        switch (how) {
            case CoilFault::silent: return true;
            case CoilFault::close: return false;
            case CoilFault::exception:
                return modbus_reply_exception(context, request.data(), MODBUS_EXCEPTION_SLAVE_OR_SERVER_FAILURE) >= 0;
            case CoilFault::stuck: return send(client, request.data(), static_cast<std::size_t>(length), MSG_NOSIGNAL) == length;
            case CoilFault::late:
                carry_out(request);
                wait(delay);
                break;
            case CoilFault::drip:
                carry_out(request);
                if (function != kWriteCoil) break;
                for (int k = 0; k < length; ++k) {  // the answer to a write of one coil is its echo
                    if (send(client, &request[static_cast<std::size_t>(k)], 1, MSG_NOSIGNAL) != 1) return false;
                    wait(delay);
                }
                return true;
            case CoilFault::none: break;
        }
        const bool sent = modbus_reply(context, request.data(), length, mapping) >= 0;
        for (int coil = 0; coil < coils; ++coil) move(coil, mapping->tab_bits[coil] != 0);
        return sent;
    }

    void carry_out(const std::array<std::uint8_t, MODBUS_TCP_MAX_ADU_LENGTH>& request) {
        if (request[kMbapBytes] != kWriteCoil) return;
        const int coil = request[kMbapBytes + 1] * 256 + request[kMbapBytes + 2];
        if (coil < coils) move(coil, request[kMbapBytes + 3] == 0xFF);
    }
};

CoilModule::CoilModule(std::unique_ptr<Module> module) : module_(std::move(module)) {}
CoilModule::~CoilModule() = default;

Result<std::unique_ptr<CoilModule>> CoilModule::open(const hal::Clock& clock, const CoilModuleOptions& options) {
    auto module = std::make_unique<Module>(clock, options.coils);
    module->port = options.port;
    module->realtime = options.realtime;
    module->mapping = modbus_mapping_new(options.coils, 0, 0, 0);
    module->wake = eventfd(0, EFD_CLOEXEC | EFD_NONBLOCK);
    if (module->mapping == nullptr || module->wake < 0) {
        return fail(ErrorCode::io, "the coil module cannot be made", "check memory and the limit of open files");
    }
    if (auto listening = module->on(); !listening) return tl::unexpected(listening.error());
    return std::unique_ptr<CoilModule>(new CoilModule(std::move(module)));
}

int CoilModule::port() const { return module_->port; }

bool CoilModule::coil(int number) const {
    const std::scoped_lock lock(module_->mutex);
    return module_->state[static_cast<std::size_t>(number)];
}

std::vector<CoilModule::Move> CoilModule::history() const {
    const std::scoped_lock lock(module_->mutex);
    return module_->history;
}

int CoilModule::connections() const {
    const std::scoped_lock lock(module_->mutex);
    return module_->accepted;
}

void CoilModule::misbehave(CoilFault fault, int writes, hal::Duration delay, bool reads) {
    const std::scoped_lock lock(module_->mutex);
    module_->fault = fault;
    module_->fault_writes = writes;
    module_->fault_delay = delay;
    module_->fault_reads = reads;
}

int CoilModule::misbehaved() const {
    const std::scoped_lock lock(module_->mutex);
    return module_->misbehaved;
}

void CoilModule::power_off() { module_->off(); }
Result<void> CoilModule::power_on() { return module_->thread.joinable() ? Result<void>{} : module_->on(); }

void CoilModule::on_coil(std::function<void(int, bool, hal::TimePoint)> callback) { module_->on_coil = std::move(callback); }

}  // namespace hord::sim
