#include "tests/system/cli/program.h"

#include <cerrno>
#include <csignal>
#include <cstdlib>
#include <cstring>
#include <stdexcept>

#include <fcntl.h>
#include <poll.h>
#include <sys/wait.h>
#include <unistd.h>

namespace hord::test {
namespace {

using Clock = std::chrono::steady_clock;

struct Child {
    pid_t pid = -1;
    int out = -1, err = -1;
};

Child start(const std::string& program, const std::vector<std::string>& arguments) {
    std::string path = program;
    if (path.find('/') == std::string::npos) path.insert(0, HORD_BIN_DIR "/");
    std::vector<char*> argv{const_cast<char*>(path.c_str())};
    for (const std::string& argument : arguments) argv.push_back(const_cast<char*>(argument.c_str()));
    argv.push_back(nullptr);
    int out[2], err[2];
    if (pipe2(out, O_CLOEXEC) != 0 || pipe2(err, O_CLOEXEC) != 0) throw std::runtime_error("pipe failed");
    const pid_t pid = fork();
    if (pid == 0) {
        dup2(out[1], STDOUT_FILENO);
        dup2(err[1], STDERR_FILENO);
        execv(path.c_str(), argv.data());
        dprintf(STDERR_FILENO, "cannot run %s: %s\n", path.c_str(), std::strerror(errno));
        _exit(127);
    }
    close(out[1]);
    close(err[1]);
    return {pid, out[0], err[0]};
}

// Reads the available output; waits for more until `until`. False when both streams have ended.
bool read_some(Child& child, Said& said, Clock::time_point until) {
    pollfd fds[2] = {{child.out, POLLIN, 0}, {child.err, POLLIN, 0}};
    const auto left = std::chrono::duration_cast<std::chrono::milliseconds>(until - Clock::now()).count();
    if (left <= 0 || poll(fds, 2, static_cast<int>(left)) <= 0) return child.out >= 0 || child.err >= 0;
    for (int k = 0; k < 2; ++k) {
        if ((fds[k].revents & (POLLIN | POLLHUP | POLLERR)) == 0) continue;
        char bytes[4096];
        const ssize_t got = read(fds[k].fd, bytes, sizeof bytes);
        if (got > 0) {
            (k == 0 ? said.out : said.err).append(bytes, static_cast<std::size_t>(got));
        } else {
            int& fd = k == 0 ? child.out : child.err;
            close(fd);
            fd = -1;
        }
    }
    return child.out >= 0 || child.err >= 0;
}

void finish(Child& child, Said& said, std::chrono::seconds patience) {
    const auto until = Clock::now() + patience;
    while (read_some(child, said, until)) {
        if (Clock::now() >= until) {
            kill(child.pid, SIGKILL);
            break;
        }
    }
    for (int* fd : {&child.out, &child.err}) {
        if (*fd >= 0) close(*fd);
        *fd = -1;
    }
    int status = 0;
    waitpid(child.pid, &status, 0);
    child.pid = -1;
    said.status = WIFEXITED(status) ? WEXITSTATUS(status) : 128 + WTERMSIG(status);
}

}  // namespace

Said run(const std::string& program, const std::vector<std::string>& arguments, std::chrono::seconds patience) {
    Child child = start(program, arguments);
    Said said;
    finish(child, said, patience);
    return said;
}

struct Running::State {
    Child child;
    Said said;
};

Running::Running(const std::string& program, const std::vector<std::string>& arguments)
    : state_(new State{start(program, arguments), {}}) {}

Running::~Running() {
    if (state_->child.pid > 0) stop(SIGINT);
    delete state_;
}

bool Running::says(const std::string& text, std::chrono::seconds patience) {
    const auto until = Clock::now() + patience;
    const auto said = [&] { return (state_->said.out + state_->said.err).find(text) != std::string::npos; };
    while (!said() && Clock::now() < until) {
        if (!read_some(state_->child, state_->said, until)) break;
    }
    return said();
}

const Said& Running::so_far() const { return state_->said; }

void Running::signal(int signal) { kill(state_->child.pid, signal); }
int Running::pid() const { return state_->child.pid; }

Said Running::stop(int signal) {
    if (state_->child.pid > 0) {
        kill(state_->child.pid, signal);
        finish(state_->child, state_->said, std::chrono::seconds(30));
    }
    return state_->said;
}

std::string simulated_beside(std::string text) {
    const std::string backend = "backend = \"simulated\"\n";
    for (const std::string device : {"sensor", "strobe", "part_sensor", "rejector"}) {
        const std::string header = "[" + device + "]\n";
        const auto at = text.find(header);
        if (at == std::string::npos) text += header + backend;
        else if (!text.substr(at + header.size()).starts_with("backend")) text.insert(at + header.size(), backend);
    }
    return text;
}

TemporaryFolder::TemporaryFolder() {
    std::string name = (std::filesystem::temp_directory_path() / "hord-test-XXXXXX").string();
    if (mkdtemp(name.data()) == nullptr) throw std::runtime_error("no temporary folder");
    path_ = name;
}

TemporaryFolder::~TemporaryFolder() {
    std::error_code ignored;
    std::filesystem::remove_all(path_, ignored);
}

std::filesystem::path real_data() {
    const char* named = std::getenv("HORD_DATA");
    const std::filesystem::path data =
        named != nullptr ? std::filesystem::path(named) : std::filesystem::path(HORD_SOURCE_DIR) / "../shared/data";
    return std::filesystem::is_directory(data) ? data : std::filesystem::path();
}

}  // namespace hord::test
