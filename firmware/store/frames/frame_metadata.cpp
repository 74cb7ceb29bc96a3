#include "firmware/store/frames/frame_metadata.h"

#include "common/json_integer.h"
#include "firmware/store/results/hash_chain.h"
#include "firmware/store/results/records.h"

namespace hord::firmware::store {
namespace {

using common::integer_of;

// The value of the key "maps" where the gradient's map holds bounds. Without the key it is exact everywhere.
constexpr const char* kMapsOfBounds = "judged";

}  // namespace

std::vector<std::uint8_t> bytes_of_maps(const algo::Inspection& inspection) {
    std::vector<std::uint8_t> bytes;
    bytes.reserve(inspection.mask.size() * (3 * sizeof(float) + 1));
    const auto append = [&](algo::Map map) {
        const auto* from = reinterpret_cast<const std::uint8_t*>(map.data());
        bytes.insert(bytes.end(), from, from + map.size_bytes());
    };
    for (const algo::Map map : {inspection.gradient, inspection.frobenius, inspection.transmission}) append(map);
    // Without a comparison of neighbours only the z-scores may be there.
    if (!inspection.compares) append(inspection.z_score);
    bytes.insert(bytes.end(), inspection.mask.begin(), inspection.mask.end());
    return bytes;
}

Judgement judgement_of(const algo::Inspection& inspection) {
    return {std::string(name_of(inspection.verdict)),
            std::string(name_of(inspection.reason)),
            inspection.score,
            to_json(inspection.defects),
            to_hex(sha256(bytes_of_maps(inspection))),
            inspection.has_bounds,
            inspection.bounded,
            inspection.out_of_time};
}

Json to_json(const Judgement& j) {
    Json json{{"verdict", j.verdict},
              {"reason", j.reason},
              {"score", j.score},
              {"defects", j.defects},
              {"maps_sha256", j.maps_sha256}};
    if (j.maps_of_bounds) json["maps"] = kMapsOfBounds;
    if (j.bounded) json["bounded"] = true;
    if (j.out_of_time) json["out_of_time"] = true;
    return json;
}

std::string FrameMetadata::to_json() const {
    Json json{{"hord", 1},    {"station", station}, {"software", software}, {"boot", boot},
              {"part", part}, {"time_us", time_us}, {"role", role}};
    if (trigger != 0) json["trigger"] = trigger;
    json["kind"] = "macro-pixels";  // a geometry note of drivers/files/frame_geometry.h, too
    json["grid"] = {{"m", grid.m}, {"n", grid.n}, {"i", grid.i}, {"j", grid.j}};
    json["bits"] = bits;
    if (dark_dn) json["dark_dn"] = *dark_dn;
    json.update(store::to_json(judgement));
    json["samples_sha256"] = samples_sha256;
    json["recipe"] = recipe;
    return to_line(json);
}

Result<FrameMetadata> FrameMetadata::from_json(const std::string& text, const std::string& name) {
    FrameMetadata data;
    try {
        const Json json = Json::parse(text);
        if (!json.contains("hord"))  // a frame that only notes its geometry
            return fail(ErrorCode::unreadable, name + " says nothing of its part",
                        "name frames that a station has kept");
        data.station = json.value("station", "");
        data.software = json.value("software", "");
        data.boot = integer_of<std::uint32_t>(json.at("boot"));
        data.part = integer_of<std::uint32_t>(json.at("part"));
        data.time_us = integer_of(json, "time_us", UtcMicros{0});
        data.role = json.at("role").get<std::string>();
        data.trigger = integer_of(json, "trigger", 0U);
        const Json& grid = json.at("grid");
        data.grid = {integer_of<int>(grid.at("m")), integer_of<int>(grid.at("n")), integer_of<int>(grid.at("i")),
                     integer_of<int>(grid.at("j"))};
        data.bits = integer_of(json, "bits", 8);
        if (json.contains("dark_dn")) data.dark_dn = integer_of<std::uint32_t>(json.at("dark_dn"));
        data.judgement = {json.at("verdict").get<std::string>(),
                          std::string(algo::present_reason_name(json.at("reason").get<std::string>())),
                          json.at("score").get<float>(),
                          Json::array(),
                          json.at("maps_sha256").get<std::string>(),
                          json.value("maps", "") == kMapsOfBounds,
                          json.value("bounded", false),
                          json.value("out_of_time", false)};
        for (const Json& d : json.at("defects")) {  // numbers as floats, the type in the inspection
            data.judgement.defects.push_back({{"m", d.at("m").get<float>()},
                                              {"n", d.at("n").get<float>()},
                                              {"area", integer_of<std::uint32_t>(d.at("area"))},
                                              {"peak", d.at("peak").get<float>()},
                                              {"kind", d.at("kind").get<std::string>()}});
        }
        data.samples_sha256 = json.at("samples_sha256").get<std::string>();
        data.recipe = json.at("recipe").get<std::string>();
    } catch (const Json::exception& error) {
        return fail(ErrorCode::unreadable, name + " has metadata that cannot be read (" + error.what() + ")",
                    "name frames that a station has kept");
    }
    return data;
}

}  // namespace hord::firmware::store
