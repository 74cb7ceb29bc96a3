// Arbitrary bytes on one connection to hord-page. Every answer must be complete and legal, only the page's own files
// may be served, and no command may be executed without a token.
#include <cstdint>
#include <cstdlib>
#include <string>
#include <string_view>

#include "tests/firmware/page/answer_bytes.h"
#include "tests/fuzz/fuzzed_page.h"

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
    using namespace hord::firmware::page;
    static FuzzedPage page([](hord::firmware::Command) { std::abort(); });
    const std::string answer =
        test::answer_bytes(page.pages, page.viewers, {reinterpret_cast<const char*>(data), size});
    if (page.viewers.count() != 0) std::abort();
    if (!answer.empty() && !answer.starts_with("HTTP/1.")) std::abort();
    const std::string_view asked(reinterpret_cast<const char*>(data),
                                 size);  // a refusal may repeat the requested name
    if (answer.starts_with("HTTP/1.1 500") ||
        (answer.find("root:x:") != std::string::npos && asked.find("root:x:") == asked.npos))
        std::abort();
    const bool by_us = answer.starts_with("HTTP/1.1 2") || answer.starts_with("HTTP/1.1 404");
    if (by_us && answer.find("Content-Security-Policy: default-src 'none'") == std::string::npos) std::abort();
    return 0;
}
