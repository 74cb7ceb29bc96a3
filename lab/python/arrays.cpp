#include <algorithm>

#include <fmt/format.h>

#include "algo/frame/decode.h"
#include "lab/python/module.h"

namespace hord::lab::python {

void refuse(std::string what, std::string cure) {
    throw Failure{{ErrorCode::invalid_argument, std::move(what), std::move(cure)}};
}

bool may_be_path(const py::handle& given) {
    return py::isinstance<py::str>(given) || py::isinstance<py::bytes>(given) || py::hasattr(given, "__fspath__");
}

std::filesystem::path path_of(const py::object& given, const char* wanted) {
    if (!may_be_path(given)) {
        const auto type = py::str(py::type::of(given).attr("__name__")).cast<std::string>();
        throw py::type_error(fmt::format("{}, not {}", wanted, type));
    }
    const py::object path = py::module_::import("os").attr("fspath")(given);
    if (py::len(path) == 0)
        refuse(fmt::format("{}, and this path is empty", wanted), "is a variable of the script not set?");
    if (path.attr("__contains__")(py::isinstance<py::bytes>(path) ? py::object(py::bytes("\0", 1)) : py::str("\0", 1))
            .cast<bool>()) {
        refuse("the path " + py::repr(path).cast<std::string>() + " holds a NUL character", "no file has such a name");
    }
    return given.cast<std::filesystem::path>();
}

py::array read_only(py::array array) {
    array.attr("flags").attr("writeable") = false;
    return array;
}

ArrayFrame frame_of(const py::array& array, int bits) {
    // array_t compares the byte order, too; big-endian samples are copied below.
    const bool narrow = py::isinstance<py::array_t<std::uint8_t>>(array);
    if (!narrow && (array.dtype().kind() != 'u' || array.itemsize() != sizeof(std::uint16_t))) {
        refuse("a frame of type " + py::str(array.dtype()).cast<std::string>() + " is not supported",
               "give unsigned samples: uint8, or uint16 for 9 to 16 bits");
    }
    if (array.ndim() != 2) {
        refuse(fmt::format("a frame has two dimensions, and this array {}", array.ndim()),
               array.ndim() == 4 ? "give samples [n, m, j, i] to hord.from_samples"
                                 : "give one grey image of shape (height, width)");
    }
    const int fits = narrow ? 8 : 16;
    if (bits == 0) bits = fits;
    if (narrow ? bits != 8 : bits < 9 || bits > 16) {
        refuse(fmt::format("{} bits are not those of {} samples", bits, narrow ? "uint8" : "uint16"),
               narrow ? "leave bits out" : "give 9 to 16 bits");
    }
    constexpr py::ssize_t kMaxSide = std::ptrdiff_t{algo::kMaxLenslets} * algo::kMaxBins;
    if (array.shape(0) > kMaxSide || array.shape(1) > kMaxSide) {
        refuse(fmt::format("a frame of {}x{} pixels is too large", array.shape(1), array.shape(0)),
               "give a frame of the lenslet sensor");
    }
    py::array kept = array;
    const bool native = array.dtype().byteorder() != '>';
    const auto address = reinterpret_cast<std::uintptr_t>(array.data());
    if (!native || array.strides(1) != array.itemsize() || array.strides(0) < array.shape(1) * array.itemsize() ||
        array.strides(0) % array.itemsize() != 0 || address % static_cast<std::uintptr_t>(array.itemsize()) != 0) {
        kept = narrow ? py::array(py::array_t<std::uint8_t, py::array::c_style | py::array::forcecast>(array))
                      : py::array(py::array_t<std::uint16_t, py::array::c_style | py::array::forcecast>(array));
    }
    const FrameView view{static_cast<const std::byte*>(kept.data()), static_cast<int>(kept.shape(1)),
                         static_cast<int>(kept.shape(0)), kept.strides(0), bits};
    check_samples(view);
    return {kept.is(array) ? std::move(kept) : read_only(std::move(kept)), view};
}

ArrayFrame frame_of(Frame&& frame) {
    auto* owned = new Frame(std::move(frame));
    const py::capsule owner(owned, [](void* memory) { delete static_cast<Frame*>(memory); });
    const FrameView view = owned->view();
    const py::dtype type = view.bits > 8 ? py::dtype::of<std::uint16_t>() : py::dtype::of<std::uint8_t>();
    py::array array(type, {view.height_px, view.width_px},
                    {view.stride_bytes, static_cast<std::ptrdiff_t>(view.sample_bytes())}, view.data, owner);
    return {read_only(std::move(array)), view};  // no view of it can be made writeable
}

void check_samples(const FrameView& view) {
    if (view.bits == 8 || view.bits == 16) return;
    std::uint16_t largest = 0;
    for (int y = 0; y < view.height_px; ++y) {
        const std::uint16_t* row = view.row16(y);
        for (int x = 0; x < view.width_px; ++x) largest = std::max(largest, row[x]);
    }
    if (largest > view.full_scale()) {
        refuse(
            fmt::format("a sample reads {}, and the largest of {} bits is {}", largest, view.bits, view.full_scale()),
            "give the bits that the sensor recorded");
    }
}

std::pair<int, int> bins_of(const py::object& bins) {
    std::pair<int, int> out;
    if (py::isinstance<py::str>(bins)) {
        const auto text = bins.cast<std::string>();
        const auto parsed = algo::parse_bins(text);
        if (!parsed)
            refuse("bins " + text + " are not a macro-pixel size",
                   "write columns x rows, 3 to 15 bins a side, as in 9x9");
        return *parsed;
    }
    const auto whole_numbers = [&] {
        const auto pair = bins.cast<py::sequence>();
        return pair.size() == 2 && py::isinstance<py::int_>(pair[0]) && py::isinstance<py::int_>(pair[1]);
    };
    try {
        out = bins.cast<std::pair<int, int>>();
    } catch (const py::cast_error&) {
        if (py::isinstance<py::sequence>(bins) && whole_numbers())  // beyond an int
            refuse("bins " + py::str(bins).cast<std::string>() + " are not a macro-pixel size",
                   "give columns and rows, 3 to 15 bins a side, as in (9, 9)");
        throw py::type_error("bins are a text such as \"9x9\" or two numbers such as (9, 9)");
    }
    const auto wrong = [](int count) { return count < algo::kMinBins || count > algo::kMaxBins; };
    if (wrong(out.first) || wrong(out.second)) {
        refuse(fmt::format("bins {}x{} are not a macro-pixel size", out.first, out.second),
               "give columns and rows, 3 to 15 bins a side, as in (9, 9)");
    }
    return out;
}

}  // namespace hord::lab::python
