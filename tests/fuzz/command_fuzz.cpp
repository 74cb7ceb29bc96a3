// Arbitrary bytes as the body of a command with a valid token, as the query of a search and as a part's name. A command
// that is executed has a known code, and every reply a known status.
#include <algorithm>
#include <array>
#include <cstdlib>

#include "firmware/core/enum_values.h"
#include "tests/fuzz/fuzzed_page.h"

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
    using namespace hord::firmware;
    using namespace hord::firmware::page;
    static FuzzedPage page([](Command code) {
        if (!std::ranges::count(kValuesOf<Command>, code) || code == Command::teach) std::abort();
    });
    const std::string text(reinterpret_cast<const char*>(data), size);
    Request request;
    request.host = "localhost";
    const auto check = [&] {
        constexpr std::array kStatus{200, 400, 404, 409, 503};
        if (!std::ranges::count(kStatus, page.pages.answer(request).status)) std::abort();
    };
    request.method = "POST";
    request.path = "/api/command";
    request.content_type = "application/json";
    request.authorization = std::string("Bearer ") + FuzzedPage::kToken;
    request.body = text;
    check();
    request.method = "GET";
    request.path = "/parts/" + text;
    check();
    request.path = "/api/results";
    const auto equals = text.find('=');
    request.query.emplace(text.substr(0, equals), equals == std::string::npos ? "" : text.substr(equals + 1));
    check();
    return 0;
}
