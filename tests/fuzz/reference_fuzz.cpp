// Arbitrary bytes as a learned reference. The checksum is corrected: else nearly every input would be refused for it.
#include <cstdlib>
#include <cstring>

#include "common/crc32.h"
#include "firmware/recipes/reference_file.h"
#include "tests/fuzz/input_file.h"

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
    using namespace hord;
    std::string bytes(reinterpret_cast<const char*>(data), size);
    if (size > 4) {
        const std::uint32_t seal = common::crc32(std::string_view(bytes).substr(0, size - 4));
        std::memcpy(bytes.data() + size - 4, &seal, sizeof seal);
    }
    const fuzz::InputFile file(bytes);
    const auto read = firmware::read_reference(file.path());
    if (!read && (read.error().cure.empty() || read.error().code == ErrorCode::internal)) std::abort();
    return 0;
}
