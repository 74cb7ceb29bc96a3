#include "firmware/core/faults.h"

namespace hord::firmware {
namespace {

constexpr FaultText kTexts[] = {
    {kFaultPartSensor, "part-sensor", "the part sensor or the encoder is lost, silent, or missed an edge",
     "check the light barrier, the encoder and their wiring; look at the line for parts nobody saw; reset"},
    {kFaultStrobe, "strobe", "the light did not come, or came at the wrong time",
     "check the collimator's driver and supply, and timing.strobe_us; reset"},
    {kFaultSensor, "sensor", "the lenslet sensor is lost, or its frames are missing, old, repeated, short or corrupt",
     "check the sensor's cable and supply, and timing.exposure_us; reset"},
    {kFaultRejector, "rejector", "the rejector's module does not answer",
     "check its supply, network and address (rejector.host, rejector.port, rejector.unit)"},
    {kFaultRejectUnconfirmed, "reject-unconfirmed", "a bad part may have passed the ejector: the line is stopped",
     "take the parts behind the ejector off the line, check the ejector, then reset"},
    {kFaultInspector, "inspector", "an inspection failed or its queue was full",
     "see the log; check that the frame's size is that of [inspection], lower the line's rate or raise "
     "inspection.threads"},
    {kFaultOverrun, "overrun", "verdicts come later than the line allows",
     "lower the line's rate, raise inspection.threads or move the ejector downstream (line.transport_ms)"},
    {kFaultConfiguration, "configuration", "the configuration could not be used",
     "see the log; correct the file and reload"},
    {kFaultLightLevel, "light-level", "frames are too dark or saturated",
     "check the collimator and the optics for dirt, then timing.strobe_us and timing.exposure_us"},
    {kFaultPlc, "plc-lost", "the PLC's heartbeat stopped; the station does what plc.policy says",
     "check the PLC and its network; the heartbeat must change several times within plc.timeout_ms"},
    {kFaultStore, "store", "results cannot be stored now; they wait in memory, and the line goes on",
     "see the log for the reason: free the disk, make it writable, or move a damaged file away"},
    {kFaultPictures, "pictures",
     "frames that should have been kept were dropped; verdicts and results are not concerned",
     "see the log for the reason: free the disk, use a faster one, or keep fewer frames ([store])"},
    {kFaultGridDrift, "grid-drift",
     "the lenslet grid has moved by a tenth of a pixel; verdicts do not suffer yet, and parts are judged as before",
     "let the optics settle in temperature, check that the sensor is fastened; if it stays, calibrate (hordctl "
     "calibrate) and restart"},
    {kFaultLightFading, "light-fading",
     "parts have much less light than they had: the LED ages, something lies in the light's way, or the parts' glass "
     "is another; parts are judged as before",
     "see HEALTH light_output; clean the collimator and the optics, raise timing.strobe_us or replace the LED; if the "
     "parts are meant to be darker, teach a reference of them"},
    {kFaultDarkDrift, "dark-drift", "the sensor's dark level has changed; parts are judged as before",
     "see HEALTH dark_drift; look for stray light and a hot or failing sensor; if it stays, correct the camera's black "
     "level or the recipe's dark_dn"},
    {kFaultLightUneven, "light-uneven",
     "a region of the field has another share of the light than it had; parts are judged as before",
     "see HEALTH uneven_m and uneven_n for its middle; clean the collimator, the window and the lenses there, check "
     "that the LED sits straight"},
    {kFaultDust, "dust",
     "the same places of the sensor respond in part after part: dust on the optics, or the same flaw in every part; "
     "parts are judged as before",
     "see HEALTH dust_m and dust_n for the largest: clean the lenslet array, the sensor's window and the lenses; if it "
     "stays, look whether every part has a flaw or a mark there; if it is meant to be there, teach a reference or give "
     "the recipe an ignore zone"},
};

}  // namespace

std::span<const FaultText> fault_texts() { return kTexts; }

std::string names_of_faults(std::uint32_t bits) {
    std::string names;
    for (const FaultText& text : kTexts) {
        if ((bits & text.bit) == 0) continue;
        if (!names.empty()) names += ", ";
        names += text.name;
    }
    return names.empty() ? "none" : names;
}

}  // namespace hord::firmware
