#include "tests/drivers/genicam/fake_gige.h"

#include <cerrno>
#include <csignal>
#include <cstring>
#include <stdexcept>

#include <net/if.h>
#include <sched.h>
#include <sys/ioctl.h>
#include <sys/socket.h>

#include "common/unique_fd.h"

namespace hord::test {
namespace {

std::string enter() {
    if (::unshare(CLONE_NEWNET) != 0 && ::unshare(CLONE_NEWUSER | CLONE_NEWNET) != 0)
        return std::string("this user gets no network namespace: ") + std::strerror(errno);
    const common::UniqueFd socket(::socket(AF_INET, SOCK_DGRAM | SOCK_CLOEXEC, 0));
    ifreq loopback{};
    std::strcpy(loopback.ifr_name, "lo");
    loopback.ifr_flags = IFF_UP | IFF_RUNNING;
    if (!socket || ::ioctl(socket.get(), SIOCSIFFLAGS, &loopback) != 0)
        return std::string("the loopback of a network namespace cannot be switched on: ") + std::strerror(errno);
    return {};
}

}  // namespace

std::string own_network() {
    static const std::string refused = enter();
    return refused;
}

FakeGige::FakeGige(const std::vector<std::string>& arguments) : arguments_(arguments) { bring_back(); }

void FakeGige::lose() {
    program_->stop(SIGKILL);
    program_.reset();
}

void FakeGige::set_input(bool active) { program_->signal(active ? SIGUSR1 : SIGUSR2); }

void FakeGige::bring_back() {
    program_.emplace("hord_fake_gige", arguments_);
    if (!program_->says("ready")) throw std::runtime_error("hord_fake_gige does not run: " + program_->so_far().err);
}

}  // namespace hord::test
