// The reference that the newest recipe of the store names, and the report beside it
// (firmware/diagnostics/learn_report.h). Clients name no file: all names come from that recipe.
#pragma once

#include <cstdint>
#include <string>

#include "common/result.h"
#include "firmware/store/results/json_text.h"

namespace hord::firmware::page {

// `recipe`: as Results::recipe_in_use(). {"file","since","parts","report"} without folders; `file` and `report` are
// null, and `note` says why, where there is none. A report counts only if it is of this reference and undamaged. Of a
// report only what the page knows is passed on, each text shortened.
store::Json reference_json(const store::Json& recipe);

// The picture of mean, spread and modes, if the report's picture has this CRC-32. Fails with not_found, unreadable
// (damaged).
Result<std::string> reference_picture(const store::Json& recipe, std::uint32_t crc32);

}  // namespace hord::firmware::page
