#include "lab/python/calibration.h"

#include <ctime>

#include <fmt/chrono.h>
#include <fmt/format.h>

#include "calib/calibrate/calibrate_grid.h"
#include "calib/tilts/tilts.h"
#include "common/crc32.h"

namespace hord::lab::python {
namespace {

std::optional<FrameView> view_of(const std::optional<ArrayFrame>& frame) {
    return frame ? std::optional(frame->view) : std::nullopt;
}

// (frame, x_rad, y_rad) of each capture of tilted light.
using TiltArguments = std::vector<std::tuple<py::array, double, double>>;

Calibration calibrate(const py::array& white, const std::optional<py::array>& dark,
                      const std::optional<py::array>& flat, const std::optional<py::array>& empty,
                      const TiltArguments& tilts, int bits, const std::string& camera) {
    const ArrayFrame white_frame = frame_of(white, bits);
    const auto optional = [&](const std::optional<py::array>& frame) {
        return frame ? std::optional(frame_of(*frame, bits)) : std::nullopt;
    };
    const auto dark_frame = optional(dark), flat_frame = optional(flat), empty_frame = optional(empty);
    if (empty_frame.has_value() != !tilts.empty()) {
        refuse(tilts.empty() ? "a frame of the empty field calibrates nothing by itself"
                             : "directions are measured from the frame of the empty field, and there is none",
               "give empty and tilts together");
    }
    std::vector<ArrayFrame> tilted;
    for (const auto& tilt : tilts) tilted.push_back(frame_of(std::get<0>(tilt), bits));
    const calib::GridStamp stamp{camera, fmt::format("{:%Y-%m-%dT%H:%M:%SZ}", fmt::gmtime(std::time(nullptr))),
                                 "hord.calibrate", ""};
    return without_gil([&] {
        calib::GridOptions options;
        options.flat = view_of(flat_frame);
        const auto found = unwrap(calib::calibrate_grid(white_frame.view, view_of(dark_frame), options));
        Calibration out{calib::file_of(found, stamp), found.warnings};
        if (tilts.empty()) return out;
        const auto measure = [&](const FrameView& view) {
            return unwrap(calib::measure_spots(view, view_of(dark_frame), view_of(flat_frame), found));
        };
        const calib::SpotPlace zero = measure(empty_frame->view);
        std::vector<calib::Tilt> measured;
        for (std::size_t k = 0; k < tilted.size(); ++k) {
            measured.push_back(
                {fmt::format("tilts[{}]", k), {std::get<1>(tilts[k]), std::get<2>(tilts[k])}, measure(tilted[k].view)});
        }
        calib::add_directions(out.file, unwrap(calib::fit_directions(zero, measured, found.pitch_px)));
        return out;
    });
}

py::array_t<double> centres(const Calibration& c) {
    const algo::LensletGrid& grid = c.file.grid;
    py::array_t<double> out({grid.rows, grid.columns, 2});
    auto to = out.mutable_unchecked<3>();
    for (int n = 0; n < grid.rows; ++n) {
        for (int m = 0; m < grid.columns; ++m) {
            const algo::PixelPoint at = grid.centre_px(m, n);
            to(n, m, 0) = at.x_px;
            to(n, m, 1) = at.y_px;
        }
    }
    return out;
}

double pitch_px(const Calibration& c) {
    const algo::LensletGrid& grid = c.file.grid;
    return grid.steps_px(grid.uv(grid.columns / 2, grid.rows / 2)).mean_px();
}

py::dict statistics(const Calibration& c) {
    const calib::GridStatistics& s = c.file.statistics;
    using namespace py::literals;
    return py::dict("complete"_a = s.complete, "found"_a = s.found, "missing"_a = s.missing, "rejected"_a = s.rejected,
                    "saturated"_a = s.saturated, "rms_x_px"_a = s.rms_x_px, "rms_y_px"_a = s.rms_y_px,
                    "max_px"_a = s.max_px, "cv_rms_x_px"_a = s.cv_x_rms_px, "cv_rms_y_px"_a = s.cv_y_rms_px);
}

}  // namespace

calib::GridFile grid_of(const py::object& grid) {
    if (py::isinstance<Calibration>(grid)) return grid.cast<Calibration>().file;
    const auto file = path_of(grid, "a grid is a Calibration or the path of its file");
    return without_gil([&] { return unwrap(calib::read_grid(file)); });
}

void add_calibration(py::module_& module) {
    py::class_<Calibration>(module, "Calibration",
                            "The lenslet grid of a sensor, and its direction map if tilts were captured.")
        .def_static(
            "load",
            [](const File& file) {
                return without_gil([&] { return Calibration{unwrap(calib::read_grid(file)), {}}; });
            },
            py::arg("file"),
            "Reads what hordctl calibrate or save() wrote. Raises NotFound, Unreadable, InvalidArgument, Unsupported.")
        .def(
            "save",
            [](const Calibration& c, const File& file) {
                without_gil([&] { unwrap(calib::write_grid(file, c.file)); });
            },
            py::arg("file"),
            "Writes the calibration file (TOML), which hordctl --grid and hordd read. Raises NotFound, "
            "Refused or IoError.")
        .def_property_readonly("centres", &centres,
                               "Lenslet centres [n, m, 2], float64: x and y in pixels of the raw frame, (0, 0) the "
                               "centre of its top-left pixel. Not all need lie inside the frame.")
        .def_property_readonly("pitch_px", &pitch_px, "Mean of the two pitches at the middle of the grid, pixels.")
        .def_property_readonly(
            "lattice", [](const Calibration& c) { return std::string(name_of(c.file.grid.kind)); },
            "\"square\" or \"hexagonal\".")
        .def_property_readonly(
            "model", [](const Calibration& c) { return std::string(name_of(c.file.grid.model)); },
            "Name of the model that was selected.")
        .def_property_readonly(
            "reason", [](const Calibration& c) { return c.file.reason; }, "Why this model.")
        .def_property_readonly(
            "camera", [](const Calibration& c) { return c.file.stamp.camera; }, "Identity of the camera, as given.")
        .def_property_readonly(
            "frame_shape",
            [](const Calibration& c) { return py::make_tuple(c.file.grid.height_px, c.file.grid.width_px); },
            "(height, width) of the raw frame, pixels.")
        .def_property_readonly(
            "has_directions", [](const Calibration& c) { return c.file.directions.has_value(); },
            "Whether bins are known in radians.")
        .def_property_readonly(
            "scale_px_a_rad", [](const Calibration& c) { return c.file.direction_statistics.scale_px_a_rad; },
            "Pixels a radian; 0 without directions.")
        .def_property_readonly("statistics", &statistics,
                               "Counts of lenslets, and residuals of the fit in pixels: a dict.")
        .def_readonly("warnings", &Calibration::warnings,
                      "Sentences: the grid is usable, but something is unusual. Empty for a file.")
        .def(
            "toml", [](const Calibration& c) { return calib::to_toml(c.file); }, "The text of the calibration file.");
    module.def("calibrate", &calibrate, py::arg("white"), py::arg("dark") = py::none(), py::arg("flat") = py::none(),
               py::arg("empty") = py::none(), py::arg("tilts") = py::list(), py::arg("bits") = 0,
               py::arg("camera") = std::string(calib::kUnnamedCamera),
               R"(The lenslet grid of a sensor from a white frame, as hordctl calibrate finds it.

white: a raw frame of even light, uint8 or uint16, shape (height, width), at least 24 pixels a side.
dark, flat: frames without light and without lenslets, of the same shape.
empty, tilts: collimated frames of the empty field, and (frame, x_rad, y_rad) of known directions; they give radians.

Raises Refused, with reason and cure, for a frame that shows no single lattice of lenslets; InvalidArgument.)");
}

}  // namespace hord::lab::python
