// Proof, in a file, that no part was on the line when the last process ended in order.
//
// Without it the line is unknown. A process withdraws the proof before its line runs, and gives it again at the end. A
// crash, a loss of power, and a disk that is full or read-only at the end therefore leave none.
#pragma once

#include <filesystem>

#include "common/result.h"

namespace hord::firmware {

class EmptyLineProof {
  public:
    // Empty folder: nothing is ever proven.
    explicit EmptyLineProof(const std::filesystem::path& folder)
        : file_(folder.empty() ? folder : folder / "line-empty") {}

    // Returns whether there was a whole proof. Waits for the disk: no later process finds the same one. Fails with io;
    // a later process might then take the old proof for its own, so the line must not run.
    [[nodiscard]] Result<bool> withdraw() const;

    // Waits for the disk. Fails as write_durably() does; the next process then finds no proof.
    [[nodiscard]] Result<void> give() const;

  private:
    std::filesystem::path file_;
};

}  // namespace hord::firmware
