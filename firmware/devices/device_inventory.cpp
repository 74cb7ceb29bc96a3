#include "firmware/devices/device_inventory.h"

#include <algorithm>
#include <array>
#include <fstream>
#include <iterator>
#include <map>
#include <sstream>

#include <fmt/format.h>
#include <unistd.h>

#include "common/device_access.h"
#include "common/file_writing.h"
#include "drivers/camera_process/camera_process.h"
#include "drivers/genicam/genicam_request.h"
#include "drivers/libcamera/libcamera_request.h"
#include "drivers/v4l2/v4l2_listing.h"
#include "firmware/config/module_profiles.h"
#include "firmware/devices/device_factory.h"

namespace hord::firmware {
namespace {

namespace fs = std::filesystem;
using hal::ListedCamera;
using hal::ListedFormat;

std::string toml_text(const std::string& text) {
    std::string out = "\"";
    for (const char letter : text) {
        if (letter == '"' || letter == '\\') out += '\\';
        if (static_cast<unsigned char>(letter) >= 0x20) out += letter;
    }
    return out + '"';
}

std::vector<std::string> lines_of(const std::string& text) {
    std::vector<std::string> lines;
    std::istringstream in(text);
    for (std::string line; std::getline(in, line);) lines.push_back(line);
    return lines;
}

// Empty: it cannot be read, as when its process or device is gone meanwhile.
std::string text_in(const fs::path& file) { return common::read_file(file).value_or(""); }

struct Process {
    std::string pid, name;
    std::vector<std::string> arguments;
    [[nodiscard]] std::string text() const { return name + " (process " + pid + ")"; }
};

// The processes of the machine, of all users.
std::vector<Process> processes(const fs::path& root) {
    std::vector<Process> all;
    std::error_code error;
    for (auto entries = fs::directory_iterator(root / "proc", error); !error && entries != fs::directory_iterator();
         entries.increment(error)) {
        const fs::directory_entry& entry = *entries;
        Process process;
        process.pid = entry.path().filename().string();
        if (process.pid.find_first_not_of("0123456789") != std::string::npos) continue;
        process.name = text_in(entry.path() / "comm");
        while (process.name.ends_with('\n')) process.name.pop_back();
        std::string line = text_in(entry.path() / "cmdline");
        for (std::size_t at = 0; at < line.size();) {
            const auto end = std::min(line.find('\0', at), line.size());
            process.arguments.push_back(line.substr(at, end - at));
            at = end + 1;
        }
        if (!process.name.empty()) all.push_back(std::move(process));
    }
    return all;
}

// Who has the file open; empty: nobody whose files this user may see.
std::string holder_of(const fs::path& root, const std::vector<Process>& running, const fs::path& file) {
    for (const Process& process : running) {
        std::error_code error;
        std::error_code gone;  // a process that ends meanwhile holds nothing
        for (auto entry = fs::directory_iterator(root / "proc" / process.pid / "fd", error);
             !error && entry != fs::directory_iterator(); entry.increment(error)) {
            if (fs::read_symlink(entry->path(), gone) == file) return process.text();
        }
    }
    return {};
}

// The process of the package that holds a camera: `program` runs with the command "start".
const Process* camera_holder(const std::vector<Process>& running, const std::string& program) {
    const auto found = std::ranges::find_if(running, [&](const Process& process) {
        return process.name == program && process.arguments.size() > 1 && process.arguments[1] == "start";
    });
    return found == running.end() ? nullptr : &*found;
}

// ---- GPIO

InventorySection gpio_section(const fs::path& root) {
    InventorySection section{"gpio",
                             "GPIO chips",
                             {},
                             "no GPIO chip found: looked for /dev/gpiochip*",
                             {},
                             "load the driver of the board's chip or attach a USB adapter with GPIO lines; gpiodetect "
                             "lists them"};
    const auto chips = drivers::list_gpio_chips(root / "dev");
    for (const drivers::ListedChip& chip : chips) {
        section.items.push_back(
            describe_chip(chip, std::ranges::count(chips, chip.label, &drivers::ListedChip::label) > 1));
    }
    return section;
}

// ---- cameras

// The format that the station would use: the deepest one that is grey. Null: none.
const ListedFormat* best_format(const ListedCamera& camera) {
    const ListedFormat* best = nullptr;
    for (const ListedFormat& format : camera.formats) {
        if (format.bits > (best == nullptr ? 0 : best->bits)) best = &format;
    }
    return best;
}

std::string size_lines(const ListedFormat& format) {
    return format.width_px == 0 ? ""
                                : fmt::format("width_px = {}\nheight_px = {}\n", format.width_px, format.height_px);
}

// The largest region of whole lenslets of inspection.macro's default, in steps that cameras have.
std::string region_lines(const ListedFormat& format) {
    constexpr int kStep = 9 * 8;
    if (format.width_px < kStep || format.height_px < kStep) return size_lines(format);
    return fmt::format("width_px = {}  # of {} x {}: whole lenslets of inspection.macro (9x9)\nheight_px = {}\n",
                       format.width_px / kStep * kStep, format.width_px, format.height_px,
                       format.height_px / kStep * kStep);
}

std::string trigger_lines(const std::vector<std::string>& triggers) {
    const auto line = std::ranges::find_if(triggers, [](const std::string& one) { return one.starts_with("Line"); });
    if (line != triggers.end())
        return fmt::format("trigger = \"line\"\ntrigger_source = {}  # the strobe's wire\n", toml_text(*line));
    const bool software = std::ranges::find(triggers, "Software") != triggers.end();
    return fmt::format("trigger = \"{}\"\n", software ? "software" : "free");
}

InventorySection v4l2_section(const fs::path& root, const std::vector<Process>& running) {
    InventorySection section{"v4l2",
                             "Video devices (V4L2)",
                             {},
                             "no video device found: looked for /dev/video*",
                             {},
                             "attach the camera and look at the kernel's log (dmesg); cameras of libcamera and GenICam "
                             "are listed below"};
    for (ListedCamera camera : drivers::list_v4l2_cameras(root / "dev")) {
        const std::string known = holder_of(root, running, camera.name);
        if (!known.empty()) camera.holder = known;
        section.items.push_back(describe_camera(camera, "v4l2"));
    }
    return section;
}

// The camera of a process that holds it, from its command line.
template <class Options>
std::string camera_of(const Process& process, std::optional<Options> (*parse)(const std::string&)) {
    const auto request = process.arguments.size() > 2 ? parse(process.arguments[2]) : std::nullopt;
    return request ? request->camera : std::string();
}

void list_of_program(InventorySection& section, const std::string& backend, const std::string& request,
                     const fs::path& program, const std::string& station) {
    auto cameras = drivers::list_cameras(request, program);
    if (!cameras) {
        section.problem = cameras.error().what;
        section.cure = cameras.error().cure;
        section.looked_for.clear();
        return;
    }
    for (ListedCamera& camera : *cameras) {
        if (!camera.holder.empty() && !station.empty()) camera.holder = station;
        section.items.push_back(describe_camera(camera, backend));
    }
}

InventorySection libcamera_section(const InventoryOptions& options, const std::vector<Process>& running) {
    InventorySection section{"libcamera",
                             "Cameras of libcamera",
                             {},
                             "no camera of libcamera found: asked libcamera",
                             {},
                             "attach the camera, install libcamera-ipa and join the group video; cam -l shows what "
                             "libcamera itself finds"};
    // To list cameras, libcamera sets up their links: not beside a station that streams.
    if (const Process* const station = camera_holder(running, "hord-camera")) {
        const std::string name = camera_of(*station, &drivers::parse_libcamera_request);
        InventoryItem item;
        item.name = name.empty() ? "the only camera" : name;
        item.holder = "the station: " + station->text();
        item.cure = "stop the station to list all cameras of libcamera and their formats";
        section.items.push_back(std::move(item));
        return section;
    }
    const auto program =
        options.libcamera_program.empty() ? drivers::camera_program("hord-camera") : options.libcamera_program;
    list_of_program(section, "libcamera", drivers::request_of(drivers::LibcameraSensorOptions{}), program, {});
    return section;
}

InventorySection genicam_section(const InventoryOptions& options, const std::vector<Process>& running) {
    InventorySection section{"genicam",
                             "GenICam cameras (GigE Vision, USB3 Vision)",
                             {},
                             "no GenICam camera found: asked every network of this machine, and USB",
                             {},
                             "check the camera's power and cable; a GigE camera needs an address of this machine's "
                             "network; for a USB one, see genicam.conf"};
    const Process* const station = camera_holder(running, "hord-genicam");
    const auto program =
        options.genicam_program.empty() ? drivers::camera_program("hord-genicam") : options.genicam_program;
    list_of_program(section, "genicam", drivers::request_of(drivers::GenicamSensorOptions{}), program,
                    station == nullptr ? std::string() : "the station, or another program: " + station->text());
    return section;
}

// ---- serial ports

bool is_port(const fs::path& root, const std::string& name) {
    constexpr std::array<std::string_view, 4> kKinds{"ttyS", "ttyUSB", "ttyACM", "ttyAMA"};
    const auto kind = std::ranges::find_if(kKinds, [&](std::string_view one) {
        return name.starts_with(one) && name.size() > one.size() &&
            name.find_first_not_of("0123456789", one.size()) == std::string::npos;
    });
    // The kernel makes ttyS files for ports that do not exist: their type is 0.
    return kind != kKinds.end() && text_in(root / "sys/class/tty" / name / "type") != "0\n";
}

InventorySection serial_section(const fs::path& root, const std::vector<Process>& running) {
    InventorySection section{"serial", "Serial ports",
                             {},       "no serial port found: looked for /dev/ttyS*, ttyUSB*, ttyACM*, ttyAMA*",
                             {},       "attach the adapter and look at the kernel's log (dmesg)"};
    std::error_code error;
    std::vector<fs::path> ports;
    for (const auto& entry : fs::directory_iterator(root / "dev", error)) {
        if (is_port(root, entry.path().filename().string())) ports.push_back(entry.path());
    }
    std::ranges::sort(ports, {}, [](const fs::path& port) { return std::pair(port.string().size(), port); });
    for (const fs::path& port : ports) {
        InventoryItem item;
        item.name = port.string();
        for (const auto& link : fs::directory_iterator(root / "dev/serial/by-id", error)) {
            if (fs::weakly_canonical(link.path(), error) != fs::weakly_canonical(port, error)) continue;
            item.name = link.path().string();
            item.text = port.string();
        }
        item.holder = holder_of(root, running, port);
        if (::access(port.c_str(), R_OK | W_OK) != 0) {
            item.problem = "may not be opened by this user";
            item.cure = common::access_cure(port.string());
        }
        item.config = fmt::format(
            "[rejector]\nbackend = \"modbus\"\ndevice = {}\nbaud = 19200\nparity = \"even\"\nunit = 1  # as set in the "
            "module\n",
            toml_text(item.name));
        section.items.push_back(std::move(item));
    }
    return section;
}

// ---- the rejector's module

InventorySection module_section(const hal::Clock& clock, const InventoryOptions& options) {
    InventorySection section{"module", "Rejector's module (Modbus)", {}, {}, {}, {}};
    if (!options.module) {
        section.looked_for = "no Modbus module was asked";
        section.cure = "give --module HOST[:PORT] to ask a module what it is";
        return section;
    }
    const drivers::ModuleAddress& at = *options.module;
    InventoryItem& item = section.items.emplace_back();
    item.name = fmt::format("{} unit {}", at.host_and_port(), at.unit);
    const auto found = identify_module(clock, at, options.patience);
    if (!found) {
        item.problem = found.error().what;
        item.cure = found.error().cure;
        return section;
    }
    item.text = found->text;
    if (found->text.starts_with("HORD HORD station")) {
        item.problem = "is a station, not a rejector";
        item.cure = "give the address of the rejector's module";
        return section;
    }
    std::string others;
    for (const ModuleProfile& profile : module_profiles().subspan(1))
        others += (others.empty() ? "" : ", ") + std::string(profile.name);
    if (found->profile.empty()) {
        item.problem = "does not say what it is";
        item.cure = fmt::format(
            "see its label, and set rejector.profile: {} for any module with coils, or {} (the table of modules in "
            "docs/hardware.md)",
            module_profiles().front().name, others);
    }
    const int output = found->first_output;
    item.config = fmt::format(
        "[rejector]\nbackend = \"modbus\"\nhost = {}\nport = {}\nunit = {}\nprofile = \"{}\"{}\nreject_coil = {}  # as "
        "the "
        "ejector is wired\nrun_permit_coil = {}  # as the run permit is wired\n",
        toml_text(at.host), at.port, at.unit, found->profile.empty() ? "plain-coils" : found->profile,
        found->profile.empty() ? "  # or " + others + ": see its label" : "", output, output + 1);
    return section;
}

}  // namespace

InventoryItem describe_chip(const drivers::ListedChip& chip, bool shared_label) {
    InventoryItem item;
    item.name = chip.path;
    item.text = chip.problem.empty() ? fmt::format("{}, {} lines", toml_text(chip.label), chip.lines.size()) : "";
    item.problem = chip.problem;
    item.cure = chip.cure;
    item.lines = chip.lines;
    std::vector<std::string> free;
    for (const drivers::ListedLine& line : chip.lines) {
        if (line.holder || line.output) continue;
        const bool unique = std::ranges::count(chip.lines, line.name, &drivers::ListedLine::name) == 1;
        free.push_back(line.name.empty() || !unique ? std::to_string(line.offset) : line.name);
    }
    if (free.size() < 2) return item;
    item.config = fmt::format(
        "[strobe]\nbackend = \"gpio\"\n[[strobe.channel]]\nchip = {0}\nline = {1}  # the light's: any line that is not "
        "in use\n[part_sensor]\nbackend = \"gpio\"\nchip = {0}\nline = {2}  # the light barrier's\n",
        toml_text(chip.label.empty() || shared_label ? chip.path : chip.label), toml_text(free[0]), toml_text(free[1]));
    return item;
}

InventoryItem describe_camera(const ListedCamera& camera, const std::string& backend) {
    InventoryItem item;
    item.name = camera.name;
    item.text = camera.text;
    item.holder = camera.holder;
    item.problem = camera.problem;
    item.cure = camera.cure;
    item.formats = camera.formats;
    item.triggers = camera.triggers;
    if (!item.problem.empty() || !camera.holder.empty()) return item;
    const std::string head = fmt::format("[sensor]\nbackend = \"{}\"\n{} = {}\n", backend,
                                         backend == "v4l2" ? "device" : "camera", toml_text(camera.name));
    if (const ListedFormat* const grey = best_format(camera)) {
        item.config = head + (backend == "genicam" ? region_lines(*grey) : size_lines(*grey)) +
            fmt::format("bits = {}  # {}\n", grey->bits, grey->name) +
            (backend == "genicam" ? trigger_lines(camera.triggers) : "");
        return item;
    }
    const auto colour = std::ranges::find_if(
        camera.formats, [](const ListedFormat& format) { return format.name == "BGR888" || format.name == "RGB888"; });
    if (backend == "libcamera" && colour != camera.formats.end()) {
        item.config = head + size_lines(*colour) + "green = true  # a colour camera: for a trial only\n";
        return item;
    }
    if (camera.formats.empty()) {
        item.problem = "names no format";
        item.cure = "switch the camera on; a loopback device has its writer's format";
        return item;
    }
    item.problem = "has no grey format that the station can use";
    item.cure = "use a monochrome camera";
    return item;
}

std::vector<std::string> make_one_file(std::vector<InventorySection>& sections) {
    std::map<std::string, std::string> set_by;  // a table's head to the item's name
    for (auto section = sections.rbegin(); section != sections.rend(); ++section) {
        for (InventoryItem& item : section->items) {
            std::vector<std::string> heads;
            std::string commented;
            for (const std::string& line : lines_of(item.config)) {
                if (line.starts_with('[') && !line.starts_with("[[")) heads.push_back(line);
                commented += "# " + line + '\n';
            }
            const auto taken = std::ranges::find_if(heads, [&](const auto& head) { return set_by.contains(head); });
            if (taken == heads.end()) {
                for (const std::string& head : heads) set_by.emplace(head, item.name);
            } else {
                item.config =
                    fmt::format("# or, instead of {} of {}:\n{}", *taken, toml_text(set_by.at(*taken)), commented);
            }
        }
    }
    std::vector<std::string> missing;
    for (const char* head : {"[sensor]", "[strobe]", "[part_sensor]", "[rejector]"})
        if (!set_by.contains(head)) missing.emplace_back(head);
    return missing;
}

std::vector<InventorySection> list_devices(const hal::Clock& clock, const InventoryOptions& options) {
    const auto running = processes(options.root);
    return {
        gpio_section(options.root),        v4l2_section(options.root, running),   libcamera_section(options, running),
        genicam_section(options, running), serial_section(options.root, running), module_section(clock, options)};
}

}  // namespace hord::firmware
