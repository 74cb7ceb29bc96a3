#include "drivers/genicam/genicam_features.h"

#include <charconv>
#include <cmath>
#include <optional>
#include <sstream>
#include <vector>

#include "common/nearest_name.h"
#include "drivers/camera_process/camera_port.h"

namespace hord::drivers {
namespace {

void add_names(ArvDomNode* node, std::vector<std::string>& names) {
    if (ARV_IS_GC_FEATURE_NODE(node)) {
        if (const char* name = arv_gc_feature_node_get_name(ARV_GC_FEATURE_NODE(node))) names.emplace_back(name);
    }
    for (ArvDomNode* child = arv_dom_node_get_first_child(node); child != nullptr;
         child = arv_dom_node_get_next_sibling(child))
        add_names(child, names);
}

template <class Number>
std::optional<Number> number_of(const std::string& text) {
    Number value{};
    const auto read = std::from_chars(text.data(), text.data() + text.size(), value);
    return read.ec == std::errc() && read.ptr == text.data() + text.size() ? std::optional(value) : std::nullopt;
}

template <class Number>
std::string range(Number low, Number high) {
    std::ostringstream out;
    out << low << " to " << high;
    return out.str();
}

class Feature {
  public:
    Feature(ArvDevice* device, const std::string& name, const std::string& value)
        : device_(device), name_(name), value_(value) {}

    Result<void> set() {
        ArvGcNode* const node = arv_device_get_feature(device_, name_.c_str());
        if (node == nullptr || !ARV_IS_GC_FEATURE_NODE(node)) return unknown();
        if (ARV_IS_GC_CATEGORY(node))
            return fail(ErrorCode::invalid_argument, name_ + " is a category, a group of features",
                        "name one of its features");
        if (arv_device_is_feature_available(device_, name_.c_str(), failed_.out()) == FALSE) {
            return fail(ErrorCode::unsupported, "feature " + name_ + " is not available as the camera is set",
                        "set the feature that it depends on first: features are set in the order of the file");
        }
        if (arv_gc_feature_node_get_actual_access_mode(ARV_GC_FEATURE_NODE(node)) == ARV_GC_ACCESS_MODE_RO) {
            return fail(
                ErrorCode::unsupported, "feature " + name_ + " can only be read",
                "take it out of [[sensor.feature]], or set the feature that unlocks it first: they are set in the "
                "order of the file");
        }
        if (ARV_IS_GC_COMMAND(node)) return command();
        if (ARV_IS_GC_ENUMERATION(node)) return enumeration();
        if (ARV_IS_GC_BOOLEAN(node)) return boolean();
        if (ARV_IS_GC_FLOAT(node)) return floating();
        if (ARV_IS_GC_INTEGER(node)) return integer();
        arv_device_set_string_feature_value(device_, name_.c_str(), value_.c_str(), failed_.out());
        return done();
    }

  private:
    [[nodiscard]] tl::unexpected<Error> wrong(const std::string& use) const {
        return fail(ErrorCode::invalid_argument, "feature " + name_ + " cannot be \"" + value_ + "\"", "use " + use);
    }
    [[nodiscard]] Result<void> unknown() const {
        std::vector<std::string> names;
        add_names(ARV_DOM_NODE(arv_device_get_genicam(device_)), names);
        // "Gain" of a camera that has GainRaw is no misspelling.
        std::string longer;
        for (const std::string& name : names) {
            if (name.starts_with(name_) && (longer.empty() || name.size() < longer.size())) longer = name;
        }
        const auto nearest = longer.empty() ? common::nearest_name(name_, names) : std::optional(longer);
        return fail(ErrorCode::unsupported, "the camera has no feature \"" + name_ + "\"",
                    nearest ? "did you mean " + *nearest + "?" : "look its name up in the camera's manual");
    }
    [[nodiscard]] Result<void> done() const {
        if (!failed_) return {};
        return fail(ErrorCode::refused, "feature " + name_ + " was refused: " + failed_.what(),
                    "features may depend on one another: they are set in the order of the file");
    }

    Result<void> command() {
        if (value_ != "true") return wrong("true: it is a command");
        arv_device_execute_command(device_, name_.c_str(), failed_.out());
        return done();
    }
    Result<void> enumeration() {
        guint count = 0;
        const GlibOwned<const char*> entries(arv_device_dup_available_enumeration_feature_values_as_strings(
            device_, name_.c_str(), &count, failed_.out()));
        const std::vector<std::string> there(entries.get(), entries.get() + (entries ? count : 0));
        if (std::ranges::find(there, value_) == there.end()) return wrong("one of " + list_of(there));
        arv_device_set_string_feature_value(device_, name_.c_str(), value_.c_str(), failed_.out());
        return done();
    }
    Result<void> boolean() {
        if (value_ != "true" && value_ != "false") return wrong("true or false");
        arv_device_set_boolean_feature_value(device_, name_.c_str(), value_ == "true" ? TRUE : FALSE, failed_.out());
        return done();
    }
    Result<void> floating() {
        double low = 0, high = 0;
        arv_device_get_float_feature_bounds(device_, name_.c_str(), &low, &high, failed_.out());
        const auto number = number_of<double>(value_);
        if (!number || !std::isfinite(*number) || *number < low || *number > high) return wrong(range(low, high));
        arv_device_set_float_feature_value(device_, name_.c_str(), *number, failed_.out());
        return done();
    }
    Result<void> integer() {
        gint64 low = 0, high = 0;
        arv_device_get_integer_feature_bounds(device_, name_.c_str(), &low, &high, failed_.out());
        const gint64 step = arv_device_get_integer_feature_increment(device_, name_.c_str(), failed_.out());
        const auto number = number_of<gint64>(value_);
        if (!number || *number < low || *number > high || (step > 1 && (*number - low) % step != 0))
            return wrong("a whole number, " + range(low, high) +
                         (step > 1 ? " in steps of " + std::to_string(step) : ""));
        arv_device_set_integer_feature_value(device_, name_.c_str(), *number, failed_.out());
        return done();
    }

    ArvDevice* const device_;
    const std::string& name_;
    const std::string& value_;
    ArvFailure failed_;
};

}  // namespace

Result<void> set_feature(ArvDevice* device, const std::string& name, const std::string& value) {
    return Feature(device, name, value).set();
}

bool has_feature(ArvDevice* device, const char* name) {
    ArvFailure failed;
    return arv_device_is_feature_available(device, name, failed.out()) != FALSE;
}

}  // namespace hord::drivers
