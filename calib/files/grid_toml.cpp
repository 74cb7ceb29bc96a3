#include "calib/files/grid_toml.h"

#include <array>
#include <cmath>
#include <cstddef>
#include <cstdint>

#include <fmt/format.h>

#include "common/file_kind.h"
#include "common/file_writing.h"
#include "common/hash.h"
#include "common/toml_fields.h"

namespace hord::calib {
namespace {

constexpr std::string_view kChecksumKey = "checksum = \"fnv1a64:";
constexpr std::size_t kDigits = 16;
constexpr double kAny = 1e12;
constexpr double kShiftUnit = 0.001;   // px
constexpr double kMaxShift = 100'000;  // units

std::uint64_t fnv1a(std::string_view bytes) {
    common::Fnv1a64 hash;
    hash.add(bytes);
    return hash.value();
}

// The keys of a table whose values are plain numbers, in the file's order.
template <class Owner, class Number>
struct Key {
    const char* name;
    Number Owner::*value;
};
using S = GridStatistics;
constexpr Key<S, int> kCounts[] = {{"complete", &S::complete}, {"found", &S::found},         {"missing", &S::missing},
                                   {"rejected", &S::rejected}, {"saturated", &S::saturated}, {"blocks", &S::blocks}};
constexpr Key<S, double> kResiduals[] = {{"rms_x_px", &S::rms_x_px},
                                         {"rms_y_px", &S::rms_y_px},
                                         {"max_px", &S::max_px},
                                         {"cv_x_rms_px", &S::cv_x_rms_px},
                                         {"cv_y_rms_px", &S::cv_y_rms_px},
                                         {"noise_px", &S::noise_px},
                                         {"correlation_inflation", &S::correlation_inflation}};
constexpr Key<LensletShifts, double> kShifts[] = {{"rms_px", &LensletShifts::rms_px},
                                                  {"share", &LensletShifts::share},
                                                  {"left_x_px", &LensletShifts::left_x_px},
                                                  {"left_y_px", &LensletShifts::left_y_px}};
using D = DirectionStatistics;
constexpr Key<D, double> kDirections[] = {{"left_out_x_px", &D::left_out_x_px},
                                          {"left_out_y_px", &D::left_out_y_px},
                                          {"noise_px", &D::noise_px},
                                          {"scale_px_a_rad", &D::scale_px_a_rad},
                                          {"scale_sigma", &D::scale_sigma},
                                          {"stage_rotation_rad", &D::stage_rotation_rad},
                                          {"stage_rotation_sigma", &D::stage_rotation_sigma}};

// Shortest digits that read back as the same number, and a decimal point.
std::string number(double value) {
    std::string digits = fmt::format("{}", value);
    return digits.find_first_of(".en") == std::string::npos ? digits + ".0" : digits;
}
std::string number(int value) { return fmt::format("{}", value); }

template <class Owner, class Number, std::size_t N>
std::string to_toml(const Owner& from, const Key<Owner, Number> (&keys)[N]) {
    std::string lines;
    for (const auto& [name, value] : keys) lines += fmt::format("{} = {}\n", name, number(from.*value));
    return lines;
}

template <class Owner, std::size_t N>
void read(common::TomlTable& table, const Key<Owner, double> (&keys)[N], Owner& to, double low, double high) {
    for (const auto& [name, value] : keys) table.number(name, to.*value, low, high);
}

std::string list(const std::vector<double>& values) {
    std::string out = "[";
    for (std::size_t k = 0; k < values.size(); ++k)
        out += (k == 0 ? "" : k % 4 == 0 ? ",\n    " : ", ") + number(values[k]);
    return out + "]";
}

std::string toml_string(std::string_view text) {
    std::string out = "\"";
    for (const char c : text) {
        if (c == '"' || c == '\\') out += '\\';
        if (static_cast<unsigned char>(c) < 0x20) out += fmt::format("\\u{:04x}", static_cast<int>(c));
        else out += c;
    }
    return out + '"';
}

std::string directions_to_toml(const algo::DirectionMap& map, const DirectionStatistics& s) {
    return fmt::format(
        "\n[directions]\nname = \"{}\"\nreason = {}\nparameters = {}\nsigma = {}\nspan_rad = {}\nradius_px = "
        "{}\nzero_x_px = {}\nzero_y_px = {}\n"
        "captures = {}\n{}mirrored = {}\n",
        name_of(map.model), toml_string(s.reason), list(map.parameters), list(s.sigma), number(map.span_rad),
        number(map.radius_px), number(map.zero_px.x_px), number(map.zero_px.y_px), s.captures, to_toml(s, kDirections),
        s.mirrored);
}

void read_model(common::TomlTable& table, algo::GridModelKind& to) {
    std::array<std::string_view, algo::kGridModels.size()> models;
    for (std::size_t k = 0; k < models.size(); ++k) models[k] = name_of(algo::kGridModels[k]);
    if (const auto model = table.choice("name", models)) to = algo::kGridModels[*model];
}

void read_directions(common::TomlTable table, GridFile& file) {
    algo::DirectionMap& map = file.directions.emplace();
    DirectionStatistics& s = file.direction_statistics;
    read_model(table, map.model);
    table.text("reason", s.reason);
    table.numbers("parameters", map.parameters, 4, 64);
    table.numbers("sigma", s.sigma, 0, 64);
    table.number("span_rad", map.span_rad, 1e-9, kAny);
    table.number("radius_px", map.radius_px, 1e-9, kAny);
    table.number("zero_x_px", map.zero_px.x_px, -kAny, kAny);
    table.number("zero_y_px", map.zero_px.y_px, -kAny, kAny);
    table.integer("captures", s.captures, 0, 1'000'000);
    table.boolean("mirrored", s.mirrored);
    read(table, kDirections, s, -kAny, kAny);
}

// A line a lattice row.
std::string shifts_to_toml(const algo::LensletGrid& grid, double algo::PixelPoint::*axis) {
    std::string out = "[";
    for (std::size_t k = 0; k < grid.shifts_px.size(); ++k) {
        out += k % static_cast<std::size_t>(grid.columns) == 0 ? "\n" : "";
        out += fmt::format("{},", std::lround(grid.shifts_px[k].*axis / kShiftUnit));
    }
    return out + "\n]\n";
}

void read_shifts(common::TomlTable table, algo::LensletGrid& grid, LensletShifts& s) {
    read(table, kShifts, s, 0, 1e300);
    const std::size_t count = static_cast<std::size_t>(grid.columns) * static_cast<std::size_t>(grid.rows);
    std::vector<double> x, y;
    table.numbers("x", x, count, count);
    table.numbers("y", y, count, count);
    if (x.size() != count || y.size() != count)
        return table.problem("x", "does not shift every lenslet", "use an unchanged calibration file");
    for (std::size_t k = 0; k < count; ++k) {
        if (!(std::abs(x[k]) <= kMaxShift && std::abs(y[k]) <= kMaxShift))
            return table.problem("x", "shifts a lenslet out of the frame", "use an unchanged calibration file");
        grid.shifts_px.push_back({x[k] * kShiftUnit, y[k] * kShiftUnit});
    }
}

Result<void> replace(const std::filesystem::path& path, std::string_view text) {
    return common::write_atomically(path, {reinterpret_cast<const std::uint8_t*>(text.data()), text.size()});
}

// The oldest version that can say it: older programs read the file then.
int version_for(const algo::LensletGrid& grid) {
    using enum algo::GridModelKind;
    if (grid.model == similarity_radial1 || grid.model == division1 || grid.model == rational2) return kGridFileVersion;
    return grid.shifts_px.empty() ? 1 : 2;
}

}  // namespace

GridFile file_of(const GridCalibration& calibration, const GridStamp& stamp) {
    const GridFit& fit = calibration.fit;
    GridFile file;
    file.grid = fit.grid;
    file.stamp = stamp;
    file.reason = fit.reason;
    file.sigma = fit.sigma;
    for (const Unobservable& parameter : fit.unobservable)
        file.fixed += (file.fixed.empty() ? "" : ",") + parameter.name;
    file.statistics = {calibration.complete,
                       calibration.found,
                       calibration.missing,
                       calibration.rejected,
                       calibration.saturated,
                       fit.blocks,
                       fit.rms_x_px,
                       fit.rms_y_px,
                       fit.max_px,
                       fit.cv_x_rms_px,
                       fit.cv_y_rms_px,
                       fit.noise_px,
                       fit.correlation_inflation,
                       fit.shifts};
    return file;
}

void add_directions(GridFile& file, const DirectionFit& fit) {
    file.directions = fit.map;
    file.direction_statistics = static_cast<const DirectionStatistics&>(fit);
}

std::string to_toml(const GridFile& file) {
    const algo::LensletGrid& grid = file.grid;
    const GridStatistics& s = file.statistics;
    std::string body = fmt::format(
        "version = {}\n\n[camera]\nidentity = {}\nwidth_px = {}\nheight_px = {}\n\n[made]\ndate = {}\nwhite = {}\ndark "
        "= {}\n\n",
        version_for(grid), toml_string(file.stamp.camera), grid.width_px, grid.height_px, toml_string(file.stamp.date),
        toml_string(file.stamp.white), toml_string(file.stamp.dark));
    body += fmt::format(
        "[lattice]\nkind = \"{}\"\nstagger = \"{}\"\nparity = {}\ncolumns = {}\nrows = {}\norigin_u = {}\norigin_v = "
        "{}\nspan = {}\n\n",
        name_of(grid.kind), name_of(grid.stagger), grid.parity, grid.columns, grid.rows, number(grid.origin_u),
        number(grid.origin_v), number(grid.span));
    body += fmt::format(
        "[model]\nname = \"{}\"\nreason = {}\nparameters = {}\nsigma = {}\nfixed = {}\nmiddle_x_px = {}\nmiddle_y_px = "
        "{}\nradius_px = {}\n\n",
        name_of(grid.model), toml_string(file.reason), list(grid.parameters), list(file.sigma), toml_string(file.fixed),
        number(grid.middle_x_px), number(grid.middle_y_px), number(grid.radius_px));
    body += "[residuals]\n" + to_toml(s, kCounts) + to_toml(s, kResiduals);
    if (!grid.shifts_px.empty()) {
        body += "\n[lenslets]\n" + to_toml(s.shifts, kShifts) + "x = " + shifts_to_toml(grid, &algo::PixelPoint::x_px) +
            "y = " + shifts_to_toml(grid, &algo::PixelPoint::y_px);
    }
    if (file.directions) body += directions_to_toml(*file.directions, file.direction_statistics);
    return fmt::format("{}{:016x}\"\n{}", kChecksumKey, fnv1a(body), body);
}

Result<GridFile> parse_grid(std::string_view text, std::string_view name) {
    const std::size_t head = kChecksumKey.size() + kDigits + 2;
    if (auto right = common::require_kind(text, name, common::FileKind::calibration); !right)
        return tl::unexpected(right.error());
    if (text.size() < head || text.substr(0, kChecksumKey.size()) != kChecksumKey) {
        return fail(ErrorCode::unreadable, fmt::format("{}:1: no checksum", name),
                    "this is no calibration file; make one with hordctl calibrate");
    }
    if (text.substr(kChecksumKey.size(), kDigits) != fmt::format("{:016x}", fnv1a(text.substr(head)))) {
        return fail(ErrorCode::unreadable,
                    fmt::format("{}: the checksum does not fit: the file was changed after it was made", name),
                    "restore the file, or calibrate again");
    }
    common::TomlProblems problems;
    auto root = common::TomlTable::parse_text(text, name, problems);
    std::string checksum;
    root.text("checksum", checksum);
    int version = 0;
    root.integer("version", version, 0, 1'000'000);
    if (problems.empty() && (version < 1 || version > kGridFileVersion)) {
        return fail(ErrorCode::unsupported,
                    fmt::format("{}: calibration file version {}, not 1 to {}", name, version, kGridFileVersion),
                    "calibrate again with this program");
    }
    GridFile file;
    algo::LensletGrid& grid = file.grid;
    auto camera = root.table("camera");
    camera.text("identity", file.stamp.camera);
    camera.integer("width_px", grid.width_px, 1, 65536);
    camera.integer("height_px", grid.height_px, 1, 65536);
    auto made = root.table("made");
    made.text("date", file.stamp.date);
    made.text("white", file.stamp.white);
    made.text("dark", file.stamp.dark);
    auto lattice = root.table("lattice");
    constexpr std::array<std::string_view, 2> kKinds{"square", "hexagonal"};
    if (const auto kind = lattice.choice("kind", kKinds)) grid.kind = static_cast<algo::LatticeKind>(*kind);
    constexpr std::array<std::string_view, 3> kStaggers{"none", "rows", "columns"};
    if (const auto stagger = lattice.choice("stagger", kStaggers)) grid.stagger = static_cast<algo::Stagger>(*stagger);
    lattice.integer("parity", grid.parity, 0, 1);
    lattice.integer("columns", grid.columns, 1, 4096);
    lattice.integer("rows", grid.rows, 1, 4096);
    lattice.number("origin_u", grid.origin_u, -kAny, kAny);
    lattice.number("origin_v", grid.origin_v, -kAny, kAny);
    lattice.number("span", grid.span, 1e-9, kAny);
    auto model_table = root.table("model");
    read_model(model_table, grid.model);
    model_table.text("reason", file.reason);
    model_table.numbers("parameters", grid.parameters, 4, 64);
    model_table.numbers("sigma", file.sigma, 0, 64);
    model_table.text("fixed", file.fixed);
    model_table.number("middle_x_px", grid.middle_x_px, -kAny, kAny);
    model_table.number("middle_y_px", grid.middle_y_px, -kAny, kAny);
    model_table.number("radius_px", grid.radius_px, 1e-9, kAny);
    auto residuals = root.table("residuals");
    GridStatistics& s = file.statistics;
    for (const auto& [key, value] : kCounts) residuals.integer(key, s.*value, 0, 100'000'000);
    read(residuals, kResiduals, s, 0, 1e300);
    if (version >= 2 && root.has("lenslets")) read_shifts(root.table("lenslets"), grid, s.shifts);
    if (root.has("directions")) read_directions(root.table("directions"), file);
    root.refuse_unknown_keys();
    if (!problems.empty()) return problems.as_error();
    for (const auto& fine : {check(grid), file.directions ? check(*file.directions) : Result<void>{}}) {
        if (!fine) return fail(fine.error().code, fmt::format("{}: {}", name, fine.error().what), fine.error().cure);
    }
    return file;
}

Result<void> write_grid(const std::filesystem::path& path, const GridFile& file) {
    return replace(path, to_toml(file));
}

Result<GridFile> read_grid(const std::filesystem::path& path) {
    const auto text = common::read_file(path, common::kMaxText);
    if (!text) return tl::unexpected(common::cannot_read(path));
    return parse_grid(*text, path.string());
}

Result<void> write_centres(const std::filesystem::path& path, const GridCalibration& calibration) {
    std::string text = "m,n,x_px,y_px\n";
    for (const GridCalibration::Node& node : calibration.nodes()) {
        text += fmt::format("{},{},{:.5f},{:.5f}\n", node.m, node.n, node.centre_px.x_px, node.centre_px.y_px);
    }
    return replace(path, text);
}

}  // namespace hord::calib
