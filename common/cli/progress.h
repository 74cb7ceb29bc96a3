// Progress of long work: a bar on a terminal; elsewhere lines, at most one for every tenth.
#pragma once

#include <cstdio>
#include <string>

namespace hord {

class Progress {
  public:
    // `what` names the work. Writes to stderr; `quiet` writes nothing.
    explicit Progress(std::string what, bool quiet = false);
    ~Progress();
    Progress(const Progress&) = delete;
    Progress& operator=(const Progress&) = delete;

    // `done` is 0..1; `note` follows the bar.
    void show(double done, const std::string& note = {});

  private:
    std::string what_;
    bool quiet_;
    bool terminal_;
    bool drawn_ = false;
    int tenths_ = -1;
    int permille_ = -1;
};

}  // namespace hord
