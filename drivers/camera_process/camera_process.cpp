#include "drivers/camera_process/camera_process.h"

#include <atomic>
#include <cerrno>
#include <csignal>
#include <cstring>
#include <optional>
#include <string>
#include <thread>
#include <utility>

#include <poll.h>
#include <sched.h>
#include <spawn.h>
#include <sys/mman.h>
#include <sys/socket.h>
#include <sys/wait.h>
#include <unistd.h>

#include "common/unique_fd.h"
#include "drivers/camera_process/camera_host.h"
#include "drivers/camera_process/camera_wire.h"

namespace hord::drivers {
namespace {

using namespace std::chrono_literals;

constexpr auto kTimeToEnd = 2s;        // then the process is killed
constexpr auto kTimeToSayHow = 500ms;  // from the end of its connection to the end of the process

struct Ending {
    std::string how;  // "was killed by signal 9 (Killed)"
    std::string cure;
};

// How a child process that is ending, but not reaped, ended. None: it did not end within `patience`. Any thread.
std::optional<Ending> ending_of(pid_t pid, hal::Duration patience) {
    const std::string again = "; a new one is started at the next reset";
    const auto until = std::chrono::steady_clock::now() + patience;
    siginfo_t ended{};
    while (::waitid(P_PID, static_cast<id_t>(pid), &ended, WEXITED | WNOHANG | WNOWAIT) == 0 && ended.si_pid == 0) {
        if (std::chrono::steady_clock::now() >= until) return std::nullopt;
        std::this_thread::sleep_for(1ms);
    }
    if (ended.si_pid == 0) return std::nullopt;  // somebody else reaped it
    if (ended.si_code == CLD_EXITED)
        return Ending{"ended with exit status " + std::to_string(ended.si_status),
                      "look at its last lines in the journal" + again};
    const char* const name = sigdescr_np(ended.si_status);
    return Ending{
        "was killed by signal " + std::to_string(ended.si_status) + " (" + (name == nullptr ? "unknown" : name) + ")",
        (ended.si_status == SIGKILL ? "look who killed it, and whether memory ran out (journalctl -k)"
                                    : "it crashed: report it, with its last lines in the journal") +
            again};
}

struct Mapped {
    CameraPort::Memory memory;
    std::vector<std::shared_ptr<void>> maps;
};

// The process and the station's end of its socket.
class CameraChild {
  public:
    static Result<std::unique_ptr<CameraChild>> start(const std::filesystem::path& program,
                                                      const std::vector<std::string>& arguments) {
        int ends[2];
        if (::socketpair(AF_UNIX, SOCK_SEQPACKET | SOCK_CLOEXEC, 0, ends) != 0)
            return fail(ErrorCode::io, std::string("no sockets for a camera's process: ") + std::strerror(errno),
                        "raise the limit of open files");
        common::UniqueFd station_end(ends[0]), process_end(ends[1]);
        posix_spawn_file_actions_t files;
        posix_spawn_file_actions_init(&files);
        posix_spawn_file_actions_adddup2(&files, process_end.get(), kCameraSocket);
        posix_spawn_file_actions_addclosefrom_np(&files, kCameraSocket + 1);
        // Without the station's signal mask and real-time policy: libcamera spins while a camera that went away is
        // open, and with that policy would block a processor.
        posix_spawnattr_t how;
        posix_spawnattr_init(&how);
        sigset_t none, all;
        sigemptyset(&none);
        sigfillset(&all);
        const sched_param ordinary{};
        posix_spawnattr_setsigmask(&how, &none);
        posix_spawnattr_setsigdefault(&how, &all);
        posix_spawnattr_setschedpolicy(&how, SCHED_OTHER);
        posix_spawnattr_setschedparam(&how, &ordinary);
        posix_spawnattr_setflags(&how, POSIX_SPAWN_SETSIGMASK | POSIX_SPAWN_SETSIGDEF | POSIX_SPAWN_SETSCHEDULER);
        std::vector<std::string> words = arguments;
        words.insert(words.begin(), program.string());
        std::vector<char*> argv;
        for (std::string& word : words) argv.push_back(word.data());
        argv.push_back(nullptr);
        pid_t pid = 0;
        const int error = ::posix_spawn(&pid, program.c_str(), &files, &how, argv.data(), environ);
        posix_spawn_file_actions_destroy(&files);
        posix_spawnattr_destroy(&how);
        process_end.reset();
        if (error != 0) {
            return fail(error == ENOENT ? ErrorCode::not_found : ErrorCode::io,
                        program.string() + ", which holds the camera, cannot be started: " + std::strerror(error),
                        "install the package again");
        }
        return std::unique_ptr<CameraChild>(new CameraChild(pid, std::move(station_end)));
    }
    ~CameraChild() { end(kTimeToEnd); }
    CameraChild(const CameraChild&) = delete;
    CameraChild& operator=(const CameraChild&) = delete;

    [[nodiscard]] int socket() const { return socket_.get(); }
    [[nodiscard]] pid_t pid() const { return pid_; }

    // Closes the connection, waits for the process to end, and kills it after `patience`.
    void end(hal::Duration patience) {
        if (pid_ == 0) return;
        ::shutdown(socket_.get(), SHUT_WR);
        (void)ending_of(pid_, patience);
        ::kill(pid_,
               SIGKILL);  // safe also after its end: it is reaped below, so its id is not reused
        while (::waitpid(pid_, nullptr, 0) < 0 && errno == EINTR) {
        }
        pid_ = 0;
    }

  private:
    CameraChild(pid_t pid, common::UniqueFd socket) : pid_(pid), socket_(std::move(socket)) {}
    pid_t pid_;
    common::UniqueFd socket_;
};

// The answer of a new process, which `child` holds then.
Result<CameraAnswer> ask(std::unique_ptr<CameraChild>& child, const std::filesystem::path& program,
                         const std::vector<std::string>& arguments, hal::Duration patience) {
    auto started = CameraChild::start(program, arguments);
    if (!started) return tl::unexpected(started.error());
    child = std::move(*started);
    auto answer = receive_answer(child->socket(), patience);
    if (answer) return std::move(*answer);
    const auto ending = ending_of(child->pid(), kTimeToSayHow);
    child->end({});
    const std::string holder = program.filename().string() + ", which holds the camera, ";
    if (ending) return fail(ErrorCode::io, holder + ending->how + " when it was asked for it", ending->cure);
    return fail(ErrorCode::io, holder + "gave no answer that can be read when it was asked for it",
                "look at its last lines in the journal");
}

class CameraProcess final : public CameraPort {
  public:
    CameraProcess(std::string request, std::filesystem::path program, hal::Duration patience)
        : request_(std::move(request)), program_(std::move(program)), patience_(patience) {}
    ~CameraProcess() override { stop(); }

    Result<CameraFormat> look() override {
        auto answer = run(CameraCommand::look);
        child_.reset();
        return answer.map([](const CameraAnswer& there) { return there.format; });
    }

    Result<std::shared_ptr<const Memory>> start(Listener& listener) override {
        stop();
        auto answer = run(CameraCommand::start);
        auto memory = answer ? map(*answer) : tl::unexpected(answer.error());
        if (!memory) {
            child_.reset();
            return memory;
        }
        stopping_ = false;
        reader_ = std::thread(
            [this, &listener, socket = child_->socket(), pid = child_->pid()] { read(listener, socket, pid); });
        return memory;
    }

    Result<void> queue(std::uint32_t buffer) override { return tell(buffer); }
    Result<void> trigger() override { return tell(kTriggerOrder); }

    void stop() override {
        stopping_ = true;
        if (child_) child_->end(kTimeToEnd);
        if (reader_.joinable()) reader_.join();  // recv() returns: the other end is closed
        child_.reset();
    }

  private:
    Result<void> tell(std::uint32_t order) {
        if (::send(child_->socket(), &order, sizeof order, MSG_DONTWAIT | MSG_NOSIGNAL) !=
            static_cast<ssize_t>(sizeof order)) {
            const bool full = errno == EAGAIN;
            return fail(
                full ? ErrorCode::busy : ErrorCode::disconnected,
                "its process " + program_.filename().string() + (full ? " takes no order" : " does not run any more"),
                "look at its last lines in the journal; a new one is started at the next reset");
        }
        return {};
    }
    Result<CameraAnswer> run(CameraCommand command) {
        return ask(child_, program_, camera_arguments(command, request_), patience_);
    }

    static Result<std::shared_ptr<const Memory>> map(const CameraAnswer& answer) {
        auto mapped = std::make_shared<Mapped>();
        Result<void> good;
        for (const CameraBuffer& buffer : answer.buffers) {
            // Memory behind the file's end would end the station when it is read.
            const auto size = ::lseek(buffer.fd, 0, SEEK_END);
            if (size < 0 || buffer.bytes > static_cast<std::size_t>(size) ||
                buffer.offset > static_cast<std::size_t>(size) - buffer.bytes) {
                good = fail(ErrorCode::io, "a camera's buffer is smaller than its process says",
                            "look at the lines of the camera's process in the journal");
                continue;
            }
            void* const data = ::mmap(nullptr, buffer.offset + buffer.bytes, PROT_READ, MAP_SHARED, buffer.fd, 0);
            if (data == MAP_FAILED) {
                good = fail(ErrorCode::io, std::string("a camera's buffer cannot be mapped: ") + std::strerror(errno),
                            "look at the kernel's log");
                continue;
            }
            mapped->maps.emplace_back(data, [size = buffer.offset + buffer.bytes](void* p) { ::munmap(p, size); });
            mapped->memory.emplace_back(static_cast<const std::byte*>(data) + buffer.offset, buffer.bytes);
        }
        for (const CameraBuffer& buffer : answer.buffers) ::close(buffer.fd);  // the mapping stays
        if (!good) return tl::unexpected(good.error());
        return std::shared_ptr<const Memory>(mapped, &mapped->memory);
    }

    void read(Listener& listener, int socket, pid_t pid) {
        for (;;) {
            CameraEvent event;
            const ssize_t count = ::recv(socket, &event, sizeof event, 0);
            if (count < 0 && errno == EINTR) continue;
            if (stopping_) return;
            if (count != static_cast<ssize_t>(sizeof event)) return tell_end(listener, pid);
            if (event.what == CameraEvent::What::frame) listener.on_camera_frame(event.frame);
            else if (event.what == CameraEvent::What::edge) listener.on_camera_edge(event.edge);
            else return listener.on_camera_gone({event.why.data(), ::strnlen(event.why.data(), event.why.size())}, {});
        }
    }

    void tell_end(Listener& listener, pid_t pid) const {
        const std::string its = "is lost: its process " + program_.filename().string() + " ";
        if (const auto ending = ending_of(pid, kTimeToSayHow))
            return listener.on_camera_gone(its + ending->how, ending->cure);
        listener.on_camera_gone(its + "closed its connection", "look at its last lines in the journal");
    }

    const std::string request_;
    const std::filesystem::path program_;
    const hal::Duration patience_;
    std::unique_ptr<CameraChild> child_;
    std::thread reader_;
    std::atomic<bool> stopping_ = false;
};

}  // namespace

std::filesystem::path camera_program(const std::string& name) {
    std::error_code error;
    const auto beside = std::filesystem::read_symlink("/proc/self/exe", error).parent_path() / name;
    return !error && ::access(beside.c_str(), X_OK) == 0 ? beside : std::filesystem::path("/usr/libexec/hord") / name;
}

Result<std::vector<hal::ListedCamera>> list_cameras(const std::string& request, const std::filesystem::path& program,
                                                    hal::Duration patience) {
    std::unique_ptr<CameraChild> child;
    return ask(child, program, camera_arguments(CameraCommand::list, request), patience).map([](CameraAnswer&& answer) {
        return std::move(answer.cameras);
    });
}

std::unique_ptr<CameraPort> open_camera_process(std::string request, std::filesystem::path program,
                                                hal::Duration patience) {
    return std::make_unique<CameraProcess>(std::move(request), std::move(program), patience);
}

}  // namespace hord::drivers
