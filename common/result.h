// The result of a call that can fail. A library returns an Error; the firmware logs it once, with its cure.
#pragma once

#include <cstdint>
#include <string>

#include <tl/expected.hpp>

namespace hord {

enum class ErrorCode : std::uint8_t {
    invalid_argument,  // the caller or the configuration requests something impossible
    not_found,         // the named file, device, key or address does not exist
    unreadable,        // it exists and cannot be read or decoded
    unsupported,       // this build or device cannot do it
    busy,              // in use, or doing something else
    timeout,           // no answer in time; the action may or may not have happened
    disconnected,      // the device or the link is gone
    refused,           // the other side rejected the request
    io,                // the operating system reported an error
    internal,          // a bug
};

// `what` says what failed; `cure` says what a person should do about it.
struct Error {
    ErrorCode code = ErrorCode::internal;
    std::string what;
    std::string cure;

    // One line for a person: "what: cure".
    [[nodiscard]] std::string message() const { return cure.empty() ? what : what + ": " + cure; }
};

template <class T>
using Result = tl::expected<T, Error>;

[[nodiscard]] inline tl::unexpected<Error> fail(ErrorCode code, std::string what, std::string cure = {}) {
    return tl::unexpected<Error>(Error{code, std::move(what), std::move(cure)});
}

}  // namespace hord
