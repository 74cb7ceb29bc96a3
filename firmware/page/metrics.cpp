#include "firmware/page/metrics.h"

#include <array>
#include <fstream>
#include <limits>
#include <span>
#include <sstream>

#include <fmt/format.h>
#include <prometheus/metric_family.h>
#include <prometheus/text_serializer.h>
#include <sys/resource.h>
#include <unistd.h>

#include "firmware/core/events.h"
#include "firmware/core/faults.h"

namespace hord::firmware::page {
namespace {

using prometheus::ClientMetric;
using prometheus::MetricFamily;
using prometheus::MetricType;
using Labels = std::vector<ClientMetric::Label>;

class Families {
  public:
    using Values = std::vector<std::pair<Labels, double>>;

    void add(const std::string& name, const char* help, MetricType type, const Values& values) {
        MetricFamily& family = begin(name, help, type);
        for (const auto& [labels, value] : values) {
            ClientMetric& metric = family.metric.emplace_back();
            metric.label = labels;
            (type == MetricType::Counter ? metric.counter.value : metric.gauge.value) = value;
        }
    }
    // Without labels. An unknown value is absent, not zero.
    void one(const std::string& name, const char* help, MetricType type, std::optional<double> value) {
        if (value) add(name, help, type, {{{}, *value}});
    }
    void histogram(const char* name, const char* help, const LatencyHistogram& counted) {
        auto& histogram = begin(name, help, MetricType::Histogram).metric.emplace_back().histogram;
        for (std::size_t k = 0; k < counted.counts.size(); ++k) {
            const bool last = k == counted.kBounds_s.size();
            ClientMetric::Bucket& bucket = histogram.bucket.emplace_back();
            bucket.cumulative_count = histogram.sample_count += counted.counts[k];
            bucket.upper_bound = last ? std::numeric_limits<double>::infinity() : counted.kBounds_s[k];
        }
        histogram.sample_sum = counted.sum_s;
    }
    [[nodiscard]] std::string text() const {
        std::ostringstream out;
        prometheus::TextSerializer().Serialize(out, all_);
        return out.str();
    }

  private:
    MetricFamily& begin(const std::string& name, const char* help, MetricType type) {
        MetricFamily& family = all_.emplace_back();
        family.name = name;
        family.help = help;
        family.type = type;
        return family;
    }
    std::vector<MetricFamily> all_;
};

constexpr auto kGauge = MetricType::Gauge;
constexpr auto kCounter = MetricType::Counter;

// Registers that are exported unchanged: one row, one metric.
using enum BlockId;
struct Row {
    BlockId block;
    const char* row;
    MetricType type;
    const char* name;
    const char* help;
    double scale = 1;
};
constexpr Row kRows[] = {
    {counters, "seen", kCounter, "hord_parts_seen_total", "Parts that the part sensor saw since the station's start."},
    {counters, "inspected", kCounter, "hord_parts_inspected_total", "Parts with a frame that was judged."},
    {counters, "missed", kCounter, "hord_parts_missed_total", "Parts that passed the ejector without any decision."},
    {counters, "reject_commanded", kCounter, "hord_rejections_commanded_total",
     "Rejections that were due: confirmed, failed, late or under way."},
    {counters, "reject_confirmed", kCounter, "hord_rejections_confirmed_total",
     "Rejections that the ejector confirmed in time."},
    {counters, "reject_failed", kCounter, "hord_rejections_failed_total",
     "Rejections never confirmed, or of a part whose place was lost: a bad part may have passed."},
    {counters, "reject_late", kCounter, "hord_rejections_late_total",
     "Rejections commanded or confirmed too late for the part: a bad part may have passed."},
    {status, "parts_on_line", kGauge, "hord_line_parts", "Parts between part sensor and ejector."},
    {health, "uptime", kGauge, "hord_station_uptime_seconds", "Time since the station's start."},
    {health, "parts_per_minute", kGauge, "hord_parts_per_minute",
     "Pace of the last minute with parts; 0 when none came for a minute."},
    {health, "frames_lost", kCounter, "hord_frames_lost_total", "Frames asked for and never delivered."},
    {health, "frames_corrupt", kCounter, "hord_frames_corrupt_total",
     "Frames that were short, flagged, old or repeated."},
    {health, "frames_waiting", kGauge, "hord_frames_waiting", "Frames that wait for an inspection thread."},
    {health, "bounded", kCounter, "hord_bounded_inspections_total",
     "Parts that were judged by upper bounds, because a limit of work or time was reached."},
    {health, "modbus_connections", kGauge, "hord_modbus_connections", "Connections to the register server."},
    {health, "modbus_requests", kCounter, "hord_modbus_requests_total", "Requests that the register server answered."},
    {health, "modbus_exceptions", kCounter, "hord_modbus_exceptions_total", "Of these, with an exception."},
    {health, "modbus_evicted", kCounter, "hord_modbus_evictions_total", "Connections closed to make room for others."},
    {health, "modbus_broken", kCounter, "hord_modbus_broken_connections_total",
     "Connections closed for bytes that are not Modbus."},
    {health, "processor", kGauge, "hord_processor_temperature_celsius", "Temperature of the station's processor."},
    {health, "disk_free", kGauge, "hord_store_disk_free_ratio", "Share of the disk with the results that is free.",
     0.01},
    {health, "light_output", kGauge, "hord_light_output_ratio",
     "Light of the parts, of what the reference's had; without one, the first since the start.", 0.01},
    {health, "dark_drift", kGauge, "hord_dark_drift_dn", "Change of the sensor's dark level since the start."},
    {health, "uneven", kGauge, "hord_light_uneven_ratio", "Change of the region whose share of the light changed most.",
     0.01},
    {health, "dust", kGauge, "hord_dust_specks", "Places of the optics that respond in most parts."},
    {plc, "overruns", kCounter, "hord_plc_overruns_total", "Results overwritten before the PLC acknowledged them."},
    {plc, "unacknowledged", kGauge, "hord_plc_unacknowledged_results",
     "Results newer than the PLC's last acknowledgement."},
    {status, "plc_heartbeat_age", kGauge, "hord_plc_heartbeat_age_seconds",
     "Time since the PLC's heartbeat last changed.", 0.001},
    {calibration, "age", kGauge, "hord_calibration_age_seconds", "Time since the calibration was made."},
    {calibration, "residual", kGauge, "hord_calibration_residual_pixels", "Root mean square of the calibration's fit."},
    {calibration, "drift", kGauge, "hord_grid_drift_pixels",
     "How far the lenslet grid has moved since the calibration."},
};

// Registers whose texts are the labels of one metric with the value 1.
struct Info {
    const char* name;
    const char* help;
    BlockId block;
    std::array<const char*, 4> rows;  // null: none
};
constexpr Info kInfos[] = {
    {"hord_station_info", "Who the station is.", ident, {"vendor", "product", "firmware", "serial"}},
    {"hord_recipe_info", "The recipe in use.", recipe, {"number", "name", "crc32"}},
};

constexpr std::pair<const char*, const char*> kStatusBits[] = {
    {"run_permit", "1 while the conveyor may run."},
    {"line_stop", "1 while the conveyor must stand."},
    {"plc_lost", "1 while the PLC's heartbeat is missing."},
};

// One value for each key, which becomes a label.
template <class Counts>
Families::Values by_label(const char* label, const Counts& counts) {
    Families::Values values;
    for (const auto& [key, count] : counts)
        values.push_back({{{label, fmt::format("{}", key)}}, static_cast<double>(count)});
    return values;
}

void add_station(Families& f, const Live::Figures& s) {
    f.one("hord_station_up", "1 while the station answers, else 0.", kGauge, s.up ? 1 : 0);
    f.histogram("hord_verdict_latency_seconds", "Part sensor's edge to verdict, of the results that the page saw.",
                s.verdict);
    f.histogram("hord_reject_latency_seconds",
                "Part sensor's edge to confirmed rejection, of the results that the page saw.", s.reject);
    f.add("hord_results_by_reason_total", "Results that the page saw, by the reason of their verdict.", kCounter,
          by_label("reason", s.by_reason));
    f.one("hord_results_missed_total", "Results that were overwritten before the page read them.", kCounter,
          static_cast<double>(s.missed));
    f.one("hord_light_peak_ratio", "Brightest samples of the frame that was kept last, of full scale.", kGauge,
          s.light);
    if (!s.up) return;  // the last values are outdated
    const RegisterSnapshot& m = s.snapshot;
    for (const Info& info : kInfos) {
        Labels labels;
        for (const char* row : info.rows) {
            if (row != nullptr) labels.push_back({row, m.text(info.block, row)});
        }
        f.add(info.name, info.help, kGauge, {{std::move(labels), 1}});
    }
    std::vector<std::pair<std::string_view, double>> states, active, latched, judged, simulated;
    for (const NamedValue& value : find_register(status, "state")->values)
        states.emplace_back(value.name, m.number(status, "state") == static_cast<double>(value.value) ? 1 : 0);
    f.add("hord_station_state", "1 for the state that the station is in (OPC 40100-1), 0 for the others.", kGauge,
          by_label("state", states));
    for (const auto& [bit, help] : kStatusBits) f.one(std::string("hord_") + bit, help, kGauge, m.status_bit(bit));
    for (const FaultInfo& fault : std::span(kFaultTable).first(kDevices))  // named as the devices
        simulated.emplace_back(fault.name, (m.bits(status, "simulated") & fault.bit) != 0 ? 1 : 0);
    f.add("hord_device_simulated", "1 for a device that is simulated or plays recorded frames, 0 for a real one.",
          kGauge, by_label("device", simulated));
    for (const FaultInfo& fault : kFaultTable) {
        active.emplace_back(fault.name, (m.bits(status, "faults_active") & fault.bit) != 0 ? 1 : 0);
        latched.emplace_back(fault.name, (m.bits(status, "faults_latched") & fault.bit) != 0 ? 1 : 0);
    }
    f.add("hord_fault_active", "1 while the fault is present.", kGauge, by_label("fault", active));
    f.add("hord_fault_latched", "1 when the fault was present since the last reset.", kGauge,
          by_label("fault", latched));
    for (const char* verdict : {"pass", "reject", "unfit"})
        judged.emplace_back(verdict, m.number(counters, verdict).value_or(0));
    f.add("hord_parts_judged_total", "Parts by verdict.", kCounter, by_label("verdict", judged));
    for (const Row& row : kRows) {
        const auto value = m.number(row.block, row.row);
        if (value) f.one(row.name, row.help, row.type, *value * row.scale);
    }
}

void add_page(Families& f, const PageFigures& p) {
    f.add("hord_page_build_info", "The page's own software.", kGauge, {{{{"version", p.version}}, 1}});
    f.one("hord_page_viewers", "Browsers that are told of changes.", kGauge, static_cast<double>(p.viewers));
    f.one("hord_page_connections_refused_total", "Connections beyond those that may be open.", kCounter,
          static_cast<double>(p.turned_away));
    f.add("hord_page_replies_total", "Replies of the page, by HTTP status.", kCounter, by_label("status", p.replies));
    f.add("hord_page_commands_total", "Commands given on the page, by what came of them.", kCounter,
          by_label("outcome", p.commands));
    rusage used{};
    ::getrusage(RUSAGE_SELF, &used);
    const auto seconds = [](const timeval& t) {
        return static_cast<double>(t.tv_sec) + 1e-6 * static_cast<double>(t.tv_usec);
    };
    f.one("process_cpu_seconds_total", "Processor time of the page.", kCounter,
          seconds(used.ru_utime) + seconds(used.ru_stime));
    std::ifstream in("/proc/self/statm");
    double all = 0, resident = 0;
    if (in >> all >> resident)
        f.one("process_resident_memory_bytes", "Memory of the page.", kGauge,
              resident * static_cast<double>(::sysconf(_SC_PAGESIZE)));
}

}  // namespace

std::string metrics_text(const Live::Figures& station, const PageFigures& page) {
    Families families;
    add_station(families, station);
    add_page(families, page);
    return families.text();
}

}  // namespace hord::firmware::page
