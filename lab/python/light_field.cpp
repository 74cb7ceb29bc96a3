#include "lab/python/light_field.h"

#include <fmt/format.h>

#include "algo/frame/grid_decoder.h"
#include "calib/files/grid_toml.h"
#include "drivers/files/frame_file.h"
#include "lab/python/calibration.h"

namespace hord::lab::python {
namespace {

constexpr std::pair kDefaultBins{9, 9};

Error about(const std::string& source, const Error& error) {
    return source.empty() ? error : Error{error.code, source + ": " + error.what, error.cure};
}

// Decodes a raw frame through a calibration: a Calibration, or its file.
LightField through_grid(const FrameView& raw, const py::object& grid, std::pair<int, int> bins, std::string source) {
    const calib::GridFile file = grid_of(grid);
    Frame out;
    double bin_rad = 0;
    without_gil([&] {
        auto decoder = unwrap(algo::GridDecoder::create(file.grid, file.directions, bins.first, bins.second));
        bin_rad = decoder.bin_rad();
        auto decoded = decoder.decode(raw);
        if (!decoded) throw Failure{about(source, decoded.error())};
        out = std::move(*decoded);
    });
    const auto extents = unwrap(algo::extents_of_frame(out.width_px(), out.height_px(), bins.first, bins.second));
    return {frame_of(std::move(out)), extents, bin_rad, std::move(source)};
}

LightField decode(const py::array& frame, const py::object& bins, const py::object& grid, int bits) {
    ArrayFrame given = frame_of(frame, bits);
    const auto [i, j] = bins.is_none() ? kDefaultBins : bins_of(bins);
    if (!grid.is_none()) return through_grid(given.view, grid, {i, j}, {});
    const auto extents = unwrap(algo::extents_of_frame(given.view.width_px, given.view.height_px, i, j));
    return {std::move(given), extents, 0, {}};
}

LightField read(const File& file, const py::object& bins, const py::object& grid, int bits) {
    const std::string name = file.string();
    auto noted = without_gil([&] { return unwrap(drivers::read_noted_frame(file, {.bits = bits})); });
    const auto contradicts = [&](const std::string& given, const std::string& cure) {
        refuse(name + " says " + describe(*noted.geometry) + ", and " + given, cure);
    };
    std::pair<int, int> chosen = bins.is_none() ? kDefaultBins : bins_of(bins);
    if (noted.geometry) {
        const drivers::FrameGeometry& note = *noted.geometry;
        if (bits != 0 && bits != note.bits)
            contradicts(fmt::format("bits={}", bits), fmt::format("leave bits out, or give bits={}", note.bits));
        if (note.kind == drivers::FrameKind::raw && grid.is_none()) {
            contradicts("without a grid it would be read as macro-pixels",
                        "give grid, the calibration of its sensor (hord.calibrate)");
        }
        if (note.kind == drivers::FrameKind::macro_pixels) {
            if (!grid.is_none()) contradicts("a grid decodes raw frames", "leave grid out, or give the raw frame");
            const std::pair own{note.grid.i, note.grid.j};
            if (!bins.is_none() && own != chosen) {
                contradicts(fmt::format("bins={}x{}", chosen.first, chosen.second),
                            fmt::format("leave bins out, or give bins=({}, {})", own.first, own.second));
            }
            chosen = own;
        }
    }
    if (!grid.is_none()) return through_grid(noted.frame.view(), grid, chosen, name);
    const auto extents =
        algo::extents_of_frame(noted.frame.width_px(), noted.frame.height_px(), chosen.first, chosen.second);
    if (!extents) throw Failure{about(name, extents.error())};
    return {frame_of(std::move(noted.frame)), *extents, 0, name};
}

void write(const LightField& field, const File& file) {
    without_gil([&] {
        check_samples(field.frame.view);
        unwrap(drivers::write_frame(
            file, field.frame.view,
            drivers::FrameGeometry{drivers::FrameKind::macro_pixels, field.extents, field.frame.view.bits}));
    });
}

LightField from_samples(const py::array& samples, int bits) {
    if (samples.ndim() != 4) {
        refuse(fmt::format("a light field has four dimensions, and this array {}", samples.ndim()),
               "give samples [n, m, j, i]");
    }
    const auto side = [&](int k) { return samples.shape(k); };
    // The samples of a macro-pixel frame, whose view this was, are not copied.
    const py::array frame =
        samples.attr("transpose")(0, 2, 1, 3).attr("reshape")(side(0) * side(2), side(1) * side(3)).cast<py::array>();
    ArrayFrame given = frame_of(frame, bits);
    const auto extents = unwrap(algo::extents_of_frame(given.view.width_px, given.view.height_px,
                                                       static_cast<int>(side(3)), static_cast<int>(side(2))));
    return {std::move(given), extents, 0, {}};
}

}  // namespace

py::array LightField::samples() const {
    const FrameView& v = frame.view;
    const std::ptrdiff_t item = v.sample_bytes();
    return read_only(py::array(frame.array.dtype(), {extents.n, extents.m, extents.j, extents.i},
                               {v.stride_bytes * extents.j, item * extents.i, v.stride_bytes, item}, v.data,
                               frame.array));
}

LightField field_of(const py::object& frame, const py::object& bins, const py::object& grid, int bits) {
    if (py::isinstance<LightField>(frame)) return frame.cast<LightField>();
    if (py::isinstance<py::array>(frame)) return decode(frame.cast<py::array>(), bins, grid, bits);
    return read({path_of(frame, "a frame is a LightField, an array or the path of a file")}, bins, grid, bits);
}

void add_light_field(py::module_& module) {
    py::class_<LightField>(module, "LightField", R"(A light field: M x N lenslets of I x J bins.

Made by decode(), read() or from_samples(). It refers to the memory of the frame that it was made of.)")
        .def_property_readonly("samples", &LightField::samples,
                               "Samples [n, m, j, i], DN, uint8 or uint16: a read-only view, no copy. m and i count to "
                               "the right, n and j downwards.")
        .def_property_readonly(
            "frame", [](const LightField& f) { return read_only(f.frame.array.attr("view")().cast<py::array>()); },
            "The macro-pixel frame (N*J, M*I), DN: a read-only view.")
        .def_property_readonly(
            "shape",
            [](const LightField& f) { return py::make_tuple(f.extents.n, f.extents.m, f.extents.j, f.extents.i); },
            "(N, M, J, I).")
        .def_property_readonly(
            "bits", [](const LightField& f) { return f.frame.view.bits; }, "Of a sample, 8 to 16.")
        .def_readonly("bin_rad", &LightField::bin_rad,
                      "One bin pitch, radians; 0 without a calibration with directions.")
        .def_property_readonly(
            "source",
            [](const LightField& f) { return py::module_::import("os").attr("fsdecode")(py::bytes(f.source)); },
            "The file that it was read from; empty for arrays.")
        .def("save", &write, py::arg("file"),
             "Writes a PNG with a geometry note, which hordctl reads. Raises NotFound, Refused or IoError.")
        .def("__repr__", [](const LightField& f) {
            const algo::Extents& e = f.extents;
            return fmt::format("<hord.LightField {}x{} lenslets of {}x{} bins, {} bits>", e.m, e.n, e.i, e.j,
                               f.frame.view.bits);
        });
    module.def("decode", &decode, py::arg("frame"), py::arg("bins") = py::none(), py::arg("grid") = py::none(),
               py::arg("bits") = 0, R"(A light field from a frame: uint8 or uint16, shape (height, width).

bins: (I, J) or "9x9", columns x rows of bins a lenslet, 3 to 15; None: 9x9.
grid: a Calibration, or its file: `frame` is then a raw frame of that sensor and is decoded through it.
bits: of a sample, 9 to 16 in uint16; 0: those of the type.

A macro-pixel frame is not copied: the light field refers to its memory, which must not change while it is used.
Raises InvalidArgument: bins that do not divide the frame, samples above the bits, a grid of another frame size.)");
    module.def("read", &read, py::arg("file"), py::arg("bins") = py::none(), py::arg("grid") = py::none(),
               py::arg("bits") = 0, R"(A light field from a file: PNG, TIFF or binary PGM, 8- or 16-bit grey.

Arguments as of decode(). The file's geometry note, if it has one, gives bins and bits, and is compared with them.
Raises NotFound, Unreadable, Unsupported, InvalidArgument.)");
    module.def("from_samples", &from_samples, py::arg("samples"), py::arg("bits") = 0,
               R"(A light field from samples [n, m, j, i], uint8 or uint16.

No copy if they are the view of a macro-pixel frame. Raises InvalidArgument.)");
}

}  // namespace hord::lab::python
