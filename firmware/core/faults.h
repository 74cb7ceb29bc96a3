// Faults: ONE table for the core, the registers, the journal and its catalogue, the page and hordctl.
//
// To add one: a bit in FaultBit, its row in kFaultTable, and the place that raises it. Then print docs/registers.md
// (hordctl registers --format md) and deploy/hord.catalog (hordd --catalog) again.
#pragma once

#include <array>
#include <bit>
#include <cstddef>
#include <cstdint>
#include <string>
#include <string_view>

namespace hord::firmware {

// A released bit keeps its meaning.
enum FaultBit : std::uint32_t {
    kFaultPartSensor = 1U << 0,
    kFaultStrobe = 1U << 1,
    kFaultSensor = 1U << 2,
    kFaultRejector = 1U << 3,
    kFaultRejectUnconfirmed = 1U << 4,  // line stop: a rejection ended failed or late, or parts are not tracked
    kFaultInspector = 1U << 5,
    kFaultOverrun = 1U << 6,
    kFaultConfiguration = 1U << 7,
    kFaultLightLevel = 1U << 8,
    kFaultPlc = 1U << 9,
    kFaultStore = 1U << 10,
    kFaultPictures = 1U << 11,
    kFaultGridDrift = 1U << 12,
    kFaultLightFading = 1U << 13,
    kFaultDarkDrift = 1U << 14,
    kFaultLightUneven = 1U << 15,
    kFaultDust = 1U << 16,
    kFaultsEnd,  // one more than the value above; kFaultCount is made from it
};
inline constexpr std::size_t kFaultCount = std::bit_width(static_cast<std::uint32_t>(kFaultsEnd) - 1U);

// Who finds the fault. The core learns of faults of service and optics by OutsideFaults; they stop nothing.
enum class FaultSource : std::uint8_t { core, service, optics };

struct FaultInfo {
    FaultBit bit;
    std::string_view name;
    FaultSource source;
    int priority;                 // of the journal entry, as in syslog: 2 critical, 3 error, 4 warning
    std::string_view message_id;  // of the journal entry; a released id keeps its meaning
    std::string_view meaning;
    std::string_view cure;
};

// Every FaultBit once, lowest first.
inline constexpr std::array<FaultInfo, kFaultCount> kFaultTable{{
    {kFaultPartSensor, "part-sensor", FaultSource::core, 3, "00a154d85ed84bccb5c719c2add9ca88",
     "the part sensor or the encoder is lost, silent, or missed an edge",
     "check the light barrier, the encoder and their wiring; look at the line for parts nobody saw; reset"},
    {kFaultStrobe, "strobe", FaultSource::core, 3, "c0290103855d4f5599ec8712e8e3574f",
     "the light did not come, or came at the wrong time",
     "a message before it says by how much, if the light came; check the collimator's driver and supply, "
     "timing.strobe_us and timing.strobe_window_us; reset"},
    {kFaultSensor, "sensor", FaultSource::core, 3, "6e704245a4ff41e3a7949b80dcb0b82e",
     "the lenslet sensor is lost, or its frames are missing, old, repeated, short or corrupt",
     "check the trigger's wire, the sensor's cable and supply, and timing.exposure_us; a message beside it may say "
     "more; reset"},
    {kFaultRejector, "rejector", FaultSource::core, 3, "de1b1471320a48eab7a788d106762832",
     "the rejector's module does not answer, refuses, or does not hold its outputs as written",
     "see the message before it; check its supply, network, address and profile (rejector.host, rejector.port, "
     "rejector.unit, rejector.profile)"},
    {kFaultRejectUnconfirmed, "reject-unconfirmed", FaultSource::core, 2, "4350cc1721e54f21acd552a09ddbef12",
     "a bad part may have passed the ejector: the line is stopped",
     "take the parts behind the ejector off the line, check the ejector, then reset"},
    {kFaultInspector, "inspector", FaultSource::core, 3, "9ed89eddd6844325b600e6129ec04ece",
     "an inspection failed or its queue was full",
     "see the log; check that the frame's size is that of [inspection], lower the line's rate or raise "
     "inspection.threads"},
    {kFaultOverrun, "overrun", FaultSource::core, 3, "627bf3225fac4cb6a34acb115ee347dd",
     "verdicts or exposures come later than the line allows",
     "of an exposure a message before it names part and lateness; of verdicts, lower the line's rate, raise "
     "inspection.threads or move the ejector downstream (line.transport_ms)"},
    {kFaultConfiguration, "configuration", FaultSource::service, 3, "a930d55d954540f3ae889fe46f2c7a8c",
     "the recipe that was in use before the restart cannot be used, or the one in use cannot be kept for the next",
     "see the log for the file and the reason, then commit or select the recipe again"},
    {kFaultLightLevel, "light-level", FaultSource::core, 3, "43f2f1936e854f08b5927b0fe339d309",
     "frames are too dark or saturated",
     "check the collimator and the optics for dirt, then timing.strobe_us and timing.exposure_us"},
    {kFaultPlc, "plc-lost", FaultSource::core, 3, "990d3cd8381d422f850c86bd84e0164b",
     "the PLC's heartbeat stopped; the station does what plc.policy says",
     "check the PLC and its network; the heartbeat must change several times within plc.timeout_ms"},
    {kFaultStore, "store", FaultSource::service, 3, "c20f0dab7307416d98d1afa216472950",
     "results cannot be stored now; they wait in memory, and the line goes on",
     "see the log for the reason: free the disk, make it writable, or move a damaged file away"},
    {kFaultPictures, "pictures", FaultSource::service, 4, "6ae3785aa68348aebc18209a00138d38",
     "frames that should have been kept were dropped; verdicts and results are not concerned",
     "see the log for the reason: free the disk, use a faster one, or keep fewer frames ([store])"},
    {kFaultGridDrift, "grid-drift", FaultSource::service, 4, "8b733f2f7bba4320b76d5504078a192f",
     "the lenslet grid has moved by a tenth of a pixel; verdicts do not suffer yet, and parts are judged as before",
     "let the optics settle in temperature, check that the sensor is fastened; if it stays, calibrate (hordctl "
     "calibrate) and restart"},
    {kFaultLightFading, "light-fading", FaultSource::optics, 4, "83e066eefde0496b8ce4dac31331004f",
     "parts have much less light than they had: the LED ages, something lies in the light's way, or the parts' glass "
     "is another; parts are judged as before",
     "see HEALTH light_output; clean the collimator and the optics, raise timing.strobe_us or replace the LED; if the "
     "parts are meant to be darker, teach a reference of them"},
    {kFaultDarkDrift, "dark-drift", FaultSource::optics, 4, "e7d3251d9b6b489d9f4ef739016262c6",
     "the sensor's dark level has changed; parts are judged as before",
     "see HEALTH dark_drift; look for stray light and a hot or failing sensor; if it stays, correct the camera's black "
     "level or the recipe's dark_dn"},
    {kFaultLightUneven, "light-uneven", FaultSource::optics, 4, "b1b7148ee1cb4aaea6b19e0ab12d4f97",
     "a region of the field has another share of the light than it had; parts are judged as before",
     "see HEALTH uneven_m and uneven_n for its middle; clean the collimator, the window and the lenses there, check "
     "that the LED sits straight"},
    {kFaultDust, "dust", FaultSource::optics, 4, "e0c6a143346e499d83a9464aeaa60f19",
     "the same places of the sensor respond in part after part: dust on the optics, or the same flaw in every part; "
     "parts are judged as before",
     "see HEALTH dust_m and dust_n for the largest: clean the lenslet array, the sensor's window and the lenses; if it "
     "stays, look whether every part has a flaw or a mark there; if it is meant to be there, teach a reference or give "
     "the recipe an ignore zone"},
}};
static_assert(
    [] {
        for (std::size_t k = 0; k < kFaultCount; ++k) {
            if (kFaultTable[k].bit != 1U << k || kFaultTable[k].message_id.size() != 32) return false;
        }
        return true;
    }(),
    "row k of kFaultTable describes bit k");

constexpr const FaultInfo& info_of(FaultBit fault) {
    return kFaultTable[static_cast<std::size_t>(std::countr_zero(std::uint32_t{fault}))];
}

constexpr std::uint32_t faults_from(FaultSource source) {
    std::uint32_t bits = 0;
    for (const FaultInfo& fault : kFaultTable) bits |= fault.source == source ? fault.bit : 0U;
    return bits;
}
inline constexpr std::uint32_t kOpticsFaults = faults_from(FaultSource::optics);
inline constexpr std::uint32_t kOutsideFaults = faults_from(FaultSource::service) | kOpticsFaults;

// Why the line stop was raised: the first cause since the last reset.
enum class LineStopCause : std::uint8_t {
    none,
    reject_failed,     // the rejection of `part` was not confirmed
    reject_late,       // the rejection of `part` came too late
    place_lost,        // no run permit while `part` came or was on its way: its place is not known
    untracked_part,    // a part came that the station cannot follow: `part`, or one without a number (0)
    part_sensor_lost,  // the part sensor was lost, or missed edges
    encoder_silent,
    line_unknown,  // nothing proves that the line is empty
};
struct LineStop {
    LineStopCause cause = LineStopCause::none;
    std::uint32_t part = 0;  // 0: none, or not known
    bool operator==(const LineStop&) const = default;
};

// For people: "the rejection of part 12 was not confirmed". Empty without a line stop.
std::string text_of(const LineStop& why);

// What is said of a fault when it comes: name, meaning, why (of a line stop), cure.
std::string text_of(const FaultInfo& fault, const LineStop& why = {});

// The names of the bits that are set, ", " between them; "none" for 0.
std::string names_of_faults(std::uint32_t bits);

}  // namespace hord::firmware
