// Aravis's objects and errors as the rest of the code knows them.
#pragma once

#include <memory>
#include <string>
#include <utility>

#include <arv.h>

#include "common/result.h"

namespace hord::drivers {

struct Unref {
    void operator()(void* object) const { g_object_unref(object); }
};
struct FreeGlib {
    void operator()(void* memory) const { g_free(memory); }
};
template <class T>
using ArvOwned = std::unique_ptr<T, Unref>;
template <class T>
using GlibOwned = std::unique_ptr<T, FreeGlib>;

// A call's error: pass out(), then ask.
class ArvFailure {
  public:
    ArvFailure() = default;
    ~ArvFailure() { g_clear_error(&error_); }
    ArvFailure(const ArvFailure&) = delete;
    ArvFailure& operator=(const ArvFailure&) = delete;
    GError** out() {
        g_clear_error(&error_);
        return &error_;
    }
    explicit operator bool() const { return error_ != nullptr; }
    [[nodiscard]] std::string what() const { return error_ != nullptr ? error_->message : "no reason is given"; }
    [[nodiscard]] bool is(ArvDeviceError code) const {
        return error_ != nullptr && g_error_matches(error_, ARV_DEVICE_ERROR, code);
    }

  private:
    GError* error_ = nullptr;
};

// An error tells the camera's name first.
template <class T>
Result<T> named(const std::string& camera, Result<T> result) {
    return std::move(result).map_error([&](Error error) {
        error.what = camera + ": " + error.what;
        return error;
    });
}

}  // namespace hord::drivers
