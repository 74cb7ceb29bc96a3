// hordd: the station as a systemd service. Service does the work; this file handles readiness, status, watchdog, socket
// activation, reload, the journal and the real-time policy.
#include <cstdio>
#include <cstdlib>
#include <string>
#include <utility>

#include <fmt/format.h>
#include <fmt/ranges.h>
#include <systemd/sd-daemon.h>

#include "common/cli/message.h"
#include "common/cli/output.h"
#include "common/cli/program.h"
#include "common/service_manager.h"
#include "common/toml_fields.h"
#include "firmware/config/path_check.h"
#include "firmware/core/faults.h"
#include "firmware/recipes/recipe_folder.h"
#include "firmware/service/early_signals.h"
#include "firmware/service/journal.h"
#include "firmware/service/realtime.h"
#include "firmware/service/service.h"
#include "firmware/store/recorder/store_setup.h"
#include "firmware/store/results/store_rights.h"

namespace {

using namespace hord;
using namespace hord::firmware;

constexpr int kBadConfiguration = 78;  // EX_CONFIG: systemd does not restart
constexpr int kCannotRun = 2;
constexpr int kResultsLost = 3;
constexpr Duration kStatusEvery = milliseconds(1000);

struct Options {
    std::string config = "/etc/hord/hordd.toml";
    int realtime = 0;
    bool check = false, catalog = false;
};

const char* environment(const char* name) {
    const char* value = std::getenv(name);
    return value == nullptr ? "" : value;
}

Result<Config> read_config(const Options& options) {
    auto config = load_config(options.config);
    if (config) config->state_folder = environment("STATE_DIRECTORY");
    return config;
}

int complain(JournalEvent what, const Error& error, int status) {
    write_to_journal(what, error.message());
    common::tell_manager("STATUS=" + error.message());
    return status;
}

int refuse_configuration(const Error& error) {
    return complain(JournalEvent::configuration_refused, error, kBadConfiguration);
}

// The sockets of hordd.socket by their FileDescriptorName. Fails with refused if there are two of one kind: systemd
// would take connections at the first one, and nobody would answer them.
Result<ListenSockets> sockets_from_systemd() {
    ListenSockets sockets;
    char** names = nullptr;
    const int count = sd_listen_fds_with_names(1, &names);
    bool twice = false;
    for (int k = 0; k < count; ++k) {
        const std::string_view name = names[k];
        int& socket = name == "modbus-read-only" ? sockets.modbus_read_only : sockets.modbus;
        twice = twice || socket != -1;
        socket = SD_LISTEN_FDS_START + k;
        std::free(names[k]);
    }
    if (count > 0) std::free(names);
    if (!twice) return sockets;
    return fail(ErrorCode::refused, "systemd gave two sockets for the same register port, and one is served",
                "give one ListenStream= (systemctl edit hordd.socket: an empty ListenStream= first takes the others "
                "away; 0.0.0.0:502 is every network)");
}

// The configured recipe is not among them: without it there is no start.
void print_unusable_recipes(const std::vector<RecipeEntry>& all, const std::filesystem::path& configured,
                            const std::optional<LightField>& light_field) {
    for (const RecipeEntry& entry : all) {
        std::error_code none;
        if (std::filesystem::equivalent(entry.file, configured, none)) continue;
        if (const auto fine = check_selectable(entry, light_field); !fine)
            fmt::print("note: a recipe that cannot be selected: {}\n", fine.error().message());
    }
}

// --check: everything that a start reads, and the folders.
int check(const Options& options) {
    const auto config = read_config(options);
    if (!config) return refuse_configuration(config.error());
    common::TomlProblems found;
    const auto use = [&](const auto& result) {
        if (!result) found.add(result.error());
    };
    const auto files = read_station_files(*config);  // refuses what check_sources() refuses
    use(files);
    const auto all = list_recipes(config->inspection.recipes);  // there need not be a folder of recipes
    const auto folders = check_folders(*config);
    use(folders);
    if (const auto store = store_folder(*config); folders && !store.empty()) {
        use(store::check_files(store).and_then([&] { return store::check_rights(store); }));
        if (config->store.frames_mb > 0) use(store::check_frames_folder(store / store::kFramesFolder));
    }
    use(check_lock_files(*config));
    // A refusal hides none of them.
    if (all) print_unusable_recipes(*all, config->inspection.recipe, files ? files->light_field : std::nullopt);
    if (!found.empty()) return refuse_configuration(found.as_error().value());
    for (const auto& readable : {check_sources(*config), folders}) {
        for (const std::string& folder : readable.value_or(std::vector<std::string>())) fmt::print("{}\n", folder);
    }
    for (const std::string& held : folders_in_use(*config)) fmt::print("note: {}\n", held);
    for (const Error& lost : problems_of_kept_recipe(*config, *files))
        fmt::print("note: what was in use or learned cannot be used at the next start: {}\n", lost.message());
    for (const Error& note : start_notes(*config)) fmt::print("note: {}\n", note.message());
    const auto print_notes = [](const std::string& name, const NumberedRecipe& of) {
        for (const std::string& note : notes(of)) fmt::print("{}: note: {}\n", name, note);
    };
    const std::string named = config->inspection.recipe.string();
    print_notes(named.empty() ? "the default recipe (inspection.recipe names none)" : named, files->recipe);
    for (const RecipeEntry& entry : all.value_or(std::vector<RecipeEntry>())) {
        std::error_code none;
        if (std::filesystem::equivalent(entry.file, config->inspection.recipe, none)) continue;
        if (entry.recipe) print_notes(entry.file.string(), *entry.recipe);
    }
    fmt::print("{} can be used; devices were not asked\n", options.config);
    return end_output(0);
}

class Daemon {
  public:
    explicit Daemon(const Options& options) : options_(options) {}

    int run() {
        auto config = read_config(options_);
        if (!config) return refuse_configuration(config.error());
        auto files = read_station_files(*config);
        if (!files) return refuse_configuration(files.error());
        const auto sockets = sockets_from_systemd();
        if (!sockets) return complain(JournalEvent::trouble, sockets.error(), kCannotRun);
        common::tell_manager("STATUS=opening devices");
        SimulationOptions simulation;
        simulation.variety = 2;
        simulation.cache = environment("CACHE_DIRECTORY");
        auto opened = Service::open(*config, std::move(*files), simulation, watchers(), *sockets);
        if (!opened) return complain(JournalEvent::trouble, opened.error(), kCannotRun);
        service_ = std::move(*opened);
        for (const auto& told : {start_notes(*config), missing_references(config->inspection.recipes)}) {
            for (const Error& note : told) write_to_journal(JournalEvent::trouble, note.message());
        }
        if (options_.realtime > 0) {
            for (const Error& refused : take_realtime_policy(options_.realtime))
                write_to_journal(JournalEvent::trouble, refused.message());
        }
        service_->loop().post([this] { begin(); });
        const auto ran = service_->run();
        common::tell_manager("STOPPING=1\nSTATUS=halting");
        service_->halt();                                              // lights off, permit down
        const std::unique_ptr<Service> service = std::move(service_);  // watchers ask it nothing any more
        const std::vector<Error> lost = service->close();
        for (const Error& error : lost) write_to_journal(JournalEvent::trouble, error.message());
        if (!ran) return complain(JournalEvent::trouble, ran.error(), kCannotRun);
        if (!lost.empty()) common::tell_manager("STATUS=" + lost.front().message());
        write_to_journal(JournalEvent::stopped,
                         lost.empty() ? "stopped as asked" : "stopped as asked; not everything could be stored");
        return lost.empty() ? 0 : kResultsLost;
    }

  private:
    ServiceWatchers watchers() {
        ServiceWatchers all;
        all.fault = [this](std::uint32_t raised, const Snapshot& now) {
            station_journal_.raised(raised, now.line_stop_why);
        };
        all.state = [this](State from, State to) {
            station_journal_.state(from, to, service_ ? service_->snapshot().faults_active : 0);
            if (service_) service_->loop().post([this] { notify_status(); });
        };
        all.recipe = [](const NumberedRecipe& recipe) {
            const std::string crc = fmt::format("{:08X}", crc32_of(recipe));
            write_to_journal(
                JournalEvent::recipe,
                fmt::format("recipe {} \"{}\", CRC-32 {}, is in use", recipe.number, recipe.recipe.name, crc),
                std::array{Field{"HORD_RECIPE", std::to_string(recipe.number)}, Field{"HORD_RECIPE_CRC", crc}});
        };
        all.reload = [this] { reload(); };
        all.stopped_early = [] {
            common::tell_manager("STOPPING=1");
            write_to_journal(JournalEvent::stopped, "stopped as asked, before the line ran");
        };
        all.trouble = [](const Error& error) { write_to_journal(JournalEvent::trouble, error.message()); };
        return all;
    }

    void begin() {
        const std::string address = service_->registers_address();
        write_to_journal(JournalEvent::ready, "registers at " + address, std::array{Field{"HORD_REGISTERS", address}});
        simulated_ = service_->simulated() == 0 ? "" : names_of_faults(service_->simulated());
        if (!simulated_.empty()) {
            write_to_journal(JournalEvent::simulated, "simulated: " + simulated_,
                             std::array{Field{"HORD_SIMULATED", simulated_}});
        }
        common::tell_manager("READY=1");
        notify_status();
        service_->loop().call_after(kStatusEvery, [this] { notify_status_again(); });
        std::uint64_t watchdog_us = 0;
        if (sd_watchdog_enabled(0, &watchdog_us) > 0) {
            check_liveness_every(microseconds(static_cast<std::int64_t>(watchdog_us / 4)));
        }
    }

    // The watchdog is fed only after every inspecting thread and the loop have answered.
    void check_liveness_every(Duration pace) {
        service_->liveness_check([] { common::tell_manager("WATCHDOG=1"); });
        service_->loop().call_after(pace, [this, pace] { check_liveness_every(pace); });
    }

    void notify_status_again() {
        const Snapshot now = service_->snapshot();
        station_journal_.faults(now.faults_active, now.line_stop_why);
        notify_status();
        flush_journal();
        common::tell_manager_again();
        service_->loop().call_after(kStatusEvery, [this] { notify_status_again(); });
    }
    void notify_status() {
        const Snapshot now = service_->snapshot();
        const Counters& c = now.counters;
        const std::string status =
            fmt::format("{}{}, {} parts: {} pass, {} reject, {} unfit; faults: {}{}", name_of(now.state),
                        now.line_stop ? ", LINE STOP" : "", c.seen, c.pass, c.reject, c.unfit,
                        names_of_faults(now.faults_active), simulated_.empty() ? "" : "; SIMULATED: " + simulated_);
        if (status != std::exchange(status_, status)) common::tell_manager("STATUS=" + status);
    }
    void reload() {
        timespec now{};
        ::clock_gettime(CLOCK_MONOTONIC, &now);
        common::tell_manager(fmt::format("RELOADING=1\nMONOTONIC_USEC={}",
                                         static_cast<long long>(now.tv_sec) * 1'000'000 + now.tv_nsec / 1000));
        const auto config = read_config(options_);
        const auto waiting = config ? service_->reload(*config) : tl::unexpected(config.error());
        if (!waiting) {
            write_to_journal(JournalEvent::reload_refused,
                             "reload refused, the old configuration stays: " + waiting.error().message());
        } else if (waiting->empty()) {
            write_to_journal(JournalEvent::reloaded, "configuration read again");
        } else {
            write_to_journal(
                JournalEvent::reloaded,
                fmt::format("configuration read again; not changed until a restart: {}", fmt::join(*waiting, ", ")));
        }
        if (waiting) {
            for (const Error& note : notes(*config)) write_to_journal(JournalEvent::trouble, note.message());
        }
        common::tell_manager("READY=1");
    }

    const Options& options_;
    std::unique_ptr<Service> service_;
    std::string status_, simulated_;
    StationJournal station_journal_{[](const Entry& entry, std::string_view message, std::span<const Field> fields) {
        write_to_journal(entry, message, fields);
    }};
};

// Before the libraries' constructors, which take most of the time before main().
[[gnu::section(".preinit_array"), gnu::used]] void (*const kFirst)() = hold_signals;

}  // namespace

int main(int argc, char** argv) {
    Options options;
    CLI::App program{
        "hordd: the inspection station as a service; runs until SIGTERM, reads its configuration again on SIGHUP"};
    program.set_version_flag("--version", "hordd " HORD_VERSION);
    program.add_option("--config", options.config, "Configuration (TOML)")->capture_default_str();
    add_number(program, "--realtime", options.realtime,
               "Run the timing thread under SCHED_FIFO with this priority; 0: not", 0, 99);
    program.add_flag(
        "--check", options.check,
        "Only read the configuration, its recipe and its calibration, look at the folders that it names, and say "
        "what is wrong with them");
    program.add_flag("--catalog", options.catalog,
                     "Only print the journal's catalogue: every message id, what it means and what to do");
    program.footer(
        "Exit status: 0 stopped as asked, 2 a device or a port cannot be used, another station uses the folder of "
        "state or results, or usage, 3 stopped as asked, but results or frames could not be stored, 78 the "
        "configuration cannot be used.\n"
        "Example: hordd --config deploy/hordd.toml");
    if (const auto ended = parse_command_line(program, argc, argv)) return *ended;
    if (options.catalog || options.check) release_signals();
    if (options.catalog) {
        print_output(format_catalog());
        return end_output(0);
    }
    if (options.check) {
        return check(options);
    }
    never_wait_for_stderr();
    end_at_signals("hordd: stopped as asked, before the line ran\n", false);
    return Daemon(options).run();
}
