// Arbitrary bytes as a shard of a replay. The checksum in the last line is corrected where there is one.
#include <cstdlib>

#include "firmware/store/frames/replay_shard.h"
#include "tests/fuzz/input_file.h"

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
    using namespace hord;
    using namespace hord::firmware::store;
    std::string bytes(reinterpret_cast<const char*>(data), size);
    constexpr std::string_view kKey = "\"sha256\":\"";
    const auto at = bytes.rfind(kKey);
    const auto line = at == std::string::npos ? at : bytes.rfind('\n', at);
    if (line != std::string::npos && at + kKey.size() + 64 <= bytes.size())
        bytes.replace(at + kKey.size(), 64, text_identity(std::string_view(bytes).substr(0, line + 1)));
    const fuzz::InputFile file(bytes);
    const auto merged = merge_shards({file.path()}, "/dev/null/none");
    if (merged || merged.error().code == ErrorCode::internal) std::abort();  // the output's folder is none
    return 0;
}
