// `import hord`: the light field and what is computed from it, for Python and NumPy (lab/python/hord/__init__.py).
#include "lab/python/module.h"

#include <algorithm>
#include <cctype>

#include "algo/features/feature.h"
#include "algo/frame/mask.h"

namespace hord::lab::python {
namespace {

// The class of hord/errors.py for an error's code.
const char* class_of(ErrorCode code) {
    switch (code) {
        case ErrorCode::invalid_argument: return "InvalidArgument";
        case ErrorCode::not_found: return "NotFound";
        case ErrorCode::unreadable: return "Unreadable";
        case ErrorCode::unsupported: return "Unsupported";
        case ErrorCode::refused: return "Refused";
        case ErrorCode::io: return "IoError";
        default: return "Error";
    }
}

// The sentences are hordctl's: its options become Python's arguments, "--read-dn" read_dn and "--macro" bins.
std::string with_arguments(std::string text) {
    constexpr std::string_view kTool = "to hordctl as --";
    if (const auto at = text.find(kTool); at != std::string::npos) text.replace(at, kTool.size(), "as --");
    constexpr std::string_view kFrames = "hordctl inspect, learn and tune take frames";
    if (text == kFrames) return "hord.read, hord.inspect and hord.learn take frames";
    std::string out;
    for (std::size_t at = 0; at < text.size();) {
        const bool option = text.compare(at, 2, "--") == 0 && at + 2 < text.size() && std::islower(text[at + 2]) != 0 &&
            (at == 0 || text[at - 1] == ' ' || text[at - 1] == '(');
        if (!option) {
            out += text[at++];
            continue;
        }
        const auto end = std::min(text.find_first_not_of("abcdefghijklmnopqrstuvwxyz-", at + 2), text.size());
        std::string name = text.substr(at + 2, end - at - 2);
        std::ranges::replace(name, '-', '_');
        out += name == "macro" ? "bins" : name;
        at = end;
    }
    return out;
}

// Text for people. Bytes that are not UTF-8 (a file's name) are escaped as Python does: "gr\\xe9n.png".
py::object text_of(const std::string& bytes) {
    return py::reinterpret_steal<py::object>(
        PyUnicode_DecodeUTF8(bytes.data(), static_cast<py::ssize_t>(bytes.size()), "backslashreplace"));
}

// pybind11 wants this signature.
void raise_failure(std::exception_ptr pointer) {  // NOLINT(performance-unnecessary-value-param)
    try {
        if (pointer) std::rethrow_exception(pointer);
    } catch (const Failure& failure) {
        const Error& error = failure.error;
        const py::object type = py::module_::import("hord.errors").attr(class_of(error.code));
        PyErr_SetObject(type.ptr(),
                        py::make_tuple(text_of(with_arguments(error.what)), text_of(with_arguments(error.cure))).ptr());
    }
}

}  // namespace

PYBIND11_MODULE(_hord, module) {
    py::register_local_exception_translator(&raise_failure);
    module.attr("__version__") = HORD_VERSION;
    py::list features;
    for (const std::string_view name : algo::kFeatureNames) features.append(py::str(std::string(name)));
    module.attr("FEATURES") = py::tuple(features);
    module.attr("DARK") = int{algo::kDark};
    module.attr("SATURATED") = int{algo::kSaturated};
    module.attr("BORDER") = int{algo::kBorder};
    module.attr("RIM") = int{algo::kRim};
    module.attr("OUTSIDE") = int{algo::kOutside};
    module.attr("AT_LIMIT") = int{algo::kAtLimit};
    add_calibration(module);
    add_inspection(module);
    add_reference(module);
    add_light_field(module);
    add_features(module);
}

}  // namespace hord::lab::python
