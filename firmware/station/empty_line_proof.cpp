#include "firmware/station/empty_line_proof.h"

#include <cerrno>
#include <cstring>

#include <unistd.h>

#include "common/file_writing.h"

namespace hord::firmware {
namespace {

constexpr const char* kProof = "The station ended in order, and no part was on the line.\n";

}  // namespace

Result<bool> EmptyLineProof::withdraw() const {
    if (file_.empty()) return false;
    const auto proof = common::read_file(file_);
    int error = proof || errno == ENOENT ? 0 : errno;
    if (proof && ::unlink(file_.c_str()) != 0) error = errno;
    if (error == 0) error = common::sync_folder_of(file_);
    if (error == 0) return proof == kProof;
    return fail(ErrorCode::io,
                file_.string() + " cannot be removed (" + std::strerror(error) +
                    "): after a crash it would say that the line is empty, so the line does not run",
                "make the folder writable, or remove the file by hand; then reset");
}

Result<void> EmptyLineProof::give() const {
    if (file_.empty()) return {};
    return common::write_durably(file_, kProof);
}

}  // namespace hord::firmware
