// What is attached to this machine that the station could use. No output moves, no light fires, no line or serial port
// is opened, and no camera is taken that another program holds.
#pragma once

#include <filesystem>
#include <optional>
#include <string>
#include <vector>

#include "drivers/gpio/gpio_listing.h"
#include "drivers/hal/clock.h"
#include "drivers/hal/listed_camera.h"
#include "drivers/modbus/modbus_options.h"

namespace hord::firmware {

struct InventoryOptions {
    std::filesystem::path root = "/";                          // of dev, proc and sys
    std::filesystem::path libcamera_program, genicam_program;  // empty: the package's
    std::optional<drivers::ModuleAddress> module;              // none: no module is asked
    hal::Duration patience = std::chrono::seconds(1);          // with the module's answers
};

struct InventoryItem {
    std::string name;                        // what the configuration names it by
    std::string text;                        // what it is
    std::string holder;                      // who uses it now; empty: nobody, as far as this user may see
    std::string problem, cure;               // why it could not be read or used
    std::vector<drivers::ListedLine> lines;  // of a GPIO chip
    std::vector<hal::ListedFormat> formats;  // of a camera
    std::vector<std::string> triggers;       // of a camera
    std::string config;                      // lines for hordd.toml; empty: it cannot be used as it is
};

struct InventorySection {
    std::string key;    // "gpio", "v4l2", "libcamera", "genicam", "serial", "module"
    std::string title;  // for people
    std::vector<InventoryItem> items;
    std::string looked_for;     // without items: a sentence, what was looked for
    std::string problem, cure;  // without items: why nothing could be listed; how to attach or permit a device
};

// Of a GPIO chip; `shared_label`: another chip has its label, too, so its path names it.
InventoryItem describe_chip(const drivers::ListedChip& chip, bool shared_label);
// Of a camera of sensor.backend "v4l2", "libcamera" or "genicam".
InventoryItem describe_camera(const hal::ListedCamera& camera, const std::string& backend);

// Makes the lines of all items one valid file. Where several items set the same table, one item keeps its lines: the
// first item of the last section that sets it. The lines of the others become comments that name that item. Returns the
// tables that a configuration needs beside these lines ("[strobe]"): no device of theirs was found.
std::vector<std::string> make_one_file(std::vector<InventorySection>& sections);

// Blocks for the time that cameras and the module need to answer, a few seconds.
std::vector<InventorySection> list_devices(const hal::Clock& clock, const InventoryOptions& options);

}  // namespace hord::firmware
