#include "firmware/page/tokens.h"

#include <algorithm>
#include <cerrno>
#include <cstring>
#include <sstream>

#include <fcntl.h>
#include <fmt/format.h>
#include <sys/stat.h>
#include <unistd.h>

#include "common/regular_file.h"
#include "common/unique_fd.h"
#include "firmware/store/results/hash_chain.h"

namespace hord::firmware::page {
namespace {

constexpr std::size_t kLargestFile = 64 * 1024;

store::Hash digest_of(std::string_view token) {
    return store::sha256({reinterpret_cast<const std::uint8_t*>(token.data()), token.size()});
}

bool printable(std::string_view text) {
    return std::all_of(text.begin(), text.end(), [](unsigned char c) { return c > 0x20 && c < 0x7F; });
}

}  // namespace

Result<Tokens> Tokens::load(const std::filesystem::path& file) {
    constexpr const char* kLines = "write one line \"NAME TOKEN\" for each person";
    if (auto regular = common::check_regular(file, kLines); !regular) return tl::unexpected(regular.error());
    const common::UniqueFd fd(::open(file.c_str(), O_RDONLY | O_CLOEXEC | O_NONBLOCK | O_NOCTTY));
    if (!fd) {
        return fail(ErrorCode::not_found, fmt::format("{} cannot be read ({})", file.string(), std::strerror(errno)),
                    "make it and let the page's user read it, or leave actions.tokens empty: the page then only shows");
    }
    struct stat what {};
    std::string text;
    const bool known = ::fstat(fd.get(), &what) == 0 && S_ISREG(what.st_mode);
    if (known) {
        text.resize(kLargestFile + 1);
        const ssize_t got = ::read(fd.get(), text.data(), text.size());
        text.resize(got > 0 ? static_cast<std::size_t>(got) : 0);
    }
    if (!known || text.size() > kLargestFile)
        return fail(ErrorCode::invalid_argument, file.string() + " is no file of tokens", kLines);
    if ((what.st_mode & (S_IWGRP | S_IRWXO)) != 0) {
        return fail(ErrorCode::refused,
                    fmt::format("{} has mode {:04o}: others than its owner may change it, or everybody may read it",
                                file.string(), what.st_mode & 07777U),
                    fmt::format("chmod 0640 {}, and give it to root and the page's group", file.string()));
    }
    return parse(text, file.string());
}

Result<Tokens> Tokens::parse(std::string_view text, const std::string& file) {
    Tokens tokens;
    std::istringstream lines{std::string(text)};
    int number = 0;
    for (std::string line; std::getline(lines, line);) {
        ++number;
        const auto wrong = [&](const std::string& what, const std::string& cure) {
            return fail(ErrorCode::invalid_argument, fmt::format("{}:{}: {}", file, number, what), cure);
        };
        if (const auto comment = line.find('#'); comment != std::string::npos) line.resize(comment);
        std::istringstream words(line);
        std::string name, token, more;
        if (!(words >> name)) continue;
        if (!(words >> token) || words >> more)
            return wrong("not a name and a token", "write \"NAME TOKEN\"; make a token with: openssl rand -hex 24");
        if (name.size() > kLongestName || !printable(name))
            return wrong("the name has more than 20 characters, or others than ASCII",
                         "choose a shorter one; it is recorded with each command");
        if (token.size() < kShortestToken || token.size() > kLongestToken || !printable(token)) {
            return wrong(fmt::format("the token of {} has fewer than {} characters", name, kShortestToken),
                         "make one with: openssl rand -hex 24");
        }
        const Entry one{name, digest_of(token)};
        for (const Entry& other : tokens.entries_) {
            if (other.name == one.name || other.digest == one.digest)
                return wrong(fmt::format("the name or the token of {} is there twice", name),
                             "give everybody a token of their own");
        }
        tokens.entries_.push_back(one);
    }
    if (tokens.entries_.empty())
        return fail(ErrorCode::invalid_argument, file + " holds no token",
                    "write one line \"NAME TOKEN\" for each person, or leave actions.tokens empty");
    return tokens;
}

std::optional<std::string> Tokens::owner(std::string_view token) const {
    const auto shown = digest_of(token.substr(0, kLongestToken + 1));
    std::optional<std::string> name;
    for (const Entry& one : entries_) {  // compare with all of them: constant time
        unsigned differs = 0;
        for (std::size_t k = 0; k < shown.size(); ++k) differs |= static_cast<unsigned>(one.digest[k] ^ shown[k]);
        if (differs == 0) name = one.name;
    }
    return name;
}

}  // namespace hord::firmware::page
