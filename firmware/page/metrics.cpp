#include "firmware/page/metrics.h"

#include <fstream>
#include <limits>
#include <sstream>

#include <prometheus/metric_family.h>
#include <prometheus/text_serializer.h>
#include <sys/resource.h>
#include <unistd.h>

#include "firmware/core/faults.h"

namespace hord::firmware::page {
namespace {

using prometheus::ClientMetric;
using prometheus::MetricFamily;
using prometheus::MetricType;
using Labels = std::vector<ClientMetric::Label>;

class Families {
  public:
    void begin(const char* name, const char* help, MetricType type) {
        all_.emplace_back();
        all_.back().name = name;
        all_.back().help = help;
        all_.back().type = type;
    }
    void add(double value, Labels labels = {}) {
        ClientMetric metric;
        metric.label = std::move(labels);
        if (all_.back().type == MetricType::Counter) metric.counter.value = value;
        else metric.gauge.value = value;
        all_.back().metric.push_back(std::move(metric));
    }
    void one(const char* name, const char* help, MetricType type, std::optional<double> value, double scale = 1) {
        if (!value) return;  // not known: absent, not zero
        begin(name, help, type);
        add(*value * scale);
    }
    void histogram(const char* name, const char* help, const LatencyHistogram& counted) {
        begin(name, help, MetricType::Histogram);
        ClientMetric metric;
        std::uint64_t so_far = 0;
        for (std::size_t k = 0; k < counted.kBounds_s.size(); ++k) {
            so_far += counted.counts[k];
            ClientMetric::Bucket bucket;
            bucket.cumulative_count = so_far;
            bucket.upper_bound = counted.kBounds_s[k];
            metric.histogram.bucket.push_back(bucket);
        }
        so_far += counted.counts.back();
        ClientMetric::Bucket beyond;
        beyond.cumulative_count = so_far;
        beyond.upper_bound = std::numeric_limits<double>::infinity();
        metric.histogram.bucket.push_back(beyond);
        metric.histogram.sample_count = so_far;
        metric.histogram.sample_sum = counted.sum_s;
        all_.back().metric.push_back(std::move(metric));
    }
    [[nodiscard]] std::string text() const {
        std::ostringstream out;
        prometheus::TextSerializer().Serialize(out, all_);
        return out.str();
    }

  private:
    std::vector<MetricFamily> all_;
};

constexpr auto kGauge = MetricType::Gauge;
constexpr auto kCounter = MetricType::Counter;

// Registers that are exported unchanged: one row, one metric.
struct Row {
    BlockId block;
    const char* row;
    const char* name;
    MetricType type;
    double scale;
    const char* help;
};
constexpr Row kRows[] = {
    {BlockId::counters, "seen", "hord_parts_seen_total", kCounter, 1,
     "Parts that the part sensor saw since the station's start."},
    {BlockId::counters, "inspected", "hord_parts_inspected_total", kCounter, 1, "Parts with a frame that was judged."},
    {BlockId::counters, "missed", "hord_parts_missed_total", kCounter, 1,
     "Parts that passed the ejector without any decision."},
    {BlockId::counters, "reject_commanded", "hord_rejections_commanded_total", kCounter, 1,
     "Rejections asked of the ejector."},
    {BlockId::counters, "reject_confirmed", "hord_rejections_confirmed_total", kCounter, 1,
     "Rejections that the ejector confirmed in time."},
    {BlockId::counters, "reject_failed", "hord_rejections_failed_total", kCounter, 1,
     "Rejections without confirmation: a bad part may have passed."},
    {BlockId::counters, "reject_late", "hord_rejections_late_total", kCounter, 1,
     "Rejections confirmed after the part had passed."},
    {BlockId::status, "parts_on_line", "hord_line_parts", kGauge, 1, "Parts between part sensor and ejector."},
    {BlockId::health, "uptime", "hord_station_uptime_seconds", kGauge, 1, "Time since the station's start."},
    {BlockId::health, "parts_per_minute", "hord_parts_per_minute", kGauge, 1, "Pace of the newest 256 parts."},
    {BlockId::health, "frames_lost", "hord_frames_lost_total", kCounter, 1, "Frames asked for and never delivered."},
    {BlockId::health, "frames_corrupt", "hord_frames_corrupt_total", kCounter, 1,
     "Frames that were short, flagged, old or repeated."},
    {BlockId::health, "frames_waiting", "hord_frames_waiting", kGauge, 1, "Frames that wait for an inspection thread."},
    {BlockId::health, "modbus_connections", "hord_modbus_connections", kGauge, 1,
     "Connections to the register server."},
    {BlockId::health, "modbus_requests", "hord_modbus_requests_total", kCounter, 1,
     "Requests that the register server answered."},
    {BlockId::health, "modbus_exceptions", "hord_modbus_exceptions_total", kCounter, 1, "Of these, with an exception."},
    {BlockId::health, "modbus_evicted", "hord_modbus_evictions_total", kCounter, 1,
     "Connections closed to make room for others."},
    {BlockId::health, "modbus_broken", "hord_modbus_broken_connections_total", kCounter, 1,
     "Connections closed for bytes that are not Modbus."},
    {BlockId::health, "processor", "hord_processor_temperature_celsius", kGauge, 1,
     "Temperature of the station's processor."},
    {BlockId::health, "disk_free", "hord_store_disk_free_ratio", kGauge, 0.01,
     "Share of the disk with the results that is free."},
    {BlockId::health, "light_output", "hord_light_output_ratio", kGauge, 0.01,
     "Light of the parts, of what the reference's had; without one, the first since the start."},
    {BlockId::health, "dark_drift", "hord_dark_drift_dn", kGauge, 1,
     "Change of the sensor's dark level since the start."},
    {BlockId::health, "uneven", "hord_light_uneven_ratio", kGauge, 0.01,
     "Change of the region whose share of the light changed most."},
    {BlockId::health, "dust", "hord_dust_specks", kGauge, 1, "Places of the optics that respond in most parts."},
    {BlockId::plc, "overruns", "hord_plc_overruns_total", kCounter, 1,
     "Results overwritten before the PLC acknowledged them."},
    {BlockId::plc, "unacknowledged", "hord_plc_unacknowledged_results", kGauge, 1,
     "Results newer than the PLC's last acknowledgement."},
    {BlockId::status, "plc_heartbeat_age", "hord_plc_heartbeat_age_seconds", kGauge, 0.001,
     "Time since the PLC's heartbeat last changed."},
    {BlockId::calibration, "age", "hord_calibration_age_seconds", kGauge, 1, "Time since the calibration was made."},
    {BlockId::calibration, "residual", "hord_calibration_residual_pixels", kGauge, 1,
     "Root mean square of the calibration's fit."},
    {BlockId::calibration, "drift", "hord_grid_drift_pixels", kGauge, 1,
     "How far the lenslet grid has moved since the calibration."},
};

void add_station(Families& f, const Live::Figures& s) {
    f.one("hord_station_up", "1 while the station answers, else 0.", kGauge, s.up ? 1 : 0);
    f.histogram("hord_verdict_latency_seconds", "Part sensor's edge to verdict, of the results that the page saw.",
                s.verdict);
    f.histogram("hord_reject_latency_seconds",
                "Part sensor's edge to confirmed rejection, of the results that the page saw.", s.reject);
    f.begin("hord_results_by_reason_total", "Results that the page saw, by the reason of their verdict.", kCounter);
    for (const auto& [reason, count] : s.by_reason) f.add(static_cast<double>(count), {{"reason", reason}});
    f.one("hord_results_missed_total", "Results that were overwritten before the page read them.", kCounter,
          static_cast<double>(s.missed));
    f.one("hord_light_peak_ratio", "Brightest samples of the frame that was kept last, of full scale.", kGauge,
          s.light);
    if (!s.up) return;  // what the station said before is not what it is
    const RegisterSnapshot& m = s.snapshot;
    f.begin("hord_station_info", "Who the station is.", kGauge);
    f.add(1,
          {{"vendor", m.text(BlockId::ident, "vendor")},
           {"product", m.text(BlockId::ident, "product")},
           {"firmware", m.text(BlockId::ident, "firmware")},
           {"serial", m.text(BlockId::ident, "serial")}});
    f.begin("hord_recipe_info", "The recipe in use.", kGauge);
    f.add(1,
          {{"number", m.text(BlockId::recipe, "number")},
           {"name", m.text(BlockId::recipe, "name")},
           {"crc32", m.text(BlockId::recipe, "crc32")}});
    f.begin("hord_station_state", "1 for the state that the station is in (OPC 40100-1), 0 for the others.", kGauge);
    const auto state = m.number(BlockId::status, "state");
    for (const NamedValue& value : find_register(BlockId::status, "state")->values)
        f.add(state == double{static_cast<double>(value.value)} ? 1 : 0, {{"state", std::string(value.name)}});
    const auto status_bit = [&](const char* name) { return m.status_bit(name) ? 1 : 0; };
    f.one("hord_run_permit", "1 while the conveyor may run.", kGauge, status_bit("run_permit"));
    f.one("hord_line_stop", "1 while the conveyor must stand.", kGauge, status_bit("line_stop"));
    f.one("hord_plc_lost", "1 while the PLC's heartbeat is missing.", kGauge, status_bit("plc_lost"));
    const auto faults = [&](const char* name, const char* help, std::uint32_t set) {
        f.begin(name, help, kGauge);
        for (const FaultInfo& fault : kFaultTable)
            f.add((set & fault.bit) != 0 ? 1 : 0, {{"fault", std::string(fault.name)}});
    };
    faults("hord_fault_active", "1 while the fault is present.", m.bits(BlockId::status, "faults_active"));
    faults("hord_fault_latched", "1 when the fault was present since the last reset.",
           m.bits(BlockId::status, "faults_latched"));
    f.begin("hord_parts_judged_total", "Parts by verdict.", kCounter);
    for (const char* verdict : {"pass", "reject", "unfit"})
        f.add(m.number(BlockId::counters, verdict).value_or(0), {{"verdict", verdict}});
    for (const Row& row : kRows) {
        auto value = m.number(row.block, row.row);
        f.one(row.name, row.help, row.type, value, row.scale);
    }
}

void add_page(Families& f, const PageFigures& p) {
    f.begin("hord_page_build_info", "The page's own software.", kGauge);
    f.add(1, {{"version", p.version}});
    f.one("hord_page_viewers", "Browsers that are told of changes.", kGauge, static_cast<double>(p.viewers));
    f.one("hord_page_connections_refused_total", "Connections beyond those that may be open.", kCounter,
          static_cast<double>(p.turned_away));
    f.begin("hord_page_replies_total", "Replies of the page, by HTTP status.", kCounter);
    for (const auto& [status, count] : p.replies)
        f.add(static_cast<double>(count), {{"status", std::to_string(status)}});
    f.begin("hord_page_commands_total", "Commands given on the page, by what came of them.", kCounter);
    for (const auto& [outcome, count] : p.commands) f.add(static_cast<double>(count), {{"outcome", outcome}});
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
