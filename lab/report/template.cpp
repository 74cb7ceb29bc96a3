#include "lab/report/template.h"

#include <algorithm>
#include <vector>

#include "lab/report/template_files.h"

namespace hord::lab {

std::string fill_template(std::string_view text, const TemplateFields& fields) {
    constexpr auto kNone = std::string_view::npos;
    std::string filled;
    std::vector<bool> shown{true};  // of the sections that are open here, outermost first
    std::size_t at = 0;
    const auto copy_until = [&](std::size_t end) {
        if (shown.back()) filled += text.substr(at, end - at);
        at = end;
    };
    for (;;) {
        const std::size_t begin = text.find("{{", at);
        const std::size_t end = begin == kNone ? kNone : text.find("}}", begin);
        if (end == kNone) break;
        copy_until(begin);
        const std::string_view tag = text.substr(begin + 2, end - begin - 2);
        const bool alone = (begin == 0 || text[begin - 1] == '\n') && text.substr(end + 2).starts_with('\n');
        const bool section = tag.starts_with('#') || tag.starts_with('^') || tag.starts_with('/');
        const auto field = fields.find(section ? tag.substr(1) : tag);
        if (tag.starts_with('/')) {
            if (shown.size() > 1) shown.pop_back();
        } else if (field == fields.end()) {
            if (section) shown.push_back(shown.back());
            copy_until(end + 2);
            continue;
        } else if (section) {
            shown.push_back(shown.back() && field->second.empty() == tag.starts_with('^'));
        } else if (shown.back()) {
            filled += field->second;
        }
        at = end + 2 + (alone && (section || field->second.ends_with('\n')) ? 1 : 0);
    }
    copy_until(text.size());
    return filled;
}

std::string fill_report(std::string_view name, const TemplateFields& fields) {
    const auto files = template_files();
    const auto file = std::ranges::find(files, std::string(name) + ".md", &EmbeddedFile::path);
    return file == files.end() ? std::string() : fill_template(file->text, fields);
}

}  // namespace hord::lab
