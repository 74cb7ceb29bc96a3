#include "common/file_kind.h"

#include <array>
#include <string>

#include <fcntl.h>
#include <unistd.h>

#include "common/unique_fd.h"

namespace hord::common {
namespace {

constexpr std::size_t kHeadBytes = 65'536;

struct KindText {
    FileKind kind;
    const char* name;
    const char* belongs;  // where a file of this kind is given
};
constexpr std::array<KindText, 10> kTexts{{
    {FileKind::image, "an image", "hordctl inspect, learn and tune take frames"},
    {FileKind::reference, "a learned reference",
     "give it to hordctl as --reference, or name it in a recipe's [reference]"},
    {FileKind::calibration, "a calibration", "give it to hordctl as --grid, or name it in hordd.toml: inspection.grid"},
    {FileKind::recipe, "a recipe", "give it to hordctl as --recipe, or name it in hordd.toml: inspection.recipe"},
    {FileKind::configuration, "a station's configuration", "give it to hordd, or to hordctl run, selftest and latency"},
    {FileKind::page, "the page's configuration", "give it to hord-page"},
    {FileKind::mqtt, "a configuration of hord-mqtt", "give it to hord-mqtt"},
    {FileKind::scene, "a scene of the simulated cell", "give it to hord-lab: render, scene, design"},
    {FileKind::stations, "a list of stations", "give it to hord-page as --stations"},
    {FileKind::tilts, "a list of tilted frames", "give it to hordctl calibrate as --tilts"},
}};

const KindText& text_of(FileKind kind) { return kTexts[static_cast<std::size_t>(kind) - 1]; }

bool has_line(std::string_view text, std::string_view start) {
    if (text.starts_with(start)) return true;
    for (auto at = text.find(start); at != std::string_view::npos; at = text.find(start, at + 1)) {
        if (at > 0 && text[at - 1] == '\n') return true;
    }
    return false;
}

// Empty for what is no regular file: a pipe could block.
std::string head_of(const std::filesystem::path& file) {
    std::error_code error;
    if (!std::filesystem::is_regular_file(file, error)) return {};
    const UniqueFd fd(::open(file.c_str(), O_RDONLY | O_CLOEXEC | O_NONBLOCK));  // /proc/kmsg is regular, and waits
    std::string head(kHeadBytes, '\0');
    const ssize_t count = fd ? ::read(fd.get(), head.data(), head.size()) : 0;
    head.resize(count > 0 ? static_cast<std::size_t>(count) : 0);
    return head;
}

}  // namespace

FileKind kind_of(std::string_view bytes) {
    using namespace std::string_view_literals;
    for (const auto magic : {"\x89PNG\r\n\x1a\n"sv, "II*\0"sv, "MM\0*"sv, "P5\n"sv, "P5 "sv, "\xFF\xD8\xFF"sv}) {
        if (bytes.starts_with(magic)) return FileKind::image;
    }
    if (bytes.starts_with("HORDREF")) return FileKind::reference;
    if (bytes.starts_with("checksum = \"fnv1a64:")) return FileKind::calibration;
    for (const char* table : {"[sensor]", "[part_sensor]", "[rejector]", "[strobe]", "[inspection]"}) {
        if (has_line(bytes, table)) return FileKind::configuration;
    }
    if (has_line(bytes, "[broker]") || has_line(bytes, "[sparkplug]")) return FileKind::mqtt;
    if (has_line(bytes, "[page]")) return FileKind::page;
    if (has_line(bytes, "[[station]]")) return FileKind::stations;
    if (has_line(bytes, "[[tilt]]")) return FileKind::tilts;
    if (has_line(bytes, "[camera]") || has_line(bytes, "[[defect]]")) return FileKind::scene;
    if (has_line(bytes, "[limits]") || has_line(bytes, "rim_margin =")) return FileKind::recipe;
    return FileKind::unknown;
}

Result<void> require_kind(std::string_view bytes, std::string_view name, FileKind wanted) {
    const FileKind kind = kind_of(bytes);
    if (kind == FileKind::unknown || kind == wanted) return {};
    return fail(ErrorCode::invalid_argument,
                std::string(name) + " is " + text_of(kind).name + ", and " + text_of(wanted).name + " is needed",
                text_of(kind).belongs);
}

Result<void> require_kind(const std::filesystem::path& file, FileKind wanted) {
    return require_kind(head_of(file), file.string(), wanted);
}

Result<void> refuse_hand_written(const std::filesystem::path& file) {
    const FileKind kind = kind_of(head_of(file));
    if (kind < FileKind::recipe) return {};
    return fail(ErrorCode::refused, file.string() + " is " + text_of(kind).name + ": it is not overwritten",
                "give another name, or remove it first");
}

}  // namespace hord::common
