// The size that an image file declares is checked before memory is taken for it.
#pragma once

#include <cstdint>
#include <functional>
#include <string>
#include <string_view>

#include "common/result.h"

namespace hord::common {

// A file that declares more samples is refused: a small file can unpack to gigabytes.
constexpr std::uint64_t kMaxFrameSamples = 200'000'000;

// Decides on a declared size. Empty: every size up to kMaxFrameSamples.
using AcceptSize = std::function<Result<void>(std::uint32_t width_px, std::uint32_t height_px)>;

inline Result<void> check_declared_size(std::string_view name, std::uint32_t width_px, std::uint32_t height_px,
                                        const AcceptSize& accept) {
    if (std::uint64_t{width_px} * height_px > kMaxFrameSamples)
        return fail(ErrorCode::unsupported,
                    std::string(name) + " says that it is " + std::to_string(width_px) + "x" +
                        std::to_string(height_px) + " pixels, more than " + std::to_string(kMaxFrameSamples) +
                        " samples",
                    "give a frame of the lenslet sensor");
    return accept ? accept(width_px, height_px) : Result<void>{};
}

}  // namespace hord::common
