// Assigns the value of a call that can fail, or passes its error on:
//     if (auto done = assign(loop_, SdEventLoop::open()); !done) return done;
#pragma once

#include <utility>

#include "common/result.h"

namespace hord {

template <class To, class From>
[[nodiscard]] Result<void> assign(To& to, Result<From> from) {
    if (!from) return tl::unexpected(std::move(from).error());
    to = *std::move(from);
    return {};
}

}  // namespace hord
