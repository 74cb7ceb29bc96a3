#include "lab/experiment/result_cache.h"

#include <fstream>
#include <iterator>

namespace hord::lab {
namespace {

Error cannot_write(const std::filesystem::path& file) {
    return {ErrorCode::io, file.string() + " cannot be written",
            "check that the folder exists, may be written to, and has space"};
}

Error foreign(const std::filesystem::path& file, const std::string& why) {
    return {ErrorCode::invalid_argument, file.string() + " " + why,
            "use another --out folder, or delete the file to begin again"};
}

Json parse(const std::string& line) { return Json::parse(line, nullptr, false); }

}  // namespace

Result<ResultCache> ResultCache::open(const std::filesystem::path& file, const Json& parameters) {
    ResultCache cells;
    cells.file_ = file;
    std::string text;
    if (std::filesystem::exists(file)) {
        std::ifstream stream(file, std::ios::binary);
        text.assign(std::istreambuf_iterator<char>(stream), {});
        if (!stream) return fail(ErrorCode::io, file.string() + " cannot be read", "check who may read it");
    }
    const std::size_t whole = text.rfind('\n') == std::string::npos ? 0 : text.rfind('\n') + 1;
    if (whole == 0) {
        std::ofstream stream(file, std::ios::binary | std::ios::trunc);
        stream << parameters.dump() << '\n';
        if (!stream.flush()) return tl::unexpected(cannot_write(file));
        return cells;
    }
    for (std::size_t from = 0, number = 1; from < whole; ++number) {
        const std::size_t end = text.find('\n', from);
        const Json line = parse(text.substr(from, end - from));
        from = end + 1;
        if (number == 1) {
            if (line != parameters)
                return tl::unexpected(foreign(file,
                                              "was made with other parameters (" +
                                                  line.dump(-1, ' ', false, Json::error_handler_t::replace) + ")"));
            continue;
        }
        if (!line.is_object() || !line.contains("cell") || !line["cell"].is_string() || !line.contains("values")) {
            return tl::unexpected(foreign(file, "line " + std::to_string(number) + " is not a cell"));
        }
        cells.cells_[line["cell"].get<std::string>()] = line["values"];
    }
    if (whole < text.size()) {
        std::error_code error;
        std::filesystem::resize_file(file, whole, error);
        if (error) return tl::unexpected(cannot_write(file));
    }
    cells.taken_up_ = cells.cells_.size();
    return cells;
}

const Json* ResultCache::find(const std::string& key) const {
    const auto found = cells_.find(key);
    return found == cells_.end() ? nullptr : &found->second;
}

Result<void> ResultCache::add(const std::string& key, Json values) {
    std::ofstream stream(file_, std::ios::binary | std::ios::app);
    stream << Json{{"cell", key}, {"values", values}}.dump() << '\n';
    if (!stream.flush()) return tl::unexpected(cannot_write(file_));
    cells_[key] = std::move(values);
    return {};
}

}  // namespace hord::lab
