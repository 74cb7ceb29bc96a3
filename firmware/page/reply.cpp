#include "firmware/page/reply.h"

#include "firmware/store/results/json_text.h"

namespace hord::firmware::page {

Reply refusal(int status, std::string_view what, std::string_view cure) {
    return {.status = status, .body = store::to_text({{"error", what}, {"cure", cure}})};
}

Reply refusal(const Error& error) {
    const int status = error.code == ErrorCode::not_found ? 404
        : error.code == ErrorCode::invalid_argument       ? 400
        : error.code == ErrorCode::busy || error.code == ErrorCode::timeout || error.code == ErrorCode::disconnected
        ? 503
        : 500;
    return refusal(status, error.what, error.cure);
}

}  // namespace hord::firmware::page
