// A fake GigE camera in a process of its own, and a network of this process's own for it.
#pragma once

#include <optional>
#include <string>
#include <vector>

#include "tests/system/cli/program.h"

namespace hord::test {

// From the first call on this process and its children have a network namespace of their own with loopback alone: all
// cameras share port 3956, and discovery asks every network. Empty: it has; else why the kernel refused it. Call it
// before any thread is started.
std::string own_network();

// Runs until it is destroyed. Call own_network() before.
class FakeGige {
  public:
    // As fake_gige_program.cpp says.
    explicit FakeGige(const std::vector<std::string>& arguments = {"127.0.0.1", "S1"});
    void lose();  // kills it
    void bring_back();
    void set_input(bool active);  // Line1 ("wire", "events")

  private:
    const std::vector<std::string> arguments_;
    std::optional<Running> program_;
};

}  // namespace hord::test
