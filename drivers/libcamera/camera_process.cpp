#include "drivers/libcamera/camera_process.h"

#include <atomic>
#include <cerrno>
#include <csignal>
#include <cstring>
#include <optional>
#include <thread>
#include <utility>

#include <poll.h>
#include <sched.h>
#include <spawn.h>
#include <sys/mman.h>
#include <sys/socket.h>
#include <sys/wait.h>
#include <unistd.h>

#include "drivers/libcamera/camera_host.h"
#include "drivers/libcamera/camera_wire.h"

namespace hord::drivers {
namespace {

using namespace std::chrono_literals;

constexpr auto kToEnd = 2s;  // a process that was told to, before it is killed

struct Mapped {
    CameraPort::Memory memory;
    std::vector<std::pair<void*, std::size_t>> maps;
    Mapped() = default;
    Mapped(const Mapped&) = delete;
    Mapped& operator=(const Mapped&) = delete;
    ~Mapped() {
        for (const auto& [data, size] : maps) ::munmap(data, size);
    }
};

// The process and this end of its socket.
class Helper {
  public:
    static Result<std::unique_ptr<Helper>> start(const std::filesystem::path& program,
                                                 const std::vector<std::string>& arguments) {
        int ends[2];
        if (::socketpair(AF_UNIX, SOCK_SEQPACKET | SOCK_CLOEXEC, 0, ends) != 0)
            return fail(ErrorCode::io, std::string("no sockets for a camera's process: ") + std::strerror(errno),
                        "raise the limit of open files");
        posix_spawn_file_actions_t files;
        posix_spawn_file_actions_init(&files);
        posix_spawn_file_actions_adddup2(&files, ends[1], kCameraSocket);
        posix_spawn_file_actions_addclosefrom_np(&files, kCameraSocket + 1);
        // Not the station's signals; and not its real-time policy: libcamera turns in circles while a camera that went
        // away is still open, and would leave a processor to nobody.
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
        ::close(ends[1]);
        if (error != 0) {
            ::close(ends[0]);
            return fail(
                error == ENOENT ? ErrorCode::not_found : ErrorCode::io,
                program.string() + ", which holds libcamera's cameras, cannot be started: " + std::strerror(error),
                "install the package again");
        }
        return std::unique_ptr<Helper>(new Helper(pid, ends[0]));
    }
    ~Helper() {
        end({});
        ::close(socket_);
    }
    Helper(const Helper&) = delete;
    Helper& operator=(const Helper&) = delete;

    [[nodiscard]] int socket() const { return socket_; }

    // It has so long to end by itself.
    void end(hal::Duration patience) {
        if (pid_ == 0) return;
        ::shutdown(socket_, SHUT_WR);
        const auto until = std::chrono::steady_clock::now() + patience;
        siginfo_t ended{};
        while (::waitid(P_PID, static_cast<id_t>(pid_), &ended, WEXITED | WNOHANG | WNOWAIT) == 0 &&
               ended.si_pid == 0 && std::chrono::steady_clock::now() < until) {
            std::this_thread::sleep_for(2ms);
        }
        ::kill(
            pid_,
            SIGKILL);  // one that has ended feels nothing; it is reaped only here, so that the number is still its own
        while (::waitpid(pid_, nullptr, 0) < 0 && errno == EINTR) {
        }
        pid_ = 0;
    }

  private:
    Helper(pid_t pid, int socket) : pid_(pid), socket_(socket) {}
    pid_t pid_;
    int socket_;
};

class CameraProcess final : public CameraPort {
  public:
    CameraProcess(CameraRequest request, std::filesystem::path program, hal::Duration patience)
        : request_(std::move(request)), program_(std::move(program)), patience_(patience) {}
    ~CameraProcess() override { stop(); }

    Result<CameraFormat> look() override {
        auto answer = ask(CameraAsk::look);
        if (helper_) helper_->end(kToEnd);
        helper_.reset();
        if (!answer) return tl::unexpected(answer.error());
        return answer->format;
    }

    Result<std::shared_ptr<const Memory>> start(Listener& listener) override {
        stop();
        auto answer = ask(CameraAsk::start);
        auto memory = answer ? map(*answer) : tl::unexpected(answer.error());
        if (!memory) {
            if (helper_) helper_->end(kToEnd);
            helper_.reset();
            return memory;
        }
        stopping_ = false;
        reader_ = std::thread([this, &listener, socket = helper_->socket()] { read(listener, socket); });
        return memory;
    }

    Result<void> queue(std::uint32_t buffer) override {
        if (::send(helper_->socket(), &buffer, sizeof buffer, MSG_DONTWAIT | MSG_NOSIGNAL) !=
            static_cast<ssize_t>(sizeof buffer)) {
            return fail(ErrorCode::disconnected, "the camera's process takes no buffer",
                        "stop the sensor and start it again");
        }
        return {};
    }

    void stop() override {
        stopping_ = true;
        if (helper_) helper_->end(kToEnd);
        if (reader_.joinable()) reader_.join();  // its end of the socket is closed by now
        helper_.reset();
    }

  private:
    Result<CameraAnswer> ask(CameraAsk what) {
        auto helper = Helper::start(program_, camera_arguments(what, request_));
        if (!helper) return tl::unexpected(helper.error());
        helper_ = std::move(*helper);
        auto answer = receive_answer(helper_->socket(), patience_);
        if (answer) return std::move(*answer);
        helper_->end({});
        return fail(
            ErrorCode::io,
            program_.filename().string() + ", which holds libcamera's cameras, ended or hung when it was asked for one",
            "look at its lines in the journal; see cam -l");
    }

    static Result<std::shared_ptr<const Memory>> map(const CameraAnswer& answer) {
        auto mapped = std::make_shared<Mapped>();
        Result<void> good;
        for (const CameraBuffer& buffer : answer.buffers) {
            void* const data = ::mmap(nullptr, buffer.offset + buffer.bytes, PROT_READ, MAP_SHARED, buffer.fd, 0);
            if (data == MAP_FAILED) {
                good = fail(ErrorCode::io, std::string("a camera's buffer cannot be mapped: ") + std::strerror(errno),
                            "look at the kernel's log");
                continue;
            }
            mapped->maps.emplace_back(data, buffer.offset + buffer.bytes);
            mapped->memory.emplace_back(static_cast<const std::byte*>(data) + buffer.offset, buffer.bytes);
        }
        for (const CameraBuffer& buffer : answer.buffers) ::close(buffer.fd);  // the map keeps the memory
        if (!good) return tl::unexpected(good.error());
        return std::shared_ptr<const Memory>(mapped, &mapped->memory);
    }

    void read(Listener& listener, int socket) {
        for (;;) {
            CameraNote note;
            const ssize_t count = ::recv(socket, &note, sizeof note, 0);
            if (count < 0 && errno == EINTR) continue;
            if (stopping_) return;
            if (count != static_cast<ssize_t>(sizeof note) || note.what != CameraNote::What::frame)
                return listener.on_camera_gone();
            listener.on_camera_frame(note.frame);
        }
    }

    const CameraRequest request_;
    const std::filesystem::path program_;
    const hal::Duration patience_;
    std::unique_ptr<Helper> helper_;
    std::thread reader_;
    std::atomic<bool> stopping_ = false;
};

}  // namespace

std::filesystem::path camera_program() {
    std::error_code error;
    const auto beside = std::filesystem::read_symlink("/proc/self/exe", error).parent_path() / "hord-camera";
    return !error && ::access(beside.c_str(), X_OK) == 0 ? beside : "/usr/libexec/hord/hord-camera";
}

std::unique_ptr<CameraPort> open_camera_process(CameraRequest request, std::filesystem::path program,
                                                hal::Duration patience) {
    return std::make_unique<CameraProcess>(std::move(request), std::move(program), patience);
}

std::string libcamera_version() { return HORD_LIBCAMERA_VERSION; }

}  // namespace hord::drivers
