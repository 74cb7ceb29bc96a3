#include "firmware/config/path_check.h"

#include <algorithm>
#include <array>
#include <cerrno>
#include <cstring>
#include <filesystem>

#include <fcntl.h>
#include <fmt/format.h>
#include <linux/magic.h>
#include <pwd.h>
#include <sys/vfs.h>
#include <unistd.h>

#include "common/dangling_link.h"
#include "common/toml_fields.h"

namespace hord::firmware {
namespace {

namespace fs = std::filesystem;

std::string user_name() {
    const passwd* const user = ::getpwuid(::geteuid());
    return user == nullptr ? std::to_string(::geteuid()) : user->pw_name;
}

// Why this user may not, with effective rights; empty: he may.
std::string refusal(const fs::path& path, int mode) {
    return ::faccessat(AT_FDCWD, path.c_str(), mode, AT_EACCESS) == 0 ? std::string() : std::strerror(errno);
}

// Permissions do not tell that no file can be made there.
bool is_view_of_kernel(const fs::path& path) {
    struct statfs system {};
    if (::statfs(path.c_str(), &system) != 0) return false;
    constexpr std::array<long, 4> kViews{PROC_SUPER_MAGIC, SYSFS_MAGIC, CGROUP_SUPER_MAGIC, CGROUP2_SUPER_MAGIC};
    return std::ranges::find(kViews, static_cast<long>(system.f_type)) != kViews.end();
}

class Folders {
  public:
    void read(const char* key, const fs::path& folder) {
        if (!is_folder(key, folder)) return;
        if (const auto why = refusal(folder, R_OK | X_OK); !why.empty())
            return problem(key, folder, "cannot be read by user " + user_ + " (" + why + ")",
                           "give this user the right");
        good(key, folder, "user " + user_ + " may read it");
    }

    // The station creates the folder itself, but not the one that it is in.
    void write(const char* key, const fs::path& folder) {
        std::error_code error;
        if (fs::exists(folder, error) || error) {
            if (!is_folder(key, folder)) return;
            if (is_view_of_kernel(folder)) return problem(key, folder, "cannot hold files", "name another folder");
            if (const auto why = refusal(folder, W_OK | X_OK); !why.empty())
                return problem(key, folder, "cannot be written by user " + user_ + " (" + why + ")",
                               "give this user the right, or name another folder");
            return good(key, folder, "user " + user_ + " may write it");
        }
        if (is_dangling(key, folder)) return;
        const fs::path absolute = fs::absolute(folder, error).lexically_normal();
        const fs::path parent = (absolute.has_filename() ? absolute : absolute.parent_path()).parent_path();
        if (!fs::is_directory(parent, error))
            return problem(key, folder,
                           fmt::format("cannot be created: {} {}", parent.string(),
                                       fs::exists(parent, error) ? "is not a folder" : "does not exist"),
                           "create that folder, or name another one");
        if (is_view_of_kernel(parent))
            return problem(key, folder, fmt::format("cannot be created: {} cannot hold files", parent.string()),
                           "name another one");
        if (const auto why = refusal(parent, W_OK | X_OK); !why.empty())
            return problem(key, folder,
                           fmt::format("cannot be created by user {} in {} ({})", user_, parent.string(), why),
                           "create it and give it to this user, or name another one");
        good(key, folder, "does not exist; user " + user_ + " may create it");
    }

    Result<std::vector<std::string>> result() {
        if (!problems_.empty()) return problems_.as_error();
        return std::move(good_);
    }

  private:
    bool is_folder(const char* key, const fs::path& folder) {
        std::error_code error;
        if (fs::is_directory(folder, error)) return true;
        if (fs::exists(folder, error)) problem(key, folder, "is not a folder", "name a folder");
        else if (error)
            problem(key, folder, "cannot be looked at by user " + user_ + " (" + error.message() + ")",
                    "give this user the right, or name another folder");
        else if (!is_dangling(key, folder))
            problem(key, folder, "does not exist", "create it, or name another folder; " + mounted_late(folder));
        return false;
    }
    // Creating a folder there fails.
    bool is_dangling(const char* key, const fs::path& folder) {
        const std::string link = common::dangling_link(folder);
        if (!link.empty()) {
            problems_.add(Error{ErrorCode::io, fmt::format("{}: {}", key, link),
                                "create the folder that it links to, or remove the link, or name another folder; " +
                                    mounted_late(folder)});
        }
        return !link.empty();
    }
    void problem(const char* key, const fs::path& folder, const std::string& what, const std::string& cure) {
        problems_.add(Error{ErrorCode::io, fmt::format("{}: {} {}", key, folder.string(), what), cure});
    }
    void good(const char* key, const fs::path& folder, const std::string& what) {
        good_.push_back(fmt::format("{} {}: {}", key, folder.string(), what));
    }

    const std::string user_ = user_name();
    common::TomlProblems problems_;
    std::vector<std::string> good_;
};

// The path with every symbolic link replaced by its target, whether or not that exists: systemd does not follow links,
// and fs::weakly_canonical() stops at the first one to nothing. Of links in a circle, the path as it is.
fs::path without_links(const fs::path& path) {
    constexpr int kMaxLinks = 40;  // as the kernel
    std::error_code error;
    fs::path whole = fs::absolute(path, error);
    for (int links = 0; links <= kMaxLinks; ++links) {
        fs::path done, target;
        for (const fs::path& name : whole) {
            if (!target.empty()) {
                target /= name;
                continue;
            }
            const fs::path here = done / name;
            if (fs::is_symlink(fs::symlink_status(here, error))) target = done / fs::read_symlink(here, error);
            else done = here;
        }
        if (target.empty()) return done.lexically_normal();
        whole = target;
    }
    return fs::absolute(path, error);
}

}  // namespace

std::string mounted_late(const fs::path& folder) {
    return fmt::format("if it is mounted later: systemctl edit hordd, [Unit] RequiresMountsFor={}",
                       without_links(folder).string());
}

Result<std::vector<std::string>> check_sources(const Config& config) {
    Folders folders;
    if (const auto* const frames = std::get_if<FrameFolder>(&config.sensor))
        folders.read("sensor.folder", frames->folder);
    if (const auto* const parts = std::get_if<SimulatedSensor>(&config.sensor);
        parts != nullptr && !parts->scenes.empty())
        folders.read("sensor.scenes", parts->scenes);
    return folders.result();
}

Result<std::vector<std::string>> check_folders(const Config& config) {
    Folders folders;
    // The default one need not exist.
    const fs::path& recipes = config.inspection.recipes;
    std::error_code error;
    if (!recipes.empty() && (recipes != config.file.parent_path() / "recipes" || fs::exists(recipes, error) || error))
        folders.read("inspection.recipes", recipes);
    if (!config.state_folder.empty()) folders.write("$STATE_DIRECTORY", config.state_folder);
    if (!config.store.enabled) return folders.result();
    if (!config.store.folder.empty()) {
        folders.write("store.folder", config.store.folder);
    } else if (const fs::path store = store_folder(config);
               fs::exists(fs::symlink_status(store, error)) && !store.empty()) {
        folders.write("store.folder (not set: in $STATE_DIRECTORY)", store);  // made by the first start
    }
    return folders.result();
}

}  // namespace hord::firmware
