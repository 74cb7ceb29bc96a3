// Arbitrary bytes as a file of another program (.npy, Lytro's container): the result must be an array or a frame whose
// size the bytes can hold, or an error that names the file and has a cure. HDF5 is read by its own library.
#include <cstdlib>

#include "firmware/exchange/array.h"
#include "firmware/exchange/lytro.h"

namespace {

template <class T>
bool fails_well(const hord::Result<T>& read) {
    if (read) return false;
    if (read.error().what.find("the.file") == std::string::npos || read.error().cure.empty()) std::abort();
    return true;
}

}  // namespace

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
    using namespace hord;
    const auto bytes = std::as_bytes(std::span(data, size));
    if (const auto array = firmware::decode_npy(bytes, "the.file"); !fails_well(array)) {
        if (array->bytes.size() != array->count() * bytes_of(array->type) || array->bytes.size() > size) std::abort();
        const auto again = firmware::encode_npy(*array);
        const auto same = firmware::decode_npy(std::as_bytes(std::span(again)), "the.file");
        if (!same || same->bytes != array->bytes || same->shape != array->shape) std::abort();
    }
    if (const auto frame = firmware::decode_lytro(bytes, "the.file"); !fails_well(frame)) {
        const auto view = frame->view();
        if (frame->bytes().size() > 2 * size) std::abort();
        for (int y = 0; y < view.height_px; ++y) {
            for (int x = 0; x < view.width_px; ++x) {
                if (view.sample(x, y) > view.full_scale()) std::abort();
            }
        }
    }
    return 0;
}
