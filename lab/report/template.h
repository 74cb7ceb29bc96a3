// The prose of reports: templates of docs/results/templates, built into the program, and the fields that fill them.
//
// The syntax is a part of Mustache's:
//   {{name}}                 the field
//   {{#name}} ... {{/name}}  only if the field is not empty
//   {{^name}} ... {{/name}}  only if it is empty
// A section tag alone on its line takes the line's end with it. So does {{name}} if the field ends with a newline, as
// tables do. A tag whose field is missing stays in the text, where tests of the reports find it.
#pragma once

#include <map>
#include <string>
#include <string_view>

namespace hord::lab {

using TemplateFields = std::map<std::string, std::string, std::less<>>;

std::string fill_template(std::string_view text, const TemplateFields& fields);

// docs/results/templates/NAME.md, filled. Empty when the program has no template of that name.
std::string fill_report(std::string_view name, const TemplateFields& fields);

}  // namespace hord::lab
